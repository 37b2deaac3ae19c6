//! Turns cases into quads: 2 x 2 neighbouring pixels, between which a shader takes derivatives.

use crate::reflect::Function;
use crate::value::{Scalar, Shape};

/// The number of pixels in a quad: two pixels in the upper row and two pixels in the lower row.
pub(super) const PIXELS: usize = 4;

#[derive(Debug)]
pub(super) struct Quads {
    /// For each argument, its scalars at one pixel, and `true` if the argument varies between pixels.
    arguments: Vec<(Vec<Scalar>, bool)>,
    /// The pixel whose results count, if rows have the arguments of all four pixels. `None` if rows have the first
    /// pixel's arguments and slopes (differences to its neighbours): then the first pixel's results count.
    pub(super) own: Option<usize>,
}

impl Quads {
    pub(super) fn of(function: &Function) -> Self {
        let of = |(_, shape): &(String, Shape)| match shape.quad() {
            Some(value) => (value.lanes(), true),
            None => (shape.lanes(), false),
        };
        Self { arguments: function.parameters.iter().map(of).collect(), own: None }
    }

    /// Sets `open` to `true` for each scalar of the results that changes if all slopes are a little steeper or flatter.
    pub(super) fn open<E>(
        &self,
        rows: &[u32],
        open: &mut [bool],
        results: impl Fn(&[u32]) -> Result<Vec<u32>, E>,
    ) -> Result<(), E> {
        /// Factors by which the slopes are multiplied. They move the mip level up or down by about a third of a level
        /// (log2 of 1.25 is 0.32). A driver's mip level may differ from the exact mip level by this amount.
        const SLOPES: [f32; 2] = [0.8, 1.25];
        let usual = results(rows)?;
        for factor in SLOPES {
            let other = results(&self.steeper(rows, factor))?;
            let pairs = usual.iter().zip(&other);
            open.iter_mut().zip(pairs).for_each(|(open, (a, b))| *open |= a != b);
        }
        Ok(())
    }

    /// The rows with slopes multiplied by `factor`. All other values stay unchanged.
    fn steeper(&self, rows: &[u32], factor: f32) -> Vec<u32> {
        let of_argument = |(scalars, varies): &(Vec<Scalar>, bool)| {
            let slopes = if *varies { 2 } else { 0 };
            let own = scalars.iter().map(|_| false);
            let floats = scalars.iter().map(|scalar| scalar.is_float());
            own.chain((0..slopes).flat_map(|_| floats.clone())).collect::<Vec<_>>()
        };
        let is_slope: Vec<bool> = self.arguments.iter().flat_map(of_argument).collect();
        let words = rows.iter().zip(is_slope.iter().cycle());
        let scaled = |(word, is_slope): (&u32, &bool)| match is_slope {
            true => (f32::from_bits(*word) * factor).to_bits(),
            false => *word,
        };
        words.map(scaled).collect()
    }

    /// The arguments of each of the four pixels of a quad, one pixel after another. If rows contain slopes, this
    /// function computes the other pixels' arguments with the same formula as the shader that drivers run.
    pub(super) fn pixels(&self, rows: &[u32]) -> Vec<u32> {
        if self.own.is_some() {
            return rows.to_vec();
        }
        let width: usize = self
            .arguments
            .iter()
            .map(|(scalars, varies)| scalars.len() * if *varies { 3 } else { 1 })
            .sum();
        if width == 0 {
            return Vec::new();
        }
        let mut pixels = Vec::with_capacity(rows.len() * PIXELS);
        for row in rows.chunks_exact(width) {
            for pixel in 0..PIXELS {
                let step = [(pixel % 2) as f32, (pixel / 2) as f32];
                let mut rest = row;
                for (scalars, varies) in &self.arguments {
                    let (value, behind) = rest.split_at(scalars.len());
                    rest = behind;
                    if !varies {
                        pixels.extend_from_slice(value);
                        continue;
                    }
                    let (dx, behind) = rest.split_at(scalars.len());
                    let (dy, behind) = behind.split_at(scalars.len());
                    rest = behind;
                    let at = |(index, scalar): (usize, &Scalar)| {
                        if !scalar.is_float() {
                            return value[index];
                        }
                        let [value, dx, dy] = [value, dx, dy].map(|w| f32::from_bits(w[index]));
                        (value + step[0] * dx + step[1] * dy).to_bits()
                    };
                    pixels.extend(scalars.iter().enumerate().map(at));
                }
            }
        }
        pixels
    }
}
