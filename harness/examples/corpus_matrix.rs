//! Shaders that others wrote, on each route: how far their functions and entry points get.
//!
//! `cargo run --features routes --example corpus_matrix -- LIST.toml [--json FOLDER]` makes the matrix of
//! each crate and folder of a list (see `corpus.rs`), and prints a table. `cargo ci corpus --routes`
//! runs it over `ci/corpus.toml`. A panic is a fault; whatever else goes wrong is a row. A row that passes
//! the deadline ends the process, which begins again without it: `--overdue FILE` is where that is noted.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::{Duration, Instant};

use karat::matrix::{Column, Matrix, Status, Stop, restarted};

#[path = "corpus/list.rs"]
mod list;

use list::{List, Wanted};

/// Inputs of each function: enough to tell translations apart.
const CASES: usize = 64;

/// Words of a cell that are findings, behind those of the statuses.
const WRONG: [&str; 4] = ["DIFFERS", "INVALID", "PANICS", "unsupported"];

/// All crates together.
#[derive(Default)]
struct All {
    rows: usize,
    judged: usize,
    modules: usize,
    /// How many rows got how far, by column.
    counts: BTreeMap<String, BTreeMap<&'static str, usize>>,
    /// What is wrong, by its first line: how often, and where first.
    reasons: BTreeMap<String, (usize, String)>,
    faults: Vec<String>,
}

fn main() -> ExitCode {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let Some(at) = arguments.iter().position(|argument| argument == "--overdue") else {
        return supervise(&arguments);
    };
    let overdue = PathBuf::from(arguments.drain(at..).nth(1).unwrap_or_default());
    let (list, folder) = match &*arguments {
        [list] => (list, None),
        [list, json, folder] if json == "--json" => (list, Some(folder)),
        _ => {
            eprintln!("error: name a list of crates: `corpus_matrix ci/corpus.toml`");
            return ExitCode::from(2);
        }
    };
    let wanted = match List::read(list) {
        Ok(wanted) => wanted,
        Err(error) => {
            eprintln!("error: {error}");
            return ExitCode::from(2);
        }
    };
    let mut all = All::default();
    let mut text = String::from(
        "| crate | rows | in the matrix | wrong | seconds |\n|---|---:|---:|---:|---:|\n",
    );
    for wanted in &wanted {
        let (name, began) = (wanted.name(), Instant::now());
        match catch_unwind(|| make(wanted, &overdue)) {
            Ok(Ok(matrix)) => {
                let line = all.add(&name, &matrix, began.elapsed());
                eprint!("{line}");
                text += &line;
                if let Some(folder) = folder {
                    let file = format!("{folder}/{}.json", name.replace(['/', '@'], "-"));
                    let json = serde_json::to_string(&matrix).expect("a matrix is plain data");
                    if let Err(error) = std::fs::write(&file, json) {
                        eprintln!("error: `{file}`: {error}");
                        return ExitCode::from(2);
                    }
                }
            }
            Ok(Err(error)) => {
                eprintln!("{name}: {error}");
                writeln!(text, "| {name} | | | {} | |", first_line(&error))
                    .expect("text takes text");
            }
            Err(_) => all.faults.push(format!("{name}: it panics")),
        }
    }
    text += &all.table();
    let written = std::io::stdout().write_all(text.as_bytes());
    if written.is_ok() && all.faults.is_empty() && all.judged > 0 {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    }
}

/// Runs this program in a process of its own, again as often as a row passes the deadline.
fn supervise(arguments: &[String]) -> ExitCode {
    let run = || {
        let folder = tempfile::tempdir()?;
        let file = folder.path().join("overdue.jsonl");
        let mut program = Command::new(std::env::current_exe()?);
        restarted(&file, program.args(arguments).arg("--overdue").arg(&file))
    };
    match run() {
        Ok(status) => {
            let code = status.code().and_then(|code| u8::try_from(code).ok());
            code.map_or(ExitCode::FAILURE, ExitCode::from)
        }
        Err(error) => {
            eprintln!("error: this program can't be run again: {error}");
            ExitCode::from(2)
        }
    }
}

