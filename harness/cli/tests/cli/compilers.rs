//! Tests that Karat reports Tint's errors at the author's lines, and reports exceeded limits of WebGPU. If Karat
//! doesn't run Tint, it says why.
//!
//! Tests that need Tint use this machine's Tint, which `cargo ci setup` installs. Other tests replace Tint by a program
//! with planned output.

use super::*;

fn folder(text: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "shaders/m.wgsl", text);
    folder
}

/// Runs `karat` with the Tint of this machine.
fn with_tint(folder: &FilePath, arguments: &[&str]) -> Ran {
    let ran = output(command(folder, arguments).env_remove("KARAT_TINT"));
    let missing = ran.out.contains("wasn't asked") || ran.err.contains("`webgpu` isn't installed");
    assert!(!missing, "this test needs Tint: run `cargo ci setup`\n{ran:?}");
    ran
}

const CHECK: &[&str] = &["check", "--shaders", "shaders"];
const VALID: &str = "fn half(x: f32) -> f32 { return 0.5 * x; }\n";
const REQUIRED: &str = "[compilers]\nrequire = [\"tint\"]\n";

fn last_line(text: &str) -> &str {
    text.lines().last().unwrap_or_default()
}

/// For each kind of error that Tint finds and naga doesn't, Karat reports the line and a remedy.
// Lesson 201
#[test]
fn errors_of_tint_have_a_place_and_a_remedy() {
    let fragment = "@group(0) @binding(0) var t: texture_2d<f32>;\n@group(0) @binding(1) var s: sampler;\n\
                    @fragment fn main(@location(0) u: vec2f) -> @location(0) vec4f {\n    \
                    if u.x > 0.5 { return textureSample(t, s, u); }\n    return vec4f();\n}\n";
    let barrier = "@compute @workgroup_size(64) fn main(@builtin(local_invocation_index) i: u32) {\n    \
                   if i > 3u { workgroupBarrier(); }\n}\n";
    let alias = "fn g(a: ptr<function, f32>, b: ptr<function, f32>) { *a = *b; }\n\
                 fn f() -> f32 { var x = 1.0; g(&x, &x); return x; }\n";
    let vertex = "@group(0) @binding(0) var<storage, read_write> b: array<f32>;\n\
                  @vertex fn main() -> @builtin(position) vec4f { b[0] = 1.0; return vec4f(); }\n";
    for (text, place, message, remedy) in [
        (
            fragment,
            "4:27",
            "'textureSample' must only be called from uniform",
            "textureSampleLevel",
        ),
        (
            barrier,
            "2:17",
            "'workgroupBarrier' must only be called from uniform",
            "before the condition",
        ),
        (
            "const MOST: f32 = 3.40282347e+38;\nfn f() -> f32 { return MOST; }\n",
            "1:19",
            "cannot be represented as 'f32'",
            "0x1.fffffep+127f",
        ),
        (
            "fn f(x: f32) -> f32 { return clamp(x, 1.0, 0.0); }\n",
            "1:30",
            "clamp called with 'low' (1.0) greater than 'high' (0.0)",
            "WGSL has no value for this expression",
        ),
        (
            "fn f(x: u32) -> u32 { return x << x + 1u; }\n",
            "1:32",
            "mixing '<<' and '+' requires parenthesis",
            "add parentheses",
        ),
        (
            "var<workgroup> n: atomic<u32>;\n@compute @workgroup_size(1) fn main() {\n    n = 0u;\n}\n",
            "3:7",
            "cannot assign 'u32' to 'atomic<u32>'",
            "atomicStore",
        ),
        (
            "@compute @workgroup_size(4) fn main() { let x = subgroupAdd(1.0); _ = x; }\n",
            "1:49",
            "'subgroupAdd' without extension 'subgroups'",
            "no shader with subgroups works in both",
        ),
        (alias, "2:36", "invalid aliased pointer argument", "a variable of its own"),
        (
            vertex,
            "2:49",
            "cannot be used by vertex pipeline stage",
            "declare the variable as `read`",
        ),
        (
            "fn f(x: i64) -> i64 { return x; }\n",
            "1:9",
            "unresolved type 'i64'",
            "native = [\"shader_int64\"] in `[compilers]`",
        ),
    ] {
        let folder = folder(text);
        let ran = with_tint(folder.path(), CHECK);
        let out = ran.out.clone();
        assert_eq!(ran.code, Some(0), "{text}: it is a note\n{ran:?}");
        assert!(out.contains("warning: Tint rejects this: "), "{text}\n{out}");
        assert!(out.contains(message), "{text}\n{out}");
        let place = format!("m.wgsl:{place}");
        assert!(out.contains(&place), "{text}: not at {place}\n{out}");
        assert!(out.contains(remedy), "{text}\n{out}");
        assert!(last_line(&out).contains("Tint rejects 1 module"), "{out}");
        // If the command requires Tint, the finding isn't a note.
        let ran = with_tint(folder.path(), &[CHECK, &["--require", "tint"]].concat());
        assert_eq!(ran.code, Some(1), "{text}\n{ran:?}");
        write(folder.path(), "shaders/karat.toml", REQUIRED);
        let ran = with_tint(folder.path(), CHECK);
        assert!(ran.code == Some(1) && ran.out.contains("1 of 1 module"), "{text}\n{ran:?}");
        assert!(
            ran.out.contains("error: Tint rejects this") && ran.out.contains(&place),
            "{ran:?}"
        );
    }
    let folder = folder(VALID);
    write(folder.path(), "shaders/karat.toml", REQUIRED);
    let out = with_tint(folder.path(), CHECK).good();
    assert_eq!(last_line(&out), "1 package valid; Tint accepts 1 module");
}

