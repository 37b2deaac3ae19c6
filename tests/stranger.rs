//! Tests Karat as a user has it: in a project with its own workspace, outside of this repository.

use std::io::{BufRead, BufReader};
use std::path::{Path as FilePath, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;

use tempfile::TempDir;

const MATH: &str = "const PI: f32 = 3.14159265;\n\n\
    fn pow5(x: f32) -> f32 {\n    let x2 = x * x;\n    return x2 * x2 * x;\n}\n";

const BRDF: &str = "import package::math::{PI, pow5};\n\n\
    fn schlick(f0: vec3f, cosine: f32) -> vec3f {\n    \
        return f0 + (1.0 - f0) * pow5(1.0 - cosine);\n}\n\n\
    fn lambert(albedo: f32, n_dot_l: f32) -> f32 {\n    return albedo / PI * n_dot_l;\n}\n";

/// The planted fault, as the original and the changed text. The fault multiplies by pi instead of dividing by pi.
const FAULT: (&str, &str) = ("albedo / PI", "albedo * PI");

const TESTS: &str = r#"
use glam::DVec3;
use karat::prelude::*;

static SHADERS: Package = karat::package!("shaders");

#[test]
fn schlick() {
    SHADERS.function("brdf::schlick").over((UnitRgb, 0.0..=1.0)).agrees_with(
        |f0: DVec3, cosine: f64| f0 + (1.0 - f0) * (1.0 - cosine).powi(5),
        Ulp(11.0),
    );
}

#[test]
fn lambert() {
    SHADERS.function("brdf::lambert").over((0.0..=1.0, 0.0..=1.0)).agrees_with(
        |albedo: f64, n_dot_l: f64| albedo / std::f64::consts::PI * n_dot_l,
        Ulp(8.0), // a pi, a division (2.5) and a product
    );
}
"#;

/// Rust tests that don't compile, because each has a mistake. Each of rustc's errors must say how to write the test
/// correctly.
const MISFITS: &str = r#"
use karat::prelude::*;

static SHADERS: Package = karat::package!("shaders");

#[test]
fn a_reference_in_f32() {
    SHADERS.function("math::pow5").over(0.0..=1.0).agrees_with(|x: f32| x.powi(5), Ulp(4.0));
}

#[test]
fn a_reference_of_other_arguments() {
    SHADERS
        .function("brdf::lambert")
        .over((0.0..=1.0, 0.0..=1.0))
        .agrees_with(|albedo: f64| albedo, Ulp(4.0));
}

#[test]
fn a_half_open_range() {
    SHADERS.function("math::pow5").over(0.0..1.0).agrees_with(|x: f64| x.powi(5), Ulp(4.0));
}

#[test]
fn a_result_of_f32() {
    SHADERS.function("math::pow5").over(0.0..=1.0).agrees_with(|x: f64| x as f32, Ulp(4.0));
}

#[test]
fn arguments_of_f64() {
    SHADERS.function("math::pow5").over(Just(1.0_f64)).agrees_with(|x: f64| x.powi(5), Ulp(4.0));
}
"#;

/// Dependencies of the test project, with the same features as in this workspace. With these features Cargo reuses the
/// libraries that it compiled for this workspace. Without them Cargo compiles most libraries again. `cargo tree -f "{p}
/// [{f}]"` in both workspaces shows the differences. The project in the tests of `karat render` has the same features,
/// so Cargo compiles Karat once for both projects.
const SHARED: &str = "\
    clap = { version = \"4\", features = [\"derive\", \"env\", \"wrap_help\"] }\n\
    indexmap = \"2\"\n\
    libc = { version = \"0.2\", features = [\"extra_traits\"] }\n\
    memchr = \"2\"\n\
    naga = { version = \"30\", features = [\"msl-out\", \"spv-in\", \"wgsl-out\"] }\n\
    num-traits = \"0.2\"\n\
    rustix = { version = \"1\", features = [\"event\", \"fs\", \"process\", \"stdio\", \"termios\"] }\n\
    serde_core = \"1\"\n\
    serde_json = { version = \"1\", features = [\"unbounded_depth\"] }\n\n\
    [build-dependencies]\n\
    syn = { version = \"2\", features = [\"extra-traits\"] }\n\
    syn-3 = { package = \"syn\", version = \"3\", features = [\"extra-traits\"] }\n";

fn repository() -> &'static FilePath {
    FilePath::new(env!("CARGO_MANIFEST_DIR")).parent().expect("this package is in the workspace")
}

