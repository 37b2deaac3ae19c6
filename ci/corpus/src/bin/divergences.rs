//! Lists the expressions for which a driver, or a translation that naga wrote, violates WGSL.
//!
//! `cargo run --bin divergences -- docs/divergences` tests each operator and builtin function on each path of
//! `KARAT_PATHS`, and writes a page for each path and driver. The pages of drivers that this machine lacks stay
//! unchanged. On a path such as `vulkan:glsl` the driver runs one of naga's translations. `cargo ci divergences` runs
//! the program.

use std::collections::BTreeMap;
use std::f32::consts::PI;
use std::fmt::Write as _;
use std::path::Path;
use std::process::ExitCode;

use glam::{DVec2, DVec3, Vec2};
use karat::check::{Agreement, Failure};
use karat::domain::{Integers, OneOf};
use karat::prelude::*;
use karat::unstable::check::{CaseFailure, PathDisagreement};
use karat::unstable::path::Adapter;
use karat::unstable::tolerance::SpecTolerance;
use karat::unstable::value::Scalar;

/// A WGSL expression to test, such as `x + y` or `sin(x)`, and the check that tests it.
struct Question {
    expression: &'static str,
    source: &'static str,
    ask: fn(&Package) -> Result<Agreement, Failure>,
}

/// The result of testing a [`Question`] on a path.
enum Answer {
    Agrees,
    Differs(Box<PathDisagreement>),
    /// The path returned no value. The text says why.
    Stopped(String),
}

/// Returns a tolerance that accepts each result within WGSL's bounds (section 15.7.4). If these bounds allow an
/// absolute error above 1, the case fails, because the bounds are too wide for a useful test.
fn within() -> SpecTolerance {
    Spec.needing(Abs(1.0))
}

const EXACTLY: Ulp = Ulp(0.0);

/// Integers that show off-by-one errors and wrong signs.
fn edges() -> OneOf<i32> {
    OneOf(vec![
        i32::MIN,
        i32::MIN + 1,
        -31,
        -3,
        -2,
        -1,
        0,
        1,
        2,
        3,
        31,
        32,
        33,
        i32::MAX - 1,
        i32::MAX,
    ])
}

fn unsigned_edges() -> OneOf<u32> {
    OneOf(vec![0, 1, 2, 3, 31, 32, 33, 0x7fff_ffff, 0x8000_0000, u32::MAX - 1, u32::MAX])
}

macro_rules! questions {
    ($($expression:literal, ($($name:ident: $type:ty),+) -> $result:ty, $domain:expr, $reference:expr, $bound:expr;)+) => {
        &[$(Question {
            expression: $expression,
            source: concat!(
                "fn f(", $(stringify!($name), ": ", stringify!($type), ", ",)+ ") -> ",
                stringify!($result), " { return ", $expression, "; }"
            ),
            ask: |package| {
                package.function("f").over($domain).cases(16384).unrecorded().try_agrees_with($reference, $bound)
            },
        }),+]
    };
}

