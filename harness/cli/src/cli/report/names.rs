//! The names of records, which are the same in every table, page and file, and for `karat accept`. If several crates
//! have frames of one name, each name has its crate, too.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use karat::Goldens;
use karat::unstable::diagnostic::shown;
use karat::unstable::record::{Record, Subject};

/// A folder of goldens that shares a frame's name with other folders.
#[derive(Clone, Debug)]
pub(in crate::cli) struct Home {
    /// Its Cargo package; empty if unknown.
    pub(in crate::cli) krate: String,
    /// The folder, relative to its project.
    pub(in crate::cli) folder: String,
}

impl Home {
    /// Returns the folder of goldens that a record's frame was compared with.
    fn of(record: &Record, folder: &str) -> Self {
        // A record from another machine has its test's package, and a folder that doesn't exist here.
        if !Path::new(folder).is_dir() {
            return Self { krate: record.cargo_package.clone(), folder: folder.to_owned() };
        }
        let goldens = Goldens::open(Path::new(folder));
        let krate = match goldens.cargo_package() {
            none if none.is_empty() => record.cargo_package.clone(),
            own => own,
        };
        Self { krate, folder: below_project(&goldens) }
    }
}

/// Returns the distinct names of frames that several folders have under one name, by folder: `lamp::dusk`, or with
/// the folder if two folders are of one crate. Returns `None` if there is one folder.
pub(in crate::cli) fn told_apart(
    case: &str,
    homes: &BTreeMap<PathBuf, Home>,
) -> BTreeMap<PathBuf, String> {
    if homes.len() < 2 {
        return BTreeMap::new();
    }
    let crates: BTreeSet<&str> = homes.values().map(|home| &*home.krate).collect();
    let distinct = crates.len() == homes.len();
    let names = homes.iter().map(|(place, home)| {
        let of = if distinct && !home.krate.is_empty() { &home.krate } else { &home.folder };
        (place.clone(), format!("{of}::{case}"))
    });
    names.collect()
}

/// Returns the folder of goldens relative to its project's root, with `/`, or else relative to the working directory.
pub(in crate::cli) fn below_project(goldens: &Goldens) -> String {
    let folder = goldens.folder();
    let below = || {
        let (project, place) = (goldens.project()?, folder.canonicalize().ok()?);
        let below = place.strip_prefix(project).ok()?;
        let parts: Vec<_> = below.iter().map(|part| part.to_string_lossy()).collect();
        Some(parts.join("/")).filter(|below| !below.is_empty())
    };
    below().unwrap_or_else(|| shown(&folder))
}

/// Names of frames that several folders of goldens have.
#[derive(Debug, Default)]
pub(in crate::cli) struct Names {
    /// By golden and folder: `lamp::dusk`.
    told_apart: BTreeMap<(String, PathBuf), String>,
}

impl Names {
    pub(in crate::cli) fn of(records: &[Record]) -> Self {
        let mut folders: BTreeMap<&str, BTreeMap<&str, &Record>> = BTreeMap::new();
        for record in records {
            if let Subject::Frame { golden, folder, .. } = &record.subject {
                let known = folders.entry(golden).or_default();
                known.entry(folder).or_insert(record);
            }
        }
        let mut names = BTreeMap::new();
        for (golden, folders) in folders.into_iter().filter(|(_, folders)| folders.len() > 1) {
            let home = |(folder, record): (&str, &Record)| {
                (PathBuf::from(folder), Home::of(record, folder))
            };
            let homes: BTreeMap<PathBuf, Home> = folders.into_iter().map(home).collect();
            for (folder, name) in told_apart(golden, &homes) {
                names.insert((golden.to_owned(), folder), name);
            }
        }
        Self { told_apart: names }
    }

    /// Returns the name of a frame.
    pub(in crate::cli) fn frame(&self, golden: &str, folder: &str) -> String {
        let known = self.told_apart.get(&(golden.to_owned(), PathBuf::from(folder)));
        known.map_or_else(|| golden.to_owned(), String::clone)
    }

    /// Returns the subject of a record: `fresnel::schlick agrees_with`, `frame scene`.
    pub(in crate::cli) fn subject(&self, record: &Record) -> String {
        match &record.subject {
            Subject::Function { function, check, .. } => format!("{function} {check}"),
            Subject::Frame { golden, folder, .. } => {
                format!("frame {}", self.frame(golden, folder))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::tables::tests::record;
    use super::*;
    use karat::unstable::record::Verdict;

    // Lesson 179: in reports
    #[test]
    fn frames_of_one_name_have_their_crates() {
        let frame = |golden: &str, folder: &str, krate: &str| {
            let (golden, folder, location) = (golden.into(), folder.into(), String::new());
            let mut frame = record(Verdict::Pass, 0, None);
            frame.subject = Subject::Frame { golden, folder, location };
            frame.cargo_package = krate.to_owned();
            frame
        };
        let names = |records: &[Record]| {
            let names = Names::of(records);
            records.iter().map(|record| names.subject(record)).collect::<Vec<_>>()
        };
        let (a, b) = (frame("dusk", "/w/a/golden", "a"), frame("dusk", "/w/b/golden", "b"));
        let sky = frame("sky", "/w/a/golden", "a");
        assert_eq!(names(&[a.clone(), sky.clone()]), ["frame dusk", "frame sky"]);
        let all = names(&[a.clone(), b, sky]);
        assert_eq!(all, ["frame a::dusk", "frame b::dusk", "frame sky"]);
        // One crate may have two folders.
        let all = names(&[a, frame("dusk", "/w/a/other", "a")]);
        assert_eq!(all, ["frame /w/a/golden::dusk", "frame /w/a/other::dusk"]);
        // An existing folder is named by its place in the project.
        let project = tempfile::tempdir().expect("a folder");
        std::fs::write(project.path().join("Cargo.lock"), "").expect("a file");
        let here = |name: &str| {
            let folder = project.path().join("a").join(name);
            std::fs::create_dir_all(&folder).expect("a folder");
            frame("dusk", &folder.display().to_string(), "a")
        };
        let all = names(&[here("golden"), here("other")]);
        assert_eq!(all, ["frame a/golden::dusk", "frame a/other::dusk"]);
    }
}
