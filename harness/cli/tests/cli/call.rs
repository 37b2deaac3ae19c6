//! Tests `karat call` with variables that functions read, with sweeps, and with tables as checks.

use super::diff::png;
use super::*;

const LIT: &str = "\
struct Globals { scale: f32, offset: vec2f, count: u32 }
@group(0) @binding(0) var<uniform> globals: Globals;
@group(0) @binding(1) var image: texture_2d<f32>;
@group(0) @binding(2) var filtering: sampler;
@group(0) @binding(3) var<storage, read> table: array<f32>;
@group(0) @binding(4) var<storage, read_write> counts: array<u32>;
override GAIN: f32 = 1.0;
fn scaled(x: f32) -> f32 { return GAIN * globals.scale * x + globals.offset.y; }
fn sampled(u: f32) -> f32 { return textureSampleLevel(image, filtering, vec2f(u, 0.5), 0.0).x; }
fn looked_up(i: u32) -> f32 { return table[i]; }
fn count(i: u32) -> u32 { counts[i] += 1u; return counts[i]; }
fn next(state: ptr<function, u32>) -> u32 { *state += 1u; return *state * 2u; }
fn edge(d: f32) -> f32 { return clamp(0.5 - d / fwidth(d), 0.0, 1.0); }
fn cubic(t: f32, up: bool) -> vec2f { return vec2f(t * t * t, select(-t, t, up)); }
";

fn lit() -> TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "shaders/lit.wgsl", LIT);
    folder
}

/// Mesa's drivers look for a window system, which CI doesn't have. `karat call` prints no warning about this.
#[test]
fn drivers_do_not_complain() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "m.wgsl", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    let ran =
        karat(folder.path(), &["call", "half", "1", "--shaders", "m.wgsl", "--path", "vulkan"]);
    assert_eq!((ran.code, &*ran.err), (Some(0), ""), "{ran:?}");
}

/// The output of a call on path `cpu`.
fn called(folder: &TempDir, arguments: &[&str]) -> String {
    karat(folder.path(), &[&["call"][..], arguments, &["--path", "cpu"]].concat()).good()
}

// Lesson 134
#[test]
fn variables_are_bound_by_names_files_and_numbers() {
    let folder = lit();
    let json = r#"globals={"scale": 2, "offset": [0, 0.5], "count": 1}"#;
    let out = called(&folder, &["lit::scaled", "3", "--bind", json]);
    assert!(out.contains("cpu      6.5"), "{out}");
    let gain = ["lit::scaled", "3", "--bind", json, "--override", "GAIN=0.5"];
    assert!(called(&folder, &gain).contains("cpu      3.5"));
    write(folder.path(), "globals.json", &json["globals=".len()..]);
    let file = ["lit::scaled", "3", "--bind", "globals=globals.json"];
    assert!(called(&folder, &file).contains("cpu      6.5"));
    write(folder.path(), "globals.toml", "scale = 2\noffset = [0, 0.5]\ncount = 1\n");
    let file = ["lit::scaled", "3", "--bind", "globals=globals.toml"];
    assert!(called(&folder, &file).contains("cpu      6.5"));
    let words = [2.0_f32.to_bits(), 0, 0, 0.5_f32.to_bits(), 1, 0];
    let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
    std::fs::write(folder.path().join("globals.bin"), bytes).expect("written");
    let file = ["lit::scaled", "3", "--bind", "globals=globals.bin"];
    assert!(called(&folder, &file).contains("cpu      6.5"));

    let pixels = (0..4_u8).map(|x| [f32::from(x), 0.0, 0.0, 1.0]).collect();
    let file = folder.path().join("ramp.exr");
    let image = karat::Image::new(4, 1, pixels);
    image.write_exr(&file, karat::image::Precision::Float, None).expect("written");
    let sampled = |u: &str, sampler: &str| {
        let sampler = format!("filtering={sampler}");
        called(&folder, &["lit::sampled", u, "--bind", "image=ramp.exr", "--bind", &sampler])
    };
    assert!(sampled("1.125", "nearest repeat").contains("cpu      0 "));
    assert!(sampled("1.125", "nearest").contains("cpu      3 "));
    assert!(called(&folder, &["lit::looked_up", "2", "--bind", "table=5,6,7.5"]).contains("7.5"));
    let out = called(&folder, &["lit::count", "1", "--bind", "counts=4,5"]);
    assert!(out.contains("result: 6, counts: [4, 6]"), "{out}");
}

