//! What an edit changed: every function of a package before and after it, with no test written.
//!
//! Functions and entry points whose linked text is the same aren't run. Other functions are called with
//! arguments that names and types suggest, and so are entry points of draws. Compute passes are dispatched over
//! made-up resources. Results are compared bit by bit; all NaNs are one value. A function without a result
//! isn't judged. Where each result is the same, the comparison lists lines of the edit that no input covers: their results are
//! unknown.
//!
//! ```no_run
//! use karat::Package;
//!
//! let (before, after) = (Package::open("old").unwrap(), Package::open("new").unwrap());
//! for one in karat::unstable::compare::Request::new(before, after).run().unwrap() {
//!     println!("{}: {:?}", one.function, one.change);
//! }
//! ```

mod passes;

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use serde::Serialize;

use crate::check::arguments;
use crate::dispatch::{Passes, Violation, ViolationAccess, ViolationKind};
use crate::domain::Stream;
use crate::executor::{self, Caller};
use crate::fixture::Fixtures;
use crate::interpret::{Coverage, evaluations, of_outside};
pub use crate::interpret::{Missed, Uncovered};
use crate::made_up::{self, Arguments, Drawn, Ranges, Resources, VARIANTS};
use crate::output::counted;
use crate::package::stage::Stage;
use crate::package::{Package, PackageError};
use crate::panics;
use crate::path::Path;
use crate::probe::{ProbeError, Probed};
use crate::reflect::{Binding, Function, Program};
use crate::tolerance::ulp_distance;
use crate::value::{Scalar, Shape, format_lane};

/// Inputs of each function: what runs in a moment on any path.
const CASES: usize = 4096;

/// The same arguments in every run.
const SEED: u64 = 0x0063_6f6d_7061_7265; // "compare"

/// The last corner of the twelve triangles of a box.
const LAST_VERTEX: f64 = 35.0;

/// Operations that the inputs of a function may come to over one content of its resources: a second or two of one core.
const WORK: u64 = 1 << 25;

/// Inputs by which work is measured, and which are run in any case.
const SAMPLE: usize = 16;

/// Inputs, of more, whose equal results are a verdict.
const LEAST: usize = 64;

/// Rounds in which a changed input is made simpler.
const ROUNDS: usize = 64;

/// Two packages, of which one is an edit of the other.
///
/// ```
/// use karat::Package;
/// use karat::unstable::compare::{Change, Request};
///
/// let package = |text| Package::from_source("m", text);
/// let before = package("fn half(x: f32) -> f32 { return 0.5 * x; }");
/// let after = package("fn half(x: f32) -> f32 { return 0.6 * x; }");
/// let compared = Request::new(before, after).run()?;
/// assert!(!matches!(compared[0].change, Change::Same { .. }));
/// # Ok::<(), karat::package::PackageError>(())
/// ```
#[derive(Clone, Debug)]
#[must_use = "nothing is compared until `.run()`"]
pub struct Request {
    before: Package,
    after: Package,
    only: Vec<String>,
    cases: usize,
    paths: Vec<Path>,
}

/// A function of either package.
#[derive(Clone, Debug, Serialize)]
pub struct Compared {
    /// `fresnel::schlick`
    pub function: String,
    /// `file:line:column`, after the edit where it is there.
    pub location: String,
    /// What the edit did.
    #[serde(flatten)]
    pub change: Change,
    /// Resources that a host has to supply in another way, a sentence each: another `@binding`, another place of a
    /// buffer's member.
    pub interface: Vec<String>,
    /// The ranges that arguments and members were drawn from; empty where nothing was run.
    pub drawn: Drawn,
    /// Inputs that weren't run, because they are too much work.
    pub cut: usize,
    /// Invocations in each direction of a compute pass, whose cases are the words that it leaves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dispatched: Option<[u32; 3]>,
    /// Violations that a compute pass, or the pixels of a draw that write storage, have after the edit, and hadn't before it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub violations: Vec<Violation>,
    /// Where nothing changed: lines of the edit, before it or after it, that no input came to, and conditions that each input
    /// decided alike. Of these nothing is known.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub uncovered: Vec<Uncovered>,
}

/// What an edit did to a function.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "change", rename_all = "snake_case")]
#[non_exhaustive]
pub enum Change {
    /// Neither it nor what it uses was edited, but for comments and blanks.
    Untouched,
    /// It was edited, and each result has the same bits.
    Same {
        /// Inputs that were tried on each path.
        cases: usize,
    },
    /// Some results changed.
    Changed {
        /// Each path with a change.
        paths: Vec<PathChange>,
    },
    /// It takes or returns something else.
    Signature {
        /// As it was.
        before: String,
        /// As it is.
        after: String,
    },
    /// It is new.
    Added,
    /// It is gone.
    Removed,
    /// It can't be compared.
    Unjudged {
        /// Why.
        reason: String,
    },
}

/// How results changed on one path.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PathChange {
    /// The path.
    pub path: String,
    /// Inputs whose results changed, of how many.
    pub cases: (usize, usize),
    /// The largest change in `f32` steps; `None` where something became NaN or ceased to be it, or
    /// isn't a float.
    pub ulp: Option<u64>,
    /// The largest change relative to the value before; `None` likewise.
    pub relative: Option<f64>,
    /// The simplest arguments found whose result changed as much: it became NaN or ceased to be it, or it
    /// changed by half as many binary digits of `ulp`, at least. Behind them the members of buffers that aren't elements of
    /// arrays.
    pub arguments: Vec<(String, String)>,
    /// The result for these before the edit.
    pub before: String,
    /// And after it.
    pub after: String,
    /// Of a compute pass: the first word that changed of each resource, the one that `before` and `after` are about first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub words: Vec<WordChange>,
}

/// A word of a resource that a compute pass leaves in another way.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WordChange {
    /// The resource's name.
    pub resource: String,
    /// The word by its name, before the edit: `counts[3] = 1`.
    pub before: String,
    /// Its value after it.
    pub after: String,
}

