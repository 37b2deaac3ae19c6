//! Twin of `brdf.wgsl`: whole reflectances in textbook form, and a rule that integrates them.
//!
//! Directions are in the local frame, +Z being the normal; `v` and `l` are unit vectors. A BRDF is
//! in 1/sr and without the cosine, a density in 1/sr; both are 0 where `v` or `l` is at or below
//! the horizon. `f0` and `albedo` are reflectances per channel, `alpha` a width in (0, 1].

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use glam::{DVec2, DVec3};

use crate::{distribution, fresnel, geometry, sampling};

/// Lambert 1760: albedo / pi.
#[must_use]
pub fn lambert_eval(albedo: DVec3, v: DVec3, l: DVec3) -> DVec3 {
    if above_horizon(v, l) { albedo / PI } else { DVec3::ZERO }
}

/// See `sampling::cosine_hemisphere`.
#[must_use]
pub fn lambert_sample(u: DVec2) -> DVec3 {
    sampling::cosine_hemisphere(u)
}

/// cos / pi.
#[must_use]
pub fn lambert_pdf(l: DVec3) -> f64 {
    l.z.max(0.0) / PI
}

/// Walter et al. 2007, eq. 20: F G D / (4 N.L N.V), with D of eq. 33, G of Heitz 2014, eq. 99.
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

/// Heitz 2018: `v` mirrored at a normal that is visible from it, for u.y below 1.
#[must_use]
pub fn microfacet_sample(alpha: f64, v: DVec3, u: DVec2) -> DVec3 {
    mirrored(v, sampling::ggx_visible_normal(alpha, v, u))
}

/// Heitz 2018, eq. 3 and 17: the density of the normal, divided by 4 V.H.
#[must_use]
pub fn microfacet_pdf(alpha: f64, v: DVec3, l: DVec3) -> f64 {
    if !above_horizon(v, l) {
        return 0.0;
    }
    let d = distribution::ggx_from_vectors(alpha, DVec3::Z, (v + l).normalize());
    let visible = geometry::smith_g1(alpha, v.z) * v_dot_h(v, l) * d / v.z;
    visible / (4.0 * v_dot_h(v, l))
}

/// The weight of a sample by its definition, f cos / pdf.
#[must_use]
pub fn microfacet_weight(f0: DVec3, alpha: f64, v: DVec3, l: DVec3) -> DVec3 {
    if !above_horizon(v, l) {
        return DVec3::ZERO;
    }
    microfacet_eval(f0, alpha, v, l) * (l.z / microfacet_pdf(alpha, v, l))
}

/// Walter et al. 2007, eq. 20, with Beckmann's D of eq. 25 and the G of Cook and Torrance 1982.
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

/// `v` mirrored at a normal of Walter et al. 2007, eq. 28 and 29, for u.y below 1.
#[must_use]
pub fn cook_torrance_sample(alpha: f64, v: DVec3, u: DVec2) -> DVec3 {
    mirrored(v, sampling::beckmann_normal(alpha, u))
}

/// Walter et al. 2007, eq. 24 and 14: D N.H / (4 V.H).
#[must_use]
pub fn cook_torrance_pdf(alpha: f64, v: DVec3, l: DVec3) -> f64 {
    if !above_horizon(v, l) {
        return 0.0;
    }
    let h = (v + l).normalize();
    distribution::beckmann_from_vectors(alpha, DVec3::Z, h) * h.z / (4.0 * v_dot_h(v, l))
}

/// Gotanda 2010, eq. 4 to 6, with 2^(-n/2) for the printed 2^(n/2), and the specular part outside
/// of R_d / pi.
#[must_use]
pub fn tri_ace_eval(albedo: DVec3, f0: DVec3, exponent: f64, v: DVec3, l: DVec3) -> DVec3 {
    if !above_horizon(v, l) {
        return DVec3::ZERO;
    }
    let h = (v + l).normalize();
    let normalisation = (exponent + 2.0) / (4.0 * PI * (2.0 - 2.0_f64.powf(-exponent / 2.0)));
    let specular = fresnel::schlick(f0, v_dot_h(v, l))
        * (normalisation * h.z.powf(exponent) / v.z.max(l.z));
    albedo / PI * (DVec3::ONE - fresnel::schlick(f0, l.z)) + specular
}

