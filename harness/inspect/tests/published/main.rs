//! Kernels with known faults, modelled on published test suites. The kernels contain the graph patterns of Indigo (Liu,
//! Azami, Walters, Burtscher: *The Indigo Program-Verification Microbenchmark Suite*, 2022), the races of
//! `DataRaceBench` that are possible in WGSL, the locks, scopes and work stealing of `ScoR` (Kamath, George, Basu,
//! 2020), and the out-of-bounds indices that Vulkan's GPU-assisted validation finds. The text of all kernels is new. By
//! default, every 23rd kernel runs. `SUITES=whole` runs all kernels and prints the scores.

mod expressions;

use std::collections::BTreeSet;

use karat::check::HazardKind;
use karat::prelude::*;
use karat_inspect::hazards::Kind;

/// A kernel and its planted fault.
struct Kernel {
    name: String,
    text: String,
    /// The lines of the planted fault, counted from 1. These lines end in [`MARK`].
    lines: BTreeSet<usize>,
    planted: Planted,
}

/// The kind of a kernel's planted fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Planted {
    Nothing,
    /// A race: an update that isn't atomic, or a missing barrier.
    Race,
    /// An index outside of its array, because a guard is missing.
    Bounds,
}

/// The mark at the end of each line of a planted fault.
const MARK: &str = "// here";

impl Kernel {
    fn new(name: String, text: String, planted: Planted) -> Self {
        let marked = text.lines().enumerate().filter(|(_, line)| line.trim_end().ends_with(MARK));
        let lines = marked.map(|(at, _)| at + 1).collect();
        Self { name, text, lines, planted }
    }
}

/// The number of the graph's vertices.
const VERTICES: u32 = 100;

fn graph() -> [Vec<u32>; 3] {
    let edges = (0..VERTICES).flat_map(|v| [(v + 1) % VERTICES, (7 * v + 3) % VERTICES, 5]);
    [
        (0..=VERTICES).map(|v| 3 * v).collect(),
        edges.collect(),
        (0..VERTICES).map(|v| v * 37 % 101).collect(),
    ]
}

/// The invocations that process a vertex: one invocation, eight invocations, or a workgroup.
const MAPPINGS: [(&str, &str, &str, &str); 3] = [
    ("invocation", "g.x", "0u", "1u"),
    ("eight", "g.x / 8u", "l % 8u", "8u"),
    ("workgroup", "w.x", "l", "64u"),
];

/// A kernel over the edges of each vertex `v`. `each` is the code that runs for the edge from `v` to a vertex `u`.
/// `last` is the code that runs after all edges of `v`.
fn of_graph(
    (mapping, backwards, guarded): (usize, bool, bool),
    (number, is_atomic): (&str, bool),
    (before, each, last): (&str, &str, &str),
) -> String {
    let (_, vertex, lane, step) = MAPPINGS[mapping];
    let out = if is_atomic { format!("atomic<{number}>") } else { number.to_owned() };
    let edge = if backwards { "starts[v + 1u] - 1u - (e - starts[v])" } else { "e" };
    let data = if last.contains("data[v] =") { "read_write" } else { "read" };
    let guard = if guarded { "if v >= arrayLength(&starts) - 1u { return; }" } else { "" };
    let of_loop = if guarded { "" } else { MARK };
    format!(
        "@group(0) @binding(0) var<storage, read> starts: array<u32>;
@group(0) @binding(1) var<storage, read> targets: array<u32>;
@group(0) @binding(2) var<storage, {data}> data: array<{number}>;
@group(0) @binding(3) var<storage, read_write> out: array<{out}>;
@group(0) @binding(4) var<storage, read_write> list: array<u32>;
var<workgroup> partial: array<{number}, 64>;
@compute @workgroup_size(64) fn kernel(@builtin(global_invocation_id) g: vec3u,
    @builtin(workgroup_id) w: vec3u, @builtin(local_invocation_index) l: u32) {{
    let v = {vertex};
    {guard}
    {before}
    for (var e = starts[v] + {lane}; e < starts[v + 1u]; e += {step}) {{ {of_loop}
        let u = targets[{edge}];
        {each}
    }}
    {last}
}}
"
    )
}

