//! WGSL's accuracy as a tolerance (`Spec`), and the messages of checks that fail.

use karat::Path;
use karat::check::Failure;
use karat::prelude::*;
use karat::unstable::check::{Census, Disagreement, Vacuous};
use karat::unstable::domain::{Dynamic, Part};
use karat::unstable::executor::{self, Executor};
use karat::unstable::path::Adapter;
use karat::unstable::probe::{Call, Prepared, ProbeError, Probed, Started};
use karat::unstable::tolerance::Criterion;
use karat::unstable::value::{Scalar, Shape};

fn package(text: &str) -> Package {
    Package::from_source("spec", text)
}

/// Checks the function `f`, with an argument from 0 to 1, on a [`Driver`] that multiplies correctly.
fn check(
    text: &str,
    reference: impl Fn(f64) -> f64 + Sync,
    criterion: impl Into<Criterion>,
) -> Result<karat::check::Agreement, Failure> {
    check_on(&Driver { factor: 1.0 }, text, reference, criterion)
}

fn check_on(
    driver: &dyn Executor,
    text: &str,
    reference: impl Fn(f64) -> f64 + Sync,
    criterion: impl Into<Criterion>,
) -> Result<karat::check::Agreement, Failure> {
    let package = package(text);
    package
        .function("f")
        .on(driver)
        .over(0.0..=1.0)
        .cases(4096)
        .unrecorded()
        .try_agrees_with(|x: f64| reference(x), criterion)
}

fn disagreement(result: Result<karat::check::Agreement, Failure>) -> Box<Disagreement> {
    match result {
        Err(Failure::Disagreement(disagreement)) => disagreement,
        other => panic!("{other:?}"),
    }
}

fn census(result: Result<karat::check::Agreement, Failure>) -> Census {
    disagreement(result).paths[0].census
}

/// A driver that multiplies by `3 * factor` where the function `f` multiplies by 3.
#[derive(Debug)]
struct Driver {
    factor: f32,
}

#[derive(Debug)]
struct Ready {
    factor: f32,
    /// The text of the kernel, which names the value that the driver must compute: the result of `f`, or one of its
    /// `let`s.
    name: String,
}

impl Executor for Driver {
    fn path(&self) -> Path {
        "cpu@fake".parse().expect("a name")
    }

    fn adapter(&self) -> Adapter {
        let [path, name, driver] = ["cpu@fake", "Fake", "1"].map(str::to_owned);
        Adapter { path, name, driver, software: true }
    }

    fn prepare<'e>(&'e self, call: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
        let name = call.probed.kernel().to_owned();
        Ok(Box::new(Ready { factor: self.factor, name }))
    }
}

impl Prepared for Ready {
    fn capacity(&self) -> usize {
        4096
    }

    /// Computes the result of the WGSL function `f`: `(3 x) (3 x)`. If the kernel returns a `let` of `f`, computes the
    /// value of this `let`.
    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
        let is_of = |binding: &str| self.name.contains(&format!("karat_let = {binding};"));
        let (same, thrice) = (is_of("same"), is_of("thrice"));
        let one = |row: &[u32]| {
            let x = f32::from_bits(row[0]);
            let product = 3.0 * self.factor * x;
            let value = match () {
                () if same => x,
                () if thrice => product,
                () => product * product,
            };
            value.to_bits()
        };
        let words: Vec<u32> = arguments.chunks(arguments.len() / cases).map(one).collect();
        Ok(Box::new(move |read| {
            read(&words, 1);
            Ok(())
        }))
    }
}

const SQUARE: &str = "fn f(x: f32) -> f32 {\n    let same = x;\n    let thrice = same * 3.0;\n    \
                      return thrice * thrice;\n}\n";

#[test]
fn results_within_the_wgsl_bound_pass() {
    let agreement = check(SQUARE, |x| 9.0 * x * x, Spec).expect("it agrees");
    assert_eq!(agreement.cases, 4096);
    assert!(agreement.worst.ratio < 0.01, "a few steps of f32 are allowed: {agreement}");
}

