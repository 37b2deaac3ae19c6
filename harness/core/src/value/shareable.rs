//! Host types that can be arguments of a WGSL function.

use std::fmt::Debug;

use glam::{
    BVec2, BVec3, BVec4, DMat2, DMat3, DMat4, DVec2, DVec3, DVec4, IVec2, IVec3, IVec4, Mat2, Mat3,
    Mat4, UVec2, UVec3, UVec4, Vec2, Vec3, Vec4,
};
use half::f16;

use super::{Mirror, Scalar, Shape};

/// A type whose values can travel between the CPU and the GPU: scalars, glam's vectors and matrices, arrays, and
/// structures declared with [`shareable!`](crate::shareable).
///
/// ```
/// use glam::Vec2;
/// use karat::Shareable;
///
/// let mut lanes = Vec::new();
/// Vec2::new(0.0, 1.0).store(&mut lanes);
/// assert_eq!(lanes, [0, 0x3f80_0000]);
/// assert_eq!(Vec2::load(&mut lanes.iter()), Vec2::new(0.0, 1.0));
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` can't be passed to a WGSL function",
    label = "not a WGSL value",
    note = "use f32, i32, u32, bool, half::f16, glam's f32 vectors and matrices, arrays of them, \
            or declare a structure with `karat::shareable!`. Vectors of another version of glam need a feature of karat, \
            such as `glam-029`"
)]
pub trait Shareable: Clone + Debug + PartialEq + Send + Sync + 'static {
    /// The `f64` twin of this type, which references receive.
    type Mirror: Mirror;

    /// The WGSL type.
    fn shape() -> Shape;

    /// Appends the lanes of the value.
    fn store(&self, lanes: &mut Vec<u32>);

    /// Reads the value from its lanes, in the order of [`store`](Self::store). Missing lanes count as 0.
    fn load(lanes: &mut std::slice::Iter<'_, u32>) -> Self;

    /// Converts the value to `f64`, without rounding.
    fn widen(&self) -> Self::Mirror;
}

#[inline]
pub(super) fn next(lanes: &mut std::slice::Iter<'_, u32>) -> u32 {
    match lanes.next() {
        Some(lane) => *lane,
        None => 0,
    }
}

// These functions run for each case. This crate is compiled with more optimisations than tests, so the functions must
// be compiled here, and not in the tests that call them.

/// A scalar type that fits into one 32-bit lane, for the components of vectors.
pub(super) trait Word: Copy {
    fn word(self) -> u32;
    fn of(word: u32) -> Self;
}

macro_rules! scalar {
    ($($host:ty, $mirror:ty, $scalar:ident, |$v:ident| $store:expr, |$lane:ident| $load:expr, $widen:expr;)*) => {$(
        impl Shareable for $host {
            type Mirror = $mirror;
            fn shape() -> Shape {
                Shape::Scalar(Scalar::$scalar)
            }
            #[inline(never)]
            fn store(&self, lanes: &mut Vec<u32>) {
                lanes.push(self.word());
            }
            #[inline(never)]
            fn load(lanes: &mut std::slice::Iter<'_, u32>) -> Self {
                Self::of(next(lanes))
            }
            #[inline(never)]
            fn widen(&self) -> $mirror {
                let $v = *self;
                $widen
            }
        }
        impl Word for $host {
            #[inline]
            fn word(self) -> u32 {
                let $v = self;
                $store
            }
            #[inline]
            fn of($lane: u32) -> Self {
                $load
            }
        }
    )*};
}

scalar! {
    f32, f64, F32, |v| v.to_bits(), |lane| Self::from_bits(lane), f64::from(v);
    f16, f64, F16, |v| v.to_f32().to_bits(), |lane| Self::from_f32(f32::from_bits(lane)), v.to_f64();
    i32, i32, I32, |v| v.cast_unsigned(), |lane| lane.cast_signed(), v;
    u32, u32, U32, |v| v, |lane| lane, v;
    bool, bool, Bool, |v| u32::from(v), |lane| lane != 0, v;
}

macro_rules! vector {
    ($($host:ty, $mirror:ty, $component:ty, $size:literal, $scalar:ident, $widen:expr;)*) => {$(
        impl Shareable for $host {
            type Mirror = $mirror;
            fn shape() -> Shape {
                Shape::Vector { size: $size, scalar: Scalar::$scalar }
            }
            #[inline(never)]
            fn store(&self, lanes: &mut Vec<u32>) {
                for component in &<[$component; $size]>::from(*self) {
                    lanes.push(component.word());
                }
            }
            #[inline(never)]
            fn load(lanes: &mut std::slice::Iter<'_, u32>) -> Self {
                let mut components = [<$component>::default(); $size];
                for component in &mut components {
                    *component = Word::of(next(lanes));
                }
                Self::from(components)
            }
            #[inline(never)]
            fn widen(&self) -> $mirror {
                let widen: fn(Self) -> $mirror = $widen;
                widen(*self)
            }
        }
    )*};
}

pub(super) use vector as shareable_vector;

macro_rules! matrix {
    ($($host:ty, $mirror:ty, $order:literal, $lanes:literal, $widen:ident;)*) => {$(
        impl Shareable for $host {
            type Mirror = $mirror;
            fn shape() -> Shape {
                Shape::Matrix { columns: $order, rows: $order, scalar: Scalar::F32 }
            }
            #[inline(never)]
            fn store(&self, lanes: &mut Vec<u32>) {
                lanes.extend(self.to_cols_array().map(f32::to_bits));
            }
            #[inline(never)]
            fn load(lanes: &mut std::slice::Iter<'_, u32>) -> Self {
                let columns: [f32; $lanes] = std::array::from_fn(|_| Word::of(next(lanes)));
                Self::from_cols_array(&columns)
            }
            #[inline(never)]
            fn widen(&self) -> $mirror {
                self.$widen()
            }
        }
    )*};
}

/// Implements [`Shareable`] for one version of glam. The version's types, `shareable_vector` and `shareable_matrix`
/// must be in scope.
macro_rules! shared {
    () => {
        shareable_vector! {
            Vec2, DVec2, f32, 2, F32, |v| v.as_dvec2();
            Vec3, DVec3, f32, 3, F32, |v| v.as_dvec3();
            Vec4, DVec4, f32, 4, F32, |v| v.as_dvec4();
            IVec2, IVec2, i32, 2, I32, |v| v;
            IVec3, IVec3, i32, 3, I32, |v| v;
            IVec4, IVec4, i32, 4, I32, |v| v;
            UVec2, UVec2, u32, 2, U32, |v| v;
            UVec3, UVec3, u32, 3, U32, |v| v;
            UVec4, UVec4, u32, 4, U32, |v| v;
            BVec2, BVec2, bool, 2, Bool, |v| v;
            BVec3, BVec3, bool, 3, Bool, |v| v;
            BVec4, BVec4, bool, 4, Bool, |v| v;
        }

        shareable_matrix! {
            Mat2, DMat2, 2, 4, as_dmat2;
            Mat3, DMat3, 3, 9, as_dmat3;
            Mat4, DMat4, 4, 16, as_dmat4;
        }
    };
}

pub(super) use matrix as shareable_matrix;
#[cfg(any(
    feature = "glam-029",
    feature = "glam-030",
    feature = "glam-031",
    feature = "glam-032",
    feature = "glam-033"
))]
pub(super) use shared;

shared! {}

impl<T: Shareable, const N: usize> Shareable for [T; N] {
    type Mirror = [T::Mirror; N];
    fn shape() -> Shape {
        let length = u32::try_from(N).expect("a WGSL array has fewer than 2^32 elements");
        Shape::Array { element: Box::new(T::shape()), length }
    }
    fn store(&self, lanes: &mut Vec<u32>) {
        for element in self {
            element.store(lanes);
        }
    }
    fn load(lanes: &mut std::slice::Iter<'_, u32>) -> Self {
        std::array::from_fn(|_| T::load(lanes))
    }
    fn widen(&self) -> Self::Mirror {
        std::array::from_fn(|index| self[index].widen())
    }
}

/// The arguments of one case: a [`Shareable`] value, or a tuple of up to twelve such values, or `()`.
///
/// ```
/// use karat::unstable::value::{Arguments, Scalar, Shape};
///
/// let float = Shape::Scalar(Scalar::F32);
/// assert_eq!(<(f32, u32)>::shapes(), [float, Shape::Scalar(Scalar::U32)]);
/// ```
#[diagnostic::on_unimplemented(
    message = "`{Self}` can't be the arguments of a WGSL function",
    label = "expected a WGSL value or a tuple of one to twelve of them",
    note = "WGSL values are f32, i32, u32, bool, half::f16, glam's f32 vectors and matrices, arrays \
            of them, and structures declared with `karat::shareable!`"
)]
pub trait Arguments: Clone + Debug + Send + Sync + 'static {
    /// The WGSL type of each argument.
    fn shapes() -> Vec<Shape>;
    /// Appends the lanes of all arguments.
    fn store_all(&self, lanes: &mut Vec<u32>);
    /// Reads the arguments from their lanes.
    fn load_all(lanes: &mut std::slice::Iter<'_, u32>) -> Self;
}

