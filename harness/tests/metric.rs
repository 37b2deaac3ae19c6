//! Metrics against independent results: HDR-FLIP against NVIDIA's implementation, and a part of an image against the
//! whole image.

use karat::Image;
use karat::golden::FrameTolerance;
use karat::image::Precision;
use karat::metric::{Flip, Mask, MaskError, Noise, Rect};
use karat::unstable::metric::{ErrorMap, TILE};
use karat::unstable::metric::{ExposureRange, FlipFailure, Gate, Metric, Pair, PairError};

const WIDTH: u32 = 48;
const HEIGHT: u32 = 40;

/// The random number that `data/flip/vectors.py` computes for one channel of a pixel.
fn random(x: u32, y: u32, channel: u32, seed: u32) -> f32 {
    let h = x + 48 * y + 1920 * channel + 7919 * seed;
    let h = h.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let h = ((h >> ((h >> 28) + 4)) ^ h).wrapping_mul(277_803_737);
    let h = (h >> 22) ^ h;
    (h >> 8) as f32 / (1 << 24) as f32
}

fn image(width: u32, height: u32, value: impl Fn(u32, u32, u32) -> f32) -> Image {
    let pixel = |index: u32| {
        let (x, y) = (index % width, index / width);
        [value(x, y, 0), value(x, y, 1), value(x, y, 2), 1.0]
    };
    Image::new(width, height, (0..width * height).map(pixel).collect())
}

/// The golden and the new image of the pair that `data/flip/vectors.py` calls `name`.
fn pair(name: &str) -> (Image, Image) {
    let noise = |seed: u32| move |x: u32, y: u32, c: u32| random(x, y, c, seed);
    let sized = |value: &dyn Fn(u32, u32, u32) -> f32| image(WIDTH, HEIGHT, value);
    let bright = |x: u32, y: u32| x > 20 && x < 26 && y > 10 && y < 16;
    match name {
        "noise" => (sized(&noise(1)), sized(&noise(2))),
        "edges" => {
            let bar = |shift: u32| {
                sized(&move |x, _, c| {
                    let ramp = (x * [4, 2, 1][c as usize]) as f32 / 64.0;
                    if ((x + shift) / 8).is_multiple_of(2) { ramp } else { 16.0 }
                })
            };
            (bar(0), bar(1))
        }
        "highlight" => {
            let with = |light: f32| {
                sized(&move |x, y, c| if bright(x, y) { light } else { random(x, y, c, 1) / 4.0 })
            };
            (with(512.0), with(256.0))
        }
        "drift" => (sized(&noise(1)), sized(&|x, y, c| random(x, y, c, 1) * (1.0 + 1.0 / 1024.0))),
        _ => {
            let half = |x: u32| if x < 24 { 1.0 } else { 1.125 };
            (sized(&noise(1)), sized(&move |x, y, c| random(x, y, c, 1) * half(x)))
        }
    }
}

/// The bytes of a file in `data/flip`.
fn data(file: &str) -> Vec<u8> {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/flip");
    std::fs::read(root.join(file)).expect("it is there")
}

