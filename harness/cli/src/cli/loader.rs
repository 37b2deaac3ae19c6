//!
//! SwiftShader, the Vulkan driver of Chromium, as a second driver beside the system's drivers.
//!
//! Vulkan's loader reads its list of drivers from an environment variable when it loads the first driver. So if a path
//! names SwiftShader, this program restarts with the variable set, and the test programs inherit the variable.

use std::ffi::{OsStr, OsString};
use std::path::Path;
use std::process::{Command, ExitCode};

use anyhow::Context;
use karat::unstable::path::{has_chosen_drivers, swiftshader};

/// The part of a path that names SwiftShader.
const NAMED: &str = "@swiftshader";

/// Restarts the program with SwiftShader if a path names SwiftShader and the environment variable isn't set yet.
/// Otherwise returns `None`.
pub(super) fn with_second_driver() -> Option<anyhow::Result<ExitCode>> {
    let arguments: Vec<OsString> = std::env::args_os().skip(1).collect();
    let asked = ["KARAT_PATHS", "KARAT_REQUIRE"].map(std::env::var_os).into_iter().flatten();
    if has_chosen_drivers() || !is_named(arguments.iter().cloned().chain(asked)) {
        return None;
    }
    Some(again(&arguments, &swiftshader::manifest()?))
}

fn is_named(words: impl Iterator<Item = OsString>) -> bool {
    words.into_iter().any(|word| word.to_string_lossy().contains(NAMED))
}

fn again(arguments: &[OsString], manifest: &Path) -> anyhow::Result<ExitCode> {
    let program = std::env::current_exe().context("can't find karat's executable file")?;
    let mut command = Command::new(program);
    command.args(arguments).env(swiftshader::ADD, OsStr::new(manifest));
    // Replaces this process if the system can, so that signals reach the new program.
    #[cfg(unix)]
    return Err(std::os::unix::process::CommandExt::exec(&mut command).into());
    #[cfg(not(unix))]
    {
        let status = command.status().context("can't restart this program")?;
        let code = status.code().and_then(|code| u8::try_from(code).ok()).unwrap_or(2);
        Ok(ExitCode::from(code))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_driver_is_loaded_only_for_its_paths() {
        let named = |words: &[&str]| is_named(words.iter().map(|word| OsString::from(*word)));
        assert!(named(&["test", "--paths", "vulkan,vulkan@swiftshader"]));
        assert!(named(&["matrix", "--columns=vulkan:spirv@swiftshader"]));
        assert!(!named(&["test", "--paths", "vulkan@llvmpipe", "swiftshader"]));
    }
}
