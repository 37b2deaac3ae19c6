//! Vectors of one length, or of at most this length, with two, three or four components.

use std::f64::consts::TAU;
use std::marker::PhantomData;

use glam::{Vec2, Vec3, Vec4};

use super::{Domain, Emptiness, Source, direction, shrink};

/// Vectors of one length, or of at most this length: see [`filled`](Self::filled). Their distribution is uniform over
/// the circle, the sphere, or the unit quaternions, except that axes and their close neighbours occur more often.
///
/// ```
/// use glam::{Vec2, Vec4};
/// use karat::Domain;
/// use karat::domain::Sphere;
///
/// let quaternions = Sphere::<Vec4>::unit();
/// assert_eq!(quaternions.admits(&Vec4::ONE), Some(false));
/// let offsets = Sphere::<Vec2>::of_radius(3.0).filled();
/// assert_eq!(offsets.admits(&Vec2::new(1.0, -2.0)), Some(true));
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Sphere<V> {
    radius: f32,
    filled: bool,
    of: PhantomData<fn() -> V>,
}

impl<V> Sphere<V> {
    /// Vectors of length 1. With three components, this domain is equal to [`UnitVector`](super::UnitVector).
    ///
    /// ```
    /// use karat::Domain;
    /// use karat::domain::Sphere;
    ///
    /// assert_eq!(Sphere::<glam::Vec2>::unit().edges().len(), 4); // the axes
    /// ```
    #[must_use]
    pub fn unit() -> Self {
        Self::of_radius(1.0)
    }

    /// Vectors of the length `radius`. If `radius` is negative or not finite, the check fails with an error.
    ///
    /// ```
    /// use karat::Domain;
    /// use karat::domain::Sphere;
    ///
    /// let far = Sphere::<glam::Vec3>::of_radius(100.0);
    /// assert_eq!(far.admits(&glam::Vec3::new(0.0, 60.0, 80.0)), Some(true));
    /// assert!(Sphere::<glam::Vec3>::of_radius(-1.0).emptiness().is_some());
    /// ```
    #[must_use]
    pub fn of_radius(radius: f32) -> Self {
        Self { radius, filled: false, of: PhantomData }
    }

    /// Includes shorter vectors. The domain is then a disk or a ball, in which 0 and the rim occur more often.
    ///
    /// ```
    /// use karat::Domain;
    /// use karat::domain::Sphere;
    ///
    /// let disk = Sphere::<glam::Vec2>::unit().filled();
    /// assert_eq!(disk.admits(&glam::Vec2::ZERO), Some(true));
    /// ```
    #[must_use]
    pub fn filled(self) -> Self {
        Self { filled: true, ..self }
    }

    fn fault(&self) -> Option<Emptiness> {
        let is_length = self.radius.is_finite() && self.radius >= 0.0;
        (!is_length).then(|| {
            Emptiness::of(
                "sphere",
                &format!(
                    "has the radius {}, which isn't a finite number of at least 0",
                    self.radius
                ),
            )
        })
    }

    fn scaled(&self, direction: &[f64], height: f64) -> Vec<f32> {
        let length = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
        let scale = f64::from(self.radius) * height / length;
        #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
        let mut lanes: Vec<f32> = direction.iter().map(|x| (x * scale) as f32).collect();
        // Rounding moves some vectors outside of the ball, so they are sampled again.
        while self.filled && length_of(&lanes) > f64::from(self.radius) {
            let shorter = |lane: f32| lane.abs().next_down().max(0.0).copysign(lane);
            lanes.iter_mut().for_each(|lane| *lane = shorter(*lane));
        }
        lanes
    }

    fn drawn(&self, size: usize, source: &mut Source) -> Option<Vec<f32>> {
        if self.fault().is_some() {
            return None;
        }
        let choice = source.bits() as usize;
        // Normally distributed components give a uniform direction in any dimension. The components are never all 0.
        let mut all: Vec<f64> = (0..size).map(|_| normal(source)).collect();
        let axis = (choice >> 5) % size;
        if choice & 15 < 3 {
            let length = all.iter().map(|x| x * x).sum::<f64>().sqrt();
            let off = if choice & 15 == 0 { 0.0 } else { source.log_distance() / length };
            all.iter_mut().for_each(|x| *x *= off);
            all[axis] = if choice & 16 == 0 { 1.0 } else { -1.0 };
        }
        let height = match (choice >> 8) & 7 {
            _ if !self.filled => 1.0,
            0 => 0.0,
            1 => 1.0,
            2 => source.log_distance(),
            // With this length, the vectors are uniform over the volume of the disk or ball.
            #[expect(clippy::cast_precision_loss, reason = "at most four components")]
            _ => source.unit().powf(1.0 / size as f64),
        };
        Some(self.scaled(&all, height))
    }

    fn all_edges(&self, size: usize) -> Vec<Vec<f32>> {
        if self.fault().is_some() {
            return Vec::new();
        }
        let axes = (0..2 * size).map(|at| {
            let mut lanes = vec![0.0; size];
            // The last axis comes first, as in `UnitVector`.
            lanes[(at + size - 1) % size] = if at < size { self.radius } else { -self.radius };
            lanes
        });
        let zero = self.filled.then(|| vec![0.0; size]);
        zero.into_iter().chain(axes).collect()
    }

    fn holds(&self, lanes: &[f32]) -> bool {
        let (length, radius) = (length_of(lanes), f64::from(self.radius));
        match self.filled {
            true => length <= radius,
            false => (length - radius).abs() <= direction::LENGTH * radius,
        }
    }

