//! Checks naga's translations of a package's functions and entry points, on every route.
//!
//! A *row* of the matrix is a function or an entry point. A *column* is a path, or a language for which Karat has no
//! path. A *cell* is the result of a row in a column. The cell's status is the last step that succeeded: naga
//! translates the row ([`Status::Translated`]), every installed validator of the language accepts the translation
//! ([`Status::Valid`]), the row runs on sampled inputs ([`Status::Executed`]), and its results equal those of another
//! column ([`Status::Agrees`]). If a step fails, [`Stop`] has the reason, with the message of naga or of the tool. A
//! row is valid only if a validator accepts it, and executed only if a driver ran it.

mod allowed;
mod column;
mod compute;
mod divergence;
mod excerpt;
mod execute;
mod journal;
mod judge;
mod known;
mod leeway;
mod markdown;
mod reduce;
mod reference;
mod row;
mod subject;
mod suspect;
mod table;

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use karat::package::Package;
use karat::unstable::probe::{ProbeError, Probed};
use karat::unstable::reflect::Program;
use karat_core::tolerance::{Abs, Rel, Tolerance};
use serde::Serialize;

use crate::made_up;

pub use allowed::Allowed;
pub use column::Column;
pub use divergence::{Divergence, Intermediate};
pub use journal::restarted;
pub use judge::{Outcome, Said};
pub use karat_translate::Code;
pub use known::{Finding, Known};
pub use reference::Reference;
pub use table::{Head, Matrix, MatrixError, Missed};

/// The last step that a row reached on a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// naga translates the row into the column's language.
    Translated,
    /// At least one validator of the language is installed, and all installed ones accept naga's output.
    Valid,
    /// The row ran on all inputs and wrote all results.
    Executed,
    /// The row's results equal those of another column.
    Agrees,
}

impl Status {
    /// All statuses, in ascending order.
    pub const ALL: [Self; 4] = [Self::Translated, Self::Valid, Self::Executed, Self::Agrees];

    /// The status's name in tables and on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Translated => "translated",
            Self::Valid => "valid",
            Self::Executed => "executed",
            Self::Agrees => "agrees",
        }
    }
}

impl std::str::FromStr for Status {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let known = Self::ALL.into_iter().find(|status| status.name() == name);
        let names = Self::ALL.map(Self::name).join(", ");
        known.ok_or_else(|| format!("`{name}` isn't a status; the statuses are {names}"))
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// The reason why a row gets no further on a column.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "why", content = "says")]
pub enum Stop {
    /// naga can't translate the row. Holds naga's message.
    Unsupported(String),
    /// naga panics while translating the row. Holds the panic's message.
    Panicked(String),
    /// A validator rejects the translation. Holds the validator's name and message.
    Rejected(String),
    /// A validator or a driver gives no verdict, because it crashed, took too long or didn't start.
    Broke(String),
    /// The installed validators don't support a part of the language. Holds this part and the validators' messages.
    Unable(String),
    /// No validator of the language is installed.
    NoValidator(String),
    /// The column's path isn't available on this machine, or no path runs its language.
    Unavailable(String),
    /// The row can't run here, or failed while running.
    NotRun(String),
    /// The row's results differ from another column's.
    Differs(String),
    /// No other column ran the row, or no case has a finite result.
    NothingToCompare(String),
}

impl Stop {
    /// The reason as text.
    #[must_use]
    pub fn text(&self) -> &str {
        match self {
            Self::Unsupported(text)
            | Self::Panicked(text)
            | Self::Rejected(text)
            | Self::Broke(text)
            | Self::Unable(text)
            | Self::NoValidator(text)
            | Self::Unavailable(text)
            | Self::NotRun(text)
            | Self::Differs(text)
            | Self::NothingToCompare(text) => text,
        }
    }

