//! Generates a vertex function for fragment functions that have none. The vertex function's triangle covers the
//! frame.

use naga::{Binding, ShaderStage, TypeInner, VectorSize};

use super::{Program, ReflectError};
use crate::diagnostic::Diagnostic;

pub(crate) const COVERING: &str = "karat_covering";

impl Program {
    /// The text of a vertex function whose triangle covers the frame. The vertex function writes texture coordinates to
    /// each location that the fragment function reads. The coordinates are (0, 0) at the frame's upper left, and (1, 1)
    /// at its lower right.
    ///
    /// # Errors
    /// Returns an error if an input of the fragment function has a location and isn't a `vec2f`.
    pub(crate) fn covering(&self, fragment: &str) -> Result<String, ReflectError> {
        let name = self.entry_point_name(fragment);
        let module = &self.checked.module;
        let mut entries = module.entry_points.iter();
        let found = entries.find(|e| e.name == name && e.stage == ShaderStage::Fragment);
        let Some(entry) = found else { return Ok(String::new()) };
        let mut inputs = Vec::new();
        for argument in &entry.function.arguments {
            match (&argument.binding, &module.types[argument.ty].inner) {
                (Some(binding), inner) => inputs.push((binding, inner)),
                (None, TypeInner::Struct { members, .. }) => {
                    inputs.extend(members.iter().filter_map(|member| {
                        Some((member.binding.as_ref()?, &module.types[member.ty].inner))
                    }))
                }
                _ => {}
            }
        }
        let (mut members, mut values) = (String::new(), String::new());
        for (binding, inner) in inputs {
            let Binding::Location { location, interpolation, sampling, .. } = binding else {
                continue;
            };
            let is_uv = matches!(
                inner,
                TypeInner::Vector { size: VectorSize::Bi, scalar: naga::Scalar::F32 }
            );
            if !is_uv {
                let message =
                    format!("the input of `{fragment}` at @location({location}) isn't a vec2f");
                let note = "without a vertex function, a fragment function gets only texture coordinates. For other \
                            inputs, name a vertex function: with `fullscreen` in Rust, or `vertex` in a test file";
                let diagnostic = Diagnostic::new(message).note(note);
                let diagnostic = match self.entry_point_span(name) {
                    Some(span) => diagnostic.at(span, "declared here"),
                    None => diagnostic,
                };
                return Err(ReflectError::Unprobeable(Box::new(diagnostic)));
            }
            let word = |text: String| text.to_lowercase();
            let how = match (interpolation, sampling) {
                (Some(kind), Some(sampling)) => {
                    let (kind, sampling) =
                        (word(format!("{kind:?}")), word(format!("{sampling:?}")));
                    format!("@interpolate({kind}, {sampling}) ")
                }
                (Some(kind), None) => format!("@interpolate({}) ", word(format!("{kind:?}"))),
                _ => String::new(),
            };
            members += &format!("    @location({location}) {how}uv_{location}: vec2f,\n");
            values += ", uv";
        }
        Ok(format!(
            "struct Corner {{\n    @builtin(position) position: vec4f,\n{members}}}\n\
             @vertex fn {COVERING}(@builtin(vertex_index) index: u32) -> Corner {{\n    \
             let uv = vec2f(f32(index & 1u), f32(index >> 1u)) * 2.0;\n    \
             return Corner(vec4f(2.0 * uv.x - 1.0, 1.0 - 2.0 * uv.y, 0.0, 1.0){values});\n}}\n"
        ))
    }
}
