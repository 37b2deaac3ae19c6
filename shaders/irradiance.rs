//! Rust counterpart of `irradiance.wgsl`: light from an environment, reflected by a Lambertian.
//!
//! The functions return irradiance as E / pi in W/(m^2 sr): the radiance of a white Lambertian with the unit normal
//! `n`. `radiance` is the light from a unit direction. The second argument of `radiance` in `filtered_estimate` is a
//! mip level. `linear` and `cosine_lobe` are closed forms for special environments.

use std::f64::consts::{FRAC_1_PI, FRAC_PI_2, PI, TAU};

use glam::DVec3;

use crate::environment::face_direction;
use crate::sampling;

/// Computes the general estimator, the mean of f L cos / pdf with f = 1 / pi, over directions that are uniformly
/// distributed on the hemisphere. `samples` is at least 1.
#[must_use]
pub fn estimate(n: DVec3, samples: u32, radiance: impl Fn(DVec3) -> DVec3) -> DVec3 {
    let frame = sampling::orthonormal_basis(n);
    let sample = |i| {
        let l = frame * sampling::uniform_hemisphere(sampling::hammersley_centred(i, samples));
        let n_dot_l = n.dot(l);
        FRAC_1_PI * radiance(l) * n_dot_l / sampling::uniform_hemisphere_pdf(n_dot_l)
    };
    (0..samples).map(sample).sum::<DVec3>() / f64::from(samples)
}

/// Computes the estimator of Krivanek and Colbert 2008: the mean of f L cos / pdf over directions with density cos /
/// pi. The estimator reads L from the mip level 1/2 log2(Omega_s / Omega_p), but at least 0. Omega_s = 1 / (samples
/// pdf), and Omega_p = 4 pi / (6 size^2).
#[must_use]
pub fn filtered_estimate(
    n: DVec3,
    samples: u32,
    size: u32,
    radiance: impl Fn(DVec3, f64) -> DVec3,
) -> DVec3 {
    let frame = sampling::orthonormal_basis(n);
    let texel = 4.0 * PI / (6.0 * f64::from(size).powi(2));
    let sample = |i| {
        let l = frame * sampling::cosine_hemisphere(sampling::hammersley_centred(i, samples));
        let n_dot_l = n.dot(l);
        let pdf = sampling::cosine_hemisphere_pdf(n_dot_l);
        let level = 0.5 * (1.0 / (f64::from(samples) * pdf) / texel).log2();
        FRAC_1_PI * radiance(l, level.max(0.0)) * n_dot_l / pdf
    };
    (0..samples).map(sample).sum::<DVec3>() / f64::from(samples)
}

/// Computes the double sum of the article that `shaders/README.md` cites, with each term multiplied by the step sizes:
/// (1 / pi) L cos sin dtheta dphi. The sum has 252 azimuths from 0 in steps of 0.025, and 16 polar angles from 0 in
/// steps of 0.1.
#[must_use]
pub fn loop_corrected(n: DVec3, radiance: impl Fn(DVec3) -> DVec3) -> DVec3 {
    let (d_phi, d_theta) = (0.025, 0.1);
    let at = |i: u32, k: u32| (f64::from(i) * d_phi, f64::from(k) * d_theta);
    let pairs = (0..252).flat_map(|i| (0..16).map(move |k| (i, k)));
    let terms = pairs.map(|(i, k)| {
        let (phi, theta) = at(i, k);
        let l = around(n, theta, phi);
        FRAC_1_PI * radiance(l) * theta.cos() * theta.sin() * d_theta * d_phi
    });
    terms.sum()
}

/// Computes the weighted mean of L with the weights cos(theta) sin(theta), at the centres of `phi_steps` by
/// `theta_steps` equal steps of azimuth and polar angle.
#[must_use]
pub fn midpoint(
    n: DVec3,
    phi_steps: u32,
    theta_steps: u32,
    radiance: impl Fn(DVec3) -> DVec3,
) -> DVec3 {
    let centre = |i: u32, steps: u32| (f64::from(i) + 0.5) / f64::from(steps);
    let pairs = (0..theta_steps).flat_map(|k| (0..phi_steps).map(move |i| (i, k)));
    weighted_mean(pairs.map(|(i, k)| {
        let theta = FRAC_PI_2 * centre(k, theta_steps);
        let l = around(n, theta, TAU * centre(i, phi_steps));
        (radiance(l), (2.0 * theta).sin())
    }))
}

/// Computes the weighted mean of L over the texels of a cube map with faces `size` texels wide. The weight of a texel
/// is its solid angle times the cosine between its direction and the normal, or 0 if the cosine is negative.
#[must_use]
pub fn texel_sum(n: DVec3, size: u32, radiance: &dyn Fn(DVec3) -> DVec3) -> DVec3 {
    weighted_mean(texels(size).map(|(l, solid_angle)| {
        let cosine = n.dot(l).max(0.0);
        (radiance(l), cosine * solid_angle)
    }))
}

