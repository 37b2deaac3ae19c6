//! Bounds of sums and products for all orders of their operations.
//!
//! WGSL, 15.7.5 "Reassociation and Fusion": "Reassociation is the reordering of operations in an expression such that
//! the answer is the same if computed exactly." Its examples are sums with differences, and products with quotients.
//! "However, the result may not be the same when computed in floating point. The reassociated result may be inaccurate
//! due to approximation, or may trigger an overflow or NaN when computing intermediate results. An implementation may
//! reassociate operations." WGSL adds no condition for reassociation. Only a fused expression must be at least as
//! accurate as the original expression. None of the examples distributes a product over a sum, so the bounds don't
//! include distributed products.
//!
//! So Karat bounds the results of all orders. For this, a value remembers the terms or factors from which it was
//! computed, also across let-bindings, variables and calls. For three terms, Karat computes each order. For more terms,
//! and for factors, a value remembers only a few numbers, from which Karat computes bounds for all orders at once.

use super::{Interval, greatest, half, least, lower_sum, upper_sum};

/// The least and the greatest value of a term or a factor. The range includes zero if the value may be flushed to zero.
pub(super) type Ends = (f64, f64);

/// The operands of the operations that computed a value.
#[derive(Clone, Copy, Default)]
pub(super) enum Chain {
    /// The value is neither a sum nor a product.
    #[default]
    Single,
    /// The value is a sum of two terms.
    Pair([(f32, f32); 2]),
    /// The value is a sum of three or more terms, or the join of several sums.
    Sum(Sum),
    Product(Product),
}

impl Chain {
    pub(super) fn neg(self) -> Self {
        match self {
            Self::Single => Self::Single,
            Self::Pair(terms) => Self::Pair(terms.map(|(lo, hi)| (-hi, -lo))),
            Self::Sum(sum) => Self::Sum(sum.neg()),
            Self::Product(product) => {
                let (lo, hi) = (-product.exact.1, -product.exact.0);
                Self::Product(Product { exact: (lo, hi), ..product })
            }
        }
    }

    /// The terms of a value. A value that isn't a sum is a single term, with the range `ends`.
    fn sum(self, ends: Ends) -> Sum {
        match self {
            Self::Single | Self::Product(_) => Sum::of(ends),
            Self::Pair([a, b]) => Sum::of(wide(a)).and(Sum::of(wide(b))),
            Self::Sum(sum) => sum,
        }
    }

    /// The factors of a value. A value that isn't a product is a single factor, with the range `ends`.
    fn product(self, ends: Ends) -> Product {
        match self {
            Self::Product(product) => product,
            _ => Product::of(ends),
        }
    }

    /// The bounds of a value in half precision, for all orders of its operations. Each operation rounds its result, and
    /// `more` other intermediate results are rounded, too. `None` if a value may overflow.
    pub(super) fn in_half(self, ends: Ends, more: u8) -> Option<Ends> {
        match self {
            Self::Single => Some(ends),
            Self::Product(product) => product.in_any_order(&HALF),
            sum => sum.sum(ends).in_any_order(&HALF, more),
        }
    }

    /// The largest difference between the results of two orders of a sum. Each addition has a rounding error of less
    /// than 2^-23 of the largest partial sum. The results of both orders have such errors, so the difference may be
    /// twice as large.
    pub(super) fn slack(self, ends: Ends) -> f64 {
        if !self.is_sum() {
            return 0.0;
        }
        let sum = self.sum(ends);
        let reach = f64::from(sum.most.max(-sum.least)).max(f64::from(f32::MIN_POSITIVE));
        2.0 * f64::from(sum.count) * power(exponent(reach) - 22)
    }

    fn is_sum(self) -> bool {
        matches!(self, Self::Pair(_) | Self::Sum(_))
    }

    fn is_product(self) -> bool {
        matches!(self, Self::Product(_))
    }

    pub(super) fn join(self, ends: Ends, other: Self, others: Ends) -> Self {
        match self.is_sum() || other.is_sum() {
            true => Self::Sum(self.sum(ends).join(other.sum(others))),
            false => Self::Single,
        }
    }
}

fn wide((lo, hi): (f32, f32)) -> Ends {
    (f64::from(lo), f64::from(hi))
}

fn narrow((lo, hi): Ends) -> (f32, f32) {
    (lo as f32, hi as f32)
}

fn above(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) < x { y.next_up() } else { y }
}

fn below(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) > x { y.next_down() } else { y }
}

fn size((lo, hi): Ends) -> Ends {
    let (a, b) = (lo.abs(), hi.abs());
    (if lo <= 0.0 && hi >= 0.0 { 0.0 } else { a.min(b) }, a.max(b))
}

