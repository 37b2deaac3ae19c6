//! Inputs of frames reach the shader: vertex attributes, and mip levels of textures.

use glam::{Vec2, Vec3, Vec4};
use karat::Path;
use karat::draw::Mesh;
use karat::frame::FrameError;
use karat::golden::{FrameTolerance, GoldenError};
use karat::image::Precision;
use karat::metric::Rect;
use karat::prelude::*;
use karat::unstable::golden::Provenance;
use karat::unstable::image::ExrFile;
use karat::{Frame, Goldens, Image};

const SHADER: &str = "
@group(0) @binding(0) var stripes: texture_2d<f32>;
@group(0) @binding(1) var stripes_sampler: sampler;

struct Varyings {
    @builtin(position) clip: vec4f,
    @location(0) color: vec3f,
    @location(1) uv: vec2f,
    @location(2) weight: f32,
}

@vertex
fn vertex(
    @location(0) position: vec3f,
    @location(3) weight: f32,
    @location(1) color: vec3f,
    @location(2) uv: vec2f,
) -> Varyings {
    return Varyings(vec4f(position, 1.0), color, uv, weight);
}

@fragment
fn attributes(in: Varyings) -> @location(0) vec4f {
    return vec4f(in.color.xy, in.uv.y, in.weight);
}

@fragment
fn levels(in: Varyings) -> @location(0) vec4f {
    let fine = textureSampleLevel(stripes, stripes_sampler, vec2f(0.125, 0.5), 0.0).r;
    let coarse = textureSampleLevel(stripes, stripes_sampler, vec2f(0.125, 0.5), 1.0).r;
    let coarsest = textureSampleLevel(stripes, stripes_sampler, vec2f(0.125, 0.5), 2.0).r;
    return vec4f(fine, coarse, coarsest, in.weight);
}
";

/// A triangle over the whole frame. Its attributes aren't in the order of their locations.
fn triangle() -> Mesh {
    let corners = [Vec2::NEG_ONE, Vec2::new(3.0, -1.0), Vec2::new(-1.0, 3.0)];
    let positions = corners.map(|corner| corner.extend(0.5)).to_vec();
    let unit = corners.map(|corner| 0.5 * (corner + Vec2::ONE));
    Mesh::new(positions, vec![0, 1, 2])
        .attribute(2, &unit)
        .attribute(3, &[0.5_f32; 3])
        .attribute(1, &unit.map(|at| Vec3::new(at.x, 0.25, 0.0)))
}

fn drawn(fragment: &str, fixtures: bool) -> Vec<Image> {
    let package = Package::from_source("frame", SHADER);
    let open = Path::ALL.into_iter().filter(|path| karat::unstable::path::adapter(*path).is_ok());
    let frame = |path| {
        let mut frame = package.frame("", 4, 4).mesh("vertex", fragment, triangle(), 1);
        if fixtures {
            let stripes = Texture::from_fn(4, 4, |column, _| Vec4::splat(column as f32));
            frame = frame
                .with("stripes", stripes.with_mips())
                .with("stripes_sampler", Sampler::NEAREST);
        }
        frame.render(path).expect("the triangle is drawn")
    };
    let images: Vec<Image> = open.map(frame).collect();
    assert!(!images.is_empty(), "no path opens, so nothing would be checked");
    images
}

/// Each attribute arrives at its own location. All expected values are binary fractions, so `f32` represents them
/// exactly.
#[test]
fn attributes_reach_the_vertex_function() {
    for image in drawn("attributes", false) {
        for (index, pixel) in image.pixels().iter().enumerate() {
            let (column, row) = (index % 4, index / 4);
            let [x, y] = [column, 3 - row].map(|place| (place as f32 + 0.5) / 4.0);
            for (found, expected) in pixel.iter().zip([x, 0.25, y, 0.5]) {
                assert!((found - expected).abs() < 1e-6, "{pixel:?} at {column}, {row}");
            }
        }
    }
}

