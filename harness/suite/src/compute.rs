//! Tests of compute passes, from `[[compute]]` in a test file. The page [`declared`](crate::declared) lists the keys.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use karat::check::HazardKind;
use karat::compute::{Compute, ComputeAgreement, ComputeError};
use karat::unstable::compute::{self as untyped, Broken, Content, Element, Place};
use karat::unstable::dispatch::DispatchError;
use karat::unstable::reflect::{Program, Stage};
use karat::unstable::value::{Scalar, Shape};
use karat::{Goldens, Package, Path as Route, Tolerance};
use serde::Deserialize;
use toml::Value;

use crate::assertions::{Shared, What, idle_key, switched};
use crate::declared::{GOLDEN, Keys, NoHazards, OverrideValue};
use crate::domains::no_such;
use crate::fixtures::fixture;
use crate::numbers::Wanted;
use crate::range::Range;
use crate::run::wide;
use crate::table;
use crate::tolerances::tolerance;
use crate::wrong::Misdeclared;

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Declared {
    /// The test's name. The default is the last entry point's name.
    pub(crate) name: Option<String>,
    /// The compute entry point: a name in the file's own module, or a path such as `other::sort`.
    entry: Option<String>,
    /// The number of workgroups in each direction: `4`, `[4, 2]` or `[4, 2, 1]`.
    workgroups: Option<Workgroups>,
    /// Several passes, which run in this order, each `{ entry = .., workgroups = .. }`. Replaces the keys `entry` and
    /// `workgroups`.
    #[serde(default)]
    passes: Vec<Pass>,
    /// Textures, samplers and buffers, each under its variable's name.
    #[serde(default)]
    pub(crate) with: BTreeMap<String, Value>,
    /// The values of `override`s, by their names or numbers.
    #[serde(default, rename = "override")]
    overrides: BTreeMap<String, OverrideValue>,
    /// Paths on which the test must fail, each with the reason: `{ gl = "clamps faces" }`.
    #[serde(default)]
    pub(crate) fails_on: BTreeMap<String, String>,
    /// Paths that can't run the test, each with the reason. These paths must refuse the test.
    #[serde(default)]
    pub(crate) refused_on: BTreeMap<String, String>,
    /// The variables with accepted races, each with the reason.
    #[serde(default)]
    accept_race: BTreeMap<String, String>,
    /// The variables into which several invocations may write the same value, each with the reason.
    #[serde(default)]
    accept_equal_writes: BTreeMap<String, String>,
    /// The expected contents of each resource after the passes: `{ sums = { equals = [1, 3] } }`. The keys of a
    /// resource have their own table.
    #[serde(default)]
    after: BTreeMap<String, Expected>,
    /// Asserts that no operation in the passes has a hazard: `true`, or a list of kinds.
    no_hazards: Option<NoHazards>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Pass {
    /// The compute entry point.
    entry: String,
    /// The number of workgroups in each direction.
    workgroups: Workgroups,
}

/// The number of workgroups in each direction: `4`, `[4]`, `[4, 2]` or `[4, 2, 1]`.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(try_from = "Value")]
struct Workgroups([u32; 3]);

impl TryFrom<Value> for Workgroups {
    type Error = String;

    fn try_from(value: Value) -> Result<Self, String> {
        let wrong = || {
            format!(
                "{value} isn't a number of workgroups: write 4 or [4, 2, 1], with numbers from 1 to 65535"
            )
        };
        let number = |value: &Value| value.as_integer().and_then(|count| u32::try_from(count).ok());
        let list = match &value {
            Value::Array(list) => list.iter().map(number).collect::<Option<Vec<_>>>(),
            one => number(one).map(|count| vec![count]),
        };
        match list.as_deref() {
            Some(&[x]) => Ok(Self([x, 1, 1])),
            Some(&[x, y]) => Ok(Self([x, y, 1])),
            Some(&[x, y, z]) => Ok(Self([x, y, z])),
            _ => Err(wrong()),
        }
    }
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Expected {
    /// Asserts that the resource has this value. A single number is the value of each component.
    equals: Option<Value>,
    /// Asserts that the elements equal the rows of this CSV file. Its columns are `x,y,z`, or `value`.
    table: Option<PathBuf>,
    /// Asserts that the resource has the contents that were accepted as `golden/NAME.csv`.
    golden: Option<String>,
    /// Asserts that the contents are the same if the last pass runs this entry point instead. Karat's engine runs this
    /// entry point with the same number of workgroups.
    agrees_with: Option<String>,
    /// Asserts that the elements are in ascending order (`true`), or in descending order (`"descending"`).
    sorted: Option<Value>,
    /// Asserts that the numbers have the same sum as the numbers that this buffer contains before the passes.
    sum_of: Option<String>,
    /// Asserts that the elements are those that this buffer contains before the passes, in any order.
    permutation_of: Option<String>,
    /// Asserts that the passes don't change the contents: `true`.
    unchanged: Option<bool>,
    /// Asserts that the invocations write each element of the buffer, or each texel of the texture: `true`.
    written: Option<bool>,
    /// Asserts that each component is in this range.
    in_range: Option<Range>,
    /// Asserts that no component is NaN or infinite: `true`.
    finite: Option<bool>,
    /// Ignores the order of the elements in `equals`, `table` or `agrees_with`: `true`.
    up_to_order: Option<bool>,
    /// The number of rows and columns, `[19, 13]`. Failures then name an element's row and column.
    shape: Option<[usize; 2]>,
    /// The largest error that passes, as for functions. The default is an exact comparison.
    tolerance: Option<String>,
    /// Tolerances for single paths.
    #[serde(default)]
    tolerance_on: BTreeMap<String, String>,
}

#[derive(Clone, Debug)]
pub(crate) struct Assertion {
    pub(crate) declared: Declared,
    /// For each pass, the entry point's path, and the number of workgroups in each direction.
    passes: Vec<(String, [u32; 3])>,
    /// The name of the resource that the assertion is about; empty for an assertion about the passes.
    variable: String,
    what: What,
    tolerance: Option<String>,
    pub(crate) tolerance_on: BTreeMap<String, String>,
    /// `true` if the order of the elements doesn't matter.
    up_to_order: bool,
    /// The number of rows and columns.
    shape: Option<[usize; 2]>,
    /// The folder to which the paths of tables and images are relative.
    pub(crate) folder: PathBuf,
    pub(crate) keys: Keys,
}

/// Returns an error for a hazard kind that `no_hazards` doesn't check in passes, because such an assertion never fails.
fn expect_inside(kind: HazardKind) -> Result<(), Misdeclared> {
    let wrong = |why: &str| Err(Misdeclared::of("no_hazards")(format!("{}: {why}", kind.name())));
    match kind {
        HazardKind::Nan
        | HazardKind::Infinite
        | HazardKind::BelowZero
        | HazardKind::ByZero
        | HazardKind::Saturated
        | HazardKind::EdgesReversed => Ok(()),
        HazardKind::LostDigits | HazardKind::Unbounded | HazardKind::Endless => {
            wrong("Karat doesn't check passes for hazards of this kind: remove the kind")
        }
        _ => {
            wrong("Karat checks each [[compute]] for hazards of this kind anyway: remove the kind")
        }
    }
}

impl Expected {
    fn whats(&self, variable: &str) -> Result<Vec<What>, Misdeclared> {
        let shared = Shared {
            agrees_with: &self.agrees_with,
            table: &self.table,
            golden: &self.golden,
            equals: &self.equals,
            finite: self.finite,
            in_range: self.in_range,
        };
        let mut all = shared.whats()?;
        all.extend(match &self.sorted {
            None => None,
            Some(Value::Boolean(true)) => Some(What::Sorted { descending: false }),
            Some(Value::String(way)) if way == "ascending" || way == "descending" => {
                Some(What::Sorted { descending: way == "descending" })
            }
            Some(other) => {
                return Err(Misdeclared::of("sorted")(format!(
                    "`sorted = {other}` asserts nothing: write true, \"ascending\" or \"descending\""
                )));
            }
        });
        all.extend(self.sum_of.clone().map(What::SumOf));
        all.extend(self.permutation_of.clone().map(What::PermutationOf));
        all.extend(switched("unchanged", self.unchanged, What::Unchanged)?);
        all.extend(switched("written", self.written, What::Written)?);
        if all.is_empty() {
            return Err(Misdeclared::from(format!(
                "the test asserts nothing about `{variable}`: write equals, table, golden, agrees_with, sorted, sum_of, \
                 permutation_of, unchanged, written, in_range or finite"
            )));
        }
        if self.up_to_order == Some(false) {
            let off = "`up_to_order = false` asserts nothing: remove the key".to_owned();
            return Err(Misdeclared::of("up_to_order")(off));
        }
        let written = |key: &str| match key {
            "tolerance" => self.tolerance.is_some(),
            "tolerance_on" => !self.tolerance_on.is_empty(),
            "up_to_order" => self.up_to_order.is_some(),
            _ => false,
        };
        match idle_key(&all, true, &written) {
            Some((key, idle)) => Err(Misdeclared::of(key)(idle)),
            None => Ok(all),
        }
    }
}

impl Declared {
    /// The passes in their order. `module` is the module beside the test file.
    fn all_passes(&self, module: &str) -> Result<Vec<(String, [u32; 3])>, String> {
        let path = |entry: &str| match (module, entry.contains("::")) {
            ("", _) | (_, true) => entry.to_owned(),
            (module, false) => format!("{module}::{entry}"),
        };
        match (&self.entry, self.workgroups, &*self.passes) {
            (Some(entry), Some(Workgroups(groups)), []) => Ok(vec![(path(entry), groups)]),
            (Some(entry), None, []) => {
                Err(format!("`{entry}` needs `workgroups`: add workgroups = 1, or [2, 2, 1]"))
            }
            (None, None, [_, ..]) => {
                Ok(self.passes.iter().map(|one| (path(&one.entry), one.workgroups.0)).collect())
            }
            _ => Err("write either `entry` and `workgroups`, or `passes = [{ entry = \"a\", \
                      workgroups = 1 }]`"
                .to_owned()),
        }
    }

    pub(crate) fn tests(
        self,
        module: &str,
        folder: &Path,
        keys: &Keys,
    ) -> Result<Vec<(String, Assertion)>, Misdeclared> {
        let passes = self.all_passes(module)?;
        let (last, _) = passes.last().ok_or("there is no pass")?;
        let name = match &self.name {
            Some(name) if module.is_empty() => name.clone(),
            Some(name) => format!("{module}::{name}"),
            None => last.clone(),
        };
        let mut all = Vec::new();
        let mut add = |variable: &str, what: What, expected: Option<&Expected>| {
            let of = if variable.is_empty() { String::new() } else { format!(" {variable}") };
            let name = format!("{name}{of} {}", what.key());
            let assertion = Assertion {
                declared: self.clone(),
                passes: passes.clone(),
                variable: variable.to_owned(),
                tolerance: expected
                    .and_then(|one| one.tolerance.clone())
                    .filter(|_| what.takes("tolerance")),
                tolerance_on: expected
                    .filter(|_| what.takes("tolerance_on"))
                    .map(|one| one.tolerance_on.clone())
                    .unwrap_or_default(),
                up_to_order: expected.is_some_and(|one| one.up_to_order.is_some())
                    && what.takes("up_to_order"),
                shape: expected.and_then(|one| one.shape),
                what,
                folder: folder.to_owned(),
                keys: keys.clone(),
            };
            all.push((name, assertion));
        };
        for (variable, expected) in &self.after {
            let whats = expected.whats(variable);
            for what in whats.map_err(|wrong| wrong.below(&format!("after.{variable}")))? {
                add(variable, what, Some(expected));
            }
        }
        if let Some(NoHazards(kinds)) = &self.no_hazards {
            kinds.iter().flatten().try_for_each(|kind| expect_inside(*kind))?;
            add("", What::NoHazards(kinds.clone()), None);
        }
        match all.is_empty() {
            true => Err(Misdeclared::from(format!(
                "the test asserts nothing about `{last}`: write the expected contents in [compute.after.NAME], or \
                 no_hazards = true"
            ))),
            false => Ok(all),
        }
    }
}

impl Assertion {
    pub(crate) fn entries(&self) -> impl Iterator<Item = &str> {
        self.passes.iter().map(|(name, _)| name.as_str())
    }

    /// The entry point of the last pass. The test's records contain this name.
    pub(crate) fn last(&self) -> &str {
        self.passes.last().map_or("", |(name, _)| name)
    }

    pub(crate) fn key(&self) -> &'static str {
        self.what.key()
    }

    pub(crate) fn check(&self) -> String {
        self.own(self.key())
    }

    /// The full name of one of the assertion's keys in a `[[compute]]`, such as `after.sums.equals`.
    fn own(&self, key: &str) -> String {
        match self.variable.is_empty() {
            true => key.to_owned(),
            false => format!("after.{}.{key}", self.variable),
        }
    }

    pub(crate) fn place_of(&self, key: Option<&str>) -> Option<&karat::unstable::diagnostic::Span> {
        // The key belongs to the assertion, or to the whole `[[compute]]`.
        let keys = key.into_iter().flat_map(|key| [self.own(key), key.to_owned()]);
        let mut named = keys.filter_map(|key| self.keys.exactly(&key));
        named.next().or_else(|| self.keys.place_of(&self.check()))
    }

    pub(crate) fn files(&self) -> Vec<PathBuf> {
        match &self.what {
            What::Table(file) => vec![self.folder.join(file)],
            What::Golden(name) => vec![self.folder.join(GOLDEN).join(format!("{name}.csv"))],
            _ => Vec::new(),
        }
    }

    /// All text on which the verdict depends, except for the contents of tables, goldens and images.
    pub(crate) fn normalized_text(&self, package: &Package) -> Option<String> {
        let mut text = format!("{:?} {} {:?}", self.declared, self.variable, self.what);
        let reference = if let What::AgreesWith(entry) = &self.what {
            Some(self.of_module(entry))
        } else {
            None
        };
        for name in self.passes.iter().map(|(name, _)| name).chain(&reference) {
            let (module, own) = name.rsplit_once("::").unwrap_or(("", name));
            text += &Program::of_items(package, module, &[own]).ok()?.normalized_text();
        }
        Some(text)
    }

    /// The key in the test file that names an entry point.
    pub(crate) fn key_of_entry(&self, entry: &str) -> String {
        let number = self.passes.iter().position(|(name, _)| name == entry);
        match (&self.what, number) {
            (What::AgreesWith(other), _) if self.of_module(other) == entry => {
                "agrees_with".to_owned()
            }
            (_, Some(number)) if !self.declared.passes.is_empty() => {
                format!("passes.{number}.entry")
            }
            _ => "entry".to_owned(),
        }
    }

    /// The path of an entry point: a plain name belongs to the module of the last pass.
    fn of_module(&self, entry: &str) -> String {
        match (entry.contains("::"), self.last().rsplit_once("::")) {
            (false, Some((module, _))) => format!("{module}::{entry}"),
            _ => entry.to_owned(),
        }
    }

    /// The last line of an error message about a table: the position of the row that differs first.
    pub(crate) fn row_of(&self, error: &ComputeError) -> Option<String> {
        let (What::Table(file), ComputeError::Differs(found)) = (&self.what, error) else {
            return None;
        };
        let first = found.paths.first()?.shown.first()?;
        match first.place {
            Place::Element { index, .. } if !self.up_to_order => {
                table::told("first element", &self.folder.join(file), index as u64)
            }
            _ => None,
        }
    }

    fn tolerance(&self) -> Result<Tolerance, Misdeclared> {
        let text = self.tolerance.as_deref().unwrap_or("exact");
        tolerance(text).map_err(Misdeclared::of("tolerance"))
    }

    /// Binds the resources and adds the passes. If `last` is an entry point, it replaces the entry point of the last
    /// pass.
    fn compute<'p>(
        &self,
        package: &'p Package,
        last: Option<&str>,
    ) -> Result<Compute<'p>, Misdeclared> {
        let mut compute = package.compute();
        let mut bound: BTreeMap<&str, bool> =
            self.declared.with.keys().map(|name| (&**name, false)).collect();
        let mut known = Vec::new();
        // An entry point that doesn't exist might read any resource.
        let mut unread = false;
        let count = self.passes.len();
        for (index, (name, groups)) in self.passes.iter().enumerate() {
            let name = last.filter(|_| index + 1 == count).unwrap_or(name);
            compute = compute.dispatch(name, *groups);
            let (module, own) = name.rsplit_once("::").unwrap_or(("", name));
            // If an entry point is missing or invalid, the dispatch reports it. Other code of the module may be
            // invalid.
            let program = Program::of_items(package, module, &[own]).ok();
            let bindings = program.as_ref().and_then(|program| {
                Some((program, program.entry_point_bindings(Stage::Compute, own)?))
            });
            let Some((program, bindings)) = bindings else {
                unread = true;
                continue;
            };
            for binding in bindings {
                known.push(binding.name().to_owned());
                let is_it = |name: &&String| *name == binding.name() || **name == binding.path;
                let Some(name) = self.declared.with.keys().find(is_it) else { continue };
                if bound.insert(name, true) == Some(true) {
                    continue;
                }
                let fixture = fixture(program, &binding, &self.declared.with[name], &self.folder)
                    .map_err(Misdeclared::of_resource(name))?;
                compute = compute.with(name, fixture);
            }
        }
        if let Some((idle, _)) = bound.iter().find(|(_, is_bound)| !**is_bound)
            && !unread
            // The reference may use fewer resources than the passes.
            && last.is_none()
        {
            let known = known.iter().map(String::as_str);
            return Err(Misdeclared::of_resource(idle)(no_such("variable", idle, known)));
        }
        for (name, value) in &self.declared.overrides {
            compute = compute.with_override(name, value.number());
        }
        for (on, reason) in &self.declared.fails_on {
            compute = compute.fails_on(on.as_str(), reason);
        }
        for (on, reason) in &self.declared.refused_on {
            compute = compute.refused_on(on.as_str(), reason);
        }
        for (variable, reason) in &self.declared.accept_race {
            compute = compute.accept_race(variable, reason);
        }
        for (variable, reason) in &self.declared.accept_equal_writes {
            compute = compute.accept_equal_writes(variable, reason);
        }
        for (on, text) in &self.tolerance_on {
            let own = tolerance(text).map_err(Misdeclared::of("tolerance_on"))?;
            compute = compute.tolerance_on(on.as_str(), own);
        }
        Ok(compute)
    }

    /// Binds the resources, and adds the passes.
    pub(crate) fn passes<'p>(&self, package: &'p Package) -> Result<Compute<'p>, Misdeclared> {
        self.compute(package, None)
    }

    pub(crate) fn judged(&self, package: &Package) -> Result<ComputeAgreement, Stop> {
        let compute = self.compute(package, None)?;
        self.judge(package, &compute)
    }

    fn judge(&self, package: &Package, compute: &Compute<'_>) -> Result<ComputeAgreement, Stop> {
        if let What::NoHazards(kinds) = &self.what {
            let mut found = untyped::hazards(compute)?;
            found.retain(|(kind, ..)| kinds.as_ref().is_none_or(|kinds| kinds.contains(kind)));
            // The record names the first resource that the passes write.
            let left = untyped::left(compute, Route::CPU)?;
            let variable = left.first().ok_or("the passes write nothing")?.name.clone();
            let first = found.first().map(|(_, place, what)| Element {
                place: Place::Whole(place.clone()),
                actual: what.clone(),
                expected: "no such hazard".to_owned(),
                error: String::new(),
            });
            let broken = first.map(|first| Broken { failures: found.len(), first: Some(first) });
            let after = compute.clone().after(&variable);
            let named = |kind: &HazardKind| kind.name();
            let text = match kinds {
                None => "inside the pass, each float is finite, and no integer division or conversion goes out of range".to_owned(),
                Some(kinds) => {
                    let named: Vec<&str> = kinds.iter().map(named).collect();
                    format!("inside the pass, none of these hazards occurs: {}", named.join(", "))
                }
            };
            return concluded(untyped::settled(&after, &text, broken));
        }
        let after = compute.clone().after(&self.variable);
        let after = if self.up_to_order { after.up_to_order() } else { after };
        let after = match self.shape {
            Some([rows, columns]) => after.grid(rows, columns),
            None => after,
        };
        let before = |name: &str| Ok::<_, Stop>(untyped::before(compute, name)?);
        match &self.what {
            What::Equals(value) => {
                let content = self.content(compute)?;
                let tolerance = self.tolerance()?;
                let expected = wide(&content.shape, value, Wanted::from(&tolerance))?;
                concluded(untyped::agrees_with(&after, expected, tolerance))
            }
            What::Table(file) => {
                let (content, tolerance) = (self.content(compute)?, self.tolerance()?);
                let (file, near) = (self.folder.join(file), Wanted::from(&tolerance));
                let expected = table::elements(&file, content.element(), near)?;
                concluded(untyped::agrees_with(&after, expected, tolerance))
            }
            What::Golden(name) => {
                let goldens = Goldens::open(&self.folder.join(GOLDEN));
                concluded(after.try_matches(&goldens, name, self.tolerance()?))
            }
            What::AgreesWith(entry) => {
                let entry = self.of_module(entry);
                if self.last() == entry {
                    let itself =
                        format!("`{entry}` can't be its own reference: name another entry point");
                    return Err(Misdeclared::of("agrees_with")(itself).into());
                }
                let reference = self.compute(package, Some(&entry))?;
                let wrong = Misdeclared::of("agrees_with");
                let left = untyped::left(&reference, Route::CPU);
                let left = left.map_err(|error| wrong(error.to_string()))?;
                let Some(content) = of_variable(left, &self.variable) else {
                    return Err(
                        wrong(format!("`{entry}` doesn't write `{}`", self.variable)).into()
                    );
                };
                concluded(untyped::agrees_with(&after, values(&content), self.tolerance()?))
            }
            What::Sorted { descending } => {
                let content = self.content(compute)?;
                let scalar = only_scalar(&content, "sorted")?;
                if content.lanes.len() == 1 {
                    let one = "one number is always sorted, so `sorted` can't fail".to_owned();
                    return Err(Misdeclared::of("sorted")(one).into());
                }
                let text = if *descending {
                    "the elements are in descending order"
                } else {
                    "the elements are in ascending order"
                };
                let breaks = |lanes: &[u32]| {
                    let pair =
                        |at: usize| [lanes[at], lanes[at + 1]].map(|word| scalar.decode(word));
                    let ordered = |at: &usize| match pair(*at) {
                        [a, b] if *descending => a >= b,
                        [a, b] => a <= b,
                    };
                    let wrong: Vec<usize> =
                        (0..lanes.len().saturating_sub(1)).filter(|at| !ordered(at)).collect();
                    let first = *wrong.first()?;
                    let [a, b] = pair(first);
                    let than = if *descending { "most" } else { "least" };
                    let element = named(first + 1, "", b.to_string(), format!("at {than} {a}"));
                    Some(Broken { failures: wrong.len(), first: Some(element) })
                };
                concluded(untyped::satisfies(&after, text, false, &breaks))
            }
            What::SumOf(input) => {
                let (sum, within) =
                    (values(&before(input)?).iter().sum::<f64>(), self.tolerance()?);
                let content = self.content(compute)?;
                let scalar = one_kind(&content, "sum_of")?;
                let text = format!("the numbers have the same sum as `{input}`: {sum}, {within}");
                let breaks = |lanes: &[u32]| {
                    let own = lanes.iter().map(|word| scalar.decode(*word)).sum::<f64>();
                    let passes = within.measure_sum(0, own, sum).passes();
                    let element = named_whole(own.to_string(), sum.to_string());
                    (!passes).then_some(Broken { failures: 1, first: Some(element) })
                };
                concluded(untyped::satisfies(&after, &text, false, &breaks))
            }
            What::PermutationOf(input) => {
                let (content, input_content) = (self.content(compute)?, before(input)?);
                if content.element() != input_content.element() {
                    return Err(format!(
                        "`{}` is of type {}, and `{input}` is of type {}: elements of different types can't be a permutation",
                        self.variable, content.shape, input_content.shape
                    )
                    .into());
                }
                let element = content.element().clone();
                let text = format!("the buffer contains the elements of `{input}`, in any order");
                let breaks = |lanes: &[u32]| not_permuted(&element, &input_content.lanes, lanes);
                concluded(untyped::satisfies(&after, &text, false, &breaks))
            }
            What::Unchanged => {
                let was = before(&self.variable)?;
                let element = was.element().clone();
                let breaks = |lanes: &[u32]| first_other(&element, &was.lanes, lanes);
                concluded(untyped::satisfies(&after, "its contents don't change", true, &breaks))
            }
            What::Written => concluded(after.try_is_written()),
            What::InRange(range) => {
                let range = range.checked()?;
                let content = self.content(compute)?;
                let both = |least: f64, most: f64| range.contains(least) && range.contains(most);
                let all = |scalar: &Scalar| match scalar {
                    Scalar::I32 => both(f64::from(i32::MIN), f64::from(i32::MAX)),
                    Scalar::U32 => both(0.0, f64::from(u32::MAX)),
                    Scalar::Bool => true,
                    _ => false,
                };
                if content.shape.lanes().iter().all(all) {
                    return Err(format!(
                        "every value of type {} is in this range, so the assertion can't fail",
                        content.shape
                    )
                    .into());
                }
                let text = format!("each number lies in {range}");
                let lies = |_: Scalar, value: f64| range.contains(value);
                concluded(untyped::each(&after, (&text, &range.to_string()), &lies))
            }
            What::Finite => {
                let content = self.content(compute)?;
                if !content.shape.lanes().iter().any(|scalar| scalar.is_float()) {
                    return Err(format!(
                        "every value of type {} is finite, so the assertion can't fail",
                        content.shape
                    )
                    .into());
                }
                let is_finite =
                    |scalar: Scalar, value: f64| !scalar.is_float() || value.is_finite();
                let texts = ("no number is NaN or infinite", "a finite number");
                concluded(untyped::each(&after, texts, &is_finite))
            }
            What::NoHazards(_)
            | What::Unit
            | What::PerpendicularTo(_)
            | What::RightHandedFrame
            | What::SymmetricIn(_)
            | What::Monotone(..)
            | What::Limit { .. }
            | What::Integral(_) => unreachable!("`Expected` has no key for this assertion"),
        }
    }

    fn content(&self, compute: &Compute<'_>) -> Result<Content, Stop> {
        match untyped::before(compute, &self.variable) {
            Ok(content) => Ok(content),
            Err(ComputeError::Dispatch(error @ DispatchError::NoMember { .. })) => {
                let key = format!("after.{}", self.variable);
                Err(Misdeclared::from(error.to_string()).below(&key).into())
            }
            // `untyped::before` can't read textures, so this returns the contents after the passes.
            Err(_) => {
                let left = untyped::left(compute, Route::CPU)?;
                let names: Vec<String> = left.iter().map(|one| one.name.clone()).collect();
                let own = of_variable(left, &self.variable);
                let names = names.iter().map(String::as_str);
                let unknown = || {
                    let message = no_such("written resource", &self.variable, names);
                    Misdeclared::from(message).below(&format!("after.{}", self.variable))
                };
                Ok(own.ok_or_else(unknown)?)
            }
        }
    }
}

