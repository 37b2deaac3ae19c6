// A thin shiny layer over any base. PV227 lecture 11, task 3.
//
// The layer is fully transparent except for its perfect reflection. The
// model ignores absorption, and light that bounces between layer and base.

import package::fresnel::schlick;

/// Reflectance of the coat at normal incidence: a dielectric of index 1.5 in air,
/// ((1.5 - 1) / (1.5 + 1))^2.
const COAT_F0: f32 = 0.04;

/// Radiance that leaves a coated surface: F_c of `environment`, the radiance from the
/// mirror direction, and the rest of `base`, the radiance of the surface without the coat.
///
/// White `environment` and white `base` give white, to the bit: the difference is
/// exactly 0. (The sum F + (1 - F) is 1 on paper, but a compiler may fold the 1
/// into Schlick's f0 and round the two apart.) No energy is lost. The price: the
/// weight of the base depends only on V, so the layered BRDF isn't reciprocal.
fn thin_coat(environment: vec3f, base: vec3f, n_dot_v: f32) -> vec3f {
    return base + schlick(vec3f(COAT_F0), n_dot_v) * (environment - base);
}

/// The reciprocal weight of the base: light crosses the coat on its way in and on its way out.
///
/// It ignores light that the coat reflects back to the base, and so
/// loses energy: 8.2 % over a white Lambertian base at normal incidence.
fn thin_coat_reciprocal_weight(n_dot_v: f32, n_dot_l: f32) -> f32 {
    return transmittance(n_dot_v) * transmittance(n_dot_l);
}

/// The base with semi-transparent white areas, below the coat: `mask` = 0 is `base`, 1 `white`,
/// the radiance of a white Lambertian in the same place.
///
/// It doesn't use `mix`: some drivers compute that as base + (white - base) * mask,
/// which at mask = 1 returns the rounding error of a bright base if `white` is dark.
fn masked_base(base: vec3f, white: vec3f, mask: f32) -> vec3f {
    return base * (1.0 - mask) + white * mask;
}

/// 1 - F_c, the share of light that crosses the coat once.
fn transmittance(n_dot_x: f32) -> f32 {
    return interface_transmittance(vec3f(COAT_F0), n_dot_x).x;
}

/// Radiance that leaves a plastic: `specular`, the light from around the
/// mirror direction that its interface of reflectance `f0` reflects, and
/// the rest of `base`, the light of its pigment without an interface.
///
/// The lecture adds the two unchanged (E16): its red plastic returns 1.58 times the
/// light that it receives at grazing. For a mirror-like interface no energy is
/// gained or lost. A rough one reflects another share than F(N.V), so that a white
/// base gains up to 0.12 % (alpha 0.1, 53 degrees) and loses 2 % at alpha 1. As for
/// `thin_coat`, the weight of the base depends only on V: the price is reciprocity.
fn plastic(f0: vec3f, base: vec3f, specular: vec3f, n_dot_v: f32) -> vec3f {
    return base * interface_transmittance(f0, n_dot_v) + specular;
}

/// 1 - F of Schlick's F, the share of light that crosses an interface once.
///
/// With x = 1 - c: 1 - x^5 = c (1 + x + x^2 + x^3 + x^4), a sum of positive terms. The plain
/// difference has few correct digits left at grazing, where both sides approach 1.
fn interface_transmittance(f0: vec3f, n_dot_x: f32) -> vec3f {
    let x = 1.0 - n_dot_x;
    return (1.0 - f0) * (n_dot_x * (1.0 + x * (1.0 + x * (1.0 + x * (1.0 + x)))));
}
