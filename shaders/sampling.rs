//! Rust counterpart of `sampling.wgsl`: directions from random numbers, in textbook form.
//!
//! Directions are in the local frame, in which +Z is the normal. Angles are in radians, and densities in 1/sr. Random
//! numbers `u` are in `[0, 1]`. The shader subtracts 180 degrees from each azimuth (`sampling.wgsl` gives the reason).
//! This file multiplies X and Y by -1 instead.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DQuat, DVec2, DVec3, UVec2, UVec3};

/// Samples a direction as in PV227 lecture 11, "Uniform sampling for diffuse lighting": phi = 2 pi u.x, cos = u.y.
#[must_use]
pub fn uniform_hemisphere(u: DVec2) -> DVec3 {
    half_turn(spherical(u.y.acos(), TAU * u.x))
}

/// Computes the density: 1 / (2 pi) at and above the horizon, 0 below.
#[must_use]
pub fn uniform_hemisphere_pdf(n_dot_l: f64) -> f64 {
    if n_dot_l >= 0.0 { TAU.recip() } else { 0.0 }
}

/// Samples a direction by Malley's method (Pharr et al. 2023, pbrt-v4, section A.5.3). The method takes a point that is
/// uniformly distributed on the disk, with radius sqrt(u.y), and lifts it to the hemisphere.
#[must_use]
pub fn cosine_hemisphere(u: DVec2) -> DVec3 {
    half_turn(spherical(u.y.sqrt().asin(), TAU * u.x))
}

/// Computes the density: cos / pi at and above the horizon, 0 below.
#[must_use]
pub fn cosine_hemisphere_pdf(n_dot_l: f64) -> f64 {
    n_dot_l.max(0.0) / PI
}

/// Samples a normal as in Walter et al. 2007, eq. 35 and 36: theta = atan(alpha sqrt(u.y) / sqrt(1 - u.y)).
///
/// `alpha` is the GGX width in 0..=1. For alpha = 0, `atan2` gives theta = 0, the surface's normal, for each `u`.
#[must_use]
pub fn ggx_normal(alpha: f64, u: DVec2) -> DVec3 {
    let theta = (alpha * u.y.sqrt()).atan2((1.0 - u.y).sqrt());
    half_turn(spherical(theta, TAU * u.x))
}

/// Computes Walter et al. 2007, eq. 33, times cos: alpha^2 / (pi cos^3 (alpha^2 + tan^2)^2). At and below the horizon
/// the result is 0.
#[must_use]
pub fn ggx_normal_pdf(alpha: f64, h: DVec3) -> f64 {
    if h.z <= 0.0 {
        return 0.0;
    }
    let alpha2 = alpha * alpha;
    alpha2 / (PI * h.z.powi(3) * (alpha2 + tan2(h)).powi(2))
}

/// Samples a visible normal as in Dupuy and Benyoub 2023, listing 3. In the space in which the surface is a hemisphere,
/// the normal is halfway between the view `w` and a direction that is uniform on the part of the sphere above z = -w.z.
///
/// `v` is in the upper hemisphere or on the horizon, and u.y is below 1.
#[must_use]
pub fn ggx_visible_normal(alpha: f64, v: DVec3, u: DVec2) -> DVec3 {
    let w = DVec3::new(alpha * v.x, alpha * v.y, v.z).normalize();
    // Rounding may exceed the cap by an ulp. Then `acos` would return NaN.
    let cos = ((1.0 - u.y) * (1.0 + w.z) - w.z).clamp(-1.0, 1.0);
    let halfway = half_turn(spherical(cos.acos(), TAU * u.x)) + w;
    DVec3::new(alpha * halfway.x, alpha * halfway.y, halfway.z).normalize()
}

/// Computes the density of Heitz 2018, eq. 3: G1(v) max(0, V.H) D(h) / N.V, with G1 of Walter et al. 2007, eq. 34.
///
/// At N.V = 0 the result is the limit: G1 / N.V approaches 2 / alpha.
#[must_use]
pub fn ggx_visible_normal_pdf(alpha: f64, v: DVec3, h: DVec3) -> f64 {
    if h.z <= 0.0 {
        return 0.0;
    }
    let distribution = ggx_normal_pdf(alpha, h) / h.z;
    let seen = if v.z > 0.0 {
        2.0 / (1.0 + (1.0 + alpha * alpha * tan2(v)).sqrt()) / v.z
    } else {
        2.0 / (alpha * v.x.hypot(v.y))
    };
    seen * v.dot(h).max(0.0) * distribution
}

