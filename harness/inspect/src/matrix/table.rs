//! A matrix as a table of rows, and expectations about the rows.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use karat::package::{Package, PackageError};
use karat::path::PathError;
use karat::unstable::package::{FunctionItem, KnownRows, known_rows};
use karat::unstable::reflect::Program;
use karat_core::diagnostic::nearest;
use karat_core::settings::{self, SettingsError};
use karat_translate::{NAGA_VERSION, Tool};
use serde::Serialize;

use super::journal::Journal;
use super::judge::Judged;
use super::known::{Known, declare};
use super::subject::{Ready, Subject, prepare};
use super::{Cell, Column, Request, Row, Source, Status, row};

use rayon::prelude::*;

/// A table with a row for each function and entry point, and a column for each path or language.
#[derive(Clone, Debug, Serialize)]
pub struct Matrix {
    /// The package's name.
    pub package: String,
    /// The version of naga that wrote the translations. Other versions write other translations.
    pub naga: String,
    /// The validators, with their versions.
    pub validators: BTreeMap<String, String>,
    /// The number of inputs of each function.
    pub cases: usize,
    /// The columns, with their adapters.
    pub columns: Vec<Head>,
    /// The rows, in the order of modules and lines.
    pub rows: Vec<Row>,
    /// The declarations that can't be checked here, because the column isn't in the matrix, the row has no verdict, or
    /// a validator or a driver is missing.
    pub undecided: Vec<Known>,
}

/// The description of a column.
#[derive(Clone, Debug, Serialize)]
pub struct Head {
    /// The column's name.
    pub name: String,
    /// The language of the column's translations.
    pub language: String,
    /// The adapter and the driver that run the column.
    pub adapter: Option<String>,
    /// The reason why no path runs the column.
    pub unavailable: Option<String>,
}

/// The reason why there is no matrix.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MatrixError {
    /// The package can't be read.
    #[error(transparent)]
    Package(#[from] PackageError),
    /// An environment variable has an invalid setting.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The package has no function and no entry point, or none with the requested names.
    #[error("package `{package}` has no function and no entry point{}", match only.as_slice() {
        [] => String::new(),
        names => format!(" whose name contains `{}`", names.join("` or `")),
    })]
    Nothing {
        /// The package's name.
        package: String,
        /// The requested parts of names.
        only: Vec<String>,
    },
    /// The request has no column, or no case.
    #[error("a matrix needs at least one column and one case")]
    Empty,
    /// The requested cases don't fit into memory.
    #[error("a matrix can have at most {most} cases for each function, not {cases}")]
    TooMany {
        /// The requested number of cases.
        cases: usize,
        /// The largest allowed number of cases.
        most: usize,
    },
    /// The journal file, which records the row that ran when a process ended, can't be read.
    #[error("can't read `{file}`, in which Karat notes each row before the row runs: {why}")]
    Journal {
        /// The file's path.
        file: String,
        /// The reason.
        why: String,
    },
    /// A declared failure of a row can't be used, for example because the row doesn't exist.
    #[error("the declared failure of row `{row}` on `{column}` can't be used: {why}")]
    Known {
        /// The row's name.
        row: String,
        /// The column's name.
        column: String,
        /// The problem.
        why: String,
    },
    /// No row uses the override, or the value doesn't fit its type.
    #[error("an override: {0}")]
    Override(String),
    /// The request has the same column twice.
    #[error("the column `{0}` is named twice")]
    Repeated(String),
}

/// The largest number of cases for a function. Karat holds all cases of a column in memory. `karat call` has the same
/// limit.
const MOST_CASES: usize = 1 << 22;

/// The number of rows that are translated, validated and run together. A validator checks several rows in one process,
/// but the texts must fit into memory.
const TOGETHER: usize = 64;

