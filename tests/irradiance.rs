//! Tests diffuse light from an environment. All methods are exact for a constant environment. A linear environment and
//! a cosine lobe have closed forms. Other tests compare the methods with each other.

use std::f64::consts::SQRT_2;

use glam::{DVec3, Vec3};
use karat::Path;
use karat::prelude::*;
use shaders::{PBR, irradiance};

use crate::drivers::{SINE, SWIFTSHADER};

/// The error of sampling a smooth environment with radiance near 1.
///
/// A face has 64 x 64 texels, so texels are 1/32 of half a face apart. The error of linear interpolation is at most 1/8
/// of the square of this distance times the curvature. The curvature is at most 2, so this error is at most 2.5e-4.
/// Weights have 8 bits, and neighbouring texels differ by 1/32: the weights' rounding adds 6e-5. On GL, half floats
/// have an error of 2.4e-4 in 1..2. Also on GL, 3 % of directions are within half a texel of a face's edge. Look-ups in
/// these directions read only one face, with an error of 1/64 at the edge. Both errors of GL have either sign, and
/// don't show in a mean.
const INTERPOLATION: f64 = 3e-4;

const SIZE: u32 = 64;

fn in_environment(function: &str, environment: CubeMap) -> karat::check::Probe<'static> {
    PBR.function(function)
        .with("environment", environment)
        .with("environment_sampler", Sampler::LINEAR)
}

/// An environment of radiance 1.
fn furnace(function: &str) -> karat::check::Probe<'static> {
    in_environment(function, CubeMap::constant(Vec3::ONE))
}

/// The mean radiance is 1. Each colour has another gradient of at most 1.
fn sky(d: DVec3) -> DVec3 {
    DVec3::from_array(GRADIENTS.map(|gradient| 1.0 + gradient.dot(d)))
}

const GRADIENTS: [DVec3; 3] =
    [DVec3::new(0.5, 0.0, 0.0), DVec3::new(0.0, 0.6, -0.8), DVec3::new(-0.3, 0.4, 0.5)];

/// The irradiance below the sky, divided by pi.
fn below_sky(n: DVec3) -> DVec3 {
    DVec3::from_array(GRADIENTS.map(|gradient| irradiance::linear(n, 1.0, gradient)))
}

/// A lamp with a cosine fall-off around an axis that isn't near the middle of any face.
fn lamp(d: DVec3) -> DVec3 {
    DVec3::splat(LAMP.dot(d).max(0.0))
}

const LAMP: DVec3 = DVec3::new(0.48, 0.8, -0.36);

fn below_lamp(n: DVec3) -> DVec3 {
    DVec3::splat(irradiance::cosine_lobe(n, LAMP))
}

fn cube_map(radiance: impl Fn(DVec3) -> DVec3) -> CubeMap {
    CubeMap::from_fn(SIZE, |d| radiance(d.as_dvec3()).as_vec3())
}

fn seen(map: &CubeMap) -> impl Fn(DVec3) -> DVec3 {
    move |d| map.sample_level(d, 0.0).truncate()
}

/// If the number of centred points is a power of two, their mean cosine is exactly 1/2. A sum of up to 1024 terms has
/// 1024 roundings.
#[test]
fn a_white_furnace_returns_its_light() {
    furnace("irradiance::estimate")
        .over((UnitVector, OneOf(vec![1, 2, 64, 256, 1024_u32])))
        .cases(4096)
        .agrees_with(|_: DVec3, _: u32| DVec3::ONE, Abs(1e-5));
}

#[test]
fn it_agrees_with_the_estimator_in_its_general_form() {
    furnace("irradiance::estimate")
        .over((UnitVector, Integers(1..=64_u32)))
        .cases(4096)
        .agrees_with(
            |n: DVec3, samples: u32| irradiance::estimate(n, samples, |_| DVec3::ONE),
            Abs(2e-6),
        );
}

