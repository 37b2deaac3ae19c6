//! Runs a kernel on a device: buffers, bind groups, dispatch, and reading of results.
//!
//! Poison and canaries prove that each case wrote its own words.

use std::cell::Cell;

use super::bound::{Bound, Compiled, Resources, bind, compile};
use super::evidence::{self, Evidence};
use super::kept::Kept;
use super::kernel::{Kernel, UNIFORM_WORDS, WORKGROUP};
use super::poison::Poison;
use super::quads::Target;
use super::{Inputs, ProbeError, Probed, Resource, borders, upload};
use crate::diagnostic::Span;
use crate::fixture::{self, Fixtures};
use crate::path::{Device, Turn, guard};
use crate::reflect::BindingKind;

/// The largest number of cases in a batch if each case runs separately. Each of these cases has its own commands, and
/// its own copy of each resource that it writes.
const ALONE: usize = 64;

pub(super) struct Dispatcher<'d> {
    device: &'d Device,
    kernel: Kernel,
    /// The compiled kernel. `None` if the arguments are constants, because each dispatch then compiles its own kernel.
    bound: Option<Bound>,
    resources: Resources,
    arguments: Option<wgpu::Buffer>,
    results: wgpu::Buffer,
    poison: Poison,
    batch: wgpu::Buffer,
    staging: wgpu::Buffer,
    /// The render target, if the kernel is a fragment function.
    target: Option<Target>,
    /// `Some` if cases run separately. The buffer contains the numbers that describe each case to the kernel. The list
    /// has the resources that the function writes.
    alone: Option<(wgpu::Buffer, Vec<Kept>)>,
    capacity: usize,
    words_in: usize,
    evidence: Evidence,
    place: Span,
    /// The lock under which this thread calls the driver (see [`Device::turn`]). This is the last field, so the lock is
    /// released after the other fields are dropped.
    last: Turn<'d>,
}

impl Drop for Dispatcher<'_> {
    fn drop(&mut self) {
        self.last = self.device.turn();
    }
}

/// A dispatch whose results haven't been read yet.
#[must_use]
pub(crate) struct Dispatch<'d> {
    device: &'d Device,
    /// `true` after Karat has waited for the dispatch.
    waited: Cell<bool>,
    cases: usize,
    canary: u32,
    /// The number of workgroups in x, and in y.
    groups: (u32, u32),
    /// The kernel with this dispatch's arguments as constants. `None` if the kernel reads its arguments from a buffer.
    constants: Option<Bound>,
    _deadline: crate::path::Guard,
}

impl Drop for Dispatch<'_> {
    /// Waits for the end of the dispatch, because the driver's threads must end before the process unloads the driver's
    /// code.
    fn drop(&mut self) {
        if !self.waited.get() {
            let _turn = self.device.turn();
            // Ignores an error, because these results aren't needed. The next user of the device gets the error.
            drop(self.device.wait());
        }
    }
}