pub(super) fn make(
    request: &Request,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Matrix, MatrixError> {
    settings::current()?;
    if request.columns.is_empty() || request.cases == 0 {
        return Err(MatrixError::Empty);
    }
    if request.cases > MOST_CASES {
        return Err(MatrixError::TooMany { cases: request.cases, most: MOST_CASES });
    }
    for (index, column) in request.columns.iter().enumerate() {
        if request.columns[..index].contains(column) {
            return Err(MatrixError::Repeated(column.to_string()));
        }
    }
    let (mut items, mut unread) = items(&request.package)?;
    let known = known(request)?;
    for known in &known {
        known.expect_sound(items.iter().map(|item| &*item.name))?;
    }
    let wanted =
        |name: &str| request.only.is_empty() || request.only.iter().any(|part| name.contains(part));
    items.retain(|item| wanted(&item.name));
    unread.retain(|row| wanted(&row.name));
    let package = request.package.name();
    if items.is_empty() && unread.is_empty() {
        return Err(MatrixError::Nothing { package, only: request.only.clone() });
    }
    if let Some((_, wrong)) = Program::unfit(&[&request.package], &request.overrides) {
        return Err(MatrixError::Override(wrong));
    }
    let journal = Journal::read(request.journal.as_deref(), &package).map_err(|error| {
        let file = request.journal.as_ref().map_or_else(String::new, |f| f.display().to_string());
        MatrixError::Journal { file, why: error.to_string() }
    })?;
    let all = items.len();
    let order: BTreeMap<String, usize> =
        items.iter().enumerate().map(|(index, item)| (item.name.clone(), index)).collect();
    // Suspected rows run first, each without other rows. If a row ends the process again, only this row is suspected.
    let suspected: Vec<FunctionItem> =
        items.extract_if(.., |item| journal.is_suspected(&item.name)).collect();
    // Opens the devices one after the other, before the rows need them.
    let columns = request.columns.iter().map(head).collect();
    let done = Mutex::new(0);
    let together = suspected.chunks(1).chain(items.chunks(TOGETHER));
    let rows = together.flat_map(|items| {
        let subjects: Vec<Subject> = items.par_iter().map(|item| prepare(request, item)).collect();
        let ready: Vec<&Ready> = subjects.iter().filter_map(Subject::ready).collect();
        let judged = Judged::of(&ready, &request.columns, &request.package);
        let mut rows = 0_usize..;
        let mut of = |ready: &Ready| {
            let row = rows.next().expect("the iterator has no end");
            request.columns.iter().map(|c| judged.cell(row, ready, *c)).collect()
        };
        let cells: Vec<Option<Vec<Cell>>> =
            subjects.iter().map(|subject| subject.ready().map(&mut of)).collect();
        let one = |(subject, cells): (Subject, Option<Vec<Cell>>)| {
            let row = match (subject, cells) {
                (Subject::Ready(ready), Some(mut cells)) => {
                    let name = ready.row.name.clone();
                    match journal.ends(&name, &request.columns, &mut cells) {
                        true => ready.row(cells),
                        false => journal.watched(&name, || row::run(request, *ready, cells)),
                    }
                }
                (Subject::Ready(ready), None) => ready.row(Vec::new()),
                (Subject::Row(row), _) => *row,
            };
            // The lock stays until the report, so that the counts are reported in order.
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            *done += 1;
            progress(*done, all);
            row
        };
        subjects.into_par_iter().zip(cells).map(one).collect::<Vec<Row>>()
    });
    let mut rows: Vec<Row> = rows.collect();
    rows.sort_by_key(|row| order.get(&row.name));
    rows.extend(unread);
    let undecided = declare(&known, &request.columns, &mut rows);
    let here = Tool::all().iter().filter_map(|tool| tool.as_ref().ok());
    let validators = here.map(|tool| (tool.name().to_owned(), tool.version().to_owned())).collect();
    let (naga, cases) = (NAGA_VERSION.to_owned(), request.cases);
    Ok(Matrix { package, naga, validators, cases, columns, rows, undecided })
}

/// The functions and entry points of a package, and a row for each module that can't be read.
fn items(package: &Package) -> Result<(Vec<FunctionItem>, Vec<Row>), PackageError> {
    let (mut items, mut unread) = (Vec::new(), Vec::new());
    for module in package.modules()? {
        match package.functions_in(&module) {
            Ok(functions) => items.extend(functions),
            Err(error) => unread.push(Row::of_module(&module, error.to_string())),
        }
    }
    Ok((items, unread))
}

/// The declarations in the request and in `karat.toml`.
fn known(request: &Request) -> Result<Vec<Known>, MatrixError> {
    let mut all = request.known.clone();
    for written in known_rows(&request.package)? {
        let KnownRows { rows, columns, status, reason } = written;
        for row in &rows {
            for column in &columns {
                let (row, column, reason) = (row.clone(), column.clone(), reason.clone());
                let status = status.parse().map_err(|why| {
                    let (row, column) = (row.clone(), column.clone());
                    MatrixError::Known { row, column, why }
                })?;
                all.push(Known { row, column, status, reason });
            }
        }
    }
    Ok(all)
}

fn head(column: &Column) -> Head {
    let opened = column.path().map(karat::unstable::path::adapter);
    let (adapter, unavailable) = match opened {
        None => (None, Some(column.without_path())),
        Some(Ok(adapter)) => (Some(format!("{}, {}", adapter.name, adapter.driver)), None),
        Some(Err(error @ PathError::Unavailable { .. })) => (None, Some(error.to_string())),
        Some(Err(error)) => (None, Some(error.to_string())),
    };
    let (name, language) = (column.to_string(), column.language().to_owned());
    Head { name, language, adapter, unavailable }
}

/// An expectation that a matrix doesn't meet.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Missed {
    /// The matrix has no column with this name.
    #[error("the matrix has no column `{name}`{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    NoColumn {
        /// The requested name.
        name: String,
        /// The column with the most similar name.
        nearest: Option<String>,
    },
    /// The matrix has no entry point, and no function that a kernel can call.
    #[error(
        "the matrix has no row to judge: the package has no entry point, and no function that Karat can call"
    )]
    NoRow,
    /// All rows were only translated, and neither validated nor run.
    #[error(
        "none of the {rows} rows was judged: no validator of the matrix's languages is installed, and no path ran \
             the rows; `karat doctor` lists what is missing and how to get it"
    )]
    NothingJudged {
        /// The number of rows.
        rows: usize,
    },
    /// Rows don't reach the expected status.
    #[error("{} of {of} rows don't reach `{status}` on `{column}`:\n{}", rows.len(), list(rows))]
    Rows {
        /// The column.
        column: String,
        /// The expected status.
        status: Status,
        /// The rows, each with its reason.
        rows: Vec<(String, String)>,
        /// The number of rows, without functions that no kernel can call.
        of: usize,
    },
    /// Rows reach a status, although their declarations exclude this status.
    #[error("on `{column}` these rows reach `{status}`, although declarations exclude this status; delete \
             their declarations: {}", rows.join(", "))]
    Passing {
        /// The column.
        column: String,
        /// The status that the rows reach.
        status: Status,
        /// The rows.
        rows: Vec<String>,
    },
    /// A declaration has the name of a row that the matrix doesn't have.
    #[error("a declaration names the row `{name}`, which isn't in the matrix")]
    NoSuchRow {
        /// The row.
        name: String,
    },
}

