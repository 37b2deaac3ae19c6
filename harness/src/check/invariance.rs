//! The verbs `invariant_under` and `scales_under`. These verbs transform the arguments, and check that the result stays
//! the same or changes by a known factor.

use super::batch::Batch;
use super::demand::Demand;
use super::plan::Plan;
use super::property::{Exhibit, PRIMED};
use super::session::{Asserted, Session};
use super::{Agreement, Calls, Check, Failure, Vacuous};
use crate::domain::Stream;
use crate::judge::compare;
use crate::run::or_panic;
use crate::tolerance::Tolerance;
use crate::value::Arguments;

/// A function that transforms a row of arguments, and appends the words of the new arguments to a vector.
pub(super) type Transform<'t> = &'t (dyn Fn(&[u32], &mut Vec<u32>) + Sync);

/// A function that returns the factor by which the result must change. The function receives the words of the original
/// arguments.
type Factor<'t> = &'t (dyn Fn(&[u32]) -> f64 + Sync);

/// The verb's name, and for `scales_under` the function that returns the expected factor.
#[derive(Clone, Copy)]
pub(super) struct Scaling<'t> {
    check: &'static str,
    factor: Option<Factor<'t>>,
}

impl Scaling<'_> {
    /// The verb `invariant_under`, which needs no factor, because the result must stay the same.
    pub(super) const NONE: Self = Self { check: "invariant_under", factor: None };

    /// Computes the factor for each case. `None` if the result must stay the same. Returns an error if a factor
    /// isn't finite.
    fn factors(&self, session: &Session<'_>, batch: &Batch) -> Result<Option<Vec<f64>>, Failure> {
        let Some(factor) = self.factor else { return Ok(None) };
        let factors: Vec<f64> =
            (0..batch.cases).map(|case| factor(batch.arguments(case))).collect();
        let Some(case) = factors.iter().position(|factor| !factor.is_finite()) else {
            return Ok(Some(factors));
        };
        Err(Failure::Reference {
            function: session.called.function().name.clone(),
            value: factors[case],
            place: "factor".to_owned(),
            case: batch.first + case as u64,
            arguments: session.stream.show(batch.rows().of(case)),
        })
    }
}

