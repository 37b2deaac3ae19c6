//! Makes a test fail if `KARAT_CASE` selects a case, but the test doesn't run this case.
//!
//! `KARAT_CASE` names one check. A test runs its checks in order, so Karat learns only at the end of the test that no
//! check has this name. Test runners have no hook at the end of a test. But each test has its own thread, and the
//! runtime drops the thread's local values before the runner continues. `Replay` is such a value: its `drop` prints an
//! error and ends the process.

use std::cell::RefCell;
use std::io::Write;

use super::{NotBegun, host};
use crate::diagnostic::nearest;
use crate::settings::{self, Settings};

thread_local! {
    static REPLAY: RefCell<Replay> = RefCell::default();
}

/// The checks of the running test, for the replay that `KARAT_CASE` selects.
#[derive(Debug, Default)]
struct Replay {
    /// The checks that ran, as `function/check`, without duplicates.
    checks: Vec<String>,
    /// `true` if the selected case ran, or if a check has already made the test fail.
    done: bool,
}

/// The error for a check that `KARAT_CASE` doesn't select, and that runs in a thread without a name. Karat can't tell
/// which test runs such a check.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "KARAT_CASE selects `{selected}`, but `{check}` runs in a thread without a name, so Karat can't \
     tell which test runs this check: run the check in the test's own thread"
)]
pub struct NotReplayed {
    /// The name of the check with its function, or the name of the frame.
    pub check: String,
    /// The value of `KARAT_CASE`.
    pub selected: String,
}

/// Notes that a check or the comparison of a frame begins.
///
/// # Errors
/// Returns an error if the check isn't the selected check, and runs in a thread that the test started. Such a thread
/// may end before the selected check runs, so the end of the thread isn't the end of the test.
pub(crate) fn begin(settings: &Settings, check: &str) -> Result<(), NotReplayed> {
    let Some(selected) = &settings.case else { return Ok(()) };
    let named = selected.check.as_deref();
    let nameless = std::thread::current().name().is_none();
    if nameless && named.is_some_and(|named| plain(named) != check) {
        let (check, selected) = (check.to_owned(), named.unwrap_or_default().to_owned());
        return Err(NotReplayed { check, selected });
    }
    REPLAY.with_borrow_mut(|replay| {
        if !nameless && replay.checks.iter().all(|known| known != check) {
            replay.checks.push(check.to_owned());
        }
    });
    Ok(())
}

/// Notes that the comparison of a frame begins.
///
/// # Errors
/// Returns an error if an environment variable can't be used. Also returns an error if [`begin`] does.
pub(crate) fn begin_frame(name: &str) -> Result<(), NotBegun> {
    Ok(begin(settings::current()?, &format!("frame {name}"))?)
}

/// Notes that the selected case runs, or that a check has already made the test fail.
pub(crate) fn done() {
    REPLAY.with_borrow_mut(|replay| replay.done = true);
}

/// The name of a check without the way to pass arguments.
fn plain(check: &str) -> &str {
    check.split_once('@').map_or(check, |(plain, _)| plain)
}

/// Returns an error message if the running test should have replayed a case, but didn't. A program that runs
/// tests without Cargo must call this function at the end of each test. In Cargo's test programs, the process
/// prints the message and ends.
#[must_use]
pub fn not_replayed() -> Option<String> {
    REPLAY.with_borrow_mut(|replay| {
        let none = !replay.done && !replay.checks.is_empty();
        replay.done = true;
        none.then(|| replay.message())
    })
}

impl Replay {
    fn message(&self) -> String {
        let selected = settings::case_as_typed();
        let test = std::thread::current().name().unwrap_or("main").to_owned();
        let alone = match host::current() {
            Some(host) => host.command.join(" ") + " NAME",
            None => "cargo test ... -- --exact NAME".to_owned(),
        };
        message(&test, &selected, &self.checks, &alone)
    }
}

impl Drop for Replay {
    fn drop(&mut self) {
        if self.done || self.checks.is_empty() {
            return;
        }
        // Writes to standard error directly, because the test runner loses its captured output when the process
        // ends.
        drop(std::io::stderr().write_all(format!("\n{}\n", self.message()).as_bytes()));
        std::process::abort();
    }
}

fn message(test: &str, selected: &str, checks: &[String], alone: &str) -> String {
    let named = selected.rsplit_once('/').map_or("", |(check, _)| plain(check));
    let near = nearest(named, checks.iter().map(String::as_str));
    let near = near.map_or_else(String::new, |name| format!("; did you mean `{name}`?"));
    let checks: Vec<String> = checks.iter().map(|check| format!("`{check}`")).collect();
    format!(
        "error: test `{test}` replays nothing: KARAT_CASE={selected} names none of the test's checks: {}{near}\n  \
         run only the test that has the check (`{alone}`), or unset KARAT_CASE",
        checks.join(", ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_message_names_the_nearest_check() {
        let checks = ["fresnel::schlick/agrees_with", "fresnel::schlick/satisfies"];
        let alone = "cargo test ... -- --exact NAME";
        let selected = "fresnel::schlik/agrees_with/7";
        let text = message("schlick", selected, &checks.map(str::to_owned), alone);
        assert_eq!(
            text,
            "error: test `schlick` replays nothing: KARAT_CASE=fresnel::schlik/agrees_with/7 names \
             none of the test's checks: `fresnel::schlick/agrees_with`, `fresnel::schlick/satisfies`; did \
             you mean `fresnel::schlick/agrees_with`?\n  run only the test that has the check \
             (`cargo test ... -- --exact NAME`), or unset KARAT_CASE"
        );
    }
}
