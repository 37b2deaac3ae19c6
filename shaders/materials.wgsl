// Materials of surfaces: those of the lecture's test scene, and
// those from textures. PV227 lecture 11, "Test scene" and task 2.

/// Albedo, black for metals, and reflectance at normal incidence, each linear and per channel.
struct Material {
    diffuse: vec3f,
    f0: vec3f,
}

/// A dielectric of index 1.5 in air, ((1.5 - 1) / (1.5 + 1))^2.
const DIELECTRIC_F0: f32 = 0.04;

/// Red, green and blue plastic, iron, copper, gold, aluminium, silver.
///
/// Metals: Akenine-Moeller et al. 2018 (Real-Time Rendering, 4th edition), table 9.2, linear sRGB.
/// Sources differ, most of all for iron: its measured index gives .53 .51 .50. Gold's red, 1.022
/// as gold is outside of the gamut of sRGB, is clamped to 1.
const MATERIALS = array<Material, 8>(
    Material(vec3f(0.80, 0.05, 0.05), vec3f(DIELECTRIC_F0)),
    Material(vec3f(0.05, 0.80, 0.05), vec3f(DIELECTRIC_F0)),
    Material(vec3f(0.05, 0.05, 0.80), vec3f(DIELECTRIC_F0)),
    Material(vec3f(), vec3f(0.562, 0.565, 0.578)),
    Material(vec3f(), vec3f(0.955, 0.638, 0.538)),
    Material(vec3f(), vec3f(1.000, 0.782, 0.344)),
    Material(vec3f(), vec3f(0.913, 0.922, 0.924)),
    Material(vec3f(), vec3f(0.972, 0.960, 0.915)),
);

/// The lecture's roughnesses, from the top row down. 0 is
/// a mirror, which isn't a distribution of microfacets.
const ROUGHNESSES = array<f32, 8>(0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5);

/// The material of a column of the test scene; columns beyond the eighth begin again.
fn material(column: u32) -> Material {
    return MATERIALS[column % 8u];
}

/// The roughness of a row of the test scene; rows beyond the eighth begin again.
fn roughness(row: u32) -> f32 {
    return ROUGHNESSES[row % 8u];
}

/// The width of the distribution in the lecture, which passes roughness to the sampler unchanged.
fn alpha_from_roughness(roughness: f32) -> f32 {
    return roughness;
}

/// The width of the distribution in Karis 2013, "Specular D": roughness^2, so that equal steps of
/// roughness look equal (after Burley 2012, section 5.4).
fn alpha_from_roughness_squared(roughness: f32) -> f32 {
    return roughness * roughness;
}

/// Roughness under a mask: `mask` = 0 keeps `roughness`, 1 gives `painted`, both to the bit.
/// PV227 lecture 11, task 2. The mask comes from a linear texture: sRGB would distort it.
///
/// It doesn't use `mix`, which some drivers compute as roughness + (painted - roughness) *
/// mask: at mask = 1 that leaves a rounding error, and a mirror would not stay a mirror.
fn masked_roughness(roughness: f32, painted: f32, mask: f32) -> f32 {
    return roughness * (1.0 - mask) + painted * mask;
}

/// A material from the linear texels of a base colour and of `metallic`: a dielectric at 0, whose
/// base colour is its albedo; a metal at 1, whose base colour is its reflectance.
/// Burley 2012, section 5.1; glTF 2.0, appendix B.2.
fn material_from_texels(base_color: vec3f, metallic: f32) -> Material {
    let dielectric = 1.0 - metallic;
    return Material(base_color * dielectric, DIELECTRIC_F0 * dielectric + base_color * metallic);
}
