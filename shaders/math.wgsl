// Constants, and the only power that the library needs.

const PI: f32 = 3.14159265358979323846;
const TAU: f32 = 6.28318530717958647692;
/// 1 / (2 pi): the density of a uniform direction on the hemisphere, in 1/sr.
const INV_TAU: f32 = 0.15915494309189533577;

/// `x` to the fifth power, by three multiplications.
///
/// `pow(x, 5.0)` inherits its error from `exp2(5.0 * log2(x))`: it is about twenty times less
/// accurate, unbounded at 0 and NaN for negative `x`.
fn pow5(x: f32) -> f32 {
    let x2 = x * x;
    return x2 * x2 * x;
}
