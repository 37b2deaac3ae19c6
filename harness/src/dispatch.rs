//! What compute passes dispatch: entry points over resources that they share.
//!
//! [`Passes`] are linked and validated data, which an [`Executor`](crate::executor::Executor) runs one
//! after the other.

mod part;
mod runner;
mod violation;

use std::sync::Arc;

pub use part::Part;
pub use violation::{Examined, Violation, ViolationAccess, Watched};

use crate::diagnostic::{Blame, Blamed};
use crate::diagnostic::{Diagnostic, FileRead, Span};
use crate::fixture::{self, Fixture, FixtureError, Fixtures};
use crate::package::{LinkedModule, Package};
use crate::path::{Path, PathError};
use crate::probe::{self, ProbeError};
use crate::reflect::{Binding, BindingKind, Dimension, Overrides, Program, ReflectError, lanes_of};
use crate::value::{Scalar, Shape};

/// Why nothing was dispatched.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DispatchError {
    /// The shader is at fault.
    #[error(transparent)]
    Reflect(#[from] ReflectError),
    /// Fixtures and variables don't match.
    #[error(transparent)]
    Fixture(#[from] FixtureError),
    /// A path can't be used.
    #[error(transparent)]
    Path(#[from] PathError),
    /// A pass gives no results.
    #[error(transparent)]
    Probe(#[from] ProbeError),
    /// A loop takes more rounds than the driver allows.
    #[error("{0}")]
    Rounds(Box<Diagnostic>),
    /// No such entry point.
    #[error("`{name}` is no compute entry point{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    EntryPoint {
        /// What was asked for.
        name: String,
        /// The closest one of its module.
        nearest: Option<String>,
    },
    /// Nothing is dispatched.
    #[error("nothing is dispatched; add `.dispatch(\"module::entry_point\", [x, y, z])`")]
    Empty,
    /// A dispatch of no workgroups, or of more than a device can do.
    #[error("`{name}` is dispatched over {} x {} x {} workgroups; each number is 1 to 65535", workgroups[0], workgroups[1], workgroups[2])]
    Workgroups {
        /// The entry point.
        name: String,
        /// Workgroups in each direction.
        workgroups: [u32; 3],
    },
    /// A workgroup of more invocations than the path can run.
    #[error("the workgroup of `{name}` is {} x {} x {}; path `{path}` runs up to {} x {} x {}, and {limit} \
             invocations in all", size[0], size[1], size[2], sides[0], sides[1], sides[2])]
    WorkgroupSize {
        /// The entry point.
        name: String,
        /// Invocations in each direction.
        size: [u32; 3],
        /// The path.
        path: Path,
        /// Most invocations in each direction.
        sides: [u32; 3],
        /// Most invocations in all.
        limit: u32,
    },
    /// No such invocation.
    #[error("`{name}` has no invocation {invocation:?}: it is dispatched over {} x {} x {}, counted from 0",
        counts[0], counts[1], counts[2])]
    Invocation {
        /// The entry point.
        name: String,
        /// The `global_invocation_id` that was asked for.
        invocation: [u32; 3],
        /// Invocations in each direction.
        counts: [u32; 3],
    },
    /// No pass writes a resource of that name.
    #[error("no pass writes `{name}`{}",
        nearest.as_ref().map_or_else(|| ": assert what passes write".to_owned(),
            |name| format!("; did you mean `{name}`?")))]
    NotWritten {
        /// What was asked for.
        name: String,
        /// The closest one that is written; `None` if passes only read a resource of that name.
        nearest: Option<String>,
    },
    /// A resource has no such member.
    #[error("`{name}` is {shape}, which has no `{member}`{}",
        nearest.as_ref().map_or_else(String::new, |near| format!("; did you mean `{near}`?")))]
    NoMember {
        /// The resource.
        name: String,
        /// What was asked for.
        member: String,
        /// The type of the resource.
        shape: String,
        /// The closest member, with its resource.
        nearest: Option<String>,
    },
    /// No pass uses a buffer of that name.
    #[error("no pass uses a buffer `{name}`{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    NoBuffer {
        /// The name that was asked for.
        name: String,
        /// The closest one that is used.
        nearest: Option<String>,
    },
    /// No pass has an override of that name.
    #[error("no pass has the override `{name}`")]
    Override {
        /// What was asked for.
        name: String,
    },
    /// The executor dispatches nothing.
    #[error("path `{path}` dispatches no entry points")]
    Unable {
        /// The path.
        path: Path,
    },
}

