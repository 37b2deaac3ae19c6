//! The comparison of the provenance in a golden's image with the provenance in the file beside it.

use std::io::ErrorKind;
use std::path::Path;

use karat::Image;
use karat::unstable::golden::{Provenance, Table};
use serde::Serialize;

use super::files::{Golden, is_facts};

/// A golden whose provenance is missing or doesn't match its image.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Doubt {
    #[serde(flatten)]
    pub(super) golden: Golden,
    /// The problem, as a sentence.
    pub(super) problem: String,
}

/// The advice if the image of a golden doesn't match the provenance in the file beside it.
pub(super) const ADVICE: &str = "restore the image and its `.toml` from one commit; or delete both \
                                 files, run the test and accept its frame again";

impl Doubt {
    /// Finds the problem with a golden's provenance. Returns `None` if the golden's image and its `.toml` have the same
    /// provenance, or if another tool wrote the golden without provenance.
    pub(super) fn of(golden: &Golden) -> Option<Self> {
        let problem = problem(&golden.file, &golden.file.with_extension("toml"))?;
        Some(Self { golden: golden.clone(), problem })
    }
}

fn problem(image: &Path, beside: &Path) -> Option<String> {
    if image.extension().is_some_and(|ending| ending == "csv") {
        // A golden of values contains its provenance.
        return Table::read(image).err().map(|error| error.to_string());
    }
    let metadata = match Image::read_exr(image) {
        Ok((_, metadata)) => metadata,
        Err(error) => return Some(error.to_string()),
    };
    let (image, shown) = (image.display(), beside.display());
    let Some(metadata) = metadata else {
        let why = || {
            format!("`{shown}` has provenance, but another tool wrote `{image}` without provenance")
        };
        return is_facts(beside).then(why);
    };
    let held = match Provenance::parse(&metadata) {
        Ok(held) => held,
        Err(error) => return Some(format!("the provenance in `{image}` can't be read: {error}")),
    };
    let told = match std::fs::read_to_string(beside) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => {
            return Some(format!(
                "`{shown}` is missing: this file must contain the provenance of `{image}`"
            ));
        }
        Err(error) => return Some(format!("can't read `{shown}`: {error}")),
    };
    match toml::from_str::<Provenance>(&told) {
        Ok(told) if told == held => None,
        Ok(told) => {
            let others = differing(&told, &held).join("`, `");
            Some(format!(
                "`{shown}` differs from the provenance of `{image}` in the fields `{others}`"
            ))
        }
        Err(error) => Some(format!("`{shown}` has no readable provenance: {}", error.message())),
    }
}

/// Returns the names of the fields that differ.
fn differing(a: &Provenance, b: &Provenance) -> Vec<String> {
    let table = |facts| toml::Table::try_from(facts).unwrap_or_default();
    let (a, b) = (table(a), table(b));
    let mut names: Vec<String> = a.keys().chain(b.keys()).cloned().collect();
    names.sort();
    names.dedup();
    names.retain(|name| a.get(name) != b.get(name));
    names
}
