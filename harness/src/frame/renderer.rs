//! Draws a frame on a device and reads it back.

use std::borrow::Cow;
use std::collections::BTreeMap;

use half::f16;

use super::{Blend, Draw, Frame, FrameError, Mesh};
use crate::diagnostic::FileRead;
use crate::fixture::{self, FixtureError};
use crate::image::Image;
use crate::path::{Device, MOST_ROUNDS, guard};
use crate::probe::{Resource, upload};
use crate::reflect::{Binding, Program, Stage, Watched};

const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;
/// Channels of a pixel: RGBA.
const CHANNELS: u32 = 4;

/// A draw with its pipelines.
struct Prepared {
    /// Indices, then a buffer for each attribute.
    buffers: Option<(wgpu::Buffer, Vec<wgpu::Buffer>)>,
    vertices: u32,
    instances: u32,
    depth: Option<(wgpu::RenderPipeline, Vec<wgpu::BindGroup>)>,
    color: (wgpu::RenderPipeline, Vec<wgpu::BindGroup>),
}

/// A frame that was drawn.
pub(super) struct Drawn {
    pub(super) image: Image,
    /// The hash of the WGSL that drew it.
    pub(super) shader: String,
    /// The files that it depends on.
    pub(super) read: Vec<FileRead>,
}

/// Draws a frame.
pub(super) fn render(device: &'static Device, frame: &Frame<'_>) -> Result<Drawn, FrameError> {
    let (width, height) = frame.size();
    let mut items: Vec<&str> = Vec::new();
    for draw in frame.draws() {
        items.extend([draw.vertex.as_str(), draw.fragment.as_str()]);
        items.extend(draw.depth_fragment.as_deref());
    }
    let program = Program::of_items(frame.package(), frame.module(), &items)?;
    crate::reflect::validate(frame.package(), frame.module())?;
    let shader = blake3::hash(program.text().as_bytes()).to_hex().to_string();

    let stages = stages(&program, frame)?;
    let all = stages.iter().flat_map(|stage| stage.depth.iter().chain(&stage.color));
    let all: Vec<Binding> = all.cloned().collect();
    fixture::check_used(&all, frame.fixtures())?;
    let _turn = device.turn();
    // By variable: draws may use one binding number for several.
    let mut resources: BTreeMap<&str, Resource> = BTreeMap::new();
    for (binding, fixture) in fixture::resolve(&all, frame.fixtures())? {
        if let std::collections::btree_map::Entry::Vacant(entry) = resources.entry(&binding.path) {
            entry.insert(upload(device, &program, binding, fixture)?);
        }
    }

    let (module, path) = (frame.module().to_owned(), device.path());
    let _deadline =
        guard(move || format!("the {width} x {height} frame of module `{module}` on path {path}"));
    let unbounded = program.most_rounds().is_none_or(|rounds| rounds >= MOST_ROUNDS);
    if unbounded && device.leaves_loops() {
        watch_rounds(device, frame, &program, &mut resources)?;
    }
    let format = color_format(device, frame.blending());
    let painter = Painter { device, frame, program: &program, format, resources: &resources };
    let source = wgpu::ShaderSource::Wgsl(program.text().into());
    let image = painter.draw(source, &stages)?;
    let row = Row::new(format, width);
    let pixels = device.read_back(&image, row.stride * u64::from(height), |bytes| {
        let rows = bytes.chunks_exact(row.stride as usize);
        rows.flat_map(|bytes| row.pixels(bytes)).collect()
    })?;
    let fixtures = frame.fixtures().iter().flat_map(|(_, fixture)| fixture.read());
    let read = program.files().iter().chain(fixtures).cloned().collect();
    Ok(Drawn { image: Image::new(width, height, pixels), shader, read })
}

/// What each draw of a frame reads.
fn stages(program: &Program, frame: &Frame<'_>) -> Result<Vec<Bindings>, FrameError> {
    let bindings_of = |stage: Stage, name: &str| {
        program.entry_point_bindings(stage, name).ok_or_else(|| FrameError::EntryPoint {
            module: frame.module().to_owned(),
            stage,
            name: name.to_owned(),
        })
    };
    let mut stages = Vec::new();
    for draw in frame.draws() {
        let vertex = bindings_of(Stage::Vertex, &draw.vertex)?;
        let fragment = bindings_of(Stage::Fragment, &draw.fragment)?;
        let depth = match &draw.depth_fragment {
            Some(fragment) => bindings_of(Stage::Fragment, fragment)?,
            None => Vec::new(),
        };
        stages.push(Bindings { depth: union(&vertex, depth)?, color: union(&vertex, fragment)? });
    }
    Ok(stages)
}

