//! Finds uses of native features: features of wgpu that no browser has.

use naga::front::wgsl::{Frontend, Options};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use naga::{ImageClass, StorageFormat, TypeInner};

use super::{Program, on_deep_stack};
use crate::package::as_naga_takes;

/// Capabilities that WebGPU also has, by default or as a feature. naga's other capabilities exist only in wgpu.
const WEBGPU: Capabilities = Capabilities::MULTISAMPLED_SHADING
    .union(Capabilities::CUBE_ARRAY_TEXTURES)
    .union(Capabilities::SHADER_FLOAT16)
    .union(Capabilities::SHADER_FLOAT16_IN_FLOAT32)
    .union(Capabilities::CLIP_DISTANCES)
    .union(Capabilities::DUAL_SOURCE_BLENDING)
    .union(Capabilities::PRIMITIVE_INDEX)
    .union(Capabilities::IMMEDIATES)
    .union(Capabilities::TEXTURE_EXTERNAL);

/// The names that `native` in `karat.toml` accepts: naga's capabilities that WebGPU lacks, in lower case.
pub(super) fn names() -> Vec<String> {
    native().map(|(name, _)| name).collect()
}

fn native() -> impl Iterator<Item = (String, Capabilities)> {
    let native = Capabilities::all().difference(WEBGPU);
    native
        .iter_names()
        .map(|(name, one)| (name.to_lowercase(), one))
        .collect::<Vec<_>>()
        .into_iter()
}

impl Program {
    /// The native features that the program uses. A program uses a feature if naga, without the feature, rejects the
    /// program, or rejects an `enable` in its text.
    pub(super) fn native_features(&self) -> Vec<String> {
        let used = native().filter(|(_, one)| on_deep_stack(|| self.needs(*one)));
        used.map(|(name, _)| name).collect()
    }

    fn needs(&self, capability: Capabilities) -> bool {
        let capabilities = Capabilities::all().difference(capability);
        let mut options = Options::new();
        options.capabilities = capabilities;
        if Frontend::new_with_options(options).parse(&as_naga_takes(self.text())).is_err() {
            return true;
        }
        // naga accepts these texels without the feature. But wgpu requires the feature when it creates the shader
        // module.
        let is_wide = |inner: &TypeInner| {
            matches!(
                inner,
                TypeInner::Image {
                    class: ImageClass::Storage { format: StorageFormat::R64Uint, .. },
                    ..
                }
            )
        };
        let module = &self.checked.module;
        let wide = capability == Capabilities::TEXTURE_INT64_ATOMIC
            && module.types.iter().any(|(_, ty)| is_wide(&ty.inner));
        wide || Validator::new(ValidationFlags::all(), capabilities).validate(module).is_err()
    }
}
