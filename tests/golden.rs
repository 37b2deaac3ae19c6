//! Frames of the test scene against their goldens.

use karat::prelude::*;
use karat::{Frame, Goldens, Mesh};
use shaders::{PBR, environment, scene};

static GOLDEN: Goldens = karat::goldens!("../golden");

/// Texels along a face: the sun is 10 texels wide.
const ENVIRONMENT: u32 = 128;

/// The 64 spheres under the studio's light, with the environment behind them.
fn scene_in_the_studio(width: u32, height: u32) -> Frame<'static> {
    let studio = environment::cube_map(ENVIRONMENT, environment::studio);
    let (positions, indices) = scene::sphere(32, 64);
    let spheres = scene::SIDE * scene::SIDE;
    PBR.frame("scene", width, height)
        .with("camera", Uniform::new(scene::camera(f64::from(width) / f64::from(height))))
        .with("materials", Storage::new(scene::materials()))
        .with("environment", CubeMap::from_texels(ENVIRONMENT, studio))
        .with("environment_sampler", Sampler::Linear)
        .mesh("vertex", "fragment", Mesh::new(positions, indices), spheres)
        .fullscreen("background_vertex", "background_fragment")
}

/// wgpu's GL draws into 16-bit floats here, which rounds one pixel in a hundred by more than the
/// 1e-3 of lavapipe, and doesn't filter across the edges of cube-map faces: where a mirror shows
/// such an edge inside a light, up to 4 %.
const GL_TOLERANCE: f32 = 5e-2;

/// Diffuse and importance-sampled specular light of the studio on 8 materials x 8 roughnesses.
#[test]
fn scene() {
    // Large enough to tell the materials apart, small enough for a software rasteriser.
    scene_in_the_studio(640, 360)
        .depth_prepass()
        .tolerance_on(Path::Gl, GL_TOLERANCE)
        .matches(&GOLDEN, "scene");
}

/// Depth equality after a pre-pass keeps exactly the fragments that the plain depth test keeps,
/// and drawing again gives the same bits.
#[test]
fn a_depth_prepass_changes_no_pixel() {
    let open = Path::ALL.into_iter().filter(|path| karat::adapter(*path).is_ok());
    let open: Vec<Path> = open.collect();
    assert!(!open.is_empty(), "no execution path opens, so nothing would be checked");
    for path in open {
        let render = |frame: Frame<'_>| frame.render(path).expect("the scene is drawn");
        let plain = render(scene_in_the_studio(160, 90));
        let prepass = render(scene_in_the_studio(160, 90).depth_prepass());
        assert_eq!(plain.hash(), prepass.hash(), "on {path}");
        assert_eq!(prepass.hash(), render(scene_in_the_studio(160, 90).depth_prepass()).hash());
    }
}
