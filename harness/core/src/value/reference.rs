//! References: Rust functions that compute the expected result of a shader.

use crate::value::{Arguments, Mirror, Shape, Shareable};

/// A reference for arguments of type `A`: a function that takes the arguments' `f64` mirrors.
///
/// `fn(DVec3, f64) -> DVec3` is a reference for a domain of `(Vec3, f32)`.
///
/// ```
/// # use karat::prelude::*;
/// // The closure has the function's parameters, with `f64` for `f32`.
/// let package = Package::from_source("m", "fn sum(x: f32, n: u32) -> f32 { return x + f32(n); }");
/// let sum = package.function("sum").over((0.0..=1.0, Integers(0..=9_u32)));
/// sum.agrees_with(|x: f64, n: u32| x + f64::from(n), Ulp(1.0));
/// ```
#[diagnostic::on_unimplemented(
    message = "the parameters of this reference don't match the domain's values",
    label = "expected a function whose parameters are the `f64` types for `{A}`",
    note = "a domain of `(Vec3, f32)` needs `fn(DVec3, f64) -> _`; write out the types of a \
            closure's parameters"
)]
pub trait Reference<A: Arguments>: Sync {
    /// The WGSL type of the result.
    fn shape(&self) -> Shape;
    /// Appends the expected value of each lane.
    fn expect(&self, arguments: &A, lanes: &mut Vec<f64>);
}

impl<F, A, R> Reference<A> for F
where
    A: Shareable,
    F: Fn(A::Mirror) -> R + Sync,
    R: Mirror,
{
    fn shape(&self) -> Shape {
        R::shape()
    }
    fn expect(&self, arguments: &A, lanes: &mut Vec<f64>) {
        self(arguments.widen()).lanes(lanes);
    }
}

/// The reference of a WGSL function without parameters. Such a function has one case, and its result depends on its
/// resources.
impl<F, R> Reference<()> for F
where
    F: Fn() -> R + Sync,
    R: Mirror,
{
    fn shape(&self) -> Shape {
        R::shape()
    }
    fn expect(&self, (): &(), lanes: &mut Vec<f64>) {
        self().lanes(lanes);
    }
}

macro_rules! reference {
    ($(($($name:ident $index:tt),+))*) => {$(
        impl<F, R, $($name),+> Reference<($($name,)+)> for F
        where
            $($name: Shareable,)+
            F: Fn($($name::Mirror),+) -> R + Sync,
            R: Mirror,
        {
            fn shape(&self) -> Shape {
                R::shape()
            }
            fn expect(&self, arguments: &($($name,)+), lanes: &mut Vec<f64>) {
                self($(arguments.$index.widen()),+).lanes(lanes);
            }
        }
    )*};
}

reference! {
    (A 0)
    (A 0, B 1)
    (A 0, B 1, C 2)
    (A 0, B 1, C 2, D 3)
    (A 0, B 1, C 2, D 3, E 4)
    (A 0, B 1, C 2, D 3, E 4, G 5)
    (A 0, B 1, C 2, D 3, E 4, G 5, H 6)
    (A 0, B 1, C 2, D 3, E 4, G 5, H 6, I 7)
    (A 0, B 1, C 2, D 3, E 4, G 5, H 6, I 7, J 8)
    (A 0, B 1, C 2, D 3, E 4, G 5, H 6, I 7, J 8, K 9)
    (A 0, B 1, C 2, D 3, E 4, G 5, H 6, I 7, J 8, K 9, L 10)
    (A 0, B 1, C 2, D 3, E 4, G 5, H 6, I 7, J 8, K 9, L 10, M 11)
}
