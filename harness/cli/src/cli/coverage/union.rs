//! Sums up the coverage of all tests, for each file.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use karat::unstable::interpret::{Counted, CountedKind, Ran};

type Key = ([usize; 2], usize, CountedKind);

/// The files of the packages, each with its statements and the tests that ran them.
#[derive(Debug, Default)]
pub(super) struct Union {
    files: BTreeMap<PathBuf, File>,
    /// The names of test functions, which aren't counted.
    tests: BTreeSet<String>,
}

#[derive(Debug, Default)]
pub(super) struct File {
    pub(super) statements: BTreeMap<Key, Seen>,
}

#[derive(Debug)]
pub(super) struct Seen {
    pub(super) sum: Counted,
    /// `true` if the statement ran in a frame or on a driver, where Karat can't count statements.
    unmeasured: bool,
    /// The tests that ran the statement, by name, each with its counts.
    pub(super) tests: BTreeMap<String, Came>,
    variants: BTreeSet<String>,
}

/// The counts of one test for one statement: how often the test ran the statement, the first input, and how often the
/// test took each side of a branch.
#[derive(Clone, Debug, Default)]
pub(super) struct Came {
    pub(super) count: u64,
    pub(super) input: Option<String>,
    pub(super) taken: Vec<u64>,
}

/// A line with statements.
#[derive(Clone, Debug)]
pub(super) struct Line<'u> {
    /// The largest count of a statement on this line.
    pub(super) count: u64,
    /// `false` if only frames and drivers run the line.
    pub(super) measured: bool,
    /// `true` if a test runs the line, but no test checks a value that depends on the line.
    pub(super) weak: bool,
    pub(super) seen: Vec<&'u Seen>,
}

/// The numbers of lines, of sides of branches (`ways`) and of functions, and for each the number that the tests ran.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub(super) struct Sum {
    pub(super) lines: usize,
    pub(super) ran: usize,
    pub(super) weak: usize,
    pub(super) unmeasured: usize,
    pub(super) ways: usize,
    pub(super) taken: usize,
    pub(super) functions: usize,
    pub(super) called: usize,
}

impl Union {
    /// Adds the statements of a package, with counts of 0.
    pub(super) fn add(&mut self, root: &Path, all: impl Iterator<Item = Counted>) {
        let root = root.canonicalize().unwrap_or_else(|_| root.to_owned());
        for one in all {
            let file = canonical(&one.file);
            // Modules that are imported from other packages belong to the tests of those packages.
            if file.starts_with(&root) {
                self.files.entry(file).or_default().seen(&one);
            }
        }
    }

    /// Leaves out the statements of these test functions.
    pub(super) fn leave_out(&mut self, tests: impl Iterator<Item = String>) {
        self.tests.extend(tests);
    }

    /// Adds the counts of a test. Ignores files that [`Union::add`] didn't add.
    pub(super) fn run(&mut self, ran: &Ran) {
        for one in &ran.statements {
            let Some(file) = self.files.get_mut(&canonical(&one.file)) else { continue };
            // Under another variant, a file may have other statements. Packages that import a file may name it
            // differently.
            let is_new = !file.statements.contains_key(&(one.lines, one.column, one.kind));
            let is = |test: &String| format!("::{}", one.function).ends_with(&format!("::{test}"));
            if is_new && self.tests.iter().any(is) {
                continue;
            }
            let seen = file.seen(one);
            match one.count {
                None => seen.unmeasured = true,
                Some(0) => {}
                Some(count) => {
                    let own = seen.tests.entry(ran.test.clone()).or_default();
                    own.count += count;
                    own.input = own.input.take().or_else(|| one.input.clone());
                    own.taken.resize(one.taken.len(), 0);
                    own.taken.iter_mut().zip(&one.taken).for_each(|(own, more)| *own += more);
                    seen.variants.insert(ran.variant.clone());
                }
            }
            if one.count.is_some_and(|count| count > 0) {
                // A run that doesn't reach the statement doesn't show whether a test checks its value.
                match seen.sum.count {
                    Some(0) => {
                        let function = std::mem::take(&mut seen.sum.function);
                        seen.sum = Counted { function, ..one.clone() };
                    }
                    _ => seen.sum.add(one),
                }
            }
        }
    }

    /// Removes the statements that aren't on one of the given lines.
    pub(super) fn keep_lines(&mut self, lines: &BTreeMap<PathBuf, Vec<RangeInclusive<usize>>>) {
        for (file, own) in &mut self.files {
            let kept = lines.get(file);
            let touches = |key: &Key| {
                let [first, last] = key.0;
                kept.is_some_and(|kept| {
                    kept.iter().any(|one| *one.start() <= last && first <= *one.end())
                })
            };
            own.statements.retain(|key, _| touches(key));
        }
        self.files.retain(|_, own| !own.statements.is_empty());
    }

