//! Which texels a sample is made of, and their weights.

use super::{Address, Comparison, Dimension, Filter, Sampler, Texels, Texture, cube};
use crate::arithmetic::sealed::Rules;

/// The level of detail of a sample.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Level {
    /// Given.
    Exact(f64),
    /// From how far the coordinates move from a pixel to the next, in both directions.
    Gradient([f64; 3], [f64; 3]),
}

/// Samples that are looked at together.
pub(crate) const TOGETHER: usize = 64;

/// Numbers of so many samples.
pub(crate) type Many = [f64; TOGETHER];

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

    /// The mean of the texels that a sampler filters, or of whether `reference` compares with them.
    pub(crate) fn mean(
        &self,
        sampler: &Sampler,
        place: Place,
        level: Level,
        reference: Option<f64>,
    ) -> Mean {
        let mut mean = Mean::of(sampler, reference);
        let on_face = self.on_face(place);
        let (filter, first, share) = self.levels_of(sampler, level);
        let is_bilinear =
            filter == Filter::Linear && mean.compare.is_none() && self.dimensions() == 2;
        for (level, weight) in [(first, 1.0 - share), (first + 1, share)] {
            if weight > 0.0
                && !(is_bilinear && self.bilinear((place, on_face), level, weight, &mut mean))
            {
                self.level((sampler, filter), (place, on_face), level, weight, &mut mean);
            }
        }
        mean
    }

    /// The filter of a level of detail, the level that it begins with, and the weight of the next one.
    #[inline]
    fn levels_of(&self, sampler: &Sampler, level: Level) -> (Filter, u32, f64) {
        let last = self.levels() - 1;
        if last == 0 && sampler.mag == sampler.min {
            return (sampler.mag, 0, 0.0);
        }
        let detail = self.detail(level);
        // NaN has no level; the largest is as good as any.
        let detail = if detail.is_nan() { 0.0 } else { detail };
        let detail = detail.clamp(f64::from(sampler.lod_min), f64::from(sampler.lod_max));
        let filter = if detail <= 0.0 { sampler.mag } else { sampler.min };
        let detail = detail.clamp(0.0, f64::from(last));
        match sampler.mip {
            Filter::Nearest => (filter, (floor(detail + 0.5).1 as u32).min(last), 0.0),
            Filter::Linear => {
                let (below, first) = floor(detail);
                (filter, first as u32, detail - below)
            }
        }
    }

    /// True if [`bilinear_of`](Self::bilinear_of) knows the texture and the sampler: one level that isn't nearer or further
    /// than another one, of floats, without layers.
    pub(crate) fn is_bilinear(&self, sampler: &Sampler) -> bool {
        let is_flat = match self.dimension {
            Dimension::D2 => self.size[2] == 1,
            Dimension::Cube => self.size[2] == 6,
            Dimension::D1 | Dimension::D3 => false,
        };
        let is_linear = [sampler.mag, sampler.min] == [Filter::Linear; 2];
        is_flat && is_linear && matches!(*self.levels, [Texels::Float(_)])
    }

    /// The sums of the four channels of samples at these coordinates, and the samples that have none: those with a
    /// texel beyond an edge, or fewer than four.
    pub(crate) fn bilinear_of(
        &self,
        [x, y, z]: &[Many; 3],
        wanted: &[bool; TOGETHER],
    ) -> ([[f64; 4]; TOGETHER], [bool; TOGETHER]) {
        let [width, height, _] = self.size.map(f64::from);
        let is_cube = self.dimension == Dimension::Cube;
        let mut corners = [Corner::default(); TOGETHER];
        for (k, corner) in corners.iter_mut().enumerate() {
            let (face, u, v) = cube::face([x[k], y[k], z[k]]);
            let (face, u, v) = if is_cube { (face, u, v) } else { (0.0, x[k], y[k]) };
            *corner = Corner::of([u, v], [0.0; 2], face, [width, height]);
        }
        let (mut sums, mut left_out) = ([[0.0; 4]; TOGETHER], [false; TOGETHER]);
        let [Texels::Float(texels)] = &*self.levels else { return (sums, *wanted) };
        for k in (0..TOGETHER).filter(|k| wanted[*k]) {
            match corners[k].blend(texels, self.size[0]) {
                Some(sum) => sums[k] = sum,
                None => left_out[k] = true,
            }
        }
        (sums, left_out)
    }

    /// Adds four texels of a level, as nearly all samples have: none is beyond an edge. `false`: they aren't four.
    #[inline]
    fn bilinear(
        &self,
        (place, (face, at)): (Place, (usize, [f64; 3])),
        level: u32,
        weight: f64,
        mean: &mut Mean,
    ) -> bool {
        let Texels::Float(texels) = &self.levels[level as usize] else { return false };
        let [width, height, _] = self.level_size(level);
        let layer = match self.dimension {
            Dimension::Cube => f64::from(place.layer) * 6.0 + face as f64,
            _ => f64::from(place.layer),
        };
        let [u, v, _] = at;
        let [right, down, _] = place.offset.map(f64::from);
        let corner = Corner::of([u, v], [right, down], layer, [width, height].map(f64::from));
        let Some(sum) = corner.blend(texels, width) else { return false };
        mean.sum.iter_mut().zip(sum).for_each(|(to, sum)| *to += weight * sum);
        mean.count += 4;
        true
    }

    #[inline(never)]
    fn level(
        &self,
        (sampler, filter): (&Sampler, Filter),
        (place, (face, at)): (Place, (usize, [f64; 3])),
        level: u32,
        weight: f64,
        mean: &mut Mean,
    ) {
        let mut visit = |weight: f64, at: [u32; 3]| mean.add(weight, self.texel(level, at, 0));
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
                visit(weight * part, at);
            });
            return;
        }
        let mut low = [0; 3];
        let mut fraction = [0.0; 3];
        for k in 0..n {
            let centre = texel(k) - 0.5;
            let (below, index) = floor(centre);
            low[k] = index + i64::from(place.offset[k]);
            fraction[k] = centre - below;
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
                    visit(share * part, at);
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
            (face as usize, [u, v, 0.0])
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

/// The first of four texels, counted over all layers, and how far a place is from its centre; below 0 if not all four
/// are inside, or not all four count. In floats alone, so that several places are looked at by one instruction.
#[derive(Clone, Copy, Default)]
struct Corner {
    first: f64,
    right: f64,
    down: f64,
}

impl Corner {
    #[inline(always)]
    fn of(at: [f64; 2], offset: [f64; 2], layer: f64, [width, height]: [f64; 2]) -> Self {
        // Numbers below 2^51 in size are rounded to whole ones by this sum, as floats have 53 bits. Larger ones are outside.
        const ROUNDING: f64 = 1.5 * (1u64 << 52) as f64;
        let along = |at: f64, offset: f64, size: f64| {
            let centre = at * size - 0.5;
            let whole = (centre + ROUNDING) - ROUNDING;
            let whole = whole - if whole > centre { 1.0 } else { 0.0 };
            (whole + offset, centre - whole)
        };
        let (left, right) = along(at[0], offset[0], width);
        let (up, down) = along(at[1], offset[1], height);
        let is_inside = (left >= 0.0) & (up >= 0.0) & (left + 1.0 < width) & (up + 1.0 < height);
        // The texel below and to the right is the one that a weight of 0 leaves out. NaN isn't above 0.
        let has_four = is_inside & (right > 0.0) & (down > 0.0);
        let first = if has_four { (layer * height + up) * width + left } else { -1.0 };
        Self { first, right, down }
    }

    /// The mean of the four by their distances, channel by channel, where a row has so many texels.
    #[inline(always)]
    fn blend(self, texels: &[[f32; 4]], row: u32) -> Option<[f64; 4]> {
        if !(self.first >= 0.0) {
            return None;
        }
        let first = self.first as usize;
        let above = texels.get(first..)?.first_chunk::<2>()?;
        let below = texels.get(first + row as usize..)?.first_chunk::<2>()?;
        let (left, up) = (1.0 - self.right, 1.0 - self.down);
        let shares = [left * up, self.right * up, left * self.down, self.right * self.down];
        let [a, b, c, d] =
            [above[0], above[1], below[0], below[1]].map(|texel| texel.map(f64::from));
        let [p, q, r, s] = shares;
        Some(std::array::from_fn(|k| p * a[k] + q * b[k] + r * c[k] + s * d[k]))
    }
}

/// The weighted mean of texels, or of whether a reference compares with them.
pub(crate) struct Mean {
    compare: Option<(Comparison, f64)>,
    sum: [f64; 4],
    count: u32,
    /// The first texel: alone it is exact, infinities included.
    first: [u32; 4],
}

impl Mean {
    pub(crate) fn of(sampler: &Sampler, reference: Option<f64>) -> Self {
        let compare = sampler.compare.zip(reference);
        Self { compare, sum: [0.0; 4], count: 0, first: [0; 4] }
    }

    pub(crate) fn add(&mut self, weight: f64, words: [u32; 4]) {
        if self.count == 0 {
            self.first = words;
        }
        self.count += 1;
        let mut texel = words.map(|word| f64::from(f32::from_bits(word)));
        if let Some((compare, reference)) = self.compare {
            texel = texel.map(|texel| f64::from(compare.holds(reference, texel)));
        }
        for (sum, texel) in self.sum.iter_mut().zip(texel) {
            *sum += weight * texel;
        }
    }

    pub(crate) fn channel<A: Rules>(
        &self,
        texture: &Texture,
        channel: usize,
        unbounded: bool,
    ) -> A::Float {
        if unbounded {
            return A::float(f32::NAN);
        }
        if self.count == 1 && self.compare.is_none() && !A::NOTES {
            return A::float(f32::from_bits(self.first[channel]));
        }
        let hull = if self.compare.is_some() { (0.0, 1.0) } else { texture.hull(channel) };
        A::filtered(self.sum[channel], hull)
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
