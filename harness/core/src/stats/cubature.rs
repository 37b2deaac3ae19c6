//! Integrates a function adaptively over the cells of a support. The function is evaluated in batches.

use super::gauss::gauss_legendre;
use super::{Cells, Support};

/// The number of Gauss-Legendre nodes for each coordinate of a rectangle: a rule of degree 13, whose nodes are inside
/// of the rectangle. A second rule, Lobatto's rule of degree 7, also has nodes on the sides of the rectangle. So the
/// two rules disagree if a jump of the function is between the rectangle's sides and the outer Gauss-Legendre nodes.
const ORDER: u32 = 7;

/// The largest number of nodes for the integrals over all cells together. A software rasteriser evaluates this many
/// nodes in about ten seconds.
const MOST: usize = 1 << 24;

/// The number of rectangles whose nodes are evaluated at once.
const BATCH: usize = 880; // with 74 nodes each, less than 65,536 nodes

/// A rectangle in the coordinates of a [`Support`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rectangle {
    /// The lower end of each coordinate.
    pub low: [f64; 2],
    /// The upper end of each coordinate.
    pub high: [f64; 2],
}

impl Rectangle {
    /// The smallest rectangle that contains both rectangles.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        let low = [self.low[0].min(other.low[0]), self.low[1].min(other.low[1])];
        let high = [self.high[0].max(other.high[0]), self.high[1].max(other.high[1])];
        Self { low, high }
    }

    fn split(self, line: bool) -> Vec<Self> {
        let middle = [0, 1].map(|side| 0.5 * (self.low[side] + self.high[side]));
        let halves =
            |side: usize| [(self.low[side], middle[side]), (middle[side], self.high[side])];
        let second = if line { vec![(self.low[1], self.high[1])] } else { halves(1).to_vec() };
        let part = |(a0, a1): (f64, f64)| {
            second.iter().map(move |(b0, b1)| Self { low: [a0, *b0], high: [a1, *b1] })
        };
        halves(0).into_iter().flat_map(part).collect()
    }
}

/// The integral of a function over one cell.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CellIntegral {
    /// The integral of each component of the function.
    pub value: Vec<f64>,
    /// The estimated error of the component with the largest error: the difference between two quadrature rules. The
    /// errors of a cell's parts are independent, so their squares are added.
    pub error: f64,
}

/// The reason why [`integrate`] has no result.
#[derive(Debug, thiserror::Error)]
pub enum CubatureError<E> {
    /// The function can't be evaluated.
    #[error(transparent)]
    Evaluation(E),
    /// The two quadrature rules still differ by more than the tolerance after the largest number of nodes.
    #[error("the integral is unknown: two quadrature rules still disagree after {nodes} nodes")]
    Diverges {
        /// The number of evaluated nodes.
        nodes: usize,
    },
}

#[derive(Clone, Copy)]
struct Part {
    cell: usize,
    rectangle: Rectangle,
    depth: u32,
}

/// Integrates a function with `components` components over each cell of `cells`.
///
/// Karat applies two quadrature rules to each part of a cell, and divides the part if the rules differ by more than the
/// tolerance. `tolerance` computes a cell's tolerance from the current estimate of the cell's integral. Each division
/// halves the sides of a part, and divides its tolerance by sqrt(2). A jump of the function then crosses twice as many
/// parts, whose errors are independent, so the squares of their tolerances have the same sum as before.
///
/// `evaluate` receives points and returns the function's components at each point, one point after another.
///
/// # Errors
/// Returns an error if `evaluate` fails, or if the two rules still disagree after the largest number of nodes.
pub fn integrate<E>(
    support: Support,
    cells: &Cells,
    components: usize,
    tolerance: impl Fn(&[f64]) -> f64,
    mut evaluate: impl FnMut(&[[f64; 3]]) -> Result<Vec<f64>, E>,
) -> Result<Vec<CellIntegral>, CubatureError<E>> {
    let rules = [lobatto(), gauss_legendre(ORDER)].map(|side| rule(&side, support.is_line()));
    let per_part: usize = rules.iter().map(Vec::len).sum();
    let zero = CellIntegral { value: vec![0.0; components], error: 0.0 };
    let mut sums = vec![zero; cells.len()];
    let mut pending: Vec<Part> = (0..cells.len())
        .flat_map(|cell| cells.parts(cell).into_iter().map(move |part| (cell, part)))
        .map(|(cell, rectangle)| Part { cell, rectangle, depth: 0 })
        .collect();
    let mut evaluated = 0;
    while !pending.is_empty() {
        let mut results = Vec::with_capacity(pending.len());
        for batch in pending.chunks(BATCH) {
            evaluated += batch.len() * per_part;
            if evaluated > MOST {
                return Err(CubatureError::Diverges { nodes: evaluated });
            }
            let mut points = Vec::with_capacity(batch.len() * per_part);
            let mut weights = Vec::with_capacity(batch.len() * per_part);
            for part in batch {
                let Rectangle { low, high } = part.rectangle;
                let size = [high[0] - low[0], high[1] - low[1]];
                for (node, weight) in rules.iter().flatten() {
                    let at = [low[0] + size[0] * node[0], low[1] + size[1] * node[1]];
                    let (point, measure) = support.point(at);
                    points.push(point);
                    weights.push(weight * size[0] * size[1] * measure);
                }
            }
            let values = evaluate(&points).map_err(CubatureError::Evaluation)?;
            let mut nodes = weights.iter().zip(values.chunks_exact(components));
            for _ in batch {
                let sums = [0, 1].map(|which| {
                    let mut sum = vec![0.0; components];
                    for (weight, value) in nodes.by_ref().take(rules[which].len()) {
                        for (sum, value) in sum.iter_mut().zip(value) {
                            *sum += weight * value;
                        }
                    }
                    sum
                });
                results.push(sums);
            }
        }
        // The current estimate of each cell's integral, before any part is divided.
        let mut known: Vec<Vec<f64>> = sums.iter().map(|sum| sum.value.clone()).collect();
        for (part, [_, higher]) in pending.iter().zip(&results) {
            add(&mut known[part.cell], higher);
        }
        let mut next = Vec::new();
        for (part, [lower, higher]) in pending.iter().zip(results) {
            let errors = lower.iter().zip(&higher).map(|(lower, higher)| (higher - lower).abs());
            // Unlike `f64::max`, this closure keeps NaN.
            let error = errors.fold(0.0, |worst, error| if error <= worst { worst } else { error });
            let share = 0.5_f64.powi(part.depth.cast_signed()).sqrt();
            if error <= share * tolerance(&known[part.cell]) {
                let sum = &mut sums[part.cell];
                add(&mut sum.value, &higher);
                sum.error = sum.error.hypot(error);
            } else {
                let parts = part.rectangle.split(support.is_line()).into_iter();
                let depth = part.depth + 1;
                next.extend(parts.map(|rectangle| Part { rectangle, depth, ..*part }));
            }
        }
        pending = next;
    }
    Ok(sums)
}

