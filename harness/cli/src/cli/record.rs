//! `karat record`: runs tests by another runner, and keeps what they check as one run.

use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, ensure};
use karat::record::{self, Run, Running, SCHEMA};

use super::project::Project;
use super::report::{OutputArgs, Tests, short, tables};
use super::test::unwritable;
use super::{Ending, Outcome, child};

#[derive(clap::Args)]
pub(super) struct Args {
    /// Keep the record in this folder, new or empty, for `karat report --merge` [default: as the last
    /// run of the project]
    #[arg(long, value_name = "DIR")]
    into: Option<PathBuf>,
    #[command(flatten)]
    output: OutputArgs,
    /// What runs the tests, with its arguments
    #[arg(last = true, required = true, value_name = "COMMAND")]
    command: Vec<OsString>,
}

/// Where the records of the run are kept.
enum Place {
    /// Of the project, where it becomes the last run.
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
            "{} isn't empty, and a record is of one run: remove it, or name another folder",
            name()
        );
        // Tests run in the folders of their packages.
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
    let told: &mut dyn Write = if args.output.short { &mut unread } else { &mut *out };
    let project = Project::find()?;
    args.output.spare(&project.record())?;
    let place = Place::of(args.into.as_deref(), &project)?;
    args.output.clear()?;
    let [program, arguments @ ..] = args.command.as_slice() else {
        anyhow::bail!("no command runs the tests: `karat record -- cargo nextest run`");
    };
    let mut command = Command::new(program);
    command.args(arguments).env("KARAT_RECORD", place.folder());
    let passed = child::pass_on(&mut command, told)?.success();
    let records = record::read(place.folder())?;
    tables::expect_some(&records, None)?;
    // Which tests another runner leaves out nobody knows.
    let words: Vec<_> = args.command.iter().map(|word| word.to_string_lossy()).collect();
    let run = Run { schema: SCHEMA, selected: vec![words.join(" ")], passed };
    run.write(place.folder()).context("can't say how the run was made")?;
    let folder = place.end().context("can't keep the record")?;
    let failed = tables::write(&records, args.output.all, told)?;
    let tests = Tests { failed: &[], passed, told: true };
    tables::write_sum(&records, failed, tests, &folder, told)?;
    if args.output.short {
        short::write(&records, &[], tests, project.root(), out)?;
    }
    args.output.write(&records, Some(&run), &[], &project, out)?;
    Ok(if passed && failed == 0 { Ending::Good } else { Ending::Bad })
}
