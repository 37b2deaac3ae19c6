//! The fixtures that a declared test or a command binds: textures, samplers and buffers.
//!
//! | variable | value |
//! |---|---|
//! | a 2D texture | `"image.exr"` or `"image.png"`; the value of all texels: a number, `[r, g, b]` or `[r, g, b, a]`; or `{ size = [50, 5] }`, whose texels are zeros, copies of a `value`, or samples from a `range` with a `seed` |
//! | a texture array, a 3D texture, a cube map | a list of images or colours for its layers, slices or faces; or the value of all texels |
//! | a cube map of floats | a value from the line above, or one image, `"equirectangular.exr"` |
//! | a sampler | `"linear"` or `"nearest"`, then `clamp`, `repeat` or `mirror`; for a comparison sampler `"linear less_equal"` |
//! | a runtime-sized array | `{ size = 256 }`, whose elements are zeros; `{ size = 256, value = 0 }`, for a buffer that the host clears before the passes; `{ size = 256, range = "0..1", seed = 7 }`, sampled like arguments |
//! | a buffer | a number, a list, or a table of members, the last of which may be a list of any length; or `"values.json"`, `"values.toml"`, `"bytes.bin"` |
//!
//! In a real program, a buffer that has only a `size` can contain old data. The last line that `karat test` prints has
//! the number of checks in which a pass reads such a buffer before any pass writes it.
//!
//! A depth texture takes its texels from the red channel of an image. A PNG has colours in sRGB. Karat converts them to
//! linear colours, as textures with an sRGB format do; `"normals.png linear"` prevents that. Depths and integers are
//! never converted. A texture with one value for all texels has 16 x 16 texels. A texture from an image has the image's
//! size.

use std::path::Path;

use glam::{IVec4, UVec4};
use karat::fixture::{Buffer, Compare, Fixture};
use karat::unstable::diagnostic::read_file;
use karat::unstable::domain::{Dynamic, Numbering, Stream};
use karat::unstable::reflect::{Binding, BindingKind, Dimension, Program, Texels, TextureKind};
use karat::unstable::value::{Scalar, Shape};
use karat::{CubeMap, Image, Sampler, Texture};
use karat_inspect::made_up::Ranges;
use toml::Value;

use crate::domains::{is_number, lanes, no_such, parts};

/// The width of a cube map's face in texels, if the cube map is made from an equirectangular image.
const FACE: u32 = 64;

/// The width and height of a texture with equal texels.
const SIDE: u32 = 16;

/// The number of samples in each texel of a multisampled texture. All samples are equal.
const SAMPLES: u32 = 4;

/// Makes the fixture that a test or a command binds to a variable. Files are relative to `folder`.
///
/// # Errors
/// Returns an error if the value doesn't fit the variable's type, or a file can't be read.
pub fn fixture(
    program: &Program,
    binding: &Binding,
    value: &Value,
    folder: &Path,
) -> Result<Fixture, String> {
    let name = binding.name();
    let wrong = |reason: String| format!("`{name}`: {reason}");
    let made = match binding.kind {
        BindingKind::Sampler { comparison } => sampler(value, comparison).map(Fixture::from),
        BindingKind::Texture(kind) => texture(name, kind, value, folder),
        BindingKind::StorageTexture { dimension, arrayed, format, .. } => {
            let (texels, multisampled) = (format.texels(), false);
            let kind = TextureKind { dimension, arrayed, texels, multisampled };
            texture(name, kind, value, folder)
        }
        BindingKind::Uniform | BindingKind::Storage { .. } | BindingKind::Immediate => {
            buffer(program, binding, value, folder)
        }
        BindingKind::Other => Err(format!("Karat can't bind a {}", binding.kind)),
    };
    made.map_err(wrong)
}

