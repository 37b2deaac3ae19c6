//! Dispatches passes with wgpu.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::{Afterwards, DispatchError, Pass, Passes};
use crate::path::{Device, MOST_ROUNDS, PathError, guard};
use crate::probe::{Kept, Resource, upload_shared};
use crate::reflect::{BindingKind, Program, Watched};

/// A program that counts the iterations of its loops, and the binding of the buffer with the counts.
struct Counted {
    watched: Watched,
    binding: u32,
}

impl Device {
    pub(crate) fn dispatch(&self, passes: &Passes) -> Result<Afterwards, DispatchError> {
        self.dispatch_with(passes, self.leaves_loops())
    }

    /// Dispatches the passes. If `watched` is `true`, first checks that the driver won't stop a loop early.
    pub fn dispatch_with(
        &self,
        passes: &Passes,
        watched: bool,
    ) -> Result<Afterwards, DispatchError> {
        let (path, of) = (self.path(), passes.passes[0].name.clone());
        let limits = self.device.limits();
        let sides = [
            limits.max_compute_workgroup_size_x,
            limits.max_compute_workgroup_size_y,
            limits.max_compute_workgroup_size_z,
        ];
        passes.expect_sizes(path, sides, limits.max_compute_invocations_per_workgroup)?;
        let _turn = self.turn();
        let _deadline = guard(path, move || format!("the dispatch of `{of}` on path {path}"));
        if watched {
            self.expect_whole_loops(passes)?;
        }
        let plain: Vec<Option<Counted>> = passes.passes.iter().map(|_| None).collect();
        self.run_passes(passes, &plain).map(|(afterwards, _)| afterwards)
    }

    /// Returns an error if the driver would silently stop a loop early.
    fn expect_whole_loops(&self, passes: &Passes) -> Result<(), DispatchError> {
        let limit = u32::try_from(MOST_ROUNDS).expect("it fits");
        let counted = |pass: &Pass| {
            let program = &pass.program;
            if program.most_rounds().is_some_and(|rounds| rounds < MOST_ROUNDS) {
                return None;
            }
            let binding = program.free_binding();
            let watched = program.watching_rounds(binding, limit, false);
            let bindings = watched.program.compute_entry_point(&pass.entry_point);
            let bindings = bindings.map(|(bindings, _)| bindings).unwrap_or_default();
            // The counted loops may belong to another entry point of the module.
            let counts = bindings.iter().any(|b| (b.group, b.binding) == (0, binding));
            counts.then_some(Counted { watched, binding })
        };
        let counted: Vec<Option<Counted>> = passes.passes.iter().map(counted).collect();
        if counted.iter().all(Option::is_none) {
            return Ok(());
        }
        let (_, counts) = self.run_passes(passes, &counted)?;
        for (pass, (counted, counts)) in passes.passes.iter().zip(counted.iter().zip(counts)) {
            let Some(counted) = counted else { continue };
            let most = counted.watched.loops.iter().zip(counts).max_by_key(|(_, count)| *count);
            if let Some((place, count)) = most.filter(|(_, count)| *count > 0) {
                let of = format!("`{}`", pass.name);
                let diagnostic = self.left_loop(&of, count, place.as_ref());
                return Err(DispatchError::Rounds(Box::new(diagnostic)));
            }
        }
        Ok(())
    }

