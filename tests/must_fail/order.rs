//! Tests that Karat reports passes whose results depend on the order of invocations, and no other passes.

use karat::check::HazardKind;
use karat::compute::ComputeError;
use karat::prelude::*;

/// Runs `body` on the engine in `groups` workgroups of `size` invocations, and checks that `out` is `expected` in the
/// end. `body` can use an array `a` of atomics, an array `d` and the atomic `out`.
fn left(body: &str, size: u32, groups: u32, expected: u32) -> Result<(), ComputeError> {
    let text = format!(
        "@group(0) @binding(0) var<storage, read_write> a: array<atomic<u32>, 8>;
@group(0) @binding(1) var<storage, read_write> d: array<u32, 64>;
@group(0) @binding(2) var<storage, read_write> out: array<atomic<u32>, 1>;
var<workgroup> shared_count: atomic<u32>;
@compute @workgroup_size({size}) fn main(@builtin(local_invocation_index) i: u32, @builtin(workgroup_id) w: vec3u,
    @builtin(global_invocation_id) g: vec3u) {{
    let all = {all}u;
    d[g.x] += atomicLoad(&a[7]) + atomicLoad(&shared_count) * 0u + min(atomicLoad(&out[0]), 0u);
    {body}
}}",
        all = size * groups,
    );
    let package = Package::from_source("m", text);
    let cpu = karat::unstable::executor::of(karat::Path::CPU).expect("it is always there");
    let passes = package.compute().with("a", Storage::new([0_u32; 8]));
    let passes = passes.with("d", Storage::new([0_u32; 64])).with("out", Storage::new([0_u32]));
    let after = passes.dispatch("main", [groups, 1, 1]).on(cpu).after("out").unrecorded();
    after.try_agrees_with([expected], Abs(0.0)).map(drop)
}

/// Each body gives the expected result in the usual order of invocations, but not in all orders.
// Lesson 216
#[test]
fn results_of_an_order() {
    for (name, body, size, groups, expected) in [
        (
            "a lost update, where one invocation has more iterations",
            "for (var k = 1u; k <= select(1u, 6u, i == 0u); k++) { let old = atomicLoad(&out[0]); atomicStore(&out[0], max(old, k)); }",
            2,
            1,
            6,
        ),
        (
            "a maximum by hand",
            "if g.x > atomicLoad(&out[0]) { atomicStore(&out[0], g.x); }",
            1,
            4,
            3,
        ),
        (
            "a flag that two may take",
            "if atomicLoad(&a[0]) == 0u { atomicStore(&a[0], 1u); atomicAdd(&out[0], 1u); }",
            1,
            5,
            1,
        ),
        (
            "a comparison whose word was changed and changed back",
            "if g.x == 0u { let old = atomicLoad(&a[0]); let seen = atomicLoad(&a[1]); let r = atomicCompareExchangeWeak(&a[0], old, 9u); if r.exchanged { atomicStore(&out[0], 1u + u32(atomicLoad(&a[1]) != seen)); } } else { atomicAdd(&a[0], 1u); atomicAdd(&a[1], 1u); atomicSub(&a[0], 1u); }",
            1,
            2,
            1,
        ),
        (
            "a poll that gives up",
            "if w.x == 0u { atomicStore(&a[0], 1u); } else { for (var k = 0u; k < 100u; k++) { if atomicLoad(&a[0]) == 1u { atomicStore(&out[0], 1u); break; } } }",
            1,
            2,
            1,
        ),
        (
            "retries that run out",
            "for (var k = 0u; k < 3u; k++) { let old = atomicLoad(&out[0]); if atomicCompareExchangeWeak(&out[0], old, old + 1u).exchanged { break; } }",
            1,
            8,
            8,
        ),
        ("the last one wins", "atomicStore(&out[0], g.x);", 1, 3, 2),
        (
            "the first one wins",
            "if atomicExchange(&a[0], 1u) == 0u { atomicStore(&out[0], g.x + 1u); }",
            1,
            3,
            1,
        ),
        (
            "a count that is read before all have counted",
            "atomicAdd(&a[0], 1u); if g.x + 1u == all { atomicStore(&out[0], atomicLoad(&a[0])); }",
            2,
            3,
            6,
        ),
        (
            "two words that are read one after the other",
            "if g.x == 0u { atomicAdd(&a[0], 1u); atomicAdd(&a[1], 1u); } else { let x = atomicLoad(&a[0]); let y = atomicLoad(&a[1]); atomicStore(&out[0], 1u + u32(x != y)); }",
            1,
            2,
            1,
        ),
        (
            "an exchange of two words",
            "if g.x < 2u { let x = atomicExchange(&a[g.x], g.x + 1u); let y = atomicExchange(&a[1u - g.x], x); atomicMax(&out[0], y); }",
            1,
            2,
            1,
        ),
        (
            "a turn that only one of many may have",
            "let n = atomicAdd(&a[0], 1u); if n == 0u && g.x != 0u { atomicStore(&out[0], 1u); }",
            8,
            4,
            0,
        ),
    ] {
        let seen = left(body, size, groups, expected);
        assert!(matches!(seen, Err(ComputeError::Order(_))), "{name}: {seen:?}");
    }
}

