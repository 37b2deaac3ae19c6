//! Inputs that a signature asks for, where no test says what they mean.

use crate::domain::Source;
use crate::fixture::{Buffer, Compare, CubeMap, Fixture, Fixtures, Sampler, Texel, Texture};
#[cfg(feature = "routes")]
use crate::reflect::Program;
use crate::reflect::{Binding, BindingKind, Dimension, Texels};

#[cfg(feature = "routes")]
use super::Data;
use super::Probed;
use crate::value::{Scalar, Shape};

/// What is special among floats, the simplest first. Larger numbers are arguments that nobody means,
/// and drivers may differ in them.
const FLOATS: [f32; 6] = [0.0, 1.0, 0.5, -1.0, 0.25, 2.0];

/// Integers are counts and indices as often as not: large ones are loops without an end.
const MOST: u64 = 16;

/// The arguments of cases, one row each: first what is special, then draws.
#[cfg(feature = "routes")]
pub(crate) fn rows(probed: &Probed, cases: usize) -> Vec<u32> {
    let shapes: Vec<&Shape> = probed.function().parameters.iter().map(|(_, s)| s).collect();
    let mut rows = Vec::new();
    for case in 0..cases as u64 {
        let mut source = Source::new(SEED, case);
        let plain = (case as usize) < FLOATS.len();
        for shape in &shapes {
            match plain {
                true => rows.extend(shape.lanes().iter().map(|s| special(*s, case as usize))),
                false => draw(shape, &mut source, &mut rows),
            }
        }
    }
    rows
}

/// The same rows for each function of one signature, on every machine.
const SEED: u64 = 0x6d61_7472_6978; // "matrix"

#[cfg(feature = "routes")]
fn special(scalar: Scalar, index: usize) -> u32 {
    match scalar {
        Scalar::F32 | Scalar::F16 => FLOATS[index].to_bits(),
        Scalar::I32 | Scalar::U32 => index as u32,
        Scalar::Bool => (index % 2) as u32,
    }
}

fn draw(shape: &Shape, source: &mut Source, rows: &mut Vec<u32>) {
    if let Some(value) = shape.quad() {
        draw(value, source, rows);
        let from = rows.len();
        (0..2).for_each(|_| draw(value, source, rows));
        // From pixel to pixel little changes: what a derivative selects, such as a level of a texture,
        // is seen on all scales.
        let scale = source.log_distance() as f32;
        let scalars = value.lanes().into_iter().cycle();
        for (word, _) in rows[from..].iter_mut().zip(scalars).filter(|(_, s)| s.is_float()) {
            *word = (f32::from_bits(*word) * scale).to_bits();
        }
        return;
    }
    match shape {
        // Directions, as often as not: many functions take nothing else.
        Shape::Vector { size, scalar: Scalar::F32 } if *size > 1 && source.below(2) == 0 => {
            let values: Vec<f64> = (0..*size).map(|_| 2.0 * source.unit() - 1.0).collect();
            let length = values.iter().map(|value| value * value).sum::<f64>().sqrt();
            let length = if length > 0.0 { length } else { 1.0 };
            #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
            rows.extend(values.iter().map(|value| ((value / length) as f32).to_bits()));
        }
        Shape::Array { element, length } => {
            (0..*length).for_each(|_| draw(element, source, rows));
        }
        Shape::Struct { members, .. } => {
            members.iter().for_each(|(_, member)| draw(member, source, rows));
        }
        other => rows.extend(other.lanes().iter().map(|scalar| lane(*scalar, source))),
    }
}

fn lane(scalar: Scalar, source: &mut Source) -> u32 {
    match scalar {
        Scalar::F32 | Scalar::F16 => {
            let value = match source.below(8) {
                0 => f64::from(FLOATS[source.below(FLOATS.len() as u64) as usize]),
                1 => source.log_distance(),
                2..6 => source.unit(),
                _ => 8.0 * source.unit() - 4.0,
            };
            #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
            let value = value as f32;
            match scalar {
                Scalar::F16 => half::f16::from_f32(value).to_f32().to_bits(),
                _ => value.to_bits(),
            }
        }
        Scalar::I32 => {
            let value = i32::try_from(source.below(MOST)).unwrap_or_default();
            (value - 4).cast_unsigned()
        }
        Scalar::U32 => u32::try_from(source.below(MOST)).unwrap_or_default(),
        Scalar::Bool => source.bits() & 1,
    }
}

/// A function that takes note of how long its made-up resources are, if there are such. Where it takes
/// derivatives its arguments have some.
pub(crate) fn fitted(probed: Probed) -> Result<Probed, super::ProbeError> {
    let mut probed = probed.with_varying();
    if let Ok(fixtures) = fixtures(&probed) {
        probed.fit(&fixtures)?;
    }
    Ok(probed)
}

