//! Textures and samplers as data, with WebGPU's filters.

mod cube;
mod format;
mod sample;

use std::sync::OnceLock;

use thiserror::Error;

pub(crate) use format::stored;
pub(crate) use sample::{Level, Many, Mean, Place, TOGETHER};

/// The coordinates that select a texel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// One coordinate.
    D1,
    /// Two coordinates, and a layer.
    D2,
    /// Three coordinates.
    D3,
    /// A direction, and a layer. Faces are layers in the order +X, -X, +Y, -Y, +Z, -Z.
    Cube,
}

/// The texels of one mip level. The rows of a slice or layer are in order, and then the next slice or layer follows.
/// The samples of a texel are next to each other.
#[derive(Clone, Debug, PartialEq)]
pub enum Texels {
    /// Four channels of `f32`. If the format has fewer channels, the missing ones are read as 0, 0, 0, 1.
    Float(Vec<[f32; 4]>),
    /// Four channels of `i32`.
    Sint(Vec<[i32; 4]>),
    /// Four channels of `u32`.
    Uint(Vec<[u32; 4]>),
    /// Depths.
    Depth(Vec<f32>),
}

impl Texels {
    fn len(&self) -> usize {
        match self {
            Self::Float(texels) => texels.len(),
            Self::Sint(texels) => texels.len(),
            Self::Uint(texels) => texels.len(),
            Self::Depth(texels) => texels.len(),
        }
    }
}

/// The reason why texels can't form a texture.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum TextureError {
    /// A mip level has too few or too many texels.
    #[error("level {level} has {found} texels, but its size needs {needed}")]
    Level {
        /// The index of the level.
        level: usize,
        /// The number of texels that the level has.
        found: usize,
        /// The number of texels that the level needs for its size.
        needed: u64,
    },
    /// A size is zero, there is no level, the faces of a cube aren't square, or their number isn't six.
    #[error("{0}")]
    Shape(&'static str),
}

/// A texture.
#[derive(Clone, Debug)]
pub struct Texture {
    dimension: Dimension,
    size: [u32; 3],
    samples: u32,
    levels: Vec<Texels>,
    /// The levels of a cube of floats, in which each face has a border: the texels beyond its edges. This field is
    /// computed when the cube is first filtered.
    framed: OnceLock<Vec<Vec<[f32; 4]>>>,
    /// The least and the greatest value of each channel.
    hull: [(f32, f32); 4],
    /// `true` if the format is normalised, such as `rgba8unorm` or `rgba8snorm`.
    normalized: bool,
}

impl Texture {
    /// Makes a texture of `size` texels: width, height, and depth or layers. A cube has six layers. `levels` has the
    /// texels of each mip level, the largest level first. `samples` is 1 unless the texture is multisampled.
    ///
    /// # Errors
    ///
    /// Returns an error if sizes and texels don't match.
    pub fn new(
        dimension: Dimension,
        size: [u32; 3],
        samples: u32,
        levels: Vec<Texels>,
    ) -> Result<Self, TextureError> {
        if size.contains(&0) || samples == 0 || levels.is_empty() {
            return Err(TextureError::Shape("the texture has no texels"));
        }
        if dimension == Dimension::Cube && (size[0] != size[1] || !size[2].is_multiple_of(6)) {
            return Err(TextureError::Shape("each layer of a cube needs six square faces"));
        }
        if samples > 1 && levels.len() > 1 {
            return Err(TextureError::Shape("a multisampled texture can have only one level"));
        }
        if levels.len() > 32 {
            return Err(TextureError::Shape("the texture has more than 32 levels"));
        }
        let hull = [(0.0, 0.0); 4];
        let framed = OnceLock::new();
        let mut texture =
            Self { dimension, size, samples, levels, framed, hull, normalized: false };
        for (level, texels) in texture.levels.iter().enumerate() {
            let [w, h, d] = texture.level_size(level as u32).map(u64::from);
            let needed = w
                .checked_mul(h)
                .and_then(|n| n.checked_mul(d))
                .and_then(|n| n.checked_mul(u64::from(samples)))
                .ok_or(TextureError::Shape("the texture has more than 2^64 texels"))?;
            if texels.len() as u64 != needed {
                return Err(TextureError::Level { level, found: texels.len(), needed });
            }
        }
        texture.hull = std::array::from_fn(|channel| texture.hull_of(channel));
        Ok(texture)
    }

