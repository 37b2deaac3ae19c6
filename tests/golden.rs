//! Compares the frames of the shader library with their goldens.

use frames::{Shot, open_paths};
use karat::Path;
use karat::golden::FrameTolerance;
use karat::{Goldens, Image};

static GOLDEN: Goldens = karat::goldens!("../golden");

/// The tolerance of a frame on GL, where wgpu draws into 16-bit floats. The rounding to 16 bits changes one pixel in a
/// hundred by more than lavapipe's tolerance of 1e-3. GL also doesn't filter across the edges of cube-map faces. The
/// missing filter affects few pixels, but one tolerance applies to all pixels of a frame. Such a wide tolerance proves
/// little about GL. `second_opinion` proves more: it computes pixels of GL's frames again, without filtering across
/// edges, with a tolerance of 1e-2.
fn gl_tolerance(name: &str) -> f32 {
    match name {
        // On higher mip levels a texel, and so the visible edge, is up to a face wide. Measured: 0.34 and 0.44.
        "filtered_diffuse" | "filtered_specular" => 0.6,
        // Walls of different colours meet at the edges of faces. Measured: 0.58.
        "lambert_parallax" => 0.7,
        // A mirror shows the edge of a light at an edge of faces, and levels with faces of 4 texels. Measured: 0.17.
        "specular" | "split_sum" => 0.25,
        // The frame shows the same mirror behind 0.96 of other light. Measured: 0.07.
        "layered" | "masked_layered" => 0.1,
        // Measured: 0.04.
        _ => 5e-2,
    }
}

/// The tolerance of a frame on SwiftShader, which moves drawn surfaces by up to 1/32 of a pixel (`frames::is_snapped`).
/// This shift changes pixels at each outline and in each highlight, so a tolerance for single pixels would have to be
/// very wide. Frames of the spheres have HDR-FLIP errors of up to 0.050 in a tile, with a mean of 0.0057. Faulty
/// shaders cause tiles with errors of 0.09 and more. `second_opinion` proves more about this driver: it computes the
/// values that each pixel can have if surfaces move by up to 1/32 of a pixel.
fn swiftshader_tolerance(name: &str) -> FrameTolerance {
    let gate = || FrameTolerance::gate(karat::unstable::metric::DEFAULT_RELATIVE);
    let flip = |tile, mean| {
        let seen = vec![FrameTolerance::FlipTile(tile), FrameTolerance::FlipMean(mean)];
        FrameTolerance::Any(vec![gate(), FrameTolerance::All(seen)])
    };
    match name {
        // These frames have no outlines.
        "environment" | "irradiance" => gate(),
        // Everything is white, except for the edge of the table at outlines. Measured: 0.081.
        "furnace" => FrameTolerance::gate(0.1),
        // These frames have few outlines. Measured: 0.021 and 0.00074.
        "lambert" | "lambert_parallax" => flip(0.03, 0.001),
        _ => flip(0.06, 0.007),
    }
}

/// Compares a frame with its golden. The first open path computes the frame's maps for all paths, so the comparison on
/// a path tests only the drawing of the frame. Frames such as `irradiance` test the maps.
fn golden(name: &str) {
    let shot = Shot::golden(open_paths()[0]);
    frames::frame(name, &shot)
        .expect("the frame can be described")
        // The tolerance is only the gate. Lavapipe draws the same frame on every machine, and the gate must detect
        // mutants.
        .tolerance(karat::unstable::metric::DEFAULT_RELATIVE)
        .tolerance_on(Path::GL, gl_tolerance(name))
        .tolerance_on("@swiftshader", swiftshader_tolerance(name))
        .matches(&GOLDEN, name);
}

macro_rules! goldens {
    ($($name:ident),* $(,)?) => {
        $(#[test]
        fn $name() {
            golden(stringify!($name));
        })*

        // Lesson 27
        #[test]
        fn every_frame_has_its_golden() {
            let tested = [$(stringify!($name)),*];
            for (name, _) in frames::FRAMES {
                assert!(tested.contains(&name), "frame `{name}` has no test");
            }
            assert_eq!(tested.len(), frames::FRAMES.len());
        }
    };
}

