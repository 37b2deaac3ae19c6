//! Tests that a check of an integral finds planted faults.

use glam::{DVec3, Vec3};
use karat::check::Failure;
use karat::prelude::*;
use std::f64::consts::{PI, TAU};

use crate::disagreement;
use crate::processes::planted;

/// Directions of the hemisphere around +Z, with weights for an integral of `f cos`. The directions have equal steps in
/// the squared sine and in the azimuth, so the weights already include the cosine.
pub(crate) fn hemisphere(size: u16) -> Vec<(Vec3, f64)> {
    let at = |index: u16| (f64::from(index) + 0.5) / f64::from(size);
    let node = |row: u16, column: u16| {
        let (sine_squared, azimuth) = (at(row), TAU * at(column));
        let (sine, cosine) = (sine_squared.sqrt(), (1.0 - sine_squared).sqrt());
        let l = DVec3::new(sine * azimuth.cos(), sine * azimuth.sin(), cosine);
        (l.as_vec3(), PI / (f64::from(size) * f64::from(size)))
    };
    (0..size).flat_map(|row| (0..size).map(move |column| node(row, column))).collect()
}

/// A diffuse BRDF `albedo * factor`. The right factor is 1/pi, and tests plant other factors.
pub(crate) fn diffuse(factor: &str) -> Package {
    let wgsl = format!(
        "fn eval(albedo: vec3f, l: vec3f) -> vec3f {{ return albedo * select(0.0, {factor}, l.z > 0.0); }}"
    );
    Package::from_modules("planted", [("brdf", wgsl)])
}

pub(crate) fn albedo_rule(albedo: &Vec3) -> Vec<((Vec3, Vec3), f64)> {
    hemisphere(16).into_iter().map(|(l, weight)| ((*albedo, l), weight)).collect()
}

/// The tolerance for two roundings to `f32`: of the factor, and of `albedo * factor`.
const ALBEDO: Rel = Rel(1.2e-7);

// Lesson 40: arguments from storage buffers, with controls
#[test]
fn an_integral_that_is_right() {
    let package = diffuse("0.318309886");
    let integral = || package.function("brdf::eval").integral(UnitRgb, albedo_rule);
    // WGSL may flush an albedo / pi below the least normal f32: 3.7e-38 of the integral.
    let tolerance = ALBEDO.or(Abs(3.7e-38));
    let agreement = integral().agrees_with(|albedo| albedo.as_dvec3(), tolerance);
    assert_eq!(agreement.cases, 256);
    let agreement = integral().cases(1000).unrecorded().try_is_at_most(|_| 1.0, 1.2e-7);
    assert_eq!(agreement.expect("no albedo is above 1").cases, 1000);
    let cases = OneOf(vec![Vec3::ZERO, Vec3::splat(0.5), Vec3::ONE]);
    let finite = package.function("brdf::eval").integral(cases, albedo_rule);
    let agreement = finite.unrecorded().try_is_at_most(|albedo| albedo.as_dvec3(), 1.2e-7);
    assert_eq!(agreement.expect("each value of a finite domain").cases, 3);
}

