//! Rust counterpart of `brdf.wgsl`: complete BRDFs in textbook form, and a quadrature rule for their integrals.
//!
//! Directions are in the local frame, in which +Z is the normal. `v` and `l` are unit vectors. A BRDF is in 1/sr, and
//! doesn't contain the cosine of `l`. The probability density of a direction is in 1/sr. The BRDF and the density are 0
//! where `v` or `l` is at or below the horizon. `f0` and `albedo` are reflectances per channel. `alpha` is the width of
//! the distribution of normals, in (0, 1].

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use glam::{DVec2, DVec3};
use karat::stats::gauss_legendre;

use crate::{distribution, fresnel, geometry, sampling};

/// Computes the BRDF of Lambert 1760: albedo / pi.
#[must_use]
pub fn lambert_eval(albedo: DVec3, v: DVec3, l: DVec3) -> DVec3 {
    if above_horizon(v, l) { albedo / PI } else { DVec3::ZERO }
}

/// Samples a direction as `sampling::cosine_hemisphere` does.
#[must_use]
pub fn lambert_sample(u: DVec2) -> DVec3 {
    sampling::cosine_hemisphere(u)
}

/// Computes the density of a direction that `lambert_sample` returns: cos / pi.
#[must_use]
pub fn lambert_pdf(l: DVec3) -> f64 {
    l.z.max(0.0) / PI
}

/// Computes the BRDF of Walter et al. 2007, eq. 20: F G D / (4 N.L N.V). D is eq. 33, and G is Heitz 2014, eq. 99.
#[must_use]
pub fn microfacet_eval(f0: DVec3, alpha: f64, v: DVec3, l: DVec3) -> DVec3 {
    if !above_horizon(v, l) {
        return DVec3::ZERO;
    }
    let h = (v + l).normalize();
    let d = distribution::ggx_from_vectors(alpha, DVec3::Z, h);
    let g = geometry::smith_correlated(alpha, v.z, l.z);
    fresnel::schlick(f0, v_dot_h(v, l)) * (g * d / (4.0 * v.z * l.z))
}

/// Samples a direction as in Heitz 2018: mirrors `v` at a normal that is visible from `v`. u.y must be below 1.
#[must_use]
pub fn microfacet_sample(alpha: f64, v: DVec3, u: DVec2) -> DVec3 {
    mirrored(v, sampling::ggx_visible_normal(alpha, v, u))
}

/// Computes the density of a direction that `microfacet_sample` returns: the density of the normal (Heitz 2018, eq. 3
/// and 17), divided by 4 V.H.
#[must_use]
pub fn microfacet_pdf(alpha: f64, v: DVec3, l: DVec3) -> f64 {
    if !above_horizon(v, l) {
        return 0.0;
    }
    let d = distribution::ggx_from_vectors(alpha, DVec3::Z, (v + l).normalize());
    let visible = geometry::smith_g1(alpha, v.z) * v_dot_h(v, l) * d / v.z;
    visible / (4.0 * v_dot_h(v, l))
}

/// Computes the weight of a sample by its definition, f cos / pdf.
#[must_use]
pub fn microfacet_weight(f0: DVec3, alpha: f64, v: DVec3, l: DVec3) -> DVec3 {
    if !above_horizon(v, l) {
        return DVec3::ZERO;
    }
    microfacet_eval(f0, alpha, v, l) * (l.z / microfacet_pdf(alpha, v, l))
}

/// Computes the BRDF of Walter et al. 2007, eq. 20, with Beckmann's D (eq. 25) and the G of Cook and Torrance 1982.
#[must_use]
pub fn cook_torrance_eval(f0: DVec3, alpha: f64, v: DVec3, l: DVec3) -> DVec3 {
    if !above_horizon(v, l) {
        return DVec3::ZERO;
    }
    let h = (v + l).normalize();
    let d = distribution::beckmann_from_vectors(alpha, DVec3::Z, h);
    let g = geometry::v_cavity(h.z, v.z, l.z, v_dot_h(v, l));
    fresnel::schlick(f0, v_dot_h(v, l)) * (g * d / (4.0 * v.z * l.z))
}

