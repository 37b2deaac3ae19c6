//! Twin of `specular.wgsl`: light from an environment, reflected by GGX microfacets.

use std::f64::consts::PI;

use glam::DVec3;

use crate::{fresnel, geometry, sampling};

/// The estimator in its general form, the mean of f L cos / pdf over the same normals, with D in
/// both f and pdf: W/(m^2 sr).
///
/// f = D F G / (4 N.L N.V): Walter et al. 2007, eq. 20; pdf = D N.H / (4 V.H): eq. 24 and 14. `n`
/// and `v` are unit vectors with N.V > 0; `alpha` is 0, a mirror, or lies in 1e-4..=1; `radiance`
/// is the light from a unit direction; `samples` is at least 1.
#[must_use]
pub fn specular_estimate(
    f0: DVec3,
    alpha: f64,
    n: DVec3,
    v: DVec3,
    samples: u32,
    radiance: impl Fn(DVec3) -> DVec3,
) -> DVec3 {
    let n_dot_v = n.dot(v);
    if alpha == 0.0 {
        return fresnel::schlick(f0, n_dot_v) * radiance(2.0 * n_dot_v * n - v);
    }
    let frame = sampling::orthonormal_basis(n);
    let sample = |i| {
        let h = frame * sampling::ggx_normal(alpha, sampling::hammersley_centred(i, samples));
        let (n_dot_h, v_dot_h) = (n.dot(h), v.dot(h));
        let l = 2.0 * v_dot_h * h - v;
        let n_dot_l = n.dot(l);
        if n_dot_l <= 0.0 {
            return DVec3::ZERO;
        }
        // From the sine, as n_dot_h alone has lost it for small alpha.
        let d = ggx(alpha, n.cross(h).length_squared());
        let g = geometry::v_cavity(n_dot_h, n_dot_v, n_dot_l, v_dot_h);
        let f = fresnel::schlick(f0, v_dot_h) * d * g / (4.0 * n_dot_l * n_dot_v);
        let pdf = d * n_dot_h / (4.0 * v_dot_h);
        f * radiance(l) * n_dot_l / pdf
    };
    (0..samples).map(sample).sum::<DVec3>() / f64::from(samples)
}

/// Walter et al. 2007, eq. 33, from sin^2: alpha^2 / (pi (cos^2 alpha^2 + sin^2)^2).
fn ggx(alpha: f64, sin2: f64) -> f64 {
    let width = (1.0 - sin2) * alpha * alpha + sin2;
    alpha * alpha / (PI * width * width)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A view at `degrees` from +Z.
    fn view(degrees: f64) -> DVec3 {
        let (sin, cos) = degrees.to_radians().sin_cos();
        DVec3::new(sin, 0.0, cos)
    }

    /// What a perfect reflector (f0 = 1) of `alpha` returns of a white furnace.
    fn furnace(alpha: f64, degrees: f64, samples: u32) -> f64 {
        let white = |_| DVec3::ONE;
        specular_estimate(DVec3::ONE, alpha, DVec3::Z, view(degrees), samples, white).x
    }

    #[test]
    fn a_furnace_never_gains() {
        for alpha in [0.0, 1e-4, 0.05, 0.3, 0.5, 1.0] {
            for degrees in [0.0, 30.0, 60.0, 80.0, 89.0, 89.9] {
                let white = furnace(alpha, degrees, 1 << 14);
                // 1e-3 is the error of the quadrature; at 64 normals it is 5e-3.
                assert!(white > 0.0 && white < 1.001, "{alpha}, {degrees}: {white}");
            }
        }
    }

    #[test]
    fn a_narrow_lobe_is_a_mirror() {
        let sky = |l: DVec3| DVec3::new(1.0 + l.x, 1.0 + l.y, 1.0 + l.z);
        for degrees in [0.0, 45.0, 80.0] {
            let estimate = |alpha| {
                specular_estimate(DVec3::splat(0.3), alpha, DVec3::Z, view(degrees), 64, sky)
            };
            assert!(estimate(1e-4).abs_diff_eq(estimate(0.0), 1e-3), "{degrees}");
        }
    }

    #[test]
    fn a_mirror_shows_the_mirror_direction() {
        let seen = specular_estimate(DVec3::ONE, 0.0, DVec3::Z, view(30.0), 1, |l| l);
        assert!(seen.abs_diff_eq(DVec3::new(-0.5, 0.0, 0.75_f64.sqrt()), 1e-15));
    }
}
