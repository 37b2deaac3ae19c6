// Radiometry as the lecture and the article define it, with
// their mistakes. `radiometry.wgsl` has the corrected functions.

import package::math::TAU;

const INV_PI: f32 = 0.31830988618379067154;

/// E3. The article, "Physics terms": irradiance is "the sum of all the radiance" over
/// the hemisphere, here of a uniform sky divided into `rings` of equal solid angle.
///
/// Wrong: each radiance counts with the cosine of its angle. A sky of radiance 1 gives 2 pi, not
/// pi.
fn irradiance_of_sky(radiance: f32, rings: u32) -> f32 {
    var sum = 0.0;
    for (var i = 0u; i < rings; i++) {
        sum += radiance * (TAU / f32(rings));
    }
    return sum;
}

/// E4. PV227 lecture 11, "Properties of BRDF": the integral of f cos must be less than 1.
///
/// Wrong: a white Lambertian has exactly 1. It loses nothing and creates nothing.
fn conserves_energy(directional_albedo: f32) -> bool {
    return directional_albedo < 1.0;
}

/// E5. The article, "The rendering equation": the integral of f over the outgoing
/// directions, with the cosine of the *incoming* one, must not exceed 1. Here f is
/// a Lambertian's, and the hemisphere is divided into `rings` of equal solid angle.
///
/// Wrong: the cosine belongs to the direction of integration. The law as written gives
/// 2 albedo (N.L): a white Lambertian would double light at normal incidence, and one
/// of albedo 2, which does double it, would conserve energy for N.L up to 1/4.
fn directional_albedo(albedo: f32, n_dot_l: f32, rings: u32) -> f32 {
    var sum = 0.0;
    for (var i = 0u; i < rings; i++) {
        sum += albedo * INV_PI * n_dot_l * (TAU / f32(rings));
    }
    return sum;
}

/// E6. The article, "The rendering equation": a mirror's BRDF is 1 in the
/// mirror direction. Here it is 1 in a small `solid_angle` around it.
///
/// Wrong: it is delta / cos. A number that doesn't grow as the solid angle
/// shrinks reflects almost nothing in the end: of the sun's radiance, 6.8e-5.
fn mirror_brdf(n_dot_l: f32, solid_angle: f32) -> f32 {
    return 1.0;
}