/// The unit direction through the centre of each texel of a cube map, with the texel's solid angle.
fn texels(size: u32) -> impl Iterator<Item = (DVec3, f64)> {
    let area = (2.0 / f64::from(size)).powi(2);
    (0..6 * size * size).map(move |i| {
        let point = texel_direction(size, i);
        (point.normalize(), area * texel_density(point))
    })
}

/// Returns the point of the cube of side 2 at the centre of texel `i`. Texels are counted face by face, and row by row
/// from the top.
#[must_use]
pub fn texel_direction(size: u32, i: u32) -> DVec3 {
    let centre = |texel: u32| (f64::from(texel) + 0.5) / f64::from(size);
    let (row, column) = (i / size, i % size);
    let (face, row) = (row / size, row % size);
    face_direction(face as usize, centre(column), centre(row))
}

/// Computes the ratio of solid angle to surface area at the point `d` of the cube of side 2: cos / r^2, where cos is
/// the cosine of the angle between `d` and the face's axis.
#[must_use]
pub fn texel_density(d: DVec3) -> f64 {
    let cosine = d.normalize().abs().max_element();
    cosine / d.length_squared()
}

/// Coefficients of a function on the sphere, by band l and then by m from -l to l.
pub type Coefficients<T> = [T; 9];

const HARMONICS: [(u32, i32); 9] =
    [(0, 0), (1, -1), (1, 0), (1, 1), (2, -2), (2, -1), (2, 0), (2, 1), (2, 2)];

/// Computes the real spherical harmonics by their definition (Sloan 2008): K P_l^|m|(cos theta), times sqrt 2 cos(m
/// phi) for m > 0, and times sqrt 2 sin(-m phi) for m < 0. Without the phase (-1)^m, all signs are positive, as in
/// Ramamoorthi and Hanrahan 2001.
#[must_use]
pub fn sh_basis(d: DVec3) -> Coefficients<f64> {
    let phi = d.y.atan2(d.x);
    let sin_theta = d.x.hypot(d.y);
    HARMONICS.map(|(l, m)| {
        let order = m.unsigned_abs();
        let factorial = |k: u32| (1..=k).map(f64::from).product::<f64>();
        let ratio = factorial(l - order) / factorial(l + order);
        let norm = (f64::from(2 * l + 1) / (4.0 * PI) * ratio).sqrt();
        let legendre = match (l, order) {
            (0, 0) => 1.0,
            (1, 0) => d.z,
            (1, _) => sin_theta,
            (_, 0) => 1.5 * d.z * d.z - 0.5,
            (_, 1) => 3.0 * sin_theta * d.z,
            _ => 3.0 * sin_theta * sin_theta,
        };
        let angle = f64::from(order) * phi;
        let azimuthal = match m {
            0 => 1.0,
            1.. => 2.0_f64.sqrt() * angle.cos(),
            _ => 2.0_f64.sqrt() * angle.sin(),
        };
        norm * legendre * azimuthal
    })
}

/// Computes Ramamoorthi and Hanrahan 2001, eq. 10: the sum of L Y over the texels of a cube map with faces `size`
/// texels wide. The function scales the texels' solid angles so that their sum is 4 pi.
#[must_use]
pub fn sh_project(size: u32, radiance: &dyn Fn(DVec3) -> DVec3) -> Coefficients<DVec3> {
    let sphere: f64 = texels(size).map(|(_, solid_angle)| solid_angle).sum();
    let mut coefficients = Coefficients::default();
    for (l, solid_angle) in texels(size) {
        let light = radiance(l) * solid_angle * 4.0 * PI / sphere;
        for (coefficient, basis) in coefficients.iter_mut().zip(sh_basis(l)) {
            *coefficient += light * basis;
        }
    }
    coefficients
}

/// Computes E / pi by Ramamoorthi and Hanrahan 2001, eq. 7: E is the sum of A_l L_lm Y_lm, with A_l from eq. 8.
#[must_use]
pub fn sh_irradiance(coefficients: Coefficients<DVec3>, n: DVec3) -> DVec3 {
    let terms = HARMONICS.iter().zip(coefficients).zip(sh_basis(n));
    terms.map(|(((l, _), light), basis)| FRAC_1_PI * cosine_coefficient(*l) * light * basis).sum()
}

