//! The files in a folder of goldens.

use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};

use anyhow::Context;
use karat::unstable::golden::Provenance;
use karat::unstable::image::{is_beside, is_leftover};
use serde::Serialize;

#[derive(Clone, Debug, Serialize)]
pub(super) struct Golden {
    pub(super) case: String,
    /// The profile of the golden. `None` means that the golden applies to all profiles.
    pub(super) profile: Option<String>,
    pub(super) file: PathBuf,
}

impl Golden {
    /// Checks if the golden contains values and their provenance, and not a frame.
    pub(super) fn is_table(&self) -> bool {
        self.file.extension().is_some_and(|ending| ending == "csv")
    }
}

/// Formats the golden as `scene` or `scene of profile gl-nvidia`.
impl fmt::Display for Golden {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.case)?;
        self.profile.as_ref().map_or(Ok(()), |profile| write!(f, " of profile {profile}"))
    }
}

#[derive(Clone, Debug, Serialize)]
pub(super) struct Stray {
    pub(super) file: PathBuf,
    pub(super) reason: &'static str,
    /// `true` if Karat wrote the file, and may delete it.
    #[serde(skip)]
    pub(super) is_ours: bool,
}

/// The goldens in a folder and its subfolders, and the stray files there, in the order of their names.
#[derive(Debug, Default)]
pub(super) struct Files {
    pub(super) goldens: Vec<Golden>,
    pub(super) stray: Vec<Stray>,
}

/// The endings of the files that Karat writes beside a golden: provenance, pending images and values, and previews.
const COMPANIONS: [&str; 5] = [".new.exr", ".new.csv", ".new.png", ".toml", ".png"];

/// The reason why a temporary file exists: a process was killed after it wrote the file and before it renamed the file.
const LEFTOVER: &str = "an interrupted acceptance or test left this file";

impl Files {
    pub(super) fn of(folder: &Path) -> anyhow::Result<Self> {
        let mut all = BTreeSet::new();
        walk(folder, &mut all)?;
        let mut files = Self::default();
        for file in &all {
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            let hidden = name.starts_with('.');
            if is_beside(file) {
                // A file that is being written is neither golden nor stray.
                if is_leftover(file) {
                    files.push(file, LEFTOVER, true);
                }
                continue;
            }
            let Some((stem, ending)) = split(&name) else {
                // Hidden files and Markdown files are for Git and for people.
                if !hidden && !name.ends_with(".md") {
                    files.push(file, "this file doesn't belong to a golden", false);
                }
                continue;
            };
            let golden = file.with_file_name(format!("{stem}.exr"));
            match ending {
                ".exr" | ".csv" => files.goldens.push(name_of(folder, file, stem)),
                // A pending image may have no golden.
                ".new.exr" | ".new.csv" => {}
                _ if all.contains(&golden) => {}
                ".new.png" if all.contains(&file.with_file_name(format!("{stem}.new.exr"))) => {}
                ".toml" => files.push(
                    file,
                    "this file is the provenance of a golden that doesn't exist",
                    is_facts(file),
                ),
                _ => files.push(
                    file,
                    "this file is the preview of an image that doesn't exist",
                    false,
                ),
            }
        }
        Ok(files)
    }

    fn push(&mut self, file: &Path, reason: &'static str, is_ours: bool) {
        self.stray.push(Stray { file: file.to_owned(), reason, is_ours });
    }
}

/// Checks if a file contains the provenance of a golden.
pub(super) fn is_facts(file: &Path) -> bool {
    let text = std::fs::read_to_string(file).unwrap_or_default();
    toml::from_str::<Provenance>(&text).is_ok()
}

/// Splits a file name into a golden's name and the ending. Returns `None` if the ending isn't one of Karat's.
fn split(name: &str) -> Option<(&str, &'static str)> {
    let endings = COMPANIONS.into_iter().chain([".exr", ".csv"]);
    let mut split = endings.filter_map(|ending| Some((name.strip_suffix(ending)?, ending)));
    split.next().filter(|(stem, _)| !stem.is_empty())
}

fn name_of(folder: &Path, file: &Path, stem: &str) -> Golden {
    let relative = file.strip_prefix(folder).unwrap_or(file).with_file_name(stem);
    let mut parts: Vec<String> =
        relative.iter().map(|part| part.to_string_lossy().into_owned()).collect();
    let profile = parts.first().and_then(|first| first.strip_prefix('@')).map(str::to_owned);
    if profile.is_some() {
        parts.remove(0);
    }
    Golden { case: parts.join("/"), profile, file: file.to_owned() }
}

fn walk(folder: &Path, found: &mut BTreeSet<PathBuf>) -> anyhow::Result<()> {
    let failed = || format!("can't read the folder `{}`", folder.display());
    for entry in std::fs::read_dir(folder).with_context(failed)? {
        let entry = entry.with_context(failed)?;
        // A link to a folder may lead anywhere.
        if entry.file_type().with_context(failed)?.is_dir() {
            walk(&entry.path(), found)?;
        } else {
            found.insert(entry.path());
        }
    }
    Ok(())
}
