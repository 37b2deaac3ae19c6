//! Checks every frame by a second computation. These tests compute some pixels of each frame again in `f64`, with rays
//! instead of rasterisation, and with the references instead of the shaders. So a golden that passes agrees with the
//! references.
//!
//! The tests compare pixels with two values. The first value comes from the shader's formulas with the same samples, so
//! it differs only by rounding. The second value approximates the integral that the shader estimates, but from many
//! more samples, with other densities. To find the allowed error of the shader's estimate, the tests move the sample
//! points at random and compute the estimate again for each moved copy (Cranley and Patterson 1976).

mod shade;
mod trace;

use frames::{Shot, open_paths};
use glam::{DVec2, DVec3, UVec2};
use karat::Path;
use karat::prelude::*;
use karat::{Goldens, Image};
use rand_core::{Rng, SeedableRng};
use rayon::prelude::*;
use shaders::scene::{self, Painted, Samples};
use shaders::{irradiance, maps, probe_room, sampling};

use shade::{Gather, Light, Surface, compensated, look_up, shade};
use trace::{Hit, Ray, Scene};

static GOLDEN: Goldens = karat::goldens!("../golden");

/// The number of randomly moved copies of the sample points.
const COPIES: usize = 128;

/// The largest allowed error of a pixel, in standard deviations of the moved copies. By chance, only 6 of 10^7 normally
/// distributed values have a larger error, and the tests compare about 200 values for each frame.
const DEVIATIONS: f64 = 5.0;

/// The largest allowed error of a pixel, as a multiple of the largest error of a moved copy. A pixel passes if its
/// error is within this bound or within [`DEVIATIONS`]. For narrow lobes, errors aren't normally distributed: one more
/// sample that reflects the sun brightens a pixel by half, and only one copy in a hundred has such a sample.
const RARE: f64 = 1.5;

/// The allowed relative rounding error of a pixel. The shader adds up to 512 terms in `f32`, its directions have errors
/// of 1e-6, which change the light near the edges of lamps, and goldens are half floats, with an error of 4.9e-4.
const ROUNDING: f64 = 1.5e-3;

/// The allowed relative rounding error on wgpu's GL, where texels and frames are half floats, with an error of 4.9e-4
/// each. Roughness and f0 come from texels, so lobes and their samples also have errors.
const GL_ROUNDING: f64 = 1e-2;

/// The largest distance, in pixels, by which a driver moves surfaces if it snaps vertices (see `frames::is_snapped`).
const SNAPPED: f64 = 1.0 / 32.0;

/// The number of points that tests try along each side of a small square. If a driver snaps vertices, a pixel may show
/// any point in this square around its middle.
const PLACES: i32 = 5;

/// The data from which the tests recompute pixels of a frame that shows the 64 spheres.
struct Spheres {
    scene: Scene,
    painted: Vec<Painted>,
    mask: Texture,
    light: CubeMap,
    /// The split sum's table, if the frame uses it. `first_path` computes the table for the frame and for the test.
    table: Option<Texture>,
    prefiltered: Option<CubeMap>,
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
            table: (furnace || name == "split_sum").then(|| {
                frames::split_sum_table(&Shot::golden(first_path())).expect("the table is drawn")
            }),
            prefiltered: (name == "split_sum").then(|| {
                frames::prefiltered(&Shot::golden(first_path())).expect("the levels are drawn")
            }),
        }
    }

    fn shade(&self, name: &str, surface: &Surface, light: &Light<'_>) -> DVec3 {
        match (&self.table, &self.prefiltered) {
            (Some(table), Some(prefiltered)) => {
                shade::split_sum(surface, light, prefiltered, table)
            }
            (Some(table), None) => compensated(surface, light, table),
            _ => shade(name, surface, light),
        }
    }

    /// The pixels to compute again, with the surfaces that they show: three pixels on each sphere. One of the three
    /// pixels is as near to the sphere's outline as possible.
    fn pixels(&self) -> Vec<((u32, u32), Surface)> {
        let of_sphere = |instance: u32| {
            let angle = f64::from(instance); // another part of the outline for each sphere
            let outline = 0.9999 * DVec2::from_angle(angle);
            [DVec2::new(0.3, 0.2), DVec2::new(-0.75, 0.45), outline].map(|at| {
                // If a corner of the pixel shows the surface, its middle may miss the surface. Further inwards, the
                // middle hits it.
                let inward = (0..32).map(|step| 0.99_f64.powi(step) * at);
                let seen = inward.map(|at| self.shown(instance, at)).find_map(|found| found);
                seen.expect("the camera sees the sphere")
            })
        };
        (0..scene::SIDE * scene::SIDE).flat_map(of_sphere).collect()
    }

    /// The pixel that shows a point of a sphere, and the surface at the middle of this pixel. The point is on the front
    /// of the sphere, and its normal has the X and Y of `at`. `None` if the middle of the pixel doesn't show the
    /// sphere.
    fn shown(&self, instance: u32, at: DVec2) -> Option<((u32, u32), Surface)> {
        let normal = at.extend((1.0 - at.length_squared()).sqrt());
        let pixel = self.scene.pixel_of(scene::sphere_centre(instance) + normal);
        let ray = self.scene.ray(pixel);
        let hit = self.scene.trace(ray).filter(|hit| hit.instance == instance)?;
        let painted = self.painted[instance as usize];
        Some((pixel, Surface::new(painted, &self.mask, hit, ray)))
    }

    /// The smallest and the largest value that a pixel can have if drawn surfaces move by up to [`SNAPPED`] pixels.
    fn snapped(&self, pixel: (u32, u32), shaded: impl Fn(&Surface) -> DVec3) -> (DVec3, DVec3) {
        range(|by| {
            let ray = self.scene.ray_beside(pixel, by);
            self.scene.trace(ray).map_or_else(
                || look_up(&self.light, true, ray.direction, 0.0),
                |hit| {
                    let painted = self.painted[hit.instance as usize];
                    shaded(&Surface::new(painted, &self.mask, hit, ray))
                },
            )
        })
    }

    /// Pixels between spheres, with the directions of their rays.
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

