// Light from an environment, reflected by a Lambertian. PV227 lecture 11, task 1; the article,
// "Lambert".
//
// All functions return irradiance over pi, E / pi, the value that an irradiance map stores:
// colour times it is the radiance of a Lambertian, and a white furnace of radiance 1 returns 1.
// There are several methods: samples, sharp or filtered; rings; texels; spherical harmonics.
//
// Mesa's software drivers leave a loop once all loops of an invocation together have gone round
// 65,535 times, and the sum is then too small. The numbers of samples, steps and texels are
// limited accordingly; an invocation that calls several of these functions has to share the limit.

import package::environment::{face_direction, mip_level, radiance, radiance_level};
import package::math::{INV_TAU, PI};
import package::sampling::{
    cosine_hemisphere,
    cosine_hemisphere_pdf,
    hammersley_centred,
    orthonormal_basis,
    turned,
    uniform_hemisphere,
};

/// Estimated by `samples` (1..=65,535) directions uniform on the hemisphere about the unit normal
/// `n`.
///
/// Each sample is f L cos / pdf = (colour / pi) L (N.L) (2 pi) = 2 colour (N.L) L. The
/// lecture omits the 2 (E13), so that a white furnace returns half of its light. Centred
/// points make a furnace exact if `samples` is a power of two: then the mean of N.L is 1/2.
fn estimate(n: vec3f, samples: u32) -> vec3f {
    let frame = orthonormal_basis(n);
    var sum = vec3f();
    for (var i = 0u; i < samples; i++) {
        let l = uniform_hemisphere(hammersley_centred(i, samples));
        let n_dot_l = l.z; // in the local frame
        sum += n_dot_l * radiance(frame * l);
    }
    return 2.0 * sum / f32(samples);
}

/// Estimated by few directions (`samples`, 1..=65,535). Each looks
/// up the mean over its solid angle: a mip level of the environment,
/// whose faces are `size` texels wide. Krivanek and Colbert 2008.
///
/// Directions have density cos / pi, so that each weighs f cos / pdf = 1 and a furnace
/// is exact for any number of samples. Texels near the horizon reach below it, which
/// tints the result with light that the surface doesn't see: the price of few samples.
fn filtered_estimate(n: vec3f, samples: u32, size: u32) -> vec3f {
    let frame = orthonormal_basis(n);
    var sum = vec3f();
    for (var i = 0u; i < samples; i++) {
        let l = cosine_hemisphere(hammersley_centred(i, samples));
        // The cosine with the normal, not with an axis of the world: the local frame's z.
        let level = mip_level(cosine_hemisphere_pdf(l.z), samples, size);
        sum += radiance_level(frame * l, level);
    }
    return sum / f32(samples);
}

/// The rings of the article's loop: azimuths from 0 below 6.283, polar angles from 0 below 1.57.
const LOOP_PHI_STEP: f32 = 0.025;
const LOOP_PHI_STEPS: u32 = 252u;
const LOOP_THETA_STEP: f32 = 0.1;
const LOOP_THETA_STEPS: u32 = 16u;

/// The article's nested loop over azimuth and polar angle, with each term weighted by
/// its true steps. No directions are random: it is a Riemann sum, not Monte Carlo (E17).
///
/// One error remains: 252 steps of 0.025 are 6.3, more than a turn, so a furnace
/// of radiance 1 returns 1.0014. `midpoint` has no such error, at the same cost.
fn loop_corrected(n: vec3f) -> vec3f {
    let frame = orthonormal_basis(n);
    var sum = vec3f();
    for (var i = 0u; i < LOOP_PHI_STEPS; i++) {
        let u = LOOP_PHI_STEP * INV_TAU * f32(i);
        for (var k = 0u; k < LOOP_THETA_STEPS; k++) {
            let theta = LOOP_THETA_STEP * f32(k);
            let weight = cos(theta) * sin(theta);
            sum += weight * radiance(frame * turned(u, sin(theta), cos(theta)));
        }
    }
    return LOOP_PHI_STEP * LOOP_THETA_STEP / PI * sum;
}

/// Midpoint rule over rings and sectors, at least 1 of each, divided by the sum of its weights
/// cos sin: exact for constants with any steps.
/// (`phi_steps` + 1) `theta_steps` is at most 65,535.
fn midpoint(n: vec3f, phi_steps: u32, theta_steps: u32) -> vec3f {
    let frame = orthonormal_basis(n);
    var sum = vec3f();
    var weights = 0.0;
    for (var k = 0u; k < theta_steps; k++) {
        let theta = 0.5 * PI * (f32(k) + 0.5) / f32(theta_steps);
        let weight = cos(theta) * sin(theta);
        var ring = vec3f();
        for (var i = 0u; i < phi_steps; i++) {
            let u = (f32(i) + 0.5) / f32(phi_steps);
            ring += radiance(frame * turned(u, sin(theta), cos(theta)));
        }
        sum += weight * ring;
        weights += weight;
    }
    return sum / (weights * f32(phi_steps));
}

