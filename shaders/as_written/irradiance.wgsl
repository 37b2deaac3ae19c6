// Irradiance as the lecture and the article compute it, kept to show that
// tests find the mistakes. The library's functions are in `irradiance.wgsl`.

import package::environment::radiance;
import package::math::PI;
import package::sampling::{hammersley_centred, orthonormal_basis, uniform_hemisphere};

/// PV227 lecture 11, "Computation of diffuse lighting": the sum of C (N.L) light / #samples.
///
/// Wrong (E13): f cos / pdf is 2 C (N.L), the density of a uniform direction being 1 / (2 pi). A
/// white furnace returns 0.5.
fn estimate(colour: vec3f, n: vec3f, samples: u32) -> vec3f {
    let frame = orthonormal_basis(n);
    var color = vec3f();
    for (var i = 0u; i < samples; i++) {
        let r = uniform_hemisphere(hammersley_centred(i, samples));
        let l = frame * r;
        let light = radiance(l) / f32(samples);
        color += colour * dot(n, l) * light;
    }
    return color;
}

/// The article's shader: phi from 0 below 6.283 and theta from 0 below 1.57
/// in these steps (0.025 and 0.1 there), times pi over the number of terms.
///
/// Wrong: the terms are not Monte Carlo samples (E17), their mean uses 1.6 for pi/2, and counts
/// theta = 0, whose weight is 0, as a whole term (E18): a white furnace returns 0.9805. Finer
/// steps don't reduce the error as more samples would. For normals along Y, `right_of` is NaN
/// (E20), which doesn't show: sampled in the direction NaN, a texture returns some texel.
fn nested_loop(n: vec3f, phi_step: f32, theta_step: f32) -> vec3f {
    let right = right_of(n);
    let up = cross(n, right);

    var sampled_colour = vec3f();
    var index = 0.0;
    for (var phi = 0.0; phi < 6.283; phi += phi_step) {
        for (var theta = 0.0; theta < 1.57; theta += theta_step) {
            let temp = cos(phi) * right + sin(phi) * up;
            let sample_vector = cos(theta) * n + sin(theta) * temp;
            sampled_colour += radiance(sample_vector) * cos(theta) * sin(theta);
            index += 1.0;
        }
    }
    return PI * sampled_colour / index;
}

/// The article's `right`, of unit length and at right angles to the normal and to Y.
///
/// Wrong (E20): along Y the product is 0, and normalising gives 0 / 0. The normals at the
/// middle of two faces are such, and every cube map with an odd side has a texel there.
fn right_of(n: vec3f) -> vec3f {
    let up = vec3f(0.0, 1.0, 0.0);
    return normalize(cross(up, n));
}

/// The article, "Lambert": L(p, w_o) = texCUBE(lambertCubemap, w_o), with the irradiance map bound
/// as `environment`, for a surface with normal `n` seen from `v`.
///
/// Wrong (E7): a Lambertian looks the same from everywhere. Its light
/// depends on its normal, and the article's own map is computed by normal.
fn lambert_lookup_by_outgoing(colour: vec3f, n: vec3f, v: vec3f) -> vec3f {
    return colour * radiance(v);
}

/// The article calls what its map stores irradiance; a Lambertian's radiance is colour / pi times
/// irradiance.
///
/// Both together are wrong (E8): the map's sums are divided by pi already, since pi / N is pi^2
/// / N over pi. Taking the name literally loses a factor of pi: 0.3183 for a white furnace.
fn lambert(colour: vec3f, irradiance: vec3f) -> vec3f {
    return colour / PI * irradiance;
}
