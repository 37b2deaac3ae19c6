//! One way through a check of samples: its functions, each configuration on each path, the verdict.

use super::calls::Calls;
use super::judgement::Judgement;
use super::rejection::{self, PathRejection, Rejection};
use super::{CONFIGURATIONS, Configuration, ENUMERATED, Fit, Hypothesis, Other, Sampled};
use crate::check::called::{Called, Fitting, Ready, Refused};
use crate::check::demand::Demand;
use crate::check::plan::Recording;
use crate::check::session::{Asserted, Session};
use crate::check::{Failure, Mismatch, Vacuous};
use crate::domain::Source;
use crate::probe::{BATCH, Inputs};
use crate::record::{PathRecord, Subject};
use crate::run::{Identity, KnownIssues, Replayed, Reporter, Seen};
use crate::stats::sidak;

/// A sampler in progress, and the other functions that a check needs.
pub(super) struct Functions<'s> {
    pub(super) sampler: &'s Called<'s>,
    pub(super) others: &'s [Called<'s>],
}

impl Functions<'_> {
    pub(super) fn sampler(&self, path: usize) -> Calls<'_> {
        Calls { called: self.sampler, ready: &self.sampler.ready[path] }
    }

    pub(super) fn other(&self, which: usize, path: usize) -> Calls<'_> {
        let called = &self.others[which];
        Calls { called, ready: &called.ready[path] }
    }
}

