//! The test programs of a Cargo project.

use std::collections::{BTreeSet, HashSet};
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::SystemTime;

use anyhow::{Context, bail};
use cargo_metadata::{Artifact, Message};
use karat::unstable::process;

/// The extensions of the files that a build by Cargo reads.
const BUILT: [&str; 3] = ["rs", "toml", "lock"];

/// A test program that uses Rust's test runner.
pub(in crate::cli) struct TestProgram {
    pub(super) executable: PathBuf,
    /// The name of the program's target: a file in `tests/`, or a crate.
    target: String,
    /// The folder of the program's package. Cargo runs the program in this folder.
    pub(super) folder: PathBuf,
    pub(super) package: String,
    made: Option<SystemTime>,
    pub(in crate::cli) tests: Vec<String>,
}

impl TestProgram {
    pub(in crate::cli) fn show(&self, test: &str) -> String {
        format!("{}::{test}", self.target)
    }

    pub(super) fn shown(&self) -> impl Iterator<Item = String> {
        self.tests.iter().map(|test| self.show(test))
    }
}

#[derive(Default)]
pub(in crate::cli) struct Programs {
    root: PathBuf,
    /// The Cargo packages of the programs. Empty means all packages.
    packages: Vec<String>,
    programs: Vec<TestProgram>,
    /// The source files, and the files that they include.
    sources: HashSet<PathBuf>,
    built: bool,
    scripts: bool,
}

impl Programs {
    pub(in crate::cli) fn of(root: &Path) -> Self {
        Self { root: root.to_owned(), ..Self::default() }
    }

    pub(in crate::cli) fn only(self, packages: &[String]) -> Self {
        Self { packages: packages.to_vec(), ..self }
    }

    pub(in crate::cli) fn all(&self) -> impl Iterator<Item = &TestProgram> {
        self.programs.iter()
    }

    /// Checks if a build by Cargo reads a file.
    pub(super) fn builds(&self, file: &Path) -> bool {
        let ending = file.extension().unwrap_or_default();
        BUILT.iter().any(|known| ending == *known) || self.sources.contains(file)
    }

    pub(super) fn are_stale(&self, changed: &HashSet<&Path>) -> bool {
        !self.built || changed.iter().any(|file| self.builds(file))
    }

    /// Checks if the project has build scripts. The inputs of build scripts are unknown.
    pub(super) fn have_scripts(&self) -> bool {
        self.scripts
    }

    /// Builds the programs. For each new or rebuilt program, returns the prefix of its tests' displayed names. If the
    /// build fails, returns Cargo's errors.
    pub(in crate::cli) fn build(&mut self) -> anyhow::Result<Result<Vec<String>, String>> {
        self.built = false;
        let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
        let mut command = Command::new(cargo);
        command.current_dir(&self.root).args(["test", "--no-run", "--tests"]);
        command.args(self.packages.is_empty().then_some("--workspace"));
        command.args(self.packages.iter().flat_map(|name| ["-p", name]));
        command.arg("--message-format=json-render-diagnostics");
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().context("can't run `cargo`")?;
        let mut stderr = child.stderr.take().context("it is piped")?;
        let diagnostics = std::thread::spawn(move || {
            let mut text = Vec::new();
            drop(stderr.read_to_end(&mut text));
            String::from_utf8_lossy(&text).into_owned()
        });
        let stdout = child.stdout.take().context("it is piped")?;
        let (mut artifacts, mut scripts) = (Vec::new(), false);
        for message in Message::parse_stream(BufReader::new(stdout)) {
            match message.context("can't read the messages of `cargo`")? {
                Message::CompilerArtifact(artifact) => artifacts.push(artifact),
                Message::BuildScriptExecuted(script) => {
                    scripts |= is_local(&script.package_id.repr);
                }
                _ => {}
            }
        }
        let status = child.wait().context("`cargo` vanished")?;
        let text = diagnostics.join().unwrap_or_default();
        if !status.success() {
            return Ok(Err(errors(&text)));
        }
        (self.built, self.scripts) = (true, scripts);
        let local = || artifacts.iter().filter(|artifact| is_local(&artifact.package_id.repr));
        self.sources = local().flat_map(sources).collect();
        let mut before = std::mem::take(&mut self.programs);
        let mut rebuilt = Vec::new();
        for artifact in local().filter(|artifact| artifact.profile.test) {
            let Some(executable) = artifact.executable.as_ref().map(|path| path.as_std_path())
            else {
                continue;
            };
            let made = std::fs::metadata(executable).and_then(|file| file.modified()).ok();
            let same = |one: &TestProgram| one.executable == executable && one.made == made;
            if let Some(at) = before.iter().position(same) {
                self.programs.push(before.swap_remove(at));
                continue;
            }
            let folder = artifact.manifest_path.as_std_path().parent().unwrap_or(&self.root);
            let program = TestProgram {
                executable: executable.to_owned(),
                target: artifact.target.name.clone(),
                folder: folder.to_owned(),
                package: package(folder).unwrap_or_default(),
                made,
                tests: tests(executable, folder)?,
            };
            rebuilt.push(program.show(""));
            self.programs.push(program);
        }
        Ok(Ok(rebuilt))
    }
}