/// A kernel that reduces a workgroup's values in a tree, to a sum or a maximum. Each `false` in `barriers` leaves out a
/// barrier.
fn tree(join: &str, then: &str, barriers: [bool; 2]) -> String {
    let barrier = |is: bool| if is { "workgroupBarrier();" } else { "" };
    let mark = if barriers == [true; 2] { "" } else { MARK };
    format!(
        "partial[l] = own; {mark}
    {}
    for (var k = 32u; k > 0u; k /= 2u) {{
        if l < k {{ partial[l] = {}; }} {mark}
        {}
    }}
    if l == 0u {{ {then} }} {mark}",
        barrier(barriers[0]),
        join.replace('?', "partial[l + k]").replace('!', "partial[l]"),
        barrier(barriers[1]),
    )
}

fn indigo() -> Vec<Kernel> {
    let mut all = Vec::new();
    let mut add = |name: String, text: String, planted| all.push(Kernel::new(name, text, planted));
    for (mapping, backwards, number) in (0..3).flat_map(|mapping| {
        [false, true].into_iter().flat_map(move |backwards| {
            ["u32", "i32"].into_iter().map(move |number| (mapping, backwards, number))
        })
    }) {
        let axes = format!(
            "{}, {number}, {}",
            MAPPINGS[mapping].0,
            if backwards { "backwards" } else { "forwards" }
        );
        let (right, one) = ((mapping, backwards, true), if number == "u32" { "1u" } else { "1" });
        let bare = (mapping, backwards, false);
        for condition in ["u > v", "data[u] > data[v]", "u > v && data[u] > data[v]"] {
            // Indigo's conditional edge: counts the edges for which a condition is true.
            let atomic = format!("if {condition} {{ atomicAdd(&out[0], {one}); }}");
            let plain = format!("if {condition} {{ out[0] += {one}; }} {MARK}");
            let name = |what: &str| format!("conditional edge, {axes}, {condition}: {what}");
            add(
                name("right"),
                of_graph(right, (number, true), ("", &atomic, "")),
                Planted::Nothing,
            );
            add(name("atomic"), of_graph(right, (number, false), ("", &plain, "")), Planted::Race);
            add(name("bounds"), of_graph(bare, (number, true), ("", &atomic, "")), Planted::Bounds);
            // Indigo's worklist: appends the vertices for which a condition is true.
            let push = format!(
                "if {condition} {{ let slot = u32(atomicAdd(&out[0], {one})); if slot < arrayLength(&list) {{ list[slot] = u; }} }}"
            );
            let plain = format!(
                "if {condition} {{ {MARK}
            let slot = u32(out[0]); {MARK}
            out[0] += {one}; {MARK}
            if slot < arrayLength(&list) {{ list[slot] = u; }} {MARK}
        }}"
            );
            let name = |what: &str| format!("worklist, {axes}, {condition}: {what}");
            add(name("right"), of_graph(right, (number, true), ("", &push, "")), Planted::Nothing);
            add(name("atomic"), of_graph(right, (number, false), ("", &plain, "")), Planted::Race);
        }
        let zero = if number == "u32" { "0u" } else { "0" };
        let own = format!("var own = {zero};");
        // Indigo's conditional vertex: finds the largest neighbour of all vertices.
        let most = "own = max(own, data[u]);";
        let name = |what: &str| format!("conditional vertex, {axes}: {what}");
        let last = |last: &str| match mapping {
            2 => {
                tree("max(!, ?)", last.trim_end_matches(MARK), [true; 2]).replace(
                    "if l == 0u {",
                    if last.ends_with(MARK) {
                        "if l == 0u { /* planted */"
                    } else {
                        "if l == 0u {"
                    },
                ) + if last.ends_with(MARK) { MARK } else { "" }
            }
            _ => last.to_owned(),
        };
        let of = |then: &str, is_atomic: bool, axes| {
            of_graph(axes, (number, is_atomic), (&own, most, &last(then)))
        };
        let atomic = if mapping == 2 {
            "atomicMax(&out[0], partial[0]);"
        } else {
            "atomicMax(&out[0], own);"
        };
        let value = if mapping == 2 { "partial[0]" } else { "own" };
        add(name("right"), of(atomic, true, right), Planted::Nothing);
        let guard = format!("if atomicLoad(&out[0]) < {value} {{ {atomic} }}");
        add(name("a guard, right in WGSL"), of(&guard, true, right), Planted::Nothing);
        let plain = format!("if out[0] < {value} {{ out[0] = {value}; }} {MARK}");
        add(name("guard"), of(&plain, false, right), Planted::Race);
        add(name("bounds"), of(atomic, true, bare), Planted::Bounds);
        // Indigo's pull: each vertex adds up its neighbours.
        let add_up = "own += data[u];";
        let name = |what: &str| format!("pull, {axes}: {what}");
        let write = |then: &str| match mapping {
            2 => tree("! + ?", &then.replace("own", "partial[0]"), [true; 2]),
            _ => then.to_owned(),
        };
        let lanes = mapping == 1;
        let into = if lanes { "atomicAdd(&out[v], own);" } else { "out[v] = own;" };
        let pull =
            |last: &str, is_atomic| of_graph(right, (number, is_atomic), (&own, add_up, last));
        add(name("right"), pull(&write(into), lanes), Planted::Nothing);
        if !lanes {
            let text = of_graph(
                right,
                (number, false),
                (&own, &format!("{add_up} {MARK}"), &write("data[v] = own;")),
            );
            let text = text.replace("data[v] = own;", &format!("data[v] = own; {MARK}"));
            let text = text
                .replace("data[v] = partial[0]; }", &format!("data[v] = partial[0]; }} {MARK}"));
            add(name("in place"), text, Planted::Race);
        }
        if mapping == 2 {
            for (what, barriers) in
                [("sync, first", [false, true]), ("sync, in the loop", [true, false])]
            {
                let last = tree("! + ?", "out[v] = partial[0];", barriers);
                add(name(what), pull(&last, false), Planted::Race);
            }
        }
        // Indigo's push: each vertex adds to its neighbours.
        let name = |what: &str| format!("push, {axes}: {what}");
        let atomic = "atomicAdd(&out[u], data[v]);";
        let plain = format!("out[u] += data[v]; {MARK}");
        add(name("right"), of_graph(right, (number, true), ("", atomic, "")), Planted::Nothing);
        add(name("atomic"), of_graph(right, (number, false), ("", &plain, "")), Planted::Race);
        add(name("bounds"), of_graph(bare, (number, true), ("", atomic, "")), Planted::Bounds);
    }
    // Indigo's path compression: follows the parents of parents.
    for (what, load, store, is_atomic) in [
        ("right", "atomicLoad(&out[?])", "atomicStore(&out[v], q)", true),
        ("race", "out[?]", "out[v] = q", false),
    ] {
        let mark = if is_atomic { "" } else { MARK };
        let out = if is_atomic { "atomic<u32>" } else { "u32" };
        let text = format!(
            "@group(0) @binding(3) var<storage, read_write> out: array<{out}>;
@compute @workgroup_size(64) fn kernel(@builtin(global_invocation_id) g: vec3u) {{
    let v = g.x;
    if v >= arrayLength(&out) {{ return; }}
    var p = {}; {mark}
    for (var k = 0u; k < 8u; k++) {{
        let q = {}; {mark}
        {store}; {mark}
        p = q;
    }}
}}
",
            load.replace('?', "v"),
            load.replace('?', "min(p, arrayLength(&out) - 1u)"),
        );
        let planted = if is_atomic { Planted::Nothing } else { Planted::Race };
        add(format!("path compression: {what}"), text, planted);
    }
    all
}

