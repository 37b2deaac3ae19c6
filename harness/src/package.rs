//! A set of WGSL or WESL modules, read at run time: editing a shader never rebuilds Rust.
//!
//! A package is one of these: a folder of `.wgsl` and `.wesl` files, a single file, or text in memory. Modules import
//! from each other (`import package::math::PI;`) and from other packages, on which their package depends. The linker
//! copies the declarations that a test needs into one WGSL text. The linker changes little, such as names, and records
//! each change. So each position in the linked text has a line and a column in an author's file.
//! [`Package::is_valid`] also validates modules that no test needs.

pub(crate) mod accepted;
pub(crate) mod asserts;
mod brackets;
mod cargo;
mod compilers;
mod conditions;
mod depth;
mod directives;
mod discard;
mod error;
mod feature;
mod fingerprint;
pub(crate) mod function_item;
pub(crate) mod functions;
mod imports;
pub(crate) mod inputs;
pub(crate) mod inside;
mod lets;
mod lexer;
mod library;
mod limits;
mod link;
mod linked;
mod linker;
mod manifest;
mod overlay;
mod parse;
mod plain;
mod portable;
pub(crate) mod scan;
mod scope;
mod splice;
pub(crate) mod stage;
mod syntax;
pub(crate) mod test_items;
mod values;
pub(crate) mod workspace;

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub(crate) use compilers::Compilers;
pub(crate) use discard::Discards;
pub use error::PackageError;
pub use feature::Feature;
pub(crate) use feature::Features;
pub(crate) use lets::{LetStatement, let_statements};
pub(crate) use lexer::texts;
pub(crate) use library::LinkedModule;
pub(crate) use limits::{Limit, Limits};
#[cfg(test)]
pub(crate) use linked::KERNEL_WORDS;
pub(crate) use linked::{KERNEL_PREFIX, Linked, Unmet, as_naga_takes, unknown_to_naga};
pub(crate) use manifest::Declared;
pub(crate) use plain::plain;
pub(crate) use portable::Portable;
pub(crate) use splice::DISCARDED;

use cargo::Found;
use library::ModulePath;
use overlay::Overlay;

use crate::diagnostic::{FileRead, nearest, shown};

/// File extensions of modules, in the order in which Karat tries them.
const EXTENSIONS: [&str; 2] = ["wgsl", "wesl"];

/// The name of the package from which Bevy's shaders import the values of shader definitions.
const CONSTANTS: &str = "constants";

