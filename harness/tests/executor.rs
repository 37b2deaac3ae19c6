//! Checks on an executor that the test defines.

use karat::Image;
use karat::Path;
use karat::check::Failure;
use karat::draw::DrawError;
use karat::metric::Rect;
use karat::prelude::*;
use karat::unstable::draw::Drawing;
use karat::unstable::executor::Executor;
use karat::unstable::path::Adapter;
use karat::unstable::probe::{Call, Prepared, ProbeError, Started};

const SHADER: &str = "fn twice(x: f32) -> f32 { return 2.0 * x; }";

/// An executor that multiplies its argument on the host. A test sets the fields so that the executor returns wrong
/// results.
#[derive(Debug)]
struct Fake {
    factor: f32,
    /// The number of results that the executor leaves out.
    missing: usize,
    room: usize,
    path: Path,
}

/// A correct executor. The checks have more cases than this executor runs at once.
const RIGHT: Fake = Fake { factor: 2.0, missing: 0, room: 100, path: Path::CPU };

impl Executor for Fake {
    fn path(&self) -> Path {
        self.path
    }

    fn adapter(&self) -> Adapter {
        let (path, name) = (Path::CPU.to_string(), "Fake 3000".to_owned());
        Adapter { path, name, driver: String::new(), software: true }
    }

    /// Draws an image of one grey: half of [`Fake::factor`].
    fn draw(&self, drawing: &Drawing<'_>) -> Result<Image, DrawError> {
        assert_eq!((drawing.module(), drawing.fixtures().len()), ("", 0));
        let (width, height) = drawing.size();
        let pixels = (width * height) as usize;
        let gray = self.factor / 2.0;
        match self.missing {
            0 => Ok(Image::new(width, height, vec![[gray, gray, gray, 1.0]; pixels])),
            _ => Ok(Image::new(1, 1, vec![[1.0; 4]])),
        }
    }

    fn prepare<'e>(&'e self, call: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
        assert_eq!(call.probed.function().name, "twice");
        Ok(Box::new(self))
    }
}

impl Prepared for &Fake {
    fn capacity(&self) -> usize {
        self.room
    }

    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
        let results = arguments.iter().take(cases - self.missing);
        let results = results.map(|word| (self.factor * f32::from_bits(*word)).to_bits());
        let results: Vec<u32> = results.collect();
        Ok(Box::new(move |read| {
            read(&results, 1);
            Ok(())
        }))
    }
}

fn check(fake: &Fake) -> Result<karat::check::Agreement, Failure> {
    let package = Package::from_source("s", SHADER);
    let over = package.function("twice").on(fake).over(-1.0..=1.0).cases(1000);
    over.unrecorded().try_agrees_with(|x: f64| 2.0 * x, Ulp(0.0))
}

#[test]
fn a_custom_executor_is_checked_like_a_path() {
    let agreement = check(&RIGHT).expect("it is right");
    let paths: Vec<_> = agreement.paths.iter().map(|(adapter, _)| adapter.to_string()).collect();
    assert_eq!((agreement.cases, paths), (1000, vec!["cpu: Fake 3000".to_owned()]));

    let wrong = check(&Fake { factor: 2.001, ..RIGHT }).expect_err("a thousandth off").to_string();
    assert!(wrong.contains("on cpu: Fake 3000"), "{wrong}");
    // The environment can't select this executor, so the replay command doesn't name it.
    assert!(wrong.contains("replay: KARAT_SEED="), "{wrong}");

    let missing = check(&Fake { missing: 1, ..RIGHT }).expect_err("a result is missing");
    assert_eq!(missing.to_string(), "path `cpu` returned 99 u32 words instead of 100");
}

/// A tolerance or a known issue can name an executor by the executor's path or driver.
#[test]
fn tolerances_and_known_issues_hold_on_an_executor() {
    let package = Package::from_source("s", SHADER);
    let wrong = Fake { factor: 2.001, ..RIGHT };
    let over = || package.function("twice").on(&wrong).over(0.5..=1.0).cases(100);
    for selector in ["cpu", "@fake", "cpu@fake"] {
        let loose = over().tolerance_on(selector, Rel(1e-3));
        loose.agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
        over().fails_on(selector, "planted").agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
    }
    for selector in ["gl", "@llvmpipe", "cpu:hlsl"] {
        let loose = over().tolerance_on(selector, Rel(1e-3));
        loose
            .unrecorded()
            .try_agrees_with(|x: f64| 2.0 * x, Ulp(0.0))
            .expect_err("it isn't for this path");
    }
    let unknown = over().tolerance_on("cpv", Rel(1e-3));
    let error =
        unknown.unrecorded().try_agrees_with(|x: f64| 2.0 * x, Ulp(0.0)).expect_err("no path");
    assert!(error.to_string().contains("did you mean `cpu`?"), "{error}");
}

