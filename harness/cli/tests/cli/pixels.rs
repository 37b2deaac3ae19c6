//! Tests `karat tap` and `karat trace`, which lead from a picture to a line of the shader.

use std::path::Path;

use super::*;
use crate::repository::git;

const SHADER: &str = "fn falloff(x: f32) -> f32 {
    let near = 1.0 - x;
    return near * near;
}

@fragment
fn shade(@location(0) uv: vec2f) -> @location(0) vec4f {
    let n = normalize(vec3f(uv, 1.0));
    let lit = falloff(uv.x);
    let broken = sqrt(uv.y - 0.5);
    let is_right = uv.x > 0.5;
    if (is_right) {
        let inner = lit - 0.05;
        return vec4f(inner);
    }
    return vec4f(lit, broken, n.z, 1.0);
}
";

const FRAME: &str = "[[frame]]\nname = \"disc\"\nfragment = \"shade\"\nsize = [8, 4]\n";

fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(&folder.path().join("shaders"), "m.wgsl", SHADER);
    write(&folder.path().join("shaders"), "m.test.toml", FRAME);
    folder
}

/// Runs a command on Vulkan. The command writes images into a folder.
fn on_vulkan(folder: &Path, words: &[&str]) -> Ran {
    let out = format!("--out={}", folder.join("out").display());
    let mut all = words.to_vec();
    if words[0] == "tap" {
        all.push(&out);
    }
    karat(folder, &[&all[..], &["--path=vulkan"]].concat())
}

// Lesson 39
#[test]
fn tap_shows_values_of_a_frame_as_pictures_and_numbers() {
    let folder = folder();
    let all = on_vulkan(folder.path(), &["tap", "disc"]).good();
    for line in [
        "m::shade::uv: vec2<f32>, a parameter",
        "m::falloff::near: f32 = 1.0 - x  shaders/m.wgsl:2:16",
        "m::shade::is_right: bool = uv.x > 0.5  shaders/m.wgsl:11:20",
    ] {
        assert!(all.lines().any(|one| one == line), "no `{line}` in:\n{all}");
    }
    let ran = on_vulkan(
        folder.path(),
        &["tap", "disc", "near", "shade::n", "inner", "broken", "is_right"],
    );
    let out = ran.good();
    for part in [
        // The smallest value is at the last column's centre: 1 - 15/16.
        "near  shaders/m.wgsl:2:16 in `m::falloff`: f32\n    from 0.0625 at (7, 0) to 0.9375 at (0, 0), mean 0.5\n",
        "disc.m-falloff-near.png: black is 0.0625, light yellow is 0.9375 (colour map magma)",
        "disc.m-shade-n.png: the value is a direction: red, green and blue are half of 1 + x, 1 + y and 1 + z",
        "16 of 32 pixels compute the value, 16 don't reach the code of the value",
        "; NaN is magenta, and infinities are yellow",
        "red is 0.141406, blue is -0.141406",
        "NaN on 16 pixels, first at (0, 0)",
        "disc.m-shade-is_right.png: white is true",
    ] {
        assert!(out.contains(part), "no `{part}` in:\n{out}");
    }
    let image = |name: &str| {
        let file = folder.path().join("out").join(format!("disc.{name}.exr"));
        karat::Image::read_exr(&file).expect("an image").0
    };
    assert_eq!(image("m-falloff-near").pixels()[0], [0.9375, 0.9375, 0.9375, 1.0]);
    assert_eq!(image("m-shade-inner").pixels()[0], [0.0; 4], "it is transparent");
    assert!(image("m-shade-broken").pixels()[0][0].is_nan());
    // In the picture, NaN is magenta, and no pixel is transparent.
    let colours = |name: &str| {
        let file = std::fs::File::open(folder.path().join("out").join(format!("disc.{name}.png")));
        let file = std::io::BufReader::new(file.expect("a picture"));
        let mut reader = png::Decoder::new(file).read_info().expect("PNG");
        let mut bytes = vec![0; reader.output_buffer_size().expect("it is small")];
        reader.next_frame(&mut bytes).expect("PNG");
        bytes
    };
    assert_eq!(colours("m-shade-broken")[..4], [255, 0, 255, 255]);
    assert_eq!(colours("m-shade-inner")[..4], [0; 4]);
    assert_eq!(colours("m-shade-is_right")[4 * 7..4 * 8], [255; 4]);
    let at = ["tap", "disc", "near", "broken", "--at", "0,0", "--at=7,3"];
    let at = on_vulkan(folder.path(), &at).good();
    for part in [
        "    at (0, 0): 0.9375 on vulkan; 0.9375 in the engine; 0.9375 in f64, WGSL allows 0.937",
        "    at (7, 3): 0.0625 on vulkan; 0.0625 in the engine; ",
        "    at (0, 0): NaN on vulkan; NaN in the engine; ",
    ] {
        assert!(at.contains(part), "no `{part}` in:\n{at}");
    }
    let parameter = on_vulkan(folder.path(), &["tap", "disc", "uv", "--at=0,0"]);
    assert!(
        parameter.out.contains(
            "the engine shows only results of operations, but this value is a parameter,"
        ),
        "{parameter:?}"
    );
    let beside = on_vulkan(folder.path(), &["tap", "disc", "near", "--beside"]).good();
    assert!(
        beside.contains("the frame's colours don't change when Karat reads the value"),
        "{beside}"
    );
}

