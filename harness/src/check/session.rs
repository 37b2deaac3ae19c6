//! A check that is running on one path: it samples cases, dispatches them and judges the results.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use super::batch::{Batch, Rows, SEARCHED};
use super::called::{Called, Fitting};
use super::cause::cause;
use super::demand::{Demand, number};
use super::disagreement::Expectation;
use super::effort::Effort;
use super::goal::Goal;
use super::path_tally::PathTally;
use super::sample::Sample;
use super::{CaseFailure, Failure, Plan, Simplest, Vacuous};
use crate::domain::{Held, Numbering, Origin, Stream};
use crate::executor::{self, Executor, Results, Running};
use crate::fixture::Fixtures;
use crate::interpret::{Accuracy, Interpreted};
use crate::judge::{Described, Judge, Shown, tally};
use crate::parallel;
use crate::path::{Api, Path};
use crate::probe::{BATCH, Inputs, ProbeError};
use crate::run::{Descent, Identity, Memory, replay, with_inputs};

/// The smallest capacity of a dispatch, in calls. Even a check with few cases needs room for the many simpler values
/// that Karat tries if a case fails.
const SMALLEST: usize = 256;

/// The largest capacity of a dispatch, in calls. Each dispatch costs a few hundred microseconds, during which the CPU's
/// cores wait. So one dispatch has room for twice the default number of cases.
const LARGEST: usize = 2 * BATCH;

/// The capacity of a dispatch, in calls, for a check with `cases` cases. With this capacity, the check needs as few
/// dispatches as possible, all of about the same size.
fn room_for(cases: usize) -> usize {
    cases.div_ceil(cases.div_ceil(LARGEST).max(1)).max(SMALLEST)
}

#[derive(Clone, Debug)]
pub(super) struct Asserted {
    pub(super) check: &'static str,
    /// The tolerance or the statement that the verb checks, as text.
    pub(super) text: String,
    pub(super) expectation: Expectation,
    /// `true` if Karat stores failing arguments, so that later runs try them again.
    pub(super) remembers: bool,
    pub(super) explained: Explained,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Explained {
    /// A report of a failing case has no notes, because the verb compares several calls, or changes the case's
    /// arguments.
    Nothing,
    /// A report of a failing case lists the results that WGSL allows for the case's arguments.
    ByBounds,
    /// A report of a failing case lists the hazards of operations inside of the function.
    ByHazards(super::kinds::Kinds),
}

impl Asserted {
    /// Makes an assertion that the actual value equals the expected value.
    pub(super) fn new(check: &'static str, text: String) -> Self {
        let (expectation, explained) = (Expectation::Equal, Explained::Nothing);
        Self { check, text, expectation, remembers: true, explained }
    }
}

/// A check that is running: a function on one path, and a stream of cases.
pub(super) struct Session<'a> {
    pub(super) called: Called<'a>,
    pub(super) stream: &'a dyn Stream,
    pub(super) cases: Numbering,
    /// The single case that a replay selects, if there is a replay.
    case: Option<u64>,
    pub(super) identity: &'a Identity,
    pub(super) inputs: Inputs,
    pub(super) asserted: Asserted,
    /// `true` if the check runs on executors that the test's author supplies.
    own_executors: bool,
    pub(super) executor: &'a dyn Executor,
    /// The textures, samplers and buffers that the test supplies.
    pub(super) fixtures: &'a Fixtures,
    /// The inputs of earlier failures. `None` if Karat stores no failures of this check.
    pub(super) memory: Option<&'a Memory>,
    pub(super) recorded: bool,
    pub(super) accepted: &'a [super::kinds::Accepted],
}

pub(super) type JudgeBatch<'j> =
    &'j mut dyn FnMut(&Batch, Running<'_>) -> Result<PathTally, Failure>;

