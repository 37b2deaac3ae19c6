//! Checks the translations of a package's shaders, for each function and entry point on every route.
//!
//! A cell of the matrix is a row (a function or an entry point) on a column (an execution path, or a language that
//! nothing here runs). Its status says how far the row gets: [`Status::Translated`] by naga, [`Status::Valid`] for
//! every installed validator of the language, [`Status::Executed`] on inputs sampled for its signature, and
//! [`Status::Agrees`] with another route. If it gets no further, [`Stop`] gives the reason, in naga's or the tool's own
//! words. A row is valid only if a validator says so, and executed only if a driver ran it.

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

/// The status of a row on a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// naga writes it in the column's language.
    Translated,
    /// Every installed validator of the language accepts naga's output; there is at least one.
    Valid,
    /// It ran on each of the inputs, and wrote each result.
    Executed,
    /// Its results equal those of another column.
    Agrees,
}

impl Status {
    /// All statuses, from the least to the most.
    pub const ALL: [Self; 4] = [Self::Translated, Self::Valid, Self::Executed, Self::Agrees];

    /// The name in tables and on the command line.
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
        known.ok_or_else(|| format!("`{name}` is no status; they are {names}"))
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// The reason why a row gets no further.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "why", content = "says")]
pub enum Stop {
    /// naga can't write it. Holds naga's words.
    Unsupported(String),
    /// naga panics while writing it. Holds the panic's words.
    Panicked(String),
    /// A validator rejects it. Holds the validator's name and its words.
    Rejected(String),
    /// A validator or a driver gives no verdict: it crashed, didn't end or can't be run.
    Broke(String),
    /// The installed validators of the language don't support all of it. Holds the missing part and their words.
    Unable(String),
    /// No validator of the language is installed.
    NoValidator(String),
    /// The column's path isn't available here, or nothing here runs its language.
    Unavailable(String),
    /// It can't be run here, or running it failed.
    NotRun(String),
    /// Its results differ.
    Differs(String),
    /// No other column ran it, or no case has a finite result.
    NothingToCompare(String),
}

impl Stop {
    /// The reason in words.
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

    /// Returns `true` if something is wrong: with the translation, with the path that runs it, or with a validator.
    /// Other reasons only say that something isn't available or possible here.
    #[must_use]
    pub fn is_wrong(&self) -> bool {
        use Stop::{Broke, Differs, Panicked, Rejected};
        matches!(self, Differs(_) | Rejected(_) | Broke(_) | Panicked(_))
    }
}

/// A row on a column.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Cell {
    /// Its status; `None` if not even the translation exists.
    pub status: Option<Status>,
    /// The reason why it got no further; `None` if it reached the end.
    pub stopped: Option<Stop>,
    /// naga's options, in words.
    pub options: String,
    /// The validators' verdicts.
    pub validators: Vec<Said>,
    /// The column that it was compared with.
    pub against: Option<String>,
    /// The number of cases that were compared with another column; for an entry point, of words of its buffers.
    pub compared: usize,
    /// The number of cases in which the results differ by more than the tolerance, although WGSL doesn't leave them
    /// open; for an entry point, of words.
    pub differing: usize,
    /// The number of cases, or words of an entry point, that differ where WGSL leaves the result open: after an index
    /// outside its array, or with a float that isn't finite.
    pub open: usize,
    /// The largest distance between compared components, in `f32` steps.
    pub worst_ulp: Option<u64>,
    /// If the results differ, the simplest input and the first value that differs.
    pub divergence: Option<Divergence>,
    /// The column that is alone with its result, while at least two others agree against it.
    pub suspect: Option<String>,
    /// The results within what WGSL allows, if Karat's engine knows that.
    pub allowed: Option<Allowed>,
    /// The verdicts of the function's own tests on this path; see [`Matrix::judge_by`].
    pub reference: Option<Reference>,
    /// The declaration that it doesn't work.
    pub known: Option<Known>,
    /// The translation.
    #[serde(skip)]
    pub code: Option<Arc<Code>>,
    /// The lines of the function or entry point in that text, counted from 1, ends included.
    #[serde(skip)]
    pub text_lines: Option<(usize, usize)>,
}

