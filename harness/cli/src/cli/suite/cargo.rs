//!
//! Runs Rust tests on request. `karat watch` starts this process in a Cargo project.
//!
//! If a Rust file changed, Cargo builds the test programs. If shaders changed, the programs run without a build. An
//! edit affects a test if it changes a shader program that the test linked in its last run, or a file that the test
//! read. Each run starts the test programs again, because Rust's test runner ends after its tests.

pub(in crate::cli) mod libtest;
pub(in crate::cli) mod programs;

use std::collections::{BTreeSet, HashMap, HashSet};
use std::io::Write;
use std::ops::RangeInclusive;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use anyhow::Context;
use karat::unstable::diagnostic::FileRead;
use karat::unstable::record::{self, Record};
use karat::unstable::reflect::Dependence;
use karat_suite::Wrong;

use self::programs::{Programs, TestProgram};
use super::super::watch::{Reads, Request, Said};
use super::super::{Ending, Outcome};
use super::latest::Latest;
use super::serve::{requests, say};

pub(super) fn run(root: &Path, out: &mut dyn Write) -> Outcome {
    let mut tests = Tests { programs: Programs::of(root), ..Tests::default() };
    for request in requests(libtest::end_all) {
        karat::unstable::workspace::refresh();
        if let Some(file) = &request.report {
            let there = tests.names("");
            say(&tests.latest.write(file, |name| there.contains(name)), out)?;
            continue;
        }
        let done = match tests.answer(&request, out) {
            Ok(error) => {
                let unknown = tests.programs.have_scripts() || error.is_some();
                let (tests, idle) = tests.judged(&request.filter);
                // A reference may read any file.
                let reads = match tests.is_empty() && !unknown {
                    true => Reads::These(BTreeSet::new()),
                    false => Reads::Any,
                };
                let broken = error.map(Wrong::of).into_iter().collect();
                let records = Vec::new();
                Said::Done { tests, broken, idle, invalid: None, remarks: None, reads, records }
            }
            Err(error) => {
                // The watching process drops all verdicts.
                tests.ran.clear();
                Said::failed(format!("{error:#}"))
            }
        };
        say(&done, out)?;
    }
    Ok(Ending::Good)
}

/// The shader programs that a test linked in its last run, and the files that it read.
#[derive(Default)]
struct Made {
    linked: Vec<Dependence>,
    read: Vec<FileRead>,
}

const SHADERS: [&str; 2] = ["wgsl", "wesl"];

impl Made {
    /// Checks if the verdict of the test is still valid after these files changed.
    fn is_current(&self, changed: &HashSet<&Path>) -> bool {
        // Linked shaders are compared by their meaning, other files by their bytes.
        let by_bytes = |file: &Path| !is_shader(file) || self.linked.is_empty();
        let same = |read: &FileRead| {
            !changed.contains(&*read.file)
                || !by_bytes(&read.file)
                || FileRead::now(&read.file) == *read
        };
        let reads_any = self.read.iter().any(|read| changed.contains(&*read.file));
        self.read.iter().all(same) && (!reads_any || self.linked.iter().all(Dependence::is_current))
    }
}

fn is_shader(file: &Path) -> bool {
    file.extension().is_some_and(|ending| SHADERS.iter().any(|known| ending == *known))
}

#[derive(Default)]
struct Tests {
    programs: Programs,
    /// The tests, by their displayed names.
    made: HashMap<String, Made>,
    ran: HashSet<String>,
    /// The tests with frames that this process doesn't draw. The value is `true` if the test passed.
    left_out: HashMap<String, bool>,
    latest: Latest,
    /// The changed files that no known test reads, with their state at the last edit.
    unread: HashMap<PathBuf, FileRead>,
    written: Written,
}

/// The largest difference between the time of a write and the time of the written file. Linux rounds file times down to
/// timer ticks of up to 10 ms, but the clock of programs is finer.
const TICK: Duration = Duration::from_millis(20);

/// The files that tests write while they run. These files cause no new run. If a file changes during one run, its
/// author may have edited it. If the file also changes during the next run, the tests write it.
#[derive(Default)]
struct Written {
    ran: Option<RangeInclusive<SystemTime>>,
    /// The files that changed during the last run.
    files: HashSet<PathBuf>,
}

