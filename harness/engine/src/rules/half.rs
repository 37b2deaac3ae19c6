//! The accuracy of results in half precision, from the column `f16` of the tables in WGSL 15.7.4.

use super::{Basic, Exponential, FloatRule, Geometry, Trigonometry};

/// The largest error of a result in half precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Half {
    /// The result is rounded correctly, or exact.
    Rounded,
    /// The correctly rounded result of a conversion from another type. Karat lowers the conversion as a separate
    /// operation.
    Converted,
    /// The result is an operand that already has half precision. Karat doesn't consider other orders of the operations
    /// that computed the operand.
    Operand,
    /// The result of a sum, a product or a quotient, for all orders of its operations. The argument is the number of
    /// intermediate results that are also rounded.
    Chained(u8),
    /// The error is at most this many ulp.
    Ulps(u8),
    /// The result is the length of a vector with this number of components.
    Length(u8),
    /// For an argument x, the error is at most `1 + 2 abs(x)` ulp.
    Power,
    /// The error is at most 2^-7 for arguments in [0.5, 2], and 3 ulp for others.
    Logarithm,
    /// The error is at most 2^-7.
    Wave,
}

impl Half {
    /// Checks if the operation that computes the result also rounds it to half precision.
    pub(crate) fn is_of_a_result(self) -> bool {
        !matches!(self, Self::Converted | Self::Operand)
    }
}

impl FloatRule {
    /// Checks if drivers may reorder this operation together with the operations that compute its operands.
    pub(crate) fn is_one_of_a_chain(self) -> bool {
        self.half() == Some(Half::Chained(0))
    }

    /// The accuracy of the rule in half precision. `None` if the rule has intermediate results whose errors Karat can't
    /// bound from the result alone.
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
                // The inverse root has an error of 2 ulp. Its inverse has an error of 2.5 ulp and a rounding error.
                B::Sqrt => Half::Ulps(6),
                B::InverseSqrt => Half::Ulps(2),
                B::Remainder | B::Mix | B::SmoothStep => return None,
            },
            Self::Exponential(rule) => match rule {
                E::Exp | E::Exp2 => Half::Power,
                E::Log | E::Log2 => Half::Logarithm,
                _ => return None,
            },
            // Each of the products is rounded.
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
            // The factor is rounded, and the product is rounded, too.
            Self::Trigonometry(T::Radians | T::Degrees) => Half::Ulps(3),
            Self::Trigonometry(_) => return None,
        })
    }
}
