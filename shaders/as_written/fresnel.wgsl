// Fresnel reflectance as the lecture writes it. `fresnel.wgsl` holds what is right.

/// PV227 lecture 11, "Legend": F0 + (1 - F0)(1 - V.H)^5, its power by `pow`, the dot product
/// unclamped.
///
/// Wrong: V.H of unit vectors may round to above 1, and `pow` of a negative base is NaN. It is
/// less accurate, too, and at V.H = 1 WGSL doesn't bound the error of pow(0, 5).
fn schlick(f0: vec3f, v: vec3f, h: vec3f) -> vec3f {
    return f0 + (1.0 - f0) * pow(1.0 - dot(v, h), 5.0);
}
