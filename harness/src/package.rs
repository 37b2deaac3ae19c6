//! A set of WGSL or WESL modules, read at run time: editing a shader never rebuilds Rust.
//!
//! A package is a folder (one module a file), one file, or text in memory. Modules import each
//! other (`import package::math::PI;`) and the packages that theirs depends on. Linking gives one
//! WGSL text that holds the closure of what a test needs, with a source map exact to line and
//! column.

mod imports;
mod library;
mod link;
mod overlay;
mod source_map;

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub(crate) use link::Linked;
pub(crate) use overlay::folder as overlay;
use wgsl_parse::syntax::{GlobalDeclaration, PathOrigin};

use crate::diagnostic::{Diagnostic, SourceFile, Span, shown};

/// A set of WGSL modules.
///
/// ```
/// use karat::Package;
///
/// static SHADERS: Package = karat::package!("examples/shaders"); // relative to Cargo.toml
/// let inline = Package::from_source("inline", "fn double(x: f32) -> f32 { return 2.0 * x; }");
/// assert_eq!(inline.functions().unwrap()[0].path, "double");
/// # let _ = &SHADERS;
/// ```
#[derive(Clone, Debug)]
pub struct Package {
    origin: Origin,
    dependencies: Vec<(Cow<'static, str>, Package)>,
    features: Vec<(Cow<'static, str>, bool)>,
}

#[derive(Clone, Debug)]
enum Origin {
    Folder { base: Cow<'static, str>, path: Cow<'static, str> },
    File { path: PathBuf, name: String },
    Memory { name: String, modules: Vec<(String, String)> },
}

/// A function of a package, as found in its file.
#[derive(Clone, Debug)]
pub struct FunctionItem {
    /// `module::name`, or `name` in a package of one module.
    pub path: String,
    /// Where its name stands.
    pub span: Span,
    /// Whether it is a shader entry point, which can't be called.
    pub entry_point: bool,
}

/// Declares a [`Package`] for a folder, relative to the manifest of the crate that calls it.
///
/// Usable in a `static`.
#[macro_export]
macro_rules! package {
    ($folder:expr) => {
        $crate::Package::relative(env!("CARGO_MANIFEST_DIR"), $folder)
    };
}

/// What can be wrong with a package.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PackageError {
    /// The folder or file isn't there.
    #[error(
        "the shader folder `{0}` doesn't exist; `karat::package!` takes a path relative to Cargo.toml"
    )]
    Missing(String),
    /// The folder has no module.
    #[error("the shader folder `{0}` has no .wgsl or .wesl file")]
    Empty(String),
    /// A module can't be read.
    #[error("can't read `{file}`: {source}")]
    Unreadable {
        /// The file.
        file: String,
        /// Why.
        source: std::io::Error,
    },
    /// A module isn't UTF-8.
    #[error("`{file}` isn't UTF-8 text: line {line} has an invalid byte; save the file as UTF-8")]
    NotUtf8 {
        /// The file.
        file: String,
        /// First line that can't be decoded, from 1.
        line: usize,
    },
    /// An import names a package that isn't a dependency.
    #[error(
        "package `{package}` has no dependency `{name}`{}; declare it with `depends_on`",
        did_you_mean(nearest)
    )]
    UnknownPackage {
        /// What was asked for.
        name: String,
        /// Where.
        package: String,
        /// The closest name there is.
        nearest: Option<String>,
    },
    /// A path names a module that the package hasn't.
    #[error("package `{package}` has no module `{module}`{}", did_you_mean(nearest))]
    UnknownModule {
        /// What was asked for.
        module: String,
        /// Where.
        package: String,
        /// The closest name there is.
        nearest: Option<String>,
    },
    /// A path names a function that the package hasn't.
    #[error(
        "package `{package}` has no function `{path}` among its {count}{}",
        did_you_mean(nearest)
    )]
    UnknownFunction {
        /// What was asked for.
        path: String,
        /// Where.
        package: String,
        /// The closest name there is.
        nearest: Option<String>,
        /// How many functions it has.
        count: usize,
    },
    /// The folder that `KARAT_OVERLAY` names can't stand in for modules of the package.
    #[error("the overlay `{folder}` (KARAT_OVERLAY) {reason}")]
    Overlay {
        /// The folder.
        folder: String,
        /// Why.
        reason: String,
    },
    /// A syntax error, a failed import or an import cycle, shown in the author's file.
    #[error("{0}")]
    Shader(Box<Diagnostic>),
}

