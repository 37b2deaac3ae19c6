//! Compute entry points: several passes, their buffers and textures, statements, and errors.

use glam::{DVec4, Vec4};
use karat::Path;
use karat::fixture::Buffer;
use karat::prelude::*;

/// A prefix sum as WebGPU programs write it: the first pass sums blocks of 64 elements in workgroup memory, and the
/// second pass adds the sums of earlier blocks.
const SCAN: &str = "\
@group(0) @binding(0) var<storage, read_write> data: array<u32>;
@group(0) @binding(1) var<storage, read_write> sums: array<u32>;
override ADDED: u32 = 0u;
var<workgroup> part: array<u32, 64>;

@compute @workgroup_size(64)
fn blocks(
    @builtin(global_invocation_id) id: vec3u,
    @builtin(local_invocation_index) lane: u32,
    @builtin(workgroup_id) group: vec3u,
) {
    part[lane] = data[id.x] + ADDED;
    workgroupBarrier();
    for (var step = 1u; step < 64u; step *= 2u) {
        var before = 0u;
        if lane >= step { before = part[lane - step]; }
        workgroupBarrier();
        part[lane] += before;
        workgroupBarrier();
    }
    data[id.x] = part[lane];
    if lane == 63u { sums[group.x] = part[63]; }
}

@compute @workgroup_size(64)
fn add(@builtin(global_invocation_id) id: vec3u, @builtin(workgroup_id) group: vec3u) {
    var before = 0u;
    for (var i = 0u; i < group.x; i++) { before += sums[i]; }
    data[id.x] += before;
}
";

fn values() -> Vec<u32> {
    (0..256_u32).map(|i| i.wrapping_mul(2_654_435_761) >> 24).collect()
}

fn running(values: &[u32]) -> Vec<u32> {
    let sums = values.iter().scan(0, |sum, value| {
        *sum += value;
        Some(*sum)
    });
    sums.collect()
}

fn scan(package: &Package) -> karat::compute::Compute<'_> {
    package
        .compute()
        .with("data", Storage::new(values()))
        .with("sums", Buffer::zeros(16))
        .dispatch("blocks", [4, 1, 1])
        .dispatch("add", [4, 1, 1])
}

// Lesson 128
#[test]
fn passes_share_their_buffers() {
    let package = Package::from_source("scan", SCAN);
    let agreement = scan(&package).after("data").agrees_with(running(&values()), Abs(0.0));
    assert_eq!(agreement.elements, 256);
    assert!(!agreement.paths.is_empty());
    // The sums that the first pass writes.
    let blocks = values().chunks(64).map(|block| block.iter().sum()).collect::<Vec<u32>>();
    scan(&package).after("sums").agrees_with(blocks, Abs(0.0));
    scan(&package).after("data").satisfies("is in order", |data: &[u32]| data.is_sorted());
    // An override holds in all passes.
    let more: Vec<u32> = values().iter().map(|value| value + 2).collect();
    scan(&package).with_override("ADDED", 2.0).after("data").agrees_with(running(&more), Abs(0.0));
}

/// If a pass is missing, the check fails, and the message gives the number of wrong elements and the first of them. A
/// check also fails if the condition of `satisfies` is false.
// Lesson 128
#[test]
fn each_difference_of_a_pass_is_reported() {
    let package = Package::from_source("scan", SCAN);
    let first = package
        .compute()
        .with("data", Storage::new(values()))
        .with("sums", Buffer::zeros(16))
        .dispatch("blocks", [4, 1, 1]);
    let error = first.after("data").unrecorded().try_agrees_with(running(&values()), Abs(0.0));
    let text = error.expect_err("the second pass is missing").to_string();
    for part in [
        "`data` after `blocks` fails: abs 0",
        "<scan>:7:1",
        "192 of 256 elements differ (75.000%)",
        "first: [64]",
        "KARAT_CASE=blocks/after.data.agrees_with/0",
    ] {
        assert!(text.contains(part), "{part} in:\n{text}");
    }
    let error = scan(&package)
        .after("data")
        .unrecorded()
        .try_satisfies("is zero", |data: &[u32]| data.iter().all(|value| *value == 0));
    let text = error.expect_err("it isn't").to_string();
    assert!(
        text.contains("fails: is zero")
            && text.contains("the assertion about all 256 elements together is false"),
        "{text}"
    );
}

