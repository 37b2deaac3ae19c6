//! Features that are set, and asked about.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

use super::{Library, ModulePath};
use crate::diagnostic::nearest;
use crate::package::{PackageError, directives};

/// Whether a text has a word.
fn has_word(text: &str, word: &str) -> bool {
    let is_part = |c: char| c.is_alphanumeric() || c == '_';
    text.match_indices(word).any(|(at, _)| {
        !text[..at].ends_with(is_part) && !text[at + word.len()..].starts_with(is_part)
    })
}

impl Library {
    /// Whether something asks about each feature that is set.
    pub(super) fn expect_features(&self) -> Result<(), PackageError> {
        static ASKED: Mutex<BTreeSet<(PathBuf, String)>> = Mutex::new(BTreeSet::new());
        let package = self.package(0);
        let lock = || ASKED.lock().unwrap_or_else(PoisonError::into_inner);
        for name in self.features(0).keys() {
            let key = (package.root(), name.clone());
            if lock().contains(&key) {
                continue;
            }
            let texts = |package: usize| -> Vec<String> {
                let package = self.package(package);
                let modules = package.modules().unwrap_or_default();
                let load = |module: String| {
                    let file = package.load(&ModulePath::root(&module).components, &self.overlay);
                    Some(file.ok()?.text)
                };
                modules.into_iter().filter_map(load).collect()
            };
            let asks =
                |text: &String| has_word(text, name) && directives::asked(text).contains(name);
            if !self.all().into_iter().any(|of| texts(of).iter().any(asks)) {
                let mut known = BTreeSet::new();
                texts(0).iter().for_each(|text| known.extend(directives::asked(text)));
                return Err(PackageError::UnknownFeature {
                    feature: name.clone(),
                    package: package.name(),
                    nearest: nearest(name, known.iter().map(String::as_str)).map(str::to_owned),
                    known: known.into_iter().collect::<Vec<_>>().join(", "),
                });
            }
            // A text in memory has no place of its own.
            if !key.0.as_os_str().is_empty() {
                lock().insert(key);
            }
        }
        Ok(())
    }
}
