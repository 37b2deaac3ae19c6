//! Groups of integrals. Karat keeps the nodes of one group in memory, sums the results at these nodes, and
//! judges the sums.

use super::assertion::Assertion;
use super::sum::Sum;
use super::{Integrals, Nodes};
use crate::check::Failure;
use crate::check::disagreement::{CaseFailure, NodeFailure};
use crate::check::path_tally::PathTally;
use crate::check::session::Session;
use crate::domain::Held;
use crate::judge::{Class, Judged, Shown, Tally};
use crate::parallel;
use crate::reflect::Function;
use crate::tolerance::LaneError;

pub(super) struct Group {
    pub(super) first: u64,
    pub(super) cases: Vec<Case>,
}

pub(super) struct Case {
    pub(super) value: Held,
    /// The nodes of both rules: `own` nodes of the first rule, followed by the nodes of the second rule.
    nodes: Nodes,
    own: usize,
    /// The components of the expected integral, or of the bound.
    expected: Vec<f64>,
}

impl Group {
    /// Computes the quadrature rule and the expected integral of each case. Returns an error if a rule has no
    /// nodes, or if a weight or an expected value isn't finite.
    pub(super) fn of(
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
            // A single bound applies to all components. `expect_result` has checked all other types.
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
        // Checks the cases in their order, so that every run reports the same error.
        let mut checked = Vec::with_capacity(cases.len());
        for (index, case) in (first..).zip(cases) {
            if let Some(reason) = case.unusable() {
                let function = session.called.function().name.clone();
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

    pub(super) fn nodes(&self) -> usize {
        self.cases.iter().map(|case| case.nodes.weights.len()).sum()
    }

    /// Evaluates all nodes and judges the sums. If the two rules of an integral give no verdict (see `doubt`), the
    /// integral is doubtful, and doesn't count as failing. The second returned value is the error about the first
    /// doubtful integral.
    pub(super) fn integrate(
        &self,
        session: &Session<'_>,
        assertion: &Assertion,
    ) -> Result<(PathTally, Option<Failure>), Failure> {
        let called = &session.called;
        let scalars = called.scalars();
        let mut sums = vec![Sum::new(scalars.len()); self.cases.len()];
        let mut controls = sums.clone();
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
            called.start(&rows, piece.len())?.view(|results| {
                for (call, (case, node)) in piece.iter().enumerate() {
                    let Case { nodes, own, .. } = &self.cases[*case];
                    let weight = nodes.weights[*node];
                    let sums = if node < own { &mut sums } else { &mut controls };
                    sums[*case].add(&scalars, *node, weight, results.of(call));
                }
            })?;
        }
        let bound = assertion.on(called);
        let mut tally = Tally::default();
        let mut undecided = None;
        for (case, sum) in sums.iter().enumerate() {
            let doubt = self.doubt(session, assertion, case, (sum, &controls[case]));
            let judged = match doubt {
                Some(_) => Judged { measure: LaneError::ZERO, lane: 0, class: Class::Other },
                None => bound.judge(sum, &self.cases[case].expected),
            };
            tally.add(self.first + case as u64, judged);
            undecided = undecided.or(doubt);
        }
        let show = |shown: Shown| {
            let case = usize::try_from(shown.case - self.first).expect("in this group");
            let failure = self.show(session, shown, &self.cases[case], &sums[case]);
            let (lane, other) = (shown.judged.lane, &controls[case]);
            let nodes = self.cases[case].nodes.weights.len() - self.cases[case].own;
            let comparable = nodes > 0 && sums[case].bad.is_none() && other.bad.is_none();
            let (value, control) = (sums[case].totals()[lane], other.totals()[lane]);
            let doubt = bound.doubt(lane, value, control);
            failure.with_control(Some((control, nodes)).filter(|_| comparable && !doubt.passes()))
        };
        let tally = PathTally::new(called, tally, show).with_nodes(self.nodes() as u64);
        Ok((tally, undecided))
    }

    /// Returns an error if an integral has no verdict. An integral has no verdict if its two rules give values that
    /// differ by more than the assertion allows, unless both values clearly fail (see `refuses_both`). If the result at
    /// a node isn't finite, the integral fails.
    fn doubt(
        &self,
        session: &Session<'_>,
        assertion: &Assertion,
        index: usize,
        (sum, control): (&Sum, &Sum),
    ) -> Option<Failure> {
        let case = &self.cases[index];
        let bound = assertion.on(&session.called);
        let nodes = case.nodes.weights.len() - case.own;
        if nodes == 0 || sum.bad.is_some() || control.bad.is_some() {
            return None;
        }
        let lanes = || sum.totals().into_iter().zip(control.totals()).enumerate();
        let refused = |(lane, (value, control)): (usize, (f64, f64))| {
            bound.refuses_both(lane, [value, control], case.expected[lane])
        };
        if lanes().any(refused) {
            return None;
        }
        lanes().find_map(|(lane, (value, control))| {
            let doubt = bound.doubt(lane, value, control);
            (!doubt.passes()).then(|| {
                let expected = case.expected[lane];
                let reason = format!(
                    "gives {value} with {} nodes and {control} with {nodes} nodes (a difference of \
                     {doubt}; {expected} is {}), so there is no verdict: use more rings, or your \
                     own rule with `.integral(...)`",
                    case.own,
                    assertion.stated(),
                );
                let function = session.called.function().name.clone();
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
            arguments: function.arguments(case.nodes.row(bad.node, session.called.words)),
            result: function.result.format(&bad.result),
        });
        let integral = (&*sum.totals(), case.own, node);
        let (value, expected) = (case.value.shown(), &case.expected);
        let (index, judged) = (shown.case, &shown.judged);
        let mut failure =
            CaseFailure::of_integral(function, index, value, integral, expected, judged);
        failure.arguments.extend(case.shared(function, session.called.words));
        CaseFailure { remembered: index >= session.count(), ..failure }
    }
}

impl Case {
    /// The names and values of the arguments that have the same value at each node: the parameters of the
    /// integral.
    fn shared(&self, function: &Function, words: usize) -> Vec<(String, String)> {
        let all = |node: usize| function.arguments(self.nodes.row(node, words));
        let mut shared = all(0);
        let mut at = 0;
        for (index, (_, shape)) in function.parameters.iter().enumerate().rev() {
            let end = words - at;
            at += shape.lanes().len();
            let lanes = words - at..end;
            let first = &self.nodes.row(0, words)[lanes.clone()];
            if !(1..self.own).all(|node| self.nodes.row(node, words)[lanes.clone()] == *first) {
                shared.remove(index);
            }
        }
        shared
    }

    /// Describes why the rule can't be used. `None` if the rule can be used.
    fn unusable(&self) -> Option<String> {
        if self.own == 0 {
            return Some("has no nodes, so it can't integrate".to_owned());
        }
        let bad = self.nodes.weights.iter().position(|weight| !weight.is_finite())?;
        Some(format!(
            "has the weight {} at node {bad}, but weights must be finite",
            self.nodes.weights[bad]
        ))
    }
}
