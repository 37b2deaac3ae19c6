//! Makes the pipelines of a draw.

use super::painter::{Painter, Pass};
use super::request::{Draw, Geometry};
use super::state::{Cull, Winding};
use super::targets::{writes_depth, writes_target};
use crate::probe::compare;

impl Painter<'_> {
    pub(super) fn pipeline(
        &self,
        (shader, covering): (&wgpu::ShaderModule, Option<&wgpu::ShaderModule>),
        draw: &Draw,
        pass: Pass,
    ) -> wgpu::RenderPipeline {
        let columns = match &draw.geometry {
            Geometry::Mesh(mesh) => &*mesh.attributes,
            Geometry::Vertices(_) => &[],
        };
        let attributes: Vec<[wgpu::VertexAttribute; 1]> = columns
            .iter()
            .map(|column| {
                let (format, shader_location) = (column.format(), column.location);
                [wgpu::VertexAttribute { format, offset: 0, shader_location }]
            })
            .collect();
        let layouts: Vec<Option<wgpu::VertexBufferLayout<'_>>> = columns
            .iter()
            .zip(&attributes)
            .map(|(column, attributes)| {
                Some(wgpu::VertexBufferLayout {
                    array_stride: 4 * column.width as u64,
                    step_mode: match column.by_instance {
                        true => wgpu::VertexStepMode::Instance,
                        false => wgpu::VertexStepMode::Vertex,
                    },
                    attributes,
                })
            })
            .collect();
        let state = &draw.state;
        let own = state.depth_compare.map(compare);
        let writes = writes_depth(draw, self.program);
        let (depth_compare, write) = match (pass, self.scene.prepass && draw.is_mesh()) {
            (Pass::Color, true) => (wgpu::CompareFunction::Equal, false),
            (Pass::Color, false) => (own.unwrap_or(wgpu::CompareFunction::LessEqual), writes),
            (Pass::Depth, _) => (own.unwrap_or(wgpu::CompareFunction::Less), writes),
        };
        let targets: Vec<Option<wgpu::ColorTargetState>> = (0..)
            .zip(&self.formats)
            .map(|(index, format)| {
                let mut write_mask = match writes_target(draw, self.program, index) {
                    true => wgpu::ColorWrites::ALL,
                    false => wgpu::ColorWrites::empty(),
                };
                if let Some((_, own)) = state.masks.iter().rev().find(|(of, _)| *of == index) {
                    let channels = own.chars().map(|channel| match channel {
                        'r' => wgpu::ColorWrites::RED,
                        'g' => wgpu::ColorWrites::GREEN,
                        'b' => wgpu::ColorWrites::BLUE,
                        _ => wgpu::ColorWrites::ALPHA,
                    });
                    write_mask = channels.fold(wgpu::ColorWrites::empty(), |all, own| all | own);
                }
                let blend = draw.blend_of(index, self.scene.blend).state();
                Some(wgpu::ColorTargetState { format: *format, blend, write_mask })
            })
            .collect();
        let fragment = match pass {
            Pass::Color => draw.fragment.as_deref(),
            Pass::Depth => draw.depth_fragment.as_deref(),
        };
        let vertex = match (&draw.vertex, covering) {
            (Some(name), _) => (shader, self.program.entry_point_name(name)),
            (None, Some(covering)) => (covering, crate::reflect::COVERING),
            (None, None) => unreachable!("a draw without a vertex function has Karat's"),
        };
        let stencil = state.stencil.unwrap_or_default();
        let cull = match (state.cull, &draw.geometry) {
            (Some(Cull::None), _) | (None, Geometry::Vertices(_)) => None,
            (Some(Cull::Front), _) => Some(wgpu::Face::Front),
            (Some(Cull::Back), _) | (None, Geometry::Mesh(_)) => Some(wgpu::Face::Back),
        };
        self.device.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: draw.fragment.as_deref().or(draw.vertex.as_deref()),
            layout: None,
            vertex: wgpu::VertexState {
                module: vertex.0,
                entry_point: Some(vertex.1),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &layouts,
            },
            primitive: wgpu::PrimitiveState {
                cull_mode: cull,
                front_face: match state.winding {
                    Winding::CounterClockwise => wgpu::FrontFace::Ccw,
                    Winding::Clockwise => wgpu::FrontFace::Cw,
                },
                ..wgpu::PrimitiveState::default()
            },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: self.depth_format,
                depth_write_enabled: Some(write),
                depth_compare: Some(depth_compare),
                stencil: match pass {
                    Pass::Color => stencil.state(),
                    Pass::Depth => wgpu::StencilState::default(),
                },
                bias: wgpu::DepthBiasState {
                    constant: state.bias.constant,
                    slope_scale: state.bias.slope,
                    clamp: state.bias.clamp,
                },
            }),
            multisample: wgpu::MultisampleState {
                count: self.scene.samples,
                ..wgpu::MultisampleState::default()
            },
            fragment: fragment.map(|name| wgpu::FragmentState {
                module: shader,
                entry_point: Some(self.program.entry_point_name(name)),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: if pass == Pass::Color { &targets } else { &[] },
            }),
            multiview_mask: None,
            cache: None,
        })
    }
}
