//! Runs other programs. If the reader of Karat's output ends early, as `head` does, the programs that Karat runs keep
//! their exit codes.

use std::io::{BufRead, BufReader, IsTerminal, Read, Write};
use std::process::{ChildStderr, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use anyhow::Context;
use karat::unstable::output::{Output, with_colours};
use tempfile::TempDir;

/// Runs a program, and prints each line of its output without delay. On a terminal the output keeps its colours.
pub(super) fn pass_on(command: &mut Command, out: &mut dyn Write) -> anyhow::Result<ExitStatus> {
    if std::io::stdout().is_terminal() && std::io::stderr().is_terminal() {
        let name = command.get_program().display().to_string();
        return command.status().with_context(|| format!("can't run `{name}`"));
    }
    run(command, |line| {
        writeln!(out, "{line}")?;
        Ok(out.flush()?)
    })
}

/// Parses a line of Rust's test runner, such as `test fresnel::is_reciprocal ... ok`. Returns the name of the test and
/// the verdict.
pub(super) fn verdict(line: &str) -> Option<(&str, &str)> {
    let (name, word) = line.strip_prefix("test ")?.rsplit_once(" ... ")?;
    Some((name.strip_suffix(" - should panic").unwrap_or(name), word))
}

/// Runs a program, and calls `line` with each line of its standard output.
///
/// If Karat's standard error isn't a terminal, Karat reads the program's standard error, and prints each line to its
/// own standard error. If the program wrote directly to a closed pipe, the program would end before it prints its
/// verdict.
pub(super) fn run(
    command: &mut Command,
    line: impl FnMut(&str) -> anyhow::Result<()>,
) -> anyhow::Result<ExitStatus> {
    let is_seen = std::io::stderr().is_terminal();
    command.stderr(if is_seen { Stdio::inherit() } else { Stdio::piped() });
    // The program has already chosen its colours.
    let mut err = Output::new(std::io::stderr());
    listen(command, |text| Ok(writeln!(err, "{text}")?), line)
}

/// Runs a program. Calls `error` with each line of its standard error, and `line` with each line of its standard
/// output.
pub(super) fn run_heard(
    command: &mut Command,
    error: impl FnMut(&str) -> anyhow::Result<()> + Send,
    line: impl FnMut(&str) -> anyhow::Result<()>,
) -> anyhow::Result<ExitStatus> {
    listen(command.stderr(Stdio::piped()), error, line)
}

fn listen(
    command: &mut Command,
    error: impl FnMut(&str) -> anyhow::Result<()> + Send,
    mut line: impl FnMut(&str) -> anyhow::Result<()>,
) -> anyhow::Result<ExitStatus> {
    let name = command.get_program().display().to_string();
    let mut child =
        command.stdout(Stdio::piped()).spawn().with_context(|| format!("can't run `{name}`"))?;
    let (stdout, stderr) = (child.stdout.take(), child.stderr.take());
    // Standard input stays open until the program ends: some programs end when their input ends.
    let _stdin = child.stdin.take();
    std::thread::scope(|scope| {
        scope.spawn(|| drop(stderr.map(|stderr| lines(stderr, error))));
        stdout.map_or(Ok(()), |stdout| lines(stdout, &mut line))
    })?;
    child.wait().with_context(|| format!("`{name}` vanished"))
}

/// The standard error of a program. A separate thread reads this text, while the caller reads the standard output.
pub(super) struct LastWords(JoinHandle<Vec<u8>>);

impl LastWords {
    pub(super) fn of(mut stderr: ChildStderr) -> Self {
        Self(std::thread::spawn(move || {
            let mut text = Vec::new();
            drop(stderr.read_to_end(&mut text));
            text
        }))
    }

    /// Waits until the program ends, and returns its whole standard error.
    pub(super) fn heard(self) -> String {
        let text = self.0.join().unwrap_or_default();
        String::from_utf8_lossy(&text).trim().to_owned()
    }
}

/// Calls `line` with each line of `from`. Bytes that aren't UTF-8 are replaced.
fn lines(from: impl Read, mut line: impl FnMut(&str) -> anyhow::Result<()>) -> anyhow::Result<()> {
    for bytes in BufReader::new(from).split(b'\n') {
        let text = bytes.context("can't read the whole output of a program")?;
        let text = String::from_utf8_lossy(&text);
        line(&with_colours(text.strip_suffix('\r').unwrap_or(&text)))?;
    }
    Ok(())
}

/// Runs a child process that uses a temporary folder. After Ctrl-C, which ends the child, Karat first deletes the
/// folder and then ends, too.
pub(super) fn status_over(
    command: &mut Command,
    folder: TempDir,
) -> anyhow::Result<(ExitStatus, TempDir)> {
    static INTERRUPTED: AtomicBool = AtomicBool::new(false);
    ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::Relaxed))
        .context("can't wait for Ctrl-C")?;
    let status = command.status()?;
    if INTERRUPTED.load(Ordering::Relaxed) {
        drop(folder);
        const SIGINT: i32 = 130; // 128 and the number of SIGINT, as shells have it
        std::process::exit(SIGINT);
    }
    Ok((status, folder))
}
