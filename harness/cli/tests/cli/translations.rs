//! Tests `karat translate` and `karat matrix`.

use super::*;

const BLEND: &str = "/// A line.\nfn blend(x: f32, y: f32) -> f32 { return x * 3.0 - y; }\n\
                     fn count(n: u32) -> u32 { return n + 1u; }\n\
                     fn raise(x: f32) { var y = x; y += 1.0; }\n";

const FRAME: &str = "@vertex fn corner(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {\n    \
                     return vec4f(f32(i), 0.0, 0.0, 1.0);\n}\n\
                     @fragment fn shade() -> @location(0) vec4f { return vec4f(1.0); }\n";

pub(super) fn shaders() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "Cargo.toml", "[workspace]\n");
    write(&folder.path().join("shaders"), "maths.wgsl", BLEND);
    write(&folder.path().join("shaders"), "frame.wgsl", FRAME);
    folder
}

#[test]
fn a_function_is_printed_in_each_language() {
    let folder = shaders();
    for (language, mark) in [
        ("glsl", "#version 450 core"),
        ("glsl-es", "#version 310 es"),
        ("hlsl", "[numthreads(64, 1, 1)]"),
        ("hlsl6", "HLSL for shader model 6.2"),
        ("msl", "#include <metal_stdlib>"),
        ("wgsl", "fn blend("),
    ] {
        let text = karat(folder.path(), &["translate", "maths::blend", "--to", language]).good();
        assert!(text.starts_with("// ") && text.contains(mark), "{language}: {text}");
        assert!(text.contains('3'), "{language}: {text}");
    }
    // SPIR-V is written as binary words, also into a pipe.
    let bytes = command(folder.path(), &["translate", "maths::blend", "--to", "spirv"]).output();
    let bytes = bytes.expect("it runs").stdout;
    assert_eq!(bytes[..4], 0x0723_0203_u32.to_le_bytes());
    let file = folder.path().join("blend.spv");
    let out = ["translate", "maths::blend", "--to", "spirv", "--out", "blend.spv"];
    assert_eq!(karat(folder.path(), &out).good(), "");
    assert_eq!(std::fs::read(file).expect("it is written"), bytes);
}

#[test]
fn a_module_is_printed_with_its_entry_points() {
    let folder = shaders();
    let glsl = karat(folder.path(), &["translate", "frame", "--to", "glsl"]).good();
    assert_eq!(glsl.matches("#version 450").count(), 2, "one text an entry point: {glsl}");
    let one = ["translate", "frame", "--to", "glsl", "--entry-point", "shade"];
    assert_eq!(karat(folder.path(), &one).good().matches("#version 450").count(), 1);
    let hlsl = karat(folder.path(), &["translate", "frame", "--to", "hlsl"]).good();
    assert!(hlsl.contains("corner, shade") && hlsl.contains("SV_Target0"), "{hlsl}");
    let file = ["translate", "frame", "--to", "hlsl", "--shaders", "shaders/frame.wgsl"];
    assert_eq!(karat(folder.path(), &file).good(), hlsl, "a file alone is a package");
    let valid = ["translate", "frame", "--to", "wgsl", "--validate"];
    let said = karat(folder.path(), &valid).good();
    assert!(said.contains("naga shader.wgsl") && said.contains("valid"), "{said}");
}

#[test]
fn a_failed_translation_is_an_error() {
    let folder = shaders();
    let error = |arguments: &[&str]| {
        let ran = karat(folder.path(), &[&["translate"], arguments].concat());
        assert_eq!(ran.code, Some(2), "{ran:?}");
        ran.err
    };
    assert!(error(&["maths::blend", "--to", "hlls"]).contains("'hlsl'"), "the nearest is told");
    assert!(error(&["maths::blnd", "--to", "hlsl"]).contains("maths::blend"));
    assert!(error(&["maths", "--to", "hlsl"]).contains("name a function of the module"));
    let raise = error(&["maths::raise", "--to", "hlsl"]);
    assert!(raise.contains("the function returns nothing"), "{raise}");
    let entry = error(&["frame", "--to", "hlsl", "--entry-point", "shad"]);
    assert!(entry.contains("no entry point `shad`"), "{entry}");
    let out = error(&["frame", "--to", "glsl", "--out", "frame.glsl"]);
    assert!(out.contains("name an entry point with --entry-point"), "{out}");
    let over = error(&["maths::blend", "--to", "wgsl", "--out", "shaders/maths.wgsl"]);
    assert!(over.contains("would overwrite"), "{over}");
    let text = std::fs::read_to_string(folder.path().join("shaders/maths.wgsl"));
    assert_eq!(text.expect("it is there"), BLEND);
    let both = error(&["maths::blend", "--to", "glsl", "--entry-point", "main"]);
    assert!(both.contains("remove --entry-point"), "{both}");
}

/// Keeps only the columns that run on this machine: some machines have no GL.
#[cfg(target_os = "linux")]
pub(super) fn run_here<'c>(columns: impl IntoIterator<Item = &'c str>) -> Vec<&'c str> {
    let gl = karat::unstable::path::adapter(karat::Path::GL).is_ok();
    let of_gl = |column: &str| column == "gl" || column.starts_with("gl:");
    columns.into_iter().filter(|column| gl || !of_gl(column)).collect()
}

/// Returns the cells of one row, by column.
#[cfg(target_os = "linux")]
pub(super) fn row(
    matrix: &serde_json::Value,
    name: &str,
) -> std::collections::BTreeMap<String, serde_json::Value> {
    let columns = matrix[0]["columns"].as_array().expect("columns");
    let rows = matrix[0]["rows"].as_array().expect("rows");
    let row = rows.iter().find(|row| row["name"] == name).unwrap_or_else(|| panic!("no {name}"));
    let cells = row["cells"].as_array().expect("cells").iter();
    let names = columns.iter().map(|column| column["name"].as_str().expect("a name").to_owned());
    names.zip(cells.cloned()).collect()
}

#[cfg(target_os = "linux")]
#[test]
fn the_matrix_says_how_far_each_row_gets() {
    let folder = shaders();
    let ran = karat(folder.path(), &["matrix", "--json", "--cases", "64"]);
    let matrix = json(&ran.good());
    let blend = row(&matrix, "maths::blend");
    let columns = run_here([
        "vulkan",
        "gl",
        "vulkan:wgsl",
        "vulkan:spirv",
        "vulkan:glsl",
        "vulkan:hlsl",
        "cpu",
    ]);
    for column in &columns {
        let cell = &blend[*column];
        assert_eq!(cell["status"], "agrees", "{column}: {cell}");
        assert_eq!(cell["compared"], 64, "{column}: {cell}");
        assert!(cell["validators"].as_array().is_some_and(|said| !said.is_empty()), "{cell}");
    }
    // This machine can't run these columns, and Karat assumes nothing about their results.
    assert_eq!(blend["metal"]["status"], "translated");
    assert_eq!(blend["metal"]["stopped"]["why"], "no_validator");
    assert_eq!(blend["dx12"]["status"], "valid");
    assert_eq!(blend["dx12"]["stopped"]["why"], "unavailable");
    let shade = row(&matrix, "frame::shade");
    assert_eq!(shade["vulkan"]["status"], "agrees");
    // The kernel that calls the function has no attributes. The translated entry point has them.
    let corner = row(&matrix, "frame::corner");
    for column in &columns {
        let cell = &corner[*column];
        assert_eq!(
            (&cell["status"], &cell["compared"]),
            (&json("\"agrees\""), &json("64")),
            "{column}"
        );
    }
    assert_eq!(corner["metal"]["status"], "translated");
    // Functions that no kernel can call are rows without cells.
    assert!(row(&matrix, "maths::raise").is_empty());

    let text = karat(folder.path(), &["matrix", "--cases", "64", "--only", "maths"]).good();
    let line = |name: &str| text.lines().find(|line| line.starts_with(name)).map(str::to_owned);
    let count = line("maths::count (function)").expect("a row");
    assert_eq!(count.matches("agrees").count(), columns.len(), "{count}");
    assert!(line("maths::raise (not callable)").is_some_and(|raise| !raise.contains("agrees")));
    assert!(!text.contains("frame::"), "{text}");
}

