//! Tests `karat diff` without a Cargo project.

use karat::Image;
use karat::image::Precision;
use karat::unstable::image::{ExrFile, Part};

use super::pending::provenance;
use super::*;

fn image(width: u32, height: u32, value: impl Fn(u32) -> f32) -> Image {
    let pixels = (0..width * height).map(|index| [value(index), 0.5, 2.0, 1.0]);
    Image::new(width, height, pixels.collect())
}

/// A folder of images: `a`, `same`, `near` (a drift of 4e-4), `hole` (some dark pixels), `small` (another size), `nan`,
/// `mask`.
fn images() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let ramp = |index: u32| 0.25 + (index % 48) as f32 / 64.0;
    let hole = |index: u32| if index % 48 < 8 && index / 48 < 8 { 0.01 } else { ramp(index) };
    for (name, image) in [
        ("a", image(48, 32, ramp)),
        ("same", image(48, 32, ramp)),
        ("near", image(48, 32, |index| ramp(index) * 1.0004)),
        ("hole", image(48, 32, hole)),
        ("small", image(8, 32, ramp)),
        ("nan", image(48, 32, |index| if index == 50 { f32::NAN } else { ramp(index) })),
        ("mask", image(48, 32, |index| if hole(index) == ramp(index) { 1.0 } else { 0.0 })),
    ] {
        let path = folder.path().join(format!("{name}.exr"));
        image.write_exr(&path, Precision::Float, None).expect("written");
    }
    folder
}

/// Writes a grey PNG with one byte for each pixel.
pub(crate) fn png(folder: &TempDir, name: &str, width: u32, bytes: &[u8]) {
    let file = std::fs::File::create(folder.path().join(name)).expect("created");
    let mut encoder = png::Encoder::new(file, width, bytes.len() as u32 / width);
    encoder.set_color(png::ColorType::Grayscale);
    let mut writer = encoder.write_header().expect("sound");
    writer.write_image_data(bytes).expect("as many samples as pixels");
    writer.finish().expect("written");
}

fn diff(folder: &TempDir, arguments: &[&str]) -> Ran {
    karat(folder.path(), &[&["diff"], arguments].concat())
}

#[test]
fn bounds_decide_and_the_exit_code_says_so() {
    let folder = images();
    for (arguments, code, end) in [
        (&["a.exr", "same.exr"][..], 0, "equal, bit for bit\n"),
        (&["a.exr", "near.exr"], 0, "within rel 1e-3 or (FLIP tile 0.01 and mean FLIP 0.005)\n"),
        (&["a.exr", "near.exr", "--rel", "1e-4"], 1, "the images differ by more than rel 1e-4\n"),
        (&["a.exr", "near.exr", "--rel", "0"], 1, "the images differ by more than rel 0\n"),
        (&["a.exr", "hole.exr"], 1, "and mean FLIP 0.005)\n"),
        (&["a.exr", "hole.exr", "--flip-tile", "1"], 1, "(FLIP tile 1 and mean FLIP 0.005)\n"),
        (&["a.exr", "hole.exr", "--flip-tile", "1", "--flip-mean", "1"], 0, "mean FLIP 1)\n"),
        (&["a.exr", "hole.exr", "--flip-tile", "1", "--flip-mean", "0"], 1, "mean FLIP 0)\n"),
        (&["a.exr", "hole.exr", "--rel", "1"], 0, "within rel 1\n"),
        (&["a.exr", "hole.exr", "--mask", "mask.exr"], 0, "equal, bit for bit\n"),
        (&["a.exr", "small.exr"], 1, "the images differ in size\n"),
        (&["a.exr", "nan.exr"], 1, "NaN and infinities differ from every value\n"),
        (&["nan.exr", "nan.exr"], 1, "NaN and infinities differ from every value\n"),
    ] {
        let ran = diff(&folder, arguments);
        assert_eq!((ran.code, ran.err.as_str()), (Some(code), ""), "{arguments:?}: {ran:?}");
        assert!(ran.out.ends_with(end), "{arguments:?}: {ran:?}");
    }
}