/// Draws the frame with loops that count, where the driver would leave them without a word.
fn watch_rounds(
    device: &'static Device,
    frame: &Frame<'_>,
    program: &Program,
    resources: &mut BTreeMap<&str, Resource>,
) -> Result<(), FrameError> {
    let binding = program.free_binding();
    let limit = u32::try_from(MOST_ROUNDS).expect("it fits");
    let Watched { program, loops } = program.watching_rounds(binding, limit);
    let size = 4 * loops.len() as u64;
    let buffer = |usage| {
        device.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("rounds"),
            size,
            usage,
            mapped_at_creation: false,
        })
    };
    use wgpu::BufferUsages as Usage;
    let counts = device.checked(|| buffer(Usage::STORAGE | Usage::COPY_SRC))?;
    resources.insert(Watched::VARIABLE, Resource::Buffer(counts.clone()));
    let format = color_format(device, frame.blending());
    let painter = Painter { device, frame, program: &program, format, resources };
    let source = wgpu::ShaderSource::Naga(Cow::Owned(program.module().clone()));
    drop(painter.draw(source, &stages(&program, frame)?)?);
    let staging = device.checked(|| {
        let staging = buffer(Usage::MAP_READ | Usage::COPY_DST);
        let mut encoder = device.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(&counts, 0, &staging, 0, size);
        device.queue.submit([encoder.finish()]);
        staging
    })?;
    resources.remove(Watched::VARIABLE);
    let counts: Vec<u32> = device.read_back(&staging, size, bytemuck::pod_collect_to_vec)?;
    let most = loops.iter().zip(counts).max_by_key(|(_, count)| *count);
    match most.filter(|(_, count)| *count > 0) {
        None => Ok(()),
        Some((place, count)) => {
            let of = format!("the frame of module `{}`", frame.module());
            Err(FrameError::Rounds(Box::new(device.left_loop(&of, count, place.as_ref()))))
        }
    }
}

/// What a draw's two pipelines read.
struct Bindings {
    depth: Vec<Binding>,
    color: Vec<Binding>,
}

/// The bindings of both stages. Two variables can't share a binding in one draw: of their fixtures
/// one would be ignored.
fn union(some: &[Binding], others: Vec<Binding>) -> Result<Vec<Binding>, FixtureError> {
    let mut all = some.to_vec();
    for other in others {
        let place = |binding: &Binding| (binding.group, binding.binding);
        match some.iter().find(|binding| place(binding) == place(&other)) {
            None => all.push(other),
            Some(same) if same.path == other.path => {}
            Some(same) => {
                let (group, binding) = place(&other);
                let variables = [same.path.clone(), other.path];
                return Err(FixtureError::Shared { variables, group, binding });
            }
        }
    }
    Ok(all)
}

/// The path's format of frames; where it can't be blended, half floats can everywhere.
fn color_format(device: &Device, blend: Blend) -> wgpu::TextureFormat {
    let blendable = device.device.features().contains(wgpu::Features::FLOAT32_BLENDABLE);
    if blend == Blend::Replace || blendable {
        device.color_format()
    } else {
        wgpu::TextureFormat::Rgba16Float
    }
}

/// A row of pixels in a buffer that a texture is copied to.
struct Row {
    width: usize,
    half: bool,
    /// Bytes from one row to the next.
    stride: u64,
}

impl Row {
    fn new(format: wgpu::TextureFormat, width: u32) -> Self {
        let half = format == wgpu::TextureFormat::Rgba16Float;
        let bytes = width * CHANNELS * if half { 2 } else { 4 };
        let stride = u64::from(bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT));
        Self { width: width as usize, half, stride }
    }

    fn pixels(&self, bytes: &[u8]) -> Vec<[f32; 4]> {
        if self.half {
            let pixels = &bytes[..self.width * 8];
            let halves: Vec<[u16; 4]> = bytemuck::pod_collect_to_vec(pixels);
            halves.into_iter().map(|p| p.map(|bits| f16::from_bits(bits).to_f32())).collect()
        } else {
            bytemuck::pod_collect_to_vec(&bytes[..self.width * 16])
        }
    }
}

struct Painter<'a> {
    device: &'static Device,
    frame: &'a Frame<'a>,
    program: &'a Program,
    format: wgpu::TextureFormat,
    resources: &'a BTreeMap<&'a str, Resource>,
}

