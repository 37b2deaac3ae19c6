//! Links modules with imports into one WGSL text.
//!
//! The linker finds the declarations that a text needs, and renames some declarations. [`Spliced`] copies the
//! declarations' text from the author's files.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::discard::Discards;
use super::feature::{Feature, Features};
use super::function_item::functions_of;
use super::library::{Library, ModulePath};
use super::linked::{Linked, author_path};
use super::linker::Linker;
use super::parse::{asks_for_nothing, parse};
use super::splice::Spliced;
use super::{Package, PackageError, directives, imports};
use crate::diagnostic::{SourceFile, nearest};

impl Package {
    /// Makes one new package from each of the `texts`. The new package's only module has the name `module`. The new
    /// package imports this package as `name`, and has the features in `set`. Each new module begins with the
    /// `#define`s in `text`, which is the text of this package's own module `module`.
    pub(crate) fn around<const N: usize>(
        &self,
        name: &str,
        (module, text): (&str, &str),
        set: &Features,
        texts: [String; N],
    ) -> [Self; N] {
        let define = |(name, value): &(String, Feature)| match value {
            Feature::Flag(true) => format!("#define {name}\n"),
            value => format!("#define {name} {value}\n"),
        };
        let mut defines: String =
            directives::defined(text).into_iter().map(|one| define(&one)).collect();
        for one in directives::guards(text) {
            defines += &format!("#ifndef {}\n{}#endif\n", one.0, define(&one));
        }
        texts.map(|text| {
            let modules = [(module, defines.clone() + &text)];
            let mut generated = Self::from_modules(&self.name(), modules).depends_on(name, self);
            // An unsaved text replaces its file in these packages, too.
            generated.unsaved.clone_from(&self.unsaved);
            generated.features.extend(set.iter().map(|(name, value)| (name.clone(), *value)));
            generated
        })
    }

    /// Links one declaration with everything that it needs from any module, and nothing else. An entry point
    /// loses its attributes, so that a kernel can call it. `discards` decides what an invocation does at a `discard`.
    pub(crate) fn link(&self, path: &str, discards: Discards) -> Result<Linked, PackageError> {
        let (module, item) = path.rsplit_once("::").unwrap_or(("", path));
        self.link_closure(module, &[item], Some((item, discards)))
    }

    /// Links several declarations of one module with everything that they need.
    pub(crate) fn link_items(&self, module: &str, items: &[&str]) -> Result<Linked, PackageError> {
        self.link_closure(module, items, None)
    }

    fn link_closure(
        &self,
        module: &str,
        items: &[&str],
        called: Option<(&str, Discards)>,
    ) -> Result<Linked, PackageError> {
        let library = Library::open(self)?;
        let root = library.root(module);
        let file = library.begin(&root).map_err(|error| match error {
            PackageError::UnknownModule { .. } if items.len() == 1 => {
                self.unknown_function(module, items[0])
            }
            other => other,
        })?;
        let parsed = match library.module(&root) {
            Ok(parsed) => parsed,
            Err(_) if asks_for_nothing(&file.text) => return Ok(verbatim(&library, &root, &file)),
            Err(error) => return Err(error),
        };
        let mut wanted = Vec::new();
        for item in items {
            let before = wanted.len();
            wanted.extend(parsed.declared(item).map(|index| (root.clone(), index)));
            // The caller reports a missing entry point with its stage.
            if wanted.len() == before && items.len() == 1 {
                return Err(self.unknown_function(module, item));
            }
        }
        self.check_imports(&library, &root)?;
        Linker::new(&library, &root)?.link(wanted, false, called)
    }

    /// Links a whole module with everything that it needs from other modules. If the module has no imports and no
    /// conditions, the text is unchanged, byte for byte, even if it isn't well formed.
    pub(crate) fn link_module(&self, module: &str) -> Result<Linked, PackageError> {
        let root = ModulePath::root(module);
        let library = Library::open(self)?;
        let file = library.begin(&root)?;
        if asks_for_nothing(&file.text) && library.joined(&root)?.is_empty() {
            return Ok(verbatim(&library, &root, &file));
        }
        let parsed = library.module(&root)?;
        self.check_imports(&library, &root)?;
        let all = (0..parsed.declarations.len()).filter(|index| !parsed.declarations[*index].test);
        let all = all.map(|index| (root.clone(), index)).collect();
        Linker::new(&library, &root)?.link(all, true, None)
    }

    /// Follows each import, including unused imports. In a crate, the linker follows only used imports, as Bevy does,
    /// because the target of an unused import may exist only with some features.
    fn check_imports(&self, library: &Library, root: &ModulePath) -> Result<(), PackageError> {
        if self.is_crate() { Ok(()) } else { imports::check(library, root) }
    }

    /// Links a whole module like [`link_module`](Self::link_module), with a new name for everything that the module
    /// declares. Tests use this method to check that the linker finds all uses of each name.
    #[cfg(test)]
    pub(crate) fn link_renamed(&self, module: &str) -> Result<Linked, PackageError> {
        let root = ModulePath::root(module);
        let library = Library::open(self)?;
        let parsed = library.module(&root)?;
        let all = (0..parsed.declarations.len()).map(|index| (root.clone(), index)).collect();
        let mut linker = Linker::new(&library, &root)?;
        linker.free.extend(parsed.names().map(str::to_owned));
        linker.link(all, true, None)
    }

    /// The error about a function that doesn't exist. The error suggests a similar name, from the modules that Karat
    /// can read.
    fn unknown_function(&self, module: &str, item: &str) -> PackageError {
        let path = author_path("", &ModulePath::root(module), item);
        let mut known = Vec::new();
        let mut condition = None;
        for name in self.modules().unwrap_or_default() {
            let Ok(parsed) = self.parsed(&name) else { continue };
            known.extend(functions_of(&name, &parsed).into_iter().map(|item| item.name));
            if name == module {
                let inactive = parsed.inactive.iter().find(|inactive| inactive.name == item);
                condition = inactive.map(|inactive| inactive.condition.clone());
            }
        }
        if let Some(condition) = condition {
            return PackageError::Inactive { path, package: self.name(), condition };
        }
        PackageError::UnknownFunction {
            nearest: nearest(&path, known.iter().map(String::as_str)).map(str::to_owned),
            path,
            package: self.name(),
            count: known.len(),
        }
    }
}

/// Makes the linked text from a file that needs no change. All declarations keep their names.
fn verbatim(library: &Library, root: &ModulePath, file: &Arc<SourceFile>) -> Linked {
    let mut spliced = Spliced::default();
    spliced.copy(file, 0..file.text.len(), Vec::new());
    let mut names = BTreeMap::new();
    if let Ok(parsed) = parse(file, &BTreeMap::new()) {
        names.extend(parsed.names().map(|name| (name.to_owned(), author_path("", root, name))));
    }
    let (file, sources) = (Arc::clone(file), library.sources(root, file));
    Linked {
        spliced,
        names,
        file,
        whole: true,
        called: None,
        discards: None,
        calls: BTreeMap::new(),
        inactive: BTreeMap::new(),
        sources,
    }
}
