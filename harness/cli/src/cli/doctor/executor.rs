//! `karat doctor --executor NAME`: sends jobs with known results to an executor, and checks the replies.

use std::io::Write;

use karat::Path;
use karat::path::PathError;
use karat::unstable::diagnostic::one_line;
use karat::unstable::output::visible;
use karat::unstable::path::{adapter, programs};
use karat_inspect::conform::{Answer, Answered, conform};

use super::super::table::{BAD, DIM, GOOD, HEAD, KNOWN};
use super::super::{Ending, Outcome, write_json};

/// Returns the path that runs jobs on the program with this name in `KARAT_EXECUTORS`. If there is no such program,
/// parses the name as a path, such as `vulkan`.
fn path(name: &str) -> Result<Path, PathError> {
    if let Some(own) = programs()?.into_iter().find(|path| path.driver() == Some(name)) {
        return Ok(own);
    }
    name.parse().or_else(|_| format!("process@{name}").parse())
}

pub(super) fn run(name: &str, json: bool, out: &mut dyn Write) -> Outcome {
    let path = path(name)?;
    let about = adapter(path)?;
    if !json {
        let [name, driver] = [&about.name, &about.driver].map(|text| one_line(text));
        let driver = if driver.is_empty() { driver } else { format!(", {driver}") };
        writeln!(out, "{HEAD}{path}{HEAD:#}: {}{}\n", visible(&name), visible(&driver))?;
    }
    // A write error is returned after the last job.
    let mut written = Ok(());
    let report = conform(path, &mut |one| {
        if !json && written.is_ok() {
            written = write_answer(one, out).and_then(|()| out.flush());
        }
    })?;
    written?;
    let wrong = report.count(Answer::Wrong);
    if json {
        write_json(&report, out)?;
    } else {
        let [right, refused, unasked] =
            [Answer::Right, Answer::Refused, Answer::NotAsked].map(|answer| report.count(answer));
        let colour = if wrong == 0 { GOOD } else { BAD };
        writeln!(
            out,
            "\n{colour}{right} jobs right, {wrong} wrong{colour:#}, {refused} refused; {unasked} of {} jobs weren't sent",
            report.answers.len()
        )?;
    }
    Ok(if wrong == 0 { Ending::Good } else { Ending::Bad })
}

fn write_answer(one: &Answered, out: &mut dyn Write) -> std::io::Result<()> {
    let Answered { name, rule, answer, why } = one;
    let why = visible(why);
    match answer {
        Answer::Right => writeln!(out, "{GOOD}right    {GOOD:#}  {name:<10} {DIM}{rule}{DIM:#}"),
        Answer::NotAsked => writeln!(out, "not asked  {name:<10} {DIM}{why}{DIM:#}"),
        Answer::Refused => writeln!(out, "{KNOWN}refused  {KNOWN:#}  {name:<10} {why}"),
        Answer::Wrong => {
            writeln!(out, "{BAD}wrong    {BAD:#}  {name:<10} {rule}")?;
            why.lines().try_for_each(|line| writeln!(out, "           {line}"))
        }
    }
}