/// Each body gives the same result in all orders of invocations, even if stores reach memory late.
// Lesson 216: passes with one outcome are green
#[test]
fn results_of_no_order() {
    for (name, body, size, groups, expected) in [
        ("a sum", "atomicAdd(&out[0], g.x);", 8, 4, 496),
        ("a maximum", "atomicMax(&out[0], g.x);", 4, 2, 7),
        (
            "an invocation that waits for another one of its workgroup",
            "if i == 0u { loop { if atomicLoad(&a[0]) == 1u { break; } } atomicStore(&out[0], 5u); } if i == 7u { atomicStore(&a[0], 1u); }",
            8,
            1,
            5,
        ),
        ("a ticket for each", "let n = atomicAdd(&a[0], 1u); atomicAdd(&out[0], n);", 2, 2, 6),
        (
            "a lock, whose words are its own",
            "loop { if atomicCompareExchangeWeak(&a[0], 0u, 1u).exchanged { break; } }
             atomicAdd(&out[0], 1u); atomicStore(&a[0], 0u);",
            1,
            3,
            3,
        ),
        (
            "a look-back over one word each, with value and status",
            "var sum = g.x + 1u;
             if g.x > 0u {
                 var word = 0u;
                 loop { word = atomicLoad(&a[g.x - 1u]); if (word & 1u) == 1u { break; } }
                 sum += word >> 1u;
             }
             atomicStore(&a[g.x], sum << 1u | 1u);
             if g.x + 1u == all { atomicStore(&out[0], sum); }",
            1,
            4,
            10,
        ),
        (
            "the last one to come, whoever it is",
            "let n = atomicAdd(&a[0], 1u); if n + 1u == all { atomicStore(&out[0], 7u); }",
            4,
            3,
            7,
        ),
        (
            "a comparison until it holds",
            "loop { let old = atomicLoad(&out[0]); if atomicCompareExchangeWeak(&out[0], old, old + 2u).exchanged { break; } }",
            2,
            2,
            8,
        ),
        (
            "a count in workgroup memory behind a barrier",
            "atomicAdd(&shared_count, 1u); workgroupBarrier(); if i == 0u { atomicMax(&out[0], atomicLoad(&shared_count)); }",
            8,
            2,
            8,
        ),
    ] {
        let seen = left(body, size, groups, expected);
        assert!(seen.is_ok(), "{name}: {}", seen.err().map_or_else(String::new, |e| e.to_string()));
    }
}

/// Each body has a race that occurs only in a certain order of three workgroups, or if one invocation pauses.
// Lesson 216
#[test]
fn races_of_an_order() {
    for (name, body, size, groups) in [
        (
            "a chain of three, whose last link is the second workgroup",
            "if g.x == 0u { d[60] = 42u; atomicStore(&a[0], 1u); }
             else if g.x == 2u { if atomicLoad(&a[0]) == 1u { atomicStore(&a[1], 1u); } }
             else if atomicLoad(&a[1]) == 1u { d[61] = d[60]; }",
            1,
            3,
        ),
        (
            "a place that two find free",
            "let n = atomicLoad(&a[0]); atomicStore(&a[0], n + 1u); d[32u + n] = g.x;",
            1,
            4,
        ),
        (
            "a lock that nobody takes",
            "if atomicLoad(&a[0]) == 0u { atomicStore(&a[0], 1u); d[60] = g.x; atomicStore(&a[0], 0u); }",
            1,
            2,
        ),
    ] {
        let seen = left(body, size, groups, 0);
        let Err(ComputeError::Violations(found)) = seen else { panic!("{name}: {seen:?}") };
        let races = [HazardKind::Race, HazardKind::Race];
        assert!(races.contains(&found.all[0].kind), "{name}: {found}");
        assert_eq!(found.all[0].variable, "d", "{name}: {found}");
    }
}

/// Tests subgroup operations in workgroups of many sizes. In workgroups of more than 4 invocations, the result of
/// `subgroupAdd(1u)` depends on the subgroup size.
// Lesson 218
#[test]
fn subgroups_in_workgroups_of_each_size() {
    for size in [1_u32, 2, 3, 5, 16, 31, 32, 33, 48, 63, 64, 96, 128, 256] {
        for (operation, expected) in [
            ("subgroupAdd(1u) * 0u + i", Some(size - 1)),
            ("subgroupMax(i) * 0u + u32(subgroupAny(true))", Some(1)),
            // The result is the size of the subgroup that begins here.
            ("subgroupAdd(1u)", None),
        ] {
            let text = format!(
                "@group(0) @binding(0) var<storage, read_write> out: array<atomic<u32>, 1>;
                 @compute @workgroup_size({size}) fn main(@builtin(local_invocation_index) i: u32) {{
                     atomicMax(&out[0], {operation});
                 }}"
            );
            let package = Package::from_source("m", text);
            let cpu = karat::unstable::executor::of(karat::Path::CPU).expect("it is always there");
            let passes = package.compute().with("out", Storage::new([0_u32])).on(cpu);
            let after = passes.dispatch("main", [1, 1, 1]).after("out").unrecorded();
            let seen = after.try_agrees_with([expected.unwrap_or(size.min(32))], Abs(0.0));
            match expected {
                // WebGPU has no devices with subgroups of one invocation.
                None if size > 4 => {
                    let Err(ComputeError::Order(order)) = seen else { panic!("{size}: {seen:?}") };
                    assert!(order.swap.starts_with("subgroups have "), "{size}: {order}");
                }
                _ => assert!(seen.is_ok() || size == 1, "{size}, {operation}: {seen:?}"),
            }
        }
    }
}

