//! Tests that planted hazards are found at their lines.

use karat::check::Failure;
use karat::prelude::*;
use karat_inspect::hazards::{Class, Hazard, HazardError, Hazards, Kind};
use karat_inspect::matrix::{Cell, Status};

fn look(text: &str) -> Hazards {
    karat_inspect::hazards(&Package::from_source("planted", text)).run().expect("checked")
}

/// Runs a search, and returns the faults and requirements.
fn found(text: &str) -> Vec<Hazard> {
    look(text).found
}

/// Returns the finding of a kind at an operation. Panics if there is no such finding.
fn at(text: &str, kind: Kind, operation: &str) -> Hazard {
    let hazards = look(text);
    let mut all = hazards.found.iter().chain(&hazards.others);
    let is_of = |one: &Hazard| one.kind == kind || one.kinds.contains(&kind);
    let one = all.find(|one| is_of(one) && one.text == operation);
    one.unwrap_or_else(|| panic!("no {kind:?} at `{operation}`: {hazards:#?}")).clone()
}

/// If an operation goes wrong in every sample of the free inputs, the finding is a fault. If it works in at least one
/// sample, the finding is a requirement, and `needs` lists each input whose value alone can prevent the error.
// Lesson 97
#[test]
fn running_separates_faults_from_requirements() {
    use Class::{Dropped, Fault, Requirement};
    let of = |parameters: &str, result: &str, body: &str| {
        format!(
            "@group(0) @binding(0) var<uniform> weights: array<vec4f, 8>;\n\
             @group(0) @binding(1) var<storage> lights: array<f32>;\n\
             @group(0) @binding(2) var<uniform> scale: f32;\n\
             fn f({parameters}) -> {result} {{ return {body}; }}"
        )
    };
    let float = |parameters: &str, body: &str| of(parameters, "f32", body);
    for (text, kind, part, class, needs) in [
        // No input is declared.
        (float("x: f32", "exp(x)"), Kind::Infinite, "exp(x)", Requirement, &["x"][..]),
        (float("x: f32", "log(x)"), Kind::Nan, "log(x)", Requirement, &["x"]),
        (
            float("a: f32, b: f32, x: f32", "x / (b - a)"),
            Kind::Nan,
            "x / (b - a)",
            Requirement,
            &["a", "b"],
        ),
        (
            float("x: f32, k: f32", "0.5 * x / k"),
            Kind::Infinite,
            "0.5 * x / k",
            Requirement,
            &["k"],
        ),
        (
            float("mean: f32, s: f32", "sqrt(mean - s)"),
            Kind::Nan,
            "sqrt(mean - s)",
            Requirement,
            &["mean", "s"],
        ),
        (
            float("m: mat2x2f", "1.0 / determinant(m)"),
            Kind::Infinite,
            "1.0 / determinant(m)",
            Requirement,
            &["m"],
        ),
        (
            float("word: u32", "2.0 * bitcast<f32>(word)"),
            Kind::Nan,
            "bitcast<f32>(word)",
            Requirement,
            &["word"],
        ),
        (of("a: i32, b: i32", "i32", "a / b"), Kind::ByZero, "a / b", Requirement, &["b"]),
        (of("x: f32", "u32", "u32(x)"), Kind::Saturated, "u32(x)", Requirement, &["x"]),
        (
            float("a: f32, b: f32, x: f32", "smoothstep(a, b, x)"),
            Kind::EdgesReversed,
            "smoothstep(a, b, x)",
            Requirement,
            &["a", "b"],
        ),
        (of("i: u32", "vec4f", "weights[i]"), Kind::OutOfRange, "weights[i]", Requirement, &["i"]),
        (of("i: u32", "f32", "lights[i]"), Kind::OutOfRange, "lights[i]", Requirement, &["i"]),
        (float("x: f32", "x / scale"), Kind::Nan, "x / scale", Requirement, &["scale"]),
        // The error occurs in every sample.
        (
            float("x: f32", "1.0 / (floor(x) - floor(x))"),
            Kind::Infinite,
            "1.0 / (floor(x) - floor(x))",
            Fault,
            &[],
        ),
        (
            of("x: f32", "vec4f", "weights[8 + i32(x) * 0]"),
            Kind::OutOfRange,
            "weights[8 + i32(x) * 0]",
            Fault,
            &[],
        ),
        (
            float("x: f32", "sqrt(-1.0 - x * x * 0.0 - abs(scale))"),
            Kind::Nan,
            "sqrt(-1.0 - x * x * 0.0 - abs(scale))",
            Fault,
            &[],
        ),
        // In a function without callers, a range that a name suggests counts as declared. The other inputs are free and
        // can't avert the fault.
        (
            float("roughness: f32, x: f32", "x + 1.0 / roughness"),
            Kind::Infinite,
            "1.0 / roughness",
            Fault,
            &[],
        ),
        (
            float("n_dot_v: f32", "sqrt(1.0 - n_dot_v * n_dot_v)"),
            Kind::Nan,
            "sqrt(1.0 - n_dot_v * n_dot_v)",
            Fault,
            &[],
        ),
        (
            float("color: vec3f", "color.x / (color.x + color.y + color.z)"),
            Kind::Nan,
            "color.x / (color.x + color.y + color.z)",
            Fault,
            &[],
        ),
        (
            float("c: vec3f", "c.x / (c.x + c.y + c.z)"),
            Kind::Nan,
            "c.x / (c.x + c.y + c.z)",
            Requirement,
            &["c"],
        ),
        (
            of("v: vec3f, l: vec3f, radiance: vec3f", "vec3f", "normalize(v + l) * radiance"),
            Kind::Nan,
            "normalize(v + l)",
            Fault,
            &[],
        ),
        (of("s: vec3f", "vec3f", "normalize(s)"), Kind::Nan, "normalize(s)", Requirement, &["s"]),
        (float("roughness: f32, x: f32", "x / roughness"), Kind::Nan, "x / roughness", Fault, &[]),
        // A name doesn't limit an integer.
        (
            of("i: u32, columns: u32", "u32", "i / columns"),
            Kind::ByZero,
            "i / columns",
            Requirement,
            &["columns"],
        ),
        // Without a declaration, findings about WGSL's error bounds don't count.
        (
            float("n_dot_v: f32", "pow(n_dot_v, 5.0)"),
            Kind::Unbounded,
            "pow(n_dot_v, 5.0)",
            Requirement,
            &["n_dot_v"],
        ),
        (float("x: f32", "exp(x) - 1.0"), Kind::LostDigits, "exp(x) - 1.0", Requirement, &["x"]),
        // A `select` or a branch uses another value, or an operation bounds an infinity.
        (
            of("s: vec3f", "vec3f", "select(vec3f(0.0, 0.0, 1.0), normalize(s), dot(s, s) > 0.0)"),
            Kind::Nan,
            "normalize(s)",
            Dropped,
            &[],
        ),
        (
            of("s: vec3f", "vec3f", "select(vec3f(1.0), normalize(s), s.x >= 0.0)"),
            Kind::Nan,
            "normalize(s)",
            Requirement,
            &["s"],
        ),
        (
            float("alpha: f32", "min(1.0 / alpha, 100.0)"),
            Kind::Infinite,
            "1.0 / alpha",
            Dropped,
            &[],
        ),
    ] {
        let one = at(&text, kind, part);
        assert_eq!(
            (one.class, &*one.needs),
            (class, &*needs.iter().map(|one| (*one).to_owned()).collect::<Vec<_>>()),
            "{text}: {one}"
        );
    }
}

/// If an input has a declared range, a requirement may become a fault, or disappear.
// Lesson 97
#[test]
fn declared_inputs_are_held() {
    let text = "fn f(value: f32, k: f32) -> f32 { let bins = array(1.0, 2.0, 3.0, 4.0); return k * bins[u32(value * 4.0)]; }\n\
                fn g(x: f32) -> f32 { return exp(x) - 1.0; }";
    let package = Package::from_source("planted", text);
    let classes = |inputs: &[(&str, f64, f64)]| {
        let request =
            inputs.iter().fold(karat_inspect::hazards(&package), |request, (name, least, most)| {
                request.input(name, *least..=*most)
            });
        let found = request.run().expect("checked").found;
        found.into_iter().map(|one| (one.function, one.kind, one.class)).collect::<Vec<_>>()
    };
    let free = classes(&[]);
    assert!(free.iter().all(|(.., class)| *class == Class::Requirement), "{free:?}");
    assert!(free.contains(&("f".to_owned(), Kind::OutOfRange, Class::Requirement)), "{free:?}");
    let unit = classes(&[("value", 0.0, 1.0), ("x", -1.0, 1.0)]);
    // The index `1.0 * 4` is outside of the array for every `k`, and all inputs of `g` are declared.
    let expected = [("f", Kind::OutOfRange), ("g", Kind::LostDigits)];
    let expected = expected.map(|(name, kind)| (name.to_owned(), kind, Class::Fault));
    assert_eq!(unit, expected);
    assert_eq!(classes(&[("value", 0.0, 0.99), ("x", 1.0, 2.0)]), []);
}

/// Karat judges the findings in a function by running the function's outermost callers.
// Lesson 97
// Lesson 143
#[test]
fn a_finding_in_a_called_function_is_judged_at_its_callers() {
    let root = "fn root(x: f32) -> f32 { return sqrt(x - 0.5); }\n";
    let good = "fn good(x: f32) -> f32 { return root(1.0 + x * x); }\n";
    let shaded =
        "@fragment fn fs(@location(0) t: f32) -> @location(0) vec4f { return vec4f(good(t)); }\n";
    let bad = "fn bad(y: f32) -> f32 { return root(y); }\n";
    let always = "fn always(y: f32) -> f32 { return root(-1.0 - y * y); }\n";
    let unseen = "@group(0) @binding(0) var<storage, read_write> p: f32;
        fn unseen(x: f32) { p = root(2.0 + abs(x)); }\n";
    let seldom = "fn seldom(k: u32) -> f32 { if k == 7u { return root(2.0); } return 0.0; }\n";
    for (more, class, function) in [
        (vec![], Class::Requirement, "root"),
        (vec![good], Class::Met, "root"),
        (vec![good, shaded], Class::Met, "root"),
        // The worst of several callers decides the class, whatever its position in the file is.
        (vec![good, shaded, bad], Class::Requirement, "bad"),
        (vec![good, bad, always], Class::Fault, "always"),
        // A caller that wasn't checked doesn't count. Then the function is judged without callers.
        (vec![unseen], Class::Requirement, "root"),
        (vec![good, unseen], Class::Met, "root"),
        (vec![seldom], Class::NotReached, "root"),
    ] {
        let one = at(&format!("{root}{}", more.concat()), Kind::Nan, "sqrt(x - 0.5)");
        assert_eq!((one.class, &*one.function), (class, function), "{more:?}: {one}");
    }
    // The function's own finding precedes the finding at the call, whose operation doesn't go wrong.
    let own =
        "fn caller(x: f32, roughness: f32) -> f32 { return sqrt(x-0.5) + root(0.5 + roughness); }";
    let text = format!("{root}{own}");
    assert_eq!(at(&text, Kind::Nan, "sqrt(x - 0.5)").class, Class::Met);
    assert_eq!(at(&text, Kind::Nan, "sqrt(x-0.5)").class, Class::Requirement);
    // In a function with callers, a name doesn't declare a range.
    let known = "fn known(roughness: f32) -> f32 { return 1.0 / roughness; }
        fn other(x: f32) -> f32 { return known(x); }";
    let one = at(known, Kind::Infinite, "1.0 / roughness");
    assert_eq!((one.class, &*one.function), (Class::Requirement, "other"));
    assert_eq!(one.also, ["known"]);
    let hazards = look(&format!("{root}{good}"));
    assert_eq!((hazards.faults().count(), hazards.requirements().count()), (0, 0));
    assert_eq!(hazards.counts(), "0 faults and 0 requirements in 2 functions, 1 met");
    // `--only` excludes the callers.
    let only = Package::from_source("planted", format!("{root}{good}"));
    let only = karat_inspect::hazards(&only).only(["root"]).run().expect("checked");
    assert_eq!(only.requirements().count(), 1);
}

