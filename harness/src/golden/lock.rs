//! One acceptance at a time in a folder of goldens, whichever processes ask.

use std::fs::{File, OpenOptions};
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};

use crate::diagnostic::shown;
use crate::image::ImageError;

/// Waits for the folder's lock, which is given back when the file is dropped.
///
/// The file lies among the temporary ones: nothing foreign is put beside goldens, and some systems
/// can't lock a folder.
pub(super) fn lock(folder: &Path) -> Result<File, ImageError> {
    let file = place(folder);
    let failed = |source: Error| ImageError::Write { path: shown(&file), source };
    let opened = match OpenOptions::new().create(true).append(true).open(&file) {
        // Another user's, who may be using the same folder: reading suffices for a lock.
        Err(error) if error.kind() == ErrorKind::PermissionDenied => File::open(&file),
        opened => opened,
    };
    let opened = opened.map_err(failed)?;
    opened.lock().map_err(failed)?;
    Ok(opened)
}

fn place(folder: &Path) -> PathBuf {
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let hash = blake3::hash(folder.as_os_str().as_encoded_bytes()).to_hex();
    std::env::temp_dir().join(format!("karat-{}.lock", &hash[..16]))
}
