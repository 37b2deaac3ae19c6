//! Tests that the sanitizer reports compute passes with races, wrong indices, or results that depend on the order of
//! invocations. On a driver, such a pass may give the right result by chance.

use karat::check::HazardKind;
use karat::compute::ComputeError;
use karat::prelude::*;
use karat::unstable::compute::Violation;

const HEAD: &str = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
@group(0) @binding(1) var<storage, read_write> sums: array<u32>;
var<workgroup> tile: array<u32, 64>;
@compute @workgroup_size(64) fn main(@builtin(local_invocation_index) i: u32,
    @builtin(global_invocation_id) id: vec3u, @builtin(workgroup_id) group: vec3u) {
";

/// Runs `body` in `groups` workgroups of 64 invocations. Returns the violations that the sanitizer reports.
fn races(body: &str, groups: u32) -> Vec<Violation> {
    let package = Package::from_source("races", format!("{HEAD}{body}\n}}\n"));
    let mut passes = package.compute().with("data", Storage::new((0..64 * groups).map(|i| i + 1)));
    let has_sums = body.contains("sums");
    if has_sums {
        passes = passes.with("sums", Storage::new(vec![0_u32; 64 * groups as usize]));
    }
    let after =
        passes.dispatch("main", [groups, 1, 1]).after(if has_sums { "sums" } else { "data" });
    match after.unrecorded().try_satisfies("is anything", |_: &[u32]| true) {
        Ok(_) => Vec::new(),
        Err(ComputeError::Violations(found)) => {
            let message = found.to_string();
            for race in found.all.iter().take(2) {
                assert!(race.accesses.iter().all(|access| access.place.starts_with("<races>:")));
                let says = |access: &karat::unstable::compute::ViolationAccess| {
                    message.contains(&format!("{} {}", access.invocation, access.does))
                };
                assert!(race.accesses.iter().all(says), "{message}");
            }
            found.all
        }
        Err(other) => panic!("{other}\n{body}"),
    }
}

/// The first violation in `body`: its kind, the element of the array, and a text for each of the two accesses, with its
/// line in `body`.
fn first(body: &str, groups: u32) -> (HazardKind, String, [String; 2]) {
    let races = races(body, groups);
    let race = races.first().unwrap_or_else(|| panic!("the fault was not seen:\n{body}"));
    let line = |place: &str| -> usize {
        let line = place.rsplit(':').nth(1).expect("file:line:column");
        line.parse::<usize>().expect("a line") - HEAD.lines().count()
    };
    let access = |at: usize| {
        let access = &race.accesses[at];
        let invocation = access.invocation.replace(", 0, 0)", ")");
        format!("{} {invocation} {}", line(&access.place), access.does)
    };
    (race.kind, race.element.clone(), [access(0), access(1)])
}

/// A prefix sum over a workgroup (Hillis and Steele) needs two barriers in each iteration. The test removes one of
/// them.
// Lesson 215
#[test]
fn a_scan_without_its_second_barrier() {
    let scan = |second: &str| {
        format!(
            "tile[i] = data[id.x];
workgroupBarrier();
for (var step = 1u; step < 64u; step *= 2u) {{
    let left = select(0u, tile[i - step], i >= step);
    {second}
    tile[i] += left;
    workgroupBarrier();
}}
data[id.x] = tile[i];"
        )
    };
    assert!(races(&scan("workgroupBarrier();"), 2).is_empty());
    let (kind, element, [one, other]) = first(&scan(""), 2);
    assert_eq!((kind, &*element), (HazardKind::Race, "tile[0]"));
    assert_eq!(one, "4 local (1) of workgroup (0) reads 1");
    assert!(other.starts_with("6 local (0) of workgroup (0) writes "), "{other}");
    // Only the barrier at the end of the iteration is missing. There is still a barrier between both lines.
    let late = scan("workgroupBarrier();").replace("left;\n    workgroupBarrier();", "left;");
    let package = Package::from_source("races", format!("{HEAD}{late}\n}}\n"));
    let compute = package.compute().with("data", Storage::new((0..64_u32).map(|i| i + 1)));
    let after = compute.dispatch("main", [1, 1, 1]).after("data").unrecorded();
    let seen = after.try_satisfies("is anything", |_: &[u32]| true).expect_err("it races");
    assert!(seen.to_string().contains("at the end of the loop or of the function, too"), "{seen}");
}

// Lesson 215
#[test]
fn a_reduction_across_workgroups() {
    let reduce = "tile[i] = data[id.x];
workgroupBarrier();
if i == 0u { for (var k = 0u; k < 64u; k++) { sums[0] += tile[k]; } }";
    let (kind, element, accesses) = first(reduce, 2);
    assert_eq!((kind, &*element), (HazardKind::Race, "sums[0]"));
    assert!(accesses[1].starts_with("3 local (0) of workgroup (1)"), "{accesses:?}");
    assert!(races(&reduce.replace("sums[0]", "sums[group.x]"), 2).is_empty());
}

/// One invocation of each workgroup reads a counter by `atomicLoad` and uses the value later. In between, an invocation
/// of another workgroup may change the counter.
#[test]
fn a_count_that_another_workgroup_changes_meanwhile() {
    let package = |takes: &str, fills: &str| {
        let text = format!(
            "@group(0) @binding(0) var<storage, read_write> count: atomic<u32>;
             @group(0) @binding(1) var<storage, read_write> list: array<u32, 16>;
             @compute @workgroup_size(64) fn main(@builtin(local_invocation_index) i: u32,
                 @builtin(workgroup_id) group: vec3u) {{
                 if i == 0u {{
                     let n = {takes};
                     {fills}
                 }}
             }}"
        );
        Package::from_source("list", text)
    };
    let counted = |package: &Package, list: bool| {
        let compute = package.compute().with("count", Storage::new([0_u32]));
        let compute = if list { compute.with("list", Storage::new([9_u32; 16])) } else { compute };
        let after = compute.dispatch("main", [6, 1, 1]).after("count").unrecorded();
        after.try_agrees_with([6_u32], Abs(0.0))
    };
    let (stale, whole) = ("atomicLoad(&count)", "atomicAdd(&count, 1u)");
    let fills = "list[n] = group.x;";
    counted(&package(whole, fills), true).expect("each has a place of its own");
    let error = counted(&package(stale, &format!("atomicStore(&count, n + 1u); {fills}")), true);
    let Err(ComputeError::Violations(found)) = error else { panic!("{error:?}") };
    let [race] = &found.all[..] else { panic!("{found}") };
    assert_eq!(race.kind, HazardKind::Race);
    assert!(
        race.element.starts_with("list[")
            && race.accesses[0].invocation != race.accesses[1].invocation,
        "{found}"
    );
    // Without the list there is no race, but the count is too low.
    let error = counted(&package(stale, "atomicStore(&count, n + 1u);"), false);
    let Err(ComputeError::Order(order)) = error else { panic!("{error:?}") };
    assert_eq!(order.swap, "the invocations take turns, and each runs up to its next atomic");
    assert!(order.to_string().contains("`atomicLoad(&count)` gives local (0, 0, 0)"), "{order}");
    // The report lists each of the six loads and stores, in the order of the failing run.
    assert_eq!(order.turns[0].matches("`atomic").count(), 12, "{order}");
}

/// One invocation sets a flag before it writes the value that the flag announces. Another invocation may see the flag
/// and read the old value.
#[test]
fn a_word_that_is_published_before_it_is_written() {
    let head = "@group(0) @binding(0) var<storage, read_write> flag: atomic<u32>;
        @group(0) @binding(1) var<storage, read_write> value: atomic<u32>;
        @group(0) @binding(2) var<storage, read_write> got: array<u32, 4>;\n";
    let flagged = |writes: [&str; 2]| {
        let [first, second] = writes;
        format!("{first} {second}")
    };
    let (publish, write) = ("atomicStore(&flag, 1u);", "atomicStore(&value, 42u);");
    // One workgroup publishes and another reads, or two invocations of one workgroup do.
    let entries = |writes: &str| {
        let reads = "got[0] = 42u; if atomicLoad(&flag) == 1u { got[0] = atomicLoad(&value); }";
        format!(
            "{head}@compute @workgroup_size(1) fn groups(@builtin(workgroup_id) w: vec3u) {{
                if w.x == 0u {{ {writes} }} else if w.x == 1u {{ {reads} }}
            }}
            @compute @workgroup_size(2) fn own(@builtin(local_invocation_index) i: u32) {{
                if i == 0u {{ {writes} }} else {{ {reads} }}
            }}
            @compute @workgroup_size(1) fn last(@builtin(workgroup_id) w: vec3u) {{
                {last}
            }}",
            last = match writes.starts_with(publish) {
                // The workgroup increments the counter before it writes its part.
                true =>
                    "let n = atomicAdd(&flag, 1u); atomicAdd(&value, w.x + 1u); if n == 3u { got[0] = 32u + atomicLoad(&value); }",
                false =>
                    "atomicAdd(&value, w.x + 1u); let n = atomicAdd(&flag, 1u); if n == 3u { got[0] = 32u + atomicLoad(&value); }",
            }
        )
    };
    let run = |text: String, entry: &str, groups: u32, value: u32| {
        let package = Package::from_source("flag", text);
        let passes = package.compute().with("flag", Storage::new([0_u32]));
        let passes =
            passes.with("value", Storage::new([value])).with("got", Storage::new([9_u32; 4]));
        let after = passes.dispatch(entry, [groups, 1, 1]).after("got").unrecorded();
        after.try_satisfies("is whole", |got: &[u32]| got[0] == 42)
    };
    for (entry, groups, value) in [("groups", 2, 7), ("own", 1, 7), ("last", 4, 0)] {
        for (writes, is_relaxed) in [([publish, write], false), ([write, publish], true)] {
            let wrong = run(entries(&flagged(writes)), entry, groups, value);
            let Err(ComputeError::Order(order)) = wrong else { panic!("{entry}: {wrong:?}") };
            let operation = order.operation.as_deref().expect("a load gives something else");
            assert!(operation.starts_with("`atomic"), "{entry}: {operation}");
            // The shader fails even in the right order: no atomic of WGSL orders other accesses.
            let told = order.to_string();
            assert_eq!(told.contains("WGSL's atomics are relaxed"), is_relaxed, "{entry}: {told}");
            let late = "take effect late";
            assert_eq!(order.swap.contains(late), is_relaxed, "{entry}: {}", order.swap);
        }
    }
    // For the invocations of a workgroup, a barrier orders the accesses.
    let text = format!(
        "{head}@compute @workgroup_size(2) fn own(@builtin(local_invocation_index) i: u32) {{
            if i == 0u {{ {write} }}
            storageBarrier();
            if i == 0u {{ {publish} }} else {{
                got[0] = 42u; if atomicLoad(&flag) == 1u {{ got[0] = atomicLoad(&value); }}
            }}
        }}"
    );
    run(text, "own", 1, 7).expect("it is there by then");
}

