//! Runs child processes in the workspace's root. The child processes write directly to this program's output.

use std::error::Error;
use std::ffi::{OsStr, OsString};
use std::fmt;
use std::path::PathBuf;
use std::process::{Command, ExitStatus};

use anyhow::{Context, Result};

/// Returns the workspace's root folder, in which every child process runs.
pub(crate) fn root() -> PathBuf {
    let package = PathBuf::from(env!("CARGO_MANIFEST_DIR"));
    package.parent().map_or_else(|| package.clone(), PathBuf::from)
}

/// Returns a `cargo` command. If `CARGO` names the cargo that runs this program, the command uses the same cargo.
pub(crate) fn cargo(arguments: &[&str]) -> Command {
    let program = std::env::var_os("CARGO").unwrap_or_else(|| OsString::from("cargo"));
    let mut command = Command::new(program);
    command.args(arguments).current_dir(root());
    // CI never compiles a second edit, so it doesn't need incremental data.
    if std::env::var_os("CI").is_some() && std::env::var_os("CARGO_INCREMENTAL").is_none() {
        command.env("CARGO_INCREMENTAL", "0");
    }
    command
}

/// Returns a `karat` command. The build step has put the program `karat` beside this program.
pub(crate) fn karat(arguments: &[&str]) -> Result<Command> {
    let program = std::env::current_exe()
        .context("could not find out where cargo puts its programs; run `cargo karat` instead")?
        .with_file_name(format!("karat{}", std::env::consts::EXE_SUFFIX));
    let mut command = Command::new(program);
    command.args(arguments).current_dir(root());
    Ok(command)
}

/// Runs a command to its end. The command's output goes to this program's output. If the command fails, the error has
/// the command's exit status: see [`exit_code`].
pub(crate) fn run(command: &mut Command) -> Result<()> {
    let line = describe(command);
    let status = command.status().with_context(|| {
        format!("could not start `{line}`; is its program installed and on PATH?")
    })?;
    if status.success() { Ok(()) } else { Err(Failure { line, status }.into()) }
}

/// Runs a command as [`run`] does, but sends its stdout to stderr.
pub(crate) fn run_aside(command: &mut Command) -> Result<()> {
    run(command.stdout(std::io::stderr()))
}

/// Checks if a command runs and succeeds. Drops the command's output.
pub(crate) fn succeeds(command: &mut Command) -> bool {
    command.output().is_ok_and(|output| output.status.success())
}

/// Returns the command as you would type it in a shell, with its environment variables in front.
pub(crate) fn describe(command: &Command) -> String {
    let variables = command.get_envs().filter_map(|(name, value)| {
        Some(format!("{}={}", name.display(), quoted(&value?.to_string_lossy())))
    });
    let program = PathBuf::from(command.get_program());
    let program = program.file_stem().unwrap_or(command.get_program()).to_os_string();
    let words = std::iter::once(program.as_os_str()).chain(command.get_args());
    variables
        .chain(words.map(OsStr::to_string_lossy).map(|word| quoted(&word)))
        .collect::<Vec<_>>()
        .join(" ")
}

fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_=,.:/+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) { word.to_owned() } else { format!("'{word}'") }
}

/// Returns the exit code for an error: the exit code of the child process that failed, or 1 for other errors.
pub(crate) fn exit_code(error: &anyhow::Error) -> u8 {
    error
        .downcast_ref::<Failure>()
        .and_then(|failure| u8::try_from(failure.status.code()?).ok())
        .unwrap_or(1)
}

/// A child process that ran and failed.
#[derive(Debug)]
struct Failure {
    line: String,
    status: ExitStatus,
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "`{}` failed ({}); its output is above", self.line, self.status)
    }
}

impl Error for Failure {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_is_printed_with_its_variables_and_quotes() {
        let mut command = Command::new("/some/folder/cargo");
        command.args(["doc", "--cfg", "feature = x"]).env("RUSTDOCFLAGS", "-Dwarnings");
        assert_eq!(describe(&command), "RUSTDOCFLAGS=-Dwarnings cargo doc --cfg 'feature = x'");
    }

    #[test]
    fn the_workspace_root_holds_the_manifest() {
        assert!(root().join("Cargo.toml").is_file());
    }

    #[test]
    fn a_childs_exit_code_is_kept() {
        let error = run(cargo(&["--no-such-option"]).stderr(std::process::Stdio::null()))
            .expect_err("cargo refuses the option");
        assert_eq!(exit_code(&error), 1);
        assert!(error.to_string().contains("cargo --no-such-option` failed"), "{error}");
        assert_eq!(exit_code(&anyhow::anyhow!("no child at all")), 1);
    }

    #[test]
    fn a_missing_program_is_named() {
        let error = run(&mut Command::new("karat-no-such-program")).expect_err("it isn't there");
        assert!(error.to_string().contains("could not start `karat-no-such-program`"), "{error}");
    }
}
