//! Runs steps: pieces of work, each with a name, a heading, a wall time and a verdict.
//!
//! Headings and verdicts go to stderr, so that stdout has only the output of child processes.

use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Result;

use crate::command;

/// The steps that a `cargo ci` command has run, in their order.
pub(crate) struct Steps {
    task: &'static str,
    started: Instant,
    done: Vec<Step>,
}

struct Step {
    name: &'static str,
    wall: Duration,
    outcome: Result<()>,
}

impl Steps {
    /// Returns an empty list of steps for the command `task`, which the summary names.
    pub(crate) fn new(task: &'static str) -> Self {
        Self { task, started: Instant::now(), done: Vec::new() }
    }

    /// Runs one step, and stores its verdict. Returns `true` if the step passed, so a command can join steps by `&&` to
    /// stop at the first failure.
    pub(crate) fn run(&mut self, name: &'static str, work: impl FnOnce() -> Result<()>) -> bool {
        eprintln!("== {name}");
        let started = Instant::now();
        let outcome = work();
        let wall = started.elapsed();
        match &outcome {
            Ok(()) => eprintln!("== {name}: passed in {}", seconds(wall)),
            Err(error) => eprintln!("== {name}: FAILED in {}\n   {error:#}", seconds(wall)),
        }
        let passed = outcome.is_ok();
        self.done.push(Step { name, wall, outcome });
        passed
    }

    /// Runs two lists of steps at the same time, and stores all verdicts. The outputs of both lists are mixed.
    pub(crate) fn beside(
        &mut self,
        others: impl FnOnce(&mut Self) + Send,
        own: impl FnOnce(&mut Self),
    ) {
        let mut apart = Self::new(self.task);
        std::thread::scope(|scope| {
            let running = scope.spawn(|| others(&mut apart));
            own(self);
            running.join().expect("steps return their errors");
        });
        self.done.append(&mut apart.done);
    }

    /// Prints the summary. Returns the exit code of the first step that failed.
    pub(crate) fn finish(self) -> ExitCode {
        eprintln!("{}", summary(self.task, &self.done, self.started.elapsed()));
        let failed = self.done.iter().find_map(|step| step.outcome.as_ref().err());
        match failed {
            Some(error) => ExitCode::from(command::exit_code(error)),
            // A run without steps proves nothing, so it fails.
            None if self.done.is_empty() => ExitCode::FAILURE,
            None => ExitCode::SUCCESS,
        }
    }
}

/// Returns the exit code of a command with a single step. If the step failed, prints its error.
pub(crate) fn verdict(outcome: Result<()>) -> ExitCode {
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(command::exit_code(&error))
        }
    }
}

/// Formats the summary: a line for each failed step with its error, and a last line with the wall times of all steps.
fn summary(task: &str, steps: &[Step], wall: Duration) -> String {
    let mut lines = Vec::new();
    let mut times = Vec::new();
    for Step { name, wall, outcome } in steps {
        let time = seconds(*wall);
        match outcome {
            Ok(()) => times.push(format!("{name} {time}")),
            Err(error) => {
                lines.push(format!("{name}: {error:#}"));
                times.push(format!("{name} {time} FAILED"));
            }
        }
    }
    let (passed, all) = (steps.len() - lines.len(), steps.len());
    let times = times.join(", ");
    lines.push(format!("{task}: {passed} of {all} steps passed in {} ({times})", seconds(wall)));
    lines.join("\n")
}

fn seconds(duration: Duration) -> String {
    format!("{:.1} s", duration.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(name: &'static str, milliseconds: u64, outcome: Result<()>) -> Step {
        Step { name, wall: Duration::from_millis(milliseconds), outcome }
    }

    #[test]
    fn concurrent_steps_are_recorded() {
        let mut steps = Steps::new("cargo ci test");
        steps.beside(
            |others| {
                others.run("setup", || anyhow::bail!("no network"));
            },
            |own| {
                own.run("clippy", || Ok(()));
            },
        );
        let kept: Vec<_> = steps.done.iter().map(|s| (s.name, s.outcome.is_ok())).collect();
        assert_eq!(kept, [("clippy", true), ("setup", false)]);
    }

    #[test]
    fn passing_steps_make_one_line() {
        let steps = [step("format", 400, Ok(())), step("tests", 61_500, Ok(()))];
        assert_eq!(
            summary("cargo ci test", &steps, Duration::from_secs(62)),
            "cargo ci test: 2 of 2 steps passed in 62.0 s (format 0.4 s, tests 61.5 s)"
        );
    }

    #[test]
    fn failed_steps_are_listed_before_the_last_line() {
        let failure = anyhow::anyhow!("`cargo clippy` failed").context("lints");
        let steps = [step("clippy", 3_000, Err(failure)), step("tests", 1_000, Ok(()))];
        assert_eq!(
            summary("cargo ci test", &steps, Duration::from_secs(4)),
            "clippy: lints: `cargo clippy` failed\n\
             cargo ci test: 1 of 2 steps passed in 4.0 s (clippy 3.0 s FAILED, tests 1.0 s)"
        );
    }

    #[test]
    fn a_step_says_whether_it_passed() {
        let mut steps = Steps::new("a test");
        assert!(steps.run("good", || Ok(())));
        assert!(!steps.run("bad", || Err(anyhow::anyhow!("on purpose"))));
        assert_eq!(steps.done.len(), 2);
        assert_eq!(steps.finish(), ExitCode::FAILURE);
    }

    #[test]
    fn a_run_of_no_steps_fails() {
        assert_eq!(Steps::new("a test").finish(), ExitCode::FAILURE);
    }
}
