// Quantities of light, and conversions between them. PV227 lecture 11, "Light"; the article,
// "Physics terms". Flux in W, intensity in W/sr, irradiance and radiosity in W/m^2, radiance
// in W/(m^2 sr), BRDFs in 1/sr; lengths in m, areas in m^2, angles in rad, solid angles in sr.

import package::math::PI;

const INV_PI: f32 = 0.31830988618379067154;
/// One over the solid angle of the whole sphere.
const INV_4_PI: f32 = 0.079577471545947667884;

/// Intensity of a point that sends `flux` evenly into all directions.
fn intensity_from_flux(flux: f32) -> f32 {
    return flux * INV_4_PI;
}

/// Irradiance from a point of `intensity` at `distance`, on a surface that the light reaches
/// at the angle whose cosine is `cos_theta`. The inverse square law and Lambert's cosine law.
///
/// Divides twice: the square of a distance below 1e-19 would be 0.
fn irradiance_from_intensity(intensity: f32, cos_theta: f32, distance: f32) -> f32 {
    return intensity * cos_theta / distance / distance;
}

/// Irradiance on a surface from light of `radiance` that fills a small `solid_angle` around the
/// direction with cosine `cos_theta`: dE = L cos dw.
fn irradiance_from_radiance(radiance: f32, solid_angle: f32, cos_theta: f32) -> f32 {
    return radiance * cos_theta * solid_angle;
}

/// The inverse of `irradiance_from_radiance`: L = dE / (cos dw). Both divisors are
/// above 0: at grazing, or for no solid angle, irradiance doesn't determine radiance.
fn radiance_from_irradiance(irradiance: f32, solid_angle: f32, cos_theta: f32) -> f32 {
    return irradiance / cos_theta / solid_angle;
}

/// Irradiance by a uniform disc of light around the normal that reaches `half_angle` from it, in
/// 0..=pi/2: the integral of L cos, pi L sin^2. A whole sky gives pi L.
fn irradiance_from_cap(radiance: f32, half_angle: f32) -> f32 {
    let s = sine(half_angle);
    return PI * radiance * s * s;
}

/// Irradiance by a patch that is small beside its `distance`, with the cosines of the angles at
/// which light leaves the patch and reaches the receiver.
fn irradiance_from_patch(
    radiance: f32,
    area: f32,
    cos_emitter: f32,
    cos_receiver: f32,
    distance: f32,
) -> f32 {
    let solid_angle = patch_solid_angle(area, cos_emitter, distance);
    return irradiance_from_radiance(radiance, solid_angle, cos_receiver);
}

/// Flux per area that a Lambertian returns in all directions together.
fn lambert_radiosity(albedo: f32, irradiance: f32) -> f32 {
    return albedo * irradiance;
}

/// Radiance of a Lambertian, the same in all directions: its radiosity over pi.
fn lambert_radiance(albedo: f32, irradiance: f32) -> f32 {
    return albedo * irradiance * INV_PI;
}

/// A mirror's BRDF, delta / cos, with the delta spread over a small `solid_angle`
/// around the mirror direction: 1 / (cos dw). It grows without bound as the solid
/// angle shrinks, so that the outgoing radiance equals the incoming radiance.
fn mirror_brdf(n_dot_l: f32, solid_angle: f32) -> f32 {
    return 1.0 / n_dot_l / solid_angle;
}

/// Returns `true` if a surface that reflects `directional_albedo`
/// of the incoming light creates no energy. White, 1, is allowed.
fn conserves_energy(directional_albedo: f32) -> bool {
    return directional_albedo <= 1.0;
}

/// Solid angle of a cone that reaches `half_angle`, in 0..=pi, from its axis: 2 pi (1 - cos).
///
/// Computed as 4 pi sin^2(half_angle / 2): the difference has no correct digit at the sun's 0.0047 rad.
fn cap_solid_angle(half_angle: f32) -> f32 {
    let s = sine(0.5 * half_angle);
    return 4.0 * PI * s * s;
}

/// Solid angle of a patch that is small beside its `distance`.
fn patch_solid_angle(area: f32, cos_emitter: f32, distance: f32) -> f32 {
    return area * cos_emitter / distance / distance;
}

/// Solid angle of a texel of a cube map whose faces are `size`
/// texels, 1..=2^20, wide. It is the same on all faces.
///
/// The sum of two triangles, tan(w / 2) = a.(b x c) / (|a||b||c| + (a.b)|c| + (b.c)|a| +
/// (c.a)|b|). Van Oosterom and Strackee 1983, eq. 8. The usual difference of four arctangents
/// of order 1 has no correct digit for a small texel in f32; here nothing cancels.
fn texel_solid_angle(size: u32, column: u32, row: u32) -> f32 {
    if (size == 1u) {
        return 2.0 * PI / 3.0; // a sixth of the sphere; the series below is made for less
    }
    // Edges of the texel on the face z = 1, which goes from -1 to 1.
    // Differences of integers are exact, those of quotients would not be.
    let edge = 1.0 / f32(size);
    let low = vec2f(vec2i(2 * i32(column), 2 * i32(row)) - i32(size)) * edge;
    let high = vec2f(vec2i(2 * i32(column), 2 * i32(row)) + 2 - i32(size)) * edge;
    let a = vec3f(low, 1.0);
    let b = vec3f(high.x, low.y, 1.0);
    let c = vec3f(high, 1.0);
    let d = vec3f(low.x, high.y, 1.0);
    // The triple product of a triangle in the plane z = 1 is twice its area.
    let doubled_area = 4.0 * edge * edge;
    let abc = doubled_area / triangle_denominator(a, b, c);
    let acd = doubled_area / triangle_denominator(a, c, d);
    return 2.0 * (arctangent(abc) + arctangent(acd));
}

/// The divisor of Van Oosterom and Strackee. Corners of one texel lie in one quadrant when there
/// are two or more across, so that all dot products are at least 1.
fn triangle_denominator(a: vec3f, b: vec3f, c: vec3f) -> f32 {
    let lengths = vec3f(length(a), length(b), length(c));
    return lengths.x * lengths.y * lengths.z
        + dot(a, b) * lengths.z + dot(b, c) * lengths.x + dot(c, a) * lengths.y;
}

/// atan for 0..=0.172, the largest value for half a texel,
/// by its series: the first omitted term is 2e-9 of it.
///
/// WGSL allows `atan` an error of 4096 ulp, up to 5e-4 of a texel.
fn arctangent(x: f32) -> f32 {
    let x2 = x * x;
    return x * (1.0 - x2 * (1.0 / 3.0 - x2 * (1.0 / 5.0 - x2 * (1.0 / 7.0 - x2 / 9.0))));
}

/// sin for 0..=pi/2, by its series: the first omitted term is below 7e-10.
///
/// WGSL bounds the error of `sin` by 2^-11 for any angle: a tenth of the sun's 0.0047.
fn sine(x: f32) -> f32 {
    let x2 = x * x;
    return x * (1.0 - x2 / 6.0 * (1.0 - x2 / 20.0 * (1.0 - x2 / 42.0 * (1.0 - x2 / 72.0
        * (1.0 - x2 / 110.0 * (1.0 - x2 / 156.0))))));
}
