//! A statement about results, proved for all arguments of a domain by the bounds that WGSL gives.

use super::session::Session;
use crate::interpret::Bound;
use crate::value::Scalar;

/// The most boxes of arguments of a proof.
const BOXES: usize = 4096;

/// Boxes that run together.
const TOGETHER: usize = 256;

/// Arguments from those of one row to those of another one.
type Ends = [Vec<u32>; 2];

impl Session<'_> {
    /// True if the statement holds for each result that WGSL allows, for any arguments of the domain: halves boxes of
    /// arguments until it holds for each. `false` proves nothing, and of functions that read a resource it always is.
    pub(super) fn is_proved(&self, holds: &dyn Fn(&[Bound]) -> bool) -> bool {
        if self.is_replay() || !self.called.function().bindings.is_empty() {
            return false;
        }
        let (Some(ends), Ok(engine)) = (self.stream.ends(), self.witness()) else { return false };
        let scalars = self.called.argument_scalars();
        let width = scalars.len();
        if ends[0].len() != width || width == 0 {
            return false;
        }
        let (mut boxes, mut looked_at) = (vec![ends], 0);
        while !boxes.is_empty() {
            let some = boxes.split_off(boxes.len().saturating_sub(TOGETHER));
            looked_at += some.len();
            let rows = [0, 1].map(|end| some.iter().flat_map(|one| &one[end]).copied().collect());
            let [from, to]: [Vec<u32>; 2] = rows;
            let Ok(Some(bounds)) = engine.bounds_between(some.len(), [&from, &to]) else {
                return false;
            };
            let lanes = bounds.len() / some.len();
            for (one, bounds) in some.into_iter().zip(bounds.chunks(lanes.max(1))) {
                if holds(bounds) {
                    continue;
                }
                match halves(&one, &scalars) {
                    Some(halves) if looked_at + boxes.len() < BOXES => boxes.extend(halves),
                    _ => return false,
                }
            }
        }
        true
    }
}

/// A box, cut in two across its longest side; `None` if it holds one row alone.
fn halves([from, to]: &Ends, scalars: &[Scalar]) -> Option<[Ends; 2]> {
    let length = |lane: &usize| {
        let [from, to] = [from, to].map(|row| scalars[*lane].decode(row[*lane]));
        to - from
    };
    let lane = (0..scalars.len()).max_by(|one, other| length(one).total_cmp(&length(other)))?;
    let scalar = scalars[lane];
    let [least, most] = [from, to].map(|row| scalar.decode(row[lane]));
    let middle = f64::midpoint(least, most);
    // The neighbours of an integer are apart, and those of a float meet.
    let (below, above) = match scalar {
        Scalar::F32 => {
            #[expect(clippy::cast_possible_truncation, reason = "any number between does")]
            let middle = middle as f32;
            (middle.to_bits(), middle.to_bits())
        }
        #[expect(clippy::cast_possible_truncation, reason = "between two i32")]
        Scalar::I32 => {
            let middle = middle.floor() as i32;
            (middle.cast_unsigned(), middle.saturating_add(1).cast_unsigned())
        }
        #[expect(clippy::cast_possible_truncation, reason = "between two u32")]
        #[expect(clippy::cast_sign_loss, reason = "between two u32")]
        Scalar::U32 => {
            let middle = middle.floor() as u32;
            (middle, middle.saturating_add(1))
        }
        Scalar::Bool => (0, 1),
        Scalar::F16 => return None,
    };
    let is_smaller = |word: u32| word != from[lane] && word != to[lane];
    if scalar == Scalar::F32 && !is_smaller(below) || from[lane] == to[lane] {
        return None;
    }
    let with = |row: &[u32], word: u32| {
        let mut row = row.to_vec();
        row[lane] = word;
        row
    };
    Some([[from.clone(), with(to, below)], [with(from, above), to.clone()]])
}
