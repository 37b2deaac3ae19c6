//! Judges the contents of resources after passes.

use std::fmt;
use std::panic::Location;

use super::{After, ComputeAgreement, ComputeError, words};
use crate::dispatch::Passes;
use crate::executor::{Executor, View};
use crate::interpret::hazards::first_not_finite;
use crate::judge::{self, Census, Class, Picked, Shown, Tally, compare};
use crate::path::Adapter;
use crate::record::{CaseDetails, Details, PathDetails, PathRecord, Replay, Subject};
use crate::run::sound_paths;
use crate::run::{Identity, Judged, Replayed, Report, replay, reported};
use crate::tolerance::{LaneError, Tolerance};
use crate::value::{Scalar, Shape, hexfloat};

pub(super) enum Assertion<'a> {
    Agrees(Expected, Tolerance),
    Each(Each<'a>),
    Holds(Statement<'a>),
}

pub(super) struct Each<'a> {
    pub(super) text: &'a str,
    pub(super) shape: Shape,
    /// A phrase for messages that describes the numbers that satisfy the statement: `a finite number`.
    pub(super) expected: &'a str,
    pub(super) holds: &'a (dyn Fn(Scalar, f64) -> bool + Sync),
}

pub(super) struct Expected {
    pub(super) shape: Shape,
    pub(super) lanes: Vec<f64>,
}

pub(super) struct Statement<'a> {
    pub(super) text: String,
    pub(super) shape: Shape,
    /// `true` if the passes may leave the resource unchanged.
    pub(super) may_stay: bool,
    /// `true` if the caller knew the verdict before the passes ran (see `settled` in `untyped.rs`).
    pub(super) settled: bool,
    pub(super) breaks: &'a dyn Fn(&[u32]) -> Option<Broken>,
}

/// The elements that break a statement.
///
/// ```
/// let whole = karat::unstable::compute::Broken { failures: 1, first: None };
/// assert!(whole.first.is_none());
/// ```
#[derive(Clone, Debug)]
pub struct Broken {
    /// The number of elements that break the statement. It is 1 if the statement is about all elements together, such
    /// as their sum.
    pub failures: usize,
    /// The first element that breaks the statement. It is `None` if the statement is about all elements together.
    pub first: Option<Element>,
}

/// A failed comparison of a resource, with the elements that differ on each path.
///
/// ```
/// use karat::compute::ComputeError;
/// # use karat::prelude::*;
///
/// # let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
/// #             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
/// # let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([0_u32])).dispatch("count", [1, 1, 1]);
/// let wrong = passes.after("data").unrecorded().try_agrees_with([8_u32], Abs(0.0));
/// if let Err(ComputeError::Differs(difference)) = wrong {
///     println!("{} differs after {}", difference.variable, difference.entry_points);
/// }
/// ```
#[derive(Clone, Debug)]
pub struct Difference {
    /// The entry points in dispatch order, separated by commas.
    pub entry_points: String,
    /// The name of the resource's variable.
    pub variable: String,
    /// The assertion that fails.
    pub assertion: String,
    /// The file and line of the last pass's entry point.
    pub location: String,
    /// The results on each path that fails.
    pub paths: Vec<PathDifference>,
    /// The paths that pass.
    pub agreeing: Vec<Adapter>,
    /// The first operation that gave NaN or an infinity, if an element has such a value: ``first NaN: `a / b` of 0, 0
    /// (sum.wgsl:4:9)``.
    pub not_finite: Option<String>,
}

