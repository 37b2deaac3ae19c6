//! The modules below a folder.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use super::{PackageError, library, manifest};
use crate::diagnostic::shown;

/// Finds modules below a folder. Each folder is entered once, however many links lead there.
pub(super) fn scan(
    folder: &Path,
    prefix: &str,
    entered: &mut BTreeSet<PathBuf>,
    found: &mut Vec<String>,
) -> Result<(), PackageError> {
    let unreadable = |source| PackageError::Unreadable { file: shown(folder), source };
    if !entered.insert(folder.canonicalize().map_err(unreadable)?) {
        return Ok(());
    }
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let no_module = |reason| PackageError::NoModule { file: shown(&path), reason };
        // Hidden files are nobody's modules: an editor locks a file by one, as a link to nothing.
        let is_hidden = |name: &std::ffi::OsStr| name.to_string_lossy().starts_with('.');
        if path.file_name().is_some_and(is_hidden) {
            continue;
        }
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        let is_shader = library::EXTENSIONS.iter().any(|known| extension == *known);
        if !prefix.is_empty() && path.file_name().is_some_and(|name| name == manifest::NAME) {
            let reason =
                "only the one in the package's own folder is read: move it there".to_owned();
            return Err(PackageError::Manifest { file: shown(&path), reason });
        }
        let part = if path.is_dir() { path.file_name() } else { path.file_stem() };
        let Some(part) = part.and_then(|part| part.to_str()) else {
            if is_shader {
                return Err(no_module("its name isn't UTF-8"));
            }
            continue;
        };
        let name = if prefix.is_empty() { part.to_owned() } else { format!("{prefix}::{part}") };
        if path.is_dir() {
            // Cargo's output holds no modules of the author.
            let is_output = part == "target" && path.join("CACHEDIR.TAG").is_file();
            if !is_output {
                scan(&path, &name, entered, found)?;
            }
        } else if is_shader {
            if path.extension() != Some(&extension) {
                return Err(no_module("write its extension in small letters"));
            }
            if !path.is_file() {
                return Err(no_module("it isn't a file, or a link to nothing"));
            }
            found.push(name);
        }
    }
    Ok(())
}
