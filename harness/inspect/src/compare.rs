//! Compares every function of a package before and after an edit, without any test.
//!
//! A function or entry point whose linked text didn't change isn't run. Karat calls each changed function with
//! generated arguments, before and after the edit. Three in four arguments are in the range that their name suggests;
//! one in four has any value of its type. Both versions get the same inputs: Karat matches entry points' inputs by
//! their attributes, and resources by their names or bindings. Compute passes are dispatched over generated resources.
//! The comparison is bit by bit, and all NaNs count as equal. A function without a result has no verdict. If all
//! results are equal, the comparison lists the edited lines that no input covers, because their results are unknown.
//!
//! If a condition excludes the edited code, Karat turns on the fewest features that include this code.
//!
//! ```no_run
//! use karat::Package;
//!
//! let (before, after) = (Package::open("old").unwrap(), Package::open("new").unwrap());
//! for one in karat_inspect::compare::Request::new(before, after).run().unwrap() {
//!     println!("{}: {:?}", one.function, one.change);
//! }
//! ```

mod calls;
mod lanes;
mod passes;
mod sides;
mod values;

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, PoisonError};

use karat::check::HazardKind as Kind;
use karat::fixture::Fixtures;
use karat::package::{Feature, Package, PackageError};
use karat::path::Path;
use karat::unstable::dispatch::{Passes, Violation, ViolationAccess};
use karat::unstable::interpret::{Coverage, of_outside};
use karat::unstable::package::{Stage, declared_hazards, place_of_override, values_of, words_of};
use karat::unstable::probe::{ProbeError, Probed};
use karat::unstable::reflect::{Overrides, Program, State};
use karat_core::panics;
use karat_core::value::Scalar;
use serde::Serialize;

use crate::limits::{
    MOST_STATE, OPEN_OVERRIDE, OTHER_OVERRIDE, OTHER_VALUES, PAIRED_FEATURES, WHOLE_FEATURES,
};
use crate::made_up::{self, Drawn, Ranges};
use calls::Ran;
use lanes::Shared;
use sides::{Side, attributes, gained_and_lost, interface, renamed};
use values::Clarity;

use rayon::prelude::*;

pub use karat::unstable::interpret::{Missed, Uncovered};

/// The number of inputs for each function. On any path, this many inputs run within a moment.
const CASES: usize = 4096;

/// A comparison of a package with an edited version of it.
///
/// ```
/// use karat::Package;
/// use karat_inspect::compare::{Change, Request};
///
/// let package = |text| Package::from_source("m", text);
/// let before = package("fn half(x: f32) -> f32 { return 0.5 * x; }");
/// let after = package("fn half(x: f32) -> f32 { return 0.6 * x; }");
/// let compared = Request::new(before, after).run()?;
/// assert!(!matches!(compared[0].change, Change::Same { .. }));
/// # Ok::<(), karat::package::PackageError>(())
/// ```
#[derive(Clone, Debug)]
#[must_use = "the request compares nothing until you call `.run()`"]
pub struct Request {
    before: Package,
    after: Package,
    only: Vec<String>,
    cases: usize,
    paths: Vec<Path>,
    overrides: Overrides,
}

/// The comparison of one function.
#[derive(Clone, Debug, Serialize)]
pub struct Compared {
    /// The function's path: `fresnel::schlick`.
    pub function: String,
    /// The function's position, `file:line:column`. The position is in the edited package, or in the original package
    /// if the edit removed the function.
    pub location: String,
    /// The features that the comparison turned on in both packages, because the edit has no effect without them. These
    /// features are off by default.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub under: Vec<String>,
    /// The effect of the edit.
    #[serde(flatten)]
    pub change: Change,
    /// The resources that a host must supply differently, each in a sentence: for example another `@binding`, or
    /// another offset of a buffer's member.
    pub interface: Vec<String>,
    /// The ranges from which arguments and members were sampled; empty if nothing ran.
    pub drawn: Drawn,
    /// The number of inputs that didn't run, because they would execute too many operations.
    pub cut: usize,
    /// The number of invocations of a compute pass in each direction; `None` for other functions. For a pass, the
    /// numbers of cases in [`change`](Self::change) are numbers of 32-bit values that the pass writes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dispatched: Option<[u32; 3]>,
    /// Violations that exist only after the edit, for example races in a compute pass or between pixels that write
    /// storage.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub violations: Vec<Violation>,
    /// Violations that exist only before the edit.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub mended: Vec<Violation>,
    /// Edited lines of either version that no input reached, and edited conditions that had the same value for all
    /// inputs. Karat doesn't know if these edits change results. Empty if results changed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub uncovered: Vec<Uncovered>,
}

/// The effect of an edit on a function.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "change", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Change {
    /// Neither the function nor code that it uses changed, except for comments and whitespace.
    Untouched,
    /// The edit changed the function's code, but all results have the same bits.
    Same {
        /// The number of inputs that ran on each path.
        cases: usize,
    },
    /// Some results changed.
    Changed {
        /// The paths on which results changed.
        paths: Vec<PathChange>,
    },
    /// The types of the function's parameters or of its result changed.
    Signature {
        /// The old signature.
        before: String,
        /// The new signature.
        after: String,
    },
    /// The function is new.
    Added,
    /// The function no longer exists.
    Removed,
    /// The function can't be compared.
    Unjudged {
        /// The reason.
        reason: String,
    },
}

/// The changed results on one path.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PathChange {
    /// The path's name.
    pub path: String,
    /// The number of inputs with changed results, and the number of all inputs.
    pub cases: (usize, usize),
    /// The largest change in steps of an `f32`; `None` if a changed value is NaN before or after the edit, or isn't a
    /// float.
    pub ulp: Option<u64>,
    /// The largest change relative to the old value; `None` in the same cases as `ulp`.
    pub relative: Option<f64>,
    /// The simplest arguments that show the change, followed by the members of buffers, except for array elements.
    /// Karat prefers arguments whose results are plain numbers that differ by at least 0.001, then arguments with NaN,
    /// then arguments whose results differ in the last digit. Arguments and members that don't affect the change are
    /// left out.
    pub arguments: Vec<(String, String)>,
    /// All arguments of the shown case, if the function isn't a compute pass.
    #[serde(skip)]
    pub given: Vec<(String, String)>,
    /// The result of the shown case before the edit.
    pub before: String,
    /// The result of the shown case after the edit.
    pub after: String,
    #[serde(skip)]
    clarity: Clarity,
    /// For a compute pass: the first changed value of each resource. [`before`](Self::before) and
    /// [`after`](Self::after) show the first of these resources.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub words: Vec<WordChange>,
}

/// A 32-bit value of a resource that a compute pass writes differently after an edit.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WordChange {
    /// The resource's name.
    pub resource: String,
    /// The element with its value before the edit, such as `counts[3] = 1`.
    pub before: String,
    /// The element's value after the edit.
    pub after: String,
}

impl Compared {
    fn of(function: &str, change: Change) -> Self {
        let (location, interface, drawn, uncovered, under) = Default::default();
        let (function, dispatched, cut) = (function.to_owned(), None, 0);
        let (violations, mended) = Default::default();
        Self {
            function,
            location,
            under,
            change,
            interface,
            drawn,
            cut,
            dispatched,
            violations,
            mended,
            uncovered,
        }
    }
}

impl Request {
    /// Makes a comparison of a package with its edited version. It runs on the path `cpu`, unless
    /// [`paths`](Self::paths) sets other paths.
    pub fn new(before: Package, after: Package) -> Self {
        let (only, paths, overrides) = (Vec::new(), vec![Path::CPU], Overrides::new());
        Self { before, after, only, cases: CASES, paths, overrides }
    }

