//! `karat report`, and the reports of a run: an HTML page, JSON, JUnit XML, annotations and a summary for GitHub.

pub(super) mod colour;
mod github;
mod html;
mod junit;
pub(super) mod merge;
pub(super) mod names;
mod pictures;
pub(super) mod short;
pub(super) mod sum;
pub(super) mod tables;

use std::collections::BTreeSet;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use karat::Package;
use karat::unstable::image::write_whole;
use karat::unstable::output::{counted, visible, visible_json};
use karat::unstable::package::FunctionItem;
use karat::unstable::record::{
    CaseDetails, Details, PathDetails, PathRecord, Record, Recorded, Run, SCHEMA, Subject,
    was_killed,
};
use karat::unstable::reflect::Opinion;
use karat_suite::{Suite, Test};

use karat_review::{Failure, FrameRun, LastRun};

pub(super) use self::github::Held;
pub(super) use self::github::{runs_here as runs_on_github, summarise, write_warnings};
use self::html::Beside;
pub(super) use self::names::Names;
pub(super) use self::sum::Sum;
pub(super) use self::tables::is_failure;
use super::list::callable;
use super::project::Project;
use super::{NotThere, Outcome, spare};

/// The options for all reports except the printed tables.
#[derive(clap::Args)]
pub(super) struct OutputArgs {
    /// Writes JUnit XML to this file
    #[arg(long, value_name = "FILE")]
    junit: Option<PathBuf>,
    /// Writes the HTML report to this file, one page that needs no other files: verdicts, errors, plots of failures
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    /// Writes all records as JSON to this file
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Links the HTML report to the page of frames at this URL, which `karat review --static` writes
    #[arg(long, value_name = "URL", requires = "html")]
    review: Option<String>,
    /// Links the HTML report to the page of translations at this URL, which `karat matrix --html` writes
    #[arg(long, value_name = "URL", requires = "html")]
    matrix: Option<String>,
    /// Finds hazards as `karat hazards` does, and shows the hazards on the HTML page
    #[arg(long, requires = "html")]
    hazards: bool,
    /// Prints a line for each check that passes, in place of one line per module
    #[arg(long)]
    pub(super) all: bool,
    /// Prints, for editors, only one line per failure, `file:line:column: error: message`, and the number of failures
    #[arg(long, conflicts_with_all = ["all", "github"])]
    pub(super) short: bool,
    /// Prints failures as GitHub annotations, and adds them to the job's summary [default: on if GITHUB_ACTIONS is
    /// `true`]
    #[arg(long)]
    github: bool,
}

