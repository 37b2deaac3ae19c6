//! Runs tests.

use std::collections::BTreeMap;
use std::path::Path;

use karat::check::{Agreement, Calls, Check, Failure, Limit, Probe};
use karat::compute::ComputeError;
use karat::draw::{DrawError, Format};
use karat::fixture::FixtureError;
use karat::frame::FrameError;
use karat::golden::FrameTolerance;
use karat::unstable::check::{Condition, TestGroup, WgslTest, Words};
use karat::unstable::diagnostic::{Diagnostic, Span};
use karat::unstable::domain::{Dynamic, Part};
use karat::unstable::probe::{ProbeError, Probed};
use karat::unstable::record::{Seen, Subject, unrecorded};
use karat::unstable::reflect::{Binding, Program, Stage};
use karat::unstable::value::{Scalar, Shape};
use karat::{Directions, Goldens, Package, Tolerance, Trend};
use karat_inspect::made_up::Ranges;
use toml::Value;

use crate::assertions::What;
use crate::compute::Stop;
use crate::declared::{
    Assertion, Direction, Frame, GOLDEN, Integral, OverrideValue, Region, Relative,
};
use crate::domains::{lanes, no_such, over, parts};
use crate::fixtures::fixture;
use crate::numbers::{self, Wanted};
use crate::relations::related;
use crate::table;
use crate::tolerances::{criterion, tolerance};
use crate::wrong::{Fault, Misdeclared, blamed};
use crate::{Broken, Kind, Suite, Test, Wrong};

impl Suite {
    /// Runs a test, in a thread with the test's name. Seeds and records depend on this name.
    ///
    /// # Errors
    /// Returns an error if the test fails or can't run.
    ///
    /// # Panics
    /// Panics if no thread can start.
    pub fn run(&self, test: &Test) -> Result<(), Wrong> {
        self.run_with(test, &Groups::default())
    }

    /// Does the same as [`run`](Self::run), and shares a kernel with the other tests of the test's group.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    ///
    /// # Panics
    /// Panics if no thread can start.
    pub fn run_with(&self, test: &Test, groups: &Groups) -> Result<(), Wrong> {
        Self::on_a_thread(test, || self.verdict(test, groups))
    }

    /// Does the same as [`run`](Self::run) for shaders that aren't saved. The verdict isn't added to the record, and
    /// isn't stored for later runs. Returns the values that the test's checks compared.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    ///
    /// # Panics
    /// Panics if no thread can start.
    pub fn run_unrecorded(&self, test: &Test) -> Result<Seen, Wrong> {
        let verdict = || {
            let (verdict, seen) = unrecorded(|| self.verdict(test, &Groups::default()));
            verdict.map(|()| seen)
        };
        Self::on_a_thread(test, verdict)
    }

    fn on_a_thread<R: Send>(
        test: &Test,
        verdict: impl FnOnce() -> Result<R, Wrong> + Send,
    ) -> Result<R, Wrong> {
        let verdict = std::thread::scope(|scope| {
            let thread = std::thread::Builder::new().name(test.name.clone());
            let run = || {
                let verdict = verdict();
                karat::unstable::run::not_replayed().map_or(verdict, |text| Err(Wrong::of(text)))
            };
            thread.spawn_scoped(scope, run).expect("a thread can be started").join()
        });
        // A panic is a bug in Karat or in a driver.
        verdict.unwrap_or_else(|panic| {
            let text = panic.downcast_ref::<String>().cloned();
            let text = text.or_else(|| Some((*panic.downcast_ref::<&str>()?).to_owned()));
            Err(Wrong::of(text.unwrap_or_else(|| "the test panics".to_owned())))
        })
    }

