//! The history of a golden in git: its versions with their reasons and contents.

use std::fmt::Display;
use std::io::Write;
use std::path::Path;

use karat::Image;
use karat::unstable::golden::Table;
use karat::unstable::image::ExrFile;
use serde_json::{Value, json};

use super::git;

/// The largest number of versions to list.
const MOST: &str = "30";

/// Lists each commit that changed a golden, with the reason from its provenance. The latest commit is first.
pub(super) fn versions(golden: &Path) -> Vec<Value> {
    let (Some(folder), Some(name)) = (golden.parent(), golden.file_name()) else {
        return Vec::new();
    };
    let is_table = super::is_table(golden);
    let name = name.to_string_lossy();
    // A table contains its provenance.
    let beside = golden.with_extension("toml");
    let beside = beside.file_name().unwrap_or_default().to_string_lossy();
    let facts = if is_table { &name } else { &beside };
    let paths = [git::literal(&name), git::literal(facts)];
    let format = "--format=%h%x1f%as%x1f%an%x1f%s";
    let log = git::text(folder, &["log", "-n", MOST, format, "--", &paths[0], &paths[1]]);
    let version = |line: &str| {
        let mut fields = line.split('\u{1f}');
        let (commit, date, author, subject) =
            (fields.next()?, fields.next()?, fields.next()?, fields.next()?);
        let text = git::text(folder, &["show", &format!("{commit}:./{facts}")]).unwrap_or_default();
        let comments = || text.lines().map_while(|line| line.strip_prefix('#'));
        let text = if is_table { comments().collect::<Vec<_>>().join("\n") } else { text.clone() };
        let facts: toml::Table = text.parse().unwrap_or_default();
        let fact = |name: &str| facts.get(name).and_then(toml::Value::as_str).unwrap_or_default();
        Some(json!({
            "commit": commit, "date": date, "author": author, "subject": subject,
            "because": fact("because"), "by": fact("accepted_by"), "at": fact("accepted_at"),
            "pixels": fact("pixels"),
        }))
    };
    log.unwrap_or_default().lines().filter_map(version).collect()
}

#[derive(Debug, thiserror::Error)]
pub(super) enum VersionError {
    #[error("the requested commit isn't a version of the golden")]
    Unknown,
    #[error("commit {0} doesn't have the golden's file")]
    Absent(String),
    #[error("the golden's file can't be unpacked: {0}")]
    Unpacked(std::io::Error),
    #[error("{0}")]
    Damaged(String),
}

/// Returns the image of a golden in one of its [`versions`].
pub(super) fn image(golden: &Path, commit: &str) -> Result<Image, VersionError> {
    let file = read(golden, commit, ExrFile::read)?;
    let first = file.parts.into_iter().next();
    first.map(|part| part.image).ok_or_else(|| VersionError::Absent(commit.to_owned()))
}

/// Returns the table of a golden in one of its [`versions`].
pub(super) fn table(golden: &Path, commit: &str) -> Result<Table, VersionError> {
    read(golden, commit, Table::read).map(|(table, _)| table)
}

/// Reads the file of a golden in one of its [`versions`].
fn read<T, E: Display>(
    golden: &Path,
    commit: &str,
    read: impl Fn(&Path) -> Result<T, E>,
) -> Result<T, VersionError> {
    // The commit comes from a browser, so it becomes an argument of git only if git has listed it.
    let is_known = |version: &Value| version["commit"] == commit;
    let (Some(folder), Some(name)) = (golden.parent(), golden.file_name()) else {
        return Err(VersionError::Unknown);
    };
    if !versions(golden).iter().any(is_known) {
        return Err(VersionError::Unknown);
    }
    let place = format!("{commit}:./{}", name.to_string_lossy());
    let bytes = git::bytes(folder, &["show", &place]);
    let bytes = bytes.ok_or_else(|| VersionError::Absent(commit.to_owned()))?;
    let mut file = tempfile::NamedTempFile::new().map_err(VersionError::Unpacked)?;
    file.write_all(&bytes).map_err(VersionError::Unpacked)?;
    // The name of the temporary file would tell a reader nothing.
    let unnamed =
        |error: String| error.replace(&karat::unstable::diagnostic::shown(file.path()), &place);
    read(file.path()).map_err(|error| VersionError::Damaged(unnamed(error.to_string())))
}
