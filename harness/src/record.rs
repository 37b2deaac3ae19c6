//! What a run found, as data: one JSON line for each verdict.
//!
//! Every process of a run appends to a file of its own in the folder that `KARAT_RECORD` names;
//! the command line reads them all. Nothing is written when the variable isn't set. Whoever starts
//! a run gives it a folder of its own ([`Running`]). When the run has ended, `run.json` says how it
//! was made ([`Run`]).

mod details;
mod errors;
mod folder;
mod replay;

use std::borrow::Cow;
use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, OnceLock};
use std::time::{Instant, SystemTime};

use serde::{Deserialize, Serialize};

pub use self::details::{CaseDetails, Details, ExpectationDetails, PathDetails};
pub use self::errors::{Errors, Histogram, Plot};
pub use self::folder::Running;
use self::folder::Turn;
pub use self::replay::Replay;
pub use crate::diagnostic::FileRead;
pub use crate::dispatch::{Violation, ViolationAccess, Watched};
use crate::output;
use crate::path::Adapter;

/// Version of the format. Lines with another version are refused.
pub const SCHEMA: u32 = 5;

/// What a check concluded.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every case of every path agreed.
    Pass,
    /// At least one path fails as was declared; on the others every case agreed.
    KnownIssue,
    /// At least one case disagreed.
    Fail,
    /// Nothing could be compared.
    Error,
}

/// One verdict.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// See [`SCHEMA`].
    pub schema: u32,
    /// Name of the test that made it.
    pub test: String,
    /// The Cargo package that has the test. Empty if it isn't Cargo's, or if an older Karat wrote the record.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub cargo_package: String,
    /// What was checked.
    pub subject: Subject,
    /// The verdict.
    pub verdict: Verdict,
    /// Each path that ran.
    pub paths: Vec<PathRecord>,
    /// The whole message of a failure or error, for people: [`details`](Self::details) has the same as data.
    pub message: Option<String>,
    /// What failed, as data; `None` if the check passes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub details: Option<Details>,
    /// How much of compute passes the sanitizer looked through; `None` of what has no passes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub watched: Option<Watched>,
    /// The folder whose files replaced modules (`KARAT_OVERLAY`). Such a verdict says nothing about
    /// the package as it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overlay: Option<String>,
    /// The files that the verdict depends on, each once: modules, goldens, and the images of
    /// fixtures, masks and variances. Two kinds are missing: images whose pixels were copied into
    /// another image, and files that a reference reads. If the check ended before its function was
    /// compiled, only the function's module is listed. Empty if an older Karat wrote the record.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub read: Vec<FileRead>,
    /// When it was made; `None` if an older Karat wrote the record.
    #[serde(flatten)]
    pub time: Option<Time>,
}

/// When a verdict was made and how long it took, for people who look for slow tests. It isn't part
/// of the verdict, and differs from run to run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Time {
    /// When the check began, in UTC: `2026-01-31T12:00:00.000Z`.
    pub started: String,
    /// How long it took by the clock, even if other tests ran at the same time.
    pub seconds: f64,
}

/// Measures the [`Time`] of a verdict.
#[derive(Debug)]
pub(crate) struct Stopwatch {
    started: SystemTime,
    /// The clock of the system may be set meanwhile.
    running: Instant,
}

impl Stopwatch {
    pub(crate) fn start() -> Self {
        Self { started: SystemTime::now(), running: Instant::now() }
    }

    pub(crate) fn time(&self) -> Time {
        // There are no names for times before the epoch.
        let started = self.started.max(SystemTime::UNIX_EPOCH);
        Time {
            started: humantime::format_rfc3339_millis(started).to_string(),
            seconds: self.running.elapsed().as_secs_f64(),
        }
    }
}

/// What a verdict is about.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Subject {
    /// A WGSL function.
    Function {
        /// Folder of the package.
        package: String,
        /// `fresnel::schlick`
        function: String,
        /// Which check: `agrees_with`, ...
        check: String,
        /// What was asserted: the tolerance, or the statement.
        assertion: String,
        /// `file:line:column` of the function; empty if it wasn't found.
        location: String,
        /// Where arguments come from, in words, if the domain was made at run time: `x from 0 to 1`.
        #[serde(default, skip_serializing_if = "String::is_empty")]
        domain: String,
        /// Seed of the cases.
        seed: u64,
    },
    /// A rendered frame.
    Frame {
        /// Name of the golden.
        golden: String,
        /// The folder of goldens; empty if the frame was compared with a number.
        #[serde(default)]
        folder: String,
        /// `file:line:column` of the call in the test. The file is as the compiler was given it.
        #[serde(default)]
        location: String,
    },
}

