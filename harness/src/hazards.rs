//! What can go wrong inside of functions, without a single test: values that become NaN or infinite,
//! digits that are lost, indices that leave their array, and operations that WGSL doesn't bound.
//!
//! Karat's engine runs each function of a package in `f32`, in `f64` and in intervals, over arguments
//! that names and types suggest: unit vectors, numbers from 0 to 1, colours, edges first. A hazard is
//! told where it is born: at the operation whose operands were still good.
//!
//! ```no_run
//! use karat::prelude::*;
//!
//! static SHADERS: Package = karat::package!("shaders");
//!
//! // #[test]
//! fn no_hazards() {
//!     let hazards = SHADERS.hazards().run().unwrap();
//!     assert!(hazards.found.is_empty(), "{hazards}");
//! }
//! ```

mod inputs;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use serde::Serialize;

use crate::check::arguments;
use crate::diagnostic::{Diagnostic, nearest};
use crate::interpret::Interpreted;
use crate::interpret::hazards::Found;
pub use crate::interpret::hazards::Kind;
use crate::output::counted;
use crate::package::{AcceptedHazard, Package, PackageError};
use crate::probe::{ProbeError, Probed, made_up};
use crate::value::format_f32;
use inputs::Declared;
pub use inputs::suggested;

/// Inputs of each function. With three arguments of six edges each, that leaves 800 draws.
const CASES: usize = 1024;

/// One input in so many is rare.
const RARE: usize = 100;

/// What hazards are looked for, and over what.
///
/// ```
/// # use karat::prelude::*;
/// let package = Package::from_source("m", "fn inverse(x: f32) -> f32 { return 1.0 / x; }");
/// let hazards = package.hazards().input("x", 0.0..=1.0).run()?;
/// assert_eq!(hazards.found[0].text, "1.0 / x");
/// # Ok::<(), karat::hazards::HazardError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Request {
    package: Package,
    only: Vec<String>,
    cases: usize,
    inputs: Declared,
    with_accepted: bool,
}

/// An operation at which something goes wrong.
///
/// ```
/// use karat::hazards::Kind;
/// # use karat::prelude::*;
/// let package = Package::from_source("m", "fn inverse(x: f32) -> f32 { return 1.0 / x; }");
/// let hazard = &package.hazards().input("x", 0.0..=1.0).run()?.found[0];
/// assert_eq!((hazard.kind, hazard.text.as_str()), (Kind::Infinite, "1.0 / x"));
/// # Ok::<(), karat::hazards::HazardError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Hazard {
    /// What goes wrong.
    pub kind: Kind,
    /// The operation in the author's file.
    pub location: String,
    /// Its text.
    pub text: String,
    /// The function that was called.
    pub function: String,
    /// Its arguments in the first case: edges come first.
    pub arguments: Vec<(String, String)>,
    /// How many cases, of how many.
    pub cases: (usize, usize),
    /// Whether the result is finite all the same in that case: a later `max`, `clamp`, `select` or
    /// branch hides it.
    pub hidden: bool,
    /// For lost digits, in that case: the value in `f32`, and what it is in `f64`.
    pub values: Option<(String, String)>,
    /// What the operation was computed from in that case, in `f32`; empty where that isn't floats, or more
    /// than a line holds.
    pub operands: Vec<String>,
    /// Whether some argument is a number of which neither name nor type say what it is, so that nobody
    /// knows whether these are arguments that it gets.
    pub guessed: bool,
    /// Why `karat.toml` accepts it, where those are asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accepted: Option<String>,
    /// Other functions in which the same operation goes wrong.
    pub also: Vec<String>,
}