/// A function that takes rows of arguments, and appends the components of the expected results to a vector.
pub(super) type Expect<'e> = &'e (dyn Fn(Rows<'_>, &mut Vec<f64>) + Sync);

impl<'a> Session<'a> {
    /// Returns the tally if `tested` is `true`, if a case fails, or if a replay runs a single case. Otherwise
    /// the check compared nothing that could fail, so the function returns the error `otherwise`.
    pub(super) fn expect_tested(
        &self,
        tested: bool,
        tally: PathTally,
        otherwise: Vacuous,
    ) -> Result<PathTally, Failure> {
        if tested || self.is_replay() || tally.fails() {
            return Ok(tally);
        }
        self.called.vacuous(otherwise)
    }

    pub(super) fn open(
        (plan, executor): (&'a Plan<'_>, &'a dyn Executor),
        stream: &'a dyn Stream,
        demand: &Demand,
        identity: &'a Identity,
        seed: u64,
        asserted: Asserted,
        inputs: Inputs,
    ) -> Result<Self, Failure> {
        let function = (plan.probe.package, plan.probe.called());
        let given = (&plan.probe.fixtures, &plan.probe.overrides);
        let mut fitting = Fitting::find(function, given, inputs, &demand.arguments, demand.who)?;
        if let Some((place, _)) = &plan.probe.place {
            fitting.declared_at(place.clone());
        }
        let cases = number(plan, fitting.function(), stream, demand, seed, inputs)?;
        let count = usize::try_from(cases.count).unwrap_or(usize::MAX);
        let capacity = room_for(count.saturating_mul(demand.calls));
        let fixtures = &plan.probe.fixtures;
        let called = fitting.on(executor, fixtures, capacity)?;
        let case = identity.case(&plan.probe.name, &with_inputs(&identity.check, inputs));
        if case.is_some() {
            replay::done();
        }
        let own_executors = !plan.probe.executors.is_empty();
        let memory = None;
        Ok(Self {
            called,
            stream,
            cases,
            case,
            identity,
            inputs,
            asserted,
            own_executors,
            executor,
            fixtures,
            memory,
            recorded: plan.recorded,
            accepted: &plan.accepted,
        })
    }

    /// Makes the check run the inputs of earlier failures again, and remember new failing inputs. A check of a function
    /// without arguments has a single case, so the check remembers nothing.
    pub(super) fn remembering(self, memory: Option<&'a Memory>) -> Self {
        // Cases of integrals may have a width of 0 words.
        let memory = memory.filter(|_| self.stream.width() > 0 || self.count() > 1);
        Self { memory, ..self }
    }

    /// The tested function, ready to run in Karat's engine, which also computes the results that WGSL allows.
    pub(super) fn witness(&self) -> Result<Interpreted, ProbeError> {
        Interpreted::new(&self.called.probed, self.fixtures)
    }

    pub(super) fn measured(&self) -> Result<Arc<Accuracy>, ProbeError> {
        // Karat stores nothing for an author's executor or a program, because either may be different in the
        // next run.
        let is_program = self.executor.path().api() == Api::Process;
        executor::measured(self.executor, !self.own_executors && !is_program)
    }

    /// The number of the check's cases, even if a replay selects a single case.
    pub(super) fn count(&self) -> u64 {
        self.cases.count
    }

    /// The path, if environment variables can select the path. `None` if the test's author supplies the executor.
    pub(super) fn selectable(&self) -> Option<Path> {
        (!self.own_executors).then_some(self.called.path)
    }

    pub(super) fn declared(&self) -> u64 {
        if self.case.is_some() { 1 } else { self.count() }
    }

    /// The cases that run: all cases, or the single case that a replay selects.
    pub(super) fn selected(&self) -> Result<Range<u64>, Failure> {
        let count = self.count();
        match self.case {
            Some(case) if case < count => Ok(case..case + 1),
            Some(case) => self.called.vacuous(Vacuous::NoSuchCase { count, case }),
            None => Ok(0..count),
        }
    }

    /// Checks if a replay runs a single case. After such a run, Karat skips the verdicts that need all cases.
    pub(super) fn is_replay(&self) -> bool {
        self.case.is_some()
    }

    /// The value of a case, or the simpler value that a replay selects.
    pub(super) fn case(&self, index: u64) -> Result<Held, Failure> {
        let steps = self.steps();
        if steps.is_empty() {
            let mut source = self.cases.source(index);
            let value = self.stream.value(self.cases.origin(index, &mut source));
            return value.map_or_else(|| self.never_drawn(), Ok);
        }
        let descent = Descent { seed: self.cases.seed, case: index, steps: steps.to_vec() };
        self.descend(&descent).map_or_else(|| self.called.vacuous(Vacuous::NoSuchStep), Ok)
    }

    fn never_drawn<T>(&self) -> Result<T, Failure> {
        self.called.vacuous(Vacuous::Filtered)
    }

    /// The steps of simplification that a replay applies to its case.
    pub(super) fn steps(&self) -> &[usize] {
        self.identity.steps(&self.called.function().name, &self.name())
    }

    /// Follows steps of simplification from a case to a simpler value. `None` if the domain no longer offers one of
    /// these steps.
    pub(super) fn descend(&self, descent: &Descent) -> Option<Held> {
        let Descent { seed, case, steps } = descent;
        let cases = self.cases.with_seed(*seed);
        let mut at = self.stream.shrinkable(cases.origin(*case, &mut cases.source(*case)))?;
        for index in steps {
            at = at.simpler().into_iter().nth(*index)?;
        }
        Some(at.value().clone())
    }

    pub(super) fn dispatch(&self, batch: &Batch) -> Result<Running<'_>, Failure> {
        Ok(self.called.start(&batch.lanes(), batch.cases)?)
    }

    /// Calls the function for each case of a batch, with `lanes` instead of the batch's own arguments.
    pub(super) fn results(&self, batch: &Batch, lanes: &[u32]) -> Result<Results, Failure> {
        self.called.call(lanes, batch.cases)
    }

    /// The check's name in replay commands. The name includes the way to pass arguments.
    pub(super) fn name(&self) -> String {
        with_inputs(&self.identity.check, self.inputs)
    }

    /// The arguments that a replay uses instead of its case's own arguments.
    pub(super) fn input(&self) -> Option<&[u32]> {
        self.identity.input(&self.called.function().name, &self.name())
    }

    /// Samples and dispatches one batch after the other, and passes each batch to `judge`. Then simplifies the
    /// worst failing case with further calls of `judge`.
    pub(super) fn run(&self, judge: JudgeBatch<'_>) -> Result<PathTally, Failure> {
        self.run_searching(judge, None)
    }

    /// Runs the check like [`run`](Self::run). If no case fails, also searches for failing arguments.
    pub(super) fn run_searching(
        &self,
        judge: JudgeBatch<'_>,
        goal: Option<&Goal<'_>>,
    ) -> Result<PathTally, Failure> {
        self.expect_constants()?;
        let remembered = self.remembered();
        let again = self.run_again(&remembered, judge)?;
        let mut sum = self.run_cases(judge)?;
        // Karat doesn't count remembered inputs that pass, so the number of cases stays the same.
        if let Some(mut again) = again.filter(PathTally::fails) {
            let census = &mut again.tally.census;
            census.remembered = census.cases;
            sum = sum.merge(again);
        }
        let goal = goal.filter(|_| !sum.fails());
        let is_proved = goal.is_some_and(|goal| (goal.is_proved)());
        sum = sum.with_proof(is_proved);
        let searched = match goal.filter(|_| !is_proved) {
            Some(goal) => self.search(goal)?,
            None => None,
        };
        if let Some(row) = &searched {
            let batch = self.batch(SEARCHED, row.clone(), 1);
            sum = sum.merge(judge(&batch, self.dispatch(&batch)?)?);
        }
        if let (Some(worst), None) = (&sum.worst, self.input()) {
            let old = worst.case.checked_sub(self.count());
            let old = old.and_then(|index| remembered.get(usize::try_from(index).ok()?));
            let old = if worst.searched { searched.as_ref() } else { old };
            sum.simplest = match old {
                Some(row) => {
                    // The replay command contains the words of the arguments.
                    let (seed, case, steps) = (self.cases.seed, worst.case, Vec::new());
                    let simplest = Simplest::new(worst.clone(), Descent { seed, case, steps });
                    Some(Simplest { input: row.clone(), ..simplest })
                }
                None => {
                    let mut judge = |values: &[Held]| {
                        let rows = values.iter().flat_map(|value| value.row.iter().copied());
                        let batch = self.batch(0, rows.collect(), values.len());
                        judge(&batch, self.dispatch(&batch)?)
                    };
                    let found = self.simplest(worst, self.effort(), &mut judge);
                    found.map(|(simplest, value)| Simplest { input: value.row, ..simplest })
                }
            };
        }
        self.remember(&sum);
        Ok(sum)
    }

    /// Returns an error if the kernel contains the arguments as constants, but WGSL can't write an edge of the domain
    /// as a constant. Without this function, the error would occur only in runs that sample this edge.
    fn expect_constants(&self) -> Result<(), Failure> {
        if self.inputs != Inputs::Constant {
            return Ok(());
        }
        for edge in 0..self.stream.edges() {
            let mut row = Vec::new();
            if self.stream.row(Origin::Edge(edge), &mut row) && !self.is_constant(&row) {
                return self.dispatch(&self.batch(0, row, 1)).map(|_| ());
            }
        }
        Ok(())
    }

    pub(super) fn is_constant(&self, row: &[u32]) -> bool {
        let scalars = self.called.argument_scalars();
        let mut lanes = scalars.iter().zip(row);
        lanes.all(|(scalar, word)| !scalar.is_float() || f32::from_bits(*word).is_finite())
    }

    fn effort(&self) -> Effort {
        match self.inputs {
            Inputs::Constant => Effort::of_constants(self.called.capacity()),
            Inputs::Storage | Inputs::Uniform => Effort::of_calls(self.called.capacity()),
        }
    }

    /// Judges the remembered inputs. Their case numbers follow those of the check's own cases.
    fn run_again(
        &self,
        remembered: &[Vec<u32>],
        judge: JudgeBatch<'_>,
    ) -> Result<Option<PathTally>, Failure> {
        let mut sum = None;
        for (index, row) in (self.count()..).zip(remembered) {
            let batch = self.batch(index, row.clone(), 1);
            let running = self.dispatch(&batch)?;
            sum = Some(PathTally::and(sum, judge(&batch, running)?));
        }
        Ok(sum)
    }

    fn run_cases(&self, judge: JudgeBatch<'_>) -> Result<PathTally, Failure> {
        if let Some(words) = self.input() {
            let (expected, found) = (self.stream.width(), words.len());
            if expected != found {
                return self.called.vacuous(Vacuous::Words { expected, found });
            }
            // A replay may supply an input without a case.
            let case = self.case.unwrap_or(0);
            let batch = self.batch(case, words.to_vec(), 1);
            let running = self.dispatch(&batch)?;
            return judge(&batch, running);
        }
        let Range { start: mut first, end } = self.selected()?;
        let mut draw = || {
            let size = (end - first).min(self.called.capacity() as u64);
            first += size;
            (size > 0).then(|| self.draw(first - size, size)).transpose()
        };
        let mut sum = None;
        let mut next = draw()?;
        while let Some(batch) = next {
            let running = self.dispatch(&batch)?;
            // Samples the next batch while the device runs this batch.
            next = draw()?;
            sum = Some(PathTally::and(sum, judge(&batch, running)?));
        }
        sum.map_or_else(|| self.called.vacuous(Vacuous::NoCases), Ok)
    }

    /// Makes a batch of cases. The first case has the index `first`.
    pub(super) fn batch(&self, first: u64, rows: Vec<u32>, cases: usize) -> Batch {
        Batch::new(first, rows, cases, self.stream.width(), self.called.words)
    }

    pub(super) fn draw(&self, first: u64, size: u64) -> Result<Batch, Failure> {
        if !self.steps().is_empty() {
            return Ok(self.batch(first, self.case(first)?.row, 1));
        }
        let (size, width) =
            (usize::try_from(size).expect("a batch fits in memory"), self.stream.width());
        let rows = parallel::rows(size, width, &|cases, rows| {
            let range = first + cases.start as u64..first + cases.end as u64;
            self.stream.rows(&self.cases, range, rows) == cases.len() as u64
        });
        rows.map_or_else(|| self.never_drawn(), |rows| Ok(self.batch(first, rows, size).drawn()))
    }

    /// Reads the results and judges them. `expect` takes the index of a failing case in the batch, and returns the
    /// expected components, if the verb has any.
    pub(super) fn judge(
        &self,
        batch: &Batch,
        running: Running<'_>,
        expect: impl Fn(usize) -> Option<Vec<f64>>,
        judge: &impl Judge,
    ) -> Result<PathTally, Failure> {
        let judged = running.view(|results| {
            let mut picked = Sample::picked(batch);
            let sum = tally(batch.first, results, judge, &mut picked);
            let cause = cause(self.called.function(), batch, &picked.failing, &sum);
            let sample = Sample::of(&self.called.function().parameters, batch, &sum, picked);
            let tally = PathTally::new(&self.called, sum, |shown: Shown| {
                let case = usize::try_from(shown.case - batch.first).expect("in this batch");
                let actual = results.of(case);
                let (judged, expected) = (judge.judge(case, actual), expect(case));
                let function = self.called.function();
                let arguments = function.arguments(batch.arguments(case));
                let expected = expected.as_deref();
                let remembered = (self.count()..SEARCHED).contains(&shown.case);
                let case = shown.case;
                let failure =
                    CaseFailure::new(function, case, arguments, actual, expected, &judged);
                match judge.describe(actual) {
                    Some(Described { expectations, notes }) => CaseFailure {
                        remembered,
                        result: String::new(),
                        explanation: notes,
                        expectations,
                        ..failure
                    },
                    None => CaseFailure { remembered, ..failure },
                }
            });
            tally.with_sample(sample).with_cause(cause)
        });
        Ok(judged?)
    }

    /// Computes the components that the reference returns for the arguments in `rows`, one row for each case of the
    /// batch. Returns an error if a component isn't finite.
    pub(super) fn expected(
        &self,
        batch: &Batch,
        rows: Rows<'_>,
        expect: Expect<'_>,
    ) -> Result<Vec<f64>, Failure> {
        let width = self.called.scalars().len();
        let finite = AtomicBool::new(true);
        let expected = parallel::rows(rows.len(), width, &|cases, lanes| {
            expect(rows.part(cases), lanes);
            if !lanes.iter().all(|lane| lane.is_finite()) {
                finite.store(false, Ordering::Relaxed);
            }
            true
        });
        let expected = expected.expect("each task appends its rows");
        if !finite.into_inner() {
            self.called.expect_finite(&expected, "result", |case| {
                (batch.first + case as u64, self.stream.show(rows.of(case)))
            })?;
        }
        Ok(expected)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dispatches_are_few_and_of_one_size() {
        for (cases, dispatches) in
            [(0, 0), (1, 1), (65_536, 1), (100_000, 1), (131_072, 1), (131_073, 2), (1_000_000, 8)]
        {
            let room = room_for(cases);
            assert!((SMALLEST..=LARGEST).contains(&room), "{cases}: {room}");
            assert_eq!(cases.div_ceil(room), dispatches, "{cases}: {room}");
            let last = cases - room * dispatches.saturating_sub(1);
            assert!(dispatches < 2 || room - last < dispatches, "{cases}: {last} of {room}");
        }
        assert!(room_for(usize::MAX) <= LARGEST);
    }
}
