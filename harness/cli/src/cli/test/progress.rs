//! A progress line for a whole run, on standard error if this is a terminal. The line disappears at the end.

use std::io::IsTerminal;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use indicatif::{ProgressBar, ProgressStyle};

/// The progress of a run. The bar needs the number of all tests. If this run includes all tests, Karat knows their
/// number from an earlier run of all tests. Each test program prints the number of its tests only when it starts, so
/// a bar that used the sum of these numbers would jump backwards.
pub(super) struct Progress {
    line: Line,
    done: u64,
    passed: Vec<String>,
    failed: Vec<String>,
}

/// The progress line. Several threads may write above it.
#[derive(Clone)]
pub(super) struct Line {
    bar: ProgressBar,
    /// `true` while the line is on the screen. Only the thread that has the lock may write.
    drawn: Arc<Mutex<bool>>,
}

impl Line {
    fn of(bar: ProgressBar) -> Self {
        Self { bar, drawn: Arc::default() }
    }

    fn alone(&self) -> MutexGuard<'_, bool> {
        self.drawn.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Checks if a terminal shows the line.
    pub(super) fn is_seen(&self) -> bool {
        !self.bar.is_hidden()
    }

    /// Writes text that stays above the line.
    pub(super) fn above<T>(&self, write: impl FnOnce() -> T) -> T {
        let drawn = self.alone();
        // The line appears with the first verdict, because Cargo builds first.
        if *drawn { self.bar.suspend(write) } else { write() }
    }
}

impl Progress {
    /// Makes the progress line. `expected` is the number of all tests, or `None` if this run leaves tests out.
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

    pub(super) fn step(&mut self, name: &str, verdict: &str) {
        self.done += 1;
        match verdict {
            "FAILED" => self.failed.push(name.to_owned()),
            "ok" => self.passed.push(name.to_owned()),
            _ => {}
        }
        let mut drawn = self.line.alone();
        let bar = &self.line.bar;
        // If there are more tests than in the last run, the bar stays full and grows.
        if bar.length().is_some_and(|length| length < self.done) {
            bar.set_length(self.done);
        }
        bar.set_position(self.done);
        bar.set_message(name.to_owned());
        *drawn = true;
    }

    /// Returns the line, so that other code can write above it.
    pub(super) fn line(&self) -> Line {
        self.line.clone()
    }

    /// Hides the line until the next verdict.
    pub(super) fn pause(&self) {
        let mut drawn = self.line.alone();
        self.line.bar.finish_and_clear();
        *drawn = false;
    }

    pub(super) fn passed(&self) -> &[String] {
        &self.passed
    }

    /// Counts the tests without a verdict as failed. The program of these tests ended early.
    pub(super) fn end_without(&mut self, tests: impl Iterator<Item = String>) -> Vec<String> {
        let untold = |name: &String| !self.passed.contains(name) && !self.failed.contains(name);
        let untold: Vec<String> = tests.filter(untold).collect();
        self.failed.extend(untold.iter().cloned());
        untold
    }

    pub(super) fn failed(&self) -> &[String] {
        &self.failed
    }

    /// Returns the number of tests with a verdict.
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
