//! Rust counterpart of `geometry.wgsl`: masking and shadowing of microfacets in textbook form.
//!
//! Results are shares in 0..=1, except those of the two `visibility` functions. `n_dot_x` and `v_dot_h` are cosines in
//! 0..=1. `alpha` is the width of GGX or Beckmann, in (0, 1].

use std::f64::consts::PI;

/// Computes the "geometrical attenuation factor" of Cook and Torrance 1982: the least of three numbers, 1, the masking
/// term and the shadowing term. Where `v_dot_h` is 0, the result is the limit, 1.
#[must_use]
pub fn v_cavity(n_dot_h: f64, n_dot_v: f64, n_dot_l: f64, v_dot_h: f64) -> f64 {
    if v_dot_h == 0.0 {
        return 1.0;
    }
    let masking = 2.0 * n_dot_h * n_dot_v / v_dot_h;
    let shadowing = 2.0 * n_dot_h * n_dot_l / v_dot_h;
    1.0_f64.min(masking).min(shadowing)
}

/// Computes [`v_cavity`] divided by 4 N.V N.L (Walter et al. 2007, eq. 20).
#[must_use]
pub fn v_cavity_visibility(n_dot_h: f64, n_dot_v: f64, n_dot_l: f64, v_dot_h: f64) -> f64 {
    v_cavity(n_dot_h, n_dot_v, n_dot_l, v_dot_h) / (4.0 * n_dot_v * n_dot_l)
}

/// Computes Walter et al. 2007, eq. 34: 2 / (1 + sqrt(1 + alpha^2 tan^2)). At and below the horizon the result is 0.
#[must_use]
pub fn smith_g1(alpha: f64, n_dot_x: f64) -> f64 {
    if n_dot_x <= 0.0 {
        return 0.0;
    }
    2.0 / (1.0 + (1.0 + alpha * alpha * tan2(n_dot_x)).sqrt())
}

/// Computes Walter et al. 2007, eq. 23: G1(v) G1(l).
#[must_use]
pub fn smith_separable(alpha: f64, n_dot_v: f64, n_dot_l: f64) -> f64 {
    smith_g1(alpha, n_dot_v) * smith_g1(alpha, n_dot_l)
}

/// Computes Heitz 2014, eq. 99: 1 / (1 + Lambda(v) + Lambda(l)). At and below the horizon the result is 0.
#[must_use]
pub fn smith_correlated(alpha: f64, n_dot_v: f64, n_dot_l: f64) -> f64 {
    if n_dot_v <= 0.0 || n_dot_l <= 0.0 {
        return 0.0;
    }
    1.0 / (1.0 + lambda(alpha, n_dot_v) + lambda(alpha, n_dot_l))
}

/// Computes Heitz 2014, eq. 99, divided by 4 N.V N.L, the denominator of Walter et al. 2007, eq. 20.
#[must_use]
pub fn smith_correlated_visibility(alpha: f64, n_dot_v: f64, n_dot_l: f64) -> f64 {
    if n_dot_v <= 0.0 || n_dot_l <= 0.0 {
        return 0.0;
    }
    smith_correlated(alpha, n_dot_v, n_dot_l) / (4.0 * n_dot_v * n_dot_l)
}

/// Computes the product of Schlick's G1 = c / (c (1 - k) + k) for both directions, with k = alpha / 2: Karis 2013,
/// "Specular G". The function divides numerator and denominator by c: G1 = 1 / (1 + k (1 / c - 1)).
#[must_use]
pub fn smith_schlick_ggx(alpha: f64, n_dot_v: f64, n_dot_l: f64) -> f64 {
    let g1 = |c: f64| if c <= 0.0 { 0.0 } else { 1.0 / (1.0 + 0.5 * alpha * (1.0 / c - 1.0)) };
    g1(n_dot_v) * g1(n_dot_l)
}

/// Computes Walter et al. 2007, eq. 26: 2 / (1 + erf(a) + exp(-a^2) / (a sqrt(pi))) with a = 1 / (alpha tan). At and
/// below the horizon the result is 0.
#[must_use]
pub fn smith_g1_beckmann(alpha: f64, n_dot_x: f64) -> f64 {
    if n_dot_x <= 0.0 {
        return 0.0;
    }
    let a = 1.0 / (alpha * tan2(n_dot_x).sqrt()); // infinite at normal incidence, where G1 is 1
    2.0 / (1.0 + libm::erf(a) + (-a * a).exp() / (a * PI.sqrt()))
}

/// Computes Lambda of GGX: Heitz 2014, eq. 72, with 1 / a^2 = alpha^2 tan^2.
fn lambda(alpha: f64, n_dot_x: f64) -> f64 {
    0.5 * ((1.0 + alpha * alpha * tan2(n_dot_x)).sqrt() - 1.0)
}

