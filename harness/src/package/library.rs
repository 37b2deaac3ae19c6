//! Reads the modules of a package, and of the packages on which it depends, at their first use.

mod composed;
mod features;
mod included;

use std::cell::{OnceCell, RefCell};
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;

use blake3::Hash;

use super::asserts;
use super::directives::{self, Include};
use super::feature::{Feature, Features};
use super::manifest::Manifest;
use super::overlay::{Overlay, read_utf8};
use super::parse::parse;
use super::syntax::Module;
use super::workspace::{self, Kind};
use super::{CONSTANTS, EXTENSIONS};
use super::{Origin, Package, PackageError};
use crate::diagnostic::{FileRead, Mend, SourceFile, nearest, text_hash};
use crate::expectation;

/// A module: the index of its package in the library, and its path in that package.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct ModulePath {
    pub(super) package: usize,
    pub(super) components: Vec<String>,
}

impl ModulePath {
    /// The module with this path in the linked package. The path `""` means the package's only module.
    pub(super) fn root(module: &str) -> Self {
        let components = module.split("::").filter(|part| !part.is_empty());
        Self { package: 0, components: components.map(str::to_owned).collect() }
    }
}

/// The packages and modules for linking one package. Karat reads a module at its first use. The package with the
/// index 0 is the linked package. The linked package imports from all others, directly or through other packages.
pub(super) struct Library {
    packages: RefCell<Vec<(Rc<Package>, String)>>,
    /// The `karat.toml` of each package from which Karat has used a module, by the package's index.
    manifests: RefCell<BTreeMap<usize, Rc<Manifest>>>,
    overlay: Overlay,
    files: RefCell<BTreeMap<ModulePath, Arc<SourceFile>>>,
    modules: RefCell<BTreeMap<ModulePath, Arc<Module>>>,
    /// The paths that Karat has looked up. The value is `true` if the module exists.
    there: RefCell<BTreeMap<ModulePath, bool>>,
    /// The folders that Karat has looked up. The value is `true` if the folder exists.
    folders: RefCell<BTreeMap<PathBuf, bool>>,
    /// The names that the linked module defines.
    defined: RefCell<Features>,
    /// The names that the linked module defines only if nothing else defines them.
    guards: RefCell<Features>,
    /// Modules by the paths that they declare for themselves.
    composed: OnceCell<BTreeMap<String, Vec<ModulePath>>>,
}

impl Library {
    pub(super) fn open(package: &Package) -> Result<Self, PackageError> {
        package.expect_distinct()?;
        let package = package.found()?.into_owned();
        let package = Manifest::of(&package)?.depended(package)?;
        let overlay = Overlay::of(&package)?;
        let packages = RefCell::new(vec![(Rc::new(package), String::new())]);
        let library = Self {
            packages,
            overlay,
            manifests: RefCell::default(),
            files: RefCell::default(),
            modules: RefCell::default(),
            there: RefCell::default(),
            folders: RefCell::default(),
            defined: RefCell::default(),
            guards: RefCell::default(),
            composed: OnceCell::new(),
        };
        library.manifest(0)?;
        library.expect_features()?;
        Ok(library)
    }

    /// The module to which a path in the author's code refers. The path names a module of the linked package, or a
    /// module of a dependency: `noise::value` begins with the name under which modules import the dependency `noise`.
    pub(super) fn root(&self, module: &str) -> ModulePath {
        let own = ModulePath::root(module);
        let Some((name, rest)) = own.components.split_first() else { return own };
        let of = self.package(0);
        if self.has(&own) || !of.dependencies.iter().any(|(known, _)| known == name) {
            return own;
        }
        let of_dependency = |package| ModulePath { package, components: rest.to_vec() };
        let found = self.dependency(0, name).map(of_dependency);
        found.ok().filter(|found| self.has(found)).unwrap_or(own)
    }

