//! Programs that run tests in place of Cargo.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// What a program that runs tests itself says of them.
///
/// Cargo's test programs say it by what Cargo tells them. Any other program names each test by the name
/// of the thread that runs it, and calls [`host`] before the first.
#[derive(Clone, Debug)]
pub struct Host {
    /// The words of the command that runs one test: its name follows. `karat test shaders --exact`
    pub command: Vec<String>,
    /// The folder that has `.karat/failures/`, where inputs are kept on which tests have failed.
    pub folder: PathBuf,
    /// The folder in there for these tests.
    pub target: String,
    /// The folder of what tests leave behind: in CI, what waits to be accepted.
    pub output: PathBuf,
}

static HOST: OnceLock<Host> = OnceLock::new();

/// Says who runs the tests of this process. A second call changes nothing.
pub fn host(host: Host) {
    crate::golden::leave_in(host.output.clone());
    drop(HOST.set(host));
}

/// Who runs the tests of this process, if it isn't Cargo.
pub(super) fn current() -> Option<&'static Host> {
    HOST.get()
}

impl Host {
    /// The folder of remembered failures.
    pub(super) fn failures(&self) -> PathBuf {
        failures(&self.folder, &self.target)
    }

    /// The command that runs a test: its program and arguments.
    pub(super) fn command(&self, test: &str) -> (String, Vec<String>) {
        let mut words = self.command.iter().cloned();
        let program = words.next().unwrap_or_default();
        (program, words.chain([test.to_owned()]).collect())
    }
}

/// Where a package of tests keeps what they failed on.
pub(super) fn failures(package: &Path, target: &str) -> PathBuf {
    package.join(".karat").join("failures").join(target)
}
