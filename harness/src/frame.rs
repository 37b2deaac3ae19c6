//! Frames: Karat draws a scene off-screen into linear float colours, and checks the image.
//!
//! A frame is a list of draws: meshes with a vertex and a fragment function, and full-screen triangles. All draws use
//! the resources of one module.

mod comparison;
mod expectation;
pub(crate) mod pixel;
pub(crate) mod tap;

use std::borrow::Cow;
use std::collections::BTreeMap;

pub use expectation::FrameMean;

use crate::diagnostic::{Blame, Blamed, Diagnostic};
use crate::dispatch::Watched;
use crate::draw::{Blend, Draw, DrawError, Drawing, Format, Mesh, Scene, Source};
use crate::executor::{self, Executor};
use crate::fixture::{Fixture, Texture};
use crate::golden::{FrameMargin, FrameTolerance, GoldenError};
use crate::image::Image;
use crate::metric::{Mask, MaskError, Rect};
use crate::package::Package;
use crate::path::{Adapter, Path, PathError, Selected, Selector};
use crate::record::{Details, PathDetails};
use crate::run::{
    Fails, KnownIssue, KnownIssues, NotBegun, Passed, PathFailures, Stop, WrongDeclaration,
};
use crate::tolerance::LaneError;
use crate::value::Shareable;

/// A frame to draw and check.
///
/// ```no_run
/// use karat::prelude::*;
///
/// static SHADERS: Package = karat::package!("shaders");
/// static GOLDENS: karat::Goldens = karat::goldens!("golden");
///
/// // @fragment fn fragment(@location(0) uv: vec2f) -> @location(0) vec4f, in sky.wgsl
/// SHADERS.frame("sky", 256, 128).fragment("fragment").matches(&GOLDENS, "sky");
/// ```
#[derive(Clone, Debug)]
#[must_use = "a frame draws nothing until you call `.render(...)` or `.matches(...)`"]
pub struct Frame<'a> {
    scene: Scene<'a>,
    /// The frames that this frame reads as textures, by the name of the variable.
    inputs: Vec<(String, Self)>,
    /// The executors that draw the frame. If the list is empty, environment variables such as `KARAT_PATHS` select the
    /// paths.
    executors: Vec<&'a dyn Executor>,
    /// The test's tolerance. `None` stands for the default tolerance.
    tolerance: Option<FrameTolerance>,
    tolerance_on: Selected<FrameTolerance>,
    mask: Option<Mask>,
    variance: Option<Image>,
    facts: BTreeMap<String, String>,
    aovs: Vec<(String, Self)>,
    known_issues: KnownIssues,
    /// The position of the frame's declaration, if a `*.test.toml` or another file outside of Rust declares the frame.
    declared_at: Option<String>,
    /// `true` if Karat writes records of the verdicts.
    recorded: bool,
}

/// The result of a frame that matches its golden on each path.
///
/// ```
/// # use karat::prelude::*;
/// # use karat::image::{Image, Precision};
/// # let folder = tempfile::tempdir().expect("a folder");
/// # let pixels = vec![[0.5, 0.25, 0.0, 1.0]; 64];
/// # let golden = Image::new(8, 8, pixels);
/// # golden.write_exr(&folder.path().join("flat.exr"), Precision::Float, None).expect("written");
/// # let goldens = karat::Goldens::open(folder.path());
/// # let text = "@fragment fn fragment() -> @location(0) vec4f { return vec4f(0.5, 0.25, 0.0, 1.0); }";
/// # let package = Package::from_source("m", text);
/// let agreement = package.frame("", 8, 8).fragment("fragment").matches(&goldens, "flat");
/// for (adapter, margin) in &agreement.paths {
///     assert!(margin.is_identical(), "{adapter}: {margin}");
/// }
/// ```
#[derive(Clone, Debug)]
pub struct FrameAgreement {
    /// The name of the golden.
    pub case: String,
    /// Each path, with the frame's errors and their bounds on this path.
    pub paths: Vec<(Adapter, FrameMargin)>,
    /// The paths on which the frame differs, as the test declared with `fails_on`.
    pub known_issues: Vec<KnownIssue>,
}