/// The elements that differ on one path.
///
/// ```
/// # use karat::compute::ComputeError;
/// # use karat::prelude::*;
/// # let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
/// #             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
/// # let package = Package::from_source("m", text);
/// # let passes = package.compute().with("data", Storage::new([0_u32])).dispatch("count", [1, 1, 1]);
/// let wrong = passes.after("data").unrecorded().try_agrees_with([8_u32], Abs(0.0));
/// if let Err(ComputeError::Differs(difference)) = wrong {
///     for path in &difference.paths {
///         println!("{} of {} on {}", path.census.failures, path.elements, path.adapter);
///     }
/// }
/// ```
#[derive(Clone, Debug)]
pub struct PathDifference {
    /// The path, its adapter and its driver.
    pub adapter: Adapter,
    /// The number of compared elements.
    pub elements: usize,
    /// The number and kinds of the failures.
    pub census: Census,
    /// The first failing element, and the element with the largest error.
    pub shown: Vec<Element>,
    /// The command that repeats the passes on this path.
    pub replay: Replay,
}

/// One element that differs.
///
/// ```
/// # use karat::compute::ComputeError;
/// # use karat::prelude::*;
/// # let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
/// #             @compute @workgroup_size(1) fn count() { data[0] = 7u; }";
/// # let package = Package::from_source("m", text);
/// # let passes = package.compute().with("data", Storage::new([0_u32])).dispatch("count", [1, 1, 1]);
/// let wrong = passes.after("data").unrecorded().try_agrees_with([8_u32], Abs(0.0));
/// if let Err(ComputeError::Differs(difference)) = wrong {
///     for one in &difference.paths[0].shown {
///         println!("{}: {}, expected {}", one.place, one.actual, one.expected);
///     }
/// }
/// ```
#[derive(Clone, Debug)]
pub struct Element {
    /// The position of the element in the resource.
    pub place: Place,
    /// The value that the passes computed.
    pub actual: String,
    /// The value that the assertion expects.
    pub expected: String,
    /// The error of the value, as text. It is empty if the assertion is a statement.
    pub error: String,
}

/// The position of a difference in a resource.
///
/// ```
/// use karat::unstable::compute::Place;
///
/// let texel = Some("[3, 1]".to_owned());
/// let place = Place::Element { index: 9, component: ".x".to_owned(), texel };
/// assert_eq!(place.to_string(), "[3, 1].x");
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Place {
    /// One element of the resource.
    Element {
        /// The index of the element. Texels are counted row by row from the top.
        index: usize,
        /// The component, such as `.x`. It is empty for the whole element.
        component: String,
        /// Another name for the element: a texel's column and row, `[3, 1]`, or its position in a grid,
        /// `[9: row 1, column 3]`.
        texel: Option<String>,
    },
    /// The whole resource, with a phrase for the message.
    Whole(String),
}

impl Place {
    pub(super) fn of_element(index: usize, component: &str) -> Self {
        Self::Element { index, component: component.to_owned(), texel: None }
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Element { component, texel: Some(texel), .. } => write!(f, "{texel}{component}"),
            Self::Element { index, component, texel: None } => write!(f, "[{index}]{component}"),
            Self::Whole(words) => f.write_str(words),
        }
    }
}

impl Sum {
    /// Summarizes a tally. The summary contains the first failing element, and the element with the largest error.
    fn of(tally: Tally, element: &dyn Fn(Shown) -> Element) -> Self {
        let worst = tally.worst.map_or(LaneError::ZERO, |worst| worst.judged.measure);
        let first = tally.first;
        let other = tally.worst.filter(|worst| first.is_some_and(|first| first.case != worst.case));
        let is_worse = |one: &Shown| {
            first.is_none_or(|first| one.judged.measure.is_worse_than(&first.judged.measure))
        };
        let shown = first.into_iter().chain(other.filter(is_worse)).map(element).collect();
        Self { census: tally.census, worst, shown }
    }

    /// Adds to each shown element its column and row in the texture, or its row and column in the grid.
    pub(super) fn named(
        mut self,
        passes: &Passes,
        resource: usize,
        grid: Option<[usize; 2]>,
    ) -> Self {
        let in_grid = |index: usize| {
            let [_, columns] = grid?;
            Some(format!("[{index}: row {}, column {}]", index / columns, index % columns))
        };
        for one in &mut self.shown {
            if let Place::Element { index, texel, .. } = &mut one.place {
                *texel = passes.texel(resource, *index).or_else(|| in_grid(*index));
            }
        }
        self
    }

