//! `cargo ci setup`: installs what the tests need, and checks that the required execution paths can load.
//!
//! The check of the paths only looks at files, so it takes milliseconds and doesn't need the harness. The commands of
//! `cargo ci` that build `karat` also run `karat doctor`, which opens the paths.

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

/// The paths on which every test must run: on Linux Mesa's two software paths, elsewhere the system's own path.
pub(crate) const PATHS: &str = if cfg!(target_os = "macos") {
    "metal"
} else if cfg!(windows) {
    "dx12"
} else {
    "vulkan,gl"
};

/// Installs missing drivers, and fails if some are still missing.
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

/// Installs a browser for the tests of the review page, if there is none. [`install_missing`] doesn't install a
/// browser, because a browser is a large package, and the demo doesn't need one.
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

/// Installs the validators of naga's translations, if one is missing. The demo doesn't need these validators.
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

/// Installs Tint, Chrome's WGSL compiler, if it is missing. The demo doesn't need Tint.
pub(crate) fn install_tint() -> Result<()> {
    npm::install_tint()
}

/// Returns the path of the browser that tests control.
pub(crate) fn browser() -> Option<std::path::PathBuf> {
    browser::find(&Host::current())
}

/// Functions that install and find Node and the npm packages for the tests of Karat's own npm packages.
pub(crate) use npm::{install_web, node_and_modules, version as node_version};

/// Checks if all drivers that the tests need are installed, and installs nothing. If a driver is missing, the error
/// says how to install it.
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

/// Prints one line for each path. Returns `true` if all paths can load.
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