    /// The tests that can run, and the errors of all other tests. An error that several tests share appears once.
    #[must_use]
    pub fn sound<'t>(&self, tests: Vec<&'t Test>) -> (Vec<&'t Test>, Vec<Broken>) {
        let wrong = |test: &&Test| match &test.kind {
            Kind::Wgsl(test) => test.parameters().err().map(|error| Wrong::from(&*error)),
            Kind::Function(_) | Kind::Frame(_) | Kind::Compute(_) => None,
        };
        let wrong: Vec<Option<Wrong>> = match &*tests {
            // A single test needs no thread. Starting threads takes noticeable time.
            [test] => vec![wrong(test)],
            tests => std::thread::scope(|scope| {
                let threads = std::thread::available_parallelism().map_or(1, usize::from);
                let size = tests.len().div_ceil(threads).max(1);
                let part = |part| scope.spawn(move || part_of(part, wrong));
                let parts: Vec<_> = tests.chunks(size).map(part).collect();
                let join = |part: std::thread::ScopedJoinHandle<'_, Vec<_>>| {
                    part.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
                };
                parts.into_iter().flat_map(join).collect()
            }),
        };
        let (mut sound, mut broken) = (Vec::new(), Vec::<(String, Wrong, usize)>::new());
        for (test, wrong) in tests.into_iter().zip(wrong) {
            match wrong {
                None => sound.push(test),
                Some(wrong) => match broken.iter_mut().find(|(_, known, _)| *known == wrong) {
                    Some((_, _, more)) => *more += 1,
                    None => broken.push((test.name.clone(), wrong, 0)),
                },
            }
        }
        let named = |(name, wrong, more): (String, Wrong, usize)| match more {
            0 => Broken { name, wrong, is_file: false },
            more => Broken { name: format!("{name} and {more} more"), wrong, is_file: false },
        };
        (sound, broken.into_iter().map(named).collect())
    }

    /// Adds to the record the error of a test, module or file that can't run. Usually a check writes the record, but
    /// here no check runs.
    ///
    /// # Panics
    /// Panics if no thread can start.
    pub fn record_broken(&self, broken: &Broken) {
        let Broken { name, wrong, .. } = broken;
        let subject = self.unbegun(name, "declared", wrong.place.as_deref());
        std::thread::scope(|scope| {
            // The record has the thread's name.
            let thread = std::thread::Builder::new().name(name.clone());
            let record = thread.spawn_scoped(scope, || drop(wrong.recorded(subject)));
            let recorded = record.expect("a thread can be started").join();
            recorded.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        });
    }

    /// The subject in the record of a test that can't begin.
    fn unbegun(&self, name: &str, check: &str, location: Option<&str>) -> Subject {
        Subject::Function {
            package: self.package.root().display().to_string(),
            function: name.to_owned(),
            check: check.to_owned(),
            assertion: String::new(),
            location: location.unwrap_or_default().to_owned(),
            domain: String::new(),
            seed: 0,
        }
    }

    /// The groups of tests that share a kernel, so that a driver compiles one kernel for a group. If `cpu` is the only
    /// path, no driver compiles, so there are no groups.
    #[must_use]
    pub fn groups(tests: &[&Test]) -> Groups {
        let drivers = karat::unstable::path::selected()
            .is_ok_and(|all| all.iter().any(|p| p.api() != karat::unstable::path::Api::Cpu));
        let mut own: Vec<&WgslTest> = Vec::new();
        for test in tests {
            if let Kind::Wgsl(test) = &test.kind {
                own.push(test);
            }
        }
        Groups(if drivers { TestGroup::of(&own) } else { Vec::new() })
    }

    fn verdict(&self, test: &Test, groups: &Groups) -> Result<(), Wrong> {
        let whole = &test.span;
        let no_entry = |_: &str| None;
        match &test.kind {
            Kind::Wgsl(test) => {
                let unbegun = |wrong: Wrong| {
                    wrong.recorded(self.unbegun(&test.name, "expects", wrong.place.as_deref()))
                };
                let probe = match groups.0.iter().find_map(|group| group.probe(test)) {
                    Some(together) => together,
                    // The error of invalid WGSL has its own position.
                    None => test.probe().map_err(|error| unbegun(Wrong::from(&*error)))?,
                };
                let judged = wgsl(&self.package, test, probe)
                    .map_err(|wrong| unbegun(wrong.told(&|_| None, whole)))?;
                judged.map(drop).map_err(|failure| match unbound(&failure) {
                    Some(unbound) => Wrong::from(Diagnostic::new(unbound).at(whole.clone(), "")),
                    None => blamed(&failure, &no_entry, &|_| None, whole),
                })
            }
            Kind::Function(assertion) => {
                let place_of = |key: Option<&str>| assertion.place_of(key).cloned();
                let judged = function(&self.package, assertion).map_err(|wrong| {
                    let wrong = wrong.told(&place_of, whole);
                    let Assertion { function, what, .. } = &**assertion;
                    wrong.recorded(self.unbegun(function, what.key(), wrong.place.as_deref()))
                })?;
                judged.map(drop).map_err(|failure| {
                    let place_of = |key: &str| assertion.keys.place_of(key).cloned();
                    let own = place_of(assertion.what.key()).unwrap_or_else(|| whole.clone());
                    let mut wrong = blamed(&failure, &no_entry, &place_of, &own);
                    wrong.message += &row_of(&failure, assertion).unwrap_or_default();
                    wrong
                })
            }
            Kind::Compute(assertion) => {
                let place_of = |key: Option<&str>| assertion.place_of(key).cloned();
                let unbegun = |wrong: Wrong| {
                    let (function, check) = (assertion.last(), assertion.check());
                    wrong.recorded(self.unbegun(function, &check, wrong.place.as_deref()))
                };
                let of = |error: &ComputeError| {
                    let entry = |name: &str| Some(assertion.key_of_entry(name));
                    let own = place_of(None).unwrap_or_else(|| whole.clone());
                    let mut wrong = blamed(error, &entry, &|key| place_of(Some(key)), &own);
                    wrong.message += &assertion.row_of(error).unwrap_or_default();
                    match violations_of(error) {
                        Some(all) => Wrong { fault: Fault::Violations(all), ..wrong },
                        None => wrong,
                    }
                };
                match assertion.judged(&self.package) {
                    Ok(_) => Ok(()),
                    Err(Stop::Misdeclared(wrong)) => Err(unbegun(wrong.told(&place_of, whole))),
                    Err(Stop::Unbegun(error)) => Err(unbegun(of(&error))),
                    Err(Stop::Failed(error)) => Err(of(&error)),
                }
            }
            Kind::Frame(declared) => {
                let place_of = |key: &str| declared.keys.place_of(key).cloned();
                let (unknown, frame) = self.drawn(declared, whole)?;
                let matches = |frame: karat::Frame<'_>| {
                    let goldens = Goldens::open(&declared.golden_folder());
                    frame.try_matches(&goldens, &declared.name).map(drop)
                };
                frame
                    .and_then(matches)
                    .map_err(|error| blamed(&error, &|_| unknown.clone(), &place_of, whole))
            }
        }
    }
}

