//! The score of a hunt: its verdicts, counted.

use crate::{Fate, Tried};

/// Mutants by what became of them.
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
    /// Those that a test failed for.
    pub killed: usize,
    /// Those that the tests they are part of passed with.
    pub lived: usize,
    /// Those that no test is made of.
    pub untested: usize,
    /// Those that do what the original does. No test can see them.
    pub equal: usize,
    /// Those that `karat.toml` accepts.
    pub accepted: usize,
    /// Those that are no valid WGSL.
    pub invalid: usize,
    /// Those that are in no function as it is linked, such as under a condition that doesn't hold.
    pub idle: usize,
    /// Those without a verdict: a test ended without one, or the tests can't be found.
    pub stopped: usize,
}

impl Score {
    /// The sum over mutants.
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

    /// Mutants that a test could kill, and of which it is known whether one does.
    #[must_use]
    pub fn judged(&self) -> usize {
        self.killed + self.lived + self.untested
    }

    /// Killed ones in per cent of these, and not rounded up; `None` if there are none.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "a share to a tenth of a per cent")]
    pub fn percent(&self) -> Option<f64> {
        (self.judged() > 0).then(|| (1000 * self.killed / self.judged()) as f64 / 10.0)
    }
}