fn read(path: &FilePath) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

struct Project {
    folder: TempDir,
}

impl Project {
    fn new(name: &str, tests: &str) -> Self {
        let root = read(&repository().join("Cargo.toml"));
        // The project has this repository's profiles, lock file and features, so Cargo compiles only Karat again.
        // Without optimisation, this takes 10 s instead of 40 s.
        let profiles = root.find("[profile.dev]").map(|at| &root[at..]).expect("it has profiles");
        // The test doesn't use the engine. Compiling it with optimisation would take longer than all other steps.
        let engine = "[profile.dev.package.karat-engine]\nopt-level = 3\ncodegen-units = 1\n";
        assert!(profiles.contains(engine), "the profile of the engine has changed");
        let quick = "[profile.dev.package.karat-engine]\nopt-level = 1\n";
        let library = "[profile.dev.package.karat]\nopt-level = 2\n\
                       [profile.dev.package.karat-core]\nopt-level = 2\n";
        assert!(profiles.contains(library), "the profile of the library has changed");
        let unoptimised = "[profile.dev.package.karat]\nopt-level = 0\n\
                           [profile.dev.package.karat-core]\nopt-level = 0\n";
        let profiles = profiles.replace(engine, quick).replace(library, unoptimised);
        let karat = repository().join("harness");
        let manifest = format!(
            "[package]\nname = \"{name}\"\nedition = \"2024\"\n\n[workspace]\n\n\
             [dev-dependencies]\nkarat = {{ path = {karat:?} }}\nglam = \"0.34\"\n{SHARED}\n\
             {profiles}\n"
        );
        let project = Self { folder: tempfile::tempdir().expect("a temporary folder") };
        project.write("Cargo.toml", &manifest);
        project.write("Cargo.lock", &read(&repository().join("Cargo.lock")));
        project.write("src/lib.rs", "//! An application.\n");
        project.write("tests/brdf.rs", tests);
        project.write("shaders/math.wgsl", MATH);
        project.write("shaders/brdf.wgsl", BRDF);
        project
    }

    fn write(&self, file: &str, text: &str) {
        let path = self.folder.path().join(file);
        std::fs::create_dir_all(path.parent().expect("in the folder")).expect("a folder");
        std::fs::write(path, text).expect("written");
    }

    /// Runs a program in the project, as a user of the project would, without the environment variables of this test
    /// run.
    fn run(&self, program: &FilePath, arguments: &[&str]) -> Ran {
        let ran = self.command(program, arguments).output();
        Ran::of(ran.unwrap_or_else(|error| panic!("{}: {error}", program.display())))
    }

    fn command(&self, program: &FilePath, arguments: &[&str]) -> Command {
        let mut command = Command::new(program);
        let own = ["CI", "CARGO_TARGET_DIR", "CARGO_CRATE_NAME", "CARGO_PRIMARY_PACKAGE"];
        let prefixes = ["KARAT_", "CARGO_PKG_", "CARGO_MANIFEST_", "CARGO_BIN_"];
        for (name, _) in std::env::vars_os() {
            let text = name.to_string_lossy();
            if own.contains(&&*text) || prefixes.iter().any(|prefix| text.starts_with(prefix)) {
                command.env_remove(name);
            }
        }
        // The project uses this repository's folder of intermediate output, which has the compiled libraries. The
        // project writes records to its own `target`, separate from the records of this run. Cargo has released its
        // lock before it runs a test.
        let built = FilePath::new(env!("CARGO_TARGET_TMPDIR")).parent().expect("in the output");
        command.env("CARGO_BUILD_BUILD_DIR", built).env("CARGO_NET_OFFLINE", "true");
        command.env("CARGO_TERM_COLOR", "never").env("NO_COLOR", "1");
        command.env("RUST_BACKTRACE", "0");
        command.current_dir(self.folder.path()).args(arguments);
        command
    }

