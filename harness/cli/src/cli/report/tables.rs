//! The tables of verdicts.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::Path;

use anyhow::bail;
use karat::unstable::record::{Allowance, PathRecord, Record, Subject, Verdict};

use super::{Names, Sum};
use crate::cli::table::{BAD, DIM, GOOD, KNOWN, Table};
use crate::cli::{replay, terminal};

/// The number of lines on a screen that aren't rows of the table: the table's head, the last line of the run, the
/// replay commands and the shell's prompt.
const AROUND: usize = 8;

/// Writes the functions, then the frames, and returns the number of failed checks. If the passing checks don't fit on a
/// screen, each module takes one line, and the full failures follow after all tables. With `all`, each check has a
/// line.
pub(in crate::cli) fn write(
    records: &[Record],
    all: bool,
    out: &mut dyn Write,
) -> anyhow::Result<usize> {
    let names = &Names::of(records);
    let (passed, others): (Vec<_>, Vec<_>) =
        records.iter().partition(|record| record.verdict == Verdict::Pass);
    let rows: usize = passed.iter().map(|record| record.paths.len()).sum();
    if all || rows + AROUND <= terminal::size().rows {
        let records: Vec<&Record> = records.iter().collect();
        let functions = write_functions(&records, out)?;
        write_grants(&records, out)?;
        return Ok(functions + write_frames(&records, names, out)?);
    }
    write_folded(&passed, out)?;
    write_grants(&records.iter().collect::<Vec<_>>(), out)?;
    if !others.is_empty() {
        writeln!(out)?;
    }
    let failed = write_functions(&others, out)? + write_frames(&others, names, out)?;
    for record in others.iter().filter(|record| is_failure(record)).take(IN_FULL) {
        if let Some(message) = &record.message {
            writeln!(out, "\n{}", super::colour::painted(message.trim_end()))?;
        }
    }
    Ok(failed)
}

/// The largest number of failures that Karat writes in full. A person rarely reads more before the next edit.
const IN_FULL: usize = 3;

/// Writes the passing checks: one line for each module, and one for the frames.
fn write_folded(records: &[&Record], out: &mut dyn Write) -> anyhow::Result<()> {
    #[derive(Default)]
    struct Folded<'r> {
        checks: usize,
        paths: BTreeSet<&'r str>,
        cases: u64,
        closest: Option<(f64, &'r PathRecord)>,
    }
    let mut modules: BTreeMap<(bool, &str), Folded<'_>> = BTreeMap::new();
    for record in records {
        let of = match &record.subject {
            Subject::Function { function, .. } => {
                (false, function.rsplit_once("::").map_or(&**function, |(module, _)| module))
            }
            Subject::Frame { .. } => (true, "frames"),
        };
        let folded = modules.entry(of).or_default();
        folded.checks += 1;
        for path in &record.paths {
            folded.paths.insert(&path.adapter.path);
            folded.cases += path.cases;
            let ratio = path.ratio.unwrap_or_default();
            if folded.closest.is_none_or(|(closest, _)| ratio > closest) {
                folded.closest = Some((ratio, path));
            }
        }
    }
    let mut table = Table::new(&["passed", "checks", "cases", "of bound", "paths"], &[1, 2, 3])
        .cutting(&[4])
        .leaving(&[2]);
    for ((_, module), folded) in modules {
        let closest = folded.closest.map_or_else(String::new, |(_, path)| share(path));
        let paths = folded.paths.into_iter().collect::<Vec<_>>().join(", ");
        let (checks, cases) = (folded.checks.to_string(), folded.cases.to_string());
        table.row(GOOD, vec![module.to_owned(), checks, cases, closest, paths]);
    }
    table.write(out)?;
    writeln!(out, "{DIM}--all lists each check{DIM:#}")?;
    Ok(())
}