/// A NaN or an infinity isn't `Dropped` if a result, a condition or an integer depends on it.
// Lesson 143
#[test]
fn used_results_are_not_dropped() {
    for text in [
        "fn lit(a: f32) -> f32 { return select(0.0, 1.0, sqrt(a) > 0.5); }",
        "fn hit(a: f32) -> bool { return sqrt(a) < 1.0; }",
        "fn part(a: f32) -> f32 { if sqrt(a) < 0.5 { return 1.0; } return 0.0; }",
        "fn whole(a: f32) -> i32 { return i32(sqrt(a)); }",
        "fn packed(a: f32) -> u32 { return pack2x16float(vec2f(sqrt(a), 1.0)); }",
        "fn bits(a: f32) -> u32 { return bitcast<u32>(sqrt(a)); }",
        "fn own(a: f32) -> f32 { let s = sqrt(a); if s != s { return 0.0; } return s; }",
        "fn cut(a: f32) -> f32 { let s = sqrt(a); var t = 0.0; for (var i = 0; i < 5000; i++) { t += 1.0; } \
         return max(s, 0.0) + t; }",
        "fn capped(a: f32) -> f32 { return clamp(sqrt(a), 0.0, 1.0); }",
    ] {
        assert_eq!(at(text, Kind::Nan, "sqrt(a)").class, Class::Requirement, "{text}");
    }
    let difference =
        "fn f(x: f32) -> f32 { let i = 1.0 / abs(x); return clamp(i - i, -1.0, 1.0); }";
    assert_eq!(at(difference, Kind::Infinite, "1.0 / abs(x)").class, Class::Requirement);
    let masked = "@group(0) @binding(0) var<storage, read_write> out: array<f32>;
        @compute @workgroup_size(4) fn main(@builtin(global_invocation_id) id: vec3u) {
            if id.x < arrayLength(&out) { out[id.x] = max(sqrt(-1.0 - abs(out[id.x])), 0.0); }
        }";
    assert_eq!(at(masked, Kind::Nan, "sqrt(-1.0 - abs(out[id.x]))").class, Class::Fault);
}

/// Karat reports each wrong operation of a function, even if an earlier operation has the same kind of error.
// Lesson 97
#[test]
fn each_operation_has_its_own_verdict() {
    let text = "fn f(x: f32, y: f32) -> f32 { let a = 1.0 / (x - x); let b = 1.0 / (y - y); let c = 1.0 / x; return a + b + c; }";
    let classes: Vec<_> = found(text).into_iter().map(|one| (one.text, one.class)).collect();
    let fault = |text: &str| (text.to_owned(), Class::Fault);
    let expected = [
        fault("1.0 / (x - x)"),
        fault("1.0 / (y - y)"),
        ("1.0 / x".to_owned(), Class::Requirement),
    ];
    assert_eq!(classes, expected);
}

/// An invalid function affects only the functions that call it, both in `hazards` and in `matrix`. A test, in contrast,
/// needs its whole module to be valid.
#[test]
fn a_function_is_judged_by_what_it_uses() {
    let text = "fn inverse(x: f32) -> f32 { return 1.0 / x; }
        fn twice(x: f32) -> f32 { return 2.0 * x; }
        fn broken(x: f32) -> f32 { return x.y; }
        fn uses(x: f32) -> f32 { return broken(x); }";
    let package = Package::from_source("m", text);
    let hazards = karat_inspect::hazards(&package).run().expect("some are looked at");
    assert_eq!((hazards.functions, hazards.unread, hazards.invalid), (2, 0, 2));
    let skipped: Vec<_> = hazards.skipped.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(skipped, ["broken", "uses"]);
    assert!(hazards.skipped[1].1.contains("<m>:3:"), "{:?}", hazards.skipped);
    assert_eq!(hazards.found[0].function, "inverse");
    let columns = ["vulkan", "cpu"].map(|name| name.parse().expect("a column"));
    let matrix = karat_inspect::matrix(&package).columns(columns).run().expect("a matrix");
    let agrees = |name: &str| {
        let row = matrix.rows.iter().find(|row| row.name == name).expect("a row");
        let is_good = |cell: &Cell| cell.status == Some(Status::Agrees);
        row.cells.len() == 2 && row.cells.iter().all(is_good)
    };
    assert!(agrees("twice") && !agrees("broken") && !agrees("uses"));
    let test = package.function("inverse").over(1.0..=2.0).unrecorded();
    let error =
        test.try_agrees_with(|x: f64| 1.0 / x, Ulp(2.5)).expect_err("a test needs a valid module");
    assert!(error.to_string().contains("invalid field accessor"), "{error}");
}

/// Karat reads the valid functions of an invalid module one by one, so it also finds their calls of functions in other
/// modules.
// Lesson 143
#[test]
fn a_requirement_is_met_despite_an_invalid_calling_module() {
    let modules = |broken: &'static str| {
        let a = "fn inverse(x: f32) -> f32 { return 1.0 / x; }
                 fn good(x: f32) -> f32 { return inverse(1.0 + x * x); }";
        karat_inspect::hazards(&Package::from_modules("p", [("a", a), ("b", broken)]))
            .run()
            .expect("checked")
    };
    let beside = modules(
        "import package::a::inverse; fn beside(x: f32) -> f32 { return inverse(2.0 + x * x); }
         fn broken(x: f32) -> f32 { return x.y; }",
    );
    assert_eq!((beside.found.len(), beside.of(Class::Met).count()), (0, 1), "{beside}");
}

// Lesson 111
#[test]
fn each_hazard_is_reported_where_it_arises() {
    let schlick =
        "fn f(v_dot_h: f32) -> f32 {\n    return 0.04 + 0.96 * pow(1.0 - v_dot_h, 5.0);\n}";
    let hazard = at(schlick, Kind::Unbounded, "pow(1.0 - v_dot_h, 5.0)");
    assert!(hazard.location.ends_with(":2:26"), "{hazard:?}");
    assert_eq!((hazard.kind, &*hazard.kinds), (Kind::Nan, &[Kind::Unbounded][..]));
    assert_eq!(hazard.arguments, [("v_dot_h".to_owned(), "1.0000001".to_owned())]);
    assert!(hazard.fails.is_some_and(|fails| fails.contains("v_dot_h is")));

    let sine = "fn f(n: vec3f, l: vec3f) -> f32 { let c = dot(n, l); return sqrt(1.0 - c * c); }";
    at(sine, Kind::Nan, "sqrt(1.0 - c * c)");

    let half = "fn f(v: vec3f, l: vec3f) -> vec3f { return normalize(v + l); }";
    let hazard = at(half, Kind::Nan, "normalize(v + l)");
    assert!(hazard.class == Class::Fault && hazard.cases.0 >= 3, "{hazard:?}");

    let naive = "fn f(n_dot_h: f32, alpha: f32) -> f32 {\n    let a2 = alpha * alpha;\n    \
                 let d = n_dot_h * n_dot_h * (a2 - 1.0) + 1.0;\n    return a2 / (3.1415927 * d * d);\n}";
    let hazard = at(naive, Kind::LostDigits, "n_dot_h * n_dot_h * (a2 - 1.0) + 1.0");
    assert!(hazard.location.ends_with(":3:13") && hazard.values.is_some(), "{hazard:?}");

    let angle = "fn f(n: vec3f, l: vec3f) -> f32 { return acos(dot(n, l)); }";
    at(angle, Kind::Nan, "acos(dot(n, l))");

    let hidden = "fn f(n: vec3f, l: vec3f) -> f32 { return max(acos(dot(n, l) * 1.5), 0.0); }";
    // `max` of NaN and a number may be NaN.
    assert_eq!(at(hidden, Kind::Nan, "acos(dot(n, l) * 1.5)").class, Class::Fault);

    let cavity = "fn f(n_dot_h: f32, n_dot_v: f32, v_dot_h: f32) -> f32 {\n    \
                  return min(1.0, 2.0 * n_dot_h * n_dot_v / v_dot_h);\n}";
    at(cavity, Kind::Nan, "2.0 * n_dot_h * n_dot_v / v_dot_h");

    let remainder = "fn f(u: f32, t: f32) -> f32 { return u % t; }";
    at(remainder, Kind::Nan, "u % t");

    let cancels = "fn f(theta: f32) -> f32 { return 1.0 - cos(theta); }";
    at(cancels, Kind::LostDigits, "1.0 - cos(theta)");

    // The result loses all digits: in `f32`, 1 - cos(1e-4) is 0, so the result is 0 instead of 0.5.
    let all = "fn f(x: f32) -> f32 { return (1.0 - cos(x)) / (x * x); }";
    let package = Package::from_source("planted", all);
    let lost = package.function("f").over(1e-6..=1e-4).cases(500).unrecorded().try_has_no_hazards();
    let told = lost.expect_err("0 is no half").to_string();
    assert!(told.contains("lost digits at `1.0 - cos(x)`"), "{told}");
    // A result that consists only of rounding errors has no digits to lose.
    let rounding = Package::from_source("planted", "fn f(x: f32) -> f32 { return 1.0 - cos(x); }");
    rounding.function("f").over(1e-6..=1e-5).cases(500).has_no_hazards();

    let index = "fn f(i: u32) -> f32 { var a = array(1.0, 2.0, 3.0); return a[i]; }";
    at(index, Kind::OutOfRange, "a[i]");

    let cell = "fn f(i: u32, columns: u32) -> u32 { return i % columns; }";
    at(cell, Kind::ByZero, "i % columns");
    let guarded = "fn f(i: i32, n: i32) -> i32 { if n == 0 { return 0; } return i / n; }";
    assert_eq!(found(guarded), []);

    let sum = "fn f(t: f32) -> f32 { return 1.0 / t; }";
    at(sum, Kind::Infinite, "1.0 / t");
}

/// The first finding that has this kind of hazard; panics if there is none.
fn of_kind(hazards: &Hazards, kind: Kind) -> Hazard {
    let is_of = |one: &&Hazard| one.kind == kind || one.kinds.contains(&kind);
    let one = hazards.found.iter().find(is_of);
    one.unwrap_or_else(|| panic!("no {kind:?}: {hazards:#?}")).clone()
}

