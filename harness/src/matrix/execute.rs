//! Running a function on a column's path, and comparing it with another one's results.

use crate::executor::Executor;
use crate::fixture::Fixtures;
use crate::path::{self, Device, Path};
use crate::probe::{Call, Prepared, ProbeError, Probed};
use crate::tolerance::{Tolerance, ulp_distance};
use crate::value::{Scalar, format_f32};

/// A function that is ready on a path.
pub(super) struct Ready<'p> {
    prepared: Box<dyn Prepared + 'p>,
    path: Path,
    words_in: usize,
    words_out: usize,
}

impl<'p> Ready<'p> {
    pub(super) fn new(
        path: Path,
        probed: &'p Probed,
        fixtures: &'p Fixtures,
        cases: usize,
    ) -> Result<Self, ProbeError> {
        let device: &'static Device = path::open(path)?;
        let call = Call { probed, fixtures, cases };
        let prepared = device.prepare(&call)?;
        let function = probed.function();
        let words_in = function.parameters.iter().map(|(_, shape)| shape.lanes().len()).sum();
        Ok(Self { prepared, path, words_in, words_out: function.result.lanes().len() })
    }

    /// The results of some cases, one after the other.
    pub(super) fn results(&self, rows: &[u32], cases: usize) -> Result<Vec<u32>, ProbeError> {
        let mut results = Vec::with_capacity(cases * self.words_out);
        let most = self.prepared.capacity();
        for first in (0..cases).step_by(most) {
            let count = most.min(cases - first);
            let part = &rows[first * self.words_in..][..count * self.words_in];
            let started = self.prepared.start(count, part)?;
            started(&mut |words, stride| {
                for case in words.chunks_exact(stride) {
                    results.extend_from_slice(&case[..self.words_out]);
                }
            })?;
        }
        let (expected, found) = (cases * self.words_out, results.len());
        if found != expected {
            return Err(ProbeError::Length { path: self.path, expected, found });
        }
        Ok(results)
    }
}

/// How the results of two columns compare.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Comparison {
    pub(super) compared: usize,
    /// The cases that differ.
    pub(super) differing: Vec<usize>,
    pub(super) worst_ulp: Option<u64>,
}

/// Compares results case by case. A case whose first result has a component that isn't finite is
/// left out: WGSL lets implementations assume that there is none.
pub(super) fn compare(
    scalars: &[Scalar],
    expected: &[u32],
    actual: &[u32],
    within: &Tolerance,
) -> Comparison {
    let mut comparison = Comparison::default();
    let cases = expected.chunks_exact(scalars.len()).zip(actual.chunks_exact(scalars.len()));
    for (index, (expected, actual)) in cases.enumerate() {
        let finite = scalars.iter().zip(expected).all(|(s, word)| s.decode(*word).is_finite());
        if !finite {
            continue;
        }
        comparison.compared += 1;
        let ulp = scalars.iter().zip(expected.iter().zip(actual)).filter_map(distance).max();
        comparison.worst_ulp = comparison.worst_ulp.max(ulp);
        if !agree(scalars, expected, actual, within) {
            comparison.differing.push(index);
        }
    }
    comparison
}

/// Whether one case agrees.
pub(super) fn agree(
    scalars: &[Scalar],
    expected: &[u32],
    actual: &[u32],
    within: &Tolerance,
) -> bool {
    scalars.iter().zip(expected.iter().zip(actual)).all(|(scalar, (expected, actual))| {
        if !scalar.is_float() {
            return expected == actual;
        }
        within.measure(0, f32::from_bits(*actual), scalar.decode(*expected)).passes()
    })
}

/// Steps of `f32` between two components; what may be flushed to 0 is 0.
fn distance((scalar, (expected, actual)): (&Scalar, (&u32, &u32))) -> Option<u64> {
    if !scalar.is_float() {
        return None;
    }
    let flushed = |word: u32| {
        let value = f32::from_bits(word);
        if value.abs() < f32::MIN_POSITIVE { 0.0 } else { value }
    };
    ulp_distance(flushed(*expected), flushed(*actual))
}

/// The words of a value as a person reads them.
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
    use crate::tolerance::{Abs, Rel};

    #[test]
    fn one_other_bit_in_many_words_is_seen() {
        let scalars = [Scalar::F32, Scalar::U32];
        let within = Rel(1e-3).or(Abs(1e-3));
        let expected: Vec<u32> = (0..65_536_u32).flat_map(|i| [(i as f32).to_bits(), i]).collect();
        let same = compare(&scalars, &expected, &expected, &within);
        assert_eq!((same.compared, same.differing.len(), same.worst_ulp), (65_536, 0, Some(0)));
        for bit in [30, 22, 15] {
            let mut actual = expected.clone();
            actual[2 * 40_000] ^= 1 << bit;
            assert_eq!(compare(&scalars, &expected, &actual, &within).differing, [40_000], "{bit}");
        }
        let mut actual = expected.clone();
        actual[2 * 7 + 1] ^= 1;
        assert_eq!(compare(&scalars, &expected, &actual, &within).differing, [7], "of an integer");
    }

    #[test]
    fn what_is_not_finite_is_left_out_and_never_agrees() {
        let (scalars, within) = ([Scalar::F32], Tolerance::from(Abs(1.0)));
        let words = |values: [f32; 3]| values.map(f32::to_bits);
        let expected = words([f32::NAN, 1.0, f32::INFINITY]);
        let seen = compare(&scalars, &expected, &expected, &within);
        assert_eq!((seen.compared, seen.differing.len()), (1, 0));
        let seen = compare(&scalars, &expected, &words([1.0, f32::NAN, 1.0]), &within);
        assert_eq!((seen.compared, &*seen.differing), (1, &[1][..]));
    }
}
