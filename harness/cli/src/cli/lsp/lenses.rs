//! The lenses beside each function: the verdict, and a command that runs the tests.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use karat::Package;
use karat::unstable::diagnostic::Span;
use karat::unstable::output::counted;
use karat::unstable::record::{PathRecord, Record, Subject, Verdict};
use karat_suite::{Suite, Test};
use lsp_types::{CodeLens, Command, Uri};
use serde_json::json;

use super::super::report::is_failure;
use super::findings::file_of;
use super::place::{Lines, resolved};
use super::root::Verdicts;

/// The command that a lens sends to run tests. Its arguments are the URI of a file, and the name of a function in the
/// file.
pub(super) const RUN: &str = "karat.run";

/// The functions and WGSL tests that have lenses.
pub(super) struct Subjects {
    package: String,
    tests: Tests,
    /// The names of the functions and tests, with their locations.
    pub(super) all: Vec<(String, Span)>,
}

/// The tests beside the shaders: for each function, the names of the tests that check or call it. A function with
/// `@test` is its own test.
#[derive(Default)]
struct Tests(BTreeMap<String, BTreeSet<String>>);

impl Tests {
    fn of(tests: &[Test]) -> Self {
        let mut by_function: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        for test in tests {
            // A test in a TOML file has a name such as `brdf::schlick is symmetric`.
            let spaces = test.name.match_indices(' ').map(|(space, _)| &test.name[..space]);
            for function in spaces.chain([&*test.name]).chain(test.calls()) {
                let own = by_function.entry(function.to_owned()).or_default();
                own.insert(test.name.clone());
            }
        }
        Self(by_function)
    }

    fn about(&self, function: &str) -> &BTreeSet<String> {
        static NONE: BTreeSet<String> = BTreeSet::new();
        self.0.get(function).unwrap_or(&NONE)
    }
}

/// The records of a package's functions, by function and by test.
struct Records<'r> {
    all: Vec<&'r Record>,
    by_function: BTreeMap<&'r str, Vec<usize>>,
    by_test: BTreeMap<&'r str, Vec<usize>>,
}

impl<'r> Records<'r> {
    fn of(package: &str, records: &'r [Record]) -> Self {
        let mut found =
            Self { all: Vec::new(), by_function: BTreeMap::new(), by_test: BTreeMap::new() };
        for record in records {
            let Subject::Function { function, package: own, .. } = &record.subject else {
                continue;
            };
            if own != package {
                continue;
            }
            let index = found.all.len();
            found.by_function.entry(function).or_default().push(index);
            found.by_test.entry(&record.test).or_default().push(index);
            found.all.push(record);
        }
        found
    }

    /// Returns the records of a function and of the tests that call it, in the order of the run.
    fn about(&self, function: &str, tests: &BTreeSet<String>) -> Vec<&'r Record> {
        let of_tests = tests.iter().filter_map(|test| self.by_test.get(&**test));
        let of_function = self.by_function.get(function);
        let all: BTreeSet<usize> = of_tests.chain(of_function).flatten().copied().collect();
        all.into_iter().map(|index| self.all[index]).collect()
    }
}

/// The verdicts on a package, and the state of its runs.
pub(super) struct Known<'k> {
    pub(super) verdicts: &'k Verdicts,
    /// `true` while tests run.
    pub(super) busy: bool,
    /// `true` if Karat knows all tests. Then the lens of a function without tests says `no test`.
    pub(super) whole: bool,
}

impl Subjects {
    /// Returns the tests in a module's file, and the functions of the module if Karat can read it.
    pub(super) fn of(package: &Package, module: &str, file: &Path) -> Self {
        let functions = package.functions_in(module).unwrap_or_default();
        let functions = functions.into_iter().filter(|item| item.entry_point.is_none());
        let mut all: Vec<(String, Span)> = functions.map(|item| (item.name, item.span)).collect();
        let suite = Suite::of(package.clone()).ok();
        let known = suite.iter().flat_map(|suite| &suite.tests);
        let here = known.filter(|test| file_of(&test.span).is_some_and(|own| own == file));
        all.extend(here.map(|test| (test.name.clone(), test.span.clone())));
        all.sort_by_key(|(_, span)| span.range.start);
        let package = resolved(&package.root()).display().to_string();
        let tests = suite.map_or_else(Tests::default, |suite| Tests::of(&suite.tests));
        Self { package, tests, all }
    }