/// Each executor needs a path of its own that isn't a driver's path, and memory for at least one case.
#[test]
fn executors_without_a_name_or_room_are_refused() {
    let none = check(&Fake { room: 0, ..RIGHT }).expect_err("no room").to_string();
    assert_eq!(
        none,
        "the executor of path `cpu` doesn't have enough memory for one case of `twice`"
    );
    let driver = check(&Fake { path: Path::VULKAN, ..RIGHT }).expect_err("a driver's").to_string();
    assert!(driver.contains("another executor already has the path `vulkan`"), "{driver}");
    let mine: Path = "vulkan@mine".parse().expect("a name");
    check(&Fake { path: mine, ..RIGHT }).expect("a name of its own");
    let package = Package::from_source("s", SHADER);
    let both = package.function("twice").on(&RIGHT).on(&RIGHT).over(0.0..=1.0);
    let both = both.unrecorded().try_agrees_with(|x: f64| 2.0 * x, Ulp(0.0)).expect_err("one name");
    assert!(both.to_string().contains("another executor already has the path `cpu`"), "{both}");
}

/// A density runs on the executor of its sampler. If a test sets another executor for the density, that is an error.
#[test]
fn a_density_has_no_executor_of_its_own() {
    let wgsl = "fn sample(u: f32) -> f32 { return u; }\nfn twice(x: f32) -> f32 { return 1.0; }";
    let package = Package::from_source("s", wgsl);
    let sampled = package.function("sample").sampled_over(Just(()), |(), u: f32| u);
    let density = package.function("twice").on(&RIGHT);
    let found = sampled
        .support(Support::Interval(0.0, 1.0))
        .unrecorded()
        .try_follows(density, |(), x: f32| x);
    let error = found.expect_err("the executor would be passed over").to_string();
    assert!(error.contains("`twice` runs on the sampler's executors"), "{error}");
}

const FRAME: &str = "\
@vertex
fn cover(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return vec4f(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 1.0, 1.0);
}
@fragment
fn white() -> @location(0) vec4f { return vec4f(1.0); }
";

/// An executor that can call functions, but can't draw frames.
#[derive(Debug)]
struct Calls;

impl Executor for Calls {
    fn path(&self) -> Path {
        Path::CPU
    }

    fn adapter(&self) -> Adapter {
        RIGHT.adapter()
    }

    fn prepare<'e>(&'e self, call: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
        RIGHT.prepare(call)
    }
}

/// Karat judges the frames of an executor like the frames of a driver.
#[test]
fn an_executor_draws_frames_or_says_that_it_does_not() {
    let package = Package::from_source("s", FRAME);
    let mean = |executor: &dyn Executor| {
        let frame = package.frame("", 3, 2).fullscreen("cover", "white").on(executor);
        let whole = Rect { left: 0, top: 0, width: 3, height: 2 };
        frame
            .unrecorded()
            .try_has_mean(whole, [1.0; 3], Rel(1e-3))
            .map_err(|error| error.to_string())
    };
    let right = mean(&RIGHT).expect("it is white");
    let paths: Vec<_> = right.paths.iter().map(|(adapter, _)| adapter.to_string()).collect();
    assert_eq!(paths, ["cpu: Fake 3000"]);
    let gray = mean(&Fake { factor: 1.0, ..RIGHT }).expect_err("it is gray");
    assert!(
        gray.starts_with("the mean colour of") && gray.ends_with("\non cpu: Fake 3000"),
        "{gray}"
    );
    let small = mean(&Fake { missing: 1, ..RIGHT }).expect_err("it is small");
    assert_eq!(small, "path `cpu` drew 1 x 1 pixels instead of 3 x 2");
    let driver = mean(&Fake { path: Path::VULKAN, ..RIGHT }).expect_err("a driver's");
    assert!(driver.contains("another executor already has the path `vulkan`"), "{driver}");
    let none = mean(&Calls).expect_err("it draws nothing");
    assert!(none.starts_with("path `cpu` draws no frames"), "{none}");
}
