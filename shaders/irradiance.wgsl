// Light from an environment, reflected by a Lambertian. PV227 lecture 11, task 1.

import package::environment::radiance;
import package::sampling::{hammersley_centred, orthonormal_basis, uniform_hemisphere};

/// Irradiance over pi at a surface with unit normal `n`, estimated by `samples` (at least 1)
/// directions uniform on the hemisphere. Colour times this is the radiance of a Lambertian.
///
/// Each sample is f L cos / pdf = (colour / pi) L (N.L) (2 pi) = 2 colour (N.L) L. The lecture
/// leaves out the 2, so that a white furnace returns half of its light. Centred points make a
/// furnace exact when `samples` is a power of two: then the mean of N.L is 1/2.
fn diffuse_irradiance_estimate(n: vec3f, samples: u32) -> vec3f {
    let frame = orthonormal_basis(n);
    var sum = vec3f();
    for (var i = 0u; i < samples; i++) {
        let l = uniform_hemisphere(hammersley_centred(i, samples));
        let n_dot_l = l.z; // in the local frame
        sum += n_dot_l * radiance(frame * l);
    }
    return 2.0 * sum / f32(samples);
}