    pub(super) fn of_failures(failures: usize, shown: Option<Element>) -> Self {
        let census = Census { failures: failures as u64, ..Census::default() };
        let worst = LaneError::statement(failures == 0);
        Self { census, worst, shown: shown.into_iter().collect() }
    }

    /// The result for passes in which a loop doesn't end: one failure of the whole resource.
    pub(super) fn endless() -> Self {
        let element = Element {
            place: Place::Whole("no result".to_owned()),
            actual: "a loop doesn't end".to_owned(),
            expected: "each loop ends, in each order of the invocations".to_owned(),
            error: String::new(),
        };
        Self::of_failures(1, Some(element))
    }
}

struct Outcome {
    elements: usize,
    sum: Sum,
    replay: Replay,
}

pub(super) struct Sum {
    pub(super) census: Census,
    worst: LaneError,
    pub(super) shown: Vec<Element>,
}

impl After<'_> {
    /// Dispatches the passes on each path, judges the results, and records the verdict.
    pub(super) fn judge(
        &self,
        assertion: Assertion<'_>,
        place: &'static Location<'static>,
    ) -> Result<ComputeAgreement, ComputeError> {
        let verb = assertion.verb();
        self.report((verb, assertion.text()), place, |report| self.judged(&assertion, verb, report))
    }

    pub(super) fn report(
        &self,
        (verb, text): (&str, String),
        place: &'static Location<'static>,
        judge: impl FnOnce(&mut Report) -> Result<ComputeAgreement, ComputeError>,
    ) -> Result<ComputeAgreement, ComputeError> {
        let subject = Subject::Function {
            package: self.compute.package.root().display().to_string(),
            function: self.last_entry_point().to_owned(),
            check: self.check(verb),
            assertion: text,
            location: place.to_string(),
            domain: String::new(),
            seed: 0,
        };
        reported(subject, &|| self.recorded, judge)
    }

    /// The check's name in records: `after.data.agrees_with`.
    pub(super) fn check(&self, verb: &str) -> String {
        format!("after.{}.{verb}", self.variable)
    }

    pub(super) fn last_entry_point(&self) -> &str {
        self.compute.wanted.last().map_or("", |wanted| &wanted.name)
    }

    /// Judges an assertion on each path. `verb` is the name of the assertion's method, such as `agrees_with`.
    pub(super) fn judged(
        &self,
        assertion: &Assertion<'_>,
        verb: &str,
        report: &mut Report,
    ) -> Result<ComputeAgreement, ComputeError> {
        let function = self.last_entry_point();
        let compute = &self.compute;
        let identity = Identity::of(function, &self.check(verb))?;
        if identity.case(function, &identity.check).is_some() {
            replay::done();
        }
        compute.known_issues.expect_sound::<ComputeError>(&self.variable)?;
        sound_paths("tolerance_on", &compute.tolerance_on)?;
        let executors = self.executors()?;
        let passes = compute.passes()?;
        report.read.extend(passes.read());
        let (part, shape) = passes.written(&self.variable)?;
        let element = self.fitting(assertion, &passes, &shape)?;
        if let (Some(span), Subject::Function { location, .. }) =
            (passes.span(), &mut report.subject)
        {
            *location = span.to_string();
        }
        let replayed = || Replayed { case: 0, steps: &[], input: None };
        let again = identity.replay(None, 0, function, &identity.check, replayed());
        let asserted = Some((assertion, &part, &element));
        self.expect_each_order(asserted, &passes, report, &again)?;
        let has_subgroups = passes.has_subgroups();
        let on_path = &mut |executor: &dyn Executor, adapter: &Adapter| {
            let path = executor.path();
            let own = compute.tolerance_on.on(path, adapter);
            let found = words(executor, &passes, &part)?;
            let elements = found.len() / element.lanes().len().max(1);
            if elements == 0 {
                let reason = format!("`{}` has no elements", self.variable);
                return Err(ComputeError::Nothing(reason));
            }
            if let Some(grid) =
                self.grid.filter(|[rows, columns]| rows.checked_mul(*columns) != Some(elements))
            {
                let variable = self.variable.clone();
                return Err(ComputeError::Grid { variable, elements, grid });
            }
            let sum = self.sum(assertion, own, &element, &found, function)?;
            let sum = sum.named(&passes, part.number, self.grid);
            // Passes that change nothing are reported only if no element fails, and if they must change the resource.
            let may_stay = matches!(assertion, Assertion::Holds(one) if one.may_stay);
            if sum.census.failures == 0
                && !may_stay
                && passes.before(part.number).is_some_and(|before| part.pick(before) == found)
            {
                return Err(ComputeError::Unchanged { variable: self.variable.clone() });
            }
            let record = PathRecord {
                cases: elements as u64,
                failures: sum.census.failures,
                worst: sum.worst.to_string(),
                ratio: sum.worst.ratio.is_finite().then_some(sum.worst.ratio),
                asserted: match own {
                    Some(own) => format!("{}; on {path} {own}", assertion.text()),
                    None => assertion.text(),
                },
                subgroups: executor.subgroups().filter(|_| has_subgroups),
                ..PathRecord::of(adapter.clone())
            };
            let selectable = compute.executors.is_empty().then_some(path);
            let replay = identity.replay(selectable, 0, function, &identity.check, replayed());
            Ok(Judged { record, values: Outcome { elements, sum, replay } })
        };
        let all = compute.known_issues.conclude(
            &self.variable,
            &executors,
            false,
            &mut report.paths,
            on_path,
        );
        let differ = |differing: Vec<(Adapter, Outcome)>, agreeing: &[(Adapter, Outcome)]| {
            let entry_points: Vec<&str> = passes.entry_points().collect();
            let is_bad = |one: &Element| one.actual.contains("NaN") || one.actual.contains("inf");
            let is_bad = differing.iter().any(|(_, one)| one.sum.shown.iter().any(is_bad));
            let inside = is_bad.then(|| crate::interpret::passes::hazards(&passes).ok()).flatten();
            let first = inside.and_then(|all| first_not_finite(all.iter().map(|one| &one.found)));
            let not_finite = first.map(|(name, text)| format!("{name}: {text}"));
            let paths = differing.into_iter().map(|(adapter, one)| {
                let Outcome { elements, sum: Sum { census, shown, .. }, replay } = one;
                PathDifference { adapter, elements, census, shown, replay }
            });
            vec![ComputeError::Differs(Box::new(Difference {
                entry_points: entry_points.join(", "),
                variable: self.variable.clone(),
                assertion: assertion.text(),
                location: passes.span().map_or_else(String::new, |span| span.to_string()),
                paths: paths.collect(),
                agreeing: agreeing.iter().map(|(adapter, _)| adapter.clone()).collect(),
                not_finite,
            }))]
        };
        let (agreed, known_issues) = all.verdict(differ)?;
        let known = known_issues
            .iter()
            .map(|issue| usize::try_from(issue.cases).expect("they were in memory"));
        let elements = agreed.iter().map(|(_, one)| one.elements).chain(known).max().unwrap_or(0);
        let paths = agreed.into_iter().map(|(adapter, one)| (adapter, one.sum.worst)).collect();
        Ok(ComputeAgreement { variable: self.variable.clone(), elements, paths, known_issues })
    }

    /// Checks that the assertion fits the resource, and returns the type of an element.
    fn fitting(
        &self,
        assertion: &Assertion<'_>,
        passes: &Passes,
        shape: &Shape,
    ) -> Result<Shape, ComputeError> {
        match assertion {
            Assertion::Agrees(expected, tolerance) => {
                let who = "the reference gives";
                let element = self.element(passes, shape, &expected.shape, who, true)?;
                let own = self.compute.tolerance_on.iter().map(|(_, tolerance)| tolerance);
                for tolerance in own.chain([tolerance]) {
                    if let Some(bound) = tolerance.unusable() {
                        let tolerance = tolerance.clone();
                        return Err(ComputeError::Bound { tolerance, bound });
                    }
                }
                let width = element.lanes().len().max(1);
                if let Some(at) = expected.lanes.iter().position(|value| !value.is_finite()) {
                    let (variable, value) = (self.variable.clone(), expected.lanes[at]);
                    return Err(ComputeError::Reference { variable, index: at / width, value });
                }
                if expected.lanes.is_empty() {
                    let reason = "the reference has no elements".to_owned();
                    return Err(ComputeError::Nothing(reason));
                }
                Ok(element)
            }
            Assertion::Each(Each { shape: own, .. })
            | Assertion::Holds(Statement { shape: own, .. }) => {
                self.element(passes, shape, own, "the statement takes", false)
            }
        }
    }

    pub(super) fn sum(
        &self,
        assertion: &Assertion<'_>,
        own: Option<&Tolerance>,
        shape: &Shape,
        found: &[u32],
        entry_point: &str,
    ) -> Result<Sum, ComputeError> {
        let (scalars, names) = (shape.lanes(), shape.lane_names());
        let width = scalars.len().max(1);
        let view = |words| View { words, stride: width, width };
        let element = |(at, word, lane): (usize, u32, usize), expected: String, error: String| {
            let scalar = scalars[lane];
            let bits = match scalar.is_float() {
                true => format!(" ({})", hexfloat(f32::from_bits(word))),
                false => String::new(),
            };
            let actual = format!("{}{bits}", crate::value::format_lane(scalar, word));
            let place = Place::of_element(at / width, &names[at % width]);
            Element { place, actual, expected, error }
        };
        let (expected, tolerance) = match assertion {
            Assertion::Agrees(expected, tolerance) => (expected, own.unwrap_or(tolerance)),
            Assertion::Each(Each { expected, holds, .. }) => {
                let judge = |_: usize, actual: &[u32]| each(&scalars, actual, holds);
                let sum = judge::tally(0, view(found), &judge, &mut Picked::default());
                return Ok(Sum::of(sum, &|shown| {
                    let (lane, at) = (shown.judged.lane, shown.at(width));
                    element((at, found[at], lane), (*expected).to_owned(), String::new())
                }));
            }
            Assertion::Holds(statement) => {
                let broken = (statement.breaks)(found);
                let failures = broken.as_ref().map_or(0, |broken| broken.failures.max(1));
                return Ok(Sum::of_failures(failures, broken.and_then(|broken| broken.first)));
            }
        };
        if expected.lanes.len() != found.len() {
            return Err(ComputeError::Count {
                variable: self.variable.clone(),
                entry_point: entry_point.to_owned(),
                found: found.len() / width,
                expected: expected.lanes.len() / width,
            });
        }
        // For each number that is compared, in order, its index in the resource.
        let (places, wanted) = match self.up_to_order {
            true => {
                let (before, scalars) = listed(shape);
                let (head, items) = found.split_at(before.min(found.len()));
                let (wanted_head, wanted) = expected.lanes.split_at(head.len());
                let (order, wanted) = matched((items, &scalars), wanted, tolerance);
                let of_items = order.into_iter().map(|lane| head.len() + lane);
                ((0..head.len()).chain(of_items).collect(), [wanted_head, &wanted].concat())
            }
            false => ((0..found.len()).collect::<Vec<_>>(), expected.lanes.clone()),
        };
        let found: Vec<u32> = places.iter().map(|lane| found[*lane]).collect();
        let judge = |case: usize, actual: &[u32]| {
            compare(&scalars, actual, &wanted[case * width..][..width], tolerance)
        };
        let sum = judge::tally(0, view(&found), &judge, &mut Picked::default());
        Ok(Sum::of(sum, &|shown| {
            let at = shown.at(width);
            let (expected, error) = (wanted[at].to_string(), shown.judged.measure.to_string());
            element((places[at], found[at], shown.judged.lane), expected, error)
        }))
    }
}