/// On each level, the weight is 1, a sum of ones is exact, and a division has 2.5 ulp.
#[test]
fn a_furnace_is_exact_at_every_level() {
    let sizes = OneOf(vec![1, 16, 2048_u32]);
    furnace("irradiance::filtered_estimate")
        .over((UnitVector, Integers(1..=300_u32), sizes))
        .cases(4096)
        .agrees_with(|_: DVec3, _: u32, _: u32| DVec3::ONE, Ulp(4.0));
    let levels = CubeMap::from_fn(16, |_| Vec3::splat(3.0)).with_mips();
    in_environment("irradiance::filtered_estimate", levels)
        .over((UnitVector, Integers(1..=300_u32), Just(16_u32)))
        .cases(4096)
        .agrees_with(|_: DVec3, _: u32, _: u32| DVec3::splat(3.0), Ulp(4.0));
}

/// The result is a quotient of sums of up to 600 terms.
#[test]
fn a_furnace_is_exact_where_weights_are_divided_out() {
    furnace("irradiance::midpoint")
        .over((UnitVector, Integers(1..=40_u32), Integers(1..=40_u32)))
        .cases(1024)
        .agrees_with(|_: DVec3, _: u32, _: u32| DVec3::ONE, Abs(1e-5));
    furnace("irradiance::texel_sum")
        .over((UnitVector, Integers(1..=12_u32)))
        .cases(1024)
        .agrees_with(|_: DVec3, _: u32| DVec3::ONE, Abs(1e-5));
}

/// The result is 1.0014, because the loop's rings cover an angle of 6.3 instead of 2 pi. The sum has 4032 terms, and as
/// many roundings.
// Lesson 22: a tolerance of one path
#[test]
fn the_loop_is_off_by_what_it_says() {
    furnace("irradiance::loop_corrected")
        .over(UnitVector)
        .cases(64)
        // A weight is cos sin, with sqrt(2) times the error of a sine. The 4032 weights, each multiplied by 0.025 0.1 /
        // pi, add up to 3.21.
        .tolerance_on(SWIFTSHADER, Abs(3.21 * SQRT_2 * SINE))
        .agrees_with(|n: DVec3| irradiance::loop_corrected(n, |_| DVec3::ONE), Abs(2e-5));
    furnace("irradiance::loop_corrected")
        .over(UnitVector)
        .cases(64)
        .satisfies("is 1.0014", |_, light: Vec3| (light - 1.0014).abs().max_element() < 5e-5);
}

/// The error of means over at least 64 directions. Weights have 8 bits. The error of the last bit has either sign, and
/// is multiplied by the difference between texels, 1/32.
const WEIGHTS: Abs = Abs(6e-5);

/// The error on GL if all directions within half a texel of an edge (3 %) have an error of 1/64 with equal signs.
const EDGES: Abs = Abs(5e-4);

/// Compares sampled light with sums in f64 over the same directions and cube map. The difference is only the sampler's
/// filter and the rounding of sums.
#[test]
fn they_agree_with_their_twins() {
    let map = cube_map(sky);
    let light = seen(&map);
    in_environment("irradiance::estimate", map.clone())
        .over((UnitVector, Integers(64..=256_u32)))
        .cases(256)
        .tolerance_on(Path::GL, EDGES)
        .agrees_with(|n: DVec3, samples: u32| irradiance::estimate(n, samples, &light), WEIGHTS);
    in_environment("irradiance::loop_corrected", map.clone())
        .over(UnitVector)
        .cases(64)
        .tolerance_on(Path::GL, EDGES)
        .agrees_with(|n: DVec3| irradiance::loop_corrected(n, &light), WEIGHTS);
    in_environment("irradiance::midpoint", map.clone())
        .over((UnitVector, Integers(24..=40_u32), Integers(8..=30_u32)))
        .cases(256)
        .tolerance_on(Path::GL, EDGES)
        .agrees_with(
            |n: DVec3, phi_steps: u32, theta_steps: u32| {
                irradiance::midpoint(n, phi_steps, theta_steps, &light)
            },
            WEIGHTS,
        );
}