/// A path such as `vulkan:glsl` includes a route, so `karat call` can call a function on each route.
#[cfg(target_os = "linux")]
#[test]
fn a_function_can_be_called_on_each_translation_route() {
    let folder = shaders();
    let image = "@group(0) @binding(0) var image: texture_2d<f32>;\n\
                 @group(0) @binding(1) var near: sampler;\n\
                 fn texel(x: f32) -> vec4f { return textureSampleLevel(image, near, vec2f(x), 0.0); }\n";
    write(&folder.path().join("shaders"), "image.wgsl", image);
    let call = |path: &str, function: &[&str]| {
        karat(folder.path(), &[&["call", "--path", path], function].concat())
    };
    let routes =
        ["vulkan:wgsl", "vulkan:spirv", "vulkan:glsl", "vulkan:hlsl", "gl:wgsl", "gl:spirv"];
    for route in run_here(routes) {
        let out = call(route, &["maths::blend", "2", "1"]).good();
        assert!(out.contains(route) && out.contains('5'), "{out}");
        // `karat doctor` reports that the route opens.
        karat(folder.path(), &["doctor", "--require", route]).good();
    }
    for (route, message) in [
        ("gl:hlsl", "no compiler translates hlsl for this API"),
        ("vulkan:msl", "execution path `vulkan:msl` has no route `msl`"),
    ] {
        let ran = call(route, &["maths::blend", "2", "1"]);
        assert!(ran.code != Some(0) && ran.err.contains(message), "{ran:?}");
    }
    // If a route can't bind a resource, there is no result, and the cell has the reason.
    let matrix = ["matrix", "--json", "--only", "texel"];
    let matrix = json(&karat(folder.path(), &matrix).good());
    for (column, why) in [("vulkan:glsl", "combines each texture"), ("vulkan:hlsl", "from a heap")]
    {
        let cell = &row(&matrix, "image::texel")[column];
        assert_eq!(cell["status"], "valid", "{cell}");
        assert!(cell["stopped"]["says"].as_str().is_some_and(|says| says.contains(why)), "{cell}");
    }
}

/// A shader with features of entry points: workgroup memory, a barrier, atomics, and buffers in several groups.
const SUMS: &str = "struct Params { scale: f32, m: mat4x4f, list: array<vec4f, 3> }\n\
    @group(0) @binding(0) var<uniform> params: Params;\n\
    @group(1) @binding(3) var<storage, read_write> sums: array<f32>;\n\
    @group(1) @binding(4) var<storage, read_write> bins: array<atomic<u32>, 8>;\n\
    @group(2) @binding(0) var<storage, read> ints: array<u32>;\n\
    @group(2) @binding(1) var image: texture_2d<f32>;\n\
    var<workgroup> last: f32;\n\
    @compute @workgroup_size(64)\n\
    fn add(@builtin(local_invocation_index) i: u32) {\n    \
        if i == 63u { last = params.scale * 2.0 + params.m[1].y; }\n    workgroupBarrier();\n    \
        sums[i] = last + params.list[i % 3u].z + f32(i);\n    \
        atomicAdd(&bins[i % 8u], ints[i] + 1u);\n}\n\
    @compute @workgroup_size(1)\n\
    fn texels() { sums[0] = textureLoad(image, vec2i(), 0).x; }\n\
    @group(2) @binding(2) var grey: texture_storage_2d<rgba8unorm, write>;\n\
    @compute @workgroup_size(8, 8)\n\
    fn greys(@builtin(global_invocation_id) id: vec3u) { textureStore(grey, id.xy, vec4f(sin(f32(id.x + id.y)))); }\n\
    @compute @workgroup_size(64)\n\
    fn groups(@builtin(global_invocation_id) id: vec3u, @builtin(num_workgroups) all: vec3u) { sums[id.x] = f32(all.x); }\n\
    @compute @workgroup_size(1)\n\
    fn nothing() {}\n\
    @compute @workgroup_size(1)\n\
    fn waits() { while atomicLoad(&bins[0]) < 1000000000u { atomicAdd(&bins[1], 1u); } sums[0] = 1.0; }\n";

// Lesson 114
#[cfg(target_os = "linux")]
#[test]
fn compute_entry_points_are_run() {
    let folder = shaders();
    write(folder.path(), "sums.wgsl", SUMS);
    let columns = "vulkan,gl,vulkan:wgsl,vulkan:spirv,vulkan:glsl,vulkan:hlsl,msl,cpu";
    let columns = run_here(columns.split(',')).join(",");
    let arguments = ["matrix", "--json", "--shaders", "sums.wgsl", "--columns", &columns];
    let matrix = json(&karat(folder.path(), &arguments).good());
    for (column, cell) in row(&matrix, "add") {
        match column.as_str() {
            "msl" => assert_eq!(cell["status"], "translated", "{cell}"),
            _ => {
                assert_eq!(cell["status"], "agrees", "{column}: {cell}");
                // The pass writes 64 sums with the elements that follow them, and 8 bins.
                assert!(cell["compared"].as_u64().is_some_and(|words| words >= 72), "{cell}");
            }
        }
    }
    for column in run_here(["vulkan", "gl", "vulkan:wgsl", "vulkan:spirv"]) {
        for name in ["texels", "greys"] {
            let cell = &row(&matrix, name)[column];
            assert_eq!(cell["status"], "agrees", "{name} on {column}: {cell}");
        }
    }
    // In naga's HLSL this value comes from the host. A driver that reads an unbound resource ends the process.
    for column in run_here(["vulkan", "gl", "vulkan:hlsl"]) {
        let cell = &row(&matrix, "groups")[column];
        let refused =
            cell["stopped"]["says"].as_str().is_some_and(|says| says.contains("num_workgroups"));
        assert!(refused == (column == "vulkan:hlsl"), "{column}: {cell}");
        assert!(refused || cell["status"] == "agrees", "{column}: {cell}");
    }
    // This shader would hang a driver, and the deadline would end the whole matrix.
    for column in run_here(["vulkan", "gl", "vulkan:hlsl"]) {
        let waits = &row(&matrix, "waits")[column];
        assert_eq!(waits["stopped"]["why"], "not_run", "{waits}");
        let says = waits["stopped"]["says"].as_str().expect("a reason");
        assert!(says.contains("with generated data, this loop runs"), "{says}");
        assert!(says.contains("sums.wgsl:25:14"), "{says}");
    }
    let nothing = &row(&matrix, "nothing")["vulkan"];
    assert_eq!(nothing["stopped"]["why"], "nothing_to_compare", "{nothing}");
}

/// WGSL (section 15.7.2) lets drivers replace a subnormal number by 0, so Karat accepts 0 in a pass's buffer.
#[test]
fn a_subnormal_number_that_a_pass_leaves_may_be_zero() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let small = "@group(0) @binding(0) var<storage, read_write> d: array<f32>;
        @compute @workgroup_size(64) fn main(@builtin(global_invocation_id) id: vec3u) {
            if id.x < arrayLength(&d) { d[id.x] = f32(id.x) * 1e-40; }
        }";
    let arguments = [
        "matrix",
        "--shaders",
        "small.wgsl",
        "--columns",
        "cpu,cpu:ftz",
        "--require",
        "cpu:ftz=agrees",
    ];
    write(folder.path(), "small.wgsl", small);
    karat(folder.path(), &arguments).good();
    // With the type `u32`, the same bits are other numbers.
    let whole = small.replace("array<f32>", "array<u32>");
    write(
        folder.path(),
        "small.wgsl",
        &whole.replace("f32(id.x) * 1e-40", "bitcast<u32>(f32(id.x) * 1e-40)"),
    );
    assert_eq!(karat(folder.path(), &arguments).code, Some(1));
}