impl DispatchError {
    /// True if a path refuses what it is given before any of it runs. A workgroup that is too large is the
    /// author's mistake, and no refusal.
    pub(crate) fn is_refusal(&self) -> bool {
        match self {
            Self::Path(error) => error.is_refusal(),
            Self::Fixture(error) => error.is_unsupported(),
            Self::Probe(error) => error.is_refusal(),
            Self::Unable { .. } => true,
            _ => false,
        }
    }
}

/// The most workgroups in a direction, on every device.
pub(crate) const MOST_WORKGROUPS: u32 = 65_535;

/// One dispatch, as its author says it.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// `module::entry_point`
    pub name: String,
    /// Workgroups in each direction.
    pub workgroups: [u32; 3],
}

/// Dispatches whose shaders are valid and whose fixtures fit them.
#[derive(Debug)]
pub struct Passes {
    /// In their order.
    pub passes: Vec<Pass>,
    /// What they share.
    pub resources: Vec<Held>,
}

/// One dispatch.
#[derive(Debug)]
pub struct Pass {
    /// `module::entry_point`
    pub name: String,
    /// The linked text.
    pub program: Arc<Program>,
    /// The entry point's name in the text.
    pub entry_point: String,
    /// Workgroups in each direction.
    pub workgroups: [u32; 3],
    /// What it uses, with the number of the resource.
    pub bindings: Vec<(Binding, usize)>,
    /// Of a draw, whose `workgroups` are pixels of a fragment function, the scalars of what that returns.
    pub drawn: Option<Vec<Scalar>>,
}

impl Pass {
    /// Invocations of all workgroups. A size that is computed of overrides counts as 1.
    pub(crate) fn invocations(&self) -> u64 {
        self.invocations_of(self.workgroup_size())
    }

    /// Invocations of all workgroups, of this size each.
    pub(crate) fn invocations_of(&self, size: [u32; 3]) -> u64 {
        size.iter().chain(&self.workgroups).map(|count| u64::from(*count)).product()
    }

    /// Invocations of a workgroup in each direction.
    pub(crate) fn workgroup_size(&self) -> [u32; 3] {
        if self.drawn.is_some() {
            return [1; 3];
        }
        let entry_point = self.program.compute_entry_point(&self.entry_point);
        entry_point.expect("a pass has an entry point").1
    }

    /// An invocation by its number, workgroup after workgroup of this size.
    pub(crate) fn invocation(&self, size: [u32; 3], number: usize) -> String {
        let width = size.iter().map(|count| *count as usize).product::<usize>();
        let (group, local) = (split(number / width, self.workgroups), split(number % width, size));
        format!("local {local} of workgroup {group}")
    }
}

/// A number among so many in each direction: `(x, y, z)`.
fn split(number: usize, counts: [u32; 3]) -> String {
    let [x, y, _] = counts.map(|count| count as usize);
    format!("({}, {}, {})", number % x, number / x % y, number / (x * y))
}

/// A resource that passes share.
#[derive(Debug)]
pub struct Held {
    /// The variable's path.
    pub name: String,
    /// What it holds.
    pub fixture: Fixture,
}

impl Pass {
    /// Where its entry point is declared.
    pub(crate) fn span(&self) -> Option<Span> {
        self.program.entry_point_span(&self.entry_point)
    }
}

/// The error of a member that a resource doesn't have.
fn no_member(name: &str, member: &str, shape: &Shape) -> DispatchError {
    let known = part::members(shape);
    let first = member.split('.').next().unwrap_or_default();
    let nearest = crate::diagnostic::nearest(first, known.iter().map(String::as_str));
    let nearest = nearest.map(|near| format!("{name}.{near}"));
    DispatchError::NoMember {
        name: name.to_owned(),
        member: member.to_owned(),
        shape: shape.to_string(),
        nearest,
    }
}

