//! Runs a function on a column's path, and compares its results with another column's.

use karat::unstable::executor::Caller;
use karat::unstable::probe::ProbeError;
use karat_core::tolerance::{Tolerance, ulp_distance};
use karat_core::value::{Scalar, format_f32};

use super::leeway::{Freedom, Latitude, OfCase};
use super::{Cell, Status, Stop};
use crate::limits::CANCELLED;

pub(super) struct Ran<'p> {
    pub(super) column: usize,
    pub(super) caller: Caller<'p>,
    pub(super) results: Vec<u32>,
}

/// The reason why a function didn't run. The text has no function name, so that a report can show a reason once for
/// several functions.
pub(super) fn not_run(error: ProbeError) -> String {
    match error {
        ProbeError::Compile { error, .. } => error.to_string(),
        other => other.to_string(),
    }
}

/// Sets the first column's status to "agrees" if another column agrees with the first column.
pub(super) fn conclude(first: &mut Cell, agreeing: Option<Comparison>, others: usize) {
    first.stopped = match agreeing {
        Some(seen) => {
            first.status = Some(Status::Agrees);
            (first.compared, first.worst_ulp) = (seen.compared, seen.worst_ulp);
            return;
        }
        None if others == 0 => {
            Some(Stop::NothingToCompare("no other column ran the row".to_owned()))
        }
        None => Some(Stop::NothingToCompare("no other column agrees with this column".to_owned())),
    };
}

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Comparison {
    pub(super) compared: usize,
    /// The cases that differ although WGSL defines the result.
    pub(super) differing: Vec<usize>,
    /// The number of cases in which a lane differs, and WGSL allows both values.
    pub(super) open: usize,
    pub(super) worst_ulp: Option<u64>,
}

#[derive(Clone, Debug)]
pub(super) struct Judge<'j> {
    scalars: &'j [Scalar],
    within: &'j Tolerance,
    /// The scale of each component: the largest magnitude of the component's results, but at most 1; 1 if all results
    /// are 0. Results are divided by their scale before an absolute tolerance applies. Otherwise, all small results
    /// would count as equal.
    scales: Vec<f64>,
}

impl<'j> Judge<'j> {
    /// Makes the rules for a comparison. The first column's results determine the scales.
    pub(super) fn new(scalars: &'j [Scalar], within: &'j Tolerance, expected: &[u32]) -> Self {
        let mut scales = vec![0.0_f64; scalars.len()];
        for case in expected.chunks_exact(scalars.len()) {
            for (scale, (scalar, word)) in scales.iter_mut().zip(scalars.iter().zip(case)) {
                let size = scalar.decode(*word).abs();
                *scale = scale.max(if size.is_finite() { size.min(1.0) } else { 0.0 });
            }
        }
        // A component that is much smaller than others may be a remainder of terms that cancel.
        let least = CANCELLED * scales.iter().copied().fold(0.0, f64::max);
        let one = |scale: f64| if scale > 0.0 { scale.max(least) } else { 1.0 };
        Self { scalars, within, scales: scales.into_iter().map(one).collect() }
    }

    pub(super) fn compare(
        &self,
        expected: &[u32],
        actual: &[u32],
        latitude: Option<&Latitude>,
    ) -> Comparison {
        let width = self.scalars.len();
        let mut comparison = Comparison::default();
        let cases = expected.chunks_exact(width).zip(actual.chunks_exact(width));
        for (index, (expected, actual)) in cases.enumerate() {
            let seen = self.case(expected, actual, latitude.map(|all| all.case(index, width)));
            comparison.open += usize::from(seen.open);
            comparison.worst_ulp = comparison.worst_ulp.max(seen.worst_ulp);
            comparison.compared += usize::from(seen.compared);
            if seen.differs {
                comparison.differing.push(index);
            }
        }
        comparison
    }

    /// Compares the lanes of a case. If WGSL allows two results, both are right. If the allowed results are unknown and
    /// a float of the first result isn't finite, this function skips all floats of the case. Implementations may assume
    /// that infinities and NaN don't occur, so all values that depend on them are open.
    pub(super) fn case(
        &self,
        expected: &[u32],
        actual: &[u32],
        latitude: Option<OfCase<'_>>,
    ) -> Seen {
        let finite = self.scalars.iter().zip(expected).all(|(s, word)| s.decode(*word).is_finite());
        let mut seen = Seen::default();
        for (lane, scalar) in self.scalars.iter().enumerate() {
            let (wanted, found) = (expected[lane], actual[lane]);
            let freedom = latitude
                .map_or(Freedom::Unknown, |case| case.freedom(lane, *scalar, [wanted, found]));
            let agrees = self.agree(lane, wanted, found);
            // NaN and infinity agree with no value. If WGSL allows any value, they prove nothing.
            let is_number = scalar.decode(wanted).is_finite();
            match freedom {
                Freedom::Any if !(agrees && is_number) => {
                    seen.open |= wanted != found;
                    continue;
                }
                Freedom::Both if !agrees => {
                    (seen.open, seen.compared) = (true, true);
                    continue;
                }
                Freedom::Unknown if scalar.is_float() && !finite => continue,
                _ => {}
            }
            seen.compared = true;
            if is_number {
                seen.worst_ulp = seen.worst_ulp.max(distance((scalar, (&wanted, &found))));
            }
            seen.differs |= !agrees;
        }
        seen
    }