    fn cargo(&self, arguments: &[&str]) -> Ran {
        self.run(&cargo(), arguments)
    }
}

#[derive(Debug)]
struct Ran {
    code: Option<i32>,
    out: String,
    err: String,
}

impl Ran {
    fn of(output: Output) -> Self {
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Self { code: output.status.code(), out: text(&output.stdout), err: text(&output.stderr) }
    }

    #[track_caller]
    fn says(&self, code: i32, parts: &[&str]) {
        let Self { out, err, .. } = self;
        assert_eq!(self.code, Some(code), "\n{err}\n{out}");
        for part in parts {
            assert!(out.contains(part) || err.contains(part), "no `{part}` in:\n{err}\n{out}");
        }
    }
}

fn cargo() -> PathBuf {
    std::env::var_os("CARGO").map_or_else(|| PathBuf::from("cargo"), PathBuf::from)
}

/// Builds the program `karat` from the current sources, because `cargo test` of this package builds only Karat's
/// library.
fn karat() -> PathBuf {
    let folder = FilePath::new(env!("CARGO_BIN_EXE_planted")).parent().expect("in a folder");
    let profile = match folder.file_name().and_then(|name| name.to_str()) {
        Some("debug") | None => "dev",
        Some(name) => name,
    };
    let status = Command::new(cargo())
        .args([
            "build",
            "--offline",
            "--quiet",
            "--workspace", // also compile the tests, so that all dependencies have the same features
            "--bin",
            "karat",
            "--test",
            "stranger",
            "--profile",
            profile,
        ])
        .arg("--target-dir")
        .arg(folder.parent().expect("in the folder of output"))
        .current_dir(repository())
        .status();
    assert!(status.is_ok_and(|status| status.success()), "the command line doesn't compile");
    folder.join("karat").with_extension(std::env::consts::EXE_EXTENSION)
}

/// The words in the table's row for `function`.
fn row<'a>(table: &'a str, function: &str) -> Vec<&'a str> {
    let line = table.lines().find(|line| line.starts_with(function));
    line.unwrap_or_else(|| panic!("no row of {function} in:\n{table}")).split_whitespace().collect()
}

