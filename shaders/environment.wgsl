// The light that surrounds the scene. One of the two modules with bindings: what samples it
// (`diffuse`, `specular`) imports `radiance` and stays free of them.

/// Radiance from each direction, linear and HDR.
@group(0) @binding(1) var environment: texture_cube<f32>;
@group(0) @binding(2) var environment_sampler: sampler;

/// Radiance that arrives from `direction`, which needn't be of unit length.
///
/// The level is explicit: a sample's direction has no derivatives worth having, and implicit
/// levels are confined to fragment shaders in uniform control flow.
fn radiance(direction: vec3f) -> vec3f {
    return textureSampleLevel(environment, environment_sampler, direction, 0.0).rgb;
}
