//! Checks whose arguments are chosen at run time: by a tool, or by a file.

use super::agreement::Expected;
use super::demand::Demand;
use super::integral::Assertion;
use super::invariance::Scaling;
use super::limit::Limit;
use super::plan::{Plan, Recording};
use super::{Agreement, CASES, Directions, ENUMERATED, Failure, Parameter, Probe, Trend};
use crate::domain::Dynamic;
use crate::golden::Goldens;
use crate::path::Selector;
use crate::tolerance::{Criterion, Tolerance};
use crate::value::Shape;

impl<'a> Probe<'a> {
    /// Chooses the arguments at run time. The verbs of a [`DynamicCheck`] take and return words: the
    /// lanes of all arguments in turn, and those of the result.
    pub fn over_dynamic(self, domain: Dynamic) -> DynamicCheck<'a> {
        DynamicCheck { plan: Plan::new(self), domain }
    }
}

/// A function with arguments that are chosen at run time. Each verb records its verdict and returns it.
#[derive(Debug)]
#[must_use = "a check compares nothing until a verb such as `.agrees_with(...)`"]
pub struct DynamicCheck<'a> {
    plan: Plan<'a>,
    domain: Dynamic,
}

/// Appends the expected lanes for a case's arguments.
pub type ExpectWords<'e> = &'e (dyn Fn(&[u32], &mut Vec<f64>) + Sync);

