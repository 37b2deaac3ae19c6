//! Tests entry points without Rust tests: listing, calling, dispatching and comparing them, and declaring them as
//! `[[compute]]`.

use super::*;

const SHADER: &str = "\
struct In { @builtin(position) pixel: vec4f, @location(0) uv: vec2f }
@fragment fn shade(in: In) -> @location(0) vec4f { return vec4f(in.uv, fwidth(in.pixel.x), 1.0); }
@group(0) @binding(0) var<storage, read_write> keys: array<u32>;
@group(0) @binding(1) var<storage, read> input: array<u32>;
@group(0) @binding(2) var<storage, read_write> total: atomic<u32>;
@group(0) @binding(3) var<storage, read_write> out: array<f32>;
@compute @workgroup_size(8) fn reverse(@builtin(local_invocation_index) i: u32) { keys[i] = input[7u - i]; }
@compute @workgroup_size(8) fn mirror(@builtin(local_invocation_index) i: u32) { keys[7u - i] = input[i]; }
@compute @workgroup_size(8) fn add(@builtin(global_invocation_id) id: vec3u) {
    if id.x < arrayLength(&input) { atomicAdd(&total, input[id.x]); }
}
@compute @workgroup_size(8) fn root(@builtin(local_invocation_index) i: u32) { out[i] = sqrt(out[i]); }
@compute @workgroup_size(8) fn wait(@builtin(local_invocation_index) i: u32) { keys[0] = i; }
";

fn shaders(declared: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "m.wgsl", SHADER);
    if !declared.is_empty() {
        write(folder.path(), "m.test.toml", declared);
    }
    folder
}

