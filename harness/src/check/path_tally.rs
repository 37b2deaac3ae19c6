//! The results of a check on one path: the counts over all cases, and the failing cases that a report shows.

use super::called::Called;
use super::sample::Sample;
use super::{CaseFailure, Simplest};
use crate::judge::{Shown, Tally};
use crate::path::{Adapter, Path};
use crate::record::{Allowance, PathRecord};

/// The number of cases and failures on one path, the worst error, and the failing cases that a report shows.
pub(super) struct PathTally {
    pub(super) adapter: Adapter,
    pub(super) path: Path,
    pub(super) tally: Tally,
    pub(super) worst: Option<CaseFailure>,
    pub(super) first: Option<CaseFailure>,
    pub(super) simplest: Option<Simplest>,
    /// One line that says for which arguments the function fails.
    pub(super) cause: Option<String>,
    /// The errors that WGSL allows the function, compared with the tolerance.
    pub(super) allowed: Option<Allowance>,
    /// The cases for the plots in reports.
    sample: Option<Sample>,
    /// The number of nodes of all integrals. 0 for checks without integrals.
    nodes: u64,
    /// `true` if the statement is proved for all arguments of the domain.
    proved: bool,
}

impl PathTally {
    /// Makes the tally of a path. `show` describes a failing case.
    pub(super) fn new(
        called: &Called<'_>,
        tally: Tally,
        show: impl Fn(Shown) -> CaseFailure,
    ) -> Self {
        let failing = tally.census.failures > 0;
        Self {
            adapter: called.adapter.clone(),
            path: called.path,
            worst: tally.worst.filter(|_| failing).map(&show),
            first: tally.first.map(&show),
            simplest: None,
            cause: None,
            tally,
            allowed: None,
            sample: None,
            nodes: 0,
            proved: false,
        }
    }

    pub(super) fn with_nodes(self, nodes: u64) -> Self {
        Self { nodes, ..self }
    }

    pub(super) fn with_proof(self, proved: bool) -> Self {
        Self { proved: proved && !self.fails(), ..self }
    }

    pub(super) fn is_proved(&self) -> bool {
        self.proved
    }

    pub(super) fn with_sample(self, sample: Option<Sample>) -> Self {
        Self { sample, ..self }
    }

    pub(super) fn with_cause(self, cause: Option<String>) -> Self {
        Self { cause, ..self }
    }

    pub(super) fn fails(&self) -> bool {
        self.tally.census.failures > 0
    }

    pub(super) fn record(&self, asserted: &str) -> PathRecord {
        let worst = self.tally.worst.map(|worst| worst.judged.measure);
        PathRecord {
            cases: self.tally.census.judged(),
            failures: self.tally.census.failures,
            worst: match self.proved {
                true => "proved".to_owned(),
                false => worst.map_or_else(String::new, |measure| measure.to_string()),
            },
            ratio: worst.map(|measure| measure.ratio).filter(|ratio| ratio.is_finite()),
            asserted: match self.nodes {
                0 => asserted.to_owned(),
                nodes => format!("{asserted} ({nodes} nodes)"),
            },
            allowed: self.allowed,
            errors: self.sample.as_ref().map(Sample::errors),
            plot: self.sample.as_ref().filter(|_| self.fails()).map(Sample::plot),
            ..PathRecord::of(self.adapter.clone())
        }
    }

    pub(super) fn merge(self, other: Self) -> Self {
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

    /// Merges the earlier tally, if there is one, with the later tally.
    pub(super) fn and(earlier: Option<Self>, later: Self) -> Self {
        match earlier {
            Some(earlier) => earlier.merge(later),
            None => later,
        }
    }
}