/// The reason why a frame fails, or why Karat can't judge it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// Karat can't draw the frame.
    #[error(transparent)]
    Draw(#[from] DrawError),
    /// An environment variable has an unusable value, or asks Karat to replay another check.
    #[error(transparent)]
    NotBegun(#[from] NotBegun),
    /// A bound of the tolerance isn't a usable number.
    #[error("the tolerance of the frame is {0}")]
    Tolerance(String),
    /// An arbitrary output variable (AOV) has a name that Karat can't store in the golden's file.
    #[error("`{0}` can't name an AOV: {1}")]
    Aov(String, &'static str),
    /// The mean colour of a rectangle differs from the expected colour.
    #[error(
        "the mean colour of {rect} is {mean:?}, but the test expects {expected:?}: {worst}, {}\non {adapter}",
        crate::tolerance::times_allowed(worst.ratio)
    )]
    Mean {
        /// The adapter that rendered the frame.
        adapter: Box<Adapter>,
        /// The rectangle in the frame.
        rect: Rect,
        /// The expected mean of red, green and blue.
        expected: [f64; 3],
        /// The actual mean of red, green and blue.
        mean: [f64; 3],
        /// The error of the channel with the largest ratio.
        worst: LaneError,
    },
    /// A rectangle isn't inside the frame.
    #[error(transparent)]
    Rectangle(MaskError),
    /// A declaration about a path, such as `fails_on`, is wrong, or has no reason.
    #[error(transparent)]
    Declaration(#[from] WrongDeclaration),
    /// No draw changed any pixel.
    #[error(
        "no draw touches a pixel: all pixels still have the clear value {clear:?}. Check the position that the \
         vertex function returns, the culling and the depth"
    )]
    Untouched {
        /// The clear values of the frame.
        clear: [f32; 4],
    },
    /// An assertion of a fragment function is false.
    #[error("{0}")]
    Asserted(Box<Diagnostic>),
    /// Several paths fail, or some paths have no verdict.
    #[error("{0}")]
    Paths(Box<PathFailures<Self>>),
    /// The frame differs from its golden, or the golden is missing or unusable.
    #[error("{}", first_then(cause, adapter))]
    Golden {
        /// The adapter that rendered the frame.
        adapter: Box<Adapter>,
        /// The difference, or the reason why the golden is unusable.
        cause: Box<GoldenError>,
    },
}

impl Blamed for FrameError {
    fn blame(&self) -> Blame<'_> {
        match self {
            Self::Draw(error) => error.blame(),
            Self::Declaration(wrong) => wrong.blame(),
            Self::Tolerance(_) => Blame::setting(&["tolerance"]),
            Self::Asserted(found) => Blame::of(Some(found), &[]),
            Self::Paths(paths) => paths.blame(),
            _ => Blame::TEST,
        }
    }
}

impl Fails for FrameError {
    fn is_verdict(&self) -> bool {
        match self {
            Self::Mean { .. } | Self::Asserted(_) => true,
            Self::Declaration(wrong) => wrong.is_verdict(),
            Self::Golden { cause, .. } => {
                matches!(**cause, GoldenError::Differs { .. } | GoldenError::Unacceptable { .. })
            }
            Self::Paths(paths) => paths.all().any(Self::is_verdict),
            _ => false,
        }
    }

    fn details(&self) -> Details {
        match self {
            Self::Golden { adapter, .. } | Self::Mean { adapter, .. } => {
                Details { paths: vec![PathDetails::on(adapter)], ..Details::of(&self.to_string()) }
            }
            Self::Paths(failures) => failures.details(Self::details),
            other => Details::of(&other.to_string()).at(self.blame().message),
        }
    }
}

impl Stop for FrameError {
    fn is_refusal(&self) -> bool {
        matches!(self, Self::Draw(error) if error.is_refusal())
    }

    /// The text by which Karat groups paths that fail for the same cause, such as a missing golden.
    fn cause(&self) -> String {
        match self {
            Self::Golden { cause, .. } if matches!(**cause, GoldenError::Missing { .. }) => {
                "no golden".to_owned()
            }
            error => error.to_string(),
        }
    }

    fn of_paths(failures: PathFailures<Self>) -> Self {
        Self::Paths(Box::new(failures))
    }
}

impl From<PathError> for FrameError {
    fn from(error: PathError) -> Self {
        Self::Draw(error.into())
    }
}

impl Passed for FrameAgreement {
    fn known_issues(&self) -> &[KnownIssue] {
        &self.known_issues
    }
}

