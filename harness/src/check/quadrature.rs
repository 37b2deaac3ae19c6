//! Integrals over directions, for functions whose last argument is a direction.
//!
//! The quadrature rule is a product: Gauss-Legendre in the cosine of the polar angle, and equal steps in the
//! azimuth. The rule is accurate for smooth functions, but misses lobes that are narrower than its rings. So
//! Karat computes each integral with two rules that have different numbers of rings. If both integrals are
//! clearly wrong, the check fails. Otherwise, if the two integrals differ by more than the tolerance, there is no
//! verdict. If a lobe lies between the rings of both rules, both rules miss the lobe. For narrow lobes, use a rule
//! with nodes in the lobe.

use std::f64::consts::TAU;

use glam::{DVec3, Vec3};

use super::integral::{Assertion, Integrals, Nodes};
use super::{Agreement, Calls, Check, Failure};
use crate::domain::Held;
use crate::run::or_panic;
use crate::stats::gauss_legendre;
use crate::tolerance::Tolerance;
use crate::value::{Arguments, Mirror, Shape, Shareable};

/// The default number of rings. Each ring has twice as many directions as there are rings.
const RINGS: u16 = 64;

/// The directions over which Karat integrates, such as the hemisphere around +Z, and the measure: solid angle or
/// projected solid angle.
///
/// ```
/// use std::f64::consts::TAU;
///
/// use karat::prelude::*;
///
/// let package = Package::from_source("m", "fn f(l: vec3f) -> f32 { return 1.0; }");
/// package.function("f").over(()).integrates_to(Directions::hemisphere(), |()| TAU, Rel(1e-6));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub struct Directions {
    region: Region,
    rings: u16,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Region {
    Sphere,
    Hemisphere,
    Projected,
}

impl Directions {
    /// The whole sphere, measured by solid angle. The integral of 1 is 4 pi.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::from_source("m", "fn one(l: vec3f) -> f32 { return 1.0; }");
    /// let area = 4.0 * std::f64::consts::PI;
    /// package.function("one").over(()).integrates_to(Directions::sphere(), |()| area, Rel(1e-6));
    /// ```
    pub fn sphere() -> Self {
        Self { region: Region::Sphere, rings: RINGS }
    }

    /// The hemisphere z > 0, measured by solid angle. The integral of 1 is 2 pi.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::from_source("m", "fn one(l: vec3f) -> f32 { return 1.0; }");
    /// let area = 2.0 * std::f64::consts::PI;
    /// package.function("one").over(()).integrates_to(Directions::hemisphere(), |()| area, Rel(1e-6));
    /// ```
    pub fn hemisphere() -> Self {
        Self { region: Region::Hemisphere, rings: RINGS }
    }

    /// The hemisphere z > 0, measured by projected solid angle, which includes the cosine. The integral of 1 is pi.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// // The albedo of a BRDF that is 1 / pi everywhere. The measure includes the cosine.
    /// let brdf = Package::from_source("brdf", "fn white(l: vec3f) -> f32 { return 0.318309886; }");
    /// let light = Directions::projected_hemisphere();
    /// brdf.function("white").over(()).integrates_to(light, |()| 1.0, Rel(1e-6));
    /// ```
    pub fn projected_hemisphere() -> Self {
        Self { region: Region::Projected, rings: RINGS }
    }

    /// Sets the number of rings: at least 4, by default 64. Each ring has twice as many directions as there are
    /// rings.
    ///
    /// ```
    /// use karat::Directions;
    ///
    /// let fine = Directions::hemisphere().rings(256); // for a narrow lobe
    /// # let _ = fine;
    /// ```
    pub fn rings(self, rings: u16) -> Self {
        Self { rings: rings.max(4), ..self }
    }

    /// The second rule, which has three quarters of the rings. The integrals of both rules must agree.
    fn control(self) -> Self {
        Self { rings: self.rings - self.rings / 4, ..self }
    }

    fn rule(self) -> Vec<(Vec3, f64)> {
        let azimuths = 2 * self.rings;
        let mut rule = Vec::with_capacity(usize::from(self.rings) * usize::from(azimuths));
        for (node, weight) in gauss_legendre(self.rings.into()) {
            let (cosine, weight) = match self.region {
                Region::Sphere => (2.0 * node - 1.0, 2.0 * weight),
                Region::Hemisphere => (node, weight),
                Region::Projected => (node, weight * node),
            };
            let sine = ((1.0 - cosine) * (1.0 + cosine)).sqrt();
            for azimuth in 0..azimuths {
                // The directions are half a step away from the axes, because functions may branch on the axes.
                let azimuth = TAU * (f64::from(azimuth) + 0.5) / f64::from(azimuths);
                let l = DVec3::new(sine * azimuth.cos(), sine * azimuth.sin(), cosine);
                rule.push((l.as_vec3(), TAU * weight / f64::from(azimuths)));
            }
        }
        rule
    }
}