/// The squared tangent of the angle with cosine `c`.
fn tan2(c: f64) -> f64 {
    (1.0 - c * c) / (c * c)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distribution;

    const ALPHAS: [f64; 4] = [1e-4, 0.1, 0.5, 1.0];

    #[test]
    fn nothing_is_hidden_at_normal_incidence() {
        for alpha in ALPHAS {
            assert_eq!(smith_g1(alpha, 1.0), 1.0);
            assert_eq!(smith_separable(alpha, 1.0, 1.0), 1.0);
            assert_eq!(smith_correlated(alpha, 1.0, 1.0), 1.0);
        }
        assert_eq!(v_cavity(1.0, 1.0, 1.0, 1.0), 1.0);
        assert_eq!(v_cavity(0.0, 0.0, 0.0, 0.0), 1.0);
    }

    #[test]
    fn everything_is_hidden_at_the_horizon() {
        for alpha in ALPHAS {
            assert_eq!(smith_g1(alpha, 0.0), 0.0);
            assert_eq!(smith_correlated(alpha, 0.0, 0.0), 0.0);
        }
        assert_eq!(v_cavity(0.7, 0.0, 1.0, 0.7), 0.0);
    }

    #[test]
    fn widest_lobe_has_a_closed_form() {
        // At alpha = 1, 1 + tan^2 = 1 / cos^2, so G1 = 2 cos / (1 + cos).
        for c in [0.01, 0.3, 0.9] {
            assert!((smith_g1(1.0, c) - 2.0 * c / (1.0 + c)).abs() < 1e-15);
        }
    }

    #[test]
    fn correlated_heights_hide_less() {
        // Lambda >= 0, so (1 + a) (1 + b) >= 1 + a + b.
        for alpha in ALPHAS {
            for (v, l) in [(0.1, 0.9), (0.5, 0.5), (0.01, 0.02)] {
                let gain = smith_correlated(alpha, v, l) - smith_separable(alpha, v, l);
                assert!(gain >= -1e-15, "{alpha}, {v}, {l}");
            }
        }
        // If one direction isn't masked, both functions are G1 of the other direction.
        assert!((smith_correlated(0.5, 1.0, 0.3) - smith_g1(0.5, 0.3)).abs() < 1e-15);
    }

    #[test]
    fn visibility_of_the_widest_lobe_has_a_closed_form() {
        // At alpha = 1, 1 + 2 Lambda = 1 / cos, so G / (4 v l) = 1 / (2 (v + l)).
        for (v, l) in [(0.01, 0.9), (0.3, 0.3), (1.0, 1.0)] {
            let expected = 0.5 / (v + l);
            assert!((smith_correlated_visibility(1.0, v, l) / expected - 1.0).abs() < 1e-14);
        }
    }

    #[test]
    fn schlick_s_form_stays_near_smith_s() {
        // Schlick 1994 approximates Beckmann. With k = alpha / 2, the approximation is within 0.16 of GGX everywhere,
        // and equal at normal incidence and at the horizon.
        assert_eq!(smith_schlick_ggx(0.5, 1.0, 1.0), 1.0);
        assert_eq!(smith_schlick_ggx(0.5, 0.0, 1.0), 0.0);
        let mut worst = 0.0_f64;
        for alpha in ALPHAS {
            for step in 0..=1000 {
                let c = f64::from(step) / 1000.0;
                let gap = smith_schlick_ggx(alpha, c, 1.0) - smith_g1(alpha, c);
                worst = worst.max(gap.abs());
            }
        }
        assert!(worst < 0.16, "{worst}");
    }

    #[test]
    fn beckmann_s_masking_is_near_the_rational_fit() {
        // The fit of Walter et al. 2007, eq. 27, has a relative error below 0.35 % for a < 1.6. Above, it is 1.
        for step in 1..300 {
            let a = f64::from(step) / 100.0;
            let cos = a / (1.0 + a * a).sqrt(); // tan = 1 / a, alpha = 1
            let fit = if a < 1.6 {
                (3.535 * a + 2.181 * a * a) / (1.0 + 2.276 * a + 2.577 * a * a)
            } else {
                1.0
            };
            assert!((fit / smith_g1_beckmann(1.0, cos) - 1.0).abs() < 3.6e-3, "{a}");
        }
        assert_eq!(smith_g1_beckmann(0.5, 1.0), 1.0);
    }

    #[test]
    fn the_projected_lobe_has_unit_area() {
        // Heitz 2014, section 3: the visible facets cover exactly the projected macrosurface, int G1 D <v, m> dm =
        // cos(v). This equation relates G1 to the distribution. It determines alpha, the factor 2 and the tangent
        // together.
        let ggx = covered(0.4, 0.35, distribution::ggx, smith_g1);
        assert!((ggx - 0.35).abs() < 1e-5, "{ggx}");
        let beckmann = covered(0.4, 0.35, distribution::beckmann, smith_g1_beckmann);
        assert!((beckmann - 0.35).abs() < 1e-5, "{beckmann}");
    }

    /// The integral of G1 D <v, m> over the normals m.
    fn covered(alpha: f64, cos_v: f64, d: fn(f64, f64) -> f64, g1: fn(f64, f64) -> f64) -> f64 {
        let sin_v = (1.0 - cos_v * cos_v).sqrt();
        let (rings, spokes) = (2000, 400);
        let mut sum = 0.0;
        for i in 0..rings {
            let theta = (f64::from(i) + 0.5) / f64::from(rings) * std::f64::consts::FRAC_PI_2;
            let (sin_m, cos_m) = theta.sin_cos();
            let d = d(alpha, cos_m);
            for j in 0..spokes {
                let phi = (f64::from(j) + 0.5) / f64::from(spokes) * std::f64::consts::TAU;
                let v_dot_m = sin_v * sin_m * phi.cos() + cos_v * cos_m;
                sum += d * v_dot_m.max(0.0) * sin_m;
            }
        }
        let cell = std::f64::consts::FRAC_PI_2 / f64::from(rings) * std::f64::consts::TAU
            / f64::from(spokes);
        g1(alpha, cos_v) * sum * cell
    }
}