fn seen(image: &Image, (x, y): (u32, u32)) -> DVec3 {
    let [r, g, b, _] = image.pixels()[(y * image.width() + x) as usize];
    DVec3::new(r.into(), g.into(), b.into())
}

/// The path that computes the maps for the frames, as in `golden.rs`.
fn first_path() -> Path {
    open_paths()[0]
}

/// The smallest and the largest result of `value` for points up to [`SNAPPED`] away from the middle of a pixel, with
/// [`PLACES`] points along each side.
fn range(value: impl Fn(DVec2) -> DVec3) -> (DVec3, DVec3) {
    let at = |step: i32| SNAPPED * (2.0 * f64::from(step) / f64::from(PLACES - 1) - 1.0);
    let places = (0..PLACES * PLACES).map(|i| DVec2::new(at(i % PLACES), at(i / PLACES)));
    let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for value in places.map(value) {
        (low, high) = (low.min(value), high.max(value));
    }
    (low, high)
}

/// An image whose pixels the tests compute again.
struct Exhibit {
    /// The path that drew the image. `None` stands for the golden.
    path: Option<Path>,
    image: Image,
}

impl Exhibit {
    /// Checks if the image was drawn with filtering across the edges of cube-map faces, which only wgpu's desktop GL
    /// lacks.
    fn is_seamless(&self) -> bool {
        self.path != Some(Path::GL)
    }

    /// Checks if the driver snaps vertices, so that outlines and interpolated values may move by 1/32 of a pixel.
    fn is_snapped(&self) -> bool {
        self.path.is_some_and(frames::is_snapped)
    }

    /// The allowed rounding error of a pixel, where `value` is the pixel's colour in f64, computed with the same
    /// samples.
    fn rounding(&self, value: DVec3) -> DVec3 {
        let relative = if self.is_seamless() { ROUNDING } else { GL_ROUNDING };
        relative * (value + DVec3::splat(0.01)) // the error of black is that of a hundredth of white
    }
}

/// The golden, and the frame as each open path draws it in the given `size`. `None` draws the frame in the golden's
/// size.
fn exhibits(name: &str, size: Option<(u32, u32)>) -> Vec<Exhibit> {
    let mut exhibits = vec![golden(name)];
    for path in open_paths() {
        // The first path computes the maps, as in `golden.rs`.
        let shot = Shot { size, ..Shot::golden(first_path()) };
        let frame = frames::frame(name, &shot).expect("the frame can be described");
        let image = frame.render(path).expect("the frame is drawn");
        exhibits.push(Exhibit { path: Some(path), image });
    }
    exhibits
}

/// The size in which these tests draw the frames of spheres. A small size saves drawing time, and the tests check the
/// same number of points at any size.
fn size() -> (u32, u32) {
    if frames::are_suites_whole() { (240, 135) } else { (160, 90) }
}

