//! Formats of a frame's targets.

use crate::image::encode_srgb;
use crate::path::Device;

/// The largest rounding error if a GPU stores a float as an integer, as in `rgba8unorm`. The unit is the step between
/// two integers. Direct3D allows 0.6 steps (`D3D11_FLOAT32_TO_INTEGER_TOLERANCE_IN_ULP`). Other APIs round to the
/// nearest integer.
const ROUNDING: f64 = 0.6;

/// The format of a colour target. The frame's image contains the target's values as floats. If the format is sRGB, the
/// floats are the decoded, linear values.
///
/// ```
/// use karat::draw::Format;
///
/// assert_eq!(Format::named("rgba8unorm-srgb"), Some(Format::Rgba8UnormSrgb));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Format {
    /// The most precise floats that the path can draw into, usually of 32 bits. The floats have 16 bits if
    /// pixels have several samples, or if the path can't draw or blend 32-bit floats.
    #[default]
    Float,
    /// One channel of 8 bits from 0 to 1.
    R8Unorm,
    /// Two channels of 8 bits from 0 to 1.
    Rg8Unorm,
    /// Four channels of 8 bits from 0 to 1.
    Rgba8Unorm,
    /// Four channels of 8 bits, encoded with sRGB's transfer function.
    #[serde(rename = "rgba8unorm-srgb")]
    Rgba8UnormSrgb,
    /// Four channels of 8 bits from 0 to 1, blue first. Many systems use this format for their surfaces.
    Bgra8Unorm,
    /// Four channels of 8 bits, blue first, encoded with sRGB's transfer function.
    #[serde(rename = "bgra8unorm-srgb")]
    Bgra8UnormSrgb,
    /// Three channels of 10 bits and one of 2, from 0 to 1.
    Rgb10a2Unorm,
    /// Three unsigned floats of 11, 11 and 10 bits, for HDR.
    Rg11b10Ufloat,
    /// One 16-bit float.
    R16Float,
    /// Two 16-bit floats.
    Rg16Float,
    /// Four 16-bit floats.
    Rgba16Float,
    /// One 32-bit float.
    R32Float,
    /// Two 32-bit floats.
    Rg32Float,
    /// Four 32-bit floats.
    Rgba32Float,
    /// One `u32`. Images store integers as floats, so integers are exact up to 2^24.
    R32Uint,
    /// One `i32`.
    R32Sint,
    /// Four integers from 0 to 255.
    Rgba8Uint,
    /// Four integers from 0 to 65535.
    Rgba16Uint,
    /// Four `u32`.
    Rgba32Uint,
}

impl Format {
    /// The formats with their names in test files. Except for `float`, the names are WebGPU's names.
    pub const NAMES: [(&str, Self); 20] = [
        ("float", Self::Float),
        ("r8unorm", Self::R8Unorm),
        ("rg8unorm", Self::Rg8Unorm),
        ("rgba8unorm", Self::Rgba8Unorm),
        ("rgba8unorm-srgb", Self::Rgba8UnormSrgb),
        ("bgra8unorm", Self::Bgra8Unorm),
        ("bgra8unorm-srgb", Self::Bgra8UnormSrgb),
        ("rgb10a2unorm", Self::Rgb10a2Unorm),
        ("rg11b10ufloat", Self::Rg11b10Ufloat),
        ("r16float", Self::R16Float),
        ("rg16float", Self::Rg16Float),
        ("rgba16float", Self::Rgba16Float),
        ("r32float", Self::R32Float),
        ("rg32float", Self::Rg32Float),
        ("rgba32float", Self::Rgba32Float),
        ("r32uint", Self::R32Uint),
        ("r32sint", Self::R32Sint),
        ("rgba8uint", Self::Rgba8Uint),
        ("rgba16uint", Self::Rgba16Uint),
        ("rgba32uint", Self::Rgba32Uint),
    ];

