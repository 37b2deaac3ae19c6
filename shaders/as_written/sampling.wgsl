// Sampling as the lecture and older papers define it, kept to show that
// tests find the mistakes. The library's functions are in `sampling.wgsl`.

import package::math::TAU;
import package::sampling::hammersley;

/// PV227 lecture 11, "Uniform sampling for diffuse lighting": the azimuth phi = 2 pi R.x.
///
/// Wrong in WGSL (P6): the error of sin and cos is only bounded on [-pi, pi]. Half
/// of all azimuths are outside, where a conforming driver may return anything.
fn azimuth(u: f32) -> f32 {
    return TAU * u;
}

/// PV227 lecture 11, "Non-uniform importance sampling": cos from R.w and the roughness m, and
/// sin = sqrt(1 - cos^2).
///
/// Wrong in f32 (P3, P4): at m = 0 and R.w = 1 the quotient is 0 / 0. At
/// small m the cosine rounds to 1 and the sine to 0 or to sqrt(2^-23) =
/// 3.5e-4, so that each normal of a smooth surface is in a wrong place.
fn ggx_normal(m: f32, u: vec2f) -> vec3f {
    let phi = TAU * u.x;
    let cos_theta = sqrt((1.0 - u.y) / (1.0 + (m * m - 1.0) * u.y));
    let sin_theta = sqrt(1.0 - cos_theta * cos_theta);
    return vec3f(sin_theta * cos(phi), sin_theta * sin(phi), cos_theta);
}

/// The tangent of the angle that half of all normals stay below, for a
/// `roughness` that goes to the sampler unchanged: PV227 lecture 11.
///
/// A different convention rather than a mistake (E14): the paper that the lecture builds on (Karis
/// 2013) squares the roughness first, so that its lobe is narrower by a factor of the roughness.
fn median_tangent(roughness: f32) -> f32 {
    let cos_theta = sqrt(0.5 / (1.0 + (roughness * roughness - 1.0) * 0.5));
    return sqrt((1.0 - cos_theta) * (1.0 + cos_theta)) / cos_theta;
}

/// The radical inverse by reversing all 32 bits, times 2^-32. Widely printed since Dammertz 2012.
///
/// Wrong for 128 integers, the first of which is 2^25 -
/// 1: they round up to exactly 1, for which 1 - u is 0.
fn radical_inverse(i: u32) -> f32 {
    return f32(reverseBits(i)) * 2.3283064365386963e-10;
}

/// A white furnace, lit by the `n` plain Hammersley points: the mean of 2 cos.
///
/// Wrong: the set contains 0 but not 1, so the furnace loses 1/n of its light.
fn plain_furnace(n: u32) -> f32 {
    var sum = 0.0;
    for (var i = 0u; i < n; i++) {
        sum += 2.0 * hammersley(i, n).y;
    }
    return sum / f32(n);
}

/// Frisvad 2012, listing 3, without its special case: tangent, bitangent, `n`.
///
/// Wrong near -Z: the rounding of n.z is up to a quarter of 1 + n.z, and an axis
/// gets a length of 1.48 instead of 1. At -Z axes are NaN or infinite. The paper's
/// special case only covers n.z < -0.9999999, which is -1 and one more float.
fn frisvad_basis(n: vec3f) -> mat3x3f {
    let a = 1.0 / (1.0 + n.z);
    let b = -n.x * n.y * a;
    return mat3x3f(
        vec3f(1.0 - n.x * n.x * a, b, -n.x),
        vec3f(b, 1.0 - n.y * n.y * a, -n.y),
        n,
    );
}
