//! The verb `satisfies`: checks that a statement holds for each case's arguments and result.

use std::cell::OnceCell;

use super::batch::Batch;
use super::demand::Demand;
use super::flush::allowing_flushes;
use super::goal::{Distance, Goal};
use super::plan::Plan;
use super::session::Asserted;
use super::{Agreement, Calls, Check, Failure, tolerances};
use crate::domain::Stream;
use crate::executor::Running;
use crate::interpret::Bound;
use crate::judge::{Judged, finite};
use crate::run::or_panic;
use crate::tolerance::LaneError;
use crate::value::{Arguments, Shape, Shareable};

/// A statement about a function's results alone, such as "the result is positive". Karat can prove such a statement for
/// all arguments, or search for arguments that violate the statement.
pub(super) struct Beyond<'b> {
    /// The distance between a result and the nearest excluded value. `None` if the statement excludes no value. Karat
    /// then doesn't search.
    pub(super) distance: Option<Distance<'b>>,
    /// A function that checks if the statement holds for all results whose components lie within the given bounds.
    pub(super) holds: &'b dyn Fn(&[Bound]) -> bool,
}

/// A function that checks if a statement holds for the words of the arguments and of the result.
pub(super) type Holds<'h> = &'h (dyn Fn(&[u32], &[u32]) -> bool + Sync);

impl<V: Arguments> Check<'_, Calls<V>> {
    /// Checks that a statement holds for each case's arguments and result.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS.function("fresnel::schlick")
    ///     .over((UnitRgb, 0.0..=1.0))
    ///     .satisfies("lies between f0 and 1", |(f0, _), f: glam::Vec3| {
    ///         f.cmpge(f0).all() && f.cmple(glam::Vec3::ONE).all()
    ///     });
    /// ```
    ///
    /// A result with a NaN or infinite component fails every statement. WGSL lets drivers flush subnormal
    /// arguments to 0. So a case with subnormal arguments also passes if the statement holds with 0 in their place.
    ///
    /// # Panics
    /// Panics with the [`Failure`] if a case doesn't satisfy the statement or nothing could be checked.
    #[track_caller]
    pub fn satisfies<R: Shareable>(
        self,
        statement: &str,
        holds: impl Fn(V, R) -> bool + Sync,
    ) -> Agreement {
        or_panic(self.try_satisfies(statement, holds))
    }

    /// Runs [`satisfies`](Self::satisfies), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if a case doesn't satisfy the statement or nothing could be checked.
    pub fn try_satisfies<R: Shareable>(
        self,
        statement: &str,
        holds: impl Fn(V, R) -> bool + Sync,
    ) -> Result<Agreement, Failure> {
        let holds = |arguments: &[u32], result: &[u32]| {
            holds(V::load_all(&mut arguments.iter()), R::load(&mut result.iter()))
        };
        let (stream, demand) = (&*self.stream, &self.demand());
        self.plan.satisfies(stream, demand, statement, (&R::shape(), &holds))
    }
}

impl Plan<'_> {
    pub(super) fn satisfies(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
        statement: &str,
        said: (&Shape, Holds<'_>),
    ) -> Result<Agreement, Failure> {
        self.states(stream, demand, ("satisfies", statement), said)
    }

    pub(super) fn states(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
        asserted: (&'static str, &str),
        said: (&Shape, Holds<'_>),
    ) -> Result<Agreement, Failure> {
        self.states_beyond(stream, demand, asserted, said, None)
    }

    /// Checks a verb's statement for each case. If the statement holds for all cases and `beyond` is `Some`, tries to
    /// prove the statement for all arguments. If there is no proof, searches for arguments with a result that reaches
    /// an excluded value.
    pub(super) fn states_beyond(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
        (verb, statement): (&'static str, &str),
        (shape, holds): (&Shape, Holds<'_>),
        beyond: Option<&Beyond<'_>>,
    ) -> Result<Agreement, Failure> {
        let asserted = Asserted::new(verb, statement.to_owned());
        // The proof is the same on every path.
        let proof = OnceCell::new();
        self.conclude(&asserted, stream, demand, &mut |session| {
            tolerances::expect_none(&self.tolerance_on, session.asserted.check, &session.called)?;
            session.called.expect_result(shape, "the statement takes")?;
            let scalars = session.called.scalars();
            let lanes = session.called.argument_scalars();
            let judged = |row: &[u32], actual: &[u32]| {
                let judged = finite(&scalars, actual);
                if !judged.measure.passes() {
                    return judged;
                }
                let of = |row: &[u32]| Judged {
                    measure: LaneError::statement(holds(row, actual)),
                    ..judged
                };
                allowing_flushes(&lanes, row, of(row), of)
            };
            let fails = |row: &[u32], actual: &[u32]| !judged(row, actual).measure.passes();
            let is_proved = || {
                let beyond = beyond.expect("there is a goal");
                *proof.get_or_init(|| session.is_proved(beyond.holds))
            };
            let goal = beyond.map(|beyond| Goal {
                distance: beyond.distance,
                fails: &fails,
                is_proved: &is_proved,
            });
            let mut judge = |batch: &Batch, running: Running<'_>| {
                let judge = |case: usize, actual: &[u32]| judged(batch.arguments(case), actual);
                session.judge(batch, running, |_| None, &judge)
            };
            session.run_searching(&mut judge, goal.as_ref())
        })
    }
}
