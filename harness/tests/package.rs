//! Linking across modules and packages, and the messages of its errors.

use std::path::Path;

use karat::check::Failure;
use karat::unstable::probe::{ProbeError, Probed};
use karat::{Package, Ulp};

fn error(package: &Package, function: &str) -> String {
    match Probed::new(package, function) {
        Ok(probed) => panic!("`{function}` was linked:\n{}", probed.kernel()),
        Err(error) => error.to_string(),
    }
}

fn write(folder: &Path, file: &str, text: impl AsRef<[u8]>) {
    let path = folder.join(file);
    std::fs::create_dir_all(path.parent().expect("in the folder")).expect("a folder");
    std::fs::write(path, text).expect("written");
}

/// The error message for a function of the package in `folder`, without the name of the temporary folder.
fn error_in(folder: &tempfile::TempDir, function: &str) -> String {
    let package = Package::open(folder.path()).expect("a folder");
    let name = package.name();
    let parent = folder.path().parent().expect("in another folder").display().to_string();
    error(&package, function).replace(&format!("{parent}/"), "").replace(&name, "shaders")
}

const MATH: &str = "const PI: f32 = 3.14159265;\n\n\
                    // Squares its argument.\n\
                    fn square(x: f32) -> f32 {\n    return x * x;\n}\n";

#[test]
fn imports_are_followed_through_modules_and_packages() {
    let noise = Package::from_modules(
        "noise",
        [
            (
                "value",
                "import package::hash::mix_bits;\nfn noise(i: u32) -> f32 { return f32(mix_bits(i)); }",
            ),
            ("hash", "fn mix_bits(i: u32) -> u32 { return i * 747796405u; }"),
        ],
    );
    let textures = Package::from_modules(
        "textures",
        [("marble", "import noise::value::noise as value_noise;\nfn marble(i: u32) -> f32 { return value_noise(i) + 1.0; }")],
    )
    .depends_on("noise", &noise);
    let package = Package::from_modules(
        "shaders",
        [
            ("math", MATH.to_owned()),
            ("area", "import package::math::{PI, square};\nfn disk(r: f32) -> f32 { return PI * square(r); }".to_owned()),
            ("inline", "fn ball(r: f32) -> f32 { return package::math::PI * r; }".to_owned()),
            ("wall", "import textures::marble::marble;\nfn wall(i: u32) -> f32 { return marble(i); }".to_owned()),
        ],
    )
    .depends_on("textures", &textures);
    for function in ["area::disk", "inline::ball", "wall::wall"] {
        let probed = Probed::new(&package, function).unwrap_or_else(|e| panic!("{function}: {e}"));
        assert_eq!(probed.function().name, function);
    }
    // The kernel contains only the declarations that the function needs.
    let kernel = Probed::new(&package, "inline::ball").expect("linked").kernel().to_owned();
    assert!(!kernel.contains("square"), "{kernel}");
}

/// A test names a function of a dependency by its import path: `shaders::pbr::f`. If the package itself has a function
/// of this name, the test calls the package's own function.
#[test]
fn a_function_agrees_with_one_of_another_package() {
    let shaders = |factor: &str| {
        let half = format!("fn half(x: f32) -> f32 {{ return {factor} * x; }}");
        let f = "import package::math::half;\nfn f(x: f32) -> f32 { return half(x); }";
        Package::from_modules("shaders", [("math", half), ("pbr", f.to_owned())])
    };
    let fast = ("fast", "fn fast(x: f32) -> f32 { return x - 0.5 * x; }");
    let other = Package::from_modules("other", [fast]).depends_on("shaders", &shaders("0.5"));
    let check = |package: &Package, reference: &str| {
        let check = package.function("fast::fast").over(0.0..=1.0_f32);
        check.unrecorded().try_agrees_with_function(reference, Ulp(0.0))
    };
    check(&other, "shaders::pbr::f").expect("they are the same");
    let wrong = Package::from_modules("other", [fast]).depends_on("shaders", &shaders("0.25"));
    assert!(matches!(check(&wrong, "shaders::pbr::f"), Err(Failure::Disagreement(_))));
    let own = ("shaders::pbr", "fn f(x: f32) -> f32 { return 0.5 * x; }");
    let own = Package::from_modules("other", [fast, own]).depends_on("shaders", &shaders("0.25"));
    check(&own, "shaders::pbr::f").expect("its own");
    let unknown = check(&other, "shaders::pbr::g").expect_err("there is none").to_string();
    assert!(unknown.contains("`shaders::pbr::g`"), "{unknown}");
    let unknown = check(&other, "math::half").expect_err("not its own").to_string();
    assert!(unknown.contains("`math::half`"), "{unknown}");
}

