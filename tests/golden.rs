//! Frames of the test scene against their goldens.

use karat::prelude::*;
use karat::{Frame, Goldens, Mesh};
use shaders::{PBR, environment, scene};

static GOLDEN: Goldens = karat::goldens!("../golden");

/// Large enough to tell the materials apart, small enough for a software rasteriser.
const SIZE: (u32, u32) = (640, 360);

/// Texels along a face: the sun is 10 texels wide.
const ENVIRONMENT: u32 = 128;

fn lit_scene(environment: CubeMap) -> Frame<'static> {
    let (width, height) = SIZE;
    let (positions, indices) = scene::sphere(32, 64);
    let spheres = scene::SIDE * scene::SIDE;
    PBR.frame("scene", width, height)
        .with("camera", Uniform::new(scene::camera(f64::from(width) / f64::from(height))))
        .with("materials", Storage::new(scene::materials()))
        .with("environment", environment)
        .with("environment_sampler", Sampler::Linear)
        .mesh("vertex", "fragment", Mesh::new(positions, indices), spheres)
        .fullscreen("background_vertex", "background_fragment")
        .depth_prepass()
}

fn studio() -> CubeMap {
    CubeMap::from_texels(ENVIRONMENT, environment::cube_map(ENVIRONMENT, environment::studio))
}

/// wgpu's GL draws into 16-bit floats here, which rounds one pixel in a hundred by more than the
/// 1e-3 of lavapipe, and doesn't filter across the edges of cube-map faces: where a mirror shows
/// such an edge inside a light, up to 4 %.
const GL_TOLERANCE: f32 = 5e-2;

/// Diffuse and importance-sampled specular light of the studio on 8 materials x 8 roughnesses.
#[test]
fn scene_in_the_studio() {
    lit_scene(studio()).tolerance_on(Path::Gl, GL_TOLERANCE).matches(&GOLDEN, "scene");
}
