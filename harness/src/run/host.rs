//! Programs that run tests without Cargo.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A description of a program that runs tests without Cargo.
///
/// Cargo gives its test programs these facts in environment variables and paths. Any other program calls
/// [`host`] before the first test, and names the thread of each test after the test.
#[derive(Clone, Debug)]
pub struct Host {
    /// The words of the command that runs one test, without the test's name: `karat test shaders --exact`.
    pub command: Vec<String>,
    /// The folder that has `.karat/failures/`, with the inputs on which tests have failed.
    pub folder: PathBuf,
    /// The folder in `.karat/failures/` for these tests.
    pub target: String,
    /// The output folder of tests. In CI it has the pending frames.
    pub output: PathBuf,
}

static HOST: OnceLock<Host> = OnceLock::new();

/// Sets the program that runs the tests of this process. A second call changes nothing.
pub fn host(host: Host) {
    crate::golden::leave_in(host.output.clone());
    drop(HOST.set(host));
}

/// The program that runs the tests of this process; `None` for Cargo.
pub(super) fn current() -> Option<&'static Host> {
    HOST.get()
}

impl Host {
    /// The folder of inputs on which tests have failed.
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

/// The folder in which a package of tests stores the inputs on which they failed.
pub(super) fn failures(package: &Path, target: &str) -> PathBuf {
    package.join(".karat").join("failures").join(target)
}