/// The tested expressions. The domain of each expression has only arguments for which WGSL bounds the error of the
/// result. For example, the domain of `sin` and `cos` is -pi to pi. The domains of `asin` and `acos` stay away from 0
/// and 1: WGSL defines the error bounds of both functions through `atan2` of `x` and `sqrt(1 - x * x)`, and has no
/// bound for `atan2` if an argument is 0.
const QUESTIONS: &[Question] = questions! {
    "x + y", (x: f32, y: f32) -> f32, (-1e3..=1e3, -1e3..=1e3), |x: f64, y: f64| x + y, within();
    "x - y", (x: f32, y: f32) -> f32, (-1e3..=1e3, -1e3..=1e3), |x: f64, y: f64| x - y, within();
    "x * y", (x: f32, y: f32) -> f32, (-1e3..=1e3, -1e3..=1e3), |x: f64, y: f64| x * y, within();
    "x / y", (x: f32, y: f32) -> f32, (-1.0..=1.0, 1e-2..=1e3), |x: f64, y: f64| x / y, within();
    "(x - y) * z", (x: f32, y: f32, z: f32) -> f32, (0.0..=8.0, 0.0..=8.0, 0.5..=4.0),
        |x: f64, y: f64, z: f64| (x - y) * z, within();
    "-x", (x: f32) -> f32, -1e3..=1e3, |x: f64| -x, EXACTLY;
    "abs(x)", (x: f32) -> f32, -1e3..=1e3, |x: f64| x.abs(), EXACTLY;
    "sign(x)", (x: f32) -> f32, -1e3..=1e3, |x: f64| if x == 0.0 { 0.0 } else { x.signum() }, EXACTLY;
    "floor(x)", (x: f32) -> f32, -1e3..=1e3, f64::floor, EXACTLY;
    "ceil(x)", (x: f32) -> f32, -1e3..=1e3, f64::ceil, EXACTLY;
    "trunc(x)", (x: f32) -> f32, -1e3..=1e3, f64::trunc, EXACTLY;
    "round(x)", (x: f32) -> f32, Integers(-4000..=4000).map(|eighths: i32| eighths as f32 / 8.0), f64::round_ties_even, EXACTLY;
    "fract(x)", (x: f32) -> f32, -1e3..=1e3, |x: f64| x - x.floor(), within();
    "min(x, y)", (x: f32, y: f32) -> f32, (-1e3..=1e3, -1e3..=1e3), f64::min, EXACTLY;
    "max(x, y)", (x: f32, y: f32) -> f32, (-1e3..=1e3, -1e3..=1e3), f64::max, EXACTLY;
    "saturate(x)", (x: f32) -> f32, -2.0..=2.0, |x: f64| x.clamp(0.0, 1.0), EXACTLY;
    "step(x, y)", (x: f32, y: f32) -> f32, (-1.0..=1.0, -1.0..=1.0), |x: f64, y: f64| f64::from(u8::from(x <= y)),
        EXACTLY;
    "sqrt(x)", (x: f32) -> f32, 1e-6..=1e6, f64::sqrt, within();
    "inverseSqrt(x)", (x: f32) -> f32, 1e-6..=1e6, |x: f64| x.sqrt().recip(), within();
    "exp(x)", (x: f32) -> f32, -10.0..=10.0, f64::exp, within();
    "exp2(x)", (x: f32) -> f32, -10.0..=10.0, f64::exp2, within();
    "log(x)", (x: f32) -> f32, 1e-6..=1e6, f64::ln, within();
    "log2(x)", (x: f32) -> f32, 1e-6..=1e6, f64::log2, within();
    "pow(x, y)", (x: f32, y: f32) -> f32, (0.1..=10.0, -2.0..=2.0), f64::powf, within();
    "sin(x)", (x: f32) -> f32, -PI..=PI, f64::sin, within();
    "cos(x)", (x: f32) -> f32, -PI..=PI, f64::cos, within();
    "tan(x)", (x: f32) -> f32, -1.0..=1.0, f64::tan, within();
    "asin(x)", (x: f32) -> f32, 1e-3..=0.99, f64::asin, within();
    "acos(x)", (x: f32) -> f32, 1e-3..=0.99, f64::acos, within();
    "atan(x)", (x: f32) -> f32, -1e3..=1e3, f64::atan, within();
    "atan2(y, x)", (y: f32, x: f32) -> f32, (1e-2..=1e3, 1e-2..=1e3), f64::atan2, within();
    "sinh(x)", (x: f32) -> f32, -5.0..=5.0, f64::sinh, within();
    "cosh(x)", (x: f32) -> f32, -5.0..=5.0, f64::cosh, within();
    "tanh(x)", (x: f32) -> f32, -5.0..=5.0, f64::tanh, within();
    "asinh(x)", (x: f32) -> f32, -1e2..=1e2, f64::asinh, within();
    "acosh(x)", (x: f32) -> f32, 1.0..=1e2, f64::acosh, within();
    "atanh(x)", (x: f32) -> f32, -0.9..=0.9, f64::atanh, within();
    "fma(x, y, z)", (x: f32, y: f32, z: f32) -> f32, (-8.0..=8.0, -8.0..=8.0, -8.0..=8.0), f64::mul_add, within();
    "ldexp(x, n)", (x: f32, n: i32) -> f32, (-8.0..=8.0, Integers(-100..=100)), |x: f64, n: i32| x * f64::from(n).exp2(),
        within();
    "modf(x).fract", (x: f32) -> f32, -1e3..=1e3, |x: f64| x.fract(), EXACTLY;
    "frexp(x).exp", (x: f32) -> i32, 1e-3..=1e3, |x: f64| x.log2().floor() as i32 + 1, EXACTLY;
    "mix(x, y, a)", (x: f32, y: f32, a: f32) -> f32, (-8.0..=8.0, -8.0..=8.0, 0.0..=1.0),
        |x: f64, y: f64, a: f64| x * (1.0 - a) + y * a, within();
    "mix(x, y, 1.0)", (x: f32, y: f32) -> f32, (1.0..=50.0, 1e-4..=1.0), |_: f64, y: f64| y, within();
    "smoothstep(0.0, 1.0, x)", (x: f32) -> f32, -0.5..=1.5, |x: f64| { let t = x.clamp(0.0, 1.0); t * t * (3.0 - 2.0 * t) },
        within();
    "length(v)", (v: vec3f) -> f32, UnitVector, |v: DVec3| v.length(), within();
    "dot(v, w)", (v: vec3f, w: vec3f) -> f32, (UnitVector, UnitVector), |v: DVec3, w: DVec3| v.dot(w), within();
    "cross(v, w)", (v: vec3f, w: vec3f) -> vec3f, (UnitVector, UnitVector), |v: DVec3, w: DVec3| v.cross(w), within();
    "normalize(v)", (v: vec3f) -> vec3f, UnitVector, |v: DVec3| v.normalize(), within();
    "reflect(v, w)", (v: vec3f, w: vec3f) -> vec3f, (UnitVector, UnitVector), |v: DVec3, w: DVec3| v - 2.0 * w.dot(v) * w,
        within();
    "i32(x)", (x: f32) -> i32, OneOf(vec![0.0, -0.9, 0.9, -1.5, 1.5, 3e9, -3e9, 1e20, 2_147_483_500.0]),
        // The result is the nearest integer in range, section 15.7.6. The largest `f32` in range is 2147483520.
        |x: f64| x.clamp(-2_147_483_648.0, 2_147_483_520.0).trunc() as i32, EXACTLY;
    "u32(x)", (x: f32) -> u32, OneOf(vec![0.0, -1.0, 0.9, 1.5, 3e9, 5e9, -1e20, 1e20]),
        |x: f64| x.clamp(0.0, 4_294_967_040.0).trunc() as u32, EXACTLY;
    "f32(a)", (a: i32) -> f32, Integers(i32::MIN..=i32::MAX), |a: i32| f64::from(a), Ulp(1.0);
    "a + b", (a: i32, b: i32) -> i32, (edges(), edges()), i32::wrapping_add, EXACTLY;
    "a * b", (a: i32, b: i32) -> i32, (edges(), edges()), i32::wrapping_mul, EXACTLY;
    "-a", (a: i32) -> i32, edges(), i32::wrapping_neg, EXACTLY;
    // Division by 0, and of the smallest integer by -1, gives the dividend, and the remainder is 0: section 8.7.
    "a / b", (a: i32, b: i32) -> i32, (edges(), edges()), |a: i32, b: i32| a.checked_div(b).unwrap_or(a), EXACTLY;
    "a % b", (a: i32, b: i32) -> i32, (edges(), edges()), |a: i32, b: i32| a.checked_rem(b).unwrap_or(0), EXACTLY;
    "u / w", (u: u32, w: u32) -> u32, (unsigned_edges(), unsigned_edges()),
        |a: u32, b: u32| a.checked_div(b).unwrap_or(a), EXACTLY;
    "u % w", (u: u32, w: u32) -> u32, (unsigned_edges(), unsigned_edges()),
        |a: u32, b: u32| a.checked_rem(b).unwrap_or(0), EXACTLY;
    // The shift amount is taken modulo 32: section 8.9.
    "a << n", (a: i32, n: u32) -> i32, (edges(), unsigned_edges()), i32::wrapping_shl, EXACTLY;
    "a >> n", (a: i32, n: u32) -> i32, (edges(), unsigned_edges()), i32::wrapping_shr, EXACTLY;
    "abs(a)", (a: i32) -> i32, edges(), i32::wrapping_abs, EXACTLY;
    "countLeadingZeros(a)", (a: u32) -> u32, unsigned_edges(), u32::leading_zeros, EXACTLY;
    "countTrailingZeros(a)", (a: u32) -> u32, unsigned_edges(), u32::trailing_zeros, EXACTLY;
    "firstLeadingBit(a)", (a: i32) -> i32, edges(),
        |a: i32| 31 - (if a < 0 { !a } else { a }).leading_zeros() as i32, EXACTLY;
    "firstTrailingBit(a)", (a: u32) -> u32, unsigned_edges(),
        |a: u32| if a == 0 { u32::MAX } else { a.trailing_zeros() }, EXACTLY;
    "reverseBits(a)", (a: u32) -> u32, unsigned_edges(), u32::reverse_bits, EXACTLY;
    "extractBits(a, o, n)", (a: i32, o: u32, n: u32) -> i32, (edges(), unsigned_edges(), unsigned_edges()),
        extracted, EXACTLY;
    "insertBits(a, b, o, n)", (a: u32, b: u32, o: u32, n: u32) -> u32,
        (unsigned_edges(), unsigned_edges(), unsigned_edges(), unsigned_edges()), inserted, EXACTLY;
    "dot4I8Packed(a, b)", (a: u32, b: u32) -> i32, (Integers(0..=u32::MAX), Integers(0..=u32::MAX)),
        |a: u32, b: u32| bytes(a).zip(bytes(b)).map(|(a, b)| a * b).sum::<i32>(), EXACTLY;
    "unpack2x16float(pack2x16float(v))", (v: vec2f) -> vec2f, OneOf(vec![Vec2::new(1.0, -0.5), Vec2::new(0.25, 1024.0)]),
        |v: DVec2| v, EXACTLY;
};

