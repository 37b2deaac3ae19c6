//! What wgpu has on native platforms alone, and no browser.

use naga::valid::{Capabilities, ValidationFlags, Validator};

use super::{Program, on_deep_stack};

/// What WebGPU has, too, by default or as a feature. All else that naga knows of is wgpu's.
const WEBGPU: Capabilities = Capabilities::MULTISAMPLED_SHADING
    .union(Capabilities::CUBE_ARRAY_TEXTURES)
    .union(Capabilities::SHADER_FLOAT16)
    .union(Capabilities::SHADER_FLOAT16_IN_FLOAT32)
    .union(Capabilities::CLIP_DISTANCES)
    .union(Capabilities::DUAL_SOURCE_BLENDING)
    .union(Capabilities::PRIMITIVE_INDEX)
    .union(Capabilities::TEXTURE_EXTERNAL);

/// The names that `native` in `karat.toml` can have: those of naga's capabilities, in small letters.
pub(super) fn names() -> Vec<String> {
    native().iter_names().map(|(name, _)| name.to_lowercase()).collect()
}

fn native() -> Capabilities {
    Capabilities::all().difference(WEBGPU)
}

impl Program {
    /// What the program uses that wgpu alone has: naga rejects it without.
    pub(super) fn native_features(&self) -> Vec<String> {
        let needs = |(_, without): &(&str, Capabilities)| {
            let others = Capabilities::all().difference(*without);
            let mut validator = Validator::new(ValidationFlags::all(), others);
            on_deep_stack(|| validator.validate(&self.checked.module).is_err())
        };
        let used = native().iter_names().filter(needs);
        used.map(|(name, _)| name.to_lowercase()).collect()
    }
}
