//! A function on its execution paths: calls by rows of words, with no cases and no verdict.

use super::Failure;
use super::mismatch::signature;
use crate::fixture::Fixtures;
use crate::package::Package;
use crate::path;
use crate::probe::{self, BATCH, Dispatch, Inputs, Probed, Runner};
use crate::reflect::Function;
use crate::tolerance::Tolerance;
use crate::value::{Scalar, Shape};

/// A function whose parameters fit what it is to be given.
#[derive(Debug)]
pub(super) struct Fitting(Probed);

impl Fitting {
    /// Finds a function, which has to take these arguments. `who` supplies them: `the domain draws`.
    pub(super) fn find(
        (package, function): (&Package, &str),
        inputs: Inputs,
        supplied: &[Shape],
        who: &str,
    ) -> Result<Self, Failure> {
        let probed = Probed::new(package, function)?.with_inputs(inputs)?;
        let declared = probe::parameter_shapes(&probed.function);
        let fits = supplied.len() == declared.len()
            && supplied.iter().zip(&declared).all(|(host, wgsl)| host.stands_for(wgsl, false));
        if fits {
            return Ok(Self(probed));
        }
        let list = |shapes: &[&Shape]| {
            let names: Vec<String> = shapes.iter().map(ToString::to_string).collect();
            format!("({})", names.join(", "))
        };
        let supplied: Vec<&Shape> = supplied.iter().collect();
        let (declared, supplied) = (list(&declared), list(&supplied));
        let mismatch = format!("takes {declared}, {who} {supplied}");
        Err(signature(&probed.function, mismatch))
    }

    /// Compiles it on each selected path, with room for so many calls in a dispatch.
    pub(super) fn on_paths(self, fixtures: &Fixtures, calls: usize) -> Result<Called, Failure> {
        let Self(probed) = self;
        let words = probe::parameter_shapes(&probed.function);
        let words = words.into_iter().map(|shape| shape.lanes().len()).sum();
        let runners = path::devices()?
            .into_iter()
            .map(|device| Runner::new(device, &probed, fixtures, calls))
            .collect::<Result<_, _>>()?;
        Ok(Called { probed, runners, words })
    }
}

/// A function that can be called on each selected path.
pub(super) struct Called {
    pub(super) probed: Probed,
    pub(super) runners: Vec<Runner>,
    /// Words of all arguments.
    pub(super) words: usize,
}

/// The results of one dispatch on one path.
pub(super) struct Results {
    pub(super) words: Vec<u32>,
    pub(super) stride: usize,
}

impl Results {
    /// The words of one case.
    pub(super) fn of(&self, case: usize) -> &[u32] {
        &self.words[case * self.stride..][..self.stride - 1]
    }
}

impl Called {
    pub(super) fn function(&self) -> &Function {
        &self.probed.function
    }

    /// The lanes of a result.
    pub(super) fn scalars(&self) -> Vec<Scalar> {
        self.function().result.lanes()
    }

    /// The lanes of all arguments.
    pub(super) fn argument_scalars(&self) -> Vec<Scalar> {
        probe::parameter_shapes(self.function()).into_iter().flat_map(Shape::lanes).collect()
    }

    /// Calls of one dispatch.
    pub(super) fn capacity(&self) -> usize {
        self.runners.iter().map(Runner::capacity).min().unwrap_or(BATCH)
    }

    /// Starts calls on each path. `canary` is a number of this dispatch.
    pub(super) fn start(
        &self,
        rows: &[u32],
        calls: usize,
        (seed, number): (u64, u64),
    ) -> Result<Vec<Dispatch>, Failure> {
        let dispatches = self.runners.iter().map(|runner| {
            let canary = probe::canary(seed, number);
            runner.dispatch(calls, rows, canary)
        });
        Ok(dispatches.collect::<Result<_, _>>()?)
    }

    /// Reads the results of each path.
    pub(super) fn read(&self, dispatches: Vec<Dispatch>) -> Result<Vec<Results>, Failure> {
        let read = self.runners.iter().zip(dispatches).map(|(runner, dispatch)| {
            let stride = runner.stride_out();
            Ok(runner.read(dispatch, |words| Results { words: words.to_vec(), stride })?)
        });
        read.collect()
    }

    /// The numbers in the words of a result.
    pub(super) fn decode(&self, words: &[u32]) -> Vec<f64> {
        self.scalars().iter().zip(words).map(|(scalar, word)| scalar.decode(*word)).collect()
    }

    /// Wants the function to return this type.
    pub(super) fn expect_result(&self, host: &Shape, who: &str) -> Result<(), Failure> {
        let function = self.function();
        if host.stands_for(&function.result, true) {
            return Ok(());
        }
        Err(signature(function, format!("returns {}, {who} {host}", function.result)))
    }

    /// Refuses a reference that isn't finite. `lanes` are those of one case after the other, and
    /// `case` tells a case's index and arguments.
    pub(super) fn expect_finite(
        &self,
        lanes: &[f64],
        what: &str,
        case: impl FnOnce(usize) -> (u64, String),
    ) -> Result<(), Failure> {
        let function = self.function();
        let Some(at) = lanes.iter().position(|value| !value.is_finite()) else { return Ok(()) };
        let names = function.result.lane_names();
        let place = format!("{what}{}", names[at % names.len()]);
        let (case, arguments) = case(at / names.len());
        let (function, value) = (function.path.clone(), lanes[at]);
        Err(Failure::Reference { function, value, place, case, arguments })
    }

    /// Refuses a tolerance that bounds nothing, or is declared for another number of components.
    pub(super) fn expect_lanes(&self, tolerance: &Tolerance) -> Result<(), Failure> {
        let lanes = self.scalars().len();
        if let Some(bound) = tolerance.unusable() {
            let mismatch = format!("is compared to {tolerance}, and {bound} bounds nothing");
            return Err(signature(self.function(), mismatch));
        }
        match tolerance.lanes() {
            Some(declared) if declared != lanes => {
                let mismatch =
                    format!("returns {lanes} components, the tolerance is declared for {declared}");
                Err(signature(self.function(), mismatch))
            }
            _ => Ok(()),
        }
    }

    /// An error of the domain, which leaves nothing to be judged.
    pub(super) fn vacuous<T>(&self, reason: impl Into<String>) -> Result<T, Failure> {
        Err(Failure::Domain { function: self.function().path.clone(), reason: reason.into() })
    }
}