/// The test uses few steps, so each step counts. Between texels, two weights of 8 bits have an error in the last bit,
/// which multiplies the difference between texels, 1/32. On GL a step within half a texel of a face's edge has an error
/// of half a texel, 1/64.
// Lesson 32
#[test]
fn few_steps_agree_with_their_twin() {
    let map = cube_map(sky);
    let light = seen(&map);
    in_environment("irradiance::midpoint", map.clone())
        .over((UnitVector, Integers(1..=4_u32), Integers(1..=4_u32)))
        .cases(4096)
        .tolerance_on(Path::GL, Abs(1.6e-2))
        .agrees_with(
            |n: DVec3, phi_steps: u32, theta_steps: u32| {
                irradiance::midpoint(n, phi_steps, theta_steps, &light)
            },
            Abs(1.3e-4),
        );
}

/// The test uses few texels, 6 to 96, so each texel counts. GL has half floats, with an error of up to 4.9e-4 in 1..2.
// Lesson 32
#[test]
fn few_texels_agree_with_their_twin() {
    for size in [1, 2, 4_u32] {
        let map = CubeMap::from_fn(size, |d| sky(d.as_dvec3()).as_vec3());
        in_environment("irradiance::texel_sum", map.clone())
            .over((UnitVector, Just(size)))
            .cases(4096)
            .tolerance_on(Path::GL, Abs(5e-4))
            .agrees_with(|n: DVec3, size: u32| irradiance::texel_sum(n, size, &sky), Abs(2e-6));
        in_environment("irradiance::sh_project", map)
            .over(Just(size))
            .cases(1)
            .tolerance_on(Path::GL, Abs(6e-3))
            .agrees_with(|size: u32| irradiance::sh_project(size, &sky), Abs(2e-5));
    }
}

/// Texel centres are sampled exactly. Sums of 12,288 terms have as many roundings, upwards or downwards.
#[test]
fn texel_sums_agree_with_their_twins() {
    in_environment("irradiance::texel_sum", cube_map(sky))
        .over((UnitVector, Just(SIZE)))
        .cases(64)
        .agrees_with(|n: DVec3, size: u32| irradiance::texel_sum(n, size, &sky), Abs(5e-5));
    // The centre of a coarser texel is the point at which four finer texels meet. On GL, half floats have an error of
    // up to 4.9e-4, so a good sum needs many texels.
    let map = cube_map(sky);
    in_environment("irradiance::sh_project", map.clone())
        .over(OneOf(vec![16, SIZE]))
        .agrees_with(|size: u32| irradiance::sh_project(size, &seen(&map)), Abs(2e-4));
}

/// The coefficients of a light with a part in each of the nine harmonics. The radiance is in 0.7..=1.3, around a mean
/// of 1.
const BANDS: [f64; 9] = [3.544907701811032, 0.1, -0.2, 0.15, 0.18, -0.12, 0.08, 0.13, -0.16];

fn banded(d: DVec3) -> DVec3 {
    let terms = BANDS.iter().zip(irradiance::sh_basis(d));
    DVec3::splat(terms.map(|(coefficient, basis)| coefficient * basis).sum())
}

/// The light has only nine coefficients, so the reference needs no integral.
fn below_bands(n: DVec3) -> DVec3 {
    irradiance::sh_irradiance(BANDS.map(DVec3::splat), n)
}

/// A closed form: from the normal to the irradiance divided by pi.
type Below = fn(DVec3) -> DVec3;

/// Three environments, each with the closed form of its irradiance.
fn environments() -> [(CubeMap, Below); 3] {
    [(cube_map(sky), below_sky), (cube_map(lamp), below_lamp), (cube_map(banded), below_bands)]
}

/// The error of centred Hammersley points is about log N / N, 1.5e-4 for 1024 points, instead of 1 / sqrt N.
#[test]
fn estimates_approach_the_closed_forms() {
    for (map, below) in environments() {
        in_environment("irradiance::estimate", map)
            .over((UnitVector, Just(1024_u32)))
            .cases(256)
            .agrees_with(|n: DVec3, _: u32| below(n), Abs(INTERPOLATION + 2e-4));
    }
}

