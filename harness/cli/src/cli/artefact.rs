//! Opens the downloaded artefact of a CI run: a folder, or a zip of the folder.
//!
//! A zip may be damaged or hostile, so Karat unpacks only the pending frames and values, into a temporary folder. The
//! limits on their number and size are far above the needs of a real run.

use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use karat::Goldens;
use tempfile::TempDir;
use zip::ZipArchive;

use super::NotThere;

const MOST_ENTRIES: usize = 20_000;
/// The largest number of frames that Karat unpacks.
const MOST_FRAMES: usize = 2_000;
/// The largest size of a pending frame, in bytes. A golden has at most 1 MiB, but a frame with NaN can be larger,
/// because Karat stores it in 32-bit floats and not in half floats.
const LARGEST_FRAME: u64 = 64 << 20;
/// The largest size of all frames together, in bytes.
const LARGEST: u64 = 1 << 30;

/// The artefact of a CI run, with its pending frames.
#[derive(Debug)]
pub(super) struct Artefact {
    folder: PathBuf,
    /// The temporary folder into which Karat unpacked a zip. Dropping this value deletes the folder.
    unpacked: Option<TempDir>,
}

impl Artefact {
    /// Opens a folder, or unpacks a zip. The folder or zip must contain a pending frame, pending values or a record, as
    /// each artefact of a run does. Otherwise returns an error.
    pub(super) fn open(path: &Path) -> anyhow::Result<Self> {
        let shown = path.display();
        if path.is_dir() {
            Contents::of(path)?.expect_run(path)?;
            return Ok(Self { folder: path.to_owned(), unpacked: None });
        }
        if !path.exists() {
            return Err(NotThere(format!("there is no folder or zip `{shown}`")).into());
        }
        let unpacked = tempfile::tempdir().context("can't make a temporary folder")?;
        let contents =
            unpack(path, unpacked.path()).with_context(|| format!("can't use `{shown}`"))?;
        contents.expect_run(path)?;
        Ok(Self { folder: unpacked.path().to_owned(), unpacked: Some(unpacked) })
    }

    /// Checks if the frames are copies that Karat unpacked from a zip. If a command deletes a copy, the zip stays
    /// unchanged.
    pub(super) fn is_zip(&self) -> bool {
        self.unpacked.is_some()
    }

    /// Returns the folder in which commands look for pending frames.
    pub(super) fn frames(&self) -> Goldens {
        Goldens::open(&self.folder)
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }
}

/// The endings of the file names of pending frames and pending values.
const WAITING: [&str; 2] = [".new.exr", ".new.csv"];

/// Checks if a file name is the name of a pending frame or of pending values.
fn waits(name: &str) -> bool {
    WAITING.iter().any(|ending| name.ends_with(ending))
}

/// The facts that show if a folder or zip is the artefact of a run.
#[derive(Debug, Default)]
struct Contents {
    /// `true` if the folder or zip contains a pending frame, pending values or a record.
    of_run: bool,
    /// The name of an inner zip, if there is one. Perhaps the user meant to open this inner zip.
    zip: Option<String>,
}

impl Contents {
    fn of(folder: &Path) -> anyhow::Result<Self> {
        let below = |pattern: &str| -> anyhow::Result<Option<PathBuf>> {
            // The folder's name may contain characters with a special meaning in glob patterns.
            let folder = glob::Pattern::escape(&folder.to_string_lossy());
            let pattern = Path::new(&folder).join("**").join(pattern);
            let first = glob::glob(&pattern.to_string_lossy())?.next();
            // An unreadable folder counts as found: the later search for frames reports its error.
            Ok(first.map(|found| found.unwrap_or_else(|error| error.path().to_owned())))
        };
        let [frame, table] = WAITING.map(|ending| format!("*{ending}"));
        for pattern in [&*frame, &*table, "record/*.jsonl", "record/run-*/*.jsonl", "run.json"] {
            if below(pattern)?.is_some() {
                return Ok(Self { of_run: true, zip: None });
            }
        }
        let zip = below("*.zip")?.map(|zip| zip.display().to_string());
        Ok(Self { of_run: false, zip })
    }

