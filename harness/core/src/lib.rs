//! The parts of [Karat](https://docs.rs/karat) that work without shaders: values, domains, tolerances, statistics,
//! images and messages.
//!
//! Test authors use these parts through the crate `karat`, which exports them. They are a separate crate so that cargo
//! compiles them in parallel with the shader compilers. Items that this documentation doesn't show are internal to
//! Karat.

/// The version of glam that this crate uses. Karat's macros generate code that uses this version.
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
