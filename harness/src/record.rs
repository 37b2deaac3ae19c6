//! The verdicts of a run as data: one line of JSON per verdict.
//!
//! Each process of a run appends its verdicts to its own file in the folder that `KARAT_RECORD` names. The command that
//! started the run reads all of these files. If `KARAT_RECORD` isn't set, Karat writes nothing. A command that starts a
//! run creates a folder for the run's records ([`Running`]). When the run ends, the command writes `run.json`, which
//! says which tests ran and whether they passed ([`Run`]).

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

/// Version of the format. Karat refuses records of other versions.
pub const SCHEMA: u32 = 5;

/// The conclusion of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every case passes on every path.
    Pass,
    /// At least one path fails, and each failing path is a declared known issue. On all other paths, every case passes.
    KnownIssue,
    /// A module isn't valid, a case fails on a path without a declared known issue, or a declared known issue no longer
    /// occurs.
    Fail,
    /// Karat couldn't run the check, or couldn't compare any case.
    Error,
}

/// A verdict on one function or frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Version of the record's format, [`SCHEMA`].
    pub schema: u32,
    /// Name of the test that made the record.
    pub test: String,
    /// The Cargo package that has the test; empty if Cargo didn't run it, or if an older Karat wrote the record.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub cargo_package: String,
    /// The function or frame that was checked.
    pub subject: Subject,
    /// The verdict on all paths together.
    pub verdict: Verdict,
    /// The results of each path that ran.
    pub paths: Vec<PathRecord>,
    /// The whole message of a failure or error, for people. [`Details`] is the same failure as data.
    pub message: Option<String>,
    /// The failure or error as data; `None` if the check passes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub details: Option<Details>,
    /// The part of the compute passes that the sanitizer examined; `None` if the check has no passes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub watched: Option<Watched>,
    /// The folder whose files replaced modules of the package (`KARAT_OVERLAY`). The verdict is then about the shaders
    /// with these files, and not about the package itself. `None` without an overlay.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overlay: Option<String>,
    /// The files on which the verdict depends, each once: modules, goldens, and the images of fixtures, masks and
    /// variances. The list is empty if an older Karat wrote the record. The list doesn't contain files that a reference
    /// reads, or images from which a test copied pixels into another image. If the check ended before Karat compiled
    /// its function, the list has only the function's module.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub read: Vec<FileRead>,
    /// The start and the duration of the check; `None` if an older Karat wrote the record.
    #[serde(flatten)]
    pub time: Option<Time>,
}

/// The start and the duration of a check. These values help you find slow tests. The time isn't part of the verdict,
/// and differs from run to run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Time {
    /// Time at which the check began, in UTC: `2026-01-31T12:00:00.000Z`.
    pub started: String,
    /// Seconds from the start to the end of the check. Other tests may have run at the same time.
    pub seconds: f64,
}

#[derive(Debug)]
pub(crate) struct Stopwatch {
    started: SystemTime,
    running: Instant,
}

impl Stopwatch {
    pub(crate) fn start() -> Self {
        Self { started: SystemTime::now(), running: Instant::now() }
    }

    pub(crate) fn time(&self) -> Time {
        // `humantime` can't format times before 1970.
        let started = self.started.max(SystemTime::UNIX_EPOCH);
        Time {
            started: humantime::format_rfc3339_millis(started).to_string(),
            seconds: self.running.elapsed().as_secs_f64(),
        }
    }
}

/// The function or frame that a verdict is about.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum Subject {
    /// A WGSL function.
    Function {
        /// Folder of the package.
        package: String,
        /// The function's path: `fresnel::schlick`.
        function: String,
        /// The verb of the check, such as `agrees_with`.
        check: String,
        /// The assertion: a tolerance or a statement.
        assertion: String,
        /// `file:line:column` of the function; empty if Karat didn't find it.
        location: String,
        /// The domains of the arguments as text, such as `x from 0 to 1`; empty if a test in Rust chose
        /// the domains, or if the check has no domains.
        #[serde(default, skip_serializing_if = "String::is_empty")]
        domain: String,
        /// Seed of the cases.
        seed: u64,
    },
    /// A rendered frame.
    Frame {
        /// Name of the golden.
        golden: String,
        /// The folder of goldens; empty if the test compared the frame with a number instead of a golden.
        #[serde(default)]
        folder: String,
        /// `file:line:column` of the check in the test. The file has the path that Rust's `file!` returns.
        #[serde(default)]
        location: String,
    },
}