/// 32 rings are pi/64 apart. The error of a midpoint rule is 1/24 of the square of this distance (1e-4), times the
/// second derivative.
#[test]
fn rings_approach_the_closed_forms() {
    for (map, below) in environments() {
        in_environment("irradiance::midpoint", map)
            .over((UnitVector, Just(64_u32), Just(32_u32)))
            .cases(256)
            .agrees_with(|n: DVec3, _: u32, _: u32| below(n), Abs(INTERPOLATION + 2e-4));
    }
}

/// Without interpolation, the error is that of the midpoint rule for texels 1/32 wide (4e-5 times the second
/// derivative). Rounding adds to it.
#[test]
fn texels_approach_the_closed_forms() {
    for (map, below) in environments() {
        in_environment("irradiance::texel_sum", map)
            .over((UnitVector, Just(SIZE)))
            .cases(64)
            .agrees_with(|n: DVec3, _: u32| below(n), Abs(2e-4));
    }
}

/// The shader projects the light on nine harmonics and evaluates them. The lamp also has higher bands: 0.0052 in all,
/// as the reference's tests compute.
#[test]
fn harmonics_approach_the_closed_forms() {
    let text = "import library::irradiance::{sh_irradiance, sh_project};\n\n\
         fn lit(n: vec3f, size: u32) -> vec3f { return sh_irradiance(sh_project(size), n); }\n";
    let package = Package::from_source("harmonics", text).depends_on("library", &PBR);
    for ((map, below), rest) in environments().into_iter().zip([0.0, 0.0052, 0.0]) {
        package
            .function("lit")
            .with("environment", map)
            .with("environment_sampler", Sampler::LINEAR)
            .over((UnitVector, Just(SIZE)))
            .cases(64)
            .agrees_with(|n: DVec3, _: u32| below(n), Abs(rest + 3e-4));
    }
}

fn filtered(n: DVec3, samples: u32, size: u32, map: &CubeMap) -> DVec3 {
    let light = |d: DVec3, level| map.sample_level(d, level).truncate();
    irradiance::filtered_estimate(n, samples, size, light)
}

/// The colour of each level is the level's number, so the result is the mean level. Most drivers quantise the weight
/// between levels to 8 bits: the error is 1/512, or 4e-3 on a driver that truncates.
#[test]
fn filtered_directions_ask_for_the_right_levels() {
    let levels = (0..7_u16).map(|level| {
        let side = usize::from(64_u16 >> level);
        vec![[f32::from(level); 4]; 6 * side * side]
    });
    let map = CubeMap::from_levels(SIZE, levels.collect());
    in_environment("irradiance::filtered_estimate", map.clone())
        .over((UnitVector, Integers(1..=4096_u32), Just(SIZE)))
        .cases(256)
        .agrees_with(|n: DVec3, k: u32, size: u32| filtered(n, k, size, &map), Abs(4e-3));
}

/// 1024 directions need texels that are 0.08 wide, and 64 directions need texels that are 0.31 wide. A box filter and a
/// tent filter of width w together leave 1 - w^2 / 4 of a gradient: 0.9985 for 1024 directions, and 0.975 for 64. GL
/// leaves a little less, because GL doesn't filter coarse texels across the edges of faces.
#[test]
fn filtered_directions_blur_as_much_as_their_texels() {
    let map = cube_map(sky).with_mips();
    for (samples, blur) in [(1024_u32, 2e-3), (64, 0.03)] {
        in_environment("irradiance::filtered_estimate", map.clone())
            .over((UnitVector, Just(samples), Just(SIZE)))
            .cases(256)
            .agrees_with(|n: DVec3, _: u32, _: u32| below_sky(n), Abs(blur));
    }
}

