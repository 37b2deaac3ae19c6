//! Integrals of a function by quadrature: the rule is the host's, the integrand the shader's.
//!
//! The nodes of as many cases as fill a dispatch are evaluated at once; a rule of more nodes than
//! that takes several dispatches. `weight * value` is summed in `f64` with Neumaier's compensation,
//! in the order of the rule, so that the sum depends neither on the number of its nodes (up to one
//! rounding) nor on how they were dispatched. A node without a finite result fails its case.

use std::cell::RefCell;
use std::ops::Range;

use super::disagreement::{CaseFailure, NodeFailure, Simplest, arguments};
use super::mismatch::signature;
use super::parallel;
use super::path_tally::PathTally;
use super::plan::{Plan, Recording};
use super::session::{Asserted, Demand, Session};
use super::shrink::{Effort, JudgeValues};
use super::tally::{Class, Judged, Shown, Tally, classify, finite};
use super::tolerances::{self, Tolerances};
use super::{Agreement, Failure, Probe};
use crate::domain::{Domain, Held, Stream, Typed};
use crate::path::Path;
use crate::probe::{BATCH, Runner};
use crate::run::{Descent, or_panic};
use crate::tolerance::{LaneError, Tolerance};
use crate::value::{Arguments, Mirror, Scalar, Shape};

/// Integrals of a check unless it says otherwise: each is thousands of calls.
const CASES: u64 = 256;

/// Values of a finite domain that are all tried unless a number of integrals is asked for.
const ENUMERATED: u64 = 65_536;

/// The name of the verb that bounds from above.
pub(super) const IS_AT_MOST: &str = "integral.is_at_most";

impl<'a> Probe<'a> {
    /// Integrates the function by quadrature, once for each of `cases`.
    ///
    /// `rule` turns a case into the nodes of a quadrature rule: each is a complete tuple of the
    /// function's arguments (or the argument of a function that has one) with its weight. Cosines
    /// and Jacobians are part of the weight. The integral is the sum of weight times result, taken
    /// in `f64` for each component of the result, which must be floats. How far the rule itself is
    /// from the integral is the caller's to know, and part of the tolerance.
    ///
    /// ```no_run
    /// use std::f64::consts::{PI, TAU};
    ///
    /// use glam::{DVec3, Vec3};
    /// use karat::prelude::*;
    ///
    /// # static SHADERS: Package = karat::package!("shaders");
    /// // Midpoints of the squared sine and the azimuth: the cosine is in the measure.
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
    pub fn integral<D, A, Q>(self, cases: D, rule: Q) -> Integral<'a, D, Q>
    where
        D: Domain,
        A: Arguments,
        Q: Fn(&D::Value) -> Vec<(A, f64)> + Sync,
    {
        Integral { plan: Plan::new(self), cases, rule }
    }
}

/// A function with the quadrature rules that it is integrated by: see [`Probe::integral`].
#[derive(Clone, Debug)]
#[must_use = "an integral is not taken until a verb such as `.agrees_with(...)`"]
pub struct Integral<'a, D, Q> {
    plan: Plan<'a>,
    cases: D,
    rule: Q,
}

/// The nodes of a quadrature rule: rows of arguments, and their weights.
#[derive(Clone, Debug, Default)]
pub(super) struct Nodes {
    pub(super) rows: Vec<u32>,
    pub(super) weights: Vec<f64>,
}

/// Adds the nodes of a rule for a case.
pub(super) type Rule<'r> = &'r (dyn Fn(&Held, &mut Nodes) + Sync);

/// What is integrated, and what is expected.
pub(super) struct Integrals<'i> {
    /// Types of the arguments that a rule supplies.
    pub(super) arguments: Vec<Shape>,
    pub(super) rule: Rule<'i>,
    /// A rule of another order. Where it gives another integral, neither gives the right one.
    pub(super) control: Option<Rule<'i>>,
    /// Appends the lanes of the expected integral, or of the bound.
    pub(super) expected: &'i (dyn Fn(&Held, &mut Vec<f64>) + Sync),
    /// The type of what is expected.
    pub(super) shape: Shape,
    pub(super) assertion: Assertion,
}

/// What is asserted of an integral.
pub(super) enum Assertion {
    AgreesWith(Tolerances),
    /// The slack.
    IsAtMost(f64),
}

