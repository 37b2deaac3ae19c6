//! `cargo ci test`: runs all of CI.

use std::path::PathBuf;
use std::process::{Command, ExitCode};

use anyhow::{Context, Result, ensure};

use crate::full::Sum;
use crate::record::Running;
use crate::setup::{self, PATHS};
use crate::step::Steps;
use crate::{command, lint, once, swiftshader};

/// Runs every step, even after failures. The steps after the tests print to stderr, so that stdout ends with the test
/// runner's lines. Only GitHub's annotations go to stdout after the tests, because GitHub reads them there.
pub(crate) fn run() -> ExitCode {
    let mut steps = Steps::new("cargo ci test");
    // Installing packages waits for the network. The lints need no packages, so they run at the same time.
    let packages = |steps: &mut Steps| {
        steps.run("setup", setup::install_missing);
        steps.run("browser", setup::install_browser);
        steps.run("validators", setup::install_validators);
        steps.run("tint", setup::install_tint);
        steps.run("web", setup::install_web);
    };
    steps.beside(packages, lint::steps);
    steps.run("build", build);
    steps.run("compiled once", once::check);
    steps.run("paths", open_paths);
    steps.run("both compilers", both_compilers);
    // This step runs before the tests, because readers of a log look for the tests' last lines on stdout.
    if swiftshader::manifest().is_some() {
        steps.run("swiftshader", second_driver);
        steps.run("dawn and chromium", web);
    }
    steps.run("npm packages", || npm_packages(false));
    steps.run("examples", examples);
    steps.run("behind a pipe", behind_a_pipe);
    steps.run("mutants", mutants);
    let passed = steps.run("tests", test);
    steps.run("report", || report(passed));
    steps.run("goldens", unreferenced);
    steps.finish()
}

/// The arguments of a build whose output `cargo test` can reuse. With `--package karat` instead of `--workspace`, Cargo
/// would turn on fewer features of some dependencies, and later compile these dependencies again. The arguments name
/// the programs, because `--bins` would also build this program, which Windows can't replace while it runs.
pub(crate) const BUILD: &[&str] =
    &["build", "--workspace", "--locked", "--bin", "karat", "--bin", "planted", "--tests"];

pub(crate) fn build() -> Result<()> {
    command::run(&mut command::cargo(BUILD))
}

/// Runs the tests of `harness/examples/folder`, an example project without Rust code. Other steps run the examples for
/// wgpu and npm, and `cargo ci full` runs the example for Bevy.
fn examples() -> Result<()> {
    command::run_aside(&mut command::karat(&["test", "harness/examples/folder/shaders"])?)
}

/// Runs the example for Bevy, whose test fetches Bevy's shaders.
pub(crate) fn bevy_example() -> Result<()> {
    let mut test = command::cargo(&["test", "--workspace", "--locked", "--test", "toon"]);
    command::run(test.args(["--features", "example-bevy/fetch"]))
}

/// Opens each required path with `karat doctor`. The step `setup` only checks that the drivers' libraries exist.
pub(crate) fn open_paths() -> Result<()> {
    command::run(&mut command::karat(&["doctor", "--require", PATHS])?)
}

/// Checks that naga and Tint accept the whole shader library. The tests use Tint only if Tint is installed, but this
/// step fails without Tint.
fn both_compilers() -> Result<()> {
    let mut check = command::karat(&["check", "--shaders", "shaders", "--require", "tint"])?;
    command::run_aside(&mut check)
}

/// Runs every test, and records the verdicts, which later steps read.
fn test() -> Result<()> {
    let records = output().join("record");
    let running = Running::begin(&records)
        .with_context(|| format!("can't keep a record in `{}`", records.display()))?;
    let record = running.folder();
    let mut test = command::cargo(&["test", "--workspace", "--locked", "--no-fail-fast"]);
    // If a path doesn't open, the run must fail, because skipped tests would prove nothing.
    test.env("KARAT_PATHS", "all").env("KARAT_REQUIRE", PATHS).env("KARAT_RECORD", record);
    // Tests that start programs mostly wait for them, so another test can use the processor core.
    if std::env::var_os("RUST_TEST_THREADS").is_none() {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        test.env("RUST_TEST_THREADS", (cores + 1).to_string());
    }
    let outcome = command::run(&mut test);
    std::fs::write(record.join("run.json"), ending(outcome.is_ok()))
        .and_then(|()| running.end())
        .with_context(|| format!("can't keep the record in `{}`", records.display()))
        .and(outcome)
}

