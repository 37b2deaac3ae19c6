//! The packages of expectations, such as `expect_near`, for tests in WGSL: their WGSL, and the layout of the values
//! that a failing expectation stores.
//!
//! `karat` contains Karat's own expectations, and `wgsl_test` has the expectations of the WGSL community's test runner.
//! The first argument of each expectation is a number that identifies the call. The linker inserts this number into
//! each call: `expect(x)` becomes `expect(3u, x)`. The shader tests each expectation with a slightly narrower bound
//! than the author's. If this test fails, private variables store the expectation's values, and the host decides, by
//! the kind of the expectation ([`Wanted`]), if the expectation really failed.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::sync::LazyLock;

/// The number of `u32`s that an expectation stores if it may have failed: one for the number of the call, one for the
/// kind and the number of components, four for the values, four for the expected values, and two for the bounds.
pub const KEPT_WORDS: usize = 12;

/// The largest number of expectations whose values a case stores. If more expectations may have failed, the message
/// states only how many others there are.
pub const MOST_KEPT: usize = 3;

/// The number of `u32`s in a test's result. The result consists of the number of evaluated expectations, the number of
/// expectations that may have failed, and the stored values of the first [`MOST_KEPT`] of these expectations.
pub const REPORT_WORDS: usize = 2 + MOST_KEPT * KEPT_WORDS;

/// The kind of an expectation. The generated WGSL contains the discriminants of these variants.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    True,
    EqualU32,
    EqualI32,
    EqualF32,
    /// The values differ by at most the bound.
    Near,
    /// The values differ by at most the bound times the expected value.
    Relative,
    /// The values differ by at most the bound, which counts steps between neighbouring `f32`s.
    Ulp,
    /// The values differ by at most the larger of an absolute and a relative bound.
    Within,
    Finite,
    AtMost,
    Less,
    InRange,
}

impl Wanted {
    pub const ALL: [Self; 12] = [
        Self::True,
        Self::EqualU32,
        Self::EqualI32,
        Self::EqualF32,
        Self::Near,
        Self::Relative,
        Self::Ulp,
        Self::Within,
        Self::Finite,
        Self::AtMost,
        Self::Less,
        Self::InRange,
    ];
}

/// A package of expectations.
#[derive(Debug)]
pub struct Expectations {
    /// The text of the package's only module.
    pub text: String,
    /// The names of the expectations, such as `expect_near`.
    pub names: BTreeSet<String>,
}

impl Expectations {
    fn new(text: String) -> Self {
        let declared = text.split("fn expect").skip(1);
        let names = declared.filter_map(|rest| Some(format!("expect{}", rest.split('(').next()?)));
        Self { names: names.collect(), text }
    }
}

static KARAT: LazyLock<Expectations> = LazyLock::new(|| Expectations::new(karat()));
static WGSL_TEST: LazyLock<Expectations> = LazyLock::new(|| Expectations::new(wgsl_test()));

pub fn package(name: &str) -> Option<&'static Expectations> {
    match name {
        "karat" => Some(&KARAT),
        "wgsl_test" => Some(&WGSL_TEST),
        _ => None,
    }
}

/// The suffixes of the generated functions for one to four components, each with the type of the values.
const FLOATS: [(&str, &str); 4] =
    [("", "f32"), ("_vec2", "vec2f"), ("_vec3", "vec3f"), ("_vec4", "vec4f")];
const WHOLES: [(&str, &str); 4] =
    [("_u32", "u32"), ("_vec2u", "vec2u"), ("_vec3u", "vec3u"), ("_vec4u", "vec4u")];
const SIGNED: [(&str, &str); 4] =
    [("_i32", "i32"), ("_vec2i", "vec2i"), ("_vec3i", "vec3i"), ("_vec4i", "vec4i")];

/// A WGSL expression for a `vec4u` with the bits of `x`, followed by zeros.
fn words(x: &str, width: usize) -> String {
    match width {
        1 => format!("vec4u(bitcast<u32>({x}), 0u, 0u, 0u)"),
        2 => format!("vec4u(bitcast<vec2u>({x}), 0u, 0u)"),
        3 => format!("vec4u(bitcast<vec3u>({x}), 0u)"),
        _ => format!("bitcast<vec4u>({x})"),
    }
}

/// A WGSL expression for a `vec4f` with the components of `x`, followed by zeros.
fn four(x: &str, width: usize) -> String {
    match width {
        1 => format!("vec4f({x}, 0.0, 0.0, 0.0)"),
        2 => format!("vec4f({x}, 0.0, 0.0)"),
        3 => format!("vec4f({x}, 0.0)"),
        _ => x.to_owned(),
    }
}