fn list(rows: &[(String, String)]) -> String {
    let lines: Vec<String> = rows.iter().map(|(name, why)| format!("  {name}: {why}")).collect();
    lines.join("\n")
}

impl Matrix {
    /// Checks that the matrix has a row, and a cell that a validator or another column has judged.
    ///
    /// # Errors
    /// Returns an error if the matrix has no row, or if no cell has been judged.
    pub fn try_expect_evidence(&self) -> Result<(), Missed> {
        let rows = self.rows.iter().filter(|row| row.is_judged()).count();
        let judged = |cell: &Cell| {
            cell.status > Some(Status::Translated)
                || cell.stopped.as_ref().is_some_and(|stop| {
                    stop.is_wrong() || matches!(stop, super::Stop::Unsupported(_))
                })
        };
        match self.rows.iter().flat_map(|row| &row.cells).any(judged) {
            _ if rows == 0 => Err(Missed::NoRow),
            true => Ok(()),
            // The error of an unreadable module is reported separately.
            false if self.rows.iter().any(|row| row.is_judged() && row.error.is_some()) => Ok(()),
            false => Err(Missed::NothingJudged { rows }),
        }
    }

    /// Checks that every row has at least this status in a column. Functions that no kernel can call don't count.
    ///
    /// # Panics
    /// Panics if a row doesn't reach the status, if the column doesn't exist, or if the matrix has no row.
    #[track_caller]
    pub fn expect(&self, column: &str, status: Status) {
        self.expect_but(column, status, &[]);
    }