/// For u.x < 1/2 a cosine-distributed direction, else `v` mirrored at a normal with cos = (1 -
/// u.y)^(1 / (n + 1)), for u.y below 1; u.x is stretched to 0..=1 again.
#[must_use]
pub fn tri_ace_sample(exponent: f64, v: DVec3, u: DVec2) -> DVec3 {
    if u.x < 0.5 {
        return sampling::cosine_hemisphere(DVec2::new(2.0 * u.x, u.y));
    }
    let log_cos = (-u.y).ln_1p() / (exponent + 1.0);
    let sin = (-(2.0 * log_cos).exp_m1()).sqrt();
    mirrored(v, sampling::turned(2.0 * u.x - 1.0, sin, log_cos.exp()))
}

/// The mean of cos / pi and of (n + 1) / (2 pi) (N.H)^n / (4 V.H).
#[must_use]
pub fn tri_ace_pdf(exponent: f64, v: DVec3, l: DVec3) -> f64 {
    if !above_horizon(v, l) {
        return 0.0;
    }
    let h = (v + l).normalize();
    let specular = (exponent + 1.0) / TAU * h.z.powf(exponent) / (4.0 * v_dot_h(v, l));
    f64::midpoint(lambert_pdf(l), specular)
}

/// Directions `l` above the horizon with their weights in sr, such that the weighted sum of a
/// function over them is its integral over the hemisphere: for lobes of width `alpha` around the
/// mirror direction of `v` and for what is smooth beside them, to 1e-6 or so.
///
/// The half vector is swept, dl = 4 V.H dh: for each azimuth up to the angle at which `l` meets the
/// horizon, because a rule that steps over an edge can't be of high order. In between, theta =
/// alpha sinh(y) spreads the lobe and its tail evenly; `rings` points of Gauss and Legendre in y,
/// `spokes` in each quarter of azimuth (they crowd at right angles to the plane of `v`, where a grazing
/// view makes the limit steep). The half on one side of that plane is swept; its points alternate
/// between the sides, with twice the weight: a BRDF is symmetric.
///
/// `v` is above the horizon.
#[must_use]
pub fn half_vector_rule(alpha: f64, v: DVec3, rings: u32, spokes: u32) -> Vec<(DVec3, f64)> {
    let (forward, side) = azimuth(v);
    let sin_v = v.x.hypot(v.y);
    let (rings, spokes) = (gauss_legendre(rings), gauss_legendre(spokes));
    let mut rule = Vec::with_capacity(2 * rings.len() * spokes.len());
    for (quarter, (spoke, spoke_weight)) in
        [0.0, FRAC_PI_2].into_iter().flat_map(|quarter| spokes.iter().map(move |s| (quarter, s)))
    {
        let (sin_phi, cos_phi) = (quarter + spoke * FRAC_PI_2).sin_cos();
        // L.z = 2 V.H H.z - V.z = sin_v cos_phi sin 2 theta + cos_v cos 2 theta > 0
        let horizon = FRAC_PI_4 + 0.5 * (sin_v * cos_phi).atan2(v.z);
        let y_end = (horizon / alpha).asinh();
        for (ring, ring_weight) in &rings {
            let y = ring * y_end;
            let (sin, cos) = (alpha * y.sinh()).sin_cos();
            let mirror = if rule.len() % 2 == 0 { side } else { -side };
            let h = (forward * cos_phi + mirror * sin_phi) * sin + DVec3::Z * cos;
            let d_theta = ring_weight * y_end * alpha * y.cosh();
            let d_phi = 2.0 * spoke_weight * FRAC_PI_2;
            rule.push((mirrored(v, h), 4.0 * v.dot(h) * sin * d_theta * d_phi));
        }
    }
    rule
}

/// The sum of `f` over a rule that is fine enough for each view up to 89 degrees.
#[must_use]
pub fn integral(alpha: f64, v: DVec3, f: impl Fn(DVec3) -> f64) -> f64 {
    half_vector_rule(alpha, v, 32, 32).into_iter().map(|(l, weight)| f(l) * weight).sum()
}