/// Each command that validates modules asks Tint, and gives Tint's verdict.
// Lesson 201
#[test]
fn each_command_that_validates_asks_tint() {
    let tests = "import package::m::shift;\nimport karat::expect_near;\n@test fn is_zero() { expect_near(f32(shift(0u)), 1.0, 2.0); }\n";
    let folder = folder("fn shift(x: u32) -> u32 { return x << x + 1u; }\n");
    write(folder.path(), "shaders/m_test.wgsl", tests);
    let ran = with_tint(folder.path(), &["test", "shaders", "--paths", "cpu"]);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(ran.out.contains("warning: Tint rejects this: mixing"), "{ran:?}");
    assert!(ran.out.contains("1 check, 0 failed") && ran.out.contains("; Tint rejects 1 module"));
    let out = with_tint(folder.path(), &["test", "shaders", "--paths", "cpu", "--short"]).good();
    assert!(last_line(&out).ends_with("; Tint rejects 1 module"), "{out}");
    let watch = ["watch", "shaders", "--once", "--lines", "--paths", "cpu"];
    let ran = with_tint(folder.path(), &watch);
    assert_eq!(ran.code, Some(0), "{ran:?}");
    assert!(
        ran.out.contains("Tint rejects 1 module") && ran.out.contains("m.wgsl:1:36"),
        "{ran:?}"
    );
    let columns = ["matrix", "--shaders", "shaders", "--columns", "tint,cpu", "--json"];
    let ran = with_tint(folder.path(), &columns);
    let matrix = json(&ran.out);
    let rows = matrix[0]["rows"].as_array().expect("rows");
    let shift = rows.iter().find(|row| row["name"] == "m::shift").expect("the function");
    let tint = &shift["cells"][0];
    assert_eq!(tint["status"], "translated", "{tint}");
    assert!(
        tint["stopped"]["says"].as_str().is_some_and(|says| says.contains("parenthesis")),
        "{tint}"
    );

    write(folder.path(), "shaders/karat.toml", REQUIRED);
    for arguments in [&["test", "shaders", "--paths", "cpu"][..], &watch] {
        let ran = with_tint(folder.path(), arguments);
        assert_eq!(ran.code, Some(1), "{arguments:?}\n{ran:?}");
        assert!(ran.out.contains("m.wgsl:1:36"), "{arguments:?}\n{ran:?}");
    }
}

/// Without Tint, the last line of each command says why Tint wasn't asked. A command that requires Tint fails, and says
/// how to get Tint.
// Lesson 203
// Lesson 207
#[test]
fn a_missing_tint_is_reported_by_each_command() {
    let folder = folder(VALID);
    write(folder.path(), "shaders/m.test.toml", "[[test]]\nfunction = \"half\"\nfinite = true\n");
    let bare = |arguments: &[&str]| {
        let mut command = command(folder.path(), arguments);
        // Many machines have Node. The test hides Node, so it also shows that Karat needs none.
        let nothing = folder.path().join("nothing");
        command.env_remove("KARAT_TINT").env("PATH", &nothing).env("XDG_CACHE_HOME", &nothing);
        output(&mut command)
    };
    let out = bare(CHECK).good();
    // On a machine with an installed browser, the line also names the browser.
    assert!(
        last_line(&out).starts_with(
            "1 package valid; Tint wasn't asked: the npm package `webgpu` isn't installed"
        ),
        "{out}"
    );
    let test = ["test", "shaders", "--paths", "cpu"];
    let out = bare(&test).good();
    assert!(
        out.contains(" compared; Tint wasn't asked: the npm package `webgpu` isn't installed"),
        "{out}"
    );
    let off = karat(folder.path(), CHECK).good();
    assert_eq!(last_line(&off), "1 package valid; Tint wasn't asked: KARAT_TINT=off");
    if cfg!(target_os = "linux") {
        write(folder.path(), "shaders/karat.toml", REQUIRED);
        for arguments in [CHECK, &test] {
            let ran = bare(arguments);
            assert_eq!(ran.code, Some(1), "{arguments:?}\n{ran:?}");
            assert!(
                ran.out.contains(
                    "requires Tint's verdict, but Tint has no verdict: the npm package `webgpu` isn't installed"
                ),
                "{ran:?}"
            );
            assert!(ran.out.contains("npm install --save-dev webgpu"), "{ran:?}");
        }
    }
    let doctor = bare(&["doctor"]);
    assert!(doctor.out.contains("npm install --save-dev webgpu"), "{doctor:?}");
}

