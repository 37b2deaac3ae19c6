//! Rust counterpart of `distribution.wgsl`: distributions of microfacet normals in textbook form.
//!
//! Results are densities in 1/sr. The integral of D cos is 1, and D is 0 at and below the horizon. `alpha` is a width
//! in (0, 1], `n_dot_h` is a cosine, and `n` and `h` are unit vectors.

use std::f64::consts::{PI, TAU};

use glam::DVec3;

/// Computes Walter et al. 2007, eq. 33: alpha^2 / (pi cos^4 (alpha^2 + tan^2)^2).
#[must_use]
pub fn ggx(alpha: f64, n_dot_h: f64) -> f64 {
    if n_dot_h <= 0.0 {
        return 0.0;
    }
    ggx_slope(alpha, tan2(n_dot_h), n_dot_h)
}

/// Computes `ggx` from the vectors. The tangent is the length of N x H, divided by N.H.
#[must_use]
pub fn ggx_from_vectors(alpha: f64, n: DVec3, h: DVec3) -> f64 {
    if n.dot(h) <= 0.0 {
        return 0.0;
    }
    ggx_slope(alpha, tan2_between(n, h), n.dot(h))
}

/// Computes Walter et al. 2007, eq. 25: exp(-tan^2 / alpha^2) / (pi alpha^2 cos^4).
#[must_use]
pub fn beckmann(alpha: f64, n_dot_h: f64) -> f64 {
    if n_dot_h <= 0.0 {
        return 0.0;
    }
    beckmann_slope(alpha, tan2(n_dot_h), n_dot_h)
}

/// Computes `beckmann` from the vectors. The tangent is the length of N x H, divided by N.H.
#[must_use]
pub fn beckmann_from_vectors(alpha: f64, n: DVec3, h: DVec3) -> f64 {
    if n.dot(h) <= 0.0 {
        return 0.0;
    }
    beckmann_slope(alpha, tan2_between(n, h), n.dot(h))
}

/// Computes Walter et al. 2007, eq. 30: (exponent + 2) / (2 pi) cos^exponent.
#[must_use]
pub fn blinn_phong(exponent: f64, n_dot_h: f64) -> f64 {
    if n_dot_h <= 0.0 {
        return 0.0;
    }
    (exponent + 2.0) / TAU * n_dot_h.powf(exponent)
}

/// Computes the exponent of Walter et al. 2007, section 5.2: 2 / alpha^2 - 2.
#[must_use]
pub fn blinn_phong_exponent(alpha: f64) -> f64 {
    2.0 / (alpha * alpha) - 2.0
}

fn ggx_slope(alpha: f64, tan2: f64, cos: f64) -> f64 {
    alpha * alpha / (PI * cos.powi(4) * (alpha * alpha + tan2).powi(2))
}

/// The density of slopes, divided by cos^4. Where the exponential is below 2e-300, the function returns 0. Without this
/// limit, the result would be 0 / 0 at the horizon.
fn beckmann_slope(alpha: f64, tan2: f64, cos: f64) -> f64 {
    let slope = tan2 / (alpha * alpha);
    if slope > 690.0 {
        return 0.0;
    }
    (-slope).exp() / (PI * alpha * alpha * cos.powi(4))
}

/// The squared tangent of the angle with cosine `c`. If rounding puts the cosine above 1, the function treats it as a
/// cosine equally far below 1.
fn tan2(c: f64) -> f64 {
    (1.0 - c).abs() * (1.0 + c) / (c * c)
}

