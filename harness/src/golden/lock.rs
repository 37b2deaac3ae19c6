//! A lock on a folder of goldens. Only one process at a time accepts frames in the folder.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::diagnostic::shown;
use crate::image::ImageError;
use crate::output::tell;

/// The longest time that Karat waits while another process accepts a frame. Accepting a large frame takes a second.
const PATIENCE: Duration = Duration::from_secs(30);
/// Time after which Karat tells the user that it waits for the lock.
const SILENT: Duration = Duration::from_secs(1);
const PAUSE: Duration = Duration::from_millis(20);

/// Waits for the lock of a folder. Dropping the returned file releases the lock.
///
/// The lock file lies in the system's folder for temporary files. So Karat puts no extra files beside goldens,
/// and also works on systems that can't lock a folder.
pub(super) fn lock(folder: &Path) -> Result<File, ImageError> {
    let file = place(folder);
    let failed = |cause: Error| ImageError::Write { path: shown(&file), cause };
    let opened = match OpenOptions::new().create(true).append(true).open(&file) {
        // Another user of this folder owns the file. A file that is open for reading can be locked, too.
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
                let reason =
                    "another acceptance has held this lock for 30 seconds; end that process";
                return Err(failed(Error::new(ErrorKind::TimedOut, reason)));
            }
            Err(TryLockError::WouldBlock) => {
                if !told && begun.elapsed() > SILENT {
                    tell(&format!(
                        "note: waiting until another process has accepted its goldens (lock file `{}`)",
                        shown(&file)
                    ));
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
