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
    ///
    /// ```
    /// # use karat::prelude::*;
    /// use karat::domain::{Dynamic, Part};
    /// use karat::value::{Scalar, Shape};
    ///
    /// let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// package.function("half").over_dynamic(x).stays_within(0.0, 0.5)?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
    pub fn over_dynamic(self, domain: Dynamic) -> DynamicCheck<'a> {
        DynamicCheck { plan: Plan::new(self), domain }
    }
}

/// A function with arguments that are chosen at run time. Each verb records its verdict and returns it.
///
/// ```
/// # use karat::domain::{Dynamic, Part};
/// # use karat::prelude::*;
/// # use karat::value::{Scalar, Shape};
/// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
/// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
/// # let x = Dynamic::new(&parameters, vec![vec![part]]);
/// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
/// let agreement = package.function("half").over_dynamic(x).cases(1000).is_finite()?;
/// assert_eq!(agreement.cases, 1000);
/// # Ok::<(), karat::check::Failure>(())
/// ```
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
    ///
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// package.function("half").over_dynamic(x).cases(1000).is_finite()?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
    pub fn cases(mut self, cases: u64) -> Self {
        self.plan.cases = Some(cases);
        self
    }

    /// See [`Check::seed`](super::Check::seed).
    ///
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// package.function("half").over_dynamic(x).seed(7).is_finite()?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
    pub fn seed(mut self, seed: u64) -> Self {
        self.plan.seed = Some(seed);
        self
    }

    /// See [`Check::tolerance_on`](super::Check::tolerance_on).
    ///
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// let check = package.function("half").over_dynamic(x).tolerance_on("metal", Ulp(4.0));
    /// let half = |x: &[u32], out: &mut Vec<f64>| out.push(0.5 * f64::from(f32::from_bits(x[0])));
    /// check.agrees_with(&half, Ulp(1.0))?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
    pub fn tolerance_on(
        mut self,
        on: impl Into<Selector>,
        tolerance: impl Into<Tolerance>,
    ) -> Self {
        self.plan.tolerance_on.declare(on.into(), tolerance.into());
        self
    }

    /// See [`Check::fails_on`](super::Check::fails_on).
    ///
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// let check = package.function("half").over_dynamic(x);
    /// check.fails_on("metal", "vendor bug 1234: half is rounded up").is_finite()?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
    pub fn fails_on(mut self, on: impl Into<Selector>, reason: &str) -> Self {
        self.plan.known_issues.declare(on.into(), reason);
        self
    }

    /// See [`Check::refused_on`](super::Check::refused_on).
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// use karat::domain::Dynamic;
    ///
    /// let package = Package::from_source("m", "fn one() -> f32 { return 1.0; }");
    /// let one = package.function("one").over_dynamic(Dynamic::new(&[], Vec::new()));
    /// one.refused_on("gl", "a compiler's bug 123").is_finite()?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
    pub fn refused_on(mut self, on: impl Into<Selector>, reason: &str) -> Self {
        self.plan.known_issues.declare_refusal(on.into(), reason);
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
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// let half = |words: &[u32], lanes: &mut Vec<f64>| lanes.push(0.5 * Scalar::F32.decode(words[0]));
    /// package.function("half").over_dynamic(x).agrees_with(&half, Ulp(0.0))?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
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
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// let text = "fn twice(x: f32) -> f32 { return x + x; }
    ///             fn product(x: f32) -> f32 { return 2.0 * x; }";
    /// let package = Package::from_source("m", text);
    /// package.function("twice").over_dynamic(x).agrees_with_function("product", Ulp(0.0))?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
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
    /// ```no_run
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// # let package = Package::from_source("m", "fn noise(x: f32) -> f32 { return fract(17.0 * x); }");
    /// let goldens = karat::Goldens::open("golden".as_ref());
    /// package.function("noise").over_dynamic(x).cases(64).matches(&goldens, "noise", Rel(1e-5))?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
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
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// package.function("half").over_dynamic(x).is_finite()?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
    ///
    /// # Errors
    /// See [`Check::try_is_finite`](super::Check::try_is_finite).
    pub fn is_finite(self) -> Result<Agreement, Failure> {
        let demand = self.demand();
        self.plan.is_finite(&self.domain, &demand, Recording::On)
    }

    /// See [`Check::stays_within`](super::Check::stays_within).
    ///
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// package.function("half").over_dynamic(x).stays_within(0.0, 0.5)?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
    ///
    /// # Errors
    /// See [`Check::try_stays_within`](super::Check::try_stays_within).
    pub fn stays_within(self, least: f64, most: f64) -> Result<Agreement, Failure> {
        let demand = self.demand();
        self.plan.stays_within(&self.domain, &demand, [least, most], Recording::On)
    }

    /// See [`Check::is_unit`](super::Check::is_unit).
    ///
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// let text = "fn turned(x: f32) -> vec2f { return vec2f(x, sqrt(1.0 - x * x)); }";
    /// let package = Package::from_source("m", text);
    /// package.function("turned").over_dynamic(x).is_unit()?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
    ///
    /// # Errors
    /// See [`Check::try_is_unit`](super::Check::try_is_unit).
    pub fn is_unit(self) -> Result<Agreement, Failure> {
        let demand = self.demand();
        self.plan.is_unit(&self.domain, &demand, Recording::On)
    }

    /// Checks that a statement holds for the words of arguments and result.
    ///
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// let smaller = |arguments: &[u32], result: &[u32]| {
    ///     f32::from_bits(result[0]) <= f32::from_bits(arguments[0])
    /// };
    /// package.function("half").over_dynamic(x).satisfies("is smaller", &smaller)?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
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
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// let package = Package::from_source("m", "fn bump(x: f32) -> f32 { return x * (1.0 - x); }");
    /// let mirrored = |words: &[u32], others: &mut Vec<u32>| {
    ///     others.push((1.0 - f32::from_bits(words[0])).to_bits());
    /// };
    /// package.function("bump").over_dynamic(x).invariant_under(&mirrored, Abs(1e-6))?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
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
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// package.function("half").over_dynamic(x).is_monotone_in("x", Trend::Increasing, Ulp(0.0))?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
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
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// let package = Package::from_source("m", "fn grow(x: f32) -> f32 { return exp2(x); }");
    /// let one = |_: &[u32], lanes: &mut Vec<f64>| lanes.push(1.0);
    /// let limit = Limit::toward(0.0, [0.1, 0.01, 0.001]);
    /// package.function("grow").over_dynamic(x).at_limit("x", &limit, &one, Abs(1e-3))?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
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
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let parameters = [("x".to_owned(), Shape::Scalar(Scalar::F32))];
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// # let x = Dynamic::new(&parameters, vec![vec![part]]);
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// package.function("half").over_dynamic(x).has_no_hazards()?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
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
    /// ```
    /// # use karat::domain::{Dynamic, Part};
    /// # use karat::prelude::*;
    /// # use karat::value::{Scalar, Shape};
    /// # let part = Part::range(Scalar::F32, 0.0..=1.0).expect("f32 holds both ends");
    /// let text = "import karat::expect_in_range;
    ///             @test fn stays(x: f32) { expect_in_range(0.5 * x, 0.0, 0.5); }";
    /// let package = Package::from_modules("m", [("half_test", text)]);
    /// let test = package.tests_in(&["half_test".to_owned()])?.remove(0)?.remove(0);
    /// let x = Dynamic::new(test.parameters()?, vec![vec![part]]);
    /// test.probe()?.over_dynamic(x).cases(100).expects()?;
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
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
    /// ```
    /// # use karat::prelude::*;
    /// use karat::domain::Dynamic;
    ///
    /// let package = Package::from_source("m", "fn one(l: vec3f) -> f32 { return 1.0; }");
    /// let area = |_: &[u32], lanes: &mut Vec<f64>| lanes.push(std::f64::consts::TAU);
    /// let one = package.function("one").over_dynamic(Dynamic::new(&[], Vec::new()));
    /// one.integrates_to(Directions::hemisphere(), &area, Rel(1e-6))?;
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
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
    /// ```
    /// # use karat::prelude::*;
    /// use karat::domain::Dynamic;
    ///
    /// let package = Package::from_source("m", "fn dim(l: vec3f) -> f32 { return 0.1; }");
    /// let one = |_: &[u32], lanes: &mut Vec<f64>| lanes.push(1.0);
    /// let dim = package.function("dim").over_dynamic(Dynamic::new(&[], Vec::new()));
    /// dim.integrates_to_at_most(Directions::hemisphere(), &one, 1e-6)?; // 0.2 pi
    /// # Ok::<(), karat::check::Failure>(())
    /// ```
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
