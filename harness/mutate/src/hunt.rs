//! Runs the tests of a package against mutants.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use karat::Package;
use karat::package::PackageError;
use karat::unstable::diagnostic::{nearest, shown};
use karat::unstable::package::{AcceptedMutants, accepted_mutants, file_of};
use karat::unstable::record::Seen;
use karat::unstable::reflect::{Program, ReflectError};
use karat_suite::{Fault, FindError, Suite, Test, Wrong};
use serde::Serialize;

use crate::lived::{self, Equality, Lived};
use crate::maker::{self, Mutant, Rule};

/// A request to test mutants of a package.
///
/// The tests run in this process, on the path in the settings. Each test runs in a thread with the test's name.
#[derive(Clone, Debug)]
#[must_use = "the hunt tries no mutant until you call `.run()`"]
pub struct Request {
    package: Package,
    only: Vec<String>,
    filter: Option<String>,
    sample: Option<(usize, u64)>,
    lines: Option<BTreeMap<PathBuf, Vec<RangeInclusive<usize>>>>,
    frames: bool,
}

/// A mutant of a package.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// The mutant's id: a hash of the changed lines, the module and the function. The id stays the same if the lines
    /// move.
    pub id: String,
    /// The mutated module.
    pub module: String,
    /// The path of the file that contains the mutated code.
    pub file: PathBuf,
    /// The file's text when Karat read it. The mutation's position refers to this text.
    pub text: Arc<str>,
    /// The mutation.
    pub mutant: Mutant,
}

/// A mutant and its fate.
#[derive(Clone, Debug)]
pub struct Tried {
    /// The mutant.
    pub candidate: Candidate,
    /// The mutant's fate.
    pub fate: Fate,
}

impl Candidate {
    /// The mutated function or constant: `brdf::schlick`, or `schlick` in a package of one file.
    #[must_use]
    pub fn path(&self) -> String {
        path_of(&self.module, &self.mutant.item)
    }
}

/// The fate of a mutant. [`Score::judged`](crate::Score::judged) counts `Killed`, `Lived` and `Untested`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "fate", rename_all = "snake_case")]
pub enum Fate {
    /// A test failed on the mutant.
    Killed {
        /// The test.
        test: String,
    },
    /// All tests that use the mutated code passed.
    Lived {
        /// The number of tests that use the mutated code.
        tests: usize,
        /// A test that saw other values with the mutant and tolerated them. If several tests tolerated the mutant, this
        /// is the test that came closest to failing.
        #[serde(skip_serializing_if = "Option::is_none")]
        hidden: Option<Hidden>,
        /// `true` if Karat knows the compared values of each test that uses the mutated code. Then a `hidden` of `None`
        /// means that no test saw a difference.
        #[serde(skip)]
        seen: bool,
        /// The reason why the mutant lived.
        why: Lived,
    },
    /// No test uses the mutated code.
    Untested {
        /// The result of comparing the mutant with the original.
        why: Lived,
    },
    /// The mutant is equivalent to the original, so no test can fail on the mutant, and Karat ran no test.
    Equal {
        /// The proof that the mutant is equivalent.
        by: Equality,
    },
    /// The mutant isn't valid WGSL, so it proves nothing about the tests.
    Invalid {
        /// The reason.
        reason: String,
    },
    /// The mutant doesn't change the linked text, for example because an `@if` removes the mutated code.
    Idle,
    /// The mutant lives, and `karat.toml` accepts it.
    Accepted {
        /// The reason in `karat.toml`.
        reason: String,
    },
    /// The mutant has no verdict, because Karat can't find the tests that use its code.
    Unknown {
        /// The reason.
        reason: String,
    },
    /// A test ended without a verdict.
    Stopped {
        /// The test.
        test: String,
        /// The reason.
        reason: String,
    },
}

/// A test whose tolerance hides a mutant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Hidden {
    /// The test.
    pub test: String,
    /// The test's largest ratio on the original, and its largest ratio on the mutant.
    pub ratios: [f64; 2],
}