/// Pairs of kernel bodies: one body has a race, and the other has none. The bodies use the arrays `a`, `b` (read-only),
/// `c`, `t` (atomics) and `idx`, each with `n` elements, and the workgroup array `tile` with 64 elements.
const PAIRS: [(&str, &str, &str); 32] = [
    (
        "antidependence",
        "if i + 1u < n { a[i] = a[i + 1u] + 1; }",
        "if i + 1u < n { c[i] = a[i + 1u] + 1; }",
    ),
    (
        "true dependence",
        "if i + 1u < n { a[i + 1u] = a[i] + 1; }",
        "if i + 1u < n { c[i + 1u] = a[i] + 1; }",
    ),
    ("reduction missing", "c[0] += b[i];", "atomicAdd(&t[0], b[i]);"),
    ("private missing", "tile[0] = b[i]; c[i] = tile[0];", "var own = b[i]; c[i] = own;"),
    ("indirect access", "a[idx[i] / 2u] += 1;", "atomicAdd(&t[idx[i] / 2u], 1);"),
    ("last private", "c[0] = b[i];", "if i == n - 1u { c[0] = b[i]; }"),
    ("decrement", "c[0] -= 1;", "atomicSub(&t[0], 1);"),
    ("inner loop parallel", "c[i / 8u] += b[i];", "atomicAdd(&t[i / 8u], b[i]);"),
    (
        "no barrier",
        "tile[l] = b[i]; c[i] = tile[63u - l];",
        "tile[l] = b[i]; workgroupBarrier(); c[i] = tile[63u - l];",
    ),
    (
        "in place",
        "if i > 0u && i + 1u < n { a[i] = a[i - 1u] + a[i + 1u]; }",
        "if i > 0u && i + 1u < n { c[i] = a[i - 1u] + a[i + 1u]; }",
    ),
    ("halves overlap", "if i < 64u { a[i] = a[i + 32u]; }", "if i < 64u { a[i] = a[i + 64u]; }"),
    (
        "even and odd",
        "if i < n / 2u { a[i] = a[2u * i + 1u]; }",
        "if i < n / 2u { a[2u * i] = a[2u * i + 1u]; }",
    ),
    ("critical missing", "if b[i] > c[0] { c[0] = b[i]; }", "atomicMax(&t[0], b[i]);"),
    (
        "flag without data",
        "c[i] = a[0]; if i == 0u { a[0] = 7; atomicStore(&t[0], 1); }",
        "if i == 0u { atomicStore(&t[0], 1); } c[i] = atomicLoad(&t[0]);",
    ),
    (
        "barrier of one workgroup",
        "a[i] = b[i]; storageBarrier(); c[i] = a[(i + 64u) % n];",
        "a[i] = b[i]; storageBarrier(); c[i] = a[i / 64u * 64u + 63u - l];",
    ),
    ("histogram", "tile[u32(b[i]) % 16u] += 1; c[i] = 0;", "atomicAdd(&t[u32(b[i]) % 16u], 1);"),
    (
        "tree without barrier",
        "tile[l] = b[i]; workgroupBarrier(); for (var k = 32u; k > 0u; k /= 2u) { if l < k { tile[l] += tile[l + k]; } } c[i] = tile[l];",
        "tile[l] = b[i]; workgroupBarrier(); for (var k = 32u; k > 0u; k /= 2u) { if l < k { tile[l] += tile[l + k]; } workgroupBarrier(); } c[i] = tile[l];",
    ),
    ("equal writes", "c[0] = 7;", "if i == 0u { c[0] = 7; }"),
    (
        "transposed",
        "a[i % 8u * 16u + i / 8u % 16u] = a[i];",
        "c[i % 8u * 16u + i / 8u % 16u] = a[i];",
    ),
    ("rotated", "let x = a[i]; a[(i + 1u) % n] = x;", "let x = b[i]; a[(i + 1u) % n] = x;"),
    (
        "swapped",
        "let j = n - 1u - i; let x = a[i]; a[i] = a[j]; a[j] = x;",
        "let j = n - 1u - i; if i < j { let x = a[i]; a[i] = a[j]; a[j] = x; }",
    ),
    (
        "counter read",
        "atomicAdd(&t[0], 1); c[0] = atomicLoad(&t[0]);",
        "let old = atomicAdd(&t[0], 1); c[i] = old;",
    ),
    (
        "two of one tile",
        "tile[l / 2u] = b[i]; workgroupBarrier(); c[i] = tile[l / 2u];",
        "tile[l] = b[i]; workgroupBarrier(); c[i] = tile[l / 2u];",
    ),
    (
        "prefix in place",
        "tile[l] = b[i]; workgroupBarrier(); for (var k = 1u; k < 64u; k *= 2u) { if l >= k { tile[l] += tile[l - k]; } workgroupBarrier(); } c[i] = tile[l];",
        "tile[l] = b[i]; workgroupBarrier(); for (var k = 1u; k < 64u; k *= 2u) { var own = tile[l]; if l >= k { own += tile[l - k]; } workgroupBarrier(); tile[l] = own; workgroupBarrier(); } c[i] = tile[l];",
    ),
    (
        "lock",
        "if l == 0u { loop { if atomicExchange(&t[0], 1) == 0 { break; } } c[0] += b[i]; atomicStore(&t[0], 0); }",
        "if l == 0u { atomicAdd(&t[0], b[i]); }",
    ),
    (
        "last workgroup sums",
        "if l == 0u { a[i / 64u] = b[i]; if atomicAdd(&t[0], 1) == 1 { c[0] = a[0] + a[1]; } }",
        "if l == 0u { atomicStore(&t[1u + i / 64u], b[i]); if atomicAdd(&t[0], 1) == 1 { c[0] = atomicLoad(&t[1]) + atomicLoad(&t[2]); } }",
    ),
    (
        "work that two take",
        "let k = atomicLoad(&t[0]); atomicStore(&t[0], k + 1); c[u32(k) % n] = b[i];",
        "let k = atomicAdd(&t[0], 1); c[u32(k) % n] = b[i];",
    ),
    (
        "colours of neighbours",
        "c[i] = max(c[(i + 1u) % n], b[i]);",
        "c[i] = max(b[(i + 1u) % n], b[i]);",
    ),
    (
        "labels of components",
        "let p = min(a[i], a[i * 7u % n]); a[i * 7u % n] = p;",
        "atomicMin(&t[i * 7u % n], b[i]);",
    ),
    (
        "broadcast",
        "if l == 0u { tile[0] = b[i]; } c[i] = tile[0];",
        "if l == 0u { tile[0] = b[i]; } workgroupBarrier(); c[i] = tile[0];",
    ),
    (
        "broadcast again",
        "for (var k = 0u; k < 4u; k++) { if l == 0u { tile[0] = b[k]; } workgroupBarrier(); c[i] += tile[0]; }",
        "for (var k = 0u; k < 4u; k++) { if l == 0u { tile[0] = b[k]; } workgroupBarrier(); c[i] += tile[0]; workgroupBarrier(); }",
    ),
    (
        "ticket",
        "let k = atomicAdd(&t[0], 1); a[u32(k) / 2u % n] = b[i];",
        "let k = atomicAdd(&t[0], 1); a[u32(k) % n] = b[i];",
    ),
];

