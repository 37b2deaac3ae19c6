//! Frames: a scene drawn off-screen into linear float colour.
//!
//! A frame is a list of draws over one module's resources: meshes with a vertex and a fragment
//! function, and full-screen triangles. With a depth pre-pass, depth alone is drawn first and the
//! colour pass tests for equality, so each fragment is shaded once.

mod mesh;
mod renderer;

pub use mesh::{Attribute, Mesh};

use crate::check::{Identity, KnownIssue, KnownIssues};
use crate::fixture::{Fixture, FixtureError, Fixtures};
use crate::golden::{
    DEFAULT_RELATIVE, FrameDifference, FrameMargin, GoldenError, Goldens, Rendered,
};
use crate::image::Image;
use crate::package::Package;
use crate::path::{self, Adapter, Path, PathError};
use crate::record::{self, PathRecord, Record, Subject, Verdict};
use crate::reflect::{ReflectError, Stage};

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
    relative: f32,
    relative_on: Vec<(Path, f32)>,
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
    /// A tolerance that isn't a number of at least 0.
    #[error("the tolerance of the frame is {0}; it is a relative difference of at least 0")]
    Tolerance(f32),
    /// A path agrees that is declared to fail.
    #[error(
        "`{case}` matches its golden on {path}, where it is declared to fail: {reason}\n\
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
    UnexplainedIssue(Path),
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
            relative: DEFAULT_RELATIVE,
            relative_on: Vec::new(),
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

    /// Sets the largest relative difference of a channel from the golden (default 1e-3).
    pub fn tolerance(mut self, relative: f32) -> Self {
        self.relative = relative;
        self
    }

    /// Sets another tolerance for one path, whose driver or formats the golden wasn't made on.
    pub fn tolerance_on(mut self, path: Path, relative: f32) -> Self {
        self.relative_on.push((path, relative));
        self
    }

    /// Declares that the frame differs from its golden on a path, and why: a driver's bug by its
    /// number. A frame that matches there after all fails, until the declaration is removed.
    pub fn fails_on(mut self, path: Path, reason: &str) -> Self {
        self.known_issues.declare(path, reason);
        self
    }

    /// Draws the frame on one path.
    ///
    /// # Errors
    /// If the shader isn't valid, a fixture is missing, or the path doesn't open.
    pub fn render(&self, path: Path) -> Result<Image, FrameError> {
        self.render_on(path::open(path)?).map(|(image, _)| image)
    }

    fn render_on(&self, device: &'static path::Device) -> Result<(Image, String), FrameError> {
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

    /// Draws the frame on each selected path and compares it with a golden.
    ///
    /// # Panics
    /// With the [`FrameError`], if it differs or there is nothing to compare with.
    #[track_caller]
    pub fn matches(&self, goldens: &Goldens, case: &str) -> FrameAgreement {
        let mut records = Vec::new();
        let result = self.compare(goldens, case, &mut records);
        let (verdict, message) = match &result {
            Ok(agreement) if agreement.known_issues.is_empty() => (Verdict::Pass, None),
            Ok(_) => (Verdict::KnownIssue, None),
            Err(error) => {
                let differs = matches!(error, FrameError::UnexpectedPass { .. })
                    || matches!(error, FrameError::Golden { source, .. }
                        if matches!(**source, GoldenError::Differs { .. }));
                let verdict = if differs { Verdict::Fail } else { Verdict::Error };
                (verdict, Some(error.to_string()))
            }
        };
        record::write(&Record {
            schema: record::SCHEMA,
            test: Identity::current().test,
            subject: Subject::Frame { golden: case.to_owned() },
            verdict,
            paths: records,
            message,
            overlay: record::overlay(),
        });
        match result {
            Ok(agreement) => agreement,
            Err(error) => panic!("{error}"),
        }
    }

    /// [`matches`](Self::matches) without the panic. The verdict is left to the caller and isn't
    /// recorded.
    ///
    /// # Errors
    /// If it differs or there is nothing to compare with.
    pub fn try_matches(&self, goldens: &Goldens, case: &str) -> Result<FrameAgreement, FrameError> {
        self.compare(goldens, case, &mut Vec::new())
    }

    fn compare(
        &self,
        goldens: &Goldens,
        case: &str,
        records: &mut Vec<PathRecord>,
    ) -> Result<FrameAgreement, FrameError> {
        let (mut paths, mut known_issues) = (Vec::new(), Vec::new());
        if let Some(path) = self.known_issues.unexplained() {
            return Err(FrameError::UnexplainedIssue(path));
        }
        let tolerances = self.relative_on.iter().map(|(_, relative)| *relative);
        for relative in tolerances.chain([self.relative]) {
            if !(relative >= 0.0 && relative.is_finite()) {
                return Err(FrameError::Tolerance(relative));
            }
        }
        for device in path::selected()? {
            let adapter = device.adapter();
            let (image, shader) = self.render_on(device)?;
            let own = self.relative_on.iter().rev().find(|(path, _)| *path == device.path());
            let relative = own.map_or(self.relative, |(_, relative)| *relative);
            let frame = Rendered { image: &image, adapter, shader, relative };
            let compared = goldens.check(case, &frame);
            let mut entry = PathRecord {
                adapter: adapter.clone(),
                cases: u64::from(self.width) * u64::from(self.height),
                failures: 0,
                worst: String::new(),
                ratio: None,
                asserted: format!("rel {relative:e}"),
                known_issue: self.known_issues.on(device.path()).map(str::to_owned),
            };
            match compared {
                Ok(margin) => {
                    entry.ratio = Some(f64::from(margin.ratio));
                    entry.worst = if margin.identical {
                        "equal".to_owned()
                    } else {
                        let relative = f64::from(margin.relative);
                        format!("rel {}", crate::tolerance::significant(relative))
                    };
                    let known_issue = entry.known_issue.clone();
                    records.push(entry);
                    if let Some(reason) = known_issue {
                        let (case, path) = (case.to_owned(), device.path());
                        return Err(FrameError::UnexpectedPass { case, path, reason });
                    }
                    paths.push((adapter.clone(), margin));
                }
                Err(GoldenError::Differs { difference, .. }) if entry.known_issue.is_some() => {
                    entry.failures = outliers(&difference);
                    known_issues.push(KnownIssue {
                        adapter: adapter.clone(),
                        reason: entry.known_issue.clone().unwrap_or_default(),
                        cases: entry.cases,
                        failures: entry.failures,
                    });
                    records.push(entry);
                }
                Err(source) => {
                    entry.failures = failures(&source);
                    records.push(entry);
                    return Err(FrameError::Golden {
                        adapter: Box::new(adapter.clone()),
                        source: Box::new(source),
                    });
                }
            }
        }
        Ok(FrameAgreement { case: case.to_owned(), paths, known_issues })
    }
}

fn failures(error: &GoldenError) -> u64 {
    match error {
        GoldenError::Differs { difference, .. } => outliers(difference),
        _ => 1,
    }
}

/// Pixels that are off; 1 of a frame that can't be compared at all.
fn outliers(difference: &FrameDifference) -> u64 {
    match difference {
        FrameDifference::Values { outliers, .. } => *outliers as u64,
        _ => 1,
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
