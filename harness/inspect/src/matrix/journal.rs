//! Recovers from rows that end the process. If a driver crashes, the process ends. If a driver hangs, the process must
//! end, because nothing else stops the driver. A file records which row runs on which path, so that the next process
//! can skip the row that ended the process.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use std::sync::Arc;

use karat::unstable::path::{Moment, watched};
use serde::{Deserialize, Serialize};

use super::{Cell, Column, Stop};

/// A line of the journal file.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Line {
    Began(At),
    /// The row exceeded the time limit. Holds a sentence with the details.
    Overdue(At, String),
    Ended(At),
    /// The process ended. Holds a text that says how the process ended.
    Process(String),
}

/// A row on a path. Without a path, the row is being prepared or compared.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
struct At {
    package: String,
    row: String,
    path: Option<String>,
}

/// A row that ran when a process ended.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Culprit {
    at: At,
    why: String,
}

/// The rows of a package that were running when earlier processes ended.
#[derive(Debug, Default)]
pub(super) struct Journal {
    file: Option<PathBuf>,
    package: String,
    /// For each row, an entry for each process that the row may have ended.
    culprits: BTreeMap<String, Vec<Culprit>>,
}

impl Journal {
    /// Reads a journal file. If the file doesn't exist, the journal has no rows, because no earlier process ended.
    pub(super) fn read(file: Option<&Path>, package: &str) -> io::Result<Self> {
        let mut journal = Self { package: package.to_owned(), ..Self::default() };
        let Some(file) = file else { return Ok(journal) };
        journal.file = Some(file.to_owned());
        for culprit in culprits(&lines(file)?) {
            if culprit.at.package == package {
                journal.culprits.entry(culprit.at.row.clone()).or_default().push(culprit);
            }
        }
        Ok(journal)
    }

    /// Checks if a row may have ended an earlier process. Such a row runs without other rows, so that Karat knows which
    /// row ends the process.
    pub(super) fn is_suspected(&self, row: &str) -> bool {
        self.culprits.contains_key(row)
    }

    /// Checks if a row ended a process in which it ran without other rows. In this case, the row doesn't run again, and
    /// its cells give the reason.
    pub(super) fn ends(&self, row: &str, columns: &[Column], cells: &mut [Cell]) -> bool {
        let Some([.., _, last]) = self.culprits.get(row).map(Vec::as_slice) else { return false };
        let runs = |(column, cell): &(&Column, &mut Cell)| match &cell.stopped {
            None => column.path().map(|path| path.to_string()),
            Some(_) => None,
        };
        let mut open: Vec<_> =
            columns.iter().zip(cells).filter(|pair| runs(pair).is_some()).collect();
        // If the row's path is unknown or isn't a column, the first open cell gets the reason.
        let blamed = open.iter().position(|pair| runs(pair) == last.at.path).unwrap_or(0);
        let on = open.get(blamed).map_or_else(String::new, |(column, _)| column.to_string());
        for (index, (_, cell)) in open.iter_mut().enumerate() {
            cell.stopped = Some(match index == blamed {
                true => Stop::Broke(last.why.clone()),
                false => Stop::NotRun(format!(
                    "Karat doesn't run the row here, because an earlier process ended while the row ran on `{on}`: {}",
                    last.why
                )),
            });
        }
        true
    }

    /// Runs a row, and records in the file on which path the row is running.
    pub(super) fn watched<T>(&self, row: &str, work: impl FnOnce() -> T) -> T {
        let Some(file) = self.file.clone() else { return work() };
        let row = At { package: self.package.clone(), row: row.to_owned(), path: None };
        // If this line can't be written and the process ends, the process isn't restarted. Its exit status shows how it
        // ended.
        let write = move |line: Line| drop(line.write(&file));
        let note = {
            let (write, row) = (write.clone(), row.clone());
            move |path: karat::path::Path, moment: Moment<'_>| {
                let at = At { path: Some(path.to_string()), ..row.clone() };
                write(match moment {
                    Moment::Begins => Line::Began(at),
                    Moment::Overdue(why) => Line::Overdue(at, why.to_owned()),
                    Moment::Ends => Line::Ended(at),
                });
            }
        };
        write(Line::Began(row.clone()));
        let result = watched(Arc::new(note), work);
        write(Line::Ended(row));
        result
    }
}