/// The violations that the sanitizer found in the passes, independently of the test's assertions.
fn violations_of(error: &ComputeError) -> Option<String> {
    let ComputeError::Violations(found) = error else { return None };
    let headlines = found.all.iter().map(|one| one.headline.as_str());
    Some(headlines.collect::<Vec<_>>().join("\n"))
}

/// The last line of an error message about a table: the position of the worst case's row.
fn row_of(failure: &Failure, Assertion { test, what, folder, .. }: &Assertion) -> Option<String> {
    let What::Table(file) = what else { return None };
    let found = match failure {
        Failure::Disagreement(found) => found,
        Failure::Paths(paths) => paths.failures.iter().find_map(|failure| match failure {
            Failure::Disagreement(found) => Some(found),
            _ => None,
        })?,
        _ => return None,
    };
    // Unless a test sets the number of cases, a case's number is the number of its row.
    let worst =
        &found.paths.first().filter(|path| test.cases.is_none() && !path.worst.remembered)?.worst;
    table::told("worst case", &folder.join(file), worst.case)
}

/// The groups of tests that share a kernel: see [`Suite::groups`].
#[derive(Debug, Default)]
pub struct Groups(Vec<TestGroup>);

fn part_of(tests: &[&Test], wrong: impl Fn(&&Test) -> Option<Wrong>) -> Vec<Option<Wrong>> {
    tests.iter().map(wrong).collect()
}

/// The error message if a test in WGSL reads a variable that needs a fixture.
fn unbound(failure: &Failure) -> Option<String> {
    let Failure::Probe(ProbeError::Fixture(error)) = failure else { return None };
    let error = match error {
        FixtureError::Declared { cause, .. } => &**cause,
        other => other,
    };
    let FixtureError::Missing { variable, kind } = error else { return None };
    let name = variable.rsplit("::").next().unwrap_or(variable);
    Some(format!(
        "this test reads `{name}` ({kind}), and a test in WGSL can't bind variables: declare a test in \
         `*.test.toml`, with `with = {{ {name} = ... }}`"
    ))
}

type Judged<E> = Result<Result<Agreement, Failure>, E>;

