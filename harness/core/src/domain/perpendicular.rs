//! Makes a vector perpendicular to other vectors of the same row. A row contains the words of a case's arguments.

use std::ops::Range;

use super::{direction, shrink};

/// If the perpendicular part of a unit vector is shorter than this length, rounding has made the part's direction
/// inaccurate. Then Karat starts from an axis instead of this vector.
const SHORT: f64 = 1e-3;

/// If the directions of two vectors differ by at most this value, the vectors count as parallel, because `f32` rounding
/// causes such differences.
const PARALLEL: f64 = 1e-6;

/// A relation that makes a unit vector perpendicular to other vectors of its row.
#[derive(Debug)]
pub(super) struct Perpendicular {
    pub(super) lanes: Range<usize>,
    pub(super) to: Vec<usize>,
}

impl Perpendicular {
    fn vector(&self, row: &[u32], first: usize) -> Vec<f64> {
        let lanes = &row[first..first + self.lanes.len()];
        lanes.iter().map(|word| f64::from(f32::from_bits(*word))).collect()
    }

    /// Returns orthogonal unit vectors that span the same space as the other vectors. A zero vector adds nothing.
    /// `None` if a vector isn't finite, or if two vectors are almost, but not exactly, parallel: a vector perpendicular
    /// to both would have few correct digits.
    fn others(&self, row: &[u32]) -> Option<Vec<Vec<f64>>> {
        let mut all: Vec<Vec<f64>> = Vec::new();
        for first in &self.to {
            let other = self.vector(row, *first);
            let length = dot(&other, &other).sqrt();
            if !length.is_finite() {
                return None;
            }
            let rest = without(&other, &all);
            let left = dot(&rest, &rest).sqrt();
            if left > SHORT * length {
                all.push(rest.iter().map(|x| x / left).collect());
            } else if left > PARALLEL * length {
                return None;
            }
        }
        Some(all)
    }

    /// Makes the vector perpendicular to the other vectors, by removing its components along them, and gives it the
    /// length 1. Returns `false` if no vector is perpendicular to all the others, or if a vector isn't finite.
    pub(super) fn settle(&self, row: &mut [u32]) -> bool {
        let Some(others) = self.others(row) else { return false };
        let own = self.vector(row, self.lanes.start);
        let axis = |at: usize| -> Vec<f64> {
            (0..own.len()).map(|lane| f64::from(u8::from(lane == at))).collect()
        };
        // Tries the axes in the order Z, X, Y, like the edges of a unit vector.
        let axes = (0..own.len()).map(|at| axis((at + own.len() - 1) % own.len()));
        for start in std::iter::once(own.clone()).chain(axes) {
            // The second call removes the rounding errors of the first call.
            let rest = without(&without(&start, &others), &others);
            let length = dot(&rest, &rest).sqrt();
            if length > SHORT {
                for (word, x) in row[self.lanes.clone()].iter_mut().zip(rest) {
                    #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
                    let single = (x / length) as f32;
                    *word = single.to_bits();
                }
                return true;
            }
        }
        false
    }

    /// Checks if the vector is perpendicular to the others, up to rounding.
    pub(super) fn holds(&self, row: &[u32]) -> bool {
        let own = self.vector(row, self.lanes.start);
        self.to.iter().all(|first| {
            let other = self.vector(row, *first);
            let length = dot(&other, &other).sqrt();
            dot(&own, &other).abs() <= (2.0 * direction::LENGTH + PARALLEL) * length
        })
    }