/// Runs a sample of `cargo ci full`: the functions of five modules of the shader library on SwiftShader, another Vulkan
/// driver. SwiftShader is a part of the browser that setup installs for the tests of the review page.
fn second_driver() -> Result<()> {
    let manifest = swiftshader::manifest().context("SwiftShader is gone")?;
    let mut test = command::cargo(&["test", "--workspace", "--locked", "--no-fail-fast"]);
    test.args(["--test", "library", "--"]);
    test.args(["brdf::", "fresnel::", "geometry::", "layering::", "sampling::"]);
    const PATH: &str = "vulkan@swiftshader";
    test.env(swiftshader::ADD, manifest).env("KARAT_PATHS", PATH).env("KARAT_REQUIRE", PATH);
    command::run_aside(&mut test)
}

/// Runs jobs with known results, and some tests, on the web's paths `dawn` and `chromium`.
fn web() -> Result<()> {
    for path in ["dawn", "chromium"] {
        command::run_aside(&mut command::karat(&["doctor", "--executor", path])?)?;
        let mut test = command::cargo(&["test", "--workspace", "--locked", "--no-fail-fast"]);
        test.args(["--test", "library", "--", "fresnel::"]);
        test.env("KARAT_PATHS", path).env("KARAT_REQUIRE", path);
        command::run_aside(&mut test)?;
        // The tests use textures and buffers of each kind. WebGPU has no immediates yet.
        let mut test = command::cargo(&["test", "--workspace", "--locked", "--no-fail-fast"]);
        test.args(["--test", "strangers", "--", "resources::", "--skip", "immediates_are_set"]);
        test.env("KARAT_PATHS", path).env("KARAT_REQUIRE", path);
        command::run_aside(&mut test)?;
    }
    Ok(())
}

pub(crate) fn npm() -> ExitCode {
    let mut steps = Steps::new("cargo ci npm");
    let _ = steps.run("browser", setup::install_browser)
        && steps.run("tint", setup::install_tint)
        && steps.run("web", setup::install_web)
        && steps.run("build", build)
        && steps.run("npm packages", || npm_packages(true));
    steps.finish()
}

/// The oldest version of Node that can run the current vitest.
pub(crate) const VITEST_NODE: (u32, u32) = (22, 12);

/// Tests Karat's own npm packages, with the newest vitest that this machine's Node can run. If `all` is `true`, tests
/// them with each vitest that this Node can run.
pub(crate) fn npm_packages(all: bool) -> Result<()> {
    let root = command::root();
    let folder = root.join("harness/npm/tests");
    let mut tests = Vec::new();
    for entry in std::fs::read_dir(&folder)? {
        let file = entry?.path();
        tests.extend(file.to_string_lossy().ends_with(".test.js").then_some(file));
    }
    tests.sort();
    ensure!(!tests.is_empty(), "no test is in `{}`", folder.display());
    let browser = setup::browser().context("no browser is here")?;
    let mut ran = 0;
    for name in ["web", "web-before"] {
        let (node, modules) =
            setup::node_and_modules(name).context("npm's packages aren't here")?;
        let is_new = setup::node_version(&node).is_some_and(|version| version >= VITEST_NODE);
        if (name == "web" && !is_new) || (ran > 0 && !all) {
            continue;
        }
        let mut test = Command::new(&node);
        test.args(["--test", "--test-reporter=spec"]).args(&tests).current_dir(&root);
        test.env("TESTED_KARAT", command::karat(&[])?.get_program()).env("TESTED_MODULES", modules);
        command::run_aside(test.env("TESTED_CHROMIUM", &browser))?;
        ran += 1;
    }
    ensure!(ran > 0, "no vitest runs in this machine's Node");
    Ok(())
}

/// Tries 40 mutants of the shader library's module `sensor`. The tests of this module kill 97 of 100 mutants, and this
/// step requires 90 %.
fn mutants() -> Result<()> {
    let sample = [
        "--tests",
        "library::sensor",
        "--only",
        "sensor::",
        "--sample",
        "40",
        "--fail-under",
        "90",
    ];
    command::run_aside(command::karat(&["mutate"])?.args(sample))
}

