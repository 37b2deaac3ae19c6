//! Integrals of a function by quadrature. The host computes the quadrature rule, and the shader computes the
//! integrand.
//!
//! A dispatch evaluates the nodes of several cases. If a rule has more nodes than fit into one dispatch, Karat
//! runs several dispatches. The host sums `weight * value` in `f64` with Neumaier's compensation, in the order
//! of the rule. So the sum's rounding error doesn't grow with the number of nodes, and the number of dispatches
//! doesn't change the sum. A case fails if the result at one of its nodes isn't finite.

mod assertion;
mod group;
mod sum;

use std::cell::Cell;
use std::marker::PhantomData;
use std::ops::Range;

use super::demand::Demand;
use super::disagreement::Simplest;
use super::effort::Effort;
use super::path_tally::PathTally;
use super::plan::Plan;
use super::session::{Asserted, Session};
use super::shrink::JudgeValues;
use super::{Agreement, Check, Failure, Probe, Vacuous};
use crate::domain::{Domain, Held, Stream, Typed};
use crate::probe::BATCH;
use crate::run::{Descent, or_panic};
use crate::tolerance::Tolerance;
use crate::value::{Arguments, Mirror, Shape};
pub(super) use assertion::Assertion;
use group::Group;

/// The default number of integrals. The number is small, because each integral takes thousands of calls.
const CASES: u64 = 256;

/// If a finite domain has at most this many values, Karat by default computes an integral for every value.
const ENUMERATED: u64 = 65_536;

impl<'a> Probe<'a> {
    /// Integrates the function by quadrature, once for each case from the domain `cases`.
    ///
    /// `rule` returns the nodes of a quadrature rule for a case. Each node is a pair of arguments and a weight. The
    /// arguments are a tuple, or a single value if the function has one parameter. Include cosines and Jacobians in the
    /// weight. For each component of the result, Karat sums `weight * result` over all nodes in `f64`. The result's
    /// components must be floats. Karat doesn't know the rule's quadrature error, so choose a tolerance that is larger
    /// than this error.
    ///
    /// ```no_run
    /// use std::f64::consts::{PI, TAU};
    ///
    /// use glam::{DVec3, Vec3};
    /// use karat::prelude::*;
    ///
    /// # static SHADERS: Package = karat::package!("shaders");
    /// // Midpoints of the squared sine and of the azimuth. This measure includes the cosine.
    /// let nodes = |size: u16| {
    ///     let at = move |index: u16| (f64::from(index) + 0.5) / f64::from(size);
    ///     (0..size * size).map(move |node| {
    ///         let (sine_squared, phi) = (at(node / size), TAU * at(node % size));
    ///         let (sine, cosine) = (sine_squared.sqrt(), (1.0 - sine_squared).sqrt());
    ///         let l = DVec3::new(sine * phi.cos(), sine * phi.sin(), cosine);
    ///         (l.as_vec3(), PI / f64::from(size * size))
    ///     })
    /// };
    /// // fn lambert_eval(albedo: vec3f, v: vec3f, l: vec3f) -> vec3f
    /// SHADERS
    ///     .function("brdf::lambert_eval")
    ///     .integral((UnitRgb, Hemisphere), |&(albedo, v): &(Vec3, Vec3)| {
    ///         nodes(32).map(|(l, weight)| ((albedo, v, l), weight)).collect()
    ///     })
    ///     .agrees_with(|(albedo, _)| albedo.as_dvec3(), Rel(1e-6));
    /// ```
    pub fn integral<D, A, Q>(self, cases: D, rule: Q) -> Check<'a, Integral<D::Value, Q>>
    where
        D: Domain + 'a,
        A: Arguments,
        Q: Fn(&D::Value) -> Vec<(A, f64)> + Sync,
    {
        Check::new(self, Typed::values(cases), Integral { rule, cases: PhantomData })
    }
}

/// A marker for a [`Check`] that integrates a function (see [`Probe::integral`]). `V` is the type of the cases.
/// Each case has a quadrature rule.
///
/// ```no_run
/// use glam::{DVec3, Vec3};
/// # use karat::prelude::*;
/// # static SHADERS: Package = karat::package!("shaders");
///
/// // A rule may have one node. Here the node is a point light.
/// let sun = |_: &f32| vec![((Vec3::Z,), 1.0)];
/// SHADERS
///     .function("sky::radiance") // fn radiance(l: vec3f) -> vec3f
///     .integral(0.0..=1.0, sun)
///     .cases(64)
///     .agrees_with(|_: &f32| DVec3::ONE, Rel(1e-6));
/// ```
#[derive(Clone, Debug)]
pub struct Integral<V, Q> {
    rule: Q,
    cases: PhantomData<fn(V)>,
}

