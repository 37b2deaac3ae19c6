//! Tables of the contents and sizes of buffers and textures: one table for functions and one for passes. Each row is
//! one content: a set of values and sizes.

use crate::limits::ELEMENTS;
use karat_core::value::Scalar;

/// The values of integers in arrays. Each integer may be an index into another array.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Numbered {
    /// 0, 1, 2 and so on: all elements differ.
    Forwards,
    /// The last element is 0, and each earlier one is larger by 1. Ascending values would hide that a pass doesn't
    /// sort.
    Backwards,
    /// Zeros and ones in irregular order, as in an array of flags.
    Bits,
    /// All integers and floats are 0. If an index is outside of its array even then, the contents aren't the cause.
    Zero,
    /// All integers and floats are 1.
    One,
    /// 0, 65536, 131072 and so on. The steps are larger than usual indices, so `a[i] + k` and `a[j] + l` differ if `i`
    /// and `j` differ.
    Apart,
}

impl Numbered {
    /// The value of all elements, if they are equal.
    pub(super) fn constant(self, scalar: Scalar) -> Option<u32> {
        match (self, scalar) {
            (Self::Zero, _) => Some(0),
            (Self::One, Scalar::F32) => Some(1.0_f32.to_bits()),
            (Self::One, Scalar::F16) => Some(u32::from(half::f16::ONE.to_bits())),
            (Self::One, _) => Some(1),
            _ => None,
        }
    }

    /// The value of an element in an array of `count` elements.
    pub(super) fn of(self, element: u32, count: u32) -> u32 {
        match self {
            Self::Zero => 0,
            Self::One => 1,
            Self::Forwards => element,
            Self::Apart => element.wrapping_mul(1 << 16),
            Self::Backwards => count - 1 - element,
            // Each combination of neighbours occurs. Three in eight elements are 1.
            Self::Bits => u32::from(hashed(0, element) & 7 < 3),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Texels {
    /// Values that change little between texels, so that the few bits of a filter's weights hardly matter.
    Smooth,
    /// Values that are independent of neighbouring texels.
    Noise,
    /// Independent values, many of them negative.
    NoiseBelowZero,
    /// All channels are 0, including the alpha channel.
    Black,
    /// The same value in all texels, which filtering doesn't change. The value is the number at this position in the
    /// list of numbers in the shader's text.
    OfText(usize),
}

/// Selects the runtime-sized arrays and textures that have fewer elements than others.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Shorter {
    /// The larger the hash of a resource's name (modulo 8) is, the fewer elements the resource has.
    Most,
    /// The larger the hash of a resource's name (modulo 8) is, the more elements the resource has.
    Least,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Content {
    /// The content's number. In content 0, all values are random samples. In each further content, a member of a buffer
    /// has another one of its preferred numbers, such as an end of its range.
    pub(crate) draw: usize,
    pub(super) texels: Texels,
    /// The number of elements in a runtime-sized array that a function reads. In a pass, the dispatch determines this
    /// number.
    pub(super) elements: usize,
    /// The values of integers in arrays; `None` if they are sampled.
    pub(crate) numbered: Option<Numbered>,
    /// The smallest value of integers whose names suggest no range; `None` if these integers are sampled.
    pub(super) least: Option<u32>,
    /// The tail: the number of invocations without an element in each direction. The first number is for a short side
    /// of the dispatch, and the second number for a long side. With a tail, the number of elements isn't a multiple of
    /// the workgroup size.
    pub(crate) tail: Option<[u32; 2]>,
    /// For a one-dimensional dispatch whose elements form a grid of several rows: the number of elements for each
    /// invocation.
    pub(super) rows: Option<u32>,
    /// `true` if unconstrained floats in arrays are negative. A read outside of an array gives 0, which then changes a
    /// maximum.
    pub(super) negative: bool,
    /// Selects the runtime-sized arrays and textures that are shorter than others; `None` if all have the same size.
    pub(crate) shorter: Option<Shorter>,
    /// `true` if resources have more elements than a pass needs.
    pub(super) long: bool,
    /// The kinds of values of three successive buffers. The next three buffers have these kinds again, and so on. Some
    /// shaders need different kinds: in a graph, the integers of a sorted buffer are indices into an unsorted buffer.
    pub(super) orders: Option<[Numbered; 3]>,
    pub(crate) one_workgroup: bool,
    /// `true` if the content's indices and counts are like those that a host may use.
    pub(crate) is_likely: bool,
    /// `true` if all sizes follow from the dispatch.
    pub(crate) is_sized: bool,
}

/// A content with only random samples.
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
    /// The contents that functions read. The first content has random samples. In the second content, each member has
    /// its first preferred number, in the third content its second one, and so on. Preferred numbers include ends of
    /// ranges, 0 and 1. Textures have another size in each content. Some contents have short arrays, which reveal
    /// missing bounds checks.
    pub(crate) const OF_FUNCTIONS: [Self; 6] = [
        DRAWN,
        Self { draw: 1, ..DRAWN },
        Self { draw: 2, elements: 16, ..DRAWN },
        Self { draw: 3, ..DRAWN },
        Self { draw: 4, elements: 3, texels: Texels::Black, ..DRAWN },
        Self { draw: 5, texels: Texels::Noise, ..DRAWN },
    ];

    /// The contents that functions read if names are ignored. All texels of a texture have the same number, which comes
    /// from the shader's text.
    pub(crate) const NAMELESS: [Self; 2] = [
        Self { draw: 60, texels: Texels::OfText(10), ..DRAWN },
        Self { draw: 66, texels: Texels::OfText(11), ..DRAWN },
    ];

    /// The contents that passes read and write. In the first content, each invocation has one element. In the second
    /// content, some invocations have no element. In other contents, integers have small values such as 2, 3 or 4, with
    /// which a shader may compare a parameter. The last content has random samples.
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
            // More elements than a tile of 8 or 16, so that a loop over tiles has several iterations.
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

    /// Returns the content with these values in all arrays: zeros, ones, or numbers far apart.
    pub(crate) const fn numbered(self, numbered: Numbered) -> Self {
        Self { numbered: Some(numbered), orders: None, ..self }
    }

    /// Returns the content with arrays that are longer than a pass needs.
    pub(crate) const fn long(self) -> Self {
        Self { long: true, orders: None, ..self }
    }

    /// Returns the content for a dispatch of one workgroup.
    pub(crate) const fn of_one_workgroup(self) -> Self {
        Self { one_workgroup: true, ..self }
    }

    /// Returns the content for one buffer, by its position among all buffers.
    pub(super) fn of_buffer(self, place: usize) -> Self {
        match self.orders {
            Some(orders) => Self { numbered: Some(orders[place % orders.len()]), ..self },
            None => self,
        }
    }

    /// Checks if each texture is partly transparent with this content.
    pub(super) fn is_transparent(self) -> bool {
        self.draw % 2 == 1
    }
}

/// Hashes bits with a number, by the finalizer of MurmurHash3.
pub(super) fn hashed(bits: u32, number: u32) -> u32 {
    let mut bits = (bits ^ number).wrapping_mul(0x9e37_79b9);
    bits = (bits ^ bits >> 16).wrapping_mul(0x85eb_ca6b);
    bits = (bits ^ bits >> 13).wrapping_mul(0xc2b2_ae35);
    bits ^ bits >> 16
}
