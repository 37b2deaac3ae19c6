//! Divides the support of a density into the cells of a histogram.

use super::{Rectangle, Support};

/// A partition of a support into cells, with about the same number of samples in each cell. The first coordinate is
/// divided into rows, and in each row the second coordinate is divided into columns.
///
/// If all cells had the same size, a single cell could contain a whole narrow lobe. So the bounds of the cells are
/// quantiles of the samples of a pilot run. The test uses other samples than the pilot's, so the cells don't depend on
/// the tested samples.
///
/// Many samples may be equal, for example if a sampler has lost a dimension. Then these samples get a cell of their
/// own, which is narrower than the distance to the neighbouring samples. The density predicts far fewer samples in this
/// cell, and some samples in the empty cells beside it, so the test rejects the sampler.
#[derive(Clone, Debug)]
pub struct Cells {
    support: Support,
    rows: Vec<f64>,
    columns: Vec<Vec<f64>>,
    /// The index of the first cell of each row, followed by the number of cells.
    offsets: Vec<usize>,
    /// For each cell, the smallest rectangle around the pilot samples in the cell.
    occupied: Vec<Option<Rectangle>>,
}

impl Cells {
    /// Divides the support into rows and columns, by the coordinates of pilot samples. There are at most `rows` rows
    /// with at most `columns` columns each, or up to twice as many if some samples are equal. If the support has only
    /// one coordinate, each row has one column.
    #[must_use]
    pub fn new(support: Support, pilot: &[[f64; 2]], rows: usize, columns: usize) -> Self {
        let columns = if support.is_line() { 1 } else { columns };
        let ends = support.extent();
        let first: Vec<f64> = pilot.iter().map(|at| at[0]).collect();
        let rows = quantiles(first, rows, ends[0]);
        let mut members = vec![Vec::new(); rows.len() + 1];
        for at in pilot {
            members[index(&rows, at[0])].push(at[1]);
        }
        let columns: Vec<Vec<f64>> =
            members.into_iter().map(|second| quantiles(second, columns, ends[1])).collect();
        let mut offsets = vec![0];
        for row in &columns {
            offsets.push(offsets[offsets.len() - 1] + row.len() + 1);
        }
        let occupied = vec![None; offsets[offsets.len() - 1]];
        let mut cells = Self { support, rows, columns, offsets, occupied };
        for at in pilot {
            let cell = cells.index(*at);
            let point = Rectangle { low: *at, high: *at };
            let grown = cells.occupied[cell].map_or(point, |occupied| occupied.union(point));
            cells.occupied[cell] = Some(grown);
        }
        cells
    }

    /// The number of cells.
    #[must_use]
    pub fn len(&self) -> usize {
        self.occupied.len()
    }