#[test]
fn a_karat_tint_without_tint_is_reported_with_the_reason() {
    let folder = folder(VALID);
    write(folder.path(), "shaders/karat.toml", REQUIRED);
    write(folder.path(), "empty/readme", "");
    for (named, part) in [
        ("nowhere", "KARAT_TINT=nowhere doesn't exist"),
        ("empty", "is a folder without the npm package `webgpu`"),
        ("OFF", "KARAT_TINT=off"),
        // A program that prints nothing and exits with 0 has read nothing.
        ("true", "isn't Tint"),
        ("cat", "isn't Tint"),
    ] {
        let ran = output(command(folder.path(), CHECK).env("KARAT_TINT", named));
        assert!(ran.code == Some(1) && ran.out.contains(part), "{named}: {ran:?}");
    }
}

/// A package must declare features that only wgpu has. It is an error to declare a feature that no module needs.
// Lesson 204
#[test]
fn features_of_wgpu_alone_must_be_declared() {
    let folder = folder("fn twice(x: i64) -> i64 { return x + x; }\n");
    let check = |native: &str| {
        let text = format!("[compilers]\nrequire = [\"tint\"]\nnative = [{native}]\n");
        write(folder.path(), "shaders/karat.toml", &text);
        with_tint(folder.path(), CHECK)
    };
    let out = check("\"shader_int64\"").good();
    assert_eq!(last_line(&out), "1 package valid; Tint skipped 1 module");
    assert_eq!(check("").code, Some(1));
    for (native, part) in [
        (
            "\"shader_int64\", \"ray_query\"",
            "`native` lists `ray_query`, but no module uses this feature",
        ),
        ("\"ray_qurey\"", "has no native feature `ray_qurey`; did you mean `ray_query`?"),
        ("\"shader_float16\"", "has no native feature `shader_float16`"),
    ] {
        let ran = check(native);
        assert!(ran.code == Some(2) && ran.err.contains(part), "{native}: {ran:?}");
        assert!(ran.err.contains("karat.toml"), "{native}: {ran:?}");
    }
    for (text, part) in [
        ("[compilers]\nrequire = [\"tnit\"]\n", "did you mean `tint`?"),
        ("[compilers]\nrequires = [\"tint\"]\n", "unknown field `requires`"),
        ("[compilers]\nrequire = \"tint\"\n", "expected a sequence"),
    ] {
        write(folder.path(), "shaders/karat.toml", text);
        let ran = karat(folder.path(), CHECK);
        assert!(ran.code == Some(2) && ran.err.contains(part), "{text}: {ran:?}");
    }
}