fn published(name: &str) -> Vec<f32> {
    let bytes = data(&format!("{name}.f32"));
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

/// For each case: the name, the first and the last exposure in stops, and the number of pixels per degree.
const CASES: [(&str, f64, f64, f32); 6] = [
    ("noise", -3.0, 2.0, Flip::MEAN.pixels_per_degree),
    ("edges", -6.0, 1.0, Flip::MEAN.pixels_per_degree),
    ("highlight", -9.5, -1.5, Flip::MEAN.pixels_per_degree),
    ("drift", -1.0, 0.5, Flip::MEAN.pixels_per_degree),
    ("near", -4.0, 3.0, 30.0),
    ("far", -2.0, 2.0, 100.0),
];

#[test]
fn flip_values_equal_those_of_the_published_implementation() {
    let mut largest = 0.0_f32;
    for (name, start, stop, pixels_per_degree) in CASES {
        let (golden, actual) = pair(name);
        let measured = Pair::new(&golden, &actual).expect("finite");
        let measured = measured.with_exposures(ExposureRange { start, stop });
        let flip = Flip { pixels_per_degree, ..Flip::MEAN };
        let map = flip.whole(&measured).expect("it is computed");
        let published = published(name);
        assert_eq!((map.values().len(), published.len()), (1920, 1920));
        for (index, (ours, theirs)) in map.values().iter().zip(&published).enumerate() {
            let difference = (ours - theirs).abs();
            assert!(difference <= 1e-6, "{name}, pixel {index}: {ours} {theirs}");
            largest = largest.max(difference);
        }
        let mean = published.iter().copied().map(f64::from).sum::<f64>() / 1920.0;
        assert!((map.mean(&measured) - mean).abs() <= 1e-7, "{name}: {mean}");
        assert!(mean > 1e-3, "{name} would be equal to anything");
    }
    println!("largest difference from the published implementation: {largest:e}");
}

/// For each pixel, Karat and the program of FLIP's authors report the same exposure, with one exception. Karat also
/// tries exposures outside of the range in [`CASES`]. If one of them shows a larger error, Karat reports that exposure.
#[test]
fn exposures_are_those_of_flips_authors() {
    let mut same = 0;
    for (name, start, stop, pixels_per_degree) in CASES.into_iter().filter(|c| c.0 != "drift") {
        let (golden, actual) = pair(name);
        let pair = Pair::new(&golden, &actual).expect("finite");
        let pair = pair.with_exposures(ExposureRange { start, stop });
        let flip = Flip { pixels_per_degree, ..Flip::MEAN };
        let (map, whole) = (flip.map(&pair).expect("computed"), flip.whole(&pair).expect("too"));
        let exposures = flip.exposures(&pair).expect("computed");
        let step = (stop - start) / ((stop - start).ceil() - 1.0);
        for (index, theirs) in (0..).zip(data(&format!("{name}.u8"))) {
            let (x, y) = (index % WIDTH, index / WIDTH);
            let ours = exposures.at(x, y).map(f64::from);
            let (judged, published) = (map.at(x, y), whole.at(x, y));
            if judged > published {
                let added = ours.expect("it has an error");
                assert!(!(start..=stop).contains(&added), "{name} ({x}, {y}): {added}");
            } else if judged > 0.0 {
                let (ours, theirs) = (ours.expect("an error"), start + f64::from(theirs) * step);
                assert!((ours - theirs).abs() < 1e-5, "{name} ({x}, {y}): {ours} {theirs}");
                same += 1;
            } else {
                assert_eq!((ours, theirs), (None, 255), "{name} ({x}, {y})");
            }
        }
    }
    assert!(same > 5000, "{same}");
}

/// Dark exposures show errors in highlights, and bright exposures show errors in shadows.
#[test]
fn exposures_tell_highlights_from_shadows() {
    let lamp = Rect::new(20, 20, 24, 24);
    let room = |light: f32, shade: f32| {
        image(160, 120, move |x, y, _| if lamp.contains(x, y) { light } else { shade })
    };
    let golden = room(500.0, 0.05);
    let exposures = |actual: &Image, mask: Option<&Mask>| {
        let pair = match mask {
            None => Pair::new(&golden, actual),
            Some(mask) => Pair::masked(&golden, actual, mask),
        };
        let pair = pair.expect("finite");
        Flip::LARGEST_TILE.exposures(&pair).expect("computed")
    };
    let all = ExposureRange::of(&golden);
    let (darkest, brightest) = (all.start as f32, all.stop as f32);
    assert!(brightest - darkest > 10.0, "{all}");
    let light = exposures(&room(250.0, 0.05), None);
    assert_eq!(light.range().map(|range| *range.start()), Some(darkest));
    let at = light.at(32, 32).expect("the middle of the lamp");
    assert!(at < darkest + 2.0, "{at} of {all}");
    assert_eq!((light.at(100, 100), light.at(159, 119), light.at(999, 0)), (None, None, None));

    let mut shadow = golden.clone();
    for y in 90..100 {
        shadow.pixels_mut()[160 * y + 100..160 * y + 110].fill([0.04, 0.04, 0.04, 1.0]);
    }
    let shade = exposures(&shadow, None);
    let at = shade.at(105, 95).expect("the middle of the shadow");
    // At this exposure, people see the largest difference between greys of 0.05 and 0.04.
    assert!(at > brightest - 4.0, "{at} of {all}");
    assert_eq!(shade.at(32, 32), None);
    // This pixel is brighter than all others, so Karat adds exposures.
    let mut sun = golden.clone();
    sun.pixels_mut()[160 * 95 + 105] = [1e6, 1e6, 1e6, 1.0];
    let at = exposures(&sun, None).at(105, 95);
    assert!(at.is_some_and(|at| at < darkest), "{at:?} of {all}");
    let equal = exposures(&golden, None);
    assert_eq!((equal.range(), equal.at(105, 95)), (None, None));
    let mask = Mask::except(&[Rect::new(100, 90, 5, 10)]);
    let masked = exposures(&shadow, Some(&mask));
    assert!(masked.at(104, 95).is_none() && masked.at(105, 95).is_some(), "{masked:?}");
}

/// LDR-FLIP compares two images as a display shows them. The images of the pair `far` differ only in one half, so Karat
/// computes only that half of the error map.
#[test]
fn ldr_flip_is_what_its_authors_compute() {
    let default = Flip::MEAN.pixels_per_degree;
    for (name, pixels_per_degree) in
        [("ldr_noise", default), ("ldr_edges", default), ("ldr_far", 100.0)]
    {
        let (golden, actual) = pair(name.trim_start_matches("ldr_"));
        let pair = Pair::new(&golden, &actual).expect("finite");
        let flip = Flip { pixels_per_degree, ..Flip::MEAN };
        let map = flip.displayed(&pair).expect("it is computed");
        assert_eq!(map.rect().left > 0, name == "ldr_far");
        let published = published(name);
        assert_eq!(published.len(), 1920);
        for (index, theirs) in (0..).zip(&published) {
            let (x, y) = (index % WIDTH, index / WIDTH);
            let difference = (map.at(x, y) - theirs).abs();
            assert!(difference <= 1e-6, "{name}, ({x}, {y}): {} {theirs}", map.at(x, y));
        }
        let mean = published.iter().copied().map(f64::from).sum::<f64>() / 1920.0;
        assert!((map.mean(&pair) - mean).abs() <= 1e-7, "{name}: {mean}");
        assert!(mean > 1e-3, "{name} would be equal to anything");
    }
}

#[test]
fn ldr_flip_sees_no_alpha_and_nothing_that_a_display_clips() {
    let golden = image(24, 24, |_, _, _| 2.0);
    let mut actual = golden.clone();
    actual.pixels_mut()[30] = [3.0, 1.0, 2.0, 0.5];
    let pair = Pair::new(&golden, &actual).expect("finite");
    let map = Flip::MEAN.displayed(&pair).expect("it is computed");
    assert!(map.values().iter().all(|error| *error == 0.0), "{map:?}");
    let same = Pair::new(&golden, &golden).expect("finite");
    let map = Flip::MEAN.displayed(&same).expect("it is computed");
    assert!(map.values().is_empty() && map.mean(&same) == 0.0);
}

/// If a fault is small, Karat computes only a part of the error map. The values of this part equal the values in the
/// whole map.
#[test]
fn a_part_of_the_map_is_that_of_the_whole() {
    let golden = image(160, 120, |x, y, c| 2.0 * random(x, y, c, 3));
    for (left, top) in [(0, 0), (155, 40), (70, 112), (80, 60)] {
        let fault = Rect::new(left, top, 5, 7);
        let mut actual = golden.clone();
        for y in top..top + fault.height {
            for x in left..left + fault.width {
                actual.pixels_mut()[(y * 160 + x) as usize][1] += 0.5;
            }
        }
        // These exposures show all values, so Karat adds none.
        let exposures = ExposureRange { start: -3.0, stop: 4.0 };
        let pair = Pair::new(&golden, &actual).expect("finite").with_exposures(exposures);
        let (part, whole) = (Flip::LARGEST_TILE.map(&pair), Flip::LARGEST_TILE.whole(&pair));
        let (part, whole) = (part.expect("computed"), whole.expect("computed"));
        assert!(part.values().len() < 27 * 29, "{:?}", part.rect());
        let pixels = (0..120).flat_map(|y| (0..160).map(move |x| (x, y)));
        for (x, y) in pixels {
            assert_eq!(part.at(x, y).to_bits(), whole.at(x, y).to_bits(), "({x}, {y})");
        }
        assert_eq!(part.largest_tile(&pair), whole.largest_tile(&pair));
        assert!((part.mean(&pair) - whole.mean(&pair)).abs() < 1e-12);
        let at = (left / TILE, top / TILE);
        let (_, tile) = part.largest_tile(&pair);
        assert!(tile.left / TILE <= at.0 + 1 && tile.top / TILE <= at.1 + 1, "{tile}");
    }
}

/// FLIP misses differences in alpha, in negative values, and in pixels so bright that they are white at each of
/// the golden's exposures. Karat reports these differences.
#[test]
fn differences_that_flip_misses_fail() {
    let golden = image(64, 64, |x, y, c| random(x, y, c, 4));
    let changed = |channel: usize, value: f32| {
        let mut actual = golden.clone();
        actual.pixels_mut()[100][channel] = value;
        let measured = Flip::LARGEST_TILE.measure(&Pair::new(&golden, &actual).expect("finite"));
        (measured.value, measured.note.unwrap_or_default())
    };
    let (value, note) = changed(3, 0.99);
    assert!(value == f64::INFINITY && note == "alpha differs at (36, 1), and FLIP ignores alpha");
    let (value, note) = changed(1, -0.5);
    assert!(value == f64::INFINITY && note.contains("a negative value differs at (36, 1)"));

    // Three bright pixels of 4096 don't change the exposures, at which these pixels are white.
    let sun = |light: f32| {
        let mut image = golden.clone();
        image.pixels_mut()[2000..2003].fill([light, light, light, 1.0]);
        image
    };
    let (golden, actual) = (sun(2e4), sun(1e4));
    let pair = Pair::new(&golden, &actual).expect("finite");
    let whole = Flip::LARGEST_TILE.whole(&pair).expect("computed");
    let map = Flip::LARGEST_TILE.map(&pair).expect("computed");
    let ((seen, _), (unseen, _)) = (map.largest_tile(&pair), whole.largest_tile(&pair));
    assert!(unseen < 1e-3 && seen > 0.012, "{unseen} {seen}");

    // A difference that no exposure shows fails.
    for (light, other) in [(1e30, 3e38), (3e38, 1e30)] {
        let sun = |light: f32| {
            image(64, 64, |x, y, _| if y == 31 && (16..19).contains(&x) { light } else { 0.2 })
        };
        let (golden, actual) = (sun(light), sun(other));
        let pair = Pair::new(&golden, &actual).expect("finite");
        let measured = Flip::MEAN.measure(&pair);
        assert_eq!(measured.value, f64::INFINITY);
        let note = "the value 3e38 of pixel (16, 31) is more than 128 stops outside of the golden's exposures: \
                    clamp the value in the shader, or compare only by the gate";
        assert_eq!(measured.note.as_deref(), Some(note));
        assert!(FrameTolerance::default().compare(&golden, &actual, None).is_err());
    }
    let dark = |light: f32| image(64, 64, |x, y, _| if x + y == 9 { light } else { 1e-37 });
    let (night, day) = (dark(1e-41), dark(3e-41));
    let measured = Flip::MEAN.measure(&Pair::new(&night, &day).expect("finite"));
    assert!(
        measured.note.is_some_and(
            |note| note.starts_with("the value 3e-41 of pixel (9, 0) is more than 128")
        )
    );

    let pair = pair.with_exposures(ExposureRange { start: f64::NAN, stop: 0.0 });
    assert!(matches!(Flip::MEAN.map(&pair), Err(FlipFailure::Parameters(_))));
    assert!(!(Flip::MEAN.measure(&pair).value <= 1.0));
}

#[test]
fn a_gate_finds_the_one_wrong_channel() {
    let golden = image(600, 3, |x, y, c| 1.0 + random(x, y, c, 5));
    let gate = Gate::default();
    assert_eq!(gate.passes(&Pair::new(&golden, &golden).expect("finite")), Some(0.0));
    for (index, channel) in [(0, 0), (511, 1), (512, 2), (1799, 3)] {
        let mut actual = golden.clone();
        actual.pixels_mut()[index][channel] *= 1.0 + 0.9e-3;
        let ratio = gate.passes(&Pair::new(&golden, &actual).expect("finite"));
        assert!(ratio.is_some_and(|ratio| (ratio - 0.9).abs() < 1e-3), "{ratio:?}");
        actual.pixels_mut()[index][channel] *= 1.01;
        let pair = Pair::new(&golden, &actual).expect("finite");
        assert_eq!(gate.passes(&pair), None);
        let outliers = gate.outliers(&pair).expect("one is out");
        let worst = outliers.worst;
        let place = (worst.y * 600 + worst.x) as usize;
        assert_eq!((outliers.count, place, worst.channel), (1, index, channel));
        let absolute = Gate { relative: 0.0, absolute: Some(0.1) }.passes(&pair);
        assert!(absolute.is_some(), "an absolute bound is of every channel");
    }
}

/// Karat stores an image as half floats if rounding changes each value by at most half of the tolerance.
#[test]
fn an_image_is_stored_as_precisely_as_the_gate_compares() {
    let gate = |relative| Gate { relative, absolute: None };
    let precision = |image: &Image, relative| gate(relative).precision_for(image, None);
    let ordinary = image(64, 48, |x, y, c| 0.01 + 20.0 * random(x, y, c, 7));
    assert_eq!(precision(&ordinary, 1e-3), Precision::Half);
    assert_eq!(precision(&ordinary, 4e-4), Precision::Float);
    assert_eq!(precision(&ordinary, f32::NAN), Precision::Float);
    // Half floats store their own values under any tolerance.
    assert_eq!(precision(&ordinary.rounded_to(Precision::Half), 0.0), Precision::Half);
    let with = |channel: usize, value: f32| {
        let mut image = ordinary.clone();
        image.pixels_mut()[64 * 20 + 9][channel] = value;
        image
    };
    // The image's key is near 8, so values below 8e-4 are compared as if they were 8e-4.
    for (channel, value, expected) in [
        (1, 65504.0, Precision::Half),
        (1, 7e4, Precision::Float),
        (1, -7e4, Precision::Float),
        (1, 1.2345e-8, Precision::Half),
        (3, 1.2345e-8, Precision::Half),
        (3, 0.0123456, Precision::Half),
        (3, 0.7, Precision::Half),
        (2, f32::NAN, Precision::Float),
        (2, f32::INFINITY, Precision::Float),
    ] {
        assert_eq!(precision(&with(channel, value), 1e-3), expected, "{channel} {value}");
    }
    for light in [1e-8, 3e-6] {
        let dark = image(64, 48, |x, y, c| light * (1.0 + random(x, y, c, 7)));
        assert_eq!(precision(&dark, 1e-3), Precision::Float, "{light}");
        let absolute = Gate { relative: 1e-3, absolute: Some(1e-5) };
        assert_eq!(absolute.precision_for(&dark, None), Precision::Half, "{light}");
    }
    // A masked pixel neither requires 32-bit floats, nor changes the key.
    let hole = Rect::new(9, 20, 1, 1);
    let masked =
        |image: &Image, rect| gate(1e-3).precision_for(image, Some(&Mask::except(&[rect])));
    assert_eq!(masked(&with(1, 7e4), hole), Precision::Half);
    assert_eq!(masked(&with(1, f32::NAN), hole), Precision::Half);
    assert_eq!(masked(&with(1, 7e4), Rect::new(0, 0, 9, 9)), Precision::Float);
    assert_eq!(masked(&ordinary, Rect::new(0, 0, 99, 99)), Precision::Float);
    // Beside a bright half of the frame, the dark half counts as black.
    let half_dark = image(64, 48, |_, y, _| if y < 24 { 6e4 } else { 1.2345e-5 });
    assert_eq!(precision(&half_dark, 1e-3), Precision::Half);
    assert_eq!(masked(&half_dark, Rect::new(0, 0, 64, 24)), Precision::Float);
}

#[test]
fn masks_leave_out_what_they_say() {
    let golden = image(64, 48, |x, y, c| random(x, y, c, 6));
    let mut actual = golden.clone();
    for index in [64 * 10 + 20, 64 * 11 + 21] {
        actual.pixels_mut()[index] = [f32::NAN, 9.0, 0.0, 0.5];
    }
    assert!(matches!(Pair::new(&golden, &actual), Err(PairError::NonFinite(_))));
    let hole = Rect::new(20, 10, 2, 2);
    let black = |x: u32, y: u32, _| if hole.contains(x, y) { 0.0 } else { 1.0 };
    for mask in [
        Mask::except(&[hole]),
        Mask::only(&[Rect::new(0, 0, 64, 10), Rect::new(30, 10, 34, 38)]),
        Mask::wherever(move |x, y| !hole.contains(x, y)),
        Mask::image(image(64, 48, black)),
    ] {
        let pair = Pair::masked(&golden, &actual, &mask).expect("what is compared is finite");
        assert!(
            pair.is_identical() && !pair.is_compared(20, 10) && pair.compared_count() < 64 * 48
        );
        // A fault beside the mask is detected, and the masked pixel doesn't count.
        let mut faulty = actual.clone();
        faulty.pixels_mut()[64 * 12 + 40] = [9.0; 4];
        let pair = Pair::masked(&golden, &faulty, &mask).expect("finite");
        let found = Gate::default().outliers(&pair).expect("it is out");
        assert_eq!((found.count, found.rect), (1, Rect::new(40, 12, 1, 1)));
    }
    let refused = |mask: &Mask| Pair::masked(&golden, &actual, mask).expect_err("useless");
    assert_eq!(refused(&Mask::wherever(|_, _| false)), PairError::Mask(MaskError::Nothing));
    assert_eq!(refused(&Mask::only(&[])).to_string(), "the mask excludes all pixels");
    let error = refused(&Mask::image(image(8, 8, |_, _, _| 1.0)));
    assert_eq!(error.to_string(), "the mask has 8 x 8 pixels, but the frame has 64 x 48");
    for rect in [Rect::new(60, 0, 5, 5), Rect::new(3, 3, 0, 4), Rect::new(u32::MAX, 0, 2, 2)] {
        assert!(matches!(
            refused(&Mask::except(&[rect])),
            PairError::Mask(MaskError::Outside { .. })
        ));
    }
}

/// The mean of a tile includes only the tile's compared pixels.
#[test]
fn tile_means_include_only_compared_pixels() {
    let golden = image(40, 20, |_, _, _| 1.0);
    let mut actual = golden.clone();
    actual.pixels_mut()[0] = [2.0; 4];
    let errors = |x: u32, y: u32| if (x, y) == (33, 17) { 1.0 } else { 0.25 };
    let rect = Rect::new(30, 15, 10, 5);
    let pixels = (15..20).flat_map(|y| (30..40).map(move |x| (x, y)));
    let map = ErrorMap::new(rect, pixels.map(|(x, y)| errors(x, y)).collect());
    let all = Pair::new(&golden, &actual).expect("finite");
    // The tile of the corner has 8 x 4 pixels.
    let expected = (31.0 * 0.25 + 1.0) / 32.0;
    assert_eq!(map.largest_tile(&all), (expected, Rect::new(32, 16, 8, 4)));
    assert_eq!(map.mean(&all), (49.0 * 0.25 + 1.0) / 800.0);
    let mask = Mask::except(&[Rect::new(33, 17, 1, 1)]);
    let pair = Pair::masked(&golden, &actual, &mask).expect("finite");
    assert_eq!(map.largest_tile(&pair), (0.25, Rect::new(32, 16, 8, 4)));
    assert_eq!(map.mean(&pair), 49.0 * 0.25 / 799.0);
}

/// Karat detects a fault in the dark half of a frame whose other half is bright.
#[test]
fn the_dark_half_of_a_bright_frame_is_seen() {
    let scene = |ground: [f32; 3]| {
        let sky = |y: u32| y < 66;
        image(160, 120, |_, y, c| if sky(y) { 1000.0 } else { ground[c as usize] })
    };
    for (right, wrong) in [
        ([1.0; 3], [3.0, 0.0, 0.0]),
        ([0.2; 3], [0.0; 3]),
        ([0.2; 3], [0.4; 3]),
        ([0.2; 3], [0.2, 0.1, 0.2]),
    ] {
        let found = FrameTolerance::default().compare(&scene(right), &scene(wrong), None);
        assert!(found.is_err(), "{right:?} {wrong:?}: {found:?}");
    }
    // A lamp in a dark room.
    let room = |light: f32| {
        let lamp = |x: u32, y: u32| (60..80).contains(&x) && (40..60).contains(&y);
        image(160, 120, move |x, y, _| if lamp(x, y) { 500.0 } else { light })
    };
    let found = FrameTolerance::default().compare(&room(0.0), &room(0.02), None);
    assert!(found.is_err(), "{found:?}");
}

/// Masked pixels change neither the exposures nor the limit below which values count as black.
#[test]
fn masked_pixels_influence_no_metric() {
    let scene = |rest: f32| image(160, 120, |_, y, _| if y < 108 { 1e9 } else { rest });
    let mask = Mask::only(&[Rect::new(0, 108, 160, 12)]);
    for tolerance in [FrameTolerance::gate(1e-3), FrameTolerance::default()] {
        let found = tolerance.compare(&scene(0.05), &scene(5.0), Some(&mask));
        assert!(found.is_err(), "{found:?}");
    }
    let mut unclear = image(160, 120, |_, _, _| 1.0);
    unclear.pixels_mut()[7][0] = f32::NAN;
    let same = scene(0.05);
    let found = FrameTolerance::gate(1e-3).compare(&same, &same, Some(&Mask::image(unclear)));
    assert!(found.is_err(), "{found:?}");
}

/// A wrong hue with the right luminance isn't noise.
#[test]
fn noise_is_judged_in_each_channel() {
    let golden = image(64, 64, |_, _, _| 0.5);
    let red = 0.5 / 0.2126;
    let actual = image(64, 64, |_, _, c| if c == 0 { red } else { 0.0 });
    let variance = image(64, 64, |_, _, _| 1e-4);
    let noise = Noise { golden: &variance, actual: &variance };
    let pair = Pair::new(&golden, &actual).expect("finite");
    assert!(!(noise.measure(&pair).value <= 1.0));
}

#[test]
fn tolerances_without_a_bound_are_errors() {
    let golden = image(16, 16, |_, _, _| 0.5);
    for tolerance in [
        FrameTolerance::All(Vec::new()),
        FrameTolerance::FlipTile(f64::INFINITY),
        FrameTolerance::gate(f32::NAN),
    ] {
        assert!(tolerance.compare(&golden, &golden, None).is_err(), "{tolerance:?}");
    }
}
