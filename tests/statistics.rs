//! Tests the statistical checks: which faults they find, whether they state their power correctly, and how rarely they
//! reject a right sampler.
//!
//! The planted faults are small, because finding a large fault would prove little about a check. On the CPU, the tests
//! use a thousand seeds to measure how often each statistical test rejects a right sampler. One more test measures this
//! rate for whole checks on a driver, over fewer seeds.

use std::f64::consts::TAU;

use glam::{Vec2, Vec3};
use karat::check::Failure;
use karat::prelude::*;
use karat::unstable::check::{Finding, Fit, Rejection};
use karat::unstable::domain::Source;
use karat::unstable::stats::{
    Cells, ChiSquare, Kolmogorov, Mean, Moments, Place, Rate, accepts, binomial_tail,
    chi_square_power,
};
use shaders::PBR;

/// A package with right and wrong samplers and densities.
fn planted() -> Package {
    let text = "
        import pbr::sampling::{ggx_normal, ggx_normal_pdf, cosine_hemisphere, turned, ggx};
        import pbr::sampling::{ggx_visible_normal, ggx_visible_normal_pdf};

        // Right, except for a factor.
        fn scaled_pdf(alpha: f32, h: vec3f) -> f32 {
            return 1.05 * ggx_normal_pdf(alpha, h);
        }

        // With the right integral: 5 % more on one half, 5 % less on the other.
        fn tilted_pdf(alpha: f32, h: vec3f) -> f32 {
            return select(0.95, 1.05, h.x > 0.0) * ggx_normal_pdf(alpha, h);
        }

        // Roughness in place of alpha.
        fn squared_pdf(alpha: f32, h: vec3f) -> f32 {
            return ggx_normal_pdf(alpha * alpha, h);
        }

        // D without N.H.
        fn without_cosine_pdf(alpha: f32, h: vec3f) -> f32 {
            return select(0.0, ggx(alpha, h), h.z > 0.0);
        }

        fn reflected(alpha: f32, v: vec3f, u: vec2f) -> vec3f {
            return reflect(-v, ggx_visible_normal(alpha, v, u));
        }

        fn reflected_pdf(alpha: f32, v: vec3f, l: vec3f) -> f32 {
            if (l.z <= 0.0) {
                return 0.0;
            }
            let h = normalize(v + l);
            return ggx_visible_normal_pdf(alpha, v, h) / (4.0 * dot(v, h));
        }

        // The density of directions, in place of that of normals.
        fn without_jacobian_pdf(alpha: f32, v: vec3f, l: vec3f) -> f32 {
            return select(0.0, ggx_visible_normal_pdf(alpha, v, normalize(v + l)), l.z > 0.0);
        }

        fn cosine(u: vec2f) -> vec3f {
            return cosine_hemisphere(u);
        }

        // 8 by 8 strata. The last one is never sampled.
        fn stratum_missing(u: vec2f) -> vec3f {
            let last = u.x >= 0.875 && u.y >= 0.875;
            return cosine_hemisphere(select(u, u - 0.875, last));
        }

        // The azimuth depends slightly on the height.
        fn correlated(u: vec2f) -> vec3f {
            return cosine_hemisphere(vec2f(mix(u.x, u.y, step(0.97, fract(u.x * 97.0))), u.y));
        }

        // Infinite for one sample in 10,000.
        fn poisoned(u: vec2f) -> vec3f {
            let l = cosine_hemisphere(u);
            return select(l, l * exp(1000.0 + u.x), u.x < 1e-3 && u.y < 0.1);
        }

        @group(0) @binding(0) var table: texture_2d<f32>;

        // The texel is the lobe's peak, 1 / (pi alpha^2).
        fn tabled_pdf(alpha: f32, h: vec3f) -> f32 {
            let peak = textureLoad(table, vec2i(0, 0), 0).x;
            let squared = alpha * alpha;
            let falls = squared / (squared * h.z * h.z + dot(h.xy, h.xy));
            return peak * falls * falls * max(h.z, 0.0);
        }

        // Above 1 by less than rounding may add, and by more.
        fn full_cosine_pdf(l: vec3f) -> f32 {
            return 1.00019 * cosine_pdf(l);
        }

        fn fuller_cosine_pdf(l: vec3f) -> f32 {
            return 1.0003 * cosine_pdf(l);
        }

        fn dense_cosine_pdf(l: vec3f) -> f32 {
            return 1.0005 * cosine_pdf(l);
        }

        // One in 10,000 is below the horizon.
        fn falling(u: vec2f) -> vec3f {
            let l = cosine_hemisphere(u);
            return select(l, -l, u.x < 1e-4);
        }

        fn stretched(u: vec2f) -> vec3f {
            return 1.01 * cosine_hemisphere(u);
        }

        // Half of the hemisphere, and its density.
        fn inner(u: vec2f) -> vec3f {
            let z = 0.5 + 0.5 * u.y;
            let phi = 6.2831853 * u.x;
            return vec3f(sqrt(1.0 - z * z) * vec2f(cos(phi), sin(phi)), z);
        }

        fn inner_pdf(l: vec3f) -> f32 {
            return select(0.0, 1.0 / 3.14159265, l.z > 0.4999999);
        }

        // Without the azimuth.
        fn flat_cosine(u: vec2f) -> vec3f {
            let l = cosine_hemisphere(u);
            return vec3f(length(l.xy), 0.0, l.z);
        }

        fn flat_normal(alpha: f32, u: vec2f) -> vec3f {
            let h = ggx_normal(alpha, u);
            return vec3f(length(h.xy), 0.0, h.z);
        }

        fn flat_disk(u: vec2f) -> vec2f {
            return vec2f(sqrt(u.x), 0.0);
        }

        // 64 values, the middles of steps.
        fn stepped(u: f32) -> f32 {
            return (floor(64.0 * u) + 0.5) / 64.0;
        }

        fn flat_pdf(x: f32) -> f32 {
            return 1.0;
        }

        fn die(u: f32) -> u32 {
            return u32(6.0 * u);
        }

        fn rare(u: u32) -> f32 {
            return select(0.0, 1.0, u < 4295u); // one in a million
        }

        fn cap_pdf(l: vec3f) -> f32 {
            return select(0.0, l.z / 3.14159265 / 0.99, l.z > 0.1);
        }

        fn cosine_pdf(l: vec3f) -> f32 {
            return max(l.z, 0.0) / 3.14159265;
        }

        fn scaled_cosine_pdf(l: vec3f) -> f32 {
            return 1.02 * cosine_pdf(l);
        }

        fn negative_pdf(l: vec3f) -> f32 {
            return l.z / 3.14159265 - 0.001;
        }

        fn infinite_pdf(l: vec3f) -> f32 {
            return select(l.z / 3.14159265, exp(1000.0 + l.z), l.z < 0.001);
        }

        fn constant(u: vec2f) -> vec3f {
            return vec3f(0.0, 0.0, 1.0);
        }

        fn square_root(u: f32) -> f32 {
            return sqrt(u);
        }

        fn triangle_pdf(x: f32) -> f32 {
            return 2.0 * x;
        }

        fn bent_pdf(x: f32) -> f32 {
            return 1.9 * x + 0.05;
        }

        fn in_disk(u: vec2f) -> vec2f {
            return turned(u.x, sqrt(u.y), 0.0).xy;
        }

        fn disk_pdf(x: vec2f) -> f32 {
            return 1.0 / 3.14159265;
        }

        fn half(l: vec3f) -> vec3f {
            return vec3f(0.5);
        }

        fn almost_half(l: vec3f) -> vec3f {
            return vec3f(0.5, 0.5, 0.501);
        }

        fn grey(l: vec3f) -> vec3f {
            return vec3f(0.5 / 3.14159265);
        }
    ";
    Package::from_source("planted", text).depends_on("pbr", &PBR)
}