    pub(super) fn read(&self, path: &ModulePath) -> Result<Arc<SourceFile>, PackageError> {
        if let Some(known) = self.files.borrow().get(path) {
            return Ok(Arc::clone(known));
        }
        let (package, manifest) = (self.package(path.package), self.manifest(path.package)?);
        let file = Arc::new(package.load(&path.components, &self.overlay, &manifest)?);
        self.files.borrow_mut().insert(path.clone(), Arc::clone(&file));
        Ok(file)
    }

    /// The linked package, and the packages that Karat has reached through imports so far. `None` if one of these
    /// imported packages isn't text in memory.
    pub(super) fn in_memory(&self) -> Option<Vec<(Package, String)>> {
        let packages = self.packages.borrow();
        let is_memory = |package: &Package| matches!(package.origin, Origin::Memory { .. });
        let all = packages.iter().skip(1).all(|(package, _)| is_memory(package));
        all.then(|| packages.iter().map(|(p, route)| (Package::clone(p), route.clone())).collect())
    }

    /// Gives the imported packages the same indices as in an earlier library of the same linked package.
    pub(super) fn number_as(&self, packages: &[(Package, String)]) {
        let others = packages.iter().skip(1);
        let others = others.map(|(package, route)| (Rc::new(package.clone()), route.clone()));
        self.packages.borrow_mut().extend(others);
    }

    /// The `karat.toml` of a package. The library reads this file once.
    fn manifest(&self, package: usize) -> Result<Rc<Manifest>, PackageError> {
        if let Some(known) = self.manifests.borrow().get(&package) {
            return Ok(Rc::clone(known));
        }
        let manifest = Rc::new(Manifest::of(&self.package(package))?);
        self.manifests.borrow_mut().insert(package, Rc::clone(&manifest));
        Ok(manifest)
    }

    /// Reads the file of the module to link, and records the names in the file's `#define`s, because these
    /// definitions apply to all modules.
    pub(super) fn begin(&self, root: &ModulePath) -> Result<Arc<SourceFile>, PackageError> {
        let file = self.read(root)?;
        *self.defined.borrow_mut() = directives::defined(&file.text);
        *self.guards.borrow_mut() = directives::guards(&file.text);
        Ok(file)
    }

    /// The names of the modules that the author's program concatenates with this module (`[join]` in `karat.toml`).
    pub(super) fn joined(&self, path: &ModulePath) -> Result<Vec<String>, PackageError> {
        Ok(self.manifest(path.package)?.joined(&path.components.join("::")).to_vec())
    }

    pub(super) fn module(&self, path: &ModulePath) -> Result<Arc<Module>, PackageError> {
        if let Some(module) = self.modules.borrow().get(path) {
            return Ok(Arc::clone(module));
        }
        let file = self.read(path)?;
        // In a file with a guard, the guard's condition is evaluated before the definition of the name.
        let own = directives::guards(&file.text);
        let mut features = self.guarded(path.package);
        if !own.is_empty() {
            let elsewhere = self.features(path.package);
            features.retain(|name, _| !own.contains_key(name) || elsewhere.contains_key(name));
        }
        let mut module = parsed(&file, features).map_err(|error| self.with_values(path, error))?;
        let joined = self.joined(path)?;
        if !joined.is_empty() {
            let joined = joined.into_iter().map(|name| (Include::Joined(name), 0..0));
            Arc::make_mut(&mut module).includes.extend(joined);
        }
        self.modules.borrow_mut().insert(path.clone(), Arc::clone(&module));
        Ok(module)
    }

    pub(super) fn parsed(&self) -> BTreeMap<ModulePath, Arc<Module>> {
        self.modules.borrow().clone()
    }

    pub(super) fn has(&self, path: &ModulePath) -> bool {
        if let Some(known) = self.there.borrow().get(path) {
            return *known;
        }
        let package = self.package(path.package);
        let has = self.has_folder(&package, path) && package.find(&path.components).is_some();
        self.there.borrow_mut().insert(path.clone(), has);
        has
    }

