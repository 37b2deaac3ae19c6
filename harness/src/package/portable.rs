//! Serializes a package so that another process can open it.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::{Feature, Origin, Package};

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Portable {
    from: From,
    dependencies: Vec<(String, Self)>,
    features: Vec<(String, Feature)>,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
enum From {
    Folder(PathBuf),
    File { path: PathBuf, name: String },
    Memory { name: String, modules: Vec<(String, String)> },
    Crate { base: PathBuf, name: String, root: Option<String> },
}

impl Package {
    /// The package as data that another process can open from any working directory. `None` for a crate that Karat has
    /// already looked up.
    pub(crate) fn portable(&self) -> Option<Portable> {
        let whole = |path: PathBuf| std::path::absolute(&path).unwrap_or(path);
        let from = match &self.origin {
            Origin::Folder { .. } => From::Folder(whole(self.root())),
            Origin::File { path, name } => {
                From::File { path: whole(path.clone()), name: name.clone() }
            }
            Origin::Memory { name, modules } => {
                From::Memory { name: name.clone(), modules: modules.clone() }
            }
            Origin::Crate { base, name, root } => From::Crate {
                base: whole(PathBuf::from(&**base)),
                name: name.to_string(),
                root: root.as_ref().map(ToString::to_string),
            },
            Origin::Found(_) => return None,
        };
        let dependencies = self.dependencies.iter();
        let dependencies =
            dependencies.map(|(name, package)| Some((name.clone(), package.portable()?)));
        Some(Portable {
            from,
            dependencies: dependencies.collect::<Option<_>>()?,
            features: self.features.clone(),
        })
    }
}

impl Portable {
    /// The folder or file of the package; `None` for a crate, and for text in memory.
    pub(crate) fn place(&self) -> Option<&Path> {
        match &self.from {
            From::Folder(path) | From::File { path, .. } => Some(path),
            From::Memory { .. } | From::Crate { .. } => None,
        }
    }

    pub(crate) fn package(&self) -> Package {
        let text = |path: &PathBuf| Cow::Owned(path.to_string_lossy().into_owned());
        let origin = match &self.from {
            From::Folder(path) => Origin::Folder { base: Cow::Borrowed(""), path: text(path) },
            From::File { path, name } => Origin::File { path: path.clone(), name: name.clone() },
            From::Memory { name, modules } => {
                Origin::Memory { name: name.clone(), modules: modules.clone() }
            }
            From::Crate { base, name, root } => Origin::Crate {
                base: text(base),
                name: Cow::Owned(name.clone()),
                root: root.clone().map(Cow::Owned),
            },
        };
        let dependencies = self.dependencies.iter();
        Package {
            dependencies: dependencies.map(|(name, own)| (name.clone(), own.package())).collect(),
            features: self.features.clone(),
            ..Package::of_origin(origin)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_package_is_the_same_in_another_process() {
        let noise = Package::from_modules("noise", [("value", "fn f() -> f32 { return 1.0; }")]);
        let folder = tempfile::tempdir().expect("a temporary folder");
        let here = Package::open(folder.path()).expect("a package");
        let whole = here.depends_on("noise", &noise).feature("fast", true).feature("size", 3);
        let text = serde_json::to_string(&whole.portable().expect("it is")).expect("plain data");
        let again: Portable = serde_json::from_str(&text).expect("as written");
        assert_eq!(again.package(), whole);
    }
}
