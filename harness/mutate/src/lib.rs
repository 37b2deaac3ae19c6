//! Mutation testing of WGSL: whether a package's tests would see a slip in its shaders.
//!
//! [`mutants`] makes slips of a text: another operator, a number that is off, a guard less. [`Request`] gives each to the
//! tests that are made of it, as a text that isn't saved: nothing is compiled, and no file changes. A mutant that a test
//! fails for is killed. Of one that lives [`Lived`] says why, and where original and mutant part.
//!
//! ```
//! use karat::Package;
//! use karat_mutate::{Fate, Request};
//!
//! let folder = tempfile::tempdir()?;
//! std::fs::write(folder.path().join("calc.wgsl"), "fn half(x: f32) -> f32 { return 0.5 * x; }\n")?;
//! let test = "[[test]]\nfunction = \"half\"\nover = { x = 2 }\nequals = 1\ntolerance = \"1 ulp\"\n";
//! std::fs::write(folder.path().join("calc.test.toml"), test)?;
//! let hunted = Request::new(Package::open(folder.path())?).run(&|_, _, _| {})?;
//! assert!(hunted.tried.iter().any(|one| matches!(one.fate, Fate::Killed { .. })));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod hunt;
mod lived;
mod maker;
mod score;
#[cfg(test)]
mod tests;
mod tokens;

pub use hunt::{Candidate, Fate, Hidden, Hunted, Judged, MutateError, Others, Request, Tried};
pub use lived::{Difference, Equality, Form, Lived};
pub use maker::{Mutant, Rule, mutants};
pub use score::Score;