    pub(super) fn weight(&self, row: &[u32]) -> u64 {
        let lanes = row[self.lanes.clone()].iter();
        lanes.map(|word| shrink::float_complexity(f32::from_bits(*word))).sum()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Removes from a vector its components along the other vectors, which are orthogonal.
fn without(vector: &[f64], others: &[Vec<f64>]) -> Vec<f64> {
    let mut rest = vector.to_vec();
    for other in others {
        let along = dot(&rest, other);
        rest.iter_mut().zip(other).for_each(|(x, o)| *x -= along * o);
    }
    rest
}

#[cfg(test)]
mod tests {
    use super::super::{Dynamic, Numbering, Part, Stream};
    use crate::value::{Scalar, Shape};

    fn unit(size: u8) -> Vec<Part> {
        vec![Part::named("unit_vector", size).expect("known")]
    }

    fn vectors(names: &[&str], size: u8) -> Vec<(String, Shape)> {
        let shape = Shape::Vector { size, scalar: Scalar::F32 };
        names.iter().map(|name| ((*name).to_owned(), shape.clone())).collect()
    }

    fn rows(domain: &Dynamic, count: u64) -> Vec<Vec<u32>> {
        let numbering = Numbering::of(domain, 3, count, 1 << 20);
        let mut words = Vec::new();
        domain.rows(&numbering, 0..count, &mut words);
        words.chunks(domain.width()).map(<[u32]>::to_vec).collect()
    }

    #[test]
    fn frames_are_drawn_and_simplified_as_frames() {
        let domain = Dynamic::new(&vectors(&["n", "t", "b"], 3), vec![unit(3), unit(3), unit(3)])
            .perpendicular(3..6, vec![0], "n")
            .perpendicular(6..9, vec![0, 3], "n, t");
        let all = rows(&domain, 2000);
        assert_eq!(all.len(), 2000);
        for row in all.iter().chain(&domain.shrink(&all[1999])) {
            let at = |first: usize| {
                glam::Vec3::from_array([0, 1, 2].map(|lane| f32::from_bits(row[first + lane])))
            };
            let (n, t, b) = (at(0).as_dvec3(), at(3).as_dvec3(), at(6).as_dvec3());
            for cosine in [n.dot(t), n.dot(b), t.dot(b)] {
                assert!(cosine.abs() < 3e-7, "{n} {t} {b}: {cosine}");
            }
            assert_eq!(domain.admits(row), Some(true), "{n} {t} {b}");
        }
        let mut row = all[1999].clone();
        for step in 0.. {
            let simpler = domain.shrink(&row);
            let Some(next) = simpler.get(simpler.len() / 2) else { break };
            row.clone_from(next);
            assert!(step < 1000, "it ends");
        }
    }

    #[test]
    fn nothing_is_perpendicular_to_two_vectors_of_a_plane() {
        let domain = Dynamic::new(&vectors(&["a", "b", "c"], 2), vec![unit(2), unit(2), unit(2)])
            .perpendicular(4..6, vec![0, 2], "a, b");
        // A third vector can be perpendicular to `a` and `b` only if `a` and `b` are parallel. Some edges are parallel.
        assert!(domain.edges() < 50, "{}", domain.edges());
        let near = |row: &Vec<u32>| {
            let [ax, ay, bx, by] = [0, 1, 2, 3].map(|lane| f32::from_bits(row[lane]));
            (ax * by - ay * bx).abs() < 1e-5
        };
        assert!(rows(&domain, 50).iter().all(near));
    }

    #[test]
    fn a_filter_keeps_only_rows_that_satisfy_its_condition() {
        let float = |name: &str| (name.to_owned(), Shape::Scalar(Scalar::F32));
        let part = || vec![Part::range(Scalar::F32, 0.0..=1.0).expect("floats")];
        let ordered = |row: &[u32]| f32::from_bits(row[0]) <= f32::from_bits(row[1]);
        let pairs = || Dynamic::new(&[float("a"), float("b")], vec![part(), part()]);
        let domain = pairs().filtered("a <= b", ordered);
        let all = rows(&domain, 500);
        assert!(all.len() == 500 && all.iter().all(|row| ordered(row)));
        assert!(domain.shrink(&all[499]).iter().all(|row| ordered(row)));
        let swapped = [1.0_f32, 0.0].map(f32::to_bits);
        assert_eq!(domain.admits(&swapped), Some(false));
        assert!(rows(&pairs().filtered("false", |_| false), 5).is_empty());
    }
}