/// What textures and samplers are made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Content {
    /// Equal ones, on which drivers agree.
    Plain,
    /// Those of each variable are its own, so that one that is taken for another is seen.
    Own,
}

/// Something for each resource that the function reads; or the one that there is nothing for.
pub(crate) fn fixtures(probed: &Probed) -> Result<Fixtures, String> {
    made_of(probed, Content::Plain)
}

/// [`fixtures`], where no texture is like another, and no sampler: for results of one driver.
#[cfg_attr(not(feature = "engine"), expect(dead_code, reason = "`compare` needs the engine"))]
pub(crate) fn own_fixtures(probed: &Probed) -> Result<Fixtures, String> {
    made_of(probed, Content::Own)
}

fn made_of(probed: &Probed, content: Content) -> Result<Fixtures, String> {
    let one = |binding: &Binding| {
        let fixture = fixture(probed, binding, content).ok_or_else(|| {
            format!("it reads `{}`, a {}, for which no data is made up", binding.path, binding.kind)
        })?;
        Ok((binding.path.clone(), fixture))
    };
    probed.function().bindings.iter().map(one).collect()
}

/// Data for each buffer of an entry point, the same on each column; or the resource that there is
/// none for. An array whose length the shader doesn't say has an element for each invocation.
#[cfg(feature = "routes")]
pub(crate) fn data(
    program: &Program,
    bindings: &[Binding],
    invocations: usize,
) -> Result<Vec<Data>, String> {
    // More words than a buffer may have are refused below.
    let elements = invocations.clamp(ELEMENTS, MOST_BYTES / 4 + 1);
    let one = |binding: &Binding| {
        let Binding { group, binding: number, kind, .. } = *binding;
        let mut source = source_of(binding);
        if !matches!(kind, BindingKind::Uniform | BindingKind::Storage { .. }) {
            return Err(format!(
                "it uses `{}`, a {kind}, and entry points are run with buffers alone",
                binding.path
            ));
        }
        let bytes = match program.buffer_data(binding) {
            Some((shape, endless)) => {
                let mut lanes = Vec::new();
                let count = if endless { elements } else { 1 };
                (0..count).for_each(|_| draw(&shape, &mut source, &mut lanes));
                program.bytes(binding, &lanes).map_err(|error| error.to_string())?
            }
            // Atomics, and structures that end in an array.
            None => program.zeros(binding, elements),
        };
        if bytes.len() > MOST_BYTES {
            return Err(format!(
                "it uses `{}` of {} bytes, and entry points are run with at most {MOST_BYTES} a buffer",
                binding.path,
                bytes.len()
            ));
        }
        Ok(Data { group, binding: number, kind, bytes })
    };
    bindings.iter().map(one).collect()
}

/// Invocations of an entry point, at least.
#[cfg(feature = "routes")]
pub(crate) const INVOCATIONS: u32 = 64;

/// A buffer of an entry point, at most. Mesa's GL takes minutes to compile a shader whose arrays have a
/// million elements.
#[cfg(feature = "routes")]
const MOST_BYTES: usize = 1 << 20;

/// Texels along a side, and elements of an array whose length the shader doesn't say.
const SIDE: u32 = 16;
const ELEMENTS: usize = 64;

/// Numbers for a variable, by its name: where it is bound changes nothing of what it holds.
fn source_of(binding: &Binding) -> Source {
    let hash = blake3::hash(binding.path.as_bytes());
    let stream = hash.as_bytes().iter().take(8).fold(0, |all, byte| all << 8 | u64::from(*byte));
    Source::new(SEED, stream)
}

