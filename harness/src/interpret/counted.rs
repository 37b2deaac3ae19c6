//! Measures the coverage of tests: how often each of an author's statements runs, and which branches it takes.

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

/// The extension of files with a test's coverage.
const ENDING: &str = "coverage";

/// The statements of a program, with how often a test ran each of them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ran {
    /// The test.
    pub test: String,
    /// The features and the values of overrides that its program was made with; empty if there are none.
    pub variant: String,
    /// All statements of the program.
    pub statements: Vec<Counted>,
}

/// A statement, or a branch of it, in the author's file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Counted {
    /// The file.
    pub file: PathBuf,
    /// Its first and its last line, from 1. A statement that contains others has one line.
    pub lines: [usize; 2],
    /// Its column in the first line, from 1.
    pub column: usize,
    /// The function: `fresnel::schlick`.
    pub function: String,
    /// Its kind.
    pub kind: CountedKind,
    /// The number of cases, pixels or invocations that reached it; `None` if it is unknown because the engine didn't
    /// run it.
    pub count: Option<u64>,
    /// The number that took each of the branch's [ways](Self::ways).
    pub taken: Vec<u64>,
    /// Set if a result that the test checks is computed from it.
    pub needed: bool,
    /// The first input that reached it, if it was a call's: `x = 0.5`.
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
    /// A clause of a `switch`, by its number.
    Clause(usize),
    /// `for` or `while`
    For,
    /// A loop with the same number of rounds in each call.
    Fixed,
    /// `loop`
    Loop,
}

impl Counted {
    /// The ways of a branch, each with the number that took it; empty without branches.
    pub fn ways(&self) -> impl Iterator<Item = (&'static str, u64)> {
        let names: &[&str] = match self.kind {
            CountedKind::Plain | CountedKind::Switch | CountedKind::Fixed => &[],
            CountedKind::If | CountedKind::Select => &["true", "false"],
            CountedKind::Logical => &["decided on the right", "decided on the left"],
            CountedKind::Clause(_) => &["taken"],
            CountedKind::For => &["no round", "one round", "many rounds"],
            CountedKind::Loop => &["one round", "two rounds", "more rounds"],
        };
        names.iter().copied().zip(self.taken.iter().copied())
    }

    /// Adds the counts of another run of the same statement.
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

    /// The place and the kind, which are the same in all runs.
    #[must_use]
    pub fn key(&self) -> (PathBuf, [usize; 2], usize, CountedKind) {
        (self.file.clone(), self.lines, self.column, self.kind)
    }
}

impl Ran {
    /// The coverage that the tests of a run wrote down.
    ///
    /// # Errors
    /// If a file can't be read, or has other contents.
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

/// All statements of a program in files, with no runs.
#[must_use]
pub fn statements_of(program: &Program) -> Vec<Counted> {
    let all = statements(program.module());
    let fixed = program.fixed_loops();
    let of = |one| counted((program, &fixed), one, Count::default(), &|_| None);
    merged(all.iter().filter_map(|one| Some((one.call, of(one)?))))
}

/// Returns `true` if coverage is being measured.
pub(crate) fn counts() -> bool {
    settings::coverage().is_some()
}

/// Writes down a test's coverage of a program. `input` names a case.
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

/// Writes down that a test runs a program whose statements aren't counted.
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

/// A statement with its place; `None` if it is in no file.
fn counted(
    (program, fixed): (&Program, &[Range<usize>]),
    Statement { function, span, kind, needed, .. }: &Statement,
    count: Count,
    input: &dyn Fn(usize) -> Option<String>,
) -> Option<Counted> {
    let bytes = span.to_range()?;
    let span = program.resolve(bytes.clone())?;
    // Lines that assert or print don't belong to the shader's code.
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

/// Each statement once, with its counts summed over the calls of its function. In naga's IR it may be several, such as
/// a value and its store.
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