/// Samples a direction: mirrors `v` at a normal of Walter et al. 2007, eq. 28 and 29. u.y must be below 1.
#[must_use]
pub fn cook_torrance_sample(alpha: f64, v: DVec3, u: DVec2) -> DVec3 {
    mirrored(v, sampling::beckmann_normal(alpha, u))
}

/// Computes the density of a direction that `cook_torrance_sample` returns, by Walter et al. 2007, eq. 24 and 14: D N.H
/// / (4 V.H).
#[must_use]
pub fn cook_torrance_pdf(alpha: f64, v: DVec3, l: DVec3) -> f64 {
    if !above_horizon(v, l) {
        return 0.0;
    }
    let h = (v + l).normalize();
    distribution::beckmann_from_vectors(alpha, DVec3::Z, h) * h.z / (4.0 * v_dot_h(v, l))
}

/// Computes the BRDF of Gotanda 2010, eq. 4 to 6, with 2^(-n/2) instead of the printed 2^(n/2), and without the printed
/// factor R_d / pi before the specular part.
#[must_use]
pub fn tri_ace_eval(albedo: DVec3, f0: DVec3, exponent: f64, v: DVec3, l: DVec3) -> DVec3 {
    if !above_horizon(v, l) {
        return DVec3::ZERO;
    }
    let h = (v + l).normalize();
    let normalisation = (exponent + 2.0) / (4.0 * PI * (2.0 - 2.0_f64.powf(-exponent / 2.0)));
    let specular =
        fresnel::schlick(f0, v_dot_h(v, l)) * (normalisation * h.z.powf(exponent) / v.z.max(l.z));
    albedo / PI * (DVec3::ONE - fresnel::schlick(f0, l.z)) + specular
}

/// Samples a direction. For u.x < 1/2 the direction is cosine-distributed. Otherwise `v` is mirrored at a normal with
/// cos = (1 - u.y)^(1 / (n + 1)), and u.y must be below 1. In both cases, u.x is scaled to 0..=1 before its use.
#[must_use]
pub fn tri_ace_sample(exponent: f64, v: DVec3, u: DVec2) -> DVec3 {
    if u.x < 0.5 {
        return sampling::cosine_hemisphere(DVec2::new(2.0 * u.x, u.y));
    }
    let log_cos = (-u.y).ln_1p() / (exponent + 1.0);
    let sin = (-(2.0 * log_cos).exp_m1()).sqrt();
    mirrored(v, sampling::turned(2.0 * u.x - 1.0, sin, log_cos.exp()))
}

/// Computes the density of a direction that `tri_ace_sample` returns: the mean of cos / pi and of (n + 1) / (2 pi)
/// (N.H)^n / (4 V.H).
#[must_use]
pub fn tri_ace_pdf(exponent: f64, v: DVec3, l: DVec3) -> f64 {
    if !above_horizon(v, l) {
        return 0.0;
    }
    let h = (v + l).normalize();
    let specular = (exponent + 1.0) / TAU * h.z.powf(exponent) / (4.0 * v_dot_h(v, l));
    f64::midpoint(lambert_pdf(l), specular)
}

/// Returns directions `l` above the horizon with their weights in sr, for integrals over the hemisphere. The sum of
/// f(l) times the weight of l approximates the integral of f. The rule is accurate for smooth functions, and for lobes
/// of width `alpha` around the mirror direction of `v`.
///
/// The function chooses half vectors, and mirrors `v` at each of them to get `l`. A solid angle dh of half vectors
/// gives the solid angle dl = 4 V.H dh of directions. For each azimuth, the polar angle of the half vectors ends where
/// `l` meets the horizon. There the integrand jumps to 0, and a rule across this jump would lose its accuracy. `v` must
/// be above the horizon. The integrand must be symmetric about the plane of `v` and the normal, as a BRDF is.
#[must_use]
pub fn half_vector_rule(alpha: f64, v: DVec3, rings: u32, spokes: u32) -> Vec<(DVec3, f64)> {
    let sin_v = v.x.hypot(v.y);
    sweep(alpha, v, (rings, spokes), |cos_phi| {
        // L.z = 2 V.H H.z - V.z = sin_v cos_phi sin 2 theta + cos_v cos 2 theta > 0
        FRAC_PI_4 + 0.5 * (sin_v * cos_phi).atan2(v.z)
    })
}

