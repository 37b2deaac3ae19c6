// The test scene of PV227 lecture 11: 8 x 8 spheres, with a material for each column and a roughness
// for each row, in front of the environment that lights them. The output is linear and HDR.
//
// It is drawn twice with `vertex`: first only depth, then with one of the fragment
// functions, one for each task of the lecture, and depth test `equal`, so that each
// pixel is shaded once. The background passes the same test where there is no sphere.

import package::camera::{camera, covering_corner, view_direction};
import package::compensation::{compensated, coupled};
import package::environment::{environment, environment_sampler, radiance};
import package::irradiance;
import package::layering::{masked_base, plastic, thin_coat};
import package::materials::{alpha_from_roughness, masked_roughness, material_from_texels};
import package::specular;

/// The numbers of directions that gather light, together at most 65,535:
/// see `irradiance`. Powers of two make the diffuse furnace exact.
struct Samples {
    diffuse: u32,
    specular: u32,
}

/// The outputs of the vertex stage.
struct Varyings {
    // Both passes must compute the same depth to the bit, though they are different pipelines.
    @invariant @builtin(position) clip: vec4f,
    @location(0) position: vec3f,
    @location(1) normal: vec3f,
    @location(2) @interpolate(flat) instance: u32,
}

/// Linear, with a texel for each sphere: a material for each column, a roughness for each row.
@group(0) @binding(3) var base_color_map: texture_2d<f32>;
/// Roughness in R, metallic in G.
@group(0) @binding(4) var surface_map: texture_2d<f32>;
/// A mask over each sphere as the camera of the test scene sees it, in R. Linear: a mask isn't a colour.
@group(0) @binding(5) var mask: texture_2d<f32>;
@group(0) @binding(6) var<uniform> samples: Samples;
/// The environment, filtered for growing roughness in its mip levels.
@group(0) @binding(7) var prefiltered: texture_cube<f32>;
/// Karis' scale and bias of f0 in R and G; N.V increases to the right, alpha downward.
@group(0) @binding(8) var split_sum_table: texture_2d<f32>;

/// Spheres across and down.
const SIDE: u32 = 8u;
/// Distances between centres of spheres of radius 1: wider than high, for a frame of 16:9.
const SPACING: vec2f = vec2f(3.2, 2.2);

/// The least N.V that is shaded. Weights are bounded for any N.V; at
/// 1e-3 the rounding of N.V, about 1e-7, is still only 1e-4 of it.
const LEAST_N_DOT_V: f32 = 1e-3;

/// The roughness where the mask is 1, in frames with masked roughness.
const MASKED_ROUGHNESS: f32 = 0.5;

/// The centre of sphere `instance`: row by row from the top left, in the plane z = 0.
fn sphere_centre(instance: u32) -> vec3f {
    let cell = vec2f(f32(instance % SIDE), f32(instance / SIDE));
    let middle = 0.5 * f32(SIDE - 1u);
    return vec3f((cell.x - middle) * SPACING.x, (middle - cell.y) * SPACING.y, 0.0);
}

/// `n`, turned towards `v` by the least angle that makes N.V at least LEAST_N_DOT_V.
///
/// Normals interpolated over a mesh face away along its outline. Turning the
/// vector keeps all dot products consistent; clamping them one by one would not.
fn facing_normal(n: vec3f, v: vec3f) -> vec3f {
    let missing = LEAST_N_DOT_V - dot(n, v);
    if (missing <= 0.0) {
        return n;
    }
    return normalize(n + missing * v);
}

/// The mask coordinates of a point with unit normal `n`, as the camera on the +Z axis sees it.
fn mask_coordinate(n: vec3f) -> vec2f {
    return vec2f(0.5 + 0.5 * n.x, 0.5 - 0.5 * n.y);
}

/// A vertex of sphere `instance`: on a unit sphere the position is the normal.
fn projected(position: vec3f, instance: u32) -> Varyings {
    let world = position + sphere_centre(instance);
    return Varyings(camera.view_projection * vec4f(world, 1.0), world, position, instance);
}

@vertex
fn vertex(@location(0) position: vec3f, @builtin(instance_index) instance: u32) -> Varyings {
    return projected(position, instance);
}

/// The surface at the point that a pixel shows.
struct Surface {
    diffuse: vec3f, // albedo, black for metals
    f0: vec3f,
    roughness: f32,
    mask: f32,
    n: vec3f,
    v: vec3f,
}

fn surface(in: Varyings) -> Surface {
    let texel = vec2u(in.instance % SIDE, in.instance / SIDE);
    let painted = textureLoad(surface_map, texel, 0);
    let material = material_from_texels(textureLoad(base_color_map, texel, 0).rgb, painted.g);
    let normal = normalize(in.normal); // interpolation shortens normals
    let covered =
        textureSampleLevel(mask, environment_sampler, mask_coordinate(normal), 0.0).r;
    let v = normalize(camera.position - in.position);
    let n = facing_normal(normal, v);
    return Surface(material.diffuse, material.f0, painted.r, covered, n, v);
}

/// The most light that the pigment returns. Metals, five columns of eight, skip the loop.
fn diffuse_light(s: Surface) -> vec3f {
    if (all(s.diffuse == vec3f(0.0))) {
        return vec3f(0.0);
    }
    return s.diffuse * irradiance::estimate(s.n, samples.diffuse);
}

