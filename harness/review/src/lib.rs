//! The review page: pending frames beside their goldens, in HDR.
//!
//! The review is one page, and works offline. [`Review::write`] writes the page as files, which show the differences
//! and the commands to type. [`Review::serve`] serves the same page to this machine only, and on the served page you
//! can accept and reject frames. A [`Case`] is the data of one frame. When you look at a frame, the page loads the
//! frame's pixels from a script `data/<n>.js`, because a page from `file://` can't fetch files, but
//! can load scripts.
//!
//! The browser computes the displayed image from the stored floats. [`Goldens`] determines verdicts, and accepts
//! frames.

mod data;
mod facts;
mod git;
mod history;
pub mod http;
mod last_run;
mod load;
mod maps;
mod modules;
mod packed;
mod page;
mod pixels;
mod server;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

pub use facts::Cause;
pub use last_run::{Failure, FrameRun, LastRun};
pub use pixels::Pixels;
pub use server::Server;

use karat::unstable::diagnostic::shown;
use karat::unstable::golden::CriterionMargin;
use karat::unstable::golden::{
    AcceptError, ChangedRow, Pending, PendingFrames, Provenance, Table, Unusable,
};
use karat::unstable::image::ExrFile;
use karat::{Goldens, Image};
use serde_json::json;

/// The largest number of rows of a table that the page shows. Readers rarely look at more.
const MOST_ROWS: usize = 500;
/// The largest size of a frame in a report, in bytes, including older versions of its golden. People mail and keep
/// reports, so a report includes only the versions that fit.
const MOST_BYTES: usize = 1_000_000;
/// The largest number of older versions of a golden in a report.
const MOST_VERSIONS: usize = 8;

/// The data of a pending frame or table for the page.
///
/// [`load`](Self::load) reads the data. You can add more images to `maps`.
#[derive(Clone, Debug)]
pub struct Case {
    /// The name of the golden.
    pub name: String,
    /// The images of the golden and of the frame. The test compares only the images in the first element.
    pub parts: Vec<Part>,
    /// Images computed from the golden and the frame.
    pub maps: Vec<Map>,
    /// The measurements and bounds of the test.
    pub margins: Vec<CriterionMargin>,
    /// The difference between golden and frame, as a sentence.
    pub verdict: String,
    /// The metadata in the golden's file. `None` if there is no golden, or if the golden has no metadata.
    pub golden_provenance: Option<Provenance>,
    /// The metadata in the frame's file.
    pub actual_provenance: Provenance,
    /// The kind of difference between the golden's and the frame's metadata.
    pub cause: Cause,
    /// The rows that differ, if the case is a table of values; `None` for a frame.
    pub table: Option<Rows>,
}

/// The changed rows of a table: the rows whose values differ from the golden's.
#[derive(Clone, Debug)]
pub struct Rows {
    /// The names of the columns: arguments, then results.
    pub columns: Vec<String>,
    /// The number of columns that are arguments.
    pub arguments: usize,
    /// The rows that changed most.
    pub rows: Vec<ChangedRow>,
    /// The number of rows that changed.
    pub changed: usize,
}

/// A named image, from the golden, from the frame, or from both.
#[derive(Clone, Debug)]
pub struct Part {
    /// The name of the image: `color`.
    pub name: String,
    /// The golden's image.
    pub golden: Option<Image>,
    /// The frame's image.
    pub actual: Option<Image>,
}

/// An image computed from golden and frame, such as a map of errors.
#[derive(Clone, Debug)]
pub struct Map {
    /// The name of the map.
    pub name: String,
    /// The meaning of the map's values, as a sentence.
    pub about: String,
    /// The values of the map. If red, green and blue are equal everywhere, the page shows the map in false colours.
    pub image: Image,
    /// The values that the page shows in the first and in the last of its false colours.
    pub range: [f32; 2],
}

/// The reason why there is no review.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReviewError {
    /// A pending frame can't be read.
    #[error(transparent)]
    Goldens(#[from] AcceptError),
    /// A file of an older page can't be removed.
    #[error("can't remove `{path}`, a file of an older page: {cause}")]
    Remove {
        /// The path of the file.
        path: String,
        /// The operating system's error.
        cause: std::io::Error,
    },
    /// A file of the page can't be written.
    #[error("can't write `{path}`: {cause}")]
    Write {
        /// The path of the file.
        path: String,
        /// The operating system's error.
        cause: std::io::Error,
    },
    /// The server can't be started.
    #[error("can't serve the review on 127.0.0.1:{port}: {reason}")]
    Serve {
        /// The requested port. 0 means any port.
        port: u16,
        /// The operating system's error.
        reason: String,
    },
}