/// The results of one path.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathRecord {
    /// Path, adapter and driver.
    pub adapter: Adapter,
    /// Cases (or pixels) that were compared.
    pub cases: u64,
    /// How many of them failed.
    pub failures: u64,
    /// The largest error, in its unit: `2.5 ulp`.
    pub worst: String,
    /// The largest error divided by its bound; `None` if that isn't a number.
    pub ratio: Option<f64>,
    /// What was asserted on this path: the tolerance, or the statement.
    pub asserted: String,
    /// Why this path was declared to fail; `None` if it should pass.
    pub known_issue: Option<String>,
    /// What WGSL allows where a tolerance is declared; `None` for what declares none, and for functions
    /// that the engine doesn't execute.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub allowed: Option<Allowance>,
    /// How large the errors of some cases are; `None` for what isn't judged case by case, or if an older
    /// Karat wrote the record.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub errors: Option<Errors>,
    /// Where the errors are; for paths that fail.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plot: Option<Plot>,
    /// What was counted in the worst configuration of a sampler that is rejected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub histogram: Option<Histogram>,
    /// How many configurations of a sampler were judged, each by many samples: `failures` are of them.
    /// `None` for what is judged case by case, or if an older Karat wrote the record.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub configurations: Option<u64>,
    /// The least and the largest number of invocations of a subgroup, if passes depend on it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subgroups: Option<[u32; 2]>,
}

impl PathRecord {
    /// A record of a path with nothing in it yet.
    pub(crate) fn of(adapter: Adapter) -> Self {
        Self {
            adapter,
            cases: 0,
            failures: 0,
            worst: String::new(),
            ratio: None,
            asserted: String::new(),
            known_issue: None,
            allowed: None,
            errors: None,
            plot: None,
            histogram: None,
            configurations: None,
            subgroups: None,
        }
    }
}

/// What WGSL allows a function to return, compared with the tolerance of a check. Where it allows more,
/// another driver may fail the check and be right.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Allowance {
    /// Cases that were looked at: a sample.
    pub cases: u64,
    /// In how many of them it allows a larger error than the tolerance.
    pub wider: u64,
    /// The largest error that it allows, divided by the tolerance; `None` if that is no number: it allows
    /// anything, or an error where the tolerance allows none.
    pub worst: Option<f64>,
    /// In how many cases it allows anything; 0 in records of older versions.
    #[serde(default)]
    pub unbounded: u64,
}

/// How a run was made: `run.json`, beside its records. If it is missing, the run didn't end, so the
/// records may be incomplete: they don't show that something wasn't tested.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Run {
    /// See [`SCHEMA`].
    pub schema: u32,
    /// What selected the tests: a filter, packages, targets. If it is empty, every test ran.
    pub selected: Vec<String>,
    /// True if every test passed and each module is valid. A test that fails records nothing after its
    /// failure.
    pub passed: bool,
    /// Tests that failed, as far as their runner named them, whether or not a check of theirs did.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<String>,
    /// Modules that aren't valid, whether or not a test uses them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub invalid: Vec<String>,
    /// What is wrong with them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<ModuleError>,
    /// Packages that aren't valid, and of which no module is to blame: one that requires Tint's verdict and has none, or one
    /// without a module.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub invalid_packages: Vec<String>,
    /// Remarks that fail nothing: modules that Tint rejects, or why it wasn't asked.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
    /// Tests that the runner left out after a failure, by its own word. They were to run.
    #[serde(default, skip_serializing_if = "is_none")]
    pub not_run: u64,
    /// True if the runner stopped at a failure, and didn't say how many tests it left out.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub stopped: bool,
}

/// An error of a module that isn't valid.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ModuleError {
    /// `file:line:column`; empty if it has no place.
    pub place: String,
    /// What is wrong.
    pub message: String,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn is_none(count: &u64) -> bool {
    *count == 0
}

