//! The parts of a package that programs need which look into functions without a test.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::accepted::{Hazards, KnownRows};
use super::feature::Feature;
use super::library::{self, ModulePath};
use super::manifest::{self, Manifest};
use super::overlay::Overlay;
use super::{Package, PackageError, directives, texts};

/// The result of a method of [`Package`] that moved to another crate. The compiler's note says where it is.
#[derive(Debug)]
pub struct Moved;

impl Package {
    /// It is a function of another crate.
    ///
    /// *Unstable*: for programs around tests.
    #[deprecated(
        note = "add karat-inspect to [dev-dependencies], and write `karat_inspect::hazards(&package)`"
    )]
    #[must_use]
    pub fn hazards(&self) -> Moved {
        Moved
    }

    /// It is a function of another crate.
    ///
    /// *Unstable*: for programs around tests.
    #[deprecated(
        note = "add karat-inspect to [dev-dependencies], and write `karat_inspect::matrix(&package)`"
    )]
    #[must_use]
    pub fn matrix(&self) -> Moved {
        Moved
    }
}

/// The package with the features with which a module is validated.
#[must_use]
pub fn for_validating(package: &Package, module: &str) -> Package {
    package.for_validating(module)
}

/// A fingerprint of each of some functions: `brdf::schlick`. Of one that can't be linked there is none.
///
/// ```
/// use karat::Package;
/// use karat::unstable::package::fingerprints;
///
/// let of = |text| fingerprints(&Package::from_source("m", text), &["half".to_owned()].into());
/// let half = of("fn half(x: f32) -> f32 { return 0.5 * x; }");
/// assert_eq!(half, of("fn half(x: f32) -> f32 { return 0.5 * x; } fn other() {}"));
/// ```
#[must_use]
pub fn fingerprints(package: &Package, functions: &BTreeSet<String>) -> BTreeMap<String, String> {
    package.fingerprints(functions)
}

/// The folders and files that a package is made of, with those of its dependencies. Files of crates don't change, and text
/// in memory has none.
#[must_use]
pub fn places(package: &Package) -> Vec<PathBuf> {
    package.places()
}

/// True if a program prints the modules (`preprocess` in `karat.toml`): it may read any file.
#[must_use]
pub fn is_printed(package: &Package) -> bool {
    package.is_printed()
}

/// The package with the text of a file that isn't saved yet, as an editor has it. It is read in place of the file, here and
/// in packages that this one depends on. A file that is in none of them changes nothing.
///
/// ```
/// use karat::prelude::*;
/// use karat::unstable::package::unsaved;
///
/// let package = Package::open("examples/shaders")?;
/// let file = package.root().join("srgb.wgsl");
/// let edited = unsaved(&package, &file, "fn half(x: f32) -> f32 { return 0.5 * x; }");
/// edited.function("srgb::half").over(0.0..=1.0).stays_within(0.0..=0.5);
/// # Ok::<(), karat::package::PackageError>(())
/// ```
#[must_use]
pub fn unsaved(package: &Package, file: &Path, text: &str) -> Package {
    package.unsaved(file, text)
}

/// A crate's package where a crate that it uses ships its shaders in a folder that no manifest names.
///
/// # Errors
/// If the package isn't a crate's, or no crate of that name ships shaders to it from that folder.
pub fn with_root_of(package: &Package, krate: &str, root: &str) -> Result<Package, PackageError> {
    package.with_root_of(krate, root)
}

/// The files of a package that are no modules: its tests in TOML, tables, images.
///
/// # Errors
/// If a folder can't be read, or holds what can't be a module.
pub fn files_beside(package: &Package) -> Result<Vec<PathBuf>, PackageError> {
    package.files_beside()
}

/// Whether it is a crate's.
#[must_use]
pub fn is_crate(package: &Package) -> bool {
    package.is_crate()
}

/// What `karat.toml` declares of hazards.
///
/// # Errors
/// If it can't be read.
pub fn declared_hazards(package: &Package) -> Result<Hazards, PackageError> {
    Ok(Manifest::of(package)?.hazards())
}

/// What `karat.toml` declares of the matrix of translations.
///
/// # Errors
/// If it can't be read.
pub fn known_rows(package: &Package) -> Result<Vec<KnownRows>, PackageError> {
    Ok(Manifest::of(package)?.known_rows())
}

/// The words of a module's own file, and the features that its conditions ask about and that aren't set.
#[must_use]
pub fn words_of(package: &Package, module: &str) -> Option<(Vec<String>, Vec<String>)> {
    let (overlay, manifest) = (Overlay::of(package).ok()?, Manifest::of(package).ok()?);
    let file = package.load(&ModulePath::root(module).components, &overlay, &manifest).ok()?;
    let words = texts(&file.text).into_iter().map(str::to_owned).collect();
    let is_set = |name: &String| package.features.iter().any(|(known, _)| known == name);
    let open = directives::asked(&file.text).into_iter().filter(|name| !is_set(name));
    Some((words, open.collect()))
}

/// Values for the features that the conditions of a package compare with one, and that have none, the first of them the one
/// that stands there.
#[must_use]
pub fn values_of(package: &Package) -> BTreeMap<String, Vec<Feature>> {
    library::values_of(package)
}

/// The same of an override's value.
#[must_use]
pub fn place_of_override(package: &Package, name: &str) -> String {
    manifest::place_of("overrides", package, name)
}

/// The place of an input's declaration in the folder's `karat.toml`, behind a message: ` (karat.toml:3:1)`. It is empty if
/// nothing declares it.
#[must_use]
pub fn place_of_input(package: &Package, name: &str) -> String {
    manifest::place_of("inputs", package, name)
}
