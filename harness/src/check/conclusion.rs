//! Makes a check's verdict of the sums of its paths.

use super::path_tally::PathTally;
use super::session::Session;
use super::{Agreement, Disagreement, Failure, PathDisagreement, Simplest, Vacuous};
use crate::run::{Descent, Replayed};
use crate::tolerance::LaneError;

impl Session<'_> {
    /// Whether all paths agree, each of them on every case.
    pub(super) fn conclude(&self, tallies: Vec<PathTally>) -> Result<Agreement, Failure> {
        let compared = tallies.iter().map(|path| path.tally.census.cases).min().unwrap_or(0);
        let declared = self.declared();
        if compared < declared {
            return self.called.vacuous(Vacuous::Uncompared { declared, compared });
        }
        if tallies.iter().any(PathTally::fails) {
            return Err(self.disagreement(tallies));
        }
        let judged = tallies.iter().map(|path| path.tally.census.judged()).min().unwrap_or(0);
        let worst_of = |path: &PathTally| {
            path.tally.worst.map_or(LaneError::ZERO, |worst| worst.judged.measure)
        };
        let worst = tallies.iter().map(worst_of).max_by(|a, b| a.ratio.total_cmp(&b.ratio));
        Ok(Agreement {
            function: self.called.function().name.clone(),
            cases: judged,
            paths: tallies.iter().map(|path| (path.adapter.clone(), worst_of(path))).collect(),
            worst: worst.unwrap_or(LaneError::ZERO),
            known_issues: Vec::new(),
        })
    }

    fn disagreement(&self, tallies: Vec<PathTally>) -> Failure {
        let mut agreeing = Vec::new();
        let mut paths = Vec::new();
        for tally in tallies {
            match tally.fails() {
                true => paths.extend(self.path_disagreement(tally)),
                false => agreeing.push((tally.adapter, self.inputs)),
            }
        }
        Failure::Disagreement(Box::new(Disagreement {
            function: self.called.function().clone(),
            check: self.asserted.check,
            assertion: self.asserted.text.clone(),
            expectation: self.asserted.expectation,
            paths,
            agreeing,
            domain: self.stream.described(),
            seed: self.cases.seed,
        }))
    }

    /// The failures of one path with the commands that replay them.
    fn path_disagreement(&self, tally: PathTally) -> Option<PathDisagreement> {
        let PathTally { adapter, path, tally, worst, first, simplest, cause, .. } = tally;
        let worst = worst?;
        let replay = |seed: u64, replayed: Replayed<'_>| {
            let (function, check) = (&self.called.function().name, &self.name());
            self.identity.replay(self.selectable(path), seed, function, check, replayed)
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
        let replay_worst = match simplest.as_ref().filter(|_| worst.remembered) {
            Some(old) => replay_of(old),
            None => {
                let (steps, input) = (self.steps(), self.input());
                replay(self.cases.seed, Replayed { case: worst.case, steps, input })
            }
        };
        let reduced = |simplest: &Simplest| !worst.remembered && !simplest.descent.steps.is_empty();
        let simplest = simplest.filter(reduced);
        let mut simplest =
            simplest.map(|simplest| Simplest { replay: replay_of(&simplest), ..simplest });
        let mut worst = worst;
        match &mut simplest {
            Some(Simplest { failure, input, .. }) => self.explain(failure, input, path),
            None => {
                let row = self.input().map(<[u32]>::to_vec);
                let drawn = || Some(self.case(worst.case).ok()?.row);
                let row = row.or_else(|| drawn().filter(|_| !worst.remembered));
                self.explain(&mut worst, &row.unwrap_or_default(), path);
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
