// The test scene of PV227 lecture 11: 8 x 8 spheres, a material a column, a roughness a row,
// in front of the environment that lights them. The output is linear and HDR.
//
// Drawn twice with `vertex`: depth only, then with `fragment` and depth test `equal`, so that
// each pixel is shaded once. The background passes the same test where no sphere is.

import package::irradiance;
import package::environment::radiance;
import package::fresnel::schlick;
import package::specular::specular_estimate;

struct Camera {
    view_projection: mat4x4f, // right-handed, depth 0..1
    position: vec3f,
}

struct Material {
    diffuse: vec3f, // albedo, black for metals
    f0: vec3f,
    roughness: f32,
}

/// What the vertex stage hands over.
struct Varyings {
    // Both passes must compute the same depth to the bit, though they are different pipelines.
    @invariant @builtin(position) clip: vec4f,
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) @interpolate(flat) instance: u32,
}

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(3) var<storage, read> materials: array<Material>;

/// Spheres across and down.
const SIDE: u32 = 8u;
/// Between centres of spheres of radius 1: wider than high, for a frame of 16:9.
const SPACING: vec2f = vec2f(3.2, 2.2);

// Few enough for a software rasteriser. A power of two makes the diffuse furnace exact.
const DIFFUSE_SAMPLES: u32 = 256u;
const SPECULAR_SAMPLES: u32 = 512u;

/// The least N.V that is shaded. Weights are bounded however small it is; at 1e-3 the rounding
/// of N.V, about 1e-7, is still 1e-4 of it.
const LEAST_N_DOT_V: f32 = 1e-3;

/// Where sphere `instance` stands: row by row from the top left, in the plane z = 0.
fn sphere_centre(instance: u32) -> vec3f {
    let cell = vec2f(f32(instance % SIDE), f32(instance / SIDE));
    let middle = 0.5 * f32(SIDE - 1u);
    return vec3f((cell.x - middle) * SPACING.x, (middle - cell.y) * SPACING.y, 0.0);
}

/// `n`, turned towards `v` by as little as makes N.V at least LEAST_N_DOT_V.
///
/// Normals interpolated over a mesh face away along its outline. Turning the vector keeps all dot
/// products consistent, which clamping them one by one would not.
fn facing_normal(n: vec3f, v: vec3f) -> vec3f {
    let missing = LEAST_N_DOT_V - dot(n, v);
    if (missing <= 0.0) {
        return n;
    }
    return normalize(n + missing * v);
}

/// Direction, not of unit length, seen at `ndc` by a camera with a symmetric frustum.
///
/// The rows of its matrix are right / width, up / height and, fourth, forward, all orthogonal, so
/// that no inverse is needed: right * width is the first row over its squared length.
fn view_direction(view_projection: mat4x4f, ndc: vec2f) -> vec3f {
    let rows = transpose(view_projection);
    let x = rows[0].xyz;
    let y = rows[1].xyz;
    return rows[3].xyz + ndc.x * x / dot(x, x) + ndc.y * y / dot(y, y);
}

/// A vertex of sphere `instance`: on a unit sphere the position is the normal.
@vertex
fn vertex(@location(0) position: vec3f, @builtin(instance_index) instance: u32) -> Varyings {
    let world = position + sphere_centre(instance);
    return Varyings(camera.view_projection * vec4f(world, 1.0), world, position, instance);
}

/// Radiance towards the camera.
@fragment
fn fragment(in: Varyings) -> @location(0) vec4f {
    let material = materials[in.instance];
    let v = normalize(camera.position - in.position);
    let n = facing_normal(normalize(in.normal), v); // interpolation shortens normals
    // The lecture's scene feeds its roughness to the sampler as it is; others square it first.
    let alpha = material.roughness;

    var color = specular_estimate(material.f0, alpha, n, v, SPECULAR_SAMPLES);
    if (any(material.diffuse > vec3f(0.0))) { // metals, five columns of eight, skip the loop
        // What the interface reflects doesn't reach the pigment. Without this factor, which the
        // lecture leaves out, a plastic reflects more than it receives at grazing.
        let transmitted = 1.0 - schlick(material.f0, dot(n, v));
        color += material.diffuse * transmitted * irradiance::estimate(n, DIFFUSE_SAMPLES);
    }
    return vec4f(color, 1.0);
}

struct Background {
    @builtin(position) clip: vec4f,
    @location(0) direction: vec3f,
}

/// One triangle over the whole frame, at depth 1: equal to a cleared depth buffer.
@vertex
fn background_vertex(@builtin(vertex_index) index: u32) -> Background {
    let corner = vec2f(f32(index & 1u), f32(index >> 1u));
    let ndc = 4.0 * corner - 1.0; // (-1, -1), (3, -1), (-1, 3)
    // The direction is linear in ndc: interpolating it is exact.
    return Background(vec4f(ndc, 1.0, 1.0), view_direction(camera.view_projection, ndc));
}

/// The environment, as the camera sees it.
@fragment
fn background_fragment(in: Background) -> @location(0) vec4f {
    return vec4f(radiance(in.direction), 1.0);
}
