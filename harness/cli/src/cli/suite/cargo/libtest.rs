//! Runs the tests of a program, and parses the output of Rust's test runner.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, PoisonError};

use anyhow::Context;

use super::super::super::child::{LastWords, verdict};
use super::programs::TestProgram;

/// The largest number of test names in one command. On Windows, a command has at most 32,767 characters.
const TOGETHER: usize = 200;

/// The running test program. Karat ends this program before its own process ends.
static RUNNING: Mutex<Option<Child>> = Mutex::new(None);

pub(in crate::cli) fn end_all() {
    if let Some(child) = &mut *RUNNING.lock().unwrap_or_else(PoisonError::into_inner) {
        drop(child.kill());
        drop(child.wait());
    }
}

/// The function that receives a verdict: the name of the test, and the message if the test failed.
pub(in crate::cli) type Heard<'h> = &'h mut dyn FnMut(&str, Option<String>) -> std::io::Result<()>;

/// Runs tests of a program by their names, with a folder for records and an overlay of modules.
pub(in crate::cli) fn run(
    program: &TestProgram,
    tests: &[&str],
    folders: (&Path, Option<&Path>),
    heard: Heard<'_>,
) -> anyhow::Result<()> {
    run_until(program, tests, folders, heard, &mut |_| false).map(drop)
}

/// Does the work of [`run`], but stops at the first failed test for which `ends` returns `true`. After such a test,
/// returns `true`, and reports no later tests.
pub(in crate::cli) fn run_until(
    program: &TestProgram,
    tests: &[&str],
    folders: (&Path, Option<&Path>),
    heard: Heard<'_>,
    ends: &mut dyn FnMut(&str) -> bool,
) -> anyhow::Result<bool> {
    // A program that runs all of its tests needs no names.
    if tests.len() == program.tests.len() {
        return run_some(program, tests, &[], folders, heard, ends);
    }
    for some in tests.chunks(TOGETHER) {
        if run_some(program, some, some, folders, heard, ends)? {
            return Ok(true);
        }
    }
    Ok(false)
}

fn run_some(
    program: &TestProgram,
    tests: &[&str],
    filters: &[&str],
    (record, overlay): (&Path, Option<&Path>),
    heard: Heard<'_>,
    ends: &mut dyn FnMut(&str) -> bool,
) -> anyhow::Result<bool> {
    let mut command = Command::new(&program.executable);
    command.args((!filters.is_empty()).then_some("--exact")).args(filters);
    command.args(["--color", "never"]);
    // Cargo would use the same folder and variables.
    command.current_dir(&program.folder).env("CARGO_MANIFEST_DIR", &program.folder);
    command.env("CARGO_PKG_NAME", &program.package).env("KARAT_RECORD", record);
    command.envs(overlay.map(|folder| ("KARAT_OVERLAY", folder)));
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let name = program.executable.display();
    let mut child = command.spawn().with_context(|| format!("can't run `{name}`"))?;
    let stdout = child.stdout.take().context("it is piped")?;
    let last_words = LastWords::of(child.stderr.take().context("it is piped")?);
    *RUNNING.lock().unwrap_or_else(PoisonError::into_inner) = Some(child);
    let mut parser = Parser::default();
    for line in BufReader::new(stdout).split(b'\n') {
        let line = line.context("can't read the whole output of a test program")?;
        let line = String::from_utf8_lossy(&line);
        match parser.line(line.trim_end_matches('\r')) {
            Some((passed, true)) => heard(&passed, None)?,
            Some((failed, false)) if ends(&failed) => {
                end_all();
                return Ok(true);
            }
            _ => {}
        }
    }
    let child = RUNNING.lock().unwrap_or_else(PoisonError::into_inner).take();
    let status = child.map(|mut child| child.wait()).transpose()?;
    let words = last_words.heard();
    for test in tests {
        if let Some(message) = parser.failure(test) {
            heard(test, Some(message))?;
        } else if !parser.has_passed(test) {
            let status = status.map_or_else(String::new, |status| status.to_string());
            let message =
                format!("the test program ended before the end of this test ({status})\n{words}");
            heard(test, Some(message))?;
        }
    }
    Ok(false)
}

