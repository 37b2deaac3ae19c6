//! Twin of `sampling.wgsl`: directions from random numbers, in textbook form.
//!
//! Directions are in the local frame, +Z being the normal; angles in radians, densities in 1/sr.
//! Random numbers `u` lie in `[0, 1]`. The shader turns each pattern by half a turn (it says
//! why); here that is the factor -1 on the horizontal components.

use std::f64::consts::TAU;

use glam::{DMat3, DQuat, DVec2, DVec3};

/// PV227 lecture 11, "Uniform sampling for diffuse lighting": phi = 2 pi u.x, cos = u.y.
#[must_use]
pub fn uniform_hemisphere(u: DVec2) -> DVec3 {
    half_turn(spherical(u.y.acos(), TAU * u.x))
}

/// 1 / (2 pi) at and above the horizon, 0 below.
#[must_use]
pub fn uniform_hemisphere_pdf(n_dot_l: f64) -> f64 {
    if n_dot_l >= 0.0 { TAU.recip() } else { 0.0 }
}

/// Walter et al. 2007, eq. 35 and 36: theta = atan(alpha sqrt(u) / sqrt(1 - u)).
///
/// `alpha` is the GGX width, in 0..=1. `atan2` makes alpha = 0 the normal for each `u`.
#[must_use]
pub fn ggx_normal(alpha: f64, u: DVec2) -> DVec3 {
    let theta = (alpha * u.y.sqrt()).atan2((1.0 - u.y).sqrt());
    half_turn(spherical(theta, TAU * u.x))
}

/// Pharr et al. 2023 (pbrt-v4), section 8.6.1, with base 2: digit k of `i` weighs 2^-(k + 1).
///
/// All 32 digits, while the shader keeps 24: equal for i < 2^24, else up to 2^-24 more.
#[must_use]
pub fn radical_inverse(i: u32) -> f64 {
    (0..u32::BITS)
        .filter(|digit| i >> digit & 1 == 1)
        .map(|digit| 0.5_f64.powi(digit.cast_signed() + 1))
        .sum()
}

/// Pharr et al. 2023 (pbrt-v4), section 8.6.1: (i / n, radical inverse of i), for i < n.
#[must_use]
pub fn hammersley(i: u32, n: u32) -> DVec2 {
    DVec2::new(f64::from(i) / f64::from(n), radical_inverse(i))
}

/// `hammersley`, moved by half a cell in both coordinates.
#[must_use]
pub fn hammersley_centred(i: u32, n: u32) -> DVec2 {
    hammersley(i, n) + DVec2::splat(0.5 / f64::from(n))
}

/// The basis of Duff et al. 2017, by its geometric meaning: the shortest rotation of +Z (for
/// `n` in the lower half: of -Z) to `n`, applied to X and Y; below, Y is flipped so that the basis
/// stays right-handed.
#[must_use]
pub fn orthonormal_basis(n: DVec3) -> DMat3 {
    let side = if n.z >= 0.0 { 1.0 } else { -1.0 };
    let rotation = DQuat::from_rotation_arc(side * DVec3::Z, n.normalize());
    DMat3::from_cols(rotation * DVec3::X, side * (rotation * DVec3::Y), n)
}

/// The unit vector with polar angle `theta` and azimuth `phi`.
fn spherical(theta: f64, phi: f64) -> DVec3 {
    let (sin_theta, cos_theta) = theta.sin_cos();
    let (sin_phi, cos_phi) = phi.sin_cos();
    DVec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta)
}