    /// Checks if the folder of a module exists. Karat makes this quick check before it searches for the file. Most
    /// paths that Karat tries are paths of declarations, which have no folder.
    fn has_folder(&self, package: &Package, path: &ModulePath) -> bool {
        let Some((_, above)) = path.components.split_last() else { return true };
        if above.is_empty() || matches!(package.origin, Origin::Memory { .. }) {
            return true;
        }
        let mut folder = package.root();
        folder.extend(above);
        let known = self.folders.borrow().get(&folder).copied();
        known.unwrap_or_else(|| {
            let is_there = folder.is_dir();
            self.folders.borrow_mut().insert(folder, is_there);
            is_there
        })
    }

    /// Checks if a package is a crate, and has a module of this name in its root folder.
    pub(super) fn is_own(&self, package: usize, name: &str) -> bool {
        let of = self.package(package);
        of.is_crate() && of.find(&[name.to_owned()]).is_some()
    }

    /// Checks if a path is a folder of modules.
    pub(super) fn has_below(&self, path: &ModulePath) -> bool {
        let prefix = format!("{}::", path.components.join("::"));
        let modules = self.package(path.package).modules().unwrap_or_default();
        modules.iter().any(|module| module.starts_with(&prefix))
    }

    pub(super) fn sources(&self, root: &ModulePath, file: &SourceFile) -> Sources {
        let hash = hash_of;
        let modules = self.modules.borrow();
        let mut texts: BTreeMap<ModulePath, Hash> =
            modules.iter().map(|(path, module)| (path.clone(), hash(&module.file))).collect();
        texts.insert(root.clone(), hash(file));
        let packages = self.packages.borrow();
        let packages = packages.iter().map(|(package, _)| Package::clone(package));
        let parsed = modules.values().map(|module| &*module.file);
        let files = parsed.chain([file]).filter_map(SourceFile::read);
        let mut files: BTreeSet<FileRead> = files.collect();
        let manifest = |at: usize| self.manifest(at).unwrap_or_default();
        let packages: Vec<_> =
            packages.enumerate().map(|(at, package)| ((*manifest(at)).clone(), package)).collect();
        let source = |path: &ModulePath| match modules.get(path) {
            Some(module) if path != root => &*module.file,
            _ => file,
        };
        let linked = texts.keys().map(|path| {
            let file = source(path);
            LinkedModule {
                name: self.shown(path),
                file: file.read().map(|read| read.file),
                hash: text_hash(file.written().as_bytes()),
            }
        });
        let linked = linked.collect();
        files.extend(packages.iter().filter_map(|(manifest, _)| manifest.read.clone()));
        // A program's output is in no file, but the program's input is.
        let given = texts.keys().filter_map(|path| {
            let (manifest, package) = &packages[path.package];
            match package.find(&path.components)? {
                Place::File(file) if manifest.expands() => {
                    read_utf8(&self.overlay.file(file)).ok()?.read()
                }
                _ => None,
            }
        });
        files.extend(given);
        Sources { packages, texts, linked, files: files.into_iter().collect() }
    }

    fn package(&self, index: usize) -> Rc<Package> {
        Rc::clone(&self.packages.borrow()[index].0)
    }

    pub(super) fn name(&self, package: usize) -> String {
        self.package(package).name()
    }

    /// The names of the dependencies that lead from the linked package to another package: `noise`, `textures/noise`.
    pub(super) fn route(&self, package: usize) -> String {
        self.packages.borrow()[package].1.clone()
    }

    /// The path of a module in messages: `package::math` in the linked package, or `noise::value` in a dependency.
    pub(super) fn shown(&self, path: &ModulePath) -> String {
        let route = self.route(path.package);
        let first = if route.is_empty() { "package".to_owned() } else { route };
        let parts: Vec<_> = [first].into_iter().chain(path.components.iter().cloned()).collect();
        parts.join("::")
    }