fn fixture(probed: &Probed, binding: &Binding, content: Content) -> Option<Fixture> {
    let mut source = source_of(binding);
    let is_own = content == Content::Own;
    Some(match binding.kind {
        BindingKind::Uniform | BindingKind::Storage { .. } | BindingKind::Immediate => {
            let Some((shape, unsized_)) = probed.program.buffer_data(binding) else {
                // Atomics, and structures that end in an array.
                return Some(Buffer::of_bytes(probed.program.zeros(binding, ELEMENTS)).into());
            };
            let mut lanes = Vec::new();
            let count = if unsized_ { ELEMENTS } else { 1 };
            (0..count).for_each(|_| draw(&shape, &mut source, &mut lanes));
            Fixture::of_lanes(shape, lanes, unsized_)
        }
        BindingKind::TEXTURE_CUBE => {
            // A power of two of its own: it is told from another one, and loses no digit by it.
            let own = if is_own { (source.below(9) as f32 - 4.0).exp2() } else { 1.0 };
            CubeMap::from_fn(SIDE, |d| own * (d * 0.5 + glam::Vec3::ONE)).with_mips().into()
        }
        BindingKind::Texture(kind) => {
            let samples = if kind.multisampled { 4 } else { 1 };
            let own = is_own.then_some(&mut source);
            texture((kind.dimension, kind.arrayed), kind.texels, samples, own).into()
        }
        BindingKind::StorageTexture { dimension, arrayed, format, .. } => {
            let texels = format.texels();
            let own = is_own.then_some(&mut source);
            texture((dimension, arrayed), texels, 1, own).without_mips().into()
        }
        BindingKind::Sampler { comparison: false } if !is_own => Sampler::Linear.into(),
        BindingKind::Sampler { comparison: true } if !is_own => {
            Sampler::Linear.compare(Compare::LessEqual).into()
        }
        BindingKind::Sampler { comparison: false } => {
            // Textures are smooth: another least level is seen in the last bits, and is no jump.
            let least = source.unit() as f32;
            let sampler = Sampler::Linear.lod(least, 32.0);
            if source.below(2) == 0 { sampler.into() } else { sampler.mirror().into() }
        }
        BindingKind::Sampler { comparison: true } => {
            let ways = [Compare::LessEqual, Compare::Less, Compare::GreaterEqual, Compare::Greater];
            Sampler::Linear.compare(ways[source.below(4) as usize]).into()
        }
        BindingKind::Other => return None,
    })
}

/// Smooth texels, so that a filter's few bits of weight don't matter much. A variable's `own` ones are
/// curved, too, so that levels differ.
fn texture(
    (dimension, arrayed): (Dimension, bool),
    texels: Texels,
    samples: u32,
    own: Option<&mut Source>,
) -> Texture {
    let (own, whole) = own.map_or((0.0, 0), |source| {
        let whole = u32::try_from(source.below(MOST)).unwrap_or_default();
        (source.unit() as f32, whole)
    });
    let wave = |x: u32, y: u32, z: u32| {
        let [x, y, z] = [x, y, z].map(|n| n as f32 / SIDE as f32);
        let (x, y) = (x + 0.25 * own * x * x, y - 0.25 * own * y * y);
        glam::Vec4::new(x + own, y, 0.5 * (x + y) + 0.25 * z, 1.0)
    };
    match texels {
        Texels::Float => {
            let texture = made(dimension, arrayed, samples, wave);
            // Neither textures of one dimension nor those with several samples have more levels.
            if samples > 1 || dimension == Dimension::D1 { texture } else { texture.with_mips() }
        }
        Texels::Depth => made(dimension, arrayed, samples, |x, y, z| {
            0.5 * own + 0.5 * (x + y + z) as f32 / (3 * SIDE) as f32
        }),
        Texels::Sint => {
            made(dimension, arrayed, samples, |x, y, z| (x + y + z + whole).cast_signed() - 4)
        }
        Texels::Uint => made(dimension, arrayed, samples, |x, y, z| x + y + z + whole),
    }
}

/// A texture whose values are made of columns, rows, and slices, layers or samples.
fn made<T: Texel>(
    dimension: Dimension,
    arrayed: bool,
    samples: u32,
    value: impl Fn(u32, u32, u32) -> T,
) -> Texture {
    let layer = |z: u32| Texture::from_fn(SIDE, SIDE, |x, y| value(x, y, z));
    match (dimension, arrayed) {
        (Dimension::D1, _) => Texture::line(SIDE, |x| value(x, 0, 0)),
        (Dimension::D2, false) if samples > 1 => Texture::multisampled(SIDE, SIDE, samples, value),
        (Dimension::D2, false) => layer(0),
        (Dimension::D2, true) => Texture::array((0..4).map(layer)),
        (Dimension::D3, _) => Texture::volume([SIDE, SIDE, 4], value),
        (Dimension::Cube, false) => Texture::cube((0..6).map(layer)),
        (Dimension::Cube, true) => Texture::cubes((0..12).map(layer)),
    }
}

#[cfg(all(test, feature = "routes"))]
mod tests {
    use super::*;

    #[test]
    fn what_is_differentiated_varies() {
        let text = "fn f(a: f32, k: u32, v: vec2f) -> f32 { return dpdx(a) + dpdy(v.x) + f32(k); }";
        let probed = Probed::new(&crate::Package::from_source("p", text), "f").and_then(fitted);
        let rows = rows(&probed.expect("it is called"), 64);
        // a, its dx and dy; k; v, its dx and dy
        let cases = || rows.chunks_exact(3 + 1 + 6).skip(FLOATS.len());
        for slope in [1, 2, 6, 8] {
            let varying = cases().filter(|row| f32::from_bits(row[slope]) != 0.0).count();
            assert!(2 * varying > cases().count(), "{varying} cases have slope {slope}");
        }
    }
}