/// If a shader exceeds a limit of WebGPU, Karat prints a note. With a `[limits]` table in karat.toml, an exceeded limit
/// is an error.
// Lesson 205
#[test]
fn an_exceeded_limit_is_reported_at_its_place() {
    let workgroup = "var<workgroup> tile: array<vec4f, 2048>;\n\
                     @compute @workgroup_size(16, 32) fn main() { tile[0] = vec4f(); }\n";
    let storage = "@group(0) @binding(0) var<storage, read> a: array<f32>;\n\
                   @vertex fn main() -> @builtin(position) vec4f { return vec4f(a[0]); }\n";
    let textures: String =
        (0..17).map(|n| format!("@group(0) @binding({n}) var t{n}: texture_2d<f32>;\n")).collect();
    let uses: String = (0..17).map(|n| format!("+ textureLoad(t{n}, vec2u(), 0)")).collect();
    let textures = format!(
        "{textures}@fragment fn main() -> @location(0) vec4f {{ return vec4f() {uses}; }}\n"
    );
    let group = "@group(4) @binding(0) var<uniform> u: f32;\n\
                 @vertex fn main() -> @builtin(position) vec4f { return vec4f(u); }\n";
    let uniform = "@group(0) @binding(0) var<uniform> u: array<vec4f, 2048>;\n\
                   @vertex fn main() -> @builtin(position) vec4f { return u[0]; }\n";
    let sized = "override size: u32 = 512;\n@compute @workgroup_size(size) fn main() { }\n";
    let facing = "@fragment fn main(@location(15) a: f32, @builtin(front_facing) b: bool, \
                  @location(0) c: vec4f, @location(1) d: f32) -> @location(0) vec4f \
                  { return select(c, vec4f(a * d), b); }\n";
    let passed = "@fragment fn main(@location(15) a: f32, @location(0) b: f32) -> @location(0) vec4f \
                  { return vec4f(a + b); }\n";
    let written = "@group(0) @binding(0) var<storage, read_write> a: array<f32>;\n\
                   @vertex fn main() -> @builtin(position) vec4f { a[0] = 1.0; return vec4f(); }\n";
    let check = |text: &str, limits: &str| {
        let folder = folder(text);
        write(folder.path(), "shaders/karat.toml", limits);
        karat(folder.path(), CHECK)
    };
    let compatibility = "[limits]\nmode = \"compatibility\"\n";
    for (text, limits, place, part) in [
        (
            sized,
            "",
            "2:32",
            "uses 512 invocations in a workgroup, but WebGPU's default maxComputeInv",
        ),
        (
            workgroup,
            "",
            "2:34",
            "uses 512 invocations in a workgroup, but WebGPU's default maxComputeInv",
        ),
        (
            workgroup,
            "",
            "2:34",
            "uses 32768 bytes of workgroup memory, but WebGPU's default maxComputeW",
        ),
        (
            &textures,
            "",
            "18:11",
            "uses 17 sampled textures, but WebGPU's default maxSampledTextures",
        ),
        (
            group,
            "",
            "1:23",
            "uses group 4, so at least 5 groups, but WebGPU's default maxBindGroups is 4",
        ),
        (written, "", "2:9", "uses `m::a`, which is writable, and WebGPU forbids writable storage"),
        (
            uniform,
            compatibility,
            "1:23",
            "uses 32768 bytes, but compatibility mode's maxUniformBuffer",
        ),
        (
            storage,
            compatibility,
            "2:9",
            "uses 1 storage buffer, but compatibility mode's maxStorageB",
        ),
        (
            passed,
            compatibility,
            "1:11",
            "uses 16 variables between stages, but compatibility mode's",
        ),
        (
            workgroup,
            "[limits]\nmaxComputeInvocationsPerWorkgroup = 400\nmaxComputeWorkgroupStorageSize = 65536\n",
            "2:34",
            "uses 512 invocations in a workgroup, but karat.toml's maxComputeInvocationsPerWorkgroup is 400",
        ),
    ] {
        let ran = check(text, limits);
        let code = if limits.is_empty() { 0 } else { 1 };
        assert_eq!(ran.code, Some(code), "{text}\n{ran:?}");
        assert!(ran.out.contains(part), "{part}\n{}", ran.out);
        assert!(ran.out.contains(&format!("m.wgsl:{place}")), "{text}\n{}", ran.out);
        assert!(
            last_line(&ran.out).contains("WebGPU's limits are exceeded in 1 module"),
            "{ran:?}"
        );
    }
    // A module within its limits has no finding, with the default limits or with other limits.
    let more = "[limits]\nmaxComputeInvocationsPerWorkgroup = 512\n\
                maxComputeWorkgroupStorageSize = 32768\n";
    let stages = "[limits]\nmaxStorageBuffersPerShaderStage = 12\n";
    let nine: String = (0..9)
        .map(|n| format!("@group(0) @binding({n}) var<storage, read> b{n}: array<f32>;\n"))
        .collect();
    let sum: String = (0..9).map(|n| format!(" + b{n}[0]")).collect();
    let nine = format!(
        "{nine}@vertex fn main() -> @builtin(position) vec4f {{ return vec4f(0.0{sum}); }}\n"
    );
    // No entry point uses the variable, so it's in no layout.
    let unused = "@group(7) @binding(0) var<uniform> u: f32;\nfn f() -> f32 { return u; }\n";
    for (text, limits) in [
        (workgroup, more),
        (storage, ""),
        (uniform, ""),
        (passed, ""),
        (facing, ""),
        (VALID, compatibility),
        (&*nine, stages),
        (unused, ""),
    ] {
        let out = check(text, limits).good();
        assert!(!out.contains("limits"), "{text}\n{out}");
    }
    let ran = check(VALID, "[limits]\nmaxBindGroup = 4\n");
    assert!(ran.code == Some(2) && ran.err.contains("did you mean `maxBindGroups`?"), "{ran:?}");
}