fn pairs() -> Vec<Kernel> {
    let of = |(name, racy, right): (&str, &str, &str)| {
        [
            Kernel::new(format!("{name}: racy"), body_of(racy, MARK), Planted::Race),
            Kernel::new(format!("{name}: right"), body_of(right, ""), Planted::Nothing),
        ]
    };
    PAIRS.into_iter().flat_map(of).collect()
}

/// The text of a kernel that runs `body` in each invocation. `mark` is added after each statement of `body`.
fn body_of(body: &str, mark: &str) -> String {
    let body = body.replace("; ", &format!("; {mark}\n    "));
    format!(
        "@group(0) @binding(0) var<storage, read_write> a: array<i32>;
@group(0) @binding(1) var<storage, read> b: array<i32>;
@group(0) @binding(2) var<storage, read_write> c: array<i32>;
@group(0) @binding(3) var<storage, read_write> t: array<atomic<i32>>;
@group(0) @binding(4) var<storage, read> idx: array<u32>;
@group(0) @binding(5) var<uniform> u: array<vec4i, 4>;
@group(0) @binding(6) var<uniform> m: mat2x2f;
@group(0) @binding(7) var image: texture_2d<i32>;
var<workgroup> tile: array<i32, 64>;
@compute @workgroup_size(64) fn kernel(@builtin(global_invocation_id) g: vec3u, @builtin(local_invocation_index) l: u32) {{
    let i = g.x;
    let n = 128u;
    {body} {mark}
}}
"
    )
}

