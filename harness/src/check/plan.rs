//! What every check is made of, whatever its verb, and how it ends in a verdict and its record.

use super::memory::Memory;
use super::path_tally::PathTally;
use super::session::{Asserted, Demand, Session};
use super::tolerances::{self, Tolerances};
use super::{Agreement, Failure, Identity, KnownIssues, Probe, inputs, replay};
use crate::domain::Stream;
use crate::output::visible;
use crate::path::Path;
use crate::record::{self, PathRecord, Record, Stopwatch, Subject, Verdict};
use crate::tolerance::{Measure, Tolerance};

/// A function with what its author says of a check, but for the cases.
#[derive(Clone, Debug)]
pub(super) struct Plan<'a> {
    pub(super) probe: Probe<'a>,
    pub(super) cases: Option<u64>,
    pub(super) seed: Option<u64>,
    pub(super) tolerance_on: Vec<(Path, Tolerance)>,
    pub(super) known_issues: KnownIssues,
}

/// Whether a verdict goes into the record of the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Recording {
    On,
    Off,
}

/// What a verb does with a session.
pub(super) type Body<'b> = &'b mut dyn FnMut(&Session<'_>) -> Result<Vec<PathTally>, Failure>;

impl<'a> Plan<'a> {
    pub(super) fn new(probe: Probe<'a>) -> Self {
        let (tolerance_on, known_issues) = (Vec::new(), KnownIssues::default());
        Self { probe, cases: None, seed: None, tolerance_on, known_issues }
    }

    /// A verb's tolerance with those of single paths.
    pub(super) fn tolerances(&self, general: Tolerance) -> Tolerances {
        Tolerances { general, on: self.tolerance_on.clone() }
    }

    /// Prepares the session, runs a verb and records its verdict.
    pub(super) fn conclude(
        &self,
        asserted: &Asserted,
        stream: &dyn Stream,
        demand: &Demand,
        recording: Recording,
        verb: Body<'_>,
    ) -> Result<Agreement, Failure> {
        let stopwatch = Stopwatch::start();
        let Asserted { check, text } = asserted;
        let function = self.probe.path.clone();
        let identity = Identity::of(&function, check)?;
        let seed = self.seed.unwrap_or_else(|| identity.seed(&function, &identity.check));
        let mut subject = Subject::Function {
            package: self.probe.package.root().display().to_string(),
            function,
            check: (*check).to_owned(),
            assertion: text.clone(),
            location: String::new(),
            seed,
        };
        let mut paths = Vec::new();
        let mut run = || {
            self.known_issues.expect_reasons(&self.probe.path)?;
            inputs::each(self, &identity, &mut |inputs| {
                let own = |(path, own): &(Path, Tolerance)| format!("; on {path} {own}");
                let own: String = self.tolerance_on.iter().map(own).collect();
                let asserted = Asserted { check, text: format!("{text}{own}") };
                let session =
                    Session::open(self, stream, demand, &identity, seed, asserted, inputs)?;
                // What is declared to fail needn't be remembered.
                let remembered = recording == Recording::On && self.known_issues.is_empty();
                let memory = Memory::open(&identity).filter(|_| remembered);
                let session = session.remembering(memory);
                if let Subject::Function { location, .. } = &mut subject {
                    *location = session.called.function().span.to_string();
                }
                let tallies = verb(&session)?;
                let text = format!("{text}{}", inputs.remark());
                paths.extend(tallies.iter().map(|tally| self.record(tally, &text)));
                self.verdict(&session, tallies)
            })
        };
        let result = run();
        if recording == Recording::Off {
            return result;
        }
        let (verdict, message) = match &result {
            Ok(agreement) if agreement.known_issues.is_empty() => (Verdict::Pass, None),
            Ok(_) => (Verdict::KnownIssue, None),
            Err(failure @ (Failure::Disagreement(_) | Failure::UnexpectedPass { .. })) => {
                (Verdict::Fail, Some(failure.to_string()))
            }
            Err(failure) => (Verdict::Error, Some(failure.to_string())),
        };
        let test = identity.test;
        let (schema, overlay) = (record::SCHEMA, record::overlay());
        let time = Some(stopwatch.time());
        record::write(&Record { schema, test, subject, verdict, paths, message, overlay, time });
        result
    }

    /// Judges the paths that are to pass; of those that are declared to fail, wants a failure.
    fn verdict(
        &self,
        session: &Session<'_>,
        tallies: Vec<PathTally>,
    ) -> Result<Agreement, Failure> {
        let function = &session.called.function().path;
        let (judged, known) = self.known_issues.split(tallies);
        let mut agreement = if judged.is_empty() && !known.is_empty() {
            let cases = known.iter().map(|tally| tally.tally.census.cases).min().unwrap_or(0);
            let (function, paths) = (function.clone(), Vec::new());
            Agreement { function, cases, paths, worst: Measure::ZERO, known_issues: Vec::new() }
        } else {
            session.conclude(judged)?
        };
        // One case that is replayed may be one that passes.
        if !session.is_replay() {
            self.known_issues.expect_failures(function, &known)?;
        }
        agreement.known_issues = self.known_issues.seen(&known);
        Ok(agreement)
    }

    fn record(&self, tally: &PathTally, assertion: &str) -> PathRecord {
        let asserted = match tolerances::own(&self.tolerance_on, tally.path) {
            Some(own) => format!("{assertion}; on {} {own}", tally.path),
            None => assertion.to_owned(),
        };
        let known_issue = self.known_issues.on(tally.path).map(str::to_owned);
        PathRecord { known_issue, ..tally.record(&asserted) }
    }
}

#[track_caller]
pub(super) fn or_panic<T>(result: Result<T, Failure>) -> T {
    match result {
        Ok(agreement) => agreement,
        Err(failure) => {
            replay::done();
            panic!("{}", visible(&failure.to_string()))
        }
    }
}