// Lesson 90
#[test]
fn the_census_separates_shader_and_driver() {
    let shader = census(check(SQUARE, |x| 9.001 * x * x, Spec));
    assert!(shader.shader > 3000 && shader.driver == 0, "{shader:?}");

    let wrong = check_on(&Driver { factor: 1.00001 }, SQUARE, |x| 9.0 * x * x, Spec);
    let driver = census(wrong);
    assert!(driver.driver > 3000 && driver.shader == 0, "{driver:?}");

    // The shader loses the digits of a small x in 1 - (1 - x). The reference doesn't.
    let cancels = "fn f(x: f32) -> f32 { let y = 1.0 - x * 1e-4; return (1.0 - y) * 90000.0 * x; }";
    let ill = census(check(cancels, |x| 9.0 * x * x, Spec));
    assert!(ill.ill_conditioned > 1000 && ill.driver == 0, "{ill:?}");

    let unbounded = "fn f(x: f32) -> f32 { return 9.0 * x * x + 0.0 * sin(40.0 + x); }";
    let unbounded = census(check(unbounded, |x| 9.0 * x * x, Spec));
    assert_eq!(unbounded.unbounded, 4096, "{unbounded:?}");
}

#[test]
fn where_wgsl_allows_too_much_another_tolerance_holds() {
    // WGSL bounds neither log2(0) nor pow(0, y).
    let pow = "fn f(x: f32) -> f32 { return 9.0 * pow(x, 2.0); }";
    let census = census(check(pow, |x| 9.0 * x * x, Spec));
    assert!(census.unbounded > 0 && census.unbounded < 2000, "{census:?}");
    check(pow, |x| 9.0 * x * x, Spec.or(Abs(1e-3))).expect("0 is right there");
    // A value outside the bound fails also with a second tolerance.
    let wrong = check_on(&Driver { factor: 1.1 }, SQUARE, |x| 9.0 * x * x, Spec.or(Abs(100.0)));
    assert!(self::census(wrong).driver > 3000);
    // `needing(Rel(0.5))` accepts any bound that is narrower than half of the result.
    let coarse = "fn f(x: f32) -> f32 { let y = 3.0 * x; return y * y + 0.0 * x * sin(x); }";
    check(coarse, |x| 9.0 * x * x, Spec.needing(Rel(0.5))).expect("it is that close");
}

/// A check with `Spec` reports an error if WGSL gives no bound in any of the cases.
// Lesson 90
#[test]
fn a_specification_that_judges_nothing_is_an_error() {
    let unbounded = "fn f(x: f32) -> f32 { return 9.0 * x * x + 0.0 * sin(40.0 + x); }";
    match check(unbounded, |x| 9.0 * x * x, Spec.or(Abs(1.0))) {
        Err(Failure::Domain { reason, .. }) => assert_eq!(*reason, Vacuous::Ungranted),
        other => panic!("{other:?}"),
    }
}

/// A function with sines of large angles. WGSL gives no bound for the error of such sines.
const WAVE: &str = "fn f(x: f32) -> f32 { return 0.5 * sin(4.0 + 40.0 * x); }";

// Lesson 92
#[test]
fn an_adapter_is_as_exact_as_it_was_measured() {
    let check = |text: &str, reference: fn(f64) -> f64, criterion: Criterion| {
        let package = package(text);
        package
            .function("f")
            .over(0.0..=1.0)
            .cases(4096)
            .unrecorded()
            .try_agrees_with(reference, criterion)
    };
    let wave = |x: f64| 0.5 * (4.0 + 40.0 * x).sin();
    let unbounded = disagreement(check(WAVE, wave, Spec.into()));
    assert!(unbounded.paths[0].census.unbounded > 3000, "{unbounded}");
    // The rounding of the angle has the largest effect where the sine is near 0.
    let need = DeviceSpec.needing(Rel(1e-3)).or(Abs(1e-4));
    let agreement = check(WAVE, wave, need.clone().into()).expect("it agrees");
    assert_eq!(agreement.cases, 4096);
    // This reference is wrong by more than the error of any measured adapter.
    let off = |x: f64| 0.5 * (4.0 + 40.0 * x).sin() + 1e-2;
    let wrong = disagreement(check(WAVE, off, DeviceSpec.needing(Abs(1e-3)).into()));
    assert!(wrong.paths[0].census.shader > 2000, "{wrong}");
    // WGSL doesn't bound pow(0, 5). On a measured adapter each such power is 0.
    let pow = "fn f(x: f32) -> f32 { return pow(x, 5.0); }";
    if let Err(failure) = check(pow, |x| x.powi(5), DeviceSpec.into()) {
        let census = &disagreement(Err(failure)).paths[0].census;
        assert_eq!((census.shader, census.driver, census.nan), (0, 0, 0), "another isn't wrong");
    }
    assert!(check(pow, |x| x.powi(5), Spec.into()).is_err(), "0 is a case");
}

