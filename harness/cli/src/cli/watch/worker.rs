//! A process that runs tests on request.

use std::collections::BTreeSet;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::Context;
use karat::unstable::record::Record;
use karat_suite::Wrong;
use serde::{Deserialize, Serialize};

use super::super::child::LastWords;
use super::{DEADLINE, Source};

/// The time that Karat waits for a worker to end after closing the worker's input. Then Karat kills the worker.
const FAREWELL: Duration = Duration::from_millis(300);

/// A request to a worker. Each request is sent as one line of JSON.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(in crate::cli) struct Request {
    /// Runs only tests whose names contain this text.
    pub(in crate::cli) filter: String,
    /// Runs all tests, including those that no edit affects.
    pub(in crate::cli) all: bool,
    /// The tests to run before the others.
    pub(in crate::cli) first: Vec<String>,
    /// The absolute paths of the files that changed since the last request.
    #[serde(default)]
    pub(in crate::cli) changed: Vec<PathBuf>,
    /// Validates all modules, not only those that tests link.
    #[serde(default)]
    pub(in crate::cli) validate: bool,
    /// Runs nothing, and writes the records of each test's last run into this file.
    #[serde(default)]
    pub(in crate::cli) report: Option<PathBuf>,
    /// Runs only the test of this name, and returns its records with the reply. Editors and other test runners use this
    /// field.
    #[serde(default)]
    pub(in crate::cli) only: Option<String>,
}

/// A message from a worker. Each message is sent as one line of JSON.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(in crate::cli) enum Said {
    /// A test ran. `wrong` is the failure, or `None` if the test passed.
    Test { name: String, wrong: Option<Wrong> },
    /// All tests have a verdict. `tests` are all tests, `broken` are unreadable tests, and `idle` is the number of
    /// tests that can't run on this path.
    Done {
        tests: BTreeSet<String>,
        #[serde(default)]
        broken: Vec<Wrong>,
        #[serde(default)]
        idle: usize,
        /// The errors of invalid modules, including modules that no test links.
        #[serde(default)]
        invalid: Option<String>,
        /// The remarks of other compilers on the modules: a summary line, and then each remark.
        #[serde(default)]
        remarks: Option<String>,
        /// The files that tests read, except for modules and for files that declare tests.
        #[serde(default)]
        reads: Reads,
        /// The records of the test that the request named in `only`.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        records: Vec<Record>,
    },
    /// The worker wrote the records that [`Request::report`] asks for. If `error` is `Some`, the worker couldn't write
    /// them.
    Reported { error: Option<String> },
    /// The process ended. `why` describes the reason.
    Ended { why: String },
}

impl Said {
    /// Returns a message without tests, in which `why` is the only error.
    pub(in crate::cli) fn failed(why: String) -> Self {
        let (tests, broken) = (BTreeSet::new(), vec![Wrong::of(why)]);
        let (idle, invalid, remarks, reads) = (0, None, None, Reads::Any);
        let records = Vec::new();
        Self::Done { tests, broken, idle, invalid, remarks, reads, records }
    }
}

/// The files that tests read.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(in crate::cli) enum Reads {
    /// These files, with links resolved.
    These(BTreeSet<PathBuf>),
    /// Any file, because Karat can't know which files a program or a Rust test will read.
    #[default]
    Any,
}

pub(in crate::cli) struct Worker {
    child: Child,
    stdin: Option<ChildStdin>,
}

impl Worker {
    /// Starts a worker that runs tests on one path. Calls `tell` with each of the worker's messages until `tell`
    /// returns `false`.
    pub(in crate::cli) fn start(
        path: &str,
        source: &Source,
        records: &Path,
        tell: impl Fn(Said) -> bool + Send + 'static,
    ) -> anyhow::Result<Self> {
        let program = std::env::current_exe().context("can't find karat's executable file")?;
        let mut command = Command::new(program);
        command.arg("suite").arg(source.folder()).arg("--serve").env("KARAT_PATHS", path);
        // Removes the records of an earlier process.
        drop(std::fs::remove_dir_all(records));
        std::fs::create_dir_all(records)
            .with_context(|| format!("can't write records into `{}`", records.display()))?;
        command.env("KARAT_RECORD", records);
        // Each process has one path. A required path would run in all processes.
        command.env_remove("KARAT_REQUIRE");
        // Frames need a driver.
        command
            .envs((path == "cpu" || path.starts_with("cpu:")).then_some(("KARAT_FRAMES", "off")));
        command.args(matches!(source, Source::Cargo(_)).then_some("--cargo"));
        // After an edit only the usual order runs, because it is fast.
        if std::env::var_os("KARAT_SCHEDULES").is_none() {
            command.env("KARAT_SCHEDULES", "0");
        }
        if std::env::var_os("KARAT_TIMEOUT").is_none() {
            command.env("KARAT_TIMEOUT", DEADLINE);
        }
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().context("can't start the process that runs the tests")?;
        let stdin = child.stdin.take().context("it is piped")?;
        let stdout = child.stdout.take().context("it is piped")?;
        let last_words = LastWords::of(child.stderr.take().context("it is piped")?);
        std::thread::spawn(move || {
            for line in BufReader::new(stdout).lines() {
                let Ok(line) = line else { break };
                // Other lines are messages of drivers.
                if let Ok(said) = serde_json::from_str(&line)
                    && !tell(said)
                {
                    return;
                }
            }
            let why = match last_words.heard() {
                words if words.is_empty() => "the process that runs the tests ended".to_owned(),
                words => words,
            };
            tell(Said::Ended { why });
        });
        Ok(Self { child, stdin: Some(stdin) })
    }

    pub(in crate::cli) fn ask(&mut self, request: &Request) -> std::io::Result<()> {
        let Some(stdin) = &mut self.stdin else { return Ok(()) };
        let request = serde_json::to_string(request).expect("a request is plain data");
        writeln!(stdin, "{request}")?;
        stdin.flush()
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // When its standard input ends, a worker ends the programs that it runs.
        self.stdin = None;
        let began = Instant::now();
        while began.elapsed() < FAREWELL && matches!(self.child.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(5));
        }
        drop(self.child.kill());
        drop(self.child.wait());
    }
}
