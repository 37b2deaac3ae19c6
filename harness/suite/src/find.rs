//! Which tests a package has.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use karat::Package;
use karat::diagnostic::{nearest, shown};
use karat::package::PackageError;

use crate::declared;
use crate::{Broken, Kind, Suite, Test};

/// Why the tests of a folder can't be looked for.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FindError {
    /// The package can't be read.
    #[error("{0}")]
    Package(PackageError),
    /// A folder can't be read.
    #[error("can't read `{}`: {reason}", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// Why.
        reason: std::io::Error,
    },
}

/// How the files of declared tests end.
const ENDING: &str = ".test.toml";

pub(crate) fn find(package: Package) -> Result<Suite, FindError> {
    let modules = package.modules().map_err(FindError::Package)?;
    let root = package.root();
    let (mut tests, mut broken) = (Vec::new(), Vec::new());
    let found = package.tests_in(&modules).map_err(FindError::Package)?;
    for (module, found) in modules.iter().zip(found) {
        match found {
            Ok(found) => tests.extend(found.into_iter().map(|test| Test {
                name: test.name.clone(),
                span: test.span.clone(),
                kind: Kind::Wgsl(Box::new(test)),
            })),
            Err(error) => {
                let name = if module.is_empty() { package.name() } else { module.clone() };
                broken.push(Broken { name, message: error.to_string() });
            }
        }
    }
    let mut files = Vec::new();
    let folder = if root.is_file() { root.parent().unwrap_or(Path::new("")) } else { &root };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    sidecars(folder, &root, &mut files)?;
    for file in files {
        if !file.to_string_lossy().ends_with(ENDING) {
            let message =
                format!("`{}` isn't read: declared tests are in `*{ENDING}`", shown(&file));
            broken.push(Broken { name: file.display().to_string(), message });
            continue;
        }
        match declared::read(&file, &root) {
            Ok(found) => tests.extend(found),
            Err(message) => broken.push(Broken { name: file.display().to_string(), message }),
        }
    }
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    for test in &mut tests {
        let count = seen.entry(test.name.clone()).or_default();
        *count += 1;
        if *count > 1 {
            test.name = format!("{}#{count}", test.name);
        }
    }
    let folder = folder.to_owned();
    Ok(Suite { package, folder, tests, broken, fingerprints: OnceLock::new() })
}

/// The module's name in a file's: `brdf` of `brdf.test.toml`, and of `brdf.tests.toml`, whose author meant it.
fn stem_of(name: &str) -> Option<&str> {
    let (stem, word) = name.strip_suffix(".toml")?.rsplit_once('.')?;
    (nearest(word, ["test"]).is_some() || word == "tests").then_some(stem)
}

/// The files of declared tests in a folder and below, or those of one module.
fn sidecars(folder: &Path, root: &Path, files: &mut Vec<PathBuf>) -> Result<(), FindError> {
    let failed = |reason| FindError::Folder { folder: folder.to_owned(), reason };
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder)
        .map_err(failed)?
        .map(|entry| Ok(entry.map_err(failed)?.path()))
        .collect::<Result<_, FindError>>()?;
    entries.sort();
    for path in entries {
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() {
            // What tools keep, and what they build.
            if !root.is_file()
                && !name.starts_with('.')
                && name != "target"
                && name != "node_modules"
            {
                sidecars(&path, root, files)?;
            }
        } else if let Some(stem) = stem_of(&name) {
            let own = root.file_stem().unwrap_or_default().to_string_lossy();
            if !root.is_file() || own == stem {
                files.push(path);
            }
        }
    }
    Ok(())
}