impl Passes {
    /// Passes over fixtures, and over those of which a test says no more than their size.
    ///
    /// # Errors
    /// If an entry point or a resource is missing, or one too many.
    pub fn new(
        package: &Package,
        wanted: &[Wanted],
        (given, same): (&Fixtures, &[(String, String)]),
        overrides: &Overrides,
    ) -> Result<Self, DispatchError> {
        // A variable that has another one's resource is found under its own name, too.
        let of = |(name, other): &(String, String)| {
            let place = given.iter().rposition(|(known, _)| known == other)?;
            Some(((name.clone(), given[place].1.clone()), place))
        };
        let (others, places): (Vec<_>, Vec<_>) = same.iter().filter_map(of).unzip();
        let fixtures: Fixtures = given.iter().cloned().chain(others).collect();
        let given_as = |place: usize| match place.checked_sub(given.len()) {
            Some(index) => places[index],
            None => place,
        };
        if wanted.is_empty() {
            return Err(DispatchError::Empty);
        }
        let mut passes = Vec::new();
        let mut resources: Vec<(usize, Held)> = Vec::new();
        let mut all = Vec::new();
        let mut unknown_overrides: Vec<&String> = overrides.keys().collect();
        for Wanted { name, workgroups } in wanted {
            let workgroups = *workgroups;
            if workgroups.iter().any(|count| !(1..=MOST_WORKGROUPS).contains(count)) {
                return Err(DispatchError::Workgroups { name: name.clone(), workgroups });
            }
            let (module, own) = name.rsplit_once("::").unwrap_or(("", name));
            let program = Program::of_items(package, module, &[own])
                .map_err(|error| unknown(package, name, error))?;
            // Of several passes each takes the overrides that it has.
            let own_overrides: Overrides = overrides
                .iter()
                .filter(|(name, _)| wanted.len() == 1 || program.has_override(name))
                .map(|(name, value)| (name.clone(), *value))
                .collect();
            unknown_overrides.retain(|name| !own_overrides.contains_key(*name));
            let program = program.overridden(&own_overrides)?;
            let entry_point = program.entry_point_name(own).to_owned();
            let Some((bindings, _)) = program.compute_entry_point(&entry_point) else {
                let known = program.compute_entry_points();
                let nearest = crate::diagnostic::nearest(own, known.iter().map(String::as_str));
                let (name, nearest) = (name.clone(), nearest.map(str::to_owned));
                return Err(DispatchError::EntryPoint { name, nearest });
            };
            let mut bound = Vec::new();
            for (binding, fixture) in fixture::resolve(&bindings, &fixtures)? {
                // One fixture is one resource, whichever passes use it.
                let place = fixtures.iter().position(|(_, one)| std::ptr::eq(one, fixture));
                let place = given_as(place.expect("it is one of the fixtures"));
                let known = resources.iter().position(|(fixture, _)| *fixture == place);
                let number = known.unwrap_or_else(|| {
                    let (name, fixture) = (fixtures[place].0.clone(), fixture.clone());
                    resources.push((place, Held { name, fixture }));
                    resources.len() - 1
                });
                bound.push((binding.clone(), number));
            }
            all.extend(bindings);
            let (name, bindings) = (name.clone(), bound);
            let drawn = None;
            passes.push(Pass { name, program, entry_point, workgroups, bindings, drawn });
        }
        if let Some(name) = unknown_overrides.first() {
            return Err(DispatchError::Override { name: (*name).clone() });
        }
        fixture::check_used(&all, &fixtures)?;
        let resources = resources.into_iter().map(|(_, held)| held).collect();
        Ok(Self { passes, resources })
    }

    /// One pass over resources. The entry point is named as in the text.
    pub fn over(
        program: Arc<Program>,
        entry_point: &str,
        workgroups: [u32; 3],
        resources: &[(Binding, Fixture)],
    ) -> Self {
        let bindings = (0..).zip(resources).map(|(n, (binding, _))| (binding.clone(), n)).collect();
        let held = |(binding, fixture): &(Binding, Fixture)| Held {
            name: binding.path.clone(),
            fixture: fixture.clone(),
        };
        let resources = resources.iter().map(held).collect();
        let (name, entry_point) = (entry_point.to_owned(), entry_point.to_owned());
        let pass = Pass { name, program, entry_point, workgroups, bindings, drawn: None };
        Self { passes: vec![pass], resources }
    }

    /// True if results may depend on the size of subgroups.
    pub(crate) fn has_subgroups(&self) -> bool {
        self.passes.iter().any(|pass| pass.program.has_subgroups())
    }