/// Writes the adapter on the second line, so the message begins with the cause.
fn first_then(source: &GoldenError, adapter: &Adapter) -> String {
    let text = source.to_string();
    match text.split_once('\n') {
        Some((first, rest)) => format!("{first}\non {adapter}\n{rest}"),
        None => format!("{text}\non {adapter}"),
    }
}

impl Passed for FrameMean {
    fn known_issues(&self) -> &[KnownIssue] {
        &self.known_issues
    }
}

impl Package {
    /// Begins a frame of `width` x `height` pixels. Entry points of `module` draw the frame.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// SHADERS.frame("sky", 256, 128).fragment("fragment").matches(&GOLDENS, "sky");
    /// ```
    pub fn frame(&self, module: &str, width: u32, height: u32) -> Frame<'_> {
        Frame {
            scene: Scene::new(self, module, (width, height)),
            inputs: Vec::new(),
            executors: Vec::new(),
            tolerance: None,
            tolerance_on: Selected::default(),
            mask: None,
            variance: None,
            facts: BTreeMap::new(),
            aovs: Vec::new(),
            known_issues: KnownIssues::default(),
            declared_at: None,
            recorded: true,
        }
    }
}

impl<'a> Frame<'a> {
    /// Supplies a texture, sampler or buffer for the resource variable `name`.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// SHADERS
    ///     .frame("sky", 64, 64)
    ///     .with("environment", CubeMap::constant(glam::Vec3::Z))
    ///     .with("filtering", Sampler::LINEAR)
    ///     .fragment("fragment")
    ///     .matches(&GOLDENS, "sky");
    /// ```
    pub fn with(mut self, name: &str, fixture: impl Into<Fixture>) -> Self {
        self.scene.fixtures.push((name.to_owned(), fixture.into()));
        self
    }

    /// Supplies the image of another frame for the texture variable `name`. Karat draws the other frame first, on the
    /// same path. The image is a 2D texture of floats. If the other frame shows its [`depth`](Self::depth), the image
    /// is a depth texture.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// let sharp = SHADERS.frame("sky", 64, 64).fragment("fragment");
    /// SHADERS
    ///     .frame("blur", 64, 64)
    ///     .with_frame("source", sharp)
    ///     .with("filtering", Sampler::LINEAR)
    ///     .fragment("fragment")
    ///     .matches(&GOLDENS, "blurred");
    /// ```
    pub fn with_frame(mut self, name: &str, frame: Self) -> Self {
        self.inputs.push((name.to_owned(), frame));
        self
    }

    /// Sets one member of a buffer, such as the time or the frame's number: `globals.time`. The buffer's fixture
    /// supplies all other members. Without a fixture, these members are zero. Karat stores the value in the golden's
    /// file.
    ///
    /// ```no_run
    /// # let shaders = karat::Package::from_source("m", "");
    /// # let frame = shaders.frame("m", 8, 8);
    /// let frame = frame.set("globals.time", 1.5_f32).set("globals.frame_count", 90_u32);
    /// ```
    pub fn set<T: Shareable>(mut self, member: &str, value: T) -> Self {
        let mut lanes = Vec::new();
        value.store(&mut lanes);
        self.facts.insert(member.to_owned(), T::shape().format(&lanes));
        self.scene.members.push((member.to_owned(), T::shape(), lanes));
        self
    }

    /// Sets an `override` of the shader, by its name or its `@id`. A `bool` is 0 or 1. Karat stores the value in the
    /// golden's file.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// SHADERS.frame("sky", 64, 64).with_override("STEPS", 8).fragment("fragment").matches(&GOLDENS, "sky");
    /// ```
    pub fn with_override(mut self, name: &str, value: impl Into<f64>) -> Self {
        let value = value.into();
        self.facts.insert(format!("override {name}"), value.to_string());
        self.scene.overrides.insert(name.to_owned(), value);
        self
    }

    /// Adds a draw with its state. Draws run in the order in which the test adds them.
    ///
    /// ```no_run
    /// use glam::Vec3;
    /// use karat::draw::{Cull, Draw, Mesh};
    /// use karat::prelude::*;
    ///
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// let triangle = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![0, 1, 2]);
    /// SHADERS
    ///     .frame("leaf", 64, 64)
    ///     .draw(Draw::mesh("vertex", "fragment", triangle).instances(100).cull(Cull::None))
    ///     .matches(&GOLDENS, "leaf");
    /// ```
    pub fn draw(mut self, draw: Draw) -> Self {
        self.scene.draws.push(draw);
        self
    }

