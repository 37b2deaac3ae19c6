//! Combines the results of all paths into a check's verdict.

use super::path_tally::PathTally;
use super::session::{Asserted, Session};
use super::{Agreement, Disagreement, Failure, PathDisagreement, Plan, Simplest, Vacuous};
use crate::path::Adapter;
use crate::probe::Inputs;
use crate::reflect::Function;
use crate::run::{Conclusion, Descent, Replayed};
use crate::tolerance::LaneError;

/// The results on one path, for one way to pass arguments: in a storage buffer, in a uniform buffer, or as constants.
pub(super) struct Outcome {
    function: Function,
    inputs: Inputs,
    /// The number of cases in which the check made an assertion.
    cases: u64,
    worst: LaneError,
    proved: bool,
    seed: u64,
    /// The disagreement, if the path fails and the report shows this failure.
    disagreement: Option<PathDisagreement>,
}

impl Session<'_> {
    /// Builds the outcome of the path. If `told` is set and the path fails, the outcome includes the failure.
    /// Returns an error if the check didn't compare all cases.
    pub(super) fn outcome(&self, tally: PathTally, told: bool) -> Result<Outcome, Failure> {
        let (compared, declared) = (tally.tally.census.cases, self.declared());
        if compared < declared {
            return self.called.vacuous(Vacuous::Uncompared { declared, compared });
        }
        let worst = tally.tally.worst.map_or(LaneError::ZERO, |worst| worst.judged.measure);
        Ok(Outcome {
            function: self.called.function().clone(),
            inputs: self.inputs,
            cases: tally.tally.census.judged(),
            worst,
            proved: tally.is_proved(),
            seed: self.cases.seed,
            disagreement: (told && tally.fails()).then(|| self.path_disagreement(tally)).flatten(),
        })
    }

    fn path_disagreement(&self, tally: PathTally) -> Option<PathDisagreement> {
        let PathTally { adapter, tally, worst, first, simplest, cause, .. } = tally;
        let worst = worst?;
        let replay = |seed: u64, replayed: Replayed<'_>| {
            let (function, check) = (&self.called.function().name, &self.name());
            self.identity.replay(self.selectable(), seed, function, check, replayed)
        };
        let replay_of = |simplest: &Simplest| match &*simplest.input {
            [] => {
                let Descent { seed, case, steps } = &simplest.descent;
                replay(*seed, Replayed { case: *case, steps, input: None })
            }
            input => {
                let case = worst.case;
                replay(self.cases.seed, Replayed { case, steps: &[], input: Some(input) })
            }
        };
        let replay_worst = match simplest.as_ref().filter(|_| !worst.is_drawn()) {
            Some(old) => replay_of(old),
            None => {
                let (steps, input) = (self.steps(), self.input());
                replay(self.cases.seed, Replayed { case: worst.case, steps, input })
            }
        };
        let reduced = |simplest: &Simplest| worst.is_drawn() && !simplest.descent.steps.is_empty();
        let simplest = simplest.filter(reduced);
        let mut simplest =
            simplest.map(|simplest| Simplest { replay: replay_of(&simplest), ..simplest });
        let mut worst = worst;
        match &mut simplest {
            Some(Simplest { failure, input, .. }) => self.explain(failure, input),
            None => {
                let row = self.input().map(<[u32]>::to_vec);
                let drawn = || Some(self.case(worst.case).ok()?.row);
                let row = row.or_else(|| drawn().filter(|_| worst.is_drawn()));
                self.explain(&mut worst, &row.unwrap_or_default());
            }
        }
        Some(PathDisagreement {
            adapter,
            inputs: self.inputs,
            census: tally.census,
            cause,
            first: first.filter(|first| first.case != worst.case),
            replay: replay_worst,
            simplest,
            worst,
        })
    }
}

impl Plan<'_> {
    pub(super) fn verdict(
        &self,
        asserted: &Asserted,
        domain: String,
        all: Conclusion<Outcome, Failure>,
    ) -> Result<Agreement, Failure> {
        let differ = |differing: Vec<(Adapter, Outcome)>, agreeing: &[(Adapter, Outcome)]| {
            let Some((_, first)) = differing.first() else { return Vec::new() };
            let (function, seed) = (first.function.clone(), first.seed);
            let agreeing = agreeing.iter().map(|(adapter, one)| (adapter.clone(), one.inputs));
            let disagreement = Disagreement {
                function,
                check: asserted.check,
                assertion: asserted.text.clone(),
                expectation: asserted.expectation,
                paths: differing.into_iter().filter_map(|(_, one)| one.disagreement).collect(),
                agreeing: agreeing.collect(),
                domain,
                seed,
            };
            vec![Failure::Disagreement(Box::new(disagreement))]
        };
        let (agreeing, known_issues) = all.verdict(differ)?;
        // Each way to pass arguments has its own cases. All paths run the same cases.
        let mut cases = 0;
        for inputs in Inputs::ALL {
            let own = agreeing.iter().filter(|(_, one)| one.inputs == inputs);
            cases += own.map(|(_, one)| one.cases).min().unwrap_or(0);
        }
        if agreeing.is_empty() {
            cases = known_issues.iter().map(|issue| issue.cases).min().unwrap_or(0);
        }
        let proved = !agreeing.is_empty() && agreeing.iter().all(|(_, one)| one.proved);
        let worst = agreeing.iter().map(|(_, one)| one.worst);
        let worst = worst.max_by(|a, b| a.ratio.total_cmp(&b.ratio)).unwrap_or(LaneError::ZERO);
        let function = agreeing.first().map(|(_, one)| one.function.name.clone());
        Ok(Agreement {
            function: function.unwrap_or_else(|| self.probe.name.clone()),
            cases,
            paths: agreeing.into_iter().map(|(adapter, one)| (adapter, one.worst)).collect(),
            worst,
            proved,
            known_issues,
        })
    }
}