// Lesson 128
#[test]
fn mistakes_are_reported_before_a_dispatch() {
    let package = Package::from_source("scan", SCAN);
    let told = |result: Result<karat::compute::ComputeAgreement, karat::compute::ComputeError>,
                parts: &[&str]| {
        let text = result.expect_err("a mistake").to_string();
        parts.iter().for_each(|part| assert!(text.contains(part), "{part} in:\n{text}"));
    };
    let reference = || running(&values());
    let start = || package.compute().with("data", Storage::new(values()));
    told(
        start()
            .dispatch("blocks", [4, 1, 1])
            .after("data")
            .unrecorded()
            .try_agrees_with(reference(), Abs(0.0)),
        &["<scan>:2:", "`sums` (storage buffer) has no fixture"],
    );
    told(
        start().after("data").unrecorded().try_agrees_with(reference(), Abs(0.0)),
        &["nothing is dispatched"],
    );
    told(
        scan(&package)
            .dispatch("block", [1, 1, 1])
            .after("data")
            .unrecorded()
            .try_agrees_with(reference(), Abs(0.0)),
        &["`block` isn't a compute entry point; did you mean `blocks`?"],
    );
    told(
        scan(&package)
            .dispatch("add", [0, 1, 1])
            .after("data")
            .unrecorded()
            .try_agrees_with(reference(), Abs(0.0)),
        &["0 x 1 x 1 workgroups"],
    );
    told(
        scan(&package).after("dat").unrecorded().try_agrees_with(reference(), Abs(0.0)),
        &["no pass writes `dat`; did you mean `data`?"],
    );
    told(
        scan(&package).after("data").unrecorded().try_agrees_with([1_u32, 2], Abs(0.0)),
        &["`data` has 256 elements", "the reference has 2"],
    );
    told(
        scan(&package).after("data").unrecorded().try_agrees_with([1.0_f64], Abs(0.0)),
        &["`data` holds array<u32, 256>", "the reference gives f32"],
    );
    let none: [u32; 0] = [];
    told(
        scan(&package).after("data").unrecorded().try_agrees_with(none, Abs(0.0)),
        &["nothing is compared: the reference has no elements"],
    );
    told(
        scan(&package)
            .with("dta", Buffer::zeros(4))
            .after("data")
            .unrecorded()
            .try_agrees_with(reference(), Abs(0.0)),
        &["no variable `dta`", "did you mean `data`?"],
    );
    told(
        scan(&package)
            .fails_on(Path::VULKAN, "")
            .after("data")
            .unrecorded()
            .try_agrees_with(reference(), Abs(0.0)),
        &["has no reason"],
    );
}

/// A blur in two passes. The second pass samples the texture that the first pass stores.
// Lesson 128
#[test]
fn textures_are_stored_and_sampled() {
    let text = "\
        @group(0) @binding(0) var source: texture_2d<f32>;\n\
        @group(0) @binding(1) var middle: texture_storage_2d<rgba16float, write>;\n\
        @group(0) @binding(2) var blurred: texture_storage_2d<rgba32float, write>;\n\
        @group(0) @binding(3) var sampled: texture_2d<f32>;\n\
        @compute @workgroup_size(4, 4)\n\
        fn across(@builtin(global_invocation_id) id: vec3u) {\n    \
        let at = vec2i(id.xy);\n    \
        let sum = textureLoad(source, max(at - vec2i(1, 0), vec2i()), 0) + textureLoad(source, at, 0)\n        \
        + textureLoad(source, min(at + vec2i(1, 0), vec2i(7, 3)), 0);\n    \
        textureStore(middle, at, sum / 3.0);\n}\n\
        @compute @workgroup_size(4, 4)\n\
        fn twice(@builtin(global_invocation_id) id: vec3u) {\n    \
        textureStore(blurred, id.xy, 2.0 * textureLoad(sampled, id.xy, 0));\n}\n";
    let package = Package::from_source("blur", text);
    let texel = |x: u32, y: u32| Vec4::new(x as f32, y as f32, (x * y) as f32 / 8.0, 1.0);
    let reference = (0..32_u32).map(|i| {
        let (x, y) = (i % 8, i / 8);
        let at = |x: u32| texel(x, y).as_dvec4();
        2.0 / 3.0 * (at(x.saturating_sub(1)) + at(x) + at((x + 1).min(7)))
    });
    package
        .compute()
        .with("source", Texture::from_fn(8, 4, texel))
        .with("middle", Texture::from_fn(8, 4, |_, _| Vec4::ZERO))
        .alias("sampled", "middle")
        .with("blurred", Texture::from_fn(8, 4, |_, _| Vec4::ZERO))
        .dispatch("across", [2, 1, 1])
        .dispatch("twice", [2, 1, 1])
        .after("blurred")
        .agrees_with(reference.collect::<Vec<DVec4>>(), Rel(1e-3).or(Abs(1e-6))); // half floats
}

/// If a driver ends a pass's loop too early, the check fails with an error at the loop's line.
// Lesson 128
#[test]
fn loops_of_passes_that_drivers_cut_short_are_errors() {
    let text = "@group(0) @binding(0) var<storage, read_write> out: array<u32>;\n\
        @compute @workgroup_size(1)\n\
        fn spin() {\n    \
        var n = 0u;\n    \
        for (var i = 0u; i < out[1]; i++) { n += i % 3u; }\n    out[0] = n;\n}\n";
    let package = Package::from_source("spin", text);
    let after = |rounds: u32| {
        let passes = package.compute().with("out", Storage::new([0, rounds]));
        passes.dispatch("spin", [1, 1, 1]).after("out")
    };
    let spun = |rounds: u32| (0..rounds).map(|i| i % 3).sum::<u32>();
    after(1000).agrees_with([spun(1000), 1000], Abs(0.0));
    match after(200_000).unrecorded().try_agrees_with([spun(200_000), 200_000], Abs(0.0)) {
        Ok(agreement) => assert!(
            agreement.paths.iter().all(|(adapter, _)| !adapter.name.contains("llvmpipe")),
            "{agreement}"
        ),
        Err(error) => assert!(error.to_string().contains("<spin>:5:5"), "{error}"),
    }
}
