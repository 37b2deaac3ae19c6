//! The latest records of each test, which the process keeps because a report may need them at any time.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::ffi::OsStr;
use std::fs::OpenOptions;
use std::io::Write;
use std::path::{Path, PathBuf};

use karat::unstable::output::tell;
use karat::unstable::record::{self, FileRead, Record, Verdict};

use super::super::watch::Said;

/// The records, by the displayed names of the tests.
#[derive(Default)]
pub(super) struct Latest(BTreeMap<String, Vec<Record>>);

impl Latest {
    /// Replaces the records of some tests by the records of a new run.
    pub(super) fn take<'n>(
        &mut self,
        tests: impl Iterator<Item = &'n str>,
        records: Vec<Record>,
        shown: impl Fn(&str) -> String,
    ) {
        tests.for_each(|test| drop(self.0.remove(test)));
        for record in records {
            self.0.entry(shown(&record.test)).or_default().push(record);
        }
    }

    pub(super) fn has(&self, test: &str) -> bool {
        self.0.contains_key(test)
    }

    pub(super) fn of(&self, test: &str) -> &[Record] {
        self.0.get(test).map_or(&[], Vec::as_slice)
    }

    /// Reads the records that this process wrote into its file since the last call, and then empties the file.
    pub(super) fn take_own<'n>(&mut self, tests: impl Iterator<Item = &'n str>) {
        let Some(folder) = std::env::var_os("KARAT_RECORD") else { return };
        // If the records can't be read, the tests get no records. Old ones would be wrong.
        let records = record::read(Path::new(&folder)).unwrap_or_else(|error| {
            tell(&format!("warning: {error}"));
            Vec::new()
        });
        self.take(tests, records, str::to_owned);
        let file = Path::new(&folder).join(format!("{}.jsonl", std::process::id()));
        // The process appends to the file, so its next record begins at the start of the empty file.
        drop(OpenOptions::new().write(true).open(file).and_then(|file| file.set_len(0)));
    }

    /// Returns the present state of the files that the records depend on. If all `changed` paths are files, considers
    /// only files with the same name as a changed file. If `changed` is empty or contains a folder, considers all
    /// files.
    pub(super) fn files(&self, changed: &[PathBuf]) -> HashMap<PathBuf, FileRead> {
        let names: BTreeSet<&OsStr> = changed.iter().filter_map(|file| file.file_name()).collect();
        // A new or removed folder may contain any file.
        let all = changed.is_empty() || !changed.iter().all(|file| file.is_file());
        let read = self.0.values().flatten().flat_map(|record| &record.read);
        let mut files = HashMap::new();
        for FileRead { file, .. } in read {
            let may_differ = all || file.file_name().is_some_and(|name| names.contains(name));
            if may_differ && !files.contains_key(file) {
                files.insert(file.clone(), FileRead::now(file));
            }
        }
        files
    }

    /// Keeps the records of a test that an edit doesn't affect, and updates the state of the files in these records.
    /// Returns `false` if the test failed: the failure can't be kept, because an edit elsewhere in the file may move
    /// the failing line.
    pub(super) fn renew(&mut self, test: &str, files: &HashMap<PathBuf, FileRead>) -> bool {
        let Some(records) = self.0.get_mut(test) else { return true };
        let changed = |read: &FileRead| files.get(&read.file).is_some_and(|now| now != read);
        for record in records.iter_mut().filter(|record| record.read.iter().any(changed)) {
            if !matches!(record.verdict, Verdict::Pass | Verdict::KnownIssue) {
                return false;
            }
            for read in &mut record.read {
                if let Some(now) = files.get(&read.file) {
                    read.clone_from(now);
                }
            }
        }
        true
    }

    /// Writes the records of the tests that still exist.
    pub(super) fn write(&self, file: &Path, is_there: impl Fn(&str) -> bool) -> Said {
        let records = self.0.iter().filter(|(name, _)| is_there(name)).flat_map(|(_, all)| all);
        let lines: Result<String, serde_json::Error> =
            records.map(|record| Ok(serde_json::to_string(record)? + "\n")).collect();
        let written = lines
            .map_err(std::io::Error::from)
            .and_then(|lines| std::fs::File::create(file)?.write_all(lines.as_bytes()));
        Said::Reported { error: written.err().map(|error| error.to_string()) }
    }
}
