//! Finds the texels of a sample, and their weights.

use super::{Address, Comparison, Dimension, Filter, Sampler, Texels, Texture, cube};
use crate::arithmetic::sealed::Rules;

#[derive(Clone, Copy, Debug)]
pub(crate) enum Level {
    /// The caller passes the level of detail.
    Exact(f64),
    /// The level of detail follows from the changes of the coordinates to the next pixel, horizontally and vertically.
    Gradient([f64; 3], [f64; 3]),
}

pub(crate) const TOGETHER: usize = 64;

/// One number for each of [`TOGETHER`] samples.
pub(crate) type Many = [f64; TOGETHER];

/// Texels with their weights. The sum of the weights is 1.
pub(crate) type Footprint = Vec<(f64, [u32; 3])>;

/// The largest integer that isn't above `x`, as a float and as an integer. The code avoids `f64::floor`, which is a
/// function call before SSE 4.1.
#[inline]
fn floor(x: f64) -> (f64, i64) {
    let cut = x as i64;
    let index = cut - i64::from(cut as f64 > x);
    (index as f64, index)
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) at: [f64; 3],
    /// The layer of an array. For a cube array, the index of the cube.
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

    /// The weighted mean of the texels that a sampler reads. If there is a `reference`, each texel counts as 1 or 0:
    /// the result of its comparison with `reference`.
    pub(crate) fn mean(
        &self,
        sampler: &Sampler,
        place: Place,
        level: Level,
        reference: Option<f64>,
    ) -> Mean {
        let mut mean = Mean::of(sampler, reference);
        let on_face = self.on_face(place);
        let level = match level {
            Level::Gradient(x, y) if self.dimension == Dimension::Cube => {
                let [x, y] = [x, y].map(|step| cube::step(place.at, step));
                Level::Gradient(x, y)
            }
            other => other,
        };
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

    /// The filter for a level of detail, the first of the two mip levels to mix, and the weight of the second mip
    /// level.
    #[inline]
    fn levels_of(&self, sampler: &Sampler, level: Level) -> (Filter, u32, f64) {
        let last = self.levels() - 1;
        if last == 0 && sampler.mag == sampler.min {
            return (sampler.mag, 0, 0.0);
        }
        let detail = self.detail(level);
        // NaN has no level, so the largest level is used.
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

    /// Checks if [`bilinear_of`](Self::bilinear_of) can sample the texture with the sampler: the texels are floats, the
    /// texture has no layers and only one mip level, and the filters are linear.
    pub(crate) fn is_bilinear(&self, sampler: &Sampler) -> bool {
        let is_flat = match self.dimension {
            Dimension::D2 => self.size[2] == 1,
            Dimension::Cube => self.size[2] == 6,
            Dimension::D1 | Dimension::D3 => false,
        };
        let is_linear = [sampler.mag, sampler.min] == [Filter::Linear; 2];
        is_flat && is_linear && matches!(*self.levels, [Texels::Float(_)])
    }

    /// For each sample at these coordinates, the weighted sum of its four texels in each channel. The second result is
    /// `true` for samples without such a sum, because a texel is beyond an edge, or there are fewer than four texels.
    pub(crate) fn bilinear_of(
        &self,
        [x, y, z]: &[Many; 3],
        wanted: &[bool; TOGETHER],
    ) -> ([[f64; 4]; TOGETHER], [bool; TOGETHER]) {
        let is_cube = self.dimension == Dimension::Cube;
        let (mut sums, mut left_out) = ([[0.0; 4]; TOGETHER], [false; TOGETHER]);
        let Some(plane) = self.plane(0) else { return (sums, *wanted) };
        let mut corners = [Corner::default(); TOGETHER];
        for (k, corner) in corners.iter_mut().enumerate() {
            let (face, u, v) = cube::face([x[k], y[k], z[k]]);
            let (face, u, v) = if is_cube { (face, u, v) } else { (0.0, x[k], y[k]) };
            *corner = plane.corner([u, v], [0.0; 2], face);
        }
        for k in (0..TOGETHER).filter(|k| wanted[*k]) {
            match plane.blend(corners[k]) {
                Some(sum) => sums[k] = sum,
                None => left_out[k] = true,
            }
        }
        (sums, left_out)
    }

    /// Adds four texels of a level to `mean`. Nearly all samples have four texels, none of which is beyond an edge. For
    /// other samples, adds nothing and returns `false`.
    #[inline]
    fn bilinear(
        &self,
        (place, (face, at)): (Place, (usize, [f64; 3])),
        level: u32,
        weight: f64,
        mean: &mut Mean,
    ) -> bool {
        let Some(plane) = self.plane(level) else { return false };
        let layer = match self.dimension {
            Dimension::Cube => f64::from(place.layer) * 6.0 + face as f64,
            _ => f64::from(place.layer),
        };
        let [u, v, _] = at;
        let [right, down, _] = place.offset.map(f64::from);
        let Some(sum) = plane.blend(plane.corner([u, v], [right, down], layer)) else {
            return false;
        };
        mean.sum.iter_mut().zip(sum).for_each(|(to, sum)| *to += weight * sum);
        mean.count += 4;
        true
    }

    /// The texels of a level, from which samples of four texels are computed. For a cube, the plane includes the texels
    /// beyond the edges of its faces. `None` if the texels aren't floats.
    #[inline]
    fn plane(&self, level: u32) -> Option<Plane<'_>> {
        let Texels::Float(texels) = &self.levels[level as usize] else { return None };
        let [width, height, _] = self.level_size(level);
        let is_cube = self.dimension == Dimension::Cube;
        let texels = if is_cube { &self.framed()[level as usize] } else { texels };
        let row = if is_cube { width + 2 } else { width };
        let frame = if is_cube { 1.0 } else { 0.0 };
        Some(Plane { texels, size: [width, height].map(f64::from), frame, row })
    }

    /// The levels of a cube. Each face has a border of its neighbours' texels, so the four texels of a sample are next
    /// to each other. Where three faces meet, the border has 0 in place of a texel, but no sample reads this 0.
    fn framed(&self) -> &[Vec<[f32; 4]>] {
        self.framed
            .get_or_init(|| (0..self.levels()).map(|level| self.framed_level(level)).collect())
    }

    fn framed_level(&self, level: u32) -> Vec<[f32; 4]> {
        let Texels::Float(texels) = &self.levels[level as usize] else { return Vec::new() };
        let size = self.level_size(level)[0];
        let (row, last) = (size as usize, i64::from(size));
        let faces = texels.chunks_exact(row * row);
        let mut framed = Vec::with_capacity(faces.len() * (row + 2) * (row + 2));
        for number in 0..faces.len() {
            let (cube, face) = (number / 6 * 6, number % 6);
            let beyond = |x: i64, y: i64| {
                let (face, x, y) = cube::beyond(face, x, y, size);
                texels[((cube + face) * row + y as usize) * row + x as usize]
            };
            let line = |y: i64| (0..last).map(move |x| beyond(x, y));
            framed.push([0.0; 4]);
            framed.extend(line(-1));
            framed.push([0.0; 4]);
            for y in 0..last {
                let start = (number * row + y as usize) * row;
                framed.push(beyond(-1, y));
                framed.extend_from_slice(&texels[start..start + row]);
                framed.push(beyond(last, y));
            }
            framed.push([0.0; 4]);
            framed.extend(line(last));
            framed.push([0.0; 4]);
        }
        framed
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
        // Filters can't use infinite coordinates or NaN. NaN becomes 0.
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

    /// The four texels that a gather reads, in the order of WGSL.
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

    /// Finds the texel at an index, which may be beyond an edge. At a corner of a cube, where three faces meet, the
    /// function finds three texels, each with the weight 1/3.
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

/// The texels of all layers of a level. The layers of a cube have a border: the texels beyond the edges of each face.
#[derive(Clone, Copy)]
struct Plane<'a> {
    texels: &'a [[f32; 4]],
    size: [f64; 2],
    /// The width of the border in texels: 0 or 1.
    frame: f64,
    row: u32,
}

/// The first of a sample's four texels. `first` is its index over all layers, or a negative number if one of the four
/// texels doesn't exist or has no weight. `right` and `down` say how far the sample is from the centre of the first
/// texel. All fields are floats, so that one instruction computes several corners.
#[derive(Clone, Copy, Default)]
struct Corner {
    first: f64,
    right: f64,
    down: f64,
}

impl Plane<'_> {
    #[inline(always)]
    fn corner(&self, at: [f64; 2], offset: [f64; 2], layer: f64) -> Corner {
        // Adding this number rounds numbers with a magnitude below 2^51 to integers, because an `f64` has 53 bits.
        // Larger numbers are outside of the texture.
        const ROUNDING: f64 = 1.5 * (1u64 << 52) as f64;
        let along = |at: f64, offset: f64, size: f64| {
            let centre = at * size - 0.5;
            let whole = (centre + ROUNDING) - ROUNDING;
            let whole = whole - if whole > centre { 1.0 } else { 0.0 };
            (whole + offset, centre - whole)
        };
        let ([width, height], frame) = (self.size, self.frame);
        let (left, right) = along(at[0], offset[0], width);
        let (up, down) = along(at[1], offset[1], height);
        let there = |low: f64, size: f64| (low >= -frame) & (low + 1.0 < size + frame);
        let within = |low: f64, size: f64| (low >= 0.0) & (low + 1.0 < size);
        // A frame has no corners.
        let is_there =
            there(left, width) & there(up, height) & (within(left, width) | within(up, height));
        // A texel on the right or below with the weight 0 is left out. For NaN, both comparisons are false.
        let has_four = is_there & (right > 0.0) & (down > 0.0);
        let line = layer * (height + 2.0 * frame) + up + frame;
        let first = if has_four { line * (width + 2.0 * frame) + left + frame } else { -1.0 };
        Corner { first, right, down }
    }

    /// The mean of the four texels, weighted by distance, for each channel.
    #[inline(always)]
    fn blend(&self, Corner { first, right, down }: Corner) -> Option<[f64; 4]> {
        if !(first >= 0.0) {
            return None;
        }
        let first = first as usize;
        let above = self.texels.get(first..)?.first_chunk::<2>()?;
        let below = self.texels.get(first + self.row as usize..)?.first_chunk::<2>()?;
        let (left, up) = (1.0 - right, 1.0 - down);
        let [p, q, r, s] = [left * up, right * up, left * down, right * down];
        let [a, b, c, d] =
            [above[0], above[1], below[0], below[1]].map(|texel| texel.map(f64::from));
        Some(std::array::from_fn(|k| p * a[k] + q * b[k] + r * c[k] + s * d[k]))
    }
}

