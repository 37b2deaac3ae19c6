//! Describes entry points as pipelines with automatic layouts, because compilers check some rules only for
//! pipelines.

use std::fmt::Write;

use naga::{
    Binding, BuiltIn, EntryPoint, Handle, Interpolation, Sampling, ScalarKind, ShaderStage, Type,
    TypeInner,
};

use super::Program;
use crate::tint::{Attribute, Pipeline};

impl Program {
    /// A pipeline for each vertex, fragment and compute entry point. The list is empty if an override has no value.
    pub fn pipelines(&self) -> Vec<Pipeline> {
        let module = &self.checked.module;
        // Only the author's program knows the value of an override without an initial value. Any other value may
        // be wrong.
        if module.overrides.iter().any(|(_, one)| one.init.is_none()) {
            return Vec::new();
        }
        let one = |entry: &EntryPoint| {
            let mut pipeline = Pipeline { entry_point: entry.name.clone(), ..Pipeline::default() };
            match entry.stage {
                ShaderStage::Compute => pipeline.stage = "compute",
                ShaderStage::Vertex => {
                    pipeline.stage = "vertex";
                    for (binding, ty) in self.inputs(entry) {
                        if let Binding::Location { location, .. } = binding {
                            let format = self.vertex_format(ty)?;
                            pipeline.attributes.push(Attribute { location, format });
                        }
                    }
                }
                ShaderStage::Fragment => {
                    pipeline.stage = "fragment";
                    pipeline.feeder = self.feeder(entry)?;
                    for (binding, ty) in self.outputs(entry) {
                        if let Binding::Location { location, .. } = binding {
                            let at = usize::try_from(location).ok()?;
                            let length = pipeline.targets.len().max(at + 1);
                            pipeline.targets.resize(length, None);
                            pipeline.targets[at] = Some(self.target_format(ty)?);
                        }
                    }
                }
                _ => return None,
            }
            Some(pipeline)
        };
        module.entry_points.iter().filter_map(one).collect()
    }

    pub(super) fn locations(&self, entry: &EntryPoint) -> (Vec<u32>, Vec<u32>) {
        let locations = |all: Vec<(Binding, Handle<Type>)>| {
            let location = |(binding, _): (Binding, Handle<Type>)| match binding {
                Binding::Location { location, blend_src: None | Some(0), .. } => Some(location),
                _ => None,
            };
            all.into_iter().filter_map(location).collect()
        };
        (locations(self.inputs(entry)), locations(self.outputs(entry)))
    }

    pub(super) fn inputs(&self, entry: &EntryPoint) -> Vec<(Binding, Handle<Type>)> {
        let arguments = entry.function.arguments.iter();
        arguments.flat_map(|one| self.bound(one.binding.as_ref(), one.ty)).collect()
    }

    pub(super) fn outputs(&self, entry: &EntryPoint) -> Vec<(Binding, Handle<Type>)> {
        let result = entry.function.result.iter();
        result.flat_map(|one| self.bound(one.binding.as_ref(), one.ty)).collect()
    }

    /// The binding and the type of an input or output; for a structure, the bindings and types of its members.
    fn bound(&self, binding: Option<&Binding>, ty: Handle<Type>) -> Vec<(Binding, Handle<Type>)> {
        match (binding, &self.checked.module.types[ty].inner) {
            (Some(binding), _) => vec![(binding.clone(), ty)],
            (None, TypeInner::Struct { members, .. }) => {
                let members = members.iter();
                members.filter_map(|one| Some((one.binding.clone()?, one.ty))).collect()
            }
            (None, _) => Vec::new(),
        }
    }

    /// The component type and the number of components of a scalar or a vector.
    fn scalars_of(&self, ty: Handle<Type>) -> Option<(naga::Scalar, usize)> {
        match self.checked.module.types[ty].inner {
            TypeInner::Scalar(scalar) => Some((scalar, 1)),
            TypeInner::Vector { size, scalar } => Some((scalar, size as usize)),
            _ => None,
        }
    }

    fn vertex_format(&self, ty: Handle<Type>) -> Option<&'static str> {
        let (scalar, count) = self.scalars_of(ty)?;
        let formats = match scalar.kind {
            ScalarKind::Float => ["float32", "float32x2", "float32x3", "float32x4"],
            ScalarKind::Sint => ["sint32", "sint32x2", "sint32x3", "sint32x4"],
            ScalarKind::Uint => ["uint32", "uint32x2", "uint32x3", "uint32x4"],
            _ => return None,
        };
        formats.get(count - 1).copied()
    }

    /// A format for the colour target of an output. One component is enough, because a fragment stage may write more
    /// components than the format has.
    fn target_format(&self, ty: Handle<Type>) -> Option<&'static str> {
        match self.scalars_of(ty)?.0.kind {
            ScalarKind::Float => Some("r8unorm"),
            ScalarKind::Sint => Some("r8sint"),
            ScalarKind::Uint => Some("r8uint"),
            _ => None,
        }
    }

    /// The text of a module with a vertex stage that supplies all inputs of a fragment stage.
    fn feeder(&self, entry: &EntryPoint) -> Option<String> {
        let (mut members, mut halves, mut clips) = (String::new(), false, false);
        for (binding, ty) in self.inputs(entry) {
            match binding {
                Binding::Location { location, interpolation, sampling, .. } => {
                    let (scalar, count) = self.scalars_of(ty)?;
                    halves |= scalar.width == 2;
                    let name = match (scalar.kind, scalar.width) {
                        (ScalarKind::Float, 4) => "f32",
                        (ScalarKind::Float, 2) => "f16",
                        (ScalarKind::Sint, 4) => "i32",
                        (ScalarKind::Uint, 4) => "u32",
                        _ => return None,
                    };
                    let ty = match count {
                        1 => name.to_owned(),
                        count => format!("vec{count}<{name}>"),
                    };
                    let how = interpolated(interpolation, sampling)?;
                    writeln!(members, "@location({location}) {how}v{location}: {ty},").ok()?;
                }
                Binding::BuiltIn(BuiltIn::ClipDistances) => clips = true,
                Binding::BuiltIn(_) => {}
            }
        }
        if clips {
            return None;
        }
        let enable = if halves { "enable f16;\n" } else { "" };
        Some(format!(
            "{enable}struct Fed {{\n@builtin(position) position: vec4f,\n{members}}}\n\
             @vertex fn karat_feeds() -> Fed {{ return Fed(); }}\n"
        ))
    }
}

fn interpolated(
    interpolation: Option<Interpolation>,
    sampling: Option<Sampling>,
) -> Option<String> {
    let interpolation = match interpolation {
        None => return Some(String::new()),
        Some(Interpolation::Perspective) => "perspective",
        Some(Interpolation::Linear) => "linear",
        Some(Interpolation::Flat) => "flat",
        Some(_) => return None,
    };
    Some(match sampling {
        None => format!("@interpolate({interpolation}) "),
        Some(Sampling::Center) => format!("@interpolate({interpolation}, center) "),
        Some(Sampling::Centroid) => format!("@interpolate({interpolation}, centroid) "),
        Some(Sampling::Sample) => format!("@interpolate({interpolation}, sample) "),
        Some(Sampling::First) => format!("@interpolate({interpolation}, first) "),
        Some(Sampling::Either) => format!("@interpolate({interpolation}, either) "),
    })
}
