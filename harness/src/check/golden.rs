//! Results that are compared with a golden: the values that a function returned once, for fixed arguments.

use std::cell::Cell;
use std::collections::HashMap;

use super::agreement::Expected;
use super::batch::Rows;
use super::called::Ready;
use super::demand::{Demand, number};
use super::path_tally::PathTally;
use super::plan::{Plan, Recording};
use super::session::{Asserted, Session};
use super::tolerances::Tolerances;
use super::{Agreement, Check, Failure, Vacuous};
use crate::diagnostic::text_hash;
use crate::domain::{Domain, Dynamic, Numbering, Part, Stream};
use crate::golden::{Column, Goldens, Made, Table, ValuesError, other_columns};
use crate::path::Adapter;
use crate::probe;
use crate::reflect::Function;
use crate::run::or_panic;
use crate::tolerance::Tolerance;
use crate::value::{Arguments, Scalar, Shape};

/// Cases unless the check says otherwise: a person can look through so many rows, and they are stored
/// for ever.
const CASES: u64 = 256;

/// Values of a finite domain that are all kept unless a number of cases is asked for.
const ENUMERATED: u64 = 1024;

impl<D: Domain> Check<'_, D>
where
    D::Value: Arguments,
{
    /// Checks that the function returns what it returned when its golden was accepted, to within a
    /// tolerance: `golden/<case>.csv`, arguments beside results. It is for functions that have no
    /// reference.
    ///
    /// The golden's arguments are the domain's first 256 cases, of a finite domain up to 1,024, or as
    /// many as [`cases`](Self::cases) says. They depend on the golden's name and on no test. If the domain
    /// draws others than the golden has, the check fails until the new ones are accepted.
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
    /// With the [`Failure`], if a case differs, or there is nothing to compare with.
    #[track_caller]
    pub fn matches(
        self,
        goldens: &Goldens,
        case: &str,
        tolerance: impl Into<Tolerance>,
    ) -> Agreement {
        or_panic(self.compare_with((goldens, case), tolerance.into(), Recording::On))
    }

    /// [`matches`](Self::matches) without the panic.
    ///
    /// # Errors
    /// If a case differs, or there is nothing to compare with.
    pub fn try_matches(
        self,
        goldens: &Goldens,
        case: &str,
        tolerance: impl Into<Tolerance>,
    ) -> Result<Agreement, Failure> {
        self.compare_with((goldens, case), tolerance.into(), Recording::Off)
    }

    fn compare_with(
        self,
        golden: (&Goldens, &str),
        tolerance: Tolerance,
        recording: Recording,
    ) -> Result<Agreement, Failure> {
        self.plan.matches(&self.stream(), Self::demand(), golden, tolerance, recording)
    }
}

impl Plan<'_> {
    pub(super) fn matches(
        &self,
        domain: &dyn Stream,
        demand: Demand,
        (goldens, case): (&Goldens, &str),
        tolerance: Tolerance,
        recording: Recording,
    ) -> Result<Agreement, Failure> {
        let golden = goldens.table(case);
        let text = format!("golden `{case}`, {tolerance}");
        // What it fails on is in the golden.
        let asserted = Asserted { remembers: false, ..Asserted::new("matches", text) };
        let comparison = Comparison {
            plan: self,
            domain,
            demand: Demand { cases: CASES, enumerated: ENUMERATED, ..demand },
            goldens,
            case,
            seed: self.seed.unwrap_or_else(|| seed_of(case)),
            tolerances: self.tolerances(tolerance),
            recording,
            left: Cell::new(None),
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
        plan.conclude_as(
            &asserted,
            stream,
            &comparison.demand,
            recording,
            &mut |session| match (unread.take(), &golden) {
                (Some(error), _) => Err(Failure::golden(error)),
                (None, Some(golden)) => comparison.compare(session, golden),
                (None, None) => {
                    let rows = drawn(session, domain, &session.cases)?;
                    let made = comparison.made(session, &rows, None)?;
                    Err(Failure::golden(goldens.without_golden(case, &made)))
                }
            },
            &mut |result, read| {
                read.extend(goldens.values_read(case));
                match (result, comparison.left.take()) {
                    (Err(Failure::Disagreement(differs)), Some(source)) => {
                        let (disagreement, source) = (Some(differs), Box::new(source));
                        Err(Failure::Golden { disagreement, source })
                    }
                    (Ok(_), Some(source)) => Err(Failure::golden(source)),
                    (result, _) => result,
                }
            },
        )
    }
}

/// A function and its golden.
struct Comparison<'c> {
    plan: &'c Plan<'c>,
    domain: &'c dyn Stream,
    demand: Demand,
    goldens: &'c Goldens,
    case: &'c str,
    seed: u64,
    tolerances: Tolerances,
    recording: Recording,
    /// What was left to be looked at.
    left: Cell<Option<ValuesError>>,
}