// Lesson 52
#[test]
fn features_choose_branches() {
    let source = "fn f() -> f32 {\n    @if(fast) return 1.0;\n    @if(!fast) return 2.0;\n}";
    let slow = Probed::new(&Package::from_source("s", source), "f").expect("linked");
    let fast = Package::from_source("s", source).feature("fast", true);
    let fast = Probed::new(&fast, "f").expect("linked");
    assert!(slow.kernel().contains("return 2.0") && !slow.kernel().contains("return 1.0"));
    assert!(fast.kernel().contains("return 1.0") && !fast.kernel().contains("return 2.0"));
}

#[test]
fn bindings_that_a_function_does_not_use_are_left_out() {
    let source = "@group(0) @binding(0) var<uniform> unused: vec4f;\n\
                  @group(0) @binding(1) var<uniform> used: vec4f;\n\
                  fn f() -> f32 { return used.x; }\nfn g() -> f32 { return 1.0; }";
    let package = Package::from_source("s", source);
    let bindings = |name| Probed::new(&package, name).expect("linked").function().bindings.clone();
    assert_eq!(bindings("f").iter().map(|b| b.path.as_str()).collect::<Vec<_>>(), ["used"]);
    assert!(bindings("g").is_empty());
    let kernel = Probed::new(&package, "f").expect("linked").kernel().to_owned();
    assert!(!kernel.contains("unused"));
}

#[test]
fn signatures_spans_and_comments_are_reflected() {
    let source = "struct Hit { t: f32, n: vec3<f32>, ids: array<u32, 2> }\n\n\
                  /// Distance along a ray.\n/// Negative behind the eye.\n\
                  fn hit(origin: vec3f, axes: mat3x3f, on: bool) -> Hit {\n    \
                  return Hit(origin.x, axes[0], array<u32, 2>(1u, select(0u, 1u, on)));\n}";
    let probed = Probed::new(&Package::from_source("rays", source), "hit").expect("linked");
    let function = probed.function();
    assert_eq!(function.to_string(), "hit(origin: vec3<f32>, axes: mat3x3<f32>, on: bool) -> Hit");
    assert_eq!(function.doc, "Distance along a ray.\nNegative behind the eye.");
    assert_eq!(function.span.to_string(), "<rays>:5:1");
    assert_eq!(function.result.lane_names(), [".t", ".n.x", ".n.y", ".n.z", ".ids[0]", ".ids[1]"]);
}

#[test]
fn a_syntax_error_is_shown_where_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    write(
        folder.path(),
        "area.wgsl",
        "import package::math::square;\n\nfn f(x: f32) -> f32 { return square(x); }",
    );
    write(
        folder.path(),
        "math.wgsl",
        "// A module\nfn square(x: f32) -> f32 {\n    let y = x * ;\n    return y;\n}",
    );
    insta::assert_snapshot!(error_in(&folder, "area::f"));
}

// Lesson 47
#[test]
fn a_type_error_in_an_imported_module_is_shown_at_its_line_and_column() {
    let folder = tempfile::tempdir().expect("a folder");
    write(
        folder.path(),
        "area.wgsl",
        "import package::math::square;\n\nfn f(x: f32) -> f32 { return square(x); }",
    );
    write(
        folder.path(),
        "math.wgsl",
        "// Comments, @if branches and names are gone from the linked text.\n\
         import package::constants::PI;\n\n\
         fn square(x: f32) -> f32 {\n    // Also gone.\n    @if(fast) return 0.0;\n    \
         let scaled   =   x * PI;\n    return scaled * vec2f(1.0, 2.0);\n}",
    );
    write(folder.path(), "constants.wgsl", "const PI = 3.14;");
    insta::assert_snapshot!(error_in(&folder, "area::f"));
}

