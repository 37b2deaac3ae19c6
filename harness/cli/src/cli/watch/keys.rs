//! What keys do besides running tests: accepting frames, and opening the report.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::Context;
use karat::golden::Goldens;
use karat::record::Record;

use super::super::project::Project;
use super::super::report;

/// Names of frames that wait to be accepted.
pub(super) fn pending(project: &Project) -> Vec<String> {
    let found = Goldens::open(&project.golden()).pending();
    found.frames.iter().map(|frame| frame.case.clone()).collect()
}

/// Accepts frames as `karat accept` does; what it says.
pub(super) fn accept(project: &Project, frames: &[String], because: &str) -> String {
    let accepted = || -> anyhow::Result<String> {
        let program = std::env::current_exe().context("this program isn't where it was")?;
        let mut command = Command::new(program);
        command.arg("accept").args(frames).args(["--because", because]);
        command.current_dir(project.root()).stdin(Stdio::null());
        let ran = command.output().context("can't run `karat accept`")?;
        let text = [ran.stdout, ran.stderr].concat();
        Ok(String::from_utf8_lossy(&text).trim().to_owned())
    };
    accepted().unwrap_or_else(|error| format!("error: {error:#}"))
}

/// Writes the report of some files of records into one page, and opens it.
pub(super) fn open_report(project: &Project, files: &[PathBuf], page: &Path) -> anyhow::Result<()> {
    let mut records: Vec<Record> = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(file)
            .with_context(|| format!("can't read `{}`", file.display()))?;
        for line in text.lines() {
            records.push(serde_json::from_str(line).context("a record isn't one")?);
        }
    }
    report::write_page(records, project, page)?;
    open::that_detached(page).with_context(|| format!("can't open `{}`", page.display()))
}
