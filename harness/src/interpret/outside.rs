//! Decides if reads and writes outside of arrays change a result.
//!
//! WGSL allows a read outside of an array to return any element or zero. WGSL allows a write outside of an array to
//! change any element, or nothing (6.4.4). A read matters if another returned value changes the data that passes write.
//! To judge reads, Karat changes the value of one read, or the values of all reads outside of arrays.

use karat_engine::{Choice, Elsewhere, Options, Outside};

use super::dispatch::{OfPass, Prepared};
use crate::dispatch::DispatchError;

/// The largest number of times that Karat runs the passes to judge the reads of one pass.
const MOST_RUNS: usize = 64;

/// Other values that a read may return, the most useful first. If there are few reads, Karat tries more elements.
/// An element may be a kind or a flag, which shaders compare with small numbers. Then only one of the elements may
/// change the result.
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

/// Other values that a read may return if contents are generated. Elements of generated contents may be any number.
const ANY: [Elsewhere; 6] = [
    Elsewhere::Number(0),
    Elsewhere::Number(47),
    Elsewhere::Number(u8::MAX),
    Elsewhere::Number(1),
    Elsewhere::Number(2),
    Elsewhere::Number(3),
];

/// The effect of a pass's reads outside of arrays on its result.
#[derive(Debug, Default)]
pub(super) struct Matter {
    /// The numbers of the reads that change the result even if every other read returns its usual value.
    pub(super) alone: Vec<u32>,
    /// `true` if no single read changes the result, but the result changes if all reads return other values.
    pub(super) together: bool,
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

/// For passes over generated contents: the values that all reads outside of arrays return in one run, one choice for
/// each run. Writes outside of arrays have no effect.
pub(super) fn choices() -> impl Iterator<Item = Choice> {
    ANY.into_iter().take(LEAST).map(|reads| Choice { reads, drops: true })
}
