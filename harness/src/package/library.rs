//! The modules of a package and of what it depends on, read when first needed.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use blake3::Hash;

use super::conditions::Features;
use super::overlay::Overlay;
use super::syntax::Module;
use super::{Origin, Package, PackageError};
use crate::diagnostic::{FileRead, SourceFile, nearest, shown};

/// File extensions of modules, in the order in which they are looked for.
pub(super) const EXTENSIONS: [&str; 2] = ["wgsl", "wesl"];

/// Parsed modules that a process keeps: more than any package has, and a bound for long-lived ones.
const MOST_KEPT: usize = 10_000;

/// A module: the package that has it, by its index in the library, and its path in there.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct ModulePath {
    pub(super) package: usize,
    pub(super) components: Vec<String>,
}

impl ModulePath {
    /// A module of the package that is linked, from its author's path; `""` is the only module.
    pub(super) fn root(module: &str) -> Self {
        let components = module.split("::").filter(|part| !part.is_empty());
        Self { package: 0, components: components.map(str::to_owned).collect() }
    }
}

/// The packages of one link and their modules, read when first needed. The package that is linked
/// is the first; the others are reached from it.
pub(super) struct Library<'a> {
    packages: RefCell<Vec<(&'a Package, String)>>,
    overlay: Overlay,
    modules: RefCell<BTreeMap<ModulePath, Arc<Module>>>,
}

impl<'a> Library<'a> {
    pub(super) fn open(package: &'a Package) -> Result<Self, PackageError> {
        package.expect_distinct()?;
        let overlay = Overlay::of(package)?;
        let packages = RefCell::new(vec![(package, String::new())]);
        Ok(Self { packages, overlay, modules: RefCell::default() })
    }

    /// The text of a module.
    pub(super) fn read(&self, path: &ModulePath) -> Result<Arc<SourceFile>, PackageError> {
        let package = self.package(path.package);
        package.load(&path.components, &self.overlay).map(Arc::new)
    }

    /// A module without what its conditions leave out.
    pub(super) fn module(&self, path: &ModulePath) -> Result<Arc<Module>, PackageError> {
        if let Some(module) = self.modules.borrow().get(path) {
            return Ok(Arc::clone(module));
        }
        let module = parsed(&self.read(path)?, self.features(path.package))?;
        self.modules.borrow_mut().insert(path.clone(), Arc::clone(&module));
        Ok(module)
    }

    /// Whether a module exists, readable or not.
    pub(super) fn has(&self, path: &ModulePath) -> bool {
        self.package(path.package).find(&path.components).is_some()
    }

    /// Whether a path is a folder of modules.
    pub(super) fn has_below(&self, path: &ModulePath) -> bool {
        let prefix = format!("{}::", path.components.join("::"));
        let modules = self.package(path.package).modules().unwrap_or_default();
        modules.iter().any(|module| module.starts_with(&prefix))
    }

    /// What was read, with `root`, which may be no module that can be parsed.
    pub(super) fn sources(&self, root: &ModulePath, file: &SourceFile) -> Sources {
        let hash = |file: &SourceFile| blake3::hash(file.text.as_bytes());
        let modules = self.modules.borrow();
        let mut texts: BTreeMap<ModulePath, Hash> =
            modules.iter().map(|(path, module)| (path.clone(), hash(&module.file))).collect();
        texts.insert(root.clone(), hash(file));
        let packages = self.packages.borrow();
        let packages = packages.iter().map(|(package, _)| (*package).clone()).collect();
        let parsed = modules.values().map(|module| &*module.file);
        let files = parsed.chain([file]).filter_map(SourceFile::read);
        let files: BTreeSet<FileRead> = files.collect();
        Sources { packages, texts, files: files.into_iter().collect() }
    }

    fn package(&self, index: usize) -> &'a Package {
        self.packages.borrow()[index].0
    }

    pub(super) fn name(&self, package: usize) -> String {
        self.package(package).name()
    }

    /// The name of a package as the one that is linked reaches it: `noise`, `textures/noise`.
    pub(super) fn route(&self, package: usize) -> String {
        self.packages.borrow()[package].1.clone()
    }

    /// `package::math`, or `noise::value` of another package.
    pub(super) fn shown(&self, path: &ModulePath) -> String {
        let route = self.route(path.package);
        let first = if route.is_empty() { "package".to_owned() } else { route };
        let parts: Vec<_> = [first].into_iter().chain(path.components.iter().cloned()).collect();
        parts.join("::")
    }

    /// The package that `package` knows as `name`.
    pub(super) fn dependency(&self, package: usize, name: &str) -> Result<usize, PackageError> {
        let of = self.package(package);
        let Some((_, found)) = of.dependencies.iter().find(|(known, _)| known == name) else {
            let known = of.dependencies.iter().map(|(name, _)| name.as_ref());
            return Err(PackageError::UnknownPackage {
                name: name.to_owned(),
                package: of.name(),
                nearest: nearest(name, known).map(str::to_owned),
            });
        };
        found.expect_distinct()?;
        let route = self.route(package);
        let mut packages = self.packages.borrow_mut();
        // One package that is reached in two ways is one: its types are the same types.
        let same =
            |known: &Package| known.origin == found.origin && known.features == found.features;
        if let Some(index) = packages.iter().position(|(known, _)| same(known)) {
            return Ok(index);
        }
        let name = if route.is_empty() { name.to_owned() } else { format!("{route}/{name}") };
        packages.push((found, name));
        Ok(packages.len() - 1)
    }

    /// The features that hold in a package: its own, then those of the one that is linked.
    fn features(&self, package: usize) -> Features {
        let all = self.package(package).features.iter().chain(&self.package(0).features);
        all.map(|(name, enabled)| (name.to_string(), *enabled)).collect()
    }
}

/// The texts that a link was made of.
#[derive(Clone, Debug)]
pub(crate) struct Sources {
    packages: Vec<Package>,
    texts: BTreeMap<ModulePath, Hash>,
    /// Those of them that are files.
    files: Vec<FileRead>,
}

impl Sources {
    /// The files among them.
    pub(crate) fn files(&self) -> &[FileRead] {
        &self.files
    }

    /// Whether all of them are as they were.
    pub(crate) fn are_current(&self) -> Result<bool, PackageError> {
        let overlay = Overlay::of(&self.packages[0])?;
        Ok(self.texts.iter().all(|(path, hash)| {
            let file = self.packages[path.package].load(&path.components, &overlay);
            file.is_ok_and(|file| blake3::hash(file.text.as_bytes()) == *hash)
        }))
    }
}

/// A parsed module; once in a process for the same file and features.
fn parsed(file: &Arc<SourceFile>, features: Features) -> Result<Arc<Module>, PackageError> {
    type Known = HashMap<(Hash, Features), Arc<Module>>;
    static KNOWN: LazyLock<Mutex<Known>> = LazyLock::new(Mutex::default);
    let mut hasher = blake3::Hasher::new();
    hasher.update(file.name.as_bytes()).update(&[0]).update(file.text.as_bytes());
    let key = (hasher.finalize(), features);
    let lock = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(module) = lock().get(&key) {
        return Ok(Arc::clone(module));
    }
    let module = Arc::new(Module::parse(file, &key.1)?);
    let mut known = lock();
    if known.len() >= MOST_KEPT {
        known.clear();
    }
    known.insert(key, Arc::clone(&module));
    Ok(module)
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

    pub(super) fn load(
        &self,
        components: &[String],
        overlay: &Overlay,
    ) -> Result<SourceFile, PackageError> {
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
