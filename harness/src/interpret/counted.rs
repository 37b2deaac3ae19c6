//! Measures the coverage of tests: how often each statement of the source files runs, and which branches it takes.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use karat_engine::{Count, Counts, Program as Lowered, Statement, StatementKind, statements};
use serde::{Deserialize, Serialize};

use crate::image::append_line;
use crate::package::asserts::is_in_a_line;
use crate::reflect::Program;
use crate::settings;

const ENDING: &str = "coverage";

/// A program's statements, each with the number of times that one test ran the statement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ran {
    /// The name of the test.
    pub test: String,
    /// The features and the values of overrides with which the program was built. Empty if the program has no features
    /// and no overrides.
    pub variant: String,
    /// All statements of the program.
    pub statements: Vec<Counted>,
}

/// A statement of a source file, or an operation that branches: `&&`, `||` or `select`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Counted {
    /// The source file.
    pub file: PathBuf,
    /// The first and the last line, from 1. For a statement that contains other statements, both are its first line.
    pub lines: [usize; 2],
    /// The column in the first line, from 1.
    pub column: usize,
    /// The function that contains the statement: `fresnel::schlick`.
    pub function: String,
    /// The kind of the statement.
    pub kind: CountedKind,
    /// The number of cases, pixels or invocations that reached the statement. `None` says that the number is unknown,
    /// because the engine didn't run the statement.
    pub count: Option<u64>,
    /// For each of a branch's [ways](Self::ways), such as `true` and `false`, the number of cases, pixels or
    /// invocations that took this way.
    pub taken: Vec<u64>,
    /// `true` if a checked result depends on the statement.
    pub needed: bool,
    /// The arguments of the first call that reached the statement: `x = 0.5`.
    pub input: Option<String>,
}

/// The kind of a statement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CountedKind {
    /// A statement without branches.
    Plain,
    /// `if`
    If,
    /// `&&` or `||`
    Logical,
    /// `select`
    Select,
    /// `switch`
    Switch,
    /// A clause of a `switch`, by its index.
    Clause(usize),
    /// `for` or `while`
    For,
    /// A `for`, `while` or `loop` that takes the same number of iterations in each call.
    Fixed,
    /// `loop`
    Loop,
}

impl Counted {
    /// The names of a branch's ways, such as `true` and `false`, each with the number of cases that took this way. A
    /// plain statement has no ways.
    pub fn ways(&self) -> impl Iterator<Item = (&'static str, u64)> {
        let names: &[&str] = match self.kind {
            CountedKind::Plain | CountedKind::Switch | CountedKind::Fixed => &[],
            CountedKind::If | CountedKind::Select => &["true", "false"],
            CountedKind::Logical => &["decided on the right", "decided on the left"],
            CountedKind::Clause(_) => &["taken"],
            CountedKind::For => &["no iteration", "one iteration", "many iterations"],
            CountedKind::Loop => &["one iteration", "two iterations", "more iterations"],
        };
        names.iter().copied().zip(self.taken.iter().copied())
    }

    /// Adds the counts of `other`, which is the same statement in another run.
    pub fn add(&mut self, other: &Self) {
        self.count = match (self.count, other.count) {
            (Some(a), Some(b)) => Some(a + b),
            (a, b) => a.or(b),
        };
        self.taken.iter_mut().zip(&other.taken).for_each(|(own, more)| *own += more);
        self.needed |= other.needed;
        if self.input.is_none() {
            self.input.clone_from(&other.input);
        }
    }

    /// The position and the kind of the statement. A statement has the same key in all runs of the same source text.
    #[must_use]
    pub fn key(&self) -> (PathBuf, [usize; 2], usize, CountedKind) {
        (self.file.clone(), self.lines, self.column, self.kind)
    }
}

impl Ran {
    /// Reads the coverage that the tests of a run wrote.
    ///
    /// # Errors
    /// Returns an error if a file can't be read, or if it contains no coverage.
    pub fn all(folder: &Path) -> std::io::Result<Vec<Self>> {
        let mut all = Vec::new();
        for entry in std::fs::read_dir(folder)? {
            let file = entry?.path();
            if file.extension().is_some_and(|ending| ending == ENDING) {
                for line in std::fs::read_to_string(&file)?.lines() {
                    all.push(serde_json::from_str(line)?);
                }
            }
        }
        Ok(all)
    }
}