fn make(wanted: &Wanted, overdue: &Path) -> Result<Matrix, String> {
    let package = wanted.open().map_err(|error| error.to_string())?;
    let with = |package: karat::Package, (module, features): (&String, &Vec<String>)| {
        let features: Vec<&str> = features.iter().map(String::as_str).collect();
        package.validated_with(module, &features)
    };
    let package = wanted.with.iter().fold(package, with);
    let request = package.matrix().columns(Column::usual()).cases(CASES).overdue(overdue);
    request.run().map_err(|error| error.to_string())
}

fn first_line(text: &str) -> String {
    let line = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    line.replace('|', "\\|")
}

impl All {
    /// Adds a crate; its line in the table.
    fn add(&mut self, name: &str, matrix: &Matrix, took: Duration) -> String {
        let judged: Vec<_> = matrix.rows.iter().filter(|row| row.error.is_none()).collect();
        let mut wrong = 0;
        for row in &judged {
            for (head, cell) in matrix.columns.iter().zip(&row.cells) {
                let counts = self.counts.entry(head.name.clone()).or_default();
                for status in Status::ALL.into_iter().filter(|s| cell.status >= Some(*s)) {
                    *counts.entry(status.name()).or_default() += 1;
                }
                if let Some(
                    stop @ (Stop::Differs(_)
                    | Stop::Rejected(_)
                    | Stop::Broke(_)
                    | Stop::Panicked(_)
                    | Stop::Unsupported(_)),
                ) = &cell.stopped
                {
                    wrong += 1;
                    let word = match stop {
                        Stop::Differs(_) => WRONG[0],
                        Stop::Rejected(_) | Stop::Broke(_) => WRONG[1],
                        Stop::Panicked(_) => WRONG[2],
                        _ => WRONG[3],
                    };
                    *counts.entry(word).or_default() += 1;
                    let known = self.reasons.entry(reason(&head.name, stop));
                    known.or_insert_with(|| (0, format!("{name}, {}", row.name))).0 += 1;
                }
            }
        }
        for row in matrix.rows.iter().filter(|row| row.kind != "not callable") {
            if let Some(error) = &row.error {
                let known = self.reasons.entry(format!("not in the matrix: {}", first_line(error)));
                known.or_insert_with(|| (0, format!("{name}, {}", row.name))).0 += 1;
            }
        }
        self.rows += matrix.rows.len();
        self.judged += judged.len();
        self.modules += 1;
        let seconds = took.as_secs_f64();
        format!("| {name} | {} | {} | {wrong} | {seconds:.1} |\n", matrix.rows.len(), judged.len())
    }

    fn table(&self) -> String {
        let mut text = format!(
            "\n{} packages, {} functions and entry points, {} of them in the matrix.\n\n| column |",
            self.modules, self.rows, self.judged
        );
        let words: Vec<&str> = Status::ALL.map(Status::name).into_iter().chain(WRONG).collect();
        for word in &words {
            write!(text, " {word} |").expect("text takes text");
        }
        writeln!(text, "\n|---|{}", "---:|".repeat(words.len())).expect("text takes text");
        for (column, counts) in &self.counts {
            let cells: Vec<String> =
                words.iter().map(|w| counts.get(w).map_or(0, |count| *count).to_string()).collect();
            writeln!(text, "| {column} | {} |", cells.join(" | ")).expect("text takes text");
        }
        let mut reasons: Vec<_> = self.reasons.iter().collect();
        reasons.sort_by_key(|(_, (count, _))| std::cmp::Reverse(*count));
        text += "\n| reason | cells | first |\n|---|---:|---|\n";
        for (reason, (count, first)) in reasons {
            writeln!(text, "| {reason} | {count} | {first} |").expect("text takes text");
        }
        for fault in &self.faults {
            writeln!(text, "fault: {fault}").expect("text takes text");
        }
        text
    }
}

/// The column and what is wrong, without what differs from row to row.
fn reason(column: &str, stop: &Stop) -> String {
    let text = stop.text();
    let line = match stop {
        Stop::Differs(_) => "other results".to_owned(),
        // The first line is the command with the file's name.
        Stop::Rejected(_) => {
            let line = text.lines().find(|line| line.contains("rror")).map(str::to_owned);
            line.unwrap_or_else(|| first_line(text))
        }
        _ => first_line(text),
    };
    let plain: String = line.chars().map(|c| if c.is_ascii_digit() { '#' } else { c }).collect();
    let mut short = plain.replace('|', "\\|");
    while short.contains("##") {
        short = short.replace("##", "#");
    }
    format!("{column}: {}", short.chars().take(160).collect::<String>())
}
