//! Twin of `diffuse.wgsl`: light from an environment, reflected by a Lambertian.

use std::f64::consts::FRAC_1_PI;

use glam::DVec3;

use crate::sampling;

/// The estimator in its general form, the mean of f L cos / pdf with f = 1 / pi, over the same
/// directions: W/(m^2 sr) for a white Lambertian with unit normal `n`.
///
/// `radiance` is the light from a unit direction; `samples` is at least 1.
#[must_use]
pub fn diffuse_irradiance_estimate(
    n: DVec3,
    samples: u32,
    radiance: impl Fn(DVec3) -> DVec3,
) -> DVec3 {
    let frame = sampling::orthonormal_basis(n);
    let sample = |i| {
        let l = frame * sampling::uniform_hemisphere(sampling::hammersley_centred(i, samples));
        let n_dot_l = n.dot(l);
        FRAC_1_PI * radiance(l) * n_dot_l / sampling::uniform_hemisphere_pdf(n_dot_l)
    };
    (0..samples).map(sample).sum::<DVec3>() / f64::from(samples)
}

#[cfg(test)]
mod tests {
    use super::*;

    const NORMAL: DVec3 = DVec3::new(0.6, -0.48, 0.64);

    #[test]
    fn a_furnace_returns_its_light() {
        for samples in [1, 64, 1024] {
            let light = diffuse_irradiance_estimate(NORMAL, samples, |_| DVec3::ONE);
            assert!(light.abs_diff_eq(DVec3::ONE, 1e-12), "{samples}: {light}");
        }
    }

    #[test]
    fn a_cosine_lobe_has_a_closed_form() {
        // (1 / pi) int cos^2 = 2/3 for a lobe about the normal; a light from below adds nothing.
        let lobe = |axis: DVec3| {
            diffuse_irradiance_estimate(NORMAL, 4096, |l| DVec3::splat(l.dot(axis).max(0.0))).x
        };
        assert!((lobe(NORMAL) - 2.0 / 3.0).abs() < 1e-6);
        assert_eq!(lobe(-NORMAL), 0.0);
    }
}
