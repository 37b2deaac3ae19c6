//! Runs a check: opens a session on each path, runs the verb, and records the verdict.

use std::sync::atomic::{AtomicBool, Ordering};

use super::demand::Demand;
use super::path_tally::PathTally;
use super::plan::Plan;
use super::session::{Asserted, Session};
use super::{Agreement, Failure, inputs};
use crate::diagnostic::FileRead;
use crate::domain::Stream;
use crate::executor::Executor;
use crate::path::Adapter;
use crate::record::Subject;
use crate::run::{Conclusion, Identity, Judged, Memory, Report, reported, with_inputs};

/// A verb's last step: a function that may change the verdict before Karat records the verdict.
pub(super) type Last<'l> =
    &'l mut dyn FnMut(Result<Agreement, Failure>, &mut Vec<FileRead>) -> Result<Agreement, Failure>;

/// The work of a verb on one path. Karat calls this function once for each path, so a verb can't skip a path.
pub(super) type Body<'b> = &'b mut dyn FnMut(&Session<'_>) -> Result<PathTally, Failure>;

impl Plan<'_> {
    pub(super) fn conclude(
        &self,
        asserted: &Asserted,
        stream: &dyn Stream,
        demand: &Demand,
        verb: Body<'_>,
    ) -> Result<Agreement, Failure> {
        self.conclude_as(asserted, stream, demand, verb, &mut |result, _| result)
    }

    /// Runs a check like `conclude`. At the end, `last` may change the verdict, and list more files that the check
    /// read.
    pub(super) fn conclude_as(
        &self,
        asserted: &Asserted,
        stream: &dyn Stream,
        demand: &Demand,
        verb: Body<'_>,
        last: Last<'_>,
    ) -> Result<Agreement, Failure> {
        let identity = Identity::of(&self.probe.name, asserted.check)?;
        let run = (&identity, &AtomicBool::new(false));
        self.conclude_unless(run, asserted, stream, demand, (verb, last))
    }

    /// Runs a check like `conclude_as`, but under the name in `identity`, which several runs of the same check share.
    /// If `withheld` is `true` after this run, a later run gives the verdict, so this run writes no record.
    pub(super) fn conclude_unless(
        &self,
        (identity, withheld): (&Identity, &AtomicBool),
        asserted: &Asserted,
        stream: &dyn Stream,
        demand: &Demand,
        (verb, last): (Body<'_>, Last<'_>),
    ) -> Result<Agreement, Failure> {
        let Asserted { check, text, .. } = asserted;
        let function = self.probe.name.clone();
        let seed = self.seed.unwrap_or_else(|| identity.seed(&function, &identity.check));
        let subject = Subject::Function {
            package: self.probe.root().display().to_string(),
            function,
            check: (*check).to_owned(),
            assertion: text.clone(),
            location: String::new(),
            domain: stream.described(),
            seed,
        };
        let recorded = || self.recorded && !withheld.load(Ordering::Relaxed);
        let mut run = |Report { subject, paths, read, .. }: &mut Report| {
            read.extend(self.probe.module_file());
            self.expect_reasons()?;
            self.expect_hazards_asked(asserted)?;
            let own = self.tolerance_on.iter().map(|(on, own)| format!("; on {on} {own}"));
            let own: String = own.collect();
            let remembers = asserted.remembers;
            let asserted = Asserted { text: format!("{text}{own}"), ..asserted.clone() };
            // A check with declared failures remembers no inputs. Karat opens the memory once for all paths. So
            // inputs that fail on one path in this run don't count as earlier failures on the next path.
            let remembered = self.recorded && self.known_issues.is_empty();
            let memory = Memory::open(identity).filter(|_| remembered && remembers);
            let executors = self.probe.executors()?;
            let mut all = Conclusion::default();
            for inputs in inputs::chosen(self, identity) {
                let text = format!("{text}{}", inputs.remark());
                let check = with_inputs(&identity.check, inputs);
                let replays = identity.case(&self.probe.name, &check).is_some();
                let judge = &mut |executor: &dyn Executor, adapter: &Adapter| {
                    let asserted = asserted.clone();
                    let session = Session::open(
                        (self, executor),
                        stream,
                        demand,
                        identity,
                        seed,
                        asserted,
                        inputs,
                    )?;
                    let session = session.remembering(memory.as_ref());
                    if let Subject::Function { location, .. } = &mut *subject {
                        *location = session.called.function().span.to_string();
                    }
                    read.extend(session.called.files(&self.probe.fixtures));
                    let tally = verb(&session)?;
                    let asserted = match self.tolerance_on.on(tally.path, adapter) {
                        Some(own) => format!("{text}; on {} {own}", tally.path),
                        None => text.clone(),
                    };
                    let record = tally.record(&asserted);
                    let told = !self.known_issues.names(tally.path, adapter);
                    Ok(Judged { record, values: session.outcome(tally, told)? })
                };
                let name = &self.probe.name;
                all.extend(self.known_issues.conclude(name, &executors, replays, paths, judge));
            }
            self.verdict(&asserted, stream.described(), all)
        };
        reported(subject, &recorded, |report| {
            let result = run(report);
            last(result, &mut report.read)
        })
    }
}

/// These tests define a verb in a few lines: its name, and a function that judges a case. `Plan` does
/// everything else.
#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{Calls, Check};
    use crate::domain::Integers;
    use crate::judge::finite;
    use crate::package::Package;
    use crate::tolerance::LaneError;

    impl<V> Check<'_, Calls<V>> {
        /// Checks that each component of each result is a whole number.
        fn try_is_whole(&self) -> Result<Agreement, Failure> {
            let asserted = Asserted::new("is_whole", "a whole number".to_owned());
            let (stream, demand) = (&*self.stream, &self.demand());
            self.plan.conclude(&asserted, stream, demand, &mut |session| {
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
                    session.judge(batch, running, |_| None, &judge)
                })
            })
        }
    }

    #[test]
    fn a_new_kind_of_check_has_complete_messages() {
        let check = |body: &str| {
            let wgsl = format!("fn f(i: i32) -> vec2f {{ return {body}; }}");
            let package = Package::from_source("s", &wgsl);
            package.function("f").over(Integers(-1000..=1000_i32)).unrecorded().try_is_whole()
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