impl Compared {
    fn of(function: &str, change: Change) -> Self {
        let (location, interface, drawn, violations, uncovered) = Default::default();
        let (function, dispatched, cut) = (function.to_owned(), None, 0);
        Self {
            function,
            location,
            change,
            interface,
            drawn,
            cut,
            dispatched,
            violations,
            uncovered,
        }
    }
}

impl Request {
    /// Compares a package with an edited one, on the path `cpu` unless others are named.
    pub fn new(before: Package, after: Package) -> Self {
        Self { before, after, only: Vec::new(), cases: CASES, paths: vec![Path::CPU] }
    }

    /// Only functions whose name contains one of these.
    pub fn only<'n>(self, names: impl IntoIterator<Item = &'n str>) -> Self {
        Self { only: names.into_iter().map(str::to_owned).collect(), ..self }
    }

    /// Inputs of each function, 4,096 unless it is said.
    pub fn cases(self, cases: usize) -> Self {
        Self { cases, ..self }
    }

    /// Runs functions on these paths.
    pub fn paths(self, paths: Vec<Path>) -> Self {
        Self { paths, ..self }
    }

    /// Compares, in the order of names.
    ///
    /// # Errors
    /// If a package can't be read.
    pub fn run(&self) -> Result<Vec<Compared>, PackageError> {
        self.run_with(&|_, _, _| {})
    }

    /// [`run`](Self::run), which tells each verdict as soon as all before it are there, with their count, and of how many.
    ///
    /// # Errors
    /// As [`run`](Self::run).
    pub fn run_with(
        &self,
        told: &(dyn Fn(&Compared, usize, usize) + Sync),
    ) -> Result<Vec<Compared>, PackageError> {
        let names = |package: &Package| -> Result<BTreeMap<String, Option<Stage>>, PackageError> {
            let items = package.functions()?.into_iter();
            let wanted = |name: &String| {
                self.only.is_empty() || self.only.iter().any(|part| name.contains(part.as_str()))
            };
            let items = items.map(|item| (item.name, item.entry_point));
            Ok(items.filter(|(name, _)| wanted(name)).collect())
        };
        let (before, after) = (names(&self.before)?, names(&self.after)?);
        let all: BTreeMap<&String, _> = before
            .keys()
            .chain(after.keys())
            .map(|name| (name, (before.get(name), after.get(name))))
            .collect();
        let of = all.len();
        type There<'t> = Option<&'t Option<Stage>>;
        let verdict = |name: &String, there: (There<'_>, There<'_>)| match there {
            (Some(None), Some(None)) => self.compare(name, None),
            (Some(was), Some(is)) if was == is => self.compare(name, *is),
            (Some(was), Some(is)) => {
                let shown = |stage: &Option<Stage>| {
                    let function = || format!("fn {name}");
                    stage.map_or_else(function, |stage| format!("@{stage} fn {name}"))
                };
                let change = Change::Signature { before: shown(was), after: shown(is) };
                Compared::of(name, change)
            }
            (Some(_), None) => Compared::of(name, Change::Removed),
            _ => Compared::of(name, Change::Added),
        };
        let done = Mutex::new((0, BTreeMap::new()));
        let all: Vec<_> = all.into_iter().enumerate().collect();
        let compared = all.into_par_iter().map(|(at, (name, there))| {
            let one = panics::caught(|| verdict(name, there)).unwrap_or_else(|panicked| {
                let reason = format!("Karat panics at it: {panicked}");
                Compared::of(name, Change::Unjudged { reason })
            });
            // In the order of names, so that the same verdicts are the same text.
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

    fn compare(&self, name: &str, stage: Option<Stage>) -> Compared {
        let compared = |change| Compared::of(name, change);
        let unjudged = |error: &dyn std::fmt::Display| {
            let reason = error.to_string().replacen("error: ", "", 1);
            let reason = reason.lines().next().unwrap_or_default().to_owned();
            compared(Change::Unjudged { reason })
        };
        // What can't be called may be untouched all the same.
        let (module, own) = name.rsplit_once("::").unwrap_or(("", name));
        let linked = |package: &Package| Program::of_items(package, module, &[own]);
        let linked = (linked(&self.before), linked(&self.after));
        let mut interface_of_stage = Vec::new();
        if let (Ok(before), Ok(after)) = &linked {
            if before.normalized_text() == after.normalized_text() {
                return compared(Change::Untouched);
            }
            interface_of_stage = attributes(&before.attributes(own), &after.attributes(own));
        }
        if stage == Some(Stage::Compute) {
            let compared = self.compare_passes(name);
            let interface = [interface_of_stage, compared.interface].concat();
            return Compared { interface, ..compared };
        }
        let probed = |package: &Package| Probed::new(package, name).and_then(made_up::fitted);
        let (before, after) = match (probed(&self.before), probed(&self.after)) {
            (Ok(before), Ok(after)) => (before, after),
            (Err(error), Err(_)) => return unjudged(&format!("it was edited, and {error}")),
            (Err(error), _) => return unjudged(&format!("before: {error}")),
            (_, Err(error)) => return unjudged(&format!("after: {error}")),
        };
        // An edit may have brought derivatives in, or taken them away.
        let (before, after) = match (before.takes_derivatives(), after.takes_derivatives()) {
            (true, false) => (before, after.varying()),
            (false, true) => (before.varying(), after),
            _ => (before, after),
        };
        let location = after.function.span.to_string();
        let shapes = |function: &Function| {
            let parameters = function.parameters.iter().map(|(_, shape)| shape.clone());
            (parameters.collect::<Vec<_>>(), function.result.clone(), function.form.taken.clone())
        };
        if shapes(&before.function) != shapes(&after.function) {
            let mut shown = [&before, &after].map(|one| one.function.to_string());
            // A signature doesn't show the resources that a function writes.
            if shown[0] == shown[1] {
                let given = |one: &Probed| {
                    let all = match &one.function.result {
                        Shape::Struct { members, .. } => members.as_slice(),
                        _ => &[],
                    };
                    let written = all.iter().skip(one.function.outputs().len());
                    let written: Vec<String> =
                        written.map(|(name, shape)| format!("{name}: {shape}")).collect();
                    let written = match written.is_empty() {
                        true => "nothing".to_owned(),
                        false => written.join(", "),
                    };
                    format!("{}, and writes {written}", one.function)
                };
                shown = [&before, &after].map(given);
            }
            let [before, after] = shown;
            return Compared { location, ..compared(Change::Signature { before, after }) };
        }
        let mut ran = Ran::default();
        let unseen = |reason: String| {
            let reason = reason.replacen("error: ", "", 1);
            let reason = reason.lines().next().unwrap_or_default().to_owned();
            Change::Unjudged { reason }
        };
        let mut change = self.run_both(&before, &after, &mut ran).unwrap_or_else(unseen);
        let mut violations = Vec::new();
        if after.function.form.alone && stage == Some(Stage::Fragment) {
            let renamed = renamed(Side::of(&before), Side::of(&after));
            match self.brought_to_pixels(name, renamed) {
                Ok(brought) => violations = brought,
                // A change says more than that pixels can't be run beside each other.
                Err(reason) if matches!(change, Change::Same { .. }) => change = unseen(reason),
                Err(_) => {}
            }
        }
        if matches!(change, Change::Same { .. }) && violations.is_empty() {
            violations.extend(ran.reached.outside(name));
        }
        let uncovered = match change {
            Change::Same { .. } if violations.is_empty() => ran.reached.uncovered(),
            _ => Vec::new(),
        };
        let Ran { drawn, cut, .. } = ran;
        let interface =
            [interface_of_stage, interface(Side::of(&before), Side::of(&after))].concat();
        Compared { location, interface, drawn, cut, violations, uncovered, ..compared(change) }
    }

    /// Runs both on each path, over each content of buffers.
    fn run_both(&self, before: &Probed, after: &Probed, ran: &mut Ran) -> Result<Change, String> {
        let mut ranges = Ranges::of(&self.after).map_err(|error| error.to_string())?;
        // A shader may look its corners up: one of 3 is as right as one of 36, and both sides have the same.
        for (path, builtin) in &after.function.form.builtins {
            if matches!(&**builtin, "vertex_index" | "instance_index") && ranges.get(path).is_none()
            {
                ranges.declare(path, 0.0, LAST_VERTEX)?;
            }
        }
        let literals = before.program.literals().and(&after.program.literals());
        let ranges = ranges.with_literals(literals);
        let arguments = Arguments::of(&after.function, &ranges)?;
        ran.drawn = arguments.drawn();
        let (count, rows) = arguments.rows(SEED, self.cases);
        if count == 0 {
            return Err("no arguments can be made up for it".to_owned());
        }
        let mut paths: Vec<PathChange> = Vec::new();
        let (mut cases, mut left_out) = (0, 0);
        for variant in 0..VARIANTS {
            let (all, rows) = arguments.part(&rows, count, variant);
            // What one of them reads and the other doesn't is made up for the one that reads it.
            let mut old = Resources::of(before, &ranges, variant)?;
            let mut new = Resources::of(after, &ranges, variant)?;
            hold_the_same([&mut old.fixtures, &mut new.fixtures], before, after);
            ran.drawn.merge(new.drawn);
            let varies = old.varies || new.varies;
            let members = new.members;
            let held = [old.fixtures, new.fixtures];
            let Bounded { count, rows, simpler } =
                bounded([before, after], &held, &arguments, (all, &rows));
            ran.cut += all - count;
            left_out += all - count;
            for path in self.paths.iter().filter(|_| count > 0) {
                let both = || -> Result<_, ProbeError> {
                    let executor = executor::of(*path)?;
                    let old = Caller::new(executor, Cow::Borrowed(before), &held[0], count)?;
                    Ok((old, Caller::new(executor, Cow::Borrowed(after), &held[1], count)?))
                };
                let (old, new) = both().map_err(|error| error.to_string())?;
                let mut tried = (count, Cow::Borrowed(&*rows));
                let inputs = (&*rows, count, simpler);
                let change = match changed(&old, &new, &arguments, inputs) {
                    // A loop that counts to a large number ends, but not here. One that ended before the edit is
                    // another thing.
                    Err(ProbeError::Rounds { .. }) => {
                        if old.results(&rows, count).is_ok() {
                            return Err("after the edit a loop of it doesn't end".to_owned());
                        }
                        let few = arguments.few(&rows);
                        tried = (few.len() / (rows.len() / count).max(1), Cow::Owned(few));
                        ran.cut += count - tried.0;
                        changed(&old, &new, &arguments, (&tried.1, tried.0, simpler))
                    }
                    other => other,
                };
                cases += tried.0;
                let Some(mut change) = change.map_err(|error| error.to_string())? else {
                    ran.reached.add_calls([before, after], &held, (tried.0, &tried.1));
                    continue;
                };
                change.arguments.extend_from_slice(&members);
                match paths.iter_mut().find(|known| known.path == change.path) {
                    Some(known) => known.add(change),
                    None => paths.push(change),
                }
            }
            if !varies {
                break;
            }
        }
        let each = cases / self.paths.len().max(1);
        if each == 0 {
            return Err("each of its inputs makes a loop count too far".to_owned());
        }
        if paths.is_empty() && each < LEAST && left_out > 0 {
            let inputs = counted(each, "input");
            return Err(format!(
                "not looked at whole: {inputs} of {} give the same results, and more is too much work",
                each + left_out
            ));
        }
        paths.iter_mut().for_each(|path| path.cases.1 = each);
        Ok(match paths.is_empty() {
            true => Change::Same { cases: each },
            false => Change::Changed { paths },
        })
    }
}

/// The inputs that a comparison ran over.
#[derive(Default)]
struct Ran {
    drawn: Drawn,
    cut: usize,
    reached: Both,
}

/// The coverage of both sides of an edit.
#[derive(Default)]
struct Both {
    sides: [Coverage; 2],
    /// True if a result depends on an index outside after the edit, and doesn't before it.
    strays: bool,
}

impl Both {
    /// Adds calls of both sides. What the engine doesn't execute, for which other paths have values, reaches nothing.
    fn add_calls(&mut self, sides: [&Probed; 2], fixtures: &[Fixtures; 2], rows: (usize, &[u32])) {
        for ((reach, side), fixtures) in self.sides.iter_mut().zip(sides).zip(fixtures) {
            let _ = reach.add_calls(side, fixtures, rows);
        }
        let [before, after] = &self.sides;
        if self.strays || after.outside_beside(before).is_empty() {
            return;
        }
        let strays = |side: usize| of_outside(sides[side], &fixtures[side], rows);
        if let (Ok(before), Ok(after)) = (strays(0), strays(1)) {
            self.strays = after.iter().zip(&before).any(|(after, before)| *after && !before);
        }
    }

    fn add_passes(&mut self, sides: [&Passes; 2]) {
        for (reach, side) in self.sides.iter_mut().zip(sides) {
            let _ = reach.add_passes(side);
        }
    }

    fn uncovered(&self) -> Vec<Uncovered> {
        let [before, after] = &self.sides;
        [after.uncovered_beside(before), before.uncovered_beside(after)].concat()
    }

    /// The index outside that an edit brings to a function, and that its results depend on.
    fn outside(&self, function: &str) -> Option<Violation> {
        let [before, after] = &self.sides;
        let place = after.outside_beside(before).into_iter().next().filter(|_| self.strays)?;
        let headline = format!(
            "`{function}` has an index outside of an array or a texture, and its results depend on it"
        );
        let does = "has an index beyond the array, or its texture's edge".to_owned();
        let (place, invocation) = (place.to_string(), "a call".to_owned());
        let access = ViolationAccess { place, invocation, does };
        Some(Violation::new(function, ViolationKind::Outside, (headline, 1), vec![access]))
    }
}

/// A function or an entry point on one side of an edit, with its resources.
#[derive(Clone, Copy)]
struct Side<'s> {
    program: &'s Program,
    bindings: &'s [Binding],
}

impl<'s> Side<'s> {
    fn of(probed: &'s Probed) -> Self {
        Self { program: &probed.program, bindings: &probed.function.bindings }
    }

    /// True if a resource lies in memory as another side's does.
    fn has_layout(self, binding: &Binding, other: Self, is: &Binding) -> bool {
        let layout = |side: Self, binding: &Binding| {
            let lanes = side.program.written_shape(binding, Some(256)).map(|shape| shape.lanes());
            (lanes, side.program.least_bytes(binding), side.program.places(binding))
        };
        layout(self, binding) == layout(other, is)
    }
}

/// The resource before an edit: that of the same name, or one that isn't there any more and was bound where
/// this one is.
fn was<'b>(before: Side<'b>, after: Side<'_>, new: &Binding) -> Option<&'b Binding> {
    let is_gone = |old: &Binding| after.bindings.iter().all(|new| new.path != old.path);
    let place = |one: &Binding| (one.group, one.binding, one.kind);
    let olds = before.bindings;
    olds.iter()
        .find(|old| old.path == new.path)
        .or_else(|| olds.iter().find(|old| place(old) == place(new) && is_gone(old)))
}

/// Resources that have another name after an edit and the same layout: their paths before it and after it.
fn renamed(before: Side<'_>, after: Side<'_>) -> Vec<(String, String)> {
    let of = |is: &Binding| {
        let was = was(before, after, is).filter(|was| was.path != is.path)?;
        before.has_layout(was, after, is).then(|| (was.path.clone(), is.path.clone()))
    };
    after.bindings.iter().filter_map(of).collect()
}

/// A resource with another name, or with other names of its members, holds the same: contents come from names. One that is
/// written on one side is as long as that side's on both.
fn hold_the_same([old, new]: [&mut Fixtures; 2], before: &Probed, after: &Probed) {
    let of = |fixtures: &Fixtures, path: &str| fixtures.iter().position(|(name, _)| name == path);
    let mut named = renamed(Side::of(before), Side::of(after));
    named.extend(with_renamed_members(before, after));
    for (was, is) in named {
        if let (Some(from), Some(to)) = (of(new, &is), of(old, &was)) {
            old[to].1 = new[from].1.clone();
        }
    }
    let written = |side: &Probed, path: &str| {
        let mut bindings = side.function.bindings.iter();
        bindings.any(|one| one.path == path && one.kind.is_written())
    };
    for (path, was) in old {
        let Some(at) = of(new, path) else { continue };
        match (written(before, path), written(after, path)) {
            (true, false) => new[at].1 = was.clone(),
            (false, true) => *was = new[at].1.clone(),
            _ => {}
        }
    }
}

/// Buffers of one name whose members have other names, and the same types at the same places.
fn with_renamed_members(before: &Probed, after: &Probed) -> Vec<(String, String)> {
    fn names(shape: &Shape, all: &mut BTreeSet<String>) {
        match shape {
            Shape::Struct { members, .. } => members.iter().for_each(|(name, member)| {
                all.insert(name.clone());
                names(member, all);
            }),
            Shape::Array { element, .. } => names(element, all),
            _ => {}
        }
    }
    let of = |side: &Probed, binding: &Binding| {
        let shape = side.program.buffer_of(binding, 1)?;
        let mut all = BTreeSet::new();
        names(&shape, &mut all);
        Some((shape.lanes(), all, side.program.least_bytes(binding)))
    };
    let is_renamed = |new: &&Binding| {
        let mut bindings = before.function.bindings.iter();
        let old = bindings.find(|old| old.path == new.path);
        old.and_then(|old| Some((of(before, old)?, of(after, new)?)))
            .is_some_and(|(old, new)| (&old.0, old.2) == (&new.0, new.2) && old.1 != new.1)
    };
    let all = after.function.bindings.iter().filter(is_renamed);
    all.map(|one| (one.path.clone(), one.path.clone())).collect()
}

/// How the host has to connect an entry point in another way: attributes of its inputs and outputs.
fn attributes(before: &[(String, String)], after: &[(String, String)]) -> Vec<String> {
    let of = |(path, is): &(String, String)| {
        let (_, was) = before.iter().find(|(known, _)| known == path)?;
        (was != is).then(|| format!("`{path}` is {is}, and was {was}"))
    };
    after.iter().filter_map(of).collect()
}

/// How the host has to supply resources in another way after an edit: bindings and places of members.
fn interface(before: Side<'_>, after: Side<'_>) -> Vec<String> {
    let mut all = Vec::new();
    for new in after.bindings {
        let Some(old) = was(before, after, new) else { continue };
        let name = new.name();
        let at =
            |binding: &Binding| format!("@group({}) @binding({})", binding.group, binding.binding);
        if (old.group, old.binding) != (new.group, new.binding) {
            all.push(format!("`{name}` is bound at {}, and was at {}", at(new), at(old)));
        }
        if old.kind != new.kind {
            let [was, is] = [old, new].map(|binding| binding.kind.to_string());
            let access = |one: &Binding| if one.kind.is_written() { "read_write" } else { "read" };
            all.push(match was == is {
                true => format!("`{name}` is {}, and was {}", access(new), access(old)),
                false => format!("`{name}` is a {is}, and was a {was}"),
            });
        }
        let bytes = |side: Side<'_>, binding: &Binding| side.program.least_bytes(binding);
        if bytes(before, old) != bytes(after, new) {
            let (was, is) = (bytes(before, old), bytes(after, new));
            all.push(format!("`{name}` takes {is} bytes, and took {was}"));
        }
        let (was, is) = (before.program.places(old), after.program.places(new));
        let moved = is.iter().find_map(|(path, place)| {
            let (_, old) = was.iter().find(|(known, _)| known == path)?;
            (old != place).then(|| format!("`{name}{path}` lies at byte {place}, and was at {old}"))
        });
        all.extend(moved);
    }
    all
}

impl PathChange {
    /// Adds what the same edit did over other contents of buffers. The larger change is the one that is shown;
    /// between a number and NaN there is no larger one.
    fn add(&mut self, other: Self) {
        let cases = self.cases.0 + other.cases.0;
        let larger = |ulp: Option<u64>| ulp.unwrap_or(u64::MAX);
        let less = match larger(other.ulp) > larger(self.ulp) {
            true => std::mem::replace(self, other),
            false => other,
        };
        self.cases.0 = cases;
        // Other contents may show another resource.
        for one in less.words {
            if self.words.iter().all(|known| known.resource != one.resource) {
                self.words.push(one);
            }
        }
    }
}

/// Inputs that fit into the work of a function over one content of its resources.
struct Bounded {
    count: usize,
    rows: Vec<u32>,
    /// How many more there may be to make one simpler.
    simpler: usize,
}

/// Bounds the work of a function: by what a few inputs evaluate, so that the same are left out on every machine. Where a loop
/// counts too far for those before the edit, the inputs with small numbers remain; if it does so for those as well, none.
fn bounded(
    sides: [&Probed; 2],
    held: &[Fixtures; 2],
    arguments: &Arguments,
    (count, rows): (usize, &[u32]),
) -> Bounded {
    let sample = |count: usize, rows: &[u32]| {
        let each = count.div_ceil(SAMPLE).max(1);
        arguments.select(rows, count, |at| at % each == 0)
    };
    let mut own = (count, Cow::Borrowed(rows));
    for _ in 0..2 {
        let (some, few) = sample(own.0, &own.1);
        let cost = |side: usize| evaluations(sides[side], &held[side], (some, &few));
        match [cost(0), cost(1)] {
            [Ok(Some(before)), Ok(Some(after))] => {
                let fit = usize::try_from(WORK / before.max(after).max(1)).unwrap_or(usize::MAX);
                let each = own.0.div_ceil(fit.max(SAMPLE)).max(1);
                let (count, rows) = arguments.select(&own.1, own.0, |at| at % each == 0);
                return Bounded { count, rows, simpler: fit };
            }
            // After the edit it may not end, which these show.
            [Ok(Some(_)), Ok(None)] => {
                return Bounded { count: some, rows: few, simpler: 0 };
            }
            [Ok(None), _] => {
                let few = arguments.few(&own.1);
                own = (few.len().checked_div(arguments.width()).unwrap_or(0), Cow::Owned(few));
            }
            // Other paths may run what the engine doesn't.
            _ => return Bounded { count: own.0, rows: own.1.into_owned(), simpler: usize::MAX },
        }
    }
    Bounded { count: 0, rows: Vec::new(), simpler: 0 }
}

/// How results differ on a path; `None` if they don't.
fn changed(
    old: &Caller<'_>,
    new: &Caller<'_>,
    drawn: &Arguments,
    (rows, count, simpler): (&[u32], usize, usize),
) -> Result<Option<PathChange>, ProbeError> {
    let function = &new.probed.function;
    let scalars = function.result.lanes();
    let (was, is) = (old.results(rows, count)?, new.results(rows, count)?);
    let width = rows.len() / count.max(1);
    let by = |was: &[u32], is: &[u32]| -> Option<Distance> {
        let lanes = scalars.iter().zip(was.iter().zip(is));
        lanes.filter_map(|(scalar, (was, is))| distance(*scalar, *was, *is)).max()
    };
    let pairs = || was.chunks_exact(scalars.len()).zip(is.chunks_exact(scalars.len())).enumerate();
    // Of equal distances the first: edges come first, and are the simplest.
    let far = |(case, (was, is)): (usize, _)| Some((by(was, is)?, std::cmp::Reverse(case)));
    let Some((farthest, std::cmp::Reverse(first))) = pairs().filter_map(far).max() else {
        return Ok(None);
    };
    let total = pairs().filter(|(_, (was, is))| by(was, is).is_some()).count();
    let (mut ulp, mut relative) = (Some(0), Some(0.0_f64));
    for (_, (was, is)) in pairs() {
        for ((scalar, was), is) in scalars.iter().zip(was).zip(is) {
            let Some(distance) = distance(*scalar, *was, *is) else { continue };
            let (a, b) = (f64::from(f32::from_bits(*was)), f64::from(f32::from_bits(*is)));
            let share = Some((b - a).abs() / a.abs());
            let share = share.filter(|share| share.is_finite() && scalar.is_float());
            ulp = ulp.zip(distance.ulp()).map(|(most, own)| most.max(own));
            relative = relative.zip(share).map(|(most, own)| most.max(own));
        }
    }
    let mut row = rows[first * width..][..width].to_vec();
    let mut left = simpler;
    for _ in 0..ROUNDS {
        let simpler = drawn.domain.shrink(&row);
        let all = simpler.concat();
        if simpler.is_empty() || width == 0 || simpler.len() > left {
            break;
        }
        left -= simpler.len();
        let (was, is) = (old.results(&all, simpler.len())?, new.results(&all, simpler.len())?);
        let mut pairs = was.chunks_exact(scalars.len()).zip(is.chunks_exact(scalars.len()));
        let as_far =
            |(was, is): (&[u32], &[u32])| by(was, is).is_some_and(|own| own.is_like(farthest));
        match pairs.position(as_far) {
            Some(at) => row.clone_from(&simpler[at]),
            None => break,
        }
    }
    let (was, is) = (old.results(&row, 1)?, new.results(&row, 1)?);
    Ok(Some(PathChange {
        path: old.path.to_string(),
        cases: (total, count),
        ulp,
        relative,
        arguments: arguments(function, &row),
        before: told(&function.result, &was, (&was, &is)),
        after: told(&function.result, &is, (&was, &is)),
        words: Vec::new(),
    }))
}

/// Components of a result that are shown whole; of more, such as a buffer, only those that changed.
const WHOLE: usize = 16;

/// A result as it is shown.
fn told(shape: &Shape, own: &[u32], (was, is): (&[u32], &[u32])) -> String {
    let scalars = shape.lanes();
    if scalars.len() <= WHOLE {
        return shape.format(own);
    }
    let names = shape.lane_names();
    let differs = |lane: &usize| distance(scalars[*lane], was[*lane], is[*lane]).is_some();
    let changed: Vec<usize> = (0..scalars.len()).filter(differs).collect();
    let one = |lane: &usize| {
        format!(
            "{} = {}",
            names[*lane].trim_start_matches('.'),
            format_lane(scalars[*lane], own[*lane])
        )
    };
    let shown = changed.iter().take(4).map(one).collect::<Vec<_>>().join(", ");
    match changed.len().saturating_sub(4) {
        0 => shown,
        more => format!("{shown} and {more} more of {}", scalars.len()),
    }
}

/// How far two results are from each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Distance {
    /// Of integers and booleans, which are equal or not.
    Other,
    /// In `f32` steps.
    Ulp(u64),
    /// Between a number and NaN.
    Nan,
}

