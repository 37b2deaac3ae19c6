//! Records a frame's render passes (the depth pass and the colour pass), and the copy of the results into buffers.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::drawing::{Bindings, Scene, Source};
use super::request::{Draw, Geometry};
use super::row::Row;
use super::{DrawError, depths};
use crate::path::Device;
use crate::probe::Resource;
use crate::reflect::{Binding, Program};

/// The render pass in which a pipeline runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Pass {
    Depth,
    Color,
}

struct Prepared<'d> {
    draw: &'d Draw,
    /// The buffer of indices, and a buffer for each attribute.
    buffers: Option<(wgpu::Buffer, Vec<wgpu::Buffer>)>,
    count: u32,
    /// A buffer with the numbers of vertices and copies, if the GPU reads these numbers from a buffer.
    indirect: Option<wgpu::Buffer>,
    depth: Option<Ready>,
    color: Ready,
}

struct Ready {
    pipeline: wgpu::RenderPipeline,
    groups: Vec<wgpu::BindGroup>,
    immediates: Option<Vec<u8>>,
}

pub(super) struct Painter<'a> {
    pub(super) device: &'a Device,
    pub(super) scene: &'a Scene<'a>,
    pub(super) program: &'a Program,
    /// The formats of the targets. The list is empty if all draws write only depth.
    pub(super) formats: Vec<wgpu::TextureFormat>,
    pub(super) depth_format: wgpu::TextureFormat,
    pub(super) resources: &'a BTreeMap<&'a str, Resource>,
    pub(super) sources: Vec<Source>,
}

impl<'a> Painter<'a> {
    pub(super) fn new(
        device: &'a Device,
        scene: &'a Scene<'a>,
        program: &'a Program,
        resources: &'a BTreeMap<&'a str, Resource>,
    ) -> Self {
        let of = |(index, format): (usize, &super::Format)| {
            let blends = scene.draws.iter().map(|draw| draw.blend_of(index, scene.blend));
            let blended = blends.into_iter().any(|blend| blend != super::Blend::Replace);
            format.on(device, blended, (scene.samples, scene.components(program, index)))
        };
        let formats = match scene.is_depth_only() {
            true => Vec::new(),
            false => scene.formats.iter().enumerate().map(of).collect(),
        };
        let stencil = scene.draws.iter().any(|draw| draw.state.stencil.is_some());
        let exact = device.device.features().contains(wgpu::Features::DEPTH32FLOAT_STENCIL8);
        let depth_format = match (stencil, exact) {
            (false, _) => wgpu::TextureFormat::Depth32Float,
            (true, true) => wgpu::TextureFormat::Depth32FloatStencil8,
            (true, false) => wgpu::TextureFormat::Depth24PlusStencil8,
        };
        let sources = vec![scene.result];
        Self { device, scene, program, formats, depth_format, resources, sources }
    }

    pub(super) fn format_of(&self, source: Source) -> wgpu::TextureFormat {
        match source {
            Source::Target(target) => self.formats[target],
            Source::Depth => self.depth_format,
        }
    }

