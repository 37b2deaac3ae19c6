//! Calls naga's back ends with wgpu's options.

mod glsl;
pub(crate) mod hlsl;
mod msl;
mod spirv;
mod wgsl;

use std::borrow::Cow;

use naga::back::pipeline_constants::process_overrides;
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::valid::ModuleInfo;
use naga::{EntryPoint, Module};

use crate::{Bindings, Code, Shader, Stage, Target, Translation};

struct Written {
    code: Code,
    /// The names of the entry points in the translation: the requested entry point, or all entry points in the module's
    /// order.
    entry_points: Vec<String>,
    bindings: Bindings,
    options: String,
}

struct Job<'j> {
    module: &'j Module,
    info: &'j ModuleInfo,
    entry_point: Option<&'j EntryPoint>,
}

impl Job<'_> {
    /// The WGSL names of the requested entry points.
    fn names(&self) -> Vec<String> {
        match self.entry_point {
            Some(one) => vec![one.name.clone()],
            None => self.module.entry_points.iter().map(|e| e.name.clone()).collect(),
        }
    }
}

/// The policy by which naga clamps indices to their range. wgpu uses the same policy if a driver doesn't check indices.
const RESTRICT: BoundsCheckPolicies = BoundsCheckPolicies {
    index: BoundsCheckPolicy::Restrict,
    buffer: BoundsCheckPolicy::Restrict,
    image_load: BoundsCheckPolicy::Restrict,
    // wgpu doesn't check the indices of binding arrays.
    binding_array: BoundsCheckPolicy::Unchecked,
};

/// The description of [`RESTRICT`] in reports.
const RESTRICTED: &str = "restricts indices";

pub(crate) fn write(
    shader: &Shader,
    target: Target,
    entry_point: Option<&EntryPoint>,
) -> Result<Translation, String> {
    let wanted = entry_point.map(|e| (e.stage, e.name.as_str()));
    // Unlike all other languages, WGSL keeps the overrides.
    let (module, info) = if target == Target::Wgsl || shader.module.overrides.is_empty() {
        (Cow::Borrowed(&shader.module), Cow::Borrowed(&shader.info))
    } else {
        process_overrides(&shader.module, &shader.info, wanted, &Default::default())
            .map_err(|error| crate::shader::causes(&error))?
    };
    let find =
        |(stage, name)| module.entry_points.iter().find(|e| e.stage == stage && e.name == name);
    let job = Job { module: &module, info: &info, entry_point: wanted.and_then(find) };
    let written = match target {
        Target::Spirv => spirv::write(&job),
        Target::Glsl => glsl::write(&job, naga::back::glsl::Version::Desktop(450)),
        Target::GlslEs => glsl::write(&job, naga::back::glsl::Version::new_gles(310)),
        Target::Hlsl => hlsl::write(&job, naga::back::hlsl::ShaderModel::V5_1),
        Target::Hlsl6 => hlsl::write(&job, naga::back::hlsl::ShaderModel::V6_2),
        Target::Msl => msl::write(&job),
        Target::Wgsl => wgsl::write(&job),
    }?;
    let stages = match job.entry_point {
        Some(one) => vec![one.stage],
        None => job.module.entry_points.iter().map(|e| e.stage).collect(),
    };
    let entry_points = stages
        .into_iter()
        .zip(written.entry_points)
        .map(|(stage, name)| crate::EntryPoint { stage: Stage::of(stage), name });
    Ok(Translation {
        target,
        code: written.code,
        entry_points: entry_points.collect(),
        bindings: written.bindings,
        options: written.options,
        uniforms: crate::layout::uniform_structures(&module, &info, job.entry_point),
    })
}
