// Compensation for the light that a single reflection between microfacets loses, so that a
// white furnace stays white. `table` has scale and bias of f0, as `specular::split_sum_table`
// computes them; their sum is the furnace of a perfect metal, in (0, 1].

/// The share of white light that a surface of reflectance `f0` reflects towards its viewer.
/// Karis 2013, "Environment BRDF".
fn directional_albedo(f0: vec3f, table: vec2f) -> vec3f {
    return f0 * table.x + table.y;
}

/// Specular `light`, including the light that further reflections would return:
/// times 1 + f0 (1 / E - 1), where E is the furnace of a perfect metal. Turquin
/// 2019, "Practical multiple scattering compensation for microfacet models", eq. 16.
///
/// At f0 = 1 it divides by E: a perfect metal is white in a furnace. Each further
/// reflection multiplies by f0 again, so coloured metals get more saturated.
fn compensated(f0: vec3f, light: vec3f, table: vec2f) -> vec3f {
    return light * (1.0 + f0 * (1.0 / (table.x + table.y) - 1.0));
}

/// A pigment behind an interface that reflects `light` specularly: it gets the
/// part of white light that the interface doesn't reflect. Albedo scaling, as in
/// Kulla and Conty 2017, "Revisiting physically based shading at Imageworks".
fn coupled(f0: vec3f, diffuse: vec3f, light: vec3f, table: vec2f) -> vec3f {
    return diffuse * (1.0 - directional_albedo(f0, table)) + light;
}
