// The camera of a frame, and the triangle that covers the frame.

/// A perspective camera.
struct Camera {
    view_projection: mat4x4f, // right-handed, depth 0..1
    position: vec3f,
}

@group(0) @binding(0) var<uniform> camera: Camera;

/// Corner `index` of one triangle that covers the frame: (-1, -1), (3, -1), (-1, 3).
fn covering_corner(index: u32) -> vec2f {
    return 4.0 * vec2f(f32(index & 1u), f32(index >> 1u)) - 1.0;
}

/// The direction that a camera with a symmetric frustum sees at `ndc`, not of unit
/// length. It is linear in `ndc`: interpolating it over the covering triangle is exact.
///
/// The rows of its matrix are right / width, up / height and, fourth, forward, all orthogonal, so
/// that no inverse is needed: right * width is the first row over its squared length.
fn view_direction(view_projection: mat4x4f, ndc: vec2f) -> vec3f {
    let rows = transpose(view_projection);
    let x = rows[0].xyz;
    let y = rows[1].xyz;
    return rows[3].xyz + ndc.x * x / dot(x, x) + ndc.y * y / dot(y, y);
}
