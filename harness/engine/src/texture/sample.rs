//! Which texels a sample is made of, and their weights.

use super::{Address, Dimension, Filter, Sampler, Texture, cube};

/// The level of detail of a sample.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Level {
    /// Given.
    Exact(f64),
    /// From how far the coordinates move from a pixel to the next, in both directions.
    Gradient([f64; 3], [f64; 3]),
}

/// Texels and weights, which sum to one.
#[derive(Debug, Default)]
pub(crate) struct Footprint {
    /// Weight, level, texel.
    pub(crate) texels: Vec<(f64, u32, [u32; 3])>,
}

/// Where a sample is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) at: [f64; 3],
    /// The layer of an array; of a cube array, the cube.
    pub(crate) layer: u32,
    pub(crate) offset: [i32; 3],
}

impl Texture {
    fn dimensions(&self) -> usize {
        match self.dimension {
            Dimension::D1 => 1,
            Dimension::D2 | Dimension::Cube => 2,
            Dimension::D3 => 3,
        }
    }

    /// log2 of the longer of both gradients in texels.
    fn detail(&self, level: Level) -> f64 {
        match level {
            Level::Exact(level) => level,
            Level::Gradient(x, y) => {
                let n = self.dimensions();
                let length = |d: [f64; 3]| {
                    let squares = (0..n).map(|k| (d[k] * f64::from(self.size[k])).powi(2));
                    squares.sum::<f64>().sqrt()
                };
                length(x).max(length(y)).log2()
            }
        }
    }

    /// The texels that a sampler filters, in place of those that were there.
    pub(crate) fn footprint(
        &self,
        sampler: &Sampler,
        place: Place,
        level: Level,
        footprint: &mut Footprint,
    ) {
        footprint.texels.clear();
        let detail = self.detail(level);
        // NaN has no level; the largest is as good as any.
        let detail = if detail.is_nan() { 0.0 } else { detail };
        let detail = detail.clamp(f64::from(sampler.lod_min), f64::from(sampler.lod_max));
        let filter = if detail <= 0.0 { sampler.mag } else { sampler.min };
        let last = f64::from(self.levels() - 1);
        let detail = detail.clamp(0.0, last);
        match sampler.mip {
            Filter::Nearest => {
                let level = (detail + 0.5).floor().min(last);
                self.level(sampler, filter, place, level as u32, 1.0, footprint);
            }
            Filter::Linear => {
                let below = detail.floor();
                let share = detail - below;
                self.level(sampler, filter, place, below as u32, 1.0 - share, footprint);
                if share > 0.0 {
                    self.level(sampler, filter, place, below as u32 + 1, share, footprint);
                }
            }
        }
    }

    fn level(
        &self,
        sampler: &Sampler,
        filter: Filter,
        place: Place,
        level: u32,
        weight: f64,
        to: &mut Footprint,
    ) {
        let n = self.dimensions();
        let size = self.level_size(level);
        let (face, at) = self.on_face(place);
        // Filters have no use for coordinates that aren't finite; NaN becomes 0.
        let texel = |k: usize| at[k].clamp(-1e9, 1e9) * f64::from(size[k]);
        let texel = |k: usize| if texel(k).is_nan() { 0.0 } else { texel(k) };
        let mut find = |index: [i64; 3], weight: f64| {
            self.find(sampler, place, face, index, size, |part, texel| {
                to.texels.push((weight * part, level, texel));
            });
        };
        if filter == Filter::Nearest {
            let index = std::array::from_fn(|k| {
                if k < n { texel(k).floor() as i64 + i64::from(place.offset[k]) } else { 0 }
            });
            find(index, weight);
            return;
        }
        let low: [f64; 3] =
            std::array::from_fn(|k| if k < n { (texel(k) - 0.5).floor() } else { 0.0 });
        for corner in 0..1usize << n {
            let mut share = weight;
            let index = std::array::from_fn(|k| {
                if k >= n {
                    return 0;
                }
                let fraction = texel(k) - 0.5 - low[k];
                let high = corner >> k & 1 == 1;
                share *= if high { fraction } else { 1.0 - fraction };
                low[k] as i64 + i64::from(high) + i64::from(place.offset[k])
            });
            if share != 0.0 {
                find(index, share);
            }
        }
    }

    /// The four texels that a gather reads, in WGSL's order.
    pub(crate) fn gathered(&self, sampler: &Sampler, place: Place) -> [Footprint; 4] {
        let size = self.level_size(0);
        let (face, at) = self.on_face(place);
        let low = |k: usize| {
            let texel = at[k].clamp(-1e9, 1e9) * f64::from(size[k]) - 0.5;
            if texel.is_nan() { 0 } else { texel.floor() as i64 + i64::from(place.offset[k]) }
        };
        // (u min, v max), (u max, v max), (u max, v min), (u min, v min)
        [(0, 1), (1, 1), (1, 0), (0, 0)].map(|(x, y)| {
            let mut footprint = Footprint::default();
            let index = [low(0) + x, low(1) + y, 0];
            self.find(sampler, place, face, index, size, |share, at| {
                footprint.texels.push((share, 0, at));
            });
            footprint
        })
    }

    fn on_face(&self, place: Place) -> (usize, [f64; 3]) {
        if self.dimension == Dimension::Cube {
            let (face, u, v) = cube::face(place.at);
            (face, [u, v, 0.0])
        } else {
            (0, place.at)
        }
    }

    /// The texel at an index that may lie beyond the edge. At the corner of a cube, where three
    /// faces meet, it is the mean of those three.
    fn find(
        &self,
        sampler: &Sampler,
        place: Place,
        face: usize,
        index: [i64; 3],
        size: [u32; 3],
        mut found: impl FnMut(f64, [u32; 3]),
    ) {
        let address = |k: usize| addressed(index[k], size[k], sampler.address[k]);
        match self.dimension {
            Dimension::D1 => found(1.0, [address(0), 0, 0]),
            Dimension::D2 => found(1.0, [address(0), address(1), place.layer]),
            Dimension::D3 => found(1.0, [address(0), address(1), address(2)]),
            Dimension::Cube => {
                let layer = |face: usize| place.layer * 6 + face as u32;
                let inside = |k: usize| (0..i64::from(size[k])).contains(&index[k]);
                let [x, y, _] = index;
                let edge = |k: usize| index[k].clamp(0, i64::from(size[k]) - 1);
                let there = |x: i64, y: i64| {
                    let (face, x, y) = cube::beyond(face, x, y, size[0]);
                    [x, y, layer(face)]
                };
                match (inside(0), inside(1)) {
                    (true, true) => found(1.0, [x as u32, y as u32, layer(face)]),
                    (false, false) => {
                        let third = 1.0 / 3.0;
                        found(third, [edge(0) as u32, edge(1) as u32, layer(face)]);
                        found(third, there(x, edge(1)));
                        found(third, there(edge(0), y));
                    }
                    _ => found(1.0, there(x, y)),
                }
            }
        }
    }
}

/// The texel that an address mode finds.
fn addressed(index: i64, size: u32, mode: Address) -> u32 {
    let n = i64::from(size);
    let found = match mode {
        Address::ClampToEdge => index.clamp(0, n - 1),
        Address::Repeat => index.rem_euclid(n),
        Address::MirrorRepeat => {
            let turn = index.rem_euclid(2 * n);
            turn.min(2 * n - 1 - turn)
        }
    };
    found as u32
}