/// A set of WGSL modules.
///
/// ```
/// use karat::Package;
///
/// static SHADERS: Package = karat::package!("examples/shaders"); // relative to Cargo.toml
/// let inline = Package::from_source("inline", "fn double(x: f32) -> f32 { return 2.0 * x; }");
/// assert_eq!(inline.functions().unwrap()[0].name, "double");
/// # let _ = &SHADERS;
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Package {
    origin: Origin,
    dependencies: Vec<(String, Package)>,
    features: Vec<(String, Feature)>,
    /// The names of modules, each with the additional features that are on when Karat validates the module.
    module_features: Vec<(String, Vec<String>)>,
    /// `true` after a call of `require_tint`. `karat.toml` can also require Tint's verdict.
    requires_tint: bool,
    /// Paths of files, each with the text that Karat reads instead of the file.
    unsaved: Vec<(PathBuf, Arc<str>)>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum Origin {
    Folder {
        base: Cow<'static, str>,
        path: Cow<'static, str>,
    },
    File {
        path: PathBuf,
        name: String,
    },
    Memory {
        name: String,
        modules: Vec<(String, String)>,
    },
    /// A crate that Karat hasn't looked up yet.
    Crate {
        base: Cow<'static, str>,
        name: Cow<'static, str>,
        root: Option<Cow<'static, str>>,
    },
    Found(Found),
}

/// Declares a [`Package`]: a folder, or the shaders of another crate. The folder is relative to the manifest of
/// the crate that calls the macro.
///
/// ```no_run
/// use karat::Package;
///
/// static OURS: Package = karat::package!("shaders");
/// // A crate that the project builds, at the version that it builds.
/// static PBR: Package = karat::package!(crate = "bevy_pbr");
/// // Any crate at an exact version: cargo fetches it, and compiles nothing of it.
/// static FIXED: Package = karat::package!(crate = "bevy_pbr@0.20.1");
/// // A crate whose modules are in another folder than Karat would choose.
/// static OTHER: Package = karat::package!(crate = "vello_shaders@0.11.0", root = "shader");
/// ```
#[macro_export]
macro_rules! package {
    (crate = $name:expr) => {
        $crate::Package::from_crate(env!("CARGO_MANIFEST_DIR"), $name)
    };
    (crate = $name:expr, root = $root:expr) => {
        $crate::Package::from_crate_in(env!("CARGO_MANIFEST_DIR"), $name, $root)
    };
    ($folder:expr) => {
        $crate::Package::relative(env!("CARGO_MANIFEST_DIR"), $folder)
    };
}

impl Package {
    /// A package from a folder relative to `base`. [`package!`](crate::package!) passes the manifest's folder as
    /// `base`.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// // The same package as `karat::package!("shaders")`.
    /// static SHADERS: Package = Package::relative(env!("CARGO_MANIFEST_DIR"), "examples/shaders");
    /// assert_eq!(SHADERS.name(), "shaders");
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub const fn relative(base: &'static str, folder: &'static str) -> Self {
        Self::of_origin(Origin::Folder { base: Cow::Borrowed(base), path: Cow::Borrowed(folder) })
    }

    /// A package with the shaders of a crate. `name` is a crate that the project in the folder `base` builds
    /// (`bevy_pbr`), or any crate at an exact version (`bevy_pbr@0.20.1`). Cargo fetches an exact version without
    /// compiling it. [`package!`](crate::package!) passes the manifest's folder as `base`.
    ///
    /// Modules are the files below the folder that the crate's metadata declares (`root` of
    /// `package.metadata.karat`, of `package.metadata.wgsl-analyzer` or of `wesl.toml`). Without such metadata,
    /// modules are the files below `src`, or else below the innermost folder that has all of the crate's shaders.
    /// Modules can import from other crates of the same dependency graph by the crates' names.
    ///
    /// Karat searches for the crate at the first use of the package.
    ///
    /// ```no_run
    /// use karat::Package;
    ///
    /// // The same package as `karat::package!(crate = "bevy_pbr@0.20.1")`.
    /// static PBR: Package = Package::from_crate(env!("CARGO_MANIFEST_DIR"), "bevy_pbr@0.20.1");
    /// println!("{:?}", PBR.modules());
    /// ```
    #[must_use]
    pub const fn from_crate(base: &'static str, name: &'static str) -> Self {
        let (base, name) = (Cow::Borrowed(base), Cow::Borrowed(name));
        Self::of_origin(Origin::Crate { base, name, root: None })
    }

    /// Like [`from_crate`](Self::from_crate), but `root` names the folder of the modules, relative to the crate's
    /// folder.
    ///
    /// ```no_run
    /// use karat::Package;
    ///
    /// static VELLO: Package =
    ///     Package::from_crate_in(env!("CARGO_MANIFEST_DIR"), "vello_shaders@0.11.0", "shader");
    /// println!("{:?}", VELLO.modules());
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub const fn from_crate_in(base: &'static str, name: &'static str, root: &'static str) -> Self {
        let (base, name) = (Cow::Borrowed(base), Cow::Borrowed(name));
        Self::of_origin(Origin::Crate { base, name, root: Some(Cow::Borrowed(root)) })
    }

    const fn of_origin(origin: Origin) -> Self {
        Self {
            origin,
            dependencies: Vec::new(),
            features: Vec::new(),
            module_features: Vec::new(),
            requires_tint: false,
            unsaved: Vec::new(),
        }
    }

    /// Like [`from_crate`](Self::from_crate), but searches for the crate immediately.
    ///
    /// ```no_run
    /// use karat::Package;
    ///
    /// let pbr = Package::open_crate(".".as_ref(), "bevy_pbr@0.20.1", None)?;
    /// println!("{:?}", pbr.modules()?);
    /// # Ok::<(), karat::package::PackageError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the crate doesn't exist, or if it has no shaders.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn open_crate(base: &Path, name: &str, root: Option<&str>) -> Result<Self, PackageError> {
        Ok(Self::of_origin(Origin::Found(cargo::find(base, name, root)?)))
    }

    /// A copy of this package that reads the modules of the imported crate `krate` from the folder `root`. The path
    /// `root` is relative to the folder of `krate`. Use this method if Karat doesn't find the modules of `krate`.
    ///
    /// ```no_run
    /// use karat::Package;
    ///
    /// let viewer = Package::open_crate(".".as_ref(), "wgpu-3dgs-viewer@0.8.0", None)?;
    /// let viewer = viewer.with_root_of("wgpu_3dgs_core", "src/shader")?;
    /// # Ok::<(), karat::package::PackageError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the package isn't a crate, if its modules can't import from a crate `krate`, or if that
    /// crate has no folder `root`.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn with_root_of(&self, krate: &str, root: &str) -> Result<Self, PackageError> {
        let package = self.found()?.into_owned();
        let Origin::Found(found) = &package.origin else {
            let reason = "the package is a folder: write the crate's `root` under `[dependencies]` in its `karat.toml`";
            return Err(PackageError::Crate { name: krate.to_owned(), reason: reason.to_owned() });
        };
        let origin = Origin::Found(found.with_root(krate, root)?);
        Ok(Self { origin, ..package })
    }

    /// A package from a folder of modules, or from one file, which is the only module.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// let package = Package::open("examples/shaders")?;
    /// assert!(!package.modules()?.is_empty());
    /// # Ok::<(), karat::package::PackageError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the folder or file doesn't exist.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, PackageError> {
        let path = path.as_ref();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let origin = if path.is_file() {
            Origin::File { path: path.to_owned(), name }
        } else {
            let path = Cow::Owned(path.to_string_lossy().into_owned());
            Origin::Folder { base: Cow::Borrowed(""), path }
        };
        let package = Self::of_origin(origin);
        package.check_exists()?;
        Ok(package)
    }

    /// A package with one module in memory. A function `f` has the path `f`, without the module's name.
    ///
    /// ```
    /// use karat::prelude::*;
    ///
    /// let package = Package::from_source("m", "fn f(x: f32) -> f32 { return 0.5 * x; }");
    /// package.function("f").over(0.0..=1.0).agrees_with(|x: f64| 0.5 * x, Ulp(0.0));
    /// ```
    pub fn from_source(name: &str, text: impl Into<String>) -> Self {
        Self::from_modules(name, [(String::new(), text.into())])
    }

    /// A package with modules in memory, each with its path (`math`, `noise::value`) and its text.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// let package = Package::from_modules("m", [("math", "fn f() {}"), ("noise::value", "fn g() {}")]);
    /// assert_eq!(package.modules().unwrap(), ["math", "noise::value"]);
    /// ```
    pub fn from_modules<N: Into<String>, T: Into<String>>(
        name: &str,
        modules: impl IntoIterator<Item = (N, T)>,
    ) -> Self {
        let modules = modules.into_iter().map(|(n, t)| (n.into(), t.into())).collect();
        Self::of_origin(Origin::Memory { name: name.to_owned(), modules })
    }

    /// Lets modules import from `package` under `name`: `import noise::value::perlin;`.
    ///
    /// ```
    /// use karat::prelude::*;
    ///
    /// let tested = Package::from_modules("m", [("hash", "fn mix(x: u32) -> u32 { return x ^ (x >> 7u); }")]);
    /// let glue = "import tested::hash::mix;
    ///             fn twice(x: u32) -> u32 { return mix(mix(x)); }";
    /// let glue = Package::from_source("glue", glue).depends_on("tested", &tested);
    /// let mix = |x: u32| x ^ (x >> 7);
    /// glue.function("twice").over(Integers(0..=u32::MAX)).agrees_with(move |x: u32| mix(mix(x)), Abs(0.0));
    /// ```
    #[must_use]
    pub fn depends_on(&self, name: &str, package: &Self) -> Self {
        let mut own = self.clone();
        own.dependencies.push((name.to_owned(), package.clone()));
        own
    }

    /// Sets a feature for conditions such as `@if(name)` or `#ifdef name`: on, off, or a number. A feature with a
    /// number is on and has a value. Features that aren't set are off. The feature is also set in the packages from
    /// which this package imports. If no condition in any of these packages uses the name, the check fails with an
    /// error.
    ///
    /// ```
    /// use karat::prelude::*;
    ///
    /// let text = "@if(half) fn f(x: f32) -> f32 { return 0.5 * x; }
    ///             @else fn f(x: f32) -> f32 { return x; }";
    /// let package = Package::from_source("m", text).feature("half", true);
    /// package.function("f").over(0.0..=1.0).agrees_with(|x: f64| 0.5 * x, Ulp(0.0));
    /// ```
    #[must_use]
    pub fn feature(&self, name: &str, value: impl Into<Feature>) -> Self {
        let mut own = self.clone();
        own.features.push((name.to_owned(), value.into()));
        own
    }

    /// Turns on these features when Karat validates `module`. Use this method if the module isn't valid without the
    /// features. Only [`is_valid`](Self::is_valid) uses these features. When a test links a function, only the
    /// package's own features are on.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// let text = "@if(shadows) fn f() -> f32 { return 1.0; }
    ///             fn g() -> f32 { return f(); } // there is no `f` without shadows";
    /// let package = Package::from_modules("m", [("light", text)]);
    /// assert!(package.try_is_valid().is_err());
    /// assert!(package.module_features("light", &["shadows"]).try_is_valid().is_ok());
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn module_features(&self, module: &str, features: &[&str]) -> Self {
        let mut own = self.clone();
        let features = features.iter().map(|feature| (*feature).to_owned()).collect();
        own.module_features.push((module.to_owned(), features));
        own
    }

    /// Checks that the package has the modules that the author passed to [`module_features`](Self::module_features).
    pub(crate) fn knows_its_validated(&self, modules: &[String]) -> Result<(), PackageError> {
        let unknown = self.module_features.iter().find(|(module, _)| !modules.contains(module));
        let Some((module, _)) = unknown else { return Ok(()) };
        let near = nearest(module, modules.iter().map(String::as_str));
        Err(PackageError::UnknownModule {
            module: module.clone(),
            package: self.name(),
            nearest: near.map(str::to_owned),
        })
    }

    pub(crate) fn for_validating(&self, module: &str) -> Self {
        let mut package = self.clone();
        for (_, features) in self.module_features.iter().filter(|(name, _)| name == module) {
            let on = Feature::Flag(true);
            let on = features.iter().map(|feature| (feature.clone(), on));
            package.features.extend(on);
        }
        package
    }

    /// The name of the folder, file or crate, or the name that the author gave to text in memory.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// assert_eq!(Package::from_source("m", "fn f() {}").name(), "m");
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn name(&self) -> String {
        match &self.origin {
            Origin::Folder { .. } => {
                let root = self.root();
                let root = root.canonicalize().unwrap_or(root);
                root.file_name().unwrap_or_default().to_string_lossy().into_owned()
            }
            Origin::File { name, .. } | Origin::Memory { name, .. } => name.clone(),
            Origin::Found(found) => found.library().to_owned(),
            Origin::Crate { name, .. } => {
                name.split('@').next().unwrap_or_default().replace('-', "_")
            }
        }
    }

    /// The folder or file. The path is empty for text in memory, and for a crate that Karat doesn't find.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// let package = karat::package!("examples/shaders");
    /// assert!(package.root().ends_with("examples/shaders"));
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn root(&self) -> PathBuf {
        match &self.origin {
            Origin::Folder { base, path } if path == "." && !base.is_empty() => {
                PathBuf::from(base.as_ref())
            }
            Origin::Folder { base, path } => Path::new(base.as_ref()).join(path.as_ref()),
            Origin::File { path, .. } => path.clone(),
            Origin::Found(found) => found.root().to_owned(),
            Origin::Memory { .. } => PathBuf::new(),
            Origin::Crate { .. } => self.found().map(|package| package.root()).unwrap_or_default(),
        }
    }

    /// This package. If this package is a crate that Karat hasn't looked up yet, Karat now asks cargo for the crate's
    /// folder.
    fn found(&self) -> Result<Cow<'_, Self>, PackageError> {
        let Origin::Crate { base, name, root } = &self.origin else {
            return Ok(Cow::Borrowed(self));
        };
        let origin = Origin::Found(cargo::find(Path::new(&**base), name, root.as_deref())?);
        Ok(Cow::Owned(Self { origin, ..self.clone() }))
    }

    pub(crate) fn is_crate(&self) -> bool {
        matches!(self.origin, Origin::Crate { .. } | Origin::Found(_))
    }

    fn check_exists(&self) -> Result<(), PackageError> {
        let there = match &self.origin {
            Origin::Folder { .. } | Origin::Found(_) => self.root().is_dir(),
            Origin::File { path, .. } => path.is_file(),
            Origin::Memory { .. } => true,
            Origin::Crate { .. } => return self.found().map(drop),
        };
        let root = shown(&self.root());
        match &self.origin {
            _ if there => Ok(()),
            // Only a folder from `package!` is relative to a manifest.
            Origin::Folder { base, .. } if base.is_empty() => Err(PackageError::NoFolder(root)),
            _ => Err(PackageError::Missing(root)),
        }
    }

    /// The paths of all modules, sorted.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// let package = Package::from_modules("m", [("tone", "fn f() {}"), ("noise::value", "fn g() {}")]);
    /// assert_eq!(package.modules()?, ["noise::value", "tone"]);
    /// # Ok::<(), karat::package::PackageError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the folder is missing or unreadable, or if it has no modules.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn modules(&self) -> Result<Vec<String>, PackageError> {
        self.check_exists()?;
        let mut modules = match &self.origin {
            Origin::Crate { .. } => return self.found()?.modules(),
            Origin::Folder { .. } | Origin::Found(_) => {
                let found = scan::Contents::of(&self.root())?.modules;
                if found.is_empty() {
                    return Err(PackageError::Empty(shown(&self.root())));
                }
                found
            }
            Origin::File { .. } => vec![String::new()],
            Origin::Memory { modules, .. } => {
                modules.iter().map(|(name, _)| name.clone()).collect()
            }
        };
        modules.sort();
        if let Some(pair) = modules.windows(2).find(|pair| pair[0] == pair[1]) {
            return Err(self.twice("modules", &pair[0]));
        }
        Ok(modules)
    }

    /// The files beside the modules, sorted: tests in TOML, tables, images. For a folder, the list leaves out hidden
    /// files and Cargo's build output. Karat enters each folder once, even if symbolic links lead to it again. For a
    /// package of one file, the list has the other files in that file's folder. For text in memory, the list is empty.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// let folder = tempfile::tempdir()?;
    /// std::fs::write(folder.path().join("brdf.wgsl"), "fn f() {}")?;
    /// std::fs::write(folder.path().join("brdf.test.toml"), "")?;
    /// let beside = Package::open(folder.path())?.files_beside()?;
    /// assert_eq!(beside, [folder.path().join("brdf.test.toml")]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if a folder can't be read, or if a `.wgsl` or `.wesl` file can't be a module.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn files_beside(&self) -> Result<Vec<PathBuf>, PackageError> {
        let root = self.root();
        let mut files = match &self.origin {
            Origin::Crate { .. } => return self.found()?.files_beside(),
            Origin::Folder { .. } | Origin::Found(_) => scan::Contents::of(&root)?.others,
            Origin::File { .. } => {
                let folder = root.parent().filter(|folder| !folder.as_os_str().is_empty());
                let folder = folder.unwrap_or(Path::new("."));
                let unreadable = |cause| PackageError::Unreadable { file: shown(folder), cause };
                let all = std::fs::read_dir(folder).map_err(unreadable)?;
                let all = all.map(|entry| Ok(entry.map_err(unreadable)?.path()));
                let mut all = all.collect::<Result<Vec<_>, PackageError>>()?;
                all.retain(|file| *file != root && !file.is_dir());
                all
            }
            Origin::Memory { .. } => Vec::new(),
        };
        files.sort();
        Ok(files)
    }

    fn twice(&self, what: &str, name: &str) -> PackageError {
        PackageError::Twice { package: self.name(), what: format!("{what} named `{name}`") }
    }

    /// Checks that no two modules in memory, and no two dependencies, have the same name. For a folder,
    /// [`modules`](Self::modules) checks the modules' names.
    fn expect_distinct(&self) -> Result<(), PackageError> {
        let mut names = BTreeSet::new();
        if let Origin::Memory { modules, .. } = &self.origin
            && let Some((name, _)) = modules.iter().find(|(name, _)| !names.insert(name.as_str()))
        {
            return Err(self.twice("modules", name));
        }
        let mut names = BTreeSet::new();
        match self.dependencies.iter().find(|(name, _)| !names.insert(name.as_str())) {
            Some((name, _)) => Err(self.twice("dependencies", name)),
            None => Ok(()),
        }
    }

    /// The file of a module; `None` if Karat can't read it.
    pub(crate) fn file_of(&self, module: &str) -> Option<FileRead> {
        let (overlay, manifest) = (Overlay::of(self).ok()?, manifest::Manifest::of(self).ok()?);
        self.load(&ModulePath::root(module).components, &overlay, &manifest).ok()?.read()
    }
}
