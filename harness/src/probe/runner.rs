//! Runs a function's kernel on a device. If the driver stops long loops, Karat counts the loops' iterations first.

use super::bound::compile;
use super::dispatcher::{Dispatch, Dispatcher};
use super::evidence::canary;
use super::rounds::{Rounds, VECTOR};
use super::{Inputs, Prepared, ProbeError, Probed, Started};
use crate::fixture::Fixtures;
use crate::path::{Device, guard};

/// The number of cases in one dispatch. This many cases keep a GPU busy, and even a function with dozens of arguments
/// needs only 20 MB of buffers.
pub(crate) const BATCH: usize = 65_536;

pub(crate) struct Runner<'d> {
    dispatcher: Dispatcher<'d>,
    /// The counter of loop iterations, if the driver stops long loops.
    rounds: Option<Rounds<'d>>,
}

impl Prepared for Runner<'_> {
    fn capacity(&self) -> usize {
        self.dispatcher.capacity()
    }

    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
        let dispatch = self.dispatch(cases, arguments, canary())?;
        if self.dispatcher.is_alone() {
            return Ok(Box::new(move |reader| {
                let (rows, stride) = self.dispatcher.rows(dispatch)?;
                reader(&rows, stride);
                Ok(())
            }));
        }
        // The canary follows each result.
        Ok(Box::new(move |reader| {
            let stride = self.dispatcher.stride_out();
            self.dispatcher.read(dispatch, |words| reader(words, stride))
        }))
    }

    fn reads_half_floats(&self) -> bool {
        self.dispatcher.reads_half_floats()
    }
}

impl<'d> Runner<'d> {
    /// Compiles the kernel, uploads the fixtures, and allocates buffers for `cases` cases in a dispatch. The device's
    /// limits may allow fewer cases.
    pub(crate) fn new(
        device: &'d Device,
        probed: &Probed,
        fixtures: &Fixtures,
        cases: usize,
    ) -> Result<Self, ProbeError> {
        let Probed { function, kernel, .. } = probed;
        let path = device.path();
        let (name, place) = (function.name.clone(), function.span.clone());
        let _turn = device.turn();
        let what = move || format!("compiling the kernel of `{name}` ({place}) on path {path}");
        let _deadline = guard(path, what);
        let rounds = (kernel.apart && device.leaves_loops())
            .then(|| Rounds::new(device, probed, fixtures, cases))
            .transpose()?;
        let pipeline = (kernel.inputs != Inputs::Constant)
            .then(|| compile(device, &function.name, &kernel.text, kernel))
            .transpose()?;
        let dispatcher = Dispatcher::new(device, probed, kernel, fixtures, cases, pipeline)?;
        Ok(Self { dispatcher, rounds })
    }

    /// Starts a dispatch of `cases` cases with these arguments. Each case writes a canary: `canary ^ case`, where
    /// `case` is the index of the case.
    fn dispatch(
        &self,
        cases: usize,
        arguments: &[u32],
        canary: u32,
    ) -> Result<Dispatch<'d>, ProbeError> {
        let apart = match &self.rounds {
            Some(rounds) => rounds.apart(cases, arguments, canary)?,
            None => false,
        };
        self.dispatcher.dispatch(cases, arguments, canary, if apart { VECTOR } else { 1 })
    }
}

#[cfg(test)]
mod tests;
