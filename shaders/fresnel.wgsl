// Fresnel reflectance: the share of light that a smooth interface reflects.

import package::math::pow5;

/// Reflectance at the angle whose cosine is `v_dot_h`, from `f0`, the reflectance at normal
/// incidence. Schlick 1994.
///
/// `v_dot_h` lies in 0..=1, but V.H of two unit vectors often rounds to just above 1.
/// The fifth power of that tiny negative difference would be a negative reflectance
/// if `f0` is 0. `abs` makes it vanish (below 1e-30), is free on hardware and, unlike
/// `max` or `saturate`, can't turn a NaN into a plausible number.
fn schlick(f0: vec3f, v_dot_h: f32) -> vec3f {
    return f0 + (1.0 - f0) * pow5(abs(1.0 - v_dot_h));
}

/// Exact reflectance of unpolarised light at a dielectric interface.
/// Pharr et al. 2023 (pbrt-v4), section 9.3.5, from Fresnel's r_s and r_p.
///
/// `eta` = n_t / n_i, designed for 0.4..=2.5: from diamond to air up to air to diamond.
/// `cos_i` lies in 0..=1; a caller on the far side of the interface passes 1 / eta and a
/// positive cosine. Total internal reflection returns 1. At eta = 1 there is no interface and
/// the result is 0, also at cos_i = 0, where the limit depends on the direction of approach.
///
/// The textbook's differences c - g and eta^2 c - g cancel for eta near 1 and near Brewster's
/// angle, so this form multiplies both amplitudes by their conjugates. With q = eta^2 - 1:
///     c^2       - g^2 = -q
///     eta^4 c^2 - g^2 =  q (c^2 (eta^2 + 1) - 1)
/// For eta >= 1 nothing cancels any more, except the last factor, which is zero at
/// Brewster's angle, where r_s outweighs it. For eta < 1, g^2 cancels near the critical
/// angle, where the function itself has an infinite slope: no other form helps there.
fn dielectric(eta: f32, cos_i: f32) -> f32 {
    // Exact near eta = 1, unlike the rounded eta * eta.
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

/// Exact reflectance of unpolarised light at a metal, of complex index `eta` + i `k`, seen from
/// air. Born and Wolf 1999, section 14.2; Pharr et al. 2023 (pbrt-v4), section 9.3.6.
///
/// `eta` is designed for 0.05..=10 and `k` for 0..=10, k at least 1e-18 if it
/// isn't 0, so that its square is a normal number. With k = 0 it is a dielectric,
/// and eta = 1 means no interface and the result 0. `cos_i` lies in 0..=1.
///
/// As in `dielectric`, with complex numbers: e = (eta + i k)^2, q = e - 1 and g^2 = q + c^2,
///     r_s = -q / (c + g)^2        r_p = q (c^2 e - s^2) / (e c + g)^2
/// Squared moduli of these need no complex division. Nothing cancels in them, except what cancels
/// in `dielectric`, too: c^2 e - s^2 at Brewster's angle, and g^2 near the critical angle.
fn conductor(eta: f32, k: f32, cos_i: f32) -> f32 {
    // |q|^2 = |eta + i k - 1|^2 |eta + i k + 1|^2
    let q2 = ((eta - 1.0) * (eta - 1.0) + k * k) * ((eta + 1.0) * (eta + 1.0) + k * k);
    if (q2 == 0.0) {
        return 0.0;
    }
    let c2 = cos_i * cos_i;
    let s2 = (1.0 - cos_i) * (1.0 + cos_i);
    let e = vec2f((eta - k) * (eta + k), 2.0 * eta * k);
    let q = (eta - 1.0) * (eta + 1.0) - k * k;
    // g^2 by the smaller two of e - s^2 = q + c^2: at grazing, q is exact where e rounds to 1.
    let g = complex_root(vec2f(select(e.x - s2, q + c2, c2 < 0.5), e.y));
    let s = g + vec2f(cos_i, 0.0);
    let p = e * cos_i + g;
    let brewster = vec2f(c2 * e.x - s2, c2 * e.y);
    let r_s = 1.0 / dot(s, s);
    let r_p = length(brewster) / dot(p, p);
    return 0.5 * q2 * (r_s * r_s + r_p * r_p);
}

/// The root with positive parts of z.x + i z.y, z.y >= 0. One part is computed from the
/// modulus as a sum, the other one from the product of both: as a difference it would cancel.
fn complex_root(z: vec2f) -> vec2f {
    let larger = sqrt(0.5 * (length(z) + abs(z.x)));
    if (larger == 0.0) {
        return vec2f();
    }
    let smaller = 0.5 * z.y / larger;
    return select(vec2f(smaller, larger), vec2f(larger, smaller), z.x >= 0.0);
}

/// Mean of `schlick` over the hemisphere, weighted by the cosine: the share of
/// a uniform sky that a surface reflects. 2 int c F(c) dc = f0 + (1 - f0) / 21.
fn schlick_average(f0: vec3f) -> vec3f {
    return (1.0 + 20.0 * f0) / 21.0;
}

/// Mean of `dielectric` over the hemisphere, weighted by the cosine, for `eta` in 0.4..=2.5.
///
/// The closed form (Duntley 1942) is a sum of terms that grow as 1 / (eta - 1)^2
/// and cancel: in f32 it has no correct digits near eta = 1. Here, for eta > 1,
/// the variable is x = -r_s = (g - c) / (g + c), which falls from 1 at grazing
/// to x0 = (eta - 1) / (eta + 1). With q = eta^2 - 1 and w = q / (eta^2 + 1),
///     d(c^2) = q / 4 (1 - 1 / x^2) dx    r_p = (w - x) / (1 - w x)
/// so that the integral of r_s^2 is a polynomial, and that of r_p^2 has elementary
/// terms and a rest without poles near 0..=1, for which six Gauss points are enough.
///
/// For eta < 1, the same energy passes in both directions: eta^2 (1 - F(1 / eta)) = 1 - F(eta).
fn dielectric_average(eta: f32) -> f32 {
    let d = abs(eta - 1.0);
    if (d == 0.0) {
        return 0.0;
    }
    // All of these are the same for eta and 1 / eta.
    let sum = eta + 1.0;
    let x0 = d / sum;
    let w = d * sum / (eta * eta + 1.0);
    let w_over_x0 = sum * sum / (eta * eta + 1.0);
    let s = 2.0 / 3.0 - x0 + x0 * x0 * x0 / 3.0;
    let p = (1.0 - x0) * (1.0 - 4.0 * w * w + w * (1.0 + x0) + w * w_over_x0)
        + 2.0 * w * (1.0 - w * w) * log(x0)
        + dielectric_average_rest(w, x0);
    let outside = d * sum / 8.0 * (s + p); // by q of eta above 1, by -q of eta below
    if (eta > 1.0) {
        return outside;
    }
    // 1 - eta^2 + eta^2 F(1 / eta), whose q is that of `outside` over eta^2.
    return d * sum + outside;
}

/// Integral over x0..=1 of (x - w)^2 (3 w^2 - 1 - 2 w^3 x) / (1 - w x)^2, by Gauss's six points:
/// within 5e-7 at eta = 2.5, where the pole is nearest, and more exact than f32 at eta = 1.5.
fn dielectric_average_rest(w: f32, x0: f32) -> f32 {
    let middle = 0.5 * (1.0 + x0);
    let half = 0.5 * (1.0 - x0);
    // Abscissae and weights: Abramowitz and Stegun 1964, table 25.4.
    let near = rest_pair(w, middle, half * 0.23861918608319690863);
    let mean = rest_pair(w, middle, half * 0.66120938646626451366);
    let far = rest_pair(w, middle, half * 0.93246951420315202781);
    return half * (0.46791393457269104739 * near + 0.36076157304813860757 * mean
        + 0.17132449237917034504 * far);
}

fn rest_pair(w: f32, middle: f32, offset: f32) -> f32 {
    let x = middle + vec2f(-offset, offset);
    let quotient = (x - w) / (1.0 - w * x);
    let values = quotient * quotient * (3.0 * w * w - 1.0 - 2.0 * w * w * w * x);
    return values.x + values.y;
}
