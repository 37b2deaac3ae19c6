//! One line of progress for a whole run, on standard error, where that is a terminal. It leaves nothing behind.

use std::io::IsTerminal;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use indicatif::{ProgressBar, ProgressStyle};

/// How many tests there will be is known where the last run was of the same ones: programs of tests tell their
/// counts one by one, and a bar of what is known so far would go backwards.
pub(super) struct Progress {
    line: Line,
    done: u64,
    passed: Vec<String>,
    failed: Vec<String>,
}

/// The line that is drawn. Several threads may write above it.
#[derive(Clone)]
pub(super) struct Line {
    bar: ProgressBar,
    /// Whether it is on the screen. Who holds it writes alone.
    drawn: Arc<Mutex<bool>>,
}

impl Line {
    fn of(bar: ProgressBar) -> Self {
        Self { bar, drawn: Arc::default() }
    }

    fn alone(&self) -> MutexGuard<'_, bool> {
        self.drawn.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether somebody sees it.
    pub(super) fn is_seen(&self) -> bool {
        !self.bar.is_hidden()
    }

    /// Writes what is to stay above the line.
    pub(super) fn above<T>(&self, write: impl FnOnce() -> T) -> T {
        let drawn = self.alone();
        // Nothing is drawn before there is a verdict: Cargo builds.
        if *drawn { self.bar.suspend(write) } else { write() }
    }
}

impl Progress {
    /// `expected` is how many tests the last such run had.
    pub(super) fn of(expected: Option<u64>) -> Self {
        let hidden = !std::io::stderr().is_terminal();
        let bar = match expected {
            _ if hidden => ProgressBar::hidden(),
            Some(count) => ProgressBar::new(count)
                .with_style(style("{bar:40} {pos} of {len} tests  {wide_msg}")),
            None => {
                ProgressBar::new_spinner().with_style(style("{spinner} {pos} tests  {wide_msg}"))
            }
        };
        Self { line: Line::of(bar), done: 0, passed: Vec::new(), failed: Vec::new() }
    }

    /// A test has its verdict.
    pub(super) fn step(&mut self, name: &str, verdict: &str) {
        self.done += 1;
        match verdict {
            "FAILED" => self.failed.push(name.to_owned()),
            "ok" => self.passed.push(name.to_owned()),
            _ => {}
        }
        let mut drawn = self.line.alone();
        let bar = &self.line.bar;
        // More tests than last time: the bar is full, and grows.
        if bar.length().is_some_and(|length| length < self.done) {
            bar.set_length(self.done);
        }
        bar.set_position(self.done);
        bar.set_message(name.to_owned());
        *drawn = true;
    }

    /// The line, for who writes above it.
    pub(super) fn line(&self) -> Line {
        self.line.clone()
    }

    /// Takes the line away for a while: another program writes.
    pub(super) fn pause(&self) {
        let mut drawn = self.line.alone();
        self.line.bar.finish_and_clear();
        *drawn = false;
    }

    /// Tests that passed.
    pub(super) fn passed(&self) -> &[String] {
        &self.passed
    }

    /// Tests whose program ended before they had a verdict: those of some that have none.
    pub(super) fn end_without(&mut self, tests: impl Iterator<Item = String>) -> Vec<String> {
        let untold = |name: &String| !self.passed.contains(name) && !self.failed.contains(name);
        let untold: Vec<String> = tests.filter(untold).collect();
        self.failed.extend(untold.iter().cloned());
        untold
    }

    /// Tests that failed.
    pub(super) fn failed(&self) -> &[String] {
        &self.failed
    }

    /// How many tests had a verdict.
    pub(super) fn done(&self) -> u64 {
        self.done
    }
}

fn style(template: &str) -> ProgressStyle {
    ProgressStyle::with_template(template).expect("the template is valid")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_that_is_done_never_shrinks() {
        let line = Line::of(ProgressBar::hidden());
        line.bar.set_length(3);
        let mut progress = Progress { line, done: 0, passed: Vec::new(), failed: Vec::new() };
        let mut last = 0.0;
        for test in 0..5 {
            progress.step(&test.to_string(), if test == 2 { "FAILED" } else { "ok" });
            let (at, length) =
                (progress.line.bar.position(), progress.line.bar.length().unwrap_or(0));
            let share = at as f64 / length as f64;
            assert!(share >= last, "{test}: {share} after {last}");
            last = share;
        }
        assert_eq!((progress.done(), progress.failed()), (5, &["2".to_owned()][..]));
    }
}
