//! Mirrors: the `f64` values that a reference receives and returns.

use glam::{
    BVec2, BVec3, BVec4, DMat2, DMat3, DMat4, DVec2, DVec3, DVec4, IVec2, IVec3, IVec4, UVec2,
    UVec3, UVec4,
};

use super::{Scalar, Shape};

/// The `f64` twin of a [`Shareable`](super::Shareable) type: `f64` for `f32`, `DVec3` for `Vec3`.
///
/// Integers and booleans are their own mirrors.
///
/// ```
/// use karat::unstable::value::Mirror;
///
/// let mut lanes = Vec::new();
/// (glam::DVec2::new(0.5, 1.0)).lanes(&mut lanes);
/// assert_eq!(lanes, [0.5, 1.0]);
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` can't be the result of a reference",
    label = "a reference computes in f64",
    note = "use f64 for `f32`, glam's DVec and DMat types for vectors and matrices; i32, u32, bool \
            and their vectors keep their types"
)]
pub trait Mirror: Clone + std::fmt::Debug + Send + 'static {
    /// The WGSL type whose values Karat compares with this type's values.
    fn shape() -> Shape;

    /// Appends the value of each lane. Integers and booleans are exact in `f64`.
    fn lanes(&self, lanes: &mut Vec<f64>);
}

// Code that runs for each case is compiled in this crate, not in tests, as in `shareable.rs`.

macro_rules! scalar {
    ($($mirror:ty, $scalar:ident, |$v:ident| $lane:expr;)*) => {$(
        impl Mirror for $mirror {
            fn shape() -> Shape {
                Shape::Scalar(Scalar::$scalar)
            }
            #[inline(never)]
            fn lanes(&self, lanes: &mut Vec<f64>) {
                let $v = *self;
                lanes.push($lane);
            }
        }
    )*};
}

scalar! {
    f64, F32, |v| v;
    i32, I32, |v| f64::from(v);
    u32, U32, |v| f64::from(v);
    bool, Bool, |v| f64::from(u8::from(v));
}

macro_rules! vector {
    ($($mirror:ty, $component:ty, $size:literal, $scalar:ident, $lane:expr;)*) => {$(
        impl Mirror for $mirror {
            fn shape() -> Shape {
                Shape::Vector { size: $size, scalar: Scalar::$scalar }
            }
            #[inline(never)]
            fn lanes(&self, lanes: &mut Vec<f64>) {
                let lane: fn($component) -> f64 = $lane;
                for component in &<[$component; $size]>::from(*self) {
                    lanes.push(lane(*component));
                }
            }
        }
    )*};
}

pub(super) use vector as mirror_vector;

macro_rules! matrix {
    ($($mirror:ty, $order:literal;)*) => {$(
        impl Mirror for $mirror {
            fn shape() -> Shape {
                Shape::Matrix { columns: $order, rows: $order, scalar: Scalar::F32 }
            }
            #[inline(never)]
            fn lanes(&self, lanes: &mut Vec<f64>) {
                lanes.extend(self.to_cols_array());
            }
        }
    )*};
}

/// Implements the `f64` mirrors for one version of glam. The version's types, `mirror_vector` and `mirror_matrix` must
/// be in scope.
macro_rules! mirrored {
    () => {
        mirror_vector! {
            DVec2, f64, 2, F32, |v| v;
            DVec3, f64, 3, F32, |v| v;
            DVec4, f64, 4, F32, |v| v;
            IVec2, i32, 2, I32, f64::from;
            IVec3, i32, 3, I32, f64::from;
            IVec4, i32, 4, I32, f64::from;
            UVec2, u32, 2, U32, f64::from;
            UVec3, u32, 3, U32, f64::from;
            UVec4, u32, 4, U32, f64::from;
            BVec2, bool, 2, Bool, |v| f64::from(u8::from(v));
            BVec3, bool, 3, Bool, |v| f64::from(u8::from(v));
            BVec4, bool, 4, Bool, |v| f64::from(u8::from(v));
        }

        mirror_matrix! {
            DMat2, 2;
            DMat3, 3;
            DMat4, 4;
        }
    };
}

pub(super) use matrix as mirror_matrix;
#[cfg(any(
    feature = "glam-029",
    feature = "glam-030",
    feature = "glam-031",
    feature = "glam-032",
    feature = "glam-033"
))]
pub(super) use mirrored;

mirrored! {}

impl<T: Mirror, const N: usize> Mirror for [T; N] {
    fn shape() -> Shape {
        let length = u32::try_from(N).expect("a WGSL array has fewer than 2^32 elements");
        Shape::Array { element: Box::new(T::shape()), length }
    }
    fn lanes(&self, lanes: &mut Vec<f64>) {
        for element in self {
            element.lanes(lanes);
        }
    }
}
