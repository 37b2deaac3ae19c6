//! Failing cases are reduced to the simplest that fail, remembered, and replayed.

use std::time::Instant;

use glam::{DVec3, Vec3};
use karat::prelude::*;
use karat::{Agreement, Disagreement, Failure};

#[track_caller]
fn disagreement(result: Result<Agreement, Failure>) -> Disagreement {
    match result {
        Ok(_) => panic!("the fault was not seen"),
        Err(Failure::Disagreement(disagreement)) => *disagreement,
        Err(other) => panic!("the check failed for another reason: {other}"),
    }
}

/// The arguments of the simplest case of every path, which must be the same.
#[track_caller]
fn simplest(found: &Disagreement) -> Vec<String> {
    let mut all = found.paths.iter().map(|path| {
        let simplest = path.simplest.as_ref().expect("the worst case can be reduced");
        simplest.failure.arguments.iter().map(|(_, value)| value.clone()).collect::<Vec<_>>()
    });
    let first = all.next().expect("a path fails");
    assert!(all.all(|other| other == first), "{found}");
    first
}

/// A fault above 0.3 in one of three arguments of a function.
const THREE: &str = "fn f(n: vec3f, x: f32, i: u32) -> f32 {\n    \
                     return select(n.z, 2.0, x > 0.3 && x < 0.9 && i > 4u);\n}";

#[test]
fn each_verb_reduces_its_worst_case() {
    let package = Package::from_source("planted", THREE);
    let over = || package.function("f").over((UnitVector, 0.0..=1.0, Integers(0..=1000_u32)));
    let found = over().try_agrees_with(|n: DVec3, _: f64, _: u32| n.z, Ulp(1.0));
    assert_eq!(simplest(&disagreement(found)), ["(0, 0, 1)", "0.5", "5"]);
    let found = over().try_satisfies("is at most 1", |_, z: f32| z <= 1.0);
    assert_eq!(simplest(&disagreement(found)), ["(0, 0, 1)", "0.5", "5"]);
    let found = over().try_invariant_under(|(n, x, i)| (n, x, i.max(4)), Ulp(0.0));
    assert!(found.is_ok(), "i is made no smaller than 4");
    let found = over().try_invariant_under(|(n, x, i)| (n, x, i.max(5)), Ulp(0.0));
    let found = disagreement(found);
    assert!(found.paths.iter().all(|path| path.simplest.is_none()), "an edge is simple: {found}");
    let over = package.function("f").over((UnitVector, 0.4..=0.51, Integers(1..=3_u32)));
    let found = over.try_invariant_under(|(n, x, i)| (n, x, i + 4), Ulp(0.0));
    assert_eq!(simplest(&disagreement(found)), ["(0, 0, 1)", "0.5", "1"]);
}

/// What is simplified is the value that was mapped, and a filter holds for each value tried.
#[test]
fn mapped_and_filtered_domains_are_reduced_within() {
    let wgsl = "fn f(l: vec3f, v: vec3f) -> f32 { return select(dot(l, v), 9.0, l.z < 0.7); }";
    let package = Package::from_source("planted", wgsl);
    let cosine = |l: Vec3| l.z >= 0.1 && l.z <= 0.9;
    let domain = (Hemisphere, Hemisphere).filter(move |(l, _)| cosine(*l)).map(|(l, v)| (v, l));
    let found = package.function("f").over(domain.map(|(v, l)| (l, v))).try_satisfies(
        "is at most 1, of cosines in the domain",
        move |(l, _), x: f32| {
            assert!(cosine(l), "{l} was never drawn");
            x <= 1.01
        },
    );
    assert_eq!(simplest(&disagreement(found)), ["(0.8, 0, 0.6)", "(0, 0, 1)"]);
}

/// Draws from a half to one, and takes zero, one quarter and three quarters for simpler.
#[derive(Debug)]
struct Upper;

impl Domain for Upper {
    type Value = f32;
    fn draw(&self, source: &mut karat::Source) -> Option<f32> {
        (0.5..=1.0).draw(source)
    }
    fn shrink(&self, value: &f32) -> Vec<f32> {
        [0.0, 0.25, 0.75].into_iter().filter(|simpler| simpler < value).collect()
    }
}

/// Values for which the reference isn't finite are no verdict, and not the end either.
#[test]
fn a_reference_that_fails_on_the_way_is_passed_over() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return 1.01 / x; }");
    let found = package.function("f").over(Upper).try_agrees_with(|x: f64| 1.0 / x, Rel(1e-5));
    assert_eq!(simplest(&disagreement(found)), ["0.25"]);
}

/// The same case every time, whatever the threads do.
#[test]
fn reducing_is_deterministic() {
    let package = Package::from_source("planted", THREE);
    let run = || {
        let over = package.function("f").over((UnitVector, 0.0..=1.0, Integers(0..=1000_u32)));
        disagreement(over.try_agrees_with(|n: DVec3, _: f64, _: u32| n.z, Ulp(1.0))).to_string()
    };
    assert_eq!(run(), run());
}

/// A check that passes evaluates its cases and nothing else.
#[test]
fn a_check_that_passes_tries_nothing_more() {
    use std::sync::atomic::{AtomicU64, Ordering};
    let package = Package::from_source("s", "fn f(x: f32) -> f32 { return x; }");
    let calls = AtomicU64::new(0);
    let count = |_: f32, _: f32| calls.fetch_add(1, Ordering::Relaxed) < u64::MAX;
    let start = Instant::now();
    let agreement = package.function("f").over(0.0..=1.0).satisfies("is counted", count);
    let paths = agreement.paths.len() as u64;
    assert_eq!(calls.into_inner(), 65_536 * paths, "{:?}", start.elapsed());
}
