//! Git, asked for a moment.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, bail};
use karat::unstable::output::visible;
use karat::unstable::process;

/// The output of git in a folder. Names are whole and unquoted under any configuration.
pub(super) fn git(folder: &Path, arguments: &[&str]) -> anyhow::Result<Vec<u8>> {
    let mut command = Command::new("git");
    command.current_dir(folder);
    command.args(["-c", "core.quotePath=false", "-c", "diff.relative=false"]).args(arguments);
    let output = process::output(&mut command, process::LOOK_UP, u64::MAX);
    let output = output.context("git gives no answer")?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        match said.trim() {
            "" => bail!("`git {}` fails", arguments[0]),
            said => bail!("{}", visible(said)),
        }
    }
    Ok(output.stdout)
}
