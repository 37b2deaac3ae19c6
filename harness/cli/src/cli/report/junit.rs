//! JUnit XML: one suite of functions and one of frames, with a case for each check.

use std::time::Duration;

use anyhow::Context;
use karat::record::{Record, Subject, Verdict};
use quick_junit::{NonSuccessKind, Report, TestCase, TestCaseStatus, TestSuite};

/// The file. Times are of each check, and their sums: checks run beside each other, so a run takes
/// less. A test that failed outside of Karat's checks is a case of its own, so that no reader
/// takes the run for a success.
pub(super) fn text(records: &[Record], passed: bool) -> anyhow::Result<String> {
    let mut report = Report::new("karat");
    let mut functions = TestSuite::new("functions");
    let mut frames = TestSuite::new("frames");
    for record in records {
        match record.subject {
            Subject::Function { .. } => functions.add_test_case(case(record)),
            Subject::Frame { .. } => frames.add_test_case(case(record)),
        };
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
    let failed = records.iter().any(super::tables::is_failure);
    if !passed && !failed {
        let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
        status.set_message("a test failed outside of Karat's checks, or the run didn't end");
        let mut rest = TestSuite::new("tests");
        rest.add_test_case(TestCase::new("cargo test", status));
        report.add_test_suite(rest);
    }
    report.to_string().context("the report isn't XML")
}

fn case(record: &Record) -> TestCase {
    let mut status = match record.verdict {
        Verdict::Pass | Verdict::KnownIssue => TestCaseStatus::success(),
        Verdict::Fail => TestCaseStatus::non_success(NonSuccessKind::Failure),
        Verdict::Error => TestCaseStatus::non_success(NonSuccessKind::Error),
    };
    if let Some(message) = super::message(record) {
        status.set_message(message.lines().next().unwrap_or_default());
        status.set_description(message);
    }
    let mut case = TestCase::new(super::subject(record), status);
    case.set_classname(record.test.as_str());
    if let Some(time) = &record.time {
        // Whatever can't be read is no reason to lose a verdict.
        case.timestamp = time.started.parse().ok();
        case.time = Duration::try_from_secs_f64(time.seconds).ok();
    }
    let mut lines: Vec<String> = Vec::new();
    for path in &record.paths {
        let known = path.known_issue.as_ref().map(|why| format!("; known issue: {why}"));
        lines.push(format!(
            "{}: {} cases, {} failed, {} ({}){}",
            path.adapter.path,
            path.cases,
            path.failures,
            path.worst,
            path.asserted,
            known.unwrap_or_default()
        ));
    }
    lines.extend(super::replays(record).first().map(|command| format!("replay: {command}")));
    if !lines.is_empty() {
        case.set_system_out(lines.join("\n"));
    }
    case
}
