//! Opened paths: adapter, device, queue, and the pipelines of a path.

use std::borrow::Cow;
use std::collections::HashMap;
use std::sync::mpsc::RecvTimeoutError;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use parking_lot::{ReentrantMutex, ReentrantMutexGuard};

use crate::diagnostic::{Diagnostic, Span};
use crate::reflect::{self, Ir, Overrides};

use super::route::{self, Foreign, Routed};
use super::{Adapter, Api, Path, PathError, driver, guard_opening};
use crate::settings;

/// The number of loop iterations after which Mesa's llvmpipe stops all loops of an invocation, on Vulkan and on GL.
/// Mesa's sources call this number `LP_MAX_TGSI_LOOP_ITERATIONS`.
pub(crate) const MOST_ROUNDS: u64 = 65_535;

/// A shader that Karat compiles to test a driver's compute support. On OpenGL 3.3, wgpu reports support for compute
/// shaders if the driver has `GL_ARB_compute_shader`, as NVIDIA's driver has. But naga can't write compute shaders
/// for OpenGL 3.3.
const NO_WORK: &str = "@compute @workgroup_size(1) fn work() {}";

const CALLBACK: Duration = Duration::from_millis(5);

/// The device of one path.
#[derive(Debug)]
pub struct Device {
    path: Path,
    adapter: Adapter,
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    color_format: wgpu::TextureFormat,
    multisampled_format: wgpu::TextureFormat,
    pipelines: Mutex<HashMap<blake3::Hash, Arc<Pipeline>>>,
    /// A lock for calls of the driver, if the driver serves only one thread at a time. Otherwise `None`.
    turns: Option<ReentrantMutex<()>>,
    subgroups: Option<[u32; 2]>,
}

pub(crate) struct Pipeline {
    pub(crate) pipeline: wgpu::ComputePipeline,
    /// The SPIR-V of the pipeline, if a compiler other than naga made the SPIR-V.
    foreign: Option<Box<Foreign>>,
}

impl std::fmt::Debug for Pipeline {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.pipeline.fmt(f)
    }
}

impl Pipeline {
    /// Checks if a compiler other than naga made the pipeline's SPIR-V.
    pub(crate) fn is_foreign(&self) -> bool {
        self.foreign.is_some()
    }

    /// Finds a resource by its group and binding in WGSL. Returns the resource's group and binding in the pipeline, or
    /// `None` if the pipeline doesn't use the resource.
    pub(crate) fn place(&self, group: u32, binding: u32) -> Option<(u32, u32)> {
        match &self.foreign {
            None => Some((group, binding)),
            Some(foreign) => foreign.place(group, binding).map(|number| (0, number)),
        }
    }
}

/// The right to call the driver. Only one thread at a time has this right. See [`Device::turn`].
pub(crate) type Turn<'d> = Option<ReentrantMutexGuard<'d, ()>>;

