//! Tests that `karat render` draws the requested frames of the library.

use std::path::Path;
use std::process::Command;

use karat::Image;
use karat::image::Precision;
use karat::unstable::frame::Tap;
use karat::unstable::trace::Value;

fn gallery(folder: &Path, arguments: &[&str]) -> std::process::Output {
    Command::new(env!("CARGO_BIN_EXE_gallery"))
        .args(arguments)
        .arg("--out")
        .arg(folder)
        .output()
        .expect("the gallery runs")
}

fn write(folder: &Path, name: &str, width: u32, height: u32) -> String {
    let file = folder.join(name);
    let pixels = vec![[0.25, 0.5, 2.0, 1.0]; (width * height) as usize];
    let image = Image::new(width, height, pixels);
    image.write_exr(&file, Precision::Float, None).expect("the folder is writable");
    file.display().to_string()
}

/// Draws a frame in an environment of one colour, given as a panorama and as six faces, and checks that the frame shows
/// this colour.
#[test]
fn a_users_environment_is_what_is_seen() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, width, height) in [("panorama.exr", 16, 8), ("faces.exr", 4, 24)] {
        let file = write(folder.path(), name, width, height);
        let output = gallery(folder.path(), &["environment", "--environment", &file]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let drawn = folder.path().join("environment.exr");
        let (image, _) = Image::read_exr(&drawn).expect("it was written");
        let expected = Image::new(288, 192, vec![[0.25, 0.5, 2.0, 1.0]; 288 * 192]);
        approx::assert_abs_diff_eq!(image, expected, epsilon = 1e-6);
        assert!(folder.path().join("environment.png").is_file());
    }
}

#[test]
fn size_and_samples_are_those_asked_for() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let draw = |samples: &str| {
        let arguments = ["diffuse", "--size", "64x36", "--samples", samples];
        assert!(gallery(folder.path(), &arguments).status.success());
        let (image, _) =
            Image::read_exr(&folder.path().join("diffuse.exr")).expect("it was written");
        assert_eq!((image.width(), image.height()), (64, 36));
        image.hash()
    };
    assert_ne!(draw("4"), draw("64"));
}

#[test]
fn images_that_are_no_environment_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let square = write(folder.path(), "square.exr", 8, 8);
    let odd = write(folder.path(), "odd.exr", 3, 18);
    for (file, complaint) in [(square, "isn't an environment"), (odd, "a power of two is needed")] {
        let output = gallery(folder.path(), &["environment", "--environment", &file]);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && text.contains(complaint), "{text}");
    }
}

/// Compares the values that drivers compute for variables of the scene's shader with the engine's values. Each value is
/// in the range that WGSL allows for the inputs that the driver interpolated. Most values equal the engine's to the
/// bit, because drivers and engine round products and sums in the same way. Only operations such as `normalize` and
/// `dot` may differ.
// Lesson 39
#[test]
fn values_of_the_scene_are_the_engine_s() {
    const NAMES: [&str; 10] = [
        "scene::surface::texel",
        "scene::surface::normal",
        "scene::surface::v",
        "scene::surface::n",
        "scene::facing_normal::missing",
        "specular::estimate::n_dot_v",
        "irradiance::estimate::frame",
        "materials::material_from_texels::dielectric",
        "sampling::orthonormal_basis::a",
        "sampling::orthonormal_basis::b",
    ];
    const SIZE: (u32, u32) = (64, 48);
    let (mut compared, mut equal) = (0, 0);
    for path in frames::open_paths() {
        let shot = frames::Shot::golden(path).sized(SIZE.0, SIZE.1);
        let shot = frames::Shot { samples: Some(4), ..shot };
        let frame = frames::frame("scene", &shot).expect("it is a frame");
        let tapped: Vec<_> = NAMES
            .iter()
            .map(|name| {
                frame.tap(path, &Tap::new(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
            })
            .collect();
        let shown = tapped[1].told.iter().enumerate().filter(|(_, told)| **told);
        let pixels: Vec<u32> =
            shown.map(|(at, _)| u32::try_from(at).expect("few")).step_by(120).collect();
        assert!(pixels.len() >= 4, "{} pixels", pixels.len());
        for pixel in pixels {
            let at = (pixel % SIZE.0, pixel / SIZE.0);
            let traced = frame.trace(path, at).unwrap_or_else(|error| panic!("{at:?}: {error}"));
            for one in &tapped {
                let width = one.shape.lanes().len();
                let lanes = &one.lanes[pixel as usize * width..][..width];
                let own = traced.steps.iter().rfind(|step| {
                    step.span.range == one.span.range && step.span.file.name == one.span.file.name
                });
                // Constructors and calls have no step in the trace.
                let Some(step) = own.filter(|_| one.told[pixel as usize]) else { continue };
                for ((lane, single), allowed) in lanes.iter().zip(&step.single).zip(&step.allowed) {
                    let Value::Single(single) = single else { continue };
                    let driver = f32::from_bits(*lane);
                    compared += 1;
                    equal += usize::from(driver.to_bits() == single.to_bits());
                    if let Some((Value::Single(lo), Value::Single(hi))) = allowed {
                        let text = &one.text;
                        assert!(
                            (*lo..=*hi).contains(&driver),
                            "{text} at {at:?} on {path}: {driver}, {lo} to {hi}"
                        );
                    }
                }
            }
        }
    }
    println!("{equal} of {compared} numbers have the engine's bits");
    assert!(compared >= 60, "only {compared} were compared");
    assert!(equal * 2 > compared, "{equal} of {compared} are equal");
}
