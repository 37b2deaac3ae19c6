//! Tests that every command finds the same packages, and the same tests in them.

use super::report::function;
use super::*;

const HALF: &str = "fn half(x: f32) -> f32 { return 0.5 * x; }\n";
const DECLARED: &str =
    "[[test]]\nfunction = \"half\"\nover = { x = \"0..1\" }\nin_range = [0, 1]\n";
const FAILS: &str =
    "[[test]]\nfunction = \"half\"\nover = { x = \"0..1\" }\nin_range = [0, 0.25]\n";
const WORKSPACE: &str = "[workspace]\nmembers = [\"crates/*\"]\n";
const MEMBER: &str = "[package]\nname = \"engine\"\nversion = \"0.1.0\"\nedition = \"2024\"\n";

/// All commands that look for tests.
const COMMANDS: [&[&str]; 5] = [
    &["test", "--paths", "cpu"],
    &["watch", "--once", "--paths", "cpu"],
    &["check"],
    &["list"],
    &["compare", "before"],
];

fn run(folder: &FilePath, arguments: &[&str]) -> Ran {
    output(command(folder, arguments).env("CARGO", "true"))
}

/// A project with these manifests, and with these files in the folder that `shaders` names.
fn with(shaders: &str, manifests: &[(&str, &str)], files: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (file, text) in manifests {
        write(folder.path(), file, text);
    }
    for (file, text) in files {
        write(&folder.path().join(shaders), file, text);
    }
    write(folder.path(), "before/a.wgsl", HALF);
    folder
}

/// If a file should declare tests and declares none, each command fails. This holds for packages that a manifest
/// declares, and for folders called `shaders`. With a valid file, each command succeeds.
// Lesson 185
#[test]
fn a_misnamed_test_file_fails_every_command() {
    let none: &[(&str, &str)] = &[];
    let declared = "[workspace.metadata.karat]\npackages = [\"assets/wgsl\"]\n";
    let members: &[(&str, &str)] = &[
        ("Cargo.toml", WORKSPACE),
        (
            "crates/engine/Cargo.toml",
            &format!("{MEMBER}[package.metadata.karat]\npackages = [\"wgsl\"]\n"),
        ),
    ];
    for (at, (shaders, manifests)) in [
        ("shaders", none),
        ("shaders", &[("Cargo.toml", "[workspace]\n")]),
        ("assets/wgsl", &[("Cargo.toml", &format!("[workspace]\n{declared}"))]),
        ("crates/engine/wgsl", members),
        (
            "crates/engine/shaders",
            &[("Cargo.toml", WORKSPACE), ("crates/engine/Cargo.toml", MEMBER)],
        ),
    ]
    .into_iter()
    .enumerate()
    {
        // The kinds of broken files don't depend on the folder, so only the first folder tests all of them.
        let kinds = if at == 0 { 5 } else { 1 };
        for (file, text) in [
            ("a.test.toml", DECLARED.replace("function", "functionn")),
            ("a.test.toml", "\u{0}garbage".to_owned()),
            ("a.tests.toml", DECLARED.to_owned()),
            ("sub/tests.toml", DECLARED.to_owned()),
            ("a_test.wgls", "@test fn t() {}\n".to_owned()),
        ]
        .into_iter()
        .take(kinds)
        {
            let folder = with(shaders, manifests, &[("a.wgsl", HALF), (file, &text)]);
            for arguments in COMMANDS {
                // The other packages don't change the result.
                let ran = run(folder.path(), arguments);
                assert_eq!(ran.code, Some(1), "{shaders}/{file} {arguments:?}: {ran:?}");
                assert!(ran.out.contains(file), "{shaders}/{file} {arguments:?}: {ran:?}");
            }
        }
        let folder = with(shaders, manifests, &[("a.wgsl", HALF), ("a.test.toml", DECLARED)]);
        for arguments in COMMANDS {
            let ran = run(folder.path(), arguments);
            assert_eq!(ran.code, Some(0), "{shaders} {arguments:?}: {ran:?}");
        }
    }
}

/// A misspelt key in a member's manifest is an error. Karat doesn't ignore it.
// Lesson 186
#[test]
fn a_slip_in_a_members_manifest_is_an_error() {
    let member = format!("{MEMBER}[package.metadata.karat]\npackage = [\"wgsl\"]\n");
    let manifests = [("Cargo.toml", WORKSPACE), ("crates/engine/Cargo.toml", &*member)];
    let folder = with("crates/engine/wgsl", &manifests, &[("a.wgsl", HALF)]);
    for arguments in COMMANDS {
        let error = run(folder.path(), arguments).error();
        let place = FilePath::new("crates").join("engine").join("Cargo.toml");
        assert!(error.contains("unknown field `package`"), "{error}");
        assert!(error.contains(&*place.to_string_lossy()), "{error}");
    }
}