    /// Draws `instances` copies of a mesh.
    ///
    /// ```no_run
    /// use glam::Vec3;
    /// use karat::draw::Mesh;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// let triangle = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![0, 1, 2]);
    /// SHADERS.frame("leaf", 64, 64).mesh("vertex", "fragment", triangle, 100).matches(&GOLDENS, "leaf");
    /// ```
    pub fn mesh(self, vertex: &str, fragment: &str, mesh: Mesh, instances: u32) -> Self {
        self.draw(Draw::mesh(vertex, fragment, mesh).instances(instances))
    }

    /// Draws one triangle. The vertex function computes the three corners from `@builtin(vertex_index)`. A triangle at
    /// depth 1 is visible only where the frame has no mesh.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// SHADERS.frame("sky", 64, 64).fullscreen("vertex", "fragment").matches(&GOLDENS, "sky");
    /// ```
    pub fn fullscreen(self, vertex: &str, fragment: &str) -> Self {
        self.draw(Draw::fullscreen(vertex, fragment))
    }

    /// Draws over the whole frame with only a fragment function: see [`Draw::fragment`].
    ///
    /// ```no_run
    /// # let shaders = karat::Package::from_source("m", "");
    /// # let goldens = karat::Goldens::open("golden".as_ref());
    /// shaders.frame("sky", 64, 64).fragment("fragment").matches(&goldens, "sky");
    /// ```
    pub fn fragment(self, fragment: &str) -> Self {
        self.draw(Draw::fragment(fragment))
    }

    /// Sets the formats of the targets, the first one at `@location(0)`. The default is one target of
    /// [`Format::Float`]. The frame's image is the first target, unless [`target`](Self::target) selects another one.
    ///
    /// ```no_run
    /// use karat::draw::Format;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// SHADERS
    ///     .frame("surface", 64, 64)
    ///     .formats([Format::Rgba8UnormSrgb, Format::Rg16Float])
    ///     .target(1) // compares the second target
    ///     .fragment("fragment")
    ///     .matches(&GOLDENS, "normals");
    /// ```
    pub fn formats(mut self, formats: impl IntoIterator<Item = Format>) -> Self {
        self.scene.formats = formats.into_iter().collect();
        self
    }

    /// Makes the target at this location the frame's image.
    ///
    /// ```no_run
    /// use karat::draw::Format;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// SHADERS
    ///     .frame("surface", 64, 64)
    ///     .formats([Format::Rgba8UnormSrgb, Format::Rg16Float])
    ///     .target(1) // @location(1)
    ///     .fragment("fragment")
    ///     .matches(&GOLDENS, "normals");
    /// ```
    pub fn target(mut self, location: usize) -> Self {
        self.scene.result = Source::Target(location);
        self
    }

    /// Makes the depth buffer the frame's image. The red channel has the depth, from 0 to 1.
    ///
    /// ```no_run
    /// use karat::draw::{Draw, Mesh};
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// # let scene = Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    /// SHADERS.frame("shadow", 64, 64).draw(Draw::depth("vertex", scene)).depth().matches(&GOLDENS, "map");
    /// ```
    pub fn depth(mut self) -> Self {
        self.scene.result = Source::Depth;
        self
    }

    /// Draws with this number of samples per pixel. The default is 1. Each pixel of the image is the mean of its
    /// samples. Every GPU supports 1 and 4 samples.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// SHADERS.frame("edge", 64, 64).samples(4).fullscreen("vertex", "fragment").matches(&GOLDENS, "edge");
    /// ```
    pub fn samples(mut self, samples: u32) -> Self {
        self.scene.samples = samples;
        self
    }

    /// Sets the values of each target before the first draw. The default is zeros.
    ///
    /// ```no_run
    /// use karat::draw::Blend;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// let frame = SHADERS.frame("glow", 64, 64).clear([0.0, 0.0, 0.1, 1.0]).blend(Blend::Add);
    /// frame.fullscreen("vertex", "fragment").matches(&GOLDENS, "glow at night");
    /// ```
    pub fn clear(mut self, color: [f32; 4]) -> Self {
        self.scene.clear = color;
        self
    }