fn wgsl(package: &Package, test: &WgslTest, probe: Probe<'_>) -> Judged<Misdeclared> {
    let ranges = Ranges::of(package).map_err(|error| error.to_string())?;
    let mut all = Vec::new();
    let parameters = test.parameters().map_err(|error| error.to_string())?;
    for (index, (name, shape)) in parameters.iter().enumerate() {
        let said = test.over.get(index).and_then(Option::as_ref);
        all.push(match said {
            Some((words, place)) => {
                over(name, shape, words).map_err(|error| format!("{error} ({place})"))?
            }
            None => parts(name, shape, None, &ranges)?,
        });
    }
    let check = probe.over_dynamic(Dynamic::new(parameters, all));
    Ok(check.cases(test.cases.unwrap_or(CASES)).try_expects())
}

/// The default number of cases for a WGSL test with parameters. The number is small, because for each case
/// the shader also has to report the failed expectations.
const CASES: u64 = 4096;

fn function(package: &Package, assertion: &Assertion) -> Judged<Misdeclared> {
    let Assertion { test, function, what, folder, .. } = assertion;
    let overrides = test.overrides.iter().map(|(name, value)| (name.clone(), value.number()));
    let overrides: BTreeMap<String, f64> = overrides.collect();
    let probed = match Probed::in_valid(package, function, &overrides) {
        Ok(probed) => probed,
        // The error of invalid WGSL has its own position.
        Err(ProbeError::Reflect(error)) if error.diagnostic().is_some() => {
            return Ok(Err(ProbeError::Reflect(error).into()));
        }
        Err(error) => return Err(Misdeclared::of("function")(error.to_string())),
    };
    for (name, value) in &test.overrides {
        let kind = probed.program().override_type(name).filter(|kind| *kind != Scalar::Bool);
        if let (OverrideValue::Switch(on), Some(kind)) = (value, kind) {
            let kind = kind.wgsl();
            let wrong = format!(
                "the override `{name}` is of type {kind}, but {on} isn't a number: write a number"
            );
            return Err(Misdeclared::of("override")(wrong));
        }
    }
    // With a constant argument, each derivative is 0.
    let mut probed = match what {
        What::Integral(_) if probed.takes_derivatives() => {
            return Err(
                "Karat can't integrate a function with derivatives (such as `dpdx`), which would all be 0 here".into()
            );
        }
        _ => probed.with_varying(),
    };
    let parameters = probed.function().parameters.clone();
    let known = || parameters.iter().map(|(name, _)| &**name);
    if let Some(unknown) = test.over.keys().find(|key| known().all(|name| name != key.as_str())) {
        return Err(Misdeclared::of("over")(no_such("parameter", unknown, known())));
    }
    let mut probe = package.function(function);
    for (name, value) in overrides {
        probe = probe.with_override(&name, value);
    }
    let fixtures = bound(probed.program(), &probed.function().bindings, &test.with, folder)?;
    // If a fixture is missing or wrong, the check reports it.
    let _ = probed.fit(&fixtures);
    for (name, fixture) in fixtures {
        probe = probe.with(&name, fixture);
    }
    let result = probed.function().result.clone();
    let shapes: Vec<Shape> = parameters.iter().map(|(_, shape)| shape.clone()).collect();
    let ranges = Ranges::of(package).map_err(|error| error.to_string())?;
    let ranges = ranges.of_function(probed.function());
    let domain = |count: usize| -> Result<Dynamic, Misdeclared> {
        let own = parameters.iter().take(count);
        let parts = own.map(|(name, shape)| {
            parts(name, shape, test.over.get(name), &ranges).map_err(Misdeclared::of("over"))
        });
        let own = &parameters[..count];
        let domain = Dynamic::new(own, parts.collect::<Result<_, _>>()?);
        let domain = related(domain, own, &test.over).map_err(Misdeclared::of("over"))?;
        let Some(text) = &test.filter else { return Ok(domain) };
        let condition = Condition::parse(own, text).map_err(Misdeclared::of("where"))?;
        Ok(domain.filtered(text, move |row| condition.holds(row)))
    };
    let all = shapes.len();
    let of_key = || Misdeclared::of("tolerance");
    let said = assertion.tolerance(&result);
    let required = || tolerance(said.clone()?).map_err(of_key());
    let or_exact = || tolerance(test.tolerance.as_deref().unwrap_or("exact")).map_err(of_key());
    let wanted = || criterion(said.clone()?).map_err(of_key());
    let plain = said.as_ref().ok().and_then(|text| tolerance(text).ok());
    let near = plain.as_ref().map_or(Wanted::Near, Wanted::from);
    match what {
        What::AgreesWith(reference) => {
            let reference = assertion.of_module(reference);
            let criterion = wanted()?;
            Ok(settled(probe.over_dynamic(domain(all)?), assertion)?
                .try_agrees_with_function(&reference, criterion))
        }
        What::Table(file) => {
            let criterion = wanted()?;
            let table = table::read(&folder.join(file), &parameters, &result, near)?;
            // Each row is a combination of all arguments, so Karat doesn't combine them further.
            let mut parts: Vec<Vec<Part>> = shapes.iter().map(|_| Vec::new()).collect();
            match parts.first_mut() {
                Some(first) => first.push(table.part(&shapes)),
                None => {
                    return Err(
                        "a function without arguments can't have a table: write `equals`".into()
                    );
                }
            }
            let check = settled(probe.over_dynamic(Dynamic::new(&parameters, parts)), assertion)?;
            let expect = |words: &[u32], lanes: &mut Vec<f64>| match table.expected.get(words) {
                Some(expected) => lanes.extend(expected),
                // The table doesn't have flushed or simplified arguments, so they have no expected result.
                None => lanes.extend(vec![f64::NAN; result.lanes().len()]),
            };
            Ok(check.try_agrees_with(&expect, criterion))
        }
        What::Golden(name) => {
            let tolerance = required()?;
            let goldens = Goldens::open(&folder.join(GOLDEN));
            Ok(settled(probe.over_dynamic(domain(all)?), assertion)?
                .try_matches(&goldens, name, tolerance))
        }
        What::Equals(value) => {
            let criterion = wanted()?;
            let expected = wide(&result, value, near)?;
            let expect = |_: &[u32], lanes: &mut Vec<f64>| lanes.extend(&expected);
            Ok(settled(probe.over_dynamic(domain(all)?), assertion)?
                .try_agrees_with(&expect, criterion))
        }
        What::Finite => {
            if !result.lanes().iter().any(|lane| lane.is_float()) {
                return Err("`finite` can't fail: the function returns no float".into());
            }
            Ok(settled(probe.over_dynamic(domain(all)?), assertion)?.try_is_finite())
        }
        What::Unit => Ok(settled(probe.over_dynamic(domain(all)?), assertion)?.try_is_unit()),
        What::PerpendicularTo(argument) => {
            place(&parameters, argument)?;
            let check = settled(probe.over_dynamic(domain(all)?), assertion)?;
            Ok(check.try_is_perpendicular_to(&**argument))
        }
        What::RightHandedFrame => {
            let check = settled(probe.over_dynamic(domain(all)?), assertion)?;
            Ok(check.try_is_right_handed_frame())
        }
        What::InRange(range) => {
            let range = range.checked()?;
            if result.lanes().iter().all(|lane| *lane == Scalar::Bool) {
                return Err(
                    format!("`in_range` needs numbers, but the result is a {result}").into()
                );
            }
            Ok(settled(probe.over_dynamic(domain(all)?), assertion)?
                .try_stays_within(range.bounds()))
        }
        What::SymmetricIn([first, second]) => {
            let [first, second] = [first, second].map(|name| place(&parameters, name));
            let (first, second) = (first?, second?);
            if first.0 == second.0 {
                return Err("a parameter can't be swapped with itself: name two parameters".into());
            }
            if parameters[first.0].1 != parameters[second.0].1 {
                return Err(
                    "the two parameters have different types, so Karat can't swap them".into()
                );
            }
            let width = shapes[first.0].lanes().len();
            let swap = |words: &[u32], out: &mut Vec<u32>| {
                let mut swapped = words.to_vec();
                for lane in 0..width {
                    swapped.swap(first.1 + lane, second.1 + lane);
                }
                out.extend(swapped);
            };
            let tolerance = or_exact()?;
            Ok(settled(probe.over_dynamic(domain(all)?), assertion)?
                .try_invariant_under(&swap, tolerance))
        }
        What::Monotone(argument, direction) => {
            place(&parameters, argument)?;
            let trend = match direction {
                Direction::Increasing => Trend::Increasing,
                Direction::Decreasing => Trend::Decreasing,
            };
            let tolerance = or_exact()?;
            Ok(settled(probe.over_dynamic(domain(all)?), assertion)?.try_is_monotone_in(
                &**argument,
                trend,
                tolerance,
            ))
        }
        What::Limit { argument, toward, through, is } => {
            place(&parameters, argument)?;
            let names = |text: &&String| Condition::names(text, argument);
            if let Some(text) = test.filter.as_ref().filter(names) {
                let wrong = format!(
                    "the condition `{text}` names `{argument}`, but `limit` sets this argument: remove `{argument}` from `where`"
                );
                return Err(Misdeclared::of("where")(wrong));
            }
            #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
            let steps: Vec<f32> = through.iter().map(|step| *step as f32).collect();
            #[expect(clippy::cast_possible_truncation, reason = "arguments are f32")]
            let limit = Limit::toward(*toward as f32, steps);
            let expected = wide(&result, is, near)?;
            let expect = |_: &[u32], lanes: &mut Vec<f64>| lanes.extend(&expected);
            let tolerance = required()?;
            Ok(settled(probe.over_dynamic(domain(all)?), assertion)?.try_at_limit(
                &**argument,
                &limit,
                &expect,
                tolerance,
            ))
        }
        What::Integral(Integral { over, equals: is, at_most, slack, rings }) => {
            if !matches!(shapes.last(), Some(Shape::Vector { size: 3, scalar: Scalar::F32 })) {
                return Err("an integral needs a function whose last parameter is a vec3f".into());
            }
            if *rings == Some(0) {
                return Err("`rings = 0` gives the integral no directions: write at least 1".into());
            }
            let directions = match over {
                Region::Sphere => Directions::sphere(),
                Region::Hemisphere => Directions::hemisphere(),
                Region::ProjectedHemisphere => Directions::projected_hemisphere(),
            };
            let directions = rings.map_or(directions, |rings| directions.rings(rings));
            let last = parameters.last().map_or("", |(name, _)| name);
            if test.over.contains_key(last) {
                let wrong = format!("`integral` sets `{last}`: remove `{last}` from `over`");
                return Err(Misdeclared::of("over")(wrong));
            }
            let check = settled(probe.over_dynamic(domain(shapes.len() - 1)?), assertion)?;
            let value = is.as_ref().or(at_most.as_ref()).expect("an expected value");
            let expected = wide(&result, value, near)?;
            let expect = |_: &[u32], lanes: &mut Vec<f64>| lanes.extend(&expected);
            match is {
                Some(_) => {
                    let tolerance = required()?;
                    Ok(check.try_integrates_to(directions, &expect, tolerance))
                }
                None => {
                    let slack = slack.ok_or("`at_most` needs `slack` for rounding errors")?;
                    Ok(check.try_integrates_to_at_most(directions, &expect, slack))
                }
            }
        }
        What::NoHazards(kinds) => {
            let check = settled(probe.over_dynamic(domain(all)?), assertion)?;
            Ok(match kinds {
                None => check.try_has_no_hazards(),
                Some(kinds) => check.try_has_none_of(kinds.iter().copied()),
            })
        }
        What::Sorted { .. }
        | What::SumOf(_)
        | What::PermutationOf(_)
        | What::Unchanged
        | What::Written => unreachable!("`Declared` has no key for this assertion"),
    }
}

