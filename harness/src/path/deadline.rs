//! Limits the time that a shader may take.
//!
//! A time-out can't be an error that the caller handles: some drivers run a shader inside the call that submits it, and
//! a hung queue can't be shut down. So the process reports what hung, and ends.

use std::cell::RefCell;
use std::io::Write;
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

use super::Path;
use crate::output::visible;
use crate::settings;

/// Runs the deadline as long as it lives.
#[must_use]
pub(crate) struct Guard {
    /// Its end, when the guard is dropped, tells the watching thread that the work is done.
    _done: Sender<()>,
    path: Path,
    watcher: Option<Watcher>,
}

impl Drop for Guard {
    fn drop(&mut self) {
        self.watcher.iter().for_each(|watcher| watcher(self.path, Moment::Ends));
    }
}

/// An event in the life of a guard, for its watcher.
pub enum Moment<'a> {
    /// Work with a deadline begins.
    Begins,
    /// The work didn't finish; a sentence says what, before the process ends.
    Overdue(&'a str),
    /// The work ended in time.
    Ends,
}

/// Receives the events of the guards that live during some work.
pub(crate) type Watcher = Arc<dyn Fn(Path, Moment<'_>) + Send + Sync>;

thread_local! {
    /// The watcher of guards that this thread makes.
    static WATCHER: RefCell<Option<Watcher>> = const { RefCell::new(None) };
}

/// Runs `work`, and sends the events of its guards to the watcher.
pub fn watched<T>(watcher: Watcher, work: impl FnOnce() -> T) -> T {
    /// Restores the previous watcher, even after a panic.
    struct Before(Option<Watcher>);
    impl Drop for Before {
        fn drop(&mut self) {
            WATCHER.set(self.0.take());
        }
    }
    let _before = Before(WATCHER.replace(Some(watcher)));
    work()
}

/// Ends the process unless the guard is dropped within the deadline. `what` describes the work on the path, and how to
/// run it again.
pub(crate) fn guard(path: Path, what: impl FnOnce() -> String + Send + 'static) -> Guard {
    within(settings::deadline(), path, what)
}

/// The same while a path opens. That runs no shader, so this deadline is separate.
pub(crate) fn guard_opening(path: Path) -> Guard {
    let limit = settings::deadline().max(Duration::from_secs_f64(settings::DEADLINE_SECONDS));
    within(limit, path, move || format!("opening path {path}"))
}

fn within(limit: Duration, path: Path, what: impl FnOnce() -> String + Send + 'static) -> Guard {
    let watcher = WATCHER.with_borrow(Clone::clone);
    watcher.iter().for_each(|watcher| watcher(path, Moment::Begins));
    let late = watcher.clone();
    let (done, wait) = channel::<()>();
    std::thread::spawn(move || {
        if wait.recv_timeout(limit) == Err(RecvTimeoutError::Timeout) {
            // Written past the test runner's capture, whose text is lost with the process.
            let why = format!(
                "{} did not finish within {} s: an endless loop, or a deadline too short for this \
                 adapter (KARAT_TIMEOUT=seconds)",
                what(),
                limit.as_secs_f64()
            );
            if let Some(late) = late {
                late(path, Moment::Overdue(&why));
            }
            let message = format!("\nerror: {why}\n");
            let mut stderr = std::io::stderr();
            let written =
                stderr.write_all(visible(&message).as_bytes()).and_then(|()| stderr.flush());
            // `exit` would run the driver's clean-up, which waits for the hung queue.
            drop(written);
            std::process::abort();
        }
    });
    Guard { _done: done, path, watcher }
}