impl<D, A, Q> Integral<'_, D, Q>
where
    D: Domain,
    A: Arguments,
    Q: Fn(&D::Value) -> Vec<(A, f64)> + Sync,
{
    /// Sets the number of integrals. A finite domain of at most that many values is enumerated
    /// instead. Without this, a finite domain of up to 65,536 values is enumerated, and of others
    /// 256 cases are drawn.
    pub fn cases(mut self, cases: u64) -> Self {
        self.plan.cases = Some(cases);
        self
    }

    /// Sets the seed, which otherwise derives from the test's name.
    pub fn seed(mut self, seed: u64) -> Self {
        self.plan.seed = Some(seed);
        self
    }

    /// Sets another tolerance for one path: see [`Check::tolerance_on`](super::Check::tolerance_on).
    pub fn tolerance_on(mut self, path: Path, tolerance: impl Into<Tolerance>) -> Self {
        self.plan.tolerance_on.push((path, tolerance.into()));
        self
    }

    /// Declares that the check fails on a path, and why: see
    /// [`Check::fails_on`](super::Check::fails_on).
    pub fn fails_on(mut self, path: Path, reason: &str) -> Self {
        self.plan.known_issues.declare(path, reason);
        self
    }

    /// Checks that each integral agrees with the expected one to within a tolerance, component by
    /// component. The sum isn't rounded to `f32` before it is compared.
    ///
    /// # Panics
    /// With the [`Failure`], if an integral disagrees, a node has no finite result, or nothing
    /// could be compared.
    #[track_caller]
    pub fn agrees_with<E: Mirror>(
        self,
        expected: impl Fn(&D::Value) -> E + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Agreement {
        let assertion = Assertion::AgreesWith(self.plan.tolerances(tolerance.into()));
        or_panic(self.check(expected, assertion, Recording::On))
    }

    /// [`agrees_with`](Self::agrees_with) without the panic.
    ///
    /// # Errors
    /// If an integral disagrees, a node has no finite result, or nothing could be compared.
    pub fn try_agrees_with<E: Mirror>(
        self,
        expected: impl Fn(&D::Value) -> E + Sync,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let assertion = Assertion::AgreesWith(self.plan.tolerances(tolerance.into()));
        self.check(expected, assertion, Recording::Off)
    }

    /// Checks that each integral is at most a bound plus `slack`, which is absolute: the stated
    /// error of the quadrature and of the shader's arithmetic. The bound is a number for all
    /// components, or one for each.
    ///
    /// # Panics
    /// With the [`Failure`], if an integral exceeds its bound, a node has no finite result, or
    /// nothing could be compared.
    #[track_caller]
    pub fn is_at_most<E: Mirror>(
        self,
        bound: impl Fn(&D::Value) -> E + Sync,
        slack: f64,
    ) -> Agreement {
        or_panic(self.check(bound, Assertion::IsAtMost(slack), Recording::On))
    }

    /// [`is_at_most`](Self::is_at_most) without the panic.
    ///
    /// # Errors
    /// If an integral exceeds its bound, a node has no finite result, or nothing could be compared.
    pub fn try_is_at_most<E: Mirror>(
        self,
        bound: impl Fn(&D::Value) -> E + Sync,
        slack: f64,
    ) -> Result<Agreement, Failure> {
        self.check(bound, Assertion::IsAtMost(slack), Recording::Off)
    }

    fn check<E: Mirror>(
        self,
        expected: impl Fn(&D::Value) -> E + Sync,
        assertion: Assertion,
        recording: Recording,
    ) -> Result<Agreement, Failure> {
        let Self { plan, cases, rule } = self;
        let integrals = Integrals {
            arguments: A::shapes(),
            rule: &|case, nodes| {
                for (arguments, weight) in rule(case.get()) {
                    arguments.store_all(&mut nodes.rows);
                    nodes.weights.push(weight);
                }
            },
            control: None,
            expected: &|case, lanes| expected(case.get()).lanes(lanes),
            shape: E::shape(),
            assertion,
        };
        plan.integrates(&Typed::values(&cases), &integrals, recording)
    }
}

impl Plan<'_> {
    /// Takes the integrals of all cases.
    pub(super) fn integrates(
        &self,
        stream: &dyn Stream,
        integrals: &Integrals<'_>,
        recording: Recording,
    ) -> Result<Agreement, Failure> {
        let demand = Demand {
            arguments: integrals.arguments.clone(),
            who: "the quadrature rule supplies",
            cases: CASES,
            enumerated: ENUMERATED,
            calls: BATCH,
        };
        let assertion = &integrals.assertion;
        let asserted = Asserted { check: assertion.name(), text: assertion.to_string() };
        self.conclude(&asserted, stream, &demand, recording, &mut |session| {
            assertion.expect_result(session, &integrals.shape, &self.tolerance_on)?;
            integrals.run(session)
        })
    }
}

