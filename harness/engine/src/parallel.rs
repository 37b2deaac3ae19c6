//! Runs work on all cores.

use std::sync::atomic::{AtomicUsize, Ordering};

use karat_core::panics;

/// Returns the next task, or `None` if all tasks are taken.
pub(crate) type Next<'n> = &'n (dyn Fn() -> Option<usize> + Sync);

/// Runs workers on this thread and on other threads, until the workers have taken all tasks. A worker may get no task.
///
/// The calling thread works, too. If the calling thread only waited, and each core had a worker, the system's scheduler
/// would often run two workers on one core while another core idles.
pub(crate) fn run(tasks: usize, worker: &(dyn Fn(Next<'_>) + Sync)) {
    let taken = AtomicUsize::new(0);
    let next = || Some(taken.fetch_add(1, Ordering::Relaxed)).filter(|task| *task < tasks);
    let helpers = rayon::current_num_threads().min(tasks).saturating_sub(1);
    if helpers == 0 {
        return worker(&next);
    }
    let caught = panics::are_caught();
    rayon::in_place_scope(|scope| {
        (0..helpers).for_each(|_| scope.spawn(|_| panics::helping(caught, || worker(&next))));
        worker(&next);
    });
}