impl Default for Run {
    /// Of every test, which passed.
    fn default() -> Self {
        let (selected, failed, invalid, invalid_packages, remarks) = Default::default();
        let errors = Vec::new();
        let (schema, passed, not_run, stopped) = (SCHEMA, true, 0, false);
        Self {
            schema,
            selected,
            passed,
            failed,
            invalid,
            errors,
            invalid_packages,
            remarks,
            not_run,
            stopped,
        }
    }
}

impl Run {
    /// The file in the folder of records.
    const FILE: &'static str = "run.json";

    /// Writes it beside the records of a folder.
    ///
    /// # Errors
    /// If the file can't be written.
    pub fn write(&self, folder: &Path) -> std::io::Result<()> {
        let text = serde_json::to_string(self).expect("a run is plain data");
        crate::image::write_whole(&folder.join(Self::FILE), text.as_bytes())
    }

    /// How the run of a folder's records was made; `None` if that isn't written down. For a folder
    /// of runs, it is the run that ended last.
    ///
    /// ```no_run
    /// use karat::unstable::record::Run;
    ///
    /// let run = Run::read("target/karat/last".as_ref())?;
    /// println!("it passed: {}", run.is_some_and(|run| run.passed));
    /// # Ok::<(), karat::unstable::record::RecordError>(())
    /// ```
    ///
    /// # Errors
    /// If the file can't be read or isn't of this version.
    pub fn read(folder: &Path) -> Result<Option<Self>, RecordError> {
        Ok(Recorded::read(folder)?.and_then(|recorded| recorded.run))
    }

    fn of(folder: &Path) -> Result<Option<Self>, RecordError> {
        let file = folder.join(Self::FILE);
        let path = file.display().to_string();
        let text = match std::fs::read_to_string(&file) {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            read => read.map_err(|cause| RecordError::Read { path: path.clone(), cause })?,
        };
        let bad = |reason: String| RecordError::Line { path: path.clone(), line: 1, reason };
        let run: Self = serde_json::from_str(&text).map_err(|error| bad(error.to_string()))?;
        if run.schema != SCHEMA {
            return Err(bad(format!("it has version {}", run.schema)));
        }
        Ok(Some(run))
    }
}

/// The overlay that is in force, as records have it.
pub(crate) fn overlay() -> Option<String> {
    crate::settings::overlay().map(|folder| folder.display().to_string())
}

impl Allowance {
    /// With other cases of the check.
    pub(crate) fn merge(self, other: Self) -> Self {
        let worst = self.worst.zip(other.worst).map(|(a, b)| a.max(b));
        Self {
            cases: self.cases + other.cases,
            wider: self.wider + other.wider,
            worst,
            unbounded: self.unbounded + other.unbounded,
        }
    }
}

thread_local! {
    /// False while verdicts of this thread say nothing of the package as it is.
    static KEPT: Cell<bool> = const { Cell::new(true) };
}

/// The values that the checks of a test saw.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    /// Stands for all values that they judged, in their order.
    pub values: [u8; 32],
    /// The largest error divided by its bound; 0 of what has neither.
    pub ratio: f64,
}

thread_local! {
    /// The values that the checks of this thread saw, within [`unrecorded`].
    static SEEN: RefCell<Option<Seen>> = const { RefCell::new(None) };
}

/// Writes what lines of shaders print in a test, under the test's name, and once: each path prints the same.
pub(crate) fn tell_prints(text: &str) {
    thread_local! {
        static TOLD: RefCell<String> = const { RefCell::new(String::new()) };
    }
    TOLD.with_borrow_mut(|told| {
        // Mutants and counted runs repeat what the tests print.
        if *told != text
            && !text.is_empty()
            && !is_unrecorded()
            && crate::settings::coverage().is_none()
        {
            let thread = std::thread::current();
            let name = thread.name().map_or_else(String::new, |name| format!("{name} prints\n"));
            eprint!("{name}{text}");
            text.clone_into(told);
        }
    });
}

/// True within [`unrecorded`].
pub(crate) fn is_unrecorded() -> bool {
    SEEN.with_borrow(Option::is_some)
}

