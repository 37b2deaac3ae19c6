//! Dispatches compute passes: entry points over shared resources.
//!
//! [`Passes`] are linked and validated data. An [`Executor`](crate::executor::Executor) runs them one after another.

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

/// The reason why passes can't be dispatched.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DispatchError {
    /// The shader can't be used.
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
    /// There is no such entry point.
    #[error("`{name}` is no compute entry point{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    EntryPoint {
        /// The name that was asked for.
        name: String,
        /// The closest entry point of its module.
        nearest: Option<String>,
    },
    /// There are no passes.
    #[error("nothing is dispatched; add `.dispatch(\"module::entry_point\", [x, y, z])`")]
    Empty,
    /// A dispatch has no workgroups, or more than a device supports.
    #[error("`{name}` is dispatched over {} x {} x {} workgroups; each number is 1 to 65535", workgroups[0], workgroups[1], workgroups[2])]
    Workgroups {
        /// The entry point.
        name: String,
        /// Workgroups in each direction.
        workgroups: [u32; 3],
    },
    /// A workgroup has more invocations than the path supports.
    #[error("the workgroup of `{name}` is {} x {} x {}; path `{path}` runs up to {} x {} x {}, and {limit} \
             invocations in all", size[0], size[1], size[2], sides[0], sides[1], sides[2])]
    WorkgroupSize {
        /// The entry point.
        name: String,
        /// Invocations in each direction.
        size: [u32; 3],
        /// The path.
        path: Path,
        /// The most invocations in each direction.
        sides: [u32; 3],
        /// The most invocations in all.
        limit: u32,
    },
    /// There is no such invocation.
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
        /// The name that was asked for.
        name: String,
        /// The closest written resource; `None` if passes only read the resource.
        nearest: Option<String>,
    },
    /// A resource has no such member.
    #[error("`{name}` is {shape}, which has no `{member}`{}",
        nearest.as_ref().map_or_else(String::new, |near| format!("; did you mean `{near}`?")))]
    NoMember {
        /// The resource.
        name: String,
        /// The member that was asked for.
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
        /// The closest name that a pass uses.
        nearest: Option<String>,
    },
    /// No pass has an override of that name.
    #[error("no pass has the override `{name}`")]
    Override {
        /// The name that was asked for.
        name: String,
    },
    /// The executor can't dispatch passes.
    #[error("path `{path}` dispatches no entry points")]
    Unable {
        /// The path.
        path: Path,
    },
}

impl DispatchError {
    /// Returns `true` if a path refuses its input before any of it runs. A workgroup that is too large is the author's
    /// mistake, and doesn't count.
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

/// The most workgroups in one direction that every device supports.
pub(crate) const MOST_WORKGROUPS: u32 = 65_535;

/// A dispatch, as its author describes it.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// `module::entry_point`
    pub name: String,
    /// Workgroups in each direction.
    pub workgroups: [u32; 3],
}

/// Dispatches with valid shaders, whose fixtures fit their variables.
#[derive(Debug)]
pub struct Passes {
    /// The passes, in their order.
    pub passes: Vec<Pass>,
    /// The resources that they share.
    pub resources: Vec<Held>,
}

/// A dispatch.
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
    /// The variables that it uses, each with the number of its resource.
    pub bindings: Vec<(Binding, usize)>,
    /// For a draw, the scalars of the fragment function's result. Its `workgroups` are pixels.
    pub drawn: Option<Vec<Scalar>>,
}

impl Pass {
    /// The number of invocations in all workgroups. A size that is computed from overrides counts as 1.
    pub(crate) fn invocations(&self) -> u64 {
        self.invocations_of(self.workgroup_size())
    }

    /// The number of invocations in all workgroups of this size.
    pub(crate) fn invocations_of(&self, size: [u32; 3]) -> u64 {
        size.iter().chain(&self.workgroups).map(|count| u64::from(*count)).product()
    }

    /// The size of a workgroup: its invocations in each direction.
    pub(crate) fn workgroup_size(&self) -> [u32; 3] {
        if self.drawn.is_some() {
            return [1; 3];
        }
        let entry_point = self.program.compute_entry_point(&self.entry_point);
        entry_point.expect("a pass has an entry point").1
    }

    /// The name of an invocation, by its number; workgroups of this size come one after another.
    pub(crate) fn invocation(&self, size: [u32; 3], number: usize) -> String {
        let width = size.iter().map(|count| *count as usize).product::<usize>();
        let (group, local) = (split(number / width, self.workgroups), split(number % width, size));
        format!("local {local} of workgroup {group}")
    }
}

