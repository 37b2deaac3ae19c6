//! Translates and runs shaders of other projects on each route. For each function and entry point, the program reports
//! if the translation succeeds, is valid, runs, and gives the same results as another route.
//!
//! `cargo run --bin corpus_matrix -- LIST.toml [--json FOLDER]` computes the matrix of each crate and folder of a list
//! (see `corpus.rs`), and prints a table. `cargo ci corpus --routes` runs the program over `ci/corpus.toml`. The
//! program computes the matrix of each crate in a separate process. If a function or entry point hangs or crashes a
//! driver, the process starts again, and leaves out this function or entry point. If a process ends without a result,
//! the program fails. The table counts all other problems.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode};
use std::time::Instant;

use karat_inspect::matrix::{Column, Matrix, Status, Stop, restarted};
use serde::{Deserialize, Serialize};

#[path = "../list.rs"]
mod list;

use list::{List, Wanted};

/// The number of inputs for each function. A wrong translation usually fails for some of 64 inputs.
const CASES: usize = 64;

/// The problems that a cell of the matrix can report. The printed table counts the cells with each problem.
const WRONG: [&str; 5] = ["DIFFERS", "INVALID", "NO VERDICT", "PANICS", "unsupported"];

/// The counts for one crate, or for all crates together.
#[derive(Default, Serialize, Deserialize)]
struct Sum {
    rows: usize,
    judged: usize,
    wrong: usize,
    /// For each column of the matrix, the number of rows with each status or problem.
    counts: BTreeMap<String, BTreeMap<String, usize>>,
    /// For each problem, described by the text that [`reason`] returns: the number of rows with this problem, and the
    /// name of the first such row.
    reasons: BTreeMap<String, (usize, String)>,
    /// The error, if Karat couldn't compute the matrix of the crate.
    error: Option<String>,
}