/// An entry point doesn't need the abilities that only other entry points of its module use. Karat doesn't judge
/// results that depend on the size of a subgroup, because this size differs between drivers.
// Lesson 142
#[cfg(target_os = "linux")]
#[test]
fn an_entry_point_needs_what_it_uses_itself() {
    let text = "@group(0) @binding(0) var<storage, read_write> sums: array<f32>;\n\
        @compute @workgroup_size(64) fn plain(@builtin(global_invocation_id) id: vec3u) { sums[id.x] += 1.0; }\n\
        @compute @workgroup_size(64) fn together(@builtin(global_invocation_id) id: vec3u) {\n\
        if id.x < arrayLength(&sums) { sums[id.x] = subgroupAdd(1.0); }\n}\n";
    let (matrix, ran) = matrix_of(text, &run_here(["vulkan", "gl", "cpu"]).join(","));
    for gl in run_here(["gl"]) {
        assert_eq!(row(&matrix, "plain")[gl]["status"], "agrees", "{ran:?}");
        let says = row(&matrix, "together")[gl]["stopped"]["says"].to_string();
        assert!(says.contains("subgroups"), "{says}");
    }
    let cell = &row(&matrix, "together")["cpu"];
    assert!(cell["differing"] == 0 && cell["open"].as_u64() > Some(0), "{cell}");
}

/// If the first buffer contents make a pass add only zeros, Karat runs the pass with other contents.
#[cfg(target_os = "linux")]
#[test]
fn the_matrix_looks_for_a_content_that_a_pass_changes() {
    let text = "@group(0) @binding(0) var<storage, read_write> output: array<u32>;\n\
        @group(0) @binding(1) var<storage, read> sums: array<u32>;\n\
        @compute @workgroup_size(64) fn add(@builtin(global_invocation_id) id: vec3u) {\n\
        if id.x < arrayLength(&output) && sums[0] > 0u { output[id.x] += sums[0]; }\n}\n";
    let (matrix, ran) = matrix_of(text, "vulkan,cpu");
    for column in run_here(["vulkan", "cpu"]) {
        assert_eq!(row(&matrix, "add")[column]["status"], "agrees", "{ran:?}");
    }
}

/// Each driver chooses its own mip level. So Karat compares only results that don't depend on the mip level.
// Lesson 142
#[cfg(target_os = "linux")]
#[test]
fn the_matrix_leaves_results_of_derivatives_open() {
    let text = "@group(0) @binding(0) var t: texture_2d<f32>;\n@group(0) @binding(1) var s: sampler;\n\
        @fragment fn shade(@location(0) uv: vec2f) -> @location(0) vec4f { return textureSample(t, s, uv); }\n\
        @fragment fn part(@location(0) uv: vec2f) -> @location(0) vec4f { return vec4f(fwidth(uv.x), sin(7.0 * uv), 1.0); }\n";
    let (matrix, ran) = matrix_of(text, "vulkan,cpu");
    assert_eq!(ran.code, Some(0), "{ran:?}");
    for name in ["shade", "part"] {
        let cell = &row(&matrix, name)["cpu"];
        assert!(cell["status"] == "agrees" && cell["compared"].as_u64() > Some(0), "{cell}");
    }
}

/// The override's value reaches the translations and the runs.
#[test]
fn overrides_have_values_in_the_matrix() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(
        folder.path(),
        "m.wgsl",
        "@id(3) override GAIN: f32 = 1.0;\noverride SIZE: u32;\n\
         fn gained(x: f32) -> f32 { return GAIN * x; }\n\
         @group(0) @binding(0) var<storage, read_write> data: array<u32>;\n\
         @compute @workgroup_size(4) fn fill(@builtin(global_invocation_id) i: vec3u) {\n    \
         data[i.x] = SIZE;\n}\n",
    );
    let matrix = |overrides: &[&str]| {
        let plain = ["matrix", "--shaders", ".", "--columns", "cpu,glsl,hlsl", "--json"];
        karat(folder.path(), &[&plain, overrides].concat())
    };
    let cells = |ran: &Ran| -> Vec<String> {
        let all: serde_json::Value = serde_json::from_str(&ran.out).expect("JSON");
        let rows = all[0]["rows"].as_array().expect("rows").clone();
        rows.iter()
            .flat_map(|row| row["cells"].as_array().cloned())
            .flatten()
            .map(|cell| cell["status"].as_str().unwrap_or("none").to_owned())
            .collect()
    };
    let without = cells(&matrix(&[]));
    assert!(without[3..].contains(&"none".to_owned()), "`SIZE` has no value: {without:?}");
    let with = cells(&matrix(&["--override", "SIZE=4", "--override", "3=2"]));
    assert!(!with.contains(&"none".to_owned()) && with.len() == 6, "{with:?}");
    let error = matrix(&["--override", "SIEZ=4"]).error();
    assert!(error.contains("no function and no entry point uses an override `SIEZ`"), "{error}");
    let error = matrix(&["--override", "SIZE=1.5"]).error();
    assert!(error.contains("the override `SIZE` must be a u32"), "{error}");
    // Of several packages, only one has the override.
    write(
        folder.path(),
        "Cargo.toml",
        "[workspace]\n[workspace.metadata.karat]\npackages = [\"a\", \"b\"]\n",
    );
    write(&folder.path().join("a"), "a.wgsl", "fn f(x: f32) -> f32 { return x; }\n");
    write(
        &folder.path().join("b"),
        "b.wgsl",
        "override GAIN = 1.0;\nfn g(x: f32) -> f32 { return GAIN * x; }\n",
    );
    karat(folder.path(), &["matrix", "--columns", "cpu", "--override", "GAIN=2"]).good();
    let error = matrix(&["--override", "SIZE"]).error();
    assert!(error.contains("write NAME=VALUE"), "{error}");
}

/// Runs `karat matrix` on one file, for those of the given columns that run on this machine. Returns the matrix as
/// JSON, and the output for people.
#[cfg(target_os = "linux")]
fn matrix_of(text: &str, columns: &str) -> (serde_json::Value, Ran) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "shader.wgsl", text);
    let columns = run_here(columns.split(',')).join(",");
    let common = ["matrix", "--shaders", "shader.wgsl", "--cases", "128", "--columns", &columns];
    let ran = karat(folder.path(), &common);
    let again = karat(folder.path(), &[&common[..], &["--json"]].concat());
    assert_eq!(again.code, ran.code, "{again:?}");
    (json(&again.out), ran)
}

// Lesson 154
#[cfg(target_os = "linux")]
#[test]
fn a_panic_of_naga_is_a_finding() {
    let atomics = "struct B { a: array<atomic<u32>, 4> } struct C { b: B }\n\
                   @group(0) @binding(0) var<storage, read_write> c: C;\n\
                   @compute @workgroup_size(1) fn m() { let w = c; }\n";
    // No other validator checks this column.
    let (matrix, ran) = matrix_of(atomics, "hlsl6");
    let cell = &row(&matrix, "m")["hlsl6"];
    assert_eq!(cell["stopped"]["why"], "panicked", "{cell}");
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.out.contains("PANICS") && ran.out.contains("naga panics as it writes"), "{ran:?}");
    assert!(ran.err.contains("the matrix has one wrong cell"), "{ran:?}");
}

/// A shader with accesses outside of arrays, vectors and textures. For such an access, a driver clamps the index, reads
/// 0, or does something else.
#[cfg(target_os = "linux")]
const OUTSIDE: &str = "@group(0) @binding(0) var p: texture_2d<f32>;\n\
    fn element(c: u32) -> f32 { var a = array<f32, 3>(1.0, 2.0, 3.0); return a[c % 4u]; }\n\
    fn lane(v: vec3f, i: i32) -> f32 { return v[i]; }\n\
    fn texel(at: vec2i) -> vec4f { return textureLoad(p, at, 0); }\n\
    fn root(x: f32) -> f32 { return sqrt(x) / x; }\n";

// Lesson 155
#[cfg(target_os = "linux")]
#[test]
fn results_that_wgsl_leaves_open_are_counted_and_pass() {
    let (matrix, ran) = matrix_of(OUTSIDE, "vulkan,gl,cpu");
    assert_eq!(ran.code, Some(0), "{ran:?}");
    let mut open = 0;
    for name in ["element", "lane", "texel", "root"] {
        for (column, cell) in row(&matrix, name) {
            assert_eq!(cell["status"], "agrees", "{name} on {column}: {cell}");
            assert_eq!(cell["differing"], 0, "{name} on {column}: {cell}");
            open += cell["open"].as_u64().expect("a count");
        }
    }
    assert!(open > 0, "drivers do the same now: nothing is shown here");
    let last = format!("{open} results in ");
    assert!(ran.out.lines().any(|line| line.starts_with(&last)), "{last}: {}", ran.out);
    assert!(ran.out.contains(" open"), "{}", ran.out);
}

