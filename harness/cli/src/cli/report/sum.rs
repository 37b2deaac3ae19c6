//!
//! The last line of a run: the sum of its verdicts.
//!
//! The last line, its colour and the exit code come from the same count, so they can't contradict each other: the line
//! says "0 failed" only if the run passed.

use std::collections::BTreeSet;
use std::io::Write;

use karat::unstable::output::{Style, counted, one_line};
use karat::unstable::record::{Record, Run, Subject, Verdict};

use super::{is_failure, outside};
use crate::cli::Ending;
use crate::cli::table::{BAD, GOOD};
use crate::cli::test::some;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(in crate::cli) struct Sum {
    checks: usize,
    failed: usize,
    known: usize,
    cases: u64,
    /// The names of the tests that failed although all their checks passed.
    outside: Vec<String>,
    /// The other reasons why the run failed: invalid modules, tests that didn't run.
    others: Vec<String>,
    /// Remarks that don't make the run fail.
    remarks: Vec<String>,
}

/// Formats the first few of these names in one line.
fn first(names: &[String]) -> String {
    let names: Vec<_> = names.iter().map(|name| one_line(name)).collect();
    some(&names.iter().map(|name| &**name).collect::<Vec<&str>>())
}

/// Returns a remark with the number of checks that the sanitizer didn't examine completely. These are checks of compute
/// passes, and of draws that write storage. The remark says why the first of these checks wasn't examined completely.
/// For the other checks, see the records.
fn unwatched(records: &[Record]) -> Option<String> {
    let watched = records.iter().filter_map(|record| record.watched.as_ref());
    let reasons =
        watched.map(|watched| watched.reason.as_str()).filter(|reason| !reason.is_empty());
    let reasons: Vec<&str> = reasons.collect();
    let (first, count) = (reasons.first()?, reasons.len());
    let others = reasons.iter().collect::<BTreeSet<_>>().len() - 1;
    let others = match others {
        0 => String::new(),
        others => format!(", and {}", counted(others, "other reason")),
    };
    let checks = counted(count, "check");
    Some(format!(
        "the sanitizer didn't check everything in {checks} of passes or draws: {first}{others}"
    ))
}

/// Returns a remark with the number of passing checks for which Karat tried only some orders of the invocations.
fn in_some_orders(records: &[Record]) -> Option<String> {
    let passed = records.iter().filter(|record| !is_failure(record));
    let watched = passed.filter_map(|record| record.watched.as_ref());
    let orders = watched.filter(|one| one.orders > 0 && !one.all_orders).map(|one| one.orders);
    let orders: Vec<u64> = orders.collect();
    let least = orders.iter().min()?;
    let checks = counted(orders.len(), "check");
    Some(format!(
        "in {checks} of passes, not all orders ran, but at least {} did",
        counted(*least as usize, "order")
    ))
}

/// Returns a remark with the number of shader lines that read elements which neither the test nor a pass has written.
fn unwritten(records: &[Record]) -> Option<String> {
    let watched = records.iter().filter_map(|record| record.watched.as_ref());
    let all: BTreeSet<&String> = watched.flat_map(|watched| &watched.unwritten).collect();
    let first = all.first()?;
    let lines = counted(all.len(), "line");
    let reads = if all.len() == 1 { "reads" } else { "read" };
    Some(format!(
        "{lines} {reads} elements that no pass has written: {first}; if your program clears these elements, add `value = 0` beside `size`"
    ))
}

fn accepted(records: &[Record]) -> Option<String> {
    // Each assertion about a pass accepts the races that the declaration of the pass accepts.
    let of = |record: &Record| {
        let name = match &record.subject {
            Subject::Function { function, .. } => function.clone(),
            Subject::Frame { golden, .. } => golden.clone(),
        };
        let watched = record.watched.clone().unwrap_or_default();
        watched.accepted.into_iter().map(move |one| (name.clone(), one))
    };
    let count = records.iter().flat_map(of).collect::<BTreeSet<_>>().len();
    (count > 0).then(|| counted(count, "accepted race"))
}

