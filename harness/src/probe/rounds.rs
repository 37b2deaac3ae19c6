//! Counts the iterations of loops, for drivers that stop long loops without an error.
//!
//! Mesa's llvmpipe runs several invocations as the lanes of one vector. Each vector has a single counter for the
//! iterations of all loops that its lanes run. llvmpipe counts one iteration even for a loop that no lane enters. After
//! [`MOST_ROUNDS`] iterations, llvmpipe stops every loop without a message, and the results are wrong.
//!
//! If naga's IR shows no bound for a loop, Karat first runs a copy of the kernel that counts the iterations. If a
//! single case takes [`MOST_ROUNDS`] iterations, Karat reports an error. If no single case takes that many, but the
//! cases of one vector may take that many together, Karat runs the kernel with one case in each vector.

use super::bound::Compiled;
use super::dispatcher::Dispatcher;
use super::{ProbeError, Probed};
use crate::fixture::Fixtures;
use crate::path::{Device, MOST_ROUNDS};
use crate::reflect::{CountedLoop, Nesting, count_rounds};

/// The largest number of invocations in a vector. llvmpipe's widest vectors have 512 bits, which is 16 lanes of 32
/// bits.
pub(crate) const VECTOR: u32 = 16;

/// A kernel that counts the iterations of each loop for each case.
pub(super) struct Rounds<'d> {
    dispatcher: Dispatcher<'d>,
    loops: Vec<CountedLoop>,
    nesting: Nesting,
    function: String,
}

impl<'d> Rounds<'d> {
    pub(super) fn new(
        device: &'d Device,
        probed: &Probed,
        fixtures: &Fixtures,
        cases: usize,
    ) -> Result<Self, ProbeError> {
        let kernel = probed.kernel.counting(2 * probed.program.loops());
        let counting = count_rounds(&probed.program, &kernel.text);
        let function = probed.function.name.clone();
        let pipeline = device
            .pipeline_of_ir(counting.module, super::kernel::ENTRY_POINT)
            .map_err(|error| ProbeError::Compile { function: function.clone(), error })?;
        let dispatcher = Dispatcher::new(
            device,
            probed,
            &kernel,
            fixtures,
            cases,
            Some(Compiled::Dispatched(pipeline)),
        )?;
        Ok(Self { dispatcher, loops: counting.loops, nesting: counting.nesting, function })
    }

    /// Checks if each case needs its own vector: if cases share a vector, the driver might stop a loop. Returns an
    /// error if one case takes too many iterations.
    pub(super) fn apart(
        &self,
        cases: usize,
        arguments: &[u32],
        canary: u32,
    ) -> Result<bool, ProbeError> {
        let rounds = self.count(cases, arguments, canary, 1)?;
        let stride = self.loops.len();
        // In each iteration of a vector, at least one lane runs an iteration. So a vector never runs more iterations
        // than its lanes together.
        let together = |rounds: &[u64]| rounds.iter().sum::<u64>();
        let vector = stride * VECTOR as usize;
        if rounds.chunks(vector).all(|lanes| together(lanes) < MOST_ROUNDS) {
            return Ok(false);
        }
        let rounds = self.count(cases, arguments, canary, VECTOR)?;
        for (case, counts) in rounds.chunks_exact(stride).enumerate() {
            if together(counts) >= MOST_ROUNDS {
                return Err(self.too_many(case, counts));
            }
        }
        // A vector runs a loop as often as its busiest lane. But lanes may run nested loops one after another.
        let at_most = |lanes: &[u64]| -> u64 {
            let of_loop = |(index, counted): (usize, &CountedLoop)| {
                let counts = lanes.iter().skip(index).step_by(stride).copied();
                if counted.nested { counts.sum() } else { counts.max().unwrap_or(0) }
            };
            self.loops.iter().enumerate().map(of_loop).sum()
        };
        Ok(rounds.chunks(vector).any(|lanes| at_most(lanes) >= MOST_ROUNDS))
    }

    fn count(
        &self,
        cases: usize,
        arguments: &[u32],
        canary: u32,
        invocations: u32,
    ) -> Result<Vec<u64>, ProbeError> {
        let dispatch = self.dispatcher.dispatch(cases, arguments, canary, invocations)?;
        let stride = self.dispatcher.stride_out();
        self.dispatcher.read(dispatch, |words| {
            let cases = words.chunks_exact(stride);
            cases.flat_map(|case| self.nesting.rounds(&case[..stride - 1])).collect()
        })
    }

    fn too_many(&self, case: usize, counts: &[u64]) -> ProbeError {
        let most = self.loops.iter().zip(counts).max_by_key(|(_, count)| **count);
        let (counted, count) = most.expect("a counting kernel has a loop");
        let of = format!("`{}`", self.function);
        let rounds = u32::try_from(*count).unwrap_or(u32::MAX);
        let diagnostic = self.dispatcher.device().left_loop(&of, rounds, counted.span.as_ref());
        ProbeError::Rounds { case, diagnostic: Box::new(diagnostic) }
    }
}
