//! The sizes of what a compute pass is dispatched over.

use karat_core::value::Scalar;

use super::meaning::words;

/// Words of names that mean a number of elements, of integers.
const ELEMENTS: [&str; 10] =
    ["count", "size", "length", "len", "num", "n", "elements", "total", "dimensions", "resolution"];

/// Words of vectors' names that mean the elements in each direction.
const DIRECTIONS: [&str; 7] = ["grid", "extent", "extents", "dims", "shape", "bounds", "domain"];

/// Words of names that mean a number of what is done for each element.
const EACH: [&str; 8] =
    ["samples", "sample", "steps", "rays", "bounces", "iterations", "octaves", "taps"];

/// How integers in arrays are numbered: each of them is an index of another array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Numbered {
    /// 0, 1, 2 ..: no two are the same.
    Forwards,
    /// .. 2, 1, 0: what is sorted already would hide that a pass doesn't sort.
    Backwards,
    /// 0 and 1, as cells and flags are.
    Bits,
    /// All of them 0, and floats, too: an index that is wrong all the same comes from no content.
    Zero,
    /// All of them 1, and floats, too.
    One,
    /// 0, 65536, 131072 ..: so far from each other that what is added to one as an index never meets what is added to another.
    Apart,
}

impl Numbered {
    /// The one number of all elements, if there is one.
    pub(super) fn constant(self, scalar: Scalar) -> Option<u32> {
        match (self, scalar) {
            (Self::Zero, _) => Some(0),
            (Self::One, Scalar::F32) => Some(1.0_f32.to_bits()),
            (Self::One, Scalar::F16) => Some(u32::from(half::f16::ONE.to_bits())),
            (Self::One, _) => Some(1),
            _ => None,
        }
    }

    /// The number of an element among so many.
    pub(super) fn of(self, element: u32, count: u32) -> u32 {
        match self {
            Self::Zero => 0,
            Self::One => 1,
            Self::Forwards => element,
            Self::Apart => element.wrapping_mul(1 << 16),
            Self::Backwards => count - 1 - element,
            // So that each neighbourhood comes; three of eight are set.
            Self::Bits => u32::from(hashed(0, element) & 7 < 3),
        }
    }
}

/// How far a dispatch reaches, which made-up sizes follow, and what else is made up for it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Extents {
    /// Elements in each direction: invocations of all workgroups, or fewer.
    pub(crate) elements: [u32; 3],
    pub(crate) workgroups: [u32; 3],
    /// How elements of arrays of integers are numbered; `None`: they are drawn.
    pub(crate) numbered: Option<Numbered>,
    /// The least of whole numbers of which the name says nothing; `None`: they are drawn.
    least: Option<u32>,
    /// True if texels are noise, of which many are below 0.
    pub(super) noise: bool,
    /// True if floats of arrays are below 0, where nothing says what they are.
    pub(super) negative: bool,
    /// The content in which some arrays without a length, and some textures, are shorter; `None`: they aren't.
    shorter: Option<usize>,
    /// True if arrays without a length, and textures, are longer than the dispatch.
    pub(super) long: bool,
    /// Of two contents in which each buffer has an order of its own, the number.
    pub(super) mixed: Option<usize>,
}

impl Extents {
    /// Contents that are tried.
    pub(crate) const VARIANTS: usize = 9;

    /// In the first so many all sizes follow from what is dispatched.
    pub(crate) const SIZED: usize = 2;

    /// The one of them whose elements are no multiple of the workgroup.
    pub(crate) const TAIL: usize = 1;

    /// Another one: its floats are below 0, so that an element that isn't there is seen among them.
    pub(crate) const NEGATIVE: usize = 4;

    /// In these the arrays of each buffer have an order of their own.
    const MIXED: [usize; 2] = [Self::NEGATIVE, 6];

    /// In these a line of elements has several rows. No race of another variant comes of it.
    const ROWS: [usize; 3] = [Self::REPEATED, 6, Self::TWICE];

    /// The one of these that has twice as many elements as there are invocations.
    const TWICE: usize = 7;