/// The mutants that were tested, with their fates.
#[derive(Clone, Debug)]
pub struct Hunted {
    /// The tested mutants, in the order of their files and lines.
    pub tried: Vec<Tried>,
    /// The number of all requested mutants, from which `tried` is a sample.
    pub of: usize,
    /// The number of the package's tests that ran.
    pub tests: usize,
    /// The number of frame tests that didn't run, because the request doesn't include [`frames`](Request::frames).
    pub left_out: usize,
    /// The modules that are invalid in the original.
    pub invalid: Vec<String>,
    /// A complaint for each mutant that a test kills although `karat.toml` accepts the mutant.
    pub complaints: Vec<String>,
}

/// The reason why Karat tested no mutant.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MutateError {
    /// The package can't be read.
    #[error("{0}")]
    Package(#[from] PackageError),
    /// Karat can't find the package's tests.
    #[error("{0}")]
    Find(#[from] FindError),
    /// Karat can't read a module of the package, or the module has no file.
    #[error("{module}: {reason}")]
    Read {
        /// The module.
        module: String,
        /// The reason.
        reason: String,
    },
    /// Karat can't mutate a package with a `preprocess` program: the program reads files, but mutants exist only in
    /// memory.
    #[error(
        "the program `preprocess` in karat.toml reads modules from files, but mutants exist only in memory: \
         run `karat mutate` on a folder with the program's output"
    )]
    Printed,
    /// `karat.toml` accepts mutants without a reason, without ids, twice, or with an id that no mutant has.
    #[error("{0}")]
    Accepted(String),
    /// The package has no test that could kill a mutant.
    #[error("{0}")]
    NoTest(String),
    /// The request selects no mutant.
    #[error("the package has no mutant{of}, so Karat runs no tests")]
    NoMutant {
        /// The description of the request's selection, for the message.
        of: String,
    },
    /// Tests fail on the original shaders.
    #[error(
        "{} on the original shaders, and would kill every mutant: fix these tests first\n\n{}",
        if wrong.len() == 1 { "1 test fails".to_owned() } else { format!("{} tests fail", wrong.len()) },
        wrong.iter().map(|(test, wrong)| format!("---- {test} ----\n{wrong}")).collect::<Vec<_>>().join("\n\n")
    )]
    Red {
        /// The failing tests, each with its error.
        wrong: Vec<(String, Wrong)>,
    },
}

/// Tests that the package doesn't contain, such as Rust tests. All these tests passed on the original shaders.
pub trait Others: Sync {
    /// The number of the tests.
    fn count(&self) -> usize;

    /// Runs the tests that use the mutated code, until a test fails.
    fn judge(&self, candidate: &Candidate) -> Judged;
}

/// The verdict of [`Others`] on a mutant.
#[derive(Clone, Debug, Default)]
pub struct Judged {
    /// The number of tests that use the mutated code.
    pub concerned: usize,
    /// The test that failed on the mutant; `None` if no test failed.
    pub killed: Option<String>,
    /// A test that saw other values with the mutant and tolerated them.
    pub hidden: Option<Hidden>,
    /// A test that ended without a verdict, with the reason; `None` if each test had a verdict.
    pub stopped: Option<(String, String)>,
}

struct Judge {
    name: String,
    /// The test's linked text; `None` if Karat can't determine this text.
    made_of: Option<String>,
    /// The values that the test's checks compared on the original shaders.
    seen: Seen,
    took: Duration,
}

impl Request {
    /// Creates a request for all mutants of a package.
    pub fn new(package: Package) -> Self {
        let (only, filter, sample, lines) = (Vec::new(), None, None, None);
        Self { package, only, filter, sample, lines, frames: false }
    }

