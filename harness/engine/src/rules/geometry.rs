//! Rules for functions of whole vectors and matrices, such as `dot` and `determinant`.
//!
//! Each size of vector or matrix has its own rule, such as `Reflect2` and `Reflect3`. A rule is then a single loop over
//! all lanes.

use super::float_rules;
use crate::interval::Interval;

/// The sum of products, in the order of the components.
macro_rules! dot {
    ($zero:expr, $x:expr, $y:expr) => {{
        let mut sum = $x[0] * $y[0];
        for k in 1..$x.len() {
            sum += $x[k] * $y[k];
        }
        sum
    }};
}

macro_rules! refract {
    ($x:expr, $n:literal) => {{
        let eta = $x[2 * $n];
        let d = dot!(0.0, $x[$n..2 * $n], $x[..$n]);
        let k = 1.0 - eta * eta * (1.0 - d * d);
        let bend = eta * d + k.sqrt();
        std::array::from_fn(|i| if k < 0.0 { 0.0 } else { eta * $x[i] - bend * $x[$n + i] })
    }};
}

float_rules! {
    /// Functions of vectors and matrices.
    Geometry {
        Dot2[4, 1] {
            single: |x| [dot!(0.0, x[..2], x[2..])],
            double: |x| [dot!(0.0, x[..2], x[2..])],
            interval: |x| [dot(&x[..2], &x[2..])],
        }
        Dot3[6, 1] {
            single: |x| [dot!(0.0, x[..3], x[3..])],
            double: |x| [dot!(0.0, x[..3], x[3..])],
            interval: |x| [dot(&x[..3], &x[3..])],
        }
        Dot4[8, 1] {
            single: |x| [dot!(0.0, x[..4], x[4..])],
            double: |x| [dot!(0.0, x[..4], x[4..])],
            interval: |x| [dot(&x[..4], &x[4..])],
        }
        /// The length of a scalar, which is its magnitude.
        Length1[1, 1] {
            single: |[x]| [x.abs()],
            double: |[x]| [x.abs()],
            interval: |x| [length(&x)],
        }
        Length2[2, 1] {
            single: |x| [dot!(0.0, x, x).sqrt()],
            double: |x| [dot!(0.0, x, x).sqrt()],
            interval: |x| [length(&x)],
        }
        Length3[3, 1] {
            single: |x| [dot!(0.0, x, x).sqrt()],
            double: |x| [dot!(0.0, x, x).sqrt()],
            interval: |x| [length(&x)],
        }
        Length4[4, 1] {
            single: |x| [dot!(0.0, x, x).sqrt()],
            double: |x| [dot!(0.0, x, x).sqrt()],
            interval: |x| [length(&x)],
        }
        Normalize2[2, 2] {
            single: |x| { let length = dot!(0.0, x, x).sqrt(); x.map(|x| x / length) },
            double: |x| { let length = dot!(0.0, x, x).sqrt(); x.map(|x| x / length) },
            interval: |x| normalize(x),
        }
        Normalize3[3, 3] {
            single: |x| { let length = dot!(0.0, x, x).sqrt(); x.map(|x| x / length) },
            double: |x| { let length = dot!(0.0, x, x).sqrt(); x.map(|x| x / length) },
            interval: |x| normalize(x),
        }
        Normalize4[4, 4] {
            single: |x| { let length = dot!(0.0, x, x).sqrt(); x.map(|x| x / length) },
            double: |x| { let length = dot!(0.0, x, x).sqrt(); x.map(|x| x / length) },
            interval: |x| normalize(x),
        }
        Cross[6, 3] {
            single: |[a, b, c, x, y, z]| [b * z - c * y, c * x - a * z, a * y - b * x],
            double: |[a, b, c, x, y, z]| [b * z - c * y, c * x - a * z, a * y - b * x],
            interval: |[a, b, c, x, y, z]| [
                b.mul(z).sub(c.mul(y)),
                c.mul(x).sub(a.mul(z)),
                a.mul(y).sub(b.mul(x)),
            ],
        }
        /// `x - 2 dot(n, x) n`. The arguments are x, then n.
        Reflect2[4, 2] {
            single: |x| {
                let twice = 2.0 * dot!(0.0, x[2..], x[..2]);
                std::array::from_fn(|k| x[k] - twice * x[2 + k])
            },
            double: |x| {
                let twice = 2.0 * dot!(0.0, x[2..], x[..2]);
                std::array::from_fn(|k| x[k] - twice * x[2 + k])
            },
            interval: |x| reflect(&x),
        }
        Reflect3[6, 3] {
            single: |x| {
                let twice = 2.0 * dot!(0.0, x[3..], x[..3]);
                std::array::from_fn(|k| x[k] - twice * x[3 + k])
            },
            double: |x| {
                let twice = 2.0 * dot!(0.0, x[3..], x[..3]);
                std::array::from_fn(|k| x[k] - twice * x[3 + k])
            },
            interval: |x| reflect(&x),
        }
        Reflect4[8, 4] {
            single: |x| {
                let twice = 2.0 * dot!(0.0, x[4..], x[..4]);
                std::array::from_fn(|k| x[k] - twice * x[4 + k])
            },
            double: |x| {
                let twice = 2.0 * dot!(0.0, x[4..], x[..4]);
                std::array::from_fn(|k| x[k] - twice * x[4 + k])
            },
            interval: |x| reflect(&x),
        }
        /// The arguments are x, n and the ratio of refractive indices. The result is zero for total reflection.
        Refract2[5, 2] {
            single: |x| refract!(x, 2),
            double: |x| refract!(x, 2),
            interval: |x| refract(&x),
        }
        Refract3[7, 3] {
            single: |x| refract!(x, 3),
            double: |x| refract!(x, 3),
            interval: |x| refract(&x),
        }
        Refract4[9, 4] {
            single: |x| refract!(x, 4),
            double: |x| refract!(x, 4),
            interval: |x| refract(&x),
        }
        /// The specification doesn't limit the error of determinants.
        Determinant2[4, 1] {
            single: |[a, b, c, d]| [a * d - b * c],
            double: |[a, b, c, d]| [a * d - b * c],
            interval: |_| [Interval::UNBOUNDED],
        }
        Determinant3[9, 1] {
            single: |m| [determinant3(m)],
            double: |m| [determinant3(m)],
            interval: |_| [Interval::UNBOUNDED],
        }
        Determinant4[16, 1] {
            single: |m| [determinant4(m)],
            double: |m| [determinant4(m)],
            interval: |_| [Interval::UNBOUNDED],
        }
    }
}