// Lesson 155
#[cfg(target_os = "linux")]
#[test]
fn a_wrong_defined_result_beside_an_open_one_fails() {
    // x / 0 is x, and x % 0 is 0. The last two functions use an index outside of an array in each case, or in some
    // cases.
    let text = "fn quotient(a: i32, b: i32) -> i32 { return a / b; }\n\
                fn rest(a: i32, b: i32) -> i32 { return a % b; }\n\
                fn beside(c: u32, b: i32) -> vec2i {\n    \
                    var a = array<i32, 3>(4, 5, 6);\n    \
                    return vec2i(a[c + 3u], 7 / b);\n}\n\
                fn between(c: u32, b: i32) -> vec2i {\n    \
                    var a = array<i32, 3>(4, 5, 6);\n    \
                    return vec2i(a[c % 4u], 7 / b);\n}\n";
    let (matrix, ran) = matrix_of(text, "vulkan,gl,vulkan:glsl,cpu");
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for name in ["quotient", "rest", "beside", "between"] {
        let cells = row(&matrix, name);
        assert_eq!(cells["cpu"]["status"], "agrees", "{name}: {}", cells["cpu"]);
        for column in run_here(["gl", "vulkan:glsl"]) {
            let cell = &cells[column];
            assert_eq!(cell["stopped"]["why"], "differs", "{name} on {column}: {cell}");
        }
    }
}

/// Each buffer that the matrix generates has an element for each invocation. A generated one-dimensional texture has
/// only one mip level.
// Lesson 157
#[cfg(target_os = "linux")]
#[test]
fn generated_buffers_and_textures_of_the_matrix_are_valid_to_bind() {
    let text = "@group(0) @binding(0) var<storage, read_write> o: array<u32>;\n\
                @group(0) @binding(1) var line: texture_1d<f32>;\n\
                @compute @workgroup_size(256) fn each(@builtin(global_invocation_id) id: vec3u) {\n    \
                    o[id.x] = id.x + 1u;\n}\n\
                fn texel(i: u32) -> vec4f { return textureLoad(line, i % 16u, 0); }\n";
    let (matrix, ran) = matrix_of(text, "vulkan,vulkan:spirv,cpu");
    assert_eq!(ran.code, Some(0), "{ran:?}");
    for (column, cell) in row(&matrix, "each") {
        assert_eq!((&cell["status"], &cell["open"]), (&json("\"agrees\""), &json("0")), "{cell}");
        assert_eq!(cell["compared"], 256, "{column}: {cell}");
    }
    for (column, cell) in row(&matrix, "texel") {
        assert_eq!(cell["status"], "agrees", "{column}: {cell}");
    }
}

/// The engine runs the author's WGSL, because the WGSL that naga writes has no `@align`.
// Lesson 158
#[cfg(target_os = "linux")]
#[test]
fn the_engine_runs_what_the_author_wrote() {
    let text = "struct I { a: f32, b: f32 }\n\
                struct P { x: f32, @align(16) i: I }\n\
                @group(0) @binding(0) var<uniform> p: P;\n\
                fn f(x: f32) -> f32 { return p.i.b * x; }\n";
    let (matrix, _) = matrix_of(text, "vulkan,cpu");
    let cells = row(&matrix, "f");
    assert_eq!(cells["cpu"]["status"], "agrees", "{}", cells["cpu"]);
    let options = cells["cpu"]["options"].as_str().expect("options");
    assert!(options.contains("the author's text"), "{options}");
    let judges = cells["cpu"]["validators"].as_array().expect("validators");
    assert!(
        judges.iter().all(|said| said["verdict"] == "valid") && judges.len() == 1,
        "{judges:?}"
    );
}

/// For the length of an HLSL buffer, glslang returns the number of words, and Direct3D the number of bytes.
// Lesson 159
#[cfg(target_os = "linux")]
#[test]
fn array_length_is_equal_on_each_route() {
    let text = "@group(0) @binding(0) var<storage> a: array<f32>;\n\
                @group(0) @binding(1) var<storage> b: array<vec4f>;\n\
                struct S { n: u32, e: array<vec2u> }\n\
                @group(0) @binding(2) var<storage, read_write> s: S;\n\
                fn f(x: u32) -> u32 { return arrayLength(&a) + x; }\n\
                fn g(x: u32) -> u32 { return arrayLength(&b) + x; }\n\
                @compute @workgroup_size(1) fn m() { s.n = arrayLength(&s.e); }\n";
    let (matrix, ran) = matrix_of(text, "vulkan,vulkan:hlsl,cpu");
    assert_eq!(ran.code, Some(0), "{ran:?}");
    for name in ["f", "g", "m"] {
        for (column, cell) in row(&matrix, name) {
            assert_eq!(cell["status"], "agrees", "{name} on {column}: {cell}");
        }
    }
}

/// A shader with four entry points: one takes minutes on a software driver, and three are fast.
#[cfg(target_os = "linux")]
fn slow_and_three() -> String {
    let terms: String = (0..300)
        .map(|i| format!("x = pow(abs(sin(x * 1.{i}) + cos(x + {i}.0)), 1.{i});\n"))
        .collect();
    let mut text = format!(
        "@group(0) @binding(0) var<storage, read_write> o: array<f32>;\n\
         @compute @workgroup_size(256) fn slow(@builtin(global_invocation_id) id: vec3u) {{\n\
         var x = f32(id.x);\n\
         for (var i = 0u; i < 63u; i++) {{ for (var j = 0u; j < 63u; j++) {{\n{terms}}} }}\n\
         o[id.x] = x;\n}}\n"
    );
    for (name, number) in [("one", 1), ("two", 2), ("three", 3)] {
        text += &format!(
            "@compute @workgroup_size(64) fn {name}(@builtin(global_invocation_id) id: vec3u) \
             {{ o[id.x] = f32(id.x) + {number}.0; }}\n"
        );
    }
    text
}

#[cfg(target_os = "linux")]
fn expect_three(matrix: &serde_json::Value) {
    let names = matrix[0]["rows"].as_array().expect("rows").iter().map(|row| &row["name"]);
    assert!(names.eq(["slow", "one", "two", "three"]), "in the author's order");
    for name in ["one", "two", "three"] {
        for (column, cell) in row(matrix, name) {
            assert_eq!(cell["status"], "agrees", "{name} on {column}: {cell}");
        }
    }
}

/// If a driver crashes, its process ends, and Karat reports the crash in the row that ran.
// Lesson 162
#[cfg(target_os = "linux")]
#[test]
fn a_crash_ends_one_row_of_the_matrix() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "shader.wgsl", &slow_and_three());
    let temporary = folder.path().join("tmp");
    std::fs::create_dir(&temporary).expect("a folder");
    let columns = ["--columns", "vulkan,vulkan:wgsl", "--json"];
    let arguments = [&["matrix", "--shaders", "shader.wgsl"], &columns[..]].concat();
    let mut command = command(folder.path(), &arguments);
    command.env("TMPDIR", &temporary).stdout(Stdio::piped()).stderr(Stdio::piped());
    let supervisor = command.spawn().expect("it runs");
    let journal = || {
        let below = std::fs::read_dir(&temporary).ok()?;
        let files = below.filter_map(|entry| Some(entry.ok()?.path().join("journal.jsonl")));
        files.filter_map(|file| std::fs::read_to_string(file).ok()).next()
    };
    let runs = "{\"began\":{\"package\":\"shader\",\"row\":\"slow\",\"path\":\"vulkan\"}}";
    for time in 1..=2 {
        for _ in 0..600 {
            if journal().is_some_and(|text| text.matches(runs).count() == time) {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(100));
        }
        let id = supervisor.id();
        let child = std::fs::read_to_string(format!("/proc/{id}/task/{id}/children"));
        let child = child.expect("its children");
        // Rust's handler catches the first SIGSEGV that is sent from outside, so the test sends SIGFPE.
        let killed = Command::new("sh").args(["-c", &format!("kill -FPE {child}")]).status();
        assert!(killed.expect("it runs").success(), "{:?}", journal());
    }
    let output = supervisor.wait_with_output().expect("it ends");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let matrix = json(&String::from_utf8_lossy(&output.stdout));
    expect_three(&matrix);
    let crashed = &row(&matrix, "slow")["vulkan"]["stopped"];
    assert_eq!(crashed["why"], "broke", "{crashed}");
    let why = "the process ended while `slow` ran on `vulkan`: signal: 8";
    assert!(crashed["says"].as_str().is_some_and(|says| says.starts_with(why)), "{crashed}");
}