impl<V: Arguments> Check<'_, Calls<V>> {
    /// Checks that the function returns the same result for transformed arguments, to within a tolerance. Use
    /// this verb to test reciprocity, symmetry and rotation.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "fn halfway(v: vec3f, l: vec3f) -> vec3f { return normalize(v + l); }";
    /// // Opposite directions have no halfway vector.
    /// let apart = (Hemisphere, Hemisphere).filter(|(v, l)| (*v + *l).length() > 0.1);
    /// let package = Package::from_source("brdf", text);
    /// package.function("halfway").over(apart).invariant_under(|(v, l)| (l, v), Ulp(0.0));
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if a result is wrong or nothing could be compared.
    #[track_caller]
    pub fn invariant_under(
        self,
        transform: impl Fn(V) -> V + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Agreement {
        or_panic(self.try_invariant_under(transform, tolerance))
    }

    /// Runs [`invariant_under`](Self::invariant_under), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if a result is wrong or nothing could be compared.
    pub fn try_invariant_under(
        self,
        transform: impl Fn(V) -> V + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let (stream, demand, transform) = (&*self.stream, &self.demand(), words(transform));
        self.plan.is_invariant(stream, demand, &transform, Scaling::NONE, tolerance.into())
    }

    /// Checks that transforming the arguments multiplies the result by a factor, to within a tolerance.
    ///
    /// `factor` receives the original arguments. The result for the transformed arguments must be the factor
    /// times the result for the original arguments. For example, if a function returns a BRDF times the cosine,
    /// swapping the two directions multiplies the result by the quotient of their cosines (Helmholtz; pbrt,
    /// 4.3.1). A factor that isn't finite is an error.
    ///
    /// ```
    /// use karat::prelude::*;
    ///
    /// // Lambert's BRDF times the cosine of the light.
    /// let brdf = Package::from_source(
    ///     "brdf",
    ///     "fn eval(albedo: f32, v: vec3f, l: vec3f) -> f32 { return albedo / 3.14159265 * l.z; }",
    /// );
    /// let above = Hemisphere.above(0.01);
    /// brdf.function("eval").over((0.0..=1.0, above, above)).scales_under(
    ///     |(albedo, v, l)| (albedo, l, v),
    ///     |(_, v, l)| f64::from(v.z) / f64::from(l.z),
    ///     Rel(1e-5),
    /// );
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if a result is wrong or nothing could be compared.
    #[track_caller]
    pub fn scales_under(
        self,
        transform: impl Fn(V) -> V + Sync,
        factor: impl Fn(V) -> f64 + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Agreement {
        or_panic(self.try_scales_under(transform, factor, tolerance))
    }

    /// Runs [`scales_under`](Self::scales_under), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if a result is wrong or nothing could be compared.
    pub fn try_scales_under(
        self,
        transform: impl Fn(V) -> V + Sync,
        factor: impl Fn(V) -> f64 + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let factor = |row: &[u32]| factor(V::load_all(&mut row.iter()));
        let scaling = Scaling { check: "scales_under", factor: Some(&factor) };
        let (stream, demand, transform) = (&*self.stream, &self.demand(), words(transform));
        self.plan.is_invariant(stream, demand, &transform, scaling, tolerance.into())
    }
}

/// Turns a function that transforms Rust values into a function that transforms their `u32` words.
fn words<V: Arguments>(transform: impl Fn(V) -> V + Sync) -> impl Fn(&[u32], &mut Vec<u32>) + Sync {
    move |row, lanes| transform(V::load_all(&mut row.iter())).store_all(lanes)
}

/// The note that a report of `scales_under` prints beside the returned value.
const SCALED: &str = "returned for the arguments with a prime ('); expected: the result for the arguments without a prime, times the factor";

impl Plan<'_> {
    pub(super) fn is_invariant(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
        transform: Transform<'_>,
        scaling: Scaling<'_>,
        tolerance: Tolerance,
    ) -> Result<Agreement, Failure> {
        let tolerances = self.tolerances(tolerance);
        let asserted = Asserted::new(scaling.check, tolerances.general.to_string());
        self.conclude(&asserted, stream, demand, &mut |session| {
            tolerances.expect_usable(&session.called)?;
            let called = &session.called;
            let (scalars, tolerance) = (called.scalars(), tolerances.of(called));
            let mut changed = false;
            let tally = session.run(&mut |batch, running| {
                let before = running.read()?;
                let mut lanes = Vec::with_capacity(batch.cases * called.words);
                batch.rows().iter().for_each(|row| transform(row, &mut lanes));
                changed |= *lanes != *batch.lanes();
                let after = session.results(batch, &lanes)?;
                let factors = scaling.factors(session, batch)?;
                // The expected result: the result for the original arguments, times the factor.
                let expected = |case: usize| -> Vec<f64> {
                    let decoded =
                        scalars.iter().zip(before.of(case)).map(|(s, word)| s.decode(*word));
                    let factor = factors.as_ref().map_or(1.0, |factors| factors[case]);
                    decoded.map(|lane| lane * factor).collect()
                };
                let judge =
                    |case: usize| compare(&scalars, after.of(case), &expected(case), tolerance);
                let exhibit = |case: usize| {
                    let plain = batch.arguments(case).to_vec();
                    let primed = batch.with_lanes(&lanes).of(case);
                    let own = called.function().arguments(&plain);
                    let primed = called.function().arguments(primed).into_iter();
                    let changed = primed.zip(&own).filter(|(primed, plain)| primed != *plain);
                    Exhibit {
                        varied: changed.map(|((name, v), _)| (format!("{name}'"), v)).collect(),
                        lanes: plain,
                        compared: if scaling.factor.is_some() { SCALED } else { PRIMED },
                        actual: after.of(case).to_vec(),
                        expected: expected(case),
                        judged: judge(case),
                    }
                };
                Ok(session.judge_results(batch, &after, judge, exhibit))
            })?;
            session.expect_tested(changed, tally, Vacuous::Untransformed)
        })
    }
}
