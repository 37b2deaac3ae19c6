//! Reads other files in place of modules. So you can try a change without editing the sources, or plant a fault
//! that a test must catch.
//!
//! If `KARAT_OVERLAY` names a folder, Karat reads each file in the folder in place of the module with the same path in
//! a package. If several packages have a module with this path, put the file into a subfolder with the package's name
//! (`shaders/math.wgsl`). Files never replace modules in memory.
//!
//! An editor has texts that aren't saved yet. Karat reads the texts from [`Package::unsaved`] in place of their
//! files.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::{Origin, Package, PackageError};
use crate::diagnostic::{SourceFile, nearest, read_file, shown};
use crate::output::visible;
use crate::settings;

#[derive(Debug, Default)]
pub(super) struct Overlay {
    replaced: BTreeMap<PathBuf, PathBuf>,
    /// Texts that Karat reads in place of files. The paths of the files contain no symbolic links.
    unsaved: BTreeMap<PathBuf, Arc<str>>,
}

impl Overlay {
    /// The overlay that `KARAT_OVERLAY` selects for a package and its dependencies. Each file of the overlay must
    /// replace a module. Otherwise the user could misspell a file's name, and believe that Karat tested the changed
    /// file. The overlay is empty if neither the package nor its dependencies have modules in files.
    pub(super) fn of(package: &Package) -> Result<Self, PackageError> {
        let unsaved = package.unsaved.iter().cloned().collect();
        let Some(folder) = settings::overlay() else {
            return Ok(Self { unsaved, ..Self::default() });
        };
        let overlay = Self::of_folder(package, &folder)?;
        overlay.note(&folder);
        Ok(Self { unsaved, ..overlay })
    }

    fn of_folder(package: &Package, folder: &Path) -> Result<Self, PackageError> {
        let error = |reason: String| PackageError::Overlay { folder: shown(folder), reason };
        let mut packages = BTreeMap::new();
        on_disk(package, &mut packages);
        if packages.is_empty() {
            return Ok(Self::default());
        }
        if !folder.is_dir() {
            let here = std::env::current_dir().unwrap_or_default();
            return Err(error(format!("isn't a folder in `{}`", here.display())));
        }
        let mut files = Vec::new();
        list(folder, Path::new(""), &mut files)?;
        if files.is_empty() {
            return Err(error("has no files, so it replaces no module".to_owned()));
        }
        let mut replaced = BTreeMap::new();
        for file in files {
            let name = file.display();
            let found = packages.values().filter_map(|p| Some((p.name(), p.holds(&file)?)));
            match found.collect::<Vec<_>>().as_slice() {
                [(_, module)] => {
                    if replaced.insert(module.clone(), folder.join(&file)).is_some() {
                        return Err(error(format!("has a second file for a module: `{name}`")));
                    }
                }
                [] => return Err(error(unknown(&file, packages.values()))),
                several => {
                    let names = several.iter().map(|(package, _)| format!("`{package}/{name}`"));
                    let names = names.collect::<Vec<_>>().join(" or ");
                    return Err(error(format!(
                        "has `{name}`, but several packages have a module `{name}`: use {names}"
                    )));
                }
            }
        }
        Ok(Self { replaced, ..Self::default() })
    }

    pub(super) fn file(&self, module: PathBuf) -> PathBuf {
        self.replaced.get(&module).cloned().unwrap_or(module)
    }

    pub(super) fn read(&self, file: &Path) -> Result<SourceFile, PackageError> {
        // Most packages have no unsaved text, and then Karat doesn't resolve links.
        let place = (!self.unsaved.is_empty()).then(|| file.canonicalize().ok()).flatten();
        match place.and_then(|place| self.unsaved.get(&place)) {
            Some(text) => Ok(SourceFile::new(shown(file), text.to_string())),
            None => read_utf8(file),
        }
    }

    /// Prints, once in each process, the files that the overlay replaces. The user sees this text even if the test
    /// runner captures the output of passing tests.
    fn note(&self, folder: &Path) {
        static SAID: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());
        if self.replaced.is_empty() {
            return;
        }
        let modules: Vec<String> = self.replaced.keys().map(|module| shown(module)).collect();
        let modules = modules.join(", ");
        let line = format!(
            "note: KARAT_OVERLAY={}: files of this folder replace {modules}\n",
            folder.display()
        );
        let mut said = SAID.lock().unwrap_or_else(PoisonError::into_inner);
        if said.insert(line.clone()) {
            // If the write fails, the record still has the overlay.
            drop(std::io::stderr().write_all(visible(&line).as_bytes()));
        }
    }
}

/// The packages with modules in files, by path: this package and its dependencies.
fn on_disk<'a>(package: &'a Package, found: &mut BTreeMap<PathBuf, &'a Package>) {
    if !matches!(package.origin, Origin::Memory { .. }) {
        found.insert(package.root(), package);
    }
    for (_, dependency) in &package.dependencies {
        on_disk(dependency, found);
    }
}

/// The reason why a file replaces no module of these packages, with suggestions.
fn unknown<'a>(file: &Path, packages: impl Iterator<Item = &'a &'a Package> + Clone) -> String {
    let bare = packages.clone().find_map(|package| file.strip_prefix(package.name()).ok());
    let known: Vec<String> = packages.clone().flat_map(|package| package.files()).collect();
    let wanted = bare.unwrap_or(file).to_string_lossy();
    let near = nearest(&wanted, known.iter().map(String::as_str));
    let near = near.map_or_else(String::new, |name| format!("; did you mean `{name}`?"));
    let names: Vec<_> = packages.map(|package| format!("`{}`", package.name())).collect();
    format!("has `{}`, which isn't a module of package {}{near}", file.display(), names.join(", "))
}