/// Judges an element. The element fails if one of its numbers breaks the statement. The message shows the first number
/// that breaks the statement.
fn each(scalars: &[Scalar], actual: &[u32], holds: &dyn Fn(Scalar, f64) -> bool) -> judge::Judged {
    let value = |lane: usize| scalars[lane].decode(actual[lane]);
    let broken = (0..actual.len()).find(|lane| !holds(scalars[*lane], value(*lane)));
    let measure = LaneError::statement(broken.is_none());
    judge::Judged { measure, lane: broken.unwrap_or(0), class: Class::Other }
}

/// Finds the scalars that `up_to_order` sorts. In a structure that ends with an array, such as `{ count: atomic<u32>,
/// items: array<Item> }`, `up_to_order` sorts only the array's elements. Otherwise it sorts the elements of the
/// resource. Returns the number of scalars before the sorted elements, and the types of the scalars in one sorted
/// element.
fn listed(element: &Shape) -> (usize, Vec<Scalar>) {
    if let Shape::Struct { members, .. } = element
        && let Some((_, list @ Shape::Array { element: item, .. })) = members.last()
    {
        return (element.lanes().len() - list.lanes().len(), item.lanes());
    }
    (0, element.lanes())
}

/// Pairs actual and expected elements without regard to their order. Returns the indices of the actual scalars, and the
/// expected values. Both lists are in the order of the pairs. The function sorts the actual and the expected elements
/// by value, and pairs each actual element with the next expected element if their difference is within the tolerance.
/// At the end, pairs the remaining elements with each other.
fn matched(
    (found, scalars): (&[u32], &[Scalar]),
    wanted: &[f64],
    tolerance: &Tolerance,
) -> (Vec<usize>, Vec<f64>) {
    let width = scalars.len().max(1);
    let values = |words: &[u32]| -> Vec<f64> {
        words.iter().zip(scalars).map(|(word, scalar)| scalar.decode(*word)).collect()
    };
    let mut items: Vec<(usize, Vec<f64>)> =
        found.chunks_exact(width).map(values).enumerate().collect();
    items.sort_by(|(_, a), (_, b)| by_value(a, b));
    let mut expected: Vec<&[f64]> = wanted.chunks_exact(width).collect();
    expected.sort_by(|a, b| by_value(a, b));
    let (mut items, mut expected) = (items.into_iter().peekable(), expected.into_iter().peekable());
    let (mut pairs, mut strange, mut missing) = (Vec::new(), Vec::new(), Vec::new());
    while let (Some((at, item)), Some(one)) = (items.peek(), expected.peek()) {
        let words = &found[at * width..][..width];
        let near = tolerance.measure_words(scalars, words, one).1.passes();
        let order = by_value(item, one);
        if near {
            pairs.extend(items.next().map(|(at, _)| at).zip(expected.next()));
        } else if order.is_lt() {
            strange.extend(items.next().map(|(at, _)| at));
        } else {
            missing.extend(expected.next());
        }
    }
    strange.extend(items.map(|(at, _)| at));
    missing.extend(expected);
    pairs.extend(strange.into_iter().zip(missing));
    let (order, expected): (Vec<usize>, Vec<&[f64]>) = pairs.into_iter().unzip();
    let lanes = order.into_iter().flat_map(|at| at * width..(at + 1) * width);
    (lanes.collect(), expected.concat())
}

