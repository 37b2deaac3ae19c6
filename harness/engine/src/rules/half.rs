//! The accuracy of results of half precision. WGSL 15.7.4, the column of `f16`.

use super::{Basic, Exponential, FloatRule, Geometry, Trigonometry};

/// The largest error of a result of half precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Half {
    /// Correctly rounded, or exact.
    Rounded,
    /// Correctly rounded from another type. The conversion is an operation of its own.
    Converted,
    /// An operand that already has half precision. It isn't a term of a sum in another order.
    Operand,
    /// A sum, a product or a quotient, in any order of its operations, with this many more roundings inside.
    Chained(u8),
    /// Within so many ulp.
    Ulps(u8),
    /// The root of a sum of squares of so many components.
    Length(u8),
    /// Within 1 + 2 |x| ulp at x.
    Power,
    /// Within 2^-7, or 3 ulp outside [0.5, 2].
    Logarithm,
    /// Within 2^-7.
    Wave,
}

impl Half {
    /// Returns `true` if it rounds the result of an operation, as a part of it.
    pub(crate) fn is_of_a_result(self) -> bool {
        !matches!(self, Self::Converted | Self::Operand)
    }
}

impl FloatRule {
    /// Returns `true` if its operands may be reordered together with it.
    pub(crate) fn is_one_of_a_chain(self) -> bool {
        self.half() == Some(Half::Chained(0))
    }

    /// The accuracy in half precision. `None` if it is computed from intermediate results whose errors its result alone
    /// doesn't bound.
    pub(crate) fn half(self) -> Option<Half> {
        use {Basic as B, Exponential as E, Geometry as G, Trigonometry as T};
        Some(match self {
            Self::Basic(rule) => match rule {
                B::Add | B::Subtract | B::Multiply | B::Square | B::Divide => Half::Chained(0),
                // The product is rounded, too.
                B::Fma => Half::Chained(1),
                B::Negate
                | B::Abs
                | B::Min
                | B::Max
                | B::Clamp
                | B::Saturate
                | B::Step
                | B::Sign => Half::Rounded,
                // The inverse root has 2 ulp, its inverse 2.5 ulp and a rounding.
                B::Sqrt => Half::Ulps(6),
                B::InverseSqrt => Half::Ulps(2),
                B::Remainder | B::Mix | B::SmoothStep => return None,
            },
            Self::Exponential(rule) => match rule {
                E::Exp | E::Exp2 => Half::Power,
                E::Log | E::Log2 => Half::Logarithm,
                _ => return None,
            },
            // Each of its products is rounded.
            Self::Geometry(G::Dot2) => Half::Chained(2),
            Self::Geometry(G::Dot3) => Half::Chained(3),
            Self::Geometry(G::Dot4) => Half::Chained(4),
            Self::Geometry(G::Length1) => Half::Rounded,
            Self::Geometry(G::Length2) => Half::Length(2),
            Self::Geometry(G::Length3) => Half::Length(3),
            Self::Geometry(G::Length4) => Half::Length(4),
            Self::Geometry(_) => return None,
            Self::Rounding(_) => Half::Rounded,
            Self::Trigonometry(T::Sin | T::Cos) => Half::Wave,
            Self::Trigonometry(T::Atan) => Half::Ulps(5),
            // The factor is rounded, and so is the product.
            Self::Trigonometry(T::Radians | T::Degrees) => Half::Ulps(3),
            Self::Trigonometry(_) => return None,
        })
    }
}
