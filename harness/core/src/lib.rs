//! The parts of [Karat](https://docs.rs/karat) that need no shader: values, domains, tolerances, statistics, images,
//! messages.
//!
//! Test authors use these parts through `karat`, under its names. They form a crate of their own, so that cargo
//! compiles them in parallel with the shader compilers. Items that are hidden in the documentation are internal to
//! Karat.

/// This crate's glam, for its macros.
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
