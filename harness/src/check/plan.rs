//! The settings of a check that are the same for every verb.

use super::tolerances::Tolerances;
use super::{Failure, Probe};
use crate::path::Selected;
use crate::run::KnownIssues;
use crate::run::sound_paths;
use crate::tolerance::Tolerance;

/// A function with the settings of its check, but without the domain.
#[derive(Clone, Debug)]
pub(super) struct Plan<'a> {
    pub(super) probe: Probe<'a>,
    pub(super) cases: Option<u64>,
    pub(super) seed: Option<u64>,
    pub(super) tolerance_on: Selected<Tolerance>,
    pub(super) known_issues: KnownIssues,
    pub(super) accepted: Vec<super::kinds::Accepted>,
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

    /// Returns the verb's tolerance together with the tolerances that the check sets for single paths.
    pub(super) fn tolerances(&self, general: Tolerance) -> Tolerances {
        Tolerances { general, on: self.tolerance_on.clone() }
    }

    /// Returns an error if a declaration names a path that can't exist, or declares a failure without a reason.
    pub(super) fn expect_reasons(&self) -> Result<(), Failure> {
        self.known_issues.expect_sound::<Failure>(&self.probe.name)?;
        Ok(sound_paths("tolerance_on", &self.tolerance_on)?)
    }
}
