//! Karat tests WGSL shaders from Rust: it compares functions with references, and frames with goldens.
//!
//! ```no_run
//! use std::f64::consts::PI;
//!
//! use karat::prelude::*;
//!
//! static SHADERS: Package = karat::package!("shaders"); // a folder beside Cargo.toml
//!
//! // #[test]
//! fn lambert_is_what_the_textbook_says() {
//!     SHADERS
//!         .function("brdf::lambert")
//!         .over((0.0..=1.0, 0.0..=1.0)) // albedo, n_dot_l: seeded, edge-biased, one dispatch
//!         .agrees_with(|albedo: f64, n_dot_l: f64| albedo / PI * n_dot_l, Ulp(4.0));
//! }
//! ```
//!
//! A check runs in a plain `#[test]`. Karat links the function with everything that the function uses from the
//! shader folder, and compares the function's signature with the domain and the reference. Then Karat generates a
//! compute kernel, runs the kernel on each selected execution path ([`Path`]) and compares the results with the
//! reference. The reference computes in `f64` from the same `f32` arguments.
//!
//! # What do I have, and what do I use?
//!
//! | I have | I use |
//! |---|---|
//! | a folder of WGSL | [`package!`]`("shaders")` |
//! | WGSL as text, or a few lines around a function | [`Package::from_source`], [`Package::depends_on`] |
//! | the shaders of a crate, such as Bevy's | [`package!`]`(crate = "bevy_pbr@0.20.1")` |
//! | a function, and the formula in Rust | [`Check::agrees_with`] |
//! | a function, and a simpler function in WGSL that computes the same | [`Check::agrees_with_function`] |
//! | a function, and a property that it must have | [`Check::satisfies`], [`Check::stays_within`], [`Check::is_monotone_in`], [`Check::invariant_under`] |
//! | a function without a formula, such as noise or a fitted curve | [`Check::matches`] with [`Goldens`] |
//! | a BRDF or a density to integrate | [`Check::integrates_to`] over [`Directions`], or [`Probe::integral`](check::Probe::integral) with my own quadrature rule |
//! | a sampler and its density | [`Probe::sampled_over`](check::Probe::sampled_over) |
//! | numbers as arguments | ranges such as `0.0..=1.0`, [`Integers`], [`Grid`], [`AnyF32`] |
//! | directions and colours as arguments | [`UnitVector`], [`Hemisphere`], [`UnitRgb`] |
//! | a WGSL structure | [`shareable!`] |
//! | a tolerance | [`Ulp`], [`Rel`], [`Abs`]; [`Spec`] if I don't know a tolerance |
//! | a texture, a sampler or a buffer that the function reads | [`Texture`], [`CubeMap`], [`Sampler`], [`Uniform`], [`Storage`], [`Buffer`](fixture::Buffer) |
//! | entry points that draw | [`Package::frame`], [`Frame`], [`Goldens`] |
//! | compute passes | [`Package::compute`], [`Compute`](compute::Compute) |
//! | a driver with wrong results | [`Check::tolerance_on`], [`Check::fails_on`], [`Check::refused_on`], [`Path`] |
//! | shaders without tests | [`Package::is_valid`], and the crate `karat-inspect` |
//!
//! Every verb, such as `agrees_with`, has a `try_` form that returns the [`Failure`](check::Failure)
//! instead of panicking.
//!
//! The stable names are at the root, in [`prelude`] and in the modules. Only a new major version changes them.
//! Other names are for programs that run or report tests: such a name is in [`unstable`], or its documentation
//! marks the name as *Unstable*.

pub mod check;
pub mod compute;
mod dispatch;
pub mod draw;
mod executor;
pub mod fixture;
pub mod frame;
pub mod golden;
mod interpret;
mod job;
mod judge;
pub mod package;
mod parallel;
pub mod path;
mod probe;
mod record;
mod reflect;
mod run;
mod tint;
pub mod unstable;

use karat_core::{diagnostic, expectation, hazard, lines, output, panics, settings};

#[doc(no_inline)]
pub use glam;
#[doc(inline)]
pub use karat_core::{shareable, vector};

/// Domains: the sets from which Karat samples arguments. Ranges include both ends, sampling prefers edges, and a
/// seed determines every case.
pub mod domain {
    pub(crate) use karat_core::domain::*;
    #[doc(inline)]
    pub use karat_core::domain::{
        AnyF32, Domain, Edges, Grid, Hemisphere, Integers, Just, OneOf, Sphere, UnitRgb, UnitVector,
    };
}

/// Float images, from EXR and PNG.
pub mod image {
    pub(crate) use karat_core::image::*;
    #[doc(inline)]
    pub use karat_core::image::{Image, ImageError, Precision};
}

/// Measures of the difference between a frame and its golden. `Flip` measures the difference that a person would see.
/// `Noise` compares the difference with the noise of both images. `Mask` selects the pixels to compare.
pub mod metric {
    pub(crate) use karat_core::metric::*;
    #[doc(inline)]
    pub use karat_core::metric::{Flip, Mask, MaskError, Noise, Pool, Rect};
}

/// Supports of samplers, such as a hemisphere, and quadrature rules for references.
pub mod stats {
    pub(crate) use karat_core::stats::*;
    #[doc(inline)]
    pub use karat_core::stats::{Support, gauss_legendre};
}

/// Tolerances: the largest errors that pass, such as `Ulp` and `Rel`.
pub mod tolerance {
    pub(crate) use karat_core::tolerance::*;
    #[doc(inline)]
    pub use karat_core::tolerance::{Abs, DeviceSpec, Rel, Spec, Tolerance, Ulp};
}

/// WGSL values and their types in Rust.
pub mod value {
    #[doc(inline)]
    pub use karat_core::value::Shareable;
    pub(crate) use karat_core::value::*;
}

pub use check::{Check, Directions, Limit, Trend};
pub use domain::{
    AnyF32, Domain, Edges, Grid, Hemisphere, Integers, Just, OneOf, UnitRgb, UnitVector,
};
pub use fixture::{CubeMap, Sampler, Storage, Texture, Uniform};
pub use frame::Frame;
pub use golden::Goldens;
pub use image::Image;
pub use package::Package;
pub use path::Path;
pub use probe::Inputs;
pub use stats::Support;
pub use tolerance::{Abs, DeviceSpec, Rel, Spec, Tolerance, Ulp};
pub use value::Shareable;

/// The names that a test file needs: `use karat::prelude::*;`.
pub mod prelude {
    pub use crate::{
        Abs, AnyF32, CubeMap, DeviceSpec, Directions, Domain, Edges, Goldens, Grid, Hemisphere,
        Inputs, Integers, Just, Limit, OneOf, Package, Rel, Sampler, Spec, Storage, Support,
        Texture, Tolerance, Trend, Ulp, Uniform, UnitRgb, UnitVector,
    };
}
