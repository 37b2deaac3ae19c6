//! Several results of one call: tuples of mirrors.

use super::{Mirror, Shape};

/// The name of a tuple's shape. No WGSL structure can have this name.
pub(super) const NAME: &str = "()";

macro_rules! tuples {
    ($(($($name:ident $index:tt),+))*) => {$(
        /// The tuple has the function's result, then the values behind pointers, then the resources that the function
        /// wrote.
        impl<$($name: Mirror),+> Mirror for ($($name,)+) {
            fn shape() -> Shape {
                let members = vec![$((stringify!($index).to_owned(), $name::shape())),+];
                Shape::Struct { name: NAME.to_owned(), members }
            }

            fn lanes(&self, lanes: &mut Vec<f64>) {
                $(self.$index.lanes(lanes);)+
            }
        }
    )*};
}

tuples! {
    (A 0, B 1)
    (A 0, B 1, C 2)
    (A 0, B 1, C 2, D 3)
    (A 0, B 1, C 2, D 3, E 4)
    (A 0, B 1, C 2, D 3, E 4, F 5)
}
