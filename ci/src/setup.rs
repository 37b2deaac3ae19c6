//! `cargo ci setup`: makes sure that the execution paths the tests require can load.
//!
//! This step looks at files only, so it takes milliseconds and needs nothing from the harness.
//! `karat doctor` opens the paths for real; the commands that build it run it afterwards.

use anyhow::{Result, bail};

use self::host::Host;
use self::install::{Family, Privilege};

mod gl;
mod host;
mod install;
mod manifest;
mod vulkan;

/// The paths that every test must have run on: on Linux both that Mesa offers in software,
/// elsewhere the one that comes with the system.
pub(crate) const PATHS: &str = if cfg!(target_os = "macos") {
    "metal"
} else if cfg!(windows) {
    "dx12"
} else {
    "vulkan,gl"
};

/// Installs what is missing, and fails if it is missing still.
pub(crate) fn install_missing() -> Result<()> {
    if came_with_the_system() {
        return Ok(());
    }
    let host = Host::current();
    if report(&host) {
        return Ok(());
    }
    install::run(&Family::of(&host), Privilege::current())?;
    if report(&Host::current()) {
        return Ok(());
    }
    bail!(
        "the packages are installed, but a path is missing still: \
         see the lines above for where it was looked for"
    )
}

/// Only reports; a missing path is an error that says how to install it.
pub(crate) fn check() -> Result<()> {
    if came_with_the_system() {
        return Ok(());
    }
    let host = Host::current();
    if report(&host) {
        return Ok(());
    }
    bail!("{}", install::advice(&Family::of(&host)))
}

fn came_with_the_system() -> bool {
    let system = match std::env::consts::OS {
        "macos" => "metal: comes with macOS",
        "windows" => "dx12: comes with Windows (WARP where there is no GPU)",
        _ => return false,
    };
    eprintln!("{system}");
    true
}

/// Prints one line a path. True if both are there.
fn report(host: &Host) -> bool {
    let mut complete = true;
    for (path, finding) in [("vulkan", vulkan::find(host)), ("gl", gl::find(host))] {
        match finding {
            Ok(drivers) => eprintln!("{path}: found {drivers}"),
            Err(missing) => {
                eprintln!("{path}: missing: {missing}");
                complete = false;
            }
        }
    }
    complete
}