/// If a Rust test uses shaders, `karat test` also runs the tests beside these shaders. After this run, other commands
/// find these tests, too.
// Lesson 186
#[test]
fn tests_beside_shaders_that_rust_tests_use_are_run() {
    let manifests = [("Cargo.toml", WORKSPACE), ("crates/engine/Cargo.toml", MEMBER)];
    let files = [("a.wgsl", HALF), ("a.test.toml", FAILS)];
    let folder = with("crates/engine/assets/shaders", &manifests, &files);
    let path = folder.path();
    let unknown = run(path, &["check"]).error();
    assert!(unknown.contains("no recorded test used a package"), "{unknown}");
    // The record of a Rust test that passes.
    let script = "mkdir -p \"$KARAT_RECORD\"\ncp verdict \"$KARAT_RECORD/1.jsonl\"\n";
    write(path, "test", script);
    let verdict = function("a::half", "gl", "pass", None);
    let used = "\"package\":\"crates/engine/assets/shaders\"";
    write(path, "verdict", &verdict.replace("\"package\":\"shaders\"", used));
    let ran = output(command(path, &["test", "--paths", "cpu"]).env("CARGO", "/bin/sh"));
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.out.contains("test a::half in_range ... FAILED"), "{ran:?}");
    assert!(run(path, &["check"]).good().contains("shaders: valid"));
    assert!(run(path, &["list"]).good().contains("a::half"));
    let watched = run(path, &["watch", "--once", "--paths", "cpu"]);
    assert!(watched.code == Some(1) && watched.out.contains("1 of 1 tests fail"), "{watched:?}");
    // A run of some tests keeps the list of all packages.
    let filtered = output(command(path, &["test", "nothing"]).env("CARGO", "true"));
    assert_ne!(filtered.code, Some(0), "{filtered:?}");
    assert!(run(path, &["list"]).good().contains("a::half"));
}

/// `karat test` and `karat watch` pass despite errors in a folder `shaders` that has no tests, and that no manifest or
/// test uses. `karat check` validates the folder.
// Lesson 187
#[test]
fn a_folder_that_no_test_uses_fails_no_run() {
    let manifests = [("Cargo.toml", WORKSPACE), ("crates/engine/Cargo.toml", MEMBER)];
    let folder =
        with("crates/engine/shaders", &manifests, &[("a.wgsl", HALF), ("a.test.toml", DECLARED)]);
    write(folder.path(), "shaders/template.wgsl", "fn f() -> f32 { return {{ value }}; }\n");
    let ran = run(folder.path(), &["test", "--paths", "cpu"]).good();
    assert!(
        ran.contains(
            "no test uses the shaders in `shaders`: `karat check` validates these shaders"
        ),
        "{ran}"
    );
    run(folder.path(), &["watch", "--once", "--paths", "cpu"]).good();
    assert_eq!(run(folder.path(), &["check"]).code, Some(1));
}

/// Karat runs the tests beside a module in any folder, even in a folder called `target`.
// Lesson 187
#[test]
fn each_folder_of_modules_has_its_tests() {
    for folder in ["target", "deep/er"] {
        let project = with(folder, &[], &[("a.wgsl", HALF), ("a.test.toml", FAILS)]);
        let ran = run(project.path(), &["test", ".", "--paths", "cpu"]);
        assert_eq!(ran.code, Some(1), "{folder}: {ran:?}");
        assert!(ran.out.contains("a::half in_range ... FAILED"), "{folder}: {ran:?}");
    }
}

/// Karat finds shaders in the folder `shaders`, with and without a karat.toml in this folder.
// Lesson 187
#[test]
fn the_folder_shaders_is_found_by_every_command() {
    for (manifests, own) in
        [(&[][..], None), (&[][..], Some("")), (&[("Cargo.toml", "[workspace]\n")], Some(""))]
    {
        let folder = with("shaders", manifests, &[("a.wgsl", HALF), ("a.test.toml", DECLARED)]);
        std::fs::remove_dir_all(folder.path().join("before")).expect("it is there");
        if let Some(text) = own {
            write(folder.path(), "shaders/karat.toml", text);
        }
        for arguments in [
            &["check"][..],
            &["list"],
            &["compare", "shaders"],
            &["test", "--paths", "cpu"],
            &["test", ".", "--paths", "cpu"],
            &["watch", "--once", "--paths", "cpu"],
            &["watch", ".", "--once", "--paths", "cpu"],
        ] {
            let ran = run(folder.path(), arguments);
            assert_eq!(ran.code, Some(0), "{manifests:?} {own:?} {arguments:?}: {ran:?}");
        }
        write(folder.path(), "shaders/a.wgsl", &HALF.replace("0.5", "1.5"));
        for arguments in [&["test", "--paths", "cpu"][..], &["watch", "--once", "--paths", "cpu"]] {
            let ran = run(folder.path(), arguments);
            assert_eq!(ran.code, Some(1), "{manifests:?} {own:?} {arguments:?}: {ran:?}");
        }
    }
}

