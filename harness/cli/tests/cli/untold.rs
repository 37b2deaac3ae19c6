//! Tests that Karat reports each step that a run leaves out or couldn't do.

use super::*;

const CPU: [&str; 2] = ["--paths", "cpu"];

fn test(folder: &FilePath, more: &[&str]) -> Ran {
    karat(folder, &[&["test", "wgsl"], more, &CPU].concat())
}

fn folder(shader: &str, declared: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "wgsl/a.wgsl", shader);
    write(folder.path(), "wgsl/a.test.toml", declared);
    folder
}

const CONDITION: &str = "@if(fast) fn f(x: f32) -> f32 { return -1.0; }\n\
                         @else fn f(x: f32) -> f32 { return x; }\n";
const IN_RANGE: &str = "[[test]]\nfunction = \"f\"\nover = { x = \"0..1\" }\nin_range = [0, 1]\n";

#[test]
fn features_reach_the_tests_of_a_folder() {
    let folder = folder(CONDITION, IN_RANGE);
    let gated = "import karat::expect_true;\n@if(fast) @test fn gated() { expect_true(false); }\n\
                 #ifdef SLOW\n@test fn slow() { expect_true(false); }\n#endif\n\
                 @test fn free() { expect_true(true); }\n";
    write(
        folder.path(),
        "wgsl/b_test.wgsl",
        &gated.replace("#ifdef SLOW\n", "").replace("#endif\n", ""),
    );
    let without = test(folder.path(), &["--feature", "fast=false"]);
    let told = "1 test not run because of a false condition: b_test::gated @if(fast)";
    assert!(without.out.contains(told), "{without:?}");
    assert!(
        without.out.contains(" compared; 1 test left out because of false conditions;"),
        "{without:?}"
    );
    let with = test(folder.path(), &["--feature", "fast"]);
    assert!(with.code == Some(1) && with.out.contains("4 checks, 3 failed"), "{with:?}");
    // The printed command repeats the run with the same features.
    assert!(with.out.contains("karat test wgsl --feature fast=true --exact"), "{with:?}");
    let again = karat(folder.path(), &["replay", "--print", &replayed(&with.out)]).good();
    assert!(again.contains("--feature fast=true"), "{again}");
    let unknown = test(folder.path(), &["--feature", "fasd"]).error();
    assert!(unknown.contains("uses the feature `fasd`"), "{unknown}");
}

/// If a test fails before it reaches the case to replay, the report shows the test's message, and the verdicts
/// of the other tests.
#[test]
fn a_failure_before_the_replayed_case_is_reported() {
    let folder = folder("fn f(x: f32) -> f32 { return 2.0 * x; }\n", IN_RANGE);
    let replay = |case: &str| {
        let mut command = command(folder.path(), &["test", "wgsl", "--paths", "cpu"]);
        output(command.env("KARAT_CASE", case))
    };
    let ran = replay("g/is_finite/3");
    assert!(ran.code == Some(1) && ran.out.contains("`a::f` fails stays_within"), "{ran:?}");
    // A test that passes and replays nothing fails if it runs singly.
    let two =
        format!("{IN_RANGE}[[test]]\nfunction = \"f\"\nover = {{ x = \"0..1\" }}\nfinite = true\n");
    write(folder.path(), "wgsl/a.wgsl", "fn f(x: f32) -> f32 { return x; }\n");
    write(folder.path(), "wgsl/a.test.toml", &two);
    let ran = replay("a::f/is_finite/3");
    assert!(ran.code == Some(1), "{ran:?}");
    for part in
        ["1 passed; 1 failed", "`a::f in_range` replays nothing", "karat test wgsl --exact NAME"]
    {
        assert!(ran.out.contains(part), "no `{part}`: {ran:?}");
    }
}

fn replayed(out: &str) -> String {
    let line = out.lines().find_map(|line| line.strip_prefix("karat replay "));
    line.and_then(|line| line.split(' ').next()).expect("a failure is named").to_owned()
}

