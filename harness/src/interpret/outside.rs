//! Decides if reads and writes outside of arrays change a result.
//!
//! WGSL allows such a read to return any element or zero. It allows such a write to change any element, or nothing
//! (6.4.4). A read matters if another choice changes the data that passes write. The choice may be for this read, or
//! for all reads outside of arrays together.

use karat_engine::{Choice, Elsewhere, Options, Outside};

use super::dispatch::{OfPass, Prepared};
use crate::dispatch::DispatchError;

/// The largest number of runs for judging the reads of one pass.
const MOST_RUNS: usize = 64;

/// Other values that a read may return, the most useful first. If there are few reads, Karat tries more elements.
/// Shaders compare kinds and flags with small numbers, so only one element may change the result.
const OTHERS: [Elsewhere; 7] = [
    Elsewhere::Number(0),
    Elsewhere::Nth(0),
    Elsewhere::Wrapped,
    Elsewhere::Nth(2),
    Elsewhere::Nth(1),
    Elsewhere::Nth(3),
    Elsewhere::Nth(5),
];
const LEAST: usize = 3;

/// Other values for generated contents, whose elements may be any number.
const ANY: [Elsewhere; 6] = [
    Elsewhere::Number(0),
    Elsewhere::Number(47),
    Elsewhere::Number(u8::MAX),
    Elsewhere::Number(1),
    Elsewhere::Number(2),
    Elsewhere::Number(3),
];

/// The reads outside of arrays that change the result of a pass.
#[derive(Debug, Default)]
pub(super) struct Matter {
    /// Reads that change the result on their own.
    pub(super) alone: Vec<u32>,
    /// Set if only all reads together change the result.
    pub(super) together: bool,
    /// The number of reads that weren't tried.
    pub(super) untried: usize,
}

/// Judges the reads of the pass `number`. `made_up` says that contents are generated.
pub(super) fn matter(
    prepared: &Prepared<'_>,
    (number, made_up): (usize, bool),
    reads: &[&Outside],
    options_of: OfPass<'_>,
) -> Result<Matter, DispatchError> {
    let others = if made_up { &ANY[..] } else { &OTHERS };
    let mut runs = 0;
    let mut left = |outside: Choice, outside_at: Option<(u32, Elsewhere)>| {
        runs += 1;
        prepared.dispatched(&|own| match options_of(own) {
            options if own == number => Options { outside, outside_at, ..options },
            options => options,
        })
    };
    let mut all = Matter::default();
    // A write outside of an array may restore a value that a wrong read changed.
    let dropped = Choice { drops: true, ..Choice::default() };
    let usual = left(dropped, None)?;
    // Keeps some runs for all reads together.
    let left_over = MOST_RUNS - 1 - 2 * (1 + LEAST);
    let each = (left_over / reads.len().max(1)).clamp(LEAST, others.len());
    let most = left_over / each;
    all.untried = reads.len().saturating_sub(most);
    for read in reads.iter().take(most) {
        for elsewhere in others.iter().copied().take(each) {
            if left(dropped, Some((read.number, elsewhere)))? != usual {
                all.alone.push(read.number);
                break;
            }
        }
    }
    if all.alone.is_empty() && !reads.is_empty() {
        for drops in [true, false] {
            let usual = left(Choice { drops, ..Choice::default() }, None)?;
            for reads in others.iter().copied().take(LEAST) {
                all.together |= left(Choice { reads, drops }, None)? != usual;
            }
        }
    }
    debug_assert!(runs <= MOST_RUNS, "{runs}");
    Ok(all)
}

/// The choices for all reads and writes outside of arrays, if contents are generated.
pub(super) fn choices() -> impl Iterator<Item = Choice> {
    ANY.into_iter().take(LEAST).map(|reads| Choice { reads, drops: true })
}
