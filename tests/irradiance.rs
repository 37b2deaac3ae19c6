//! Tests diffuse light from an environment. For a constant environment, most methods of the shaders are exact. For a
//! linear environment and a cosine lobe, the tests know the exact result. Other tests compare the shaders with
//! references that use the same directions.

use std::f64::consts::SQRT_2;

use glam::{DVec3, Vec3};
use karat::Path;
use karat::prelude::*;
use shaders::{PBR, irradiance};

use crate::drivers::{SINE, SWIFTSHADER};

/// The error of looking up a smooth environment with radiance near 1.
///
/// A face reaches from -1 to 1 and has 64 x 64 texels, so neighbouring texels are 1/32 apart. Linear interpolation has
/// an error of at most 1/8 of the squared distance times the curvature. The curvature is at most 2, so this error is at
/// most 2.5e-4. The filter's weights have 8 bits, and neighbouring texels differ by 1/32, so rounding the weights adds
/// an error of 6e-5. On GL, texels are half floats, with a mean error of 2.4e-4 for values in 1..2. Also on GL, 3 % of
/// directions are within half a texel of a face's edge. There, the filter reads only one face, with an error of 1/64 at
/// the edge. GL's errors may be positive or negative, so they nearly vanish in a mean.
const INTERPOLATION: f64 = 3e-4;

const SIZE: u32 = 64;

fn in_environment(function: &str, environment: CubeMap) -> karat::check::Probe<'static> {
    PBR.function(function)
        .with("environment", environment)
        .with("environment_sampler", Sampler::LINEAR)
}

/// Calls `function` in an environment of radiance 1.
fn furnace(function: &str) -> karat::check::Probe<'static> {
    in_environment(function, CubeMap::constant(Vec3::ONE))
}

/// A linear environment with a mean radiance of 1. Each colour channel has its own gradient, of at most 1.
fn sky(d: DVec3) -> DVec3 {
    DVec3::from_array(GRADIENTS.map(|gradient| 1.0 + gradient.dot(d)))
}

const GRADIENTS: [DVec3; 3] =
    [DVec3::new(0.5, 0.0, 0.0), DVec3::new(0.0, 0.6, -0.8), DVec3::new(-0.3, 0.4, 0.5)];

/// The exact irradiance from `sky` for a normal, divided by pi.
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

/// If the number of sampled directions is a power of two, the mean of their cosines is exactly 1/2. So the only error
/// is the rounding of a sum of up to 1024 terms.
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

/// On each mip level, all directions have the weight 1, so the sum is exact. Only the division by the number of
/// directions has an error, of 2.5 ulp.
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

/// The shaders divide by the sum of the weights. So the result is exact, except for the rounding of sums of up to 1600
/// terms.
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

/// The result is 1.0014, because the loop's rings cover an angle of 6.3 instead of 2 pi. The sum has 4032 terms, and
/// each addition is rounded.
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

/// The error of a mean over at least 64 directions, from the filter's weights of 8 bits. The error of a colour is the
/// rounding error of a weight, positive or negative, times the difference between texels, 1/32.
const WEIGHTS: Abs = Abs(6e-5);

/// The error of a mean on GL, where 3 % of the directions are within half a texel of an edge and have an error of up to
/// 1/64. The bound assumes that these errors all have the same sign.
const EDGES: Abs = Abs(5e-4);

/// Compares each shader with a reference in f64 that uses the same directions and the same cube map. Differences come
/// only from the filter of the sampler and the rounding of sums.
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

/// Uses few steps, so that an error in any single step shows. The filter has two weights of 8 bits. Rounding both
/// weights changes the colour by up to 2 * 1/512 times the difference between texels, 1/32. On GL a direction within
/// half a texel of a face's edge has an error of up to half a texel, 1/64.
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

/// Uses few texels, 6 to 96, so that an error in any single texel shows. On GL texels are half floats, with an error of
/// up to 4.9e-4 for values in 1..2.
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

/// The shader reads the cube map at texel centres, where the filter has no error. The sum has up to 24,576 terms, and
/// each addition is rounded up or down.
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

/// The nine coefficients of a light that consists of spherical harmonics up to band 2. Its radiance is around 1.
const BANDS: [f64; 9] = [3.544907701811032, 0.1, -0.2, 0.15, 0.18, -0.12, 0.08, 0.13, -0.16];

