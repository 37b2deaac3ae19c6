//! Runs checks with a planted fault. `must_fail/processes.rs` runs this program.
//!
//! The first argument names the fault. The program prints the message of the check. Its exit code is 0 if the check
//! passes, and isn't 0 if the check finds the fault.

mod jobs;

use std::process::ExitCode;

use glam::Vec3;
use karat::Path;
use karat::check::Agreement;
use karat::prelude::*;
use karat::{Frame, Goldens, Trend};

/// A function whose loop never ends: `sum` is never negative. On llvmpipe, the loop ends after 65,535 iterations, but
/// the body is so long that these iterations take minutes.
fn endless() -> String {
    let body = "sum = sin(sum) + 1.5;\n".repeat(64);
    format!(
        "fn endless(x: f32) -> f32 {{ var sum = x; while sum >= 0.0 {{ {body} }} return sum; }}"
    )
}

/// A shader for a frame in which no two pixels are equal.
const GRADIENT: &str = include_str!("gradient.wgsl");

fn main() -> ExitCode {
    let fault = std::env::args().nth(1).unwrap_or_default();
    let verdict = match fault.as_str() {
        "endless_loop" => check(&endless(), "endless"),
        "too_large" => check("fn above(x: f32) -> f32 { return x + x * x * 0.001; }", "above"),
        "integral" => Ok(integral()),
        "signature" => Ok(signature()),
        "two" => two(),
        // The test starts a thread without a name, so Karat doesn't know the test's name in that thread.
        "in_a_thread" => std::thread::spawn(two).join().expect("no check panics"),
        "one_path" => one_path(),
        "mirrored" => mirrored(),
        "records" => Ok(records()),
        "recorded" => Ok(failures(true)),
        "unrecorded" => Ok(failures(false)),
        "known_issue" => {
            Ok(declared("fn above(x: f32) -> f32 { return x + x * x * 0.001; }", "above"))
        }
        "unexpected_pass" => Ok(declared("fn id(x: f32) -> f32 { return x; }", "id")),
        "kept" => kept(),
        "valid" => Ok(valid("fn id(x: f32) -> f32 { return x; }")),
        "invalid" => Ok(valid("fn id(x: f32) -> f32 { return y; }")),
        "none" => check("fn id(x: f32) -> f32 { return x; }", "id"),
        "golden" => frame(GRADIENT),
        "golden_or_panic" => {
            let package = Package::from_source("gradient", GRADIENT);
            let frame = package.frame("", 32, 16).fullscreen("corners", "gradient");
            let seen = frame.matches(&Goldens::open("nowhere".as_ref()), "gradient");
            Ok(format!("{} paths", seen.paths.len()))
        }
        // The expression isn't constant, because WGSL refuses a constant NaN.
        "nan_frame" => frame(&GRADIENT.replace("0.5, 1.0)", "sqrt(-at.x), 1.0)")),
        "executor" => jobs::serve(),
        "pipe" => jobs::checks(),
        "conform" => jobs::conform(),
        _ => Err(format!("there is no fault `{fault}`")),
    };
    let (code, text) = match verdict {
        Ok(text) => (ExitCode::SUCCESS, text),
        Err(text) => (ExitCode::FAILURE, text),
    };
    eprintln!("{text}");
    code
}

fn check(wgsl: &str, function: &str) -> Result<String, String> {
    Package::from_source("planted", wgsl)
        .function(function)
        .over(0.0..=1.0)
        .unrecorded()
        .try_agrees_with(|x: f64| x, Ulp(0.0))
        .map(|agreement| agreement.to_string())
        .map_err(|failure| failure.to_string())
}

fn valid(wgsl: &str) -> String {
    Package::from_source("planted", wgsl).is_valid().to_string()
}

fn signature() -> String {
    karat::shareable! { struct Pair mirrors PairMirror { b: f32, a: f32 } }
    let wgsl = "struct Pair { a: f32, b: f32 }\nfn f(p: Pair) -> f32 { return p.a; }";
    let package = Package::from_source("planted", wgsl);
    let drawn = (0.0..=1.0, 0.0..=1.0).compose::<Pair>();
    let expected = |p: PairMirror| p.a;
    package.function("f").over(drawn).agrees_with(expected, Ulp(0.0)).to_string()
}

fn two() -> Result<String, String> {
    let package = Package::from_source(
        "planted",
        "fn f(x: f32) -> f32 { return x; }\nfn g(x: f32) -> f32 { return x; }",
    );
    for function in ["f", "g"] {
        package
            .function(function)
            .over(0.0..=1.0)
            .unrecorded()
            .try_agrees_with(|x: f64| x, Ulp(0.0))
            .map_err(|failure| failure.to_string())?;
    }
    Ok("both agree".to_owned())
}

/// Checks a transformation that changes only the first of two cases.
fn mirrored() -> Result<String, String> {
    let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x * x; }");
    let over = package.function("f").over(OneOf(vec![-1.0, 1.0]));
    let found = over.unrecorded().try_invariant_under(f32::abs, Ulp(0.0));
    found.map(|agreement| agreement.to_string()).map_err(|error| error.to_string())
}

