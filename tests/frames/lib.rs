//! The frames of the shader library: `golden.rs` compares them with the goldens, `second_opinion` computes them again
//! in `f64`, and `karat render` draws them.

use std::error::Error;

use glam::Vec3;
use karat::Frame;
use karat::Path;
use karat::draw::Mesh;
use karat::prelude::*;
use shaders::camera::Camera;
use shaders::maps::{self, MapSettings};
use shaders::scene::{self, Painted, Samples};
use shaders::{PBR, environment, probe_room, specular};

/// Texels along each side of the environment's faces. The sun is 10 texels wide.
pub const ENVIRONMENT: u32 = 128;
/// Texels along each side of the irradiance map's faces.
pub const IRRADIANCE: u32 = 32;
/// Pixels along each side of a face in the frame of the environment.
pub const FACE: u32 = 96;
/// Texels along each side of the split sum's table.
pub const TABLE: u32 = 128;
/// Mip levels of the prefiltered environment. The faces of the last level are 4 texels wide.
pub const PREFILTERED_LEVELS: u32 = 6;
/// The number of sampled normals for each texel of a prefiltered level, and for each texel of the split sum's table.
const PREFILTERED_SAMPLES: u32 = 1024;
/// A sphere's number of bands, from pole to pole, and its number of segments, around the axis. Each facet is 5.6
/// degrees wide.
const SPHERE: (u32, u32) = (32, 64);

/// Checks if long suites run all their cases (`SUITES=whole`), as in `cargo ci full`, or only a sample. The name
/// `SUITES` doesn't begin with `KARAT_`, because the harness reserves such names.
///
/// # Panics
///
/// Panics if `SUITES` is set to another value than `whole`.
#[must_use]
pub fn are_suites_whole() -> bool {
    match std::env::var("SUITES") {
        Ok(value) if value == "whole" => true,
        Ok(value) => panic!("SUITES={value}: it is `whole`, or isn't set"),
        Err(_) => false,
    }
}

/// The name and the description of each frame. The golden has the same name as the frame.
pub const FRAMES: [(&str, &str); 14] = [
    ("scene", "diffuse and specular light of the studio on 8 materials x 8 roughnesses"),
    ("diffuse", "the diffuse term alone: metals are black"),
    ("specular", "the specular term alone, a mirror in the first row"),
    ("masked_roughness", "roughness from a mask texture"),
    ("layered", "a thin shiny coat over everything"),
    ("masked_layered", "the coat over semi-transparent white dots"),
    ("filtered_diffuse", "the diffuse term from 64 samples in higher mip levels"),
    ("filtered_specular", "the specular term from 64 samples in higher mip levels"),
    ("environment", "the six faces of the environment"),
    ("irradiance", "the six faces of its irradiance map"),
    ("lambert", "the article's Lambert object, lit by the irradiance map of a room"),
    ("lambert_parallax", "the same with directions corrected by their place in the room"),
    ("furnace", "white materials in white light, with compensation: the spheres vanish"),
    ("split_sum", "the scene with Karis' split sum in place of the specular estimator"),
];

/// The settings for drawing a frame.
#[derive(Clone, Debug)]
pub struct Shot {
    /// The width and the height of the frame in pixels. `None` uses the frame's own size. Frames of a map, such as
    /// `irradiance`, ignore this setting.
    pub size: Option<(u32, u32)>,
    /// The number of directions that the shader samples for each of a pixel's two terms, diffuse and specular. `None`
    /// uses the frame's own number.
    pub samples: Option<u32>,
    /// The light of the scene, with mip levels. `None` uses the studio.
    pub environment: Option<CubeMap>,
    /// The path that computes the maps for the frame, such as the irradiance map.
    pub path: Path,
    /// `true` draws depth first.
    pub prepass: bool,
}

impl Shot {
    /// The settings with which goldens are drawn. Karat computes the maps for the frame on `path`.
    #[must_use]
    pub fn golden(path: Path) -> Self {
        Self { size: None, samples: None, environment: None, path, prepass: true }
    }

    /// Sets the size of the frame to `width` x `height` pixels.
    #[must_use]
    pub fn sized(self, width: u32, height: u32) -> Self {
        Self { size: Some((width, height)), ..self }
    }

    fn light(&self) -> CubeMap {
        self.environment.clone().unwrap_or_else(studio)
    }

    fn samples(&self, usual: Samples) -> Samples {
        self.samples.map_or(usual, |samples| Samples { diffuse: samples, specular: samples })
    }
}