#[test]
fn a_file_whose_name_resembles_a_test_file_fails_the_run() {
    let folder = folder("fn f(x: f32) -> f32 { return x; }\n", IN_RANGE);
    test(folder.path(), &[]).good();
    for name in ["wgsl/a_test.toml", "wgsl/a.test.tml", "wgsl/B.TEST.TOML"] {
        write(folder.path(), name, IN_RANGE);
        let ran = test(folder.path(), &[]);
        let told = format!("`{name}` isn't read: Karat reads declared tests from `*.test.toml`");
        assert!(ran.code == Some(1) && ran.out.contains(&told), "{ran:?}");
        std::fs::remove_file(folder.path().join(name)).expect("it is there");
    }
    let declared = karat(folder.path(), &["test", "wgsl/a.test.toml"]).error();
    assert!(
        declared.contains("name the module of these tests, such as `wgsl/a.wgsl`"),
        "{declared}"
    );
}

/// Each error in a declared test has the line of its key, and each failing row of a table has the row's line.
#[test]
fn declared_tests_have_places_of_their_own() {
    let shader = "override GAIN = 1.0;\nfn f(x: f32) -> f32 { return x * GAIN; }\n\
                  @fragment fn fs() -> @location(0) vec4f { return vec4f(0.5); }\n";
    let f = "[[test]]\nfunction = \"f\"\n";
    for (declared, place, part) in [
        (
            format!("{f}finite = true\nover = {{ x = \"1..0\" }}\n"),
            "4:1",
            "starts at 1, above its end 0",
        ),
        (
            format!("{f}finite = true\nover = {{ x = \"0,,1\" }}\n"),
            "4:1",
            "isn't a domain of a number",
        ),
        (format!("{f}finite = true\ncases = 0\n"), "4:1", "has 0 cases"),
        (
            format!("{f}finite = true\ncases = 100000000000\n"),
            "4:1",
            "but a check can have at most 4294967296",
        ),
        (
            format!("{f}finite = true\nfails_on = {{ vulcan = \"no\" }}\n"),
            "4:1",
            "did you mean `vulkan`?",
        ),
        (format!("{f}finite = true\noverride = {{ GAIM = 2 }}\n"), "4:1", "did you mean `GAIN`?"),
        (
            format!("{f}symmetric_in = [\"x\", \"x\"]\ntolerance = \"exact\"\n"),
            "3:1",
            "a parameter can't be swapped with itself",
        ),
        (format!("{f}equals = 1\ntolerance = \"abs nan\"\n"), "4:1", "isn't a bound"),
        (format!("{f}tolerance = \"4 ulp\"\nequals = nan\n"), "4:1", "returned NaN"),
        (
            format!("{f}tolerance = \"4 ulp\"\ngolden = \"../../evil\"\n"),
            "4:1",
            "can't name a golden",
        ),
        (format!("{f}in_range = [0, 1, 2]\n"), "3:12", "the list must have two entries, but has 3"),
        (
            format!("{f}symmetric_in = [\"a\", \"b\", \"c\"]\n"),
            "3:16",
            "the list must have two entries, but has 3",
        ),
        (
            format!("{f}golden = \"f\"\n"),
            "3:1",
            "a tolerance is missing, such as tolerance = \"4 ulp\"\n",
        ),
        (
            "[[frame]]\nname = \"a\"\nsize = [8, 8]\nformats = [\"rgba8\"]\nfragment = \"fs\"\n"
                .to_owned(),
            "4:1",
            "there is no format `rgba8`",
        ),
        (
            "[[frame]]\nname = \"a\"\nsize = [8, 8]\nfragment = \"fss\"\nwith = { g = 1 }\n"
                .to_owned(),
            "4:1",
            "did you mean `a::fs`?",
        ),
    ] {
        let folder = folder(shader, &declared);
        let ran = test(folder.path(), &[]);
        let place = format!("wgsl/a.test.toml:{place}");
        assert!(ran.code == Some(1) && ran.out.contains(&place), "no {place}: {}", ran.out);
        assert!(ran.out.contains(part), "no `{part}`: {}", ran.out);
        assert!(!ran.out.contains("error: error:"), "{}", ran.out);
    }
    // Errors also have their lines in three cases: on two paths, for a resource with its name from messages, and for a
    // test that expects nothing.
    let declared = format!("{f}finite = true\nfails_on = {{ cpu = \"no\", vulkan = \"no\" }}\n");
    let both = folder(shader, &declared);
    let ran = karat(both.path(), &["test", "wgsl", "--paths", "cpu,vulkan"]);
    assert!(ran.out.contains("wgsl/a.test.toml:4:1"), "{}", ran.out);
    let reads =
        "@group(0) @binding(0) var<uniform> gain: f32;\nfn f(x: f32) -> f32 { return x * gain; }\n";
    let bound = folder(reads, &format!("{f}finite = true\nwith = {{ \"a::gain\" = 2 }}\n"));
    test(bound.path(), &[]).good();
    write(
        bound.path(),
        "wgsl/a.test.toml",
        &format!("{f}finite = true\nwith = {{ gain = [1, 2] }}\n"),
    );
    let ran = test(bound.path(), &[]);
    assert!(ran.out.contains("error: with: `gain`: ") && ran.code == Some(1), "{}", ran.out);
    write(bound.path(), "wgsl/b_test.wgsl", "@test fn nothing() {}\n");
    let ran = test(bound.path(), &[]);
    assert!(ran.out.contains("wgsl/b_test.wgsl:1:1"), "{}", ran.out);
    let folder = folder(shader, &format!("{f}table = \"t.csv\"\ntolerance = \"2 ulp\"\n"));
    write(folder.path(), "wgsl/t.csv", "# squares\nx,result\n1,1\n\n2,4\n");
    let row = "row of the worst case: wgsl/t.csv:5:1";
    assert!(test(folder.path(), &[]).out.contains(row));
    write(folder.path(), "wgsl/t.csv", "x,result\n1,one\n");
    assert!(test(folder.path(), &[]).out.contains("wgsl/t.csv:2:1"));
}

