//! Rust counterpart of `radiometry.wgsl`: quantities of light in textbook form.
//!
//! Units: flux in W, intensity in W/sr, irradiance and radiosity in W/m^2, radiance in W/(m^2 sr), BRDFs in 1/sr,
//! lengths in m, angles in rad, and solid angles in sr. Cosines are in 0..=1.

use std::f64::consts::{FRAC_PI_2, PI};

/// Computes dPhi / dw of an isotropic source: Phi divided by the sphere's 4 pi.
#[must_use]
pub fn intensity_from_flux(flux: f64) -> f64 {
    flux / (4.0 * PI)
}

/// Computes the irradiance by the inverse square law: E = I cos / r^2, for r > 0.
#[must_use]
pub fn irradiance_from_intensity(intensity: f64, cos_theta: f64, distance: f64) -> f64 {
    intensity * cos_theta / distance.powi(2)
}

/// Computes dE from the definition of radiance: L cos dw.
#[must_use]
pub fn irradiance_from_radiance(radiance: f64, solid_angle: f64, cos_theta: f64) -> f64 {
    radiance * solid_angle * cos_theta
}

/// Computes the radiance by its definition: dE / (cos dw), for a cosine and a solid angle above 0.
#[must_use]
pub fn radiance_from_irradiance(irradiance: f64, solid_angle: f64, cos_theta: f64) -> f64 {
    irradiance / (solid_angle * cos_theta)
}

/// Computes the integral of L cos over a cap around the normal: pi L (1 - cos(2 half_angle)) / 2.
///
/// `half_angle` is in 0..=pi/2. The function computes 1 - cos(2 half_angle) without cancellation.
#[must_use]
pub fn irradiance_from_cap(radiance: f64, half_angle: f64) -> f64 {
    PI * radiance * versine(2.0 * half_angle) / 2.0
}

/// Computes the irradiance from a small patch: L A cos_e cos_r / r^2, for r > 0.
#[must_use]
pub fn irradiance_from_patch(
    radiance: f64,
    area: f64,
    cos_emitter: f64,
    cos_receiver: f64,
    distance: f64,
) -> f64 {
    radiance * area * cos_emitter * cos_receiver / distance.powi(2)
}

/// Computes the radiosity: the albedo times the irradiance.
#[must_use]
pub fn lambert_radiosity(albedo: f64, irradiance: f64) -> f64 {
    albedo * irradiance
}

/// Computes the radiance (albedo / pi) E.
#[must_use]
pub fn lambert_radiance(albedo: f64, irradiance: f64) -> f64 {
    albedo / PI * irradiance
}

/// Computes the BRDF of a mirror, delta / cos, for light from a small solid angle dw, over which delta is 1 / dw.
#[must_use]
pub fn mirror_brdf(n_dot_l: f64, solid_angle: f64) -> f64 {
    (solid_angle * n_dot_l).recip()
}

/// Checks that a surface doesn't create energy: its albedo, the integral of f cos, is at most 1. The albedo of a white
/// surface is exactly 1.
#[must_use]
pub fn conserves_energy(directional_albedo: f64) -> bool {
    directional_albedo <= 1.0
}

/// Computes the solid angle of a cap, 2 pi (1 - cos half_angle), for `half_angle` in 0..=pi.
#[must_use]
pub fn cap_solid_angle(half_angle: f64) -> f64 {
    2.0 * PI * versine(half_angle)
}

/// Computes the solid angle of a patch, A cos / r^2, for r > 0.
#[must_use]
pub fn patch_solid_angle(area: f64, cos_emitter: f64, distance: f64) -> f64 {
    area * cos_emitter / distance.powi(2)
}

/// Computes the solid angle of a cube map's texel by its closed form. The part of the face z = 1 between the origin and
/// (x, y) has the solid angle atan(x y / sqrt(x^2 + y^2 + 1)). The solid angle of a texel is the second difference of
/// this arctangent.
///
/// The function subtracts arctangents of up to 0.52, so digits cancel. If a face is 4096 texels wide, a texel has about
/// 2e-7 sr, and 8 digits of the result are right.
#[must_use]
pub fn texel_solid_angle(size: u32, column: u32, row: u32) -> f64 {
    let edge = |texel: u32| 2.0 * f64::from(texel) / f64::from(size) - 1.0;
    let corner = |x: f64, y: f64| (x * y / (x * x + y * y + 1.0).sqrt()).atan();
    let (left, right, top, bottom) = (edge(column), edge(column + 1), edge(row), edge(row + 1));
    corner(right, bottom) - corner(left, bottom) - corner(right, top) + corner(left, top)
}