impl Line {
    fn write(&self, file: &Path) -> io::Result<()> {
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(file)?;
        // The process may have left an incomplete line, so this line begins with a line break.
        let begin = if matches!(self, Self::Process(_)) { "\n" } else { "" };
        file.write_all(format!("{begin}{}\n", serde_json::to_string(self)?).as_bytes())
    }
}

fn lines(file: &Path) -> io::Result<Vec<Line>> {
    let text = match std::fs::read_to_string(file) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => String::new(),
        text => text?,
    };
    // The process may have ended in the middle of a line.
    Ok(text.lines().filter_map(|line| serde_json::from_str(line).ok()).collect())
}

/// For each process that ended, the rows that were running. If some of these rows had exceeded the time limit, only
/// those rows are listed.
fn culprits(lines: &[Line]) -> Vec<Culprit> {
    let (mut culprits, mut running, mut overdue) = (Vec::new(), Vec::<At>::new(), Vec::new());
    for line in lines {
        match line {
            Line::Began(at) => running.push(at.clone()),
            Line::Ended(at) => {
                let last = running.iter().rposition(|one| one == at);
                last.map(|last| running.remove(last));
            }
            Line::Overdue(at, why) => {
                let same = |one: &Culprit| (&one.at.package, &one.at.row) == (&at.package, &at.row);
                if !overdue.iter().any(same) {
                    overdue.push(Culprit { at: at.clone(), why: why.clone() });
                }
            }
            Line::Process(how) => {
                let mut rows: BTreeMap<(String, String), At> = BTreeMap::new();
                // The last line of a row has the row's current path.
                for at in running.drain(..) {
                    rows.insert((at.package.clone(), at.row.clone()), at);
                }
                let crashed = rows.into_values().map(|at| {
                    let on =
                        at.path.as_ref().map_or_else(String::new, |path| format!(" on `{path}`"));
                    let why = format!("the process ended while `{}` ran{on}: {how}", at.row);
                    Culprit { at, why }
                });
                match overdue.is_empty() {
                    true => culprits.extend(crashed),
                    false => culprits.append(&mut overdue),
                }
            }
        }
    }
    culprits
}

/// Runs a program that makes matrices. If a row ends the program by exceeding the time limit or by a crash, restarts
/// the program. The program must use the same file in [`Request::journal`](super::Request::journal). Returns the exit
/// status of the last run.
///
/// # Errors
/// Returns an error if the program doesn't start, or if the file can't be read or written.
pub fn restarted(file: &Path, program: &mut Command) -> io::Result<ExitStatus> {
    loop {
        let before = culprits(&lines(file)?).len();
        let status = program.status()?;
        // A normal exit has a small exit code. After a crash, there is no exit code, or on Windows a large one.
        if status.code().is_some_and(|code| (0..=255).contains(&code)) || is_asked_to_end(status) {
            return Ok(status);
        }
        Line::Process(status.to_string()).write(file)?;
        if culprits(&lines(file)?).len() == before {
            return Ok(status);
        }
    }
}

/// Checks if a signal asked the process to end.
#[cfg(unix)]
fn is_asked_to_end(status: ExitStatus) -> bool {
    /// SIGHUP, SIGINT and SIGTERM, with the numbers that POSIX defines.
    const ASKING: [i32; 3] = [1, 2, 15];
    let signal = std::os::unix::process::ExitStatusExt::signal(&status);
    signal.is_some_and(|signal| ASKING.contains(&signal))
}