/// The specification says: "Inherited from sum of x[i] * y[i]". As for every sum, the bounds hold for all orders of the
/// additions.
fn dot(x: &[Interval], y: &[Interval]) -> Interval {
    sum(x.iter().zip(y).map(|(x, y)| x.mul(*y)))
}

fn sum(terms: impl Iterator<Item = Interval>) -> Interval {
    terms.reduce(Interval::add).unwrap_or_default()
}

fn length(x: &[Interval]) -> Interval {
    sum(x.iter().map(|x| x.square())).sqrt()
}

fn normalize<const N: usize>(x: [Interval; N]) -> [Interval; N] {
    let length = length(&x);
    x.map(|x| x.div(length))
}

fn reflect<const O: usize>(x: &[Interval]) -> [Interval; O] {
    let (e, n) = x.split_at(O);
    let twice = Interval::point(2.0).mul(dot(n, e));
    std::array::from_fn(|k| e[k].sub(twice.mul(n[k])))
}

fn refract<const O: usize>(x: &[Interval]) -> [Interval; O] {
    let (e, n, eta) = (&x[..O], &x[O..2 * O], x[2 * O]);
    let one = Interval::point(1.0);
    let d = dot(n, e);
    let k = one.sub(eta.mul(eta).mul(one.sub(d.mul(d))));
    let zero = Interval::point(0.0);
    if k.is_bounded() && k.hi() < 0.0 {
        return [zero; O];
    }
    let bend = eta.mul(d).add(k.sqrt());
    std::array::from_fn(|i| eta.mul(e[i]).sub(bend.mul(n[i])))
}

/// Expands the determinant by the first column. `m` has the elements of the matrix, column after column.
fn determinant3<T>(m: [T; 9]) -> T
where
    T: Copy + std::ops::Mul<Output = T> + std::ops::Sub<Output = T> + std::ops::Add<Output = T>,
{
    let [a, b, c, d, e, f, g, h, i] = m;
    a * (e * i - f * h) - d * (b * i - c * h) + g * (b * f - c * e)
}

fn determinant4<T>(m: [T; 16]) -> T
where
    T: Copy + std::ops::Mul<Output = T> + std::ops::Sub<Output = T> + std::ops::Add<Output = T>,
{
    let minor = |column: usize| {
        let columns: Vec<usize> = (0..4).filter(|&c| c != column).collect();
        determinant3(std::array::from_fn(|k| m[columns[k / 3] * 4 + 1 + k % 3]))
    };
    m[0] * minor(0) - m[4] * minor(1) + m[8] * minor(2) - m[12] * minor(3)
}
