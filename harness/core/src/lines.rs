//! Runs other programs: programs that answer messages until Karat closes their input, and programs that run once.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, ChildStdin, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The number of bytes that Karat keeps from the end of a process's log, for error messages.
const LAST_WORDS: usize = 2 << 10;
/// The largest number of unread messages that Karat keeps in memory for a process. If there are more, the process
/// waits.
const MOST_UNREAD: usize = 256;
/// The interval at which Karat checks if a process has ended.
const POLL: Duration = Duration::from_millis(5);
/// The time limit for a program that looks something up, such as git, or a compiler that prints its name. Such programs
/// take about 30 ms.
pub const LOOK_UP: Duration = Duration::from_secs(60);
/// The longest time that Karat waits for a process to end after the process's output or input was closed.
const LINGER: Duration = Duration::from_secs(1);

/// The reason why a program can't be run, or a process doesn't answer.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[doc(hidden)]
pub enum Broken {
    #[error("the program can't be run: {0}")]
    Start(String),
    #[error("the program ended ({status}){said}")]
    Ended { status: String, said: String },
    #[error("the program didn't answer within {0} s")]
    Hung(u64),
}

/// The stream on which the process answers. Karat keeps the end of the other stream for error messages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[doc(hidden)]
pub enum Answers {
    Stdout,
    /// Dawn logs on stdout, so its answers are on stderr.
    Stderr,
}

/// Runs a program without input, and returns its output and exit status. `patience` is the time limit. The function
/// reads at most `most + 1` bytes from stdout, and as many from stderr.
///
/// # Errors
/// Returns an error if the program doesn't start, or doesn't end within `patience`.
pub fn output(command: &mut Command, patience: Duration, most: u64) -> Result<Output, Broken> {
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().map_err(|error| Broken::Start(error.to_string()))?;
    let out = all_of(child.stdout.take().expect("it is piped"), most);
    let err = all_of(child.stderr.take().expect("it is piped"), most);
    let began = Instant::now();
    // After the program ends, programs that it started may still write. The time limit also applies to them.
    let left = || patience.saturating_sub(began.elapsed());
    let said = (|| {
        let (stdout, stderr) = (out.recv_timeout(left()).ok()?, err.recv_timeout(left()).ok()?);
        loop {
            match child.try_wait() {
                Ok(Some(status)) => return Some(Output { status, stdout, stderr }),
                Ok(None) if !left().is_zero() => std::thread::sleep(POLL),
                _ => return None,
            }
        }
    })();
    said.ok_or_else(|| {
        drop(child.kill());
        drop(child.wait());
        Broken::Hung(patience.as_secs())
    })
}

/// Reads a stream on another thread. The thread reads at most `most + 1` bytes, then closes the stream.
fn all_of(stream: impl Read + Send + 'static, most: u64) -> Receiver<Vec<u8>> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        // If reading fails, the data before the error still count.
        drop(stream.take(most.saturating_add(1)).read_to_end(&mut bytes));
        drop(sender.send(bytes));
    });
    receiver
}

/// A process that receives messages on stdin and answers them.
#[doc(hidden)]
pub struct Lines {
    child: Child,
    /// The channel to the thread that writes to the process. If the process doesn't read its input, only this thread
    /// blocks. `None` after Karat closed the process's input to end the process.
    to: Option<Sender<Vec<u8>>>,
    from: Receiver<String>,
    end: u8,
    said: Arc<Mutex<Vec<u8>>>,
    /// A channel that disconnects when the process's log has been read to its end.
    silent: Receiver<()>,
}

impl Lines {
    /// Starts a program that ends each of its messages with the byte `end`. Karat reads at most `longest` bytes as one
    /// message, because the message of a faulty process could be endless.
    #[doc(hidden)]
    pub fn start(
        command: &mut Command,
        answers: Answers,
        end: u8,
        longest: u64,
    ) -> Result<Self, Broken> {
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // Ctrl-C in the terminal must not reach the process: the process ends when its input closes, and cleans up.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(command, 0);
        let mut child = command.spawn().map_err(|error| Broken::Start(error.to_string()))?;
        let stdout: Box<dyn Read + Send> = Box::new(child.stdout.take().expect("it is piped"));
        let stderr: Box<dyn Read + Send> = Box::new(child.stderr.take().expect("it is piped"));
        let (answering, logging) = match answers {
            Answers::Stdout => (stdout, stderr),
            Answers::Stderr => (stderr, stdout),
        };
        let said = Arc::new(Mutex::new(Vec::new()));
        let kept = Arc::clone(&said);
        let (told, silent) = channel();
        std::thread::spawn(move || {
            keep(logging, &kept);
            drop::<Sender<()>>(told);
        });
        let (sender, from) = sync_channel(MOST_UNREAD);
        std::thread::spawn(move || {
            let mut reader = BufReader::new(answering);
            loop {
                let mut bytes = Vec::new();
                let read = (&mut reader).take(longest).read_until(end, &mut bytes);
                let text = String::from_utf8_lossy(&bytes);
                let text = text.trim_end_matches([char::from(end), '\r']).to_owned();
                if !matches!(read, Ok(1..)) || sender.send(text).is_err() {
                    break;
                }
            }
        });
        let stdin = child.stdin.take().expect("it is piped");
        let (to, written) = channel();
        std::thread::spawn(move || write(stdin, &written));
        Ok(Self { child, to: Some(to), from, end, said, silent })
    }

