//! What a declared test or a command binds: images, samplers, and values of buffers.
//!
//! | for | is |
//! |---|---|
//! | a 2D texture | `"image.exr"` or `"image.png"`; or the value of each texel: a number, or `[r, g, b, a]` |
//! | an array, a volume, a cube of depths | a list of as many images (layers, slices, faces), or the value of each texel |
//! | a cube map | `"equirectangular.exr"`, or a colour `[r, g, b]` |
//! | a sampler | `"linear"` or `"nearest"`, then `repeat` or `mirror`; of one that compares `"linear less_equal"` |
//! | a buffer | its value: numbers, lists, tables of members; for an array without a length, a list |
//!
//! Texels of depth and integer textures are the red channel of an image.

use std::path::Path;

use karat::fixture::{Compare, Fixture};
use karat::reflect::{Binding, BindingKind, Dimension, Program, Texels, TextureKind};
use karat::{CubeMap, Image, Sampler, Storage, Texture, Uniform};
use toml::Value;

use crate::domains::lanes;

/// Texels along an edge of a face of a cube map that is made of an image.
const FACE: u32 = 64;

/// Layers of an array, and slices of a volume, whose texels are all of one value.
const LAYERS: usize = 1;

/// The samples of a texel of a multisampled texture, which are all the same.
const SAMPLES: u32 = 4;

/// The fixture of a variable. Files are in the folder.
///
/// # Errors
/// If the value isn't one of the variable's kind, or a file can't be read.
pub fn fixture(
    program: &Program,
    binding: &Binding,
    value: &Value,
    folder: &Path,
) -> Result<Fixture, String> {
    let name = binding.name();
    let wrong = |reason: String| format!("with `{name}`: {reason}");
    let made = match binding.kind {
        BindingKind::Sampler { comparison } => sampler(value, comparison).map(Fixture::from),
        BindingKind::TEXTURE_CUBE => cube(value, folder).map(Fixture::from),
        BindingKind::Texture(kind) => texture(kind, value, folder).map(Fixture::from),
        BindingKind::StorageTexture { dimension, arrayed, format, .. } => {
            let (texels, multisampled) = (format.texels(), false);
            let kind = TextureKind { dimension, arrayed, texels, multisampled };
            texture(kind, value, folder).map(Fixture::from)
        }
        BindingKind::Uniform | BindingKind::Storage { .. } | BindingKind::Immediate => {
            buffer(program, binding, value)
        }
        BindingKind::Other => Err(format!("it is a {}", binding.kind)),
    };
    made.map_err(wrong)
}

fn sampler(value: &Value, comparison: bool) -> Result<Sampler, String> {
    let example = if comparison { "\"linear less_equal\"" } else { "\"linear repeat\"" };
    let wrong = |what: &str| {
        format!(
            "{what}; a sampler is \"linear\" or \"nearest\", then \"repeat\" or \"mirror\"{}: {example}",
            if comparison { ", then how it compares" } else { "" }
        )
    };
    let text = value.as_str().ok_or_else(|| wrong(&format!("{value} is no sampler")))?;
    let mut words = text.split_whitespace();
    let mut sampler = match words.next() {
        Some("linear") => Sampler::Linear,
        Some("nearest") => Sampler::Nearest,
        _ => return Err(wrong(&format!("\"{text}\" is no sampler"))),
    };
    let mut compares = false;
    for word in words {
        let compare = match word {
            "clamp" => continue,
            "repeat" => {
                sampler = sampler.repeat();
                continue;
            }
            "mirror" => {
                sampler = sampler.mirror();
                continue;
            }
            "never" => Compare::Never,
            "less" => Compare::Less,
            "equal" => Compare::Equal,
            "less_equal" => Compare::LessEqual,
            "greater" => Compare::Greater,
            "not_equal" => Compare::NotEqual,
            "greater_equal" => Compare::GreaterEqual,
            "always" => Compare::Always,
            other => return Err(wrong(&format!("`{other}` is nothing of a sampler"))),
        };
        compares = true;
        sampler = sampler.compare(compare);
    }
    match (compares, comparison) {
        (false, true) => Err(wrong("it compares depths, and the sampler doesn't say how")),
        (true, false) => Err(wrong("it compares nothing, and the sampler says how")),
        _ => Ok(sampler),
    }
}

fn image(file: &str, folder: &Path) -> Result<Image, String> {
    Image::read(&folder.join(file)).map_err(|error| error.to_string())
}

