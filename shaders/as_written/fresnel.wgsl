// Fresnel reflectance as the lecture writes it. `fresnel.wgsl` has the corrected form.

/// PV227 lecture 11, "Legend": F0 + (1 - F0)(1 - V.H)^5,
/// with the power by `pow` and an unclamped dot product.
///
/// Wrong: V.H of unit vectors may round to above 1, and `pow` of a negative base is NaN.
/// It is also less accurate, and at V.H = 1 WGSL doesn't bound the error of pow(0, 5).
fn schlick(f0: vec3f, v: vec3f, h: vec3f) -> vec3f {
    return f0 + (1.0 - f0) * pow(1.0 - dot(v, h), 5.0);
}
