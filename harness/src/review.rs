//! The review page: pending frames beside their goldens, in HDR.
//!
//! One page, offline. [`Review::write`] writes it as files, which show what differs and name the
//! commands to type; [`Review::serve`] serves the same page to this machine alone, where frames
//! can be accepted and rejected. A [`Case`] is what the page shows of one frame. Its pixels are
//! loaded when it is looked at, from a script `data/<n>.js`, because pages from `file://` may load
//! scripts and nothing else.
//!
//! What the page displays is computed by the browser from the stored floats; what the verdict is
//! and what may be accepted is [`Goldens`]' business.

mod data;
mod facts;
mod gates;
mod load;
mod page;
mod server;

use std::path::Path;

pub use facts::{Cause, Fact};
pub use server::{Server, Stop};

use crate::diagnostic::shown;
use crate::golden::{AcceptError, Goldens, Provenance};
use crate::image::Image;

/// What the page shows of one pending frame.
///
/// [`load`](Self::load) fills it in; whoever has another map or another gate pushes it.
#[derive(Clone, Debug)]
pub struct Case {
    /// Name of the golden.
    pub name: String,
    /// Images of both sides, the one that is judged first.
    pub parts: Vec<Part>,
    /// Images computed from both.
    pub maps: Vec<Map>,
    /// What was measured, against what is allowed.
    pub gates: Vec<Gate>,
    /// How the frame differs, for people.
    pub verdict: String,
    /// What the golden's file says of itself; `None` if there is no golden or it says nothing.
    pub golden_provenance: Option<Provenance>,
    /// What the frame's file says of itself.
    pub actual_provenance: Provenance,
    /// What is different, other than pixels.
    pub cause: Cause,
}

/// An image that a golden and a frame may both have.
#[derive(Clone, Debug)]
pub struct Part {
    /// Its name: `color`.
    pub name: String,
    /// The golden's.
    pub golden: Option<Image>,
    /// The frame's.
    pub actual: Option<Image>,
}

/// An image computed from golden and frame, such as a map of errors.
#[derive(Clone, Debug)]
pub struct Map {
    /// Its name.
    pub name: String,
    /// What its values are: one sentence.
    pub about: String,
    /// Its values. Where all three colours are equal it is shown in false colour.
    pub image: Image,
    /// The value at the upper end of the false colours.
    pub full: f32,
}

/// A measured value and its bound.
#[derive(Clone, Debug, PartialEq)]
pub struct Gate {
    /// What was measured.
    pub name: String,
    /// The value. It passes if it is at most `bound`, so that NaN doesn't.
    pub value: f64,
    /// The largest value that passes.
    pub bound: f64,
    /// Where the worst is: left, top, right, bottom in pixels, inclusive.
    pub place: Option<[u32; 4]>,
}

impl Gate {
    /// Whether the value is within its bound.
    #[must_use]
    pub fn passes(&self) -> bool {
        self.value <= self.bound
    }
}

/// Why there is no review.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReviewError {
    /// The pending frames can't be read.
    #[error(transparent)]
    Goldens(#[from] AcceptError),
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
///
/// ```
/// use karat::{Goldens, review::Review};
///
/// let folder = tempfile::tempdir().unwrap();
/// let review = Review::new(Goldens::open(&folder.path().join("golden")));
/// let frames = review.write(&folder.path().join("report")).unwrap();
/// assert_eq!(frames, 0); // nothing is pending, and the page says so
/// assert!(folder.path().join("report/index.html").is_file());
/// ```
#[derive(Clone, Debug)]
pub struct Review {
    goldens: Goldens,
    arguments: String,
}

impl Review {
    /// A review of all that is pending in a folder of goldens.
    #[must_use]
    pub fn new(goldens: Goldens) -> Self {
        Self { goldens, arguments: String::new() }
    }

    /// Arguments that the commands on the page need, such as `--golden other`.
    #[must_use]
    pub fn with_arguments(mut self, arguments: &str) -> Self {
        self.arguments = arguments.to_owned();
        self
    }

    /// Writes the page into a folder: `index.html` and `data/<n>.js`. Returns how many frames it
    /// shows.
    ///
    /// # Errors
    /// If a pending frame can't be read or a file can't be written.
    pub fn write(&self, folder: &Path) -> Result<usize, ReviewError> {
        let put = |name: &str, text: &str| {
            let path = folder.join(name);
            crate::image::write_whole(&path, text.as_bytes())
                .map_err(|source| ReviewError::Write { path: shown(&path), source })
        };
        let pending = load::pending(&self.goldens)?;
        for (index, frame) in pending.iter().enumerate() {
            let case = Case::load(&self.goldens, frame)?;
            put(&format!("data/{index}.js"), &data::script(index, &case))?;
        }
        let listed: Vec<_> = pending.iter().enumerate().collect();
        put("index.html", &page::html(&listed, &self.arguments, &page::Mode::Files))?;
        Ok(pending.len())
    }

    /// Serves the page on 127.0.0.1, on any free port if `port` is 0.
    ///
    /// # Errors
    /// If the port is taken, or a pending frame can't be read.
    pub fn serve(self, port: u16) -> Result<Server, ReviewError> {
        load::pending(&self.goldens)?;
        Server::bind(self, port)
    }

    /// How many frames are pending now.
    ///
    /// # Errors
    /// If a pending frame can't be read.
    pub fn pending(&self) -> Result<usize, ReviewError> {
        Ok(load::pending(&self.goldens)?.len())
    }
}