/// If a shader reads a struct, an array or a vector, it reads all of its members. So a read races with a write to any
/// member, even if the shader doesn't use this member.
// Lesson 220
#[test]
fn a_read_without_use_still_races() {
    let races = |body: &str| {
        let text = format!(
            "struct Pair {{ kept: u32, count: u32 }}
             struct Deep {{ pair: Pair, list: array<u32, 2>, m: mat2x2f }}
             @group(0) @binding(0) var<storage, read_write> pairs: array<Pair, 16>;
             @group(0) @binding(1) var<storage, read_write> deep: array<Deep, 16>;
             @group(0) @binding(2) var<storage, read_write> v: array<vec4f, 16>;
             @group(0) @binding(3) var<storage, read> given: array<Pair, 16>;
             @group(0) @binding(4) var<storage, read_write> out: array<u32, 16>;
             var<workgroup> w: array<Pair, 16>;
             fn kept(pair: Pair) -> u32 {{ return pair.kept; }}
             @compute @workgroup_size(16) fn main(@builtin(local_invocation_index) i: u32) {{
                 let next = (i + 1u) % 16u;
                 out[i] += pairs[i].kept + deep[i].pair.kept + u32(v[i].x) + given[i].kept + w[i].kept;
                 {body}
             }}"
        );
        let package = Package::from_source("m", text);
        let passes = package.compute();
        let passes = passes.with("deep", karat::fixture::Buffer::zeros(16 * 32));
        let passes = passes.with("v", karat::fixture::Buffer::zeros(256));
        let passes = passes.with("given", karat::fixture::Buffer::zeros(128));
        let passes = passes.with("pairs", karat::fixture::Buffer::zeros(128));
        let passes = passes.with("out", Storage::new([0_u32; 16])).dispatch("main", [1, 1, 1]);
        let found = karat::unstable::compute::violations(&passes).expect("it is valid").0;
        let found = found.iter().filter(|(one, _)| one.kind == HazardKind::Race);
        found.map(|(one, _)| one.element.clone()).collect::<Vec<_>>()
    };
    for (body, element) in [
        ("pairs[i].count = i; let other = pairs[next]; out[i] = other.kept;", "pairs[1].count"),
        ("pairs[i].count = i; out[i] = kept(pairs[next]);", "pairs[1].count"),
        ("pairs[i].count = i; let other = pairs[next].count;", "pairs[1].count"),
        ("pairs[i].count = i; _ = pairs[next].count;", "pairs[1].count"),
        ("w[i].count = i; let other = w[next]; out[i] = other.kept;", "w[1].count"),
        ("w[i].count = i; _ = w[next];", "w[1].count"),
        (
            "deep[i].list[1] = i; let other = deep[next]; out[i] = other.pair.kept;",
            "deep[1].list[1]",
        ),
        (
            "deep[i].m[1] = vec2f(1.0); let other = deep[next]; out[i] = other.pair.kept;",
            "deep[1].m",
        ),
        ("deep[i].pair.count = i; out[i] = kept(deep[next].pair);", "deep[1].pair.count"),
        ("v[i].w = 1.0; let other = v[next]; out[i] = u32(other.x);", "v[1].w"),
        ("v[i].w = 1.0; _ = v[next];", "v[1].w"),
    ] {
        let found = races(body);
        assert!(found.first().is_some_and(|own| own.starts_with(element)), "{body}: {found:?}");
    }
    for body in [
        // The shader reads a member instead of the whole structure.
        "pairs[i].count = i; let other = pairs[next].kept; out[i] = other;",
        "deep[i].list[1] = i; out[i] = deep[next].list[0];",
        "v[i].w = 1.0; let other = v[next].x; out[i] = u32(other);",
        // The invocation reads its own element, or reads after a barrier.
        "pairs[i].count = i; let other = pairs[i]; out[i] = other.kept;",
        "pairs[i].count = i; storageBarrier(); let other = pairs[next]; out[i] = other.kept;",
        // No invocation writes the element.
        "let other = given[next]; out[i] = other.kept;",
        "_ = pairs[next];",
    ] {
        assert_eq!(races(body), [""; 0], "{body}");
    }
}