#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    output: OutputArgs,
    /// Reads this folder of records, or the last run of the project in this folder [default: the current project]
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    /// Merges these folders, into which `karat record --into` wrote the parts of one run; may be repeated
    #[arg(long, value_name = "DIR", num_args = 1.., conflicts_with = "record")]
    merge: Vec<PathBuf>,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let project = Project::last_tested()?;
    // The path is a folder of records, or a project that has such a folder.
    let of_project =
        |folder: &Path| anyhow::Ok(Recorded::read(&Project::around(folder)?.record())?);
    let recorded = |folder: &Path| {
        let found = match Recorded::read(folder)? {
            None if folder.is_dir() => of_project(&folder.canonicalize()?)?,
            found => found,
        };
        found.ok_or_else(|| {
            let why = format!(
                "there is no record of a run in `{}`: run `karat test` first",
                folder.display()
            );
            anyhow::Error::from(NotThere(why))
        })
    };
    let folder = args.record.clone().unwrap_or_else(|| project.record());
    let (Recorded { folder, records, run }, reasons) = match args.merge.as_slice() {
        [] => (recorded(&folder)?, Vec::new()),
        folders => {
            let places = folders.iter().map(|folder| folder.canonicalize().ok());
            let places: Vec<_> = places.collect();
            for (at, folder) in folders.iter().enumerate() {
                let twice = places[at].is_some() && places[..at].contains(&places[at]);
                anyhow::ensure!(
                    !twice,
                    "--merge names `{}` twice: name each folder once",
                    folder.display()
                );
            }
            let parts: Vec<Recorded> =
                folders.iter().map(|folder| recorded(folder)).collect::<anyhow::Result<_>>()?;
            for part in &parts {
                args.output.spare(&part.folder)?;
            }
            (merge::merged(&parts), merge::missing(&parts))
        }
    };
    args.output.spare(&folder)?;
    if run.as_ref().is_none_or(|run| run.passed) {
        tables::expect_some(&records, None)?;
    }
    let mut sum = reasons.into_iter().fold(Sum::of(&records, run.as_ref()), Sum::with);
    if args.merge.is_empty() && args.record.is_none() && was_killed(&project.record()) {
        let why = "the last run was stopped early, so this report shows an earlier run";
        sum = sum.with(why.to_owned());
    }
    let held = args.output.hold_commands(out)?;
    let mut unread = std::io::sink();
    let told: &mut dyn Write = if args.output.short { &mut unread } else { &mut *out };
    tables::write(&records, args.output.all, told)?;
    tables::write_sum(&records, &sum, &folder, told)?;
    if args.output.short {
        short::write(&records, (&[], &Opinion::default()), &sum, project.root(), out)?;
    }
    if run.is_none() {
        writeln!(
            out,
            "the record shows the end of a run only if `karat test` or `karat record` ran the tests: use one of these commands"
        )?;
    }
    args.output.write(&records, run.as_ref(), &sum, held, &project, out)?;
    Ok(sum.ending())
}

/// Writes an HTML page of records, each of which covers one path. The page shows the paths of a check side by side.
pub(super) fn write_page(
    records: Vec<Record>,
    project: &Project,
    page: &Path,
) -> anyhow::Result<()> {
    let records = merge::side_by_side(records);
    let packages = project.tested(&records)?;
    let untested = Some(names(untested(&records, &packages)?));
    let run = Run { passed: !records.iter().any(is_failure), ..Run::default() };
    let sum = Sum::of(&records, Some(&run));
    let text = html::page(&records, Some(&run), &sum, &Beside { untested, ..Beside::default() });
    let folder = page.parent().unwrap_or(page);
    std::fs::create_dir_all(folder)
        .and_then(|()| write_whole(page, visible(&text).as_bytes()))
        .with_context(|| format!("can't write `{}`", page.display()))
}

impl OutputArgs {
    /// Returns an error if a report would replace a file of the record, or if two reports would have the same file.
    pub(super) fn spare(&self, record: &Path) -> anyhow::Result<()> {
        let whole = |file| std::path::absolute(file).unwrap_or_else(|_| PathBuf::from(file));
        let files: Vec<PathBuf> = self.files().map(whole).collect();
        let twice = files.iter().enumerate().find(|(at, file)| files[..*at].contains(file));
        if let Some((_, file)) = twice {
            anyhow::bail!("two reports have the same file `{}`: use two files", file.display());
        }
        let entries = std::fs::read_dir(record).into_iter().flatten().flatten();
        let record: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        self.files().try_for_each(|file| {
            spare(
                "report",
                file,
                record.iter().map(PathBuf::as_path).filter(|path| {
                    let is_report = |ending: &std::ffi::OsStr| ending == "xml" || ending == "html";
                    !path.extension().is_some_and(is_report)
                }),
            )
        })
    }

    fn files(&self) -> impl Iterator<Item = &Path> {
        [&self.junit, &self.html, &self.json].into_iter().flatten().map(PathBuf::as_path)
    }

    /// Makes GitHub's runner ignore commands in the output, because names and messages of tests may look like commands.
    /// The runner obeys commands again before Karat prints its own commands.
    pub(super) fn hold_commands(&self, out: &mut dyn Write) -> std::io::Result<Held> {
        if github::runs_here() && !self.short { Held::begin(out) } else { Ok(Held::default()) }
    }