/// The BRDF has the factor 1/3 in place of 1/pi, so each integral is pi/3 times the albedo, which is 4.7 % too large.
#[test]
fn a_wrong_constant_in_an_integral() {
    let package = diffuse("0.33333334");
    let over = |cases| package.function("brdf::eval").integral(OneOf(cases), albedo_rule);
    let found = over([0.0, 0.25, 0.5, 0.75, 1.0].map(Vec3::splat).to_vec());
    let found =
        disagreement(found.unrecorded().try_agrees_with(|albedo| albedo.as_dvec3(), ALBEDO));
    assert_eq!((found.check, &*found.assertion), ("integral.agrees_with", "rel 1.2e-7"));
    for path in &found.paths {
        assert_eq!((path.census.cases, path.census.failures, path.census.too_high), (5, 4, 4));
        assert!(
            path.replay.to_string().contains("KARAT_CASE=brdf::eval/integral.agrees_with/"),
            "{found}"
        );
    }
    let found = over(vec![Vec3::new(0.0, 0.0, 0.75)]);
    let found =
        disagreement(found.unrecorded().try_agrees_with(|albedo| albedo.as_dvec3(), ALBEDO));
    for path in &found.paths {
        let integral = path.worst.integral.as_ref().expect("the check is one of integrals");
        assert_eq!((&*path.worst.component, integral.nodes), (".z", 256));
        assert!((integral.value - 0.25 * PI).abs() < 1e-7, "{found}");
    }
    let text = found.to_string();
    for part in [
        "error: `brdf::eval` fails integral.agrees_with: rel 1.2e-7",
        "  1 of 1 case fails (100.000%), 1 too high\n  worst (case 0)\n        \
         case = Vec3(0.0, 0.0, 0.75)\n      albedo = (0, 0, 0.75)\n    integral = (0, 0, 0.785398",
        ")  over 256 nodes\n      actual = 0.785398",
        "  at .z\n    expected = 0.75\n       error = rel 0.0472 (1.20e-7 allowed), 593883 ulp, abs 0.0354\n  replay: KARAT",
    ] {
        assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    }
}

#[test]
fn an_integral_above_its_bound() {
    let package = diffuse("0.33333334");
    let integral = || package.function("brdf::eval").integral(Just(Vec3::splat(0.75)), albedo_rule);
    let found = disagreement(integral().unrecorded().try_is_at_most(|_| 0.75, 0.03));
    assert_eq!(
        (found.check, &*found.assertion),
        ("integral.is_at_most", "each integral is at most its bound, plus the slack abs 3e-2")
    );
    let text = found.to_string();
    let part = "at most = 0.75\n       error = abs 0.0354 (0.03 allowed)";
    assert!(text.contains(part), "`{part}` is missing in:\n{text}");
    integral().unrecorded().try_is_at_most(|_| 0.75, 0.036).expect("the excess is 0.0354");
    integral().unrecorded().try_is_at_most(|_| 0.786, 0.0).expect("the bound is larger");
    // Each component has its own bound. The integral exceeds only the bound of the last component.
    let found =
        disagreement(integral().unrecorded().try_is_at_most(|_| DVec3::new(1.0, 1.0, 0.7), 0.0));
    assert!(found.paths.iter().all(|path| path.worst.component == ".z"), "{found}");
    // The integral is exactly the bound: each term and their sum are powers of two.
    let package = diffuse("0.5");
    let four = |albedo: &Vec3| vec![((*albedo, Vec3::Z), 0.5); 4];
    let integral = || package.function("brdf::eval").integral(Just(Vec3::splat(0.25)), four);
    integral().unrecorded().try_is_at_most(|_| 0.25, 0.0).expect("the integral is the bound");
    disagreement(integral().unrecorded().try_is_at_most(|_| 0.25_f64.next_down(), 0.0));
}

/// The integral has 100,000 nodes, which Karat evaluates in two dispatches. The function returns NaN or an infinity at
/// one node. The check fails whether the weight of this node is positive, negative or 0.
// Lesson 5
#[test]
fn one_bad_node_of_an_integral() {
    for (bits, nan, infinite) in [("0x7fc00000u", 3, 0), ("0xff800000u", 0, 3)] {
        let wgsl = format!(
            "fn f(i: u32, bad: u32) -> f32 {{ return select(1.0, bitcast<f32>(i - bad + {bits}), \
             i == bad); }}"
        );
        let package = Package::from_source("planted", wgsl);
        for weight in [1e-5, 0.0, -1e-5] {
            let bad = OneOf(vec![0_u32, 99_999, 70_000, 100_000]);
            let rule = move |bad: &u32| (0..100_000_u32).map(|i| ((i, *bad), weight)).collect();
            let integral = || package.function("f").integral(bad.clone(), rule);
            let loosest = Abs(6e38).or(Rel(1e83));
            let found = [
                disagreement(integral().unrecorded().try_agrees_with(|_| 1.0, loosest)),
                disagreement(integral().unrecorded().try_is_at_most(|_| 1e300, 6e38)),
            ];
            for path in found.iter().flat_map(|found| &found.paths) {
                assert_eq!((path.census.cases, path.census.failures), (4, 3));
                assert_eq!((path.census.nan, path.census.infinite), (nan, infinite));
                assert_eq!((path.worst.case, path.first.is_none()), (0, true));
            }
        }
        let one = package.function("f").integral(Just(70_000_u32), |bad| {
            (0..100_000_u32).map(|i| ((i, *bad), 0.25)).collect()
        });
        let text = disagreement(one.unrecorded().try_is_at_most(|_| 1e300, 0.0)).to_string();
        let value = if nan > 0 { "NaN" } else { "-inf" };
        let part = format!(
            "        case = 70000\n         bad = 70000\n    integral = {value}  over 100000 nodes\n        node = 70000: \
             i = 70000, bad = 70000 (weight 0.25)\n    returned = {value}\n     at most = 1e300\n"
        );
        assert!(text.contains(&part), "`{part}` is missing in:\n{text}");
    }
}