#[test]
fn two_writes_of_one_element() {
    let (kind, element, [one, other]) = first("data[i / 2u] = i;", 1);
    assert_eq!((kind, &*element), (HazardKind::Race, "data[0]"));
    let expected =
        ["1 local (0) of workgroup (0) writes 0", "1 local (1) of workgroup (0) writes 1"];
    assert_eq!([one, other], expected);
    assert_eq!(first("data[i / 2u] = 5u;", 1).0, HazardKind::EqualWrites);
}

#[test]
fn a_histogram_without_atomics() {
    let (kind, element, _) = first("sums[data[id.x] % 4u] += 1u;", 1);
    assert_eq!((kind, &*element), (HazardKind::Race, "sums[1]"), "each reads, then each writes");
    let atomics = "@group(0) @binding(0) var<storage, read_write> counts: array<atomic<u32>, 4>;
        @compute @workgroup_size(64) fn main(@builtin(local_invocation_index) i: u32) {
            atomicAdd(&counts[i % 4u], 1u);
        }";
    let package = Package::from_source("m", atomics);
    let passes = package.compute().with("counts", Storage::new([0_u32; 4]));
    passes.dispatch("main", [1, 1, 1]).after("counts").agrees_with([16_u32; 4], Abs(0.0));
}

// Lesson 215
#[test]
fn barriers_that_some_invocations_miss() {
    let reduce = |inside: &str, behind: &str| {
        format!(
            "tile[i] = data[id.x];\nif i < 32u {{ {inside} tile[i] += 1u; }}\n{behind}\ndata[id.x] = tile[i];"
        )
    };
    let (kind, _, [one, other]) = first(&reduce("workgroupBarrier();", ""), 1);
    assert_eq!(kind, HazardKind::Barrier);
    assert_eq!(one, "2 local (0) of workgroup (0) reaches it");
    assert_eq!(other, "2 local (32) of workgroup (0) takes another branch here");
    assert!(races(&reduce("", "workgroupBarrier();"), 1).is_empty());
    let rounds =
        "for (var k = 0u; k < data[id.x]; k++) { workgroupBarrier(); }\ndata[id.x] += 100u;";
    let (kind, _, [one, other]) = first(rounds, 1);
    assert_eq!(kind, HazardKind::Barrier);
    assert_eq!(one, "1 local (1) of workgroup (0) reaches it", "the first has one iteration");
    assert_eq!(other, "1 local (0) of workgroup (0) takes another branch here");
    let behind = |parts: &str| format!("{parts}\n\nworkgroupBarrier();\ndata[id.x] += 1u;");
    let inside = |parts: &str| format!("{parts}\ndata[id.x] += 1u;");
    // The report names the line at which the invocations diverged, however far it is from the barrier.
    for (body, line) in [
        (behind("if i > 3u { return; }"), 2),
        (behind("if i > 3u {\ndata[id.x] = 1u;\n} else {\nreturn; }"), 5),
        (behind("switch i {\ncase 7u: { return; }\ndefault: {} }"), 3),
        (behind("for (var k = 0u; k < 3u; k++) {\nif k == i { return; } }"), 3),
        (inside("switch i % 3u {\ncase 1u: {\nworkgroupBarrier(); }\ndefault: {} }"), 2),
        (inside("switch i % 3u {\ncase 1u: {}\ndefault: {\nworkgroupBarrier(); } }"), 2),
        (
            inside(
                "var k = 0u;\nloop {\nworkgroupBarrier();\ncontinuing {\nk++;\nbreak if k > i; } }",
            ),
            7,
        ),
    ] {
        let parts = &body;
        let (kind, _, [_, other]) = first(&format!("\n{body}"), 1);
        assert_eq!(kind, HazardKind::Barrier);
        assert!(
            other.starts_with(&format!("{line} ")) && other.ends_with("takes another branch here"),
            "{parts}: {other}"
        );
    }
}