/// Samples a normal as in Walter et al. 2007, eq. 28 and 29: theta = atan(sqrt(-alpha^2 ln(1 - u.y))), for u.y below 1.
#[must_use]
pub fn beckmann_normal(alpha: f64, u: DVec2) -> DVec3 {
    let theta = (alpha * minus_log_of_rest(u.y).sqrt()).atan();
    half_turn(spherical(theta, TAU * u.x))
}

/// Computes -ln(1 - x), for `x` below 1.
#[must_use]
pub fn minus_log_of_rest(x: f64) -> f64 {
    -(-x).ln_1p()
}

/// Computes Walter et al. 2007, eq. 25, times cos: exp(-tan^2 / alpha^2) / (pi alpha^2 cos^3). At and below the horizon
/// the result is 0.
#[must_use]
pub fn beckmann_normal_pdf(alpha: f64, h: DVec3) -> f64 {
    if h.z <= 0.0 {
        return 0.0;
    }
    let exponential = (-tan2(h) / (alpha * alpha)).exp();
    if exponential == 0.0 {
        return 0.0; // cos^3 may also be 0, but the exponential falls faster
    }
    exponential / (PI * alpha * alpha * h.z.powi(3))
}

/// Computes the radical inverse of Pharr et al. 2023 (pbrt-v4), section 8.6.1, in base 2: digit k of `i` has the weight
/// 2^-(k + 1).
///
/// The function uses all 32 digits, and the shader uses 24 digits, so the results are equal for i < 2^24. For larger
/// `i`, the function's result is larger than the shader's by up to 2^-24.
#[must_use]
pub fn radical_inverse(i: u32) -> f64 {
    (0..u32::BITS)
        .filter(|digit| i >> digit & 1 == 1)
        .map(|digit| 0.5_f64.powi(digit.cast_signed() + 1))
        .sum()
}

/// Returns the point (i / n, radical inverse of i), for i < n, as in Pharr et al. 2023 (pbrt-v4), section 8.6.1.
#[must_use]
pub fn hammersley(i: u32, n: u32) -> DVec2 {
    DVec2::new(f64::from(i) / f64::from(n), radical_inverse(i))
}

/// Returns the point of `hammersley`, moved by half a cell in both coordinates.
#[must_use]
pub fn hammersley_centred(i: u32, n: u32) -> DVec2 {
    hammersley(i, n) + DVec2::splat(0.5 / f64::from(n))
}

/// Computes the basis of Duff et al. 2017 from its geometric meaning. The shortest rotation from +Z to `n` is applied
/// to X and Y. If `n` is in the lower hemisphere, the rotation begins at -Z, and Y is flipped so that the basis stays
/// right-handed.
#[must_use]
pub fn orthonormal_basis(n: DVec3) -> DMat3 {
    let side = if n.z >= 0.0 { 1.0 } else { -1.0 };
    let rotation = DQuat::from_rotation_arc(side * DVec3::Z, n.normalize());
    DMat3::from_cols(rotation * DVec3::X, side * (rotation * DVec3::Y), n)
}

/// Computes r.x T + r.y B + r.z N, the product of `r` and the matrix with the columns T, B and N. PV227 lecture 11.
#[must_use]
pub fn to_world(tangent: DVec3, bitangent: DVec3, n: DVec3, r: DVec3) -> DVec3 {
    DMat3::from_cols(tangent, bitangent, n) * r
}

/// Computes PCG-RXS-M-XS with 32 bits of state (O'Neill 2014, section 6.3.4): one step of the linear congruential
/// generator from `x`, a shift by the number in the top four bits, a product, and a fixed shift. Jarzynski and Olano
/// 2020 use it as a hash.
#[must_use]
pub fn pcg(x: u32) -> u32 {
    let state = modulo(u64::from(x) * 747_796_405 + 2_891_336_453);
    let shift = 4 + state / (1 << 28);
    let word = modulo(u64::from(state ^ state >> shift) * 277_803_737);
    word ^ word >> 22
}

