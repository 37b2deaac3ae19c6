use std::sync::LazyLock;

use super::*;
use karat::Package;

static SHADER: LazyLock<Package> = LazyLock::new(|| {
    let text = "@vertex fn cover(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {\n\
                    return vec4f(f32(i & 1u) * 4.0 - 1.0, f32(i >> 1u) * 4.0 - 1.0, 1.0, 1.0);\n\
                }\n\
                @fragment fn grey() -> @location(0) vec4f { return vec4f(0.5); }\n\
                @fragment fn hole(@builtin(position) at: vec4f) -> @location(0) vec4f {\n\
                    let left = u32(at.x) == 0u;\n\
                    let nan = bitcast<f32>(u32(at.y) | 0x7fc00000u);\n\
                    return select(vec4f(0.5), vec4f(nan), left);\n\
                }\n";
    Package::from_modules("pictures", [("flat", text)])
});

fn draw(fragment: &str) -> Result<Frame<'static>, Box<dyn Error>> {
    Ok(SHADER.frame("flat", 2, 3).fullscreen("cover", fragment))
}

#[derive(Debug, thiserror::Error)]
#[error("the sky can't be used")]
struct Sky {
    source: io::Error,
}

fn arguments(words: &[&str]) -> RenderArguments {
    let words = [&["gallery"], words].concat();
    Standalone::try_parse_from(words).expect("good").arguments
}

/// Runs the gallery. Returns the result, and the texts of stdout and stderr without colours.
fn run(gallery: &Gallery, words: &[&str]) -> (Result<Vec<String>, String>, String, String) {
    let text = |bytes: Vec<u8>| {
        let plain = anstream::adapter::strip_bytes(&bytes).into_vec();
        String::from_utf8(plain).expect("UTF-8")
    };
    let (mut out, mut err) = (Vec::new(), Vec::new());
    let arguments = arguments(words);
    let result = gallery.run(&arguments, &mut Output::new(&mut out), &mut Output::new(&mut err));
    let names = result.map(|names| names.into_iter().map(str::to_owned).collect());
    (names.map_err(|error| error.to_string()), text(out), text(err))
}

#[test]
fn a_failing_frame_does_not_stop_the_other_frames() {
    let gallery = Gallery::new()
        .frame("missing", "", |_| draw("gray"))
        .frame("sky", "", |_| Err(Sky { source: io::Error::other("it is dark") }.into()))
        .frame("panic", "", |_| panic!("as planted"))
        .frame("hole", "", |_| draw("hole"))
        .frame("grey", "", |_| draw("grey"));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().to_string_lossy();
    let (failed, lines, errors) = run(&gallery, &["--all", "--out", &out, "--size=4x4"]);
    let bad = ["missing", "sky", "panic", "hole"].map(str::to_owned).to_vec();
    assert_eq!(failed, Ok(bad));
    assert_eq!(lines.lines().count(), 2, "{lines}");
    for part in [
        "error: frame `missing` can't be rendered: module `flat` has no fragment entry point",
        "error: frame `sky` can't be rendered: the sky can't be used: it is dark\n",
        "error: frame `panic` can't be rendered: the frame's code panicked: see the message above\n",
        "note: frame `grey` has a fixed size and ignores --size\n",
        "warning: frame `hole` has 3 pixels with NaN and 0 with infinities, the first one in \
         column 0, row 0\n",
        "4 of 5 frames failed: missing, sky, panic, hole\n",
    ] {
        assert!(errors.contains(part), "no `{part}` in:\n{errors}");
    }
    for name in ["hole", "grey"] {
        let (image, _) = Image::read_exr(&folder.path().join(format!("{name}.exr"))).unwrap();
        assert_eq!((image.width(), image.height()), (2, 3));
        assert_eq!(image.pixels()[0][0].is_nan(), name == "hole");
        assert_eq!(image.pixels()[5], [0.5; 4]);
        assert!(folder.path().join(format!("{name}.png")).is_file());
    }
    let left = std::fs::read_dir(folder.path()).expect("a folder").count();
    assert_eq!(left, 4, "no probe stays behind");
}

#[test]
fn frames_are_selected_by_name_and_glob_in_the_order_of_the_gallery() {
    let gallery = ["scene", "furnace/rough", "furnace/smooth", "lut"]
        .iter()
        .fold(Gallery::new(), |gallery, name| gallery.frame(name, "", |_| draw("grey")));
    let select = |words: &[&str]| {
        let selected = gallery.select(&arguments(words));
        let names = |entries: Vec<&Entry>| entries.iter().map(|e| e.name.clone()).collect();
        selected.map(names).map_err(|error| error.to_string())
    };
    let names = |names: &[&str]| Ok(names.iter().map(|name| (*name).to_owned()).collect());
    let all: Result<Vec<String>, String> =
        names(&["scene", "furnace/rough", "furnace/smooth", "lut"]);
    assert_eq!(select(&["--all"]), all);
    assert_eq!(select(&["*"]), all);
    assert_eq!(select(&["--first"]), names(&["scene"]));
    assert_eq!(select(&["lut", "scene", "l*"]), names(&["scene", "lut"]));
    assert_eq!(select(&["furnace/*"]), names(&["furnace/rough", "furnace/smooth"]));
    let error = "the gallery has no frame `scnee`; did you mean `scene`?";
    assert_eq!(select(&["scnee"]), Err(error.to_owned()));
    assert!(select(&["[", "lut"]).is_err_and(|error| error.contains("no frame `[`; its")));
}

#[test]
fn a_gallery_that_makes_no_sense_is_an_error() {
    let frame = |gallery: Gallery, name| gallery.frame(name, "", |_| draw("grey"));
    let error = |gallery: &Gallery| run(gallery, &["--list"]).0.expect_err("refused");
    assert!(error(&Gallery::new()).contains("the gallery has no frame; add one"));
    let twice = frame(frame(Gallery::new(), "a"), "a");
    assert_eq!(error(&twice), "the gallery has two frames with the name `a`");
    for name in ["", "a b", "/a", "../a", "a//b", "a.exr", "*"] {
        let named = frame(Gallery::new(), name);
        assert!(error(&named).starts_with(&format!("`{name}` can't name a frame")), "{name}");
    }
}

/// A writer that fails like a closed pipe.
struct Closed;

impl Write for Closed {
    fn write(&mut self, _: &[u8]) -> io::Result<usize> {
        Err(io::ErrorKind::BrokenPipe.into())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

// Lesson 57
#[test]
fn frames_are_written_to_a_closed_output() {
    let gallery = Gallery::new().frame("grey", "", |_| draw("grey"));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().to_string_lossy();
    let arguments = arguments(&["grey", "--out", &out]);
    let mut out = Output::new(Closed);
    let failed = gallery.run(&arguments, &mut out, &mut Vec::new()).expect("it works");
    out.finish().expect("nobody reads, which is no error");
    assert!(failed.is_empty() && folder.path().join("grey.exr").is_file());
}
