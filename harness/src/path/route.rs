//! Translates shaders for routes such as `vulkan:hlsl`, on which wgpu doesn't translate the shader itself.

use karat_foreign::spirv_as_it_is;
use karat_translate::{
    Bindings, Code, Kind, Resource, Shader, Target, Texels, Tool, compile, compiler,
};

use super::{Api, Path, PathError, Via};
use crate::reflect::Ir;

/// The reason why this machine can't use a path's route.
pub(super) fn missing(path: Path) -> Option<String> {
    if takes_wgpu(path) {
        return None;
    }
    let compiler = compiler(target(path)).filter(|_| path.api() == Api::Vulkan);
    let Some(compiler) = compiler else {
        return Some(format!("no compiler translates {} for this API", path.via()));
    };
    let missing = Tool::all().iter().filter_map(|tool| tool.as_ref().err());
    let missing = missing.into_iter().find(|missing| missing.name == compiler)?;
    let (via, reason, remedy) = (path.via(), &missing.reason, missing.remedy);
    Some(format!("the route {via} needs `{compiler}`: {reason} ({remedy})"))
}

/// The language into which naga translates a shader on the path's route.
fn target(path: Path) -> Target {
    match path.via() {
        Via::Glsl => Target::Glsl,
        Via::Hlsl => Target::Hlsl,
        Via::HlslDxc => Target::Hlsl6,
        Via::Wgsl => Target::Wgsl,
        // The arithmetics of `cpu` aren't routes.
        Via::Direct | Via::Spirv | Via::Fma | Via::Ftz => Target::Spirv,
    }
}

/// The features that wgpu's device must have for a route.
pub(super) fn features(path: Path) -> wgpu::Features {
    if takes_wgpu(path) { wgpu::Features::empty() } else { wgpu::Features::PASSTHROUGH_SHADERS }
}

/// A translated shader.
pub(super) enum Routed {
    /// IR that wgpu translates for the path's API.
    Ir(Box<Ir>),
    /// SPIR-V for the driver, without wgpu's translation.
    Spirv(Box<Foreign>),
}

/// SPIR-V from another compiler.
pub(super) struct Foreign {
    words: Vec<u32>,
    entry_point: String,
    workgroup_size: (u32, u32, u32),
    bindings: Bindings,
    layout: Vec<wgpu::BindGroupLayoutEntry>,
}

/// Checks if wgpu translates the shader for the driver at the end of the route. On all other routes, Karat compiles the
/// shader to SPIR-V, and the driver gets this SPIR-V unchanged.
pub(super) fn takes_wgpu(path: Path) -> bool {
    matches!(path.via(), Via::Direct | Via::Wgsl | Via::Spirv)
}

pub(super) fn take(path: Path, ir: Ir, entry_point: &str) -> Result<Routed, PathError> {
    if takes_wgpu(path) {
        return through_naga(path, ir).map(Box::new).map(Routed::Ir);
    }
    let on_route = |message: String| PathError::Route { path, message };
    let shader = Shader::of(ir).map_err(|error| on_route(error.to_string()))?;
    if matches!(path.via(), Via::Hlsl | Via::HlslDxc) && shader.takes_constants(entry_point) {
        let why = "naga's HLSL reads `num_workgroups` from a buffer that the calling program must bind, and Karat binds no such buffer";
        return Err(on_route(why.to_owned()));
    }
    let translation = shader.translate(target(path), Some(entry_point));
    let translation = translation.map_err(|error| on_route(error.to_string()))?;
    let layout = layout(path.via(), &translation.bindings).map_err(on_route)?;
    let words = compile(&translation).map_err(|error| on_route(error.to_string()))?;
    let name = translation.entry_points.first().map(|e| e.name.clone());
    let name = name.ok_or_else(|| on_route("the translation has no entry point".to_owned()))?;
    Ok(Routed::Spirv(Box::new(Foreign {
        words,
        entry_point: name,
        workgroup_size: shader.workgroup_size(entry_point),
        bindings: translation.bindings,
        layout,
    })))
}

