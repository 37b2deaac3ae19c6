//! Programs that run tests without Cargo.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// The description of a program that runs tests without Cargo.
///
/// For a test program that Cargo runs, Karat derives the command and the folders from environment variables and from
/// the program's path. Any other program must call [`host`] before the first test, and must name each test's thread
/// after the test.
#[derive(Clone, Debug)]
pub struct Host {
    /// The words of the command that runs one test, such as `karat test shaders --exact`. Karat appends the test's
    /// name.
    pub command: Vec<String>,
    /// The folder that contains `.karat/failures/`, where Karat stores the inputs on which tests have failed.
    pub folder: PathBuf,
    /// The name of the folder in `.karat/failures/` for these tests.
    pub target: String,
    /// The output folder of tests. In CI, Karat writes pending frames into this folder.
    pub output: PathBuf,
}

static HOST: OnceLock<Host> = OnceLock::new();

/// Tells Karat which program runs the tests of this process. A second call has no effect.
pub fn host(host: Host) {
    crate::golden::leave_in(host.output.clone());
    drop(HOST.set(host));
}

/// The program that runs the tests of this process; `None` if Cargo runs the tests.
pub(super) fn current() -> Option<&'static Host> {
    HOST.get()
}

impl Host {
    pub(super) fn failures(&self) -> PathBuf {
        failures(&self.folder, &self.target)
    }

    pub(super) fn command(&self, test: &str) -> (String, Vec<String>) {
        let mut words = self.command.iter().cloned();
        let program = words.next().unwrap_or_default();
        (program, words.chain([test.to_owned()]).collect())
    }
}

/// The folder for the inputs on which a package's tests have failed.
pub(super) fn failures(package: &Path, target: &str) -> PathBuf {
    package.join(".karat").join("failures").join(target)
}
