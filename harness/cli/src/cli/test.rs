//! `karat test`: runs the tests and prints what their records hold.

use std::collections::BTreeSet;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::process::Command;

use anyhow::Context;
use indicatif::{ProgressBar, ProgressStyle};
use karat::Package;
use karat::record::{self, Record, Run, Running, Subject};

use super::list::callable;
use super::project::Project;
use super::report::{OutputArgs, tables};
use super::table::{DIM, HEAD, KNOWN};
use super::{Ending, Outcome, PackageArgs, check, child};

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
    /// Leave frames out, which need a driver
    #[arg(long)]
    functions: bool,
    #[command(flatten)]
    output: OutputArgs,
    #[command(flatten)]
    package: PackageArgs,
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let project = Project::find()?;
    args.output.clear()?;
    // The record of the last run stays until there is another one.
    let running = Running::begin(&project.record()).context("can't keep a record")?;
    let passed = run_cargo(args, &project, running.folder(), out)?;
    let records = record::read(running.folder())?;
    tables::expect_some(&records, args.filter.as_deref())?;
    // Tests call single functions: whatever else their packages hold must be valid, too.
    let packages = project.packages_if_any(&args.package)?;
    let mut invalid = Vec::new();
    let valid = check::validate(&packages, false, &mut invalid)?;
    let run = Run { schema: record::SCHEMA, selected: args.selected(), passed: passed && valid };
    run.write(running.folder()).context("can't say how the run was made")?;
    let folder = running.end().context("can't keep the record")?;
    let failed = tables::write(&records, out)?;
    // With a filter most functions aren't tested on purpose.
    if args.filter.is_none() {
        write_untested(&records, &packages, out)?;
    }
    out.write_all(&invalid)?;
    tables::write_sum(&records, failed, passed, &folder, out)?;
    if args.leaves_frames_out() {
        writeln!(out, "{KNOWN}frames were left out{KNOWN:#}")?;
    }
    args.output.write(&records, Some(&run), &project, out)?;
    Ok(if passed && valid && failed == 0 { Ending::Good } else { Ending::Bad })
}

impl Args {
    /// By the option, or by the variable that it sets.
    fn leaves_frames_out(&self) -> bool {
        self.functions || std::env::var("KARAT_FRAMES").is_ok_and(|frames| frames == "off")
    }

    /// What chooses among the tests, as it was typed.
    fn selected(&self) -> Vec<String> {
        let packages = self.cargo_packages.iter().map(|name| format!("-p {name}"));
        let targets = self.targets.iter().map(|name| format!("--test {name}"));
        let functions = self.functions.then(|| "--functions".to_owned());
        self.filter.iter().cloned().chain(packages).chain(targets).chain(functions).collect()
    }
}

/// Runs `cargo test`; whether it succeeded. On a terminal a bar stands for tests that pass.
fn run_cargo(
    args: &Args,
    project: &Project,
    folder: &Path,
    out: &mut dyn Write,
) -> anyhow::Result<bool> {
    // A slip is told before minutes go into building.
    for (option, names) in [("--paths", &args.paths), ("--require", &args.require)] {
        names.as_deref().map_or(Ok(Vec::new()), |names| karat::path::named(option, names))?;
    }
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
    command.envs(args.functions.then_some(("KARAT_FRAMES", "off")));
    command.envs(args.paths.as_ref().map(|paths| ("KARAT_PATHS", paths)));
    command.envs(args.require.as_ref().map(|paths| ("KARAT_REQUIRE", paths)));
    let bar = if std::io::stderr().is_terminal() {
        ProgressBar::new(0).with_style(
            ProgressStyle::with_template("{bar:40} {pos} of {len} tests  {wide_msg}")
                .expect("the template is valid"),
        )
    } else {
        ProgressBar::hidden()
    };
    let status = child::run(&mut command, |line| {
        let running = line.strip_prefix("running ").and_then(|rest| rest.split(' ').next());
        if let Some(count) = running.and_then(|count| count.parse::<u64>().ok()) {
            bar.inc_length(count);
        } else if let Some(name) =
            line.strip_prefix("test ").and_then(|l| l.strip_suffix(" ... ok"))
        {
            bar.inc(1);
            bar.set_message(name.to_owned());
        } else if !is_noise(line) {
            bar.suspend(|| writeln!(out, "{line}"))?;
        }
        Ok(())
    })?;
    bar.finish_and_clear();
    Ok(status.success())
}

/// Lines that say nothing beyond the table.
fn is_noise(line: &str) -> bool {
    line.is_empty() || line.starts_with("test result: ok")
}

fn write_untested(
    records: &[Record],
    packages: &[Package],
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
    for package in packages {
        let items = callable(package)?;
        untested.extend(items.into_iter().filter(|item| !tested.contains(item.name.as_str())));
    }
    if untested.is_empty() {
        return Ok(());
    }
    writeln!(out, "\n{HEAD}functions with no test of their own{HEAD:#}")?;
    for item in untested {
        writeln!(out, "{DIM}{}  {}{DIM:#}", item.name, item.span)?;
    }
    Ok(())
}