fn sampler(value: &Value, comparison: bool) -> Result<Sampler, String> {
    let example = if comparison { "\"linear less_equal\"" } else { "\"linear repeat\"" };
    let wrong = |what: &str| {
        format!(
            "{what}; write a sampler as \"linear\" or \"nearest\", then \"clamp\" (the default), \"repeat\" or \
             \"mirror\"{}: {example}",
            match comparison {
                true => {
                    ", then the comparison: never, less, equal, less_equal, greater, not_equal, \
                     greater_equal or always"
                }
                false => "",
            }
        )
    };
    let text = value.as_str().ok_or_else(|| wrong(&format!("{value} isn't a sampler")))?;
    let mut words = text.split_whitespace();
    let mut sampler = match words.next() {
        Some("linear") => Sampler::LINEAR,
        Some("nearest") => Sampler::NEAREST,
        _ => return Err(wrong(&format!("\"{text}\" isn't a sampler"))),
    };
    let (mut compares, mut addressed) = (None, None);
    for word in words {
        let compare = match word {
            "clamp" | "repeat" | "mirror" => {
                if let Some(other) = addressed.replace(word) {
                    return Err(wrong(&format!("use `{other}` or `{word}`, not both")));
                }
                sampler = match word {
                    "repeat" => sampler.repeat(),
                    "mirror" => sampler.mirror(),
                    _ => sampler,
                };
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
            other => return Err(wrong(&format!("`{other}` isn't a property of a sampler"))),
        };
        if let Some(other) = compares.replace(word) {
            return Err(wrong(&format!("use `{other}` or `{word}`, not both")));
        }
        sampler = sampler.compare(compare);
    }
    match (compares.is_some(), comparison) {
        (false, true) => {
            Err(wrong("the variable compares depths, so the sampler needs a comparison"))
        }
        (true, false) => Err(wrong(
            "the variable doesn't compare depths, so the sampler can't have a comparison",
        )),
        _ => Ok(sampler),
    }
}

/// Splits text into an image's file name and its colour space, `linear` or `srgb`.
pub(crate) fn name_and_space(file: &str) -> (&str, Option<&str>) {
    match file.rsplit_once(' ') {
        Some((name, space @ ("linear" | "srgb"))) => (name.trim(), Some(space)),
        _ => (file, None),
    }
}

/// Reads an image. Converts sRGB to linear colours, except if the image's colour space is `linear`, or if the texture
/// stores integers or depths.
fn image(file: &str, folder: &Path, texels: Texels) -> Result<Image, String> {
    let (name, space) = name_and_space(file);
    if name.is_empty() {
        return Err(
            "the image's name is empty: name an image, or write a value for all texels".to_owned()
        );
    }
    let path = folder.join(name);
    let data = texels != Texels::Float;
    if data && space == Some("srgb") {
        return Err("depths and integers aren't colours: remove `srgb`".to_owned());
    }
    let read = if data || space == Some("linear") { Image::read_stored } else { Image::read };
    let unread = |error: std::io::Error| format!("can't read `{}`: {error}", path.display());
    let bytes = match read_file(&path) {
        // The image reader reports a missing file, so this isn't an error here.
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Vec::new(),
        read => read.map_err(unread)?,
    };
    let mut image = read(&path).map_err(|error| error.to_string())?;
    if matches!(texels, Texels::Sint | Texels::Uint) {
        let most = largest_sample(&bytes);
        for value in image.pixels_mut().iter_mut().flatten() {
            *value = (*value * most).round();
        }
    }
    Ok(image)
}

/// The largest value that a sample of a PNG can have, 255 or 65535; 1 for other images.
fn largest_sample(bytes: &[u8]) -> f32 {
    match (bytes.starts_with(b"\x89PNG"), bytes.get(24)) {
        (true, Some(16)) => 65535.0,
        // The reader converts samples with fewer bits to 8 bits.
        (true, _) => 255.0,
        _ => 1.0,
    }
}

/// The texel for a value: one number for all channels, or a list of numbers. `f64` represents all integers and floats
/// of textures exactly.
fn texel(value: &Value) -> Option<[f64; 4]> {
    let number = |value: &Value| match value {
        Value::Float(number) => Some(*number),
        #[expect(clippy::cast_precision_loss, reason = "what has more digits isn't in range")]
        Value::Integer(number) => Some(*number as f64),
        _ => None,
    };
    let Value::Array(list) = value else { return number(value).map(|x| [x, x, x, 1.0]) };
    let list: Option<Vec<f64>> = list.iter().map(number).collect();
    match list.as_deref() {
        Some([x]) => Some([*x, *x, *x, 1.0]),
        Some([r, g, b]) => Some([*r, *g, *b, 1.0]),
        Some([r, g, b, a]) => Some([*r, *g, *b, *a]),
        _ => None,
    }
}

struct Layer {
    width: u32,
    height: u32,
    texels: Vec<[f64; 4]>,
}

impl Layer {
    fn read(file: &str, folder: &Path, kind: Texels) -> Result<Self, String> {
        let image = image(file, folder, kind)?;
        let texels = image.pixels().iter().map(|texel| texel.map(f64::from)).collect();
        Ok(Self { width: image.width(), height: image.height(), texels })
    }

    fn of(value: &Value, folder: &Path, kind: Texels) -> Result<Self, String> {
        match value {
            Value::String(file) => Self::read(file, folder, kind),
            other => match texel(other) {
                Some(texel) => Ok(Self { width: 1, height: 1, texels: vec![texel] }),
                None => Err(format!("{other} isn't an image or a colour")),
            },
        }
    }
}

/// The largest number of texels in a texture without an image: 4096 x 4096.
const MOST_TEXELS: u64 = 1 << 24;

/// Layers with a declared size, `{ size = [50, 5] }`. The texels are zeros, copies of the `value`, or samples from the
/// `range`.
fn sized(name: &str, kind: TextureKind, table: &toml::Table) -> Result<Vec<Layer>, String> {
    let known = ["size", "value", "range", "seed"];
    if let Some(other) = table.keys().find(|key| !known.contains(&key.as_str())) {
        return Err(format!(
            "a texture has no key `{other}`: write `size`, and either `value` for all texels, or `range` and `seed` for random texels"
        ));
    }
    let count = match kind.dimension {
        Dimension::D1 => 1,
        Dimension::D2 if !kind.arrayed => 2,
        Dimension::Cube if !kind.arrayed => 1,
        _ => 3,
    };
    let wrong = || {
        let sides = ["[width]", "[width, height]", "[width, height, layers]"][count - 1];
        format!("the `size` of a {kind} must be {sides}, with integers of at least 1")
    };
    let side = |value: &Value| {
        value.as_integer().and_then(|side| u32::try_from(side).ok()).filter(|side| *side > 0)
    };
    let list = table.get("size").and_then(Value::as_array).filter(|list| list.len() == count);
    let sides: Option<Vec<u32>> = list.ok_or_else(wrong)?.iter().map(side).collect();
    let sides = sides.ok_or_else(wrong)?;
    let width = sides[0];
    let (height, layers) = match kind.dimension {
        Dimension::D1 => (1, 1),
        Dimension::Cube => {
            (sides.get(1).copied().unwrap_or(width), sides.get(2).map_or(6, |count| 6 * count))
        }
        _ => (sides[1], sides.get(2).copied().unwrap_or(1)),
    };
    let all = [width, height, layers]
        .iter()
        .fold(1_u64, |all, side| all.saturating_mul(u64::from(*side)));
    if all > MOST_TEXELS {
        return Err(format!(
            "the texture has {all} texels, but a texture without an image can have at most {MOST_TEXELS}"
        ));
    }
    let value = match table.get("value") {
        None => [0.0; 4],
        Some(_) if table.contains_key("range") => {
            return Err(
                "a texture can't have both a `value` and a `range`: remove one key".to_owned()
            );
        }
        Some(value) => texel(value)
            .ok_or("a texture's `value` must be a number, or a colour of 3 or 4 numbers")?,
    };
    let (scalar, channels) = match kind.texels {
        Texels::Depth => (Scalar::F32, 1),
        Texels::Float => (Scalar::F32, 4),
        Texels::Sint => (Scalar::I32, 4),
        Texels::Uint => (Scalar::U32, 4),
    };
    let element = match channels {
        1 => Shape::Scalar(scalar),
        _ => Shape::Vector { size: 4, scalar },
    };
    let texels = match drawn(name, &element, all as usize, table)? {
        None => vec![value; all as usize],
        Some(words) => {
            let texel = |words: &[u32]| {
                std::array::from_fn(|k| words.get(k).map_or(0.0, |word| scalar.decode(*word)))
            };
            words.chunks_exact(channels).map(texel).collect()
        }
    };
    let layers = texels.chunks_exact((width * height) as usize);
    Ok(layers.map(|texels| Layer { width, height, texels: texels.to_vec() }).collect())
}

fn texture(name: &str, kind: TextureKind, value: &Value, folder: &Path) -> Result<Fixture, String> {
    if let (BindingKind::TEXTURE_CUBE, Value::String(file)) = (BindingKind::Texture(kind), value) {
        let map = CubeMap::from_image(&image(file, folder, kind.texels)?, FACE);
        return map.map(Fixture::from).map_err(|error| error.to_string());
    }
    let several = kind.arrayed || kind.dimension != Dimension::D2;
    let layers = match (texel(value), value) {
        // The value is one colour for all texels.
        (Some(texel), _) => {
            let count = if kind.dimension == Dimension::Cube { 6 } else { 1 };
            let height = if kind.dimension == Dimension::D1 { 1 } else { SIDE };
            let texels = vec![texel; (SIDE * height) as usize];
            let layer = |_| Layer { width: SIDE, height, texels: texels.clone() };
            (0..count).map(layer).collect()
        }
        (None, Value::Table(table)) => sized(name, kind, table)?,
        (None, Value::Array(list)) if several && !list.is_empty() => list
            .iter()
            .map(|value| Layer::of(value, folder, kind.texels))
            .collect::<Result<Vec<_>, _>>()?,
        (None, Value::String(file)) if !several || kind.dimension == Dimension::D1 => {
            vec![Layer::read(file, folder, kind.texels)?]
        }
        _ => {
            let listed = match kind.dimension {
                Dimension::Cube if !kind.arrayed && kind.texels == Texels::Float => {
                    "the name of an equirectangular image, a list of six images or colours"
                }
                Dimension::Cube if !kind.arrayed => "a list of six images or colours",
                _ if several => "a list of images or colours",
                _ => "the name of an image",
            };
            return Err(format!(
                "write a {kind} as {listed}, a number, a colour (a list of 3 or 4 numbers), or `{{ size = [64, 64] }}` for texels of 0"
            ));
        }
    };
    of_layers(kind, &layers).map(Fixture::from)
}

fn of_layers(kind: TextureKind, layers: &[Layer]) -> Result<Texture, String> {
    let first = layers.first().ok_or("a texture needs an image")?;
    let (width, height) = (first.width, first.height);
    if layers.iter().any(|layer| (layer.width, layer.height) != (width, height)) {
        return Err("all images of a texture must have the same size".to_owned());
    }
    let (least, most, name) = match kind.texels {
        Texels::Sint => (f64::from(i32::MIN), f64::from(i32::MAX), "i32"),
        Texels::Uint => (0.0, f64::from(u32::MAX), "u32"),
        Texels::Float | Texels::Depth => (f64::NEG_INFINITY, f64::INFINITY, "f32"),
    };
    for value in layers.iter().flat_map(|layer| layer.texels.iter().flatten()) {
        let integer = name != "f32";
        #[expect(clippy::cast_possible_truncation, reason = "it is asked whether it fits")]
        let overflows = value.is_finite() && !(*value as f32).is_finite();
        if integer && value.fract() != 0.0 {
            return Err(format!("a texel is {value}, but the texture's texels are integers"));
        }
        if overflows || integer && !(least..=most).contains(value) {
            return Err(format!("a texel is {value}, but the texture's texels are of type {name}"));
        }
    }
    let at = |layer: usize, x: u32, y: u32| layers[layer].texels[(y * width + x) as usize];
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "integers are whole and in range, floats are rounded"
    )]
    match kind.texels {
        Texels::Float => {
            shaped(kind, layers.len(), width, height, |l, x, y| at(l, x, y).map(|c| c as f32))
        }
        Texels::Depth => shaped(kind, layers.len(), width, height, |l, x, y| at(l, x, y)[0] as f32),
        Texels::Sint => shaped(kind, layers.len(), width, height, |l, x, y| {
            IVec4::from(at(l, x, y).map(|c| c as i32))
        }),
        Texels::Uint => shaped(kind, layers.len(), width, height, |l, x, y| {
            UVec4::from(at(l, x, y).map(|c| c as u32))
        }),
    }
}