impl Integrals<'_> {
    fn run(&self, session: &Session<'_>) -> Result<Vec<PathTally>, Failure> {
        // What each path has no verdict of, at first.
        let undecided: RefCell<Vec<Option<Failure>>> =
            RefCell::new(session.called.runners.iter().map(|_| None).collect());
        let judge = |first: u64, values: Vec<Held>| -> Result<_, Failure> {
            let group = Group::of(session, first, values, self)?;
            let nodes = group.nodes() / group.cases.len().max(1);
            let (tallies, doubts) = group.integrate(session, &self.assertion)?;
            for (undecided, doubt) in undecided.borrow_mut().iter_mut().zip(doubts) {
                *undecided = undecided.take().or(doubt);
            }
            Ok((tallies, nodes))
        };
        let remembered = session.remembered_integrals();
        let mut again = Vec::new();
        for (index, (_, value)) in (session.count()..).zip(&remembered) {
            again = PathTally::merge_all(again, judge(index, vec![value.clone()])?.0);
        }
        let Range { start: mut first, end } = session.selected()?;
        let (mut sums, mut size) = (Vec::new(), 1);
        while first < end {
            let cases = first..end.min(first + size);
            let values = cases.clone().map(|index| session.case(index));
            let (tallies, nodes) = judge(first, values.collect::<Result<_, _>>()?)?;
            sums = PathTally::merge_all(sums, tallies);
            first = cases.end;
            // The next group fills a dispatch if its rules are as long as these. It grows by
            // steps, so that few long rules after short ones are in memory at once.
            let fitting = session.called.capacity() / nodes.max(1);
            size = (2 * size).min(fitting.max(1) as u64);
        }
        if again.iter().any(PathTally::fails) {
            sums = PathTally::merge_all(sums, again);
        }
        // A path that fails has its verdict without what is undecided.
        for (sum, undecided) in sums.iter().zip(undecided.take()) {
            if let Some(undecided) = undecided.filter(|_| !sum.fails()) {
                return Err(undecided);
            }
        }
        session.reduce_integrals(&mut sums, &remembered, &mut |values| {
            Ok(judge(0, values.to_vec())?.0)
        });
        Ok(sums)
    }
}

impl Session<'_> {
    /// Simplifies the worst integral of each path that fails, and remembers it.
    fn reduce_integrals(
        &self,
        sums: &mut [PathTally],
        remembered: &[(Descent, Held)],
        judge: JudgeValues<'_>,
    ) {
        for (path, sum) in sums.iter_mut().enumerate() {
            let Some(worst) = sum.worst.as_ref().filter(|_| self.steps().is_empty()) else {
                continue;
            };
            let old = worst.case.checked_sub(self.count());
            let old = old.and_then(|index| remembered.get(usize::try_from(index).ok()?));
            sum.simplest = match old {
                Some((descent, _)) => Some(Simplest::new(worst.clone(), descent.clone())),
                None => {
                    let found = self.simplest(path, worst, Effort::INTEGRALS, judge);
                    found.map(|(simplest, _)| simplest)
                }
            };
        }
        self.remember(sums);
    }
}