/// What was found in a package.
///
/// ```
/// # use karat::prelude::*;
/// let package = Package::from_source("m", "fn inverse(x: f32) -> f32 { return 1.0 / x; }");
/// let hazards = package.hazards().run()?;
/// println!("{hazards}"); // as `karat hazards` prints it
/// assert_eq!(hazards.functions, 1);
/// # Ok::<(), karat::hazards::HazardError>(())
/// ```
#[derive(Clone, Debug, Serialize)]
pub struct Hazards {
    /// The package.
    pub package: String,
    /// Functions that were looked at.
    pub functions: usize,
    /// Functions that weren't, each with the reason.
    pub skipped: Vec<(String, String)>,
    /// The worst first; one a line and kind.
    pub found: Vec<Hazard>,
    /// What happens in less than one case of a hundred, with arguments that nobody declared: too rarely
    /// to be sure.
    pub rare: Vec<Hazard>,
    /// How many were left out, as `karat.toml` accepts them with a reason.
    pub accepted: usize,
}

/// Why nothing could be looked for.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum HazardError {
    /// The package can't be read.
    #[error(transparent)]
    Package(#[from] PackageError),
    /// No function was looked at: there is no verdict.
    #[error("no function of package `{package}` can be looked at{}", first(skipped))]
    Nothing {
        /// The package.
        package: String,
        /// Each function with the reason.
        skipped: Vec<(String, String)>,
    },
    /// What is declared can't be so.
    #[error("{0}")]
    Declaration(String),
}

fn first(skipped: &[(String, String)]) -> String {
    skipped.first().map_or_else(String::new, |(name, why)| format!(": `{name}`: {why}"))
}

impl Package {
    /// Looks for hazards in all functions that can be called alone.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// let hazards = SHADERS.hazards().run()?;
    /// assert!(hazards.found.is_empty(), "{hazards}");
    /// # Ok::<(), karat::hazards::HazardError>(())
    /// ```
    #[must_use]
    pub fn hazards(&self) -> Request {
        let (only, inputs) = Default::default();
        Request { package: self.clone(), only, cases: CASES, inputs, with_accepted: false }
    }
}

