//! The verb `equivariant_under`: checks that results rotate with their arguments.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use glam::{DQuat, DVec3};

use super::companion::{Companion, WithCompanion};
use super::demand::Demand;
use super::plan::Plan;
use super::property::Exhibit;
use super::session::Asserted;
use super::{Agreement, Calls, Check, Failure, Vacuous};
use crate::domain::{Source, Stream};
use crate::judge::compare;
use crate::run::or_panic;
use crate::tolerance::{Tolerance, significant};
use crate::value::{Arguments, Mirror, Shape, Shareable};

/// A function that reads a value from `u32` words, rotates the value, and appends the rotated value as `u32`
/// words or as `f64` components.
type Turn<'t, T> = &'t (dyn Fn(&[u32], DQuat, &mut Vec<T>) + Sync);

/// The functions that rotate arguments and results.
struct Turned<'t> {
    arguments: Turn<'t, u32>,
    result: Turn<'t, f64>,
    shape: Shape,
}

impl<V: Arguments> Check<'_, Calls<V>> {
    /// Checks that the result rotates with its arguments. Each case has a random rotation. Seven of eight
    /// rotations are uniformly distributed. One of eight is a quarter turn about the x, y or z axis.
    ///
    /// `arguments` rotates the arguments that are directions. `result` rotates the result, or returns it
    /// unchanged if the function only measures angles.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// use glam::{DQuat, Vec3};
    ///
    /// // fn bounce(n: vec3f, v: vec3f) -> vec3f
    /// let turned = |q: DQuat, d: Vec3| (q * d.as_dvec3()).as_vec3();
    /// SHADERS.function("mirror::bounce").over((UnitVector, UnitVector)).equivariant_under(
    ///     move |(n, v), q| (turned(q, n), turned(q, v)),
    ///     |l: Vec3, q| q * l.as_dvec3(),
    ///     Abs(1e-6),
    /// );
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if a result doesn't rotate with its arguments, if no rotation changes
    /// any argument, or if nothing could be compared.
    #[track_caller]
    pub fn equivariant_under<R: Shareable>(
        self,
        arguments: impl Fn(V, DQuat) -> V + Sync,
        result: impl Fn(R, DQuat) -> R::Mirror + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Agreement {
        or_panic(self.try_equivariant_under(arguments, result, tolerance))
    }

    /// Runs [`equivariant_under`](Self::equivariant_under), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if a result doesn't rotate with its arguments, if no rotation changes any argument, or if
    /// nothing could be compared.
    pub fn try_equivariant_under<R: Shareable>(
        self,
        arguments: impl Fn(V, DQuat) -> V + Sync,
        result: impl Fn(R, DQuat) -> R::Mirror + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let turned = Turned {
            arguments: &|row, rotation, lanes| {
                arguments(V::load_all(&mut row.iter()), rotation).store_all(lanes);
            },
            result: &|words, rotation, lanes| {
                result(R::load(&mut words.iter()), rotation).lanes(lanes);
            },
            shape: R::shape(),
        };
        self.plan.is_equivariant(&*self.stream, &self.demand(), &turned, tolerance.into())
    }
}

impl Plan<'_> {
    fn is_equivariant(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
        turned: &Turned<'_>,
        tolerance: Tolerance,
    ) -> Result<Agreement, Failure> {
        let tolerances = self.tolerances(tolerance);
        let asserted = Asserted::new("equivariant_under", tolerances.general.to_string());
        let stream = WithCompanion { arguments: stream, companion: &Rotations };
        self.conclude(&asserted, &stream, demand, &mut |session| {
            let called = &session.called;
            called.expect_result(&turned.shape, "the function that rotates the result takes")?;
            tolerances.expect_usable(&session.called)?;
            let (scalars, tolerance) = (called.scalars(), tolerances.of(called));
            let mut changed = false;
            let tally = session.run(&mut |batch, running| {
                let rotation = |case: usize| rotation(batch.companion(case));
                let mut lanes = Vec::with_capacity(batch.cases * called.words);
                for case in 0..batch.cases {
                    (turned.arguments)(batch.arguments(case), rotation(case), &mut lanes);
                }
                changed |= *lanes != *batch.lanes();
                let before = running.read()?;
                let after = session.results(batch, &lanes)?;
                let expected = |case: usize| {
                    let mut expected = Vec::with_capacity(scalars.len());
                    (turned.result)(before.of(case), rotation(case), &mut expected);
                    expected
                };
                let judge =
                    |case: usize| compare(&scalars, after.of(case), &expected(case), tolerance);
                let exhibit = |case: usize| Exhibit {
                    lanes: batch.arguments(case).to_vec(),
                    varied: vec![("rotation".to_owned(), shown(rotation(case)))],
                    compared: "returned for the rotated arguments; expected: the rotated result for the original arguments",
                    actual: after.of(case).to_vec(),
                    expected: expected(case),
                    judged: judge(case),
                };
                Ok(session.judge_results(batch, &after, judge, exhibit))
            })?;
            session.expect_tested(changed, tally, Vacuous::Unrotated)
        })
    }
}