/// The sanitizer reports a hazard for each workgroup that reads workgroup memory before writing it, but the check
/// doesn't fail, because WGSL sets this memory to 0.
#[test]
fn workgroup_memory_that_is_read_before_it_is_written() {
    let text = "var<workgroup> tile: array<vec2f, 8>;
        var<workgroup> count: atomic<u32>;
        @group(0) @binding(0) var<storage, read_write> data: array<f32>;
        @compute @workgroup_size(8) fn early(@builtin(global_invocation_id) id: vec3u,
            @builtin(local_invocation_index) i: u32) {
            if i < 7u { tile[i].y = data[id.x]; }
            workgroupBarrier();
            data[id.x] = tile[i].y;
        }
        @compute @workgroup_size(8) fn counts(@builtin(global_invocation_id) id: vec3u) {
            data[id.x] = f32(atomicAdd(&count, 1u));
        }
        @compute @workgroup_size(8) fn right(@builtin(global_invocation_id) id: vec3u,
            @builtin(local_invocation_index) i: u32) {
            tile[i] = vec2f(data[id.x]);
            if i == 0u { atomicStore(&count, 0u); }
            workgroupBarrier();
            atomicAdd(&count, 1u);
            data[id.x] = 2.0 * tile[7u - i].y;
        }";
    let package = Package::from_source("tiles", text);
    let found = |entry: &str| {
        let passes = package.compute().with("data", Storage::new([1.0_f32; 16]));
        let passes = passes.dispatch(entry, [2, 1, 1]);
        let (found, _) = karat::unstable::compute::violations(&passes).expect("valid");
        passes.after("data").unrecorded().satisfies("is anything", |_: &[f32]| true);
        found
    };
    let early = found("early");
    let [(one, message)] = &early[..] else { panic!("{early:?}") };
    assert_eq!((one.kind, &*one.element, one.count), (HazardKind::Unwritten, "tile[7].y", 2));
    assert_eq!(one.accesses[0].place, "<tiles>:8:26");
    assert_eq!(one.accesses[0].invocation, "local (7, 0, 0) of workgroup (0, 0, 0)");
    assert!(message.contains("no invocation has written yet"), "{message}");
    let counts = found("counts");
    assert_eq!((counts[0].0.kind, &*counts[0].0.element), (HazardKind::Unwritten, "count"));
    assert_eq!(found("right").len(), 0);
}

/// A blur has a race if it reads and writes the same buffer. It has no race if it writes a second buffer.
#[test]
fn a_ping_pong_buffer_used_as_one() {
    let blur = |to: &str| {
        format!("let left = data[max(id.x, 1u) - 1u];\n{to}[id.x] = (left + data[id.x]) / 2u;")
    };
    let (kind, element, [one, other]) = first(&blur("data"), 1);
    assert_eq!((kind, &*element), (HazardKind::Race, "data[0]"));
    assert_eq!(one, "1 local (1) of workgroup (0) reads 1");
    assert_eq!(other, "2 local (0) of workgroup (0) writes 1");
    assert!(races(&blur("sums"), 1).is_empty());
}

/// The shader reverses an array without a barrier: `w[i] = d[i]; d[i] = w[63 - i];`. On the engine the result is right,
/// because the engine runs invocations in lockstep. Drivers don't guarantee this result.
#[test]
fn a_reversal_without_a_barrier() {
    let text =
        |barrier: &str| format!("tile[i] = data[id.x];\n{barrier}\ndata[id.x] = tile[63u - i];");
    let (kind, element, accesses) = first(&text(""), 1);
    assert_eq!((kind, &*element), (HazardKind::Race, "tile[63]"));
    assert_eq!(accesses[0], "1 local (63) of workgroup (0) writes 64");
    assert_eq!(accesses[1], "3 local (0) of workgroup (0) reads 64");
    assert!(races(&text("workgroupBarrier();"), 1).is_empty());
    // A barrier for another address space doesn't order these accesses.
    assert_eq!(first(&text("storageBarrier();"), 1).1, "tile[63]");
}

