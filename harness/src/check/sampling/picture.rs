//! Draws pictures of a histogram: the observed counts, the expected counts and the differences.

use std::path::PathBuf;

use crate::golden::output;
use crate::image::{Image, ImageError, Precision};
use crate::record;
use crate::stats::{Cells, Rectangle, Support};

/// The side of a cell in pixels.
const SIDE: u32 = 8;

const NAMED: usize = 3;

/// A difference of this many standard deviations is as bright in the picture as the mean count.
const BRIGHT: f64 = 4.0;

pub(super) struct Histogram {
    pub(super) cells: Cells,
    pub(super) observed: Vec<u64>,
    pub(super) expected: Vec<f64>,
}

/// The names of a cell's two coordinates: one grows from row to row, the other from column to column.
fn axes(support: Support) -> [&'static str; 2] {
    match support {
        Support::Sphere | Support::Hemisphere => ["theta", "phi"],
        Support::Disk => ["r", "phi"],
        Support::Interval(..) => ["x", ""],
    }
}

impl Histogram {
    /// The difference between a cell's observed and expected count, in standard deviations.
    fn difference(&self, cell: usize) -> f64 {
        let (observed, expected) = (self.observed[cell] as f64, self.expected[cell]);
        if observed == expected { 0.0 } else { (observed - expected) / expected.sqrt() }
    }

    pub(super) fn record(&self, support: Support) -> record::Histogram {
        record::Histogram {
            axes: axes(support).map(str::to_owned),
            rows: self.cells.row_lengths(),
            observed: self.observed.clone(),
            expected: self.expected.clone(),
        }
    }

    pub(super) fn worst_cells(&self, support: Support) -> String {
        let mut cells: Vec<usize> = (0..self.cells.len()).collect();
        cells.sort_by(|a, b| self.difference(*b).abs().total_cmp(&self.difference(*a).abs()));
        let names = axes(support);
        let shown = |cell: usize| {
            let Rectangle { low, high } = self.cells.rectangle(cell);
            let mut text = format!("{} {:.4}..{:.4}", names[0], low[0], high[0]);
            if !support.is_line() {
                text += &format!(", {} {:.4}..{:.4}", names[1], low[1], high[1]);
            }
            let (observed, expected) = (self.observed[cell], self.expected[cell]);
            let sigma = self.difference(cell);
            format!("\n      {text}: {observed}, expected {expected:.1} ({sigma:+.1} sigma)")
        };
        cells.into_iter().take(NAMED).map(shown).collect()
    }

    /// Writes the picture as EXR and PNG into `target/karat/samples`.
    pub(super) fn write(&self, name: &str) -> Result<Vec<PathBuf>, ImageError> {
        let folder = output().join("samples");
        let image = self.image();
        let exr = folder.join(format!("{name}.exr"));
        let png = exr.with_extension("png");
        image.write_exr(&exr, Precision::Float, None)?;
        image.write_png(&png)?;
        Ok(vec![exr, png])
    }

    /// Draws three panels of cells with the first row at the top. The first panel shows the observed counts, the second
    /// panel the expected counts, both divided by the mean count. The third panel shows the difference, divided by its
    /// standard deviation: red for too many samples, blue for too few. The picture shows all cells at the same size, so
    /// a narrow lobe, which has many small cells, looks large.
    fn image(&self) -> Image {
        let rows = self.cells.row_lengths();
        let columns = rows.iter().copied().max().unwrap_or(1);
        // The picture shows a single column of cells as a row.
        let (rows, columns) =
            if columns == 1 { (vec![rows.len()], rows.len()) } else { (rows, columns) };
        let [columns, height] =
            [columns, rows.len()].map(|cells| u32::try_from(cells).expect("a few hundred cells"));
        let mean = self.expected.iter().sum::<f64>() / self.expected.len() as f64;
        let panel = columns * SIDE;
        let mut pixels = Vec::new();
        for y in 0..height * SIDE {
            let row = (y / SIDE) as usize;
            let first: usize = rows[..row].iter().sum();
            for x in 0..3 * panel {
                let column = (x % panel / SIDE) as usize * rows[row] / columns as usize;
                let cell = first + column;
                let grey = |value: f64| [value / mean; 3];
                let color = match x / panel {
                    0 => grey(self.observed[cell] as f64),
                    1 => grey(self.expected[cell]),
                    _ => {
                        let difference = self.difference(cell) / BRIGHT;
                        [difference.max(0.0), 0.0, (-difference).max(0.0)]
                    }
                };
                #[expect(clippy::cast_possible_truncation, reason = "a picture")]
                let [r, g, b] = color.map(|value| value as f32);
                pixels.push([r, g, b, 1.0]);
            }
        }
        Image::new(3 * panel, height * SIDE, pixels)
    }
}
