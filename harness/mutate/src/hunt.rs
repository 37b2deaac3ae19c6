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

/// A request to try mutants.
///
/// Tests run in this process, on the path of the settings. Each runs in a thread with its name.
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

/// A mutant of a package.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// A name that depends only on the changed lines, wherever they move.
    pub id: String,
    /// The module.
    pub module: String,
    /// The author's file.
    pub file: PathBuf,
    /// The text as it was read. The place of the mutation refers to this text.
    pub text: Arc<str>,
    /// The mutation.
    pub mutant: Mutant,
}

/// A mutant with its fate.
#[derive(Clone, Debug)]
pub struct Tried {
    /// The mutant.
    pub candidate: Candidate,
    /// Its fate.
    pub fate: Fate,
}

impl Candidate {
    /// The function or constant: `brdf::schlick`; in a package of one file, its name alone.
    #[must_use]
    pub fn path(&self) -> String {
        path_of(&self.module, &self.mutant.item)
    }
}

/// The fate of a mutant: killed, alive, or not counted.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "fate", rename_all = "snake_case")]
pub enum Fate {
    /// A test failed for it.
    Killed {
        /// The test.
        test: String,
    },
    /// All tests that use it passed.
    Lived {
        /// The number of these tests.
        tests: usize,
        /// The test that sees other values with the mutant, and allows them; of several, the one closest to failing.
        #[serde(skip_serializing_if = "Option::is_none")]
        hidden: Option<Hidden>,
        /// `true` if all of these tests show the values that they compare: none of them saw a difference, unless one hides it.
        #[serde(skip)]
        seen: bool,
        /// The reason why it lived.
        why: Lived,
    },
    /// No test uses it.
    Untested {
        /// The difference that a test could see.
        why: Lived,
    },
    /// It is equivalent to the original, so no test can see it, and none ran.
    Equal {
        /// The proof.
        by: Equality,
    },
    /// It isn't valid WGSL, so it proves nothing about the tests.
    Invalid {
        /// The reason.
        reason: String,
    },
    /// It doesn't change the linked text, for example because a condition leaves the code out.
    Idle,
    /// It lives, and `karat.toml` accepts that.
    Accepted {
        /// The reason.
        reason: String,
    },
    /// It has no verdict, because its tests can't be found.
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

/// A test with a tolerance that hides a mutant.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Hidden {
    /// The test.
    pub test: String,
    /// Its largest error divided by the bound: without the mutant, and with it.
    pub ratios: [f64; 2],
}

/// All mutants that were tried.
#[derive(Clone, Debug)]
pub struct Hunted {
    /// In the order of their files and lines.
    pub tried: Vec<Tried>,
    /// The number of all mutants. A sample of them was tried.
    pub of: usize,
    /// The number of tests of the package that ran.
    pub tests: usize,
    /// The number of frames left out, because the path has no driver to draw them.
    pub left_out: usize,
    /// Modules that are invalid without a mutant.
    pub invalid: Vec<String>,
    /// Acceptances in `karat.toml` that don't apply to a mutant, each as a sentence.
    pub complaints: Vec<String>,
}

/// The reason why no mutant was tried.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MutateError {
    /// The package can't be read.
    #[error("{0}")]
    Package(#[from] PackageError),
    /// The search for its tests failed.
    #[error("{0}")]
    Find(#[from] FindError),
    /// A module of the package can't be read, or has no file.
    #[error("{module}: {reason}")]
    Read {
        /// The module.
        module: String,
        /// The reason.
        reason: String,
    },
    /// A program prints the modules, so mutants in memory would never reach them.
    #[error(
        "`preprocess` in karat.toml prints these modules from their files, and mutants are texts that aren't saved: mutate a \
         folder of what it prints"
    )]
    Printed,
    /// An acceptance in `karat.toml` doesn't apply to a mutant.
    #[error("{0}")]
    Accepted(String),
    /// There is no test that could kill a mutant.
    #[error("{0}")]
    NoTest(String),
    /// There is no mutant.
    #[error("there is no mutant{of}: nothing would be judged")]
    NoMutant {
        /// The place that has no mutant.
        of: String,
    },
    /// Tests fail on the original shaders.
    #[error(
        "{} without a mutant, and would kill each: mend them first\n\n{}",
        if wrong.len() == 1 { "1 test fails".to_owned() } else { format!("{} tests fail", wrong.len()) },
        wrong.iter().map(|(test, wrong)| format!("---- {test} ----\n{wrong}")).collect::<Vec<_>>().join("\n\n")
    )]
    Red {
        /// The failing tests, each with its error.
        wrong: Vec<(String, Wrong)>,
    },
}

