//! What a CI run left, downloaded: a folder, or the zip that it came in.
//!
//! A zip may be damaged or hostile. Of its entries only pending frames are unpacked, into a temporary folder, within limits that no honest run comes near.

use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use karat::Goldens;
use tempfile::TempDir;
use zip::ZipArchive;

use super::NotThere;

/// Entries of a zip that are looked at.
const MOST_ENTRIES: usize = 20_000;
/// Frames that are unpacked.
const MOST_FRAMES: usize = 2_000;
/// Bytes of a frame; a golden has at most 1 MiB, a frame with NaN is stored in floats.
const LARGEST_FRAME: u64 = 64 << 20;
/// Bytes of all frames.
const LARGEST: u64 = 1 << 30;

/// The pending frames of a CI run.
#[derive(Debug)]
pub(super) struct Artefact {
    folder: PathBuf,
    /// Where a zip is unpacked, as long as this lives.
    unpacked: Option<TempDir>,
}

impl Artefact {
    /// A folder, or a zip that is unpacked.
    pub(super) fn open(path: &Path) -> anyhow::Result<Self> {
        let shown = path.display();
        if path.is_dir() {
            return Ok(Self { folder: path.to_owned(), unpacked: None });
        }
        if !path.exists() {
            return Err(NotThere(format!("there is no folder or zip `{shown}`")).into());
        }
        let unpacked = tempfile::tempdir().context("there is no room for temporary files")?;
        unpack(path, unpacked.path()).with_context(|| format!("can't use `{shown}`"))?;
        Ok(Self { folder: unpacked.path().to_owned(), unpacked: Some(unpacked) })
    }

    /// Whether the frames are copies: deleting them changes nothing.
    pub(super) fn is_zip(&self) -> bool {
        self.unpacked.is_some()
    }

    /// The folder that frames are selected from.
    pub(super) fn frames(&self) -> Goldens {
        Goldens::open(&self.folder)
    }

    /// The folder itself.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }
}

fn unpack(path: &Path, folder: &Path) -> anyhow::Result<()> {
    let mut archive = ZipArchive::new(File::open(path)?).context("it isn't a readable zip")?;
    let entries = archive.len();
    ensure!(entries <= MOST_ENTRIES, "it has {entries} entries, at most {MOST_ENTRIES} are read");
    let (mut frames, mut bytes) = (0, 0);
    for index in 0..entries {
        let entry = archive.by_index(index).context("an entry can't be read")?;
        let name = entry.name().context("an entry has no name")?.escape_debug().to_string();
        // The crate makes `/etc/x` relative, which is safe, and a sign of nothing good.
        let relative = entry.enclosed_name().filter(|_| !name.starts_with(['/', '\\']));
        let Some(relative) = relative else {
            bail!("its entry `{name}` would lie outside of the folder it is unpacked into");
        };
        if !name.ends_with(".new.exr") || !entry.is_file() {
            continue;
        }
        frames += 1;
        ensure!(frames <= MOST_FRAMES, "it has more than {MOST_FRAMES} frames");
        // What the zip says of its sizes needn't be so.
        let mut content = Vec::new();
        entry
            .take(LARGEST_FRAME + 1)
            .read_to_end(&mut content)
            .with_context(|| format!("its entry `{name}` is damaged"))?;
        let length = content.len() as u64;
        ensure!(length <= LARGEST_FRAME, "its entry `{name}` has more than {LARGEST_FRAME} bytes");
        bytes += length;
        ensure!(bytes <= LARGEST, "its frames have more than {LARGEST} bytes");
        let place = folder.join(relative);
        std::fs::create_dir_all(place.parent().unwrap_or(folder))?;
        // Two entries of one name aren't one frame.
        let mut file = File::create_new(&place)
            .with_context(|| format!("its entry `{name}` can't be unpacked"))?;
        file.write_all(&content)?;
    }
    Ok(())
}
