//! The displayed names of the functions and frames in records. All tables, pages and files use the same names, and
//! `karat accept` takes these names as arguments. If several crates have frames of the same name, the name includes the
//! crate.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use karat::Goldens;
use karat::unstable::diagnostic::shown;
use karat::unstable::record::{Record, Subject};

/// A folder of goldens that has frame names in common with other folders.
#[derive(Clone, Debug)]
pub(in crate::cli) struct Home {
    /// The Cargo package of the folder. The name is empty if the package is unknown.
    pub(in crate::cli) krate: String,
    /// The folder, relative to its project.
    pub(in crate::cli) folder: String,
}

impl Home {
    /// Returns the folder of goldens that a record's frame was compared with.
    fn of(record: &Record, folder: &str) -> Self {
        // A record from another machine has the package of its test, and a folder that doesn't exist on this machine.
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

/// Returns a distinct name for each folder that has a frame of this name, such as `lamp::dusk`. If two folders belong
/// to one crate, the names contain the folders in place of the crates. If there is only one folder, returns an empty
/// map, because the frame's own name is enough.
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

/// Returns the path of a folder of goldens, with `/` as the separator. The path is relative to the project's root if
/// the folder is inside the project.
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

/// The names of frames that several folders of goldens have.
#[derive(Debug, Default)]
pub(in crate::cli) struct Names {
    /// The distinct names, by golden and folder: `lamp::dusk`.
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

    pub(in crate::cli) fn frame(&self, golden: &str, folder: &str) -> String {
        let known = self.told_apart.get(&(golden.to_owned(), PathBuf::from(folder)));
        known.map_or_else(|| golden.to_owned(), String::clone)
    }

    /// Returns the subject of a record as text: `fresnel::schlick agrees_with`, `frame scene`.
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
    fn frames_with_equal_names_are_shown_with_crate_or_folder() {
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
        // An existing folder is named by its path in the project.
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
