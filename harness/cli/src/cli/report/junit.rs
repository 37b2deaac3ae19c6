//! JUnit XML: a suite of functions and a suite of frames, with one case for each check on each path.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use karat::unstable::output::{name as name_of, one_line, visible};
use karat::unstable::record::{PathDetails, PathRecord, Record, Subject, Verdict};
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite, XmlString};

use super::{Names, Sum, facts, failing, pictures, place, relative, replays, workspace};
use crate::cli::project::Project;

/// Returns the XML text, with the time of each check and the sums of the times. A run takes less time than the sum,
/// because checks run in parallel. A test that failed outside of Karat's checks gets a test case of its own, so that
/// the run counts as failed.
pub(super) fn text(records: &[Record], sum: &Sum, project: &Project) -> anyhow::Result<String> {
    let names = Names::of(records);
    let mut unique = Unique::default();
    let mut report = Report::new("karat");
    let mut functions = TestSuite::new("functions");
    let mut frames = TestSuite::new("frames");
    for record in records {
        let suite = match record.subject {
            Subject::Function { .. } => &mut functions,
            Subject::Frame { .. } => &mut frames,
        };
        for mut case in cases(record, &names, project)? {
            unique.name(&mut case);
            suite.add_test_case(case);
        }
    }
    for mut suite in [functions, frames].into_iter().filter(|suite| !suite.test_cases.is_empty()) {
        suite.timestamp = suite.test_cases.iter().filter_map(|case| case.timestamp).min();
        suite.time =
            suite.test_cases.iter().filter_map(|case| case.time).reduce(Duration::saturating_add);
        report.add_test_suite(suite);
    }
    report.timestamp = report.test_suites.iter().filter_map(|suite| suite.timestamp).min();
    report.time =
        report.test_suites.iter().filter_map(|suite| suite.time).reduce(Duration::saturating_add);
    let mut rest = TestSuite::new("tests");
    let outside = "the test failed outside of Karat's checks, or didn't end";
    let tests = sum.outside().iter().map(|name| (name.as_str(), outside));
    let others = sum.others().iter().map(|why| ("karat test", why.as_str()));
    for (name, why) in tests.chain(others) {
        let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
        status.set_message(&*one_line(why));
        let mut case = TestCase::new(&*name_of(name), status);
        unique.name(&mut case);
        rest.add_test_case(case);
    }
    if !rest.test_cases.is_empty() {
        report.add_test_suite(rest);
    }
    report.to_string().context("the report isn't XML")
}

/// The class and the name of each JUnit case so far. If the name of the next case is already taken, Karat adds a
/// number: `name #2`. A test may check a function several times, and programs that read the file show only the first
/// case of a name.
#[derive(Default)]
struct Unique(BTreeSet<(String, String)>);

impl Unique {
    fn name(&mut self, case: &mut TestCase) {
        let class = case.classname.as_ref().map_or("", XmlString::as_str).to_owned();
        let own = case.name.as_str().to_owned();
        let numbered = (2_u64..).map(|number| format!("{own} #{number}"));
        let mut names = std::iter::once(own.clone()).chain(numbered);
        let free = names.find(|name| self.0.insert((class.clone(), name.clone())));
        case.name = XmlString::new(free.unwrap_or(own));
    }
}