#[test]
fn an_unknown_name_inside_a_function_is_shown_where_it_is() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "area.wgsl", "fn f(x: f32) -> f32 {\n    return sqare(x);\n}");
    insta::assert_snapshot!(error_in(&folder, "area::f"));
}

// Lesson 47
#[test]
fn an_unresolved_import_is_shown_at_the_import() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "math.wgsl", MATH);
    write(
        folder.path(),
        "item.wgsl",
        "import package::math::{PI, sqare};\nfn f(x: f32) -> f32 { return sqare(x); }",
    );
    write(
        folder.path(),
        "module.wgsl",
        "// First line.\nimport package::mathe::square;\nfn f(x: f32) -> f32 { return square(x); }",
    );
    write(
        folder.path(),
        "package.wgsl",
        "import noise::value::perlin;\nfn f(x: f32) -> f32 { return perlin(x); }",
    );
    write(
        folder.path(),
        "inline.wgsl",
        "fn f(x: f32) -> f32 {\n    return package::math::cube(x);\n}",
    );
    let errors = ["item::f", "module::f", "package::f", "inline::f"].map(|f| error_in(&folder, f));
    insta::assert_snapshot!(errors.join("\n\n"));
}

#[test]
fn an_import_cycle_is_shown_with_its_route() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "a.wgsl", "@publish import package::b::x;\nfn f() -> f32 { return x; }");
    write(folder.path(), "b.wgsl", "@publish import package::c::x;");
    write(folder.path(), "c.wgsl", "@publish import package::b::x;");
    insta::assert_snapshot!(error_in(&folder, "a::f"));
}

/// Modules may import each other, but their declarations may not depend on each other in a cycle.
#[test]
fn modules_may_import_each_other_but_functions_may_not_recurse() {
    let folder = tempfile::tempdir().expect("a folder");
    write(
        folder.path(),
        "a.wgsl",
        "import package::b::g;\nfn f(x: f32) -> f32 { return g(x); }\nconst A = 2.0;",
    );
    write(folder.path(), "b.wgsl", "import package::a::A;\nfn g(x: f32) -> f32 { return A * x; }");
    let package = Package::open(folder.path()).expect("a folder");
    assert!(Probed::new(&package, "a::f").is_ok());
    write(folder.path(), "b.wgsl", "import package::a::f;\nfn g(x: f32) -> f32 { return f(x); }");
    insta::assert_snapshot!(error_in(&folder, "a::f"));
}

#[test]
fn a_duplicate_name_is_shown_twice() {
    let folder = tempfile::tempdir().expect("a folder");
    write(
        folder.path(),
        "a.wgsl",
        "fn f() -> f32 { return 1.0; }\n\nfn f() -> f32 { return 2.0; }",
    );
    insta::assert_snapshot!(error_in(&folder, "a::f"));
}

#[test]
fn a_file_that_is_not_utf8_names_its_line() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "a.wgsl", b"// fine\n// caf\xe9\nfn f() -> f32 { return 1.0; }");
    insta::assert_snapshot!(error_in(&folder, "a::f"));
}

#[test]
fn missing_and_empty_folders_are_errors() {
    let missing = Package::open("no/such/folder").expect_err("missing");
    assert_eq!(missing.to_string(), "there is no folder or file `no/such/folder`");
    static DECLARED: Package = karat::package!("no/such/folder");
    assert!(error(&DECLARED, "a::f").contains("doesn't exist"));
    let folder = tempfile::tempdir().expect("a folder");
    insta::assert_snapshot!(error_in(&folder, "a::f"));
}

