//! Searches a folder for modules and the files beside them. All commands use this search, so they agree on the
//! folders that belong to a package.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::{PackageError, manifest};
use crate::diagnostic::shown;

#[derive(Debug, Default)]
pub(super) struct Contents {
    pub(super) modules: Vec<String>,
    /// The files that aren't modules, including pipes and device files.
    pub(super) others: Vec<PathBuf>,
    /// The real paths of the folders that Karat has entered. Karat enters a folder once, even if several links lead to
    /// it.
    entered: BTreeSet<PathBuf>,
    /// Symbolic links to folders, each with the folder's path in imports, such as `math::noise`. If a folder can also
    /// be reached without links, Karat uses the path without links.
    links: Vec<(PathBuf, String)>,
}

impl Contents {
    pub(super) fn of(folder: &Path) -> Result<Self, PackageError> {
        let mut found = Self::default();
        found.enter(folder, "")?;
        while !found.links.is_empty() {
            let mut links = std::mem::take(&mut found.links);
            links.sort();
            for (link, name) in links {
                found.enter(&link, &name)?;
            }
        }
        Ok(found)
    }

    fn enter(&mut self, folder: &Path, prefix: &str) -> Result<(), PackageError> {
        let unreadable = |cause| PackageError::Unreadable { file: shown(folder), cause };
        if !self.entered.insert(folder.canonicalize().map_err(unreadable)?) {
            return Ok(());
        }
        for entry in std::fs::read_dir(folder).map_err(unreadable)? {
            let path = entry.map_err(unreadable)?.path();
            let no_module = |reason| PackageError::NoModule { file: shown(&path), reason };
            // Hidden files aren't modules. Some editors lock a file with a dangling link.
            let is_hidden = |name: &std::ffi::OsStr| name.to_string_lossy().starts_with('.');
            if path.file_name().is_some_and(is_hidden) {
                continue;
            }
            let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
            let is_shader = super::EXTENSIONS.iter().any(|known| extension == *known);
            if !prefix.is_empty() && path.file_name().is_some_and(|name| name == manifest::NAME) {
                let reason =
                    "Karat reads only the karat.toml in the package's own folder: move this file there"
                        .to_owned();
                return Err(PackageError::Manifest { file: shown(&path), reason });
            }
            let part = if path.is_dir() { path.file_name() } else { path.file_stem() };
            let Some(part) = part.and_then(|part| part.to_str()) else {
                if is_shader {
                    return Err(no_module("the file's name isn't UTF-8"));
                }
                continue;
            };
            let name =
                if prefix.is_empty() { part.to_owned() } else { format!("{prefix}::{part}") };
            if path.is_dir() {
                match path.is_symlink() {
                    _ if is_of_tools(&path) => {}
                    true => self.links.push((path, name)),
                    false => self.enter(&path, &name)?,
                }
            } else if is_shader {
                if path.extension() != Some(&extension) {
                    return Err(no_module("write the file's extension in lower case"));
                }
                if !path.is_file() {
                    return Err(no_module("the path isn't a file, or is a broken link"));
                }
                self.modules.push(name);
            } else {
                self.others.push(path);
            }
        }
        Ok(())
    }
}

/// Checks if the contents of a folder come from a tool: the folder is `node_modules`, or has a cache tag, as Cargo's
/// output has.
///
/// ```
/// use karat::unstable::package::is_of_tools;
///
/// assert!(is_of_tools("node_modules".as_ref()) && !is_of_tools("src".as_ref()));
/// ```
#[must_use]
pub fn is_of_tools(folder: &Path) -> bool {
    folder.ends_with("node_modules") || folder.join("CACHEDIR.TAG").is_file()
}