/// Karat refuses a quadrature rule without nodes, and weights or expected values that aren't finite.
// Lesson 4
#[test]
fn an_integral_of_nothing() {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
    let rule = |bad: Option<f64>| {
        move |case: &f32| -> Vec<(f32, f64)> {
            match bad {
                None if *case > 0.5 => Vec::new(),
                Some(weight) if *case > 0.5 => vec![(*case, 0.5), (*case, weight)],
                _ => vec![(*case, 1.0)],
            }
        }
    };
    let integral = |bad| package.function("f").integral(Grid::linear(0.0..=1.0, 5), rule(bad));
    let refused = |found: Result<karat::check::Agreement, Failure>| match found {
        Err(failure @ Failure::Rule { .. }) => failure.to_string(),
        other => panic!("the rule was not refused: {other:?}"),
    };
    let empty = "for case 3 (0.75), the quadrature rule of `f` has no nodes, so it can't \
                 integrate";
    assert_eq!(
        refused(integral(None).unrecorded().try_agrees_with(|x| f64::from(*x), Abs(6e38))),
        empty
    );
    assert_eq!(refused(integral(None).unrecorded().try_is_at_most(|_| 1e300, 6e38)), empty);
    for weight in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let text = refused(integral(Some(weight)).unrecorded().try_is_at_most(|_| 1e300, 6e38));
        let expected = format!(
            "for case 3 (0.75), the quadrature rule of `f` has the weight {weight} at node 1, but weights must be finite"
        );
        assert_eq!(text, expected);
    }

    let whole = || package.function("f").integral(0.0..=1.0_f32, |x| vec![(*x, 1.0)]);
    for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let found = [
            whole().unrecorded().try_agrees_with(|_| value, Abs(1.0)),
            whole().unrecorded().try_is_at_most(|_| value, 1.0),
        ];
        assert!(found.iter().all(|f| matches!(f, Err(Failure::Reference { .. }))), "{found:?}");
    }
    for bound in [f64::NAN, f64::INFINITY, -1.0] {
        let found = [
            whole().unrecorded().try_agrees_with(|_| 0.5, Abs(bound)),
            whole().unrecorded().try_is_at_most(|_| 0.5, bound),
        ];
        assert!(found.iter().all(|f| matches!(f, Err(Failure::Signature { .. }))), "{found:?}");
    }
    let none = [
        whole().cases(0).unrecorded().try_is_at_most(|_| 1.0, 0.0),
        package
            .function("f")
            .integral(OneOf::<f32>(vec![]), |x| vec![(*x, 1.0)])
            .unrecorded()
            .try_is_at_most(|_| 1.0, 0.0),
        package
            .function("f")
            .integral((0.0..=1.0).filter(|_: &f32| false), |x| vec![(*x, 1.0)])
            .unrecorded()
            .try_is_at_most(|_| 1.0, 0.0),
    ];
    assert!(none.iter().all(|found| matches!(found, Err(Failure::Domain { .. }))), "{none:?}");
}

