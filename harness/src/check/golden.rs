//! The verb `matches`: checks a function against its golden. The golden contains values that the function
//! returned earlier, and that a person accepted.

use std::cell::Cell;
use std::collections::HashMap;

use super::agreement::Expected;
use super::batch::Rows;
use super::demand::{Demand, number};
use super::path_tally::PathTally;
use super::plan::Plan;
use super::session::{Asserted, Session};
use super::tolerances::Tolerances;
use super::{Agreement, Calls, Census, Check, Failure, Vacuous};
use crate::diagnostic::text_hash;
use crate::domain::{Dynamic, Numbering, Part, Stream};
use crate::executor::{self, Executor};
use crate::golden::{Column, Goldens, Made, Table, ValuesError, other_columns};
use crate::path::Path;
use crate::probe;
use crate::reflect::Function;
use crate::run::or_panic;
use crate::tolerance::Tolerance;
use crate::value::{Scalar, Shape};

/// The default number of cases. The number is small, because a person reads each row of the golden, and the repository
/// keeps the rows forever.
const CASES: u64 = 256;

/// The largest size of a finite domain for which the golden contains every value by default.
const ENUMERATED: u64 = 1024;

impl<V> Check<'_, Calls<V>> {
    /// Checks that the function returns the values of its accepted golden, to within a tolerance. Use this verb
    /// for functions without a reference. The golden is the file `golden/<case>.csv`, which contains arguments
    /// and results.
    ///
    /// The golden's arguments are the domain's first 256 cases, or all values of a finite domain that has at most 1,024
    /// values. To set another number, call [`cases`](Self::cases). The sampled arguments depend on the golden's name,
    /// so you can rename the test. If you change the domain, and Karat samples arguments that the golden doesn't
    /// contain, the check fails until you accept the new values.
    ///
    /// ```no_run
    /// # use karat::{Goldens, prelude::*};
    /// # static SHADERS: Package = karat::package!("shaders");
    /// static GOLDEN: Goldens = karat::goldens!("golden");
    ///
    /// SHADERS
    ///     .function("tonemap::filmic")
    ///     .over(0.0..=16.0)
    ///     .cases(64)
    ///     .matches(&GOLDEN, "filmic", Rel(1e-5).or(Abs(1e-7)));
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if a result differs from the golden, or there is no golden.
    #[track_caller]
    pub fn matches(
        self,
        goldens: &Goldens,
        case: &str,
        tolerance: impl Into<Tolerance>,
    ) -> Agreement {
        or_panic(self.try_matches(goldens, case, tolerance))
    }

    /// Runs [`matches`](Self::matches), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if a result differs from the golden, or there is no golden.
    pub fn try_matches(
        self,
        goldens: &Goldens,
        case: &str,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        self.plan.matches(&*self.stream, self.demand(), (goldens, case), tolerance.into())
    }
}

impl Plan<'_> {
    pub(super) fn matches(
        &self,
        domain: &dyn Stream,
        demand: Demand,
        (goldens, case): (&Goldens, &str),
        tolerance: Tolerance,
    ) -> Result<Agreement, Failure> {
        let golden = goldens.table(case);
        let text = format!("golden `{case}`, {tolerance}");
        // The check doesn't remember failing arguments, because the golden contains all arguments.
        let asserted = Asserted { remembers: false, ..Asserted::new("matches", text) };
        let comparison = Comparison {
            plan: self,
            domain,
            demand: Demand { cases: CASES, enumerated: ENUMERATED, ..demand },
            goldens,
            case,
            seed: self.seed.unwrap_or_else(|| seed_of(case)),
            tolerances: self.tolerances(tolerance),
            canonical: self.canonical(),
            left: Cell::new(Left::Nothing),
            agrees: Cell::new(false),
        };
        let kept = golden.as_ref().ok().and_then(Option::as_ref).map(rows_of);
        let stream: &dyn Stream = kept.as_ref().map_or(domain, |kept| kept);
        let cases = match &golden {
            Ok(Some(golden)) => Some(golden.len() as u64),
            _ => self.cases,
        };
        let plan = Self { cases, seed: Some(comparison.seed), ..self.clone() };
        let mut unread = None;
        let golden = golden.unwrap_or_else(|error| {
            unread = Some(error);
            None
        });
        let is_unread = unread.is_some();
        plan.conclude_as(
            &asserted,
            stream,
            &comparison.demand,
            &mut |session| match &golden {
                Some(golden) => comparison.compare(session, golden),
                None if is_unread => session.called.vacuous(Vacuous::NoCases),
                None => {
                    let rows = drawn(session, domain, &session.cases)?;
                    comparison.leave(session, || {
                        Ok(goldens.without_golden(case, &comparison.made(session, &rows)?))
                    })?;
                    session.called.vacuous(Vacuous::NoCases)
                }
            },
            &mut |result, read| {
                read.extend(goldens.values_read(case));
                if let Some(error) = unread.take() {
                    return Err(Failure::golden(error));
                }
                match (result, comparison.left.take()) {
                    (Ok(agreement), Left::Nothing) => {
                        if comparison.agrees.get() {
                            goldens.values_agree(case);
                        }
                        Ok(agreement)
                    }
                    (Err(failure), Left::Nothing) => Err(failure),
                    (Err(failure), Left::Differs(source)) => Err(failure.with_golden(source)),
                    (Err(failure), Left::Other(source)) => Err(failure.beside_golden(source)),
                    (Ok(_), Left::Other(source) | Left::Differs(source)) => {
                        Err(Failure::golden(source))
                    }
                }
            },
        )
    }

    /// The path whose values become the golden: the first selected path that is lavapipe or the engine, or else the
    /// first selected path.
    fn canonical(&self) -> Option<Path> {
        let executors = self.probe.executors().ok()?;
        let canonical = |executor: &&&dyn Executor| {
            let adapter = executor::adapter(**executor);
            adapter.is_lavapipe() || adapter.path == "cpu"
        };
        executors.iter().find(canonical).or(executors.first()).map(|executor| executor.path())
    }
}

