//! Runs tasks on all cores. Most of this code isn't generic, because each test program would compile generic code
//! again.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};

/// The number of rows that one task makes. A task of this size takes longer to run than to start.
const TASK: usize = 2048;

/// Runs tasks, and returns their results in the order of their indices.
pub(crate) fn map<T: Send + Sync>(tasks: usize, task: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let slots: Vec<OnceLock<T>> = (0..tasks).map(|_| OnceLock::new()).collect();
    run(tasks, &|index| {
        slots[index].get_or_init(|| task(index));
    });
    slots.into_iter().map(|slot| slot.into_inner().expect("each task has run")).collect()
}

/// Runs tasks on this thread, and on one helper thread for each other core. If there were one helper thread for each
/// core, and this thread only waited, the system would often run two helper threads on one core, and leave another core
/// idle.
fn run(tasks: usize, task: &(dyn Fn(usize) + Sync)) {
    let next = AtomicUsize::new(0);
    let work = || {
        while let Some(index) = Some(next.fetch_add(1, Ordering::Relaxed)).filter(|i| *i < tasks) {
            task(index);
        }
    };
    let helpers = rayon::current_num_threads().min(tasks).saturating_sub(1);
    rayon::in_place_scope(|scope| {
        (0..helpers).for_each(|_| scope.spawn(|_| work()));
        work();
    });
}

/// Makes `count` rows of `width` values in one list, such as the arguments of each case. `append` appends the rows
/// of a range to a list. Returns `None` if a call of `append` returns `false`.
pub(crate) fn rows<T: Copy + Default + Send>(
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
        parts.push((range, Mutex::new(part)));
    }
    let failed = AtomicBool::new(false);
    run(parts.len(), &|index| {
        if failed.load(Ordering::Relaxed) {
            return;
        }
        let (range, part) = &parts[index];
        let mut part = part.lock().expect("no other task has it");
        let mut lanes = Vec::with_capacity(part.len());
        // The thread's own buffer stays in its cache. The memory of all rows is written only once.
        match append(range.clone(), &mut lanes) {
            true => part.copy_from_slice(&lanes),
            false => failed.store(true, Ordering::Relaxed),
        }
    });
    drop(parts);
    (!failed.into_inner()).then_some(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_is_made_once_and_rows_are_in_order() {
        for count in [0, 1, TASK, TASK + 1, 10 * TASK + 7] {
            let made = AtomicUsize::new(0);
            let rows = rows(count, 2, &|range, lanes| {
                made.fetch_add(range.len(), Ordering::Relaxed);
                range.for_each(|row| lanes.extend([2 * row, 2 * row + 1]));
                true
            });
            assert_eq!(rows, Some((0..2 * count).collect()));
            assert_eq!(made.into_inner(), count);
        }
        assert_eq!(map(1000, |task| task * task), (0..1000).map(|i| i * i).collect::<Vec<_>>());
    }

    #[test]
    fn a_parallel_run_with_one_failed_task_returns_no_rows() {
        let without = |refused: usize| {
            rows(5 * TASK, 1, &|range, lanes| {
                lanes.extend(range.clone().map(|_| 0_u32));
                !range.contains(&refused)
            })
        };
        for refused in [0, 3 * TASK, 5 * TASK - 1] {
            assert_eq!(without(refused), None, "{refused}");
        }
        assert!(without(5 * TASK).is_some());
    }

    /// If a reference panics on any thread, the test that uses the reference fails.
    #[test]
    fn a_panic_of_any_task_reaches_the_caller() {
        for bad in [0, 50, 99] {
            let ran = std::panic::catch_unwind(|| map(100, |task| assert_ne!(task, bad)));
            assert!(ran.is_err(), "{bad}");
        }
    }
}