    /// Draws the frame, and returns one buffer of texels for each entry of `sources`.
    pub(super) fn draw(&self, bindings: &[Bindings]) -> Result<Vec<wgpu::Buffer>, DrawError> {
        // A draw without a vertex function gets a generated vertex function that supplies the fragment function's
        // inputs.
        let alone = |draw: &Draw| match (&draw.vertex, &draw.fragment) {
            (None, Some(fragment)) => Ok(Some(self.program.covering(fragment)?)),
            _ => Ok(None),
        };
        let covering: Vec<Option<String>> =
            self.scene.draws.iter().map(alone).collect::<Result<_, DrawError>>()?;
        let covering = covering.iter().map(|text| {
            let text = text.as_ref()?;
            Some(crate::reflect::parsed_with(text, &Default::default()))
        });
        let covering = covering.map(Option::transpose).collect::<Result<Vec<_>, String>>();
        let covering = covering.map_err(|message| crate::path::PathError::Driver {
            path: self.device.path(),
            message,
        })?;
        let image = crate::reflect::on_deep_stack(|| {
            let module = self.device.drawn(self.program.module().clone())?;
            let covering = covering.into_iter().map(|module| {
                module.map(|module| self.device.drawn((*module).clone())).transpose()
            });
            let covering = covering.collect::<Result<Vec<_>, _>>()?;
            let draws: Vec<Prepared<'_>> = self.device.made(|| {
                let made = |module| {
                    let source = wgpu::ShaderSource::Naga(Cow::Owned(module));
                    let descriptor = wgpu::ShaderModuleDescriptor { label: None, source };
                    self.device.device.create_shader_module(descriptor)
                };
                let shader = made(module);
                let draws = self.scene.draws.iter().zip(bindings).zip(covering);
                draws
                    .map(|((draw, bindings), covering)| {
                        let covering = covering.map(made);
                        self.prepare((&shader, covering.as_ref()), draw, bindings)
                    })
                    .collect()
            })?;
            self.device.checked(|| self.paint(&draws))
        });
        Ok(image?)
    }

    fn prepare<'d>(
        &self,
        shaders: (&wgpu::ShaderModule, Option<&wgpu::ShaderModule>),
        draw: &'d Draw,
        bindings: &Bindings,
    ) -> Prepared<'d> {
        let (buffers, count) = match &draw.geometry {
            Geometry::Mesh(mesh) => {
                let count = mesh.indices.len() as u32;
                let indices = match draw.u16_indices {
                    false => bytemuck::cast_slice(&mesh.indices).to_vec(),
                    true => {
                        #[expect(clippy::cast_possible_truncation, reason = "they are short")]
                        let mut short: Vec<u16> =
                            mesh.indices.iter().map(|index| *index as u16).collect();
                        // A buffer copy needs a multiple of 4 bytes.
                        short.resize(short.len().next_multiple_of(2), 0);
                        bytemuck::cast_slice(&short).to_vec()
                    }
                };
                let indices = self.upload(&indices, wgpu::BufferUsages::INDEX);
                let columns = mesh.attributes.iter().map(|column| {
                    self.upload(bytemuck::cast_slice(&column.words), wgpu::BufferUsages::VERTEX)
                });
                (Some((indices, columns.collect())), count)
            }
            Geometry::Vertices(count) => (None, *count),
        };
        let indirect = draw.indirect.then(|| {
            let base = draw.base_vertex.cast_unsigned();
            let words = match draw.is_mesh() {
                true => vec![count, draw.instances, 0, base, draw.first_instance],
                false => vec![count, draw.instances, base, draw.first_instance],
            };
            self.upload(bytemuck::cast_slice(&words), wgpu::BufferUsages::INDIRECT)
        });
        let bound = |pipeline: wgpu::RenderPipeline, bindings: &[Binding]| {
            let groups = self.bind(&pipeline, bindings);
            let immediates =
                bindings.iter().find_map(|binding| match &self.resources[binding.path.as_str()] {
                    Resource::Immediate(bytes) => Some(bytes.clone()),
                    _ => None,
                });
            Ready { pipeline, groups, immediates }
        };
        // The pre-pass draws only meshes. A triangle that covers the frame lies behind the meshes.
        let depth = (self.scene.prepass && draw.is_mesh())
            .then(|| bound(self.pipeline(shaders, draw, Pass::Depth), &bindings.depth));
        let color = bound(self.pipeline(shaders, draw, Pass::Color), &bindings.color);
        Prepared { draw, buffers, count, indirect, depth, color }
    }

    fn upload(&self, bytes: &[u8], usage: wgpu::BufferUsages) -> wgpu::Buffer {
        let buffer = self.device.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: bytes.len() as u64,
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.device.queue.write_buffer(&buffer, 0, bytes);
        buffer
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

    /// Submits the depth pass, the colour pass and the copies of the targets. Returns the buffers with the copies.
    fn paint(&self, draws: &[Prepared<'_>]) -> Vec<wgpu::Buffer> {
        let Scene { width, height, samples, clear, clear_depth, .. } = *self.scene;
        let device = &self.device.device;
        let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
        let texture = |format, sample_count, usage| {
            device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size,
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            })
        };
        let view =
            |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let read = |of, usage| match self.sources.contains(&of) {
            true => usage,
            false => wgpu::TextureUsages::empty(),
        };
        // Each target has a texture to read back. With several samples, it also has a multisampled texture to draw
        // into.
        let colors: Vec<(wgpu::Texture, Option<wgpu::Texture>)> = (0..)
            .zip(&self.formats)
            .map(|(index, format)| {
                let several =
                    (samples > 1).then(|| texture(*format, samples, wgpu::TextureUsages::empty()));
                let usage = read(Source::Target(index), wgpu::TextureUsages::COPY_SRC);
                (texture(*format, 1, usage), several)
            })
            .collect();
        let loaded_later = read(Source::Depth, wgpu::TextureUsages::TEXTURE_BINDING);
        let depth = texture(self.depth_format, samples, loaded_later);
        let views: Vec<_> = colors
            .iter()
            .map(|(plain, several)| (view(plain), several.as_ref().map(&view)))
            .collect();
        let depth_view = view(&depth);
        let depth_attachment = |load| {
            let stencil =
                wgpu::Operations { load: wgpu::LoadOp::Clear(0), store: wgpu::StoreOp::Store };
            Some(wgpu::RenderPassDepthStencilAttachment {
                view: &depth_view,
                depth_ops: Some(wgpu::Operations { load, store: wgpu::StoreOp::Store }),
                stencil_ops: self.depth_format.has_stencil_aspect().then_some(stencil),
            })
        };
        let mut encoder = device.create_command_encoder(&Default::default());
        let mut loaded = wgpu::LoadOp::Clear(clear_depth);
        if self.scene.prepass {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                depth_stencil_attachment: depth_attachment(loaded),
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
            let attachments: Vec<_> = views
                .iter()
                .enumerate()
                .map(|(index, (plain, several))| {
                    let zeros = self.scene.told.is_some_and(|first| index >= first);
                    let [r, g, b, a] = if zeros { [0.0; 4] } else { clear.map(f64::from) };
                    Some(wgpu::RenderPassColorAttachment {
                        view: several.as_ref().unwrap_or(plain),
                        depth_slice: None,
                        resolve_target: several.as_ref().map(|_| plain),
                        ops: wgpu::Operations {
                            load: wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a }),
                            store: wgpu::StoreOp::Store,
                        },
                    })
                })
                .collect();
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                color_attachments: &attachments,
                depth_stencil_attachment: depth_attachment(loaded),
                ..wgpu::RenderPassDescriptor::default()
            });
            for draw in draws {
                record(&mut pass, draw, &draw.color);
            }
        }
        let copied = |source: &Source| {
            let stride = Row::new(self.format_of(*source), width).stride;
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
            match *source {
                Source::Target(index) => {
                    encoder.copy_texture_to_buffer(colors[index].0.as_image_copy(), target, size);
                }
                Source::Depth => {
                    let bytes = staging.size();
                    let depths = depths::load(self.device, &mut encoder, &depth, bytes);
                    encoder.copy_buffer_to_buffer(&depths, 0, &staging, 0, bytes);
                }
            }
            staging
        };
        let all = self.sources.iter().map(copied).collect();
        self.device.queue.submit([encoder.finish()]);
        all
    }
}

