use super::*;

/// A kernel that samples the middle of an edge between two faces. The result is the mean of the texels on both sides of
/// the edge.
const EDGE: &str = "
@group(0) @binding(0) var cube: texture_cube<f32>;
@group(0) @binding(1) var cube_sampler: sampler;
@group(0) @binding(2) var<storage, read_write> result: array<f32>;
@compute @workgroup_size(1) fn kernel() {
    result[0] = textureSampleLevel(cube, cube_sampler, vec3f(1.0, 0.9999, 0.0), 0.0).x;
}
";

/// The size of the cube map: six faces of 4 x 4 texels.
const SIZE: wgpu::Extent3d = wgpu::Extent3d { width: 4, height: 4, depth_or_array_layers: 6 };

/// A cube map of one colour, and a kernel that samples the cube map across an edge.
struct Sampled<'d> {
    device: &'d Device,
    texture: wgpu::Texture,
    pipeline: wgpu::ComputePipeline,
    group: wgpu::BindGroup,
    buffers: [wgpu::Buffer; 2],
}

impl<'d> Sampled<'d> {
    fn new(device: &'d Device) -> Self {
        let gpu = &device.device;
        let texture = gpu.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: SIZE,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let module = gpu.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(EDGE.into()),
        });
        let pipeline = gpu.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: None,
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        let buffer = |usage| {
            gpu.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: 4,
                usage,
                mapped_at_creation: false,
            })
        };
        let result = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
        let staging = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        let linear = wgpu::FilterMode::Linear;
        let sampler = gpu.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: linear,
            min_filter: linear,
            ..wgpu::SamplerDescriptor::default()
        });
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        let group = gpu.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[
                entry(0, wgpu::BindingResource::TextureView(&view(&texture))),
                entry(1, wgpu::BindingResource::Sampler(&sampler)),
                entry(2, result.as_entire_binding()),
            ],
        });
        Self { device, texture, pipeline, group, buffers: [result, staging] }
    }

    fn paint(&self, value: u8) {
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(4 * SIZE.width),
            rows_per_image: Some(SIZE.height),
        };
        let target = self.texture.as_image_copy();
        self.device.queue.write_texture(target, &[value; 4 * 4 * 4 * 6], layout, SIZE);
    }

    /// The kernel's result, in steps of 1/255.
    fn dispatch(&self) -> f32 {
        let gpu = &self.device.device;
        let mut encoder = gpu.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        {
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &self.group, &[]);
            pass.dispatch_workgroups(1, 1, 1);
        }
        let [result, staging] = &self.buffers;
        encoder.copy_buffer_to_buffer(result, 0, staging, 0, 4);
        self.device.queue.submit([encoder.finish()]);
        let read = |bytes: &[u8]| f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        255.0 * self.device.read_back(staging, 4, read).expect("it is read")
    }
}

fn view(texture: &wgpu::Texture) -> wgpu::TextureView {
    texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::Cube),
        ..wgpu::TextureViewDescriptor::default()
    })
}

/// The test fills a cube map with one colour, draws with the cube map, and fills it with another colour. On the drivers
/// that fill borders only in a draw, a dispatch now reads the mean of the old and the new colour at an edge. Other
/// drivers read the new colour. After another draw, all drivers read the new colour.
#[test]
fn borders_are_those_of_the_last_draw_on_swiftshader() {
    for device in crate::path::chosen()
        .expect("a path opens")
        .into_iter()
        .filter_map(crate::path::Opened::device)
    {
        let _turn = device.turn();
        let sampled = Sampled::new(device);
        let near = |found: f32, expected: f32| (found - expected).abs() < 1.0;
        sampled.paint(200);
        draw(device, &view(&sampled.texture));
        let drawn = sampled.dispatch();
        sampled.paint(100);
        let stale = sampled.dispatch();
        draw(device, &view(&sampled.texture));
        let again = sampled.dispatch();
        let path = device.path();
        assert!(near(drawn, 200.0) && near(again, 100.0), "on {path}: {drawn}, {stale}, {again}");
        let expected = if device.fills_borders_by_draws() { 150.0 } else { 100.0 };
        assert!((stale - expected).abs() < 5.0, "on {path}: {stale}, expected {expected}");
    }
}
