//! Finds the resource variables of functions and entry points.

use std::sync::Arc;

use super::Overrides;
use super::{BindingKind, NAMED, Program, Stage};
use crate::diagnostic::Span;
use crate::package::Package;
use crate::value::Shape;

/// A resource variable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Binding {
    /// The author's path: `environment::sky`.
    pub path: String,
    /// The number in `@group`; [`NOWHERE`](Self::NOWHERE) for a `var<immediate>`.
    pub group: u32,
    /// The number in `@binding`; [`NOWHERE`](Self::NOWHERE) for a `var<immediate>`.
    pub binding: u32,
    /// The kind of the resource.
    pub kind: BindingKind,
    /// The location of the variable's declaration.
    pub span: Option<Span>,
    /// `true` if the shader reads the texture through a sampler.
    pub(crate) sampled: bool,
    pub(crate) ty: naga::Handle<naga::Type>,
}

impl Binding {
    /// The value of `group` and `binding` for a `var<immediate>`, which has neither `@group` nor `@binding`.
    pub const NOWHERE: u32 = u32::MAX;

    /// The variable's own name, without its module.
    #[must_use]
    pub fn name(&self) -> &str {
        self.path.rsplit("::").next().unwrap_or_default()
    }
}

/// A program, the resources of its compute entry point, and the size of a workgroup.
pub(crate) type PassProgram = (Arc<Program>, Vec<Binding>, [u32; 3]);

impl Program {
    /// The length of the longest array in the buffers, in elements, if the shader declares each array's length. `None`
    /// if there are no arrays, or if the host chooses the length of an array or the size of a storage texture.
    pub fn fixed_elements(&self, bindings: &[Binding]) -> Option<usize> {
        fn longest(shape: &Shape) -> usize {
            match shape {
                Shape::Array { element, length } => longest(element).max(*length as usize),
                Shape::Struct { members, .. } => {
                    members.iter().map(|(_, member)| longest(member)).max().unwrap_or(0)
                }
                _ => 0,
            }
        }
        let of = |binding: &Binding| match binding.kind {
            BindingKind::StorageTexture { .. } => None,
            BindingKind::Storage { .. } => {
                let [one, two] = [1, 2].map(|elements| self.buffer_of(binding, elements));
                let (one, two) = (one?, two?);
                (one == two).then(|| longest(&one))
            }
            _ => Some(0),
        };
        let all: Option<Vec<usize>> = bindings.iter().map(of).collect();
        all?.into_iter().max().filter(|most| *most > 1)
    }

    /// Links and validates a compute entry point with everything that it uses.
    ///
    /// # Errors
    /// Returns an error if the linked text isn't valid, if `name` isn't a compute entry point, if an override has no
    /// value, or if the workgroup is larger than any device supports.
    pub fn of_pass(
        package: &Package,
        name: &str,
        overrides: &Overrides,
    ) -> Result<PassProgram, String> {
        /// The largest number of invocations that any device supports (`maxComputeInvocationsPerWorkgroup` is
        /// 1,024 today).
        const MOST_INVOCATIONS: u64 = 1024;
        let (module, own) = name.rsplit_once("::").unwrap_or(("", name));
        let program = Self::of_items(package, module, &[own]).map_err(|error| error.to_string())?;
        let program = program.overridden(overrides).map_err(|error| error.to_string())?;
        let found = program.compute_entry_point(program.entry_point_name(own));
        let (bindings, size) = found.ok_or_else(|| {
            format!("`{name}` isn't a compute entry point: name a function with `@compute`")
        })?;
        let size = size.map(|count| count.max(1));
        let invocations = size.iter().map(|count| u64::from(*count)).product::<u64>();
        if invocations > MOST_INVOCATIONS {
            return Err(format!(
                "a workgroup of `{name}` has {invocations} invocations, which is more than any device supports"
            ));
        }
        Ok((program, bindings, size))
    }

