// Directions from random numbers, and their densities. Directions are in the
// local frame: +Z is the normal. Densities are per solid angle, in 1/sr.
//
// The azimuth is 2 pi u - pi rather than 2 pi u, because WGSL bounds the error of sin
// and cos only on [-pi, pi]. This turns every pattern by half a turn, which changes no
// distribution. The code computes 2 pi (u - 1/2): that difference is exact for u >= 1/4.

import package::math::{INV_TAU, PI, TAU};

/// 2^-24, the distance between neighbouring floats in [1/2, 1).
const ULP_BELOW_ONE: f32 = 5.9604644775390625e-8;

/// The unit vector with azimuth 2 pi u - pi and the given sine and cosine of the polar angle.
fn turned(u: f32, sin_theta: f32, cos_theta: f32) -> vec3f {
    let phi = TAU * (u - 0.5);
    return vec3f(sin_theta * cos(phi), sin_theta * sin(phi), cos_theta);
}

/// A direction uniform in solid angle: cos = u.y, azimuth from u.x.
/// PV227 lecture 11, "Uniform sampling for diffuse lighting".
fn uniform_hemisphere(u: vec2f) -> vec3f {
    // As a product: 1 - u.y * u.y would cancel near the pole.
    let sin_theta = sqrt((1.0 - u.y) * (1.0 + u.y));
    return turned(u.x, sin_theta, u.y);
}

/// Density of `uniform_hemisphere` at a direction with cosine `n_dot_l`, in 1/sr.
fn uniform_hemisphere_pdf(n_dot_l: f32) -> f32 {
    if (n_dot_l < 0.0) {
        return 0.0;
    }
    return INV_TAU;
}

/// A direction with density cos / pi: cos = sqrt(1 - u.y), azimuth from u.x. Malley's method,
/// Pharr et al. 2023 (pbrt-v4), section A.5.3.
///
/// u.y = 0 is the top of the sphere. So below u.y = 1, where every sequence
/// here ends, no direction lies on the horizon, where the density is 0.
fn cosine_hemisphere(u: vec2f) -> vec3f {
    return turned(u.x, sqrt(u.y), sqrt(1.0 - u.y));
}

/// Density of `cosine_hemisphere` at a direction with cosine `n_dot_l`, in 1/sr.
fn cosine_hemisphere_pdf(n_dot_l: f32) -> f32 {
    return select(n_dot_l / PI, 0.0, n_dot_l < 0.0);
}

/// A microfacet normal with density D(h) N.H, D being GGX of width `alpha`.
/// Walter et al. 2007, eq. 35 and 36; PV227 lecture 11.
///
/// `alpha` is 0 or lies in 1e-4..=1; alpha = 0 returns the normal itself. sin comes from `alpha`
/// and not from sqrt(1 - cos^2), which has no correct digit left at alpha = 1e-4.
fn ggx_normal(alpha: f32, u: vec2f) -> vec3f {
    // 1 + (alpha^2 - 1) u.y, as a sum of terms that can't cancel.
    let d = (1.0 - u.y) + alpha * alpha * u.y;
    if (d == 0.0) {
        return vec3f(0.0, 0.0, 1.0); // alpha = 0 and u.y = 1, where the formula reads 0 / 0
    }
    let cos_theta = sqrt((1.0 - u.y) / d);
    let sin_theta = alpha * sqrt(u.y / d);
    return turned(u.x, sin_theta, cos_theta);
}

/// Density of `ggx_normal` at a unit vector `h`: D(h) N.H. Walter et al. 2007, eq. 33.
///
/// cos^2 (alpha^2 - 1) + 1 is written as sin^2 + alpha^2 cos^2, with the sine from the vector: the
/// cosine of a unit vector near the normal has no digits left for it. `alpha` lies in 1e-4..=1.
fn ggx_normal_pdf(alpha: f32, h: vec3f) -> f32 {
    if (h.z <= 0.0) {
        return 0.0;
    }
    return ggx(alpha, h) * h.z;
}

/// D of GGX at `h` in the upper hemisphere. It squares the quotient,
/// not its parts: alpha^4 would be close to the least float.
fn ggx(alpha: f32, h: vec3f) -> f32 {
    let quotient = alpha / (dot(h.xy, h.xy) + alpha * alpha * h.z * h.z);
    return quotient * quotient / PI;
}

/// A microfacet normal, sampled as often as it is visible from `v`: with density G1(v) max(0, V.H)
/// D(h) / N.V. Heitz 2018, section 3, with the spherical cap of Dupuy and Benyoub 2023, listing 3.
///
/// Stretched by `alpha`, the microsurface is a hemisphere. Its normals visible from `w`
/// are halfway between `w` and directions c that are uniform on the cap c.z >= -w.z.
///
/// `alpha` lies in 1e-4..=1, `v` in the upper hemisphere or on the horizon, u.y
/// below 1: at u.y = 1, c may be opposite to `w`, and there is no halfway vector.
fn ggx_visible_normal(alpha: f32, v: vec3f, u: vec2f) -> vec3f {
    let w = normalize(vec3f(alpha * v.xy, v.z));
    // c.z = (1 - u.y) (1 + w.z) - w.z. Its sine, from 1 - c.z and 1 + c.z, and the height of
    // c + w are written out, because each of the three can be small, and 1 - w.z cancels too.
    let height = (1.0 - u.y) * (1.0 + w.z);
    let from_top = u.y * (1.0 + w.z);
    let from_bottom = height + dot(w.xy, w.xy) / (1.0 + w.z);
    let c = turned(u.x, sqrt(from_top * from_bottom), 0.0);
    return normalize(vec3f(alpha * (c.xy + w.xy), height));
}

