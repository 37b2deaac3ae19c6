//! Runs a check of a sampler: prepares its functions, runs each configuration on each path, and gives the
//! verdict.

use super::calls::Calls;
use super::judgement::Judgement;
use super::rejection::{self, PathRejection, Rejection};
use super::{CONFIGURATIONS, Configuration, ENUMERATED, Fit, Hypothesis, Other, Sampled};
use crate::check::called::{Called, Fitting};
use crate::check::demand::Demand;
use crate::check::session::{Asserted, Session};
use crate::check::{Failure, Mismatch, Vacuous, tolerances};
use crate::domain::Source;
use crate::executor::Executor;
use crate::path::Adapter;
use crate::probe::{BATCH, Inputs};
use crate::record::{PathRecord, Subject};
use crate::reflect::Function;
use crate::run::{Identity, Judged, Replayed, Report, reported};
use crate::stats::sidak;

/// A sampler on one path, with the other functions of the check.
pub(super) struct Functions<'s> {
    pub(super) sampler: &'s Called<'s>,
    pub(super) others: &'s [Called<'s>],
}

impl Functions<'_> {
    pub(super) fn sampler(&self) -> Calls<'_> {
        Calls { called: self.sampler }
    }

    pub(super) fn other(&self, which: usize) -> Calls<'_> {
        Calls { called: &self.others[which] }
    }
}

struct Outcome {
    function: Function,
    configurations: u64,
    p: f64,
    rejection: Option<PathRejection>,
}