fn did_you_mean(nearest: &Option<String>) -> String {
    nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?"))
}

impl Package {
    /// A folder relative to `base`. [`package!`](crate::package) fills in the manifest's folder.
    #[must_use]
    pub const fn relative(base: &'static str, folder: &'static str) -> Self {
        let origin = Origin::Folder { base: Cow::Borrowed(base), path: Cow::Borrowed(folder) };
        Self { origin, dependencies: Vec::new(), features: Vec::new() }
    }

    /// A folder of modules, or one file as a package of one module.
    ///
    /// # Errors
    /// If there is no such folder or file.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, PackageError> {
        let path = path.as_ref();
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let origin = if path.is_file() {
            Origin::File { path: path.to_owned(), name }
        } else {
            let path = Cow::Owned(path.to_string_lossy().into_owned());
            Origin::Folder { base: Cow::Borrowed(""), path }
        };
        let package = Self { origin, dependencies: Vec::new(), features: Vec::new() };
        package.check_exists()?;
        Ok(package)
    }

    /// One module in memory. Its functions are named without a module.
    pub fn from_source(name: &str, text: impl Into<String>) -> Self {
        Self::from_modules(name, [(String::new(), text.into())])
    }

    /// Modules in memory, each with its path (`math`, `noise::value`) and its text.
    pub fn from_modules<N: Into<String>, T: Into<String>>(
        name: &str,
        modules: impl IntoIterator<Item = (N, T)>,
    ) -> Self {
        let modules = modules.into_iter().map(|(n, t)| (n.into(), t.into())).collect();
        let origin = Origin::Memory { name: name.to_owned(), modules };
        Self { origin, dependencies: Vec::new(), features: Vec::new() }
    }

    /// Lets modules import from `package` under `name`: `import noise::value::perlin;`.
    #[must_use]
    pub fn depends_on(mut self, name: &'static str, package: &Self) -> Self {
        self.dependencies.push((Cow::Borrowed(name), package.clone()));
        self
    }

    /// Sets a feature of WESL's conditional translation: `@if(name)`. Features not set are off.
    #[must_use]
    pub fn feature(mut self, name: &'static str, enabled: bool) -> Self {
        self.features.push((Cow::Borrowed(name), enabled));
        self
    }

    /// The name of the folder or file, or the one given to text in memory.
    #[must_use]
    pub fn name(&self) -> String {
        match &self.origin {
            Origin::Folder { .. } => {
                let root = self.root();
                let root = root.canonicalize().unwrap_or(root);
                root.file_name().unwrap_or_default().to_string_lossy().into_owned()
            }
            Origin::File { name, .. } | Origin::Memory { name, .. } => name.clone(),
        }
    }

    /// The folder or file; empty for text in memory.
    #[must_use]
    pub fn root(&self) -> PathBuf {
        match &self.origin {
            Origin::Folder { base, path } if path == "." => PathBuf::from(base.as_ref()),
            Origin::Folder { base, path } => Path::new(base.as_ref()).join(path.as_ref()),
            Origin::File { path, .. } => path.clone(),
            Origin::Memory { .. } => PathBuf::new(),
        }
    }

    fn check_exists(&self) -> Result<(), PackageError> {
        let there = match &self.origin {
            Origin::Folder { .. } => self.root().is_dir(),
            Origin::File { path, .. } => path.is_file(),
            Origin::Memory { .. } => true,
        };
        if there { Ok(()) } else { Err(PackageError::Missing(shown(&self.root()))) }
    }

    /// The paths of all modules, sorted.
    ///
    /// # Errors
    /// If the folder is missing, unreadable or has no module.
    pub fn modules(&self) -> Result<Vec<String>, PackageError> {
        self.check_exists()?;
        let mut modules = match &self.origin {
            Origin::Folder { .. } => {
                let mut found = Vec::new();
                scan(&self.root(), "", &mut found)?;
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
        modules.dedup();
        Ok(modules)
    }

    /// All functions of all modules, in the order of modules and lines.
    ///
    /// # Errors
    /// If a module can't be read or parsed.
    pub fn functions(&self) -> Result<Vec<FunctionItem>, PackageError> {
        let modules = self.modules()?;
        let functions = modules.iter().map(|module| self.functions_in(module));
        Ok(functions.collect::<Result<Vec<_>, _>>()?.concat())
    }

    /// The functions of one module (`""` in a package of one module), in the order of lines.
    ///
    /// # Errors
    /// If the module can't be read or parsed.
    pub fn functions_in(&self, module: &str) -> Result<Vec<FunctionItem>, PackageError> {
        use wgsl_parse::syntax::Attribute;
        let components = module.split("::").filter(|part| !part.is_empty()).map(str::to_owned);
        let path = wesl::ModulePath::new(PathOrigin::Absolute, components.collect());
        let file = library::Library::open(self)?.read(&path)?;
        let unit =
            wgsl_parse::parse_str(&file.text).map_err(|error| syntax_error(&error, &file))?;
        let mut functions = Vec::new();
        for declaration in &unit.global_declarations {
            let GlobalDeclaration::Function(function) = declaration.node() else { continue };
            let name = function.ident.name().clone();
            let range = name_range(&file, declaration.span().range(), &name);
            let entry_point = function.attributes.iter().any(|attribute| {
                matches!(
                    attribute.node(),
                    Attribute::Compute | Attribute::Vertex | Attribute::Fragment
                )
            });
            let path = if module.is_empty() { name } else { format!("{module}::{name}") };
            let span = Span { file: Arc::clone(&file), range };
            functions.push(FunctionItem { path, span, entry_point });
        }
        Ok(functions)
    }
}

/// Where `fn name` stands inside a declaration.
fn name_range(
    file: &SourceFile,
    whole: std::ops::Range<usize>,
    name: &str,
) -> std::ops::Range<usize> {
    let text = file.text.get(whole.clone()).unwrap_or_default();
    let after = text.find("fn").map_or(0, |at| at + 2);
    match text[after..].find(name) {
        Some(at) => whole.start + after + at..whole.start + after + at + name.len(),
        None => whole,
    }
}

fn scan(folder: &Path, prefix: &str, found: &mut Vec<String>) -> Result<(), PackageError> {
    let unreadable = |source| PackageError::Unreadable { file: shown(folder), source };
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let Some(stem) = path.file_stem().and_then(|stem| stem.to_str()) else { continue };
        let name = if prefix.is_empty() { stem.to_owned() } else { format!("{prefix}::{stem}") };
        if path.is_dir() {
            // Build output and hidden folders hold no modules of the author.
            if !stem.starts_with('.') && stem != "target" {
                scan(&path, &name, found)?;
            }
        } else if library::EXTENSIONS
            .iter()
            .any(|known| path.extension().is_some_and(|e| e == *known))
        {
            found.push(name);
        }
    }
    Ok(())
}

/// Most alternatives that are worth reading in a syntax error.
const ALTERNATIVES: usize = 5;

/// A parse error at its place.
fn syntax_error(error: &wgsl_parse::Error, file: &Arc<SourceFile>) -> PackageError {
    let range = error.span.range();
    let span = Span { file: Arc::clone(file), range };
    let message = error.error.to_string();
    // Where an expression may stand, the parser lists every token that begins one.
    let message = match message.split_once(", expected") {
        Some((found, expected)) if expected.matches(',').count() >= ALTERNATIVES => found,
        _ => &message,
    };
    let message = format!("syntax error: {message}");
    PackageError::Shader(Box::new(Diagnostic::new(message).at(span, "")))
}
