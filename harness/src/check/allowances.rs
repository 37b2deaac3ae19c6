//! Compares a test's tolerance with the errors that WGSL allows. The comparison shows if a valid driver could fail the
//! test.

use super::batch::Batch;
use crate::interpret::{Bound, Interpreted};
use crate::probe::ProbeError;
use crate::record::Allowance;
use crate::reflect::Program;
use crate::tolerance::Tolerance;
use crate::value::Scalar;

/// The number of cases for which Karat computes WGSL's bounds if the function has no loops. The computation
/// takes some milliseconds.
const ASKED: usize = 128;

/// The largest number of loop iterations for which Karat computes WGSL's bounds, summed over all cases. Interval
/// arithmetic is slow, and only the record needs its results.
const ROUNDS: u64 = 4096;

/// The number of cases for which Karat computes WGSL's bounds. The number is smaller if the function's loops
/// iterate often, and may be 0.
pub(super) fn wanted(program: &Program) -> usize {
    let rounds = program.most_rounds().unwrap_or(u64::MAX).max(1);
    usize::try_from(ROUNDS / rounds).unwrap_or(ASKED).min(ASKED)
}

/// The intervals of results that WGSL allows for some cases of a batch.
pub(super) struct Allowances {
    cases: Vec<usize>,
    /// The bounds of each component of the results, one case after the other.
    bounds: Vec<Bound>,
}

impl Allowances {
    /// Computes WGSL's bounds for some cases of a batch. Half of these cases are the batch's first cases, which contain
    /// the edges. The other half is spread over the batch. Chooses at most `left` cases, and subtracts their number
    /// from `left`.
    pub(super) fn of(
        witness: &Interpreted,
        batch: &Batch,
        left: &mut usize,
    ) -> Result<Self, ProbeError> {
        let wanted = (*left).min(batch.cases);
        let first = wanted.div_ceil(2);
        let step = (batch.cases - first).div_ceil((wanted - first).max(1)).max(1);
        let spread = (first..batch.cases).step_by(step).take(wanted - first);
        let cases: Vec<usize> = (0..first).chain(spread).collect();
        *left -= cases.len();
        let rows: Vec<u32> =
            cases.iter().flat_map(|case| batch.arguments(*case)).copied().collect();
        Ok(Self { bounds: witness.driver_bounds(cases.len(), &rows)?, cases })
    }

    /// Compares the allowed results with the tolerance around `expected`, the expected components of all cases.
    pub(super) fn against(
        &self,
        scalars: &[Scalar],
        expected: &[f64],
        tolerance: &Tolerance,
    ) -> Allowance {
        let cases = self.cases.len() as u64;
        let mut allowance = Allowance { cases, wider: 0, worst: Some(0.0), unbounded: 0 };
        for (case, bounds) in self.cases.iter().zip(self.bounds.chunks(scalars.len())) {
            let expected = &expected[case * scalars.len()..][..scalars.len()];
            let ratio = allowed(scalars, bounds, expected, tolerance);
            allowance.unbounded += u64::from(bounds.iter().any(|bound| bound.ends().is_none()));
            allowance.wider += u64::from(!(ratio <= 1.0));
            allowance.worst =
                allowance.worst.map(|worst| worst.max(ratio)).filter(|x| x.is_finite());
        }
        allowance
    }
}

/// The largest error that WGSL allows, divided by the tolerance.
fn allowed(scalars: &[Scalar], bounds: &[Bound], expected: &[f64], tolerance: &Tolerance) -> f64 {
    let lanes = scalars.iter().zip(bounds).zip(expected).enumerate();
    let ratio = |(lane, ((scalar, bound), expected)): (usize, ((&Scalar, &Bound), &f64))| {
        let Some((least, most)) = bound.ends() else { return f64::INFINITY };
        let of = |end: f64| tolerance.measure_sum(lane, end, *expected).ratio;
        match scalar.is_float() {
            true => of(least).max(of(most)),
            // WGSL allows a single value. This value may be wrong, but every driver returns it.
            false if least == most => 0.0,
            false => f64::INFINITY,
        }
    };
    lanes.map(ratio).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::package::Package;
    use crate::probe::Probed;
    use crate::tolerance::{Abs, Ulp};

    fn allowance(
        body: &str,
        reference: fn(f64) -> f64,
        tolerance: impl Into<Tolerance>,
    ) -> Allowance {
        let text = format!("fn f(x: f32) -> f32 {{ return {body}; }}");
        let package = Package::from_source("allowances", text.as_str());
        let probed = Probed::new(&package, "f").expect("it is valid");
        let fixtures = Vec::new();
        let witness = Interpreted::new(&probed, &fixtures).expect("the engine executes it");
        let x: Vec<f32> = (0..1000_u16).map(|case| f32::from(case) / 1000.0).collect();
        let expected: Vec<f64> = x.iter().map(|x| reference(f64::from(*x))).collect();
        let rows = x.iter().map(|x| x.to_bits()).collect();
        let batch = Batch::new(0, rows, 1000, 1, 1);
        let mut left = 100;
        let allowances = Allowances::of(&witness, &batch, &mut left).expect("it runs");
        assert_eq!((left, wanted(&probed.program)), (0, 128));
        allowances.against(&[Scalar::F32], &expected, &tolerance.into())
    }

    /// WGSL allows `sin` an error of 2^-11, so a test with a smaller tolerance may fail on some driver.
    // Lesson 93
    // Lesson 171
    #[test]
    fn tolerances_that_other_drivers_may_leave_are_found() {
        let loose = allowance("sin(x)", f64::sin, Abs(1e-3));
        assert_eq!((loose.cases, loose.wider), (100, 0));
        let worst = loose.worst.expect("WGSL bounds it");
        assert!((worst - 0.488).abs() < 0.01, "{worst}");
        let tight = allowance("sin(x)", f64::sin, Ulp(4.0));
        assert_eq!(tight.wider, 100);
        assert!(tight.worst.is_some_and(|worst| worst > 1000.0), "{tight:?}");
        // The first case is `x = 0`. WGSL sets no bounds for `pow` of 0.
        let unbounded = allowance("pow(x, 5.0)", |x| x.powi(5), Abs(1e-3));
        assert_eq!((unbounded.wider, unbounded.worst, unbounded.unbounded), (1, None, 1));
        // All drivers use the constant in the shader. Only the reference may use a different 0.3.
        let constant = allowance("0.3", |_| f64::from(0.3_f32), Ulp(0.0));
        assert_eq!((constant.wider, constant.worst), (0, Some(0.0)));
        let inexact = allowance("0.3 * x", |x| f64::from(0.3_f32) * x, Ulp(0.0));
        assert!(inexact.wider > 50 && inexact.unbounded == 0, "{inexact:?}");
    }
}
