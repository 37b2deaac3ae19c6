//! Rust counterpart of `fresnel.wgsl`: Fresnel reflectance in textbook form.

use glam::{DVec2, DVec3};

/// Computes the reflectance of Schlick 1994: F = f0 + (1 - f0) (1 - cos)^5.
///
/// `f0` and the result are reflectances in 0..=1 per channel. `v_dot_h` is a cosine in 0..=1.
#[must_use]
pub fn schlick(f0: DVec3, v_dot_h: f64) -> DVec3 {
    f0 + (DVec3::ONE - f0) * (1.0 - v_dot_h).powi(5)
}

/// Computes the mean of r_s^2 and r_p^2, with cos_t from Snell's law: Born and Wolf 1999, section 1.5.2; Pharr et al.
/// 2023 (pbrt-v4), section 9.3.5.
///
/// `eta` = n_t / n_i is in 0.4..=2.5, and `cos_i` in 0..=1. The result is a reflectance. For total internal reflection,
/// the result is 1. At eta = 1 there is no interface and the result is 0, also at grazing incidence, where the formula
/// gives 0 / 0.
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

/// Computes `dielectric` with the complex index m = eta + i k: the mean of |r_s|^2 and |r_p|^2, as in Pharr et al. 2023
/// (pbrt-v4), section 9.3.6.
///
/// `cos_i` is in 0..=1, eta > 0 and k >= 0. At eta = 1 with k = 0 there is no interface, and the result is 0.
#[must_use]
pub fn conductor(eta: f64, k: f64, cos_i: f64) -> f64 {
    if (eta, k) == (1.0, 0.0) {
        return 0.0;
    }
    // Complex numbers are vectors, and `rotate` is their product.
    let index = DVec2::new(eta, k);
    let square = index.rotate(index);
    let divide = |a: DVec2, b: DVec2| a.rotate(DVec2::new(b.x, -b.y)) / b.length_squared();
    let cos2_t = DVec2::X - divide(DVec2::new(1.0 - cos_i * cos_i, 0.0), square);
    let cos_t = DVec2::from_angle(0.5 * cos2_t.to_angle()) * cos2_t.length().sqrt();
    let cos_i = DVec2::new(cos_i, 0.0);
    let (outside, inside) = (index.rotate(cos_i), index.rotate(cos_t));
    let r_s = divide(cos_i - inside, cos_i + inside);
    let r_p = divide(outside - cos_t, outside + cos_t);
    0.5 * (r_s.length_squared() + r_p.length_squared())
}

/// Computes the mean of Schlick's F, weighted by the cosine c: the integral of 2 c F(c) over c in 0..=1. The integral
/// of c (1 - c)^5 is 1 / 42.
#[must_use]
pub fn schlick_average(f0: DVec3) -> DVec3 {
    f0 + (DVec3::ONE - f0) * 2.0 / 42.0
}