/// `karat test` reports tests outside of `shaders`, even if a karat.toml in `shaders` makes this folder a package.
// Lesson 187
#[test]
fn tests_outside_of_shaders_are_reported() {
    let folder =
        with("shaders", &[], &[("a.wgsl", HALF), ("a.test.toml", DECLARED), ("karat.toml", "")]);
    let test = "import karat::expect_true;\n@test fn own() { expect_true(true); }\n";
    write(folder.path(), "own/own.wgsl", test);
    let ran = run(folder.path(), &["test", "--paths", "cpu"]).good();
    assert!(
        ran.contains("Karat didn't run 1 test outside of `shaders`; to run these tests, name own"),
        "{ran}"
    );
}

/// Every command reports files of declared tests that are outside of `shaders`, even if `shaders` has a karat.toml. No
/// command reports files of tests inside of `shaders`.
#[test]
fn declared_tests_outside_of_shaders_are_reported() {
    for (own, how) in
        [(None, "`karat test .` runs all tests"), (Some(""), "move the files into `shaders`")]
    {
        let folder = with("shaders", &[], &[("a.wgsl", HALF), ("a.test.toml", DECLARED)]);
        let path = folder.path();
        std::fs::remove_dir_all(path.join("before")).expect("it is there");
        if let Some(text) = own {
            write(path, "shaders/karat.toml", text);
        }
        let commands = [
            &["test", "--paths", "cpu"][..],
            &["watch", "--once", "--paths", "cpu"],
            &["check"],
            &["list"],
        ];
        for arguments in commands {
            let ran = run(path, arguments).good();
            assert!(!ran.contains("Karat didn't run"), "{arguments:?}: {ran}");
        }
        write(path, "tests/a.test.toml", FAILS);
        write(path, "tests/deep/c.tests.toml", FAILS);
        write(path, "b.test.toml", "not even TOML [[");
        write(path, "notes.toml", "[package]\n");
        let told = "Karat didn't run 3 files of tests outside of `shaders`, b.test.toml, tests/a.test.toml, \
                    tests/deep/c.tests.toml; ";
        for arguments in commands {
            let ran = run(path, arguments);
            assert!(ran.out.contains(&format!("{told}{how}")), "{own:?} {arguments:?}: {ran:?}");
        }
        if own.is_some() {
            for arguments in
                [&["test", ".", "--paths", "cpu"][..], &["watch", ".", "--once", "--paths", "cpu"]]
            {
                let ran = run(path, arguments);
                assert!(ran.out.contains("didn't run 3 files of tests"), "{arguments:?}: {ran:?}");
            }
        } else {
            let ran = run(path, &["test", ".", "--paths", "cpu"]);
            assert!(ran.code == Some(1) && ran.out.contains("b.test.toml:1 ... FAILED"), "{ran:?}");
        }
        // If the command names a folder, Karat uses this folder.
        let ran = run(path, &["test", "shaders", "--paths", "cpu"]).good();
        assert!(!ran.contains("Karat didn't run"), "{ran}");
    }
}

/// It is an error if the second argument, the filter, is the name of an existing file or folder.
#[test]
fn a_second_folder_is_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path();
    let test = |body: &str| {
        format!("import karat::expect_true;\n@test fn tells() {{ expect_true({body}); }}\n")
    };
    write(path, "s/a_test.wgsl", &test("true"));
    write(path, "t/a_test.wgsl", &test("false"));
    write(path, "u.wgsl", HALF);
    for second in ["t", "t/", "./t", "t/a_test.wgsl", "u.wgsl", "s"] {
        for command in [
            &["test", "s", second, "--paths", "cpu"][..],
            &["watch", "s", second, "--once", "--paths", "cpu"],
        ] {
            let error = run(path, command).error();
            assert!(
                error.contains(&format!("`{second}` is an existing folder or file")),
                "{error}"
            );
        }
    }
    let filtered = run(path, &["test", "s", "tell", "--paths", "cpu"]).good();
    assert!(filtered.contains("1 check, 0 failed"), "{filtered}");
    assert_eq!(run(path, &["test", "t", "--paths", "cpu"]).code, Some(1));
    // If a folder's name is part of the name of a test in another folder, the argument may mean both.
    write(path, "shaders/a_test.wgsl", &test("true").replace("tells", "s_is_told"));
    let error = run(path, &["test", "s", "--paths", "cpu"]).error();
    for part in ["`karat test ./s`", "`karat test shaders --exact 'a_test::s_is_told'`"] {
        assert!(error.contains(part), "{error}");
    }
    assert_eq!(run(path, &["test", "./s", "--paths", "cpu"]).code, Some(0));
    // The argument doesn't mean a folder without shaders.
    write(path, "told/readme.txt", "no shader");
    let told = run(path, &["test", "told", "--paths", "cpu"]).good();
    assert!(told.contains("a_test::s_is_told"), "{told}");
}

