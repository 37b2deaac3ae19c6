//! What can go wrong inside of functions, without a single test: values that become NaN or infinite,
//! digits that are lost, indices that leave their array, and operations that WGSL doesn't bound.
//!
//! Karat's engine runs each function of a package in `f32`, in `f64` and in intervals, over arguments
//! that declarations, names and types suggest (see [`made_up`](mod@crate::made_up)). A hazard is reported
//! where it is born: at the operation whose operands were still good.
//!
//! ```no_run
//! use karat::prelude::*;
//!
//! static SHADERS: Package = karat::package!("shaders");
//!
//! // #[test]
//! fn no_hazards() {
//!     let hazards = SHADERS.hazards().run().unwrap();
//!     assert!(hazards.found.is_empty() && hazards.lowered.is_empty(), "{hazards}");
//! }
//! ```

mod lowered;
mod passes;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use serde::Serialize;

use crate::check::arguments;
use crate::diagnostic::{Diagnostic, Span, nearest};
use crate::dispatch::{Violation, ViolationAccess, ViolationKind};
use crate::fixture::Fixtures;
pub use crate::interpret::hazards::Kind;
use crate::interpret::hazards::{Fine, Found, Hazards as FoundInCases, Missing};
use crate::interpret::{Interpreted, evaluations};
use crate::made_up::{Arguments, Drawn, Ranges, Resources, VARIANTS};
use crate::output::counted;
use crate::package::stage::Stage;
use crate::package::{AcceptedHazard, Package, PackageError};
use crate::panics;
use crate::probe::{ProbeError, Probed};
use crate::reflect::{Idiom, Program, ReflectError};
use crate::value::format_f32;
use lowered::Callers;
pub use lowered::Lowered;

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
/// # Ok::<(), karat::unstable::hazards::HazardError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Request {
    package: Package,
    only: Vec<String>,
    cases: usize,
    inputs: Vec<(String, f64, f64)>,
    with_accepted: bool,
}

/// An operation at which something goes wrong.
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
    /// True if the result is finite all the same in each case: a `select` or a branch drops the value, or a
    /// later operation bounds an infinity.
    pub hidden: bool,
    /// For lost digits, in that case: the value in `f32`, and what it is in `f64`.
    pub values: Option<(String, String)>,
    /// What the operation was computed from in that case, in `f32`; empty where that isn't floats, or more
    /// than a line holds.
    pub operands: Vec<String>,
    /// True if neither name nor type say what some argument, or some member of a buffer, is: a caller may never give these
    /// numbers.
    pub guessed: bool,
    /// True if each case has a float beyond 10,000 among the arguments of which nothing is known, or one within
    /// 1e-10 of 0.
    pub extreme: bool,
    #[serde(skip)]
    idiom: Option<Idiom>,
    /// The functions in which the contents of buffers decide it alone, and it is fine over others.
    #[serde(skip)]
    by_contents: BTreeSet<String>,
    /// True of an index beyond a texture, or beyond an array as long as its buffer, that a function is given.
    #[serde(skip)]
    of_made_up_size: bool,
    /// True of an index in a pass that leaves its array only where the elements are no multiple of the workgroup.
    #[serde(skip)]
    at_tail: bool,
    /// Why `karat.toml` accepts it, where those are asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub accepted: Option<String>,
    /// Why it is less than others, if it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lowered: Option<Lowered>,
    /// Other functions in which the same operation goes wrong.
    pub also: Vec<String>,
    /// The sanitizer's finding in a compute pass, or the pixel that doesn't come to a derivative.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub violation: Option<Violation>,
}

/// A function that was looked at, while others are still.
#[derive(Clone, Copy, Debug)]
pub struct Progress<'p> {
    /// Its name.
    pub function: &'p str,
    /// Hazards in it, of which the functions that call it may lower some.
    pub found: usize,
    /// Functions that are done.
    pub done: usize,
    /// Of how many.
    pub of: usize,
}

