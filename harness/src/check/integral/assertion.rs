//! The assertions about integrals: `agrees_with` and `is_at_most`.

use super::sum::Sum;
use crate::check::called::Called;
use crate::check::disagreement::Expectation;
use crate::check::session::Session;
use crate::check::tolerances::{self, Tolerances};
use crate::check::{Failure, Mismatch};
use crate::judge::{Class, Judged, classify};
use crate::path::Selected;
use crate::tolerance::{LaneError, Tolerance};
use crate::value::{Scalar, Shape};

pub(in crate::check) enum Assertion {
    AgreesWith(Tolerances),
    /// Asserts that the integral is at most a bound plus this slack.
    IsAtMost(f64),
}

/// An assertion about integrals, with the tolerance for one path.
#[derive(Clone, Copy, Debug)]
pub(super) enum Bound<'t> {
    AgreesWith(&'t Tolerance),
    IsAtMost(f64),
}

impl Assertion {
    pub(super) fn name(&self) -> &'static str {
        match self {
            Self::AgreesWith(_) => "integral.agrees_with",
            Self::IsAtMost(_) => "integral.is_at_most",
        }
    }

    /// The relation between the integral and the number that the caller supplies.
    pub(super) fn expectation(&self) -> Expectation {
        match self {
            Self::AgreesWith(_) => Expectation::Equal,
            Self::IsAtMost(_) => Expectation::AtMost,
        }
    }

    /// The noun that error messages use if the expected number isn't finite: `integral` or `bound`.
    pub(super) fn what(&self) -> &'static str {
        match self {
            Self::AgreesWith(_) => "integral",
            Self::IsAtMost(_) => "bound",
        }
    }

    /// The end of the phrase `1.5 is expected` or `1.5 is the bound`, in a message about a doubtful integral.
    pub(super) fn stated(&self) -> &'static str {
        match self {
            Self::AgreesWith(_) => "expected",
            Self::IsAtMost(_) => "the bound",
        }
    }

    pub(super) fn expect_result(
        &self,
        session: &Session<'_>,
        host: &Shape,
        tolerance_on: &Selected<Tolerance>,
    ) -> Result<(), Failure> {
        let called = &session.called;
        let function = called.function();
        if !called.scalars().into_iter().all(Scalar::is_float) {
            let (result, wanted) = (function.result.clone(), "but an integral is a sum of floats");
            return Err(Mismatch::Unsuited { result, wanted }.of(function));
        }
        match self {
            Self::AgreesWith(tolerances) => {
                called.expect_result(host, "the expected integral is")?;
                tolerances.expect_usable(&session.called)
            }
            Self::IsAtMost(slack) => {
                tolerances::expect_none(tolerance_on, session.asserted.check, &session.called)?;
                if *host != Shape::Scalar(Scalar::F32) {
                    called.expect_result(host, "the bound is")?;
                }
                called.expect_lanes(&Tolerance::Abs(*slack))
            }
        }
    }

    pub(super) fn on(&self, called: &Called<'_>) -> Bound<'_> {
        match self {
            Self::AgreesWith(tolerances) => Bound::AgreesWith(tolerances.of(called)),
            Self::IsAtMost(slack) => Bound::IsAtMost(*slack),
        }
    }
}

impl Bound<'_> {
    pub(super) fn measure(&self, lane: usize, value: f64, expected: f64) -> LaneError {
        // An integral of minus infinity must fail, although it is below every bound.
        let value = if value.is_finite() { value } else { f64::NAN };
        match self {
            Self::AgreesWith(tolerance) => tolerance.measure_sum(lane, value, expected),
            Self::IsAtMost(slack) => LaneError::excess(value, expected, *slack),
        }
    }

    /// The difference between the two rules' integrals, divided by the tolerance or the slack.
    pub(super) fn doubt(&self, lane: usize, value: f64, control: f64) -> LaneError {
        match self {
            Self::AgreesWith(tolerance) => tolerance.measure_sum(lane, control, value),
            Self::IsAtMost(slack) => Tolerance::Abs(*slack).measure_sum(lane, control, value),
        }
    }

    /// Checks if the integrals of both rules clearly fail. Moves each integral towards `expected` by the difference
    /// between the two integrals. Returns `true` if both integrals stay on the same side of `expected` and still fail.
    pub(super) fn refuses_both(&self, lane: usize, sums: [f64; 2], expected: f64) -> bool {
        let doubt = (sums[0] - sums[1]).abs();
        let above = sums[0] > expected;
        sums.into_iter().all(|value| {
            let nearest = if above { value - doubt } else { value + doubt };
            let same_side = if above { nearest > expected } else { nearest < expected };
            same_side && !self.measure(lane, nearest, expected).passes()
        })
    }

    /// Judges an integral. The worst component decides.
    pub(super) fn judge(&self, sum: &Sum, expected: &[f64]) -> Judged {
        if let Some(bad) = &sum.bad {
            let Judged { lane, class, .. } = bad.judged;
            let measure = self.measure(lane, f64::NAN, expected[lane]);
            return Judged { measure, lane, class };
        }
        let mut worst = Judged { measure: LaneError::ZERO, lane: 0, class: Class::Other };
        for (lane, (value, expected)) in sum.totals().into_iter().zip(expected).enumerate() {
            let measure = self.measure(lane, value, *expected);
            if lane == 0 || measure.ratio > worst.measure.ratio {
                let class = match self {
                    Self::IsAtMost(_) if value.is_finite() => Class::TooHigh,
                    _ => classify(value, *expected),
                };
                worst = Judged { measure, lane, class };
            }
        }
        worst
    }
}

