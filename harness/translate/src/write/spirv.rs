//! Writes SPIR-V.

use naga::back::spv::{Options, PipelineOptions, WriterFlags, ZeroInitializeWorkgroupMemoryMode};

use super::{Job, RESTRICT, RESTRICTED, Written};
use crate::{Bindings, Code};

pub(super) fn write(job: &Job<'_>) -> Result<Written, String> {
    let options = Options {
        // wgpu uses this version for Vulkan 1.1 and later.
        lang_version: (1, 3),
        flags: WriterFlags::ADJUST_COORDINATE_SPACE
            | WriterFlags::LABEL_VARYINGS
            | WriterFlags::CLAMP_FRAG_DEPTH
            | WriterFlags::DEBUG,
        bounds_check_policies: RESTRICT,
        zero_initialize_workgroup_memory: ZeroInitializeWorkgroupMemoryMode::Polyfill,
        ..Options::default()
    };
    let entry_point = job
        .entry_point
        .map(|e| PipelineOptions { shader_stage: e.stage, entry_point: e.name.clone() });
    let words = naga::back::spv::write_vec(job.module, job.info, &options, entry_point.as_ref())
        .map_err(|error| crate::shader::causes(&error))?;
    Ok(Written {
        code: Code::Words(words),
        entry_points: job.names(),
        bindings: Bindings::kept(job.module),
        options: format!(
            "SPIR-V 1.3; naga {RESTRICTED}, sets workgroup memory to zero, bounds loops and flips the y axis"
        ),
    })
}
