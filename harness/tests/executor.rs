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
}

const RIGHT: Fake = Fake { factor: 2.0, missing: 0 };

impl Executor for Fake {
    fn path(&self) -> Path {
        Path::CPU
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
        100 // fewer than the check has cases
    }

    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
        let results = arguments.iter().take(cases - self.missing);
        let results = results.map(|word| (self.factor * f32::from_bits(*word)).to_bits()).collect();
        Ok(Box::new(move || Ok(results)))
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
    assert!(wrong.contains("KARAT_PATHS=cpu"), "{wrong}");

    let missing = check(&Fake { missing: 1, ..RIGHT }).expect_err("a result is missing");
    assert_eq!(missing.to_string(), "the device returned 99 words instead of 100");
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
