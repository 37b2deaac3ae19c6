//! What buffers and textures hold, and how large they are: a table for functions and one for passes, each row a content that
//! is tried.

use crate::limits::ELEMENTS;
use karat_core::value::Scalar;

/// How integers in arrays are numbered: each of them is an index of another array.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
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

/// What textures hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Texels {
    /// Numbers that change little from texel to texel, so that a filter's few bits of weight don't matter much.
    Smooth,
    /// Numbers that have nothing to do with their neighbours'.
    Noise,
    /// The same, many of them below 0.
    NoiseBelowZero,
    /// 0, transparent.
    Black,
    /// One number of the text everywhere, by its place among them: a filter keeps it.
    OfText(usize),
}

/// Which part of its elements an array without a length, or a texture, has.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Shorter {
    /// Of two names, the first has more.
    Most,
    /// The same the other way round.
    Least,
}

/// What resources hold, and how large they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Content {
    /// Its number: 0 are draws alone, and each further one begins with another of the numbers that are tried first.
    pub(crate) draw: usize,
    pub(super) texels: Texels,
    /// Elements of an array without a length that a function reads; a pass has as many as it has invocations.
    pub(super) elements: usize,
    /// How elements of arrays of integers are numbered; `None`: they are drawn.
    pub(crate) numbered: Option<Numbered>,
    /// The least of whole numbers of which the name says nothing; `None`: they are drawn.
    pub(super) least: Option<u32>,
    /// Invocations in each direction without an element, of a short side and of a long one: elements are no multiple of the
    /// workgroup.
    pub(crate) tail: Option<[u32; 2]>,
    /// So many times the invocations, in several rows. No race of another content comes of it.
    pub(super) rows: Option<u32>,
    /// `true` if floats of arrays are below 0, where nothing says what they are, so that an element that isn't there is
    /// seen.
    pub(super) negative: bool,
    /// Arrays without a length, and textures, are shorter, each by another part.
    pub(crate) shorter: Option<Shorter>,
    /// `true` if they are longer than a pass has any use for.
    pub(super) long: bool,
    /// The order of each of three buffers, one after the other: one that is sorted leads into one that isn't, as the edges of
    /// a graph do.
    pub(super) orders: Option<[Numbered; 3]>,
    /// `true` if a single workgroup is dispatched.
    pub(crate) one_workgroup: bool,
    /// `true` if indices and counts are such as a host may well give.
    pub(crate) is_likely: bool,
    /// `true` if all sizes follow from what is dispatched.
    pub(crate) is_sized: bool,
}

/// Draws alone.
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
    /// What functions read: draws; then the first of the numbers that are tried first, in each member, the second, and so on.
    /// Ends of ranges, 0 and 1 are among these. Textures have other sizes in each. A guard that is left out shows where an array
    /// is short.
    pub(crate) const OF_FUNCTIONS: [Self; 6] = [
        DRAWN,
        Self { draw: 1, ..DRAWN },
        Self { draw: 2, elements: 16, ..DRAWN },
        Self { draw: 3, ..DRAWN },
        Self { draw: 4, elements: 3, texels: Texels::Black, ..DRAWN },
        Self { draw: 5, texels: Texels::Noise, ..DRAWN },
    ];

    /// What functions read where no name says anything: their textures are all one number of the text.
    pub(crate) const NAMELESS: [Self; 2] = [
        Self { draw: 60, texels: Texels::OfText(10), ..DRAWN },
        Self { draw: 66, texels: Texels::OfText(11), ..DRAWN },
    ];

    /// What passes read and write. The first have sizes by what is dispatched, the second with a tail; the others try the
    /// numbers that a parameter may be compared with, and the last one draws.
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
            // More than a tile of 8 or 16 has: a loop over tiles goes round several times.
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

    /// The same sizes with one way to number the elements of all arrays: zeros, ones, or numbers far from each other.
    pub(crate) const fn numbered(self, numbered: Numbered) -> Self {
        Self { numbered: Some(numbered), orders: None, ..self }
    }

    /// The same numbers with arrays that are longer than a pass has any use for.
    pub(crate) const fn long(self) -> Self {
        Self { long: true, orders: None, ..self }
    }

    /// The same, dispatched as one workgroup.
    pub(crate) const fn of_one_workgroup(self) -> Self {
        Self { one_workgroup: true, ..self }
    }

    /// The same for a buffer by its place among all.
    pub(super) fn of_buffer(self, place: usize) -> Self {
        match self.orders {
            Some(orders) => Self { numbered: Some(orders[place % orders.len()]), ..self },
            None => self,
        }
    }

    /// Returns `true` if each texture is transparent in parts.
    pub(super) fn is_transparent(self) -> bool {
        self.draw % 2 == 1
    }
}

/// Bits that follow from others and a number, by the finalizer of MurmurHash3.
pub(super) fn hashed(bits: u32, number: u32) -> u32 {
    let mut bits = (bits ^ number).wrapping_mul(0x9e37_79b9);
    bits = (bits ^ bits >> 16).wrapping_mul(0x85eb_ca6b);
    bits = (bits ^ bits >> 13).wrapping_mul(0xc2b2_ae35);
    bits ^ bits >> 16
}
