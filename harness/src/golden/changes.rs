//! The changed rows of pending values, for the person who accepts or rejects the values.

use std::collections::HashMap;
use std::ops::Range;

use super::table::{Table, TableError};
use super::{AcceptError, Goldens, Pending};
use crate::image::ImageError;
use crate::value::format_lane;

/// A row of values that differs from the row in the golden.
#[derive(Clone, Debug)]
pub struct ChangedRow {
    /// The row's index, from 0. The index of a removed row is its index in the golden.
    pub row: usize,
    /// The row's arguments, as text.
    pub arguments: Vec<String>,
    /// The golden's values, as text; empty if the row is new.
    pub golden: Vec<String>,
    /// The new values, as text; empty if the row was removed.
    pub actual: Vec<String>,
    /// The largest relative difference of a component: the difference divided by the golden's value; infinite for new
    /// and removed rows.
    pub relative: f64,
}

impl Pending {
    /// The rows that differ from the golden's rows, the largest differences first. Returns all rows if there is
    /// no golden.
    ///
    /// # Errors
    /// Returns an error if the pending file or the golden can't be read, or isn't a table.
    pub fn changed_rows(&self, goldens: &Goldens) -> Result<Vec<ChangedRow>, AcceptError> {
        let (actual, _) = Table::read(&self.path)?;
        let golden = match Table::read(&goldens.values(&self.case)) {
            Ok((golden, _)) => Some(golden),
            Err(TableError::File(ImageError::Missing { .. })) => None,
            Err(error) => return Err(error.into()),
        };
        Ok(actual.changed_rows(golden.as_ref()))
    }
}

impl Table {
    /// The rows that changed. New and removed rows come first, and then rows whose results differ, the largest
    /// differences first. Karat compares a row with the golden's row that has the same arguments. Returns all
    /// rows if there is no golden, or if the golden has other columns.
    #[must_use]
    pub fn changed_rows(&self, golden: Option<&Self>) -> Vec<ChangedRow> {
        let (given, all) = (self.arguments, self.columns.len());
        let row = |row: usize, old: Option<&[u32]>, new: Option<&[u32]>, relative: f64| {
            let cells = |row: Option<&[u32]>, columns: Range<usize>| -> Vec<String> {
                let words = row.into_iter().flat_map(|row| &row[columns.clone()]);
                let cells = self.columns[columns.clone()].iter().zip(words);
                cells.map(|(column, word)| format_lane(column.scalar, *word)).collect()
            };
            let arguments = cells(new.or(old), 0..given);
            let (golden, actual) = (cells(old, given..all), cells(new, given..all));
            ChangedRow { row, arguments, golden, actual, relative }
        };
        // Rows with other columns can't be compared.
        let golden = golden.filter(|golden| golden.columns == self.columns);
        let old_rows: Vec<&[u32]> = golden.iter().flat_map(|golden| golden.rows()).collect();
        let mut by_arguments: HashMap<&[u32], Vec<usize>> = HashMap::new();
        for (at, old) in old_rows.iter().enumerate().rev() {
            by_arguments.entry(&old[..given]).or_default().push(at);
        }
        let mut changed = Vec::new();
        let mut gone = vec![true; old_rows.len()];
        for (at, new) in self.rows().enumerate() {
            // The golden's first unpaired row with the same arguments.
            let old = by_arguments.get_mut(&new[..given]).and_then(Vec::pop);
            match old.map(|old| (old, old_rows[old])) {
                None => changed.push(row(at, None, Some(new), f64::INFINITY)),
                Some((place, old)) => {
                    gone[place] = false;
                    if old != new {
                        changed.push(row(at, Some(old), Some(new), relative(self, old, new)));
                    }
                }
            }
        }
        for (at, old) in old_rows.iter().enumerate().filter(|(at, _)| gone[*at]) {
            changed.push(row(at, Some(*old), None, f64::INFINITY));
        }
        changed.sort_by(|a, b| b.relative.total_cmp(&a.relative));
        changed
    }
}

/// The largest relative difference between two rows: a component's difference divided by the golden's value.
fn relative(table: &Table, old: &[u32], new: &[u32]) -> f64 {
    let cells = table.columns.iter().zip(old.iter().zip(new)).skip(table.arguments);
    let differences = cells.map(|(column, (old, new))| {
        let (old, new) = (column.scalar.decode(*old), column.scalar.decode(*new));
        let difference = (new - old).abs();
        if difference == 0.0 { 0.0 } else { difference / old.abs() }
    });
    differences.fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::golden::Column;
    use crate::value::Scalar;

    fn table(names: &[&str], rows: &[[f32; 2]]) -> Table {
        let column = |name: &&str| Column { name: (*name).to_owned(), scalar: Scalar::F32 };
        let columns: Vec<Column> = names.iter().map(column).collect();
        let words = rows.iter().flatten().map(|value| value.to_bits()).collect();
        Table { columns, arguments: 1, words }
    }

    fn shown(now: &Table, before: Option<&Table>) -> Vec<String> {
        let row = |row: ChangedRow| {
            let ChangedRow { row, arguments, golden, actual, .. } = row;
            format!("{row}: {} {}->{}", arguments.join(","), golden.join(","), actual.join(","))
        };
        now.changed_rows(before).into_iter().map(row).collect()
    }

    #[test]
    fn rows_are_paired_by_their_arguments() {
        let names = ["x", "result"];
        let before = table(&names, &[[0.0, 1.0], [0.5, 2.0], [0.5, 2.0], [1.0, 4.0]]);
        assert!(shown(&before, Some(&before)).is_empty());
        let moved = table(&names, &[[1.0, 4.0], [0.5, 2.0], [0.5, 2.0], [0.0, 1.0]]);
        assert!(shown(&moved, Some(&before)).is_empty(), "an order is no difference");
        let now = table(&names, &[[0.0, 1.5], [0.5, 2.0], [2.0, 8.0]]);
        assert_eq!(
            shown(&now, Some(&before)),
            ["2: 2 ->8", "2: 0.5 2->", "3: 1 4->", "0: 0 1->1.5"]
        );
        // Tables with other columns can't be compared.
        let other = table(&["y", "result"], &[[0.0, 1.0]]);
        assert_eq!(shown(&other, Some(&before)), ["0: 0 ->1"]);
        assert_eq!(shown(&other, None), ["0: 0 ->1"]);
    }
}
