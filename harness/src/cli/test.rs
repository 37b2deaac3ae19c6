//! `karat test`: runs the tests and prints what their records hold.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, IsTerminal, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressStyle};
use karat::record::{self, Record, Subject, Verdict as Recorded};

use super::list::callable;
use super::project::Project;
use super::table::{BAD, DIM, GOOD, HEAD, KNOWN, Table};
use super::{Outcome, PackageArgs, Verdict};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Only tests whose names contain this
    filter: Option<String>,
    /// Only tests of this Cargo package; may be repeated [default: the whole workspace]
    #[arg(short = 'p', long = "cargo-package", value_name = "NAME")]
    cargo_packages: Vec<String>,
    /// Only this test target (the name of a file in `tests/`); may be repeated
    #[arg(long = "test", value_name = "NAME")]
    targets: Vec<String>,
    /// Execution paths: `vulkan`, `vulkan,gl`, or `all` that open
    #[arg(long, value_name = "PATHS", env = "KARAT_PATHS")]
    paths: Option<String>,
    /// Paths that must run
    #[arg(long, value_name = "PATHS", env = "KARAT_REQUIRE")]
    require: Option<String>,
    #[command(flatten)]
    package: PackageArgs,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let project = Project::find()?;
    // The record of the last run stays until there is another one.
    let folder = project.output().join("record");
    let running = project.output().join("record.running");
    clear(&running)?;
    let passed = run_cargo(args, &project, &running, out)?;
    let records = if running.is_dir() { record::read(&running)? } else { Vec::new() };
    expect_some(&records, args.filter.as_deref())?;
    clear(&folder)?;
    std::fs::rename(&running, &folder)
        .with_context(|| format!("can't keep the record as `{}`", folder.display()))?;
    let failed = write_functions(&records, out)?;
    let failed = write_frames(&records, out)? + failed;
    // With a filter most functions aren't tested on purpose.
    if args.filter.is_none() {
        write_untested(&records, &project, args, out)?;
    }
    let count = records.len();
    let good = passed && failed == 0;
    let style = if good { GOOD } else { BAD };
    let known = known_issues(&records);
    let cases: u64 = records.iter().flat_map(|record| &record.paths).map(|path| path.cases).sum();
    writeln!(
        out,
        "\n{style}{count} checks, {failed} failed{known}{style:#}, {cases} cases compared"
    )?;
    writeln!(out, "{DIM}record: {}{DIM:#}", folder.display())?;
    let overlays: BTreeSet<_> = records.iter().filter_map(|r| r.overlay.as_ref()).collect();
    for overlay in overlays {
        writeln!(out, "{BAD}with KARAT_OVERLAY={overlay}: not the modules of the packages{BAD:#}")?;
    }
    if failed == 0 && !passed {
        writeln!(out, "{BAD}a test failed outside of Karat's checks, see above{BAD:#}")?;
    }
    Ok(if good { Verdict::Good } else { Verdict::Bad })
}

/// Refuses a run without a verdict.
fn expect_some(records: &[Record], filter: Option<&str>) -> anyhow::Result<()> {
    if !records.is_empty() {
        return Ok(());
    }
    match filter {
        Some(filter) => bail!(
            "no check ran in a test whose name contains `{filter}`; a run that compared nothing is \
             no success"
        ),
        None => bail!("no test ran a check; a run that compared nothing is no success"),
    }
}

/// How many of the records are of known issues, for the last line.
fn known_issues(records: &[Record]) -> String {
    match records.iter().filter(|record| record.verdict == Recorded::KnownIssue).count() {
        0 => String::new(),
        1 => ", 1 known issue".to_owned(),
        count => format!(", {count} known issues"),
    }
}

/// Removes the record of the last run.
fn clear(folder: &Path) -> anyhow::Result<()> {
    match std::fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("can't clear `{}`", folder.display()))
        }
        _ => Ok(()),
    }
}

