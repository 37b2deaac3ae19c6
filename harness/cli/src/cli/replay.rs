//! `karat replay`: the case that a check of the last run failed on, by a short name.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, ensure};
use karat::diagnostic::nearest;
use karat::record::{Record, Recorded};

use super::project::Project;
use super::report::{Names, is_failure};
use super::{Ending, NotThere, Outcome, child};

#[derive(clap::Args)]
pub(super) struct Args {
    /// The name that `karat test` gives a failure [default: the only one]
    name: Option<String>,
    /// Print the whole command, and run nothing
    #[arg(long)]
    print: bool,
}

/// How many characters a name has at least.
const LENGTH: usize = 4;

/// The names of the failures of a run: the beginnings of hashes of what failed, so that a failure keeps
/// its name from run to run. All are as long as the longest needs to be.
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
        // A test that makes one check twice: the first is replayed, as it ends the test.
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

/// The command that replays the simplest case of a failure: a message has that of the worst, then that
/// of the simplest that it was reduced to, for each path.
fn command(record: &Record) -> Option<&str> {
    let message = record.message.as_deref()?;
    let first = message.lines().take_while({
        let mut paths = 0;
        move |line| {
            paths += usize::from(line.starts_with("on "));
            paths < 2
        }
    });
    first.filter_map(|line| line.trim_start().strip_prefix("replay: ")).last()
}

pub(super) fn run(args: &Args, out: &mut dyn Write) -> Outcome {
    let project = Project::find()?;
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
                    let which = format!("several failures begin with `{name}`: {}", list());
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
            return Err(NotThere(format!("which one?{lines}")).into());
        }
        None => names.first(),
    };
    let Some((_, record)) = found else {
        let Some(name) = args.name.as_deref().filter(|_| !names.is_empty()) else {
            let none = "no failure of the last run can be replayed: each passed, or has no cases";
            return Err(NotThere(none.to_owned()).into());
        };
        let near = nearest(name, known()).map_or_else(list, str::to_owned);
        let none = format!("no failure of the last run is called `{name}`; there is {near}");
        return Err(NotThere(none).into());
    };
    let command = command(record).context("the record has the command")?;
    if args.print {
        writeln!(out, "{command}")?;
        return Ok(Ending::Good);
    }
    let mut command = parsed(command, project.root())?;
    let status = child::pass_on(&mut command, out)?;
    Ok(if status.success() { Ending::Good } else { Ending::Bad })
}

/// Where a recorded command runs: in the project's folder. `karat test FOLDER` was run in one that has FOLDER,
/// which is in the project.
fn start(project: &Path, arguments: &[&String]) -> PathBuf {
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

/// A line for a shell as a command: variables, the program, its arguments.
fn parsed(line: &str, folder: &Path) -> anyhow::Result<Command> {
    let words = shell_words::split(line).context("the record's command can't be read")?;
    let is_variable = |word: &&String| word.starts_with("KARAT_") && word.contains('=');
    let variables: Vec<&String> = words.iter().take_while(is_variable).collect();
    let mut rest = words.iter().skip(variables.len());
    let program = rest.next().map(String::as_str);
    ensure!(matches!(program, Some("cargo" | "karat")), "the record's command is another program");
    let mut command = match program {
        Some("cargo") => Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into())),
        _ => Command::new(std::env::current_exe().context("this program isn't where it was")?),
    };
    let arguments: Vec<&String> = rest.collect();
    command.current_dir(start(folder, &arguments)).args(arguments);
    command.envs(variables.iter().filter_map(|word| word.split_once('=')));
    // What the last run was told doesn't choose this one's paths.
    command.env_remove("KARAT_REQUIRE");
    Ok(command)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_has_variables_a_program_and_arguments() {
        let line =
            "KARAT_PATHS=gl KARAT_CASE='a::f/agrees_with#2/7' cargo test -p x -- --exact 'a b'";
        let command = parsed(line, Path::new(".")).expect("it is one");
        let arguments: Vec<_> = command.get_args().map(|word| word.to_string_lossy()).collect();
        assert_eq!(arguments, ["test", "-p", "x", "--", "--exact", "a b"]);
        let variable = command.get_envs().find(|(name, _)| *name == "KARAT_CASE");
        let value = variable.and_then(|(_, value)| value).expect("it is set");
        assert_eq!(value, "a::f/agrees_with#2/7");
        for other in ["rm -rf /", "KARAT_CASE=a", "", "PATH=. cargo test", "cargo 'test"] {
            assert!(parsed(other, Path::new(".")).is_err(), "{other}");
        }
    }
}