fn by_value(a: &[f64], b: &[f64]) -> std::cmp::Ordering {
    // Both zeros count as the same value.
    let each = a.iter().zip(b).map(|(a, b)| (a + 0.0).total_cmp(&(b + 0.0)));
    each.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
}

impl Assertion<'_> {
    fn verb(&self) -> &'static str {
        match self {
            Self::Agrees(..) => "agrees_with",
            Self::Each(_) | Self::Holds(_) => "satisfies",
        }
    }

    /// Checks if the caller knew the assertion's verdict before the passes ran. Such a verdict doesn't depend on the
    /// order of invocations.
    pub(super) fn is_settled(&self) -> bool {
        matches!(self, Self::Holds(statement) if statement.settled)
    }

    /// The assertion as a clause for messages: `elements agree within 0.1`.
    pub(super) fn holds(&self) -> String {
        match self {
            Self::Agrees(_, tolerance) => format!("elements agree within {tolerance}"),
            Self::Each(one) => one.text.to_owned(),
            Self::Holds(statement) => statement.text.clone(),
        }
    }

    fn text(&self) -> String {
        match self {
            Self::Agrees(_, tolerance) => tolerance.to_string(),
            Self::Each(one) => one.text.to_owned(),
            Self::Holds(statement) => statement.text.clone(),
        }
    }
}