#[track_caller]
fn rejected(result: Result<Fit, Failure>) -> Rejection {
    match result {
        Err(Failure::Rejection(rejection)) => *rejection,
        other => panic!("the fault was not found: {other:?}"),
    }
}

/// The findings of a rejected check. Their kinds must be the same on all paths.
#[track_caller]
fn findings(result: Result<Fit, Failure>) -> Vec<Finding> {
    let kinds = |of: &[Finding]| of.iter().map(std::mem::discriminant).collect::<Vec<_>>();
    let rejection = rejected(result);
    assert!(rejection.agreeing.is_empty());
    let mut paths = rejection.paths.into_iter().map(|path| path.worst.findings);
    let first = paths.next().expect("a path rejects");
    assert!(paths.all(|findings| kinds(&findings) == kinds(&first)));
    first
}

/// The p-value of the chi-square test, which must be the first finding.
#[track_caller]
fn chi_square_alone(result: Result<Fit, Failure>) -> f64 {
    match findings(result)[..] {
        [Finding::ChiSquare { p, .. }, ..] => p,
        ref other => panic!("not chi-square's: {other:?}"),
    }
}

fn ggx_against(pdf: &str) -> Result<Fit, Failure> {
    PBR.function("sampling::ggx_normal")
        .sampled_over(Just(0.5), |&alpha, u: Vec2| (alpha, u))
        .unrecorded()
        .try_follows(planted().function(pdf), |&alpha, h: Vec3| (alpha, h))
}

fn ggx_power(pdf: &str, samples: u64) -> f64 {
    let planted = planted();
    PBR.function("sampling::ggx_normal")
        .sampled_over(Just(0.5), |&alpha, u: Vec2| (alpha, u))
        .samples(samples)
        .power_against(
            planted.function(pdf),
            |&alpha, h: Vec3| (alpha, h),
            PBR.function("sampling::ggx_normal_pdf"),
        )
        .expect("two densities")
        .least
}

/// Checks a sampler of [`planted`] against a density of [`planted`], such as `cosine_pdf`.
fn cosine_against(sampler: &str, pdf: &str) -> Result<Fit, Failure> {
    let planted = planted();
    planted
        .function(sampler)
        .sampled_over(Just(()), |(), u: Vec2| u)
        .unrecorded()
        .try_follows(planted.function(pdf), |(), l: Vec3| l)
}

// Lesson 7
#[test]
fn a_pdf_of_the_wrong_scale_is_rejected() {
    let found = findings(ggx_against("scaled_pdf"));
    let [Finding::Mass { integral, bound }] = found[..] else { panic!("{found:?}") };
    assert!((integral - 1.05).abs() < 1e-3 && bound < 1e-3, "{integral} {bound}");
    assert_eq!(ggx_power("scaled_pdf", 1 << 18), 1.0);
}

