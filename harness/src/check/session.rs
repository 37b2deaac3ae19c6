//! A check in progress: cases are drawn, dispatched on every path, and judged.

use std::ops::Range;

use super::disagreement::arguments;
use super::identity::{Replayed, with_inputs};
use super::memory::{Descent, Entry, Memory};
use super::shrink::{Effort, words as words_of};
use super::tally::{Judged, Shown, Tally, tally};
use super::{
    Agreement, CaseFailure, Disagreement, Failure, Identity, PathDisagreement, Plan, Reference,
    Simplest,
};
use super::{parallel, replay};
use crate::domain::{Cases, Domain, Shrinkable};
use crate::path::{self, Adapter, Device, Path};
use crate::probe::{self, BATCH, CONSTANTS, Dispatch, Inputs, Probed, Runner};
use crate::record::PathRecord;
use crate::reflect::Function;
use crate::tolerance::{Measure, Tolerance};
use crate::value::{Arguments, Scalar, Shape};

/// Cases that one task draws or computes the reference of.
const TASK: usize = 2048;

/// Room for cases in a dispatch of few, for the values that a failing one is replaced by.
const SMALLEST: usize = 256;

/// What one verb asks of a session.
pub(super) struct Demand {
    /// Types of the arguments that the host supplies.
    pub(super) arguments: Vec<Shape>,
    /// Who supplies them: `the domain draws`.
    pub(super) who: &'static str,
    /// Cases of a domain that isn't enumerated, unless the check says otherwise.
    pub(super) cases: u64,
    /// Values of a finite domain that are all tried unless a number of cases is asked for.
    pub(super) enumerated: u64,
    /// Calls of the function that a case makes in one dispatch, at most.
    pub(super) calls: usize,
}

/// A check in progress.
pub(super) struct Session<'a, D: Domain> {
    pub(super) probed: Probed,
    pub(super) runners: Vec<Runner>,
    cases: Cases<'a, D>,
    /// The one case that a replay selects.
    case: Option<u64>,
    /// Lanes of all parameters. Values may hold more words, of which kernels know nothing.
    words: usize,
    identity: &'a Identity,
    pub(super) seed: u64,
    /// Where the arguments come from.
    pub(super) inputs: Inputs,
    /// The verb and what it asserts.
    pub(super) assertion: (&'static str, String),
    /// Inputs on which the test has failed before; `None`: nothing is remembered.
    memory: Option<Memory>,
}

/// The cases of one dispatch.
pub(super) struct Batch<V> {
    pub(super) first: u64,
    pub(super) values: Vec<V>,
    pub(super) lanes: Vec<u32>,
}

/// One path's sum, and what is needed to show its failures.
pub(super) struct PathTally {
    pub(super) adapter: Adapter,
    pub(super) path: Path,
    pub(super) tally: Tally,
    pub(super) worst: Option<CaseFailure>,
    first: Option<CaseFailure>,
    pub(super) simplest: Option<Simplest>,
    /// Nodes of all integrals; 0 for other checks.
    nodes: u64,
}

impl PathTally {
    /// A path's sum with its failures, which `show` describes.
    pub(super) fn new(device: &Device, tally: Tally, show: impl Fn(Shown) -> CaseFailure) -> Self {
        let failing = tally.census.failures > 0;
        Self {
            adapter: device.adapter().clone(),
            path: device.path(),
            worst: tally.worst.filter(|_| failing).map(&show),
            first: tally.first.map(&show),
            simplest: None,
            tally,
            nodes: 0,
        }
    }

    pub(super) fn with_nodes(self, nodes: u64) -> Self {
        Self { nodes, ..self }
    }

    /// The failing case of the lowest index.
    pub(super) fn first_failure(self) -> Option<CaseFailure> {
        self.first
    }

    pub(super) fn record(&self, asserted: &str) -> PathRecord {
        let worst = self.tally.worst.map(|worst| worst.judged.measure);
        PathRecord {
            adapter: self.adapter.clone(),
            cases: self.tally.census.cases,
            failures: self.tally.census.failures,
            worst: worst.map_or_else(String::new, |measure| measure.to_string()),
            ratio: worst.map(|measure| measure.ratio).filter(|ratio| ratio.is_finite()),
            asserted: match self.nodes {
                0 => asserted.to_owned(),
                nodes => format!("{asserted} ({nodes} nodes)"),
            },
            known_issue: None,
        }
    }
}