pub(crate) enum Stop {
    Misdeclared(Misdeclared),
    /// The check didn't begin, so there is no record of it.
    Unbegun(Box<ComputeError>),
    Failed(Box<ComputeError>),
}

fn concluded(verdict: Result<ComputeAgreement, ComputeError>) -> Result<ComputeAgreement, Stop> {
    verdict.map_err(|error| Stop::Failed(Box::new(error)))
}

impl From<ComputeError> for Stop {
    fn from(error: ComputeError) -> Self {
        Self::Unbegun(Box::new(error))
    }
}

impl From<Misdeclared> for Stop {
    fn from(wrong: Misdeclared) -> Self {
        Self::Misdeclared(wrong)
    }
}

impl From<String> for Stop {
    fn from(message: String) -> Self {
        Self::Misdeclared(message.into())
    }
}

impl From<&str> for Stop {
    fn from(message: &str) -> Self {
        message.to_owned().into()
    }
}

/// Finds a resource, or a member of a resource, among all resources after the passes. `variable` may contain the
/// module's name.
fn of_variable(left: Vec<Content>, variable: &str) -> Option<Content> {
    let (name, member) = variable.split_once('.').unwrap_or((variable, ""));
    left.into_iter().find(|one| is_called(&one.name, name))?.member(member)
}

