// Light from an environment, reflected by GGX microfacets. PV227 lecture 11, task 2, and the
// approximation of the paper that it builds on: Karis 2013, "Real Shading in Unreal Engine 4".
//
// `n`, `v` and `r` are unit vectors with N.V > 0; `alpha` is 0, a mirror, or
// lies in 1e-4..=1. G is the V-cavity, as in the lecture. Unlike with the Smith
// forms, the weight of a sample never exceeds 2 F, however grazing the view is.
//
// Mesa's software drivers leave a loop once all loops of an invocation together
// have gone round 65,535 times, and the sum is then too small: `samples` may be
// at most that, minus the rounds that other loops of the invocation need.

import package::environment::{mip_level, radiance, radiance_level};
import package::fresnel::schlick;
import package::geometry::v_cavity;
import package::math::pow5;
import package::sampling::{ggx_normal, ggx_normal_pdf, hammersley_centred, orthonormal_basis};

/// Radiance that a metal or a coat of reflectance `f0` and width `alpha` sends towards `v`,
/// estimated by `samples` (1..=65,535) microfacet normals.
///
/// Light from below the surface doesn't arrive. Rejecting it, also for V.H < 0
/// (which implies it), keeps a furnace at or below 1 (64 normals: 1.005, the error
/// of the quadrature). If all cosines were clamped to 0.001 instead, as the lecture
/// advises, it would reach 1.25 to 1.75 within 0.1 degrees of grazing (E15).
fn estimate(f0: vec3f, alpha: f32, n: vec3f, v: vec3f, samples: u32) -> vec3f {
    let n_dot_v = dot(n, v);
    if (alpha == 0.0) {
        return mirror(f0, n, v);
    }
    let frame = orthonormal_basis(n);
    var sum = vec3f();
    for (var i = 0u; i < samples; i++) {
        let local = ggx_normal(alpha, hammersley_centred(i, samples));
        let h = frame * local;
        let v_dot_h = dot(v, h);
        let l = 2.0 * v_dot_h * h - v;
        let n_dot_l = dot(n, l);
        if (n_dot_l > 0.0) {
            let g = weight(local.z, n_dot_v, n_dot_l, v_dot_h);
            sum += schlick(f0, v_dot_h) * g * radiance(l);
        }
    }
    return sum / f32(samples);
}

/// `estimate`, with each sample taken from the mip level whose texels are as large as the solid
/// angle that it stands for. Krivanek and Colbert 2008. `size` is the side of the environment's
/// faces in texels, `samples` lies in 1..=65,535.
///
/// The density needs N.H and the sine in the frame in which the normal was sampled.
/// From the components of `h` in world space it would be right only for upward normals.
fn filtered_estimate(
    f0: vec3f,
    alpha: f32,
    n: vec3f,
    v: vec3f,
    samples: u32,
    size: u32,
) -> vec3f {
    let n_dot_v = dot(n, v);
    if (alpha == 0.0) {
        return mirror(f0, n, v);
    }
    let frame = orthonormal_basis(n);
    var sum = vec3f();
    for (var i = 0u; i < samples; i++) {
        let local = ggx_normal(alpha, hammersley_centred(i, samples));
        let h = frame * local;
        let v_dot_h = dot(v, h);
        let l = 2.0 * v_dot_h * h - v;
        let n_dot_l = dot(n, l);
        if (n_dot_l > 0.0) {
            let pdf = ggx_normal_pdf(alpha, local) / (4.0 * v_dot_h);
            let level = mip_level(pdf, samples, size);
            let g = weight(local.z, n_dot_v, n_dot_l, v_dot_h);
            sum += schlick(f0, v_dot_h) * g * radiance_level(l, level);
        }
    }
    return sum / f32(samples);
}

/// The first half of the split sum: the light about `r`, weighted by N.L, for a
/// surface seen along its normal (N = V = R). `samples` lies in 2..=65,535: a single
/// sample is on the horizon for alpha = 1. Karis 2013, "Pre-filtered environment map".
fn prefiltered(alpha: f32, r: vec3f, samples: u32) -> vec3f {
    if (alpha == 0.0) {
        return radiance(r);
    }
    let frame = orthonormal_basis(r);
    var sum = vec3f();
    var total = 0.0;
    for (var i = 0u; i < samples; i++) {
        let h = ggx_normal(alpha, hammersley_centred(i, samples));
        let l = 2.0 * h.z * h - vec3f(0.0, 0.0, 1.0);
        if (l.z > 0.0) {
            sum += l.z * radiance(frame * l);
            total += l.z;
        }
    }
    return sum / total;
}

/// The second half: scale and offset of f0, the light that a
/// white furnace returns for the two terms of Schlick's F = f0
/// (1 - (1 - V.H)^5) + (1 - V.H)^5. `n_dot_v` lies in 1e-3..=1,
/// `samples` in 1..=65,535. Karis 2013, "Environment BRDF".
///
/// It has the V-cavity in place of Karis' Smith, so that it is the furnace of `estimate`.
fn split_sum_table(alpha: f32, n_dot_v: f32, samples: u32) -> vec2f {
    let v = vec3f(sqrt((1.0 - n_dot_v) * (1.0 + n_dot_v)), 0.0, n_dot_v);
    var sum = vec2f();
    for (var i = 0u; i < samples; i++) {
        let h = ggx_normal(alpha, hammersley_centred(i, samples));
        let v_dot_h = dot(v, h);
        let n_dot_l = 2.0 * v_dot_h * h.z - n_dot_v;
        if (n_dot_l > 0.0) {
            let fc = pow5(abs(1.0 - v_dot_h)); // as in `schlick`: V.H may round to above 1
            sum += weight(h.z, n_dot_v, n_dot_l, v_dot_h) * vec2f(1.0 - fc, fc);
        }
    }
    return sum / f32(samples);
}

/// The split sum: `light` from `prefiltered` about the mirror direction, `table`
/// from `split_sum_table`. Exact for constant light. Otherwise its lobe is round
/// about the mirror direction, where the true reflection stretches at grazing.
fn split_sum(f0: vec3f, table: vec2f, light: vec3f) -> vec3f {
    return light * (f0 * table.x + table.y);
}

/// The level, in a chain of `levels` (at least 2) maps, with the light prefiltered for `alpha`:
/// linear in sqrt(alpha), Karis' roughness, from the mirror at 0 to alpha = 1 at the last level.
///
/// Levels are denser for narrow lobes: of 7 levels, half are for alpha below 1/4.
fn prefiltered_level(alpha: f32, levels: u32) -> f32 {
    return sqrt(alpha) * f32(levels - 1u);
}

/// The width that level `level` of `levels` (at least 2) is prefiltered for: the inverse of
/// `prefiltered_level`.
fn prefiltered_alpha(level: f32, levels: u32) -> f32 {
    let share = level / f32(levels - 1u);
    return share * share;
}

/// The light that a mirror reflects towards `v`. All normals are n, and there the weight is 1.
fn mirror(f0: vec3f, n: vec3f, v: vec3f) -> vec3f {
    return schlick(f0, dot(n, v)) * radiance(reflect(-v, n));
}

/// f (N.L) / (F pdf) with f = D F G / (4 N.L N.V) (Walter et al. 2007, eq. 20) and
/// pdf = D N.H / (4 V.H) (eq. 24 and 14): D cancels, G V.H / (N.H N.V) is left.
fn weight(n_dot_h: f32, n_dot_v: f32, n_dot_l: f32, v_dot_h: f32) -> f32 {
    return v_cavity(n_dot_h, n_dot_v, n_dot_l, v_dot_h) * v_dot_h / (n_dot_h * n_dot_v);
}