/// Each mip level contains the means of the previous level. The columns of the texture have the values 0, 1, 2 and 3,
/// so the next mip level has the values 1/2 and 5/2, and the last level has the value 3/2.
#[test]
fn levels_are_means() {
    for image in drawn("levels", true) {
        assert!(image.pixels().iter().all(|pixel| *pixel == [0.0, 0.5, 1.5, 0.5]));
    }
}

/// Checks that the error reports a wrong mean on each path that has a driver on this machine, and no other failure.
fn is_mean(error: &FrameError) -> bool {
    match error {
        FrameError::Mean { .. } => true,
        FrameError::Paths(paths) => paths.stopped.is_empty() && paths.failures.iter().all(is_mean),
        _ => false,
    }
}

/// The check of a rectangle's mean colour needs no golden. If the mean is NaN, the check fails.
#[test]
fn the_mean_of_a_rectangle_is_what_is_expected() {
    let package = Package::from_source("frame", SHADER);
    let frame: Frame<'_> =
        package.frame("", 4, 4).mesh("vertex", "attributes", triangle(), 1).unrecorded();
    let right = Rect::new(2, 0, 2, 4);
    let mean = frame.has_mean(right, [0.75, 0.25, 0.5], Abs(1e-6));
    assert!(!mean.paths.is_empty());
    let error = frame.try_has_mean(right, [0.75, 0.25, 0.51], Rel(0.01)).expect_err("it is .5");
    assert!(is_mean(&error), "{error}");
    assert!(error.to_string().contains("the mean colour of (2, 0) to (3, 3) is [0.75, 0.25, 0.5]"));
    let error = frame.try_has_mean(Rect::new(2, 0, 3, 4), [0.0; 3], Abs(1.0));
    assert!(
        error
            .expect_err("too wide")
            .to_string()
            .contains("extends beyond the frame of 4 x 4 pixels")
    );
    for useless in [f64::NAN, f64::INFINITY, -1.0] {
        let error = frame.try_has_mean(right, [0.0; 3], Abs(useless)).expect_err("no bound");
        assert!(error.to_string().contains("the tolerance of the frame is"), "{error}");
    }
    let nan = "@vertex fn vertex(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
        return vec4f(vec2f(f32(i & 1u), f32(i >> 1u)) * 4.0 - 1.0, 0.5, 1.0);
    }
    @fragment fn fragment(@builtin(position) at: vec4f) -> @location(0) vec4f {
        return vec4f(select(1.0, bitcast<f32>(u32(at.x) + 0x7fc00000u), at.x < 1.0 && at.y < 1.0));
    }";
    let package = Package::from_source("frame", nan);
    let frame = package.frame("", 4, 4).fullscreen("vertex", "fragment");
    frame.has_mean(Rect::new(0, 1, 4, 3), [1.0; 3], Abs(0.0));
    let frame = frame.unrecorded();
    let error = frame.try_has_mean(Rect::new(0, 0, 4, 4), [1.0; 3], Rel(1e9)).expect_err("NaN");
    assert!(is_mean(&error), "{error}");
}

/// The paths that have a driver on this machine, each with the driver's selector, such as `gl@llvmpipe`.
fn drivers() -> Vec<(Path, String)> {
    let adapters = Path::ALL
        .into_iter()
        .filter_map(|path| Some((path, karat::unstable::path::adapter(path).ok()?)));
    adapters.map(|(path, adapter)| (path, format!("{path}@{}", adapter.family()))).collect()
}

