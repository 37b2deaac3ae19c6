//! Messages about slow work.

use std::io::IsTerminal;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

/// The time after which Karat reports an action that isn't finished.
pub(super) const PATIENCE: Duration = Duration::from_secs(2);

/// Calls `work`. If `work` takes long, prints the text `doing` on a terminal.
pub(super) fn patiently<T>(doing: &str, work: impl FnOnce() -> T) -> T {
    if !std::io::stderr().is_terminal() {
        return work();
    }
    after(PATIENCE, || karat::unstable::output::tell(doing), work)
}

/// Calls `work`, and calls `say` if `work` takes longer than `patience`.
fn after<T>(patience: Duration, say: impl FnOnce() + Send, work: impl FnOnce() -> T) -> T {
    let (done, waiting) = mpsc::channel::<()>();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            if waiting.recv_timeout(patience) == Err(RecvTimeoutError::Timeout) {
                say();
            }
        });
        let result = work();
        drop(done);
        result
    })
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    #[test]
    fn only_slow_work_is_announced() {
        let told = |patience, work: &dyn Fn()| {
            let told = AtomicBool::new(false);
            after(patience, || told.store(true, Ordering::Relaxed), work);
            told.load(Ordering::Relaxed)
        };
        assert!(told(Duration::ZERO, &|| std::thread::sleep(Duration::from_millis(50))));
        assert!(!told(Duration::from_secs(600), &|| ()));
    }
}
