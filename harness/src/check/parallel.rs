//! Tasks on all cores, compiled once: what is generic is compiled again in every test.

use std::sync::OnceLock;

use rayon::prelude::*;

/// The results of tasks, in their order.
pub(super) fn map<T: Send + Sync>(tasks: usize, task: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let slots: Vec<OnceLock<T>> = (0..tasks).map(|_| OnceLock::new()).collect();
    run(tasks, &|index| {
        slots[index].get_or_init(|| task(index));
    });
    slots.into_iter().map(|slot| slot.into_inner().expect("each task has run")).collect()
}

fn run(tasks: usize, task: &(dyn Fn(usize) + Sync)) {
    (0..tasks).into_par_iter().for_each(task);
}