impl Device {
    pub(super) fn open(path: Path) -> Result<Self, PathError> {
        let unavailable = |reason: String| PathError::Unavailable { path, reason };
        if path.api() == Api::Cpu {
            let reason = "Karat's engine has no device: use the path of a driver here";
            return Err(unavailable(reason.to_owned()));
        }
        if let Some(reason) = route::missing(path) {
            return Err(unavailable(reason));
        }
        if !exists(path) {
            return Err(unavailable("this operating system doesn't have this API".to_owned()));
        }
        let _deadline = guard_opening(path);
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: backends(path),
            // Turns validation layers off, because they cost more time than the test. wgpu's own validation stays on.
            flags: wgpu::InstanceFlags::empty(),
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let adapters = pollster::block_on(instance.enumerate_adapters(backends(path)));
        let wanted = settings::current()?.adapter.as_ref();
        let mut candidates: Vec<_> = adapters
            .into_iter()
            .filter(|adapter| {
                let info = adapter.get_info();
                let name = info.name.to_lowercase();
                let of_family = |family| driver::family(&info.name, &driver_of(&info)) == family;
                path.driver().is_none_or(of_family)
                    && wanted.as_ref().is_none_or(|wanted| name.contains(&wanted.to_lowercase()))
            })
            .collect();
        candidates.sort_by_key(|adapter| preference(&adapter.get_info()));
        let adapter = candidates.into_iter().next().ok_or_else(|| {
            unavailable(match (wanted, path.driver()) {
                (None, Some(family)) => format!("no adapter of the family `{family}` found"),
                (Some(wanted), Some(family)) => format!(
                    "no adapter of the family `{family}` has a name that contains `{wanted}` \
                     (KARAT_ADAPTER)"
                ),
                (Some(wanted), None) => {
                    format!("no adapter's name contains `{wanted}` (KARAT_ADAPTER)")
                }
                (None, None) => {
                    "no adapter found: no driver is installed, or no driver loads".to_owned()
                }
            })
        })?;
        let compute = wgpu::DownlevelFlags::COMPUTE_SHADERS;
        if !adapter.get_downlevel_capabilities().flags.contains(compute) {
            return Err(unavailable("the driver can't run compute shaders".to_owned()));
        }
        let needed = route::features(path);
        if !adapter.features().contains(needed) {
            return Err(unavailable(
                "wgpu can't pass the route's shaders to this driver".to_owned(),
            ));
        }
        let optional = wgpu::Features::SHADER_F16
            | wgpu::Features::FLOAT32_FILTERABLE
            | wgpu::Features::FLOAT32_BLENDABLE
            // Karat counts loop iterations in vertex shaders with this feature.
            | wgpu::Features::VERTEX_WRITABLE_STORAGE
            // Fixtures need these features.
            | wgpu::Features::IMMEDIATES
            | wgpu::Features::TEXTURE_FORMAT_16BIT_NORM
            // Compute passes need these features.
            | wgpu::Features::SUBGROUP
            | wgpu::Features::SUBGROUP_BARRIER
            // The colour targets of frames need these features.
            | wgpu::Features::RG11B10UFLOAT_RENDERABLE
            | wgpu::Features::DEPTH32FLOAT_STENCIL8
            | wgpu::Features::INDIRECT_FIRST_INSTANCE
            | wgpu::Features::TEXTURE_ADAPTER_SPECIFIC_FORMAT_FEATURES;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("karat"),
            required_features: adapter.features() & optional | needed,
            required_limits: adapter.limits(),
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| unavailable(error.to_string()))?;
        let full = wgpu::TextureFormat::Rgba32Float;
        let usages = adapter.get_texture_format_features(full).allowed_usages;
        let renderable = usages.contains(wgpu::TextureUsages::RENDER_ATTACHMENT);
        let specific = wgpu::Features::TEXTURE_ADAPTER_SPECIFIC_FORMAT_FEATURES;
        let flags = adapter.get_texture_format_features(full).flags;
        let multisampled = device.features().contains(specific)
            && flags.contains(wgpu::TextureFormatFeatureFlags::MULTISAMPLE_X4);
        let multisampled_format =
            if multisampled { full } else { wgpu::TextureFormat::Rgba16Float };
        let color_format = if renderable { full } else { wgpu::TextureFormat::Rgba16Float };
        let info = adapter.get_info();
        let sizes = [info.subgroup_min_size, info.subgroup_max_size];
        let has_subgroups = device.features().contains(wgpu::Features::SUBGROUP);
        let subgroups = Some(sizes).filter(|_| has_subgroups);
        let (path_name, driver) = (path.to_string(), driver_of(&info));
        let software = info.device_type == wgpu::DeviceType::Cpu;
        let adapter = Adapter { path: path_name, name: info.name, driver, software };
        // Mesa's GL reports llvmpipe as hardware.
        let adapter = Adapter { software: software || adapter.is_llvmpipe(), ..adapter };
        let turns = (path.api() == Api::Gl).then(ReentrantMutex::default);
        let pipelines = Mutex::default();
        let opened = Self {
            path,
            adapter,
            device,
            queue,
            color_format,
            multisampled_format,
            subgroups,
            pipelines,
            turns,
        };
        match path.api() == Api::Gl
            && opened.compute_pipeline(NO_WORK, "work", &Overrides::default()).is_err()
        {
            true => Err(unavailable(format!(
                "wgpu can't compile compute shaders for this driver: they need OpenGL 4.3 or OpenGL ES 3.1, but \
                 the driver has {}",
                opened.adapter.driver
            ))),
            false => Ok(opened),
        }
    }

    /// Waits until this thread may call the driver (its turn), if the driver serves one thread at a time. wgpu panics
    /// if a thread waits six seconds for GL's context. On a busy machine, another thread's compilation can take that
    /// long.
    ///
    /// Take a turn for every call of the driver, including the release of resources. Release the turn before you
    /// wait for other threads. Take the turn before a deadline begins, so that the time limit doesn't include the
    /// wait.
    pub(crate) fn turn(&self) -> Turn<'_> {
        self.turns.as_ref().map(ReentrantMutex::lock)
    }

    /// The path of the device.
    pub fn path(&self) -> Path {
        self.path
    }

    /// The adapter, as the driver describes it.
    pub fn adapter(&self) -> &Adapter {
        &self.adapter
    }

    /// Checks if the driver stops loops after [`MOST_ROUNDS`] iterations and continues with the current values.
    pub(crate) fn leaves_loops(&self) -> bool {
        self.adapter.is_llvmpipe()
    }

    /// Checks if the driver fills the borders of a cube map only when a draw uses the cube map. Kernels would read
    /// undefined borders on such a driver.
    pub(crate) fn fills_borders_by_draws(&self) -> bool {
        self.adapter.is_swiftshader()
    }

    /// The message about a loop that the driver stopped.
    pub(crate) fn left_loop(&self, of: &str, rounds: u32, place: Option<&Span>) -> Diagnostic {
        let path = self.path;
        let diagnostic = Diagnostic::new(format!(
            "on path `{path}` the driver doesn't finish {of}: this loop runs {rounds} iterations \
             or more"
        ));
        let diagnostic = match place {
            Some(span) => diagnostic.at(span.first_line(), ""),
            None => diagnostic,
        };
        let driver = &self.adapter.name;
        diagnostic
            .note(format!(
                "{driver} stops the loops of an invocation after {MOST_ROUNDS} iterations in total, and continues with \
                 the current values"
            ))
            .note("use fewer iterations, or run on a driver without this limit")
    }

    /// The smallest and the largest subgroup size. `None` if the device has no subgroups.
    pub(crate) fn subgroups(&self) -> Option<[u32; 2]> {
        self.subgroups
    }

    pub(crate) fn has_f16(&self) -> bool {
        self.device.features().contains(wgpu::Features::SHADER_F16)
    }

    /// The format for sampled float textures. The format has 32-bit floats if the path can filter them, and 16-bit
    /// floats otherwise.
    pub(crate) fn float_format(&self) -> wgpu::TextureFormat {
        if self.device.features().contains(wgpu::Features::FLOAT32_FILTERABLE) {
            wgpu::TextureFormat::Rgba32Float
        } else {
            wgpu::TextureFormat::Rgba16Float
        }
    }

    /// The format for float textures with several samples.
    pub(crate) fn multisampled_format(&self) -> wgpu::TextureFormat {
        self.multisampled_format
    }

    /// The format for frames: 32-bit floats, or 16-bit floats if the path can't draw into 32-bit floats.
    pub(crate) fn color_format(&self) -> wgpu::TextureFormat {
        self.color_format
    }

    /// Runs `work`. Returns an error if wgpu reports an error while `work` runs.
    pub(crate) fn checked<T>(&self, work: impl FnOnce() -> T) -> Result<T, PathError> {
        self.watched(work).map_err(|error| self.failed(&error))
    }

    /// Runs `make`, which makes shader modules and pipelines. If `make` fails, the error says that the driver refuses
    /// the shader, or that memory ran out.
    pub(crate) fn made<T>(&self, make: impl FnOnce() -> T) -> Result<T, PathError> {
        self.watched(make).map_err(|error| match error {
            wgpu::Error::OutOfMemory { .. } => self.failed(&error),
            refusal => PathError::Refused { path: self.path, message: refusal.to_string() },
        })
    }

    fn failed(&self, error: &wgpu::Error) -> PathError {
        PathError::Driver { path: self.path, message: error.to_string() }
    }

    fn watched<T>(&self, work: impl FnOnce() -> T) -> Result<T, wgpu::Error> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let value = work();
        // Error scopes end in reverse order.
        let validation = pollster::block_on(validation.pop());
        let internal = pollster::block_on(internal.pop());
        let memory = pollster::block_on(memory.pop());
        match validation.or(internal).or(memory) {
            None => Ok(value),
            Some(error) => Err(error),
        }
    }

    /// The compute pipeline of a kernel. Karat compiles the pipeline once for each WGSL text and set of overrides.
    pub(crate) fn compute_pipeline(
        &self,
        wgsl: &str,
        entry_point: &str,
        overrides: &Overrides,
    ) -> Result<Arc<Pipeline>, PathError> {
        let key = match overrides.is_empty() {
            true => blake3::hash(wgsl.as_bytes()),
            false => blake3::hash(format!("{overrides:?} {wgsl}").as_bytes()),
        };
        let lock = || self.pipelines.lock().expect("no thread panics while it holds the lock");
        if let Some(pipeline) = lock().get(&key) {
            return Ok(Arc::clone(pipeline));
        }
        let module = reflect::parsed_with(wgsl, overrides)
            .map_err(|message| PathError::Driver { path: self.path, message })?;
        let pipeline = self.pipeline_of_ir(Ir::clone(&module), entry_point)?;
        lock().insert(key, Arc::clone(&pipeline));
        Ok(pipeline)
    }

    /// Makes a compute pipeline from naga's IR, along the path's route.
    pub(crate) fn pipeline_of_ir(
        &self,
        module: Ir,
        entry_point: &str,
    ) -> Result<Arc<Pipeline>, PathError> {
        // The recursion of translators and drivers is as deep as the shader's nesting.
        reflect::on_deep_stack(|| match route::take(self.path, module, entry_point)? {
            Routed::Ir(module) => {
                let pipeline = self.pipeline_of_wgpu(*module, entry_point)?;
                Ok(Arc::new(Pipeline { pipeline, foreign: None }))
            }
            Routed::Spirv(foreign) => {
                let pipeline = self.made(|| foreign.pipeline(&self.device))?;
                Ok(Arc::new(Pipeline { pipeline, foreign: Some(foreign) }))
            }
        })
    }

    /// Translates a frame's shader along the path's route, and returns naga's IR for wgpu.
    pub(crate) fn drawn(&self, module: Ir) -> Result<Ir, PathError> {
        let undrawn = || PathError::Route {
            path: self.path,
            message: "Karat can't draw frames with SPIR-V that naga didn't write".to_owned(),
        };
        match route::takes_wgpu(self.path) {
            true => route::through_naga(self.path, module),
            false => Err(undrawn()),
        }
    }

    fn pipeline_of_wgpu(
        &self,
        module: Ir,
        entry_point: &str,
    ) -> Result<wgpu::ComputePipeline, PathError> {
        let source = wgpu::ShaderSource::Naga(Cow::Owned(module));
        self.made(|| {
            let module = self
                .device
                .create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
            self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry_point),
                layout: None,
                module: &module,
                entry_point: Some(entry_point),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            })
        })
    }

    /// Waits for all submitted work. The caller must hold a deadline's [`guard`](super::deadline::guard).
    pub(crate) fn wait(&self) -> Result<(), PathError> {
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .map(drop)
            .map_err(|error| PathError::Driver { path: self.path, message: error.to_string() })
    }

    /// Reads the mapped contents of a buffer, and unmaps the buffer. The thread releases its turn while `read` runs,
    /// because `read` may wait for other threads.
    pub(crate) fn read_back<T>(
        &self,
        buffer: &wgpu::Buffer,
        size: u64,
        read: impl FnOnce(&[u8]) -> T,
    ) -> Result<T, PathError> {
        let failed = |message: String| PathError::Driver { path: self.path, message };
        let turn = self.turn();
        let (sender, receiver) = std::sync::mpsc::channel();
        let slice = buffer.slice(0..size);
        slice.map_async(wgpu::MapMode::Read, move |result| {
            // The receiver exists until it gets the result.
            drop(sender.send(result));
        });
        // The mapping may be unfinished when this thread's poll ends: another thread's poll may have taken the callback
        // without calling it yet. The caller's deadline limits this loop.
        let mapped = loop {
            self.wait()?;
            match receiver.recv_timeout(CALLBACK) {
                Ok(mapped) => break mapped,
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(failed(
                        "wgpu didn't map a buffer into memory, and gave no reason".to_owned(),
                    ));
                }
            }
        };
        mapped.map_err(|error| failed(error.to_string()))?;
        drop(turn);
        let value = {
            let view = slice.get_mapped_range().map_err(|error| failed(error.to_string()))?;
            read(&view)
        };
        let _turn = self.turn();
        buffer.unmap();
        Ok(value)
    }
}

/// The name and the version of the driver, as far as the adapter reports them.
fn driver_of(info: &wgpu::AdapterInfo) -> String {
    format!("{} {}", info.driver, info.driver_info).trim().to_owned()
}

/// Checks if the path's API exists on this operating system.
pub(super) fn exists(path: Path) -> bool {
    let backends = backends(path);
    !backends.is_empty() && wgpu::Instance::enabled_backend_features().contains(backends)
}

fn backends(path: Path) -> wgpu::Backends {
    match path.api() {
        Api::Vulkan => wgpu::Backends::VULKAN,
        Api::Metal => wgpu::Backends::METAL,
        Api::Dx12 => wgpu::Backends::DX12,
        Api::Gl => wgpu::Backends::GL,
        Api::Cpu | Api::Process => wgpu::Backends::empty(),
    }
}

/// The rank of an adapter: hardware first, and software rasterisers last. Of the rasterisers, Mesa's is first, because
/// most machines have it. To use another rasteriser, name the rasteriser in the path.
fn preference(info: &wgpu::AdapterInfo) -> (u8, bool) {
    let kind = match info.device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Cpu => 3,
        wgpu::DeviceType::Other => 4,
    };
    (kind, driver::family(&info.name, &driver_of(info)) == "swiftshader")
}