/// The twin uses the same levels. Fractions of levels have 8 bits, between texels that differ by up to 1/4. GL doesn't
/// filter texels across the edges of faces. On a level of 8 x 8 texels, this gives a quarter of the directions an error
/// of up to 1/8, with either sign.
// Lesson 22: a tolerance of one path
#[test]
fn filtered_directions_agree_with_their_twin() {
    let map = cube_map(sky).with_mips();
    in_environment("irradiance::filtered_estimate", map.clone())
        .over((UnitVector, Integers(256..=1024_u32), Just(SIZE)))
        .cases(256)
        .tolerance_on(Path::GL, Abs(1e-2))
        .agrees_with(|n: DVec3, k: u32, size: u32| filtered(n, k, size, &map), Abs(2e-3));
}

/// A sun of radiance 50 in 0.05 sr adds up to 0.8. Each of 256 directions on the hemisphere stands for 0.025 sr, so
/// one, two or four directions hit the sun.
fn sun(d: DVec3) -> DVec3 {
    DVec3::splat(50.0 * (128.0 * (LAMP.dot(d) - 1.0)).exp())
}

/// Compares filtered and unfiltered estimates with the same number of directions and the same bound, an eighth of the
/// sun. The filter's error is its blur: texels of levels 2 and 3 are half as wide as the sun.
#[test]
fn a_filter_sees_what_lies_between_directions() {
    let map = cube_map(sun).with_mips();
    let above = UnitVector.filter(|n| n.as_dvec3().dot(LAMP) > 0.2);
    let bound = Abs(0.1);
    in_environment("irradiance::filtered_estimate", map.clone())
        .over((&above, Just(256_u32), Just(SIZE)))
        .cases(256)
        .agrees_with(|n: DVec3, _: u32, size: u32| irradiance::texel_sum(n, size, &sun), bound);
    let sharp = in_environment("irradiance::estimate", map)
        .over((&above, Just(256_u32)))
        .cases(256)
        .unrecorded()
        .try_agrees_with(|n: DVec3, _: u32| irradiance::texel_sum(n, SIZE, &sun), bound);
    assert!(matches!(sharp, Err(karat::check::Failure::Disagreement(_))), "{sharp:?}");
}

/// The functions are polynomials of values up to 1, with constants up to 1.1.
#[test]
fn sh_basis() {
    PBR.function("irradiance::sh_basis")
        .over(UnitVector)
        .agrees_with(irradiance::sh_basis, Abs(1e-6));
}

fn coefficients() -> impl Domain<Value = [Vec3; 9]> {
    let colours = || (UnitRgb, UnitRgb, UnitRgb);
    (colours(), colours(), colours()).map(|(a, b, c)| {
        [a.0, a.1, a.2, b.0, b.1, b.2, c.0, c.1, c.2].map(|rgb| 4.0 * rgb - Vec3::splat(2.0))
    })
}

/// The function adds nine products of numbers up to 2 with basis functions up to 1.1.
#[test]
fn sh_irradiance() {
    PBR.function("irradiance::sh_irradiance")
        .over((coefficients(), UnitVector))
        .agrees_with(irradiance::sh_irradiance, Abs(5e-6));
}

/// Direction and density of texels need a quotient and its reciprocal root.
#[test]
fn texels() {
    let indexed = (Integers(1..=104_u32), 0.0..=1.0_f32).map(|(size, share)| {
        let count = 6 * size * size;
        (size, ((share * count as f32) as u32).min(count - 1))
    });
    PBR.function("irradiance::texel_direction")
        .over(indexed)
        .agrees_with(irradiance::texel_direction, Abs(5e-7));
    PBR.function("irradiance::texel_density")
        .over(UnitVector.map(|d| d / d.abs().max_element()))
        .agrees_with(irradiance::texel_density, Ulp(8.0));
}

/// The function computes one product.
#[test]
fn lambert() {
    PBR.function("irradiance::lambert")
        .over((UnitRgb, UnitRgb))
        .agrees_with(irradiance::lambert, Ulp(1.0));
}
