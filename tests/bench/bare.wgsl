const TAU: f32 = 6.283185307179586;

fn ggx_normal(alpha: f32, u: vec2f) -> vec3f {
    let phi = TAU * (u.x - 0.5);
    let scale = inverseSqrt((1.0 - u.y) + alpha * alpha * u.y);
    let sin_theta = alpha * sqrt(u.y) * scale;
    return vec3f(sin_theta * cos(phi), sin_theta * sin(phi), sqrt(1.0 - u.y) * scale);
}

@group(0) @binding(0) var<storage, read> arguments: array<f32>;
@group(0) @binding(1) var<storage, read_write> results: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let i = 3u * id.x;
    if i >= arrayLength(&arguments) { return; }
    let h = ggx_normal(arguments[i], vec2f(arguments[i + 1u], arguments[i + 2u]));
    results[i] = h.x;
    results[i + 1u] = h.y;
    results[i + 2u] = h.z;
}