/// If the process that runs tests is killed, Karat names the tests that have no verdict yet. This test finds the
/// process in `/proc`, which only Linux has.
#[cfg(target_os = "linux")]
#[test]
fn tests_of_a_killed_process_are_named() {
    let folder = folder(
        "fn f(x: f32) -> f32 { return x; }\n",
        &format!(
            "{IN_RANGE}cases = 400000000\n[[test]]\nfunction = \"f\"\nfinite = true\ncases = 10\n"
        ),
    );
    let mut command = command(folder.path(), &["test", "wgsl", "--paths", "cpu"]);
    let child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("it starts");
    let children = format!("/proc/{0}/task/{0}/children", child.id());
    let began = std::time::Instant::now();
    let suite = loop {
        let text = std::fs::read_to_string(&children).unwrap_or_default();
        if let Some(id) = text.split(' ').next().filter(|id| !id.is_empty()) {
            break id.to_owned();
        }
        assert!(began.elapsed().as_secs() < 60, "it has no process for tests");
        std::thread::sleep(std::time::Duration::from_millis(10));
    };
    std::thread::sleep(std::time::Duration::from_millis(500));
    let killed = Command::new("kill").args(["-9", &suite]).status();
    assert!(killed.expect("it runs").success());
    let ended = child.wait_with_output().expect("it ends");
    let out = String::from_utf8_lossy(&ended.stdout);
    assert_eq!(ended.status.code(), Some(1), "{out}");
    assert!(out.contains("signal: 9"), "{out}");
    assert!(
        out.contains("before these tests had a verdict: ") && out.contains("a::f in_range"),
        "{out}"
    );
    // The test counts as failed, and runs again singly.
    write(folder.path(), "wgsl/a.test.toml", &format!("{IN_RANGE}finite = true\n"));
    let failed = test(folder.path(), &["--failed"]).good();
    assert!(failed.contains("stays_within") && failed.contains("1 check, 0 failed"), "{failed}");
}

