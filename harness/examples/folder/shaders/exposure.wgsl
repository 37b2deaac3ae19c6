// Exposure of a scene, as a camera measures it.

const MIDDLE_GREY = 0.18;

/// The luminance of a linear colour (Rec. 709).
fn luminance(color: vec3f) -> f32 {
    return dot(color, vec3f(0.2126, 0.7152, 0.0722));
}

/// The factor that makes the average luminance of a scene a middle grey.
fn exposure(average: f32) -> f32 {
    return MIDDLE_GREY / max(average, 1e-4);
}

@group(0) @binding(0) var<storage, read> pixels: array<vec4f>;
@group(0) @binding(1) var<storage, read_write> sums: array<f32>;

var<workgroup> partial: array<f32, 64>;

/// The sum of the luminances of 64 pixels, a workgroup each.
@compute @workgroup_size(64)
fn sum_luminances(@builtin(local_invocation_index) lane: u32, @builtin(workgroup_id) group: vec3u) {
    let at = group.x * 64 + lane;
    partial[lane] = select(0.0, luminance(pixels[min(at, arrayLength(&pixels) - 1)].rgb), at < arrayLength(&pixels));
    for (var step = 32u; step > 0; step /= 2) {
        workgroupBarrier();
        if lane < step {
            partial[lane] += partial[lane + step];
        }
    }
    if lane == 0 {
        sums[group.x] = partial[0];
    }
}
