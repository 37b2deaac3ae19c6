//! Decides if reads and writes outside of arrays change a result.
//!
//! WGSL allows a read outside of an array to return any element or zero. WGSL allows a write outside of an array to
//! change any element, or nothing (6.4.4). A read outside of an array matters if the passes write other data when the
//! read returns another value. To find out, Karat runs the passes again, and changes the value of one such read, or of
//! all such reads.

use karat_engine::{Choice, Elsewhere, Options, Outside};

use super::dispatch::{OfPass, Prepared};
use crate::dispatch::DispatchError;

/// The largest number of times that Karat runs the passes to judge the reads of one pass.
const MOST_RUNS: usize = 64;

/// Values that a read outside of an array may return, the most useful first. Karat tries several, because perhaps only
/// one of them changes the result. If there are few reads, Karat tries more of these values.
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

/// Values that a read outside of an array may return if Karat generated the contents of the array. Such an array could
/// contain any number.
const ANY: [Elsewhere; 6] = [
    Elsewhere::Number(0),
    Elsewhere::Number(47),
    Elsewhere::Number(u8::MAX),
    Elsewhere::Number(1),
    Elsewhere::Number(2),
    Elsewhere::Number(3),
];

/// The effect that a pass's reads outside of arrays have on the results.
#[derive(Debug, Default)]
pub(super) struct Matter {
    /// The reads that change the result while every other read returns its usual value, by their `Outside::number`.
    pub(super) alone: Vec<u32>,
    /// `true` if no single read changes the result, but the result changes if all reads return other values.
    pub(super) together: bool,
    pub(super) untried: usize,
}

/// Finds out which of the `reads` outside of arrays in the pass `number` change the results. `made_up` is `true` if
/// Karat generated the contents of the passes' resources.
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
    // Reserves some of the runs for changing all reads together.
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

/// The choices to try, one in each run: the value that all reads outside of arrays return. In each run, writes outside
/// of arrays change nothing.
pub(super) fn choices() -> impl Iterator<Item = Choice> {
    ANY.into_iter().take(LEAST).map(|reads| Choice { reads, drops: true })
}