/// The check computes the expected share of samples outside of the support as 1 minus the integral of the density. If
/// the integral exceeds 1 because of a fault, the only finding is the wrong integral. If it exceeds 1 only by rounding,
/// the expected share is 0, so samples outside of the support are a finding.
// Lesson 68
#[test]
fn a_density_above_one_leaves_nothing_out() {
    let planted = planted();
    let follows = |sampler: &str, pdf: &str| {
        let sampled = planted.function(sampler).sampled_over(Just(()), |(), u: Vec2| u);
        sampled.may_leave_support().unrecorded().try_follows(planted.function(pdf), |(), l: Vec3| l)
    };
    follows("cosine", "full_cosine_pdf").expect("more than 1 by rounding alone");
    let found = findings(follows("falling", "fuller_cosine_pdf"));
    assert!(matches!(found[..], [Finding::Mass { .. }]), "{found:?}");
    let found = findings(follows("falling", "full_cosine_pdf"));
    let [Finding::Left { left, expected, .. }] = found[..] else { panic!("{found:?}") };
    assert!(left > 10 && expected == 0.0, "{found:?}");
}

/// The density reads the peak of a lobe with alpha 0.01, 3183.1, from a texel. On paths with half-float textures, the
/// texel is 3184. The check accepts the density on each path, because it knows the texture's rounding, but rejects a
/// larger error of the peak.
// Lesson 68
#[test]
fn a_sharp_lobe_from_a_texture_is_judged_by_the_texture() {
    let alpha = 0.01_f32;
    let peak = 1.0 / (std::f64::consts::PI * f64::from(alpha) * f64::from(alpha));
    let planted = planted();
    let follows = |scale: f64, leaves: bool| {
        let texel = glam::Vec4::splat((peak * scale) as f32);
        let sampled = PBR
            .function("sampling::ggx_normal")
            .sampled_over(Just(alpha), |&alpha, u: Vec2| (alpha, u));
        let sampled = if leaves { sampled.may_leave_support() } else { sampled };
        let pdf = planted.function("tabled_pdf").with("table", Texture::constant(texel));
        sampled.unrecorded().try_follows(pdf, |&alpha, h: Vec3| (alpha, h))
    };
    for leaves in [false, true] {
        follows(1.0, leaves).expect("the right density");
        let found = findings(follows(1.001, leaves));
        assert!(matches!(found[..], [Finding::Mass { .. }]), "{found:?}");
    }
    let found = findings(follows(0.999, false));
    assert!(matches!(found[..], [Finding::Mass { .. }]), "{found:?}");
}

/// A check runs several statistical tests, and divides its significance among them. So all tests together reject a
/// right sampler with the stated probability.
// Lesson 72
#[test]
fn a_check_shares_its_significance_among_its_tests() {
    let planted = planted();
    let widths = || OneOf(vec![0.3_f32, 0.5, 0.7, 0.9]);
    let sampled = || {
        let normal = PBR.function("sampling::ggx_normal");
        normal.sampled_over(widths(), |&alpha, u: Vec2| (alpha, u)).samples(4096)
    };
    let pdf = || PBR.function("sampling::ggx_normal_pdf");
    let plain = sampled().follows(pdf(), |&alpha, h: Vec3| (alpha, h));
    let leaving = sampled().may_leave_support().follows(pdf(), |&alpha, h: Vec3| (alpha, h));
    let cosine = planted.function("cosine").sampled_over(Just(()), |(), u: Vec2| u);
    let with = |name: &str| (planted.function(name), |(): &(), l: Vec3| l);
    let estimate = cosine.estimates(with("grey"), with("cosine_pdf"));
    for (fit, tests) in [(plain, 4), (leaving, 8), (estimate, 4)] {
        let any = 1.0 - (1.0 - fit.threshold).powi(tests);
        assert!((any - 0.01).abs() < 1e-12, "{tests} tests: {}", fit.threshold);
    }
}

/// For n = 2^18 samples, the noncentrality of chi-square is n 0.05^2 = 655, which is twenty of its standard deviations.
/// So the check certainly rejects the density.
// Lesson 7
#[test]
fn a_pdf_that_is_five_percent_wrong_is_rejected() {
    assert!(chi_square_alone(ggx_against("tilted_pdf")) < 1e-12);
    assert!(ggx_power("tilted_pdf", 1 << 18) > 0.999_999);
    // Only the shape is wrong, and few samples rarely detect that. The integral over the edge is already exact enough.
    assert!(ggx_power("tilted_pdf", 1024) < 0.1);
}

/// The share of runs that detect a fault agrees with the power that Karat states. The test uses a fault with a power
/// near one half.
// Lesson 7
#[test]
fn power_is_what_it_is_said_to_be() {
    let (planted, samples) = (planted(), 45_000);
    let sampled = || {
        PBR.function("sampling::ggx_normal")
            .sampled_over(Just(0.5), |&alpha, u: Vec2| (alpha, u))
            .samples(samples)
    };
    let rate = Rate::over(0..40, |seed| {
        let result = sampled()
            .seed(seed)
            .unrecorded()
            .try_follows(planted.function("tilted_pdf"), |&alpha, h: Vec3| (alpha, h));
        result.is_err()
    });
    let said = ggx_power("tilted_pdf", samples);
    assert!((0.2..0.9).contains(&said), "{said}");
    let chance = binomial_tail(rate.rejected, rate.runs, said);
    assert!(accepts(chance, 1e-3), "{said}, but {rate:?}");
}

// Lesson 7
#[test]
fn a_squared_alpha_is_rejected() {
    assert!(chi_square_alone(ggx_against("squared_pdf")) < 1e-12);
    assert!(ggx_power("squared_pdf", 4096) > 0.999_999);
}

/// Without the cosine, the density has two faults: its integral is about 2 / (1 + alpha) instead of 1, and its shape is
/// wrong.
#[test]
fn a_missing_cosine_is_rejected() {
    let found = findings(ggx_against("without_cosine_pdf"));
    assert!(matches!(found[..], [Finding::Mass { .. }, Finding::ChiSquare { .. }]), "{found:?}");
}

