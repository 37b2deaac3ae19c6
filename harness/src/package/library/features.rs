//! Features that are set, and asked about.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::{Library, ModulePath};
use crate::diagnostic::nearest;
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
        let names = features
            .keys()
            .filter(|name| workspace::get::<Asked>(&(root.clone(), (*name).clone())).is_none());
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
        if let Some(name) =
            names.iter().find(|name| !own.contains(**name) && !others.contains(**name))
        {
            return Err(unreadable.unwrap_or_else(|| PackageError::UnknownFeature {
                feature: (*name).clone(),
                package: package.name(),
                nearest: nearest(name, own.iter().map(String::as_str)).map(str::to_owned),
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
