//! Karat's benchmark, which `cargo ci bench` runs.
//!
//! The benchmark is built in the profile of `cargo test`, because authors run their tests in this profile and wait for
//! them. Because the speed of a machine varies, a run alternates between the tasks that it compares, and prints each
//! figure as a median with its spread.

#![expect(clippy::print_stdout, reason = "a benchmark prints its figures")]

mod bare;
mod compilers;
mod engine;
mod frames;
mod project;
mod watch;

use std::process::Command;
use std::time::{Duration, Instant};

use karat::prelude::*;
use shaders::{PBR, fresnel, sampling};

use self::bare::Bare;

/// The number of repetitions of each task that starts a process.
const STARTS: usize = 9;

/// The benchmarks by name.
const BENCHMARKS: [(&str, fn()); 11] = [
    ("starts", starts),
    ("throughput", throughput),
    ("costs", costs),
    ("samplers", samplers),
    ("memory", memory),
    ("frames", frames::run),
    ("engine", engine::run),
    ("sanitizer", engine::sanitizer),
    ("compilers", compilers::run),
    ("watch", watch::run),
    ("project", project::run),
];

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.first().is_some_and(|first| first == "--child") {
        return child(&arguments[1]);
    }
    // Cargo adds the argument `--bench`.
    let parts: Vec<&String> = arguments.iter().filter(|part| !part.starts_with('-')).collect();
    let asked = |name: &str| parts.is_empty() || parts.iter().any(|part| name.contains(*part));
    let chosen: Vec<_> = BENCHMARKS.into_iter().filter(|(name, _)| asked(name)).collect();
    if chosen.is_empty() {
        eprintln!("no benchmark has such a name; there are {}", BENCHMARKS.map(|b| b.0).join(", "));
        std::process::exit(2);
    }
    for (_, run) in chosen {
        run();
    }
}

/// Runs a task in the child process.
fn child(task: &str) {
    match task {
        "schlick" => {
            PBR.function("fresnel::schlick")
                .over((UnitRgb, 0.0..=1.0))
                .agrees_with(fresnel::schlick, Ulp(11.0));
        }
        "valid" => compilers::child(),
        "one_frame" => {
            frames::compare_one();
            print!("{}", peak_memory());
        }
        "karat" => {
            ggx(1_000_000);
            print!("{}", peak_memory());
        }
        "bare" => {
            assert!(Bare::open().run(1_000_000) < 6e-4);
            print!("{}", peak_memory());
        }
        other => assert!(engine::child(other), "there is no task `{other}`"),
    }
}

fn ggx(cases: u64) {
    let u = (0.0..=1.0_f32, 0.0..=1.0_f32).map(|(x, y)| glam::Vec2::new(x, y));
    PBR.function("sampling::ggx_normal")
        .over((1e-4..=1.0, u))
        .cases(cases)
        .agrees_with(sampling::ggx_normal, Abs(6e-4));
}

struct Spread([f64; 3]);

impl Spread {
    fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let (middle, last) = (values.len() / 2, values.len() - 1);
        Self([values[middle], values[0], values[last]])
    }
}

impl std::fmt::Display for Spread {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self([median, smallest, largest]) = self;
        write!(f, "{median:>8.3}  ({smallest:.3} to {largest:.3})")
    }
}

fn spawn(task: &str, environment: &[(&str, &str)]) -> (Duration, String) {
    let exe = std::env::current_exe().expect("this program has a path");
    let start = Instant::now();
    let output = Command::new(exe)
        .args(["--child", task])
        .env("NODEVICE_SELECT", "1")
        .envs(environment.iter().copied())
        .output()
        .expect("this program runs");
    let time = start.elapsed();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    (time, String::from_utf8_lossy(&output.stdout).into_owned())
}

fn starts() {
    println!("65,536 cases of fresnel::schlick, process start to verdict [s]");
    for (name, paths) in [("one path ", "vulkan"), ("two paths", "vulkan,gl")] {
        let mut cold = Vec::new();
        let mut warm = Vec::new();
        for _ in 0..STARTS {
            let cache = tempfile::tempdir().expect("a temporary folder");
            let folder = cache.path().display().to_string();
            let environment = [("KARAT_PATHS", paths), ("MESA_SHADER_CACHE_DIR", folder.as_str())];
            cold.push(spawn("schlick", &environment).0.as_secs_f64());
            warm.push(spawn("schlick", &environment).0.as_secs_f64());
        }
        println!("  {name}, driver cache cold  {}", Spread::of(cold));
        println!("  {name}, driver cache warm  {}", Spread::of(warm));
    }
}

