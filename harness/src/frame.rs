//! Frames: a scene drawn off-screen into linear float colour.
//!
//! A frame is a list of draws over one module's resources: meshes with a vertex and a fragment
//! function, and full-screen triangles. With a depth pre-pass, depth alone is drawn first and the
//! colour pass tests for equality, so each fragment is shaded once.

mod comparison;
mod expectation;
mod mesh;
mod renderer;

use std::collections::BTreeMap;

pub use expectation::FrameMean;
pub use mesh::{Attribute, Mesh};

use crate::diagnostic::Diagnostic;
use crate::fixture::{Fixture, FixtureError, Fixtures};
use crate::golden::{FrameMargin, FrameTolerance, GoldenError};
use crate::image::Image;
use crate::metric::{Mask, MaskError, Rect};
use crate::package::Package;
use crate::path::{self, Adapter, Path, PathError, Selected, Selector};
use crate::record::Verdict;
use crate::reflect::{ReflectError, Stage};
use crate::run::{Concluded, KnownIssue, KnownIssues, NotBegun, NotReplayed, Passed, Passes};
use crate::settings::SettingsError;
use crate::tolerance::LaneError;

/// What becomes of a pixel that is drawn again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Blend {
    /// The new value stays.
    #[default]
    Replace,
    /// Values add up. A fragment function that returns 1 counts how often a pixel is shaded.
    Add,
}

#[derive(Clone, Debug)]
pub(crate) struct Draw {
    pub(crate) vertex: String,
    pub(crate) fragment: String,
    /// What the depth pre-pass runs; `None`: depth comes from the triangles alone.
    pub(crate) depth_fragment: Option<String>,
    /// `None`: one triangle that covers the frame, from `@builtin(vertex_index)`.
    pub(crate) mesh: Option<(Mesh, u32)>,
}

/// A frame to be drawn.
#[derive(Clone, Debug)]
#[must_use = "a frame draws nothing until `.render(...)` or `.matches(...)`"]
pub struct Frame<'a> {
    package: &'a Package,
    module: String,
    width: u32,
    height: u32,
    fixtures: Fixtures,
    draws: Vec<Draw>,
    prepass: bool,
    blend: Blend,
    /// `None`: the default for the golden and the adapter.
    tolerance: Option<FrameTolerance>,
    tolerance_on: Selected<FrameTolerance>,
    mask: Option<Mask>,
    variance: Option<Image>,
    facts: BTreeMap<String, String>,
    aovs: Vec<(String, Self)>,
    known_issues: KnownIssues,
}

/// What a frame that matches its golden was compared on.
#[derive(Clone, Debug)]
pub struct FrameAgreement {
    /// Name of the golden.
    pub case: String,
    /// Each path with its margin.
    pub paths: Vec<(Adapter, FrameMargin)>,
    /// Paths that differ as was declared.
    pub known_issues: Vec<KnownIssue>,
}

/// Why a frame has no verdict, or a bad one.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// The shader is at fault.
    #[error(transparent)]
    Reflect(#[from] ReflectError),
    /// Fixtures and variables don't match.
    #[error(transparent)]
    Fixture(#[from] FixtureError),
    /// A path can't be used.
    #[error(transparent)]
    Path(#[from] PathError),
    /// Loops go round more often than the driver lets them.
    #[error("{0}")]
    Rounds(Box<Diagnostic>),
    /// The environment has a setting that can't be used.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// A check is to be replayed, and not here.
    #[error(transparent)]
    NotReplayed(#[from] NotReplayed),
    /// No such entry point.
    #[error("module `{module}` has no {stage} entry point `{name}`")]
    EntryPoint {
        /// The module.
        module: String,
        /// The stage that it should belong to.
        stage: Stage,
        /// What was asked for.
        name: String,
    },
    /// A bound that bounds nothing.
    #[error("the tolerance of the frame is {0}")]
    Tolerance(String),
    /// A name that no arbitrary output variable can have.
    #[error("`{0}` can't name an AOV: {1}")]
    Aov(String, &'static str),
    /// The mean of a rectangle is off.
    #[error(
        "on {adapter}\nthe mean of {rect} is {mean:?}, expected {expected:?}: {worst}, {} times what \
         is allowed",
        crate::tolerance::significant(worst.ratio)
    )]
    Mean {
        /// What rendered the frame.
        adapter: Box<Adapter>,
        /// The rectangle.
        rect: Rect,
        /// What was expected of red, green and blue.
        expected: [f64; 3],
        /// What they are.
        mean: [f64; 3],
        /// The worst of them.
        worst: LaneError,
    },
    /// A rectangle that isn't in the frame.
    #[error(transparent)]
    Rectangle(MaskError),
    /// A path agrees that is declared to fail.
    #[error(
        "`{case}` is as it should be on {path}, where it is declared to fail: {reason}\n\
         the bug is gone, or hidden: remove `.fails_on(...)`"
    )]
    UnexpectedPass {
        /// Name of the golden.
        case: String,
        /// The path.
        path: Path,
        /// What was declared.
        reason: String,
    },
    /// A path is declared to fail, and nobody says why.
    #[error("the frame is declared to fail on {0} without a reason: name the bug")]
    UnexplainedIssue(Selector),
    /// A side of 0 pixels, or more than the device can draw.
    #[error("the frame is {width} x {height}; path `{path}` draws 1 to {limit} pixels a side")]
    Size {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
        /// The path.
        path: Path,
        /// Longest side.
        limit: u32,
    },
    /// Nothing is drawn.
    #[error("the frame draws nothing; add `.mesh(...)` or `.fullscreen(...)`")]
    Empty,
    /// The golden differs, is missing or can't be used.
    #[error("on {adapter}\n{source}")]
    Golden {
        /// What rendered the frame.
        adapter: Box<Adapter>,
        /// What is wrong.
        source: Box<GoldenError>,
    },
}