#[test]
fn with_a_tolerance_of_zero_the_error_is_printed() {
    let folder = images();
    let out = diff(&folder, &["a.exr", "near.exr", "--rel", "0"]).out;
    assert!(out.contains(", and no error is allowed\n") && !out.contains("inf"), "{out}");
}

#[test]
fn the_report_has_the_count_place_and_size_of_differences() {
    let folder = images();
    let out = diff(&folder, &["a.exr", "hole.exr"]).out;
    for part in [
        "a: a.exr, 48 x 32\nb: hole.exr, 48 x 32\n",
        "gate: 64 of 1536 pixels differ by more than rel 1e-3, within (0, 0) to (7, 7)\n",
        "  worst: pixel (7, 0) red: 0.01 instead of 0.359375, 972 times the allowed error\n",
        "  pixels that differ at a tolerance of 0.001: 4.167%, 0.01: 4.167%, 0.1: 4.167%, 1: 0.000%\n",
        "HDR-FLIP: largest tile 0.",
        " of 0.01, in (0, 0) to (15, 15); mean 0.",
    ] {
        assert!(out.contains(part), "no `{part}` in:\n{out}");
    }
    let out = diff(&folder, &["a.exr", "nan.exr"]).out;
    let census =
        "b: nan.exr, 48 x 32, 1 pixel with NaN and 0 with infinities, the first at (2, 1)\n";
    assert!(out.contains(census), "{out}");
}

#[test]
fn json_has_what_the_report_has() {
    let folder = images();
    let report = json(&diff(&folder, &["a.exr", "hole.exr", "--json"]).out);
    assert_eq!((&report["verdict"], &report["reason"]), (&"differs".into(), &"values".into()));
    assert_eq!((&report["a"]["width"], &report["b"]["nan"]), (&48.into(), &0.into()));
    assert_eq!(
        (&report["gate"]["off"], &report["gate"]["bounds"]["width"]),
        (&64.into(), &8.into())
    );
    assert_eq!(report["gate"]["worst"]["channel"], "red");
    assert!(report["flip"]["largest_tile"].as_f64().is_some_and(|tile| tile > 0.01), "{report}");
    assert_eq!(report["flip"]["tile_bound"], 0.01);
    let report = json(&diff(&folder, &["nan.exr", "a.exr", "--json"]).out);
    assert_eq!((&report["reason"], &report["a"]["nan"]), (&"non_finite".into(), &1.into()));
    assert!(report["gate"].is_null() && report["flip"].is_null());
    let report = json(&diff(&folder, &["a.exr", "small.exr", "--json"]).out);
    assert_eq!(report["reason"], "size");
    let report = json(&diff(&folder, &["a.exr", "same.exr", "--json"]).good());
    assert_eq!((&report["verdict"], &report["reason"]), (&"equal".into(), &().into()));
}

/// Karat reads a mask without conversion: a pixel counts if its stored value is above one half.
#[test]
fn a_mask_selects_pixels_with_a_stored_value_above_one_half() {
    let folder = images();
    let mask = |byte: u8| {
        let hole = |index: u32| index % 48 < 8 && index / 48 < 8;
        let bytes: Vec<u8> =
            (0..48 * 32).map(|index| if hole(index) { byte } else { 255 }).collect();
        png(&folder, "mask.png", 48, &bytes);
        diff(&folder, &["a.exr", "hole.exr", "--mask", "mask.png"])
    };
    let out = mask(127).good();
    assert!(out.contains("1472 of 1536 pixels are compared, selected by the mask\n"), "{out}");
    assert!(out.ends_with("equal, bit for bit\n"), "{out}");
    let ran = mask(128);
    assert!(ran.code == Some(1) && !ran.out.contains("the mask excludes"), "{ran:?}");
    png(&folder, "black.png", 48, &[127; 48 * 32]);
    let error = diff(&folder, &["a.exr", "hole.exr", "--mask", "black.png"]).error();
    assert!(error.contains("the mask excludes all pixels"), "{error}");
}