/// A check that fails only on the last path. On the other paths, the tolerance is larger than the error.
fn one_path() -> Result<String, String> {
    let wgsl = "fn f(x: f32, n: u32) -> f32 { return select(x, x + 0.5, x > 0.3 && n > 2u); }";
    let package = Package::from_source("planted", wgsl);
    let check = package.function("f").over((0.0..=1.0, Integers(0..=1000_u32)));
    let open = Path::ALL.into_iter().filter(|path| karat::unstable::path::adapter(*path).is_ok());
    let open: Vec<Path> = open.collect();
    let (_, others) = open.split_last().ok_or("no path opens")?;
    let granted = others.iter().fold(check, |check, path| check.tolerance_on(*path, Abs(1.0)));
    granted
        .unrecorded()
        .try_agrees_with(|x: f64, _: u32| x, Ulp(0.0))
        .map(|agreement| agreement.to_string())
        .map_err(|failure| failure.to_string())
}

/// Runs and records three checks that pass: of a function's values, of a sampler, and of a frame.
fn records() -> String {
    let package = Package::from_source("planted", "fn f(u: f32) -> f32 { return u; }");
    package.function("f").over(0.0..=1.0).agrees_with(|x: f64| x, Ulp(0.0));
    let sampled = package.function("f").sampled_over(Just(()), |(), u: f32| u);
    sampled.has_mean("u", |u: f32| f64::from(u), |()| 0.5, 1e-6);
    let pictures = Package::from_source("gradient", GRADIENT);
    let frame = pictures.frame("", 4, 8).fullscreen("corners", "gradient");
    let whole = karat::metric::Rect { left: 0, top: 0, width: 4, height: 8 };
    frame.has_mean(whole, [0.5, 0.5, 0.5], Abs(1e-3));
    "three verdicts".to_owned()
}

/// Runs failing checks of values, an integral, samples, a frame and a pass. If `recorded` is false, the checks aren't
/// recorded.
fn failures(recorded: bool) -> String {
    let wgsl = "fn f(u: f32) -> f32 { return u; }
                @group(0) @binding(0) var<storage, read_write> data: array<u32>;
                @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
    let package = Package::from_source("planted", wgsl);
    let values = package.function("f").over(0.0..=1.0);
    let integral = package.function("f").integral(0.1..=1.0, |c: &f32| vec![(*c, 1.0)]);
    let samples = package.function("f").sampled_over(Just(()), |(), u: f32| u);
    let passes = package.compute().with("data", Storage::new([0_u32])).dispatch("count", [1, 1, 1]);
    let passes = passes.after("data");
    let pictures = Package::from_source("gradient", GRADIENT);
    let frame = pictures.frame("", 4, 8).fullscreen("corners", "gradient");
    let (values, integral, samples, passes, frame) = match recorded {
        true => (values, integral, samples, passes, frame),
        false => (
            values.unrecorded(),
            integral.unrecorded(),
            samples.unrecorded(),
            passes.unrecorded(),
            frame.unrecorded(),
        ),
    };
    let whole = karat::metric::Rect { left: 0, top: 0, width: 4, height: 8 };
    let failures = [
        values.try_agrees_with(|x: f64| x + 1.0, Ulp(0.0)).err().map(|e| e.to_string()),
        integral.try_agrees_with(|_: &f32| 2.0, Rel(1e-6)).err().map(|e| e.to_string()),
        samples
            .try_has_mean("u", |u: f32| f64::from(u), |()| 0.9, 1e-6)
            .err()
            .map(|e| e.to_string()),
        passes.try_agrees_with([8_u32], Abs(0.0)).err().map(|e| e.to_string()),
        frame.try_has_mean(whole, [0.0; 3], Abs(1e-3)).err().map(|e| e.to_string()),
    ];
    format!("{} failures", failures.iter().flatten().count())
}

/// A recorded check that is declared by `fails_on` to fail on every path.
fn declared(wgsl: &str, function: &str) -> String {
    let package = Package::from_source("planted", wgsl);
    let check = package.function(function).over(0.0..=1.0);
    let check = Path::ALL.into_iter().fold(check, |check, path| check.fails_on(path, "bug 1234"));
    check.agrees_with(|x: f64| x, Ulp(0.0)).to_string()
}

/// Checks integrals over ten nodes. An integral is too large if its case is at least one half, so the check panics.
fn integral() -> String {
    let wgsl = "fn above(c: f32, x: f32) -> f32 { return c + 0.001 * step(0.5, c) * x; }";
    let nodes = |c: &f32| (0..10_u8).map(|x| ((*c, f32::from(x)), 0.1)).collect();
    Package::from_source("planted", wgsl)
        .function("above")
        .integral(0.0..=1.0_f32, nodes)
        .agrees_with(|c| f64::from(*c), Rel(1e-6))
        .to_string()
}

