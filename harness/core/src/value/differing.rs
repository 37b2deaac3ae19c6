//! Finds the first difference between two structures.

use super::{Shape, several};

/// The first member that differs between two structures: `m.roughness: f32`; a side without such a member has `None`.
#[derive(Debug, PartialEq, Eq)]
#[doc(hidden)]
pub struct Differing {
    /// The structure in WGSL that has the member, or lacks it.
    #[doc(hidden)]
    pub structure: String,
    /// The member's position, from 1.
    #[doc(hidden)]
    pub place: usize,
    /// WGSL's member at that position.
    #[doc(hidden)]
    pub wgsl: Option<String>,
    /// The host's member at that position.
    #[doc(hidden)]
    pub host: Option<String>,
}

impl Shape {
    /// The first member in which a host's structure can't stand for WGSL's, innermost first; `None` if they agree, or
    /// aren't structures. `result` is the same as in [`stands_for`](Self::stands_for).
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
        // A tuple's members have no names, and its types are shown completely.
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
