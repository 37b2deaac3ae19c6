//! Checks that conditions use each feature that is set.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::{Library, ModulePath};
use crate::diagnostic::nearest;
use crate::package::lexer::lex;
use crate::package::values::{self, Values};
use crate::package::workspace::{self, Kind};
use crate::package::{PackageError, directives};

/// The cache of the features that a package's conditions use. Karat searches a package's conditions only for
/// features that aren't in this cache.
struct Asked;

impl Kind for Asked {
    type Key = (PathBuf, String);
    type Value = ();
    // Any package has fewer features than this.
    const MOST: usize = 10_000;
}

/// Finds an attribute that is probably a misspelt `@if` or `@elif` with one of the features in its brackets:
/// `@iff(fast)`.
fn misspelt(text: &str, features: &[&String]) -> Option<Box<str>> {
    const CONDITIONS: [&str; 2] = ["if", "elif"];
    /// Correct attributes with a name similar to `if` or `elif` (WGSL, 12; WESL).
    const OTHERS: [&str; 2] = ["id", "else"];
    let tokens = lex(text);
    let of = |at: usize| tokens.get(at).map_or("", |token| &text[token.range()]);
    (0..tokens.len()).filter(|at| of(*at) == "@" && of(at + 2) == "(").find_map(|at| {
        let name = of(at + 1);
        let end = (at + 3..tokens.len()).find(|at| of(*at) == ")")?;
        let has = |feature: &&String| (at + 3..end).any(|at| of(at) == feature.as_str());
        let is_near = !CONDITIONS.contains(&name)
            && !OTHERS.contains(&name)
            && nearest(name, CONDITIONS).is_some();
        let whole = &text[tokens[at].range().start..tokens[end].range().end];
        (is_near && features.iter().any(has)).then(|| whole.into())
    })
}

impl Library {
    /// Checks that each feature that is set occurs in a condition.
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
        // A module that can't be read may use any feature.
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
            let misspelt = texts.iter().find_map(|text| misspelt(text, &unknown));
            let mut plain = unknown.iter().filter(|name| !manifest.stands_for(name));
            // If an attribute is misspelt, the name in its brackets isn't an ordinary use of the name.
            let bare = match &misspelt {
                Some(_) => None,
                None => plain.find(is_bare).map(|name| name.as_str().into()),
            };
            return Err(unreadable.unwrap_or_else(|| PackageError::UnknownFeature {
                bare,
                misspelt,
                unknown: unknown.into_iter().map(|name| (name.clone(), near(name))).collect(),
                package: package.name(),
                known: own.iter().cloned().collect::<Vec<_>>().join(", ").into(),
            }));
        }
        // A text in memory has no path for the key.
        if !root.as_os_str().is_empty() {
            workspace::with_room::<Asked, _>(|asked| {
                asked.extend(names.into_iter().map(|name| ((root.clone(), name.clone()), ())));
            });
        }
        Ok(())
    }
}