/// All statements of a program that are in source files, without counts.
#[must_use]
pub fn statements_of(program: &Program) -> Vec<Counted> {
    let all = statements(program.module());
    let fixed = program.fixed_loops();
    let of = |one| counted((program, &fixed), one, Count::default(), &|_| None);
    merged(all.iter().filter_map(|one| Some((one.call, of(one)?))))
}

pub(crate) fn counts() -> bool {
    settings::coverage().is_some()
}

/// Writes the number of times that the current test ran each statement of a program. `input` returns the arguments of a
/// case.
pub(super) fn note(
    program: &Program,
    lowered: &Lowered,
    counts: Option<Arc<Counts>>,
    input: &dyn Fn(usize) -> Option<String>,
) {
    let Some(counts) = counts else { return };
    let (all, fixed) = (lowered.counted(&counts), program.fixed_loops());
    let all = all.filter_map(|(one, count)| {
        Some((one.call, counted((program, &fixed), one, count, input)?))
    });
    write(program, merged(all));
}

/// Writes the program's statements without counts, because another path than the engine runs the program.
pub(crate) fn unmeasured(program: &Program) {
    if counts() {
        let mut all = statements_of(program);
        all.iter_mut().for_each(|one| one.count = None);
        write(program, all);
    }
}

fn write(program: &Program, statements: Vec<Counted>) {
    let Some(folder) = settings::coverage().filter(|_| !statements.is_empty()) else { return };
    let test = std::thread::current().name().unwrap_or("main").to_owned();
    let ran = Ran { test, variant: program.variant(), statements };
    append_line(&folder, ENDING, &serde_json::to_string(&ran).expect("it is plain data"));
}

/// Makes the [`Counted`] of a statement. Returns `None` if the statement isn't code of the shader in a source file, for
/// example if it is an assertion.
fn counted(
    (program, fixed): (&Program, &[Range<usize>]),
    Statement { function, span, kind, needed, .. }: &Statement,
    count: Count,
    input: &dyn Fn(usize) -> Option<String>,
) -> Option<Counted> {
    let bytes = span.to_range()?;
    let span = program.resolve(bytes.clone())?;
    // Skips asserting and printing lines, because they aren't the shader's code.
    if is_in_a_line(&span) {
        return None;
    }
    let text = span.file.text.get(span.range.clone())?.trim();
    let kind = match kind {
        StatementKind::Plain => CountedKind::Plain,
        StatementKind::Switch => CountedKind::Switch,
        StatementKind::If if text.starts_with("if") => CountedKind::If,
        StatementKind::If => CountedKind::Logical,
        StatementKind::Select => CountedKind::Select,
        StatementKind::Clause(number) => CountedKind::Clause(*number),
        StatementKind::Loop if fixed.contains(&bytes) => CountedKind::Fixed,
        StatementKind::Loop if text.starts_with("loop") => CountedKind::Loop,
        StatementKind::Loop => CountedKind::For,
        StatementKind::Exit => return None,
    };
    let read = span.file.read()?;
    let (line, column) = span.file.line_column(span.range.start);
    let last = match kind {
        CountedKind::Plain => span.file.line_column(span.range.end.saturating_sub(1)).0,
        _ => line,
    };
    let mut one = Counted {
        file: std::path::absolute(&read.file).unwrap_or(read.file),
        lines: [line, last],
        column,
        function: program.path_of(function),
        kind,
        count: Some(count.lanes),
        taken: count.ways.to_vec(),
        needed: *needed,
        input: count.first.and_then(input),
    };
    one.taken.truncate(one.ways().count());
    Some(one)
}

/// Merges the counts of each source statement. naga's IR may have several statements for one source statement, such as
/// a value and its store. Of their counts, Karat keeps the largest. If a function is called at several places, Karat
/// adds the counts of these calls.
fn merged(all: impl Iterator<Item = (usize, Counted)>) -> Vec<Counted> {
    let mut of_calls: BTreeMap<_, Counted> = BTreeMap::new();
    for (call, one) in all {
        let known = of_calls.entry((one.key(), call)).or_insert_with(|| one.clone());
        known.count = known.count.max(one.count);
        known.needed |= one.needed;
    }
    let mut known: BTreeMap<_, Counted> = BTreeMap::new();
    for ((key, _), one) in of_calls {
        known.entry(key).and_modify(|own| own.add(&one)).or_insert(one);
    }
    known.into_values().collect()
}
