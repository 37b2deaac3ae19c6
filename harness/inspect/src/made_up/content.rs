//! The contents of buffers and textures, and their sizes: one table for functions and one for passes, with a row for
//! each content to try.

use crate::limits::ELEMENTS;
use karat_core::value::Scalar;

/// The numbering of integers in arrays. Each of them may be an index into another array.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Numbered {
    /// 0, 1, 2 ..: all are different.
    Forwards,
    /// .. 2, 1, 0: sorted input would hide that a pass doesn't sort.
    Backwards,
    /// 0 and 1, as in cells and flags.
    Bits,
    /// All are 0, and floats, too: an index that is still outside doesn't come from the contents.
    Zero,
    /// All are 1, and floats, too.
    One,
    /// 0, 65536, 131072 ..: so far apart that sums of an index with different elements never meet.
    Apart,
}

impl Numbered {
    /// The number of all elements, if it is the same.
    pub(super) fn constant(self, scalar: Scalar) -> Option<u32> {
        match (self, scalar) {
            (Self::Zero, _) => Some(0),
            (Self::One, Scalar::F32) => Some(1.0_f32.to_bits()),
            (Self::One, Scalar::F16) => Some(u32::from(half::f16::ONE.to_bits())),
            (Self::One, _) => Some(1),
            _ => None,
        }
    }

    /// The number of an element of an array with this length.
    pub(super) fn of(self, element: u32, count: u32) -> u32 {
        match self {
            Self::Zero => 0,
            Self::One => 1,
            Self::Forwards => element,
            Self::Apart => element.wrapping_mul(1 << 16),
            Self::Backwards => count - 1 - element,
            // Each neighbourhood occurs; three of eight bits are set.
            Self::Bits => u32::from(hashed(0, element) & 7 < 3),
        }
    }
}

/// The contents of textures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Texels {
    /// Numbers that change little between texels, so that the few bits of a filter's weights don't matter much.
    Smooth,
    /// Numbers that are independent of their neighbours.
    Noise,
    /// The same, many of them negative.
    NoiseBelowZero,
    /// 0, transparent.
    Black,
    /// The same number everywhere: the one at this position among those of the text. A filter keeps it.
    OfText(usize),
}

/// The share of its elements that a runtime-sized array, or a texture, has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Shorter {
    /// Of two names, the first has more elements.
    Most,
    /// Of two names, the second has more elements.
    Least,
}

/// The contents and the sizes of resources.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Content {
    /// Its number: 0 has only random samples; each further one begins with another of the preferred numbers.
    pub(crate) draw: usize,
    pub(super) texels: Texels,
    /// The elements of a runtime-sized array that a function reads. In a pass it has as many as there are invocations.
    pub(super) elements: usize,
    /// The numbering of elements in arrays of integers; `None` if they are sampled.
    pub(crate) numbered: Option<Numbered>,
    /// The least value of whole numbers that their name doesn't constrain; `None` if they are sampled.
    pub(super) least: Option<u32>,
    /// The invocations in each direction that have no element, for a short side and for a long one: the number of
    /// elements is then no multiple of the workgroup.
    pub(crate) tail: Option<[u32; 2]>,
    /// This many times the invocations, in several rows. Doesn't cause a race that another content lacks.
    pub(super) rows: Option<u32>,
    /// `true` if unconstrained floats of arrays are negative, so that a missing element shows.
    pub(super) negative: bool,
    /// Runtime-sized arrays and textures are shorter, each by another share.
    pub(crate) shorter: Option<Shorter>,
    /// `true` if they are longer than a pass needs.
    pub(super) long: bool,
    /// The order of each of three buffers in turn: a sorted one leads to an unsorted one, like the edges of a graph.
    pub(super) orders: Option<[Numbered; 3]>,
    /// `true` if a single workgroup is dispatched.
    pub(crate) one_workgroup: bool,
    /// `true` if a host may well give such indices and counts.
    pub(crate) is_likely: bool,
    /// `true` if all sizes follow from the dispatch.
    pub(crate) is_sized: bool,
}

/// Random samples only.
const DRAWN: Content = Content {
    draw: 0,
    texels: Texels::Smooth,
    elements: ELEMENTS,
    numbered: None,
    least: None,
    tail: None,
    rows: None,
    negative: false,
    shorter: None,
    long: false,
    orders: None,
    one_workgroup: false,
    is_likely: false,
    is_sized: false,
};

