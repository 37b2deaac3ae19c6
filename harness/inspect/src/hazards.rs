//! Finds hazards in functions without a test: values that become NaN or infinite, lost digits, indices outside of
//! arrays, and operations for which WGSL bounds no error.
//!
//! Karat's engine runs each function of a package in `f32`, in `f64` and in interval arithmetic. The arguments follow
//! from declarations, names and types (see [`made_up`](mod@crate::made_up)). Karat reports each finding at its origin:
//! the operation whose operands were still good.
//!
//! To classify a finding, Karat runs the function again, with the declared inputs of a failing case and new samples of
//! the free inputs. If the operation goes wrong in every sample that reaches it, the finding is a *fault*. If the
//! operation runs without the error in at least one sample, the finding is a *requirement*. Declared inputs are those
//! in `[inputs]` of `karat.toml`. In a function without callers, inputs whose names suggest a range are declared, too.
//! If a function has callers, a finding counts only if its operation also goes wrong when Karat runs the callers.
//!
//! ```no_run
//! use karat::prelude::*;
//!
//! static SHADERS: Package = karat::package!("shaders");
//!
//! // #[test]
//! fn no_hazards() {
//!     let hazards = karat_inspect::hazards(&SHADERS).run().unwrap();
//!     assert_eq!(hazards.faults().count(), 0, "{hazards}");
//! }
//! ```

mod callers;
mod function;
mod passes;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::sync::{Mutex, PoisonError};

use karat::package::{Package, PackageError};
use karat::unstable::dispatch::{Violation, ViolationAccess};
use karat::unstable::interpret::hazards::{Found, Missing};
use karat::unstable::package::{
    AcceptedHazard, FunctionItem, Stage, declared_hazards, is_crate, place_of_input,
    place_of_override, scope,
};
use karat::unstable::probe::Probed;
use karat::unstable::reflect::{Program, ReflectError};
use karat_core::diagnostic::{Span, nearest};
use karat_core::output::counted;
use karat_core::panics;
use karat_core::value::format_f32;
use serde::Serialize;

use crate::limits::{CASES, MET, MOST_STATE};
use crate::made_up::{Drawn, Ranges};
use callers::Callers;
use function::Trial;

use rayon::prelude::*;

pub use karat::unstable::interpret::hazards::Kind;

/// A search for hazards and its settings.
///
/// ```
/// # use karat::prelude::*;
/// let package = Package::from_source("m", "fn inverse(x: f32) -> f32 { return 1.0 / x; }");
/// let hazards = karat_inspect::hazards(&package).input("x", 0.0..=1.0).run()?;
/// assert_eq!(hazards.found[0].text, "1.0 / x");
/// # Ok::<(), karat_inspect::hazards::HazardError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Request {
    package: Package,
    only: Vec<String>,
    cases: usize,
    inputs: Vec<(String, f64, f64)>,
    overrides: BTreeMap<String, f64>,
    with_accepted: bool,
}

/// The class of a finding: a fault of the shader, a requirement on its inputs, or neither.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Class {
    /// The operation goes wrong in every sample of the free inputs that reaches it.
    Fault,
    /// The operation runs without the error in at least one sample, or too few samples reach the operation.
    Requirement,
    /// The function's callers meet the requirement: in at least 256 of their calls, the operation ran without an error.
    Met,
    /// The function's callers rarely or never reach the operation: in fewer than 256 of their calls.
    NotReached,
    /// In every case, a `select`, a branch, or an operation such as `clamp` drops the wrong value.
    Dropped,
}

impl Class {
    /// The class's name in reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fault => "fault",
            Self::Requirement => "requirement",
            Self::Met => "met",
            Self::NotReached => "not reached",
            Self::Dropped => "dropped",
        }
    }
}