    /// The entry points, in the order in which they are dispatched.
    pub fn entry_points(&self) -> impl Iterator<Item = &str> {
        self.passes.iter().map(|pass| pass.name.as_str())
    }

    /// Refuses workgroups that are too large for a path: in a direction, or in all.
    pub(crate) fn expect_sizes(
        &self,
        path: Path,
        sides: [u32; 3],
        limit: u32,
    ) -> Result<(), DispatchError> {
        for pass in &self.passes {
            let entry_point = pass.program.compute_entry_point(&pass.entry_point);
            let Some((_, size)) = entry_point else { continue };
            let invocations = size.iter().fold(1_u32, |all, side| all.saturating_mul(*side));
            if invocations > limit || size.iter().zip(&sides).any(|(side, most)| side > most) {
                let name = pass.name.clone();
                return Err(DispatchError::WorkgroupSize { name, size, path, sides, limit });
            }
        }
        Ok(())
    }

    /// Where each resource is used.
    pub(crate) fn uses(&self, resource: usize) -> impl Iterator<Item = (&Pass, &Binding)> {
        self.passes.iter().flat_map(move |pass| {
            let own = pass.bindings.iter().filter(move |(_, number)| *number == resource);
            own.map(move |(binding, _)| (pass, binding))
        })
    }

    /// The first use of a resource that may write it.
    pub(crate) fn writer(&self, resource: usize) -> Option<(&Pass, &Binding)> {
        self.uses(resource).find(|(_, binding)| binding.kind.is_written())
    }

    /// A resource that is written, by the name of its variable or of its fixture, or a member of it (`particles.position`);
    /// and the type of what it holds.
    pub fn written(&self, name: &str) -> Result<(Part, Shape), DispatchError> {
        let (name, member) = part::split(name);
        let is_it = |number: &usize| {
            let named = |b: &Binding| b.name() == name || b.path == name;
            self.resources[*number].name == name || self.uses(*number).any(|(_, b)| named(b))
        };
        let mut numbers = 0..self.resources.len();
        let found = numbers.find(|number| is_it(number) && self.writer(*number).is_some());
        let Some(number) = found else {
            let written = (0..self.resources.len()).filter_map(|number| self.writer(number));
            let known: Vec<&str> = written.map(|(_, binding)| binding.name()).collect();
            let is_read = (0..self.resources.len()).any(|number| is_it(&number));
            let nearest = crate::diagnostic::nearest(name, known).filter(|_| !is_read);
            let (name, nearest) = (name.to_owned(), nearest.map(str::to_owned));
            return Err(DispatchError::NotWritten { name, nearest });
        };
        let (pass, binding) = self.writer(number).expect("it is written");
        let count = probe::count(&pass.program, binding, &self.resources[number].fixture)?;
        let shape = pass.program.written_shape(binding, Some(count));
        let shape = shape.ok_or_else(|| FixtureError::Unusable {
            variable: binding.path.clone(),
            reason: "no host can read it".to_owned(),
        })?;
        Part::of(number, &shape, member).ok_or_else(|| no_member(name, member, &shape))
    }

    /// The name of a texel by its number, `[3, 1]`, and of a volume or layers `[3, 1, 0]`; `None` of what has one index.
    pub fn texel(&self, resource: usize, number: usize) -> Option<String> {
        let view = self.resources[resource].fixture.view()?;
        let level = view.levels.first()?;
        let (across, down) = (level.width as usize, level.height as usize);
        let (row, x) = (number / across, number % across);
        let (z, y) = (row / down, row % down);
        match (view.dimension, view.arrayed) {
            (Dimension::D1, _) => None,
            (Dimension::D2, false) => Some(format!("[{x}, {y}]")),
            _ => Some(format!("[{x}, {y}, {z}]")),
        }
    }

    /// The lanes of what a resource that is written holds, by its words.
    pub fn lanes(&self, resource: usize, words: &[u32]) -> Option<Vec<u32>> {
        let (pass, binding) = self.writer(resource)?;
        Some(pass.program.lanes_of_words(binding, words))
    }

    /// The lanes of what a buffer that is written holds before all passes.
    pub(crate) fn before(&self, resource: usize) -> Option<Vec<u32>> {
        let (pass, binding) = self.writer(resource)?;
        let bytes = self.resources[resource].fixture.bytes(&pass.program, binding)?.ok()?;
        lanes_of(pass.program.module(), binding.ty, &bytes)
    }