    /// Selects mutants of functions and constants with one of these strings in their names (`brdf::schlick`), and
    /// mutants with one of these ids.
    pub fn only<'n>(self, names: impl IntoIterator<Item = &'n str>) -> Self {
        Self { only: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    /// Selects the tests with this string in their names.
    pub fn tests(self, filter: &str) -> Self {
        Self { filter: Some(filter.to_owned()), ..self }
    }

    /// Selects a random sample of `count` mutants. The same seed gives the same sample.
    pub fn sample(self, count: usize, seed: u64) -> Self {
        Self { sample: Some((count, seed)), ..self }
    }

    /// Selects the mutants that touch these lines of files. Lines count from 1.
    pub fn lines(self, lines: BTreeMap<PathBuf, Vec<RangeInclusive<usize>>>) -> Self {
        Self { lines: Some(lines), ..self }
    }

    /// Also runs tests of frames, which need a path with a driver.
    pub fn frames(self) -> Self {
        Self { frames: true, ..self }
    }

    /// Finds the selected mutants, in the order of modules and positions. Also returns the number of mutants that the
    /// request selects before it takes a sample.
    ///
    /// # Errors
    /// Returns an error if Karat can't read the package.
    pub fn mutants(&self) -> Result<(Vec<Candidate>, usize), MutateError> {
        Ok(self.chosen(self.all()?))
    }

    fn all(&self) -> Result<Vec<Candidate>, MutateError> {
        if self.package.is_printed() {
            return Err(MutateError::Printed);
        }
        let suite = Suite::of(self.package.clone())?;
        let tests: BTreeSet<&str> = suite.tests.iter().map(|test| &*test.name).collect();
        let mut all = Vec::new();
        let mut seen: BTreeMap<String, usize> = BTreeMap::new();
        // Two equal changes of the same function get different ids, because the id includes a counter.
        let mut named = |of: &str, path: &str, [before, after]: [String; 2]| {
            let name = format!("{of}\n{path}\n{before}\n{after}");
            let count = seen.entry(name.clone()).or_default();
            *count += 1;
            let id = blake3::hash(format!("{name}\n{count}").as_bytes()).to_hex();
            id[..8].to_owned()
        };
        for module in self.package.modules()? {
            let unread = |reason: String| MutateError::Read { module: module.clone(), reason };
            let file = file_of(&self.package, &module);
            let file = file
                .ok_or_else(|| unread("the module has no file that could be mutated".to_owned()))?;
            let text = std::fs::read_to_string(&file)
                .map_err(|error| unread(format!("can't read `{}`: {error}", file.display())))?;
            let text: Arc<str> = text.into();
            for mutant in maker::mutants(&text) {
                let path = path_of(&module, &mutant.item);
                // The code of tests isn't mutated.
                if tests.contains(&*path) {
                    continue;
                }
                // Two packages of one file each may contain equal functions.
                let of = if module.is_empty() { self.package.name() } else { module.clone() };
                let id = named(&of, &path, mutant.lines(&text));
                let (module, file, text) = (module.clone(), file.clone(), Arc::clone(&text));
                all.push(Candidate { id, module, file, text, mutant });
            }
        }
        for (module, file) in suite.declared() {
            let text = std::fs::read_to_string(&file).map_err(|error| MutateError::Read {
                module: module.clone(),
                reason: format!("can't read `{}`: {error}", file.display()),
            })?;
            let text: Arc<str> = text.into();
            for mutant in maker::samplers(&text) {
                let path = path_of(&module, &mutant.item);
                let id = named(&format!("{module} tests"), &path, mutant.lines(&text));
                let (module, file, text) = (module.clone(), file.clone(), Arc::clone(&text));
                all.push(Candidate { id, module, file, text, mutant });
            }
        }
        Ok(all)
    }

    fn chosen(&self, mut all: Vec<Candidate>) -> (Vec<Candidate>, usize) {
        all.retain(|one| self.wants(one));
        let of = all.len();
        let Some((count, seed)) = self.sample else { return (all, of) };
        // The key doesn't depend on the mutant's position, so that an added line above doesn't change the sample.
        let key =
            |one: &Candidate| *blake3::hash(format!("{seed} {}", one.id).as_bytes()).as_bytes();
        let mut keyed: Vec<_> = all.into_iter().map(|one| (key(&one), one)).enumerate().collect();
        keyed.sort_by_key(|(_, (key, _))| *key);
        keyed.truncate(count);
        keyed.sort_by_key(|(at, _)| *at);
        (keyed.into_iter().map(|(_, (_, one))| one).collect(), of)
    }

    fn wants(&self, one: &Candidate) -> bool {
        let (path, Candidate { id, file, mutant, .. }) = (one.path(), one);
        let names = |name: &String| path.contains(&**name) || id == name;
        let is_named = self.only.is_empty() || self.only.iter().any(names);
        let lines = mutant.line..=mutant.line + mutant.original.matches('\n').count();
        let is_touched = |own: &Vec<RangeInclusive<usize>>| {
            own.iter().any(|one| one.start() <= lines.end() && lines.start() <= one.end())
        };
        let is_in = |all: &BTreeMap<PathBuf, Vec<_>>| {
            let place = file.canonicalize().unwrap_or_else(|_| file.to_owned());
            all.get(&place).is_some_and(is_touched)
        };
        is_named && self.lines.as_ref().is_none_or(is_in)
    }

    /// Runs the tests on each selected mutant. After each mutant, calls `told` with the mutant's fate, the number of
    /// finished mutants and the number of all mutants.
    ///
    /// # Errors
    /// Returns an error if there is no mutant or no test, or if a test fails on the original shaders.
    pub fn run(&self, told: &(dyn Fn(&Tried, usize, usize) + Sync)) -> Result<Hunted, MutateError> {
        self.run_with(None, told)
    }

    /// Does the same as [`run`](Self::run), and also runs tests that the package doesn't contain.
    ///
    /// # Errors
    /// Returns the same errors as [`run`](Self::run).
    pub fn run_with(
        &self,
        others: Option<&dyn Others>,
        told: &(dyn Fn(&Tried, usize, usize) + Sync),
    ) -> Result<Hunted, MutateError> {
        let all = self.all()?;
        let accepted = self.accepted(&all)?;
        let known: BTreeSet<String> = all.iter().map(Candidate::path).collect();
        let (all, of) = self.chosen(all);
        if all.is_empty() {
            let of = match (&*self.only, &self.lines) {
                ([], None) => String::new(),
                ([], Some(_)) => " in the lines that changed".to_owned(),
                (names, _) => {
                    let near = nearest(&names[0], known.iter().map(String::as_str));
                    let near =
                        near.map_or_else(String::new, |near| format!(" (did you mean `{near}`?)"));
                    format!(" of `{}`{near}", names.join("`, `"))
                }
            };
            return Err(MutateError::NoMutant { of });
        }
        let suite = Suite::of(self.package.clone())?;
        let (judges, left_out) = self.judges(&suite, others)?;
        let (done, count) = (AtomicUsize::new(0), all.len());
        let tried = beside_each_other(&all, &|candidate: &Candidate| {
            let fate = match (self.fate(candidate, &judges, others), accepted.get(&candidate.id)) {
                (Fate::Lived { .. } | Fate::Untested { .. }, Some(reason)) => {
                    Fate::Accepted { reason: reason.clone() }
                }
                (fate, _) => fate,
            };
            let tried = Tried { candidate: candidate.clone(), fate };
            told(&tried, done.fetch_add(1, Ordering::Relaxed) + 1, count);
            tried
        });
        let is_invalid = |module: &String| Program::of_module(&self.package, module).is_err();
        let invalid = self.package.modules()?.into_iter().filter(is_invalid).collect();
        let complaint = |one: &Tried| {
            let (id, fate) = (&one.candidate.id, &one.fate);
            let what = match fate {
                _ if !accepted.contains_key(id) => return None,
                Fate::Accepted { .. } => return None,
                Fate::Killed { test } => format!("`{test}` kills the mutant"),
                _ => "the mutant doesn't count in the score anyway".to_owned(),
            };
            Some(format!("karat.toml accepts the mutant {id}, but {what}: remove this id"))
        };
        let complaints = tried.iter().filter_map(complaint).collect();
        Ok(Hunted { tried, of, tests: judges.len(), left_out, invalid, complaints })
    }

    /// The ids of the mutants that `karat.toml` accepts, each with its reason.
    fn accepted(&self, all: &[Candidate]) -> Result<BTreeMap<String, String>, MutateError> {
        let mut accepted = BTreeMap::new();
        let file = self.package.root().join("karat.toml");
        for AcceptedMutants { ids, reason } in accepted_mutants(&self.package)? {
            if ids.is_empty() {
                let nothing = format!("`{}`: a `[[mutant]]` needs the key `ids`", shown(&file));
                return Err(MutateError::Accepted(nothing));
            }
            for id in ids {
                let wrong = if reason.trim().is_empty() {
                    "is accepted without a reason"
                } else if all.iter().all(|one| one.id != id) {
                    "is accepted, but the package has no mutant with this id: `karat mutate --list` prints all mutants"
                } else if accepted.insert(id.clone(), reason.clone()).is_some() {
                    "is accepted twice"
                } else {
                    continue;
                };
                let wrong = format!("`{}`: the mutant {id} {wrong}", shown(&file));
                return Err(MutateError::Accepted(wrong));
            }
        }
        Ok(accepted)
    }

    /// Returns the tests, and the number of frame tests that don't run. Returns an error if a test fails on the
    /// original shaders.
    fn judges(
        &self,
        suite: &Suite,
        others: Option<&dyn Others>,
    ) -> Result<(Vec<Judge>, usize), MutateError> {
        let is_wanted =
            |test: &&Test| self.filter.as_ref().is_none_or(|filter| test.is_about(filter));
        let (frames, tests): (Vec<&Test>, Vec<&Test>) =
            suite.tests.iter().filter(is_wanted).partition(|test| test.is_frame() && !self.frames);
        let broken = suite.broken.iter().map(|one| (one.name.clone(), one.wrong.clone()));
        let mut wrong: Vec<(String, Wrong)> = broken.collect();
        let run = |test: &&Test| {
            let began = Instant::now();
            let verdict = suite.run_unrecorded(test);
            let (name, made_of) = (test.name.clone(), suite.normalized_text(test));
            let seen = verdict.as_ref().cloned().unwrap_or_default();
            (Judge { name, made_of, seen, took: began.elapsed() }, verdict)
        };
        let ran: Vec<(Judge, Result<Seen, Wrong>)> = beside_each_other(&tests, &run);
        let mut judges = Vec::new();
        for (judge, verdict) in ran {
            match verdict {
                Ok(_) => judges.push(judge),
                Err(why) => wrong.push((judge.name, why)),
            }
        }
        if !wrong.is_empty() {
            return Err(MutateError::Red { wrong });
        }
        if judges.is_empty() && others.is_none_or(|others| others.count() == 0) {
            let why = match (&self.filter, frames.len()) {
                (Some(filter), 0) => format!("no test has `{filter}` in its name"),
                (_, 0) => "the package has no test: `karat init` writes a first test".to_owned(),
                (_, frames) => format!(
                    "the only tests are frames ({frames}), which need a driver: add --paths vulkan"
                ),
            };
            return Err(MutateError::NoTest(format!("there is no test to run: {why}")));
        }
        Ok((judges, frames.len()))
    }

    fn fate(&self, one: &Candidate, judges: &[Judge], others: Option<&dyn Others>) -> Fate {
        let package = self.package.unsaved(&one.file, &one.mutant.applied(&one.text));
        let is_shader = one.mutant.rule != Rule::Sampler;
        if let Some(known) = self.before_tests(one, &package).filter(|_| is_shader) {
            return known;
        }
        let own = match Suite::of(package.clone()) {
            Ok(own) => own,
            Err(error) => return Fate::Unknown { reason: error.to_string() },
        };
        let mut concerned: Vec<(&Judge, &Test)> = Vec::new();
        for judge in judges {
            match own.tests.iter().find(|test| test.name == judge.name) {
                Some(test)
                    if judge.made_of.is_some() && own.normalized_text(test) == judge.made_of => {}
                Some(test) => concerned.push((judge, test)),
                None => {
                    let reason = format!("the mutant removes the test `{}`", judge.name);
                    return Fate::Unknown { reason };
                }
            }
        }
        if concerned.is_empty() {
            match is_shader {
                false => return Fate::without_sampler(),
                true if is_idle(&self.package, &package) => return Fate::Idle,
                true => {}
            }
        }
        // Tests that call the mutated function run first, because they most likely kill the mutant. Faster tests run
        // before slower ones.
        let path = one.path();
        concerned.sort_by_key(|(judge, test)| (!test.is_about(&path), judge.took));
        let (mut stopped, mut hidden) = (None, None);
        for (judge, test) in &concerned {
            let Wrong { fault, headline, .. } = match own.run_unrecorded(test) {
                Err(wrong) => wrong,
                Ok(seen) => {
                    let ratios = [judge.seen.ratio, seen.ratio];
                    let changes = (seen.values != judge.seen.values)
                        .then(|| Hidden { test: judge.name.clone(), ratios });
                    hidden = Hidden::nearest(hidden, changes);
                    continue;
                }
            };
            match fault {
                Fault::Values | Fault::Violations(_) | Fault::Vacuous | Fault::Declaration => {
                    return Fate::Killed { test: judge.name.clone() };
                }
                Fault::Unbegun => {
                    stopped = stopped.or(Some((judge.name.clone(), headline)));
                }
            }
        }
        let others = others.filter(|_| is_shader).map(|others| others.judge(one));
        let others = others.unwrap_or_default();
        if let Some(test) = others.killed {
            return Fate::Killed { test };
        }
        let tests = concerned.len() + others.concerned;
        match stopped.or(others.stopped) {
            // A mutated constant may make another module invalid, although its own module stays valid.
            Some((test, reason)) => match self.broken_by(&package) {
                Some(reason) => Fate::Invalid { reason },
                None => Fate::Stopped { test, reason },
            },
            None => {
                let why = lived::why(&self.package, &package, one);
                let hidden = Hidden::nearest(hidden, others.hidden);
                let seen = concerned.iter().all(|(_, test)| test.shows_values());
                match tests {
                    0 => Fate::Untested { why },
                    _ => Fate::Lived { tests, hidden, seen, why },
                }
            }
        }
    }

    /// The fate of a mutant that needs no test, because the mutant is invalid or equivalent to the original.
    fn before_tests(&self, one: &Candidate, package: &Package) -> Option<Fate> {
        let Candidate { module, mutant, .. } = one;
        // If the original module is invalid, only the mutated item must be valid.
        let linked = match Program::of_module(&self.package, module).is_ok() {
            true => Program::of_module(package, module),
            false => Program::of_items(package, module, &[&mutant.item]),
        };
        if let Err(error) = linked {
            return Some(Fate::Invalid { reason: reason(&error) });
        }
        lived::equality(&self.package, package, one).map(|by| Fate::Equal { by })
    }

    /// The first error of a module that is valid in the original and invalid in the mutant.
    fn broken_by(&self, mutant: &Package) -> Option<String> {
        let modules = self.package.modules().ok()?;
        let mut broken = modules.iter().filter_map(|module| {
            let error = Program::of_module(mutant, module).err()?;
            Program::of_module(&self.package, module).is_ok().then(|| reason(&error))
        });
        broken.next()
    }
}

impl Fate {
    fn without_sampler() -> Self {
        Self::Unknown { reason: "no test that ran uses this sampler".to_owned() }
    }
}

impl Hidden {
    /// Selects the test that came closer to failing on the mutant.
    #[must_use]
    pub fn nearest(one: Option<Self>, other: Option<Self>) -> Option<Self> {
        let all = one.into_iter().chain(other);
        all.max_by(|a, b| a.ratios[1].total_cmp(&b.ratios[1]))
    }
}

fn reason(error: &ReflectError) -> String {
    error.diagnostic().map_or_else(|| error.to_string(), |found| found.message.clone())
}

/// Runs a function for each element, on all cores. The threads aren't in Rayon's pool, because each test waits for
/// checks that run in this pool.
fn beside_each_other<T: Sync, R: Send>(all: &[T], run: &(dyn Fn(&T) -> R + Sync)) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let work = || {
        let mut done = Vec::new();
        while let Some((at, one)) =
            Some(next.fetch_add(1, Ordering::Relaxed)).and_then(|at| Some((at, all.get(at)?)))
        {
            done.push((at, run(one)));
        }
        done
    };
    let mut done: Vec<(usize, R)> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        let join = |thread: std::thread::ScopedJoinHandle<'_, Vec<(usize, R)>>| {
            thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        };
        threads.into_iter().flat_map(join).collect()
    });
    done.sort_by_key(|(at, _)| *at);
    done.into_iter().map(|(_, result)| result).collect()
}

/// Checks if each linked function of the package has the same text in the original and in the mutant.
fn is_idle(original: &Package, mutant: &Package) -> bool {
    let Ok(functions) = original.functions() else { return false };
    let names: BTreeSet<String> = functions.into_iter().map(|item| item.name).collect();
    let known = original.fingerprints(&names);
    !known.is_empty() && known == mutant.fingerprints(&names)
}

/// The path of an item: `brdf::schlick`, or `schlick` in a package of one file.
fn path_of(module: &str, item: &str) -> String {
    if module.is_empty() { item.to_owned() } else { format!("{module}::{item}") }
}