    /// Checks if the translation, the path that runs it, or a validator has a fault. All other reasons mean that
    /// something isn't available or possible here.
    #[must_use]
    pub fn is_wrong(&self) -> bool {
        use Stop::{Broke, Differs, Panicked, Rejected};
        matches!(self, Differs(_) | Rejected(_) | Broke(_) | Panicked(_))
    }
}

/// The result of a row in one column.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Cell {
    /// The cell's status; `None` if the translation failed.
    pub status: Option<Status>,
    /// The reason why the row got no further; `None` if it reached the last status.
    pub stopped: Option<Stop>,
    /// A description of naga's options.
    pub options: String,
    /// The validators' verdicts.
    pub validators: Vec<Said>,
    /// The column with which this cell was compared.
    pub against: Option<String>,
    /// The number of cases that were compared with another column. For an entry point: the number of 32-bit words in
    /// its buffers.
    pub compared: usize,
    /// The number of cases whose results differ by more than the tolerance, although WGSL doesn't leave these results
    /// open. For an entry point: the number of words that differ in this way.
    pub differing: usize,
    /// The number of cases, or of an entry point's words, that differ where WGSL leaves the result open: after an index
    /// outside of an array, or with a float that isn't finite.
    pub open: usize,
    /// The largest distance between compared components, in steps of an `f32`.
    pub worst_ulp: Option<u64>,
    /// If the results differ: the simplest input, and the first value that differs.
    pub divergence: Option<Divergence>,
    /// The suspect: a column whose result differs, while at least two other columns agree with each other.
    pub suspect: Option<String>,
    /// The comparison of the results with WGSL's bounds; `None` if Karat's engine doesn't know the bounds.
    pub allowed: Option<Allowed>,
    /// The verdicts of the function's own tests on the column's path; see [`Matrix::judge_by`].
    pub reference: Option<Reference>,
    /// The declaration that the row doesn't work on this column.
    pub known: Option<Known>,
    /// The translation.
    #[serde(skip)]
    pub code: Option<Arc<Code>>,
    /// The first and the last line of the function or entry point in the translation, counted from 1.
    #[serde(skip)]
    pub text_lines: Option<(usize, usize)>,
}

impl Cell {
    /// The translation as text; `None` for SPIR-V.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        self.code.as_ref()?.text()
    }

    /// Checks if the results differ from those of the compared column.
    #[must_use]
    pub fn differs(&self) -> bool {
        matches!(self.stopped, Some(Stop::Differs(_)))
    }
}

/// The source text of a function or entry point, as its author wrote it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Source {
    /// The path of the author's file.
    pub file: String,
    /// The line of the text's first character, counted from 1.
    pub line: usize,
    /// The text of the function or entry point, with its attributes.
    pub text: String,
}

/// A buffer with which an entry point ran.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Buffer {
    /// The buffer's group.
    pub group: u32,
    /// The buffer's binding.
    pub binding: u32,
    /// The buffer's bytes before the run.
    pub bytes: Vec<u8>,
}

/// A row of the matrix: a function or an entry point, with a cell for each column.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// The name: `module::name`.
    pub name: String,
    /// `function`, `vertex`, `fragment` or `compute`. A row with an error has the kind `not callable` or `module`.
    pub kind: String,
    /// The position in the author's file.
    pub location: String,
    /// The row's source text, as its author wrote it.
    #[serde(skip)]
    pub source: Source,
    /// The text that is translated: the author's text with everything that it uses, and a kernel that calls the
    /// function.
    #[serde(skip)]
    pub text: Arc<str>,
    /// The buffers of an entry point before the run, if its results differ between columns.
    #[serde(skip)]
    pub buffers: Vec<Buffer>,
    /// The reason why the row has no cells: a kernel can't call the function, or the code is invalid.
    pub error: Option<String>,
    /// One cell for each column, in the order of the columns; empty if [`error`](Self::error) is set.
    pub cells: Vec<Cell>,
}

/// A request for a matrix.
///
/// ```
/// # use karat::Package;
/// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
/// let request = karat_inspect::matrix(&package).only(["half"]).columns(["cpu".parse()?]).cases(16);
/// let matrix = request.run()?;
/// assert_eq!((matrix.rows.len(), matrix.cases), (1, 16));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Request {
    package: Package,
    columns: Vec<Column>,
    cases: usize,
    within: Tolerance,
    only: Vec<String>,
    known: Vec<Known>,
    overrides: BTreeMap<String, f64>,
    journal: Option<PathBuf>,
}

/// The number of cases of each function. So many cases suffice to find differences between translations. To find the
/// largest error, more cases would be necessary.
const CASES: usize = 512;

