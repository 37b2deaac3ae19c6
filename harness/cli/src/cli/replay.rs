//! `karat replay`: runs a failing case of the last run again. A short name selects the failure.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, ensure};
use karat::unstable::diagnostic::nearest;
use karat::unstable::record::{Record, Recorded, Replay};

use super::project::Project;
use super::report::{Names, is_failure};
use super::{Ending, NotThere, Outcome, child};

#[derive(clap::Args)]
pub(super) struct Args {
    /// The name that `karat test` prints for a failure [default: the only failure]
    name: Option<String>,
    /// Prints the whole command, and runs nothing
    #[arg(long)]
    print: bool,
}

/// The smallest number of characters in the name of a failure.
const LENGTH: usize = 4;

/// Returns the names of a run's failures. A name is the beginning of a hash of the check, so a failure has the same
/// name in each run. All names have the same length, at least [`LENGTH`], and are just long enough to be distinct.
pub(super) fn names<'r>(records: &'r [Record]) -> Vec<(String, &'r Record)> {
    let failed = records.iter().filter(|record| is_failure(record) && command(record).is_some());
    let called = Names::of(records);
    let hash = |record: &Record| {
        let mut hasher = blake3::Hasher::new();
        for part in [&record.cargo_package, &record.test, &called.subject(record)] {
            hasher.update(part.as_bytes()).update(&[0]);
        }
        hasher.finalize().to_hex().to_string()
    };
    let mut all: Vec<(String, &'r Record)> = Vec::new();
    for record in failed {
        let name = hash(record);
        // A test may make the same check twice. The name means the first failure, because it ends the test.
        if all.iter().all(|(known, _)| *known != name) {
            all.push((name, record));
        }
    }
    let unique = |length: usize| {
        let mut heads: Vec<&str> = all.iter().map(|(name, _)| &name[..length]).collect();
        heads.sort_unstable();
        heads.windows(2).all(|pair| pair[0] != pair[1])
    };
    let length = (LENGTH..).find(|length| unique(*length)).unwrap_or(LENGTH);
    all.into_iter().map(|(name, record)| (name[..length].to_owned(), record)).collect()
}

/// Returns the command that replays the simplest case of a failure, on the first path with such a command.
fn command(record: &Record) -> Option<&Replay> {
    let details = record.details.as_ref()?;
    let of_path = details.paths.iter().find_map(|details| details.replays().last());
    of_path.or(details.replay.as_ref())
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let project = Project::last_tested()?;
    let recorded = Recorded::read(&project.record())?;
    let none = || NotThere("there is no record of a run: run `karat test` first".to_owned());
    let records = recorded.ok_or_else(none)?.records;
    let names = names(&records);
    let known = || names.iter().map(|(name, _)| &**name);
    let list = || known().collect::<Vec<_>>().join(", ");
    let found = match &args.name {
        Some(name) => {
            let mut fitting = names.iter().filter(|(own, _)| own.starts_with(&**name));
            match (fitting.next(), fitting.next()) {
                (Some(found), None) => Some(found),
                (Some(_), Some(_)) => {
                    let which =
                        format!("the names of several failures begin with `{name}`: {}", list());
                    return Err(NotThere(which).into());
                }
                (None, _) => None,
            }
        }
        None if names.len() > 1 => {
            let called = Names::of(&records);
            let lines = names
                .iter()
                .map(|(name, record)| format!("\n  {name}  {}", called.subject(record)));
            let lines: String = lines.collect();
            return Err(NotThere(format!("name one of these failures:{lines}")).into());
        }
        None => names.first(),
    };
    let Some((_, record)) = found else {
        let Some(name) = args.name.as_deref().filter(|_| !names.is_empty()) else {
            let none = "no failure of the last run can be replayed: all checks passed, or only checks without cases, such as frames, failed";
            return Err(NotThere(none.to_owned()).into());
        };
        let near = nearest(name, known()).map_or_else(list, str::to_owned);
        let none = format!("no failure of the last run is called `{name}`; did you mean {near}?");
        return Err(NotThere(none).into());
    };
    let command = command(record).context("the record has no command that replays the failure")?;
    if args.print {
        writeln!(out, "{command}")?;
        return Ok(Ending::Good);
    }
    let mut command = made(command, project.root())?;
    let status = child::pass_on(&mut command, out)?;
    Ok(if status.success() { Ending::Good } else { Ending::Bad })
}

/// Returns the folder in which a recorded command runs: for `karat test FOLDER` the parent of FOLDER, and otherwise the
/// project's folder.
fn start(project: &Path, arguments: &[String]) -> PathBuf {
    let named = match arguments {
        [verb, folder, ..] if *verb == "test" && !folder.starts_with('-') => Path::new(folder),
        _ => return project.to_owned(),
    };
    let root = project.canonicalize().unwrap_or_else(|_| project.to_owned());
    let has = |from: &&Path| {
        from.join(named).canonicalize().is_ok_and(|folder| folder.starts_with(&root))
    };
    root.ancestors().find(has).unwrap_or(project).to_owned()
}

/// Makes the [`Command`] of a recorded replay. A record may come from another machine, so the command can run only
/// cargo or karat, and set only variables `KARAT_*`.
fn made(replay: &Replay, folder: &Path) -> anyhow::Result<Command> {
    let Replay { variables, program, arguments } = replay;
    let mut command = match &**program {
        "cargo" => Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into())),
        "karat" => {
            Command::new(std::env::current_exe().context("can't find karat's executable file")?)
        }
        other => anyhow::bail!("the record's command must run cargo or karat, not `{other}`"),
    };
    for (name, value) in variables {
        ensure!(name.starts_with("KARAT_"), "a replay can set only KARAT_*, not `{name}`");
        command.env(name, value);
    }
    command.current_dir(start(folder, arguments)).args(arguments);
    // The required paths of the last run don't apply to a replay.
    command.env_remove("KARAT_REQUIRE");
    Ok(command)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_has_variables_a_program_and_arguments() {
        let replay = |program: &str, name: &str| Replay {
            variables: vec![(name.to_owned(), "a::f/agrees_with#2/7".to_owned())],
            program: program.to_owned(),
            arguments: ["test", "--exact", "a b"].map(str::to_owned).to_vec(),
        };
        let command = made(&replay("cargo", "KARAT_CASE"), Path::new(".")).expect("it is one");
        let arguments: Vec<_> = command.get_args().map(|word| word.to_string_lossy()).collect();
        assert_eq!(arguments, ["test", "--exact", "a b"]);
        let variable = command.get_envs().find(|(name, _)| *name == "KARAT_CASE");
        let value = variable.and_then(|(_, value)| value).expect("it is set");
        assert_eq!(value, "a::f/agrees_with#2/7");
        for (program, name) in [("rm", "KARAT_CASE"), ("", "KARAT_CASE"), ("cargo", "PATH")] {
            assert!(made(&replay(program, name), Path::new(".")).is_err(), "{program} {name}");
        }
    }
}