/// A violation occurs if a blur reads one element beyond the end of an array and uses the value. If the blur ignores
/// the value, there is no violation.
#[test]
fn an_index_one_beyond_the_end() {
    let blur = |right: &str| format!("let right = {right};\nsums[id.x] = data[id.x] + right;");
    let violations = races(&blur("data[id.x + 1u]"), 2);
    let [Violation { kind: HazardKind::OutOfRange, count: 1, accesses, headline, .. }] =
        &*violations
    else {
        panic!("{violations:?}");
    };
    assert!(headline.contains("reads outside of `data`, and"), "{headline}");
    assert_eq!(accesses[0].invocation, "local (63, 0, 0) of workgroup (1, 0, 0)");
    assert_eq!(accesses[0].does, "uses index 128, but `data` has 128 elements");
    assert!(accesses[0].place.starts_with(&format!("<races>:{}:", HEAD.lines().count() + 1)));
    assert!(races(&blur("select(0u, data[id.x + 1u], id.x < 127u)"), 2).is_empty());
    // The element changes the result only if it is a certain number.
    let kind = races(&blur("select(1u, 2u, data[id.x + 1u] == 3u)"), 2);
    assert_eq!(kind[0].kind, HazardKind::OutOfRange);
    // One driver drops the write, and another driver writes the last element.
    let tail = "if id.x == 5u { data[id.x + 123u] = 7u; }";
    assert_eq!(races(tail, 2)[0].kind, HazardKind::OutOfRange);
    assert!(races("if id.x == 5u { data[id.x + 122u] = 7u; }", 2).is_empty());
    for (constant, kinds) in [("128", &[HazardKind::OutOfRange][..]), ("127", &[])] {
        let seen = races(&format!("if id.x == 5u {{ data[{constant}] = 7u; }}"), 2);
        assert_eq!(seen.iter().map(|one| one.kind).collect::<Vec<_>>(), kinds, "{constant}");
    }
    // Clamping moves the writes in the tail to an element that already has the value.
    let tail = "data[min(id.x, 200u) + 64u] = 7u;";
    let kinds: Vec<_> = races(tail, 2).iter().map(|one| (one.kind, one.count)).collect();
    assert_eq!(kinds, [(HazardKind::OutOfRange, 64)]);
    let reading = races("data[id.x + 1u] += 1u;", 1);
    assert_eq!(reading.len(), 1, "one statement has one violation: {reading:?}");
}

/// The product in the index exceeds 32 bits and wraps around to a valid index, so the pass reads a wrong element of the
/// array.
#[test]
fn an_index_that_wraps_around() {
    let row = |stride: &str| {
        format!(
            "let row = {stride} * id.x;\nif i == 0u {{ sums[id.x] = data[row % 7u] + data[row + id.x]; }}"
        )
    };
    let violations = races(&row("67108864u"), 2);
    let [Violation { kind: HazardKind::Wrapped, count: 1, accesses, .. }] = &*violations else {
        panic!("{violations:?}");
    };
    assert_eq!(accesses[0].invocation, "local (0, 0, 0) of workgroup (1, 0, 0)");
    assert_eq!(accesses[0].does, "computes index 4294967360, but accesses element 64");
    assert!(accesses[0].place.starts_with(&format!("<races>:{}:", HEAD.lines().count() + 2)));
    assert!(races(&row("0u"), 2).is_empty());
}

/// The test sets the override that gives the workgroup's size. The sanitizer still finds the race between the
/// invocations.
#[test]
fn a_size_that_is_an_override() {
    let text = "override WIDTH = 64u;
        @group(0) @binding(0) var<storage, read_write> data: array<u32>;
        @compute @workgroup_size(WIDTH) fn main(@builtin(global_invocation_id) id: vec3u) { data[0] = id.x; }";
    let package = Package::from_source("m", text);
    let passes = package.compute().with("data", Storage::new([7_u32])).with_override("WIDTH", 32.0);
    let after = passes.dispatch("main", [2, 1, 1]).after("data").unrecorded();
    let Err(ComputeError::Violations(found)) = after.try_satisfies("is any", |_: &[u32]| true)
    else {
        panic!("each writes");
    };
    let who = &found.all[0].accesses[1].invocation;
    assert_eq!(who, "local (1, 0, 0) of workgroup (0, 0, 0)");
}

/// The invocations race on `data[0]`. The sanitizer finds this race although one invocation then waits in a loop for
/// the other invocation.
#[test]
fn a_loop_that_waits_hides_no_race() {
    let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
        @group(0) @binding(1) var<storage, read_write> flag: atomic<u32>;
        @compute @workgroup_size(2) fn main(@builtin(local_invocation_index) i: u32) {
            data[0] = i;
            if i == 0u { loop { if atomicLoad(&flag) == 1u { break; } } } else { atomicStore(&flag, 1u); }
        }";
    let package = Package::from_source("m", text);
    let passes =
        package.compute().with("data", Storage::new([7_u32])).with("flag", Storage::new([0_u32]));
    let after = passes.dispatch("main", [1, 1, 1]).after("data").unrecorded();
    let waits = after.try_satisfies("is any", |_: &[u32]| true).expect_err("it waits");
    assert!(waits.to_string().contains("has a race on `data[0]`: two writes"), "{waits}");
}

/// Checks `body` while accepting races in the way that `how` names. Returns the failure's message, or an empty text if
/// the check passes.
fn accepting(how: &str, body: &str) -> String {
    let package = Package::from_source("races", format!("{HEAD}{body}\n}}\n"));
    let passes = package.compute().with("data", Storage::new(vec![0_u32; 64]));
    let passes = passes.dispatch("main", [1, 1, 1]);
    let passes = match how {
        "equal" => passes.accept_equal_writes("data", "a flag"),
        "race" => passes.accept_race("data", "any will do"),
        "typo" => passes.accept_race("daat", "any will do"),
        "tile" => passes.accept_race("tile", "any will do"),
        "none" => passes.accept_race("", "any will do"),
        _ => passes.accept_race("data", " "),
    };
    let any = passes.after("data").unrecorded().try_satisfies("is anything", |_: &[u32]| true);
    any.err().map_or_else(String::new, |error| error.to_string())
}

/// If a test accepts a race, it must give a reason, and the race must occur. The acceptance covers only races on the
/// named variable.
#[test]
fn races_that_are_accepted() {
    assert_eq!(accepting("race", "data[0] = i + 1u;"), "");
    assert_eq!(accepting("equal", "data[0] = 1u;"), "");
    for (how, body, part) in [
        ("equal", "data[0] = i + 1u;", "two writes that nothing orders"),
        (
            "equal",
            "data[i] = i + 1u;",
            "isn't needed, because no two invocations write the same value to the variable: remove it",
        ),
        (
            "race",
            "data[i] = i + 1u;",
            "isn't needed, because no invocations race on the variable: remove it",
        ),
        ("typo", "data[i] = 1u;", "names a variable that no pass uses; did you mean `data`?"),
        ("silent", "data[0] = 1u;", "has no reason: say why the race is harmless"),
        ("tile", "data[0] = 1u; tile[i] = 0u;", "has a race on `data[0]`"),
        ("none", "data[0] = 1u;", "names a variable that no pass uses"),
    ] {
        let wrong = accepting(how, body);
        assert!(wrong.contains(part), "{how} {body}: {wrong}");
    }
}