fn tan2_between(n: DVec3, h: DVec3) -> f64 {
    n.cross(h).length_squared() / n.dot(h).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The integral of D cos over the hemisphere, by the midpoint rule in ln(tan / scale). The integrand vanishes
    /// exponentially at both ends, so the rule converges exponentially.
    fn projected_area(scale: f64, d: impl Fn(f64) -> f64) -> f64 {
        let (nodes, first, step) = (1200, -20.0, 0.05);
        let sum: f64 = (0..nodes)
            .map(|i| {
                let tan = scale * (first + (f64::from(i) + 0.5) * step).exp();
                let cos = (1.0 + tan * tan).sqrt().recip();
                // d(theta) = cos^2 tan dy, sin = tan cos
                d(cos) * cos.powi(4) * tan * tan
            })
            .sum();
        sum * step * TAU
    }

    #[test]
    fn facets_cover_the_surface_once() {
        for alpha in [1e-3, 0.03, 0.4, 1.0] {
            let area = projected_area(alpha, |cos| ggx(alpha, cos));
            assert!((area - 1.0).abs() < 1e-8, "GGX {alpha}: {area}");
            let area = projected_area(alpha, |cos| beckmann(alpha, cos));
            assert!((area - 1.0).abs() < 1e-8, "Beckmann {alpha}: {area}");
            let exponent = blinn_phong_exponent(alpha);
            let area = projected_area(alpha, |cos| blinn_phong(exponent, cos));
            assert!((area - 1.0).abs() < 1e-8, "Blinn-Phong {alpha}: {area}");
        }
    }

    #[test]
    fn peaks_are_the_closed_forms() {
        for alpha in [1e-4, 0.1, 1.0_f64] {
            let peak = 1.0 / (PI * alpha * alpha);
            for d in [ggx(alpha, 1.0), beckmann(alpha, 1.0)] {
                assert!((d / peak - 1.0).abs() < 1e-14, "{alpha}");
            }
            // 2 / alpha^2 - 2 + 2 is 2 / alpha^2, because equal peaks define the exponent.
            let d = blinn_phong(blinn_phong_exponent(alpha), 1.0);
            assert!((d / peak - 1.0).abs() < 1e-14, "{alpha}");
        }
    }

    #[test]
    fn widest_ggx_is_uniform() {
        for cos in [1e-3, 0.3, 1.0] {
            assert!((ggx(1.0, cos) * PI - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn vectors_and_cosine_agree() {
        for theta in [0.0, 1e-3, 0.7, 1.5_f64] {
            let n = DVec3::new(0.48, -0.6, 0.64);
            let side = n.any_orthonormal_vector();
            let h = n * theta.cos() + side * theta.sin();
            for alpha in [0.1, 1.0] {
                let pairs = [
                    (ggx_from_vectors(alpha, n, h), ggx(alpha, theta.cos())),
                    (beckmann_from_vectors(alpha, n, h), beckmann(alpha, theta.cos())),
                ];
                for (vectors, cosine) in pairs {
                    assert!((vectors - cosine).abs() <= 1e-8 * cosine, "{alpha}, {theta}");
                }
            }
        }
    }

    #[test]
    fn nothing_faces_down() {
        for cos in [0.0, -0.5, -1.0] {
            assert_eq!(ggx(0.5, cos), 0.0);
            assert_eq!(beckmann(0.5, cos), 0.0);
            assert_eq!(blinn_phong(5.0, cos), 0.0);
        }
        assert_eq!(ggx_from_vectors(0.5, DVec3::Z, DVec3::NEG_Z), 0.0);
        assert_eq!(beckmann_from_vectors(0.5, DVec3::Z, DVec3::X), 0.0);
    }

    #[test]
    fn rounding_the_cosine_moves_narrow_lobes() {
        // The relative change of D with cos^2 is 2 d(cos^2) / (alpha^2 + tan^2). At alpha = 0.0025, a cosine half an
        // ulp (3e-8) below 1 gives up to 1.9 %. A dot product may have an error of a whole ulp, which gives 3.8 %.
        let worst = |alpha: f64| {
            (0..20_000)
                .map(|i| {
                    let cos = (f64::from(i) / 20_000.0 * 4.0 * alpha).cos();
                    #[expect(clippy::cast_possible_truncation, reason = "the point of the test")]
                    let rounded = f64::from(cos as f32);
                    (ggx(alpha, rounded) / ggx(alpha, cos) - 1.0).abs()
                })
                .fold(0.0, f64::max)
        };
        assert!((worst(0.0025) - 0.019).abs() < 0.001, "{}", worst(0.0025));
        assert!(worst(0.1) < 3e-5, "{}", worst(0.1));
    }
}
