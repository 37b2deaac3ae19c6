//! What every check is made of, whatever its verb.

use super::tolerances::Tolerances;
use super::{Failure, Probe};
use crate::path::Selected;
use crate::run::KnownIssues;
use crate::run::sound_paths;
use crate::tolerance::Tolerance;

/// A function with what its author says of a check, but for the cases.
#[derive(Clone, Debug)]
pub(super) struct Plan<'a> {
    pub(super) probe: Probe<'a>,
    pub(super) cases: Option<u64>,
    pub(super) seed: Option<u64>,
    pub(super) tolerance_on: Selected<Tolerance>,
    pub(super) known_issues: KnownIssues,
    /// Hazards that are meant.
    pub(super) accepted: Vec<super::kinds::Accepted>,
    /// True if the verdict goes into the record of the run.
    pub(super) recorded: bool,
}

impl<'a> Plan<'a> {
    pub(super) fn new(probe: Probe<'a>) -> Self {
        let (tolerance_on, known_issues) = Default::default();
        Self {
            probe,
            cases: None,
            seed: None,
            tolerance_on,
            known_issues,
            accepted: Vec::new(),
            recorded: true,
        }
    }

    /// A verb's tolerance with those of single paths.
    pub(super) fn tolerances(&self, general: Tolerance) -> Tolerances {
        Tolerances { general, on: self.tolerance_on.clone() }
    }

    /// Wants paths that can be, and a reason for each that is declared to fail.
    pub(super) fn expect_reasons(&self) -> Result<(), Failure> {
        self.known_issues.expect_sound::<Failure>(&self.probe.name)?;
        Ok(sound_paths("tolerance_on", &self.tolerance_on)?)
    }
}
