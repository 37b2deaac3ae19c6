//! The review page: pending frames beside their goldens, in HDR.
//!
//! One page, offline. [`Review::write`] writes it as files, which show what differs and name the
//! commands to type; [`Review::serve`] serves the same page to this machine alone, where frames
//! can be accepted and rejected. A [`Case`] is what the page shows of one frame. Its pixels are
//! loaded when it is looked at, from a script `data/<n>.js`, because pages from `file://` may load
//! scripts and nothing else.
//!
//! The browser computes what the page displays from the stored floats. [`Goldens`] decides what the
//! verdict is and what may be accepted.

mod data;
mod facts;
mod history;
mod http;
mod last_run;
mod load;
mod maps;
mod packed;
mod page;
mod server;

use std::path::{Path, PathBuf};

pub(crate) use facts::Cause;
pub(crate) use last_run::{Failure, FrameRun, LastRun};
pub(crate) use server::Server;

use karat::diagnostic::shown;
use karat::golden::{
    AcceptError, ChangedRow, CriterionMargin, Pending, PendingFrames, Provenance, Unusable,
};
use karat::{Goldens, Image};
use serde_json::json;

/// What the page shows of one pending frame or table.
///
/// [`load`](Self::load) fills it in; whoever has another map pushes it.
#[derive(Clone, Debug)]
pub(crate) struct Case {
    /// Name of the golden.
    pub(crate) name: String,
    /// Images of both sides, the one that is judged first.
    pub(crate) parts: Vec<Part>,
    /// Images computed from both.
    pub(crate) maps: Vec<Map>,
    /// What the test measured, against what it allows.
    pub(crate) margins: Vec<CriterionMargin>,
    /// How the frame differs, for people.
    pub(crate) verdict: String,
    /// What the golden's file says of itself; `None` if there is no golden or it says nothing.
    pub(crate) golden_provenance: Option<Provenance>,
    /// What the frame's file says of itself.
    pub(crate) actual_provenance: Provenance,
    /// What is different, other than pixels.
    pub(crate) cause: Cause,
    /// The rows that differ, where it is a table of values and no frame.
    pub(crate) table: Option<Rows>,
}

/// Rows of a table that aren't its golden's.
#[derive(Clone, Debug)]
pub(crate) struct Rows {
    /// Names of the columns: arguments, then results.
    pub(crate) columns: Vec<String>,
    /// How many of them are arguments.
    pub(crate) arguments: usize,
    /// The rows that changed most.
    pub(crate) rows: Vec<ChangedRow>,
    /// How many changed.
    pub(crate) changed: usize,
}

/// An image that a golden and a frame may both have.
#[derive(Clone, Debug)]
pub(crate) struct Part {
    /// Its name: `color`.
    pub(crate) name: String,
    /// The golden's.
    pub(crate) golden: Option<Image>,
    /// The frame's.
    pub(crate) actual: Option<Image>,
}

/// An image computed from golden and frame, such as a map of errors.
#[derive(Clone, Debug)]
pub(crate) struct Map {
    /// Its name.
    pub(crate) name: String,
    /// What its values are: one sentence.
    pub(crate) about: String,
    /// Its values. Where all three colours are equal it is shown in false colour.
    pub(crate) image: Image,
    /// The values at the lower and the upper end of the false colours.
    pub(crate) range: [f32; 2],
}

/// Why there is no review.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub(crate) enum ReviewError {
    /// A pending frame can't be read.
    #[error(transparent)]
    Goldens(#[from] AcceptError),
    /// A file of an older page can't be removed.
    #[error("can't remove `{path}`, which is of an older page: {source}")]
    Remove {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// A file of the page can't be written.
    #[error("can't write `{path}`: {source}")]
    Write {
        /// The file.
        path: String,
        /// Why.
        source: std::io::Error,
    },
    /// The server can't be started.
    #[error("can't serve the review on 127.0.0.1:{port}: {reason}")]
    Serve {
        /// The port that was asked for; 0 is any.
        port: u16,
        /// Why.
        reason: String,
    },
}

/// A review of a folder's pending frames.
#[derive(Clone, Debug)]
pub(crate) struct Review {
    goldens: Goldens,
    /// Where the frames wait, which needn't be beside their goldens.
    waiting: Goldens,
    arguments: String,
    run: LastRun,
    /// Whether goldens are shown that nothing is pending for.
    accepted: bool,
}

/// An entry of the page, by the number of its data file.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Entry {
    /// A frame that is pending, by its name.
    Pending(String),
    /// A golden, by its name, which may begin with its profile: `@gl-llvmpipe/scene`.
    Golden(String),
    /// A function that fails, by its place in the last run.
    Failure(usize),
}

impl Review {
    /// A review of all that is pending in a folder of goldens.
    #[must_use]
    pub(crate) fn new(goldens: Goldens) -> Self {
        Self {
            waiting: goldens.clone(),
            goldens,
            arguments: String::new(),
            run: LastRun::default(),
            accepted: false,
        }
    }

    /// Takes the pending frames from another folder, such as what a CI run left.
    #[must_use]
    pub(crate) fn pending_in(mut self, folder: &Path) -> Self {
        self.waiting = Goldens::open(folder);
        self
    }

    /// Arguments that the commands on the page need, such as `--golden other`.
    #[must_use]
    pub(crate) fn with_arguments(mut self, arguments: &str) -> Self {
        self.arguments = arguments.to_owned();
        self
    }