fn added(a: Ends, b: Ends) -> Interval {
    Interval::outwards(lower_sum(a.0, b.0), upper_sum(a.1, b.1))
}

pub(super) fn add(x: (Ends, Chain), y: (Ends, Chain)) -> Interval {
    let ((a, of_a), (b, of_b)) = (x, y);
    let written = added(a, b);
    let (terms, third) = match (of_a, of_b) {
        (of_a, of_b) if !of_a.is_sum() && !of_b.is_sum() => {
            return Interval { chain: Chain::Pair([narrow(a), narrow(b)]), ..written };
        }
        (Chain::Pair(terms), of_b) if !of_b.is_sum() => (terms, b),
        (of_a, Chain::Pair(terms)) if !of_a.is_sum() => (terms, a),
        _ => {
            let sum = of_a.sum(a).and(of_b.sum(b));
            let any = outwards(sum.in_any_order(&SINGLE, 0));
            return Interval { chain: Chain::Sum(sum), ..any }.unless_written(written);
        }
    };
    let [first, second] = terms.map(wide);
    let mut any = written;
    for (first, second) in [(first, second), (second, first)] {
        match added(first, third).bounds() {
            Some(inner) => any = any.join(added(inner, second)),
            None => any = Interval::UNBOUNDED,
        }
    }
    let sum = Sum::of(first).and(Sum::of(second)).and(Sum::of(third));
    Interval { chain: Chain::Sum(sum), ..any }.unless_written(written)
}

/// The product of two values. `same` is `true` for the product of a value with itself, which is never negative.
pub(super) fn multiply(x: (Ends, Chain), y: (Ends, Chain), same: bool) -> Interval {
    let ((a, of_a), (b, of_b)) = (x, y);
    let products = [a.0 * b.0, a.0 * b.1, a.1 * b.0, a.1 * b.1];
    let lo = if same { size(a).0 * size(a).0 } else { least(&products) };
    // The product of two `f32` is exact in `f64`.
    let written = Interval::outwards(lo, greatest(&products));
    let product = of_a.product(a).times(of_b.product(b), same);
    let chain = Chain::Product(product);
    match of_a.is_product() || of_b.is_product() {
        true => {
            Interval { chain, ..outwards(product.in_any_order(&SINGLE)) }.unless_written(written)
        }
        false => Interval { chain, ..written },
    }
}

/// The quotient of two values, for all orders. `written` is the quotient in the written order.
pub(super) fn divide(x: (Ends, Chain), y: (Ends, Chain), written: Interval) -> Interval {
    let ((a, of_a), (b, of_b)) = (x, y);
    if !written.is_bounded() {
        return written;
    }
    let product = of_a.product(a).over(of_b.product(b));
    let chain = Chain::Product(product);
    match of_a.is_product() || of_b.is_product() {
        true => {
            Interval { chain, ..outwards(product.in_any_order(&SINGLE)) }.unless_written(written)
        }
        false => Interval { chain, ..written },
    }
}

#[derive(Clone, Copy)]
pub(super) struct Sum {
    exact: Ends,
    /// The lower bound of all partial sums. `most` is the upper bound.
    least: f32,
    most: f32,
    count: u32,
    /// Each term is a multiple of 2^`step`. Each partial sum is also a multiple of 2^`step`, even after rounding.
    step: i16,
}

/// The value of `step` for zero, because zero is a multiple of each power of two.
const ANY_STEP: i16 = i16::MAX;

const LEAST_STEP: i16 = -149;

struct Format {
    digits: i16,
    greatest: f64,
    /// The exponent of the least subnormal number.
    least_step: i16,
    least_normal: i16,
}

const SINGLE: Format =
    Format { digits: 24, greatest: f32::MAX as f64, least_step: LEAST_STEP, least_normal: -126 };

const HALF: Format = Format {
    digits: 11,
    greatest: half::GREATEST,
    least_step: half::LEAST_STEP,
    least_normal: half::LEAST_NORMAL,
};

impl Sum {
    fn of(ends: Ends) -> Self {
        let (lo, hi) = ends;
        let step = match (size(ends).0, lo == hi) {
            (_, true) if lo == 0.0 => ANY_STEP,
            (0.0, _) => LEAST_STEP,
            (x, one) => {
                let (_, exponent) = significand(x);
                let trailing = if one { significand(x).0.trailing_zeros() } else { 0 };
                exponent + trailing as i16
            }
        };
        let (least, most) = (lo.min(0.0) as f32, hi.max(0.0) as f32);
        Self { exact: ends, least, most, count: 1, step }
    }

    fn neg(self) -> Self {
        let exact = (-self.exact.1, -self.exact.0);
        Self { exact, least: -self.most, most: -self.least, ..self }
    }