impl Difference {
    pub(super) fn details(&self) -> Details {
        let Self { entry_points, variable, assertion, .. } = self;
        let headline = format!("`{variable}` after `{entry_points}` fails: {assertion}");
        Details {
            headline,
            paths: self.paths.iter().map(PathDifference::details).collect(),
            ..Details::default()
        }
    }
}

impl PathDifference {
    fn details(&self) -> PathDetails {
        let case = |element: &Element| CaseDetails {
            component: element.place.to_string(),
            actual: element.actual.clone(),
            expected: element.expected.clone(),
            error: element.error.clone(),
            ..CaseDetails::default()
        };
        // The first failing case, if it differs from the worst case.
        let first = self.shown.first().map(case);
        let worst = self.shown.get(1).map(case);
        let (worst, first) = if worst.is_some() { (worst, first) } else { (first, None) };
        let worst = CaseDetails { replay: Some(self.replay.clone()), ..worst.unwrap_or_default() };
        PathDetails { worst: Some(worst), first, ..PathDetails::on(&self.adapter) }
    }
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { entry_points, variable, assertion, location, .. } = self;
        writeln!(f, "error: `{variable}` after `{entry_points}` fails: {assertion}")?;
        if !location.is_empty() {
            writeln!(f, "  --> {location}")?;
        }
        for path in &self.paths {
            writeln!(f, "on {}", path.adapter)?;
            let failures = path.census.failures;
            let compares = path.shown.iter().all(|one| !one.error.is_empty());
            if path.shown.is_empty() {
                writeln!(
                    f,
                    "  the assertion about all {} elements together is false",
                    path.elements
                )?;
            } else if !compares {
                writeln!(f, "  {failures} of {} elements break the assertion", path.elements)?;
            } else {
                let share = 100.0 * failures as f64 / path.elements as f64;
                let (elements, ways) = (path.elements, path.census.ways());
                writeln!(f, "  {failures} of {elements} elements differ ({share:.3}%){ways}")?;
            }
            for (element, what) in path.shown.iter().zip(["first", "worst"]) {
                writeln!(f, "  {what}: {}", element.place)?;
                writeln!(f, "      actual = {}", element.actual)?;
                writeln!(f, "    expected = {}", element.expected)?;
                if !element.error.is_empty() {
                    writeln!(f, "       error = {}", element.error)?;
                }
            }
            writeln!(f, "  replay: {}", path.replay)?;
        }
        if let Some(not_finite) = &self.not_finite {
            writeln!(f, "  {not_finite}")?;
        }
        for adapter in &self.agreeing {
            writeln!(f, "on {adapter}\n  all elements agree")?;
        }
        Ok(())
    }
}