pub(crate) struct Mean {
    compare: Option<(Comparison, f64)>,
    sum: [f64; 4],
    count: u32,
    /// The first texel. If it is the only texel, the mean is exactly the texel's value, even if this value is infinite.
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Computing four texels together gives the same result as computing them one by one, also at the edges and corners
    /// of cubes.
    #[test]
    fn sampling_four_texels_together_equals_sampling_each() {
        let mut state = 1u32;
        let mut random = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8) / f64::from(1u32 << 23) - 1.0
        };
        let mut together = 0;
        for size in [1_u32, 2, 3, 8] {
            let levels = (0..=size.ilog2()).map(|level| {
                let texels = 12 * (size >> level).pow(2);
                Texels::Float((0..texels).map(|_| [(); 4].map(|()| random() as f32)).collect())
            });
            let levels = levels.collect::<Vec<_>>();
            let cubes =
                Texture::new(Dimension::Cube, [size, size, 12], 1, levels).expect("it fits");
            let sampler =
                Sampler { mag: Filter::Linear, min: Filter::Linear, ..Sampler::default() };
            for _ in 0..2_000 {
                let at = [random(), random(), random()];
                let (layer, level) = (u32::from(random() > 0.0), u32::from(random() > 0.0));
                let level = level.min(cubes.levels() - 1);
                let place = Place { at, layer, offset: [0; 3] };
                let on_face = cubes.on_face(place);
                let [mut four, mut one] = [(); 2].map(|()| Mean::of(&sampler, None));
                if cubes.bilinear((place, on_face), level, 1.0, &mut four) {
                    together += 1;
                    cubes.level((&sampler, Filter::Linear), (place, on_face), level, 1.0, &mut one);
                    for (four, one) in four.sum.iter().zip(one.sum) {
                        // The four texels are added in another order.
                        assert!((four - one).abs() <= 1e-15, "{at:?}: {four} and {one} of {size}");
                    }
                }
            }
        }
        // Samples at a corner where three faces meet aren't computed together. With size 1 these are all samples, with
        // size 2 most of them.
        assert!(together > 3_000, "{together} samples");
    }
}
