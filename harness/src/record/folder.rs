//! Folders of records: each run has its own, and the file `last` names the run that ended last.
//!
//! `ci` compiles this file, too, so it uses nothing but the standard library. Only one process at a
//! time changes a folder of records (`lock`). A run holds a lock on the file `running` in its own
//! folder as long as it lives. So a run that was killed is noticed, and removed when another begins
//! or ends.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Error, ErrorKind, Result};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Names the folder of the run that ended last.
const LAST: &str = "last";
/// How folders of runs begin.
const RUN: &str = "run-";
/// Held by a run that lives.
pub(crate) const RUNNING: &str = "running";
/// Held by whoever looks at all runs, or changes which are there.
const LOCK: &str = "lock";
/// How long a turn is waited for. It takes the time to read a record.
const PATIENCE: Duration = Duration::from_secs(30);
/// Between two looks.
const PAUSE: Duration = Duration::from_millis(5);

/// A run that hasn't ended. If it never ends, its folder is removed.
#[derive(Debug)]
pub struct Running {
    records: PathBuf,
    folder: PathBuf,
    /// `None`: it has ended, or the file system knows no locks.
    held: Option<File>,
    ended: bool,
}

impl Running {
    /// Makes the folder of a run in a folder of records, and removes the folders of killed runs.
    ///
    /// # Errors
    /// If the folder can't be made.
    pub fn begin(records: &Path) -> Result<Self> {
        std::fs::create_dir_all(records)?;
        let turn = Turn::wait(records, File::try_lock)?;
        turn.clear(records);
        let process = std::process::id();
        let mut names = (0_u32..).map(|count| format!("{RUN}{process}-{count}"));
        let folder = loop {
            let folder = records.join(names.next().expect("numbers enough"));
            match std::fs::create_dir(&folder) {
                // Of a process of the same number, that ended or is in another container.
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                made => break made.map(|()| folder)?,
            }
        };
        let held = File::create(folder.join(RUNNING))?;
        let held = held.try_lock().is_ok().then_some(held);
        Ok(Self { records: records.to_owned(), folder, held, ended: false })
    }

    /// The folder that its processes write records into (`KARAT_RECORD`).
    #[must_use]
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Makes this the run that ended last, in one step, and removes the run before it.
    ///
    /// # Errors
    /// If that can't be written. Then the run before it stays the last one.
    pub fn end(mut self) -> Result<PathBuf> {
        let turn = Turn::wait(&self.records, File::try_lock)?;
        let name = self.folder.file_name().unwrap_or_default();
        // Nobody else has this name, since turns are taken.
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
            // Some systems remove no file that is open. What stays is cleared away by the next run.
            self.held = None;
            drop(std::fs::remove_dir_all(&self.folder));
        }
    }
}

/// The folder of the run that ended last, if a folder of records says which one did.
pub(crate) fn last(records: &Path) -> Option<PathBuf> {
    let name = std::fs::read_to_string(records.join(LAST)).ok()?;
    let sound = |c: char| c.is_ascii_digit() || c == '-';
    let is_run = name.strip_prefix(RUN).is_some_and(|rest| rest.chars().all(sound));
    is_run.then(|| records.join(name))
}

/// What is done to a folder of records while nobody else changes it.
#[derive(Debug)]
pub(crate) struct Turn {
    /// `None`: the file system knows no locks, or there is none as nobody changes the folder.
    held: Option<File>,
}

impl Turn {
    /// Waits for a turn: `File::try_lock` to change something, `File::try_lock_shared` to read.
    ///
    /// # Errors
    /// If another process stays in its turn.
    pub(crate) fn wait(
        records: &Path,
        take: impl Fn(&File) -> std::result::Result<(), TryLockError>,
    ) -> Result<Self> {
        let place = records.join(LOCK);
        let opened = OpenOptions::new().create(true).append(true).open(&place);
        // What was downloaded, or belongs to somebody else, may be readable only.
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
                    let reason = format!("another process has held `{place}` for 30 seconds");
                    return Err(Error::new(ErrorKind::TimedOut, reason));
                }
                Err(TryLockError::WouldBlock) => std::thread::sleep(PAUSE),
            }
        }
    }

    /// Removes the folders of runs that neither live nor are the last one.
    fn clear(&self, records: &Path) {
        // Without locks nobody knows who lives.
        if self.held.is_none() {
            return;
        }
        // Without the name of the last run each of them may be that one.
        let named = std::fs::read_to_string(records.join(LAST));
        if named.is_err_and(|error| error.kind() != ErrorKind::NotFound) {
            return;
        }
        for folder in dead(records) {
            // What can't be removed is in nobody's way.
            drop(std::fs::remove_dir_all(&folder));
        }
    }
}

/// The folders of runs that neither live nor are the last one.
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

/// Whether the run of a folder has ended or was killed.
fn is_dead(folder: &Path) -> bool {
    match File::open(folder.join(RUNNING)) {
        Ok(file) => file.try_lock().is_ok(),
        // It ended, or its tests live on and made its folder once more.
        Err(error) => error.kind() == ErrorKind::NotFound,
    }
}
