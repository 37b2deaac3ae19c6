//! The functions that Karat's other crates, such as `karat-inspect`, need to check shaders without tests.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::accepted::{AcceptedMutants, Hazards, KnownRows};
use super::feature::Feature;
use super::library::{self, ModulePath};
use super::manifest::{self, Manifest};
use super::overlay::Overlay;
use super::{Package, PackageError, directives, texts};

/// The result type of a [`Package`] method that moved to another crate. The compiler's note names the crate.
#[derive(Debug)]
pub struct Moved;

impl Package {
    /// This method moved to the crate `karat-inspect`.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[deprecated(
        note = "add karat-inspect to [dev-dependencies], and write `karat_inspect::hazards(&package)`"
    )]
    #[must_use]
    pub fn hazards(&self) -> Moved {
        Moved
    }

    /// This method moved to the crate `karat-inspect`.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[deprecated(
        note = "add karat-inspect to [dev-dependencies], and write `karat_inspect::matrix(&package)`"
    )]
    #[must_use]
    pub fn matrix(&self) -> Moved {
        Moved
    }
}

/// The package with the features for validating one module.
#[must_use]
pub fn for_validating(package: &Package, module: &str) -> Package {
    package.for_validating(module)
}

/// Checks if the package comes from a crate.
#[must_use]
pub fn is_crate(package: &Package) -> bool {
    package.is_crate()
}

/// The declarations of `karat.toml` for the search for hazards.
///
/// # Errors
/// Returns an error if `karat.toml` can't be read.
pub fn declared_hazards(package: &Package) -> Result<Hazards, PackageError> {
    Ok(Manifest::of(package)?.hazards())
}

/// The mutants that `karat.toml` accepts.
///
/// # Errors
/// Returns an error if `karat.toml` can't be read.
pub fn accepted_mutants(package: &Package) -> Result<Vec<AcceptedMutants>, PackageError> {
    Ok(Manifest::of(package)?.mutants())
}

/// The rows of the translation matrix that `karat.toml` declares as known failures.
///
/// # Errors
/// Returns an error if `karat.toml` can't be read.
pub fn known_rows(package: &Package) -> Result<Vec<KnownRows>, PackageError> {
    Ok(Manifest::of(package)?.known_rows())
}

/// The author's file of a module; `None` for text in memory.
#[must_use]
pub fn file_of(package: &Package, module: &str) -> Option<PathBuf> {
    package.file_at(&ModulePath::root(module).components)
}

/// The text that replaces a file's contents, if an editor passed such a text to [`Package::unsaved`].
#[must_use]
pub fn unsaved_of<'p>(package: &'p Package, file: &Path) -> Option<&'p str> {
    package.unsaved_text(file)
}

/// The identifiers and keywords in a module's own file, and the features that its conditions use and that aren't set.
#[must_use]
pub fn words_of(package: &Package, module: &str) -> Option<(Vec<String>, Vec<String>)> {
    let (overlay, manifest) = (Overlay::of(package).ok()?, Manifest::of(package).ok()?);
    let file = package.load(&ModulePath::root(module).components, &overlay, &manifest).ok()?;
    let words = texts(&file.text).into_iter().map(str::to_owned).collect();
    let is_set = |name: &String| package.features.iter().any(|(known, _)| known == name);
    let open = directives::asked(&file.text).into_iter().filter(|name| !is_set(name));
    Some((words, open.collect()))
}

/// For each feature that needs a value but isn't set, some values to try. If a condition compares the feature (`#if
/// A >= 3`), the first value is the value in the condition.
#[must_use]
pub fn values_of(package: &Package) -> BTreeMap<String, Vec<Feature>> {
    library::values_of(package)
}

/// The position of an override's value in the folder's `karat.toml`, as a suffix for a message: `
/// (karat.toml:3:1)`. The text is empty if the file doesn't declare the override.
#[must_use]
pub fn place_of_override(package: &Package, name: &str) -> String {
    manifest::place_of("overrides", package, name)
}

/// The position of an input's declaration in the folder's `karat.toml`, as a suffix for a message: `
/// (karat.toml:3:1)`. The text is empty if the file doesn't declare the input.
#[must_use]
pub fn place_of_input(package: &Package, name: &str) -> String {
    manifest::place_of("inputs", package, name)
}
