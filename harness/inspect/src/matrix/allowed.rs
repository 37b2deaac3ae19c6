//! Checks results against the bounds that WGSL allows.

use karat::unstable::interpret::Bound;
use karat::unstable::probe::Probed;
use karat_core::value::Scalar;
use serde::Serialize;

use super::Row;
use super::execute::shown;

/// The comparison of a function's results on one column with the bounds that WGSL allows.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Allowed {
    /// The number of cases in which WGSL bounds each component.
    pub bounded: usize,
    /// The number of cases with a component outside of its bounds.
    pub outside: usize,
    /// The first case outside of its bounds: its arguments, the bounds, and the result.
    pub first: Option<String>,
}

impl Allowed {
    /// Compares the result of each case with WGSL's bounds.
    pub(super) fn of(probed: &Probed, rows: &[u32], bounds: &[Bound], results: &[u32]) -> Self {
        let function = probed.function();
        let scalars = function.result.lanes();
        let arguments: Vec<Scalar> =
            function.parameters.iter().flat_map(|(_, shape)| shape.lanes()).collect();
        let width = scalars.len();
        let mut allowed = Self { bounded: 0, outside: 0, first: None };
        let cases = bounds.chunks_exact(width).zip(results.chunks_exact(width));
        for (case, (bounds, words)) in cases.enumerate() {
            let ends: Vec<_> = bounds.iter().map(Bound::ends).collect();
            allowed.bounded += usize::from(ends.iter().all(Option::is_some));
            let outside = |lane: usize| !bounds[lane].allows(scalars[lane].decode(words[lane]));
            let Some(lane) = (0..width).find(|lane| outside(*lane)) else { continue };
            allowed.outside += 1;
            allowed.first.get_or_insert_with(|| {
                let row = &rows[case * arguments.len()..][..arguments.len()];
                let (least, most) = ends[lane].expect("bounds without ends allow every value");
                let (at, result) = (shown(&arguments, row), shown(&scalars, words));
                format!("at {at} the function returns {result}, but WGSL allows only results from {least} to {most}")
            });
        }
        allowed
    }

    pub(super) fn and(self, more: Self) -> Self {
        let (bounded, outside) = (self.bounded + more.bounded, self.outside + more.outside);
        Self { bounded, outside, first: self.first.or(more.first) }
    }
}

impl Row {
    /// The columns with results that WGSL doesn't allow, each with its index.
    pub fn columns_outside(&self) -> impl Iterator<Item = (usize, &Allowed)> {
        let cells = self.cells.iter().enumerate();
        let outside = cells.filter_map(|(index, cell)| Some((index, cell.allowed.as_ref()?)));
        outside.filter(|(_, allowed)| allowed.outside > 0)
    }
}