/// On the route `wgsl` or `spirv`, translates the IR to WGSL or SPIR-V with naga, and reads the translation with naga.
/// On other routes, returns the IR unchanged.
pub(super) fn through_naga(path: Path, ir: Ir) -> Result<Ir, PathError> {
    let target = match path.via() {
        Via::Wgsl => Target::Wgsl,
        Via::Spirv => Target::Spirv,
        _ => return Ok(ir),
    };
    let on_route = |message: String| PathError::Route { path, message };
    let shader = Shader::of(ir).map_err(|error| on_route(error.to_string()))?;
    let names = shader.entry_points().into_iter().map(|entry_point| entry_point.name);
    let translation = shader.translate(target, None);
    let again = match translation.map_err(|error| on_route(error.to_string()))?.code {
        Code::Text(text) => Shader::parse(&text),
        Code::Words(words) => Shader::from_spirv(&words),
    };
    let again =
        again.map_err(|error| on_route(format!("naga can't read naga's own {target}: {error}")));
    let mut ir = again?.into_module();
    // naga's WGSL writer renames `step` and `pass1` to `step_` and `pass1_`, but keeps the order of entry points.
    for (entry_point, name) in ir.entry_points.iter_mut().zip(names) {
        entry_point.name = name;
    }
    Ok(ir)
}

impl Foreign {
    /// The binding number in group 0 of the SPIR-V, for the resource with this group and binding number in WGSL.
    /// Returns `None` if the kernel doesn't use the resource.
    pub(super) fn place(&self, group: u32, binding: u32) -> Option<u32> {
        let used = self.bindings.iter().find(|r| r.used && r.wgsl == (group, binding));
        used.map(|resource| resource.translated.1)
    }

    /// Makes the pipeline. wgpu can't see the shader's resources, so the pipeline gets an explicit layout.
    pub(super) fn pipeline(&self, device: &wgpu::Device) -> wgpu::ComputePipeline {
        let module = spirv_as_it_is(device, &self.words, &self.entry_point, self.workgroup_size);
        let group = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: None,
            entries: &self.layout,
        });
        let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: None,
            bind_group_layouts: &[Some(&group)],
            ..Default::default()
        });
        device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some(&self.entry_point),
            layout: Some(&layout),
            module: &module,
            entry_point: Some(&self.entry_point),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        })
    }
}

/// The bind group layout of the resources that an entry point uses. Their binding numbers are the numbers in the
/// translated shader.
fn layout(via: Via, bindings: &Bindings) -> Result<Vec<wgpu::BindGroupLayoutEntry>, String> {
    bindings.iter().filter(|resource| resource.used).map(|resource| entry(via, resource)).collect()
}

fn entry(via: Via, resource: &Resource) -> Result<wgpu::BindGroupLayoutEntry, String> {
    let buffer =
        |ty| wgpu::BindingType::Buffer { ty, has_dynamic_offset: false, min_binding_size: None };
    let ty = match resource.kind {
        Kind::Uniform => buffer(wgpu::BufferBindingType::Uniform),
        Kind::Storage { read_only } => buffer(wgpu::BufferBindingType::Storage { read_only }),
        Kind::Texture { .. } | Kind::Sampler if via == Via::Glsl => {
            return Err(
                "naga's GLSL combines each texture with a sampler, but wgpu's Vulkan can't bind \
                 such a pair"
                    .to_owned(),
            );
        }
        Kind::Sampler => {
            return Err(
                "naga's HLSL reads samplers from a heap of 2,048 samplers, which wgpu's Vulkan can't bind"
                    .to_owned(),
            );
        }
        Kind::Texture { dimensions, arrayed, texels } => wgpu::BindingType::Texture {
            sample_type: match texels {
                // Without samplers there is no filtering.
                Texels::Float => wgpu::TextureSampleType::Float { filterable: false },
                Texels::Sint => wgpu::TextureSampleType::Sint,
                Texels::Uint => wgpu::TextureSampleType::Uint,
                Texels::Depth => wgpu::TextureSampleType::Depth,
            },
            view_dimension: match (dimensions, arrayed) {
                (1, _) => wgpu::TextureViewDimension::D1,
                (2, false) => wgpu::TextureViewDimension::D2,
                (2, true) => wgpu::TextureViewDimension::D2Array,
                (3, _) => wgpu::TextureViewDimension::D3,
                (_, false) => wgpu::TextureViewDimension::Cube,
                (_, true) => wgpu::TextureViewDimension::CubeArray,
            },
            multisampled: false,
        },
        _ => {
            let (group, binding) = resource.wgsl;
            return Err(format!(
                "Karat binds uniform buffers, storage buffers and sampled textures on this route, \
                 but not the resource at @group({group}) @binding({binding})"
            ));
        }
    };
    let visibility = wgpu::ShaderStages::COMPUTE;
    Ok(wgpu::BindGroupLayoutEntry { binding: resource.translated.1, visibility, ty, count: None })
}
