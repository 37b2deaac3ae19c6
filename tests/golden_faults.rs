//! Checks that the default tolerance of frames detects faults and accepts harmless changes.
//!
//! The tests plant each fault in a scene that they render on the CPU: spheres with highlights and shadows on a
//! chequered floor, 640 x 360 pixels in HDR, once without noise and once with noise. The tests write a table of the
//! verdicts to `target/karat/golden-faults.md`.

use std::fmt::Write as _;
use std::ops::RangeInclusive;

use glam::DVec3;
use karat::Image;
use karat::golden::FrameTolerance;
use karat::image::Precision;
use karat::metric::{Flip, Noise};
use karat::unstable::golden::FrameCriterion;
use karat::unstable::metric::{DEFAULT_RELATIVE, Gate, Metric, Pair};
use rand_core::Rng;
use rand_pcg::Pcg32;

const WIDTH: u32 = 640;
const HEIGHT: u32 = 360;

/// The scene, with parameters that plant faults.
#[derive(Clone, Copy)]
struct Scene {
    /// A factor for the light that the second sphere reflects, 1 without a fault.
    second: f64,
    /// A factor for highlights, 1 without a fault.
    highlights: f64,
    /// The distance in pixels by which shadows on the floor move to the right.
    shadow: f64,
}

const RIGHT: Scene = Scene { second: 1.0, highlights: 1.0, shadow: 0.0 };

/// Centre and colour of each sphere. The radius is 1.
const SPHERES: [(DVec3, DVec3); 5] = [
    (DVec3::new(-4.6, 1.0, 0.5), DVec3::new(0.7, 0.2, 0.1)),
    (DVec3::new(-2.3, 1.0, -0.6), DVec3::new(0.2, 0.6, 0.2)),
    (DVec3::new(0.0, 1.0, 0.4), DVec3::new(0.7, 0.7, 0.7)),
    (DVec3::new(2.3, 1.0, -0.5), DVec3::new(0.1, 0.2, 0.7)),
    (DVec3::new(4.6, 1.0, 0.6), DVec3::new(0.8, 0.6, 0.1)),
];
const EYE: DVec3 = DVec3::new(0.0, 2.6, 9.0);
const SUN: DVec3 = DVec3::new(0.48, 0.8, 0.36);

/// The distance along a ray to its nearer intersection with a sphere of radius 1.
fn hit(from: DVec3, towards: DVec3, centre: DVec3) -> Option<f64> {
    let to = centre - from;
    let along = to.dot(towards);
    let rest = 1.0 - (to.length_squared() - along * along);
    (rest > 0.0 && along > rest.sqrt()).then(|| along - rest.sqrt())
}

fn lit(at: DVec3) -> bool {
    SPHERES.iter().all(|(centre, _)| hit(at, SUN, *centre).is_none())
}

impl Scene {
    fn light(&self, x: f64, y: f64) -> DVec3 {
        let plane = DVec3::new(x - 320.0, 150.0 - y, -620.0);
        let towards = plane.normalize();
        let spheres = SPHERES.iter().enumerate();
        let hits = spheres.filter_map(|(i, (c, _))| hit(EYE, towards, *c).map(|t| (t, i)));
        let nearest = hits.min_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((distance, index)) = nearest {
            let at = EYE + distance * towards;
            let (centre, colour) = SPHERES[index];
            let normal = at - centre;
            let mirrored = towards - 2.0 * towards.dot(normal) * normal;
            let sun = normal.dot(SUN).max(0.0);
            let highlight = self.highlights * 60.0 * mirrored.dot(SUN).max(0.0).powi(400);
            let light = colour * (3.0 * sun + 0.25 + 0.15 * normal.y) + DVec3::splat(highlight);
            return if index == 1 { self.second * light } else { light };
        }
        if towards.y >= 0.0 {
            return DVec3::new(0.35, 0.55, 1.0) * (0.8 + 0.6 * towards.y);
        }
        let at = EYE - EYE.y / towards.y * towards;
        // The width of a pixel at the distance of the floor.
        let pixel = at.distance(EYE) / plane.length();
        let sun = if lit(at - DVec3::X * self.shadow * pixel) { 3.0 * SUN.y } else { 0.0 };
        let chequer = (at.x.floor() + at.z.floor()).rem_euclid(2.0);
        DVec3::splat((0.25 + 0.3 * chequer) * (sun + 0.3)) / (1.0 + 1e-3 * at.length_squared())
    }

