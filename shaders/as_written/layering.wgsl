// Layers as PV227 lecture 11 defines them.

import package::fresnel::schlick;

/// E16. Adds diffuse and specular light of one surface: light
/// that the interface reflects still reaches the pigment.
///
/// A furnace of the lecture's red plastic (albedo 0.8, f0 0.04) returns 1.58 at
/// 89.6 degrees for alpha = 0.05 and 1.79 at 89.9 degrees for a mirror. The missing
/// factor 2 in the lecture's diffuse sum (E13) hides it: 0.4 in place of 0.8.
fn plastic(base: vec3f, specular: vec3f) -> vec3f {
    return base + specular;
}

/// The weight of light from `l` that crosses the thin coat, is scattered
/// in the base and leaves towards `v`: 1 - F_c(N.V), for any N.L.
///
/// It conserves energy but isn't reciprocal: light that comes along the normal and
/// leaves at a cosine of 0.1 keeps 0.393 of its radiance; in the other direction 0.96.
fn thin_coat_weight(n_dot_v: f32, n_dot_l: f32) -> f32 {
    return 1.0 - schlick(vec3f(0.04), n_dot_v).x;
}