/// Adds rows that a check judged, and the largest ratio of their errors.
pub(crate) fn saw(rows: &mut dyn Iterator<Item = &[u32]>, ratio: f64) {
    SEEN.with_borrow_mut(|seen| {
        if let Some(seen) = seen {
            let mut hasher = blake3::Hasher::new();
            hasher.update(&seen.values);
            // WGSL lets the sign of a zero be ignored (15.7.2). As an integer it would be the least one.
            const NEGATIVE_ZERO: u32 = 1 << 31;
            for word in rows.flatten() {
                let word = if *word == NEGATIVE_ZERO { 0 } else { *word };
                hasher.update(&word.to_le_bytes());
            }
            seen.values = *hasher.finalize().as_bytes();
            seen.ratio = seen.ratio.max(ratio);
        }
    });
}

/// Runs tests whose verdicts say nothing of the package as it is, such as those of a mutant: they are neither recorded nor
/// remembered. Returns what their checks saw, too.
pub fn unrecorded<R>(run: impl FnOnce() -> R) -> (R, Seen) {
    struct Before(bool);
    impl Drop for Before {
        fn drop(&mut self) {
            KEPT.set(self.0);
        }
    }
    let _before = Before(KEPT.replace(false));
    SEEN.set(Some(Seen::default()));
    let result = run();
    (result, SEEN.take().unwrap_or_default())
}

/// False within [`unrecorded`].
pub(crate) fn is_kept() -> bool {
    KEPT.get()
}

/// Whether a record is kept.
pub(crate) fn wanted() -> bool {
    is_kept() && crate::settings::record().is_some()
}

/// Appends a verdict to this process's file, if a run is being recorded.
///
/// # Panics
/// If the record can't be written: a verdict that is lost would be missing from the report.
pub(crate) fn write(record: &Record) {
    let Some(folder) = crate::settings::record().filter(|_| is_kept()) else { return };
    let folder = folder.as_path();
    static FILE: OnceLock<Mutex<File>> = OnceLock::new();
    let file = FILE.get_or_init(|| {
        let path = folder.join(format!("{}.jsonl", std::process::id()));
        let opened = std::fs::create_dir_all(folder)
            .and_then(|()| OpenOptions::new().create(true).append(true).open(&path));
        match opened {
            Ok(file) => Mutex::new(file),
            Err(error) => panic!("can't write the record `{}`: {error}", path.display()),
        }
    });
    let mut line = serde_json::to_string(record).expect("a record is plain data");
    line.push('\n');
    let mut file = file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    if let Err(error) = file.write_all(line.as_bytes()) {
        panic!("can't write the record in `{}`: {error}", folder.display());
    }
}

/// How files end that have the tests whose frames are left out.
const LEFT_OUT: &str = "left-out";

/// Notes that a test has a frame that isn't drawn, if a run is being recorded.
///
/// # Panics
/// As [`write`].
pub(crate) fn leave_out(test: &str) {
    if let Some(folder) = crate::settings::record() {
        crate::image::append_line(&folder, LEFT_OUT, test);
    }
}

/// The tests of a folder of records whose frames were left out (`KARAT_FRAMES=off`).
///
/// # Errors
/// If a file can't be read.
pub fn left_out(folder: &Path) -> std::io::Result<BTreeSet<String>> {
    let mut tests = BTreeSet::new();
    for entry in std::fs::read_dir(folder)? {
        let file = entry?.path();
        if file.extension().is_some_and(|ending| ending == LEFT_OUT) {
            tests.extend(std::fs::read_to_string(&file)?.lines().map(str::to_owned));
        }
    }
    Ok(tests)
}

/// Why a record can't be read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The folder or a file can't be read.
    #[error("can't read the record `{path}`: {cause}")]
    Read {
        /// The folder or file.
        path: String,
        /// Why.
        cause: std::io::Error,
    },
    /// A line isn't a record of this version.
    #[error("`{path}` line {line} isn't a record of version {SCHEMA}: {reason}")]
    Line {
        /// The file.
        path: String,
        /// The line, from 1.
        line: usize,
        /// Why.
        reason: String,
    },
}

/// The record of a run.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// Where it is.
    pub folder: PathBuf,
    /// The verdicts of all processes, in an order that doesn't depend on their timing.
    pub records: Vec<Record>,
    /// How the run was made; `None` if that isn't written down.
    pub run: Option<Run>,
}

