//! Gives mutants to the tests of a package.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use karat::Package;
use karat::package::PackageError;
use karat::unstable::package::{FunctionItem, file_of};
use karat::unstable::reflect::Program;
use karat_suite::{Fault, FindError, Suite, Test, Wrong};
use serde::Serialize;

use crate::lived::{self, Lived};
use crate::maker::{self, Mutant};

/// Mutants that are to be tried.
///
/// Tests run in this process, on the path that settings name. Names of threads are those of tests.
#[derive(Clone, Debug)]
#[must_use = "nothing is tried until `.run()`"]
pub struct Request {
    package: Package,
    only: Vec<String>,
    filter: Option<String>,
    sample: Option<(usize, u64)>,
    lines: Option<BTreeMap<PathBuf, Vec<RangeInclusive<usize>>>>,
    frames: bool,
}

/// A mutant, and what became of it.
#[derive(Clone, Debug)]
pub struct Tried {
    /// A name that stays while its lines do, wherever they move.
    pub id: String,
    /// The module.
    pub module: String,
    /// The author's file.
    pub file: PathBuf,
    /// The slip.
    pub mutant: Mutant,
    /// What became of it.
    pub fate: Fate,
}

/// What became of a mutant.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "fate", rename_all = "snake_case")]
pub enum Fate {
    /// A test failed for it.
    Killed {
        /// The test.
        test: String,
    },
    /// All tests that are made of it passed.
    Lived {
        /// How many there are.
        tests: usize,
        /// Why it lived.
        why: Lived,
    },
    /// No test is made of it.
    Untested {
        /// What a test would see.
        why: Lived,
    },
    /// It is no valid WGSL, which shows nothing of the tests.
    Invalid {
        /// Why not.
        reason: String,
    },
    /// It changes nothing that is linked, such as text under a condition that doesn't hold.
    Idle,
    /// A test ended without a verdict.
    Stopped {
        /// The test.
        test: String,
        /// Why.
        reason: String,
    },
}

/// All mutants that were tried.
#[derive(Clone, Debug)]
pub struct Hunted {
    /// In the order of their files and lines.
    pub tried: Vec<Tried>,
    /// Mutants that there are, a sample of which was tried.
    pub of: usize,
    /// Tests that ran.
    pub tests: usize,
    /// Frames, which a path without a driver doesn't draw.
    pub left_out: usize,
}

/// Why no mutant was tried.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MutateError {
    /// The package can't be read.
    #[error("{0}")]
    Package(#[from] PackageError),
    /// Its tests can't be looked for.
    #[error("{0}")]
    Find(#[from] FindError),
    /// A file of the package can't be read.
    #[error("can't read `{}`: {cause}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Why not.
        cause: std::io::Error,
    },
    /// There is nothing that could kill a mutant.
    #[error("there is no test, so nothing could kill a mutant: `karat init` writes a first one")]
    NoTest,
    /// There is nothing to change.
    #[error("there is no mutant{of}: nothing would be judged")]
    NoMutant {
        /// Of what.
        of: String,
    },
    /// Tests fail as the shaders are.
    #[error(
        "{} fail without a mutant, so they would kill each: mend them first\n\n{}",
        if wrong.len() == 1 { "1 test".to_owned() } else { format!("{} tests", wrong.len()) },
        wrong.iter().map(|(test, wrong)| format!("---- {test} ----\n{wrong}")).collect::<Vec<_>>().join("\n\n")
    )]
    Red {
        /// Each with what is wrong.
        wrong: Vec<(String, Wrong)>,
    },
}

/// A test, what it is made of, and how long it takes.
struct Judge {
    name: String,
    /// `None` where nobody can tell.
    made_of: Option<String>,
    took: Duration,
}

impl Request {
    /// All mutants of a package.
    pub fn new(package: Package) -> Self {
        let (only, filter, sample, lines) = (Vec::new(), None, None, None);
        Self { package, only, filter, sample, lines, frames: false }
    }

