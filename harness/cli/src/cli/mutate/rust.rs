//! Tests in Rust, as judges of mutants: by their programs, without Cargo, with the mutant as an overlay.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::Path;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use karat::Package;
use karat::unstable::output::tell;
use karat::unstable::record::{self, Verdict};
use karat::unstable::reflect::Dependence;
use karat_mutate::{Candidate, Judged, Others};

use super::super::suite::cargo::libtest;
use super::super::suite::cargo::programs::Programs;

/// How long a program may take for a mutant: far more than it took without one, which other programs may slow down.
const LEAST: Duration = Duration::from_secs(20);
const MANY: u32 = 10;

/// All tests of a project.
pub(super) struct RustTests {
    programs: Programs,
    /// The programs that tests are made of, each once, with the tests by their names in front of people.
    made: Vec<(Dependence, BTreeSet<String>)>,
    pub(super) count: usize,
    /// How long a program may take for a mutant.
    limit: Duration,
    /// Those that fail without a mutant, and not by a check, as what draws does on the engine. They are no judges.
    pub(super) unfit: Vec<String>,
    /// One program runs at a time: each takes all cores.
    turn: Mutex<()>,
}

/// The tests of a project, as far as they use the shaders of a package.
pub(super) struct OfPackage<'t> {
    pub(super) tests: &'t RustTests,
    pub(super) package: &'t Package,
}

impl RustTests {
    /// Builds them, and runs all once. None in a project without any.
    pub(super) fn of(root: &Path, filter: Option<&str>) -> anyhow::Result<Self> {
        tell("building the tests in Rust, and running each once");
        let mut slowest = Duration::ZERO;
        let mut programs = Programs::of(root);
        if let Err(message) = programs.build()? {
            bail!("{message}");
        }
        let mut made: BTreeMap<String, (Dependence, BTreeSet<String>)> = BTreeMap::new();
        let mut judges: BTreeSet<String> = BTreeSet::new();
        let (mut red, mut unfit) = (Vec::new(), Vec::new());
        for program in programs.all() {
            let tests: Vec<&str> = program
                .tests
                .iter()
                .map(String::as_str)
                .filter(|test| filter.is_none_or(|filter| program.show(test).contains(filter)))
                .collect();
            if tests.is_empty() {
                continue;
            }
            let folder = tempfile::tempdir().context("no temporary folder")?;
            let mut failed: Vec<(String, String)> = Vec::new();
            let began = Instant::now();
            libtest::run(program, &tests, (folder.path(), None), &mut |test, message| {
                failed.extend(message.map(|message| (test.to_owned(), message)));
                Ok(())
            })?;
            slowest = slowest.max(began.elapsed());
            let records = record::read(folder.path())?;
            let is_checked = |test: &str| {
                records.iter().any(|one| one.test == test && one.verdict == Verdict::Fail)
            };
            let mut idle: HashSet<String> = HashSet::new();
            for (test, message) in failed {
                match is_checked(&test) {
                    true => red.push((program.show(&test), message)),
                    false => {
                        unfit.push(program.show(&test));
                        idle.insert(test);
                    }
                }
            }
            let all = Dependence::all(folder.path()).context("what tests linked can't be read")?;
            // A thread without a test's name may have linked for any test of its program.
            for mut one in all {
                let is_own = tests.contains(&&*one.test);
                let users = tests.iter().filter(|test| !is_own || **test == one.test);
                let users = users.filter(|test| !idle.contains(**test));
                let users: Vec<String> = users.map(|test| program.show(test)).collect();
                one.test.clear();
                let key = serde_json::to_string(&one).context("it is plain data")?;
                judges.extend(users.iter().cloned());
                made.entry(key).or_insert((one, BTreeSet::new())).1.extend(users);
            }
        }
        if let Some((test, message)) = red.first() {
            let more =
                if red.len() > 1 { format!(", and {} more", red.len() - 1) } else { String::new() };
            bail!(
                "`{test}`{more} fails without a mutant, and would kill each: mend it first\n\n{}",
                message.trim_end()
            );
        }
        unfit.sort();
        let (made, count) = (made.into_values().collect(), judges.len());
        let limit = LEAST + MANY * slowest;
        Ok(Self { programs, made, count, limit, unfit, turn: Mutex::default() })
    }

