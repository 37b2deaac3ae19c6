//! A compiled kernel with its bindings.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::kernel::ENTRY_POINT;
use super::{ProbeError, Resource};
use crate::path::{Device, PathError, Pipeline};

/// The fixtures of each group, with their binding numbers; immediates are in a group that isn't one.
pub(super) type Resources = BTreeMap<u32, Vec<(u32, Resource)>>;

/// A compiled kernel with its bindings.
pub(super) struct Bound {
    pub(super) pipeline: Arc<Pipeline>,
    pub(super) groups: Vec<wgpu::BindGroup>,
    /// What is set with the commands.
    immediates: Option<Vec<u8>>,
}

impl Bound {
    /// Sets all that a dispatch needs.
    pub(super) fn set(&self, pass: &mut wgpu::ComputePass<'_>) {
        pass.set_pipeline(&self.pipeline.pipeline);
        for (index, group) in (0..).zip(&self.groups) {
            pass.set_bind_group(index, group, &[]);
        }
        if let Some(bytes) = &self.immediates {
            pass.set_immediates(0, bytes);
        }
    }
}

/// Compiles a kernel.
pub(super) fn compile(
    device: &Device,
    function: &str,
    text: &str,
) -> Result<Arc<Pipeline>, ProbeError> {
    device
        .compute_pipeline(text, ENTRY_POINT)
        .map_err(|error| ProbeError::Compile { function: function.to_owned(), error })
}

/// Binds the fixtures, and in group 0 the arguments, the results and the batch, in this order.
pub(super) fn bind(
    device: &Device,
    pipeline: Arc<Pipeline>,
    resources: &Resources,
    first_binding: u32,
    own: [Option<&wgpu::Buffer>; 3],
) -> Result<Bound, ProbeError> {
    let fixtures = resources.iter().flat_map(|(group, resources)| {
        let bound = resources.iter().filter_map(|(at, resource)| Some((at, resource.binding()?)));
        bound.map(|(binding, resource)| ((*group, *binding), resource))
    });
    let immediates = resources.values().flatten().find_map(|(_, resource)| match resource {
        Resource::Immediate(bytes) => Some(bytes.clone()),
        _ => None,
    });
    if immediates.is_some() && pipeline.is_foreign() {
        let message = "immediates aren't passed to shaders of other compilers".to_owned();
        return Err(PathError::Route { path: device.path(), message }.into());
    }
    let own = (first_binding..).zip(own).filter_map(|(binding, buffer)| {
        buffer.map(|buffer| ((0, binding), buffer.as_entire_binding()))
    });
    let mut entries: BTreeMap<u32, Vec<wgpu::BindGroupEntry<'_>>> = BTreeMap::new();
    for ((group, binding), resource) in fixtures.chain(own) {
        if let Some((group, binding)) = pipeline.place(group, binding) {
            entries.entry(group).or_default().push(wgpu::BindGroupEntry { binding, resource });
        }
    }
    let last_group = entries.keys().copied().max().unwrap_or(0);
    let groups = device.checked(|| {
        let group = |group| {
            device.device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: None,
                layout: &pipeline.pipeline.get_bind_group_layout(group),
                entries: entries.get(&group).map_or(&[], Vec::as_slice),
            })
        };
        (0..=last_group).map(group).collect()
    })?;
    Ok(Bound { pipeline, groups, immediates })
}