impl std::fmt::Display for Assertion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::AgreesWith(tolerances) => write!(f, "{}", tolerances.general),
            Self::IsAtMost(0.0) => f.write_str("each integral is at most its bound"),
            Self::IsAtMost(slack) => {
                write!(
                    f,
                    "each integral is at most its bound, plus the slack {}",
                    Tolerance::Abs(*slack)
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tolerance::{Abs, Rel};

    fn sum(terms: &[(f64, f32)]) -> Sum {
        Sum::of_scalars(terms)
    }

    #[test]
    fn no_sum_with_nan_or_infinity_passes() {
        let loosest = Tolerance::from(Abs(1e300)).or(Rel(1e300));
        for assertion in [Bound::AgreesWith(&loosest), Bound::IsAtMost(f64::MAX)] {
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                for weight in [0.0, 1.0, -1.0] {
                    let sum = sum(&[(1.0, 1.0), (weight, bad), (1.0, 1.0)]);
                    let judged = assertion.judge(&sum, &[1.0]);
                    assert!(!judged.measure.passes(), "{weight} * {bad}");
                    let nan = judged.class == Class::Nan;
                    assert!(nan == bad.is_nan() && (nan || judged.class == Class::Infinite));
                }
            }
            for weight in [f64::MAX, -f64::MAX] {
                let overflow = sum(&[(weight, 2.0)]);
                assert!(!assertion.judge(&overflow, &[1.0]).measure.passes());
            }
        }
    }

    /// If both rules give integrals that are clearly wrong, the check fails.
    // Lesson 67
    #[test]
    fn a_bound_fails_if_both_rules_refuse_it() {
        let tolerance = Abs(0.1).into();
        let equal = Bound::AgreesWith(&tolerance);
        let refuses = |assertion: &Bound<'_>, sums| {
            let there = assertion.refuses_both(0, sums, 1.0);
            let back = assertion.refuses_both(0, [sums[1], sums[0]], 1.0);
            assert_eq!(there, back, "{sums:?}");
            there
        };
        for sums in [[630.0, 480.0], [1.5, 1.35], [0.5, 0.6], [-40.0, -30.0]] {
            assert!(refuses(&equal, sums), "{sums:?}");
        }
        // In each pair, either the integrals lie on both sides of the expected value, or one of them passes if
        // it moves closer by the difference.
        for sums in [[1.05, 0.9], [1.3, 1.05], [0.7, 1.3], [1.4, 1.21], [0.6, 0.78], [-8.0, 9.0]] {
            assert!(!refuses(&equal, sums), "{sums:?}");
        }
        assert!(!refuses(&equal, [f64::NAN, 5.0]));
        let bound = Bound::IsAtMost(0.1);
        assert!(refuses(&bound, [630.0, 480.0]) && !refuses(&bound, [1.4, 1.2]));
        assert!(!refuses(&bound, [-630.0, -480.0]), "below the bound");
    }

    #[test]
    fn a_bound_is_closed_and_the_slack_absolute() {
        let passes = |slack, value: f64, bound| {
            let judged = Bound::IsAtMost(slack).judge(&sum(&[(value, 1.0)]), &[bound]);
            assert!(judged.measure.passes() || judged.class == Class::TooHigh);
            judged.measure.passes()
        };
        assert!(passes(0.0, 1.0, 1.0) && passes(0.0, -5.0, 1.0) && passes(0.0, -2.0, -1.0));
        assert!(!passes(0.0, 1.0_f64.next_up(), 1.0) && !passes(0.0, 0.5, -1.0));
        assert!(passes(0.25, 1.25, 1.0) && !passes(0.25, 1.25_f64.next_up(), 1.0));
    }
}