#[test]
fn a_bound_is_a_finite_number_of_at_least_0() {
    let folder = images();
    for bound in ["--rel", "--flip-tile", "--flip-mean"] {
        for value in ["-1", "-1e-3", "-0.1", "NaN", "-NaN", "inf", "-inf", "1e39", "", "x", "-x"] {
            let joined = format!("{bound}={value}");
            for arguments in
                [&["a.exr", "same.exr", bound, value][..], &["a.exr", "same.exr", &joined]]
            {
                let error = diff(&folder, arguments).error();
                let message = format!("invalid value '{value}' for '{bound}");
                assert!(error.contains(&message), "{arguments:?}: {error}");
                assert!(error.contains("a bound must be a finite number of at least 0"), "{error}");
            }
        }
        for value in ["0", "-0", "1e-3", "3e38", "1e-45"] {
            assert_eq!(
                diff(&folder, &["a.exr", "same.exr", bound, value]).code,
                Some(0),
                "{value}"
            );
        }
    }
    // Karat refuses numbers that would round to another bound.
    for value in ["1e-50", "1e-46", "5e-324"] {
        let error = diff(&folder, &["a.exr", "same.exr", "--rel", value]).error();
        assert!(error.contains("smaller than the smallest `f32`: write 0"), "{value}: {error}");
    }
    let out = diff(&folder, &["a.exr", "near.exr", "--rel", "1e-45"]).out;
    assert!(out.ends_with("the images differ by more than rel 1e-45\n"), "{out}");
}

#[test]
fn a_report_prints_no_negative_zero() {
    let folder = images();
    // The image changes by one float, which FLIP doesn't see.
    let mut next = Image::read(&folder.path().join("a.exr")).expect("an image");
    next.pixels_mut()[7][0] = next.pixels()[7][0].next_up();
    next.write_exr(&folder.path().join("next.exr"), Precision::Float, None).expect("written");
    for b in ["next.exr", "near.exr"] {
        for bounds in [&[][..], &["--rel", "-0", "--flip-tile", "-0", "--flip-mean", "-0"]] {
            let arguments = [&["a.exr", b], bounds].concat();
            let out = diff(&folder, &arguments).out;
            assert!(out.contains("; mean 0") && !out.contains("-0"), "{out}");
            let report = diff(&folder, &[&arguments[..], &["--json"]].concat()).out;
            assert!(!report.contains("-0"), "{report}");
        }
    }
}

#[test]
fn a_heatmap_is_colours_or_the_errors_themselves() {
    let folder = images();
    let heatmap = |b: &str, file: &str| {
        let arguments = ["a.exr", b, "--rel", "0", "--heatmap", file];
        let (text, json) = (diff(&folder, &arguments), [&arguments[..], &["--json"]].concat());
        assert_eq!(text.code, Some(1), "{text:?}");
        let report = super::json(&diff(&folder, &json).out);
        assert_eq!(report["heatmap"], file);
        let image = Image::read(&folder.path().join(file)).expect("an image");
        (text.out, report["heatmap_full"].clone(), image)
    };
    let (out, full, errors) = heatmap("hole.exr", "flip.exr");
    assert!(out.contains("\nheatmap: flip.exr\n") && full.is_null(), "{out}");
    assert_eq!((errors.width(), errors.height()), (48, 32));
    let (hole, far) = (3 * 48 + 3, 31 * 48 + 47);
    assert!(errors.pixels()[hole][0] > 0.1 && errors.pixels()[far][0] == 0.0);
    let largest = |image: &Image| image.pixels().iter().map(|pixel| pixel[0]).fold(0.0, f32::max);

    let (out, full, colours) = heatmap("hole.exr", "flip.png");
    let scale = if largest(&errors) > 0.5 { 1.0 } else { 0.5 };
    assert!(
        out.contains(&format!("\nheatmap: flip.png, errors shown from 0 to {scale}\n")),
        "{out}"
    );
    assert_eq!(full, scale);
    // The heat map has the pixels of the images at the same positions. The legend below needs more room.
    assert!(colours.width() > 48 && colours.height() > 32);
    let at = |x: u32, y: u32| colours.pixels()[(y * colours.width() + x) as usize];
    assert!(at(3, 3)[0] > 0.05 && at(47, 31)[0] < 0.01, "magma begins at nearly black");

    // The heat map also shows tiny differences, and the numbers say that they are tiny.
    let (out, full, colours) = heatmap("near.exr", "near.png");
    assert!(full.as_f64().is_some_and(|full| full <= 0.01), "{out}");
    let rows = colours.pixels().chunks(colours.width() as usize).take(32);
    let brightest = rows.flat_map(|row| &row[..48]).map(|pixel| pixel[0]).fold(0.0, f32::max);
    assert!(brightest > 0.3, "{brightest}");
    let error = diff(&folder, &["a.exr", "hole.exr", "--heatmap", "flip.jpg"]).error();
    assert!(error.contains("name a .png file (for colours) or an .exr file"), "{error}");
    let ran = diff(&folder, &["a.exr", "small.exr", "--heatmap", "none.png"]);
    assert!(ran.code == Some(1) && ran.err.contains("Karat writes no heatmap"), "{ran:?}");
    assert!(!folder.path().join("none.png").exists());
}

