// Specular light from an environment, as PV227 lecture 11 and others compute it.

import package::environment::{mip_level, radiance, radiance_level};
import package::fresnel::schlick;
import package::geometry::v_cavity;
import package::math::PI;
import package::sampling::{ggx_normal, hammersley_centred, orthonormal_basis};

/// "For better result, clamp them to be non-zero, e.g. not less than 0.001."
const LEAST: f32 = 0.001;

/// E15. Clamps all dot products and rejects no sample: directions below
/// the surface, from which no light arrives, count with N.L = 0.001.
///
/// The furnace of f0 = 1 exceeds 1 at grazing: at 89.9 degrees it is 1.25 to 1.43 (alpha from 0.01
/// to 1), at 89.95 degrees 1.47 to 1.75.
fn estimate(f0: vec3f, alpha: f32, n: vec3f, v: vec3f, samples: u32) -> vec3f {
    let frame = orthonormal_basis(n);
    let n_dot_v = max(dot(n, v), LEAST);
    var sum = vec3f();
    for (var i = 0u; i < samples; i++) {
        let h = frame * ggx_normal(alpha, hammersley_centred(i, samples));
        let l = reflected(v, h);
        let n_dot_h = max(dot(n, h), LEAST);
        let n_dot_l = max(dot(n, l), LEAST);
        let v_dot_h = max(dot(v, h), LEAST);
        let g = v_cavity(n_dot_h, n_dot_v, n_dot_l, v_dot_h);
        sum += schlick(f0, v_dot_h) * (g * v_dot_h / (n_dot_h * n_dot_v)) * radiance(l);
    }
    return sum / f32(samples);
}

/// E15. L = norm(2 (V.H) H - V) with V.H clamped like all dot products: for V.H < 0 the
/// result is about -V instead of V mirrored at H, so V and L make different angles with H.
///
/// With V.H = -0.6, L.H is 0.6.
fn reflected(v: vec3f, h: vec3f) -> vec3f {
    return normalize(2.0 * max(dot(v, h), LEAST) * h - v);
}

/// Filtered samples with the density in the wrong frame: N.H is read as the
/// third component of H after H was turned into world space. A mistake of
/// engines, not of the lecture, which only proposes to sample higher levels.
///
/// Right for normals along +Z. For alpha = 0.1 and a normal along +X, densities
/// of up to 8 become about 1e-4, and each of 16 samples comes from level 6, the
/// last of a map of 64 texels a side. The mean level should be 3.3.
fn filtered_estimate(
    f0: vec3f,
    alpha: f32,
    n: vec3f,
    v: vec3f,
    samples: u32,
    size: u32,
) -> vec3f {
    let frame = orthonormal_basis(n);
    let n_dot_v = dot(n, v);
    var sum = vec3f();
    for (var i = 0u; i < samples; i++) {
        let h = frame * ggx_normal(alpha, hammersley_centred(i, samples));
        let v_dot_h = dot(v, h);
        let l = 2.0 * v_dot_h * h - v;
        let n_dot_l = dot(n, l);
        if (n_dot_l > 0.0) {
            let n_dot_h = max(h.z, 0.0);
            let ratio = alpha / (alpha * alpha * n_dot_h * n_dot_h + dot(h.xy, h.xy));
            let pdf = ratio * ratio * n_dot_h / (4.0 * PI * v_dot_h) + 1e-4;
            let level = mip_level(pdf, samples, size);
            let g = v_cavity(dot(n, h), n_dot_v, n_dot_l, v_dot_h);
            let weight = g * v_dot_h / (dot(n, h) * n_dot_v);
            sum += schlick(f0, v_dot_h) * weight * radiance_level(l, level);
        }
    }
    return sum / f32(samples);
}
