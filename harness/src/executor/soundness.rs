//! Tests that drivers' results are within the engine's bounds, with 2^18 inputs for each test. These tests cover each
//! builtin function, and expressions that drivers reassociate. The engine's own results in `f32` and `f64` must be
//! within the bounds, too.

use super::Executor;
use crate::domain::Source;
use crate::executor;
use crate::interpret::{Bound, Interpreted};
use crate::package::Package;
use crate::path::{self, Path};
use crate::probe::{Call, Probed};
use crate::reflect::Ability;

const CASES: usize = 1 << 18;

/// Edges of `f32`, of the range from 0 to 1, and of the ranges of some builtin functions.
const EDGES: [f32; 24] = [
    0.0,
    -0.0,
    1.0,
    -1.0,
    0.5,
    2.0,
    -2.0,
    1.5,
    f32::MIN_POSITIVE,
    -f32::MIN_POSITIVE,
    1e-40,
    -1e-40,
    1e-45,
    f32::MAX,
    f32::MIN,
    0.999_999_94,
    1.000_000_1,
    -0.999_999_94,
    std::f32::consts::PI,
    std::f32::consts::FRAC_PI_2,
    -std::f32::consts::PI,
    16_777_216.0,
    -16_777_215.0,
    65_504.0,
];

/// Returns rows of arguments: first combinations of edges, then numbers from the unit interval, numbers of
/// moderate size and numbers of any size.
fn rows(width: usize) -> Vec<u32> {
    let mut rows = Vec::with_capacity(CASES * width);
    for case in 0..CASES {
        let mut source = Source::new(0x5eed, case as u64);
        let mut left = case;
        for _ in 0..width {
            let edge = left % EDGES.len();
            left /= EDGES.len();
            let value = match case {
                0..20_000 => EDGES[edge],
                _ if source.below(16) == 0 => EDGES[source.below(EDGES.len() as u64) as usize],
                _ => match source.below(4) {
                    0 => source.unit() as f32,
                    1 => (8.0 * source.unit() - 4.0) as f32,
                    2 => (2000.0 * source.unit() - 1000.0) as f32,
                    _ => {
                        let any = f32::from_bits(source.bits());
                        if any.is_finite() { any } else { 0.25 }
                    }
                },
            };
            rows.push(value.to_bits());
        }
    }
    rows
}

/// Scalar functions, each with the number of its arguments, and the smallest percentage of cases for which the engine
/// must have bounds.
const SCALARS: [(&str, usize, usize); 44] = [
    ("a + b", 2, 60),
    ("a - b", 2, 60),
    ("a * b", 2, 60),
    ("a / b", 2, 50),
    ("a % b", 2, 40),
    ("-a", 1, 99),
    ("abs(a)", 1, 99),
    ("sign(a)", 1, 99),
    ("floor(a)", 1, 99),
    ("ceil(a)", 1, 99),
    ("round(a)", 1, 99),
    ("trunc(a)", 1, 99),
    ("fract(a)", 1, 80),
    ("min(a, b)", 2, 99),
    ("max(a, b)", 2, 99),
    ("clamp(a, -1.0, 2.5)", 1, 99),
    ("saturate(a)", 1, 99),
    ("sqrt(a)", 1, 50),
    ("inverseSqrt(a)", 1, 50),
    ("exp(a)", 1, 50),
    ("exp2(a)", 1, 50),
    ("log(a)", 1, 50),
    ("log2(a)", 1, 50),
    ("pow(a, b)", 2, 20),
    ("sin(a)", 1, 40),
    ("cos(a)", 1, 40),
    ("tan(a)", 1, 40),
    ("asin(a)", 1, 30),
    ("acos(a)", 1, 30),
    ("atan(a)", 1, 90),
    ("atan2(a, b)", 2, 50),
    ("sinh(a)", 1, 40),
    ("cosh(a)", 1, 40),
    ("tanh(a)", 1, 40),
    ("asinh(a)", 1, 30),
    ("acosh(a)", 1, 10),
    ("atanh(a)", 1, 20),
    ("fma(a, b, c)", 3, 40),
    ("mix(a, b, c)", 3, 30),
    ("step(a, b)", 2, 99),
    ("smoothstep(a, b, c)", 3, 30),
    ("degrees(a)", 1, 80),
    ("radians(a)", 1, 99),
    ("select(a, b, a < b)", 2, 99),
];

/// Functions of vectors and matrices, and conversions. If a function returns a vector, the test takes only one
/// component.
const VECTORS: [(&str, usize, usize); 11] = [
    ("length(vec3f(a, b, c))", 3, 20),
    ("distance(vec2f(a, b), vec2f(c, 1.0))", 3, 20),
    ("dot(vec3f(a, b, c), vec3f(b, c, a))", 3, 20),
    ("cross(vec3f(a, b, c), vec3f(b, c, a)).y", 3, 20),
    ("normalize(vec3f(a, b, c)).y", 3, 20),
    ("reflect(vec2f(a, b), vec2f(c, 1.0)).x", 3, 20),
    ("refract(normalize(vec2f(a, b)), vec2f(0.0, 1.0), 0.7).x", 2, 10),
    ("faceForward(vec2f(a, b), vec2f(c, 1.0), vec2f(0.0, 1.0)).x", 3, 50),
    ("(mat2x2f(a, b, c, 1.0) * vec2f(c, a)).x", 3, 20),
    ("f32(i32(a)) + f32(u32(abs(b)))", 2, 90),
    ("f32(bitcast<u32>(a) >> 9u)", 1, 90),
];

