//! Whether what indices outside of arrays read and write matters.
//!
//! WGSL allows a read there to give any element or zero, and a write to go to any element or nowhere (6.4.4). A read
//! matters if the words that passes leave are others for another such choice: by itself, with all else as it was, or
//! together with all other reads outside.

use karat_engine::{Choice, Elsewhere, Options, Outside};

use super::dispatch::{OfPass, Prepared};
use crate::dispatch::DispatchError;

/// Runs by which a pass' reads are judged.
const MOST_RUNS: usize = 64;

/// What else may be read, the likeliest first: with few reads more elements are tried, as kinds and flags are compared
/// with small numbers, one of which may be the only one that matters.
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

/// The same over contents that are made up, of which any number may be an element.
const ANY: [Elsewhere; 6] = [
    Elsewhere::Number(0),
    Elsewhere::Number(47),
    Elsewhere::Number(u8::MAX),
    Elsewhere::Number(1),
    Elsewhere::Number(2),
    Elsewhere::Number(3),
];

/// The reads outside of a pass that matter.
#[derive(Debug, Default)]
pub(super) struct Matter {
    /// Operations that do by themselves.
    pub(super) alone: Vec<u32>,
    /// True if none does by itself, and all of them do together.
    pub(super) together: bool,
    /// Operations that weren't tried.
    pub(super) untried: usize,
}

/// Judges the reads of the pass of this number, which may be over contents that are made up.
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
    // A write outside may put back what a read outside has changed.
    let dropped = Choice { drops: true, ..Choice::default() };
    let usual = left(dropped, None)?;
    // Those together are some, too.
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

/// The choices between which all that is read and written outside is compared, over contents that are made up.
pub(super) fn choices() -> impl Iterator<Item = Choice> {
    ANY.into_iter().take(LEAST).map(|reads| Choice { reads, drops: true })
}