/// `direction`, turned by pi about Z.
fn half_turn(direction: DVec3) -> DVec3 {
    DVec3::new(-direction.x, -direction.y, direction.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: u32 = 1 << 14;

    /// The mean of `f` over the centred Hammersley set.
    fn mean(f: impl Fn(DVec2) -> f64) -> f64 {
        (0..N).map(|i| f(hammersley_centred(i, N))).sum::<f64>() / f64::from(N)
    }

    #[test]
    fn hemisphere_moments() {
        // E[cos] = 1/2, E[cos^2] = 1/3; E[x] = 0, E[x^2] = E[y^2] = 1/3.
        assert!((mean(|u| uniform_hemisphere(u).z) - 0.5).abs() < 1e-12);
        assert!((mean(|u| uniform_hemisphere(u).z.powi(2)) - 1.0 / 3.0).abs() < 1e-8);
        assert!(mean(|u| uniform_hemisphere(u).x).abs() < 1e-3);
        assert!((mean(|u| uniform_hemisphere(u).x.powi(2)) - 1.0 / 3.0).abs() < 1e-3);
        assert!((mean(|u| uniform_hemisphere(u).y.powi(2)) - 1.0 / 3.0).abs() < 1e-3);
        assert!((uniform_hemisphere(DVec2::new(0.3, 0.2)).length() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn hemisphere_density_integrates_to_one() {
        assert!((uniform_hemisphere_pdf(0.5) * TAU - 1.0).abs() < 1e-15);
        assert_eq!(uniform_hemisphere_pdf(-0.5), 0.0);
    }

    #[test]
    fn ggx_quantiles() {
        // The share of normals within theta is alpha^2-free at tan(theta) = alpha: it is 1/2.
        for alpha in [1e-4, 0.1, 1.0_f64] {
            let normal = ggx_normal(alpha, DVec2::new(0.7, 0.5));
            let tangent = normal.x.hypot(normal.y) / normal.z;
            assert!((tangent / alpha - 1.0).abs() < 1e-12, "{alpha}");
        }
        // The lecture's form, cos = sqrt((1 - u) / (1 + (alpha^2 - 1) u)).
        let (alpha, u) = (0.3_f64, 0.8);
        let cos = ((1.0 - u) / (1.0 + (alpha * alpha - 1.0) * u)).sqrt();
        assert!((ggx_normal(alpha, DVec2::new(0.1, u)).z - cos).abs() < 1e-15);
    }

    #[test]
    fn a_mirror_has_one_normal() {
        for u in [0.0, 0.5, 1.0] {
            assert_eq!(ggx_normal(0.0, DVec2::new(0.25, u)).z, 1.0);
        }
    }

    #[test]
    fn radical_inverses() {
        let expected = [0.0, 0.5, 0.25, 0.75, 0.125];
        for (i, expected) in (0..).zip(expected) {
            assert_eq!(radical_inverse(i), expected);
        }
        assert!(radical_inverse(u32::MAX) < 1.0);
    }

    #[test]
    fn the_plain_set_is_dark_by_one_over_n() {
        let plain = (0..64).map(|i| hammersley(i, 64).y).sum::<f64>() / 64.0;
        let centred = (0..64).map(|i| hammersley_centred(i, 64).y).sum::<f64>() / 64.0;
        assert_eq!(2.0 * plain, 1.0 - 1.0 / 64.0);
        assert_eq!(centred, 0.5);
    }

    #[test]
    fn centred_points_stay_inside() {
        for n in 1..300 {
            for i in 0..n {
                assert!(hammersley_centred(i, n).max_element() < 1.0, "{i} of {n}");
            }
        }
    }

    #[test]
    fn bases_are_orthonormal_and_right_handed() {
        let inputs = [
            DVec3::Z,
            DVec3::NEG_Z,
            DVec3::X,
            DVec3::new(1e-9, 0.0, -1.0),
            DVec3::new(0.6, -0.48, 0.64),
            DVec3::new(-0.6, 0.48, -0.64),
            DVec3::new(0.6, 0.8, -1e-12),
        ];
        for n in inputs.map(DVec3::normalize) {
            let basis = orthonormal_basis(n);
            assert!((basis.determinant() - 1.0).abs() < 1e-7, "{n}");
            assert!((basis * basis.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-7), "{n}");
            assert_eq!(basis.z_axis, n);
        }
    }
}
