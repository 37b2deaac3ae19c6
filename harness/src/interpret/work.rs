//! Measures the work of calls: the number of operations, and loops that take too many iterations.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};

use karat_engine::{F32, F64, Here, Observer, Options, Runs, Stop};

use super::hazards::PATIENCE;
use super::trace::Traced as _;
use super::{Alone, Interpreted, place};
use crate::diagnostic::Span;
use crate::fixture::Fixtures;
use crate::probe::{ProbeError, Probed};

#[derive(Default)]
struct Evaluations(AtomicU64);

impl Observer<F32> for Evaluations {
    fn reached(&self, _: &Here<'_, F32>) {
        self.0.fetch_add(1, Ordering::Relaxed);
    }
}

/// Estimates the number of operations in a call. Calls run together, and an operation counts if any of the calls
/// reaches it. If each call is a quad, the number is multiplied by 4, because a quad has four pixels. If the function
/// writes to module-scope variables, its calls run one by one, and the result is the mean number of operations of a
/// call. Returns `None` if the loops take too many iterations.
pub fn evaluations(
    probed: &Probed,
    fixtures: &Fixtures,
    (count, rows): (usize, &[u32]),
) -> Result<Option<u64>, ProbeError> {
    /// The largest number of loop iterations in all calls together.
    const ROUNDS: u64 = 1 << 20;
    let seen = Evaluations::default();
    if !probed.function().form.alone {
        let called = Interpreted::new(probed, fixtures)?;
        let options = Options { work: ROUNDS, deadline: None, ..called.options() };
        return match called.run::<F32>(count, rows, &options, &seen) {
            Ok(_) => Ok(Some(seen.0.into_inner() * called.lanes() as u64)),
            Err(Stop::Work { .. } | Stop::Fuel { .. }) => Ok(None),
            Err(stop) => Err(called.error(&stop)),
        };
    }
    // Runs the calls one by one, so that each call has its own count.
    let count = count.max(1);
    let (width, each) = (rows.len() / count, ROUNDS / count as u64);
    let called = Alone::new(probed, fixtures)?.with_fuel(each);
    match (0..count).try_for_each(|case| called.run(&rows[case * width..][..width], &seen)) {
        Ok(()) => Ok(Some(seen.0.into_inner() / count as u64)),
        Err(ProbeError::Rounds { .. }) => Ok(None),
        Err(error) => Err(error),
    }
}

/// The calls whose loops take more than 4,096 iterations, each with the loop in which the engine stopped the call. Most
/// functions also run in double precision, where a loop may take more iterations. The list is empty if the number of
/// iterations of each loop has a known bound, because such loops end.
pub fn long_cases(
    probed: &Probed,
    fixtures: &Fixtures,
    (count, rows): (usize, &[u32]),
) -> Result<BTreeMap<usize, Span>, ProbeError> {
    if probed.program.most_rounds().is_some() {
        return Ok(BTreeMap::new());
    }
    if !probed.function().form.alone {
        let called = Interpreted::new(probed, fixtures)?;
        let mut long = called.long::<F32>(count, rows)?;
        long.extend(called.long::<F64>(count, rows)?);
        return Ok(long);
    }
    let width = rows.len().checked_div(count).unwrap_or_default();
    let called = Alone::new(probed, fixtures)?.with_fuel(PATIENCE);
    let mut long = BTreeMap::new();
    for case in 0..count {
        match called.run::<F32>(&rows[case * width..][..width], &()) {
            Ok(()) => {}
            Err(ProbeError::Rounds { diagnostic, .. }) => {
                let at = diagnostic.location().unwrap_or(&probed.function().span);
                long.insert(case, at.clone());
            }
            Err(error) => return Err(error),
        }
    }
    Ok(long)
}

impl Interpreted {
    fn long<A: Runs>(
        &self,
        count: usize,
        rows: &[u32],
    ) -> Result<BTreeMap<usize, Span>, ProbeError> {
        let options = Options { fuel: PATIENCE, leaves: true, ..self.options() };
        let results = self.call_with::<A>(count, rows, &options)?;
        let each = self.lanes();
        let all = results.long().iter().map(|(lane, span)| {
            let at = place(&self.program, span.to_range());
            (lane / each, at.unwrap_or_else(|| self.function.span.clone()).first_line())
        });
        Ok(all.collect())
    }
}
