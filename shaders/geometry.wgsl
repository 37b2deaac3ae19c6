// Masking and shadowing of microfacets. All functions return the visible share, in 0..=1.
// n_dot_x, v_dot_h are cosines in 0..=1; alpha is the width of GGX or Beckmann, in (0, 1].

const INV_SQRT_PI: f32 = 0.56418958354775628695;

/// V-shaped grooves: min(1, 2 N.H N.V / V.H, 2 N.H N.L / V.H).
/// Cook and Torrance 1982, "Geometrical attenuation factor".
///
/// Both quotients grow without bound as `v_dot_h` approaches 0, so G is 1 there. The
/// comparison comes before the division, so that nothing is divided by V.H = 0 and G
/// is exactly 1 where nothing is masked. A NaN fails the comparison and gets through.
fn v_cavity(n_dot_h: f32, n_dot_v: f32, n_dot_l: f32, v_dot_h: f32) -> f32 {
    let visible = 2.0 * n_dot_h * min(n_dot_v, n_dot_l);
    if (visible >= v_dot_h) {
        return 1.0;
    }
    return visible / v_dot_h;
}

/// `v_cavity` / (4 N.V N.L): a microfacet BRDF without D and F. Both cosines are above 0,
/// the larger one is at least 1e-18, and V.H at least half of it, as for any half vector.
///
/// The quotient is simplified by hand, because 4 N.V N.L may underflow.
/// If a facet is masked, the smaller cosine cancels. If none is, it is
/// more than a third of the larger one, and the result is at most 1e36.
fn v_cavity_visibility(n_dot_h: f32, n_dot_v: f32, n_dot_l: f32, v_dot_h: f32) -> f32 {
    let smaller = min(n_dot_v, n_dot_l);
    let larger = max(n_dot_v, n_dot_l);
    if (2.0 * n_dot_h * smaller >= v_dot_h) {
        return 0.25 / larger / smaller;
    }
    return 0.5 * n_dot_h / (larger * v_dot_h);
}

/// Smith masking of GGX for one direction. Walter et al. 2007, eq. 34.
///
/// The tangent is multiplied out: cos^2 + alpha^2 sin^2 has no pole
/// at grazing and, in the form below, no difference that cancels.
fn smith_g1(alpha: f32, n_dot_x: f32) -> f32 {
    // The positive characteristic function of eq. 34. It also prevents 0 / 0 at alpha = 0.
    if (n_dot_x <= 0.0) {
        return 0.0;
    }
    return 2.0 * n_dot_x / (n_dot_x + projected_width(alpha, n_dot_x));
}

/// Masking times shadowing, as if the two were independent. Walter et al. 2007, eq. 23.
fn smith_separable(alpha: f32, n_dot_v: f32, n_dot_l: f32) -> f32 {
    return smith_g1(alpha, n_dot_v) * smith_g1(alpha, n_dot_l);
}

/// Masking and shadowing correlated by the height of the facet. Heitz 2014, eq. 99.
///
/// 1 + Lambda(v) + Lambda(l) with Lambda = (width / cos - 1) / 2: on paper
/// the ones cancel, so they don't appear here. The form divides, because
/// the product of two small cosines would underflow and give 0 / 0.
fn smith_correlated(alpha: f32, n_dot_v: f32, n_dot_l: f32) -> f32 {
    if (n_dot_v <= 0.0 || n_dot_l <= 0.0) {
        return 0.0; // the characteristic functions of eq. 99
    }
    let masking = projected_width(alpha, n_dot_v) / n_dot_v;
    let shadowing = projected_width(alpha, n_dot_l) / n_dot_l;
    return 2.0 / (masking + shadowing);
}

/// `smith_correlated` / (4 N.V N.L): a microfacet BRDF without D and F.
///
/// The quotient is simplified by hand: G vanishes with either cosine, so that
/// the result stays finite until both vanish. At and below the horizon it is 0.
fn smith_correlated_visibility(alpha: f32, n_dot_v: f32, n_dot_l: f32) -> f32 {
    if (n_dot_v <= 0.0 || n_dot_l <= 0.0) {
        return 0.0; // the characteristic functions of eq. 99
    }
    let masking = n_dot_l * projected_width(alpha, n_dot_v);
    let shadowing = n_dot_v * projected_width(alpha, n_dot_l);
    return 0.5 / (masking + shadowing);
}

/// The rational approximation of `smith_separable` for GGX, with k = alpha / 2. Karis 2013, "Specular G".
///
/// For light from all directions; for single lights Karis uses another k.
fn smith_schlick_ggx(alpha: f32, n_dot_v: f32, n_dot_l: f32) -> f32 {
    if (n_dot_v <= 0.0 || n_dot_l <= 0.0) {
        return 0.0; // 0 / k; this also keeps 0 / 0 away at alpha = 0
    }
    let k = 0.5 * alpha;
    let masking = n_dot_v / (n_dot_v * (1.0 - k) + k);
    let shadowing = n_dot_l / (n_dot_l * (1.0 - k) + k);
    return masking * shadowing;
}

/// Smith masking of Beckmann's distribution for one direction. Walter et al. 2007, eq. 26.
///
/// erf is eq. 7.1.26 of Abramowitz and Stegun 1964, 1 - poly(t) exp(-a^2), within
/// 1.5e-7. The exponential is needed anyway, and the result is then a thousand times
/// closer than eq. 27, the rational fit of the same paper. With 1 + erf = 2 - poly exp,
/// numerator and denominator of eq. 26 are multiplied by a, so that grazing has no pole:
///     G1 = 2 a / (2 a + exp(-a^2) (1 / sqrt(pi) - a poly(t)))
fn smith_g1_beckmann(alpha: f32, n_dot_x: f32) -> f32 {
    if (n_dot_x <= 0.0) {
        return 0.0;
    }
    // As a product, which has no difference of squares; a cosine may round to just above 1.
    let width = alpha * sqrt(abs(1.0 - n_dot_x) * (1.0 + n_dot_x));
    if (n_dot_x >= 4.0 * width) {
        return 1.0; // a >= 4: 1 - G1 is below exp(-16) / (4 a^3 sqrt(pi)) = 3e-10
    }
    let a = n_dot_x / width;
    let t = 1.0 / (1.0 + 0.3275911 * a);
    let poly = t * (0.254829592
        + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429))));
    return 2.0 * a / (2.0 * a + exp(-a * a) * (INV_SQRT_PI - a * poly));
}

/// sqrt(cos^2 + alpha^2 sin^2): the apparent width of the GGX ellipsoid from
/// the direction with cosine `n_dot_x`. Both terms are positive for alpha <= 1.
fn projected_width(alpha: f32, n_dot_x: f32) -> f32 {
    let alpha2 = alpha * alpha;
    return sqrt(alpha2 + (1.0 - alpha2) * n_dot_x * n_dot_x);
}