#[test]
fn an_unknown_function_names_the_nearest() {
    let package = Package::from_modules("shaders", [("math", MATH)]);
    insta::assert_snapshot!(
        [error(&package, "math::sqare"), error(&package, "square"), error(&package, "maths::x")]
            .join("\n")
    );
}

#[test]
fn functions_that_cannot_be_called_are_refused_with_a_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    write(
        folder.path(),
        "a.wgsl",
        "fn nothing(x: f32) { _ = x; }\n\
         fn meets(x: f32) -> f32 { return subgroupAdd(x); }\n",
    );
    let errors = ["nothing", "meets"].map(|name| error_in(&folder, &format!("a::{name}")));
    insta::assert_snapshot!(errors.join("\n\n"));
}

#[test]
fn one_file_is_a_package_and_both_extensions_are_read() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "one.wgsl", "fn f() -> f32 { return 1.0; }");
    write(folder.path(), "deep/two.wesl", "fn g() -> f32 { return 2.0; }");
    let file = Package::open(folder.path().join("one.wgsl")).expect("a file");
    assert!(Probed::new(&file, "f").is_ok());
    let package = Package::open(folder.path()).expect("a folder");
    assert!(Probed::new(&package, "deep::two::g").is_ok());
    assert_eq!(package.modules().expect("readable"), ["deep::two", "one"]);
}

#[test]
fn errors_carry_their_place_as_data() {
    let package = Package::from_source("s", "fn f() -> f32 {\n  return 1u;\n}");
    let Err(ProbeError::Reflect(karat::unstable::reflect::ReflectError::Invalid(diagnostic))) =
        Probed::new(&package, "f")
    else {
        panic!("a type error is found by naga");
    };
    assert_eq!(diagnostic.location().map(ToString::to_string).as_deref(), Some("<s>:2:10"));
}

/// An unsaved text replaces its file, also in packages that depend on its package. The unsaved text changes neither the
/// file on disk nor the package with the saved text.
#[test]
fn texts_that_are_not_saved_stand_in_for_their_files() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "a/user.wgsl", "import b::math::f;\nfn g() -> f32 { return f(); }\n");
    write(folder.path(), "b/math.wgsl", "fn f() -> f32 { return 1.0; }\n");
    let file = folder.path().join("b/math.wgsl");
    let math = Package::open(folder.path().join("b")).expect("a package");
    let saved = Package::open(folder.path().join("a")).expect("a package").depends_on("b", &math);
    // The path contains `.`, as another program may write it.
    let edited =
        saved.unsaved(&folder.path().join("b/./math.wgsl"), "\nfn f() -> f32 { return y; }\n");
    let invalid = edited.try_is_valid().expect_err("there is no y").to_string();
    assert!(invalid.contains("math.wgsl:2:24"), "{invalid}");
    assert!(saved.try_is_valid().is_ok());
    let again = edited.unsaved(&file, "fn h() {}\n\nfn f() -> f32 { return 2.0; }\n");
    assert!(again.try_is_valid().is_ok());
    let line = |package: &Package| {
        let functions = package.functions_in("math").expect("it can be read");
        functions.last().expect("a function").span.to_string().rsplit(':').nth(1).map(str::to_owned)
    };
    assert_eq!(line(&math).as_deref(), Some("1"));
    assert_eq!(
        line(&math.unsaved(&file, "\n\nfn f() -> f32 { return 2.0; }\n")).as_deref(),
        Some("3")
    );
    // A text for a file outside the package changes nothing.
    assert!(saved.unsaved(Path::new("nowhere.wgsl"), "no WGSL").try_is_valid().is_ok());
}