impl Written {
    /// Checks if a change of a file at this time came from the tests, and not from an author.
    fn has(&mut self, file: &Path, changed: Option<SystemTime>) -> bool {
        let ran = self.ran.as_ref();
        match ran.zip(changed).is_some_and(|(ran, changed)| ran.contains(&changed)) {
            true => !self.files.insert(file.to_owned()),
            false => {
                self.files.remove(file);
                false
            }
        }
    }
}

impl Tests {
    fn names(&self, filter: &str) -> BTreeSet<String> {
        let all = self.programs.all().flat_map(TestProgram::shown);
        all.filter(|name| name.contains(filter)).collect()
    }

    /// Returns [`names`](Self::names) without the tests that pass only because this process left out their frames. Also
    /// returns the number of all tests with frames that this process doesn't draw.
    fn judged(&self, filter: &str) -> (BTreeSet<String>, usize) {
        let names = self.names(filter);
        let idle = names.iter().filter(|name| self.left_out.contains_key(*name)).count();
        let is_judged =
            |name: &String| self.left_out.get(name) != Some(&true) || self.latest.has(name);
        (names.into_iter().filter(is_judged).collect(), idle)
    }

    /// Runs the tests of a request. If the project can't be built, returns the error of the build.
    fn answer(&mut self, request: &Request, out: &mut dyn Write) -> anyhow::Result<Option<String>> {
        let changed: HashSet<&Path> = request.changed.iter().map(PathBuf::as_path).collect();
        if self.programs.are_stale(&changed) {
            let rebuilt = match self.programs.build()? {
                Ok(rebuilt) => rebuilt,
                Err(message) => return Ok(Some(message)),
            };
            self.ran.retain(|name| !rebuilt.iter().any(|program| name.starts_with(&**program)));
        }
        let concerned = self.concerned(request, &changed);
        // Failed tests run first.
        let failed = |name: &String| request.first.contains(name);
        let (first, rest): (Vec<String>, Vec<String>) = concerned.into_iter().partition(failed);
        let began = SystemTime::now();
        // The time of a file may be that of the last tick before the run.
        let began = began.checked_sub(TICK).unwrap_or(began);
        let runs = !first.is_empty() || !rest.is_empty();
        for names in [first, rest] {
            self.run(&names, out)?;
        }
        if runs {
            self.written.ran = Some(began..=SystemTime::now());
        }
        // A build script may have read the edited file, and only Cargo knows that.
        if self.programs.have_scripts() && !changed.is_empty() {
            let rebuilt = match self.programs.build()? {
                Ok(rebuilt) => rebuilt,
                Err(message) => return Ok(Some(message)),
            };
            let of_rebuilt = |name: &String| rebuilt.iter().any(|one| name.starts_with(&**one));
            let names = self.names(&request.filter).into_iter().filter(of_rebuilt);
            self.run(&names.collect::<Vec<_>>(), out)?;
        }
        Ok(None)
    }

    /// Returns the tests whose verdict may have changed.
    fn concerned(&mut self, request: &Request, changed: &HashSet<&Path>) -> Vec<String> {
        let names: Vec<String> = self.names(&request.filter).into_iter().collect();
        let reads = |file: &Path| {
            self.made.values().any(|made| made.read.iter().any(|read| read.file == file))
        };
        // A reference may read a file that no known test reads, or the file may be a new module. Only new content
        // counts: otherwise tests that write the same bytes again would run forever.
        let unread = changed.iter().filter(|file| !self.programs.builds(file) && !reads(file));
        let unread: Vec<FileRead> = unread.map(|file| FileRead::now(file)).collect();
        let all = unread.into_iter().fold(false, |all, now| {
            let is_shader = is_shader(&now.file);
            let changed = now.file.metadata().and_then(|file| file.modified()).ok();
            let is_own = !is_shader && self.written.has(&now.file, changed);
            let before = self.unread.insert(now.file.clone(), now.clone());
            let is_there = !now.hash.is_empty();
            let is_new = before.is_none_or(|before| !is_shader && before != now);
            all || (is_there && is_new && !is_own)
        });
        if all || request.all {
            return names;
        }
        let is_concerned = |name: &String| {
            !self.ran.contains(name)
                || request.first.contains(name)
                || self.made.get(name).is_some_and(|made| !made.is_current(changed))
        };
        // Linking a hundred programs again uses all cores.
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let part = names.len().div_ceil(threads).max(1);
        std::thread::scope(|scope| {
            let is_concerned = &is_concerned;
            let parts: Vec<_> = names
                .chunks(part)
                .map(|part| {
                    scope.spawn(move || {
                        part.iter().filter(|name| is_concerned(name)).cloned().collect::<Vec<_>>()
                    })
                })
                .collect();
            let joined = parts.into_iter().map(|part| part.join());
            joined.flat_map(|part| part.unwrap_or_else(|panic| resume_unwind(panic))).collect()
        })
    }