/// Makes a texture. `value` returns the texel for a layer, a column and a row.
fn shaped<T: karat::Shareable>(
    kind: TextureKind,
    layers: usize,
    width: u32,
    height: u32,
    value: impl Fn(usize, u32, u32) -> T,
) -> Result<Texture, String> {
    let layer = |layer: usize| Texture::from_fn(width, height, |x, y| value(layer, x, y));
    let expect = |count: usize, what: &str| match layers {
        found if found == count => Ok(()),
        found => Err(format!("{what}, not {found}")),
    };
    let square = || match width == height {
        true => Ok(()),
        false => Err("each image of a cube texture must be square".to_owned()),
    };
    Ok(match (kind.dimension, kind.arrayed) {
        (Dimension::D1, _) => {
            expect(1, "a 1D texture must have 1 image")?;
            if height != 1 {
                return Err("the image of a 1D texture must have one row".to_owned());
            }
            Texture::from_fn_1d(width, |x| value(0, x, 0))
        }
        (Dimension::D2, false) => {
            expect(1, "a 2D texture must have 1 image")?;
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
            expect(6, "a cube texture must have 6 images")?;
            square()?;
            Texture::cube((0..6).map(layer))
        }
        (Dimension::Cube, true) => {
            if !layers.is_multiple_of(6) {
                return Err(format!(
                    "each cube has 6 images, so a cube array can't have {layers} images"
                ));
            }
            square()?;
            Texture::cube_array((0..layers).map(layer))
        }
    })
}