/// The results of one path.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PathRecord {
    /// The path's name, its adapter and its driver.
    pub adapter: Adapter,
    /// Number of compared cases, or of compared pixels of a frame.
    pub cases: u64,
    /// Number of failing cases, or of failing pixels of a frame; 0 or 1 if the check compares the mean of an area.
    pub failures: u64,
    /// The largest error with its unit: `2.5 ulp`.
    pub worst: String,
    /// The largest error divided by its tolerance; `None` if the quotient isn't a finite number.
    pub ratio: Option<f64>,
    /// The assertion on this path: a tolerance or a statement.
    pub asserted: String,
    /// The declared reason why this path fails; `None` without a declaration.
    pub known_issue: Option<String>,
    /// A comparison of the tolerance with the errors that WGSL allows. `None` if the test declares no tolerance, or if
    /// Karat's engine can't run the function.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub allowed: Option<Allowance>,
    /// The distribution of the errors in a sample of cases. `None` if the check doesn't judge single cases, or if
    /// an older Karat wrote the record.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub errors: Option<Errors>,
    /// The errors and arguments in a sample of cases; `None` if the path passes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plot: Option<Plot>,
    /// A failing sampler's samples for its worst arguments, counted in cells of the support; `None` in all other
    /// records.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub histogram: Option<Histogram>,
    /// Number of argument sets for which the check judged a sampler; `failures` of them failed. `None` if the
    /// check judges single cases, or if an older Karat wrote the record.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub configurations: Option<u64>,
    /// The smallest and the largest subgroup size; `None` if no pass depends on the size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subgroups: Option<[u32; 2]>,
}

impl PathRecord {
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

/// The errors that WGSL allows a function, compared with the tolerance of a check. If WGSL allows larger errors
/// than the tolerance, a correct driver may fail the check.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Allowance {
    /// Number of examined cases. Karat examines only a sample of all cases.
    pub cases: u64,
    /// Number of the examined cases in which WGSL allows a larger error than the tolerance.
    pub wider: u64,
    /// The largest error that WGSL allows, divided by the tolerance. `None` if the quotient isn't finite: either WGSL
    /// allows any result, or WGSL allows an error and the tolerance is 0.
    pub worst: Option<f64>,
    /// Number of cases in which WGSL allows any result; 0 if an older Karat wrote the record.
    #[serde(default)]
    pub unbounded: u64,
}

/// The selection and the result of a run: `run.json`, beside the run's records. If the file is missing, the run didn't
/// end, so the records of some tests may be missing, too.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Run {
    /// Version of the format, [`SCHEMA`].
    pub schema: u32,
    /// The selection of tests: a filter, packages, targets. If the list is empty, every test ran.
    pub selected: Vec<String>,
    /// `true` if every test passed and every module is valid. If this is `false`, some records may be missing: a test
    /// ends at its first failing check, so Karat doesn't record the test's later checks.
    pub passed: bool,
    /// Names of tests that failed, as the test runner printed the names. A test may also fail without a failing check,
    /// for example by a panic.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub failed: Vec<String>,
    /// Modules that aren't valid, including modules that no test uses.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub invalid: Vec<String>,
    /// The errors in the modules of `invalid`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub errors: Vec<ModuleError>,
    /// Packages that aren't valid, but have no module with an error. Such a package has no modules, or it requires
    /// Tint's verdict and Tint gave no verdict.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub invalid_packages: Vec<String>,
    /// Remarks that don't fail the run: modules that Tint rejects, or the reason why Karat didn't ask Tint.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub remarks: Vec<String>,
    /// Number of selected tests that the runner didn't run, because another test failed. The number is from the
    /// runner's output.
    #[serde(default, skip_serializing_if = "is_none")]
    pub not_run: u64,
    /// `true` if the runner stopped at a failing test without printing the number of tests that it skipped.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub stopped: bool,
}

/// An error in a module.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ModuleError {
    /// `file:line:column`; empty if the error has no position.
    pub place: String,
    /// The error's message.
    pub message: String,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn is_none(count: &u64) -> bool {
    *count == 0
}

impl Default for Run {
    /// A run of all tests, in which every test passed.
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
    const FILE: &'static str = "run.json";

    /// Writes `run.json` into a folder of records.
    ///
    /// # Errors
    /// Returns an error if the file can't be written.
    pub fn write(&self, folder: &Path) -> std::io::Result<()> {
        let text = serde_json::to_string(self).expect("a run is plain data");
        crate::image::write_whole(&folder.join(Self::FILE), text.as_bytes())
    }

    /// Reads `run.json` from a folder of records. If the folder has several runs, Karat reads the run that ended
    /// last. Returns `None` if there is no `run.json`.
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
    /// Returns an error if the file can't be read, or isn't of this version.
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

pub(crate) fn overlay() -> Option<String> {
    crate::settings::overlay().map(|folder| folder.display().to_string())
}

impl Allowance {
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
    /// `false` while the tests of this thread run a mutant instead of the package itself.
    static KEPT: Cell<bool> = const { Cell::new(true) };
}

/// A summary of the values that the checks of a test judged.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    /// Hash of all values that the checks judged, in the order of the checks.
    pub values: [u8; 32],
    /// The largest error divided by its tolerance; 0 for checks without a tolerance.
    pub ratio: f64,
}