    fn draw(&self) -> Image {
        let pixel = |index: u32| {
            let (x, y) = (f64::from(index % WIDTH), f64::from(index / WIDTH));
            let [r, g, b] = self.light(x + 0.5, y + 0.5).as_vec3().to_array();
            [r, g, b, 1.0]
        };
        Image::new(WIDTH, HEIGHT, (0..WIDTH * HEIGHT).map(pixel).collect())
    }
}

fn scaled(image: &Image, factor: f32) -> Image {
    let pixels = image.pixels().iter().map(|[r, g, b, a]| [r * factor, g * factor, b * factor, *a]);
    Image::new(WIDTH, HEIGHT, pixels.collect())
}

/// Replaces `count` pixels at edges by the pixels to their right. The pixels are evenly spread over all pixels at
/// edges.
fn edges_moved(image: &Image, count: usize) -> Image {
    let bright = |pixel: &[f32; 4]| pixel[0] + pixel[1] + pixel[2];
    let edge = |index: &usize| {
        let (here, beside) = (bright(&image.pixels()[*index]), bright(&image.pixels()[index + 1]));
        index % WIDTH as usize + 1 < WIDTH as usize && here.max(beside) > 2.0 * here.min(beside)
    };
    let edges: Vec<usize> = (0..image.pixels().len() - 1).filter(edge).collect();
    let mut moved = image.clone();
    for index in (0..count).map(|i| edges[(2 * i + 1) * edges.len() / (2 * count)]) {
        moved.pixels_mut()[index] = image.pixels()[index + 1];
    }
    moved
}

fn changed(image: &Image, change: impl Fn(u32, u32, &mut [f32; 4])) -> Image {
    let mut changed = image.clone();
    for (index, pixel) in (0..).zip(changed.pixels_mut()) {
        change(index % WIDTH, index / WIDTH, pixel);
    }
    changed
}

/// Simulates the noise of 64 light samples per pixel: returns the mean of the samples, about 1, and the variance of
/// this mean. Half of the samples are in shadow, so they are 0. The other half have an exponential distribution.
fn noise(seed: u64) -> Vec<[f32; 2]> {
    let sample = |byte: usize| {
        if byte < 128 { 0.0 } else { -2.0 * ((255.5 - byte as f32) / 128.0).ln() }
    };
    let samples: [f32; 256] = std::array::from_fn(sample);
    let mut random = Pcg32::new(seed, 7);
    let mut pixel = |_| {
        let (mut sum, mut squares) = (0.0, 0.0);
        for byte in (0..16).flat_map(|_| random.next_u32().to_le_bytes()) {
            let sample = samples[usize::from(byte)];
            sum += sample;
            squares += sample * sample;
        }
        let mean = sum / 64.0;
        [mean, (squares / 64.0 - mean * mean).max(0.0) / 63.0]
    };
    (0..WIDTH * HEIGHT).map(&mut pixel).collect()
}

/// Returns the image multiplied by the noise, and an image of the variance of each pixel.
fn noisy(image: &Image, noise: &[[f32; 2]]) -> (Image, Image) {
    let pixel = |([r, g, b, a], [mean, variance]): (&[f32; 4], &[f32; 2])| {
        let square = |light: &f32| light * light * variance;
        ([r * mean, g * mean, b * mean, *a], [square(r), square(g), square(b), 0.0])
    };
    let (means, variances) = image.pixels().iter().zip(noise).map(pixel).unzip();
    (Image::new(WIDTH, HEIGHT, means), Image::new(WIDTH, HEIGHT, variances))
}

/// Multiplies each colour value by a random factor in 1 - `amount` to 1 + `amount`.
fn jittered(image: &Image, amount: f32) -> Image {
    let mut random = Pcg32::new(1, 3);
    let mut jittered = image.clone();
    for value in jittered.pixels_mut().iter_mut().flat_map(|pixel| &mut pixel[..3]) {
        *value *= 1.0 + amount * (random.next_u32() as f32 / 2.0_f32.powi(31) - 1.0);
    }
    jittered
}

/// The expected verdict on a change.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Verdict {
    /// The gate accepts the change.
    Gate,
    /// The gate rejects the change, but HDR-FLIP accepts the change.
    Flip,
    /// HDR-FLIP rejects the change on the profile that drew the golden, but accepts the change on other profiles.
    FlipElsewhere,
    /// The gate and HDR-FLIP reject the change on each profile.
    Fault,
}

