//! The report of a failed check, as text and as data.

use std::fmt;

use super::batch::SEARCHED;
use crate::diagnostic::Diagnostic;
use crate::judge::{Census, Judged};
use crate::output::counted;
use crate::path::Adapter;
use crate::probe::Inputs;
use crate::record::{CaseDetails, Details, ExpectationDetails, PathDetails, Replay};
use crate::reflect::Function;
use crate::run::Descent;
use crate::tolerance::{Abs, Rel, Tolerance, Ulp, Unit};
use crate::value::{Scalar, Shape, format_f32, hexfloat};

/// A failed check: the function's results violate the assertion on at least one path.
///
/// `Display` shows the function in the author's file. For each path, `Display` shows the number of failing
/// cases, the worst and the first failing case with their inputs, and the command that replays a case. If Karat
/// could simplify the worst case, `Display` shows the simplest case instead of the first.
///
/// ```
/// use karat::check::Failure;
/// use karat::prelude::*;
///
/// let package = Package::from_source("m", "fn f(x: f32) -> f32 { return 0.6 * x; }");
/// let wrong = package.function("f").over(0.1..=1.0).unrecorded().try_agrees_with(|x: f64| 0.5 * x, Ulp(1.0));
/// let Err(Failure::Disagreement(found)) = wrong else { panic!("it is 0.6") };
/// assert_eq!((found.function.name.as_str(), found.check), ("f", "agrees_with"));
/// for path in &found.paths {
///     println!("{} of {} cases fail on {}", path.census.failures, path.census.cases, path.adapter);
/// }
/// ```
#[derive(Clone, Debug)]
pub struct Disagreement {
    /// The function under test.
    pub function: Function,
    /// The verb, such as `agrees_with`.
    pub check: &'static str,
    /// The assertion: the tolerance, or the statement.
    pub assertion: String,
    /// The relation between the expected value and the actual value.
    pub expectation: Expectation,
    /// The domain, such as `x from 0 to 1`, if Karat reads the domain at run time, for example from a `*.test.toml`.
    /// Empty for a domain in Rust code.
    pub domain: String,
    /// The paths on which the check fails.
    pub paths: Vec<PathDisagreement>,
    /// The paths on which the check passes, each with the way in which the kernel got the arguments.
    pub agreeing: Vec<(Adapter, Inputs)>,
    /// The seed of the cases.
    pub seed: u64,
}

/// The relation that a check asserts between the expected and the actual value.
///
/// ```
/// # use karat::check::Failure;
/// # use karat::prelude::*;
/// # let package = Package::from_source("m", "fn f(x: f32) -> f32 { return 0.6 * x; }");
/// # let wrong = package.function("f").over(0.1..=1.0).unrecorded().try_agrees_with(|x: f64| 0.5 * x, Ulp(1.0));
/// let Err(Failure::Disagreement(found)) = wrong else { panic!("it is 0.6") };
/// assert_eq!(found.expectation.to_string(), "expected"); // what an integral may be `at most`
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Expectation {
    /// The actual value equals the expected value, within the tolerance.
    #[default]
    Equal,
    /// The actual value is at most the expected value.
    AtMost,
}

impl fmt::Display for Expectation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Equal => "expected",
            Self::AtMost => "at most",
        })
    }
}

/// The failures of a check on one path.
///
/// ```
/// # use karat::check::Failure;
/// # use karat::prelude::*;
/// # let package = Package::from_source("m", "fn f(x: f32) -> f32 { return 0.6 * x; }");
/// # let wrong = package.function("f").over(0.1..=1.0).unrecorded().try_agrees_with(|x: f64| 0.5 * x, Ulp(1.0));
/// let Err(Failure::Disagreement(found)) = wrong else { panic!("it is 0.6") };
/// for path in &found.paths {
///     println!("on {}: {}", path.adapter, path.worst.error);
///     println!("run it again: {}", path.replay);
/// }
/// ```
#[derive(Clone, Debug)]
pub struct PathDisagreement {
    /// The path, its adapter and its driver.
    pub adapter: Adapter,
    /// The way in which the kernel got the arguments: from a storage buffer, from a uniform buffer, or as
    /// constants.
    pub inputs: Inputs,
    /// The numbers of failing cases, by kind.
    pub census: Census,
    /// The property of the arguments that separates failing from passing cases, if there is one:
    /// `where x is at least 0.2 (this includes all failing cases and 0.4 % of the passing cases)`, or
    /// `everywhere except where a number in the arguments is 0`.
    pub cause: Option<String>,
    /// The case with the largest error.
    pub worst: CaseFailure,
    /// The failing case with the lowest index, if it isn't the worst case.
    pub first: Option<CaseFailure>,
    /// The command that runs the worst case again.
    pub replay: Replay,
    /// The simplest failing case that Karat found by simplifying the worst case. `None` if Karat found no simpler case.
    pub simplest: Option<Simplest>,
}