// Lesson 59
#[test]
fn a_heatmap_replaces_no_input() {
    let folder = images();
    let path = |name: &str| folder.path().join(name);
    png(&folder, "mask.png", 48, &[255; 48 * 32]);
    std::fs::create_dir(path("sub")).expect("a folder");
    std::fs::hard_link(path("a.exr"), path("hard.exr")).expect("a link");
    #[cfg(unix)]
    std::os::unix::fs::symlink("a.exr", path("soft.exr")).expect("a link");
    let names = ["a.exr", "hole.exr", "mask.png", "./sub/../a.exr", "hard.exr", "soft.exr"];
    // On other systems, making links needs privileges.
    let outputs = names.into_iter().filter(|name| cfg!(unix) || *name != "soft.exr");
    let inputs = ["a.exr", "hole.exr", "mask.png"];
    let read = || inputs.map(|name| std::fs::read(path(name)).expect("there"));
    let before = read();
    for output in outputs {
        let arguments = ["a.exr", "hole.exr", "--mask", "mask.png", "--heatmap", output];
        let ran = diff(&folder, &arguments);
        assert_eq!(ran.out, "", "{output}: nothing is computed");
        let error = ran.error();
        let message = format!("the heatmap `{output}` would overwrite `");
        assert!(error.contains(&message) && error.contains("name another file"), "{error}");
        assert!(read() == before, "{output}");
    }
}

/// Karat writes a temporary file beside the old file, then renames the temporary file. A program that is reading the
/// old file can read it to its end.
#[test]
fn a_heatmap_is_written_whole() {
    let folder = images();
    let path = |name: &str| folder.path().join(name);
    for file in ["flip.png", "flip.exr"] {
        write(folder.path(), file, "of the run before");
        let old = format!("old-{file}");
        std::fs::hard_link(path(file), path(&old)).expect("a link");
        assert_eq!(diff(&folder, &["a.exr", "hole.exr", "--heatmap", file]).code, Some(1));
        Image::read(&path(file)).expect("an image");
        assert_eq!(std::fs::read(path(&old)).expect("there"), b"of the run before");
    }
    let files = std::fs::read_dir(folder.path()).expect("a folder").flatten();
    let mut names = files.map(|file| file.file_name().to_string_lossy().into_owned());
    assert!(names.all(|name| !name.ends_with(".tmp")), "nothing is left beside it");
}

