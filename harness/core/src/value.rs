//! The values that travel between the CPU and the GPU.
//!
//! A value travels as *lanes*: the value's scalars in the order of their declaration, each in one 32-bit word. The
//! shader that Karat generates to call a function assembles the value from its lanes, so WGSL's memory layout (padding,
//! alignment, strides) can't cause errors. A [`Shape`] describes a WGSL type. A host type ([`Shareable`]), its `f64`
//! twin ([`Mirror`]) and the signature that naga reflects each have a shape. Karat compares the three shapes before it
//! dispatches anything.

mod differing;
mod glams;
mod mirror;
mod quad;
mod reference;
mod several;
mod shareable;

use std::fmt;

#[doc(hidden)]
pub use differing::Differing;
pub use mirror::Mirror;
pub use quad::Quad;
pub use reference::Reference;
pub use shareable::{Arguments, Shareable};

/// A WGSL scalar type.
///
/// ```
/// use karat::unstable::value::Scalar;
///
/// assert_eq!(Scalar::named("u32"), Some(Scalar::U32));
/// assert_eq!(Scalar::F32.decode(0x3f00_0000), 0.5);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Scalar {
    /// `f32`
    F32,
    /// `f16`. The lane stores the value as an `f32`, without rounding.
    F16,
    /// `i32`
    I32,
    /// `u32`
    U32,
    /// `bool`. The lane is 0 or 1.
    Bool,
}

impl Scalar {
    /// The WGSL keyword for the type.
    ///
    /// ```
    /// use karat::unstable::value::Scalar;
    ///
    /// assert_eq!(Scalar::F16.wgsl(), "f16");
    /// ```
    #[must_use]
    pub fn wgsl(self) -> &'static str {
        match self {
            Self::F32 => "f32",
            Self::F16 => "f16",
            Self::I32 => "i32",
            Self::U32 => "u32",
            Self::Bool => "bool",
        }
    }

    /// Checks if the type is a float. Karat compares floats with a tolerance. Lanes of integers and booleans must be
    /// equal.
    ///
    /// ```
    /// use karat::unstable::value::Scalar;
    ///
    /// assert!(Scalar::F32.is_float() && !Scalar::I32.is_float());
    /// ```
    #[inline]
    #[must_use]
    pub fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F16)
    }

    /// The scalar type with this WGSL keyword.
    ///
    /// ```
    /// use karat::unstable::value::Scalar;
    ///
    /// assert_eq!(Scalar::named("bool"), Some(Scalar::Bool));
    /// assert_eq!(Scalar::named("f64"), None);
    /// ```
    #[must_use]
    pub fn named(wgsl: &str) -> Option<Self> {
        [Self::F32, Self::F16, Self::I32, Self::U32, Self::Bool]
            .into_iter()
            .find(|scalar| scalar.wgsl() == wgsl)
    }

    /// Parses a decimal number, `true` or `false`, and returns the value's 32 bits. `None` if the text isn't a finite
    /// value of the type.
    ///
    /// ```
    /// use karat::unstable::value::Scalar;
    ///
    /// assert_eq!(Scalar::I32.parse("-1"), Some(u32::MAX));
    /// assert_eq!(Scalar::F32.parse("inf"), None);
    /// ```
    #[must_use]
    pub fn parse(self, text: &str) -> Option<u32> {
        match self {
            Self::F32 | Self::F16 => {
                Some(text.parse::<f32>().ok().filter(|value| value.is_finite())?.to_bits())
            }
            Self::I32 => text.parse::<i32>().ok().map(i32::cast_unsigned),
            Self::U32 => text.parse().ok(),
            Self::Bool => text.parse::<bool>().ok().map(u32::from),
        }
    }

    /// The value in a lane. The conversion to `f64` is exact for each scalar type.
    ///
    /// ```
    /// use karat::unstable::value::Scalar;
    ///
    /// assert_eq!(Scalar::I32.decode(u32::MAX), -1.0);
    /// ```
    #[must_use]
    pub fn decode(self, lane: u32) -> f64 {
        match self {
            Self::F32 | Self::F16 => f64::from(f32::from_bits(lane)),
            Self::I32 => f64::from(lane.cast_signed()),
            Self::U32 | Self::Bool => f64::from(lane),
        }
    }
}