    pub(super) fn names(&self, function: &str, verdicts: &Verdicts) -> BTreeSet<String> {
        let tests = self.tests.about(function);
        let records = [&verdicts.current, &verdicts.stale];
        let records = records.map(|all| Records::of(&self.package, all));
        let recorded = records.iter().flat_map(|all| all.about(function, tests));
        let names = recorded.map(|record| record.test.clone());
        names.chain(tests.iter().cloned()).collect()
    }

    /// Returns the lenses of each function and test: the verdict, and a command that runs the function's tests if there
    /// are any.
    pub(super) fn lenses(&self, uri: &Uri, known: &Known<'_>) -> Vec<CodeLens> {
        let mut lenses = Vec::new();
        let current = Records::of(&self.package, &known.verdicts.current);
        let stale = Records::of(&self.package, &known.verdicts.stale);
        let written: BTreeMap<&str, Cow<'_, str>> =
            self.all.iter().map(|(_, span)| (&*span.file.name, span.file.written())).collect();
        let mut texts: BTreeMap<&str, Lines<'_>> = BTreeMap::new();
        for (name, span) in &self.all {
            let lines = texts.entry(&span.file.name);
            let lines = lines.or_insert_with(|| Lines::of(&written[&*span.file.name]));
            let range = lines.range(&span.written().1);
            let mut lens = |title: String, command: &str| {
                let arguments = Some(vec![json!(uri), json!(name)]);
                let command = Some(Command { title, command: command.to_owned(), arguments });
                lenses.push(CodeLens { range, command, data: None });
            };
            let tests = self.tests.about(name);
            let current = current.about(name, tests);
            let is_stale = !stale.about(name, tests).is_empty();
            let untested = current.is_empty() && !is_stale && tests.is_empty();
            // A lens with an empty command is only text.
            lens(format!("karat: {}", title(&current, is_stale, !untested, known)), "");
            if !untested {
                lens("run".to_owned(), RUN);
            }
        }
        lenses
    }
}

fn title(current: &[&Record], is_stale: bool, is_tested: bool, known: &Known<'_>) -> String {
    if current.is_empty() {
        let why = match (is_stale, is_tested) {
            (_, true) if known.busy => "running",
            (true, _) => "changed after the last test",
            (false, true) => "not run yet",
            (false, false) if known.whole => "no test",
            (false, false) => "no test is known: run `karat test`",
        };
        return why.to_owned();
    }
    let failed = current.iter().filter(|record| is_failure(record)).count();
    let is_known = |record: &&&Record| record.verdict == Verdict::KnownIssue;
    let issues = match current.iter().filter(is_known).count() {
        0 => String::new(),
        count => format!(", {}", counted(count, "known issue")),
    };
    let verdict = match (failed, current.len()) {
        (0, 1) => "1 check passes".to_owned(),
        (0, count) => format!("{count} checks pass"),
        (failed, 1) => format!("{failed} check fails"),
        (failed, count) => format!("{failed} of {count} checks fail"),
    };
    let paths = || current.iter().flat_map(|record| &record.paths);
    let cases = counted(paths().map(|path| path.cases).sum::<u64>(), "case");
    format!("{verdict}{issues}{}, {cases}", worst(paths()).unwrap_or_default())
}

/// Returns the worst error with its assertion and path, or `None` if no error was measured.
fn worst<'p>(paths: impl Iterator<Item = &'p PathRecord>) -> Option<String> {
    // A failing path without a ratio counts as infinite.
    let ratio = |path: &PathRecord| match path.ratio {
        None if path.failures > 0 => f64::INFINITY,
        ratio => ratio.unwrap_or_default(),
    };
    let measured = paths.filter(|path| path.worst.contains(|c: char| c.is_ascii_digit()));
    let worst = measured.max_by(|a, b| ratio(a).total_cmp(&ratio(b)))?;
    let PathRecord { worst: error, asserted, adapter, .. } = worst;
    Some(format!(", worst error {error} ({asserted}) on {}", adapter.path))
}