    /// Does the same as [`expect`](Self::expect), except for the rows in `known`, each with a reason. If a declared row
    /// reaches the status, its declaration is outdated, and the check fails.
    ///
    /// # Panics
    /// Panics in the same cases as [`expect`](Self::expect), and also if a declared row reaches the status.
    #[track_caller]
    pub fn expect_but(&self, column: &str, status: Status, known: &[(&str, &str)]) {
        self.try_expect_but(column, status, known).unwrap_or_else(|missed| panic!("{missed}"));
    }

    /// Does the same as [`expect_but`](Self::expect_but), but returns an error and doesn't panic.
    ///
    /// # Errors
    /// Returns an error if an undeclared row doesn't reach the status, if a declared row reaches the status, if the
    /// column doesn't exist, or if the matrix has no row.
    pub fn try_expect_but(
        &self,
        column: &str,
        status: Status,
        known: &[(&str, &str)],
    ) -> Result<(), Missed> {
        let names = || self.columns.iter().map(|head| head.name.as_str());
        let index = names().position(|name| name == column).ok_or_else(|| Missed::NoColumn {
            name: column.to_owned(),
            nearest: nearest(column, names()).map(str::to_owned),
        })?;
        if let Some((name, _)) = known.iter().find(|(k, _)| self.rows.iter().all(|r| r.name != *k))
        {
            return Err(Missed::NoSuchRow { name: (*name).to_owned() });
        }
        let judged: Vec<&Row> = self.rows.iter().filter(|row| row.is_judged()).collect();
        if judged.is_empty() {
            return Err(Missed::NoRow);
        }
        let (mut missing, mut passing) = (Vec::new(), Vec::new());
        for row in &judged {
            let cell = row.cells.get(index);
            let reached = cell.and_then(|cell| cell.status) >= Some(status);
            if !reached && cell.is_some_and(|cell| cell.is_known_to_miss(status)) {
                continue;
            }
            let declared = known.iter().any(|(name, _)| *name == row.name);
            match (reached, declared) {
                (false, false) => missing.push((row.name.clone(), row.why(index))),
                (true, true) => passing.push(row.name.clone()),
                (true, false) | (false, true) => {}
            }
        }
        let column = column.to_owned();
        if !missing.is_empty() {
            return Err(Missed::Rows { column, status, rows: missing, of: judged.len() });
        }
        if !passing.is_empty() {
            return Err(Missed::Passing { column, status, rows: passing });
        }
        Ok(())
    }
}

impl Row {
    fn of_module(module: &str, error: String) -> Self {
        let source = Source { file: String::new(), line: 1, text: String::new() };
        Self {
            name: module.to_owned(),
            kind: "module".to_owned(),
            location: String::new(),
            source,
            text: "".into(),
            buffers: Vec::new(),
            error: Some(error),
            cells: Vec::new(),
        }
    }

    /// Checks if the row counts in expectations. A function that no kernel can call doesn't count.
    #[must_use]
    pub fn is_judged(&self) -> bool {
        self.kind != "not callable"
    }

    /// The reason why the row gets no further on a column.
    #[must_use]
    pub fn why(&self, column: usize) -> String {
        let stopped = self.cells.get(column).and_then(|cell| cell.stopped.as_ref());
        let text = stopped.map(super::Stop::text).or(self.error.as_deref());
        text.unwrap_or("Karat doesn't know the reason").to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_row_is_reported_once_and_in_order() {
        let functions = |at: usize| format!("fn f{at}(x: f32) -> f32 {{ return x * {at}.0; }}\n");
        // The package has more rows than run together.
        let text: String = (0..TOGETHER + 3).map(functions).collect();
        let package = Package::from_modules("m", [("a", text), ("b", "fn broken(".to_owned())]);
        let told = Mutex::new(Vec::new());
        let request = crate::matrix(&package).columns(["cpu".parse().expect("a column")]).cases(4);
        let made = request.run_with(&|done, of| told.lock().expect("whole").push((done, of)));
        // A module that can't be read is a row, but it has no work.
        assert_eq!(made.expect("made").rows.len(), TOGETHER + 4);
        let all = TOGETHER + 3;
        assert_eq!(
            told.into_inner().expect("whole"),
            (1..=all).map(|done| (done, all)).collect::<Vec<_>>()
        );
    }
}