/// A simplification of the worst case. The simplified case fails the same check on the same path.
///
/// ```
/// # use karat::check::Failure;
/// # use karat::prelude::*;
/// # let package = Package::from_source("m", "fn f(x: f32) -> f32 { return 0.6 * x; }");
/// # let wrong = package.function("f").over(0.1..=1.0).unrecorded().try_agrees_with(|x: f64| 0.5 * x, Ulp(1.0));
/// let Err(Failure::Disagreement(found)) = wrong else { panic!("it is 0.6") };
/// if let Some(simplest) = &found.paths[0].simplest {
///     println!("the simplest case: {:?}", simplest.failure.arguments);
/// }
/// ```
#[derive(Clone, Debug)]
pub struct Simplest {
    /// The failure of the simplified case. `failure.case` is the index of the case that Karat simplified.
    pub failure: CaseFailure,
    /// The components of the arguments, as `u32` bits. Empty for an integral, because an integral's cases may
    /// have any type.
    pub input: Vec<u32>,
    /// The command that runs the simplest case again.
    pub replay: Replay,
    /// The steps of the simplification, for the replay.
    pub(crate) descent: Descent,
}

impl Simplest {
    pub(super) fn new(failure: CaseFailure, descent: Descent) -> Self {
        Self { failure, input: Vec::new(), replay: Replay::default(), descent }
    }
}