fn record(pass: &mut wgpu::RenderPass<'_>, prepared: &Prepared<'_>, ready: &Ready) {
    let Prepared { draw, buffers, count, indirect, .. } = prepared;
    pass.set_pipeline(&ready.pipeline);
    for (index, group) in (0..).zip(&ready.groups) {
        pass.set_bind_group(index, group, &[]);
    }
    if let Some(bytes) = &ready.immediates {
        pass.set_immediates(0, bytes);
    }
    let [r, g, b, a] = draw.state.blend_constant.map(f64::from);
    pass.set_blend_constant(wgpu::Color { r, g, b, a });
    if let Some(stencil) = draw.state.stencil {
        pass.set_stencil_reference(stencil.reference.into());
    }
    let instances = draw.first_instance..draw.first_instance + draw.instances;
    match (buffers, indirect) {
        (Some((indices, attributes)), _) => {
            for (slot, buffer) in (0..).zip(attributes) {
                pass.set_vertex_buffer(slot, buffer.slice(..));
            }
            let format = match draw.u16_indices {
                true => wgpu::IndexFormat::Uint16,
                false => wgpu::IndexFormat::Uint32,
            };
            pass.set_index_buffer(indices.slice(..), format);
            match indirect {
                Some(arguments) => pass.draw_indexed_indirect(arguments, 0),
                None => pass.draw_indexed(0..*count, draw.base_vertex, instances),
            }
        }
        (None, Some(arguments)) => pass.draw_indirect(arguments, 0),
        (None, None) => {
            let first = draw.base_vertex.cast_unsigned();
            pass.draw(first..first + count, instances);
        }
    }
}