    /// The package that `package` imports as `name`.
    pub(super) fn dependency(&self, package: usize, name: &str) -> Result<usize, PackageError> {
        let of = self.package(package);
        let constants = || (name == CONSTANTS).then(|| self.constants());
        let Some(found) = of.dependency(name)?.or_else(constants) else {
            let own = of.dependencies.iter().map(|(name, _)| name.as_str());
            let crates = match &of.origin {
                Origin::Found(found) => found.known().collect(),
                _ => Vec::new(),
            };
            return Err(PackageError::UnknownPackage {
                name: name.to_owned(),
                package: of.name(),
                nearest: nearest(name, own.chain(crates)).map(str::to_owned),
            });
        };
        let found = Manifest::of(&found)?.depended(found)?;
        found.expect_distinct()?;
        let route = self.route(package);
        let mut packages = self.packages.borrow_mut();
        // A package that is reached in two ways is one package, and its types are equal.
        let same =
            |known: &Package| known.origin == found.origin && known.features == found.features;
        if let Some(index) = packages.iter().position(|(known, _)| same(known)) {
            return Ok(index);
        }
        let name = if route.is_empty() { name.to_owned() } else { format!("{route}/{name}") };
        packages.push((Rc::new(found), name));
        Ok(packages.len() - 1)
    }

    fn constants(&self) -> Package {
        let features = self.guarded(0);
        let values = features.iter().filter_map(|(name, value)| match value {
            Feature::Number(value) => Some(format!("const {name} = {value};\n")),
            Feature::Flag(_) => None,
        });
        Package::from_modules(CONSTANTS, [("", values.collect::<String>())])
    }

    /// The indices of the linked package and of all packages from which it can import, directly or through others.
    fn all(&self) -> Vec<usize> {
        let (mut all, mut at) = (vec![0], 0);
        while let Some(package) = all.get(at).copied() {
            let of = self.package(package);
            let own = of.dependencies.iter().map(|(name, _)| name.clone());
            let crates = match &of.origin {
                Origin::Found(found) => found.known().map(str::to_owned).collect(),
                _ => Vec::new(),
            };
            // A missing crate is an error at its import.
            let found = own.chain(crates).filter_map(|name| self.dependency(package, &name).ok());
            let new: BTreeSet<usize> = found.filter(|index| !all.contains(index)).collect();
            all.extend(new);
            at += 1;
        }
        all
    }

    /// The features for a package's conditions: the package's own features, the features of the linked package, and
    /// the linked module's `#define`s. For a name that is set several times, the last value counts.
    pub(super) fn features(&self, package: usize) -> Features {
        let (own, linked) = (self.package(package), self.package(0));
        // The first read of the file reported its errors.
        let declared =
            [package, 0].map(|of| self.manifest(of).unwrap_or_default().features.clone());
        let set = own.features.iter().chain(&linked.features);
        let set = set.map(|(name, value)| (name.clone(), *value));
        let defined = self.defined.borrow().clone();
        declared.into_iter().flatten().chain(set).chain(defined).collect()
    }

    /// Extends an error about a feature that has no value. The longer error also names the package's other features
    /// without a value, so that the user can set all of these features at once.
    fn with_values(&self, path: &ModulePath, error: PackageError) -> PackageError {
        let PackageError::Shader(diagnostic) = error else { return error };
        if !matches!(diagnostic.mend, Some(Mend::Feature(_))) {
            return PackageError::Shader(diagnostic);
        }
        let set = self.features(path.package);
        let mut open = values_of(&self.package(path.package));
        open.retain(|name, _| !set.contains_key(name));
        if open.len() < 2 {
            return PackageError::Shader(diagnostic);
        }
        let each = open.iter().map(|(name, all)| format!("{name} = {}", all[0]));
        let each = each.collect::<Vec<_>>().join(", ");
        let note = format!(
            "other features of the package have no value, too. To set all values, write into `karat.toml`: features = {{ {each} }}"
        );
        PackageError::Shader(Box::new(diagnostic.note(note)))
    }

    /// The package's [`features`](Self::features), and the linked module's guards: names that the module defines
    /// only if nothing else defines them.
    fn guarded(&self, package: usize) -> Features {
        let mut features = self.features(package);
        for (name, value) in &*self.guards.borrow() {
            features.entry(name.clone()).or_insert(*value);
        }
        features
    }
}

