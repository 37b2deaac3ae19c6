//! Draws a frame's meshes and full-screen triangles with entry points of one module, and with the resources that these
//! read.
//!
//! A [`Drawing`] is linked and validated data for an [`Executor`](crate::executor::Executor). A depth pre-pass draws
//! depth alone. The colour pass then draws only where the depth is equal, so it shades each pixel once.

mod blend;
mod depths;
pub(crate) mod drawing;
mod format;
mod inputs;
mod mesh;
mod painter;
mod pipeline;
mod renderer;
mod request;
mod row;
mod state;
mod targets;
mod told;

/// The old name of the trait for attributes.
pub use crate::value::Shareable as Attribute;
pub use blend::{Blend, BlendComponent, BlendFactor, BlendOperation};
pub(crate) use drawing::{Drawing, Scene, Source};
pub use format::Format;
pub use mesh::Mesh;
pub use request::Draw;
pub use state::{Cull, DepthBias, Stencil, StencilOperation, Winding};

use crate::diagnostic::Diagnostic;
use crate::diagnostic::{Blame, Blamed};
use crate::fixture::FixtureError;
use crate::path::{Path, PathError};
use crate::reflect::{ReflectError, Stage};

/// The reason why a frame can't be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DrawError {
    /// The shader can't be used.
    #[error(transparent)]
    Reflect(#[from] ReflectError),
    /// Fixtures and variables don't match.
    #[error(transparent)]
    Fixture(#[from] FixtureError),
    /// A path can't be used.
    #[error(transparent)]
    Path(#[from] PathError),
    /// A loop takes more rounds than the driver allows.
    #[error("{0}")]
    Rounds(Box<Diagnostic>),
    /// The module has no such entry point.
    #[error("module `{module}` has no {stage} entry point `{name}`")]
    EntryPoint {
        /// The module.
        module: String,
        /// The stage that it should belong to.
        stage: Stage,
        /// The name that was asked for.
        name: String,
    },
    /// A side has 0 pixels, or more than the device can draw.
    #[error("the frame is {width} x {height}; path `{path}` draws 1 to {limit} pixels a side")]
    Size {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
        /// The path.
        path: Path,
        /// The longest side that the device can draw.
        limit: u32,
    },
    /// The frame has no draws.
    #[error("the frame draws nothing; add `.mesh(...)` or `.fullscreen(...)`")]
    Empty,
    /// No device can draw the frame with these settings.
    #[error("the frame can't be drawn: {reason}")]
    Unsound {
        /// The wrong setting, as the author writes it: `samples`, `formats`, `target`, `depth`, `mesh`.
        setting: &'static str,
        /// The reason.
        reason: String,
    },
    /// The executor can call functions, but can't draw.
    #[error(
        "path `{path}` draws no frames. They need a driver: `karat doctor` tells how to get one, and \
         `karat test --no-frames` leaves frames out"
    )]
    Unable {
        /// The path.
        path: Path,
    },
    /// The executor returned an image of the wrong size.
    #[error("path `{path}` drew {} x {} pixels instead of {} x {}", found.0, found.1, expected.0, expected.1)]
    OtherSize {
        /// The path.
        path: Path,
        /// The expected width and height.
        expected: (u32, u32),
        /// The width and height of the returned image.
        found: (u32, u32),
    },
}

impl DrawError {
    /// Returns `true` if a path refuses its input before any of it runs.
    pub(crate) fn is_refusal(&self) -> bool {
        match self {
            Self::Path(error) => error.is_refusal(),
            Self::Fixture(error) => error.is_unsupported(),
            Self::Unable { .. } => true,
            _ => false,
        }
    }
}

impl Blamed for DrawError {
    fn blame(&self) -> Blame<'_> {
        match self {
            Self::Reflect(error) => error.blame().or(&["fragment", "vertex"]),
            Self::Fixture(error) => error.blame(),
            Self::Rounds(found) => Blame::of(Some(found), &[]),
            Self::EntryPoint { name, .. } => Blame::entry_point(name),
            Self::Size { .. } => Blame::setting(&["size"]),
            Self::Unsound { setting, .. } => Blame::setting(std::slice::from_ref(setting)),
            _ => Blame::TEST,
        }
    }
}
