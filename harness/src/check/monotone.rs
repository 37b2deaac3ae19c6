//! The verb `is_monotone_in`: checks that results only rise, or only fall, as one argument grows.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};

use super::companion::{Companion, WithCompanion};
use super::demand::Demand;
use super::parameter::{Parameter, ScalarParameter};
use super::plan::Plan;
use super::property::{Exhibit, PRIMED};
use super::session::Asserted;
use super::{Agreement, Calls, Check, Failure, Vacuous};
use crate::domain::{Origin, Source, Stream, complexity};
use crate::judge::{Class, Judged, classify};
use crate::probe::Probed;
use crate::run::or_panic;
use crate::tolerance::{LaneError, Tolerance};
use crate::value::{Scalar, format_lane};

/// The direction in which results change as an argument grows. Equal results satisfy both trends.
///
/// ```
/// use karat::prelude::*;
///
/// let package = Package::from_source("m", "fn f(x: f32) -> f32 { return 1.0 - x; }");
/// package.function("f").over(0.0..=1.0).is_monotone_in("x", Trend::Decreasing, Ulp(0.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trend {
    /// Results never fall.
    Increasing,
    /// Results never rise.
    Decreasing,
}

impl fmt::Display for Trend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Increasing => "increasing",
            Self::Decreasing => "decreasing",
        })
    }
}

/// For each case, Karat samples 1, 2, 8 or 32 candidates for the second value of the argument, and uses the candidate
/// nearest to the case's own value. The difference between the two values is the step. A single candidate may lie at
/// the other end of the range. The nearest of 32 candidates is about 1/64 of the range away. A wide step shows a wrong
/// slope, and a short step shows a bump. In three of four cases, Karat shortens the step by a random factor, down to
/// 1/4096. A rising function with a small jump down still rises over a wide step, but falls over a short step at the
/// jump. Short steps usually find a jump of 1/1000 of the results' range.
const DRAWS: [u32; 4] = [1, 2, 8, 32];

/// The largest number of attempts to sample a second value that differs from the case's own value. If the domain is a
/// list of two values, about half of the attempts give the case's own value again.
const PATIENCE: u32 = 64;

const NAME: &str = "is_monotone_in";

impl<V> Check<'_, Calls<V>> {
    /// Checks that each component of the result only rises, or only falls, as one argument grows. The other
    /// arguments stay the same.
    ///
    /// Karat calls the function twice for each case: with the sampled arguments, and with a second value of the
    /// argument that the check varies. Karat samples the second value separately, near the first value or far from it.
    /// So the domain must let this argument vary independently of the other arguments. A result may change in the wrong
    /// direction by up to the tolerance, because of rounding.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS
    ///     .function("fresnel::schlick")
    ///     .over((UnitRgb, 0.0..=1.0))
    ///     .is_monotone_in("v_dot_h", Trend::Decreasing, Ulp(4.0));
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if a result changes in the wrong direction by more than the tolerance, if no
    /// result changes by more than the tolerance, or if nothing could be compared.
    #[track_caller]
    pub fn is_monotone_in(
        self,
        argument: impl Into<Parameter>,
        trend: Trend,
        tolerance: impl Into<Tolerance>,
    ) -> Agreement {
        or_panic(self.try_is_monotone_in(argument, trend, tolerance))
    }

    /// Runs [`is_monotone_in`](Self::is_monotone_in), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if a result changes in the wrong direction by more than the tolerance, if no result changes
    /// by more than the tolerance, or if nothing could be compared.
    pub fn try_is_monotone_in(
        self,
        argument: impl Into<Parameter>,
        trend: Trend,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let (stream, demand) = (&*self.stream, &self.demand());
        self.plan.is_monotone(stream, demand, (&argument.into(), trend), tolerance.into())
    }
}