/// One failing case.
///
/// ```
/// # use karat::check::Failure;
/// # use karat::prelude::*;
/// # let package = Package::from_source("m", "fn f(x: f32) -> f32 { return 0.6 * x; }");
/// # let wrong = package.function("f").over(0.1..=1.0).unrecorded().try_agrees_with(|x: f64| 0.5 * x, Ulp(1.0));
/// let Err(Failure::Disagreement(found)) = wrong else { panic!("it is 0.6") };
/// let worst = &found.paths[0].worst;
/// assert_eq!(worst.arguments[0].0, "x");
/// println!("{:?}, expected {:?}", f32::from_bits(worst.actual), worst.expected);
/// ```
#[derive(Clone, Debug)]
pub struct CaseFailure {
    /// The index of the case.
    pub case: u64,
    /// `true` if the input comes from an earlier failure of this check. `false` if this run sampled the input.
    pub remembered: bool,
    /// `true` if no sampled case failed, and a search found this input. The search begins at the cases whose
    /// results are nearest to failing.
    pub searched: bool,
    /// Each argument's name, and its value in WGSL's syntax. For an integral, the first entry is `case` with the case's
    /// `Debug` text. The next entries are the arguments that have the same value at all nodes of the quadrature rule.
    pub arguments: Vec<(String, String)>,
    pub(crate) lane: usize,
    /// The name of the worst component, such as `".y"`. `""` for a scalar.
    pub component: String,
    /// The bits of the component's value. For an integral, the bits of the nearest `f32`.
    pub actual: u32,
    /// The component's expected value, or the bound on it. `None` if the check is a predicate.
    pub expected: Option<f64>,
    /// The type of the component.
    pub scalar: Scalar,
    /// The function's result, in WGSL's syntax.
    pub result: String,
    /// A note that says which results Karat compared, if a case calls the function more than once. Otherwise
    /// empty.
    pub compared: &'static str,
    /// The error in its unit, with the largest allowed error.
    pub error: String,
    /// Notes, each with a name and a text. The notes give the results that WGSL allows, and the path's first operation
    /// that returned a value outside of WGSL's bounds.
    pub explanation: Vec<(&'static str, String)>,
    /// The failing expectations of a test in WGSL.
    pub expectations: Vec<ExpectationDetails>,
    /// The integral, if the check integrates the function.
    pub integral: Option<IntegralFailure>,
}

/// An integral that fails its check.
///
/// ```
/// # use karat::check::Failure;
/// # use karat::prelude::*;
/// let package = Package::from_source("m", "fn f(x: f32) -> f32 { return x; }");
/// let midpoint = |&b: &f32| vec![(0.5 * b, f64::from(b))];
/// let integral = package.function("f").integral(0.1..=1.0, midpoint).cases(16);
/// let wrong = integral.unrecorded().try_agrees_with(|&b: &f32| f64::from(b), Rel(1e-6));
/// let Err(Failure::Disagreement(found)) = wrong else { panic!("it is b * b / 2") };
/// let integral = found.paths[0].worst.integral.as_ref().expect("it is one of integrals");
/// assert_eq!(integral.nodes, 1);
/// ```
#[derive(Clone, Debug)]
pub struct IntegralFailure {
    /// The value of the worst component, before rounding to `f32`.
    pub value: f64,
    /// The number of nodes of the quadrature rule.
    pub nodes: usize,
    /// The integral by a second quadrature rule and that rule's number of nodes, if this integral also fails
    /// the check.
    pub control: Option<(f64, usize)>,
    /// The first node at which the function's result isn't finite.
    pub node: Option<NodeFailure>,
}

/// A node of a quadrature rule at which the function returned NaN or an infinity.
///
/// ```
/// # use karat::check::Failure;
/// # use karat::prelude::*;
/// let package = Package::from_source("m", "fn f(x: f32) -> f32 { return log(x - 2.0); }");
/// let midpoint = |&b: &f32| vec![(0.5 * b, f64::from(b))];
/// let integral = package.function("f").integral(0.1..=1.0, midpoint).cases(16);
/// let wrong = integral.unrecorded().try_agrees_with(|&b: &f32| f64::from(b), Rel(1e-6));
/// if let Err(Failure::Disagreement(found)) = wrong {
///     let node = found.paths[0].worst.integral.as_ref().and_then(|integral| integral.node.as_ref());
///     println!("{:?}", node.map(|node| (&node.arguments, &node.result)));
/// }
/// ```
#[derive(Clone, Debug)]
pub struct NodeFailure {
    /// The node's index in the quadrature rule.
    pub index: usize,
    /// The node's weight.
    pub weight: f64,
    /// Each argument's name, and its value in WGSL's syntax.
    pub arguments: Vec<(String, String)>,
    /// The result of the function at the node.
    pub result: String,
}

impl CaseFailure {
    pub(super) fn new(
        function: &Function,
        case: u64,
        arguments: Vec<(String, String)>,
        actual: &[u32],
        expected: Option<&[f64]>,
        judged: &Judged,
    ) -> Self {
        let lane = judged.lane;
        let pick = |shape: &Shape| {
            let name = shape.lane_names().into_iter().nth(lane).unwrap_or_default();
            let scalar = shape.lanes().into_iter().nth(lane).unwrap_or(Scalar::F32);
            (name, scalar)
        };
        let (component, scalar) = pick(&function.result);
        let measure = judged.measure;
        let error = if !scalar.is_float() {
            match scalar {
                Scalar::Bool => "not equal".to_owned(),
                _ => "not equal: tolerances are only for floats".to_owned(),
            }
        } else if measure.error.is_nan() {
            "not a finite number".to_owned()
        } else {
            let bound = crate::tolerance::significant(measure.bound);
            let error = crate::tolerance::significant(measure.error);
            match measure.unit {
                Unit::Shader => format!(
                    "the shader is wrong: the reference is {error} away from the results that WGSL \
                     allows for this code"
                ),
                Unit::Driver => {
                    format!("the driver is wrong: its result is {error} away from WGSL's bounds")
                }
                Unit::Measured => format!(
                    "the driver is less exact here than Karat measured: its result is {error} \
                     away from the measured bounds"
                ),
                Unit::Conditioning => {
                    let expected = expected.and_then(|expected| expected.get(lane));
                    // A few operations can make a value below 1e-37 subnormal: smaller than 1.2e-38.
                    let flushed = expected.is_some_and(|value| value.abs() < 1e-37);
                    let advice = if flushed {
                        "; a driver may turn a value so near to 0 into 0: allow this with `Spec.or(Abs(1e-37))`, \
                         or in a test's file with `spec or abs 1e-37`"
                    } else {
                        ""
                    };
                    format!(
                        "ill-conditioned in this case: WGSL allows results with an error of rel {error} \
                         (the test allows {bound}){advice}"
                    )
                }
                Unit::Unbounded => "unbounded: WGSL allows any result in this case".to_owned(),
                unit => {
                    let actual = actual.get(lane).map(|word| scalar.decode(*word));
                    let expected = expected.and_then(|expected| expected.get(lane));
                    let others = actual.zip(expected).map(|(a, e)| others(unit, a, *e));
                    format!("{measure} ({bound} allowed){}", others.unwrap_or_default())
                }
            }
        };
        Self {
            case,
            remembered: false,
            searched: case >= SEARCHED,
            arguments,
            lane,
            component,
            actual: actual[lane],
            expected: expected.and_then(|expected| expected.get(lane)).copied(),
            scalar,
            result: function.result.format(actual),
            compared: "",
            error,
            explanation: Vec::new(),
            expectations: Vec::new(),
            integral: None,
        }
    }