/// Adds to a check the settings that all assertions of a test share.
fn settled<'p>(
    mut check: Check<'p, Calls<Words>>,
    Assertion { test, what, .. }: &Assertion,
) -> Result<Check<'p, Calls<Words>>, Misdeclared> {
    if let Some(cases) = test.cases {
        check = check.cases(cases);
    }
    if let Some(seed) = test.seed {
        check = check.seed(seed);
    }
    if what.takes("tolerance_on") {
        for (on, text) in &test.tolerance_on {
            let own: Tolerance = tolerance(text).map_err(Misdeclared::of("tolerance_on"))?;
            check = check.tolerance_on(on.as_str(), own);
        }
    }
    if what.takes("accept_hazard") {
        for (text, reason) in &test.accept_hazard {
            check = check.accept_hazard(text, reason);
        }
    }
    for (on, reason) in &test.fails_on {
        check = check.fails_on(on.as_str(), reason);
    }
    for (on, reason) in &test.refused_on {
        check = check.refused_on(on.as_str(), reason);
    }
    Ok(check)
}

/// The position of a parameter, and the index of the parameter's first scalar among the scalars of all parameters.
fn place(parameters: &[(String, Shape)], name: &str) -> Result<(usize, usize), String> {
    let known = || parameters.iter().map(|(name, _)| &**name);
    let Some(at) = known().position(|known| known == name) else {
        return Err(no_such("parameter", name, known()));
    };
    Ok((at, parameters[..at].iter().map(|(_, shape)| shape.lanes().len()).sum()))
}

