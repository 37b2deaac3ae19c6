//! A second opinion on every frame: chosen pixels computed again in `f64`, by rays in place of
//! rasterisation and by the references in place of the shaders. A golden that passes is not only
//! as before but right.
//!
//! Two questions are asked of each pixel. Is it what the formulas give for the very same samples?
//! Then only rounding is left. And is it, within the error of the samples, the integral that they
//! estimate? That error is known from the same points moved at random (Cranley and Patterson
//! 1976), and the integral is estimated by other densities.

mod shade;
mod trace;

use frames::Shot;
use glam::{DVec2, DVec3};
use karat::prelude::*;
use karat::{Goldens, Image};
use rand_core::{Rng, SeedableRng};
use rayon::prelude::*;
use shaders::scene::{self, Painted, Samples};
use shaders::{environment, irradiance, maps, probe_room, sampling};

use shade::{Gather, Light, Surface, lambert, shade, split_sum};
use trace::Scene;

static GOLDEN: Goldens = karat::goldens!("../golden");

/// Copies of the sample points, each moved differently.
const COPIES: usize = 128;

/// Standard deviations by which a pixel may be off. Where errors are normal, five are exceeded by
/// chance in 6 of 10^7 cases; a frame has about 600 values.
const DEVIATIONS: f64 = 5.0;

/// The errors of narrow lobes are not normal: one normal more that reflects the sun brightens a
/// pixel by half, and only one copy in a hundred has it. So a pixel may also be off by this many
/// times the largest error of a copy.
const RARE: f64 = 1.5;

/// What `f32` makes of sums of 512 terms and of directions that are off by 1e-6 in front of edges
/// of lights, relative; and where the golden is stored as half floats, 4.9e-4 more.
const ROUNDING: f64 = 1.5e-3;

/// Where the second opinion comes from for a frame of the 64 spheres.
struct Spheres {
    scene: Scene,
    painted: Vec<Painted>,
    mask: Texture,
    light: CubeMap,
}

impl Spheres {
    fn new(name: &str, (width, height): (u32, u32)) -> Self {
        let camera = scene::camera(f64::from(width) / f64::from(height));
        let centres = (0..scene::SIDE * scene::SIDE).map(scene::sphere_centre).collect();
        let furnace = name == "furnace";
        Self {
            scene: Scene::new(camera, (width, height), frames::sphere(), centres, 1.0),
            painted: if furnace { scene::white_spheres() } else { scene::spheres() },
            mask: match name {
                "masked_roughness" => scene::rings(),
                "masked_layered" => scene::dots(),
                _ => scene::no_mask(),
            },
            light: if furnace { CubeMap::constant(glam::Vec3::ONE) } else { frames::studio() },
        }
    }

    /// Pixels to be computed again: three on each sphere, one near its edge, and what they show.
    fn pixels(&self) -> Vec<((u32, u32), Surface)> {
        let toward_camera = [(0.3, 0.2), (-0.75, 0.45), (0.1, -0.8)];
        let of_sphere = |instance: u32| {
            toward_camera.map(|(x, y): (f64, f64)| {
                // The middle of a pixel may miss what its corner shows: further in, it doesn't.
                let inward = (0..8).map(|step| 0.95_f64.powi(step) * DVec2::new(x, y));
                let seen = inward.map(|at| self.shown(instance, at)).find_map(|found| found);
                seen.expect("the camera sees the sphere")
            })
        };
        (0..scene::SIDE * scene::SIDE).flat_map(of_sphere).collect()
    }

    /// The pixel that shows the point of a sphere with this normal, seen from the front, and the
    /// surface there.
    fn shown(&self, instance: u32, at: DVec2) -> Option<((u32, u32), Surface)> {
        let normal = at.extend((1.0 - at.length_squared()).sqrt());
        let pixel = self.scene.pixel_of(scene::sphere_centre(instance) + normal);
        let ray = self.scene.ray(pixel);
        let hit = self.scene.trace(ray).filter(|hit| hit.instance == instance)?;
        let painted = self.painted[instance as usize];
        Some((pixel, Surface::new(painted, &self.mask, hit, ray)))
    }

    /// Pixels between spheres, and their rays.
    fn gaps(&self) -> Vec<((u32, u32), DVec3)> {
        let between = |instance: u32| {
            let right_below = 0.5 * DVec3::new(scene::SPACING.x, -scene::SPACING.y, 0.0);
            let pixel = self.scene.pixel_of(scene::sphere_centre(instance) + right_below);
            let ray = self.scene.ray(pixel);
            assert!(self.scene.trace(ray).is_none(), "the pixel shows the background");
            (pixel, ray.direction)
        };
        (0..scene::SIDE * (scene::SIDE - 1)).step_by(3).map(between).collect()
    }
}

/// A frame's pixel as f64.
fn seen(image: &Image, (x, y): (u32, u32)) -> DVec3 {
    let [r, g, b, _] = image.pixels()[(y * image.width() + x) as usize];
    DVec3::new(r.into(), g.into(), b.into())
}

