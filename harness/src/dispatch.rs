//! Dispatches compute passes: runs entry points that share resources.
//!
//! [`Passes`] holds linked and validated shaders with their resources. An
//! [`Executor`](crate::executor::Executor) runs the passes one after another.

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
    /// The shader isn't valid, or can't be used as a pass.
    #[error(transparent)]
    Reflect(#[from] ReflectError),
    /// The fixtures don't match the shader's variables.
    #[error(transparent)]
    Fixture(#[from] FixtureError),
    /// A path can't be used.
    #[error(transparent)]
    Path(#[from] PathError),
    /// A pass ran, but Karat couldn't get its results.
    #[error(transparent)]
    Probe(#[from] ProbeError),
    /// A loop takes more iterations than the driver allows.
    #[error("{0}")]
    Rounds(Box<Diagnostic>),
    /// The module has no compute entry point with this name.
    #[error("`{name}` isn't a compute entry point{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    EntryPoint {
        /// The name that the test uses.
        name: String,
        /// The module's entry point with the most similar name.
        nearest: Option<String>,
    },
    /// There are no passes.
    #[error("nothing is dispatched; add `.dispatch(\"module::entry_point\", [x, y, z])`")]
    Empty,
    /// The number of workgroups in one direction is 0, or more than 65535. Every GPU supports up to 65535 workgroups in
    /// each direction.
    #[error("`{name}` is dispatched over {} x {} x {} workgroups; each number must be 1 to 65535", workgroups[0], workgroups[1], workgroups[2])]
    Workgroups {
        /// The name of the entry point.
        name: String,
        /// The number of workgroups in each direction.
        workgroups: [u32; 3],
    },
    /// A workgroup has more invocations than the path supports.
    #[error("the workgroup of `{name}` has {} x {} x {} invocations, but path `{path}` allows up to {} x {} x {}, and {limit} \
             invocations in total", size[0], size[1], size[2], sides[0], sides[1], sides[2])]
    WorkgroupSize {
        /// The name of the entry point.
        name: String,
        /// The number of invocations in each direction.
        size: [u32; 3],
        /// The path.
        path: Path,
        /// The largest number of invocations in each direction that the path supports.
        sides: [u32; 3],
        /// The largest number of invocations in a workgroup that the path supports.
        limit: u32,
    },
    /// The dispatch has no invocation with this id.
    #[error("`{name}` has no invocation {invocation:?}: its dispatch has {} x {} x {} invocations, counted from 0",
        counts[0], counts[1], counts[2])]
    Invocation {
        /// The name of the entry point.
        name: String,
        /// The `global_invocation_id` that the dispatch doesn't have.
        invocation: [u32; 3],
        /// The number of invocations in each direction.
        counts: [u32; 3],
    },
    /// No pass writes a resource with this name.
    #[error("no pass writes `{name}`{}",
        nearest.as_ref().map_or_else(|| ": name a resource that a pass writes".to_owned(),
            |name| format!("; did you mean `{name}`?")))]
    NotWritten {
        /// The name that the test uses.
        name: String,
        /// A suggestion: the written resource with the most similar name. If the resource `name` exists but no pass
        /// writes it, Karat makes no suggestion.
        nearest: Option<String>,
    },
    /// A resource has no member with this name.
    #[error("`{name}` is {shape}, which has no `{member}`{}",
        nearest.as_ref().map_or_else(String::new, |near| format!("; did you mean `{near}`?")))]
    NoMember {
        /// The name of the resource.
        name: String,
        /// The name of the member that the test uses.
        member: String,
        /// The type of the resource.
        shape: String,
        /// The member with the most similar name, such as `particles.position`.
        nearest: Option<String>,
    },
    /// No pass uses a buffer with this name.
    #[error("no pass uses a buffer `{name}`{}",
        nearest.as_ref().map_or_else(String::new, |name| format!("; did you mean `{name}`?")))]
    NoBuffer {
        /// The name that the test uses.
        name: String,
        /// The most similar name of a resource that a pass uses.
        nearest: Option<String>,
    },
    /// No pass has an override with this name.
    #[error("no pass uses an override `{name}`")]
    Override {
        /// The name that the test uses.
        name: String,
    },
    /// The executor can't dispatch passes.
    #[error("path `{path}` can't dispatch compute passes")]
    Unable {
        /// The path.
        path: Path,
    },
}