    fn and(self, other: Self) -> Self {
        Self {
            exact: (lower_sum(self.exact.0, other.exact.0), upper_sum(self.exact.1, other.exact.1)),
            least: below(f64::from(self.least) + f64::from(other.least)),
            most: above(f64::from(self.most) + f64::from(other.most)),
            count: self.count.saturating_add(other.count),
            step: self.step.min(other.step),
        }
    }

    fn join(self, other: Self) -> Self {
        Self {
            exact: (self.exact.0.min(other.exact.0), self.exact.1.max(other.exact.1)),
            least: self.least.min(other.least),
            most: self.most.max(other.most),
            count: self.count.max(other.count),
            step: self.step.min(other.step),
        }
    }

    /// The bounds of the sum for all orders of its additions. `count` terms need `count - 1` additions. The last
    /// addition rounds the result. Each other addition rounds a partial sum to a neighbouring float, so its error is
    /// less than the distance between two floats near the largest partial sum. All results are multiples of 2^`step`.
    /// `more` is the number of terms that are rounded, too, each with at most the error of a partial sum. `None` if a
    /// sum may overflow.
    fn in_any_order(self, format: &Format, more: u8) -> Option<Ends> {
        let reach = f64::from(self.most.max(-self.least));
        let count = f64::from(self.count);
        let roundings = (count - 2.0).max(0.0) + f64::from(more);
        let flushed =
            if self.step < format.least_normal { power(format.least_normal) } else { 0.0 };
        if reach <= power(self.step.saturating_add(format.digits)).min(format.greatest) {
            // No partial sum is rounded, but subnormal partial sums may be flushed.
            let error = roundings * flushed;
            return Some((self.exact.0 - error, self.exact.1 + error));
        }
        // Rounding may make a partial sum larger.
        let reach = reach * ((count + f64::from(more)) * power(2 - format.digits)).exp();
        if !(reach <= format.greatest) {
            return None;
        }
        let exponent = exponent(reach) - (format.digits - 1);
        let spacing = power(exponent.max(format.least_step));
        let error = roundings * ((spacing - power(self.step)).max(0.0) + flushed);
        Some(((self.exact.0 - error).next_down(), (self.exact.1 + error).next_up()))
    }
}

fn outwards(ends: Option<Ends>) -> Interval {
    ends.map_or(Interval::UNBOUNDED, |(lo, hi)| Interval::outwards(lo, hi))
}

/// 2^`exponent` as an `f64`. Infinity if the power is too large for an `f32`, 0 if it is too small for an `f64`.
pub(super) fn power(exponent: i16) -> f64 {
    match exponent {
        128.. => f64::INFINITY,
        // Only the exponent bits are set.
        -1022.. => f64::from_bits(((i64::from(exponent) + 1023) as u64) << 52),
        _ => 0.0,
    }
}

/// The exponent of an `f32` that was converted to `f64`. For 0, returns an exponent below all others.
pub(super) fn exponent(x: f64) -> i16 {
    (x.to_bits() >> 52 & 0x7FF) as i16 - 1023
}

/// Splits an `f32` above zero into an integer of up to 24 bits, times a power of two. Returns the integer and the
/// exponent of this power.
fn significand(x: f64) -> (u32, i16) {
    let exponent = exponent(x).max(-126) - 23;
    ((x / power(exponent)) as u32, exponent)
}

/// The factors and divisors of a product, as numbers from which Karat computes bounds for all orders.
#[derive(Clone, Copy)]
pub(super) struct Product {
    exact: Ends,
    /// The lower bound of the magnitudes of all partial products. `most` is the upper bound.
    least: f32,
    most: f32,
    /// The largest magnitude that a product of some of the divisors can have. `dividend` is the same for the other
    /// factors.
    divisor: f32,
    dividend: f32,
    divisors: u16,
    dividends: u16,
    divisions: u16,
    /// The number of factors that may cause rounding errors: all factors except powers of two.
    rounding: u16,
    /// The number of binary digits of all factors that `rounding` counts. A product with up to 24 binary digits is
    /// exact.
    digits: u16,
}

impl Product {
    fn of(ends: Ends) -> Self {
        let (least, most) = size(ends);
        let (rounding, digits) = match ends.0 == ends.1 {
            true if least == 0.0 => (0, 0),
            true => {
                let digits = 32
                    - significand(least).0.trailing_zeros()
                    - significand(least).0.leading_zeros();
                if digits == 1 { (0, 0) } else { (1, digits as u16) }
            }
            false => (1, 24),
        };
        Self {
            exact: ends,
            least: (least as f32).min(1.0),
            most: (most as f32).max(1.0),
            divisor: 1.0,
            dividend: (most as f32).max(1.0),
            divisors: 0,
            dividends: 1,
            divisions: 0,
            rounding,
            digits,
        }
    }