/// The position `(x, y, z)` of a number in a grid with these sides.
fn split(number: usize, counts: [u32; 3]) -> String {
    let [x, y, _] = counts.map(|count| count as usize);
    format!("({}, {}, {})", number % x, number / x % y, number / (x * y))
}

/// A resource that passes share.
#[derive(Debug)]
pub struct Held {
    /// The variable's path.
    pub name: String,
    /// The fixture with its contents.
    pub fixture: Fixture,
}

impl Pass {
    /// The place of its entry point's declaration.
    pub(crate) fn span(&self) -> Option<Span> {
        self.program.entry_point_span(&self.entry_point)
    }
}

/// The error for a member that a resource doesn't have.
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
    /// Passes over fixtures, and over buffers that have only a size.
    ///
    /// # Errors
    /// If an entry point or a resource is missing, or if a fixture isn't used.
    pub fn new(
        package: &Package,
        wanted: &[Wanted],
        (given, same): (&Fixtures, &[(String, String)]),
        overrides: &Overrides,
    ) -> Result<Self, DispatchError> {
        // A variable that shares another's resource is also found under its own name.
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
            // Each of several passes takes the overrides that it declares.
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
                // One fixture is one resource in all passes.
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

    /// One pass over resources. The entry point has its name in the text.
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

    /// Returns `true` if results may depend on the subgroup size.
    pub(crate) fn has_subgroups(&self) -> bool {
        self.passes.iter().any(|pass| pass.program.has_subgroups())
    }

    /// The entry points, in the order in which they are dispatched.
    pub fn entry_points(&self) -> impl Iterator<Item = &str> {
        self.passes.iter().map(|pass| pass.name.as_str())
    }

    /// Fails if workgroups are too large for a path, in one direction or in all.
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

    /// The uses of a resource.
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

    /// A written resource and its type, by the name of its variable or of its fixture; or a member of it
    /// (`particles.position`).
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

    /// The name of a texel by its number: `[3, 1]`, or `[3, 1, 0]` in a volume or with layers; `None` for a resource
    /// with one index.
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

    /// The lanes of a written resource, from its words.
    pub fn lanes(&self, resource: usize, words: &[u32]) -> Option<Vec<u32>> {
        let (pass, binding) = self.writer(resource)?;
        Some(pass.program.lanes_of_words(binding, words))
    }

    /// The lanes of a written buffer before all passes.
    pub(crate) fn before(&self, resource: usize) -> Option<Vec<u32>> {
        let (pass, binding) = self.writer(resource)?;
        let bytes = self.resources[resource].fixture.bytes(&pass.program, binding)?.ok()?;
        lanes_of(pass.program.module(), binding.ty, &bytes)
    }

    /// The contents of a buffer before all passes: its name, its type and its lanes.
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
                // If a texture has this name, the name isn't a misspelt buffer.
                let nearest = crate::diagnostic::nearest(name, held).filter(|near| *near != name);
                let nearest = nearest.map(str::to_owned);
                DispatchError::NoBuffer { name: name.to_owned(), nearest }
            })
        })
    }

    /// The number of invocations in all passes.
    pub fn invocations(&self) -> u64 {
        self.passes.iter().map(Pass::invocations).sum()
    }

    /// The author's names of the variables in all passes: resources, and workgroup variables.
    pub(crate) fn variables(&self) -> Vec<String> {
        self.passes.iter().flat_map(|pass| pass.program.variables()).collect()
    }

    /// The files that they depend on.
    pub(crate) fn read(&self) -> Vec<FileRead> {
        let modules = self.passes.iter().flat_map(|pass| pass.program.files());
        let fixtures = self.resources.iter().flat_map(|held| held.fixture.read());
        modules.chain(fixtures).cloned().collect()
    }

    /// The modules that their shaders were linked from.
    pub(crate) fn modules(&self) -> Vec<LinkedModule> {
        self.passes.iter().flat_map(|pass| pass.program.modules()).cloned().collect()
    }

    /// The place of the last entry point's declaration.
    pub fn span(&self) -> Option<Span> {
        self.passes.last()?.span()
    }

    /// Returns `true` if a resource is bound, and not set along with the commands.
    fn is_bound(binding: &Binding) -> bool {
        binding.kind != BindingKind::Immediate
    }
}

/// The contents of written resources after all passes: the number of each, with the words of a buffer, or four words a
/// texel of a texture.
pub type Afterwards = Vec<(usize, Vec<u32>)>;

/// Adds the nearest name of the module to the error of a missing entry point.
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
