//! Finds the first difference between two structures.

use super::{Shape, several};

/// The first member that differs between a host's structure and a WGSL structure, such as `m.roughness: f32`. If one of
/// the structures has no member at this position, the field `wgsl` or `host` is `None`.
#[derive(Debug, PartialEq, Eq)]
#[doc(hidden)]
pub struct Differing {
    /// The name of the WGSL structure.
    #[doc(hidden)]
    pub structure: String,
    /// The member's position, counted from 1.
    #[doc(hidden)]
    pub place: usize,
    /// The WGSL structure's member at that position.
    #[doc(hidden)]
    pub wgsl: Option<String>,
    /// The host structure's member at that position.
    #[doc(hidden)]
    pub host: Option<String>,
}

impl Shape {
    /// The first member whose name or type in the host's structure doesn't match the WGSL structure. If that member is
    /// a structure, the search continues inside of it. `None` if the structures match, or if the types aren't
    /// structures. `result` means the same as in [`stands_for`](Self::stands_for).
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
        // A tuple's members have no names, and messages show a tuple's types completely.
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