/// A WGSL type of values that Karat can pass to a function, or read from its results.
///
/// ```
/// use karat::unstable::value::{Scalar, Shape};
///
/// let direction = Shape::Vector { size: 3, scalar: Scalar::F32 };
/// assert_eq!(direction.to_string(), "vec3<f32>");
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub enum Shape {
    /// `f32`, `i32`, ...
    Scalar(Scalar),
    /// `vecN<T>`
    Vector {
        /// The number of components, from 2 to 4.
        size: u8,
        /// The type of a component.
        scalar: Scalar,
    },
    /// `matCxR<T>`, stored by columns.
    Matrix {
        /// The number of columns, from 2 to 4.
        columns: u8,
        /// The number of rows, from 2 to 4.
        rows: u8,
        /// The type of a component.
        scalar: Scalar,
    },
    /// `array<T, N>`
    Array {
        /// The type of an element.
        element: Box<Shape>,
        /// The number of elements, at least 1.
        length: u32,
    },
    /// A structure in WGSL.
    Struct {
        /// The structure's name, as the author wrote it.
        name: String,
        /// The structure's members in order, with their names.
        members: Vec<(String, Shape)>,
    },
}

impl Shape {
    /// Returns the scalar type and the number of components (one to four) of an attribute's or a texel's shape. Such a
    /// shape is a scalar, a vector, or an array of scalars. Returns `None` for any other shape.
    ///
    /// ```
    /// use karat_core::value::{Scalar, Shareable};
    ///
    /// assert_eq!(glam::Vec3::shape().components(), Some((Scalar::F32, 3)));
    /// assert_eq!(<[u32; 2]>::shape().components(), Some((Scalar::U32, 2)));
    /// assert_eq!(glam::Mat2::shape().components(), None);
    /// ```
    #[must_use]
    pub fn components(&self) -> Option<(Scalar, usize)> {
        let (scalar, count) = match self {
            Self::Scalar(scalar) => (*scalar, 1),
            Self::Vector { size, scalar } => (*scalar, usize::from(*size)),
            Self::Array { element, length } => match **element {
                Self::Scalar(scalar) => (scalar, *length as usize),
                _ => return None,
            },
            _ => return None,
        };
        let is_number = matches!(scalar, Scalar::F32 | Scalar::I32 | Scalar::U32);
        (is_number && (1..=4).contains(&count)).then_some((scalar, count))
    }

    /// The scalar type of each lane, in order.
    ///
    /// ```
    /// use karat::unstable::value::{Scalar, Shape};
    ///
    /// let point = Shape::Vector { size: 2, scalar: Scalar::I32 };
    /// assert_eq!(point.lanes(), [Scalar::I32; 2]);
    /// ```
    #[must_use]
    pub fn lanes(&self) -> Vec<Scalar> {
        let mut lanes = Vec::new();
        self.visit(&mut String::new(), &mut |_, scalar| lanes.push(scalar));
        lanes
    }

    /// The name of each lane as an access in WGSL: `""` for a scalar, `".x"`, `"[2].y"`, `".weight"`.
    ///
    /// ```
    /// use karat::unstable::value::{Scalar, Shape};
    ///
    /// let point = Shape::Vector { size: 2, scalar: Scalar::I32 };
    /// assert_eq!(point.lane_names(), [".x", ".y"]);
    /// ```
    #[must_use]
    pub fn lane_names(&self) -> Vec<String> {
        let mut names = Vec::new();
        self.visit(&mut String::new(), &mut |name, _| names.push(name.to_owned()));
        names
    }

    fn visit(&self, prefix: &mut String, lane: &mut impl FnMut(&str, Scalar)) {
        let mut nested = |suffix: &str, shape: &Self| {
            let length = prefix.len();
            prefix.push_str(suffix);
            shape.visit(prefix, lane);
            prefix.truncate(length);
        };
        match self {
            Self::Scalar(scalar) => lane(prefix, *scalar),
            Self::Vector { size, scalar } => {
                for name in [".x", ".y", ".z", ".w"].iter().take(usize::from(*size)) {
                    nested(name, &Self::Scalar(*scalar));
                }
            }
            Self::Matrix { columns, rows, scalar } => {
                let column = Self::Vector { size: *rows, scalar: *scalar };
                for index in 0..*columns {
                    nested(&format!("[{index}]"), &column);
                }
            }
            Self::Array { element, length } => {
                for index in 0..*length {
                    nested(&format!("[{index}]"), element);
                }
            }
            Self::Struct { members, .. } => {
                for (name, shape) in members {
                    nested(&format!(".{name}"), shape);
                }
            }
        }
    }

