//! Finds modules by the paths that they declare for themselves.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;

use super::{Library, ModulePath};
use crate::diagnostic::nearest;
use crate::package::manifest::Manifest;
use crate::package::overlay::Overlay;
use crate::package::workspace::{self, Kind};
use crate::package::{Origin, Package, PackageError, directives};

/// The paths that modules declare for themselves, each with the module's path in the package.
type Composed = Vec<(String, Vec<String>)>;

impl Library {
    /// Finds the module whose declared path is the longest prefix of `words`. Returns the module, and the number of
    /// words in this path. If a package has several modules with this path, the function chooses the module in the
    /// nearest folder. Among several modules in that folder, the function chooses the module that declares the first
    /// word after the path: `PI` in `math::PI`.
    pub(in crate::package) fn composed(
        &self,
        from: &ModulePath,
        words: &[String],
    ) -> Result<Option<(ModulePath, usize)>, PackageError> {
        let known = self.all_composed();
        let found = (1..=words.len())
            .rev()
            .find_map(|count| Some((&**known.get(&words[..count].join("::"))?, count)));
        let Some((modules, count)) = found else { return Ok(None) };
        // The package's own modules come first, and then the other modules in the order in which imports reach
        // them.
        let own = modules.iter().find(|module| module.package == from.package);
        let package = own.or(modules.first()).map(|module| module.package);
        let shared = |module: &ModulePath| {
            let both = module.components.iter().zip(&from.components);
            both.take_while(|(one, other)| one == other).count()
        };
        let mut own: Vec<&ModulePath> =
            modules.iter().filter(|module| Some(module.package) == package).collect();
        let nearest = own.iter().map(|module| shared(module)).max();
        own.retain(|module| Some(shared(module)) == nearest);
        if let (Some(item), [_, _, ..]) = (words.get(count), &*own) {
            let mut declaring = Vec::new();
            for module in &own {
                if self.module(module)?.declared(item).next().is_some() {
                    declaring.push(*module);
                }
            }
            if !declaring.is_empty() {
                own = declaring;
            }
        }
        match *own {
            [first, second, ..] => Err(PackageError::ComposedTwice {
                path: words[..count].join("::"),
                first: self.shown(first),
                second: self.shown(second),
            }),
            _ => Ok(own.first().map(|module| ((*module).clone(), count))),
        }
    }

    pub(in crate::package) fn not_composed(&self, path: &str) -> PackageError {
        let near = nearest(path, self.all_composed().keys().map(String::as_str));
        PackageError::NotComposed { path: path.to_owned(), nearest: near.map(str::to_owned) }
    }

    fn all_composed(&self) -> &BTreeMap<String, Vec<ModulePath>> {
        self.composed.get_or_init(|| {
            let mut known: BTreeMap<String, Vec<ModulePath>> = BTreeMap::new();
            for package in self.all() {
                for (path, components) in &*self.package(package).composed() {
                    let module = ModulePath { package, components: components.clone() };
                    known.entry(path.clone()).or_default().push(module);
                }
            }
            known
        })
    }
}

/// The paths that modules of crates declare for themselves, by the crates' folders.
struct OfCrates;

impl Kind for OfCrates {
    type Key = PathBuf;
    type Value = Arc<Composed>;
    // Any project has fewer crates with shaders than this.
    const MOST: usize = 1000;
}

impl Package {
    /// The paths that the package's modules declare for themselves.
    fn composed(&self) -> Arc<Composed> {
        // Files of a crate don't change.
        let fixed = matches!(self.origin, Origin::Found(_)).then(|| self.root());
        if let Some(known) = fixed.as_ref().and_then(workspace::get::<OfCrates>) {
            return known;
        }
        let mut found = Vec::new();
        // The first read of the file reported its errors.
        let manifest = Manifest::of(self).unwrap_or_default();
        for module in self.modules().unwrap_or_default() {
            let components = ModulePath::root(&module).components;
            let Ok(file) = self.load(&components, &Overlay::default(), &manifest) else { continue };
            found.extend(directives::path(&file.text).map(|path| (path, components)));
        }
        let found = Arc::new(found);
        if let Some(root) = fixed {
            workspace::keep::<OfCrates>(root, Arc::clone(&found));
        }
        found
    }
}