/// The pending values that the check writes for a person to accept.
#[derive(Default)]
enum Left {
    #[default]
    Nothing,
    /// Values for which no golden exists, or for which the golden contains other arguments.
    Other(ValuesError),
    /// Values with the golden's arguments, but with other results.
    Differs(ValuesError),
}

impl Failure {
    /// Adds `source`, the message about the pending values, to the failure that lists the differing results.
    fn with_golden(self, source: ValuesError) -> Self {
        match self {
            Self::Disagreement(differs) => {
                Self::Golden { disagreement: Some(differs), cause: Box::new(source) }
            }
            Self::Paths(mut paths) => {
                let differs = |one: &Self| matches!(one, Self::Disagreement(_));
                match paths.failures.iter().position(differs) {
                    Some(at) => {
                        let failure = paths.failures.remove(at);
                        paths.failures.insert(at, failure.with_golden(source));
                    }
                    None => paths.failures.push(Self::golden(source)),
                }
                Self::Paths(paths)
            }
            other => other,
        }
    }

    /// Adds the golden's error to the failure of a check without a usable golden. Without a golden there are no cases,
    /// so each path also reports that it has no cases. Removes these reports, and keeps the other failures.
    fn beside_golden(self, source: ValuesError) -> Self {
        let Self::Paths(mut paths) = self else { return Self::golden(source) };
        paths.stopped.retain(|(_, error)| !error.has_no_cases());
        if paths.failures.is_empty() && paths.stopped.is_empty() {
            return Self::golden(source);
        }
        paths.failures.push(Self::golden(source));
        Self::Paths(paths)
    }

    fn has_no_cases(&self) -> bool {
        matches!(self, Self::Domain { reason, .. } if matches!(**reason, Vacuous::NoCases))
    }
}

struct Comparison<'c> {
    plan: &'c Plan<'c>,
    domain: &'c dyn Stream,
    demand: Demand,
    goldens: &'c Goldens,
    case: &'c str,
    seed: u64,
    tolerances: Tolerances,
    canonical: Option<Path>,
    left: Cell<Left>,
    /// `true` after a path agreed with all rows of the golden.
    agrees: Cell<bool>,
}

