//! Does the work of a check without Karat, for comparison: calls one function by hand-written wgpu code.

use glam::DVec2;
use shaders::sampling;

/// The function under test and its kernel, as an author would copy them into one file.
const WGSL: &str = include_str!("bare.wgsl");

pub(crate) struct Bare {
    device: wgpu::Device,
    queue: wgpu::Queue,
}

impl Bare {
    pub(crate) fn open() -> Self {
        let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
            backends: wgpu::Backends::VULKAN,
            flags: wgpu::InstanceFlags::empty(),
            ..wgpu::InstanceDescriptor::new_without_display_handle()
        });
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::VULKAN));
        let adapter = adapters.into_iter().next().expect("a Vulkan adapter");
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            required_limits: adapter.limits(),
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..wgpu::DeviceDescriptor::default()
        }))
        .expect("the device opens");
        Self { device, queue }
    }

    /// Compiles the shader, runs `cases` cases and compares them with the reference. Returns the largest absolute
    /// error.
    pub(crate) fn run(&self, cases: u32) -> f64 {
        let inputs = Self::inputs(cases);
        self.call(&inputs, |outputs| {
            let mut worst = 0.0_f64;
            for (input, output) in inputs.iter().zip(outputs) {
                for (actual, expected) in output.iter().zip(expected(*input)) {
                    worst = worst.max((f64::from(*actual) - expected).abs());
                }
            }
            worst
        })
    }

    pub(crate) fn inputs(cases: u32) -> Vec<[f32; 3]> {
        let mut state = 1_u32;
        let mut random = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            f64::from(state) / 4_294_967_296.0
        };
        (0..cases)
            .map(|_| [1e-4 + (1.0 - 1e-4) * random(), random(), random()].map(|v| v as f32))
            .collect()
    }

    /// The sum of the last components of the reference's results.
    pub(crate) fn reference(inputs: &[[f32; 3]]) -> f64 {
        inputs.iter().map(|input| expected(*input)[2]).sum()
    }

    /// Compiles the shader, uploads the inputs, dispatches and reads the results back.
    pub(crate) fn call<T>(&self, inputs: &[[f32; 3]], read: impl FnOnce(&[[f32; 3]]) -> T) -> T {
        let Self { device, queue } = self;
        let cases = u32::try_from(inputs.len()).expect("a dispatch of them");
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: None,
            source: wgpu::ShaderSource::Wgsl(WGSL.into()),
        });
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &module,
            entry_point: Some("main"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        let size = u64::from(cases) * 12;
        let buffer = |usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size,
                usage,
                mapped_at_creation: false,
            })
        };
        let arguments = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST);
        let results = buffer(wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC);
        let staging = buffer(wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST);
        queue.write_buffer(&arguments, 0, bytemuck::cast_slice(inputs));
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &[
                wgpu::BindGroupEntry { binding: 0, resource: arguments.as_entire_binding() },
                wgpu::BindGroupEntry { binding: 1, resource: results.as_entire_binding() },
            ],
        });
        let mut encoder = device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.dispatch_workgroups(cases.div_ceil(64), 1, 1);
        }
        encoder.copy_buffer_to_buffer(&results, 0, &staging, 0, size);
        queue.submit([encoder.finish()]);
        let slice = staging.slice(..);
        slice.map_async(wgpu::MapMode::Read, |result| result.expect("the buffer maps"));
        device.poll(wgpu::PollType::wait_indefinitely()).expect("the queue ends");
        let view = slice.get_mapped_range().expect("it is mapped");
        read(bytemuck::cast_slice(&view))
    }
}

fn expected([alpha, x, y]: [f32; 3]) -> [f64; 3] {
    sampling::ggx_normal(f64::from(alpha), DVec2::new(f64::from(x), f64::from(y))).to_array()
}
