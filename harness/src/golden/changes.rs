//! What changed in values that wait, row by row, for whoever accepts or rejects them.

use super::table::{Table, TableError};
use super::{AcceptError, Goldens, Pending};
use crate::image::ImageError;
use crate::value::format_lane;

/// A row of values that isn't its golden's.
///
/// ```no_run
/// # let goldens = karat::Goldens::open("golden".as_ref());
/// # let pending = goldens.select("noise")?.frames.remove(0);
/// for changed in pending.changed_rows(&goldens)? {
///     println!("row {}: {:?} was {:?}", changed.row, changed.actual, changed.golden);
/// }
/// # Ok::<(), karat::golden::AcceptError>(())
/// ```
#[derive(Clone, Debug)]
pub struct ChangedRow {
    /// The row, from 0.
    pub row: usize,
    /// Its arguments, as text.
    pub arguments: Vec<String>,
    /// The golden's values, as text; empty if the golden has no such row.
    pub golden: Vec<String>,
    /// The new values, as text; empty if they have no such row.
    pub actual: Vec<String>,
    /// The largest difference of a component, relative to the golden's value.
    pub relative: f64,
}

impl Pending {
    /// The rows that differ from the golden's, the largest differences first; all rows if there is no
    /// golden.
    ///
    /// ```no_run
    /// use karat::Goldens;
    ///
    /// let goldens = Goldens::open("golden".as_ref());
    /// for pending in goldens.pending().frames.iter().filter(|pending| pending.is_table()) {
    ///     println!("{}: {} rows changed", pending.case, pending.changed_rows(&goldens)?.len());
    /// }
    /// # Ok::<(), karat::golden::AcceptError>(())
    /// ```
    ///
    /// # Errors
    /// If one of the files can't be read, or holds no table.
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
    /// The rows that differ from those of a golden, the largest differences first; all rows if there is
    /// no golden.
    ///
    /// ```no_run
    /// use karat::golden::Table;
    ///
    /// let [(before, _), (now, _)] = [Table::read("before.csv".as_ref())?, Table::read("now.csv".as_ref())?];
    /// for changed in now.changed_rows(Some(&before)) {
    ///     println!("row {}: {:?} was {:?}", changed.row, changed.actual, changed.golden);
    /// }
    /// # Ok::<(), karat::golden::TableError>(())
    /// ```
    #[must_use]
    pub fn changed_rows(&self, golden: Option<&Self>) -> Vec<ChangedRow> {
        let text = |table: &Table, columns: std::ops::Range<usize>, row: &[u32]| {
            let cells = table.columns[columns.clone()].iter().zip(&row[columns]);
            let shown = cells.map(|(column, word)| format_lane(column.scalar, *word));
            shown.collect::<Vec<String>>()
        };
        let results = |table: &Table, row: Option<&[u32]>| {
            let columns = table.arguments..table.columns.len();
            row.map_or_else(Vec::new, |row| text(table, columns, row))
        };
        let old_rows: Vec<&[u32]> = golden.iter().flat_map(|golden| golden.rows()).collect();
        let new_rows: Vec<&[u32]> = self.rows().collect();
        let mut changed = Vec::new();
        for row in 0..old_rows.len().max(new_rows.len()) {
            let (old, new) = (old_rows.get(row).copied(), new_rows.get(row).copied());
            let same = golden.is_some_and(|golden| golden.columns == self.columns);
            if same && old == new {
                continue;
            }
            let relative = match (old, new) {
                (Some(old), Some(new))
                    if same && old[..self.arguments] == new[..self.arguments] =>
                {
                    relative(self, old, new)
                }
                _ => f64::INFINITY,
            };
            let arguments = match (new, old, golden) {
                (Some(new), ..) => text(self, 0..self.arguments, new),
                (None, Some(old), Some(golden)) => text(golden, 0..golden.arguments, old),
                _ => Vec::new(),
            };
            let golden = golden.map_or_else(Vec::new, |golden| results(golden, old));
            let actual = results(self, new);
            changed.push(ChangedRow { row, arguments, golden, actual, relative });
        }
        changed.sort_by(|a, b| b.relative.total_cmp(&a.relative));
        changed
    }
}

/// The largest difference of a result's component, relative to the golden's.
fn relative(table: &Table, old: &[u32], new: &[u32]) -> f64 {
    let cells = table.columns.iter().zip(old.iter().zip(new)).skip(table.arguments);
    let differences = cells.map(|(column, (old, new))| {
        let (old, new) = (column.scalar.decode(*old), column.scalar.decode(*new));
        let difference = (new - old).abs();
        if difference == 0.0 { 0.0 } else { difference / old.abs() }
    });
    differences.fold(0.0, f64::max)
}