#[derive(Default)]
struct Parser {
    /// The failed tests. The message is `None` until the output of the test begins.
    failed: BTreeMap<String, Option<String>>,
    passed: Vec<String>,
    /// The test to which the present lines of output belong.
    section: Option<String>,
    ended: bool,
}

impl Parser {
    /// Reads a line. If the line is a verdict, returns the test, and `true` if the test passed.
    fn line(&mut self, line: &str) -> Option<(String, bool)> {
        if self.ended {
            return None;
        }
        if let Some(name) = section(line).filter(|name| self.failed.contains_key(*name)) {
            self.section = Some(name.to_owned());
            self.failed.insert(name.to_owned(), Some(String::new()));
            return None;
        }
        if let Some(section) = &self.section {
            // The list of names after the last message begins.
            if line == "failures:" {
                (self.section, self.ended) = (None, true);
            } else if let Some(Some(text)) = self.failed.get_mut(section) {
                text.push_str(line);
                text.push('\n');
            }
            return None;
        }
        let (name, word) = verdict(line)?;
        match word {
            "ok" => {
                self.passed.push(name.to_owned());
                Some((name.to_owned(), true))
            }
            "FAILED" => {
                self.failed.insert(name.to_owned(), None);
                Some((name.to_owned(), false))
            }
            _ => None,
        }
    }

    fn has_passed(&self, test: &str) -> bool {
        self.passed.iter().any(|passed| passed == test)
    }

    fn failure(&self, test: &str) -> Option<String> {
        let text = self.failed.get(test)?.clone().unwrap_or_default();
        let note = |line: &str| line.starts_with("note: run with `RUST_BACKTRACE");
        // `thread 'name' (7) panicked at tests/a.rs:3:5:`
        let place = |line: &str| {
            let (_, place) = line.strip_prefix("thread '")?.split_once(" panicked at ")?;
            Some(place.trim_end_matches(':').to_owned())
        };
        let at = text.lines().find_map(place);
        let lines = text.lines().filter(|line| !note(line) && place(line).is_none());
        let text = lines.collect::<Vec<_>>().join("\n");
        let text = if text.trim().is_empty() { "it failed" } else { text.trim() };
        Some(at.map_or_else(|| text.to_owned(), |at| format!("{text}\n  in {at}")))
    }
}

/// Returns the test of a line `---- name stdout ----`.
fn section(line: &str) -> Option<&str> {
    line.strip_prefix("---- ")?.strip_suffix(" stdout ----")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verdicts_and_messages_are_read() {
        let text = "\nrunning 4 tests\ntest a::good ... ok\ntest bad ... FAILED\n\
                    test dies - should panic ... ok\ntest skipped ... ignored\n\nfailures:\n\n\
                    ---- bad stdout ----\n\nthread 'bad' (7) panicked at tests/a.rs:3:5:\nwrong by 2 ulp\n\
                    ---- of mine ----\nfailures are shown\n\
                    note: run with `RUST_BACKTRACE=1` environment variable\n\n\nfailures:\n    bad\n\n\
                    test result: FAILED. 2 passed; 1 failed\n";
        let mut parser = Parser::default();
        let told: Vec<(String, bool)> = text.lines().filter_map(|line| parser.line(line)).collect();
        let told: Vec<(&str, bool)> =
            told.iter().map(|(name, passed)| (&**name, *passed)).collect();
        assert_eq!(told, [("a::good", true), ("bad", false), ("dies", true)]);
        let message = parser.failure("bad").expect("it failed");
        assert_eq!(
            message,
            "wrong by 2 ulp\n---- of mine ----\nfailures are shown\n  in tests/a.rs:3:5"
        );
        assert!(parser.failure("a::good").is_none() && !parser.has_passed("skipped"));
    }
}
