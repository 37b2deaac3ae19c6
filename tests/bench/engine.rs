//! Times the engine (path `cpu`) and lavapipe on the same cores.

use std::time::Instant;

use glam::Vec3;
use karat::prelude::*;
use shaders::{PBR, fresnel, sampling};

use super::{STARTS, Spread, spawn};

/// The number of checks that a child process runs to represent a small library. [`CHECKS`] represents a large library.
const FEW: usize = 10;
const CHECKS: usize = 110;

/// Runs a task in a child process on a path. Returns the time of the process in seconds, and the number that it
/// printed. If `cold`, the child has its own empty driver cache.
fn on(path: &str, task: &str, cold: bool) -> (f64, f64) {
    let cache = tempfile::tempdir().expect("a temporary folder");
    let folder = cache.path().display().to_string();
    let own = [("KARAT_PATHS", path), ("MESA_SHADER_CACHE_DIR", folder.as_str())];
    let (time, text) = spawn(task, if cold { &own } else { &own[..1] });
    (time.as_secs_f64(), text.parse().unwrap_or(0.0))
}

pub(super) fn run() {
    println!("\nchecks of one process, start to verdicts [s]");
    for (task, cases) in [
        ("few_checks", "10 of 1,000 cases"),
        ("checks_of_1000", "110 of 1,000 cases"),
        ("checks", "110 of 65,536 cases"),
    ] {
        for (path, cold) in [("cpu", false), ("vulkan", false), ("vulkan", true)] {
            let times = (0..STARTS).map(|_| on(path, task, cold).0).collect();
            let cache = if cold { "   driver cache cold" } else { "" };
            println!("  {path:<7} {cases:<20} {}{cache}", Spread::of(times));
        }
    }
    println!(
        "\n65,536 cases of one check, process start to verdict, cpu over lavapipe [ratio of times]"
    );
    for task in ["ggx_65536", "estimate_65536"] {
        for (name, cold) in [("driver cache cold", true), ("driver cache warm", false)] {
            let ratio = |_| on("cpu", task, cold).0 / on("vulkan", task, cold).0;
            println!("  {task:<15} {name}  {}", Spread::of((0..STARTS).map(ratio).collect()));
        }
    }
    println!(
        "\nsteady state, cases a second of the whole check, cpu over lavapipe [ratio of rates]"
    );
    for task in ["ggx_steady", "estimate_steady"] {
        let (mut cpu, mut vulkan, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..5 {
            let rates = ["cpu", "vulkan"].map(|path| on(path, task, false).1);
            cpu.push(rates[0]);
            vulkan.push(rates[1]);
            ratios.push(rates[0] / rates[1]);
        }
        let [cpu, vulkan, ratios] = [cpu, vulkan, ratios].map(Spread::of);
        println!("  {task:<15} cpu {cpu}  lavapipe {vulkan} [1e6/s]  {ratios}");
    }
}

/// Times a pass with the sanitizer, and the same pass in other orders of its invocations. The benchmark divides both
/// times by the time of a plain run.
pub(super) fn sanitizer() {
    println!(
        "\na pass of 65,536 invocations in the engine: the part beside a plain run [ratio of times]"
    );
    let (mut detector, mut order) = (Vec::new(), Vec::new());
    for _ in 0..STARTS {
        let [[looked, without], [_, with]] = ["0", ORDERS].map(|orders| {
            let own = [("KARAT_PATHS", "cpu"), ("KARAT_SCHEDULES", orders)];
            let text = spawn("passes", &own).1;
            let mut all = text.split(' ').map(|one| one.parse::<f64>().expect("it prints ratios"));
            [(); 2].map(|()| all.next().expect("it prints two"))
        });
        detector.push(looked);
        order.push((with - without) / ORDERS.parse::<f64>().expect("a number"));
    }
    println!("  with the detector          {}", Spread::of(detector));
    println!("  in another order, each     {}", Spread::of(order));
}

/// The number of orders, besides the usual one, in which the benchmark runs the invocations of the pass.
const ORDERS: &str = "6";

/// A shader in which each workgroup has a tile of 64 `u32`s. Each invocation adds up the weighted values of the tile,
/// and then adds the value that a shared counter had before this invocation incremented the counter. So the results
/// depend on the order of the invocations.
const TILES: &str = "@group(0) @binding(0) var<storage, read> input: array<u32>;
    @group(0) @binding(1) var<storage, read_write> sums: array<u32>;
    @group(0) @binding(2) var<storage, read_write> tickets: atomic<u32>;
    var<workgroup> tile: array<u32, 64>;
    @compute @workgroup_size(64) fn sum(@builtin(local_invocation_index) i: u32,
        @builtin(global_invocation_id) id: vec3u) {
        tile[i] = input[id.x];
        workgroupBarrier();
        var sum = 0u;
        for (var k = 0u; k < 64u; k++) { sum += tile[(i + k) % 64u] * (k + 1u); }
        sums[id.x] = sum + atomicAdd(&tickets, 1u);
    }";

/// The time of a pass with the sanitizer, and the time of a whole check of the pass, each divided by the time of a
/// plain run.
fn passes() -> [f64; 2] {
    const WORDS: u32 = 1 << 16;
    let package = Package::from_source("tiles", TILES);
    let passes = || {
        let passes = package.compute().with("input", Storage::new(0..WORDS));
        let passes = passes.with("tickets", Storage::new([0_u32]));
        passes.with("sums", Storage::new(vec![0_u32; WORDS as usize])).dispatch("sum", [1024, 1, 1])
    };
    let plain = || {
        let left = karat::unstable::compute::left(&passes(), karat::Path::CPU);
        assert_eq!(left.expect("the pass is valid").len(), 2);
    };
    let looked = || {
        let (found, watched) =
            karat::unstable::compute::violations(&passes()).expect("the pass is valid");
        assert!(found.is_empty() && watched.invocations == u64::from(WORDS), "{watched:?}");
    };
    let test = || {
        drop(passes().after("sums").unrecorded().satisfies("is anything", |_: &[u32]| true));
    };
    let timed = |once: &dyn Fn()| {
        let start = Instant::now();
        once();
        start.elapsed().as_secs_f64()
    };
    // The tasks take turns, so that noise of the machine affects all tasks. The first turn warms up.
    let turns: Vec<[f64; 3]> =
        (0..6).map(|_| [timed(&plain), timed(&looked), timed(&test)]).collect();
    let median = |at: usize| Spread::of(turns[1..].iter().map(|turn| turn[at]).collect()).0[0];
    [1, 2].map(|at| median(at) / median(0))
}

/// Runs a task in the child process. Returns `false` if `task` isn't a task of this file.
pub(super) fn child(task: &str) -> bool {
    match task {
        "few_checks" => checks(FEW, 1_000),
        "checks_of_1000" => checks(CHECKS, 1_000),
        "checks" => checks(CHECKS, 65_536),
        "ggx_65536" => ggx(65_536),
        "estimate_65536" => estimate(65_536),
        "ggx_steady" => print!("{}", steady(1_000_000, ggx)),
        "estimate_steady" => print!("{}", steady(100_000, estimate)),
        "passes" => {
            let [looked, test] = passes();
            print!("{looked} {test}");
        }
        _ => return false,
    }
    true
}

/// The speed of `check` in millions of cases per second, measured after one run to warm up.
fn steady(cases: u64, check: fn(u64)) -> f64 {
    check(cases);
    let start = Instant::now();
    check(cases);
    #[expect(clippy::cast_precision_loss, reason = "millions")]
    let cases = cases as f64;
    cases / start.elapsed().as_secs_f64() / 1e6
}

fn checks(count: usize, cases: u64) {
    for check in 0..count {
        match check % 3 {
            0 => drop(
                PBR.function("fresnel::schlick")
                    .over((UnitRgb, 0.0..=1.0))
                    .cases(cases)
                    .agrees_with(fresnel::schlick, Ulp(11.0)),
            ),
            1 => drop(
                PBR.function("fresnel::schlick_average")
                    .over(UnitRgb)
                    .cases(cases)
                    .agrees_with(fresnel::schlick_average, Ulp(8.0)),
            ),
            _ => ggx(cases),
        }
    }
}

fn ggx(cases: u64) {
    let u = (0.0..=1.0_f32, 0.0..=1.0_f32).map(|(x, y)| glam::Vec2::new(x, y));
    PBR.function("sampling::ggx_normal")
        .over((1e-4..=1.0, u))
        .cases(cases)
        .agrees_with(sampling::ggx_normal, Abs(6e-4));
}

/// Runs a check of a sum over 64 filtered samples of a cube map. The check computes no reference, so nearly all of the
/// measured time is spent on the path.
fn estimate(cases: u64) {
    PBR.function("specular::estimate")
        .with("environment", CubeMap::from_fn(32, |direction| 1.0 + 0.5 * direction))
        .with("environment_sampler", Sampler::LINEAR)
        .over((0.01..=1.0_f32, 0.01..=1.0_f32).map(|(alpha, cosine)| {
            let v = Vec3::new((1.0 - cosine * cosine).sqrt(), 0.0, cosine);
            (Vec3::ONE, alpha, Vec3::Z, v, 64_u32)
        }))
        .cases(cases)
        .satisfies("is finite", |_, light: Vec3| light.is_finite());
}