/// A change, its expected verdict, and the range in which the largest HDR-FLIP error of a tile should be.
struct Row {
    name: &'static str,
    verdict: Verdict,
    tile: RangeInclusive<f64>,
    actual: Image,
}

fn rows(golden: &Image) -> Vec<Row> {
    let row = |name, verdict, tile, actual| Row { name, verdict, tile, actual };
    let hole = |x: u32, y: u32| (300..308).contains(&x) && (300..308).contains(&y);
    let black = |x: u32, y: u32, pixel: &mut [f32; 4]| {
        if hole(x, y) {
            *pixel = [0.0, 0.0, 0.0, 1.0];
        }
    };
    vec![
        row(
            "drift of up to 1e-4, by chance",
            Verdict::Gate,
            3.3e-4..=4.7e-4,
            jittered(golden, 1e-4),
        ),
        row("everything 1e-4 brighter", Verdict::Gate, 1.2e-3..=1.7e-3, scaled(golden, 1.0001)),
        row(
            "rounding to half floats",
            Verdict::Gate,
            3.0e-3..=4.2e-3,
            golden.rounded_to(Precision::Half),
        ),
        row("one pixel of an edge", Verdict::Flip, 4.5e-3..=6.3e-3, edges_moved(golden, 1)),
        row(
            "20 pixels of edges, scattered",
            Verdict::FlipElsewhere,
            0.0175..=0.024,
            edges_moved(golden, 20),
        ),
        row(
            "one sphere 5 % brighter",
            Verdict::Fault,
            0.095..=0.13,
            Scene { second: 1.05, ..RIGHT }.draw(),
        ),
        row(
            "highlights halved",
            Verdict::Fault,
            0.22..=0.3,
            Scene { highlights: 0.5, ..RIGHT }.draw(),
        ),
        row(
            "shadows moved by a pixel",
            Verdict::Fault,
            0.137..=0.185,
            Scene { shadow: 1.0, ..RIGHT }.draw(),
        ),
        row("a hole of 8 x 8 pixels", Verdict::Fault, 0.36..=0.48, changed(golden, black)),
        row("everything 1 % brighter", Verdict::Fault, 0.032..=0.043, scaled(golden, 1.01)),
        row(
            "alpha of one pixel",
            Verdict::Fault,
            f64::INFINITY..=f64::INFINITY,
            changed(golden, |x, y, pixel| {
                if (x, y) == (5, 5) {
                    pixel[3] = 0.9;
                }
            }),
        ),
    ]
}

/// Checks the changes in `rows` with noise in the golden and in the frame. The metric `Noise` knows the variances of
/// both images, so it accepts harmless changes and still rejects faults. The default tolerance, which ignores
/// variances, rejects even the noise.
fn under_noise(rows: &[Row], table: &mut String, complaints: &mut Vec<String>) {
    let golden = &RIGHT.draw();
    let [ours, theirs] = [3, 4].map(noise);
    let (noisy_golden, variance) = noisy(golden, &ours);
    for tolerance in [false, true].map(FrameTolerance::standard) {
        if tolerance.compare(&noisy_golden, &noisy(golden, &theirs).0, None).is_ok() {
            complaints.push(format!("noise passes by {tolerance}"));
        }
    }
    let changes = rows.iter().map(|row| (row.name, row.verdict, &row.actual));
    let no_change = [("another pattern of noise", Verdict::Gate, golden)];
    for (name, verdict, actual) in no_change.into_iter().chain(changes) {
        let (actual, actual_variance) = noisy(actual, &theirs);
        let pair = Pair::new(&noisy_golden, &actual).expect("finite");
        let found = Noise { golden: &variance, actual: &actual_variance }.measure(&pair);
        let passes = found.value <= 1.0;
        let shown = if passes { "Noise" } else { "Fault" };
        writeln!(table, "| {name} | {:.2} | {shown} |", found.value).expect("text");
        if passes == (verdict == Verdict::Fault) {
            complaints.push(format!("{name}, under noise: {shown}, {found:?}"));
        }
    }
}

