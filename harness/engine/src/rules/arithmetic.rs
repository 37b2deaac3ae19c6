//! Rules that nearly all programs use: the four operations, roots and comparisons.

use super::float_rules;
use crate::interval::Interval;

float_rules! {
    /// Operators, and builtins that combine a few operators.
    Basic {
        Add[2, 1] {
            single: |[x, y]| [x + y],
            double: |[x, y]| [x + y],
            interval: |[x, y]| [x.add(y)],
        }
        Subtract[2, 1] {
            single: |[x, y]| [x - y],
            double: |[x, y]| [x - y],
            interval: |[x, y]| [x.sub(y)],
        }
        Multiply[2, 1] {
            single: |[x, y]| [x * y],
            double: |[x, y]| [x * y],
            interval: |[x, y]| [x.mul(y)],
        }
        /// A number times itself. The result is never negative, even for an interval that contains numbers below zero.
        Square[1, 1] {
            single: |[x]| [x * x],
            double: |[x]| [x * x],
            interval: |[x]| [x.square()],
        }
        Divide[2, 1] {
            single: |[x, y]| [x / y],
            double: |[x, y]| [x / y],
            interval: |[x, y]| [x.div(y)],
        }
        /// `x - y trunc(x / y)`. The result has the sign of x.
        Remainder[2, 1] {
            single: |[x, y]| [x % y],
            double: |[x, y]| [x % y],
            interval: |[x, y]| [remainder(x, y)],
        }
        Negate[1, 1] {
            single: |[x]| [-x],
            double: |[x]| [-x],
            interval: |[x]| [x.neg().flushed()],
        }
        Abs[1, 1] = Abs {
            single: |[x]| [x.abs()],
            double: |[x]| [x.abs()],
            interval: |[x]| [absolute(x).flushed()],
        }
        /// If one argument is NaN, the result is the other argument, as in IEEE's minNum.
        Min[2, 1] = Min {
            single: |[x, y]| [if y < x || x.is_nan() { y } else { x }],
            double: |[x, y]| [if y < x || x.is_nan() { y } else { x }],
            interval: |[x, y]| [x.min(y)],
        }
        Max[2, 1] = Max {
            single: |[x, y]| [if y > x || x.is_nan() { y } else { x }],
            double: |[x, y]| [if y > x || x.is_nan() { y } else { x }],
            interval: |[x, y]| [x.max(y)],
        }
        /// `min(max(x, low), high)`. The specification also allows the median of the three arguments.
        Clamp[3, 1] = Clamp {
            single: |[x, low, high]| {
                let above = if low > x || x.is_nan() { low } else { x };
                [if high < above || above.is_nan() { high } else { above }]
            },
            double: |[x, low, high]| {
                let above = if low > x || x.is_nan() { low } else { x };
                [if high < above || above.is_nan() { high } else { above }]
            },
            interval: |[x, low, high]| {
                let clamped = x.max(low).min(high);
                let median = x.min(low).max(x.max(low).min(high));
                [clamped.join(median)]
            },
        }
        Saturate[1, 1] = Saturate {
            single: |[x]| [if x > 0.0 { if x < 1.0 { x } else { 1.0 } } else { 0.0 }],
            double: |[x]| [if x > 0.0 { if x < 1.0 { x } else { 1.0 } } else { 0.0 }],
            interval: |[x]| [x.max(Interval::point(0.0)).min(Interval::point(1.0))],
        }
        Sqrt[1, 1] = Sqrt {
            single: |[x]| [x.sqrt()],
            double: |[x]| [x.sqrt()],
            interval: |[x]| [x.sqrt()],
        }
        InverseSqrt[1, 1] = InverseSqrt {
            single: |[x]| [1.0 / x.sqrt()],
            double: |[x]| [1.0 / x.sqrt()],
            interval: |[x]| [x.inverse_sqrt()],
        }
        /// `x y + z`, rounded once. The specification also allows two roundings.
        Fma[3, 1] = Fma {
            single: |[x, y, z]| [x.mul_add(y, z)],
            double: |[x, y, z]| [x.mul_add(y, z)],
            interval: |[x, y, z]| [x.mul(y).add(z)],
        }
        /// `x (1 - t) + y t`. The conformance suite also accepts `x + (y - x) t`.
        Mix[3, 1] = Mix {
            single: |[x, y, t]| [x * (1.0 - t) + y * t],
            double: |[x, y, t]| [x * (1.0 - t) + y * t],
            interval: |[x, y, t]| {
                let one = Interval::point(1.0);
                let weighted = x.mul(one.sub(t)).add(y.mul(t));
                [weighted.join(x.add(y.sub(x).mul(t)))]
            },
        }
        /// 0 if `x` is below the edge, and otherwise 1. The edge is the first argument.
        Step[2, 1] = Step {
            single: |[edge, x]| [if edge <= x { 1.0 } else { 0.0 }],
            double: |[edge, x]| [if edge <= x { 1.0 } else { 0.0 }],
            interval: |[edge, x]| {
                use crate::interval::Truth;
                [match edge.less_equal(x) {
                    _ if !edge.is_bounded() || !x.is_bounded() => Interval::UNBOUNDED,
                    Truth::True => Interval::point(1.0),
                    Truth::False => Interval::point(0.0),
                    Truth::Undecided => Interval::between(0.0, 1.0),
                }]
            },
        }
        /// `t t (3 - 2 t)`, where `t` is `saturate((x - low) / (high - low))`.
        SmoothStep[3, 1] = SmoothStep {
            single: |[low, high, x]| {
                let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
                [t * t * (3.0 - 2.0 * t)]
            },
            double: |[low, high, x]| {
                let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
                [t * t * (3.0 - 2.0 * t)]
            },
            interval: |[low, high, x]| {
                let share = x.sub(low).div(high.sub(low));
                let t = share.max(Interval::point(0.0)).min(Interval::point(1.0));
                let two_t = Interval::point(2.0).mul(t);
                [t.mul(t).mul(Interval::point(3.0).sub(two_t))]
            },
        }
        /// The result is -1, 0 or 1. For NaN, the result is 0.
        Sign[1, 1] = Sign {
            single: |[x]| [if x > 0.0 { 1.0 } else if x < 0.0 { -1.0 } else { 0.0 }],
            double: |[x]| [if x > 0.0 { 1.0 } else if x < 0.0 { -1.0 } else { 0.0 }],
            interval: |[x]| [sign(x)],
        }
    }
}

fn absolute(x: Interval) -> Interval {
    if x.lo() >= 0.0 {
        x
    } else if x.hi() <= 0.0 {
        x.neg()
    } else if x.is_bounded() {
        Interval::between(0.0, x.hi().max(-x.lo())).flushed()
    } else {
        Interval::UNBOUNDED
    }
}

fn sign(x: Interval) -> Interval {
    match x.bounds() {
        Some((lo, hi)) => {
            let of = |x: f64| {
                if x > 0.0 {
                    1.0
                } else if x < 0.0 {
                    -1.0
                } else {
                    0.0
                }
            };
            Interval::between(of(lo), of(hi))
        }
        None => Interval::UNBOUNDED,
    }
}

fn remainder(x: Interval, y: Interval) -> Interval {
    let quotient = x.div(y);
    let Some((lo, hi)) = quotient.bounds() else { return Interval::UNBOUNDED };
    let whole = Interval::outwards(lo.trunc(), hi.trunc());
    x.sub(y.mul(whole))
}