/// The faulty density lacks the factor 1 / (4 V.H), so its integral is the mean of 4 V.H, which is far above 1.
// Lesson 7
#[test]
fn a_missing_jacobian_is_rejected() {
    let (planted, v) = (planted(), Vec3::new(0.6, 0.0, 0.8));
    let reflected = || {
        planted
            .function("reflected")
            .sampled_over(Just(0.3), move |&alpha, u: Vec2| (alpha, v, u))
            .may_leave_support()
    };
    let at = |&alpha: &f32, l: Vec3| (alpha, v, l);
    reflected().follows(planted.function("reflected_pdf"), at);
    let found = findings(
        reflected().unrecorded().try_follows(planted.function("without_jacobian_pdf"), at),
    );
    let mass = found.iter().any(|f| matches!(f, Finding::Mass { integral, .. } if *integral > 2.0));
    let shape = found.iter().any(|f| matches!(f, Finding::ChiSquare { p, .. } if *p < 1e-12));
    assert!(mass && shape, "{found:?}");
    // The check doesn't declare that samples may leave the domain, so each sample outside is a failure.
    let strict = planted
        .function("reflected")
        .sampled_over(Just(0.3), move |&alpha, u: Vec2| (alpha, v, u))
        .unrecorded()
        .try_follows(planted.function("reflected_pdf"), at);
    let found = findings(strict);
    assert!(found.iter().any(|f| matches!(f, Finding::Outside { .. })), "{found:?}");
}

// Lesson 7
#[test]
fn a_missing_stratum_is_rejected() {
    assert!(chi_square_alone(cosine_against("stratum_missing", "cosine_pdf")) < 1e-12);
}

/// In the planted sampler, three samples in a hundred have an azimuth that depends on their height.
// Lesson 7
#[test]
fn correlated_random_numbers_are_rejected() {
    assert!(chi_square_alone(cosine_against("correlated", "cosine_pdf")) < 1e-12);
}

#[test]
fn what_cannot_be_is_rejected_outright() {
    let found = findings(cosine_against("poisoned", "cosine_pdf"));
    assert!(matches!(found[0], Finding::NotFinite { .. }), "{found:?}");
    let found = findings(cosine_against("falling", "cosine_pdf"));
    assert!(matches!(found[0], Finding::Outside { .. }), "{found:?}");
    let found = findings(cosine_against("stretched", "cosine_pdf"));
    assert!(matches!(found[0], Finding::NotUnit { .. }), "{found:?}");
    let found = findings(cosine_against("cosine", "cap_pdf"));
    assert!(matches!(found[0], Finding::Impossible { .. }), "{found:?}");
    let found = findings(cosine_against("cosine", "negative_pdf"));
    assert!(matches!(found[0], Finding::Negative { .. }), "{found:?}");
    let found = findings(cosine_against("cosine", "infinite_pdf"));
    assert!(matches!(found[0], Finding::NotFinite { .. }), "{found:?}");
}

/// Karat reports an error for a check that could prove nothing, such as a check with too few samples.
#[test]
fn what_proves_nothing_is_an_error() {
    let planted = planted();
    let sampled = |sampler: &str| {
        planted.function(sampler).sampled_over(Just(()), |(), u: Vec2| u).samples(10_000)
    };
    let pdf = || planted.function("cosine_pdf");
    let at = |(): &(), l: Vec3| l;
    for samples in [0, 1, 1023] {
        let few = sampled("cosine").samples(samples).unrecorded().try_follows(pdf(), at);
        assert!(matches!(few, Err(Failure::Evidence { .. })), "{few:?}");
    }
    // All samples lie in one cell, which expects fewer samples.
    assert!(chi_square_alone(sampled("constant").unrecorded().try_follows(pdf(), at)) < 1e-12);
    for significance in [0.0, 1.0, f64::NAN] {
        let none = sampled("cosine").significance(significance).unrecorded().try_follows(pdf(), at);
        assert!(matches!(none, Err(Failure::Domain { .. })), "{none:?}");
    }
    let none = sampled("cosine").mass_within(f64::INFINITY).unrecorded().try_follows(pdf(), at);
    assert!(matches!(none, Err(Failure::Domain { .. })), "{none:?}");
    let few = sampled("cosine").samples(50).unrecorded().try_has_mean(
        "z",
        |l: Vec3| l.z.into(),
        |()| 0.6,
        0.0,
    );
    assert!(matches!(few, Err(Failure::Evidence { .. })), "{few:?}");
    let empty = planted
        .function("cosine")
        .sampled_over(OneOf(Vec::<f32>::new()), |_, u: Vec2| u)
        .unrecorded()
        .try_follows(pdf(), |_, l: Vec3| l);
    assert!(matches!(empty, Err(Failure::Domain { .. })), "{empty:?}");
    // The points lie outside the support, or the random numbers aren't uniform.
    let disk = sampled("cosine").support(Support::Disk).unrecorded().try_follows(pdf(), at);
    assert!(matches!(disk, Err(Failure::Signature { .. })), "{disk:?}");
    let signs = planted
        .function("cosine")
        .sampled_over(Just(()), |(), _: bool| Vec2::ZERO)
        .unrecorded()
        .try_follows(pdf(), at);
    assert!(matches!(signs, Err(Failure::Signature { .. })), "{signs:?}");
}

