//! Writes GLSL and GLSL ES.

use naga::back::glsl::{BindingMap, Options, PipelineOptions, Version, Writer, WriterFlags};
use naga::proc::{BoundsCheckPolicies, BoundsCheckPolicy};
use naga::{EntryPoint, ResourceBinding};

use super::{Job, RESTRICT, Written};
use crate::{Bindings, Code};

pub(super) fn write(job: &Job<'_>, version: Version) -> Result<Written, String> {
    let entry_point = one(job)?;
    let bindings = Bindings::in_a_row(job.module, job.info, Some(entry_point));
    let mut binding_map = BindingMap::new();
    for resource in bindings.iter() {
        let ((group, binding), (_, number)) = (resource.wgsl, resource.translated);
        let number = u8::try_from(number).map_err(|_| "the shader has more than 256 resources")?;
        binding_map.insert(ResourceBinding { group, binding }, number);
    }
    let options = Options {
        version,
        writer_flags: WriterFlags::ADJUST_COORDINATE_SPACE,
        binding_map,
        zero_initialize_workgroup_memory: true,
    };
    let pipeline = PipelineOptions {
        shader_stage: entry_point.stage,
        entry_point: entry_point.name.clone(),
        multiview: None,
    };
    let mut text = String::new();
    // In GLSL, naga can check only texel indices.
    let policies = match version {
        Version::Desktop(_) => RESTRICT,
        // The check of texel indices needs the number of mip levels, which GLSL ES can't query. wgpu doesn't check
        // these indices, either.
        Version::Embedded { .. } => {
            BoundsCheckPolicies { image_load: BoundsCheckPolicy::Unchecked, ..RESTRICT }
        }
    };
    let mut writer = Writer::new(&mut text, job.module, job.info, &options, &pipeline, policies)
        .map_err(|error| crate::shader::causes(&error))?;
    writer.write().map_err(|error| crate::shader::causes(&error))?;
    let is_es = matches!(version, Version::Embedded { .. });
    let version = match version {
        Version::Desktop(version) => format!("GLSL {version}"),
        Version::Embedded { version, .. } => format!("GLSL ES {version}"),
    };
    Ok(Written {
        code: Code::Text(text),
        entry_points: vec!["main".to_owned()],
        bindings,
        options: format!(
            "{version}; naga {}, sets workgroup memory to zero and flips the y axis",
            if is_es { "checks no indices" } else { "restricts only texel indices" }
        ),
    })
}

/// The entry point that becomes `main` in GLSL: the requested entry point, or the shader's only entry point.
fn one<'j>(job: &Job<'j>) -> Result<&'j EntryPoint, String> {
    match (job.entry_point, &*job.module.entry_points) {
        (Some(entry_point), _) | (None, [entry_point]) => Ok(entry_point),
        (None, []) => {
            Err("GLSL needs an entry point, but the shader has no entry point".to_owned())
        }
        (None, _) => {
            Err("a GLSL translation has only one entry point: name an entry point of the shader"
                .to_owned())
        }
    }
}