/// The lecture's scene passes its roughness to the sampler unchanged; others square it first.
fn specular_light(s: Surface) -> vec3f {
    let alpha = alpha_from_roughness(s.roughness);
    return specular::estimate(s.f0, alpha, s.n, s.v, samples.specular);
}

/// Both terms, with the diffuse light behind the interface.
fn shade(s: Surface) -> vec3f {
    return plastic(s.f0, diffuse_light(s), specular_light(s), dot(s.n, s.v));
}

/// Task 1: metals are black.
@fragment
fn diffuse_fragment(in: Varyings) -> @location(0) vec4f {
    let s = surface(in);
    return vec4f(plastic(s.f0, diffuse_light(s), vec3f(0.0), dot(s.n, s.v)), 1.0);
}

/// Task 2.
@fragment
fn specular_fragment(in: Varyings) -> @location(0) vec4f {
    return vec4f(specular_light(surface(in)), 1.0);
}

/// Tasks 1 and 2 together.
@fragment
fn fragment(in: Varyings) -> @location(0) vec4f {
    return vec4f(shade(surface(in)), 1.0);
}

/// Task 2, "try using a mask texture to change the roughness".
@fragment
fn masked_roughness_fragment(in: Varyings) -> @location(0) vec4f {
    var s = surface(in);
    s.roughness = masked_roughness(s.roughness, MASKED_ROUGHNESS, s.mask);
    return vec4f(shade(s), 1.0);
}

/// Task 3: a thin coat over the surface's own light.
@fragment
fn layered_fragment(in: Varyings) -> @location(0) vec4f {
    let s = surface(in);
    return vec4f(coated(s, shade(s)), 1.0);
}

/// Task 3, "try using a mask texture to create parts of semitransparent white areas": below the
/// coat.
@fragment
fn masked_layered_fragment(in: Varyings) -> @location(0) vec4f {
    let s = surface(in);
    let white = irradiance::estimate(s.n, samples.diffuse);
    return vec4f(coated(s, masked_base(shade(s), white, s.mask)), 1.0);
}

/// The perfect reflection of the coat, and the rest of `base`.
fn coated(s: Surface, base: vec3f) -> vec3f {
    return thin_coat(radiance(reflect(-s.v, s.n)), base, dot(s.n, s.v));
}

/// Task 1, "try sampling higher mipmap-levels": few samples, each from the level of its solid angle.
@fragment
fn filtered_diffuse_fragment(in: Varyings) -> @location(0) vec4f {
    let s = surface(in);
    let light = s.diffuse * irradiance::filtered_estimate(s.n, samples.diffuse, environment_size());
    return vec4f(plastic(s.f0, light, vec3f(0.0), dot(s.n, s.v)), 1.0);
}

/// Task 2, "try sampling higher mipmap-levels".
@fragment
fn filtered_specular_fragment(in: Varyings) -> @location(0) vec4f {
    let s = surface(in);
    let alpha = alpha_from_roughness(s.roughness);
    let light =
        specular::filtered_estimate(s.f0, alpha, s.n, s.v, samples.specular, environment_size());
    return vec4f(light, 1.0);
}

fn environment_size() -> u32 {
    return textureDimensions(environment).x;
}

/// Tasks 1 and 2 with Karis' split sum in place of the specular estimator.
@fragment
fn split_sum_fragment(in: Varyings) -> @location(0) vec4f {
    let s = surface(in);
    let alpha = alpha_from_roughness(s.roughness);
    let n_dot_v = dot(s.n, s.v);
    let level = specular::prefiltered_level(alpha, textureNumLevels(prefiltered));
    let light =
        textureSampleLevel(prefiltered, environment_sampler, reflect(-s.v, s.n), level).rgb;
    let specular_part = specular::split_sum(s.f0, table_entry(s), light);
    return vec4f(plastic(s.f0, diffuse_light(s), specular_part, n_dot_v), 1.0);
}

/// Scale and bias of f0 for this width and view.
fn table_entry(s: Surface) -> vec2f {
    let place = vec2f(dot(s.n, s.v), alpha_from_roughness(s.roughness));
    return textureSampleLevel(split_sum_table, environment_sampler, place, 0.0).rg;
}

/// Compensates for the energy that `fragment` loses: white materials are invisible in white light.
@fragment
fn compensated_fragment(in: Varyings) -> @location(0) vec4f {
    let s = surface(in);
    let table = table_entry(s);
    if (all(s.diffuse == vec3f(0.0))) {
        return vec4f(compensated(s.f0, specular_light(s), table), 1.0);
    }
    return vec4f(coupled(s.f0, diffuse_light(s), specular_light(s), table), 1.0);
}

struct Background {
    @builtin(position) clip: vec4f,
    @location(0) direction: vec3f,
}

/// At depth 1: equal to a cleared depth buffer.
@vertex
fn background_vertex(@builtin(vertex_index) index: u32) -> Background {
    let ndc = covering_corner(index);
    return Background(vec4f(ndc, 1.0, 1.0), view_direction(camera.view_projection, ndc));
}

/// The environment, as the camera sees it.
@fragment
fn background_fragment(in: Background) -> @location(0) vec4f {
    return vec4f(radiance(in.direction), 1.0);
}
