//! Reads the list of crates and folders that contain shaders.

use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

use karat::Package;
use karat::package::{Feature, PackageError};
use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct List {
    pub(crate) shaders: Vec<Wanted>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Wanted {
    #[serde(rename = "crate")]
    krate: Option<String>,
    folder: Option<String>,
    root: Option<String>,
    /// The text of the `karat.toml` that a user of the crate would write beside the modules. If this text is set, the
    /// program copies the modules, adds this `karat.toml`, and reads the copy.
    pub(crate) karat: Option<String>,
    #[serde(default)]
    features: BTreeMap<String, Value>,
    /// The features that only some modules need: for each module's name, the features to turn on.
    #[serde(default)]
    pub(crate) with: BTreeMap<String, Vec<String>>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(untagged)]
enum Value {
    Flag(bool),
    Number(i64),
}

impl List {
    /// Reads a list from a TOML file.
    pub(crate) fn read(file: &str) -> Result<Vec<Wanted>, String> {
        let text = std::fs::read_to_string(file).map_err(|error| format!("`{file}`: {error}"))?;
        let list: Self = toml::from_str(&text).map_err(|error| format!("`{file}`: {error}"))?;
        Ok(list.shaders)
    }
}

impl Wanted {
    pub(crate) fn name(&self) -> String {
        self.krate.clone().or_else(|| self.folder.clone()).unwrap_or_default()
    }

    /// Opens the package, and turns on the features that all its modules share.
    pub(crate) fn open(&self) -> Result<Package, PackageError> {
        let package = match (&self.krate, &self.folder) {
            (Some(krate), _) => Package::open_crate(Path::new("."), krate, self.root.as_deref()),
            (None, folder) => Package::open(folder.as_deref().unwrap_or(".")),
        };
        let package = match &self.karat {
            Some(text) => Package::open(copied(&package?.root(), &self.name(), text)),
            None => package,
        };
        let set = |package: Package, (name, value): (&String, &Value)| match value {
            Value::Flag(on) => package.feature(name, *on),
            Value::Number(value) => package.feature(name, Feature::Number(*value)),
        };
        Ok(self.features.iter().fold(package?, set))
    }
}

/// Copies modules into a folder below `target`, and adds a `karat.toml` with `text`. In `text`, `{ci}` stands for the
/// folder `ci` of this repository.
fn copied(from: &Path, name: &str, text: &str) -> PathBuf {
    let ci = std::env::current_dir().unwrap_or_default().join("ci");
    let to = Path::new("target/corpus").join(name);
    let written = fresh(from, &to).and_then(|()| {
        std::fs::write(to.join("karat.toml"), text.replace("{ci}", &ci.display().to_string()))
    });
    written.unwrap_or_else(|error| panic!("`{}`: {error}", to.display()));
    to
}

fn fresh(from: &Path, to: &Path) -> io::Result<()> {
    if to.exists() {
        std::fs::remove_dir_all(to)?;
    }
    std::fs::create_dir_all(to)?;
    for entry in std::fs::read_dir(from)? {
        let (path, to) = {
            let entry = entry?;
            (entry.path(), to.join(entry.file_name()))
        };
        let is_module = |e: &std::ffi::OsStr| ["wgsl", "wesl"].iter().any(|known| e == *known);
        if path.is_dir() {
            fresh(&path, &to)?;
        } else if path.extension().is_some_and(is_module) {
            std::fs::copy(&path, &to)?;
        }
    }
    Ok(())
}