impl<T: Shareable> Arguments for T {
    fn shapes() -> Vec<Shape> {
        vec![T::shape()]
    }
    fn store_all(&self, lanes: &mut Vec<u32>) {
        self.store(lanes);
    }
    fn load_all(lanes: &mut std::slice::Iter<'_, u32>) -> Self {
        Self::load(lanes)
    }
}

impl Arguments for () {
    fn shapes() -> Vec<Shape> {
        Vec::new()
    }
    fn store_all(&self, _: &mut Vec<u32>) {}
    fn load_all(_: &mut std::slice::Iter<'_, u32>) -> Self {}
}

macro_rules! arguments {
    ($(($($name:ident $index:tt),+))*) => {$(
        impl<$($name: Shareable),+> Arguments for ($($name,)+) {
            fn shapes() -> Vec<Shape> {
                vec![$($name::shape()),+]
            }
            fn store_all(&self, lanes: &mut Vec<u32>) {
                $(self.$index.store(lanes);)+
            }
            fn load_all(lanes: &mut std::slice::Iter<'_, u32>) -> Self {
                ($($name::load(lanes),)+)
            }
        }
    )*};
}

arguments! {
    (A 0)
    (A 0, B 1)
    (A 0, B 1, C 2)
    (A 0, B 1, C 2, D 3)
    (A 0, B 1, C 2, D 3, E 4)
    (A 0, B 1, C 2, D 3, E 4, F 5)
    (A 0, B 1, C 2, D 3, E 4, F 5, G 6)
    (A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7)
    (A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7, I 8)
    (A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7, I 8, J 9)
    (A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7, I 8, J 9, K 10)
    (A 0, B 1, C 2, D 3, E 4, F 5, G 6, H 7, I 8, J 9, K 10, L 11)
}

/// Lets you pass a type of your own to WGSL in place of one of glam's vectors. The type must convert from and into an
/// array of floats or integers. Functions, buffers, meshes and textures accept the type. References receive glam's
/// `f64` vector.
///
/// ```
/// use karat::prelude::*;
///
/// #[derive(Clone, Copy, Debug, PartialEq)]
/// struct Rgb { r: f32, g: f32, b: f32 }
///
/// impl From<Rgb> for [f32; 3] {
///     fn from(c: Rgb) -> Self { [c.r, c.g, c.b] }
/// }
/// impl From<[f32; 3]> for Rgb {
///     fn from([r, g, b]: [f32; 3]) -> Self { Self { r, g, b } }
/// }
/// karat::vector!(Rgb: Vec3);
///
/// let package = Package::from_source("m", "fn grey(c: vec3f) -> f32 { return (c.r + c.g + c.b) / 3.0; }");
/// let colors = (0.0..=1.0, 0.0..=1.0, 0.0..=1.0).map(|(r, g, b)| Rgb { r, g, b });
/// package.function("grey").over(colors).agrees_with(|c: glam::DVec3| c.element_sum() / 3.0, Ulp(4.0));
/// ```
#[macro_export]
macro_rules! vector {
    ($name:ty: $vector:ident) => {
        impl $crate::value::Shareable for $name {
            type Mirror = <$crate::glam::$vector as $crate::value::Shareable>::Mirror;
            fn shape() -> $crate::value::Shape {
                <$crate::glam::$vector as $crate::value::Shareable>::shape()
            }
            #[inline(never)]
            fn store(&self, lanes: &mut Vec<u32>) {
                let vector = $crate::glam::$vector::from_array(self.clone().into());
                $crate::value::Shareable::store(&vector, lanes);
            }
            #[inline(never)]
            fn load(lanes: &mut std::slice::Iter<'_, u32>) -> Self {
                let vector = <$crate::glam::$vector as $crate::value::Shareable>::load(lanes);
                Self::from(vector.to_array())
            }
            #[inline(never)]
            fn widen(&self) -> Self::Mirror {
                let vector = $crate::glam::$vector::from_array(self.clone().into());
                $crate::value::Shareable::widen(&vector)
            }
        }
    };
}

/// Declares a structure whose values can travel between the CPU and the GPU, with its `f64` mirror.
///
/// The members must have the names and types of the WGSL structure's members. The structure itself may have another
/// name. Both types implement `Clone`, `Copy`, `Debug`, `PartialEq` and `Default`. The default value is all zeros.
///
/// ```
/// karat::shareable! {
///     /// What `lighting::shade` returns.
///     pub struct Shaded mirrors ShadedMirror {
///         weight: f32,
///         color: glam::Vec3,
///     }
/// }
/// let reference = |weight: f64| ShadedMirror { weight, color: glam::DVec3::ONE };
/// assert_eq!(reference(0.5).weight, 0.5);
/// let shaded = Shaded { weight: 1.0, ..Shaded::default() };
/// assert_eq!(shaded.color, glam::Vec3::ZERO);
/// ```
#[macro_export]
macro_rules! shareable {
    ($(#[$meta:meta])* $vis:vis struct $name:ident mirrors $mirror:ident {
        $($(#[$field_meta:meta])* $field:ident : $type:ty),+ $(,)?
    }) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq)]
        $vis struct $name {
            $($(#[$field_meta])* pub $field: $type),+
        }

        #[doc = concat!("[`", stringify!($name), "`] in `f64`: the type that references receive and return.")]
        #[derive(Clone, Copy, Debug, PartialEq)]
        $vis struct $mirror {
            $($(#[$field_meta])* pub $field: <$type as $crate::value::Shareable>::Mirror),+
        }

        impl $crate::value::Shareable for $name {
            type Mirror = $mirror;
            fn shape() -> $crate::value::Shape {
                $crate::value::Shape::Struct {
                    name: stringify!($name).to_owned(),
                    members: vec![$((
                        stringify!($field).to_owned(),
                        <$type as $crate::value::Shareable>::shape(),
                    )),+],
                }
            }
            #[inline(never)]
            fn store(&self, lanes: &mut Vec<u32>) {
                $($crate::value::Shareable::store(&self.$field, lanes);)+
            }
            #[inline(never)]
            fn load(lanes: &mut std::slice::Iter<'_, u32>) -> Self {
                Self { $($field: <$type as $crate::value::Shareable>::load(lanes)),+ }
            }
            #[inline(never)]
            fn widen(&self) -> $mirror {
                $mirror { $($field: $crate::value::Shareable::widen(&self.$field)),+ }
            }
        }

        impl Default for $name {
            /// All zeros, as in a WGSL variable that has no initial value.
            fn default() -> Self {
                let shape = <Self as $crate::value::Shareable>::shape();
                let zeros = vec![0; shape.lanes().len()];
                <Self as $crate::value::Shareable>::load(&mut zeros.iter())
            }
        }

        impl Default for $mirror {
            /// All zeros.
            fn default() -> Self {
                $crate::value::Shareable::widen(&<$name as Default>::default())
            }
        }

        impl $crate::value::Mirror for $mirror {
            fn shape() -> $crate::value::Shape {
                <$name as $crate::value::Shareable>::shape()
            }
            fn lanes(&self, lanes: &mut Vec<f64>) {
                $($crate::value::Mirror::lanes(&self.$field, lanes);)+
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round_trip<T: Shareable>(value: T) {
        let mut lanes = Vec::new();
        value.store(&mut lanes);
        assert_eq!(lanes.len(), T::shape().lanes().len());
        assert_eq!(T::load(&mut lanes.iter()), value);
        let mut widened = Vec::new();
        value.widen().lanes(&mut widened);
        let decoded: Vec<f64> = T::shape()
            .lanes()
            .iter()
            .zip(&lanes)
            .map(|(scalar, lane)| scalar.decode(*lane))
            .collect();
        assert_eq!(decoded, widened);
    }

    #[test]
    fn values_survive_their_lanes() {
        round_trip(0.1_f32);
        round_trip(f16::from_f32(0.333));
        round_trip(-7_i32);
        round_trip(u32::MAX);
        round_trip(true);
        round_trip(Vec4::new(1.0, -2.0, 3.5, f32::MIN_POSITIVE));
        round_trip(IVec3::new(-1, 0, i32::MAX));
        round_trip(BVec3::new(true, false, true));
        round_trip(Mat3::from_cols_array(&[1., 2., 3., 4., 5., 6., 7., 8., 9.]));
        round_trip([Vec2::X, Vec2::Y, Vec2::ONE]);
    }
}