#[cfg(not(unix))]
fn is_asked_to_end(_: ExitStatus) -> bool {
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix::Status;

    fn at(package: &str, row: &str, path: Option<&str>) -> At {
        let [package, row] = [package, row].map(str::to_owned);
        At { package, row, path: path.map(str::to_owned) }
    }

    /// Karat suspects only the row that was running when the process ended. If this row ends a process again, Karat
    /// doesn't run the row a third time.
    // Lesson 161
    #[test]
    fn a_row_is_given_up_when_it_ends_the_process_alone() {
        let columns = ["gl", "vulkan", "msl"].map(|name| name.parse().expect("a column"));
        let hangs = |package: &str| {
            let at = at(package, "slow", Some("vulkan"));
            vec![
                Line::Began(at.clone()),
                Line::Overdue(at, "it hangs".to_owned()),
                Line::Process("signal: 6".to_owned()),
            ]
        };
        let crashes = |package: &str| {
            // The first row has finished, and waits for the second one.
            let over = at(package, "fast", Some("vulkan"));
            vec![
                Line::Began(at(package, "slow", None)),
                Line::Began(over.clone()),
                Line::Began(at(package, "slow", Some("vulkan"))),
                Line::Ended(over),
                Line::Process("signal: 11".to_owned()),
            ]
        };
        let crashed = "the process ended while `slow` ran on `vulkan`: signal: 11";
        for why in ["it hangs", crashed] {
            let lines = |package| if why == crashed { crashes(package) } else { hangs(package) };
            let folder = tempfile::tempdir().expect("a folder");
            let file = folder.path().join("journal");
            let read = || Journal::read(Some(&file), "p").expect("the journal can be read");
            let cell = Cell { status: Some(Status::Valid), ..Cell::default() };
            let mut cells = [cell.clone(), cell.clone(), cell];
            assert!(!read().is_suspected("slow"), "the file doesn't exist yet");
            for (times, package) in [(1, "p"), (1, "other"), (2, "p")] {
                for line in lines(package) {
                    line.write(&file).expect("written");
                }
                assert!(read().is_suspected("slow") && !read().is_suspected("fast"));
                assert_eq!(read().ends("slow", &columns, &mut cells), times == 2);
            }
            let [gl, vulkan, msl] = cells.map(|cell| cell.stopped);
            assert_eq!(vulkan, Some(Stop::Broke(why.to_owned())));
            assert!(gl.is_some_and(|stop| !stop.is_wrong() && stop.text().contains("`vulkan`")));
            assert_eq!(msl, None, "no path runs MSL");
        }
    }

    /// A row that crashes outside of its dispatches causes one finding. If the journal has an incomplete line, Karat
    /// still reads the other lines.
    #[test]
    fn a_row_that_crashes_before_its_dispatches_is_one_finding() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("journal");
        for _ in 0..2 {
            Line::Began(at("p", "r", None)).write(&file).expect("written");
            let mut half = std::fs::OpenOptions::new().append(true).open(&file).expect("there");
            half.write_all(b"{\"ended\":{\"pack").expect("written");
            Line::Process("signal: 11".to_owned()).write(&file).expect("written");
        }
        let columns = ["gl", "vulkan", "msl"].map(|name| name.parse().expect("a column"));
        let cell = Cell { status: Some(Status::Valid), ..Cell::default() };
        let mut cells = [cell.clone(), cell.clone(), cell];
        assert!(Journal::read(Some(&file), "p").expect("read").ends("r", &columns, &mut cells));
        let wrong = cells.iter().filter(|cell| cell.stopped.as_ref().is_some_and(Stop::is_wrong));
        assert_eq!(wrong.count(), 1, "{cells:?}");
    }

    /// If a process ends while no row runs, Karat suspects no row.
    // Lesson 162
    #[test]
    fn a_process_that_ends_between_rows_has_no_culprit() {
        let row = at("p", "r", None);
        let lines = [Line::Began(row.clone()), Line::Ended(row), Line::Process("no".to_owned())];
        assert_eq!(culprits(&lines), []);
    }
}