// Lesson 161
#[cfg(target_os = "linux")]
#[test]
fn a_deadline_ends_one_row_of_the_matrix() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "shader.wgsl", &slow_and_three());
    let columns = ["--columns", "vulkan,vulkan:wgsl", "--json"];
    let arguments = [&["matrix", "--shaders", "shader.wgsl"], &columns[..]].concat();
    let mut command = command(folder.path(), &arguments);
    let output = command.env("KARAT_TIMEOUT", "1").output().expect("it runs");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let matrix = json(&String::from_utf8_lossy(&output.stdout));
    expect_three(&matrix);
    let slow = row(&matrix, "slow");
    let hangs = &slow["vulkan"]["stopped"];
    assert_eq!(hangs["why"], "broke", "{hangs}");
    assert!(hangs["says"].as_str().is_some_and(|says| says.contains("`slow`")), "{hangs}");
    assert_eq!(slow["vulkan:wgsl"]["stopped"]["why"], "not_run");
}

#[cfg(target_os = "linux")]
#[test]
fn required_columns_decide_the_exit_code() {
    let folder = shaders();
    let matrix = |arguments: &[&str]| {
        let common = ["matrix", "--cases", "16", "--columns", "vulkan,vulkan:hlsl,msl"];
        karat(folder.path(), &[&common[..], arguments].concat())
    };
    let only = ["--only", "blend", "--only", "count"];
    matrix(&[&only[..], &["--require", "vulkan:hlsl=agrees,msl=translated"]].concat()).good();
    matrix(&["--require", "vulkan:hlsl=executed"]).good();
    let fill = "@group(0) @binding(0) var image: texture_storage_2d<r32float, write>;\n\
                @compute @workgroup_size(1) fn fill() { textureStore(image, vec2u(), vec4f(1.0)); }\n";
    write(&folder.path().join("shaders"), "image.wgsl", fill);
    let ran = matrix(&["--require", "vulkan:hlsl=executed"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.err.contains("1 of 5 rows don't reach `executed` on `vulkan:hlsl`"), "{ran:?}");
    assert!(ran.err.contains("image::fill: path `vulkan:hlsl` can't run this"), "{ran:?}");
    let ran = matrix(&[&only[..], &["--require", "msl=valid"]].concat());
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.err.contains("no validator of msl is installed"), "{ran:?}");
    for (wrong, message) in [
        (
            &["--require", "vulkan=good"][..],
            "`good` isn't a status; the statuses are translated, valid",
        ),
        (&["--require", "vulkan"], "write COLUMN=STATUS"),
        (&["--require", "vulkn=valid"], "did you mean `vulkan`?"),
        (&["--within=-1"], "write a finite number of at least 0"),
        (&["--only", "nothing"], "whose name contains `nothing`"),
    ] {
        let ran = matrix(wrong);
        assert_eq!(ran.code, Some(2), "{ran:?}");
        assert!(ran.err.contains(message), "{ran:?}");
    }
    let many = karat(folder.path(), &["matrix", "--cases", "99999999999"]);
    assert!(many.error().contains("at most 4194304 cases"));
    let none = karat(folder.path(), &["matrix", "--cases", "0"]);
    assert!(none.error().contains("at least one column and one case"));
    let twice = karat(folder.path(), &["matrix", "--columns", "vulkan,vulkan"]);
    assert!(twice.error().contains("`vulkan` is named twice"));
}

/// A matrix that judges no row fails. Karat refuses an output that would overwrite an input.
// Lesson 89
#[cfg(target_os = "linux")]
#[test]
fn a_matrix_without_evidence_fails() {
    let folder = shaders();
    let matrix =
        |more: &[&str]| karat(folder.path(), &[&["matrix", "--cases", "16"], more].concat());
    let pointers = "fn raise(x: f32) { var y = x; y += 1.0; }\n";
    write(folder.path(), "pointers.wgsl", pointers);
    let none = matrix(&["--shaders", "pointers.wgsl"]).error();
    assert!(none.contains("no row to judge"), "{none}");
    let mut bare = command(folder.path(), &["matrix", "--columns", "hlsl,msl", "--only", "maths"]);
    let bare = output(bare.env("PATH", folder.path()).env_remove("VULKAN_SDK")).error();
    assert!(bare.contains("none of the 2 rows was judged"), "{bare}");
    let absent = matrix(&["--columns", "vulkan,vulkan:wgsl,metal", "--only", "maths"]);
    let absent = absent.error();
    assert!(absent.contains("path `metal` doesn't open, so no row ran on this path"), "{absent}");
    assert!(
        absent.contains("To translate and validate without running, name the column `msl`"),
        "{absent}"
    );
    for same in ["out", "./out", "new/../out"] {
        let twice = matrix(&["--html", "out", "--junit", same]).error();
        assert!(twice.contains("two outputs have the same file"), "{twice}");
    }
    let folder_and_file = matrix(&["--html", "bugs", "--reproduce", "bugs"]).error();
    assert!(folder_and_file.contains("two outputs have the same file"), "{folder_and_file}");
    // All files of the package stay, and Karat adds none.
    write(&folder.path().join("shaders"), "types.wgsl", "const K: f32 = 2.0;\n");
    write(&folder.path().join("shaders"), "karat.toml", "");
    for taken in ["shaders/types.wgsl", "shaders/karat.toml", "shaders/new.wgsl"] {
        let html = matrix(&["--html", taken]).error();
        assert!(html.contains("a file of the package `shaders`, or become a file"), "{html}");
        let out = ["translate", "maths::blend", "--to", "hlsl", "--out", taken];
        assert!(karat(folder.path(), &out).error().contains("or become a file"), "{taken}");
    }
    let types = std::fs::read_to_string(folder.path().join("shaders/types.wgsl"));
    assert_eq!(types.expect("it is there"), "const K: f32 = 2.0;\n");
    write(folder.path(), "out", "");
    assert!(
        matrix(&["--html", "out", "--junit", "./out"])
            .error()
            .contains("two outputs have the same file")
    );
    std::os::unix::fs::symlink("shaders", folder.path().join("link")).expect("a link");
    for place in ["shaders/bugs", "link/bugs", "none/../shaders"] {
        let inside = matrix(&["--reproduce", place]).error();
        assert!(inside.contains("would belong to the package `shaders`"), "{inside}");
    }
    write(&folder.path().join("bugs"), "older.txt", "");
    assert!(matrix(&["--reproduce", "bugs"]).error().contains("`bugs` isn't an empty folder"));
    // On each column, the pass leaves its buffer unchanged.
    let idle = "@group(0) @binding(0) var<storage, read_write> out: array<f32>;\n\
                @compute @workgroup_size(1) fn idle() { if out[0] > 1e30 { out[0] = 1.0; } }\n";
    write(folder.path(), "idle.wgsl", idle);
    let columns = ["--columns", "vulkan,vulkan:wgsl", "--json", "--shaders", "idle.wgsl"];
    let cell = &row(&json(&matrix(&columns).good()), "idle")["vulkan:wgsl"];
    assert_eq!((&cell["status"], &cell["compared"]), (&json("\"executed\""), &json("0")));
    let required = ["--require", "vulkan:wgsl=agrees"];
    assert_eq!(matrix(&[&columns[..], &required].concat()).code, Some(1));
}

