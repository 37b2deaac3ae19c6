//! Tests the common verbs. Each verb finds its kind of fault, and refuses functions whose types don't fit the verb.

use glam::{Vec2, Vec3};
use karat::check::Failure;
use karat::prelude::*;

use crate::disagreement;

fn package(function: &str) -> Package {
    Package::from_source("o", function.to_owned())
}

/// The message of a check that Karat refuses, because the function's types don't fit the verb.
#[track_caller]
fn unsuited<T>(result: Result<T, Failure>) -> String {
    match result {
        Err(error @ Failure::Signature { .. }) => error.to_string(),
        Err(other) => panic!("it has no verdict for another reason: {other}"),
        Ok(_) => panic!("it has a verdict"),
    }
}

#[test]
fn results_that_are_not_finite() {
    let inverse = package("fn f(x: f32) -> vec2f { return vec2f(1.0, 1.0 / x); }");
    let over = |domain| inverse.function("f").over(domain);
    assert_eq!(
        over(0.5..=1.0).unrecorded().try_is_finite().expect("no pole is there").cases,
        65_536
    );
    let found = disagreement(over(0.0..=1.0).unrecorded().try_is_finite());
    assert_eq!(found.check, "is_finite");
    assert_eq!(found.assertion, "no result is NaN or infinite");
    let root = package("fn f(x: f32) -> f32 { return sqrt(x); }");
    disagreement(root.function("f").over(-1.0..=1.0).unrecorded().try_is_finite());
    let whole = package("fn f(x: u32) -> u32 { return x + 1u; }");
    let reason =
        unsuited(whole.function("f").over(Integers(0..=9_u32)).unrecorded().try_is_finite());
    assert!(reason.contains("u32, and this type is always finite"), "{reason}");
}

#[test]
fn results_outside_of_their_range() {
    let cosine = package("fn f(x: f32) -> vec2f { return vec2f(0.5, x * x); }");
    let over = || cosine.function("f").over(-1.0..=1.0);
    over().stays_within(0.0..=1.0);
    over().stays_within(0.0..);
    // Only one component at one of many values is wrong.
    let found = disagreement(over().unrecorded().try_stays_within(0.0..=0.999_999));
    assert_eq!((found.check, &*found.assertion), ("stays_within", "lies in 0..=0.999999"));
    disagreement(over().unrecorded().try_stays_within(1e-6..=1.0));
    // The float nearest to 2 pi is larger than 2 pi.
    let turn = package("fn f(x: f32) -> f32 { return 6.2831855 + x; }");
    turn.function("f").over(Just(0.0)).stays_within(0.0..=std::f64::consts::TAU);
    let next = turn.function("f").over(Just(4.8e-7));
    disagreement(next.unrecorded().try_stays_within(0.0..=std::f64::consts::TAU));
    let infinite = package("fn f(x: f32) -> f32 { return 1.0 / x; }");
    let open = infinite.function("f").over(0.0..=1.0);
    disagreement(open.unrecorded().try_stays_within(0.0..));
    for (least, most) in
        [(1.0, 0.0), (f64::NAN, 1.0), (0.0, f64::NAN), (f64::NEG_INFINITY, f64::INFINITY)]
    {
        let reason = unsuited(over().unrecorded().try_stays_within(least..=most));
        assert!(reason.contains("no result passes this check, or every result does"), "{reason}");
    }
    let truth = package("fn f(x: f32) -> bool { return x > 0.0; }");
    unsuited(truth.function("f").over(-1.0..=1.0).unrecorded().try_stays_within(0.0..=1.0));
}

