// Fragment functions that test a depth pre-pass: they show how often pixels are shaded,
// and that fragments which discard or write their depth, which early depth tests would
// ignore, give the same result. WGSL has no qualifier that forces early tests.

import package::scene::{Varyings, projected};

@vertex
fn vertex(@location(0) position: vec3f, @builtin(instance_index) instance: u32) -> Varyings {
    return projected(position, instance);
}

/// Adds up to the number of fragments that were kept, in each channel, with additive blending.
@fragment
fn counting_fragment(in: Varyings) -> @location(0) vec4f {
    return vec4f(1.0);
}

/// Returns `true` if the stripe pattern, in the object's space, has a
/// hole here: in each quarter of a radius, the lower two fifths are open.
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

/// A sphere with holes, through which you see the fronts of those behind it, each labelled.
@fragment
fn cutout_fragment(in: Varyings) -> @location(0) vec4f {
    if (is_hole(in.normal)) {
        discard;
    }
    return vec4f(label(in.instance, in.normal), 1.0);
}

struct Depth {
    @builtin(frag_depth) depth: f32,
}

struct ColorAndDepth {
    @location(0) color: vec4f,
    @builtin(frag_depth) depth: f32,
}

/// Depth rounded down to 16 steps, each at least as deep as a sphere: of
/// several fragments with the same step, the sphere that is drawn last is kept.
fn stepped_depth(depth: f32) -> f32 {
    return floor(depth * 16.0) / 16.0;
}

@fragment
fn stepped_depth_fragment(in: Varyings) -> Depth {
    return Depth(stepped_depth(in.clip.z));
}

@fragment
fn stepped_fragment(in: Varyings) -> ColorAndDepth {
    return ColorAndDepth(vec4f(label(in.instance, in.normal), 1.0), stepped_depth(in.clip.z));
}

/// A colour that identifies sphere and place: the number of the
/// sphere, and X and Y of its normal, mapped from -1..=1 to 0..=1.
fn label(instance: u32, normal: vec3f) -> vec3f {
    return vec3f(f32(instance), 0.5 * normal.xy + 0.5);
}
