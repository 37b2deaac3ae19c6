//! Programs that commands run. They end in the same way whether or not anybody reads their output.

use std::io::{BufRead, BufReader, IsTerminal, Read, Write};
use std::process::{ChildStderr, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use anyhow::Context;
use karat::unstable::output::{Output, with_colours};
use tempfile::TempDir;

/// Runs a program whose output is ours. Terminals show it as it comes, with its colours.
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

/// The test and the word of a line that Rust's test runner writes after a test:
/// `test fresnel::is_reciprocal ... ok`.
pub(super) fn verdict(line: &str) -> Option<(&str, &str)> {
    let (name, word) = line.strip_prefix("test ")?.rsplit_once(" ... ")?;
    Some((name.strip_suffix(" - should panic").unwrap_or(name), word))
}

/// Runs a program, with each line of its standard output given to `line`.
///
/// What it writes to standard error passes through here, too, unless a terminal shows it: a pipe
/// that nobody reads would end the program, and its verdict would be lost.
pub(super) fn run(
    command: &mut Command,
    line: impl FnMut(&str) -> anyhow::Result<()>,
) -> anyhow::Result<ExitStatus> {
    let is_seen = std::io::stderr().is_terminal();
    command.stderr(if is_seen { Stdio::inherit() } else { Stdio::piped() });
    // As it comes: colours were chosen by whoever wrote them.
    let mut err = Output::new(std::io::stderr());
    listen(command, |text| Ok(writeln!(err, "{text}")?), line)
}

/// Runs a program, with each line of its standard error given to `error`, and of its output to `line`.
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
    // Open to its end, for one that ends with its input.
    let _stdin = child.stdin.take();
    std::thread::scope(|scope| {
        scope.spawn(|| drop(stderr.map(|stderr| lines(stderr, error))));
        stdout.map_or(Ok(()), |stdout| lines(stdout, &mut line))
    })?;
    child.wait().with_context(|| format!("`{name}` vanished"))
}

/// What a program writes to standard error, which is read beside its output.
pub(super) struct LastWords(JoinHandle<Vec<u8>>);

impl LastWords {
    pub(super) fn of(mut stderr: ChildStderr) -> Self {
        Self(std::thread::spawn(move || {
            let mut text = Vec::new();
            drop(stderr.read_to_end(&mut text));
            text
        }))
    }

    /// All of them, once the program has ended.
    pub(super) fn heard(self) -> String {
        let text = self.0.join().unwrap_or_default();
        String::from_utf8_lossy(&text).trim().to_owned()
    }
}

/// Lines of any bytes.
fn lines(from: impl Read, mut line: impl FnMut(&str) -> anyhow::Result<()>) -> anyhow::Result<()> {
    for bytes in BufReader::new(from).split(b'\n') {
        let text = bytes.context("the output of a program ended early")?;
        let text = String::from_utf8_lossy(&text);
        line(&with_colours(text.strip_suffix('\r').unwrap_or(&text)))?;
    }
    Ok(())
}

/// Runs a process over a temporary folder. Ctrl-C reaches that process, too: this one stays until the folder is gone.
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
