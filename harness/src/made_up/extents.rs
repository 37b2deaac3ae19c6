//! The sizes of what a compute pass is dispatched over.

use super::meaning::words;

/// Words of names that mean a number of elements, of integers.
const ELEMENTS: [&str; 10] =
    ["count", "size", "length", "len", "num", "n", "elements", "total", "dimensions", "resolution"];

/// Numbers of elements, each of which is an index of another array, and no two are the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Numbered {
    /// 0, 1, 2 ..
    Forwards,
    /// .. 2, 1, 0: what is sorted already would hide that a pass doesn't sort.
    Backwards,
}

impl Numbered {
    /// The number of an element among so many.
    pub(super) fn of(self, element: u32, count: u32) -> u32 {
        match self {
            Self::Forwards => element,
            Self::Backwards => count - 1 - element,
        }
    }
}

/// How far a dispatch reaches, which made-up sizes follow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Extents {
    /// Elements in each direction: invocations of all workgroups, or fewer.
    pub(crate) elements: [u32; 3],
    pub(crate) workgroups: [u32; 3],
    /// How elements of arrays of integers are numbered; `None`: they are drawn.
    pub(crate) numbered: Option<Numbered>,
}

impl Extents {
    /// Contents that are tried: as many elements as are dispatched, in order; fewer, so that the last workgroup has a
    /// tail; then draws.
    #[cfg(feature = "engine")]
    pub(crate) const VARIANTS: usize = 4;

    /// In the first so many of them indices aren't drawn.
    #[cfg(feature = "engine")]
    pub(crate) const SURE: usize = 2;

    /// A dispatch over all of its invocations. The second variant has a tail: its elements are no multiple of the
    /// workgroup. From the third one on integers in arrays are drawn like others.
    #[cfg(feature = "engine")]
    pub(crate) fn of(size: [u32; 3], workgroups: [u32; 3], variant: usize) -> Self {
        /// What is missing of the last workgroup.
        const TAIL: u32 = 3;
        let mut elements = [0, 1, 2].map(|k| size[k].saturating_mul(workgroups[k]));
        if variant == 1 {
            elements = elements.map(|count| if count > TAIL { count - TAIL } else { count });
        }
        let numbered = match variant {
            0 => Some(Numbered::Forwards),
            1 => Some(Numbered::Backwards),
            _ => None,
        };
        Self { elements, workgroups, numbered }
    }

    /// All elements.
    pub(crate) fn total(&self) -> u32 {
        self.elements.iter().fold(1_u32, |all, count| all.saturating_mul(*count))
    }

    /// The value of a whole number by its name, if that says a size; `lanes` are those of its vector.
    pub(super) fn size(&self, name: &str, lane: usize, lanes: usize) -> Option<u32> {
        let words = words(name);
        let has = |list: &[&str]| words.iter().any(|word| list.contains(&word.as_str()));
        Some(match () {
            () if has(&["width", "columns"]) => self.elements[0],
            () if has(&["height", "rows"]) => self.elements[1],
            () if has(&["groups", "workgroups"]) => match lanes {
                1 => self.workgroups.iter().product(),
                _ => *self.workgroups.get(lane)?,
            },
            () if has(&ELEMENTS) => match lanes {
                1 => self.total(),
                _ => *self.elements.get(lane)?,
            },
            () => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_follow_from_what_is_dispatched() {
        let extents = Extents::of([8, 8, 1], [2, 3, 1], 0);
        assert_eq!(extents.elements, [16, 24, 1]);
        let size = |name, lane, lanes| extents.size(name, lane, lanes);
        assert_eq!(size("width", 0, 1), Some(16));
        assert_eq!(size("imageHeight", 0, 1), Some(24));
        assert_eq!(size("particle_count", 0, 1), Some(16 * 24));
        assert_eq!((size("resolution", 0, 2), size("resolution", 1, 2)), (Some(16), Some(24)));
        assert_eq!(size("num_workgroups", 0, 1), Some(6));
        assert_eq!(size("seed", 0, 1), None);
        assert_eq!(Extents::of([64, 1, 1], [2, 1, 1], 1).elements, [125, 1, 1]);
    }
}
