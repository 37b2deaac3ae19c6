//! Rust counterpart of `specular.wgsl`: light from an environment, reflected by GGX microfacets.
//!
//! `n`, `v` and `r` are unit vectors with N.V > 0. `alpha` is 0 (a mirror) or in 1e-4..=1. `samples` is at least 1.
//! Radiances are in W/(m^2 sr).

use glam::{DVec2, DVec3};

use crate::{distribution, environment, fresnel, geometry, sampling};

/// Computes the general estimator, the mean of f L cos / pdf over the same microfacet normals as the shader. D is a
/// factor of both f and pdf. The shader cancels D, and this function computes D twice, in f and in pdf.
///
/// f = D F G / (4 N.L N.V): Walter et al. 2007, eq. 20; pdf = D N.H / (4 V.H): eq. 24 and 14. `radiance` is the light
/// from a unit direction.
#[must_use]
pub fn estimate(
    f0: DVec3,
    alpha: f64,
    n: DVec3,
    v: DVec3,
    samples: u32,
    radiance: impl Fn(DVec3) -> DVec3,
) -> DVec3 {
    mean(f0, alpha, n, v, samples, |l, _| radiance(l))
}

/// Computes `estimate` with light from mip levels, as in Krivanek and Colbert 2008. `radiance` is the light from a unit
/// direction, read from a mip level. `size` is the width of a face in texels.
#[must_use]
pub fn filtered_estimate(
    f0: DVec3,
    alpha: f64,
    n: DVec3,
    v: DVec3,
    samples: u32,
    size: u32,
    radiance: impl Fn(DVec3, f64) -> DVec3,
) -> DVec3 {
    let level = |pdf| pdf_level(pdf, samples, size);
    mean(f0, alpha, n, v, samples, |l, pdf| radiance(l, level(pdf)))
}

/// The mip level for a sample with the density `pdf`. For a mirror, the density is infinite and the level is 0.
fn pdf_level(pdf: f64, samples: u32, size: u32) -> f64 {
    if pdf == f64::INFINITY { 0.0 } else { environment::mip_level(pdf, samples, size) }
}

/// The mean of f L cos / pdf. `radiance` computes L from the direction and from pdf.
fn mean(
    f0: DVec3,
    alpha: f64,
    n: DVec3,
    v: DVec3,
    samples: u32,
    radiance: impl Fn(DVec3, f64) -> DVec3,
) -> DVec3 {
    let n_dot_v = n.dot(v);
    if alpha == 0.0 {
        return fresnel::schlick(f0, n_dot_v) * radiance(2.0 * n_dot_v * n - v, f64::INFINITY);
    }
    let frame = sampling::orthonormal_basis(n);
    let sample = |i| {
        let h = frame * sampling::ggx_normal(alpha, sampling::hammersley_centred(i, samples));
        let (n_dot_h, v_dot_h) = (n.dot(h), v.dot(h));
        let l = 2.0 * v_dot_h * h - v;
        let n_dot_l = n.dot(l);
        if n_dot_l <= 0.0 {
            return DVec3::ZERO;
        }
        let d = distribution::ggx_from_vectors(alpha, n, h);
        let g = geometry::v_cavity(n_dot_h, n_dot_v, n_dot_l, v_dot_h);
        let f = fresnel::schlick(f0, v_dot_h) * d * g / (4.0 * n_dot_l * n_dot_v);
        let pdf = d * n_dot_h / (4.0 * v_dot_h);
        f * radiance(l, pdf) * n_dot_l / pdf
    };
    (0..samples).map(sample).sum::<DVec3>() / f64::from(samples)
}

/// Computes sum L N.L / sum N.L with N = V = R, as in Karis 2013, "Pre-filtered environment map". `samples` is at
/// least 2.
#[must_use]
pub fn prefiltered(alpha: f64, r: DVec3, samples: u32, radiance: impl Fn(DVec3) -> DVec3) -> DVec3 {
    let frame = sampling::orthonormal_basis(r);
    let mut sum = DVec3::ZERO;
    let mut total = 0.0;
    for i in 0..samples {
        let h = frame * sampling::ggx_normal(alpha, sampling::hammersley_centred(i, samples));
        let l = 2.0 * r.dot(h) * h - r;
        let n_dot_l = r.dot(l);
        if n_dot_l > 0.0 {
            sum += n_dot_l * radiance(l);
            total += n_dot_l;
        }
    }
    sum / total
}

/// Computes the two integrals of Karis 2013, "Environment BRDF": the factor of f0, and the term without f0. Because
/// Schlick's F is linear in f0, the function gets both from the light that surfaces with f0 = 0 and f0 = 1 reflect in a
/// white environment.
#[must_use]
pub fn split_sum_table(alpha: f64, n_dot_v: f64, samples: u32) -> DVec2 {
    let v = DVec3::new((1.0 - n_dot_v * n_dot_v).sqrt(), 0.0, n_dot_v);
    let furnace = |f0| estimate(f0, alpha, DVec3::Z, v, samples, |_| DVec3::ONE).x;
    let offset = furnace(DVec3::ZERO);
    DVec2::new(furnace(DVec3::ONE) - offset, offset)
}