impl Plan<'_> {
    pub(super) fn is_monotone(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
        (argument, trend): (&Parameter, Trend),
        tolerance: Tolerance,
    ) -> Result<Agreement, Failure> {
        let tolerances = self.tolerances(tolerance);
        let text = format!("{trend} in {argument}, {}", tolerances.general);
        let asserted = Asserted::new(NAME, text);
        let probed = Probed::in_valid(self.probe.package, &self.probe.name, &self.probe.overrides);
        let varied = probed.ok().and_then(|probed| argument.scalar(&probed.function).ok());
        let Some(varied) = varied else {
            // The session finds the same error again, and records it.
            return self.conclude(&asserted, stream, demand, &mut |session| {
                argument.scalar(session.called.function())?;
                session.called.vacuous(Vacuous::NoCases)
            });
        };
        let companion = &Other { domain: stream, argument: varied.clone() };
        let stream = WithCompanion { arguments: stream, companion };
        self.conclude(&asserted, &stream, demand, &mut |session| {
            tolerances.expect_usable(&session.called)?;
            let called = &session.called;
            let (scalars, tolerance) = (called.scalars(), tolerances.of(called));
            let (mut pairs, changed) = (0, AtomicBool::new(false));
            let tally = session.run(&mut |batch, running| {
                let plain = batch.lanes();
                let mut lanes = plain.to_vec();
                for (case, lanes) in lanes.chunks_exact_mut(called.words).enumerate() {
                    let other = batch.companion(case)[0];
                    let own = std::mem::replace(&mut lanes[varied.lane], other);
                    pairs += usize::from(own != other);
                }
                let before = running.read()?;
                let after = session.results(batch, &lanes)?;
                let judge = |case: usize| {
                    let (before, after) = (before.of(case), after.of(case));
                    let lane = case * called.words + varied.lane;
                    let grows =
                        varied.scalar.decode(plain[lane]) < varied.scalar.decode(lanes[lane]);
                    let rises = grows == (trend == Trend::Increasing);
                    // The result has changed if the change would be an error for the opposite trend.
                    let other = || judge_pair(&scalars, before, after, !rises, tolerance);
                    if !changed.load(Ordering::Relaxed) && !other().measure.passes() {
                        changed.store(true, Ordering::Relaxed);
                    }
                    judge_pair(&scalars, before, after, rises, tolerance)
                };
                let exhibit = |case: usize| Exhibit {
                    lanes: batch.arguments(case).to_vec(),
                    varied: vec![(
                        format!("{}'", varied.name),
                        format_lane(varied.scalar, batch.companion(case)[0]),
                    )],
                    compared: PRIMED,
                    actual: after.of(case).to_vec(),
                    expected: called.decode(before.of(case)),
                    judged: judge(case),
                };
                Ok(session.judge_results(batch, &after, judge, exhibit))
            })?;
            let tally =
                session.expect_tested(pairs > 0, tally, Vacuous::OneValue(argument.clone()))?;
            let otherwise = Vacuous::Constant(argument.clone());
            session.expect_tested(changed.into_inner(), tally, otherwise)
        })
    }
}

/// Samples a second value of the argument for each case.
struct Other<'a> {
    domain: &'a dyn Stream,
    argument: ScalarParameter,
}

impl Other<'_> {
    fn replaced(&self, arguments: &[u32], other: u32) -> Vec<u32> {
        let mut lanes = arguments.to_vec();
        lanes[self.argument.lane] = other;
        lanes
    }
}

impl Companion for Other<'_> {
    fn words(&self) -> usize {
        1
    }

    /// Samples some values, and returns the value that is nearest to the case's own value. Returns the case's
    /// own value if all samples equal it.
    fn draw(&self, arguments: &[u32], source: &mut Source) -> Vec<u32> {
        let own = arguments[self.argument.lane];
        let draws = DRAWS[usize::try_from(source.below(4)).unwrap_or_default()];
        let value = |word: u32| self.argument.scalar.decode(word);
        let distance = |word: u32| (value(word) - value(own)).abs();
        let (mut nearest, mut drawn): (Option<u32>, Vec<u32>) = (None, Vec::new());
        for draw in 0..PATIENCE {
            if draw >= draws && nearest.is_some() {
                break;
            }
            drawn.clear();
            if !self.domain.row(Origin::Draw(&mut *source), &mut drawn) {
                break;
            }
            let word = drawn[self.argument.lane];
            let nearer = nearest.is_none_or(|nearest| distance(word) < distance(nearest));
            if distance(word) > 0.0 && nearer {
                nearest = Some(word);
            }
        }
        let Some(nearest) = nearest else { return vec![own] };
        let fraction = (-12.0 * source.unit()).exp2();
        let nearer = [self.argument.between(own, nearest, fraction)];
        let inside = || self.admits(arguments, &nearer) == Some(true);
        let nearer =
            if source.below(4) > 0 && nearer != [own] && inside() { nearer } else { [nearest] };
        nearer.to_vec()
    }

    fn admits(&self, arguments: &[u32], companion: &[u32]) -> Option<bool> {
        self.domain.admits(&self.replaced(arguments, companion[0]))
    }

    /// Returns simpler second values than `companion`: edges of the domain, and the domain's simplifications of
    /// `companion`.
    fn shrink(&self, arguments: &[u32], companion: &[u32]) -> Vec<Vec<u32>> {
        let other = companion[0];
        let weight = |word: u32| match self.argument.scalar {
            Scalar::F32 => complexity(&f32::from_bits(word)),
            Scalar::I32 => complexity(&word.cast_signed()),
            _ => complexity(&word),
        };
        let mut simpler = self.domain.shrink(&self.replaced(arguments, other));
        simpler.extend((0..self.domain.edges()).filter_map(|edge| {
            let mut row = Vec::new();
            self.domain.row(Origin::Edge(edge), &mut row).then_some(row)
        }));
        let mut found: Vec<u32> = simpler.iter().map(|row| row[self.argument.lane]).collect();
        found.retain(|word| weight(*word) < weight(other));
        found.sort_by_key(|word| weight(*word));
        found.dedup();
        found.into_iter().map(|word| vec![word]).collect()
    }
}

