//! Work on all cores.

use std::sync::atomic::{AtomicUsize, Ordering};

use karat_core::panics;

/// The next task; `None` when all are taken.
pub(crate) type Next<'n> = &'n (dyn Fn() -> Option<usize> + Sync);

/// Runs workers, here and on other cores, until they have taken all tasks; a worker may find none.
///
/// A thread that only waited for as many workers as there are cores would leave them to the system's
/// scheduler, which often wakes two of them on one core while another idles.
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