    fn judge(&self, package: &Package, candidate: &Candidate) -> anyhow::Result<Judged> {
        let text = candidate.mutant.applied(&candidate.text);
        let root = package.root();
        // As an overlay names it, beside modules of other packages.
        let below = match root.is_file() {
            true => root.file_name().map(Path::new).unwrap_or(&root).to_owned(),
            false => Path::new(&package.name()).join(candidate.file.strip_prefix(&root)?),
        };
        let scratch = tempfile::tempdir().context("no temporary folder")?;
        let (overlay, records) = (scratch.path().join("overlay"), scratch.path().join("record"));
        let file = overlay.join(below);
        std::fs::create_dir_all(file.parent().unwrap_or(&overlay))?;
        std::fs::write(&file, &text)?;
        // A file that another process can't open is text in memory, which no overlay replaces.
        let changes = |(one, _): &&(Dependence, BTreeSet<String>)| {
            one.is_current_with(&candidate.file, &text) == Some(false)
        };
        let users: BTreeSet<&String> =
            self.made.iter().filter(changes).flat_map(|(_, users)| users).collect();
        let mut judged = Judged::default();
        for program in self.programs.all() {
            let is_user = |test: &&str| users.contains(&program.show(test));
            let concerned: Vec<&str> =
                program.tests.iter().map(String::as_str).filter(is_user).collect();
            if concerned.is_empty() {
                continue;
            }
            judged.concerned += concerned.len();
            let own = records.join(judged.concerned.to_string());
            std::fs::create_dir_all(&own)?;
            let mut failed: Vec<(String, String)> = Vec::new();
            let turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
            let was_ended = self.within_limit(&mut || {
                libtest::run(program, &concerned, (&own, Some(&overlay)), &mut |test, message| {
                    failed.extend(message.map(|message| (test.to_owned(), message)));
                    Ok(())
                })
            })?;
            drop(turn);
            if was_ended {
                let seconds = self.limit.as_secs();
                let reason = format!("it was ended after {seconds} s");
                judged.stopped = Some((program.show(concerned[0]), reason));
                continue;
            }
            let records = record::read(&own)?;
            for (test, message) in failed {
                let verdicts = records.iter().filter(|one| one.test == test).map(|one| one.verdict);
                let verdicts: Vec<Verdict> = verdicts.collect();
                let name = program.show(&test);
                // Without an error of Karat's it is a check, or an assertion of the test's own, that fails.
                if verdicts.contains(&Verdict::Fail) || !verdicts.contains(&Verdict::Error) {
                    return Ok(Judged { killed: Some(name), ..judged });
                }
                let reason = message.lines().find(|line| !line.trim().is_empty());
                judged.stopped = Some((name, reason.unwrap_or_default().trim().to_owned()));
            }
        }
        Ok(judged)
    }
}

impl RustTests {
    /// Runs a program, which is ended where it takes too long: a test of its own may wait for what a mutant never brings.
    fn within_limit(&self, run: &mut dyn FnMut() -> anyhow::Result<()>) -> anyhow::Result<bool> {
        let (done, waits) = mpsc::channel::<()>();
        std::thread::scope(|scope| {
            let watching = scope.spawn(move || {
                let is_late = waits.recv_timeout(self.limit) == Err(RecvTimeoutError::Timeout);
                if is_late {
                    libtest::end_all();
                }
                is_late
            });
            let ran = run();
            drop(done);
            let was_ended =
                watching.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            ran.map(|()| was_ended)
        })
    }
}

impl Others for OfPackage<'_> {
    fn count(&self) -> usize {
        self.tests.count
    }

    fn judge(&self, candidate: &Candidate) -> Judged {
        self.tests.judge(self.package, candidate).unwrap_or_else(|error| Judged {
            stopped: Some(("tests in Rust".to_owned(), format!("{error:#}"))),
            ..Judged::default()
        })
    }
}