fn golden(name: &str) -> Exhibit {
    let file = GOLDEN.folder().join(format!("{name}.exr"));
    let (image, _) = Image::read_exr(&file).expect("the golden is readable");
    Exhibit { path: None, image }
}

/// Copies of the centred Hammersley set of `count` points. Each copy is moved by its own random vector of the unit
/// square.
fn copies(count: u32) -> Vec<Vec<DVec2>> {
    let copy = |seed| {
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let mut unit = || f64::from(random.next_u32()) / 2_f64.powi(32);
        let by = DVec2::new(unit(), unit());
        (0..count).map(|i| (sampling::hammersley_centred(i, count) + by).fract()).collect()
    };
    (0..COPIES as u64).map(copy).collect()
}

/// The mean and the standard deviation of a pixel's values, one for each copy of the sample points.
fn statistics(values: &[DVec3]) -> (DVec3, DVec3) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<DVec3>() / count;
    let squares: DVec3 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
    (mean, (squares / (count - 1.0)).map(f64::sqrt))
}

/// A complaint if any channel of the pixel has an error above the bound.
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

/// A complaint if any channel of the pixel is outside of the range that snapped vertices allow.
fn snapped_complaint(
    exhibit: &Exhibit,
    pixel: (u32, u32),
    seen: DVec3,
    (low, high): (DVec3, DVec3),
) -> Option<String> {
    // Between the computed points, the value may be slightly lower or higher.
    let between = (high - low) / f64::from(PLACES - 1);
    let (below, above) = (between + exhibit.rounding(low), between + exhibit.rounding(high));
    let good = seen.cmpge(low - below).all() && seen.cmple(high + above).all();
    (!good).then(|| format!("snapped {pixel:?}: {seen}, which isn't in {low} to {high}"))
}

/// Complaints about the pixels of a frame of the 64 spheres. If `whole` is false, the test checks only every third
/// sphere. It compares each pixel with the shader's formula in f64. It also compares a third of the golden's pixels
/// with the integral that the shader estimates, which takes longer.
fn complaints(name: &str, exhibit: &Exhibit, whole: bool) -> Vec<String> {
    let image = &exhibit.image;
    let spheres = Spheres::new(name, (image.width(), image.height()));
    let filtered = name.starts_with("filtered");
    let samples = if filtered { Samples::FILTERED } else { Samples::DEFAULT };
    let (diffuse, specular) = (copies(samples.diffuse), copies(samples.specular));
    let seamless = exhibit.is_seamless();
    let apart = if whole { 1 } else { 3 };
    let pixels: Vec<_> = spheres.pixels().chunks(3).step_by(apart).flatten().copied().collect();
    // Chooses one of the three pixels on each sphere, in turn.
    let asked = |index: usize| index % 3 == index / 3 % 3;
    // These frames don't estimate the integral: the result is blurred, or a product of two integrals.
    let unbiased = !filtered && name != "split_sum";
    let of_sphere = |(index, (pixel, surface)): (usize, &((u32, u32), Surface))| {
        let shaded = |gather| {
            let light = Light { map: &spheres.light, seamless, gather };
            spheres.shade(name, surface, &light)
        };
        let same = if filtered { Gather::Filtered(&samples) } else { Gather::Same(&samples) };
        let (seen, same) = (seen(image, *pixel), shaded(same));
        let allowed = exhibit.rounding(same);
        let mut formula = complaint("formula", *pixel, seen, same, allowed);
        if formula.is_some() && exhibit.is_snapped() {
            let gather =
                || if filtered { Gather::Filtered(&samples) } else { Gather::Same(&samples) };
            let range = spheres.snapped(*pixel, |surface| {
                let light = Light { map: &spheres.light, seamless, gather: gather() };
                spheres.shade(name, surface, &light)
            });
            formula = snapped_complaint(exhibit, *pixel, seen, range);
        }
        let mut found = Vec::from_iter(formula);
        if exhibit.path.is_none() && unbiased && asked(index) {
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
            let bound = rare.max(DEVIATIONS * deviation) + exhibit.rounding(integral);
            found.extend(complaint("integral", *pixel, seen, integral, bound));
        }
        found
    };
    let mut found: Vec<String> = pixels.par_iter().enumerate().flat_map_iter(of_sphere).collect();
    for (pixel, direction) in spheres.gaps() {
        let expected = look_up(&spheres.light, seamless, direction, 0.0);
        found.extend(complaint(
            "gap",
            pixel,
            seen(image, pixel),
            expected,
            exhibit.rounding(expected),
        ));
    }
    found
}

