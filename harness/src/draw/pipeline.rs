//! The pipelines of a draw.

use super::Blend;
use super::drawing::Draw;
use super::painter::{DEPTH, Painter};

impl Painter<'_> {
    /// The pipeline of a draw's colour, or of its depth alone.
    pub(super) fn pipeline(
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
        let (compare, write) = match (color, self.scene.prepass) {
            (true, true) => (wgpu::CompareFunction::Equal, false),
            (true, false) => (wgpu::CompareFunction::LessEqual, true),
            (false, _) => (wgpu::CompareFunction::Less, true),
        };
        let target = wgpu::ColorTargetState {
            blend: blend_state(self.scene.blend),
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