/// In a pass, an expression has a value for each invocation. Karat shows these values as a table, or as a picture if
/// the dispatch is two-dimensional.
// Lesson 39
#[test]
fn invocations_are_a_table_or_a_picture() {
    let folder = tempfile::tempdir().expect("a folder");
    let shader = "@group(0) @binding(0) var<storage, read_write> data: array<f32>;
@compute @workgroup_size(4)
fn root(@builtin(global_invocation_id) id: vec3u) {
    if (id.x == 3u) { return; }
    let own = data[id.x] * 2.0;
    data[id.x] = own;
}
@compute @workgroup_size(2, 2)
fn grid(@builtin(global_invocation_id) id: vec3u) {
    let place = id.y * 4u + id.x;
    data[place] = 1.0;
}
";
    let tests = "[[compute]]\nentry = \"root\"\nworkgroups = 1\nwith = { data = [1, 2, 3, 4] }\n\
                 [compute.after.data]\nequals = [2, 4, 6, 4]\ntolerance = \"1 ulp\"\n\
                 [[compute]]\nentry = \"grid\"\nworkgroups = [2, 1, 1]\nwith = { data = [0, 0, 0, 0, 0, 0, 0, 0] }\n\
                 [compute.after.data]\nfinite = true\n";
    write(&folder.path().join("shaders"), "m.wgsl", shader);
    write(&folder.path().join("shaders"), "m.test.toml", tests);
    karat(folder.path(), &["test", "shaders", "--paths", "cpu"]).good();
    let out = format!("--out={}", folder.path().join("out").display());
    for path in ["--path=cpu", "--path=vulkan"] {
        let root = ["tap", "root", "own", &out, path, "--at=1,0", "--at=3,0"];
        let root = karat(folder.path(), &root).good();
        let on = path.trim_start_matches("--path=");
        assert!(root.contains(&format!("at (1, 0): 4 on {on}; 4 in the engine\n")), "{root}");
        assert!(root.contains(&format!("at (3, 0): not computed on {on}; ")), "{root}");
        assert!(root.contains("2 at (0, 0) to 6 at (2, 0), mean 4"), "{root}");
        assert!(root.contains("3 of 4 invocations compute the value"), "{root}");
        let table = std::fs::read_to_string(folder.path().join("out/root.m-root-own.csv"));
        assert_eq!(table.expect("a table"), "invocation,times,value\n0,1,2\n1,1,4\n2,1,6\n3,0,\n");
        let grid = karat(folder.path(), &["tap", "m::grid", "place", &out, path]).good();
        assert!(grid.contains("m-grid.m-grid-place.png: black is 0, light yellow is 7"), "{grid}");
    }
    let listed = karat(folder.path(), &["tap", "grid", "--path=cpu"]).good();
    assert!(listed.contains("m::grid::place: u32 = id.y * 4u + id.x"), "{listed}");
    let beside = karat(folder.path(), &["tap", "grid", "place", "--beside"]).error();
    assert!(beside.contains("passes have no colours to compare"), "{beside}");
}

/// If a declared frame differs from its golden, the message suggests a `karat trace` command for one of the pixels.
// Lesson 39
#[test]
fn a_frame_that_differs_says_how_to_go_on() {
    let folder = folder();
    let mended = SHADER.replace("sqrt(uv.y - 0.5)", "uv.y");
    write(&folder.path().join("shaders"), "m.wgsl", &mended);
    let test = || karat(folder.path(), &["test", "shaders", "--paths", "vulkan"]);
    assert!(test().out.contains("has no golden"), "it is the first frame");
    let golden = folder.path().join("shaders/golden").display().to_string();
    karat(folder.path(), &["accept", "disc", "--goldens", &golden, "--because", "it is the first"])
        .good();
    write(&folder.path().join("shaders"), "m.wgsl", &mended.replace("near * near", "near * x"));
    let ran = test();
    let message = format!("{}{}", ran.out, ran.err);
    let hint = message.split("`karat trace disc ").nth(1).and_then(|rest| rest.split('`').next());
    let pixel = hint.unwrap_or_else(|| panic!("no hint in {message}"));
    let traced = on_vulkan(folder.path(), &["trace", "disc", pixel]).good();
    assert!(traced.contains("near * x") && traced.contains("the driver drew"), "{traced}");
    // The failure of a frame with NaN also names a command.
    write(&folder.path().join("shaders"), "m.wgsl", SHADER);
    let ran = test();
    assert!(
        format!("{}{}", ran.out, ran.err)
            .contains("`karat trace disc 0,0` shows how the first pixel with NaN or infinity"),
        "{ran:?}"
    );
}