impl DynamicCheck<'_> {
    /// See [`Check::cases`](super::Check::cases).
    pub fn cases(mut self, cases: u64) -> Self {
        self.plan.cases = Some(cases);
        self
    }

    /// See [`Check::seed`](super::Check::seed).
    pub fn seed(mut self, seed: u64) -> Self {
        self.plan.seed = Some(seed);
        self
    }

    /// See [`Check::tolerance_on`](super::Check::tolerance_on).
    pub fn tolerance_on(
        mut self,
        on: impl Into<Selector>,
        tolerance: impl Into<Tolerance>,
    ) -> Self {
        self.plan.tolerance_on.declare(on.into(), tolerance.into());
        self
    }

    /// See [`Check::fails_on`](super::Check::fails_on).
    pub fn fails_on(mut self, on: impl Into<Selector>, reason: &str) -> Self {
        self.plan.known_issues.declare(on.into(), reason);
        self
    }

    fn demand(&self) -> Demand {
        Demand {
            arguments: self.domain.shapes().to_vec(),
            who: "the test draws",
            draws_arguments: true,
            cases: CASES,
            enumerated: ENUMERATED,
            calls: 1,
        }
    }

    /// Checks that the function agrees with `expect`, which knows the result's lanes.
    ///
    /// # Errors
    /// See [`Check::try_agrees_with`](super::Check::try_agrees_with).
    pub fn agrees_with(
        self,
        expect: ExpectWords<'_>,
        criterion: impl Into<Criterion>,
    ) -> Result<Agreement, Failure> {
        let shape = self.result()?;
        let expected = Expected {
            shape,
            expect: &|rows, lanes| rows.iter().for_each(|row| expect(row, lanes)),
        };
        let demand = self.demand();
        self.plan.agrees(&self.domain, &demand, &expected, &criterion.into(), Recording::On)
    }

    /// Checks that the function agrees with another one of its package, which takes the same
    /// arguments. Karat's engine executes that one in `f64`, with the fixtures of the first.
    ///
    /// # Errors
    /// As above, and if the engine can't execute the other function.
    pub fn agrees_with_function(
        self,
        reference: &str,
        criterion: impl Into<Criterion>,
    ) -> Result<Agreement, Failure> {
        let demand = self.demand();
        self.plan.agrees_with_function(
            &self.domain,
            &demand,
            reference,
            &criterion.into(),
            Recording::On,
        )
    }

    /// Checks that the function returns what it returned when its golden was accepted.
    ///
    /// # Errors
    /// See [`Check::try_matches`](super::Check::try_matches).
    pub fn matches(
        self,
        goldens: &Goldens,
        case: &str,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let (demand, golden) = (self.demand(), (goldens, case));
        self.plan.matches(&self.domain, demand, golden, tolerance.into(), Recording::On)
    }

    /// See [`Check::is_finite`](super::Check::is_finite).
    ///
    /// # Errors
    /// See [`Check::try_is_finite`](super::Check::try_is_finite).
    pub fn is_finite(self) -> Result<Agreement, Failure> {
        let demand = self.demand();
        self.plan.is_finite(&self.domain, &demand, Recording::On)
    }

    /// See [`Check::stays_within`](super::Check::stays_within).
    ///
    /// # Errors
    /// See [`Check::try_stays_within`](super::Check::try_stays_within).
    pub fn stays_within(self, least: f64, most: f64) -> Result<Agreement, Failure> {
        let demand = self.demand();
        self.plan.stays_within(&self.domain, &demand, [least, most], Recording::On)
    }

    /// See [`Check::is_unit`](super::Check::is_unit).
    ///
    /// # Errors
    /// See [`Check::try_is_unit`](super::Check::try_is_unit).
    pub fn is_unit(self) -> Result<Agreement, Failure> {
        let demand = self.demand();
        self.plan.is_unit(&self.domain, &demand, Recording::On)
    }

    /// Checks that a statement holds for the words of arguments and result.
    ///
    /// # Errors
    /// See [`Check::try_satisfies`](super::Check::try_satisfies).
    pub fn satisfies(
        self,
        statement: &str,
        holds: &(dyn Fn(&[u32], &[u32]) -> bool + Sync),
    ) -> Result<Agreement, Failure> {
        let (shape, demand) = (self.result()?, self.demand());
        self.plan.satisfies(&self.domain, &demand, statement, (&shape, holds), Recording::On)
    }

    /// Checks that the result stays the same when `transform` appends other arguments.
    ///
    /// # Errors
    /// See [`Check::try_invariant_under`](super::Check::try_invariant_under).
    pub fn invariant_under(
        self,
        transform: &(dyn Fn(&[u32], &mut Vec<u32>) + Sync),
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let demand = self.demand();
        let (plan, scaling, tolerance) = (&self.plan, Scaling::NONE, tolerance.into());
        plan.is_invariant(&self.domain, &demand, transform, scaling, tolerance, Recording::On)
    }

    /// Checks that the result only rises, or only falls, with one argument.
    ///
    /// # Errors
    /// See [`Check::try_is_monotone_in`](super::Check::try_is_monotone_in).
    pub fn is_monotone_in(
        self,
        argument: impl Into<Parameter>,
        trend: Trend,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let (demand, argument) = (self.demand(), argument.into());
        let how = (&argument, trend);
        self.plan.is_monotone(&self.domain, &demand, how, tolerance.into(), Recording::On)
    }

    /// Checks that the result approaches `expect` as one argument approaches a limit.
    ///
    /// # Errors
    /// See [`Check::try_at_limit`](super::Check::try_at_limit).
    pub fn at_limit(
        self,
        argument: impl Into<Parameter>,
        limit: &Limit,
        expect: ExpectWords<'_>,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let expected = Expected {
            shape: self.result()?,
            expect: &|rows, lanes| rows.iter().for_each(|row| expect(row, lanes)),
        };
        let (demand, argument) = (self.demand(), argument.into());
        let approach = (&argument, limit);
        let tolerance = tolerance.into();
        self.plan.has_limit(&self.domain, &demand, approach, &expected, tolerance, Recording::On)
    }

    /// Checks that nothing goes wrong inside of the function: see
    /// [`Check::has_no_hazards`](super::Check::has_no_hazards).
    ///
    /// # Errors
    /// If something goes wrong, or the engine doesn't execute the function.
    #[cfg(feature = "engine")]
    pub fn has_no_hazards(self) -> Result<Agreement, Failure> {
        let demand = self.demand();
        self.plan.hazards(&self.domain, &demand, Recording::On)
    }

    /// Runs a test that is written in WGSL: see [`WgslTest`](super::WgslTest).
    ///
    /// # Errors
    /// If an expectation fails, or none was evaluated.
    pub fn expects(self) -> Result<Agreement, Failure> {
        let demand = self.demand();
        self.plan.expects(&self.domain, &demand, Recording::On)
    }

    /// Checks the integral over directions, which are the function's last argument: the domain has the
    /// arguments before it. See [`Check::integrates_to`](super::Check::integrates_to).
    ///
    /// # Errors
    /// If an integral isn't the expected one, if two rules disagree, or if nothing could be compared.
    pub fn integrates_to(
        self,
        directions: Directions,
        expect: ExpectWords<'_>,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let assertion = Assertion::AgreesWith(self.plan.tolerances(tolerance.into()));
        self.integrate(directions, expect, assertion)
    }

    /// Checks that the integral over directions is at most a bound plus `slack`, as
    /// [`Check::integrates_to_at_most`](super::Check::integrates_to_at_most) does.
    ///
    /// # Errors
    /// As above.
    pub fn integrates_to_at_most(
        self,
        directions: Directions,
        bound: ExpectWords<'_>,
        slack: f64,
    ) -> Result<Agreement, Failure> {
        self.integrate(directions, bound, Assertion::IsAtMost(slack))
    }

    fn integrate(
        self,
        directions: Directions,
        expect: ExpectWords<'_>,
        assertion: Assertion,
    ) -> Result<Agreement, Failure> {
        let shapes = self.domain.shapes().to_vec();
        let shape = self.result()?;
        directions.integrals(
            shapes,
            shape,
            &|case, lanes| expect(&case.row, lanes),
            assertion,
            |i| self.plan.integrates(&self.domain, i, Recording::On),
        )
    }

    fn result(&self) -> Result<Shape, Failure> {
        Ok(self.plan.function()?.result)
    }
}