/// The WGSL code that stores, in private variables, the values of expectations that may have failed. Each stored
/// expectation has its own variables, because an array with a variable index makes compilation tens of times slower in
/// some drivers.
fn report() -> String {
    let mut text = "\nvar<private> evaluated: u32;\nvar<private> suspected: u32;\n".to_owned();
    let (mut stored, mut listed) = (String::new(), String::new());
    for kept in 0..MOST_KEPT {
        write!(
            text,
            "var<private> head{kept}: vec4u;\nvar<private> actual{kept}: vec4u;\n\
             var<private> expected{kept}: vec4u;\n"
        )
        .expect("text takes text");
        writeln!(
            stored,
            "    if suspected == {kept}u {{ head{kept} = vec4u(site, kind, bound); \
             actual{kept} = actual; expected{kept} = expected; }}"
        )
        .expect("text takes text");
        let words = |name: &str, lanes: [&str; 4]| {
            lanes.map(|lane| format!(", {name}{kept}.{lane}")).concat()
        };
        listed += &format!(", head{kept}.x, head{kept}.y");
        listed += &words("actual", ["x", "y", "z", "w"]);
        listed += &words("expected", ["x", "y", "z", "w"]);
        listed += &format!(", head{kept}.z, head{kept}.w");
    }
    write!(
        text,
        "
fn begin() {{
    evaluated = 0u;
    suspected = 0u;
}}

fn counts() -> array<u32, 2> {{
    return array<u32, 2>(evaluated, suspected);
}}

fn report() -> array<u32, {REPORT_WORDS}> {{
    return array<u32, {REPORT_WORDS}>(evaluated, suspected{listed});
}}

fn judge(site: u32, kind: u32, actual: vec4u, expected: vec4u, bound: vec2u, passes: bool) {{
    evaluated += 1u;
    if passes {{
        return;
    }}
{stored}    suspected += 1u;
}}
"
    )
    .expect("text takes text");
    text
}

