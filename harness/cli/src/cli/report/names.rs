//! What records are called, alike in every table, page and file. Crates of a workspace may have frames of one
//! name: then each has its crate's name, too.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use karat::Goldens;
use karat::record::{Record, Subject};

/// Names of frames that several folders of goldens have.
#[derive(Debug, Default)]
pub(in crate::cli) struct Names {
    /// By golden and folder: `lamp::dusk`.
    told_apart: BTreeMap<(String, String), String>,
}

impl Names {
    pub(in crate::cli) fn of(records: &[Record]) -> Self {
        let mut folders: BTreeMap<&str, BTreeMap<&str, &str>> = BTreeMap::new();
        for record in records {
            if let Subject::Frame { golden, folder, .. } = &record.subject {
                let known = folders.entry(golden).or_default();
                known.entry(folder).or_insert(&record.cargo_package);
            }
        }
        let mut told_apart = BTreeMap::new();
        for (golden, folders) in folders.into_iter().filter(|(_, folders)| folders.len() > 1) {
            // The folder's own package, or that of the test where the record is of another machine.
            let of = |(folder, tests): (&&str, &&str)| match &*Goldens::open(Path::new(folder))
                .cargo_package()
            {
                own if Path::new(folder).is_dir() && !own.is_empty() => own.to_owned(),
                _ => (*tests).to_owned(),
            };
            let crates: Vec<String> = folders.iter().map(of).collect();
            let distinct = crates.iter().collect::<BTreeSet<_>>().len() == crates.len();
            for (folder, krate) in folders.keys().zip(&crates) {
                let krate = if distinct && !krate.is_empty() { krate } else { *folder };
                let name = format!("{krate}::{golden}");
                told_apart.insert((golden.to_owned(), (*folder).to_owned()), name);
            }
        }
        Self { told_apart }
    }

    /// The name of a frame.
    pub(in crate::cli) fn frame(&self, golden: &str, folder: &str) -> String {
        let known = self.told_apart.get(&(golden.to_owned(), folder.to_owned()));
        known.map_or_else(|| golden.to_owned(), String::clone)
    }

    /// What a record is about, in words: `fresnel::schlick agrees_with`, `frame scene`.
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
    use karat::record::Verdict;

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
    }
}
