//! Twin of `geometry.wgsl`: masking and shadowing of microfacets in textbook form.
//!
//! Results are shares in 0..=1; `n_dot_x` and `v_dot_h` are cosines in 0..=1; `alpha` is the GGX
//! width in (0, 1].

/// Cook and Torrance 1982, "Geometrical attenuation factor": the least of 1, masking and
/// shadowing. 1, the limit, where `v_dot_h` is 0.
#[must_use]
pub fn v_cavity(n_dot_h: f64, n_dot_v: f64, n_dot_l: f64, v_dot_h: f64) -> f64 {
    if v_dot_h == 0.0 {
        return 1.0;
    }
    let masking = 2.0 * n_dot_h * n_dot_v / v_dot_h;
    let shadowing = 2.0 * n_dot_h * n_dot_l / v_dot_h;
    1.0_f64.min(masking).min(shadowing)
}

/// Walter et al. 2007, eq. 34: 2 / (1 + sqrt(1 + alpha^2 tan^2)), and 0 at and below the horizon.
#[must_use]
pub fn smith_g1(alpha: f64, n_dot_x: f64) -> f64 {
    if n_dot_x <= 0.0 {
        return 0.0;
    }
    2.0 / (1.0 + (1.0 + alpha * alpha * tan2(n_dot_x)).sqrt())
}

/// Walter et al. 2007, eq. 23: G1(v) G1(l).
#[must_use]
pub fn smith_separable(alpha: f64, n_dot_v: f64, n_dot_l: f64) -> f64 {
    smith_g1(alpha, n_dot_v) * smith_g1(alpha, n_dot_l)
}

/// Heitz 2014, eq. 99: 1 / (1 + Lambda(v) + Lambda(l)), and 0 at and below the horizon.
#[must_use]
pub fn smith_correlated(alpha: f64, n_dot_v: f64, n_dot_l: f64) -> f64 {
    if n_dot_v <= 0.0 || n_dot_l <= 0.0 {
        return 0.0;
    }
    1.0 / (1.0 + lambda(alpha, n_dot_v) + lambda(alpha, n_dot_l))
}

/// Heitz 2014, eq. 72, with 1 / a^2 = alpha^2 tan^2.
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
        // alpha = 1: 1 + tan^2 = 1 / cos^2, so that G1 = 2 cos / (1 + cos).
        for c in [0.01, 0.3, 0.9] {
            assert!((smith_g1(1.0, c) - 2.0 * c / (1.0 + c)).abs() < 1e-15);
        }
    }

    #[test]
    fn correlated_heights_hide_less() {
        // Lambda >= 0, so that (1 + a) (1 + b) >= 1 + a + b.
        for alpha in ALPHAS {
            for (v, l) in [(0.1, 0.9), (0.5, 0.5), (0.01, 0.02)] {
                let gain = smith_correlated(alpha, v, l) - smith_separable(alpha, v, l);
                assert!(gain >= -1e-15, "{alpha}, {v}, {l}");
            }
        }
        // One direction unmasked: both forms are G1 of the other.
        assert!((smith_correlated(0.5, 1.0, 0.3) - smith_g1(0.5, 0.3)).abs() < 1e-15);
    }

    #[test]
    fn the_projected_lobe_has_unit_area() {
        // Heitz 2014, section 3: the visible facets cover exactly the projected macrosurface,
        // int G1 D <v, m> dm = cos(v). This is what ties G1 to the GGX distribution D (Walter et
        // al. 2007, eq. 33); it pins alpha, the 2 and the tangent at once.
        let (alpha, cos_v) = (0.4_f64, 0.35_f64);
        let sin_v = (1.0 - cos_v * cos_v).sqrt();
        let (rings, spokes) = (2000, 400);
        let mut sum = 0.0;
        for i in 0..rings {
            let theta = (f64::from(i) + 0.5) / f64::from(rings) * std::f64::consts::FRAC_PI_2;
            let (sin_m, cos_m) = theta.sin_cos();
            let denominator = 1.0 + (alpha * alpha - 1.0) * cos_m * cos_m;
            let d = alpha * alpha / (std::f64::consts::PI * denominator * denominator);
            for j in 0..spokes {
                let phi = (f64::from(j) + 0.5) / f64::from(spokes) * std::f64::consts::TAU;
                let v_dot_m = sin_v * sin_m * phi.cos() + cos_v * cos_m;
                sum += d * v_dot_m.max(0.0) * sin_m;
            }
        }
        let cell = std::f64::consts::FRAC_PI_2 / f64::from(rings) * std::f64::consts::TAU
            / f64::from(spokes);
        let covered = smith_g1(alpha, cos_v) * sum * cell;
        assert!((covered - cos_v).abs() < 1e-5, "{covered} for {cos_v}");
    }
}
