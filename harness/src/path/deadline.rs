//! A limit on the time that a shader may take.
//!
//! A time-out can't be an error that the caller handles: some drivers run a shader inside the call
//! that submits it, and a hung queue can't be torn down. So the process says what hung, and ends.

use std::io::Write;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};

use crate::settings;

use crate::output::visible;

/// While it lives, the deadline runs.
#[must_use]
pub(crate) struct Guard {
    /// Dropping the sender tells the watch that the work is done.
    _done: Sender<()>,
}

/// Ends the process unless the guard is dropped within the deadline. `what` says what was running
/// and how to run it again.
pub(crate) fn guard(what: impl FnOnce() -> String + Send + 'static) -> Guard {
    let (done, wait) = channel::<()>();
    let settings = settings::current().expect("no path opens with settings that aren't right");
    let limit = settings.deadline;
    std::thread::spawn(move || {
        if wait.recv_timeout(limit) == Err(RecvTimeoutError::Timeout) {
            // Written past the test runner's capture, which dies with the process.
            let message = format!(
                "\nerror: {} did not finish within {} s: an endless loop, or a deadline too short \
                 for this adapter (KARAT_DEADLINE=seconds)\n",
                what(),
                limit.as_secs_f64()
            );
            let mut stderr = std::io::stderr();
            let written =
                stderr.write_all(visible(&message).as_bytes()).and_then(|()| stderr.flush());
            // `exit` would run the driver's own clean-up, which waits for the hung queue.
            drop(written);
            std::process::abort();
        }
    });
    Guard { _done: done }
}