/// Runs a check: `expect` compares signatures, and each configuration on each path is handed to
/// `judge`.
pub(super) fn conclude(
    sampler: Sampled<'_, '_>,
    hypothesis: &Hypothesis,
    others: &[Other<'_>],
    recording: Recording,
    expect: &dyn Fn(&Functions<'_>) -> Result<(), Failure>,
    judge: &mut dyn FnMut(&Functions<'_>, &Configuration<'_>) -> Result<Judgement, Failure>,
) -> Result<Fit, Failure> {
    let Sampled { plan, settings, configurations, shapes, .. } = sampler;
    let function = plan.probe.name.clone();
    let reporter = Reporter::start();
    let check = hypothesis.check;
    let identity = Identity::of(&function, check)?;
    let seed = plan.seed.unwrap_or_else(|| identity.seed(&function, &identity.check));
    let package = plan.probe.package.root().display().to_string();
    let mut subject = Subject::Function {
        package,
        function: function.clone(),
        check: check.to_owned(),
        assertion: hypothesis.text.clone(),
        location: String::new(),
        domain: String::new(),
        seed,
    };
    let mut paths = Vec::new();
    let mut read: Vec<_> = plan.probe.module_file().into_iter().collect();
    let result = (|| {
        settings.check(&function)?;
        plan.expect_reasons()?;
        let asserted = Asserted::new(check, hypothesis.text.clone());
        let demand = Demand {
            arguments: shapes.to_vec(),
            who: "the sampler is given",
            draws_arguments: false,
            cases: CONFIGURATIONS,
            enumerated: ENUMERATED,
            calls: BATCH,
        };
        let inputs = Inputs::Storage;
        let session =
            Session::open(plan, configurations, &demand, &identity, seed, asserted, inputs)?;
        if let Subject::Function { location, .. } = &mut subject {
            *location = session.called.function().span.to_string();
        }
        read.extend(session.called.files(&plan.probe.fixtures));
        let executors = plan.probe.executors()?;
        let mut open = |Other { probe, shapes, .. }: &Other<'_>| {
            let function = (probe.package, &*probe.name);
            let given = (&probe.fixtures, &probe.overrides);
            let fitting = Fitting::find(function, given, inputs, shapes, "it is given")?;
            if !probe.executors.is_empty() {
                return Err(Mismatch::Executor.of(fitting.function()));
            }
            // Where the sampler runs: what they return is compared with its samples.
            let called = fitting.on(&executors, &probe.fixtures, BATCH, &KnownIssues::default())?;
            read.extend(called.files(&probe.fixtures));
            Ok(called)
        };
        let others: Vec<Called<'_>> =
            others.iter().map(&mut open).collect::<Result<_, Failure>>()?;
        let functions = Functions { sampler: &session.called, others: &others };
        expect(&functions)?;
        let count = session.count();
        let threshold = sidak(settings.significance, count * hypothesis.tests);
        let selected = session.selected()?;
        let ready = &session.called.ready;
        let mut sums: Vec<Sum> = ready.iter().map(|_| Sum::default()).collect();
        for index in selected.clone() {
            let value = &session.case(index)?;
            let seed = configuration_seed(seed, index);
            for (path, sum) in sums.iter_mut().enumerate() {
                let configuration = Configuration { value, index, path, seed, threshold };
                let judgement = judge(&functions, &configuration)?;
                sum.add(index, value.shown(), judgement);
            }
        }
        let (mut fits, mut rejections, mut agreeing) = (Vec::new(), Vec::new(), Vec::new());
        let mut known: Vec<Seen> = session.called.refused.iter().map(Refused::seen).collect();
        for (Ready { path, adapter, .. }, sum) in ready.iter().zip(sums) {
            let (path, adapter) = (*path, adapter.clone());
            let known_issue = plan.known_issues.on(path, &adapter).map(str::to_owned);
            let is_known = known_issue.is_some();
            let worst = sum.worst.as_ref().and_then(|worst| worst.histogram.as_ref());
            let histogram = worst.map(|worst| worst.record(settings.support));
            paths.push(PathRecord {
                adapter: adapter.clone(),
                cases: sum.configurations * settings.samples,
                failures: sum.rejected,
                worst: format!("p {:.2e}", sum.p),
                ratio: Some(threshold / sum.p).filter(|ratio| ratio.is_finite()),
                asserted: hypothesis.text.clone(),
                known_issue,
                granted: None,
                errors: None,
                plot: None,
                histogram,
                configurations: Some(sum.configurations),
            });
            if sum.configurations < selected.end - selected.start || sum.configurations == 0 {
                let declared = selected.end - selected.start;
                let reason = Vacuous::Uncompared { declared, compared: sum.configurations };
                return Err(Failure::Domain {
                    function: function.clone(),
                    reason: Box::new(reason),
                });
            }
            if is_known {
                let failures = sum.rejected;
                known.push(Seen { adapter, path, cases: sum.configurations, failures });
                continue;
            }
            let Some(worst) = sum.worst.filter(|_| sum.rejected > 0) else {
                agreeing.push(adapter.clone());
                fits.push((adapter, sum.p));
                continue;
            };
            let replayed = Replayed { case: worst.configuration, steps: &[], input: None };
            let label = &identity.check;
            let replay =
                identity.replay(session.selectable(path), seed, &function, label, replayed);
            let check = format!("{}-{function}-{label}", identity.test);
            let place = (check, path.to_string());
            let worst = worst.reported(settings.support, place);
            rejections.push(PathRejection {
                adapter,
                configurations: sum.configurations,
                rejected: sum.rejected,
                worst,
                replay,
            });
        }
        if rejections.is_empty() {
            let p = fits.iter().map(|fit| fit.1).fold(1.0, f64::min);
            let (configurations, samples) = (selected.end - selected.start, settings.samples);
            let known_issues = plan.known(known, session.is_replay())?;
            let paths = fits;
            return Ok(Fit {
                function,
                configurations,
                samples,
                paths,
                p,
                threshold,
                known_issues,
            });
        }
        Err(Failure::Rejection(Box::new(Rejection {
            function: session.called.function().clone(),
            check,
            assertion: hypothesis.text.clone(),
            significance: settings.significance,
            threshold,
            paths: rejections,
            agreeing,
            seed,
        })))
    })();
    if recording == Recording::On {
        reporter.record(subject, paths, read, &result);
    }
    result
}

/// The seed of a configuration's random numbers.
fn configuration_seed(seed: u64, index: u64) -> u64 {
    let mut source = Source::new(seed, index);
    u64::from(source.bits()) << 32 | u64::from(source.bits())
}

/// The configurations of one path.
struct Sum {
    configurations: u64,
    rejected: u64,
    /// The least p-value.
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
