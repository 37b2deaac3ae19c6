//! The attributes that tie an entry point to its host: locations, builtin values, the size of a workgroup.

use naga::common::wgsl::TryToWgsl;
use naga::{Binding, Interpolation, ShaderStage, Type, TypeInner};

use super::{NAMED, Program};
use crate::value::Shape;

/// An input of an entry point that its host gives by location.
///
/// ```
/// use karat::unstable::reflect::{Input, Program};
/// # use karat::Package;
///
/// let text = "@vertex fn at(@location(0) place: vec3f) -> @builtin(position) vec4f { return vec4f(place, 1.0); }";
/// let program = Program::of_module(&Package::from_source("m", text), "")?;
/// let Input { location, name, shape } = &program.located_inputs("at")[0];
/// assert_eq!((*location, &**name, &*shape.to_string()), (0, "place", "vec3<f32>"));
/// # Ok::<(), karat::unstable::reflect::ReflectError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Input {
    /// `@location(0)`: 0.
    pub location: u32,
    /// The parameter, or the member of a structure.
    pub name: String,
    /// The type.
    pub shape: Shape,
}

impl Program {
    /// The inputs of an entry point that have a location; empty if there is no such entry point.
    #[must_use]
    pub fn located_inputs(&self, name: &str) -> Vec<Input> {
        let name = self.entry_point_name(name);
        let module = &self.checked.module;
        let Some(entry) = module.entry_points.iter().find(|entry| entry.name == name) else {
            return Vec::new();
        };
        let input = |name: &Option<String>, binding: &Option<Binding>, ty: naga::Handle<Type>| {
            let Some(Binding::Location { location, .. }) = binding else { return None };
            let shape = self.shape(ty).ok()?;
            Some(Input { location: *location, name: name.clone().expect(NAMED), shape })
        };
        let mut all = Vec::new();
        for argument in &entry.function.arguments {
            match &module.types[argument.ty].inner {
                TypeInner::Struct { members, .. } => all.extend(
                    members.iter().filter_map(|one| input(&one.name, &one.binding, one.ty)),
                ),
                _ => all.extend(input(&argument.name, &argument.binding, argument.ty)),
            }
        }
        all
    }

    /// The attributes of an entry point's inputs and outputs by their paths (`in.uv`, `result`), and the size of its
    /// workgroup; empty if there is no such entry point.
    pub(crate) fn attributes(&self, name: &str) -> Vec<(String, String)> {
        let name = self.entry_point_name(name);
        let module = &self.checked.module;
        let Some(entry) = module.entry_points.iter().find(|entry| entry.name == name) else {
            return Vec::new();
        };
        let mut all = Vec::new();
        let mut add = |path: &str, binding: Option<&Binding>, ty: naga::Handle<Type>| {
            all.extend(binding.map(|binding| (path.to_owned(), shown(binding))));
            if let (None, TypeInner::Struct { members, .. }) = (binding, &module.types[ty].inner) {
                all.extend(members.iter().filter_map(|member| {
                    let own = member.name.as_deref().expect(NAMED);
                    Some((format!("{path}.{own}"), shown(member.binding.as_ref()?)))
                }));
            }
        };
        for argument in &entry.function.arguments {
            let name = argument.name.as_deref().expect(NAMED);
            add(name, argument.binding.as_ref(), argument.ty);
        }
        if let Some(result) = &entry.function.result {
            add("result", result.binding.as_ref(), result.ty);
        }
        if entry.stage == ShaderStage::Compute {
            let [x, y, z] = entry.workgroup_size;
            all.push((name.to_owned(), format!("@workgroup_size({x}, {y}, {z})")));
        }
        all
    }
}

/// An attribute as its author may write it.
fn shown(binding: &Binding) -> String {
    match binding {
        Binding::BuiltIn(builtin) => format!("@builtin({})", builtin.to_wgsl_for_diagnostics()),
        Binding::Location { location, interpolation, sampling, .. } => {
            let how = match (interpolation, sampling) {
                (None | Some(Interpolation::Perspective), None | Some(naga::Sampling::Center)) => {
                    String::new()
                }
                (interpolation, sampling) => {
                    let of = |text: String| text.to_lowercase();
                    let kind = interpolation.map(|kind| of(format!("{kind:?}")));
                    let sampling = sampling.map(|one| of(format!("{one:?}")));
                    let parts: Vec<String> = kind.into_iter().chain(sampling).collect();
                    format!(" @interpolate({})", parts.join(", "))
                }
            };
            format!("@location({location}){how}")
        }
    }
}
