//! Answers questions about WGSL shaders without a test.
//!
//! | question | answer |
//! |---|---|
//! | which operations go wrong in functions and passes? | [`hazards()`] |
//! | which results does an edit change? | [`compare`] |
//! | do naga's translations give the same results, here and on other drivers? | [`matrix()`] |
//!
//! All three modules run shaders over inputs that [`made_up`] generates from declarations, source text and types.
//!
//! ```
//! use karat::Package;
//!
//! let package = Package::from_source("m", "fn inverse(x: f32) -> f32 { return 1.0 / x; }");
//! let found = karat_inspect::hazards(&package).run()?;
//! assert_eq!(found.found[0].function, "inverse");
//! # Ok::<(), karat_inspect::hazards::HazardError>(())
//! ```
//!
//! This crate's API may change in any release.

pub mod compare;
pub mod conform;
pub mod hazards;
mod limits;
pub mod made_up;
pub mod matrix;
mod passes;
mod work;

pub use hazards::hazards;
pub use matrix::matrix;
pub use passes::Usual;
