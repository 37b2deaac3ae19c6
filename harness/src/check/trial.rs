//! How a plan is carried out: its session, a verb, the verdict and its record.

use std::sync::atomic::{AtomicBool, Ordering};

use super::called::Refused;
use super::demand::Demand;
use super::path_tally::PathTally;
use super::plan::{Plan, Recording};
use super::session::{Asserted, Session};
use super::{Agreement, Census, Failure, inputs};
use crate::diagnostic::FileRead;
use crate::domain::Stream;
use crate::record::{PathRecord, Subject};
use crate::run::{Identity, Memory, Reporter, Seen};
use crate::tolerance::LaneError;

/// What a verb makes of the verdict before it is recorded.
pub(super) type Last<'l> =
    &'l mut dyn FnMut(Result<Agreement, Failure>, &mut Vec<FileRead>) -> Result<Agreement, Failure>;

/// What a verb does with a session.
pub(super) type Body<'b> = &'b mut dyn FnMut(&Session<'_>) -> Result<Vec<PathTally>, Failure>;

impl Plan<'_> {
    /// Prepares the session, runs a verb and records its verdict.
    pub(super) fn conclude(
        &self,
        asserted: &Asserted,
        stream: &dyn Stream,
        demand: &Demand,
        recording: Recording,
        verb: Body<'_>,
    ) -> Result<Agreement, Failure> {
        self.conclude_as(asserted, stream, demand, recording, verb, &mut |result, _| result)
    }

    /// The same for a verb that has the last word, and may read more files.
    pub(super) fn conclude_as(
        &self,
        asserted: &Asserted,
        stream: &dyn Stream,
        demand: &Demand,
        recording: Recording,
        verb: Body<'_>,
        last: Last<'_>,
    ) -> Result<Agreement, Failure> {
        let identity = Identity::of(&self.probe.name, asserted.check)?;
        let run = (&identity, &AtomicBool::new(false));
        self.conclude_unless(run, asserted, stream, demand, recording, (verb, last))
    }

    /// The same under an identity that several runs share, and without a record as long as another run
    /// may have the verdict.
    pub(super) fn conclude_unless(
        &self,
        (identity, withheld): (&Identity, &AtomicBool),
        asserted: &Asserted,
        stream: &dyn Stream,
        demand: &Demand,
        recording: Recording,
        (verb, last): (Body<'_>, Last<'_>),
    ) -> Result<Agreement, Failure> {
        let reporter = Reporter::start();
        let Asserted { check, text, .. } = asserted;
        let function = self.probe.name.clone();
        let seed = self.seed.unwrap_or_else(|| identity.seed(&function, &identity.check));
        let mut subject = Subject::Function {
            package: self.probe.root().display().to_string(),
            function,
            check: (*check).to_owned(),
            assertion: text.clone(),
            location: String::new(),
            domain: stream.described(),
            seed,
        };
        let mut paths = Vec::new();
        let mut read: Vec<_> = self.probe.module_file().into_iter().collect();
        let mut run = || {
            self.expect_reasons()?;
            inputs::each(self, identity, &mut |inputs| {
                let own = self.tolerance_on.iter().map(|(on, own)| format!("; on {on} {own}"));
                let own: String = own.collect();
                let text_of_paths = format!("{text}{own}");
                let remembers = asserted.remembers;
                let asserted = Asserted { text: text_of_paths, ..asserted.clone() };
                let session =
                    Session::open(self, stream, demand, identity, seed, asserted, inputs)?;
                // What is declared to fail needn't be remembered.
                let remembered = recording == Recording::On && self.known_issues.is_empty();
                let remembered = remembered && remembers;
                let memory = Memory::open(identity).filter(|_| remembered);
                let session = session.remembering(memory);
                if let Subject::Function { location, .. } = &mut subject {
                    *location = session.called.function().span.to_string();
                }
                read.extend(session.called.files(&self.probe.fixtures));
                let tallies = verb(&session)?;
                let text = format!("{text}{}", inputs.remark());
                paths.extend(tallies.iter().map(|tally| self.record(tally, &text)));
                let refused = session.called.refused.iter();
                paths.extend(refused.map(|refused| PathRecord {
                    known_issue:
                        self.known_issues.on(refused.path, &refused.adapter).map(str::to_owned),
                    ..refused.record(&text)
                }));
                self.verdict(&session, tallies)
            })
        };
        let result = run();
        let result = last(result, &mut read);
        if recording == Recording::On && !withheld.load(Ordering::Relaxed) {
            reporter.record(subject, paths, read, &result);
        }
        result
    }

    /// Judges the paths that are to pass; of those that are declared to fail, wants a failure.
    fn verdict(
        &self,
        session: &Session<'_>,
        tallies: Vec<PathTally>,
    ) -> Result<Agreement, Failure> {
        let (known, judged): (Vec<_>, Vec<_>) =
            tallies.into_iter().partition(|tally| self.known_issue(tally).is_some());
        let mut agreement = if judged.is_empty() && !known.is_empty() {
            let cases = known.iter().map(|tally| tally.tally.census.cases).min().unwrap_or(0);
            let (function, paths) = (self.probe.name.clone(), Vec::new());
            Agreement { function, cases, paths, worst: LaneError::ZERO, known_issues: Vec::new() }
        } else {
            session.conclude(judged)?
        };
        let refused = session.called.refused.iter().map(Refused::seen);
        let seen = known.into_iter().map(|PathTally { adapter, path, tally, .. }| {
            let Census { cases, failures, .. } = tally.census;
            Seen { adapter, path, cases, failures }
        });
        // One case that is replayed may be one that passes.
        agreement.known_issues = self.known(refused.chain(seen), session.is_replay())?;
        Ok(agreement)
    }

    /// Why the path of a tally is to fail.
    pub(super) fn known_issue(&self, tally: &PathTally) -> Option<&str> {
        self.known_issues.on(tally.path, &tally.adapter)
    }

    fn record(&self, tally: &PathTally, assertion: &str) -> PathRecord {
        let asserted = match self.tolerance_on.on(tally.path, &tally.adapter) {
            Some(own) => format!("{assertion}; on {} {own}", tally.path),
            None => assertion.to_owned(),
        };
        let known_issue = self.known_issue(tally).map(str::to_owned);
        PathRecord { known_issue, ..tally.record(&asserted) }
    }
}