impl Comparison<'_> {
    /// Compares the function with its golden, at the golden's arguments.
    fn compare(&self, session: &Session<'_>, golden: &Table) -> Result<Vec<PathTally>, Failure> {
        let (goldens, case, function) = (self.goldens, self.case, session.called.function());
        let numbering =
            number(self.plan, function, self.domain, &self.demand, self.seed, session.inputs)?;
        let rows = || drawn(session, self.domain, &numbering);
        let unlike = |path: Option<usize>, difference: &str| {
            let made = self.made(session, &rows()?, path)?;
            Ok::<_, Failure>(goldens.unlike_golden(case, &made, golden, difference))
        };
        let now = Table {
            columns: columns(function),
            arguments: session.called.words,
            words: Vec::new(),
        };
        if let Some(difference) = other_columns(golden, &now) {
            return Err(Failure::golden(unlike(None, &difference)?));
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
                    // The golden says nothing of other arguments, so nothing agrees there.
                    None => lanes.extend(scalars.iter().map(|_| f64::NAN)),
                }
            }
        };
        let expected = Expected { shape: function.result.clone(), expect: &expect };
        let tallies = session.agrees(&expected, &self.tolerances, None, self.recording)?;
        if session.is_replay() {
            return Ok(tallies);
        }
        let fails = |tally: &PathTally| tally.fails() && self.plan.known_issue(tally).is_none();
        if let Some(at) = tallies.iter().position(fails) {
            let PathTally { path, tally, .. } = &tallies[at];
            let (failures, all) = (tally.census.failures, tally.census.cases);
            let difference = format!("{failures} of {all} rows on {path}");
            self.left.set(Some(unlike(Some(at), &difference)?));
        } else if !rows()?.iter().eq(golden.split_rows().map(|(arguments, _)| arguments)) {
            let difference = "it agrees for the golden's arguments, and the test draws others: its domain, \
                              number of cases or seed was changed";
            self.left.set(Some(unlike(None, difference)?));
        } else {
            goldens.values_agree(case);
        }
        Ok(tallies)
    }

    /// What the function returns for these arguments, on a path by its index, or where goldens are made.
    fn made<'a>(
        &self,
        session: &'a Session<'_>,
        rows: &[Vec<u32>],
        path: Option<usize>,
    ) -> Result<Made<'a>, Failure> {
        let (called, ready) = (&session.called, &session.called.ready);
        let canonical = |adapter: &Adapter| adapter.is_lavapipe() || adapter.path == "cpu";
        let path = path.or_else(|| ready.iter().position(|ready| canonical(&ready.adapter)));
        let path = path.unwrap_or_default();
        let Some(Ready { adapter, .. }) = ready.get(path) else {
            return called.vacuous(Vacuous::NoCases);
        };
        let mut words = Vec::new();
        for rows in rows.chunks(called.capacity().max(1)) {
            let results = called.call(&rows.concat(), rows.len())?;
            for (case, row) in rows.iter().enumerate() {
                words.extend_from_slice(row);
                words.extend_from_slice(results[path].of(case));
            }
        }
        let table = Table { columns: columns(called.function()), arguments: called.words, words };
        let program = &called.probed.program;
        let shader = text_hash(program.text().as_bytes());
        let modules = program.modules().to_vec();
        let tolerance = self.tolerances.general.to_string();
        Ok(Made { table, adapter, shader, modules, tolerance })
    }
}

/// Where the arguments of a golden come from: its name alone, so that neither the test's name nor the
/// environment changes them.
fn seed_of(case: &str) -> u64 {
    let hash = blake3::hash(case.as_bytes());
    hash.as_bytes().iter().take(8).fold(0, |seed, byte| seed << 8 | u64::from(*byte))
}

/// The golden's arguments as a domain.
fn rows_of(golden: &Table) -> Dynamic {
    let columns = &golden.columns[..golden.arguments];
    let scalars: Vec<Scalar> = columns.iter().map(|column| column.scalar).collect();
    let names = columns.iter().map(|column| (column.name.clone(), Shape::Scalar(column.scalar)));
    let rows = golden.split_rows().map(|(arguments, _)| arguments.to_vec());
    // One part draws the lanes of all arguments together.
    let mut parts = vec![vec![Part::listed(scalars, rows.collect())]];
    parts.resize_with(columns.len().max(1), Vec::new);
    Dynamic::new(&names.collect::<Vec<_>>(), parts)
}

/// The rows of all cases of a domain.
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

/// The columns of a function's golden.
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