impl Content {
    /// The contents that functions read: random samples; then the first of the preferred numbers in each member, the
    /// second, and so on. Ends of ranges, 0 and 1 are among these. Textures have other sizes in each content. A missing
    /// guard shows if an array is short.
    pub(crate) const OF_FUNCTIONS: [Self; 6] = [
        DRAWN,
        Self { draw: 1, ..DRAWN },
        Self { draw: 2, elements: 16, ..DRAWN },
        Self { draw: 3, ..DRAWN },
        Self { draw: 4, elements: 3, texels: Texels::Black, ..DRAWN },
        Self { draw: 5, texels: Texels::Noise, ..DRAWN },
    ];

    /// The contents that functions read if names are ignored. All texels are one number of the text.
    pub(crate) const NAMELESS: [Self; 2] = [
        Self { draw: 60, texels: Texels::OfText(10), ..DRAWN },
        Self { draw: 66, texels: Texels::OfText(11), ..DRAWN },
    ];

    /// The contents that passes read and write. In the first, sizes follow from the dispatch; the second has a tail;
    /// others try the numbers that a parameter may be compared with; the last one samples.
    pub(crate) const OF_PASSES: [Self; 9] = {
        use Numbered::{Backwards, Bits, Forwards};
        const LIKELY: Content = Content { is_likely: true, ..DRAWN };
        [
            Self { numbered: Some(Forwards), least: Some(1), is_sized: true, ..LIKELY },
            Self {
                draw: 1,
                numbered: Some(Backwards),
                least: Some(1),
                tail: Some([1, 3]),
                is_sized: true,
                ..LIKELY
            },
            Self { draw: 2, numbered: Some(Backwards), least: Some(2), ..LIKELY },
            Self { draw: 3, numbered: Some(Bits), least: Some(3), rows: Some(1), ..LIKELY },
            Self {
                draw: 4,
                numbered: Some(Forwards),
                least: Some(4),
                tail: Some([2, 4]),
                negative: true,
                orders: Some([Forwards, Bits, Backwards]),
                ..LIKELY
            },
            Self { draw: 5, numbered: Some(Forwards), least: Some(0), ..DRAWN },
            // More than a tile of 8 or 16, so that a loop over tiles has several rounds.
            Self {
                draw: 6,
                numbered: Some(Forwards),
                least: Some(33),
                rows: Some(1),
                shorter: Some(Shorter::Most),
                orders: Some([Forwards, Backwards, Bits]),
                ..DRAWN
            },
            Self {
                draw: 7,
                numbered: Some(Backwards),
                least: Some(1),
                rows: Some(2),
                texels: Texels::NoiseBelowZero,
                ..DRAWN
            },
            Self { draw: 8, shorter: Some(Shorter::Least), ..DRAWN },
        ]
    };

    /// The same sizes with one numbering for the elements of all arrays: zeros, ones, or numbers far apart.
    pub(crate) const fn numbered(self, numbered: Numbered) -> Self {
        Self { numbered: Some(numbered), orders: None, ..self }
    }

    /// The same numbers, with arrays that are longer than a pass needs.
    pub(crate) const fn long(self) -> Self {
        Self { long: true, orders: None, ..self }
    }

    /// The same, dispatched as one workgroup.
    pub(crate) const fn of_one_workgroup(self) -> Self {
        Self { one_workgroup: true, ..self }
    }

    /// The same for a buffer, by its position among all.
    pub(super) fn of_buffer(self, place: usize) -> Self {
        match self.orders {
            Some(orders) => Self { numbered: Some(orders[place % orders.len()]), ..self },
            None => self,
        }
    }

    /// Returns `true` if each texture is partly transparent.
    pub(super) fn is_transparent(self) -> bool {
        self.draw % 2 == 1
    }
}

/// Bits that depend on others and on a number, by the finalizer of MurmurHash3.
pub(super) fn hashed(bits: u32, number: u32) -> u32 {
    let mut bits = (bits ^ number).wrapping_mul(0x9e37_79b9);
    bits = (bits ^ bits >> 16).wrapping_mul(0x85eb_ca6b);
    bits = (bits ^ bits >> 13).wrapping_mul(0xc2b2_ae35);
    bits ^ bits >> 16
}