/// A check whose failing input Karat keeps for the next run. The program's second argument chooses a variant of the
/// function or of the check, such as `mended`. The check panics if it fails.
fn kept() -> Result<String, String> {
    let change = std::env::args().nth(2).unwrap_or_default();
    let condition = match change.as_str() {
        "mended" => "false",
        "rare" => "bitcast<u32>(x) == 0x3f3b2fecu", // 0.7312
        _ => "x > 0.3 && x < 0.9 && i > 4u",
    };
    let wgsl = format!(
        "fn f(n: vec3f, x: f32, i: u32) -> f32 {{ return select(n.z, 2.0, {condition}); }}"
    );
    let package = Package::from_source("planted", wgsl);
    let integers = || Integers(0..=1000_u32);
    let reference = |n: glam::DVec3, _: f64, _: u32| n.z;
    let agreement = match change.as_str() {
        "mapped" => {
            let domain = (UnitVector, 0.0..=1.0_f32, integers()).map(|(n, x, i)| (-n, x, i));
            package.function("f").over(domain).agrees_with(reference, Ulp(1.0))
        }
        "other_map" => {
            let domain = (UnitVector, 0.0..=0.25_f32, integers()).map(|(n, x, i)| (n, x, i));
            package.function("f").over(domain).agrees_with(reference, Ulp(1.0))
        }
        "narrow" => {
            let domain = (UnitVector, 0.0..=0.25, integers());
            package.function("f").over(domain).agrees_with(reference, Ulp(1.0))
        }
        "caught" => {
            let domain = (UnitVector, 0.0..=1.0, integers());
            return package
                .function("f")
                .over(domain)
                .unrecorded()
                .try_agrees_with(reference, Ulp(1.0))
                .map(|agreement| agreement.to_string())
                .map_err(|failure| failure.to_string());
        }
        "monotone" | "monotone_mended" => monotone(change == "monotone"),
        "turned" | "turned_mended" => turned(change == "turned"),
        "integral" => many_integrals("0.5 * step(0.4, c)", 1.0),
        "integral_mended" => many_integrals("0.0", 1.0),
        "integral_window" => many_integrals("0.5 * step(0.33, c) * step(c, 0.39)", 1.0),
        "integral_rare" => many_integrals("select(0.0, 0.5, c == 0.36)", 1.0),
        "integral_elsewhere" => many_integrals("0.0", 0.25),
        "signature" => {
            let package = Package::from_source("planted", "fn f(x: f32) -> f32 { return x; }");
            package.function("f").over(0.0..=1.0).agrees_with(|x: f64| x, Ulp(1.0))
        }
        _ => {
            let domain = (UnitVector, 0.0..=1.0, integers());
            package.function("f").over(domain).agrees_with(reference, Ulp(1.0))
        }
    };
    Ok(agreement.to_string())
}

/// Checks a function that rises with `x`. The faulty function has a step down at 0.6 if `a` is above 0.3.
fn monotone(fault: bool) -> Agreement {
    let step = if fault { "x > 0.6 && a > 0.3" } else { "false" };
    let wgsl = format!("fn f(x: f32, a: f32) -> f32 {{ return x - select(0.0, 3.0, {step}); }}");
    let package = Package::from_source("planted", &wgsl);
    let over = package.function("f").over((0.0..=1.0, 0.0..=1.0));
    over.is_monotone_in("x", Trend::Increasing, Ulp(1.0))
}

/// Checks a function that returns the direction `d` unchanged. The faulty function swaps components of `d` if `a` is
/// above 0.3.
fn turned(fault: bool) -> Agreement {
    let swapped = if fault { "d.yxz" } else { "d" };
    let wgsl = format!(
        "fn f(d: vec3f, a: f32) -> vec3f {{ return select(d, {swapped}, a > 0.3 && d.z > 0.1); }}"
    );
    let package = Package::from_source("planted", &wgsl);
    package.function("f").over((UnitVector, 0.0..=1.0)).equivariant_under(
        |(d, a), q| ((q * d.as_dvec3()).as_vec3(), a),
        |d: Vec3, q| q * d.as_dvec3(),
        Abs(1e-5),
    )
}

/// Checks integrals whose cases are strings instead of numbers.
fn many_integrals(excess: &str, end: f32) -> Agreement {
    let wgsl = format!("fn f(c: f32, x: f32) -> f32 {{ return c + {excess}; }}");
    let package = Package::from_source("planted", &wgsl);
    let cases = (0.0..=end).map(|c| format!("{c:?}"));
    let number = |c: &String| c.parse::<f32>().expect("a number");
    let nodes = move |c: &String| (0..10_u8).map(|x| ((number(c), f32::from(x)), 0.1)).collect();
    let integral = package.function("f").integral(cases, nodes);
    integral.agrees_with(move |c| f64::from(number(c)), Abs(1e-6))
}

fn frame(wgsl: &str) -> Result<String, String> {
    let folder = std::env::args().nth(2).ok_or("name the folder of goldens")?;
    let package = Package::from_source("gradient", wgsl);
    let frame: Frame<'_> =
        package.frame("", 32, 16).fullscreen("corners", "gradient").tolerance(1e-3);
    frame
        .unrecorded()
        .try_matches(&Goldens::open(folder.as_ref()), "gradient")
        .map(|agreement| format!("{agreement:?}"))
        .map_err(|error| error.to_string())
}