    /// Selects the functions with one of these strings in their names.
    pub fn only<'n>(self, names: impl IntoIterator<Item = &'n str>) -> Self {
        Self { only: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    /// Sets the number of inputs for each function. The default is 4,096.
    pub fn cases(self, cases: usize) -> Self {
        Self { cases, ..self }
    }

    /// Sets the paths on which functions run.
    pub fn paths(self, paths: Vec<Path>) -> Self {
        Self { paths, ..self }
    }

    /// Sets the value of an `override`, by its name or its `@id`, in both packages.
    pub fn set_override(mut self, name: &str, value: f64) -> Self {
        self.overrides.insert(name.to_owned(), value);
        self
    }

    /// Compares the selected functions, in the order of their names.
    ///
    /// # Errors
    /// Returns an error if a package can't be read, or if `karat.toml` sets an override that exists in neither package.
    pub fn run(&self) -> Result<Vec<Compared>, PackageError> {
        self.run_with(&|_, _, _| {})
    }

    /// Does the same as [`run`](Self::run). Calls `told` with each verdict, the verdict's number and the number of all
    /// verdicts, in the order of the functions' names.
    ///
    /// # Errors
    /// Returns the same errors as [`run`](Self::run).
    pub fn run_with(
        &self,
        told: &(dyn Fn(&Compared, usize, usize) + Sync),
    ) -> Result<Vec<Compared>, PackageError> {
        let declared = declared_hazards(&self.after)?.overrides;
        if let Some((name, wrong)) = Program::unfit(&[&self.before, &self.after], &declared) {
            let reason = format!("{wrong}{}", place_of_override(&self.after, &name));
            return Err(PackageError::Manifest { file: "karat.toml".to_owned(), reason });
        }
        // If a condition compares a feature with a number, both packages need a number for this feature. Without a
        // number, Karat couldn't read the module.
        let values = [&self.before, &self.after].map(values_of);
        let mut both = values[0].clone();
        for (name, own) in &values[1] {
            let known = both.entry(name.clone()).or_default();
            known
                .extend(own.iter().filter(|one| !known.contains(one)).copied().collect::<Vec<_>>());
        }
        let first = |side: usize| -> Vec<String> {
            let known = both.iter().filter(|(name, _)| values[side].contains_key(*name));
            known.map(|(name, all)| format!("{name}={}", all[0])).collect()
        };
        let (before, after) = (featured(&self.before, &first(0)), featured(&self.after, &first(1)));
        // An override with a value in `karat.toml` is fixed, like one that the request sets.
        let overrides = declared.into_iter().chain(self.overrides.clone()).collect();
        let shown: BTreeSet<String> = first(0).into_iter().chain(first(1)).collect();
        let valued = Self { before, after, overrides, ..self.clone() };
        let others = other_values(&both);
        let all = valued.pairs(&values, &others)?;
        let of = all.len();
        let done = Mutex::new((0, BTreeMap::new()));
        let all: Vec<_> = all.into_iter().enumerate().collect();
        let compared = all.into_par_iter().map(|(at, (name, pair))| {
            let one = panics::caught(|| valued.verdict_under(&name, pair, (&others, &values)));
            let mut one = one.unwrap_or_else(|panicked| {
                let reason = format!("Karat panics while it compares the function: {panicked}");
                Compared::of(&name, Change::Unjudged { reason })
            });
            if one.change != Change::Untouched {
                let own: BTreeSet<&str> =
                    one.under.iter().map(|feature| name_of(feature)).collect();
                let open = shown.iter().filter(|feature| !own.contains(name_of(feature)));
                let open: Vec<String> = open.cloned().collect();
                one.under.extend(open);
            }
            // The verdicts are sorted by name, so that the same verdicts always give the same output.
            let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
            let (next, waiting) = &mut *done;
            waiting.insert(at, one.clone());
            while let Some(one) = waiting.remove(next) {
                *next += 1;
                told(&one, *next, of);
            }
            one
        });
        Ok(compared.collect())
    }

    /// All functions of both packages, by name. If Karat can't read a module, the result has the module instead of its
    /// functions.
    fn pairs(
        &self,
        values: &[Values; 2],
        others: &[String],
    ) -> Result<BTreeMap<String, Pair>, PackageError> {
        let sides = [&self.before, &self.after];
        let [before, after] = [self.before.modules()?, self.after.modules()?];
        let modules: BTreeSet<&String> = before.iter().chain(&after).collect();
        let name_of = |module: &String| match module.is_empty() {
            true => self.after.name(),
            false => module.clone(),
        };
        let mut all = BTreeMap::new();
        for module in modules {
            let has = [before.contains(module), after.contains(module)];
            let texts = [0, 1].map(|side| words_of(sides[side], module));
            // Files that can't be read don't count as equal.
            let is_same = match &texts {
                [Some(before), Some(after)] => before.0 == after.0,
                _ => false,
            };
            let words = texts.map(Option::unwrap_or_default);
            let items =
                |side: usize, features: &[String]| -> Result<BTreeMap<_, _>, PackageError> {
                    if !has[side] {
                        return Ok(BTreeMap::new());
                    }
                    let items = featured(sides[side], features).functions_in(module)?.into_iter();
                    Ok(items.map(|item| (item.name, item.entry_point)).collect())
                };
            let (old, new) = match (items(0, &[]), items(1, &[])) {
                (Ok(old), Ok(new)) => (old, new),
                (old, new) => {
                    let whole = |side: &Result<_, PackageError>| {
                        side.as_ref().err().map(|error| with_place(&error.to_string()))
                    };
                    let pair = match (&old, &new) {
                        (Err(_), Err(_)) if is_same => Pair::Same,
                        _ => Pair::Broken(whole(&old), whole(&new)),
                    };
                    all.insert(name_of(module), pair);
                    continue;
                }
            };
            for name in old.keys().chain(new.keys()) {
                let there = Pair::There(old.get(name).copied(), new.get(name).copied());
                all.insert(name.clone(), there);
            }
            // A changed file may also have code that a condition excludes, which belongs to none of these functions.
            if is_same {
                continue;
            }
            // If a module was added or removed, its functions already report the change.
            let overrides =
                if has == [true; 2] { self.overrides_of(module) } else { Ok(Vec::new()) };
            match overrides {
                Ok(overrides) if overrides.is_empty() => {}
                Ok(overrides) => drop(all.insert(name_of(module), Pair::Overrides(overrides))),
                // If a module is invalid, its functions are compared, but not its interface with the host.
                Err(reasons) => {
                    if overrides_in(&words[0].0) != overrides_in(&words[1].0) {
                        let [was, is] = reasons;
                        all.insert(name_of(module), Pair::Broken(was, is));
                    }
                }
            }
            let open: BTreeSet<&String> = words[0].1.iter().chain(&words[1].1).collect();
            let open: Vec<String> = open.into_iter().chain(others).cloned().collect();
            let mut edited = BTreeSet::new();
            for features in subsets(&open) {
                // Each package gets only the features that its conditions use.
                let of = |side: usize| asked(&features, &values[side], &words[side].1);
                let own = [of(0), of(1)];
                let (old, new) = match (items(0, &own[0]), items(1, &own[1])) {
                    (Ok(old), Ok(new)) => (old, new),
                    // Features that exclude each other are skipped.
                    (Err(_), Err(_)) => continue,
                    _ if own[0] != own[1] => continue,
                    (old, new) => {
                        let [was, is] = [old.err(), new.err()].map(|error| {
                            let on = features.join(", ");
                            error.map(|error| {
                                format!("with {on}: {}", with_place(&error.to_string()))
                            })
                        });
                        all.entry(name_of(module)).or_insert(Pair::Broken(was, is));
                        continue;
                    }
                };
                for name in old.keys().chain(new.keys()) {
                    let (was, is) = (old.get(name).copied(), new.get(name).copied());
                    if edited.contains(name) || self.is_untouched_under(name, &own) {
                        continue;
                    }
                    edited.insert(name.clone());
                    if !features.is_empty() {
                        let under = Under { features: features.clone(), own: own.clone() };
                        all.insert(name.clone(), Pair::Under(under, was, is));
                    }
                }
            }
            if edited.is_empty() && open.len() > WHOLE_FEATURES {
                all.insert(name_of(module), Pair::Hidden(open));
            }
        }
        if !self.only.is_empty() {
            all.retain(|name, _| self.only.iter().any(|part| name.contains(part.as_str())));
        }
        Ok(all)
    }

    /// Checks if a function's linked text is equal in both packages with these features on.
    fn is_untouched_under(&self, name: &str, features: &[Vec<String>; 2]) -> bool {
        let (module, own) = name.rsplit_once("::").unwrap_or(("", name));
        let linked = |side: &Package, features: &[String]| {
            Program::of_items(&featured(side, features), module, &[own]).ok()
        };
        match (linked(&self.before, &features[0]), linked(&self.after, &features[1])) {
            (Some(before), Some(after)) => before.normalized_text() == after.normalized_text(),
            // Features that exclude each other are skipped.
            (None, None) => features.iter().any(|own| !own.is_empty()),
            _ => false,
        }
    }

    /// Returns the changes of a module's overrides, except for overrides that a function uses. Returns an error if the
    /// module is invalid before or after the edit.
    fn overrides_of(&self, module: &str) -> Result<Vec<String>, [Option<String>; 2]> {
        let whole = |side| Program::of_module(side, module);
        let (before, after) = match (whole(&self.before), whole(&self.after)) {
            (Ok(before), Ok(after)) => (before, after),
            (before, after) => {
                return Err([before.err(), after.err()].map(|error| {
                    error.map(|error| {
                        format!("the module's overrides: {}", with_place(&error.to_string()))
                    })
                }));
            }
        };
        let used = |side: &Package| -> BTreeSet<String> {
            let items = side.functions_in(module).unwrap_or_default().into_iter();
            let of = |name: String| {
                let own = name.rsplit("::").next().unwrap_or(&name).to_owned();
                let program = Program::of_items(side, module, &[&own]).ok();
                program.map(|program| program.declared_overrides()).unwrap_or_default()
            };
            items.flat_map(|item| of(item.name)).map(|(name, _)| name).collect()
        };
        let all = sides::overrides(&before, &after);
        if all.is_empty() {
            return Ok(all);
        }
        let used: BTreeSet<String> = &used(&self.before) | &used(&self.after);
        let is_open = |sentence: &String| {
            used.iter().all(|name| !sentence.contains(&format!("override `{name}`")))
        };
        Ok(all.into_iter().filter(is_open).collect())
    }

    /// The verdict on a function. If the results are the same before and after the edit, Karat also compares the
    /// function with other values of features. If the results differ with one of these values, returns the verdict for
    /// this value.
    fn verdict_under(
        &self,
        name: &str,
        pair: Pair,
        (others, values): (&[String], &[Values; 2]),
    ) -> Compared {
        let there = match pair {
            Pair::There(was, is) => Some((was, is)),
            _ => None,
        };
        let mut one = self.verdict(name, pair);
        let Some((was, is)) = there else { return one };
        for other in others.iter().take(OTHER_VALUES) {
            if !one.is_open() {
                break;
            }
            let side = |package: &Package, own: &Values| {
                let known: &[String] = match own.contains_key(name_of(other)) {
                    true => std::slice::from_ref(other),
                    false => &[],
                };
                featured(package, known)
            };
            let (before, after) = (side(&self.before, &values[0]), side(&self.after, &values[1]));
            let own = Self { before, after, ..self.clone() };
            let next = own.verdict(name, Pair::There(was, is));
            one.take(Compared { under: vec![other.clone()], ..next });
        }
        one
    }

    fn verdict(&self, name: &str, pair: Pair) -> Compared {
        let unjudged = |reason: String| Compared::of(name, Change::Unjudged { reason });
        match pair {
            Pair::There(Some(None), Some(None)) => self.compare(name, None),
            Pair::There(Some(was), Some(is)) if was == is => self.compare(name, is),
            Pair::There(Some(was), Some(is)) => {
                let shown = |stage: Option<Stage>| {
                    let function = || format!("fn {name}");
                    stage.map_or_else(function, |stage| format!("@{stage} fn {name}"))
                };
                Compared::of(name, Change::Signature { before: shown(was), after: shown(is) })
            }
            Pair::There(Some(_), None) => Compared::of(name, Change::Removed),
            Pair::There(..) => Compared::of(name, Change::Added),
            Pair::Under(Under { features, own: [old, new] }, was, is) => {
                let (before, after) = (featured(&self.before, &old), featured(&self.after, &new));
                let under = Self { before, after, ..self.clone() };
                Compared { under: features, ..under.verdict(name, Pair::There(was, is)) }
            }
            Pair::Overrides(interface) => {
                Compared { interface, ..Compared::of(name, Change::Untouched) }
            }
            Pair::Same => Compared::of(name, Change::Untouched),
            Pair::Broken(Some(was), Some(is)) if was == is => {
                unjudged(format!("before and after the edit: {is}"))
            }
            Pair::Broken(_, Some(is)) => unjudged(format!("after the edit: {is}")),
            Pair::Broken(was, None) => {
                unjudged(format!("before the edit: {}", was.unwrap_or_default()))
            }
            Pair::Hidden(open) => unjudged(format!(
                "Karat didn't find the features that turn on the edited code: the module's {} features have too many combinations to try all. Turn on the right features with --feature NAME",
                open.len()
            )),
        }
    }

    fn ranges(&self) -> Result<Ranges, String> {
        let mut ranges = Ranges::of(&self.after).map_err(|error| error.to_string())?;
        self.overrides.iter().for_each(|(name, value)| ranges.set_override(name, *value));
        Ok(ranges)
    }

    fn compare(&self, name: &str, stage: Option<Stage>) -> Compared {
        let compared = |change| Compared::of(name, change);
        // A function that can't be called may still be unchanged.
        let (module, own) = name.rsplit_once("::").unwrap_or(("", name));
        let linked = |package: &Package| Program::of_items(package, module, &[own]);
        let (mut host, mut settings) = (Vec::new(), vec![BTreeMap::new()]);
        let mut of_stage = [Vec::new(), Vec::new()];
        match (linked(&self.before), linked(&self.after)) {
            (Ok(before), Ok(after)) => {
                if before.normalized_text() == after.normalized_text() {
                    return compared(Change::Untouched);
                }
                of_stage = [before.attributes(own), after.attributes(own)];
                host = attributes(&of_stage[0], &of_stage[1]);
                host.extend(sides::overrides(&before, &after));
                settings = self.settings(&before, &after);
            }
            (Err(was), Err(is)) => {
                let words = |side: &Package| words_of(side, module).map(|(words, _)| words);
                let reason = first_line(&is.to_string());
                if first_line(&was.to_string()) == reason
                    && words(&self.before) == words(&self.after)
                {
                    return compared(Change::Untouched);
                }
            }
            _ => {}
        }
        let stateful = self.state_of(name);
        let usual = settings[0].clone();
        let none = || [State::new(), State::new()];
        let mut runs: Vec<_> = settings.into_iter().map(|given| (given, none())).collect();
        if !stateful.sides[0].is_empty() {
            runs.retain(|_| !stateful.is_needed);
            runs.push((usual, stateful.sides));
        }
        let mut one: Option<Compared> = None;
        for (given, state) in &runs {
            let own = given.iter().fold(self.clone(), |all, (name, x)| all.set_override(name, *x));
            let mut next = own.compare_linked(name, stage, &of_stage, state);
            if let Change::Changed { paths } = &mut next.change {
                let shown = given.iter().map(|(name, x)| (name.clone(), x.to_string()));
                paths.iter_mut().for_each(|path| path.arguments.extend(shown.clone()));
            }
            match &mut one {
                // If private variables can't be set, there is no verdict, because other overrides may change results.
                Some(one)
                    if matches!(next.change, Change::Unjudged { .. }) && !state[0].is_empty() =>
                {
                    *one = next;
                }
                Some(one) => one.take(next),
                None => one = Some(next),
            }
            if !one.as_ref().is_some_and(Compared::is_open) {
                break;
            }
        }
        let mut one = one.expect("there is one setting, at least");
        if let (Change::Same { .. }, Some((path, lanes))) = (&one.change, stateful.large) {
            let reason = format!(
                "the results are the same, but Karat doesn't compare the variable `{path}`: its {lanes} numbers are too many"
            );
            one.change = Change::Unjudged { reason };
        }
        one.interface.splice(0..0, host);
        one
    }

    /// The private variables through which a function receives values from other functions or passes values to them. A
    /// variable counts only if both packages declare the variable with the same type, or if the edit renamed the
    /// variable.
    fn state_of(&self, name: &str) -> Stateful {
        let sides = [&self.before, &self.after];
        let programs = sides.map(|side| Program::of_function(side, name).ok());
        let [old, new] = [0, 1].map(|side| {
            programs[side].as_ref().map(|program| program.state_of(name)).unwrap_or_default()
        });
        let is_needed = programs.iter().zip([&old, &new]).any(|(program, own)| {
            let shows = |program: &Arc<Program>| program.function(name).is_ok();
            !own.is_empty() && !program.as_ref().is_some_and(shows)
        });
        let mut all = Stateful { is_needed, ..Stateful::default() };
        let declared = |side: usize, path: &str| {
            let (module, own) = path.rsplit_once("::").unwrap_or(("", path));
            let program = Program::of_items(sides[side], module, &[own]).ok()?;
            program.private_type(path)
        };
        for (path, variable) in old.iter().chain(&new) {
            let types = [0, 1].map(|side| declared(side, path));
            if types.iter().any(|ty| ty.as_ref() != Some(&variable.ty)) {
                continue;
            }
            match variable.lanes > MOST_STATE {
                true => all.large = Some((path.clone(), variable.lanes)),
                false => all.sides.iter_mut().for_each(|side| {
                    side.insert(path.clone(), variable.clone());
                }),
            }
        }
        // A renamed variable has the same position among all variables.
        let gone: Vec<_> = old.iter().filter(|(path, _)| declared(1, path).is_none()).collect();
        let came: Vec<_> = new.iter().filter(|(path, _)| declared(0, path).is_none()).collect();
        if let ([(was, variable)], [(is, other)]) = (&*gone, &*came)
            && variable.ty == other.ty
            && variable.lanes <= MOST_STATE
            && old.keys().position(|path| path == *was) == new.keys().position(|path| path == *is)
        {
            all.sides[0].insert((*was).clone(), (*variable).clone());
            all.sides[1].insert((*is).clone(), (*other).clone());
        }
        all
    }

    /// The settings to compare: each setting has values for overrides that neither the request nor `karat.toml` sets.
    /// The first setting has a value for each override without a default. Each further setting changes one override
    /// that both packages have.
    fn settings(&self, before: &Program, after: &Program) -> Vec<BTreeMap<String, f64>> {
        let declared = |side: &Program| side.declared_overrides().into_iter().map(|(name, _)| name);
        let is_bool = |side: &Program, name: &str| side.override_type(name) == Some(Scalar::Bool);
        let mut usual = BTreeMap::new();
        for side in [before, after] {
            let open = declared(side).filter(|name| side.wants_override(name));
            usual.extend(open.map(|name| {
                let value = if is_bool(side, &name) { 1.0 } else { OPEN_OVERRIDE };
                (name, value)
            }));
        }
        usual.retain(|name, _| !self.overrides.contains_key(name));
        let old: BTreeSet<String> = declared(before).collect();
        let both = declared(after).filter(|name| old.contains(name));
        let mut all = vec![usual.clone()];
        for name in both.filter(|name| !self.overrides.contains_key(name)) {
            let values = if is_bool(after, &name) { &[0.0, 1.0][..] } else { &[OTHER_OVERRIDE] };
            let other = |value: &f64| usual.clone().into_iter().chain([(name.clone(), *value)]);
            all.extend(values.iter().map(|value| other(value).collect()));
        }
        all
    }

    /// Compares an edited function. `attributes` has the attributes of each version's inputs and outputs.
    fn compare_linked(
        &self,
        name: &str,
        stage: Option<Stage>,
        attributes: &[Vec<(String, String)>; 2],
        state: &[State; 2],
    ) -> Compared {
        let compared = |change| Compared::of(name, change);
        let unjudged = |error: &dyn std::fmt::Display| {
            compared(Change::Unjudged { reason: first_line(&error.to_string()) })
        };
        if stage == Some(Stage::Compute) {
            return self.compare_passes(name);
        }
        let ranges = match self.ranges() {
            Ok(ranges) => ranges,
            Err(reason) => return unjudged(&reason),
        };
        let probed = |package: &Package, state: &State| {
            let overrides = ranges.overrides_of(package, name);
            Probed::in_state(package, name, &overrides, state).and_then(made_up::fitted)
        };
        let [was, is] = state;
        let (before, after) = match (probed(&self.before, was), probed(&self.after, is)) {
            (Ok(before), Ok(after)) => (before, after),
            (Err(error), Err(_)) => {
                return unjudged(&format!("the function was edited, but {error}"));
            }
            (Err(error), _) => return unjudged(&format!("before the edit: {error}")),
            (_, Err(error)) => return unjudged(&format!("after the edit: {error}")),
        };
        // An edit may add derivatives or remove them.
        let (before, after) = match (before.takes_derivatives(), after.takes_derivatives()) {
            (true, false) => (before, after.varying()),
            (false, true) => (before.varying(), after),
            _ => (before, after),
        };
        let location = after.function.span.to_string();
        let Some(shared) = Shared::of(&before, &after, attributes) else {
            let [before, after] = sides::signatures([&before, &after]);
            return Compared { location, ..compared(Change::Signature { before, after }) };
        };
        let mut ran = Ran::default();
        let unseen = |reason: String| Change::Unjudged { reason: first_line(&reason) };
        let change = self.run_both(&before, &after, (&mut ran, shared));
        let mut change = change.unwrap_or_else(unseen);
        let (mut violations, mut mended) = (Vec::new(), Vec::new());
        if after.function.form.alone && stage == Some(Stage::Fragment) {
            let renamed = renamed(Side::of(&before), Side::of(&after));
            match self.brought_to_pixels(name, &renamed) {
                Ok(brought) => (violations, mended) = brought,
                // A changed result matters more than a note that pixels couldn't run side by side.
                Err(reason) if matches!(change, Change::Same { .. }) => change = unseen(reason),
                Err(_) => {}
            }
        }
        if matches!(change, Change::Same { .. }) && violations.is_empty() {
            violations.extend(ran.reached.outside(name));
        }
        let uncovered = match change {
            Change::Same { .. } if violations.is_empty() => ran.reached.uncovered(&location),
            _ => Vec::new(),
        };
        let Ran { drawn, cut, .. } = ran;
        let (old, new) = (Side::of(&before), Side::of(&after));
        let mut interface = interface(old, new);
        if stage.is_some() {
            interface.extend(gained_and_lost(old, new));
        }
        let change = compared(change);
        Compared { location, interface, drawn, cut, violations, mended, uncovered, ..change }
    }
}

impl Compared {
    /// Checks if no setting of overrides or features has shown a change so far. If so, Karat tries further settings.
    fn is_open(&self) -> bool {
        matches!(self.change, Change::Same { .. }) && self.violations.is_empty()
    }

    /// Replaces this verdict by the verdict with another setting of overrides or features, if the other verdict shows a
    /// change. If neither verdict shows a change, a line counts as covered if at least one of the two settings covers
    /// the line.
    fn take(&mut self, next: Self) {
        match next.change {
            Change::Same { .. } if next.violations.is_empty() => {
                self.uncovered.retain(|line| next.uncovered.contains(line));
            }
            Change::Same { .. } | Change::Changed { .. } => *self = next,
            // The verdict of a setting that the shader doesn't accept proves nothing.
            _ => {}
        }
    }
}

/// The private variables of a function, which count as inputs and results.
#[derive(Default)]
struct Stateful {
    sides: [State; 2],
    /// `true` if these variables are the only visible effect of the function, before or after the edit.
    is_needed: bool,
    /// A variable that is too large to compare, with the number of its scalars.
    large: Option<(String, usize)>,
}

#[derive(Debug)]
enum Pair {
    /// A function that exists with the default features: its stage before and after the edit. `None` for a version
    /// without this function, and `Some(None)` if the function isn't an entry point.
    There(Option<Option<Stage>>, Option<Option<Stage>>),
    /// An edited function that needs these features: without them, the function doesn't exist, or the edit doesn't
    /// affect it.
    Under(Under, Option<Option<Stage>>, Option<Option<Stage>>),
    /// Changed overrides that no function uses.
    Overrides(Vec<String>),
    /// A module that Karat can't read before the edit, after it, or both, with the reason for each version.
    Broken(Option<String>, Option<String>),
    /// An invalid module whose text didn't change.
    Same,
    /// A module whose edited code stays excluded with all tried features. Holds the module's features.
    Hidden(Vec<String>),
}

/// The features that include edited code. `own` has, for each of the two packages, the features that the package's
/// conditions use.
#[derive(Debug)]
struct Under {
    features: Vec<String>,
    own: [Vec<String>; 2],
}

/// The numbers with which conditions compare each feature.
type Values = BTreeMap<String, Vec<Feature>>;

/// All numbers of each feature except the feature's first number, as `NAME=NUMBER`.
fn other_values(values: &Values) -> Vec<String> {
    let of = |(name, all): (&String, &Vec<Feature>)| {
        all[1..].iter().map(|value| format!("{name}={value}")).collect::<Vec<_>>()
    };
    values.iter().flat_map(of).collect()
}

fn name_of(feature: &str) -> &str {
    feature.split_once('=').map_or(feature, |(name, _)| name)
}

/// Returns the features among `features` that a package's conditions use. A feature with a value is used if a condition
/// compares the feature with a number.
fn asked(features: &[String], values: &Values, conditions: &[String]) -> Vec<String> {
    let asks = |name: &&String| match name.split_once('=') {
        Some((name, _)) => values.contains_key(name),
        None => conditions.contains(name),
    };
    features.iter().filter(asks).cloned().collect()
}

/// Turns features on in a package. A feature may have a value: `NAME=VALUE`.
fn featured(package: &Package, features: &[String]) -> Package {
    features.iter().fold(package.clone(), |package, feature| match feature.split_once('=') {
        Some((name, value)) => match value.parse::<i64>() {
            Ok(number) => package.feature(name, Feature::Number(number)),
            Err(_) => package.feature(name, value == "true"),
        },
        None => package.feature(feature, true),
    })
}

/// Sets of features, smaller sets first. No set has two values for one feature. For few features, the function returns
/// all sets. For more features, the function returns the empty set, each single feature, each pair, and for each n, the
/// set in which each feature has its n-th value. For many features, the function leaves out the pairs.
fn subsets(all: &[String]) -> Vec<Vec<String>> {
    let chosen = |at: Vec<usize>| at.into_iter().map(|at| all[at].clone()).collect::<Vec<_>>();
    let of_mask = |mask: usize| chosen((0..all.len()).filter(|at| mask >> at & 1 == 1).collect());
    let mut sets: Vec<Vec<String>> = if all.len() <= WHOLE_FEATURES {
        let mut masks: Vec<usize> = (0..1 << all.len()).collect();
        masks.sort_by_key(|mask| mask.count_ones());
        masks.into_iter().map(of_mask).collect()
    } else {
        let each = (0..all.len()).map(|at| vec![at]);
        let pairs =
            (0..all.len()).flat_map(|at| (at + 1..all.len()).map(move |other| vec![at, other]));
        let pairs = pairs.filter(|_| all.len() <= PAIRED_FEATURES);
        // The values of one feature are neighbours in the list.
        let number =
            |at: usize| (0..at).filter(|one| name_of(&all[*one]) == name_of(&all[at])).count();
        let most = (0..all.len()).map(number).max().unwrap_or_default();
        let whole = (0..=most).map(|own| {
            let is_own = |at: &usize| number(*at) == own || !all[*at].contains('=');
            (0..all.len()).filter(is_own).collect()
        });
        std::iter::once(Vec::new()).chain(each).chain(pairs).chain(whole).map(chosen).collect()
    };
    sets.retain(|set| {
        set.iter().map(|one| name_of(one)).collect::<BTreeSet<_>>().len() == set.len()
    });
    sets
}

/// The first line of an error, with the error's position. If a feature lacks a value, the text also names the option
/// that sets the value.
fn with_place(error: &str) -> String {
    let place = error.lines().find_map(|line| line.trim_start().strip_prefix("┌─ "));
    let place = place.map_or_else(String::new, |place| format!(" ({})", place.trim()));
    let line = first_line(error);
    let hint = if line.ends_with("has no value") {
        ": set the value with --feature NAME=VALUE"
    } else {
        ""
    };
    format!("{line}{place}{hint}")
}

fn first_line(error: &str) -> String {
    let reason = error.replacen("error: ", "", 1);
    reason.lines().next().unwrap_or_default().to_owned()
}

#[derive(Default)]
struct Both {
    sides: [Coverage; 2],
    /// `true` if the results depend on an index outside of an array after the edit, but not before it.
    strays: bool,
    /// For each version: `None` before its first run in the engine, `Ok` after a run that succeeded, and otherwise the
    /// reason why the first run failed.
    measured: [Option<Result<(), String>>; 2],
    /// The reason why Karat doesn't know if results depend on an index outside of an array.
    unknown: Option<String>,
}

/// The declarations of overrides in a module's tokens.
fn overrides_in(words: &[String]) -> Vec<&[String]> {
    let begins = (0..words.len()).filter(|at| words[*at] == "override");
    let whole = |at: usize| {
        // An attribute such as `@id(7)` precedes the keyword.
        let before = words[..at].iter().rposition(|word| word == ";" || word == "}");
        let behind = words[at..].iter().position(|word| word == ";");
        &words[before.map_or(0, |before| before + 1)..at + behind.unwrap_or(words.len() - at)]
    };
    begins.map(whole).collect()
}

/// Records the outcome of a version's run in the engine. If no run has succeeded, keeps the reason why the first run
/// failed.
fn note(measured: &mut Option<Result<(), String>>, one: Result<(), String>) {
    if one.is_ok() || measured.is_none() {
        *measured = Some(one);
    }
}

impl Both {
    /// Adds the lines that both versions of a function reach in these calls.
    fn add_calls(
        &mut self,
        sides: [&Probed; 2],
        fixtures: &[Fixtures; 2],
        (count, rows): (usize, [Cow<'_, [u32]>; 2]),
    ) {
        let mut ran = [false; 2];
        for (at, reach) in self.sides.iter_mut().enumerate() {
            let added = reach.add_calls(sides[at], &fixtures[at], (count, &rows[at]));
            ran[at] = added.is_ok();
            note(&mut self.measured[at], added.map_err(|error| error.to_string()));
        }
        let [before, after] = &self.sides;
        if self.strays || after.outside_beside(before).is_empty() {
            return;
        }
        let strays = |side: usize| of_outside(sides[side], &fixtures[side], (count, &rows[side]));
        match (strays(0), strays(1)) {
            (Ok(before), Ok(after)) => {
                self.strays = after.iter().zip(&before).any(|(after, before)| *after && !before);
            }
            // The function ended if reads outside of an array gave the usual values. With other values, a loop doesn't
            // end.
            (Ok(_), Err(ProbeError::Rounds { .. })) if ran[1] => self.strays = true,
            (Err(error), _) | (_, Err(error)) => self.unknown = Some(error.to_string()),
        }
    }

    fn add_passes(&mut self, sides: [&Passes; 2]) {
        for (at, reach) in self.sides.iter_mut().enumerate() {
            let added = reach.add_passes(sides[at]);
            note(&mut self.measured[at], added.map_err(|error| error.to_string()));
        }
    }

    /// The edited lines that no input covers. `place` is the function's position.
    fn uncovered(&self, place: &str) -> Vec<Uncovered> {
        let stopped = self.measured.iter().flatten().find_map(|one| one.as_ref().err());
        if let Some(reason) = stopped.or(self.unknown.as_ref()) {
            let (place, text) = (place.to_owned(), first_line(reason));
            return vec![Uncovered { place, text, missed: Missed::Unmeasured }];
        }
        let [before, after] = &self.sides;
        [after.uncovered_beside(before), before.uncovered_beside(after)].concat()
    }

    /// Returns a violation if, only after the edit, the results depend on an index outside of an array.
    fn outside(&self, function: &str) -> Option<Violation> {
        let [before, after] = &self.sides;
        let place = after.outside_beside(before).into_iter().next().filter(|_| self.strays)?;
        let headline = format!(
            "`{function}` uses an index outside of an array or a texture, and the results depend on the value at this index"
        );
        let does = "uses an index outside of the array or texture".to_owned();
        let (place, invocation) = (place.to_string(), "a call".to_owned());
        let access = ViolationAccess { place, invocation, does };
        Some(Violation::new(function, Kind::OutOfRange, (headline, 1), vec![access]))
    }
}

impl PathChange {
    /// A measure of how clearly the shown case shows the edit. Karat keeps the case with the largest measure.
    fn shows(&self) -> (Clarity, u64) {
        (self.clarity, self.ulp.unwrap_or(u64::MAX))
    }

    /// Merges this change with the change that the function shows for other contents of the buffers. Keeps the case
    /// that shows the change more clearly.
    fn add(&mut self, other: Self) {
        let cases = self.cases.0 + other.cases.0;
        let (ulp, relative) = (self.ulp.zip(other.ulp), self.relative.zip(other.relative));
        let less = match other.shows() > self.shows() {
            true => std::mem::replace(self, other),
            false => other,
        };
        self.cases.0 = cases;
        self.ulp = ulp.map(|(one, other)| one.max(other));
        self.relative = relative.map(|(one, other)| one.max(other));
        // With other contents, another resource may change.
        for one in less.words {
            if self.words.iter().all(|known| known.resource != one.resource) {
                self.words.push(one);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changes(before: &str, after: &str) -> Vec<(String, Change)> {
        let package = |text: &str| Package::from_source("p", text);
        let compared =
            Request::new(package(before), package(after)).run().expect("the packages can be read");
        compared.into_iter().map(|one| (one.function, one.change)).collect()
    }

    #[test]
    fn a_change_of_each_kind_is_reported() {
        let before = "// old\nfn half(x: f32) -> f32 { return x / 2.0; }\n\
                      fn user(x: f32) -> f32 { return half(x) + 1.0; }\n\
                      fn gone() -> u32 { return 1u; }\nfn other(x: f32) -> f32 { return x; }\n";
        let after = "/* new /* nested */ */\nfn half(x: f32) -> f32 { return 0.5 * x; }\n\
                     fn user(x: f32) -> f32 {\n return half(x) +   1.0; }\n\
                     fn more() -> u32 { return 1u; }\nfn other(x: vec2f) -> f32 { return x.x; }\n";
        let all = changes(before, after);
        let of = |name: &str| {
            let found = all.iter().find(|(function, _)| function == name);
            found.map(|(_, change)| change.clone()).expect("a verdict")
        };
        assert!(matches!(of("half"), Change::Same { cases: CASES, .. }), "{:?}", of("half"));
        assert!(matches!(of("user"), Change::Same { .. }), "`user` calls the edited function");
        assert_eq!((of("gone"), of("more")), (Change::Removed, Change::Added));
        assert!(matches!(of("other"), Change::Signature { .. }));
        let untouched = changes(before, &before.replace("// old", "// a comment"));
        assert!(untouched.iter().all(|(_, change)| *change == Change::Untouched), "{untouched:?}");
    }

    /// Tests the coverage of a function without side effects, and of a function that writes memory.
    #[test]
    fn lines_that_no_argument_reaches_are_listed() {
        let before = "@group(0) @binding(0) var<storage, read_write> seen: array<f32>;
            fn f(x: f32) -> f32 {
                if x * x == 1234.56 { return 2.0; }
                return x;
            }
            fn g(x: f32) -> f32 {
                if x * x == 1234.56 {
                    seen[0] = 2.0;
                }
                return x + 1.0;
            }";
        let after = before.replace("2.0", "3.0").replace("x + 1.0", "1.0 + x");
        let [before, after] = [before, &after].map(|text| Package::from_source("p", text));
        let all = Request::new(before, after).run().expect("the packages can be read");
        assert!(all.iter().all(|one| matches!(one.change, Change::Same { .. })), "{all:?}");
        let lines =
            |one: &Compared| one.uncovered.iter().map(|line| line.text.clone()).collect::<Vec<_>>();
        let of_f = ["if x * x == 1234.56 { return 3.0; }", "if x * x == 1234.56 { return 2.0; }"];
        assert_eq!(lines(&all[0]), of_f, "{all:?}");
        assert_eq!(lines(&all[1]), ["seen[0] = 3.0;", "seen[0] = 2.0;"], "{all:?}");
    }

    fn compared(before: &str, after: &str) -> Compared {
        let [before, after] = [before, after].map(|text| Package::from_source("p", text));
        let mut all = Request::new(before, after).run().expect("compared");
        all.pop().expect("a function")
    }

    /// If a condition has the same value for all inputs, its other branch isn't covered.
    #[test]
    fn conditions_with_one_outcome_are_listed() {
        let text = "fn key(x: u32, y: u32) -> u32 {
                let far = select(0u, 2u, y * y != 7654321u);
                if x > 3u && y >= 0u { return far; }
                return 1u;
            }";
        let ways = |from: &str, to: &str| {
            let one = compared(text, &text.replace(from, to));
            assert!(matches!(one.change, Change::Same { .. }), "{one:?}");
            one.uncovered.iter().map(|line| line.missed).collect::<Vec<_>>()
        };
        assert_eq!(ways("7654321u", "7654320u"), [Missed::False; 2]);
        assert_eq!(ways("y >= 0u", "y + 0u >= 0u"), [Missed::False; 2]);
        assert_eq!(ways("x > 3u", "3u < x"), []);
    }

    /// The comparison reports an edit that removes the guard of an index. In this test, such an edit changes no result:
    /// for an index outside of the array, the engine reads the last element, as the guarded code does.
    #[test]
    fn a_new_index_out_of_bounds_is_reported() {
        let of = |value: &str| {
            format!(
                "fn pick(i: u32) -> f32 {{
                    var all = array<f32, 4>(1.0, 2.0, 3.0, 4.0);
                    return {value};
                }}"
            )
        };
        let [guarded, bare] = [of("all[min(i, 3u)]"), of("all[i]")];
        let one = compared(&guarded, &bare);
        let [brought] = &one.violations[..] else { panic!("{one:?}") };
        assert_eq!(brought.kind, Kind::OutOfRange);
        assert_eq!(brought.accesses[0].place, "<p>:3:28", "{brought:?}");
        assert!(
            compared(&bare, &guarded).violations.is_empty(),
            "an edit that fixes the index brings no violation"
        );
        // If the function ignores the value outside of the array, no result depends on it.
        let given_up = compared(
            &of("select(0.0, all[min(i, 3u)], i < 4u)"),
            &of("select(0.0, all[i], i < 4u)"),
        );
        assert!(given_up.violations.is_empty(), "{given_up:?}");
    }

    /// Both versions see the same length of a buffer, even if only one version writes the buffer.
    #[test]
    fn a_buffer_that_one_side_may_write_is_as_long_on_both() {
        let of = |access: &str| {
            format!(
                "@group(0) @binding(0) var<storage, {access}> d: array<f32>;
                @group(0) @binding(1) var<storage, read> other: array<f32>;
                fn f(i: u32) -> u32 {{ return arrayLength(&d) + 1000u * arrayLength(&other); }}"
            )
        };
        let [read, written] = ["read", "read_write"].map(of);
        for (was, is, told) in [
            (&read, &written, "`d` is read_write, and was read before the edit"),
            (&written, &read, "`d` is read, and was read_write before the edit"),
        ] {
            let one = compared(was, is);
            assert!(matches!(one.change, Change::Same { .. }), "{one:?}");
            assert_eq!(one.interface, [told]);
        }
        // Two buffers that are only read have different lengths, so the results differ if an edit exchanges them.
        let one = compared(&read, &read.replace("arrayLength(&other)", "64u"));
        assert!(matches!(one.change, Change::Changed { .. }), "{one:?}");
    }

    /// If a function writes memory, Karat runs each case separately. A line counts as covered if any case reaches it.
    #[test]
    fn lines_that_any_case_comes_to_are_covered() {
        let text = "@group(0) @binding(0) var<storage, read_write> seen: array<f32>;
            fn f(x: f32) -> f32 {
                if x > 0.25 && x < 0.75 { seen[0] = 2.0 * x; }
                if x < -0.25 && x > -0.75 { seen[1] = 3.0 * x; }
                return x;
            }";
        for (from, to) in [("2.0 * x", "x * 2.0"), ("3.0 * x", "x * 3.0"), ("x > 0", "x + 0.0 > 0")]
        {
            let one = compared(text, &text.replace(from, to));
            assert!(matches!(one.change, Change::Same { .. }), "{one:?}");
            assert_eq!(one.uncovered, [], "{to}");
        }
    }

    /// If a function runs over several contents of its buffers, Karat shows the largest change and the first changed
    /// value of each resource, and adds up the numbers of cases.
    #[test]
    fn changes_over_several_inputs_are_summed() {
        let change = |ulp: Option<u64>, resource: &str, after: &str| {
            let word = WordChange {
                resource: resource.to_owned(),
                before: format!("{resource}[0] = 0"),
                after: after.to_owned(),
            };
            let (path, before, after) = ("cpu".to_owned(), word.before.clone(), after.to_owned());
            let (cases, relative, arguments) = ((2, 9), None, Vec::new());
            let clarity = Clarity::Plain;
            let words = vec![word];
            let given = Vec::new();
            PathChange {
                path,
                cases,
                ulp,
                relative,
                arguments,
                given,
                before,
                after,
                clarity,
                words,
            }
        };
        let mut sum = change(Some(3), "a", "1");
        for (ulp, resource, after, shown) in [
            (Some(3), "a", "2", "1"),
            (Some(4), "b", "3", "3"),
            (None, "c", "NaN", "NaN"),
            (Some(9), "c", "4", "NaN"),
        ] {
            sum.add(change(ulp, resource, after));
            assert_eq!(sum.after, shown);
        }
        let words: Vec<&str> = sum.words.iter().map(|one| &*one.resource).collect();
        assert_eq!((sum.cases.0, words), (10, vec!["c", "b", "a"]));
    }

    /// The comparison reports only the inputs and outputs whose attributes changed.
    #[test]
    fn each_changed_attribute_is_reported() {
        let of = |all: &[(&str, &str)]| {
            all.iter()
                .map(|(path, is)| ((*path).to_owned(), (*is).to_owned()))
                .collect::<Vec<(String, String)>>()
        };
        let before = of(&[("in.a", "@location(0)"), ("in.b", "@location(1)"), ("in.c", "flat")]);
        let after = of(&[("in.new", "flat"), ("in.b", "@location(2)"), ("in.a", "@location(3)")]);
        let told = [
            "`in.b` is @location(2), and was @location(1) before the edit",
            "`in.a` is @location(3), and was @location(0) before the edit",
        ];
        assert_eq!(attributes(&before, &after), told);
        assert_eq!(attributes(&before, &before), [""; 0]);
    }

    /// The comparison runs a vertex shader for all six vertices of a quad.
    #[test]
    fn each_corner_of_a_quad_is_compared() {
        let text = "@vertex fn vs(@builtin(vertex_index) i: u32) -> @builtin(position) vec4f {
                var corners = array<vec2f, 6>(vec2f(-1.0, -1.0), vec2f(1.0, -1.0), vec2f(-1.0, 1.0),
                    vec2f(-1.0, 1.0), vec2f(1.0, -1.0), vec2f(1.0, 1.0));
                return vec4f(corners[i], 0.0, 1.0);
            }";
        let one = compared(text, &text.replace("vec2f(1.0, 1.0)", "vec2f(1.0, 0.0)"));
        assert!(matches!(one.change, Change::Changed { .. }), "{one:?}");
    }

    #[test]
    fn a_change_is_shown_at_the_simplest_arguments() {
        let before = "fn f(a: f32, b: f32) -> f32 { return a + b; }\n\
                      fn n(x: f32) -> f32 { return x; }\n";
        let after = "fn f(a: f32, b: f32) -> f32 { return select(a + b, a - b, a > 0.25); }\n\
                     fn n(x: f32) -> f32 { return select(x, sqrt(-1.0 - x * x), x > 1.5); }\n";
        let all = changes(before, after);
        let Change::Changed { paths } = &all[0].1 else { panic!("{all:?}") };
        let [path] = &**paths else { panic!("{paths:?}") };
        let shown: Vec<&str> = path.arguments.iter().map(|(_, value)| value.as_str()).collect();
        assert_eq!((&shown[..], &*path.before, &*path.after), (&["1", "1"][..], "2", "0"));
        assert!(path.ulp.is_some_and(|ulp| ulp > 1000) && path.cases.0 < path.cases.1);
        let Change::Changed { paths } = &all[1].1 else { panic!("{all:?}") };
        assert_eq!(
            (paths[0].ulp, &*paths[0].after),
            (None, "NaN"),
            "the distance to NaN isn't a number"
        );
    }

    // Lesson 106
    #[test]
    fn the_worst_change_is_shown_and_not_the_simplest() {
        let before = "fn f(x: f32) -> f32 { return max(x, 0.0) + 1.0; }\n";
        let after = "fn f(x: f32) -> f32 {\n\
                     if x == 0.0 { return bitcast<f32>(bitcast<u32>(1.0) + 1u); }\n\
                     return select(max(x, 0.0) + 1.0, sqrt(-1.0 - x * x), x < -3.0);\n}\n";
        let all = changes(before, after);
        let Change::Changed { paths } = &all[0].1 else { panic!("{all:?}") };
        assert_eq!((&*paths[0].after, paths[0].ulp), ("NaN", None), "{paths:?}");
    }

    // Lesson 106
    #[test]
    fn functions_that_cannot_be_called_are_unchanged_or_unjudged() {
        let before = "fn add(x: ptr<function, atomic<u32>>) { let a = 1.0; }\n\
                      @compute @workgroup_size(1) fn nothing() { let x = 1.0; }\n";
        let untouched = changes(before, &format!("// a comment\n{before}"));
        assert_eq!(untouched.len(), 2, "{untouched:?}");
        assert!(untouched.iter().all(|(_, change)| *change == Change::Untouched), "{untouched:?}");
        let edited = changes(before, &before.replace("1.0", "2.0"));
        for (name, change) in &edited {
            let Change::Unjudged { reason } = change else { panic!("{name}: {change:?}") };
            let why = if name == "nothing" {
                "the pass writes no buffer or texture that Karat could compare"
            } else {
                "the function was edited, but "
            };
            assert!(reason.starts_with(why), "{reason}");
        }
    }

    #[test]
    fn another_pixel_that_is_discarded_is_a_change() {
        let before = "fn cut(x: f32) { if x < 0.5 { discard; } }\n\
                      @fragment fn fs(@location(0) x: f32) -> @location(0) vec4f { cut(x); return vec4f(x); }\n";
        let all = changes(before, &before.replace("0.5", "0.52"));
        assert_eq!(all.len(), 2);
        for (name, change) in &all {
            let Change::Changed { paths } = change else { panic!("{name}: {change:?}") };
            assert!(paths[0].after.contains("discarded: true"), "{name}: {paths:?}");
        }
        // The value of a discarded pixel isn't a result.
        let dead = before.replace("return vec4f(x);", "return vec4f(select(x, 7.0, x < 0.5));");
        let all = changes(before, &dead);
        let fs = all.iter().find(|(name, _)| name.ends_with("fs")).expect("a verdict");
        assert!(matches!(fs.1, Change::Same { .. }), "{all:?}");
        // Writes before a `discard` count.
        let writes = "@group(0) @binding(0) var<storage, read_write> n: atomic<u32>;\n\
                      @fragment fn fs(@location(0) x: f32) { if x < 0.5 { discard; } atomicAdd(&n, 1u); }\n";
        let edited =
            writes.replace("if x", "atomicAdd(&n, 1u); if x").replace("} atomicAdd(&n, 1u);", "}");
        let [(_, Change::Changed { paths })] = &changes(writes, &edited)[..] else { panic!() };
        assert!(paths[0].after.contains("discarded: true"), "{paths:?}");
        let plain = writes.replace("atomic<u32>", "f32").replace("atomicAdd(&n, 1u)", "n = x");
        let [(_, Change::Signature { before, after })] = &changes(writes, &plain)[..] else {
            panic!()
        };
        assert!(
            before.ends_with("writes n: u32") && after.ends_with("writes n: f32"),
            "{before} {after}"
        );
    }

    // Lesson 132
    #[test]
    fn a_changed_derivative_is_found() {
        let before = "struct Point { uv: vec2f, id: u32 }\n\
                      fn edge(d: f32) -> f32 { return d / max(fwidth(d), 1e-3); }\n\
                      fn slope(p: Point) -> f32 { return dpdx(p.uv.y) + f32(p.id); }\n\
                      fn plain(x: f32) -> f32 { return x; }\n";
        for (old, new) in [
            ("d / max(fwidth(d)", "d / max(2.0 * fwidth(d)"),
            ("dpdx(p.uv.y)", "dpdy(p.uv.y)"),
            ("return x;", "return x + dpdx(x);"),
        ] {
            for (was, is) in
                [(before, before.replace(old, new)), (&before.replace(old, new), before.to_owned())]
            {
                let all = changes(was, &is);
                let changed =
                    all.iter().filter(|(_, change)| matches!(change, Change::Changed { .. }));
                assert_eq!(changed.count(), 1, "{new}: {all:?}");
            }
        }
    }

    /// The edits of this test change no results, but the host must then supply resources differently.
    // Lesson 152
    // Lesson 200
    #[test]
    fn changed_bindings_and_layouts_are_reported() {
        let package = |text: &str| Package::from_source("p", text);
        let interface = |before: &str, from: &str, to: &str| {
            let request = Request::new(package(before), package(&before.replace(from, to)));
            let all = request.run().expect("compared");
            let one = all.into_iter().next_back().expect("a function");
            assert!(matches!(one.change, Change::Same { .. }), "{one:?}");
            one.interface
        };
        let buffer = "@group(0) @binding(4) var<storage> d: array<f32>;\n\
                      fn read(i: u32) -> f32 { return d[i]; }\n";
        let moved = interface(buffer, "binding(4)", "binding(5)");
        assert_eq!(
            moved,
            [
                "`d` is bound at @group(0) @binding(5), and was bound at @group(0) @binding(4) before the edit"
            ]
        );
        let textures = "@group(0) @binding(0) var a: texture_2d<f32>;\n\
                        @group(0) @binding(1) var b: texture_2d<f32>;\n\
                        fn f(i: u32) -> vec4f { return textureLoad(a, vec2u(i % 4u), 0)\n\
                        - textureLoad(b, vec2u(i % 4u), 0); }\n";
        let swapped = textures.replace("(1) var b", "(0) var b").replace("(0) var a", "(1) var a");
        assert_eq!(interface(textures, textures, &swapped).len(), 2);
        let aligned = "struct P { x: f32, y: f32 }\n@group(0) @binding(0) var<uniform> p: P;\n\
                       fn f(x: f32) -> f32 { return x * p.y; }\n";
        let moved = interface(aligned, "y: f32", "@align(16) y: f32");
        assert_eq!(
            moved,
            [
                "`p` needs 32 bytes now, and needed 8 bytes before the edit",
                "`p.y` is at byte 16, and was at byte 4 before the edit"
            ]
        );
        let space = interface(buffer, "var<storage>", "var<storage, read_write>");
        assert_eq!(space.len(), 1, "{space:?}");
        // A new name of a resource doesn't affect the host, and the resource keeps its contents.
        let renamed = buffer.replace("d: array", "data: array").replace("d[i]", "data[i]");
        assert_eq!(interface(buffer, buffer, &renamed), [""; 0]);
        let renamed = aligned.replace("> p:", "> params:").replace("p.y", "params.y");
        assert_eq!(interface(aligned, aligned, &renamed), [""; 0]);
    }

    /// Generated textures differ in size and number of levels. Numbers have the ranges in `karat.toml`. A number with
    /// the name of a cosine, such as `n_dot_l`, may be slightly above 1, because dot products are rounded.
    // Lesson 153
    #[test]
    fn generated_resources_reveal_edits() {
        let textures = "@group(0) @binding(0) var t: texture_2d<f32>;\n\
                        @group(0) @binding(1) var u: texture_2d<f32>;\n\
                        fn f(i: u32) -> vec2u { return textureDimensions(t); }\n\
                        fn g(l: u32) -> u32 { return textureNumLevels(t); }\n\
                        fn h(l: u32) -> vec2u { return textureDimensions(t, 0); }\n";
        for (from, to) in [
            ("textureDimensions(t)", "textureDimensions(u)"),
            ("textureNumLevels(t)", "textureNumLevels(u)"),
            ("textureDimensions(t, 0)", "textureDimensions(t, 1)"),
        ] {
            let all = changes(textures, &textures.replace(from, to));
            let changed = all.iter().filter(|(_, one)| matches!(one, Change::Changed { .. }));
            assert_eq!(changed.count(), 1, "{from} to {to}: {all:?}");
        }
        for (before, from, to) in [
            (
                "fn f(n_dot_l: f32) -> f32 { return n_dot_l; }",
                "return n_dot_l",
                "return min(n_dot_l, 1.0)",
            ),
            ("fn f(NoV: f32) -> f32 { return NoV; }", "return NoV", "return min(NoV, 1.0)"),
            ("fn f(count: u32) -> u32 { return count; }", "return count", "return min(count, 60u)"),
            (
                "struct P { k: u32 }\n@group(0) @binding(0) var<uniform> p: P;\n\
              fn f(x: u32) -> u32 { return p.k; }",
                "return p.k",
                "return max(p.k, 1u)",
            ),
            (
                "@group(0) @binding(0) var<storage> p: array<f32>;\n\
              fn f(x: u32) -> f32 { return p[x % 4u]; }",
                "return p[x % 4u]",
                "return min(p[x % 4u], 4.0)",
            ),
        ] {
            let all = changes(before, &before.replace(from, to));
            assert!(matches!(all[0].1, Change::Changed { .. }), "{to}: {all:?}");
        }
        let folder = |text: &str| {
            let folder = tempfile::tempdir().expect("a folder");
            std::fs::write(folder.path().join("m.wgsl"), text).expect("the file is written");
            std::fs::write(folder.path().join("karat.toml"), "[inputs]\nx = [1, 2]\n")
                .expect("ours");
            folder
        };
        let text = "fn f(x: f32) -> f32 { return x; }";
        let (before, after) =
            (folder(text), folder(&text.replace("return x", "return max(x, 1.0)")));
        let open =
            |folder: &tempfile::TempDir| Package::open(folder.path()).expect("the package opens");
        let compared = Request::new(open(&before), open(&after)).run().expect("compared").remove(0);
        assert!(matches!(compared.change, Change::Same { .. }), "{compared:?}");
        assert_eq!(compared.drawn.to_string(), "from 1 to 2: x");
        // An override keeps its value from `karat.toml`. A value for an override that neither package has is an error.
        let text = "override GAIN: f32 = 1.0;\nfn f(x: f32) -> f32 { return x * GAIN; }";
        let (before, after) = (folder(text), folder(&text.replace("return x", "return 2.0 * x")));
        for (declared, is_same) in
            [("GAIN = 0", Some(true)), ("GAIN = 1", Some(false)), ("GAYN = 1", None)]
        {
            let declared = format!("[overrides]\n{declared}\n");
            std::fs::write(after.path().join("karat.toml"), declared).expect("the file is written");
            let all = Request::new(open(&before), open(&after)).run();
            let same = all.as_ref().ok().map(|all| matches!(all[0].change, Change::Same { .. }));
            assert_eq!(same, is_same, "{all:?}");
        }
    }

    #[test]
    fn only_the_changed_elements_of_a_buffer_are_shown() {
        let before = "@group(0) @binding(0) var<storage, read_write> all: array<u32, 40>;\n\
                      fn put(i: u32) { all[3] = 1u; }\n";
        let all = changes(before, &before.replace("1u", "2u"));
        let Change::Changed { paths } = &all[0].1 else { panic!("{all:?}") };
        assert_eq!((&*paths[0].before, &*paths[0].after), ("[3] = 1", "[3] = 2"));
    }

    /// Nested loops may exceed the work budget of a function. Karat then runs only some of the inputs, and reports the
    /// number of the other inputs.
    #[test]
    fn the_work_of_a_function_is_bounded() {
        let text = |rounds: &str, step: &str| {
            format!(
                "fn f(x: f32) -> f32 {{
                    var sum = 0.0;
                    for (var i = 0u; i < {rounds}; i++) {{ for (var j = 0u; j < 64u; j++) {{ sum += {step}; }} }}
                    return sum;
                }}"
            )
        };
        // The edit doesn't change the loops' numbers of iterations.
        let one = compared(&text("64u", "x * f32(j)"), &text("64u", "f32(j) * x"));
        assert!(
            matches!(one.change, Change::Same { cases } if (64..1024).contains(&cases)),
            "{one:?}"
        );
        let Change::Same { cases } = one.change else { unreachable!() };
        assert_eq!(cases + one.cut, CASES);
        let changed = compared(&text("64u", "x * f32(j)"), &text("64u", "x * f32(j + 1u)"));
        let Change::Changed { paths } = &changed.change else { panic!("{changed:?}") };
        assert_eq!(paths[0].cases.1 + changed.cut, CASES);
        // All inputs run if the loop is short.
        let short = compared(&text("2u", "x * f32(j)"), &text("2u", "f32(j) * x"));
        assert_eq!((short.change, short.cut), (Change::Same { cases: CASES }, 0));
        // If too few inputs ran, there is no verdict "same". A change among them still counts.
        let one = compared(&text("900u", "x * f32(j)"), &text("900u", "f32(j) * x"));
        let Change::Unjudged { reason } = &one.change else { panic!("{one:?}") };
        assert!(reason.starts_with("Karat compared only "), "{reason}");
        assert!(reason.contains(" inputs of 4096, and found the same results"), "{reason}");
        let changed = compared(&text("900u", "x * f32(j)"), &text("900u", "x + f32(j)"));
        assert!(matches!(changed.change, Change::Changed { .. }) && changed.cut > 0, "{changed:?}");
        // If a loop no longer ends after the edit, the comparison reports it.
        let endless = compared(&text("2u", "x"), &text("2u", "x").replace("i++", "i += 0u"));
        let Change::Unjudged { reason } = &endless.change else { panic!("{endless:?}") };
        assert_eq!(
            reason,
            "after the edit, one of the function's loops runs too many iterations to compare, or doesn't end"
        );
    }

    #[test]
    fn each_verdict_is_printed_once_with_its_count() {
        let text: String =
            (0..9).map(|n| format!("fn f{n}x(x: f32) -> f32 {{ return x * {n}.5; }}\n")).collect();
        let [before, after] =
            [text.clone(), text.replace("3.5", "3.25")].map(|text| Package::from_source("p", text));
        let told = Mutex::new(Vec::new());
        let all = Request::new(before, after)
            .run_with(&|one, done, of| {
                told.lock().expect("whole").push((one.function.clone(), done, of));
            })
            .expect("compared");
        let mut told = told.into_inner().expect("whole");
        let counts: Vec<_> = told.iter().map(|(_, done, of)| (*done, *of)).collect();
        assert_eq!(counts, (1..=9).map(|done| (done, 9)).collect::<Vec<_>>());
        told.sort();
        let names: Vec<&String> = told.iter().map(|(name, ..)| name).collect();
        assert_eq!(names, all.iter().map(|one| &one.function).collect::<Vec<_>>());
    }

    // Lesson 106
    #[test]
    fn a_change_far_from_small_numbers_is_found() {
        let before = "fn hash(seed: u32) -> u32 { return seed * 747796405u; }\n\
                      fn f(x: f32) -> f32 { return x; }\n";
        let after = "fn hash(seed: u32) -> u32 {\n\
                     return select(seed * 747796405u, 1u, seed > 0x1000000u);\n}\n\
                     fn f(x: f32) -> f32 { return select(x, 0.0, abs(x) > 1000.0); }\n";
        let all = changes(before, after);
        assert_eq!(all.len(), 2);
        for (name, change) in &all {
            assert!(matches!(change, Change::Changed { .. }), "{name}: {change:?}");
        }
    }

    /// The comparison also tries values outside of the range that a parameter's name suggests: a negative `index`, or a
    /// `color` above 1.
    #[test]
    fn a_parameter_name_does_not_narrow_the_compared_values() {
        for (text, from, to) in [
            (
                "fn f(i: i32, n: i32) -> i32 { return ((i % n) + n) % n; }",
                "((i % n) + n) % n",
                "i % n",
            ),
            ("fn f(index: i32) -> i32 { return abs(index); }", "abs(index)", "index"),
            (
                "fn f(color: vec3f) -> vec3f { return min(color, vec3f(1.5)); }",
                "min(color, vec3f(1.5))",
                "color",
            ),
            (
                "fn f(normal: vec3f) -> vec3f { return normalize(normal); }",
                "normalize(normal)",
                "normal",
            ),
            ("fn f(a: f32, b: f32) -> f32 { return select(1.0, 2.0, a > b); }", "a > b", "a >= b"),
            (
                "struct P { albedo: f32 } @group(0) @binding(0) var<uniform> p: P;
                fn f(x: f32) -> f32 { return max(p.albedo, 0.0); }",
                "max(p.albedo, 0.0)",
                "p.albedo",
            ),
        ] {
            let one = compared(text, &text.replace(from, to));
            assert!(matches!(one.change, Change::Changed { .. }), "{to}: {one:?}");
        }
    }

    /// If a condition excludes edited code, Karat turns on the fewest features that include the code.
    #[test]
    fn edits_under_a_condition_are_compared_with_its_features_set() {
        let text = "@if(A) fn f(x: f32) -> f32 { return x; }
            fn g(x: f32) -> f32 {
                @if(B && C) { return 2.0 * x; }
                return x;
            }
            fn h(x: f32) -> f32 { return x; }";
        let under = |from: &str, to: &str| {
            let [before, after] =
                [text, &text.replace(from, to)].map(|text| Package::from_source("p", text));
            let all = Request::new(before, after).run().expect("compared");
            let of = |one: &Compared| (one.function.clone(), one.under.join(" "));
            let changed = all.iter().filter(|one| matches!(one.change, Change::Changed { .. }));
            let changed: Vec<_> = changed.map(of).collect();
            let rest = all.iter().filter(|one| matches!(one.change, Change::Untouched)).count();
            (changed, rest)
        };
        let of = |name: &str, features: &str| (name.to_owned(), features.to_owned());
        assert_eq!(
            under(
                "{ return x; }\
            fn g",
                "{ return 3.0 * x; }\
            fn g"
            ),
            (vec![], 2)
        );
        assert_eq!(
            under(
                "-> f32 { return x; }\
            fn g",
                ""
            ),
            (vec![], 2)
        );
        assert_eq!(
            under("f(x: f32) -> f32 { return x", "f(x: f32) -> f32 { return 3.0 * x"),
            (vec![of("f", "A")], 2)
        );
        assert_eq!(under("2.0 * x", "3.0 * x"), (vec![of("g", "B C")], 1));
        // A reversed condition with exchanged branches isn't an edit. A condition that only one package has is an edit.
        let swap =
            "fn f(x: f32) -> f32 {\n#ifdef A\n return 2.0 * x;\n#else\n return 3.0 * x;\n#endif\n}";
        let other = "fn f(x: f32) -> f32 {\n#ifndef A\n return 3.0 * x;\n#else\n return 2.0 * x;\n#endif\n}";
        assert_eq!(compared(swap, other).change, Change::Untouched);
        let new = "fn f(x: f32) -> f32 { @if(NEW) { return 2.0 * x; } return x; }";
        let old = "fn f(x: f32) -> f32 { return x; }";
        for (was, is) in [(old, new), (new, old)] {
            let one = compared(was, is);
            assert!(matches!(one.change, Change::Changed { .. }), "{one:?}");
            assert_eq!(one.under, ["NEW"]);
        }
        // If none of the tested sets of features includes an edit, the comparison reports this.
        let never = "@if(A && B && C && D && !E && !F) fn f(x: f32) -> f32 { return x; }\nfn g() -> f32 { return 1.0; }";
        let [before, after] = [never, &never.replace("return x", "return 2.0 * x")]
            .map(|text| Package::from_source("p", text));
        let all = Request::new(before, after).run().expect("compared");
        let hidden = all.iter().find(|one| one.function == "p").expect("the module is told");
        assert!(matches!(hidden.change, Change::Unjudged { .. }), "{all:?}");
    }

    /// The comparison matches the inputs of entry points by their attributes, and reports each change of the interface
    /// between shader and host.
    #[test]
    fn entry_points_are_compared_by_their_attributes() {
        let text = "struct I { @location(0) uv: vec2f, @location(1) n: vec3f }
            @fragment fn fs(i: I) -> @location(0) vec4f { return vec4f(i.uv, i.n.x, 1.0); }";
        let plain = "@fragment fn fs(@location(1) n: vec3f, @location(0) coord: vec2f) -> @location(0) vec4f {
            return vec4f(coord, n.x, 1.0);
        }";
        let one = compared(text, plain);
        assert!(matches!(one.change, Change::Same { .. }) && one.interface.is_empty(), "{one:?}");
        let one = compared(text, &plain.replace("n.x", "n.y"));
        assert!(
            matches!(one.change, Change::Changed { .. }) && one.interface.is_empty(),
            "{one:?}"
        );
        let more = text.replace("n: vec3f }", "n: vec3f, @location(2) k: f32 }");
        assert_eq!(compared(text, &more).interface, ["the input `i.k` with @location(2) is new"]);
        assert_eq!(
            compared(&more, text).interface,
            ["the input `i.k` with @location(2) is no longer used"]
        );
        let other = compared(text, &text.replace("n: vec3f }", "n: vec4f }"));
        assert!(matches!(other.change, Change::Signature { .. }), "{other:?}");
        let vs = "@vertex fn vs(@location(0) p: vec3f) -> @builtin(position) vec4f { return vec4f(p, 1.0); }";
        let one = compared(vs, &vs.replace("@builtin", "@invariant @builtin"));
        assert_eq!(one.interface.len(), 1, "{one:?}");
        let bound = format!("@group(0) @binding(3) var<uniform> q: f32;\n{text}");
        let uses = bound.replace("i.n.x", "i.n.x + 0.0 * q");
        assert_eq!(compared(&bound, &uses).interface, ["`q` at @group(0) @binding(3) is new"]);
        let lost = compared(&uses, &bound).interface;
        assert_eq!(lost, ["`q` at @group(0) @binding(3) is no longer used"]);
    }

    /// If an edit renames a structure or a member, or reorders the members, the results still count as the same.
    #[test]
    fn structures_are_compared_by_their_members() {
        let text = "struct Tmp { a: f32, b: vec2f }
            fn make(x: f32) -> Tmp { return Tmp(x, vec2f(x, 2.0 * x)); }
            fn sum(t: Tmp) -> f32 { return t.a + t.b.y; }";
        for edited in [
            text.replace("a: f32, b: vec2f", "b: vec2f, a: f32")
                .replace("Tmp(x, vec2f(x, 2.0 * x))", "Tmp(vec2f(x, 2.0 * x), x)"),
            text.replace("a: f32", "c: f32").replace("t.a", "t.c"),
            text.replace("Tmp", "Other"),
        ] {
            let all = changes(text, &edited);
            assert!(all.iter().all(|(_, change)| matches!(change, Change::Same { .. })), "{all:?}");
            let wrong = changes(text, &edited.replace("2.0 * x", "3.0 * x"));
            assert!(matches!(wrong[0].1, Change::Changed { .. }), "{wrong:?}");
        }
        let typed = changes(
            text,
            &text
                .replace("a: f32", "a: u32")
                .replace("Tmp(x,", "Tmp(1u,")
                .replace("t.a +", "f32(t.a) +"),
        );
        assert!(matches!(typed[0].1, Change::Signature { .. }), "{typed:?}");
    }

    /// The comparison reports edits that only a few inputs show, such as `<=` in place of `<`, and edits of an override
    /// that no function uses.
    #[test]
    fn rare_edits_of_guards_states_and_overrides_are_reported() {
        let guard = "@group(0) @binding(0) var<uniform> count: u32;
            @group(0) @binding(1) var<storage, read_write> d: array<f32>;
            @compute @workgroup_size(64) fn c(@builtin(global_invocation_id) id: vec3u) {
                if id.x < count && id.x < arrayLength(&d) { d[id.x] *= 2.0; }
            }";
        let one = compared(guard, &guard.replace("id.x < count", "id.x <= count"));
        assert!(matches!(one.change, Change::Changed { .. }), "{one:?}");
        let state = "var<private> s: u32 = 1u;\nfn next() -> u32 { s ^= s >> 17u; return s; }";
        assert!(matches!(
            compared(state, &state.replace("17u", "18u")).change,
            Change::Changed { .. }
        ));
        let texels = "@group(0) @binding(0) var t: texture_2d<f32>;
            @group(0) @binding(1) var s: sampler;
            @fragment fn f(@location(0) uv: vec2f, @builtin(position) p: vec4f) -> @location(0) vec4f {
                if textureSample(t, s, uv).a < 0.5 { discard; }
                return vec4f(select(1.0, 2.0, textureLoad(t, vec2u(p.xy), 0).r > 0.25));
            }";
        for (from, to) in [("< 0.5", "<= 0.5"), ("> 0.25", ">= 0.25"), ("> 0.25", "> 0.251")] {
            let one = compared(texels, &texels.replace(from, to));
            assert!(matches!(one.change, Change::Changed { .. }), "{to}: {one:?}");
        }
        // Private variables have their initial values at each call of an entry point.
        let entry = "var<private> n: u32;
            @fragment fn f() -> @location(0) vec4f { n += 1u; return vec4f(f32(n)); }";
        let one = compared(entry, &entry.replace("n += 1u", "n = 1u"));
        assert!(matches!(one.change, Change::Same { .. }), "{one:?}");
        let unused = "override LOD: f32 = 1.0;\nfn f() -> f32 { return 1.0; }";
        let [before, after] =
            [unused, &unused.replace("LOD", "BIAS")].map(|text| Package::from_source("p", text));
        let all = Request::new(before, after).run().expect("compared");
        assert!(all.iter().any(|one| one.interface.len() == 2), "{all:?}");
        let wanted = "override N: u32;
            @group(0) @binding(0) var<storage, read_write> d: array<u32>;
            @compute @workgroup_size(64) fn c(@builtin(global_invocation_id) id: vec3u) {
                if id.x < arrayLength(&d) { d[id.x] = N; }
            }";
        let one = compared(wanted, &wanted.replace("= N;", "= N + 1u;"));
        assert!(matches!(one.change, Change::Changed { .. }), "{one:?}");
        // A call of a function with an early `return` counts as covered, also after a conditional `discard`.
        let call = "fn a_pick(p: f32) -> f32 { if p > 0.0 { return 1.0; } return p; }
            @fragment fn fs(@location(0) x: f32) -> @location(0) vec4f {
                if x < 0.5 { discard; }
                var c = a_pick(x);
                return vec4f(c);
            }";
        let one = compared(call, &call.replace("var c", "var d").replace("vec4f(c)", "vec4f(d)"));
        assert!(matches!(one.change, Change::Same { .. }) && one.uncovered.is_empty(), "{one:?}");
    }

    /// The comparison reports changed overrides, and runs functions with other values than the defaults.
    #[test]
    fn overrides_are_compared() {
        let text = "@id(3) override A: f32 = 1.0;\nfn f(x: f32) -> f32 { return A * x; }";
        let told = |from: &str, to: &str| compared(text, &text.replace(from, to)).interface;
        assert_eq!(
            told("@id(3)", "@id(4)"),
            ["the override `A` is @id(4) f32 = 1.0, and was @id(3) f32 = 1.0 before the edit"]
        );
        assert_eq!(told("= 1.0", "= 2.0").len(), 1);
        assert_eq!(told("@id(3) override", "const").len(), 1, "the override no longer exists");
        let renamed = text.replace("A:", "B:").replace("A *", "B *");
        assert_eq!(compared(text, &renamed).interface.len(), 2);
        for text in [text, &text.replace(" = 1.0", "")] {
            let one = compared(text, &text.replace("A * x", "A * A * x"));
            let Change::Changed { paths } = &one.change else { panic!("{one:?}") };
            assert!(paths[0].arguments.iter().any(|(name, _)| name == "A"), "{paths:?}");
        }
        let given = text.replace("A * x", "select(x, 2.0 * x, A == 7.0)");
        let [before, after] =
            [&given, &given.replace("2.0", "3.0")].map(|text| Package::from_source("p", text));
        let request = Request::new(before, after);
        let all = request.clone().run().expect("compared");
        assert!(!matches!(all[0].change, Change::Changed { .. }), "{all:?}");
        let all = request.set_override("A", 7.0).run().expect("compared");
        assert!(matches!(all[0].change, Change::Changed { .. }), "{all:?}");
    }

    /// If one module can't be read, the functions of other modules are still compared.
    #[test]
    fn a_broken_module_is_reported_and_the_others_are_compared() {
        let package =
            |bad: &str, good: &str| Package::from_modules("p", [("bad", bad), ("good", good)]);
        let (bad, good) = ("fn f( {", "fn g(x: f32) -> f32 { return x; }");
        let edited = good.replace("return x", "return 2.0 * x");
        for (old, new, side) in [
            (bad, "fn g( {", "before and after the edit: "),
            (bad, "fn f() {}", "before the edit: "),
            ("fn f() {}", bad, "after the edit: "),
        ] {
            let all = Request::new(package(old, good), package(new, &edited))
                .run()
                .expect("the packages can be read");
            let Change::Unjudged { reason } = &all[0].change else { panic!("{all:?}") };
            assert!(all[0].function == "bad" && reason.starts_with(side), "{all:?}");
            assert!(matches!(all[1].change, Change::Changed { .. }), "{all:?}");
        }
        // A module that can't be read or linked, but has the same text in both packages, isn't an edit.
        let all = Request::new(package(bad, good), package(bad, good)).run().expect("compared");
        assert!(all.iter().all(|one| one.change == Change::Untouched), "{all:?}");
        let lacks = "fn f() -> f32 { return missing(); }";
        let all =
            Request::new(package(lacks, good), package(lacks, &edited)).run().expect("compared");
        assert_eq!(all[0].change, Change::Untouched, "{all:?}");
    }

    /// The value of a private variable is an input of the functions that read it, and a result of the functions that
    /// write it.
    #[test]
    fn private_state_is_an_input_and_a_result() {
        let left = "var<private> n: u32;\nvar<private> all: array<f32, 2>;
            fn put(x: f32) { n = 1u; all[1] = x; }
            fn user(x: f32) -> f32 { put(x); return x; }";
        for (from, to, shown) in
            [("n = 1u", "n = 2u", "n: 1"), ("n = 1u; ", "", "n: "), ("= x;", "= x + 1.0;", "all")]
        {
            let found = changes(left, &left.replace(from, to));
            for name in ["put", "user"] {
                let (_, change) = found.iter().find(|(own, _)| own == name).expect("a verdict");
                let Change::Changed { paths } = change else { panic!("{name}, {to}: {change:?}") };
                assert!(paths[0].before.contains(shown), "{name}, {to}: {paths:?}");
            }
        }
        let same = changes(left, &left.replace("n = 1u", "n = 3u - 2u"));
        assert!(same.iter().all(|(_, change)| matches!(change, Change::Same { .. })), "{same:?}");
        // A private variable that no function writes keeps its initial value. At a function's first call, all other
        // private variables have their initial values, too.
        let table = "var<private> table: array<f32, 3> = array(1.0, 2.0, 4.0);
            fn at(i: u32) -> f32 { return table[i % 3u]; }";
        let one = compared(table, &table.replace("4.0", "5.0"));
        let Change::Changed { paths } = &one.change else { panic!("{one:?}") };
        assert!(paths[0].arguments.iter().all(|(name, _)| name == "i"), "{paths:?}");
        let seed = "var<private> s: u32 = 7u;\nfn next() -> u32 { s = s * 5u + 1u; return s; }";
        let one = compared(seed, &seed.replace("7u", "8u"));
        let Change::Changed { paths } = &one.change else { panic!("{one:?}") };
        assert_eq!((&*paths[0].before, &*paths[0].after), ("36", "41"));
        // The override and the private variable decide about different branches. The tests cover both branches.
        let both =
            "var<private> on: bool;\nfn f(x: f32) -> f32 { if on { return x; } return x + 1.0; }";
        let one = compared(both, &both.replace("return x; }", "return 1.0 * x; }"));
        assert!(matches!(one.change, Change::Same { .. }) && one.uncovered.is_empty(), "{one:?}");

        let text = "var<private> state: vec2u;
            fn next() -> f32 { return f32(state.x % 1000u) * sin(f32(state.y)); }";
        let one = compared(text, &text.replace("sin", "tan"));
        let Change::Changed { paths } = &one.change else { panic!("{one:?}") };
        assert!(
            paths[0]
                .arguments
                .iter()
                .any(|(name, value)| name == "state" && value.starts_with('(')),
            "{paths:?}"
        );
        assert!(matches!(
            compared(text, &text.replace("1000u", "1000u * 1u")).change,
            Change::Same { .. }
        ));
    }

    /// A feature that a condition compares with a number gets this number. If the edit has no effect with this number,
    /// the feature gets the next smaller and the next larger number.
    #[test]
    fn features_without_a_value_get_a_value_from_their_conditions() {
        let text = "#if LIGHTS > 2\nfn f(x: f32) -> f32 { return x + 1.0; }\n#else\n\
                    fn f(x: f32) -> f32 { return x; }\n#endif\n\
                    fn g(x: f32) -> f32 { return x * #{COUNT}.0; }\n";
        for (from, to, name, under) in [
            ("return x;", "return -x;", "f", vec!["COUNT=4", "LIGHTS=2"]),
            ("x + 1.0", "x + 2.0", "f", vec!["LIGHTS=3", "COUNT=4"]),
            ("x * #", "2.0 * x * #", "g", vec!["COUNT=4", "LIGHTS=2"]),
        ] {
            let package = |text: &str| Package::from_source("p", text);
            let all = Request::new(package(text), package(&text.replace(from, to)));
            let all = all.run().expect("compared");
            let told: Vec<_> = all.iter().filter(|one| one.change != Change::Untouched).collect();
            let [one] = &*told else { panic!("{to}: {all:?}") };
            assert!(matches!(one.change, Change::Changed { .. }), "{to}: {one:?}");
            assert_eq!(
                (&*one.function, &one.under),
                (name, &under.iter().map(|name| (*name).to_owned()).collect()),
                "{to}"
            );
        }
        let same = changes(text, &text.replace("x + 1.0", "1.0 + x"));
        assert!(matches!(same[0].1, Change::Same { .. }), "{same:?}");
    }

    /// If Karat can't compare the function with a setting of the overrides, this setting covers no line. If a setting
    /// leads to a violation, Karat reports the verdict with this setting.
    #[test]
    fn a_setting_that_cannot_be_judged_covers_no_line() {
        let line = || Uncovered {
            place: "f.wgsl:1:1".to_owned(),
            text: "return 1.0;".to_owned(),
            missed: Missed::Line,
        };
        let of = |change| Compared { uncovered: vec![line()], ..Compared::of("f", change) };
        let mut one = of(Change::Same { cases: 9 });
        one.take(Compared::of("f", Change::Unjudged { reason: "no".to_owned() }));
        one.take(of(Change::Same { cases: 9 }));
        assert_eq!(one.uncovered, [line()]);
        let access = Violation::new("f", Kind::OutOfRange, ("outside".to_owned(), 1), Vec::new());
        let mut worse = one.clone();
        let same = Compared::of("f", Change::Same { cases: 9 });
        worse.take(Compared { violations: vec![access], ..same.clone() });
        assert!(!worse.is_open() && worse.violations.len() == 1);
        one.take(same);
        assert!(one.is_open() && one.uncovered.is_empty());
    }

    /// The comparison finds edits under several conditions with different numbers. Both versions get the same values of
    /// features.
    #[test]
    fn edits_under_several_numeric_conditions_are_compared() {
        let package =
            |text: &str| Package::from_source("p", format!("#define_import_path p\n{text}"));
        let body = "fn f(x: f32) -> f32 {\nOPEN\nreturn x + 1.0;\nCLOSE\nreturn x;\n}\n";
        for conditions in [
            vec!["#if A > 1", "#if B > 2"],
            vec!["#ifdef A", "#if B > 2"],
            vec!["#if A < 2", "#if B < 3"],
            vec!["#if A != 2", "#if B != 3"],
            vec!["#if A > 1", "#if B > 2", "#if C > 3"],
        ] {
            let close = vec!["#endif"; conditions.len()].join("\n");
            let text = body.replace("OPEN", &conditions.join("\n")).replace("CLOSE", &close);
            let all = Request::new(package(&text), package(&text.replace("+ 1.0", "+ 2.0")));
            let all = all.run().expect("compared");
            assert!(matches!(all[0].change, Change::Changed { .. }), "{conditions:?}: {all:?}");
        }
        let chain =
            "fn f(x: f32) -> f32 {\n#if N > 2\nreturn x + 1.0;\n#else\nreturn x;\n#endif\n}\n";
        let longer = chain.replace("#if N > 2", "#if N == 200\nreturn x;\n#else if N > 2");
        let all = Request::new(package(chain), package(&longer)).run().expect("compared");
        assert!(matches!(all[0].change, Change::Changed { .. }), "{all:?}");
        assert_eq!(all[0].under, ["N=200"]);
        let divided = "fn f(i: u32) -> u32 { return i / #{N}u; }";
        let all = Request::new(package(divided), package(&divided.replace("/ #{N}u", ">> 2u")));
        let all = all.run().expect("compared");
        assert!(matches!(all[0].change, Change::Changed { .. }), "{all:?}");
    }

    /// Tests private variables that only one package declares, that an edit renamed, or that are too large to compare.
    #[test]
    fn added_removed_and_large_private_variables_are_compared() {
        let scratch = "var<private> t: f32;\nfn f(x: f32) -> f32 { t = x * 2.0; return t + 1.0; }";
        let without = "fn f(x: f32) -> f32 { let t = x * 2.0; return t + 1.0; }";
        for [before, after] in [[scratch, without], [without, scratch]] {
            let one = compared(before, after);
            assert!(matches!(one.change, Change::Same { .. }), "{one:?}");
        }
        let renamed = scratch.replace("t;", "scratch;").replace("t:", "scratch:");
        let renamed = renamed.replace("t =", "scratch =").replace("return t", "return scratch");
        let renamed = renamed.replace("returscratch", "return").replace("> t", "> scratch");
        let one = compared(scratch, &renamed);
        assert!(matches!(one.change, Change::Same { .. }), "{renamed}: {one:?}");
        let one = compared(
            scratch,
            &renamed.replace(
                "x * 2.0; return scratch",
                "x * 3.0 - x; scratch += 1.0; return scratch - 1.0",
            ),
        );
        assert!(matches!(one.change, Change::Changed { .. }), "{one:?}");
        let large = "var<private> a: array<f32, 5000>;\nfn put(i: u32, x: f32) -> f32 { a[i % 5000u] = x; return x; }";
        let one = compared(large, &large.replace("i %", "(i + 9u) %"));
        let Change::Unjudged { reason } = &one.change else { panic!("{one:?}") };
        assert!(reason.contains("its 5000 numbers are too many"), "{reason}");
        // If two variables have the same name, the comparison uses their paths.
        let modules = |a: &str| {
            let b = "var<private> s: u32;\nfn g() -> u32 { s = s + 1u; return s; }";
            Package::from_modules("p", [("a", a), ("b", b)])
        };
        let a = "import package::b::g;\nvar<private> s: u32;\nfn f() -> u32 { s = s + 2u; return s + g(); }";
        let all =
            Request::new(modules(a), modules(&a.replace("2u", "3u"))).run().expect("compared");
        let Change::Changed { paths } = &all[0].change else { panic!("{all:?}") };
        let named: Vec<&str> = paths[0].arguments.iter().map(|(name, _)| &**name).collect();
        assert!(named.iter().all(|name| name.starts_with("private ")), "{named:?}");
        let pointer = "fn f(p: ptr<private, u32>) { *p = 1u; }";
        let one = compared(pointer, &pointer.replace("private", "function"));
        assert!(matches!(one.change, Change::Signature { .. }), "{one:?}");
    }

    /// If the engine can't run one of the two versions, the comparison reports that coverage is unknown.
    // Lesson 88
    #[test]
    fn unmeasured_coverage_is_reported() {
        let mut both = Both::default();
        assert!(both.uncovered("f.wgsl:1:1").is_empty(), "no run was measured");
        let [before, after] = [0, 1];
        note(&mut both.measured[after], Err("no rule for it\nmore".to_owned()));
        note(&mut both.measured[before], Ok(()));
        let told = both.uncovered("f.wgsl:1:1");
        assert_eq!((&*told[0].place, &*told[0].text), ("f.wgsl:1:1", "no rule for it"));
        assert_eq!(told[0].missed, Missed::Unmeasured);
        note(&mut both.measured[after], Ok(()));
        note(&mut both.measured[after], Err("another content".to_owned()));
        assert!(both.uncovered("f.wgsl:1:1").is_empty(), "one run of each version was measured");
        // The engine stopped early, so later code may still use an index outside of an array.
        both.unknown = Some("it ran too long".to_owned());
        assert_eq!(both.uncovered("f.wgsl:1:1")[0].missed, Missed::Unmeasured);
    }

    /// If edited code is invalid, or is in an invalid module, Karat reports that it can't compare this code.
    // Lesson 88
    #[test]
    fn edits_that_cannot_be_read_are_unjudged() {
        let of = |before: &str, after: &str| {
            let package = |text: &str| Package::from_modules("p", [("m", text)]);
            let all = Request::new(package(before), package(after)).run().expect("compared");
            let unjudged = |one: &Compared| matches!(one.change, Change::Unjudged { .. });
            let found = all.iter().find(|one| unjudged(one)).unwrap_or_else(|| panic!("{all:?}"));
            format!("{}: {:?}", found.function, found.change)
        };
        let sound = "fn f(x: f32) -> f32 { return x; }\n#ifdef SHADOWS\nfn g() -> f32 { return 1.0; }\n#endif\n";
        let told = of(sound, &sound.replace("1.0; }", "1.0;"));
        assert!(told.contains("m: ") && told.contains("after the edit: with SHADOWS: "), "{told}");
        // In an invalid module, Karat can't compare the interface with the host.
        let invalid = "@id(3) override size: u32 = 4u;\nfn broken() -> f32 { return missing; }\n";
        for (from, to) in [("4u", "8u"), ("@id(3)", "@id(4)")] {
            let told = of(invalid, &invalid.replace(from, to));
            assert!(told.contains("m: ") && told.contains("the module's overrides: "), "{told}");
        }
    }

    /// After a `discard`, statements have no visible effect, so they don't count as covered.
    #[test]
    fn lines_behind_a_discard_are_not_reached() {
        let text = "fn cut(x: f32) { if x * x >= 0.0 { discard; } }
            @fragment fn fs(@location(0) x: f32) -> @location(0) vec4f {
                cut(x);
                let y = 2.0 * x;
                return vec4f(y);
            }";
        let one = compared(text, &text.replace("2.0 *", "3.0 *"));
        let lines: Vec<&str> = one.uncovered.iter().map(|line| line.text.as_str()).collect();
        assert_eq!(lines, ["let y = 3.0 * x;", "let y = 2.0 * x;"], "{one:?}");
        let some = text.replace(">= 0.0", ">= 4.0");
        let same = compared(&some, &some.replace("2.0 * x", "x * 2.0"));
        assert!(
            matches!(same.change, Change::Same { .. }) && same.uncovered.is_empty(),
            "{same:?}"
        );
    }

    /// Karat shows a change by a case with finite numbers, and leaves out inputs that don't affect the change.
    #[test]
    fn a_change_is_shown_with_plain_numbers_and_relevant_inputs() {
        let text = "struct P { scale: f32, unused: f32 }
            @group(0) @binding(0) var<uniform> p: P;
            fn f(roughness: f32, k: f32, other: f32) -> f32 { return p.scale * roughness / k + 0.0 * p.unused; }";
        let one = compared(text, &text.replace("roughness / k", "roughness * roughness / k"));
        let Change::Changed { paths } = &one.change else { panic!("{one:?}") };
        let names: Vec<&str> = paths[0].arguments.iter().map(|(name, _)| name.as_str()).collect();
        assert!(!names.contains(&"other"), "{paths:?}");
        let shown = |text: &str| text.parse::<f32>().expect("a number");
        assert!(
            shown(&paths[0].before).is_finite() && shown(&paths[0].after).is_finite(),
            "{paths:?}"
        );
        let value = paths[0]
            .arguments
            .iter()
            .find(|(name, _)| name == "roughness")
            .expect("`roughness` affects the results");
        assert!((0.0..=1.0).contains(&shown(&value.1)), "within the range of its name: {paths:?}");
    }
}