/// Karat tells Tint the limits that the project declares. Without them, Tint's reply would depend on WebGPU's default
/// limits.
#[test]
fn tint_accepts_a_module_within_the_requested_limits() {
    let text = "@compute @workgroup_size(512) fn main() { }\n";
    let folder = folder(text);
    let limits = "[compilers]\nrequire = [\"tint\"]\n[limits]\n\
                  maxComputeInvocationsPerWorkgroup = 1024\nmaxComputeWorkgroupSizeX = 1024\n";
    write(folder.path(), "shaders/karat.toml", limits);
    let out = with_tint(folder.path(), CHECK).good();
    assert_eq!(last_line(&out), "1 package valid; Tint accepts 1 module");
    // A required limit gives an error, and the output has this error once.
    write(folder.path(), "shaders/karat.toml", REQUIRED);
    let ran = with_tint(folder.path(), CHECK);
    assert_eq!(
        (ran.code, ran.out.matches("uses 512 invocations").count()),
        (Some(1), 1),
        "{ran:?}"
    );
}

/// In compatibility mode Tint and Dawn have additional rules.
#[test]
fn compatibility_mode_has_its_own_rules() {
    let text = "@fragment fn main(@location(0) @interpolate(linear) a: f32) -> @location(0) vec4f \
                { return vec4f(a); }\n";
    let folder = folder(text);
    let out = with_tint(folder.path(), CHECK).good();
    assert!(last_line(&out).contains("Tint accepts 1 module"), "{out}");
    write(folder.path(), "shaders/karat.toml", "[limits]\nmode = \"compatibility\"\n");
    let out = with_tint(folder.path(), CHECK).good();
    assert!(last_line(&out).contains("Tint rejects 1 module"), "{out}");
}

/// If an override has no default, only the program that uses the shader knows a valid value, so Karat sets none.
#[test]
fn an_override_without_a_value_is_given_none() {
    let text = "override count: u32;\nvar<workgroup> w: array<f32, count - 1u>;\n\
                @compute @workgroup_size(1) fn main() { w[0] = 1.0; }\n";
    let folder = folder(text);
    let out = with_tint(folder.path(), CHECK).good();
    assert_eq!(last_line(&out), "1 package valid; Tint accepts 1 module");
}

/// If a shader file contains tests, and isn't a file of tests, `karat check` warns that game engines will read the
/// tests, too. `karat show --plain` prints the file without its tests.
// Lesson 206
#[test]
fn tests_in_shipped_files_are_reported_and_can_be_stripped() {
    let folder = folder(VALID);
    let mixed = "/// Twice.\nfn twice(x: f32) -> f32 { return 2.0 * x; }\n\n\
                 @test fn is_two() { expect(twice(1.0) == 2.0); }\n\
                 @test fn is_none(@over(0, 1) x: f32) { expect(twice(0.0 * x) == 0.0); }\n";
    write(folder.path(), "shaders/n.wgsl", mixed);
    write(folder.path(), "shaders/m_test.wgsl", "@test fn is_one() { expect(true); }\n");
    let out = karat(folder.path(), CHECK).good();
    assert!(
        out.contains("warning: this file has 2 tests, and a program that loads the file"),
        "{out}"
    );
    assert!(out.contains("shaders/n.wgsl:4:1") && !out.contains("m_test.wgsl:"), "{out}");
    assert!(last_line(&out).contains("test functions are in 1 module"), "{out}");
    let plain = karat(folder.path(), &["show", "--plain", "n", "--shaders", "shaders"]).good();
    assert_eq!(plain, "/// Twice.\nfn twice(x: f32) -> f32 { return 2.0 * x; }\n");
    let error = karat(folder.path(), &["show", "--plain", "nn", "--shaders", "shaders"]).error();
    assert!(error.contains("did you mean `n`?"), "{error}");
}

/// If naga rejects a module that Tint accepts, the error message says so.
#[test]
fn an_error_of_naga_says_if_tint_accepts_the_module() {
    let folder = folder("requires linear_indexing;\nfn half(x: f32) -> f32 { return 0.5 * x; }\n");
    let ran = with_tint(folder.path(), CHECK);
    assert!(ran.code == Some(1), "{ran:?}");
    assert!(
        ran.out.contains("Tint accepts this module: Chrome can run it, but wgpu and Firefox can't"),
        "{ran:?}"
    );
    write(folder.path(), "shaders/m.wgsl", "fn half(x: f32) -> f32 { return 0.5 * y; }\n");
    let ran = with_tint(folder.path(), CHECK);
    assert!(ran.code == Some(1) && !ran.out.contains("Tint accepts it"), "{ran:?}");
}