impl<V: Arguments> Check<'_, Calls<V>> {
    /// Checks the integral of a function over directions. The direction is the function's last argument. The
    /// domain supplies the other arguments. Use `()` as the domain if the function has no other arguments. The
    /// default is 256 cases.
    ///
    /// Karat computes each integral with two rules that have different numbers of rings. If both integrals are clearly
    /// wrong, the check fails. Otherwise, if the integrals differ by more than the tolerance, the check ends with an
    /// error instead of a verdict: the function has a lobe that is narrower than the rings.
    ///
    /// If a lobe lies between the rings of both rules, both rules miss the lobe, and the check ignores it. (The
    /// innermost of 64 rings is 1.5 degrees from the pole.) For such lobes, and if there is no verdict, set more
    /// [`rings`](Directions::rings), or use your own rule with [`integral`](super::Probe::integral).
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// // fn lambert_pdf(l: vec3f) -> f32
    /// SHADERS.function("brdf::lambert_pdf").over(()).integrates_to(
    ///     Directions::hemisphere(),
    ///     |()| 1.0,
    ///     Rel(1e-6),
    /// );
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if an integral differs from the expected integral, if the two rules disagree, if
    /// the result at a node isn't finite, or if nothing could be compared.
    #[track_caller]
    pub fn integrates_to<E: Mirror>(
        self,
        directions: Directions,
        expected: impl Fn(&V) -> E + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Agreement {
        or_panic(self.try_integrates_to(directions, expected, tolerance))
    }

    /// Runs [`integrates_to`](Self::integrates_to), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if an integral differs from the expected integral, if the two rules disagree, if the result
    /// at a node isn't finite, or if nothing could be compared.
    pub fn try_integrates_to<E: Mirror>(
        self,
        directions: Directions,
        expected: impl Fn(&V) -> E + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let assertion = Assertion::AgreesWith(self.plan.tolerances(tolerance.into()));
        self.integrate(directions, expected, assertion)
    }

    /// Checks that the integral over directions is at most a bound plus `slack`. The slack is an absolute
    /// error. The slack must be at least as large as the rounding error and the difference between the two rules.
    /// `bound` returns one number for all components, or one number for each component. For lobes that are narrower
    /// than the rings, see [`integrates_to`](Self::integrates_to).
    ///
    /// ```
    /// # use karat::prelude::*;
    /// // A BRDF reflects at most all incoming light.
    /// let brdf = Package::from_source(
    ///     "brdf",
    ///     "fn eval(albedo: f32, l: vec3f) -> f32 { return albedo / 3.14159265; }",
    /// );
    /// let light = Directions::projected_hemisphere();
    /// brdf.function("eval").over(0.0..=1.0).integrates_to_at_most(light, |_| 1.0, 1e-5);
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if an integral exceeds its bound, the rules disagree, the result at a node isn't
    /// finite, or nothing could be compared.
    #[track_caller]
    pub fn integrates_to_at_most<E: Mirror>(
        self,
        directions: Directions,
        bound: impl Fn(&V) -> E + Sync,
        slack: f64,
    ) -> Agreement {
        or_panic(self.try_integrates_to_at_most(directions, bound, slack))
    }

    /// Runs [`integrates_to_at_most`](Self::integrates_to_at_most), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if an integral exceeds its bound, the rules disagree, the result at a node isn't finite, or
    /// nothing could be compared.
    pub fn try_integrates_to_at_most<E: Mirror>(
        self,
        directions: Directions,
        bound: impl Fn(&V) -> E + Sync,
        slack: f64,
    ) -> Result<Agreement, Failure> {
        self.integrate(directions, bound, Assertion::IsAtMost(slack))
    }

    fn integrate<E: Mirror>(
        self,
        directions: Directions,
        expected: impl Fn(&V) -> E + Sync,
        assertion: Assertion,
    ) -> Result<Agreement, Failure> {
        let expected = |case: &Held, lanes: &mut Vec<f64>| expected(case.get()).lanes(lanes);
        self.integrate_over(directions, E::shape(), &expected, assertion)
    }
}

impl<V> Check<'_, Calls<V>> {
    /// Checks integrals over directions. The direction is the last argument, after the arguments of a case.
    /// `shape` is the type of the expected value.
    pub(super) fn integrate_over(
        &self,
        directions: Directions,
        shape: Shape,
        expected: &(dyn Fn(&Held, &mut Vec<f64>) + Sync),
        assertion: Assertion,
    ) -> Result<Agreement, Failure> {
        let (own, control) = (directions.rule(), directions.control().rule());
        let integrals = Integrals {
            arguments: self.of.shapes.iter().cloned().chain([Vec3::shape()]).collect(),
            rule: &|case, nodes| add(&own, case, nodes),
            control: Some(&|case, nodes| add(&control, case, nodes)),
            expected,
            shape,
            assertion,
        };
        self.plan.integrates(&*self.stream, &integrals)
    }
}

/// Appends a node for each direction of a rule: the arguments of a case, followed by the direction.
fn add(rule: &[(Vec3, f64)], case: &Held, nodes: &mut Nodes) {
    nodes.rows.reserve(rule.len() * (case.row.len() + 3));
    for (l, weight) in rule {
        nodes.rows.extend_from_slice(&case.row);
        l.store(&mut nodes.rows);
        nodes.weights.push(*weight);
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn directions_have_their_measure_and_lie_on_their_side() {
        let whole = |directions: Directions| -> f64 { directions.rule().iter().map(|n| n.1).sum() };
        for rings in [1, 4, 5, 64] {
            let directions = Directions::sphere().rings(rings);
            assert!((whole(directions) - 4.0 * PI).abs() < 1e-12);
            assert!((whole(directions.control()) - 4.0 * PI).abs() < 1e-12);
            assert_ne!(directions, directions.control());
            assert!((whole(Directions::hemisphere().rings(rings)) - TAU).abs() < 1e-12);
            assert!((whole(Directions::projected_hemisphere().rings(rings)) - PI).abs() < 1e-12);
        }
        assert!(Directions::hemisphere().rule().iter().all(|(l, _)| l.z > 0.0));
        let linear: DVec3 = Directions::sphere()
            .rule()
            .iter()
            .map(|(l, weight)| *weight * l.as_dvec3() * f64::from(l.z))
            .sum();
        assert!(linear.distance(DVec3::new(0.0, 0.0, 4.0 * PI / 3.0)) < 1e-6, "{linear}");
    }
}
