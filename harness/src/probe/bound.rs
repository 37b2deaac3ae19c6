//! A compiled kernel with its bindings.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::kernel::ENTRY_POINT;
use super::{ProbeError, Resource};
use crate::path::Device;

/// The fixtures of each group, with their binding numbers.
pub(super) type Resources = BTreeMap<u32, Vec<(u32, Resource)>>;

/// A compiled kernel with its bindings.
pub(super) struct Bound {
    pub(super) pipeline: Arc<wgpu::ComputePipeline>,
    pub(super) groups: Vec<wgpu::BindGroup>,
}

/// Compiles a kernel.
pub(super) fn compile(
    device: &Device,
    function: &str,
    text: &str,
) -> Result<Arc<wgpu::ComputePipeline>, ProbeError> {
    device
        .compute_pipeline(text, ENTRY_POINT)
        .map_err(|error| ProbeError::Compile { function: function.to_owned(), error })
}

/// Binds the fixtures, and in group 0 the arguments, the results and the batch, in this order.
pub(super) fn bind(
    device: &Device,
    pipeline: Arc<wgpu::ComputePipeline>,
    resources: &Resources,
    first_binding: u32,
    own: [Option<&wgpu::Buffer>; 3],
) -> Result<Bound, ProbeError> {
    let last_group = resources.keys().copied().max().unwrap_or(0);
    let groups = device.checked(|| {
        (0..=last_group)
            .map(|group| {
                let mut entries: Vec<_> = resources
                    .get(&group)
                    .into_iter()
                    .flatten()
                    .map(|(binding, resource)| wgpu::BindGroupEntry {
                        binding: *binding,
                        resource: resource.binding(),
                    })
                    .collect();
                if group == 0 {
                    for (offset, buffer) in (0..).zip(own) {
                        entries.extend(buffer.map(|buffer| wgpu::BindGroupEntry {
                            binding: first_binding + offset,
                            resource: buffer.as_entire_binding(),
                        }));
                    }
                }
                device.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: None,
                    layout: &pipeline.get_bind_group_layout(group),
                    entries: &entries,
                })
            })
            .collect()
    })?;
    Ok(Bound { pipeline, groups })
}