    /// In these some arrays are shorter than others.
    pub(crate) const SHORTER: [usize; 2] = [6, 8];

    /// The one of them in which numbers of elements repeat.
    const REPEATED: usize = 3;

    /// Added to a variant, it stands for the same sizes with arrays of zeros.
    pub(crate) const ZEROS: usize = 16;

    /// Added to a variant, it stands for the same sizes with numbers far from each other.
    pub(crate) const APART: usize = 2 * Self::ZEROS;

    /// In the first so many indices and counts are such as a host may well give.
    pub(crate) const LIKELY: usize = 5;

    /// Added to a variant, it stands for the same sizes with arrays of ones.
    pub(crate) const ONES: usize = 3 * Self::ZEROS;

    /// Added to a variant, it stands for the same numbers with arrays that are longer than a pass has any use for.
    pub(crate) const LONG: usize = 4 * Self::ZEROS;

    /// A dispatch over all of its invocations. The second variant has a tail: its elements are no multiple of the
    /// workgroup. The others try the numbers that a parameter may be compared with, and then draws.
    pub(crate) fn of(size: [u32; 3], workgroups: [u32; 3], variant: usize) -> Self {
        /// Elements of arrays, at least.
        const LEAST: u32 = 64;
        /// Invocations along a side of two workgroups of 8 x 8.
        const SHORT: u32 = 16;
        let mut elements = [0, 1, 2].map(|k| size[k].saturating_mul(workgroups[k]));
        let total = elements.iter().fold(1_u32, |all, count| all.saturating_mul(*count));
        // A single workgroup has as many elements as invocations.
        if total < LEAST && workgroups != [1; 3] {
            elements[0] = elements[0].saturating_mul(LEAST.div_ceil(total.max(1)));
        }
        let own = variant % Self::ZEROS;
        // The invocations of the last workgroup without an element: an odd number, or an even one. Few of a short side, so
        // that most have one.
        let less = |count: u32| match own {
            Self::TAIL if count <= SHORT => 1,
            Self::TAIL => 3,
            Self::NEGATIVE if count <= SHORT => 2,
            Self::NEGATIVE => 4,
            _ => 0,
        };
        if less(elements[0]) > 0 {
            // A host has no reason to round up workgroups of one.
            let of_one = size.map(|count| count == 1);
            elements = [0, 1, 2].map(|k| match elements[k] {
                count if count > less(count) && !of_one[k] => count - less(count),
                count => count,
            });
        }
        if let [count, 1, 1] = elements
            && Self::ROWS.contains(&own)
        {
            let count = count.saturating_mul(if own == Self::TWICE { 2 } else { 1 });
            let rows = (1..=count.isqrt()).rev().find(|rows| count % rows == 0).unwrap_or(1);
            elements = [count / rows, rows, 1];
        }
        let (numbered, least) = match own {
            0 => (Some(Numbered::Forwards), Some(1)),
            1 => (Some(Numbered::Backwards), Some(1)),
            2 => (Some(Numbered::Backwards), Some(2)),
            Self::REPEATED => (Some(Numbered::Bits), Some(3)),
            Self::NEGATIVE => (Some(Numbered::Forwards), Some(4)),
            5 => (Some(Numbered::Forwards), Some(0)),
            // More than a tile of 8 or 16 has: a loop over tiles goes round several times.
            6 => (Some(Numbered::Forwards), Some(33)),
            Self::TWICE => (Some(Numbered::Backwards), Some(1)),
            _ => (None, None),
        };
        let numbered = match variant / Self::ZEROS {
            0 => numbered,
            1 => Some(Numbered::Zero),
            2 => Some(Numbered::Apart),
            3 => Some(Numbered::One),
            _ => numbered,
        };
        let (noise, negative) = (own == Self::TWICE, own == Self::NEGATIVE);
        // A draw's buffers have an element for each pixel.
        let shorter = (Self::SHORTER.contains(&own) && size != [1; 3]).then_some(own);
        let long = variant / Self::ZEROS == 4;
        let mixed = (variant < Self::ZEROS)
            .then_some(own)
            .and_then(|own| Self::MIXED.iter().position(|mixed| *mixed == own));
        Self { elements, workgroups, numbered, least, noise, negative, shorter, long, mixed }
    }