/// Computes pcg3d (Jarzynski and Olano 2020, section 4.1.3): a congruential step of each number, a round in which the
/// product of the other two numbers is added to each number, a shift by half of the bits, and a second round.
#[must_use]
pub fn pcg3d(x: UVec3) -> UVec3 {
    let step = |x: u32| modulo(u64::from(x) * 1_664_525 + 1_013_904_223);
    let mixed = stirred(UVec3::from_array(x.to_array().map(step)));
    stirred(UVec3::from_array(mixed.to_array().map(|x| x ^ x >> 16)))
}

/// Computes one round of `pcg3d`: adds to each number, one after another, the product of the other two.
#[must_use]
pub fn stirred(x: UVec3) -> UVec3 {
    let gain = |a: u32, b: u32, c: u32| modulo(u64::from(b) * u64::from(c) + u64::from(a));
    let first = gain(x.x, x.y, x.z);
    let second = gain(x.y, x.z, first);
    let third = gain(x.z, first, second);
    UVec3::new(first, second, third)
}

/// Returns the upper 24 bits of `bits` as a binary fraction in `[0, 1)`.
#[must_use]
pub fn unit_float(bits: u32) -> f64 {
    f64::from(bits / 256) / f64::from(1 << 24)
}

/// Returns the hash of `seed` as a number in `[0, 1)`.
#[must_use]
pub fn random(seed: u32) -> f64 {
    unit_float(pcg(seed))
}

/// Returns the first two numbers of the hash of `pixel` and `i`, in `[0, 1)`.
#[must_use]
pub fn random_point(pixel: UVec2, i: u32) -> DVec2 {
    let bits = pcg3d(pixel.extend(i));
    DVec2::new(unit_float(bits.x), unit_float(bits.y))
}

/// `x` modulo 2^32, because WGSL's u32 arithmetic wraps.
fn modulo(x: u64) -> u32 {
    u32::try_from(x % (1 << 32)).expect("a remainder of 2^32 has 32 bits")
}

/// The squared tangent of the polar angle of `direction`, a vector of any length.
fn tan2(direction: DVec3) -> f64 {
    direction.truncate().length_squared() / (direction.z * direction.z)
}

