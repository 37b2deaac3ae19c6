//! `karat render` of the library's frames: what it is asked for is what it draws.

use std::path::Path;
use std::process::Command;

use karat::Image;
use karat::image::Precision;

/// Runs the gallery as `karat render` does.
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

/// A panorama and six faces of one colour light the scene with it.
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
    for (file, complaint) in [(square, "is no environment"), (odd, "a power of two is needed")] {
        let output = gallery(folder.path(), &["environment", "--environment", &file]);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && text.contains(complaint), "{text}");
    }
}
