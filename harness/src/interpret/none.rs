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
#[derive(Clone, Debug)]
pub(crate) enum OrderOf {}

impl OrderOf {
    #[cfg(feature = "routes")]
    pub(crate) fn is_of_size(&self) -> bool {
        match *self {}
    }

    pub(crate) fn subgroup(&self) -> u32 {
        match *self {}
    }

    pub(crate) fn simpler(&self) -> impl Iterator<Item = Self> {
        std::iter::empty()
    }

    pub(crate) fn passes(
        &self,
        _: &crate::dispatch::Passes,
    ) -> impl Iterator<Item = (&crate::dispatch::Pass, ())> {
        std::iter::empty()
    }

    pub(crate) fn told(&self, _: &crate::dispatch::Passes) -> String {
        match *self {}
    }
}

/// How many orders were tried: none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Tried {
    pub(crate) orders: u64,
    pub(crate) all: bool,
}

/// A run that didn't happen.
pub(crate) struct Run {
    pub(crate) order: Option<OrderOf>,
    pub(crate) left: Option<crate::dispatch::Afterwards>,
    pub(crate) examined: crate::dispatch::Examined,
}

/// Has one run, which says that nothing runs passes.
pub(crate) struct Runner(Option<crate::dispatch::Examined>);

impl Runner {
    pub(crate) fn new(passes: &crate::dispatch::Passes) -> Self {
        Self(Some(examine(passes)))
    }

    #[cfg(feature = "routes")]
    pub(crate) fn few(self, _: u64) -> Self {
        self
    }

    pub(crate) fn tried(&self) -> Tried {
        Tried::default()
    }

    pub(crate) fn found(&mut self) {}
}

impl Iterator for Runner {
    type Item = Run;

    fn next(&mut self) -> Option<Run> {
        let examined = self.0.take()?;
        Some(Run { order: None, left: None, examined })
    }
}

/// Nothing runs passes.
pub(crate) fn in_order_of(
    _: &crate::dispatch::Passes,
    _: Option<&OrderOf>,
) -> Result<crate::dispatch::Afterwards, crate::dispatch::DispatchError> {
    Err(missing().into())
}

/// Nothing runs passes.
pub(crate) struct Parting {
    pub(crate) first: Option<(Span, String)>,
    pub(crate) turns: Turns,
}

#[derive(Default)]
pub(crate) struct Turns {
    pub(crate) late: Option<(Span, String)>,
}

impl Turns {
    pub(crate) fn told(&self) -> Vec<String> {
        Vec::new()
    }
}

/// Nothing runs passes.
pub(crate) fn parting(_: &crate::dispatch::Passes, _: &OrderOf) -> Option<Parting> {
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