/// Numbers of a list.
fn numbers(list: &[Value]) -> Option<Vec<f32>> {
    let number = |value: &Value| match value {
        #[expect(clippy::cast_possible_truncation, reason = "texels are f32")]
        Value::Float(number) => Some(*number as f32),
        #[expect(clippy::cast_precision_loss, reason = "as a literal of WGSL would")]
        Value::Integer(number) => Some(*number as f32),
        _ => None,
    };
    list.iter().map(number).collect()
}

fn cube(value: &Value, folder: &Path) -> Result<CubeMap, String> {
    match value {
        Value::String(file) => {
            let map = CubeMap::from_image(&image(file, folder)?, FACE);
            map.map_err(|error| error.to_string())
        }
        Value::Array(list) => match numbers(list).as_deref() {
            Some([r, g, b]) => Ok(CubeMap::constant([*r, *g, *b].into())),
            _ => Err("a colour is a list of 3 numbers".to_owned()),
        },
        _ => Err("a cube map is the name of an image, or a colour".to_owned()),
    }
}

fn texture(kind: TextureKind, value: &Value, folder: &Path) -> Result<Texture, String> {
    let is_2d = kind.dimension == Dimension::D2 && !kind.arrayed;
    let files = match value {
        Value::String(file) if is_2d || kind.dimension == Dimension::D1 => vec![file.as_str()],
        Value::Array(list) if !list.is_empty() && list.iter().all(Value::is_str) => {
            list.iter().filter_map(Value::as_str).collect()
        }
        _ => Vec::new(),
    };
    if files.is_empty() {
        let all = match value {
            Value::Array(list) => numbers(list),
            one => numbers(std::slice::from_ref(one)),
        };
        let texel = match all.as_deref() {
            Some([x]) => [*x, *x, *x, 1.0],
            Some([r, g, b, a]) => [*r, *g, *b, *a],
            _ => {
                return Err(match is_2d {
                    true => {
                        "a texture is the name of an image, a number, or a colour: a list of 4 \
                             numbers"
                            .to_owned()
                    }
                    false => {
                        format!("a {kind} is a list of images, a number, or a list of 4 numbers")
                    }
                });
            }
        };
        let layers = match (kind.dimension, kind.arrayed) {
            (Dimension::Cube, _) => 6,
            _ => LAYERS,
        };
        let constant = Image::new(1, 1, vec![texel]);
        return of_images(kind, &vec![constant; layers]);
    }
    let images = files.iter().map(|file| image(file, folder)).collect::<Result<Vec<_>, _>>()?;
    of_images(kind, &images)
}

/// A texture whose layers, slices or faces are images.
fn of_images(kind: TextureKind, images: &[Image]) -> Result<Texture, String> {
    let first = images.first().ok_or("a texture without an image")?;
    let (width, height) = (first.width(), first.height());
    if images.iter().any(|image| (image.width(), image.height()) != (width, height)) {
        return Err("its images are of one size".to_owned());
    }
    let at = |layer: usize, x: u32, y: u32| images[layer].pixels()[(y * width + x) as usize];
    let whole = |x: f32| {
        let fits = x.fract() == 0.0 && x.abs() < 16_777_216.0;
        fits.then_some(x).ok_or_else(|| format!("a texel is {x}, and its texels are integers"))
    };
    if matches!(kind.texels, Texels::Sint | Texels::Uint) {
        for image in images {
            image.pixels().iter().try_for_each(|texel| {
                whole(texel[0])?;
                match kind.texels {
                    Texels::Uint if texel[0] < 0.0 => {
                        Err(format!("a texel is {}, and its texels are u32", texel[0]))
                    }
                    _ => Ok(()),
                }
            })?;
        }
    }
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "they are whole and in range"
    )]
    match kind.texels {
        Texels::Float => shaped(kind, images.len(), width, height, at),
        Texels::Depth => shaped(kind, images.len(), width, height, |l, x, y| at(l, x, y)[0]),
        Texels::Sint => shaped(kind, images.len(), width, height, |l, x, y| at(l, x, y)[0] as i32),
        Texels::Uint => shaped(kind, images.len(), width, height, |l, x, y| at(l, x, y)[0] as u32),
    }
}

