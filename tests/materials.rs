//! Tests materials: the lecture's table, roughness, masks and texels.

use glam::{DVec3, Vec3};
use karat::prelude::*;
use shaders::materials::{self, MATERIALS, Material, NAMES, ROUGHNESSES};
use shaders::{PBR, fresnel};

/// The shader and the reference have the same constants, so their results are equal to the bit, also for indices beyond
/// the table's end.
#[test]
fn the_table_is_its_twin() {
    PBR.function("materials::material")
        .over(Integers(0..=23_u32))
        .agrees_with(materials::material, Ulp(0.0));
    PBR.function("materials::roughness")
        .over(Integers(0..=23_u32))
        .agrees_with(materials::roughness, Ulp(0.0));
    assert_eq!((NAMES.len(), MATERIALS.len(), ROUGHNESSES.len()), (8, 8, 8));
}

#[test]
fn metals_have_no_diffuse_and_all_reflect() {
    PBR.function("materials::material").over(Integers(0..=7_u32)).satisfies(
        "has a diffuse colour only if it is a plastic, and f0 in 0.04..=1",
        |column, Material { diffuse, f0 }| {
            let plastic = column < 3;
            (diffuse != Vec3::ZERO) == plastic
                && (f0 == Vec3::splat(0.04)) == plastic
                && f0.cmpge(Vec3::splat(0.04)).all()
                && f0.cmple(Vec3::ONE).all()
        },
    );
}

/// A material reflects the share f0 of the light specularly, and a part of the rest diffusely. Together, these two
/// parts are at most the incoming light.
#[test]
fn no_material_reflects_more_than_it_receives() {
    PBR.function("materials::material")
        .over(Integers(0..=7_u32))
        .satisfies("has f0 + (1 - f0) diffuse of at most 1", |_, Material { diffuse, f0 }| {
            (f0 + (Vec3::ONE - f0) * diffuse).max_element() <= 1.0
        });
}

/// The plastics have the f0 of a dielectric with index 1.5.
#[test]
fn plastics_have_the_reflectance_of_their_index() {
    PBR.function("materials::material")
        .over(Integers(0..=2_u32))
        .satisfies("has the f0 of index 1.5", |_, Material { f0, .. }| {
            f0.x == fresnel::dielectric(1.5, 1.0) as f32
        });
}

/// In the lecture, the roughness itself is the width alpha of the lobe. Karis squares the roughness, so the result has
/// one rounding.
#[test]
fn alpha_from_roughness() {
    PBR.function("materials::alpha_from_roughness")
        .over(0.0..=1.0)
        .agrees_with(materials::alpha_from_roughness, Ulp(0.0));
    PBR.function("materials::alpha_from_roughness_squared")
        .over(0.0..=1.0)
        .agrees_with(materials::alpha_from_roughness_squared, Ulp(1.0));
}

/// The function has three roundings of positive terms, and the rounding of 1 - mask.
#[test]
fn masked_roughness() {
    PBR.function("materials::masked_roughness")
        .over((0.0..=1.0, 0.0..=1.0, 0.0..=1.0))
        .agrees_with(materials::masked_roughness, Ulp(4.0).or(Abs(1e-30)));
}

/// At a mask of 0, the result is exactly the surface's roughness, and at a mask of 1, exactly the paint's roughness.
#[test]
fn masks_are_exact_at_both_ends() {
    let kept = |roughness: f64, _: f64, _: f64| roughness;
    PBR.function("materials::masked_roughness")
        .over((0.0..=1.0, 0.0..=1.0, Just(0.0)))
        .agrees_with(kept, Ulp(0.0));
    let painted = |_: f64, painted: f64, _: f64| painted;
    PBR.function("materials::masked_roughness")
        .over((0.0..=1.0, 0.0..=1.0, Just(1.0)))
        .agrees_with(painted, Ulp(0.0));
}

/// If the paint has the roughness of the surface, the mask has no effect: 1 - mask and mask add up to 1, except for
/// rounding.
#[test]
fn painting_the_same_roughness_changes_nothing() {
    let same = (0.0..=1.0_f32, 0.0..=1.0_f32).map(|(roughness, mask)| (roughness, roughness, mask));
    PBR.function("materials::masked_roughness")
        .over(same)
        .agrees_with(|roughness: f64, _: f64, _: f64| roughness, Ulp(3.0).or(Abs(1e-30)));
}

/// The function blends f0 by `metallic` with the operations of `masked_roughness`, so it has the same error.
#[test]
fn material_from_texels() {
    PBR.function("materials::material_from_texels")
        .over((UnitRgb, 0.0..=1.0))
        .agrees_with(materials::material_from_texels, Ulp(4.0).or(Abs(1e-30)));
}

/// For any texture, energy is conserved at normal incidence, and a metal has no diffuse part.
#[test]
fn materials_from_texels_conserve_energy() {
    PBR.function("materials::material_from_texels").over((UnitRgb, 0.0..=1.0)).satisfies(
        "has f0 + (1 - f0) diffuse of at most 1",
        |(_, metallic), Material { diffuse, f0 }| {
            let reflected = f0 + (Vec3::ONE - f0) * diffuse;
            reflected.max_element() <= 1.0 + 2.0 * f32::EPSILON
                && (metallic < 1.0 || diffuse == Vec3::ZERO)
        },
    );
    PBR.function("materials::material_from_texels").over((UnitRgb, Just(1.0))).agrees_with(
        |base_color: DVec3, _: f64| materials::MaterialMirror {
            diffuse: DVec3::ZERO,
            f0: base_color,
        },
        Ulp(0.0),
    );
}

/// As the mask grows, the roughness of the surface approaches the paint's roughness: it rises for rougher paint, and
/// falls for smoother paint. Three roundings may cause small steps in the opposite direction.
#[test]
fn masks_go_one_way() {
    let over = |kept: std::ops::RangeInclusive<f32>, painted| {
        PBR.function("materials::masked_roughness").over((kept, painted, 0.0..=1.0))
    };
    over(0.0..=0.5, 0.5..=1.0).is_monotone_in("mask", Trend::Increasing, Ulp(4.0));
    over(0.5..=1.0, 0.0..=0.5).is_monotone_in("mask", Trend::Decreasing, Ulp(4.0));
    over(0.0..=1.0, 0.0..=1.0).is_monotone_in("roughness", Trend::Increasing, Ulp(4.0));
}
