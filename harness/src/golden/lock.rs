//! A lock: only one process at a time accepts frames in a folder of goldens.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::diagnostic::shown;
use crate::image::ImageError;
use crate::output::tell;

/// How long Karat waits for another acceptance, which takes a second for a large frame.
const PATIENCE: Duration = Duration::from_secs(30);
/// How long Karat waits before it says that it waits.
const SILENT: Duration = Duration::from_secs(1);
/// Pause between two attempts.
const PAUSE: Duration = Duration::from_millis(20);

/// Waits for the lock of a folder. Dropping the returned file releases the lock.
///
/// The lock file lies among the temporary files, so that Karat puts no files of its own beside goldens, and
/// because some systems can't lock a folder.
pub(super) fn lock(folder: &Path) -> Result<File, ImageError> {
    let file = place(folder);
    let failed = |cause: Error| ImageError::Write { path: shown(&file), cause };
    let opened = match OpenOptions::new().create(true).append(true).open(&file) {
        // The file is that of another user of the same folder. Opening it for reading suffices for a lock.
        Err(error) if error.kind() == ErrorKind::PermissionDenied => File::open(&file),
        opened => opened,
    };
    let opened = opened.map_err(failed)?;
    let (begun, mut told) = (Instant::now(), false);
    loop {
        match opened.try_lock() {
            Ok(()) => return Ok(opened),
            Err(TryLockError::Error(error)) => return Err(failed(error)),
            Err(TryLockError::WouldBlock) if begun.elapsed() > PATIENCE => {
                let reason = "another acceptance has held this lock for 30 seconds; end it";
                return Err(failed(Error::new(ErrorKind::TimedOut, reason)));
            }
            Err(TryLockError::WouldBlock) => {
                if !told && begun.elapsed() > SILENT {
                    tell(&format!("note: waiting for another acceptance (`{}`)", shown(&file)));
                    told = true;
                }
                std::thread::sleep(PAUSE);
            }
        }
    }
}

fn place(folder: &Path) -> PathBuf {
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let hash = blake3::hash(folder.as_os_str().as_encoded_bytes()).to_hex();
    std::env::temp_dir().join(format!("karat-{}.lock", &hash[..16]))
}