/// Computes 1 - cos. Up to a right angle, the function computes sin^2 / (1 + cos), which loses no digits for small
/// angles.
fn versine(angle: f64) -> f64 {
    let (sin, cos) = angle.sin_cos();
    if angle < FRAC_PI_2 { sin * sin / (1.0 + cos) } else { 1.0 - cos }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The integral of `f` over 0..=`end`, by the midpoint rule.
    fn integrate(end: f64, f: impl Fn(f64) -> f64) -> f64 {
        const N: i32 = 20_000;
        let step = end / f64::from(N);
        (0..N).map(|i| f((f64::from(i) + 0.5) * step) * step).sum()
    }

    #[test]
    fn all_directions_together_carry_the_flux() {
        let intensity = intensity_from_flux(60.0);
        let flux = integrate(PI, |theta| intensity * 2.0 * PI * theta.sin());
        assert!((flux / 60.0 - 1.0).abs() < 1e-8);
        assert!((intensity * cap_solid_angle(PI) / 60.0 - 1.0).abs() < 1e-15);
    }

    #[test]
    fn all_of_a_sphere_around_a_point_catches_the_flux() {
        for radius in [0.1, 1.0, 30.0] {
            let irradiance = irradiance_from_intensity(intensity_from_flux(60.0), 1.0, radius);
            assert!((irradiance * 4.0 * PI * radius * radius / 60.0 - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn caps_are_integrals() {
        for half_angle in [1e-3, 0.1, 1.0, 1.5] {
            let area = integrate(half_angle, |theta| 2.0 * PI * theta.sin());
            assert!((cap_solid_angle(half_angle) / area - 1.0).abs() < 1e-8, "{half_angle}");
            let projected = integrate(half_angle, |theta| 2.0 * PI * theta.sin() * theta.cos());
            let irradiance = irradiance_from_cap(1.0, half_angle);
            assert!((irradiance / projected - 1.0).abs() < 1e-8, "{half_angle}");
        }
        assert!((cap_solid_angle(FRAC_PI_2) - 2.0 * PI).abs() < 1e-15);
        assert!((irradiance_from_cap(1.0, FRAC_PI_2) - PI).abs() < 1e-15);
        // Small caps are flat: their solid angle is pi theta^2.
        assert!((cap_solid_angle(1e-8) / (PI * 1e-16) - 1.0).abs() < 1e-14);
    }

    #[test]
    fn a_lambertian_sends_its_radiosity() {
        // The radiance is equal in all directions of the hemisphere.
        let radiance = lambert_radiance(0.8, 5.0);
        let radiosity = integrate(FRAC_PI_2, |t| radiance * t.cos() * 2.0 * PI * t.sin());
        assert!((radiosity - lambert_radiosity(0.8, 5.0)).abs() < 1e-7);
    }

    #[test]
    fn radiance_along_a_ray_is_constant() {
        for distance in [0.5, 10.0, 300.0] {
            let irradiance = irradiance_from_patch(7.0, 1e-4, 0.3, 0.6, distance);
            let solid_angle = patch_solid_angle(1e-4, 0.3, distance);
            let radiance = radiance_from_irradiance(irradiance, solid_angle, 0.6);
            assert!((radiance - 7.0).abs() < 1e-14, "{distance}");
            let back = irradiance_from_radiance(radiance, solid_angle, 0.6);
            assert!((back / irradiance - 1.0).abs() < 1e-14, "{distance}");
        }
    }

    #[test]
    fn a_small_patch_is_a_small_cap() {
        let radius: f64 = 1e-4;
        let patch = irradiance_from_patch(1.0, PI * radius.powi(2), 1.0, 1.0, 1.0);
        assert!((patch / irradiance_from_cap(1.0, radius.atan()) - 1.0).abs() < 1e-7);
    }

    #[test]
    fn a_mirror_returns_the_radiance() {
        for (n_dot_l, solid_angle) in [(1.0, 1.0), (0.3, 6.8e-5), (1e-3, 1e-6)] {
            let irradiance = irradiance_from_radiance(3.0, solid_angle, n_dot_l);
            assert!((mirror_brdf(n_dot_l, solid_angle) * irradiance - 3.0).abs() < 1e-14);
        }
    }

    #[test]
    fn white_conserves_energy() {
        assert!(conserves_energy(0.0) && conserves_energy(1.0));
        assert!(!conserves_energy(1.0 + f64::EPSILON) && !conserves_energy(f64::NAN));
    }

    #[test]
    fn the_texels_of_a_cube_cover_the_sphere() {
        for size in 1..=64 {
            let face: f64 = (0..size * size)
                .map(|index| texel_solid_angle(size, index % size, index / size))
                .sum();
            assert!((6.0 * face / (4.0 * PI) - 1.0).abs() < 1e-13, "{size}: {face}");
        }
    }

    #[test]
    fn a_texel_in_the_middle_is_nearly_flat() {
        // At the centre of the face the solid angle is the area, (2 / size)^2. In the corner it is smaller by a factor
        // of 3^(3/2).
        let area = (2.0_f64 / 4096.0).powi(2);
        assert!((texel_solid_angle(4096, 2048, 2048) / area - 1.0).abs() < 1e-6);
        let corner = texel_solid_angle(4096, 0, 4095);
        assert!((corner * 27.0_f64.sqrt() / area - 1.0).abs() < 1e-3);
    }
}
