//! Rust counterpart of `math.wgsl`.

/// `x` to the fifth power.
#[must_use]
pub fn pow5(x: f64) -> f64 {
    x.powi(5)
}