/// If a result is outside the bounds of `DeviceSpec`, the message says that the driver is less exact for this function
/// than in Karat's measurement.
// Lesson 92
#[test]
fn results_below_the_measured_accuracy_are_reported() {
    let text = "fn f(x: f32) -> f32 {\n    return (3.0 * x) * (3.0 * x);\n}\n";
    let wrong = check_on(&Driver { factor: 1.00001 }, text, |x| 9.0 * x * x, DeviceSpec);
    let wrong = disagreement(wrong);
    assert!(wrong.paths[0].census.driver > 3000, "{wrong}");
    let text = wrong.to_string();
    assert!(text.contains("the driver is less exact here than Karat measured"), "{text}");
}

/// A failing check compares the result with WGSL's bounds, even if its tolerance isn't `Spec`, and prints the first
/// `let` whose value is outside of its bound.
#[test]
fn the_first_binding_that_leaves_what_is_allowed_is_blamed() {
    let result = check_on(&Driver { factor: 1.01 }, SQUARE, |x| 9.0 * x * x, Rel(1e-4));
    let text = disagreement(result).to_string();
    assert!(text.contains("this path's result isn't allowed"), "{text}");
    assert!(
        text.contains(
            "blame = `thrice` (<spec>:3:9) is the first value outside of WGSL's bounds: 3.03"
        ),
        "{text}"
    );
    let result = check(SQUARE, |x| 9.01 * x * x, Rel(1e-4));
    let text = disagreement(result).to_string();
    assert!(
        text.contains("the reference isn't in this range: this code computes something else"),
        "{text}"
    );
    let unbounded = "fn f(x: f32) -> f32 { return 8.0 * x * x + 0.0 * pow(x - 1.0, 5.0); }";
    let text = disagreement(check(unbounded, |x| 9.1 * x * x, Rel(1e-4))).to_string();
    assert!(text.contains("allows anything: no bounds exist for `pow(x - 1.0, 5.0)`"), "{text}");
}

/// A driver that returns a constant.
#[derive(Debug)]
struct Returns(f32);

impl Executor for Returns {
    fn path(&self) -> Path {
        "cpu@fake".parse().expect("a name")
    }

    fn adapter(&self) -> Adapter {
        Driver { factor: 1.0 }.adapter()
    }

    fn prepare<'e>(&'e self, _: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
        Ok(Box::new(Self(self.0)))
    }
}

impl Prepared for Returns {
    fn capacity(&self) -> usize {
        4096
    }

    fn start<'p>(&'p self, cases: usize, _: &[u32]) -> Result<Started<'p>, ProbeError> {
        let words = vec![self.0.to_bits(); cases];
        Ok(Box::new(move |read| {
            read(&words, 1);
            Ok(())
        }))
    }
}

/// The two neighbouring floats below and above the exact sum. WGSL allows either float as the result.
fn rounded(exact: f64) -> [f32; 2] {
    let nearest = exact as f32;
    match f64::from(nearest).partial_cmp(&exact) {
        Some(std::cmp::Ordering::Less) => [nearest, nearest.next_up()],
        Some(std::cmp::Ordering::Greater) => [nearest.next_down(), nearest],
        _ => [nearest; 2],
    }
}

/// The sum of three terms passes in each order of addition. A result fails if it is one ULP below the smallest or above
/// the largest of these sums.
// Lesson 168: a result one ULP beyond fails
#[test]
fn a_sum_of_three_terms_passes_in_any_order_of_addition() {
    let numbers = [0.1_f32, 1.0, -1.0, 3.3, 1e-3, -7.25, 16_777_216.0, 1e-7, -0.99];
    let package = package("fn f(x: f32, y: f32, z: f32) -> f32 { return (x + y) + z; }");
    let mut beyond = 0;
    for (k, x) in numbers.into_iter().enumerate() {
        let (y, z) = (numbers[(k * 2 + 1) % 9], numbers[(k * 5 + 3) % 9]);
        let mut orders = Vec::new();
        for (a, b, c) in [(x, y, z), (x, z, y), (y, z, x)] {
            for inner in rounded(f64::from(a) + f64::from(b)) {
                orders.extend(rounded(f64::from(inner) + f64::from(c)));
            }
        }
        let least = orders.iter().copied().fold(f32::INFINITY, f32::min);
        let most = orders.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let returns = |value: f32| {
            let driver = Returns(value);
            let check = package.function("f").on(&driver).over((Just(x), Just(y), Just(z)));
            // Floats near 16,777,216 are 2 apart.
            check
                .unrecorded()
                .try_agrees_with(|x: f64, y: f64, z: f64| x + y + z, Spec.needing(Abs(16.0)))
        };
        for value in orders {
            returns(value).expect("an order gives it");
        }
        for value in [least.next_down(), most.next_up()] {
            let census = census(returns(value));
            assert!(census.driver > 0 && census.driver == census.failures, "{census:?}");
            beyond += 1;
        }
    }
    assert_eq!(beyond, 18);
}