/// The largest difference between two columns that counts as equal. WGSL allows an error of 2^-11 for sine and cosine,
/// so a smaller tolerance would report differences between drivers, not between translations.
const WITHIN: f64 = 1e-3;

/// Makes a request for the matrix of a package; see [`matrix`](self).
///
/// ```no_run
/// use karat::Package;
/// use karat_inspect::matrix::Status;
///
/// static SHADERS: Package = karat::package!("shaders");
///
/// let matrix = karat_inspect::matrix(&SHADERS).run().unwrap();
/// matrix.expect("vulkan:hlsl", Status::Valid);
/// ```
#[must_use]
pub fn matrix(package: &Package) -> Request {
    Request {
        package: package.clone(),
        columns: Column::usual(),
        cases: CASES,
        within: Rel(WITHIN).or(Abs(WITHIN)),
        only: Vec::new(),
        known: Vec::new(),
        overrides: BTreeMap::new(),
        journal: None,
    }
}

impl Request {
    /// Selects the columns.
    #[must_use]
    pub fn columns(self, columns: impl IntoIterator<Item = Column>) -> Self {
        Self { columns: columns.into_iter().collect(), ..self }
    }

    /// Sets the number of cases of each function.
    #[must_use]
    pub fn cases(self, cases: usize) -> Self {
        Self { cases, ..self }
    }

    /// Sets the largest difference between two columns that counts as equal.
    #[must_use]
    pub fn within(self, tolerance: impl Into<Tolerance>) -> Self {
        Self { within: tolerance.into(), ..self }
    }

    /// Selects the rows with one of these strings in their names.
    #[must_use]
    pub fn only<'n>(self, names: impl IntoIterator<Item = &'n str>) -> Self {
        Self { only: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    /// Sets the value of an `override`, by its name or its `@id`, in each row that uses it.
    #[must_use]
    pub fn with_override(mut self, name: &str, value: f64) -> Self {
        self.overrides.insert(name.to_owned(), value);
        self
    }

    fn overrides_of(&self, program: &Program) -> BTreeMap<String, f64> {
        let own = self.overrides.iter().filter(|(name, _)| program.has_override(name));
        own.map(|(name, value)| (name.clone(), *value)).collect()
    }

    fn probed(&self, name: &str) -> Result<Probed, ProbeError> {
        let own = match self.overrides.is_empty() {
            true => BTreeMap::new(),
            false => self.overrides_of(&*Program::of_function(&self.package, name)?),
        };
        Probed::with_overrides(&self.package, name, &own).and_then(made_up::fitted)
    }

    /// Declares that a row doesn't reach a status on a column, or on all paths of a selector (`:hlsl`, `@swiftshader`).
    /// If the row does reach the status, the matrix has a [finding](Matrix::findings). `[[matrix]]` in `karat.toml`
    /// declares the same.
    #[must_use]
    pub fn fails_on(mut self, column: &str, row: &str, status: Status, reason: &str) -> Self {
        let [row, column, reason] = [row, column, reason].map(str::to_owned);
        self.known.push(Known { row, column, status, reason });
        self
    }

    /// Records in a file which row runs on which path. After a driver hangs or crashes, only a new process can
    /// continue. The new process first runs each interrupted row alone. If such a row ends the process again, the next
    /// process skips it, and its cells give the reason. The function [`restarted`] starts these processes.
    #[must_use]
    pub fn journal(self, file: &Path) -> Self {
        Self { journal: Some(file.to_owned()), ..self }
    }

    /// Makes the matrix.
    ///
    /// # Errors
    /// Returns an error if the package can't be read or has no functions and entry points, if a setting is wrong, or if
    /// the file of [`journal`](Self::journal) can't be read.
    pub fn run(&self) -> Result<Matrix, MatrixError> {
        self.run_with(&|_, _| {})
    }

    /// Does the same as [`run`](Self::run). After each row, calls `progress` with the number of finished rows and the
    /// number of all rows.
    ///
    /// # Errors
    /// Returns the same errors as [`run`](Self::run).
    pub fn run_with(
        &self,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Matrix, MatrixError> {
        table::make(self, progress)
    }
}