    pub(super) fn of_integral(
        function: &Function,
        case: u64,
        argument: String,
        (integral, nodes, node): (&[f64], usize, Option<NodeFailure>),
        expected: &[f64],
        judged: &Judged,
    ) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "the failure has the f64, too")]
        let nearest: Vec<u32> = integral.iter().map(|value| (*value as f32).to_bits()).collect();
        let arguments = vec![("case".to_owned(), argument)];
        let failure = Self::new(function, case, arguments, &nearest, Some(expected), judged);
        let (value, control) = (integral[judged.lane], None);
        let integral = IntegralFailure { value, nodes, control, node };
        Self { integral: Some(integral), ..failure }
    }

    /// Adds the integral from a second quadrature rule, if there is a second rule.
    pub(super) fn with_control(mut self, control: Option<(f64, usize)>) -> Self {
        if let Some(integral) = &mut self.integral {
            integral.control = control;
        }
        self
    }

    /// Checks if this run sampled the case. The other cases are remembered, or found by a search.
    pub(super) fn is_drawn(&self) -> bool {
        !self.remembered && !self.searched
    }

    /// Writes the failure. `expectation` is the label before the expected value of an integral.
    fn write(&self, f: &mut fmt::Formatter<'_>, title: &str, expectation: &str) -> fmt::Result {
        match (self.searched, self.remembered) {
            (true, _) => writeln!(f, "  {title}found by a search)")?,
            (false, true) => writeln!(f, "  {title}remembered case {})", self.case)?,
            (false, false) => writeln!(f, "  {title}case {})", self.case)?,
        }
        if let Some(integral) = &self.integral {
            return self.write_integral(f, integral, expectation);
        }
        let names = self.arguments.iter().map(|(name, _)| name.len());
        let width = names.chain([8]).max().unwrap_or(8);
        for (name, value) in &self.arguments {
            writeln!(f, "    {name:>width$} = {value}")?;
        }
        if !self.result.is_empty() {
            writeln!(f, "    {:>width$} = {}", "returned", self.result)?;
        }
        if !self.compared.is_empty() {
            writeln!(f, "    {:>width$}   ({})", "", self.compared)?;
        }
        let place = self.place();
        let actual = f32::from_bits(self.actual);
        match (self.expected, self.scalar.is_float()) {
            (Some(expected), true) => {
                #[expect(clippy::cast_possible_truncation, reason = "shown beside the f64")]
                let nearest = expected as f32;
                writeln!(
                    f,
                    "    {:>width$} = {} ({}){place}",
                    "actual",
                    format_f32(actual),
                    hexfloat(actual)
                )?;
                writeln!(
                    f,
                    "    {:>width$} = {} ({})  nearest f32 of {expected}",
                    "expected",
                    format_f32(nearest),
                    hexfloat(nearest)
                )?;
                writeln!(f, "    {:>width$} = {}", "error", self.error)?;
                self.write_explanation(f, width)
            }
            (Some(expected), false) => {
                let actual = crate::value::format_lane(self.scalar, self.actual);
                writeln!(f, "    {:>width$} = {actual}{place}", "actual")?;
                let expected = match self.scalar {
                    Scalar::Bool => (expected != 0.0).to_string(),
                    _ => expected.to_string(),
                };
                writeln!(f, "    {:>width$} = {expected}", "expected")?;
                match self.scalar {
                    Scalar::Bool => Ok(()),
                    _ => writeln!(f, "    {:>width$} = {}", "error", self.error),
                }
            }
            (None, _) => self.write_explanation(f, width),
        }
    }

    fn write_explanation(&self, f: &mut fmt::Formatter<'_>, width: usize) -> fmt::Result {
        for expectation in &self.expectations {
            writeln!(f, "    {:>width$} = {expectation}", "failed")?;
        }
        self.explanation
            .iter()
            .try_for_each(|(name, text)| writeln!(f, "    {name:>width$} = {text}"))
    }
}