/// Karat counts every case in which a hazard occurs, not only one case in each dispatch.
// Lesson 140
#[test]
fn each_input_of_a_hazard_counts() {
    let always =
        look("fn f(s: f32) -> f32 { var a = array<f32, 3>(); var i = 3u; return a[i] * s; }");
    let hazard = of_kind(&always, Kind::OutOfRange);
    assert_eq!(hazard.cases.0, hazard.cases.1, "{hazard:?}");
    for (text, kind, share) in [
        (
            "fn f(i: i32) -> f32 { var a = array(1.0, 2.0); return a[i & 7]; }",
            Kind::OutOfRange,
            0.5,
        ),
        ("fn f(x: f32) -> u32 { return 7u / (u32(abs(x)) & 1u); }", Kind::ByZero, 0.3),
        (
            "@group(0) @binding(0) var t: texture_2d<f32>;\n\
          fn f(i: u32) -> vec4f { return textureLoad(t, vec2u(i, 99u), 0); }",
            Kind::OutOfRange,
            1.0,
        ),
        (
            "var<private> a: array<f32, 4>;\nfn f(i: u32) -> f32 { a[i | 4u] = 1.0; return a[0]; }",
            Kind::OutOfRange,
            1.0,
        ),
        (
            "@group(0) @binding(0) var<storage> a: array<f32, 4>;\n\
          fn f(i: u32) -> f32 { return a[i | 4u]; }",
            Kind::OutOfRange,
            1.0,
        ),
        (
            "fn f(i: u32) -> f32 { return vec4f(1.0, 2.0, 3.0, 4.0)[i | 4u]; }",
            Kind::OutOfRange,
            1.0,
        ),
    ] {
        let (cases, of) = of_kind(&look(text), kind).cases;
        assert!(cases as f64 >= share * of as f64, "{cases} of {of}: {text}");
    }
    let package = Package::from_source(
        "planted",
        "fn f(x: f32) -> f32 { var a = array(0.0, 1.0); return a[u32(x * 20.0)]; }",
    );
    let failure =
        package.function("f").over(0.0..=1.0).cases(4096).unrecorded().try_has_no_hazards();
    let text = failure.expect_err("most indices are outside").to_string();
    let share =
        text.lines().find_map(|line| line.trim().split_once(" cases fail (")?.1.split_once('%'));
    let share: f64 = share.and_then(|(share, _)| share.parse().ok()).expect("a share of the cases");
    assert!(share > 75.0, "{text}");
}

/// Declared ranges also apply to integers. Without a declaration, samples include the smallest and the largest value of
/// the type.
// Lesson 146
#[test]
fn integers_are_declared_and_reach_the_ends_of_their_types() {
    let text = "fn g(count: u32) -> u32 { return 100u / (50u - count); }";
    let package = Package::from_source("planted", text);
    let declared =
        |least: f64, most: f64| karat_inspect::hazards(&package).input("count", least..=most).run();
    let one = declared(50.0, 50.0).expect("checked");
    assert_eq!(of_kind(&one, Kind::ByZero).arguments, [("count".to_owned(), "50".to_owned())]);
    assert_eq!(declared(0.0, 49.0).expect("checked").found, []);
    let error = declared(0.25, 0.75).expect_err("no whole number lies there").to_string();
    assert!(
        error.contains("`count` is declared from 0.25 to 0.75, but no u32 is in this range"),
        "{error}"
    );
    for text in [
        "fn f(bits: u32) -> u32 { return 7u / (4294967295u - bits); }",
        "fn f(bits: i32) -> i32 { return 7 / (bits - 2147483647); }",
        "fn f(bits: i32) -> i32 { return 7 / (bits + 2147483647 + 1); }",
        "fn f(x: f32) -> u32 { return 7u / u32(abs(x - 1048576.0)); }",
    ] {
        of_kind(&look(text), Kind::ByZero);
    }
}

/// The report lists the ranges from which Karat samples the inputs.
// Lesson 147
#[test]
fn a_report_says_what_was_drawn() {
    let hazards =
        look("fn h(x: f32, worldNormal: vec3f) -> f32 { return exp(x) + sqrt(100.0 - x); }");
    let kinds: Vec<Kind> = hazards.found.iter().map(|hazard| hazard.kind).collect();
    assert_eq!(kinds, [Kind::Nan, Kind::Infinite]);
    let drawn = "a unit vector: worldNormal\nfrom -1048576 to 1048576, with half of the values from -4 to 4: x";
    assert_eq!(hazards.drawn.to_string(), drawn);
}

// Lesson 150
#[test]
fn edges_in_the_wrong_order_and_numbers_beyond_a_type_are_hazards() {
    for (text, kind) in [
        ("fn f(t: f32) -> f32 { return clamp(t, 1.0, 0.0); }", Kind::EdgesReversed),
        ("fn f(a: vec2f, b: vec2f) -> vec2f { return clamp(a, b, b.yx); }", Kind::EdgesReversed),
        ("fn f(t: f32) -> f32 { return smoothstep(1.0, 0.0, t); }", Kind::EdgesReversed),
        (
            "fn f(t: f32, w: f32) -> f32 { return smoothstep(0.5, 0.5 + w, t); }",
            Kind::EdgesReversed,
        ),
        ("fn f(x: f32) -> i32 { return i32(x * 1e20); }", Kind::Saturated),
        ("fn f(x: f32) -> u32 { return u32(x); }", Kind::Saturated),
        ("fn f(x: vec3f) -> vec3i { return vec3i(x * 1e4); }", Kind::Saturated),
    ] {
        let hazard = of_kind(&look(text), kind);
        assert!(hazard.location.contains(":1:"), "{text}: {hazard:?}");
    }
    for text in [
        "fn f(t: f32) -> f32 { return clamp(t, 0.0, 0.0) + smoothstep(0.0, 1.0, t); }",
        "fn f(u: f32) -> u32 { return u32(u * 255.0 - 0.5) + u32(-u * 0.5); }",
        "fn f(i: i32) -> i32 { return clamp(i, 3, 1); }", // WGSL defines this result for integers
    ] {
        let hazards = look(text);
        assert_eq!((&*hazards.found, &*hazards.others), (&[][..], &[][..]), "{text}");
    }
}

/// Karat tries several values for each member of a buffer. `[inputs]` in `karat.toml` may declare a member's range:
/// `p.other = [1, 9]`.
// Lesson 149
#[test]
fn members_of_buffers_are_drawn_and_declared() {
    let text = "struct P { groups: u32, other: u32, gain: f32, seeds: array<u32, 3> }\n\
                @group(0) @binding(0) var<storage> p: P;\n\
                fn f(id: u32) -> u32 { return (id + 1u) % p.groups; }\n\
                fn g(id: u32) -> u32 { return id / p.other; }\n\
                fn h(x: f32) -> f32 { return x / p.gain; }\n\
                fn k(id: u32) -> u32 { return id / p.seeds[0]; }\n";
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("m.wgsl"), text).expect("written");
    let package = Package::open(folder.path()).expect("opened");
    let found = |only: &str| {
        let hazards = karat_inspect::hazards(&package).only([only]).run().expect("checked");
        hazards.found.into_iter().map(|one| (one.kind, one.arguments)).collect::<Vec<_>>()
    };
    assert_eq!(found("::f")[0].0, Kind::ByZero, "a name doesn't limit an integer");
    let by_zero = found("::g");
    assert_eq!(by_zero[0].0, Kind::ByZero);
    assert!(by_zero[0].1.contains(&("p.other".to_owned(), "0".to_owned())), "{by_zero:?}");
    assert!(found("::h").iter().any(|(kind, _)| *kind == Kind::Nan), "0 / 0");
    assert_eq!(found("::k")[0].0, Kind::ByZero, "elements have all numbers in turn");
    let declare = |text: &str| std::fs::write(folder.path().join("karat.toml"), text);
    for ranges in [
        "[inputs]\n\"p.other\" = [1, 9]\ngain = [1, 2]\nseeds = [3, 3]\n",
        "[inputs]\np.other = [1, 9]\np.gain = [1, 2]\np.seeds = [3, 3]\n",
    ] {
        declare(ranges).expect("written");
        assert_eq!([found("::g"), found("::h"), found("::k")].concat(), [], "{ranges}");
    }
    let drawn = karat_inspect::hazards(&package).run().expect("checked").drawn.to_string();
    assert!(drawn.contains("from 1 to 9: p.other"), "{drawn}");
    declare("[inputs]\np.others = [1, 9]\n").expect("written");
    let error =
        karat_inspect::hazards(&package).run().expect_err("there is no such member").to_string();
    assert!(error.contains("did you mean `p.other`?"), "{error}");
}

/// The report counts the inputs and the functions that Karat didn't check.
// Lesson 151
#[test]
fn unchecked_inputs_and_functions_are_counted() {
    let text = "fn f(m: u32) -> f32 { var s = 0.0; for (var i = 0u; i < m; i++) { s += 1.0 / f32(i + 1u); }\n\
                return s; }\n\
                @group(0) @binding(0) var<storage, read_write> p: f32; fn unseen(x: f32) { p = x; }\n";
    let hazards = look(text);
    assert_eq!(hazards.functions, 1);
    assert!(hazards.unseen.inputs > 100 && hazards.unseen.functions == 1, "{:?}", hazards.unseen);
    assert!(
        hazards
            .skipped
            .iter()
            .any(|(name, why)| name == "unseen" && why.contains("writes memory that other calls"))
    );
    let long = look(
        "fn f(x: f32) -> f32 { var s = x; for (var i = 0; i < 3000; i++) { s = s * 0.5 + x; }\n\
                     return s; }",
    );
    assert_eq!(long.unseen.in_part, 1);
}

/// Karat doesn't assume that two textures have the same size: a texel of one texture may be outside of the other. An
/// index may also be outside of a generated array, which has one element for each invocation.
#[test]
fn a_texel_outside_may_be_one_of_another_size() {
    let of = |source: &str, value: &str| {
        look(&format!(
            "@group(0) @binding(0) var {source};
            @group(0) @binding(1) var result: texture_storage_2d<r32float, write>;
            @compute @workgroup_size(8, 8) fn main(@builtin(global_invocation_id) id: vec3u) {{
                let size = textureDimensions(result);
                if any(id.xy >= size) {{ return; }}
                textureStore(result, id.xy, vec4f({value}));
            }}"
        ))
    };
    let texture = of("image: texture_2d<f32>", "textureLoad(image, id.xy + 1u, 0).x");
    let classes =
        |all: &Hazards| all.found.iter().map(|one| (one.kind, one.class)).collect::<Vec<_>>();
    assert_eq!(classes(&texture), [(Kind::OutOfRange, Class::Requirement)]);
    let array = of("<storage, read> all: array<f32>", "all[id.y * size.x + id.x + 1u]");
    assert_eq!(classes(&array), [(Kind::OutOfRange, Class::Requirement)]);
}

/// The reported number of finished functions only increases, even if the callback is slow.
#[test]
fn progress_never_goes_backwards() {
    let text: String =
        (0..12).map(|at| format!("fn f{at}(x: f32) -> f32 {{ return x; }}\n")).collect();
    let told = std::sync::Mutex::new(Vec::new());
    let package = Package::from_source("many", &text);
    let ran = karat_inspect::hazards(&package).run_with(&|at| {
        let (done, of) = (at.done, at.of);
        if done % 3 == 1 {
            std::thread::sleep(std::time::Duration::from_millis(50));
        }
        told.lock().expect("nobody panics").push((done, of));
    });
    assert_eq!(ran.expect("checked").functions, 12);
    let expected: Vec<_> = (1..=12).map(|done| (done, 12)).collect();
    assert_eq!(told.into_inner().expect("nobody panics"), expected);
}

