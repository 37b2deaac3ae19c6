//! The functions and goldens that each test checks. Karat keeps these names from run to run: Cargo knows only the names
//! of tests, and the record of a filtered run contains only some tests.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use karat::unstable::record::{Record, Subject};
use serde::{Deserialize, Serialize};

/// The functions and goldens that each test checked in its last run, as stored in `subjects.json`.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(in crate::cli) struct Subjects {
    tests: BTreeMap<String, BTreeSet<String>>,
    /// The number of tests in the last complete run.
    count: Option<u64>,
    /// The tests that failed in the last run, including tests without a record.
    #[serde(default)]
    failed: Vec<String>,
    /// The folders and files of shaders that tests used.
    #[serde(default)]
    packages: BTreeSet<PathBuf>,
}

/// The name of the file with these subjects, beside the record of the last run.
const FILE: &str = "subjects.json";

impl Subjects {
    /// Reads the subjects of earlier runs from the folder of the last record.
    pub(in crate::cli) fn read(record: &Path) -> Self {
        let text = std::fs::read_to_string(record.with_file_name(FILE)).unwrap_or_default();
        serde_json::from_str(&text).unwrap_or_default()
    }

    /// Returns the number of tests in the last complete run, if there was one.
    pub(super) fn count(&self) -> Option<u64> {
        self.count
    }

    pub(super) fn failed(&self) -> &[String] {
        &self.failed
    }

    pub(in crate::cli) fn packages(&self) -> &BTreeSet<PathBuf> {
        &self.packages
    }

    /// Adds the packages that a run used. A complete run replaces the known packages.
    pub(super) fn add_packages(&mut self, used: BTreeSet<PathBuf>, whole: bool) {
        if whole {
            self.packages.clear();
        }
        self.packages.extend(used);
    }

    /// Adds the subjects of a run. If the run was complete, `whole` is the number of its tests, and the subjects of all
    /// other tests are removed.
    pub(super) fn add(&mut self, records: &[Record], whole: Option<u64>, failed: &[String]) {
        self.failed = failed.to_vec();
        self.count = whole.or(self.count);
        let ran: BTreeSet<&String> = records.iter().map(|record| &record.test).collect();
        self.tests.retain(|test, _| whole.is_none() && !ran.contains(test));
        for record in records {
            let name = match &record.subject {
                Subject::Function { function, .. } => function,
                Subject::Frame { golden, .. } => golden,
            };
            self.tests.entry(record.test.clone()).or_default().insert(name.clone());
        }
    }

    pub(super) fn write(&self, record: &Path) -> std::io::Result<()> {
        let text = serde_json::to_string(self).expect("it is plain data");
        std::fs::write(record.with_file_name(FILE), text)
    }

    /// Checks if a test checked a subject whose name contains `words`.
    pub(super) fn checks(&self, words: &str) -> bool {
        self.tests.values().flatten().any(|name| name.contains(words))
    }

    /// Returns the tests that checked a subject whose name contains `words`, without the tests whose own names contain
    /// `words`.
    pub(super) fn about(&self, words: &str) -> Vec<String> {
        let tests = self.tests.iter().filter(|(test, names)| {
            !test.contains(words) && names.iter().any(|name| name.contains(words))
        });
        tests.map(|(test, _)| test.clone()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(test: &str, function: &str) -> Record {
        let text = format!(
            r#"{{"schema":2,"test":"{test}","subject":{{"kind":"function","package":"p","function":"{function}",
            "check":"agrees_with","assertion":"4 ulp","location":"","seed":1}},"verdict":"pass","paths":[],"message":null}}"#
        );
        serde_json::from_str(&text).expect("a record")
    }

    #[test]
    fn a_filtered_run_forgets_no_other_test() {
        let folder = tempfile::tempdir().expect("a folder");
        let last = folder.path().join("run");
        let mut all = Subjects::read(&last);
        all.add(&[record("grazing", "fresnel::schlick"), record("lobe", "ggx::d")], Some(2), &[]);
        all.write(&last).expect("written");
        let mut again = Subjects::read(&last);
        again.add(&[record("grazing", "fresnel::conductor")], None, &["lost".to_owned()]);
        assert_eq!(again.about("schlick"), Vec::<String>::new(), "it checks another one now");
        assert_eq!(
            (again.about("fresnel"), again.failed()),
            (vec!["grazing".to_owned()], &["lost".to_owned()][..])
        );
        assert!(
            again.checks("ggx") && !again.checks("lobe"),
            "of tests only their names are known"
        );
        assert_eq!((again.about("ggx"), again.count()), (vec!["lobe".to_owned()], Some(2)));
        assert_eq!(again.about("lobe"), Vec::<String>::new(), "cargo finds it by its name");
        again.add(&[record("other", "a::b")], Some(1), &[]);
        assert_eq!(again.about("ggx"), Vec::<String>::new(), "a whole run has no such test");
        std::fs::write(last.with_file_name(FILE), "{").expect("written");
        assert_eq!(Subjects::read(&last).about("ggx"), Vec::<String>::new());
    }
}
