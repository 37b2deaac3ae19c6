//! Tests the effect of a depth pre-pass: the fragment function runs once for each pixel, and nothing else changes.

use std::cmp::Reverse;

use frames::{grid, open_paths};
use glam::{DVec2, DVec3, Vec3};
use karat::Path;
use karat::draw::Blend;
use karat::prelude::*;
use karat::{Frame, Image};
use shaders::camera::Camera;
use shaders::{PBR, camera, overdraw, scene};

const SIZE: (u32, u32) = (240, 180);

/// A frame of overlapping spheres, seen from an oblique camera. The farthest sphere is drawn first.
fn oblique(fragment: &str) -> Frame<'static> {
    let aspect = f64::from(SIZE.0) / f64::from(SIZE.1);
    grid("overdraw", fragment, scene::oblique_camera(aspect), SIZE)
}

fn render(frame: &Frame<'_>, path: Path) -> Image {
    frame.render(path).expect("the spheres are drawn")
}

fn counts(frame: Frame<'_>, path: Path) -> Vec<u32> {
    let image = render(&frame.blend(Blend::Add), path);
    let count = |[r, g, b, a]: &[f32; 4]| {
        assert!(r == g && g == b && b == a, "{path} counts differently by channel");
        *r as u32
    };
    image.pixels().iter().map(count).collect()
}

#[test]
fn a_pre_pass_shades_each_pixel_once() {
    for path in open_paths() {
        let plain = counts(oblique("counting_fragment"), path);
        let prepass = counts(oblique("counting_fragment").depth_prepass(), path);
        let most = plain.iter().max().expect("the frame has pixels");
        assert!(*most >= 4, "on {path} spheres hide each other, at most {most} times");
        assert!(plain.iter().zip(&prepass).all(|(plain, once)| *once == (*plain).min(1)), "{path}");
        let shaded: u32 = prepass.iter().sum();
        let drawn: u32 = plain.iter().sum();
        assert!(shaded > 4000 && drawn > shaded + shaded / 2, "on {path}: {shaded} of {drawn}");
    }
}

/// The fragment functions discard fragments or write their depth. If the pre-pass discards the same fragments and
/// writes the same depth, the image doesn't change.
#[test]
fn fragments_that_change_depth_come_out_the_same() {
    for (fragment, depth) in [
        ("cutout_fragment", "cutout_depth_fragment"),
        ("stepped_fragment", "stepped_depth_fragment"),
    ] {
        for path in open_paths() {
            let plain = render(&oblique(fragment), path);
            let prepass = render(&oblique(fragment).depth_prepass().depth_fragment(depth), path);
            assert_eq!(plain.hash(), prepass.hash(), "{fragment} on {path}");
        }
    }
}

/// Shows why a pre-pass must discard the same fragments as the frame. If the pre-pass writes depth also for the holes
/// in spheres, the spheres behind these holes disappear.
#[test]
fn a_pre_pass_without_the_holes_changes_the_image() {
    for path in open_paths() {
        let plain = render(&oblique("cutout_fragment"), path);
        let filled = render(&oblique("cutout_fragment").depth_prepass(), path);
        let differing = plain.pixels().iter().zip(filled.pixels()).filter(|(a, b)| a != b).count();
        assert!(differing > 500, "on {path} {differing} pixels show the fault");
    }
}

/// The test leaves out normals at the edge of a hole, where rounding decides if `fract(4.0 * normal.y)` is below 0.4.
#[test]
fn is_hole() {
    let away = UnitVector.filter(|n: &Vec3| overdraw::from_edge(n.as_dvec3()) > 1e-6);
    PBR.function("overdraw::is_hole")
        .over(away)
        .agrees_with(|normal: DVec3| overdraw::is_hole(normal), Ulp(0.0));
}

/// The shader multiplies and divides only by powers of two, so the result is exact.
#[test]
fn stepped_depth() {
    PBR.function("overdraw::stepped_depth")
        .over(0.0..=1.0)
        .agrees_with(overdraw::stepped_depth, Ulp(0.0));
}

/// The instance's number, which is below 64, and products with 1/2 are exact. Only a sum is rounded.
// Lesson 33
#[test]
fn label() {
    PBR.function("overdraw::label")
        .over((Integers(0..=63_u32), UnitVector))
        .agrees_with(overdraw::label, Abs(6e-8));
}

/// The point at which the ray through a pixel enters a sphere.
struct Hit {
    instance: u32,
    normal: DVec3,
    depth: f64,
}

/// The largest distance between the unit sphere and a facet of its mesh, at the middle of the facet. Facets are 5.6
/// degrees wide in both directions. At the middle of a facet, the mesh's interpolated normal differs from the sphere's
/// normal by a vector whose length is also `FACET`.
const FACET: f64 = 2.5e-3;

