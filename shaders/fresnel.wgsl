// Fresnel reflectance: the share of light that a smooth interface reflects.

import package::math::pow5;

/// Reflectance at the angle whose cosine is `v_dot_h`, from `f0`, the reflectance at normal
/// incidence. Schlick 1994.
///
/// `v_dot_h` lies in 0..=1, but V.H of two unit vectors often rounds to just above 1. The fifth
/// power of that tiny negative difference would be a negative reflectance where `f0` is 0. `abs`
/// makes it vanish (below 1e-30), is free on hardware and, unlike `max` or `saturate`, can't turn
/// a NaN into a plausible number.
fn schlick(f0: vec3f, v_dot_h: f32) -> vec3f {
    return f0 + (1.0 - f0) * pow5(abs(1.0 - v_dot_h));
}

/// Exact reflectance of unpolarised light at a dielectric interface.
/// Pharr et al. 2023 (pbrt-v4), section 9.3.5, from Fresnel's r_s and r_p.
///
/// `eta` = n_t / n_i, made for 0.4..=2.5: from diamond to air up to air to diamond. `cos_i` lies
/// in 0..=1; a caller on the far side of the interface passes 1 / eta and a positive cosine.
/// Total internal reflection returns 1. At eta = 1 there is no interface and the result is 0,
/// also at cos_i = 0, where the limit depends on the way there.
///
/// The textbook's differences c - g and eta^2 c - g cancel for eta near 1 and near Brewster's
/// angle, so both amplitudes are multiplied by their conjugates here. With q = eta^2 - 1:
///     c^2       - g^2 = -q
///     eta^4 c^2 - g^2 =  q (c^2 (eta^2 + 1) - 1)
/// For eta >= 1 nothing is left that cancels, except the last factor, whose zero is Brewster's
/// angle and which r_s outweighs there. For eta < 1, g^2 cancels near the critical angle, where
/// the function itself has an infinite slope: no algebra helps there.
fn dielectric(eta: f32, cos_i: f32) -> f32 {
    // Exact next to eta = 1, as the rounding of eta * eta would not be.
    let q = (eta - 1.0) * (eta + 1.0);
    if (q == 0.0) {
        return 0.0;
    }
    let c2 = cos_i * cos_i;
    let g2 = q + c2; // (eta cos_t)^2, by Snell's law
    if (g2 < 0.0) {
        return 1.0;
    }
    let g = sqrt(g2);
    let eta2 = eta * eta;
    let s = cos_i + g;
    let p = eta2 * cos_i + g;
    let r_s = q / (s * s);
    let r_p = q * (c2 * (eta2 + 1.0) - 1.0) / (p * p);
    return 0.5 * (r_s * r_s + r_p * r_p);
}