impl Distance {
    fn ulp(self) -> Option<u64> {
        if let Self::Ulp(steps) = self { Some(steps) } else { None }
    }

    /// Whether it shows what a larger one shows: it has half of its binary digits.
    fn is_like(self, farthest: Self) -> bool {
        match (self, farthest) {
            (Self::Ulp(own), Self::Ulp(most)) => own >= most.isqrt(),
            (own, most) => own == most,
        }
    }
}

/// `None` if two words are one value: bit by bit, but for NaN.
fn distance(scalar: Scalar, was: u32, is: u32) -> Option<Distance> {
    if was == is {
        return None;
    }
    if !scalar.is_float() {
        return Some(Distance::Other);
    }
    let (a, b) = (f32::from_bits(was), f32::from_bits(is));
    match (a.is_nan(), b.is_nan()) {
        (true, true) => None,
        (false, false) => Some(ulp_distance(a, b).map_or(Distance::Nan, Distance::Ulp)),
        _ => Some(Distance::Nan),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changes(before: &str, after: &str) -> Vec<(String, Change)> {
        let package = |text: &str| Package::from_source("p", text);
        let compared = Request::new(package(before), package(after)).run().expect("it reads");
        compared.into_iter().map(|one| (one.function, one.change)).collect()
    }

    #[test]
    fn an_edit_is_told_by_what_it_changes() {
        let before = "// old\nfn half(x: f32) -> f32 { return x / 2.0; }\n\
                      fn user(x: f32) -> f32 { return half(x) + 1.0; }\n\
                      fn gone() -> u32 { return 1u; }\nfn other(x: f32) -> f32 { return x; }\n";
        let after = "/* new /* nested */ */\nfn half(x: f32) -> f32 { return 0.5 * x; }\n\
                     fn user(x: f32) -> f32 {\n return half(x) +   1.0; }\n\
                     fn more() -> u32 { return 1u; }\nfn other(x: vec2f) -> f32 { return x.x; }\n";
        let all = changes(before, after);
        let of = |name: &str| {
            let found = all.iter().find(|(function, _)| function == name);
            found.map(|(_, change)| change.clone()).expect("it is compared")
        };
        assert!(matches!(of("half"), Change::Same { cases: CASES, .. }), "{:?}", of("half"));
        assert!(matches!(of("user"), Change::Same { .. }), "it calls what was edited");
        assert_eq!((of("gone"), of("more")), (Change::Removed, Change::Added));
        assert!(matches!(of("other"), Change::Signature { .. }));
        let untouched = changes(before, &before.replace("// old", "// a comment"));
        assert!(untouched.iter().all(|(_, change)| *change == Change::Untouched), "{untouched:?}");
    }

    /// Of a function, and of one that writes what others see.
    #[test]
    fn lines_that_no_argument_comes_to_are_told() {
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
        let all = Request::new(before, after).run().expect("they read");
        assert!(all.iter().all(|one| matches!(one.change, Change::Same { .. })), "{all:?}");
        let lines =
            |one: &Compared| one.uncovered.iter().map(|line| line.text.clone()).collect::<Vec<_>>();
        let of_f = ["if x * x == 1234.56 { return 3.0; }", "if x * x == 1234.56 { return 2.0; }"];
        assert_eq!(lines(&all[0]), of_f, "{all:?}");
        assert_eq!(lines(&all[1]), ["seen[0] = 3.0;", "seen[0] = 2.0;"], "{all:?}");
    }

    fn compared(before: &str, after: &str) -> Compared {
        let [before, after] = [before, after].map(|text| Package::from_source("p", text));
        let mut all = Request::new(before, after).run().expect("they read");
        all.pop().expect("a function")
    }

    /// A condition that each input decides alike says nothing of its other way.
    #[test]
    fn conditions_that_each_input_decides_alike_are_told() {
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

    /// Where an index leaves its array the engine reads as drivers may: the last element, which a guard chose, too.
    #[test]
    fn an_index_outside_that_an_edit_brings_is_told() {
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
        assert_eq!(brought.kind, ViolationKind::Outside);
        assert_eq!(brought.accesses[0].place, "<p>:3:28", "{brought:?}");
        assert!(compared(&bare, &guarded).violations.is_empty(), "an edit may mend it");
        // An element outside that is given up matters to no result.
        let given_up = compared(
            &of("select(0.0, all[min(i, 3u)], i < 4u)"),
            &of("select(0.0, all[i], i < 4u)"),
        );
        assert!(given_up.violations.is_empty(), "{given_up:?}");
    }

    /// A length that a result shows is that of one buffer, whichever side may write it.
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
            (&read, &written, "`d` is read_write, and was read"),
            (&written, &read, "`d` is read, and was read_write"),
        ] {
            let one = compared(was, is);
            assert!(matches!(one.change, Change::Same { .. }), "{one:?}");
            assert_eq!(one.interface, [told]);
        }
        // What both read has other lengths, and so has a function that takes one for another.
        let one = compared(&read, &read.replace("arrayLength(&other)", "64u"));
        assert!(matches!(one.change, Change::Changed { .. }), "{one:?}");
    }

    /// A function that writes runs case by case, and each case covers its own lines.
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

    /// All NaNs are one value, and no number is near to them.
    #[test]
    fn words_are_as_far_as_their_values() {
        let far = |was: f32, is: f32| distance(Scalar::F32, was.to_bits(), is.to_bits());
        let nan = f32::from_bits(f32::NAN.to_bits() ^ 5);
        assert_eq!([far(1.0, 1.0), far(f32::NAN, nan)], [None; 2]);
        assert_eq!([far(1.0, nan), far(nan, 1.0)], [Some(Distance::Nan); 2]);
        assert_eq!(far(1.0, 1.0_f32.next_up()), Some(Distance::Ulp(1)));
        assert_eq!(distance(Scalar::U32, 0x7fc0_0000, 0x7fc0_0001), Some(Distance::Other));
        let like = |own: Distance, most: Distance| own.is_like(most);
        assert!(
            like(Distance::Ulp(10), Distance::Ulp(100))
                && !like(Distance::Ulp(9), Distance::Ulp(100))
        );
        assert!(like(Distance::Nan, Distance::Nan) && !like(Distance::Ulp(9), Distance::Nan));
    }

    /// Of many components the first four that changed are shown, and the others are counted.
    #[test]
    fn the_first_components_that_changed_are_shown() {
        let of = |changed: u32, length: u32| {
            let element = Box::new(Shape::Scalar(Scalar::U32));
            let was = vec![0; length as usize];
            let is: Vec<u32> =
                (0..length).map(|at| if at < changed { at + 1 } else { 0 }).collect();
            told(&Shape::Array { element, length }, &is, (&was, &is))
        };
        assert_eq!(of(1, 17), "[0] = 1");
        assert_eq!(of(4, 17), "[0] = 1, [1] = 2, [2] = 3, [3] = 4");
        assert_eq!(of(5, 17), "[0] = 1, [1] = 2, [2] = 3, [3] = 4 and 1 more of 17");
        assert!(of(1, 16).contains("1, 0, 0"), "fewer are shown whole: {}", of(1, 16));
    }

    /// Over several contents the largest change is shown, each resource has its first word, and cases add up.
    #[test]
    fn changes_over_several_contents_add_up() {
        let change = |ulp: Option<u64>, resource: &str, after: &str| {
            let word = WordChange {
                resource: resource.to_owned(),
                before: format!("{resource}[0] = 0"),
                after: after.to_owned(),
            };
            let (path, before, after) = ("cpu".to_owned(), word.before.clone(), after.to_owned());
            let (cases, relative, arguments) = ((2, 9), None, Vec::new());
            PathChange { path, cases, ulp, relative, arguments, before, after, words: vec![word] }
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

    /// Each input and output that has another attribute is told, and no other one.
    #[test]
    fn each_attribute_that_changes_is_told() {
        let of = |all: &[(&str, &str)]| {
            all.iter()
                .map(|(path, is)| ((*path).to_owned(), (*is).to_owned()))
                .collect::<Vec<(String, String)>>()
        };
        let before = of(&[("in.a", "@location(0)"), ("in.b", "@location(1)"), ("in.c", "flat")]);
        let after = of(&[("in.new", "flat"), ("in.b", "@location(2)"), ("in.a", "@location(3)")]);
        let told = [
            "`in.b` is @location(2), and was @location(1)",
            "`in.a` is @location(3), and was @location(0)",
        ];
        assert_eq!(attributes(&before, &after), told);
        assert_eq!(attributes(&before, &before), [""; 0]);
    }

    /// A quad has more corners than a triangle.
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
    fn a_change_is_told_by_the_simplest_arguments() {
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
        assert_eq!((paths[0].ulp, &*paths[0].after), (None, "NaN"), "NaN is no distance");
    }

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

    #[test]
    fn what_cannot_be_called_is_untouched_or_not_judged() {
        let before = "fn add(x: ptr<function, atomic<u32>>) { let a = 1.0; }\n\
                      @compute @workgroup_size(1) fn nothing() { let x = 1.0; }\n";
        let untouched = changes(before, &format!("// a comment\n{before}"));
        assert_eq!(untouched.len(), 2, "{untouched:?}");
        assert!(untouched.iter().all(|(_, change)| *change == Change::Untouched), "{untouched:?}");
        let edited = changes(before, &before.replace("1.0", "2.0"));
        for (name, change) in &edited {
            let Change::Unjudged { reason } = change else { panic!("{name}: {change:?}") };
            let why = if name == "nothing" { "it writes nothing" } else { "it was edited, and " };
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
        // The value of a pixel that is discarded is none.
        let dead = before.replace("return vec4f(x);", "return vec4f(select(x, 7.0, x < 0.5));");
        let all = changes(before, &dead);
        let fs = all.iter().find(|(name, _)| name.ends_with("fs")).expect("it was edited");
        assert!(matches!(fs.1, Change::Same { .. }), "{all:?}");
        // A write before the statement stays.
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

    #[test]
    fn derivatives_have_something_to_differentiate() {
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

    /// The results are the same, and the host has to supply its resources otherwise.
    #[test]
    fn other_bindings_and_layouts_are_told() {
        let package = |text: &str| Package::from_source("p", text);
        let interface = |before: &str, from: &str, to: &str| {
            let request = Request::new(package(before), package(&before.replace(from, to)));
            let all = request.run().expect("it reads");
            let one = all.into_iter().next_back().expect("a function");
            assert!(matches!(one.change, Change::Same { .. }), "{one:?}");
            one.interface
        };
        let buffer = "@group(0) @binding(4) var<storage> d: array<f32>;\n\
                      fn read(i: u32) -> f32 { return d[i]; }\n";
        let moved = interface(buffer, "binding(4)", "binding(5)");
        assert_eq!(
            moved,
            ["`d` is bound at @group(0) @binding(5), and was at @group(0) @binding(4)"]
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
            ["`p` takes 32 bytes, and took 8", "`p.y` lies at byte 16, and was at 4"]
        );
        let space = interface(buffer, "var<storage>", "var<storage, read_write>");
        assert_eq!(space.len(), 1, "{space:?}");
        // Another name says nothing to the host, and holds the same.
        let renamed = buffer.replace("d: array", "data: array").replace("d[i]", "data[i]");
        assert_eq!(interface(buffer, buffer, &renamed), [""; 0]);
        let renamed = aligned.replace("> p:", "> params:").replace("p.y", "params.y");
        assert_eq!(interface(aligned, aligned, &renamed), [""; 0]);
    }

    /// Textures differ in size and levels, numbers are those that `karat.toml` declares, and cosines round
    /// above 1.
    #[test]
    fn what_is_made_up_tells_edits_apart() {
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
            std::fs::write(folder.path().join("m.wgsl"), text).expect("it is ours");
            std::fs::write(folder.path().join("karat.toml"), "[inputs]\nx = [1, 2]\n")
                .expect("ours");
            folder
        };
        let text = "fn f(x: f32) -> f32 { return x; }";
        let (before, after) =
            (folder(text), folder(&text.replace("return x", "return max(x, 1.0)")));
        let open = |folder: &tempfile::TempDir| Package::open(folder.path()).expect("it is there");
        let compared = Request::new(open(&before), open(&after)).run().expect("it reads").remove(0);
        assert!(matches!(compared.change, Change::Same { .. }), "{compared:?}");
        assert_eq!(compared.drawn.to_string(), "from 1 to 2: x");
    }

    #[test]
    fn of_a_whole_buffer_what_changed_is_shown() {
        let before = "@group(0) @binding(0) var<storage, read_write> all: array<u32, 40>;\n\
                      fn put(i: u32) { all[3] = 1u; }\n";
        let all = changes(before, &before.replace("1u", "2u"));
        let Change::Changed { paths } = &all[0].1 else { panic!("{all:?}") };
        assert_eq!((&*paths[0].before, &*paths[0].after), ("[3] = 1", "[3] = 2"));
    }

    /// Loops in each other cost more than a function gets: fewer inputs run, evenly drawn, and what is left out is counted.
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
        // As many rounds before and behind the edit.
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
        // What is short runs whole.
        let short = compared(&text("2u", "x * f32(j)"), &text("2u", "f32(j) * x"));
        assert_eq!((short.change, short.cut), (Change::Same { cases: CASES }, 0));
        // So few inputs are no verdict, but a change among them is one.
        let one = compared(&text("900u", "x * f32(j)"), &text("900u", "f32(j) * x"));
        let Change::Unjudged { reason } = &one.change else { panic!("{one:?}") };
        assert!(reason.starts_with("not looked at whole: "), "{reason}");
        assert!(reason.contains(" inputs of 4096 give the same results"), "{reason}");
        let changed = compared(&text("900u", "x * f32(j)"), &text("900u", "x + f32(j)"));
        assert!(matches!(changed.change, Change::Changed { .. }) && changed.cut > 0, "{changed:?}");
        // A loop that doesn't end after the edit is told as before.
        let endless = compared(&text("2u", "x"), &text("2u", "x").replace("i++", "i += 0u"));
        let Change::Unjudged { reason } = &endless.change else { panic!("{endless:?}") };
        assert_eq!(reason, "after the edit a loop of it doesn't end");
    }

    #[test]
    fn each_verdict_is_told_once_with_its_count() {
        let text: String =
            (0..9).map(|n| format!("fn f{n}x(x: f32) -> f32 {{ return x * {n}.5; }}\n")).collect();
        let [before, after] =
            [text.clone(), text.replace("3.5", "3.25")].map(|text| Package::from_source("p", text));
        let told = Mutex::new(Vec::new());
        let all = Request::new(before, after)
            .run_with(&|one, done, of| {
                told.lock().expect("whole").push((one.function.clone(), done, of));
            })
            .expect("they read");
        let mut told = told.into_inner().expect("whole");
        let counts: Vec<_> = told.iter().map(|(_, done, of)| (*done, *of)).collect();
        assert_eq!(counts, (1..=9).map(|done| (done, 9)).collect::<Vec<_>>());
        told.sort();
        let names: Vec<&String> = told.iter().map(|(name, ..)| name).collect();
        assert_eq!(names, all.iter().map(|one| &one.function).collect::<Vec<_>>());
    }

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
}
