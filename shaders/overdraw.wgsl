// Fragment functions that show what a depth pre-pass does: how often pixels are shaded, and that
// fragments which discard or write their depth, which early depth tests would ignore, come out
// the same. WGSL has no qualifier that forces early tests.

import package::scene::{Varyings, projected};

@vertex
fn vertex(@location(0) position: vec3f, @builtin(instance_index) instance: u32) -> Varyings {
    return projected(position, instance);
}

/// Adds up to the number of fragments that were kept, with blending that adds.
@fragment
fn counting_fragment(in: Varyings) -> @location(0) vec4f {
    return vec4f(1.0);
}

/// Whether the stripe pattern, in the object's space, has a hole here.
fn is_hole(normal: vec3f) -> bool {
    return fract(4.0 * normal.y) < 0.4;
}

/// The depth of a sphere with holes.
@fragment
fn cutout_depth_fragment(in: Varyings) {
    if (is_hole(in.normal)) {
        discard;
    }
}

/// A sphere with holes, through which those behind it are seen, each in a colour of its own.
@fragment
fn cutout_fragment(in: Varyings) -> @location(0) vec4f {
    if (is_hole(in.normal)) {
        discard;
    }
    return vec4f(label(in), 1.0);
}

struct Depth {
    @builtin(frag_depth) depth: f32,
}

struct ColorAndDepth {
    @location(0) color: vec4f,
    @builtin(frag_depth) depth: f32,
}

/// Depth in steps, coarse enough to be seen: spheres that are close together share one.
fn stepped_depth(clip: vec4f) -> f32 {
    return floor(clip.z * 64.0) / 64.0;
}

@fragment
fn stepped_depth_fragment(in: Varyings) -> Depth {
    return Depth(stepped_depth(in.clip));
}

@fragment
fn stepped_fragment(in: Varyings) -> ColorAndDepth {
    return ColorAndDepth(vec4f(label(in), 1.0), stepped_depth(in.clip));
}

/// A colour that tells sphere and place apart.
fn label(in: Varyings) -> vec3f {
    return vec3f(f32(in.instance), 0.5 * in.normal.xy + 0.5);
}
