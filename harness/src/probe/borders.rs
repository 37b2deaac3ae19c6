//! Fills the border texels of cube maps.
//!
//! SwiftShader stores each face with a border of texels from the neighbouring faces. Its linear filter reads this
//! border at the edges of faces. SwiftShader fills the border when a draw uses the cube map, but not when a dispatch
//! does: only `Renderer.cpp` calls `DescriptorSet::PrepareForSampling`, and `ComputeProgram.cpp` doesn't. So a kernel
//! would read stale texels. Applications sample cube maps mostly in fragment shaders, where SwiftShader fills the
//! border. Karat calls the functions in kernels, so it first draws once with each cube map.

use crate::path::{Device, PathError};

/// A shader that draws a triangle outside of the target. The driver prepares the cube map even if the draw shades no
/// pixel.
const NOTHING: &str = "
@vertex fn vertex() -> @builtin(position) vec4f { return vec4f(2.0, 2.0, 0.0, 1.0); }
@fragment fn fragment() -> @location(0) vec4f { return vec4f(0.0); }
";

/// The format of the target, which has one pixel. The contents don't matter.
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Makes the driver fill the borders of a new cube map, on drivers that need a draw for this.
pub(super) fn fill(device: &Device, cube_map: &wgpu::TextureView) -> Result<(), PathError> {
    if !device.fills_borders_by_draws() {
        return Ok(());
    }
    device.checked(|| draw(device, cube_map))
}

fn draw(device: &Device, cube_map: &wgpu::TextureView) {
    let Device { device, queue, .. } = device;
    let group_layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries: &[wgpu::BindGroupLayoutEntry {
            binding: 0,
            visibility: wgpu::ShaderStages::FRAGMENT,
            ty: wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable: true },
                view_dimension: wgpu::TextureViewDimension::Cube,
                multisampled: false,
            },
            count: None,
        }],
    });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &group_layout,
        entries: &[wgpu::BindGroupEntry {
            binding: 0,
            resource: wgpu::BindingResource::TextureView(cube_map),
        }],
    });
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        bind_group_layouts: &[Some(&group_layout)],
        ..wgpu::PipelineLayoutDescriptor::default()
    });
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(NOTHING.into()),
    });
    let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        fragment: Some(wgpu::FragmentState {
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(FORMAT.into())],
        }),
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        multiview_mask: None,
        cache: None,
    });
    let target = device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d::default(),
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: FORMAT,
        usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
        view_formats: &[],
    });
    let target = target.create_view(&wgpu::TextureViewDescriptor::default());
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &target,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations::default(),
            })],
            ..wgpu::RenderPassDescriptor::default()
        });
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
    }
    queue.submit([encoder.finish()]);
}

#[cfg(test)]
mod tests;
