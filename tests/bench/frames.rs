//! Times the comparison of frames of 1920 x 1080 pixels with their goldens, on one thread.

use std::hint::black_box;
use std::time::Instant;

use karat::Image;
use karat::golden::FrameTolerance;
use karat::image::Precision;
use karat::metric::{Flip, Noise};
use karat::unstable::metric::{ExposureRange, Gate, Metric, Pair};

use super::{Spread, spawn};

const WIDTH: u32 = 1920;
const HEIGHT: u32 = 1080;

/// A golden with gradients and edges, and values from 0.1 to 44. In a tenth of the pixels, red and green are 40 times
/// as bright as in the other pixels.
fn golden() -> Image {
    let pixel = |index: u32| {
        let (x, y) = (index % WIDTH, index / WIDTH);
        let light = if (x / 64).is_multiple_of(10) { 40.0 } else { 1.0 };
        let edge = ((x / 24 + y / 24) % 2) as f32;
        let (x, y) = (x as f32 / WIDTH as f32, y as f32 / HEIGHT as f32);
        [light * (0.1 + x), light * (0.1 + y), 0.2 + 0.5 * edge, 1.0]
    };
    Image::new(WIDTH, HEIGHT, (0..WIDTH * HEIGHT).map(pixel).collect())
}

fn scaled(image: &Image, factor: f32) -> Image {
    let mut scaled = image.clone();
    for value in scaled.pixels_mut().iter_mut().flat_map(|pixel| &mut pixel[..3]) {
        *value *= factor;
    }
    scaled
}

/// Adds a black square of 8 x 8 pixels.
fn with_hole(image: &Image) -> Image {
    let mut changed = image.clone();
    for index in (500..508).flat_map(|y| (900..908).map(move |x| y * WIDTH + x)) {
        changed.pixels_mut()[index as usize] = [0.0, 0.0, 0.0, 1.0];
    }
    changed
}

/// Compares a frame that differs from its golden everywhere. The process then reaches its peak memory, with both images
/// and the data of FLIP for all pixels.
pub(super) fn compare_one() {
    let golden = golden();
    let actual = scaled(&golden, 1.01);
    assert!(FrameTolerance::default().compare(&golden, &actual, None).is_err());
}

fn pair<'a>(golden: &'a Image, actual: &'a Image) -> Pair<'a> {
    Pair::new(golden, actual).expect("the images are finite")
}

pub(super) fn run() {
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    one.expect("a thread starts").install(measure);
    let peaks = (0..3).map(|_| spawn("one_frame", &[]).1.parse().expect("a child prints its peak"));
    println!(
        "  peak memory of a frame that differs everywhere [MB]  {}",
        Spread::of(peaks.collect())
    );
}

fn measure() {
    println!(
        "\na frame of 1920 x 1080 against its golden, one thread [ms], and over reading both once"
    );
    let golden = golden();
    let copy = golden.clone();
    let [drifted, brighter] = [1.0001, 1.01].map(|factor| scaled(&golden, factor));
    let hole = with_hole(&golden);
    let exposures = ExposureRange::of(&golden);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let file = folder.path().join("frame.exr");
    golden.write_exr(&file, Precision::Half, None).expect("written");
    let gate = Gate::default();
    let bytes = |image: &Image| image.pixels().len() * 16;
    println!("  images of {} MB, {} exposures", bytes(&golden) >> 20, exposures.count());

    let read = || {
        assert!(
            bytemuck::cast_slice::<_, u8>(golden.pixels())
                == bytemuck::cast_slice::<_, u8>(copy.pixels())
        )
    };
    let equal = || assert!(pair(&golden, &copy).is_identical());
    let passes = || assert!(gate.passes(&pair(&golden, &drifted)).is_some());
    let local = || assert!(gate.passes(&pair(&golden, &hole)).is_none());
    let outliers = || assert!(gate.outliers(&pair(&golden, &brighter)).is_some());
    let cropped = || {
        let pair = pair(&golden, &hole).with_exposures(exposures);
        assert!(Flip::LARGEST_TILE.map(&pair).expect("computed").largest_tile(&pair).0 > 0.01);
    };
    let whole = || {
        let pair = pair(&golden, &hole).with_exposures(exposures);
        assert!(Flip::LARGEST_TILE.whole(&pair).expect("computed").largest_tile(&pair).0 > 0.01);
    };
    // The variance is large enough to explain the drift.
    let variance = Image::new(WIDTH, HEIGHT, vec![[1e-4, 1e-4, 1e-4, 0.0]; golden.pixels().len()]);
    let noise = || {
        let noise = Noise { golden: &variance, actual: &variance };
        assert!(noise.measure(&pair(&golden, &drifted)).value <= 1.0);
    };
    let round = || drop(black_box(golden.rounded_to(Precision::Half)));
    let write = || golden.write_exr(&file, Precision::Half, None).expect("written");
    let reread = || drop(black_box(Image::read_exr(&file).expect("readable")));
    type Task<'a> = (&'a str, &'a dyn Fn(), usize);
    let tasks: [Task<'_>; 11] = [
        ("both images read once", &read, 15),
        ("equal: bits, finiteness", &equal, 15),
        ("drift of 1e-4: the gate passes", &passes, 15),
        ("a hole of 8 x 8: the gate fails", &local, 15),
        ("1 % everywhere: all outliers", &outliers, 15),
        ("FLIP of the hole", &cropped, 9),
        ("FLIP of all pixels", &whole, 3),
        ("noise by tiles", &noise, 5),
        ("rounded to half floats", &round, 9),
        ("EXR written", &write, 3),
        ("EXR read", &reread, 5),
    ];
    for (name, task, repetitions) in tasks {
        task();
        let time = |task: &dyn Fn()| {
            let start = Instant::now();
            task();
            start.elapsed().as_secs_f64() * 1e3
        };
        // The read of a golden is timed beside each task, because the speed of memory depends on other processes.
        let pair = |_| (time(&read), time(task));
        let pairs: Vec<(f64, f64)> = (0..repetitions).map(pair).collect();
        let ratios = Spread::of(pairs.iter().map(|(read, task)| task / read).collect());
        let times = Spread::of(pairs.into_iter().map(|(_, task)| task).collect());
        println!("  {name:<32} {times}   x {ratios}");
    }
}
