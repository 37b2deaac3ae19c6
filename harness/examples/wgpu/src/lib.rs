//! Moves particles with wgpu.

use wgpu::util::DeviceExt;
use wgpu::{BufferUsages, PollType};

/// A particle in the shader's layout.
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Particle {
    /// The position, with coordinates from 0 to 1.
    pub position: [f32; 2],
    /// The velocity, in widths of the box per second.
    pub velocity: [f32; 2],
}

/// The text of the shader, compiled into the program.
pub const SHADER: &str = include_str!("../shaders/particles.wgsl");

/// Moves particles for this number of seconds, on the first adapter. Returns `None` if there is no adapter, or if the
/// run fails.
#[must_use]
pub fn stepped(particles: &[Particle], seconds: f32) -> Option<Vec<Particle>> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let adapter = pollster::block_on(instance.request_adapter(&Default::default())).ok()?;
    let wanted = wgpu::DeviceDescriptor { required_limits: adapter.limits(), ..Default::default() };
    let (device, queue) = pollster::block_on(adapter.request_device(&wanted)).ok()?;
    let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: None,
        source: wgpu::ShaderSource::Wgsl(SHADER.into()),
    });
    let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &module,
        entry_point: Some("step"),
        compilation_options: Default::default(),
        cache: None,
    });
    let buffer = |contents: &[u8], usage| {
        device.create_buffer_init(&wgpu::util::BufferInitDescriptor {
            label: None,
            contents,
            usage,
        })
    };
    let words: &[u8] = bytemuck::cast_slice(particles);
    let own = buffer(words, BufferUsages::STORAGE | BufferUsages::COPY_SRC);
    let time = buffer(bytemuck::bytes_of(&[seconds; 4]), BufferUsages::UNIFORM);
    let read = buffer(words, BufferUsages::MAP_READ | BufferUsages::COPY_DST);
    let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: None,
        layout: &pipeline.get_bind_group_layout(0),
        entries: &[
            wgpu::BindGroupEntry { binding: 0, resource: own.as_entire_binding() },
            wgpu::BindGroupEntry { binding: 1, resource: time.as_entire_binding() },
        ],
    });
    let mut encoder = device.create_command_encoder(&Default::default());
    let mut pass = encoder.begin_compute_pass(&Default::default());
    pass.set_pipeline(&pipeline);
    pass.set_bind_group(0, &group, &[]);
    pass.dispatch_workgroups(u32::try_from(particles.len()).ok()?.div_ceil(64), 1, 1);
    drop(pass);
    encoder.copy_buffer_to_buffer(&own, 0, &read, 0, own.size());
    queue.submit([encoder.finish()]);
    read.slice(..).map_async(wgpu::MapMode::Read, |_| {});
    device.poll(PollType::wait_indefinitely()).ok()?;
    let view = read.slice(..).get_mapped_range().ok()?;
    Some(bytemuck::cast_slice(&view).to_vec())
}