impl FrameError {
    fn passes(case: &str, Passes { path, reason }: Passes) -> Self {
        Self::UnexpectedPass { case: case.to_owned(), path, reason }
    }
}

impl From<NotBegun> for FrameError {
    fn from(error: NotBegun) -> Self {
        match error {
            NotBegun::Settings(error) => Self::Settings(error),
            NotBegun::NotReplayed(error) => Self::NotReplayed(error),
        }
    }
}

impl Passed for FrameAgreement {
    fn known_issues(&self) -> &[KnownIssue] {
        &self.known_issues
    }
}

impl Passed for FrameMean {
    fn known_issues(&self) -> &[KnownIssue] {
        &self.known_issues
    }
}

impl<T: Passed> Concluded for Result<T, FrameError> {
    fn verdict(&self) -> Verdict {
        match self {
            Ok(passed) if passed.known_issues().is_empty() => Verdict::Pass,
            Ok(_) => Verdict::KnownIssue,
            Err(FrameError::Mean { .. } | FrameError::UnexpectedPass { .. }) => Verdict::Fail,
            Err(FrameError::Golden { source, .. })
                if matches!(
                    **source,
                    GoldenError::Differs { .. } | GoldenError::Unacceptable { .. }
                ) =>
            {
                Verdict::Fail
            }
            Err(_) => Verdict::Error,
        }
    }

    fn message(&self) -> Option<String> {
        self.as_ref().err().map(ToString::to_string)
    }
}

impl Package {
    /// Starts a frame of `width` x `height` pixels, drawn with entry points of `module`.
    pub fn frame(&self, module: &str, width: u32, height: u32) -> Frame<'_> {
        Frame {
            package: self,
            module: module.to_owned(),
            width,
            height,
            fixtures: Vec::new(),
            draws: Vec::new(),
            prepass: false,
            blend: Blend::Replace,
            tolerance: None,
            tolerance_on: Selected::default(),
            mask: None,
            variance: None,
            facts: BTreeMap::new(),
            aovs: Vec::new(),
            known_issues: KnownIssues::default(),
        }
    }
}

