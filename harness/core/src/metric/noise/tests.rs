use rand_pcg::Pcg32;
use rand_pcg::rand_core::Rng;
use rayon::prelude::*;

use super::*;
use crate::stats::Rate;

const WIDTH: u32 = 640;
const HEIGHT: u32 = 360;

/// The brightness of a pixel in a test scene with a texture, and spheres with highlights. The brightest pixel has more
/// than 1000 times the light of the darkest one.
fn light(x: u32, y: u32) -> f32 {
    let across = x as f32 / WIDTH as f32;
    let texture = [1.0, 0.3, 0.1, 2.0, 0.05][((x / 5 * 7 + y / 5 * 13) % 5) as usize];
    let floor = 0.02 * 100.0_f32.powf(across) * texture;
    let sphere = |index: u32| {
        let (dx, dy) = (x as f32 - 60.0 - 130.0 * index as f32, y as f32 - 180.0);
        let out = (dx * dx + dy * dy) / (45.0 * 45.0);
        let lit = (0.3 + 0.5 * index as f32) * (1.0 - out).max(0.01).sqrt();
        let highlight = (dx + 15.0).powi(2) + (dy + 15.0).powi(2) < 36.0;
        (out < 1.0).then_some(if highlight { 60.0 } else { lit })
    };
    (0..5).find_map(sphere).unwrap_or(floor)
}

fn expectation(index: u32) -> [f32; 4] {
    let light = light(index % WIDTH, index / WIDTH);
    [light, light, light, 1.0]
}

/// An image with the mean of 64 samples in each pixel, and an image with the variance of this mean. Half of the samples
/// are in shadow, and the brightness of the others is exponentially distributed. So the standard deviation of all
/// samples is 1.7 times their mean.
fn rendered(seed: u64) -> (Image, Image) {
    let sample = |byte: usize| if byte < 128 { 0.0 } else { -((255.5 - byte as f32) / 128.0).ln() };
    let samples: [f32; 256] = std::array::from_fn(sample);
    let mean = samples.iter().sum::<f32>() / 256.0;
    let samples = samples.map(|sample| sample / mean);
    let mut random = Pcg32::new(seed, 7);
    let mut pixel = |index: u32| {
        let (mut sum, mut squares) = (0.0, 0.0);
        for byte in (0..16).flat_map(|_| random.next_u32().to_le_bytes()) {
            let sample = samples[usize::from(byte)];
            sum += sample;
            squares += sample * sample;
        }
        let [light, ..] = expectation(index);
        let mean = sum / 64.0;
        let variance = light * light * ((squares / 64.0 - mean * mean) / 63.0).max(0.0);
        let mean = light * mean;
        ([mean, mean, mean, 1.0], [variance, variance, variance, 0.0])
    };
    let (means, variances) = (0..WIDTH * HEIGHT).map(&mut pixel).unzip();
    (Image::new(WIDTH, HEIGHT, means), Image::new(WIDTH, HEIGHT, variances))
}

/// Makes a square part of the image 5 % brighter. The square covers 2 % of the image. The seed determines the square's
/// position.
fn brighter((mut mean, mut variance): (Image, Image), seed: u64) -> (Image, Image) {
    let mut random = Pcg32::new(seed, 9);
    let (left, top) = (random.next_u32() % (WIDTH - 68), random.next_u32() % (HEIGHT - 68));
    for index in (top..top + 68).flat_map(|y| (left..left + 68).map(move |x| y * WIDTH + x)) {
        let scale = |image: &mut Image, factor: f32| {
            image.pixels_mut()[index as usize][..3].iter_mut().for_each(|v| *v *= factor);
        };
        scale(&mut mean, 1.05);
        scale(&mut variance, 1.05 * 1.05);
    }
    (mean, variance)
}

fn measured(golden: &(Image, Image), actual: &(Image, Image)) -> Measured {
    let pair = Pair::new(&golden.0, &actual.0).expect("finite");
    Noise { golden: &golden.1, actual: &actual.1 }.measure(&pair)
}

/// Tests each pixel separately by its z, with Sidak's correction for the number of pixels. The test passes if at most
/// 0.25 % of the pixels are outliers, as in the test suites of renderers.
fn passes_by_pixels(golden: &(Image, Image), actual: &(Image, Image)) -> bool {
    let critical = normal_critical(sidak(SIGNIFICANCE, u64::from(WIDTH * HEIGHT)));
    let means = golden.0.pixels().iter().zip(actual.0.pixels());
    let variances = golden.1.pixels().iter().zip(actual.1.pixels());
    let off = means.zip(variances).filter(|((a, b), (va, vb))| {
        f64::from((a[0] - b[0]).abs()) > critical * f64::from(va[0] + vb[0]).sqrt()
    });
    off.count() as f64 <= 0.0025 * f64::from(WIDTH * HEIGHT)
}