// Lesson 24
// Lesson 107
#[test]
fn a_project_of_its_own() {
    let karat = karat();
    let project = Project::new("stranger", TESTS);
    assert!(BRDF.contains(FAULT.0));
    project.write("shaders/brdf.wgsl", &BRDF.replace(FAULT.0, FAULT.1));

    let failing = project.cargo(&["test", "--offline"]);
    let parts = [
        "test schlick ... ok",
        "test lambert ... FAILED",
        "error: `brdf::lambert` fails agrees_with: 8 ulp",
        "shaders/brdf.wgsl:7:1",
        "fn lambert(albedo: f32, n_dot_l: f32) -> f32 {",
        " cases fail (",
        "too high",
        "  replay: KARAT_PATHS=",
        "cargo test -p stranger --test brdf -- --exact lambert",
    ];
    failing.says(101, &parts);

    // Runs the command from the message, unchanged.
    if cfg!(unix) {
        let replay = failing.out.lines().find_map(|line| line.trim().strip_prefix("replay: "));
        let replay = replay.expect("it was found above");
        let again = project.run(FilePath::new("sh"), &["-c", replay]);
        again.says(101, &["test lambert ... FAILED", "  1 of 1 case fails (100.000%)"]);
        assert!(!again.out.contains("schlick") && !again.err.contains("Compiling"), "{again:?}");
    }

    let none = project.run(&karat, &["test", "nosuchtest"]);
    none.says(2, &["error: no check ran: `nosuchtest` isn't part of the name of a test"]);
    let listed = project.run(&karat, &["list"]);
    assert!(!listed.out.contains(" yes "), "nothing ran: {}", listed.out);

    let table = project.run(&karat, &["test"]);
    table.says(
        1,
        &["2 checks, 1 failed", "functions without a test: math::pow5 (`karat list` lists all)"],
    );
    assert!(row(&table.out, "brdf::lambert ").contains(&"FAIL"), "{}", table.out);
    let schlick = row(&table.out, "brdf::schlick ");
    assert_eq!((schlick[1], schlick[3]), ("agrees_with", "65536"), "{}", table.out);

    let listed = project.run(&karat, &["list"]);
    listed.says(0, &[]);
    for (function, tested) in [("brdf::lambert", "yes"), ("brdf::schlick", "yes"), ("math::", "no")]
    {
        assert!(row(&listed.out, function).contains(&tested), "{}", listed.out);
    }

    // A test reads shaders when it runs, so an edit of a shader compiles no Rust.
    project.write("shaders/brdf.wgsl", BRDF);
    let mended = project.cargo(&["test", "--offline"]);
    mended.says(0, &["test schlick ... ok", "test lambert ... ok", "Finished"]);
    assert!(!mended.err.contains("Compiling"), "{}", mended.err);
    let table = project.run(&karat, &["test"]);
    table.says(0, &["2 checks, 0 failed, 131072 cases compared"]);
    assert!(!table.out.contains("FAIL") && !table.err.contains("Compiling"), "{table:?}");
    project.run(&karat, &["test", "lambert"]).says(0, &["1 check, 0 failed"]);
    mutants_are_tried(&karat, &project);
    edits_are_followed(&karat, &project);
}

/// `karat mutate` runs the compiled Rust tests for each mutant, and compiles nothing for a mutant.
fn mutants_are_tried(karat: &FilePath, project: &Project) {
    let before = remembered(project);
    let lambert = project.run(karat, &["mutate", "--only", "lambert", "--all"]);
    lambert.says(0, &["killed shaders/brdf.wgsl:8:", "by `brdf::lambert`", "score 100%"]);
    assert!(lambert.out.contains("killed by 2 tests on cpu"), "{}", lambert.out);
    assert!(!lambert.err.contains("Compiling"), "{}", lambert.err);
    // One function is used by both tests, another by no test.
    let all = project.run(karat, &["mutate", "--fail-under", "0", "--all"]);
    all.says(0, &["by `brdf::schlick`", "by `brdf::lambert`", "in `math::pow5`"]);
    // Tests that fail for a mutant add nothing to the remembered inputs.
    assert_eq!(remembered(project), before);
    // Without a mutant to try, `karat mutate` builds nothing.
    let none = project.run(karat, &["mutate", "--only", "nosuch"]);
    none.says(2, &["the package has no mutant of `nosuch`"]);
    assert!(!none.err.contains("builds the tests"), "{}", none.err);
    // If a test already fails without a mutant, mutants have no verdict.
    project.write("shaders/brdf.wgsl", &BRDF.replace(FAULT.0, FAULT.1));
    let red = project.run(karat, &["mutate", "--only", "lambert"]);
    red.says(2, &["correct this test first: `brdf::lambert`"]);
    project.write("shaders/brdf.wgsl", BRDF);
}

/// The files in which Karat keeps the project's failing inputs, and the text of each file.
fn remembered(project: &Project) -> Vec<(PathBuf, String)> {
    let (mut folders, mut all) = (vec![project.folder.path().join(".karat")], Vec::new());
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            match entry.path() {
                path if path.is_dir() => folders.push(path),
                path => all.push((path.clone(), read(&path))),
            }
        }
    }
    all.sort();
    all
}

/// A running `karat watch` on the path `cpu`, and the lines that it prints.
struct Watching {
    child: Child,
    lines: Receiver<String>,
}

