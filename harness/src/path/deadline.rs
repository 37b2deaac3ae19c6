//! Limits the time that a shader may take.
//!
//! Karat can't return a time-out as an error, because some drivers run a shader inside the call that submits the
//! shader, and because a hung queue can't be shut down. So the process reports the work that hangs, and ends.

use std::cell::RefCell;
use std::io::Write;
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

use super::Path;
use crate::output::visible;
use crate::settings;

/// A running deadline, which ends when this guard is dropped.
#[must_use]
pub(crate) struct Guard {
    /// The watching thread stops when this sender is dropped.
    _done: Sender<()>,
    path: Path,
    watcher: Option<Watcher>,
}

impl Drop for Guard {
    fn drop(&mut self) {
        self.watcher.iter().for_each(|watcher| watcher(self.path, Moment::Ends));
    }
}

/// An event of guarded work: its start, its end, or a missed deadline.
pub enum Moment<'a> {
    /// The work begins.
    Begins,
    /// The work missed the deadline. The text names the work. The process ends next.
    Overdue(&'a str),
    /// The work ended in time.
    Ends,
}

/// A function that a guard calls at each of its events.
pub(crate) type Watcher = Arc<dyn Fn(Path, Moment<'_>) + Send + Sync>;

thread_local! {
    /// The watcher that receives the events of the guards that this thread makes.
    static WATCHER: RefCell<Option<Watcher>> = const { RefCell::new(None) };
}

/// Runs `work`, and sends the events of its guards to the watcher.
pub fn watched<T>(watcher: Watcher, work: impl FnOnce() -> T) -> T {
    /// Restores the previous watcher when dropped, even after a panic.
    struct Before(Option<Watcher>);
    impl Drop for Before {
        fn drop(&mut self) {
            WATCHER.set(self.0.take());
        }
    }
    let _before = Before(WATCHER.replace(Some(watcher)));
    work()
}

/// Starts a deadline, and returns its guard. If the guard still exists at the deadline, the process ends. `what`
/// describes the work, and how to repeat it.
pub(crate) fn guard(path: Path, what: impl FnOnce() -> String + Send + 'static) -> Guard {
    within(settings::deadline(), path, what)
}

/// Like [`guard`], for opening a path. The time limit is at least 60 s, even if `KARAT_TIMEOUT` is shorter.
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
            // Writes directly to stderr, because the test runner's captured output is lost with the process.
            let why = format!(
                "{} did not finish within {} s. A loop may be endless, or the deadline may be too short \
                 for this adapter: set KARAT_TIMEOUT to a larger number of seconds",
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
