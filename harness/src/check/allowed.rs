//! Judges results by the bounds that WGSL allows, or by the adapter's measured accuracy.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::interpret::Bound;
use crate::judge::{Class, Judged};
use crate::tolerance::{LaneError, SpecTolerance, Unit};
use crate::value::Scalar;

/// The bounds that WGSL sets for each result of a batch, and the tolerance that the test's author sets.
#[derive(Clone, Copy)]
pub(super) struct Allowed<'g> {
    pub(super) spec_tolerance: &'g SpecTolerance,
    /// The bounds of each component of the results, one case after the other.
    pub(super) bounds: &'g [Bound],
    /// `true` after the bounds decided that a case passes. If the bounds of a case are too wide, the tolerance in
    /// `spec_tolerance.otherwise` decides instead.
    pub(super) judged: &'g AtomicBool,
}

impl Allowed<'_> {
    /// Judges each component of a case's result and returns the worst judgement.
    pub(super) fn judge(
        &self,
        scalars: &[Scalar],
        case: usize,
        actual: &[u32],
        expected: &[f64],
    ) -> Judged {
        let bounds = &self.bounds[case * scalars.len()..][..scalars.len()];
        let mut worst = Judged { measure: LaneError::ZERO, lane: 0, class: Class::Other };
        let mut by_bounds = true;
        for (lane, (scalar, bound)) in scalars.iter().zip(bounds).enumerate() {
            let (value, reference) = (scalar.decode(actual[lane]), expected[lane]);
            let mut found = self.lane((lane, *scalar), value, reference, bound);
            if let (Unit::Conditioning | Unit::Unbounded, Some(tolerance)) =
                (found.unit, &self.spec_tolerance.otherwise)
                && !found.passes()
            {
                by_bounds = false;
                found = match scalar.is_float() {
                    true => tolerance.measure_sum(lane, value, reference),
                    false => LaneError::equality(value == reference),
                };
            }
            if lane == 0 || found.ratio > worst.measure.ratio {
                worst = Judged { measure: found, lane, class: class(found.unit) };
            }
        }
        if by_bounds && worst.measure.passes() {
            self.judged.store(true, Ordering::Relaxed);
        }
        worst
    }

    fn lane(
        &self,
        (lane, scalar): (usize, Scalar),
        value: f64,
        reference: f64,
        bound: &Bound,
    ) -> LaneError {
        let need = self.spec_tolerance.need_of(scalar);
        let Some((least, most)) = bound.ends() else {
            let (ratio, error) = (f64::INFINITY, f64::INFINITY);
            return LaneError { ratio, error, bound: 0.0, unit: Unit::Unbounded };
        };
        // A bound on the reference's own rounding error in f64.
        let noise = 8.0 * f64::EPSILON * reference.abs();
        let outside = |x: f64, noise: f64| (least - x).max(x - most) - noise;
        let size = (most - least).max(f64::from(f32::EPSILON) * least.abs().max(most.abs()));
        let wrong = |distance: f64, unit: Unit| LaneError {
            // 1 plus the distance from the allowed interval, in widths of that interval.
            ratio: 1.0 + distance / size.max(f64::from(f32::MIN_POSITIVE)),
            error: distance,
            bound: 0.0,
            unit,
        };
        // The negated comparison rejects NaN, which lies in no interval.
        if !(outside(reference, noise) <= 0.0) {
            return wrong(outside(reference, noise), Unit::Shader);
        }
        if !bound.allows(value) {
            let distance = outside(value, 0.0);
            let distance = if distance.is_finite() { distance } else { f64::INFINITY };
            let unit = if self.spec_tolerance.measured { Unit::Measured } else { Unit::Driver };
            return wrong(distance, unit);
        }
        if least == most {
            return LaneError::ZERO;
        }
        let needed = [least, most].map(|end| need.measure_sum(lane, end, reference));
        let widest = needed.into_iter().max_by(|a, b| a.ratio.total_cmp(&b.ratio));
        let widest = widest.unwrap_or(LaneError::ZERO);
        if !widest.passes() {
            return LaneError { unit: Unit::Conditioning, ..widest };
        }
        let own = need.measure_sum(lane, value, reference);
        LaneError { ratio: widest.ratio, ..own }
    }
}

fn class(unit: Unit) -> Class {
    match unit {
        Unit::Shader => Class::Shader,
        Unit::Driver | Unit::Measured => Class::Driver,
        Unit::Conditioning => Class::Conditioning,
        Unit::Unbounded => Class::Unbounded,
        _ => Class::Other,
    }
}
