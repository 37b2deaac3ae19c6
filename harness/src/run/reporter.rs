//! Hands a verdict to its record and to the test that asked for it.

use std::collections::BTreeSet;
use std::fmt::Display;

use super::{KnownIssue, host, identity, replay};
use crate::diagnostic::Blamed;
use crate::diagnostic::FileRead;
use crate::dispatch::Watched;
use crate::output::visible;
use crate::record::{self, Details, PathRecord, Record, Stopwatch, Subject, Verdict};

/// Why a check fails, as far as its record is concerned.
pub trait Fails: Display + Blamed {
    /// True if values are wrong, or a declaration is: otherwise there is no verdict.
    fn is_verdict(&self) -> bool;

    /// True if the shader leaves nothing that could fail, such as a result that is the same for all inputs.
    fn is_vacuous(&self) -> bool {
        false
    }

    /// The same as data.
    fn details(&self) -> Details {
        Details::of(&self.to_string()).at(self.blame().message)
    }

    /// `file:line:column` of the function, where a failure knows it.
    fn location(&self) -> Option<String> {
        None
    }
}

/// What a check found that didn't fail.
pub(crate) trait Passed {
    /// Paths that fail as was declared.
    fn known_issues(&self) -> &[KnownIssue];
}

/// The record of a check, as it grows.
pub(crate) struct Report {
    pub(crate) subject: Subject,
    pub(crate) paths: Vec<PathRecord>,
    /// The files that its verdict depends on.
    pub(crate) read: Vec<FileRead>,
    /// How much of compute passes the sanitizer looked through.
    pub(crate) watched: Option<Watched>,
}

/// Judges something, and records how that ended unless `recorded` says then that it isn't to be.
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
    // Where no Rust test is that could go on, the failure is the test's.
    if result.is_err() && host::current().is_some() {
        replay::done();
    }
    result
}

/// Records that the running test couldn't begin: what declares it is wrong, so that no check could say so. The
/// subject's location is the place of what is wrong.
///
/// `message` is all that is wrong, for people, and `headline` is its first sentence.
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
        // A check that ends before its function runs has found it all the same.
        if let (Subject::Function { location, .. }, Some(known)) =
            (&mut self.subject, failure.and_then(E::location))
            && location.is_empty()
        {
            *location = known;
        }
        let failure = failure.map(|failure| (failure.to_string(), failure.details()));
        self.write(verdict, failure, stopwatch);
    }

    /// Writes it down with the message and the data of its failure.
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

/// The test fails with what is wrong.
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
