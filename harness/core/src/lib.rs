//! The part of [Karat](https://docs.rs/karat) that needs no shader: values, domains, tolerances, statistics, images, messages.
//!
//! Authors of tests know all of it by the names that `karat` has for it. It is a crate of its own so that it is compiled
//! beside the shader compilers, and not after them. What its documentation hides is Karat's own.

/// The glam of this crate, for its macros.
pub use glam;

pub mod diagnostic;
pub mod domain;
#[doc(hidden)]
pub mod expectation;
#[doc(hidden)]
pub mod hazard;
pub mod image;
#[doc(hidden)]
pub mod lines;
pub mod metric;
pub mod output;
#[doc(hidden)]
pub mod panics;
pub mod settings;
pub mod stats;
pub mod tolerance;
pub mod value;