impl Cell {
    /// The translation, if it is a text.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        self.code.as_ref()?.text()
    }

    /// Returns `true` if its results differ from those of the column that it is compared with.
    #[must_use]
    pub fn differs(&self) -> bool {
        matches!(self.stopped, Some(Stop::Differs(_)))
    }
}

/// The author's text.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Source {
    /// The file.
    pub file: String,
    /// The line of its first character, counted from 1.
    pub line: usize,
    /// The function or entry point, with its attributes.
    pub text: String,
}

/// A buffer that an entry point was run with.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Buffer {
    /// Its group.
    pub group: u32,
    /// Its binding.
    pub binding: u32,
    /// Its bytes before the run.
    pub bytes: Vec<u8>,
}

/// A function or an entry point on every column.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// `module::name`
    pub name: String,
    /// `function`, `vertex`, `fragment` or `compute`; `not callable`, or `module`, if there is an error.
    pub kind: String,
    /// The place in the author's file.
    pub location: String,
    /// The author's text.
    #[serde(skip)]
    pub source: Source,
    /// The text that is translated: with everything that it uses, and for a function with the kernel that calls it.
    #[serde(skip)]
    pub text: Arc<str>,
    /// The buffers of an entry point whose results differ.
    #[serde(skip)]
    pub buffers: Vec<Buffer>,
    /// The reason why no column has it: a kernel can't call it, or it is invalid.
    pub error: Option<String>,
    /// The cells, in the order of the columns; empty if there is an error.
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

/// The cases of each function. They have to tell translations apart, not to find the worst error.
const CASES: usize = 512;

/// The largest allowed difference between two columns. WGSL allows a driver's sine and cosine an error of 2^-11, so a
/// smaller tolerance would report differences of drivers rather than of translations.
const WITHIN: f64 = 1e-3;

/// A matrix of the package's functions and entry points on every column; see [`matrix`](self).
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

    /// Restricts the matrix to rows whose name contains one of these.
    #[must_use]
    pub fn only<'n>(self, names: impl IntoIterator<Item = &'n str>) -> Self {
        Self { only: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    /// Gives an `override` a value, by its name or its `@id`, in each row that has one.
    #[must_use]
    pub fn with_override(mut self, name: &str, value: f64) -> Self {
        self.overrides.insert(name.to_owned(), value);
        self
    }

    /// The values of the overrides that a program has.
    fn overrides_of(&self, program: &Program) -> BTreeMap<String, f64> {
        let own = self.overrides.iter().filter(|(name, _)| program.has_override(name));
        own.map(|(name, value)| (name.clone(), *value)).collect()
    }

    /// A function with these values.
    fn probed(&self, name: &str) -> Result<Probed, ProbeError> {
        let own = match self.overrides.is_empty() {
            true => BTreeMap::new(),
            false => self.overrides_of(&*Program::of_function(&self.package, name)?),
        };
        Probed::with_overrides(&self.package, name, &own).and_then(made_up::fitted)
    }

    /// Declares that a row doesn't reach a status on a column, or on the paths of a selector (`:hlsl`, `@swiftshader`).
    /// If the row does reach it, that is a [finding](Matrix::findings). `[[matrix]]` in `karat.toml` declares the same.
    #[must_use]
    pub fn fails_on(mut self, column: &str, row: &str, status: Status, reason: &str) -> Self {
        let [row, column, reason] = [row, column, reason].map(str::to_owned);
        self.known.push(Known { row, column, status, reason });
        self
    }

    /// Records in a file which row runs where: after a driver hangs or crashes, the only remedy is to start again. A
    /// row that was running then runs alone; if it ends the process again, it is skipped, and its cells give the
    /// reason. [`restarted`] runs a program that does this.
    #[must_use]
    pub fn journal(self, file: &Path) -> Self {
        Self { journal: Some(file.to_owned()), ..self }
    }

    /// Makes the matrix.
    ///
    /// # Errors
    /// If the package can't be read, has no function and no entry point, a setting is wrong, or the
    /// file of [`journal`](Self::journal) isn't one.
    pub fn run(&self) -> Result<Matrix, MatrixError> {
        self.run_with(&|_, _| {})
    }

    /// Does the same as [`run`](Self::run), and reports the number of finished rows, one more each time, and the total.
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