/// An operation that goes wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Hazard {
    /// The finding's class.
    pub class: Class,
    /// The worst kind of error that occurs.
    pub kind: Kind,
    /// The other kinds of error that the same operation has for other inputs.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub kinds: Vec<Kind>,
    /// The operation's position in the author's file.
    pub location: String,
    /// The operation's text.
    pub text: String,
    /// The function that Karat called.
    pub function: String,
    /// The arguments in the simplest case.
    pub arguments: Vec<(String, String)>,
    /// The number of cases in which the operation goes wrong, and the number of cases that reached it. For a pass, each
    /// content (a set of generated values of its resources) counts as one case.
    pub cases: (usize, usize),
    /// For a requirement: the inputs that can avert the error in the simplest case. A change of any one of these inputs
    /// suffices.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub needs: Vec<String>,
    /// The condition under which the operation goes wrong, if it is a simple one, such as `where k is 0`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fails: Option<String>,
    /// For lost digits: the operation's value in the simplest case, computed in `f32` and in `f64`.
    pub values: Option<(String, String)>,
    /// The operation's operands in the simplest case, in `f32`. Empty if the operands aren't floats, or if there are
    /// too many to show.
    pub operands: Vec<String>,
    /// The reason why `karat.toml` accepts the finding, if accepted findings were requested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accepted: Option<String>,
    /// The other functions in which the same operation goes wrong.
    pub also: Vec<String>,
    /// The details of a sanitizer's finding in a compute pass, or of a derivative that one pixel reaches and its
    /// neighbour doesn't.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub violation: Option<Violation>,
}

/// The progress of a search, after each checked function.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'p> {
    /// The function's name.
    pub function: &'p str,
    /// The number of findings in the function itself, before Karat looks at the function's callers.
    pub found: usize,
    /// The number of checked functions so far.
    pub done: usize,
    /// The number of functions in the search.
    pub of: usize,
}

/// The result of a search for hazards in a package.
#[derive(Clone, Debug, Serialize)]
pub struct Hazards {
    /// The version of this data format. Since version 2, each finding has a class.
    pub schema: u32,
    /// The package's name.
    pub package: String,
    /// The number of checked functions.
    pub functions: usize,
    /// The functions that weren't checked and the modules that can't be read, each with the reason.
    pub skipped: Vec<(String, String)>,
    /// The number of modules that can't be read. Their functions are unknown.
    pub unread: usize,
    /// The number of functions that aren't valid WGSL, or use invalid code.
    pub invalid: usize,
    /// Faults and requirements, one for each operation and kind of error. Faults come before requirements. Within each
    /// class, the worst kinds come first.
    pub found: Vec<Hazard>,
    /// The findings of the other classes: requirements that the callers meet, findings that the callers don't reach,
    /// and findings whose wrong value is dropped.
    pub others: Vec<Hazard>,
    /// The functions for which `karat.toml` accepts a fault that Karat doesn't find. You can remove these
    /// acceptances.
    pub needless: Vec<String>,
    /// The number of findings that are left out because `karat.toml` accepts them.
    pub accepted: usize,
    /// The ranges from which arguments and members were sampled.
    pub drawn: Drawn,
    /// The parts of the checked functions that Karat couldn't check.
    pub unseen: Unseen,
    /// The lines with operations that no input reached, as `file:line`.
    pub unreached: Vec<String>,
}

/// The parts of functions that Karat couldn't check.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Unseen {
    /// The number of inputs for which Karat didn't run the function, because of long loops or too many operations.
    pub inputs: usize,
    /// The number of functions with such inputs.
    pub functions: usize,
    /// The number of functions in which Karat checked only some of the operations: it records at most 4,096 operations
    /// in a run of 256 inputs.
    pub in_part: usize,
    /// The number of functions that read a private variable with more than 256 numbers. Such a variable keeps its
    /// initial value.
    pub of_state: usize,
}

/// The reason why a search has no result.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HazardError {
    /// The package can't be read.
    #[error(transparent)]
    Package(#[from] PackageError),
    /// No function was checked, so there is no verdict.
    #[error("Karat can't check any function of package `{package}`{}", first(skipped))]
    Nothing {
        /// The package.
        package: String,
        /// The functions that weren't checked, each with the reason.
        skipped: Vec<(String, String)>,
    },
    /// The range of an input is declared, but no function has this input.
    #[error(
        "the input `{name}` is declared, but no checked function has an argument or reads a \
         member with this name{}{place}", nearest.as_ref().map_or_else(String::new, |near| format!("; did you mean `{near}`?"))
    )]
    UnknownInput {
        /// The input's name.
        name: String,
        /// The input with the most similar name.
        nearest: Option<String>,
        /// The declaration's position, ` (karat.toml:3:1)`, if it is in a file.
        place: String,
    },
    /// A declaration contradicts itself or the package.
    #[error("{0}")]
    Declaration(String),
}