    /// The resources of an entry point; `None` if there is no such entry point.
    #[must_use]
    pub fn entry_point_bindings(&self, stage: Stage, name: &str) -> Option<Vec<Binding>> {
        let name = self.entry_point_name(name);
        let naga_stage = match stage {
            Stage::Vertex => naga::ShaderStage::Vertex,
            Stage::Fragment => naga::ShaderStage::Fragment,
            Stage::Compute => naga::ShaderStage::Compute,
            Stage::Other => return None,
        };
        let mut entries = self.checked.module.entry_points.iter();
        let index = entries.position(|entry| entry.name == name && entry.stage == naga_stage)?;
        let info = self.checked.info.get_entry_point(index);
        Some(self.bindings(info))
    }

    /// Checks if a compute entry point writes a resource. Returns `false` if the entry point only reads a `read_write`
    /// resource.
    #[must_use]
    pub fn writes(&self, entry_point: &str, binding: &Binding) -> bool {
        let (name, module) = (self.entry_point_name(entry_point), &self.checked.module);
        let index = module.entry_points.iter().position(|entry| entry.name == name);
        let place = naga::ResourceBinding { group: binding.group, binding: binding.binding };
        let mut all = module.global_variables.iter();
        let global = all.find(|(_, global)| global.binding == Some(place));
        index.zip(global).is_some_and(|(index, (global, _))| {
            let uses = self.checked.info.get_entry_point(index)[global];
            uses.contains(naga::valid::GlobalUse::WRITE)
        })
    }

    /// The resources and the workgroup size of the compute entry point with this name in the linked text.
    pub fn compute_entry_point(&self, name: &str) -> Option<(Vec<Binding>, [u32; 3])> {
        let (bindings, index) = self.resources_of(name, naga::ShaderStage::Compute)?;
        let size = self.workgroup_size(&self.checked.module.entry_points[index]);
        let size = size.map(|count| u32::try_from(count).unwrap_or(u32::MAX));
        Some((bindings, size))
    }

    /// The resources of the fragment entry point with this name in the linked text.
    pub fn fragment_entry_point(&self, name: &str) -> Option<Vec<Binding>> {
        self.resources_of(name, naga::ShaderStage::Fragment).map(|(bindings, _)| bindings)
    }

    fn resources_of(&self, name: &str, stage: naga::ShaderStage) -> Option<(Vec<Binding>, usize)> {
        let mut entries = self.checked.module.entry_points.iter();
        let index = entries.position(|entry| entry.name == name && entry.stage == stage)?;
        Some((self.bindings(self.checked.info.get_entry_point(index)), index))
    }

    /// Checks if a variable's type contains a matrix of two rows. GLSL's std140 layout puts the columns of such a
    /// matrix further apart than WGSL's layout does.
    pub(crate) fn has_narrow_matrix(&self, binding: &Binding) -> bool {
        fn has(module: &naga::Module, ty: naga::Handle<naga::Type>) -> bool {
            match &module.types[ty].inner {
                naga::TypeInner::Matrix { rows: naga::VectorSize::Bi, .. } => true,
                naga::TypeInner::Array { base, .. } => has(module, *base),
                naga::TypeInner::Struct { members, .. } => {
                    members.iter().any(|member| has(module, member.ty))
                }
                _ => false,
            }
        }
        has(&self.checked.module, binding.ty)
    }

    pub(crate) fn compute_entry_points(&self) -> Vec<String> {
        let entries = self.checked.module.entry_points.iter();
        let compute = entries.filter(|entry| entry.stage == naga::ShaderStage::Compute);
        let path = |text: &str| self.author_path(text).unwrap_or(text).to_owned();
        let names = compute.map(|entry| path(&entry.name));
        names.map(|path| path.rsplit("::").next().unwrap_or_default().to_owned()).collect()
    }

    pub(crate) fn variables(&self) -> Vec<String> {
        let globals = self.checked.module.global_variables.iter();
        let names = globals.filter_map(|(_, global)| global.name.as_deref());
        names.map(|name| self.author_path(name).unwrap_or(name).to_owned()).collect()
    }

