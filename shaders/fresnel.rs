//! Twin of `fresnel.wgsl`: Fresnel reflectance in textbook form.

use glam::DVec3;

/// Schlick 1994: F = f0 + (1 - f0) (1 - cos)^5.
///
/// `f0` and the result are reflectances in 0..=1 per channel, `v_dot_h` a cosine in 0..=1.
#[must_use]
pub fn schlick(f0: DVec3, v_dot_h: f64) -> DVec3 {
    f0 + (DVec3::ONE - f0) * (1.0 - v_dot_h).powi(5)
}

/// Born and Wolf 1999, section 1.5.2; Pharr et al. 2023 (pbrt-v4), section 9.3.5: the mean of
/// r_s^2 and r_p^2, with cos_t from Snell's law.
///
/// `eta` = n_t / n_i in 0.4..=2.5, `cos_i` in 0..=1; the result is a reflectance. Total internal
/// reflection returns 1. At eta = 1 there is no interface and the result is 0, also at grazing
/// incidence, where the formula reads 0 / 0.
#[must_use]
pub fn dielectric(eta: f64, cos_i: f64) -> f64 {
    if eta == 1.0 {
        return 0.0;
    }
    let sin2_t = (1.0 - cos_i * cos_i) / (eta * eta);
    if sin2_t > 1.0 {
        return 1.0;
    }
    let cos_t = (1.0 - sin2_t).sqrt();
    let r_s = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    let r_p = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    0.5 * (r_s * r_s + r_p * r_p)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GLASS: f64 = 1.5;

    #[test]
    fn schlick_interpolates_from_f0_to_white() {
        let f0 = DVec3::new(0.0, 0.04, 1.0);
        assert_eq!(schlick(f0, 1.0), f0);
        assert_eq!(schlick(f0, 0.0), DVec3::ONE);
    }

    #[test]
    fn normal_incidence_is_the_closed_form() {
        for eta in [0.4, 1.0 / GLASS, 1.0001, 1.33, GLASS, 2.5] {
            let expected = ((eta - 1.0) / (eta + 1.0_f64)).powi(2);
            assert!((dielectric(eta, 1.0) - expected).abs() < 1e-15, "{eta}");
        }
    }

    #[test]
    fn grazing_incidence_reflects_everything() {
        for eta in [0.4, 1.33, 2.5] {
            assert!((dielectric(eta, 0.0) - 1.0).abs() < 1e-15, "{eta}");
        }
    }

    #[test]
    fn brewster_angle_leaves_r_s_alone() {
        // tan(theta_B) = eta; there r_p = 0 and r_s = (1 - eta^2) / (1 + eta^2).
        let cos_b = (1.0 + GLASS * GLASS).sqrt().recip();
        let r_s = (1.0 - GLASS * GLASS) / (1.0 + GLASS * GLASS);
        assert!((dielectric(GLASS, cos_b) - 0.5 * r_s * r_s).abs() < 1e-15);
    }

    #[test]
    fn both_sides_of_the_interface_agree() {
        // Stokes reversibility: F(eta, cos_i) = F(1 / eta, cos_t).
        for cos_i in [0.05, 0.3, 0.7, 1.0_f64] {
            let cos_t = (1.0 - (1.0 - cos_i * cos_i) / (GLASS * GLASS)).sqrt();
            let difference = dielectric(GLASS, cos_i) - dielectric(GLASS.recip(), cos_t);
            assert!(difference.abs() < 1e-14, "{cos_i}");
        }
    }

    #[test]
    fn total_internal_reflection_begins_at_the_critical_angle() {
        let critical = (1.0 - GLASS.recip().powi(2)).sqrt();
        assert_eq!(dielectric(GLASS.recip(), critical - 1e-9), 1.0);
        assert!(dielectric(GLASS.recip(), critical + 1e-3) < 0.9);
    }
}