/// Looks up each texel of a cube map with faces `size` (1..=104) texels wide. It
/// adds each direction once: the reference for small maps. Divided by the sum of its
/// weights: exact for constants. 6 times 105^2 texels would be more than 65,535.
fn texel_sum(n: vec3f, size: u32) -> vec3f {
    var sum = vec3f();
    var weights = 0.0;
    for (var i = 0u; i < 6u * size * size; i++) {
        let d = texel_direction(size, i);
        let cosine = dot(n, normalize(d));
        // With this comparison a NaN adds nothing, not even weight, and the result is 0 / 0.
        if (cosine > 0.0) {
            let weight = cosine * texel_density(d);
            sum += weight * radiance(d);
            weights += weight;
        }
    }
    return sum / weights;
}

/// The direction, not of unit length, through the centre of texel `i` < 6 `size`^2, counted by
/// face, row and column.
fn texel_direction(size: u32, i: u32) -> vec3f {
    let in_face = i % (size * size);
    let texel = vec2f(vec2u(in_face % size, in_face / size));
    return face_direction(i / (size * size), (texel + 0.5) / f32(size));
}

/// Solid angle per area at the point `d` of the cube of side 2: cos / distance^2 with the cosine
/// 1 / distance.
fn texel_density(d: vec3f) -> f32 {
    let squared = dot(d, d);
    return inverseSqrt(squared) / squared;
}

/// The nine real spherical harmonics up to band 2 at the unit vector `d`, in the order 00, 1-1, 10,
/// 11, 2-2, 2-1, 20, 21, 22. Ramamoorthi and Hanrahan 2001, eq. 3.
fn sh_basis(d: vec3f) -> array<f32, 9> {
    return array<f32, 9>(
        0.28209479177387814, // sqrt(1 / (4 pi))
        0.48860251190291992 * d.y, // sqrt(3 / (4 pi))
        0.48860251190291992 * d.z,
        0.48860251190291992 * d.x,
        1.0925484305920792 * d.x * d.y, // sqrt(15 / (4 pi))
        1.0925484305920792 * d.y * d.z,
        0.31539156525252005 * (3.0 * d.z * d.z - 1.0), // sqrt(5 / (16 pi))
        1.0925484305920792 * d.x * d.z,
        0.54627421529603959 * (d.x - d.y) * (d.x + d.y), // sqrt(15 / (16 pi))
    );
}

/// The environment's coefficients of the nine harmonics, from each texel of a cube map with faces
/// `size` (1..=104) texels wide. Ramamoorthi and Hanrahan 2001, eq. 10.
///
/// The sum of solid angles is scaled to 4 pi: exact for constants.
fn sh_project(size: u32) -> array<vec3f, 9> {
    var coefficients = array<vec3f, 9>();
    var weights = 0.0;
    for (var i = 0u; i < 6u * size * size; i++) {
        let d = texel_direction(size, i);
        let weight = texel_density(d);
        let light = weight * radiance(d);
        let basis = sh_basis(normalize(d));
        // Written out: a loop here would take nine more rounds for each texel.
        coefficients[0] += basis[0] * light;
        coefficients[1] += basis[1] * light;
        coefficients[2] += basis[2] * light;
        coefficients[3] += basis[3] * light;
        coefficients[4] += basis[4] * light;
        coefficients[5] += basis[5] * light;
        coefficients[6] += basis[6] * light;
        coefficients[7] += basis[7] * light;
        coefficients[8] += basis[8] * light;
        weights += weight;
    }
    for (var k = 0u; k < 9u; k++) {
        coefficients[k] *= 4.0 * PI / weights;
    }
    return coefficients;
}

/// From the coefficients of an environment, in the order of `sh_basis`. Ramamoorthi and Hanrahan
/// 2001, eq. 7 and 8, over pi: the cosine keeps 1, 2/3 and 1/4 of the bands.
///
/// Band 3 has no share; all higher bands add up to 0.5 % of a cosine lobe.
fn sh_irradiance(coefficients: array<vec3f, 9>, n: vec3f) -> vec3f {
    let c = coefficients;
    let y = sh_basis(n);
    let linear = y[1] * c[1] + y[2] * c[2] + y[3] * c[3];
    let quadratic = y[4] * c[4] + y[5] * c[5] + y[6] * c[6] + y[7] * c[7] + y[8] * c[8];
    return y[0] * c[0] + 2.0 / 3.0 * linear + 0.25 * quadratic;
}

/// Radiance of a Lambertian of `colour`: (colour / pi) E. The stored value is over pi already.
fn lambert(colour: vec3f, irradiance_over_pi: vec3f) -> vec3f {
    return colour * irradiance_over_pi;
}