/// Computes `extractBits` (section 17.5 of WGSL): `count` bits of `a`, from bit `offset` on. The highest extracted bit
/// is the sign of the result.
fn extracted(a: i32, offset: u32, count: u32) -> i32 {
    let offset = offset.min(32);
    match count.min(32 - offset) {
        0 => 0,
        count => a << (32 - count - offset) >> (32 - count),
    }
}

/// Computes `insertBits` (section 17.5 of WGSL): replaces `count` bits of `a`, from bit `offset` on, by the lowest bits
/// of `b`.
fn inserted(a: u32, b: u32, offset: u32, count: u32) -> u32 {
    let offset = offset.min(32);
    match count.min(32 - offset) {
        0 => a,
        count => {
            let mask = u32::MAX >> (32 - count) << offset;
            a & !mask | b << offset & mask
        }
    }
}

/// The four bytes of a `u32` as signed integers, the lowest byte first.
fn bytes(word: u32) -> impl Iterator<Item = i32> {
    word.to_le_bytes().into_iter().map(|byte| i32::from(byte.cast_signed()))
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder] = &*arguments else {
        eprintln!("error: name a folder for the pages: `divergences docs/divergences`");
        return ExitCode::from(2);
    };
    match write_all(Path::new(folder)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

/// For each path, its adapter and its answers, in the order of [`QUESTIONS`].
type Answers = BTreeMap<String, (Adapter, Vec<Answer>)>;

fn write_all(folder: &Path) -> Result<(), String> {
    let mut all = Answers::new();
    for question in QUESTIONS {
        let package = Package::from_source("asked", question.source);
        for (adapter, answer) in answers((question.ask)(&package), question)? {
            all.entry(adapter.path.clone()).or_insert_with(|| (adapter, Vec::new())).1.push(answer);
        }
    }
    std::fs::create_dir_all(folder).map_err(|error| format!("`{}`: {error}", folder.display()))?;
    for (adapter, answers) in all.into_values() {
        if answers.len() != QUESTIONS.len() {
            return Err(format!(
                "{adapter} answered {} questions of {}",
                answers.len(),
                QUESTIONS.len()
            ));
        }
        let name = format!(
            "{}-{}.md",
            adapter.path.split('@').next().unwrap_or_default().replace(':', "-"),
            adapter.family()
        );
        let file = folder.join(name);
        if adapter.family() == "karat"
            && answers.iter().any(|answer| !matches!(answer, Answer::Agrees))
        {
            return Err(format!(
                "the engine isn't WGSL's any more\n\n{}",
                page(&adapter, &answers)
            ));
        }
        std::fs::write(&file, page(&adapter, &answers))
            .map_err(|error| format!("`{}`: {error}", file.display()))?;
    }
    Ok(())
}

/// Converts the result of a check into an answer for each path. Wrong results and errors on a path become answers. For
/// any other failure of the check, returns an error.
fn answers(
    asked: Result<Agreement, Failure>,
    question: &Question,
) -> Result<Vec<(Adapter, Answer)>, String> {
    let agree = |adapter: Adapter| (adapter, Answer::Agrees);
    match asked {
        Ok(agreement) => {
            Ok(agreement.paths.into_iter().map(|(adapter, _)| agree(adapter)).collect())
        }
        Err(Failure::Disagreement(found)) => {
            let differ = found
                .paths
                .into_iter()
                .map(|path| (path.adapter.clone(), Answer::Differs(Box::new(path))));
            Ok(differ
                .chain(found.agreeing.into_iter().map(|(adapter, _)| agree(adapter)))
                .collect())
        }
        Err(Failure::Paths(paths)) => {
            let mut all = Vec::new();
            for failure in paths.failures {
                all.extend(answers(Err(failure), question)?);
            }
            let stopped = paths.stopped.into_iter();
            all.extend(
                stopped.map(|(adapter, error)| (adapter, Answer::Stopped(first_line(&error)))),
            );
            all.extend(paths.agreeing.into_iter().map(agree));
            Ok(all)
        }
        Err(other) => Err(format!("`{}`: {other}", question.expression)),
    }
}

fn first_line(error: &Failure) -> String {
    error.to_string().lines().next().unwrap_or_default().to_owned()
}

fn page(adapter: &Adapter, answers: &[Answer]) -> String {
    let differ = answers.iter().filter(|answer| !matches!(answer, Answer::Agrees)).count();
    let mut page = format!(
        "# `{}` on {}\n\n{}. It computes {differ} of {} \
         expressions otherwise than WGSL says, or not at all; `cargo ci divergences` asked. [About these pages](README.md)\n",
        adapter.path,
        adapter.name,
        adapter.driver,
        answers.len()
    );
    if differ > 0 {
        page.push_str("\n| expression | cases | for | returned | WGSL |\n|---|---:|---|---|---|\n");
    }
    for (question, answer) in QUESTIONS.iter().zip(answers) {
        let row = match answer {
            Answer::Agrees => continue,
            Answer::Stopped(why) => format!("0 | | | {} ", why.replace('|', "\\|")),
            Answer::Differs(path) => row(path),
        };
        // Writing to a `String` can't fail.
        let _ = writeln!(page, "| `{}` | {row}|", question.expression);
    }
    page
}

/// Returns the table cells for an expression that a path computes wrongly: the share of wrong cases, and the arguments,
/// the result and the allowed values of the simplest wrong case.
fn row(path: &PathDisagreement) -> String {
    let case = path.simplest.as_ref().map_or(&path.worst, |simplest| &simplest.failure);
    let share = 100.0 * path.census.failures as f64 / path.census.cases as f64;
    let arguments: Vec<String> =
        case.arguments.iter().map(|(name, value)| format!("{name} = {value}")).collect();
    format!("{share:.1} % | {} | {} | {} ", arguments.join(", "), case.result, wanted(case))
}

/// Returns the values that WGSL allows for a case, as text.
fn wanted(case: &CaseFailure) -> String {
    let allowed = case.explanation.iter().find(|(name, _)| *name == "WGSL");
    match (allowed, case.scalar, case.expected) {
        (Some((_, allowed)), Scalar::F32, _) => allowed.clone(),
        (_, _, Some(expected)) => format!("{expected}"),
        (_, _, None) => String::new(),
    }
}