/// `karat report` and `karat replay` without a folder use the last tested folder, even if it isn't called `shaders`.
/// These commands print file names relative to the working directory.
#[test]
fn report_and_replay_find_the_last_tested_folder() {
    let folder = folder("fn f(x: f32) -> f32 { return x + 1.0; }\n", IN_RANGE);
    let path = folder.path();
    let nested = path.join("assets/with space");
    write(&nested, "a.wgsl", "fn f(x: f32) -> f32 { return x + 2.0; }\n");
    write(&nested, "a.test.toml", IN_RANGE);
    let nested = "assets/with space";
    for (tested, named) in [("wgsl", "wgsl"), (nested, "'assets/with space'")] {
        let ran = karat(path, &["test", tested, "--paths", "cpu", "--github"]);
        let place = format!("file={tested}/a.wgsl,line=1,");
        assert!(ran.code == Some(1) && ran.out.contains(&place), "{ran:?}");
        let later = karat(path, &["report", "--github"]);
        assert!(later.code == Some(1) && later.out.contains(&place), "{later:?}");
        let replay = karat(path, &["replay", "--print"]).good();
        assert!(replay.contains(&format!("karat test {named} --exact")), "{replay}");
        assert!(karat(path, &["replay"]).out.contains("1 of 1 case fails"));
    }
}

#[test]
fn exact_names_are_exact() {
    let folder = folder("fn f(x: f32) -> f32 { return x; }\n", IN_RANGE);
    test(folder.path(), &["a::f in_range", "--exact"]).good();
    let near = test(folder.path(), &["in_range", "--exact"]).failure(3);
    assert!(near.contains("none of 1 test is called `in_range`"), "{near}");
}

/// If the arguments in a golden of values differ from the test's arguments, the test fails, and the table of results
/// shows `FAIL` for the test.
#[test]
fn a_golden_with_other_rows_fails_in_the_table() {
    let golden = "[[test]]\nfunction = \"f\"\nover = { x = \"0..1\" }\ncases = 20\ngolden = \"f\"\n\
                  tolerance = \"exact\"\n";
    let folder = folder("fn f(x: f32) -> f32 { return x; }\n", golden);
    assert_eq!(test(folder.path(), &[]).code, Some(1));
    karat(folder.path(), &["accept", "f", "--goldens", "wgsl/golden", "--because", "the first"])
        .good();
    test(folder.path(), &[]).good();
    write(folder.path(), "wgsl/a.test.toml", &golden.replace("0..1", "0..2"));
    let ran = test(folder.path(), &[]);
    let row = ran.out.lines().find(|line| line.starts_with("a::f ") && line.contains(" cpu "));
    assert!(ran.code == Some(1) && row.is_some_and(|row| row.contains("FAIL")), "{ran:?}");
}

/// If a test has only one case, Karat doesn't store this case as a failure to try again, because every run tries the
/// case.
#[test]
fn a_test_without_arguments_fails_once() {
    let folder = folder("fn f(x: f32) -> f32 { return x; }\n", IN_RANGE);
    let red = "@test fn t() { karat::expect_true(false); }\n";
    write(folder.path(), "wgsl/a_test.wgsl", red);
    for _ in 0..2 {
        let ran = test(folder.path(), &["a_test"]);
        assert!(ran.out.contains("1 of 1 case fails"), "{ran:?}");
    }
}

