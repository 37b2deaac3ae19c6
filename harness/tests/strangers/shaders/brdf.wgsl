const PI = 3.14159265358979;

fn lambert(albedo: f32, n_dot_l: f32) -> f32 {
    return albedo / PI * n_dot_l;
}

fn ggx(n_dot_h: f32, alpha: f32) -> f32 {
    let a2 = alpha * alpha;
    let d = n_dot_h * n_dot_h * (a2 - 1.0) + 1.0;
    return a2 / (PI * d * d);
}

fn schlick(f0: f32, cosine: f32) -> f32 {
    let c = 1.0 - cosine;
    return f0 + (1.0 - f0) * (c * c * c * c * c);
}

fn halfway(v: vec3f, l: vec3f) -> vec3f {
    return normalize(v + l);
}