/// Correct code has no findings.
// Lesson 111
#[test]
fn correct_functions_have_no_findings() {
    for text in [
        "fn f(n_dot_l: f32, albedo: vec3f) -> vec3f { return albedo * n_dot_l / 3.1415927; }",
        "fn f(f0: vec3f, v_dot_h: f32) -> vec3f { let c = 1.0 - v_dot_h; let c2 = c * c;\n\
         return f0 + (1.0 - f0) * (c2 * c2 * c); }",
        "fn f(n: vec3f, v: vec3f) -> f32 { return clamp(dot(n, v), 0.0, 1.0); }",
        "fn f(u: vec2f) -> vec2f { return mix(u, u.yx, 0.25); }",
        "fn f(alpha: f32) -> f32 { return sqrt(max(1.0 - alpha, 0.0)); }",
    ] {
        assert_eq!(found(text), [], "{text}");
    }
}

#[test]
fn inputs_are_declared_and_hazards_accepted() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).expect("written");
    };
    write("maths.wgsl", "fn rcp(t: f32) -> f32 { return 1.0 / t; }\n");
    let package = Package::open(folder.path()).expect("opened");
    let look = || karat_inspect::hazards(&package).run();
    assert_eq!(look().expect("read").found.len(), 1);
    assert_eq!(
        karat_inspect::hazards(&package).input("t", 0.5..=1.0).run().expect("read").found,
        []
    );
    write("karat.toml", "[inputs]\nt = [0.5, 1]\n");
    assert_eq!(look().expect("read").found, []);
    write("karat.toml", "[inputs]\ntt = [0.5, 1]\n");
    match look() {
        Err(HazardError::UnknownInput { name, nearest, .. }) => {
            assert_eq!((&*name, nearest.as_deref()), ("tt", Some("t")));
        }
        other => panic!("{other:?}"),
    }
    // An invalid range is an error in every command that reads it.
    write("karat.toml", "[inputs]\nt = [1, 0.5]\n");
    let error = look().expect_err("no range").to_string();
    assert!(error.contains("`t` is declared from 1 to 0.5"), "{error}");
    assert!(package.try_is_valid().is_err());
    let accepted = |function: &str| {
        format!(
            "[[hazard]]\nfunctions = [\"{function}\"]\ntext = \"1.0 / t\"\nreason = \"callers know\"\n"
        )
    };
    write("karat.toml", &accepted("maths::rcp"));
    let hazards = look().expect("read");
    assert_eq!((hazards.found.len(), hazards.accepted), (0, 1));
    write("karat.toml", &accepted("maths::*"));
    assert_eq!(look().expect("read").accepted, 1);
    write("karat.toml", &accepted("maths::other"));
    match look() {
        Err(HazardError::Declaration(text)) => {
            assert!(
                text.contains("but Karat finds no such hazard: delete the declaration"),
                "{text}"
            )
        }
        other => panic!("{other:?}"),
    }
    write("karat.toml", "");
    write("maths.wgsl", "fn f(x: f32) { let y = 2.0 * x; }\n");
    assert!(matches!(look(), Err(HazardError::Nothing { .. })), "no verdict without evidence");
}

#[test]
fn a_domain_is_checked_for_hazards() {
    let text = "fn f(x: f32) -> f32 { return select(0.0, sqrt(x - 0.5), x >= 0.5); }";
    let package = Package::from_source("planted", text);
    package.function("f").over(0.5..=1.0).cases(500).has_no_hazards();
    let failure =
        package.function("f").over(0.0..=1.0).cases(500).unrecorded().try_has_no_hazards();
    let Err(Failure::Disagreement(found)) = failure else { panic!("{failure:?}") };
    let text = found.to_string();
    assert!(text.contains("hazard = NaN at `sqrt(x - 0.5)` ("), "{text}");
    assert!(text.contains("a later operation hides this hazard"), "{text}");
    let quad = Package::from_source(
        "planted",
        "fn f(x: f32) -> f32 { return fwidth(x) + sqrt(x - 0.5); }",
    );
    let quad = |range| quad.function("f").over(range).unrecorded().try_has_no_hazards();
    assert!(quad(0.5..=1.0).is_ok() && quad(0.0..=1.0).is_err());
}

/// A check that stops with an error doesn't wait for the results of its dispatch. So the process must wait for the
/// driver before it ends: without this wait, one in three processes crashed.
#[test]
fn nothing_runs_when_the_process_ends() {
    let program = std::env::current_exe().expect("a path");
    for _ in 0..8 {
        let mut tests = std::process::Command::new(&program);
        tests.arg("a_domain_is_checked_for_hazards");
        let ended = tests.output().expect("started");
        assert!(ended.status.success(), "{}: {ended:?}", ended.status);
    }
}

/// Checks vertex and fragment functions. A fragment function gets interpolated values, and the position of its pixel,
/// which differs by 1 between neighbours.
#[test]
fn entry_points_of_draws_are_looked_at() {
    let text = "struct In { @builtin(position) pixel: vec4f, @location(0) n_dot_l: f32 }\n\
                @fragment fn shade(in: In, @builtin(front_facing) front: bool) -> @location(0) vec4f {\n\
                let side = select(-1.0, 1.0, front);\n\
                return vec4f(acos(in.n_dot_l * 1.5) * side, fwidth(in.pixel.x), 0.0, 1.0);\n}\n\
                @vertex fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {\n\
                var at = array(vec2f(-1.0), vec2f(3.0, -1.0), vec2f(-1.0, 3.0));\n\
                return vec4f(at[i], 0.0, 1.0);\n}";
    let hazards = look(text);
    assert_eq!((hazards.functions, hazards.skipped.len()), (2, 0));
    let hazard = of_kind(&hazards, Kind::Nan);
    assert_eq!((&*hazard.text, &*hazard.function), ("acos(in.n_dot_l * 1.5)", "shade"));
    let (_, shown) = &hazard.arguments[0];
    assert!(shown.contains("dx: { pixel: (1, 0, 0, 0)"), "{shown}");
    assert!(
        hazards.found.iter().all(|hazard| hazard.function == "shade"),
        "three corners are drawn"
    );
}

/// Checks passes over two workgroups of 8 x 8 in each direction.
#[test]
fn compute_passes_are_looked_through() {
    let head = "struct Size { width: u32, height: u32 }\n\
                @group(0) @binding(0) var<uniform> size: Size;\n\
                @group(0) @binding(1) var<storage, read_write> data: array<f32>;\n\
                @group(0) @binding(2) var<storage, read> order: array<u32>;\n\
                var<workgroup> tile: array<f32, 64>;\n\
                @compute @workgroup_size(8, 8) fn pass_(@builtin(global_invocation_id) id: vec3u,\n\
                @builtin(local_invocation_index) k: u32) {\n\
                if id.x >= size.width || id.y >= size.height { return; }\n\
                let i = id.y * size.width + id.x;\n";
    let of = |body: &str| look(&format!("{head}{body}\n}}"));
    let own = "tile[k] = data[i]; data[i] = tile[k] + 1.0;";
    for right in ["data[i] = 0.5 * data[i];", "data[order[i]] = 1.0;", own] {
        let hazards = of(right);
        let faults: Vec<&Hazard> = hazards.faults().collect();
        assert!(faults.is_empty(), "{right}: {faults:#?}");
        assert_eq!((hazards.functions, hazards.skipped.len()), (1, 0));
    }
    for (wrong, kind, at) in [
        ("data[i + 1u] = 0.5;", Kind::OutOfRange, "data[i + 1u] = 0.5"),
        ("data[i] = data[i ^ 1u];", Kind::Race, "data[i ^ 1u]"),
        ("data[0] = 1.0;", Kind::EqualWrites, "data[0] = 1.0"),
        ("data[i] = sqrt(-1.0 - abs(data[i]));", Kind::Nan, "sqrt(-1.0 - abs(data[i]))"),
        ("tile[k] = data[i]; data[i] = tile[63u - k];", Kind::Race, "tile[k] = data[i]"),
        (
            "if order[i] > 7u { workgroupBarrier(); } data[i] = 1.0;",
            Kind::Barrier,
            "workgroupBarrier",
        ),
        ("if k < 3u { workgroupBarrier(); } data[i] = 1.0;", Kind::Barrier, "workgroupBarrier"),
        (
            "data[i] = f32(order[i] / (order[i] - order[i]));",
            Kind::ByZero,
            "order[i] / (order[i] - order[i])",
        ),
    ] {
        let hazards = of(wrong);
        let found = hazards.found.iter().find(|hazard| hazard.kind == kind);
        let found = found.unwrap_or_else(|| panic!("no {kind:?} of `{wrong}`: {hazards:#?}"));
        assert!(found.text.contains(at.trim_end_matches(';')), "{wrong}: {found:#?}");
        assert!(found.location.contains(":10:"), "{}", found.location);
        assert!(found.arguments[0].1.starts_with("local ("), "{found:#?}");
    }
    // The barrier at the end of this loop over tiles may be missing. The loop has two iterations only for some sizes.
    let tiles = |barrier: &str| {
        look(&format!(
            "struct Dims {{ m: u32, n: u32, k: u32 }}\n\
             @group(0) @binding(0) var<uniform> dims: Dims;\n\
             @group(0) @binding(1) var<storage, read> a: array<f32>;\n\
             @group(0) @binding(2) var<storage, read_write> sums: array<f32>;\n\
             var<workgroup> tile: array<f32, 8>;\n\
             @compute @workgroup_size(8) fn sum(@builtin(local_invocation_index) i: u32) {{\n\
             var all = 0.0;\n\
             for (var t = 0u; t < (dims.k + 7u) / 8u; t++) {{\n\
             let at = t * 8u + i;\n\
             tile[i] = select(0.0, a[min(at, arrayLength(&a) - 1u)], at < dims.k);\n\
             workgroupBarrier();\n\
             for (var j = 0u; j < 8u; j++) {{ all += tile[j]; }}\n\
             {barrier}\n}}\n\
             if i < arrayLength(&sums) {{ sums[i] = all; }}\n}}"
        ))
    };
    assert!(of_kind(&tiles(""), Kind::Race).location.contains(":12:"));
    let right = tiles("workgroupBarrier();");
    assert!(right.found.iter().all(|one| one.kind != Kind::Race), "{right:#?}");
    // In a workgroup with many invocations, the total of all iterations reaches a million before one invocation reaches
    // its own limit.
    let endless = "@group(0) @binding(0) var<storage, read_write> data: array<f32>;\n\
                   @compute @workgroup_size(256) fn spin(@builtin(local_invocation_index) i: u32) {\n\
                   loop { data[i] += 1.0; if data[i] < 0.0 && data[i] > 0.0 { break; } }\n}";
    assert!(of_kind(&look(endless), Kind::Endless).location.contains(":3:"));
    // If the dispatch has as many invocations as a fixed array has elements, no index is outside of the array. An index
    // that is larger by 1 is outside.
    let fixed = |index: &str| {
        look(&format!(
            "@group(0) @binding(0) var<storage, read_write> data: array<u32, 64>;\n\
             @compute @workgroup_size(64) fn f(@builtin(global_invocation_id) id: vec3u) {{ data[{index}] = id.x; }}"
        ))
    };
    assert!(fixed("id.x").found.is_empty(), "a host dispatches one workgroup");
    assert!(of_kind(&fixed("id.x + 1u"), Kind::OutOfRange).location.contains(":2:"));
    // A reduction with one workgroup writes all its workgroup memory.
    let reduction = "@group(0) @binding(0) var<storage, read_write> sum: u32;\n\
                     var<workgroup> own: array<u32, 64>;\n\
                     @compute @workgroup_size(64) fn f(@builtin(global_invocation_id) id: vec3u) {\n\
                     own[id.x] = 1u; workgroupBarrier();\n\
                     let first = own[0]; if id.x == 0u { sum = first; }\n}";
    assert_eq!(look(reduction).faults().count(), 0, "{:#?}", look(reduction).found);
    // Reading unwritten workgroup memory isn't a finding, because WGSL initializes this memory to zero.
    let unwritten = reduction.replace("own[id.x] = 1u", "if id.x > 0u { own[id.x] = 1u; }");
    assert_eq!(look(&unwritten).found.len(), look(reduction).found.len());
    // Neighbouring workgroups have the same row, and the pass doesn't use the column. If `x` is the index, they race.
    let rows = |value: &str| {
        look(&format!(
            "@group(0) @binding(0) var<storage, read_write> data: array<u32>;\n\
             @compute @workgroup_size(64) fn f(@builtin(workgroup_id) w: vec3u, @builtin(local_invocation_index) i: u32) {{\n\
             data[w.y * 64u + i] = {value};\n}}"
        ))
    };
    let is_write = |one: &&Hazard| matches!(one.kind, Kind::Race | Kind::EqualWrites);
    assert!(!rows("i").found.iter().any(|one| is_write(&one)), "{:#?}", rows("i"));
    assert!(rows("i + w.x").found.iter().any(|one| is_write(&one)), "{:#?}", rows("i + w.x"));
    // With distinct indices, nothing goes wrong.
    let hazards = of("data[order[i]] = f32(i);");
    let race = hazards.requirements().find(|one| one.kind == Kind::Race);
    let race = race.unwrap_or_else(|| panic!("some contents have it: {hazards:#?}"));
    assert!(race.needs.contains(&"order".to_owned()) && race.violation.is_some(), "{race:#?}");
}

