/// How much of an overlay shows, `age` seconds after it appeared: all of it for 2 seconds, then less for half a second.
fn opacity(age: f32) -> f32 {
    return 1.0 - smoothstep(2.0, 2.5, age);
}

/// An overlay with premultiplied alpha over an opaque colour.
fn over(overlay: vec4f, under: vec3f) -> vec3f {
    return overlay.rgb + (1.0 - overlay.a) * under;
}
