//! Folders of records. Each run has its own folder, and the file `last` names the run that ended last.
//!
//! The crate `ci` also compiles this file, so the file uses only the standard library. While a process changes a folder
//! of records, it holds a lock on the file `lock`, so other processes wait. A run holds a lock on the file `running` in
//! its own folder until its process ends. If a run was killed, no process holds the lock on its file `running`. The
//! next run that begins or ends removes the folder of the killed run.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Error, ErrorKind, Result};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The file that names the run that ended last.
const LAST: &str = "last";
const RUN: &str = "run-";
/// The file that a run locks until its process ends.
pub(crate) const RUNNING: &str = "running";
/// The file that a process locks while it reads records, or changes the folder of records.
const LOCK: &str = "lock";
/// Longest wait for the lock on `lock`. Other processes hold this lock while they read records.
const PATIENCE: Duration = Duration::from_secs(30);
const PAUSE: Duration = Duration::from_millis(5);

/// A run that hasn't ended. If the run is killed, a later run removes its folder.
#[derive(Debug)]
pub struct Running {
    records: PathBuf,
    folder: PathBuf,
    /// The locked file `running`; `None` if the run has ended, or if the file system has no locks.
    held: Option<File>,
    ended: bool,
}

impl Running {
    /// Creates the folder of a run in a folder of records, and removes the folders of killed runs.
    ///
    /// # Errors
    /// Returns an error if the folder can't be created.
    pub fn begin(records: &Path) -> Result<Self> {
        std::fs::create_dir_all(records)?;
        let turn = Turn::wait(records, File::try_lock)?;
        turn.clear(records);
        let process = std::process::id();
        let mut names = (0_u32..).map(|count| format!("{RUN}{process}-{count}"));
        let folder = loop {
            let folder = records.join(names.next().expect("numbers enough"));
            match std::fs::create_dir(&folder) {
                // Another process had this number. That process has ended, or runs in another container.
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                made => break made.map(|()| folder)?,
            }
        };
        let held = File::create(folder.join(RUNNING))?;
        let held = held.try_lock().is_ok().then_some(held);
        Ok(Self { records: records.to_owned(), folder, held, ended: false })
    }

    /// The folder into which the run's processes write records (`KARAT_RECORD`).
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Writes the name of this run into the file `last` in one atomic step, and removes the folder of the previous last
    /// run.
    ///
    /// # Errors
    /// Returns an error if Karat can't write `last`. Then `last` still names the previous run.
    pub fn end(mut self) -> Result<PathBuf> {
        let turn = Turn::wait(&self.records, File::try_lock)?;
        let name = self.folder.file_name().unwrap_or_default();
        // Only the process that holds the lock writes this file.
        let beside = self.records.join(format!("{LAST}.tmp"));
        std::fs::write(&beside, name.as_encoded_bytes())?;
        std::fs::rename(&beside, self.records.join(LAST))?;
        self.ended = true;
        self.held = None;
        drop(std::fs::remove_file(self.folder.join(RUNNING)));
        turn.clear(&self.records);
        Ok(std::mem::take(&mut self.folder))
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if !self.ended {
            // Some systems can't remove an open file. The next run removes the folder if the folder still exists.
            self.held = None;
            drop(std::fs::remove_dir_all(&self.folder));
        }
    }
}

/// The folder of the run that ended last, if `last` names one.
pub(crate) fn last(records: &Path) -> Option<PathBuf> {
    let name = std::fs::read_to_string(records.join(LAST)).ok()?;
    let sound = |c: char| c.is_ascii_digit() || c == '-';
    let is_run = name.strip_prefix(RUN).is_some_and(|rest| rest.chars().all(sound));
    is_run.then(|| records.join(name))
}

/// The lock of a folder of records. While a process holds the lock, no other process changes the folder.
#[derive(Debug)]
pub(crate) struct Turn {
    /// The locked file `lock`; `None` if the file system has no locks, or if the folder is read-only and has no lock
    /// file.
    held: Option<File>,
}

impl Turn {
    /// Waits for the lock. The function `take` takes the lock: `File::try_lock` for a process that writes, and
    /// `File::try_lock_shared` for a process that reads.
    ///
    /// # Errors
    /// Returns an error if another process holds the lock for more than 30 seconds.
    pub(crate) fn wait(
        records: &Path,
        take: impl Fn(&File) -> std::result::Result<(), TryLockError>,
    ) -> Result<Self> {
        let place = records.join(LOCK);
        let opened = OpenOptions::new().create(true).append(true).open(&place);
        // A downloaded folder, or the folder of another user, may be read-only.
        let Ok(file) = opened.or_else(|_| File::open(&place)) else {
            return Ok(Self { held: None });
        };
        let begun = Instant::now();
        loop {
            match take(&file) {
                Ok(()) => return Ok(Self { held: Some(file) }),
                Err(TryLockError::Error(_)) => return Ok(Self { held: None }),
                Err(TryLockError::WouldBlock) if begun.elapsed() > PATIENCE => {
                    let place = place.display();
                    let reason = format!(
                        "another process has locked `{place}` for 30 seconds: wait until that process ends"
                    );
                    return Err(Error::new(ErrorKind::TimedOut, reason));
                }
                Err(TryLockError::WouldBlock) => std::thread::sleep(PAUSE),
            }
        }
    }

    /// Removes the folders of runs that ended or were killed. Keeps the folder of the run that ended last.
    fn clear(&self, records: &Path) {
        // Without locks, Karat can't recognise runs that still go on.
        if self.held.is_none() {
            return;
        }
        // If the name of the last run can't be read, each folder may be the folder of the last run.
        let named = std::fs::read_to_string(records.join(LAST));
        if named.is_err_and(|error| error.kind() != ErrorKind::NotFound) {
            return;
        }
        for folder in dead(records) {
            // A folder that can't be removed does no harm, so the error is ignored.
            drop(std::fs::remove_dir_all(&folder));
        }
    }
}

/// The folders of runs that ended or were killed, without the folder of the run that ended last.
pub(crate) fn dead(records: &Path) -> Vec<PathBuf> {
    let last = last(records);
    let mut found = Vec::new();
    for entry in std::fs::read_dir(records).into_iter().flatten().flatten() {
        let folder = entry.path();
        let is_run = entry.file_name().to_string_lossy().starts_with(RUN)
            && entry.file_type().is_ok_and(|kind| kind.is_dir());
        if is_run && last.as_ref() != Some(&folder) && is_dead(&folder) {
            found.push(folder);
        }
    }
    found
}

fn is_dead(folder: &Path) -> bool {
    match File::open(folder.join(RUNNING)) {
        Ok(file) => file.try_lock().is_ok(),
        // The run ended, or its tests created the folder again after another run removed the folder.
        Err(error) => error.kind() == ErrorKind::NotFound,
    }
}