/// The largest number in half precision is 65504. A constant in half precision, such as `0.1h`, stands for the decimal
/// number 0.1.
#[test]
fn halves_overflow_and_lose_digits_of_their_own() {
    let text = "enable f16;
        fn capped(x: f32) -> f32 { let y = f16(x); return f32(min(y * y, 100.0h)); }
        fn into(x: f32) -> f32 { return f32(min(f16(x), 100.0h)); }
        fn less(x: f32) -> f32 { return f32((1.0h + f16(x)) - 1.0h); }
        fn tenth(x: f32) -> f32 { return f32(f16(x) * 0.1h); }";
    let package = Package::from_source("halves", text);
    let function = |name: &str| package.function(name);
    // A driver without half precision doesn't run these functions. A hazard counts if it occurs on one path.
    let cpu = karat::unstable::executor::of(karat::Path::CPU).expect("the engine");
    let hazards = |name: &str, range| {
        let check = function(name).on(cpu).over(range).cases(500).unrecorded();
        check.try_has_no_hazards()
    };
    for (name, range, part) in [
        ("capped", 255.0..=300.0, "infinite at `y * y`"),
        ("into", 65_000.0..=70_000.0, "infinite at `f16(x)`"),
        ("less", 1e-3..=4e-3, "lost digits at `(1.0h + f16(x)) - 1.0h`"),
    ] {
        let found = hazards(name, range).expect_err("a hazard").to_string();
        assert!(found.contains(part), "{found}");
    }
    hazards("capped", 0.0..=200.0).expect("no overflow");
    hazards("tenth", 0.1..=200.0).expect("it rounds like half precision");
    let tenth = function("tenth").over(1.0..=8.0).cases(500).unrecorded();
    let tenth = tenth.refused_on("@swiftshader", "SwiftShader has no half precision");
    let tenth = tenth.refused_on("gl", "OpenGL has no half precision in its core");
    let tenth = tenth.try_agrees_with(|x: f64| 0.1 * x, Spec.needing(Rel(1e-2)));
    tenth.expect("0.1h is any number that is rounded to it");
}

/// The sanitizer also checks passes that write no result.
#[test]
fn a_pass_without_results_is_checked_for_races_and_barriers() {
    let text = "@group(0) @binding(0) var<storage, read> src: array<f32>;
        var<workgroup> tile: array<f32, 64>;
        @compute @workgroup_size(64) fn parts(@builtin(local_invocation_index) i: u32) {
            if src[i] > 0.5 { workgroupBarrier(); }
            tile[i] = 1.0;
        }
        @compute @workgroup_size(64) fn races(@builtin(local_invocation_index) i: u32) { tile[0] = f32(i); }";
    assert_eq!(at(text, Kind::Barrier, "workgroupBarrier()").function, "parts");
    assert_eq!(at(text, Kind::Race, "tile[0] = f32(i)").function, "races");
}

/// Karat runs a pass with several contents of its buffers. A divisor that is 0 for all contents is a fault; a divisor
/// that is 0 for only one content is a requirement.
#[test]
fn a_hazard_of_one_buffer_content_is_a_requirement() {
    let pass = |divisor: &str| {
        format!(
            "@group(0) @binding(0) var<storage, read> data: array<u32>;
             @group(0) @binding(1) var<storage, read_write> out: array<f32>;
             @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {{
                 let x = f32(data[0]);
                 if id.x < arrayLength(&out) {{ out[id.x] = 1.0 / ({divisor}); }}
             }}"
        )
    };
    let of_one = at(&pass("x - 127.0"), Kind::Infinite, "1.0 / (x - 127.0)");
    assert_eq!((of_one.class, &*of_one.needs[0]), (Class::Requirement, "data"));
    let fault = at(&pass("x - x"), Kind::Infinite, "1.0 / (x - x)");
    assert_eq!((fault.class, fault.cases.0 >= 6), (Class::Fault, true));
}

/// The pixels of a draw run in parallel, so two pixels that write the same element race.
// Lesson 215: two pixels of a draw
#[test]
fn pixels_that_write_storage_race() {
    let declared = "struct P { width: u32, height: u32 }
        @group(0) @binding(0) var<storage, read_write> out: array<vec4f>;
        @group(0) @binding(1) var<uniform> p: P;
        @group(0) @binding(2) var image: texture_storage_2d<r32uint, read_write>;
        @group(0) @binding(3) var<storage, read_write> count: atomic<u32>;
        fn at(q: vec4f) -> u32 { return u32(q.y) * p.width + u32(q.x); }
        fn texel(q: vec4f, dx: u32) -> vec4u { return textureLoad(image, vec2u(q.xy) + vec2u(dx, 0)); }\n";
    let fragment = |body: &str| {
        format!(
            "{declared}@fragment fn main(@builtin(position) q: vec4f, @location(0) uv: vec2f, \
             @location(1) @interpolate(flat) id: u32) {{ {body} }}"
        )
    };
    for body in [
        "out[at(q)] = q + out[at(q)];",
        "out[u32(uv.y * f32(p.height)) * p.width + u32(uv.x * f32(p.width))] = q;",
        "textureStore(image, vec2u(q.xy), texel(q, 0u));",
        "let n = atomicAdd(&count, 1u); if n < arrayLength(&out) { out[n] = q; }",
        // Discarded pixels write nothing, and their values don't matter.
        "if at(q) != 5u { discard; } out[0] = q;",
        "let x = f32(uv.x > 0.5); if x == 0.0 { discard; } out[at(q)] = q * fwidth(uv.y) / x;",
        "if uv.x < 0.5 { discard; } let n = atomicAdd(&count, 1u); if n < arrayLength(&out) { out[n] = q; }",
    ] {
        let hazards = look(&fragment(body));
        let skipped = hazards.skipped.iter().find(|(name, _)| name == "main");
        assert_eq!(skipped, None, "{body}");
        let faults: Vec<_> = hazards.faults().filter(|one| one.function == "main").collect();
        assert!(faults.is_empty(), "{body}: {faults:?}");
    }
    for (body, kind, text) in [
        ("out[u32(q.x)] = q;", Kind::Race, "out[u32(q.x)] = q"),
        ("out[u32(uv.x * 8.0)] += q;", Kind::Race, "out[u32(uv.x * 8.0)]"),
        (
            "let n = atomicLoad(&count); atomicAdd(&count, 1u); if n < arrayLength(&out) { out[n] = q; }",
            Kind::Race,
            "out[n] = q",
        ),
        ("out[id] = vec4f(1.0);", Kind::EqualWrites, "out[id] = vec4f(1.0)"),
        (
            "textureStore(image, vec2u(q.xy), texel(q, 1u));",
            Kind::Race,
            "textureLoad(image, vec2u(q.xy) + vec2u(dx, 0))",
        ),
        ("out[at(q) + 1u] = q;", Kind::OutOfRange, "out[at(q) + 1u] = q"),
        ("if uv.x < 0.5 { discard; } out[u32(q.x)] = q;", Kind::Race, "out[u32(q.x)] = q"),
        ("out[u32(q.x)] = dpdx(q * q.y);", Kind::Race, "out[u32(q.x)] = dpdx(q * q.y)"),
        ("out[at(q)] = q / (dpdx(q.x) - 1.0);", Kind::Infinite, "q / (dpdx(q.x) - 1.0)"),
        ("if q.x > 3.0 { out[at(q)] = fwidth(q * q); }", Kind::Barrier, "fwidth(q * q)"),
        ("out[at(q)] = normalize(q - q);", Kind::Nan, "normalize(q - q)"),
    ] {
        let hazard = at(&fragment(body), kind, text);
        assert_eq!(hazard.function, "main", "{body}");
        let (name, pixel) = &hazard.arguments[0];
        assert!(name == "invocation" && pixel.starts_with("pixel ("), "{body}: {pixel}");
    }
    let race = at(&fragment("out[u32(q.x)] = q;"), Kind::Race, "out[u32(q.x)] = q");
    let race = race.violation.expect("both accesses");
    let pixels: Vec<&str> = race.accesses.iter().map(|one| one.invocation.as_str()).collect();
    assert_eq!(pixels, ["pixel (0, 0)", "pixel (0, 1)"]);
    assert!(race.advice.starts_with("the pixels of a draw have no order"), "{}", race.advice);
}

/// The race in `bright` is a fault: all writes go to `a[0]`. The race in `scatter` is a requirement: the contents of
/// `idx` decide to which element an invocation writes.
#[test]
fn a_race_for_one_element_is_one_whatever_contents_are() {
    let text = "@group(0) @binding(0) var<storage, read> src: array<f32>;
        @group(0) @binding(1) var<storage, read_write> a: array<u32>;
        @group(0) @binding(2) var<storage, read> idx: array<u32>;
        @compute @workgroup_size(64) fn bright(@builtin(global_invocation_id) g: vec3u) {
            if g.x < arrayLength(&src) && src[g.x] > 12345.0 { a[0] = g.x; }
        }
        @compute @workgroup_size(64) fn scatter(@builtin(global_invocation_id) g: vec3u) {
            if g.x < arrayLength(&idx) { a[idx[g.x]] = g.x; }
        }";
    let hazards = look(text);
    let [bright, scatter] = ["bright", "scatter"].map(|function| {
        let one = hazards.found.iter().find(|one| one.function == function);
        one.unwrap_or_else(|| panic!("{hazards:#?}"))
    });
    // If two pixels write to the element, they race.
    assert_eq!(bright.class, Class::Fault, "{bright}");
    assert_eq!(scatter.class, Class::Requirement, "{scatter}");
    assert!(scatter.needs.contains(&"idx".to_owned()), "{scatter}");
}

