//! Binds fixtures in the engine.

use karat_engine as engine;

use crate::fixture::{Address, Compare, Filter, Fixture, FixtureError, Level, Sampler, View};
use crate::path::{Path, PathError};
use crate::probe::ProbeError;
use crate::reflect::{Binding, BindingKind, Dimension, Program, Texels};

/// Puts a fixture into the engine's resources, in the form that the variable's kind needs.
pub(super) fn supply(
    resources: &mut engine::Resources,
    program: &Program,
    binding: &Binding,
    fixture: &Fixture,
) -> Result<(), ProbeError> {
    let (group, number) = (binding.group, binding.binding);
    if let Some(bytes) = fixture.bytes(program, binding) {
        resources.set_buffer(group, number, bytes?);
        if matches!(fixture, Fixture::Buffer(buffer) if buffer.blank) {
            resources.set_blank(group, number);
        }
    } else if let Some(view) = fixture.view() {
        let texture = texture(binding, &view).map_err(|message| {
            let variable = &binding.path;
            let message =
                format!("Karat's engine can't use the texture of variable `{variable}`: {message}");
            PathError::Route { path: Path::CPU, message }
        })?;
        resources.set_texture(group, number, texture);
    } else if let Fixture::Sampler(given) = fixture {
        if given.anisotropy > 1 {
            let reason =
                "Karat's engine can't filter with anisotropy: run the check only on drivers"
                    .to_owned();
            return Err(FixtureError::Unusable { variable: binding.path.clone(), reason }.into());
        }
        resources.set_sampler(group, number, sampler(given));
    }
    Ok(())
}

fn sampler(given: &Sampler) -> engine::Sampler {
    let address = |address| match address {
        Address::Clamp => engine::Address::ClampToEdge,
        Address::Repeat => engine::Address::Repeat,
        Address::Mirror => engine::Address::MirrorRepeat,
    };
    let filter = |filter| match filter {
        Filter::Nearest => engine::Filter::Nearest,
        Filter::Linear => engine::Filter::Linear,
    };
    let compare = |compare| match compare {
        Compare::Never => engine::Comparison::Never,
        Compare::Less => engine::Comparison::Less,
        Compare::Equal => engine::Comparison::Equal,
        Compare::LessEqual => engine::Comparison::LessEqual,
        Compare::Greater => engine::Comparison::Greater,
        Compare::NotEqual => engine::Comparison::NotEqual,
        Compare::GreaterEqual => engine::Comparison::GreaterEqual,
        Compare::Always => engine::Comparison::Always,
    };
    engine::Sampler {
        address: given.address.map(address),
        mag: filter(given.mag),
        min: filter(given.min),
        mip: filter(given.mip),
        lod_min: given.lod.0,
        lod_max: given.lod.1,
        compare: given.compare.map(compare),
    }
}

fn texture(binding: &Binding, view: &View<'_>) -> Result<engine::Texture, String> {
    let first = view.levels.first().ok_or("the texture has no mip level")?;
    let depth = matches!(binding.kind, BindingKind::Texture(kind) if kind.texels == Texels::Depth);
    let format = match binding.kind {
        BindingKind::StorageTexture { format, .. } => Some(format.name()),
        _ => None,
    };
    let texels = |level: &Level| {
        let words = level.words.iter().copied();
        Ok(match view.texels {
            _ if depth => engine::Texels::Depth(words.map(|w| f32::from_bits(w[0])).collect()),
            Texels::Float | Texels::Depth => {
                engine::Texels::Float(words.map(|w| w.map(f32::from_bits)).collect())
            }
            Texels::Sint => engine::Texels::Sint(words.map(|w| w.map(u32::cast_signed)).collect()),
            Texels::Uint => engine::Texels::Uint(words.collect()),
        })
    };
    let levels = view.levels.iter().map(|level| {
        let Some(format) = &format else { return texels(level) };
        let codec = crate::probe::Codec::named(format)
            .ok_or_else(|| format!("Karat can't write texels of the format {format}"))?;
        let kept = |words: &[u32; 4]| {
            let mut bytes = Vec::new();
            codec.encode(*words, &mut bytes);
            codec.decode(&bytes)
        };
        texels(&Level { words: level.words.iter().map(kept).collect(), ..level.clone() })
    });
    let levels = levels.collect::<Result<Vec<_>, String>>()?;
    let dimension = match view.dimension {
        Dimension::D1 => engine::Dimension::D1,
        Dimension::D2 => engine::Dimension::D2,
        Dimension::D3 => engine::Dimension::D3,
        Dimension::Cube => engine::Dimension::Cube,
    };
    let size = [first.width, first.height, first.depth * view.layers];
    let texture = engine::Texture::new(dimension, size, view.samples, levels)
        .map_err(|error| error.to_string())?;
    let normalized = format.is_some_and(|name| name.ends_with("norm"));
    Ok(if normalized { texture.normalized() } else { texture })
}

/// The contents of a resource as `u32` words. A texel of a texture has four words.
pub(super) fn after(resources: &engine::Resources, binding: &Binding) -> Vec<u32> {
    let (group, number) = (binding.group, binding.binding);
    if let BindingKind::StorageTexture { .. } = binding.kind {
        let texture = resources.texture(group, number);
        return texture.and_then(|t| t.texels().first()).map_or_else(Vec::new, words);
    }
    bytemuck::pod_collect_to_vec(resources.buffer(group, number).expect("each binding is bound"))
}

pub(super) fn words(texels: &engine::Texels) -> Vec<u32> {
    match texels {
        engine::Texels::Float(texels) => texels.iter().flatten().map(|x| x.to_bits()).collect(),
        engine::Texels::Sint(texels) => {
            texels.iter().flatten().map(|x| x.cast_unsigned()).collect()
        }
        engine::Texels::Uint(texels) => texels.iter().flatten().copied().collect(),
        engine::Texels::Depth(texels) => texels.iter().map(|x| x.to_bits()).collect(),
    }
}
