//! `cargo ci full`: runs the suites that are too long for each change.
//!
//! `cargo ci test` runs only a sample of each suite. For example, it runs the tests of five modules of the shader
//! library on SwiftShader, while `cargo ci full` runs the tests of all modules.

use std::fmt::Write as _;
use std::io::{BufRead, BufReader, Write};
use std::process::{Command, ExitCode, Stdio};

use anyhow::{Context, Result, bail, ensure};

use crate::step::Steps;
use crate::{command, dist, glams, matrix, setup, suite, swiftshader};

/// The page with the results of the last run on SwiftShader.
const PAGE: &str = "docs/swiftshader.md";

/// The path of the run on SwiftShader. During this run, the path has no other driver.
const PATHS: &str = "vulkan";

/// Runs the long suites one after the other, and stops at the first failure.
pub(crate) fn run() -> ExitCode {
    let mut steps = Steps::new("cargo ci full");
    let _ = steps.run("setup", setup::install_missing)
        && steps.run("browser", setup::install_browser)
        && steps.run("validators", setup::install_validators)
        && steps.run("tint", setup::install_tint)
        && steps.run("web", setup::install_web)
        && steps.run("build", suite::build)
        && steps.run("npm packages", || suite::npm_packages(true))
        && steps.run("behind a pipe", || command::run(&mut suite::piped(&[])))
        && steps.run("example for Bevy", suite::bevy_example)
        && steps.run("glams", glams::run)
        && steps.run("long suites", || command::run(&mut suite::long()))
        && steps.run("dawn", || on_the_web("dawn"))
        && steps.run("chromium", || on_the_web("chromium"))
        && steps.run("divergences", matrix::divergences)
        && steps.run("packages without Rust", || dist::run(None))
        && steps.run("swiftshader", on_swiftshader);
    steps.finish()
}

/// The file that lists the shader library's tests that fail on a path of the web (WebGPU in Node or in a browser).
const KNOWN: &str = "tests/web.txt";

/// Runs the tests of the whole shader library on a path of the web. Exactly the tests in [`KNOWN`] must fail.
fn on_the_web(path: &str) -> Result<()> {
    let list = std::fs::read_to_string(command::root().join(KNOWN)).context(KNOWN)?;
    let mut test = command::cargo(&["test", "--workspace", "--locked", "--no-fail-fast"]);
    test.args(["--test", "library"]).env("KARAT_PATHS", path).env("KARAT_REQUIRE", path);
    let output = test.stderr(Stdio::inherit()).output().context("cargo doesn't run")?;
    let mut sum = Sum::default();
    String::from_utf8_lossy(&output.stdout).lines().for_each(|line| sum.read(line));
    ensure!(sum.passed > 0, "no test passed on {path}");
    let wrong = others(&list, &sum.failed);
    ensure!(wrong.is_empty(), "on {path}: {}; see {KNOWN}", wrong.join(", "));
    Ok(())
}

/// Returns a message for each failed test that isn't in `list`, and for each test in `list` that passed. A test marked
/// `sometimes` may pass or fail.
fn others(list: &str, failed: &[String]) -> Vec<String> {
    let known = list.lines().filter(|line| !line.starts_with('#') && !line.is_empty());
    let (mut always, mut sometimes) = (Vec::new(), Vec::new());
    for line in known {
        match line.strip_suffix(" sometimes") {
            Some(name) => sometimes.push(name),
            None => always.push(line),
        }
    }
    let is_known = |name: &str| always.contains(&name) || sometimes.contains(&name);
    let new = failed.iter().filter(|name| !is_known(name)).map(|name| format!("`{name}` fails"));
    let gone = always.iter().filter(|name| !failed.iter().any(|one| one == *name));
    new.chain(gone.map(|name| format!("`{name}` passes"))).collect()
}