// Lesson 134
#[test]
fn call_takes_pointers_derivatives_and_named_arguments() {
    let folder = lit();
    let out = called(&folder, &["lit::next", "4"]);
    assert!(out.contains("next(state: ptr<function, u32>) -> u32"), "{out}");
    assert!(out.contains("{ result: 10, state: 5 }"), "{out}");
    assert!(called(&folder, &["lit::edge", "0.25@0.5@0"]).contains("cpu      0 "));
    assert!(called(&folder, &["lit::edge", "0.125@0.5@0"]).contains("cpu      0.25"));
    let out = called(&folder, &["lit::cubic", "up=true", "t=-0x1p-1"]);
    assert!(out.contains("(-0.125, -0.5)"), "{out}");
}

const MATERIALS: &str = "\
struct Material { roughness: f32, f0: vec3f, layers: array<u32, 2> }
struct Scene { exposure: f32, materials: array<Material, 2> }
fn f(m: Material, k: f32) -> f32 { return k * m.roughness * m.f0.y + f32(m.layers[1]); }
fn last(s: Scene) -> f32 { return s.exposure * s.materials[1].f0.z; }
fn sum(a: array<f32, 3>) -> f32 { return a[0] + a[1] + a[2]; }
";

/// `karat call` accepts a structure or an array as JSON, as an argument and as the contents of a buffer.
#[test]
fn arguments_are_json_where_numbers_have_no_names() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "shaders/m.wgsl", MATERIALS);
    let json = r#"{"f0": [1, 3, 1], "roughness": 0.5, "layers": [1, 2]}"#;
    for arguments in [
        &["m::f", json, "2"][..],
        &["m::f", "k=2", &format!("m={json}")],
        &["m::f", "0.5,1,3,1,1,2", "2"],
    ] {
        assert!(called(&folder, arguments).contains("cpu      5 "), "{arguments:?}");
    }
    let other = json.replace('3', "9");
    let scene = format!(r#"{{"exposure": 2, "materials": [{other}, {json}]}}"#);
    assert!(called(&folder, &["m::last", &scene]).contains("cpu      2 "));
    assert!(called(&folder, &["m::sum", "[1, 2, 3.5]"]).contains("cpu      6.5 "));
    for (argument, part) in [
        (
            json.replace("roughness", "rougness"),
            "argument `m`: there is no member `rougness`; did you mean `roughness`?",
        ),
        (json.replace(r#""f0": [1, 3, 1], "#, ""), "argument `m`: member `f0` is missing"),
        (
            json.replace("[1, 3, 1]", "[1, 3]"),
            "argument `m`: `f0`: a vec3<f32> has 3 components, but the list has 2",
        ),
        (json.replace("0.5", "\"a\""), "argument `m`: `roughness`: "),
        (json.replace("[1, 2]", "[1, -2]"), "argument `m`: `layers`: `-2` isn't of type u32"),
        (json.replace("0.5", "0.5, \"roughness\": 1"), "argument `m`: `roughness` is given twice"),
        (json.replace("0.5", "null"), "argument `m`: `null` isn't a value"),
        (json.replace('}', ""), "argument `m`: EOF while parsing an object"),
        (
            "1,2".to_owned(),
            "has 2; write the struct as JSON: {\"roughness\": 0, \"f0\": [0, 0, 0], \"layers\": [0, 0]}",
        ),
    ] {
        let error = karat(folder.path(), &["call", "m::f", &argument, "1"]).error();
        assert!(error.contains(part), "{argument}: {error}");
    }
}

#[test]
fn wrong_bindings_and_overrides_of_a_call_are_errors() {
    let folder = lit();
    let json = r#"globals={"scale": 2, "offset": [0, 0.5], "count": 1}"#;
    let scaled = ["call", "lit::scaled", "3", "--bind", json, "--override"];
    let error = karat(folder.path(), &[&scaled[..], &["GAIN=true"]].concat()).error();
    let part = "--override GAIN=true: `GAIN` has the type f32, so write a number";
    assert!(error.contains(part), "{error}");
    let error = karat(folder.path(), &["call", "lit::sampled", "u=1", "image=1"]).error();
    assert!(error.contains("--bind image="), "{error}");
    let both = ["--bind", "image=0.5", "--bind", "filtering=linear"];
    let error = karat(folder.path(), &[&["call", "lit::sampled", "image=0.5"], &both[..]].concat());
    let error = error.error();
    assert!(error.contains("not a parameter: write --bind image=0.5"), "{error}");
}

// Lesson 134
#[test]
fn a_sweep_prints_a_table_or_a_plot() {
    let folder = lit();
    let out = called(&folder, &["lit::cubic", "0..1:5", "true"]);
    let lines: Vec<&str> = out.lines().collect();
    assert_eq!(lines[0], "t,up,cpu.x,cpu.y");
    assert_eq!((lines.len(), lines[3]), (6, "0.5,true,0.125,0.5"));
    let exact = called(&folder, &["lit::cubic", "0..1:3", "true", "--hex"]);
    assert!(exact.contains("0x1p-1,true,0x1p-3,0x1p-1"), "{exact}");
    let drawn = called(&folder, &["lit::cubic", "t=-1..1:100", "true", "--plot"]);
    assert!(drawn.contains("t = -1.0000") && drawn.contains("* cpu.x"), "{drawn}");
    let curve = ["lit::cubic", "t=-1..1:100", "true", "--plot=curve.svg", "--out", "t.csv"];
    assert_eq!(called(&folder, &curve), "curve.svg\n", "it says where it wrote");
    let svg = std::fs::read_to_string(folder.path().join("curve.svg")).expect("written");
    assert!(svg.starts_with("<svg") && svg.contains("cpu.y"), "{svg}");
    let table = std::fs::read_to_string(folder.path().join("t.csv")).expect("written");
    assert_eq!(table.lines().count(), 101);
}

// Lesson 134
#[test]
fn a_table_of_expected_values_checks_a_function() {
    let folder = lit();
    let table = "# cubes\nnote,t,up,cube.x,cube.y\nfirst,0.5,true,0.125,0.5\n\
                 second,0x1p-2,false,0x1p-6,-0.25\n";
    write(folder.path(), "cases.csv", table);
    let out = called(&folder, &["lit::cubic", "--table", "cases.csv"]);
    assert!(out.starts_with("t,up,note,cube.x,cube.y,cpu.x,cpu.y\n"), "{out}");
    assert!(out.contains("0.25,false,second,0x1p-6,-0.25,0.015625,-0.25"), "{out}");
    let renamed = called(&folder, &["lit::cubic", "--cases", "cases.csv", "--exact"]);
    assert_eq!(renamed, called(&folder, &["lit::cubic", "--table", "cases.csv", "--hex"]));
    let check = ["--table", "cases.csv", "--expect", "cube", "--tolerance", "4 ulp"];
    let out = called(&folder, &[&["lit::cubic"][..], &check].concat());
    assert_eq!(out, "cpu: all 2 rows agree with the shader (4 ulp)\n");
    write(folder.path(), "cases.csv", &table.replace("0x1p-6", "0.02"));
    let all = [&["call", "lit::cubic"][..], &check, &["--path", "cpu"]].concat();
    let ran = karat(folder.path(), &all);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in ["cases.csv:4", "t = 0.25", "result.x = 0.015625, expected 0.02", "1 of 2 rows"] {
        assert!(ran.out.contains(part), "{part}: {ran:?}");
    }
}

const TEXELS: &str = "\
@group(0) @binding(0) var words: texture_2d<u32>;
@group(0) @binding(1) var signed: texture_2d<i32>;
@group(0) @binding(2) var layers: texture_2d_array<f32>;
@group(0) @binding(3) var sky: texture_cube<f32>;
@group(0) @binding(4) var filtering: sampler;
struct Lights { count: atomic<u32>, scale: f32, items: array<vec2f> }
@group(0) @binding(5) var<storage, read_write> lights: Lights;
fn word() -> vec4u { return textureLoad(words, vec2u(), 0); }
fn integer() -> vec4i { return textureLoad(signed, vec2u(), 0); }
fn layer(i: u32) -> vec4f { return textureLoad(layers, vec2u(), i, 0); }
fn face(d: vec3f) -> vec4f { return textureSampleLevel(sky, filtering, d, 0.0); }
fn light(i: u32) -> vec2f { return f32(atomicLoad(&lights.count)) * lights.scale * lights.items[i]; }
";

// Lesson 133
#[test]
fn values_of_textures_and_buffers_are_exact() {
    let folder = tempfile::tempdir().expect("a folder");
    write(folder.path(), "shaders/t.wgsl", TEXELS);
    let out = |arguments: &[&str], part: &str| {
        let out = called(&folder, arguments);
        assert!(out.contains(part), "{arguments:?}: {part} in\n{out}");
    };
    let words = "words=4294967295,16777217,2,3";
    out(&["t::word", "--bind", words], "(4294967295, 16777217, 2, 3)");
    let integers = "signed=-2147483648,2147483647,-1,0";
    out(&["t::integer", "--bind", integers], "(-2147483648, 2147483647, -1, 0)");
    out(&["t::layer", "1", "--bind", "layers=[[1, 0, 0, 1], [0, 0.5, 0]]"], "(0, 0.5, 0, 1)");
    let faces = "sky=[1, 2, 3, 4, 5, [6, 7, 8]]";
    out(&["t::face", "0,0,-1", "--bind", faces, "--bind", "filtering=nearest"], "(6, 7, 8, 1)");
    let lights = r#"lights={"count": 2, "scale": 0.5, "items": [[1, 2], [3, 4]]}"#;
    out(&["t::light", "1", "--bind", lights], "cpu      (3, 4)");
    let told = |arguments: &[&str], part: &str| {
        let error = karat(folder.path(), &[&["call"][..], arguments].concat()).error();
        assert!(error.contains(part), "{part} in:\n{error}");
    };
    told(
        &["t::word", "--bind", "words=4294967296"],
        "a texel is 4294967296, but the texture's texels are of type u32",
    );
    told(&["t::word", "--bind", words, "--bind", "words=1"], "`words` is bound twice");
    told(
        &["t::light", "1", "--bind", r#"lights={"count": 1, "scale": 1e39, "items": [1]}"#],
        "too large for f32",
    );
    told(
        &["t::light", "1", "--bind", r#"lights={"count": 1, "scale": 1, "items": []}"#],
        "at least one element",
    );
    told(
        &["t::face", "1,0,0", "--bind", "sky=1", "--bind", "filtering=linear clamp repeat"],
        "use `clamp` or `repeat`, not both",
    );
}

// Lesson 132
#[test]
fn tables_have_derivatives_and_carry_their_columns() {
    let folder = lit();
    let sweep = called(&folder, &["lit::edge", "0.125@0..1:3@0"]);
    assert!(sweep.starts_with("d.value,d.dx,d.dy,cpu\n0.125,0,0,"), "{sweep}");
    write(folder.path(), "sweep.csv", &sweep);
    let again = called(&folder, &["lit::edge", "--table", "sweep.csv"]);
    assert!(again.starts_with("d.value,d.dx,d.dy,given.cpu,cpu\n"), "{again}");
    assert!(again.contains("0.125,0.5,0,0.25,0.25"), "{again}");
    let error = |arguments: &[&str], part: &str| {
        let error = karat(folder.path(), &[&["call"][..], arguments].concat()).error();
        assert!(error.contains(part), "{part} in:\n{error}");
    };
    error(&["lit::cubic", "0..1:3", "true", "--plot=o.png"], "--plot=o.svg");
    error(&["lit::cubic", "0..nan:3", "true"], "both ends of a sweep must be finite");
    error(&["lit::looked_up", "0..2:4", "--bind", "table=1,2,3"], "there are only 3 integers");
    let spec = ["lit::cubic", "--table", "sweep.csv", "--expect", "cube", "--tolerance", "spec"];
    error(&spec, "`spec` isn't a number");
    error(
        &["lit::cubic", "1", "true", "--override", "GAIN=1", "--override", "GAIN=2"],
        "set the same override",
    );
}

// Lesson 134
#[test]
fn wrong_arguments_of_a_call_are_errors() {
    let folder = lit();
    let told = |arguments: &[&str], part: &str| {
        let error = karat(folder.path(), &[&["call"][..], arguments].concat()).error();
        assert!(error.contains(part), "{part} in:\n{error}");
    };
    told(&["lit::scaled", "1"], "`globals`, a uniform buffer, is used (shaders/lit.wgsl:2:23)");
    told(&["lit::scaled", "1"], "--bind globals=values.json");
    told(&["lit::scaled", "1", "--bind", "globls=1"], "did you mean `globals`?");
    told(&["lit::scaled", "1", "--bind", "globals"], "write NAME=VALUE");
    told(&["lit::scaled", "1", "--bind", "globals={\"scale\": 1}"], "member `offset` is missing");
    told(&["lit::scaled", "1", "--bind", "globals=none.json"], "can't read `none.json`");
    told(
        &["lit::sampled", "0", "--bind", "image=1", "--bind", "filtering=linear less"],
        "the variable doesn't compare depths",
    );
    told(&["lit::cubic", "1", "true", "--override", "GAIM=1"], "no override `GAIM`");
    told(&["lit::cubic", "0..1", "true"], "number of points");
    told(&["lit::cubic", "x=1", "true"], "no parameter `x`");
    told(&["lit::cubic", "t=1", "t=2"], "two arguments for the parameter `t`");
    told(&["lit::cubic", "1@0@0", "true"], "uses no derivatives");
    told(&["lit::edge", "1@0"], "needs two derivatives");
    told(&["lit::cubic", "1", "true", "--plot"], "--plot needs a sweep");
    told(&["lit::cubic", "0x1.0000001p+0", "true"], "isn't an f32");
    write(folder.path(), "cases.csv", "t,upp\n0.5,true\n");
    told(&["lit::cubic", "--table", "cases.csv"], "no column `up` (did you mean `upp`?)");
    write(folder.path(), "cases.csv", "t,up\n0.5,ture\n");
    told(&["lit::cubic", "--table", "cases.csv"], "`cases.csv` line 2, column `up`");
    let expect = ["--expect", "cube", "--tolerance", "exact"];
    told(&[&["lit::cubic", "--table", "cases.csv"][..], &expect].concat(), "no column `cube.x`");
    write(folder.path(), "cases.csv", "t,up,cube.x,cube.y\n0.5,true,nan,1\n");
    told(&[&["lit::cubic", "--table", "cases.csv"][..], &expect].concat(), "isn't a finite number");
}

#[test]
fn each_option_of_a_call_is_used_or_refused() {
    let folder = lit();
    let told = |arguments: &[&str], part: &str| {
        let error = karat(folder.path(), &[&["call"][..], arguments].concat()).error();
        assert!(error.contains(part), "{part} in:\n{error}");
    };
    let expect = ["--expect", "x", "--tolerance", "exact"];
    told(&[&["lit::cubic", "1", "true"][..], &expect].concat(), "--expect needs a table");
    told(&[&["lit::cubic", "0..1:3", "true"][..], &expect].concat(), "--expect needs a table");
    told(&["lit::cubic", "0...1:3", "true"], "has one dot too many");
    // A table of a call's results serves as a table of expected results.
    let table = called(&folder, &["lit::cubic", "0..1:7", "false"]);
    write(folder.path(), "returned.csv", &table);
    let again =
        ["lit::cubic", "--table", "returned.csv", "--expect", "cpu", "--tolerance", "exact"];
    assert_eq!(called(&folder, &again), "cpu: all 7 rows agree with the shader (0 ulp)\n");
}

#[test]
fn a_path_that_is_required_is_not_left_out() {
    let folder = tempfile::tempdir().expect("a folder");
    let lines = "@group(0) @binding(0) var line: texture_1d<f32>;\n\
                 fn at(x: u32) -> f32 { return textureLoad(line, x, 0).x; }\n";
    write(folder.path(), "shaders/t.wgsl", lines);
    let call = ["call", "t::at", "3", "--bind", "line=0.5"];
    let free = karat(folder.path(), &call);
    let required = output(command(folder.path(), &call).env("KARAT_REQUIRE", "gl"));
    assert!(free.code == Some(0) && free.out.contains("vulkan   0.5"), "{free:?}");
    assert_eq!(required.code, Some(2), "{required:?}");
    let (told, refused) = match karat::unstable::path::adapter(karat::Path::GL) {
        Ok(_) => (
            "note: path `gl` can't bind",
            "error: path `gl` returned no result: path `gl` can't bind",
        ),
        Err(_) => ("", "error: path `gl` returned no result: execution path `gl` is unavailable"),
    };
    assert!(free.err.contains(told) && required.err.contains(refused), "{free:?}, {required:?}");
}

#[test]
fn depths_and_integers_of_textures_are_given_as_data() {
    let folder = tempfile::tempdir().expect("a folder");
    let texels = "@group(0) @binding(0) var color: texture_2d<f32>;\n\
                  @group(0) @binding(1) var depth: texture_depth_2d;\n\
                  @group(0) @binding(2) var words: texture_2d<u32>;\n\
                  @group(0) @binding(3) var<storage> vectors: array<vec3f>;\n\
                  fn c(p: vec2u) -> f32 { return textureLoad(color, p, 0).x; }\n\
                  fn d() -> f32 { return textureLoad(depth, vec2u(), 0); }\n\
                  fn w() -> u32 { return textureLoad(words, vec2u(), 0).x; }\n\
                  fn v(i: u32) -> vec3f { return vectors[i]; }\n";
    write(folder.path(), "shaders/t.wgsl", texels);
    // The image has one texel, stored as 188, which is one half in linear light.
    png(&folder, "half.png", 1, &[188; 3]);
    let stored = 188.0_f32 / 255.0;
    let out = |arguments: &[&str], part: &str| {
        let out = called(&folder, arguments);
        assert!(out.contains(part), "{arguments:?}: {part} in\n{out}");
    };
    out(&["t::c", "0,0", "--bind", "color=half.png"], "cpu      0.502"); // 0.50289
    out(&["t::c", "0,0", "--bind", "color=half.png linear"], &stored.to_string());
    out(&["t::d", "--bind", "depth=half.png"], &stored.to_string());
    out(&["t::w", "--bind", "words=half.png"], "cpu      188");
    // One value fills all texels of a texture with 16 x 16 texels.
    out(&["t::c", "15,15", "--bind", "color=0.25"], "cpu      0.25");
    out(&["t::v", "1", "--bind", "vectors=[1,2,3,4,5,6]"], "(4, 5, 6)");
    out(&["t::v", "1", "--bind", "vectors=[[1,2,3],[4,5,6]]"], "(4, 5, 6)");
    let told = |arguments: &[&str], part: &str| {
        let error = karat(folder.path(), &[&["call"][..], arguments].concat()).error();
        assert!(error.contains(part), "{part} in:\n{error}");
    };
    told(&["t::v", "1", "--bind", "vectors=[1,2,3,4,5]"], "have 6 components, but the list has 5");
    told(&["t::d", "--bind", "depth=half.png srgb"], "aren't colours");
    told(&["t::c", "0,0", "--bind", "color="], "the image's name is empty");
    write(folder.path(), "six.bin", "123456");
    told(&["t::v", "0", "--bind", "vectors=six.bin"], "the file has 6 bytes");
}

/// With `--arbitrary`, Karat generates the values that a call doesn't have, and prints the generated values.
#[test]
fn missing_values_of_a_call_are_generated_and_named() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let text = "struct P { groups: u32, gain: f32 }\n@group(0) @binding(0) var<uniform> p: P;\n\
                fn f(n_dot_l: f32, id: u32) -> f32 { return n_dot_l * p.gain + f32(id % p.groups); }\n";
    write(folder.path(), "m.wgsl", text);
    let call = |more: &[&str]| {
        karat(
            folder.path(),
            &[&["call", "f", "--shaders", "m.wgsl", "--path", "cpu"][..], more].concat(),
        )
    };
    let error = call(&["0.5", "3"]).error();
    assert!(error.contains("--arbitrary"), "{error}");
    let made = call(&["--arbitrary"]).good();
    for part in [
        "generated: n_dot_l = ",
        "generated: id = ",
        "generated: p.groups = ",
        "generated from 0 to 1.0000001: n_dot_l",
    ] {
        assert!(made.contains(part), "no `{part}` in {made}");
    }
    assert_eq!(made, call(&["--arbitrary"]).good(), "the same in each run");
    assert_ne!(made, call(&["--arbitrary=7"]).good());
    let bound = call(&["--arbitrary", "--bind", "p={\"groups\": 1, \"gain\": 0}"]).good();
    assert!(!bound.contains("generated: p."), "{bound}");
    assert!(call(&["--arbitrary=5000"]).error().contains("cases, counted from 0"));
    assert!(call(&["0.5", "3", "--arbitrary"]).error().contains("cannot be used with"));
}

#[test]
fn a_panic_of_one_path_leaves_the_others_their_results() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path();
    let text = "@group(0) @binding(0) var<storage, read_write> lock: array<atomic<u32>, 2>;\n\
                @compute @workgroup_size(1)\nfn spin() {\n    loop {\n        \
                let taken = atomicExchange(&lock[0], 1u);\n        \
                continuing { break if taken == 0u; }\n    }\n    atomicAdd(&lock[1], 1u);\n}\n";
    write(path, "spin.wgsl", text);
    let declared = "[[compute]]\nentry = \"spin\"\nworkgroups = 1\nwith = { lock = [0, 41] }\n\
                    [compute.after.lock]\nequals = [1, 42]\n";
    write(path, "spin.test.toml", declared);
    if !open_paths(path).iter().any(|path| path == "gl") {
        return;
    }
    let panics =
        "path `gl` panics on `spin::spin` (spin.wgsl:3:1): naga panics as it writes GLSL: ";
    let tested = karat(path, &["test", ".", "--paths", "gl,cpu"]);
    assert_eq!(tested.code, Some(1), "{tested:?}");
    for part in [
        panics,
        "on cpu: Karat's engine",
        "all results agree",
        "1 check, 1 failed, 2 cases compared",
    ] {
        assert!(tested.out.contains(part), "no `{part}` in {tested:?}");
    }
    let bound = ["--dispatch", "1", "--bind", "lock=[0,41]", "--path", "gl,cpu"];
    let called = karat(path, &[&["call", "spin::spin"], &bound[..]].concat());
    assert_eq!(called.code, Some(2), "{called:?}");
    assert!(called.out.contains("lock = [1, 42]"), "{called:?}");
    assert!(called.err.contains(&format!("path `gl` returned no result: {panics}")), "{called:?}");
    assert!(
        !called.err.contains("RUST_BACKTRACE") && !called.err.contains("thread '"),
        "{called:?}"
    );
}