impl Recorded {
    /// Reads the record of a folder. If it is a folder of runs, that is the record of the run that
    /// ended last; otherwise the files in the folder itself. `None` if there is neither.
    ///
    /// ```
    /// # let folder = tempfile::tempdir()?;
    /// # let record = folder.path();
    /// use karat::unstable::record::{Recorded, Run};
    ///
    /// assert!(Recorded::read(record)?.is_none(), "nothing has run");
    /// Run::default().write(record)?;
    /// let recorded = Recorded::read(record)?.expect("a run has ended");
    /// assert!(recorded.records.is_empty(), "it had no check");
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If a file can't be read or a line isn't a record.
    pub fn read(folder: &Path) -> Result<Option<Self>, RecordError> {
        if !folder.is_dir() {
            return Ok(None);
        }
        // A run that ends meanwhile removes no record that is being read.
        let last = || folder::last(folder).filter(|last| last.is_dir());
        let _turn = match last() {
            Some(_) => Some(Turn::wait(folder, File::try_lock_shared).map_err(|cause| {
                RecordError::Read { path: folder.display().to_string(), cause }
            })?),
            None => None,
        };
        let folder = last().unwrap_or_else(|| folder.to_owned());
        let (run, records) = (Run::of(&folder)?, records(&folder)?);
        let is_there = !records.is_empty() || run.is_some();
        Ok(is_there.then_some(Self { folder, records, run }))
    }
}

/// Whether a run of a folder of records was killed, and none has begun since.
#[must_use]
pub fn was_killed(records: &Path) -> bool {
    // One that has ended holds nothing.
    folder::dead(records).iter().any(|run| run.join(folder::RUNNING).exists())
}

/// Reads the verdicts of a folder as [`Recorded::read`] does.
///
/// ```no_run
/// use karat::unstable::record::Verdict;
///
/// let records = karat::unstable::record::read("target/karat/last".as_ref())?;
/// let failures = records.iter().filter(|record| record.verdict == Verdict::Fail).count();
/// println!("{failures} of {} fail", records.len());
/// # Ok::<(), karat::unstable::record::RecordError>(())
/// ```
///
/// # Errors
/// If the folder or a file can't be read or a line isn't a record.
pub fn read(folder: &Path) -> Result<Vec<Record>, RecordError> {
    if !folder.is_dir() {
        return records(folder);
    }
    Ok(Recorded::read(folder)?.map(|recorded| recorded.records).unwrap_or_default())
}

fn records(folder: &Path) -> Result<Vec<Record>, RecordError> {
    let failed = |path: &Path| {
        let path = path.display().to_string();
        move |cause| RecordError::Read { path, cause }
    };
    let mut records = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed(folder))? {
        let path = entry.map_err(failed(folder))?.path();
        if path.extension().is_none_or(|extension| extension != "jsonl") {
            continue;
        }
        let file = File::open(&path).map_err(failed(&path))?;
        for (line, text) in (1..).zip(BufReader::new(file).lines()) {
            let text = text.map_err(failed(&path))?;
            let bad = |reason: String| RecordError::Line {
                path: path.display().to_string(),
                line,
                reason,
            };
            let record: Record = serde_json::from_str(&text).map_err(|e| bad(e.to_string()))?;
            if record.schema != SCHEMA {
                return Err(bad(format!("it has version {}", record.schema)));
            }
            records.push(record.named());
        }
    }
    Record::sort(&mut records);
    Ok(records)
}

impl Record {
    /// With names that every format can hold: a record may come from another program or machine.
    fn named(mut self) -> Self {
        let mut names = vec![&mut self.test, &mut self.cargo_package];
        match &mut self.subject {
            Subject::Function { function, check, .. } => names.extend([function, check]),
            Subject::Frame { golden, .. } => names.push(golden),
        }
        names.extend(self.paths.iter_mut().map(|path| &mut path.adapter.path));
        for name in names {
            if let Cow::Owned(held) = output::name(name) {
                *name = held;
            }
        }
        self
    }

    /// Orders records by what they are about, and those of one test about the same as they were made.
    pub fn sort(records: &mut [Self]) {
        let key = |record: &Self| {
            let subject = match &record.subject {
                Subject::Function { function, check, .. } => format!("{function} {check}"),
                Subject::Frame { golden, .. } => format!("~{golden}"),
            };
            let started = record.time.as_ref().map(|time| time.started.clone());
            (subject, record.test.clone(), started)
        };
        records.sort_by_cached_key(key);
    }
}

#[cfg(test)]
mod tests;