/// Circular links and named pipes don't make a command hang: Karat follows each link once, and reads no pipe.
// Lesson 188
#[cfg(unix)]
#[test]
fn links_in_circles_and_pipes_hang_no_command() {
    let folder = with(".", &[], &[("a.wgsl", HALF), ("a.test.toml", DECLARED)]);
    let path = folder.path();
    std::fs::remove_dir_all(path.join("before")).expect("it is there");
    for name in ["l1", "l2"] {
        std::os::unix::fs::symlink(".", path.join(name)).expect("a link");
    }
    // Without a module, the folder isn't part of the package.
    write(path, "before.txt", "");
    let ran = run(path, &["test", ".", "--paths", "cpu"]).good();
    assert!(ran.contains("1 check, 0 failed"), "{ran}");
    let listed = run(path, &["list"]).good();
    assert_eq!(listed.matches("half").count(), 1, "{listed}");
    run(path, &["watch", ".", "--once", "--paths", "cpu"]).good();
    let pipe = |name: &str| {
        let made = Command::new("mkfifo").arg(path.join(name)).status().expect("mkfifo runs");
        assert!(made.success());
    };
    let told = "the path names a pipe, a socket or a device, not a file";
    pipe("p.test.toml");
    for arguments in [
        &["test", ".", "--paths", "cpu"][..],
        &["watch", ".", "--once", "--paths", "cpu"],
        &["check"],
        &["list"],
    ] {
        let ran = run(path, arguments);
        assert!(ran.code == Some(1) && ran.out.contains(told), "{arguments:?}: {ran:?}");
    }
    std::fs::remove_file(path.join("p.test.toml")).expect("it is there");
    pipe("rows");
    let table = "[[test]]\nfunction = \"half\"\ntable = \"rows\"\ntolerance = \"exact\"\n";
    write(path, "a.test.toml", table);
    let ran = run(path, &["test", ".", "--paths", "cpu"]);
    assert!(ran.code == Some(1) && ran.out.contains(told), "{ran:?}");
    pipe("karat.toml");
    assert!(run(path, &["check"]).error().contains(told));
    pipe("Cargo.toml");
    let error = run(path, &["check"]).error();
    assert!(error.contains("Cargo.toml"), "{error}");
}

/// A folder that contains only tests passes. The tests use shaders of another package.
// Lesson 190
#[test]
fn a_folder_of_tests_alone_passes() {
    let folder = with("shaders", &[], &[("a.wgsl", HALF)]);
    let path = folder.path();
    write(path, "tests/karat.toml", "[dependencies]\nshaders = { path = \"../shaders\" }\n");
    let test = "import karat::expect_near;\nimport shaders::a::half;\n\
                @test fn halves() { expect_near(half(3.0), 1.5, 0.0); }\n";
    write(path, "tests/a.wgsl", test);
    let ran = run(path, &["test", "tests", "--paths", "cpu"]).good();
    assert!(ran.contains("1 check, 0 failed"), "{ran}");
    assert!(!ran.contains("isn't known") && !ran.contains("declares no"), "{ran}");
    assert!(run(path, &["check", "--shaders", "tests"]).good().contains("1 test)"));
    write(path, "shaders/a.wgsl", &HALF.replace("0.5", "0.25"));
    assert_eq!(run(path, &["test", "tests", "--paths", "cpu"]).code, Some(1));
}

/// Karat calls a function of a module that has an include guard, and runs the module's tests.
// Lesson 189
#[test]
fn a_guarded_module_is_tested() {
    let guarded = |text: &str| format!("#ifndef A_WGSL\n#define A_WGSL\n{text}#endif\n");
    let test =
        "import karat::expect_near;\n@test fn halves() { expect_near(half(3.0), 1.5, 0.0); }\n";
    let text = guarded(&format!("{test}{HALF}"));
    let folder = with("shaders", &[], &[("a.wgsl", &text), ("a.test.toml", DECLARED)]);
    let path = folder.path();
    let ran = run(path, &["test", "--paths", "cpu"]).good();
    assert!(ran.contains("2 checks, 0 failed"), "{ran}");
    let called = run(path, &["call", "a::half", "3", "--path", "cpu"]).good();
    assert!(called.contains("1.5"), "{called}");
    write(path, "shaders/a.wgsl", &text.replace("0.5", "0.75"));
    let ran = run(path, &["test", "--paths", "cpu"]);
    assert!(ran.code == Some(1) && ran.out.contains("a::halves"), "{ran:?}");
}