/// Judges a batch on every path.
trait Judge<V>: FnMut(&Batch<V>, Vec<Dispatch>) -> Result<Vec<PathTally>, Failure> {}

impl<V, F> Judge<V> for F where F: FnMut(&Batch<V>, Vec<Dispatch>) -> Result<Vec<PathTally>, Failure>
{}

impl<'a, D: Domain> Session<'a, D> {
    pub(super) fn open(
        plan: &'a Plan<'_, D>,
        demand: &Demand,
        identity: &'a Identity,
        seed: u64,
        assertion: (&'static str, String),
        inputs: Inputs,
    ) -> Result<Self, Failure> {
        let Plan { probe, domain, .. } = plan;
        let probed = Probed::new(probe.package, &probe.path)?.with_inputs(inputs)?;
        let function = &probed.function;
        let supplied = &demand.arguments;
        let declared = probe::parameter_shapes(function);
        let list = |shapes: &[&Shape]| {
            let names: Vec<String> = shapes.iter().map(ToString::to_string).collect();
            format!("({})", names.join(", "))
        };
        let fits = supplied.len() == declared.len()
            && supplied.iter().zip(&declared).all(|(host, wgsl)| host.stands_for(wgsl, false));
        if !fits {
            let supplied: Vec<&Shape> = supplied.iter().collect();
            let (declared, supplied) = (list(&declared), list(&supplied));
            let mismatch = format!("takes {declared}, {} {supplied}", demand.who);
            return Err(signature(function, mismatch));
        }
        let (cases, enumerated) = match plan.cases {
            Some(cases) => (cases, cases),
            None => (demand.cases, demand.enumerated),
        };
        let few = CONSTANTS as u64;
        let (cases, enumerated) = match inputs {
            Inputs::Storage | Inputs::Uniform => (cases, enumerated),
            Inputs::Constant => (cases.min(few), enumerated.min(few)),
        };
        let cases = Cases::new(domain, seed, cases, enumerated);
        if cases.count() == 0 || domain.is_empty() {
            let reason = "has no value, so nothing would be checked: a range ends before it \
                          starts, at NaN or at infinity, a logarithmic grid includes 0, a list is \
                          empty, or no case is asked for"
                .to_owned();
            return Err(Failure::Domain { function: function.path.clone(), reason });
        }
        let count = usize::try_from(cases.count()).unwrap_or(BATCH);
        let capacity = count.saturating_mul(demand.calls).clamp(SMALLEST, BATCH);
        let runners = path::selected()?
            .into_iter()
            .map(|device| Runner::new(device, &probed, &probe.fixtures, capacity))
            .collect::<Result<_, _>>()?;
        let case = identity.case(&probed.function.path, &with_inputs(&identity.check, inputs));
        if case.is_some() {
            replay::done();
        }
        let words = declared.iter().map(|shape| shape.lanes().len()).sum();
        let memory = None;
        Ok(Self { probed, runners, cases, case, words, identity, seed, inputs, assertion, memory })
    }

    /// Tries what the test has failed on before, and remembers what it fails on.
    pub(super) fn remembering(self, memory: Option<Memory>) -> Self {
        Self { memory, ..self }
    }

    pub(super) fn scalars(&self) -> Vec<Scalar> {
        self.probed.function.result.lanes()
    }

    pub(super) fn expect_result(
        &self,
        host: &Shape,
        who: &str,
        tolerance: Option<&Tolerance>,
    ) -> Result<(), Failure> {
        let function = &self.probed.function;
        if !host.stands_for(&function.result, true) {
            let mismatch = format!("returns {}, {who} {host}", function.result);
            return Err(signature(function, mismatch));
        }
        tolerance.map_or(Ok(()), |tolerance| self.expect_lanes(tolerance))
    }

    /// Refuses a reference that isn't finite. `lanes` are those of one case after the other, and
    /// `case` tells a case's index and arguments.
    pub(super) fn expect_finite(
        &self,
        lanes: &[f64],
        what: &str,
        case: impl FnOnce(usize) -> (u64, String),
    ) -> Result<(), Failure> {
        let function = &self.probed.function;
        let Some(at) = lanes.iter().position(|value| !value.is_finite()) else { return Ok(()) };
        let names = function.result.lane_names();
        let place = format!("{what}{}", names[at % names.len()]);
        let (case, arguments) = case(at / names.len());
        let (function, value) = (function.path.clone(), lanes[at]);
        Err(Failure::Reference { function, value, place, case, arguments })
    }

    pub(super) fn expect_lanes(&self, tolerance: &Tolerance) -> Result<(), Failure> {
        let lanes = self.scalars().len();
        if let Some(bound) = tolerance.unusable() {
            let mismatch = format!("is compared to {tolerance}, and {bound} bounds nothing");
            return Err(signature(&self.probed.function, mismatch));
        }
        match tolerance.lanes() {
            Some(declared) if declared != lanes => {
                let mismatch =
                    format!("returns {lanes} components, the tolerance is declared for {declared}");
                Err(signature(&self.probed.function, mismatch))
            }
            _ => Ok(()),
        }
    }

    /// How many cases the check declares, whether or not a replay selects one.
    pub(super) fn count(&self) -> u64 {
        self.cases.count()
    }

    /// The cases that run: all, or the one that a replay selects.
    pub(super) fn selected(&self) -> Result<Range<u64>, Failure> {
        let count = self.cases.count();
        match self.case {
            Some(case) if case < count => Ok(case..case + 1),
            Some(case) => {
                let reason = format!("has {count} cases, none with index {case} (KARAT_CASE)");
                let function = self.probed.function.path.clone();
                Err(Failure::Domain { function, reason })
            }
            None => Ok(0..count),
        }
    }

    /// Whether one case stands for all of them: some verdicts need them all.
    pub(super) fn is_replay(&self) -> bool {
        self.case.is_some()
    }

    /// Calls of one dispatch.
    pub(super) fn capacity(&self) -> usize {
        self.runners.iter().map(Runner::capacity).min().unwrap_or(BATCH)
    }

    /// The value of a case, or the simpler one that a replay asks for.
    pub(super) fn case(&self, index: u64) -> Result<D::Value, Failure> {
        let steps = self.steps();
        if !steps.is_empty() {
            let descent = Descent { seed: self.seed, case: index, steps: steps.to_vec() };
            return self.descend(&descent).ok_or_else(|| Failure::Domain {
                function: self.probed.function.path.clone(),
                reason: "has no such simpler value any more (steps of KARAT_CASE)".to_owned(),
            });
        }
        self.cases.get(index).ok_or_else(|| Failure::Domain {
            function: self.probed.function.path.clone(),
            reason: "rejects nearly everything that its filter sees: build the values with `map` \
                     instead"
                .to_owned(),
        })
    }

    /// The steps with which a replay goes on from its case.
    pub(super) fn steps(&self) -> &[usize] {
        self.identity.steps(&self.probed.function.path, &self.name())
    }

    /// The value that comes about in this way, if it still does.
    fn descend(&self, descent: &Descent) -> Option<D::Value> {
        let cases = self.cases.with_seed(descent.seed);
        let mut at = cases.shrinkable(descent.case)?;
        for index in &descent.steps {
            at = at.simpler().into_iter().nth(*index)?;
        }
        Some(at.value().clone())
    }

    /// The cases of integrals that have failed before, which come about as they did then.
    pub(super) fn remembered_integrals(&self) -> Vec<(Descent, D::Value)> {
        let Some(memory) = &self.memory else { return Vec::new() };
        let mut found = Vec::new();
        for entry in memory.of(&self.probed.function.path, &self.identity.check) {
            match self.descend(&entry.descent) {
                Some(value) if entry.comment == format!("case = {value:?}") => {
                    found.push((entry.descent.clone(), value));
                }
                _ => memory.ignore(entry, "it isn't in the domain any more"),
            }
        }
        found
    }

    /// Keeps what failed, reduced.
    pub(super) fn remember(&self, sums: &[PathTally]) {
        let Some(memory) = &self.memory else { return };
        for (path, simplest) in
            sums.iter().filter_map(|sum| Some((sum.path, sum.simplest.as_ref()?)))
        {
            if simplest.failure.remembered {
                continue;
            }
            let arguments: Vec<String> = simplest
                .failure
                .arguments
                .iter()
                .map(|(name, value)| format!("{name} = {value}"))
                .collect();
            memory.keep(&Entry {
                function: self.probed.function.path.clone(),
                check: self.identity.check.clone(),
                path: path.name().to_owned(),
                words: simplest.input.clone(),
                descent: simplest.descent.clone(),
                comment: arguments.join(", "),
            });
        }
    }

    /// The value of a case, with the simpler ones next to it.
    pub(super) fn shrinkable(&self, index: u64) -> Option<Shrinkable<'_, D::Value>> {
        self.cases.shrinkable(index)
    }