    /// Adds what the last run said.
    #[must_use]
    pub(crate) fn with_run(mut self, run: LastRun) -> Self {
        self.run = run;
        self
    }

    /// Shows all goldens, too.
    #[must_use]
    pub(crate) fn with_goldens(mut self) -> Self {
        self.accepted = true;
        self
    }

    /// Whether there is anything to look at but what is pending.
    #[must_use]
    pub(crate) fn has_more(&self) -> bool {
        !self.run.failures.is_empty() || !self.others(&PendingFrames::default()).is_empty()
    }

    /// What stands on the page besides what is pending.
    fn others(&self, pending: &PendingFrames) -> Vec<Entry> {
        let mut entries = Vec::new();
        if self.accepted {
            let is_pending = |name: &String| pending.frames.iter().any(|frame| frame.case == *name);
            let mut names = Vec::new();
            goldens_below(&self.goldens.folder(), "", &mut names);
            names.sort();
            entries.extend(names.into_iter().filter(|name| !is_pending(name)).map(Entry::Golden));
        }
        entries.extend((0..self.run.failures.len()).map(Entry::Failure));
        entries
    }

    /// The file of a golden that [`others`](Self::others) has listed.
    fn golden(&self, name: &str) -> PathBuf {
        self.goldens.folder().join(format!("{name}.exr"))
    }

    /// Writes the page into a folder: `index.html` and `data/<n>.js`. A link to
    /// `index.html#rooms/dark` leads to that frame. Frames that can't be read are
    /// on the page, too, and say why. What an older page has left in `data` is removed.
    ///
    /// # Errors
    /// If a file can't be written or removed.
    pub(crate) fn write(&self, folder: &Path) -> Result<PendingFrames, ReviewError> {
        let put = |name: &str, text: &str| {
            let path = folder.join(name);
            karat::image::write_whole(&path, text.as_bytes())
                .map_err(|source| ReviewError::Write { path: shown(&path), source })
        };
        let pending = self.pending();
        let frames = pending.frames.iter().map(|frame| Entry::Pending(frame.case.clone()));
        let entries: Vec<Entry> = frames.chain(self.others(&pending)).collect();
        for (index, entry) in entries.iter().enumerate() {
            let script = match pending.frames.get(index) {
                Some(frame) => self.script(index, frame),
                None => self.other_script(index, entry),
            };
            put(&format!("data/{index}.js"), &script)?;
        }
        remove_data(&folder.join("data"), entries.len())?;
        let numbered: Vec<_> = entries.into_iter().enumerate().collect();
        put("index.html", &page::html(self, &pending, &numbered, &page::Mode::Files))?;
        Ok(pending)
    }

    /// What the page loads of a frame.
    fn script(&self, index: usize, frame: &Pending) -> String {
        match Case::load(&self.goldens, frame) {
            Ok(case) => {
                let golden = self.goldens.compared(frame);
                let run = self.run.frames.get(&frame.case);
                let modules = run.map(|run| run.modules.as_slice());
                let versions = history::versions(&golden);
                // What is new has no modules of before.
                let modules = (!frame.is_new()).then(|| history::modules(&golden, modules));
                data::script(index, &case, &json!({ "versions": versions, "modules": modules }))
            }
            Err(error) => data::failure(index, &error.to_string()),
        }
    }

    /// What the page loads of an entry that isn't pending.
    fn other_script(&self, index: usize, entry: &Entry) -> String {
        match entry {
            Entry::Golden(name) => {
                let file = self.golden(name);
                match karat::image::ExrFile::read(&file) {
                    Ok(golden) => data::golden(index, name, &golden, &history::versions(&file)),
                    Err(error) => data::failure(index, &error.to_string()),
                }
            }
            Entry::Failure(at) => match self.run.failures.get(*at) {
                Some(failure) => data::function(index, failure),
                None => data::failure(index, "the last run has no such failure"),
            },
            Entry::Pending(name) => data::failure(index, &format!("`{name}` isn't pending")),
        }
    }

    /// Serves the page on 127.0.0.1, on any free port if `port` is 0.
    ///
    /// # Errors
    /// If the port is taken.
    pub(crate) fn serve(self, port: u16) -> Result<Server, ReviewError> {
        Server::bind(self, port)
    }

    /// What is pending now. Frames of other goldens than these can't be used here.
    #[must_use]
    pub(crate) fn pending(&self) -> PendingFrames {
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

/// Names of all goldens in a folder and those below it, without their ending.
fn goldens_below(folder: &Path, prefix: &str, names: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        // Links aren't followed: they may lead in a circle.
        let Ok(kind) = entry.file_type() else { continue };
        if kind.is_dir() {
            goldens_below(&entry.path(), &format!("{prefix}{name}/"), names);
        } else if let Some(stem) = name.strip_suffix(".exr")
            && !stem.ends_with(".new")
        {
            names.push(format!("{prefix}{stem}"));
        }
    }
}

/// Removes the data of frames that an older page had and this one has not.
fn remove_data(folder: &Path, frames: usize) -> Result<(), ReviewError> {
    let files = std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok);
    for path in files.map(|file| file.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let number = name.strip_suffix(".js").and_then(|number| number.parse::<usize>().ok());
        if number.is_some_and(|number| number >= frames && name == format!("{number}.js")) {
            std::fs::remove_file(&path)
                .map_err(|source| ReviewError::Remove { path: shown(&path), source })?;
        }
    }
    Ok(())
}