/// With `--tests`, a cell of the matrix is wrong if the function's tests failed on the cell's path. Karat ignores tests
/// of another version of the module.
// Lesson 113
#[cfg(target_os = "linux")]
#[test]
fn tests_judge_the_functions_that_they_have() {
    let folder = shaders();
    let module = folder.path().join("shaders/maths.wgsl");
    let record = |test: &str, path: &str, failures: u64, hash: &str| {
        let verdict = if failures > 0 { "fail" } else { "pass" };
        let record = serde_json::json!({
            "schema": karat::unstable::record::SCHEMA, "test": test, "verdict": verdict, "message": null,
            "subject": {
                "kind": "function", "package": "shaders", "function": "maths::blend",
                "check": "agrees_with", "assertion": "4 ulp", "location": "", "seed": 1,
            },
            "paths": [{
                "adapter": { "path": path, "name": "a", "driver": "d", "software": true },
                "cases": 10, "failures": failures, "worst": "1 ulp", "ratio": 0.25,
                "asserted": "4 ulp", "known_issue": null,
            }],
            "read": [{ "file": module, "hash": hash }],
        });
        format!("{record}\n")
    };
    let matrix = |lines: &[String]| {
        write(&folder.path().join("target/karat/record"), "1.jsonl", &lines.concat());
        let arguments = ["--only", "blend", "--columns", "vulkan,vulkan:wgsl", "--json", "--tests"];
        karat(folder.path(), &[&["matrix"], &arguments[..]].concat())
    };
    let hash = karat::unstable::record::FileRead::now(&module).hash;
    let one = |path: &str, failures: u64| record("blends", path, failures, &hash);
    let good = json(&matrix(&[one("vulkan", 0), one("vulkan:wgsl", 0)]).good());
    let reference = &row(&good, "maths::blend")["vulkan:wgsl"]["reference"];
    assert_eq!(*reference, serde_json::json!({ "checks": 1, "failed": [], "worst": 0.25 }));
    let bad = matrix(&[one("vulkan", 0), one("vulkan:wgsl", 3)]);
    assert_eq!(bad.code, Some(1), "{bad:?}");
    let cell = &row(&json(&bad.out), "maths::blend")["vulkan:wgsl"];
    assert_eq!(cell["status"], "executed");
    assert_eq!(cell["stopped"]["says"], "the function's tests fail on this path: `blends`");
    let other = "0".repeat(64);
    let stale = matrix(&[record("blends", "vulkan:wgsl", 3, &other)]);
    assert_eq!(stale.code, Some(2), "{stale:?}");
    assert!(stale.err.contains("no test of the last run checked these functions"), "{stale:?}");
}

/// Tests with planted faults: a fake compiler changes naga's translation before compiling, or changes its own output.
/// Karat reports each fault with the right status, and only in the column that uses this compiler.
#[cfg(target_os = "linux")]
mod planted {
    use std::os::unix::fs::PermissionsExt;

    use base64::Engine;

    use super::*;

    /// The path of a program on this machine. `cargo ci setup` installs these programs.
    fn program(name: &str) -> std::path::PathBuf {
        let path = std::env::var_os("PATH").unwrap_or_default();
        let found = std::env::split_paths(&path).map(|folder| folder.join(name));
        found.into_iter().find(|file| file.is_file()).unwrap_or_else(|| {
            panic!("`{name}` isn't here: `cargo ci setup` installs the validators")
        })
    }

    /// Runs `karat matrix` with a script in place of glslang: the script runs the shell commands `before`, then
    /// glslang, then the shell commands `after`. Checks that the matrix has one wrong cell, and returns the matrix as
    /// JSON.
    fn with_glslang(before: &str, after: &str) -> serde_json::Value {
        let ran = run_with_glslang(&shaders(), before, after, &["--json"]);
        assert_eq!(ran.code, Some(1), "{ran:?}");
        assert!(
            ran.err.contains("the matrix has one wrong cell, which `karat.toml` doesn't declare"),
            "{ran:?}"
        );
        json(&ran.out)
    }

    /// Debian has no package of Microsoft's compiler. So a script replaces this compiler: it reads the compiler's
    /// arguments and runs glslang. This tests the arguments, not the compiler.
    #[test]
    fn dxc_gets_the_arguments_that_dxc_needs() {
        let folder = shaders();
        let bin = folder.path().join("bin");
        let script = format!(
            "#!/bin/sh\n[ \"$1\" = --version ] && echo 'dxcompiler.so: 1.8' && exit\n\
             case \"$*\" in *'-spirv -fspv-target-env=vulkan1.1 -fvk-use-dx-layout -Vd'*) \
             echo \"$*\" >> {asked} ;; esac\n\
             for last; do :; done\n\
             while [ $# -gt 0 ]; do\n\
             case \"$1\" in -E) entry=$2 ;; -Fo) out=$2 ;; -T) profile=$2 ;; esac; shift\ndone\n\
             [ \"$profile\" = cs_6_2 ] || [ \"$profile\" = cs_6_0 ] || exit 9\n\
             exec {glslang} -D --hlsl-offsets -V --target-env vulkan1.1 -S comp -e $entry -o $out $last\n",
            asked = folder.path().join("asked").display(),
            glslang = program("glslangValidator").display(),
        );
        write(&bin, "dxc", &script);
        let all = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(bin.join("dxc"), all).expect("it is ours");
        let path = std::env::var_os("PATH").unwrap_or_default();
        let path = std::env::split_paths(&path).collect::<Vec<_>>();
        let path = std::env::join_paths([vec![bin], path].concat()).expect("folders");
        let columns = ["--columns", "vulkan,vulkan:hlsl-dxc,hlsl6", "--only", "blend", "--json"];
        let arguments = [&["matrix"], &columns[..]].concat();
        let ran = output(command(folder.path(), &arguments).env("PATH", &path));
        let cells = row(&json(&ran.good()), "maths::blend");
        assert_eq!(cells["vulkan:hlsl-dxc"]["status"], "agrees");
        assert_eq!(cells["hlsl6"]["status"], "valid");
        let asked = std::fs::read_to_string(folder.path().join("asked")).expect("it was asked");
        assert!(asked.contains("-T cs_6_2 -E karat_probe -Fo out.spv shader.hlsl"), "{asked}");
        let without = karat(folder.path(), &arguments);
        let cell = &row(&json(&without.out), "maths::blend")["vulkan:hlsl-dxc"];
        if cell["status"] != "agrees" {
            let says = cell["stopped"]["says"].as_str().expect("a reason");
            assert!(says.contains("validator of hlsl6") && says.contains("dxc"), "{says}");
            assert_eq!(without.code, Some(2), "a path that is asked for by name must be here");
            assert!(without.err.contains("`vulkan:hlsl-dxc` doesn't open"), "{without:?}");
        }
    }

    fn run_with_glslang(folder: &TempDir, before: &str, after: &str, more: &[&str]) -> Ran {
        let bin = folder.path().join("bin");
        let real = program("glslangValidator");
        let script = format!(
            "#!/bin/sh\ncase \"$*\" in *--version*) exec {real} --version;; esac\n\
             {before}\n{real} \"$@\" || exit $?\n{after}\n",
            real = real.display()
        );
        write(&bin, "glslangValidator", &script);
        let all = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(bin.join("glslangValidator"), all).expect("it is ours");
        let path = std::env::var_os("PATH").unwrap_or_default();
        let path = std::env::split_paths(&path).collect::<Vec<_>>();
        let path = std::env::join_paths([vec![bin], path].concat()).expect("folders");
        let columns = "vulkan,vulkan:wgsl,vulkan:glsl,vulkan:hlsl";
        let common = ["matrix", "--only", "maths::blend", "--columns", columns];
        output(command(folder.path(), &[&common, more].concat()).env("PATH", path))
    }

    /// A glslang that replaces a subtraction in naga's HLSL by an addition.
    const ANOTHER_OPERATOR: &str =
        "[ -f shader.hlsl ] && sed -i 's/ - y/ + y/; s/_ - /_ + /' shader.hlsl";

