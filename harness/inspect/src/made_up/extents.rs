//! Determines the sizes of a compute pass's resources.

use karat::unstable::package::MOST_ELEMENTS;

use super::content::{Content, Shorter};
use super::meaning::words;

/// Words in integers' names that suggest a number of elements.
const ELEMENTS: [&str; 10] =
    ["count", "size", "length", "len", "num", "n", "elements", "total", "dimensions", "resolution"];

/// Words in vectors' names that suggest the number of elements in each direction.
const DIRECTIONS: [&str; 7] = ["grid", "extent", "extents", "dims", "shape", "bounds", "domain"];

/// Words in names that suggest a number of steps for each element.
const EACH: [&str; 8] =
    ["samples", "sample", "steps", "rays", "bounces", "iterations", "octaves", "taps"];

/// The size of a dispatch, which determines the sizes of resources, and the content (set of generated values) of the
/// resources.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Extents {
    /// The number of elements in each direction: the number of invocations, or fewer.
    pub(crate) elements: [u32; 3],
    pub(crate) workgroups: [u32; 3],
    pub(crate) content: Content,
}

impl Extents {
    /// Returns the extents of a dispatch. Each invocation has an element, except for the invocations in the content's
    /// tail.
    pub(crate) fn of(size: [u32; 3], workgroups: [u32; 3], content: Content) -> Self {
        /// The minimum number of elements of an array.
        const LEAST: u32 = 64;
        /// The length up to which a side of a dispatch is short: two workgroups of 8 x 8 invocations.
        const SHORT: u32 = 16;
        let mut elements = [0, 1, 2].map(|k| size[k].saturating_mul(workgroups[k]));
        let total = elements.iter().fold(1_u32, |all, count| all.saturating_mul(*count));
        // A single workgroup has exactly one element for each invocation.
        if total < LEAST && workgroups != [1; 3] {
            elements[0] = elements[0].saturating_mul(LEAST.div_ceil(total.max(1)));
        }
        if let Some([of_short, of_long]) = content.tail {
            // On a short side, fewer invocations have no element. With a workgroup size of 1, a host never dispatches
            // too many invocations.
            let less = |count: u32| if count <= SHORT { of_short } else { of_long };
            elements = [0, 1, 2].map(|k| match elements[k] {
                count if count > less(count) && size[k] != 1 => count - less(count),
                count => count,
            });
        }
        if let ([count, 1, 1], Some(times)) = (elements, content.rows) {
            let count = count.saturating_mul(times);
            let rows = (1..=count.isqrt()).rev().find(|rows| count % rows == 0).unwrap_or(1);
            elements = [count / rows, rows, 1];
        }
        // In a draw, each buffer has an element for each pixel.
        let shorter = content.shorter.filter(|_| size != [1; 3]);
        Self { elements, workgroups, content: Content { shorter, ..content } }
    }

    /// The value of an integer whose name suggests no range; `None` if the content has no `least`. The value is usually
    /// `least`. If `least` is 2, 3 or 4, Karat adds a small number that depends on the integer's name and the
    /// component's index, so that exchanging two integers changes the result.
    pub(crate) fn unknown(&self, name: &str, lane: usize) -> Option<u32> {
        const APART: std::ops::RangeInclusive<u32> = 2..=4;
        let least = self.content.least?;
        if !APART.contains(&least) {
            return Some(least);
        }
        // Each of the three values of `least` uses another byte of the hash.
        let own = blake3::hash(name.as_bytes()).as_bytes()[least as usize] % 3;
        Some(least + u32::from(own) + lane as u32)
    }

    /// Returns the extents for one buffer, by its position among all buffers.
    pub(super) fn of_buffer(self, place: usize) -> Self {
        Self { content: self.content.of_buffer(place), ..self }
    }

    /// Checks that there are at most 2^22 elements. Each element may have several 32-bit words.
    ///
    /// # Errors
    /// Returns an error if there are more than 2^22 elements.
    pub(crate) fn expect_few(&self) -> Result<(), String> {
        match self.total() {
            total if total > MOST_ELEMENTS => Err(format!(
                "Karat generates buffers for at most {MOST_ELEMENTS} invocations: dispatch fewer workgroups, or bind the buffers"
            )),
            _ => Ok(()),
        }
    }

    pub(super) fn elements_of(&self, name: &str) -> u32 {
        self.part_of(name, self.total())
    }

