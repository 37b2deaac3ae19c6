//! What stands for the engine in a library that is built without it.

use std::sync::Arc;

use crate::diagnostic::Span;
use crate::fixture::Fixtures;
use crate::path::{Path, PathError};
use crate::probe::{ProbeError, Probed};

/// There is none.
#[derive(Debug)]
pub(crate) enum Interpreted {}

/// Nor for functions that write what is seen outside of them.
#[cfg(feature = "routes")]
#[derive(Debug)]
pub(crate) enum Alone {}

#[cfg(feature = "routes")]
impl Alone {
    pub(crate) fn new(_: &Probed, _: &Fixtures) -> Result<Self, ProbeError> {
        Err(missing())
    }

    pub(crate) fn strays(&self, _: usize, _: &[u32]) -> Result<Vec<bool>, ProbeError> {
        match *self {}
    }
}

/// How exact an adapter was measured to be.
#[derive(Clone, Debug)]
pub(crate) enum Accuracy {}

/// What needs the engine.
pub(crate) fn missing() -> ProbeError {
    let message = "karat is built without its engine, which knows what WGSL allows: write features = \
                   [\"engine\"] at its dependency in Cargo.toml";
    let (path, message) = (Path::CPU, message.to_owned());
    PathError::Route { path, message }.into()
}

/// Nothing is known of an entry point, either.
#[cfg(feature = "routes")]
pub(crate) fn strays(
    _: &crate::dispatch::Passes,
) -> Result<Vec<bool>, crate::dispatch::DispatchError> {
    Err(missing().into())
}

/// Nothing runs passes.
pub(crate) fn examine_in(
    _: &crate::dispatch::Passes,
    _: &mut crate::dispatch::Examined,
    _: OrderOf,
) {
}

/// No pass is looked through, and the result says so.
pub(crate) fn examine(passes: &crate::dispatch::Passes) -> crate::dispatch::Examined {
    let mut examined = crate::dispatch::Examined::default();
    examined.watched.of = passes.invocations();
    examined.watched.reason = missing().to_string();
    examined
}

/// What WGSL allows a lane to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Bound {}

impl Bound {
    pub(crate) fn allows(&self, _: f64) -> bool {
        match *self {}
    }

    pub(crate) fn is_reordered(&self) -> bool {
        match *self {}
    }

    pub(crate) fn ends(&self) -> Option<(f64, f64)> {
        match *self {}
    }
}

impl Interpreted {
    pub(crate) fn new(_: &Probed, _: &Fixtures) -> Result<Self, ProbeError> {
        Err(missing())
    }

    #[cfg(feature = "routes")]
    pub(crate) fn strays(&self, _: usize, _: &[u32]) -> Result<Vec<bool>, ProbeError> {
        match *self {}
    }

    pub(crate) fn bounds(&self, _: usize, _: &[u32]) -> Result<Vec<Bound>, ProbeError> {
        match *self {}
    }

    pub(crate) fn bounds_between(
        &self,
        _: usize,
        _: [&[u32]; 2],
    ) -> Result<Option<Vec<Bound>>, ProbeError> {
        match *self {}
    }

    pub(crate) fn driver_bounds(&self, _: usize, _: &[u32]) -> Result<Vec<Bound>, ProbeError> {
        match *self {}
    }

    pub(crate) fn measured_bounds(
        &self,
        _: usize,
        _: &[u32],
        accuracy: &Arc<Accuracy>,
    ) -> Result<Vec<Bound>, ProbeError> {
        match **accuracy {}
    }

    pub(crate) fn shadow(&self, _: usize, _: &[u32]) -> Result<Vec<f64>, ProbeError> {
        match *self {}
    }

    pub(crate) fn words(&self, _: usize, _: &[u32]) -> Result<Vec<u32>, ProbeError> {
        match *self {}
    }

    pub(crate) fn cause(&self, _: &Bound) -> Option<(Span, String)> {
        match *self {}
    }

    pub(crate) fn place(&self) -> &Span {
        match *self {}
    }
}

/// Nothing runs passes in another order: what looks through them says so before one is asked for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct OrderOf;

impl OrderOf {
    pub(crate) fn whole(_: &crate::dispatch::Passes, _: u64) -> Self {
        Self
    }

    pub(crate) fn swaps(self) -> usize {
        0
    }

    pub(crate) fn subgroup(self) -> u32 {
        0
    }

    pub(crate) fn first(self, _: usize) -> Self {
        self
    }

    pub(crate) fn apart(self) -> Self {
        self
    }

    pub(crate) fn only(self, _: usize) -> Self {
        self
    }

    pub(crate) fn passes(
        self,
        _: &crate::dispatch::Passes,
    ) -> impl Iterator<Item = &crate::dispatch::Pass> {
        std::iter::empty()
    }

    pub(crate) fn last(self, _: &crate::dispatch::Passes) -> String {
        String::new()
    }
}

/// Nothing runs passes.
pub(crate) fn in_order_of(
    _: &crate::dispatch::Passes,
    _: Option<OrderOf>,
) -> Result<crate::dispatch::Afterwards, crate::dispatch::DispatchError> {
    Err(missing().into())
}

/// Nothing runs passes.
pub(crate) fn parting(_: &crate::dispatch::Passes, _: OrderOf) -> Option<(Span, String)> {
    None
}

/// Nothing runs passes.
#[cfg(feature = "routes")]
pub(crate) fn dispatch_briefly(
    _: &crate::dispatch::Passes,
) -> Result<crate::dispatch::Afterwards, crate::dispatch::DispatchError> {
    Err(missing().into())
}

/// Nothing notes writes.
pub(crate) fn written(
    _: &crate::dispatch::Passes,
    _: usize,
) -> Result<Vec<bool>, crate::dispatch::DispatchError> {
    Err(missing().into())
}
