//! Checks the translations of a package's shaders, for each function and entry point on every route.
//!
//! A cell of the matrix is a row (a function or an entry point) on a column (an execution path, or a language that no
//! path runs). The cell's status is the last step that the row reached: [`Status::Translated`] by naga,
//! [`Status::Valid`] for every installed validator of the language, [`Status::Executed`] on inputs sampled for its
//! signature, and [`Status::Agrees`] with another column. If a row reaches no further step, [`Stop`] gives the reason,
//! in the words of naga or of the tool. A row is valid only if a validator accepts it, and executed only if a driver
//! ran it.

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
    /// Every installed validator of the language accepts naga's output. There is at least one validator.
    Valid,
    /// The row ran on all of the inputs, and wrote each result.
    Executed,
    /// The results equal those of another column.
    Agrees,
}

impl Status {
    /// All statuses, in the order of the steps.
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

/// The reason why a row reaches no further status.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "why", content = "says")]
pub enum Stop {
    /// naga can't translate the row. Holds naga's message.
    Unsupported(String),
    /// naga panics while it translates the row. Holds the panic's message.
    Panicked(String),
    /// A validator rejects the translation. Holds the validator's name and message.
    Rejected(String),
    /// A validator or a driver gives no verdict: it crashed, didn't end, or can't be run.
    Broke(String),
    /// The installed validators of the language don't support some part of the translation. Holds this part, and the
    /// validators' messages.
    Unable(String),
    /// No validator of the language is installed.
    NoValidator(String),
    /// The column's path isn't available here, or no path runs its language.
    Unavailable(String),
    /// The row can't be run here, or running it failed.
    NotRun(String),
    /// The results differ from another column's.
    Differs(String),
    /// No other column ran the row, or no case has a finite result.
    NothingToCompare(String),
}

impl Stop {
    /// The reason as a sentence.
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

    /// Reports if the translation, the path that runs it, or a validator is wrong. All other reasons mean that
    /// something isn't available or possible here.
    #[must_use]
    pub fn is_wrong(&self) -> bool {
        use Stop::{Broke, Differs, Panicked, Rejected};
        matches!(self, Differs(_) | Rejected(_) | Broke(_) | Panicked(_))
    }
}

/// A row on one column.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Cell {
    /// The last status that the row reached; `None` if the row has no translation.
    pub status: Option<Status>,
    /// The reason why the row reached no further status; `None` if it reached [`Status::Agrees`].
    pub stopped: Option<Stop>,
    /// naga's options, as readable text.
    pub options: String,
    /// The validators' verdicts.
    pub validators: Vec<Said>,
    /// The column whose results this column's results were compared with.
    pub against: Option<String>,
    /// The number of cases that were compared with another column. For an entry point: the number of `u32` words in its
    /// buffers.
    pub compared: usize,
    /// The number of cases in which the results differ by more than the tolerance, and WGSL defines the result. For an
    /// entry point: the number of `u32` words.
    pub differing: usize,
    /// The number of cases (for an entry point: `u32` words) that differ where WGSL doesn't define the result: after an
    /// index outside its array, or with a float that isn't finite.
    pub open: usize,
    /// The largest distance between compared components, in `f32` steps.
    pub worst_ulp: Option<u64>,
    /// The simplest input for which the results differ, and the first value that differs; `None` if the results agree.
    pub divergence: Option<Divergence>,
    /// The column that disagrees with at least two columns that agree with each other.
    pub suspect: Option<String>,
    /// The number of results that WGSL allows; `None` if Karat's engine can't compute the bounds.
    pub allowed: Option<Allowed>,
    /// The verdicts of the function's own tests on this path; see [`Matrix::judge_by`].
    pub reference: Option<Reference>,
    /// The declaration that this row fails on this column.
    pub known: Option<Known>,
    /// The translation.
    #[serde(skip)]
    pub code: Option<Arc<Code>>,
    /// The first and the last line of the function or entry point in the translation, counted from 1.
    #[serde(skip)]
    pub text_lines: Option<(usize, usize)>,
}

