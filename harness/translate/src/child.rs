//! Programs of others. Each runs as a process of its own, for so long and no longer: whatever it does
//! to itself is a verdict on it.

use std::io::{self, Read, Seek};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// How long a validator or a compiler may take for one shader. They take some 30 ms.
const DEADLINE: Duration = Duration::from_secs(30);

/// What a program may write: far more than any has to say of a shader.
const MOST_WRITTEN: u64 = 16 << 20;

/// What is kept of that.
const MOST_KEPT: u64 = 64 << 10;

/// How often a program is asked whether it has ended, at first; then more and more seldom.
const FIRST_PAUSE: Duration = Duration::from_micros(500);
const LONGEST_PAUSE: Duration = Duration::from_millis(20);

/// How a program ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum End {
    Good,
    /// With an exit code that isn't 0.
    Bad,
    /// By a signal, or as Windows ends what has crashed.
    Crashed,
    /// It was ended: it took too long.
    TimedOut,
    /// It was ended: it wrote too much.
    TooMuch,
}

/// A program that has run.
#[derive(Clone, Debug)]
pub(crate) struct Ran {
    pub(crate) end: End,
    /// What it wrote to both of its outputs, or the beginning of it.
    pub(crate) output: String,
    /// How it ended, in the system's words: `signal: 11 (SIGSEGV)`.
    pub(crate) status: String,
}

impl Ran {
    /// Why there is no verdict of it; `None`: there is one.
    pub(crate) fn broke(&self) -> Option<String> {
        Some(match self.end {
            End::Bad if self.output.is_empty() => {
                format!("says nothing and ends badly ({})", self.status)
            }
            End::Good | End::Bad => return None,
            End::Crashed => format!("crashes ({})", self.status),
            End::TimedOut => format!("doesn't end within {} s", DEADLINE.as_secs()),
            End::TooMuch => format!("writes more than {} MiB", MOST_WRITTEN >> 20),
        })
    }
}

pub(crate) fn run(command: &mut Command) -> io::Result<Ran> {
    run_for(command, DEADLINE)
}

/// Runs a program for at most so long.
fn run_for(command: &mut Command, deadline: Duration) -> io::Result<Ran> {
    // A file takes whatever is written; a pipe would have to be read meanwhile.
    let mut output = tempfile::tempfile()?;
    command.stdin(Stdio::null()).stdout(output.try_clone()?).stderr(output.try_clone()?);
    // A group of its own, so that what it has started ends with it.
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(command, 0);
    let (mut child, start) = (command.spawn()?, Instant::now());
    let mut pause = FIRST_PAUSE;
    let (end, status) = loop {
        if let Some(status) = child.try_wait()? {
            break (ended(status), status.to_string());
        }
        let too_much = output.metadata()?.len() > MOST_WRITTEN;
        if too_much || start.elapsed() > deadline {
            end(&mut child)?;
            let why = if too_much { End::TooMuch } else { End::TimedOut };
            break (why, String::new());
        }
        std::thread::sleep(pause);
        pause = (pause * 2).min(LONGEST_PAUSE);
    };
    let (mut bytes, length) = (Vec::new(), output.metadata()?.len());
    output.rewind()?;
    output.take(MOST_KEPT).read_to_end(&mut bytes)?;
    let mut output = String::from_utf8_lossy(&bytes).trim().to_owned();
    if length > MOST_KEPT {
        output += &format!("\n... and {} bytes more", length - MOST_KEPT);
    }
    Ok(Ran { end, output, status })
}

/// Ends a program, and what it has started.
fn end(child: &mut Child) -> io::Result<()> {
    #[cfg(unix)]
    {
        use rustix::process::{Pid, Signal, kill_process_group};
        // It isn't waited for yet, so its group is there; what may be wrong, `kill` below says again.
        let _ = kill_process_group(Pid::from_child(child), Signal::KILL);
    }
    // It has ended if its group has.
    match child.kill() {
        Err(error) if error.kind() != io::ErrorKind::InvalidInput => return Err(error),
        _ => {}
    }
    child.wait().map(drop)
}

fn ended(status: ExitStatus) -> End {
    /// Windows' codes of errors have their highest bits set: access violations, overflowed stacks.
    const ERRORS: u32 = 0xc000_0000;
    match status.code() {
        Some(0) => End::Good,
        // What a shell says of a program that it can't run, or that a signal ended.
        Some(126..) if cfg!(unix) => End::Crashed,
        Some(code) if cfg!(windows) && code.cast_unsigned() >= ERRORS => End::Crashed,
        Some(_) => End::Bad,
        None => End::Crashed,
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// Longer than a busy machine needs for a script that ends.
    fn shell(script: &str) -> Ran {
        shell_for(script, Duration::from_secs(20))
    }

    fn shell_for(script: &str, deadline: Duration) -> Ran {
        let mut command = Command::new("sh");
        run_for(command.args(["-c", script]), deadline).expect("a shell")
    }

    #[test]
    fn each_end_is_told_apart() {
        let good = shell("echo a; echo b >&2");
        assert_eq!((good.end, good.output.as_str()), (End::Good, "a\nb"));
        let bad = shell("echo no; exit 3");
        assert_eq!((bad.end, bad.output.as_str()), (End::Bad, "no"));
        let crashed = shell("kill -SEGV $$");
        assert_eq!(crashed.end, End::Crashed);
        assert!(crashed.broke().is_some_and(|how| how.contains("signal: 11")), "{crashed:?}");
        let slow = shell_for("exec sleep 60", Duration::from_millis(300));
        assert_eq!((slow.end, slow.broke().is_some()), (End::TimedOut, true));
        assert_eq!((good.broke(), bad.broke()), (None, None));
        assert_eq!(shell("exec cat").end, End::Good, "there is no input to wait for");
    }

    #[test]
    fn what_writes_without_end_is_ended() {
        let ran = shell("exec yes 0123456789");
        assert_eq!(ran.end, End::TooMuch);
        assert!(ran.output.len() < 2 * MOST_KEPT as usize, "{} bytes", ran.output.len());
        assert!(ran.output.ends_with("bytes more"), "nothing is left out in silence");
        let long = shell("yes 0123456789 | head -c 100000");
        assert_eq!(long.end, End::Good);
        assert!(long.output.ends_with("... and 34464 bytes more"), "{}", long.output.len());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn what_a_program_has_started_ends_with_it() {
        // Time enough to tell the process that it starts.
        let ran = shell_for("sleep 600 & echo $!; wait", Duration::from_secs(2));
        assert_eq!(ran.end, End::TimedOut);
        assert!(ran.output.parse::<u32>().is_ok(), "no process in {:?}", ran.output);
        // The signal is sent, but a busy machine may take a while to carry it out.
        let deadline = Instant::now() + Duration::from_secs(10);
        while runs(&ran.output) {
            assert!(Instant::now() < deadline, "process {} is left", ran.output);
            std::thread::sleep(LONGEST_PAUSE);
        }
    }

    /// Returns `true` if a process is more than an entry that nobody has taken notice of yet.
    #[cfg(target_os = "linux")]
    fn runs(id: &str) -> bool {
        let status = std::fs::read_to_string(format!("/proc/{id}/status"));
        status.is_ok_and(|status| !status.contains("State:\tZ"))
    }
}