/// Pairs of kernel bodies: one body uses an index outside of an array, and the other guards the index. Vulkan's
/// GPU-assisted validation finds such indices.
const OUTSIDE: [(&str, &str, &str); 16] = [
    ("read of a buffer", "c[i] = b[i + 1u];", "c[i] = b[min(i + 1u, n - 1u)];"),
    ("write to a buffer", "c[i + 1u] = b[i];", "if i + 1u < n { c[i + 1u] = b[i]; }"),
    ("atomic", "atomicAdd(&t[i + 1u], 1);", "atomicAdd(&t[(i + 1u) % n], 1);"),
    ("index of a buffer", "c[i] = b[idx[i] + 1u];", "c[i] = b[min(idx[i] + 1u, n - 1u)];"),
    ("below 0", "c[i] = b[i32(i) - 1];", "c[i] = b[max(i32(i) - 1, 0)];"),
    ("unsigned below 0", "c[i] = b[i - 1u];", "c[i] = b[max(i, 1u) - 1u];"),
    (
        "one iteration too many",
        "for (var k = 0u; k <= n; k++) { c[i] += b[k]; }",
        "for (var k = 0u; k < n; k++) { c[i] += b[k]; }",
    ),
    ("workgroup memory", "tile[l] = 1; c[i] = tile[l + 1u];", "tile[l] = 1; c[i] = tile[l];"),
    ("stride", "c[i] = b[2u * i];", "c[i] = b[2u * (i / 2u)];"),
    ("uniform buffer", "c[i] = u[i].x;", "c[i] = u[i % 4u].x;"),
    ("column of a matrix", "c[i] = i32(m[l][0]);", "c[i] = i32(m[l % 2u][0]);"),
    ("component of a vector", "c[i] = u[0][l];", "c[i] = u[0][l % 4u];"),
    (
        "array of a function",
        "var own = array(1, 2, 3, 4); c[i] = own[l];",
        "var own = array(1, 2, 3, 4); c[i] = own[l % 4u];",
    ),
    (
        "array of a function, written",
        "var own = array(1, 2, 3, 4); own[l] = 5; c[i] = own[0];",
        "var own = array(1, 2, 3, 4); own[l % 4u] = 5; c[i] = own[0];",
    ),
    (
        "texel",
        "c[i] = textureLoad(image, vec2u(i, 0u), 0).x;",
        "c[i] = textureLoad(image, vec2u(i, 0u) % textureDimensions(image), 0).x;",
    ),
    (
        "level of a texture",
        "c[i] = textureLoad(image, vec2u(0u), i32(l)).x;",
        "c[i] = textureLoad(image, vec2u(0u), i32(l % textureNumLevels(image))).x;",
    ),
];