    /// Removes the reports of an earlier run, because this run may end before it writes its own reports.
    pub(super) fn clear(&self) -> anyhow::Result<()> {
        // Devices, pipes and links stay. Only a regular file can be the report of an earlier run.
        let is_file = |file: &&Path| file.symlink_metadata().is_ok_and(|found| found.is_file());
        self.files().filter(is_file).try_for_each(|file| match std::fs::remove_file(file) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
                Err(error).with_context(|| format!("can't replace `{}`", file.display()))
            }
            _ => Ok(()),
        })
    }

    pub(super) fn write(
        &self,
        records: &[Record],
        run: Option<&Run>,
        sum: &Sum,
        held: Held,
        project: &Project,
        out: &mut dyn Write,
    ) -> anyhow::Result<()> {
        held.release(out)?;
        let write = |file: &Path, text: &str| {
            let shown = match self.json.as_deref() == Some(file) {
                true => visible_json(text),
                false => visible(text),
            };
            write_whole(file, shown.as_bytes())
                .with_context(|| format!("can't write `{}`", file.display()))
        };
        if let Some(file) = &self.json {
            let all = serde_json::json!({ "schema": SCHEMA, "run": run, "records": records });
            write(file, &serde_json::to_string_pretty(&all).context("records are plain data")?)?;
        }
        if let Some(file) = &self.html {
            let packages = project.tested(records)?;
            // Functions that a filter excluded don't count as untested.
            let whole = run.is_some_and(|run| run.selected.is_empty());
            let untested = whole.then(|| untested(records, &packages)).transpose()?.map(names);
            let look =
                || packages.iter().map(|package| karat_inspect::hazards(package).run()).collect();
            let hazards = self.hazards.then(look).transpose()?;
            let (review, matrix) = (self.review.as_deref(), self.matrix.as_deref());
            let beside = Beside { untested, hazards, review, matrix };
            write(file, &html::page(records, run, sum, &beside))?;
        }
        if self.github || (github::runs_here() && !self.short) {
            let errors = run.map_or(&[][..], |run| &run.errors);
            github::write(records, (sum, errors), project, out)?;
        }
        // GitHub's summary deletes old pictures. The JUnit file names the new pictures, so it is written afterwards.
        if let Some(file) = &self.junit {
            write(file, &junit::text(records, sum, project)?)?;
        }
        Ok(())
    }
}

/// Returns the functions that no check tests and no WGSL test calls.
pub(super) fn untested(
    records: &[Record],
    packages: &[Package],
) -> anyhow::Result<Vec<FunctionItem>> {
    let tested: BTreeSet<&str> = records
        .iter()
        .filter_map(|record| match &record.subject {
            Subject::Function { function, .. } => Some(function.as_str()),
            Subject::Frame { .. } => None,
        })
        .collect();
    let mut all = Vec::new();
    for package in packages {
        // Other commands report invalid modules. The tests of an unreadable module can't run, so its functions don't
        // count as untested.
        let Ok(modules) = package.modules() else { continue };
        if modules.iter().any(|module| package.functions_in(module).is_err()) {
            continue;
        }
        let Ok(items) = callable(package) else { continue };
        let suite = Suite::of(package.clone()).ok();
        let tests = suite.iter().flat_map(|suite| &suite.tests);
        let ran = tests.filter(|test| tested.contains(test.name.as_str()));
        let called: BTreeSet<&str> = ran.flat_map(Test::calls).collect();
        let items = items.into_iter().filter(|item| !called.contains(item.name.as_str()));
        all.extend(items.filter(|item| !tested.contains(item.name.as_str())));
    }
    Ok(all)
}

fn names(items: Vec<FunctionItem>) -> Vec<String> {
    items.into_iter().map(|item| item.name).collect()
}