fn is_called(path: &str, name: &str) -> bool {
    path == name || path.rsplit("::").next() == Some(name)
}

fn named(index: usize, component: &str, actual: String, expected: String) -> Element {
    let place = Place::Element { index, component: component.to_owned(), texel: None };
    Element { place, actual, expected, error: String::new() }
}

fn named_whole(actual: String, expected: String) -> Element {
    let place = Place::Whole("the sum".to_owned());
    Element { place, actual, expected, error: String::new() }
}

fn values(content: &Content) -> Vec<f64> {
    let scalars = content.shape.lanes();
    scalars.iter().zip(&content.lanes).map(|(scalar, word)| scalar.decode(*word)).collect()
}

fn only_scalar(content: &Content, key: &str) -> Result<Scalar, String> {
    match content.element() {
        Shape::Scalar(scalar) => Ok(*scalar),
        other => Err(format!("`{key}` needs numbers, but an element is a {other}")),
    }
}

/// The type of all numbers in a resource; an error if they have different types.
fn one_kind(content: &Content, key: &str) -> Result<Scalar, String> {
    let scalars = content.shape.lanes();
    match scalars.first() {
        Some(first) if scalars.iter().all(|scalar| scalar == first) => Ok(*first),
        _ => {
            Err(format!("`{key}` needs numbers of one type, but the resource is {}", content.shape))
        }
    }
}