    /// The content of a buffer before all passes: its name, its type and its lanes.
    pub fn content(&self, name: &str) -> Result<(String, Shape, Vec<u32>), DispatchError> {
        let (name, member) = part::split(name);
        let is_it = |number: &usize| {
            let named = |b: &Binding| b.name() == name || b.path == name;
            self.resources[*number].name == name || self.uses(*number).any(|(_, b)| named(b))
        };
        let found = (0..self.resources.len()).find(is_it).and_then(|number| {
            let (pass, binding) = self.uses(number).next()?;
            let held = &self.resources[number];
            let bytes = held.fixture.bytes(&pass.program, binding)?.ok()?;
            let shape = pass.program.written_shape(binding, Some(bytes.len()))?;
            let lanes = lanes_of(pass.program.module(), binding.ty, &bytes)?;
            Some((held.name.clone(), number, shape, lanes))
        });
        let part = |(held, number, shape, lanes): (String, usize, Shape, Vec<u32>)| {
            let (part, of) =
                Part::of(number, &shape, member).ok_or_else(|| no_member(name, member, &shape))?;
            Ok((held, of, part.pick(lanes)))
        };
        found.map(part).unwrap_or_else(|| {
            Err({
                let held = self.resources.iter().map(|held| held.name.as_str());
                // A texture of that name is no misspelt buffer.
                let nearest = crate::diagnostic::nearest(name, held).filter(|near| *near != name);
                let nearest = nearest.map(str::to_owned);
                DispatchError::NoBuffer { name: name.to_owned(), nearest }
            })
        })
    }

    /// Invocations of all passes.
    pub fn invocations(&self) -> u64 {
        self.passes.iter().map(Pass::invocations).sum()
    }

    /// The variables of all passes, as their authors name them: resources, and those of workgroups.
    pub(crate) fn variables(&self) -> Vec<String> {
        self.passes.iter().flat_map(|pass| pass.program.variables()).collect()
    }

    /// The files that it depends on.
    pub(crate) fn read(&self) -> Vec<FileRead> {
        let modules = self.passes.iter().flat_map(|pass| pass.program.files());
        let fixtures = self.resources.iter().flat_map(|held| held.fixture.read());
        modules.chain(fixtures).cloned().collect()
    }

    /// The modules that its shaders were linked from.
    pub(crate) fn modules(&self) -> Vec<LinkedModule> {
        self.passes.iter().flat_map(|pass| pass.program.modules()).cloned().collect()
    }

    /// Where the last entry point is declared.
    pub fn span(&self) -> Option<Span> {
        self.passes.last()?.span()
    }

    /// Whether a resource is bound, and not set with the commands.
    fn is_bound(binding: &Binding) -> bool {
        binding.kind != BindingKind::Immediate
    }
}

/// The contents of resources that are written, after all passes: the number of each, and the words of a
/// buffer, or four words a texel of a texture.
pub type Afterwards = Vec<(usize, Vec<u32>)>;

/// An entry point that isn't there has the nearest name of its module.
fn unknown(package: &Package, name: &str, error: ReflectError) -> DispatchError {
    let items = package.functions().unwrap_or_default();
    let known =
        items.iter().filter(|item| item.entry_point.is_some()).map(|item| item.name.as_str());
    let known: Vec<&str> = known.collect();
    if known.contains(&name) {
        return error.into();
    }
    match crate::diagnostic::nearest(name, known) {
        Some(nearest) => {
            let (name, nearest) = (name.to_owned(), Some(nearest.to_owned()));
            DispatchError::EntryPoint { name, nearest }
        }
        None => error.into(),
    }
}

impl Blamed for DispatchError {
    fn blame(&self) -> Blame<'_> {
        match self {
            Self::Reflect(error) => error.blame().or(&["entry"]),
            Self::Fixture(error) => error.blame(),
            Self::Probe(error) => error.blame(),
            Self::Rounds(found) => Blame::of(Some(found), &[]),
            Self::Override { .. } => Blame::setting(&["override"]),
            Self::Workgroups { .. } | Self::WorkgroupSize { .. } => Blame::setting(&["workgroups"]),
            Self::EntryPoint { name, .. } => Blame::entry_point(name),
            _ => Blame::TEST,
        }
    }
}