/// Returns the points of the rule: `v` mirrored at half vectors, with weights. At each azimuth, the polar angle of the
/// half vectors goes up to `limit(cos(azimuth))`.
///
/// The rule has `rings` Gauss-Legendre points in y, where theta = alpha sinh(y). So the points cover both a lobe and
/// its tail. Each quarter of azimuth has `spokes` points. The points are denser near azimuths at right angles to the
/// plane of `v`, where `limit` changes quickly if the view is grazing. The integrand is symmetric about that plane, so
/// the azimuths cover only 180 degrees, with twice the weight. Every second half vector is mirrored to the other side
/// of the plane.
fn sweep(
    alpha: f64,
    v: DVec3,
    (rings, spokes): (u32, u32),
    limit: impl Fn(f64) -> f64,
) -> Vec<(DVec3, f64)> {
    let forward = DVec3::new(v.x, v.y, 0.0).normalize_or(DVec3::X);
    let side = DVec3::Z.cross(forward);
    let (rings, spokes) = (gauss_legendre(rings), gauss_legendre(spokes));
    let quarters = [0.0, FRAC_PI_2];
    let azimuths = quarters
        .iter()
        .flat_map(|quarter| spokes.iter().map(move |(x, w)| (quarter + x * FRAC_PI_2, w)));
    let mut rule = Vec::with_capacity(quarters.len() * spokes.len() * rings.len());
    for (phi, spoke_weight) in azimuths {
        let (sin_phi, cos_phi) = phi.sin_cos();
        let y_end = (limit(cos_phi) / alpha).asinh();
        for (x, ring_weight) in &rings {
            let y = x * y_end;
            let (sin, cos) = (alpha * y.sinh()).sin_cos();
            let side = if rule.len() % 2 == 0 { side } else { -side };
            let h = (forward * cos_phi + side * sin_phi) * sin + DVec3::Z * cos;
            let d_theta = ring_weight * y_end * alpha * y.cosh();
            let d_phi = 2.0 * spoke_weight * FRAC_PI_2;
            rule.push((mirrored(v, h), 4.0 * v.dot(h) * sin * d_theta * d_phi));
        }
    }
    rule
}

/// Computes the integral of `f` over the directions above the horizon. The function uses [`half_vector_rule`] with
/// enough points for lobes of width 0.01 seen at 89 degrees: the relative error is at most 1e-5, or 1e-3 for Cook and
/// Torrance's G, which has kinks.
#[must_use]
pub fn integral(alpha: f64, v: DVec3, f: impl Fn(DVec3) -> f64) -> f64 {
    half_vector_rule(alpha, v, 40, 40).into_iter().map(|(l, weight)| f(l) * weight).sum()
}

fn above_horizon(v: DVec3, l: DVec3) -> bool {
    v.z > 0.0 && l.z > 0.0
}

/// Computes V.H, which equals L.H for unit vectors. The function returns the mean of both, so that the result stays
/// exactly the same if `v` and `l` are exchanged.
fn v_dot_h(v: DVec3, l: DVec3) -> f64 {
    (v + l).normalize().dot(v + l) / 2.0
}

