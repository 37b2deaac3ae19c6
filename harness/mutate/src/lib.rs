//! Mutation testing of WGSL: checks that a package's tests would notice mistakes in its shaders.
//!
//! [`mutants`] makes small mistakes in a text: another operator, another number, a missing guard. For each mutant,
//! [`Request`] runs the tests that use the mutated code. Mutants exist only in memory: no file changes. A test that
//! fails on a mutant kills it. For a mutant that lives, [`Lived`] gives the reason. If Karat finds an input for which
//! the mutant and the original differ, [`Lived`] has that input.
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