/// If a product overflows when its factors are multiplied in an order other than the written one, WGSL allows any
/// result. The message says so.
// Lesson 168: overflow is reported
#[test]
fn an_order_that_overflows_is_named() {
    let text = "fn f(x: f32) -> f32 {\n    return x * 1e-30 * 1e25 * 1e20;\n}\n";
    let found = disagreement(check_on(&Returns(1.0), text, |x| x * 1e15, Spec));
    let census = found.paths[0].census;
    assert!(census.unbounded > 4000 && census.driver == 0, "{census:?}");
    let message = found.to_string();
    assert!(message.contains("(<spec>:2:12) has bounds, but WGSL (15.7.5)"), "{message}");
    assert!(
        message.contains("WGSL allows any result") && !message.contains("is wrong"),
        "{message}"
    );
}

/// Each function agrees with a reference that computes the same expression. Mesa's compilers add the terms of some of
/// these functions in another order.
// Lesson 168: each order of terms lies within the bound
#[test]
fn a_function_agrees_with_itself_in_any_order() {
    let one = |text: &str, reference: fn(f64) -> f64| {
        let package = package(&format!("fn f(y: f32) -> f32 {{ {text} }}"));
        let spec = Spec.or(Abs(1e-5));
        package.function("f").over(0.0..=1.0).cases(4096).agrees_with(reference, spec);
    };
    one("return (y + y) - 3.0;", |y| y + y - 3.0);
    one("let twice = y + y; var s = twice; s -= 3.0; return s;", |y| y + y - 3.0);
    let two = package("fn f(x: f32, y: f32) -> f32 { return (x - y) + 1.0; }");
    let over = (0.0..=1.0, 0.0..=1.0);
    let spec = Spec.or(Abs(1e-5));
    two.function("f").over(over).agrees_with(|x: f64, y: f64| x - y + 1.0, spec);
    let four = package(
        "fn blended(x: f32, y: f32, t: f32) -> f32 { return mix(x, y, t); }
         fn f(x: f32, y: f32, t: f32, z: f32) -> f32 { return blended(x, y, t) + z; }",
    );
    let over = (1.0..=4.0, 1.0..=4.0, 0.0..=4.0, 1e-3..=1.0);
    let sum = |x: f64, y: f64, t: f64, z: f64| x * (1.0 - t) + y * t + z;
    four.function("f").over(over).agrees_with(sum, Spec.or(Abs(1e-4)));
    // `x % y` is "inherited from x - y * trunc(x / y)": a product, and a sum of three terms with `s`.
    let wrapped = package("fn f(a: f32, b: f32, s: f32) -> f32 { return a * b % 289.0 + s; }");
    let over = (1.0..=300.0, 1.0..=300.0, 0.0..=1.0);
    let reference = |a: f64, b: f64, s: f64| a * b % 289.0 + s;
    wrapped.function("f").over(over).agrees_with(reference, Spec.or(Abs(300.0)));
}

/// `Spec` allows small errors when a sampler filters equal texels, and when a driver divides an 8-bit integer of a
/// texel by 255.
// Lesson 169
#[test]
fn texels_are_as_exact_as_formats_and_filters() {
    let sampled = package(
        "@group(0) @binding(0) var sky: texture_cube<f32>;
         @group(0) @binding(1) var linear: sampler;
         fn f(d: vec3f) -> f32 { return textureSampleLevel(sky, linear, d, 0.0).w; }",
    );
    let white = CubeMap::constant(glam::Vec3::ONE);
    let check = sampled.function("f").with("sky", white).with("linear", Sampler::LINEAR);
    check.over(UnitVector).cases(4096).agrees_with(|_: glam::DVec3| 1.0, Spec);
    let stored = package(
        "@group(0) @binding(0) var kept: texture_storage_2d<rgba8unorm, read>;
         fn f(x: u32) -> f32 { return textureLoad(kept, vec2u(x, 0u)).x; }",
    );
    let shades = Texture::from_fn(256, 1, |x, _| [x as f32 / 255.0, 0.0, 0.0, 1.0]);
    let check = stored.function("f").with("kept", shades).over(Integers(0..=255_u32));
    check.agrees_with(|x: u32| f64::from(x) / 255.0, Spec);
}