    /// The location of an entry point's declaration, from `fn` to the name. `name` is the name in the linked text.
    pub(crate) fn entry_point_span(&self, name: &str) -> Option<Span> {
        let text = self.text();
        // The name ends before the parameters. Blanks may come between.
        let begins =
            |(at, head): &(usize, &str)| text[at + head.len()..].trim_start().starts_with('(');
        let head = format!("fn {name}");
        let (at, head) = text.match_indices(&*head).find(begins)?;
        self.resolve(at..at + head.len())
    }

    /// The smallest size of a buffer for the variable's type, in bytes. A runtime-sized array counts as one element.
    pub fn least_bytes(&self, binding: &Binding) -> usize {
        let inner = &self.checked.module.types[binding.ty].inner;
        inner.size(self.checked.module.to_ctx()) as usize
    }

    /// The offset in bytes of the member `member` in a buffer (`light.position`), and the scalars in `lanes` as bytes
    /// of this member.
    pub(crate) fn member_bytes(
        &self,
        binding: &Binding,
        member: &str,
        shape: &Shape,
        lanes: &[u32],
    ) -> Result<(usize, Vec<u8>), String> {
        let module = &self.checked.module;
        let (mut ty, mut offset) = (binding.ty, 0);
        for name in member.split('.').filter(|name| !name.is_empty()) {
            let naga::TypeInner::Struct { members, .. } = &module.types[ty].inner else {
                return Err(format!(
                    "the value before `.{name}` isn't a structure, so it has no members"
                ));
            };
            let names = || members.iter().filter_map(|member| member.name.as_deref());
            let known = members.iter().find(|member| member.name.as_deref() == Some(name));
            let Some(known) = known else {
                let near = crate::diagnostic::nearest(name, names());
                let near =
                    near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
                return Err(format!("the structure has no member `{name}`{near}"));
            };
            ty = known.ty;
            offset += known.offset as usize;
        }
        let wgsl = self.buffer_shape(ty).filter(|wgsl| shape.stands_for(wgsl, false));
        if wgsl.is_none() {
            let wgsl = self.buffer_shape(ty);
            let wgsl = wgsl.map_or_else(|| "of another type".to_owned(), |wgsl| wgsl.to_string());
            return Err(format!("`{member}` is {wgsl}, but the value is {shape}"));
        }
        let bytes = super::bytes_of(module, &self.checked.layouter, ty, lanes)
            .map_err(|error| error.to_string())?;
        let size = module.types[ty].inner.size(module.to_ctx()) as usize;
        Ok((offset, bytes[..size.min(bytes.len())].to_vec()))
    }

    /// A free binding number in group 0: the largest number that the program uses there, plus 1.
    pub fn free_binding(&self) -> u32 {
        let used = self.checked.module.global_variables.iter().filter_map(|(_, global)| {
            global.binding.as_ref().filter(|binding| binding.group == 0).map(|b| b.binding + 1)
        });
        used.max().unwrap_or(0)
    }

    pub(super) fn bindings(&self, info: &naga::valid::FunctionInfo) -> Vec<Binding> {
        let mut bindings: Vec<Binding> = self
            .checked
            .module
            .global_variables
            .iter()
            .filter(|(handle, _)| !info[*handle].is_empty())
            .filter_map(|(handle, global)| {
                let kind = BindingKind::of(global, &self.checked.module.types[global.ty].inner);
                let place = global.binding.as_ref().map(|place| (place.group, place.binding));
                let nowhere = (Binding::NOWHERE, Binding::NOWHERE);
                let place = place.or((kind == BindingKind::Immediate).then_some(nowhere));
                let (group, binding) = place?;
                let name = global.name.clone().expect(NAMED);
                let path = self.linked.names.get(&name).cloned().unwrap_or(name);
                let range = self.checked.module.global_variables.get_span(handle).to_range();
                let declared = range.and_then(|range| self.resolve(range));
                let taken_by = || self.taken_by(global.name.as_deref()?);
                let span = declared.or_else(|| taken_by().map(|taker| self.function_span(taker)));
                let sampled = info.sampling_set.iter().any(|key| key.image == handle);
                Some(Binding { path, group, binding, kind, span, sampled, ty: global.ty })
            })
            .collect();
        bindings.sort_by_key(|binding| (binding.group, binding.binding));
        bindings
    }
}
