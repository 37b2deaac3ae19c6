// Reflectances as the sources print them. `shaders/brdf.wgsl` has the corrected ones, with the same
// arguments: directions in the local frame, results without the cosine, unless a comment says otherwise.

import package::brdf::microfacet_eval;
import package::distribution::{beckmann_from_vectors, ggx, ggx_from_vectors};
import package::fresnel::schlick;
import package::geometry::{smith_correlated, v_cavity};
import package::math::PI;

const N: vec3f = vec3f(0.0, 0.0, 1.0);

/// P1. PV227 lecture 11, "what we use in shaders": max(0, N.L) C, with the cosine.
///
/// The result is pi times f cos. That is right if the light's
/// colour means E / pi; then no other term may keep its 1 / pi.
fn lambert(albedo: vec3f, n: vec3f, l: vec3f) -> vec3f {
    return max(0.0, dot(n, l)) * albedo;
}

/// P1. A mixture: the diffuse part without its 1 / pi, the
/// specular part with it. A white furnace returns more than pi.
fn lambert_and_microfacet(albedo: vec3f, f0: vec3f, alpha: f32, v: vec3f, l: vec3f) -> vec3f {
    return albedo + microfacet_eval(f0, alpha, v, l);
}

/// E9. Cook and Torrance 1982 as PV227 lecture 11 quotes it: F / pi D G / (N.L N.V).
///
/// With D normalised so that the integral of D cos is 1, as everywhere
/// today, the factor is 1/4: this form is 4 / pi too bright.
fn cook_torrance(f0: vec3f, alpha: f32, v: vec3f, l: vec3f) -> vec3f {
    let h = normalize(v + l);
    let d = beckmann_from_vectors(alpha, N, h);
    let g = v_cavity(h.z, v.z, l.z, dot(v, h));
    return schlick(f0, dot(v, h)) / PI * (d * g / (l.z * v.z));
}

/// E10. Gotanda 2010, eq. 4, with the printed normalisation (n + 2) / (4 pi (2 - 2^(n/2))) and the
/// bracket where it belongs. The exponent lacks its sign: infinite at n = 2, negative above.
fn tri_ace_normalisation(albedo: vec3f, f0: vec3f, n: f32, v: vec3f, l: vec3f) -> vec3f {
    let h = normalize(v + l);
    let diffuse = 1.0 - schlick(f0, l.z);
    let normalisation = (n + 2.0) / (4.0 * PI * (2.0 - exp2(n / 2.0)));
    let specular = normalisation * schlick(f0, dot(v, h)) * pow(h.z, n) / max(l.z, v.z);
    return albedo / PI * diffuse + specular;
}

/// E11. Gotanda 2010, eq. 4, with the printed bracket and the right normalisation: R_d / pi
/// multiplies the specular part too, so that a black surface has no highlight, and a white one
/// 1 / pi of it.
fn tri_ace_bracket(albedo: vec3f, f0: vec3f, n: f32, v: vec3f, l: vec3f) -> vec3f {
    let h = normalize(v + l);
    let diffuse = 1.0 - schlick(f0, l.z);
    let normalisation = (n + 2.0) / (4.0 * PI * (2.0 - exp2(-n / 2.0)));
    let specular = normalisation * schlick(f0, dot(v, h)) * pow(h.z, n) / max(l.z, v.z);
    return albedo / PI * (diffuse + specular);
}

/// The microfacet BRDF without G, as in many first versions. No facet is hidden:
/// at alpha = 1 a white furnace returns 1 / (2 N.V), which is 57 at 89.5 degrees.
fn microfacet_without_g(f0: vec3f, alpha: f32, v: vec3f, l: vec3f) -> vec3f {
    let h = normalize(v + l);
    return schlick(f0, dot(v, h)) * (ggx_from_vectors(alpha, N, h) / (4.0 * l.z * v.z));
}

/// PV227 lecture 11: "clamp them to be non-zero, e.g. not less than 0.001". Clamps all dot products.
///
/// There is no division by 0, but light from below the horizon is
/// reflected as if it came from just above. The BRDF has to be 0 there.
fn microfacet_of_clamped_dots(f0: vec3f, alpha: f32, v: vec3f, l: vec3f) -> vec3f {
    let h = normalize(v + l);
    let n_dot_v = max(dot(N, v), 0.001);
    let n_dot_l = max(dot(N, l), 0.001);
    let n_dot_h = max(dot(N, h), 0.001);
    let v_dot_h = max(dot(v, h), 0.001);
    let g = smith_correlated(alpha, n_dot_v, n_dot_l);
    return schlick(f0, v_dot_h) * (ggx(alpha, n_dot_h) * g / (4.0 * n_dot_l * n_dot_v));
}