fn throughput() {
    println!("\nsampling::ggx_normal, from source to verdict on an open device, one path");
    println!("  cases      Karat [1e6/s]                  bare loop [1e6/s]              ratio");
    let bare = Bare::open();
    for (cases, repetitions) in [(1_000_u32, 41), (100_000, 21), (1_000_000, 9)] {
        ggx(u64::from(cases));
        bare.run(cases);
        let rate = |time: Duration| f64::from(cases) / time.as_secs_f64() / 1e6;
        let (mut ours, mut theirs, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..repetitions {
            let start = Instant::now();
            ggx(u64::from(cases));
            let karat = rate(start.elapsed());
            let start = Instant::now();
            assert!(bare.run(cases) < 6e-4);
            let loop_ = rate(start.elapsed());
            ours.push(karat);
            theirs.push(loop_);
            ratios.push(karat / loop_);
        }
        let [ours, theirs, ratios] = [ours, theirs, ratios].map(Spread::of);
        println!("  {cases:<9}  {ours}  {theirs}  {ratios}");
    }
}

/// Measures where a check with many cases spends its time: on the device, in the reference, or on choosing the
/// arguments.
fn costs() {
    const CASES: u32 = 1_000_000;
    println!("\nsampling::ggx_normal with 1,000,000 cases: where the time goes [ns a case]");
    let bare = Bare::open();
    let inputs = Bare::inputs(CASES);
    let whole = || {
        ggx(u64::from(CASES));
    };
    let without_reference = || {
        let u = (0.0..=1.0_f32, 0.0..=1.0_f32).map(|(x, y)| glam::Vec2::new(x, y));
        let function = PBR.function("sampling::ggx_normal");
        function.over((1e-4..=1.0, u)).cases(u64::from(CASES)).is_finite();
    };
    let device = || assert!(bare.call(&inputs, |results| results.len()) > 0);
    let reference = || assert!(Bare::reference(&inputs) > 0.0);
    let rows: [(&str, &dyn Fn()); 4] = [
        ("Karat: draws, device, reference, judging", &whole),
        ("Karat without the reference: `is_finite`", &without_reference),
        ("wgpu alone: upload, dispatch, read-back", &device),
        ("the reference alone, on one thread", &reference),
    ];
    let mut times = rows.map(|_| Vec::new());
    for repetition in 0..8 {
        for ((_, run), times) in rows.iter().zip(&mut times) {
            let start = Instant::now();
            run();
            // The first repetition warms up.
            if repetition > 0 {
                times.push(start.elapsed().as_secs_f64() * 1e9 / f64::from(CASES));
            }
        }
    }
    for ((name, _), times) in rows.iter().zip(times) {
        println!("  {name:<42} {}", Spread::of(times));
    }
}

/// Times the test of a sampler against its density: the pilot run, the integrals over 512 cells, the samples, and the
/// density of each sample.
fn samplers() {
    println!("\nsampling::ggx_visible_normal against its density, one configuration [s]");
    let v = glam::Vec3::new(0.6, 0.0, 0.8);
    for (alpha, samples) in [(0.5_f32, 1_u64 << 18), (0.5, 1_000_000), (0.01, 1_000_000)] {
        let run = || {
            let start = Instant::now();
            PBR.function("sampling::ggx_visible_normal")
                .sampled_over(Just(alpha), |&alpha, u: glam::Vec2| (alpha, v, u))
                .samples(samples)
                .follows(
                    PBR.function("sampling::ggx_visible_normal_pdf"),
                    |&alpha, h: glam::Vec3| (alpha, v, h),
                );
            start.elapsed().as_secs_f64()
        };
        run();
        let times = (0..7).map(|_| run()).collect();
        println!("  alpha {alpha:<5} {samples:>8} samples  {}", Spread::of(times));
    }
}

/// The peak memory of this process so far, in MB. 0 if the system doesn't report it.
fn peak_memory() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    let kilobytes = line.and_then(|line| line.split_whitespace().nth(1)?.parse::<f64>().ok());
    kilobytes.unwrap_or(0.0) / 1024.0
}

fn memory() {
    println!("\npeak memory of a process with 1,000,000 cases of sampling::ggx_normal [MB]");
    let measure = |task| {
        let runs = (0..3).map(|_| {
            let (_, text) = spawn(task, &[("KARAT_PATHS", "vulkan")]);
            text.parse::<f64>().expect("the child prints its peak")
        });
        Spread::of(runs.collect())
    };
    let (karat, bare) = (measure("karat"), measure("bare"));
    println!(
        "  Karat      {karat}\n  bare loop  {bare}\n  above      {:>8.3}",
        karat.0[0] - bare.0[0]
    );
}
