//! A compiled kernel with its bindings.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::kernel::{ENTRY_POINT, Kernel};
use super::{ProbeError, Resource, quads};
use crate::path::{Device, PathError, Pipeline};

/// The fixtures in each bind group, with their binding numbers. Immediates aren't bound, so they are listed under a
/// separate group number.
pub(super) type Resources = BTreeMap<u32, Vec<(u32, Resource)>>;

pub(super) struct Bound {
    pub(super) pipeline: Compiled,
    pub(super) groups: Vec<wgpu::BindGroup>,
    /// The bytes of the immediates (`var<immediate>`), which Karat sets in the commands of each run.
    immediates: Option<Vec<u8>>,
}

pub(super) enum Compiled {
    Dispatched(Arc<Pipeline>),
    Drawn(wgpu::RenderPipeline),
}

impl Compiled {
    /// Converts a resource's group and binding number in WGSL to its group and binding number in the pipeline.
    fn place(&self, group: u32, binding: u32) -> Option<(u32, u32)> {
        match self {
            Self::Dispatched(pipeline) => pipeline.place(group, binding),
            Self::Drawn(_) => Some((group, binding)),
        }
    }

    fn layout(&self, group: u32) -> wgpu::BindGroupLayout {
        match self {
            Self::Dispatched(pipeline) => pipeline.pipeline.get_bind_group_layout(group),
            Self::Drawn(pipeline) => pipeline.get_bind_group_layout(group),
        }
    }

    fn is_foreign(&self) -> bool {
        matches!(self, Self::Dispatched(pipeline) if pipeline.is_foreign())
    }
}

impl Bound {
    pub(super) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, cases: usize) {
        let Compiled::Drawn(pipeline) = &self.pipeline else { return };
        pass.set_pipeline(pipeline);
        for (index, group) in (0..).zip(&self.groups) {
            pass.set_bind_group(index, group, &[]);
        }
        if let Some(bytes) = &self.immediates {
            pass.set_immediates(0, bytes);
        }
        pass.draw(0..3, 0..u32::try_from(cases).expect("a batch fits in 32 bits"));
    }

    pub(super) fn set(&self, pass: &mut wgpu::ComputePass<'_>) {
        let Compiled::Dispatched(pipeline) = &self.pipeline else { return };
        pass.set_pipeline(&pipeline.pipeline);
        for (index, group) in (0..).zip(&self.groups) {
            pass.set_bind_group(index, group, &[]);
        }
        if let Some(bytes) = &self.immediates {
            pass.set_immediates(0, bytes);
        }
    }
}

pub(super) fn compile(
    device: &Device,
    function: &str,
    text: &str,
    kernel: &Kernel,
) -> Result<Compiled, ProbeError> {
    if kernel.is_drawn() {
        let pipeline = quads::compile(device, function, text, &kernel.overrides)?;
        return Ok(Compiled::Drawn(pipeline));
    }
    let pipeline = device.compute_pipeline(text, ENTRY_POINT, &kernel.overrides);
    let pipeline =
        pipeline.map_err(|error| ProbeError::Compile { function: function.to_owned(), error })?;
    Ok(Compiled::Dispatched(pipeline))
}

/// Binds the fixtures. Group 0 also gets three buffers, in this order: the arguments, the results, and the numbers that
/// describe the batch.
pub(super) fn bind(
    device: &Device,
    pipeline: Compiled,
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
        let message =
            "Karat can't pass immediates to a shader that naga didn't translate".to_owned();
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
                layout: &pipeline.layout(group),
                entries: entries.get(&group).map_or(&[], Vec::as_slice),
            })
        };
        (0..=last_group).map(group).collect()
    })?;
    Ok(Bound { pipeline, groups, immediates })
}
