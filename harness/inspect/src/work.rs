//! Selects the cases with which Karat runs a function. In a selected case, no loop has more than 4,096 iterations. The
//! selected cases are evenly spread over all cases, and their number is as large as the function's work budget allows.

use std::borrow::Cow;

use karat::fixture::Fixtures;
use karat::unstable::interpret::{evaluations, long_cases};
use karat::unstable::probe::Probed;
use karat_core::diagnostic::Span;

use crate::limits::SAMPLE;
use crate::made_up::{Arguments, Ranges, SEED};

/// Converts rows (each has the arguments of one case) for another version of the function. The `usize` is the number of
/// rows.
type Own<'s> = &'s dyn Fn(&[u32], usize) -> Vec<u32>;

/// One version of a function, with its resources. `own` converts rows into this version's arguments; without `own`, the
/// version gets the rows unchanged.
pub(crate) struct Side<'s> {
    pub(crate) probed: &'s Probed,
    pub(crate) fixtures: &'s Fixtures,
    pub(crate) own: Option<Own<'s>>,
}

impl Side<'_> {
    fn rows<'r>(&self, rows: &'r [u32], count: usize) -> Cow<'r, [u32]> {
        self.own.map_or(Cow::Borrowed(rows), |own| Cow::Owned(own(rows, count)))
    }
}

pub(crate) struct Chosen {
    pub(crate) count: usize,
    pub(crate) rows: Vec<u32>,
    pub(crate) cut: usize,
    /// The rows in which a loop has too many iterations, each with the loop's position.
    pub(crate) long: Vec<(Vec<u32>, Span)>,
    /// The number of cases that the work budget allows; 0 if a single case costs too much.
    pub(crate) allowed: usize,
}

impl Chosen {
    /// Selects the rows in which each loop ends. If the engine can't run the function, all rows are selected, because
    /// other paths may run the function.
    pub(crate) fn ending(
        side: &Side<'_>,
        arguments: &Arguments,
        (all, rows): (usize, &[u32]),
    ) -> Self {
        let long = long_cases(side.probed, side.fixtures, (all, &side.rows(rows, all)));
        let long = long.unwrap_or_default();
        let (count, left) = arguments.select(rows, all, |at| !long.contains_key(&at));
        let width = arguments.width();
        let row = |(case, span)| (rows[case * width..][..width].to_vec(), span);
        let long: Vec<_> = long.into_iter().map(row).collect();
        Self { count, rows: left, cut: all - count, long, allowed: usize::MAX }
    }

    /// Selects as many rows as the work budget allows for the costliest version of the function, and leaves out rows
    /// for which a loop of the first version doesn't end.
    pub(crate) fn of(
        sides: &[Side<'_>],
        arguments: &Arguments,
        (all, rows): (usize, &[u32]),
        work: u64,
    ) -> Self {
        let spread = |count: usize| {
            let each = all.div_ceil(count.max(1)).max(1);
            arguments.select(rows, all, |at| at % each == 0)
        };
        let (count, sample) = spread(SAMPLE);
        let sample = Self::ending(&sides[0], arguments, (count, &sample));
        // If no loop ends in any measured case, no case runs: the number of iterations probably doesn't depend on the
        // arguments.
        if sample.count == 0 {
            return Self { cut: all, ..sample };
        }
        let mut most = 0;
        for side in sides {
            let own = side.rows(&sample.rows, sample.count);
            match evaluations(side.probed, side.fixtures, (sample.count, &own)) {
                Ok(operations) => most = most.max(operations.unwrap_or(u64::MAX)),
                Err(_) => return Self::ending(&sides[0], arguments, (all, rows)),
            }
        }
        let allowed = usize::try_from(work / most.max(1)).unwrap_or(usize::MAX);
        let (count, chosen) = spread(allowed.max(SAMPLE));
        let chosen = Self::ending(&sides[0], arguments, (count, &chosen));
        Self { cut: all - chosen.count, allowed, ..chosen }
    }
}

/// The arguments for cases of a function without side effects, one row for each case. If the function's loops end in
/// too few cases, the rows of these cases repeat.
pub(crate) fn rows(
    probed: &Probed,
    ranges: &Ranges,
    fixtures: &Fixtures,
    cases: usize,
) -> Result<Vec<u32>, String> {
    let arguments = Arguments::of(probed.function(), ranges)?;
    let width = arguments.width();
    if width == 0 {
        return Ok(Vec::new());
    }
    let (count, rows) = arguments.rows(SEED, cases);
    let side = Side { probed, fixtures, own: None };
    let Chosen { rows: ending, .. } = Chosen::ending(&side, &arguments, (count, &rows));
    // If no loop ends, the number of iterations probably doesn't depend on the arguments. Drivers may run more
    // iterations.
    let rows = if ending.is_empty() { rows } else { ending };
    Ok(rows.iter().copied().cycle().take(cases * width).collect())
}

/// The reason why a function has no verdict if one of its loops runs too long in each case.
pub(crate) const ENDS_FOR_NONE: &str =
    "for each input, a loop of the function runs more than 4096 iterations";