/// Expressions of several operations. Drivers choose the order in which they evaluate the operations.
const PROGRAMS: [(&str, usize, usize); 12] = [
    ("(b + b) - 3.0", 2, 90),
    ("(a - b) + 1.0", 2, 60),
    ("a + b - a", 2, 60),
    ("a - b + c - a", 3, 40),
    ("0.1 + a + 0.2", 1, 60),
    ("2.0 * a * 0.1 * b", 2, 40),
    ("a * b / c * a", 3, 10),
    ("a / b / c", 3, 10),
    ("a / sqrt(abs(b) + 1.0) * c", 3, 20),
    ("mix(a, b, c) + a", 3, 20),
    ("fract(a + b) - c", 3, 30),
    ("a * b % 289.0 + c", 3, 20),
];

/// Functions in half precision. The functions' arguments are rounded to half precision.
const HALVES: [(&str, usize, usize); 30] = [
    ("a + b", 2, 40),
    ("a - b", 2, 40),
    ("a * b", 2, 40),
    ("a / b", 2, 20),
    ("-a", 1, 60),
    ("floor(a)", 1, 60),
    ("fract(a)", 1, 60),
    ("max(a, b)", 2, 40),
    ("saturate(a)", 1, 60),
    ("sqrt(a)", 1, 40),
    ("inverseSqrt(a)", 1, 40),
    ("exp(a)", 1, 40),
    ("exp2(a)", 1, 40),
    ("log(a)", 1, 40),
    ("log2(a)", 1, 40),
    ("sin(a)", 1, 40),
    ("cos(a)", 1, 40),
    ("atan(a)", 1, 60),
    ("fma(a, b, c)", 3, 20),
    ("length(vec3(a, b, c))", 3, 10),
    ("dot(vec3(a, b, c), vec3(b, c, a))", 3, 20),
    ("(b + b) - 3.0h", 2, 40),
    ("a + b - a", 2, 40),
    ("a * b / c * a", 3, 10),
    ("fma(a * b, c, a)", 3, 10),
    ("dot(vec2(a * b, c), vec2(0.7h, 0.3h))", 3, 10),
    ("fract(a + b + c)", 3, 30),
    ("length(vec2(a, b))", 2, 10),
    ("a * 0.1h + 0.7h", 1, 40),
    ("exp(-a * a)", 1, 40),
];

/// Functions for which Mesa's drivers return results outside of the bounds: the path, a part of the expression,
/// and the reason. If such a function passes, the test fails.
const KNOWN: [(&str, &str, &str); 5] = [
    (
        "gl",
        "asin(a)",
        "Mesa's asin errs by up to 1.3e-4, but WGSL allows 6.77e-5 or the 4096 ulp of atan2",
    ),
    ("vulkan", "mat2x2f", "Mesa computes a c + c a as c (a + a), which overflows"),
    ("gl", "mat2x2f", "as on vulkan"),
    ("gl", "dot(vec3f", "Mesa computes b c + c a as c (b + a), which loses digits"),
    ("gl", "f32(i32(a))", "naga's GLSL converts floats that are out of range without clamping"),
];

/// Returns the number of cases that have bounds, and the indices of the cases outside of their bounds.
fn outside(bounds: &[Bound], values: &[f64], slack: f64) -> (usize, Vec<usize>) {
    let mut bounded = 0;
    let mut wrong = Vec::new();
    for (case, (bound, value)) in bounds.iter().zip(values).enumerate() {
        let Some((least, most)) = bound.ends() else { continue };
        bounded += 1;
        // The ends of intervals are rounded to `f32`, but values in double precision aren't.
        let slack = slack * value.abs();
        if !(bound.allows(*value) || (least - slack <= *value && *value <= most + slack)) {
            wrong.push(case);
        }
    }
    (bounded, wrong)
}

/// Tests a builtin function. Each error names an executor and a result outside of the bounds.
fn unsound(executors: &[&dyn Executor], (text, width, share): (&str, usize, usize)) -> Vec<String> {
    let parameters = ["a: f32", "b: f32", "c: f32"][..width].join(", ");
    let text = format!("fn f({parameters}) -> f32 {{ return {text}; }}");
    unsound_of(executors, (&text, width, share))
}