// Lesson 20
#[test]
fn faults_are_seen_and_benign_changes_pass() {
    let golden = RIGHT.draw();
    let [own, foreign] = [false, true].map(FrameTolerance::standard);
    let mut table = "# Changes of a frame, and the default tolerance\n\n\
        HDR-FLIP errors; a tile may have .01 on the profile of the golden and .03 on others.\n\n\
        | change | pixels off by 1e-3 | largest tile | mean | verdict |\n|---|---|---|---|---|\n"
        .to_owned();
    let mut complaints = Vec::new();
    let rows = rows(&golden);
    for Row { name, verdict, tile, actual } in &rows {
        let pair = Pair::new(&golden, actual).expect("finite");
        // HDR-FLIP is also measured for changes that the gate accepts.
        let (largest, mean) = match Gate::default().passes(&pair) {
            None => {
                let measure = |flip: Flip| flip.measure(&pair).value;
                (measure(Flip::LARGEST_TILE), measure(Flip::MEAN))
            }
            Some(_) => {
                let map = Flip::MEAN.whole(&pair).expect("computed");
                (map.largest_tile(&pair).0, map.mean(&pair))
            }
        };
        let off = Gate::default().outliers(&pair).map_or(0, |outliers| outliers.count);
        let compared = [&own, &foreign].map(|tolerance| tolerance.compare(&golden, actual, None));
        let found = match compared.map(|margin| margin.map(|margin| margin.decided_by)) {
            [Ok(FrameCriterion::Gate), _] => Verdict::Gate,
            [Ok(_), _] => Verdict::Flip,
            [Err(_), Ok(_)] => Verdict::FlipElsewhere,
            [Err(_), Err(_)] => Verdict::Fault,
        };
        writeln!(table, "| {name} | {off} | {largest:.4} | {mean:.5} | {found:?} |").expect("text");
        if found != *verdict || !tile.contains(&largest) {
            complaints
                .push(format!("{name}: {found:?}, {largest}; expected {verdict:?}, {tile:?}"));
        }
    }
    table += "\nThe same with noise of 64 samples in both, judged by their variances: the largest z of a \
        tile over what noise alone has in a frame of a hundred.\n\n\
        | change | z | verdict |\n|---|---|---|\n";
    under_noise(&rows, &mut table, &mut complaints);
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/karat");
    std::fs::create_dir_all(&folder).expect("a folder of build output");
    std::fs::write(folder.join("golden-faults.md"), &table).expect("written");
    println!("{table}");
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
}

/// Without HDR-FLIP, the gate accepts only the smallest changes (`Verdict::Gate`).
#[test]
fn the_gate_alone_sees_all_of_them() {
    let golden = RIGHT.draw();
    for Row { name, verdict, actual, .. } in rows(&golden) {
        let passes = FrameTolerance::gate(1e-3).compare(&golden, &actual, None).is_ok();
        assert_eq!(passes, verdict == Verdict::Gate, "{name}");
    }
}

/// For each golden of this repository, the gate rejects a frame in which one channel of one pixel differs by 0.3 %. The
/// test tries bright and dark pixels, but leaves out nearly black values.
// Lesson 20: the smallest fault that each golden detects
#[test]
fn the_smallest_fault_of_each_golden_is_seen() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../golden");
    let files = std::fs::read_dir(folder).expect("the goldens");
    let files = files.map(|entry| entry.expect("a file").path());
    let mut goldens = 0;
    for file in files.filter(|file| file.extension().is_some_and(|name| name == "exr")) {
        let (golden, _) = Image::read_exr(&file).expect("a golden");
        let floor = 1e-3 * golden.key(); // ten times the value below which the gate treats a pixel as black
        let gate = FrameTolerance::gate(DEFAULT_RELATIVE);
        let mut tried = 0;
        let pixels = golden.pixels().len();
        for index in (0..pixels).step_by(pixels.div_ceil(29)) {
            for channel in 0..4 {
                let value = golden.pixels()[index][channel];
                if value == 0.0 || channel < 3 && value.abs() < floor {
                    continue;
                }
                let mut faulty = golden.clone();
                faulty.pixels_mut()[index][channel] = value * 1.003;
                let found = gate.compare(&golden, &faulty, None);
                assert!(found.is_err(), "{}: pixel {index}, {channel}", file.display());
                tried += 1;
            }
        }
        assert!(tried > 20, "{}: {tried}", file.display());
        goldens += 1;
    }
    assert!(goldens >= 14, "{goldens}");
}