fn banded(d: DVec3) -> DVec3 {
    let terms = BANDS.iter().zip(irradiance::sh_basis(d));
    DVec3::splat(terms.map(|(coefficient, basis)| coefficient * basis).sum())
}

/// The exact irradiance from `banded`, divided by pi. `banded` has only nine coefficients, so its irradiance needs no
/// integral.
fn below_bands(n: DVec3) -> DVec3 {
    irradiance::sh_irradiance(BANDS.map(DVec3::splat), n)
}

/// A closed formula that returns the irradiance for a normal, divided by pi.
type Below = fn(DVec3) -> DVec3;

/// Three environments, each with the closed formula of its irradiance.
fn environments() -> [(CubeMap, Below); 3] {
    [(cube_map(sky), below_sky), (cube_map(lamp), below_lamp), (cube_map(banded), below_bands)]
}

/// With N Hammersley points, the error falls as log N / N, not as 1 / sqrt N. For 1024 points, the error is about
/// 1.5e-4.
#[test]
fn estimates_approach_the_closed_forms() {
    for (map, below) in environments() {
        in_environment("irradiance::estimate", map)
            .over((UnitVector, Just(1024_u32)))
            .cases(256)
            .agrees_with(|n: DVec3, _: u32| below(n), Abs(INTERPOLATION + 2e-4));
    }
}

/// The 32 rings of directions are pi/64 apart. A midpoint rule has an error of 1/24 of the squared distance, 1e-4,
/// times the second derivative.
#[test]
fn rings_approach_the_closed_forms() {
    for (map, below) in environments() {
        in_environment("irradiance::midpoint", map)
            .over((UnitVector, Just(64_u32), Just(32_u32)))
            .cases(256)
            .agrees_with(|n: DVec3, _: u32, _: u32| below(n), Abs(INTERPOLATION + 2e-4));
    }
}

/// The filter doesn't interpolate at texel centres. The sum over texels is a midpoint rule with a step of 1/32, so the
/// error is 4e-5 times the second derivative, plus rounding.
#[test]
fn texels_approach_the_closed_forms() {
    for (map, below) in environments() {
        in_environment("irradiance::texel_sum", map)
            .over((UnitVector, Just(SIZE)))
            .cases(64)
            .agrees_with(|n: DVec3, _: u32| below(n), Abs(2e-4));
    }
}

/// The shader approximates the light by nine spherical harmonics. `lamp` also contains higher harmonics, which change
/// its irradiance by up to 0.0052.
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

/// Each mip level has its own number as its colour, so the result is the mean of the levels that the shader reads. Most
/// drivers quantise the weight between levels to 8 bits: the error is 1/512, or 4e-3 on a driver that truncates.
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

/// With 1024 directions, the shader reads texels that are 0.08 wide, and with 64 directions, texels that are 0.31 wide.
/// Averaging and interpolating texels of width w multiplies a gradient by 1 - w^2 / 4: by 0.9985 for 1024 directions,
/// and by 0.975 for 64 directions. On GL the gradient is a little smaller, because GL doesn't filter coarse texels
/// across the edges of faces.
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

/// The reference reads the same mip levels as the shader. Drivers round the weight between two levels to 8 bits, and
/// the texels of the levels differ by up to 1/4. GL doesn't filter texels across the edges of faces. On a level of 8 x
/// 8 texels, a quarter of the directions are near an edge and have a positive or negative error of up to 1/8.
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

/// A sun with a radiance of 50 in 0.05 sr, so that its irradiance divided by pi is up to 0.8. If a shader samples 256
/// directions, each direction stands for 0.025 sr, so only one, two or four directions hit the sun.
fn sun(d: DVec3) -> DVec3 {
    DVec3::splat(50.0 * (128.0 * (LAMP.dot(d) - 1.0)).exp())
}

/// With 256 directions, the filtered estimate has an error of at most 0.1, which is an eighth of the sun's light. The
/// unfiltered estimate has larger errors. The filtered estimate blurs the sun a little: it reads levels 2 and 3, with
/// texels half as wide as the sun.
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

/// The basis functions are polynomials of coordinates up to 1, with coefficients up to 1.1.
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

/// The function adds nine products of a coefficient up to 2 and a basis function up to 1.1.
#[test]
fn sh_irradiance() {
    PBR.function("irradiance::sh_irradiance")
        .over((coefficients(), UnitVector))
        .agrees_with(irradiance::sh_irradiance, Abs(5e-6));
}

/// `texel_direction` computes a quotient, and `texel_density` a reciprocal square root and a quotient.
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