    fn simpler(&self, lanes: &[f32]) -> Vec<Vec<f32>> {
        let size = lanes.len();
        let mut found = self.all_edges(size);
        let flat: Vec<f64> = lanes.iter().map(|lane| f64::from(*lane)).collect();
        for axis in 0..size {
            // Vectors in a coordinate plane, with two short decimals as components.
            let other = (axis + 1) % size;
            for (a, b) in [(0.6, 0.8), (-0.6, 0.8), (0.6, -0.8), (-0.6, -0.8), (0.8, 0.6)] {
                let mut plane = vec![0.0; size];
                (plane[axis], plane[other]) = (a, b);
                found.push(self.scaled(&plane, 1.0));
            }
            let mut without = flat.clone();
            without[axis] = 0.0;
            if without.iter().any(|x| *x != 0.0) {
                found.push(self.scaled(&without, 1.0));
            }
            if self.filled {
                for short in shrink::floats(lanes[axis], &[], |_| true) {
                    let mut own = lanes.to_vec();
                    own[axis] = short;
                    found.push(own);
                }
            }
        }
        let weight = |lanes: &Vec<f32>| lanes.iter().map(|x| shrink::float_complexity(*x)).sum();
        let own: u64 = weight(&lanes.to_vec());
        found.retain(|candidate| self.holds(candidate) && weight(candidate) < own);
        found.sort_by_cached_key(weight);
        found.dedup();
        found
    }
}

fn length_of(lanes: &[f32]) -> f64 {
    lanes.iter().map(|lane| f64::from(*lane).powi(2)).sum::<f64>().sqrt()
}

fn normal(source: &mut Source) -> f64 {
    let radius = (-2.0 * (1.0 - source.unit()).max(f64::MIN_POSITIVE).ln()).sqrt();
    radius.max(f64::MIN_POSITIVE) * (TAU * source.unit()).cos()
}

macro_rules! of_vectors {
    ($($vector:ident)*) => {$(
        impl Domain for Sphere<$vector> {
            type Value = $vector;

            fn draw(&self, source: &mut Source) -> Option<$vector> {
                self.drawn($vector::ZERO.to_array().len(), source).map(|x| $vector::from_slice(&x))
            }

            fn edges(&self) -> Vec<$vector> {
                let all = self.all_edges($vector::ZERO.to_array().len());
                all.iter().map(|lanes| $vector::from_slice(lanes)).collect()
            }

            fn emptiness(&self) -> Option<Emptiness> {
                self.fault()
            }

            fn admits(&self, value: &$vector) -> Option<bool> {
                Some(self.holds(&value.to_array()))
            }

            /// Bounds slightly outside of the sphere, because rounding can make a vector longer than the radius.
            fn ends(&self) -> Option<($vector, $vector)> {
                #[expect(clippy::cast_possible_truncation, reason = "far from its ends")]
                let most = $vector::splat(self.radius * (1.0 + direction::LENGTH as f32));
                Some((-most, most))
            }

            fn shrink(&self, value: &$vector) -> Vec<$vector> {
                self.simpler(&value.to_array()).iter().map(|x| $vector::from_slice(x)).collect()
            }
        }
    )*};
}

of_vectors!(Vec2 Vec3 Vec4);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_of_a_sphere_have_its_radius_and_all_directions() {
        let draw = |domain: &Sphere<Vec4>, index| domain.draw(&mut Source::new(9, index));
        let (shell, ball) =
            (Sphere::<Vec4>::of_radius(2.0), Sphere::<Vec4>::of_radius(2.0).filled());
        let mut mean = glam::DVec4::ZERO;
        let mut shorter = 0;
        for index in 0..20_000 {
            let at = draw(&shell, index).expect("each draw is one");
            assert!((at.as_dvec4().length() - 2.0).abs() < 1e-6, "{at}");
            assert_eq!(shell.admits(&at), Some(true), "{at}");
            mean += at.as_dvec4() / 20_000.0;
            let inside = draw(&ball, index).expect("each draw is one");
            assert_eq!(ball.admits(&inside), Some(true), "{inside}");
            shorter += i32::from(inside.length() < 1.9 && inside.length() > 0.1);
        }
        // The mean of a component has a standard deviation of 2 / sqrt(4 * 20,000).
        assert!(mean.abs().max_element() < 5.0 * 0.007, "{mean}");
        assert!(shorter > 5_000, "{shorter}");
    }

    #[test]
    fn shrinking_a_point_of_a_sphere_ends_within_the_domain() {
        for domain in [Sphere::<Vec2>::unit(), Sphere::<Vec2>::of_radius(3.5).filled()] {
            let mut at = domain.draw(&mut Source::new(1, 77)).expect("a draw");
            let mut steps = 0;
            while let Some(next) = domain.shrink(&at).last() {
                assert_eq!(domain.admits(next), Some(true));
                (at, steps) = (*next, steps + 1);
                assert!(steps < 10_000, "it ends");
            }
            assert!(domain.edges().contains(&at), "{at}");
        }
    }

    #[test]
    fn an_invalid_radius_is_an_error() {
        for radius in [-1.0, f32::NAN, f32::INFINITY] {
            let domain = Sphere::<Vec3>::of_radius(radius);
            let emptiness = Domain::emptiness(&domain).expect("no vector has that length");
            assert_eq!(
                emptiness.fault,
                format!("has the radius {radius}, which isn't a finite number of at least 0")
            );
            assert!(domain.draw(&mut Source::new(1, 0)).is_none() && domain.edges().is_empty());
        }
        assert_eq!(Sphere::<Vec3>::of_radius(0.0).draw(&mut Source::new(1, 0)), Some(Vec3::ZERO));
    }
}