    /// Runs the passes. Returns the contents of the written resources. For each pass, also returns how often each loop
    /// took too many iterations.
    fn run_passes(
        &self,
        passes: &Passes,
        counted: &[Option<Counted>],
    ) -> Result<(Afterwards, Vec<Vec<u32>>), DispatchError> {
        let mut resources = Vec::new();
        let mut kept: Vec<(usize, Kept)> = Vec::new();
        for (number, held) in passes.resources.iter().enumerate() {
            let uses: Vec<_> = passes.uses(number).collect();
            let bindings: Vec<_> = uses.iter().map(|(_, binding)| *binding).collect();
            let (pass, _) = uses.first().expect("a resource is used");
            let resource = upload_shared(self, &pass.program, &bindings, &held.fixture)?;
            if let Some((pass, binding)) = passes.writer(number) {
                let own = (binding, &held.fixture);
                let one = Kept::new(self, &pass.program, own, &resource, 1)?;
                kept.extend(one.map(|one| (number, one)));
            }
            resources.push(resource);
        }
        let mut steps = Vec::new();
        for (pass, counted) in passes.passes.iter().zip(counted) {
            steps.push(self.step(pass, counted.as_ref(), &resources)?);
        }
        let staged = self.checked(|| {
            let mut encoder = self.device.create_command_encoder(&Default::default());
            for (pass, step) in passes.passes.iter().zip(&steps) {
                let mut compute = encoder.begin_compute_pass(&Default::default());
                compute.set_pipeline(&step.pipeline.pipeline);
                for (index, group) in (0..).zip(&step.groups) {
                    compute.set_bind_group(index, group, &[]);
                }
                if let Some(bytes) = &step.immediates {
                    compute.set_immediates(0, bytes);
                }
                let [x, y, z] = pass.workgroups;
                compute.dispatch_workgroups(x, y, z);
            }
            for (_, kept) in &kept {
                kept.keep(&mut encoder, 0);
                kept.stage(&mut encoder, 1);
            }
            let staged = |counts: &wgpu::Buffer| {
                self.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("counts"),
                    size: counts.size(),
                    usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                })
            };
            let staged: Vec<Option<wgpu::Buffer>> =
                steps.iter().map(|step| step.counts.as_ref().map(staged)).collect();
            for (step, to) in steps.iter().zip(&staged) {
                if let (Some(from), Some(to)) = (&step.counts, to) {
                    encoder.copy_buffer_to_buffer(from, 0, to, 0, from.size());
                }
            }
            self.queue.submit([encoder.finish()]);
            staged
        })?;
        let mut afterwards = Afterwards::new();
        for (number, kept) in &kept {
            let words = kept.words(self, 1)?.pop().expect("one run has the words of one");
            afterwards.push((*number, words));
        }
        let mut counts = Vec::new();
        for staged in &staged {
            counts.push(match staged {
                Some(staged) => {
                    self.read_back(staged, staged.size(), bytemuck::pod_collect_to_vec)?
                }
                None => Vec::new(),
            });
        }
        Ok((afterwards, counts))
    }

    fn step(
        &self,
        pass: &Pass,
        counted: Option<&Counted>,
        resources: &[Resource],
    ) -> Result<Step, DispatchError> {
        let program: &Program = counted.map_or(&pass.program, |counted| &counted.watched.program);
        let pipeline = self.pipeline_of_ir(program.module().clone(), &pass.entry_point)?;
        let counts = match counted {
            Some(counted) => Some(self.checked(|| {
                self.device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("counts"),
                    size: 4 * counted.watched.loops.len() as u64,
                    usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC,
                    mapped_at_creation: false,
                })
            })?),
            None => None,
        };
        let mut entries: BTreeMap<u32, Vec<wgpu::BindGroupEntry<'_>>> = BTreeMap::new();
        let mut immediates = None;
        for (binding, number) in &pass.bindings {
            match (&resources[*number], binding.kind) {
                (Resource::Immediate(bytes), _) => immediates = Some(bytes.clone()),
                (resource, kind) if kind != BindingKind::Immediate && Passes::is_bound(binding) => {
                    let place = pipeline.place(binding.group, binding.binding);
                    if let (Some((group, binding)), Some(resource)) = (place, resource.binding()) {
                        let entry = wgpu::BindGroupEntry { binding, resource };
                        entries.entry(group).or_default().push(entry);
                    }
                }
                _ => {}
            }
        }
        if immediates.is_some() && pipeline.is_foreign() {
            let message =
                "Karat can't pass immediates to a shader that naga didn't translate".to_owned();
            return Err(PathError::Route { path: self.path(), message }.into());
        }
        if let (Some(counts), Some(counted)) = (&counts, counted)
            && let Some((group, binding)) = pipeline.place(0, counted.binding)
        {
            let resource = counts.as_entire_binding();
            entries.entry(group).or_default().push(wgpu::BindGroupEntry { binding, resource });
        }
        let groups = self.checked(|| {
            let groups = entries.keys().copied().max().map_or(0, |last| last + 1);
            let group = |group| {
                self.device.create_bind_group(&wgpu::BindGroupDescriptor {
                    label: None,
                    layout: &pipeline.pipeline.get_bind_group_layout(group),
                    entries: entries.get(&group).map_or(&[], Vec::as_slice),
                })
            };
            (0..groups).map(group).collect()
        })?;
        drop(entries);
        Ok(Step { pipeline, groups, immediates, counts })
    }
}

struct Step {
    pipeline: Arc<crate::path::Pipeline>,
    groups: Vec<wgpu::BindGroup>,
    immediates: Option<Vec<u8>>,
    /// A buffer that counts, for each loop, how often the loop took too many iterations.
    counts: Option<wgpu::Buffer>,
}