    pub(super) fn dispatch(&self, batch: &LanesOnly<'_>) -> Result<Vec<Dispatch>, Failure> {
        let dispatches = self.runners.iter().map(|runner| {
            let canary = probe::canary(self.seed, batch.first);
            runner.dispatch(batch.cases, &batch.lanes, canary)
        });
        Ok(dispatches.collect::<Result<_, _>>()?)
    }

    /// The check's name as a replay command has it.
    fn name(&self) -> String {
        with_inputs(&self.identity.check, self.inputs)
    }

    /// The arguments with which a replay replaces those of its case.
    fn input(&self) -> Option<&[u32]> {
        self.identity.input(&self.probed.function.path, &self.name())
    }

    pub(super) fn conclude(&self, tallies: Vec<PathTally>) -> Result<Agreement, Failure> {
        let function = self.probed.function.path.clone();
        let compared = tallies.iter().map(|path| path.tally.census.cases).min().unwrap_or(0);
        let declared = if self.case.is_some() { 1 } else { self.cases.count() };
        if compared < declared {
            let reason = format!("declares {declared} cases, but {compared} were compared");
            return Err(Failure::Domain { function, reason });
        }
        if tallies.iter().all(|path| path.tally.census.failures == 0) {
            let worst_of = |path: &PathTally| {
                path.tally.worst.map_or(Measure::ZERO, |worst| worst.judged.measure)
            };
            let worst = tallies.iter().map(worst_of).max_by(|a, b| a.ratio.total_cmp(&b.ratio));
            let paths = tallies.iter().map(|path| (path.adapter.clone(), worst_of(path))).collect();
            let worst = worst.unwrap_or(Measure::ZERO);
            let known_issues = Vec::new();
            return Ok(Agreement { function, cases: compared, paths, worst, known_issues });
        }
        let mut agreeing = Vec::new();
        let mut paths = Vec::new();
        for PathTally { adapter, path, tally, worst, first, simplest, .. } in tallies {
            let Some(worst) = worst else {
                agreeing.push((adapter, self.inputs));
                continue;
            };
            let replay = |seed: u64, replayed: Replayed<'_>| {
                let (function, check) = (&self.probed.function.path, &self.name());
                self.identity.replay(path, seed, function, check, replayed)
            };
            let replay_of = |simplest: &Simplest| match &*simplest.input {
                [] => {
                    let Descent { seed, case, steps } = &simplest.descent;
                    replay(*seed, Replayed { case: *case, steps, input: None })
                }
                input => {
                    let case = worst.case;
                    replay(self.seed, Replayed { case, steps: &[], input: Some(input) })
                }
            };
            let first = first.filter(|first| first.case != worst.case);
            let replay_worst = match simplest.as_ref().filter(|_| worst.remembered) {
                Some(old) => replay_of(old),
                None => {
                    let (steps, input) = (self.steps(), self.input());
                    replay(self.seed, Replayed { case: worst.case, steps, input })
                }
            };
            let reduced =
                |simplest: &Simplest| !worst.remembered && !simplest.descent.steps.is_empty();
            let simplest = simplest.filter(reduced).map(|simplest| {
                let replay = replay_of(&simplest);
                Simplest { replay, ..simplest }
            });
            let (census, replay) = (tally.census, replay_worst);
            let inputs = self.inputs;
            paths.push(PathDisagreement {
                adapter,
                inputs,
                census,
                worst,
                first,
                replay,
                simplest,
            });
        }
        Err(Failure::Disagreement(Box::new(Disagreement {
            function: self.probed.function.clone(),
            check: self.assertion.0,
            assertion: self.assertion.1.clone(),
            paths,
            agreeing,
            seed: self.seed,
        })))
    }
}

