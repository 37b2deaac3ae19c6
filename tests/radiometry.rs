//! Tests functions for quantities of light, such as irradiance, against the definitions of these quantities.

use std::f64::consts::PI;

use karat::Path;
use karat::check::{Agreement, Failure};
use karat::prelude::*;
use karat::unstable::probe::Probed;
use shaders::{PBR, radiometry};

/// The tolerance for results near 0, because WGSL may flush results below the smallest normal f32 to 0.
const UNDERFLOW: Abs = Abs(1e-30);

/// Light of any strength, up to 1e9 W/(m^2 sr), which is more than the sun's radiance.
const LIGHT: std::ops::RangeInclusive<f32> = 0.0..=1e9;

/// Cosines that are large enough to divide by them.
const COSINE: std::ops::RangeInclusive<f32> = 1e-4..=1.0;

/// Distances from a millimetre to ten kilometres.
const DISTANCE: std::ops::RangeInclusive<f32> = 1e-3..=1e4;

/// Solid angles up to the hemisphere.
const SOLID_ANGLE: std::ops::RangeInclusive<f32> = 1e-8..=std::f32::consts::TAU;

/// A package with the module `wgsl`, which imports `functions` of the library. Tests use it to combine several
/// functions.
fn calling(functions: &str, wgsl: &str) -> Package {
    let text = format!("import pbr::radiometry::{{{functions}}};\n{wgsl}");
    Package::from_source("calling", text).depends_on("pbr", &PBR)
}

#[track_caller]
fn holds(result: Result<Agreement, Failure>) {
    if let Err(failure) = result {
        panic!("{failure}");
    }
}

/// The function computes one product with a rounded constant.
#[test]
fn intensity_from_flux() {
    PBR.function("radiometry::intensity_from_flux")
        .over(LIGHT)
        .agrees_with(radiometry::intensity_from_flux, Ulp(2.0));
}

/// The function computes a product and two divisions, each with an error of 2.5 ulp.
#[test]
fn irradiance_from_intensity() {
    PBR.function("radiometry::irradiance_from_intensity")
        .over((LIGHT, 0.0..=1.0, DISTANCE))
        .agrees_with(radiometry::irradiance_from_intensity, Ulp(6.0).or(UNDERFLOW));
}

/// At twice the distance, four times the intensity gives the same irradiance. The factors are powers of two, so both
/// results are equal to the bit. The test leaves out intensities below 1e-20, for which WGSL may flush one of the two
/// results to 0.
#[test]
fn irradiance_falls_with_the_square_of_the_distance() {
    let light = LIGHT.filter(|light: &f32| *light == 0.0 || *light >= 1e-20);
    PBR.function("radiometry::irradiance_from_intensity")
        .over((light, COSINE, DISTANCE))
        .invariant_under(
            |(intensity, cosine, distance)| (4.0 * intensity, cosine, 2.0 * distance),
            Ulp(0.0),
        );
}

#[test]
fn irradiance_from_radiance() {
    PBR.function("radiometry::irradiance_from_radiance")
        .over((LIGHT, SOLID_ANGLE, 0.0..=1.0))
        .agrees_with(radiometry::irradiance_from_radiance, Ulp(2.0).or(UNDERFLOW));
}

/// The function computes two divisions, each with an error of 2.5 ulp.
#[test]
fn radiance_from_irradiance() {
    PBR.function("radiometry::radiance_from_irradiance")
        .over((LIGHT, SOLID_ANGLE, COSINE))
        .agrees_with(radiometry::radiance_from_irradiance, Ulp(6.0).or(UNDERFLOW));
}

/// The series for the sine has an error of 3 ulp, so its square has an error of 6 ulp. Three products add 2 ulp.
#[test]
fn irradiance_from_cap() {
    PBR.function("radiometry::irradiance_from_cap")
        .over((LIGHT, 0.0..=std::f32::consts::FRAC_PI_2))
        .agrees_with(radiometry::irradiance_from_cap, Ulp(9.0).or(UNDERFLOW));
}