impl Assertion {
    fn name(&self) -> &'static str {
        match self {
            Self::AgreesWith(_) => "integral.agrees_with",
            Self::IsAtMost(_) => IS_AT_MOST,
        }
    }

    /// What the caller's function returns, as a message calls it.
    fn what(&self) -> &'static str {
        match self {
            Self::AgreesWith(_) => "integral",
            Self::IsAtMost(_) => "bound",
        }
    }

    /// What a message says of the caller's number.
    fn stated(&self) -> &'static str {
        match self {
            Self::AgreesWith(_) => "expected",
            Self::IsAtMost(_) => "the bound",
        }
    }

    /// Compares the result's type with that of the expected integral or the bound.
    fn expect_result(
        &self,
        session: &Session<'_>,
        host: &Shape,
        tolerance_on: &[(Path, Tolerance)],
    ) -> Result<(), Failure> {
        let called = &session.called;
        let function = called.function();
        if !called.scalars().into_iter().all(Scalar::is_float) {
            let mismatch =
                format!("returns {}, and an integral is a sum of floats", function.result);
            return Err(signature(function, mismatch));
        }
        match self {
            Self::AgreesWith(tolerances) => {
                called.expect_result(host, "the expected integral is")?;
                tolerances.expect_usable(session)
            }
            Self::IsAtMost(slack) => {
                tolerances::expect_none(tolerance_on, session)?;
                if *host != Shape::Scalar(Scalar::F32) {
                    called.expect_result(host, "the bound is")?;
                }
                called.expect_lanes(&Tolerance::Abs(*slack))
            }
        }
    }

    fn measure(&self, path: Path, lane: usize, value: f64, expected: f64) -> LaneError {
        // Minus infinity is no integral either, below whichever bound.
        let value = if value.is_finite() { value } else { f64::NAN };
        match self {
            Self::AgreesWith(tolerances) => tolerances.of(path).measure_sum(lane, value, expected),
            Self::IsAtMost(slack) => LaneError::excess(value, expected, *slack),
        }
    }

    /// How far a control is from an integral, which are to agree as closely as is asserted.
    fn doubt(&self, path: Path, lane: usize, value: f64, control: f64) -> LaneError {
        match self {
            Self::AgreesWith(tolerances) => tolerances.of(path).measure_sum(lane, control, value),
            Self::IsAtMost(slack) => Tolerance::Abs(*slack).measure_sum(lane, control, value),
        }
    }

    /// Whether an integral is beyond what is allowed whichever rule is right: both are on one side
    /// of what is expected, and would still be beyond if they were off by as much as they differ.
    fn refuses_both(&self, path: Path, lane: usize, sums: [f64; 2], expected: f64) -> bool {
        let doubt = (sums[0] - sums[1]).abs();
        let above = sums[0] > expected;
        sums.into_iter().all(|value| {
            let nearest = if above { value - doubt } else { value + doubt };
            let same_side = if above { nearest > expected } else { nearest < expected };
            same_side && !self.measure(path, lane, nearest, expected).passes()
        })
    }

    /// Judges an integral by its worst component.
    fn judge(&self, path: Path, sum: &Sum, expected: &[f64]) -> Judged {
        if let Some(bad) = &sum.bad {
            let Judged { lane, class, .. } = bad.judged;
            let measure = self.measure(path, lane, f64::NAN, expected[lane]);
            return Judged { measure, lane, class };
        }
        let mut worst = Judged { measure: LaneError::ZERO, lane: 0, class: Class::Other };
        for (lane, (value, expected)) in sum.totals().into_iter().zip(expected).enumerate() {
            let measure = self.measure(path, lane, value, *expected);
            if lane == 0 || measure.ratio > worst.measure.ratio {
                let class = match self {
                    Self::IsAtMost(_) if value.is_finite() => Class::TooHigh,
                    _ => classify(value, *expected),
                };
                worst = Judged { measure, lane, class };
            }
        }
        worst
    }
}

impl std::fmt::Display for Assertion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::AgreesWith(tolerances) => write!(f, "{}", tolerances.general),
            Self::IsAtMost(0.0) => f.write_str("its bound"),
            Self::IsAtMost(slack) => write!(f, "its bound, slack {}", Tolerance::Abs(*slack)),
        }
    }
}

/// Cases whose nodes are in memory together.
struct Group {
    first: u64,
    cases: Vec<Case>,
}

struct Case {
    value: Held,
    /// Those of the rule, then those of its control.
    nodes: Nodes,
    /// How many are the rule's.
    own: usize,
    /// The lanes of the expected integral, or of the bound.
    expected: Vec<f64>,
}

