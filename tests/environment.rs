//! The environment map, supplied as a fixture.

use glam::{DVec3, Vec3};
use karat::prelude::*;
use shaders::{PBR, environment};

/// A texel's colour is rounded to f32 once, or to 11 bits where a path filters half floats only.
const HALF: Rel = Rel(4.9e-4);

#[test]
fn a_constant_environment_is_constant_everywhere() {
    let color = Vec3::new(0.25, 1.0, 3.5);
    PBR.function("environment::radiance")
        .with("environment", CubeMap::constant(color))
        .with("environment_sampler", Sampler::Linear)
        .over(UnitVector)
        .agrees_with(move |_: DVec3| color.as_dvec3(), Ulp(2.0).or(HALF));
}

/// Each face has a colour of its own: a direction well inside a face finds it.
#[test]
fn directions_find_the_face_that_webgpu_says() {
    let size = 4;
    let face_color = |face: usize| [face as f32, 1.0 - face as f32, 0.5, 1.0];
    let texels = (0..6).flat_map(|face| vec![face_color(face); 16]).collect();
    let inside = UnitVector.filter(|d: &Vec3| {
        let mut sizes = d.abs().to_array();
        sizes.sort_by(f32::total_cmp);
        sizes[1] < 0.7 * sizes[2] // the filter reaches half a texel, a quarter of a half face
    });
    PBR.function("environment::radiance")
        .with("environment", CubeMap::from_texels(size, texels))
        .with("environment_sampler", Sampler::Linear)
        .over(inside)
        .agrees_with(
            |d: DVec3| {
                let axis = (0..3).max_by(|a, b| d[*a].abs().total_cmp(&d[*b].abs())).unwrap_or(0);
                let face = 2 * axis + usize::from(d[axis] < 0.0);
                DVec3::from_slice(&face_color(face).map(f64::from))
            },
            Ulp(2.0).or(HALF).or(Abs(1e-6)),
        );
}

/// A direction's own components as colour: the cube map of `karat` and that of the library agree
/// with the hardware's addressing. Between texel centres the map is bilinear, with an error below
/// (1/32)^2 and weights of 8 bits. At the edges of faces wgpu's desktop GL doesn't filter across,
/// but clamps to the nearest texel: half of one, 1/64, times the slope of 1/2.
#[test]
fn directions_find_their_texel() {
    let size = 64;
    let library = environment::cube_map(size, |d| 0.5 * (d.normalize() + DVec3::ONE));
    let own = CubeMap::from_fn(size, |d| 0.5 * (d + Vec3::ONE));
    for cube_map in [CubeMap::from_texels(size, library), own] {
        PBR.function("environment::radiance")
            .with("environment", cube_map)
            .with("environment_sampler", Sampler::Linear)
            .over(UnitVector)
            .agrees_with(|d: DVec3| 0.5 * (d.normalize() + DVec3::ONE), Abs(8e-3));
    }
}