/// Like `unsound`, but tests the function `f` in `text`.
fn unsound_of(
    executors: &[&dyn Executor],
    (text, width, share): (&str, usize, usize),
) -> Vec<String> {
    let package = Package::from_source("soundness", text);
    let probed = Probed::new(&package, "f").expect("it is valid");
    let fixtures = Vec::new();
    let engine = Interpreted::new(&probed, &fixtures).expect("the engine executes it");
    let rows = rows(width);
    let bounds = engine.bounds(CASES, &rows).expect("it runs");
    let shown = |case: usize| {
        let row = &rows[case * width..][..width];
        let row: Vec<f32> = row.iter().map(|word| f32::from_bits(*word)).collect();
        format!("{row:?}, allowed {:?}", bounds[case].ends())
    };
    let mut found = Vec::new();
    let judge = |found: &mut Vec<String>, who: &str, values: &[f64], slack: f64| {
        let (bounded, wrong) = outside(&bounds, values, slack);
        assert!(bounded * 100 >= CASES * share, "{text}: {bounded} of {CASES} cases have bounds");
        if let Some(case) = wrong.first() {
            let (count, value) = (wrong.len(), values[*case]);
            found.push(format!("{text} on {who}: {count} errors: {value} for {}", shown(*case)));
        }
    };
    for executor in executors {
        let call = Call { probed: &probed, fixtures: &fixtures, cases: CASES };
        let prepared = executor.prepare(&call).expect("it runs");
        let mut values = Vec::with_capacity(CASES);
        let most = prepared.capacity();
        for first in (0..CASES).step_by(most) {
            let cases = most.min(CASES - first);
            let started = prepared.start(cases, &rows[first * width..][..cases * width]);
            started.expect("it starts")(&mut |words, stride| {
                let results = words.chunks_exact(stride);
                values.extend(results.map(|words| f64::from(f32::from_bits(words[0]))));
            })
            .expect("it ends");
        }
        assert_eq!(values.len(), CASES);
        let before = found.len();
        judge(&mut found, executor.path().name(), &values, 0.0);
        let known = |(path, part, _): &&(&str, &str, &str)| {
            executor.adapter().is_llvmpipe()
                && *path == executor.path().name()
                && text.contains(part)
        };
        if let Some((path, part, why)) = KNOWN.iter().find(known) {
            assert!(found.len() > before, "`{part}` on {path} passes, so this is fixed: {why}");
            found.truncate(before);
        }
    }
    // In double precision, a function with jumps may jump at another argument. So the test skips such functions
    // in double precision.
    let jumps =
        ["%", "floor", "ceil", "round", "trunc", "fract", "step(", "i32", "bitcast", "select", "<"];
    if !jumps.iter().any(|jump| text.contains(jump)) {
        let values = engine.shadow(CASES, &rows).expect("it runs");
        judge(&mut found, "the shadow", &values, f64::from(f32::EPSILON));
    }
    found
}

fn executors() -> Vec<&'static dyn Executor> {
    let second: Path = "vulkan@swiftshader".parse().expect("a path");
    let all = Path::ALL.into_iter().chain([second]);
    let here = all.filter(|path| path::open(*path).is_ok());
    here.chain([Path::CPU]).map(|path| executor::of(path).expect("it opens")).collect()
}

// Lesson 90
#[test]
fn results_of_scalar_built_in_functions_are_allowed() {
    let executors = executors();
    let found: Vec<String> = SCALARS.into_iter().flat_map(|one| unsound(&executors, one)).collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

// Lesson 90
#[test]
fn results_of_vector_built_in_functions_are_allowed() {
    let executors = executors();
    let found: Vec<String> = VECTORS.into_iter().flat_map(|one| unsound(&executors, one)).collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn results_of_half_precision_are_allowed() {
    let mut executors = executors();
    // SwiftShader has no half precision. It may be the only driver on this machine.
    let is_alone = executors
        .iter()
        .all(|executor| executor.path() == Path::CPU || executor.adapter().is_swiftshader());
    executors.retain(|executor| executor.can(Ability::F16));
    let drivers = executors.iter().filter(|executor| executor.path() != Path::CPU).count();
    assert!(drivers > 0 || is_alone, "a driver has half precision");
    let found: Vec<String> = HALVES
        .into_iter()
        .flat_map(|(text, width, share)| {
            let [halves, singles, calls] = ["a: f16", "a: f32", "f16(a)"].map(|one| {
                let each = ["a", "b", "c"][..width].iter().map(|x| one.replace('a', x));
                each.collect::<Vec<_>>().join(", ")
            });
            let text = format!(
                "enable f16; fn h({halves}) -> f16 {{ return {text}; }}
                 fn f({singles}) -> f32 {{ return f32(h({calls})); }}"
            );
            unsound_of(&executors, (&text, width, share))
        })
        .collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// "An implementation may reassociate operations" (WGSL, 15.7.5), and Mesa's compilers do.
// Lesson 168: each order of terms lies within the bound
#[test]
fn results_of_reassociated_programs_are_allowed() {
    let executors = executors();
    let found: Vec<String> =
        PROGRAMS.into_iter().flat_map(|one| unsound(&executors, one)).collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}