/// A texture of a kind, by a value for each layer, column and row.
fn shaped<T: karat::fixture::Texel>(
    kind: TextureKind,
    layers: usize,
    width: u32,
    height: u32,
    value: impl Fn(usize, u32, u32) -> T,
) -> Result<Texture, String> {
    let layer = |layer: usize| Texture::from_fn(width, height, |x, y| value(layer, x, y));
    let expect = |count: usize, what: &str| match layers {
        found if found == count => Ok(()),
        found => Err(format!("{what}, not of {found}")),
    };
    let square = || match width == height {
        true => Ok(()),
        false => Err("a face is a square".to_owned()),
    };
    Ok(match (kind.dimension, kind.arrayed) {
        (Dimension::D1, _) => {
            expect(1, "a 1D texture is of one image")?;
            if height != 1 {
                return Err("a 1D texture is an image of one row".to_owned());
            }
            Texture::line(width, |x| value(0, x, 0))
        }
        (Dimension::D2, false) => {
            expect(1, "a 2D texture is of one image")?;
            match kind.multisampled {
                true => Texture::multisampled(width, height, SAMPLES, |x, y, _| value(0, x, y)),
                false => layer(0),
            }
        }
        (Dimension::D2, true) => Texture::array((0..layers).map(layer)),
        (Dimension::D3, _) => {
            let depth = u32::try_from(layers).map_err(|error| error.to_string())?;
            Texture::volume([width, height, depth], |x, y, z| value(z as usize, x, y))
        }
        (Dimension::Cube, false) => {
            expect(6, "a cube is of six images")?;
            square()?;
            Texture::cube((0..6).map(layer))
        }
        (Dimension::Cube, true) => {
            if !layers.is_multiple_of(6) {
                return Err(format!("cubes are of six images each, not of {layers}"));
            }
            square()?;
            Texture::cubes((0..layers).map(layer))
        }
    })
}

fn buffer(program: &Program, binding: &Binding, value: &Value) -> Result<Fixture, String> {
    let Some((shape, elements)) = program.buffer_data(binding) else {
        return Err(
            "its type has atomics, or is a structure that ends in an array: this can't be \
                    bound by values yet"
                .to_owned(),
        );
    };
    if !elements {
        return Ok(Uniform::of_lanes(shape.clone(), lanes(&shape, value)?).into());
    }
    let Value::Array(list) = value else {
        return Err("an array without a length is a list".to_owned());
    };
    let all = list.iter().map(|value| lanes(&shape, value)).collect::<Result<Vec<_>, _>>()?;
    Ok(Storage::of_lanes(shape, all.concat()).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use karat::Package;
    use karat::probe::Probed;

    fn bound(declared: &str, value: &str) -> Result<(), String> {
        let text = format!(
            "@group(0) @binding(0) var v: {declared};\n\
             @group(0) @binding(1) var t: texture_2d<f32>;\n\
             @group(0) @binding(2) var d: texture_depth_2d;\n\
             fn f(x: f32) -> f32 {{ {} return x; }}",
            match declared {
                "sampler" => "_ = textureSampleLevel(t, v, vec2f(), 0.0);",
                "sampler_comparison" => "_ = textureSampleCompareLevel(d, v, vec2f(), 0.0);",
                kind if kind.contains("cube") => "_ = textureNumLevels(v);",
                _ => "_ = textureDimensions(v);",
            }
        );
        let package = Package::from_source("bound", text);
        let probed = Probed::new(&package, "f").map_err(|error| error.to_string())?;
        let bindings = &probed.function().bindings;
        let binding = bindings.iter().find(|b| b.name() == "v").ok_or("it isn't read")?;
        let table: toml::Table = format!("v = {value}").parse().map_err(|e| format!("{e}"))?;
        fixture(probed.program(), binding, &table["v"], Path::new("")).map(|_| ())
    }

    #[test]
    fn each_kind_has_its_values() {
        for (declared, value) in [
            ("sampler", "\"linear repeat\""),
            ("sampler", "\"nearest mirror\""),
            ("sampler_comparison", "\"linear less_equal\""),
            ("texture_2d<f32>", "[0, 0.5, 1, 1]"),
            ("texture_2d<u32>", "3"),
            ("texture_2d<i32>", "-3"),
            ("texture_depth_2d", "0.5"),
            ("texture_2d_array<f32>", "1"),
            ("texture_3d<f32>", "0.25"),
            ("texture_cube<f32>", "[1, 1, 1]"),
            ("texture_depth_cube", "0.5"),
        ] {
            bound(declared, value).unwrap_or_else(|error| panic!("{declared}: {error}"));
        }
        for (declared, value, part) in [
            ("sampler", "\"linaer\"", "is no sampler"),
            ("sampler", "\"linear repaet\"", "`repaet` is nothing of a sampler"),
            ("sampler", "\"linear less\"", "compares nothing"),
            ("sampler_comparison", "\"linear\"", "doesn't say how"),
            ("texture_2d<u32>", "0.5", "its texels are integers"),
            ("texture_2d<u32>", "-1", "its texels are u32"),
            ("texture_2d<f32>", "\"missing.exr\"", "missing.exr"),
            ("texture_3d<f32>", "[1, 2]", "a list of images"),
        ] {
            let error = bound(declared, value).expect_err(declared);
            assert!(error.contains(part), "{declared}: {error}");
        }
    }
}