/// Points in (0, 1) and weights that integrate polynomials of degree 2 n - 1 exactly. Press et al.
/// 2007, section 4.6: Newton's method on the Legendre polynomial.
#[must_use]
pub fn gauss_legendre(n: u32) -> Vec<(f64, f64)> {
    (0..n)
        .map(|i| {
            let mut x = (PI * (f64::from(i) + 0.75) / (f64::from(n) + 0.5)).cos();
            let mut slope = 1.0;
            // Convergence is quadratic from an error of 1e-3 at most.
            for _ in 0..6 {
                let (mut p, mut before) = (1.0, 0.0);
                for k in 0..n {
                    let k = f64::from(k);
                    (p, before) = (((2.0 * k + 1.0) * x * p - k * before) / (k + 1.0), p);
                }
                slope = f64::from(n) * (x * p - before) / (x * x - 1.0);
                x -= p / slope;
            }
            (0.5 * (1.0 - x), 1.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// Unit vectors in the surface, along the projection of `v` and to its left.
fn azimuth(v: DVec3) -> (DVec3, DVec3) {
    let forward = DVec3::new(v.x, v.y, 0.0).normalize_or(DVec3::X);
    (forward, DVec3::Z.cross(forward))
}

fn above_horizon(v: DVec3, l: DVec3) -> bool {
    v.z > 0.0 && l.z > 0.0
}

/// The mean of V.H and L.H, which are equal for unit vectors.
fn v_dot_h(v: DVec3, l: DVec3) -> f64 {
    (v + l).normalize().dot(v + l) / 2.0
}

fn mirrored(v: DVec3, h: DVec3) -> DVec3 {
    2.0 * v.dot(h) * h - v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn explore() {
        let tri = |al: f64, f0: f64, n: f64, v: DVec3, l: DVec3| {
            tri_ace_eval(DVec3::splat(al), DVec3::splat(f0), n, v, l).x * l.z
        };
        for alpha in [0.001, 0.01, 0.1, 0.5, 1.0] {
            for d in [0.0, 45.0, 80.0, 89.0, 89.9_f64] {
                let v = DVec3::new(d.to_radians().sin(), 0.0, d.to_radians().cos());
                let fs: [(&str, Box<dyn Fn(DVec3) -> f64>); 5] = [
                    ("m", Box::new(move |l| microfacet_eval(DVec3::ONE, alpha, v, l).x * l.z)),
                    ("mp", Box::new(move |l| microfacet_pdf(alpha, v, l))),
                    ("ct", Box::new(move |l| cook_torrance_eval(DVec3::ONE, alpha, v, l).x * l.z)),
                    ("ctp", Box::new(move |l| cook_torrance_pdf(alpha, v, l))),
                    ("tri", Box::new(move |l| tri(1.0, 0.04, 2.0 / (alpha * alpha) - 2.0, v, l))),
                ];
                for (name, f) in &fs {
                    let q = |r, s| half_vector_rule(alpha, v, r, s).into_iter().map(|(l, w)| f(l) * w).sum::<f64>();
                    let exact = q(96, 96);
                    let e = [(16, 16), (24, 24), (32, 32), (48, 48), (16, 48), (48, 16)].map(|(r, s)| format!("{:.1e}", q(r, s) - exact));
                    println!("{name} {alpha} {d} {exact:.7} {e:?}");
                }
                let g = |l: DVec3| { let h = (v + l).normalize(); distribution::ggx_from_vectors(alpha, DVec3::Z, h) / (4.0 * v.z) };
                println!("   no G: ggx {} ", integral(alpha, v, g));
            }
        }
        let mut best = vec![];
        for n in [0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 32.0, 64.0, 128.0, 1e3, 1e4_f64] {
            for d in (0..=89_u32).step_by(5).chain([89]) {
                let d = f64::from(d);
                let v = DVec3::new(d.to_radians().sin(), 0.0, d.to_radians().cos());
                for f0 in [0.0, 0.04, 0.3, 0.6, 0.9, 1.0] {
                    for al in [0.0, 1.0] {
                        let a: f64 = (2.0 / (n + 2.0)).sqrt();
                        best.push((integral(a, v, |l| tri(al, f0, n, v, l)), n, d, f0, al));
                    }
                }
            }
        }
        best.sort_by(|a, b| b.0.total_cmp(&a.0));
        println!("{:?}", &best[..10]);
        println!("{:?}", &best.iter().filter(|b| b.3 == 1.0).take(5).collect::<Vec<_>>());
        println!("{:?}", &best.iter().filter(|b| b.3 == 0.04).take(5).collect::<Vec<_>>());
    }
}