/// Karat finds each index outside of an array, both with the test's data and with generated data. Karat reports no
/// guarded index.
#[test]
fn indices_outside_are_found() {
    for (name, outside, guarded) in OUTSIDE {
        for (body, is_planted) in [(outside, true), (guarded, false)] {
            let text = body_of(body, "");
            let package = Package::from_source("k", &*text);
            let mut passes = package.compute();
            for name in ["a", "b", "c", "t"].into_iter().filter(|name| uses(&text, name)) {
                passes = passes.with(name, Storage::new(vec![3_i32; 128]));
            }
            if uses(&text, "idx") {
                passes = passes.with("idx", Storage::new((0..128_u32).collect::<Vec<_>>()));
            }
            if uses(&text, "u") {
                passes = passes.with("u", Uniform::new([glam::IVec4::ONE; 4]));
            }
            if uses(&text, "m") {
                passes = passes.with("m", Uniform::new(glam::Mat2::IDENTITY));
            }
            if uses(&text, "image") {
                passes = passes.with("image", Texture::constant(glam::IVec4::ONE));
            }
            let (found, _) =
                karat::unstable::compute::violations(&passes.dispatch("kernel", [2, 1, 1]))
                    .unwrap_or_else(|error| panic!("{name}: {error}\n{text}"));
            let is_told = found.iter().any(|(one, _)| one.kind == HazardKind::OutOfRange);
            assert_eq!(is_told, is_planted, "{name}: {found:?}");
            // Without data, arrays have arbitrary lengths, so the guard includes the lengths of all arrays.
            let guard = "let all = vec4u(arrayLength(&a), arrayLength(&b), arrayLength(&c), arrayLength(&t));
    let least = min(min(all.x, all.y), min(all.z, all.w));
    let n = min(least, arrayLength(&idx));
    if i >= n { return; }";
            let text = text.replace("let n = 128u;", guard);
            let hazards = karat_inspect::hazards(&Package::from_source("k", &*text)).run();
            let hazards = hazards.unwrap_or_else(|error| panic!("{name}: {error}\n{text}"));
            let is_told = hazards.found.iter().any(|one| one.kind == Kind::OutOfRange);
            assert_eq!(is_told, is_planted, "{name}: {hazards}");
        }
    }
}

