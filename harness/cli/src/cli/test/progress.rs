//! One line of progress for a whole run, on standard error, where that is a terminal. It leaves nothing behind.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};

/// How many tests there will be is known where the last run was of the same ones: programs of tests tell their
/// counts one by one, and a bar of what is known so far would go backwards.
pub(super) struct Progress {
    bar: ProgressBar,
    done: u64,
    failed: Vec<String>,
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
        Self { bar, done: 0, failed: Vec::new() }
    }

    /// A test has its verdict.
    pub(super) fn step(&mut self, name: &str, verdict: &str) {
        self.done += 1;
        if verdict == "FAILED" {
            self.failed.push(name.strip_suffix(" - should panic").unwrap_or(name).to_owned());
        }
        // More tests than last time: the bar is full, and grows.
        if self.bar.length().is_some_and(|length| length < self.done) {
            self.bar.set_length(self.done);
        }
        self.bar.set_position(self.done);
        self.bar.set_message(name.to_owned());
    }

    /// Writes what is to stay above the line.
    pub(super) fn above<T>(&self, write: impl FnOnce() -> T) -> T {
        self.bar.suspend(write)
    }

    /// Takes the line away for a while: another program writes.
    pub(super) fn pause(&self) {
        self.bar.finish_and_clear();
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
        let mut progress = Progress { bar: ProgressBar::hidden(), done: 0, failed: Vec::new() };
        progress.bar.set_length(3);
        let mut last = 0.0;
        for test in 0..5 {
            progress.step(&test.to_string(), if test == 2 { "FAILED" } else { "ok" });
            let (at, length) = (progress.bar.position(), progress.bar.length().unwrap_or(0));
            let share = at as f64 / length as f64;
            assert!(share >= last, "{test}: {share} after {last}");
            last = share;
        }
        assert_eq!((progress.done(), progress.failed()), (5, &["2".to_owned()][..]));
    }
}
