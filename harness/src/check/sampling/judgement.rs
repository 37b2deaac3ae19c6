//! The judgement of one configuration, and the calls with wrong results.

use super::picture::Histogram;
use super::rejection::Finding;
use crate::stats::accepts;

pub(super) struct Judgement {
    /// The reasons to reject the configuration. Empty if the samples are acceptable.
    pub(super) findings: Vec<Finding>,
    /// The smallest p-value. 0 if there is a finding that doesn't depend on statistics.
    pub(super) p: f64,
    pub(super) notes: Vec<(&'static str, String)>,
    pub(super) histogram: Option<Histogram>,
}

impl Judgement {
    pub(super) fn fitting() -> Self {
        Self { findings: Vec::new(), p: 1.0, notes: Vec::new(), histogram: None }
    }

    pub(super) fn outright(finding: Finding) -> Self {
        Self { findings: vec![finding], p: 0.0, ..Self::fitting() }
    }

    /// Adds the result of a statistical test, and its finding if the test fails.
    pub(super) fn test(&mut self, p: f64, threshold: f64, finding: impl FnOnce() -> Finding) {
        self.p = self.p.min(p);
        if !accepts(p, threshold) {
            self.findings.push(finding());
        }
    }
}

/// The number of calls with one kind of wrong result, and the first of these calls as text.
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