    /// Checks if Karat accepts a host value of this shape as a value of the WGSL type `wgsl`.
    ///
    /// Two structures match if their members match. The structures' own names may differ. If `result` is `true`, the
    /// host's `f32` also matches `f16`, because a reference computes in `f64` for both types.
    ///
    /// ```
    /// use karat::unstable::value::{Scalar, Shape};
    ///
    /// let (float, word) = (Shape::Scalar(Scalar::F32), Shape::Scalar(Scalar::U32));
    /// assert!(float.stands_for(&float, true) && !float.stands_for(&word, true));
    /// ```
    #[must_use]
    pub fn stands_for(&self, wgsl: &Self, result: bool) -> bool {
        let scalars = |host: Scalar, shader: Scalar| {
            host == shader || (result && host == Scalar::F32 && shader == Scalar::F16)
        };
        match (self, wgsl) {
            (Self::Scalar(a), Self::Scalar(b)) => scalars(*a, *b),
            (Self::Vector { size: a, scalar: s }, Self::Vector { size: b, scalar: t }) => {
                a == b && scalars(*s, *t)
            }
            (
                Self::Matrix { columns, rows, scalar },
                Self::Matrix { columns: c, rows: r, scalar: t },
            ) => columns == c && rows == r && scalars(*scalar, *t),
            (Self::Array { element, length }, Self::Array { element: e, length: l }) => {
                length == l && element.stands_for(e, result)
            }
            (Self::Struct { name: own, members }, Self::Struct { members: others, .. }) => {
                let tuple = own == several::NAME;
                members.len() == others.len()
                    && members.iter().zip(others).all(|((name, shape), (other, wgsl))| {
                        (tuple || name == other) && shape.stands_for(wgsl, result)
                    })
            }
            _ => false,
        }
    }

    /// The shape of a [`Quad`] of values of this shape.
    #[doc(hidden)]
    pub fn as_quad(&self) -> Self {
        Quad::<f32>::members(self)
    }

    /// The shape of the value that varies from pixel to pixel, if `self` is the shape of a [`Quad`]; otherwise `None`.
    ///
    /// ```
    /// use karat::unstable::value::{Scalar, Shape};
    ///
    /// assert_eq!(Shape::Scalar(Scalar::F32).quad(), None);
    /// ```
    #[must_use]
    pub fn quad(&self) -> Option<&Self> {
        let Self::Struct { name, members } = self else { return None };
        match &**members {
            [(_, value), _, _] if name == Quad::<f32>::NAME => Some(value),
            _ => None,
        }
    }

    /// The value in `lanes` in WGSL's notation. Each number has the fewest decimal digits that give the same bits.
    ///
    /// ```
    /// use karat::unstable::value::{Scalar, Shape};
    ///
    /// let point = Shape::Vector { size: 2, scalar: Scalar::F32 };
    /// assert_eq!(point.format(&[0, 1.5_f32.to_bits()]), "(0, 1.5)");
    /// ```
    ///
    /// # Panics
    /// Panics if `lanes` has fewer lanes than the value.
    #[must_use]
    pub fn format(&self, lanes: &[u32]) -> String {
        let mut at = 0;
        let mut text = String::new();
        self.format_into(lanes, &mut at, &mut text);
        text
    }

    fn format_into(&self, lanes: &[u32], at: &mut usize, text: &mut String) {
        let mut list =
            |open: &str, close: &str, shapes: &mut dyn Iterator<Item = (&str, &Self)>| {
                text.push_str(open);
                for (index, (label, shape)) in shapes.enumerate() {
                    if index > 0 {
                        text.push_str(", ");
                    }
                    text.push_str(label);
                    shape.format_into(lanes, at, text);
                }
                text.push_str(close);
            };
        match self {
            Self::Scalar(scalar) => {
                text.push_str(&format_lane(*scalar, lanes[*at]));
                *at += 1;
            }
            Self::Vector { size, scalar } => {
                let component = Self::Scalar(*scalar);
                list("(", ")", &mut (0..*size).map(|_| ("", &component)));
            }
            Self::Matrix { columns, rows, scalar } => {
                let column = Self::Vector { size: *rows, scalar: *scalar };
                list("(", ")", &mut (0..*columns).map(|_| ("", &column)));
            }
            Self::Array { element, length } => {
                list("[", "]", &mut (0..*length).map(|_| ("", &**element)));
            }
            Self::Struct { members, .. } => {
                let labels: Vec<_> =
                    members.iter().map(|(name, shape)| (format!("{name}: "), shape)).collect();
                list("{ ", " }", &mut labels.iter().map(|(label, shape)| (label.as_str(), *shape)));
            }
        }
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Scalar(scalar) => f.write_str(scalar.wgsl()),
            Self::Vector { size, scalar } => write!(f, "vec{size}<{}>", scalar.wgsl()),
            Self::Matrix { columns, rows, scalar } => {
                write!(f, "mat{columns}x{rows}<{}>", scalar.wgsl())
            }
            Self::Array { element, length } => write!(f, "array<{element}, {length}>"),
            Self::Struct { name, members } if name == several::NAME => {
                let members: Vec<String> = members.iter().map(|(_, m)| m.to_string()).collect();
                write!(f, "({})", members.join(", "))
            }
            Self::Struct { name, .. } => match self.quad() {
                Some(value) => write!(f, "Quad<{value}>"),
                None => f.write_str(name),
            },
        }
    }
}