/// The golden itself, and the frame as each open path draws it, smaller.
fn images(name: &str) -> Vec<(String, Image)> {
    let file = GOLDEN.folder().join(format!("{name}.exr"));
    let mut images = Vec::new();
    if let Ok((golden, _)) = Image::read_exr(&file) {
        images.push(("the golden".to_owned(), golden));
    }
    for path in Path::ALL.into_iter().filter(|path| karat::adapter(*path).is_ok()) {
        let shot = Shot::golden(path).sized(240, 135);
        let frame = frames::frame(name, &shot).expect("the frame can be described");
        images.push((path.to_string(), frame.render(path).expect("the frame is drawn")));
    }
    images
}

/// Copies of the centred Hammersley set of `count` points, each moved by another vector of the
/// unit square.
fn copies(count: u32) -> Vec<Vec<DVec2>> {
    let copy = |seed| {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let mut unit = || f64::from(random.next_u32()) / 2_f64.powi(32);
        let by = DVec2::new(unit(), unit());
        (0..count).map(|i| (sampling::hammersley_centred(i, count) + by).fract()).collect()
    };
    (0..COPIES as u64).map(copy).collect()
}

/// Mean and standard deviation of one copy.
fn statistics(values: &[DVec3]) -> (DVec3, DVec3) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<DVec3>() / count;
    let squares: DVec3 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
    (mean, (squares / (count - 1.0)).map(f64::sqrt))
}

/// What is wrong with a channel, if anything.
fn complaint(
    what: &str,
    pixel: (u32, u32),
    seen: DVec3,
    expected: DVec3,
    bound: DVec3,
) -> Option<String> {
    let error = (seen - expected).abs();
    // NaN is within no bound.
    let good = error.cmple(bound).all();
    (!good).then(|| format!("{what} {pixel:?}: {seen} for {expected}, {bound} allowed"))
}

/// What is asked of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Questions {
    Formula,
    /// And integral, which takes longer.
    Both,
}

/// Complaints about the pixels of a frame of the 64 spheres, by formula and by integral.
fn complaints(name: &str, image: &Image, rounding: f64, questions: Questions) -> Vec<String> {
    let spheres = Spheres::new(name, (image.width(), image.height()));
    let filtered = name.starts_with("filtered");
    let samples = if filtered { Samples::FILTERED } else { Samples::DEFAULT };
    let (diffuse, specular) = (copies(samples.diffuse), copies(samples.specular));
    let light = |gather| Light { map: &spheres.light, gather };
    let rounded = |value: DVec3| rounding * (value + DVec3::splat(0.01));
    let of_sphere = |(pixel, surface): &((u32, u32), Surface)| {
        let gather = if filtered { Gather::Filtered(&samples) } else { Gather::Same(&samples) };
        let (seen, same) = (seen(image, *pixel), shade(name, surface, &light(gather)));
        let mut found = Vec::from_iter(complaint("formula", *pixel, seen, same, rounded(same)));
        if questions == Questions::Both && !filtered {
            let shaded = |gather| shade(name, surface, &light(gather));
            let moved: Vec<_> = diffuse
                .iter()
                .zip(&specular)
                .map(|(diffuse, specular)| shaded(Gather::Moved { diffuse, specular }))
                .collect();
            let independent: Vec<_> =
                specular.iter().map(|points| shaded(Gather::Independent { points })).collect();
            let (center, own) = statistics(&moved);
            let largest = |largest: DVec3, copy: &DVec3| largest.max((copy - center).abs());
            let rare = RARE * moved.iter().fold(DVec3::ZERO, largest);
            let (integral, other) = statistics(&independent);
            let deviation = (own * own + other * other / COPIES as f64).map(f64::sqrt);
            let bound = rare.max(DEVIATIONS * deviation) + rounded(integral);
            found.extend(complaint("integral", *pixel, seen, integral, bound));
        }
        found
    };
    let mut found: Vec<String> = spheres.pixels().par_iter().flat_map_iter(of_sphere).collect();
    for (pixel, direction) in spheres.gaps() {
        let expected = spheres.light.sample_level(direction, 0.0).truncate();
        found.extend(complaint("gap", pixel, seen(image, pixel), expected, rounded(expected)));
    }
    found
}

/// wgpu's GL stores texels and frames as half floats and doesn't filter across faces: see
/// `golden.rs`.
fn rounding_on(source: &str) -> f64 {
    if source == Path::Gl.to_string() { 5e-2 } else { ROUNDING }
}

#[track_caller]
fn agree(name: &str) {
    for (index, (source, image)) in images(name).into_iter().enumerate() {
        let questions = if index == 0 { Questions::Both } else { Questions::Formula };
        let found = complaints(name, &image, rounding_on(&source), questions);
        assert!(found.is_empty(), "{name} of {source}:\n{}", found.join("\n"));
    }
}

macro_rules! second_opinions {
    ($($name:ident),* $(,)?) => {$(
        #[test]
        fn $name() {
            agree(stringify!($name));
        }
    )*};
}

second_opinions!(
    scene,
    diffuse,
    specular,
    masked_roughness,
    layered,
    masked_layered,
    filtered_diffuse,
    filtered_specular,
    furnace,
);
