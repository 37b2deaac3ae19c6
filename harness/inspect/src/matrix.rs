//! What each translation of a package's shaders is worth: function by function and entry point by
//! entry point, on every route.
//!
//! A cell of the matrix is a row (a function or an entry point) on a column (an execution path, or a
//! language that nothing here runs). It says how far the row gets: [`Status::Translated`] by naga,
//! [`Status::Valid`] for every validator of the language that is installed, [`Status::Executed`] on
//! inputs drawn from its signature, and [`Status::Agrees`] with another route. Where it gets no
//! further, [`Stop`] says why, in naga's or the tool's own words. Nothing is assumed: without a
//! validator nothing is valid, and without a driver nothing is executed.

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

/// How far a row gets on a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Status {
    /// naga writes it in the column's language.
    Translated,
    /// Every validator of the language that is here accepts what naga wrote; there is at least one.
    Valid,
    /// It ran on each of the inputs, and wrote each result.
    Executed,
    /// Its results are those of another column.
    Agrees,
}

impl Status {
    /// All of them, from the least to the most.
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

/// Why a row gets no further.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case", tag = "why", content = "says")]
pub enum Stop {
    /// naga doesn't write it; its words.
    Unsupported(String),
    /// naga panics as it writes it; the panic's words.
    Panicked(String),
    /// A validator rejects it: which one, and its words.
    Rejected(String),
    /// A validator or a driver has no verdict: it crashed, didn't end or can't be run.
    Broke(String),
    /// The validators of the language that are here don't know all of it: what they lack, and their words.
    Unable(String),
    /// No validator of the language is here.
    NoValidator(String),
    /// The column's path isn't here, or nothing here runs its language.
    Unavailable(String),
    /// It can't be run here, or running it failed.
    NotRun(String),
    /// It gives other results.
    Differs(String),
    /// No other column ran it, or no case has a finite result.
    NothingToCompare(String),
}

impl Stop {
    /// Its words.
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

    /// Returns `true` if something is wrong: of the translation, of what runs it or of what judges it. The others say
    /// what isn't here or can't be.
    #[must_use]
    pub fn is_wrong(&self) -> bool {
        use Stop::{Broke, Differs, Panicked, Rejected};
        matches!(self, Differs(_) | Rejected(_) | Broke(_) | Panicked(_))
    }
}

/// A row on a column.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Cell {
    /// How far it got; `None`: not even a translation.
    pub status: Option<Status>,
    /// Why it got no further; `None`: there is nothing further.
    pub stopped: Option<Stop>,
    /// naga's options, in words.
    pub options: String,
    /// What the validators said.
    pub validators: Vec<Said>,
    /// The column that it was compared with.
    pub against: Option<String>,
    /// Cases that were compared with another column; of an entry point, words of its buffers.
    pub compared: usize,
    /// Cases in which the results differ by more than the tolerance, and WGSL doesn't leave them open; of
    /// an entry point, words.
    pub differing: usize,
    /// Cases, or words of an entry point, that differ where WGSL leaves the result open: an index leaves
    /// its array, or a float isn't finite.
    pub open: usize,
    /// The largest distance, in `f32` steps, of all components that were compared.
    pub worst_ulp: Option<u64>,
    /// Where the results differ, the simplest input and the first value that differs.
    pub divergence: Option<Divergence>,
    /// The only column with its result, where two others or more agree against it.
    pub suspect: Option<String>,
    /// `true` if the results are what WGSL allows, where Karat's engine knows that.
    pub allowed: Option<Allowed>,
    /// What the function's own tests found on this path; see [`Matrix::judge_by`].
    pub reference: Option<Reference>,
    /// What is declared not to work.
    pub known: Option<Known>,
    /// The translation.
    #[serde(skip)]
    pub code: Option<Arc<Code>>,
    /// The lines of the function or entry point in that text, from 1 on, both included.
    #[serde(skip)]
    pub text_lines: Option<(usize, usize)>,
}

impl Cell {
    /// The translation, if it is a text.
    #[must_use]
    pub fn text(&self) -> Option<&str> {
        self.code.as_ref()?.text()
    }

    /// Returns `true` if its results are others than those of the column that it is compared with.
    #[must_use]
    pub fn differs(&self) -> bool {
        matches!(self.stopped, Some(Stop::Differs(_)))
    }
}

/// What the author wrote.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Source {
    /// The file.
    pub file: String,
    /// The line of the text's first character, from 1 on.
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
    /// What it held before the run.
    pub bytes: Vec<u8>,
}

/// A function or an entry point on every column.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// `module::name`
    pub name: String,
    /// `function`, `vertex`, `fragment` or `compute`; `not callable`, or `module`, if there is an error.
    pub kind: String,
    /// Where its author wrote it.
    pub location: String,
    /// What its author wrote.
    #[serde(skip)]
    pub source: Source,
    /// The text that is translated: with all that it uses, and of a function with the kernel that
    /// calls it.
    #[serde(skip)]
    pub text: Arc<str>,
    /// What an entry point that differs was run with.
    #[serde(skip)]
    pub buffers: Vec<Buffer>,
    /// Why no column has it: it can't be called by a kernel, or isn't valid.
    pub error: Option<String>,
    /// In the order of the columns; empty if there is an error.
    pub cells: Vec<Cell>,
}

/// What a matrix is made of.
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

/// Cases that each function is called with. They are there to tell translations apart, not to find
/// the worst error of one.
const CASES: usize = 512;

/// How far results of two columns may be apart. Drivers' sines and cosines may be off by 2^-11, as
/// WGSL has it, so a tolerance below that tells of drivers rather than of translations.
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
    /// These columns only.
    #[must_use]
    pub fn columns(self, columns: impl IntoIterator<Item = Column>) -> Self {
        Self { columns: columns.into_iter().collect(), ..self }
    }

    /// Calls each function with so many cases.
    #[must_use]
    pub fn cases(self, cases: usize) -> Self {
        Self { cases, ..self }
    }

    /// Lets results of two columns differ by so much.
    #[must_use]
    pub fn within(self, tolerance: impl Into<Tolerance>) -> Self {
        Self { within: tolerance.into(), ..self }
    }

    /// Only rows whose name contains one of these.
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

    /// A function with them.
    fn probed(&self, name: &str) -> Result<Probed, ProbeError> {
        let own = match self.overrides.is_empty() {
            true => BTreeMap::new(),
            false => self.overrides_of(&*Program::of_function(&self.package, name)?),
        };
        Probed::with_overrides(&self.package, name, &own).and_then(made_up::fitted)
    }

    /// Declares that a row doesn't get to a status on a column, or on the paths of a selector
    /// (`:hlsl`, `@swiftshader`). It is a [finding](Matrix::findings) if it does. `[[matrix]]` in
    /// `karat.toml` declares the same.
    #[must_use]
    pub fn fails_on(mut self, column: &str, row: &str, status: Status, reason: &str) -> Self {
        let [row, column, reason] = [row, column, reason].map(str::to_owned);
        self.known.push(Known { row, column, status, reason });
        self
    }

    /// Writes to a file which row runs where, as nothing else can be done about a driver that hangs or
    /// crashes than to begin again. A row that ran as a process ended runs alone, and if it ends one once
    /// more it isn't run: its cells say why. [`restarted`] runs a program that does this.
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

    /// [`run`](Self::run), which tells how many rows are done, one more each time, and of how many.
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