    // Lesson 84
    #[test]
    fn a_difference_is_explained_in_each_output() {
        let folder = shaders();
        let text = "fn blend(x: f32, y: f32) -> f32 {\n    let thrice = x * 3.0;\n    \
                    let less = thrice - y;\n    return less * 2.0;\n}\n";
        write(&folder.path().join("shaders"), "maths.wgsl", text);
        let outputs = ["--html", "m.html", "--junit", "m.xml", "--reproduce", "bugs"];
        let ran = run_with_glslang(&folder, ANOTHER_OPERATOR, "", &outputs);
        assert_eq!(ran.code, Some(1), "{ran:?}");
        let explained = "at x = 0; y = 1 `vulkan:hlsl` returns 2, and `vulkan` returns -2; the first variable that differs is `less` \
                         (shaders/maths.wgsl:3:9): 1 on `vulkan:hlsl`, and -1 on `vulkan`";
        assert!(ran.out.contains(explained), "{ran:?}");
        let read = |name: &str| {
            let file = folder.path().join(name);
            std::fs::read_to_string(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display()))
        };
        let page = matrix_of_page(&read("m.html"));
        let cell = &page["rows"][0]["cells"][3];
        assert_eq!(cell["divergence"]["first"]["line"], 3, "{cell}");
        let text = &page["texts"][cell["text"].as_u64().expect("an index") as usize];
        let line = cell["divergence"]["first"]["text_line"].as_u64().expect("a line") as usize;
        let line = text.as_str().and_then(|text| text.lines().nth(line - 1)).expect("it is there");
        assert!(line.trim_start().starts_with("float less = "), "{line}");
        assert_eq!(page["rows"][0]["source"]["line"], 1);

        let xml = read("m.xml");
        let report = roxmltree::Document::parse(&xml).expect("XML");
        let cases = report.descendants().filter(|node| node.has_tag_name("testcase"));
        let failed: Vec<&str> = cases
            .filter(|case| case.children().any(|node| node.has_tag_name("failure")))
            .filter_map(|case| case.attribute("classname"))
            .collect();
        assert_eq!(failed, ["shaders.vulkan:hlsl"]);