thread_local! {
    /// The values that the checks of this thread have judged; `None` outside of [`unrecorded`].
    static SEEN: RefCell<Option<Seen>> = const { RefCell::new(None) };
}

/// Prints the name of the running test, and then `text`, which has the lines that a shader printed. A shader prints the
/// same lines on each path, so this function ignores a text that it has just printed.
pub(crate) fn tell_prints(text: &str) {
    thread_local! {
        static TOLD: RefCell<String> = const { RefCell::new(String::new()) };
    }
    TOLD.with_borrow_mut(|told| {
        // Mutants and counted runs repeat the lines that the tests print.
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

pub(crate) fn is_unrecorded() -> bool {
    SEEN.with_borrow(Option::is_some)
}

/// Within [`unrecorded`], adds the values that a check judged to the hash in [`Seen`], and stores `ratio` if it is the
/// largest so far. Each item of `rows` has the `u32` words of one result.
pub(crate) fn saw(rows: &mut dyn Iterator<Item = &[u32]>, ratio: f64) {
    SEEN.with_borrow_mut(|seen| {
        if let Some(seen) = seen {
            let mut hasher = blake3::Hasher::new();
            hasher.update(&seen.values);
            // WGSL may ignore a zero's sign (15.7.2), so -0 is hashed as 0. The smallest `i32` has the same bits
            // as -0.
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

/// Runs tests whose verdicts aren't about the package itself, such as the tests of a mutant. Karat doesn't store their
/// verdicts and failing inputs. Also returns a summary of the values that the tests' checks judged.
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

pub(crate) fn is_kept() -> bool {
    KEPT.get()
}

pub(crate) fn wanted() -> bool {
    is_kept() && crate::settings::record().is_some()
}

/// Appends a verdict to this process's file, if `KARAT_RECORD` names a folder.
///
/// # Panics
/// Panics if Karat can't write the record. Without the record, the report would be incomplete.
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

/// The extension of files that list tests whose frames Karat didn't draw.
const LEFT_OUT: &str = "left-out";

/// If the run is recorded, writes the test's name into a list of tests whose frames Karat didn't draw.
///
/// # Panics
/// Panics if Karat can't write the file.
pub(crate) fn leave_out(test: &str) {
    if let Some(folder) = crate::settings::record() {
        crate::image::append_line(&folder, LEFT_OUT, test);
    }
}

/// Reads the names of the tests whose frames weren't drawn (`KARAT_FRAMES=off`) from a folder of records.
///
/// # Errors
/// Returns an error if a file can't be read.
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

/// The reason why Karat can't read records.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The folder or a file can't be read.
    #[error("can't read the record `{path}`: {cause}")]
    Read {
        /// The folder or file.
        path: String,
        /// The reason.
        cause: std::io::Error,
    },
    /// A line isn't a record of this version.
    #[error("`{path}` line {line} isn't a record of version {SCHEMA}: {reason}")]
    Line {
        /// The file.
        path: String,
        /// The line, from 1.
        line: usize,
        /// The reason.
        reason: String,
    },
}

/// The records of a run.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// The folder of the records.
    pub folder: PathBuf,
    /// The verdicts of all processes, in an order that doesn't depend on their timing.
    pub records: Vec<Record>,
    /// The selection and the result of the run; `None` if there is no `run.json`.
    pub run: Option<Run>,
}

impl Recorded {
    /// Reads the records of a folder. If the folder has several runs, Karat reads the records of the run that ended
    /// last. If the folder has no runs, Karat reads the files in the folder itself. Returns `None` if the folder has no
    /// records and no `run.json`.
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
    /// Returns an error if a file can't be read, or a line isn't a record.
    pub fn read(folder: &Path) -> Result<Option<Self>, RecordError> {
        if !folder.is_dir() {
            return Ok(None);
        }
        // Another run may end at this moment. The lock keeps that run from removing these records.
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

/// Checks if a folder of records still has the folder of a killed run. The next run that begins removes such a folder.
#[must_use]
pub fn was_killed(records: &Path) -> bool {
    // A run that ended has no file `running`.
    folder::dead(records).iter().any(|run| run.join(folder::RUNNING).exists())
}

/// Reads the verdicts of a folder, as [`Recorded::read`] does.
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
/// Returns an error if the folder or a file can't be read, or a line isn't a record.
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
    /// In the record's names, replaces the characters that some report formats can't represent. Karat never writes such
    /// characters, but another program may have written the record.
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

    /// Sorts records by their subjects. Records with the same test and the same subject stay in the order of their
    /// checks.
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
