//! Tests of WGSL without Rust.
//!
//! A package can declare tests in two forms. Both forms use Karat's checks, with the same verdicts, records, simplest
//! failures and replays:
//!
//! - **In WGSL**: a function with `@test` in any module. The function calls expectations such as `expect_near` from the
//!   package `karat`, or the expectations of the WESL community's package `wgsl_test`. See [`WgslTest`].
//! - **In TOML**: a file `brdf.test.toml` beside `brdf.wgsl`. The file asserts properties of the module's functions.
//!   See [`declared`].
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
    /// The package with the shaders.
    pub package: Package,
    /// The package's folder.
    pub folder: PathBuf,
    /// The package's tests, ordered by module and line.
    pub tests: Vec<Test>,
    /// The modules, files and tests that can't run, each with its error. Each counts as a failure.
    pub broken: Vec<Broken>,
    /// The linked text of each function that declared tests call, by the function's path.
    fingerprints: OnceLock<BTreeMap<String, String>>,
}

/// A test of a package.
#[derive(Debug)]
pub struct Test {
    /// The unique name: `brdf_test::grazing`, or `brdf::schlick in_range` for a declared test.
    pub name: String,
    /// The test's position in the file that its author wrote.
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
    /// The paths of the functions that a function with `@test` calls, such as `brdf::schlick`. Empty for other tests.
    pub fn calls(&self) -> impl Iterator<Item = &str> {
        let test = if let Kind::Wgsl(test) = &self.kind { Some(test) } else { None };
        test.into_iter().flat_map(|test| test.calls())
    }

    /// The entry points that an assertion of a `[[compute]]` dispatches, in order. Empty for other tests. The test's
    /// records have the name of the last entry point.
    pub fn dispatches(&self) -> impl Iterator<Item = &str> {
        let passes = if let Kind::Compute(assertion) = &self.kind { Some(assertion) } else { None };
        passes.into_iter().flat_map(|passes| passes.entries())
    }

    /// The entry points of a frame's draws. Empty if the test isn't a frame.
    pub fn draws(&self) -> impl Iterator<Item = String> {
        let frame = if let Kind::Frame(frame) = &self.kind { Some(frame) } else { None };
        frame.into_iter().flat_map(|frame| frame.entries())
    }

    /// Checks if `words` occur in the name of the test, of a function that the test calls, or of an entry point that
    /// the test dispatches.
    #[must_use]
    pub fn is_about(&self, words: &str) -> bool {
        let has = |name: &str| name.contains(words);
        has(&self.name)
            || match &self.kind {
                Kind::Wgsl(test) => test.calls().any(has),
                Kind::Function(assertion) => has(&assertion.function),
                Kind::Frame(_) => false, // the frame and its golden have the same name
                Kind::Compute(assertion) => assertion.entries().any(has),
            }
    }

    /// Checks if a run shows the values that the test compares. A test in WGSL compares values in the shader, and a
    /// frame compares images, so neither shows values.
    #[must_use]
    pub fn shows_values(&self) -> bool {
        !matches!(self.kind, Kind::Wgsl(_) | Kind::Frame(_))
    }

    /// Checks if the test draws a frame, which needs a driver.
    #[must_use]
    pub fn is_frame(&self) -> bool {
        matches!(self.kind, Kind::Frame(_))
    }
}

/// A test, module or file that Karat can't read.
#[derive(Clone, Debug)]
pub struct Broken {
    /// The name of the test, module or file.
    pub name: String,
    /// The error, with its position.
    pub wrong: Wrong,
    /// `true` for an error in a test file, or in a file that its author probably meant as a test file. Such an error is
    /// a failure in any package. For an error in a module, this is `false`, because some modules are valid only
    /// together with modules of other packages.
    pub is_file: bool,
}

impl Suite {
    /// Finds the tests in a folder of shaders, or in one file.
    ///
    /// # Errors
    /// Returns an error if the folder can't be read, or has no module.
    pub fn open(folder: &Path) -> Result<Self, FindError> {
        Self::of(Package::open(folder).map_err(FindError::Package)?)
    }

    /// Finds the tests of a package.
    ///
    /// # Errors
    /// Returns an error if the package can't be read, or has no module.
    pub fn of(package: Package) -> Result<Self, FindError> {
        find::find(package)
    }
}
