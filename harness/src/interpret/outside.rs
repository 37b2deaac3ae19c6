//! Decides whether reads and writes outside arrays change a result.
//!
//! WGSL allows such a read to return any element or zero, and such a write to go to any element or nowhere (6.4.4). A
//! read matters if another choice changes the words that passes leave: a choice for this read alone, or for all reads
//! outside together.

use karat_engine::{Choice, Elsewhere, Options, Outside};

use super::dispatch::{OfPass, Prepared};
use crate::dispatch::DispatchError;

/// The most runs that judge a pass's reads.
const MOST_RUNS: usize = 64;

/// Other values that a read may return, the likeliest first. With few reads, more elements are tried: shaders compare
/// kinds and flags with small numbers, and only one of those may change the result.
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

/// The same for generated contents, where any number may be an element.
const ANY: [Elsewhere; 6] = [
    Elsewhere::Number(0),
    Elsewhere::Number(47),
    Elsewhere::Number(u8::MAX),
    Elsewhere::Number(1),
    Elsewhere::Number(2),
    Elsewhere::Number(3),
];

/// The reads outside arrays in a pass that change the result.
#[derive(Debug, Default)]
pub(super) struct Matter {
    /// Operations that change it by themselves.
    pub(super) alone: Vec<u32>,
    /// Set if no read changes it alone, but all of them together do.
    pub(super) together: bool,
    /// The number of operations that weren't tried.
    pub(super) untried: usize,
}

/// Judges the reads of the pass with this number. Its contents may be generated.
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
    // A write outside may restore a value that a read outside changed.
    let dropped = Choice { drops: true, ..Choice::default() };
    let usual = left(dropped, None)?;
    // The runs with all reads together need a share, too.
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

/// The choices for all reads and writes outside arrays, for generated contents.
pub(super) fn choices() -> impl Iterator<Item = Choice> {
    ANY.into_iter().take(LEAST).map(|reads| Choice { reads, drops: true })
}