impl Sum {
    /// Counts the records of a run. `run` says how the run ended, and is `None` if that is unknown.
    pub(in crate::cli) fn of(records: &[Record], run: Option<&Run>) -> Self {
        let count = |verdict| records.iter().filter(|record| record.verdict == verdict).count();
        let mut sum = Self {
            checks: records.len(),
            failed: records.iter().filter(|record| is_failure(record)).count(),
            known: count(Verdict::KnownIssue),
            cases: records.iter().flat_map(|record| &record.paths).map(|path| path.cases).sum(),
            // If the run passed, a line that looks like a failed test is other output.
            outside: run
                .filter(|run| !run.passed)
                .map_or_else(Vec::new, |run| outside(records, &run.failed)),
            others: Vec::new(),
            remarks: run.map_or_else(Vec::new, |run| run.remarks.clone()),
        };
        sum.remarks.extend(unwatched(records));
        sum.remarks.extend(in_some_orders(records));
        sum.remarks.extend(unwritten(records));
        sum.remarks.extend(accepted(records));
        let Some(run) = run else {
            return sum.with("the record doesn't say that its run ended".to_owned());
        };
        for (names, what) in [(&run.invalid, "module"), (&run.invalid_packages, "package")] {
            if !names.is_empty() {
                let are = if names.len() == 1 { "isn't" } else { "aren't" };
                let counted = counted(names.len(), what);
                sum = sum.with(format!("{counted} {are} valid: {}", first(names)));
            }
        }
        if run.not_run > 0 {
            let tests = counted(run.not_run, "test");
            sum = sum.with(format!(
                "{tests} didn't run because another test failed: run with --no-fail-fast"
            ));
        } else if run.stopped {
            let why = "the runner stopped at a failure, so later tests may be missing: run with \
                       --no-fail-fast";
            sum = sum.with(why.to_owned());
        }
        if !run.passed && sum.is_good() {
            sum = sum.with("a test failed outside of Karat's checks".to_owned());
        }
        sum
    }

    pub(in crate::cli) fn with(mut self, reason: String) -> Self {
        self.others.push(reason);
        self
    }

    pub(in crate::cli) fn is_good(&self) -> bool {
        self.checks > 0 && self.failed == 0 && self.outside.is_empty() && self.others.is_empty()
    }

    pub(in crate::cli) fn ending(&self) -> Ending {
        if self.is_good() { Ending::Good } else { Ending::Bad }
    }

    pub(in crate::cli) fn style(&self) -> Style {
        if self.is_good() { GOOD } else { BAD }
    }

    pub(in crate::cli) fn outside(&self) -> &[String] {
        &self.outside
    }

    /// Returns the reasons why the run failed, other than failing checks and tests.
    pub(in crate::cli) fn others(&self) -> &[String] {
        &self.others
    }

    /// Returns the reasons why the run failed, other than failing checks, as sentences.
    pub(in crate::cli) fn reasons(&self) -> Vec<String> {
        let mut all = self.others.clone();
        if !self.outside.is_empty() {
            let tests = counted(self.outside.len(), "test");
            all.push(format!("{tests} failed outside of Karat's checks: {}", first(&self.outside)));
        }
        all
    }

    /// Returns the last line of the run, without the number of compared cases and without the remarks.
    pub(in crate::cli) fn line(&self) -> String {
        let Self { checks, failed, known, .. } = *self;
        let mut parts = self.reasons();
        let known = match known {
            0 => String::new(),
            count => format!(", {}", counted(count, "known issue")),
        };
        parts.push(match (checks, failed) {
            (0, _) => "no check ran".to_owned(),
            (_, 0) if !self.is_good() => {
                format!("{} passed{known}", counted(checks - self.known, "check"))
            }
            _ => format!("{}, {failed} failed{known}", counted(checks, "check")),
        });
        parts.join("; ")
    }

    /// Returns the remarks at the end of the run's last line. A remark doesn't make the run fail.
    pub(in crate::cli) fn remarks(&self) -> String {
        self.remarks.iter().map(|remark| format!("; {}", one_line(remark))).collect()
    }

    /// Writes the last line of the run, with the number of compared cases and the remarks.
    pub(in crate::cli) fn write(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let (style, line, remarks) = (self.style(), self.line(), self.remarks());
        let cases = match self.checks {
            0 => String::new(),
            _ => format!(", {} compared", counted(self.cases, "case")),
        };
        writeln!(out, "{style}{line}{style:#}{cases}{remarks}")
    }
}

#[cfg(test)]
mod tests {
    use super::super::tables::tests::record;
    use super::*;

    fn line(records: &[Record], run: Option<&Run>) -> String {
        let sum = Sum::of(records, run);
        let line = sum.line();
        // Only a good line has "0 failed".
        assert_eq!(sum.is_good(), line.contains(" 0 failed"), "{line}");
        assert_eq!(sum.style() == GOOD, sum.is_good(), "{line}");
        assert_eq!(sum.ending() == Ending::Good, sum.is_good(), "{line}");
        line
    }

    fn names(names: &[&str]) -> Vec<String> {
        names.iter().map(ToString::to_string).collect()
    }

