@fragment fn fragment(@location(0) uv: vec2f) -> @location(0) vec4f {
    let zenith = vec3f(0.1, 0.3, 0.8);
    let horizon = vec3f(0.8, 0.9, 1.0);
    return vec4f(mix(zenith, horizon, uv.y), 1.0);
}