    /// Queues a message for the process. If the process can't receive the message, the next [`send`](Self::send) or
    /// [`receive`](Self::receive) returns the error.
    #[doc(hidden)]
    pub fn send(&mut self, message: &str) -> Result<(), Broken> {
        let bytes = [message.as_bytes(), &[self.end]].concat();
        let sent = self.to.as_ref().is_some_and(|to| to.send(bytes).is_ok());
        if sent { Ok(()) } else { Err(self.ended()) }
    }

    #[doc(hidden)]
    pub fn receive(&mut self, patience: Duration) -> Result<String, Broken> {
        match self.from.recv_timeout(patience) {
            Ok(message) => Ok(message),
            Err(RecvTimeoutError::Disconnected) => Err(self.ended()),
            Err(RecvTimeoutError::Timeout) => Err(Broken::Hung(patience.as_secs())),
        }
    }

    /// Closes the process's input, and returns the error for a process that has ended, with the end of its log.
    fn ended(&mut self) -> Broken {
        self.to = None;
        let status = self.wait().unwrap_or_else(|| "the program closed its output".to_owned());
        // Programs that the process started may still write.
        let _ = self.silent.recv_timeout(LINGER);
        let said = self.said.lock().unwrap_or_else(PoisonError::into_inner);
        let said = String::from_utf8_lossy(&said);
        let said = match said.trim() {
            "" => String::new(),
            said => format!(": {said}"),
        };
        Broken::Ended { status, said }
    }

    /// Waits up to [`LINGER`] for the end of the process, and returns the process's status.
    fn wait(&mut self) -> Option<String> {
        let until = Instant::now() + LINGER;
        loop {
            match self.child.try_wait() {
                Ok(Some(status)) => return Some(status.to_string()),
                Ok(None) if Instant::now() < until => std::thread::sleep(POLL),
                _ => return None,
            }
        }
    }
}

impl std::fmt::Debug for Lines {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "process {}", self.child.id())
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        // The process ends when its input is closed, so the process can clean up.
        self.to = None;
        if self.wait().is_none() {
            // Also ends the programs that the process started, such as a browser behind a shell.
            #[cfg(unix)]
            {
                let group = format!("-{}", self.child.id());
                let mut kill = Command::new("kill");
                drop(kill.args(["-KILL", "--", &group]).stderr(Stdio::null()).status());
            }
            drop(self.child.kill());
            drop(self.child.wait());
        }
    }
}

/// Writes messages until the sender is dropped, or the process closes its input.
fn write(mut stdin: ChildStdin, messages: &Receiver<Vec<u8>>) {
    for message in messages {
        if stdin.write_all(&message).and_then(|()| stdin.flush()).is_err() {
            break;
        }
    }
}

/// Reads a stream to its end, and keeps only the last bytes. An unread stream would fill its pipe and block the
/// process.
fn keep(mut stream: impl Read, kept: &Mutex<Vec<u8>>) {
    let mut part = [0; 1024];
    while let Ok(count @ 1..) = stream.read(&mut part) {
        let mut kept = kept.lock().unwrap_or_else(PoisonError::into_inner);
        kept.extend_from_slice(&part[..count]);
        let excess = kept.len().saturating_sub(LAST_WORDS);
        kept.drain(..excess);
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    fn said(script: &str, patience: Duration, most: u64) -> Result<Output, Broken> {
        output(Command::new("sh").args(["-c", script]), patience, most)
    }

    #[test]
    fn a_single_request_has_a_deadline() {
        let (short, long) = (Duration::from_millis(300), Duration::from_secs(20));
        let good = said("echo a; echo b >&2; exit 3", long, 100).expect("it ends");
        assert_eq!((good.stdout, good.stderr), (b"a\n".to_vec(), b"b\n".to_vec()));
        assert_eq!(good.status.code(), Some(3));
        assert_eq!(said("exec sleep 600", short, 100).expect_err("it hangs"), Broken::Hung(0));
        // The program started another program, which keeps the output open.
        assert_eq!(said("sleep 5 & echo a", short, 100).expect_err("one hangs"), Broken::Hung(0));
        assert!(said("exec cat", long, 100).expect("it has no input").stdout.is_empty());
        let much = said("echo 0123456789", long, 4).expect("it ends");
        assert_eq!(much.stdout.len(), 5, "one byte more than is allowed");
        let none = output(&mut Command::new("/no/such/program"), long, 100);
        assert!(matches!(none, Err(Broken::Start(_))));
    }
}