#[test]
fn images_that_differ_only_in_alpha_differ() {
    let folder = images();
    let mut clear = Image::read(&folder.path().join("a.exr")).expect("an image");
    clear.pixels_mut()[50][3] = 0.5;
    let path = folder.path().join("clear.exr");
    clear.write_exr(&path, Precision::Float, None).expect("written");
    let ran = diff(&folder, &["a.exr", "clear.exr", "--heatmap", "flip.png"]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    for part in [
        "gate: 1 of 1536 pixels differ by more than rel 1e-3, within (2, 1) to (2, 1)\n",
        "  worst: pixel (2, 1) alpha: 0.5 instead of 1, 500 times the allowed error\n",
        "HDR-FLIP: alpha differs at (2, 1), and FLIP ignores alpha\n",
        "heatmap: flip.png, errors shown from 0 to 1, without the differences that FLIP ignores\n",
    ] {
        assert!(ran.out.contains(part), "no `{part}`: {ran:?}");
    }
    // FLIP doesn't detect this difference, even with the widest limits.
    let lenient = ["a.exr", "clear.exr", "--flip-tile", "1", "--flip-mean", "1", "--json"];
    let ran = diff(&folder, &lenient);
    let report = json(&ran.out);
    assert_eq!((ran.code, &report["gate"]["worst"]["channel"]), (Some(1), &"alpha".into()));
    assert!(report["flip"]["largest_tile"].is_null() && report["flip"]["mean"].is_null());
    assert_eq!(report["flip"]["note"], "alpha differs at (2, 1), and FLIP ignores alpha");
    assert_eq!(diff(&folder, &["a.exr", "clear.exr", "--rel", "0.5"]).code, Some(0));
}

#[test]
fn images_of_other_sizes_have_their_sizes_and_their_census() {
    let folder = images();
    let arguments = ["nan.exr", "small.exr"];
    let ran = diff(&folder, &arguments);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    let expected = "a: nan.exr, 48 x 32, 1 pixel with NaN and 0 with infinities, the first at (2, 1)\n\
                    b: small.exr, 8 x 32\nthe images differ in size\n";
    assert_eq!(ran.out, expected);
    let report = json(&diff(&folder, &[&arguments[..], &["--json"]].concat()).out);
    let size = |side: &str| (report[side]["width"].clone(), report[side]["height"].clone());
    assert_eq!((size("a"), size("b")), ((48.into(), 32.into()), (8.into(), 32.into())));
    assert_eq!((&report["a"]["nan"], &report["b"]["nan"]), (&1.into(), &0.into()));
    assert_eq!((&report["verdict"], &report["compared"]), (&"differs".into(), &0.into()));
}

/// If an EXR file has several parts, the report names the part that Karat compares and the parts that it ignores.
#[test]
fn parts_that_are_not_compared_are_named() {
    let folder = images();
    let path = |name: &str| folder.path().join(name);
    let beauty = Image::read(&path("a.exr")).expect("an image");
    let hole = Image::read(&path("hole.exr")).expect("an image");
    let part = |name: &str, image: &Image| Part::new(name, Precision::Float, image.clone());
    let parts = vec![part("beauty", &beauty), part("albedo", &hole), part("light", &hole)];
    ExrFile { parts, metadata: None }.write(&path("parts.exr")).expect("written");
    let out = diff(&folder, &["a.exr", "parts.exr"]).good();
    let head = "a: a.exr, 48 x 32\nb: parts.exr, 48 x 32, of which Karat compares part `beauty` and ignores `albedo`, `light`\n";
    assert!(out.starts_with(head) && out.ends_with("equal, bit for bit\n"), "{out}");
    let report = json(&diff(&folder, &["a.exr", "parts.exr", "--json"]).good());
    assert_eq!(report["b"]["parts"], serde_json::json!(["beauty", "albedo", "light"]));
    assert_eq!(report["a"]["parts"], serde_json::json!([]));
}

/// An EXR file can declare its primaries: the colours of its channels. If two files declare different primaries, Karat
/// prints a note, and compares the values without a conversion.
#[test]
fn primaries_that_differ_are_noted_and_nothing_is_converted() {
    use exr::meta::attribute::Chromaticities;
    use exr::prelude::{SpecificChannels, Vec2, WritableImage};
    let folder = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, red: Option<Vec2<f32>>, position: Vec2<i32>| {
        let grey = SpecificChannels::rgb(|_| (0.5_f32, 0.5_f32, 0.5_f32));
        let mut image = exr::prelude::Image::from_channels((4, 2), grey);
        image.attributes.chromaticities = red.map(|red| Chromaticities {
            red,
            green: Vec2(0.3, 0.6),
            blue: Vec2(0.15, 0.06),
            white: Vec2(0.312_71, 0.329_02),
        });
        image.layer_data.attributes.layer_position = position;
        image.write().to_file(folder.path().join(name)).expect("written");
    };
    let origin = Vec2(0, 0);
    write("none.exr", None, origin);
    write("moved.exr", None, Vec2(-5, 7));
    write("same.exr", Some(Vec2(0.64, 0.33)), origin);
    write("wide.exr", Some(Vec2(0.708, 0.292)), origin);
    png(&folder, "grey.png", 4, &[128; 8]);
    let note = "note: the files name different primaries (chromaticities (0.64, 0.33), (0.3, 0.6), \
                (0.15, 0.06), (0.3127, 0.329) and (0.708, 0.292), (0.3, 0.6), (0.15, 0.06), \
                (0.31271, 0.32902)); Karat compares the values without a conversion\n";
    for (a, b, noted) in [
        ("none.exr", "wide.exr", true),
        ("none.exr", "same.exr", false),
        ("none.exr", "moved.exr", false),
        ("wide.exr", "wide.exr", false),
    ] {
        let out = diff(&folder, &[a, b]).good();
        assert!(out.ends_with("equal, bit for bit\n"), "{out}");
        assert_eq!((out.contains("note:"), out.contains(note)), (noted, noted), "{a}, {b}: {out}");
    }
    let ran = diff(&folder, &["grey.png", "wide.exr"]);
    assert!(ran.code == Some(1) && ran.out.contains(note), "{ran:?}");
    let report = json(&diff(&folder, &["none.exr", "wide.exr", "--json"]).good());
    let red = |side: &str| report[side]["chromaticities"][0].clone();
    assert_eq!((red("a"), red("b")), (0.64.into(), 0.708.into()));
}

/// If a test compares a frame with a mask, `karat diff` uses the same mask for this frame.
#[test]
fn the_mask_of_a_test_is_used() {
    let folder = images();
    let path = |name: &str| folder.path().join(name);
    let golden = Image::read(&path("a.exr")).expect("an image");
    let mut actual = golden.clone();
    actual.pixels_mut()[5] = [f32::NAN; 4];
    let mut mask = Image::new(48, 32, vec![[1.0; 4]; 48 * 32]);
    mask.pixels_mut()[5] = [0.0; 4];
    let write = |name: &str, metadata: Option<String>| {
        let part = |name: &str, image: &Image| Part::new(name, Precision::Float, image.clone());
        let parts = vec![part("color", &actual), part("mask", &mask)];
        ExrFile { parts, metadata }.write(&path(name)).expect("written");
    };
    let facts = provenance("scene", "pixels", "llvmpipe", "");
    write("scene.new.exr", serde_json::to_string(&facts).ok());
    write("foreign.exr", None);
    let out = diff(&folder, &["a.exr", "scene.new.exr"]).good();
    let told = "1535 of 1536 pixels are compared, selected by the part `mask` of image b\n";
    assert!(out.contains(told) && out.ends_with("equal, bit for bit\n"), "{out}");
    let report = json(&diff(&folder, &["a.exr", "scene.new.exr", "--json"]).good());
    assert_eq!((&report["own_mask"], &report["compared"]), (&true.into(), &1535.into()));
    // Karat ignores a part written by another tool, unless the command names the part.
    assert_eq!(diff(&folder, &["a.exr", "foreign.exr"]).code, Some(1));
    let out = diff(&folder, &["a.exr", "foreign.exr", "--mask", "foreign.exr"]).good();
    assert!(out.contains("1535 of 1536 pixels are compared, selected by the mask\n"), "{out}");
}

/// For two PNGs, the report has the LDR-FLIP value that other tools print. The expected values are those of
/// flip-evaluator 1.7.
#[test]
fn two_pngs_have_an_ldr_flip_value_that_is_no_gate() {
    let folder = images();
    let grey = |x: u32, y: u32| ((5 * x + 3 * y) % 256) as u8;
    let hole = |x: u32, y: u32| if x < 8 && y < 8 { 255 - grey(x, y) } else { grey(x, y) };
    let bytes = |value: &dyn Fn(u32, u32) -> u8| {
        (0..48 * 32).map(|index| value(index % 48, index / 48)).collect::<Vec<_>>()
    };
    png(&folder, "a.png", 48, &bytes(&grey));
    png(&folder, "hole.png", 48, &bytes(&hole));
    let ran = diff(&folder, &["a.png", "hole.png"]);
    let line = "\nLDR-FLIP: largest tile 0.363; mean 0.0605; no bound applies to LDR-FLIP\n";
    assert!(ran.code == Some(1) && ran.out.contains(line), "{ran:?}");
    let report = json(&diff(&folder, &["a.png", "hole.png", "--json"]).out);
    let near = |value: &serde_json::Value, expected: f64| {
        value.as_f64().is_some_and(|value| (value - expected).abs() < 1e-6)
    };
    let ldr = &report["ldr_flip"];
    assert!(
        near(&ldr["mean"], 0.060_525_926) && near(&ldr["largest_tile"], 0.363_155_556),
        "{ldr}"
    );
    assert_eq!((&ldr["tile"]["left"], &ldr["tile"]["width"]), (&0.into(), &16.into()));
    let lenient = ["a.png", "hole.png", "--rel", "1e9"];
    assert!(diff(&folder, &lenient).good().contains(line));
    let mask: Vec<u8> = bytes(&|x, y| if hole(x, y) == grey(x, y) { 255 } else { 0 });
    png(&folder, "mask.png", 48, &mask);
    let masked = ["a.png", "hole.png", "--mask", "mask.png", "--json"];
    assert_eq!(json(&diff(&folder, &masked).good())["ldr_flip"]["mean"], 0.0);
    // Images that aren't made for a display have no LDR-FLIP value.
    let report = json(&diff(&folder, &["a.exr", "a.png", "--json"]).out);
    assert!(report["ldr_flip"].is_null() && !report["flip"].is_null());
}

#[test]
fn a_png_is_compared_with_an_exr() {
    let folder = images();
    // A preview is tone-mapped, so it differs from its image.
    karat(folder.path(), &["preview", "a.exr", "--out", "a.png"]).good();
    assert_eq!(diff(&folder, &["a.png", "a.png"]).code, Some(0));
    assert_eq!(diff(&folder, &["a.exr", "a.png"]).code, Some(1));
    let png = Image::read(&folder.path().join("a.png")).expect("an image");
    let path = folder.path().join("linear.exr");
    png.write_exr(&path, Precision::Float, None).expect("written");
    assert_eq!(diff(&folder, &["a.png", "linear.exr", "--rel", "0"]).code, Some(0));
}

#[test]
fn images_that_cannot_be_compared_are_errors() {
    let folder = images();
    write(folder.path(), "text.exr", "not an image");
    let exr = std::fs::read(folder.path().join("a.exr")).expect("written");
    std::fs::write(folder.path().join("half.exr"), &exr[..exr.len() / 2]).expect("written");
    for (arguments, code, message) in [
        (&["a.exr", "none.exr"][..], 3, "there is no image `none.exr`"),
        (&["none.exr", "a.exr"], 3, "there is no image `none.exr`"),
        (&["a.exr", "a.exr", "--mask", "none.png"], 3, "there is no image `none.png`"),
        (&["a.exr", "text.exr"], 2, "`text.exr` is neither an OpenEXR nor a PNG image"),
        (&["half.exr", "a.exr"], 2, "`half.exr` isn't a readable OpenEXR image"),
        (
            &["a.exr", "a.exr", "--mask", "small.exr"],
            2,
            "the mask has 8 x 32 pixels, but the frame has 48 x 32",
        ),
        (&["a.exr", "a.exr", "--heatmap", "text.exr/a.png"], 2, "can't write `text.exr/a.png`"),
        (&["a.exr", "a.exr", "--heatmap", "text.exr/a.exr"], 2, "can't write `text.exr/a.exr`"),
        (&["a.exr"], 2, "required arguments were not provided"),
    ] {
        let error = diff(&folder, arguments).failure(code);
        assert!(error.contains(message), "{arguments:?}: {error}");
    }
}
