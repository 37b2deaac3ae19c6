//! Runs other programs, each in its own process and with a time limit. If a program crashes or takes too long, [`Ran`]
//! says so, and [`run`] returns no error.

use std::io::{self, Read, Seek};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// The time limit of a validator or a compiler for one shader. A validator or a compiler usually needs about 30 ms.
const DEADLINE: Duration = Duration::from_secs(30);

/// The maximum number of bytes that a program may write. Validators and compilers write far less about one shader.
const MOST_WRITTEN: u64 = 16 << 20;

/// The maximum number of bytes of a program's output that Karat keeps.
const MOST_KEPT: u64 = 64 << 10;

/// The time that Karat waits before it first checks if a program has ended. Later pauses are longer.
const FIRST_PAUSE: Duration = Duration::from_micros(500);
const LONGEST_PAUSE: Duration = Duration::from_millis(20);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum End {
    Good,
    /// The program ended with an exit code other than 0.
    Bad,
    /// A signal ended the program, or the program ended with a Windows crash code.
    Crashed,
    /// The program took too long, and Karat killed it.
    TimedOut,
    /// The program wrote too much, and Karat killed it.
    TooMuch,
}

#[derive(Clone, Debug)]
pub(crate) struct Ran {
    pub(crate) end: End,
    /// The first bytes that the program wrote to its standard output and standard error.
    pub(crate) output: String,
    /// The exit status in the system's words: `signal: 11 (SIGSEGV)`.
    pub(crate) status: String,
}

impl Ran {
    /// The reason why the program gave no verdict; `None` if it gave a verdict.
    pub(crate) fn broke(&self) -> Option<String> {
        Some(match self.end {
            End::Bad if self.output.is_empty() => {
                format!("fails without any output ({})", self.status)
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

fn run_for(command: &mut Command, deadline: Duration) -> io::Result<Ran> {
    // The output goes into a file, because a pipe needs a reader while the program runs.
    let mut output = tempfile::tempfile()?;
    command.stdin(Stdio::null()).stdout(output.try_clone()?).stderr(output.try_clone()?);
    // The program runs in its own process group, so that Karat can kill its children, too.
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

fn end(child: &mut Child) -> io::Result<()> {
    #[cfg(unix)]
    {
        use rustix::process::{Pid, Signal, kill_process_group};
        // The program hasn't been waited for, so its process group still exists. If this call fails, `kill` below
        // reports the error.
        let _ = kill_process_group(Pid::from_child(child), Signal::KILL);
    }
    // If the process group has ended, the program has ended, too.
    match child.kill() {
        Err(error) if error.kind() != io::ErrorKind::InvalidInput => return Err(error),
        _ => {}
    }
    child.wait().map(drop)
}

fn ended(status: ExitStatus) -> End {
    /// The smallest exit code of a crash on Windows, such as an access violation or a stack overflow.
    const ERRORS: u32 = 0xc000_0000;
    match status.code() {
        Some(0) => End::Good,
        // A shell returns these codes if it can't run a program, or if a signal ended the program.
        Some(126..) if cfg!(unix) => End::Crashed,
        Some(code) if cfg!(windows) && code.cast_unsigned() >= ERRORS => End::Crashed,
        Some(_) => End::Bad,
        None => End::Crashed,
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    /// Runs a script with a time limit that is long enough on a busy machine.
    fn shell(script: &str) -> Ran {
        shell_for(script, Duration::from_secs(20))
    }

    fn shell_for(script: &str, deadline: Duration) -> Ran {
        let mut command = Command::new("sh");
        run_for(command.args(["-c", script]), deadline).expect("a shell")
    }

    // Lesson 117
    #[test]
    fn each_end_of_a_process_is_recognised() {
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
        assert_eq!(shell("exec cat").end, End::Good, "the standard input is empty");
    }

    // Lesson 117
    #[test]
    fn a_program_with_endless_output_is_killed() {
        let ran = shell("exec yes 0123456789");
        assert_eq!(ran.end, End::TooMuch);
        assert!(ran.output.len() < 2 * MOST_KEPT as usize, "{} bytes", ran.output.len());
        assert!(ran.output.ends_with("bytes more"), "the output counts the missing bytes");
        let long = shell("yes 0123456789 | head -c 100000");
        assert_eq!(long.end, End::Good);
        assert!(long.output.ends_with("... and 34464 bytes more"), "{}", long.output.len());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn child_processes_end_with_their_parent() {
        // The time limit leaves the shell enough time to print the process id.
        let ran = shell_for("sleep 600 & echo $!; wait", Duration::from_secs(2));
        assert_eq!(ran.end, End::TimedOut);
        assert!(ran.output.parse::<u32>().is_ok(), "no process in {:?}", ran.output);
        // The system has received the signal, but a busy machine may need time to end the process.
        let deadline = Instant::now() + Duration::from_secs(10);
        while runs(&ran.output) {
            assert!(Instant::now() < deadline, "process {} is left", ran.output);
            std::thread::sleep(LONGEST_PAUSE);
        }
    }

    /// Checks if a process still runs. A zombie process counts as ended.
    #[cfg(target_os = "linux")]
    fn runs(id: &str) -> bool {
        let status = std::fs::read_to_string(format!("/proc/{id}/status"));
        status.is_ok_and(|status| !status.contains("State:\tZ"))
    }
}