impl Comparison<'_> {
    /// Makes this path's values pending if no values are pending yet. The values of the path that makes goldens (see
    /// `canonical`) replace values that another path left as `Left::Other`.
    fn leave(
        &self,
        session: &Session<'_>,
        source: impl FnOnce() -> Result<ValuesError, Failure>,
    ) -> Result<(), Failure> {
        let left = self.left.take();
        let canonical = self.canonical == Some(session.called.path);
        self.left.set(match left {
            Left::Nothing => Left::Other(source()?),
            Left::Other(_) if canonical => Left::Other(source()?),
            left => left,
        });
        Ok(())
    }

    /// Calls the function with the golden's arguments, and compares the results with the golden's results.
    fn compare(&self, session: &Session<'_>, golden: &Table) -> Result<PathTally, Failure> {
        let (goldens, case, function) = (self.goldens, self.case, session.called.function());
        let numbering =
            number(self.plan, function, self.domain, &self.demand, self.seed, session.inputs)?;
        let rows = || drawn(session, self.domain, &numbering);
        let unlike = |difference: &str| {
            let made = self.made(session, &rows()?)?;
            Ok::<_, Failure>(goldens.unlike_golden(case, &made, golden, difference))
        };
        let now = Table {
            columns: columns(function),
            arguments: session.called.words,
            words: Vec::new(),
        };
        if let Some(difference) = other_columns(golden, &now) {
            self.leave(session, || unlike(&difference))?;
            return session.called.vacuous(Vacuous::NoCases);
        }
        let known: HashMap<&[u32], &[u32]> = golden.split_rows().collect();
        let scalars = session.called.scalars();
        let expect = |rows: Rows<'_>, lanes: &mut Vec<f64>| {
            for row in rows.iter() {
                match known.get(row) {
                    Some(words) => {
                        let words = scalars.iter().zip(*words);
                        lanes.extend(words.map(|(scalar, word)| scalar.decode(*word)));
                    }
                    // The golden has no values for these arguments. NaN makes the case fail.
                    None => lanes.extend(scalars.iter().map(|_| f64::NAN)),
                }
            }
        };
        let expected = Expected { shape: function.result.clone(), expect: &expect };
        let tally = session.agrees(&expected, &self.tolerances, None)?;
        if session.is_replay() {
            return Ok(tally);
        }
        let known = self.plan.known_issues.names(tally.path, &tally.adapter);
        if tally.fails() && !known {
            // The values of the first path that differs from the golden become pending.
            let left = self.left.take();
            self.left.set(match left {
                Left::Differs(_) => left,
                Left::Nothing | Left::Other(_) => {
                    let Census { cases, failures, .. } = tally.tally.census;
                    let path = tally.path;
                    Left::Differs(unlike(&format!("in {failures} of {cases} rows on {path}"))?)
                }
            });
        } else if !rows()?.iter().eq(golden.split_rows().map(|(arguments, _)| arguments)) {
            let difference = "the function agrees for the golden's arguments, but the test has other arguments now: \
                              the test's domain, number of cases or seed changed";
            self.leave(session, || unlike(difference))?;
        } else {
            self.agrees.set(true);
        }
        Ok(tally)
    }

    /// Calls the function with these arguments, and returns a table of arguments and results.
    fn made<'a>(&self, session: &'a Session<'_>, rows: &[Vec<u32>]) -> Result<Made<'a>, Failure> {
        let called = &session.called;
        let mut words = Vec::new();
        for rows in rows.chunks(called.capacity().max(1)) {
            let results = called.call(&rows.concat(), rows.len())?;
            for (case, row) in rows.iter().enumerate() {
                words.extend_from_slice(row);
                words.extend_from_slice(results.of(case));
            }
        }
        let table = Table { columns: columns(called.function()), arguments: called.words, words };
        let program = &called.probed.program;
        let shader = text_hash(program.text().as_bytes());
        let modules = program.modules().to_vec();
        let tolerance = self.tolerances.general.to_string();
        Ok(Made { table, adapter: &called.adapter, shader, modules, tolerance })
    }
}

/// The seed of a golden's arguments. The seed depends only on the golden's name, so the test's name and the environment
/// can't change it.
fn seed_of(case: &str) -> u64 {
    let hash = blake3::hash(case.as_bytes());
    hash.as_bytes().iter().take(8).fold(0, |seed, byte| seed << 8 | u64::from(*byte))
}

fn rows_of(golden: &Table) -> Dynamic {
    let columns = &golden.columns[..golden.arguments];
    let scalars: Vec<Scalar> = columns.iter().map(|column| column.scalar).collect();
    let names = columns.iter().map(|column| (column.name.clone(), Shape::Scalar(column.scalar)));
    let rows = golden.split_rows().map(|(arguments, _)| arguments.to_vec());
    // The first part supplies the components of all arguments, so that each row stays complete.
    let mut parts = vec![vec![Part::listed(scalars, rows.collect())]];
    parts.resize_with(columns.len().max(1), Vec::new);
    Dynamic::new(&names.collect::<Vec<_>>(), parts)
}

fn drawn(
    session: &Session<'_>,
    domain: &dyn Stream,
    cases: &Numbering,
) -> Result<Vec<Vec<u32>>, Failure> {
    let row = |index: u64| {
        let mut row = Vec::new();
        let made = domain.row(cases.origin(index, &mut cases.source(index)), &mut row);
        if made { Ok(row) } else { session.called.vacuous(Vacuous::Filtered) }
    };
    (0..cases.count).map(row).collect()
}

fn columns(function: &Function) -> Vec<Column> {
    let of = |name: &str, shape: &Shape| {
        let lanes = shape.lane_names().into_iter().zip(shape.lanes());
        lanes
            .map(|(lane, scalar)| Column { name: format!("{name}{lane}"), scalar })
            .collect::<Vec<_>>()
    };
    let names = function.parameters.iter().map(|(name, _)| name);
    let arguments = names.zip(probe::parameter_shapes(function));
    let mut columns: Vec<Column> = arguments.flat_map(|(name, shape)| of(name, shape)).collect();
    columns.extend(of("result", &function.result));
    columns
}