/// If a shader appends elements by an atomic counter, their order differs between drivers. Karat reports a check that
/// depends on this order.
#[test]
fn an_append_whose_order_matters() {
    let text = "@group(0) @binding(0) var<storage, read_write> count: atomic<u32>;
                @group(0) @binding(1) var<storage, read_write> found: array<u32>;
                @compute @workgroup_size(8) fn invocations(@builtin(global_invocation_id) id: vec3u) {
                    if (id.x % 3u == 0u) { found[atomicAdd(&count, 1u)] = id.x; }
                }
                @compute @workgroup_size(1) fn groups(@builtin(workgroup_id) id: vec3u) {
                    found[atomicAdd(&count, 1u)] = id.x;
                }
                @compute @workgroup_size(8) fn sum(@builtin(global_invocation_id) id: vec3u) {
                    atomicAdd(&count, id.x);
                    found[id.x] = id.x;
                }";
    let package = Package::from_source("append", text);
    let after = |entry: &str, groups: u32, variable: &str| {
        let passes = package.compute().with("count", Storage::new([0_u32]));
        let passes =
            passes.with("found", Storage::new([99_u32; 8])).dispatch(entry, [groups, 1, 1]);
        passes.after(variable).unrecorded()
    };
    let order = |result: Result<_, ComputeError>| match result {
        Err(ComputeError::Order(order)) => *order,
        Err(other) => panic!("{other}"),
        Ok(_) => panic!("the order was not seen"),
    };
    let thirds = [0_u32, 3, 6, 99, 99, 99, 99, 99];
    let seen = order(after("invocations", 1, "found").try_agrees_with(thirds, Abs(0.0)));
    assert!(seen.location.starts_with("<append>:4:"), "{}", seen.location);
    let operation = seen.operation.as_deref();
    let expected = "`atomicAdd(&count, 1u)` gives local (0, 0, 0) of workgroup (0, 0, 0) the value 2 in this order, and 0 in the usual order";
    assert_eq!(operation, Some(expected));
    let place = seen.element.as_ref().map(|element| element.place.to_string());
    assert_eq!(place.as_deref(), Some("[0]"), "{seen}");
    assert_eq!(seen.swap, "the invocations run one after the other, the last one first");
    let lines: Vec<&str> = seen.turns[0].lines().collect();
    assert_eq!(lines.len(), 4, "no bystander: {seen}");
    let first =
        "  local (6, 0, 0) of workgroup (0, 0, 0): `atomicAdd(&count, 1u)` gives 0 (<append>:4:";
    assert!(lines[1].starts_with(first), "{seen}");
    assert!(seen.to_string().contains("up_to_order"), "{seen}");
    let all = [0_u32, 1, 2, 3, 4, 5, 6, 7];
    let seen = order(after("groups", 8, "found").try_agrees_with(all, Abs(0.0)));
    assert!(seen.swap.ends_with("the last one first"), "{}", seen.swap);
    let holds = |found: &[u32]| found.is_sorted();
    order(after("groups", 8, "found").try_satisfies("rises", holds));
    // If both invocations run in lockstep, both have counted before either reads, with or without a barrier.
    let text = "var<workgroup> count: atomic<u32>;
                @group(0) @binding(1) var<storage, read_write> found: array<u32>;
                @compute @workgroup_size(8) fn free(@builtin(local_invocation_index) i: u32) {
                    atomicAdd(&count, 1u);
                    found[i] = atomicLoad(&count);
                }
                @compute @workgroup_size(8) fn late(@builtin(local_invocation_index) i: u32) {
                    if (i == 0u) { atomicStore(&count, 0u); }
                    workgroupBarrier();
                    atomicAdd(&count, 1u);
                    found[i] = atomicLoad(&count);
                }
                @compute @workgroup_size(8) fn ordered(@builtin(local_invocation_index) i: u32) {
                    for (var round = 1u; round < 4u; round++) {
                        atomicAdd(&count, 1u);
                        workgroupBarrier();
                        found[i] = atomicLoad(&count) / round;
                        workgroupBarrier();
                    }
                }";
    let package = Package::from_source("counted", text);
    let counted = |entry: &str| {
        let passes = package.compute().with("found", Storage::new([0_u32; 8]));
        let after = passes.dispatch(entry, [1, 1, 1]).after("found").unrecorded();
        after.try_agrees_with([8_u32; 8], Abs(0.0))
    };
    for entry in ["free", "late"] {
        let seen = order(counted(entry));
        assert!(seen.swap.contains("one after the other"), "{entry}: {}", seen.swap);
    }
    counted("ordered").expect("a barrier lies between them");
    // A set and a sum have no order.
    after("invocations", 1, "found").up_to_order().agrees_with(thirds, Abs(0.0));
    after("groups", 8, "found").up_to_order().agrees_with(all, Abs(0.0));
    after("sum", 1, "count").agrees_with([28_u32], Abs(0.0));
    after("sum", 1, "found").agrees_with(all, Abs(0.0));
    // Different sets still differ.
    let other = after("groups", 8, "found").up_to_order().try_agrees_with([1_u32; 8], Abs(0.0));
    assert!(matches!(other, Err(ComputeError::Differs(_))));
}

/// Two invocations store different values in one atomic, in different statements. Either store may come last, so Karat
/// reports that the order matters.
#[test]
fn an_order_of_two_invocations_that_matters() {
    for (first, second) in [(31, 32), (32, 31), (0, 63), (63, 0), (5, 40), (40, 6), (17, 18)] {
        let text = format!(
            "@group(0) @binding(0) var<storage, read_write> last: atomic<u32>;
             @compute @workgroup_size(64) fn own(@builtin(local_invocation_index) i: u32) {{
                 if i == {first}u {{ atomicStore(&last, 1u); }}
                 if i == {second}u {{ atomicStore(&last, 2u); }}
             }}"
        );
        let package = Package::from_source("last", text);
        let passes =
            package.compute().with("last", Storage::new([0_u32])).dispatch("own", [1, 1, 1]);
        let seen = passes.after("last").unrecorded().try_agrees_with([2_u32], Abs(0.0));
        assert!(matches!(seen, Err(ComputeError::Order(_))), "{first} and {second}: {seen:?}");
    }
}