/// For a range that excludes its end, `stays_within` fails if any result rounds to the end.
#[test]
fn results_at_the_end_of_a_half_open_range() {
    let part = package(
        "fn part(x: f32) -> f32 { return x - floor(x); }
        fn cell(x: f32) -> f32 { return min(x - floor(x), 0x1.fffffep-1f); }
        fn hill(x: f32, y: f32) -> f32 {
            let d = vec2f(x, y) - vec2f(0.37, 0.61);
            return 1.0 - dot(d, d);
        }
        fn angle(x: f32) -> f32 { return atan2(x, -1.0); }
        fn peak(x: f32) -> f32 { return select(0.5 * x, 2.0, x == 0.3333); }
        fn half(x: f32, y: f32) -> f32 { return 0.5 * x * y + 0.125 * (1.0 - x); }
        fn nth(i: u32) -> u32 { return i % 8u; }",
    );
    // 1 - 1e-9 rounds to 1.
    let found = part.function("part").over(-4.0..=4.0).unrecorded().try_stays_within(0.0..1.0);
    let found = disagreement(found);
    assert_eq!((found.check, &*found.assertion), ("stays_within", "lies in 0..<1"));
    let worst = &found.paths[0].worst;
    assert!(worst.searched && found.to_string().contains("worst (found by a search)"), "{found}");
    assert_eq!((f32::from_bits(worst.actual), &*worst.arguments[0].1), (1.0, "-1e-8"));
    let closed = part.function("part").over(-4.0..=4.0).stays_within(0.0..=1.0);
    let cell = part.function("cell").over(-4.0..=4.0).stays_within(0.0..1.0);
    let nth = || part.function("nth").over(Integers(0..=99_u32));
    nth().stays_within(0.0..8.0);
    let half = part.function("half").over((0.0..=1.0, 0.0..=1.0)).stays_within(0.0..1.0);
    let wide = part.function("half").over((0.0..=1.0, 0.0..=1.0)).stays_within(0.0..=0.625);
    // Around an integer, the interval of `x - floor(x)` is -1 to 1, because interval arithmetic doesn't know that both
    // x are equal.
    assert_eq!([half.proved, wide.proved, closed.proved, cell.proved], [true, true, false, false]);
    // No case is 0.3333, but the check finds the peak there.
    let peak = part.function("peak").over(0.0..=1.0).stays_within(0.0..=1.0);
    assert!(!peak.proved);
    disagreement(nth().unrecorded().try_stays_within(0.0..7.0));
    let above = (std::ops::Bound::Excluded(0.0), std::ops::Bound::Unbounded);
    let found = disagreement(nth().unrecorded().try_stays_within(above));
    assert_eq!(found.assertion, "is above 0");
    for range in [1.0..1.0, 1.0..0.0, f64::NAN..1.0, f64::NEG_INFINITY..f64::INFINITY] {
        let reason = unsuited(nth().unrecorded().try_stays_within(range));
        assert!(reason.contains("no result passes this check, or every result does"), "{reason}");
    }
    // The function has a smooth peak.
    let hill = part.function("hill").over((0.0..=1.0, 0.0..=1.0)).unrecorded();
    disagreement(hill.try_stays_within(0.0..1.0));
    // A range from 0 doesn't contain -0, for which the result is -pi.
    let angle = part.function("angle").over(0.0..=1.0).unrecorded().try_stays_within(0.0..3.2);
    angle.expect("from 0 on it is pi");
    // Every u32 is below 2^32.
    unsuited(nth().unrecorded().try_stays_within(0.0..4_294_967_296.0));
}

#[test]
fn vectors_of_another_length() {
    let half = package("fn f(a: vec3f, b: vec3f) -> vec3f { return normalize(a + b); }");
    let above = || half.function("f").over((Hemisphere.above(0.1), Hemisphere.above(0.1)));
    above().is_unit();
    let found =
        disagreement(half.function("f").over((UnitVector, UnitVector)).unrecorded().try_is_unit());
    assert!(found.paths[0].census.failures > 0, "opposite ones have no half");
    let mean = package("fn f(a: vec3f, b: vec3f) -> vec3f { return 0.5 * (a + b); }");
    let found = disagreement(
        mean.function("f")
            .over((Hemisphere.above(0.1), Hemisphere.above(0.1)))
            .unrecorded()
            .try_is_unit(),
    );
    assert_eq!(
        (found.check, &*found.assertion),
        ("is_unit", "each result has length 1 to within 1e-5")
    );
    let slightly = package("fn f(v: vec3f) -> vec3f { return 1.00002 * v; }");
    disagreement(slightly.function("f").over(UnitVector).unrecorded().try_is_unit());
    let scalar = package("fn f(x: f32) -> f32 { return 1.0; }");
    let reason = unsuited(scalar.function("f").over(0.0..=1.0).unrecorded().try_is_unit());
    assert!(reason.contains("f32, but this check needs a vector of floats"), "{reason}");
}

/// Functions that compute a basis around `n`. `sign` -1 gives a left-handed basis, and `lean` tilts the tangent towards
/// `n`.
fn basis(sign: &str, lean: &str) -> Package {
    package(&format!(
        "struct Frame {{ t: vec3f, b: vec3f, n: vec3f }}
         fn tangent(n: vec3f) -> vec3f {{
             let axis = select(vec3f(1.0, 0.0, 0.0), vec3f(0.0, 1.0, 0.0), abs(n.x) > 0.7);
             return normalize(normalize(cross(axis, n)) + {lean} * n);
         }}
         fn frame(n: vec3f) -> Frame {{
             let t = tangent(n);
             return Frame(t, {sign} * cross(n, t), n);
         }}
         fn columns(n: vec3f) -> mat3x3f {{ let f = frame(n); return mat3x3f(f.t, f.b, f.n); }}
         fn none(x: f32, n: vec3f) -> vec3f {{ return x * tangent(n); }}"
    ))
}

