//! Tests of WGSL without Rust.
//!
//! There are two forms. Both use Karat's checks, with their verdicts, records, simplest failures and replays:
//!
//! - **In WGSL**: a function with `@test` in any module calls expectations such as `expect_near` of the
//!   package `karat`, or those of the WESL community's `wgsl_test`. See [`WgslTest`].
//! - **Declared**: `brdf.test.toml` beside `brdf.wgsl` asserts properties of its functions. See [`declared`].
//!
//! ```no_run
//! let suite = karat_suite::Suite::open("shaders".as_ref()).unwrap();
//! for test in &suite.tests {
//!     let verdict = suite.run(test);
//!     println!("{} {}", test.name, if verdict.is_ok() { "ok" } else { "FAILED" });
//! }
//! ```

mod assertions;
mod compute;
pub mod declared;
mod domains;
mod draws;
mod find;
mod fixtures;
mod json;
mod normalized_text;
mod numbers;
mod range;
mod relations;
mod rows;
mod run;
mod table;
mod tolerances;
mod wrong;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use karat::Package;
use karat::unstable::check::WgslTest;
use karat::unstable::diagnostic::Span;

pub use find::{FindError, is_meant};
pub use fixtures::fixture;
pub use json::{json, lanes_of_json};
pub use numbers::{Wanted, expected, hexadecimal};
pub use rows::{Places, begins_with_mark, head_of, line_of};
pub use run::Groups;
pub use tolerances::tolerance;
pub use wrong::{Fault, Wrong};

/// The tests of a package.
#[derive(Debug)]
pub struct Suite {
    /// The shaders.
    pub package: Package,
    /// The folder of the package.
    pub folder: PathBuf,
    /// Its tests, by module and line.
    pub tests: Vec<Test>,
    /// The modules, files and tests that can't be run, each with its error. Each is a failure.
    pub broken: Vec<Broken>,
    /// The text that functions of declared tests depend on.
    fingerprints: OnceLock<BTreeMap<String, String>>,
}

/// A test.
#[derive(Debug)]
pub struct Test {
    /// The name, which is unique: `brdf_test::grazing`, or `brdf::schlick in_range` for a declared test.
    pub name: String,
    /// The place in the author's file.
    pub span: Span,
    pub(crate) kind: Kind,
}

#[derive(Debug)]
pub(crate) enum Kind {
    /// A function with `@test`.
    Wgsl(Box<WgslTest>),
    /// An assertion of a `[[test]]`.
    Function(Box<declared::Assertion>),
    /// A `[[frame]]`.
    Frame(Box<declared::Frame>),
    /// An assertion of a `[[compute]]`.
    Compute(Box<compute::Assertion>),
}

impl Test {
    /// The functions that it calls, by name (`brdf::schlick`), if it is a function with `@test`.
    pub fn calls(&self) -> impl Iterator<Item = &str> {
        let test = if let Kind::Wgsl(test) = &self.kind { Some(test) } else { None };
        test.into_iter().flat_map(|test| test.calls())
    }

    /// The entry points that it dispatches, in order, if it is an assertion of a `[[compute]]`. Records name the last
    /// one.
    pub fn dispatches(&self) -> impl Iterator<Item = &str> {
        let passes = if let Kind::Compute(assertion) = &self.kind { Some(assertion) } else { None };
        passes.into_iter().flat_map(|passes| passes.entries())
    }

    /// The entry points of its draws, if it is a frame.
    pub fn draws(&self) -> impl Iterator<Item = String> {
        let frame = if let Kind::Frame(frame) = &self.kind { Some(frame) } else { None };
        frame.into_iter().flat_map(|frame| frame.entries())
    }

    /// Returns `true` if its name contains this, or the name of a function that it calls, or of its golden.
    #[must_use]
    pub fn is_about(&self, words: &str) -> bool {
        let has = |name: &str| name.contains(words);
        has(&self.name)
            || match &self.kind {
                Kind::Wgsl(test) => test.calls().any(has),
                Kind::Function(assertion) => has(&assertion.function),
                Kind::Frame(_) => false, // its golden's name is its own
                Kind::Compute(assertion) => assertion.entries().any(has),
            }
    }

    /// Returns `true` if a run shows the values that it compares. A test in WGSL compares in the shader, a frame compares
    /// images.
    #[must_use]
    pub fn shows_values(&self) -> bool {
        !matches!(self.kind, Kind::Wgsl(_) | Kind::Frame(_))
    }

    /// Returns `true` if it draws a frame, which needs a driver.
    #[must_use]
    pub fn is_frame(&self) -> bool {
        matches!(self.kind, Kind::Frame(_))
    }
}

/// A test that can't be read, or a module or file that can't.
#[derive(Clone, Debug)]
pub struct Broken {
    /// Its name: that of a test, a module or a file.
    pub name: String,
    /// The error, with its place.
    pub wrong: Wrong,
    /// `true` for a file that was probably meant to declare tests, but has none that can be read. That is an error in
    /// any package; a module, in contrast, may depend on other packages to be complete.
    pub is_file: bool,
}

impl Suite {
    /// Finds the tests of a folder of shaders, or of one file.
    ///
    /// # Errors
    /// If the folder can't be read, or has no module.
    pub fn open(folder: &Path) -> Result<Self, FindError> {
        Self::of(Package::open(folder).map_err(FindError::Package)?)
    }

    /// Finds the tests of a package.
    ///
    /// # Errors
    /// If it can't be read, or has no module.
    pub fn of(package: Package) -> Result<Self, FindError> {
        find::find(package)
    }
}
