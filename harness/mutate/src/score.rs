//! The mutation score.

use crate::{Fate, Tried};

/// The numbers of mutants, by fate.
///
/// ```
/// use karat_mutate::Score;
///
/// let score = Score { killed: 19, lived: 1, ..Score::default() };
/// assert_eq!(score.percent(), Some(95.0));
/// assert_eq!(Score::default().percent(), None, "no mutant counts");
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Score {
    /// Mutants that a test killed.
    pub killed: usize,
    /// Mutants that passed all tests that use the mutated code.
    pub lived: usize,
    /// Mutants in code that no test uses.
    pub untested: usize,
    /// Mutants that are equivalent to the original, so that no test can see them.
    pub equal: usize,
    /// Mutants that `karat.toml` accepts.
    pub accepted: usize,
    /// Mutants that aren't valid WGSL.
    pub invalid: usize,
    /// Mutants in code that no linked function contains, for example because an `@if` removes the code.
    pub idle: usize,
    /// Mutants without a verdict: a test ended without a verdict, or Karat couldn't find the tests.
    pub stopped: usize,
}

impl Score {
    /// Counts mutants by their fates.
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

    /// The number of mutants that count in the score: the killed, living and untested ones.
    #[must_use]
    pub fn judged(&self) -> usize {
        self.killed + self.lived + self.untested
    }

    /// The percentage of killed mutants among [`judged`](Self::judged) ones, rounded down to 0.1; `None` if no mutant
    /// counts.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "a share to a tenth of a per cent")]
    pub fn percent(&self) -> Option<f64> {
        (self.judged() > 0).then(|| (1000 * self.killed / self.judged()) as f64 / 10.0)
    }
}