/// A review of the pending frames in a folder.
#[derive(Clone, Debug)]
pub struct Review {
    goldens: Goldens,
    /// The folder of the pending frames, which may differ from the folder of the goldens.
    waiting: Goldens,
    arguments: String,
    run: LastRun,
    /// `true` if the page also shows goldens without a pending frame.
    accepted: bool,
    /// `true` if the page may accept frames in CI.
    ci_may_write: bool,
    in_editor: bool,
    asked: pixels::Asked,
}

/// An entry of the page. The entry's number is in the name of the data file that the page loads for the entry.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Entry {
    /// A pending frame, by its name.
    Pending(String),
    /// A golden, by its file in the folder. The file may be in the subfolder of its profile: `@gl-llvmpipe/scene.exr`.
    Golden(String),
    /// A failing function, by its number in the last run.
    Failure(usize),
}

impl Review {
    /// Makes a review of all pending frames and tables in a folder of goldens.
    #[must_use]
    pub fn new(goldens: Goldens) -> Self {
        Self {
            waiting: goldens.clone(),
            goldens,
            arguments: String::new(),
            run: LastRun::default(),
            accepted: false,
            ci_may_write: false,
            in_editor: false,
            asked: pixels::Asked::default(),
        }
    }

    /// Allows or forbids accepting frames on the page in CI, where the variable `CI` is set.
    #[must_use]
    pub fn may_write_in_ci(mut self, may: bool) -> Self {
        self.ci_may_write = may;
        self
    }

    /// Lets VS Code show the served page in a panel.
    #[must_use]
    pub fn in_editor(mut self, is: bool) -> Self {
        self.in_editor = is;
        self
    }

    /// Lets the served page trace pixels.
    #[must_use]
    pub fn with_pixels(mut self, pixels: std::sync::Arc<dyn Pixels>) -> Self {
        self.asked = pixels::Asked::of(pixels);
        self
    }

    /// Reads the pending frames from another folder, such as a folder of a CI run.
    #[must_use]
    pub fn pending_in(mut self, folder: &Path) -> Self {
        self.waiting = Goldens::open(folder);
        self
    }

    /// Sets arguments that the commands on the page need, such as `--goldens other`.
    #[must_use]
    pub fn with_arguments(mut self, arguments: &str) -> Self {
        self.arguments = arguments.to_owned();
        self
    }

    /// Adds the records of the last run.
    #[must_use]
    pub fn with_run(mut self, run: LastRun) -> Self {
        self.run = run;
        self
    }

    /// Also shows all goldens.
    #[must_use]
    pub fn with_goldens(mut self) -> Self {
        self.accepted = true;
        self
    }

    /// Checks if the page has entries that aren't pending frames.
    #[must_use]
    pub fn has_more(&self) -> bool {
        !self.run.failures.is_empty() || !self.others(&PendingFrames::default()).is_empty()
    }

    /// Returns the entries that aren't pending frames.
    fn others(&self, pending: &PendingFrames) -> Vec<Entry> {
        let mut entries = Vec::new();
        if self.accepted {
            let of = |frame: &Pending| (frame.case.clone(), frame.is_table());
            let waiting: Vec<_> = pending.frames.iter().map(of).collect();
            let is_pending = |file: &String| {
                let (name, is_table) = golden_name(file);
                waiting.contains(&(name.to_owned(), is_table))
            };
            let mut files = Vec::new();
            goldens_below(&self.goldens.folder(), "", &mut files);
            files.sort();
            entries.extend(files.into_iter().filter(|file| !is_pending(file)).map(Entry::Golden));
        }
        entries.extend((0..self.run.failures.len()).map(Entry::Failure));
        entries
    }

    /// Returns two files of an entry: the golden, and the current file, which the page compares with older versions of
    /// the golden. Returns `None` for a failing function.
    fn golden_of(&self, entry: &Entry, pending: Option<&Pending>) -> Option<(PathBuf, PathBuf)> {
        match entry {
            Entry::Pending(_) => {
                pending.map(|pending| (self.goldens.compared(pending), pending.path.clone()))
            }
            Entry::Golden(file) => {
                let file = self.goldens.folder().join(file);
                Some((file.clone(), file))
            }
            Entry::Failure(_) => None,
        }
    }

