//! Cases that are quads of pixels.

use crate::reflect::Function;

/// Pixels of a quad: the upper left one, the one to its right, and the two below.
pub(super) const PIXELS: usize = 4;

/// How the rows of cases become the rows of pixels.
#[derive(Debug)]
pub(super) struct Quads {
    /// The lanes of each argument at one pixel, and whether it varies.
    arguments: Vec<(usize, bool)>,
}

impl Quads {
    pub(super) fn of(function: &Function) -> Self {
        let of = |(_, shape): &(String, crate::value::Shape)| match shape.quad() {
            Some(value) => (value.lanes().len(), true),
            None => (shape.lanes().len(), false),
        };
        Self { arguments: function.parameters.iter().map(of).collect() }
    }

    /// The rows of all pixels, in the arithmetic of the kernel.
    pub(super) fn pixels(&self, rows: &[u32]) -> Vec<u32> {
        let width: usize =
            self.arguments.iter().map(|(lanes, varies)| lanes * if *varies { 3 } else { 1 }).sum();
        if width == 0 {
            return Vec::new();
        }
        let mut pixels = Vec::with_capacity(rows.len() * PIXELS);
        for row in rows.chunks_exact(width) {
            for pixel in 0..PIXELS {
                let step = [(pixel % 2) as f32, (pixel / 2) as f32];
                let mut rest = row;
                for &(lanes, varies) in &self.arguments {
                    let (value, behind) = rest.split_at(lanes);
                    rest = behind;
                    if !varies {
                        pixels.extend_from_slice(value);
                        continue;
                    }
                    let (dx, behind) = rest.split_at(lanes);
                    let (dy, behind) = behind.split_at(lanes);
                    rest = behind;
                    let at = |index: usize| {
                        let [value, dx, dy] = [value, dx, dy].map(|w| f32::from_bits(w[index]));
                        (value + step[0] * dx + step[1] * dy).to_bits()
                    };
                    pixels.extend((0..lanes).map(at));
                }
            }
        }
        pixels
    }
}