    /// A whole number of which the name says nothing. From 2 to 4 upwards some have others than their neighbours, so that one
    /// that is taken for another is seen.
    pub(crate) fn unknown(&self, name: &str, lane: usize) -> Option<u32> {
        const APART: std::ops::RangeInclusive<u32> = 2..=4;
        let least = self.least?;
        if !APART.contains(&least) {
            return Some(least);
        }
        // Other bits for each of the three.
        let own = blake3::hash(name.as_bytes()).as_bytes()[least as usize] % 3;
        Some(least + u32::from(own) + lane as u32)
    }

    /// The same for a buffer by its place among all: in some contents each has another order, so that one that is sorted leads
    /// into one that isn't, as the edges of a graph do.
    pub(super) fn of_buffer(self, place: usize) -> Self {
        const ORDERS: [[Numbered; 3]; 2] = [
            [Numbered::Forwards, Numbered::Bits, Numbered::Backwards],
            [Numbered::Forwards, Numbered::Backwards, Numbered::Bits],
        ];
        match self.mixed {
            Some(mixed) => Self { numbered: Some(ORDERS[mixed][place % 3]), ..self },
            None => self,
        }
    }

    /// Refuses more elements than buffers are made up for: 2^22, of which each may have some words.
    ///
    /// # Errors
    /// If there are more.
    pub(crate) fn expect_few(&self) -> Result<(), String> {
        const MOST: u32 = 1 << 22;
        match self.total() {
            total if total > MOST => Err(format!(
                "buffers are made up for at most {MOST} invocations: dispatch fewer workgroups, or bind them"
            )),
            _ => Ok(()),
        }
    }

    /// The elements of an array without a length.
    pub(super) fn elements_of(&self, name: &str) -> u32 {
        self.part_of(name, self.total())
    }

    /// So much of a number of elements as a resource of this name has. Of two names the one that has less in one of the two
    /// contents has more in the other.
    pub(super) fn part_of(&self, name: &str, count: u32) -> u32 {
        /// Sixteenths of all, at most and at least: more than half, as a host dispatches no workgroup that has nothing to do.
        const MOST: u32 = 16;
        const LEAST: u32 = 9;
        /// Times of all, in each direction of a texture: a pass that goes from level to level has four.
        const LONG: u32 = 8;
        if self.long {
            return count.saturating_mul(LONG);
        }
        let Some(content) = self.shorter else { return count };
        let own = u32::from(blake3::hash(name.as_bytes()).as_bytes()[0]) % (MOST - LEAST + 1);
        let part = if content == Self::SHORTER[0] { MOST - own } else { LEAST + own };
        count.saturating_mul(part).div_ceil(MOST)
    }

    /// All elements.
    pub(crate) fn total(&self) -> u32 {
        self.elements.iter().fold(1_u32, |all, count| all.saturating_mul(*count))
    }

