//! The passes of a frame: depth, colour, and the copy into a buffer.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::drawing::{Bindings, Draw, Scene};
use super::row::Row;
use super::{DrawError, Mesh};
use crate::path::Device;
use crate::probe::Resource;
use crate::reflect::{Binding, Program};

pub(super) const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// A draw with its pipelines.
struct Prepared {
    /// Indices, then a buffer for each attribute.
    buffers: Option<(wgpu::Buffer, Vec<wgpu::Buffer>)>,
    vertices: u32,
    instances: u32,
    depth: Option<Ready>,
    color: Ready,
}

/// A pipeline with all that it reads.
struct Ready {
    pipeline: wgpu::RenderPipeline,
    groups: Vec<wgpu::BindGroup>,
    immediates: Option<Vec<u8>>,
}

/// What draws a scene on a device.
pub(super) struct Painter<'a> {
    pub(super) device: &'a Device,
    pub(super) scene: &'a Scene<'a>,
    pub(super) program: &'a Program,
    pub(super) format: wgpu::TextureFormat,
    pub(super) resources: &'a BTreeMap<&'a str, Resource>,
}

impl Painter<'_> {
    /// Draws everything; the image as a buffer.
    pub(super) fn draw(&self, bindings: &[Bindings]) -> Result<wgpu::Buffer, DrawError> {
        let image = crate::reflect::on_deep_stack(|| {
            let module = self.device.drawn(self.program.module().clone())?;
            let source = wgpu::ShaderSource::Naga(Cow::Owned(module));
            self.device.checked(|| {
                let descriptor = wgpu::ShaderModuleDescriptor { label: None, source };
                let shader = self.device.device.create_shader_module(descriptor);
                let draws = self.scene.draws.iter().zip(bindings);
                let draws: Vec<Prepared> =
                    draws.map(|(draw, bindings)| self.prepare(&shader, draw, bindings)).collect();
                self.paint(&draws)
            })
        });
        Ok(image?)
    }

    fn prepare(&self, shader: &wgpu::ShaderModule, draw: &Draw, bindings: &Bindings) -> Prepared {
        let (buffers, vertices, instances) = match &draw.mesh {
            Some((mesh, instances)) => {
                (Some(self.upload(mesh)), mesh.indices.len() as u32, *instances)
            }
            None => (None, 3, 1),
        };
        let bound = |pipeline: wgpu::RenderPipeline, bindings: &[Binding]| {
            let groups = self.bind(&pipeline, bindings);
            let immediates =
                bindings.iter().find_map(|binding| match &self.resources[binding.path.as_str()] {
                    Resource::Immediate(bytes) => Some(bytes.clone()),
                    _ => None,
                });
            Ready { pipeline, groups, immediates }
        };
        // Only meshes are drawn in advance: what covers the frame is behind them.
        let depth = (self.scene.prepass && draw.mesh.is_some())
            .then(|| bound(self.pipeline(shader, draw, false), &bindings.depth));
        let color = bound(self.pipeline(shader, draw, true), &bindings.color);
        Prepared { buffers, vertices, instances, depth, color }
    }

    fn upload(&self, mesh: &Mesh) -> (wgpu::Buffer, Vec<wgpu::Buffer>) {
        let upload = |bytes: &[u8], usage| {
            let buffer = self.device.device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: bytes.len() as u64,
                usage: usage | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            self.device.queue.write_buffer(&buffer, 0, bytes);
            buffer
        };
        let indices = upload(bytemuck::cast_slice(&mesh.indices), wgpu::BufferUsages::INDEX);
        let columns = mesh.attributes.iter();
        let attributes = columns
            .map(|c| upload(bytemuck::cast_slice(&c.scalars), wgpu::BufferUsages::VERTEX))
            .collect();
        (indices, attributes)
    }

    fn bind(&self, pipeline: &wgpu::RenderPipeline, bindings: &[Binding]) -> Vec<wgpu::BindGroup> {
        let bound = bindings.iter().filter(|binding| binding.group != Binding::NOWHERE);
        let groups = bound.map(|binding| binding.group + 1).max().unwrap_or(0);
        (0..groups)
            .map(|group| {
                let entries: Vec<_> = bindings
                    .iter()
                    .filter(|binding| binding.group == group)
                    .filter_map(|binding| {
                        let resource = self.resources[binding.path.as_str()].binding()?;
                        Some(wgpu::BindGroupEntry { binding: binding.binding, resource })
                    })
                    .collect();
                self.device.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: None,
                    layout: &pipeline.get_bind_group_layout(group),
                    entries: &entries,
                })
            })
            .collect()
    }

    /// Submits both passes and the copy into a buffer, which it returns.
    fn paint(&self, draws: &[Prepared]) -> wgpu::Buffer {
        let Scene { width, height, .. } = *self.scene;
        let device = &self.device.device;
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let texture = |format, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size,
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            })
        };
        let color = texture(self.format, wgpu::TextureUsages::COPY_SRC);
        let depth = texture(DEPTH, wgpu::TextureUsages::empty());
        let color_view = color.create_view(&wgpu::TextureViewDescriptor::default());
        let depth_view = depth.create_view(&wgpu::TextureViewDescriptor::default());
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut loaded = wgpu::LoadOp::Clear(1.0);
        if self.scene.prepass {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                depth_stencil_attachment: Some(depth_attachment(&depth_view, loaded)),
                ..wgpu::RenderPassDescriptor::default()
            });
            for draw in draws {
                if let Some(depth) = &draw.depth {
                    record(&mut pass, draw, depth);
                }
            }
            loaded = wgpu::LoadOp::Load;
        }
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: &color_view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                depth_stencil_attachment: Some(depth_attachment(&depth_view, loaded)),
                ..wgpu::RenderPassDescriptor::default()
            });
            for draw in draws {
                record(&mut pass, draw, &draw.color);
            }
        }
        let stride = Row::new(self.format, width).stride;
        let staging = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("frame"),
            size: stride * u64::from(height),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(u32::try_from(stride).expect("a row fits in 32 bits")),
            rows_per_image: Some(height),
        };
        let target = wgpu::TexelCopyBufferInfo { buffer: &staging, layout };
        encoder.copy_texture_to_buffer(color.as_image_copy(), target, size);
        self.device.queue.submit([encoder.finish()]);
        staging
    }
}

fn depth_attachment(
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<f32>,
) -> wgpu::RenderPassDepthStencilAttachment<'_> {
    wgpu::RenderPassDepthStencilAttachment {
        view,
        depth_ops: Some(wgpu::Operations { load, store: wgpu::StoreOp::Store }),
        stencil_ops: None,
    }
}

fn record(pass: &mut wgpu::RenderPass<'_>, draw: &Prepared, ready: &Ready) {
    pass.set_pipeline(&ready.pipeline);
    for (index, group) in (0..).zip(&ready.groups) {
        pass.set_bind_group(index, group, &[]);
    }
    if let Some(bytes) = &ready.immediates {
        pass.set_immediates(0, bytes);
    }
    match &draw.buffers {
        Some((indices, attributes)) => {
            for (slot, buffer) in (0..).zip(attributes) {
                pass.set_vertex_buffer(slot, buffer.slice(..));
            }
            pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..draw.vertices, 0, 0..draw.instances);
        }
        None => pass.draw(0..draw.vertices, 0..draw.instances),
    }
}
