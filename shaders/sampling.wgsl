// Directions from random numbers. Directions are in the local frame: +Z is the normal.
//
// The azimuth is 2 pi u - pi rather than 2 pi u, because WGSL bounds the error of sin and cos
// only on [-pi, pi]. It turns every pattern by half a turn, which changes no distribution. It is
// computed as 2 pi (u - 1/2): that difference is exact for u >= 1/4.

import package::math::{INV_TAU, TAU};

/// 2^-24, the distance between neighbouring floats in [1/2, 1).
const ULP_BELOW_ONE: f32 = 5.9604644775390625e-8;

/// A direction uniform in solid angle: cos = u.y, azimuth from u.x.
/// PV227 lecture 11, "Uniform sampling for diffuse lighting".
fn uniform_hemisphere(u: vec2f) -> vec3f {
    let phi = TAU * (u.x - 0.5);
    // As a product: 1 - u.y * u.y would cancel near the pole.
    let sin_theta = sqrt((1.0 - u.y) * (1.0 + u.y));
    return vec3f(sin_theta * cos(phi), sin_theta * sin(phi), u.y);
}

/// Density of `uniform_hemisphere` at a direction with cosine `n_dot_l`, in 1/sr.
fn uniform_hemisphere_pdf(n_dot_l: f32) -> f32 {
    return select(0.0, INV_TAU, n_dot_l >= 0.0);
}

/// A microfacet normal with density D(h) N.H, D being GGX of width `alpha`.
/// Walter et al. 2007, eq. 35 and 36; PV227 lecture 11.
///
/// `alpha` is 0 or lies in 1e-4..=1; alpha = 0 returns the normal itself. sin comes from `alpha`
/// and not from sqrt(1 - cos^2), which has no correct digit left at alpha = 1e-4.
fn ggx_normal(alpha: f32, u: vec2f) -> vec3f {
    let phi = TAU * (u.x - 0.5);
    // 1 + (alpha^2 - 1) u.y, as a sum of what can't cancel.
    let d = (1.0 - u.y) + alpha * alpha * u.y;
    if (d == 0.0) {
        return vec3f(0.0, 0.0, 1.0); // alpha = 0 and u.y = 1, where the formula reads 0 / 0
    }
    let cos_theta = sqrt((1.0 - u.y) / d);
    let sin_theta = alpha * sqrt(u.y / d);
    return vec3f(sin_theta * cos(phi), sin_theta * sin(phi), cos_theta);
}

/// The bits of `i` mirrored about the binary point: van der Corput's sequence, in [0, 1).
///
/// All 32 bits would round up to exactly 1 for some `i`, so only the first 24 are kept; they
/// convert exactly.
fn radical_inverse(i: u32) -> f32 {
    return f32(reverseBits(i) >> 8u) * ULP_BELOW_ONE;
}

/// Point `i` of the `n`-point Hammersley set, in [0, 1)^2, for i < n <= 2^22.
fn hammersley(i: u32, n: u32) -> vec2f {
    return vec2f(f32(i) / f32(n), radical_inverse(i));
}

/// Point `i` of the `n`-point Hammersley set, moved to the middle of its cell.
///
/// The plain set holds 0 but not 1, so its mean is 1/2 - 1/(2 n), and an estimator that is
/// linear in u.y is that much too dark. Centred, both means are 1/2 when n is a power of two. No
/// coordinate reaches 1: the greatest radical inverse below n leaves at least 1/(2 n) to it.
fn hammersley_centred(i: u32, n: u32) -> vec2f {
    return vec2f((f32(i) + 0.5) / f32(n), radical_inverse(i) + 0.5 / f32(n));
}

/// Columns tangent, bitangent, `n`: right-handed, orthonormal for each unit vector `n`, and
/// without the singularity that Frisvad's has at -Z. Duff et al. 2017.
fn orthonormal_basis(n: vec3f) -> mat3x3f {
    // +1 for -0.0 too: copysign's -1 would also do, since the divisor is at least 1 either way.
    let z = select(-1.0, 1.0, n.z >= 0.0);
    let a = -1.0 / (z + n.z);
    let b = n.x * n.y * a;
    return mat3x3f(
        vec3f(1.0 + z * n.x * n.x * a, z * b, -z * n.x),
        vec3f(b, z + n.y * n.y * a, -n.y),
        n,
    );
}
