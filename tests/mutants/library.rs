//! Runs the shader library's own tests as processes, with a fault in one module.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path as FilePath, PathBuf};
use std::process::{Command, Output};

use karat::unstable::record::{self, Record, Subject, Verdict};
use shaders::PBR;
use tempfile::TempDir;

use crate::faults::{FAULTS, Fault, SURVIVORS};

/// The compiled test programs of the shader library, by the program's name.
pub(crate) struct Library {
    binaries: BTreeMap<String, PathBuf>,
}

/// The outcome of running tests with a fault.
pub(crate) enum Outcome {
    /// At least one check failed.
    Caught(Vec<Caught>),
    /// All tests passed.
    Survived,
    /// The run doesn't prove that the tests used the faulty module. The text has the reason.
    Broken(String),
}

/// A check that failed.
pub(crate) struct Caught {
    /// The name of the test with the failing check.
    pub(crate) test: String,
    /// The checked function and the verb, such as `fresnel::schlick agrees_with`.
    pub(crate) check: String,
    /// The number of failing cases, such as `12 of 65536`.
    pub(crate) failing: String,
    /// The largest error of the check.
    pub(crate) worst: String,
    /// The tolerance or the statement that the check asserts.
    pub(crate) asserted: String,
}

pub(crate) fn text(module: &str) -> String {
    let path = PBR.root().join(format!("{module}.wgsl"));
    std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

impl Library {
    /// Compiles the test programs with the tests that `FAULTS` and `SURVIVORS` name.
    pub(crate) fn built() -> Self {
        Self::of(&targets())
    }

    /// Compiles the test programs that contain the files `targets`, with the same profile as this program.
    pub(crate) fn of(targets: &BTreeSet<&str>) -> Self {
        let folder = FilePath::new(env!("CARGO_BIN_EXE_planted")).parent().expect("in a folder");
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let mut command = Command::new(cargo);
        // Builds the whole workspace, as for this program. For only one package, Cargo would choose other features of
        // shared dependencies, and compile most of them again.
        command.args(["test", "--no-run", "--offline", "--workspace"]);
        command.args(["--message-format", "json-render-diagnostics"]);
        match folder.file_name().and_then(|name| name.to_str()) {
            Some("debug") | None => {}
            Some(profile) => drop(command.args(["--profile", profile])),
        }
        command.arg("--target-dir").arg(folder.parent().expect("in the folder of output"));
        for program in targets.iter().map(|target| program(target)).collect::<BTreeSet<_>>() {
            command.args(["--test", program]);
        }
        let output = command.current_dir(env!("CARGO_MANIFEST_DIR")).output().expect("cargo runs");
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "the library's tests don't compile:\n{errors}");
        let messages = String::from_utf8_lossy(&output.stdout);
        let binary = |line: &str| {
            let message: serde_json::Value = serde_json::from_str(line).ok()?;
            let name = message["target"]["name"].as_str()?.to_owned();
            Some((name, PathBuf::from(message["executable"].as_str()?)))
        };
        let binaries = messages.lines().filter_map(binary).collect();
        Self { binaries }
    }

    /// Runs all tests that should detect one of `faults`, but with unchanged modules as the overlay. Returns an error
    /// if a test fails.
    pub(crate) fn control(&self, faults: &[&Fault]) -> Result<(), String> {
        let modules: BTreeSet<&str> = faults.iter().map(|fault| fault.module).collect();
        let texts: Vec<_> = modules.into_iter().map(|module| (module, text(module))).collect();
        for target in targets() {
            let names: BTreeSet<&str> = faults
                .iter()
                .filter_map(|fault| fault.test.split_once("::"))
                .filter_map(|(of, name)| (of == target).then_some(name))
                .collect();
            if names.is_empty() {
                continue;
            }
            let names: Vec<&str> = names.into_iter().collect();
            match self.outcome(target, &names, &texts) {
                Outcome::Survived => {}
                Outcome::Caught(checks) => {
                    let Caught { test, check, .. } = &checks[0];
                    return Err(format!("without a fault: {target}::{test}: {check} fails"));
                }
                Outcome::Broken(why) => return Err(format!("without a fault: {target}: {why}")),
            }
        }
        Ok(())
    }

    /// Runs the test that should detect the fault.
    pub(crate) fn run(&self, fault: &Fault) -> Outcome {
        let (target, name) = fault.test.split_once("::").expect("file::test");
        self.outcome(target, &[name], &[(fault.module, mutated(fault))])
    }

    /// Runs, with the fault, all tests of the file in which `fault.test` is.
    pub(crate) fn run_module(&self, fault: &Fault) -> Outcome {
        let target = fault.test.split("::").next().expect("a file");
        self.outcome(target, &[], &[(fault.module, mutated(fault))])
    }

    /// Runs the tests `names` of the file `target`, or all its tests if `names` is empty. The texts in `modules`
    /// replace modules of the library.
    fn outcome(&self, target: &str, names: &[&str], modules: &[(&str, String)]) -> Outcome {
        let folder = overlaid(modules);
        let overlay = folder.path().join("overlay");
        let output = self.process(target, names, &folder);
        let records = record::read(&folder.path().join("record")).unwrap_or_default();
        let names: Vec<String> = names.iter().map(|name| full(target, name)).collect();
        let verdict = judge(&output, &records, &names, &overlay);
        verdict.unwrap_or_else(Outcome::Broken)
    }

    fn process(&self, target: &str, names: &[&str], folder: &TempDir) -> Output {
        let mut command = self.command(target, names, folder);
        let output = command.output();
        output.unwrap_or_else(|error| panic!("{:?}: {error}", command.get_program()))
    }

    /// The command that runs tests of the file `target`, with the overlay and the records in `folder`.
    fn command(&self, target: &str, names: &[&str], folder: &TempDir) -> Command {
        let program = program(target);
        let binary = self.binaries.get(program).unwrap_or_else(|| panic!("no tests `{program}`"));
        let mut command = Command::new(binary);
        for (name, _) in std::env::vars_os() {
            let keep = ["KARAT_ADAPTER", "KARAT_TIMEOUT"].iter().any(|keep| name == *keep);
            if name.to_string_lossy().starts_with("KARAT_") && !keep {
                command.env_remove(name); // settings of the surrounding run
            }
        }
        // Runs as many processes as there are cores, with one thread each.
        command.env("RAYON_NUM_THREADS", "1").arg("--test-threads=1");
        command.env("KARAT_OVERLAY", folder.path().join("overlay"));
        command.env("KARAT_RECORD", folder.path().join("record"));
        command.env("NODEVICE_SELECT", "1").env("RUST_BACKTRACE", "0");
        if !names.is_empty() {
            command.arg("--exact").args(names.iter().map(|name| full(target, name)));
        } else if program != target {
            // Tests of the source documents' formulas have the same names, so they are skipped.
            command.arg(full(target, "")).args(["--skip", "as_written::"]);
        }
        command.current_dir(env!("CARGO_MANIFEST_DIR"));
        command
    }
}