fn karat() -> String {
    // A driver may assume that no value is NaN, so the shader tests the bits for NaN. The shader accepts values within
    // a narrower bound than the author's, and the host judges the others. Rounding can't bring a difference above the
    // author's bound below the narrower bound.
    let mut text = format!(
        "{}

fn are_finite(x: vec4f) -> bool {{
    return all((bitcast<vec4u>(x) & vec4u(0x7f800000u)) != vec4u(0x7f800000u));
}}

fn are_near(actual: vec4f, expected: vec4f, absolute: f32, relative: f32) -> bool {{
    let bound = max(vec4f(absolute), relative * max(abs(actual), abs(expected)));
    return are_finite(actual) && are_finite(expected) && are_finite(bound)
        && absolute >= 0.0 && relative >= 0.0
        && all((abs(actual - expected) <= 0.999 * bound) | (abs(actual - expected) < vec4f(absolute)));
}}

// The number of `f32` steps from the smallest to the largest number. With a larger bound, every value would pass.
const MOST_STEPS: f32 = 4278190080.0;

fn place(x: f32) -> u32 {{
    let bits = bitcast<u32>(x);
    return select(0x80000000u + bits, 0x80000000u - (bits & 0x7fffffffu), bits >= 0x80000000u);
}}

fn steps(a: f32, b: f32) -> f32 {{
    let first = place(a);
    let other = place(b);
    return f32(max(first, other) - min(first, other));
}}

fn within_steps(actual: vec4f, expected: vec4f, bound: f32) -> bool {{
    let apart = vec4f(steps(actual.x, expected.x), steps(actual.y, expected.y),
        steps(actual.z, expected.z), steps(actual.w, expected.w));
    return are_finite(actual) && are_finite(expected) && are_finite(vec4f(bound))
        && bound < MOST_STEPS && all(apart <= vec4f(bound));
}}

fn judge_within(site: u32, width: u32, actual: vec4f, expected: vec4f, relative: f32, absolute: f32) {{
    let passes = are_near(actual, expected, absolute, relative);
    judge(site, {}u * 8u + width, bitcast<vec4u>(actual), bitcast<vec4u>(expected),
        vec2u(bitcast<u32>(relative), bitcast<u32>(absolute)), passes);
}}

fn judge_ulp(site: u32, width: u32, actual: vec4f, expected: vec4f, bound: f32) {{
    judge(site, {}u * 8u + width, bitcast<vec4u>(actual), bitcast<vec4u>(expected),
        vec2u(bitcast<u32>(bound), 0u), within_steps(actual, expected, bound));
}}

fn expect_true(site: u32, condition: bool) {{
    judge(site, 1u, vec4u(u32(condition)), vec4u(1u), vec2u(0u), condition);
}}

fn expect_false(site: u32, condition: bool) {{
    judge(site, 1u, vec4u(u32(condition)), vec4u(0u), vec2u(0u), !condition);
}}
",
        report(),
        Wanted::Within as u32,
        Wanted::Ulp as u32,
    );
    let exact = [(WHOLES, Wanted::EqualU32), (SIGNED, Wanted::EqualI32)];
    for (types, wanted) in exact {
        for (width, (suffix, ty)) in (1..).zip(types) {
            let kind = wanted as u32 * 8 + u32::try_from(width).unwrap_or(1);
            writeln!(
                text,
                "fn expect_equal{suffix}(site: u32, actual: {ty}, expected: {ty}) {{ \
                 judge(site, {kind}u, {}, {}, vec2u(0u), all(actual == expected)); }}",
                words("actual", width),
                words("expected", width),
            )
            .expect("text takes text");
        }
    }
    for (width, (suffix, ty)) in (1..).zip(FLOATS) {
        let (actual, expected) = (four("actual", width), four("expected", width));
        let kind = |wanted: Wanted| format!("{}u", wanted as usize * 8 + width);
        let of = |name: &str, more: &str, body: &str| {
            format!("fn expect_{name}{suffix}(site: u32, actual: {ty}{more}) {{ {body} }}\n")
        };
        let pair = format!(", expected: {ty}");
        let bounded = format!(", expected: {ty}, tolerance: f32");
        let judge = |wanted: Wanted, bound: &str, passes: &str| {
            format!(
                "let a = {actual}; let e = {expected}; judge(site, {}, bitcast<vec4u>(a), \
                 bitcast<vec4u>(e), vec2u(bitcast<u32>({bound}), 0u), {passes});",
                kind(wanted)
            )
        };
        let finite = "are_finite(a) && are_finite(e)";
        text += &of(
            "near",
            &bounded,
            &judge(Wanted::Near, "tolerance", "are_near(a, e, tolerance, 0.0)"),
        );
        text += &of(
            "rel",
            &bounded,
            &judge(
                Wanted::Relative,
                "tolerance",
                &format!(
                    "{finite} && are_finite(tolerance * abs(e)) && are_finite(vec4f(tolerance)) && all(abs(a - e) <= 0.999 * tolerance * abs(e))"
                ),
            ),
        );
        text +=
            &of("ulp", &bounded, &judge(Wanted::Ulp, "tolerance", "within_steps(a, e, tolerance)"));
        text += &of(
            "equal",
            &pair,
            &judge(Wanted::EqualF32, "0.0", &format!("{finite} && all(a == e)")),
        );
        text += &of(
            "at_most",
            &pair,
            &judge(Wanted::AtMost, "0.0", &format!("{finite} && all(a <= e)")),
        );
        // Components above `width` count as equal.
        let less = (0..width).map(|lane| format!(" && a[{lane}] < e[{lane}]")).collect::<String>();
        text += &of("less", &pair, &judge(Wanted::Less, "0.0", &format!("{finite}{less}")));
        let inside = (0..width).map(|lane| format!(" && least <= a[{lane}] && a[{lane}] <= most"));
        text += &of(
            "in_range",
            ", least: f32, most: f32",
            &format!(
                "let a = {actual}; judge(site, {}, bitcast<vec4u>(a), vec4u(0u), \
                 bitcast<vec2u>(vec2f(least, most)), \
                 are_finite(a) && are_finite(vec4f(least, most, 0.0, 0.0)){});",
                kind(Wanted::InRange),
                inside.collect::<String>()
            ),
        );
        text += &of(
            "finite",
            "",
            &format!(
                "let a = {actual}; judge(site, {}, bitcast<vec4u>(a), vec4u(0u), vec2u(0u), are_finite(a));",
                kind(Wanted::Finite)
            ),
        );
    }
    text
}

/// The package with the functions of the WGSL community's test runner. The default tolerances are 1e-3 (relative) and
/// 1e-6 (absolute).
fn wgsl_test() -> String {
    let mut text = "import karat::{judge_within, judge_ulp, judge};
fn expect(site: u32, condition: bool) {
    judge(site, 1u, vec4u(u32(condition)), vec4u(1u), vec2u(0u), condition);
}
fn expectEq(site: u32, actual: u32, expected: u32) {
    judge(site, 9u, vec4u(actual), vec4u(expected), vec2u(0u), actual == expected);
}
"
    .to_owned();
    for (width, (_, ty)) in (1..).zip(FLOATS) {
        let (actual, expected) = (four("actual", width), four("expected", width));
        let suffix = if width == 1 { String::new() } else { format!("Vec{width}") };
        write!(
            text,
            "fn expectNear{suffix}(site: u32, actual: {ty}, expected: {ty}) {{ \
             judge_within(site, {width}u, {actual}, {expected}, 1e-3, 1e-6); }}\n\
             fn expectWithin{suffix}(site: u32, actual: {ty}, expected: {ty}, relTol: f32, absTol: f32) {{ \
             judge_within(site, {width}u, {actual}, {expected}, relTol, absTol); }}\n\
             fn expectUlp{suffix}(site: u32, actual: {ty}, expected: {ty}, maxUlp: f32) {{ \
             judge_ulp(site, {width}u, {actual}, {expected}, maxUlp); }}\n"
        )
        .expect("text takes text");
    }
    text
}