impl Group {
    /// Makes the rules of the cases and what their integrals should be. A rule that is empty or
    /// has a weight that isn't finite is an error, and so is an expectation that isn't finite.
    fn of(
        session: &Session<'_>,
        first: u64,
        values: Vec<Held>,
        integrals: &Integrals<'_>,
    ) -> Result<Self, Failure> {
        let words = session.called.scalars().len();
        let made = parallel::map(values.len(), |index| {
            let value = &values[index];
            let mut lanes = Vec::with_capacity(words);
            (integrals.expected)(value, &mut lanes);
            // A bound for all components; other shapes have been compared with the result's.
            let last = lanes.last().copied().unwrap_or(f64::NAN);
            lanes.resize(words, last);
            let mut nodes = Nodes::default();
            (integrals.rule)(value, &mut nodes);
            let own = nodes.weights.len();
            if let Some(control) = integrals.control {
                control(value, &mut nodes);
            }
            (nodes, own, lanes)
        });
        let case = |(value, (nodes, own, expected))| Case { value, nodes, own, expected };
        let cases: Vec<Case> = values.into_iter().zip(made).map(case).collect();
        // In order, so that of several errors the same one is reported every time.
        let mut checked = Vec::with_capacity(cases.len());
        for (index, case) in (first..).zip(cases) {
            if let Some(reason) = case.unusable() {
                let function = session.called.function().path.clone();
                let arguments = case.value.shown();
                return Err(Failure::Rule { function, reason, case: index, arguments });
            }
            let what = integrals.assertion.what();
            let shown = |_| (index, case.value.shown());
            session.called.expect_finite(&case.expected, what, shown)?;
            checked.push(case);
        }
        Ok(Self { first, cases: checked })
    }

    fn nodes(&self) -> usize {
        self.cases.iter().map(|case| case.nodes.weights.len()).sum()
    }

    /// Evaluates all nodes on every path and judges the sums. An integral whose rules leave it open
    /// whether it passes isn't counted as one that fails; the first of each path is the second
    /// result.
    fn integrate(
        &self,
        session: &Session<'_>,
        assertion: &Assertion,
    ) -> Result<(Vec<PathTally>, Vec<Option<Failure>>), Failure> {
        let called = &session.called;
        let scalars = called.scalars();
        let empty = vec![Sum::new(scalars.len()); self.cases.len()];
        let mut sums = vec![empty.clone(); called.runners.len()];
        let mut controls = vec![empty; called.runners.len()];
        let mut places = (0..self.cases.len()).flat_map(|case| {
            (0..self.cases[case].nodes.weights.len()).map(move |node| (case, node))
        });
        loop {
            let piece: Vec<(usize, usize)> = places.by_ref().take(called.capacity()).collect();
            if piece.is_empty() {
                break;
            }
            let mut rows = Vec::with_capacity(piece.len() * called.words);
            for (case, node) in &piece {
                rows.extend_from_slice(self.cases[*case].nodes.row(*node, called.words));
            }
            let canary = (session.cases.seed, self.first);
            let dispatches = called.start(&rows, piece.len(), canary)?;
            for (path, (runner, dispatch)) in called.runners.iter().zip(dispatches).enumerate() {
                runner.read(dispatch, |results| {
                    for ((case, node), result) in
                        piece.iter().zip(results.chunks_exact(runner.stride_out()))
                    {
                        let Case { nodes, own, .. } = &self.cases[*case];
                        let weight = nodes.weights[*node];
                        let sums = if node < own { &mut sums } else { &mut controls };
                        sums[path][*case].add(&scalars, *node, weight, &result[..scalars.len()]);
                    }
                })?;
            }
        }
        let mut undecided = Vec::with_capacity(called.runners.len());
        let tally = |(runner, (sums, controls)): (&Runner, (&Vec<Sum>, &Vec<Sum>))| {
            let path = runner.device().path();
            let mut tally = Tally::default();
            let mut first = None;
            for (case, sum) in sums.iter().enumerate() {
                let doubt = self.doubt(session, assertion, path, case, (sum, &controls[case]));
                let judged = match doubt {
                    Some(_) => Judged { measure: LaneError::ZERO, lane: 0, class: Class::Other },
                    None => assertion.judge(path, sum, &self.cases[case].expected),
                };
                tally.add(self.first + case as u64, judged);
                first = first.or(doubt);
            }
            undecided.push(first);
            let show = |shown: Shown| {
                let case = usize::try_from(shown.case - self.first).expect("in this group");
                let failure = self.show(session, shown, &self.cases[case], &sums[case]);
                let (lane, other) = (shown.judged.lane, &controls[case]);
                let nodes = self.cases[case].nodes.weights.len() - self.cases[case].own;
                let comparable = nodes > 0 && sums[case].bad.is_none() && other.bad.is_none();
                let (value, control) = (sums[case].totals()[lane], other.totals()[lane]);
                let doubt = assertion.doubt(path, lane, value, control);
                failure
                    .with_control(Some((control, nodes)).filter(|_| comparable && !doubt.passes()))
            };
            PathTally::new(runner.device(), tally, show).with_nodes(self.nodes() as u64)
        };
        let sums = sums.iter().zip(&controls);
        let tallies = called.runners.iter().zip(sums).map(tally).collect();
        Ok((tallies, undecided))
    }

