//! Rows that pass the deadline. Nothing else can be done about a driver that hangs than to end the process:
//! so it notes which row that was, and begins again without it.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::{Cell, Column, Stop};
use crate::path::on_deadline;

/// A line of the file: a row that was running when the process ended.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Note {
    package: String,
    row: String,
    /// The path that it ran on.
    column: String,
    /// The row that didn't finish, in a sentence.
    why: String,
}

/// The notes of earlier processes on a package.
#[derive(Debug, Default)]
pub(super) struct Overdue {
    file: Option<PathBuf>,
    package: String,
    notes: BTreeMap<String, Vec<Note>>,
}

impl Overdue {
    /// Reads a file; nothing is noted where there is none.
    pub(super) fn read(file: Option<&Path>, package: &str) -> io::Result<Self> {
        let mut overdue = Self { package: package.to_owned(), ..Self::default() };
        let Some(file) = file else { return Ok(overdue) };
        overdue.file = Some(file.to_owned());
        let text = match std::fs::read_to_string(file) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
            text => text?,
        };
        for line in text.lines() {
            let note: Note = serde_json::from_str(line)?;
            if note.package == package {
                overdue.notes.entry(note.row.clone()).or_default().push(note);
            }
        }
        Ok(overdue)
    }

    /// True if a row is suspected, so that it runs alone: another one that ran beside it may have been
    /// what hung.
    pub(super) fn is_suspected(&self, row: &str) -> bool {
        self.notes.contains_key(row)
    }

    /// True if a row isn't run, as it has passed the deadline alone: its cells then say so.
    pub(super) fn ends(&self, row: &str, columns: &[Column], cells: &mut [Cell]) -> bool {
        let Some([.., _, last]) = self.notes.get(row).map(Vec::as_slice) else { return false };
        for (column, cell) in columns.iter().zip(cells) {
            let Some(path) = column.path().filter(|_| cell.stopped.is_none()) else { continue };
            cell.stopped = Some(match path.to_string() == last.column {
                true => Stop::Broke(last.why.clone()),
                false => {
                    let Note { column, why, .. } = last;
                    Stop::NotRun(format!("it isn't run, as it hangs `{column}`: {why}"))
                }
            });
        }
        true
    }

    /// Runs a row, of which a note is made if the deadline ends the process.
    pub(super) fn watched<T>(&self, row: &str, work: impl FnOnce() -> T) -> T {
        let Some(file) = self.file.clone() else { return work() };
        let (package, row) = (self.package.clone(), row.to_owned());
        let note = move |path: crate::path::Path, why: &str| {
            let (column, why) = (path.to_string(), why.to_owned());
            let note = Note { package: package.clone(), row: row.clone(), column, why };
            // The process ends in any case; without a note it doesn't begin again.
            drop(note.write(&file));
        };
        on_deadline(Arc::new(note), work)
    }
}

impl Note {
    fn write(&self, file: &Path) -> io::Result<()> {
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(file)?;
        file.write_all(format!("{}\n", serde_json::to_string(self)?).as_bytes())
    }
}

/// Runs a program that makes matrices, and again as often as a row of them has passed the deadline,
/// which ends the program. It passes the same file to [`Request::overdue`](super::Request::overdue). How
/// the last one ended.
///
/// ```no_run
/// use std::path::Path;
/// use std::process::Command;
///
/// let file = Path::new("target/overdue.jsonl"); // which isn't there yet
/// let mut program = Command::new("makes-matrices");
/// let status = karat::matrix::restarted(file, program.arg(file))?;
/// assert!(status.success());
/// # Ok::<(), std::io::Error>(())
/// ```
///
/// # Errors
/// If the program can't be run.
pub fn restarted(file: &Path, program: &mut Command) -> io::Result<ExitStatus> {
    let noted = || std::fs::metadata(file).map_or(0, |facts| facts.len());
    loop {
        let before = noted();
        let status = program.status()?;
        if status.success() || noted() == before {
            return Ok(status);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix::Status;

    /// The one that was noted first may have waited for the one that hung.
    #[test]
    fn a_row_is_given_up_when_it_hangs_alone() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("overdue");
        let read = || Overdue::read(Some(&file), "p").expect("it is read");
        let columns = ["gl", "vulkan", "msl"].map(|name| name.parse().expect("a column"));
        let cell = Cell { status: Some(Status::Valid), ..Cell::default() };
        let mut cells = [cell.clone(), cell.clone(), cell];
        assert!(!read().is_suspected("slow"), "there is no file yet");
        for (times, package) in [(1, "p"), (1, "other"), (2, "p")] {
            let [package, row, column, why] =
                [package, "slow", "vulkan", "it hangs"].map(str::to_owned);
            Note { package, row, column, why }.write(&file).expect("written");
            assert!(read().is_suspected("slow") && !read().is_suspected("fast"));
            assert_eq!(read().ends("slow", &columns, &mut cells), times == 2);
        }
        let [gl, vulkan, msl] = cells.map(|cell| cell.stopped);
        assert_eq!(vulkan, Some(Stop::Broke("it hangs".to_owned())));
        assert!(gl.is_some_and(|stop| !stop.is_wrong() && stop.text().contains("`vulkan`")));
        assert_eq!(msl, None, "nothing runs there");
    }
}