/// Runs all tests without Mesa: SwiftShader is the only Vulkan driver, and there is no GL.
fn on_swiftshader() -> Result<()> {
    let manifest = swiftshader::manifest().context("no Chromium with SwiftShader is here")?;
    let alone = |command: &mut Command| {
        command
            .env("VK_DRIVER_FILES", &manifest)
            // The list of vendors is empty, so EGL finds no driver.
            .env("__EGL_VENDOR_LIBRARY_FILENAMES", "/dev/null")
            .env("KARAT_PATHS", PATHS)
            .env("KARAT_REQUIRE", PATHS);
    };
    let mut doctor = command::karat(&["doctor", "--require", PATHS])?;
    alone(&mut doctor);
    let doctor = doctor.output().context("`karat doctor` doesn't run")?;
    let said = String::from_utf8_lossy(&doctor.stdout);
    let driver = said.lines().find(|line| line.contains("SwiftShader"));
    let driver = driver.context("`karat doctor` opens no SwiftShader")?.trim().to_owned();
    let mut test = command::cargo(&["test", "--workspace", "--locked", "--no-fail-fast"]);
    alone(&mut test);
    let mut child = test.stdout(Stdio::piped()).spawn().context("cargo doesn't run")?;
    let mut sum = Sum::default();
    for line in BufReader::new(child.stdout.take().context("it is piped")?).lines() {
        let line = line.context("the tests' output ended early")?;
        let _ = writeln!(std::io::stderr(), "{line}");
        sum.read(&line);
    }
    let status = child.wait().context("cargo was lost")?;
    ensure!(sum.passed > 0, "no test ran");
    let page = command::root().join(PAGE);
    std::fs::write(&page, sum.page(&driver, status.success()))
        .with_context(|| format!("{}", page.display()))?;
    match (status.success(), sum.failed.len()) {
        (true, 0) => Ok(()),
        // A test program that crashes or exceeds its deadline doesn't name a failed test.
        (_, 0) => bail!("`cargo test` ended with {status} on SwiftShader alone"),
        (_, failed) => bail!("{failed} tests failed on SwiftShader alone; {PAGE} names them"),
    }
}

/// The sums of the results that libtest prints, over all test programs.
#[derive(Debug, Default, PartialEq)]
pub(crate) struct Sum {
    pub(crate) passed: u64,
    ignored: u64,
    failed: Vec<String>,
}

impl Sum {
    /// Reads a line of libtest's output, and updates the sums if the line reports a failed test, or has the counts of a
    /// test program.
    pub(crate) fn read(&mut self, line: &str) {
        if let Some(name) =
            line.strip_prefix("test ").and_then(|rest| rest.strip_suffix(" ... FAILED"))
        {
            self.failed.push(name.to_owned());
        }
        let Some(counts) = line.strip_prefix("test result: ") else { return };
        let count = |word: &str| {
            let part = counts.split(['.', ';']).find_map(|part| part.trim().strip_suffix(word));
            part.and_then(|part| part.trim().parse::<u64>().ok()).unwrap_or(0)
        };
        self.passed += count(" passed");
        self.ignored += count(" ignored");
    }

    fn page(&self, driver: &str, good: bool) -> String {
        let Self { passed, ignored, failed } = self;
        let mut page = format!(
            "# The whole suite on SwiftShader alone\n\n\
             `cargo ci full` runs every test of the project with SwiftShader as the only driver, and writes this \
             page.\nA workflow runs it once a week. `cargo ci test` runs the tests of five of the shader library's \
             modules on SwiftShader.\n\n\
             | driver | passed | failed | ignored |\n|---|---|---|---|\n| {driver} | {passed} | {} | {ignored} |\n",
            failed.len()
        );
        if !good && failed.is_empty() {
            page += "\n`cargo test` failed, and it names no test: a test program ended before its last test.\n";
        }
        for name in failed {
            let _ = write!(page, "\n- {name}");
        }
        if !failed.is_empty() {
            page.push('\n');
        }
        page
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unlisted_failures_and_passing_known_failures_are_named() {
        let list = "# Why.\na::b\na::c sometimes\n";
        let failed =
            |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        assert!(others(list, &failed(&["a::b"])).is_empty());
        assert!(others(list, &failed(&["a::c", "a::b"])).is_empty());
        assert_eq!(others(list, &failed(&["a::c"])), ["`a::b` passes"]);
        assert_eq!(others(list, &failed(&["a::b", "a::d"])), ["`a::d` fails"]);
    }

    // Lesson 197
    #[test]
    fn lines_of_all_programs_are_summed() {
        let mut sum = Sum::default();
        for line in [
            "test golden::every_frame ... ok",
            "test library::brdf ... FAILED",
            "test result: FAILED. 1 passed; 1 failed; 0 ignored; 0 measured; 0 filtered out; finished in 1.2s",
            "test result: ok. 20 passed; 0 failed; 3 ignored; 0 measured; 0 filtered out; finished in 0.1s",
        ] {
            sum.read(line);
        }
        let expected = Sum { passed: 21, ignored: 3, failed: vec!["library::brdf".to_owned()] };
        assert_eq!(sum, expected);
        let page = sum.page("vulkan: SwiftShader", false);
        assert!(
            page.contains("| vulkan: SwiftShader | 21 | 1 | 3 |\n\n- library::brdf\n"),
            "{page}"
        );
        let crashed = Sum { passed: 1, ..Sum::default() }.page("vulkan: SwiftShader", false);
        assert!(crashed.contains("ended before its last test"), "{crashed}");
    }
}