fn buffer(
    program: &Program,
    binding: &Binding,
    value: &Value,
    folder: &Path,
) -> Result<Fixture, String> {
    if let Value::String(name) = value {
        let file = folder.join(name);
        let unread = |error: std::io::Error| format!("can't read `{}`: {error}", file.display());
        let read = || {
            let text = String::from_utf8(read_file(&file).map_err(unread)?);
            text.map_err(|error| format!("can't read `{}`: {error}", file.display()))
        };
        let inside = |error: &dyn std::fmt::Display| format!("`{}`: {error}", file.display());
        let value = match file.extension().and_then(|extension| extension.to_str()) {
            Some("bin") => {
                let bytes = read_file(&file).map_err(unread)?;
                if !bytes.len().is_multiple_of(4) {
                    let length = bytes.len();
                    let reason = format!(
                        "the file has {length} bytes, but a buffer's size must be a multiple of 4"
                    );
                    return Err(inside(&reason));
                }
                return Ok(Buffer::from_bytes(bytes).into());
            }
            Some("json") => {
                let value: serde_json::Value =
                    crate::json(&read()?).map_err(|error| inside(&error))?;
                Value::try_from(value).map_err(|error| inside(&error))?
            }
            Some("toml") => Value::Table(read()?.parse().map_err(|error| inside(&error))?),
            _ => {
                return Err(format!(
                    "`{name}` isn't a value: write a number, a list, a table of the buffer's members, or the \
                     name of a file: values.json, values.toml, bytes.bin"
                ));
            }
        };
        return buffer(program, binding, &value, Path::new("")).map_err(|error| inside(&error));
    }
    let is_list = |shape: &Shape| matches!(shape, Shape::Array { .. });
    let unknown = || format!("a test can't set the values of a {}", binding.kind);
    let plain = program.buffer_of(binding, 0).ok_or_else(unknown)?;
    match (&plain, value) {
        (Shape::Array { element, length }, Value::Table(table)) => {
            let lanes = spread(binding.name(), (element, *length), table)?;
            let bytes = program.bytes(binding, &lanes).map_err(|error| error.to_string())?;
            let says = |key: &str| table.contains_key(key);
            return Ok(match says("value") || says("range") {
                true => Buffer::from_bytes(bytes).into(),
                false => karat::unstable::fixture::blank(bytes.len()).into(),
            });
        }
        // The value has a size for its last member: `{ count = 0, items = { size = 150 } }`.
        (Shape::Struct { members, .. }, Value::Table(table)) => {
            if let Some((name, Shape::Array { element, length: 0 })) = members.last()
                && let Some(Value::Table(own)) = table.get(name)
            {
                let lanes = spread(name, (element, 0), own)?;
                let mut table = table.clone();
                table.insert(name.clone(), listed_lanes(element, &lanes));
                return buffer(program, binding, &Value::Table(table), folder);
            }
        }
        _ => {}
    }
    // The list determines the length of a runtime-sized array. In a structure, such an array is the last member.
    let elements = match (&plain, value) {
        (Shape::Struct { members, .. }, Value::Table(table)) => {
            let last = members.last().filter(|(_, shape)| is_list(shape));
            let last = last.and_then(|(name, _)| table.get(name));
            match (members.last(), last.and_then(Value::as_array)) {
                (Some((_, Shape::Array { element, .. })), Some(list)) => listed(element, list),
                _ => 0,
            }
        }
        (Shape::Array { element, .. }, Value::Array(list)) => listed(element, list),
        (Shape::Array { length: 0, .. }, _) => {
            return Err("the type is a runtime-sized array: write a list".to_owned());
        }
        _ => 0,
    };
    let shape = program.buffer_of(binding, elements).ok_or_else(unknown)?;
    if elements == 0 && is_left_empty(&shape) {
        return Err("a runtime-sized array needs at least one element".to_owned());
    }
    let lanes = lanes(&shape, value)?;
    let bytes = program.bytes(binding, &lanes).map_err(|error| error.to_string())?;
    Ok(Buffer::from_bytes(bytes).into())
}

