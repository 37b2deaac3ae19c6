//! Reads depths as numbers. A shader loads the depths, because drivers copy depth textures in different ways.

use crate::path::Device;

/// A shader that loads each pixel's depth into a buffer, row by row.
const LOAD: &str = "
@group(0) @binding(0) var depth: texture_2d<f32>;
@group(0) @binding(1) var<storage, read_write> depths: array<f32>;
@compute @workgroup_size(8, 8) fn load(@builtin(global_invocation_id) at: vec3u) {
    let size = textureDimensions(depth);
    if all(at.xy < size) {
        depths[at.y * (arrayLength(&depths) / size.y) + at.x] = textureLoad(depth, at.xy, 0).x;
    }
}
";

/// The width and height of a workgroup, in invocations.
const SIDE: u32 = 8;

/// Writes the depths of all pixels into a new buffer with the size `bytes`. All rows have the same number of bytes.
pub(super) fn load(
    device: &Device,
    encoder: &mut wgpu::CommandEncoder,
    depth: &wgpu::Texture,
    bytes: u64,
) -> wgpu::Buffer {
    let device = &device.device;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some("depth"),
        source: wgpu::ShaderSource::Wgsl(LOAD.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("depth"),
        layout: None,
        module: &module,
        entry_point: Some("load"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    let depths = device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("depth"),
        size: bytes,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
        mapped_at_creation: false,
    });
    let view = depth.create_view(&wgpu::TextureViewDescriptor {
        aspect: wgpu::TextureAspect::DepthOnly,
        ..wgpu::TextureViewDescriptor::default()
    });
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("depth"),
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry {
                binding: 0,
                resource: wgpu::BindingResource::TextureView(&view),
            },
            wgpu::BindGroupEntry { binding: 1, resource: depths.as_entire_binding() },
        ],
    });
    let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.dispatch_workgroups(depth.width().div_ceil(SIDE), depth.height().div_ceil(SIDE), 1);
    drop(pass);
    depths
}