#[test]
fn an_entry_point_is_listed_and_called() {
    let folder = shaders("");
    let list = karat(folder.path(), &["list"]).good();
    for part in ["@fragment m::shade(in: In) -> vec4<f32>", "@compute m::reverse(i: u32)"] {
        assert!(list.contains(part), "`{part}` is missing in:\n{list}");
    }
    let arguments = ["call", "m::shade", r#"{"pixel": [1, 1, 0, 1], "uv": [0.5, 0.25]}"#];
    let called = karat(folder.path(), &[&arguments[..], &["--path", "cpu"]].concat()).good();
    assert!(called.contains("cpu      (0.5, 0.25, 0, 1)"), "{called}");
    let traced = ["call", "m::shade", "--arbitrary", "--path", "cpu", "--trace"];
    let traced = karat(folder.path(), &traced).good();
    assert!(traced.contains("fwidth(in.pixel.x)"), "{traced}");
    // The function writes a buffer and returns nothing.
    let traced = ["call", "m::root", "2", "--bind", "out=[1, 4, 9]", "--path", "cpu", "--trace"];
    let traced = karat(folder.path(), &traced).good();
    let row = traced.lines().find(|line| line.contains("sqrt(out[i])"));
    let row = row.unwrap_or_else(|| panic!("no `sqrt(out[i])` in:\n{traced}"));
    assert!(row.contains("m.wgsl:12") && row.contains(" 3 "), "{row}");
}

/// The result of a call says if the function discarded the pixel. A discarded pixel has no visible value.
#[test]
fn a_function_that_discards_is_called() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shader = "fn cut(alpha: f32) { if alpha < 0.5 { discard; } }
@fragment fn leaf(@location(0) alpha: f32) -> @location(0) vec4f {
    cut(alpha);
    return vec4f(sqrt(alpha - 0.25));
}
@fragment fn late(@location(0) alpha: f32) -> @location(0) vec4f {
    cut(alpha);
    return vec4f(sqrt(alpha - 0.75));
}
";
    write(folder.path(), "m.wgsl", shader);
    let list = karat(folder.path(), &["list"]).good();
    for part in ["m::cut(alpha: f32), or discards", "leaf(alpha: f32) -> vec4<f32>, or discards"] {
        assert!(list.contains(part), "`{part}` is missing in:\n{list}");
    }
    let call = |arguments: &[&str]| karat(folder.path(), &[&["call"], arguments].concat()).good();
    for (alpha, result) in [
        ("0.125", "{ value: (0, 0, 0, 0), discarded: true }"),
        ("0.5", "{ value: (0.5, 0.5, 0.5, 0.5), discarded: false }"),
    ] {
        // The dropped value is NaN, and no driver shows it.
        let called = call(&["m::leaf", alpha]);
        assert!(called.lines().filter(|line| line.contains(result)).count() >= 2, "{called}");
    }
    let hazards = karat(folder.path(), &["hazards"]);
    let shown = hazards.out.matches("NaN  sqrt(alpha - 0.75)").count();
    assert_eq!(shown, 1, "{hazards:?}");
    assert!(!hazards.out.contains("NaN  sqrt(alpha - 0.25)"), "only what is dropped is NaN");
    let tests = "[[test]]
function = \"cut\"
over = { alpha = \"0..0.49\" }
equals.discarded = true
tolerance = \"1 ulp\"

[[test]]
function = \"leaf\"
over = { alpha = \"0.4..1\" }
equals = { value = [0, 0, 0, 0], discarded = true }
tolerance = \"1 ulp\"
";
    write(folder.path(), "m.test.toml", tests);
    let ran = karat(folder.path(), &["test"]);
    assert!(ran.out.contains("1 passed; 1 failed"), "{ran:?}");
    assert!(ran.out.contains("it fails where alpha is at least 0.5"), "{ran:?}");
    // Textures and samplers are also parameters. A comment isn't code.
    let sampled = "fn cut(t: texture_2d<f32>, s: sampler, uv: vec2f) -> vec4f // discard;
{ let c = textureSampleLevel(t, s, uv, 0.0); if c.a < uv.x { discard; } return c; }
";
    write(folder.path(), "t.wgsl", sampled);
    let (white, point) = ("t=[1, 1, 1, 0.5]", ["[0.75, 0.5]", "[0.25, 0.5]"]);
    for (uv, discarded) in point.into_iter().zip(["discarded: true", "discarded: false"]) {
        let called = ["t::cut", uv, "--bind", white, "--bind", "s=linear", "--path", "cpu"];
        let called = call(&called);
        assert!(called.contains(discarded), "{uv}: {called}");
    }
    // Only fragment functions can discard.
    write(folder.path(), "m.wgsl", &shader.replace("@fragment fn late", "@vertex fn late"));
    assert_ne!(karat(folder.path(), &["call", "m::late", "0.5"]).code, Some(0));
}

/// A fragment function counts its pixels and writes storage, as order-independent transparency does. After a discard,
/// the pixel's invocation continues as a helper. In `karat call`, the quad's other pixels are helpers from the start.
#[test]
fn pixels_that_write_storage_discard_and_have_derivatives() {
    let folder = shaders("");
    let shader = "@group(0) @binding(0) var<storage, read_write> count: atomic<u32>;
@group(0) @binding(1) var<storage, read_write> nodes: array<f32, 4>;
@group(0) @binding(2) var t: texture_2d<f32>;
@group(0) @binding(3) var s: sampler;
fn cut(alpha: f32) { if alpha < 0.5 { discard; } }
@fragment fn keep(@builtin(position) pixel: vec4f, @location(0) uv: vec2f) -> @location(0) vec4f {
    nodes[3] = 7.0;
    let color = textureSample(t, s, uv);
    cut(color.a);
    nodes[atomicAdd(&count, 1u)] = fwidth(pixel.x * pixel.x) + color.a;
    return color;
}
@fragment fn last(@builtin(position) pixel: vec4f) {
    nodes[0] = pixel.x;
    discard;
}
fn slope(x: f32) -> f32 {
    nodes[0] = dpdx(x);
    if x < 0.5 { discard; }
    nodes[1] = dpdy(x * x);
    return x;
}
";
    write(folder.path(), "o.wgsl", shader);
    let list = karat(folder.path(), &["list"]).good();
    assert!(list.contains("@fragment o::keep(") && list.contains(", or discards"), "{list}");
    let called = |alpha: &str, nodes: &str| {
        let texture = format!("t=[1, 1, 1, {alpha}]");
        let bound = [&texture, "s=linear", "count=1", nodes];
        let bound = bound.into_iter().flat_map(|one| ["--bind", one]);
        let call = ["call", "o::keep", "[2.5, 1.5, 0, 1]", "[0.5, 0.25]"];
        karat(folder.path(), &call.into_iter().chain(bound).collect::<Vec<_>>()).good()
    };
    let nodes = "nodes=[1, 2, 3, 4]";
    for (alpha, parts) in [
        // An argument is equal at all pixels of a quad.
        ("0.75", ["discarded: false", "count: 2", "nodes: [1, 0.75, 3, 7]"]),
        ("0.25", ["discarded: true", "count: 1", "nodes: [1, 2, 3, 7]"]),
    ] {
        let called = called(alpha, nodes);
        for part in parts {
            let count = called.lines().filter(|line| line.contains(part)).count();
            assert!(count >= 2, "`{part}` on each path of:\n{called}");
        }
    }
    // Discarded neighbours still give values for derivatives, on each path.
    let table = "x.value,x.dx,x.dy\n0.75,0.5,-0.25\n0.625,0.5,-0.25\n0.375,0.5,-0.25\n";
    write(folder.path(), "in.csv", table);
    let gl = karat::unstable::path::adapter(karat::Path::GL).is_ok();
    for path in ["cpu", "vulkan", "gl"].into_iter().filter(|path| gl || *path != "gl") {
        let table = ["call", "o::slope", "--table", "in.csv", "--bind", nodes, "--path", path];
        let left = karat(folder.path(), &table).good();
        for (line, row) in left.lines().skip(1).zip([
            "0.75,0.5,-0.25,0.75,false,0.5,-0.3125,3,4",
            "0.625,0.5,-0.25,0.625,false,0.5,-0.25,3,4",
            "0.375,0.5,-0.25,0,true,0.5,2,3,4",
        ]) {
            assert_eq!(line, row, "{path}");
        }
        assert_eq!(left.lines().count(), 4, "{path}: {left}");
    }
    // The slope selects texels, and WGSL doesn't define its accuracy.
    let columns = if gl { "vulkan,gl,cpu" } else { "vulkan,cpu" };
    let judged = karat(folder.path(), &["matrix", "--only", "o::", "--columns", columns]);
    assert!(judged.good().contains("cpu          4 translated, 4 valid, 4 executed, 4 agrees"));
    // Pixels that run concurrently race. Discarded pixels don't.
    let hazards = karat(folder.path(), &["hazards"]);
    assert!(hazards.out.contains("nodes[3]") && hazards.out.contains("pixel ("), "{hazards:?}");
    // Of the functions that write, only one isn't an entry point.
    let unseen = hazards.out.lines().filter(|line| line.starts_with("not checked: "));
    let unseen: Vec<&str> = unseen.collect();
    assert!(matches!(unseen[..], [one] if one.contains("o::slope")), "{unseen:?}");
}

#[test]
fn call_dispatches_a_compute_pass_and_checks_for_races() {
    let folder = shaders("");
    let call = |arguments: &[&str]| {
        let all = ["call"].into_iter().chain(arguments.iter().copied()).chain(["--path", "cpu"]);
        karat(folder.path(), &all.collect::<Vec<_>>())
    };
    let bound = ["--bind", "input=[1,2,3,4,5,6,7,8]", "--bind", "keys=[0,0,0,0,0,0,0,0]"];
    let ran = call(&[&["m::reverse", "--dispatch", "1"], &bound[..]].concat()).good();
    assert!(ran.contains("keys = [8, 7, 6, 5, 4, 3, 2, 1]"), "{ran}");
    let sum =
        ["m::add", "--dispatch", "2,1", "--bind", "input=[1,2,3,4,5,6,7,8,9]", "--bind", "total=1"];
    assert!(call(&sum).good().contains("total = 46"));
    // The trace shows one invocation. It reads values that earlier invocations wrote.
    let pages = tempfile::tempdir().expect("a temporary folder");
    let page = pages.path().join("t.html");
    let to = ["--trace", "--html", page.to_str().expect("it is text")];
    let traced = |more: &[&str]| call(&[&sum[..], &to, more].concat());
    let [first, last] = ["0", "8,0,0"].map(|index| traced(&["--invocation", index]).good());
    let step = |traced: &str, number: &str| {
        let mut added = traced.lines().filter(|line| line.contains("atomicAdd(&total"));
        added.next().is_some_and(|line| line.contains(&format!("  {number}  ")))
    };
    assert!(step(&first, "1") && step(&last, "37"), "{first}\n{last}");
    assert!(last.contains("\nsteps of invocation (8, 0, 0):\n"), "{last}");
    assert_eq!(traced(&[]).good(), first);
    let page = std::fs::read_to_string(&page).expect("it was written");
    assert!(page.contains("m::add") && page.contains("atomicAdd"), "{page}");
    let raced = call(&["m::wait", "--dispatch", "1", "--arbitrary"]);
    assert_eq!(raced.code, Some(1), "{raced:?}");
    assert!(
        raced.out.contains("race on `keys[0]`") && raced.out.contains("m.wgsl:13:"),
        "{raced:?}"
    );
    for (wrong, part) in [
        (&["m::reverse", "--dispatch", "0", "--arbitrary"][..], "from 1 to 65535"),
        (&["m::reverse", "--dispatch", "1,x", "--arbitrary"][..], "write the workgroups as 4"),
        (&["m::shade", "--dispatch", "1", "--arbitrary"][..], "isn't a compute entry point"),
        (&["m::revers", "--dispatch", "1", "--arbitrary"][..], "did you mean `m::reverse`"),
        (&["m::reverse", "--dispatch", "1"][..], "add --bind"),
        (
            &["m::add", "--dispatch", "1", "--arbitrary", "--trace", "--invocation", "0,1"][..],
            "has no invocation [0, 1, 0]",
        ),
        (
            &["m::add", "--dispatch", "1", "--arbitrary", "--trace", "--invocation", "-1"][..],
            "--invocation",
        ),
        (&["m::add", "--dispatch", "1", "--arbitrary", "--invocation", "1"][..], "add --trace"),
    ] {
        let ran = call(wrong);
        assert!(ran.code != Some(0) && ran.err.contains(part), "{wrong:?}: {ran:?}");
    }
}

#[test]
fn passes_are_tested_without_rust() {
    let declared = "\
[[compute]]
name = \"twice\"
passes = [{ entry = \"reverse\", workgroups = 1 }, { entry = \"mirror\", workgroups = 1 }]
with = { input = { size = 8, range = \"0..99\", seed = 4 }, keys = { size = 8 } }
[compute.after.keys]
permutation_of = \"input\"
in_range = [0, 99]
written = true
[[compute]]
entry = \"mirror\"
workgroups = [1, 1]
with = { input = [8, 7, 6, 5, 4, 3, 2, 1], keys = { size = 8 } }
[compute.after.keys]
sorted = true
equals = [1, 2, 3, 4, 5, 6, 7, 8]
table = \"keys.csv\"
agrees_with = \"reverse\"
[[compute]]
entry = \"add\"
workgroups = 2
with = { input = [1, 2, 3, 4, 5, 6, 7, 8, 9], total = 0 }
[compute.after.total]
sum_of = \"input\"
equals = 45
[[compute]]
entry = \"root\"
workgroups = 1
no_hazards = true
with = { out = { size = 8, range = \"1..4\" } }
[compute.after.out]
finite = true
in_range = [0.999, 2.001]
[[compute]]
entry = \"wait\"
workgroups = 1
with = { keys = [9, 9] }
accept_race = { keys = \"any of them may be the last\" }
[compute.after.keys]
in_range = [0, 9]
";
    let folder = shaders(declared);
    write(folder.path(), "keys.csv", "value\n1\n2\n3\n4\n5\n6\n7\n8\n");
    let ran = karat(folder.path(), &["test", ".", "--paths", "cpu"]).good();
    assert!(ran.contains("13 checks"), "{ran}");
    assert!(ran.contains("the buffer contains the elements of `input`, in any order"), "{ran}");
    assert!(ran.contains("1 accepted race"), "{ran}");
}

/// A shader increments a counter and appends elements. The order of the elements differs between drivers.
#[test]
fn appended_elements_are_compared_up_to_their_order() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(
        folder.path(),
        "append.wgsl",
        "struct Kept { count: atomic<u32>, items: array<u32> }\n\
         @group(0) @binding(0) var<storage, read_write> kept: Kept;\n\
         @compute @workgroup_size(8) fn odd(@builtin(global_invocation_id) id: vec3u) {\n    \
         if id.x % 2u == 1u { kept.items[atomicAdd(&kept.count, 1u)] = id.x; }\n}\n",
    );
    let tested = |items: &str| {
        let declared = format!(
            "[[compute]]\nentry = \"odd\"\nworkgroups = 2\nwith = {{ kept = {{ count = 0, items = [0, 0, 0, 0, 0, 0, 0, 0] }} }}\n\
             [compute.after.kept]\nup_to_order = true\nequals = {{ count = 8, items = {items} }}\n"
        );
        write(folder.path(), "append.test.toml", &declared);
        karat(folder.path(), &["test", ".", "--paths", "cpu"])
    };
    tested("[15, 13, 11, 9, 7, 5, 3, 1]").good();
    let wrong = tested("[15, 13, 11, 9, 7, 5, 3, 2]");
    assert!(wrong.code == Some(1) && wrong.out.contains("expected = 2"), "{wrong:?}");
}

/// A test can check a single member of each element. A failure names the row and column of an element in a grid.
#[test]
fn a_test_can_check_members_and_grids_of_buffers() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(
        folder.path(),
        "p.wgsl",
        "struct Particle { position: vec2f, mass: f32 }\n\
         @group(0) @binding(0) var<storage, read_write> particles: array<Particle>;\n\
         @group(0) @binding(1) var<storage, read_write> grid: array<u32>;\n\
         @compute @workgroup_size(4) fn step(@builtin(global_invocation_id) id: vec3u) {\n    \
         if id.x >= arrayLength(&particles) { return; }\n    \
         particles[id.x].position += vec2f(1.0, f32(id.x));\n}\n\
         @compute @workgroup_size(6) fn fill(@builtin(global_invocation_id) id: vec3u) {\n    \
         if id.x < arrayLength(&grid) { grid[id.x] = id.x % 3u + select(0u, 9u, id.x == 5u); }\n}\n\
         @compute @workgroup_size(4) fn other(@builtin(global_invocation_id) id: vec3u) {\n    \
         if id.x < arrayLength(&particles) { particles[id.x] = Particle(vec2f(1.0, f32(id.x)), 5.0); }\n}\n",
    );
    let tested = |entry: &str, expected: &str| {
        let held = if entry == "step" { "particles" } else { "grid" };
        let size = if entry == "step" { 3 } else { 6 };
        let declared = format!(
            "[[compute]]\nentry = \"{entry}\"\nworkgroups = 1\nwith.{held} = {{ size = {size} }}\n{expected}"
        );
        write(folder.path(), "p.test.toml", &declared);
        karat(folder.path(), &["test", ".", "--paths", "cpu"])
    };
    let members = |position: &str, y: &str| {
        tested(
            "step",
            &format!(
                "[compute.after.\"particles.position\"]\nequals = {position}\nwritten = true\n\
                 agrees_with = \"other\"\nin_range = [0, 2]\n\
                 [compute.after.\"particles.position.y\"]\nequals = {y}\nsorted = true\n\
                 [compute.after.\"particles.mass\"]\nunchanged = true\n"
            ),
        )
    };
    let position = "[[1, 0], [1, 1], [1, 2]]";
    members(position, "[0, 1, 2]").good();
    let wrong = members(position, "[0, 1, 3]");
    assert!(wrong.code == Some(1) && wrong.out.contains("first: [2]\n"), "{wrong:?}");
    let wrong = members("[[1, 0], [1, 1], [4, 2]]", "[0, 1, 2]");
    assert!(wrong.out.contains("first: [2].x\n"), "{wrong:?}");
    // `written` checks only this member.
    let wrong = tested("step", "[compute.after.\"particles.mass\"]\nwritten = true\n");
    assert!(wrong.code == Some(1) && wrong.out.contains("expected = written"), "{wrong:?}");
    let wrong = tested("step", "[compute.after.\"particles.positon\"]\nfinite = true\n");
    assert!(wrong.out.contains("did you mean `particles.position`?"), "{wrong:?}");
    assert!(wrong.out.contains("p.test.toml:5:16"), "{wrong:?}");
    let grid = |rows: u32| {
        let grid =
            format!("[compute.after.grid]\nequals = [0, 1, 2, 0, 1, 2]\nshape = [{rows}, 3]\n");
        tested("fill", &grid)
    };
    assert!(grid(2).out.contains("first: [5: row 1, column 2]"), "{:?}", grid(2));
    assert!(
        grid(3).out.contains("`grid` has 6 elements, but 3 rows of 3 columns have 9"),
        "{:?}",
        grid(3)
    );
    assert!(grid(3).out.contains("p.test.toml:7:1"), "{:?}", grid(3));
}

/// With `up_to_order`, one wrong element counts as one difference: the other elements still match.
#[test]
fn a_wrong_element_is_reported_in_any_order() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let declared = "[[compute]]\nentry = \"turn\"\nworkgroups = 1\nwith = { out = { size = 64 } }\n\
                    [compute.after.out]\nup_to_order = true\ntable = \"out.csv\"\n";
    write(folder.path(), "turn.test.toml", declared);
    let rows: String = (0..64).map(|row| format!("{row}\n")).collect();
    write(folder.path(), "out.csv", &format!("value\n{rows}"));
    let turn = |value: &str| {
        let text = format!(
            "@group(0) @binding(0) var<storage, read_write> out: array<u32>;\n\
             @compute @workgroup_size(64) fn turn(@builtin(local_invocation_index) i: u32) {{ out[63u - i] = {value}; }}\n"
        );
        write(folder.path(), "turn.wgsl", &text);
        karat(folder.path(), &["test", ".", "--paths", "cpu"])
    };
    turn("i").good();
    let wrong = turn("select(i, 99u, i == 5u)");
    for part in ["1 of 64 elements differ", "[58]", "actual = 99", "expected = 5"] {
        assert!(wrong.code == Some(1) && wrong.out.contains(part), "no `{part}`: {wrong:?}");
    }
}

#[test]
fn passes_before_the_last_one_are_tested_too() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let pass = |name: &str, value: &str| {
        format!(
            "@compute @workgroup_size(8) fn {name}(@builtin(local_invocation_index) i: u32) {{ out[i] = {value}; }}\n"
        )
    };
    let text = format!(
        "@group(0) @binding(0) var<storage, read_write> out: array<u32>;\n{}{}{}",
        pass("clear", "0u"),
        pass("count", "out[i] + 1u"),
        pass("other", "7u")
    );
    write(folder.path(), "two.wgsl", &text);
    let declared = "[[compute]]\nname = \"both\"\npasses = [{ entry = \"clear\", workgroups = 1 }, { entry = \"count\", \
                    workgroups = 1 }]\nwith = { out = { size = 8, range = \"0..9\" } }\n\
                    [compute.after.out]\nequals = [1, 1, 1, 1, 1, 1, 1, 1]\n";
    write(folder.path(), "two.test.toml", declared);
    karat(folder.path(), &["test", ".", "--paths", "cpu"]).good();
    let list = karat(folder.path(), &["list"]).good();
    let of = |name: &str| list.lines().find(|line| line.contains(name)).unwrap_or_default();
    assert!(of("clear").contains("yes") && of("count").contains("yes"), "{list}");
    assert!(of("other").contains("no"), "{list}");
}

/// A module with subgroups needs the line `enable subgroups;`, which naga doesn't know. Karat runs the module, and
/// errors show line numbers of the author's file.
#[test]
fn a_module_that_enables_subgroups_runs_with_its_own_lines() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let text = "enable subgroups;\n\
                @group(0) @binding(0) var<storage, read_write> out: array<u32>;\n\
                @compute @workgroup_size(64) fn sum(@builtin(local_invocation_index) i: u32) {\n    \
                let sum = subgroupAdd(1u);\n    out[i] = select(0u, 1u, sum > 0u);\n}\n";
    write(folder.path(), "s.wgsl", text);
    let declared = "[[compute]]\nentry = \"sum\"\nworkgroups = 1\nwith = { out = { size = 64 } }\n\
                    [compute.after.out]\nequals = [";
    let declared = format!("{declared}{}]\n", ["1"; 64].join(", "));
    write(folder.path(), "s.test.toml", &declared);
    karat(folder.path(), &["test", ".", "--paths", "cpu,vulkan"]).good();
    // Errors have the line of the author's file.
    write(folder.path(), "s.wgsl", &text.replace("out[i] =", "out[j] ="));
    let ran = karat(folder.path(), &["test", ".", "--paths", "cpu"]);
    assert!(ran.code == Some(1) && format!("{ran:?}").contains("s.wgsl:5:9"), "{ran:?}");
}

/// A wrong expectation about a pass fails, and the message names the wrong element or the wrong key.
#[test]
fn wrong_passes_fail_with_the_element() {
    let of = |entry: &str, with: &str, after: &str| {
        let declared =
            format!("[[compute]]\nentry = \"{entry}\"\nworkgroups = 1\nwith = {with}\n{after}\n");
        let folder = shaders(&declared);
        let ran = karat(folder.path(), &["test", ".", "--paths", "cpu"]);
        assert!(ran.code != Some(0), "{declared}: {ran:?}");
        format!("{}{}", ran.out, ran.err)
    };
    let input = "{ input = [1, 2, 3, 4, 5, 6, 7, 8], keys = { size = 8 } }";
    let root = "{ out = { size = 8, range = \"-4..-1\" } }";
    for (entry, with, after, parts) in [
        ("reverse", input, "[compute.after.keys]\nsorted = true", ["first: [1]", "at least 8"]),
        (
            "reverse",
            "{ keys = { size = 8 }, input = { values = [1, 2] } }",
            "[compute.after.keys]\nsorted = true",
            ["write the elements as a list, `input = [1, 2]`", ".test.toml:4:31"],
        ),
        (
            "mirror",
            input,
            "[compute.after.keys]\nsorted = \"descending\"\nequals = 1",
            ["first: [0]", "expected = 1"],
        ),
        (
            "wait",
            "{ keys = [9, 9] }\naccept_race = { keys = \"meant\" }",
            "[compute.after.keys]\nwritten = true",
            ["1 of 2 elements differ", "actual = not written"],
        ),
        (
            "reverse",
            input,
            "[compute.after.keys]\nunchanged = true",
            ["actual = 8", "expected = 0"],
        ),
        (
            "reverse",
            input,
            "[compute.after.keys]\npermutation_of = \"keys\"",
            ["once too often", "0, which is missing"],
        ),
        (
            "reverse",
            input,
            "[compute.after.keys]\nin_range = [0, 7]",
            ["actual = 8", "expected = [0, 7]"],
        ),
        (
            "add",
            "{ input = [1, 2], total = 1 }",
            "[compute.after.total]\nsum_of = \"input\"",
            ["actual = 4", "expected = 3"],
        ),
        ("root", root, "[compute.after.out]\nfinite = true", ["actual = NaN", "m.wgsl:12:"]),
        ("root", root, "no_hazards = true", ["NaN at `sqrt(out[i])`", "m.wgsl:12:"]),
        (
            "root",
            root,
            "no_hazards = [\"by_zero\", \"nan\"]",
            ["NaN at `sqrt(out[i])`", "none of these hazards occurs: by zero, NaN"],
        ),
        (
            "wait",
            "{ keys = [9, 9] }",
            "[compute.after.keys]\nin_range = [0, 9]",
            ["race on `keys[0]`", "m.wgsl:13:"],
        ),
    ] {
        let said = of(entry, with, after);
        assert!(parts.iter().all(|part| said.contains(part)), "{entry} {after}: {said}");
    }
    for (entry, with, after, parts) in [
        (
            "revers",
            input,
            "[compute.after.keys]\nsorted = true",
            ["did you mean `m::reverse`", "m.test.toml:2:1"],
        ),
        (
            "reverse",
            "{ inputs = [1] }",
            "[compute.after.keys]\nsorted = true",
            ["`inputs`", "m.test.toml:4:1"],
        ),
        ("reverse", input, "[compute.after.kyes]\nsorted = true", ["kyes", "m.test.toml:5:"]),
        ("reverse", input, "", ["asserts nothing about `m::reverse`", "m.test.toml:1:1"]),
        (
            "reverse",
            input,
            "[compute.after.keys]\n",
            ["the test asserts nothing about `keys`", "m.test.toml:5:16"],
        ),
        ("reverse", input, "[compute.after.keys]\nsortd = true", ["sortd", "m.test.toml:6:1"]),
        (
            "reverse",
            input,
            "[compute.after.keys]\nsorted = false",
            ["asserts nothing", "m.test.toml:6:1"],
        ),
        (
            "reverse",
            input,
            "[compute.after.keys]\nsorted = true\ntolerance = \"4 ulp\"",
            ["`tolerance` does nothing here", "m.test.toml:7:1"],
        ),
        (
            "reverse",
            "{ input = { size = 0 }, keys = { size = 8 } }",
            "[compute.after.keys]\nsorted = true",
            ["isn't a number of elements", "m.test.toml:4:1"],
        ),
        (
            "reverse",
            "{ input = { sise = 8 }, keys = { size = 8 } }",
            "[compute.after.keys]\nsorted = true",
            ["did you mean `size`", "m.test.toml:4:1"],
        ),
        (
            "reverse",
            "{ input = { size = 8 } }",
            "[compute.after.keys]\nsorted = true",
            ["bind `m::keys` by `with`", "m.wgsl:3:23"],
        ),
        (
            "shade",
            "{}",
            "[compute.after.keys]\nsorted = true",
            ["compute entry point", "m.test.toml:2:1"],
        ),
        (
            "reverse",
            input,
            "[compute.after.keys]\nagrees_with = \"reverse\"",
            ["can't be its own reference", "m.test.toml:6:1"],
        ),
        (
            "reverse",
            input,
            "fails_on = { vulcan = \"no\" }\n[compute.after.keys]\nequals = 0",
            ["did you mean `vulkan`", "m.test.toml:5:1"],
        ),
        (
            "reverse",
            input,
            "[compute.after.keys]\nequals = 0\ntolerance = \"4 upl\"",
            ["`abs 1e-6` or `exact`\n", "m.test.toml:7:1"],
        ),
        ("root", root, "no_hazards = [\"nam\"]", ["did you mean `nan`", "m.test.toml:5:14"]),
        (
            "root",
            root,
            "no_hazards = [\"race\"]",
            [
                "race: Karat checks each [[compute]] for hazards of this kind anyway",
                "m.test.toml:5:1",
            ],
        ),
    ] {
        let said = of(entry, with, after);
        assert!(parts.iter().all(|part| said.contains(part)), "{entry} {with} {after}: {said}");
    }
}

/// If a test names a pass that doesn't exist, the message names the pass, not a resource that only this pass would use.
#[test]
fn a_misspelt_later_pass_is_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shader = "@group(0) @binding(0) var<storage, read_write> data: array<u32, 4>;\n\
                  @group(0) @binding(1) var<storage, read_write> other: array<u32, 4>;\n\
                  @compute @workgroup_size(1) fn first() { data[0] = 1u; }\n\
                  @compute @workgroup_size(1) fn second() { other[0] = data[0]; }\n";
    let declared = |name: &str, expected: &str| {
        format!(
            "[[compute]]\npasses = [{{ entry = \"first\", workgroups = 1 }}, {{ entry = \"{name}\", workgroups = 1 }}]\n\
             with = {{ data = {{}}, other = {{}} }}\n[compute.after.other]\ntable = \"{expected}\"\n"
        )
    };
    write(folder.path(), "m.wgsl", shader);
    write(folder.path(), "right.csv", "value\n1\n0\n0\n0\n");
    write(folder.path(), "wrong.csv", "value\n1\n0\n\n7\n0\n");
    write(folder.path(), "half.csv", "value\n1\n0\n0.5\n0\n");
    let ran = |name: &str, expected: &str| {
        write(folder.path(), "m.test.toml", &declared(name, expected));
        karat(folder.path(), &["test", ".", "--paths", "cpu"])
    };
    let slip = ran("sekond", "right.csv");
    assert!(slip.out.contains("`m::sekond` isn't a compute entry point; did you mean"), "{slip:?}");
    assert!(!slip.out.contains("there is no variable"), "{slip:?}");
    ran("second", "right.csv").good();
    // The message names the table's row, and the check's name contains the resource.
    let differs = ran("second", "wrong.csv");
    assert!(differs.out.contains("  row of the first element: wrong.csv:5:1"), "{}", differs.out);
    assert!(differs.out.contains("after.other.agrees_with"), "{}", differs.out);
    let half = ran("second", "half.csv");
    assert!(
        half.out.contains("`0.5` isn't of type u32, so no result can equal `0.5`"),
        "{}",
        half.out
    );
    assert!(half.out.contains("half.csv:4:1"), "{}", half.out);
}

/// If passes race, each assertion about these passes fails. The report has the message about the race only once.
#[test]
fn one_race_has_one_message() {
    let folder = shaders(
        "[[compute]]\nentry = \"wait\"\nworkgroups = 1\nwith = { keys = [9, 9] }\n\
         [compute.after.keys]\nin_range = [0, 9]\nwritten = true\n",
    );
    let ran = karat(folder.path(), &["test", ".", "--paths", "cpu"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert_eq!(ran.out.matches("  --> m.wgsl:13:").count(), 1, "{}", ran.out);
    assert!(
        ran.out.contains("\n  the test `m::wait keys in_range` fails with the same error\n"),
        "{}",
        ran.out
    );
}

/// The sanitizer examines passes, but not draws. The output counts the checks of frames whose draws
/// write into buffers.
#[test]
fn draws_that_write_are_counted() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let text = "@group(0) @binding(0) var<storage, read_write> count: atomic<u32>;\n\
                @fragment fn collect() -> @location(0) vec4f {\n    \
                atomicAdd(&count, 1u);\n    return vec4f(1.0);\n}\n\
                @fragment fn plain() -> @location(0) vec4f { return vec4f(1.0); }\n";
    write(folder.path(), "m.wgsl", text);
    let last = |fragment: &str, with: &str| {
        let frame =
            format!("[[frame]]\nname = \"f\"\nfragment = \"{fragment}\"\nsize = [8, 8]\n{with}");
        write(folder.path(), "m.test.toml", &frame);
        let ran = karat(folder.path(), &["test", ".", "--paths", "vulkan"]);
        assert!(ran.out.contains("1 check, 1 failed"), "no golden is there yet: {ran:?}");
        ran.out.contains("; the sanitizer didn't check everything in 1 check of passes or draws")
    };
    assert!(last("collect", "with = { count = 0 }\n"));
    // A test that needs no frame runs without frames.
    let test = "[[test]]\nfunction = \"plain\"\nfinite = true\n";
    let declared = std::fs::read_to_string(folder.path().join("m.test.toml")).expect("written");
    write(folder.path(), "m.test.toml", &format!("{declared}{test}"));
    let ran = karat(folder.path(), &["test", ".", "--paths", "cpu", "--no-frames"]).good();
    assert!(ran.contains("1 check, 0 failed") && ran.contains("no frame was drawn"), "{ran}");
    assert!(!last("plain", ""));
    // The entry points of a frame count as tested.
    let list = karat(folder.path(), &["list"]).good();
    let has = |name: &str, word: &str| {
        list.lines().any(|line| line.contains(name) && line.contains(word))
    };
    assert!(has("m::plain", "  yes  ") && has("m::collect", "  no  "), "{list}");
}

#[test]
fn edits_of_entry_points_are_compared() {
    let (old, new) = (shaders(""), shaders(""));
    write(new.path(), "m.wgsl", &SHADER.replace("input[7u - i]", "input[6u - min(i, 6u)]"));
    let before = old.path().display().to_string();
    let ran = karat(new.path(), &["compare", &before]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.out.contains("changed    m::reverse"), "{}", ran.out);
    assert!(ran.out.contains("words changed") && ran.out.contains("keys["), "{}", ran.out);
}

/// The frame has several draws: a background, a mesh from a table in which one triangle hides a part of another
/// triangle, and a draw with additive blending.
#[test]
fn a_frame_has_draws_with_meshes() {
    let shader = "\
struct Vertex { @location(0) position: vec3f, @location(1) color: vec3f, @location(2) layer: u32 }
struct Varying { @builtin(position) at: vec4f, @location(0) color: vec3f }
@vertex fn vs(v: Vertex) -> Varying {
    return Varying(vec4f(v.position, 1.0), v.color * f32(1u + v.layer));
}
@vertex fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
    return vec4f(f32(i % 2u) * 4.0 - 1.0, f32(i / 2u) * 4.0 - 1.0, 0.25, 1.0);
}
@fragment fn fs(v: Varying) -> @location(0) vec4f { return vec4f(v.color, 1.0); }
@fragment fn quarter() -> @location(0) vec4f { return vec4f(0.25); }
@fragment fn ground() -> @location(0) vec4f { return vec4f(0.5, 0.5, 0.5, 1.0); }
";
    let declared = "\
[[frame]]
name = \"crossed\"
size = [16, 16]
[[frame.draws]]
fragment = \"ground\"
[[frame.draws]]
vertex = \"vs\"
fragment = \"fs\"
mesh = \"two.csv\"
cull = \"none\"
[[frame.draws]]
vertex = \"corner\"
fragment = \"quarter\"
vertices = 3
blend = \"add\"
depth_compare = \"always\"
depth_write = false
";
    // The second triangle lies behind the first, and covers the pixels that the first leaves free.
    let mesh = "position.x,position.y,position.z,color.x,color.y,color.z,layer
-1,-1,0.5,1,0,0,0
1,-1,0.5,1,0,0,0
-1,1,0.5,1,0,0,0
-1,-1,0.75,0,0,0.5,1
3,-1,0.75,0,0,0.5,1
-1,3,0.75,0,0,0.5,1
";
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, text) in [("m.wgsl", shader), ("m.test.toml", declared), ("two.csv", mesh)] {
        write(folder.path(), name, text);
    }
    let test = || karat(folder.path(), &["test", ".", "--paths", "vulkan"]);
    assert!(test().out.contains("frame `crossed` has no golden"));
    let drawn = folder.path().join("golden/crossed.new.exr");
    let image = karat::Image::read(&drawn).expect("it was drawn");
    assert_eq!(image.pixels()[14 * 16 + 1][..3], [1.25, 0.25, 0.25], "the first mesh, in front");
    assert_eq!(
        image.pixels()[16 + 14][..3],
        [0.25, 0.25, 1.25],
        "the second one, of the second layer"
    );
    karat(
        folder.path(),
        &["accept", "crossed", "--any-adapter", "--because", "both meshes are there"],
    )
    .good();
    test().good();
    write(folder.path(), "two.csv", &mesh.replace("0.75", "0.25"));
    assert!(test().out.contains("differs from its golden"), "the order in depth has changed");
    for (from, to, part) in [
        ("two.csv", "tow.csv", "draws: can't read"),
        ("cull = \"none\"", "cull = \"non\"", "did you mean `none`?"),
        ("vertices = 3", "vertices = 4", "must be a positive multiple of 3, but is 4"),
        (
            "vertex = \"corner\"",
            "vertex = \"vs\"",
            "`vs` reads `position` at @location(0), but vertices without a mesh have no attributes",
        ),
        ("vertex = \"vs\"", "vertex = \"vx\"", "no vertex entry point `vx`"),
        (
            "vertex = \"vs\"",
            "vertex = \"corner\"",
            "must read the mesh's position at `@location(0)`",
        ),
        ("fragment = \"ground\"", "", "a draw needs a `fragment` or a `vertex` function"),
        (
            "vertex = \"vs\"",
            "vertex = \"corner\"",
            "must read the mesh's position at `@location(0)`",
        ),
        ("fragment = \"ground\"", "", "a draw needs a `fragment`"),
        (
            "size = [16, 16]",
            "size = [16, 16]\nfragment = \"fs\"",
            "remove the frame's `vertex` and `fragment`",
        ),
        (
            "mesh = \"two.csv\"",
            "mesh = \"two.csv\"\nindices = [0, 1, 7]",
            "the index 7 is too large",
        ),
        (
            "mesh = \"two.csv\"",
            "mesh = \"two.csv\"\nindices = [0, 1]",
            "must be a positive multiple of 3",
        ),
        ("vertices = 3", "vertices = 3\ninstances = 0", "0 instances draw nothing"),
        ("vertices = 3", "indices = [0, 1, 2]", "`indices` need a `mesh`"),
        ("blend = \"add\"", "blend = \"plus\"", "there is no blending `plus`"),
    ] {
        let text = declared.replace(from, to);
        write(folder.path(), "m.test.toml", &text);
        let ran = test();
        assert!(ran.code != Some(0) && ran.out.contains(part), "{to}: {ran:?}");
        // The error has its own line in each draw.
        if to.ends_with("= 0") || to.ends_with("\"plus\"") {
            let own = to.lines().last().unwrap_or_default();
            let line = text.lines().position(|line| line == own).expect("it is there") + 1;
            assert!(ran.out.contains(&format!("m.test.toml:{line}:1")), "{to}: {ran:?}");
        }
    }
}

/// A test fails if its result depends on the order of the invocations. The replay uses the order in which the test
/// failed. With `--schedules 0`, Karat tries only the usual order.
#[test]
fn an_order_that_matters_is_replayed() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let shader = "@group(0) @binding(0) var<storage, read_write> last: atomic<u32>;
@compute @workgroup_size(64) fn own(@builtin(local_invocation_index) i: u32) {
    if i == 31u { atomicStore(&last, 1u); }
    if i == 32u { atomicStore(&last, 2u); }
}
";
    write(folder.path(), "m.wgsl", shader);
    let declared = "[[compute]]\nentry = \"own\"\nworkgroups = [1, 1, 1]\nwith = { last = 0 }\n[compute.after.last]\nequals = 2\n";
    write(folder.path(), "m.test.toml", declared);
    let none = karat(folder.path(), &["test", ".", "--schedules", "0"]).good();
    assert!(none.contains("no other order of invocations was tried"), "{none}");
    let failed = karat(folder.path(), &["test", "."]);
    assert!(failed.out.contains("one after the other, the last one first"), "{failed:?}");
    let replayed = karat(folder.path(), &["replay"]);
    assert!(replayed.out.contains("depends on the order of invocations"), "{replayed:?}");
    assert_eq!((failed.code, replayed.code), (Some(1), Some(1)), "{replayed:?}");
}