/// One lane in decimal, with the fewest digits that give the same bits.
///
/// ```
/// use karat::unstable::value::Scalar;
/// use karat::unstable::value::format_lane;
///
/// assert_eq!(format_lane(Scalar::I32, u32::MAX), "-1");
/// ```
#[must_use]
pub fn format_lane(scalar: Scalar, lane: u32) -> String {
    match scalar {
        Scalar::F32 | Scalar::F16 => format_f32(f32::from_bits(lane)),
        Scalar::I32 => lane.cast_signed().to_string(),
        Scalar::U32 => lane.to_string(),
        Scalar::Bool => (lane != 0).to_string(),
    }
}

/// An `f32` in decimal, with the fewest digits that give the same bits, and with an exponent if plain digits would be
/// long. Special values become `-0`, `NaN`, `inf` and `-inf`.
///
/// ```
/// use karat::unstable::value::format_f32;
///
/// assert_eq!(format_f32(0.1), "0.1");
/// ```
#[must_use]
pub fn format_f32(value: f32) -> String {
    let size = value.abs();
    if value == 0.0 || (1e-4..1e7).contains(&size) || !value.is_finite() {
        format!("{value}")
    } else {
        format!("{value:e}")
    }
}

/// An `f32` in C99's hexadecimal notation, which shows every bit: `0x1.99999ap-4`.
///
/// ```
/// use karat::unstable::value::hexfloat;
///
/// assert_eq!(hexfloat(0.1), "0x1.99999ap-4");
/// ```
#[must_use]
pub fn hexfloat(value: f32) -> String {
    if value.is_nan() {
        return format!("NaN(0x{:08x})", value.to_bits());
    }
    if value.is_infinite() {
        return format!("{value}");
    }
    let bits = value.to_bits();
    let sign = if value.is_sign_negative() { "-" } else { "" };
    // The 23 bits of the fraction are shown as 24 bits: six hexadecimal digits, without trailing zeros.
    let fraction = format!("{:06x}", (bits & 0x007f_ffff) << 1);
    let fraction = fraction.trim_end_matches('0');
    let point = if fraction.is_empty() { "" } else { "." };
    match (bits >> 23) & 0xff {
        0 if bits << 1 == 0 => format!("{sign}0x0p+0"),
        0 => format!("{sign}0x0{point}{fraction}p-126"), // a denormal has no leading one
        exponent => {
            let exponent = exponent.cast_signed() - 127;
            format!("{sign}0x1{point}{fraction}p{exponent:+}")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Lesson 48
    #[test]
    fn hexfloat_shows_every_bit() {
        assert_eq!(hexfloat(0.1), "0x1.99999ap-4");
        assert_eq!(hexfloat(1.0), "0x1p+0");
        assert_eq!(hexfloat(-0.0), "-0x0p+0");
        assert_eq!(hexfloat(f32::from_bits(1)), "0x0.000002p-126");
        assert_eq!(hexfloat(f32::MAX), "0x1.fffffep+127");
        assert_eq!(hexfloat(f32::NEG_INFINITY), "-inf");
        assert_eq!(hexfloat(f32::from_bits(0x7fc0_0001)), "NaN(0x7fc00001)");
    }

    #[test]
    fn decimals_read_back_to_the_same_bits() {
        for value in [0.1, 1e-30, 16_777_216.0, -0.0, f32::MIN_POSITIVE, f32::MAX, 1.5e9] {
            let text = format_f32(value);
            assert_eq!(text.parse::<f32>().map(f32::to_bits), Ok(value.to_bits()), "{text}");
        }
    }

    #[test]
    fn lanes_are_named_as_wgsl_accesses() {
        let shape = Shape::Struct {
            name: "Hit".into(),
            members: vec![
                ("n".into(), Shape::Vector { size: 3, scalar: Scalar::F32 }),
                (
                    "ids".into(),
                    Shape::Array { element: Box::new(Shape::Scalar(Scalar::U32)), length: 2 },
                ),
            ],
        };
        assert_eq!(shape.lane_names(), [".n.x", ".n.y", ".n.z", ".ids[0]", ".ids[1]"]);
        assert_eq!(shape.format(&[0, 0x3f80_0000, 0, 7, 8]), "{ n: (0, 1, 0), ids: [7, 8] }");
    }
}