/// Some directives, such as `enable subgroups;`, are needed in browsers but unknown to naga. A module with such a
/// directive is valid, and Karat prints a warning.
#[test]
fn an_enable_line_unknown_to_naga_is_a_warning() {
    let text = "enable subgroups;\n@compute @workgroup_size(4) fn main() { let x = subgroupAdd(1.0); _ = x; }\n";
    let folder = folder(text);
    let out = with_tint(folder.path(), CHECK).good();
    assert!(out.contains("because naga doesn't know this line"), "{out}");
    assert!(out.contains("shaders/m.wgsl:1:1") && out.contains("Tint accepts 1 module"), "{out}");
    write(
        folder.path(),
        "shaders/m.wgsl",
        &text.replace("enable subgroups;", "// enable subgroups;"),
    );
    let ran = with_tint(folder.path(), CHECK);
    assert!(!ran.out.contains("naga doesn't know this line"), "{ran:?}");
}

/// A browser gives the same verdict as Tint.
#[cfg(unix)]
#[test]
fn chromium_can_validate_modules_instead_of_tint() {
    let folder = folder("fn shift(x: u32) -> u32 { return x << x + 1u; }\n");
    write(folder.path(), "shaders/valid.wgsl", VALID);
    // The browser's device is a software device without `f16`, which isn't a fault of the shader.
    write(
        folder.path(),
        "shaders/half.wgsl",
        "enable f16;\nfn half(x: f16) -> f16 { return 0.5 * x; }\n",
    );
    let names = ["chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome"];
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut programs =
        std::env::split_paths(&path).flat_map(|folder| names.map(|name| folder.join(name)));
    let browser = programs.find(|program| program.is_file()).expect("run `cargo ci setup`");
    let ran = output(command(folder.path(), CHECK).env("KARAT_TINT", browser));
    assert!(ran.out.contains("mixing '<<' and '+' requires parenthesis"), "{ran:?}");
    assert_eq!(
        last_line(&ran.out),
        "1 package valid; Tint accepts 1 module; Tint rejects 1 module; \
         Tint has no verdict on 1 module"
    );
    assert!(ran.out.contains("this browser's device lacks a feature"), "{ran:?}");
}

/// Programs that replace Tint.
#[cfg(unix)]
mod fakes {
    use std::os::unix::fs::PermissionsExt;

    use super::*;

    /// The FNV-1a hash of a text. The program in Node that runs Tint adds this hash to each reply.
    fn sum(text: &str) -> u32 {
        let units = text.encode_utf16();
        units.fold(0x811c_9dc5, |sum, unit| (sum ^ u32::from(unit)).wrapping_mul(0x0100_0193))
    }

    fn answer(id: u32, text: &str) -> String {
        format!("{{\"id\":{id},\"sum\":{},\"messages\":[],\"pipelines\":[]}}", sum(text))
    }

    fn script(file: &FilePath, text: &str) {
        std::fs::write(file, format!("#!/bin/sh\n{text}")).expect("written");
        let all = std::fs::Permissions::from_mode(0o755);
        std::fs::set_permissions(file, all).expect("it is ours");
    }

    /// Runs `karat check` with the shell script `own` in place of Node.
    fn check(folder: &FilePath, own: &str, more: &[&str]) -> Ran {
        write(folder, "package/package.json", "{}");
        write(folder, "package/dist/readme", "");
        write(folder, "bin/readme", "");
        script(&folder.join("bin/node"), own);
        let path = std::env::join_paths([folder.join("bin"), "/usr/bin".into(), "/bin".into()]);
        let mut command = command(folder, &[CHECK, more].concat());
        command.env("KARAT_TINT", folder.join("package")).env("PATH", path.expect("folders"));
        // A program that runs longer than this counts as hung.
        command.env("XDG_CACHE_HOME", folder).env("KARAT_TIMEOUT", "1");
        output(&mut command)
    }

    const GREETING: &str = "echo '{\"version\":\"of a test\"}' >&2\n";