/// Runs `cargo test`; whether it succeeded. On a terminal a bar stands for tests that pass.
fn run_cargo(
    args: &Args,
    project: &Project,
    folder: &Path,
    out: &mut dyn Write,
) -> anyhow::Result<bool> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut command = Command::new(cargo);
    command.current_dir(project.root()).args(["test", "--no-fail-fast"]);
    match args.cargo_packages.as_slice() {
        [] => {
            command.arg("--workspace");
        }
        packages => {
            for package in packages {
                command.args(["--package", package]);
            }
        }
    }
    // Unit tests and integration tests; examples, benchmarks and documentation check nothing.
    match args.targets.as_slice() {
        [] => {
            command.arg("--tests");
        }
        targets => {
            for target in targets {
                command.args(["--test", target]);
            }
        }
    }
    command.args(&args.filter);
    command.env("KARAT_RECORD", folder);
    command.envs(args.paths.as_ref().map(|paths| ("KARAT_PATHS", paths)));
    command.envs(args.require.as_ref().map(|paths| ("KARAT_REQUIRE", paths)));
    command.stdout(Stdio::piped());
    let mut child = command.spawn().context("can't run `cargo test`")?;
    let lines = BufReader::new(child.stdout.take().context("cargo's output is piped")?).lines();

    let bar = if std::io::stderr().is_terminal() {
        ProgressBar::new(0).with_style(
            ProgressStyle::with_template("{bar:40} {pos} of {len} tests  {wide_msg}")
                .expect("the template is valid"),
        )
    } else {
        ProgressBar::hidden()
    };
    for line in lines {
        let line = line.context("cargo's output ended early")?;
        let running = line.strip_prefix("running ").and_then(|rest| rest.split(' ').next());
        if let Some(count) = running.and_then(|count| count.parse::<u64>().ok()) {
            bar.inc_length(count);
        } else if let Some(name) =
            line.strip_prefix("test ").and_then(|l| l.strip_suffix(" ... ok"))
        {
            bar.inc(1);
            bar.set_message(name.to_owned());
        } else if !is_noise(&line) {
            bar.suspend(|| writeln!(out, "{line}"))?;
        }
    }
    bar.finish_and_clear();
    Ok(child.wait().context("`cargo test` vanished")?.success())
}

/// Lines that say nothing beyond the table.
fn is_noise(line: &str) -> bool {
    line.is_empty() || line.starts_with("test result: ok")
}

/// One row for each check and path; the number of checks that failed.
fn write_functions(records: &[Record], out: &mut dyn Write) -> anyhow::Result<usize> {
    let head = ["function", "check", "path", "cases", "worst", "of bound", "asserted"];
    let mut table = Table::new(&head, &[3, 5]);
    let mut failed = 0;
    for record in records {
        let Subject::Function { function, check, assertion, .. } = &record.subject else {
            continue;
        };
        failed += usize::from(is_failure(record));
        add_rows(&mut table, &[function, check], record, assertion);
    }
    if !table.is_empty() {
        table.write(out)?;
    }
    Ok(failed)
}

fn write_frames(records: &[Record], out: &mut dyn Write) -> anyhow::Result<usize> {
    let head = ["frame", "path", "pixels", "worst", "of bound", "asserted"];
    let mut table = Table::new(&head, &[2, 4]);
    let mut failed = 0;
    for record in records {
        let Subject::Frame { golden } = &record.subject else { continue };
        failed += usize::from(is_failure(record));
        add_rows(&mut table, &[golden], record, "matches its golden");
    }
    if !table.is_empty() {
        writeln!(out)?;
        table.write(out)?;
    }
    Ok(failed)
}

fn is_failure(record: &Record) -> bool {
    !matches!(record.verdict, Recorded::Pass | Recorded::KnownIssue)
}

