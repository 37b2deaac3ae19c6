const PI = 3.14159265358979;

fn cosine_hemisphere(u: vec2f) -> vec3f {
    let r = sqrt(u.y);
    let phi = 2.0 * PI * u.x;
    return vec3f(r * cos(phi), r * sin(phi), sqrt(1.0 - u.y));
}

fn cosine_hemisphere_pdf(l: vec3f) -> f32 {
    return max(l.z, 0.0) / PI;
}
