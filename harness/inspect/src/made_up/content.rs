//! The contents and sizes of buffers and textures: one table for functions and one table for passes. Each row of a
//! table is a content to try.

use crate::limits::ELEMENTS;
use karat_core::value::Scalar;

/// The numbers in arrays of integers. Each number may be an index into another array.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Numbered {
    /// 0, 1, 2, ...: all numbers are different.
    Forwards,
    /// ..., 2, 1, 0: sorted input would hide that a pass doesn't sort.
    Backwards,
    /// 0 and 1, as in cells and flags.
    Bits,
    /// All integers and floats are 0. An index that is still outside of its array doesn't come from the contents.
    Zero,
    /// All integers and floats are 1.
    One,
    /// 0, 65536, 131072, ...: so far apart that sums of an index with different elements are never equal.
    Apart,
}

impl Numbered {
    /// Returns the number of all elements, if it is the same for all.
    pub(super) fn constant(self, scalar: Scalar) -> Option<u32> {
        match (self, scalar) {
            (Self::Zero, _) => Some(0),
            (Self::One, Scalar::F32) => Some(1.0_f32.to_bits()),
            (Self::One, Scalar::F16) => Some(u32::from(half::f16::ONE.to_bits())),
            (Self::One, _) => Some(1),
            _ => None,
        }
    }

    /// Returns the number of one element in an array with `count` elements.
    pub(super) fn of(self, element: u32, count: u32) -> u32 {
        match self {
            Self::Zero => 0,
            Self::One => 1,
            Self::Forwards => element,
            Self::Apart => element.wrapping_mul(1 << 16),
            Self::Backwards => count - 1 - element,
            // Three of eight bits are set, so every pattern of neighbours occurs.
            Self::Bits => u32::from(hashed(0, element) & 7 < 3),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Texels {
    /// Numbers that change little between texels, so that the low precision of filter weights has a small effect.
    Smooth,
    /// Numbers that don't depend on their neighbours.
    Noise,
    /// Like `Noise`, with many negative numbers.
    NoiseBelowZero,
    /// 0, transparent.
    Black,
    /// One number of the shader's text in all texels, chosen by its position among these numbers. A filter doesn't
    /// change it.
    OfText(usize),
}

/// The rule that makes runtime-sized arrays and textures shorter, each by a different share.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Shorter {
    /// Of two names, the first one has more elements.
    Most,
    /// Of two names, the second one has more elements.
    Least,
}

/// One content: the values and the sizes of all resources.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Content {
    /// The content's number. Content 0 has only random samples. Each other content uses another of the preferred
    /// numbers first.
    pub(crate) draw: usize,
    pub(super) texels: Texels,
    /// The number of elements of a runtime-sized array that a function reads. In a pass, the array has one element for
    /// each invocation.
    pub(super) elements: usize,
    /// The numbers in arrays of integers; `None` if they are sampled.
    pub(crate) numbered: Option<Numbered>,
    /// The least value of whole numbers if the name suggests no value; `None` if these numbers are sampled.
    pub(super) least: Option<u32>,
    /// The number of invocations without an element in each direction, for a short and for a long direction. The number
    /// of elements is then not a multiple of the workgroup's size.
    pub(crate) tail: Option<[u32; 2]>,
    /// The number of elements for each invocation, in several rows; `None` for the usual number. More elements cause no
    /// race that another content lacks.
    pub(super) rows: Option<u32>,
    /// `true` if unconstrained floats of arrays are negative, so that a missing element (0) is noticed.
    pub(super) negative: bool,
    /// Makes runtime-sized arrays and textures shorter, each by another share.
    pub(crate) shorter: Option<Shorter>,
    /// `true` if arrays and textures are longer than a pass needs.
    pub(super) long: bool,
    /// The numbers of every first, second and third buffer: a sorted buffer leads to an unsorted buffer, like the edges
    /// of a graph.
    pub(super) orders: Option<[Numbered; 3]>,
    pub(crate) one_workgroup: bool,
    /// `true` if a host may plausibly set these indices and counts.
    pub(crate) is_likely: bool,
    /// `true` if all sizes follow from the dispatch.
    pub(crate) is_sized: bool,
}

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
    /// The contents for functions: random samples, then contents with the first, second, ... preferred numbers in each
    /// member. These numbers include ends of ranges, 0 and 1. Each content has other sizes of textures. The short
    /// arrays reveal missing guards.
    pub(crate) const OF_FUNCTIONS: [Self; 6] = [
        DRAWN,
        Self { draw: 1, ..DRAWN },
        Self { draw: 2, elements: 16, ..DRAWN },
        Self { draw: 3, ..DRAWN },
        Self { draw: 4, elements: 3, texels: Texels::Black, ..DRAWN },
        Self { draw: 5, texels: Texels::Noise, ..DRAWN },
    ];

    /// The contents for functions that ignore names. All texels are one number of the shader's text.
    pub(crate) const NAMELESS: [Self; 2] = [
        Self { draw: 60, texels: Texels::OfText(10), ..DRAWN },
        Self { draw: 66, texels: Texels::OfText(11), ..DRAWN },
    ];

    /// The contents for passes. In the first, sizes follow from the dispatch. The second has fewer elements than
    /// invocations. Others use numbers with which a parameter may be compared. The last one is sampled.
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
            // More elements than a tile of 8 or 16, so that a loop over tiles has several rounds.
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

    /// Returns this content with the same sizes, and with all arrays numbered in one way: zeros, ones, or numbers far
    /// apart.
    pub(crate) const fn numbered(self, numbered: Numbered) -> Self {
        Self { numbered: Some(numbered), orders: None, ..self }
    }

    /// Returns this content with arrays that are longer than a pass needs.
    pub(crate) const fn long(self) -> Self {
        Self { long: true, orders: None, ..self }
    }

    /// Returns this content, dispatched as one workgroup.
    pub(crate) const fn of_one_workgroup(self) -> Self {
        Self { one_workgroup: true, ..self }
    }

    /// Returns this content for a buffer, by the buffer's position among all buffers.
    pub(super) fn of_buffer(self, place: usize) -> Self {
        match self.orders {
            Some(orders) => Self { numbered: Some(orders[place % orders.len()]), ..self },
            None => self,
        }
    }

    /// Checks if each texture is partly transparent.
    pub(super) fn is_transparent(self) -> bool {
        self.draw % 2 == 1
    }
}

/// Mixes bits with a number, by the finalizer of MurmurHash3.
pub(super) fn hashed(bits: u32, number: u32) -> u32 {
    let mut bits = (bits ^ number).wrapping_mul(0x9e37_79b9);
    bits = (bits ^ bits >> 16).wrapping_mul(0x85eb_ca6b);
    bits = (bits ^ bits >> 13).wrapping_mul(0xc2b2_ae35);
    bits ^ bits >> 16
}
