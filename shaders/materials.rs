//! Rust counterpart of `materials.wgsl`: the materials of the lecture's test scene. PV227 lecture 11.

use glam::{DVec3, Vec3};

/// The names of the materials in the test scene's columns, from left to right.
pub const NAMES: [&str; 8] = [
    "red plastic",
    "green plastic",
    "blue plastic",
    "iron",
    "copper",
    "gold",
    "aluminium",
    "silver",
];

/// Reflectance at normal incidence of a dielectric of index 1.5.
const DIELECTRIC_F0: f32 = 0.04;

/// The albedo and the reflectance at normal incidence of each column's material, in linear sRGB.
///
/// The values of metals are from Akenine-Moeller et al. 2018 (Real-Time Rendering, 4th edition), table 9.2. Sources
/// differ, most of all for iron. The red channel of gold is 1.022 in linear sRGB, because gold is outside the gamut.
/// This table contains 1 instead. Plastics have the f0 of a dielectric, and no channel of their albedo is 0.
pub const MATERIALS: [(Vec3, Vec3); 8] = [
    (Vec3::new(0.80, 0.05, 0.05), Vec3::splat(DIELECTRIC_F0)),
    (Vec3::new(0.05, 0.80, 0.05), Vec3::splat(DIELECTRIC_F0)),
    (Vec3::new(0.05, 0.05, 0.80), Vec3::splat(DIELECTRIC_F0)),
    (Vec3::ZERO, Vec3::new(0.562, 0.565, 0.578)),
    (Vec3::ZERO, Vec3::new(0.955, 0.638, 0.538)),
    (Vec3::ZERO, Vec3::new(1.000, 0.782, 0.344)),
    (Vec3::ZERO, Vec3::new(0.913, 0.922, 0.924)),
    (Vec3::ZERO, Vec3::new(0.972, 0.960, 0.915)),
];

/// The lecture's roughnesses, from the top row down. 0 means a mirror.
pub const ROUGHNESSES: [f32; 8] = [0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5];

karat::shareable! {
    /// The properties of a surface, except its roughness.
    pub struct Material mirrors MaterialMirror {
        /// Albedo per channel. Metals are black.
        diffuse: Vec3,
        /// Reflectance at normal incidence per channel.
        f0: Vec3,
    }
}

/// Returns the material of a column. Columns from the ninth on repeat the eight materials.
#[must_use]
pub fn material(column: u32) -> MaterialMirror {
    let (diffuse, f0) = MATERIALS[column as usize % MATERIALS.len()];
    MaterialMirror { diffuse: diffuse.as_dvec3(), f0: f0.as_dvec3() }
}

/// Returns the roughness of a row. Rows from the ninth on repeat the eight roughnesses.
#[must_use]
pub fn roughness(row: u32) -> f64 {
    f64::from(ROUGHNESSES[row as usize % ROUGHNESSES.len()])
}

/// Returns `roughness` unchanged, because the lecture uses its roughness m as the width alpha in Walter et al. 2007,
/// eq. 33.
#[must_use]
pub fn alpha_from_roughness(roughness: f64) -> f64 {
    roughness
}

/// Computes alpha = roughness^2, as in Karis 2013, "Specular D".
#[must_use]
pub fn alpha_from_roughness_squared(roughness: f64) -> f64 {
    roughness.powi(2)
}

/// Computes the blend (1 - mask) roughness + mask painted.
#[must_use]
pub fn masked_roughness(roughness: f64, painted: f64, mask: f64) -> f64 {
    roughness + (painted - roughness) * mask
}

/// Computes the material of glTF 2.0, appendix B.2: `metallic` blends the albedo from the base colour to black, and f0
/// from 0.04 to the base colour.
#[must_use]
pub fn material_from_texels(base_color: DVec3, metallic: f64) -> MaterialMirror {
    let dielectric_f0 = DVec3::splat(f64::from(DIELECTRIC_F0));
    MaterialMirror {
        diffuse: base_color.lerp(DVec3::ZERO, metallic),
        f0: dielectric_f0.lerp(base_color, metallic),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fresnel;

    #[test]
    fn metals_have_no_diffuse_and_all_reflect() {
        for (name, (diffuse, f0)) in NAMES.into_iter().zip(MATERIALS) {
            assert_eq!(diffuse == Vec3::ZERO, !name.ends_with("plastic"), "{name}");
            assert!(f0.min_element() >= 0.04 && f0.max_element() <= 1.0, "{name}");
        }
    }

    #[test]
    fn plastics_are_what_they_are_called() {
        for (channel, (diffuse, _)) in MATERIALS.into_iter().take(3).enumerate() {
            assert_eq!(diffuse.max_position(), channel);
            // Energy is conserved at normal incidence.
            assert!(diffuse.max_element() + DIELECTRIC_F0 <= 1.0);
        }
        assert!((fresnel::dielectric(1.5, 1.0) - f64::from(DIELECTRIC_F0)).abs() < 1e-9);
    }

    #[test]
    fn metals_are_near_what_their_measured_index_gives() {
        // The measured indices n + i k at 650, 550 and 450 nm are from Johnson and Christy 1972 and 1974 and from Rakic
        // et al. 1998. They are samples of the spectrum, not integrals. So they only show that each metal is the right
        // one, with its channels in the right order.
        let measured = [
            (3, [(2.91, 3.09), (2.95, 2.93), (2.58, 2.77)]),
            (4, [(0.27, 3.61), (0.68, 2.62), (1.32, 2.29)]),
            (5, [(0.18, 3.42), (0.42, 2.35), (1.37, 1.77)]),
            (6, [(1.52, 7.66), (0.97, 6.46), (0.53, 5.07)]),
            (7, [(0.16, 4.07), (0.15, 3.19), (0.14, 2.20)]),
        ];
        for (column, indices) in measured {
            let f0 = DVec3::from(indices.map(|(eta, k)| fresnel::conductor(eta, k, 1.0)));
            let difference = (f0 - material(column).f0).abs().max_element();
            assert!(difference < 0.09, "{}: {f0}", NAMES[column as usize]);
        }
    }

    #[test]
    fn roughness_begins_at_the_mirror_and_rises() {
        assert_eq!(ROUGHNESSES[0], 0.0);
        assert!(ROUGHNESSES.is_sorted_by(|a, b| a < b));
    }

    #[test]
    fn both_mappings_share_their_ends() {
        for (roughness, squared) in [(0.0, 0.0), (0.5, 0.25), (1.0, 1.0)] {
            assert_eq!(alpha_from_roughness(roughness), roughness);
            assert_eq!(alpha_from_roughness_squared(roughness), squared);
        }
    }

    #[test]
    fn texels_make_plastics_and_metals() {
        let base_color = DVec3::new(0.8, 0.5, 0.1);
        let plastic = material_from_texels(base_color, 0.0);
        assert_eq!(plastic.diffuse, base_color);
        assert!(plastic.f0.abs_diff_eq(DVec3::splat(0.04), 1e-8));
        let metal = material_from_texels(base_color, 1.0);
        assert_eq!((metal.diffuse, metal.f0), (DVec3::ZERO, base_color));
    }
}
