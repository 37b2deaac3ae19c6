// Light from an environment, reflected by GGX microfacets. PV227 lecture 11, task 2.

import package::environment::radiance;
import package::fresnel::schlick;
import package::geometry::v_cavity;
import package::sampling::{ggx_normal, hammersley_centred, orthonormal_basis};

/// Radiance that a metal or a coat of reflectance `f0` and width `alpha` sends towards `v`,
/// estimated by `samples` (at least 1) microfacet normals. `n` and `v` are unit vectors with
/// N.V > 0; `alpha` is 0, a mirror, or lies in 1e-4..=1.
///
/// Each sample is f L (N.L) / pdf with f = D F G / (4 N.L N.V) (Walter et al. 2007, eq. 20) and
/// pdf = D N.H / (4 V.H) (eq. 24 and 14), so that D cancels: F G V.H / (N.H N.V) L.
/// G is the V-cavity, as in the lecture. It has a property that the Smith forms lack: the weight
/// of a sample never exceeds 2 F, however grazing the view.
fn specular_estimate(f0: vec3f, alpha: f32, n: vec3f, v: vec3f, samples: u32) -> vec3f {
    let n_dot_v = dot(n, v);
    if (alpha == 0.0) {
        // All normals are n, and the V-cavity is 1 there: 2 N.H N.V / V.H = 2.
        return schlick(f0, n_dot_v) * radiance(reflect(-v, n));
    }
    let frame = orthonormal_basis(n);
    var sum = vec3f();
    for (var i = 0u; i < samples; i++) {
        let local = ggx_normal(alpha, hammersley_centred(i, samples));
        let n_dot_h = local.z;
        let h = frame * local;
        let v_dot_h = dot(v, h);
        let l = 2.0 * v_dot_h * h - v;
        let n_dot_l = dot(n, l);
        // Light from below the surface doesn't arrive. Rejecting it, also where V.H < 0 (which
        // implies it), keeps a furnace at or below 1 (64 normals: 1.005, the error of the
        // quadrature). Clamping N.L to a small positive number instead, as the lecture advises,
        // lets it reach 1.3 to 1.7 at grazing.
        if (n_dot_l > 0.0) {
            let g = v_cavity(n_dot_h, n_dot_v, n_dot_l, v_dot_h);
            sum += schlick(f0, v_dot_h) * (g * v_dot_h / (n_dot_h * n_dot_v)) * radiance(l);
        }
    }
    return sum / f32(samples);
}