fn overlaid(modules: &[(&str, String)]) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let files = folder.path().join("overlay").join(PBR.name());
    std::fs::create_dir_all(&files).expect("a folder");
    for (module, text) in modules {
        std::fs::write(files.join(format!("{module}.wgsl")), text).expect("written");
    }
    folder
}

/// The name of the test program that contains the file `target`.
fn program(target: &str) -> &str {
    if target == "golden" { target } else { "library" }
}

/// The full name of a test in its program, such as `fresnel::schlick`.
fn full(target: &str, name: &str) -> String {
    if program(target) == target { name.to_owned() } else { format!("{target}::{name}") }
}

/// Returns the outcome of a run. If the run doesn't prove that the tests used the overlay, returns an error with the
/// reason.
fn judge(
    output: &Output,
    records: &[Record],
    names: &[String],
    overlay: &FilePath,
) -> Result<Outcome, String> {
    let said = || {
        let (out, err) = (&output.stdout, &output.stderr);
        format!("{}\n{}", String::from_utf8_lossy(out), String::from_utf8_lossy(err))
    };
    if records.is_empty() {
        return Err(format!("no check was recorded:\n{}", said()));
    }
    let overlay = overlay.to_string_lossy();
    if records.iter().any(|record| record.overlay.as_deref() != Some(&*overlay)) {
        return Err("a record doesn't name the overlay".to_owned());
    }
    let ran: BTreeSet<&str> = records.iter().map(|record| &*record.test).collect();
    if let Some(missing) = names.iter().find(|name| !ran.contains(&***name)) {
        return Err(format!("test `{missing}` isn't there, or records no check"));
    }
    // A check without a verdict proves nothing: the fault may not compile.
    if let Some(record) = records.iter().find(|record| record.verdict == Verdict::Error) {
        let message = record.message.as_deref().unwrap_or_default();
        return Err(format!("`{}` can't be checked: {message}", record.test));
    }
    let failed: Vec<&Record> = records.iter().filter(|r| r.verdict == Verdict::Fail).collect();
    match (output.status.code(), failed.as_slice()) {
        (Some(0), []) => Ok(Outcome::Survived),
        (Some(0), _) => Err("a check failed, but the process says that all is well".to_owned()),
        (Some(101), [_, ..]) => Ok(Outcome::Caught(failed.into_iter().map(caught).collect())),
        (code, _) => Err(format!("ended with {code:?} without a failing check:\n{}", said())),
    }
}

fn caught(record: &Record) -> Caught {
    let (check, asserted) = match &record.subject {
        Subject::Function { function, check, assertion, .. } => {
            (format!("{function} {check}"), assertion.clone())
        }
        Subject::Frame { golden, .. } => (format!("frame {golden}"), "its golden".to_owned()),
    };
    let path = record.paths.iter().find(|path| path.failures > 0);
    let (failing, worst) = path.map_or_else(Default::default, |path| {
        (format!("{} of {}", path.failures, path.cases), path.worst.clone())
    });
    // Removes the name of the file, because the table has its own column for it.
    let test = record.test.rsplit("::").next().unwrap_or_default().to_owned();
    Caught { test, check, failing, worst, asserted }
}

fn mutated(fault: &Fault) -> String {
    text(fault.module).replacen(fault.original, fault.replacement, 1)
}

fn targets() -> BTreeSet<&'static str> {
    let faults = FAULTS.iter().chain(SURVIVORS.iter().map(|(fault, _)| fault));
    faults.filter_map(|fault| fault.test.split("::").next()).collect()
}