    pub(super) fn files(&self) -> impl Iterator<Item = (&Path, &File)> {
        self.files.iter().map(|(file, own)| (file.as_path(), own))
    }

    pub(super) fn sum(&self) -> Sum {
        self.files.values().fold(Sum::default(), |sum, file| sum.and(file.sum()))
    }

    /// Returns each variant with the number of lines that ran in this variant, and the number of lines that ran in no
    /// other variant. The shaders have a variant for each set of features that the tests use.
    pub(super) fn variants(&self) -> Vec<(&str, usize, usize)> {
        let mut known: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
        for line in self.files.values().flat_map(|file| file.lines().into_values()) {
            let own: BTreeSet<&String> = line.seen.iter().flat_map(|seen| &seen.variants).collect();
            for variant in &own {
                let (lines, alone) = known.entry(variant).or_default();
                *lines += 1;
                *alone += usize::from(own.len() == 1);
            }
        }
        known.into_iter().map(|(name, (lines, alone))| (name, lines, alone)).collect()
    }

    pub(super) fn as_json(&self) -> serde_json::Value {
        let files = self.files().map(|(file, own)| {
            let lines = own.lines().into_iter().map(|(number, line)| {
                let tests: BTreeSet<&String> =
                    line.seen.iter().flat_map(|seen| seen.tests.keys()).collect();
                serde_json::json!({
                    "line": number, "count": line.count, "measured": line.measured, "looked_at": (line.count > 0).then_some(!line.weak), "tests": tests,
                })
            });
            let branches = own.branches().map(|seen| {
                let ways: BTreeMap<&str, u64> = seen.sum.ways().collect();
                let [line, _] = seen.sum.lines;
                serde_json::json!({ "line": line, "column": seen.sum.column, "kind": seen.sum.kind, "ways": ways })
            });
            serde_json::json!({
                "file": file, "sum": own.sum(), "lines": lines.collect::<Vec<_>>(), "branches": branches.collect::<Vec<_>>(),
            })
        });
        serde_json::json!({ "sum": self.sum(), "files": files.collect::<Vec<_>>() })
    }
}

impl File {
    fn seen(&mut self, one: &Counted) -> &mut Seen {
        let new = || Seen {
            sum: Counted { count: Some(0), taken: vec![0; one.taken.len()], ..one.clone() },
            unmeasured: false,
            tests: BTreeMap::new(),
            variants: BTreeSet::new(),
        };
        self.statements.entry((one.lines, one.column, one.kind)).or_insert_with(new)
    }