/// Computes the product of Karis' two sums: the prefiltered `light`, and the environment BRDF from the `table`.
#[must_use]
pub fn split_sum(f0: DVec3, table: DVec2, light: DVec3) -> DVec3 {
    light * (f0 * table.x + DVec3::splat(table.y))
}

/// Returns the mip level for a GGX width: sqrt(alpha) times the number of the last level.
#[must_use]
pub fn prefiltered_level(alpha: f64, levels: u32) -> f64 {
    (f64::from(levels) - 1.0) * alpha.powf(0.5)
}

/// Returns the GGX width for a mip level: (level / last level)^2.
#[must_use]
pub fn prefiltered_alpha(level: f64, levels: u32) -> f64 {
    (level / (f64::from(levels) - 1.0)).powi(2)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// A view at `degrees` from +Z.
    fn view(degrees: f64) -> DVec3 {
        let (sin, cos) = degrees.to_radians().sin_cos();
        DVec3::new(sin, 0.0, cos)
    }

    /// The share of a white furnace's light that a perfect reflector (f0 = 1) of width `alpha` returns.
    fn furnace(alpha: f64, degrees: f64, samples: u32) -> f64 {
        let white = |_| DVec3::ONE;
        estimate(DVec3::ONE, alpha, DVec3::Z, view(degrees), samples, white).x
    }

    #[test]
    fn a_furnace_never_gains() {
        for alpha in [0.0, 1e-4, 0.05, 0.3, 0.5, 1.0] {
            for degrees in [0.0, 30.0, 60.0, 80.0, 89.0, 89.9] {
                let white = furnace(alpha, degrees, 1 << 14);
                // The quadrature has an error of 1e-3. With 64 normals, the error would be 5e-3.
                assert!(white > 0.0 && white < 1.001, "{alpha}, {degrees}: {white}");
            }
        }
    }

    #[test]
    fn a_narrow_lobe_is_a_mirror() {
        let sky = |l: DVec3| DVec3::new(1.0 + l.x, 1.0 + l.y, 1.0 + l.z);
        for degrees in [0.0, 45.0, 80.0] {
            let at = |alpha| estimate(DVec3::splat(0.3), alpha, DVec3::Z, view(degrees), 64, sky);
            assert!(at(1e-4).abs_diff_eq(at(0.0), 1e-3), "{degrees}");
        }
    }

    #[test]
    fn a_mirror_shows_the_mirror_direction() {
        let seen = estimate(DVec3::ONE, 0.0, DVec3::Z, view(30.0), 1, |l| l);
        assert!(seen.abs_diff_eq(DVec3::new(-0.5, 0.0, 0.75_f64.sqrt()), 1e-15));
    }

    /// The integral of f cos over the directions of light, where f is the BRDF with F = 1, by the midpoint rule.
    fn albedo(alpha: f64, degrees: f64) -> f64 {
        let v = view(degrees);
        let n = 1000;
        let step = 1.0 / f64::from(n);
        let mut sum = 0.0;
        for i in 0..n {
            for j in 0..n {
                let (c, phi) = ((f64::from(i) + 0.5) * step, (f64::from(j) + 0.5) * step * PI);
                let s = (1.0 - c * c).sqrt();
                let l = DVec3::new(s * phi.cos(), s * phi.sin(), c);
                let h = (l + v).normalize();
                let d = distribution::ggx_from_vectors(alpha, DVec3::Z, h);
                let g = geometry::v_cavity(h.z, v.z, l.z, v.dot(h));
                sum += d * g / (4.0 * v.z) * step * step;
            }
        }
        2.0 * PI * sum
    }

    #[test]
    fn the_table_is_the_integral_of_the_brdf() {
        for (alpha, degrees) in [(0.3, 0.0), (0.3, 60.0), (0.8, 30.0), (0.8, 85.0)] {
            let table = split_sum_table(alpha, view(degrees).z, 1 << 14);
            let expected = albedo(alpha, degrees);
            assert!((table.x + table.y - expected).abs() < 1e-3, "{table} {expected}");
        }
    }

    #[test]
    fn the_split_sum_is_exact_for_constant_light() {
        let (f0, light) = (DVec3::new(0.04, 0.5, 0.9), DVec3::new(1.0, 2.0, 3.0));
        for alpha in [0.0, 1e-3, 0.3, 1.0] {
            for degrees in [0.0, 45.0, 89.9] {
                let v = view(degrees);
                let table = split_sum_table(alpha, v.z, 256);
                let held = prefiltered(alpha, DVec3::new(-v.x, 0.0, v.z), 256, |_| light);
                assert!(held.abs_diff_eq(light, 1e-14));
                let full = estimate(f0, alpha, DVec3::Z, v, 256, |_| light);
                let split = split_sum(f0, table, held);
                assert!(split.abs_diff_eq(full, 1e-12), "{alpha} {degrees}: {split} {full}");
            }
        }
    }

    #[test]
    fn the_split_sum_is_close_along_the_normal() {
        // With N = V = R, only the weight differs: it is N.L instead of G V.H / N.H.
        let sky = environment::linear(DVec3::new(0.3, -0.2, 0.6));
        for (alpha, bound) in [(0.1, 0.006), (0.3, 0.02), (0.5, 0.022)] {
            let full = estimate(DVec3::ONE, alpha, DVec3::Z, DVec3::Z, 1024, &sky).x;
            let table = split_sum_table(alpha, 1.0, 1024);
            let split = split_sum(DVec3::ONE, table, prefiltered(alpha, DVec3::Z, 1024, &sky)).x;
            assert!((split - full).abs() < bound, "{alpha}: {split} {full}");
        }
    }

    #[test]
    fn half_a_sky_gives_half() {
        // Lobes are symmetric about r, which is in the plane that halves the sky.
        let sky = environment::half_sky(DVec3::X);
        for alpha in [0.1, 0.5, 1.0] {
            let held = prefiltered(alpha, DVec3::new(0.0, 0.6, 0.8), 4096, &sky).x;
            assert!((held - 0.5).abs() < 1e-3, "{alpha}: {held}");
        }
    }

    #[test]
    fn constant_light_is_the_same_at_every_level() {
        let v = view(50.0);
        for alpha in [0.0, 0.05, 0.5] {
            let plain = estimate(DVec3::ONE, alpha, DVec3::Z, v, 32, |_| DVec3::ONE);
            let filtered =
                filtered_estimate(DVec3::ONE, alpha, DVec3::Z, v, 32, 64, |_, _| DVec3::ONE);
            assert_eq!(plain, filtered);
        }
    }

    #[test]
    fn wide_lobes_and_few_samples_take_high_levels() {
        let level = |alpha, samples| {
            let level = |_, level| DVec3::splat(level);
            let v = DVec3::Z;
            filtered_estimate(DVec3::ONE, alpha, v, v, samples, 256, level).x
        };
        eprintln!(
            "{:?}",
            [level(0.1, 16), level(0.2, 16), level(0.4, 16), level(0.2, 64), level(0.2, 256)]
        );
        assert_eq!(level(0.0, 16), 0.0);
        assert!(level(0.05, 16) < level(0.1, 16) && level(0.1, 16) < level(0.2, 16));
        assert!(level(0.2, 256) < level(0.2, 64) && level(0.2, 64) < level(0.2, 16));
        // With a quarter of the samples, the level is higher by one.
        assert!((level(0.2, 64) - level(0.2, 256) - 1.0).abs() < 0.1);
    }

    #[test]
    fn levels_and_widths_are_inverse() {
        for alpha in [0.0, 1e-4, 0.25, 1.0] {
            assert!((prefiltered_alpha(prefiltered_level(alpha, 7), 7) - alpha).abs() < 1e-15);
        }
        assert_eq!(prefiltered_level(0.25, 7), 3.0);
        assert_eq!(prefiltered_level(1.0, 7), 6.0);
    }

    #[test]
    fn the_split_sum_in_the_studio() {
        // The mean difference between split sum and estimator, divided by the mean. It is small if the view is along
        // the normal, and large where the true lobe stretches.
        let difference = |alpha: f64, n_dot_v: f64| {
            let mut sum = DVec2::ZERO;
            for i in 0..100 {
                let u = sampling::hammersley_centred(i, 100);
                let n = sampling::orthonormal_basis(DVec3::NEG_Z)
                    * sampling::uniform_hemisphere(u)
                    * if i % 2 == 0 { 1.0 } else { -1.0 };
                let sine = (1.0 - n_dot_v * n_dot_v).sqrt();
                let v = n_dot_v * n + sine * sampling::orthonormal_basis(n).x_axis;
                let sky = environment::studio;
                let full = estimate(DVec3::ONE, alpha, n, v, 256, sky).y;
                let held = prefiltered(alpha, 2.0 * n_dot_v * n - v, 256, sky);
                let table = split_sum_table(alpha, n_dot_v, 256);
                let split = split_sum(DVec3::ONE, table, held).y;
                sum += DVec2::new((split - full).abs(), full);
            }
            sum.x / sum.y
        };
        for (alpha, n_dot_v, expected) in
            [(0.1, 1.0, 0.04), (0.3, 1.0, 0.08), (0.3, 0.7, 0.16), (0.3, 0.3, 0.41)]
        {
            let found = difference(alpha, n_dot_v);
            assert!((found / expected - 1.0).abs() < 0.25, "{alpha} {n_dot_v}: {found}");
        }
    }
}
