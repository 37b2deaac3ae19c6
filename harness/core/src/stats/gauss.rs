//! Gauss-Legendre quadrature.

/// The `count` nodes in 0..1, in ascending order, each with its weight. For a polynomial of degree `2 count - 1` or
/// less, the weighted sum of the values at the nodes equals the integral from 0 to 1. Newton's method computes each
/// node, a root of a Legendre polynomial, from Tricomi's approximation. Source: Abramowitz and Stegun 25.4.29 and
/// 22.16.6.
///
/// ```
/// let area: f64 = karat::stats::gauss_legendre(3).iter().map(|(x, weight)| weight * x * x).sum();
/// assert!((area - 1.0 / 3.0).abs() < 1e-12, "x^2 from 0 to 1: {area}");
/// ```
#[must_use]
pub fn gauss_legendre(count: u32) -> Vec<(f64, f64)> {
    let degree = f64::from(count);
    let node = |index: u32| {
        let mut x = (std::f64::consts::PI * (f64::from(index) + 0.75) / (degree + 0.5)).cos();
        let mut slope = 1.0;
        // Each step squares the error. After four steps, rounding is the only error.
        for _ in 0..6 {
            let (mut before, mut value) = (1.0, x);
            for k in 2..=count {
                let k = f64::from(k);
                (before, value) = (value, ((2.0 * k - 1.0) * x * value - (k - 1.0) * before) / k);
            }
            slope = degree * (x * value - before) / (x * x - 1.0);
            x -= value / slope;
        }
        (0.5 * (1.0 - x), 1.0 / ((1.0 - x * x) * slope * slope))
    };
    (0..count).map(node).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_exact_for_polynomials() {
        for count in [1, 2, 3, 7, 40, 64, 256] {
            let rule = gauss_legendre(count);
            for power in 0..(2 * count).min(80) {
                let term = |(x, w): &(f64, f64)| w * x.powi(power.cast_signed());
                let sum: f64 = rule.iter().map(term).sum();
                assert!(
                    (sum * f64::from(power + 1) - 1.0).abs() < 1e-12,
                    "{count} nodes, x^{power}"
                );
            }
            assert!(rule.is_sorted_by(|a, b| a.0 < b.0), "{count} nodes");
        }
    }
}
