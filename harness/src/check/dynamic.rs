//! Checks for which a tool or a file chooses the domain at run time.

use std::marker::PhantomData;

use super::agreement::Expected;
use super::integral::Assertion;
use super::invariance::{Scaling, Transform};
use super::limit::Limit;
use super::statement::Holds;
use super::{Agreement, Calls, Check, Directions, Failure, Parameter, Probe};
use crate::domain::{Dynamic, Held};
use crate::tolerance::{Criterion, Tolerance};
use crate::value::Shape;

/// Arguments and results as `u32` words. A row contains the components of all arguments, one after the other. A
/// result is a row with the words of its components.
///
/// ```
/// use karat::check::{Agreement, Calls, Check, Failure};
/// use karat::unstable::check::Words;
///
/// fn is_bounded(check: Check<'_, Calls<Words>>) -> Result<Agreement, Failure> {
///     check.cases(1000).try_stays_within(0.0..=1.0)
/// }
/// ```
#[derive(Clone, Copy, Debug)]
pub enum Words {}

/// A function that takes a case's arguments as `u32` words, and appends the expected components of the result.
pub type ExpectWords<'e> = &'e (dyn Fn(&[u32], &mut Vec<f64>) + Sync);

impl<'a> Probe<'a> {
    /// Chooses the arguments' values with a domain that is known only at run time. The closures that you pass
    /// to verbs take and return `u32` words.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// use karat::unstable::domain::{Dynamic, Part};
    /// use karat::unstable::value::{Scalar, Shape};
    ///
    /// let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// let half = |words: &[u32], lanes: &mut Vec<f64>| lanes.push(0.5 * Scalar::F32.decode(words[0]));
    /// package.function("half").over_dynamic(x).try_agrees_with(&half, Ulp(0.0))?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn over_dynamic(self, domain: Dynamic) -> Check<'a, Calls<Words>> {
        let shapes = domain.shapes().to_vec();
        Check::new(self, domain, Calls { shapes, values: PhantomData })
    }
}

/// Verbs for checks with a domain that is known only at run time. The closures for these verbs take `u32` words instead
/// of values.
impl Check<'_, Calls<Words>> {
    /// Checks that the function agrees with `expect`, which appends the expected components of the result.
    ///
    /// # Errors
    /// See [`Check::try_agrees_with`].
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn try_agrees_with(
        self,
        expect: ExpectWords<'_>,
        criterion: impl Into<Criterion>,
    ) -> Result<Agreement, Failure> {
        let expected = Expected {
            shape: self.result()?,
            expect: &|rows, lanes| rows.iter().for_each(|row| expect(row, lanes)),
        };
        self.plan.agrees(&*self.stream, &self.demand(), &expected, &criterion.into())
    }

    /// Checks that a statement holds. `holds` receives the words of the arguments and of the result.
    ///
    /// # Errors
    /// See [`Check::try_satisfies`].
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn try_satisfies(self, statement: &str, holds: Holds<'_>) -> Result<Agreement, Failure> {
        let shape = self.result()?;
        self.plan.satisfies(&*self.stream, &self.demand(), statement, (&shape, holds))
    }

    /// Checks that the result stays the same if `transform` changes the arguments. `transform` appends the
    /// changed arguments.
    ///
    /// # Errors
    /// See [`Check::try_invariant_under`].
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn try_invariant_under(
        self,
        transform: Transform<'_>,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let (stream, demand) = (&*self.stream, &self.demand());
        self.plan.is_invariant(stream, demand, transform, Scaling::NONE, tolerance.into())
    }

    /// Checks that the result approaches `expect` as one argument approaches a limit.
    ///
    /// # Errors
    /// See [`Check::try_at_limit`].
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn try_at_limit(
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
        let approach = (&argument.into(), limit);
        let (stream, demand) = (&*self.stream, &self.demand());
        self.plan.has_limit(stream, demand, approach, &expected, tolerance.into())
    }

    /// Runs a test that is written in WGSL. See [`WgslTest`](crate::unstable::check::WgslTest).
    ///
    /// ```
    /// # use karat::prelude::*;
    /// use karat::unstable::domain::{Dynamic, Part};
    /// use karat::unstable::value::Scalar;
    ///
    /// let text = "import karat::expect_in_range;
    ///             @test fn stays(x: f32) { expect_in_range(0.5 * x, 0.0, 0.5); }";
    /// let package = Package::from_modules("m", [("half_test", text)]);
    /// let test = package.tests_in(&["half_test".to_owned()])?.remove(0)?.remove(0);
    /// let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// let x = Dynamic::new(test.parameters()?, vec![vec![part]]);
    /// test.probe()?.over_dynamic(x).cases(100).try_expects()?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// Returns the failure if an expectation fails, or the test evaluates no expectation.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn try_expects(self) -> Result<Agreement, Failure> {
        self.plan.expects(&*self.stream, &self.demand())
    }

    /// Checks the function's integral over directions. The direction is the function's last argument. The
    /// domain supplies the other arguments.
    ///
    /// # Errors
    /// See [`Check::try_integrates_to`].
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn try_integrates_to(
        self,
        directions: Directions,
        expect: ExpectWords<'_>,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        let assertion = Assertion::AgreesWith(self.plan.tolerances(tolerance.into()));
        self.integrate(directions, expect, assertion)
    }

    /// Checks that the function's integral over directions is at most a bound plus `slack`.
    ///
    /// # Errors
    /// See [`Check::try_integrates_to_at_most`].
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn try_integrates_to_at_most(
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
        let expected = |case: &Held, lanes: &mut Vec<f64>| expect(&case.row, lanes);
        self.integrate_over(directions, self.result()?, &expected, assertion)
    }

    fn result(&self) -> Result<Shape, Failure> {
        Ok(self.plan.function()?.result)
    }
}
