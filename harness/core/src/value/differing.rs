//! Where two structures differ whose names say nothing of it.

use super::{Shape, several};

/// The first member that differs in two structures: `m.roughness: f32`, or `None` where a side has no such
/// member.
#[derive(Debug, PartialEq, Eq)]
#[doc(hidden)]
pub struct Differing {
    /// The structure in WGSL that has it, or lacks it.
    #[doc(hidden)]
    pub structure: String,
    /// Its place among the members, from 1.
    #[doc(hidden)]
    pub place: usize,
    /// What WGSL has there.
    #[doc(hidden)]
    pub wgsl: Option<String>,
    /// What the host has there.
    #[doc(hidden)]
    pub host: Option<String>,
}

impl Shape {
    /// The first member in which a host's structure can't stand for that of WGSL, innermost first; `None` if
    /// they agree, or aren't structures. `result` is that of [`stands_for`](Self::stands_for).
    #[doc(hidden)]
    pub fn differing(&self, wgsl: &Self, result: bool) -> Option<Differing> {
        let (structure, members, others) = match (self, wgsl) {
            (Self::Array { element, .. }, Self::Array { element: other, .. }) => {
                return element.differing(other, result);
            }
            (Self::Struct { members, .. }, Self::Struct { name, members: others })
                if self.quad().is_none() =>
            {
                (name, members, others)
            }
            _ => return None,
        };
        // A tuple's members have no names, and its types are told in full.
        let is_tuple = matches!(self, Self::Struct { name, .. } if name == several::NAME);
        for place in 0..members.len().max(others.len()) {
            let (own, other) = (members.get(place), others.get(place));
            if let (Some((name, shape)), Some((as_named, wgsl))) = (own, other)
                && (is_tuple || name == as_named)
            {
                if shape.stands_for(wgsl, result) {
                    continue;
                }
                if let Some(inner) = shape.differing(wgsl, result) {
                    return Some(inner);
                }
            }
            let told = |(name, shape): &(String, Self)| format!("{name}: {shape}");
            return (!is_tuple).then(|| Differing {
                structure: structure.clone(),
                place: place + 1,
                wgsl: other.map(told),
                host: own.map(told),
            });
        }
        None
    }
}
