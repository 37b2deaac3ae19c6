//! The resource variables of functions and entry points.

use std::fmt;

use naga::valid::GlobalUse;

use super::{Program, Stage};

/// A resource variable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Binding {
    /// Author's path: `environment::sky`.
    pub path: String,
    /// `@group`
    pub group: u32,
    /// `@binding`
    pub binding: u32,
    /// What it is.
    pub kind: BindingKind,
    pub(crate) ty: naga::Handle<naga::Type>,
}

impl Binding {
    /// The variable's own name, without its module.
    #[must_use]
    pub fn name(&self) -> &str {
        self.path.rsplit("::").next().unwrap_or_default()
    }
}

/// The kind of a resource variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BindingKind {
    /// `var<uniform>`
    Uniform,
    /// `var<storage>`
    Storage {
        /// `read_write`
        writable: bool,
    },
    /// `texture_2d<f32>`
    Texture2d,
    /// `texture_cube<f32>`
    TextureCube,
    /// `sampler`
    Sampler,
    /// Something that no fixture can supply yet.
    Other,
}

impl fmt::Display for BindingKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Uniform => "uniform buffer",
            Self::Storage { .. } => "storage buffer",
            Self::Texture2d => "texture_2d<f32>",
            Self::TextureCube => "texture_cube<f32>",
            Self::Sampler => "sampler",
            Self::Other => "resource of an unsupported kind",
        })
    }
}

impl Program {
    /// The resources of an entry point; `None` if there is no such entry point.
    #[must_use]
    pub fn entry_point_bindings(&self, stage: Stage, name: &str) -> Option<Vec<Binding>> {
        let name = self.entry_point_name(name);
        let naga_stage = match stage {
            Stage::Vertex => naga::ShaderStage::Vertex,
            Stage::Fragment => naga::ShaderStage::Fragment,
        };
        let mut entries = self.checked.module.entry_points.iter();
        let index = entries.position(|entry| entry.name == name && entry.stage == naga_stage)?;
        let info = self.checked.info.get_entry_point(index);
        Some(self.bindings(|global| info[global]))
    }

    /// The resources of a compute entry point, by its name in the text, and the invocations of its
    /// workgroup.
    #[cfg(feature = "routes")]
    pub(crate) fn compute_entry_point(&self, name: &str) -> Option<(Vec<Binding>, [u32; 3])> {
        let mut entries = self.checked.module.entry_points.iter();
        let index = entries
            .position(|entry| entry.name == name && entry.stage == naga::ShaderStage::Compute)?;
        let info = self.checked.info.get_entry_point(index);
        let size = self.checked.module.entry_points[index].workgroup_size;
        Some((self.bindings(|global| info[global]), size))
    }

    /// The bytes of a buffer whose type has no shape that a host could fill: zeros, with room for
    /// `elements` more where it ends in an array without a length.
    #[cfg(feature = "routes")]
    pub(crate) fn zeros(&self, binding: &Binding, elements: usize) -> Vec<u8> {
        /// The largest alignment of an element that isn't an array or a structure.
        const ELEMENT: usize = 16;
        let size = self.layouter()[binding.ty].size as usize + elements * ELEMENT;
        vec![0; size.next_multiple_of(ELEMENT)]
    }

    /// The first binding number of group 0 that the program leaves free.
    pub(crate) fn free_binding(&self) -> u32 {
        let used = self.checked.module.global_variables.iter().filter_map(|(_, global)| {
            global.binding.as_ref().filter(|binding| binding.group == 0).map(|b| b.binding + 1)
        });
        used.max().unwrap_or(0)
    }

    pub(super) fn bindings(
        &self,
        usage: impl Fn(naga::Handle<naga::GlobalVariable>) -> GlobalUse,
    ) -> Vec<Binding> {
        let mut bindings: Vec<Binding> = self
            .checked
            .module
            .global_variables
            .iter()
            .filter(|(handle, _)| !usage(*handle).is_empty())
            .filter_map(|(_, global)| {
                let resource = global.binding.as_ref()?;
                let name = global.name.clone().unwrap_or_default();
                Some(Binding {
                    path: self.linked.names.get(&name).cloned().unwrap_or(name),
                    group: resource.group,
                    binding: resource.binding,
                    kind: self.binding_kind(global),
                    ty: global.ty,
                })
            })
            .collect();
        bindings.sort_by_key(|binding| (binding.group, binding.binding));
        bindings
    }

    fn binding_kind(&self, global: &naga::GlobalVariable) -> BindingKind {
        use naga::{AddressSpace, ImageClass, ImageDimension, ScalarKind, TypeInner};
        match (global.space, &self.checked.module.types[global.ty].inner) {
            (AddressSpace::Uniform, _) => BindingKind::Uniform,
            (AddressSpace::Storage { access }, _) => {
                BindingKind::Storage { writable: access.contains(naga::StorageAccess::STORE) }
            }
            (_, TypeInner::Sampler { comparison: false }) => BindingKind::Sampler,
            (
                _,
                TypeInner::Image {
                    dim,
                    arrayed: false,
                    class: ImageClass::Sampled { kind: ScalarKind::Float, multi: false },
                },
            ) => match dim {
                ImageDimension::D2 => BindingKind::Texture2d,
                ImageDimension::Cube => BindingKind::TextureCube,
                ImageDimension::D1 | ImageDimension::D3 => BindingKind::Other,
            },
            _ => BindingKind::Other,
        }
    }
}