/// A linear congruential generator with Knuth's constants.
struct Random(u64);

impl Random {
    fn below(&mut self, n: u32) -> u32 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as u32) % n
    }

    fn pick<T: Copy>(&mut self, of: &[T]) -> T {
        of[self.below(of.len() as u32) as usize]
    }

    /// A random expression. `parameters` contains the number of components of each parameter.
    fn number(&mut self, parameters: &[u8], depth: u32) -> String {
        if depth == 0 || self.below(8) == 0 {
            if self.below(4) == 0 {
                return self.pick(&["0.5", "1.0", "2.0", "0.1", "3.7", "1e-3", "-0.25"]).to_owned();
            }
            let at = self.below(parameters.len() as u32) as usize;
            let component = ["x", "y", "z", "w"][self.below(parameters[at].into()) as usize];
            return match parameters[at] {
                1 => format!("p{at}"),
                _ => format!("p{at}.{component}"),
            };
        }
        let mut one = || self.number(parameters, depth - 1);
        let [a, b, c, d] = [one(), one(), one(), one()];
        match self.below(24) {
            0..3 => format!("({a} + {b})"),
            3..6 => format!("({a} - {b})"),
            6..9 => format!("({a} * {b})"),
            9 => format!("({a} / {b})"),
            10 => format!("sqrt({a})"),
            11 => format!("exp({a})"),
            12 => format!("log({a})"),
            13 => format!("sin({a})"),
            14 => format!("cos({a})"),
            15 => format!("pow({a}, {b})"),
            16 => format!("min({a}, {b})"),
            17 => format!("max({a}, {b})"),
            18 => format!("clamp({a}, {b}, {c})"),
            19 => format!("mix({a}, {b}, {c})"),
            20 => format!("select({a}, {b}, {c} < {d})"),
            21 => format!("floor({a})"),
            22 => format!("fract({a})"),
            _ => {
                let size = 2 + self.below(3) as u8;
                let mut vector = || self.vector(parameters, size, depth - 1);
                let (v, w) = (vector(), vector());
                match self.below(3) {
                    0 => format!("dot({v}, {w})"),
                    1 => format!("length({v})"),
                    _ => format!("normalize({v}).y"),
                }
            }
        }
    }

    fn vector(&mut self, parameters: &[u8], size: u8, depth: u32) -> String {
        if let Some(at) = parameters.iter().position(|own| *own == size)
            && self.below(2) == 0
        {
            return format!("p{at}");
        }
        if depth > 0 && self.below(3) == 0 {
            let mut vector = || self.vector(parameters, size, depth - 1);
            let (v, w) = (vector(), vector());
            let t = self.number(parameters, depth - 1);
            let operation = self.pick(&["v + w", "v - w * t", "max(v, w)", "mix(v, w, t)"]);
            let [v, w, t] = [format!("({v})"), format!("({w})"), format!("({t})")];
            let of = |c: char| match c {
                'v' => v.clone(),
                'w' => w.clone(),
                't' => t.clone(),
                other => other.to_string(),
            };
            return match operation {
                "max(v, w)" => format!("max({v}, {w})"),
                "mix(v, w, t)" => format!("mix({v}, {w}, {t})"),
                plain => format!("({})", plain.chars().map(of).collect::<String>()),
            };
        }
        let all: Vec<String> =
            (0..size).map(|_| self.number(parameters, depth.saturating_sub(1))).collect();
        format!("vec{size}f({})", all.join(", "))
    }
}

/// An executor with the path `cpu@here`. It passes each job to another executor of this machine.
#[derive(Debug)]
struct Here(&'static dyn Executor);

impl Executor for Here {
    fn path(&self) -> Path {
        "cpu@here".parse().expect("a path")
    }

    fn adapter(&self) -> Adapter {
        self.0.adapter()
    }

    fn prepare<'e>(&'e self, call: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
        self.0.prepare(call)
    }
}

/// Expressions for which a Mesa driver returns results outside WGSL's bound. Each entry has the path, the expression
/// and the reason. The test fails if the driver returns a result within the bound.
const BEYOND: [(&str, &str, &str); 1] = [(
    "gl",
    "dot(vec2f(p1.x, p1.y), vec2f(p1.y, p1.x))",
    "x y + y x is computed as x (y + y), which overflows",
)];

