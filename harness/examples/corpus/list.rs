//! The list of crates and folders whose shaders are read.

use std::collections::BTreeMap;
use std::path::Path;

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
    #[serde(default)]
    features: BTreeMap<String, Value>,
    /// More features of single modules, which mean nothing without them.
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
    /// Reads the file; or what is wrong with it.
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

    /// The package with the features of all modules.
    pub(crate) fn open(&self) -> Result<Package, PackageError> {
        let package = match (&self.krate, &self.folder) {
            (Some(krate), _) => Package::open_crate(Path::new("."), krate, self.root.as_deref()),
            (None, folder) => Package::open(folder.as_deref().unwrap_or(".")),
        };
        let set = |package: Package, (name, value): (&String, &Value)| match value {
            Value::Flag(on) => package.feature(name, *on),
            Value::Number(value) => package.feature(name, Feature::Number(*value)),
        };
        Ok(self.features.iter().fold(package?, set))
    }
}