    /// Runs tests, and records the programs and files of each test.
    fn run(&mut self, names: &[String], out: &mut dyn Write) -> anyhow::Result<()> {
        for program in self.programs.all() {
            let own: Vec<&str> = program
                .tests
                .iter()
                .map(String::as_str)
                .filter(|test| names.contains(&program.show(test)))
                .collect();
            if own.is_empty() {
                continue;
            }
            let folder = tempfile::tempdir()?;
            let mut failed = HashSet::new();
            libtest::run(program, &own, (folder.path(), None), &mut |test, message| {
                if message.is_some() {
                    failed.insert(test.to_owned());
                }
                let wrong = message.map(Wrong::of);
                say(&Said::Test { name: program.show(test), wrong }, out)
            })?;
            let left_out =
                record::left_out(folder.path()).context("can't read the list of skipped tests")?;
            for test in &own {
                let name = program.show(test);
                match left_out.contains(*test) {
                    true => drop(self.left_out.insert(name, !failed.contains(*test))),
                    false => drop(self.left_out.remove(&name)),
                }
            }
            let shown: Vec<String> = own.iter().map(|test| program.show(test)).collect();
            let records = record::read(folder.path())?;
            let mut made = made(folder.path(), &records)?;
            self.latest.take(shown.iter().map(String::as_str), records, |test| program.show(test));
            // If a thread without a test's name linked a program, the program may belong to any test.
            let others: Vec<Dependence> = made
                .iter()
                .filter(|(name, _)| !program.tests.contains(*name))
                .flat_map(|(_, made)| made.linked.clone())
                .collect();
            for test in own {
                let mut own = made.remove(test).unwrap_or_default();
                own.linked.extend(others.iter().cloned());
                self.made.insert(program.show(test), own);
                self.ran.insert(program.show(test));
            }
        }
        Ok(())
    }
}

/// Returns the programs and files of a run's tests, by the names of the tests in the test program.
fn made(folder: &Path, records: &[Record]) -> anyhow::Result<HashMap<String, Made>> {
    let mut all: HashMap<String, Made> = HashMap::new();
    let all_of =
        Dependence::all(folder).context("can't read the list of shaders that the tests linked")?;
    for dependence in all_of {
        all.entry(dependence.test.clone()).or_default().linked.push(dependence);
    }
    for record in records {
        all.entry(record.test.clone()).or_default().read.extend(record.read.iter().cloned());
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    // Lesson 192
    #[test]
    fn each_run_owns_the_files_that_it_wrote() {
        let at = |second: u64| Some(SystemTime::UNIX_EPOCH + Duration::from_secs(second));
        let run = |from: u64| Some(at(from).expect("a time")..=at(from + 5).expect("a time"));
        let mut written = Written { ran: run(10), ..Written::default() };
        let (log, data) = (Path::new("out.log"), Path::new("rows.dat"));
        assert!(!written.has(log, at(12)) && !written.has(data, at(12)), "an author may save then");
        written.ran = run(20);
        assert!(written.has(log, at(22)), "it is written in each run");
        assert!(!written.has(data, at(30)), "no test ran");
        written.ran = run(40);
        assert!(written.has(log, at(42)) && !written.has(data, at(42)));
        assert!(!written.has(log, None), "it is gone");
    }
}
