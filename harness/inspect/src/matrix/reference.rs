//! Uses the verdicts of the package's own tests on the columns' paths.

use std::collections::BTreeSet;
use std::path::PathBuf;

use karat::unstable::record::{FileRead, PathRecord, Record, Subject, Verdict};
use serde::Serialize;

use super::{Cell, Matrix, Row, Status, Stop};

/// The verdicts of a function's own tests on one path.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Reference {
    /// The number of checks that ran on the path.
    pub checks: usize,
    /// The tests whose checks failed on the path.
    pub failed: Vec<String>,
    /// The largest ratio of an error to its tolerance; `None` if no check has a finite ratio.
    pub worst: Option<f64>,
}

impl Matrix {
    /// Judges functions by their own tests instead of the comparison with other columns. `records` has the verdicts of
    /// an earlier test run, and each cell gets the verdicts on its column's path. A test has a reference and a
    /// tolerance that its author chose, so its verdict counts more. If a file has changed since the run, its records
    /// are skipped.
    ///
    /// Returns the number of judged cells.
    pub fn judge_by(&mut self, records: &[Record]) -> usize {
        let current: Vec<&Record> = records.iter().filter(|record| is_current(record)).collect();
        let mut judged = 0;
        for row in &mut self.rows {
            let file = whole(&row.source.file);
            let of_row: Vec<&Record> = current
                .iter()
                .copied()
                .filter(|record| is_of(record, row, file.as_ref()))
                .collect();
            for (head, cell) in self.columns.iter().zip(&mut row.cells) {
                let on = |record: &Record| {
                    let mut paths = record.paths.iter();
                    paths.find(|path| path.adapter.path == head.name && path.cases > 0).cloned()
                };
                let found: Vec<(&Record, PathRecord)> =
                    of_row.iter().filter_map(|record| Some((*record, on(record)?))).collect();
                if !found.is_empty() && cell.status >= Some(Status::Executed) {
                    judge(cell, &found);
                    judged += 1;
                }
            }
        }
        judged
    }
}

fn judge(cell: &mut Cell, found: &[(&Record, PathRecord)]) {
    let mut reference = Reference { checks: found.len(), ..Reference::default() };
    for (record, path) in found {
        // A path without failures passes, even if other paths fail.
        if path.failures > 0 || (record.paths.len() == 1 && record.verdict != Verdict::Pass) {
            reference.failed.push(record.test.clone());
        }
        reference.worst = match (reference.worst, path.ratio) {
            (Some(a), Some(b)) => Some(a.max(b)),
            (a, b) => a.or(b),
        };
    }
    if reference.failed.is_empty() {
        (cell.status, cell.stopped) = (Some(Status::Agrees), None);
    } else {
        cell.status = Some(Status::Executed);
        let tests = reference.failed.join("`, `");
        cell.stopped =
            Some(Stop::Differs(format!("the function's tests fail on this path: `{tests}`")));
    }
    cell.reference = Some(reference);
}

/// Checks if a verdict is about the current files.
fn is_current(record: &Record) -> bool {
    let same = |read: &FileRead| FileRead::now(&read.file) == *read;
    record.overlay.is_none() && !record.read.is_empty() && record.read.iter().all(same)
}

fn is_of(record: &Record, row: &Row, file: Option<&PathBuf>) -> bool {
    let Subject::Function { function, .. } = &record.subject else { return false };
    let read: BTreeSet<Option<PathBuf>> =
        record.read.iter().map(|read| read.file.canonicalize().ok()).collect();
    *function == row.name && file.is_some_and(|file| read.contains(&Some(file.clone())))
}

fn whole(file: &str) -> Option<PathBuf> {
    PathBuf::from(file).canonicalize().ok()
}
