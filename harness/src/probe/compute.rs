//! A whole compute entry point on a device: its buffers before and after.

use std::collections::BTreeMap;

use super::ProbeError;
use crate::diagnostic::{Diagnostic, Span};
use crate::path::{Device, guard};
use crate::reflect::{BindingKind, Program, Watched};

/// A buffer of an entry point.
#[derive(Clone, Debug)]
pub(crate) struct Data {
    pub(crate) group: u32,
    pub(crate) binding: u32,
    pub(crate) kind: BindingKind,
    pub(crate) bytes: Vec<u8>,
}

/// Rounds of an invocation that made-up data may make. More take a software driver seconds.
const PATIENCE: u32 = 4096;

/// Runs an entry point, by its name in the program's text, over one row of workgroups. The words of
/// the buffers that it may write, in the order of `data`, one buffer after the other.
///
/// Whose loops have no bound that naga's IR shows runs first in a copy whose loops are left after
/// [`PATIENCE`] rounds: what doesn't end with these data would hang a driver.
pub(crate) fn run_entry_point(
    device: &Device,
    program: &Program,
    name: &str,
    workgroups: u32,
    data: &[Data],
) -> Result<Vec<u32>, ProbeError> {
    if program.most_rounds().is_none_or(|rounds| rounds >= u64::from(PATIENCE)) {
        let binding = program.free_binding();
        let Watched { program, loops } = program.watching_rounds(binding, PATIENCE, true);
        let bound = program.compute_entry_point(name).map(|(bindings, _)| bindings);
        let counted = bound.iter().flatten().any(|b| (b.group, b.binding) == (0, binding));
        // Another entry point of the module may have the loops.
        if counted {
            let kind = BindingKind::Storage { writable: true };
            let counts = Data { group: 0, binding, kind, bytes: vec![0; 4 * loops.len()] };
            let data = [data, &[counts]].concat();
            let written = execute(device, &program, name, workgroups, &data)?;
            expect_ends(&loops, written.last().map_or(&[][..], Vec::as_slice))?;
        }
    }
    Ok(execute(device, program, name, workgroups, data)?.concat())
}

/// Refuses what has made too many rounds, with the loop that was left most often.
fn expect_ends(loops: &[Option<Span>], counts: &[u32]) -> Result<(), ProbeError> {
    let most = loops.iter().zip(counts).max_by_key(|(_, count)| **count);
    let Some((place, count)) = most.filter(|(_, count)| **count > 0) else { return Ok(()) };
    let message = format!("with made-up data this loop goes round {count} times or more");
    let mut diagnostic = Diagnostic::new(message);
    if let Some(place) = place {
        diagnostic = diagnostic.at(place.first_line(), "");
    }
    Err(ProbeError::Rounds { case: 0, diagnostic: Box::new(diagnostic) })
}

fn execute(
    device: &Device,
    program: &Program,
    name: &str,
    workgroups: u32,
    data: &[Data],
) -> Result<Vec<Vec<u32>>, ProbeError> {
    let (path, of) = (device.path(), name.to_owned());
    let _turn = device.turn();
    let _deadline = guard(path, move || format!("the entry point `{of}` on path {path}"));
    let pipeline = device
        .pipeline_of_ir(program.module().clone(), name)
        .map_err(|error| ProbeError::Compile { function: name.to_owned(), error })?;
    let buffers = device.checked(|| {
        let buffer = |data: &Data| {
            use wgpu::BufferUsages as Usage;
            let usage = match data.kind {
                BindingKind::Uniform => Usage::UNIFORM,
                _ => Usage::STORAGE | Usage::COPY_SRC,
            };
            let buffer = device.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("data"),
                size: data.bytes.len() as u64,
                usage: usage | Usage::COPY_DST,
                mapped_at_creation: false,
            });
            device.queue.write_buffer(&buffer, 0, &data.bytes);
            buffer
        };
        data.iter().map(buffer).collect::<Vec<_>>()
    })?;
    let mut entries: BTreeMap<u32, Vec<wgpu::BindGroupEntry<'_>>> = BTreeMap::new();
    for (data, buffer) in data.iter().zip(&buffers) {
        if let Some((group, binding)) = pipeline.place(data.group, data.binding) {
            let resource = buffer.as_entire_binding();
            entries.entry(group).or_default().push(wgpu::BindGroupEntry { binding, resource });
        }
    }
    let written: Vec<&wgpu::Buffer> = data
        .iter()
        .zip(&buffers)
        .filter(|(data, _)| data.kind == BindingKind::Storage { writable: true })
        .map(|(_, buffer)| buffer)
        .collect();
    let staging = device.checked(|| {
        let last = entries.keys().copied().max();
        let groups: Vec<wgpu::BindGroup> = (0..last.map_or(0, |last| last + 1))
            .map(|group| {
                device.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: None,
                    layout: &pipeline.pipeline.get_bind_group_layout(group),
                    entries: entries.get(&group).map_or(&[], Vec::as_slice),
                })
            })
            .collect();
        let staging: Vec<wgpu::Buffer> = written
            .iter()
            .map(|buffer| {
                device.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("staging"),
                    size: buffer.size(),
                    usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                })
            })
            .collect();
        let mut encoder = device.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&pipeline.pipeline);
            for (index, group) in (0..).zip(&groups) {
                pass.set_bind_group(index, group, &[]);
            }
            pass.dispatch_workgroups(workgroups, 1, 1);
        }
        for (from, to) in written.iter().zip(&staging) {
            encoder.copy_buffer_to_buffer(from, 0, to, 0, from.size());
        }
        device.queue.submit([encoder.finish()]);
        staging
    })?;
    let words = |buffer: &wgpu::Buffer| {
        let read = |bytes: &[u8]| bytemuck::pod_collect_to_vec::<u8, u32>(bytes);
        Ok(device.read_back(buffer, buffer.size(), read)?)
    };
    staging.iter().map(words).collect()
}