/// The settings of a folder apply to all modules that its tests in WGSL import, as they do for the folder's declared
/// tests.
#[test]
fn features_reach_what_a_test_in_wgsl_imports() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path();
    write(path, "noise/v.wgsl", "@if(hard) const GAIN = 7.0;\n@else const GAIN = 3.0;\n");
    let settings =
        "[dependencies]\nnoise = { path = \"../noise\" }\n[features]\nhard = true\nSAMPLES = 4\n";
    write(path, "wgsl/karat.toml", settings);
    let module = "import noise::v::GAIN;\nimport constants::SAMPLES;\nfn f(x: f32) -> f32 { return GAIN * x; }\n\
                  fn k() -> i32 { return SAMPLES; }\n";
    write(path, "wgsl/a.wgsl", module);
    let tests = "import package::a::{f, k};\nimport karat::{expect_near, expect_true};\n\
                 @test fn gain() { expect_near(f(1.0), 7.0, 0.0); }\n\
                 @test fn count(@over(0, 1) x: f32) { expect_true(k() == 4); }\n";
    write(path, "wgsl/a_test.wgsl", tests);
    let defined = "#define GAIN 5\nimport karat::expect_true;\nfn q() -> i32 { return #{GAIN}; }\n\
                   @test fn defined() { expect_true(q() == 5); }\n";
    write(path, "wgsl/b_test.wgsl", defined);
    test(path, &[]).good();
    let soft = test(path, &["--feature", "hard=false"]);
    assert!(soft.code == Some(1) && soft.out.contains("saw 3, expected 7"), "{soft:?}");
    let samples = test(path, &["--feature", "SAMPLES=5"]);
    assert!(samples.code == Some(1) && samples.out.contains("3 checks, 1 failed"), "{samples:?}");
}

/// A replay of one case keeps the record of the whole run.
#[test]
fn a_replay_keeps_the_record_of_the_last_run() {
    let folder = folder(
        "fn f(x: f32) -> f32 { return x + 1.0; }\nfn g(x: f32) -> f32 { return x + 2.0; }\n",
        "",
    );
    let both = format!("{IN_RANGE}{}", IN_RANGE.replace("\"f\"", "\"g\""));
    write(folder.path(), "wgsl/a.test.toml", &both);
    let names = |out: &str| -> Vec<String> {
        let lines = out.lines().filter_map(|line| line.strip_prefix("karat replay "));
        lines.map(|line| line.split(' ').next().unwrap_or_default().to_owned()).collect()
    };
    let failed = names(&test(folder.path(), &[]).out);
    assert_eq!(failed.len(), 2);
    for name in failed.iter().chain(&failed) {
        let again = karat(folder.path(), &["replay", name]);
        assert!(again.code == Some(1) && again.out.contains("1 of 1 case fails"), "{again:?}");
    }
    assert_eq!(names(&karat(folder.path(), &["report"]).out), failed);
    let failed = karat(folder.path(), &["test", "wgsl", "--failed", "--paths", "cpu"]);
    assert!(failed.out.contains("2 checks, 2 failed"), "{failed:?}");
}

#[test]
fn a_misnamed_file_of_declared_tests_fails() {
    let folder = folder("fn f(x: f32) -> f32 { return x; }\n", IN_RANGE);
    for name in ["wgsl/tests.toml", "wgsl/test.toml", "wgsl/mtest.toml", "wgsl/a.test.toml.txt"] {
        write(folder.path(), name, IN_RANGE);
        let ran = test(folder.path(), &[]);
        let told = format!("`{name}` isn't read");
        assert!(ran.code == Some(1) && ran.out.contains(&told), "{ran:?}");
        std::fs::remove_file(folder.path().join(name)).expect("it is there");
    }
    // Backup copies of editors, Cargo's targets, other settings, and hidden files have no effect.
    for name in ["wgsl/a.test.toml~", "wgsl/a.test.toml.orig", "wgsl/Cargo.toml"] {
        write(folder.path(), name, &IN_RANGE.replace("[0, 1]", "[2, 3]"));
    }
    std::fs::remove_file(folder.path().join("wgsl/Cargo.toml")).expect("it is there");
    write(folder.path(), "wgsl/taplo.toml", "[formatting]\n");
    #[cfg(unix)]
    std::os::unix::fs::symlink("nowhere", folder.path().join("wgsl/.#a.wgsl")).expect("a link");
    test(folder.path(), &[]).good();
}

