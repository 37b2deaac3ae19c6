//! What WGSL leaves open of a function's results: there, two columns that differ are both right.

use crate::fixture::Fixtures;
use crate::interpret::{Bound, Interpreted};
use crate::probe::Probed;
use crate::value::Scalar;

/// A function in Karat's engine, which knows what WGSL leaves open; nothing is known of one that the
/// engine doesn't execute.
pub(super) struct Leeway(Option<Interpreted>);

/// What is left open of some cases.
pub(super) struct Latitude {
    /// What WGSL allows each lane to be; `None`: it isn't known, as of derivatives.
    pub(super) bounds: Option<Vec<Bound>>,
    /// The lanes that depend on what an index reads or writes outside of its array.
    strays: Vec<bool>,
}

/// What is left open of one case.
#[derive(Clone, Copy)]
pub(super) struct OfCase<'l> {
    bounds: Option<&'l [Bound]>,
    strays: &'l [bool],
}

/// What may be said of two results of a lane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Freedom {
    /// Any value is allowed, so there is nothing to compare.
    Any,
    /// Both results are allowed, though they may differ.
    Both,
    /// One of them isn't allowed.
    NotBoth,
    /// It isn't known what is allowed.
    Unknown,
}

impl Leeway {
    pub(super) fn of(probed: &Probed, fixtures: &Fixtures) -> Self {
        Self(Interpreted::new(probed, fixtures).ok())
    }

    /// What is left open of these cases; `None`: nothing is known of them.
    pub(super) fn at(&self, rows: &[u32], cases: usize) -> Option<Latitude> {
        let interpreted = self.0.as_ref()?;
        let strays = interpreted.strays(cases, rows).ok()?;
        Some(Latitude { bounds: interpreted.bounds(cases, rows).ok(), strays })
    }
}

impl Latitude {
    /// Of one case, whose result has so many lanes.
    pub(super) fn case(&self, case: usize, width: usize) -> OfCase<'_> {
        let lanes = case * width..(case + 1) * width;
        let bounds = self.bounds.as_ref().and_then(|bounds| bounds.get(lanes.clone()));
        OfCase { bounds, strays: self.strays.get(lanes).unwrap_or_default() }
    }
}

impl OfCase<'_> {
    /// What may be said of a lane's results.
    pub(super) fn freedom(&self, lane: usize, scalar: Scalar, results: [u32; 2]) -> Freedom {
        if self.strays.get(lane) == Some(&true) {
            return Freedom::Any;
        }
        // Where an index leaves its array in one lane, bounds of the others are lost with it.
        let Some(bounds) = self.bounds.filter(|_| !self.strays.contains(&true)) else {
            return Freedom::Unknown;
        };
        let Some(bound) = bounds.get(lane) else { return Freedom::Unknown };
        let is_any = bound.ends().is_none_or(|(least, most)| match scalar {
            Scalar::I32 | Scalar::U32 => most - least >= f64::from(u32::MAX),
            Scalar::Bool => least < most,
            Scalar::F32 | Scalar::F16 => false,
        });
        match results.iter().all(|word| bound.allows(scalar.decode(*word))) {
            _ if is_any => Freedom::Any,
            true => Freedom::Both,
            false => Freedom::NotBoth,
        }
    }
}
