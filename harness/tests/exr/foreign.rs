//! Files that `data/exr/make.py` wrote with the OpenEXR library.

use karat::Image;
use karat::image::Precision;
use karat::unstable::image::ExrFile;

use super::data;

const WIDTH: u32 = 16;

/// The value of a pixel's channel: a multiple of 1/16 below 4.
fn pattern(x: u32, y: u32, channel: u32) -> f32 {
    ((x * 7 + y * 13 + channel * 5) % 64) as f32 / 16.0
}

fn ramp(x: u32, y: u32, channel: u32) -> f32 {
    (x + y * 2 + channel * 3) as f32 / 16.0
}

fn image(width: u32, height: u32, value: impl Fn(u32, u32, u32) -> f32) -> Image {
    let pixel = |i| [0, 1, 2, 3].map(|channel| value(i % width, i / width, channel));
    Image::new(width, height, (0..width * height).map(pixel).collect())
}

fn patterned() -> Image {
    image(WIDTH, 9, pattern)
}

fn opaque(mut image: Image) -> Image {
    image.pixels_mut().iter_mut().for_each(|pixel| pixel[3] = 1.0);
    image
}

fn read(name: &str) -> Image {
    let (image, metadata) = Image::read_exr(&data(&format!("{name}.exr"))).expect(name);
    assert_eq!(metadata, None);
    image
}

fn refusal(name: &str) -> String {
    let error = Image::read_exr(&data(&format!("{name}.exr"))).expect_err(name).to_string();
    error.split_once("isn't a readable OpenEXR image: ").expect("the reason").1.to_owned()
}

#[test]
fn every_lossless_compression_gives_the_values() {
    for codec in ["no", "rle", "zips", "zip", "pxr24"] {
        assert_eq!(read(codec), patterned(), "{codec}");
    }
    assert_eq!(read("piz"), image(40, 24, ramp));
}

#[test]
fn lossy_compressions_give_what_the_library_gives() {
    for codec in ["b44", "b44a"] {
        assert_eq!(read(codec), read(&format!("{codec}.decoded")), "{codec}");
    }
    for codec in ["dwaa", "dwab"] {
        let (ours, theirs) = (read(codec), read(&format!("{codec}.decoded")));
        // DWA computes a cosine transform of floats and rounds it to half floats. Another order of the sums may
        // change a result by one step of half floats.
        assert!(approx::relative_eq!(ours, theirs, epsilon = 0.0, max_relative = 1e-3), "{codec}");
    }
}

#[test]
fn compressions_that_are_not_read_are_named() {
    for (file, name) in
        [("htj2k32", "HTJ2K32"), ("htj2k256", "HTJ2K256"), ("lj2k", "LJ2K"), ("zstd", "ZSTD")]
    {
        let expected = format!(
            "the file is compressed by {name}, which Karat can't read: convert the file to ZIP"
        );
        assert_eq!(refusal(file), expected);
    }
}

#[test]
fn every_type_of_sample_becomes_a_float() {
    let floats = image(WIDTH, 9, |x, y, c| pattern(x, y, c) + 2.0_f32.powi(-18));
    assert_eq!(read("float"), floats);
    let integers = image(WIDTH, 9, |x, y, c| pattern(x, y, c) * 16.0 + 100_000.0);
    assert_eq!(read("uint"), opaque(integers));
    assert_eq!(read("mixed"), patterned());
}

#[test]
fn colours_are_found_and_alpha_is_one_where_it_is_missing() {
    assert_eq!(read("rgb"), opaque(patterned()));
    let grey = image(WIDTH, 9, |x, y, c| pattern(x, y, if c == 3 { 3 } else { 0 }));
    assert_eq!(read("grey"), grey);
    // Of two layers with names, Karat reads the first. A layer without a name comes before a layer with a name.
    assert_eq!(read("layered"), patterned());
    assert_eq!(read("unnamed_first"), patterned());
    // With X and Z beside it, the channel Y isn't a grey image.
    assert_eq!(
        refusal("normals"),
        "the file has neither the channels R, G and B nor the channel Y; its channels are X, Y, Z"
    );
}

#[test]
fn the_data_window_is_the_image_whatever_the_order_and_the_tiles() {
    assert_eq!(read("window"), patterned());
    assert_eq!(read("downwards"), patterned());
    assert_eq!(read("tiled"), patterned());
    assert_eq!(read("mip"), patterned());
    assert_eq!(read("tiled_piz"), opaque(image(40, 24, ramp)));
}

#[test]
fn deep_data_is_refused() {
    assert_eq!(refusal("deep"), "the file has deep data, which Karat can't read");
}

#[test]
fn parts_have_their_names_and_precisions() {
    // The first part has only depth, but the metadata comes from it.
    let (first, metadata) = Image::read_exr(&data("parts.exr")).expect("readable");
    assert_eq!((first, metadata.as_deref()), (patterned(), Some("facts")));
    let file = ExrFile::read(&data("parts.exr")).expect("readable");
    assert_eq!(file.metadata.as_deref(), Some("facts"));
    let parts: Vec<_> = file.parts.iter().map(|p| (p.name.as_str(), p.precision)).collect();
    let expected = [
        ("beauty", Precision::Half),
        ("color.variance", Precision::Float),
        ("mask", Precision::Half),
    ];
    assert_eq!(parts, expected);
    let names = ExrFile::part_names(&data("parts.exr")).expect("readable");
    assert_eq!(names, expected.map(|(name, _)| name));
    assert_eq!(file.parts[1].image, patterned());
    let mask = opaque(image(WIDTH, 9, |x, y, _| pattern(x, y, 7)));
    assert_eq!(file.parts[2].image, mask);
}