impl<'d> Dispatcher<'d> {
    /// Uploads the fixtures, and allocates buffers for `cases` cases in a dispatch. The device's limits may allow fewer
    /// cases. If `pipeline` is `None`, each dispatch compiles its own kernel.
    pub(super) fn new(
        device: &'d Device,
        probed: &Probed,
        kernel: &Kernel,
        fixtures: &Fixtures,
        cases: usize,
        pipeline: Option<Compiled>,
    ) -> Result<Self, ProbeError> {
        let Probed { program, function, .. } = probed;

        let stride_out = kernel.words_out + 1;
        let capacity = cases.min(Self::largest_batch(device, kernel)).max(1);
        let buffer = |label, words: usize, usage| {
            device.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: words as u64 * 4,
                usage,
                mapped_at_creation: false,
            })
        };
        use wgpu::BufferUsages as Usage;
        let words = capacity * stride_out;
        let (arguments, results, poison, batch, staging) = device.checked(|| {
            let arguments = match kernel.inputs {
                _ if kernel.words_in == 0 => None,
                Inputs::Storage => Some((capacity * kernel.words_in, Usage::STORAGE)),
                Inputs::Uniform => Some((UNIFORM_WORDS, Usage::UNIFORM)),
                Inputs::Constant => None,
            };
            let arguments =
                arguments.map(|(words, usage)| buffer("arguments", words, usage | Usage::COPY_DST));
            let usage = Usage::STORAGE | Usage::COPY_SRC | Usage::COPY_DST;
            let results = buffer("results", words, usage);
            let poison = Poison::new(device, evidence::WORD, words);
            let batch = buffer("batch", 4, Usage::UNIFORM | Usage::COPY_DST);
            let staging = buffer("staging", words, Usage::MAP_READ | Usage::COPY_DST);
            (arguments, results, poison, batch, staging)
        })?;

        let drawn = if kernel.is_alone() { 1 } else { capacity };
        let target = kernel.is_drawn().then(|| Target::new(device, drawn)).transpose()?;
        let mut alone = match kernel.is_alone() {
            true => {
                let usage = Usage::COPY_SRC | Usage::COPY_DST;
                Some((device.checked(|| buffer("batches", 4 * capacity, usage))?, Vec::new()))
            }
            false => None,
        };
        let mut resources = Resources::new();
        fixture::check_used(&function.bindings, fixtures)?;
        for (binding, fixture) in fixture::resolve(&function.bindings, fixtures)? {
            let resource = upload(device, program, binding, fixture)?;
            if let (BindingKind::TEXTURE_CUBE, Resource::View(view)) = (binding.kind, &resource) {
                borders::fill(device, view)?;
            }
            if let Some((_, kept)) = &mut alone {
                let written = (binding, fixture);
                kept.extend(Kept::new(device, program, written, &resource, capacity)?);
            }
            resources.entry(binding.group).or_default().push((binding.binding, resource));
        }
        let own = [arguments.as_ref(), Some(&results), Some(&batch)];
        let bound = pipeline
            .map(|pipeline| bind(device, pipeline, &resources, kernel.first_binding, own))
            .transpose()?;
        Ok(Self {
            device,
            kernel: kernel.clone(),
            bound,
            resources,
            arguments,
            results,
            poison,
            batch,
            staging,
            target,
            alone,
            capacity,
            words_in: kernel.words_in,
            evidence: Evidence::of(function, device.path(), kernel.words_out),
            place: function.span.clone(),
            last: None,
        })
    }

    fn largest_batch(device: &Device, kernel: &Kernel) -> usize {
        let limits = device.device.limits();
        let bytes = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let widest = 4 * kernel.words_in.max(kernel.words_out + 1);
        let largest = usize::try_from(bytes).unwrap_or(usize::MAX) / widest;
        let largest = if kernel.is_alone() { largest.min(ALONE) } else { largest };
        kernel.largest_batch().map_or(largest, |batch| batch.min(largest))
    }

    fn of_constants(&self, arguments: &[u32]) -> Result<Bound, ProbeError> {
        let text = self.kernel.of_constants(arguments).map_err(|reason| {
            let (function, inputs) = (self.evidence.function.clone(), self.kernel.inputs);
            ProbeError::Inputs { function, inputs, reason }
        })?;
        let pipeline = compile(self.device, &self.evidence.function, &text, &self.kernel)?;
        let own = [None, Some(&self.results), Some(&self.batch)];
        bind(self.device, pipeline, &self.resources, self.kernel.first_binding, own)
    }

    pub(super) fn capacity(&self) -> usize {
        self.capacity
    }

    /// Checks if the function reads a texture that has 16-bit floats on this device.
    pub(super) fn reads_half_floats(&self) -> bool {
        let mut resources = self.resources.values().flatten();
        self.device.float_format() == wgpu::TextureFormat::Rgba16Float
            && resources.any(|(_, resource)| matches!(resource, Resource::View(_)))
    }

    pub(crate) fn device(&self) -> &'d Device {
        self.device
    }

    /// The number of words from one case's results to the next case's results.
    pub(crate) fn stride_out(&self) -> usize {
        self.evidence.stride
    }

    /// Starts a dispatch of `cases` cases with these arguments. Each case has `invocations` invocations, and the first
    /// invocation calls the function. Each case writes a canary: `canary ^ case`, where `case` is the index of the
    /// case.
    pub(super) fn dispatch(
        &self,
        cases: usize,
        arguments: &[u32],
        canary: u32,
        invocations: u32,
    ) -> Result<Dispatch<'d>, ProbeError> {
        assert!(cases <= self.capacity, "a batch must not exceed the runner's capacity");
        assert_eq!(arguments.len(), cases * self.words_in, "each case must have all its arguments");
        let (path, function) = (self.device.path(), self.evidence.function.clone());
        let place = self.place.clone();
        let _turn = self.device.turn();
        let deadline = guard(path, move || {
            format!(
                "the kernel of `{function}` ({place}) on path {path} ({cases} cases in one dispatch)"
            )
        });
        let constants = match &self.bound {
            Some(_) => None,
            None => Some(self.of_constants(arguments)?),
        };
        let count = u32::try_from(cases).expect("a batch fits in 32 bits");
        let limit = self.device.device.limits().max_compute_workgroups_per_dimension;
        let [columns, rows] = Kernel::workgroups(count * invocations, limit);
        let batch = match &self.target {
            Some(Target { grid: [columns, rows], .. }) => [count, canary, *columns, *rows],
            None => [count, canary, columns * WORKGROUP, invocations],
        };
        self.device.checked(|| {
            if let Some(buffer) = &self.arguments {
                self.device.queue.write_buffer(buffer, 0, bytemuck::cast_slice(arguments));
            }
            self.device.queue.write_buffer(&self.batch, 0, bytemuck::cast_slice(&batch));
            if let Some((batches, _)) = &self.alone {
                let each: Vec<[u32; 4]> = (0..count).map(|case| [0, canary, 0, case]).collect();
                self.device.queue.write_buffer(batches, 0, bytemuck::cast_slice(&each));
            }
        })?;
        let groups = (columns, rows);
        let (device, waited) = (self.device, Cell::new(false));
        let dispatch =
            Dispatch { device, waited, cases, canary, groups, constants, _deadline: deadline };
        self.submit(&dispatch, &self.poison)?;
        Ok(dispatch)
    }

    /// Fills the results with `poison` and runs the kernel. The caller has already uploaded the arguments.
    fn submit(&self, dispatch: &Dispatch<'_>, poison: &Poison) -> Result<(), ProbeError> {
        let bound = dispatch
            .constants
            .as_ref()
            .or(self.bound.as_ref())
            .expect("a kernel without constants is compiled once");
        let (columns, rows) = dispatch.groups;
        self.device.checked(|| {
            let mut encoder = self.device.device.create_command_encoder(&Default::default());
            let size = self.bytes(dispatch.cases);
            poison.fill(&mut encoder, &self.results, size);
            match (&self.target, &self.alone) {
                (Some(target), None) => bound.draw(&mut target.pass(&mut encoder), dispatch.cases),
                (target, Some((batches, kept))) => {
                    for case in 0..dispatch.cases {
                        kept.iter().for_each(|kept| kept.reset(&mut encoder));
                        encoder.copy_buffer_to_buffer(
                            batches,
                            case as u64 * 16,
                            &self.batch,
                            0,
                            16,
                        );
                        if let Some(target) = target {
                            bound.draw(&mut target.pass_of_one(&mut encoder), 1);
                        } else {
                            let mut pass = encoder.begin_compute_pass(&Default::default());
                            bound.set(&mut pass);
                            pass.dispatch_workgroups(1, 1, 1);
                        }
                        kept.iter().for_each(|kept| kept.keep(&mut encoder, case));
                    }
                    kept.iter().for_each(|kept| kept.stage(&mut encoder, dispatch.cases));
                }
                (None, None) => {
                    let mut pass = encoder.begin_compute_pass(&Default::default());
                    bound.set(&mut pass);
                    pass.dispatch_workgroups(columns, rows, 1);
                }
            }
            encoder.copy_buffer_to_buffer(&self.results, 0, &self.staging, 0, size);
            self.device.queue.submit([encoder.finish()]);
        })?;
        Ok(())
    }

    fn bytes(&self, cases: usize) -> u64 {
        (cases * self.stride_out() * 4) as u64
    }

    /// Waits for a dispatch, and checks that each canary is right and that each word was written. Then passes the
    /// results to `read`. The results have, for each case, the words of its result and then its canary.
    pub(crate) fn read<T>(
        &self,
        dispatch: Dispatch<'_>,
        read: impl FnOnce(&[u32]) -> T,
    ) -> Result<T, ProbeError> {
        let read = |words: &[u32]| match self.evidence.poisoned(words) {
            places if places.is_empty() => Ok(read(words)),
            places => Err((places, words.to_vec(), read)),
        };
        let (places, words, read) = match self.read_checked(&dispatch, read)? {
            Ok(value) => return Ok(value),
            Err(suspicious) => suspicious,
        };
        // A function may return the poison's value. So the kernel runs again, over another poison.
        let _turn = self.device.turn();
        let words_of_all = dispatch.cases * self.stride_out();
        let poison =
            self.device.checked(|| Poison::new(self.device, evidence::OTHER, words_of_all))?;
        self.submit(&dispatch, &poison)?;
        let again = self.read_checked(&dispatch, |words| self.evidence.poisoned(words))?;
        self.evidence.expect_written(&words, places, &again)?;
        Ok(read(&words))
    }

    pub(super) fn is_alone(&self) -> bool {
        self.alone.is_some()
    }

    /// Waits for a dispatch whose cases run separately. Returns the words of all cases, and the number of words in a
    /// case. The words of a case are the function's result, the values behind the function's pointers, and the contents
    /// of the resources that the function writes.
    pub(super) fn rows(&self, dispatch: Dispatch<'_>) -> Result<(Vec<u32>, usize), ProbeError> {
        let (cases, width) = (dispatch.cases, self.stride_out() - 1);
        let words = self.read(dispatch, <[u32]>::to_vec)?;
        let kept = self.alone.iter().flat_map(|(_, kept)| kept);
        let written =
            kept.map(|kept| kept.lanes(self.device, cases)).collect::<Result<Vec<_>, _>>()?;
        let mut rows = Vec::new();
        for (case, words) in words.chunks_exact(self.stride_out()).enumerate() {
            rows.extend_from_slice(&words[..width]);
            written.iter().for_each(|lanes| rows.extend_from_slice(&lanes[case]));
        }
        let stride = rows.len() / cases.max(1);
        Ok((rows, stride))
    }

    /// Waits for a dispatch, checks the canary of each case, and passes the results to `read`.
    fn read_checked<T>(
        &self,
        dispatch: &Dispatch<'_>,
        read: impl FnOnce(&[u32]) -> T,
    ) -> Result<T, ProbeError> {
        let Dispatch { cases, canary, .. } = *dispatch;
        dispatch.waited.set(true);
        let value = self.device.read_back(&self.staging, self.bytes(cases), |bytes| {
            let words: &[u32] = bytemuck::cast_slice(bytes);
            self.evidence.expect_canaries(words, cases, canary)?;
            Ok(read(words))
        });
        value?
    }
}