    /// Declares that the texture's format is normalised, such as `rgba8unorm`. WGSL defines the float for a byte `v` as
    /// `v / 255` (6.5.1), but doesn't say how exact the float is. Karat uses the bounds of `unpack4x8unorm`, which
    /// computes the same quotient.
    #[must_use]
    pub fn normalized(self) -> Self {
        Self { normalized: true, ..self }
    }

    pub(crate) fn channel<A: crate::arithmetic::sealed::Rules>(&self, word: u32) -> A::Float {
        let x = f32::from_bits(word);
        if self.normalized { A::normalized(x) } else { A::float(x) }
    }

    fn hull_of(&self, channel: usize) -> (f32, f32) {
        let mut hull = (f32::INFINITY, f32::NEG_INFINITY);
        let mut add = |x: f32| {
            // A NaN makes the channel unbounded.
            hull = if x.is_nan() { (f32::NAN, f32::NAN) } else { (hull.0.min(x), hull.1.max(x)) };
        };
        for texels in &self.levels {
            match texels {
                Texels::Float(texels) => texels.iter().for_each(|texel| add(texel[channel])),
                Texels::Depth(texels) => texels.iter().copied().for_each(&mut add),
                Texels::Sint(_) | Texels::Uint(_) => {}
            }
        }
        hull
    }

    pub(crate) fn is(&self, (dimension, kind): (naga::ImageDimension, naga::ScalarKind)) -> bool {
        let dimension = match dimension {
            naga::ImageDimension::D1 => Dimension::D1,
            naga::ImageDimension::D2 => Dimension::D2,
            naga::ImageDimension::D3 => Dimension::D3,
            naga::ImageDimension::Cube => Dimension::Cube,
        };
        let fits = |texels: &Texels| match texels {
            Texels::Float(_) | Texels::Depth(_) => kind == naga::ScalarKind::Float,
            Texels::Sint(_) => kind == naga::ScalarKind::Sint,
            Texels::Uint(_) => kind == naga::ScalarKind::Uint,
        };
        self.dimension == dimension && self.levels.iter().all(fits)
    }

    pub(crate) fn hull(&self, channel: usize) -> (f32, f32) {
        self.hull[channel]
    }

    /// The coordinates that select a texel.
    #[must_use]
    pub fn dimension(&self) -> Dimension {
        self.dimension
    }

    /// The width, the height, and the depth or layers of the largest level.
    #[must_use]
    pub fn size(&self) -> [u32; 3] {
        self.size
    }

    /// The number of mip levels.
    #[must_use]
    pub fn levels(&self) -> u32 {
        self.levels.len() as u32
    }

    /// The number of samples of a texel.
    #[must_use]
    pub fn samples(&self) -> u32 {
        self.samples
    }

    /// The size of a level. All levels have the same number of layers.
    #[must_use]
    pub fn level_size(&self, level: u32) -> [u32; 3] {
        let level = level.min(31);
        let [w, h, d] = self.size;
        let shrunk = |n: u32| (n >> level).max(1);
        match self.dimension {
            Dimension::D1 => [shrunk(w), 1, 1],
            Dimension::D2 | Dimension::Cube => [shrunk(w), shrunk(h), d],
            Dimension::D3 => [shrunk(w), shrunk(h), shrunk(d)],
        }
    }