/// The nodes of a quadrature rule: their rows of arguments, and their weights.
#[derive(Clone, Debug, Default)]
pub(super) struct Nodes {
    pub(super) rows: Vec<u32>,
    pub(super) weights: Vec<f64>,
}

pub(super) type Rule<'r> = &'r (dyn Fn(&Held, &mut Nodes) + Sync);

pub(super) struct Integrals<'i> {
    pub(super) arguments: Vec<Shape>,
    pub(super) rule: Rule<'i>,
    /// A second rule with another number of nodes. If the two rules give different integrals, Karat can't trust either
    /// integral.
    pub(super) control: Option<Rule<'i>>,
    /// A function that takes a case, and appends the components of the expected integral or of the bound to a vector.
    pub(super) expected: &'i (dyn Fn(&Held, &mut Vec<f64>) + Sync),
    pub(super) shape: Shape,
    pub(super) assertion: Assertion,
}

impl<V, A, Q> Check<'_, Integral<V, Q>>
where
    V: 'static,
    A: Arguments,
    Q: Fn(&V) -> Vec<(A, f64)> + Sync,
{
    /// Checks that each component of each integral agrees with the expected integral to within a tolerance.
    /// Karat compares the sums in `f64`, without rounding to `f32`.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// // The integral of x from 0 to b, by the midpoint rule.
    /// let midpoint = |&b: &f32| vec![(0.5 * b, f64::from(b))];
    /// let package = Package::from_source("m", "fn f(x: f32) -> f32 { return x; }");
    /// let half = |&b: &f32| 0.5 * f64::from(b) * f64::from(b);
    /// package.function("f").integral(0.1..=1.0, midpoint).agrees_with(half, Rel(1e-6));
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if an integral differs from the expected integral, the result at a node isn't
    /// finite, or nothing could be compared.
    #[track_caller]
    pub fn agrees_with<E: Mirror>(
        self,
        expected: impl Fn(&V) -> E + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Agreement {
        or_panic(self.try_agrees_with(expected, tolerance))
    }

    /// Runs [`agrees_with`](Self::agrees_with), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if an integral differs from the expected integral, the result at a node isn't finite, or
    /// nothing could be compared.
    pub fn try_agrees_with<E: Mirror>(
        self,
        expected: impl Fn(&V) -> E + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let assertion = Assertion::AgreesWith(self.plan.tolerances(tolerance.into()));
        self.check(expected, assertion)
    }

    /// Checks that each integral is at most a bound plus `slack`. The slack is the absolute error that you
    /// allow for the quadrature and the shader's arithmetic. `bound` returns one number for all components, or
    /// one number for each component.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let midpoint = |&b: &f32| vec![(0.5 * b, f64::from(b))];
    /// let package = Package::from_source("m", "fn f(x: f32) -> f32 { return x; }");
    /// package.function("f").integral(0.1..=1.0, midpoint).is_at_most(|_: &f32| 0.5, 0.0);
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if an integral exceeds its bound, the result at a node isn't finite, or
    /// nothing could be compared.
    #[track_caller]
    pub fn is_at_most<E: Mirror>(self, bound: impl Fn(&V) -> E + Sync, slack: f64) -> Agreement {
        or_panic(self.try_is_at_most(bound, slack))
    }

    /// Runs [`is_at_most`](Self::is_at_most), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if an integral exceeds its bound, the result at a node isn't finite, or nothing could be
    /// compared.
    pub fn try_is_at_most<E: Mirror>(
        self,
        bound: impl Fn(&V) -> E + Sync,
        slack: f64,
    ) -> Result<Agreement, Failure> {
        self.check(bound, Assertion::IsAtMost(slack))
    }

    fn check<E: Mirror>(
        self,
        expected: impl Fn(&V) -> E + Sync,
        assertion: Assertion,
    ) -> Result<Agreement, Failure> {
        let integrals = Integrals {
            arguments: A::shapes(),
            rule: &|case, nodes| {
                for (arguments, weight) in (self.of.rule)(case.get()) {
                    arguments.store_all(&mut nodes.rows);
                    nodes.weights.push(weight);
                }
            },
            control: None,
            expected: &|case, lanes| expected(case.get()).lanes(lanes),
            shape: E::shape(),
            assertion,
        };
        self.plan.integrates(&*self.stream, &integrals)
    }
}

impl Plan<'_> {
    pub(super) fn integrates(
        &self,
        stream: &dyn Stream,
        integrals: &Integrals<'_>,
    ) -> Result<Agreement, Failure> {
        let demand = Demand {
            arguments: integrals.arguments.clone(),
            who: "the quadrature rule supplies",
            draws_arguments: false,
            cases: CASES,
            enumerated: ENUMERATED,
            calls: BATCH,
        };
        let assertion = &integrals.assertion;
        let asserted = Asserted {
            expectation: assertion.expectation(),
            ..Asserted::new(assertion.name(), assertion.to_string())
        };
        self.conclude(&asserted, stream, &demand, &mut |session| {
            assertion.expect_result(session, &integrals.shape, &self.tolerance_on)?;
            integrals.run(session)
        })
    }
}