pub(in crate::cli) fn write_sum(
    records: &[Record],
    sum: &Sum,
    folder: &Path,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    writeln!(out)?;
    sum.write(out)?;
    let called = Names::of(records);
    let names = replay::names(records);
    for (name, record) in names.iter().take(NAMED) {
        writeln!(out, "{BAD}karat replay {name}{BAD:#}  {}", called.subject(record))?;
    }
    if names.len() > NAMED {
        writeln!(out, "and {} more failures: `karat replay` lists all", names.len() - NAMED)?;
    }
    if let Some(slowest) = slowest(records) {
        writeln!(out, "{DIM}slowest: {slowest}{DIM:#}")?;
    }
    writeln!(out, "{DIM}record: {}{DIM:#}", folder.display())?;
    let overlays: BTreeSet<_> = records.iter().filter_map(|r| r.overlay.as_ref()).collect();
    for overlay in overlays {
        writeln!(
            out,
            "{BAD}KARAT_OVERLAY was set: files of {overlay} replaced modules of the packages{BAD:#}"
        )?;
    }
    Ok(())
}

/// The largest number of failures for which Karat prints a replay command.
const NAMED: usize = 8;

/// The time in seconds above which a check counts as slow.
const SLOW: f64 = 1.0;

/// Returns the three slowest checks, or `None` if all checks are fast: `frame scene 3.2 s, fresnel::schlick agrees_with
/// 1.1 s`.
fn slowest(records: &[Record]) -> Option<String> {
    let names = Names::of(records);
    let time = |record: &Record| Some((record.time.as_ref()?.seconds, names.subject(record)));
    let mut times: Vec<_> =
        records.iter().filter_map(time).filter(|(seconds, _)| *seconds >= SLOW).collect();
    times.sort_by(|a, b| b.0.total_cmp(&a.0));
    let shown = times.iter().take(3).map(|(seconds, name)| format!("{name} {seconds:.1} s"));
    let shown: Vec<String> = shown.collect();
    (!shown.is_empty()).then(|| shown.join(", "))
}

/// Returns an error if a run has no verdict.
pub(in crate::cli) fn expect_some(records: &[Record], filter: Option<&str>) -> anyhow::Result<()> {
    if !records.is_empty() {
        return Ok(());
    }
    match filter {
        Some(filter) => bail!(
            "no check ran: `{filter}` isn't part of the name of a test, or of a function that an earlier \
             test checked. The filter finds a new test only by its name; `karat test` runs all tests. A run that compared nothing isn't a success"
        ),
        None => bail!("no test ran a check. A run that compared nothing isn't a success"),
    }
}

/// Writes one row for each check and path, and returns the number of failed checks.
fn write_functions(records: &[&Record], out: &mut dyn Write) -> anyhow::Result<usize> {
    let head =
        ["function", "check", "path", "cases", "worst", "of bound", "WGSL allows", "asserted"];
    let mut table = Table::new(&head, &[3, 5, 6]).cutting(&[4, 7]).leaving(&[6, 3, 7, 5]);
    let mut failed = 0;
    for record in records {
        let Subject::Function { function, check, assertion, .. } = &record.subject else {
            continue;
        };
        failed += usize::from(is_failure(record));
        add_rows(&mut table, &[function, check], record, assertion, Some(allowance));
    }
    if !table.is_empty() {
        table.write(out)?;
    }
    Ok(failed)
}

fn write_frames(records: &[&Record], names: &Names, out: &mut dyn Write) -> anyhow::Result<usize> {
    let head = ["frame", "path", "pixels", "worst", "of bound", "asserted"];
    let mut table = Table::new(&head, &[2, 4]).cutting(&[3, 5]).leaving(&[2, 5, 4]);
    let mut failed = 0;
    for record in records {
        let Subject::Frame { golden, folder, .. } = &record.subject else { continue };
        failed += usize::from(is_failure(record));
        add_rows(&mut table, &[&names.frame(golden, folder)], record, "matches its golden", None);
    }
    if !table.is_empty() {
        writeln!(out)?;
        table.write(out)?;
    }
    Ok(failed)
}