/// What was found in a package.
#[derive(Clone, Debug, Serialize)]
pub struct Hazards {
    /// The package.
    pub package: String,
    /// Functions that were looked at.
    pub functions: usize,
    /// Functions that weren't, each with the reason; and modules that can't be read.
    pub skipped: Vec<(String, String)>,
    /// Modules that can't be read, whose functions are unknown.
    pub unread: usize,
    /// The worst first; one a line and kind.
    pub found: Vec<Hazard>,
    /// Hazards that are less than others, each with its reason: a later operation drops them, say, or no caller's arguments
    /// cause them. They may be there all the same.
    pub lowered: Vec<Hazard>,
    /// Hazards of fewer than one case in a hundred, whose arguments were drawn by their types alone and are
    /// neither 0, 1, -1 nor an end of their range.
    pub rare: Vec<Hazard>,
    /// How many were left out, as `karat.toml` accepts them with a reason.
    pub accepted: usize,
    /// The ranges that arguments and members were drawn from.
    pub drawn: Drawn,
    /// The parts of these functions that weren't looked at.
    pub unseen: Unseen,
}

/// Parts of functions that weren't looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Unseen {
    /// Inputs that are too much work: loops that count to more than some thousands, or many operations.
    pub inputs: usize,
    /// Functions that have such inputs.
    pub functions: usize,
    /// Functions with more operations than are kept: 4,096 of 256 inputs together.
    pub in_part: usize,
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
    /// An input is declared that nothing takes.
    #[error(
        "the input `{name}` is declared, and no function that is looked at has such an argument or reads \
         such a member{}", nearest.as_ref().map_or_else(String::new, |near| format!("; did you mean `{near}`?"))
    )]
    UnknownInput {
        /// Its name.
        name: String,
        /// The closest name that something takes.
        nearest: Option<String>,
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
    /// assert!(hazards.found.is_empty() && hazards.lowered.is_empty(), "{hazards}");
    /// # Ok::<(), karat::unstable::hazards::HazardError>(())
    /// ```
    #[must_use]
    pub fn hazards(&self) -> Request {
        let (only, inputs) = Default::default();
        Request { package: self.clone(), only, cases: CASES, inputs, with_accepted: false }
    }
}