impl<D: Domain> Session<'_, D>
where
    D::Value: Arguments,
{
    /// Draws batch after batch, dispatches it on every path and hands it to `judge`. The worst case
    /// of each path that fails is simplified, for which `judge` gets other batches.
    pub(super) fn run(
        &self,
        mut judge: impl FnMut(&Batch<D::Value>, Vec<Dispatch>) -> Result<Vec<PathTally>, Failure>,
    ) -> Result<Vec<PathTally>, Failure> {
        self.expect_constants()?;
        let remembered = self.remembered();
        let again = self.run_again(&remembered, &mut judge)?;
        let mut sums = self.run_cases(&mut judge)?;
        // What passes again isn't counted: the declared cases are the same in every run.
        if again.iter().any(|path| path.tally.census.failures > 0) {
            sums = PathTally::merge_all(sums, again);
        }
        for (path, sum) in sums.iter_mut().enumerate() {
            if let (Some(worst), None) = (&sum.worst, self.input()) {
                let old = worst.case.checked_sub(self.cases.count());
                let old = old.and_then(|index| remembered.get(usize::try_from(index).ok()?));
                sum.simplest = match old {
                    Some(value) => {
                        // Its replay is by its words.
                        let descent =
                            Descent { seed: self.seed, case: worst.case, steps: Vec::new() };
                        let simplest = Simplest::new(worst.clone(), descent);
                        Some(Simplest { input: words_of(value), ..simplest })
                    }
                    None => {
                        let mut judge = |values: &[D::Value]| {
                            let batch = self.batch(0, values.to_vec());
                            let dispatches = self.dispatch(&batch.lanes_only())?;
                            judge(&batch, dispatches)
                        };
                        let found = self.simplest(path, worst, self.effort(), &mut judge);
                        found.map(|(simplest, value)| Simplest {
                            input: words_of(&value),
                            ..simplest
                        })
                    }
                };
            }
        }
        self.remember(&sums);
        Ok(sums)
    }

    /// Refuses constants of a domain that has an edge which isn't one in WGSL: draws of it would be
    /// refused as well, in some runs.
    fn expect_constants(&self) -> Result<(), Failure> {
        let edges = match self.inputs {
            Inputs::Constant => self.cases.edges(),
            Inputs::Storage | Inputs::Uniform => return Ok(()),
        };
        let scalars: Vec<Scalar> = D::Value::shapes().iter().flat_map(Shape::lanes).collect();
        let finite = |edge: &D::Value| {
            let lanes = words_of(edge);
            let mut lanes = scalars.iter().zip(lanes);
            lanes.all(|(scalar, word)| !scalar.is_float() || f32::from_bits(word).is_finite())
        };
        match edges.into_iter().find(|edge| !finite(edge)) {
            Some(edge) => self.dispatch(&self.batch(0, vec![edge]).lanes_only()).map(|_| ()),
            None => Ok(()),
        }
    }

    fn effort(&self) -> Effort {
        match self.inputs {
            Inputs::Constant => Effort::of_constants(self.capacity()),
            Inputs::Storage | Inputs::Uniform => Effort::of_calls(self.capacity()),
        }
    }

    /// The inputs on which this check has failed before, as far as they still are in its domain.
    fn remembered(&self) -> Vec<D::Value> {
        let Some(memory) = &self.memory else { return Vec::new() };
        let mut values = Vec::new();
        let scalars: Vec<Scalar> = D::Value::shapes().iter().flat_map(Shape::lanes).collect();
        for entry in memory.of(&self.probed.function.path, &self.identity.check) {
            let lanes = || scalars.iter().zip(&entry.words);
            if self.inputs == Inputs::Constant
                && lanes().any(|(s, word)| s.is_float() && !f32::from_bits(*word).is_finite())
            {
                continue; // WGSL has no such constant
            }
            match self.value(&entry.words) {
                Ok(value) if self.still_drawn(&value, entry) => values.push(value),
                Ok(_) => memory.ignore(entry, "it isn't in the domain any more"),
                Err(_) => memory.ignore(entry, "the function takes other arguments now"),
            }
        }
        values
    }

    /// Whether the domain has a value. One that can't tell has it if the value comes about in the
    /// same way as before.
    fn still_drawn(&self, value: &D::Value, entry: &Entry) -> bool {
        let again = || Some(words_of(&self.descend(&entry.descent)?) == entry.words);
        self.cases.admits(value).unwrap_or_else(|| again() == Some(true))
    }

    /// Judges remembered inputs, whose indices follow those of the cases.
    fn run_again(
        &self,
        remembered: &[D::Value],
        judge: &mut impl Judge<D::Value>,
    ) -> Result<Vec<PathTally>, Failure> {
        let mut sums = Vec::new();
        for (index, values) in (self.cases.count()..).zip(remembered.chunks(1)) {
            let batch = self.batch(index, values.to_vec());
            let dispatches = self.dispatch(&batch.lanes_only())?;
            sums = PathTally::merge_all(sums, judge(&batch, dispatches)?);
        }
        Ok(sums)
    }

    fn run_cases(&self, judge: &mut impl Judge<D::Value>) -> Result<Vec<PathTally>, Failure> {
        if let Some(words) = self.input() {
            let batch = self.batch(self.case.unwrap_or_default(), vec![self.value(words)?]);
            let dispatches = self.dispatch(&batch.lanes_only())?;
            return judge(&batch, dispatches);
        }
        let Range { start: mut first, end } = self.selected()?;
        let mut sums = Vec::new();
        while first < end {
            let size = (end - first).min(self.capacity() as u64);
            let batch = self.draw(first, size)?;
            let dispatches = self.dispatch(&batch.lanes_only())?;
            sums = PathTally::merge_all(sums, judge(&batch, dispatches)?);
            first += size;
        }
        Ok(sums)
    }

    /// Arguments from their lanes, which must be as many as the function takes.
    fn value(&self, words: &[u32]) -> Result<D::Value, Failure> {
        let value = D::Value::load_all(&mut words.iter());
        let (expected, found) = (words_of(&value).len(), words.len());
        if expected != found {
            let function = self.probed.function.path.clone();
            let reason = format!("has values of {expected} words, KARAT_INPUT has {found}");
            return Err(Failure::Domain { function, reason });
        }
        Ok(value)
    }

    /// Adds what a kernel gets of a value.
    fn store(&self, value: &D::Value, lanes: &mut Vec<u32>) {
        let before = lanes.len();
        value.store_all(lanes);
        lanes.truncate(before + self.words);
    }

    /// Cases from the index `first` on.
    pub(super) fn batch(&self, first: u64, values: Vec<D::Value>) -> Batch<D::Value> {
        let mut lanes = Vec::with_capacity(values.len() * self.words);
        values.iter().for_each(|value| self.store(value, &mut lanes));
        Batch { first, values, lanes }
    }

    fn draw(&self, first: u64, size: u64) -> Result<Batch<D::Value>, Failure> {
        let size = usize::try_from(size).expect("a batch fits in memory");
        let parts = parallel::map(size.div_ceil(TASK), |task| {
            let mut values = Vec::with_capacity(TASK);
            let mut lanes = Vec::with_capacity(TASK * self.words);
            for index in task * TASK..size.min((task + 1) * TASK) {
                let Ok(value) = self.case(first + index as u64) else { break };
                self.store(&value, &mut lanes);
                values.push(value);
            }
            (values, lanes)
        });
        let mut batch = Batch { first, values: Vec::with_capacity(size), lanes: Vec::new() };
        for (values, lanes) in parts {
            batch.values.extend(values);
            batch.lanes.extend(lanes);
        }
        if batch.values.len() < size {
            // A case that can't be drawn: the first of them says why.
            for index in first..first + size as u64 {
                self.case(index)?;
            }
        }
        Ok(batch)
    }

    /// Reads each path's results and judges them. `judge` gets the path's index, the case's index
    /// in the batch and the result's words; `expect` says what a failing case should have been.
    pub(super) fn judge(
        &self,
        batch: &Batch<D::Value>,
        dispatches: Vec<Dispatch>,
        expect: impl Fn(usize, usize) -> Option<Vec<f64>>,
        judge: impl Fn(usize, usize, &[u32]) -> Judged + Sync,
    ) -> Result<Vec<PathTally>, Failure> {
        let words = self.scalars().len();
        let mut tallies = Vec::with_capacity(self.runners.len());
        for (path, (runner, dispatch)) in self.runners.iter().zip(dispatches).enumerate() {
            let tally = runner.read(dispatch, |results| {
                let stride = runner.stride_out();
                let sum = tally(batch.first, results, stride, &|case, result| {
                    judge(path, case, &result[..words])
                });
                PathTally::new(runner.device(), sum, |shown: Shown| {
                    let case = usize::try_from(shown.case - batch.first).expect("in this batch");
                    let actual = &results[case * stride..][..words];
                    let (judged, expected) = (judge(path, case, actual), expect(path, case));
                    let function = &self.probed.function;
                    let arguments = arguments(function, &words_of(&batch.values[case]));
                    let expected = expected.as_deref();
                    let remembered = shown.case >= self.cases.count();
                    let case = shown.case;
                    CaseFailure {
                        remembered,
                        ..CaseFailure::new(function, case, arguments, actual, expected, &judged)
                    }
                })
            })?;
            tallies.push(tally);
        }
        Ok(tallies)
    }
}