pub(in crate::cli) fn is_failure(record: &Record) -> bool {
    !matches!(record.verdict, Verdict::Pass | Verdict::KnownIssue)
}

/// Adds a row for each path of a record, or one row if the check ran on no path. `allowance` formats the errors that
/// WGSL allows.
fn add_rows(
    table: &mut Table,
    names: &[&str],
    record: &Record,
    assertion: &str,
    allowance: Option<fn(&Allowance) -> String>,
) {
    let mut row = |style, cells: [&str; 4], allowed: Option<&Allowance>, asserted: &str| {
        let allowance = allowance.map(|text| allowed.map(text).unwrap_or_default());
        let cells = names.iter().chain(&cells).map(ToString::to_string);
        table.row(style, cells.chain(allowance).chain([asserted.to_owned()]).collect());
    };
    if record.paths.is_empty() {
        row(BAD, ["-", "0", "ERROR", ""], None, assertion);
    }
    let passes = |path: &PathRecord| path.failures == 0 && path.cases > 0;
    // If a golden of values has a different number of rows, for example, the check fails without a failing case.
    let otherwise = is_failure(record)
        && record.paths.iter().all(|path| passes(path) == path.known_issue.is_none());
    for path in &record.paths {
        if otherwise {
            let cells =
                [&*path.adapter.path, &path.cases.to_string(), "FAIL (see the message)", ""];
            row(BAD, cells, path.allowed.as_ref(), &path.asserted);
            continue;
        }
        let good = passes(path);
        let (style, word) = match (&path.known_issue, good) {
            (None, true) => (GOOD, ""),
            (None, false) => (BAD, "FAIL "),
            (Some(_), false) => (KNOWN, "known issue "),
            (Some(_), true) => (BAD, "UNEXPECTED PASS "),
        };
        let worst = format!("{word}{}", path.worst);
        let share = share(path);
        let asserted = match &path.known_issue {
            Some(reason) => format!("{}; known issue: {reason}", path.asserted),
            None => path.asserted.clone(),
        };
        let cases = path.cases.to_string();
        let cells = [&*path.adapter.path, &cases, worst.trim_end(), &share];
        row(style, cells, path.allowed.as_ref(), &asserted);
    }
}

/// Formats the largest error that WGSL allows, in per cent of the tolerance, and the share of cases in which WGSL
/// allows more than the tolerance: `40%`, `300% in 12%`, `anything in 3%`. If the tolerance is 0, the text is `more in
/// 12%`.
fn allowance(allowance: &Allowance) -> String {
    let worst = match allowance.worst {
        Some(worst) => percentage(worst),
        None if allowance.unbounded == 0 => "more".to_owned(),
        None => "anything".to_owned(),
    };
    #[expect(clippy::cast_precision_loss, reason = "a share to two digits")]
    let share = 100.0 * allowance.wider as f64 / allowance.cases as f64;
    match allowance.wider {
        0 => worst,
        _ if share < 1.0 => format!("{worst} in <1%"),
        _ => format!("{worst} in {share:.0}%"),
    }
}

/// Writes the number of passing checks whose tolerance is below the errors that WGSL allows. Such a check may fail on
/// another driver.
fn write_grants(records: &[&Record], out: &mut dyn Write) -> anyhow::Result<()> {
    // The errors of a wrong shader don't help to judge its tolerance.
    let passes = |record: &&&Record| record.verdict == Verdict::Pass;
    let allowances = |record: &&&Record| {
        passes(record) && record.paths.iter().any(|path| path.allowed.is_some())
    };
    let is_wider = |record: &&&Record| {
        passes(record)
            && record
                .paths
                .iter()
                .any(|path| path.allowed.is_some_and(|allowance| allowance.wider > 0))
    };
    let declared = records.iter().filter(allowances).count();
    let wider = records.iter().filter(is_wider).count();
    if wider > 0 {
        writeln!(
            out,
            "{DIM}{wider} of {declared} checks have a tolerance below the errors that WGSL allows: another driver may fail these checks{DIM:#}"
        )?;
    }
    Ok(())
}