    /// Returns `false`: a partition has at least one cell.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.occupied.is_empty()
    }

    /// The index of the cell that contains the position `at`. If rounding moved the position beyond an end of the
    /// support, the position belongs to the cell at that end.
    #[must_use]
    pub fn index(&self, at: [f64; 2]) -> usize {
        let row = index(&self.rows, at[0]);
        self.offsets[row] + index(&self.columns[row], at[1])
    }

    /// The number of cells in each row.
    #[must_use]
    pub fn row_lengths(&self) -> Vec<usize> {
        self.columns.iter().map(|row| row.len() + 1).collect()
    }

    /// The rectangle that a cell covers.
    ///
    /// # Panics
    /// Panics if `cell` isn't the index of a cell.
    #[must_use]
    pub fn rectangle(&self, cell: usize) -> Rectangle {
        let row = self.offsets.partition_point(|offset| *offset <= cell) - 1;
        let [first, second] = self.support.extent();
        let (a0, a1) = bounds(&self.rows, row, first);
        let (b0, b1) = bounds(&self.columns[row], cell - self.offsets[row], second);
        Rectangle { low: [a0, b0], high: [a1, b1] }
    }

    /// Divides a cell into parts for integration. Next to the samples, a density may fall quickly, and a quadrature
    /// rule over a whole wide cell would miss this fall. So one part contains the cell's pilot samples, and the parts
    /// on both sides become twice as wide with each step away from this part.
    ///
    /// # Panics
    /// Panics if `cell` isn't the index of a cell.
    #[must_use]
    pub fn parts(&self, cell: usize) -> Vec<Rectangle> {
        let Rectangle { low, high } = self.rectangle(cell);
        let Some(occupied) = self.occupied[cell] else { return vec![Rectangle { low, high }] };
        let cuts = [0, 1].map(|side| {
            if side == 1 && self.support.is_line() {
                return vec![low[1], high[1]];
            }
            graded((low[side], high[side]), (occupied.low[side], occupied.high[side]))
        });
        let pairs = |cuts: &[f64]| -> Vec<(f64, f64)> {
            cuts.windows(2).map(|pair| (pair[0], pair[1])).collect()
        };
        let (first, second) = (pairs(&cuts[0]), pairs(&cuts[1]));
        let cut = |(a0, a1): (f64, f64)| {
            second.iter().map(move |(b0, b1)| Rectangle { low: [a0, *b0], high: [a1, *b1] })
        };
        first.into_iter().flat_map(cut).collect()
    }
}

/// The largest gap between two samples that rounding to `f32` can cause, as a share of the range. If samples are this
/// dense, rounding makes some of them equal, even if the sampler is correct.
const RESOLUTION: f64 = 4.0 * f32::EPSILON as f64;

/// The bounds that divide values into `parts` parts with about the same number of values. If a bound would separate
/// equal values, these values get a part of their own.
fn quantiles(mut values: Vec<f64>, parts: usize, ends: (f64, f64)) -> Vec<f64> {
    values.sort_unstable_by(f64::total_cmp);
    let smallest = RESOLUTION * (ends.1 - ends.0);
    let mut bounds: Vec<f64> = Vec::new();
    for part in 1..parts {
        let cut = part * values.len() / parts;
        if cut == 0 || cut >= values.len() {
            continue;
        }
        let (before, after) = (values[cut - 1], values[cut]);
        if before < after {
            bounds.push(0.5 * (before + after));
            continue;
        }
        let first = values.partition_point(|value| *value < after);
        let next = values.partition_point(|value| *value <= after);
        let below = after - first.checked_sub(1).map_or(ends.0, |index| values[index]);
        let above = values.get(next).copied().unwrap_or(ends.1) - after;
        // A quarter of the gap if the gap is wider than an `f32` step, and otherwise half of the gap.
        let share = |gap: f64| if gap > smallest { 0.25 * gap } else { 0.5 * gap };
        bounds.extend((below > 0.0).then(|| after - share(below)));
        bounds.extend((above > 0.0).then(|| after + share(above)));
    }
    bounds.retain(|bound| ends.0 < *bound && *bound < ends.1);
    bounds.sort_unstable_by(f64::total_cmp);
    bounds.dedup();
    bounds
}

fn index(bounds: &[f64], value: f64) -> usize {
    bounds.partition_point(|bound| *bound <= value)
}

fn bounds(inner: &[f64], part: usize, ends: (f64, f64)) -> (f64, f64) {
    let low = if part == 0 { ends.0 } else { inner[part - 1] };
    (low, inner.get(part).copied().unwrap_or(ends.1))
}