/// The number of array elements that a list declares. For `vec2f`, both `[[1, 2], [3, 4]]` and `[1, 2, 3, 4]` declare
/// two elements.
fn listed(element: &Shape, list: &[Value]) -> usize {
    match list.iter().all(is_number) {
        true => list.len().div_ceil(element.lanes().len().max(1)),
        false => list.len(),
    }
}

/// Checks if a shape is, or ends in, a runtime-sized array without elements.
fn is_left_empty(shape: &Shape) -> bool {
    match shape {
        Shape::Array { length, .. } => *length == 0,
        Shape::Struct { members, .. } => {
            members.last().is_some_and(|(_, shape)| is_left_empty(shape))
        }
        _ => false,
    }
}

/// The scalars of an array's elements as a TOML list.
fn listed_lanes(element: &Shape, lanes: &[u32]) -> Value {
    let scalars = element.lanes();
    let one = |(word, scalar): (&u32, &Scalar)| match scalar {
        Scalar::Bool => Value::Boolean(*word != 0),
        Scalar::I32 => Value::Integer(i64::from(word.cast_signed())),
        Scalar::U32 => Value::Integer(i64::from(*word)),
        Scalar::F32 | Scalar::F16 => Value::Float(scalar.decode(*word)),
    };
    Value::Array(lanes.iter().zip(scalars.iter().cycle()).map(one).collect())
}