impl Cell {
    /// The translation, if it is text and not binary.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        self.code.as_ref()?.text()
    }

    /// Reports if the results differ from those of [`against`](Self::against).
    #[must_use]
    pub fn differs(&self) -> bool {
        matches!(self.stopped, Some(Stop::Differs(_)))
    }
}

/// A function or entry point as its author wrote it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Source {
    /// The path of the author's file.
    pub file: String,
    /// The line where the text begins, counted from 1.
    pub line: usize,
    /// The text of the function or entry point, with its attributes.
    pub text: String,
}

/// A buffer that an entry point ran with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Buffer {
    /// The buffer's `@group` number.
    pub group: u32,
    /// The buffer's `@binding` number.
    pub binding: u32,
    /// The buffer's bytes before the run.
    pub bytes: Vec<u8>,
}

/// A function or an entry point on every column.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// `module::name`
    pub name: String,
    /// `function`, `vertex`, `fragment` or `compute`. If [`error`](Self::error) is set: `not callable` or `module`.
    pub kind: String,
    /// The file, line and column of the row in the author's sources.
    pub location: String,
    /// The row as its author wrote it.
    #[serde(skip)]
    pub source: Source,
    /// The text that naga translates: the row with everything that it uses. For a function, the text includes the
    /// kernel that calls it.
    #[serde(skip)]
    pub text: Arc<str>,
    /// The initial buffers of an entry point, if its results differ.
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

/// The number of cases of each function: enough to distinguish translations, too few to find the worst error.
const CASES: usize = 512;

/// The largest allowed difference between two columns. WGSL allows a driver's sine and cosine an error of 2^-11, so a
/// smaller tolerance would report differences between drivers, not translations.
const WITHIN: f64 = 1e-3;

/// Requests a matrix of the package's functions and entry points on every column; see [`matrix`](self).
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
    /// Restricts the matrix to these columns.
    #[must_use]
    pub fn columns(self, columns: impl IntoIterator<Item = Column>) -> Self {
        Self { columns: columns.into_iter().collect(), ..self }
    }

    /// Sets the number of cases of each function.
    #[must_use]
    pub fn cases(self, cases: usize) -> Self {
        Self { cases, ..self }
    }

    /// Sets the largest allowed difference between two columns.
    #[must_use]
    pub fn within(self, tolerance: impl Into<Tolerance>) -> Self {
        Self { within: tolerance.into(), ..self }
    }

    /// Restricts the matrix to rows with a name that contains one of these texts.
    #[must_use]
    pub fn only<'n>(self, names: impl IntoIterator<Item = &'n str>) -> Self {
        Self { only: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    /// Sets the value of an `override`, by its name or its `@id`, in each row that uses the override.
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

    /// Declares that a row doesn't reach a status on a column, or on the paths of a selector (`:hlsl`, `@swiftshader`).
    /// A row that reaches the status all the same is a [finding](Matrix::findings). `[[matrix]]` in `karat.toml` makes
    /// the same declaration.
    #[must_use]
    pub fn fails_on(mut self, column: &str, row: &str, status: Status, reason: &str) -> Self {
        let [row, column, reason] = [row, column, reason].map(str::to_owned);
        self.known.push(Known { row, column, status, reason });
        self
    }

    /// Records in a file which row runs on which column. If a driver hangs or crashes, the process ends and starts
    /// again. The row that was running then runs without other rows beside it. If this row ends the process again, the
    /// next process skips it, and its cells give the reason. [`restarted`] starts the program again.
    #[must_use]
    pub fn journal(self, file: &Path) -> Self {
        Self { journal: Some(file.to_owned()), ..self }
    }

    /// Makes the matrix.
    ///
    /// # Errors
    /// If the package can't be read, if it has no function and no entry point, if a setting is wrong, or if the file of
    /// [`journal`](Self::journal) can't be read or written.
    pub fn run(&self) -> Result<Matrix, MatrixError> {
        self.run_with(&|_, _| {})
    }

    /// Does the same as [`run`](Self::run). After each finished row, calls `progress` with the number of finished rows
    /// and the total.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn run_with(
        &self,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Matrix, MatrixError> {
        table::make(self, progress)
    }
}
