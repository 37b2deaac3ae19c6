//! Rules for powers and logarithms. The bounds are from WGSL, "Floating Point Accuracy".

use super::float_rules;
use crate::interval::Interval;

float_rules! {
    /// Powers and logarithms.
    Exponential {
        Exp[1, 1] = Exp {
            single: |[x]| [libm::expf(x)],
            double: |[x]| [libm::exp(x)],
            interval: |[x]| [x.exp()],
        }
        Exp2[1, 1] = Exp2 {
            single: |[x]| [libm::exp2f(x)],
            double: |[x]| [libm::exp2(x)],
            interval: |[x]| [x.exp2()],
        }
        Log[1, 1] = Log {
            single: |[x]| [libm::logf(x)],
            double: |[x]| [libm::log(x)],
            interval: |[x]| [x.logarithm(libm::log)],
        }
        Log2[1, 1] = Log2 {
            single: |[x]| [libm::log2f(x)],
            double: |[x]| [libm::log2(x)],
            interval: |[x]| [x.logarithm(libm::log2)],
        }
        /// `exp2(y log2(x))`. For each x below zero, the result is NaN.
        Pow[2, 1] = Pow {
            single: |[x, y]| [if x < 0.0 { f32::NAN } else { libm::powf(x, y) }],
            double: |[x, y]| [if x < 0.0 { f64::NAN } else { libm::pow(x, y) }],
            interval: |[x, y]| [y.mul(x.logarithm(libm::log2)).exp2()],
        }
        Sinh[1, 1] = Sinh {
            single: |[x]| [libm::sinhf(x)],
            double: |[x]| [libm::sinh(x)],
            interval: |[x]| [sinh(x)],
        }
        Cosh[1, 1] = Cosh {
            single: |[x]| [libm::coshf(x)],
            double: |[x]| [libm::cosh(x)],
            interval: |[x]| [cosh(x)],
        }
        /// The error is at most 1e-5 (absolute), or at most the error of `sinh(x) / cosh(x)`, whichever is larger.
        Tanh[1, 1] = Tanh {
            single: |[x]| [libm::tanhf(x)],
            double: |[x]| [libm::tanh(x)],
            interval: |[x]| [x.monotonic(libm::tanh, |_, _| 1e-5).join(sinh(x).div(cosh(x)))],
        }
        /// `log(x + sqrt(x x + 1))`.
        Asinh[1, 1] = Asinh {
            single: |[x]| [libm::asinhf(x)],
            double: |[x]| [libm::asinh(x)],
            interval: |[x]| {
                let root = x.square().add(Interval::point(1.0)).sqrt();
                [x.add(root).logarithm(libm::log)]
            },
        }
        /// `log(x + sqrt(x x - 1))`.
        Acosh[1, 1] = Acosh {
            single: |[x]| [libm::acoshf(x)],
            double: |[x]| [libm::acosh(x)],
            interval: |[x]| {
                let root = x.square().sub(Interval::point(1.0)).sqrt();
                [x.add(root).logarithm(libm::log)]
            },
        }
        /// `log((1 + x) / (1 - x)) / 2`.
        Atanh[1, 1] = Atanh {
            single: |[x]| [libm::atanhf(x)],
            double: |[x]| [libm::atanh(x)],
            interval: |[x]| {
                let one = Interval::point(1.0);
                let quotient = one.add(x).div(one.sub(x));
                [quotient.logarithm(libm::log).mul(Interval::point(0.5))]
            },
        }
    }
}

fn sinh(x: Interval) -> Interval {
    x.exp().sub(x.neg().exp()).mul(Interval::point(0.5))
}

fn cosh(x: Interval) -> Interval {
    x.exp().add(x.neg().exp()).mul(Interval::point(0.5))
}
