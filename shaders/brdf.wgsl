// Whole reflectances in the local frame: +Z is the normal, `v` and `l` are unit vectors.
//
// `x_eval` returns the BRDF in 1/sr, without the cosine; `x_sample` a direction for light,
// which may lie below the horizon; `x_pdf` its density in 1/sr. At and below the horizon,
// for `v` or `l`, both BRDF and density are 0: such a sample counts, with weight 0.
//
// The functions evaluate lobes from the half vector before it is normalised: in v + l each component
// is as exact as an f32 can be, so no lobe is too narrow. (A normalised, rounded H is off by up to
// 1e-7, which at alpha = 1e-4 moves D by 0.2 %.) `alpha` lies in 1e-4..=1; a mirror has no BRDF.

import package::distribution::{beckmann_lobe, ggx_lobe, power_of_cosine};
import package::fresnel::schlick;
import package::geometry::{projected_width, smith_correlated_visibility, v_cavity_visibility};
import package::math::{INV_TAU, PI};
import package::sampling::{
    beckmann_normal, cosine_hemisphere, cosine_hemisphere_pdf, ggx_visible_normal,
    minus_log_of_rest, turned,
};

/// The half vector of two directions, and the numbers that a BRDF needs of it.
struct Half {
    cos2: f32, // (N.H)^2
    sin2: f32, // 1 - (N.H)^2
    n_dot_h: f32,
    v_dot_h: f32,
}

/// V.H is |v + l| / 2, half the diagonal of a rhombus. dot(v, h) is equal, but loses digits
/// where V approaches -L, and changes when v and l are swapped. Both directions are above
/// the horizon, one of them by at least 1e-18: otherwise the square of v + l may be 0.
fn half_vector(v: vec3f, l: vec3f) -> Half {
    let m = v + l;
    let xy2 = dot(m.xy, m.xy);
    let z2 = m.z * m.z;
    let length2 = xy2 + z2;
    let length = sqrt(length2);
    return Half(z2 / length2, xy2 / length2, m.z / length, 0.5 * length);
}

fn above_horizon(v: vec3f, l: vec3f) -> bool {
    // Written as "not below", so that a NaN passes and shows.
    return !(v.z <= 0.0 || l.z <= 0.0);
}

/// Ideal diffuse reflection: albedo / pi. Lambert 1760.
fn lambert_eval(albedo: vec3f, v: vec3f, l: vec3f) -> vec3f {
    return select(vec3f(), albedo / PI, above_horizon(v, l));
}

/// Samples in proportion to the cosine: the weight, f cos / pdf, is the albedo for each of them.
fn lambert_sample(u: vec2f) -> vec3f {
    return cosine_hemisphere(u);
}

fn lambert_pdf(l: vec3f) -> f32 {
    return cosine_hemisphere_pdf(l.z);
}

/// GGX microfacets: D F G / (4 N.L N.V). Walter et al. 2007, eq. 20, with the height-correlated G
/// of Heitz 2014, eq. 99; PV227 lecture 11, "BRDF in Frostbite".
fn microfacet_eval(f0: vec3f, alpha: f32, v: vec3f, l: vec3f) -> vec3f {
    if (!above_horizon(v, l)) {
        return vec3f();
    }
    let h = half_vector(v, l);
    let visibility = smith_correlated_visibility(alpha, v.z, l.z);
    return schlick(f0, h.v_dot_h) * (ggx_lobe(alpha, h.sin2, h.cos2) * visibility);
}

/// `v` mirrored at a normal that is visible from it. Heitz 2018. u.y lies below 1.
fn microfacet_sample(alpha: f32, v: vec3f, u: vec2f) -> vec3f {
    return reflect(-v, ggx_visible_normal(alpha, v, u));
}

/// G1(v) D / (4 N.V): V.H of the density of normals (Heitz 2018, eq. 3) cancels that of the
/// reflection, 1 / (4 V.H) (Walter et al. 2007, eq. 14). G1(v) / N.V has no pole when written out.
fn microfacet_pdf(alpha: f32, v: vec3f, l: vec3f) -> f32 {
    if (!above_horizon(v, l)) {
        return 0.0;
    }
    let h = half_vector(v, l);
    return 0.5 * ggx_lobe(alpha, h.sin2, h.cos2) / (v.z + projected_width(alpha, v.z));
}

/// The weight of a sample of light: f cos / pdf = F G2 / G1(v), in which
/// D and its large numbers cancel. Heitz 2018, eq. 19. Never above F.
fn microfacet_weight(f0: vec3f, alpha: f32, v: vec3f, l: vec3f) -> vec3f {
    if (!above_horizon(v, l)) {
        return vec3f();
    }
    let masking = projected_width(alpha, v.z);
    let shadowing = projected_width(alpha, l.z);
    let visible = l.z * (v.z + masking) / (l.z * masking + v.z * shadowing);
    return schlick(f0, length(0.5 * (v + l))) * visible;
}

