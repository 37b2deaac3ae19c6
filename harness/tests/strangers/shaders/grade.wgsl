@group(0) @binding(0) var curve: texture_2d<f32>;
@group(0) @binding(1) var curve_sampler: sampler;
@group(0) @binding(2) var<uniform> exposure: f32;
@group(0) @binding(3) var<storage> offsets: array<f32>;

fn graded(x: f32, channel: u32) -> f32 {
    return exposure * textureSampleLevel(curve, curve_sampler, vec2f(x, 0.5), 0.0).x + offsets[channel];
}
