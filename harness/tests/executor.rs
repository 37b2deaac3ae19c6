//! A check on an executor of one's own: the seam between checks and what runs shaders.

use karat::Path;
use karat::check::Failure;
use karat::path::Adapter;
use karat::prelude::*;
use karat::probe::{Call, Executor, Prepared, ProbeError, Started};

const SHADER: &str = "fn twice(x: f32) -> f32 { return 2.0 * x; }";

/// Multiplies its argument on the host. What it gets wrong is planted.
#[derive(Debug)]
struct Fake {
    factor: f32,
    /// Results that are left out.
    missing: usize,
    room: usize,
    path: Path,
}

/// It has room for fewer cases than the checks have.
const RIGHT: Fake = Fake { factor: 2.0, missing: 0, room: 100, path: Path::CPU };

impl Executor for Fake {
    fn path(&self) -> Path {
        self.path
    }

    fn adapter(&self) -> Adapter {
        let (path, name) = (Path::CPU.to_string(), "Fake 3000".to_owned());
        Adapter { path, name, driver: String::new(), software: true }
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
    over.try_agrees_with(|x: f64| 2.0 * x, Ulp(0.0))
}

#[test]
fn an_executor_of_ones_own_is_a_path_like_others() {
    let agreement = check(&RIGHT).expect("it is right");
    let paths: Vec<_> = agreement.paths.iter().map(|(adapter, _)| adapter.to_string()).collect();
    assert_eq!((agreement.cases, paths), (1000, vec!["cpu: Fake 3000".to_owned()]));

    let wrong = check(&Fake { factor: 2.001, ..RIGHT }).expect_err("a thousandth off").to_string();
    assert!(wrong.contains("on cpu: Fake 3000"), "{wrong}");
    // The environment doesn't select it, so a replay doesn't ask for it.
    assert!(wrong.contains("replay: KARAT_SEED="), "{wrong}");

    let missing = check(&Fake { missing: 1, ..RIGHT }).expect_err("a result is missing");
    assert_eq!(missing.to_string(), "path `cpu` returned 99 words instead of 100");
}

/// Tolerances and known issues are declared for it by its name, or by its driver.
#[test]
fn what_is_declared_holds_there() {
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
        loose.try_agrees_with(|x: f64| 2.0 * x, Ulp(0.0)).expect_err("it isn't for this path");
    }
    let unknown = over().tolerance_on("cpv", Rel(1e-3));
    let error = unknown.try_agrees_with(|x: f64| 2.0 * x, Ulp(0.0)).expect_err("no path");
    assert!(error.to_string().contains("did you mean `cpu`?"), "{error}");
}

/// Each executor has a name of its own, which no driver has, and room for a case.
#[test]
fn executors_that_cannot_be_told_apart_or_do_nothing_are_refused() {
    let none = check(&Fake { room: 0, ..RIGHT }).expect_err("no room").to_string();
    assert_eq!(none, "the executor of path `cpu` has room for no case of `twice`");
    let driver = check(&Fake { path: Path::VULKAN, ..RIGHT }).expect_err("a driver's").to_string();
    assert!(driver.contains("another executor is called `vulkan` already"), "{driver}");
    let mine: Path = "vulkan@mine".parse().expect("a name");
    check(&Fake { path: mine, ..RIGHT }).expect("a name of its own");
    let package = Package::from_source("s", SHADER);
    let both = package.function("twice").on(&RIGHT).on(&RIGHT).over(0.0..=1.0);
    let both = both.try_agrees_with(|x: f64| 2.0 * x, Ulp(0.0)).expect_err("one name");
    assert!(both.to_string().contains("another executor is called `cpu` already"), "{both}");
}

/// A density runs where its sampler runs; an executor of its own isn't passed over.
#[test]
fn a_density_has_no_executor_of_its_own() {
    let wgsl = "fn sample(u: f32) -> f32 { return u; }\nfn twice(x: f32) -> f32 { return 1.0; }";
    let package = Package::from_source("s", wgsl);
    let sampled = package.function("sample").sampled_over(Just(()), |(), u: f32| u);
    let density = package.function("twice").on(&RIGHT);
    let found = sampled.on(Support::Interval(0.0, 1.0)).try_follows(density, |(), x: f32| x);
    let error = found.expect_err("the executor would be passed over").to_string();
    assert!(error.contains("`twice` runs where the sampler runs"), "{error}");
}