/// Runs tests whose jobs run in another process: functions of the shader library on the engine, and resources, passes
/// and frames of every kind on a driver. `cargo ci full` runs more functions in this way.
fn behind_a_pipe() -> Result<()> {
    for (mut test, least) in [(piped(&["fresnel::", "geometry::"]), 10), (strangers(), 50)] {
        let output = test.output().context("can't run `cargo`")?;
        let said = String::from_utf8_lossy(&output.stdout);
        let mut sum = Sum::default();
        said.lines().for_each(|line| sum.read(line));
        let told = || format!("{said}{}", String::from_utf8_lossy(&output.stderr));
        ensure!(output.status.success(), "tests fail in another process:\n{}", told());
        // A filter that matches no test would pass.
        ensure!(sum.passed >= least, "only {} tests ran:\n{}", sum.passed, told());
    }
    Ok(())
}

/// Returns the command that tests modules of the shader library on Karat's engine in another process. Without modules,
/// the command tests the whole library.
pub(crate) fn piped(modules: &[&str]) -> Command {
    let mut test = in_another_process("library", "cpu");
    // Frames need a driver, and so does the test of a fault in a driver's `pow`.
    test.args(modules);
    test.args(["--skip", "overdraw::", "--skip", "split_sum_fragment", "--skip", "pow_is_less"]);
    test
}

/// Returns the command that tests resources, passes and frames on Vulkan in another process.
fn strangers() -> Command {
    let mut test = in_another_process("strangers", "vulkan");
    // Derivatives need a quad that a driver draws.
    for quads in [
        "derivatives_over_quads",
        "implicit_levels_of_detail",
        "loops_of_functions_that_drivers_cut_short",
        "structures_vary_over_quads",
        "textures_are_parameters",
    ] {
        test.args(["--skip", quads]);
    }
    test
}

/// Returns the command that runs the complete suites, of which `cargo ci test` runs a sample.
pub(crate) fn long() -> Command {
    let mut test = command::cargo(&["test", "--workspace", "--locked", "--no-fail-fast"]);
    test.args(["--test", "mutants", "--test", "second_opinion", "--test", "translations"]);
    test.args(["--test", "spec", "--test", "published"]);
    test.args(["--test", "review"]);
    // `--include-ignored` also runs the long tests of the review.
    test.args(["--", "--include-ignored"]);
    test.env("SUITES", "whole").env("KARAT_PATHS", "all").env("KARAT_REQUIRE", PATHS);
    test
}

/// Returns the command that runs the test program `program`. Another process runs the jobs of its tests, on the path
/// `path`.
fn in_another_process(program: &str, path: &str) -> Command {
    let mut test = command::cargo(&["test", "--workspace", "--locked", "--no-fail-fast"]);
    test.args(["--test", program, "--"]);
    let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
    let planted = command::root().join(target).join("debug").join("planted");
    let executor = format!("other={} executor {path}", planted.display());
    const PATH: &str = "process@other";
    test.env("KARAT_EXECUTORS", executor).env("KARAT_PATHS", PATH).env("KARAT_REQUIRE", PATH);
    test
}

/// Writes JUnit and, on GitHub, annotations and the job's summary. Failed checks don't make this step fail, because the
/// tests with these checks have already failed, or expect the failure.
fn report(passed: bool) -> Result<()> {
    let junit = output().join("junit.xml");
    let mut report = command::karat(&["report", "--junit"])?;
    let on_github = std::env::var_os("GITHUB_ACTIONS").is_some_and(|value| value == "true");
    let run = if on_github { command::run } else { command::run_aside };
    match run(report.arg(&junit)) {
        Err(error) if !passed && command::exit_code(&error) == 1 => Ok(()),
        outcome => outcome,
    }
}

/// Checks that each golden was compared by a test. If a golden wasn't compared, the golden is useless, or its test is
/// missing.
fn unreferenced() -> Result<()> {
    command::run_aside(&mut command::karat(&["unreferenced"])?)
}

/// Returns the folder into which `karat` writes the output of runs.
fn output() -> PathBuf {
    let target = std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into());
    command::root().join(target).join("karat")
}

/// Returns the content of `run.json`, which `karat` reads as a `karat::unstable::record::Run`. The empty list
/// `selected` means that the run included all tests.
fn ending(passed: bool) -> String {
    serde_json::json!({ "schema": 5, "selected": [], "passed": passed }).to_string()
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_ending_of_a_run_has_the_schema_of_the_records() {
        let expected = r#"{"passed":true,"schema":5,"selected":[]}"#;
        let source = crate::command::root().join("harness/src/record.rs");
        let source = std::fs::read_to_string(source).expect("the library has records");
        assert!(source.contains("pub const SCHEMA: u32 = 5;"), "records have another schema");
        assert_eq!(super::ending(true), expected); // harness/cli/tests/cli/unreferenced.rs reads the same text
    }
}