/// The scalars of an expected value, in `f64`. A single number is the value of each component.
pub(crate) fn wide(shape: &Shape, value: &Value, wanted: Wanted) -> Result<Vec<f64>, String> {
    let scalars = shape.lanes();
    let meant = |(scalar, value): (&Scalar, f64)| numbers::meant(*scalar, value, wanted);
    let number = |value: &Value| match value {
        Value::Float(number) => Some(*number),
        #[expect(clippy::cast_precision_loss, reason = "no i32 or u32 loses a digit")]
        Value::Integer(number) => Some(*number as f64),
        Value::Boolean(value) => Some(f64::from(u8::from(*value))),
        _ => None,
    };
    let is_switch = |value: &Value| value.as_bool().is_some();
    let switches = match value {
        Value::Array(list) => list.iter().any(is_switch),
        one => is_switch(one),
    };
    if switches && !scalars.contains(&Scalar::Bool) {
        return Err(format!("{value} isn't a number, but the result is a number"));
    }
    let expect = |scalar: &Scalar, number: f64| match numbers::fits(*scalar, number) {
        true => Ok(meant((scalar, number))),
        false => Err(format!(
            "{number} isn't of type {}, which is the type of the result",
            scalar.wgsl()
        )),
    };
    if let Some(number) = number(value) {
        return scalars.iter().map(|scalar| expect(scalar, number)).collect();
    }
    let list =
        value.as_array().and_then(|list| list.iter().map(number).collect::<Option<Vec<_>>>());
    if let Some(list) = list.filter(|list| list.len() == scalars.len()) {
        return scalars.iter().zip(list).map(|(scalar, number)| expect(scalar, number)).collect();
    }
    // For structs, arrays and matrices, the lanes have the values that the shader would have.
    let words = lanes(shape, value)?;
    Ok(scalars.iter().zip(words).map(|(scalar, word)| scalar.decode(word)).collect())
}

