//! Writes a check's verdict to its record, and returns the verdict to the test.

use std::collections::BTreeSet;
use std::fmt::Display;

use super::{KnownIssue, host, identity, replay};
use crate::diagnostic::Blamed;
use crate::diagnostic::FileRead;
use crate::dispatch::Watched;
use crate::output::visible;
use crate::record::{self, Details, PathRecord, Record, Stopwatch, Subject, Verdict};

/// The reason why a check fails, with the information for the check's record.
pub trait Fails: Display + Blamed {
    /// Returns `true` if values or a declaration are wrong: the verdict in the record is `fail`. Otherwise the verdict
    /// is `error`.
    fn is_verdict(&self) -> bool;

    /// Checks if the check failed because it tests nothing, for example because the result is the same for all
    /// inputs.
    fn is_vacuous(&self) -> bool {
        false
    }

    /// The failure as data.
    fn details(&self) -> Details {
        Details::of(&self.to_string()).at(self.blame().message)
    }

    /// The location of the function as `file:line:column`, if the failure contains the location.
    fn location(&self) -> Option<String> {
        None
    }
}

/// The result of a check that passed.
pub(crate) trait Passed {
    /// The failures that occurred as declared.
    fn known_issues(&self) -> &[KnownIssue];
}

/// The record of a check while the check runs.
pub(crate) struct Report {
    pub(crate) subject: Subject,
    pub(crate) paths: Vec<PathRecord>,
    pub(crate) read: Vec<FileRead>,
    /// The part of the compute passes that the sanitizer checked; `None` if there are no passes.
    pub(crate) watched: Option<Watched>,
}

/// Runs a check. Then writes the check's record if `recorded` returns `true`.
pub(crate) fn reported<T: Passed, E: Fails>(
    subject: Subject,
    recorded: &dyn Fn() -> bool,
    judge: impl FnOnce(&mut Report) -> Result<T, E>,
) -> Result<T, E> {
    let stopwatch = Stopwatch::start();
    let mut report = Report { subject, paths: Vec::new(), read: Vec::new(), watched: None };
    let result = judge(&mut report);
    if recorded() {
        report.record(&stopwatch, &result);
    }
    // In a program that runs tests without Cargo, a failure always ends the test, so the test needs no message
    // about the replay.
    if result.is_err() && host::current().is_some() {
        replay::done();
    }
    result
}

/// Records that a test couldn't begin, because its declaration is wrong. No check ran. The location in `subject` is the
/// place of the error.
///
/// `message` is the whole error message, and `headline` is its first sentence.
pub fn record_unbegun(subject: Subject, headline: &str, message: &str) {
    let report = Report { subject, paths: Vec::new(), read: Vec::new(), watched: None };
    let details = Details { headline: headline.to_owned(), ..Details::default() };
    report.write(Verdict::Error, Some((message.to_owned(), details)), &Stopwatch::start());
}

impl Report {
    fn record<T: Passed, E: Fails>(mut self, stopwatch: &Stopwatch, result: &Result<T, E>) {
        let (verdict, failure) = match result {
            Ok(passed) if passed.known_issues().is_empty() => (Verdict::Pass, None),
            Ok(_) => (Verdict::KnownIssue, None),
            Err(failure) if failure.is_verdict() => (Verdict::Fail, Some(failure)),
            Err(failure) => (Verdict::Error, Some(failure)),
        };
        // If a check ends before its function runs, its failure may contain the function's place.
        if let (Subject::Function { location, .. }, Some(known)) =
            (&mut self.subject, failure.and_then(E::location))
            && location.is_empty()
        {
            *location = known;
        }
        let failure = failure.map(|failure| (failure.to_string(), failure.details()));
        self.write(verdict, failure, stopwatch);
    }

    fn write(self, verdict: Verdict, failure: Option<(String, Details)>, stopwatch: &Stopwatch) {
        let Self { subject, paths, read, watched } = self;
        let (message, details) = failure.unzip();
        record::write(&Record {
            schema: record::SCHEMA,
            test: identity::test(),
            cargo_package: identity::cargo_package(),
            subject,
            verdict,
            paths,
            message,
            details,
            watched,
            overlay: record::overlay(),
            read: read.into_iter().collect::<BTreeSet<_>>().into_iter().collect(),
            time: Some(stopwatch.time()),
        });
    }
}

/// Panics with the failure's message, so that the test fails.
#[track_caller]
pub(crate) fn or_panic<T, E: Display>(result: Result<T, E>) -> T {
    match result {
        Ok(agreement) => agreement,
        Err(error) => {
            replay::done();
            panic!("{}", visible(&error.to_string()))
        }
    }
}