    /// Checks if two results of a lane are equal within the tolerance.
    fn agree(&self, lane: usize, expected: u32, actual: u32) -> bool {
        let (scalar, scale) = (self.scalars[lane], self.scales[lane]);
        if expected == actual || !scalar.is_float() {
            return expected == actual;
        }
        // Both results are divided by `scale`, so that an absolute tolerance is relative to the largest result.
        let (found, wanted) = (scalar.decode(actual) / scale, scalar.decode(expected) / scale);
        self.within.measure_sum(0, found, wanted).passes()
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Seen {
    pub(super) compared: bool,
    /// `true` if a lane differs, unless WGSL allows both results.
    pub(super) differs: bool,
    /// `true` if a lane differs, and WGSL allows both results.
    pub(super) open: bool,
    worst_ulp: Option<u64>,
}

/// Replaces a subnormal number by 0, because drivers may flush it.
pub(super) fn flushed(word: u32) -> u32 {
    let is_subnormal = f32::from_bits(word).abs() < f32::MIN_POSITIVE;
    if is_subnormal { 0 } else { word }
}

/// The distance between two components in steps of an `f32`. Subnormal numbers count as 0.
fn distance((scalar, (expected, actual)): (&Scalar, (&u32, &u32))) -> Option<u64> {
    if !scalar.is_float() {
        return None;
    }
    let value = |word: &u32| f32::from_bits(flushed(*word));
    ulp_distance(value(expected), value(actual))
}

pub(super) fn shown(scalars: &[Scalar], words: &[u32]) -> String {
    let one = |(scalar, word): (&Scalar, &u32)| match scalar {
        Scalar::F32 | Scalar::F16 => format_f32(f32::from_bits(*word)),
        Scalar::Bool => (*word != 0).to_string(),
        Scalar::I32 | Scalar::U32 => scalar.decode(*word).to_string(),
    };
    scalars.iter().zip(words).map(one).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use karat_core::tolerance::{Abs, Rel};

    // Lesson 82
    #[test]
    fn one_changed_bit_of_65536_results_is_found() {
        let scalars = [Scalar::F32, Scalar::U32];
        let within = Rel(1e-3).or(Abs(1e-3));
        let expected: Vec<u32> = (0..65_536_u32).flat_map(|i| [(i as f32).to_bits(), i]).collect();
        let judge = Judge::new(&scalars, &within, &expected);
        let same = judge.compare(&expected, &expected, None);
        assert_eq!((same.compared, same.differing.len(), same.worst_ulp), (65_536, 0, Some(0)));
        for bit in [30, 22, 15] {
            let mut actual = expected.clone();
            actual[2 * 40_000] ^= 1 << bit;
            assert_eq!(judge.compare(&expected, &actual, None).differing, [40_000], "{bit}");
        }
        let mut actual = expected.clone();
        actual[2 * 7 + 1] ^= 1;
        assert_eq!(judge.compare(&expected, &actual, None).differing, [7], "an integer differs");
    }

    #[test]
    fn nan_and_infinity_are_left_out_and_never_agree() {
        let (scalars, within) = ([Scalar::F32, Scalar::I32], Tolerance::from(Abs(1.0)));
        let words = |values: [f32; 3], number: u32| values.map(|v| [v.to_bits(), number]).concat();
        let expected = words([f32::NAN, 1.0, f32::INFINITY], 7);
        let judge = Judge::new(&scalars, &within, &expected);
        assert!(judge.compare(&expected, &expected, None).differing.is_empty());
        let seen = judge.compare(&expected, &words([1.0, f32::NAN, 1.0], 7), None);
        assert_eq!((seen.compared, &*seen.differing), (3, &[1][..]));
        // Karat still compares the other component.
        let other = words([1.0, 1.0, 1.0], 8);
        assert_eq!(judge.compare(&expected, &other, None).differing, [0, 1, 2]);
        let alone = Judge::new(&scalars[..1], &within, &expected);
        assert_eq!(alone.compare(&[f32::NAN.to_bits()], &[0], None).compared, 0);
    }

    #[test]
    fn small_results_are_compared_by_their_size() {
        let (scalars, within) = ([Scalar::F32], Rel(1e-3).or(Abs(1e-3)));
        let words = |values: [f32; 3]| values.map(f32::to_bits);
        let expected = words([0.0, 1e-5, -1e-5]);
        let judge = Judge::new(&scalars, &within, &expected);
        assert_eq!(judge.compare(&expected, &words([0.0, -1e-5, -1e-5]), None).differing, [1]);
        assert!(judge.compare(&expected, &words([1e-9, 1e-5, -1e-5]), None).differing.is_empty());
    }
}