/// A row for each path of a record, or one that says that none ran.
fn add_rows(table: &mut Table, names: &[&str], record: &Record, assertion: &str) {
    let mut row = |style, cells: [&str; 5]| {
        let cells = names.iter().chain(&cells).map(ToString::to_string).collect();
        table.row(style, cells);
    };
    if record.paths.is_empty() {
        row(BAD, ["-", "0", "ERROR", "", assertion]);
    }
    for path in &record.paths {
        let good = path.failures == 0 && path.cases > 0;
        let (style, word) = match (&path.known_issue, good) {
            (None, true) => (GOOD, ""),
            (None, false) => (BAD, "FAIL "),
            (Some(_), false) => (KNOWN, "known issue "),
            (Some(_), true) => (BAD, "UNEXPECTED PASS "),
        };
        let worst = format!("{word}{}", path.worst);
        let share = path.ratio.map_or_else(String::new, |ratio| format!("{:.0}%", 100.0 * ratio));
        let asserted = match &path.known_issue {
            Some(reason) => format!("{}; known issue: {reason}", path.asserted),
            None => path.asserted.clone(),
        };
        let cases = path.cases.to_string();
        row(style, [&path.adapter.path, &cases, worst.trim_end(), &share, &asserted]);
    }
}

fn write_untested(
    records: &[Record],
    project: &Project,
    args: &Args,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let tested: BTreeSet<&str> = records
        .iter()
        .filter_map(|record| match &record.subject {
            Subject::Function { function, .. } => Some(function.as_str()),
            Subject::Frame { .. } => None,
        })
        .collect();
    let mut untested = Vec::new();
    for package in project.packages(&args.package)? {
        let items = callable(&package)?;
        untested.extend(items.into_iter().filter(|item| !tested.contains(item.path.as_str())));
    }
    if untested.is_empty() {
        return Ok(());
    }
    writeln!(out, "\n{HEAD}functions with no test of their own{HEAD:#}")?;
    for item in untested {
        writeln!(out, "{DIM}{}  {}{DIM:#}", item.path, item.span)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use karat::Adapter;
    use karat::record::PathRecord;

    use super::*;

    fn record(verdict: Recorded, failures: u64, known_issue: Option<&str>) -> Record {
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
        };
        let subject = Subject::Function {
            package: String::new(),
            function: "m::f".to_owned(),
            check: "agrees_with".to_owned(),
            assertion: "1 ulp".to_owned(),
            location: String::new(),
            seed: 0,
        };
        let test = "t".to_owned();
        let (schema, paths) = (record::SCHEMA, vec![path]);
        Record { schema, test, subject, verdict, paths, message: None, overlay: None }
    }

    fn table(record: Record) -> (usize, String) {
        let mut out = Vec::new();
        let failed = write_functions(&[record], &mut out).expect("written");
        (failed, String::from_utf8(out).expect("UTF-8"))
    }

    #[test]
    fn a_known_issue_is_shown_with_its_reason_and_neither_passes_nor_fails() {
        let known = record(Recorded::KnownIssue, 9, Some("mesa#1: mix cancels"));
        assert_eq!(known_issues(&[known.clone(), known.clone()]), ", 2 known issues");
        let (failed, text) = table(known);
        assert_eq!(failed, 0);
        assert!(text.contains("known issue 7 ulp"), "{text}");
        assert!(text.contains("1 ulp; known issue: mesa#1: mix cancels"), "{text}");
        assert!(text.contains(&KNOWN.to_string()) && !text.contains(&GOOD.to_string()), "{text}");
    }

    #[test]
    fn an_unexpected_pass_fails() {
        let (failed, text) = table(record(Recorded::Fail, 0, Some("mesa#1: mix cancels")));
        assert_eq!(failed, 1);
        assert!(text.contains("UNEXPECTED PASS") && !text.contains(&GOOD.to_string()), "{text}");
        assert_eq!(known_issues(&[record(Recorded::Pass, 0, None)]), "");
        let (failed, text) = table(record(Recorded::Fail, 3, None));
        assert!(failed == 1 && text.contains("FAIL 7 ulp"), "{text}");
    }

    #[test]
    fn a_run_without_a_record_is_no_success() {
        for filter in [None, Some("x")] {
            let error = expect_some(&[], filter).expect_err("nothing ran").to_string();
            assert!(error.contains("a run that compared nothing is no success"), "{error}");
        }
        assert!(expect_some(&[record(Recorded::Pass, 0, None)], None).is_ok());
    }
}