    /// Returns the format with this name, or `None`.
    ///
    /// ```
    /// use karat::draw::Format;
    ///
    /// assert_eq!(Format::named("r32uint"), Some(Format::R32Uint));
    /// assert_eq!(Format::named("rgb9e5"), None);
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::NAMES.into_iter().find(|(known, _)| *known == name).map(|(_, format)| format)
    }

    /// Checks if `x` can be the stored value of a channel that was cleared to `clear`. The format rounds clear values.
    /// If the format lacks the channel, the result is `true`.
    pub(super) fn keeps(self, channel: usize, clear: f32, x: f32) -> bool {
        let (clear, x) = (f64::from(clear), f64::from(x));
        let within = |steps: f64| (x - clear.clamp(0.0, 1.0)).abs() <= ROUNDING / steps;
        // Drivers may round floats towards zero, so the stored value may be one step away. The smallest step is the
        // smallest subnormal number.
        let rounded = |clear: f64, digits: i32, least: i32| {
            let step = clear.abs() * 2.0_f64.powi(-digits);
            (x - clear).abs() <= step.max(2.0_f64.powi(least))
        };
        let is_whole = |clear: f64| (x - clear.trunc()).abs() < 0.5;
        match self {
            Self::R8Unorm => channel > 0 || within(255.0),
            Self::Rg8Unorm => channel > 1 || within(255.0),
            Self::Rgba8UnormSrgb | Self::Bgra8UnormSrgb if channel < 3 => {
                let clear = encode_srgb(clear.clamp(0.0, 1.0));
                (encode_srgb(x) - clear).abs() <= ROUNDING / 255.0
            }
            Self::Rgba8Unorm | Self::Bgra8Unorm | Self::Rgba8UnormSrgb | Self::Bgra8UnormSrgb => {
                within(255.0)
            }
            Self::Rgb10a2Unorm => within(if channel < 3 { 1023.0 } else { 3.0 }),
            Self::Rg11b10Ufloat => match channel {
                0 | 1 => rounded(clear.max(0.0), 6, -20),
                2 => rounded(clear.max(0.0), 5, -19),
                _ => true,
            },
            Self::R16Float => channel > 0 || rounded(clear, 10, -24),
            Self::Rg16Float => channel > 1 || rounded(clear, 10, -24),
            // `Float` may store 16 bits.
            Self::Float | Self::Rgba16Float => rounded(clear, 10, -24),
            Self::R32Float => channel > 0 || rounded(clear, 23, -126),
            Self::Rg32Float => channel > 1 || rounded(clear, 23, -126),
            Self::Rgba32Float => rounded(clear, 23, -126),
            Self::R32Uint => channel > 0 || is_whole(clear.max(0.0)),
            Self::R32Sint => channel > 0 || is_whole(clear),
            Self::Rgba8Uint | Self::Rgba16Uint | Self::Rgba32Uint => is_whole(clear.max(0.0)),
        }
    }

    pub(super) fn on(
        self,
        device: &Device,
        blended: bool,
        (samples, components): (u32, u8),
    ) -> wgpu::TextureFormat {
        use wgpu::TextureFormat as F;
        let blendable = device.device.features().contains(wgpu::Features::FLOAT32_BLENDABLE);
        let exact = samples == 1 && (!blended || blendable);
        match self {
            // A target has no more components than the shaders write.
            Self::Float => match (exact && device.color_format() == F::Rgba32Float, components) {
                (true, 1) => F::R32Float,
                (true, 2) => F::Rg32Float,
                (true, _) => F::Rgba32Float,
                (false, 1) => F::R16Float,
                (false, 2) => F::Rg16Float,
                (false, _) => F::Rgba16Float,
            },
            Self::R8Unorm => F::R8Unorm,
            Self::Rg8Unorm => F::Rg8Unorm,
            Self::Rgba8Unorm => F::Rgba8Unorm,
            Self::Rgba8UnormSrgb => F::Rgba8UnormSrgb,
            Self::Bgra8Unorm => F::Bgra8Unorm,
            Self::Bgra8UnormSrgb => F::Bgra8UnormSrgb,
            Self::Rgb10a2Unorm => F::Rgb10a2Unorm,
            Self::Rg11b10Ufloat => F::Rg11b10Ufloat,
            Self::R16Float => F::R16Float,
            Self::Rg16Float => F::Rg16Float,
            Self::Rgba16Float => F::Rgba16Float,
            Self::R32Float => F::R32Float,
            Self::Rg32Float => F::Rg32Float,
            Self::Rgba32Float => F::Rgba32Float,
            Self::R32Uint => F::R32Uint,
            Self::R32Sint => F::R32Sint,
            Self::Rgba8Uint => F::Rgba8Uint,
            Self::Rgba16Uint => F::Rgba16Uint,
            Self::Rgba32Uint => F::Rgba32Uint,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_within_the_rounding_of_a_format_are_accepted() {
        for byte in [76.0, 77.0] {
            assert!(Format::Rgba8Unorm.keeps(0, 0.3, byte / 255.0));
        }
        for byte in [75.0, 78.0] {
            assert!(!Format::Rgba8Unorm.keeps(0, 0.3, byte / 255.0));
        }
        // 0.3 is at 148.9 of 255 steps on sRGB's curve.
        let linear = |byte: f32| ((byte / 255.0 + 0.055) / 1.055).powf(2.4);
        assert!(Format::Rgba8UnormSrgb.keeps(0, 0.3, linear(149.0)));
        assert!(!Format::Rgba8UnormSrgb.keeps(0, 0.3, linear(150.0)));
        assert!(Format::R8Unorm.keeps(3, 0.0, 1.0), "the format has no alpha");
        let half = half::f16::from_f32(0.3).to_f32();
        assert!(Format::Rgba16Float.keeps(0, 0.3, half));
        assert!(!Format::Rgba32Float.keeps(0, 0.3, half));
        assert!(Format::Rgba8Uint.keeps(0, 3.7, 3.0));
        assert!(!Format::Rgba8Unorm.keeps(0, 0.3, f32::NAN));
    }
}