    /// Sets the depth before the first draw. The default is 1. Use 0 for reversed depth, in which nearer points have
    /// larger depths.
    ///
    /// ```no_run
    /// use karat::draw::{Draw, Mesh};
    /// use karat::fixture::Compare;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// # let scene = Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    /// // Reversed depth: nearer points have larger depths.
    /// let draw = Draw::mesh("vertex", "fragment", scene).depth_compare(Compare::GreaterEqual);
    /// SHADERS.frame("scene", 64, 64).clear_depth(0.0).draw(draw).matches(&GOLDENS, "reversed");
    /// ```
    pub fn clear_depth(mut self, depth: f32) -> Self {
        self.scene.clear_depth = depth;
        self
    }

    /// Draws in two passes. The first pass writes only depth. The second pass draws colour only where its depth equals
    /// the depth from the first pass.
    ///
    /// ```no_run
    /// use karat::draw::Mesh;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// # let scene = Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    /// let frame = SHADERS.frame("scene", 64, 64).depth_prepass();
    /// frame.mesh("vertex", "fragment", scene, 1).matches(&GOLDENS, "scene");
    /// ```
    pub fn depth_prepass(mut self) -> Self {
        self.scene.prepass = true;
        self
    }

    /// Sets the fragment function that the depth pre-pass runs for the last mesh. This function must discard pixels and
    /// write depth exactly as the colour pass's function does. Its only allowed result is a depth.
    ///
    /// ```no_run
    /// use karat::draw::Mesh;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// # let leaves = Mesh::new(vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y], vec![0, 1, 2]);
    /// SHADERS
    ///     .frame("leaf", 64, 64)
    ///     .depth_prepass()
    ///     .mesh("vertex", "fragment", leaves, 100)
    ///     .depth_fragment("cutout") // discards the gaps between leaves
    ///     .matches(&GOLDENS, "leaf");
    /// ```
    ///
    /// # Panics
    /// Panics if the frame has no mesh yet.
    pub fn depth_fragment(mut self, fragment: &str) -> Self {
        let mesh = self.scene.draws.iter().rposition(Draw::is_mesh);
        let mesh = mesh.expect("add a mesh before `.depth_fragment(...)`");
        let draw = self.scene.draws.remove(mesh).depth_fragment(fragment);
        self.scene.draws.insert(mesh, draw);
        self
    }

    /// Sets the blending in all targets. By default, the new value replaces the pixel's old value.
    ///
    /// ```no_run
    /// use karat::draw::Blend;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// SHADERS
    ///     .frame("overdraw", 64, 64)
    ///     .blend(Blend::Add) // with a fragment function that returns 1: counts how often a pixel is shaded
    ///     .fullscreen("vertex", "fragment")
    ///     .matches(&GOLDENS, "overdraw");
    /// ```
    pub fn blend(mut self, blend: Blend) -> Self {
        self.scene.blend = blend;
        self
    }

    /// Sets how much the frame may differ from its golden: a [`FrameTolerance`] or a number. A number is a gate: the
    /// largest relative difference that each channel may have in any pixel.
    ///
    /// The default is [`FrameTolerance::standard`]: a gate of 1e-3. A frame that fails this gate still passes if
    /// HDR-FLIP sees almost no difference. By default, integers must be equal, and depths must be within 1e-5. HDR-FLIP
    /// doesn't judge integers and depths.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// SHADERS.frame("sky", 64, 64).fragment("fragment").tolerance(1e-3).matches(&GOLDENS, "sky");
    /// ```
    pub fn tolerance(mut self, tolerance: impl Into<FrameTolerance>) -> Self {
        self.tolerance = Some(tolerance.into());
        self
    }

    /// Sets how much the frame may differ from its golden on some paths: `Path::GL`, `"vulkan@nvidia"`, `"@llvmpipe"`
    /// (see [`Selector`]).
    ///
    /// ```no_run
    /// # use karat::Path;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// let frame = SHADERS.frame("sky", 64, 64).fragment("fragment");
    /// frame.tolerance_on(Path::GL, 1e-2).tolerance(1e-3).matches(&GOLDENS, "sky");
    /// ```
    pub fn tolerance_on(
        mut self,
        on: impl Into<Selector>,
        tolerance: impl Into<FrameTolerance>,
    ) -> Self {
        self.tolerance_on.declare(on.into(), tolerance.into());
        self
    }