impl Package {
    /// The folders and files of this package and of all packages from which its modules can import. The list leaves out
    /// text in memory. The list also leaves out crates, because their files don't change.
    ///
    /// ```
    /// use karat::Package;
    ///
    /// let package = Package::open("examples/shaders")?;
    /// assert_eq!(package.places(), [package.root()]);
    /// # Ok::<(), karat::package::PackageError>(())
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn places(&self) -> Vec<PathBuf> {
        let Ok(library) = Library::open(self) else { return vec![self.root()] };
        let packages = library.all().into_iter().map(|index| library.package(index));
        let on_disk = |package: &Rc<Package>| {
            matches!(package.origin, Origin::Folder { .. } | Origin::File { .. })
        };
        packages.filter(on_disk).map(|package| package.root()).collect()
    }
}

#[derive(Clone, Debug)]
pub(crate) struct LinkedModule {
    /// The path of the module in messages: `package::math` in the linked package, or `noise::value` in a dependency.
    pub(crate) name: String,
    pub(crate) file: Option<PathBuf>,
    /// The hash of the module's text, from [`text_hash`].
    pub(crate) hash: String,
}

#[derive(Clone, Debug)]
pub(crate) struct Sources {
    packages: Vec<(Manifest, Package)>,
    texts: BTreeMap<ModulePath, Hash>,
    /// The modules from which the linker copied text, sorted by the paths that messages and records show.
    linked: Vec<LinkedModule>,
    /// The files that contain the modules' texts, or from which a program (`preprocess` in `karat.toml`) made the
    /// texts.
    files: Vec<FileRead>,
}

impl Sources {
    /// The features that are on in at least one package, as text: `SHADOWS`, `SAMPLES=4`.
    pub(crate) fn features(&self) -> Vec<String> {
        let all = self.packages.iter().flat_map(|(_, package)| &package.features);
        let written = all.filter_map(|(name, feature)| match feature {
            Feature::Flag(on) => on.then(|| name.clone()),
            Feature::Number(value) => Some(format!("{name}={value}")),
        });
        written.collect::<BTreeSet<_>>().into_iter().collect()
    }

    pub(crate) fn files(&self) -> &[FileRead] {
        &self.files
    }

    pub(crate) fn modules(&self) -> &[LinkedModule] {
        &self.linked
    }

    pub(crate) fn are_current(&self) -> Result<bool, PackageError> {
        let overlay = Overlay::of(&self.packages[0].1)?;
        for (manifest, package) in &self.packages {
            if Manifest::of(package)? != *manifest {
                return Ok(false);
            }
        }
        Ok(self.texts.iter().all(|(path, hash)| {
            let (manifest, package) = &self.packages[path.package];
            let file = package.load(&path.components, &overlay, manifest);
            file.is_ok_and(|file| hash_of(&file) == *hash)
        }))
    }
}

/// One hash of two texts of a file: the author's text with placeholders, and the text in which values replace the
/// placeholders. If only a placeholder changes, the second text stays the same, but positions in messages may change.
fn hash_of(file: &SourceFile) -> Hash {
    let mut hasher = blake3::Hasher::new();
    hasher.update(file.text.as_bytes());
    if !file.values.is_empty() {
        hasher.update(&[0]).update(file.written().as_bytes());
    }
    hasher.finalize()
}

/// The cache of parsed modules. The key has a hash of the module's name and text, and the features.
struct Modules;

impl Kind for Modules {
    type Key = (Hash, Features);
    type Value = Arc<Module>;
    // Any package has fewer modules than this.
    const MOST: usize = 10_000;
}

/// A parsed module. A process parses a file only once for each set of features.
fn parsed(file: &Arc<SourceFile>, features: Features) -> Result<Arc<Module>, PackageError> {
    let mut hasher = blake3::Hasher::new();
    hasher.update(file.name.as_bytes()).update(&[0]).update(hash_of(file).as_bytes());
    let key = (hasher.finalize(), features);
    if let Some(module) = workspace::get::<Modules>(&key) {
        return Ok(module);
    }
    let module = Arc::new(parse(file, &key.1)?);
    workspace::keep::<Modules>(key, Arc::clone(&module));
    Ok(module)
}

pub(super) enum Place<'a> {
    File(PathBuf),
    Memory(&'a str, &'a str),
}