impl PathTally {
    fn merge(self, other: Self) -> Self {
        let tally = self.tally.merge(other.tally);
        let pick = |shown: Option<Shown>, a: Option<CaseFailure>, b: Option<CaseFailure>| {
            let case = shown.map(|shown| shown.case);
            [a, b].into_iter().flatten().find(|failure| Some(failure.case) == case)
        };
        let worst = tally.worst.filter(|_| tally.census.failures > 0);
        Self {
            worst: pick(worst, self.worst, other.worst),
            first: pick(tally.first, self.first, other.first),
            tally,
            nodes: self.nodes + other.nodes,
            ..self
        }
    }

    /// Adds the sums of later cases to those of earlier ones, path by path.
    pub(super) fn merge_all(sums: Vec<Self>, tallies: Vec<Self>) -> Vec<Self> {
        if sums.is_empty() {
            return tallies;
        }
        sums.into_iter().zip(tallies).map(|(a, b)| a.merge(b)).collect()
    }
}

/// The arguments of a dispatch as words.
pub(super) struct LanesOnly<'a> {
    /// A number of this dispatch.
    pub(super) first: u64,
    /// Calls of the function.
    pub(super) cases: usize,
    pub(super) lanes: std::borrow::Cow<'a, [u32]>,
}

impl<V: Arguments> Batch<V> {
    pub(super) fn lanes_only(&self) -> LanesOnly<'_> {
        let (first, cases) = (self.first, self.values.len());
        LanesOnly { first, cases, lanes: self.lanes.as_slice().into() }
    }

    pub(super) fn transformed(&self, transform: impl Fn(V) -> V + Sync) -> LanesOnly<'_> {
        let mut lanes = Vec::with_capacity(self.lanes.len());
        for value in &self.values {
            transform(value.clone()).store_all(&mut lanes);
        }
        LanesOnly { first: self.first, cases: self.values.len(), lanes: lanes.into() }
    }

    /// The reference's lanes of each case. A value that isn't finite is an error.
    pub(super) fn expected<D: Domain<Value = V>>(
        &self,
        session: &Session<'_, D>,
        reference: &impl Reference<V>,
    ) -> Result<Vec<f64>, Failure> {
        let words = session.scalars().len();
        let parts = parallel::map(self.values.len().div_ceil(TASK), |task| {
            let values = &self.values[task * TASK..self.values.len().min((task + 1) * TASK)];
            let mut lanes = Vec::with_capacity(values.len() * words);
            for value in values {
                reference.expect(value, &mut lanes);
            }
            lanes
        });
        let expected = parts.concat();
        session.expect_finite(&expected, "result", |case| {
            (self.first + case as u64, format!("{:?}", self.values[case]))
        })?;
        Ok(expected)
    }
}

pub(super) fn signature(function: &Function, mismatch: String) -> Failure {
    Failure::Signature {
        function: function.path.clone(),
        mismatch,
        signature: function.to_string(),
        location: function.span.to_string(),
    }
}