struct Told<'f> {
    failure: &'f CaseFailure,
    title: &'f str,
    expectation: &'f str,
}

impl fmt::Display for Told<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.failure.write(f, self.title, self.expectation)
    }
}

/// Builds the report's headline, which points at the function:
/// ``` `fresnel::schlick` fails stays_within: lies in 0..=1 ```.
pub(super) fn failed(function: &Function, check: &str, assertion: &str) -> Diagnostic {
    let message = format!("`{}` fails {check}: {assertion}", function.name);
    Diagnostic::new(message).at(first_line(function), "")
}

impl Disagreement {
    pub(super) fn details(&self) -> Details {
        Details {
            headline: failed(&self.function, self.check, &self.assertion).message,
            paths: self.paths.iter().map(PathDisagreement::details).collect(),
            ..Details::default()
        }
    }
}

impl PathDisagreement {
    /// The text about a path, without the path's name and the replay command. The simplest case comes first,
    /// because people read the first case.
    fn told(&self, expectation: &str) -> String {
        let Census { cases, failures, idle, remembered, .. } = self.census;
        let share = 100.0 * failures as f64 / cases as f64;
        let fail = if cases == 1 { "case fails" } else { "cases fail" };
        let mut text = format!("  {failures} of {cases} {fail} ({share:.3}%)");
        if remembered > 0 {
            text += &format!(", with {} from earlier failures", counted(remembered, "case"));
        }
        if idle > 0 {
            text += &format!(", {idle} cases evaluate no expectation");
        }
        text += &self.census.ways();
        text.push('\n');
        if let Some(cause) = &self.cause {
            text += &format!("  it fails {cause}\n");
        }
        let mut write = |failure: &CaseFailure, title| {
            text += &Told { failure, title, expectation }.to_string();
        };
        match &self.simplest {
            Some(simplest) => {
                write(&simplest.failure, "simplest (reduced from ");
                write(&self.worst, "worst (");
            }
            None => {
                write(&self.worst, "worst (");
                self.first.iter().for_each(|first| write(first, "first ("));
            }
        }
        text
    }

    /// The command that runs the simplest case again. If there is no simplest case, the command that runs the
    /// worst case again.
    fn replay(&self) -> &Replay {
        self.simplest.as_ref().map_or(&self.replay, |one| &one.replay)
    }

    fn details(&self) -> PathDetails {
        let case = |failure: &CaseFailure, replay: Option<&Replay>| {
            Some(CaseDetails { replay: replay.cloned(), ..failure.details() })
        };
        let simplest = self.simplest.as_ref();
        PathDetails {
            cause: self.cause.clone(),
            worst: case(&self.worst, Some(&self.replay)),
            first: self.first.as_ref().and_then(|first| case(first, None)),
            simplest: simplest.and_then(|one| case(&one.failure, Some(&one.replay))),
            ..PathDetails::on(&self.adapter)
        }
    }
}

impl CaseFailure {
    fn details(&self) -> CaseDetails {
        let expected = |value: f64| match self.scalar {
            Scalar::Bool => (value != 0.0).to_string(),
            _ => value.to_string(),
        };
        let actual = match &self.integral {
            Some(integral) => integral.value.to_string(),
            None if self.expected.is_none() => String::new(),
            None => crate::value::format_lane(self.scalar, self.actual),
        };
        let note = |(name, text): &(&str, String)| ((*name).to_owned(), text.clone());
        CaseDetails {
            case: self.case,
            arguments: self.arguments.clone(),
            result: self.result.clone(),
            component: self.component.clone(),
            expected: self.expected.map(expected).unwrap_or_default(),
            error: if actual.is_empty() { String::new() } else { self.error.clone() },
            actual,
            notes: self.explanation.iter().map(note).collect(),
            expectations: self.expectations.clone(),
            replay: None,
        }
    }

    fn place(&self) -> String {
        if self.component.is_empty() { String::new() } else { format!("  at {}", self.component) }
    }