/// The function computes three products and two divisions, each with an error of 2.5 ulp. WGSL may flush the first
/// product, area times cosine, to 0 if it is below 1.2e-38. At a distance of a millimetre and a radiance of 1e9, this
/// changes the result by up to 1.2e-23.
#[test]
fn irradiance_from_patch() {
    PBR.function("radiometry::irradiance_from_patch")
        .over((LIGHT, 0.0..=1e4, 0.0..=1.0, 0.0..=1.0, DISTANCE))
        .agrees_with(radiometry::irradiance_from_patch, Ulp(8.0).or(Abs(1.2e-23)));
    PBR.function("radiometry::patch_solid_angle")
        .over((0.0..=1e4, 0.0..=1.0, DISTANCE))
        .agrees_with(radiometry::patch_solid_angle, Ulp(6.0).or(UNDERFLOW));
}

#[test]
fn lambert() {
    PBR.function("radiometry::lambert_radiosity")
        .over((0.0..=1.0, LIGHT))
        .agrees_with(radiometry::lambert_radiosity, Ulp(1.0).or(UNDERFLOW));
    PBR.function("radiometry::lambert_radiance")
        .over((0.0..=1.0, LIGHT))
        .agrees_with(radiometry::lambert_radiance, Ulp(3.0).or(UNDERFLOW));
}

#[test]
fn mirror_brdf() {
    PBR.function("radiometry::mirror_brdf")
        .over((COSINE, SOLID_ANGLE))
        .agrees_with(radiometry::mirror_brdf, Ulp(6.0));
}

#[test]
fn conserves_energy() {
    PBR.function("radiometry::conserves_energy")
        .over(0.0..=2.0)
        .agrees_with(radiometry::conserves_energy, Ulp(0.0));
}

/// Halving the angle is exact. The series for the sine has an error of 3 ulp, so its square has an error of 6 ulp. Two
/// products add 2 ulp.
#[test]
fn cap_solid_angle() {
    PBR.function("radiometry::cap_solid_angle")
        .over(0.0..=std::f32::consts::PI)
        .agrees_with(radiometry::cap_solid_angle, Ulp(9.0).or(UNDERFLOW));
}

/// Each series consists of nested sums, such as `1 - x2 / 6 * (1 - x2 / 20 * (...))`. The outer sums lose 2 ulp. The
/// errors of the inner divisions hardly reach the result.
#[test]
fn series_of_sine_and_arctangent() {
    PBR.function("radiometry::sine")
        .over(0.0..=std::f32::consts::FRAC_PI_2)
        .agrees_with(f64::sin, Ulp(4.0));
    PBR.function("radiometry::arctangent").over(0.0..=0.172).agrees_with(f64::atan, Ulp(3.0));
}

/// Texels of cube maps: the width of the faces in texels, up to `most`, and the column and the row of the texel.
fn texels(most: u32) -> impl Domain<Value = (u32, u32, u32)> {
    let place = (Integers(1..=most), 0.0..=1.0_f32, 0.0..=1.0_f32);
    place.map(|(size, column, row)| {
        let texel = |share: f32| ((share * size as f32) as u32).min(size - 1);
        (size, texel(column), texel(row))
    })
}

/// The function computes three square roots, each with an error of 4.5 ulp, a division, and the squared width of the
/// texel, with an error of 5 ulp. The relative error of the divisor is at most two thirds of the sum of the roots'
/// errors. The coordinates of the texel's corners are rounded, too. Nothing cancels, even for small texels.
#[test]
fn texel_solid_angle() {
    PBR.function("radiometry::texel_solid_angle")
        .over(texels(4096))
        .agrees_with(radiometry::texel_solid_angle, Ulp(16.0));
}

/// Two texels at symmetric places of a face have the same solid angle. The shader cuts each texel into two triangles,
/// and the two results differ only because the diagonals of the cuts differ.
#[test]
fn texels_are_symmetric() {
    let size_texels = || texels(4096).filter(|(size, _, _)| *size > 1);
    PBR.function("radiometry::texel_solid_angle")
        .over(size_texels())
        .invariant_under(|(size, column, row)| (size, size - 1 - column, row), Ulp(16.0));
    PBR.function("radiometry::texel_solid_angle")
        .over(size_texels())
        .invariant_under(|(size, column, row)| (size, row, column), Ulp(16.0));
}