/// These faults don't show in the usual order of invocations, so Karat must find them in other orders. For example, the
/// workgroup that publishes a value comes last.
#[test]
fn faults_of_another_order_alone() {
    let text = "@group(0) @binding(0) var<storage, read_write> word: u32;
        @group(0) @binding(1) var<storage, read_write> flag: atomic<u32>;
        @group(0) @binding(2) var<storage, read_write> out: array<u32>;
        var<workgroup> turn: atomic<u32>;
        @compute @workgroup_size(1) fn publish(@builtin(workgroup_id) w: vec3u, @builtin(num_workgroups) n: vec3u) {
            if w.x == n.x - 1u { word = 42u; atomicStore(&flag, 1u); out[w.x] = 42u; }
            else { var v = 42u; if atomicLoad(&flag) == 1u { v = word; } out[w.x] = v; }
        }
        @compute @workgroup_size(4) fn meet(@builtin(local_invocation_index) i: u32) {
            let own = atomicAdd(&turn, 1u);
            if i > 0u || own == 0u { workgroupBarrier(); }
            out[i] = 42u;
        }
        @compute @workgroup_size(4) fn last(@builtin(local_invocation_index) i: u32) {
            let own = atomicAdd(&turn, 1u);
            if i == 3u { out[own - 3u] = 42u; } else { out[i + 1u] = 42u; }
        }
        @compute @workgroup_size(4) fn stack(@builtin(local_invocation_index) i: u32) {
            // In lockstep all read before one has published.
            if atomicLoad(&flag) > 0u { out[0] = word; } else { out[i] = 42u; }
            if i == 2u { word = 42u; atomicStore(&flag, 1u); }
        }
        @compute @workgroup_size(4) fn in_order(@builtin(local_invocation_index) i: u32) {
            let own = atomicAdd(&turn, 1u);
            workgroupBarrier();
            out[own] = 42u;
            storageBarrier();
            if out[3u - own] == 42u { atomicAdd(&flag, 1u); }
        }";
    let package = Package::from_source("late", text);
    let seen = |name: &str, groups, words: &[&str]| {
        let passes = package.compute().with("out", Storage::new([0_u32; 4]));
        let passes = words.iter().fold(passes, |all, word| all.with(word, Storage::new([0_u32])));
        let after = passes.dispatch(name, [groups, 1, 1]).after("out");
        after.unrecorded().try_agrees_with([42_u32; 4], Abs(0.0))
    };
    let both: &[&str] = &["word", "flag"];
    for (name, groups, words, kind, (line, who)) in [
        ("publish", 4, both, HazardKind::Race, (6, "local (0, 0, 0) of workgroup (3, 0, 0)")),
        ("meet", 1, &[], HazardKind::Barrier, (11, "local (0, 0, 0) of workgroup (0, 0, 0)")),
        ("last", 1, &[], HazardKind::OutOfRange, (16, "local (3, 0, 0) of workgroup (0, 0, 0)")),
        ("stack", 1, both, HazardKind::Race, (21, "local (2, 0, 0) of workgroup (0, 0, 0)")),
    ] {
        let seen = seen(name, groups, words);
        let Err(ComputeError::Violations(found)) = seen else { panic!("{name}: {seen:?}") };
        let first = &found.all[0];
        assert!(first.kind == kind && first.headline.starts_with("in another order, "), "{found}");
        let place = format!("<late>:{line}:");
        let mut accesses = first.accesses.iter();
        assert!(
            accesses.any(|one| one.place.starts_with(&place) && one.invocation == who),
            "{found}"
        );
    }
    seen("in_order", 1, &["flag"]).expect("barriers order it in each order");
}

/// A check may expect a result that the engine doesn't give, because drivers round differently or have subgroups of
/// another size. Even then, Karat compares the orders of invocations on the engine with each other.
#[test]
fn an_order_that_matters_where_the_usual_one_fails() {
    let text = "@group(0) @binding(0) var<storage, read_write> count: atomic<u32>;
        @group(0) @binding(1) var<storage, read_write> out: array<f32>;
        @compute @workgroup_size(8) fn append(@builtin(local_invocation_index) i: u32) {
            out[atomicAdd(&count, 1u)] = f32(i) * 0.5;
        }
        @compute @workgroup_size(8) fn own(@builtin(local_invocation_index) i: u32) { out[i] = f32(i) * 0.5; }
        @compute @workgroup_size(8) fn lost(@builtin(local_invocation_index) i: u32) {
            atomicStore(&count, atomicLoad(&count) + 1u);
            if i == 0u { out[0] = 0.0; }
        }";
    let package = Package::from_source("append", text);
    let passes = |name: &str| {
        let passes = package.compute().with("out", Storage::new([9.0_f32; 8]));
        let passes = match name {
            "own" => passes,
            _ => passes.with("count", Storage::new([0_u32])),
        };
        passes.dispatch(name, [1, 1, 1])
    };
    // No path gives this result, so it stands for a driver with its own arithmetic.
    let others = (0..8_u8).map(|i| 0.5 * f64::from(i) + 0.25);
    let seen = passes("append").after("out").unrecorded().try_agrees_with(others.clone(), Abs(0.0));
    let Err(ComputeError::Order(order)) = seen else { panic!("{seen:?}") };
    assert!(!order.holds && order.location == "<append>:4:17", "{order}");
    let says = "in the usual order of Karat's engine, this assertion fails: elements agree within abs 0. Each order";
    assert!(order.to_string().contains(says), "{order}");
    let seen = passes("lost").after("count").unrecorded().try_agrees_with([8_u32], Abs(0.0));
    assert!(matches!(seen, Err(ComputeError::Order(_))), "one after the other leaves 8: {seen:?}");
    let seen = passes("lost")
        .after("count")
        .unrecorded()
        .try_satisfies("is 8", |count: &[u32]| count == [8]);
    assert!(matches!(seen, Err(ComputeError::Order(_))), "it holds in one order: {seen:?}");
    // If no order changes a result, the message shows only the difference of numbers.
    let seen = passes("own").after("out").unrecorded().try_agrees_with(others, Abs(0.0));
    assert!(matches!(seen, Err(ComputeError::Differs(_))), "{seen:?}");
}

