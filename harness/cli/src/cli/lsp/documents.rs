//! The files that are open in the editor. Their text may be unsaved.

use std::cell::RefCell;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use karat::Package;
use karat::unstable::record::{FileRead, Record, Time};
use lsp_types::Uri;

use super::place;

/// An open file.
pub(super) struct Document {
    /// The URI in the editor's spelling.
    pub(super) uri: Uri,
    pub(super) version: i32,
    pub(super) text: String,
}

/// The open documents, by their paths.
#[derive(Default)]
pub(super) struct Documents(BTreeMap<PathBuf, Document>);

impl Documents {
    pub(super) fn open(&mut self, file: PathBuf, document: Document) {
        self.0.insert(file, document);
    }

    pub(super) fn change(&mut self, file: &Path, version: i32, text: String) {
        if let Some(document) = self.0.get_mut(file) {
            (document.version, document.text) = (version, text);
        }
    }

    pub(super) fn close(&mut self, file: &Path) {
        self.0.remove(file);
    }

    pub(super) fn get(&self, file: &Path) -> Option<&Document> {
        self.0.get(file)
    }

    /// Returns the text that the author sees, or an empty text if there is no such file.
    pub(super) fn text(&self, file: &Path) -> String {
        match self.0.get(file) {
            Some(document) => document.text.clone(),
            None => std::fs::read(file)
                .map(|bytes| String::from_utf8_lossy(&bytes).into_owned())
                .unwrap_or_default(),
        }
    }

    /// Returns a package with the unsaved texts. Without unsaved texts, the package keeps its cached programs.
    pub(super) fn applied(&self, package: &Package) -> Package {
        let mut package = package.clone();
        for (file, document) in self.unsaved() {
            package = package.unsaved(file, &document.text);
        }
        package
    }

    /// Checks if a file below a folder has unsaved text.
    pub(super) fn is_unsaved_below(&self, folder: &Path) -> bool {
        self.unsaved().any(|(file, _)| file.starts_with(folder))
    }

    fn unsaved(&self) -> impl Iterator<Item = (&PathBuf, &Document)> {
        let differs = |(file, document): &(&PathBuf, &Document)| {
            std::fs::read(file).is_ok_and(|bytes| bytes != document.text.as_bytes())
        };
        self.0.iter().filter(differs)
    }
}

/// The present contents of files: the text in the editor, or otherwise the file on the disk. Each file is read once.
pub(super) struct Now<'d> {
    documents: &'d Documents,
    known: RefCell<HashMap<PathBuf, FileRead>>,
}

impl<'d> Now<'d> {
    pub(super) fn of(documents: &'d Documents) -> Self {
        Self { documents, known: RefCell::default() }
    }

    /// Checks if the files that a verdict depends on are unchanged, including their unsaved text. A change of a Rust
    /// reference counts only after Cargo has built the reference.
    pub(super) fn is_current(&self, record: &Record, declared: Option<&Path>) -> bool {
        if record.overlay.is_some() || record.read.is_empty() {
            return false;
        }
        // The test didn't read the file that declares it.
        let saved = declared.and_then(|file| file.metadata().ok()?.modified().ok());
        let redeclared = saved.is_some_and(|saved| began_before(record.time.as_ref(), saved));
        !redeclared && record.read.iter().all(|read| self.hash(&read.file) == read.hash)
    }

    fn hash(&self, file: &Path) -> String {
        let read = || match self.documents.get(&place::resolved(file)) {
            Some(document) => FileRead::of(file, document.text.as_bytes()),
            None => FileRead::now(file),
        };
        let mut known = self.known.borrow_mut();
        known.entry(file.to_owned()).or_insert_with(read).hash.clone()
    }
}

/// Checks if a test started before a file was saved. If the start of the test is unknown, returns `true`. A record
/// has the start in whole milliseconds. A file that was saved in the same millisecond counts as saved before the start.
fn began_before(time: Option<&Time>, saved: SystemTime) -> bool {
    let started = time.and_then(|time| humantime::parse_rfc3339(&time.started).ok());
    started.is_none_or(|started| saved >= started + Duration::from_millis(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_test_started_in_the_millisecond_of_a_save_has_read_the_file() {
        let time = |started: &str| Time { started: started.to_owned(), seconds: 0.0 };
        let saved = humantime::parse_rfc3339("2026-01-31T12:00:00.123400Z").expect("a time");
        for (started, before) in [
            ("2026-01-31T12:00:00.122Z", true),
            ("2026-01-31T12:00:00.123Z", false),
            ("2026-01-31T12:00:00.124Z", false),
            ("yesterday", true),
        ] {
            assert_eq!(began_before(Some(&time(started)), saved), before, "{started}");
        }
        assert!(began_before(None, saved));
    }
}
