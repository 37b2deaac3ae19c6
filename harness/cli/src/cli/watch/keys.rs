//! The actions of two keys: accepting frames, and opening the report.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::Context;
use karat::golden::Goldens;
use karat::unstable::record::Record;

use super::super::project::Project;
use super::super::report;

/// The names of pending frames, by their folder of goldens.
pub(super) type Waiting = BTreeMap<PathBuf, Vec<String>>;

/// Returns the pending frames in the project's goldens and beside the tests in folders of shaders.
pub(super) fn pending(project: &Project, shaders: impl Iterator<Item = PathBuf>) -> Waiting {
    let mut waiting = Waiting::new();
    for folder in project.goldens().into_iter().chain(shaders) {
        for frame in Goldens::open(&folder).pending().frames {
            // A folder of shaders may have several folders of goldens. The names of frames are paths below such a
            // folder.
            let mut above = frame.path.ancestors().skip(1 + frame.case.matches('/').count());
            if let Some(goldens) = above.next() {
                // Two paths may lead to the same folder.
                let goldens = goldens.canonicalize().unwrap_or_else(|_| goldens.to_owned());
                let names = waiting.entry(goldens).or_default();
                if !names.contains(&frame.case) {
                    names.push(frame.case);
                }
            }
        }
    }
    waiting
}

/// Accepts frames as `karat accept` does, and returns the message of that command.
pub(super) fn accept(project: &Project, waiting: &Waiting, because: &str) -> String {
    let accepted = |(folder, frames): (&PathBuf, &Vec<String>)| -> anyhow::Result<String> {
        let program = std::env::current_exe().context("can't find karat's executable file")?;
        let mut command = Command::new(program);
        command.arg("accept").args(frames).args(["--because", because]);
        command.arg("--goldens").arg(folder);
        command.current_dir(project.root()).stdin(Stdio::null());
        let ran = command.output().context("can't run `karat accept`")?;
        let text = [ran.stdout, ran.stderr].concat();
        Ok(String::from_utf8_lossy(&text).trim().to_owned())
    };
    let said = |one| accepted(one).unwrap_or_else(|error| format!("error: {error:#}"));
    waiting.iter().map(said).collect::<Vec<_>>().join("\n")
}

/// Merges several files of records into one report, and opens it.
pub(super) fn open_report(project: &Project, files: &[PathBuf], page: &Path) -> anyhow::Result<()> {
    let mut records: Vec<Record> = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(file)
            .with_context(|| format!("can't read `{}`", file.display()))?;
        for line in text.lines() {
            records.push(serde_json::from_str(line).context("a line of the file isn't a record")?);
        }
    }
    report::write_page(records, project, page)?;
    open::that_detached(page).with_context(|| format!("can't open `{}`", page.display()))
}