/// Formats the largest error divided by its bound: `48%`, or `27 x` if the quotient is at least 10. An error above the
/// bound never rounds to `100%`.
pub(super) fn share(path: &PathRecord) -> String {
    match path.ratio.filter(|ratio| ratio.is_finite()) {
        Some(ratio) => percentage(ratio),
        // JSON has no number for an infinite ratio.
        None if path.failures > 0 && !path.worst.is_empty() => "infinite".to_owned(),
        None => String::new(),
    }
}

fn percentage(ratio: f64) -> String {
    match ratio {
        _ if ratio > 1.0 && ratio < 1.005 => ">100%".to_owned(),
        _ if ratio < 10.0 => format!("{:.0}%", 100.0 * ratio),
        _ if ratio < 1e6 => format!("{ratio:.0} x"),
        _ => format!("{ratio:.1e} x"),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use karat::unstable::path::Adapter;
    use karat::unstable::record;

    use super::*;

    /// If a test ran on no path, the table has a row for the error.
    #[test]
    fn a_check_without_a_path_is_an_error_in_the_table() {
        let none = Record { paths: Vec::new(), ..record(Verdict::Error, 0, None) };
        let mut text = Vec::new();
        let failed = write_functions(&[&none], &mut text).expect("memory");
        let text = String::from_utf8(text).expect("UTF-8");
        assert!(failed == 1 && text.contains("m::f") && text.contains("ERROR"), "{text}");
    }

    // Lesson 171
    #[test]
    fn tolerances_below_the_wgsl_bound_are_reported() {
        let allowance =
            |wider, worst| allowance(&Allowance { cases: 200, wider, worst, unbounded: wider });
        assert_eq!(allowance(0, Some(0.4)), "40%");
        assert_eq!(allowance(50, Some(3.0)), "300% in 25%");
        assert_eq!(allowance(1, None), "anything in <1%");
        let inexact = Allowance { cases: 200, wider: 100, worst: None, unbounded: 0 };
        assert_eq!(self::allowance(&inexact), "more in 50%");
        let mut records = [record(Verdict::Pass, 0, None)];
        let mut text = Vec::new();
        write_grants(&records.iter().collect::<Vec<_>>(), &mut text).expect("memory");
        assert!(text.is_empty(), "nothing is known");
        records[0].paths[0].allowed =
            Some(Allowance { cases: 200, wider: 1, worst: None, unbounded: 1 });
        write_grants(&records.iter().collect::<Vec<_>>(), &mut text).expect("memory");
        let text = String::from_utf8(text).expect("UTF-8");
        assert!(
            text.contains("1 of 1 checks have a tolerance below the errors that WGSL allows"),
            "{text}"
        );
    }

    pub(in crate::cli::report) fn record(
        verdict: Verdict,
        failures: u64,
        known_issue: Option<&str>,
    ) -> Record {
        let adapter = Adapter {
            path: "gl".to_owned(),
            name: "llvmpipe".to_owned(),
            driver: String::new(),
            software: true,
        };
        let path = PathRecord {
            adapter,
            cases: 100,
            failures,
            worst: "7 ulp".to_owned(),
            ratio: Some(7.0),
            asserted: "1 ulp".to_owned(),
            known_issue: known_issue.map(str::to_owned),
            allowed: None,
            errors: None,
            plot: None,
            histogram: None,
            configurations: None,
            subgroups: None,
        };
        let subject = Subject::Function {
            package: String::new(),
            function: "m::f".to_owned(),
            check: "agrees_with".to_owned(),
            assertion: "1 ulp".to_owned(),
            location: String::new(),
            domain: String::new(),
            seed: 0,
        };
        let test = "t".to_owned();
        let (schema, paths) = (record::SCHEMA, vec![path]);
        Record {
            schema,
            test,
            cargo_package: String::new(),
            subject,
            verdict,
            paths,
            message: None,
            watched: None,
            details: None,
            overlay: None,
            read: Vec::new(),
            time: None,
        }
    }

    fn table(record: Record) -> (usize, String) {
        let mut out = Vec::new();
        let failed = write_functions(&[&record], &mut out).expect("written");
        (failed, String::from_utf8(out).expect("UTF-8"))
    }

    #[test]
    fn a_known_issue_is_shown_with_its_reason_and_neither_passes_nor_fails() {
        let known = record(Verdict::KnownIssue, 9, Some("mesa#1: mix cancels"));
        let (failed, text) = table(known);
        assert_eq!(failed, 0);
        assert!(text.contains("known issue 7 ulp"), "{text}");
        assert!(text.contains("1 ulp; known issue: mesa#1: mix cancels"), "{text}");
        assert!(text.contains(&KNOWN.to_string()) && !text.contains(&GOOD.to_string()), "{text}");
    }

    #[test]
    fn an_unexpected_pass_fails() {
        let (failed, text) = table(record(Verdict::Fail, 0, Some("mesa#1: mix cancels")));
        assert_eq!(failed, 1);
        assert!(text.contains("UNEXPECTED PASS") && !text.contains(&GOOD.to_string()), "{text}");
        let (failed, text) = table(record(Verdict::Fail, 3, None));
        assert!(failed == 1 && text.contains("FAIL 7 ulp"), "{text}");
    }

    #[test]
    fn a_failing_frame_shows_its_share_of_the_bound() {
        let failing = |ratio: Option<f64>| {
            let mut frame = record(Verdict::Fail, 3, None);
            let (golden, folder, location) = ("scene".to_owned(), String::new(), String::new());
            frame.subject = Subject::Frame { golden, folder, location };
            frame.paths[0] =
                PathRecord { ratio, worst: "rel 0.5".to_owned(), ..frame.paths[0].clone() };
            let mut out = Vec::new();
            assert_eq!(write_frames(&[&frame], &Names::default(), &mut out).expect("written"), 1);
            String::from_utf8(out).expect("UTF-8")
        };
        for (ratio, told) in [
            (Some(1.0004), " >100%  "),
            (Some(1.01), " 101%  "),
            (Some(7.0), " 700%  "),
            (Some(972.2), " 972 x  "),
            (Some(2.5e9), " 2.5e9 x  "),
            (Some(f64::INFINITY), " infinite  "),
            (None, " infinite  "),
        ] {
            let text = failing(ratio);
            assert!(text.contains("FAIL rel 0.5 ") && text.contains(told), "{ratio:?}: {text}");
        }
        let known = record(Verdict::Pass, 0, None).paths.remove(0);
        let path = |ratio| PathRecord { ratio: Some(ratio), ..known.clone() };
        assert_eq!(["48%", "100%", "0%"], [0.48, 1.0, 0.0].map(|ratio| share(&path(ratio))));
        assert_eq!(share(&PathRecord { ratio: None, ..known }), "", "no ratio, so no percentage");
    }

    #[test]
    fn the_slowest_are_named_where_something_is_slow() {
        let took = |seconds: f64| {
            let time = record::Time { started: String::new(), seconds };
            Record { time: Some(time), ..record(Verdict::Pass, 0, None) }
        };
        assert_eq!(slowest(&[record(Verdict::Pass, 0, None), took(0.99)]), None);
        let records = [took(1.04), took(0.5), took(30.0), took(2.0), took(1.5)];
        let expected = "m::f agrees_with 30.0 s, m::f agrees_with 2.0 s, m::f agrees_with 1.5 s";
        assert_eq!(slowest(&records).as_deref(), Some(expected));
    }

    // Lesson 4
    #[test]
    fn a_run_without_a_record_is_no_success() {
        for filter in [None, Some("x")] {
            let error = expect_some(&[], filter).expect_err("nothing ran").to_string();
            assert!(error.contains("A run that compared nothing isn't a success"), "{error}");
        }
        assert!(expect_some(&[record(Verdict::Pass, 0, None)], None).is_ok());
    }
}