fn first(skipped: &[(String, String)]) -> String {
    skipped.first().map_or_else(String::new, |(name, why)| format!(": `{name}`: {why}"))
}

/// Makes a search for hazards in all functions that Karat can call directly.
///
/// ```no_run
/// use karat::Package;
///
/// static SHADERS: Package = karat::package!("shaders");
///
/// let hazards = karat_inspect::hazards(&SHADERS).run()?;
/// assert_eq!(hazards.faults().count(), 0, "{hazards}");
/// # Ok::<(), karat_inspect::hazards::HazardError>(())
/// ```
#[must_use]
pub fn hazards(package: &Package) -> Request {
    let (only, inputs, overrides) = Default::default();
    Request {
        package: package.clone(),
        only,
        cases: CASES,
        inputs,
        overrides,
        with_accepted: false,
    }
}

impl Request {
    /// Selects the functions with one of these strings in their names.
    #[must_use]
    pub fn only<'n>(self, names: impl IntoIterator<Item = &'n str>) -> Self {
        Self { only: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    /// Sets the number of inputs for each function. The default is 1,024.
    #[must_use]
    pub fn cases(self, cases: usize) -> Self {
        Self { cases, ..self }
    }

    /// Includes the findings that `karat.toml` accepts.
    #[must_use]
    pub fn with_accepted(self) -> Self {
        Self { with_accepted: true, ..self }
    }

    /// Declares the range of all arguments and members with this name.
    #[must_use]
    pub fn input(mut self, name: &str, range: std::ops::RangeInclusive<f64>) -> Self {
        let (least, most) = range.into_inner();
        self.inputs.push((name.to_owned(), least, most));
        self
    }

    /// Sets the value of an `override`, by its name or its `@id`, in each function that uses it.
    #[must_use]
    pub fn with_override(mut self, name: &str, value: f64) -> Self {
        self.overrides.insert(name.to_owned(), value);
        self
    }

    /// Runs the search.
    ///
    /// # Errors
    /// Returns an error if the package can't be read, if Karat can check no function, or if a declaration is wrong.
    pub fn run(&self) -> Result<Hazards, HazardError> {
        self.run_with(&|_| {})
    }

    /// Does the same as [`run`](Self::run), and calls `progress` after each checked function.
    ///
    /// # Errors
    /// Returns the same errors as [`run`](Self::run).
    pub fn run_with(
        &self,
        progress: &(dyn Fn(&Progress<'_>) + Sync),
    ) -> Result<Hazards, HazardError> {
        let declared = declared_hazards(&self.package)?;
        let mut inputs = Ranges::of(&self.package)?;
        for (name, least, most) in &self.inputs {
            inputs.declare(name, *least, *most).map_err(HazardError::Declaration)?;
        }
        self.overrides.iter().for_each(|(name, value)| inputs.set_override(name, *value));
        if let Some((name, wrong)) = Program::unfit(&[&self.package], inputs.overrides()) {
            let place = place_of_override(&self.package, &name);
            return Err(HazardError::Declaration(format!("{wrong}{place}")));
        }
        let wanted = |name: &str| {
            self.only.is_empty() || self.only.iter().any(|part| name.contains(part.as_str()))
        };
        let mut names = Vec::new();
        let mut skipped = Vec::new();
        for module in self.package.modules()? {
            match self.package.functions_in(&module) {
                Ok(items) => names.extend(items),
                Err(error) => skipped.push((module, first_line(&error.to_string()))),
            }
        }
        let (unread, mut invalid) = (skipped.len(), 0);
        names.retain(|item| wanted(&item.name));
        if names.is_empty() && !self.only.is_empty() {
            let only = self.only.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>();
            let (package, only) = (self.package.name(), only.join(" or "));
            let why = format!("no function of package `{package}` has {only} in its name");
            return Err(HazardError::Declaration(why));
        }
        let callers = Callers::of(&self.package);
        let done = Mutex::new(0);
        let all = names.len();
        let each: Vec<(String, Result<Seen, String>)> = names
            .par_iter()
            .map(|item| {
                let own =
                    if callers.calls(&item.name) { inputs.clone() } else { inputs.with_names() };
                let look = || self.look(item, &own);
                let seen = panics::caught(look).unwrap_or_else(|panicked| {
                    Err(format!("Karat panics while it checks the function: {panicked}"))
                });
                // The lock stays until the report, so that the counts are reported in order.
                let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
                *done += 1;
                let found = seen.as_ref().map_or(0, |seen| seen.hazards.len());
                progress(&Progress { function: &item.name, found, done: *done, of: all });
                (item.name.clone(), seen)
            })
            .collect();
        let mut drawn = Drawn::default();
        let mut unseen = Unseen::default();
        let mut looked: BTreeMap<String, Seen> = BTreeMap::new();
        let mut names_of = BTreeMap::new();
        for (name, seen) in each {
            match seen {
                Err(why) => {
                    let not_valid = self.invalid(&name);
                    invalid += usize::from(not_valid.is_some());
                    skipped.push((name, not_valid.unwrap_or(why)));
                }
                Ok(mut seen) => {
                    unseen.inputs += seen.cut;
                    unseen.functions += usize::from(seen.cut > 0);
                    unseen.in_part += usize::from(seen.in_part);
                    unseen.of_state += usize::from(seen.of_state);
                    let own = seen.drawn.names().into_iter().map(str::to_owned);
                    names_of.insert(name.clone(), own.collect::<BTreeSet<String>>());
                    drawn.merge(std::mem::take(&mut seen.drawn));
                    looked.insert(name, seen);
                }
            }
        }
        let (package, functions) = (self.package.name(), looked.len());
        if functions == 0 {
            return Err(HazardError::Nothing { package, skipped });
        }
        if self.only.is_empty() {
            self.expect_names(&inputs, &drawn, &names_of, (&names, &skipped))?;
        }
        let names: BTreeSet<&str> = looked.keys().map(String::as_str).collect();
        let roots: BTreeMap<String, BTreeSet<String>> = names
            .iter()
            .map(|name| {
                let roots = callers.roots(name, &names).into_iter().map(str::to_owned);
                ((*name).to_owned(), roots.collect())
            })
            .collect();
        looked.par_iter_mut().for_each(|(name, seen)| {
            if roots[name].contains(name) {
                seen.judge();
            }
        });
        let mut all = judged(&roots, &looked);
        let mut needless = Vec::new();
        for accepted in &declared.accepted {
            if self.only.is_empty() {
                accepted.expect_current(&all)?;
                let mut covered = all.iter().filter(|hazard| accepted.covers(hazard));
                if covered.all(|hazard| hazard.class != Class::Fault) {
                    needless.push(accepted.functions.join(", "));
                }
            }
            for hazard in all.iter_mut().filter(|hazard| accepted.covers(hazard)) {
                hazard.accepted.get_or_insert_with(|| accepted.reason.clone());
            }
        }
        let is_told = |one: &Hazard| matches!(one.class, Class::Fault | Class::Requirement);
        let accepted = all.iter().filter(|one| is_told(one) && one.accepted.is_some()).count();
        if !self.with_accepted {
            all.retain(|hazard| hazard.accepted.is_none());
        }
        all.sort_by(|a, b| {
            let order = (a.class, a.kind).cmp(&(b.class, b.kind));
            order.then_with(|| a.location.cmp(&b.location))
        });
        let (mut found, others): (Vec<Hazard>, Vec<Hazard>) = all.into_iter().partition(is_told);
        // Searching for inputs that avert a finding takes many runs, so only reported findings get them.
        found.par_iter_mut().filter(|one| one.class == Class::Requirement).for_each(|hazard| {
            if let Some(needs) = looked.get(&hazard.function).and_then(|seen| seen.needs(hazard)) {
                hazard.needs = needs;
            }
        });
        let unreached = unreached(looked.values());
        Ok(Hazards {
            schema: Hazards::SCHEMA,
            package,
            functions,
            skipped,
            unread,
            invalid,
            found,
            others,
            needless,
            accepted,
            drawn,
            unseen,
            unreached,
        })
    }

    /// Checks that each declaration applies to an input.
    fn expect_names(
        &self,
        inputs: &Ranges,
        drawn: &Drawn,
        looked: &BTreeMap<String, BTreeSet<String>>,
        (names, skipped): (&[FunctionItem], &[(String, String)]),
    ) -> Result<(), HazardError> {
        let used = drawn.names();
        let is_met = |name: &&String| match scope(name) {
            (Some(function), own) => {
                looked.get(function).is_some_and(|own_names| own_names.contains(own))
            }
            (None, own) => used.contains(own),
        };
        let Some(name) = inputs.names().find(|name| !is_met(name)) else { return Ok(()) };
        let place = place_of_input(&self.package, name);
        // If the declared range fits no value of an input, its function is skipped. Without the declaration, the
        // function isn't skipped, or is skipped for another reason.
        let without = inputs.without(name);
        let blamed = names.iter().find_map(|item| {
            let (_, why) = skipped.iter().find(|(name, _)| *name == item.name)?;
            let [with, without] = [inputs, &without].map(|all| self.look(item, all).err());
            (with != without).then(|| format!("{}: {why}{place}", item.name))
        });
        if let Some(why) = blamed {
            return Err(HazardError::Declaration(why));
        }
        let (_, own) = scope(name);
        let none = match own.split_once('(') {
            Some(("length", _)) => "no function uses a runtime-sized array with this name",
            Some(("workgroups", _)) => "no checked compute pass has this name",
            _ => "",
        };
        if !none.is_empty() {
            let why = format!("`{name}` is declared, but {none}{place}");
            return Err(HazardError::Declaration(why));
        }
        let known = used.iter().copied().chain(looked.keys().map(String::as_str));
        let nearest = nearest(name, known).map(str::to_owned);
        Err(HazardError::UnknownInput { name: name.clone(), nearest, place })
    }

    /// If naga rejects a function or code that the function uses, returns the reason and the position. Returns `None`
    /// for the shaders of a crate, because these shaders may need abilities that only the crate's renderer enables.
    fn invalid(&self, name: &str) -> Option<String> {
        let (module, own) = name.rsplit_once("::").unwrap_or(("", name));
        let linked = || Program::of_items(&self.package, module, &[own]);
        match (!is_crate(&self.package)).then(linked)? {
            Err(ReflectError::Invalid(found)) => {
                let place = found.location().map_or_else(String::new, |at| format!(" ({at})"));
                Some(first_line(&found.to_string()) + &place)
            }
            _ => None,
        }
    }

    fn look(&self, item: &FunctionItem, ranges: &Ranges) -> Result<Seen, String> {
        let name = &*item.name;
        if item.entry_point == Some(Stage::Compute) {
            return passes::look(&self.package, name, ranges);
        }
        let text = |error: &dyn fmt::Display| first_line(&error.to_string());
        let overrides = ranges.overrides_of(&self.package, name);
        let program = Program::of_function(&self.package, name).map_err(|error| text(&error))?;
        let mut state = program.state_of(name);
        let large = state.extract_if(.., |_, variable| variable.lanes > MOST_STATE).count();
        let probed = Probed::in_state(&self.package, name, &overrides, &state);
        let probed = probed.map_err(|error| text(&error))?;
        let probed = probed.with_varying();
        let form = &probed.function.form;
        if form.alone && form.stage == Some(Stage::Fragment) {
            return passes::look_at_pixels(&self.package, name, ranges);
        }
        if form.alone {
            return Err(
                "the function writes memory that other calls can read: Karat can't look for \
                        hazards in such functions"
                    .to_owned(),
            );
        }
        let seen = Trial::of(name, probed, ranges.clone(), self.cases)?.seen();
        Ok(Seen { of_state: large > 0, ..seen })
    }
}

#[derive(Default)]
struct Seen {
    hazards: Vec<Hazard>,
    /// For each position of an operation: the number of cases that reached it with good operands. This number may be 0.
    reached: BTreeMap<String, usize>,
    drawn: Drawn,
    /// The number of inputs for which Karat didn't run the function, because of long loops or too many operations.
    cut: usize,
    in_part: bool,
    /// `true` if the function reads private variables that keep their initial values, because they are too large.
    of_state: bool,
    trial: Option<(Box<Trial>, Vec<function::Key>)>,
}

impl Seen {
    fn judge(&mut self) {
        if let Some((trial, keys)) = &self.trial {
            trial.judge(&mut self.hazards, keys);
        }
    }

    fn needs(&self, hazard: &Hazard) -> Option<Vec<String>> {
        let (trial, keys) = self.trial.as_ref()?;
        let is_it = |one: &Hazard| {
            (&one.location, &one.text, one.kind) == (&hazard.location, &hazard.text, hazard.kind)
        };
        Some(trial.needs(*keys.get(self.hazards.iter().position(is_it)?)?))
    }
}

fn unreached<'s>(looked: impl Iterator<Item = &'s Seen>) -> Vec<String> {
    let mut lines: BTreeMap<(&str, usize), usize> = BTreeMap::new();
    for (place, cases) in looked.flat_map(|seen| &seen.reached) {
        let mut parts = place.rsplitn(3, ':').skip(1);
        let line = parts.next().and_then(|line| line.parse().ok());
        if let (Some(line), Some(file)) = (line, parts.next()) {
            *lines.entry((file, line)).or_default() += cases;
        }
    }
    let none = lines.into_iter().filter(|(_, cases)| *cases == 0);
    none.map(|((file, line), _)| format!("{file}:{line}")).collect()
}

/// Returns the findings of all functions. If a function has checked callers, their runs determine the class of its
/// findings. For each function, `roots` has the outermost of these callers.
fn judged(
    roots: &BTreeMap<String, BTreeSet<String>>,
    looked: &BTreeMap<String, Seen>,
) -> Vec<Hazard> {
    let mut found = ByPlace::new();
    let mut called = Vec::new();
    for (name, seen) in looked {
        let roots = &roots[name];
        for hazard in &seen.hazards {
            match roots.contains(name) {
                true => add(&mut found, hazard.clone()),
                false => called.push((hazard, roots)),
            }
        }
    }
    let mut others = ByPlace::new();
    for (hazard, roots) in called {
        if let Some(known) = found.get_mut(&key_of(hazard)) {
            if !known.also.contains(&hazard.function) {
                known.also.push(hazard.function.clone());
            }
            continue;
        }
        let reached = |root: &String| looked.get(root)?.reached.get(&hazard.location).copied();
        let calls: usize = roots.iter().filter_map(reached).sum();
        let class = match hazard.class {
            Class::Dropped => Class::Dropped,
            _ if calls >= MET => Class::Met,
            _ => Class::NotReached,
        };
        add(&mut others, Hazard { class, ..hazard.clone() });
    }
    found.into_values().chain(others.into_values()).collect()
}

/// The findings by position, text and kind. The text is necessary because `1.0 / a` begins where `1.0 / a / b` begins.
type ByPlace = BTreeMap<OfPlace, Hazard>;

type OfPlace = (String, String, Kind);

/// The key of a finding. If a value is NaN for some inputs, and infinite or unbounded for others, these findings have
/// the same key.
fn key_of(hazard: &Hazard) -> OfPlace {
    let kind = match hazard.kind {
        Kind::Infinite | Kind::Unbounded => Kind::Nan,
        kind => kind,
    };
    (hazard.location.clone(), hazard.text.clone(), kind)
}

/// Adds a function's finding, and merges it with the finding of the same operation in another function. A fault has
/// precedence over other classes. Between findings of the same class and kind, Karat keeps the one in the function with
/// fewer arguments, because this function is probably closer to the operation.
fn add(found: &mut ByPlace, hazard: Hazard) {
    match found.entry(key_of(&hazard)) {
        std::collections::btree_map::Entry::Vacant(place) => {
            place.insert(hazard);
        }
        std::collections::btree_map::Entry::Occupied(mut place) => {
            let known = place.get_mut();
            let rank = |one: &Hazard| (one.class, one.kind, one.arguments.len());
            let (better, other) = match rank(known) <= rank(&hazard) {
                true => (known.clone(), hazard),
                false => (hazard, known.clone()),
            };
            let (mut kinds, mut also) = (better.kinds.clone(), better.also.clone());
            let more = other.kinds.into_iter().chain([other.kind]);
            more.filter(|kind| *kind != better.kind).for_each(|kind| {
                if !kinds.contains(&kind) {
                    kinds.push(kind);
                }
            });
            for function in other.also.into_iter().chain([other.function]) {
                if function != better.function && !also.contains(&function) {
                    also.push(function);
                }
            }
            kinds.sort();
            *known = Hazard { kinds, also, ..better };
        }
    }
}

fn shown(found: &Found) -> Option<(String, String)> {
    #[expect(clippy::cast_possible_truncation, reason = "shown with the digits of an f32")]
    found.values.map(|(single, double)| (format_f32(single), format_f32(double as f32)))
}

fn first_line(text: &str) -> String {
    karat_core::output::headline(text).to_owned()
}

/// The operands of an operation as text; empty if there are too many.
fn operands(found: &Found) -> Vec<String> {
    /// The largest number of operands that are shown: two vectors of four components.
    const MOST: usize = 8;
    let all = Some(&found.operands).filter(|all| all.len() <= MOST);
    all.into_iter().flatten().map(|x| format_f32(*x)).collect()
}

/// If one pixel reaches a derivative and another pixel doesn't, returns a violation with the position of the condition
/// at which the pixels diverged. Returns `None` for other findings.
fn parted(function: &str, found: &Found) -> Option<Violation> {
    let Missing { reached, missing, parted } = found.missing.as_ref()?;
    let access = |span: &Span, invocation: &str, does: &str| ViolationAccess {
        place: span.to_string(),
        invocation: invocation.to_owned(),
        does: does.to_owned(),
    };
    let other = match parted {
        Some(parted) => access(parted, missing, "takes another branch here"),
        None => access(&found.span, missing, "doesn't"),
    };
    let accesses = vec![access(&found.span, reached, "reaches it"), other];
    let headline = format!("`{function}` takes a derivative that {missing} doesn't reach");
    Some(Violation::new(function, Kind::Barrier, (headline, 1), accesses))
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

trait Acceptance {
    fn covers(&self, hazard: &Hazard) -> bool;

    /// Checks that this acceptance covers at least one finding in each function that the acceptance names.
    ///
    /// # Errors
    /// Returns an error if the acceptance covers no finding in one of these functions.
    fn expect_current(&self, all: &[Hazard]) -> Result<(), HazardError>;
}

impl Acceptance for AcceptedHazard {
    fn covers(&self, hazard: &Hazard) -> bool {
        // `module::*` covers the module and its submodules.
        let is = |name: &str, function: &str| match name.strip_suffix('*') {
            Some(module) => module.ends_with("::") && function.starts_with(module),
            None => name == function,
        };
        self.functions.iter().any(|name| hazard.functions().any(|function| is(name, function)))
            && self.text.as_ref().is_none_or(|text| *text == hazard.text)
    }

    fn expect_current(&self, all: &[Hazard]) -> Result<(), HazardError> {
        let has = |name: &&String| {
            let alone = Self { functions: vec![(*name).clone()], ..self.clone() };
            all.iter().any(|hazard| alone.covers(hazard))
        };
        let Some(idle) = self.functions.iter().find(|name| !has(name)) else { return Ok(()) };
        let of = self.text.as_ref().map_or_else(String::new, |text| format!(" at `{text}`"));
        let own = all.iter().filter(|hazard| hazard.function == *idle);
        let texts: Vec<&str> = own.map(|hazard| hazard.text.as_str()).collect();
        let plain = |text: &str| text.split_whitespace().collect::<String>();
        let spaced =
            self.text.as_ref().and_then(|text| texts.iter().find(|own| plain(own) == plain(text)));
        let near = nearest(idle, all.iter().map(|hazard| hazard.function.as_str()));
        let hint = match (spaced, near) {
            (Some(text), _) => format!("did you mean `{text}`?"),
            (None, Some(near)) if texts.is_empty() => format!("did you mean `{near}`?"),
            _ => "delete the declaration".to_owned(),
        };
        Err(HazardError::Declaration(format!(
            "`karat.toml` accepts a hazard of `{idle}`{of}, but Karat finds no such hazard: {hint}"
        )))
    }
}

impl Hazard {
    pub(super) fn functions(&self) -> impl Iterator<Item = &str> {
        std::iter::once(&self.function).chain(&self.also).map(String::as_str)
    }

    /// The finding's text without its first line: the inputs, the explanation, and the other functions that the finding
    /// concerns.
    pub fn details(&self) -> impl fmt::Display + '_ {
        fmt::from_fn(move |f| self.write_details(f))
    }

    fn write_details(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named: Vec<String> =
            self.arguments.iter().map(|(name, value)| format!("{name} = {value}")).collect();
        let with = if named.is_empty() { "no argument".to_owned() } else { named.join("; ") };
        let (cases, of) = self.cases;
        let is_pass = self.arguments.first().is_some_and(|(name, _)| name == passes::INVOCATION);
        let what = if is_pass { "contents" } else { "inputs that reach it" };
        let counted = format!("{cases} of {of} {what}");
        writeln!(f, "    {} with {with}  ({counted})", self.function)?;
        if let Some(violation) = &self.violation {
            for access in &violation.accesses {
                writeln!(f, "    {}  {} {}", access.place, access.invocation, access.does)?;
            }
        }
        let advice = self.violation.as_ref().map(|one| one.advice.as_str());
        let about = advice.filter(|advice| !advice.is_empty()).unwrap_or(self.kind.about());
        write!(f, "    {about}")?;
        if !self.operands.is_empty() {
            write!(f, " ({})", self.operands.join(", "))?;
        }
        if let Some((single, double)) = &self.values {
            write!(f, ": {single} in f32, {double} in f64")?;
        }
        if !self.kinds.is_empty() {
            let kinds: Vec<&str> = self.kinds.iter().map(|kind| kind.name()).collect();
            write!(f, "; other inputs show another hazard: {}", kinds.join(", "))?;
        }
        // The number of workgroups has no name in the shader.
        let named = |name: &String| match name.contains(' ') {
            true => name.clone(),
            false => format!("another `{name}`"),
        };
        let needs: Vec<String> = self.needs.iter().map(named).collect();
        let fails = self.fails.as_ref().map(|fails| format!("it fails {fails}"));
        let needs = match (self.class, &*needs) {
            (Class::Requirement, []) if self.kind == Kind::Endless => {
                Some("needs other inputs".to_owned())
            }
            (Class::Requirement, []) => {
                Some("needs other inputs: the hazard remains if only one changes".to_owned())
            }
            (Class::Requirement, needs) => Some(format!("needs {}", needs.join(" or "))),
            _ => None,
        };
        match (needs, fails) {
            (Some(needs), Some(fails)) => write!(f, "\n    {needs}: {fails}")?,
            (Some(text), None) | (None, Some(text)) => write!(f, "\n    {text}")?,
            (None, None) => {}
        }
        if let Some(reason) = &self.accepted {
            write!(f, "\n    accepted: {reason}")?;
        }
        if !self.also.is_empty() {
            let more = self.also.len();
            write!(
                f,
                "\n    also in {}{}",
                self.also[0],
                match more {
                    1 => String::new(),
                    _ => format!(" and {} more", more - 1),
                }
            )?;
        }
        Ok(())
    }
}

impl fmt::Display for Hazard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (class, kind) = (self.class.name(), self.kind.name());
        writeln!(f, "{class}: {kind}: {}  at {}", self.text, self.location)?;
        self.write_details(f)
    }
}