goldens!(
    scene,
    diffuse,
    specular,
    masked_roughness,
    layered,
    masked_layered,
    filtered_diffuse,
    filtered_specular,
    environment,
    irradiance,
    lambert,
    lambert_parallax,
    furnace,
    split_sum,
);

fn small(path: Path) -> Shot {
    Shot::golden(path).sized(160, 90)
}

fn render(name: &str, shot: &Shot) -> Image {
    let frame = frames::frame(name, shot).expect("the frame can be described");
    frame.render(shot.path).expect("the frame is drawn")
}

/// With a depth pre-pass, the frame has the same pixels as without one, to the bit. Drawing the frame again also gives
/// the same bits.
#[test]
fn a_depth_prepass_changes_no_pixel() {
    for path in open_paths() {
        let prepass = render("scene", &small(path));
        let plain = render("scene", &Shot { prepass: false, ..small(path) });
        assert_eq!(plain.hash(), prepass.hash(), "on {path}");
        assert_eq!(prepass.hash(), render("scene", &small(path)).hash());
    }
}

/// The frame `scene` is the sum of the frames `diffuse` and `specular`. On GL each frame is rounded to 16 bits, with a
/// relative error of up to 4.9e-4.
#[test]
fn diffuse_and_specular_add_up_to_the_scene() {
    for path in open_paths() {
        let [both, diffuse, specular] =
            ["scene", "diffuse", "specular"].map(|name| render(name, &small(path)));
        let mut spheres = 0;
        let pixels = both.pixels().iter().zip(diffuse.pixels()).zip(specular.pixels());
        for ((both, diffuse), specular) in pixels.filter(|((_, a), b)| a != b) {
            spheres += 1;
            for channel in 0..3 {
                let sum = diffuse[channel] + specular[channel];
                assert!((both[channel] - sum).abs() <= 1.5e-3 * sum, "on {path}: {both:?}, {sum}");
            }
        }
        assert!(spheres > 4000, "{spheres} pixels show spheres");
    }
}

/// White spheres in white light are nearly invisible. They show only the error of the split sum's table, from which the
/// shader computes the energy that a single reflection loses. This error comes from interpolating between 128 x 128
/// entries, and is largest at the outlines of rough spheres (measured: 0.0084). If a driver snaps vertices, a pixel at
/// an outline may show a point closer to the outline, where the error is larger (measured at the golden's size: 0.08).
#[test]
fn the_spheres_vanish_in_the_furnace() {
    for path in open_paths() {
        let furnace = render("furnace", &Shot::golden(path).sized(240, 135));
        let within = |bound: f32, pixel: &[f32; 4]| {
            pixel[..3].iter().all(|value| (value - 1.0).abs() <= bound)
        };
        let count = |bound| furnace.pixels().iter().filter(|pixel| !within(bound, pixel)).count();
        let most = if frames::is_snapped(path) { 0.1 } else { 1e-2 };
        assert_eq!(count(most), 0, "on {path}");
        assert!(count(1e-6) > 2000, "on {path} {} pixels show spheres", count(1e-6));
    }
}

/// Compares Karis' split sum with the frame `scene`, which samples the environment. Half of the values differ by less
/// than 6 %, and the mean difference is below a tenth of the mean value. The values differ most at grazing angles and
/// for wide lobes.
#[test]
fn the_split_sum_is_near_the_scene() {
    for path in open_paths() {
        let [scene, split] = ["scene", "split_sum"].map(|name| render(name, &small(path)));
        let pairs = scene.pixels().iter().zip(split.pixels()).filter(|(a, b)| a != b);
        let (mut light, mut difference, mut shares) = (0.0, 0.0, Vec::new());
        for (a, b) in pairs.flat_map(|(a, b)| a[..3].iter().zip(&b[..3])) {
            light += a;
            difference += (a - b).abs();
            shares.push((a - b).abs() / a);
        }
        shares.sort_by(f32::total_cmp);
        let median = shares[shares.len() / 2];
        let mean = difference / light;
        assert!(shares.len() > 3 * 4000 && median < 0.06 && mean < 0.1, "{path}: {median}, {mean}");
    }
}