    /// Why an integral has no verdict: its two rules differ by more than is allowed, and one of them
    /// may be right that it passes. A node that isn't finite is a verdict.
    fn doubt(
        &self,
        session: &Session<'_>,
        assertion: &Assertion,
        path: Path,
        index: usize,
        (sum, control): (&Sum, &Sum),
    ) -> Option<Failure> {
        let case = &self.cases[index];
        let nodes = case.nodes.weights.len() - case.own;
        if nodes == 0 || sum.bad.is_some() || control.bad.is_some() {
            return None;
        }
        let lanes = || sum.totals().into_iter().zip(control.totals()).enumerate();
        let refused = |(lane, (value, control)): (usize, (f64, f64))| {
            assertion.refuses_both(path, lane, [value, control], case.expected[lane])
        };
        if lanes().any(refused) {
            return None;
        }
        lanes().find_map(|(lane, (value, control))| {
            let doubt = assertion.doubt(path, lane, value, control);
            (!doubt.passes()).then(|| {
                let expected = case.expected[lane];
                let reason = format!(
                    "gives {value} with {} nodes and {control} with {nodes} on {path}, {doubt} \
                     apart, where {expected} is {}, so that neither is a verdict: use more rings, \
                     or a rule of your own with `.integral(...)`,",
                    case.own,
                    assertion.stated(),
                );
                let function = session.called.function().path.clone();
                let (case, arguments) = (self.first + index as u64, case.value.shown());
                Failure::Rule { function, reason, case, arguments }
            })
        })
    }

    fn show(&self, session: &Session<'_>, shown: Shown, case: &Case, sum: &Sum) -> CaseFailure {
        let function = session.called.function();
        let node = sum.bad.as_ref().map(|bad| NodeFailure {
            index: bad.node,
            weight: case.nodes.weights[bad.node],
            arguments: arguments(function, case.nodes.row(bad.node, session.called.words)),
            result: function.result.format(&bad.result),
        });
        let integral = (&*sum.totals(), case.own, node);
        let (value, expected) = (case.value.shown(), &case.expected);
        let (index, judged) = (shown.case, &shown.judged);
        let failure = CaseFailure::of_integral(function, index, value, integral, expected, judged);
        CaseFailure { remembered: index >= session.count(), ..failure }
    }
}

impl Nodes {
    /// The arguments of a node.
    fn row(&self, node: usize, words: usize) -> &[u32] {
        &self.rows[node * words..][..words]
    }
}

impl Case {
    /// Why the rule can't be summed.
    fn unusable(&self) -> Option<String> {
        if self.own == 0 {
            return Some("has no nodes, so nothing would be integrated,".to_owned());
        }
        let bad = self.nodes.weights.iter().position(|weight| !weight.is_finite())?;
        Some(format!("has the weight {} at node {bad}", self.nodes.weights[bad]))
    }
}

/// The integral of one case on one path, so far.
#[derive(Clone, Debug)]
struct Sum {
    lanes: Vec<Compensated>,
    bad: Option<Bad>,
}

/// The first node of a rule whose result isn't finite.
#[derive(Clone, Debug)]
struct Bad {
    node: usize,
    result: Vec<u32>,
    judged: Judged,
}

impl Sum {
    fn new(lanes: usize) -> Self {
        Self { lanes: vec![Compensated::default(); lanes], bad: None }
    }

    fn add(&mut self, scalars: &[Scalar], node: usize, weight: f64, result: &[u32]) {
        for ((sum, scalar), word) in self.lanes.iter_mut().zip(scalars).zip(result) {
            sum.add(weight * scalar.decode(*word));
        }
        if self.bad.is_none() {
            let judged = finite(scalars, result);
            if !judged.measure.passes() {
                self.bad = Some(Bad { node, result: result.to_vec(), judged });
            }
        }
    }

    fn totals(&self) -> Vec<f64> {
        self.lanes.iter().map(Compensated::total).collect()
    }
}

/// Neumaier's sum (1974): the rounding error of each addition is kept and added at the end.
#[derive(Clone, Copy, Debug, Default)]
struct Compensated {
    sum: f64,
    lost: f64,
}