    fn times(self, other: Self, same: bool) -> Self {
        let (a, b) = (self.exact, other.exact);
        let products = [a.0 * b.0, a.0 * b.1, a.1 * b.0, a.1 * b.1];
        let lo = if same { size(a).0 * size(a).0 } else { least(&products) };
        let hi = greatest(&products);
        let digits = self.digits.saturating_add(other.digits);
        // A number of at most 53 digits is exact in an `f64`. Zero is exact, too.
        let is_exact = digits <= 53 && self.divisors == 0 && other.divisors == 0;
        let exact = (
            if is_exact || lo == 0.0 { lo } else { lo.next_down() },
            if is_exact || hi == 0.0 { hi } else { hi.next_up() },
        );
        Self {
            exact,
            least: below(f64::from(self.least) * f64::from(other.least)),
            most: above(f64::from(self.most) * f64::from(other.most)),
            divisor: above(f64::from(self.divisor) * f64::from(other.divisor)),
            dividend: above(f64::from(self.dividend) * f64::from(other.dividend)),
            divisors: self.divisors.saturating_add(other.divisors),
            dividends: self.dividends.saturating_add(other.dividends),
            divisions: self.divisions.saturating_add(other.divisions),
            rounding: self.rounding.saturating_add(other.rounding),
            digits,
        }
    }

    /// Divides by a product that isn't zero. The divisors of `other` become factors: `a / (b / c)` is `a c / b`.
    fn over(self, other: Self) -> Self {
        let (lo, hi) = other.exact;
        let inverse = Self {
            exact: ((1.0 / hi).next_down(), (1.0 / lo).next_up()),
            least: below(1.0 / f64::from(other.most)),
            most: above(1.0 / f64::from(other.least)),
            divisor: other.dividend,
            dividend: other.divisor,
            divisors: other.dividends,
            dividends: other.divisors,
            // In another order, each factor of `other` may become a separate divisor.
            divisions: other.divisions.saturating_add(other.dividends),
            ..other
        };
        self.times(inverse, false)
    }

    /// The bounds of the product for all orders of its operations. `count` factors need `count - 1` operations. The
    /// error of a multiplication is less than an ulp of the result. The error of a division is at most 2.5 ulp. A
    /// multiplication by a power of two is exact. `None` if a product may overflow.
    fn in_any_order(self, format: &Format) -> Option<Ends> {
        // The largest ulp relative to a result. It occurs just above a power of two.
        let ulp = power(1 - format.digits);
        let least_divisor = power(format.least_normal);
        let operations = self.dividends.saturating_add(self.divisors).saturating_sub(1);
        if operations >= u16::MAX - 1 {
            // There are too many factors to count.
            return None;
        }
        let divisions = self.divisions.min(operations);
        // Another order may divide by a partial product.
        let is_reordered = divisions > 0 && operations > 1;
        let greatest = if is_reordered { 1.0 / least_divisor } else { format.greatest };
        let rounded = 1.0 + f64::from(operations) * 4.0 * ulp;
        if !(f64::from(self.most) * rounded <= greatest)
            || !(f64::from(self.divisor) * rounded <= 1.0 / least_divisor)
        {
            return None;
        }
        let multiplications = (operations - divisions).min(self.rounding.saturating_sub(1));
        let exponents = match divisions {
            // Only the last operation rounds.
            0 if i32::from(self.digits) <= i32::from(format.digits) => (0, 0),
            0 => (i32::from(multiplications) - 1, 0),
            _ => (i32::from(multiplications), i32::from(divisions)),
        };
        let error = |by: f64| {
            (1.0 + by * ulp).powi(exponents.0.max(0)) * (1.0 + 2.5 * by * ulp).powi(exponents.1)
        };
        let (lo, hi) = self.exact;
        let (less, more) = (error(-1.0), error(1.0));
        // An intermediate result below the least normal number is flushed to 0, or has an error of 2.5 of the least
        // steps. The remaining factors multiply this error.
        let underflows = f64::from(self.least) < least_divisor * rounded && (lo, hi) != (0.0, 0.0);
        let tiny = match underflows {
            true => f64::from(operations) * 2.5 * power(format.least_step) * f64::from(self.most),
            false => 0.0,
        };
        // Rounding and flushing don't change a sign.
        let below = match lo {
            _ if lo > 0.0 && underflows => 0.0,
            _ if lo >= 0.0 => lo * less,
            _ => lo * more - tiny,
        };
        let above = match hi {
            _ if hi < 0.0 && underflows => 0.0,
            _ if hi <= 0.0 => hi * less,
            _ => hi * more + tiny,
        };
        Some((below, above))
    }
}