    /// Writes the page into a folder: `index.html`, `data/<n>.js`, and `data/<n>-<commit>.js` for older versions of a
    /// golden. A link to `index.html#rooms/dark` opens the page at the frame `rooms/dark`. For an unreadable frame, the
    /// page shows the reason. Removes the files of an older page in `data`.
    ///
    /// # Errors
    /// Returns an error if a file can't be written or removed.
    pub fn write(&self, folder: &Path) -> Result<PendingFrames, ReviewError> {
        let put = |name: &str, text: &str| {
            let path = folder.join(name);
            karat::unstable::image::write_whole(&path, text.as_bytes())
                .map_err(|cause| ReviewError::Write { path: shown(&path), cause })
        };
        let pending = self.pending();
        let frames = pending.frames.iter().map(|frame| Entry::Pending(frame.case.clone()));
        let entries: Vec<Entry> = frames.chain(self.others(&pending)).collect();
        let mut written = BTreeSet::new();
        for (index, entry) in entries.iter().enumerate() {
            let frame = pending.frames.get(index);
            let script = match frame {
                Some(frame) => self.script(index, frame, true),
                None => self.other_script(index, entry),
            };
            let room = MOST_BYTES.saturating_sub(script.len());
            let golden = self.golden_of(entry, frame);
            let older = golden.map(|(golden, now)| older_versions(index, &golden, &now, room));
            let older = older.into_iter().flatten();
            for (name, script) in [(format!("{index}.js"), script)].into_iter().chain(older) {
                put(&format!("data/{name}"), &script)?;
                written.insert(name);
            }
        }
        remove_data(&folder.join("data"), &written)?;
        let numbered: Vec<_> = entries.into_iter().enumerate().collect();
        put("index.html", &page::html(self, &pending, &numbered, &page::Mode::Files))?;
        Ok(pending)
    }

    /// Returns the data of a frame for the page. Without a server, the page can't ask for pixels later: `in_advance`
    /// adds some traced pixels to the data.
    fn script(&self, index: usize, frame: &Pending, in_advance: bool) -> String {
        match Case::load(&self.goldens, frame) {
            Ok(case) => {
                let golden = self.goldens.compared(frame);
                let versions = history::versions(&golden);
                // A new frame has no earlier modules.
                let modules = (!frame.is_new()).then(|| self.changed_modules(&golden, &case));
                let mut more = json!({ "versions": versions, "modules": modules });
                if in_advance {
                    more["told"] = self.asked.in_advance(&case, &versions);
                }
                data::script(index, &case, &more)
            }
            Err(error) => data::failure(index, &error.to_string()),
        }
    }

    /// Returns the modules that changed since the golden was made. Compares hashes if golden and frame have hashes,
    /// else asks git.
    fn changed_modules(&self, golden: &Path, case: &Case) -> serde_json::Value {
        let known = case.golden_provenance.as_ref();
        let by_hash = known.zip(self.goldens.project()).and_then(|(known, project)| {
            modules::by_hash(&project, known, &case.actual_provenance)
        });
        by_hash.unwrap_or_else(|| {
            let run = self.run.frames.get(&case.name).map(|run| run.modules.clone());
            let own = self.goldens.project().map(|project| {
                let names = case.actual_provenance.modules.keys();
                let files = names.map(|name| project.join(name)).filter(|file| file.is_file());
                files.collect::<Vec<_>>()
            });
            let own = own.filter(|own| !own.is_empty()).or(run);
            modules::by_commit(golden, own.as_deref())
        })
    }

    /// Returns the data of an entry that isn't pending.
    fn other_script(&self, index: usize, entry: &Entry) -> String {
        match entry {
            Entry::Golden(name) => {
                let file = self.goldens.folder().join(name);
                let versions = || history::versions(&file);
                let script = match golden_name(name) {
                    (name, true) => Table::read(&file)
                        .map(|golden| data::golden_table(index, name, &golden, &versions()))
                        .map_err(|error| error.to_string()),
                    (name, false) => ExrFile::read(&file)
                        .map(|golden| data::golden(index, name, &golden, &versions()))
                        .map_err(|error| error.to_string()),
                };
                script.unwrap_or_else(|error| data::failure(index, &error))
            }
            Entry::Failure(at) => match self.run.failures.get(*at) {
                Some(failure) => data::function(index, failure),
                None => data::failure(index, "the last run has no failure with this number"),
            },
            Entry::Pending(name) => data::failure(index, &format!("`{name}` isn't pending")),
        }
    }