    /// If Tint crashes or sends wrong replies, it has no verdict. With `--require tint`, the command then fails.
    // Lesson 203
    #[test]
    fn a_tint_that_fails_has_no_verdict() {
        let folder = folder(VALID);
        let good = answer(1, VALID);
        let last = answer(2, "");
        let says = |lines: &[&str]| {
            let lines: String = lines.iter().map(|line| format!("echo '{line}' >&2\n")).collect();
            format!("{GREETING}{lines}cat >/dev/null\n")
        };
        let out = check(folder.path(), &says(&[&good, &last]), &["--require", "tint"]).good();
        assert_eq!(last_line(&out), "1 package valid; Tint accepts 1 module");
        let died = format!("{GREETING}read line\necho 'Bus error'\nexit 3\n");
        let other = answer(1, "fn half(x: f32) -> f32 { return 0.5 * (x); }\n");
        let empty = answer(9, VALID);
        for (fault, own, part) in [
            ("it dies", died, "the program ended (exit status: 3): Bus error"),
            ("it hangs", says(&[]), "the program didn't answer within 1 s"),
            ("it hangs at once", "cat >/dev/null\n".to_owned(), "the program didn't answer within"),
            ("garbage", says(&["Segmentation fault"]), "can't be read: Segmentation fault"),
            ("half an answer", says(&["{\"id\":1,"]), "can't be read: {\"id\":1,"),
            ("another text", says(&[&other, &last]), "Tint's answer is about another shader"),
            ("another question", says(&[&empty]), "Tint's answer is about another shader"),
            ("twice", says(&[&good, &good, &last]), "Tint answered twice"),
            ("it can't start", "echo '{\"error\":\"no Dawn\"}' >&2\n".to_owned(), "run: no Dawn"),
        ] {
            let ran = check(folder.path(), &own, &[]);
            assert_eq!(ran.code, Some(0), "{fault}: nothing requires it\n{ran:?}");
            assert!(ran.out.contains(part), "{fault}: {ran:?}");
            let last = "1 package valid; Tint has no verdict on 1 module";
            assert_eq!(last_line(&ran.out), last, "{fault}");
            let ran = check(folder.path(), &own, &["--require", "tint"]);
            assert_eq!(ran.code, Some(1), "{fault}: {ran:?}");
            write(folder.path(), "shaders/karat.toml", REQUIRED);
            let ran = check(folder.path(), &own, &[]);
            assert!(ran.code == Some(1) && ran.out.contains(part), "{fault}: {ran:?}");
            std::fs::remove_file(folder.path().join("shaders/karat.toml")).expect("it is there");
        }
    }

    /// If one module ends the compiler's process, the other modules still get their verdicts.
    // Lesson 203
    #[test]
    fn a_text_that_ends_tint_is_alone_without_a_verdict() {
        let folder = folder(VALID);
        write(folder.path(), "shaders/n.wgsl", "fn one() -> f32 { return 1.0; }\n");
        let (first, second, last) =
            (answer(1, "fn one() -> f32 { return 1.0; }\n"), answer(1, VALID), answer(2, ""));
        // The first process ends at its first module. The second process gets the other module.
        let own = format!(
            "{GREETING}read line\nif [ ! -e ended ]; then : > ended; exit 3; fi\n\
             echo '{first}' >&2\necho '{last}' >&2\ncat >/dev/null\n"
        );
        let ran = check(folder.path(), &own, &[]);
        let sum = "1 package valid; Tint accepts 1 module; Tint has no verdict on 1 module";
        assert_eq!(last_line(&ran.out), sum, "{second}\n{ran:?}");
    }

    /// If a module imports nothing, Tint gets the bytes of the author's file. If a module imports declarations, Karat
    /// replaces the imports by these declarations, and otherwise changes at most names.
    // Lesson 202
    #[test]
    fn tint_gets_the_authors_bytes() {
        let text = "// Half, in \u{1d465}.\nfn half(x: f32) -> f32 {\n\treturn 5e-1 * ((x));  // as it is\n}\n";
        let own =
            format!("{GREETING}read -r line\n[ -e got ] || printf '%s' \"$line\" > got\nexit 3\n");
        let got = |folder: &FilePath| {
            std::fs::remove_file(folder.join("got")).ok();
            check(folder, &own, &[]);
            let got = std::fs::read_to_string(folder.join("got")).expect("a question");
            json(&got)["text"].as_str().expect("a text").to_owned()
        };
        let folder = folder(text);
        assert_eq!(got(folder.path()), text);
        // Karat leaves out tests, and replaces an import by the imported declaration.
        let tested = format!("{text}@test fn is_none() {{ expect(half(0.0) == 0.0); }}\n");
        write(folder.path(), "shaders/m.wgsl", &tested);
        assert_eq!(got(folder.path()).trim_end(), text.trim_end());
        let importing = "import package::n::half;\nfn f(x: f32) -> f32 { return half ( x ); }\n";
        write(folder.path(), "shaders/m.wgsl", importing);
        write(folder.path(), "shaders/n.wgsl", text);
        let linked = got(folder.path());
        for part in
            ["fn f(x: f32) -> f32 { return ", " ( x ); }", "\treturn 5e-1 * ((x));  // as it is\n"]
        {
            assert!(linked.contains(part), "{part}\n{linked}");
        }
    }