#[test]
fn an_integral_of_other_types() {
    let wgsl =
        "fn f(x: f32, n: u32) -> vec2f { return vec2f(x); } fn g(n: u32) -> u32 { return n; }";
    let package = Package::from_source("planted", wgsl);
    let right = |x: &f32| vec![((*x, 7_u32), 1.0)];
    let whole = || package.function("f").integral(0.0..=1.0_f32, right);
    let found = [
        package
            .function("f")
            .integral(0.0..=1.0_f32, |x| vec![(*x, 1.0)])
            .unrecorded()
            .try_is_at_most(|_| 1.0, 0.0),
        whole().unrecorded().try_agrees_with(|_| 1.0, Abs(1.0)),
        whole().unrecorded().try_is_at_most(|_| DVec3::ONE, 0.0),
        whole().unrecorded().try_agrees_with(
            |x| glam::DVec2::splat(f64::from(*x)),
            Tolerance::per_lane([Abs(1.0).into()]),
        ),
        package
            .function("g")
            .integral(Just(7_u32), |n| vec![(*n, 1.0)])
            .unrecorded()
            .try_agrees_with(|n| *n, Abs(1.0)),
    ];
    let expected = [
        "takes (f32, u32), but the quadrature rule supplies (f32)\n",
        "returns vec2<f32>, but the expected integral is f32\n",
        "returns vec2<f32>, but the bound is vec3<f32>\n",
        "returns 2 components, but the tolerance has bounds for 1\n",
        "returns u32, but an integral is a sum of floats\n",
    ];
    for (found, expected) in found.into_iter().zip(expected) {
        match found {
            Err(failure @ Failure::Signature { .. }) => {
                assert!(failure.to_string().contains(expected), "{failure}");
            }
            other => panic!("not a mismatch of signatures: {other:?}"),
        }
    }
    whole().unrecorded().try_is_at_most(|_| 1.0, 0.0).expect("a bound for both components");
}

/// The replay command in the message runs only the failing integral. The record has the number of integrals and the
/// number of nodes.
// Lesson 9: the record has the number of cases
#[test]
fn an_integral_is_replayed_and_recorded() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder_name = folder.path().display().to_string();
    let (output, text) = planted(&["integral"], &[("KARAT_RECORD", &folder_name)]);
    assert!(!output.status.success(), "{text}");
    let records = karat::unstable::record::read(folder.path()).expect("the verdict was recorded");
    let [record] = &*records else { panic!("one check, {} records", records.len()) };
    assert_eq!(record.verdict, karat::unstable::record::Verdict::Fail);
    for path in &record.paths {
        assert_eq!((path.cases, &*path.asserted), (256, "rel 1e-6 (2560 nodes)"));
        assert!(0 < path.failures && path.failures < 256, "{path:?}");
    }
    let line = text.lines().find_map(|line| line.trim().strip_prefix("replay: "));
    let words = line.expect("a failure says how to replay it").split(' ');
    let environment: Vec<(&str, &str)> = words.map_while(|word| word.split_once('=')).collect();
    let (output, again) = planted(&["integral"], &environment);
    assert!(!output.status.success() && again.contains("1 of 1 case fails"), "{again}");
    let shown = |text: &str| {
        let titles = ["  simplest (reduced", "  worst (case"];
        let from = titles.iter().find_map(|title| text.find(title)).expect("a case is shown");
        text[from..].lines().skip(1).take(5).collect::<Vec<_>>().join("\n")
    };
    assert_eq!(shown(&text), shown(&again));
}