    /// Compares only the pixels of a mask.
    ///
    /// ```no_run
    /// use karat::metric::{Mask, Rect};
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// // The frame's corner shows the time, which differs in each run.
    /// let clock = Rect::new(48, 0, 16, 8);
    /// let frame = SHADERS.frame("hud", 64, 64).mask(Mask::except(&[clock]));
    /// frame.fragment("fragment").matches(&GOLDENS, "hud");
    /// ```
    pub fn mask(mut self, mask: Mask) -> Self {
        self.mask = Some(mask);
        self
    }

    /// Declares that the frame is noisy. `variance` is the variance of each pixel's mean in linear RGB. With `n`
    /// samples per pixel, divide the variance of the samples by `n`. Karat stores the variance in the golden's file.
    ///
    /// A frame that fails its tolerance still passes if the noise of the frame and the golden explains the difference.
    /// [`Noise`](crate::metric::Noise) decides this for each channel: it divides the image into tiles, and checks the
    /// mean and the squared differences of each tile. `Noise` rejects one correct frame in a hundred by chance. Karat
    /// uses HDR-FLIP for a noisy frame only if the tolerance names HDR-FLIP.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// # let variance = karat::Image::new(64, 64, vec![[0.01; 4]; 64 * 64]);
    /// // The path tracer's estimate of the variance of each pixel's mean.
    /// SHADERS.frame("room", 64, 64).fragment("fragment").noise(variance).matches(&GOLDENS, "room");
    /// ```
    pub fn noise(mut self, variance: Image) -> Self {
        self.variance = Some(variance);
        self
    }

    /// Adds a fact about the frame, such as its seed or its number of samples per pixel. Karat stores the fact in the
    /// golden's file. Karat shows the fact if the frame differs.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// let frame = SHADERS.frame("room", 64, 64).set("globals.seed", 7_u32).fragment("fragment");
    /// frame.fact("seed", 7).fact("samples a pixel", 256).matches(&GOLDENS, "room");
    /// ```
    pub fn fact(mut self, name: &str, value: impl std::fmt::Display) -> Self {
        self.facts.insert(name.to_owned(), value.to_string());
        self
    }

    /// Stores another frame of the same scene in the golden's file, such as a frame that shows the normals of the
    /// surfaces. The other frame helps to explain a difference. Karat doesn't compare the other frame, and draws it
    /// only if this frame is new or differs. `name` is the name that the other frame has in the EXR file. Use letters,
    /// digits, `-`, `_` and `.`.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// let normals = SHADERS.frame("room", 64, 64).fragment("normals");
    /// SHADERS.frame("room", 64, 64).fragment("fragment").aov("normal", normals).matches(&GOLDENS, "room");
    /// ```
    pub fn aov(mut self, name: &str, frame: Self) -> Self {
        self.aovs.push((name.to_owned(), frame));
        self
    }

    /// Tells Karat to write no records of the frame's verdicts. Use this method in a test that expects a failure. Karat
    /// draws an unrecorded frame even with `KARAT_FRAMES=off`.
    ///
    /// ```
    /// # use karat::metric::Rect;
    /// # use karat::prelude::*;
    /// let text = "@fragment fn fragment() -> @location(0) vec4f { return vec4f(0.5, 0.25, 0.0, 1.0); }";
    /// let package = Package::from_source("m", text);
    /// let frame = package.frame("", 8, 8).fragment("fragment").unrecorded();
    /// frame.try_has_mean(Rect::new(0, 0, 8, 8), [1.0; 3], Abs(1e-6)).expect_err("it is darker");
    /// ```
    pub fn unrecorded(mut self) -> Self {
        self.recorded = false;
        self
    }

    /// Declares that the frame differs from its golden on a path, and gives the reason, such as the number of a
    /// driver's bug. If the frame matches on that path, the test fails until you remove the declaration.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// let frame = SHADERS.frame("sky", 64, 64).fragment("fragment");
    /// frame.fails_on("gl@llvmpipe", "mesa#1234").matches(&GOLDENS, "sky");
    /// ```
    pub fn fails_on(mut self, on: impl Into<Selector>, reason: &str) -> Self {
        self.known_issues.declare(on.into(), reason);
        self
    }

