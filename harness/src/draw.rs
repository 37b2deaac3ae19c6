//! Draws frames: meshes and full-screen triangles, with the entry points of one module and their resources.
//!
//! A [`Drawing`] has the linked and validated shader of a frame and all other data that an
//! [`Executor`](crate::executor::Executor) needs to draw the frame. A depth pre-pass writes only depth. The colour pass
//! then draws only where its depth equals the depth from the pre-pass, so it shades each pixel once.

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

/// The old name of [`Shareable`](crate::value::Shareable), the trait of a mesh's attributes.
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

/// The reason why Karat can't draw a frame.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DrawError {
    /// Karat can't use the shader.
    #[error(transparent)]
    Reflect(#[from] ReflectError),
    /// The fixtures don't match the variables of the shader.
    #[error(transparent)]
    Fixture(#[from] FixtureError),
    /// Karat can't use a path.
    #[error(transparent)]
    Path(#[from] PathError),
    /// A loop runs more iterations than the driver allows.
    #[error("{0}")]
    Rounds(Box<Diagnostic>),
    /// The module has no entry point of the expected stage with this name.
    #[error("module `{module}` has no {stage} entry point `{name}`")]
    EntryPoint {
        /// The module.
        module: String,
        /// The expected stage of the entry point.
        stage: Stage,
        /// The name that the test gave.
        name: String,
    },
    /// The frame's width or height is 0, or larger than the device can draw.
    #[error(
        "the frame has {width} x {height} pixels; width and height must be from 1 to {limit} on path `{path}`"
    )]
    Size {
        /// The frame's width in pixels.
        width: u32,
        /// The frame's height in pixels.
        height: u32,
        /// The path.
        path: Path,
        /// The largest width and height that the device can draw.
        limit: u32,
    },
    /// The frame has no draws.
    #[error("the frame draws nothing: add `.mesh(...)` or `.fullscreen(...)`")]
    Empty,
    /// A setting of the frame is wrong, so no GPU can draw the frame.
    #[error("the frame can't be drawn: {reason}")]
    Unsound {
        /// The setting that is wrong, by its name in tests: `samples`, `formats`, `target`, `depth`, `mesh`.
        setting: &'static str,
        /// The reason.
        reason: String,
    },
    /// The executor calls functions, but draws no frames.
    #[error(
        "path `{path}` draws no frames. Frames need a driver: `karat doctor` explains how to get one. \
         `karat test --no-frames` skips frames"
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
    /// Checks if the path refused the frame before the path drew anything.
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