#[track_caller]
fn no_complaints(name: &str, exhibit: &Exhibit, found: &[String]) {
    let source = exhibit.path.map_or_else(|| "the golden".to_owned(), |path| path.to_string());
    assert!(found.is_empty(), "`{name}` of {source}:\n{}", found.join("\n"));
}

#[track_caller]
fn agree(name: &str) {
    for exhibit in exhibits(name, Some(size())) {
        no_complaints(name, &exhibit, &complaints(name, &exhibit, frames::are_suites_whole()));
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
    split_sum,
);

/// Checks pixels of a frame of six faces: `expected` returns the right colour for the direction of a pixel's texel.
fn faces(name: &str, side: u32, expected: impl Fn(bool, DVec3) -> DVec3 + Sync) {
    for exhibit in exhibits(name, None) {
        let (width, height) = (exhibit.image.width(), exhibit.image.height());
        assert_eq!([width, height], [maps::ACROSS * side, maps::DOWN * side]);
        let of_pixel = |index: u32| {
            let pixel = (index % width, index / width);
            let direction = maps::texel_direction(side, UVec2::from(pixel)).normalize();
            let expected = expected(exhibit.is_seamless(), direction);
            let allowed = exhibit.rounding(expected);
            complaint("texel", pixel, seen(&exhibit.image, pixel), expected, allowed)
        };
        let step = match side {
            65.. => 1, // a look-up is fast, an integral is slow
            _ if frames::are_suites_whole() => 7,
            _ => 23,
        };
        let pixels = (0..width * height).into_par_iter().filter(|index| index % step == 0);
        let found: Vec<String> = pixels.filter_map(of_pixel).collect();
        no_complaints(name, &exhibit, &found);
    }
}

#[test]
fn environment() {
    let studio = frames::studio();
    faces("environment", frames::FACE, |seamless, direction| {
        look_up(&studio, seamless, direction, 0.0)
    });
}

#[test]
fn irradiance() {
    let studio = frames::studio();
    faces("irradiance", frames::IRRADIANCE, |seamless, n| {
        irradiance::midpoint(n, 126, 32, |l| look_up(&studio, seamless, l, 0.0))
    });
}

/// The shader computes the irradiance map by a sum over directions. The sum agrees with the integral, which the test
/// computes from all texels of the environment, weighted by their solid angles.
// Lesson 25
// Lesson 46
#[test]
fn the_irradiance_map_holds_the_integral() {
    let studio = frames::studio();
    let frame = golden("irradiance").image;
    for face in 0..6 {
        let (column, row) = (face % maps::ACROSS, face / maps::ACROSS);
        let pixel = (column * frames::IRRADIANCE + 9, row * frames::IRRADIANCE + 21);
        let n = maps::texel_direction(frames::IRRADIANCE, UVec2::from(pixel)).normalize();
        let light = |l: DVec3| look_up(&studio, true, l, 0.0);
        let integral = irradiance::texel_sum(n, frames::ENVIRONMENT, &light);
        // In the sun, whose light falls off over 0.28, a step of 0.05 has a relative error of (0.05 / 0.28)^2 / 24.
        let bound = 2e-3 * integral;
        assert_eq!(complaint("integral", pixel, seen(&frame, pixel), integral, bound), None);
    }
}

/// Compares pixels of spheres in the room with two values: one from the irradiance map, as in the shader, and one from
/// an integral over the room's light. The tolerance for the integral is wider, because the map's faces are only 32
/// texels wide.
fn lambert_objects(name: &str, corrected: bool) {
    let room = frames::room();
    let map = frames::irradiance_cube(&room, first_path()).expect("the map is drawn");
    let shape = probe_room::room();
    let box_of = [shape.corner, shape.opposite].map(|corner| corner.as_dvec3());
    for exhibit in exhibits(name, Some(size())) {
        let (width, height) = (exhibit.image.width(), exhibit.image.height());
        let camera = probe_room::camera_setup().camera(f64::from(width) / f64::from(height));
        let centres = (0..probe_room::SPHERES).map(probe_room::sphere_centre).collect();
        let sphere = frames::sphere();
        let scene = Scene::new(camera, (width, height), sphere, centres, probe_room::RADIUS);
        let direction = |position: DVec3, d: DVec3| {
            let probe = shape.probe.as_dvec3();
            if corrected {
                shaders::environment::parallax_box(position, d, probe, box_of[0], box_of[1])
            } else {
                d
            }
        };
        let seamless = exhibit.is_seamless();
        // The steps are primes that divide neither the width nor the height, so each column has pixels.
        let step = if frames::are_suites_whole() { 29 } else { 89 };
        let of_pixel = |index: u32| {
            let pixel = (index * step % width, index * step / width);
            let (seen, ray) = (seen(&exhibit.image, pixel), scene.ray(pixel));
            let wall = |ray: Ray| {
                let along = direction(ray.origin, ray.direction);
                look_up(&room, seamless, along, 0.0)
            };
            let object = |hit: &Hit| {
                let along = direction(hit.position, hit.normal.normalize());
                (along, probe_room::COLOUR * look_up(&map, seamless, along, 0.0))
            };
            // If the pixel's own ray doesn't explain its value, the ray of a neighbouring pixel may.
            let unexplained = |complaint: Option<String>| match complaint {
                Some(_) if exhibit.is_snapped() => {
                    let range = range(|by| {
                        let ray = scene.ray_beside(pixel, by);
                        scene.trace(ray).map_or_else(|| wall(ray), |hit| object(&hit).1)
                    });
                    snapped_complaint(&exhibit, pixel, seen, range)
                }
                complaint => complaint,
            };
            let mut found = Vec::new();
            if let Some(hit) = scene.trace(ray) {
                let (along, same) = object(&hit);
                let complained = complaint("map", pixel, seen, same, exhibit.rounding(same));
                found.extend(unexplained(complained));
                if exhibit.is_snapped() {
                    return found; // the integral is that of another frame
                }
                let light = |l: DVec3| look_up(&room, true, l, 0.0);
                let irradiance = irradiance::midpoint(along.normalize(), 252, 64, light);
                let integral = probe_room::COLOUR * irradiance;
                let bound = exhibit.rounding(integral) + 1e-2 * integral;
                found.extend(complaint("integral", pixel, seen, integral, bound));
            } else {
                let same = wall(ray);
                let complained = complaint("wall", pixel, seen, same, exhibit.rounding(same));
                found.extend(unexplained(complained));
            }
            found
        };
        let pixels = (0..width * height / step).into_par_iter();
        let found: Vec<String> = pixels.flat_map_iter(of_pixel).collect();
        no_complaints(name, &exhibit, &found);
    }
}

#[test]
fn lambert() {
    lambert_objects("lambert", false);
}

#[test]
fn lambert_parallax() {
    lambert_objects("lambert_parallax", true);
}

fn tampered(name: &str, change: impl Fn(&mut Image)) -> Vec<String> {
    let mut exhibit = golden(name);
    change(&mut exhibit.image);
    complaints(name, &exhibit, true)
}

fn scaled(image: &mut Image, factor: f32) {
    for pixel in image.pixels_mut() {
        *pixel = pixel.map(|value| value * factor);
    }
}

/// A frame with half of the light, as from the lecture's estimator, fails both comparisons: with the formula and with
/// the integral. An error of half a percent fails only the comparison with the formula. NaN fails both.
// Lesson 1: shader side
// Lesson 20
#[test]
fn faults_are_seen() {
    let count = |found: &[String], what: &str| {
        found.iter().filter(|complaint| complaint.starts_with(what)).count()
    };
    let halved = tampered("diffuse", |image| scaled(image, 0.5));
    assert!(count(&halved, "formula") >= 72, "three pixels on each of 24 plastic spheres");
    assert!(count(&halved, "integral") >= 20, "{} pixels", count(&halved, "integral"));
    let brighter = tampered("diffuse", |image| scaled(image, 1.005));
    assert!(count(&brighter, "formula") >= 72);
    let not_a_number = tampered("diffuse", |image| scaled(image, f32::NAN));
    assert_eq!(count(&not_a_number, "formula"), 192);
    assert_eq!(count(&not_a_number, "integral"), 64);
}

/// Some of the pixels that the tests compare are at outlines, where mistakes for grazing angles show.
#[test]
fn some_pixels_graze() {
    let spheres = Spheres::new("scene", size());
    let cosines: Vec<f64> = spheres.pixels().iter().map(|(_, s)| s.n_dot_v()).collect();
    let below = |bound: f64| cosines.iter().filter(|cosine| **cosine < bound).count();
    assert!(below(0.2) >= 10 && below(0.1) >= 2, "{} and {}", below(0.2), below(0.1));
}

/// The comparison detects a frame that is shifted by one pixel, because pixels at edges and on mirrors change.
// Lesson 1: shader side
#[test]
fn a_shifted_pixel_is_seen() {
    let found = tampered("specular", |image| image.pixels_mut().rotate_right(1));
    assert!(found.len() > 30, "{} pixels complain", found.len());
}