/// The scalars of an array that a table declares. The elements are samples, `{ size = 256, range = "0..1" }`, or copies
/// of one value, `{ size = 256, value = 1 }`. Without `range` and `value`, all scalars are 0. A fixed-size array needs
/// no `size`.
fn spread(
    name: &str,
    (element, length): (&Shape, u32),
    table: &toml::Table,
) -> Result<Vec<u32>, String> {
    /// The size in 32-bit words of the largest buffer that every device supports: 128 MiB.
    const MOST: usize = 1 << 25;
    let fixed = Some(length as usize).filter(|length| *length > 0);
    let known = ["size", "value", "range", "seed"];
    if let Some(unknown) = table.keys().find(|key| !known.contains(&key.as_str())) {
        return Err(match unknown.as_str() {
            "values" | "data" => {
                format!(
                    "there is no key `{unknown}`: write the elements as a list, `{name} = [1, 2]`"
                )
            }
            unknown => no_such("key", unknown, known),
        });
    }
    let width = element.lanes().len().max(1);
    let whole = |key: &str| table.get(key).map(|value| (value, value.as_integer()));
    let size = match whole("size") {
        Some((value, size)) if let Some(length) = fixed => match size {
            Some(size) if usize::try_from(size) == Ok(length) => length,
            _ => return Err(format!("size = {value}, but the array has {length} elements")),
        },
        Some((_, Some(size))) if size > 0 && size as u64 <= (MOST / width) as u64 => size as usize,
        Some((value, _)) => {
            let most = MOST / width;
            return Err(format!("size = {value} isn't a number of elements from 1 to {most}"));
        }
        None => match fixed {
            Some(length) => length,
            None => {
                return Err(
                    "the type is a runtime-sized array: write a list, or a `size`".to_owned()
                );
            }
        },
    };
    let value = table.get("value").map(|value| lanes(element, value)).transpose()?;
    match (drawn(name, element, size, table)?, value) {
        (Some(_), Some(_)) => {
            Err("elements can't have both a `value` and a `range`: remove one key".to_owned())
        }
        (None, Some(value)) => Ok(value.repeat(size)),
        (drawn, None) => Ok(drawn.unwrap_or_else(|| vec![0; size * width])),
    }
}

