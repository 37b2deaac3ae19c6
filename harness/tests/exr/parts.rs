//! Files of several parts.

use karat::Image;
use karat::image::{ImageError, Precision};
use karat::unstable::image::{ExrFile, Part};

fn image(scale: f32) -> Image {
    let pixels = (0..12 * 18).map(|i| [i as f32 * scale, 0.5, i as f32, 1.0]);
    Image::new(12, 18, pixels.collect())
}

fn golden() -> ExrFile {
    let parts = vec![
        Part::new("beauty", Precision::Half, image(0.25)),
        Part::new("color.variance", Precision::Float, image(1e-9)),
        Part::new("mask", Precision::Half, image(0.0)),
    ];
    ExrFile { parts, metadata: Some("{\"schema\":2}".to_owned()) }
}

#[test]
fn parts_come_back_and_give_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("deeper/golden.exr");
    golden().write(&path).expect("written");
    let first = std::fs::read(&path).expect("readable");
    assert_eq!(ExrFile::read(&path).expect("readable"), golden());
    let (beauty, metadata) = Image::read_exr(&path).expect("readable");
    assert_eq!((beauty, metadata.as_deref()), (image(0.25), Some("{\"schema\":2}")));
    let names = ExrFile::part_names(&path).expect("readable");
    assert_eq!(names, ["beauty", "color.variance", "mask"]);
    for _ in 0..8 {
        golden().write(&path).expect("written");
        assert!(std::fs::read(&path).expect("readable") == first, "other bytes");
    }
}

#[test]
fn names_are_checked_before_anything_is_written() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("golden.exr");
    let refused = |names: &[&str]| {
        let part = |name: &&str| Part::new(*name, Precision::Half, image(1.0));
        let file = ExrFile { parts: names.iter().map(part).collect(), metadata: None };
        match file.write(&path) {
            Err(error @ ImageError::PartName { .. }) => error.to_string(),
            other => panic!("{other:?}"),
        }
    };
    assert_eq!(
        refused(&["a", "b", "a"]),
        "an image's part can't have the name `a`: another part has this name"
    );
    assert_eq!(
        refused(&["a", "b c"]),
        "an image's part can't have the name `b c`: use letters, digits, `-`, `_` and `.`"
    );
    assert_eq!(
        refused(&["a", ""]),
        "an image's part can't have the name ``: in an image with several parts, each part needs a name"
    );
    let long = "x".repeat(256);
    assert!(refused(&[&long]).ends_with("the name is longer than 255 characters"));
    assert!(!path.exists());
    let long = ExrFile {
        parts: vec![Part::new("x".repeat(255), Precision::Half, image(1.0))],
        metadata: None,
    };
    long.write(&path).expect("written");
    assert_eq!(ExrFile::read(&path).expect("readable"), long);
}

#[test]
fn unreadable_images_are_not_written() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("golden.exr");
    let write = |parts| ExrFile { parts, metadata: None }.write(&path);
    let error = write(Vec::new()).expect_err("no parts").to_string();
    assert!(error.ends_with("the image has no parts"), "{error}");
    let wide = Image::new(16_385, 1, vec![[0.0; 4]; 16_385]);
    let error = wide.write_exr(&path, Precision::Half, None).expect_err("too wide").to_string();
    assert!(
        error.ends_with("16385 x 1 pixels, but each side must have 1 to 16384 pixels"),
        "{error}"
    );
    let none = Image::new(0, 4, Vec::new());
    assert!(none.write_exr(&path, Precision::Half, None).is_err());
    assert!(!path.exists());
}