#[test]
fn lines_and_disks_are_supports() {
    let planted = planted();
    let root = || {
        planted
            .function("square_root")
            .sampled_over(Just(()), |(), u: f32| u)
            .support(Support::Interval(0.0, 1.0))
    };
    root().follows(planted.function("triangle_pdf"), |(), x: f32| x);
    let bent = root().unrecorded().try_follows(planted.function("bent_pdf"), |(), x: f32| x);
    assert!(chi_square_alone(bent) < 1e-12);
    planted
        .function("in_disk")
        .sampled_over(Just(()), |(), u: Vec2| u)
        .support(Support::Disk)
        .follows(planted.function("disk_pdf"), |(), x: Vec2| x);
}

#[test]
fn means_and_distributions_that_are_wrong_are_rejected() {
    let planted = planted();
    let root = || planted.function("square_root").sampled_over(Just(()), |(), u: f32| u);
    root().has_mean("x", |x: f32| x.into(), |()| 2.0 / 3.0, 1e-7);
    let found = findings(root().unrecorded().try_has_mean("x", |x: f32| x.into(), |()| 0.67, 1e-7));
    assert!(matches!(found[..], [Finding::Mean { p, .. }] if p < 1e-4), "{found:?}");
    root().has_distribution("x", |x: f32| x.into(), |(), x| x * x, 1e-7);
    let found = findings(root().unrecorded().try_has_distribution(
        "x",
        |x: f32| x.into(),
        |(), x| x.powf(2.05),
        1e-7,
    ));
    assert!(matches!(found[..], [Finding::Distribution { p, .. }] if p < 1e-9), "{found:?}");
    let found = findings(root().unrecorded().try_has_mean("1/0", |_: f32| f64::NAN, |()| 0.0, 0.0));
    assert!(matches!(found[..], [Finding::NotFinite { .. }]), "{found:?}");
}

/// The sampler never samples one part of the integrand, and its density is 0 there. The samples fit the density, so
/// `follows` passes. `estimates` finds that the mean lacks this part of the integral.
// Lesson 15: planted faults
#[test]
fn an_estimate_that_misses_a_part_is_rejected() {
    let planted = planted();
    let with = |name: &str| (planted.function(name), |(): &(), l: Vec3| l);
    let inner = || planted.function("inner").sampled_over(Just(()), |(), u: Vec2| u);
    inner().follows(planted.function("inner_pdf"), |(): &(), l: Vec3| l);
    let found = findings(inner().unrecorded().try_estimates(with("grey"), with("inner_pdf")));
    let [Finding::Mean { mean, expected, .. }, ..] = &found[..] else { panic!("{found:?}") };
    // 3/4 of the integral of the cosine lies at heights from 1/2 to 1.
    assert!((mean / expected - 0.75).abs() < 1e-3, "{mean} {expected}");
}

/// The planted samplers have lost a dimension: their samples all have the same azimuth, or only 64 different values.
/// Karat chooses the cells of its histogram by the quantiles of earlier samples. Even if many samples are equal, the
/// check has enough cells to find the fault.
#[test]
fn a_sampler_that_has_lost_a_dimension_is_rejected() {
    let planted = planted();
    let cosine = || planted.function("flat_cosine").sampled_over(Just(()), |(), u: Vec2| u);
    let density = || planted.function("cosine_pdf");
    assert!(
        chi_square_alone(cosine().unrecorded().try_follows(density(), |(), l: Vec3| l)) < 1e-12
    );
    let normal = planted
        .function("flat_normal")
        .sampled_over(OneOf(vec![0.001, 0.1, 1.0]), |&alpha, u: Vec2| (alpha, u))
        .unrecorded()
        .try_follows(PBR.function("sampling::ggx_normal_pdf"), |&alpha, h: Vec3| (alpha, h));
    assert_eq!(rejected(normal).paths[0].rejected, 3);
    let disk = planted
        .function("flat_disk")
        .sampled_over(Just(()), |(), u: Vec2| u)
        .support(Support::Disk)
        .unrecorded()
        .try_follows(planted.function("disk_pdf"), |(), at: Vec2| at);
    assert!(chi_square_alone(disk) < 1e-12);
    let stepped = planted
        .function("stepped")
        .sampled_over(Just(()), |(), u: f32| u)
        .support(Support::Interval(0.0, 1.0))
        .unrecorded()
        .try_follows(planted.function("flat_pdf"), |(), x: f32| x);
    assert!(chi_square_alone(stepped) < 1e-12);
}

#[test]
fn a_die_has_the_distribution_of_a_die() {
    let planted = planted();
    let die = || planted.function("die").sampled_over(Just(()), |(), u: f32| u);
    let steps = |sides: f64| move |(): &(), x: f64| ((x.floor() + 1.0) / sides).clamp(0.0, 1.0);
    die().has_distribution("pips", |pips: u32| pips.into(), steps(6.0), 0.0);
    let found =
        die().unrecorded().try_has_distribution("pips", |pips: u32| pips.into(), steps(6.2), 0.0);
    assert!(matches!(findings(found)[..], [Finding::Distribution { .. }]));
    for slack in [f64::NAN, 2.0, -1.0] {
        let found =
            die().unrecorded().try_has_distribution("pips", |p: u32| p.into(), steps(7.0), slack);
        assert!(matches!(found, Err(Failure::Evidence { .. })), "{slack}: {found:?}");
    }
}