/// Checks if a package is local, and not from a registry.
fn is_local(id: &str) -> bool {
    id.starts_with("path+") || id.contains("(path+")
}

fn package(folder: &Path) -> Option<String> {
    let text = std::fs::read_to_string(folder.join("Cargo.toml")).ok()?;
    let table: toml::Table = text.parse().ok()?;
    Some(table.get("package")?.get("name")?.as_str()?.to_owned())
}

/// Returns the tests in a program, or an empty list if the program doesn't use Rust's test runner.
fn tests(executable: &Path, folder: &Path) -> anyhow::Result<Vec<String>> {
    let mut command = Command::new(executable);
    command.current_dir(folder).args(["--list", "--format", "terse"]);
    let name = || format!("can't run `{}`", executable.display());
    let listed = process::output(&mut command, process::LOOK_UP, u64::MAX).with_context(name)?;
    // A loader exits with 127 if a library is missing. Other test runners may refuse the arguments.
    if listed.status.code().is_none_or(|code| code == 127) {
        let said = String::from_utf8_lossy(&listed.stderr);
        bail!("`{}` ended ({}): {}", executable.display(), listed.status, said.trim());
    }
    let text = String::from_utf8_lossy(&listed.stdout).into_owned();
    let names = text.lines().filter_map(|line| line.strip_suffix(": test"));
    let names: BTreeSet<String> = names.map(str::to_owned).collect();
    command.arg("--ignored");
    let ignored = process::output(&mut command, process::LOOK_UP, u64::MAX).with_context(name)?;
    let ignored = String::from_utf8_lossy(&ignored.stdout).into_owned();
    let ignored: HashSet<&str> =
        ignored.lines().filter_map(|line| line.strip_suffix(": test")).collect();
    Ok(names.into_iter().filter(|name| !ignored.contains(&**name)).collect())
}

/// Returns the files that rustc read for an artifact. The artifact's `.d` file lists them.
fn sources(artifact: &Artifact) -> Vec<PathBuf> {
    let files = artifact.filenames.iter().chain(&artifact.executable);
    let mut all = Vec::new();
    for file in files.map(|file| file.as_std_path()) {
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        let bare = stem.strip_prefix("lib").unwrap_or(&stem);
        for name in [&*stem, bare] {
            let listed = std::fs::read_to_string(file.with_file_name(format!("{name}.d")));
            all.extend(listed.unwrap_or_default().lines().filter_map(source));
        }
    }
    all
}

/// Returns the path in a line such as `src/lib.rs:` of a `.d` file, or `None` if the line has another form. Spaces in
/// the path are escaped.
fn source(line: &str) -> Option<PathBuf> {
    let file = line.strip_suffix(':').filter(|file| !file.starts_with('#'))?.replace("\\ ", " ");
    std::path::absolute(file).ok()
}

/// Returns the errors in Cargo's output, without the progress lines.
fn errors(text: &str) -> String {
    let start = text.lines().position(|line| line.starts_with("error"));
    let lines: Vec<&str> = text.lines().skip(start.unwrap_or_default()).collect();
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_errors_of_a_build_are_shown() {
        let text = "   Compiling a v0.1.0\nwarning: x\nerror[E0425]: cannot find value `y`\n  --> a.rs:1:1";
        assert!(errors(text).starts_with("error[E0425]") && errors(text).ends_with("a.rs:1:1"));
        assert_eq!(errors("no network"), "no network");
    }

    #[test]
    fn included_files_are_those_that_rustc_names() {
        let listed = "/t/a.d: src/lib.rs /x/my\\ shaders/a.wgsl\n\nsrc/lib.rs:\n/x/my\\ shaders/a.wgsl:\n# env-dep:A=1:\n";
        let files: Vec<PathBuf> = listed.lines().filter_map(source).collect();
        assert_eq!(files.len(), 2, "{files:?}");
        assert_eq!(files[1], Path::new("/x/my shaders/a.wgsl"));
    }
}