fn bound(
    program: &Program,
    bindings: &[Binding],
    with: &BTreeMap<String, Value>,
    folder: &Path,
) -> Result<Vec<(String, karat::fixture::Fixture)>, Misdeclared> {
    let known = || bindings.iter().map(Binding::name);
    let mut all = Vec::new();
    for (name, value) in with {
        // The key is the variable's name in its module, or the variable's path, which messages show.
        let is_it = |binding: &&Binding| binding.name() == name || binding.path == *name;
        let Some(binding) = bindings.iter().find(is_it) else {
            let message = match bindings {
                [] => format!(
                    "the function reads no variable, so a test can't set `{name}`: remove `{name}`"
                ),
                _ => no_such("variable", name, known()),
            };
            return Err(Misdeclared::of_resource(name)(message));
        };
        let fixture =
            fixture(program, binding, value, folder).map_err(Misdeclared::of_resource(name))?;
        all.push((binding.name().to_owned(), fixture));
    }
    Ok(all)
}

/// The key that names a missing function, if one of the frame's functions doesn't exist; and the frame, or its error.
type Drawn<'p> = (Option<String>, Result<karat::Frame<'p>, FrameError>);

impl Suite {
    /// The frame of the `[[frame]]` with this name; `None` if there is no such frame.
    ///
    /// # Errors
    /// Returns an error if the frame's declaration is wrong.
    #[must_use]
    pub fn frame(&self, name: &str) -> Option<Result<karat::Frame<'_>, Wrong>> {
        let mut tests = self.tests.iter();
        tests.find_map(|test| match &test.kind {
            Kind::Frame(declared) if declared.name == name => {
                let frame = self.drawn(declared, &test.span).and_then(|(_, frame)| {
                    let place_of = |key: &str| declared.keys.place_of(key).cloned();
                    frame.map_err(|error| blamed(&error, &|_| None, &place_of, &test.span))
                });
                Some(frame)
            }
            _ => None,
        })
    }

    /// The passes of the `[[compute]]` whose last entry point has this name, with or without its module. `None` if
    /// there is no such `[[compute]]`.
    ///
    /// # Errors
    /// Returns an error if the declaration is wrong.
    #[must_use]
    pub fn compute(&self, name: &str) -> Option<Result<karat::compute::Compute<'_>, Wrong>> {
        let is_it = |path: &str| path == name || path.rsplit("::").next() == Some(name);
        self.tests.iter().find_map(|test| match &test.kind {
            Kind::Compute(assertion) if assertion.entries().last().is_some_and(is_it) => {
                let passes = assertion.passes(&self.package);
                Some(passes.map_err(|wrong| wrong.told(&|_| None, &test.span)))
            }
            _ => None,
        })
    }

    fn drawn(&self, declared: &Frame, whole: &Span) -> Result<Drawn<'_>, Wrong> {
        frame(&self.package, declared, whole).map_err(|wrong| {
            let wrong = wrong.told(&|key| declared.keys.place_of(key?).cloned(), whole);
            wrong.recorded(declared.subject(wrong.place.as_deref()))
        })
    }
}