/// Checks the numbers in the module's documentation, with fewer runs.
// Lesson 46
#[test]
fn noise_alone_passes_and_a_faint_fault_is_seen() {
    const RUNS: u64 = 20;
    let exact = Image::new(WIDTH, HEIGHT, (0..WIDTH * HEIGHT).map(expectation).collect());
    let exact = (exact, Image::new(WIDTH, HEIGHT, vec![[0.0; 4]; (WIDTH * HEIGHT) as usize]));
    let runs = (0..RUNS).into_par_iter().map(|seed| {
        let (golden, actual) = (rendered(2 * seed), rendered(2 * seed + 1));
        let faulty = brighter(actual.clone(), seed);
        let passes = |golden, actual| measured(golden, actual).value <= 1.0;
        [
            !passes(&golden, &actual),
            passes(&golden, &faulty),
            // The golden has many more samples, so its noise differs from the frame's.
            !passes(&exact, &actual),
            !passes_by_pixels(&golden, &faulty),
        ]
    });
    let runs: Vec<[bool; 4]> = runs.collect();
    let rate = |what: usize| {
        let rejected = runs.iter().filter(|run| run[what]).count() as u64;
        Rate { rejected, runs: RUNS }
    };
    let [alarms, missed, alarms_of_exact, seen_by_pixels] = [0, 1, 2, 3].map(rate);
    assert!(alarms.is_within(SIGNIFICANCE), "{alarms:?}");
    assert!(alarms_of_exact.is_within(SIGNIFICANCE), "{alarms_of_exact:?}");
    assert!(missed.is_within(0.01), "{missed:?}");
    assert_eq!(seen_by_pixels.rejected, 0, "a test of single pixels doesn't find the fault");
}

/// If pixels of a pattern change places, the mean of each tile stays the same, so the test of means finds no fault.
// Lesson 46
#[test]
fn pixels_that_changed_places_are_seen() {
    let image = |value: &dyn Fn(u32, u32) -> f32| {
        let pixels = (0..64 * 64).map(|index| value(index % 64, index / 64));
        Image::new(64, 64, pixels.map(|v| [v, v, v, 1.0]).collect())
    };
    let variance = image(&|_, _| 1e-4);
    let stripes = |x: u32| if x.is_multiple_of(2) { 0.1 } else { 0.9 };
    let hash = |x: u32, y: u32| (x.wrapping_mul(73) ^ y.wrapping_mul(191)) % 97;
    let texture = |x: u32, y: u32| 0.1 + 0.8 * hash(x, y) as f32 / 97.0;
    let turned = |x: u32, y: u32| texture(x ^ 15, y ^ 15);
    for (golden, actual) in [
        (image(&|x, _| stripes(x)), image(&|x, _| stripes(x + 1))),
        (image(&texture), image(&turned)),
    ] {
        let found = measured(&(golden, variance.clone()), &(actual, variance.clone()));
        assert!(found.value > 10.0, "{found:?}");
        let note = found.note.expect("the failure has a reason");
        assert_eq!(note, "single pixels differ by more than their noise allows");
    }
}

/// Differences count even between very large or very small floats, and at pixels without neighbours.
#[test]
fn extreme_and_isolated_pixels_count_in_the_noise_metric() {
    let flat = |size: (u32, u32), value: f32| {
        Image::new(size.0, size.1, vec![[value, value, value, 1.0]; (size.0 * size.1) as usize])
    };
    for (size, light, other) in
        [((40, 40), 1e38, 3e38), ((40, 40), 1e-37, 3e-37), ((1, 1), 1.0, 2.0), ((1, 70), 0.0, 1e-3)]
    {
        let still = flat(size, 0.0);
        let measured = measured(&(flat(size, light), still.clone()), &(flat(size, other), still));
        assert!(measured.value == f64::INFINITY && measured.place.is_some(), "{measured:?}");
    }
}

#[test]
fn an_invalid_variance_never_passes() {
    let (golden, actual) = (rendered(1), rendered(2));
    let mut broken = actual.clone();
    broken.1.pixels_mut()[3][1] = f32::NAN;
    let found = measured(&golden, &broken);
    assert!(found.value.is_nan());
    let note = found.note.expect("the failure has a reason");
    assert!(note.starts_with("the variance of the frame is") && note.contains("NaN"), "{note}");
    assert!(note.contains("at (3, 0)"), "{note}");
    broken.1 = Image::new(1, 1, vec![[0.0; 4]]);
    assert!(measured(&golden, &broken).value.is_nan());
    // Without noise, every difference is a fault.
    let still = Image::new(WIDTH, HEIGHT, vec![[0.0; 4]; (WIDTH * HEIGHT) as usize]);
    let found = measured(&(golden.0.clone(), still.clone()), &(actual.0, still.clone()));
    assert_eq!(found.value, f64::INFINITY);
    let mut alpha = golden.clone();
    alpha.0.pixels_mut()[5][3] = 0.5;
    assert_eq!(measured(&golden, &alpha).value, f64::INFINITY);
}