impl Compensated {
    fn add(&mut self, term: f64) {
        let sum = self.sum + term;
        let (large, small) =
            if self.sum.abs() >= term.abs() { (self.sum, term) } else { (term, self.sum) };
        self.lost += (large - sum) + small;
        self.sum = sum;
    }

    /// The sum; NaN or infinite if it overflowed or a term was, and then `lost` is no number.
    fn total(&self) -> f64 {
        if self.sum.is_finite() { self.sum + self.lost } else { self.sum }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tolerance::{Abs, Rel};

    fn sum(terms: &[(f64, f32)]) -> Sum {
        let mut sum = Sum::new(1);
        for (node, (weight, value)) in terms.iter().enumerate() {
            sum.add(&[Scalar::F32], node, *weight, &[value.to_bits()]);
        }
        sum
    }

    #[test]
    fn what_cancels_is_not_lost() {
        let terms = [(1.0, 1.0), (1e100, 1.0), (1.0, 1.0), (-1e100, 1.0)];
        assert_eq!(sum(&terms).totals(), [2.0]);
        let tenths = sum(&[(0.1, 1.0); 1_000_000]).totals()[0];
        assert!((tenths - 1e5).abs() < 1e-10, "{tenths}");
    }

    #[test]
    fn no_sum_with_nan_or_infinity_passes() {
        let loosest = Tolerance::from(Abs(1e300)).or(Rel(1e300));
        let loosest = Tolerances { general: loosest, on: Vec::new() };
        let assertions = [Assertion::AgreesWith(loosest), Assertion::IsAtMost(f64::MAX)];
        for assertion in assertions {
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                for weight in [0.0, 1.0, -1.0] {
                    let sum = sum(&[(1.0, 1.0), (weight, bad), (1.0, 1.0)]);
                    let judged = assertion.judge(Path::Gl, &sum, &[1.0]);
                    assert!(!judged.measure.passes(), "{weight} * {bad}");
                    let nan = judged.class == Class::Nan;
                    assert!(nan == bad.is_nan() && (nan || judged.class == Class::Infinite));
                }
            }
            for weight in [f64::MAX, -f64::MAX] {
                let overflow = sum(&[(weight, 2.0)]);
                assert!(!assertion.judge(Path::Gl, &overflow, &[1.0]).measure.passes());
            }
        }
    }

    /// Both rules far outside are a verdict; where one may be right that it passes, there is none.
    #[test]
    fn what_both_rules_refuse_is_refused() {
        let tolerances = Tolerances { general: Abs(0.1).into(), on: Vec::new() };
        let equal = Assertion::AgreesWith(tolerances);
        let refuses = |assertion: &Assertion, sums| {
            let there = assertion.refuses_both(Path::Gl, 0, sums, 1.0);
            let back = assertion.refuses_both(Path::Gl, 0, [sums[1], sums[0]], 1.0);
            assert_eq!(there, back, "{sums:?}");
            there
        };
        for sums in [[630.0, 480.0], [1.5, 1.35], [0.5, 0.6], [-40.0, -30.0]] {
            assert!(refuses(&equal, sums), "{sums:?}");
        }
        // The last two: off by as much again, one would pass; and one on either side.
        for sums in [[1.05, 0.9], [1.3, 1.05], [0.7, 1.3], [1.4, 1.21], [0.6, 0.78], [-8.0, 9.0]] {
            assert!(!refuses(&equal, sums), "{sums:?}");
        }
        assert!(!refuses(&equal, [f64::NAN, 5.0]));
        let bound = Assertion::IsAtMost(0.1);
        assert!(refuses(&bound, [630.0, 480.0]) && !refuses(&bound, [1.4, 1.2]));
        assert!(!refuses(&bound, [-630.0, -480.0]), "below the bound");
    }

    #[test]
    fn a_bound_is_closed_and_the_slack_absolute() {
        let passes = |slack, value: f64, bound| {
            let judged =
                Assertion::IsAtMost(slack).judge(Path::Gl, &sum(&[(value, 1.0)]), &[bound]);
            assert!(judged.measure.passes() || judged.class == Class::TooHigh);
            judged.measure.passes()
        };
        assert!(passes(0.0, 1.0, 1.0) && passes(0.0, -5.0, 1.0) && passes(0.0, -2.0, -1.0));
        assert!(!passes(0.0, 1.0_f64.next_up(), 1.0) && !passes(0.0, 0.5, -1.0));
        assert!(passes(0.25, 1.25, 1.0) && !passes(0.25, 1.25_f64.next_up(), 1.0));
    }
}