/// Cook and Torrance 1982 with today's normalisation: Beckmann's D, V-shaped grooves,
/// and 1/4 in place of 1/pi. Walter et al. 2007, eq. 20. Infinite only if the value
/// exceeds an f32: if both cosines are so small that D / (4 N.L N.V) exceeds 3.4e38.
fn cook_torrance_eval(f0: vec3f, alpha: f32, v: vec3f, l: vec3f) -> vec3f {
    if (!above_horizon(v, l)) {
        return vec3f();
    }
    let h = half_vector(v, l);
    let visibility = v_cavity_visibility(h.n_dot_h, v.z, l.z, h.v_dot_h);
    return schlick(f0, h.v_dot_h) * (beckmann_lobe(alpha, h.sin2, h.cos2) * visibility);
}

/// `v` mirrored at a normal of Beckmann's distribution. The weight of a sample is at most 2 F: it
/// is F G V.H / (N.H N.V), and G at most 2 N.H N.V / V.H. u.y lies below 1.
fn cook_torrance_sample(alpha: f32, v: vec3f, u: vec2f) -> vec3f {
    return reflect(-v, beckmann_normal(alpha, u));
}

/// D N.H / (4 V.H). Walter et al. 2007, eq. 24 and 14.
fn cook_torrance_pdf(alpha: f32, v: vec3f, l: vec3f) -> f32 {
    if (!above_horizon(v, l)) {
        return 0.0;
    }
    let h = half_vector(v, l);
    return beckmann_lobe(alpha, h.sin2, h.cos2) * h.n_dot_h / (4.0 * h.v_dot_h);
}

/// tri-Ace's Blinn-Phong: Gotanda 2010, eq. 4 to 6, with
/// the corrected 2^(-n/2) and the corrected bracket:
///     albedo / pi (1 - F(N.L)) + (n + 2) / (4 pi (2 - 2^(-n/2))) F(V.H) (N.H)^n / max(N.L, N.V)
///
/// It "basically" conserves energy: directional albedos reach
/// 1.0194, for narrow lobes seen at 80 degrees. The weight of the
/// diffuse part depends only on `l`, so the sum is not reciprocal.
fn tri_ace_eval(albedo: vec3f, f0: vec3f, exponent: f32, v: vec3f, l: vec3f) -> vec3f {
    if (!above_horizon(v, l)) {
        return vec3f();
    }
    let h = half_vector(v, l);
    let lobe = power_of_cosine(exponent, h.n_dot_h, tan2_of_half(h));
    let normalisation = (exponent + 2.0) / (4.0 * PI * (2.0 - exp2(-0.5 * exponent)));
    let specular = schlick(f0, h.v_dot_h) * (normalisation * lobe / max(v.z, l.z));
    return albedo / PI * (1.0 - f0) * schlick_remainder(l.z) + specular;
}

/// 1 - (1 - x)^5, multiplied out: 1 - F(x) is (1 - f0) times this, and keeps its digits where
/// little light gets below the surface.
fn schlick_remainder(x: f32) -> f32 {
    return x * (5.0 - x * (10.0 - x * (10.0 - x * (5.0 - x))));
}

/// Half of the samples are distributed as the cosine, the other half mirrored
/// at normals with density (n + 1) / (2 pi) (N.H)^n: with that exponent, and
/// no cosine, the weight stays finite at grazing. u.y lies below 1.
fn tri_ace_sample(exponent: f32, v: vec3f, u: vec2f) -> vec3f {
    if (u.x < 0.5) {
        return cosine_hemisphere(vec2f(2.0 * u.x, u.y));
    }
    // cos = (1 - u.y)^(1 / (n + 1)) = e^-y. tan^2 of the half angle is tanh(y / 2), from which sine
    // and cosine both keep their digits when the lobe is narrow.
    let q = tanh_of(0.5 * minus_log_of_rest(u.y) / (exponent + 1.0));
    let h = turned(2.0 * u.x - 1.0, 2.0 * sqrt(q) / (1.0 + q), (1.0 - q) / (1.0 + q));
    return reflect(-v, h);
}

fn tri_ace_pdf(exponent: f32, v: vec3f, l: vec3f) -> f32 {
    if (!above_horizon(v, l)) {
        return 0.0;
    }
    let h = half_vector(v, l);
    let lobe = power_of_cosine(exponent, h.n_dot_h, tan2_of_half(h));
    let specular = (exponent + 1.0) * INV_TAU * lobe / (4.0 * h.v_dot_h);
    return 0.5 * (cosine_hemisphere_pdf(l.z) + specular);
}

/// tan^2 of half the angle of the half vector: sin^2 / (1 + cos)^2.
fn tan2_of_half(h: Half) -> f32 {
    let d = 1.0 + h.n_dot_h;
    return h.sin2 / (d * d);
}

/// tanh of x >= 0 with a small relative error, which WGSL doesn't guarantee for its own near 0.
/// Below 1/2 by Lambert's continued fraction, with an error of at most 1e-8; above, nothing cancels.
fn tanh_of(x: f32) -> f32 {
    if (x < 0.5) {
        let x2 = x * x;
        return x / (1.0 + x2 / (3.0 + x2 / (5.0 + x2 / 7.0)));
    }
    let e = exp(-2.0 * x);
    return (1.0 - e) / (1.0 + e);
}