    /// Only mutants of functions and constants whose names contain one of these: `brdf::schlick`.
    pub fn only<'n>(self, names: impl IntoIterator<Item = &'n str>) -> Self {
        Self { only: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    /// Only tests whose names contain this.
    pub fn tests(self, filter: &str) -> Self {
        Self { filter: Some(filter.to_owned()), ..self }
    }

    /// A sample of so many mutants, by a seed.
    pub fn sample(self, count: usize, seed: u64) -> Self {
        Self { sample: Some((count, seed)), ..self }
    }

    /// Only mutants that touch these lines, from 1, of files.
    pub fn lines(self, lines: BTreeMap<PathBuf, Vec<RangeInclusive<usize>>>) -> Self {
        Self { lines: Some(lines), ..self }
    }

    /// Frames judge, too: the path has a driver.
    pub fn frames(self) -> Self {
        Self { frames: true, ..self }
    }

    /// The mutants that there are, in the order of modules and places, and how many there are before a sample is taken.
    ///
    /// # Errors
    /// If the package can't be read.
    pub fn mutants(&self) -> Result<(Vec<Tried>, usize), MutateError> {
        let suite = Suite::of(self.package.clone())?;
        let tests: BTreeSet<&str> = suite.tests.iter().map(|test| &*test.name).collect();
        let mut all = Vec::new();
        for module in self.package.modules()? {
            // What can't be parsed has no mutants; the tests say why.
            let Some(file) = file_of(&self.package, &module) else { continue };
            let text = std::fs::read_to_string(&file)
                .map_err(|cause| MutateError::Read { file: file.clone(), cause })?;
            let mut seen: BTreeMap<String, usize> = BTreeMap::new();
            for mutant in maker::mutants(&text) {
                let path = path_of(&module, &mutant.item);
                // The tests themselves aren't what is judged.
                if tests.contains(&*path) || !self.wants(&path, &file, &mutant) {
                    continue;
                }
                let [before, after] = mutant.lines(&text);
                let name = format!("{path}\n{before}\n{after}");
                let count = seen.entry(name.clone()).or_default();
                *count += 1;
                let id = blake3::hash(format!("{name}\n{count}").as_bytes()).to_hex();
                let (id, module) = (id[..8].to_owned(), module.clone());
                all.push(Tried { id, module, file: file.clone(), mutant, fate: Fate::Idle });
            }
        }
        let of = all.len();
        if let Some((count, seed)) = self.sample {
            // By what changes and not by where: a line more above is no other sample.
            let key =
                |one: &Tried| *blake3::hash(format!("{seed} {}", one.id).as_bytes()).as_bytes();
            let mut keys: Vec<_> = all.iter().map(key).collect();
            keys.sort_unstable();
            keys.truncate(count);
            let last = keys.last().copied();
            all.retain(|one| last.is_some_and(|last| key(one) <= last));
        }
        Ok((all, of))
    }

    fn wants(&self, path: &str, file: &Path, mutant: &Mutant) -> bool {
        let is_named = self.only.is_empty() || self.only.iter().any(|name| path.contains(&**name));
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

    /// Tries them; each is told as soon as its fate is known, with how many are done, and of how many.
    ///
    /// # Errors
    /// If there is nothing to try, or a test fails without a mutant.
    pub fn run(&self, told: &(dyn Fn(&Tried, usize, usize) + Sync)) -> Result<Hunted, MutateError> {
        let (mut all, of) = self.mutants()?;
        let suite = Suite::of(self.package.clone())?;
        let (judges, left_out) = self.judges(&suite)?;
        if all.is_empty() {
            let of = match (&*self.only, &self.lines) {
                ([], None) => String::new(),
                ([], Some(_)) => " in the lines that changed".to_owned(),
                (names, _) => format!(" of `{}`", names.join("`, `")),
            };
            return Err(MutateError::NoMutant { of });
        }
        let (done, count) = (AtomicUsize::new(0), all.len());
        let fates = beside_each_other(&all, &|one: &Tried| {
            let tried = Tried { fate: self.fate(one, &judges), ..one.clone() };
            told(&tried, done.fetch_add(1, Ordering::Relaxed) + 1, count);
            tried.fate
        });
        all.iter_mut().zip(fates).for_each(|(one, fate)| one.fate = fate);
        Ok(Hunted { tried: all, of, tests: judges.len(), left_out })
    }

    /// The tests, once all have passed, and how many frames are left out.
    fn judges(&self, suite: &Suite) -> Result<(Vec<Judge>, usize), MutateError> {
        let is_wanted =
            |test: &&Test| self.filter.as_ref().is_none_or(|filter| test.is_about(filter));
        let (frames, tests): (Vec<&Test>, Vec<&Test>) =
            suite.tests.iter().filter(is_wanted).partition(|test| test.is_frame() && !self.frames);
        let broken = suite.broken.iter().map(|one| (one.name.clone(), one.wrong.clone()));
        let mut wrong: Vec<(String, Wrong)> = broken.collect();
        let run = |test: &&Test| {
            let began = Instant::now();
            let verdict = suite.run(test);
            let (name, made_of) = (test.name.clone(), suite.normalized_text(test));
            (Judge { name, made_of, took: began.elapsed() }, verdict)
        };
        let ran: Vec<(Judge, Result<(), Wrong>)> = beside_each_other(&tests, &run);
        let mut judges = Vec::new();
        for (judge, verdict) in ran {
            match verdict {
                Ok(()) => judges.push(judge),
                Err(why) => wrong.push((judge.name, why)),
            }
        }
        if !wrong.is_empty() {
            return Err(MutateError::Red { wrong });
        }
        if judges.is_empty() {
            return Err(MutateError::NoTest);
        }
        Ok((judges, frames.len()))
    }

    /// What becomes of a mutant.
    fn fate(&self, one: &Tried, judges: &[Judge]) -> Fate {
        let Tried { module, file, mutant, .. } = one;
        let text = match std::fs::read_to_string(file) {
            Ok(text) => mutant.applied(&text),
            Err(error) => return Fate::Invalid { reason: error.to_string() },
        };
        let package = self.package.unsaved(file, &text);
        if let Err(error) = Program::of_module(&package, module) {
            // A module that isn't valid without the slip, either, has functions that are.
            let path = path_of(module, &mutant.item);
            let alone = |package: &Package| Program::of_function(package, &path).is_ok();
            if Program::of_module(&self.package, module).is_ok() || !alone(&package) {
                let reason = error
                    .diagnostic()
                    .map_or_else(|| error.to_string(), |found| found.message.clone());
                return Fate::Invalid { reason };
            }
        }
        let own = match Suite::of(package.clone()) {
            Ok(own) => own,
            Err(error) => return Fate::Invalid { reason: error.to_string() },
        };
        let mut concerned: Vec<(&Judge, &Test)> = Vec::new();
        for judge in judges {
            let Some(test) = own.tests.iter().find(|test| test.name == judge.name) else {
                continue;
            };
            if judge.made_of.is_none() || own.normalized_text(test) != judge.made_of {
                concerned.push((judge, test));
            }
        }
        if concerned.is_empty() {
            if is_idle(&self.package, &package, module) {
                return Fate::Idle;
            }
            return Fate::Untested {
                why: lived::why(&self.package, &package, module, &mutant.item),
            };
        }
        // What calls the function itself is the likeliest to see it, and then what is quick.
        let path = path_of(module, &mutant.item);
        concerned.sort_by_key(|(judge, test)| (!test.is_about(&path), judge.took));
        let mut stopped = None;
        for (judge, test) in &concerned {
            let Err(Wrong { fault, headline, .. }) = own.run(test) else { continue };
            match fault {
                Fault::Values | Fault::Violations(_) => {
                    return Fate::Killed { test: judge.name.clone() };
                }
                Fault::Unbegun => {
                    stopped = stopped.or(Some((judge.name.clone(), headline)));
                }
            }
        }
        if let Some((test, reason)) = stopped {
            return Fate::Stopped { test, reason };
        }
        let why = lived::why(&self.package, &package, module, &mutant.item);
        Fate::Lived { tests: concerned.len(), why }
    }
}

/// What comes of each, on all cores. A test has a thread of its own, and its checks use the pool that Rayon has: a thread of
/// that pool can't wait for one.
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

/// Whether no function of a module is another one: all that is linked is the same.
fn is_idle(original: &Package, mutant: &Package, module: &str) -> bool {
    let functions = original.functions_in(module).unwrap_or_default();
    let names: BTreeSet<String> =
        functions.into_iter().map(|item: FunctionItem| item.name).collect();
    let known = original.fingerprints(&names);
    !known.is_empty() && known == mutant.fingerprints(&names)
}

/// `brdf::schlick`; in a package of one file the name alone.
fn path_of(module: &str, item: &str) -> String {
    if module.is_empty() { item.to_owned() } else { format!("{module}::{item}") }
}
