//! Answers questions about WGSL shaders without a test.
//!
//! | question | answer |
//! |---|---|
//! | what goes wrong inside of these functions and passes? | [`hazards()`] |
//! | what does this edit change? | [`compare`] |
//! | do naga's translations say the same, here and on other drivers? | [`matrix()`] |
//!
//! All three run the shader over inputs that [`made_up`] generates from declarations, from the text and from types.
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
//! Names and meanings may change in any release.

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