/// Returns the number of failures on a path: `3 of 4096 cases`, or `2 of 8 configurations` for a sampler. A sampler is
/// judged once per configuration.
fn failing(path: &PathRecord) -> String {
    match path.configurations {
        Some(all) => format!("{} of {}", path.failures, counted(all, "configuration")),
        None => format!("{} of {}", path.failures, counted(path.cases, "case")),
    }
}

/// Returns the tests that failed by a panic or another assertion, although all their checks passed. `failed` has the
/// names of all failed tests.
fn outside(records: &[Record], failed: &[String]) -> Vec<String> {
    let by_check: BTreeSet<&str> = records
        .iter()
        .filter(|record| is_failure(record))
        .map(|record| record.test.as_str())
        .collect();
    failed.iter().filter(|test| !by_check.contains(&***test)).cloned().collect()
}

/// Returns the data of a run for the review: the test that compared each golden, and the failing checks of functions.
pub(super) fn review_of(records: &[Record]) -> LastRun {
    let (mut run, names) = (LastRun::default(), Names::of(records));
    for record in records {
        let replays = replays(record);
        let test = record.test.clone();
        match &record.subject {
            Subject::Frame { golden, location, .. } => {
                let module = |file: &&PathBuf| {
                    file.extension().is_some_and(|kind| kind == "wgsl" || kind == "wesl")
                };
                let modules =
                    record.read.iter().map(|read| &read.file).filter(module).cloned().collect();
                let frame = FrameRun { test, place: location.clone(), replays, modules };
                // Several tests may compare the same golden. The failing test made the pending frame.
                if is_failure(record) || !run.frames.contains_key(golden) {
                    run.frames.insert(golden.clone(), frame);
                }
            }
            Subject::Function { location, .. } if is_failure(record) => {
                run.failures.push(Failure {
                    name: names.subject(record),
                    test,
                    place: location.clone(),
                    message: record.message.clone().unwrap_or_default(),
                    replays,
                    ratio: record.paths.iter().filter_map(|path| path.ratio).reduce(f64::max),
                    figures: html::figures(record).into_string(),
                })
            }
            Subject::Function { .. } => {}
        }
    }
    run
}

/// Returns the shell commands that replay a failure. The first command is for the worst case.
fn replays(record: &Record) -> Vec<String> {
    record.details.iter().flat_map(Details::replays).map(ToString::to_string).collect()
}

/// Returns the lines of [`values`] for a path, and the command that replays the path's worst case.
fn facts(details: &PathDetails) -> Vec<String> {
    let mut lines = values(details);
    lines.extend(details.replays().next().map(|replay| format!("replay: {replay}")));
    lines
}

/// Returns lines with the worst, first and simplest failing case of a path, and with the failing expectations.
fn values(details: &PathDetails) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for case in [&details.worst, &details.first, &details.simplest].into_iter().flatten() {
        let expectations = case.expectations.iter().map(ToString::to_string);
        for line in std::iter::once(in_a_line(case)).chain(expectations) {
            if !line.is_empty() && !lines.contains(&line) {
                lines.push(line);
            }
        }
    }
    lines
}

/// Formats a case: `x = 2; returned = (1, 3); .y = 3; expected = 2; error = 1 (0.5 allowed)`.
fn in_a_line(case: &CaseDetails) -> String {
    let CaseDetails { arguments, result, component, actual, expected, error, .. } = case;
    let part = if component.is_empty() { "" } else { actual };
    let others =
        [("returned", &**result), (component, part), ("expected", expected), ("error", error)];
    let others = others.into_iter().filter(|(_, value)| !value.is_empty());
    let arguments = arguments.iter().map(|(name, value)| (&**name, &**value));
    let parts = arguments.chain(others).map(|(name, value)| format!("{name} = {value}"));
    parts.collect::<Vec<_>>().join("; ")
}

/// The location of a failure. The file is relative to the project or to the repository.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Place {
    pub(super) file: String,
    pub(super) line: u32,
    /// The number of the character in its line, counted from 1.
    pub(super) column: u32,
}

