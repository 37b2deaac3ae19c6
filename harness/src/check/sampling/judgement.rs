//! The judgement of one configuration, and the calls that offend.

use super::picture::Histogram;
use super::rejection::Finding;
use crate::stats::accepts;

/// The judgement of one configuration.
pub(super) struct Judgement {
    /// The findings. Empty if the samples fit.
    pub(super) findings: Vec<Finding>,
    /// The smallest p-value. 0 if a finding needs no statistics.
    pub(super) p: f64,
    /// Additional facts for the message.
    pub(super) notes: Vec<(&'static str, String)>,
    pub(super) histogram: Option<Histogram>,
}

impl Judgement {
    /// A judgement without findings.
    pub(super) fn fitting() -> Self {
        Self { findings: Vec::new(), p: 1.0, notes: Vec::new(), histogram: None }
    }

    pub(super) fn outright(finding: Finding) -> Self {
        Self { findings: vec![finding], p: 0.0, ..Self::fitting() }
    }

    /// Adds a test's result.
    pub(super) fn test(&mut self, p: f64, threshold: f64, finding: impl FnOnce() -> Finding) {
        self.p = self.p.min(p);
        if !accepts(p, threshold) {
            self.findings.push(finding());
        }
    }
}

/// The number of offending calls, and the first offending call.
#[derive(Default)]
pub(super) struct Offence {
    count: u64,
    first: String,
}

impl Offence {
    pub(super) fn add(&mut self, call: impl FnOnce() -> String) {
        if self.count == 0 {
            self.first = call();
        }
        self.count += 1;
    }

    pub(super) fn finding(self, finding: impl FnOnce(u64, String) -> Finding) -> Option<Finding> {
        (self.count > 0).then(|| finding(self.count, self.first))
    }
}