impl Request {
    /// Only functions whose name contains one of these.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "fn inverse(x: f32) -> f32 { return 1.0 / x; }
    ///             fn half(x: f32) -> f32 { return 0.5 * x; }";
    /// let package = Package::from_source("m", text);
    /// assert!(package.hazards().only(["half"]).run()?.found.is_empty());
    /// # Ok::<(), karat::hazards::HazardError>(())
    /// ```
    #[must_use]
    pub fn only<'n>(self, names: impl IntoIterator<Item = &'n str>) -> Self {
        Self { only: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    /// Inputs of each function, 1,024 unless it is said.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// let hazards = package.hazards().cases(64).run()?;
    /// assert_eq!(hazards.functions, 1);
    /// # Ok::<(), karat::hazards::HazardError>(())
    /// ```
    #[must_use]
    pub fn cases(self, cases: usize) -> Self {
        Self { cases, ..self }
    }

    /// Reports what `karat.toml` accepts, too.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// for hazard in SHADERS.hazards().with_accepted().run()?.found {
    ///     println!("{}: {:?}", hazard.text, hazard.accepted);
    /// }
    /// # Ok::<(), karat::hazards::HazardError>(())
    /// ```
    #[must_use]
    pub fn with_accepted(self) -> Self {
        Self { with_accepted: true, ..self }
    }

    /// What arguments and members of this name are, in every function.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::from_source("m", "fn inverse(x: f32) -> f32 { return 1.0 / x; }");
    /// assert!(package.hazards().input("x", 1.0..=2.0).run()?.found.is_empty());
    /// # Ok::<(), karat::hazards::HazardError>(())
    /// ```
    #[must_use]
    pub fn input(mut self, name: &str, range: std::ops::RangeInclusive<f64>) -> Self {
        self.inputs.insert(name.to_owned(), range.into_inner());
        self
    }

    /// Looks.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// assert!(package.hazards().run()?.found.is_empty());
    /// # Ok::<(), karat::hazards::HazardError>(())
    /// ```
    ///
    /// # Errors
    /// If the package can't be read, no function can be looked at, or a declaration isn't true.
    pub fn run(&self) -> Result<Hazards, HazardError> {
        self.run_with(&|_, _| {})
    }

    /// [`run`](Self::run), which tells how many functions are done, one more each time, and of how many.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// # let package = Package::from_source("m", "fn half(x: f32) -> f32 { return 0.5 * x; }");
    /// package.hazards().run_with(&|done, all| eprintln!("{done} of {all}"))?;
    /// # Ok::<(), karat::hazards::HazardError>(())
    /// ```
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn run_with(
        &self,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Hazards, HazardError> {
        let declared = self.package.declared_hazards()?;
        let mut inputs = declared.inputs.clone();
        inputs.extend(self.inputs.clone());
        for (name, (least, most)) in &inputs {
            if !(least <= most && least.is_finite() && most.is_finite()) {
                let text =
                    format!("the input `{name}` is declared from {least} to {most}: no range");
                return Err(HazardError::Declaration(text));
            }
        }
        let wanted = |name: &str| {
            self.only.is_empty() || self.only.iter().any(|part| name.contains(part.as_str()))
        };
        let mut names = Vec::new();
        let mut skipped = Vec::new();
        for module in self.package.modules()? {
            match self.package.functions_in(&module) {
                Ok(items) => names.extend(items.into_iter().filter(|item| !item.entry_point)),
                Err(error) => skipped.push((module, first_line(&error.to_string()))),
            }
        }
        names.retain(|item| wanted(&item.name));
        let done = Mutex::new(0);
        let all = names.len();
        let each: Vec<(String, Result<Seen, String>)> = names
            .par_iter()
            .map(|item| {
                let seen = self.look(&item.name, &inputs);
                // Whoever counts tells it before another one counts, so that no count is told late.
                let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
                *done += 1;
                progress(*done, all);
                (item.name.clone(), seen)
            })
            .collect();
        let mut functions = 0;
        let mut found: BTreeMap<(String, Kind), Hazard> = BTreeMap::new();
        let mut rare: BTreeMap<(String, Kind), Hazard> = BTreeMap::new();
        let mut used: BTreeSet<String> = BTreeSet::new();
        for (name, seen) in each {
            match seen {
                Err(why) => skipped.push((name, why)),
                Ok(Seen { hazards, rare: own, names }) => {
                    functions += 1;
                    for hazard in own {
                        add(&mut rare, hazard);
                    }
                    used.extend(names);
                    for hazard in hazards {
                        add(&mut found, hazard);
                    }
                }
            }
        }
        let package = self.package.name();
        if functions == 0 {
            return Err(HazardError::Nothing { package, skipped });
        }
        if self.only.is_empty() {
            expect_names(&inputs, &used)?;
        }
        let mut found: Vec<Hazard> = found.into_values().collect();
        let mut rare: Vec<Hazard> = rare.into_values().collect();
        rare.retain(|one| !found.iter().any(|h| h.location == one.location && h.kind == one.kind));
        for accepted in &declared.accepted {
            let covered = found.iter().chain(&rare).filter(|hazard| accepted.covers(hazard));
            if self.only.is_empty() {
                accepted.expect_current(&covered.collect::<Vec<_>>(), &found)?;
            }
            for hazard in found.iter_mut().filter(|hazard| accepted.covers(hazard)) {
                hazard.accepted.get_or_insert_with(|| accepted.reason.clone());
            }
            rare.retain(|hazard| !accepted.covers(hazard));
        }
        let accepted = found.iter().filter(|hazard| hazard.accepted.is_some()).count();
        if !self.with_accepted {
            found.retain(|hazard| hazard.accepted.is_none());
        }
        found.sort_by(|a, b| {
            let rank = |hazard: &Hazard| (hazard.guessed, hazard.kind, hazard.hidden);
            let order = rank(a).cmp(&rank(b)).then(b.cases.0.cmp(&a.cases.0));
            order.then_with(|| a.location.cmp(&b.location))
        });
        rare.sort_by(|a, b| (a.kind, &a.location).cmp(&(b.kind, &b.location)));
        Ok(Hazards { package, functions, skipped, found, rare, accepted })
    }

    /// What goes wrong in a function, and the names of its arguments.
    fn look(&self, name: &str, inputs: &Declared) -> Result<Seen, String> {
        let text = |error: &dyn fmt::Display| first_line(&error.to_string());
        let probed = Probed::new(&self.package, name).map_err(|error| text(&error))?;
        let fixtures = made_up::fixtures(&probed)?;
        let form = &probed.function.form;
        if form.fragment {
            return Err("it takes derivatives: hazards are looked for pixel by pixel".to_owned());
        }
        if form.alone {
            return Err("it writes what others would see: hazards are looked for in functions \
                        that only return"
                .to_owned());
        }
        let engine = Interpreted::new(&probed, &fixtures).map_err(|error| text(&error))?;
        let rows = inputs::rows(&probed, inputs, self.cases);
        let function = probed.function();
        let cases = match engine.hazards(self.cases, &rows) {
            Ok(cases) => cases,
            Err(ProbeError::Rounds { case, diagnostic })
                if probed.program.most_rounds().is_none() =>
            {
                return Ok(endless(&probed, case, &diagnostic, &rows, self.cases));
            }
            Err(error) => return Err(text(&error)),
        };
        let lanes = |case: usize| {
            let width: usize = function.parameters.iter().map(|(_, s)| s.lanes().len()).sum();
            &rows[case * width..][..width]
        };
        let guessed = inputs::are_guessed(&probed, inputs);
        let mut found: BTreeMap<(String, Kind), Hazard> = BTreeMap::new();
        for (case, hazards) in cases.iter().enumerate() {
            for one in hazards {
                let location = one.span.to_string();
                let hazard = found.entry((location.clone(), one.kind)).or_insert_with(|| Hazard {
                    kind: one.kind,
                    location,
                    text: one_line(&one.text),
                    function: name.to_owned(),
                    arguments: arguments(function, lanes(case)),
                    cases: (0, cases.len()),
                    hidden: one.hidden,
                    values: shown(one),
                    operands: operands(one),
                    guessed,
                    accepted: None,
                    also: Vec::new(),
                });
                hazard.cases.0 += 1;
                // That it shows in one case is worse than that it is hidden in others.
                if hazard.hidden && !one.hidden {
                    hazard.arguments = arguments(function, lanes(case));
                    hazard.operands = operands(one);
                    hazard.hidden = false;
                }
            }
        }
        let names = function.parameters.iter().map(|(name, _)| name.clone()).collect();
        // Numbers that nobody means may break anything once: then it has to happen more often.
        let sure = |hazard: &Hazard| !guessed || hazard.cases.0 * RARE >= hazard.cases.1;
        let (hazards, rare) = found.into_values().partition(sure);
        Ok(Seen { hazards, rare, names })
    }
}

/// What was seen of a function.
struct Seen {
    hazards: Vec<Hazard>,
    /// What made-up arguments cause now and then.
    rare: Vec<Hazard>,
    names: Vec<String>,
}

/// A function with a loop that was stopped.
fn endless(
    probed: &Probed,
    case: usize,
    diagnostic: &Diagnostic,
    rows: &[u32],
    cases: usize,
) -> Seen {
    let function = probed.function();
    let width: usize = function.parameters.iter().map(|(_, s)| s.lanes().len()).sum();
    let at = diagnostic.location().unwrap_or(&function.span);
    let text = at.file.text.get(at.range.clone()).unwrap_or_default();
    let hazard = Hazard {
        kind: Kind::Endless,
        location: at.to_string(),
        text: one_line(text),
        function: function.name.clone(),
        arguments: rows
            .get(case * width..(case + 1) * width)
            .map_or_else(Vec::new, |row| arguments(function, row)),
        cases: (1, cases),
        hidden: false,
        values: None,
        operands: Vec::new(),
        guessed: true,
        accepted: None,
        also: Vec::new(),
    };
    let names = function.parameters.iter().map(|(name, _)| name.clone()).collect();
    Seen { hazards: vec![hazard], rare: Vec::new(), names }
}

/// Adds a hazard to those of other functions. The function that has the operation is preferred.
fn add(found: &mut BTreeMap<(String, Kind), Hazard>, hazard: Hazard) {
    match found.entry((hazard.location.clone(), hazard.kind)) {
        std::collections::btree_map::Entry::Vacant(place) => {
            place.insert(hazard);
        }
        std::collections::btree_map::Entry::Occupied(mut place) => {
            let known = place.get_mut();
            // Who knows its arguments says more; who needs fewer is closer to it.
            let (better, other) = match (known.guessed, known.arguments.len())
                <= (hazard.guessed, hazard.arguments.len())
            {
                true => (known.clone(), hazard),
                false => (hazard, known.clone()),
            };
            let also = [better.also.clone(), other.also.clone(), vec![other.function]].concat();
            *known = Hazard { also, ..better };
        }
    }
}

/// Refuses a declared input that is nobody's.
fn expect_names(inputs: &Declared, used: &BTreeSet<String>) -> Result<(), HazardError> {
    let Some(name) = inputs.keys().find(|name| !used.contains(*name)) else { return Ok(()) };
    let near = nearest(name, used.iter().map(String::as_str));
    let near = near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
    let text =
        format!("the input `{name}` is declared, and no function has such an argument{near}");
    Err(HazardError::Declaration(text))
}

fn shown(found: &Found) -> Option<(String, String)> {
    #[expect(clippy::cast_possible_truncation, reason = "shown with the digits of an f32")]
    found.values.map(|(single, double)| (format_f32(single), format_f32(double as f32)))
}

fn first_line(text: &str) -> String {
    text.lines().next().unwrap_or_default().to_owned()
}

/// The operands of an operation, as people read them.
fn operands(found: &Found) -> Vec<String> {
    /// Two vectors of four have as many.
    const MOST: usize = 8;
    let all = Some(&found.operands).filter(|all| all.len() <= MOST);
    all.into_iter().flatten().map(|x| format_f32(*x)).collect()
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

impl AcceptedHazard {
    fn covers(&self, hazard: &Hazard) -> bool {
        // `module::*` is all of a module, and of those below it.
        let is = |name: &str, function: &str| match name.strip_suffix('*') {
            Some(module) => module.ends_with("::") && function.starts_with(module),
            None => name == function,
        };
        let functions = || std::iter::once(&hazard.function).chain(&hazard.also);
        self.functions.iter().any(|name| functions().any(|function| is(name, function)))
            && self.text.as_ref().is_none_or(|text| *text == hazard.text)
    }

    /// Wants each function that is named to have such a hazard.
    fn expect_current(&self, covered: &[&Hazard], all: &[Hazard]) -> Result<(), HazardError> {
        let has = |name: &&String| {
            let alone = Self { functions: vec![(*name).clone()], ..self.clone() };
            covered.iter().any(|hazard| alone.covers(hazard))
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
            _ => "delete it".to_owned(),
        };
        Err(HazardError::Declaration(format!(
            "`karat.toml` accepts a hazard of `{idle}`{of}, and there is none: {hint}"
        )))
    }
}

impl fmt::Display for Hazard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let hidden = if self.hidden { ", hidden" } else { "" };
        writeln!(f, "{}{hidden}: {}  at {}", self.kind.name(), self.text, self.location)?;
        let named: Vec<String> =
            self.arguments.iter().map(|(name, value)| format!("{name} = {value}")).collect();
        let with = if named.is_empty() { "no argument".to_owned() } else { named.join("; ") };
        let (cases, of) = self.cases;
        writeln!(f, "    {} with {with}  ({cases} of {of} inputs)", self.function)?;
        write!(f, "    {}", self.kind.about())?;
        if !self.operands.is_empty() {
            write!(f, " ({})", self.operands.join(", "))?;
        }
        if let Some((single, double)) = &self.values {
            write!(f, ": {single} in f32, {double} in f64")?;
        }
        if self.hidden {
            write!(f, "; the result is finite, as a later operation hides it")?;
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

impl fmt::Display for Hazards {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for hazard in &self.found {
            writeln!(f, "{hazard}\n")?;
        }
        let Self { package, functions, found, accepted, .. } = self;
        write!(
            f,
            "{package}: {} in {}, {accepted} accepted",
            counted(found.len(), "hazard"),
            counted(*functions, "function")
        )
    }
}