/// Computes A_l, the factor by which a clamped cosine scales band `l` of the light, by Ramamoorthi and Hanrahan 2001,
/// eq. 8. For bands 0 to 2, A_l is pi, 2 pi / 3 and pi / 4. For higher odd l, A_l is 0. For even l, A_l is 2 pi
/// (-1)^(l/2 - 1) / ((l + 2) (l - 1)) l! / (2^l (l/2)!^2).
#[must_use]
pub fn cosine_coefficient(l: u32) -> f64 {
    match l {
        0 => PI,
        1 => 2.0 * PI / 3.0,
        odd if odd % 2 == 1 => 0.0,
        even => {
            // l! / (2^l (l/2)!^2) = (1 3 5 ... (l - 1)) / (2 4 6 ... l)
            let quotient: f64 =
                (1..=even / 2).map(|k| f64::from(2 * k - 1) / f64::from(2 * k)).product();
            let sign = if even % 4 == 2 { 1.0 } else { -1.0 };
            sign * TAU / (f64::from(even + 2) * f64::from(even - 1)) * quotient
        }
    }
}

/// Computes a Lambertian's radiance, f E, with f = colour / pi. The irradiance E is pi times `irradiance_over_pi`.
#[must_use]
pub fn lambert(colour: DVec3, irradiance_over_pi: DVec3) -> DVec3 {
    colour * FRAC_1_PI * (irradiance_over_pi * PI)
}

/// Computes E / pi for the radiance `mean` + `gradient` . d from each direction d: `mean` + 2/3 `gradient` . n.
#[must_use]
pub fn linear(n: DVec3, mean: f64, gradient: DVec3) -> f64 {
    mean + 2.0 / 3.0 * gradient.dot(n)
}

/// Computes E / pi for the radiance max(0, axis . d) from each direction d. With the angle gamma between normal and
/// axis, the result is 2 (sin gamma + (pi - gamma) cos gamma) / (3 pi). In Cho and Saul 2009 this integral of two
/// clamped cosines is the arc-cosine kernel of order 1, eq. 6.
#[must_use]
pub fn cosine_lobe(n: DVec3, axis: DVec3) -> f64 {
    let gamma = n.cross(axis).length().atan2(n.dot(axis));
    2.0 / (3.0 * PI) * (gamma.sin() + (PI - gamma) * gamma.cos())
}

/// The direction at the polar angle `theta` from `n`, and at the azimuth `phi` minus pi, as in `sampling`.
fn around(n: DVec3, theta: f64, phi: f64) -> DVec3 {
    let (sin_phi, cos_phi) = (phi - PI).sin_cos();
    let local = DVec3::new(theta.sin() * cos_phi, theta.sin() * sin_phi, theta.cos());
    sampling::orthonormal_basis(n) * local
}

fn weighted_mean(terms: impl Iterator<Item = (DVec3, f64)>) -> DVec3 {
    let (sum, weights) = terms.fold((DVec3::ZERO, 0.0), |(sum, weights), (value, weight)| {
        (sum + value * weight, weights + weight)
    });
    sum / weights
}

#[cfg(test)]
mod tests {
    use super::*;

    const NORMALS: [DVec3; 4] =
        [DVec3::new(0.6, -0.48, 0.64), DVec3::Y, DVec3::NEG_Z, DVec3::new(-0.8, 0.0, -0.6)];
    const GRADIENT: DVec3 = DVec3::new(0.2, -0.5, 0.3);

    fn sky(d: DVec3) -> DVec3 {
        DVec3::splat(1.0 + GRADIENT.dot(d))
    }

    /// The largest error of `method` in a linear environment.
    fn error(method: impl Fn(DVec3) -> DVec3) -> f64 {
        let off = NORMALS.map(|n| (method(n).x - linear(n, 1.0, GRADIENT)).abs());
        off.into_iter().fold(0.0, f64::max)
    }

    #[test]
    fn a_furnace_returns_its_light() {
        for n in NORMALS {
            let one = |light: DVec3| assert!(light.abs_diff_eq(DVec3::ONE, 1e-12), "{light}");
            one(estimate(n, 64, |_| DVec3::ONE));
            one(filtered_estimate(n, 37, 16, |_, _| DVec3::ONE));
            one(midpoint(n, 5, 3, |_| DVec3::ONE));
            one(texel_sum(n, 3, &|_| DVec3::ONE));
            one(sh_irradiance(sh_project(3, &|_| DVec3::ONE), n));
        }
    }

    #[test]
    fn the_loop_turns_a_little_too_far() {
        // The sum of cos sin over 16 steps is sin 1.5 sin 1.6 / (2 sin 0.1). It is multiplied by 6.3 0.1 / pi.
        let expected = 1.5_f64.sin() * 1.6_f64.sin() / (2.0 * 0.1_f64.sin()) * 0.63 / PI;
        let light = loop_corrected(DVec3::Y, |_| DVec3::ONE).x;
        assert!((light - expected).abs() < 1e-12 && (light - 1.0014).abs() < 5e-5, "{light}");
    }

