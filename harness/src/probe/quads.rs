//! Compiles kernels that call a function in a fragment shader, and makes their render targets.

use super::ProbeError;
use super::kernel::{CELL, ENTRY_POINT, VERTEX};
use crate::path::Device;
use crate::reflect::{Overrides, on_deep_stack, parsed_with};

/// The format of the target. Nothing reads the target.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

pub(super) struct Target {
    view: wgpu::TextureView,
    /// The number of quads in a row, and the number of rows.
    pub(super) grid: [u32; 2],
}

impl Target {
    pub(super) fn new(device: &Device, cases: usize) -> Result<Self, ProbeError> {
        let cases = u32::try_from(cases).expect("a batch fits in 32 bits").max(1);
        let columns = cases.isqrt() + u32::from(!cases.isqrt().pow(2).eq(&cases));
        let rows = cases.div_ceil(columns);
        let view = device.checked(|| {
            let texture = device.device.create_texture(&wgpu::TextureDescriptor {
                label: Some("quads"),
                size: wgpu::Extent3d {
                    width: CELL * columns,
                    height: CELL * rows,
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: FORMAT,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            });
            texture.create_view(&wgpu::TextureViewDescriptor::default())
        })?;
        Ok(Self { view, grid: [columns, rows] })
    }

    /// Begins a render pass whose draws change only the first pixel of the target.
    pub(super) fn pass_of_one<'e>(
        &self,
        encoder: &'e mut wgpu::CommandEncoder,
    ) -> wgpu::RenderPass<'e> {
        let mut pass = self.pass(encoder);
        pass.set_scissor_rect(0, 0, 1, 1);
        pass
    }

    pub(super) fn pass<'e>(&self, encoder: &'e mut wgpu::CommandEncoder) -> wgpu::RenderPass<'e> {
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations::default(),
            })],
            ..wgpu::RenderPassDescriptor::default()
        })
    }
}

pub(super) fn compile(
    device: &Device,
    function: &str,
    text: &str,
    overrides: &Overrides,
) -> Result<wgpu::RenderPipeline, ProbeError> {
    let failed = |error| ProbeError::Compile { function: function.to_owned(), error };
    let module = parsed_with(text, overrides).map_err(|message| {
        failed(crate::path::PathError::Driver { path: device.path(), message })
    })?;
    on_deep_stack(|| {
        let module = device.drawn((*module).clone())?;
        device.made(|| {
            let source = wgpu::ShaderSource::Naga(std::borrow::Cow::Owned(module));
            let descriptor = wgpu::ShaderModuleDescriptor { label: None, source };
            let module = device.device.create_shader_module(descriptor);
            device.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(ENTRY_POINT),
                layout: None,
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(VERTEX),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers: &[],
                },
                primitive: wgpu::PrimitiveState::default(),
                depth_stencil: None,
                multisample: wgpu::MultisampleState::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(ENTRY_POINT),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    targets: &[Some(FORMAT.into())],
                }),
                multiview_mask: None,
                cache: None,
            })
        })
    })
    .map_err(failed)
}
