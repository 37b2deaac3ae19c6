//! Proves statements about a function's results for all arguments of a domain, by interval arithmetic with
//! WGSL's bounds.

use super::session::Session;
use crate::interpret::Bound;
use crate::value::Scalar;

/// The largest number of boxes that a proof examines. A box is a set of arguments: each component has a range
/// of values.
const BOXES: usize = 4096;

/// The number of boxes that the engine evaluates at a time.
const TOGETHER: usize = 256;

/// A box: the lower ends of all components' ranges, and the upper ends. A row of arguments lies in the box if
/// each component lies in its range.
type Ends = [Vec<u32>; 2];

impl Session<'_> {
    /// Tries to prove that the statement holds for each result that WGSL allows, for all arguments of the domain. The
    /// proof halves boxes of arguments until the statement holds for each box. `false` means that Karat found no proof.
    /// The statement may still hold. If the tested function reads a resource, Karat doesn't look for a proof.
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

/// Cuts a box into halves, in the middle of the component with the widest range. `None` if the box contains a
/// single row.
fn halves([from, to]: &Ends, scalars: &[Scalar]) -> Option<[Ends; 2]> {
    let length = |lane: &usize| {
        let [from, to] = [from, to].map(|row| scalars[*lane].decode(row[*lane]));
        to - from
    };
    let lane = (0..scalars.len()).max_by(|one, other| length(one).total_cmp(&length(other)))?;
    let scalar = scalars[lane];
    let [least, most] = [from, to].map(|row| scalar.decode(row[lane]));
    let middle = f64::midpoint(least, most);
    // Halves of a range of integers don't overlap. Halves of a range of floats share the number in the middle.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Integers;
    use crate::fixture::Uniform;
    use crate::package::Package;
    use crate::path::Path;

    /// Returns all rows that lie in a box of integers and booleans. Each row is a list of numbers.
    fn rows([from, to]: &Ends, scalars: &[Scalar]) -> Vec<Vec<i64>> {
        let mut all = vec![Vec::new()];
        for (lane, scalar) in scalars.iter().enumerate() {
            let [least, most] = [from, to].map(|row| match scalar {
                Scalar::I32 => i64::from(row[lane].cast_signed()),
                _ => i64::from(row[lane]),
            });
            let longer = |row: &Vec<i64>| {
                let row = row.clone();
                (least..=most).map(move |x| [&row[..], &[x]].concat())
            };
            all = all.iter().flat_map(longer).collect();
        }
        all
    }

    /// Cuts a box into halves again and again, until each piece has one row. Checks that the pieces contain
    /// each row of the whole box once.
    fn cut(whole: &Ends, scalars: &[Scalar]) {
        let (mut boxes, mut met) = (vec![whole.clone()], Vec::new());
        while let Some(one) = boxes.pop() {
            match halves(&one, scalars) {
                Some(halves) => {
                    let mut both: Vec<_> =
                        halves.iter().flat_map(|half| rows(half, scalars)).collect();
                    both.sort_unstable();
                    assert_eq!(both, rows(&one, scalars), "{one:?} of {scalars:?}");
                    boxes.extend(halves);
                }
                None => {
                    let own = rows(&one, scalars);
                    assert_eq!(own.len(), 1, "{one:?} of {scalars:?} is whole");
                    met.extend(own);
                }
            }
        }
        met.sort_unstable();
        assert_eq!(met, rows(whole, scalars), "{scalars:?}");
    }

    /// If a row were in neither half, the proof would skip this row.
    #[test]
    fn both_halves_of_an_integer_range_cover_each_row_once() {
        let end = |x: i32| x.cast_unsigned();
        for (scalar, starts) in [
            (Scalar::U32, [0, 1, 6, end(i32::MAX) - 3, u32::MAX - 8]),
            (Scalar::I32, [end(-5), 0, end(i32::MIN), end(i32::MAX - 8), end(-1)]),
        ] {
            for start in starts {
                for length in 0..=8 {
                    let to = start.wrapping_add(length);
                    cut(&[vec![start], vec![to]], &[scalar]);
                    // Karat cuts the component with the widest range, wherever it is among the arguments.
                    cut(&[vec![0, start], vec![1, to]], &[Scalar::Bool, scalar]);
                    cut(&[vec![start, 3], vec![to, 6]], &[scalar, Scalar::U32]);
                    cut(&[vec![end(-2), start], vec![1, to]], &[Scalar::I32, scalar]);
                }
            }
        }
        cut(&[vec![0, 1], vec![1, 1]], &[Scalar::Bool; 2]);
        let whole = [vec![0], vec![u32::MAX]];
        let half = u32::MAX / 2;
        let expected = [[vec![0], vec![half]], [vec![half + 1], vec![u32::MAX]]];
        assert_eq!(halves(&whole, &[Scalar::U32]), Some(expected));
        let whole = [vec![end(i32::MIN)], vec![end(i32::MAX)]];
        let expected = [[vec![end(i32::MIN)], vec![end(-1)]], [vec![0], vec![end(i32::MAX)]]];
        assert_eq!(halves(&whole, &[Scalar::I32]), Some(expected));
    }

    /// The two halves of a range of floats share the number at which Karat cuts the range. A range of two adjacent
    /// floats has no number between its ends, so Karat can't cut it.
    #[test]
    fn both_halves_of_a_float_range_share_one_number() {
        let all =
            [-f32::MAX, -1.0, -f32::from_bits(1), 0.0, f32::from_bits(1), 1e-30, 1.0, f32::MAX];
        for (at, from) in all.into_iter().enumerate() {
            for to in all[at..].iter().flat_map(|to| [*to, to.next_up()]) {
                let ends = [vec![from.to_bits()], vec![to.to_bits()]];
                match halves(&ends, &[Scalar::F32]) {
                    Some([[first, below], [above, last]]) => {
                        let [below, above] = [below, above].map(|row| f32::from_bits(row[0]));
                        assert_eq!([first, last], ends);
                        let is_between =
                            from.total_cmp(&below).is_lt() && below.total_cmp(&to).is_lt();
                        assert!(below == above && is_between, "{from} {below} {to}");
                    }
                    None => assert!(!(from.next_up() < to && to.is_finite()), "{from} {to}"),
                }
            }
        }
        assert_eq!(halves(&[vec![0], vec![0x3c00]], &[Scalar::F16]), None);
    }

    /// If WGSL's bounds exceed the range, or if WGSL sets no bounds, there is no proof, although the actual results
    /// stay in the range. The proof gives up after 4,096 boxes.
    #[test]
    fn there_is_no_proof_if_the_wgsl_bounds_exceed_the_range() {
        let package = Package::from_source(
            "proofs",
            "fn part(x: f32) -> f32 { return x - floor(x); }
            fn back(x: f32) -> f32 { return floor(x) - x; }
            fn inverse(x: f32) -> f32 { return min(1.0 / x, 1.0); }
            fn tenth(x: f32) -> f32 { return min(x, 0.1); }
            fn large(i: u32) -> u32 { return min(i, 16777217u); }",
        );
        let engine = crate::executor::of(Path::CPU).expect("it opens");
        let over = |name: &'static str| package.function(name).on(engine);
        let unit = |name| over(name).over(0.0..=1.0).unrecorded();
        assert!(!unit("part").stays_within(0.0..=1.0).proved);
        assert!(!unit("back").stays_within(-1.0..=0.0).proved);
        assert!(!unit("inverse").stays_within(0.0..=1.0).proved);
        // The `f32` nearest to 0.1 is larger than 0.1. Karat doesn't round bounds for integers to `f32`.
        assert!(unit("tenth").stays_within(0.0..=0.1).proved);
        let large = over("large").over(Integers(0..=20_000_000_u32)).unrecorded();
        assert!(large.stays_within(0.0..=16_777_217.0).proved);
    }

    /// Karat proves nothing about a function that reads a buffer, because the buffer may contain other values in an
    /// application than in the test.
    #[test]
    fn a_read_buffer_is_not_an_argument() {
        let package = Package::from_source(
            "proofs",
            "@group(0) @binding(0) var<uniform> half: f32;
            fn read(x: f32) -> f32 { return x * half; }
            fn alone(x: f32) -> f32 { return x * 0.5; }
            fn nth(i: u32, j: i32) -> u32 { return min(i, 1000u) + u32(max(j, 0)); }
            fn pair(x: f32) -> vec2f { return vec2f(0.5 * x, 0.25 * x); }
            fn hole(i: u32) -> u32 { return select(i % 7u, 9u, i == 3u); }",
        );
        let engine = crate::executor::of(Path::CPU).expect("it opens");
        let over = |name: &'static str| package.function(name).on(engine);
        let read = over("read").with("half", Uniform::new(0.5_f32)).over(0.0..=1.0);
        assert!(!read.unrecorded().stays_within(0.0..=1.0).proved);
        assert!(over("alone").over(0.0..=1.0).unrecorded().stays_within(0.0..=1.0).proved);
        let nth = || over("nth").over((Integers(0..=5000_u32), Integers(-9..=9_i32))).unrecorded();
        assert!(nth().stays_within(0.0..=1009.0).proved);
        nth().try_stays_within(0.0..=1008.0).expect_err("the last of both");
        let pair = || over("pair").over(0.0..=1.0).unrecorded();
        assert!(pair().stays_within(0.0..=0.5).proved, "each component is within");
        pair().try_stays_within(0.0..=0.25).expect_err("of the first");
        let hole = over("hole").over(Integers(0..=6_u32)).unrecorded();
        hole.try_stays_within(0.0..=7.0).expect_err("of 3");
    }
}
