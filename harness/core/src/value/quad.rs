//! Values that vary from pixel to pixel.

use super::{Mirror, Shape, Shareable};

/// A value on a quad of two by two pixels: the value at the upper left pixel, its change to the pixel on the right
/// (`dx`), and its change to the pixel below (`dy`). Functions that take derivatives, or sample with an implicit level
/// of detail, have such arguments. Karat checks the result of such a function at the upper left pixel.
///
/// `T` is `f32`, or a vector or matrix of `f32`. The reference receives a `Quad` of the mirror of `T`.
///
/// ```
/// use karat::prelude::*;
/// use karat::unstable::value::Quad;
///
/// let package = Package::from_source("m", "fn slope(x: f32) -> f32 { return dpdx(2.0 * x); }");
/// let x = (0.0..=1.0_f32, 0.0..=0.5_f32).map(|(value, dx)| Quad { value, dx, dy: 0.0 });
/// package.function("slope").over(x).agrees_with(|x: Quad<f64>| 2.0 * x.dx, Abs(1e-6));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quad<T> {
    /// The value at the upper left pixel.
    pub value: T,
    /// The value at the pixel on the right, minus `value`: `dpdx(value)`.
    pub dx: T,
    /// The value at the pixel below, minus `value`: `dpdy(value)`.
    pub dy: T,
}

impl<T> Quad<T> {
    /// The name of a quad's shape. No WGSL structure can have this name.
    #[doc(hidden)]
    pub const NAME: &str = "Quad<>";

    pub(super) fn members(shape: &Shape) -> Shape {
        let members = ["value", "dx", "dy"].map(|name| (name.to_owned(), shape.clone()));
        Shape::Struct { name: Self::NAME.to_owned(), members: members.to_vec() }
    }
}

impl<T: Shareable> Shareable for Quad<T> {
    type Mirror = Quad<T::Mirror>;

    fn shape() -> Shape {
        Self::members(&T::shape())
    }

    fn store(&self, lanes: &mut Vec<u32>) {
        [&self.value, &self.dx, &self.dy].into_iter().for_each(|part| part.store(lanes));
    }

    fn load(lanes: &mut std::slice::Iter<'_, u32>) -> Self {
        Self { value: T::load(lanes), dx: T::load(lanes), dy: T::load(lanes) }
    }

    fn widen(&self) -> Self::Mirror {
        Quad { value: self.value.widen(), dx: self.dx.widen(), dy: self.dy.widen() }
    }
}

impl<T: Mirror> Mirror for Quad<T> {
    fn shape() -> Shape {
        Self::members(&T::shape())
    }

    fn lanes(&self, lanes: &mut Vec<f64>) {
        [&self.value, &self.dx, &self.dy].into_iter().for_each(|part| part.lanes(lanes));
    }
}