/// `Spec` accepts the results of each driver of this machine, and of the engine in all its modes (`cpu:fma`,
/// `cpu:ftz`). The test generates 12 random functions, or 100 in `cargo ci full`.
#[test]
fn no_path_is_called_wrong_by_a_function_of_floats() {
    const CASES: u64 = 1024;
    let whole = std::env::var("SUITES").is_ok_and(|suites| suites == "whole");
    let names = [
        "cpu",
        "cpu:fma",
        "cpu:ftz",
        "vulkan",
        "gl",
        "dx12",
        "metal",
        "vulkan:spirv",
        "vulkan:wgsl",
        "vulkan:glsl",
        "vulkan:hlsl",
        "vulkan@swiftshader",
    ];
    let paths = names.map(|name| name.parse::<Path>().expect("a path"));
    let paths: Vec<_> =
        paths.into_iter().filter_map(|path| executor::of(path).ok().map(Here)).collect();
    assert!(paths.len() >= 3, "the engine is here");
    let (mut judged, mut wrong) = (0, Vec::new());
    let mut left = if whole { 100 } else { 12 };
    for seed in 0_u64.. {
        if left == 0 {
            break;
        }
        let mut random = Random(seed);
        let parameters: Vec<u8> =
            (0..1 + random.below(3)).map(|_| random.pick(&[1, 1, 2, 3, 4])).collect();
        let body = random.number(&parameters, 4);
        let declared = parameters.iter().enumerate().map(|(at, size)| match size {
            1 => format!("p{at}: f32"),
            _ => format!("p{at}: vec{size}f"),
        });
        let declared = declared.collect::<Vec<_>>().join(", ");
        let package = package(&format!("fn f({declared}) -> f32 {{ return {body}; }}"));
        // WGSL doesn't bound results that aren't finite. A constant that isn't finite is an error: `sqrt(-0.25)`.
        let Ok(probed) = Probed::new(&package, "f") else { continue };
        left -= 1;
        let expect = |row: &[u32], lanes: &mut Vec<f64>| {
            let called = executor::call(&probed, Path::CPU, &[row.to_vec()], &Vec::new());
            let value = f64::from(f32::from_bits(called.expect("it runs")[0][0]));
            lanes.push(if value.is_finite() { value } else { 0.0 });
        };
        for path in &paths {
            let shape = |size: u8| match size {
                1 => Shape::Scalar(Scalar::F32),
                size => Shape::Vector { size, scalar: Scalar::F32 },
            };
            let named: Vec<_> = parameters
                .iter()
                .enumerate()
                .map(|(at, size)| (format!("p{at}"), shape(*size)))
                .collect();
            let mut random = Random(seed + 1000);
            let mut part = |_: u8| match random.below(4) {
                0 => Part::any(Scalar::F32),
                1 => Part::plausible(Scalar::F32),
                2 => Part::range(Scalar::F32, 0.0..=1.0).expect("floats"),
                _ => Part::range(Scalar::F32, -4.0..=4.0).expect("floats"),
            };
            let parts = parameters.iter().map(|size| (0..*size).map(&mut part).collect()).collect();
            let check = package.function("f").on(path).over_dynamic(Dynamic::new(&named, parts));
            let found = check.cases(CASES).unrecorded().try_agrees_with(&expect, Spec);
            match found {
                Ok(agreement) => judged += agreement.cases,
                Err(Failure::Disagreement(found)) => {
                    let census = found.paths[0].census;
                    judged += census.cases - census.ill_conditioned - census.unbounded;
                    let (name, is_wrong) = (path.0.path(), census.driver + census.shader > 0);
                    let is_known = |(path, part, _): &(&str, &str, &str)| {
                        *path == name.name() && body.contains(part)
                    };
                    if let Some((_, part, why)) = BEYOND.iter().find(|one| is_known(one))
                        && path.adapter().name.contains("llvmpipe")
                    {
                        assert!(is_wrong, "`{part}` is mended: {why}");
                    } else if is_wrong {
                        wrong.push(format!("seed {seed} on {}: {body}\n{found}", name.name()));
                    }
                }
                Err(other) => panic!("seed {seed}: {body}: {other}"),
            }
        }
    }
    assert!(judged > 1000, "{judged} cases are bounded");
    assert!(wrong.is_empty(), "{} are called wrong:\n{}", wrong.len(), wrong.join("\n"));
}
