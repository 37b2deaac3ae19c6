//! The score of a hunt: the number of mutants by fate.

use crate::{Fate, Tried};

/// The number of mutants by fate.
///
/// ```
/// use karat_mutate::Score;
///
/// let score = Score { killed: 19, lived: 1, ..Score::default() };
/// assert_eq!(score.percent(), Some(95.0));
/// assert_eq!(Score::default().percent(), None, "nothing was judged");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Score {
    /// Mutants for which a test failed.
    pub killed: usize,
    /// Mutants for which all of their tests passed.
    pub lived: usize,
    /// Mutants that no test uses.
    pub untested: usize,
    /// Mutants that are equivalent to the original. No test can see them.
    pub equal: usize,
    /// Mutants that `karat.toml` accepts.
    pub accepted: usize,
    /// Mutants that aren't valid WGSL.
    pub invalid: usize,
    /// Mutants that aren't part of a linked function, for example because a condition leaves them out.
    pub idle: usize,
    /// Mutants without a verdict: a test ended without one, or the tests can't be found.
    pub stopped: usize,
}

impl Score {
    /// Counts mutants.
    pub fn of<'t>(all: impl IntoIterator<Item = &'t Tried>) -> Self {
        let mut sum = Self::default();
        for Tried { fate, .. } in all {
            *match fate {
                Fate::Killed { .. } => &mut sum.killed,
                Fate::Equal { .. } => &mut sum.equal,
                Fate::Lived { .. } => &mut sum.lived,
                Fate::Untested { .. } => &mut sum.untested,
                Fate::Accepted { .. } => &mut sum.accepted,
                Fate::Invalid { .. } => &mut sum.invalid,
                Fate::Idle => &mut sum.idle,
                Fate::Stopped { .. } | Fate::Unknown { .. } => &mut sum.stopped,
            } += 1;
        }
        sum
    }

    /// The mutants that count: a test could kill them, and their fate is known.
    #[must_use]
    pub fn judged(&self) -> usize {
        self.killed + self.lived + self.untested
    }

    /// The killed mutants in per cent of these, rounded down; `None` if there are none.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "a share to a tenth of a per cent")]
    pub fn percent(&self) -> Option<f64> {
        (self.judged() > 0).then(|| (1000 * self.killed / self.judged()) as f64 / 10.0)
    }
}