/// Checks integrals over directions. One function has a wrong constant, so the check fails. Another function has a lobe
/// between the rings of directions. For this function, the two quadrature rules disagree, so the check has no verdict.
// Lesson 67
#[test]
fn an_integral_over_directions() {
    let check = |body: &str, directions, expected: f64| {
        let wgsl = format!("fn f(k: f32, l: vec3f) -> f32 {{ return k * {body}; }}");
        let package = Package::from_source("planted", wgsl);
        let over = package.function("f").over(0.0..=2.0).cases(16);
        let integral = over.clone().unrecorded().try_integrates_to_at_most(
            directions,
            |k| f64::from(*k) * expected,
            1e-6,
        );
        let equal = over.unrecorded().try_integrates_to(
            directions,
            |k| f64::from(*k) * expected,
            Abs(1e-6),
        );
        (equal, integral)
    };
    let agrees = |(equal, below): (
        Result<karat::check::Agreement, _>,
        Result<karat::check::Agreement, _>,
    )| {
        assert_eq!(equal.expect("it is right").cases, 16);
        assert_eq!(below.expect("it is right").cases, 16);
    };
    agrees(check("max(l.z, 0.0) / radians(180.0)", Directions::hemisphere(), 1.0));
    agrees(check("1.0 / radians(180.0)", Directions::projected_hemisphere(), 1.0));
    agrees(check("l.z * l.z / radians(240.0)", Directions::sphere().rings(8), 1.0));
    let (equal, below) = check("1.001 * l.z / radians(180.0)", Directions::hemisphere(), 1.0);
    let found = disagreement(equal);
    assert!(found.paths.iter().all(|path| path.census.too_high > 0));
    assert!(!found.to_string().contains("`rings`"), "two rules agree: {found}");
    disagreement(below);
    let (equal, below) = check("0.999 * l.z / radians(180.0)", Directions::hemisphere(), 1.0);
    disagreement(equal);
    below.expect("it is less");
    // The results of both rules differ more from the expected value than from each other. The failure shows both
    // results.
    let lobe = "1e5 * exp(1e3 * (l.z - 1.0))";
    let coarse = Directions::hemisphere().rings(32);
    for found in <[_; 2]>::from(check(lobe, coarse, 1.0)) {
        let found = disagreement(found);
        for path in &found.paths {
            let integral = path.worst.integral.as_ref().expect("an integral");
            let expected = path.worst.expected.expect("a number");
            let (control, nodes) = integral.control.expect("the rules differ");
            assert!(integral.value > 500.0 * expected && expected > 0.0, "{found}");
            assert!(control > 300.0 * expected && nodes == 2 * 24 * 24, "{found}");
        }
        let text = found.to_string();
        assert!(text.contains("     control = "), "{text}");
        assert!(text.contains("the two quadrature rules disagree: try more `rings`"), "{text}");
    }
    // A failing case is a verdict, even if other cases have no verdict.
    let mixed =
        "select(2.0 * l.z / radians(180.0), exp(1e3 * (l.z - 1.0)) / 6.2831853e-3, k < 1.0)";
    for found in <[_; 2]>::from(check(mixed, coarse, 1.0)) {
        let found = disagreement(found);
        for path in &found.paths {
            assert!((1..16).contains(&path.census.failures), "{found}");
            let value = path.worst.integral.as_ref().expect("an integral").value;
            assert!((value / path.worst.expected.expect("a number") - 2.0).abs() < 1e-4, "{found}");
        }
    }
    for found in <[_; 2]>::from(check("exp(1e3 * (l.x - 1.0))", Directions::sphere(), 6.283e-3)) {
        let error = found.expect_err("a lobe of 0.03 between rings of 0.05");
        let rule = |error: &Failure| matches!(error, Failure::Rule { .. });
        let undecided = match &error {
            Failure::Paths(paths) => paths.stopped.iter().all(|(_, error)| rule(error)),
            error => rule(error),
        };
        assert!(undecided, "{error}");
        assert!(error.to_string().contains("so there is no verdict: use more rings"), "{error}");
    }
    let (equal, _) = check("sqrt(l.z)", Directions::sphere(), 1.0);
    assert!(disagreement(equal).paths.iter().all(|path| path.census.nan > 0));
    // The direction is the function's only argument.
    let package = Package::from_source("planted", "fn f(l: vec3f) -> f32 { return 0.25; }");
    let found = package.function("f").over(()).unrecorded().try_integrates_to(
        Directions::sphere(),
        |()| PI,
        Rel(1e-6),
    );
    assert_eq!(found.expect("a quarter of 4 pi").cases, 1);
}