/// If an event is so rare that the samples contain it at most once, `has_mean` gives no verdict on the mean, but asks
/// for more samples.
#[test]
fn the_mean_of_a_rare_event_is_no_verdict() {
    let planted = planted();
    let rare = || planted.function("rare").sampled_over(Just(()), |(), u: u32| u);
    let found =
        rare().samples(65_536).unrecorded().try_has_mean("hits", |x: f32| x.into(), |()| 1e-6, 0.0);
    let text = found.expect_err("no hit or one").to_string();
    assert!(text.contains("take more samples"), "{text}");
}

#[test]
fn an_interval_of_no_length_is_refused() {
    let planted = planted();
    for (low, high) in [(1.0, 0.0), (0.5, 0.5), (0.0, f64::INFINITY), (f64::NAN, 1.0)] {
        let found = planted
            .function("stepped")
            .sampled_over(Just(()), |(), u: f32| u)
            .support(Support::Interval(low, high))
            .unrecorded()
            .try_follows(planted.function("flat_pdf"), |(), x: f32| x);
        assert!(matches!(found, Err(Failure::Domain { .. })), "{low} {high}: {found:?}");
    }
}

/// The estimator divides by a density with a wrong factor, so the mean is wrong by the same factor, and the check finds
/// it.
// Lesson 15: planted faults
#[test]
fn an_estimate_by_a_scaled_density_is_rejected() {
    let planted = planted();
    let sampled = || planted.function("cosine").sampled_over(Just(()), |(), u: Vec2| u);
    let pdf = || (planted.function("cosine_pdf"), |(): &(), l: Vec3| l);
    sampled().estimates((planted.function("grey"), |(): &(), l: Vec3| l), pdf());
    // This density has a wrong factor, which gives a mean with the same wrong factor.
    let scaled = || (planted.function("scaled_cosine_pdf"), |(): &(), l: Vec3| l);
    let found = findings(
        sampled()
            .unrecorded()
            .try_estimates((planted.function("grey"), |(): &(), l: Vec3| l), scaled()),
    );
    assert!(found.iter().any(|f| matches!(f, Finding::Mean { .. })), "{found:?}");
}

/// If all weights of an estimate are equal, their mean has no error except rounding. The check rejects a mean with five
/// times the rounding error, even if `mass_within` allows the density's integral a larger error.
// Lesson 72
#[test]
fn a_mean_is_granted_no_more_than_rounding() {
    let planted = planted();
    let with = |name: &str| (planted.function(name), |(): &(), l: Vec3| l);
    let cosine = || planted.function("cosine").sampled_over(Just(()), |(), u: Vec2| u);
    cosine().mass_within(1e-2).estimates(with("grey"), with("cosine_pdf"));
    let found = findings(
        cosine()
            .mass_within(1e-2)
            .unrecorded()
            .try_estimates(with("grey"), with("dense_cosine_pdf")),
    );
    assert!(matches!(found[..], [Finding::Mean { .. }, ..]), "{found:?}");
}

// Lesson 15: planted faults
#[test]
fn a_weight_that_is_not_the_quotient_is_rejected() {
    let planted = planted();
    let weighed = |weight: &str| {
        let with = |name: &str| (planted.function(name), |(): &(), l: Vec3| l);
        planted
            .function("cosine")
            .sampled_over(Just(()), |(), u: Vec2| u)
            .samples(65_536)
            .unrecorded()
            .try_estimates_with_weight(with("grey"), with("cosine_pdf"), with(weight))
    };
    weighed("half").expect("the right weight");
    let found = findings(weighed("almost_half"));
    assert!(matches!(found[..], [Finding::Weight { count: 65_536, .. }]), "{found:?}");
}

