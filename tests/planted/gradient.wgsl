// A full-screen gradient: each pixel has a colour of its own.

@vertex
fn corners(@builtin(vertex_index) index: u32) -> @builtin(position) vec4f {
    return vec4f(4.0 * f32(index & 1u) - 1.0, 4.0 * f32(index >> 1u) - 1.0, 1.0, 1.0);
}

@fragment
fn gradient(@builtin(position) at: vec4f) -> @location(0) vec4f {
    return vec4f(at.x / 4.0, at.y / 8.0, 0.5, 1.0);
}
