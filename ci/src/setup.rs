//! `cargo ci setup`: makes sure that the execution paths the tests require can load.
//!
//! This step looks at files only, so it takes milliseconds and needs nothing from the harness.
//! `karat doctor` opens the paths for real; the commands that build it run it afterwards.

use anyhow::{Result, bail};

use self::host::Host;
use self::install::{Family, Privilege, Wanted};

mod browser;
mod gl;
mod host;
mod install;
mod manifest;
mod npm;

mod validators;
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
    install::run(&Family::of(&host), Privilege::current(), Wanted::Drivers)?;
    if report(&Host::current()) {
        return Ok(());
    }
    bail!(
        "the packages are installed, but a path is missing still: \
         see the lines above for where it was looked for"
    )
}

/// Installs the browser that the tests of the review page drive, if there is none. Not a part of
/// [`install_missing`]: the demo needs no browser, and it is a large package.
pub(crate) fn install_browser() -> Result<()> {
    let host = Host::current();
    if browser::find(&host).is_none() {
        install::run(&Family::of(&host), Privilege::current(), Wanted::Browser)?;
    }
    match browser::find(&Host::current()) {
        Some(program) => eprintln!("browser: found {}", program.display()),
        None => bail!("{}", install::advice(&Family::of(&host), Wanted::Browser)),
    }
    Ok(())
}

/// Installs the validators of naga's translations, if one is missing. The demo needs none.
pub(crate) fn install_validators() -> Result<()> {
    let host = Host::current();
    if !validators::missing(&host).is_empty() {
        install::run(&Family::of(&host), Privilege::current(), Wanted::Validators)?;
    }
    match validators::missing(&Host::current()).as_slice() {
        [] => eprintln!("validators: found {}", validators::NAMES.join(", ")),
        missing => bail!(
            "{} missing; {}",
            missing.join(", "),
            install::advice(&Family::of(&host), Wanted::Validators)
        ),
    }
    Ok(())
}

/// Installs Tint, Chrome's compiler of WGSL, where it isn't. The demo needs none.
pub(crate) fn install_tint() -> Result<()> {
    npm::install_tint()
}

/// The browser that tests drive.
pub(crate) fn browser() -> Option<std::path::PathBuf> {
    browser::find(&Host::current())
}

/// Installs what the tests of Karat's npm packages use, where it isn't.
pub(crate) use npm::{install_web, node_and_modules, version as node_version};

/// Only reports; a missing path is an error that says how to install it.
pub(crate) fn check() -> Result<()> {
    if came_with_the_system() {
        return Ok(());
    }
    let host = Host::current();
    if report(&host) {
        return Ok(());
    }
    bail!("{}", install::advice(&Family::of(&host), Wanted::Drivers))
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
