//! Hands a verdict to its record and to the test that asked for it.

use std::collections::BTreeSet;
use std::fmt::Display;

use super::{KnownIssue, identity, replay};
use crate::diagnostic::FileRead;
use crate::output::visible;
use crate::record::{self, Fault, PathRecord, Record, Stopwatch, Subject, Verdict};

/// How a check ends, as far as its record is concerned.
pub(crate) trait Concluded {
    /// Pass, known issue, fail or error.
    fn verdict(&self) -> Verdict;
    /// What is wrong.
    fn message(&self) -> Option<String>;
    /// The same as data.
    fn fault(&self) -> Option<Fault> {
        self.message().map(|message| Fault::of(&message))
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

/// A check whose verdict is going to be recorded.
pub(crate) struct Reporter {
    stopwatch: Stopwatch,
}

impl Reporter {
    /// The check begins.
    pub(crate) fn start() -> Self {
        Self { stopwatch: Stopwatch::start() }
    }

    /// Records how it ended, and of which files.
    pub(crate) fn record(
        self,
        mut subject: Subject,
        paths: Vec<PathRecord>,
        read: impl IntoIterator<Item = FileRead>,
        concluded: &impl Concluded,
    ) {
        // A check that ends before its function runs has found it all the same.
        if let (Subject::Function { location, .. }, Some(known)) =
            (&mut subject, concluded.location())
            && location.is_empty()
        {
            *location = known;
        }
        record::write(&Record {
            schema: record::SCHEMA,
            test: identity::test(),
            cargo_package: identity::cargo_package(),
            subject,
            verdict: concluded.verdict(),
            paths,
            message: concluded.message(),
            fault: concluded.fault(),
            overlay: record::overlay(),
            read: read.into_iter().collect::<BTreeSet<_>>().into_iter().collect(),
            time: Some(self.stopwatch.time()),
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