/// The files below a folder, sorted, without hidden files. Their paths are relative to the folder.
fn list(folder: &Path, below: &Path, found: &mut Vec<PathBuf>) -> Result<(), PackageError> {
    let unreadable = |cause| PackageError::Unreadable { file: shown(folder), cause };
    for entry in std::fs::read_dir(folder.join(below)).map_err(unreadable)? {
        let name = entry.map_err(unreadable)?.file_name();
        let path = below.join(&name);
        let linked = folder.join(&path).is_symlink();
        if name.to_string_lossy().starts_with('.') {
            continue;
        } else if folder.join(&path).is_dir() {
            if linked {
                continue; // It may lead back here.
            }
            list(folder, &path, found)?;
        } else {
            found.push(path);
        }
    }
    found.sort();
    Ok(())
}

impl Package {
    /// The package with an editor's unsaved text of a file. Karat reads the text in place of the file, in this
    /// package and in its dependencies. A file outside of these packages has no effect.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::open("examples/shaders")?;
    /// let file = package.root().join("srgb.wgsl");
    /// let edited = package.unsaved(&file, "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// edited.function("srgb::half").over(0.0..=1.0).stays_within(0.0..=0.5);
    /// # Ok::<(), karat::package::PackageError>(())
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    #[must_use]
    pub fn unsaved(&self, file: &Path, text: &str) -> Self {
        let mut own = self.clone();
        let place = file.canonicalize().unwrap_or_else(|_| file.to_owned());
        own.unsaved.retain(|(known, _)| *known != place);
        own.unsaved.push((place, Arc::from(text)));
        own
    }

    pub(super) fn unsaved_text(&self, file: &Path) -> Option<&str> {
        let place = || file.canonicalize().unwrap_or_else(|_| file.to_owned());
        let known = |place: PathBuf| self.unsaved.iter().find(|(known, _)| *known == place);
        if self.unsaved.is_empty() { None } else { known(place()).map(|(_, text)| &**text) }
    }

    /// Finds the module file that an overlay's file replaces in this package. `file` is the path in the overlay.
    /// Returns `None` if the overlay's file replaces no module of this package.
    fn holds(&self, file: &Path) -> Option<PathBuf> {
        let within = [Some(file), file.strip_prefix(self.name()).ok()];
        let here = within.into_iter().flatten().map(|file| self.at(file));
        here.into_iter().flatten().find(|file| file.is_file())
    }

    fn at(&self, file: &Path) -> Option<PathBuf> {
        let root = self.root();
        if matches!(self.origin, Origin::File { .. }) {
            return (root.file_name() == Some(file.as_os_str())).then_some(root);
        }
        let known = super::EXTENSIONS.iter().any(|e| file.extension().is_some_and(|f| f == *e));
        known.then(|| root.join(file))
    }

    fn files(&self) -> Vec<String> {
        let root = self.root();
        let folder = if root.is_dir() { &*root } else { root.parent().unwrap_or(&root) };
        let modules = self.modules().unwrap_or_default();
        let files = modules.iter().filter_map(|module| {
            let components = module.split("::").filter(|component| !component.is_empty());
            let components: Vec<String> = components.map(str::to_owned).collect();
            Some(self.file_at(&components)?.strip_prefix(folder).ok()?.display().to_string())
        });
        files.collect()
    }
}

pub(super) fn read_utf8(path: &Path) -> Result<SourceFile, PackageError> {
    let file = shown(path);
    let bytes =
        read_file(path).map_err(|cause| PackageError::Unreadable { file: file.clone(), cause })?;
    match String::from_utf8(bytes) {
        Ok(text) if text.starts_with('\u{feff}') => Err(PackageError::ByteOrderMark { file }),
        Ok(text) => Ok(SourceFile::new(file, text)),
        Err(error) => {
            let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
            let line = valid.iter().filter(|byte| **byte == b'\n').count() + 1;
            Err(PackageError::NotUtf8 { file, line })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each file of an overlay replaces exactly its own module.
    // Lesson 193
    #[test]
    fn an_overlay_replaces_each_module_that_it_has() {
        let (tree, over) = (tempfile::tempdir(), tempfile::tempdir());
        let (tree, over) = (tree.expect("a folder"), over.expect("a folder"));
        let names = ["a.wgsl", "b.wgsl", "sub/c.wgsl"];
        for folder in [tree.path(), over.path()] {
            std::fs::create_dir(folder.join("sub")).expect("a folder");
        }
        std::fs::write(tree.path().join("kept.wgsl"), "fn k() {}").expect("written");
        for name in names {
            std::fs::write(tree.path().join(name), "fn f() -> u32 { return 1u; }")
                .expect("written");
            std::fs::write(over.path().join(name), "fn f() -> u32 { return 2u; }")
                .expect("written");
        }
        let package = Package::open(tree.path()).expect("a package");
        let overlay = Overlay::of_folder(&package, over.path()).expect("it replaces modules");
        let read = |name: &str| overlay.read(&overlay.file(tree.path().join(name)));
        for name in names {
            assert!(read(name).expect("it is there").text.contains("2u"), "{name}");
        }
        assert_eq!(overlay.file(tree.path().join("kept.wgsl")), tree.path().join("kept.wgsl"));
    }
}