/// The paths that work on this machine, in the order in which tests use the paths: first one path for each API, then
/// paths from environment variables, such as a path with a second driver.
///
/// # Panics
///
/// Panics if no path opens, because then the tests would check nothing.
#[must_use]
pub fn open_paths() -> Vec<Path> {
    let open = Path::ALL.into_iter().filter(|path| karat::unstable::path::adapter(*path).is_ok());
    let mut open: Vec<Path> = open.collect();
    for path in karat::unstable::path::selected().unwrap_or_default() {
        if !open.contains(&path) {
            open.push(path);
        }
    }
    assert!(!open.is_empty(), "no execution path opens, so nothing would be checked");
    open
}

/// Checks if a driver snaps vertices to 1/16 of a pixel, as SwiftShader does: its `subPixelPrecisionBits` is 4, the
/// smallest number that Vulkan allows. Mesa's drivers have 8 bits. Snapping moves vertices, and with them the
/// interpolated values, by at most 1/32 of a pixel.
///
/// # Panics
///
/// Panics if the path doesn't open.
#[must_use]
pub fn is_snapped(path: Path) -> bool {
    let adapter = karat::unstable::path::adapter(path).expect("a path that is drawn on opens");
    adapter.family() == "swiftshader"
}

/// The studio as a cube map with mip levels.
#[must_use]
pub fn studio() -> CubeMap {
    let texels = environment::cube_map(ENVIRONMENT, environment::studio);
    CubeMap::from_texels(ENVIRONMENT, texels).with_mips()
}

/// The walls of the room in the frame `lambert`, as a cube map seen from the light probe in the room.
#[must_use]
pub fn room() -> CubeMap {
    CubeMap::from_texels(ENVIRONMENT, environment::cube_map(ENVIRONMENT, probe_room::walls))
}

/// The unit sphere that all frames use.
#[must_use]
pub fn sphere() -> (Vec<Vec3>, Vec<u32>) {
    scene::sphere(SPHERE.0, SPHERE.1)
}

/// Builds a frame by its name.
///
/// # Errors
///
/// If no frame has this name, or if drawing one of the frame's maps fails.
pub fn frame(name: &str, shot: &Shot) -> Result<Frame<'static>, Box<dyn Error>> {
    let painted = scene::spheres();
    let usual = Samples::DEFAULT;
    Ok(match name {
        "scene" => spheres(shot, "fragment", &painted, usual, (640, 360)),
        "diffuse" => spheres(shot, "diffuse_fragment", &painted, usual, SMALL),
        "specular" => spheres(shot, "specular_fragment", &painted, usual, SMALL),
        "masked_roughness" => spheres(shot, "masked_roughness_fragment", &painted, usual, SMALL),
        "layered" => spheres(shot, "layered_fragment", &painted, usual, SMALL),
        "masked_layered" => spheres(shot, "masked_layered_fragment", &painted, usual, SMALL),
        "filtered_diffuse" => {
            spheres(shot, "filtered_diffuse_fragment", &painted, Samples::FILTERED, SMALL)
        }
        "filtered_specular" => {
            spheres(shot, "filtered_specular_fragment", &painted, Samples::FILTERED, SMALL)
        }
        "environment" => {
            let settings = MapSettings { side: FACE, samples: 0, alpha: 0.0 };
            map(shot.light(), "environment_fragment", settings)
        }
        "irradiance" => irradiance_map(shot.light()),
        "lambert" => lambert_objects(shot, "fragment", "background_fragment")?,
        "lambert_parallax" => {
            lambert_objects(shot, "corrected_fragment", "corrected_background_fragment")?
                .with("room", Uniform::new(probe_room::room()))
        }
        "furnace" => {
            let white = Shot { environment: Some(CubeMap::constant(Vec3::ONE)), ..shot.clone() };
            spheres(&white, "compensated_fragment", &scene::white_spheres(), usual, SMALL)
                .with("split_sum_table", split_sum_table(shot)?)
        }
        "split_sum" => spheres(shot, "split_sum_fragment", &painted, usual, SMALL)
            .with("prefiltered", prefiltered(shot)?)
            .with("split_sum_table", split_sum_table(shot)?),
        _ => return Err(format!("there is no frame `{name}`").into()),
    })
}

/// The size of most frames, in pixels: large enough to distinguish the materials, and small enough for a software
/// rasteriser.
const SMALL: (u32, u32) = (480, 270);