/// Computes the integral of F over cos^2 in 0..=1, for `eta` > 0, by quadrature of `dielectric`.
///
/// Beyond the critical angle F is 1. The function maps the rest of the range of cos^2 to s in 0..=1, and computes a
/// trapezoidal sum over ln(s / (1 - s)). Near eta = 1, F falls from 1 to almost 0 within a narrow range of cos^2: the
/// range is about as wide as the difference between eta^2 and 1. Thanks to the logarithm, the sum is accurate in this
/// range, too. The error of the sum falls as exp(-2 pi^2 / step) (Trefethen and Weideman 2014, theorem 5.1), because
/// each singularity of the integrand is at least pi away from the real axis.
#[must_use]
pub fn dielectric_average(eta: f64) -> f64 {
    const STEP: f64 = 0.5; // 1e-17
    const REACH: i32 = 74; // exp(-37) is 1e-16
    let total = ((1.0 - eta) * (1.0 + eta)).max(0.0); // cos^2 of the critical angle
    let rest: f64 = (-REACH..=REACH)
        .map(|i| {
            let odds = (f64::from(i) * STEP).exp();
            let share = odds / (1.0 + odds); // in 0..=1
            let cos_i = (total + (1.0 - total) * share).sqrt().min(1.0);
            STEP * share / (1.0 + odds) * dielectric(eta, cos_i)
        })
        .sum();
    total + (1.0 - total) * rest
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
        // tan(theta_B) = eta. At theta_B, r_p = 0 and r_s = (1 - eta^2) / (1 + eta^2).
        let cos_b = (1.0 + GLASS * GLASS).sqrt().recip();
        let r_s = (1.0 - GLASS * GLASS) / (1.0 + GLASS * GLASS);
        assert!((dielectric(GLASS, cos_b) - 0.5 * r_s * r_s).abs() < 1e-15);
    }

    #[test]
    fn both_sides_of_the_interface_agree() {
        // Stokes' reversibility requires F(eta, cos_i) = F(1 / eta, cos_t).
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

    #[test]
    fn a_metal_without_absorption_is_a_dielectric() {
        for eta in [0.4, 0.7, 1.0001, GLASS, 2.5] {
            for cos_i in [0.0, 1e-3, 0.2, 0.6, 0.9, 1.0] {
                let difference = conductor(eta, 0.0, cos_i) - dielectric(eta, cos_i);
                assert!(difference.abs() < 1e-12, "{eta}, {cos_i}");
            }
        }
        assert_eq!(conductor(1.0, 0.0, 0.0), 0.0);
    }

    #[test]
    fn metals_at_normal_incidence_are_the_closed_form() {
        for (eta, k) in [(0.15_f64, 3.2_f64), (1.4, 7.5), (2.9, 3.1), (1.0, 1.0)] {
            let expected = ((eta - 1.0).powi(2) + k * k) / ((eta + 1.0).powi(2) + k * k);
            assert!((conductor(eta, k, 1.0) - expected).abs() < 1e-14, "{eta}, {k}");
            assert!((conductor(eta, k, 0.0) - 1.0).abs() < 1e-14, "{eta}, {k}");
        }
    }

    #[test]
    fn a_strong_reflector_dips_towards_grazing() {
        // For |m| >> 1 (Born and Wolf 1999, section 14.2), |r_p|^2 is smallest where cos = 1 / |m|. There it is (|m| -
        // eta) / (|m| + eta), and |r_s|^2 is nearly 1.
        let (eta, k) = (40.0_f64, 80.0_f64);
        let modulus = eta.hypot(k);
        let least = conductor(eta, k, modulus.recip());
        let expected = 0.5 * (1.0 + (modulus - eta) / (modulus + eta));
        assert!((least - expected).abs() < 1e-3, "{least}, {expected}");
    }

    #[test]
    fn schlick_average_is_the_integral() {
        const N: i32 = 10_000;
        for f0 in [DVec3::ZERO, DVec3::splat(0.04), DVec3::new(1.0, 0.782, 0.344)] {
            let sum: DVec3 = (0..N)
                .map(|i| (f64::from(i) + 0.5) / f64::from(N))
                .map(|c| 2.0 * c * schlick(f0, c) / f64::from(N))
                .sum();
            assert!(sum.abs_diff_eq(schlick_average(f0), 1e-7), "{f0}");
        }
    }

    /// The closed form of Duntley 1942, for eta > 1. Near eta = 1, the terms cancel, so the closed form is useless
    /// there.
    fn duntley(n: f64) -> f64 {
        let n2 = n * n;
        let (plus, minus) = (n2 + 1.0, n2 * n2 - 1.0);
        0.5 + (n - 1.0) * (3.0 * n + 1.0) / (6.0 * (n + 1.0).powi(2))
            + n2 * (n2 - 1.0).powi(2) / plus.powi(3) * ((n - 1.0) / (n + 1.0)).ln()
            - 2.0 * n2 * n * (n2 + 2.0 * n - 1.0) / (plus * minus)
            + 8.0 * n2 * n2 * (n2 * n2 + 1.0) / (plus * minus * minus) * n.ln()
    }

    #[test]
    fn dielectric_average_is_the_closed_form() {
        for eta in [1.05, 1.2, 1.33, GLASS, 2.0, 2.5] {
            assert!((dielectric_average(eta) / duntley(eta) - 1.0).abs() < 1e-9, "{eta}");
        }
        assert!((dielectric_average(GLASS) - 0.091_777_959).abs() < 1e-9);
        // Results of the closed form with 60 digits, at one step of f32 below and above 1.
        let beside = [
            (1.0 - 0.5_f64.powi(24), 1.390_774_717_7e-7),
            (1.0 + 0.5_f64.powi(23), 3.973_632_289_8e-8),
        ];
        for (eta, expected) in beside {
            assert!((dielectric_average(eta) / expected - 1.0).abs() < 1e-8, "{eta}");
        }
        assert_eq!(dielectric_average(1.0), 0.0);
    }

    #[test]
    fn a_dielectric_transmits_equally_in_both_directions() {
        // Light in equilibrium on both sides of the interface requires 1 - F(1 / n) = (1 - F(n)) / n^2.
        for eta in [1.001, 1.2, GLASS, 2.5_f64] {
            let enters = 1.0 - dielectric_average(eta);
            let leaves = (1.0 - dielectric_average(eta.recip())) * eta * eta;
            assert!((enters - leaves).abs() < 1e-9, "{eta}: {enters}, {leaves}");
        }
    }
}
