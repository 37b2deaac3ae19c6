//! Rust tests that judge mutants. The test programs run without Cargo, and read the mutant from an overlay.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::Path;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use karat::Package;
use karat::unstable::output::tell;
use karat::unstable::record::{self, PathRecord, Record, Subject, Verdict};
use karat::unstable::reflect::Dependence;
use karat_mutate::{Candidate, Hidden, Judged, Others};

use super::super::suite::cargo::libtest;
use super::super::suite::cargo::programs::{Programs, TestProgram};

/// The smallest time limit of a test program with a mutant. A test program usually needs far less time, but other
/// programs may slow it down.
const LEAST: Duration = Duration::from_secs(20);
const MANY: u32 = 10;

/// The longest time that the checks of a fast test take. Slower tests run last, in a second process of the test
/// program. This process needs only a few hundredths of a second to start.
const QUICK: Duration = Duration::from_millis(200);

pub(super) struct RustTests {
    programs: Programs,
    /// The shader programs that tests link. Each program has the displayed names of the tests that link it.
    made: Vec<(Dependence, BTreeSet<String>)>,
    pub(super) count: usize,
    /// Tests with slow checks. They run last.
    slow: BTreeSet<String>,
    /// Tests that check a function directly, by the name of the function: `brdf::schlick`. They run first.
    direct: BTreeMap<String, BTreeSet<String>>,
    /// The results of each test's checks without a mutant, by the displayed name of the test.
    found: BTreeMap<String, Vec<PathRecord>>,
    /// The time limit of a test program with a mutant.
    limit: Duration,
    /// Tests that fail without a mutant, although none of their checks fails. An example is a test that draws a frame
    /// on the path `cpu`. Such tests can't judge mutants.
    pub(super) unfit: Vec<String>,
    /// The lock that lets only one test program run at a time, because each test program uses all cores.
    turn: Mutex<()>,
}

/// The tests of a project that use the shaders of a package.
pub(super) struct OfPackage<'t> {
    pub(super) tests: &'t RustTests,
    pub(super) package: &'t Package,
}