/// Returns one JUnit case for each path of a check. A check that ran on no path gets one JUnit case.
fn cases(record: &Record, names: &Names, project: &Project) -> anyhow::Result<Vec<TestCase>> {
    let workspace = workspace(project.root());
    let attached = attached(record, names, project, &workspace)?;
    let paths: Vec<Option<&PathRecord>> = match record.paths.as_slice() {
        [] => vec![None],
        paths => paths.iter().map(Some).collect(),
    };
    let shares = u32::try_from(paths.len()).unwrap_or(u32::MAX);
    let place = place(record, project.root(), &workspace);
    let of = |path: Option<&PathRecord>| {
        let kind = match record.verdict {
            Verdict::Pass | Verdict::KnownIssue => None,
            Verdict::Fail => {
                path.is_none_or(|path| is_guilty(path, record)).then_some(NonSuccessKind::Failure)
            }
            Verdict::Error => Some(NonSuccessKind::Error),
        };
        let mut lines: Vec<String> = path.map(line).into_iter().collect();
        let mut status = kind.map_or_else(TestCaseStatus::success, TestCaseStatus::non_success);
        if kind.is_some()
            && let Some(message) = &record.message
        {
            let said = record.details.as_ref().map_or(&**message, |details| &details.headline);
            status.set_message(&*one_line(said.lines().next().unwrap_or_default()));
            status.set_description(&*visible(message));
            lines.extend(facts_on(record, path));
            // Readers expect one attachment per line.
            lines.extend(attached.iter().map(|file| format!("[[ATTACHMENT|{file}]]")));
        }
        let on = path.map(|path| format!(" on {}", path.adapter.path)).unwrap_or_default();
        let mut case = TestCase::new(format!("{}{on}", names.subject(record)), status);
        case.set_classname(classname(record));
        if let Some(place) = &place {
            case.extra.insert(XmlString::new("file"), XmlString::new(&*one_line(&place.file)));
            case.extra.insert(XmlString::new("line"), XmlString::new(place.line.to_string()));
        }
        if let Some(time) = &record.time {
            // A time that can't be read doesn't lose the verdict. The time of each path is unknown, so all paths get
            // equal shares.
            case.timestamp = time.started.parse().ok();
            case.time =
                Duration::try_from_secs_f64(time.seconds).ok().map(|time| time / shares.max(1));
        }
        if !lines.is_empty() {
            let lines: Vec<_> = lines.iter().map(|line| one_line(line)).collect();
            case.set_system_out(lines.join("\n"));
        }
        case
    };
    Ok(paths.into_iter().map(of).collect())
}

/// Returns the name of the test. In a Cargo package, the package comes first: `package::test`.
fn classname(record: &Record) -> String {
    match record.cargo_package.as_str() {
        "" => record.test.clone(),
        package => format!("{package}::{}", record.test),
    }
}

/// Checks if this path makes the check fail: cases fail on the path, or a known issue no longer occurs. If no
/// path makes the check fail, returns `true` for each path.
fn is_guilty(path: &PathRecord, record: &Record) -> bool {
    let guilty = |path: &PathRecord| (path.failures > 0) != path.known_issue.is_some();
    guilty(path) || !record.paths.iter().any(guilty)
}

/// Returns the details of a failure on this path. If the record has no details for this path, returns only the first
/// replay command.
fn facts_on(record: &Record, path: Option<&PathRecord>) -> Vec<String> {
    let faults = || record.details.iter().flat_map(|details| &details.paths);
    let is_own =
        |details: &&PathDetails| path.is_some_and(|path| details.adapter.path == path.adapter.path);
    let own: Vec<String> = faults().filter(is_own).flat_map(facts).collect();
    if own.is_empty() {
        return replays(record)
            .first()
            .map(|command| format!("replay: {command}"))
            .into_iter()
            .collect();
    }
    own
}

fn line(path: &PathRecord) -> String {
    let known = path.known_issue.as_ref().map(|why| format!("; known issue: {why}"));
    format!(
        "{}: {}, {} ({}){}",
        path.adapter.path,
        failing(path),
        path.worst,
        path.asserted,
        known.unwrap_or_default()
    )
}

/// Returns the pictures of a failing frame. The drawn frame is first, because GitLab shows only one picture.
fn attached(
    record: &Record,
    names: &Names,
    project: &Project,
    workspace: &Path,
) -> anyhow::Result<Vec<String>> {
    let folder = project.output().join("report");
    pictures::clear(record, names, &folder)?;
    if !super::is_failure(record) {
        return Ok(Vec::new());
    }
    let mut pictures = pictures::write(record, names, project, &folder)?;
    pictures.sort_by_key(|(what, _)| *what != "actual");
    Ok(pictures.iter().map(|(_, file)| relative(file, workspace)).collect())
}
