//! The text on which a test's verdict depends. While the text stays the same, the verdict stays the same.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use karat::unstable::diagnostic::read_file;
use karat::unstable::reflect::Program;
use toml::Value;

use crate::assertions::What;
use crate::fixtures::name_and_space;
use crate::{Kind, Suite, Test};

impl Suite {
    /// The text of everything on which a test's verdict depends: shaders without comments and blanks, the declaration,
    /// and the files. The driver isn't in this text. `None` if Karat can't make the text, for example if a shader is
    /// invalid.
    #[must_use]
    pub fn normalized_text(&self, test: &Test) -> Option<String> {
        match &test.kind {
            Kind::Wgsl(test) => test.normalized_text().map(str::to_owned),
            Kind::Function(assertion) => {
                let mut text = self.fingerprint(&assertion.function)?.to_owned();
                match &assertion.what {
                    What::AgreesWith(reference) => {
                        text += self.fingerprint(&assertion.of_module(reference))?;
                    }
                    What::Table(file) => text += &content(&assertion.folder.join(file))?,
                    What::Golden(_) => text += &content(&assertion.golden_file()?)?,
                    _ => {}
                }
                text += &files(assertion.test.with.values(), &assertion.folder)?;
                Some(format!("{text} {:?} {:?}", assertion.test, assertion.what))
            }
            Kind::Frame(frame) => {
                let module = frame.module.as_deref().unwrap_or_default();
                let text = Program::of_module(&self.package, module).ok()?.normalized_text();
                let golden = content(&frame.golden_file())?;
                let mut files = files(frame.with.values(), &frame.folder)?;
                for mesh in frame.meshes() {
                    files += &content(&mesh)?;
                }
                Some(format!("{text} {frame:?} {golden} {files}"))
            }
            Kind::Compute(assertion) => {
                let mut text = assertion.normalized_text(&self.package)?;
                for file in assertion.files() {
                    text += &content(&file)?;
                }
                text += &files(assertion.declared.with.values(), &assertion.folder)?;
                Some(text)
            }
        }
    }

    /// The files that the tests read, except for modules: tables, goldens, meshes, and the images and values in `with`.
    #[must_use]
    pub fn reads(&self) -> BTreeSet<PathBuf> {
        let mut all = BTreeSet::new();
        for test in &self.tests {
            match &test.kind {
                Kind::Wgsl(_) => {}
                Kind::Function(assertion) => {
                    if let What::Table(file) = &assertion.what {
                        all.insert(assertion.folder.join(file));
                    }
                    all.extend(assertion.golden_file());
                    named(assertion.test.with.values(), &assertion.folder, &mut all);
                }
                Kind::Frame(frame) => {
                    let golden = frame.golden_file();
                    all.extend([golden.with_extension("toml"), golden]);
                    all.extend(frame.meshes());
                    named(frame.with.values(), &frame.folder, &mut all);
                }
                Kind::Compute(assertion) => {
                    all.extend(assertion.files());
                    named(assertion.declared.with.values(), &assertion.folder, &mut all);
                }
            }
        }
        all
    }

    /// The linked text of a function that a declared test calls.
    fn fingerprint(&self, function: &str) -> Option<&str> {
        let all = self.fingerprints.get_or_init(|| {
            let mut names = BTreeSet::new();
            for test in &self.tests {
                let Kind::Function(assertion) = &test.kind else { continue };
                names.insert(assertion.function.clone());
                if let What::AgreesWith(reference) = &assertion.what {
                    names.insert(assertion.of_module(reference));
                }
            }
            self.package.fingerprints(&names)
        });
        all.get(function).map(String::as_str)
    }
}

/// A hash of a file's contents; `None` if the file can't be read.
fn content(file: &Path) -> Option<String> {
    let bytes = read_file(file).ok()?;
    Some(blake3::hash(&bytes).to_hex().to_string())
}

/// The values of a table that may be file names. A `range` such as `"0..1"` isn't a file name.
fn values(table: &toml::Table) -> Vec<&Value> {
    table.iter().filter(|(key, _)| *key != "range").map(|(_, value)| value).collect()
}

/// Adds to `all` the files that occur in a test's `with`.
fn named<'v>(
    with: impl IntoIterator<Item = &'v Value>,
    folder: &Path,
    all: &mut BTreeSet<PathBuf>,
) {
    for value in with {
        match value {
            Value::String(name) => drop(all.insert(folder.join(name_and_space(name).0))),
            Value::Array(list) => named(list, folder, all),
            Value::Table(table) => {
                named(values(table), folder, all);
            }
            _ => {}
        }
    }
}

/// The hashes of the images and value files that a test binds, including files in lists.
fn files<'v>(mut with: impl Iterator<Item = &'v Value>, folder: &Path) -> Option<String> {
    with.try_fold(String::new(), |all, value| {
        Some(match value {
            // An image's name may have no ending. Strings that aren't file names are skipped.
            Value::String(name) => match content(&folder.join(name_and_space(name).0)) {
                Some(content) => all + &content,
                None if name.contains('.') => return None,
                None => all,
            },
            Value::Array(list) => all + &files(list.iter(), folder)?,
            Value::Table(table) => all + &files(values(table).into_iter(), folder)?,
            _ => all,
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_in_lists_are_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let with: toml::Table =
            "layers = [\"a.png\", [1, 0, 0]]\nwhole = \"b.json\"".parse().expect("TOML");
        let write = |name: &str, text: &str| {
            std::fs::write(folder.path().join(name), text).expect("written");
        };
        let read = || files(with.values(), folder.path());
        assert_eq!(read(), None, "the file doesn't exist");
        write("a.png", "1");
        write("b.json", "1");
        let first = read();
        write("a.png", "2");
        let second = read();
        write("b.json", "2");
        assert!(first.is_some() && first != second && second != read());
    }
}