impl RustTests {
    /// Builds the tests of some or all Cargo packages, and runs each test once. Returns an error if a check fails
    /// without a mutant.
    pub(super) fn of(
        root: &Path,
        packages: &[String],
        filter: Option<&str>,
    ) -> anyhow::Result<Self> {
        tell("Karat builds the Rust tests, and runs each test once");
        let (mut slowest, mut slow) = (Duration::ZERO, BTreeSet::new());
        let mut found: BTreeMap<String, Vec<PathRecord>> = BTreeMap::new();
        let mut direct: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
        let mut programs = Programs::of(root).only(packages);
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
            let folder = tempfile::tempdir().context("can't make a temporary folder")?;
            let mut failed: Vec<(String, String)> = Vec::new();
            let began = Instant::now();
            libtest::run(program, &tests, (folder.path(), None), &mut |test, message| {
                failed.extend(message.map(|message| (test.to_owned(), message)));
                Ok(())
            })?;
            slowest = slowest.max(began.elapsed());
            let records = record::read(folder.path())?;
            let mut seconds: BTreeMap<&str, f64> = BTreeMap::new();
            for one in &records {
                let own = one.time.as_ref().map_or(0.0, |time| time.seconds);
                *seconds.entry(&*one.test).or_default() += own;
            }
            for one in &records {
                let test = program.show(&one.test);
                if let Subject::Function { function, .. } = &one.subject {
                    direct.entry(function.clone()).or_default().insert(test.clone());
                }
                found.entry(test).or_default().extend(one.paths.iter().cloned());
            }
            let is_slow = |own: &(&str, f64)| own.1 > QUICK.as_secs_f64();
            slow.extend(seconds.into_iter().filter(is_slow).map(|(test, _)| program.show(test)));
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
            let all = Dependence::all(folder.path())
                .context("can't read the list of shaders that the tests linked")?;
            // A thread without a test's name may have linked the shaders for any test of its test program.
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
                "a test that fails without a mutant would kill each mutant, so correct this test first: `{test}`{more}\n\n{}",
                message.trim_end()
            );
        }
        unfit.sort();
        let (made, count) = (made.into_values().collect(), judges.len());
        let limit = LEAST + MANY * slowest;
        Ok(Self {
            programs,
            made,
            count,
            slow,
            direct,
            found,
            limit,
            unfit,
            turn: Mutex::default(),
        })
    }

    fn judge(&self, package: &Package, candidate: &Candidate) -> anyhow::Result<Judged> {
        let text = candidate.mutant.applied(&candidate.text);
        let scratch = tempfile::tempdir().context("can't make a temporary folder")?;
        let (overlay, records) = (scratch.path().join("overlay"), scratch.path().join("record"));
        write_overlay(&overlay, package, candidate, &text)?;
        // Text in memory isn't a file, so an overlay can't replace it.
        let changes = |(one, _): &&(Dependence, BTreeSet<String>)| {
            one.may_declare(&candidate.path())
                && one.is_current_with(&candidate.file, &text) == Some(false)
        };
        let users: BTreeSet<&String> =
            self.made.iter().filter(changes).flat_map(|(_, users)| users).collect();
        let mut judged = Judged::default();
        // Tests that are likely to kill the mutant run first, and slow tests run last.
        let direct = self.direct.get(&candidate.path());
        let round_of = |test: &String| match direct.is_some_and(|direct| direct.contains(test)) {
            true => 0,
            false => 1 + usize::from(self.slow.contains(test)),
        };
        let programs = |round| self.programs.all().map(move |one| (round, one));
        for (round, program) in (0..3).flat_map(programs) {
            let is_user = |test: &&str| {
                let name = program.show(test);
                users.contains(&name) && round_of(&name) == round
            };
            let concerned: Vec<&str> =
                program.tests.iter().map(String::as_str).filter(is_user).collect();
            if concerned.is_empty() {
                continue;
            }
            judged.concerned += concerned.len();
            let own = records.join(format!("{}-{round}", judged.concerned));
            std::fs::create_dir_all(&own)?;
            let mut failed: Vec<(String, String)> = Vec::new();
            // A failing check is recorded before its test ends.
            let is_kill = |test: &str| {
                let records = record::read(&own).unwrap_or_default();
                records.iter().any(|one| one.test == test && one.verdict == Verdict::Fail)
            };
            let mut killed = None;
            let turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
            let was_ended = self.within_limit(&mut || {
                let heard = &mut |test: &str, message: Option<String>| {
                    failed.extend(message.map(|message| (test.to_owned(), message)));
                    Ok(())
                };
                let ends = &mut |test: &str| {
                    killed = killed.take().or_else(|| is_kill(test).then(|| program.show(test)));
                    killed.is_some()
                };
                libtest::run_until(program, &concerned, (&own, Some(&overlay)), heard, ends)
                    .map(drop)
            })?;
            drop(turn);
            if killed.is_some() {
                return Ok(Judged { killed, ..judged });
            }
            if was_ended {
                let seconds = self.limit.as_secs();
                let reason = format!("Karat ended the test after {seconds} s");
                judged.stopped = Some((program.show(concerned[0]), reason));
                continue;
            }
            let records = record::read(&own)?;
            judged.hidden = Hidden::nearest(judged.hidden.take(), self.hidden(program, &records));
            for (test, message) in failed {
                let verdicts = records.iter().filter(|one| one.test == test).map(|one| one.verdict);
                let verdicts: Vec<Verdict> = verdicts.collect();
                let name = program.show(&test);
                // If Karat reports no error, a check or another assertion of the test failed.
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
    /// Returns a test whose checks measure different errors with and without the mutant, or `None` if there is none.
    fn hidden(&self, program: &TestProgram, records: &[Record]) -> Option<Hidden> {
        let mut own: BTreeMap<&str, Vec<&PathRecord>> = BTreeMap::new();
        for one in records {
            own.entry(&one.test).or_default().extend(&one.paths);
        }
        let worst = |paths: &mut dyn Iterator<Item = &PathRecord>| {
            paths.filter_map(|path| path.ratio).fold(0.0, f64::max)
        };
        let of = |(test, paths): (&str, Vec<&PathRecord>)| {
            let test = program.show(test);
            let before = self.found.get(&test)?;
            let told = |path: &PathRecord| (path.worst.clone(), path.errors.clone());
            let is_other = before.len() == paths.len()
                && before.iter().zip(&paths).any(|(a, b)| told(a) != told(b));
            let ratios = [worst(&mut before.iter()), worst(&mut paths.into_iter())];
            is_other.then_some(Hidden { test, ratios })
        };
        own.into_iter().filter_map(of).fold(None, |known, one| Hidden::nearest(known, Some(one)))
    }

    /// Runs a program, and ends it after the time limit: a test may wait forever for the result of a mutant.
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

/// Writes the text of a module into an overlay, in which each package has its own folder.
fn write_overlay(
    overlay: &Path,
    package: &Package,
    candidate: &Candidate,
    text: &str,
) -> anyhow::Result<()> {
    let root = package.root();
    let below = match root.is_file() {
        true => root.file_name().map(Path::new).unwrap_or(&root).to_owned(),
        false => Path::new(&package.name()).join(candidate.file.strip_prefix(&root)?),
    };
    let file = overlay.join(below);
    std::fs::create_dir_all(file.parent().unwrap_or(overlay))?;
    Ok(std::fs::write(&file, text)?)
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