struct Rotations;

/// The rotations to which Karat simplifies a failing case's rotation, the simplest first: half turns, quarter turns and
/// turns by 106 degrees, around the x, y and z axes. The quaternion of a turn by 106 degrees is simple: its components
/// are 4/5, 3/5 and zeros.
fn simple() -> impl Iterator<Item = [u32; 4]> {
    let about = |imaginary: f64, real: f64| {
        DVec3::AXES.map(|axis| {
            let imaginary = imaginary * axis;
            words(DQuat::from_xyzw(imaginary.x, imaginary.y, imaginary.z, real))
        })
    };
    let all = [about(1.0, 0.0), about(FRAC_1_SQRT_2, FRAC_1_SQRT_2), about(0.8, 0.6)];
    all.into_iter().flatten()
}

impl Companion for Rotations {
    fn words(&self) -> usize {
        4
    }

    /// Samples a uniform rotation by Shoemake's method: "Uniform Random Rotations", 1992.
    fn draw(&self, _: &[u32], source: &mut Source) -> Vec<u32> {
        if source.below(8) == 0 {
            let axis = usize::try_from(source.below(3)).unwrap_or_default();
            return simple().nth(3 + axis).expect("there are three quarter turns").to_vec();
        }
        let (share, first, second) = (source.unit(), TAU * source.unit(), TAU * source.unit());
        let (a, b) = ((1.0 - share).sqrt(), share.sqrt());
        let (x, y, z, w) = (a * first.sin(), a * first.cos(), b * second.sin(), b * second.cos());
        words(DQuat::from_xyzw(x, y, z, w)).to_vec()
    }

    fn admits(&self, _: &[u32], companion: &[u32]) -> Option<bool> {
        let squares = companion.iter().map(|word| f64::from(f32::from_bits(*word)).powi(2));
        Some((squares.sum::<f64>() - 1.0).abs() < 1e-6)
    }

    fn shrink(&self, _: &[u32], companion: &[u32]) -> Vec<Vec<u32>> {
        simple()
            .take_while(|simple| simple.as_slice() != companion)
            .map(|words| words.to_vec())
            .collect()
    }
}

#[expect(clippy::cast_possible_truncation, reason = "a rotation is what its words say")]
fn words(q: DQuat) -> [u32; 4] {
    q.to_array().map(|component| (component as f32).to_bits())
}

/// Describes a rotation, such as `90 degrees about (0, 0, 1)`.
fn shown(q: DQuat) -> String {
    let (axis, angle) = q.to_axis_angle();
    let [x, y, z] = axis.to_array().map(significant);
    format!("{} degrees about ({x}, {y}, {z})", significant(angle.to_degrees()))
}

/// Reads the rotation from a companion, and normalises it in `f64`.
fn rotation(companion: &[u32]) -> DQuat {
    DQuat::from_array(std::array::from_fn(|i| f64::from(f32::from_bits(companion[i])))).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_keep_lengths_and_angles_and_move_the_axes_everywhere() {
        let mut mean = DVec3::ZERO;
        for case in 0..4000 {
            let q = rotation(&Rotations.draw(&[], &mut Source::new(3, case)));
            assert!((q.length() - 1.0).abs() < 1e-12);
            assert!((q * DVec3::X).dot(q * DVec3::Y).abs() < 1e-12);
            mean += q * DVec3::Z / 4000.0;
        }
        // For 3500 uniform directions, each component of the mean differs from 0 by about 0.01. One of eight
        // rotations is a quarter turn. Quarter turns rotate Z to (1/3, -1/3, 1/3) on average.
        let expected = DVec3::new(1.0, -1.0, 1.0) / 24.0;
        assert!(mean.distance(expected) < 0.06, "{mean}");
    }
}
