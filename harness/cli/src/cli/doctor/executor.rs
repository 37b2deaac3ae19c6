//! `karat doctor --executor NAME`: jobs with known answers.

use std::io::Write;

use karat::Path;
use karat::path::PathError;
use karat::unstable::output::visible;
use karat::unstable::path::Api;
use karat_inspect::conform::{Answer, Answered, Report, conform};

use super::super::table::{BAD, DIM, GOOD, HEAD};
use super::super::{Ending, Outcome, write_json};

/// A path by its name, or that of a program that KARAT_EXECUTORS names.
fn path(name: &str) -> Result<Path, PathError> {
    name.parse().or_else(|_| format!("{}@{name}", Api::Process.name()).parse())
}

pub(super) fn run(name: &str, json: bool, out: &mut dyn Write) -> Outcome {
    let path = path(name)?;
    let report = conform(path)?;
    if json {
        write_json(&report, out)?;
    } else {
        write_text(path, &report, out)?;
    }
    Ok(if report.wrong() == 0 { Ending::Good } else { Ending::Bad })
}

fn write_text(path: Path, report: &Report, out: &mut dyn Write) -> std::io::Result<()> {
    let (name, driver) = (visible(&report.adapter.name), visible(&report.adapter.driver));
    let space = if driver.is_empty() { "" } else { " " };
    writeln!(out, "{HEAD}{path}{HEAD:#} {name}{space}{driver}\n")?;
    for Answered { name, rule, answer } in &report.answers {
        match answer {
            Answer::Right => {
                writeln!(out, "{GOOD}right     {GOOD:#} {name:<10} {DIM}{rule}{DIM:#}")?
            }
            Answer::NotAsked(ability) => {
                writeln!(
                    out,
                    "not asked  {name:<10} {DIM}its greeting doesn't say {ability}{DIM:#}"
                )?;
            }
            Answer::Wrong(how) => {
                writeln!(out, "{BAD}wrong     {BAD:#} {name:<10} {rule}")?;
                for line in visible(how).lines() {
                    writeln!(out, "           {line}")?;
                }
            }
        }
    }
    let (all, wrong, unasked) = (report.answers.len(), report.wrong(), report.unasked());
    let right = all - wrong - unasked;
    let colour = if wrong == 0 { GOOD } else { BAD };
    writeln!(out, "\n{colour}{right} right, {wrong} wrong{colour:#}, {unasked} of {all} not asked")
}
