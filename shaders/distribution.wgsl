// Distributions of microfacet normals, normalised: the integral of D(h) N.H over the hemisphere is
// 1. Results are densities in 1/sr, 0 at and below the horizon; alpha lies in 1e-4..=1.
//
// Each distribution has two forms. The one from the cosine N.H is as exact as that cosine, which
// is not exact enough for narrow lobes: near 1 an f32 holds an angle only to 2.4e-4, so that
// rounding N.H alone costs 3.8 % of D at alpha = 0.0025. The one from the two vectors keeps all
// digits. Use it wherever alpha may be below 0.1, unless N.H is exact by construction.

import package::math::PI;

/// -ln of the least result that isn't 0: exp(-87) is slightly above the smallest normal
/// f32. This limit also keeps the exponent from overflowing where the cosine vanishes.
const VANISHED: f32 = 87.0;

/// GGX. Walter et al. 2007, eq. 33.
///
/// The common form cos^2 (alpha^2 - 1) + 1 rounds alpha^2 to the next multiple
/// of 6e-8. In alpha^2 cos^2 + sin^2, with sin^2 as a product, nothing cancels.
fn ggx(alpha: f32, n_dot_h: f32) -> f32 {
    if (n_dot_h <= 0.0) {
        return 0.0;
    }
    return ggx_lobe(alpha, sin2_from_cosine(n_dot_h), n_dot_h * n_dot_h);
}

/// GGX of the angle between two unit vectors.
fn ggx_from_vectors(alpha: f32, n: vec3f, h: vec3f) -> f32 {
    let n_dot_h = dot(n, h);
    if (n_dot_h <= 0.0) {
        return 0.0;
    }
    return ggx_lobe(alpha, sin2_from_vectors(n, h), n_dot_h * n_dot_h);
}

/// Beckmann. Walter et al. 2007, eq. 25.
fn beckmann(alpha: f32, n_dot_h: f32) -> f32 {
    if (n_dot_h <= 0.0) {
        return 0.0;
    }
    return beckmann_lobe(alpha, sin2_from_cosine(n_dot_h), n_dot_h * n_dot_h);
}

/// Beckmann of the angle between two unit vectors.
fn beckmann_from_vectors(alpha: f32, n: vec3f, h: vec3f) -> f32 {
    let n_dot_h = dot(n, h);
    if (n_dot_h <= 0.0) {
        return 0.0;
    }
    return beckmann_lobe(alpha, sin2_from_vectors(n, h), n_dot_h * n_dot_h);
}

/// Blinn-Phong. Walter et al. 2007, eq. 30. `exponent` lies in 0..=2e8.
fn blinn_phong(exponent: f32, n_dot_h: f32) -> f32 {
    if (n_dot_h <= 0.0) {
        return 0.0;
    }
    let tan2_half = abs(1.0 - n_dot_h) / (1.0 + n_dot_h);
    return (exponent + 2.0) / (2.0 * PI) * power_of_cosine(exponent, n_dot_h, tan2_half);
}

/// The exponent whose Blinn-Phong lobe has the width of Beckmann's `alpha`: 2 / alpha^2
/// - 2. Walter et al. 2007, section 5.2. As a product, it doesn't cancel near alpha = 1.
fn blinn_phong_exponent(alpha: f32) -> f32 {
    return 2.0 * (1.0 - alpha) * (1.0 + alpha) / (alpha * alpha);
}

/// GGX from squared sine and cosine. It squares the quotient,
/// not its parts: alpha^4 would be close to the least float.
fn ggx_lobe(alpha: f32, sin2: f32, cos2: f32) -> f32 {
    let quotient = alpha / (alpha * alpha * cos2 + sin2);
    return quotient * quotient / PI;
}

/// Beckmann from squared sine and cosine.
fn beckmann_lobe(alpha: f32, sin2: f32, cos2: f32) -> f32 {
    let width2 = alpha * alpha * cos2;
    if (sin2 >= VANISHED * width2) {
        return 0.0;
    }
    return exp(-sin2 / width2) / (PI * width2 * cos2);
}

/// c^n for the cosine c > 0 of an angle. The function also gets tan^2 of half the angle.
///
/// `pow` uses the logarithm of c, for which WGSL allows an absolute error of 2^-21 near
/// 1; an exponent of 20,000 would turn that into 1 %. With q = tan^2 of the half angle,
/// c = (1 - q) / (1 + q) and ln c = -2 artanh q, whose series has no such error. q =
/// 1/3 is 60 degrees; there the first omitted term is q^15 / 15, 1e-8 of the sum.
fn power_of_cosine(n: f32, c: f32, tan2_half: f32) -> f32 {
    var minus_log = -log(c);
    if (tan2_half <= 1.0 / 3.0) {
        let q2 = tan2_half * tan2_half;
        let tail = q2 * (1.0 / 7.0 + q2 * (1.0 / 9.0 + q2 * (1.0 / 11.0 + q2 * (1.0 / 13.0))));
        minus_log = 2.0 * tan2_half * (1.0 + q2 * (1.0 / 3.0 + q2 * (1.0 / 5.0 + tail)));
    }
    let exponent = n * minus_log;
    if (exponent >= VANISHED) {
        return 0.0;
    }
    return exp(-exponent);
}

/// Squared sine of the angle with cosine `c`. A dot product of unit vectors may
/// round to just above 1, where the square would be negative and GGX have a
/// pole. `abs` mirrors it to just below 1 and, unlike `max`, lets a NaN through.
fn sin2_from_cosine(c: f32) -> f32 {
    return abs(1.0 - c) * (1.0 + c);
}

/// Squared sine of the angle between unit vectors, |N x H|^2. N x H = N x (H -
/// N): the difference of close vectors is exact, while their products are not.
fn sin2_from_vectors(n: vec3f, h: vec3f) -> f32 {
    let perpendicular = cross(n, h - n);
    return dot(perpendicular, perpendicular);
}