fn frame<'p>(package: &'p Package, declared: &Frame, at: &Span) -> Result<Drawn<'p>, Misdeclared> {
    let module = declared.module.as_deref().unwrap_or_default();
    let [width, height] = declared.size.0;
    let program = match Program::of_module(package, module) {
        Ok(program) => program,
        // The error of invalid WGSL has its own position.
        Err(error) if error.diagnostic().is_some() => {
            return Ok((None, Err(DrawError::from(error).into())));
        }
        Err(error) => return Err(Misdeclared::of("module")(error.to_string())),
    };
    let mut bindings: Vec<Binding> = Vec::new();
    let draws = declared.draws().map_err(Misdeclared::of("draws"))?;
    let mut unknown: Option<String> = None;
    for (number, draw) in draws.iter().enumerate() {
        let named = [
            ("vertex", Stage::Vertex, &draw.vertex),
            ("fragment", Stage::Fragment, &draw.fragment),
        ];
        for (key, stage, name) in named {
            let Some(name) = name else { continue };
            match program.entry_point_bindings(stage, name) {
                Some(own) => bindings.extend(own),
                None => {
                    let below = format!("draws.{number}.{key}");
                    let is_below = declared.keys.exactly(&below).is_some();
                    unknown = unknown.or(Some(if is_below { below } else { key.to_owned() }));
                }
            }
        }
    }
    let mut frame = package.frame(module, width, height).samples(declared.samples.unwrap_or(1));
    if !declared.formats.is_empty() {
        let named = |name: &String| {
            let known = Format::NAMES.iter().map(|(name, _)| *name);
            Format::named(name)
                .ok_or_else(|| Misdeclared::of("formats")(no_such("format", name, known)))
        };
        frame = frame.formats(declared.formats.iter().map(named).collect::<Result<Vec<_>, _>>()?);
    }
    match (declared.target, declared.depth) {
        (Some(_), true) => {
            return Err(Misdeclared::of("depth")(
                "`target` and `depth` exclude each other: remove one of the keys".to_owned(),
            ));
        }
        (Some(target), false) => frame = frame.target(target),
        (None, true) => frame = frame.depth(),
        (None, false) => {}
    }
    for (name, value) in &declared.overrides {
        frame = frame.with_override(name, value.number());
    }
    for (number, draw) in draws.iter().enumerate() {
        // If the function doesn't exist, drawing reports it.
        let drawn = draw.draw(&program, &declared.folder, unknown.is_some());
        let drawn = drawn.map_err(|wrong| wrong.below(&format!("draws.{number}")))?;
        frame = frame.draw(drawn);
    }
    frame = frame.declared_at(&at.to_string());
    // If a function doesn't exist, its inputs are unknown, and drawing reports it.
    if unknown.is_none() {
        let all = bound(&program, &bindings, &declared.with, &declared.folder);
        for (name, fixture) in all? {
            frame = frame.with(&name, fixture);
        }
    }
    if let Some(Relative(relative)) = declared.tolerance {
        frame = frame.tolerance(FrameTolerance::gate(relative));
    }
    for (on, reason) in &declared.fails_on {
        frame = frame.fails_on(on.as_str(), reason);
    }
    for (on, reason) in &declared.refused_on {
        frame = frame.refused_on(on.as_str(), reason);
    }
    Ok((unknown, Ok(frame)))
}