fn add(sum: &mut [f64], values: &[f64]) {
    for (sum, value) in sum.iter_mut().zip(values) {
        *sum += value;
    }
}

/// The two-dimensional rule from a one-dimensional rule: nodes in the unit square, with their weights. If `line` is
/// `true`, the support has only one coordinate, so the second coordinate of each node is 1/2.
fn rule(nodes: &[(f64, f64)], line: bool) -> Vec<([f64; 2], f64)> {
    let second = if line { &[(0.5, 1.0)] } else { nodes };
    let row = |(a, weight): &(f64, f64)| {
        let (a, weight) = (*a, *weight);
        second.iter().map(move |(b, other)| ([a, *b], weight * other))
    };
    nodes.iter().flat_map(row).collect()
}

/// The five nodes of Lobatto's rule in 0..=1, ends included, with weights. Source: Abramowitz and Stegun 25.4.32.
fn lobatto() -> Vec<(f64, f64)> {
    let inner = 0.5 * (3.0_f64 / 7.0).sqrt();
    let (end, side, middle) = (1.0 / 20.0, 49.0 / 180.0, 16.0 / 45.0);
    vec![(0.0, end), (0.5 - inner, side), (0.5, middle), (0.5 + inner, side), (1.0, end)]
}

#[cfg(test)]
mod tests {
    use std::convert::Infallible;
    use std::f64::consts::{PI, TAU};

    use super::*;
    use crate::domain::Source;

    fn total(
        support: Support,
        tolerance: f64,
        function: impl Fn([f64; 3]) -> f64,
    ) -> Result<(f64, usize), CubatureError<Infallible>> {
        let [(a0, a1), (b0, b1)] = support.extent();
        let mut source = Source::new(3, 3);
        let mut at = || [a0 + (a1 - a0) * source.unit(), b0 + (b1 - b0) * source.unit()];
        let pilot: Vec<_> = (0..500).map(|_| at()).collect();
        let cells = Cells::new(support, &pilot, 4, 8);
        let mut nodes = 0;
        let cells = integrate(
            support,
            &cells,
            1,
            |_| tolerance,
            |points| {
                nodes += points.len();
                Ok(points.iter().map(|point| function(*point)).collect())
            },
        )?;
        Ok((cells.iter().map(|cell| cell.value[0]).sum(), nodes))
    }

    #[test]
    fn rules_are_exact_for_polynomials() {
        let exact = |nodes: Vec<(f64, f64)>, degree: u8| {
            for power in 0..=degree {
                let sum: f64 = nodes.iter().map(|(x, w)| w * x.powi(power.into())).sum();
                assert!((sum - 1.0 / f64::from(power + 1)).abs() < 1e-14, "{degree} {power}");
            }
        };
        exact(lobatto(), 7);
    }

    #[test]
    fn the_integral_of_one_is_the_measure_of_the_support() {
        for (support, measure) in [
            (Support::Sphere, 2.0 * TAU),
            (Support::Hemisphere, TAU),
            (Support::Disk, PI),
            (Support::Interval(-1.0, 4.0), 5.0),
        ] {
            let (sum, _) = total(support, 1e-9, |_| 1.0).expect("smooth");
            assert!((sum - measure).abs() < 1e-9, "{support}: {sum}");
        }
    }

    #[test]
    fn an_integral_over_a_discontinuity_converges() {
        let (sum, nodes) =
            total(Support::Disk, 1e-6, |[x, ..]| f64::from(u8::from(x > 0.3))).expect("ends");
        let exact = 0.3_f64.acos() - 0.3 * 0.91_f64.sqrt();
        assert!((sum - exact).abs() < 2e-5 && nodes < 1_000_000, "{sum} {exact} {nodes}");
    }

    #[test]
    fn an_integral_that_never_converges_is_an_error() {
        let count = std::cell::Cell::new(0_u32);
        let noise = |_| {
            count.set(count.get().wrapping_add(1));
            f64::from(count.get().wrapping_mul(0x9e37_79b9) >> 16)
        };
        let diverged = total(Support::Disk, 1e-12, noise);
        assert!(matches!(diverged, Err(CubatureError::Diverges { .. })));
        // A NaN never agrees with another value.
        assert!(total(Support::Interval(0.0, 1.0), 1.0, |_| f64::NAN).is_err());
    }
}