    /// Declares that a path refuses the frame, and gives the reason: see
    /// [`Check::refused_on`](crate::Check::refused_on).
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// let frame = SHADERS.frame("sky", 64, 64).fragment("fragment");
    /// frame.refused_on("gl", "naga#1234").matches(&GOLDENS, "sky");
    /// ```
    pub fn refused_on(mut self, on: impl Into<Selector>, reason: &str) -> Self {
        self.known_issues.declare_refusal(on.into(), reason);
        self
    }

    /// Sets the position of the declaration, as `file:line:column`, for a frame that isn't declared in Rust. Reports
    /// and annotations then show this position instead of the position of the call.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    /// let frame = SHADERS.frame("sky", 64, 64).fragment("fragment");
    /// frame.declared_at("shaders/sky.scene:3:1").matches(&GOLDENS, "sky");
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn declared_at(mut self, place: &str) -> Self {
        self.declared_at = Some(place.to_owned());
        self
    }

    fn place(&self, caller: &std::panic::Location<'_>) -> String {
        self.declared_at.clone().unwrap_or_else(|| caller.to_string())
    }

    /// Draws the frame on `executor` instead of the paths that environment variables such as `KARAT_PATHS` select. Each
    /// call adds an executor: see [`Probe::on`](crate::check::Probe::on).
    ///
    /// ```no_run
    /// use karat::unstable::executor::Executor;
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// # static GOLDENS: karat::Goldens = karat::goldens!("golden");
    ///
    /// fn matches_on(mine: &dyn Executor) {
    ///     SHADERS.frame("sky", 64, 64).fragment("fragment").on(mine).matches(&GOLDENS, "sky");
    /// }
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn on(mut self, executor: &'a dyn Executor) -> Self {
        self.executors.push(executor);
        self
    }

    /// Draws the frame on one path.
    ///
    /// ```no_run
    /// use karat::Path;
    /// use karat::prelude::*;
    ///
    /// let text = "@fragment fn fragment() -> @location(0) vec4f { return vec4f(0.5, 0.0, 0.0, 1.0); }";
    /// let package = Package::from_source("m", text);
    /// let image = package.frame("", 4, 4).fragment("fragment").render(Path::VULKAN)?;
    /// assert_eq!(image.pixels()[0][0], 0.5);
    /// # Ok::<(), karat::frame::FrameError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the shader isn't valid, a fixture is missing, or the path doesn't open.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn render(&self, path: Path) -> Result<Image, FrameError> {
        let executor = executor::of(path)?;
        Ok(drawn(executor, &self.drawing_on(executor)?)?)
    }

    /// Draws the frames that this frame reads, and returns this frame's drawing with their images as textures.
    fn drawing_on(&self, executor: &dyn Executor) -> Result<Drawing<'_>, DrawError> {
        if self.inputs.is_empty() {
            return self.scene.drawing();
        }
        let (mut scene, mut inputs) = (self.scene.clone(), Vec::new());
        for (name, frame) in &self.inputs {
            let drawing = frame.drawing_on(executor)?;
            let image = drawn(executor, &drawing)?;
            scene.fixtures.push((name.clone(), Texture::from(&image).into()));
            inputs.push(drawing);
        }
        let mut drawing = Drawing::of(Cow::Owned(scene))?;
        inputs.iter().for_each(|input| drawing.reads(input));
        Ok(drawing)
    }

    fn executors(&self) -> Result<Vec<&'a dyn Executor>, PathError> {
        executor::or_selected(&self.executors)
    }
}

/// The reason why the sanitizer doesn't check a frame that may write a resource. `None` if no draw writes a resource.
fn unwatched(drawing: &Drawing<'_>) -> Option<Watched> {
    let all = drawing.all_bindings();
    let written = all.iter().find(|binding| binding.kind.is_written())?;
    let reason = format!(
        "a draw can write `{}`: to find races between pixels, run `karat hazards`",
        written.name()
    );
    Some(Watched { reason, ..Watched::default() })
}

/// Draws the frame on an executor, and checks the size of the image.
fn drawn(executor: &dyn Executor, drawing: &Drawing<'_>) -> Result<Image, DrawError> {
    let image = executor::draw(executor, drawing)?;
    let (expected, found) = (drawing.size(), (image.width(), image.height()));
    if found == expected {
        return Ok(image);
    }
    Err(DrawError::OtherSize { path: executor.path(), expected, found })
}