/// The subgroup size depends on the device. So Karat reports a shader that gives the right result only for subgroups of
/// 32 invocations.
#[test]
fn a_reduction_that_assumes_subgroups_of_32() {
    let text = "@group(0) @binding(0) var<storage, read_write> sums: array<u32>;
        var<workgroup> parts: array<u32, 64>;
        var<workgroup> two: array<u32, 2>;
        @compute @workgroup_size(64) fn by_size(@builtin(local_invocation_index) i: u32,
            @builtin(subgroup_id) group: u32, @builtin(subgroup_invocation_id) own: u32,
            @builtin(num_subgroups) groups: u32) {
            let sum = subgroupAdd(i + 1u);
            if own == 0u { parts[group] = sum; }
            workgroupBarrier();
            if i != 0u { return; }
            for (var k = 0u; k < groups; k++) { sums[0] += parts[k]; }
        }
        @compute @workgroup_size(64) fn by_32(@builtin(local_invocation_index) i: u32) {
            let sum = subgroupAdd(i + 1u);
            if i % 32u == 0u { parts[i / 32u] = sum; }
            workgroupBarrier();
            if i == 0u { sums[0] = parts[0] + parts[1]; }
        }
        @compute @workgroup_size(64) fn tail(@builtin(local_invocation_index) i: u32) {
            if i >= 40u { return; }
            let sum = subgroupAdd(1u);
            if i == 0u { sums[0] = sum; }
        }
        @compute @workgroup_size(64) fn next(@builtin(local_invocation_index) i: u32) {
            let all = subgroupShuffleDown(i, 1u);
            if i == 31u { sums[0] = all; }
        }
        @compute @workgroup_size(64) fn fifth(@builtin(local_invocation_index) i: u32) {
            let one = subgroupBroadcast(i, 5u);
            if i == 0u { sums[0] = one; }
        }
        @compute @workgroup_size(64) fn room_for_two(@builtin(local_invocation_index) i: u32,
            @builtin(subgroup_id) group: u32, @builtin(subgroup_invocation_id) own: u32) {
            let sum = subgroupAdd(i + 1u);
            if own == 0u { two[group] = sum; }
            workgroupBarrier();
            if i == 0u { sums[0] = two[0] + two[1]; }
        }";
    let package = Package::from_source("subgroups", text);
    let sum = |entry: &str, expected: u32| {
        let passes = package.compute().with("sums", Storage::new([0_u32]));
        let passes = passes.refused_on("gl", "OpenGL ES has no subgroups in its core");
        let after = passes.dispatch(entry, [1, 1, 1]).after("sums").unrecorded();
        after.try_agrees_with([expected], Abs(0.0))
    };
    sum("by_size", 2080).expect("it asks for the size");
    let Err(ComputeError::Order(order)) = sum("by_32", 2080) else { panic!("it wasn't seen") };
    assert_eq!((&*order.swap, order.subgroup), ("subgroups have 4 invocations", Some(4)));
    assert!(order.to_string().contains("use `subgroup_size`"), "{order}");
    for (entry, kind, part) in [
        ("tail", HazardKind::Barrier, "a subgroup operation that not every invocation"),
        ("next", HazardKind::OutOfRange, "missing invocation of the subgroup"),
        ("fifth", HazardKind::OutOfRange, "in subgroups of 4, `fifth` reads the value"),
        ("room_for_two", HazardKind::OutOfRange, "in subgroups of 4, `room_for_two` writes"),
    ] {
        let wrong = sum(entry, 32);
        let Err(ComputeError::Violations(found)) = wrong else { panic!("{entry}: {wrong:?}") };
        assert_eq!(found.all[0].kind, kind);
        assert!(found.to_string().contains(part), "{found}");
    }
}

/// If a dispatch has too few workgroups, the last elements stay unchanged. `is_written` finds these elements, even if
/// the pass writes the values that the buffer already has.
#[test]
fn a_tail_that_no_invocation_writes() {
    let text = "enable f16;
        struct Item { weight: f16, at: vec3f, id: u32 }
        @group(0) @binding(0) var<storage, read_write> items: array<Item>;
        @group(0) @binding(1) var<storage, read_write> counts: array<atomic<u32>>;
        @compute @workgroup_size(4) fn fill(@builtin(global_invocation_id) id: vec3u) {
            if id.x < arrayLength(&items) { items[id.x] = Item(0.0h, vec3f(), 0u); }
        }
        @compute @workgroup_size(4) fn places(@builtin(global_invocation_id) id: vec3u) {
            if id.x < arrayLength(&items) { items[id.x].at = vec3f(); items[id.x].weight = 0.0h; }
        }
        @compute @workgroup_size(4) fn count(@builtin(global_invocation_id) id: vec3u) {
            if id.x < arrayLength(&counts) { atomicAdd(&counts[id.x], 0u); }
        }
        @compute @workgroup_size(4) fn exchange(@builtin(global_invocation_id) id: vec3u) {
            if id.x < arrayLength(&counts) { let x = atomicCompareExchangeWeak(&counts[id.x], 7u, 1u); }
        }";
    let package = Package::from_source("tail", text);
    let written = |entries: &[(&str, u32)], variable: &str| {
        let fixture = karat::fixture::Buffer::zeros(if variable == "items" { 7 * 32 } else { 28 });
        let mut passes = package.compute().with(variable, fixture);
        for (entry, groups) in entries {
            passes = passes.dispatch(entry, [*groups, 1, 1]);
        }
        let cpu = karat::unstable::executor::of(karat::Path::CPU).expect("it is always there");
        passes.on(cpu).after(variable).unrecorded().try_is_written()
    };
    written(&[("fill", 2)], "items").expect("all are");
    written(&[("count", 2)], "counts").expect("an atomic writes");
    let missed = written(&[("exchange", 2)], "counts");
    let Err(ComputeError::Differs(found)) = &missed else { panic!("{missed:?}") };
    assert_eq!(found.paths[0].census.failures, 7, "a comparison that fails writes nothing");
    for (entries, variable, first, elements) in [
        (&[("fill", 1)][..], "items", "[4].weight", 3),
        (&[("places", 2)], "items", "[0].id", 7),
        (&[("fill", 1), ("places", 2)], "items", "[4].id", 3),
        (&[("count", 1)], "counts", "[4]", 3),
    ] {
        let wrong = written(entries, variable);
        let Err(ComputeError::Differs(found)) = &wrong else { panic!("{entries:?}: {wrong:?}") };
        assert_eq!(found.paths[0].census.failures, elements, "{entries:?}");
        assert_eq!(found.paths[0].shown[0].place.to_string(), first);
    }
}

/// `is_written` finds texels of a storage texture that a dispatch with too few workgroups doesn't write, and a buffer
/// that no invocation writes.
#[test]
fn texels_that_no_invocation_writes() {
    let text = "@group(0) @binding(0) var image: texture_storage_2d<rgba16float, write>;
        @group(0) @binding(1) var<storage, read_write> data: array<u32>;
        @compute @workgroup_size(2, 2) fn fill(@builtin(global_invocation_id) id: vec3u) {
            textureStore(image, id.xy, vec4f(f32(data[0])));
        }";
    let package = Package::from_source("texels", text);
    let written = |groups: [u32; 3], variable: &str| {
        let passes = package
            .compute()
            .with("image", Texture::from_fn(5, 3, |_, _| glam::Vec4::ZERO))
            .with("data", Storage::new([0_u32; 2]))
            .dispatch("fill", groups);
        let cpu = karat::unstable::executor::of(karat::Path::CPU).expect("it is always there");
        passes.on(cpu).after(variable).unrecorded().try_is_written()
    };
    written([3, 2, 1], "image").expect("all are");
    for (groups, variable, first, elements) in [
        ([2, 2, 1], "image", "[4, 0].x", 3),
        ([3, 1, 1], "image", "[0, 2].x", 5),
        ([3, 2, 1], "data", "[0]", 2),
    ] {
        let wrong = written(groups, variable);
        let Err(ComputeError::Differs(found)) = &wrong else { panic!("{groups:?}: {wrong:?}") };
        assert_eq!(found.paths[0].census.failures, elements, "{groups:?}");
        assert_eq!(found.paths[0].shown[0].place.to_string(), first);
    }
}

