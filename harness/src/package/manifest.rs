//! `karat.toml` beside the modules of a folder: features, and what expands modules.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{LazyLock, Mutex, PoisonError};

use serde::Deserialize;

use super::feature::{Feature, Features};
use super::{Origin, Package, PackageError};
use crate::diagnostic::{SourceFile, shown};

/// The file's name.
pub(super) const NAME: &str = "karat.toml";

/// What it says.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    /// Features that are set, unless a test or the command line sets them otherwise.
    #[serde(default)]
    features: BTreeMap<String, Value>,
    /// A program with its arguments that prints a module as WGSL. The module's file is its last
    /// argument, and it runs in the folder of the modules.
    preprocess: Option<Vec<String>>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged)]
enum Value {
    Flag(bool),
    Number(i64),
}

impl Manifest {
    /// That of a package; an empty one if there is no file.
    pub(super) fn of(package: &Package) -> Result<Self, PackageError> {
        if !matches!(package.origin, Origin::Folder { .. }) {
            return Ok(Self::default());
        }
        let file = package.root().join(NAME);
        let error = |reason: String| PackageError::Manifest { file: shown(&file), reason };
        let text = match std::fs::read_to_string(&file) {
            Ok(text) => text,
            Err(none) if none.kind() == std::io::ErrorKind::NotFound => return Ok(Self::default()),
            Err(other) => return Err(error(other.to_string())),
        };
        let manifest: Self = toml::from_str(&text)
            .map_err(|reason| error(reason.to_string().trim_end().to_owned()))?;
        if manifest.preprocess.as_ref().is_some_and(Vec::is_empty) {
            return Err(error("`preprocess` names no program".to_owned()));
        }
        Ok(manifest)
    }

    pub(super) fn features(&self) -> Features {
        let feature = |value: &Value| match value {
            Value::Flag(on) => Feature::Flag(*on),
            Value::Number(value) => Feature::Number(*value),
        };
        self.features.iter().map(|(name, value)| (name.clone(), feature(value))).collect()
    }

    /// A module as it is, or as the package's program prints it; once in a process for the same text.
    pub(super) fn expanded(
        &self,
        root: &Path,
        path: &Path,
        source: SourceFile,
    ) -> Result<SourceFile, PackageError> {
        type Known = HashMap<(PathBuf, blake3::Hash), String>;
        static KNOWN: LazyLock<Mutex<Known>> = LazyLock::new(Mutex::default);
        let Some([program, arguments @ ..]) = self.preprocess.as_deref() else { return Ok(source) };
        let lock = || KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
        let key = (path.to_owned(), blake3::hash(source.text.as_bytes()));
        // In brackets, as texts are that are in no file.
        let name = format!("<{}, as `{program}` prints it>", source.name);
        if let Some(text) = lock().get(&key).cloned() {
            return Ok(SourceFile { name, text });
        }
        let error = |reason: String| {
            let (file, program) = (shown(path), program.clone());
            PackageError::Preprocess { file, program, reason }
        };
        let whole = |path: &Path| path.canonicalize().map_err(|reason| error(reason.to_string()));
        let (root, file) = (whole(root)?, whole(path)?);
        let output = Command::new(program).args(arguments).arg(&file).current_dir(root).output();
        let output = output.map_err(|reason| error(format!("it doesn't run: {reason}")))?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            return Err(error(format!("{}\n{}", output.status, said.trim_end())));
        }
        let text = String::from_utf8(output.stdout);
        let text = text.map_err(|_| error("what it prints isn't UTF-8".to_owned()))?;
        if text.trim().is_empty() {
            return Err(error("it prints nothing".to_owned()));
        }
        lock().insert(key, text.clone());
        Ok(SourceFile { name, text })
    }
}