    fn add(&mut self, relative: &Path, name: &str) {
        let mut above = relative.ancestors().skip(1).take(2);
        let in_record = above.any(|folder| folder.ends_with("record"));
        let ends_in = |end: &str| relative.extension().is_some_and(|extension| extension == end);
        self.of_run |=
            waits(name) || (in_record && ends_in("jsonl")) || relative.ends_with("run.json");
        if self.zip.is_none() && ends_in("zip") {
            self.zip = Some(name.to_owned());
        }
    }

    fn expect_run(&self, path: &Path) -> Result<(), NotThere> {
        if self.of_run {
            return Ok(());
        }
        let inner =
            self.zip.as_ref().map(|zip| format!("; you may mean the zip `{zip}` in this folder"));
        Err(NotThere(format!(
            "`{}` isn't the artefact of a run, because it contains no frame (`*.new.exr`), no values (`*.new.csv`) \
             and no record (`record/*.jsonl`, `run.json`); name the folder or zip that CI uploaded from \
             `target/karat`{}",
            path.display(),
            inner.unwrap_or_default()
        )))
    }
}

fn unpack(path: &Path, folder: &Path) -> anyhow::Result<Contents> {
    let mut archive = ZipArchive::new(File::open(path)?).context("this isn't a readable zip")?;
    // If two entries have the same name, the crate `zip` keeps the last one. Another program may have shown the first
    // one.
    ensure!(!archive.has_duplicate_names(), "two entries of the zip have the same name");
    let entries = archive.len();
    ensure!(entries <= MOST_ENTRIES, "the zip has {entries} entries, more than {MOST_ENTRIES}");
    let (mut contents, mut frames, mut bytes) = (Contents::default(), 0, 0);
    for index in 0..entries {
        let entry = archive.by_index(index).context("an entry of the zip can't be read")?;
        let name = entry
            .name()
            .context("the name of an entry in the zip is damaged")?
            .escape_debug()
            .to_string();
        // The crate `zip` makes `/etc/x` relative. That is safe, but an honest zip has no such entry.
        let relative = entry.enclosed_name().filter(|_| !name.starts_with(['/', '\\']));
        let Some(relative) = relative else {
            bail!("entry `{name}` of the zip would be unpacked outside of the target folder");
        };
        if !entry.is_file() {
            continue;
        }
        contents.add(&relative, &name);
        if !waits(&name) {
            continue;
        }
        frames += 1;
        ensure!(frames <= MOST_FRAMES, "the zip has more than {MOST_FRAMES} frames");
        // The sizes in a zip may be wrong, so the limit applies to the unpacked bytes.
        let mut content = Vec::new();
        entry
            .take(LARGEST_FRAME + 1)
            .read_to_end(&mut content)
            .with_context(|| format!("entry `{name}` of the zip is damaged"))?;
        let length = content.len() as u64;
        ensure!(length <= LARGEST_FRAME, "the entry `{name}` has more than {LARGEST_FRAME} bytes");
        bytes += length;
        ensure!(bytes <= LARGEST, "the frames of the zip have more than {LARGEST} bytes");
        place(folder, &relative, &content)
            .with_context(|| format!("entry `{name}` of the zip can't be unpacked"))?;
    }
    Ok(contents)
}

fn place(folder: &Path, relative: &Path, content: &[u8]) -> anyhow::Result<()> {
    let place = folder.join(relative);
    ensure!(!place.is_dir(), "the zip has a file and a folder with this name");
    if let Some(file) = relative.ancestors().skip(1).find(|above| folder.join(above).is_file()) {
        bail!("`{}` is both a file and a folder", file.display().to_string().escape_debug());
    }
    std::fs::create_dir_all(place.parent().unwrap_or(folder))?;
    // Two names may mean the same file: `a/b` and `a/./b`, or names that differ only in capitals.
    let mut file = match File::create_new(&place) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            bail!("another entry of the zip has the same path")
        }
        created => created?,
    };
    Ok(file.write_all(content)?)
}
