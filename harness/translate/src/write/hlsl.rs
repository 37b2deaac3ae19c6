//! Writes HLSL.

use naga::back::hlsl::{
    BindTarget, Options, PipelineOptions, SamplerHeapBindTargets, SamplerIndexBufferKey,
    ShaderModel, Writer,
};
use naga::{Binding, BuiltIn, Function, Module, ResourceBinding, TypeInner};

use super::{Job, Written};
use crate::{Bindings, Code};

/// The register space of naga's sampler heap. The next constants are the spaces of other resources that naga adds.
/// The shader's own resources are in space 0.
const SAMPLERS: u8 = 1;
const SAMPLER_INDICES: u8 = 2;
const CONSTANTS: u8 = 3;
const IMMEDIATES: u8 = 4;

/// The number of ordinary samplers in naga's sampler heap. Comparison samplers follow.
const HEAP: u32 = 2048;

pub(super) fn write(job: &Job<'_>, shader_model: ShaderModel) -> Result<Written, String> {
    let bindings = Bindings::in_a_row(job.module, job.info, job.entry_point);
    let target = |space: u8, register: u32| BindTarget { space, register, ..BindTarget::default() };
    let mut indices = std::collections::BTreeMap::new();
    let mut binding_map = std::collections::BTreeMap::new();
    for resource in bindings.iter() {
        let ((group, binding), (space, number)) = (resource.wgsl, resource.translated);
        let space = u8::try_from(space).expect("all are in group 0");
        let checked = BindTarget { restrict_indexing: true, ..target(space, number) };
        binding_map.insert(ResourceBinding { group, binding }, checked);
        indices.insert(SamplerIndexBufferKey { group }, target(SAMPLER_INDICES, group));
    }
    let options = Options {
        shader_model,
        binding_map,
        sampler_heap_target: SamplerHeapBindTargets {
            standard_samplers: target(SAMPLERS, 0),
            comparison_samplers: target(SAMPLERS, HEAP),
        },
        sampler_buffer_binding_map: indices,
        special_constants_binding: needs_constants(job.module).then(|| target(CONSTANTS, 0)),
        immediates_target: Some(target(IMMEDIATES, 0)),
        ..Options::default()
    };
    let pipeline =
        PipelineOptions { entry_point: job.entry_point.map(|e| (e.stage, e.name.clone())) };
    let mut text = String::new();
    let reflection = Writer::new(&mut text, &options, &pipeline)
        .write(job.module, job.info, None)
        .map_err(|error| crate::shader::causes(&error))?;
    let mut names = Vec::new();
    for name in reflection.entry_point_names {
        names.push(name.map_err(|error| crate::shader::causes(&error))?);
    }
    Ok(Written {
        code: Code::Text(text),
        entry_points: names,
        bindings,
        options: format!(
            "HLSL for shader model {}; naga restricts indices, sets workgroup memory to zero and bounds \
             loops",
            shader_model.to_str().replace('_', ".")
        ),
    })
}

/// Checks if a compute entry point needs a value from the host in an HLSL constant buffer.
pub(crate) fn takes_constants(module: &Module, entry_point: &str) -> bool {
    let mut all = module.entry_points.iter();
    all.find(|one| one.name == entry_point).is_some_and(|one| asks_constants(module, &one.function))
}

/// Checks if an entry point of the module uses a builtin value that differs between Direct3D and Vulkan, such as
/// `vertex_index`. In HLSL, such an entry point reads the value from a buffer that the host fills.
fn needs_constants(module: &Module) -> bool {
    module.entry_points.iter().any(|one| asks_constants(module, &one.function))
}

fn asks_constants(module: &Module, function: &Function) -> bool {
    let asks = |binding: &Option<Binding>| {
        matches!(
            binding,
            Some(Binding::BuiltIn(
                BuiltIn::VertexIndex | BuiltIn::InstanceIndex | BuiltIn::NumWorkGroups
            ))
        )
    };
    function.arguments.iter().any(|argument| {
        asks(&argument.binding)
            || matches!(&module.types[argument.ty].inner, TypeInner::Struct { members, .. }
                if members.iter().any(|member| asks(&member.binding)))
    })
}
