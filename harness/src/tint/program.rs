//! Runs the program `tint`, with one process for each text.

use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Once;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use rayon::prelude::*;
use serde::Deserialize;

use super::answer::{Answer, Message, Severity};
use super::{NoVerdict, Question};
use crate::lines::{self, Broken};

/// The time limit for one text. A text usually takes about 30 ms.
const PATIENCE: Duration = Duration::from_secs(10);
const MOST_BYTES: u64 = 1 << 20;
const POLL: Duration = Duration::from_millis(1);

/// A diagnostic in the form of `--diagnostics-format=json`.
#[derive(Deserialize)]
struct Written {
    severity: Severity,
    message: String,
    range: Option<WrittenRange>,
}

#[derive(Deserialize)]
struct WrittenRange {
    start: Place,
    end: Place,
}

/// A line and a column, both from 1. Columns count bytes.
#[derive(Deserialize)]
struct Place {
    line: usize,
    column: usize,
}

/// Checks if a program called `tint` is the compiler Tint, because Debian has a desktop panel of the same name. Returns
/// an error if the program doesn't end in time, because such a program may still be Tint.
pub(super) fn is_tint(program: &Path) -> Result<bool, String> {
    let says = |bytes: &[u8]| String::from_utf8_lossy(bytes).contains("--diagnostics-format");
    match lines::output(Command::new(program).arg("--help"), PATIENCE, MOST_BYTES) {
        Ok(ran) => Ok(says(&ran.stdout) || says(&ran.stderr)),
        Err(hung @ Broken::Hung(_)) => Err(format!("`{} --help`: {hung}", program.display())),
        Err(_) => Ok(false),
    }
}

pub(super) fn ask(program: &Path, questions: &[Question]) -> Vec<Result<Answer, NoVerdict>> {
    questions.par_iter().map(|question| judge(program, &question.text)).collect()
}

struct Folder(std::path::PathBuf);

impl Folder {
    fn new() -> std::io::Result<Self> {
        static COUNT: AtomicUsize = AtomicUsize::new(0);
        static CLEAN: Once = Once::new();
        CLEAN.call_once(remove_left);
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("karat-tint-{}-{count}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&folder)?;
        Ok(Self(folder))
    }
}

/// Removes the temporary folders of Karat processes that were killed.
fn remove_left() {
    let processes = Path::new("/proc");
    if !processes.join("self").exists() {
        return;
    }
    let entries = std::fs::read_dir(std::env::temp_dir()).into_iter().flatten().flatten();
    for entry in entries {
        let name = entry.file_name().to_string_lossy().into_owned();
        let owner = name.strip_prefix("karat-tint-").and_then(|rest| rest.split('-').next());
        if owner.is_some_and(|owner| !processes.join(owner).exists()) {
            drop(std::fs::remove_dir_all(entry.path()));
        }
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        drop(std::fs::remove_dir_all(&self.0));
    }
}

fn judge(program: &Path, text: &str) -> Result<Answer, NoVerdict> {
    let start = |error: std::io::Error| Broken::Start(error.to_string());
    let folder = Folder::new().map_err(start)?;
    std::fs::write(folder.0.join("shader.wgsl"), text).map_err(start)?;
    let said = std::fs::File::create(folder.0.join("said")).map_err(start)?;
    let mut child = Command::new(program)
        // Tells `tint` to translate to WGSL, because translation to other languages needs an entry point.
        .args(["--diagnostics-format=json", "--format", "wgsl", "-o", "out.wgsl", "shader.wgsl"])
        .current_dir(&folder.0)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(said)
        .spawn()
        .map_err(start)?;
    let until = Instant::now() + PATIENCE;
    let status = loop {
        match child.try_wait().map_err(start)? {
            Some(status) => break status,
            None if Instant::now() > until => {
                drop(child.kill());
                drop(child.wait());
                return Err(Broken::Hung(PATIENCE.as_secs()).into());
            }
            None => std::thread::sleep(POLL),
        }
    };
    let again = std::fs::read_to_string(folder.0.join("out.wgsl")).unwrap_or_default();
    let said = std::fs::read_to_string(folder.0.join("said")).map_err(start)?;
    let said = said.trim();
    let written: Vec<Written> = match (said, status.success()) {
        ("", true) => Vec::new(),
        ("", false) => {
            return Err(Broken::Ended { status: status.to_string(), said: String::new() }.into());
        }
        (said, _) => serde_json::from_str(said)
            .map_err(|_| NoVerdict::Garbage(crate::diagnostic::one_line(said)))?,
    };
    let messages = written.into_iter().map(|one| Message {
        severity: one.severity,
        text: one.message,
        range: one.range.map(|range| {
            let start = offset(text, &range.start);
            start..offset(text, &range.end).max(start)
        }),
    });
    let answer = Answer { messages: messages.collect(), ..Answer::default() };
    // The program `tint` fails exactly if it reports an error. A successful run writes the text to a file.
    let is_written = !again.trim().is_empty() || text.trim().is_empty();
    if answer.rejects() == status.success() || (status.success() && !is_written) {
        return Err(NoVerdict::Garbage(format!(
            "the program ended with {status} and wrote {said}"
        )));
    }
    Ok(answer)
}

/// The byte offset of a line and a column.
fn offset(text: &str, place: &Place) -> usize {
    let lines = text.split_inclusive('\n').take(place.line.saturating_sub(1));
    let start: usize = lines.map(str::len).sum();
    (start + place.column.saturating_sub(1)).min(text.len())
}
