//! A line beside each function: what is known of it, and a way to run its tests.

use std::collections::BTreeSet;
use std::path::Path;

use karat::Package;
use karat::diagnostic::Span;
use karat::output::counted;
use karat::record::{PathRecord, Record, Subject, Verdict};
use karat_suite::{Suite, Test};
use lsp_types::{CodeLens, Command, Uri};
use serde_json::json;

use super::super::report::is_failure;
use super::findings::file_of;
use super::place::{range, resolved};
use super::root::Verdicts;

/// The command of lenses that run tests: the URI of a file, and the name of a function in it.
pub(super) const RUN: &str = "karat.run";

/// Whoever has a lens: a function, or a test in WGSL.
pub(super) struct Subjects {
    package: String,
    suite: Option<Suite>,
    /// Names, and where they stand.
    pub(super) all: Vec<(String, Span)>,
}

/// What else is known of the package.
pub(super) struct Known<'k> {
    pub(super) verdicts: &'k Verdicts,
    /// Whether tests run.
    pub(super) busy: bool,
    /// Whether a run had all tests.
    pub(super) whole: bool,
}

impl Subjects {
    /// The functions of a module, and the tests in its file. None if it can't be read.
    pub(super) fn of(package: &Package, module: &str, file: &Path) -> Self {
        let functions = package.functions_in(module).unwrap_or_default();
        let functions = functions.into_iter().filter(|item| !item.entry_point);
        let mut all: Vec<(String, Span)> = functions.map(|item| (item.name, item.span)).collect();
        let suite = Suite::of(package.clone()).ok();
        let tests = suite.iter().flat_map(|suite| &suite.tests);
        let here = tests.filter(|test| file_of(&test.span).is_some_and(|own| own == file));
        all.extend(here.map(|test| (test.name.clone(), test.span.clone())));
        all.sort_by_key(|(_, span)| span.range.start);
        let package = resolved(&package.root()).display().to_string();
        Self { package, suite, all }
    }

    /// The tests of the shaders that are about a function, call it, or are it.
    fn tests(&self, function: &str) -> BTreeSet<&str> {
        let is_about = |test: &&Test| {
            let declared = test.name.strip_prefix(function);
            test.name == function
                || declared.is_some_and(|rest| rest.starts_with(' '))
                || test.calls().any(|called| called == function)
        };
        let tests = self.suite.iter().flat_map(|suite| &suite.tests);
        tests.filter(is_about).map(|test| &*test.name).collect()
    }

    /// The records that are about a function, or about a test that calls it.
    fn about<'r>(
        &self,
        function: &str,
        tests: &BTreeSet<&str>,
        records: &'r [Record],
    ) -> Vec<&'r Record> {
        let is_about = |record: &&Record| match &record.subject {
            Subject::Function { function: own, package, .. } => {
                *package == self.package && (own == function || tests.contains(&*record.test))
            }
            Subject::Frame { .. } => false,
        };
        records.iter().filter(is_about).collect()
    }

    /// The names of all tests of a function.
    pub(super) fn names(&self, function: &str, verdicts: &Verdicts) -> BTreeSet<String> {
        let tests = self.tests(function);
        let records = [&verdicts.current, &verdicts.stale];
        let recorded = records.into_iter().flat_map(|all| self.about(function, &tests, all));
        let names = recorded.map(|record| record.test.clone());
        names.chain(tests.iter().map(ToString::to_string)).collect()
    }

    /// Two lenses for each: what is known, and one that runs its tests if there are some.
    pub(super) fn lenses(&self, uri: &Uri, known: &Known<'_>) -> Vec<CodeLens> {
        let mut lenses = Vec::new();
        for (name, span) in &self.all {
            let range = range(&span.file.text, &span.range);
            let mut lens = |title: String, command: &str| {
                let arguments = Some(vec![json!(uri), json!(name)]);
                let command = Some(Command { title, command: command.to_owned(), arguments });
                lenses.push(CodeLens { range, command, data: None });
            };
            let tests = self.tests(name);
            let current = self.about(name, &tests, &known.verdicts.current);
            let is_stale = !self.about(name, &tests, &known.verdicts.stale).is_empty();
            let untested = current.is_empty() && !is_stale && tests.is_empty();
            // An empty command is text.
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
            (true, _) => "changed since it was tested",
            (false, true) => "not run yet",
            (false, false) if known.whole => "no test",
            (false, false) => "no test is known: `karat test` tells",
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

/// The worst error, of what it may be, and its path; `None` where nothing is measured.
fn worst<'p>(paths: impl Iterator<Item = &'p PathRecord>) -> Option<String> {
    // Without a ratio a path that fails is infinitely far off.
    let ratio = |path: &PathRecord| match path.ratio {
        None if path.failures > 0 => f64::INFINITY,
        ratio => ratio.unwrap_or_default(),
    };
    let measured = paths.filter(|path| path.worst.contains(|c: char| c.is_ascii_digit()));
    let worst = measured.max_by(|a, b| ratio(a).total_cmp(&ratio(b)))?;
    let (error, unit) = worst.worst.rsplit_once(' ').unwrap_or((&*worst.worst, ""));
    // `0.42 of 4 ulp`: a unit is told once.
    let error = if worst.asserted.ends_with(unit) { error } else { &*worst.worst };
    // Of a statement with a tolerance, `increasing in x, 4 ulp`, that is what the error is of.
    let allowed = worst.asserted.rsplit(", ").next().unwrap_or_default();
    Some(format!(", worst {error} of {allowed} on {}", worst.adapter.path))
}
