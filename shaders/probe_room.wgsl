// The article's object: Lambertian spheres in a room, each lit by one
// look-up in the irradiance map that was made in the middle of the room.

import package::camera::{camera, covering_corner, view_direction};
import package::environment::{environment_sampler, parallax_box, radiance};
import package::irradiance::lambert;

/// The room, and the point from which its cube maps were made.
struct Room {
    corner: vec3f, // where all coordinates are least
    opposite: vec3f,
    probe: vec3f,
}

struct Varyings {
    @invariant @builtin(position) clip: vec4f,
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
}

/// Irradiance over pi by normal.
@group(0) @binding(3) var irradiance_map: texture_cube<f32>;
@group(0) @binding(4) var<uniform> room: Room;

const COLOUR: vec3f = vec3f(0.8, 0.8, 0.8);
const RADIUS: f32 = 0.3;
/// The distance between neighbouring spheres, from the left wall to the right one.
const SPACING: f32 = 0.8;

/// The centre of sphere `instance` of five.
fn sphere_centre(instance: u32) -> vec3f {
    return vec3f(SPACING * (f32(instance) - 2.0), -0.35, -0.6);
}

/// A vertex of sphere `instance`: on a unit sphere the position is the normal.
@vertex
fn vertex(@location(0) position: vec3f, @builtin(instance_index) instance: u32) -> Varyings {
    let world = RADIUS * position + sphere_centre(instance);
    return Varyings(camera.view_projection * vec4f(world, 1.0), world, position);
}

/// Lit as if the room were infinitely large: all spheres look alike.
@fragment
fn fragment(in: Varyings) -> @location(0) vec4f {
    return vec4f(lit(in.normal), 1.0);
}

/// Corrects the direction by the point's place in the room: it shows at a sphere beside a wall.
@fragment
fn corrected_fragment(in: Varyings) -> @location(0) vec4f {
    return vec4f(lit(from_probe(in.position, normalize(in.normal))), 1.0);
}

/// Radiance of the Lambertian whose irradiance `direction` looks up.
fn lit(direction: vec3f) -> vec3f {
    let light = textureSampleLevel(irradiance_map, environment_sampler, direction, 0.0).rgb;
    return lambert(COLOUR, light);
}

/// The direction in which the probe saw the point that is
/// seen from `position` along the unit vector `direction`.
fn from_probe(position: vec3f, direction: vec3f) -> vec3f {
    return parallax_box(position, direction, room.probe, room.corner, room.opposite);
}

struct Background {
    @builtin(position) clip: vec4f,
    @location(0) direction: vec3f,
}

@vertex
fn background_vertex(@builtin(vertex_index) index: u32) -> Background {
    let ndc = covering_corner(index);
    return Background(vec4f(ndc, 1.0, 1.0), view_direction(camera.view_projection, ndc));
}

/// The room as the probe saw it.
@fragment
fn background_fragment(in: Background) -> @location(0) vec4f {
    return vec4f(radiance(in.direction), 1.0);
}

/// The room as the camera sees it: the same correction turns the cube map back into walls.
@fragment
fn corrected_background_fragment(in: Background) -> @location(0) vec4f {
    return vec4f(radiance(from_probe(camera.position, normalize(in.direction))), 1.0);
}