/// Tests that run elsewhere, such as Rust's, beside those of the package. All have passed without a mutant.
pub trait Others: Sync {
    /// The number of these tests.
    fn count(&self) -> usize;

    /// Runs the tests that use the changed code, until one fails.
    fn judge(&self, candidate: &Candidate) -> Judged;
}

/// The verdict of the other tests on a mutant.
#[derive(Clone, Debug, Default)]
pub struct Judged {
    /// The number of tests that use the changed code.
    pub concerned: usize,
    /// The test that failed.
    pub killed: Option<String>,
    /// The test that allows other values.
    pub hidden: Option<Hidden>,
    /// A test that ended without a verdict, and the reason.
    pub stopped: Option<(String, String)>,
}

/// A test, the text that it links, and its duration.
struct Judge {
    name: String,
    /// The linked text; `None` if it can't be found.
    made_of: Option<String>,
    /// The values that its checks see without a mutant.
    seen: Seen,
    took: Duration,
}

impl Request {
    /// All mutants of a package.
    pub fn new(package: Package) -> Self {
        let (only, filter, sample, lines) = (Vec::new(), None, None, None);
        Self { package, only, filter, sample, lines, frames: false }
    }

    /// Restricts the mutants to functions and constants whose names contain one of these (`brdf::schlick`), and to
    /// mutants with these ids.
    pub fn only<'n>(self, names: impl IntoIterator<Item = &'n str>) -> Self {
        Self { only: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    /// Restricts the tests to those whose names contain this.
    pub fn tests(self, filter: &str) -> Self {
        Self { filter: Some(filter.to_owned()), ..self }
    }

    /// Takes a random sample of so many mutants, by a seed.
    pub fn sample(self, count: usize, seed: u64) -> Self {
        Self { sample: Some((count, seed)), ..self }
    }

    /// Restricts the mutants to those that touch these lines of files, counted from 1.
    pub fn lines(self, lines: BTreeMap<PathBuf, Vec<RangeInclusive<usize>>>) -> Self {
        Self { lines: Some(lines), ..self }
    }

    /// Also runs frames. The path needs a driver.
    pub fn frames(self) -> Self {
        Self { frames: true, ..self }
    }

    /// The mutants, in the order of modules and places, and their number before a sample is taken.
    ///
    /// # Errors
    /// If the package can't be read.
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
        // Equal lines get different ids, by their order.
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
            let file = file.ok_or_else(|| unread("it has no file to be changed".to_owned()))?;
            let text = std::fs::read_to_string(&file)
                .map_err(|error| unread(format!("can't read `{}`: {error}", file.display())))?;
            let text: Arc<str> = text.into();
            for mutant in maker::mutants(&text) {
                let path = path_of(&module, &mutant.item);
                // Tests themselves aren't mutated.
                if tests.contains(&*path) {
                    continue;
                }
                // Two packages of one file each may have the same functions.
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

    /// The requested mutants, and their number before a sample is taken.
    fn chosen(&self, mut all: Vec<Candidate>) -> (Vec<Candidate>, usize) {
        all.retain(|one| self.wants(one));
        let of = all.len();
        let Some((count, seed)) = self.sample else { return (all, of) };
        // The key depends on the change and not on its place, so that lines added above don't change the sample.
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

    /// Tries the mutants. `told` receives each one as soon as its fate is known, with the number of those done and of
    /// all.
    ///
    /// # Errors
    /// If there is nothing to try, or a test fails without a mutant.
    pub fn run(&self, told: &(dyn Fn(&Tried, usize, usize) + Sync)) -> Result<Hunted, MutateError> {
        self.run_with(None, told)
    }

    /// Does the same as [`run`](Self::run), with other tests beside the package's own.
    ///
    /// # Errors
    /// As [`run`](Self::run).
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
                Fate::Killed { test } => format!("`{test}` kills it"),
                _ => "it isn't in the score anyway".to_owned(),
            };
            Some(format!("karat.toml accepts the mutant {id}, and {what}: take it out"))
        };
        let complaints = tried.iter().filter_map(complaint).collect();
        Ok(Hunted { tried, of, tests: judges.len(), left_out, invalid, complaints })
    }

    /// The mutants that `karat.toml` accepts, each with its reason.
    fn accepted(&self, all: &[Candidate]) -> Result<BTreeMap<String, String>, MutateError> {
        let mut accepted = BTreeMap::new();
        let file = self.package.root().join("karat.toml");
        for AcceptedMutants { ids, reason } in accepted_mutants(&self.package)? {
            if ids.is_empty() {
                let nothing = format!("`{}`: a `[[mutant]]` has no `ids`", shown(&file));
                return Err(MutateError::Accepted(nothing));
            }
            for id in ids {
                let wrong = if reason.trim().is_empty() {
                    "is accepted without a reason"
                } else if all.iter().all(|one| one.id != id) {
                    "is accepted, and there is none: `karat mutate --list` names all"
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

    /// The tests, after all of them have passed, and the number of frames left out.
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
                (_, 0) => "there is no test: `karat init` writes a first one".to_owned(),
                (_, frames) => format!(
                    "the only tests are frames ({frames}), which need a driver: --paths vulkan draws them"
                ),
            };
            return Err(MutateError::NoTest(format!("{why}; nothing could kill a mutant")));
        }
        Ok((judges, frames.len()))
    }

    /// Runs tests on a mutant until one kills it.
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
                    let reason = format!("`{}` is gone with it", judge.name);
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
        // Tests that call the function itself come first, as they kill most likely; then the quicker ones.
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
            // A mutated constant may leave its own module valid and make another one invalid.
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

    /// The fate of a mutant that needs no test: it is invalid, or equivalent to the original.
    fn before_tests(&self, one: &Candidate, package: &Package) -> Option<Fate> {
        let Candidate { module, mutant, .. } = one;
        // If the module is invalid anyway, only the item itself has to be valid.
        let linked = match Program::of_module(&self.package, module).is_ok() {
            true => Program::of_module(package, module),
            false => Program::of_items(package, module, &[&mutant.item]),
        };
        if let Err(error) = linked {
            return Some(Fate::Invalid { reason: reason(&error) });
        }
        lived::equality(&self.package, package, one).map(|by| Fate::Equal { by })
    }

    /// The reason why a mutant makes a valid module invalid.
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
        Self::Unknown { reason: "no test that runs here has this sampler".to_owned() }
    }
}

impl Hidden {
    /// The one closer to failing.
    #[must_use]
    pub fn nearest(one: Option<Self>, other: Option<Self>) -> Option<Self> {
        let all = one.into_iter().chain(other);
        all.max_by(|a, b| a.ratios[1].total_cmp(&b.ratios[1]))
    }
}

/// An error of linking, in a line.
fn reason(error: &ReflectError) -> String {
    error.diagnostic().map_or_else(|| error.to_string(), |found| found.message.clone())
}

/// Runs a function for each element, on all cores. Each test has its own thread, because its checks use Rayon's pool,
/// and a thread of that pool can't wait for them.
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

/// Returns `true` if each linked function of the package has the same text as before.
fn is_idle(original: &Package, mutant: &Package) -> bool {
    let Ok(functions) = original.functions() else { return false };
    let names: BTreeSet<String> = functions.into_iter().map(|item| item.name).collect();
    let known = original.fingerprints(&names);
    !known.is_empty() && known == mutant.fingerprints(&names)
}

/// The path of an item, `brdf::schlick`; in a package of one file, its name alone.
fn path_of(module: &str, item: &str) -> String {
    if module.is_empty() { item.to_owned() } else { format!("{module}::{item}") }
}
