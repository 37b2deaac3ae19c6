//! The bindings of resources, in WGSL and in a translation.

use naga::valid::{GlobalUse, ModuleInfo};
use naga::{
    AddressSpace, EntryPoint, ImageClass, ImageDimension, Module, ScalarKind, StorageAccess,
    TypeInner,
};

/// The resources of a shader, in the order of their bindings in a translation.
///
/// GLSL has no groups, and HLSL numbers the registers of buffers, textures and samplers separately. So Karat numbers
/// all resources in one sequence for GLSL and HLSL: first the resources that the entry point uses, in the order of
/// groups and bindings, then all others. The same number means the same resource in GLSL, in HLSL, and in the SPIR-V
/// that compilers make from GLSL and HLSL.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Bindings(Vec<Resource>);

/// A resource with its bindings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Resource {
    /// The resource's group and binding in WGSL.
    pub wgsl: (u32, u32),
    /// The resource's group and binding, or HLSL's space and register, in the translation.
    pub translated: (u32, u32),
    /// The resource's kind.
    pub kind: Kind,
    /// `true` if the entry point uses the resource. In the translation of a whole shader, `used` is always `true`.
    pub used: bool,
}

/// The kind of a resource.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Kind {
    /// A uniform buffer.
    Uniform,
    /// A storage buffer.
    Storage {
        /// `true` if shaders can only read the buffer.
        read_only: bool,
    },
    /// A sampled texture.
    Texture {
        /// The number of dimensions: 1, 2 or 3. The number 4 stands for a cube map.
        dimensions: u8,
        /// `true` for an array of textures.
        arrayed: bool,
        /// The type of the texture's texels.
        texels: Texels,
    },
    /// A sampler.
    Sampler,
    /// A storage texture, a multisampled texture, or a resource of a WGSL extension, such as an acceleration structure.
    Other,
}

/// The type of a texture's texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Texels {
    /// `f32`
    Float,
    /// `i32`
    Sint,
    /// `u32`
    Uint,
    /// Depth.
    Depth,
}

impl Bindings {
    /// The WGSL bindings, unchanged.
    pub(crate) fn kept(module: &Module) -> Self {
        let bound = bound(module, |_| true);
        Self(bound.map(|r| Resource { translated: r.wgsl, ..r }).collect())
    }

    pub(crate) fn in_a_row(
        module: &Module,
        info: &ModuleInfo,
        entry_point: Option<&EntryPoint>,
    ) -> Self {
        let mut resources: Vec<_> = bound(module, uses(module, info, entry_point)).collect();
        resources.sort_unstable_by_key(|resource| (!resource.used, resource.wgsl));
        for (number, resource) in (0..).zip(&mut resources) {
            resource.translated = (0, number);
        }
        Self(resources)
    }

    /// Iterates over all resources.
    pub fn iter(&self) -> impl Iterator<Item = &Resource> {
        self.0.iter()
    }

    /// The translated binding of the resource that has this group and binding in WGSL; `None` if the shader has no such
    /// resource.
    #[must_use]
    pub fn of(&self, group: u32, binding: u32) -> Option<(u32, u32)> {
        self.iter().find(|resource| resource.wgsl == (group, binding)).map(|r| r.translated)
    }
}

/// Checks if an entry point uses a variable. If no entry point is given, each variable counts as used.
pub(crate) fn uses(
    module: &Module,
    info: &ModuleInfo,
    entry_point: Option<&EntryPoint>,
) -> impl Fn(naga::Handle<naga::GlobalVariable>) -> bool {
    let index = entry_point
        .and_then(|wanted| module.entry_points.iter().position(|e| std::ptr::eq(e, wanted)));
    move |global| {
        index.is_none_or(|index| info.get_entry_point(index)[global] != GlobalUse::empty())
    }
}

fn bound(
    module: &Module,
    used: impl Fn(naga::Handle<naga::GlobalVariable>) -> bool,
) -> impl Iterator<Item = Resource> {
    module.global_variables.iter().filter_map(move |(handle, global)| {
        let binding = global.binding?;
        let kind = match global.space {
            AddressSpace::Uniform => Kind::Uniform,
            AddressSpace::Storage { access } => {
                Kind::Storage { read_only: !access.contains(StorageAccess::STORE) }
            }
            _ => kind(&module.types[global.ty].inner),
        };
        let wgsl = (binding.group, binding.binding);
        Some(Resource { wgsl, translated: wgsl, kind, used: used(handle) })
    })
}

fn kind(inner: &TypeInner) -> Kind {
    let TypeInner::Image { dim, arrayed, class } = inner else {
        return match inner {
            TypeInner::Sampler { .. } => Kind::Sampler,
            _ => Kind::Other,
        };
    };
    let texels = match class {
        ImageClass::Sampled { kind: ScalarKind::Float, multi: false } => Texels::Float,
        ImageClass::Sampled { kind: ScalarKind::Sint, multi: false } => Texels::Sint,
        ImageClass::Sampled { kind: ScalarKind::Uint, multi: false } => Texels::Uint,
        ImageClass::Depth { multi: false } => Texels::Depth,
        _ => return Kind::Other,
    };
    let dimensions = match dim {
        ImageDimension::D1 => 1,
        ImageDimension::D2 => 2,
        ImageDimension::D3 => 3,
        ImageDimension::Cube => 4,
    };
    Kind::Texture { dimensions, arrayed: *arrayed, texels }
}