/// The bounds of the parts into which [`Cells::parts`] divides the range `low..high`. One part is `start..end`. The
/// parts on both sides become twice as wide with each step away from this part.
fn graded((low, high): (f64, f64), (start, end): (f64, f64)) -> Vec<f64> {
    // The range of one sample has the width 0. At most 30 doublings of the least width reach any support's end.
    let width = (end - start).max(1e-9 * (high - low));
    let steps = |gap: f64| {
        let mut step = width;
        std::iter::from_fn(move || {
            let at = step - width;
            step *= 2.0;
            // The last cut leaves at least half a step to the end.
            (at + 0.5 * step <= gap).then_some(at)
        })
    };
    let mut cuts = vec![low, high];
    cuts.extend(steps(start - low).map(|at| start - at));
    cuts.extend(steps(high - end).map(|at| end + at));
    cuts.sort_unstable_by(f64::total_cmp);
    cuts.dedup();
    cuts
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;
    use crate::domain::Source;

    fn pilot(support: Support, count: u64) -> Vec<[f64; 2]> {
        let [first, second] = support.extent();
        let mut source = Source::new(1, 1);
        (0..count)
            .map(|_| {
                // The samples are dense near the first end, as in a lobe.
                let a = first.0 + 1e-3 * (first.1 - first.0) * source.unit() * source.unit();
                [a, second.0 + (second.1 - second.0) * source.unit()]
            })
            .collect()
    }

    #[test]
    fn each_cell_holds_nearly_the_same_number_of_samples() {
        let samples = pilot(Support::Hemisphere, 16_384);
        let cells = Cells::new(Support::Hemisphere, &samples, 16, 32);
        assert_eq!(cells.len(), 512);
        let mut counts = vec![0; cells.len()];
        samples.iter().for_each(|at| counts[cells.index(*at)] += 1);
        assert!(counts.iter().all(|count| (30..=34).contains(count)), "{counts:?}");
    }

    #[test]
    fn cells_cover_their_support_without_gaps() {
        for support in [Support::Sphere, Support::Disk, Support::Interval(-1.0, 3.0)] {
            let cells = Cells::new(support, &pilot(support, 2000), 8, 16);
            let area = |r: Rectangle| (r.high[0] - r.low[0]) * (r.high[1] - r.low[1]);
            let mut whole = 0.0;
            for cell in 0..cells.len() {
                let of_parts: f64 = cells.parts(cell).into_iter().map(area).sum();
                let of_cell = area(cells.rectangle(cell));
                assert!((of_parts - of_cell).abs() < 1e-12);
                let Rectangle { low, high } = cells.rectangle(cell);
                let middle = [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1])];
                assert_eq!(cells.index(middle), cell);
                whole += of_cell;
            }
            let [(a0, a1), (b0, b1)] = support.extent();
            assert!((whole - (a1 - a0) * (b1 - b0)).abs() < 1e-9);
        }
    }

    #[test]
    fn coincident_samples_are_cut_off() {
        let cells = Cells::new(Support::Sphere, &[[0.5, 0.5]; 100], 16, 32);
        assert_eq!((cells.row_lengths(), cells.is_empty()), (vec![1, 3, 1], false));
        let own = cells.rectangle(cells.index([0.5, 0.5]));
        assert_eq!((own.low, own.high[1]), ([0.375, 0.375], 0.5 + 0.25 * (TAU - 0.5)));
        // Each of the 64 values has a cell, and each gap between two values has two cells.
        let value = |i: u32| [f64::from(i % 64) / 64.0 + 1.0 / 128.0, 0.5];
        let steps: Vec<_> = (0..16_384).map(value).collect();
        let cells = Cells::new(Support::Interval(0.0, 1.0), &steps, 512, 1);
        assert_eq!(cells.len(), 64 + 2 * 63 + 2);
        assert_eq!(
            quantiles(vec![0.5, 0.5 + 1e-7, 0.5 + 1e-7, 0.5 + 2e-7], 2, (0.0, 1.0)).len(),
            2
        );
    }

    #[test]
    fn steps_double_away_from_what_is_occupied() {
        assert_eq!(graded((0.0, 1.0), (0.0, 0.125)), [0.0, 0.125, 0.25, 0.5, 1.0]);
        assert_eq!(graded((0.0, 1.0), (0.0, 0.99)), [0.0, 1.0]);
    }
}
