//! Functions within which nothing goes wrong.

use super::batch::Batch;
use super::demand::Demand;
use super::plan::Plan;
use super::session::{Asserted, Explained, Session};
use super::tally::{Class, Judged};
use super::{Agreement, Calls, Check, Failure, tolerances};
use crate::domain::Stream;
use crate::interpret::hazards::{Found, Kind};
use crate::run::or_panic;
use crate::tolerance::LaneError;

impl<V> Check<'_, Calls<V>> {
    /// Checks that nothing goes wrong inside of the function, whether or not its result shows it: no
    /// value becomes NaN or infinite, loses more than half of its digits, is looked up outside of an
    /// array, or comes of an operation that WGSL doesn't bound.
    ///
    /// Karat's engine watches each operation; what paths return isn't looked at, but it must be there.
    /// See [`hazards`](mod@crate::unstable::hazards) for what is found without a domain.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// // 1 / 0 is infinite, although `min` hides it from the result.
    /// let text = "fn capped(x: f32) -> f32 { return min(1.0 / x, 100.0); }";
    /// let package = Package::from_source("m", text);
    /// package.function("capped").over(0.001..=1.0).has_no_hazards();
    /// assert!(package.function("capped").over(0.0..=1.0).unrecorded().try_has_no_hazards().is_err());
    /// ```
    ///
    /// # Panics
    /// With the [`Failure`], if something goes wrong, or the engine doesn't execute the function.
    #[track_caller]
    pub fn has_no_hazards(self) -> Agreement {
        or_panic(self.try_has_no_hazards())
    }

    /// [`has_no_hazards`](Self::has_no_hazards) without the panic.
    ///
    /// # Errors
    /// As it panics.
    pub fn try_has_no_hazards(self) -> Result<Agreement, Failure> {
        self.plan.hazards(&*self.stream, &self.demand())
    }
}

impl Plan<'_> {
    pub(super) fn hazards(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
    ) -> Result<Agreement, Failure> {
        let asserted = Asserted {
            explained: Explained::ByHazards,
            ..Asserted::new("has_no_hazards", "nothing goes wrong inside".to_owned())
        };
        self.conclude(&asserted, stream, demand, &mut |session| {
            tolerances::expect_none(&self.tolerance_on, "has_no_hazards", &session.called)?;
            let witness = session.witness()?;
            session.run(&mut |batch: &Batch, running| {
                let found = witness.hazards(batch.cases, &batch.lanes())?.cases;
                let judge = |case: usize, _: &[u32]| Judged {
                    measure: LaneError::statement(found[case].is_empty()),
                    lane: 0,
                    class: found[case].first().map_or(Class::Other, |one| class(one.kind)),
                };
                session.judge(batch, running, |_| None, &judge)
            })
        })
    }
}

fn class(kind: Kind) -> Class {
    match kind {
        Kind::Nan => Class::Nan,
        Kind::Infinite => Class::Infinite,
        Kind::Unbounded => Class::Unbounded,
        Kind::OutOfRange
        | Kind::ByZero
        | Kind::Saturated
        | Kind::EdgesReversed
        | Kind::LostDigits
        | Kind::Race
        | Kind::Barrier
        | Kind::EqualWrites
        | Kind::Unwritten
        | Kind::Endless => Class::Other,
    }
}

impl Session<'_> {
    /// What goes wrong for a row, each a name with its text.
    pub(super) fn hazards_of(&self, row: &[u32]) -> Vec<(&'static str, String)> {
        let found = self.witness().and_then(|witness| witness.hazards(1, row));
        let found = found.ok().and_then(|mut found| found.cases.pop()).unwrap_or_default();
        let shown = |one: &Found| {
            let text = one.text.split_whitespace().collect::<Vec<_>>().join(" ");
            let hidden = if one.hidden { "; a later operation hides it" } else { "" };
            ("hazard", format!("{} at `{text}` ({}){hidden}", one.kind.name(), one.span))
        };
        found.iter().map(shown).collect()
    }
}
