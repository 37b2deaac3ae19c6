//! Writes files completely or not at all.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Error, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Writes a file completely or not at all: writes a temporary file in the same folder, then renames it to `path`. So
/// other programs see either the whole old file or the whole new file. Concurrent writers use different temporary
/// files, and the last rename wins. If the path is a symbolic link, the link stays, and the file to which it points is
/// replaced. A device file, a pipe, or a file that this process has open (`/dev/stdout`) can't be replaced, so the
/// function writes to it directly.
///
/// ```no_run
/// karat::unstable::image::write_whole("report.html".as_ref(), b"<!doctype html>")?;
/// # Ok::<(), std::io::Error>(())
/// ```
///
/// # Errors
/// Returns an error if the folder or file can't be written.
pub fn write_whole(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    // A program that has the file open would continue to write into the replaced file.
    let is_open = ["/dev/stdout", "/dev/stderr", "/dev/fd", "/proc"];
    let is_open = cfg!(unix) && is_open.iter().any(|above| path.starts_with(above));
    match path.metadata() {
        Ok(found) if is_open || !(found.is_file() || found.is_dir()) => std::fs::write(path, bytes),
        // The target of a link may be in another folder.
        Ok(_) => Staged::new(&path.canonicalize()?, bytes)?.commit(),
        Err(_) => Staged::new(path, bytes)?.commit(),
    }
}

/// Appends a line to a file in a folder. The file's name is the id of this process, with the extension `ending`.
///
/// # Panics
/// Panics if the line can't be written.
#[doc(hidden)]
pub fn append_line(folder: &Path, ending: &str, line: &str) {
    let path = folder.join(format!("{}.{ending}", std::process::id()));
    let appended = std::fs::create_dir_all(folder)
        .and_then(|()| OpenOptions::new().create(true).append(true).open(&path))
        // The line is written at once, because several threads write.
        .and_then(|mut file| file.write_all(format!("{line}\n").as_bytes()));
    if let Err(error) = appended {
        panic!("can't write the record `{}`: {error}", path.display());
    }
}

/// A file that was written under a temporary name, and not renamed yet. If this value is dropped before the file is
/// renamed, the file is removed.
///
/// The temporary file stays locked while this value exists, so [`is_leftover`] returns `false` for the file.
#[derive(Debug)]
#[doc(hidden)]
pub struct Staged<'a> {
    beside: PathBuf,
    place: &'a Path,
    _held: File,
}

impl<'a> Staged<'a> {
    #[doc(hidden)]
    pub fn new(place: &'a Path, bytes: &[u8]) -> std::io::Result<Self> {
        if let Some(folder) = place.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder)?;
        }
        let (beside, mut file) = create_beside(place)?;
        // Without the sync, the system may report a full disk only after the rename.
        let written = file.write_all(bytes).and_then(|()| file.sync_all());
        let staged = Self { beside, place, _held: file };
        written.map(|()| staged)
    }

    #[doc(hidden)]
    pub fn commit(self) -> std::io::Result<()> {
        std::fs::rename(&self.beside, self.place)
    }
}

impl Drop for Staged<'_> {
    fn drop(&mut self) {
        // After a rename, the temporary file no longer exists. Otherwise, the first error is more important than an
        // error here.
        drop(std::fs::remove_file(&self.beside));
    }
}

/// Makes and locks a new temporary file in the folder of `path`. No other thread or process uses the name of this file.
fn create_beside(path: &Path) -> std::io::Result<(PathBuf, File)> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let name = path
        .file_name()
        .ok_or_else(|| Error::new(ErrorKind::InvalidInput, "the path has no file name"))?;
    loop {
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let mut beside = name.to_owned();
        beside.push(format!(".{}-{count}.tmp", std::process::id()));
        let beside = path.with_file_name(beside);
        match OpenOptions::new().write(true).create_new(true).open(&beside) {
            // A killed process with the same id, or a process on another machine, has left this file.
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            opened => {
                let file = opened?;
                // Another process may have removed the file as a leftover before it was locked.
                match file.try_lock() {
                    Err(TryLockError::WouldBlock) => {}
                    Ok(()) if !beside.exists() => {}
                    // Some file systems don't support locks. On these file systems, leftovers stay.
                    Ok(()) | Err(TryLockError::Error(_)) => return Ok((beside, file)),
                }
            }
        }
    }
}

/// Checks if a file is a leftover: a temporary file that Karat began for an image or its provenance, and never renamed
/// because the process ended first. A leftover has a name such as `sky.exr.1234-0.tmp`, which Karat gives to no other
/// files.
///
/// ```
/// # let folder = tempfile::tempdir()?;
/// let file = folder.path().join("sky.exr.1234-0.tmp");
/// std::fs::write(&file, "half of it")?; // the process that wrote this was killed
/// assert!(karat::unstable::image::is_leftover(&file));
/// # Ok::<(), std::io::Error>(())
/// ```
#[must_use]
pub fn is_leftover(path: &Path) -> bool {
    is_beside(path) && unheld(path).is_some()
}

/// Removes a file if it [is a leftover](is_leftover). Returns `true` if the file was removed.
#[doc(hidden)]
pub fn remove_leftover(path: &Path) -> bool {
    // The lock is held until the file is removed, because the file's writer may be about to lock it.
    let held = if is_beside(path) { unheld(path) } else { None };
    held.is_some() && std::fs::remove_file(path).is_ok()
}

/// Checks if a file has the name of a temporary file for an image or its provenance: `scene.exr.1234-0.tmp`.
///
/// ```
/// use karat::unstable::image::is_beside;
///
/// assert!(is_beside("golden/sky.exr.1234-0.tmp".as_ref()));
/// assert!(!is_beside("golden/sky.exr".as_ref()));
/// ```
pub fn is_beside(path: &Path) -> bool {
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let is_ours = |name: &str| {
        let (place, numbers) = name.strip_suffix(".tmp")?.rsplit_once('.')?;
        let (process, count) = numbers.split_once('-')?;
        let case = place.strip_suffix(".exr").or_else(|| place.strip_suffix(".toml"))?;
        let case = case.strip_suffix(".new").unwrap_or(case);
        let sound = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
        let sound = !case.is_empty() && case.chars().all(sound);
        Some(sound && is_number(process) && is_number(count))
    };
    path.file_name().and_then(|name| name.to_str()).and_then(is_ours).unwrap_or(false)
}

/// Opens and locks a regular file. `None` if the file can't be opened, or if another process has locked it.
fn unheld(path: &Path) -> Option<File> {
    // Karat makes no links, so a link isn't a leftover. Opening a pipe would wait.
    if !path.symlink_metadata().ok()?.is_file() {
        return None;
    }
    let file = File::open(path).ok()?;
    file.try_lock().ok().map(|()| file)
}

#[cfg(test)]
mod tests {
    use super::*;

    // Lesson 60
    #[test]
    fn a_file_is_a_leftover_when_its_writer_is_gone() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let place = folder.path().join("scene.exr");
        let staged = Staged::new(&place, b"golden").expect("written");
        let beside = staged.beside.clone();
        assert!(is_beside(&beside) && !is_leftover(&beside), "its writer still has the file");
        assert!(!remove_leftover(&beside) && beside.exists());
        staged.commit().expect("renamed");
        assert_eq!(std::fs::read(&place).expect("there"), b"golden");
        assert!(!is_leftover(&place) && !remove_leftover(&place) && place.exists());
        std::fs::write(&beside, "half of i").expect("written");
        assert!(is_leftover(&beside) && remove_leftover(&beside) && !beside.exists());
        assert!(!remove_leftover(&beside), "it was removed");
    }
}