/// Returns the unit vector with azimuth 2 pi u - pi, and with the polar angle that has this sine and cosine.
#[must_use]
pub fn turned(u: f64, sin_theta: f64, cos_theta: f64) -> DVec3 {
    let (sin_phi, cos_phi) = (TAU * u - PI).sin_cos();
    DVec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta)
}

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
        // The mean of cos is 1/2 and of cos^2 1/3. The mean of x is 0, and of x^2 and y^2 1/3.
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
        // The share of normals up to theta with tan(theta) = alpha doesn't depend on alpha: it is 1/2.
        for alpha in [1e-4, 0.1, 1.0_f64] {
            let normal = ggx_normal(alpha, DVec2::new(0.7, 0.5));
            let tangent = normal.x.hypot(normal.y) / normal.z;
            assert!((tangent / alpha - 1.0).abs() < 1e-12, "{alpha}");
        }
        // The lecture has the form cos = sqrt((1 - u) / (1 + (alpha^2 - 1) u)).
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

    const VIEWS: [DVec3; 4] = [
        DVec3::Z,
        DVec3::new(0.6, 0.0, 0.8),
        DVec3::new(-0.48, 0.8, 0.36),
        DVec3::new(0.28, -0.96, 0.0), // a grazing view
    ];

    /// The integral of `f` over the hemisphere by a midpoint rule. Its error falls with the square of the step.
    fn integral(f: impl Fn(DVec3) -> f64) -> f64 {
        let (rings, sectors) = (800, 400);
        let (d_theta, d_phi) = (PI / 2.0 / f64::from(rings), TAU / f64::from(sectors));
        let ring = |i: i32| {
            let theta = (f64::from(i) + 0.5) * d_theta;
            let sector = |j: i32| f(spherical(theta, (f64::from(j) + 0.5) * d_phi));
            (0..sectors).map(sector).sum::<f64>() * theta.sin() * d_theta * d_phi
        };
        (0..rings).map(ring).sum()
    }

    /// Checks a sampler's density. A map of the unit square has the density `pdf` exactly if it scales small squares by
    /// 1 / `pdf`: the length of ds/du x ds/dv, times `pdf`, is 1. Central differences with steps of 1e-5 have an error
    /// of 1e-10 times a third derivative, which is at most a few hundred.
    fn assert_density(sample: impl Fn(DVec2) -> DVec3, pdf: impl Fn(DVec3) -> f64, what: &str) {
        const STEP: f64 = 1e-5;
        for (x, y) in (1..12).flat_map(|x| (1..12).map(move |y| (x, y))) {
            let u = DVec2::new(f64::from(x), f64::from(y)) / 12.0;
            let slope = |d: DVec2| (sample(u + STEP * d) - sample(u - STEP * d)) / (2.0 * STEP);
            let growth = slope(DVec2::X).cross(slope(DVec2::Y)).length();
            let product = growth * pdf(sample(u));
            assert!((product - 1.0).abs() < 1e-6, "{what} at {u}: {product}");
        }
    }

    #[test]
    fn densities_are_those_of_the_samplers() {
        assert_density(uniform_hemisphere, |l| uniform_hemisphere_pdf(l.z), "uniform");
        assert_density(cosine_hemisphere, |l| cosine_hemisphere_pdf(l.z), "cosine");
        for alpha in [0.05, 0.3, 1.0] {
            let what = format!("GGX {alpha}");
            assert_density(|u| ggx_normal(alpha, u), |h| ggx_normal_pdf(alpha, h), &what);
            let what = format!("Beckmann {alpha}");
            assert_density(|u| beckmann_normal(alpha, u), |h| beckmann_normal_pdf(alpha, h), &what);
            for v in VIEWS {
                let what = format!("GGX {alpha} from {v}");
                let sample = |u| ggx_visible_normal(alpha, v, u);
                assert_density(sample, |h| ggx_visible_normal_pdf(alpha, v, h), &what);
            }
        }
    }

    #[test]
    fn densities_integrate_to_one() {
        let one = |total: f64, what: &str| assert!((total - 1.0).abs() < 2e-4, "{what}: {total}");
        one(integral(|l| uniform_hemisphere_pdf(l.z)), "uniform");
        one(integral(|l| cosine_hemisphere_pdf(l.z)), "cosine");
        for alpha in [0.1, 0.4, 1.0] {
            one(integral(|h| ggx_normal_pdf(alpha, h)), "GGX");
            one(integral(|h| beckmann_normal_pdf(alpha, h)), "Beckmann");
            for v in VIEWS {
                one(integral(|h| ggx_visible_normal_pdf(alpha, v, h)), "visible GGX");
            }
        }
    }

    #[test]
    fn nothing_comes_from_below() {
        let below = DVec3::new(0.6, 0.0, -0.8);
        assert_eq!(cosine_hemisphere_pdf(below.z), 0.0);
        assert_eq!(ggx_normal_pdf(0.5, below), 0.0);
        assert_eq!(beckmann_normal_pdf(0.5, below), 0.0);
        assert_eq!(ggx_visible_normal_pdf(0.5, DVec3::Z, below), 0.0);
        // The normal is above the horizon, but faces away from the view.
        let v = DVec3::new(-0.96, 0.0, 0.28);
        assert_eq!(ggx_visible_normal_pdf(0.5, v, DVec3::new(0.6, 0.0, 0.8)), 0.0);
    }

    #[test]
    fn cosine_moments() {
        // The mean of cos is 2/3, of cos^2 1/2, and of x^2 1/4.
        assert!((mean(|u| cosine_hemisphere(u).z) - 2.0 / 3.0).abs() < 1e-5);
        assert!((mean(|u| cosine_hemisphere(u).z.powi(2)) - 0.5).abs() < 1e-12);
        assert!((mean(|u| cosine_hemisphere(u).x.powi(2)) - 0.25).abs() < 1e-3);
    }

    #[test]
    fn cumulative_distributions_invert_the_samplers() {
        // P(tan <= t) is t^2 / (alpha^2 + t^2) for GGX, and 1 - exp(-t^2 / alpha^2) for Beckmann.
        for alpha in [1e-3, 0.2, 1.0_f64] {
            for u in [1e-9, 0.1, 0.5, 0.9, 0.9999] {
                let ggx = tan2(ggx_normal(alpha, DVec2::new(0.3, u)));
                assert!((ggx / (alpha * alpha + ggx) - u).abs() < 1e-12, "{alpha}, {u}");
                let beckmann = tan2(beckmann_normal(alpha, DVec2::new(0.3, u)));
                let share = 1.0 - (-beckmann / (alpha * alpha)).exp();
                assert!((share - u).abs() < 1e-12, "{alpha}, {u}");
            }
        }
    }

    #[test]
    fn all_normals_are_visible_from_above() {
        // At normal incidence G1 is 1, so all normals are visible.
        for u in [DVec2::new(0.2, 0.7), DVec2::new(0.9, 0.01), DVec2::new(0.5, 0.999)] {
            let seen = ggx_visible_normal(0.3, DVec3::Z, u);
            assert!(seen.abs_diff_eq(ggx_normal(0.3, u), 1e-12), "{u}");
        }
        let h = DVec3::new(0.36, 0.48, 0.8);
        let densities = [ggx_visible_normal_pdf(0.3, DVec3::Z, h), ggx_normal_pdf(0.3, h)];
        assert!((densities[0] / densities[1] - 1.0).abs() < 1e-14);
    }

    #[test]
    fn the_mean_visible_normal() {
        // Compares the mean over samples with the integral over the density.
        for (alpha, v) in [0.2, 0.7].into_iter().flat_map(|alpha| VIEWS.map(|v| (alpha, v))) {
            let sampled = DVec3::from_array(
                [DVec3::X, DVec3::Y, DVec3::Z]
                    .map(|axis| mean(|u| ggx_visible_normal(alpha, v, u).dot(axis))),
            );
            let integrated = DVec3::from_array(
                [DVec3::X, DVec3::Y, DVec3::Z]
                    .map(|axis| integral(|h| ggx_visible_normal_pdf(alpha, v, h) * h.dot(axis))),
            );
            assert!(sampled.abs_diff_eq(integrated, 1e-3), "{alpha}, {v}: {sampled}");
        }
    }

    #[test]
    fn hashes_have_no_order_left() {
        // The expected numbers come from implementations in other languages.
        assert_eq!(pcg(0), 129_708_002);
        let n = 1 << 16;
        // If any bit of the input flips, each bit of the result flips for half of the inputs.
        for bit in 0..32 {
            let flipped: u32 = (0..1024).map(|x| (pcg(x) ^ pcg(x ^ 1 << bit)).count_ones()).sum();
            let share = f64::from(flipped) / (1024.0 * 32.0);
            assert!((share - 0.5).abs() < 0.02, "bit {bit}: {share}");
        }
        // The mean is 1/2, and the mean square 1/3. The tolerance is 6 standard deviations of 1 / sqrt(12 n) and 0.3 /
        // sqrt n.
        let moment = |power| (0..n).map(|i| random(i).powi(power)).sum::<f64>() / f64::from(n);
        assert!((moment(1) - 0.5).abs() < 6.0 * 0.289 / 256.0);
        assert!((moment(2) - 1.0 / 3.0).abs() < 6.0 * 0.298 / 256.0);
        // Neighbouring pixels don't correlate: the mean of x y is 1/4.
        let product: f64 = (0..n)
            .map(|i| {
                let pixel = UVec2::new(i % 256, i / 256);
                random_point(pixel, 0).x * random_point(pixel + UVec2::X, 0).x
            })
            .sum();
        assert!((product / f64::from(n) - 0.25).abs() < 6.0 * 0.22 / 256.0);
    }

    #[test]
    fn a_hash_of_32_bits_is_a_permutation() {
        // Testing all 2^32 values would take too long. 2^20 values of a random function would collide 128 times.
        let mut values: Vec<u32> = (0..1 << 20).map(pcg).collect();
        values.sort_unstable();
        values.dedup();
        assert_eq!(values.len(), 1 << 20);
    }

    #[test]
    fn the_frame_of_the_lecture() {
        let world = to_world(DVec3::Y, DVec3::Z, DVec3::X, DVec3::new(1.0, 2.0, 3.0));
        assert_eq!(world, DVec3::new(3.0, 1.0, 2.0));
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