/// Runs a check of a sampler. `expect` returns an error if the functions' signatures don't fit. `judge` judges one
/// configuration on one path.
pub(super) fn conclude(
    sampler: Sampled<'_, '_>,
    hypothesis: &Hypothesis,
    others: &[Other<'_>],
    expect: &dyn Fn(&Functions<'_>) -> Result<(), Failure>,
    judge: &mut dyn FnMut(&Functions<'_>, &Configuration<'_>) -> Result<Judgement, Failure>,
) -> Result<Fit, Failure> {
    let Sampled { plan, settings, configurations, shapes, recorded, .. } = sampler;
    let function = plan.probe.name.clone();
    let check = hypothesis.check;
    let identity = Identity::of(&function, check)?;
    let seed = plan.seed.unwrap_or_else(|| identity.seed(&function, &identity.check));
    let package = plan.probe.package.root().display().to_string();
    let subject = Subject::Function {
        package,
        function: function.clone(),
        check: check.to_owned(),
        assertion: hypothesis.text.clone(),
        location: String::new(),
        domain: String::new(),
        seed,
    };
    reported(subject, &|| recorded, |Report { subject, paths, read, .. }| {
        read.extend(plan.probe.module_file());
        settings.check(&function)?;
        plan.expect_reasons()?;
        let asserted = Asserted::new(check, hypothesis.text.clone());
        let demand = Demand {
            arguments: shapes.to_vec(),
            who: "the check supplies",
            draws_arguments: false,
            cases: CONFIGURATIONS,
            enumerated: ENUMERATED,
            calls: BATCH,
        };
        let inputs = Inputs::Storage;
        let label = &identity.check;
        let replays = identity.case(&function, label).is_some();
        let mut threshold = settings.significance;
        let on_path = &mut |executor: &dyn Executor, adapter: &Adapter| {
            let asserted = asserted.clone();
            let session = Session::open(
                (plan, executor),
                configurations,
                &demand,
                &identity,
                seed,
                asserted,
                inputs,
            )?;
            if let Subject::Function { location, .. } = &mut *subject {
                *location = session.called.function().span.to_string();
            }
            read.extend(session.called.files(&plan.probe.fixtures));
            tolerances::expect_none(&plan.tolerance_on, check, &session.called)?;
            let mut opened: Vec<Called<'_>> = Vec::new();
            for Other { probe, shapes, .. } in others {
                let function = (probe.package, &*probe.name);
                let given = (&probe.fixtures, &probe.overrides);
                let fitting = Fitting::find(function, given, inputs, shapes, "the check supplies")?;
                if !probe.executors.is_empty() {
                    return Err(Mismatch::Executor.of(fitting.function()));
                }
                // The other functions run on the same path as the sampler, because the check compares their
                // results.
                let called = fitting.on(executor, &probe.fixtures, BATCH)?;
                read.extend(called.files(&probe.fixtures));
                opened.push(called);
            }
            let functions = Functions { sampler: &session.called, others: &opened };
            expect(&functions)?;
            threshold = sidak(settings.significance, session.count() * hypothesis.tests);
            let selected = session.selected()?;
            let mut sum = Sum::default();
            for index in selected.clone() {
                let value = &session.case(index)?;
                let seed = configuration_seed(seed, index);
                let configuration = Configuration { value, index, seed, threshold };
                sum.add(index, value.shown(), judge(&functions, &configuration)?);
            }
            if sum.configurations < selected.end - selected.start || sum.configurations == 0 {
                let (declared, compared) = (selected.end - selected.start, sum.configurations);
                return session.called.vacuous(Vacuous::Uncompared { declared, compared });
            }
            let worst = sum.worst.as_ref().and_then(|worst| worst.histogram.as_ref());
            let record = PathRecord {
                cases: sum.configurations * settings.samples,
                failures: sum.rejected,
                worst: format!("p {:.2e}", sum.p),
                ratio: Some(threshold / sum.p).filter(|ratio| ratio.is_finite()),
                asserted: hypothesis.text.clone(),
                histogram: worst.map(|worst| worst.record(settings.support)),
                configurations: Some(sum.configurations),
                ..PathRecord::of(adapter.clone())
            };
            let path = session.called.path;
            let told = !plan.known_issues.names(path, adapter);
            let rejection = sum.worst.filter(|_| sum.rejected > 0 && told).map(|worst| {
                let replayed = Replayed { case: worst.configuration, steps: &[], input: None };
                let replay =
                    identity.replay(session.selectable(), seed, &function, label, replayed);
                let check = format!("{}-{function}-{label}", identity.test);
                PathRejection {
                    adapter: adapter.clone(),
                    configurations: sum.configurations,
                    rejected: sum.rejected,
                    worst: worst.reported(settings.support, (check, path.to_string())),
                    replay,
                }
            });
            let values = Outcome {
                function: session.called.function().clone(),
                configurations: sum.configurations,
                p: sum.p,
                rejection,
            };
            Ok(Judged { record, values })
        };
        let executors = plan.probe.executors()?;
        let all = plan.known_issues.conclude(&function, &executors, replays, paths, on_path);
        let differ = |differing: Vec<(Adapter, Outcome)>, agreeing: &[(Adapter, Outcome)]| {
            let Some((_, first)) = differing.first() else { return Vec::new() };
            let rejection = Rejection {
                function: first.function.clone(),
                check,
                assertion: hypothesis.text.clone(),
                significance: settings.significance,
                threshold,
                paths: differing.into_iter().filter_map(|(_, one)| one.rejection).collect(),
                agreeing: agreeing.iter().map(|(adapter, _)| adapter.clone()).collect(),
                seed,
            };
            vec![Failure::Rejection(Box::new(rejection))]
        };
        let (agreeing, known_issues) = all.verdict(differ)?;
        // A path that can't run the sampler has no configurations. The known issues' configurations count only
        // if no path agrees.
        let least = match agreeing.is_empty() {
            true => known_issues.iter().map(|issue| issue.cases).min(),
            false => agreeing.iter().map(|(_, one)| one.configurations).min(),
        };
        let configurations = least.unwrap_or(0);
        Ok(Fit {
            function: function.clone(),
            configurations,
            samples: settings.samples,
            p: agreeing.iter().map(|(_, one)| one.p).fold(1.0, f64::min),
            threshold,
            paths: agreeing.into_iter().map(|(adapter, one)| (adapter, one.p)).collect(),
            known_issues,
        })
    })
}

fn configuration_seed(seed: u64, index: u64) -> u64 {
    let mut source = Source::new(seed, index);
    u64::from(source.bits()) << 32 | u64::from(source.bits())
}

/// The numbers of judged and rejected configurations on one path, and the worst configuration.
struct Sum {
    configurations: u64,
    rejected: u64,
    p: f64,
    worst: Option<rejection::Worst>,
}

impl Default for Sum {
    fn default() -> Self {
        Self { configurations: 0, rejected: 0, p: 1.0, worst: None }
    }
}

impl Sum {
    fn add(&mut self, configuration: u64, shown: String, judgement: Judgement) {
        self.configurations += 1;
        let Judgement { findings, p, notes, histogram } = judgement;
        if findings.is_empty() {
            self.p = self.p.min(p);
            return;
        }
        self.rejected += 1;
        if self.worst.is_none() || p < self.p {
            self.worst =
                Some(rejection::Worst { configuration, shown, findings, notes, histogram });
        }
        self.p = self.p.min(p);
    }
}