/// A loop with many iterations isn't reported as endless. Karat still finds other hazards of the function.
#[test]
fn long_loops_are_not_reported_as_endless() {
    let look = |text: &str| {
        karat_inspect::hazards(&Package::from_source("planted", text)).run().expect("checked")
    };
    let is_endless = |hazards: &Hazards| {
        hazards.found.iter().chain(&hazards.others).any(|one| one.kind == Kind::Endless)
    };
    let nested = |start: &str, condition: &str| {
        look(&format!(
            "fn f(x: f32, bounces: u32, samples: u32) -> f32 {{\nvar all = sqrt(x - 2.0);\n\
             for (var i = 0u; i < bounces; i++) {{\n\
             for (var j = {start}; {condition}; j++) {{ all += f32(j); }}\n}}\nreturn all;\n}}"
        ))
    };
    let ends = nested("0u", "j < samples");
    assert!(!is_endless(&ends), "{ends:#?}");
    assert!(ends.found.iter().any(|one| one.kind == Kind::Nan), "{ends:#?}");
    assert!(ends.unseen.inputs > 0, "{ends:#?}");
    let never = look(
        "fn f(x: f32) -> f32 {\nvar all = x;\nloop {\nfor (var j = 0u; j < 8u; j++) { all += 1.0; }\n\
         if all < 0.0 && all > 1.0 { break; }\n}\nreturn all;\n}",
    );
    assert!(is_endless(&never), "{never:#?}");
    let spins = nested("0u", "j >= 0u");
    assert!(is_endless(&spins), "{spins:#?}");
}

/// If only some pixels of a quad reach a derivative, the derivative depends on the driver.
#[test]
fn a_derivative_that_only_part_of_a_quad_reaches_is_found() {
    let parted = |body: &str| {
        let text = format!(
            "@group(0) @binding(0) var t: texture_2d<f32>;\n@group(0) @binding(1) var s: sampler;\n\
             @group(0) @binding(2) var<uniform> flags: u32;\n\
             fn drawn(uv: vec2f, on: bool) -> vec4f {{ if on {{ return textureSample(t, s, uv); }} return vec4f(0.0); }}\n\
             @fragment fn f(@location(0) uv: vec2f, @location(1) @interpolate(flat) kind: u32) -> @location(0) vec4f {{\n\
             {body}\n}}"
        );
        let hazards = karat_inspect::hazards(&Package::from_source("planted", text.clone()))
            .run()
            .expect("checked");
        let mut all = hazards.found.into_iter();
        let one = all.find(|one| one.kind == Kind::Barrier)?;
        let [reached, missing] = &*one.violation?.accesses else { panic!("two pixels") };
        assert_ne!(reached.invocation, missing.invocation, "{body}");
        let place = missing.place.split(':').skip(1).map(|number| number.parse::<usize>().unwrap());
        let [line, column] = place.collect::<Vec<_>>()[..] else { panic!("{}", missing.place) };
        let rest = text.lines().nth(line - 1).unwrap()[column - 1..].to_owned();
        Some((one.text, one.function, missing.invocation.clone(), rest))
    };
    for (body, text, parts) in [
        (
            "var c = vec4f(0.0); if uv.x > 0.5 { c = textureSample(t, s, uv); } return c;",
            "textureSample(t, s, uv)",
            "if uv.x > 0.5",
        ),
        (
            "if uv.x > 0.5 { return vec4f(0.0); } return vec4f(dpdx(uv.y));",
            "dpdx(uv.y)",
            "return vec4f(0.0)",
        ),
        ("return drawn(uv, uv.y > 0.5);", "textureSample(t, s, uv)", "if on"),
        (
            "var c = vec4f(0.0); for (var x = 0.0; x < uv.x; x += 0.1) { c += vec4f(fwidth(uv.x)); } return c;",
            "fwidth(uv.x)",
            "x < uv.x",
        ),
        (
            "var c = vec4f(0.0); switch u32(8.0 * uv.y) { case 1u: { c = vec4f(dpdy(uv.x)); } default: {} } return c;",
            "dpdy(uv.x)",
            "switch u32(",
        ),
        (
            "var c = 0.0; var x = 0.0; loop { c += dpdx(uv.y); continuing { x += 0.125; break if x > uv.x; } } return vec4f(c);",
            "dpdx(uv.y)",
            "x > uv.x",
        ),
    ] {
        let found = parted(body);
        let Some((of, function, missing, rest)) = &found else { panic!("{body}") };
        assert_eq!((&**of, &**function), (text, "f"), "{body}");
        assert!(missing.starts_with("the pixel"), "{body}: {missing}");
        assert!(rest.starts_with(parts), "{body}: {rest}");
    }
    // A check of only this function reports the finding, too.
    let text = "fn edge(x: f32) -> f32 { if x > 0.5 { return fwidth(x); } return 0.0; }
        fn whole(x: f32) -> f32 { let w = fwidth(x); if x > 0.5 { return w; } return 0.0; }";
    let package = Package::from_source("planted", text);
    let of = |name: &str| {
        let slope = 0.0..=0.25_f32;
        let quads = (0.0..=1.0_f32, slope.clone(), slope)
            .map(|(value, dx, dy)| karat::unstable::value::Quad { value, dx, dy });
        package.function(name).over(quads).unrecorded().try_has_no_hazards()
    };
    of("whole").expect("each pixel takes it");
    let found = of("edge").expect_err("some don't").to_string();
    assert!(found.contains("barrier at `fwidth(x)`"), "{found}");
    assert!(found.contains("takes another branch at"), "{found}");
    for body in [
        "let c = textureSample(t, s, uv); if uv.x > 0.5 { return c; } return vec4f(0.0);",
        "if uv.x > 0.5 { discard; } return textureSample(t, s, uv);",
        "return drawn(uv, (flags & 1u) != 0u);",
        "return drawn(uv, kind == 1u);",
        "if uv.x > 0.5 { return textureSampleLevel(t, s, uv, 0.0); } return vec4f(0.0);",
    ] {
        assert_eq!(parted(body), None, "{body}");
    }
}

/// Karat reports a race even if both invocations write the same value when all buffers contain zeros. For a race in
/// workgroup memory, the report suggests a barrier.
#[test]
fn races_of_read_values_are_reported() {
    let pass = |body: &str| {
        look(&format!(
            "@group(0) @binding(0) var<storage, read> a: array<f32>;
             @group(0) @binding(1) var<storage, read_write> b: array<f32>;
             var<workgroup> tile: array<f32, 64>;
             @compute @workgroup_size(64) fn half(@builtin(global_invocation_id) id: vec3u,
                 @builtin(local_invocation_index) i: u32) {{ if id.x < arrayLength(&a) {{ {body} }} }}"
        ))
    };
    let race = |hazards: &Hazards| {
        let mut all = hazards.found.iter().filter(|one| one.kind == Kind::Race);
        all.next().unwrap_or_else(|| panic!("{hazards:#?}")).to_string()
    };
    for body in ["b[id.x / 2u] = a[id.x];", "b[0] = a[id.x] + 1.0;", "b[id.x % 8u] = f32(id.x);"] {
        race(&pass(body));
    }
    let within = race(&pass("tile[i] = a[id.x]; b[id.x] = tile[63u - i];"));
    assert!(within.contains("put a `workgroupBarrier()` between the two"), "{within}");
}

/// If a dispatch has more invocations than the array has elements, Karat finds a missing guard. The test dispatches
/// along one axis and along three axes. The report gives the condition under which the index is outside of the array.
#[test]
fn a_tail_without_its_guard_is_found() {
    let line = "@group(0) @binding(0) var<storage, read_write> v: array<f32>;
        @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) g: vec3u) { GUARD v[g.x] = 2.0 * v[g.x]; }";
    let block = "struct Grid { size: vec3u }
        @group(0) @binding(0) var<uniform> grid: Grid;
        @group(0) @binding(1) var<storage, read_write> v: array<f32>;
        @compute @workgroup_size(4, 4, 4) fn main(@builtin(global_invocation_id) g: vec3u) {
            GUARD
            v[(g.z * grid.size.y + g.y) * grid.size.x + g.x] = 1.0;
        }";
    for (text, guard, less) in [
        (line, "if g.x >= arrayLength(&v) { return; }", ""),
        (block, "if any(g >= grid.size) { return; }", "if any(g.xy >= grid.size.xy) { return; }"),
    ] {
        let look = |guard: &str| {
            let package = Package::from_source("m", text.replace("GUARD", guard));
            karat_inspect::hazards(&package).run().expect("checked")
        };
        let right = look(guard);
        let tails = |one: &&Hazard| one.fails.as_ref().is_some_and(|one| one.contains("multiple"));
        assert!(
            right.faults().count() == 0 && !right.found.iter().any(|one| tails(&one)),
            "{right}"
        );
        let wrong = look(less);
        let beyond = wrong.found.iter().find(|one| one.kind == Kind::OutOfRange);
        let told = beyond.map(ToString::to_string).unwrap_or_default();
        assert!(
            told.contains("where the number of elements isn't a multiple of the workgroup size"),
            "{wrong}"
        );
        assert!(told.contains(" but `v` has "), "{told}");
    }
}

/// The values in `s` decide which invocations swap elements. Without a barrier, another invocation may read an element
/// before the swap.
#[test]
fn a_race_that_data_decide_is_found() {
    let text = |barrier: &str| {
        format!(
            "@group(0) @binding(0) var<storage, read_write> keys: array<u32, 64>;
            var<workgroup> s: array<u32, 64>;
            @compute @workgroup_size(32) fn main(@builtin(local_invocation_index) i: u32) {{
                s[i] = keys[i];
                s[i + 32u] = keys[i + 32u];
                workgroupBarrier();
                if s[i] > s[63u - i] {{ let x = s[i]; s[i] = s[63u - i]; s[63u - i] = x; }}
                {barrier}
                keys[i] = s[i];
                keys[i + 32u] = s[i + 32u];
            }}"
        )
    };
    let look = |barrier: &str| {
        let package = Package::from_source("m", text(barrier));
        karat_inspect::hazards(&package).run().expect("checked").found
    };
    assert!(look("workgroupBarrier();").is_empty());
    let found = look("");
    let [race] = &found[..] else { panic!("{found:?}") };
    assert_eq!((race.kind, race.text.as_str()), (Kind::Race, "s[63u - i] = x"));
}

/// Checks if a result loses its digits for some number in a range, by running single cases.
fn loses(text: &str, range: std::ops::RangeInclusive<f32>) -> bool {
    let package = Package::from_source("planted", text);
    let check = package.function("f").over(range).cases(4096).unrecorded();
    match check.try_has_none_of([Kind::LostDigits]) {
        Ok(_) => false,
        Err(Failure::Disagreement(found)) => {
            assert!(found.to_string().contains("lost digits at"), "{found}");
            true
        }
        Err(other) => panic!("{text}: {other}"),
    }
}