/// Judges the function's results before and after a step of the argument. A change in the right direction has no error.
fn judge_pair(
    scalars: &[Scalar],
    before: &[u32],
    after: &[u32],
    rises: bool,
    tolerance: &Tolerance,
) -> Judged {
    let mut worst = Judged { measure: LaneError::ZERO, lane: 0, class: Class::Other };
    for (lane, scalar) in scalars.iter().enumerate() {
        let (old, new) = (scalar.decode(before[lane]), scalar.decode(after[lane]));
        let ordered = if rises { old <= new } else { new <= old };
        let measure = if ordered && old.is_finite() && new.is_finite() {
            LaneError::ZERO
        } else if scalar.is_float() {
            tolerance.measure_sum(lane, new, old)
        } else {
            LaneError::equality(false)
        };
        if measure.ratio > worst.measure.ratio {
            worst = Judged { measure, lane, class: classify(new, old) };
        }
    }
    worst
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Typed;
    use crate::tolerance::Abs;

    // Lesson 5
    #[test]
    fn only_the_wrong_way_is_an_error() {
        let judged = |before: f32, after: f32, rises| {
            let (before, after) = ([before.to_bits()], [after.to_bits()]);
            judge_pair(&[Scalar::F32], &before, &after, rises, &Abs(0.25).into())
        };
        assert!(
            judged(1.0, 5.0, true).measure.passes() && judged(5.0, 1.0, false).measure.passes()
        );
        assert!(
            judged(1.0, 0.75, true).measure.passes() && !judged(1.0, 0.7, true).measure.passes()
        );
        assert!(!judged(1.0, 1.3, false).measure.passes());
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            for rises in [true, false] {
                assert!(!judged(bad, 1.0, rises).measure.passes(), "{bad}");
                assert!(!judged(1.0, bad, rises).measure.passes(), "{bad}");
                assert!(!judged(bad, bad, rises).measure.passes(), "{bad}");
            }
        }
    }

    #[test]
    fn integers_have_no_tolerance() {
        let judged = |before, after| {
            judge_pair(&[Scalar::U32], &[before], &[after], true, &Abs(10.0).into())
        };
        assert!(judged(3, 3).measure.passes() && !judged(3, 2).measure.passes());
    }

    #[test]
    fn fractions_of_a_distance_reach_the_next_number() {
        let argument = |scalar| ScalarParameter { name: "a".to_owned(), scalar, lane: 0 };
        let float = |own: f32, other: f32, fraction| {
            let word = argument(Scalar::F32).between(own.to_bits(), other.to_bits(), fraction);
            f32::from_bits(word)
        };
        assert_eq!((float(1.0, 3.0, 0.25), float(3.0, -1.0, 0.5)), (1.5, 1.0));
        assert_eq!(
            (float(1.0, 3.0, 1e-9), float(1.0, 0.0, 1e-9)),
            (1.0_f32.next_up(), 1.0_f32.next_down())
        );
        let whole = |scalar, own: i32, other: i32, fraction| {
            let word =
                argument(scalar).between(own.cast_unsigned(), other.cast_unsigned(), fraction);
            word.cast_signed()
        };
        assert_eq!((whole(Scalar::I32, -8, 8, 0.25), whole(Scalar::U32, 8, 0, 1e-9)), (-4, 7));
    }

    #[test]
    fn the_second_value_of_a_monotone_check_lies_in_the_domain() {
        let row = |a: f32, b: f32| [a.to_bits(), b.to_bits()];
        let domain = (0.25..=0.75_f32, 2.0..=3.0_f32);
        let argument = ScalarParameter { name: "b".to_owned(), scalar: Scalar::F32, lane: 1 };
        let other = Other { domain: &Typed::arguments(&domain), argument };
        let mut near = 0;
        for case in 0..1000 {
            let word = other.draw(&row(0.5, 2.5), &mut Source::new(7, case));
            let value = f32::from_bits(word[0]);
            assert!((2.0..=3.0).contains(&value) && value != 2.5);
            assert_eq!(other.admits(&row(0.5, 2.5), &word), Some(true));
            near += usize::from((value - 2.5).abs() < 0.05);
        }
        assert!((100..900).contains(&near), "{near} of 1000 are near");
        assert_eq!(other.admits(&row(0.5, 2.5), &[4.0_f32.to_bits()]), Some(false));
        let simpler = other.shrink(&row(0.5, 2.5), &[2.734_f32.to_bits()]);
        assert_eq!(simpler.first(), Some(&vec![2.0_f32.to_bits()]));
        let one = (crate::domain::Just(1.0_f32), 0.0..=1.0_f32);
        let argument = ScalarParameter { name: "a".to_owned(), scalar: Scalar::F32, lane: 0 };
        let other = Other { domain: &Typed::arguments(&one), argument };
        assert_eq!(other.draw(&row(1.0, 0.5), &mut Source::new(7, 0)), [1.0_f32.to_bits()]);
    }
}