#[test]
fn an_unknown_value_or_place_is_an_error() {
    let folder = folder();
    for (words, part) in [
        (&["tap", "disk", "near"][..], "did you mean `disc`?"),
        (&["tap", "disc", "nera"], "did you mean `near`?"),
        (
            &["tap", "disc", "shaders/m.wgsl:11:1"],
            "this line has the values\n  shaders/m.wgsl:11:20",
        ),
        (&["tap", "disc", "shaders/m.wgsl:12:1"], "compute no value on this line"),
        (&["tap", "disc", "uv.x"], "matches 2 values: choose one\n  shaders/m.wgsl:9:23"),
        (&["tap", "disc", "near", "--round", "0"], "0 is not in"),
        (&["tap", "disc", "near", "--at", "8,0"], "the pixel (8, 0) is outside of the frame"),
        (&["tap", "disc", "near", "--at", "8"], "`8` isn't a pixel"),
        (&["tap", "disc", "near", "--size", "4x4"], "remove `--size`"),
        (&["trace", "disc", "8,0"], "8 x 4 pixels, counted from (0, 0) at the upper left"),
        (&["trace", "disc", "1"], "`1` isn't a pixel: write the pixel's column and row"),
        (&["trace", "disc", "1,1", "--against", "HEAD"], "HEAD"),
    ] {
        let ran = on_vulkan(folder.path(), words);
        assert_ne!(ran.code, Some(0), "{words:?}");
        assert!(ran.err.contains(part), "{words:?}: {ran:?}");
    }
    let ran = karat(folder.path(), &["tap", "disc", "near", "--path", "cpu"]);
    assert!(ran.err.contains("path `cpu` draws no frames"), "{ran:?}");
    let empty = tempfile::tempdir().expect("a folder");
    write(empty.path(), "m.wgsl", SHADER);
    let error = karat(empty.path(), &["tap", "disc", "near"]).error();
    assert!(error.contains("no `*.test.toml` has a `[[frame]]`"), "{error}");
}

// Lesson 39
#[test]
fn a_pixel_is_traced_and_compared_with_a_revision() {
    let folder = folder();
    git(folder.path(), &["init", "-q"]);
    git(folder.path(), &["add", "."]);
    git(folder.path(), &["commit", "-qm", "one"]);
    let out = on_vulkan(folder.path(), &["trace", "disc", "1,3"]).good();
    for part in [
        "m::shade at (1, 3) of `disc`\n  uv = (0.1875, 0.875)\n",
        "near = 1.0 - x",
        "the driver drew    (0.66015625, 0.6123724",
    ] {
        assert!(out.contains(part), "no `{part}` in:\n{out}");
    }
    let json = on_vulkan(folder.path(), &["trace", "disc", "1,3", "--json"]).good();
    let json: serde_json::Value = serde_json::from_str(&json).expect("JSON");
    assert_eq!((&json["frame"], &json["pixel"]), (&"disc".into(), &serde_json::json!([1, 3])));
    assert!(json["steps"].as_array().is_some_and(|steps| steps.len() > 5), "{json}");
    assert_eq!(json["arguments"][0], serde_json::json!(["uv", "(0.1875, 0.875)"]));
    let against = &["trace", "disc", "1,3", "--against", "HEAD"];
    let same = on_vulkan(folder.path(), against).good();
    assert!(same.contains("the shaders are the same as at HEAD: no step differs"), "{same}");
    let edit = |from: &str, to: &str| {
        assert!(SHADER.contains(from));
        write(&folder.path().join("shaders"), "m.wgsl", &SHADER.replace(from, to));
        on_vulkan(folder.path(), against)
    };
    let ran = edit("near * near", "near * x");
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "HEAD:  HEAD:shaders/m.wgsl:3  near * near  is 0.66015625",
        "today:  shaders/m.wgsl:3  near * x  is 0.15234375",
        "the engine returns (0.15234375, ",
    ] {
        assert!(ran.out.contains(part), "no `{part}` in {ran:?}");
    }
    // This pixel doesn't reach the edited line.
    let ran = edit("lit - 0.05", "lit - 0.25");
    assert!(ran.out.contains("no step differs from HEAD"), "{ran:?}");
    assert_eq!(ran.code, Some(0));
}
