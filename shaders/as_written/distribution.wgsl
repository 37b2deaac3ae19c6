// Distributions of microfacet normals in common forms that single
// precision breaks. `shaders/distribution.wgsl` has the forms to use.

import package::distribution;
import package::math::PI;

/// Wrong for narrow lobes: cos^2 (alpha^2 - 1) + 1, in Horner's form as engines have it.
///
/// alpha^2 - 1 is rounded to a multiple of 6e-8, and at cos = 1 only alpha^2 should be left: D
/// is 2.6 % too small at alpha = 1e-3, and 1 / 0 below 1.7e-4, where alpha^2 - 1 rounds to -1.
///
/// The form c * c * (alpha2 - 1) + 1 is no better in WGSL, but Mesa treats it as a `mix`
/// of 1 and alpha^2 and computes (1 - c * c) + alpha2 * c * c, which is exact at cos = 1.
fn ggx(alpha: f32, n_dot_h: f32) -> f32 {
    let alpha2 = alpha * alpha;
    let d = (n_dot_h * alpha2 - n_dot_h) * n_dot_h + 1.0;
    return alpha2 / (PI * d * d);
}

/// Wrong for narrow lobes: it takes the cosine first. No form of D can restore
/// the digits that rounding the cosine loses: up to 1.9 % at alpha = 0.0025
/// for the nearest f32, and 3.8 % for a dot product that is off by an ulp.
fn ggx_of_dot_product(alpha: f32, n: vec3f, h: vec3f) -> f32 {
    return distribution::ggx(alpha, dot(n, h));
}