impl Request {
    /// Only functions whose name contains one of these.
    #[must_use]
    pub fn only<'n>(self, names: impl IntoIterator<Item = &'n str>) -> Self {
        Self { only: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    /// Inputs of each function, 1,024 unless it is said.
    #[must_use]
    pub fn cases(self, cases: usize) -> Self {
        Self { cases, ..self }
    }

    /// Reports what `karat.toml` accepts, too.
    #[must_use]
    pub fn with_accepted(self) -> Self {
        Self { with_accepted: true, ..self }
    }

    /// What arguments and members of this name are, in every function.
    #[must_use]
    pub fn input(mut self, name: &str, range: std::ops::RangeInclusive<f64>) -> Self {
        let (least, most) = range.into_inner();
        self.inputs.push((name.to_owned(), least, most));
        self
    }

    /// Looks.
    ///
    /// # Errors
    /// If the package can't be read, no function can be looked at, or a declaration isn't true.
    pub fn run(&self) -> Result<Hazards, HazardError> {
        self.run_with(&|_| {})
    }

    /// [`run`](Self::run), which tells each function that is done, with their count and of how many.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn run_with(
        &self,
        progress: &(dyn Fn(&Progress<'_>) + Sync),
    ) -> Result<Hazards, HazardError> {
        let declared = self.package.declared_hazards()?;
        let mut inputs = Ranges::of(&self.package)?;
        for (name, least, most) in &self.inputs {
            inputs.declare(name, *least, *most).map_err(HazardError::Declaration)?;
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
        let mut unread = skipped.len();
        let mut invalid = BTreeSet::new();
        names.retain(|item| wanted(&item.name));
        if names.is_empty() && !self.only.is_empty() {
            let only = self.only.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>();
            let (package, only) = (self.package.name(), only.join(" or "));
            let why = format!("no function of package `{package}` has {only} in its name");
            return Err(HazardError::Declaration(why));
        }
        let done = Mutex::new(0);
        let all = names.len();
        let each: Vec<(String, Result<Seen, String>)> = names
            .par_iter()
            .map(|item| {
                let look = || match item.entry_point {
                    Some(Stage::Compute) => passes::look(&self.package, &item.name, &inputs),
                    _ => self.look(&item.name, &inputs),
                };
                let seen = panics::caught(look)
                    .unwrap_or_else(|panicked| Err(format!("Karat panics at it: {panicked}")));
                // Whoever counts tells it before another one counts, so that no count is told late.
                let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
                *done += 1;
                let found = seen.as_ref().map_or(0, |seen| seen.hazards.len());
                progress(&Progress { function: &item.name, found, done: *done, of: all });
                (item.name.clone(), seen)
            })
            .collect();
        let mut functions = 0;
        let mut found: BTreeMap<(String, Kind), Hazard> = BTreeMap::new();
        let mut rare: BTreeMap<(String, Kind), Hazard> = BTreeMap::new();
        let mut drawn = Drawn::default();
        let mut unseen = Unseen::default();
        let (mut whole, mut fine) = (BTreeSet::new(), BTreeMap::new());
        for (name, seen) in each {
            match seen {
                Err(why) => {
                    let module = name.rsplit_once("::").map_or("", |(module, _)| module);
                    match self.invalid(module, &name) {
                        Some(why) if invalid.insert(module.to_owned()) => {
                            skipped.push((module.to_owned(), why));
                        }
                        _ => skipped.push((name, why)),
                    }
                }
                Ok(Seen { hazards, rare: own, drawn: from, cut, in_part, fine: own_fine }) => {
                    functions += 1;
                    unseen.inputs += cut;
                    unseen.functions += usize::from(cut > 0);
                    unseen.in_part += usize::from(in_part);
                    fine.insert(name.clone(), own_fine);
                    if cut == 0 && !in_part {
                        whole.insert(name);
                    }
                    for hazard in own {
                        add(&mut rare, hazard);
                    }
                    drawn.merge(from);
                    for hazard in hazards {
                        add(&mut found, hazard);
                    }
                }
            }
        }
        unread += invalid.len();
        let package = self.package.name();
        if functions == 0 {
            return Err(HazardError::Nothing { package, skipped });
        }
        if self.only.is_empty() {
            expect_names(&inputs, &drawn)?;
        }
        let callers = Callers::of(&self.package, whole, fine);
        let mut of_kind: BTreeSet<(String, Kind)> = BTreeSet::new();
        for hazard in found.values().chain(rare.values()) {
            of_kind.extend(hazard.functions().map(|function| (function.to_owned(), hazard.kind)));
        }
        for (place, hazard) in &mut found {
            let now_and_then = rare.get(place);
            let now_and_then = now_and_then.into_iter().flat_map(Hazard::functions).collect();
            hazard.lowered = callers.lower(hazard, &of_kind, &now_and_then);
        }
        let infinite = |one: &Hazard| found.get(&(one.location.clone(), Kind::Infinite));
        let is_by_zero = |one: &&Hazard| {
            let of_nan = one.kind == Kind::Nan && one.lowered.is_none();
            of_nan && infinite(one).is_some_and(|infinite| lowered::is_by_zero(one, infinite))
        };
        let by_zero: Vec<_> =
            found.values().filter(is_by_zero).map(|one| one.location.clone()).collect();
        for location in by_zero {
            let nan = found.get_mut(&(location, Kind::Nan)).expect("it is one of them");
            nan.lowered = Some(Lowered::Arithmetic);
        }
        let is_told = |one: &Hazard| one.kind == Kind::Nan && one.lowered.is_none();
        let told: BTreeSet<String> =
            found.values().filter(|one| is_told(one)).map(|one| one.location.clone()).collect();
        for hazard in found.values_mut().filter(|one| one.kind == Kind::Infinite) {
            let is_less = matches!(hazard.lowered, None | Some(Lowered::Arithmetic));
            if is_less && told.contains(&hazard.location) {
                hazard.lowered = Some(Lowered::Nan);
            }
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
        let lowered =
            found.extract_if(.., |hazard| hazard.lowered.is_some() && hazard.accepted.is_none());
        let lowered = lowered.collect();
        rare.sort_by(|a, b| (a.kind, &a.location).cmp(&(b.kind, &b.location)));
        Ok(Hazards {
            package,
            functions,
            skipped,
            unread,
            found,
            lowered,
            rare,
            accepted,
            drawn,
            unseen,
        })
    }

    /// Looks for hazards in a function.
    /// Why and where naga rejects a function, or what it uses. A crate may want abilities of its own renderer.
    fn invalid(&self, module: &str, name: &str) -> Option<String> {
        let own = name.rsplit("::").next().unwrap_or(name);
        let linked = || Program::of_items(&self.package, module, &[own]);
        match (!self.package.is_crate()).then(linked)? {
            Err(ReflectError::Invalid(found)) => {
                let place = found.location().map_or_else(String::new, |at| format!(" ({at})"));
                Some(first_line(&found.to_string()) + &place)
            }
            _ => None,
        }
    }

    fn look(&self, name: &str, ranges: &Ranges) -> Result<Seen, String> {
        let text = |error: &dyn fmt::Display| first_line(&error.to_string());
        let probed = Probed::new(&self.package, name).map_err(|error| text(&error))?;
        let probed = probed.with_varying();
        let form = &probed.function.form;
        if form.alone && form.stage == Some(Stage::Fragment) {
            return passes::look_at_pixels(&self.package, name, ranges);
        }
        if form.alone {
            return Err("it writes what others would see: hazards are looked for in functions \
                        that only return"
                .to_owned());
        }
        let arguments = Arguments::of(probed.function(), ranges)?;
        let (count, rows) = arguments.rows(SEED, self.cases);
        let seen = Seen { drawn: arguments.drawn(), ..Seen::default() };
        let mut look = Look { name, probed: &probed, arguments: &arguments, seen };
        let mut found = BTreeMap::new();
        let (mut cases, mut first) = (0, None);
        // Of a function whose loops go round thousands of times a part is looked at, the smaller the longer they are.
        let share = probed.program.most_rounds().map_or(1, share_of);
        let Resources { fixtures, varies, .. } = Resources::of(&probed, ranges, 0)?;
        let share = share.max(share_of_work(&probed, &fixtures, &arguments, (count, &rows)));
        let variants = if varies { VARIANTS } else { 1 };
        // One function with long loops would keep one core busy while the others idle.
        let looked = (0..variants).into_par_iter().map(|variant| {
            let resources = Resources::of(&probed, ranges, variant)?;
            let (count, rows) = match share {
                1 => arguments.part(&rows, count, variant),
                share => arguments.share(&rows, count, (variant, share)),
            };
            let engine = Interpreted::new(&probed, &resources.fixtures);
            let seen = engine.and_then(|engine| engine.hazards(count, &rows));
            Ok::<_, String>((resources, (count, rows), seen))
        });
        let mut guessed = arguments.are_guessed();
        for one in looked.collect::<Vec<_>>() {
            let (resources, rows, seen) = one?;
            guessed |= resources.guessed;
            first.get_or_insert(rows.0);
            cases +=
                look.variant(resources, rows, seen, &mut found).map_err(|error| text(&error))?;
        }
        let Look { mut seen, .. } = look;
        seen.cut += count - first.unwrap_or(count);
        let of_index =
            |kind: Kind| matches!(kind, Kind::OutOfRange | Kind::Wrapped | Kind::Endless);
        // Buffers of zeros, over the very same inputs, tell an index that inputs make from one that contents make.
        let zeros = found.keys().any(|(_, kind)| varies && of_index(*kind));
        let zeros = zeros.then(|| {
            let fixtures = Resources::of(&probed, ranges, 0).ok()?.of_zeros(&probed)?;
            let (count, rows) = arguments.select(&rows, count, |at| at % share < variants);
            let seen = Interpreted::new(&probed, &fixtures).ok()?.hazards(count, &rows).ok()?;
            let all = seen.cases.into_iter().flatten();
            Some(all.map(|one| (one.span.to_string(), one.kind)).collect::<BTreeSet<_>>())
        });
        let zeros = zeros.flatten();
        for (key, Gathered { hazard, plain, mixed }) in found {
            let of_contents = |zeros: &BTreeSet<_>| of_index(hazard.kind) && !zeros.contains(&key);
            let fine = seen.fine.get(&hazard.location).map_or(0, |ran| ran.fine);
            let is_float = matches!(hazard.kind, Kind::Nan | Kind::Infinite);
            // Over most contents it is fine.
            let by_contents = is_float && !mixed && fine >= hazard.cases.0
                || zeros.as_ref().is_some_and(of_contents);
            let by_contents = by_contents.then(|| name.to_owned()).into_iter().collect();
            let cases = (hazard.cases.0, cases);
            let hazard = Hazard { cases, guessed, by_contents, ..hazard };
            // Numbers that are drawn by type alone may break anything once: then it has to happen more often,
            // or for an input that a caller may well give.
            match !guessed || plain || hazard.cases.0 * RARE >= hazard.cases.1 {
                true => seen.hazards.push(hazard),
                false => seen.rare.push(hazard),
            }
        }
        match cases {
            0 if seen.hazards.is_empty() => Err("no arguments can be made up for it".to_owned()),
            _ => Ok(seen),
        }
    }
}

/// One input of so many is looked at in a function with so many rounds of loops: some hundred thousand rounds are. The
/// longest of the shader library has 4,300, and took 18 s of one core with four times as many.
fn share_of(rounds: u64) -> usize {
    const ROUNDS: u64 = 256;
    let share = (rounds / ROUNDS).clamp(1, 16).next_power_of_two();
    usize::try_from(share).expect("it is small")
}

/// One input of so many is looked at in a function of so many operations, by what a few inputs come to.
fn share_of_work(
    probed: &Probed,
    fixtures: &Fixtures,
    arguments: &Arguments,
    (count, rows): (usize, &[u32]),
) -> usize {
    /// Operations of all inputs together: four of each arithmetic run, and all are compared.
    const WORK: u64 = 1 << 22;
    const SAMPLE: usize = 16;
    let each = count.div_ceil(SAMPLE).max(1);
    let (some, few) = arguments.select(rows, count, |at| at % each == 0);
    // Loops that don't end are found by their rounds.
    let Ok(Some(operations)) = evaluations(probed, fixtures, (some, &few)) else { return 1 };
    let share = operations.saturating_mul(count as u64).div_ceil(WORK).max(1);
    usize::try_from(share).unwrap_or(each).min(each).next_power_of_two()
}

/// The same rows for each function of one signature, on every machine.
const SEED: u64 = 0x6861_7a61_7264; // "hazard"

/// The findings in a function.
#[derive(Default)]
struct Seen {
    hazards: Vec<Hazard>,
    /// Hazards that made-up arguments cause now and then.
    rare: Vec<Hazard>,
    drawn: Drawn,
    /// Inputs whose loops were too long to be looked at.
    cut: usize,
    /// True if it has more operations than are kept.
    in_part: bool,
    /// Of its own operations, and those of what it calls.
    fine: Fine,
}

/// A function that is looked at.
struct Look<'l> {
    name: &'l str,
    probed: &'l Probed,
    arguments: &'l Arguments,
    seen: Seen,
}

/// Hazards by place and kind.
type ByPlace = BTreeMap<(String, Kind), Gathered>;

/// A hazard of all cases.
struct Gathered {
    hazard: Hazard,
    /// True if a plain input causes it.
    plain: bool,
    /// True if its operation is fine in some cases over a content over which it goes wrong in others.
    mixed: bool,
}

impl Look<'_> {
    /// Takes what was found in some rows over one content of the buffers. Returns how many were looked at.
    fn variant(
        &mut self,
        resources: Resources,
        (all, mut rows): (usize, Vec<u32>),
        seen: Result<FoundInCases, ProbeError>,
        found: &mut ByPlace,
    ) -> Result<usize, ProbeError> {
        let function = self.probed.function();
        let width = self.arguments.width();
        let Resources { fixtures, members, drawn, .. } = resources;
        self.seen.drawn.merge(drawn);
        let bounded = self.probed.program.most_rounds().is_some();
        let mut count = all;
        let seen = match seen {
            Err(ProbeError::Rounds { .. }) if !bounded => {
                // A loop that counts to a large number ends, but not here.
                rows = self.arguments.few(&rows);
                let engine = Interpreted::new(self.probed, &fixtures)?;
                let mut tries = LONG_CASES;
                loop {
                    count = rows.len().checked_div(width).unwrap_or(1);
                    let (case, diagnostic) = match engine.hazards(count, &rows) {
                        Err(ProbeError::Rounds { case, diagnostic }) => (case, diagnostic),
                        other => break other?,
                    };
                    let row = case * width..(case + 1) * width;
                    let is_endless = engine.may_not_end(&rows[row.clone()]);
                    if is_endless {
                        let hazard = endless(self.probed, &diagnostic, &rows[row.clone()], count);
                        let key = (hazard.location.clone(), hazard.kind);
                        found.insert(key, Gathered { hazard, plain: true, mixed: true });
                    }
                    tries -= 1;
                    if is_endless || row.is_empty() || tries == 0 {
                        // The loop ends the search for all of them.
                        self.seen.cut += all;
                        return Ok(count);
                    }
                    drop(rows.drain(row));
                }
            }
            other => other?,
        };
        self.seen.in_part |= seen.cut;
        for (place, ran) in &seen.fine {
            self.seen.fine.entry(place.clone()).or_default().add(*ran);
        }
        self.seen.cut += all - count;
        let described = |case: usize| {
            let mut named = arguments(function, &rows[case * width..][..width]);
            named.extend(members.iter().take(MEMBERS).cloned());
            named
        };
        for (case, hazards) in seen.cases.iter().enumerate() {
            let row = &rows[case * width..][..width];
            let (plain, moderate) = (self.arguments.is_plain(row), self.arguments.is_moderate(row));
            for one in hazards {
                let location = one.span.to_string();
                let Gathered { hazard, plain: is_plain, mixed } =
                    found.entry((location.clone(), one.kind)).or_insert_with(|| {
                        let hazard = Hazard {
                            kind: one.kind,
                            location,
                            text: one_line(&one.text),
                            function: self.name.to_owned(),
                            arguments: described(case),
                            cases: (0, 0),
                            hidden: one.hidden,
                            values: shown(one),
                            operands: operands(one),
                            guessed: false,
                            extreme: true,
                            idiom: one.idiom,
                            by_contents: BTreeSet::new(),
                            of_made_up_size: one.of_given_size,
                            at_tail: false,
                            accepted: None,
                            lowered: None,
                            also: Vec::new(),
                            violation: parted(self.name, one),
                        };
                        Gathered { hazard, plain: false, mixed: false }
                    });
                hazard.cases.0 += 1;
                *mixed |= seen.fine.get(&hazard.location).is_some_and(|ran| ran.fine > 0);
                // Arguments that a caller may give say more.
                if hazard.extreme && moderate {
                    hazard.arguments = described(case);
                    hazard.operands = operands(one);
                    hazard.values = shown(one);
                    hazard.extreme = false;
                }
                *is_plain |= plain;
                // That it shows in one case is worse than that it is hidden in others.
                if hazard.hidden && !one.hidden {
                    hazard.arguments = described(case);
                    hazard.operands = operands(one);
                    hazard.hidden = false;
                }
            }
        }
        Ok(count)
    }
}

/// Inputs whose loops are long, and end, that are left out one by one: each costs another run of those that are left.
const LONG_CASES: usize = 3;

/// Members of buffers that are shown with the arguments.
const MEMBERS: usize = 6;

/// A function with a loop that was stopped.
fn endless(probed: &Probed, diagnostic: &Diagnostic, row: &[u32], cases: usize) -> Hazard {
    let function = probed.function();
    let at = diagnostic.location().unwrap_or(&function.span);
    let text = at.file.text.get(at.range.clone()).unwrap_or_default();
    Hazard {
        kind: Kind::Endless,
        location: at.to_string(),
        text: one_line(text),
        function: function.name.clone(),
        arguments: if row.is_empty() { Vec::new() } else { arguments(function, row) },
        cases: (1, cases),
        hidden: false,
        values: None,
        operands: Vec::new(),
        guessed: true,
        extreme: false,
        idiom: None,
        by_contents: BTreeSet::new(),
        of_made_up_size: false,
        at_tail: false,
        accepted: None,
        lowered: None,
        also: Vec::new(),
        violation: None,
    }
}

/// Adds a hazard to those of other functions. The function that has the operation is preferred.
fn add(found: &mut BTreeMap<(String, Kind), Hazard>, hazard: Hazard) {
    match found.entry((hazard.location.clone(), hazard.kind)) {
        std::collections::btree_map::Entry::Vacant(place) => {
            place.insert(hazard);
        }
        std::collections::btree_map::Entry::Occupied(mut place) => {
            let known = place.get_mut();
            // That it shows says more than that it is hidden, and known arguments more than guessed ones. A function
            // with fewer of them is closer to it.
            let rank = |one: &Hazard| (one.hidden, one.extreme, one.guessed, one.arguments.len());
            let (better, other) = match rank(known) <= rank(&hazard) {
                true => (known.clone(), hazard),
                false => (hazard, known.clone()),
            };
            let also = [better.also.clone(), other.also.clone(), vec![other.function]].concat();
            let by_contents = &better.by_contents | &other.by_contents;
            *known = Hazard { also, by_contents, ..better };
        }
    }
}

/// Refuses a declared input that no function has.
fn expect_names(inputs: &Ranges, drawn: &Drawn) -> Result<(), HazardError> {
    let used = drawn.names();
    let Some(name) = inputs.names().find(|name| !used.contains(name.as_str())) else {
        return Ok(());
    };
    let nearest = nearest(name, used.iter().copied()).map(str::to_owned);
    Err(HazardError::UnknownInput { name: name.clone(), nearest })
}

fn shown(found: &Found) -> Option<(String, String)> {
    #[expect(clippy::cast_possible_truncation, reason = "shown with the digits of an f32")]
    found.values.map(|(single, double)| (format_f32(single), format_f32(double as f32)))
}

fn first_line(text: &str) -> String {
    crate::output::headline(text).to_owned()
}

/// The operands of an operation, as people read them.
fn operands(found: &Found) -> Vec<String> {
    /// Two vectors of four have as many.
    const MOST: usize = 8;
    let all = Some(&found.operands).filter(|all| all.len() <= MOST);
    all.into_iter().flatten().map(|x| format_f32(*x)).collect()
}

/// The pixel that takes a derivative and the one that doesn't, with the condition where it parted.
fn parted(function: &str, found: &Found) -> Option<Violation> {
    let Missing { reached, missing, parted } = found.missing.as_ref()?;
    let access = |span: &Span, invocation: &str, does: &str| ViolationAccess {
        place: span.to_string(),
        invocation: invocation.to_owned(),
        does: does.to_owned(),
    };
    let other = match parted {
        Some(parted) => access(parted, missing, "goes another way here"),
        None => access(&found.span, missing, "doesn't"),
    };
    let accesses = vec![access(&found.span, reached, "reaches it"), other];
    let headline = format!("`{function}` takes a derivative that {missing} doesn't reach");
    Some(Violation::new(function, ViolationKind::Barrier, (headline, 1), accesses))
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
        self.functions.iter().any(|name| hazard.functions().any(|function| is(name, function)))
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

impl Hazard {
    /// All functions in which the operation goes wrong.
    pub(super) fn functions(&self) -> impl Iterator<Item = &str> {
        std::iter::once(&self.function).chain(&self.also).map(String::as_str)
    }

    /// The form of the operation, which others share: its text without names and numbers.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let package = Package::from_source("m", "fn gamma(c: f32) -> f32 { return pow(c, 2.2); }");
    /// assert_eq!(package.hazards().run()?.found[0].idiom(), "pow(_, #)");
    /// # Ok::<(), karat::unstable::hazards::HazardError>(())
    /// ```
    #[must_use]
    pub fn idiom(&self) -> String {
        lowered::idiom(&self.text)
    }

    /// The lines below the first: where it came from, what it means and what else shows it.
    pub fn details(&self) -> impl fmt::Display + '_ {
        fmt::from_fn(move |f| self.write_details(f))
    }

    fn write_details(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named: Vec<String> =
            self.arguments.iter().map(|(name, value)| format!("{name} = {value}")).collect();
        let with = if named.is_empty() { "no argument".to_owned() } else { named.join("; ") };
        let (cases, of) = self.cases;
        let is_pass = self.arguments.first().is_some_and(|(name, _)| name == passes::INVOCATION);
        let counted = match (is_pass, &self.violation) {
            // Elements, of which an invocation has several, or several have one.
            (true, Some(_)) if self.at_tail => {
                format!("in {of} invocations, where the elements are no multiple of the workgroup")
            }
            (true, Some(one)) if self.kind == Kind::OutOfRange && !one.of_fixed_length => {
                format!("in {of} invocations, over sizes that are made up")
            }
            (true, Some(_)) => format!("in {of} invocations"),
            (true, None) => format!("{cases} of {of} invocations"),
            (false, _) => format!("{cases} of {of} inputs"),
        };
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
        if let Some(lowered) = self.lowered {
            write!(f, "; {}", lowered.about())?;
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
        writeln!(f, "{}: {}  at {}", self.kind.name(), self.text, self.location)?;
        self.write_details(f)
    }
}

impl fmt::Display for Hazards {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for hazard in &self.found {
            writeln!(f, "{hazard}\n")?;
        }
        let Self { package, functions, found, lowered, accepted, .. } = self;
        write!(
            f,
            "{package}: {} in {}, {} lowered, {accepted} accepted",
            counted(found.len(), "hazard"),
            counted(*functions, "function"),
            lowered.len()
        )
    }
}