    /// If `KARAT_TINT` names a `tint` executable, Karat runs it and reads the verdict from its output.
    // Lesson 203
    #[test]
    fn a_tint_binary_is_read() {
        let folder = folder("fn f(x: u32) -> u32 { return x << x; }\n");
        let program = folder.path().join("tint");
        let check = |own: &str| {
            let help = "[ \"$1\" = --help ] && echo '--diagnostics-format' && exit 0\n";
            script(&program, &format!("{help}{own}"));
            output(command(folder.path(), CHECK).env("KARAT_TINT", &program))
        };
        let message = "[{\"severity\":\"error\",\"message\":\"mixing\",\"range\":{\"start\":\
                       {\"line\":1,\"column\":30},\"end\":{\"line\":1,\"column\":32}}},\
                       {\"severity\":\"note\",\"message\":\"here\",\"range\":{\"start\":\
                       {\"line\":1,\"column\":6},\"end\":{\"line\":1,\"column\":7}}}]";
        let out = check(&format!("echo '{message}' >&2\nexit 1\n")).good();
        assert!(out.contains("rejects this: mixing") && out.contains("m.wgsl:1:30"), "{out}");
        assert!(out.contains("      here\n"), "its notes are kept: {out}");
        let valid = check("grep 'x << x; }' shader.wgsl > out.wgsl\n").good();
        assert_eq!(last_line(&valid), "1 package valid; Tint accepts 1 module");
        for (own, part) in [
            ("exit 1\n", "the program ended (exit status: 1)"),
            ("exit 0\n", "can't be read: the program ended with exit status: 0"),
            ("echo Killed >&2\nexit 1\n", "can't be read: Killed"),
            ("echo '[]' >&2\nexit 1\n", "can't be read"),
            (&format!("echo '{message}' >&2\n"), "can't be read"),
        ] {
            let ran = check(own);
            assert!(ran.out.contains(part), "{own}: {ran:?}");
            assert!(last_line(&ran.out).ends_with("Tint has no verdict on 1 module"), "{ran:?}");
        }
    }
}

/// If some invocations miss a barrier, the report also shows Tint's error, which Tint finds without running the shader.
#[test]
fn a_barrier_that_some_invocations_miss_shows_the_error_of_tint() {
    let entry = |condition: &str| {
        format!(
            "@group(0) @binding(0) var<storage, read_write> sums: array<u32>;\n\
             @compute @workgroup_size(4) fn main(@builtin(local_invocation_index) i: u32) {{\n    \
             {condition} {{ workgroupBarrier(); }}\n    sums[i] = i;\n}}\n"
        )
    };
    let folder = folder(&entry("if i > 2u"));
    write(
        folder.path(),
        "shaders/m.test.toml",
        "[[compute]]\nentry = \"main\"\nworkgroups = 1\nwith = { sums = { size = 4 } }\n\
         [compute.after.sums]\nequals = [0, 1, 2, 3]\n",
    );
    let told = with_tint(folder.path(), &["test", "shaders"]);
    assert_eq!(told.code, Some(1), "{told:?}");
    let word =
        "Tint's compiler reports the same error: shaders/m.wgsl:3:17: 'workgroupBarrier' must only";
    assert!(told.out.contains(word), "{}", told.out);
    let alone = output(command(folder.path(), &["test", "shaders"]).env("KARAT_TINT", "off"));
    assert_eq!(alone.code, Some(1), "{alone:?}");
    assert!(!alone.out.contains("Tint says"), "{}", alone.out);
}

/// If a program doesn't answer `--help` in time, Karat stops waiting, and reports the reason.
#[cfg(unix)]
#[test]
fn a_help_that_hangs_is_given_up() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "m.wgsl", "fn half(x: f32) -> f32 { return 0.5 * x; }\n");
    let program = folder.path().join("tint");
    // The first program hangs. The second leaves its output to a background process.
    for script in ["exec sleep 1000", "sleep 1000 & exit 0"] {
        std::fs::write(&program, format!("#!/bin/sh\n{script}\n")).expect("it is ours");
        std::fs::set_permissions(&program, std::fs::Permissions::from_mode(0o755)).expect("ours");
        let began = std::time::Instant::now();
        let mut command = command(folder.path(), &["check", "--shaders", "m.wgsl"]);
        let ran = output(command.env("KARAT_TINT", &program).env("KARAT_TIMEOUT", "5"));
        assert!(began.elapsed() < std::time::Duration::from_secs(120), "{ran:?}");
        assert!(ran.out.contains("the program didn't answer within 10 s"), "{ran:?}");
        assert!(ran.out.contains("1 package valid; Tint wasn't asked"), "{ran:?}");
    }
}
