// The light that surrounds the scene. One of the two modules with bindings: what samples it
// (`irradiance`, `specular`) imports `radiance` and stays free of them.

import package::math::PI;

/// Radiance from each direction, linear and HDR.
@group(0) @binding(1) var environment: texture_cube<f32>;
@group(0) @binding(2) var environment_sampler: sampler;

/// Radiance that arrives from `direction`, which needn't be of unit length.
///
/// The level is explicit: a sample's direction has no derivatives worth having, and implicit
/// levels are confined to fragment shaders in uniform control flow.
fn radiance(direction: vec3f) -> vec3f {
    return radiance_level(direction, 0.0);
}

/// Radiance about `direction`, averaged over texels of mip level `level`. Between two levels it is
/// interpolated, beyond the last one it is the last.
fn radiance_level(direction: vec3f, level: f32) -> vec3f {
    return textureSampleLevel(environment, environment_sampler, direction, level).rgb;
}

/// The level, at least 0, whose texels are as large as what one of `samples` directions of density
/// `pdf` > 0 (in 1/sr, in the frame that the direction was drawn in) stands for.
/// Krivanek and Colbert 2008: 1/2 log2(Omega_s / Omega_p).
///
/// Omega_s is 1 / (samples pdf). Omega_p is the mean solid angle of a texel of level 0, 4 pi over
/// 6 `size`^2: the true one is 1.91 times as large in the middle of a face and 0.37 times at a
/// corner, which moves the level by -0.47 or 0.72 and is within the width of the filter.
fn mip_level(pdf: f32, samples: u32, size: u32) -> f32 {
    let side = f32(size);
    let texels = 1.5 / PI * side * side / (f32(samples) * pdf);
    let level = 0.5 * log2(texels);
    // Not max(level, 0.0), which would turn a NaN into the sharpest level.
    return select(level, 0.0, level < 0.0);
}