/// The pass reads and writes the same texture, so invocations race. The report shows the value that one invocation
/// reads and the value that another invocation writes.
#[test]
fn texels_that_race_have_their_values() {
    let text = "@group(0) @binding(0) var image: texture_storage_2d<r32float, read_write>;
        @compute @workgroup_size(4) fn shift(@builtin(global_invocation_id) id: vec3u) {
            let next = textureLoad(image, vec2u(id.x + 1u, 0u));
            textureStore(image, vec2u(id.x, 0u), next + 0.5);
        }";
    let package = Package::from_source("texels", text);
    let image = Texture::from_fn(9, 1, |x, _| glam::Vec4::splat(x as f32));
    let cpu = karat::unstable::executor::of(karat::Path::CPU).expect("it is always there");
    let passes = package.compute().with("image", image).dispatch("shift", [2, 1, 1]).on(cpu);
    let raced = passes.after("image").unrecorded().try_is_written();
    let Err(ComputeError::Violations(found)) = &raced else { panic!("{raced:?}") };
    let texel = |one: &&Violation| one.element == "image[1, 0]" || one.element == "image[4, 0]";
    let one = found.all.iter().find(texel).unwrap_or_else(|| panic!("{found}"));
    let mut does: Vec<&str> = one.accesses.iter().map(|access| &*access.does).collect();
    does.sort_unstable();
    let expected = if one.element == "image[1, 0]" {
        ["reads 1", "writes 2.5"]
    } else {
        ["reads 4", "writes 5.5"]
    };
    assert_eq!(does, expected, "{found}");
}

/// The pass reads a texel beyond the edge of a texture. The report has the coordinates of this texel and the size of
/// the texture.
#[test]
fn a_texel_beyond_the_edge() {
    let cpu = karat::unstable::executor::of(karat::Path::CPU).expect("it is always there");
    for (texels, first, place, does) in [
        ("f32", "f32(textureLoad(src, vec2i(i32(id.x) - 1, 3), 0).x)", 0, "-1, but `src` has 8"),
        ("u32", "f32(textureLoad(src, vec2u(2u, id.x + 1u), 0).x)", 7, "8, but `src` has 8"),
    ] {
        let text = format!(
            "@group(0) @binding(0) var src: texture_2d<{texels}>;
             @group(0) @binding(1) var<storage, read_write> sums: array<f32>;
             @compute @workgroup_size(8) fn add(@builtin(global_invocation_id) id: vec3u) {{
                 sums[id.x] = {first};
             }}"
        );
        let package = Package::from_source("texels", text);
        let passes = package.compute().with("sums", Storage::new([0.0_f32; 8]));
        let passes = match texels {
            "f32" => passes.with("src", Texture::from_fn(8, 8, |_, _| glam::Vec4::ONE)),
            _ => passes.with("src", Texture::from_fn(8, 8, |_, _| glam::UVec4::ONE)),
        };
        let left = passes.dispatch("add", [1, 1, 1]).on(cpu).after("sums").unrecorded();
        let wrong = left.try_is_written();
        let Err(ComputeError::Violations(found)) = &wrong else { panic!("{wrong:?}") };
        let access = &found.all[0].accesses[0];
        assert!(access.invocation.starts_with(&format!("local ({place}, 0, 0)")), "{found}");
        assert!(access.does.contains(does), "{found}");
    }
}

/// If only one of two passes depends on the order of invocations, the message names this pass and its line.
#[test]
fn one_pass_of_several_depends_on_its_order() {
    let text = "@group(0) @binding(0) var<storage, read_write> last: atomic<u32>;
        @group(0) @binding(1) var<storage, read_write> data: array<u32, 64>;
        @compute @workgroup_size(64) fn own(@builtin(local_invocation_index) i: u32) {
            if i == 3u || i == 9u { atomicStore(&last, i); }
        }
        @compute @workgroup_size(64) fn bump(@builtin(local_invocation_index) i: u32) { data[i] += 1u; }";
    let package = Package::from_source("two", text);
    let cpu = karat::unstable::executor::of(karat::Path::CPU).expect("it is always there");
    let passes = package.compute().with("last", Storage::new([0_u32]));
    let passes = passes.with("data", Storage::new([0_u32; 64]));
    let passes = passes.dispatch("own", [1, 1, 1]).dispatch("bump", [1, 1, 1]).on(cpu);
    let seen = passes.after("last").unrecorded().try_agrees_with([9_u32], Abs(0.0));
    let Err(ComputeError::Order(order)) = &seen else { panic!("{seen:?}") };
    let expected = "the invocations of `own` run one after the other, the last one first";
    assert_eq!(order.swap, expected, "{order}");
    assert!(order.location.starts_with("<two>:3:"), "{order}");
}

/// One access of a race is in a function that is defined above its caller. No loop contains the lines of both accesses,
/// so Karat advises a barrier between the accesses.
#[test]
fn a_race_with_a_function_above() {
    let load = "fn load(i: u32) -> u32 { return tile[i]; }";
    let own = "@compute @workgroup_size(64) fn own(@builtin(local_invocation_index) i: u32) {
        tile[i] = i;
        data[i] = load(63u - i);
    }";
    for text in [format!("{load}\n{own}"), format!("{own}\n{load}")] {
        let text = format!(
            "var<workgroup> tile: array<u32, 64>;
             @group(0) @binding(0) var<storage, read_write> data: array<u32, 64>;\n{text}"
        );
        let package = Package::from_source("above", text);
        let passes = package.compute().with("data", Storage::new([0_u32; 64]));
        let cpu = karat::unstable::executor::of(karat::Path::CPU).expect("it is always there");
        let left = passes.dispatch("own", [1, 1, 1]).on(cpu).after("data").unrecorded();
        let Err(ComputeError::Violations(found)) = left.try_is_written() else { panic!("a race") };
        let advice = &found.all[0].advice;
        assert!(advice.contains("put a `workgroupBarrier()` between the two"), "{found}");
    }
}
