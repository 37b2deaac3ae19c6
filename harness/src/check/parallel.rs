//! Tasks on all cores, compiled once: what is generic is compiled again in every test.

use std::ops::Range;
use std::sync::OnceLock;

use rayon::prelude::*;

/// Rows that one task makes; enough that a task costs more than its start.
const TASK: usize = 2048;

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

/// Rows of equal width, one after the other. A task appends some of them; `None` if one says that it
/// couldn't.
pub(super) fn rows<T: Copy + Default + Send>(
    count: usize,
    width: usize,
    append: &(dyn Fn(Range<usize>, &mut Vec<T>) -> bool + Sync),
) -> Option<Vec<T>> {
    let mut rows = vec![T::default(); count * width];
    let (mut parts, mut rest) = (Vec::new(), &mut *rows);
    for first in (0..count).step_by(TASK) {
        let range = first..count.min(first + TASK);
        let (part, behind) = rest.split_at_mut(range.len() * width);
        rest = behind;
        parts.push((range, part));
    }
    let all = parts.into_par_iter().all(|(range, part)| {
        let mut lanes = Vec::with_capacity(part.len());
        // A thread's own memory is at hand; that of all rows is touched once.
        let done = append(range, &mut lanes);
        if done {
            part.copy_from_slice(&lanes);
        }
        done
    });
    all.then_some(rows)
}
