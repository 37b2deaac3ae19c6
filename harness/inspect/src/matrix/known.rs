//! Declarations that rows don't work, and findings that no declaration covers.

use std::fmt;

use karat::path::{Path, Selector};
use karat::unstable::path::adapter;
use karat::unstable::path::{expect_sound, selects};
use karat_core::diagnostic::nearest;
use serde::Serialize;

use super::{Cell, Column, Matrix, MatrixError, Row, Status, Stop};

/// A declaration that a row doesn't reach a status on some columns. If the row reaches the status, the declaration is
/// outdated.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Known {
    /// The row's name: `module::name`.
    pub row: String,
    /// A column (`vulkan:hlsl`, `msl`), or a selector of paths (`:hlsl`, `@swiftshader`).
    pub column: String,
    /// The status that the row doesn't reach.
    pub status: Status,
    /// The reason for the declaration.
    pub reason: String,
}

impl Known {
    /// Refuses a declaration without a reason, or for an unknown row or column. `rows` are all rows of the package.
    pub(super) fn expect_sound<'r>(
        &self,
        mut rows: impl Iterator<Item = &'r str> + Clone,
    ) -> Result<(), MatrixError> {
        let wrong = |why: String| {
            let (row, column) = (self.row.clone(), self.column.clone());
            MatrixError::Known { row, column, why }
        };
        if self.reason.trim().is_empty() {
            return Err(wrong("the declaration needs a `reason`".to_owned()));
        }
        if rows.clone().all(|row| row != self.row) {
            let near = nearest(&self.row, &mut rows);
            let near = near.map_or_else(String::new, |row| format!("; did you mean `{row}`?"));
            return Err(wrong(format!("the package has no row with this name{near}")));
        }
        match self.column.parse::<Column>() {
            Ok(_) => {}
            Err(_) => {
                let selector = Selector::from(&*self.column);
                expect_sound(&selector).map_err(|error| wrong(error.to_string()))?;
            }
        }
        Ok(())
    }

    fn is_of(&self, column: Column) -> bool {
        if self.column == column.to_string() {
            return true;
        }
        let Some(path) = column.path() else { return false };
        // In a declaration, the column `vulkan` is only the direct route. As a selector, `vulkan` would mean all
        // routes.
        let other_route = self.column.parse::<Path>().is_ok_and(|named| named.via() != path.via());
        let selector = Selector::from(&*self.column);
        !other_route && adapter(path).is_ok_and(|adapter| selects(&selector, path, &adapter))
    }
}

/// Adds the declarations to the cells that they concern. Returns the declarations that can't be checked here, because
/// the column isn't in the matrix, the row has no verdict, or a validator or a driver is missing.
pub(super) fn declare(known: &[Known], columns: &[Column], rows: &mut [Row]) -> Vec<Known> {
    let here = |known: &&Known| {
        let absent = !columns.iter().any(|column| known.is_of(*column));
        absent && rows.iter().any(|row| row.name == known.row)
    };
    let mut undecided: Vec<Known> = known.iter().filter(here).cloned().collect();
    for row in &*rows {
        let unjudged = |known: &&Known| known.row == row.name && row.cells.is_empty();
        undecided.extend(known.iter().filter(unjudged).cloned());
    }
    for row in rows {
        for (column, cell) in columns.iter().zip(&mut row.cells) {
            let of = |known: &&Known| known.row == row.name && known.is_of(*column);
            // If a cell has several declarations, the one with the lowest status counts.
            cell.known = known.iter().filter(of).min_by_key(|known| known.status).cloned();
            undecided.extend(cell.known.clone().filter(|_| cell.is_undecided()));
        }
    }
    undecided
}

impl Cell {
    /// The first status that the cell doesn't reach; `None` if the cell reaches all statuses.
    fn misses(&self) -> Option<Status> {
        Status::ALL.into_iter().find(|status| Some(*status) > self.status)
    }

    /// The declaration that explains why the cell fails; `None` if the cell fails at another status than the declared
    /// one, or if no fault was observed.
    #[must_use]
    pub fn fails_as_declared(&self) -> Option<&Known> {
        let seen = matches!(
            self.stopped,
            Some(
                Stop::Rejected(_)
                    | Stop::Differs(_)
                    | Stop::Unsupported(_)
                    | Stop::Unable(_)
                    | Stop::Panicked(_)
                    | Stop::NotRun(_)
            )
        );
        self.known.as_ref().filter(|known| seen && self.misses() == Some(known.status))
    }

    /// Checks if the cell's declaration can't be checked here.
    fn is_undecided(&self) -> bool {
        let wrong = self.stopped.as_ref().is_some_and(Stop::is_wrong);
        !wrong && self.fails_as_declared().is_none() && !self.contradicts()
    }

    /// Checks if the cell fails as declared, so that it doesn't reach this status.
    pub(super) fn is_known_to_miss(&self, status: Status) -> bool {
        self.fails_as_declared().is_some_and(|known| known.status <= status)
    }

    /// Checks if the cell reaches a status, although its declaration excludes this status.
    pub(super) fn contradicts(&self) -> bool {
        self.known.as_ref().is_some_and(|known| self.status >= Some(known.status))
    }
}

/// A row that fails on a column, or an outdated declaration.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// The row's name.
    pub row: String,
    /// The column's name.
    pub column: String,
    /// The problem, as a sentence.
    pub why: String,
    /// `true` for an outdated declaration, whose row reaches the status.
    pub outdated: bool,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}` on `{}`: {}", self.row, self.column, self.why)
    }
}

impl Matrix {
    /// The findings: rows on which naga panics, rows that a validator rejects or doesn't judge, rows whose results
    /// differ, and outdated declarations. Declared failures aren't findings.
    #[must_use]
    pub fn findings(&self) -> Vec<Finding> {
        let mut findings = Vec::new();
        for row in &self.rows {
            for (head, cell) in self.columns.iter().zip(&row.cells) {
                let why = match (&cell.known, &cell.stopped) {
                    (Some(known), Some(stop)) if cell.contradicts() && stop.is_wrong() => format!(
                        "the row reaches `{}`, which a declaration excludes, and fails at a later step: {}",
                        known.status,
                        stop.text()
                    ),
                    (Some(known), _) if cell.contradicts() => {
                        format!(
                            "the row reaches `{}`, although a declaration excludes this status",
                            known.status
                        )
                    }
                    _ if cell.fails_as_declared().is_some() => continue,
                    (Some(known), Some(stop)) if stop.is_wrong() => format!(
                        "the row fails at an earlier step than `{}`, the step in its declaration: {}",
                        known.status,
                        stop.text()
                    ),
                    (None, Some(stop)) if stop.is_wrong() => stop.text().to_owned(),
                    _ => continue,
                };
                let (row, column) = (row.name.clone(), head.name.clone());
                let wrong = cell.stopped.as_ref().is_some_and(Stop::is_wrong);
                findings.push(Finding { row, column, why, outdated: cell.contradicts() && !wrong });
            }
        }
        findings
    }

    /// Checks that there are no findings.
    ///
    /// # Panics
    /// Panics if there is a [finding](Self::findings), if the matrix has no row, or if no cell has been judged.
    #[track_caller]
    pub fn expect_no_findings(&self) {
        self.try_expect_evidence().unwrap_or_else(|missed| panic!("{missed}"));
        let findings: Vec<String> = self.findings().iter().map(ToString::to_string).collect();
        assert!(findings.is_empty(), "{} findings:\n{}", findings.len(), findings.join("\n"));
    }
}