impl Place {
    pub(super) fn of(text: &str) -> Option<Self> {
        let mut parts = text.rsplitn(3, ':');
        let (column, line, file) = (parts.next()?, parts.next()?, parts.next()?);
        Some(Self { file: file.to_owned(), line: line.parse().ok()?, column: column.parse().ok()? })
    }
}

/// Returns the location of a failure: the location in its message, or otherwise the location of the tested function or
/// frame.
fn wrong_place(record: &Record, root: &Path, workspace: &Path) -> Option<Place> {
    let told = || located(record.details.as_ref()?.place.as_deref()?, root, workspace);
    told().or_else(|| place(record, root, workspace))
}

/// Returns the location of the tested WGSL function, or of the test that draws the frame. If the location of this test
/// is unknown, returns the location of the golden's provenance. Paths are relative to the workspace.
fn place(record: &Record, root: &Path, workspace: &Path) -> Option<Place> {
    let located = |location: &str, package| {
        located(location, package, workspace).or_else(|| of_read(location, record, workspace))
    };
    match &record.subject {
        Subject::Function { location, package, .. } => located(location, Path::new(package)),
        Subject::Frame { golden, folder, location } => {
            let facts = || {
                let facts = Path::new(folder).join(format!("{golden}.toml"));
                let is_there = !folder.is_empty() && facts.is_file();
                is_there.then(|| Place { file: relative(&facts, workspace), line: 1, column: 1 })
            };
            located(location, root).or_else(facts)
        }
    }
}

/// The variables that contain the repository's folder on GitHub, GitLab and Jenkins.
const WORKSPACES: [&str; 3] = ["GITHUB_WORKSPACE", "CI_PROJECT_DIR", "WORKSPACE"];

/// Returns the folder that paths in reports for CI are relative to. Tries, in this order: the folder that CI names, if
/// it contains the project; the repository's folder of git; the working directory, if it contains the project; and the
/// project's folder.
fn workspace(root: &Path) -> PathBuf {
    let whole = |folder: &Path| folder.canonicalize().ok();
    let named = WORKSPACES.iter().filter_map(std::env::var_os).filter(|folder| !folder.is_empty());
    let holds = |folder: &PathBuf| {
        whole(root).zip(whole(folder)).is_some_and(|(root, folder)| root.starts_with(folder))
    };
    let of_git = || {
        let root = whole(root)?;
        root.ancestors().find(|folder| folder.join(".git").exists()).map(Path::to_owned)
    };
    let here = || std::env::current_dir().ok().filter(holds);
    let found = named.map(PathBuf::from).find(holds).or_else(of_git).or_else(here);
    found.unwrap_or_else(|| root.to_owned())
}

/// Resolves `file:line:column`. The file may be relative to the package or to any folder above it: tests run in their
/// package's folder, and the compiler runs in the workspace.
pub(super) fn located(location: &str, package: &Path, workspace: &Path) -> Option<Place> {
    let place = Place::of(location)?;
    let mut files = package.ancestors().map(|folder| folder.join(&place.file));
    let file = files.find(|path| path.is_file())?;
    Some(Place { file: relative(&file, workspace), ..place })
}

/// Resolves `file:line:column` if the file is one that a record depends on. The record may come from a project in
/// another folder.
fn of_read(location: &str, record: &Record, workspace: &Path) -> Option<Place> {
    let file = Path::new(location.rsplitn(3, ':').nth(2)?);
    let read = record.read.iter().map(|read| &read.file).find(|read| read.ends_with(file))?;
    let above = read.ancestors().nth(file.components().count())?;
    located(location, above, workspace)
}

/// Returns a relative path with `/`, as GitHub requires.
fn relative(file: &Path, root: &Path) -> String {
    let (file, root) = match (file.canonicalize(), root.canonicalize()) {
        (Ok(file), Ok(root)) => (file, root),
        _ => (file.to_owned(), root.to_owned()),
    };
    let file = file.strip_prefix(&root).unwrap_or(&file);
    file.display().to_string().replace('\\', "/")
}