/// A verb is a few lines: what it is called, and how it judges a case. All else is the plan's.
#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::Check;
    use crate::check::tally::finite;
    use crate::domain::{Domain, Integers};
    use crate::package::Package;
    use crate::value::Arguments;

    impl<D: Domain> Check<'_, D>
    where
        D::Value: Arguments,
    {
        /// Each component of each result is a whole number.
        fn try_is_whole(&self) -> Result<Agreement, Failure> {
            let asserted = Asserted::new("is_whole", "a whole number".to_owned());
            let (stream, demand) = (&self.stream(), &Self::demand());
            self.plan.conclude(&asserted, stream, demand, Recording::Off, &mut |session| {
                let scalars = session.called.scalars();
                session.run(&mut |batch, running| {
                    let judge = |_: usize, actual: &[u32]| {
                        let mut judged = finite(&scalars, actual);
                        let mut lanes = scalars.iter().zip(actual);
                        let whole = lanes.all(|(scalar, word)| scalar.decode(*word).fract() == 0.0);
                        if judged.measure.passes() {
                            judged.measure = LaneError::statement(whole);
                        }
                        judged
                    };
                    session.judge(batch, running, |_| None, |_| &judge)
                })
            })
        }
    }

    #[test]
    fn a_new_verb_has_what_all_verbs_have() {
        let check = |body: &str| {
            let wgsl = format!("fn f(i: i32) -> vec2f {{ return {body}; }}");
            let package = Package::from_source("s", &wgsl);
            package.function("f").over(Integers(-1000..=1000_i32)).try_is_whole()
        };
        let agreement = check("vec2f(f32(i), f32(i * i))").expect("whole numbers");
        assert_eq!(agreement.cases, 2001);
        let error = check("vec2f(f32(i), f32(i) / 4.0)").expect_err("one in four is").to_string();
        for part in [
            "`f` fails is_whole: a whole number",
            "simplest",
            "1500 of 2001",
            "KARAT_CASE=f/is_whole",
        ] {
            assert!(error.contains(part), "no `{part}` in:\n{error}");
        }
        assert!(check("vec2f(f32(i), floor(sqrt(f32(i))))").is_err(), "NaN is no whole number");
    }
}