/// The scalars of `size` elements, sampled from the table's `range` with the table's `seed`; `None` if the table has no
/// `range`.
fn drawn(
    name: &str,
    element: &Shape,
    size: usize,
    table: &toml::Table,
) -> Result<Option<Vec<u32>>, String> {
    let seed = match table.get("seed").map(|seed| (seed, seed.as_integer())) {
        Some((_, Some(seed))) => seed.cast_unsigned(),
        Some((value, None)) => return Err(format!("seed = {value} isn't a whole number")),
        None => 0,
    };
    let Some(range) = table.get("range") else {
        return match table.contains_key("seed") {
            true => Err("`seed` does nothing without a `range`: remove `seed`".to_owned()),
            false => Ok(None),
        };
    };
    let parameter = (name.to_owned(), element.clone());
    let parts = parts(&parameter.0, element, Some(range), &Ranges::default())?;
    let domain = Dynamic::new(&[parameter], vec![parts]);
    // Samples even if the range has few values. In order, they would be sorted for each seed.
    let numbering = Numbering::of(&domain, seed, size as u64, 0);
    let mut rows = Vec::new();
    let count = domain.rows(&numbering, 0..numbering.count, &mut rows);
    if count < size as u64 {
        return Err("the range contains no value".to_owned());
    }
    Ok(Some(rows))
}

