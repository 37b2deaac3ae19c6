// Maps that are computed once and then looked up, each drawn as a frame: the faces of cube maps,
// three across and two down, and the table of the split sum.

import package::camera::covering_corner;
import package::environment::{face_direction, radiance};
import package::irradiance;
import package::specular;

/// The settings of a map.
struct MapSettings {
    side: u32, // texels along a side of a face, or of the table
    samples: u32, // at most 65,535, see `irradiance`
    alpha: f32, // of a prefiltered level
}

@group(0) @binding(0) var<uniform> settings: MapSettings;

/// Faces across: +X, -X, +Y, and below them -Y, +Z, -Z.
const ACROSS: u32 = 3u;

/// Steps of the irradiance map: 2.9 degrees in azimuth and 2.8 in polar angle at least, a fifth
/// of the studio's sun.
const PHI_STEPS: u32 = 126u;
const THETA_STEPS: u32 = 32u;

/// Direction, not of unit length, through the texel of a cube map that `pixel` shows.
fn texel_direction(side: u32, pixel: vec2u) -> vec3f {
    let face = pixel / side;
    let texel = pixel % side;
    return face_direction(face.y * ACROSS + face.x, (vec2f(texel) + 0.5) / f32(side));
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return vec4f(covering_corner(index), 1.0, 1.0);
}

/// The environment itself.
@fragment
fn environment_fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    return vec4f(radiance(texel_direction(settings.side, vec2u(position.xy))), 1.0);
}

/// Irradiance over pi by normal: the article's convolution, in the middle of its steps.
@fragment
fn irradiance_fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let n = normalize(texel_direction(settings.side, vec2u(position.xy)));
    return vec4f(irradiance::midpoint(n, PHI_STEPS, THETA_STEPS), 1.0);
}

/// The environment as a surface of width `alpha` reflects it, seen along its normal.
@fragment
fn prefiltered_fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let r = normalize(texel_direction(settings.side, vec2u(position.xy)));
    return vec4f(specular::prefiltered(settings.alpha, r, settings.samples), 1.0);
}

/// Scale and bias of f0 in R and G, and again in B and A, because a target has four channels. N.V
/// grows to the right, alpha downward, each from the middle of its first texel.
@fragment
fn split_sum_fragment(@builtin(position) position: vec4f) -> @location(0) vec4f {
    let entry = position.xy / f32(settings.side); // pixels have their centres at 0.5
    return specular::split_sum_table(entry.y, entry.x, settings.samples).rgrg;
}
