//! Finds the tests of a package.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use karat::Package;
use karat::package::PackageError;
use karat::unstable::diagnostic::{Diagnostic, SourceFile, Span, nearest, read_file, shown};
use karat::unstable::output::name;
use karat::unstable::package::unsaved_of;

use crate::declared;
use crate::{Broken, Kind, Suite, Test, Wrong};

/// The reason why Karat can't search for tests.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FindError {
    /// The package can't be read.
    #[error("{0}")]
    Package(PackageError),
}

/// The ending of test files.
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
                broken.push(Broken { name, wrong: Wrong::from(&error), is_file: false });
            }
        }
    }
    for file in meant(&package)? {
        let read = match file.to_string_lossy().ends_with(ENDING) {
            true => declared::read(&file, unsaved_of(&package, &file).map(str::to_owned), &root),
            false => Err(unread(&file)),
        };
        let name = file.display().to_string();
        match read {
            Ok((found, wrong)) => {
                tests.extend(found);
                broken.extend(wrong.into_iter().map(|found| {
                    let line =
                        found.location().map_or(1, |at| at.file.line_column(at.range.start).0);
                    let name = format!("{name}:{line}");
                    Broken { name, wrong: Wrong::from(found), is_file: true }
                }));
            }
            Err(found) => broken.push(Broken { name, wrong: Wrong::from(found), is_file: true }),
        }
    }
    let mut seen: BTreeMap<String, usize> = BTreeMap::new();
    for broken in &mut broken {
        broken.name = name(&broken.name).into_owned();
    }
    for test in &mut tests {
        // Threads, records, replay commands and files have the test's name.
        test.name = name(&test.name).into_owned();
        let count = seen.entry(test.name.clone()).or_default();
        *count += 1;
        if *count > 1 {
            test.name = format!("{}#{count}", test.name);
        }
    }
    let folder = if root.is_file() { root.parent().unwrap_or(Path::new("")) } else { &root };
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let folder = folder.to_owned();
    Ok(Suite { package, folder, tests, broken, fingerprints: OnceLock::new() })
}

/// The error message about a test file that Karat doesn't read, with the file endings that Karat reads.
fn unread(file: &Path) -> Diagnostic {
    let read = match is_misnamed_module(file) {
        true => "Karat reads tests in WGSL from `*.wgsl` and `*.wesl`".to_owned(),
        false => format!("Karat reads declared tests from `*{ENDING}`"),
    };
    of_whole(file, format!("`{}` isn't read: {read}", shown(file)))
}

/// A message about a whole file, at the file's beginning, because editors show only messages with a position.
pub(crate) fn of_whole(file: &Path, message: String) -> Diagnostic {
    let source = SourceFile::new(shown(file), "");
    let start = Span { file: Arc::new(source), range: 0..0 };
    Diagnostic::new(message).at(start, "")
}

/// The module in a test file's name, such as `brdf` in `brdf.test.toml`. Also recognizes misspelled names:
/// `brdf.tests.toml`, `brdf_test.toml`, `brdf.test.tml`, `BRDF.TEST.TOML`.
fn stem_of(name: &str) -> Option<&str> {
    let lower = name.to_ascii_lowercase();
    let (rest, ending) = lower.rsplit_once('.')?;
    let (stem, word) = rest.rsplit_once(['.', '_', '-'])?;
    let is_test = matches!(word, "test" | "tests");
    let means_test = rest.as_bytes()[stem.len()] == b'.' && nearest(word, ["test"]).is_some();
    let meant = match ending {
        "toml" => is_test || means_test,
        // An editor's copy, such as `brdf.test.toml~`, isn't a test file.
        "yaml" | "yml" | "json" => is_test && rest.as_bytes()[stem.len()] == b'.',
        other => is_test && !other.ends_with('~') && nearest(other, ["toml"]).is_some(),
    };
    (meant && !stem.is_empty()).then(|| &name[..stem.len()])
}

/// Checks if a file declares tests, although its name doesn't end in `.test.toml`. The author probably expects these
/// tests to run.
fn declares(file: &Path, name: &str) -> bool {
    let lower = name.to_ascii_lowercase();
    // Skips the copies that editors and git make, and Cargo's files.
    let is_other = lower.ends_with('~')
        || [".bak", ".orig", ".rej", ".old", ".swp"].iter().any(|ending| lower.ends_with(ending))
        || lower == "cargo.toml";
    if is_other || !lower.contains(".toml") {
        return false;
    }
    let text = read_file(file).unwrap_or_default();
    let text = String::from_utf8_lossy(&text);
    let has = |head: &str, key: &str| {
        text.lines().any(|line| line.trim() == head)
            && text.lines().any(|line| line.trim_start().starts_with(key))
    };
    has("[[test]]", "function") || has("[[frame]]", "fragment")
}

/// Checks if a file has WGSL tests and a misspelled ending, such as `brdf_test.wgls`.
fn is_misnamed_module(file: &Path) -> bool {
    const ENDINGS: [&str; 2] = ["wgsl", "wesl"];
    let ending = file.extension().unwrap_or_default().to_string_lossy();
    let is_near = !ENDINGS.contains(&&*ending) && nearest(&ending, ENDINGS).is_some();
    let is_test = |line: &str| {
        let rest = line.trim_start().strip_prefix("@test");
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with([' ', '\t', '@']))
    };
    is_near && read_file(file).is_ok_and(|text| String::from_utf8_lossy(&text).lines().any(is_test))
}

/// Checks if an author probably meant a file to contain tests, by the file's name and content.
#[must_use]
pub fn is_meant(file: &Path) -> bool {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    stem_of(&name).is_some() || declares(file, &name) || is_misnamed_module(file)
}

impl Suite {
    /// The test files, each with its module.
    #[must_use]
    pub fn declared(&self) -> Vec<(String, PathBuf)> {
        let root = self.package.root();
        let files = meant(&self.package).unwrap_or_default().into_iter();
        let files = files.filter(|file| file.to_string_lossy().ends_with(ENDING));
        files.map(|file| (declared::module_of(&file, &root), file)).collect()
    }
}

/// The files that their authors probably meant as test files: in a package's folder, or beside a package's only file.
fn meant(package: &Package) -> Result<Vec<PathBuf>, FindError> {
    let root = package.root();
    let own = root.is_file().then(|| root.file_stem().unwrap_or_default().to_string_lossy());
    let mut files = package.files_beside().map_err(FindError::Package)?;
    files.retain(|file| {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        match &own {
            Some(own) => stem_of(&name).is_some_and(|stem| own == stem),
            None => is_meant(file),
        }
    });
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_were_meant_as_tests_are_known() {
        for name in [
            "a.test.toml",
            "a.tests.toml",
            "a.tets.toml",
            "a_test.toml",
            "a-tests.toml",
            "a.test.tml",
            "A.TEST.TOML",
            "a.test.yaml",
            "a.tests.json",
        ] {
            assert_eq!(stem_of(name).map(str::to_lowercase).as_deref(), Some("a"), "{name}");
        }
        for name in [
            "karat.toml",
            "a.wgsl",
            "a_test.wgsl",
            "a_text.toml",
            "latest.toml",
            "a.test.toml~",
            ".test.toml",
        ] {
            assert_eq!(stem_of(name), None, "{name}");
        }
    }
}
