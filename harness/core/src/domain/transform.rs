//! Unconstrained matrices that transform points.

use glam::{DMat4, DQuat, DVec3};

use super::words::Words;
use super::{Domain, Emptiness, Source, UnitVector};

/// The largest `abs(log2(scale))`: scales are from 1/4 to 4.
const SCALES: f64 = 2.0;

/// The sine and the cosine of 45 degrees. A quaternion with these components rotates by 90 degrees.
const HALF: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// The largest distance by which a matrix translates points along each axis.
const DISTANCE: f64 = 8.0;

/// Matrices like those that hosts pass to shaders: they rotate, scale, translate and mirror, and have an inverse.
pub(super) struct Transform {
    columns: usize,
    rows: usize,
    perspective: bool,
}

impl Transform {
    /// Makes a `Transform` for matrices of this size. `None` if such matrices don't transform points. Only square
    /// matrices, and matrices of 3 by 4 or 4 by 3, transform points. If `perspective` is `true`, the edges of a domain
    /// of 4 by 4 matrices include a perspective projection.
    pub(super) fn of(columns: u8, rows: u8, perspective: bool) -> Option<Self> {
        let (columns, rows) = (usize::from(columns), usize::from(rows));
        // A matrix of three columns and four rows is the transpose of a matrix of four columns and three rows.
        let is_known = columns == rows || matches!((columns, rows), (4, 3) | (3, 4));
        is_known.then_some(Self { columns, rows, perspective })
    }

    /// The matrix `whole` as words, cut to the transform's columns and rows.
    fn words(&self, whole: DMat4) -> Vec<u32> {
        let whole = if (self.columns, self.rows) == (3, 4) { whole.transpose() } else { whole };
        let column = |at: usize| {
            let lanes = whole.col(at).to_array();
            #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
            let words = lanes.map(|x| (x as f32).to_bits());
            words.into_iter().take(self.rows).collect::<Vec<_>>()
        };
        (0..self.columns).flat_map(column).collect()
    }
}

impl Words for Transform {
    fn width(&self) -> usize {
        self.columns * self.rows
    }

    fn draw(&self, source: &mut Source) -> Option<Vec<u32>> {
        let axis = UnitVector.draw(source)?.as_dvec3();
        // A matrix of two rows has only the first two axes, so it must rotate within their plane.
        let axis = if self.rows == 2 { DVec3::Z } else { axis };
        let turn = DQuat::from_axis_angle(axis, std::f64::consts::TAU * source.unit());
        let mut within = |most: f64| most * (2.0 * source.unit() - 1.0);
        let mut scale = DVec3::from_array([0; 3].map(|_| within(SCALES).exp2()));
        // One in four matrices mirrors.
        if within(1.0) > 0.5 {
            scale.x = -scale.x;
        }
        let place = DVec3::from_array([0; 3].map(|_| within(DISTANCE)));
        Some(self.words(DMat4::from_scale_rotation_translation(scale, turn, place)))
    }

    fn edges(&self) -> Vec<Vec<u32>> {
        let mut all = vec![
            DMat4::IDENTITY,
            DMat4::from_scale(DVec3::new(2.0, 0.5, 1.0)),
            DMat4::from_scale(DVec3::new(-1.0, 1.0, 1.0)),
            DMat4::from_translation(DVec3::new(1.0, -2.0, 4.0)),
            // Some elements of this matrix's diagonal are 0.
            DMat4::from_quat(DQuat::from_xyzw(0.0, 0.0, HALF, HALF)),
        ];
        if self.rows > 2 {
            all.push(DMat4::from_quat(DQuat::from_xyzw(HALF, 0.0, 0.0, HALF)));
        }
        if (self.columns, self.rows, self.perspective) == (4, 4, true) {
            // The projection comes early, so that it is combined with each of the first edges of a point. Its field of
            // view is a quarter turn. Its near plane is at the distance 0.1 and has the depth 1. Its far plane is
            // infinitely far away.
            const NEAR: f64 = 0.1;
            all.insert(
                1,
                DMat4::from_cols_array_2d(&[
                    [1.0, 0.0, 0.0, 0.0],
                    [0.0, 1.0, 0.0, 0.0],
                    [0.0, 0.0, 0.0, -1.0],
                    [0.0, 0.0, NEAR, 0.0],
                ]),
            );
        }
        all.into_iter().map(|whole| self.words(whole)).collect()
    }

    fn emptiness(&self) -> Option<Emptiness> {
        None
    }

    fn size(&self) -> Option<u64> {
        None
    }

    fn nth(&self, _: u64) -> Option<Vec<u32>> {
        None
    }

    fn admits(&self, _: &[u32]) -> Option<bool> {
        None
    }

    fn shrink(&self, words: &[u32]) -> Vec<Vec<u32>> {
        let mut simpler = self.edges();
        let own = simpler.iter().position(|edge| edge == words);
        simpler.truncate(own.unwrap_or(simpler.len()));
        simpler
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_transform_has_an_inverse() {
        for (columns, rows) in [(2, 2), (3, 3), (4, 4), (4, 3), (3, 4)] {
            let transform = Transform::of(columns, rows, true).expect("it moves points");
            let mut all = transform.edges();
            all.extend((0..500).filter_map(|index| transform.draw(&mut Source::new(5, index))));
            assert!(all.len() >= 504);
            for words in &all {
                let x: Vec<f64> =
                    words.iter().map(|word| f64::from(f32::from_bits(*word))).collect();
                let at = |column: usize, row: usize| x[column * usize::from(rows) + row];
                let determinant = match (columns, rows) {
                    (2, 2) => at(0, 0) * at(1, 1) - at(0, 1) * at(1, 0),
                    (3, 4) | (4, 3) | (3, 3) => glam::DMat3::from_cols_array_2d(
                        &[0, 1, 2].map(|c| [0, 1, 2].map(|r| at(c, r))),
                    )
                    .determinant(),
                    _ => DMat4::from_cols_array_2d(
                        &[0, 1, 2, 3].map(|c| [0, 1, 2, 3].map(|r| at(c, r))),
                    )
                    .determinant(),
                };
                assert!(determinant.abs() > 1e-2, "{columns}x{rows}: {x:?}");
            }
            assert_eq!(transform.shrink(&all[1]), vec![all[0].clone()]);
            assert!(transform.shrink(&all[0]).is_empty());
        }
        assert!(Transform::of(2, 3, false).is_none() && Transform::of(2, 4, false).is_none());
        let edges = |perspective| Transform::of(4, 4, perspective).map(|own| own.edges().len());
        assert_eq!((edges(false), edges(true)), (Some(6), Some(7)));
    }
}