#[test]
fn a_rejection_names_its_files_and_how_to_replay_it() {
    let rejection = rejected(ggx_against("tilted_pdf"));
    let text = rejection.to_string();
    let worst = &rejection.paths[0].worst;
    assert_eq!(worst.pictures.len(), 2);
    for file in &worst.pictures {
        assert!(file.is_file() && text.contains(&file.display().to_string()), "{text}");
    }
    let (image, _) = karat::Image::read_exr(&worst.pictures[0]).expect("an EXR file");
    // The image has three panels: the expectation is 5 % too large on one side of the observation and 5 % too small on
    // the other.
    assert_eq!(image.width() % 3, 0);
    for part in [
        "fails follows: tilted_pdf on the hemisphere",
        "chi-square is",
        "worst cells",
        "theta",
        "KARAT_CASE=sampling::ggx_normal/follows/0",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
}

/// Replaces each number in the text by `#`.
fn shape(text: &str) -> String {
    let (mut shape, mut before) = (String::new(), ' ');
    let mut rest = text.trim_end().chars().peekable();
    while let Some(c) = rest.next() {
        let digit = |c: &char| c.is_ascii_digit();
        let signed = matches!(c, '+' | '-') && rest.peek().is_some_and(digit);
        if before.is_ascii_alphanumeric() || !signed && !digit(&c) {
            (before, _) = (c, shape.push(c));
            continue;
        }
        // An exponent may have a sign, and a hexadecimal number has letters.
        let number = |c: &char| c.is_ascii_hexdigit() || matches!(c, '-' | 'x' | '.');
        while rest.next_if(number).is_some() {}
        shape.push('#');
        before = '#';
    }
    shape
}

/// Compares the whole message.
#[test]
fn what_a_rejection_says() {
    let mut rejection = rejected(cosine_against("stratum_missing", "cosine_pdf"));
    rejection.paths.truncate(1);
    let first = &mut rejection.paths[0];
    let path = first.adapter.path.clone();
    first.adapter.name = "adapter".to_owned();
    first.adapter.driver = "driver".to_owned();
    for picture in &mut first.worst.pictures {
        let extension = picture.extension().expect("written as two formats").to_owned();
        assert!(picture.file_name().is_some_and(|name| {
            name.to_string_lossy().starts_with("what_a_rejection_says-stratum_missing-follows-")
        }));
        *picture = std::path::Path::new("picture").with_extension(extension);
    }
    let text = shape(&rejection.to_string().replace(&path, "PATH"));
    let expected = "\
error: `stratum_missing` fails follows: cosine_pdf on the hemisphere
   --> <planted>:#:#
   |
# |         fn stratum_missing(u: vec2f) -> vec3f {
   |         ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^

on PATH: adapter, driver
  # of # configurations fail (p below #; the significance of the check is #)
  worst (case #): ()
    chi-square is # with # degrees of freedom: p = #
    sampled: # of # samples lie on the hemisphere
    integral of the density: # +- #, over # cells
    chi-square: #, # degrees, p #
    worst cells:
      theta #, phi #: #, expected # (# sigma)
      theta #, phi #: #, expected # (# sigma)
      theta #, phi #: #, expected # (# sigma)
    observed, expected, difference: picture.exr
    observed, expected, difference: picture.png
  replay: KARAT_PATHS=PATH KARAT_SEED=# KARAT_CASE=stratum_missing/follows/# \
cargo test -p tests --test statistics -- --exact what_a_rejection_says";
    assert_eq!(text, expected, "{text}");
}

// Calibration: runs right samplers on the CPU, with the statistical tests that the checks use.

const SEEDS: u64 = 1000;

fn cosine_coordinates(source: &mut Source) -> [f64; 2] {
    [source.unit().sqrt().asin(), TAU * source.unit()]
}

/// The integral of the cosine's density over each cell.
fn cosine_masses(cells: &Cells) -> Vec<f64> {
    let mass = |cell| {
        let bounds = cells.rectangle(cell);
        let (low, high) = (bounds.low[0].sin(), bounds.high[0].sin());
        (high * high - low * low) * (bounds.high[1] - bounds.low[1]) / TAU
    };
    (0..cells.len()).map(mass).collect()
}

fn cosine_histogram(seed: u64, samples: u64) -> (Cells, Vec<u64>) {
    let mut source = Source::new(seed, u64::MAX);
    let pilot: Vec<_> = (0..4096).map(|_| cosine_coordinates(&mut source)).collect();
    let cells = Cells::new(Support::Hemisphere, &pilot, 8, 16);
    let mut observed = vec![0; cells.len()];
    for sample in 0..samples {
        // Each sample has its own stream, so the test also needs independent streams.
        let at = cosine_coordinates(&mut Source::new(seed, sample));
        let Place::Inside(at) = Support::Hemisphere.locate(Support::Hemisphere.point(at).0) else {
            panic!("{at:?} is on the hemisphere")
        };
        observed[cells.index(at)] += 1;
    }
    (cells, observed)
}

/// Computes a p-value for each seed. Returns the rates of rejections at significance 0.01 and 0.1, and the p-value for
/// the hypothesis that the p-values are uniformly distributed.
fn calibrated(mut p_value: impl FnMut(u64) -> f64) -> (Rate, Rate, f64) {
    let mut p: Vec<f64> = (0..SEEDS).map(&mut p_value).collect();
    let rate = |significance| Rate {
        rejected: p.iter().filter(|p| !accepts(**p, significance)).count() as u64,
        runs: SEEDS,
    };
    let (one, ten) = (rate(0.01), rate(0.1));
    let uniform = Kolmogorov::of(&mut p, |p| p.clamp(0.0, 1.0), 0.0).expect("a thousand");
    (one, ten, uniform.p)
}

// Lesson 7: no more alarms than announced
#[test]
fn chi_square_rejects_as_often_as_it_says() {
    let (one, ten, uniform) = calibrated(|seed| {
        let (cells, observed) = cosine_histogram(seed, 4096);
        let expected: Vec<f64> = cosine_masses(&cells).iter().map(|m| m * 4096.0).collect();
        ChiSquare::of(&observed, &expected).expect("128 cells").p
    });
    assert!(one.is_within(0.01) && ten.is_within(0.1), "{one:?} {ten:?}");
    assert!(uniform > 1e-3, "{uniform}");
}

/// Half of the cells expect fewer than five samples, so the chi-square test pools these cells.
#[test]
fn pooled_chi_square_rejects_as_often_as_it_says() {
    let (one, ten, _) = calibrated(|seed| {
        let (cells, observed) = cosine_histogram(seed, 640);
        let expected: Vec<f64> = cosine_masses(&cells).iter().map(|m| m * 640.0).collect();
        let test = ChiSquare::of(&observed, &expected).expect("some cells");
        assert!(test.pooled > 0, "{test:?}");
        test.p
    });
    assert!(one.is_within(0.01) && ten.is_within(0.1), "{one:?} {ten:?}");
}

#[test]
fn kolmogorov_rejects_as_often_as_it_says() {
    let (one, ten, uniform) = calibrated(|seed| {
        let mut source = Source::new(seed, 1);
        let mut samples: Vec<f64> = (0..1000).map(|_| source.unit().sqrt()).collect();
        Kolmogorov::of(&mut samples, |x| x * x, 0.0).expect("a thousand").p
    });
    assert!(one.is_within(0.01) && ten.is_within(0.1), "{one:?} {ten:?}");
    assert!(uniform > 1e-3, "{uniform}");
}

#[test]
fn means_reject_as_often_as_they_say() {
    let (one, ten, uniform) = calibrated(|seed| {
        let (mut source, mut moments) = (Source::new(seed, 2), Moments::default());
        (0..1000).for_each(|_| moments.add(source.unit().sqrt()));
        Mean::of(&moments, 2.0 / 3.0, 0.0).expect("a thousand").p
    });
    assert!(one.is_within(0.01) && ten.is_within(0.1), "{one:?} {ten:?}");
    assert!(uniform > 1e-3, "{uniform}");
}

/// For checks of means and distributions, the share of runs that detect a fault agrees with the power that Karat
/// states. The test uses faults with a power near one half.
#[test]
fn powers_of_means_and_distributions_are_what_they_are_said_to_be() {
    let cosine = |l: Vec3| f64::from(l.z);
    let uniform = PBR.function("sampling::uniform_hemisphere");
    let samples = |count| uniform.clone().sampled_over(Just(()), |(), u: Vec2| u).samples(count);
    // The mean is 1/2, with a standard deviation of 1/sqrt(12).
    let wrong = 0.5 + 0.01;
    let said = |count| {
        let power = samples(count).mean_power_against(cosine, |()| wrong, |()| 0.5, 0.0);
        power.expect("a power").least
    };
    assert!(said(1 << 16) > 0.999_999 && said(256) < 0.05);
    let rate = Rate::over(0..40, |seed| {
        samples(5000).seed(seed).unrecorded().try_has_mean("cos", cosine, |()| wrong, 0.0).is_err()
    });
    assert!((0.2..0.9).contains(&said(5000)), "{}", said(5000));
    assert!(accepts(binomial_tail(rate.rejected, rate.runs, said(5000)), 1e-3), "{rate:?}");

    // The distribution has an error of 0.02 at the middle.
    let bent = |x: f64| x + 0.08 * x * (1.0 - x);
    let said = |count| {
        let power = samples(count).distribution_power_against(
            cosine,
            |(), x| bent(x),
            |(), x| x.clamp(0.0, 1.0),
            0.0,
        );
        power.expect("a power").least
    };
    assert!(said(1 << 17) > 0.999_999 && said(256) < 0.05);
    let rate = Rate::over(0..40, |seed| {
        let samples = samples(6000).seed(seed);
        samples.unrecorded().try_has_distribution("cos", cosine, |(), x| bent(x), 0.0).is_err()
    });
    // The stated power is a lower bound: the check also rejects a distance at another point.
    let least = said(6000);
    assert!((0.2..0.9).contains(&least), "{least}");
    assert!(rate.share() > least || accepts(binomial_tail(rate.rejected, rate.runs, least), 1e-3));
    assert!(rate.share() < 1.0, "{rate:?}");
}

/// The binomial distribution is discrete, so the test rejects slightly less often than its significance.
#[test]
fn binomial_tails_reject_no_more_often_than_they_say() {
    let (one, ten, _) = calibrated(|seed| {
        let mut source = Source::new(seed, 3);
        let left = (0..1000).filter(|_| source.unit() < 0.3).count() as u64;
        binomial_tail(left, 1000, 0.3)
    });
    assert!(one.is_within(0.01) && ten.is_within(0.1), "{one:?} {ten:?}");
}

/// The claimed density is 8 % too high in half of the 128 cells and 8 % too low in the others. The share of runs that
/// reject it, with 4,096 samples, agrees with the stated power.
#[test]
fn power_is_calibrated_too() {
    let tilt = |cells: &Cells, masses: &[f64]| -> Vec<f64> {
        let tilted = masses.iter().enumerate().map(|(cell, mass)| {
            let middle = cells.rectangle(cell);
            let sign = if middle.low[1] + middle.high[1] < TAU { 1.0 } else { -1.0 };
            mass * (1.0 + 0.08 * sign)
        });
        let tilted: Vec<f64> = tilted.collect();
        let sum: f64 = tilted.iter().sum();
        tilted.into_iter().map(|mass| mass / sum).collect()
    };
    let mut said = Moments::default();
    let rate = Rate::over(0..SEEDS, |seed| {
        let (cells, observed) = cosine_histogram(seed, 4096);
        let masses = cosine_masses(&cells);
        let claimed = tilt(&cells, &masses);
        said.add(chi_square_power(&claimed, &masses, 4096.0, 0.05).expect("128 cells"));
        let expected: Vec<f64> = claimed.iter().map(|mass| mass * 4096.0).collect();
        !accepts(ChiSquare::of(&observed, &expected).expect("128 cells").p, 0.05)
    });
    assert!((0.2..0.9).contains(&said.mean()), "{said:?}");
    let chance = binomial_tail(rate.rejected, rate.runs, said.mean());
    assert!(accepts(chance, 1e-3), "{said:?}, but {rate:?}");
}

/// Measures on a driver how often a whole check rejects a right sampler. Its significance is 0.1, shared between two
/// widths.
// Lesson 7: no more alarms than announced
#[test]
fn checks_of_right_samplers_reject_as_often_as_they_say() {
    let widths = || OneOf(vec![0.2_f32, 0.8]);
    let rate = Rate::over(0..40, |seed| {
        PBR.function("sampling::ggx_normal")
            .sampled_over(widths(), |&alpha, u: Vec2| (alpha, u))
            .samples(4096)
            .significance(0.1)
            .seed(seed)
            .unrecorded()
            .try_follows(PBR.function("sampling::ggx_normal_pdf"), |&alpha, h: Vec3| (alpha, h))
            .is_err()
    });
    assert!(rate.is_within(0.1), "{rate:?}");
}