        let bug = "bugs/shaders/maths.blend@vulkan-hlsl";
        let readme = read(&format!("{bug}/README.md"));
        for part in [
            explained,
            "| `y` | 1 |",
            "| `vulkan:hlsl` | 2 | 0x40000000 |",
            "The first value that differs is `less` at shaders/maths.wgsl:3:9",
            "let thrice = x * 3.0;",
            "glslangValidator -D",
            "naga 30.0.1",
        ] {
            assert!(readme.contains(part), "no `{part}` in {readme}");
        }
        assert!(read(&format!("{bug}/shader.wgsl")).contains("karat_probe"));
        assert!(read(&format!("{bug}/vulkan-hlsl/shader.hlsl")).contains("numthreads"));
        let words =
            std::fs::read(folder.path().join(bug).join("vulkan/shader.spv")).expect("SPIR-V");
        assert_eq!(words[..4], 0x0723_0203_u32.to_le_bytes());
        let values = json(&read(&format!("{bug}/values.json")));
        assert_eq!(values["case"]["arguments"][1], "0x3f800000");
    }

    /// Karat reports the first `let` that differs, for any initialiser.
    // Lesson 84
    #[test]
    fn the_first_let_that_differs_is_named() {
        let folder = shaders();
        let text = "fn blend(x: f32, y: f32) -> f32 {\n    var z = x * 3.0;\n    let p = &z;\n    \
                    let q = cos(y); // of y; q\n    \
                    if x > -1e9 {\n        let q = max(*p - y, -1e9);\n        let r = q * 2.0;\n        \
                    return r;\n    }\n    return q;\n}\n";
        write(&folder.path().join("shaders"), "maths.wgsl", text);
        let ran = run_with_glslang(&folder, ANOTHER_OPERATOR, "", &["--json"]);
        let found = &row(&json(&ran.out), "maths::blend")["vulkan:hlsl"]["divergence"];
        assert_eq!(found["first"]["name"], "q", "{found}");
        assert_eq!(found["first"]["location"], "shaders/maths.wgsl:6:13", "{found}");
        assert_eq!(found["unseen"], serde_json::json!(["p"]), "pointers can't be looked at");
        assert!(found["first"]["text_line"].is_u64(), "{found}");
        let says = &row(&json(&ran.out), "maths::blend")["vulkan:hlsl"]["stopped"]["says"];
        assert!(says.as_str().is_some_and(|says| says.contains("(not compared: `p`)")), "{says}");
    }

    /// If values in a loop differ, the explanation has the values of the last iteration, and says so.
    #[test]
    fn explanations_name_last_rounds_of_loops_and_entry_points() {
        let folder = shaders();
        let text = "fn blend(x: f32, y: f32) -> f32 {\n    var s = x;\n    \
                    for (var i = 0; i < 3; i++) { let good = s * 0.5; let bad = good - y; s = bad; }\n    \
                    return s;\n}\n@group(0) @binding(0) var<storage, read_write> out: array<f32>;\n\
                    @compute @workgroup_size(64) fn step_back(@builtin(global_invocation_id) i: vec3u) {\n    \
                    out[i.x] = out[i.x] - 0.5;\n}\n";
        write(&folder.path().join("shaders"), "maths.wgsl", text);
        let change = "[ -f shader.hlsl ] && sed -i 's/ - /  +  /g' shader.hlsl";
        let outputs = ["--only", "maths::step_back", "--reproduce", "bugs", "--markdown", "m.md"];
        let ran = run_with_glslang(&folder, change, "", &outputs);
        assert!(ran.out.contains(" in the last iteration of its loop: "), "{ran:?}");
        let read = |name: &str| std::fs::read_to_string(folder.path().join(name)).expect(name);
        let bug = "bugs/shaders/maths.step_back@vulkan-hlsl";
        let readme = read(&format!("{bug}/README.md"));
        assert!(readme.contains("--columns vulkan,vulkan:hlsl`"), "{readme}");
        assert!(folder.path().join(bug).join("vulkan/shader.spv").is_file());
        let page = read("m.md");
        let (_, why) = page.split_once("## Why rows stop").expect("a section");
        assert!(why.contains(": vulkan:hlsl: "), "what is wrong is never left out: {why}");
    }

    /// naga's HLSL initialises workgroup memory with a zero value of an array, which glslang 11.12 doesn't support.
    /// This isn't a fault.
    // Lesson 160
    #[test]
    fn an_array_of_workgroups_is_no_fault_of_hlsl() {
        let folder = shaders();
        let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;\n\
                    var<workgroup> tile: array<u32, 64>;\n\
                    @compute @workgroup_size(64) fn turn(@builtin(local_invocation_index) i: u32) {\n    \
                    tile[i] = data[i];\n    workgroupBarrier();\n    data[i] = tile[63u - i];\n}\n";
        write(&folder.path().join("shaders"), "maths.wgsl", text);
        let columns = ["matrix", "--only", "turn", "--columns", "vulkan,vulkan:hlsl,cpu"];
        let ran = karat(folder.path(), &columns).good();
        let known = ran.contains("vulkan:hlsl  1 translated, 1 valid");
        assert!(
            known || ran.contains("glslang doesn't support the zero value of an array"),
            "{ran}"
        );
        let required = [&columns[..], &["--require", "vulkan:hlsl=valid"]].concat();
        let ran = karat(folder.path(), &required);
        assert!(known || ran.code == Some(1), "it isn't judged, and that is no green: {ran:?}");
    }

    /// If karat.toml declares that a row's results differ, Karat still reports a failure in an earlier step, such as
    /// invalid HLSL.
    // Lesson 85
    #[test]
    fn a_declared_difference_hides_no_earlier_failure() {
        let folder = shaders();
        let declared = "[[matrix]]\nrows = [\"maths::blend\"]\ncolumns = [\"vulkan:hlsl\"]\n\
                        status = \"agrees\"\nreason = \"rounding\"\n";
        write(&folder.path().join("shaders"), "karat.toml", declared);
        let breaks = "[ -f shader.hlsl ] && echo 'nonsense;' >> shader.hlsl";
        let ran = run_with_glslang(&folder, breaks, "", &["--junit", "m.xml"]);
        assert_eq!(ran.code, Some(1), "{ran:?}");
        assert!(ran.out.contains("INVALID") && !ran.out.contains("known"), "{ran:?}");
        let xml = std::fs::read_to_string(folder.path().join("m.xml")).expect("it is written");
        assert!(
            xml.contains("the row fails at an earlier step than `agrees`, the step in its"),
            "{xml}"
        );
        let file = ["--shaders", "shaders/maths.wgsl", "--only", "blend"];
        let columns = ["--columns", "vulkan,vulkan:wgsl"];
        let ran = karat(folder.path(), &[&["matrix"], &file[..], &columns[..]].concat()).good();
        assert!(ran.contains("not checked: declared failures on"), "{ran}");
    }

    /// It is an error if a declared difference doesn't occur, or names a row that doesn't exist.
    // Lesson 85
    #[test]
    fn a_declared_difference_must_occur() {
        let folder = shaders();
        let declare = |rows: &str, columns: &str, status: &str, reason: &str| {
            let text = format!(
                "[[matrix]]\nrows = [\"{rows}\"]\ncolumns = [\"{columns}\"]\nstatus = \
                 \"{status}\"\nreason = \"{reason}\"\n"
            );
            write(&folder.path().join("shaders"), "karat.toml", &text);
        };
        let adapter =
            karat::unstable::path::adapter(karat::Path::VULKAN).expect("it opens").family();
        for column in ["vulkan:hlsl", ":hlsl", &format!("vulkan:hlsl@{adapter}")] {
            declare("maths::blend", column, "agrees", "the compiler is wrong");
            let ran = run_with_glslang(&folder, ANOTHER_OPERATOR, "", &[]);
            assert!(ran.good().contains("known: the compiler is wrong"), "{column}");
        }
        let required = ["--require", "vulkan:hlsl=agrees"];
        run_with_glslang(&folder, ANOTHER_OPERATOR, "", &required).good();
        let healthy = run_with_glslang(&folder, "", "", &["--html", "m.html"]);
        assert_eq!(healthy.code, Some(1), "{healthy:?}");
        let outdated = "delete one declaration from `karat.toml`, because these failures are gone: \
                        maths::blend on vulkan:hlsl: the row reaches `agrees`";
        assert!(healthy.err.contains(outdated), "{healthy:?}");
        // A row is declared to be rejected. If a compiler accepts it and the result differs, Karat doesn't report the
        // declaration as fixed.
        declare("maths::blend", "vulkan:hlsl", "valid", "the compiler is wrong");
        let ran = run_with_glslang(&folder, ANOTHER_OPERATOR, "", &[]);
        assert!(ran.err.contains("the matrix has one wrong cell"), "{ran:?}");
        assert!(!ran.err.contains("delete"), "{ran:?}");
        // A crash of a validator isn't a rejection.
        let ran = run_with_glslang(&folder, "[ -f shader.hlsl ] && kill -SEGV $$", "", &[]);
        assert_eq!(ran.code, Some(1), "{ran:?}");
        assert!(ran.out.contains("NO VERDICT"), "{ran:?}");
        for (rows, column, status, reason, message) in [
            (
                "maths::blnd",
                "vulkan",
                "agrees",
                "x",
                "the package has no row with this name; did you mean `maths::blend`?",
            ),
            ("maths::blend", "vulkn", "agrees", "x", "there is no execution path `vulkn`"),
            (
                "maths::blend",
                "vulkan",
                "agree",
                "x",
                "`agree` isn't a status; the statuses are translated",
            ),
            ("maths::blend", "vulkan", "agrees", " ", "the declaration needs a `reason`"),
        ] {
            declare(rows, column, status, reason);
            let ran = run_with_glslang(&folder, "", "", &[]);
            assert_eq!(ran.code, Some(2), "{ran:?}");
            assert!(ran.err.contains(message), "{ran:?}");
        }
        let empty =
            "[[matrix]]\nrows = []\ncolumns = [\"gl\"]\nstatus = \"valid\"\nreason = \"x\"\n";
        write(&folder.path().join("shaders"), "karat.toml", empty);
        assert!(run_with_glslang(&folder, "", "", &[]).error().contains("names no rows"));
        // The declared route isn't the direct route.
        declare("maths::blend", "vulkan", "agrees", "not so");
        let ran = run_with_glslang(&folder, "", "", &[]);
        assert!(
            ran.err.contains("maths::blend on vulkan") && !ran.err.contains(":wgsl"),
            "{ran:?}"
        );
    }

    fn matrix_of_page(page: &str) -> serde_json::Value {
        use std::io::Read;
        let (_, data) = page.split_once("data-encoding=\"deflate\">").expect("its data");
        let (data, _) = data.split_once("</script>").expect("the element's end");
        let bytes = base64::engine::general_purpose::STANDARD.decode(data).expect("base64");
        let mut text = String::new();
        flate2::read::ZlibDecoder::new(&bytes[..]).read_to_string(&mut text).expect("zlib");
        json(&text)["matrices"][0].clone()
    }

    fn states(matrix: &serde_json::Value) -> Vec<(String, String, String)> {
        let text = |value: &serde_json::Value| value.as_str().unwrap_or_default().to_owned();
        row(matrix, "maths::blend")
            .into_iter()
            .map(|(column, cell)| (column, text(&cell["status"]), text(&cell["stopped"]["why"])))
            .collect()
    }

    fn expected(wrong: &str, status: &str, why: &str) -> Vec<(String, String, String)> {
        ["vulkan", "vulkan:glsl", "vulkan:hlsl", "vulkan:wgsl"]
            .map(|column| match column == wrong {
                true => (column.to_owned(), status.to_owned(), why.to_owned()),
                false => (column.to_owned(), "agrees".to_owned(), String::new()),
            })
            .to_vec()
    }

    // Lesson 82
    #[test]
    fn a_changed_operator_in_hlsl_is_found() {
        let change = "[ -f shader.hlsl ] && sed -i 's/3[.]0) - /3.0) + /' shader.hlsl";
        let matrix = with_glslang(change, "");
        assert_eq!(states(&matrix), expected("vulkan:hlsl", "executed", "differs"));
        let cell = &row(&matrix, "maths::blend")["vulkan:hlsl"];
        let says = cell["stopped"]["says"].as_str().expect("a text").to_owned();
        // The message has the simplest input that shows the difference.
        assert!(
            says.contains("at x = 0; y = 1 `vulkan:hlsl` returns 1, and `vulkan` returns -1"),
            "{says}"
        );
    }

    // Lesson 82
    #[test]
    fn operands_of_spirv_that_are_swapped_are_seen() {
        let (dis, r#as) = (program("spirv-dis"), program("spirv-as"));
        let swap = format!(
            "if [ -f out.spv ] && [ -f shader.glsl ]; then\n{} --raw-id out.spv | sed -E \
             's/(OpFSub %[^ ]+) (%[^ ]+) (%[^ ]+)/\\1 \\3 \\2/' > out.txt\n\
             {} --target-env vulkan1.1 --preserve-numeric-ids out.txt -o out.spv\nfi",
            dis.display(),
            r#as.display()
        );
        let matrix = with_glslang("", &swap);
        assert_eq!(states(&matrix), expected("vulkan:glsl", "executed", "differs"));
    }

    // Lesson 82
    // Lesson 117
    #[test]
    fn glsl_that_no_longer_compiles_is_seen() {
        let matrix = with_glslang("[ -f shader.glsl ] && echo 'nonsense;' >> shader.glsl", "");
        assert_eq!(states(&matrix), expected("vulkan:glsl", "translated", "rejected"));
        let crashes = "[ -f shader.hlsl ] && kill -SEGV $$";
        let matrix = with_glslang(crashes, "");
        assert_eq!(states(&matrix), expected("vulkan:hlsl", "translated", "broke"));
        let says = &row(&matrix, "maths::blend")["vulkan:hlsl"]["stopped"]["says"];
        assert!(says.as_str().is_some_and(|says| says.contains("crashes (signal: 11")), "{says}");
        let nothing = "[ -f shader.hlsl ] && exit 0";
        let matrix = with_glslang(nothing, "");
        let says = &row(&matrix, "maths::blend")["vulkan:hlsl"]["stopped"]["says"];
        assert!(says.as_str().is_some_and(|says| says.contains("writes no SPIR-V")), "{says}");
    }
}