fn mirrored(v: DVec3, h: DVec3) -> DVec3 {
    2.0 * v.dot(h) * h - v
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Pairs of a width and a view direction: widths from narrow to wide lobes, and views from straight above to 89
    /// degrees.
    fn views() -> impl Iterator<Item = (f64, DVec3)> {
        let alphas = [0.01, 0.1, 0.5, 1.0];
        let angles = [0.0, 30.0, 60.0, 80.0, 89.0];
        alphas.into_iter().flat_map(move |alpha| angles.map(|angle| (alpha, view(angle))))
    }

    fn view(degrees: f64) -> DVec3 {
        let (sin, cos) = degrees.to_radians().sin_cos();
        DVec3::new(0.6 * sin, -0.8 * sin, cos)
    }

    /// The solid angle to which `sample` maps a small square around `u`, divided by the square's area. The function
    /// computes this ratio by central differences. The ratio is the reciprocal of the density.
    fn spread(sample: impl Fn(DVec2) -> DVec3, u: DVec2) -> f64 {
        let step = 1e-5;
        let x = sample(u + DVec2::X * step) - sample(u - DVec2::X * step);
        let y = sample(u + DVec2::Y * step) - sample(u - DVec2::Y * step);
        x.cross(y).length() / (4.0 * step * step)
    }

    #[test]
    fn rules_cover_the_hemisphere() {
        for (alpha, v) in views() {
            assert!((integral(alpha, v, |_| 1.0) / TAU - 1.0).abs() < 1e-4, "{alpha}, {v}");
            assert!((integral(alpha, v, |l| l.z) / PI - 1.0).abs() < 1e-4, "{alpha}, {v}");
        }
        assert!(half_vector_rule(0.3, view(89.0), 9, 9).iter().all(|(l, _)| l.z > 0.0));
    }

    #[test]
    fn lambert_returns_its_albedo() {
        let albedo = DVec3::new(0.0, 0.5, 1.0);
        for (alpha, v) in views() {
            let green = integral(alpha, v, |l| lambert_eval(albedo, v, l).y * l.z);
            assert!((green - 0.5).abs() < 1e-4, "{green}");
        }
        let back = DVec3::new(0.6, 0.0, -0.8);
        assert_eq!(lambert_eval(albedo, DVec3::Z, back), DVec3::ZERO);
        assert_eq!(lambert_eval(albedo, back, DVec3::Z), DVec3::ZERO);
        assert_eq!(lambert_pdf(back), 0.0);
    }

    #[test]
    fn widest_ggx_has_closed_forms() {
        // At alpha = 1, D = 1 / pi and G / (4 v l) = 1 / (2 (v + l)). So the furnace returns the integral of l / (v +
        // l), which is 1 - ln 2 from straight above. The density is constant.
        for angle in [0.0, 45.0, 80.0, 89.0] {
            let v = view(angle);
            let furnace = integral(1.0, v, |l| microfacet_eval(DVec3::ONE, 1.0, v, l).x * l.z);
            let expected = 1.0 - v.z * ((1.0 + v.z) / v.z).ln();
            assert!((furnace - expected).abs() < 1e-5, "{angle}: {furnace}, {expected}");
            let sampled = integral(1.0, v, |l| microfacet_pdf(1.0, v, l));
            assert!((sampled - 1.0 / (1.0 + v.z)).abs() < 1e-7, "{angle}: {sampled}");
        }
    }

    #[test]
    fn densities_from_above_have_closed_forms() {
        // Light is above the horizon for normals within 45 degrees of the view.
        for alpha in [0.01, 0.1, 0.5, 1.0] {
            let density = |pdf: &dyn Fn(DVec3) -> f64| integral(alpha, DVec3::Z, pdf);
            let ggx = density(&|l| microfacet_pdf(alpha, DVec3::Z, l));
            assert!((ggx - 1.0 / (1.0 + alpha * alpha)).abs() < 1e-6, "{alpha}: {ggx}");
            let beckmann = density(&|l| cook_torrance_pdf(alpha, DVec3::Z, l));
            let expected = 1.0 - (-1.0 / (alpha * alpha)).exp();
            assert!((beckmann - expected).abs() < 1e-6, "{alpha}: {beckmann}");
            let exponent = 2.0 / (alpha * alpha) - 2.0;
            let blinn = density(&|l| tri_ace_pdf(exponent, DVec3::Z, l));
            let expected = 1.0 - 0.5 * 0.5_f64.powf((exponent + 1.0) / 2.0);
            assert!((blinn - expected).abs() < 1e-6, "{alpha}: {blinn}");
        }
    }

    #[test]
    fn weak_white_furnace() {
        // Heitz 2014, section 5.5: without shadowing, all visible facets reflect, if light below the horizon also
        // counts. The integral of D G1 / (4 N.V) over the sphere is 1.
        for (alpha, v) in views() {
            let sin_v = v.x.hypot(v.y);
            let limit = |cos_phi: f64| FRAC_PI_2 + (sin_v * cos_phi).min(0.0).atan2(v.z);
            let sum: f64 = sweep(alpha, v, (40, 40), limit)
                .into_iter()
                .map(|(l, weight)| {
                    let d = distribution::ggx_from_vectors(alpha, DVec3::Z, (v + l).normalize());
                    weight * d * geometry::smith_g1(alpha, v.z) / (4.0 * v.z)
                })
                .sum();
            assert!((sum - 1.0).abs() < 1e-5, "{alpha}, {v}: {sum}");
        }
    }

    #[test]
    fn samples_have_their_density() {
        for (alpha, v) in views() {
            for u in [(0.1, 0.2), (0.3, 0.7), (0.6, 0.5), (0.8, 0.05), (0.95, 0.9)] {
                let u = DVec2::from(u);
                let exponent = 2.0 / (alpha * alpha) - 2.0;
                let l = microfacet_sample(alpha, v, u);
                let spread_out = spread(|u| microfacet_sample(alpha, v, u), u);
                let product = spread_out * microfacet_pdf(alpha, v, l);
                assert!(l.z <= 0.0 || (product - 1.0).abs() < 1e-5, "GGX {alpha} {v} {u}");
                let l = cook_torrance_sample(alpha, v, u);
                let spread_out = spread(|u| cook_torrance_sample(alpha, v, u), u);
                let product = spread_out * cook_torrance_pdf(alpha, v, l);
                assert!(l.z <= 0.0 || (product - 1.0).abs() < 1e-5, "Beckmann {alpha} {v} {u}");
                // Tests each half of the mixture separately.
                let l = tri_ace_sample(exponent, v, u);
                let spread_out = spread(|u| tri_ace_sample(exponent, v, u), u);
                let cosine = lambert_pdf(l);
                let part = if u.x < 0.5 {
                    0.5 * cosine
                } else {
                    tri_ace_pdf(exponent, v, l) - 0.5 * cosine
                };
                let near = (spread_out * part - 1.0).abs() < 1e-4;
                assert!(l.z <= 0.0 || near, "Blinn-Phong {alpha} {v} {u}");
            }
        }
    }

    #[test]
    fn weights_are_fresnel_times_masking() {
        // The weight in Heitz 2018, eq. 19, is F G2 / G1. The definition must reduce to this weight.
        for (alpha, v) in views() {
            let l = microfacet_sample(alpha, v, DVec2::new(0.3, 0.4));
            if l.z > 0.0 {
                let g2 = geometry::smith_correlated(alpha, v.z, l.z);
                let expected = g2 / geometry::smith_g1(alpha, v.z);
                let weight = microfacet_weight(DVec3::ONE, alpha, v, l).x;
                assert!((weight - expected).abs() < 1e-12, "{alpha} {v}");
                assert!(weight <= 1.0 + 1e-12);
            }
        }
    }

    #[test]
    fn swapped_directions_reflect_the_same() {
        let (v, l) = (view(80.0), DVec3::new(0.0, 0.6, 0.8));
        let f0 = DVec3::splat(0.04);
        for alpha in [0.1, 0.7] {
            let there = microfacet_eval(f0, alpha, v, l);
            assert!(there.abs_diff_eq(microfacet_eval(f0, alpha, l, v), 1e-15));
            let there = cook_torrance_eval(f0, alpha, v, l);
            assert!(there.abs_diff_eq(cook_torrance_eval(f0, alpha, l, v), 1e-15));
        }
        // tri-Ace's diffuse part isn't reciprocal: F(N.L) / pi differs from F(N.V) / pi.
        let gap = tri_ace_eval(DVec3::ONE, f0, 1e4, v, l) - tri_ace_eval(DVec3::ONE, f0, 1e4, l, v);
        let expected = (fresnel::schlick(f0, v.z) - fresnel::schlick(f0, l.z)) / PI;
        assert!(gap.abs_diff_eq(expected, 1e-15));
    }

    #[test]
    fn tri_ace_conserves_energy_to_two_percent() {
        // A lobe without width reflects cos F(cos), and the diffuse part keeps 1 - 1/21 if f0 = 0. The sum is largest
        // at cos = 1/6: 20/21 + 5^5 / 6^6.
        let greatest = 20.0 / 21.0 + 5.0_f64.powi(5) / 6.0_f64.powi(6);
        let exponent = 1e8_f64;
        let alpha = (2.0 / (exponent + 2.0)).sqrt();
        let v = view((1.0_f64 / 6.0).acos().to_degrees());
        let f = |l| tri_ace_eval(DVec3::ONE, DVec3::ZERO, exponent, v, l).x * l.z;
        let furnace = integral(alpha, v, f);
        assert!((furnace - greatest).abs() < 1e-4, "{furnace}, {greatest}");
    }
}