#[test]
fn a_folder_whose_tests_all_have_a_condition_says_so() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let text = "@if(fast) @test fn t() { karat::expect_true(true); }\n";
    write(folder.path(), "wgsl/a.wgsl", "fn f(x: f32) -> f32 { return x; }\n");
    write(folder.path(), "wgsl/a_test.wgsl", text);
    let error = test(folder.path(), &[]).failure(3);
    assert!(error.contains("the conditions of all tests are false"), "{error}");
    test(folder.path(), &["--feature", "fast"]).good();
}

/// If a run in the parent folder wrote the record, `karat report` in the inner folder prints file names relative to the
/// inner folder.
#[test]
fn a_record_has_correct_places_from_a_subfolder() {
    let folder = folder("fn f(x: f32) -> f32 { return x + 1.0; }\n", IN_RANGE);
    assert_eq!(test(folder.path(), &[]).code, Some(1));
    let within = karat(&folder.path().join("wgsl"), &["report", "--github"]);
    assert!(within.out.contains("file=a.wgsl,line=1,col=1,"), "{within:?}");
    // A function that a test in WGSL calls is tested.
    write(
        folder.path(),
        "wgsl/a_test.wgsl",
        "import package::a::f;\n@test fn t() { karat::expect_true(f(1.0) == 2.0); }\n",
    );
    std::fs::remove_file(folder.path().join("wgsl/a.test.toml")).expect("it is there");
    test(folder.path(), &[]).good();
    let listed = karat(folder.path(), &["list"]).good();
    assert!(listed.lines().any(|line| line.contains("a::f") && line.contains("yes")), "{listed}");
}

/// `karat check` without a folder uses `shaders`, even if the last run tested another folder.
#[test]
fn a_run_of_another_folder_does_not_change_the_default_folder() {
    let folder = folder("fn f(x: f32) -> f32 { return x; }\n", IN_RANGE);
    write(folder.path(), "shaders/bad.wgsl", "fn f(x: f32) -> f32 { return y; }\n");
    let is_bad = |arguments: &[&str]| {
        let ran = karat(folder.path(), arguments);
        assert!(
            ran.code != Some(0) && format!("{ran:?}").contains("bad.wgsl"),
            "{arguments:?}: {ran:?}"
        );
    };
    is_bad(&["check"]);
    test(folder.path(), &[]).good();
    is_bad(&["check"]);
    is_bad(&["test"]);
    is_bad(&["check", "shaders"]);
    karat(folder.path(), &["check", "wgsl"]).good();
    karat(folder.path(), &["hazards", "wgsl"]).good();
    karat(folder.path(), &["check", "wgsl", "--shaders", "shaders"]).failure(2);
}

/// Tests two mistakes that beginners make in a first test.
#[test]
fn two_common_mistakes_of_first_tests_have_hints() {
    let folder = folder("fn f(x: f32) -> f32 { return x; }\n", IN_RANGE);
    for (text, hint) in [
        ("@test fn t() { expect_true(true); }\n", "add `import karat::expect_true;`"),
        ("@case(10) @test fn t() { karat::expect_true(true); }\n", "did you mean `@cases`?"),
    ] {
        write(folder.path(), "wgsl/a_test.wgsl", text);
        let ran = test(folder.path(), &[]);
        assert_eq!(ran.code, Some(1), "{ran:?}");
        assert!(ran.out.contains(hint) || ran.err.contains(hint), "{ran:?}");
    }
}