impl Package {
    /// The package that this package imports under a name.
    fn dependency(&self, name: &str) -> Result<Option<Self>, PackageError> {
        if let Some((_, found)) = self.dependencies.iter().find(|(known, _)| known == name) {
            return Ok(Some(found.found()?.into_owned()));
        }
        if let Origin::Found(own) = &self.origin
            && let Some(found) = own.reach(name)
        {
            return Ok(Some(Self::of_origin(Origin::Found(found))));
        }
        let expectations = expectation::package(name);
        Ok(expectations.map(|package| Self::from_source(name, package.text.as_str())))
    }

    /// The modules that the author's program concatenates with a module (`[join]` in `karat.toml`). Returns no
    /// modules if `karat.toml` is unreadable, because an earlier read has reported this error.
    pub(crate) fn joined_with(&self, module: &str) -> Vec<String> {
        Manifest::of(self).map_or(Vec::new(), |all| all.joined(module).to_vec())
    }

    pub(crate) fn declaring(&self, name: &str, file: &str) -> (Vec<String>, Option<String>) {
        let (mut declaring, mut own) = (Vec::new(), None);
        let Ok(library) = Library::open(self) else { return (declaring, own) };
        for path in self.modules().unwrap_or_default() {
            let Ok(module) = library.module(&ModulePath::root(&path)) else { continue };
            if module.file.name == file {
                own = Some(path);
            } else if module.names().any(|known| known == name) {
                declaring.push(path);
            }
        }
        (declaring, own)
    }

    pub(super) fn file_at(&self, components: &[String]) -> Option<PathBuf> {
        match self.find(components)? {
            Place::File(path) => Some(path),
            Place::Memory(..) => None,
        }
    }

    pub(super) fn find(&self, components: &[String]) -> Option<Place<'_>> {
        match &self.origin {
            Origin::Crate { .. } => None,
            Origin::Folder { .. } | Origin::Found(_) => {
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

    /// The text of a module. `manifest` is the `karat.toml` of the module's package.
    pub(super) fn load(
        &self,
        components: &[String],
        overlay: &Overlay,
        manifest: &Manifest,
    ) -> Result<SourceFile, PackageError> {
        match self.find(components) {
            Some(Place::Memory(name, text)) => {
                let name = if name.is_empty() { self.name() } else { name.to_owned() };
                asserts::read(SourceFile::new(format!("<{name}>"), text))
            }
            Some(Place::File(path)) => {
                let path = overlay.file(path);
                manifest.expanded(&self.root(), &path, overlay.read(&path)?)
            }
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

impl Package {
    /// A module's text before Karat replaces placeholders (`[values]`): the text of the module's file, or the output
    /// of `preprocess`.
    pub(super) fn before_values(&self, module: &str) -> Result<String, PackageError> {
        let manifest = Manifest::of(self)?.without_values();
        let components = ModulePath::root(module).components;
        Ok(self.load(&components, &Overlay::of(self)?, &manifest)?.text)
    }
}

/// For each feature that needs a value but isn't set, some values to try.
pub(super) fn values_of(package: &Package) -> BTreeMap<String, Vec<Feature>> {
    let (Ok(overlay), Ok(manifest)) = (Overlay::of(package), Manifest::of(package)) else {
        return BTreeMap::new();
    };
    let mut all = BTreeMap::<String, Vec<Feature>>::new();
    let mut set: BTreeSet<String> = manifest.features.keys().cloned().collect();
    set.extend(package.features.iter().map(|(name, _)| name.clone()));
    for module in package.modules().unwrap_or_default() {
        let path = ModulePath::root(&module).components;
        let Ok(file) = package.load(&path, &overlay, &manifest) else { continue };
        set.extend(directives::defined(&file.text).into_keys());
        for (name, values) in directives::values(&file.text) {
            let known = all.entry(name).or_default();
            values.into_iter().for_each(|one| {
                if !known.contains(&one) {
                    known.push(one)
                }
            });
        }
    }
    all.retain(|name, _| !set.contains(name));
    all
}
