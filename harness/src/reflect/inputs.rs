//! Reads entry points' inputs that have a `@location`, such as vertex attributes.

use naga::{Binding, Type, TypeInner};

use super::{NAMED, Program};
use crate::value::Shape;

/// An entry point's input that has a `@location`. The host supplies the value of the input, for example from a vertex
/// buffer.
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
    /// The number of the location: 0 for `@location(0)`.
    pub location: u32,
    /// The name of the parameter, or of the structure's member.
    pub name: String,
    /// The type.
    pub shape: Shape,
}

impl Program {
    /// The inputs of an entry point that have a `@location`. The list is empty if there is no such entry point.
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
}