/// Checks if `SUITES=whole` requests all kernels.
fn is_whole() -> bool {
    std::env::var("SUITES").is_ok_and(|suites| suites == "whole")
}

/// All kernels, or every 23rd kernel. Each kernel has several variants. Because 23 isn't a multiple of a kernel's
/// number of variants, the selection includes different variants.
fn chosen(all: Vec<Kernel>) -> Vec<Kernel> {
    const SHARE: usize = 23;
    let wanted = |at: usize| is_whole() || at % SHARE == 1;
    all.into_iter().enumerate().filter(|(at, _)| wanted(*at)).map(|(_, kernel)| kernel).collect()
}

/// The counts of true positives, false positives, true negatives and false negatives.
#[derive(Debug, Default)]
struct Score {
    positive: [usize; 2],
    negative: [usize; 2],
    wrong: Vec<String>,
}

impl Score {
    fn add(&mut self, kernel: &Kernel, is_told: bool, what: &str) {
        let is_planted = kernel.planted != Planted::Nothing;
        let side = if is_told { &mut self.positive } else { &mut self.negative };
        side[usize::from(is_told != is_planted)] += 1;
        if is_told != is_planted {
            self.wrong.push(format!("{} {what}\n{}", kernel.name, kernel.text));
        }
    }
}

/// The line numbers in positions such as `file:12:5`.
fn lines<'p>(places: impl Iterator<Item = &'p str>) -> BTreeSet<usize> {
    places.filter_map(|place| place.rsplit(':').nth(1)?.parse().ok()).collect()
}