#[cfg(test)]
mod tests {
    use super::*;
    use karat::Package;
    use karat::unstable::probe::Probed;

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
        let binding =
            bindings.iter().find(|b| b.name() == "v").ok_or("the function doesn't read `v`")?;
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
            ("texture_2d<f32>", "{ size = [50, 5] }"),
            ("texture_3d<f32>", "{ size = [4, 3, 2], value = [1, 0, 0] }"),
            ("texture_cube<f32>", "{ size = [8], value = 1 }"),
            ("texture_2d<f32>", "{ size = [8, 4], range = \"0..1\", seed = 3 }"),
            ("texture_2d<i32>", "{ size = [8, 4], range = \"-9..9\" }"),
            ("texture_depth_2d", "{ size = [8, 4], range = \"0..1\" }"),
        ] {
            bound(declared, value).unwrap_or_else(|error| panic!("{declared}: {error}"));
        }
        for (declared, value, part) in [
            ("sampler", "\"linaer\"", "isn't a sampler"),
            ("sampler", "\"linear repaet\"", "`repaet` isn't a property of a sampler"),
            ("sampler", "\"linear less\"", "doesn't compare depths"),
            ("sampler_comparison", "\"linear\"", "so the sampler needs a comparison"),
            ("texture_2d<u32>", "0.5", "the texture's texels are integers"),
            ("texture_2d<u32>", "-1", "the texture's texels are of type u32"),
            ("texture_2d<f32>", "\"missing.exr\"", "missing.exr"),
            ("texture_3d<f32>", "true", "a list of images"),
            ("texture_3d<f32>", "[[1], true]", "true isn't an image"),
            ("texture_2d<f32>", "{ size = [50] }", "must be [width, height], with integers"),
            ("texture_2d<f32>", "{ size = [50, 0] }", "must be [width, height], with integers"),
            ("texture_2d<f32>", "{ size = [50, 5], value = true }", "`value` must be a number"),
            (
                "texture_2d<f32>",
                "{ size = [8, 4], value = 1, range = \"0..1\" }",
                "can't have both",
            ),
            ("texture_2d<f32>", "{ size = [8, 4], seed = 1 }", "does nothing without a `range`"),
            ("texture_2d<u32>", "{ size = [8, 4], range = \"-1..1\" }", "-1"),
            ("texture_2d<f32>", "{ sise = [50, 5] }", "a texture has no key `sise`"),
            ("texture_2d<f32>", "{ size = [65536, 65536] }", "at most 16777216"),
        ] {
            let error = bound(declared, value).expect_err(declared);
            assert!(error.contains(part), "{declared}: {error}");
        }
    }

    /// If a structure ends in an array, a test can set the array's size. Passes that append to a buffer use such
    /// structures.
    #[test]
    fn the_last_array_of_a_structure_has_a_size() {
        let text = "struct All { count: u32, items: array<vec2f> }
                    @group(0) @binding(0) var<storage> v: All; fn f() -> f32 { return v.items[0].x; }";
        let probed = Probed::new(&Package::from_source("bound", text), "f").expect("valid WGSL");
        let of = |value: &str| {
            let table: toml::Table = format!("v = {value}").parse().expect("TOML");
            fixture(probed.program(), &probed.function().bindings[0], &table["v"], Path::new(""))
        };
        for value in [
            "{ count = 0, items = { size = 150 } }",
            "{ count = 1, items = { size = 3, range = \"-1..1\" } }",
        ] {
            of(value).unwrap_or_else(|error| panic!("{value}: {error}"));
        }
        for (value, part) in [
            ("{ count = 0, items = { size = 0 } }", "isn't a number of elements"),
            ("{ count = 0, items = { sise = 2 } }", "did you mean `size`?"),
            ("{ items = { size = 2 } }", "count"),
        ] {
            let error = of(value).expect_err(value);
            assert!(error.contains(part), "{value}: {error}");
        }
    }

    /// The sampled elements of an array are in random order, and depend on the seed.
    // Lesson 141
    #[test]
    fn ranges_are_drawn_by_their_seed() {
        let of = |seed: u32| {
            let table = format!("size = 256\nrange = \"0..99\"\nseed = {seed}").parse();
            let element = Shape::Scalar(Scalar::U32);
            spread("v", (&element, 0), &table.expect("TOML")).expect("valid values")
        };
        let words = of(7);
        assert_eq!(words.len(), 256);
        let falls = words.windows(2).filter(|pair| pair[0] > pair[1]).count();
        assert!(falls > 64, "{words:?}");
        assert_ne!(words, of(8));
        assert!(words.iter().all(|word| *word <= 99));
    }

    /// Each texel is sampled separately, with as many channels as the texture's format has.
    #[test]
    fn texels_are_drawn() {
        let float = TextureKind {
            dimension: Dimension::D2,
            arrayed: true,
            texels: Texels::Float,
            multisampled: false,
        };
        let of = |kind, text: &str| {
            let layers = sized("v", kind, &text.parse().expect("TOML")).expect("valid values");
            layers.into_iter().flat_map(|layer| layer.texels).collect::<Vec<_>>()
        };
        let colours = of(float, "size = [8, 4, 2]\nrange = [\"0..1\", 5, \"2..3\", 1]");
        assert_eq!(colours.len(), 64);
        for [r, g, b, a] in &colours {
            assert!((0.0..=1.0).contains(r) && (2.0..=3.0).contains(b), "{r} {b}");
            assert_eq!((*g, *a), (5.0, 1.0));
        }
        assert!(
            colours.iter().any(|texel| texel[0] != colours[0][0]),
            "each texel is sampled separately"
        );
        let depth = TextureKind { texels: Texels::Depth, ..float };
        let depths = of(depth, "size = [8, 4, 2]\nrange = \"0.5..0.75\"");
        assert!(depths.iter().all(|texel| (0.5..=0.75).contains(&texel[0])), "{depths:?}");
        assert_eq!(depths.len(), 64);
    }

    /// A fixed-size array needs neither a list nor a size: `{ range = "0..1" }` is enough.
    #[test]
    fn fixed_arrays_are_spread() {
        let of = |value: &str| {
            let text = "@group(0) @binding(0) var<uniform> v: array<vec4u, 3>; fn f() -> u32 { return v[0].x; }";
            let probed =
                Probed::new(&Package::from_source("bound", text), "f").expect("valid WGSL");
            let table: toml::Table = format!("v = {value}").parse().expect("TOML");
            fixture(probed.program(), &probed.function().bindings[0], &table["v"], Path::new(""))
        };
        for value in
            ["{}", "{ size = 3 }", "{ range = \"0..9\" }", "{ range = \"0..9\", seed = 2 }"]
        {
            of(value).unwrap_or_else(|error| panic!("{value}: {error}"));
        }
        for (value, part) in [
            ("{ size = 4 }", "size = 4, but the array has 3 elements"),
            ("{ size = -3 }", "size = -3, but the array has 3 elements"),
            ("{ sise = 3 }", "did you mean `size`?"),
            ("{ seed = 1 }", "`seed` does nothing without a `range`"),
        ] {
            let error = of(value).expect_err(value);
            assert!(error.contains(part), "{value}: {error}");
        }
    }
}
