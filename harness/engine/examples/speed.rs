//! Measures the speed of two functions in `f32`, in `f64` and in intervals, in cases per second.
//!
//! Run it with `cargo run --release --example speed`.
#![expect(clippy::print_stdout, reason = "a program for the terminal")]

use std::time::Instant;

use karat_engine::{F32, F64, Intervals, Options, Program, Resources, Runs, Settings};

const SOURCE: &str = "
const TAU = 6.283185307;

fn ggx_normal(alpha: f32, u: vec2f) -> vec3f {
    let d = (1.0 - u.y) + alpha * alpha * u.y;
    if d == 0.0 { return vec3f(0.0, 0.0, 1.0); }
    let cos_theta = sqrt((1.0 - u.y) / d);
    let sin_theta = alpha * sqrt(u.y / d);
    let phi = TAU * (u.x - 0.5);
    return vec3f(sin_theta * cos(phi), sin_theta * sin(phi), cos_theta);
}

fn radical_inverse(i: u32) -> f32 { return f32(reverseBits(i) >> 8u) * 5.9604644775390625e-8; }

fn split_sum_table(alpha: f32, n_dot_v: f32) -> vec2f {
    let v = vec3f(sqrt((1.0 - n_dot_v) * (1.0 + n_dot_v)), 0.0, n_dot_v);
    var sum = vec2f();
    for (var i = 0u; i < 64u; i++) {
        let h = ggx_normal(alpha, vec2f((f32(i) + 0.5) / 64.0, radical_inverse(i) + 0.5 / 64.0));
        let v_dot_h = dot(v, h);
        let n_dot_l = 2.0 * v_dot_h * h.z - n_dot_v;
        if n_dot_l > 0.0 {
            let c = abs(1.0 - v_dot_h);
            let fc = c * c * c * c * c;
            let g = min(1.0, 2.0 * h.z * min(n_dot_v, n_dot_l) / v_dot_h);
            sum += g * v_dot_h / (h.z * n_dot_v) * vec2f(1.0 - fc, fc);
        }
    }
    return sum / 64.0;
}

fn polynomial(x: f32, y: f32) -> f32 {
    var s = x;
    s = s * y + 0.5; s = s * y + 0.25; s = s * y + 0.125; s = s * y + 0.5;
    s = s * y + 0.5; s = s * y + 0.25; s = s * y + 0.125; s = s * y + 0.5;
    return s / (1.0 + x * x);
}

fn iterated(x: f32, y: f32) -> f32 {
    var s = x;
    for (var i = 0; i < 64; i++) {
        s = s * y + 0.5; s = s * y + 0.25; s = s * y + 0.125; s = s * y + 0.5;
        s = s * y + 0.5; s = s * y + 0.25; s = s * y + 0.125; s = s * y + 0.5;
    }
    return s;
}
";

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let module = naga::front::wgsl::parse_str(SOURCE)?;
    let info = naga::valid::Validator::new(
        naga::valid::ValidationFlags::all(),
        naga::valid::Capabilities::all(),
    )
    .validate(&module)?;
    for (name, cases) in [
        ("polynomial", 1 << 22),
        ("ggx_normal", 1 << 20),
        ("split_sum_table", 1 << 15),
        ("iterated", 1 << 16),
    ] {
        let start = Instant::now();
        let program = Program::function(&module, &info, name, &Settings::default())?;
        println!("{name}: {:?}, lowered in {:?}", program.size(), start.elapsed());
        let width = program.parameters().len();
        let share = |k: usize| ((k * 2_654_435_761) % 9973) as f32 / 9973.0;
        let rows: Vec<u32> =
            (0..cases * width).map(|k| (0.05 + 0.9 * share(k)).to_bits()).collect();
        timed::<F32>("f32", &program, cases, &rows)?;
        timed::<F64>("f64", &program, cases, &rows)?;
        timed::<Intervals>("intervals", &program, cases / 16, &rows[..cases / 16 * width])?;
        let start = Instant::now();
        let (resources, options) = (Resources::new(), Options::default());
        program.call::<F32>(1, &rows[..width], &resources, &options, &())?;
        println!("  one case: {:?}", start.elapsed());
    }
    Ok(())
}

fn timed<A: Runs>(
    what: &str,
    program: &Program,
    cases: usize,
    rows: &[u32],
) -> Result<(), karat_engine::Stop> {
    let (resources, options) = (Resources::new(), Options::default());
    let mut best = f64::INFINITY;
    for _ in 0..5 {
        let start = Instant::now();
        program.call::<A>(cases, rows, &resources, &options, &())?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    println!("  {what}: {:.2} million cases a second", cases as f64 / best / 1e6);
    Ok(())
}