impl Integrals<'_> {
    fn run(&self, session: &Session<'_>) -> Result<PathTally, Failure> {
        // The error about the first integral without a verdict.
        let undecided: Cell<Option<Failure>> = Cell::new(None);
        let judge = |first: u64, values: Vec<Held>| -> Result<_, Failure> {
            let group = Group::of(session, first, values, self)?;
            let nodes = group.nodes() / group.cases.len().max(1);
            let (tally, doubt) = group.integrate(session, &self.assertion)?;
            undecided.set(undecided.take().or(doubt));
            Ok((tally, nodes))
        };
        let remembered = session.remembered_integrals();
        let mut again = None;
        for (index, (_, value)) in (session.count()..).zip(&remembered) {
            again = Some(PathTally::and(again, judge(index, vec![value.clone()])?.0));
        }
        let Range { start: mut first, end } = session.selected()?;
        let (mut sum, mut size) = (None, 1);
        while first < end {
            let cases = first..end.min(first + size);
            let values = cases.clone().map(|index| session.case(index));
            let (tally, nodes) = judge(first, values.collect::<Result<_, _>>()?)?;
            sum = Some(PathTally::and(sum, tally));
            first = cases.end;
            // If the rules of the next group have as many nodes as the rules of this group, the next group fills a
            // dispatch. The group's size at most doubles, so that long rules after short rules don't fill the memory.
            let fitting = session.called.capacity() / nodes.max(1);
            size = (2 * size).min(fitting.max(1) as u64);
        }
        let Some(mut sum) = sum else { return session.called.vacuous(Vacuous::NoCases) };
        if let Some(again) = again.filter(PathTally::fails) {
            sum = sum.merge(again);
        }
        // A failing integral decides the check, even if another integral has no verdict.
        if let Some(undecided) = undecided.take().filter(|_| !sum.fails()) {
            return Err(undecided);
        }
        session.reduce_integrals(&mut sum, &remembered, &mut |values| {
            Ok(judge(0, values.to_vec())?.0)
        });
        Ok(sum)
    }
}

impl Session<'_> {
    /// Simplifies the case of the worst failing integral, if there is one, and stores the case for later runs.
    fn reduce_integrals(
        &self,
        sum: &mut PathTally,
        remembered: &[(Descent, Held)],
        judge: JudgeValues<'_>,
    ) {
        if let Some(worst) = sum.worst.as_ref().filter(|_| self.steps().is_empty()) {
            let old = worst.case.checked_sub(self.count());
            let old = old.and_then(|index| remembered.get(usize::try_from(index).ok()?));
            sum.simplest = match old {
                Some((descent, _)) => Some(Simplest::new(worst.clone(), descent.clone())),
                None => {
                    let found = self.simplest(worst, Effort::INTEGRALS, judge);
                    found.map(|(simplest, _)| simplest)
                }
            };
        }
        self.remember(sum);
    }
}

impl Nodes {
    fn row(&self, node: usize, words: usize) -> &[u32] {
        &self.rows[node * words..][..words]
    }
}