#[test]
fn frames_of_the_other_hand_and_vectors_that_lean() {
    let right = basis("1.0", "0.0");
    let over = |package: &'static Package, name| package.function(name).over(UnitVector);
    right.function("tangent").over(UnitVector).is_perpendicular_to("n");
    for name in ["frame", "columns"] {
        right.function(name).over(UnitVector).is_right_handed_frame();
    }
    let leaning: &Package = Box::leak(Box::new(basis("1.0", "1e-2")));
    let found = disagreement(over(leaning, "tangent").unrecorded().try_is_perpendicular_to("n"));
    assert_eq!(found.assertion, "each result is perpendicular to `n` to within 1e-5");
    assert_eq!(found.paths[0].census.failures, 65_536, "each leans by 1e-2");
    let found = disagreement(over(leaning, "frame").unrecorded().try_is_right_handed_frame());
    assert_eq!(found.check, "is_right_handed_frame");
    // A mirrored frame also has unit vectors at right angles.
    let left: &Package = Box::leak(Box::new(basis("-1.0", "0.0")));
    for name in ["frame", "columns"] {
        let found = disagreement(over(left, name).unrecorded().try_is_right_handed_frame());
        assert_eq!(found.paths[0].census.failures, 65_536, "each is mirrored");
    }
    // A zero vector is perpendicular to everything, but isn't a direction.
    let scaled = right.function("none").over((0.0..=1.0, UnitVector));
    let found = disagreement(scaled.unrecorded().try_is_perpendicular_to("n"));
    assert!(found.paths[0].census.failures < 65_536, "some are scaled by another number");
    let scaled = || right.function("none").over((0.5..=1.0, UnitVector)).unrecorded();
    scaled().try_is_perpendicular_to(1).expect("each is scaled by another number");
    let reason = unsuited(scaled().try_is_perpendicular_to("x"));
    assert!(
        reason.contains("has the parameter `x` of type f32: only vectors of the same type"),
        "{reason}"
    );
    assert!(unsuited(scaled().try_is_perpendicular_to("m")).contains("no parameter `m`"));
    let reason = unsuited(scaled().try_is_right_handed_frame());
    assert!(reason.contains("needs three vectors of three floats"), "{reason}");
}

// Lesson 175
#[test]
fn functions_that_are_not_their_other_form() {
    let text = |factor: &str| {
        package(&format!(
            "fn exact(c: f32, f0: vec3f) -> vec3f {{ return f0 + (1.0 - f0) * pow(1.0 - c, 5.0); }}
             fn fast(c: f32, f0: vec3f) -> vec3f {{
                 let x = 1.0 - c;
                 return f0 + ({factor} - f0) * (x * x * x * x * x);
             }}
             fn turned(f0: vec3f, c: f32) -> vec3f {{ return exact(c, f0); }}"
        ))
    };
    let compared = |package: &Package, reference: &str| {
        let check = package.function("fast").over((0.0..=1.0, UnitRgb));
        check.unrecorded().try_agrees_with_function(reference, Rel(1e-5))
    };
    assert_eq!(compared(&text("1.0"), "exact").expect("the same").cases, 65_536);
    disagreement(compared(&text("1.001"), "exact"));
    let reason = unsuited(compared(&text("1.0"), "turned"));
    assert!(
        reason.contains("takes (vec3<f32>, f32), but the domain supplies (f32, vec3<f32>)"),
        "{reason}"
    );
    let error = compared(&text("1.0"), "exakt").expect_err("there is none").to_string();
    assert!(error.contains("did you mean `exact`?"), "{error}");
    // Karat matches textures that are parameters by position.
    let image = |factor: &str| {
        package(&format!(
            "fn f(a: texture_2d<f32>, b: texture_2d<f32>, x: f32) -> f32 {{
                 return x * (textureLoad(a, vec2u(), 0).x - {factor} * textureLoad(b, vec2u(), 0).x);
             }}
             fn slow(b: texture_2d<f32>, d: texture_2d<f32>, x: f32) -> f32 {{
                 return x * textureLoad(b, vec2u(), 0).x - x * textureLoad(d, vec2u(), 0).x;
             }}"
        ))
    };
    let textures = |package: &Package| {
        let grey = |x: f32| Texture::from_fn(1, 1, move |_, _| glam::Vec4::splat(x));
        let probe = package.function("f").with("a", grey(0.75)).with("b", grey(0.25));
        probe.over(0.0..=1.0_f32).unrecorded().try_agrees_with_function("slow", Rel(1e-5))
    };
    textures(&image("1.0")).expect("the same");
    disagreement(textures(&image("1.01")));
    // The reference is evaluated in f64, so its result differs from the driver's result for the same WGSL.
    let body = "(x: vec2f) -> f32 { return x.x * x.x - x.y * x.y; }";
    let same = package(&format!("fn f{body}\nfn g{body}"));
    let same = || {
        let squares = ((1.0..=2.0_f32), (1.0..=2.0_f32)).map(|(x, y)| Vec2::new(x, y));
        same.function("f").over(squares)
    };
    disagreement(same().unrecorded().try_agrees_with_function("g", Rel(1e-7)));
    // A function compared with itself can't show its own mistake, only a driver's violation of WGSL.
    let reason = unsuited(same().unrecorded().try_agrees_with_function("f", Rel(1e-7)));
    assert!(reason.contains("is compared with itself"), "{reason}");
    same()
        .unrecorded()
        .try_agrees_with_function("f", Spec.needing(Abs(1e-5)))
        .expect("drivers keep to it");
}

