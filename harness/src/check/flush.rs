//! The flushing of subnormal arguments to 0, which WGSL allows.
//!
//! Each operation may flush a subnormal operand to 0 or -0, independently of the other operations (WGSL, section
//! 15.7.2). So a result is right if it passes the check for the given arguments, or for arguments in which zeros
//! replace some of the subnormals. This module doesn't handle subnormal intermediate values.

use crate::judge::Judged;
use crate::value::Scalar;

/// The largest number of subnormal arguments for which Karat tries every combination of unchanged arguments, 0 and -0:
/// at most 3^4 rows. If a case has more subnormal arguments, Karat flushes all of them together, or none of them.
const APART: usize = 4;

/// The smallest normal `f16`, 2^-14.
const LEAST_F16: f32 = 1.0 / 16_384.0;

/// Returns `given`, the judgement of a case with unchanged arguments, if `given` is a pass. Otherwise judges the case
/// with flushed arguments. Returns `given` if no choice of flushed arguments makes the case pass.
pub(super) fn allowing_flushes(
    scalars: &[Scalar],
    arguments: &[u32],
    given: Judged,
    judge: impl Fn(&[u32]) -> Judged,
) -> Judged {
    if given.measure.passes() {
        return given;
    }
    let flushed = Flushed::of(scalars, arguments).map(|row| judge(&row));
    flushed.into_iter().find(|judged| judged.measure.passes()).unwrap_or(given)
}

fn is_subnormal(scalar: Scalar, word: u32) -> bool {
    let value = f32::from_bits(word);
    match scalar {
        Scalar::F32 => value.is_subnormal(),
        Scalar::F16 => value != 0.0 && value.abs() < LEAST_F16,
        Scalar::I32 | Scalar::U32 | Scalar::Bool => false,
    }
}

/// An iterator over the rows that flushing can make from a row of arguments. The iterator leaves out the row itself.
pub struct Flushed<'r> {
    row: &'r [u32],
    /// The indices of the subnormal arguments, in groups. Karat flushes the arguments of one group together.
    lanes: Vec<Vec<usize>>,
    /// The number of the next row. The number has one ternary digit for each group: 0 keeps the group's values, 1
    /// replaces them by 0, 2 by -0.
    next: usize,
}

impl<'r> Flushed<'r> {
    /// Makes the iterator for a row of arguments with these scalar types.
    pub fn of(scalars: &[Scalar], row: &'r [u32]) -> Self {
        let lanes = scalars.iter().zip(row).enumerate();
        let lanes = lanes.filter(|(_, (scalar, word))| is_subnormal(**scalar, **word));
        let lanes: Vec<usize> = lanes.map(|(lane, _)| lane).collect();
        let apart = lanes.len() <= APART;
        let lanes =
            if apart { lanes.into_iter().map(|lane| vec![lane]).collect() } else { vec![lanes] };
        Self { row, lanes, next: 1 }
    }
}

impl Iterator for Flushed<'_> {
    type Item = Vec<u32>;

    fn next(&mut self) -> Option<Vec<u32>> {
        let (mut digits, mut row) = (self.next, self.row.to_vec());
        for lane in &self.lanes {
            for lane in lane {
                match digits % 3 {
                    0 => {}
                    1 => row[*lane] = 0.0_f32.to_bits(),
                    _ => row[*lane] = (-0.0_f32).to_bits(),
                }
            }
            digits /= 3;
        }
        self.next += 1;
        (digits == 0).then_some(row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::judge::Class;
    use crate::tolerance::LaneError;

    fn rows(scalars: &[Scalar], values: &[f32]) -> Vec<Vec<f32>> {
        let words: Vec<u32> = values.iter().map(|value| value.to_bits()).collect();
        let rows = Flushed::of(scalars, &words);
        rows.map(|row| row.into_iter().map(f32::from_bits).collect()).collect()
    }

    const TINY: f32 = f32::from_bits(1);

    #[test]
    fn subnormals_alone_are_flushed_each_by_itself() {
        let f32s = [Scalar::F32; 3];
        assert!(rows(&f32s, &[0.0, f32::MIN_POSITIVE, -1.0]).is_empty());
        assert!(rows(&[Scalar::U32, Scalar::I32], &[TINY, TINY]).is_empty(), "words, no floats");
        let found = rows(&f32s, &[1.0, -TINY, 2.0]);
        assert_eq!(found, [[1.0, 0.0, 2.0], [1.0, -0.0, 2.0]]);
        assert!(!found[0][1].is_sign_negative() && found[1][1].is_sign_negative());
        let found = rows(&f32s, &[TINY, 1.0, 2.0 * TINY]);
        assert_eq!(found.len(), 8, "9 combinations without the row itself");
        assert!(found.contains(&vec![TINY, 1.0, 0.0]) && found.contains(&vec![0.0, 1.0, 0.0]));
        assert!(found.iter().all(|row| row[1] == 1.0));
        // f16 has larger subnormals: 5e-5 is subnormal in f16 and normal in f32.
        let half = 5e-5;
        assert_eq!(rows(&[Scalar::F16, Scalar::F32], &[half, half]).len(), 2);
    }

    #[test]
    fn many_subnormals_are_flushed_together() {
        assert_eq!(rows(&[Scalar::F32; APART], &[TINY; APART]).len(), 80);
        let found = rows(&[Scalar::F32; 6], &[TINY, TINY, 1.0, TINY, TINY, TINY]);
        assert_eq!(found, [[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]; 2]);
    }

    /// Karat doesn't judge a passing case again. A case that always fails keeps its first error.
    #[test]
    fn the_arguments_as_given_come_first() {
        let judged = |holds: bool, lane: usize| Judged {
            measure: LaneError::statement(holds),
            lane,
            class: Class::Other,
        };
        let row = [TINY.to_bits()];
        let allow = |given: bool, flushed: bool| {
            allowing_flushes(&[Scalar::F32], &row, judged(given, 0), |_| judged(flushed, 1))
        };
        assert_eq!([(true, true), (true, false)].map(|(a, b)| allow(a, b).lane), [0, 0]);
        assert!(allow(false, true).measure.passes());
        assert_eq!((allow(false, false).lane, allow(false, false).measure.passes()), (0, false));
    }
}