    #[inline(always)]
    fn index(&self, level: u32, at: [u32; 3], sample: u32) -> usize {
        let [w, h, _] = self.level_size(level).map(|n| n as usize);
        let [x, y, z] = at.map(|n| n as usize);
        ((z * h + y) * w + x) * self.samples as usize + sample as usize
    }

    #[inline(always)]
    pub(crate) fn texel(&self, level: u32, at: [u32; 3], sample: u32) -> [u32; 4] {
        let index = self.index(level, at, sample);
        match self.levels.get(level as usize) {
            Some(Texels::Float(texels)) => texels[index].map(f32::to_bits),
            Some(Texels::Sint(texels)) => texels[index].map(i32::cast_unsigned),
            Some(Texels::Uint(texels)) => texels[index],
            Some(Texels::Depth(texels)) => [texels[index].to_bits(), 0, 0, 1f32.to_bits()],
            None => [0; 4],
        }
    }

    pub(crate) fn put(&mut self, at: [u32; 3], words: [u32; 4]) {
        let index = self.index(0, at, 0);
        match self.levels.first_mut() {
            Some(Texels::Float(texels)) => texels[index] = words.map(f32::from_bits),
            Some(Texels::Sint(texels)) => texels[index] = words.map(u32::cast_signed),
            Some(Texels::Uint(texels)) => texels[index] = words,
            Some(Texels::Depth(_)) | None => {}
        }
    }

    /// The texels, level by level.
    #[must_use]
    pub fn texels(&self) -> &[Texels] {
        &self.levels
    }
}

/// The texel that is read if the coordinates are outside of the texture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Address {
    /// The nearest texel at the edge.
    #[default]
    ClampToEdge,
    /// The texture is repeated.
    Repeat,
    /// The texture is repeated, and every second copy is mirrored.
    MirrorRepeat,
}

/// The texels that a filter reads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    /// The nearest texel.
    #[default]
    Nearest,
    /// The texels around the coordinates, weighted by distance.
    Linear,
}

/// The comparison of a depth reference with a texel's depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Comparison {
    /// The comparison is never true.
    Never,
    /// The comparison is `reference < depth`.
    Less,
    /// The comparison is `reference == depth`.
    Equal,
    /// The comparison is `reference <= depth`.
    LessEqual,
    /// The comparison is `reference > depth`.
    Greater,
    /// The comparison is `reference != depth`.
    NotEqual,
    /// The comparison is `reference >= depth`.
    GreaterEqual,
    /// The comparison is always true.
    Always,
}

impl Comparison {
    pub(crate) fn holds(self, reference: f64, depth: f64) -> bool {
        match self {
            Self::Never => false,
            Self::Less => reference < depth,
            Self::Equal => reference == depth,
            Self::LessEqual => reference <= depth,
            Self::Greater => reference > depth,
            Self::NotEqual => reference != depth,
            Self::GreaterEqual => reference >= depth,
            Self::Always => true,
        }
    }
}

/// A sampler. All fields have WebGPU's defaults unless you change them.
#[derive(Clone, Debug, PartialEq)]
pub struct Sampler {
    /// The address mode of each coordinate.
    pub address: [Address; 3],
    /// The filter for pixels that are smaller than a texel.
    pub mag: Filter,
    /// The filter for pixels that are larger than a texel.
    pub min: Filter,
    /// The filter between mip levels.
    pub mip: Filter,
    /// The least level of detail.
    pub lod_min: f32,
    /// The greatest level of detail.
    pub lod_max: f32,
    /// The comparison, if this is a comparison sampler.
    pub compare: Option<Comparison>,
}

impl Default for Sampler {
    fn default() -> Self {
        Self {
            address: [Address::ClampToEdge; 3],
            mag: Filter::Nearest,
            min: Filter::Nearest,
            mip: Filter::Nearest,
            lod_min: 0.0,
            lod_max: 32.0, // WebGPU's default, which is above all possible levels
            compare: None,
        }
    }
}