#[test]
fn excluded_grazing_directions_are_not_drawn() {
    let grazing = package("fn f(v: vec3f) -> f32 { return select(1.0, 2.0, v.z < 0.01); }");
    let over = |domain: &dyn Fn() -> karat::unstable::domain::Above| {
        grazing.function("f").over(domain()).unrecorded().try_stays_within(1.0..=1.5)
    };
    over(&|| Hemisphere.above(0.01)).expect("nothing is below");
    disagreement(over(&|| Hemisphere.above(0.009)));
    let error = over(&|| Hemisphere.above(1.5)).expect_err("no cosine is so large").to_string();
    assert!(error.contains("needs a smallest cosine in 0..=1, not 1.5"), "{error}");
    assert_eq!(Hemisphere.above(1.0).edges(), [Vec3::Z]);
}

/// `has_none_of` reports only the requested kinds of hazards. It also accepts hazards that the test declares.
#[test]
fn hazards_of_a_kind() {
    use karat::check::HazardKind as Kind;
    let package = package(
        "fn capped(x: f32) -> f32 { return min(1.0 / x, 100.0) + pow(x, 5.0); }
        fn level(k: u32) -> f32 { var levels = array(0.0, 0.5, 1.0); return levels[k]; }",
    );
    let capped = || package.function("capped").over(0.0..=1.0).cases(512).unrecorded();
    let level = || package.function("level").over(Integers(0..=3_u32)).unrecorded();
    let found = disagreement(capped().try_has_none_of([Kind::Infinite]));
    assert_eq!(
        (found.check, &*found.assertion),
        ("has_none_of", "no operation has the hazard infinite")
    );
    // Of the kinds of hazards in the function, the message shows only the requested kinds.
    assert!(!found.to_string().contains("unbounded at"), "{found}");
    disagreement(capped().try_has_none_of([Kind::Nan, Kind::Infinite]));
    capped().try_has_none_of([Kind::Nan, Kind::OutOfRange]).expect("it has others");
    disagreement(level().try_has_none_of([Kind::OutOfRange]));
    level().try_has_none_of([Kind::Nan]).expect("it has another");

    let meant = "`min` caps it, and 0 to the fifth is 0";
    disagreement(capped().accept_hazard("1.0 / x", meant).try_has_no_hazards());
    let both = || capped().accept_hazard("1.0  /  x", meant).accept_hazard("pow(x, 5.0)", meant);
    both().try_has_no_hazards().expect("both are meant");
    for (reason, part) in [
        // Karat refuses an operation that doesn't exist, a kind that isn't requested, a missing reason, and an argument
        // that accepts no hazard.
        (unsuited(both().accept_hazard("2.0 / x", meant).try_has_no_hazards()), "isn't needed"),
        (
            unsuited(both().try_has_none_of([Kind::Infinite])),
            "`pow(x, 5.0)`; the declaration isn't needed",
        ),
        (unsuited(both().try_has_none_of([Kind::Nan])), "isn't needed: remove it"),
        (unsuited(capped().accept_hazard("1.0 / x", " ").try_has_no_hazards()), "has no reason"),
        (unsuited(both().try_is_finite()), "does nothing here"),
        (
            unsuited(capped().try_has_none_of([Kind::Race])),
            "no operation alone has the hazard `race`",
        ),
        (unsuited(capped().try_has_none_of([])), "the check names no kind of hazard"),
    ] {
        assert!(reason.contains(part), "{reason}");
    }
}