/// The other cases of a run don't affect the verdict on a case.
#[test]
fn lost_digits_are_judged_case_by_case() {
    let package = Package::from_source("planted", "fn f(r: f32) -> f32 { return exp(r) - 1.0; }");
    for others in [vec![], vec![0.5], vec![80.0], vec![0.0, -3.0, 20.0]] {
        let all = OneOf([vec![0.000_03_f32], others].concat());
        let check = package.function("f").over(all.clone()).unrecorded();
        let failure = check.try_has_no_hazards().expect_err("1.3e-3 of the result is rounding");
        let Failure::Disagreement(found) = failure else { panic!("{failure}") };
        let census = found.paths[0].census;
        assert_eq!((census.failures, census.cases), (1, all.0.len() as u64), "{found}");
    }
    // The result loses fewer than half of its digits.
    package.function("f").over(OneOf(vec![0.01_f32, 0.5, 80.0])).has_no_hazards();
}

/// If a range contains 0, samples include numbers near 0. Samples of unconstrained numbers do, too.
#[test]
fn digits_are_lost_near_a_zero_inside() {
    let grows = "fn f(x: f32) -> f32 { return exp(x) - 1.0; }";
    for range in [-1.0..=1.0, -0.25..=80.0, -1000.0..=1000.0] {
        assert!(loses(grows, range.clone()), "{range:?}");
    }
    assert!(!loses(grows, 0.25..=80.0), "0 isn't inside");
    assert!(loses("fn f(x: f32) -> f32 { return log(1.0 + x); }", -0.5..=4.0));
    assert!(loses("fn f(x: f32) -> f32 { return (exp(x) - exp(-x)) * 0.5; }", -3.0..=3.0));
    let text = "fn f(h: f32) -> f32 { return sign(h) * log(abs(h) + sqrt(h * h + 1.0)); }";
    at(text, Kind::LostDigits, "log(abs(h) + sqrt(h * h + 1.0))");
}

/// If an operation loses digits even in `f64`, the `f32` and `f64` results may agree, but interval arithmetic shows the
/// loss.
#[test]
fn digits_that_double_precision_loses_are_lost() {
    let root = "fn f(x: f32) -> f32 { return sqrt(x + 1.0) - sqrt(x); }";
    assert!(loses(root, 1e17..=1e20) && loses(root, 1.0..=1e30));
    for expression in
        ["(x + 1.0) - x", "log(1.0 + 1.0 / x)", "exp(1.0 / x) - 1.0", "1.0 - cos(1.0 / x)"]
    {
        let text = format!("fn f(x: f32) -> f32 {{ return {expression}; }}");
        assert!(loses(&text, 1e17..=1e20), "{expression}");
    }
    for hidden in ["(x + (sqrt(x + 1.0) - sqrt(x)))", "min(0.0, (x + 1.0) - x)"] {
        let text = format!("fn f(x: f32) -> f32 {{ return select({hidden}, 2.0, x > 1.0); }}");
        assert!(!loses(&text, 1e17..=1e20), "the result shows no loss: {hidden}");
    }
}

/// An exact operation loses no digits, even if its result is 0.
#[test]
fn exact_differences_lose_no_digits() {
    for expression in [
        "x - x",
        "x - 0.5",
        "(x + 0.0) - x",
        "(x * 2.0) - (x + x)",
        "x * x - x * x",
        "sqrt(x * x + 1.0) - sqrt(x * x + 1.0)",
        "exp(x * 0.0) - 1.0",
        "cos(x - x) - 1.0",
        "x - floor(x)",
        "(x + 0.1) * 0.0",
        "max(exp(x) - 1.0, 5.0)",
        "(exp(x) - 1.0) + 7.0",
        "1.0 - step(0.0, x)",
    ] {
        let text = format!("fn f(x: f32) -> f32 {{ return {expression}; }}");
        for range in [-1.0..=1.0, -1000.0..=1000.0, 1e17..=1e20] {
            let overflows = expression.contains("exp(x)") && *range.end() > 80.0;
            let range = if overflows { -1.5..=1.5 } else { range };
            assert!(!loses(&text, range.clone()), "{expression} over {range:?}");
        }
    }
}

/// If a function executes many operations, Karat tries only some of its inputs. The report counts the inputs that Karat
/// didn't try.
#[test]
fn the_work_of_a_function_is_bounded() {
    let text = |lines: usize| {
        let line = "    y = y * 1.5 + x; y = sin(y) - x;\n".repeat(lines);
        format!("fn f(x: f32) -> f32 {{\n    var y = 1.0 / x;\n{line}    return y;\n}}\n")
    };
    let look = |text: String| {
        karat_inspect::hazards(&Package::from_source("m", text)).run().expect("checked")
    };
    let short = look(text(10));
    assert_eq!(short.unseen.inputs, 0, "{short}");
    for lines in [2000, 4000] {
        let long = look(text(lines));
        assert!((1..1024).contains(&long.unseen.inputs), "{}", long.unseen.inputs);
        assert_eq!(long.unseen.functions, 1);
        let mut all = long.found.iter();
        let zero = all.find(|one| one.text == "1.0 / x");
        let zero = zero.unwrap_or_else(|| panic!("inputs at edges remain: {long}"));
        assert_eq!(zero.cases.1 + long.unseen.inputs, 1024);
    }
}

#[test]
fn each_function_is_reported_when_it_is_done() {
    let text = "fn a(x: f32) -> f32 { return 1.0 / x; }\nfn b(x: f32) -> f32 { return x; }\n\
                fn c(x: f32) -> f32 { return log(x); }\n";
    let told = std::sync::Mutex::new(Vec::new());
    let package = Package::from_source("m", text);
    let hazards = karat_inspect::hazards(&package).run_with(&|at| {
        told.lock().expect("whole").push((at.done, at.of, at.function.to_owned(), at.found > 0));
    });
    assert!(hazards.is_ok());
    let mut told = told.into_inner().expect("whole");
    assert_eq!(told.iter().map(|one| (one.0, one.1)).collect::<Vec<_>>(), [(1, 3), (2, 3), (3, 3)]);
    told.sort_by(|one, other| one.2.cmp(&other.2));
    let found: Vec<(&str, bool)> = told.iter().map(|one| (&*one.2, one.3)).collect();
    assert_eq!(found, [("a", true), ("b", false), ("c", true)]);
}

/// Tests shaders that a reader of the guide tried. An earlier version missed hazards in these shaders, or reported them
/// with a wrong class or name.
// Lesson 98
#[test]
fn free_inputs_are_drawn() {
    let head = "@group(0) @binding(0) var tex: texture_2d<f32>;\n@group(0) @binding(1) var smp: sampler;\n";
    let fragment = |body: &str| {
        format!(
            "{head}@fragment fn fs(@builtin(position) pos: vec4f, @location(0) uv: vec2f) -> @location(0) vec4f {{ {body} }}"
        )
    };
    // An image may be black, and may have any size.
    let black = fragment("return vec4f(1.0 / textureSample(tex, smp, uv).x);");
    let one = at(&black, Kind::Infinite, "1.0 / textureSample(tex, smp, uv).x");
    assert_eq!((one.class, &*one.needs), (Class::Requirement, &["tex".to_owned()][..]));
    let load = fragment("return textureLoad(tex, vec2i(pos.xy), 0);");
    let one = at(&load, Kind::OutOfRange, "textureLoad(tex, vec2i(pos.xy), 0)");
    assert_eq!(one.class, Class::Requirement, "{one}");
    // An error isn't a finding if it occurs only on drivers that keep subnormal numbers.
    let guard = "fn f(roughness: f32) -> f32 { if roughness > 0.0 { return 1.0 / roughness; } return 0.0; }";
    assert_eq!(found(guard), []);
    // An integer's name doesn't exclude 0, or an index outside of the array.
    let count = at("fn f(n: u32) -> f32 { return 1.0 / f32(n); }", Kind::Infinite, "1.0 / f32(n)");
    assert_eq!((count.class, &*count.needs), (Class::Requirement, &["n".to_owned()][..]));
    let gather = "@group(0) @binding(0) var<storage, read> idx: array<u32>;
        @group(0) @binding(1) var<storage, read> vals: array<f32>;
        @group(0) @binding(2) var<storage, read_write> dst: array<f32>;
        @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {
            if id.x >= arrayLength(&idx) || id.x >= arrayLength(&dst) { return; }
            dst[id.x] = vals[idx[id.x]];
        }";
    let one = at(gather, Kind::OutOfRange, "vals[idx[id.x]]");
    assert!(one.class == Class::Requirement && one.needs.contains(&"idx".to_owned()), "{one}");
    // Samples include the numbers in the shader's text.
    for text in [
        "fn f(x: f32) -> f32 { return 1.0 / (x - 3.25); }",
        "fn f(x: f32, mode: u32) -> f32 { if mode == 777777u { return 1.0 / (x - x); } return x; }",
    ] {
        assert!(found(text).iter().any(|one| one.kind == Kind::Infinite), "{text}");
    }
    // Only the member that is 0 causes the finding.
    let member = "struct P { dt: f32 }
        @group(0) @binding(0) var<uniform> params: P;
        @group(0) @binding(1) var<storage, read_write> data: array<f32>;
        @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {
            if id.x >= arrayLength(&data) { return; }
            data[id.x] = 1.0 / params.dt;
        }";
    let one = at(member, Kind::Infinite, "1.0 / params.dt");
    assert_eq!((one.class, &*one.needs), (Class::Requirement, &["params.dt".to_owned()][..]));
    let behind = "@group(0) @binding(0) var<storage, read_write> data: array<f32>;
        @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {
            if id.x >= arrayLength(&data) { return; }
            data[id.x + 1u] = 1.0;
        }";
    let one = at(behind, Kind::OutOfRange, "data[id.x + 1u] = 1.0");
    assert!(one.class != Class::Requirement || !one.needs.is_empty(), "{one}");
    let halves = "fn a(x: f32) -> f32 { var y = x; while (y != 1.0) { y = y * 0.5; } return y; }";
    let one = at(halves, Kind::Endless, &{
        let all = look(halves);
        of_kind(&all, Kind::Endless).text
    });
    assert_eq!((one.class, &*one.needs), (Class::Requirement, &["x".to_owned()][..]));
}

