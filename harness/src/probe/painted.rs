//! Draws into depth textures and multisampled textures to fill them. No other commands of WebGPU can fill such
//! textures.

use crate::path::{Device, PathError};

/// A triangle that covers the whole target.
const VERTEX: &str = "
@vertex fn vertex(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}
";

/// The texels of one layer in one mip level.
pub(super) struct Layer<'t> {
    pub(super) texture: &'t wgpu::Texture,
    pub(super) level: u32,
    pub(super) layer: u32,
    pub(super) width: u32,
    /// The values of all samples. The samples of one texel are next to each other.
    pub(super) words: &'t [[u32; 4]],
}

fn scalar(format: wgpu::TextureFormat) -> &'static str {
    match format {
        wgpu::TextureFormat::Rgba32Uint | wgpu::TextureFormat::Rgba16Uint => "u32",
        wgpu::TextureFormat::Rgba32Sint | wgpu::TextureFormat::Rgba16Sint => "i32",
        _ => "f32",
    }
}

pub(super) fn paint(device: &Device, layer: &Layer<'_>) -> Result<(), PathError> {
    device.checked(|| draw(device, layer))
}

fn draw(device: &Device, layer: &Layer<'_>) {
    let Device { device, queue, .. } = device;
    let format = layer.texture.format();
    let samples = layer.texture.sample_count();
    let depth = format.is_depth_stencil_format();
    let (sample, index) = match samples {
        1 => ("", "0u"),
        _ => (", @builtin(sample_index) s: u32", "s"),
    };
    let (result, value) = match depth {
        true => ("@builtin(frag_depth) f32", ".x"),
        false => (&*format!("@location(0) vec4<{}>", scalar(format)), ""),
    };
    let text = format!(
        "@group(0) @binding(0) var<storage, read> texels: array<vec4<{}>>;\n\
         {VERTEX}\
         @fragment fn fragment(@builtin(position) p: vec4f{sample}) -> {result} {{\n    \
         return texels[(u32(p.y) * {}u + u32(p.x)) * {samples}u + {index}]{value};\n}}\n",
        scalar(format),
        layer.width,
    );
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(text.into()),
    });
    let target = [Some(wgpu::ColorTargetState::from(format))];
    let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: None,
        layout: None,
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
            targets: if depth { &[] } else { &target },
        }),
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: depth.then(|| wgpu::DepthStencilState {
            format,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Always),
            stencil: wgpu::StencilState::default(),
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState { count: samples, ..Default::default() },
        multiview_mask: None,
        cache: None,
    });
    let bytes: &[u8] = bytemuck::cast_slice(layer.words);
    let buffer = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: bytes.len() as u64,
        usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    queue.write_buffer(&buffer, 0, bytes);
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[wgpu::BindGroupEntry { binding: 0, resource: buffer.as_entire_binding() }],
    });
    let view = layer.texture.create_view(&wgpu::TextureViewDescriptor {
        dimension: Some(wgpu::TextureViewDimension::D2),
        base_mip_level: layer.level,
        mip_level_count: Some(1),
        base_array_layer: layer.layer,
        array_layer_count: Some(1),
        ..wgpu::TextureViewDescriptor::default()
    });
    let mut encoder = device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    {
        let color = [Some(wgpu::RenderPassColorAttachment {
            view: &view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations::default(),
        })];
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: if depth { &[] } else { &color },
            depth_stencil_attachment: depth.then_some(wgpu::RenderPassDepthStencilAttachment {
                view: &view,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            ..wgpu::RenderPassDescriptor::default()
        });
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
    }
    queue.submit([encoder.finish()]);
}
