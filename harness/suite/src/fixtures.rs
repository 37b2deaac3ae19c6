//! What a declared test binds: images, samplers, and values of buffers.
//!
//! | for | is |
//! |---|---|
//! | a texture | `"image.exr"` or `"image.png"`, or a colour `[r, g, b, a]` |
//! | a cube map | `"equirectangular.exr"`, or a colour `[r, g, b]` |
//! | a sampler | `"linear"` or `"nearest"` |
//! | a buffer | its value: numbers, lists, tables of members; for an array without a length, a list |

use std::path::Path;

use karat::fixture::Fixture;
use karat::reflect::{Binding, BindingKind, Program};
use karat::{CubeMap, Image, Sampler, Storage, Texture, Uniform};
use toml::Value;

use crate::domains::lanes;

/// Texels along an edge of a face of a cube map that is made of an image.
const FACE: u32 = 64;

/// The fixture of a variable.
pub(crate) fn fixture(
    program: &Program,
    binding: &Binding,
    value: &Value,
    folder: &Path,
) -> Result<Fixture, String> {
    let name = binding.name();
    let wrong = |reason: String| format!("with `{name}`: {reason}");
    let image =
        |file: &str| Image::read(&folder.join(file)).map_err(|error| wrong(error.to_string()));
    let colour = |count: usize| -> Result<Option<Vec<f32>>, String> {
        let Value::Array(list) = value else { return Ok(None) };
        let number = |value: &Value| match value {
            #[expect(clippy::cast_possible_truncation, reason = "texels are f32")]
            Value::Float(number) => Some(*number as f32),
            #[expect(clippy::cast_precision_loss, reason = "as a literal of WGSL would")]
            Value::Integer(number) => Some(*number as f32),
            _ => None,
        };
        let numbers: Option<Vec<f32>> = list.iter().map(number).collect();
        let numbers = numbers.filter(|numbers| numbers.len() == count);
        numbers.map(Some).ok_or_else(|| wrong(format!("a colour is a list of {count} numbers")))
    };
    match binding.kind {
        BindingKind::Sampler { .. } => match value.as_str() {
            Some("linear") => Ok(Sampler::Linear.into()),
            Some("nearest") => Ok(Sampler::Nearest.into()),
            _ => Err(wrong("a sampler is \"linear\" or \"nearest\"".to_owned())),
        },
        BindingKind::TEXTURE_2D => match (value.as_str(), colour(4)?) {
            (Some(file), _) => Ok(Texture::from(&image(file)?).into()),
            (_, Some(c)) => Ok(Texture::constant([c[0], c[1], c[2], c[3]]).into()),
            _ => Err(wrong("a texture is the name of an image, or a colour".to_owned())),
        },
        BindingKind::TEXTURE_CUBE => match (value.as_str(), colour(3)?) {
            (Some(file), _) => {
                let map = CubeMap::from_image(&image(file)?, FACE);
                Ok(map.map_err(|error| wrong(error.to_string()))?.into())
            }
            (_, Some(c)) => Ok(CubeMap::constant([c[0], c[1], c[2]].into()).into()),
            _ => Err(wrong("a cube map is the name of an image, or a colour".to_owned())),
        },
        _ => {
            let Some((shape, elements)) = program.buffer_data(binding) else {
                return Err(wrong("this can't be bound by a file of tests yet".to_owned()));
            };
            if !elements {
                return Ok(
                    Uniform::of_lanes(shape.clone(), lanes(&shape, value).map_err(wrong)?).into()
                );
            }
            let Value::Array(list) = value else {
                return Err(wrong("an array without a length is a list".to_owned()));
            };
            let all = list.iter().map(|value| lanes(&shape, value)).collect::<Result<Vec<_>, _>>();
            Ok(Storage::of_lanes(shape, all.map_err(wrong)?.concat()).into())
        }
    }
}