/// For each size, the solid angles of all texels of the six faces add up to 4 pi, with a relative error below 1e-6. The
/// test adds them in f64.
#[test]
fn the_texels_of_a_cube_cover_the_sphere() {
    let probed =
        Probed::new(&PBR, "radiometry::texel_solid_angle").expect("the function can be probed");
    let open: Vec<Path> = Path::ALL
        .into_iter()
        .filter(|path| karat::unstable::path::adapter(*path).is_ok())
        .collect();
    assert!(!open.is_empty(), "no execution path opens");
    for path in open {
        for size in 1..=64_u32 {
            let texels: Vec<Vec<u32>> =
                (0..size * size).map(|index| vec![size, index % size, index / size]).collect();
            let results = karat::unstable::executor::call(&probed, path, &texels, &Vec::new())
                .expect("the kernel runs");
            let face: f64 = results.iter().map(|lanes| f64::from(f32::from_bits(lanes[0]))).sum();
            let sphere = 6.0 * face / (4.0 * PI);
            assert!((sphere - 1.0).abs() < 1e-6, "{path}, {size}: {sphere} of the sphere");
        }
    }
}

/// If the texels of a cube map stand for all directions, the sum of intensity times solid angle is the flux. The sum
/// has up to 144 terms, and each addition rounds up or down by at most half an ulp. The solid angles also have errors.
#[test]
fn isotropic_intensity_integrates_to_the_flux() {
    let package = calling(
        "intensity_from_flux, texel_solid_angle",
        "fn flux(flux: f32, size: u32) -> f32 {
            var sum = 0.0;
            for (var i = 0u; i < size * size; i++) {
                let solid_angle = texel_solid_angle(size, i % size, i / size);
                sum += 6.0 * intensity_from_flux(flux) * solid_angle;
            }
            return sum;
        }",
    );
    let flux = package.function("flux").over((LIGHT, Integers(1..=12_u32)));
    holds(flux.unrecorded().try_agrees_with(|flux: f64, _: u32| flux, Ulp(32.0).or(UNDERFLOW)));
}

/// Computes the irradiance from a patch at any distance. Dividing by the patch's solid angle and the receiver's cosine
/// gives the radiance at the receiver. This radiance equals the radiance that leaves the patch. The shader computes six
/// divisions.
#[test]
fn radiance_along_a_ray_is_constant() {
    let package = calling(
        "irradiance_from_patch, patch_solid_angle, radiance_from_irradiance",
        "fn seen(radiance: f32, area: f32, cos_e: f32, cos_r: f32, distance: f32) -> f32 {
            let irradiance = irradiance_from_patch(radiance, area, cos_e, cos_r, distance);
            let solid_angle = patch_solid_angle(area, cos_e, distance);
            return radiance_from_irradiance(irradiance, solid_angle, cos_r);
        }",
    );
    let rays = || package.function("seen").over((LIGHT, 1e-4..=1.0, COSINE, COSINE, DISTANCE));
    let radiance = |radiance: f64, _: f64, _: f64, _: f64, _: f64| radiance;
    holds(rays().unrecorded().try_agrees_with(radiance, Ulp(10.0).or(UNDERFLOW)));
    holds(rays().unrecorded().try_invariant_under(
        |(l, a, e, r, distance)| (l, a, e, r, 2.0 * distance),
        Ulp(0.0).or(UNDERFLOW),
    ));
}

/// A mirror reflects the incoming radiance unchanged, for any solid angle of the light.
#[test]
fn a_mirror_keeps_the_radiance() {
    let package = calling(
        "irradiance_from_radiance, mirror_brdf",
        "fn reflected(radiance: f32, n_dot_l: f32, solid_angle: f32) -> f32 {
            let irradiance = irradiance_from_radiance(radiance, solid_angle, n_dot_l);
            return mirror_brdf(n_dot_l, solid_angle) * irradiance;
        }",
    );
    let rays = package.function("reflected").over((LIGHT, COSINE, SOLID_ANGLE));
    holds(
        rays.unrecorded()
            .try_agrees_with(|radiance: f64, _: f64, _: f64| radiance, Ulp(9.0).or(UNDERFLOW)),
    );
}

/// A white Lambertian under a uniform sky is as bright as the sky.
#[test]
fn a_white_lambertian_vanishes_in_the_sky() {
    let package = calling(
        "irradiance_from_cap, lambert_radiance",
        "fn white(sky: f32) -> f32 {
            return lambert_radiance(1.0, irradiance_from_cap(sky, 1.57079632679));
        }",
    );
    holds(
        package
            .function("white")
            .over(LIGHT)
            .unrecorded()
            .try_agrees_with(|sky: f64| sky, Ulp(8.0)),
    );
}