    /// Returns each line that has a statement.
    pub(super) fn lines(&self) -> BTreeMap<usize, Line<'_>> {
        let mut lines: BTreeMap<usize, Line<'_>> = BTreeMap::new();
        for seen in self.statements.values() {
            let [first, last] = seen.sum.lines;
            for number in first..=last {
                let new = || Line { count: 0, measured: false, weak: true, seen: Vec::new() };
                let line = lines.entry(number).or_insert_with(new);
                line.count = line.count.max(seen.count());
                line.measured |= seen.is_measured();
                line.weak &= seen.count() == 0 || !seen.sum.needed;
                line.seen.push(seen);
            }
        }
        for line in lines.values_mut() {
            line.weak &= line.count > 0;
        }
        lines
    }

    /// Returns the measured branches. Leaves out each `select` whose result no test used, because Karat can't know
    /// which side a test would have used.
    pub(super) fn branches(&self) -> impl Iterator<Item = &Seen> {
        self.statements.values().filter(|seen| {
            let is_idle = seen.sum.kind == CountedKind::Select && !seen.sum.needed;
            seen.is_measured() && !is_idle && seen.sum.ways().next().is_some()
        })
    }

    /// Returns the functions, each with its first line, and with the largest count of its statements, which is 0 if no
    /// test called the function.
    pub(super) fn functions(&self) -> BTreeMap<&str, (usize, u64)> {
        let mut functions: BTreeMap<&str, (usize, u64)> = BTreeMap::new();
        for seen in self.statements.values().filter(|seen| seen.is_measured()) {
            let own = functions.entry(&seen.sum.function).or_insert((seen.sum.lines[0], 0));
            own.0 = own.0.min(seen.sum.lines[0]);
            own.1 = own.1.max(seen.count());
        }
        functions
    }

    pub(super) fn sum(&self) -> Sum {
        let (lines, functions) = (self.lines(), self.functions());
        let of = |is: fn(&Line<'_>) -> bool| lines.values().filter(|line| is(line)).count();
        let ways = || self.branches().flat_map(|seen| seen.sum.ways());
        Sum {
            lines: lines.len(),
            ran: of(|line| line.count > 0),
            weak: of(|line| line.weak),
            unmeasured: of(|line| !line.measured),
            ways: ways().count(),
            taken: ways().filter(|(_, count)| *count > 0).count(),
            functions: functions.len(),
            called: functions.values().filter(|(_, count)| *count > 0).count(),
        }
    }

    /// Returns the gaps in the coverage, in the order of lines. A gap is code or a side of a branch that no test ran,
    /// code whose value no test checks, or code that isn't measured. Each gap has its first and last line, a
    /// description, and `true` if no test ran it.
    pub(super) fn missing(&self) -> Vec<([usize; 2], String, bool)> {
        let mut all: Vec<([usize; 2], String, bool)> = Vec::new();
        let mut add = |line: usize, why: String, is_gap: bool| match all.last_mut() {
            Some(([_, last], known, _)) if *known == why && *last + 1 == line => *last = line,
            _ => all.push(([line; 2], why, is_gap)),
        };
        let lines = self.lines();
        for (number, line) in &lines {
            let function = &line.seen[0].sum.function;
            if !line.measured {
                add(*number, format!("this code in `{function}` isn't measured"), false);
            } else if line.count == 0 {
                add(*number, format!("no test runs this code in `{function}`"), true);
            } else if line.weak {
                add(
                    *number,
                    format!("no test checks the value of this code in `{function}`"),
                    false,
                );
            }
        }
        for seen in self.branches().filter(|seen| seen.count() > 0) {
            let never = seen.sum.ways().filter(|(_, count)| *count == 0).map(|(way, _)| way);
            let never: Vec<&str> = never.collect();
            if !never.is_empty() {
                let what = match seen.sum.kind {
                    CountedKind::Clause(number) => format!("clause {} of `switch`", number + 1),
                    kind @ (CountedKind::Logical | CountedKind::Select) => {
                        format!("`{}` at column {}", word(kind), seen.sum.column)
                    }
                    kind => format!("`{}`", word(kind)),
                };
                let [line, _] = seen.sum.lines;
                all.push(([line; 2], format!("{what} is never: {}", never.join(", ")), true));
            }
        }
        all.sort_by_key(|(lines, ..)| *lines);
        all
    }
}

/// Returns the WGSL keyword or operator that makes a branch.
pub(super) fn word(kind: CountedKind) -> &'static str {
    match kind {
        CountedKind::Plain => "statement",
        CountedKind::If => "if",
        CountedKind::Logical => "&& or ||",
        CountedKind::Select => "select",
        CountedKind::Switch | CountedKind::Clause(_) => "switch",
        CountedKind::For | CountedKind::Fixed => "for or while",
        CountedKind::Loop => "loop",
    }
}

impl Seen {
    pub(super) fn count(&self) -> u64 {
        self.sum.count.unwrap_or_default()
    }

    pub(super) fn is_measured(&self) -> bool {
        self.count() > 0 || !self.unmeasured
    }
}

impl Sum {
    fn and(self, other: Self) -> Self {
        Self {
            lines: self.lines + other.lines,
            ran: self.ran + other.ran,
            weak: self.weak + other.weak,
            unmeasured: self.unmeasured + other.unmeasured,
            ways: self.ways + other.ways,
            taken: self.taken + other.taken,
            functions: self.functions + other.functions,
            called: self.called + other.called,
        }
    }

    /// Returns the percentage of measured lines that tests ran, or `None` if no line is measured.
    pub(super) fn percent(&self) -> Option<f64> {
        per_cent(self.ran, self.lines - self.unmeasured)
    }

    /// Formats a percentage.
    pub(super) fn share(some: usize, all: usize) -> String {
        per_cent(some, all).map_or_else(|| "-".to_owned(), |percent| format!("{percent}%"))
    }
}

/// Returns `some` as a percentage of `all`, rounded down to a tenth, so that only complete coverage gives 100.
#[expect(clippy::cast_precision_loss, reason = "a share to a tenth of a per cent")]
fn per_cent(some: usize, all: usize) -> Option<f64> {
    (all > 0).then(|| (1000 * some / all) as f64 / 10.0)
}

impl fmt::Display for Sum {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let measured = self.lines - self.unmeasured;
        let of = |some: usize, all: usize| format!("{} ({some} of {all})", Self::share(some, all));
        write!(
            f,
            "lines {}, outcomes of branches {}, functions {}",
            of(self.ran, measured),
            of(self.taken, self.ways),
            of(self.called, self.functions)
        )
    }
}

fn canonical(file: &Path) -> PathBuf {
    file.canonicalize().unwrap_or_else(|_| file.to_owned())
}