impl Hazards {
    /// The current version of the data format. Version 1 had no classes.
    pub const SCHEMA: u32 = 2;

    /// The faults that `karat.toml` doesn't accept. They fail a run.
    pub fn faults(&self) -> impl Iterator<Item = &Hazard> {
        self.of(Class::Fault)
    }

    /// The requirements that `karat.toml` doesn't accept.
    pub fn requirements(&self) -> impl Iterator<Item = &Hazard> {
        self.of(Class::Requirement)
    }

    /// The findings of a class that `karat.toml` doesn't accept.
    pub fn of(&self, class: Class) -> impl Iterator<Item = &Hazard> {
        let all = self.found.iter().chain(&self.others);
        all.filter(move |one| one.class == class && one.accepted.is_none())
    }

    /// The counts in the last line of a report: `1 fault and 2 requirements in 7 functions, 3 met`.
    #[must_use]
    pub fn counts(&self) -> String {
        let mut text = format!(
            "{} and {} in {}",
            counted(self.faults().count(), "fault"),
            counted(self.requirements().count(), "requirement"),
            counted(self.functions, "function")
        );
        for class in [Class::Met, Class::NotReached, Class::Dropped] {
            match self.of(class).count() {
                0 => {}
                count => text += &format!(", {count} {}", class.name()),
            }
        }
        text
    }
}

impl fmt::Display for Hazards {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for hazard in &self.found {
            writeln!(f, "{hazard}\n")?;
        }
        write!(f, "{}: {}, {} accepted", self.package, self.counts(), self.accepted)
    }
}
