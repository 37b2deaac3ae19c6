//! Rust counterpart of `layering.wgsl`: a thin shiny layer over any base, as in task 3 of PV227 lecture 11.
//!
//! `environment`, `base` and `white` are radiances in W/(m^2 sr), at least 0. Cosines and `mask` are in 0..=1.

use glam::DVec3;

use crate::fresnel;

/// Reflectance of a dielectric of index 1.5 at normal incidence.
const COAT_F0: f64 = 0.04;

/// Computes the radiance L_o = F_c L_environment + (1 - F_c) L_base with F_c = Schlick(0.04, N.V).
#[must_use]
pub fn thin_coat(environment: DVec3, base: DVec3, n_dot_v: f64) -> DVec3 {
    reflectance(n_dot_v) * environment + transmittance(n_dot_v) * base
}

/// Computes the weight (1 - F_c(v)) (1 - F_c(l)).
#[must_use]
pub fn thin_coat_reciprocal_weight(n_dot_v: f64, n_dot_l: f64) -> f64 {
    transmittance(n_dot_v) * transmittance(n_dot_l)
}

/// Computes the blend (1 - mask) base + mask white.
#[must_use]
pub fn masked_base(base: DVec3, white: DVec3, mask: f64) -> DVec3 {
    (1.0 - mask) * base + mask * white
}

/// Computes the radiance (1 - F) L_base + L_specular with F = Schlick(f0, N.V).
#[must_use]
pub fn plastic(f0: DVec3, base: DVec3, specular: DVec3, n_dot_v: f64) -> DVec3 {
    interface_transmittance(f0, n_dot_v) * base + specular
}

/// Computes 1 - F = (1 - f0) (1 - (1 - c)^5). The function computes 1 - (1 - c)^5 as -expm1(5 log1p(-c)), which is
/// precise even for the smallest cosines. A plain subtraction would give 0 for these cosines.
#[must_use]
pub fn interface_transmittance(f0: DVec3, n_dot_x: f64) -> DVec3 {
    (DVec3::ONE - f0) * -(5.0 * (-n_dot_x).ln_1p()).exp_m1()
}

fn reflectance(n_dot_x: f64) -> f64 {
    fresnel::schlick(DVec3::splat(COAT_F0), n_dot_x).x
}

fn transmittance(n_dot_x: f64) -> f64 {
    interface_transmittance(DVec3::splat(COAT_F0), n_dot_x).x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::specular;

    const COSINES: [f64; 5] = [0.0, 1e-3, 0.2, 0.7, 1.0];

    #[test]
    fn transmittance_completes_reflectance() {
        for c in COSINES {
            assert!((transmittance(c) + reflectance(c) - 1.0).abs() < 1e-15, "{c}");
        }
    }

    #[test]
    fn a_white_furnace_stays_white() {
        for c in COSINES {
            let radiance = thin_coat(DVec3::ONE, DVec3::ONE, c);
            assert!(radiance.abs_diff_eq(DVec3::ONE, 1e-15), "{c}");
        }
    }

    #[test]
    fn the_reciprocal_weight_loses_eight_percent() {
        // The sum is that of a coat and a white Lambertian base at normal incidence: F(1) + (1 - F(1)) int 2 c (1 -
        // F(c)), and int 2 c (1 - c)^5 = 2 / 42.
        let n = 100_000;
        let base: f64 = (0..n)
            .map(|i| (f64::from(i) + 0.5) / f64::from(n))
            .map(|c| 2.0 * c * thin_coat_reciprocal_weight(1.0, c) / f64::from(n))
            .sum();
        let expected = 0.96 * 0.96 * (1.0 - 2.0 / 42.0);
        assert!((base - expected).abs() < 1e-8);
        assert!((1.0 - (0.04 + base) - 0.0823).abs() < 1e-4);
    }

    #[test]
    fn the_mask_interpolates() {
        let (base, white) = (DVec3::new(0.1, 0.2, 3.0), DVec3::splat(0.9));
        assert_eq!(masked_base(base, white, 0.0), base);
        assert_eq!(masked_base(base, white, 1.0), white);
    }

    #[test]
    fn plastic_keeps_its_energy() {
        // Tests a white furnace with the lecture's plastics, whose brightest albedo is 0.8, and with a white plastic.
        // The specular lobe is wider than a mirror's, so its mean F is above F(N.V) where F is convex: by at most
        // 0.0012, near alpha = 0.1 and 53 degrees.
        let f0 = DVec3::splat(0.04);
        for alpha in [0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5] {
            for degrees in [0.0, 30.0, 60.0, 80.0, 85.0, 89.0, 89.9_f64] {
                let (sin, cos) = degrees.to_radians().sin_cos();
                let v = DVec3::new(sin, 0.0, cos);
                let specular = specular::estimate(f0, alpha, DVec3::Z, v, 1024, |_| DVec3::ONE);
                let furnace = |albedo| plastic(f0, DVec3::splat(albedo), specular, cos).x;
                assert!(furnace(0.8) < 1.0 && furnace(1.0) < 1.0012, "{alpha} {degrees}");
            }
        }
    }

    #[test]
    fn a_mirror_on_white_neither_gains_nor_loses() {
        let f0 = DVec3::new(0.0, 0.04, 1.0);
        for c in COSINES {
            let radiance = plastic(f0, DVec3::ONE, fresnel::schlick(f0, c), c);
            assert!(radiance.abs_diff_eq(DVec3::ONE, 1e-15), "{c}");
        }
    }
}