    fn write_integral(
        &self,
        f: &mut fmt::Formatter<'_>,
        integral: &IntegralFailure,
        expectation: &str,
    ) -> fmt::Result {
        let names = self.arguments.iter().map(|(name, _)| name.len());
        let width = names.chain([8]).max().unwrap_or(8);
        for (name, value) in &self.arguments {
            writeln!(f, "    {name:>width$} = {value}")?;
        }
        let nodes = integral.nodes;
        writeln!(f, "    {:>width$} = {}  over {nodes} nodes", "integral", self.result)?;
        if let Some(NodeFailure { index, weight, arguments, result }) = &integral.node {
            let list: Vec<_> = arguments.iter().map(|(name, v)| format!("{name} = {v}")).collect();
            let list = list.join(", ");
            writeln!(f, "    {:>width$} = {index}: {list} (weight {weight})", "node")?;
            writeln!(f, "    {:>width$} = {result}", "returned")?;
        } else {
            writeln!(f, "    {:>width$} = {}{}", "actual", decimal(integral.value), self.place())?;
        }
        if let Some((value, nodes)) = integral.control {
            // If the integrals by the two rules differ much, both rules may be too coarse.
            let apart = (value - integral.value).abs();
            let is_coarse =
                self.expected.is_some_and(|e| apart > 0.25 * (integral.value - e).abs());
            let hint = match is_coarse {
                true => "; the two quadrature rules disagree: try more `rings`",
                false => "",
            };
            let value = decimal(value);
            writeln!(
                f,
                "    {:>width$} = {value}  over {nodes} nodes (this integral is wrong too){hint}",
                "control"
            )?;
        }
        if let Some(expected) = self.expected {
            writeln!(f, "    {expectation:>width$} = {}", decimal(expected))?;
        }
        writeln!(f, "    {:>width$} = {}", "error", self.error)
    }
}

/// The error in the units that the tolerance doesn't use: `, rel 2.4e-7, abs 1e-8`.
fn others(unit: Unit, actual: f64, expected: f64) -> String {
    if !matches!(unit, Unit::Ulp | Unit::Rel | Unit::Abs) {
        return String::new();
    }
    // These tolerances only measure errors, so their bounds have no effect.
    let tolerances: [(Unit, Tolerance); 3] =
        [(Unit::Ulp, Ulp(1.0).into()), (Unit::Rel, Rel(1.0).into()), (Unit::Abs, Abs(1.0).into())];
    let wanted = tolerances.iter().filter(|(other, _)| *other != unit);
    let measured = wanted.map(|(_, tolerance)| tolerance.measure_sum(0, actual, expected));
    measured.filter(|other| other.error.is_finite()).map(|other| format!(", {other}")).collect()
}

/// Formats an `f64` in decimal, with an exponent if plain digits would be long.
fn decimal(value: f64) -> String {
    if value == 0.0 || (1e-4..1e7).contains(&value.abs()) || !value.is_finite() {
        format!("{value}")
    } else {
        format!("{value:e}")
    }
}

impl fmt::Display for Disagreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", failed(&self.function, self.check, &self.assertion))?;
        if !self.domain.is_empty() {
            writeln!(f, "arguments: {}", self.domain)?;
        }
        let expectation = &self.expectation.to_string();
        // Paths with the same values share one text in the report.
        let mut told: Vec<(Vec<&PathDisagreement>, String)> = Vec::new();
        for path in &self.paths {
            let text = path.told(expectation);
            match told.iter_mut().find(|(_, known)| *known == text) {
                Some((paths, _)) => paths.push(path),
                None => told.push((vec![path], text)),
            }
        }
        for (paths, text) in &told {
            writeln!(f)?;
            for path in paths {
                writeln!(f, "on {}{}", path.adapter, path.inputs.remark())?;
            }
            f.write_str(text)?;
            writeln!(f, "  replay: {}", paths[0].replay())?;
        }
        for (adapter, inputs) in &self.agreeing {
            writeln!(f, "\non {adapter}{}\n  all cases agree", inputs.remark())?;
        }
        Ok(())
    }
}

/// The span of the first line of the function, from `fn` on.
fn first_line(function: &Function) -> crate::diagnostic::Span {
    let mut span = function.span.clone();
    let text = span.file.text.get(span.range.clone()).unwrap_or_default();
    let head = text.find('\n').unwrap_or(text.len());
    span.range.end = span.range.start + text[..head].trim_end().len();
    span
}