/// The command-line arguments of a process that computes the matrix of one crate. These arguments follow the file name
/// of the list of crates.
struct One {
    index: usize,
    journal: PathBuf,
    /// The file into which the process writes its counts.
    sum: PathBuf,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let (list, json, one) = match *arguments {
        [list] => (list, None, None),
        [list, "--json", folder] => (list, Some(folder), None),
        [list, "--one", index, journal, sum, ref json @ ..] => {
            let (journal, sum) = (PathBuf::from(journal), PathBuf::from(sum));
            let index = index.parse().expect("an index");
            (list, json.first().copied(), Some(One { index, journal, sum }))
        }
        _ => {
            eprintln!("error: name a list of crates: `corpus_matrix ci/corpus.toml`");
            return ExitCode::from(2);
        }
    };
    let done = List::read(list).map_err(|error| error.to_string()).and_then(|wanted| match &one {
        Some(one) => make_one(&wanted[one.index], one, json).map(|()| true),
        None => make_all(list, &wanted, json),
    });
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

/// Starts a process for each crate, and prints the table. Returns `true` if every process wrote its counts, and Karat
/// computed at least one row of a matrix.
fn make_all(list: &str, wanted: &[Wanted], json: Option<&str>) -> Result<bool, String> {
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let this = std::env::current_exe().map_err(|error| error.to_string())?;
    let (mut all, mut faults, mut packages) = (Sum::default(), Vec::new(), 0);
    let mut text = String::from(
        "| crate | rows | in the matrix | wrong | seconds |\n|---|---:|---:|---:|---:|\n",
    );
    for (index, wanted) in wanted.iter().enumerate() {
        let (name, began) = (wanted.name(), Instant::now());
        let [journal, file] =
            ["journal", "sum"].map(|kind| folder.path().join(format!("{index}.{kind}")));
        let mut program = Command::new(&this);
        program.args([list, "--one", &index.to_string()]).arg(&journal).arg(&file).args(json);
        let status = restarted(&journal, &mut program).map_err(|error| error.to_string())?;
        let read = || serde_json::from_slice::<Sum>(&std::fs::read(&file).ok()?).ok();
        // The process writes this file last and completely, so nothing is lost if a driver crashes while unloading.
        let Some(sum) = read() else {
            let fault = format!("{name}: the process that makes its matrix ended: {status}");
            eprintln!("{fault}");
            faults.push(fault);
            continue;
        };
        let line = match &sum.error {
            Some(error) => format!("| {name} | | | {} | |\n", first_line(error)),
            None => {
                let Sum { rows, judged, wrong, .. } = &sum;
                let seconds = began.elapsed().as_secs_f64();
                format!("| {name} | {rows} | {judged} | {wrong} | {seconds:.1} |\n")
            }
        };
        eprint!("{line}");
        text += &line;
        packages += usize::from(sum.error.is_none());
        all.merge(sum);
    }
    text += &all.table(packages, &faults);
    let written = std::io::stdout().write_all(text.as_bytes());
    Ok(written.is_ok() && faults.is_empty() && all.judged > 0)
}

/// Computes the matrix of one crate, and writes its counts.
fn make_one(wanted: &Wanted, one: &One, json: Option<&str>) -> Result<(), String> {
    let mut sum = Sum::default();
    match make(wanted, &one.journal) {
        Ok(matrix) => {
            sum.add(&wanted.name(), &matrix);
            if let Some(folder) = json {
                let file = format!("{folder}/{}.json", wanted.name().replace(['/', '@'], "-"));
                let json = serde_json::to_string(&matrix).expect("a matrix is plain data");
                std::fs::write(&file, json).map_err(|error| format!("`{file}`: {error}"))?;
            }
        }
        Err(error) => sum.error = Some(error),
    }
    let sum = serde_json::to_string(&sum).expect("a sum is plain data");
    std::fs::write(&one.sum, sum).map_err(|error| error.to_string())
}

fn make(wanted: &Wanted, journal: &Path) -> Result<Matrix, String> {
    let package = wanted.open().map_err(|error| error.to_string())?;
    let with = |package: karat::Package, (module, features): (&String, &Vec<String>)| {
        let features: Vec<&str> = features.iter().map(String::as_str).collect();
        package.module_features(module, &features)
    };
    let package = wanted.with.iter().fold(package, with);
    let request =
        karat_inspect::matrix(&package).columns(Column::usual()).cases(CASES).journal(journal);
    request.run().map_err(|error| error.to_string())
}

fn first_line(text: &str) -> String {
    let line = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    line.replace('|', "\\|")
}

impl Sum {
    fn add(&mut self, name: &str, matrix: &Matrix) {
        let judged: Vec<_> = matrix.rows.iter().filter(|row| row.error.is_none()).collect();
        for row in &judged {
            for (head, cell) in matrix.columns.iter().zip(&row.cells) {
                let counts = self.counts.entry(head.name.clone()).or_default();
                for status in Status::ALL.into_iter().filter(|s| cell.status >= Some(*s)) {
                    *counts.entry(status.name().to_owned()).or_default() += 1;
                }
                let Some(stop) = &cell.stopped else { continue };
                let word = match stop {
                    Stop::Differs(_) => WRONG[0],
                    Stop::Rejected(_) => WRONG[1],
                    Stop::Broke(_) => WRONG[2],
                    Stop::Panicked(_) => WRONG[3],
                    Stop::Unsupported(_) => WRONG[4],
                    _ => continue,
                };
                self.wrong += 1;
                *counts.entry(word.to_owned()).or_default() += 1;
                let known = self.reasons.entry(reason(&head.name, stop));
                known.or_insert_with(|| (0, format!("{name}, {}", row.name))).0 += 1;
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
    }

    fn merge(&mut self, other: Self) {
        self.rows += other.rows;
        self.judged += other.judged;
        self.wrong += other.wrong;
        for (column, counts) in other.counts {
            let all = self.counts.entry(column).or_default();
            counts.into_iter().for_each(|(word, count)| *all.entry(word).or_default() += count);
        }
        for (reason, (count, first)) in other.reasons {
            self.reasons.entry(reason).or_insert((0, first)).0 += count;
        }
    }

    fn table(&self, packages: usize, faults: &[String]) -> String {
        let mut text = format!(
            "\n{packages} packages, {} functions and entry points, {} of them in the matrix.\n\n| column |",
            self.rows, self.judged
        );
        let words: Vec<&str> = Status::ALL.map(Status::name).into_iter().chain(WRONG).collect();
        for word in &words {
            write!(text, " {word} |").expect("text takes text");
        }
        writeln!(text, "\n|---|{}", "---:|".repeat(words.len())).expect("text takes text");
        for (column, counts) in &self.counts {
            let cells: Vec<String> = words
                .iter()
                .map(|w| counts.get(*w).map_or(0, |count| *count).to_string())
                .collect();
            writeln!(text, "| {column} | {} |", cells.join(" | ")).expect("text takes text");
        }
        let mut reasons: Vec<_> = self.reasons.iter().collect();
        reasons.sort_by_key(|(_, (count, _))| std::cmp::Reverse(*count));
        text += "\n| reason | cells | first |\n|---|---:|---|\n";
        for (reason, (count, first)) in reasons {
            writeln!(text, "| {reason} | {count} | {first} |").expect("text takes text");
        }
        for fault in faults {
            writeln!(text, "fault: {fault}").expect("text takes text");
        }
        text
    }
}

/// Shortens the paths of crates in a line of text: removes cargo's folder, which differs between machines.
fn without_registry(line: &str) -> String {
    let Some((before, after)) = line.split_once("/registry/src/") else { return line.to_owned() };
    let begin = before.rfind(['(', '`', ' ']).map_or(0, |at| at + 1);
    let (_, file) = after.split_once('/').unwrap_or(("", after));
    format!("{}{file}", &before[..begin])
}

/// Returns a short text for a problem: the column's name, and one line of the problem's message. A `#` replaces each
/// number, so that the same problem in several rows has the same text.
fn reason(column: &str, stop: &Stop) -> String {
    let text = stop.text();
    let line = match stop {
        Stop::Differs(_) => "other results".to_owned(),
        // The first line is the command, which contains a file's name. Another line describes the error.
        Stop::Rejected(_) => {
            let line = text.lines().find(|line| line.contains("rror")).map(str::to_owned);
            line.unwrap_or_else(|| first_line(text))
        }
        _ => first_line(text),
    };
    let line = without_registry(&line);
    let plain: String = line.chars().map(|c| if c.is_ascii_digit() { '#' } else { c }).collect();
    let mut short = plain.replace('|', "\\|");
    while short.contains("##") {
        short = short.replace("##", "#");
    }
    format!("{column}: {}", short.chars().take(160).collect::<String>())
}
