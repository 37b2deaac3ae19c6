use super::*;

fn passes(tolerance: impl Into<Tolerance>, actual: f32, expected: f64) -> bool {
    tolerance.into().measure(0, actual, expected).passes()
}

// Lesson 11
#[test]
fn distance_is_ordered_across_zero_denormals_and_infinity() {
    let tiny = f32::from_bits(1);
    assert_eq!(ulp_distance(tiny, -tiny), Some(2));
    assert_eq!(ulp_distance(0.0, -0.0), Some(0));
    assert_eq!(ulp_distance(f32::MIN_POSITIVE, f32::MIN_POSITIVE.next_down()), Some(1));
    assert_eq!(ulp_distance(1.0, 1.0_f32.next_down()), Some(1));
    assert_eq!(ulp_distance(2.0, 2.0_f32.next_up()), Some(1));
    assert_eq!(ulp_distance(f32::MAX, f32::INFINITY), Some(1));
    assert_eq!(ulp_distance(f32::NEG_INFINITY, f32::INFINITY), Some(2 * 0x7f80_0000));
    assert_eq!(ulp_distance(f32::NAN, 1.0), None);
}

// Lesson 11
#[test]
fn real_references_lie_between_floats() {
    let half_step = 1.0 + f64::from(f32::EPSILON) / 2.0;
    assert!((ordinal(half_step) - ordinal(1.0) - 0.5).abs() < 1e-9);
    assert!(passes(Ulp(0.5), 1.0, half_step));
    assert!(!passes(Ulp(0.49), 1.0, half_step));
    assert!(passes(Ulp(1.0), 1.0_f32.next_down(), 1.0));
    assert!(!passes(Ulp(1.0), 1.0 + 2.0 * f32::EPSILON, 1.0));
}

// Lesson 5
#[test]
fn nan_and_infinity_never_pass() {
    let everything = Abs(f64::INFINITY).or(Rel(f64::INFINITY)).or(Ulp(f64::INFINITY));
    for actual in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for expected in [0.0, 1.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(!passes(everything.clone(), actual, expected), "{actual} {expected}");
        }
    }
    assert!(!passes(everything, 1.0, f64::NAN));
    assert!(!passes(Abs(f64::NAN), 1.5, 1.0), "a bound that is NaN lets nothing pass");
    assert!(!passes(Tolerance::All(vec![]), 1.0, 1.0), "an empty tolerance checks nothing");
    assert!(!passes(Tolerance::Any(vec![]), 1.0, 1.0));
}

// Lesson 12
// Lesson 26
// Lesson 48
#[test]
fn flushed_denormals_are_equal_and_cancellation_has_its_band() {
    assert!(passes(Ulp(0.0), 0.0, 1e-39));
    assert!(passes(Abs(0.0), 0.0, 1e-39) && !passes(Abs(0.0), 1e-39, 0.0));
    assert!(!passes(Abs(0.0), 0.0, 1.2e-38), "that is normal");
    assert!(!passes(Ulp(4.0), 1e-9, 0.0));
    assert!(passes(Ulp(4.0).near_zero(1e-2), 1e-9, 0.0));
    assert!(!passes(Ulp(4.0).near_zero(1e-2), 1e-8, 0.0), "4 steps at 0.01 are 3.7e-9");
    assert!(!passes(Rel(1e-3), 1e-9, 0.0));
    assert!(passes(Rel(1e-3).or(Abs(1e-8)), 1e-9, 0.0));
    assert!(!passes(Rel(1e-3).and(Abs(1e-8)), 1e-9, 0.0));
}

#[test]
fn a_value_too_large_for_f32_fails() {
    assert!(!passes(Ulp(4.0), f32::INFINITY, 1e39));
    assert!(!passes(Ulp(4.0), f32::MAX, 1e39));
}

// Lesson 14
#[test]
fn the_last_component_has_its_own_bound() {
    let tolerance = Tolerance::per_lane([Abs(1.0).into(), Abs(1.0).into(), Abs(0.0).into()]);
    assert!(tolerance.measure(1, 0.5, 0.0).passes());
    assert!(!tolerance.measure(2, 0.5, 0.0).passes());
    assert!(!tolerance.measure(3, 0.0, 0.0).passes(), "a lane without a bound fails");
}

#[test]
fn a_tolerance_is_displayed_as_it_is_written() {
    let tolerance = Ulp(4.0).or(Abs(1e-6)).near_zero(0.01);
    assert_eq!(tolerance.to_string(), "4 ulp (absolute below 0.01) or abs 1e-6");
    assert_eq!(significant(0.000_123_4), "1.23e-4");
    assert_eq!(significant(12.345), "12.3");
    assert_eq!(significant(2.0), "2");
    assert_eq!(significant(123_456.0), "123456");
}

/// Numbers of all binades, with both signs, and special values.
fn numbers() -> Vec<f64> {
    let mut numbers = vec![0.0, f64::NAN, f64::INFINITY, f64::from(f32::MAX), 1e300, 1e-300];
    for exponent in (-150..=128).step_by(9) {
        let binade = 2_f64.powi(exponent);
        numbers.extend(
            [1.0, 1.0 - f64::EPSILON / 2.0, 1.0 + 1e-7, 1.37, 1.999_999_9].map(|x| x * binade),
        );
    }
    let opposite: Vec<f64> = numbers.iter().map(|number| -number).collect();
    [numbers, opposite].concat()
}

// Lesson 118
#[test]
fn a_ratio_below_one_means_within_the_bound() {
    let (wide, narrow) = (Tolerance::from(Ulp(1e8)), Tolerance::from(Ulp(3.0)));
    let tolerances = [
        narrow.clone(),
        wide.clone(),
        Ulp(0.0).into(),
        narrow.clone().near_zero(0.01),
        narrow.clone().near_zero(0.0),
        narrow.clone().near_zero(1e300),
        Rel(1e-6).into(),
        Rel(10.0).into(),
        Abs(1e-3).into(),
        Abs(0.0).into(),
        Rel(1e-6).or(Abs(1e-3)),
        wide.and(Abs(1e-3)),
        Tolerance::per_lane([narrow]),
        Tolerance::Any(vec![]),
        Tolerance::All(vec![]),
        Tolerance::PerLane(vec![]),
    ];
    let numbers = numbers();
    let (mut within, mut passing) = (0_u64, 0_u64);
    for tolerance in &tolerances {
        for (value, expected) in numbers.iter().flat_map(|a| numbers.iter().map(move |b| (*a, *b)))
        {
            // Results are `f32`.
            #[expect(clippy::cast_possible_truncation, reason = "of the numbers that are one")]
            let actual = value as f32;
            let exact = tolerance.measure(0, actual, expected).ratio;
            passing += u64::from(exact <= 1.0);
            for ratio in [f64::NEG_INFINITY, 0.0, 1e-6, 0.3, 1.0] {
                let claim = tolerance.is_within(0, f64::from(actual), expected, ratio);
                let says =
                    || format!("{tolerance}: {actual:e} for {expected:e} has {exact}, not {ratio}");
                assert!(!claim || exact <= ratio, "{}", says());
                within += u64::from(claim && ratio == 1.0);
            }
        }
    }
    // The estimate is useful only if it recognises most results that pass.
    assert!(within > passing / 2, "{within} of {passing} were recognised");
}