/// Density of `ggx_visible_normal` at a unit vector `h`. Heitz 2018, eq. 3.
///
/// G1(v) / N.V is 2 / (N.V + |stretched v|), which has no pole at grazing.
fn ggx_visible_normal_pdf(alpha: f32, v: vec3f, h: vec3f) -> f32 {
    let v_dot_h = dot(v, h);
    if (v_dot_h <= 0.0 || h.z <= 0.0) {
        return 0.0; // the facet shows its back
    }
    let seen = 2.0 / (v.z + length(vec3f(alpha * v.xy, v.z)));
    return seen * v_dot_h * ggx(alpha, h);
}

/// A microfacet normal with density D(h) N.H, D being Beckmann's of width `alpha`.
/// Walter et al. 2007, eq. 28 and 29.
///
/// `alpha` lies in 0..=1, u.y in 0..1: at 1 the tangent is infinite.
fn beckmann_normal(alpha: f32, u: vec2f) -> vec3f {
    let tan_theta = alpha * sqrt(minus_log_of_rest(u.y));
    let cos_theta = inverseSqrt(1.0 + tan_theta * tan_theta);
    return turned(u.x, tan_theta * cos_theta, cos_theta);
}

/// -ln(1 - x) for 0 <= x < 1.
///
/// Near 1 WGSL bounds the error of log only absolutely: ln 1 may be positive, and the
/// square root of its negative NaN. There this function uses 2 artanh(x / (2 - x)), whose
/// third term is 1e-6 of the first at x = 0.1 and whose fourth is below half an ulp.
fn minus_log_of_rest(x: f32) -> f32 {
    if (x < 0.1) {
        let s = x / (2.0 - x);
        let s2 = s * s;
        return 2.0 * s * (1.0 + s2 * (1.0 / 3.0 + s2 * (1.0 / 5.0)));
    }
    return -log(1.0 - x);
}

/// Density of `beckmann_normal` at a unit vector `h`: D(h) N.H. Walter et al. 2007, eq. 25.
///
/// `alpha` lies in 1e-4..=1. Towards the horizon the exponential vanishes faster than
/// any power of the cosine. Beyond e^-87, the least normal float, the result is 0
/// before the cosine's third power can make it 0 / 0; omitted results are below 1e-30.
fn beckmann_normal_pdf(alpha: f32, h: vec3f) -> f32 {
    if (h.z <= 0.0) {
        return 0.0;
    }
    let sin2 = dot(h.xy, h.xy);
    let width = alpha * h.z;
    if (sin2 > 87.0 * width * width) {
        return 0.0;
    }
    return exp(-sin2 / (width * width)) / (PI * width * width * h.z);
}

/// The bits of `i` mirrored about the binary point: van der Corput's sequence, in [0, 1).
///
/// All 32 bits would round up to exactly 1 for some `i`,
/// so it keeps only the first 24, which convert exactly.
fn radical_inverse(i: u32) -> f32 {
    return unit_float(reverseBits(i));
}

/// Point `i` of the `n`-point Hammersley set, in [0, 1)^2, for i < n <= 2^22.
fn hammersley(i: u32, n: u32) -> vec2f {
    return vec2f(f32(i) / f32(n), radical_inverse(i));
}

/// Point `i` of the `n`-point Hammersley set, moved to the middle of its cell.
///
/// The plain set contains 0 but not 1, so its mean is 1/2 - 1/(2 n), and an estimator that is
/// linear in u.y is too dark by that much. Centred, both means are 1/2 if n is a power of two.
/// No coordinate reaches 1: the greatest radical inverse below n is at least 1/(2 n) below it.
fn hammersley_centred(i: u32, n: u32) -> vec2f {
    return vec2f((f32(i) + 0.5) / f32(n), radical_inverse(i) + 0.5 / f32(n));
}

/// Columns tangent, bitangent, `n`: right-handed, orthonormal for each unit vector
/// `n`, and without the singularity of Frisvad's basis at -Z. Duff et al. 2017.
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

/// From the local frame to the world: r.x T + r.y B + r.z N. PV227 lecture 11.
fn to_world(tangent: vec3f, bitangent: vec3f, n: vec3f, r: vec3f) -> vec3f {
    return r.x * tangent + r.y * bitangent + r.z * n;
}

/// A hash of 32 bits, a permutation: one step of PCG from state `x`, then its output function
/// RXS-M-XS. O'Neill 2014, section 6.3.4; recommended for GPUs by Jarzynski and Olano 2020.
fn pcg(x: u32) -> u32 {
    let state = x * 747796405u + 2891336453u;
    let shifted = (state ^ (state >> ((state >> 28u) + 4u))) * 277803737u;
    return shifted ^ (shifted >> 22u);
}

/// Mixes three numbers into three. Jarzynski and Olano 2020, section 4.1.3, pcg3d.
fn pcg3d(x: vec3u) -> vec3u {
    let mixed = stirred(x * 1664525u + 1013904223u);
    return stirred(mixed ^ (mixed >> vec3u(16u)));
}

/// Each number in turn gains the product of the two others: one round of `pcg3d`.
fn stirred(x: vec3u) -> vec3u {
    var v = x;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    return v;
}

/// The upper 24 bits as a number in [0, 1), exactly.
fn unit_float(bits: u32) -> f32 {
    return f32(bits >> 8u) * ULP_BELOW_ONE;
}

/// A random number in [0, 1) for each `seed`.
fn random(seed: u32) -> f32 {
    return unit_float(pcg(seed));
}

/// A random point of [0, 1)^2 for sample `i` of a pixel.
fn random_point(pixel: vec2u, i: u32) -> vec2f {
    let bits = pcg3d(vec3u(pixel, i));
    return vec2f(unit_float(bits.x), unit_float(bits.y));
}
