//! Work that may take long.

use std::io::IsTerminal;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

/// The time after which a person wonders what happens.
pub(super) const PATIENCE: Duration = Duration::from_secs(2);

/// Does work. If it takes long, prints on a terminal what it does.
pub(super) fn patiently<T>(doing: &str, work: impl FnOnce() -> T) -> T {
    if !std::io::stderr().is_terminal() {
        return work();
    }
    after(PATIENCE, || karat::unstable::output::tell(doing), work)
}

/// Does work, and calls `say` if it takes longer than `patience`.
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