/// With the test's data in the buffers, Karat finds each planted fault at its lines, and reports nothing else.
#[test]
fn planted_faults_are_found_with_data() {
    let [starts, targets, data] = graph();
    let (mut score, mut astray) = (Score::default(), Vec::new());
    let kernels = kernels();
    for kernel in &kernels {
        let package = Package::from_source("k", &*kernel.text);
        let has = |name: &str| kernel.text.contains(&format!("> {name}: "));
        let signed = kernel.text.contains("i32");
        let words = |all: &[u32]| match signed {
            true => Storage::new(all.iter().map(|x| x.cast_signed()).collect::<Vec<_>>()),
            false => Storage::new(all.to_vec()),
        };
        let mut passes = package.compute();
        let mut groups = 2;
        if kernel.text.contains("let n = 128u") {
            for name in ["a", "b", "c", "t"] {
                let own: Vec<u32> = (0..128).map(|x| x * 37 % 101).collect();
                if uses(&kernel.text, name) {
                    passes = passes.with(name, words(&own));
                }
            }
            if uses(&kernel.text, "idx") {
                passes = passes.with("idx", Storage::new((0..128_u32).collect::<Vec<_>>()));
            }
        } else {
            if has("starts") {
                passes = passes.with("starts", Storage::new(starts.clone()));
                passes = passes.with("targets", Storage::new(targets.clone()));
            }
            if uses(&kernel.text, "data") {
                passes = passes.with("data", words(&data));
            }
            if uses(&kernel.text, "list") {
                passes = passes.with("list", Storage::new(vec![0_u32; 300]));
            }
            let parents: Vec<u32> = (0..VERTICES).map(|v| v / 2).collect();
            if uses(&kernel.text, "out") {
                passes = passes.with("out", words(&parents));
            }
            groups = match () {
                () if kernel.text.contains("let v = w.x") => 104,
                () if kernel.text.contains("/ 8u;") => 13,
                () => 2,
            };
        }
        let passes = passes.dispatch("kernel", [groups, 1, 1]);
        let (found, watched) = karat::unstable::compute::violations(&passes)
            .unwrap_or_else(|error| panic!("{}: {error}\n{}", kernel.name, kernel.text));
        assert!(watched.invocations > 0, "{}", kernel.name);
        let found: Vec<_> =
            found.into_iter().map(|(one, _)| one).filter(|one| one.kind.fails()).collect();
        let is_it = |kind: HazardKind| match kernel.planted {
            Planted::Bounds => kind == HazardKind::OutOfRange,
            _ => kind != HazardKind::OutOfRange,
        };
        // An index outside of an array that changes no result doesn't fail a test, so Karat may or may not report the
        // missing guard.
        let told = found.iter().any(|one| is_it(one.kind));
        if kernel.planted != Planted::Bounds {
            score.add(kernel, told, &format!("{found:?}"));
        }
        for one in found.iter().filter(|one| is_it(one.kind)) {
            let own = lines(one.accesses.iter().map(|access| &*access.place));
            if !own.is_subset(&kernel.lines) {
                astray.push(format!(
                    "{}: {own:?} of {:?}\n{}",
                    kernel.name, kernel.lines, kernel.text
                ));
            }
        }
    }
    println!(
        "with data, by kernel: {:?}, {:?} of {}",
        score.positive,
        score.negative,
        kernels.len()
    );
    assert!(score.wrong.is_empty(), "{}", score.wrong.join("\n"));
    assert!(astray.is_empty(), "told by other lines: {}", astray.join("\n"));
}

/// Without a test, Karat reports no race in a kernel without races, and finds most of the planted races.
#[test]
fn planted_races_are_found_without_a_test() {
    let (mut score, mut guards) = (Score::default(), [0, 0]);
    let kernels = kernels();
    for kernel in &kernels {
        let package = Package::from_source("k", &*kernel.text);
        let hazards = karat_inspect::hazards(&package)
            .run()
            .unwrap_or_else(|error| panic!("{}: {error}", kernel.name));
        let races = || {
            hazards.found.iter().filter(|one| matches!(one.kind, Kind::Race | Kind::EqualWrites))
        };
        if kernel.planted == Planted::Bounds {
            // The finding is at the loop without the guard. A read outside of an array that changes no result isn't a
            // finding, so such kernels don't count.
            let outside = hazards.found.iter().filter(|one| one.kind == Kind::OutOfRange);
            let is_told = !lines(outside.map(|one| &*one.location)).is_disjoint(&kernel.lines);
            guards[usize::from(is_told)] += 1;
            assert_eq!(races().count(), 0, "{}: {hazards}", kernel.name);
            continue;
        }
        let is_told = races().count() > 0;
        score.add(kernel, is_told, &format!("{hazards}"));
    }
    println!(
        "without a test, by kernel: {:?}, {:?} of {}",
        score.positive,
        score.negative,
        kernels.len()
    );
    println!("missing guards, not told and told: {guards:?}");
    let [found, alarms] = score.positive;
    let [_, missed] = score.negative;
    let missing = score.wrong.join("\n");
    assert_eq!(alarms, 0, "{missing}");
    // The goal is 85 % of the planted races.
    assert!(100 * found >= 85 * (found + missed), "{found} of {}: {missing}", found + missed);
}

fn kernels() -> Vec<Kernel> {
    chosen(indigo()).into_iter().chain(chosen(pairs())).collect()
}

/// Checks if the entry point `kernel` in `text` uses the variable `name`.
fn uses(text: &str, name: &str) -> bool {
    let body = text.split("fn kernel").nth(1).unwrap_or_default();
    let is_word = |c: char| c.is_alphanumeric() || c == '_';
    body.split(|c: char| !is_word(c)).any(|word| word == name)
}
