//! Tests maps that are computed once and then looked up.

use frames::open_paths;
use glam::{UVec2, Vec3};
use karat::Path;
use karat::prelude::*;
use shaders::maps::MapSettings;
use shaders::{PBR, maps, specular};

/// For each pixel of a frame with six faces, the direction has the errors of one division and of `face_direction`.
#[test]
fn texel_direction() {
    let pixels =
        (OneOf(vec![1, 2, 7, 32, 96_u32]), 0.0..=1.0_f32, 0.0..=1.0_f32).map(|(side, x, y)| {
            let pixel = |share: f32, faces: u32| {
                ((share * (faces * side) as f32) as u32).min(faces * side - 1)
            };
            (side, UVec2::new(pixel(x, maps::ACROSS), pixel(y, maps::DOWN)))
        });
    PBR.function("maps::texel_direction")
        .over(pixels)
        .agrees_with(|side: u32, pixel: UVec2| maps::texel_direction(side, pixel), Abs(5e-7));
}

/// A frame of six faces becomes a cube map in which each direction finds the texel that was drawn for that direction.
#[test]
fn faces_become_the_cube_map_that_they_show() {
    let side = 16;
    let color = |d: Vec3| 0.5 * (d.normalize() + Vec3::ONE);
    let pixels = (0..maps::DOWN * side)
        .flat_map(|y| (0..maps::ACROSS * side).map(move |x| UVec2::new(x, y)))
        .map(|pixel| color(maps::texel_direction(side, pixel).as_vec3()).extend(1.0).to_array());
    let frame = karat::Image::new(maps::ACROSS * side, maps::DOWN * side, pixels.collect());
    let cube = CubeMap::from_faces(&maps::faces(&frame, side)).expect("six squares");
    let own = CubeMap::from_fn(side, color);
    let texels = |cube: &CubeMap| cube.texels(0).expect("a first level").concat();
    for (found, expected) in texels(&cube).into_iter().zip(texels(&own)) {
        // The first cube map's directions are rounded before they are normalised. The directions of the second cube map
        // are rounded afterwards.
        assert!((found - expected).abs() <= 1e-6, "{found} for {expected}");
    }
}

/// Each texel of the table has the scale and the bias for its centre in red and green, and again in blue and alpha. As
/// in `specular.rs`, V.H has a rounding error of 1e-7, and the shader divides V.H by N.V, which is at least 1/32. On GL
/// the frame has half floats, and a driver may cut off bits, which gives an error of 2^-11 for values in 1/2..1.
// Lesson 33
#[test]
fn split_sum_fragment() {
    const SIDE: u32 = 16;
    const SAMPLES: u32 = 64;
    for path in open_paths() {
        let settings = MapSettings { side: SIDE, samples: SAMPLES, alpha: 0.0 };
        let table = PBR
            .frame("maps", SIDE, SIDE)
            .with("settings", Uniform::new(settings))
            .fullscreen("vertex", "split_sum_fragment")
            .render(path)
            .expect("the table is drawn");
        let tolerance = if path == Path::GL { 2e-5 + 0.5_f64.powi(11) } else { 2e-5 };
        let centre = |texel: usize| (texel as f64 + 0.5) / f64::from(SIDE);
        for (index, [r, g, b, a]) in table.pixels().iter().copied().enumerate() {
            let (column, row) = (index % SIDE as usize, index / SIDE as usize);
            let expected = specular::split_sum_table(centre(row), centre(column), SAMPLES);
            let off = (f64::from(r) - expected.x).abs().max((f64::from(g) - expected.y).abs());
            assert!(
                off <= tolerance,
                "on {path}, row {row}, column {column}: {r}, {g} for {expected}"
            );
            assert!(r == b && g == a, "on {path}, row {row}, column {column}: {b}, {a}");
        }
    }
}
