//! Calls a function on an executor, with arguments and results as rows of `u32` words.

use std::borrow::Cow;
use std::ops::Deref;

use super::{Failure, Mismatch, Vacuous};
use crate::diagnostic::{FileRead, Span};
use crate::executor::{self, Caller, Executor, Results, Running};
use crate::fixture::{self, Fixtures};
use crate::interpret::asserted::Watched;
use crate::package::Package;
use crate::path::Adapter;
use crate::probe::{self, Inputs, ProbeError, Probed};
use crate::record::tell_prints;
use crate::reflect::{Function, Overrides};
use crate::tolerance::Tolerance;
use crate::value::{Scalar, Shape};

/// A function with parameters that fit the types of the check's arguments.
#[derive(Debug)]
pub(super) struct Fitting(Probed);

impl Fitting {
    pub(super) fn function(&self) -> &Function {
        &self.0.function
    }

    pub(super) fn declared_at(&mut self, place: Span) {
        self.0.function.span = place;
    }

    /// Finds a function that takes arguments of the `supplied` types. In an error message, `who` says who
    /// supplies the arguments, such as `the domain supplies`.
    pub(super) fn find(
        (package, function): (&Package, &str),
        (fixtures, overrides): (&Fixtures, &Overrides),
        inputs: Inputs,
        supplied: &[Shape],
        who: &'static str,
    ) -> Result<Self, Failure> {
        let probed = Probed::in_valid(package, function, overrides)?;
        let mut probed = probed.with_inputs(inputs)?;
        probed.fit(fixtures)?;
        let probed = probed.with_quads_of(supplied);
        let declared = probe::parameter_shapes(&probed.function);
        let fits = supplied.len() == declared.len()
            && supplied.iter().zip(&declared).all(|(host, wgsl)| host.stands_for(wgsl, false));
        if fits {
            return Ok(Self(probed));
        }
        let declared = declared.into_iter().cloned().collect();
        let supplied = supplied.to_vec();
        Err(Mismatch::Arguments { declared, supplied, who }.of(&probed.function))
    }

    /// Prepares the function on an executor. A batch has at most `calls` calls.
    pub(super) fn on<'e>(
        self,
        executor: &'e dyn Executor,
        fixtures: &'e Fixtures,
        calls: usize,
    ) -> Result<Called<'e>, Failure> {
        let Self(probed) = self;
        fixture::check_used(&probed.function.bindings, fixtures).map_err(ProbeError::from)?;
        let watched = Watched::of(&probed, fixtures)?;
        let caller = Caller::new(executor, Cow::Owned(probed), fixtures, calls)?;
        Ok(Called { caller, adapter: executor::adapter(executor), watched })
    }
}

/// A function that is ready to be called on one executor.
pub(super) struct Called<'e> {
    caller: Caller<'e>,
    pub(super) adapter: Adapter,
    watched: Option<Watched>,
}

impl Drop for Called<'_> {
    fn drop(&mut self) {
        self.watched.iter().for_each(|watched| tell_prints(&watched.told()));
    }
}

impl<'e> Deref for Called<'e> {
    type Target = Caller<'e>;

    fn deref(&self) -> &Caller<'e> {
        &self.caller
    }
}

impl Called<'_> {
    pub(super) fn files(&self, fixtures: &Fixtures) -> Vec<FileRead> {
        let modules = self.probed.program.files().iter();
        modules.chain(fixtures.iter().flat_map(|(_, fixture)| fixture.read())).cloned().collect()
    }

    pub(super) fn function(&self) -> &Function {
        &self.probed.function
    }

    pub(super) fn scalars(&self) -> Vec<Scalar> {
        self.function().result.lanes()
    }

    /// The scalar types of the components of all arguments.
    pub(super) fn argument_scalars(&self) -> Vec<Scalar> {
        probe::parameter_shapes(self.function()).into_iter().flat_map(Shape::lanes).collect()
    }

    /// Starts calls on the executor. If the function asserts or prints, Karat's engine runs these calls first.
    pub(super) fn start(&self, rows: &[u32], calls: usize) -> Result<Running<'_>, ProbeError> {
        if let Some(watched) = &self.watched {
            watched.look(calls, rows)?;
        }
        self.caller.start(rows, calls)
    }

    pub(super) fn call(&self, rows: &[u32], calls: usize) -> Result<Results, Failure> {
        Ok(self.start(rows, calls)?.read()?)
    }

    pub(super) fn decode(&self, words: &[u32]) -> Vec<f64> {
        self.scalars().iter().zip(words).map(|(scalar, word)| scalar.decode(*word)).collect()
    }

    /// Checks that `host`, the type that the check expects, fits the function's return type.
    pub(super) fn expect_result(&self, host: &Shape, who: &str) -> Result<(), Failure> {
        let function = self.function();
        if host.stands_for(&function.result, true) {
            return Ok(());
        }
        let (declared, supplied) = (function.result.clone(), host.clone());
        Err(Mismatch::Result { declared, supplied, who: who.to_owned() }.of(function))
    }

    /// Returns an error if a value of the reference isn't finite. `lanes` contains the components of all cases,
    /// one case after the other. `case` returns a case's index and its arguments as text.
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
        let (function, value) = (function.name.clone(), lanes[at]);
        Err(Failure::Reference { function, value, place, case, arguments })
    }

    /// Returns an error if a bound of the tolerance can't be used, or if the tolerance's number of bounds
    /// differs from the result's number of components.
    pub(super) fn expect_lanes(&self, tolerance: &Tolerance) -> Result<(), Failure> {
        let lanes = self.scalars().len();
        if let Some(bound) = tolerance.unusable() {
            let tolerance = tolerance.clone();
            return Err(Mismatch::Bound { tolerance, bound }.of(self.function()));
        }
        match tolerance.lanes() {
            Some(declared) if declared != lanes => {
                Err(Mismatch::Lanes { lanes, declared }.of(self.function()))
            }
            _ => Ok(()),
        }
    }

    pub(super) fn vacuous<T>(&self, reason: Vacuous) -> Result<T, Failure> {
        Err(Failure::Domain { function: self.function().name.clone(), reason: Box::new(reason) })
    }
}