impl Painter<'_> {
    /// Draws everything; the image as a buffer.
    fn draw(
        &self,
        source: wgpu::ShaderSource<'_>,
        stages: &[Bindings],
    ) -> Result<wgpu::Buffer, FrameError> {
        let image = crate::reflect::on_deep_stack(|| {
            self.device.checked(|| {
                let descriptor = wgpu::ShaderModuleDescriptor { label: None, source };
                let shader = self.device.device.create_shader_module(descriptor);
                let draws = self.frame.draws().iter().zip(stages);
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
            (pipeline, groups)
        };
        // Only meshes are drawn in advance: what covers the frame is behind them.
        let depth = (self.frame.has_prepass() && draw.mesh.is_some())
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

    fn pipeline(
        &self,
        shader: &wgpu::ShaderModule,
        draw: &Draw,
        color: bool,
    ) -> wgpu::RenderPipeline {
        let columns = draw.mesh.iter().flat_map(|(mesh, _)| &mesh.attributes);
        let attributes: Vec<(u64, [wgpu::VertexAttribute; 1])> = columns
            .map(|column| {
                let format = [
                    wgpu::VertexFormat::Float32,
                    wgpu::VertexFormat::Float32x2,
                    wgpu::VertexFormat::Float32x3,
                    wgpu::VertexFormat::Float32x4,
                ][column.width - 1];
                let location = column.location;
                let attribute =
                    wgpu::VertexAttribute { format, offset: 0, shader_location: location };
                (4 * column.width as u64, [attribute])
            })
            .collect();
        let layouts: Vec<Option<wgpu::VertexBufferLayout<'_>>> = attributes
            .iter()
            .map(|(array_stride, attributes)| {
                Some(wgpu::VertexBufferLayout {
                    array_stride: *array_stride,
                    step_mode: wgpu::VertexStepMode::Vertex,
                    attributes,
                })
            })
            .collect();
        let (compare, write) = match (color, self.frame.has_prepass()) {
            (true, true) => (wgpu::CompareFunction::Equal, false),
            (true, false) => (wgpu::CompareFunction::LessEqual, true),
            (false, _) => (wgpu::CompareFunction::Less, true),
        };
        let target = wgpu::ColorTargetState {
            blend: blend_state(self.frame.blending()),
            ..wgpu::ColorTargetState::from(self.format)
        };
        let targets = [Some(target)];
        let fragment =
            if color { Some(draw.fragment.as_str()) } else { draw.depth_fragment.as_deref() };
        self.device.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(&draw.fragment),
            layout: None,
            vertex: wgpu::VertexState {
                module: shader,
                entry_point: Some(self.program.entry_point_name(&draw.vertex)),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &layouts,
            },
            primitive: wgpu::PrimitiveState {
                cull_mode: draw.mesh.is_some().then_some(wgpu::Face::Back),
                ..wgpu::PrimitiveState::default()
            },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH,
                depth_write_enabled: Some(write),
                depth_compare: Some(compare),
                stencil: wgpu::StencilState::default(),
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: fragment.map(|name| wgpu::FragmentState {
                module: shader,
                entry_point: Some(self.program.entry_point_name(name)),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: if color { &targets } else { &[] },
            }),
            multiview_mask: None,
            cache: None,
        })
    }

    fn bind(&self, pipeline: &wgpu::RenderPipeline, bindings: &[Binding]) -> Vec<wgpu::BindGroup> {
        let groups = bindings.iter().map(|binding| binding.group + 1).max().unwrap_or(0);
        (0..groups)
            .map(|group| {
                let entries: Vec<_> = bindings
                    .iter()
                    .filter(|binding| binding.group == group)
                    .map(|binding| wgpu::BindGroupEntry {
                        binding: binding.binding,
                        resource: self.resources[binding.path.as_str()].binding(),
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
        let (width, height) = self.frame.size();
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
        if self.frame.has_prepass() {
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

fn blend_state(blend: Blend) -> Option<wgpu::BlendState> {
    let sum = wgpu::BlendComponent {
        src_factor: wgpu::BlendFactor::One,
        dst_factor: wgpu::BlendFactor::One,
        operation: wgpu::BlendOperation::Add,
    };
    match blend {
        Blend::Replace => None,
        Blend::Add => Some(wgpu::BlendState { color: sum, alpha: sum }),
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

fn record(
    pass: &mut wgpu::RenderPass<'_>,
    draw: &Prepared,
    (pipeline, groups): &(wgpu::RenderPipeline, Vec<wgpu::BindGroup>),
) {
    pass.set_pipeline(pipeline);
    for (index, group) in (0..).zip(groups) {
        pass.set_bind_group(index, group, &[]);
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