/// A tolerance for a driver replaces the tolerance for the driver's path. A tolerance for a path replaces the general
/// tolerance.
#[test]
fn the_most_particular_tolerance_holds() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let goldens = Goldens::open(folder.path());
    let package = Package::from_source("frame", SHADER);
    let frame = || package.frame("", 4, 4).mesh("vertex", "attributes", triangle(), 1);
    let mut golden = frame().render(drivers()[0].0).expect("drawn");
    golden.pixels_mut()[3][1] *= 1.01;
    golden.write_exr(&folder.path().join("near.exr"), Precision::Float, None).expect("written");
    let (tight, wide) = (|| FrameTolerance::gate(1e-3), || FrameTolerance::gate(0.02));
    let on = |frame: Frame<'_>, path: Option<f32>, driver: Option<f32>| {
        let all = drivers().into_iter().fold(frame, |frame, (on, name)| {
            let frame = path.iter().fold(frame, |frame, bound| frame.tolerance_on(on, *bound));
            driver.iter().fold(frame, |frame, bound| frame.tolerance_on(&*name, *bound))
        });
        all.unrecorded().try_matches(&goldens, "near").map(|agreement| agreement.paths.len())
    };
    on(frame().tolerance(tight()), None, None).expect_err("a hundredth off");
    on(frame().tolerance(tight()), Some(0.02), None).expect("allowed on the path");
    on(frame().tolerance(tight()), Some(1e-3), Some(0.02)).expect("allowed for the driver");
    on(frame().tolerance(wide()), Some(0.02), Some(1e-3)).expect_err("not for the driver");
    let elsewhere = frame().tolerance(tight()).tolerance_on("gl@nobody", wide());
    on(elsewhere, None, None).expect_err("of no driver here");
    let error = on(frame().tolerance_on("llvmpipe", wide()), None, None).expect_err("no path");
    assert!(error.to_string().contains("there is no execution path `llvmpipe`"), "{error}");
    let error = on(frame().fails_on("vulcan", "a bug"), None, None).expect_err("no path");
    assert!(error.to_string().contains("did you mean `vulkan`?"), "{error}");
    let error = on(frame(), None, Some(f32::NAN)).expect_err("no bound");
    assert!(matches!(error, FrameError::Tolerance(_)), "{error}");
}

/// A pending frame keeps its AOVs (additional images of intermediate values) and the facts that its author adds.
#[test]
fn aovs_and_facts_are_kept_with_a_frame_that_is_new() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let goldens = Goldens::open(folder.path());
    let package = Package::from_source("frame", SHADER);
    let plain = |fragment: &str| package.frame("", 4, 4).mesh("vertex", fragment, triangle(), 1);
    let textured = |fragment: &str| {
        plain(fragment)
            .with("stripes", Texture::from_fn(4, 4, |x, _| Vec4::splat(x as f32)).with_mips())
            .with("stripes_sampler", Sampler::NEAREST)
    };
    let frame = plain("attributes")
        .fact("samples", 64)
        .aov("levels", textured("levels"))
        .aov("missing", plain("no_such_function"));
    let error = frame.unrecorded().try_matches(&goldens, "aovs_and_facts").expect_err("no golden");
    let FrameError::Golden { cause, .. } = &error else { panic!("{error}") };
    let GoldenError::Missing { pending, .. } = &**cause else { panic!("{error}") };
    let ExrFile { parts, metadata } = ExrFile::read(pending.as_ref()).expect("written");
    let names: Vec<&str> = parts.iter().map(|part| part.name.as_str()).collect();
    assert_eq!(names, ["color", "levels"], "what can't be drawn is left out");
    assert!(parts[1].image.pixels().iter().all(|pixel| pixel[2] == 1.5));
    let facts = Provenance::parse(&metadata.expect("facts")).expect("ours").facts;
    assert_eq!(facts.get("samples").map(String::as_str), Some("64"));
    for (name, reason) in [("", "use 1 to 255"), ("a/b", "use 1 to 255"), ("mask", "another part")]
    {
        let frame = plain("attributes").aov(name, plain("attributes"));
        let error =
            frame.unrecorded().try_matches(&goldens, "aovs_and_facts").expect_err("no name");
        assert!(error.to_string().contains(reason), "{error}");
    }
    let twice = plain("attributes").aov("a", plain("attributes")).aov("a", plain("attributes"));
    let error = twice.unrecorded().try_matches(&goldens, "aovs_and_facts").expect_err("one name");
    assert!(error.to_string().contains("another AOV has that name"), "{error}");
}