impl Frame<'_> {
    /// Supplies a texture, sampler or buffer for the resource variable `name`.
    pub fn with(mut self, name: &str, fixture: impl Into<Fixture>) -> Self {
        self.fixtures.push((name.to_owned(), fixture.into()));
        self
    }

    /// Draws `instances` copies of a mesh.
    pub fn mesh(mut self, vertex: &str, fragment: &str, mesh: Mesh, instances: u32) -> Self {
        let (vertex, fragment) = (vertex.to_owned(), fragment.to_owned());
        self.draws.push(Draw {
            vertex,
            fragment,
            depth_fragment: None,
            mesh: Some((mesh, instances)),
        });
        self
    }

    /// Draws one triangle whose three corners the vertex function makes from
    /// `@builtin(vertex_index)`. At depth 1 it is seen where no mesh is.
    pub fn fullscreen(mut self, vertex: &str, fragment: &str) -> Self {
        let (vertex, fragment) = (vertex.to_owned(), fragment.to_owned());
        self.draws.push(Draw { vertex, fragment, depth_fragment: None, mesh: None });
        self
    }

    /// Draws depth alone first, then colour where the depth is equal.
    pub fn depth_prepass(mut self) -> Self {
        self.prepass = true;
        self
    }

    /// Sets the fragment function that the depth pre-pass runs for the mesh added last: one that
    /// discards or writes depth as the colour's does. It returns nothing but a depth.
    ///
    /// # Panics
    /// If no mesh was added.
    pub fn depth_fragment(mut self, fragment: &str) -> Self {
        let mesh = self.draws.iter_mut().rev().find(|draw| draw.mesh.is_some());
        mesh.expect("a mesh comes before its `.depth_fragment(...)`").depth_fragment =
            Some(fragment.to_owned());
        self
    }

    /// Sets what becomes of a pixel that is drawn again (default: the new value stays).
    pub fn blend(mut self, blend: Blend) -> Self {
        self.blend = blend;
        self
    }

    /// Sets what the frame may differ by: a [`FrameTolerance`], or a number, the largest relative
    /// difference of a channel, with the gate alone and without outliers.
    ///
    /// The default is [`FrameTolerance::standard`], where a frame that fails the gate of 1e-3 still
    /// passes if HDR-FLIP sees next to nothing of it.
    pub fn tolerance(mut self, tolerance: impl Into<FrameTolerance>) -> Self {
        self.tolerance = Some(tolerance.into());
        self
    }

    /// Sets what the frame may differ by on paths whose driver or formats the golden wasn't made on:
    /// `Path::GL`, `"vulkan@nvidia"`, `"@llvmpipe"`, as [`Selector`] tells.
    pub fn tolerance_on(
        mut self,
        on: impl Into<Selector>,
        tolerance: impl Into<FrameTolerance>,
    ) -> Self {
        self.tolerance_on.declare(on.into(), tolerance.into());
        self
    }

    /// Compares only the pixels of a mask.
    pub fn mask(mut self, mask: Mask) -> Self {
        self.mask = Some(mask);
        self
    }

    /// Declares that the frame is noisy, with the variance of each pixel's mean in linear RGB: of
    /// `n` samples a pixel, that of the samples over `n`. It is kept with the golden. A frame that
    /// fails its tolerance still passes if the noise of both explains the difference, as
    /// [`Noise`](crate::metric::Noise) tells: by the means and the scatter of tiles, of each channel. One frame
    /// in a hundred is rejected by chance. HDR-FLIP takes no part, unless it is asked for.
    pub fn noise(mut self, variance: Image) -> Self {
        self.variance = Some(variance);
        self
    }

    /// Says something of the frame that is kept with its golden and shown when it differs: its
    /// seed, its samples a pixel.
    pub fn fact(mut self, name: &str, value: impl std::fmt::Display) -> Self {
        self.facts.insert(name.to_owned(), value.to_string());
        self
    }

    /// Keeps another frame of the same scene with the golden, such as its normals: it explains a
    /// difference, and isn't compared. It is drawn only when this frame differs or is new. `name` is
    /// that of a part of the EXR file: letters, digits, `-`, `_` and `.`.
    pub fn aov(mut self, name: &str, frame: Self) -> Self {
        self.aovs.push((name.to_owned(), frame));
        self
    }

    /// Declares that the frame differs from its golden on a path, and why: a driver's bug by its
    /// number. A frame that matches there after all fails, until the declaration is removed.
    pub fn fails_on(mut self, on: impl Into<Selector>, reason: &str) -> Self {
        self.known_issues.declare(on.into(), reason);
        self
    }

    /// Draws the frame on one path.
    ///
    /// # Errors
    /// If the shader isn't valid, a fixture is missing, or the path doesn't open.
    pub fn render(&self, path: Path) -> Result<Image, FrameError> {
        self.render_on(path::open(path)?).map(|drawn| drawn.image)
    }

    fn render_on(&self, device: &'static path::Device) -> Result<renderer::Drawn, FrameError> {
        if self.draws.is_empty() {
            return Err(FrameError::Empty);
        }
        let (width, height) = (self.width, self.height);
        let limit = device.device.limits().max_texture_dimension_2d;
        if width.min(height) == 0 || width.max(height) > limit {
            return Err(FrameError::Size { width, height, path: device.path(), limit });
        }
        renderer::render(device, self)
    }
}

impl Frame<'_> {
    pub(crate) fn package(&self) -> &Package {
        self.package
    }
    pub(crate) fn module(&self) -> &str {
        &self.module
    }
    pub(crate) fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }
    pub(crate) fn fixtures(&self) -> &Fixtures {
        &self.fixtures
    }
    pub(crate) fn draws(&self) -> &[Draw] {
        &self.draws
    }
    pub(crate) fn has_prepass(&self) -> bool {
        self.prepass
    }
    pub(crate) fn blending(&self) -> Blend {
        self.blend
    }
}