/// Karat finds no fault in these correct shaders of other projects. Each shader relies on its host: on an array longer
/// than the dispatch, on a projection matrix, or on an earlier call that sets a private variable.
// Lesson 98
#[test]
fn inputs_of_the_host_cause_no_fault() {
    let level = "struct U { width: u32 } @group(0) @binding(0) var<uniform> ubo: U;
        @group(0) @binding(1) var<storage, read> buf_in: array<f32>;
        @group(0) @binding(2) var<storage, read_write> buf_out: array<f32>;
        @compute @workgroup_size(64) fn level(@builtin(global_invocation_id) id: vec3u) {
            if id.x >= ubo.width || id.x + id.y * ubo.width >= arrayLength(&buf_out) { return; }
            buf_out[id.x + id.y * ubo.width] = buf_in[2u * id.x + 2u * id.y * ubo.width];
        }";
    let hazards = look(level);
    assert_eq!(hazards.faults().count(), 0, "{hazards}");
    let one = at(level, Kind::OutOfRange, "buf_in[2u * id.x + 2u * id.y * ubo.width]");
    assert!(one.needs.iter().any(|need| need.contains("buf_in")), "{one}");
    let near = "struct U { inverseModelViewProjectionMatrix: mat4x4f } @group(0) @binding(0) var<uniform> u: U;
        @vertex fn vs(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
            var near = u.inverseModelViewProjectionMatrix * vec4f(f32(i), 0.0, 0.0, 1.0);
            near /= near.w;
            return near;
        }";
    assert_eq!(look(near).faults().count(), 0, "{}", look(near));
    let state = "var<private> rnd: vec3u;
        fn rand() -> f32 { rnd = rnd * 7u + 3u; return f32(rnd.x) / 4294967295.0; }
        fn phi() -> f32 { return acos(1.0 - 2.0 * f32(rnd.y)); }";
    assert_eq!(look(state).faults().count(), 0, "{}", look(state));
    let one = at(state, Kind::Nan, "acos(1.0 - 2.0 * f32(rnd.y))");
    assert_eq!(one.needs, ["rnd"], "{one}");
    // In a function without a result, the variables that it writes count as results.
    let left = "var<private> p: f32; fn put(x: f32) { p = sqrt(x - 0.5); }";
    assert_eq!(at(left, Kind::Nan, "sqrt(x - 0.5)").needs, ["x"]);
    // In a host's texture, a shader may step down to a level of one texel.
    let walk = "@group(0) @binding(0) var tex: texture_2d<f32>;
        @group(0) @binding(1) var<storage, read_write> out: array<vec4f>;
        @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {
            if id.x >= arrayLength(&out) { return; }
            var coord = vec2i(0);
            for (var level = textureNumLevels(tex) - 1u; level > 0u; level--) {
                coord = 2 * coord + vec2i(vec2f(0.5) < textureLoad(tex, coord, level).xy);
            }
            out[id.x] = textureLoad(tex, coord, 0);
        }";
    assert_eq!(look(walk).faults().count(), 0, "{}", look(walk));
    // The report shows a case that no input averts.
    let held = "fn f(x: f32, roughness: f32) -> f32 { return x / (roughness * abs(x - 2.0)); }";
    let one = at(held, Kind::Nan, "x / (roughness * abs(x - 2.0))");
    let shown = one.arguments.iter().find(|(name, _)| name == "roughness").map(|(_, x)| &**x);
    assert_eq!((one.class, shown), (Class::Fault, Some("0")), "{one}");
}

/// Karat gives an override its declared value, or otherwise its default.
// Lesson 98
#[test]
fn overrides_are_declared() {
    let text = "override SCALE: f32;\nfn f(x: f32) -> f32 { return x / SCALE; }\n\
        @group(0) @binding(0) var<storage, read_write> out: array<f32>;\n\
        @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {\n\
            if id.x < arrayLength(&out) { out[id.x] = 2.0 / SCALE; }\n}";
    let package = Package::from_source("planted", text);
    assert!(
        matches!(karat_inspect::hazards(&package).run(), Err(HazardError::Nothing { .. })),
        "it has no value"
    );
    let faults = |scale: f64| {
        let hazards =
            karat_inspect::hazards(&package).with_override("SCALE", scale).run().expect("checked");
        assert_eq!((hazards.functions, hazards.skipped.len()), (2, 0));
        hazards.faults().map(|one| one.text.clone()).collect::<Vec<_>>()
    };
    assert_eq!(
        (faults(2.0), faults(0.0)),
        (vec![], vec!["x / SCALE".to_owned(), "2.0 / SCALE".to_owned()])
    );
    let error = karat_inspect::hazards(&package)
        .with_override("SCAL", 1.0)
        .run()
        .expect_err("there is none");
    assert!(error.to_string().contains("uses an override `SCAL`"), "{error}");
}

/// Karat reports no hazard that the declarations in `karat.toml` exclude. In this test, each declaration excludes the
/// hazards of one function. For example, `length(out)` is a multiple of 64.
#[test]
fn declared_inputs_of_the_host_are_used() {
    let folder = tempfile::tempdir().expect("a folder");
    let write = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).expect("written");
    };
    write(
        "m.wgsl",
        "@group(0) @binding(0) var<storage, read> places: array<u32>;
        @group(0) @binding(1) var<storage, read_write> sum: array<u32>;
        @group(0) @binding(2) var<storage, read_write> out: array<f32>;
        @compute @workgroup_size(64) fn scatter(@builtin(global_invocation_id) g: vec3u) {
            if g.x >= arrayLength(&places) { return; }
            sum[places[g.x]] += 1u;
        }
        @compute @workgroup_size(64) fn tail(@builtin(global_invocation_id) g: vec3u) { out[g.x] = 1.0; }
        @compute @workgroup_size(64) fn one(@builtin(local_invocation_index) i: u32, @builtin(workgroup_id) w: vec3u) {
            if i == 0u { out[0] = out[0] + f32(w.x); }
        }
        fn toward(q: vec3f) -> vec3f { return normalize(q); }
        fn away(q: vec3f) -> vec3f { return normalize(q); }
        fn kind(k: u32) -> f32 { return 1.0 / f32(k); }
        override SIZE: u32 = 0u;
        fn sized() -> f32 { return 1.0 / f32(SIZE); }",
    );
    let package = Package::open(folder.path()).expect("opened");
    let told = |declared: &str| {
        write("karat.toml", declared);
        let hazards = karat_inspect::hazards(&package).run().expect("valid declarations");
        assert_eq!((hazards.schema, hazards.skipped.len()), (2, 0), "{hazards}");
        hazards
            .found
            .iter()
            .map(|one| one.function.clone())
            .collect::<std::collections::BTreeSet<_>>()
    };
    let names = |all: &[&str]| all.iter().map(|name| format!("m::{name}")).collect();
    let all = ["away", "kind", "one", "scatter", "sized", "tail", "toward"];
    assert_eq!(told(""), names(&all));
    // Each declaration removes the findings of one function.
    for (declared, mends) in [
        ("[inputs]\nplaces = { distinct = true, range = [0, \"length(sum) - 1\"] }", "scatter"),
        ("[inputs]\n\"length(out)\" = \"multiple of 64\"", "tail"),
        ("[inputs]\n\"workgroups(m::one)\" = 1", "one"),
        ("[inputs]\n\"workgroups(one)\" = [1, 1]", "one"),
        ("[inputs]\n\"m::toward.q\" = \"unit_vector\"", "toward"),
        ("[inputs]\nk = { one_of = [1, 2, 4] }", "kind"),
        ("[overrides]\nSIZE = 4", "sized"),
    ] {
        let rest: Vec<&str> = all.into_iter().filter(|name| *name != mends).collect();
        assert_eq!(told(declared), names(&rest), "{declared}");
    }
    // If elements may be equal, the pass races. If another array has the declared length, the pass has a tail.
    let same = told("[inputs]\nplaces = { range = [0, \"length(sum) - 1\"] }");
    assert!(same.contains("m::scatter"), "{same:?}");
    assert!(told("[inputs]\n\"length(out)\" = [1, 100]").contains("m::tail"));
    // Some declarations apply to no input, and others allow no value.
    for (declared, part) in [
        ("[inputs]\n\n\"length(outt)\" = 64", "karat.toml:3:1)"),
        ("[inputs]\n\"workgroups(m::two)\" = 1", "karat.toml:2:1)"),
        ("[inputs]\n\"m::toward.p\" = [0, 1]", "karat.toml:2:1)"),
        ("[inputs]\n\"m::nowhere.q\" = [0, 1]", "karat.toml:2:1)"),
        (
            "[inputs]\nplaces = { distinct = true, range = [0, 10] }",
            "different elements, but there are only 11 numbers",
        ),
        ("[inputs]\nplaces = { range = [0, \"length(summ)\"] }", "no buffer has the name `summ`"),
        ("[inputs]\nk = { one_of = [0.5] }", "some of these numbers aren't u32"),
        ("[inputs]\nk = \"unit_vector\"", "declared as \"unit_vector\", but its type is u32"),
        ("[inputs]\nk = \"unit vector\"", "the input `k` must be a number"),
        ("[overrides]\nSIZES = 4", "uses an override `SIZES`"),
        ("[overrides]\nSIZE = \"4\"", "the override `SIZE` must be a number or a bool"),
    ] {
        write("karat.toml", declared);
        let error = karat_inspect::hazards(&package).run().expect_err(declared).to_string();
        assert!(error.contains(part), "{declared}: {error}");
    }
}

/// Karat reports an unsigned difference that wraps below 0 and then becomes a float. Karat doesn't report a hash that
/// wraps on purpose.
#[test]
fn differences_below_zero_that_become_floats_are_found() {
    for (text, operation) in [
        ("fn f(a: u32, b: u32) -> f32 { return f32(a - b); }", "f32(a - b)"),
        (
            "fn f(a: u32, b: u32) -> f32 { let d = 2u * a - b; return 0.5 * f32(d + 1u); }",
            "f32(d + 1u)",
        ),
        (
            "fn f(word: u32, zero: u32) -> vec4f { return vec4f(unpack4xU8(word) - vec4u(zero)); }",
            "vec4f(unpack4xU8(word) - vec4u(zero))",
        ),
    ] {
        let one = at(text, Kind::BelowZero, operation);
        assert_eq!(one.class, Class::Requirement, "{one}");
    }
    for right in [
        "fn f(a: u32, b: u32) -> f32 { return f32(max(a, b) - b); }",
        "fn f(a: u32, b: u32) -> f32 { return f32(select(b - a, a - b, a >= b)); }",
        "fn f(a: u32, b: u32) -> f32 { return f32(i32(a % 9u) - i32(b % 9u)); }",
        "fn f(a: u32) -> f32 { return f32((a ^ 61u) - (a >> 1u) & 0xffu); }",
        "fn f(a: u32) -> u32 { return a - 7u; }",
        "fn f(a: u32) -> f32 { return f32(a % 9u + 0u - 0u); }",
    ] {
        let all = found(right);
        assert!(all.iter().all(|one| one.kind != Kind::BelowZero), "{right}: {all:?}");
    }
    let package = Package::from_source("m", "fn f(a: u32, b: u32) -> f32 { return f32(a - b); }");
    let check = package.function("f").over((Integers(0..=9_u32), Integers(0..=9_u32)));
    assert!(check.unrecorded().try_has_no_hazards().is_err(), "a test finds it, too");
}

/// A kind has the same name in reports, in JSON and in `karat.toml`.
#[test]
fn kinds_have_one_name() {
    for kind in [
        Kind::Nan,
        Kind::OutOfRange,
        Kind::Wrapped,
        Kind::BelowZero,
        Kind::Race,
        Kind::Barrier,
        Kind::ByZero,
        Kind::Infinite,
        Kind::Saturated,
        Kind::EdgesReversed,
        Kind::LostDigits,
        Kind::EqualWrites,
        Kind::Unbounded,
        Kind::Endless,
    ] {
        let key = serde_json::to_value(kind).expect("a name");
        assert_eq!(key, kind.name().to_lowercase().replace(' ', "_"));
    }
}