/// Builds the frame of the 64 spheres in front of their environment, with one of the scene's fragment functions.
fn spheres(
    shot: &Shot,
    fragment: &str,
    painted: &[Painted],
    samples: Samples,
    usual_size: (u32, u32),
) -> Frame<'static> {
    let (width, height) = shot.size.unwrap_or(usual_size);
    let camera = scene::camera(f64::from(width) / f64::from(height));
    let [base_color, surface] = scene::material_maps(painted);
    let samples = shot.samples(samples);
    let mask = match fragment {
        "masked_roughness_fragment" => scene::rings(),
        "masked_layered_fragment" => scene::dots(),
        _ => scene::no_mask(),
    };
    let frame = grid("scene", fragment, camera, (width, height))
        .fact("diffuse samples", samples.diffuse)
        .fact("specular samples", samples.specular)
        .fullscreen("background_vertex", "background_fragment")
        .with("samples", Uniform::new(samples))
        .with("base_color_map", base_color)
        .with("surface_map", surface)
        .with("mask", mask)
        .with("environment", shot.light())
        .with("environment_sampler", Sampler::LINEAR);
    if shot.prepass { frame.depth_prepass() } else { frame }
}

/// Builds a frame of the 64 spheres without a background, with a fragment function of `module`.
pub fn grid(
    module: &str,
    fragment: &str,
    camera: Camera,
    (width, height): (u32, u32),
) -> Frame<'static> {
    let (positions, indices) = sphere();
    let mesh = Mesh::new(positions, indices);
    PBR.frame(module, width, height).with("camera", Uniform::new(camera)).mesh(
        "vertex",
        fragment,
        mesh,
        scene::SIDE * scene::SIDE,
    )
}

/// Builds the frame `lambert` or `lambert_parallax`: five spheres in a room.
fn lambert_objects(
    shot: &Shot,
    fragment: &str,
    background: &str,
) -> Result<Frame<'static>, Box<dyn Error>> {
    let (width, height) = shot.size.unwrap_or(SMALL);
    let room = shot.environment.clone().unwrap_or_else(room);
    let irradiance = irradiance_cube(&room, shot.path)?;
    let (positions, indices) = sphere();
    let aspect = f64::from(width) / f64::from(height);
    Ok(PBR
        .frame("probe_room", width, height)
        .with("camera", Uniform::new(probe_room::camera_setup().camera(aspect)))
        .with("irradiance_map", irradiance)
        .with("environment", room)
        .with("environment_sampler", Sampler::LINEAR)
        .mesh("vertex", fragment, Mesh::new(positions, indices), probe_room::SPHERES)
        .fullscreen("background_vertex", background)
        .depth_prepass())
}

/// Builds the frame of the six faces of a cube map, with a fragment function of the module `maps`.
fn map(light: CubeMap, fragment: &str, settings: MapSettings) -> Frame<'static> {
    let (width, height) = (maps::ACROSS * settings.side, maps::DOWN * settings.side);
    PBR.frame("maps", width, height)
        .with("settings", Uniform::new(settings))
        .with("environment", light)
        .with("environment_sampler", Sampler::LINEAR)
        .fullscreen("vertex", fragment)
}

fn irradiance_map(light: CubeMap) -> Frame<'static> {
    let settings = MapSettings { side: IRRADIANCE, samples: 0, alpha: 0.0 };
    map(light, "irradiance_fragment", settings)
}

/// Computes on `path` the irradiance from `light`, divided by pi, for each normal.
///
/// # Errors
///
/// If drawing the map fails.
pub fn irradiance_cube(light: &CubeMap, path: Path) -> Result<CubeMap, Box<dyn Error>> {
    let faces = irradiance_map(light.clone()).render(path)?;
    Ok(CubeMap::from_faces(&maps::faces(&faces, IRRADIANCE))?)
}

/// The prefiltered environment: each mip level is blurred for a different roughness.
///
/// # Errors
///
/// If drawing a level fails.
pub fn prefiltered(shot: &Shot) -> Result<CubeMap, Box<dyn Error>> {
    let mut levels = Vec::new();
    for level in 0..PREFILTERED_LEVELS {
        let side = ENVIRONMENT >> level;
        let alpha = specular::prefiltered_alpha(f64::from(level), PREFILTERED_LEVELS) as f32;
        let settings = MapSettings { side, samples: PREFILTERED_SAMPLES, alpha };
        let faces = map(shot.light(), "prefiltered_fragment", settings).render(shot.path)?;
        levels.push(maps::faces(&faces, side).iter().flat_map(|f| f.pixels().to_vec()).collect());
    }
    Ok(CubeMap::from_levels(ENVIRONMENT, levels))
}

/// The split sum's table of scale and bias.
///
/// # Errors
///
/// If drawing the table fails.
pub fn split_sum_table(shot: &Shot) -> Result<Texture, Box<dyn Error>> {
    let settings = MapSettings { side: TABLE, samples: PREFILTERED_SAMPLES, alpha: 0.0 };
    let table = PBR
        .frame("maps", TABLE, TABLE)
        .with("settings", Uniform::new(settings))
        .fullscreen("vertex", "split_sum_fragment");
    Ok(Texture::from(&table.render(shot.path)?))
}