    #[test]
    fn a_linear_environment_keeps_two_thirds_of_its_gradient() {
        assert!(error(|n| estimate(n, 4096, sky)) < 1e-3);
        assert!(error(|n| filtered_estimate(n, 4096, 16, |d, _| sky(d))) < 1e-3);
        assert!(error(|n| midpoint(n, 64, 64, sky)) < 2e-4);
        assert!(error(|n| loop_corrected(n, sky)) < 4e-3);
        assert!(error(|n| texel_sum(n, 32, &sky)) < 2e-3);
        assert!(error(|n| sh_irradiance(sh_project(32, &sky), n)) < 1e-3);
    }

    #[test]
    fn midpoint_and_texels_converge_with_the_square_of_their_steps() {
        let rings = [8, 16].map(|steps| error(|n| midpoint(n, 64, steps, sky)));
        assert!((3.5..4.5).contains(&(rings[0] / rings[1])), "{rings:?}");
        let sides = [8, 32].map(|size| error(|n| texel_sum(n, size, &sky)));
        assert!(sides[0] / sides[1] > 8.0, "{sides:?}");
    }

    #[test]
    fn a_cosine_lobe_has_a_closed_form() {
        let axis = DVec3::new(0.28, 0.96, 0.0);
        let lobe = |d: DVec3| DVec3::splat(axis.dot(d).max(0.0));
        for n in NORMALS {
            let difference = midpoint(n, 256, 256, lobe).x - cosine_lobe(n, axis);
            assert!(difference.abs() < 5e-5, "{n}: {difference}");
        }
        assert!((cosine_lobe(axis, axis) - 2.0 / 3.0).abs() < 1e-15);
        assert!(cosine_lobe(-axis, axis).abs() < 1e-15);
    }

    #[test]
    fn harmonics_are_orthonormal() {
        let mut gram = [[0.0; 9]; 9];
        for (d, solid_angle) in texels(64) {
            let basis = sh_basis(d);
            for (row, left) in gram.iter_mut().zip(basis) {
                for (entry, right) in row.iter_mut().zip(basis) {
                    *entry += left * right * solid_angle;
                }
            }
        }
        for (i, row) in gram.iter().enumerate() {
            for (k, entry) in row.iter().enumerate() {
                let expected = if i == k { 1.0 } else { 0.0 };
                assert!((entry - expected).abs() < 1e-3, "{i}, {k}: {entry}");
            }
        }
    }

    #[test]
    fn texels_cover_the_sphere() {
        let sphere: f64 = texels(64).map(|(_, solid_angle)| solid_angle).sum();
        assert!((sphere / (4.0 * PI) - 1.0).abs() < 2e-4, "{sphere}");
    }

    #[test]
    fn bands_of_the_cosine() {
        // A_l = 2 pi int_0^1 x P_l(x) dx. P_4 = (35 x^4 - 30 x^2 + 3) / 8 gives -pi / 24.
        let expected = [PI, 2.0 * PI / 3.0, PI / 4.0, 0.0, -PI / 24.0];
        for (l, expected) in (0..).zip(expected) {
            assert!((cosine_coefficient(l) - expected).abs() < 1e-15, "{l}");
        }
        // All bands together are the cosine at its axis: the sum of (2 l + 1) A_l / (4 pi) is 1.
        let sum: f64 =
            (0..4000).map(|l| f64::from(2 * l + 1) * cosine_coefficient(l) / (4.0 * PI)).sum();
        assert!((sum - 1.0).abs() < 1e-3, "{sum}");
    }

    #[test]
    fn nine_coefficients_carry_a_lobe_to_half_a_percent() {
        // Each of the bands 4, 6, ... has a share of (2 l + 1) A_l^2 / (4 pi^2) in a lobe's E / pi.
        let rest: f64 = (3..400)
            .map(|l| f64::from(2 * l + 1) * cosine_coefficient(l).powi(2) / (4.0 * PI * PI))
            .sum();
        assert!((0.005..0.0055).contains(&rest), "{rest}");
        let axis = DVec3::new(0.28, 0.96, 0.0);
        let coefficients = sh_project(64, &|d| DVec3::splat(axis.dot(d).max(0.0)));
        for n in NORMALS.into_iter().chain([axis, -axis]) {
            let difference = sh_irradiance(coefficients, n).x - cosine_lobe(n, axis);
            assert!(difference.abs() < rest + 5e-4, "{n}: {difference}");
        }
    }

    #[test]
    fn a_white_lambertian_returns_what_is_stored() {
        let light = DVec3::new(0.1, 2.0, 30.0);
        assert!(lambert(DVec3::ONE, light).abs_diff_eq(light, 1e-14));
    }
}
