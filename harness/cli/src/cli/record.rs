//! `karat record`: runs another test runner, and records the verdicts of its checks as one run.

use std::ffi::OsString;
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, ensure};
use karat::unstable::output::Output;
use karat::unstable::record::{self, Run, Running};
use karat::unstable::reflect::Opinion;

use super::project::Project;
use super::report::{OutputArgs, Sum, short, tables};
use super::test::unwritable;
use super::{Outcome, child};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Keeps the record in this new or empty folder, for `karat report --merge` [default: the record of the project's
    /// last run]
    #[arg(long, value_name = "DIR")]
    into: Option<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
    /// The command that runs the tests, with its arguments
    #[arg(last = true, required = true, value_name = "COMMAND")]
    command: Vec<OsString>,
}

/// The destination of the run's records.
enum Place {
    /// The project's folder of records. The run becomes the project's last run.
    Project(Running),
    Folder(PathBuf),
}

impl Place {
    fn of(into: Option<&Path>, project: &Project) -> anyhow::Result<Self> {
        let Some(folder) = into else {
            let running = Running::begin(&project.record()).with_context(|| unwritable(project))?;
            return Ok(Self::Project(running));
        };
        let name = || format!("`{}`", folder.display());
        std::fs::create_dir_all(folder).with_context(name)?;
        let mut entries = std::fs::read_dir(folder).with_context(name)?;
        ensure!(
            entries.next().is_none(),
            "the folder {} isn't empty, and a record needs an empty folder: delete this folder, or name another folder",
            name()
        );
        // The path must be absolute, because tests run in the folders of their packages.
        Ok(Self::Folder(folder.canonicalize().with_context(name)?))
    }

    fn folder(&self) -> &Path {
        match self {
            Self::Project(running) => running.folder(),
            Self::Folder(folder) => folder,
        }
    }

    fn end(self) -> std::io::Result<PathBuf> {
        match self {
            Self::Project(running) => running.end(),
            Self::Folder(folder) => Ok(folder),
        }
    }
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let mut unread = std::io::sink();
    let project = Project::find()?;
    args.output.spare(&project.record())?;
    let place = Place::of(args.into.as_deref(), &project)?;
    args.output.clear()?;
    let held = args.output.hold_commands(out)?;
    let told: &mut dyn Write = if args.output.short { &mut unread } else { &mut *out };
    let [program, arguments @ ..] = args.command.as_slice() else {
        anyhow::bail!("name the command that runs the tests: `karat record -- cargo nextest run`");
    };
    let mut command = Command::new(program);
    command.args(arguments).env("KARAT_RECORD", place.folder());
    let mut heard = Heard::default();
    let passed = heard.run(&mut command, told)?;
    let records = record::read(place.folder())?;
    if passed {
        tables::expect_some(&records, None)?;
    }
    let words: Vec<_> = args.command.iter().map(|word| word.to_string_lossy()).collect();
    let Heard { not_run, stopped } = heard;
    let selected = vec![words.join(" ")];
    let run = Run { selected, passed, not_run, stopped, ..Run::default() };
    run.write(place.folder()).context("can't write the `run.json` of the record")?;
    let folder = place.end().context("can't keep the record")?;
    let sum = Sum::of(&records, Some(&run));
    tables::write(&records, args.output.all, told)?;
    tables::write_sum(&records, &sum, &folder, told)?;
    if args.output.short {
        short::write(&records, (&[], &Opinion::default()), &sum, project.root(), out)?;
    }
    args.output.write(&records, Some(&run), &sum, held, &project, out)?;
    Ok(sum.ending())
}

/// The tests that the runner skipped after a failure, according to the runner's output.
#[derive(Debug, Default, PartialEq, Eq)]
struct Heard {
    /// The number of skipped tests, if the runner prints it.
    not_run: u64,
    /// `true` if the runner stopped early without printing a number.
    stopped: bool,
}

impl Heard {
    /// Runs the command, and checks if it succeeds.
    fn run(&mut self, command: &mut Command, out: &mut dyn Write) -> anyhow::Result<bool> {
        let is_seen = std::io::stderr().is_terminal();
        // The command writes into a pipe, but a person reads its output on a terminal.
        if is_seen && std::env::var_os("CARGO_TERM_COLOR").is_none() {
            command.env("CARGO_TERM_COLOR", "always");
        }
        let mut err = Output::new(std::io::stderr());
        let mut error = |line: &str| {
            self.hear(line);
            Ok(writeln!(err, "{line}")?)
        };
        let mut line = |line: &str| {
            writeln!(out, "{line}")?;
            Ok(out.flush()?)
        };
        Ok(child::run_heard(command, &mut error, &mut line)?.success())
    }

    /// Reads a line of standard error. nextest prints `warning: 4/5 tests were not run due to test failure`. Cargo
    /// stops at the first test program that fails, and prints `error: test failed, to rerun pass ..`. With
    /// `--no-fail-fast`, Cargo prints the same line, but runs all programs, and ends with `error: 2 targets failed:`.
    fn hear(&mut self, line: &str) {
        let line = anstream::adapter::strip_str(line).to_string();
        if let Some((count, _)) = line.split_once(" were not run due to ") {
            let count = count.trim_start_matches("warning: ");
            self.not_run = count.split(['/', ' ']).next().and_then(|n| n.parse().ok()).unwrap_or(0);
            self.stopped |= self.not_run == 0;
        }
        let Some(error) = line.strip_prefix("error: ") else { return };
        let failed = ["test failed, to rerun pass ", "doctest failed, to rerun pass "];
        self.stopped |= failed.iter().any(|failed| error.starts_with(failed));
        if error.ends_with(" target failed:") || error.ends_with(" targets failed:") {
            self.stopped = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    // Lesson 183
    #[test]
    fn skipped_tests_are_read_from_the_output_of_runners() {
        let heard = |lines: &str| {
            let mut heard = Heard::default();
            lines.lines().for_each(|line| heard.hear(line));
            heard
        };
        let nextest =
            "warning: 4/5 tests were not run due to test failure (run with --no-fail-fast ..)";
        assert_eq!(heard(nextest), Heard { not_run: 4, stopped: false });
        let coloured = "\u{1b}[33mwarning\u{1b}[0m: 12/50 tests were not run due to test failure";
        assert_eq!(heard(coloured), Heard { not_run: 12, stopped: false });
        let cargo = "error: test failed, to rerun pass `--lib`";
        assert_eq!(heard(cargo), Heard { not_run: 0, stopped: true });
        let doctest = "error: doctest failed, to rerun pass `--doc`";
        assert_eq!(heard(doctest), Heard { not_run: 0, stopped: true });
        assert_eq!(heard("test a ... FAILED"), Heard::default());
        // With `--no-fail-fast`, Cargo runs all test programs.
        for end in ["1 target failed:", "2 targets failed:\n    `--lib`\n    `--doc`"] {
            let all = format!("{cargo}\n{doctest}\nerror: {end}\n");
            assert_eq!(heard(&all), Heard::default(), "{all}");
        }
        let coloured = format!("{cargo}\n\u{1b}[1m\u{1b}[91merror\u{1b}[0m: 1 target failed:");
        assert_eq!(heard(&coloured), Heard::default());
    }
}