    /// The remark counts the checks that the sanitizer didn't examine completely, and gives the first reason.
    #[test]
    fn unchecked_checks_are_counted() {
        let with = |reason: &str| {
            let mut record = record(Verdict::Pass, 0, None);
            let watched = karat::unstable::record::Watched {
                invocations: 64,
                of: 64,
                reason: reason.to_owned(),
                ..Default::default()
            };
            record.watched = Some(watched);
            record
        };
        let remarks = |records: &[Record]| Sum::of(records, Some(&Run::default())).remarks();
        assert_eq!(remarks(&[with(""), record(Verdict::Pass, 0, None)]), "");
        let told = remarks(&[with("too large"), with(""), with("no engine")]);
        let expected =
            "; the sanitizer didn't check everything in 2 checks of passes or draws: too large";
        assert_eq!(told, format!("{expected}, and 1 other reason"));
        assert_eq!(remarks(&[with("too large"), with("too large")]), expected);
        let in_orders = |orders, all_orders| {
            let mut record = with("");
            let watched = record.watched.as_mut().expect("it has passes");
            (watched.orders, watched.all_orders) = (orders, all_orders);
            record
        };
        assert_eq!(remarks(&[in_orders(12, true), in_orders(0, true)]), "");
        let some = remarks(&[in_orders(16, false), in_orders(12, true), in_orders(20, false)]);
        assert_eq!(some, "; in 2 checks of passes, not all orders ran, but at least 16 orders did");
        let mut reading = with("");
        let watched = reading.watched.as_mut().expect("it has passes");
        watched.unwritten.push("`partials[3]` at mean.wgsl:17:57".to_owned());
        let expected = "; 1 line reads elements that no pass has written: `partials[3]` at mean.wgsl:17:57; if your program clears \
                        these elements, add `value = 0` beside `size`";
        assert_eq!(remarks(&[reading.clone(), reading]), expected, "two checks of one pass");
        let mut accepting = with("");
        let watched = accepting.watched.as_mut().expect("it has passes");
        watched.accepted.push(("any".to_owned(), "whichever comes last will do".to_owned()));
        assert_eq!(remarks(&[accepting.clone(), accepting]), "; 1 accepted race");
    }

    // Lesson 183
    #[test]
    fn the_summary_line_agrees_with_the_result_of_the_run() {
        let [pass, known, fail] = [
            record(Verdict::Pass, 0, None),
            record(Verdict::KnownIssue, 9, Some("mesa#1")),
            record(Verdict::Fail, 9, None),
        ];
        let good = &[pass.clone(), known.clone()][..];
        let one = std::slice::from_ref(&fail);
        let whole = Run::default();
        assert_eq!(line(good, Some(&whole)), "2 checks, 0 failed, 1 known issue");
        let red = Run { passed: false, ..Run::default() };
        let failed = Run { failed: names(&["t"]), ..red.clone() };
        assert_eq!(line(&[pass.clone(), fail.clone()], Some(&failed)), "2 checks, 1 failed");
        let invalid = Run { invalid: names(&["a::b"]), ..red.clone() };
        assert_eq!(
            line(good, Some(&invalid)),
            "1 module isn't valid: a::b; 1 check passed, 1 known issue"
        );
        assert_eq!(line(one, Some(&invalid)), "1 module isn't valid: a::b; 1 check, 1 failed");
        let of_package = Run { invalid_packages: names(&["p"]), ..red.clone() };
        assert_eq!(line(one, Some(&of_package)), "1 package isn't valid: p; 1 check, 1 failed");
        let other = Run { failed: names(&["other"]), ..red.clone() };
        assert_eq!(
            line(&[], Some(&other)),
            "1 test failed outside of Karat's checks: other; no check ran"
        );
        assert_eq!(
            line(good, Some(&red)),
            "a test failed outside of Karat's checks; 1 check passed, 1 known issue"
        );
        assert_eq!(line(&[], Some(&whole)), "no check ran");
        let printed = Run { failed: names(&["printed"]), ..Run::default() };
        assert_eq!(line(good, Some(&printed)), "2 checks, 0 failed, 1 known issue");
        let ended = "the record doesn't say that its run ended; 1 check passed, 1 known issue";
        assert_eq!(line(good, None), ended);
        let stopped = Run { not_run: 4, failed: names(&["t"]), ..red.clone() };
        assert_eq!(
            line(one, Some(&stopped)),
            "4 tests didn't run because another test failed: run with --no-fail-fast; 1 check, 1 failed"
        );
        let stopped = Run { stopped: true, ..red };
        assert!(line(one, Some(&stopped)).starts_with("the runner stopped at a failure"));
    }

    #[test]
    fn all_cases_are_counted() {
        let mut records = [record(Verdict::Pass, 0, None), record(Verdict::Pass, 0, None)];
        let second = records[0].paths[0].clone();
        records[0].paths.push(second);
        let run = Run::default();
        let mut text = Vec::new();
        Sum::of(&records, Some(&run)).write(&mut text).expect("memory");
        let text = String::from_utf8(text).expect("UTF-8");
        assert!(text.contains("300 cases compared"), "{text}");
    }

    // Lesson 183
    #[test]
    fn only_five_failed_tests_are_named_in_a_summary() {
        let failed = names(&["a", "b", "c", "d", "e", "f", "g"]);
        let sum = Sum::of(&[], Some(&Run { failed, passed: false, ..Run::default() }));
        let told = "7 tests failed outside of Karat's checks: a, b, c, d, e and 2 more";
        assert_eq!(sum.reasons(), [told]);
    }
}
