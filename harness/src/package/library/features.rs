//! Features that are set, and asked about.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::{Library, ModulePath};
use crate::diagnostic::nearest;
use crate::package::values::{self, Values};
use crate::package::workspace::{self, Kind};
use crate::package::{PackageError, directives};

/// Features that modules of a package ask about: once seen, one isn't looked for again.
struct Asked;

impl Kind for Asked {
    type Key = (PathBuf, String);
    type Value = ();
    // More features than packages have.
    const MOST: usize = 10_000;
}

impl Library {
    /// Whether something asks about each feature that is set.
    pub(super) fn expect_features(&self) -> Result<(), PackageError> {
        let package = self.package(0);
        let root = package.root();
        let features = self.features(0);
        let manifest = self.manifest(0)?;
        let by_engine = &manifest.set_by_engine;
        let names = features.keys().filter(|name| {
            !by_engine.contains(*name)
                && workspace::get::<Asked>(&(root.clone(), (*name).clone())).is_none()
        });
        let names: Vec<&String> = names.collect();
        if names.is_empty() {
            return Ok(());
        }
        // What can't be read may ask about anything.
        let mut unreadable = None;
        let mut asked_in = |of: usize| {
            let (package, mut found) = (self.package(of), BTreeSet::new());
            for module in package.modules().unwrap_or_default() {
                match self.read(&ModulePath { package: of, ..ModulePath::root(&module) }) {
                    Ok(file) => found.extend(directives::asked(&file.text)),
                    Err(error) => drop(unreadable.get_or_insert(error)),
                }
            }
            found
        };
        let own = asked_in(0);
        let others: BTreeSet<String> =
            self.all().into_iter().skip(1).flat_map(&mut asked_in).collect();
        let is_unknown = |name: &&&String| !own.contains(**name) && !others.contains(**name);
        let unknown: Vec<&String> = names.iter().filter(is_unknown).copied().collect();
        if !unknown.is_empty() {
            let near =
                |name: &String| nearest(name, own.iter().map(String::as_str)).map(str::to_owned);
            let modules = package.modules().unwrap_or_default();
            let texts = modules.iter().filter_map(|module| package.before_values(module).ok());
            let texts: Vec<String> = texts.collect();
            let is_bare = |name: &&&String| {
                let value = Values::from([((**name).clone(), String::new())]);
                texts.iter().any(|text| !values::used(text, &value).is_empty())
            };
            return Err(unreadable.unwrap_or_else(|| PackageError::UnknownFeature {
                bare: unknown
                    .iter()
                    .filter(|name| !manifest.stands_for(name))
                    .find(is_bare)
                    .map(|name| (*name).clone()),
                unknown: unknown.into_iter().map(|name| (name.clone(), near(name))).collect(),
                package: package.name(),
                known: own.iter().cloned().collect::<Vec<_>>().join(", "),
            }));
        }
        // A text in memory has no place of its own.
        if !root.as_os_str().is_empty() {
            workspace::with_room::<Asked, _>(|asked| {
                asked.extend(names.into_iter().map(|name| ((root.clone(), name.clone()), ())));
            });
        }
        Ok(())
    }
}