/// All hits of the ray through the middle of a pixel. `None` if the ray passes near the rim of a sphere, because the
/// mesh has another outline than the sphere.
fn hits(camera: &Camera, ndc: DVec2) -> Option<Vec<Hit>> {
    let (eye, matrix) = (camera.position.as_dvec3(), camera.view_projection.as_dmat4());
    let direction = camera::view_direction(matrix, ndc).normalize();
    let mut found = Vec::new();
    for instance in 0..scene::SIDE * scene::SIDE {
        let to_centre = scene::sphere_centre(instance) - eye;
        let along = to_centre.dot(direction);
        let miss = (to_centre - along * direction).length();
        if (miss - 1.0).abs() < 0.02 {
            return None;
        }
        if miss < 1.0 {
            let normal = (along - (1.0 - miss * miss).sqrt()) * direction - to_centre;
            let depth = matrix.project_point3(normal + scene::sphere_centre(instance)).z;
            found.push(Hit { instance, normal, depth });
        }
    }
    Some(found)
}

/// The hits of each pixel's ray, row by row from the top left. `None` stands for a ray near the rim of a sphere.
fn rays(camera: &Camera) -> Vec<Option<Vec<Hit>>> {
    let centre = |pixel: u32, size: u32| 2.0 * (f64::from(pixel) + 0.5) / f64::from(size) - 1.0;
    let pixels = (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y)));
    pixels.map(|(x, y)| hits(camera, DVec2::new(centre(x, SIZE.0), -centre(y, SIZE.1)))).collect()
}

/// Checks if a pixel shows the sphere and the normal of a hit. The pixel shows a facet, whose normal differs from the
/// sphere's normal. Near the rim the difference is larger than [`FACET`], but at most 8 times as large, because all
/// rays pass the rim at a distance of at least 0.02.
fn shows(pixel: &[f32; 4], hit: Option<&Hit>) -> bool {
    let Some(hit) = hit else { return pixel[..3] == [0.0; 3] };
    let expected = overdraw::label(hit.instance, hit.normal).to_array();
    let off = |channel: usize| (f64::from(pixel[channel]) - expected[channel]).abs();
    off(0) == 0.0 && off(1).max(off(2)) < 8.0 * FACET && pixel[3] == 1.0
}

/// Checks that each pixel shows the hit that `expected` chooses, which for some pixels isn't the nearest hit. If
/// `expected` returns `None`, the pixel isn't compared.
fn judge(
    fragment: &str,
    camera: &dyn Fn() -> Camera,
    expected: impl Fn(&[Hit]) -> Option<Option<&Hit>>,
) {
    let rays = rays(&camera());
    for path in open_paths() {
        let image = render(&grid("overdraw", fragment, camera(), SIZE), path);
        let (mut judged, mut hidden) = (0, 0);
        for (index, (pixel, hits)) in image.pixels().iter().zip(&rays).enumerate() {
            let Some(hits) = hits else { continue };
            let Some(hit) = expected(hits) else { continue };
            let at = (index as u32 % SIZE.0, index as u32 / SIZE.0);
            assert!(shows(pixel, hit), "{fragment} on {path} at {at:?}: {pixel:?}");
            judged += 1;
            let nearest = hits.iter().min_by(|a, b| a.depth.total_cmp(&b.depth));
            let is_nearest = nearest.map(|near| near.instance) == hit.map(|hit| hit.instance);
            hidden += u32::from(!is_nearest);
        }
        assert!(judged > 15_000 && hidden > 200, "on {path} {judged} judged, {hidden} by the rule");
    }
}

/// Each pixel shows the nearest sphere that has no hole there. The test leaves out pixels near the edge of a hole,
/// where the sphere may have a hole that its facet lacks, or the reverse.
// Lesson 33
#[test]
fn holes_show_the_next_sphere() {
    let camera = || scene::oblique_camera(f64::from(SIZE.0) / f64::from(SIZE.1));
    judge("cutout_fragment", &camera, |hits| {
        let mut near: Vec<&Hit> = hits.iter().collect();
        near.sort_by(|a, b| a.depth.total_cmp(&b.depth));
        for hit in near {
            if overdraw::from_edge(hit.normal) < 8.0 * FACET {
                return None;
            }
            if !overdraw::is_hole(hit.normal) {
                return Some(Some(hit));
            }
        }
        Some(None)
    });
}

/// The fragment function rounds depth to steps, so several spheres may have the same depth in a pixel. The pixel then
/// shows the sphere that is drawn last, which is the farthest from this camera. Facet and sphere differ by up to 1e-3
/// of the depth range. The test leaves out pixels for which this difference decides between two steps.
// Lesson 33
#[test]
fn steps_show_the_last_sphere() {
    let camera = || {
        let setup = camera::Setup {
            position: DVec3::new(-45.0, 3.0, 8.0),
            target: DVec3::ZERO,
            field_of_view: 25_f64.to_radians(),
            depth: [25.0, 65.0],
        };
        setup.camera(f64::from(SIZE.0) / f64::from(SIZE.1))
    };
    judge("stepped_fragment", &camera, |hits| {
        let clear = |hit: &Hit| {
            let above = hit.depth - overdraw::stepped_depth(hit.depth);
            above.min(overdraw::STEP - above) > 1e-3
        };
        if !hits.iter().all(clear) {
            return None;
        }
        let step = |hit: &&Hit| (overdraw::stepped_depth(hit.depth) / overdraw::STEP) as u32;
        Some(hits.iter().min_by_key(|hit| (step(hit), Reverse(hit.instance))))
    });
}
