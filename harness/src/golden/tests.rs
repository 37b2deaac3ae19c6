//! Tests that compare generated frames with goldens in a temporary folder.

mod acceptance;
mod kept;
mod verdict;

use super::acceptance::{Acceptance, Accepted};
use super::pending::PendingFrames;
use super::place::build_output;
use super::*;
use crate::image::ExrFile;
use crate::metric::{ExposureRange, Gate, Measured, Metric, Pair, Rect};
use tempfile::TempDir;

const LAVAPIPE: [&str; 2] = ["llvmpipe (LLVM 15.0.6, 256 bits)", "llvmpipe Mesa 22.3.6"];

fn adapter(path: &str) -> Adapter {
    let [name, driver] = LAVAPIPE.map(str::to_owned);
    Adapter { path: path.to_owned(), name, driver, software: true }
}

/// An image of 64 x 48 pixels: a ramp of brightness in the upper half, and bright pixels in the lower half.
fn ramp() -> Image {
    let pixel = |index: u32| {
        let (x, y) = ((index % 64) as f32, (index / 64) as f32);
        if y < 24.0 { [x / 64.0, 0.5, y / 24.0, 1.0] } else { [4.0, 2.0 + y / 64.0, 1.0, 1.0] }
    };
    Image::new(64, 48, (0..64 * 48).map(pixel).collect()).rounded_to(Precision::Half)
}

fn with(changes: &[(u32, u32)], factor: f32) -> Image {
    let mut image = ramp();
    for (x, y) in changes {
        for value in &mut image.pixels_mut()[(y * 64 + x) as usize][..3] {
            *value *= factor;
        }
    }
    image
}

static NO_FACTS: BTreeMap<String, String> = BTreeMap::new();

fn no_aovs() -> Vec<Part> {
    Vec::new()
}

/// A frame without declared tolerance, mask or facts.
fn rendered<'a>(image: &'a Image, adapter: &'a Adapter) -> Rendered<'a> {
    Rendered {
        image,
        adapter,
        shader: "shader".to_owned(),
        modules: Vec::new(),
        tolerance: None,
        mask: None,
        variance: None,
        facts: &NO_FACTS,
        aovs: &no_aovs,
        known_issue: false,
        other_waits: false,
    }
}

/// The image [`ramp`] with wrong values in a square of 8 x 8 pixels.
fn spot(factor: f32) -> Image {
    let pixels: Vec<_> = (8..16).flat_map(|y| (24..32).map(move |x| (x, y))).collect();
    with(&pixels, factor)
}

struct Project {
    folder: TempDir,
    goldens: Goldens,
}

impl Project {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let goldens = Goldens { beside: true, ..Goldens::open(folder.path()) };
        Self { folder, goldens }
    }

    /// A project with a golden that was made on lavapipe.
    fn with_golden() -> Self {
        let project = Self::new();
        let failed = project.check("vulkan", &ramp(), None, None).expect_err("no golden");
        project.accept(&failed, "first", None).expect("accepted");
        project
    }

    fn check(
        &self,
        path: &str,
        image: &Image,
        tolerance: Option<&FrameTolerance>,
        mask: Option<&Mask>,
    ) -> Result<FrameMargin, GoldenError> {
        let adapter = &adapter(path);
        let frame = Rendered { tolerance, mask, ..rendered(image, adapter) };
        self.goldens.check("room/ramp", &frame)
    }

    fn accept(
        &self,
        failed: &GoldenError,
        because: &str,
        profile: Option<&str>,
    ) -> Result<Accepted, AcceptError> {
        let (GoldenError::Missing { pending, .. } | GoldenError::Differs { pending, .. }) = failed
        else {
            panic!("nothing is pending: {failed}");
        };
        let pending = pending_at(Path::new(pending));
        let acceptance = Acceptance {
            because: because.to_owned(),
            by: Some("A. Reviewer".to_owned()),
            profile: profile.map(str::to_owned),
            ..Acceptance::default()
        };
        self.goldens.accept(&pending, &acceptance)
    }

    /// Names of the golden's parts.
    fn parts(&self) -> Vec<String> {
        let file = ExrFile::read(&self.folder.path().join("room/ramp.exr")).expect("readable");
        file.parts.into_iter().map(|part| part.name).collect()
    }

    fn text(&self, error: &GoldenError) -> String {
        let folder = shown(self.folder.path());
        let text = error.to_string().replace(&folder, "golden");
        let build = shown(&build_output().join("karat/pending"));
        text.replace(&build, "golden")
    }
}

fn pending_at(path: &Path) -> Pending {
    let (_, metadata) = Image::read_exr(path).expect("it was written");
    let provenance = Provenance::parse(&metadata.expect("it has facts")).expect("they are ours");
    Pending { case: provenance.case.clone(), path: path.to_owned(), provenance }
}

/// A metric with a fixed value.
#[derive(Debug)]
struct Red(f64);

impl Metric for Red {
    fn name(&self) -> String {
        "red".to_owned()
    }
    fn measure(&self, _: &Pair<'_>) -> Measured {
        Measured::of(self.0)
    }
}
