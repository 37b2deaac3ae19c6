// The light that surrounds the scene. One of the few modules with bindings: modules that
// sample it (`irradiance`, `specular`) import `radiance`, and have no bindings of their own.
//
// Faces are those of WebGPU, in the order +X, -X, +Y, -Y, +Z, -Z, mirrored as seen from inside
// the cube with Y up. `uv` runs from the top left, and a texel's value belongs to its centre.

import package::math::{PI, TAU};

/// Radiance from each direction, linear and HDR.
@group(0) @binding(1) var environment: texture_cube<f32>;
@group(0) @binding(2) var environment_sampler: sampler;

/// Radiance that arrives from `direction`, which needn't be of unit length.
///
/// The level is explicit: the directions of samples have no useful derivatives,
/// and implicit levels need fragment shaders in uniform control flow.
fn radiance(direction: vec3f) -> vec3f {
    return radiance_level(direction, 0.0);
}

/// Radiance about `direction`, averaged over texels of mip level `level`.
/// Levels in between are interpolated; beyond the last one, the last is used.
fn radiance_level(direction: vec3f, level: f32) -> vec3f {
    return textureSampleLevel(environment, environment_sampler, direction, level).rgb;
}

/// The level, at least 0, whose texels are as large as the solid angle of one of
/// `samples` directions with density `pdf` > 0 (in 1/sr, in the frame in which the
/// direction was sampled). Krivanek and Colbert 2008: 1/2 log2(Omega_s / Omega_p).
///
/// Omega_s is 1 / (samples pdf). Omega_p is the mean solid angle of a texel of level 0, 4 pi
/// over 6 `size`^2: the true one is 1.91 times as large in the middle of a face and 0.37 times
/// at a corner, which moves the level by -0.47 or 0.72, less than the width of the filter.
fn mip_level(pdf: f32, samples: u32, size: u32) -> f32 {
    let side = f32(size);
    let texels = 1.5 / PI * side * side / (f32(samples) * pdf);
    let level = 0.5 * log2(texels);
    // Not max(level, 0.0), which would turn a NaN into the sharpest level.
    return select(level, 0.0, level < 0.0);
}

/// A point of a cube's surface.
struct FacePoint {
    face: u32,
    uv: vec2f,
}

/// The point of the cube of side 2 at `uv` of `face`, below 6. Vulkan 1.3, section 16.5.4.
fn face_direction(face: u32, uv: vec2f) -> vec3f {
    let s = 2.0 * uv.x - 1.0;
    let t = 2.0 * uv.y - 1.0;
    switch face {
        case 0u: { return vec3f(1.0, -t, -s); }
        case 1u: { return vec3f(-1.0, -t, s); }
        case 2u: { return vec3f(s, 1.0, t); }
        case 3u: { return vec3f(s, -1.0, -t); }
        case 4u: { return vec3f(s, -t, 1.0); }
        default: { return vec3f(-s, -t, -1.0); }
    }
}

/// The point at which the ray along `direction`, of any length but 0, meets the cube: a sampler's
/// first step. On edges Z goes before Y and Y before X, as Vulkan 1.3, section 16.5.4, recommends.
fn face_point(direction: vec3f) -> FacePoint {
    let size = abs(direction);
    var face: u32;
    var st: vec2f;
    if (size.z >= size.x && size.z >= size.y) {
        face = select(5u, 4u, direction.z > 0.0);
        st = vec2f(direction.x * sign(direction.z), -direction.y) / size.z;
    } else if (size.y >= size.x) {
        face = select(3u, 2u, direction.y > 0.0);
        st = vec2f(direction.x, direction.z * sign(direction.y)) / size.y;
    } else {
        face = select(1u, 0u, direction.x > 0.0);
        st = vec2f(-direction.z * sign(direction.x), -direction.y) / size.x;
    }
    return FacePoint(face, 0.5 * st + 0.5);
}

/// The place of `direction`, of any length but 0, in an image of latitude
/// and longitude. The layout is OpenEXR's (ImfEnvmap.h): +Y at the top,
/// +Z in the middle, +X a quarter to its left, and -Z at both sides.
///
/// The poles are whole rows; the result is u = 1/2 there. The polar angle comes from both legs
/// of its triangle, because the arccosine of y keeps only half of its digits near the poles.
fn equirectangular_uv(direction: vec3f) -> vec2f {
    let from_axis = length(direction.xz);
    var longitude = 0.0;
    if (from_axis > 0.0) { // atan2(0, 0) is undefined
        longitude = atan2(direction.x, direction.z);
    }
    return vec2f(0.5 - longitude / TAU, atan2(from_axis, direction.y) / PI);
}

/// The unit vector that an image of latitude and longitude shows at `uv` in 0..=1: the inverse of
/// `equirectangular_uv`.
fn equirectangular_direction(uv: vec2f) -> vec3f {
    // Both angles stay within [-pi, pi], where WGSL bounds the error of sin and cos.
    let longitude = TAU * (0.5 - uv.x);
    let latitude = PI * (0.5 - uv.y);
    let from_axis = cos(latitude);
    return vec3f(from_axis * sin(longitude), sin(latitude), from_axis * cos(longitude));
}

/// If a component of a unit vector is smaller, the planes across that axis count
/// as infinitely far. A quotient by it would overflow only for rooms of 1e18.
const LEAST_COMPONENT: f32 = 1e-20;

/// The direction, not of unit length, in which a cube map drawn at `centre` shows the point
/// seen from `position` along the unit vector `direction`, if the box from `low` to `high`
/// surrounds both. Lagarde and Zanuttini 2012; "the sampling vector corrected" of the article.
///
/// Both points lie in the box. The distance to each wall ahead is at least 0, and the ray hits
/// the nearest. At the centre the sum is a multiple of `direction`: the correction vanishes.
fn parallax_box(
    position: vec3f,
    direction: vec3f,
    centre: vec3f,
    low: vec3f,
    high: vec3f,
) -> vec3f {
    let wall = select(low, high, direction > vec3f(0.0));
    let parallel = abs(direction) < vec3f(LEAST_COMPONENT);
    let speed = select(direction, vec3f(1.0), parallel); // no division by 0
    let distances = select((wall - position) / speed, vec3f(1e38), parallel);
    let hit = min(distances.x, min(distances.y, distances.z));
    return (position - centre) + hit * direction;
}

/// As `parallax_box`, but both points are surrounded by
/// the sphere about `centre`; `position` lies in it.
///
/// The positive root of |q + t d| = r with q from the centre: sqrt(b^2 + c) - b. Near
/// the sphere it cancels, by no more than the rounding of q, to which it is added.
fn parallax_sphere(position: vec3f, direction: vec3f, centre: vec3f, radius: f32) -> vec3f {
    let q = position - centre;
    let away = length(q);
    let b = dot(q, direction);
    let c = (radius - away) * (radius + away);
    return q + (sqrt(b * b + c) - b) * direction;
}