    /// The value of a number by its name, if that says a size; `lanes` are those of its vector.
    pub(crate) fn size(&self, name: &str, lane: usize, lanes: usize, whole: bool) -> Option<u32> {
        let words = words(name);
        let has = |list: &[&str]| words.iter().any(|word| list.contains(&word.as_str()));
        // `num_samples` of each element.
        if has(&EACH) {
            return None;
        }
        if !whole {
            // A width in floats may be that of a line.
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

/// Bits that follow from others and a number, by the finalizer of MurmurHash3.
pub(super) fn hashed(bits: u32, number: u32) -> u32 {
    let mut bits = (bits ^ number).wrapping_mul(0x9e37_79b9);
    bits = (bits ^ bits >> 16).wrapping_mul(0x85eb_ca6b);
    bits = (bits ^ bits >> 13).wrapping_mul(0xc2b2_ae35);
    bits ^ bits >> 16
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_follow_from_what_is_dispatched() {
        let extents = Extents::of([8, 8, 1], [2, 3, 1], 0);
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
        assert_eq!(extents.size("width", 0, 1, false), None, "of a line");
        let bits: Vec<u32> = (0..64).map(|at| Numbered::Bits.of(at, 64)).collect();
        assert!((16..32).contains(&bits.iter().sum::<u32>()) && bits.iter().all(|bit| *bit < 2));
        assert_eq!(Extents::of([64, 1, 1], [2, 1, 1], 1).elements, [125, 1, 1]);
        assert_eq!(Extents::of([1, 1, 1], [64, 1, 1], 1).elements, [64, 1, 1]);
        let rows = [3, 6, 7].map(|variant| Extents::of([64, 1, 1], [2, 1, 1], variant).elements);
        assert_eq!(rows, [[16, 8, 1], [16, 8, 1], [16, 16, 1]]);
        assert_eq!(Extents::of([8, 8, 1], [2, 1, 1], 7).elements, [16, 8, 1]);
    }

    /// At least 64 elements, and of a tail some fewer in each direction that has several invocations a workgroup.
    #[test]
    fn elements_are_those_of_whole_workgroups_or_a_few_less() {
        let of = |size, workgroups, variant| Extents::of(size, workgroups, variant).elements;
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
        for variant in 0..Extents::VARIANTS {
            let of = |added| Extents::of([64, 1, 1], [2, 1, 1], variant + added);
            assert_eq!(of(Extents::ZEROS).numbered, Some(Numbered::Zero));
            assert_eq!(of(Extents::APART).numbered, Some(Numbered::Apart));
            let sizes = [0, Extents::ZEROS, Extents::APART].map(|added| of(added).elements);
            assert_eq!(sizes, [sizes[0]; 3]);
            // A lane of a vector isn't the one before.
            let [x, y] = [0, 1].map(|lane| of(0).unknown("v", lane));
            match variant {
                2..=4 => assert_eq!(y, x.map(|x| x + 1)),
                _ => assert_eq!(x, y),
            }
        }
    }

    /// One content has floats below 0, one is noise, and in two some arrays are shorter than others.
    #[test]
    fn contents_differ_in_what_they_try() {
        let of =
            |size| (0..Extents::VARIANTS).map(move |variant| Extents::of(size, [4, 2, 1], variant));
        let numbers = |is: fn(&Extents) -> bool| {
            let all = of([8, 8, 1]).enumerate();
            all.filter(|(_, one)| is(one)).map(|(number, _)| number).collect::<Vec<_>>()
        };
        assert_eq!(numbers(|one| one.negative), [4]);
        assert_eq!(numbers(|one| one.noise), [7]);
        assert_eq!(numbers(|one| one.shorter.is_some()), [6, 8]);
        assert_eq!(numbers(|one| one.numbered == Some(Numbered::Bits)), [3]);
        assert_eq!(numbers(|one| one.numbered.is_none()), [8]);
        let names = ["a", "b", "points", "list", "next", "source"];
        for one in of([8, 8, 1]) {
            let total = one.total();
            let lengths = names.map(|name| one.elements_of(name));
            match one.shorter {
                Some(_) => {
                    assert!(lengths.iter().all(|length| 2 * length > total), "{lengths:?}");
                    assert!(lengths.iter().any(|length| *length != lengths[0]), "{lengths:?}");
                }
                None => assert_eq!(lengths, [total; 6]),
            }
        }
        // A draw's buffers have an element for each pixel.
        assert!(of([1; 3]).all(|one| names.map(|name| one.elements_of(name)) == [one.total(); 6]));
    }

    #[test]
    fn unknown_numbers_differ_from_each_other() {
        let all = [0, 2, 3, 4, 5].map(|variant| {
            let extents = Extents::of([64, 1, 1], [2, 1, 1], variant);
            ["a", "b", "mode", "step"].map(|name| extents.unknown(name, 0))
        });
        assert_eq!((all[0], all[4]), ([Some(1); 4], [Some(0); 4]));
        for (one, other) in [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)] {
            assert!(all.iter().any(|own| own[one] != own[other]), "{all:?}, {one} and {other}");
        }
    }
}
