//! The modules of a package and of what it depends on, read when first needed.

use std::borrow::Cow;
use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use wesl::{ModulePath, ResolveError, Resolver};
use wgsl_parse::lexer::Lexer;
use wgsl_parse::syntax::PathOrigin;

use super::overlay::Overlay;
use super::{Origin, Package, PackageError};
use crate::diagnostic::{SourceFile, Span, nearest, shown};

/// File extensions of modules, in the order in which they are looked for.
pub(super) const EXTENSIONS: [&str; 2] = ["wgsl", "wesl"];

/// Reads and keeps the modules of a package tree for one link.
pub(super) struct Library<'a> {
    package: &'a Package,
    overlay: Overlay,
    files: RefCell<BTreeMap<String, Arc<SourceFile>>>,
}

impl<'a> Library<'a> {
    pub(super) fn open(package: &'a Package) -> Result<Self, PackageError> {
        let overlay = Overlay::of(package)?;
        Ok(Self { package, overlay, files: RefCell::default() })
    }

    /// The text of a module.
    pub(super) fn read(&self, path: &ModulePath) -> Result<Arc<SourceFile>, PackageError> {
        let key = path.to_string();
        if let Some(file) = self.files.borrow().get(&key) {
            return Ok(Arc::clone(file));
        }
        let file = Arc::new(self.owner(path)?.load(&path.components, &self.overlay)?);
        self.files.borrow_mut().insert(key, Arc::clone(&file));
        Ok(file)
    }

    /// Whether a module exists, readable or not.
    pub(super) fn has(&self, path: &ModulePath) -> bool {
        self.owner(path).is_ok_and(|package| package.find(&path.components).is_some())
    }

    /// Where a name stands first in the modules read so far.
    pub(super) fn find_name(&self, name: &str) -> Option<Span> {
        self.files.borrow().values().find_map(|file| {
            let mut tokens = Lexer::new(&file.text).map_while(Result::ok);
            let (start, _, end) =
                tokens.find(|(start, _, end)| &file.text[*start..*end] == name)?;
            Some(Span { file: Arc::clone(file), range: start..end })
        })
    }

    /// The package that a path leads into.
    fn owner(&self, path: &ModulePath) -> Result<&'a Package, PackageError> {
        let PathOrigin::Package(names) = &path.origin else { return Ok(self.package) };
        // The import resolution names a dependency's dependency `outer/inner`.
        names.split('/').try_fold(self.package, |package, name| {
            let dependencies = || package.dependencies.iter().map(|(name, _)| name.as_ref());
            package.dependencies.iter().find(|(known, _)| known == name).map(|(_, p)| p).ok_or_else(
                || PackageError::UnknownPackage {
                    name: name.to_owned(),
                    package: package.name().to_owned(),
                    nearest: nearest(name, dependencies()).map(str::to_owned),
                },
            )
        })
    }
}

impl Resolver for Library<'_> {
    fn resolve_source<'b>(&'b self, path: &ModulePath) -> Result<Cow<'b, str>, ResolveError> {
        match self.read(path) {
            Ok(file) => Ok(file.text.clone().into()),
            Err(error) => Err(ResolveError::ModuleNotFound(path.clone(), error.to_string())),
        }
    }

    fn display_name(&self, path: &ModulePath) -> Option<String> {
        self.read(path).ok().map(|file| file.name.clone())
    }
}

/// Where the text of a module is.
pub(super) enum Place<'a> {
    File(PathBuf),
    Memory(&'a str, &'a str),
}

impl Package {
    /// Finds a module by its path inside the package.
    pub(super) fn find(&self, components: &[String]) -> Option<Place<'_>> {
        match &self.origin {
            Origin::Folder { .. } => {
                let mut stem = self.root();
                stem.extend(components);
                EXTENSIONS
                    .iter()
                    .map(|extension| PathBuf::from(format!("{}.{extension}", stem.display())))
                    .find(|file| !components.is_empty() && file.is_file())
                    .map(Place::File)
            }
            Origin::File { .. } => components.is_empty().then(|| Place::File(self.root())),
            Origin::Memory { modules, .. } => modules
                .iter()
                .find(|(name, _)| *name == components.join("::"))
                .map(|(name, text)| Place::Memory(name, text)),
        }
    }

    fn load(&self, components: &[String], overlay: &Overlay) -> Result<SourceFile, PackageError> {
        match self.find(components) {
            Some(Place::Memory(name, text)) => {
                let name = if name.is_empty() { self.name() } else { name.to_owned() };
                Ok(SourceFile { name: format!("<{name}>"), text: text.to_owned() })
            }
            Some(Place::File(path)) => read_utf8(&overlay.file(path)),
            None => {
                self.check_exists()?;
                let module = components.join("::");
                let known = self.modules()?;
                Err(PackageError::UnknownModule {
                    nearest: nearest(&module, known.iter().map(String::as_str)).map(str::to_owned),
                    package: self.name().to_owned(),
                    module,
                })
            }
        }
    }
}

fn read_utf8(path: &Path) -> Result<SourceFile, PackageError> {
    let file = shown(path);
    let bytes = std::fs::read(path)
        .map_err(|source| PackageError::Unreadable { file: file.clone(), source })?;
    match String::from_utf8(bytes) {
        Ok(text) => Ok(SourceFile { name: file, text }),
        Err(error) => {
            let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
            let line = valid.iter().filter(|byte| **byte == b'\n').count() + 1;
            Err(PackageError::NotUtf8 { file, line })
        }
    }
}