impl DispatchError {
    /// Checks if a path rejected the passes before it ran any pass. A workgroup that is too large for the path doesn't
    /// count as a refusal: the shader has to change.
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

/// The largest number of workgroups in one direction that every device supports.
pub(crate) const MOST_WORKGROUPS: u32 = 65_535;

/// A dispatch, as the test's author describes it.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// The entry point's name, such as `module::entry_point`.
    pub name: String,
    /// The number of workgroups in each direction.
    pub workgroups: [u32; 3],
}

/// Passes that are ready to run: linked and validated shaders, with the resources for their variables.
#[derive(Debug)]
pub struct Passes {
    /// The passes, in the order in which they run.
    pub passes: Vec<Pass>,
    /// The resources that the passes share.
    pub resources: Vec<Held>,
}

/// One dispatch of an entry point.
#[derive(Debug)]
pub struct Pass {
    /// The entry point's name, such as `module::entry_point`.
    pub name: String,
    /// The linked shader.
    pub program: Arc<Program>,
    /// The entry point's name in the linked text.
    pub entry_point: String,
    /// The number of workgroups in each direction.
    pub workgroups: [u32; 3],
    /// The resource variables that the entry point uses, each with the index of its resource in [`Passes::resources`].
    pub bindings: Vec<(Binding, usize)>,
    /// The scalar types of the result, if `entry_point` is a fragment function. `None` for a compute pass. For a
    /// fragment function, `workgroups` has the width and height of the draw in pixels.
    pub drawn: Option<Vec<Scalar>>,
}

impl Pass {
    /// The number of invocations in all workgroups.
    pub(crate) fn invocations(&self) -> u64 {
        self.invocations_of(self.workgroup_size())
    }

    /// The number of invocations in all workgroups, if a workgroup has this size.
    pub(crate) fn invocations_of(&self, size: [u32; 3]) -> u64 {
        size.iter().chain(&self.workgroups).map(|count| u64::from(*count)).product()
    }

    /// The size of a workgroup: the number of invocations in each direction.
    pub(crate) fn workgroup_size(&self) -> [u32; 3] {
        if self.drawn.is_some() {
            return [1; 3];
        }
        let entry_point = self.program.compute_entry_point(&self.entry_point);
        entry_point.expect("a pass has an entry point").1
    }

    /// Describes the invocation with the index `number`. The invocations of one workgroup have consecutive indices.
    /// `size` is the size of a workgroup.
    pub(crate) fn invocation(&self, size: [u32; 3], number: usize) -> String {
        let width = size.iter().map(|count| *count as usize).product::<usize>();
        let (group, local) = (split(number / width, self.workgroups), split(number % width, size));
        format!("local {local} of workgroup {group}")
    }
}

/// Returns the position `(x, y, z)` of the element with the index `number` in a 3D grid. `counts` is the size of the
/// grid.
fn split(number: usize, counts: [u32; 3]) -> String {
    let [x, y, _] = counts.map(|count| count as usize);
    format!("({}, {}, {})", number % x, number / x % y, number / (x * y))
}

/// A resource that passes share.
#[derive(Debug)]
pub struct Held {
    /// The name of the variable, with its module.
    pub name: String,
    /// The fixture, with its contents.
    pub fixture: Fixture,
}

