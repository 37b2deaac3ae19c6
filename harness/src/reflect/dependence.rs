//! Records which programs a test uses, so that commands can run the right tests again after an edit.
//!
//! While Karat records a run, each process writes a line for each program that a test links, into a file beside the
//! process's records. After an edit of a shader, a command reads these files to find the tests that the edit affects.

use std::collections::HashSet;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use serde::{Deserialize, Serialize};

use super::kept::{self, Wanted};
use super::{Program, ReflectError};
use crate::package::{Package, Portable};
use crate::settings;

const ENDING: &str = "programs";

/// A program that a test linked. The test depends on this program.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Dependence {
    /// The name of the thread that linked the program. A test runs in a thread with the test's name, but a thread that
    /// the test starts has another name.
    pub test: String,
    /// The package, in a form with which another process can open it; `None` if only the test's own process can open
    /// the package.
    package: Option<Portable>,
    wanted: Wanted,
    of: Of,
    normalized_text: String,
    /// The program's declarations by their paths in the author's code (`brdf::schlick`); empty for an invalid program.
    #[serde(default)]
    declares: Vec<String>,
}

/// The property of a program on which a test depends: the program's text, or only the fact that the program is valid.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) enum Of {
    Text,
    Validity,
}

/// `true` if this process must not record the programs that it links.
static UNWANTED: AtomicBool = AtomicBool::new(false);

impl Dependence {
    /// Makes this process record no more programs. A watcher calls this function, because it already knows the tests'
    /// programs.
    pub fn unwanted() {
        UNWANTED.store(true, Ordering::Relaxed);
    }

    /// Reads the dependences that the processes of a run wrote into the run's folder of records.
    ///
    /// # Errors
    /// Returns an error if a file can't be read, or a line isn't a dependence.
    pub fn all(folder: &Path) -> std::io::Result<Vec<Self>> {
        let mut all = Vec::new();
        for entry in std::fs::read_dir(folder)? {
            let file = entry?.path();
            if file.extension().is_some_and(|ending| ending == ENDING) {
                for line in std::fs::read_to_string(&file)?.lines() {
                    all.push(serde_json::from_str(line)?);
                }
            }
        }
        Ok(all)
    }

    /// The package with the features and dependencies that the test uses; `None` if only the test's own process
    /// can open the package.
    #[must_use]
    pub fn package(&self) -> Option<Package> {
        self.package.as_ref().map(Portable::package)
    }

    /// The folder or file of the package from which the program was linked; `None` for a crate, and for text in
    /// memory.
    #[must_use]
    pub fn place(&self) -> Option<&Path> {
        self.package.as_ref().and_then(Portable::place)
    }

    /// Checks that the program hasn't changed since the test linked it, except for comments and blanks. If a file has
    /// changed, Karat links the program again.
    #[must_use]
    pub fn is_current(&self) -> bool {
        self.package().is_some_and(|package| self.is_same(&package))
    }

    /// Like [`is_current`](Self::is_current), but with `text` as the contents of `file`. Returns `None` if only the
    /// test's own process can open the package.
    #[must_use]
    pub fn is_current_with(&self, file: &Path, text: &str) -> Option<bool> {
        Some(self.is_same(&self.package()?.unsaved(file, text)))
    }

    /// Checks if an edit of a declaration could change the program. Returns `false` if the program surely lacks the
    /// declaration. `path` is the declaration's path, such as `brdf::schlick`, or the end of the path.
    #[must_use]
    pub fn may_declare(&self, path: &str) -> bool {
        let is_it = |own: &String| format!("::{own}").ends_with(&format!("::{path}"));
        self.declares.is_empty() || self.declares.iter().any(is_it)
    }

    fn is_same(&self, package: &Package) -> bool {
        normalized_text(&kept::again(package, &self.wanted), self.of) == self.normalized_text
    }
}

/// A hash of the program's normalized text, or of its error. For `Of::Validity`, all valid programs have the same hash.
fn normalized_text(program: &Result<Arc<Program>, ReflectError>, of: Of) -> String {
    let text = match (program, of) {
        (Ok(program), Of::Text) => program.normalized_text(),
        (Ok(_), Of::Validity) => String::new(),
        (Err(error), _) => format!("error: {error}"),
    };
    blake3::hash(text.as_bytes()).to_hex().to_string()
}

/// Links the program for the running test. If the run is recorded, Karat also writes a [`Dependence`].
pub(super) fn program(package: &Package, wanted: &Wanted) -> Result<Arc<Program>, ReflectError> {
    let program = kept::again(package, wanted);
    note(package, wanted, &program, Of::Text);
    program
}

/// Returns an error if a module isn't valid. `linked` is a program that Karat linked from the module or from a part of
/// the module.
pub(super) fn validity(
    package: &Package,
    module: &str,
    linked: &Arc<Program>,
) -> Result<(), ReflectError> {
    let wanted = Wanted::Module(module.to_owned());
    let program = match linked.linked.whole {
        true => Ok(Arc::clone(linked)),
        false => kept::again(package, &wanted),
    };
    note(package, &wanted, &program, Of::Validity);
    program.map(drop)
}

/// Writes a [`Dependence`] of the running test, if the run is recorded. If the write fails, Karat ignores the error.
/// Without the dependence, a watcher runs more tests than necessary.
fn note(package: &Package, wanted: &Wanted, program: &Result<Arc<Program>, ReflectError>, of: Of) {
    static SEEN: LazyLock<Mutex<HashSet<(String, String)>>> = LazyLock::new(Mutex::default);
    static FILE: Mutex<Option<File>> = Mutex::new(None);
    let Some(folder) = settings::record().filter(|_| !UNWANTED.load(Ordering::Relaxed)) else {
        return;
    };
    let test = std::thread::current().name().unwrap_or_default().to_owned();
    let portable = package.portable();
    let (wanted, normalized_text) = (wanted.clone(), normalized_text(program, of));
    let names = program.as_ref().ok().map(|program| program.linked.names.values().cloned());
    let declares = names.into_iter().flatten().collect();
    let dependence = Dependence { test, package: portable, wanted, of, normalized_text, declares };
    let Ok(mut line) = serde_json::to_string(&dependence) else { return };
    let mut seen = SEEN.lock().unwrap_or_else(PoisonError::into_inner);
    if !seen.insert((dependence.test, line.clone())) {
        return;
    }
    drop(seen);
    line.push('\n');
    let mut file = FILE.lock().unwrap_or_else(PoisonError::into_inner);
    if file.is_none() {
        let path = folder.join(format!("{}.{ENDING}", std::process::id()));
        let opened = std::fs::create_dir_all(folder)
            .and_then(|()| OpenOptions::new().create(true).append(true).open(path));
        *file = opened.ok();
    }
    if let Some(file) = &mut *file {
        drop(file.write_all(line.as_bytes()));
    }
}