/// A folder without Rust lists its dependencies in `karat.toml`.
#[test]
fn a_folder_declares_its_dependencies() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, text: &str| {
        let file = folder.path().join(name);
        std::fs::create_dir_all(file.parent().expect("a folder")).expect("made");
        std::fs::write(file, text).expect("written");
    };
    write(
        "shaders/a.wgsl",
        "import noise::value::hash;\nfn f(x: f32) -> f32 { return hash(x); }\n",
    );
    write(
        "noise/value.wgsl",
        "import own::gain::GAIN;\nfn hash(x: f32) -> f32 { return GAIN * x; }\n",
    );
    // Two packages may depend on each other.
    write(
        "noise/karat.toml",
        "[dependencies]\nown = { path = \"../own\" }\nback = { path = \"../shaders\" }\n",
    );
    write("own/gain.wgsl", "const GAIN = 0.5;\n");
    let declared = |text: &str| write("shaders/karat.toml", text);
    let package = Package::open(folder.path().join("shaders")).expect("a folder");
    let ran = || {
        package
            .function("a::f")
            .over(0.0..=1.0)
            .cases(16)
            .unrecorded()
            .try_agrees_with(|x: f64| 0.5 * x, Ulp(1.0))
    };
    let told = |part: &str| {
        let error = ran().expect_err(part).to_string();
        assert!(error.contains(part), "no `{part}`: {error}");
    };
    told("`[dependencies]` in the package's `karat.toml`");
    declared("[dependencies]\nnoise = { path = \"../noise\" }\n");
    ran().expect("0.5 x");
    package.function("noise::value::hash").over(0.0..=1.0).agrees_with(|x: f64| 0.5 * x, Ulp(1.0));
    // After an edit in a dependency, the program is linked again.
    write("own/gain.wgsl", "const GAIN = 0.25;\n");
    assert!(ran().is_err());
    for (text, part) in [
        ("noise = { path = \"../nose\" }", "nose` (dependency `noise`)"),
        ("noise = { path = \"../noise\", crate = \"noise\" }", "or { crate = \"name@version\" }"),
        ("noise = {}", "the dependency `noise` must be { path = \"..\" }"),
        ("karat = { path = \"../noise\" }", "a dependency can't have the name `karat`"),
        ("noise = { pat = \"../noise\" }", "unknown field `pat`"),
    ] {
        declared(&format!("[dependencies]\n{text}\n"));
        told(part);
    }
}

/// A folder may contain only tests. The tests can call functions of the folder's dependencies.
// Lesson 190
#[test]
fn a_package_of_tests_alone_is_valid() {
    let half = Package::from_source("half", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    let text = "import half::half;\nimport karat::expect_near;\n\
                @test fn halves() { expect_near(half(3.0), 1.5, 0.0); }\n";
    let tests = Package::from_source("tests", text).depends_on("half", &half);
    let valid = tests.try_is_valid().expect("it is valid");
    assert_eq!((valid.functions, valid.tests), (0, 1));
    assert_eq!(valid.to_string(), "1 module, 0 functions, 0 entry points, 1 test");
    let nothing = Package::from_source("m", "const A = 1;").try_is_valid();
    assert!(nothing.expect_err("nothing").to_string().contains("no entry point and no test"));
}

/// The path of a module's file gives the module's name. A symbolic link to a folder of the same package doesn't
/// give the folder's modules a second name.
// Lesson 188
#[cfg(unix)]
#[test]
fn links_lead_to_each_folder_once() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path();
    std::fs::create_dir_all(path.join("z/inner")).expect("a folder");
    let outer = tempfile::tempdir().expect("a temporary folder");
    for file in [path.join("z/m.wgsl"), path.join("z/inner/n.wgsl"), outer.path().join("o.wgsl")] {
        std::fs::write(file, "fn f() {}").expect("written");
    }
    std::fs::write(path.join("z/rows.csv"), "x").expect("written");
    let link = |to: &Path, name: &str| {
        std::os::unix::fs::symlink(to, path.join(name)).expect("a link");
    };
    link(path, "again");
    link(&path.join("z"), "a");
    link(&path.join("z"), "z/inner/up");
    link(outer.path(), "other");
    let package = Package::open(path).expect("a package");
    assert_eq!(package.modules().expect("modules"), ["other::o", "z::inner::n", "z::m"]);
    assert_eq!(package.files_beside().expect("files"), [path.join("z/rows.csv")]);
}