impl Pass {
    /// The source position of the entry point.
    pub(crate) fn span(&self) -> Option<Span> {
        self.program.entry_point_span(&self.entry_point)
    }
}

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
    /// Links passes and binds their fixtures. A buffer's fixture can have just a size, without contents.
    ///
    /// # Errors
    /// Returns an error if an entry point or a fixture is missing, or if there is a fixture that no pass uses.
    pub fn new(
        package: &Package,
        wanted: &[Wanted],
        (given, same): (&Fixtures, &[(String, String)]),
        overrides: &Overrides,
    ) -> Result<Self, DispatchError> {
        // A variable may share the resource of another variable. Then the resource has the names of both
        // variables.
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
            // If there are several passes, each pass gets only the overrides that it declares.
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
                // All passes share the resource of one fixture.
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

    /// Makes one pass that uses `resources`. `entry_point` is the entry point's name in the linked text.
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

    pub(crate) fn has_subgroups(&self) -> bool {
        self.passes.iter().any(|pass| pass.program.has_subgroups())
    }

    /// The entry points, in the order in which they are dispatched.
    pub fn entry_points(&self) -> impl Iterator<Item = &str> {
        self.passes.iter().map(|pass| pass.name.as_str())
    }

    /// Returns an error if workgroups are too large for a path, in one direction or in total.
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

    /// The passes that use a resource. Each pass comes with its variable for the resource.
    pub(crate) fn uses(&self, resource: usize) -> impl Iterator<Item = (&Pass, &Binding)> {
        self.passes.iter().flat_map(move |pass| {
            let own = pass.bindings.iter().filter(move |(_, number)| *number == resource);
            own.map(move |(binding, _)| (pass, binding))
        })
    }

    /// Finds the first pass that can write a resource. Also returns the pass's variable for the resource.
    pub(crate) fn writer(&self, resource: usize) -> Option<(&Pass, &Binding)> {
        self.uses(resource).find(|(_, binding)| binding.kind.is_written())
    }

    /// Finds a resource that a pass writes, by the name of its variable or its fixture. Returns the named part of the
    /// resource, and the type of this part. The name may continue with a member, as in `particles.position`.
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
            reason: "Karat can't read values of the variable's type".to_owned(),
        })?;
        Part::of(number, &shape, member).ok_or_else(|| no_member(name, member, &shape))
    }

    /// Returns the indices of a texel as text: `[3, 1]`, or `[3, 1, 0]` for a 3D texture or a texture with layers.
    /// `number` counts texels row by row. Returns `None` for a buffer or a 1D texture.
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

    /// Returns the components of a resource that a pass writes. `words` has the contents of the resource. Returns
    /// `None` if no pass writes the resource.
    pub fn lanes(&self, resource: usize, words: &[u32]) -> Option<Vec<u32>> {
        let (pass, binding) = self.writer(resource)?;
        Some(pass.program.lanes_of_words(binding, words))
    }

    /// Returns the contents of a buffer before the first pass, as components. Returns `None` if no pass writes the
    /// buffer, or if the resource isn't a buffer.
    pub(crate) fn before(&self, resource: usize) -> Option<Vec<u32>> {
        let (pass, binding) = self.writer(resource)?;
        let bytes = self.resources[resource].fixture.bytes(&pass.program, binding)?.ok()?;
        lanes_of(pass.program.module(), binding.ty, &bytes)
    }

    /// Returns a buffer's name and type, and its contents before the first pass.
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
                // If a texture has this name, the name isn't a misspelt name of a buffer.
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

    /// The names of the passes' resources and workgroup variables, as in the author's files.
    pub(crate) fn variables(&self) -> Vec<String> {
        self.passes.iter().flat_map(|pass| pass.program.variables()).collect()
    }

    pub(crate) fn read(&self) -> Vec<FileRead> {
        let modules = self.passes.iter().flat_map(|pass| pass.program.files());
        let fixtures = self.resources.iter().flat_map(|held| held.fixture.read());
        modules.chain(fixtures).cloned().collect()
    }

    /// The modules from which the passes' shaders were linked.
    pub(crate) fn modules(&self) -> Vec<LinkedModule> {
        self.passes.iter().flat_map(|pass| pass.program.modules()).cloned().collect()
    }

    /// The source position of the last pass's entry point.
    pub fn span(&self) -> Option<Span> {
        self.passes.last()?.span()
    }

    /// Checks if a variable has a binding. Immediates have no binding.
    fn is_bound(binding: &Binding) -> bool {
        binding.kind != BindingKind::Immediate
    }
}

/// The contents of the written resources after all passes. Each entry has the index of a resource in
/// [`Passes::resources`], and the contents as `u32`s. A texture has four `u32`s for each texel.
pub type Afterwards = Vec<(usize, Vec<u32>)>;

/// Adds the most similar name in the package to the error about a missing entry point, if there is a similar
/// name.
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