    /// The number of elements of a resource: `count`, a share of `count` that depends on the resource's name, or 8
    /// times `count` if resources are long. Of two resources, the one with the smaller share under `Shorter::Most` has
    /// the larger share under `Shorter::Least`.
    pub(super) fn part_of(&self, name: &str, count: u32) -> u32 {
        /// The largest share, in sixteenths.
        const MOST: u32 = 16;
        /// The smallest share, in sixteenths. It is more than half, so that the second of two workgroups still has
        /// elements.
        const LEAST: u32 = 9;
        /// The factor by which long resources are longer than usual; for a texture, in each direction. A pass that
        /// halves the size at each level then has four levels.
        const LONG: u32 = 8;
        if self.content.long {
            return count.saturating_mul(LONG);
        }
        let Some(shorter) = self.content.shorter else { return count };
        let own = u32::from(blake3::hash(name.as_bytes()).as_bytes()[0]) % (MOST - LEAST + 1);
        let part = match shorter {
            Shorter::Most => MOST - own,
            Shorter::Least => LEAST + own,
        };
        count.saturating_mul(part).div_ceil(MOST)
    }

    pub(crate) fn total(&self) -> u32 {
        self.elements.iter().fold(1_u32, |all, count| all.saturating_mul(*count))
    }

    /// The value of a number whose name suggests a size. `lanes` is the number of components of the number's vector.
    pub(crate) fn size(&self, name: &str, lane: usize, lanes: usize, whole: bool) -> Option<u32> {
        let words = words(name);
        let has = |list: &[&str]| words.iter().any(|word| list.contains(&word.as_str()));
        // A name such as `num_samples` counts something for each element.
        if has(&EACH) {
            return None;
        }
        if !whole {
            // A float named `width` may be the width of a line.
            let is_size = lanes > 1 && has(&["resolution", "dimensions"]);
            return self.elements.get(lane).copied().filter(|_| is_size);
        }
        Some(match () {
            () if has(&["offset", "start", "first", "base", "begin"]) => 0,
            () if has(&["channels", "components"]) => 1,
            () if has(&["width", "columns", "cols", "stride", "pitch"]) => self.elements[0],
            () if has(&["height", "rows"]) => self.elements[1],
            () if has(&["groups", "workgroups"]) => match lanes {
                1 => self.workgroups.iter().fold(1_u32, |all, count| all.saturating_mul(*count)),
                _ => *self.workgroups.get(lane)?,
            },
            () if lanes > 1 && has(&DIRECTIONS) => *self.elements.get(lane)?,
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
    use crate::made_up::content::{Numbered, Texels};

    #[test]
    fn sizes_follow_from_what_is_dispatched() {
        let extents = Extents::of([8, 8, 1], [2, 3, 1], Content::OF_PASSES[0]);
        assert_eq!(extents.elements, [16, 24, 1]);
        let size = |name, lane, lanes| extents.size(name, lane, lanes, true);
        assert_eq!(size("width", 0, 1), Some(16));
        assert_eq!(size("imageHeight", 0, 1), Some(24));
        assert_eq!(size("particle_count", 0, 1), Some(16 * 24));
        assert_eq!((size("resolution", 0, 2), size("resolution", 1, 2)), (Some(16), Some(24)));
        assert_eq!(size("num_workgroups", 0, 1), Some(6));
        assert_eq!((size("seed", 0, 1), size("num_samples", 0, 1)), (None, None));
        assert_eq!((size("row_stride", 0, 1), size("base", 0, 1)), (Some(16), Some(0)));
        assert_eq!((size("grid", 1, 3), size("grid", 0, 1)), (Some(24), None));
        assert_eq!(extents.size("resolution", 1, 2, false), Some(24));
        assert_eq!(extents.size("width", 0, 1, false), None, "the width of a line");
        let bits: Vec<u32> = (0..64).map(|at| Numbered::Bits.of(at, 64)).collect();
        assert!((16..32).contains(&bits.iter().sum::<u32>()) && bits.iter().all(|bit| *bit < 2));
        assert_eq!(Extents::of([64, 1, 1], [2, 1, 1], Content::OF_PASSES[1]).elements, [125, 1, 1]);
        assert_eq!(Extents::of([1, 1, 1], [64, 1, 1], Content::OF_PASSES[1]).elements, [64, 1, 1]);
        let rows =
            [3, 6, 7].map(|at| Extents::of([64, 1, 1], [2, 1, 1], Content::OF_PASSES[at]).elements);
        assert_eq!(rows, [[16, 8, 1], [16, 8, 1], [16, 16, 1]]);
        assert_eq!(Extents::of([8, 8, 1], [2, 1, 1], Content::OF_PASSES[7]).elements, [16, 8, 1]);
    }

    /// A dispatch of several workgroups has at least 64 elements. With a tail, there are fewer elements than
    /// invocations in each direction in which a workgroup has several invocations.
    #[test]
    fn element_counts_fill_whole_workgroups_or_leave_a_tail() {
        let of = |size, workgroups, at: usize| {
            Extents::of(size, workgroups, Content::OF_PASSES[at]).elements
        };
        assert_eq!(of([3, 1, 1], [7, 1, 1], 0), [84, 1, 1]);
        assert_eq!(
            [of([64, 1, 1], [2, 1, 1], 1), of([64, 1, 1], [2, 1, 1], 4)],
            [[125, 1, 1], [124, 1, 1]]
        );
        assert_eq!(
            [of([8, 8, 1], [2, 1, 1], 1), of([8, 8, 1], [2, 1, 1], 4)],
            [[15, 7, 1], [14, 6, 1]]
        );
        assert_eq!(of([8, 8, 1], [4, 2, 1], 4), [28, 14, 1]);
        assert_eq!(of([64, 1, 1], [2, 3, 1], 4), [124, 3, 1]);
    }

    #[test]
    fn elements_are_numbered() {
        let of = |how: Numbered| [0, 1, 3].map(|at| how.of(at, 4));
        assert_eq!(of(Numbered::Forwards), [0, 1, 3]);
        assert_eq!(of(Numbered::Backwards), [3, 2, 0]);
        assert_eq!(of(Numbered::Apart), [0, 1 << 16, 3 << 16]);
        assert_eq!(of(Numbered::Zero), [0; 3]);
        for content in Content::OF_PASSES {
            let of = |content| Extents::of([64, 1, 1], [2, 1, 1], content);
            let others = [Numbered::Zero, Numbered::Apart].map(|how| of(content.numbered(how)));
            assert_eq!(others.map(|one| one.elements), [of(content).elements; 2]);
            // Neighbouring lanes of a vector differ.
            let [x, y] = [0, 1].map(|lane| of(content).unknown("v", lane));
            match content.draw {
                2..=4 => assert_eq!(y, x.map(|x| x + 1)),
                _ => assert_eq!(x, y),
            }
        }
    }

    /// One content has negative floats, one has noise, and in two contents some arrays are shorter than others.
    #[test]
    fn contents_differ_in_what_they_try() {
        let of = |size| {
            Content::OF_PASSES.into_iter().map(move |content| Extents::of(size, [4, 2, 1], content))
        };
        let numbers = |is: fn(&Content) -> bool| {
            let all = of([8, 8, 1]).enumerate();
            all.filter(|(_, one)| is(&one.content)).map(|(number, _)| number).collect::<Vec<_>>()
        };
        assert_eq!(numbers(|one| one.negative), [4]);
        assert_eq!(numbers(|one| one.texels == Texels::NoiseBelowZero), [7]);
        assert_eq!(numbers(|one| one.shorter.is_some()), [6, 8]);
        assert_eq!(numbers(|one| one.numbered == Some(Numbered::Bits)), [3]);
        assert_eq!(numbers(|one| one.numbered.is_none()), [8]);
        let names = ["a", "b", "points", "list", "next", "source"];
        for one in of([8, 8, 1]) {
            let total = one.total();
            let lengths = names.map(|name| one.elements_of(name));
            match one.content.shorter {
                Some(_) => {
                    assert!(lengths.iter().all(|length| 2 * length > total), "{lengths:?}");
                    assert!(lengths.iter().any(|length| *length != lengths[0]), "{lengths:?}");
                }
                None => assert_eq!(lengths, [total; 6]),
            }
        }
        // In a draw, each buffer has an element for each pixel.
        assert!(of([1; 3]).all(|one| names.map(|name| one.elements_of(name)) == [one.total(); 6]));
    }

    #[test]
    fn unknown_numbers_differ_from_each_other() {
        let all = [0, 2, 3, 4, 5].map(|at| {
            let extents = Extents::of([64, 1, 1], [2, 1, 1], Content::OF_PASSES[at]);
            ["a", "b", "mode", "step"].map(|name| extents.unknown(name, 0))
        });
        assert_eq!((all[0], all[4]), ([Some(1); 4], [Some(0); 4]));
        for (one, other) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
            assert!(all.iter().any(|own| own[one] != own[other]), "{all:?}, {one} and {other}");
        }
    }
}
