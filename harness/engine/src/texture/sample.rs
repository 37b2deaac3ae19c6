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

/// Texels and weights, which sum to one: of a corner of a cube three.
pub(crate) type Footprint = Vec<(f64, [u32; 3])>;

/// The next whole number below, as a float and as an integer: without a call, which `f64::floor` is before SSE 4.1.
#[inline]
fn floor(x: f64) -> (f64, i64) {
    let cut = x as i64;
    let index = cut - i64::from(cut as f64 > x);
    (index as f64, index)
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

    /// Visits the texels that a sampler filters: weight, level, texel. Weights sum to one.
    pub(crate) fn each_texel(
        &self,
        sampler: &Sampler,
        place: Place,
        level: Level,
        mut visit: impl FnMut(f64, u32, [u32; 3]),
    ) {
        let detail = self.detail(level);
        // NaN has no level; the largest is as good as any.
        let detail = if detail.is_nan() { 0.0 } else { detail };
        let detail = detail.clamp(f64::from(sampler.lod_min), f64::from(sampler.lod_max));
        let filter = if detail <= 0.0 { sampler.mag } else { sampler.min };
        let last = f64::from(self.levels() - 1);
        let detail = detail.clamp(0.0, last);
        let on_face = self.on_face(place);
        // One call of what is inlined: it is long.
        let (first, share) = match sampler.mip {
            Filter::Nearest => (floor(detail + 0.5).0.min(last), 0.0),
            Filter::Linear => {
                let (below, _) = floor(detail);
                (below, detail - below)
            }
        };
        for (level, weight) in [(first as u32, 1.0 - share), (first as u32 + 1, share)] {
            if weight > 0.0 {
                self.level((sampler, filter), (place, on_face), level, weight, &mut visit);
            }
        }
    }

    #[inline]
    fn level(
        &self,
        (sampler, filter): (&Sampler, Filter),
        (place, (face, at)): (Place, (usize, [f64; 3])),
        level: u32,
        weight: f64,
        visit: &mut impl FnMut(f64, u32, [u32; 3]),
    ) {
        let n = self.dimensions().min(3);
        let size = self.level_size(level);
        // Filters have no use for coordinates that aren't finite; NaN becomes 0.
        let texel = |k: usize| {
            let texel = at[k].clamp(-1e9, 1e9) * f64::from(size[k]);
            if texel.is_nan() { 0.0 } else { texel }
        };
        if filter == Filter::Nearest {
            let index = std::array::from_fn(|k| {
                if k < n { floor(texel(k)).1 + i64::from(place.offset[k]) } else { 0 }
            });
            self.find(sampler, place, face, index, size, |part, at| {
                visit(weight * part, level, at)
            });
            return;
        }
        let mut low = [0; 3];
        let mut fraction = [0.0; 3];
        let mut inside = true;
        for k in 0..n {
            let centre = texel(k) - 0.5;
            let (below, index) = floor(centre);
            low[k] = index + i64::from(place.offset[k]);
            fraction[k] = centre - below;
            inside &= low[k] >= 0 && low[k] + 1 < i64::from(size[k]);
        }
        // Nearly all samples have no texel beyond an edge.
        if inside && n == 2 {
            let layer = match self.dimension {
                Dimension::Cube => place.layer * 6 + face as u32,
                _ => place.layer,
            };
            let [x, y] = [low[0] as u32, low[1] as u32];
            let [right, down] = [fraction[0], fraction[1]];
            let [left, up] = [weight * (1.0 - right), 1.0 - down];
            let right = weight * right;
            for (share, at) in [
                (left * up, [x, y, layer]),
                (right * up, [x + 1, y, layer]),
                (left * down, [x, y + 1, layer]),
                (right * down, [x + 1, y + 1, layer]),
            ] {
                if share != 0.0 {
                    visit(share, level, at);
                }
            }
            return;
        }
        for corner in 0..1usize << n {
            let mut share = weight;
            let index = std::array::from_fn(|k| {
                if k >= n {
                    return 0;
                }
                let high = corner >> k & 1 == 1;
                share *= if high { fraction[k] } else { 1.0 - fraction[k] };
                low[k] + i64::from(high)
            });
            if share != 0.0 {
                self.find(sampler, place, face, index, size, |part, at| {
                    visit(share * part, level, at);
                });
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
            self.find(sampler, place, face, index, size, |share, at| footprint.push((share, at)));
            footprint
        })
    }

    #[inline]
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