impl Watching {
    fn start(karat: &FilePath, project: &Project) -> Self {
        let mut command = project.command(karat, &["watch", "--paths", "cpu", "--lines"]);
        let piped = command.stdin(Stdio::null()).stdout(Stdio::piped());
        let mut child = piped.spawn().expect("it starts");
        let out = child.stdout.take().expect("it is piped");
        let (sender, lines) = channel();
        std::thread::spawn(move || {
            for line in BufReader::new(out).lines().map_while(Result::ok) {
                if sender.send(line).is_err() {
                    return;
                }
            }
        });
        Self { child, lines }
    }

    /// Waits for a line that contains `part`, and returns all lines up to it.
    #[track_caller]
    fn until(&self, part: &str) -> String {
        let mut all = String::new();
        while let Ok(line) = self.lines.recv_timeout(Duration::from_secs(120)) {
            all += &line;
            all.push('\n');
            if line.contains(part) {
                return all;
            }
        }
        panic!("no `{part}` in:\n{all}");
    }
}

impl Drop for Watching {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// After an edit of a shader, `karat watch` runs the Rust tests that depend on the shader, and compiles nothing.
#[track_caller]
fn edits_are_followed(karat: &FilePath, project: &Project) {
    let watching = Watching::start(karat, project);
    watching.until("cpu (Rust): 2 tests pass; 2 ran");
    project.write("shaders/brdf.wgsl", &BRDF.replace(FAULT.0, FAULT.1));
    let red = watching.until("cpu (Rust): 1 of 2 tests fail; 1 ran");
    for part in [
        "changed: shaders/brdf.wgsl",
        "FAILED brdf::lambert",
        "brdf.wgsl:7:1",
        "  in tests/brdf.rs:",
    ] {
        assert!(red.contains(part), "no `{part}` in {red}");
    }
    project.write("shaders/brdf.wgsl", BRDF);
    watching.until("cpu (Rust): 2 tests pass; 1 ran");
    project.write("shaders/brdf.wgsl", &format!("// a comment\n{BRDF}"));
    watching.until("cpu (Rust): 2 tests pass; no code changed");
    // A function depends on the functions that it calls. Of the two tested functions, one calls `pow5`.
    project.write("shaders/math.wgsl", &MATH.replace("x2 * x2 * x", "x2 * x * x2"));
    watching.until("cpu (Rust): 2 tests pass; 1 ran");
    project.write("tests/brdf.rs", &TESTS.replace("fn lambert()", "fn lambert() -> "));
    let broken = watching.until("cpu (Rust): no verdict");
    assert!(watching.until("--> tests/brdf.rs:").contains("error: "), "{broken}");
    project.write("tests/brdf.rs", &TESTS.replace("fn lambert()", "fn diffuse()"));
    watching.until("cpu (Rust): 2 tests pass; 2 ran");
    // This path doesn't judge frames. A test that fails outside of a check also fails here.
    let more = "#[test]\nfn drawn() {\n    let goldens = karat::goldens!(\"golden\");\n    \
                SHADERS.frame(\"brdf\", 8, 8).fragment(\"fs\").matches(&goldens, \"drawn\");\n}\n\
                #[test]\nfn panics() {\n    panic!(\"before its check\");\n}\n\
                #[test]\nfn silent() {}\n";
    project.write("tests/brdf.rs", &format!("{TESTS}{more}"));
    let red = watching.until("cpu (Rust): 1 of 4 tests fail; 5 ran");
    assert!(red.contains("1 frame isn't judged: frames need a driver"), "{red}");
}

#[test]
fn what_does_not_fit_is_explained_by_the_compiler() {
    let project = Project::new("misfit", MISFITS);
    let refused = project.cargo(&["test", "--offline", "--no-run", "--test", "brdf"]);
    refused.says(
        101,
        &[
            "--> tests/brdf.rs:",
            "expected closure signature `fn(f64) -> _`",
            "the parameters of this reference don't match the domain's values",
            "expected a function whose parameters are the `f64` types for `(f32, f32)`",
            "`std::ops::Range<{float}>` is not a domain",
            "use a closed range such as `0.0..=1.0` (not `0.0..1.0`)",
            "`f32` can't be the result of a reference",
            "`f64` can't be the arguments of a WGSL function",
        ],
    );
}