    /// Serves the page on 127.0.0.1, on a free port if `port` is 0.
    ///
    /// # Errors
    /// Returns an error if the port is taken.
    pub fn serve(self, port: u16) -> Result<Server, ReviewError> {
        Server::bind(self, port)
    }

    /// Returns the currently pending frames. `unusable` also lists the frames that belong to another folder of goldens.
    #[must_use]
    pub fn pending(&self) -> PendingFrames {
        let PendingFrames { frames, mut unusable } = self.waiting.pending();
        let (frames, others): (Vec<_>, Vec<_>) =
            frames.into_iter().partition(|pending| pending.is_of(&self.goldens));
        unusable.extend(others.into_iter().map(|Pending { case, path, provenance }| {
            let reason = AcceptError::Elsewhere { case, folder: provenance.folder };
            Unusable { path, reason }
        }));
        PendingFrames { frames, unusable }
    }
}

/// Returns the script of an older version of a golden. The page loads this script on demand. For a table, the script
/// has the rows that differ from the rows in `now`.
fn version_script(index: usize, golden: &Path, now: &Path, commit: &str) -> String {
    let older = if is_table(golden) {
        let now = Table::read(now).map_err(|error| error.to_string());
        now.and_then(|(now, _)| {
            let older = history::table(golden, commit).map_err(|error| error.to_string())?;
            Ok(data::Older::Table(Rows::of(&now, now.changed_rows(Some(&older)))))
        })
    } else {
        let image = history::image(golden, commit).map_err(|error| error.to_string());
        image.map(data::Older::Image)
    };
    data::version(index, commit, older)
}

/// Returns the latest older versions of a golden, each as a file name and a script. All scripts together have at most
/// `room` bytes.
fn older_versions(
    index: usize,
    golden: &Path,
    now: &Path,
    mut room: usize,
) -> Vec<(String, String)> {
    // The page already shows a version with the golden's current content.
    let shown = if is_table(golden) {
        Table::read(golden).ok().map(|(_, known)| known.pixels)
    } else {
        let golden = ExrFile::read(golden).ok();
        golden.and_then(|golden| golden.parts.into_iter().next()).map(|part| part.image.hash())
    };
    let mut seen = BTreeSet::from_iter(shown);
    let mut kept = Vec::new();
    for version in history::versions(golden) {
        let text = |name: &str| version[name].as_str().unwrap_or_default().to_owned();
        let (commit, pixels) = (text("commit"), text("pixels"));
        if !pixels.is_empty() && !seen.insert(pixels) {
            continue;
        }
        if seen.len() > MOST_VERSIONS + 1 || kept.len() >= MOST_VERSIONS {
            break;
        }
        let script = version_script(index, golden, now, &commit);
        if script.len() <= room {
            room -= script.len();
            kept.push((format!("{index}-{commit}.js"), script));
        }
    }
    kept
}

/// Returns the name of a golden from its file, and `true` if the golden is a table.
fn golden_name(file: &str) -> (&str, bool) {
    (file.rsplit_once('.').map_or(file, |(name, _)| name), is_table(file.as_ref()))
}

fn is_table(golden: &Path) -> bool {
    golden.extension().is_some_and(|ending| ending == "csv")
}

/// Adds all goldens in a folder and in its subfolders to `files`, with `prefix` before each path in the folder.
fn goldens_below(folder: &Path, prefix: &str, files: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        // Links aren't followed: they may form a cycle.
        let Ok(kind) = entry.file_type() else { continue };
        if kind.is_dir() {
            goldens_below(&entry.path(), &format!("{prefix}{name}/"), files);
        } else if let Some(stem) = name.strip_suffix(".exr").or_else(|| name.strip_suffix(".csv"))
            && !stem.ends_with(".new")
        {
            files.push(format!("{prefix}{name}"));
        }
    }
}

/// Removes the data files of an older page that aren't among the `written` files of this page.
fn remove_data(folder: &Path, written: &BTreeSet<String>) -> Result<(), ReviewError> {
    let files = std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok);
    for path in files.map(|file| file.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let stem = name.strip_suffix(".js").unwrap_or_default();
        let (number, commit) = stem.split_once('-').unwrap_or((stem, "0"));
        let is_ours = !number.is_empty()
            && number.bytes().all(|c| c.is_ascii_digit())
            && commit.bytes().all(|c| c.is_ascii_hexdigit());
        if is_ours && !written.contains(&*name) {
            std::fs::remove_file(&path)
                .map_err(|cause| ReviewError::Remove { path: shown(&path), cause })?;
        }
    }
    Ok(())
}