/// Compares two lists, and returns the first element that differs, with the number of elements that differ.
fn first_other(element: &Shape, was: &[u32], is: &[u32]) -> Option<Broken> {
    let width = element.lanes().len().max(1);
    let pairs = was.chunks(width).zip(is.chunks(width)).enumerate();
    let wrong: Vec<_> = pairs.filter(|(_, (was, is))| was != is).collect();
    let (at, (was, is)) = *wrong.first()?;
    let first = named(at, "", element.format(is), element.format(was));
    Some(Broken { failures: wrong.len(), first: Some(first) })
}

/// The first element that occurs more often in `is` than in `was`. If there is none, an element of `was` that is
/// missing from `is`.
fn not_permuted(element: &Shape, was: &[u32], is: &[u32]) -> Option<Broken> {
    let width = element.lanes().len().max(1);
    let mut left: HashMap<&[u32], i64> = HashMap::new();
    was.chunks(width).for_each(|one| *left.entry(one).or_default() += 1);
    let mut wrong = Vec::new();
    for (at, one) in is.chunks(width).enumerate() {
        let count = left.entry(one).or_default();
        *count -= 1;
        if *count < 0 {
            wrong.push(at);
        }
    }
    let missing = was.chunks(width).find(|one| left[one] > 0);
    let expected = match missing {
        Some(missing) => format!("{}, which is missing", element.format(missing)),
        None => "no more elements".to_owned(),
    };
    let (at, actual) = match wrong.first() {
        Some(at) => (
            *at,
            format!("{}, which occurs once too often", element.format(&is[at * width..][..width])),
        ),
        None => (is.len() / width, "nothing".to_owned()),
    };
    let failures = wrong.len().max(usize::from(missing.is_some()));
    (failures > 0).then(|| Broken { failures, first: Some(named(at, "", actual, expected)) })
}
