//! Compares the interface that a function shows to its host before and after an edit: resources, attributes and
//! overrides.

use std::collections::BTreeSet;

use karat::fixture::Fixtures;
use karat::unstable::probe::Probed;
use karat::unstable::reflect::{Binding, Program};
use karat_core::value::Shape;

/// A function or an entry point in one of the two packages, with its resources.
#[derive(Clone, Copy)]
pub(super) struct Side<'s> {
    pub(super) program: &'s Program,
    pub(super) bindings: &'s [Binding],
}

impl<'s> Side<'s> {
    pub(super) fn of(probed: &'s Probed) -> Self {
        Self { program: &probed.program, bindings: &probed.function.bindings }
    }

    /// Checks if a resource has the same layout in both packages.
    fn has_layout(self, binding: &Binding, other: Self, is: &Binding) -> bool {
        let layout = |side: Self, binding: &Binding| {
            let lanes = side.program.written_shape(binding, Some(256)).map(|shape| shape.lanes());
            (lanes, side.program.least_bytes(binding), side.program.places(binding))
        };
        layout(self, binding) == layout(other, is)
    }
}

/// Returns the old resource that corresponds to a resource after the edit: the resource with the same name, or
/// otherwise a removed resource with the same binding. Returns `None` if neither resource exists.
fn was<'b>(before: Side<'b>, after: Side<'_>, new: &Binding) -> Option<&'b Binding> {
    let is_gone = |old: &Binding| after.bindings.iter().all(|new| new.path != old.path);
    let place = |one: &Binding| (one.group, one.binding, one.kind);
    let olds = before.bindings;
    olds.iter()
        .find(|old| old.path == new.path)
        .or_else(|| olds.iter().find(|old| place(old) == place(new) && is_gone(old)))
}

/// The resources that an edit renamed without changing their layout, with their paths before and after the edit.
pub(super) fn renamed(before: Side<'_>, after: Side<'_>) -> Vec<(String, String)> {
    let of = |is: &Binding| {
        let was = was(before, after, is).filter(|was| was.path != is.path)?;
        before.has_layout(was, after, is).then(|| (was.path.clone(), is.path.clone()))
    };
    after.bindings.iter().filter_map(of).collect()
}

/// Gives renamed resources, and resources with renamed members, the same contents in both packages. Otherwise the
/// contents would differ, because they depend on names. If only one version of the function writes a resource, both
/// packages get the contents that Karat generated for that version.
pub(super) fn hold_the_same([old, new]: [&mut Fixtures; 2], before: &Probed, after: &Probed) {
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

/// Buffers whose members were renamed, but kept their types and offsets.
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

/// The changed attributes of an entry point's inputs and outputs, such as `@location(1)`, as sentences. If only an
/// input's name changed, the host isn't affected, so there is no sentence.
pub(super) fn attributes(before: &[(String, String)], after: &[(String, String)]) -> Vec<String> {
    let is_given = |(path, _): &(String, String)| path.starts_with("result");
    let shown = |one: &(String, String)| {
        let role = if is_given(one) { "output" } else { "input" };
        format!("the {role} `{}` with {}", one.0, one.1)
    };
    let has = |all: &[(String, String)], one: &(String, String)| {
        all.iter().any(|known| known.1 == one.1 && is_given(known) == is_given(one))
    };
    let named = |all: &[(String, String)], path: &str| all.iter().any(|(known, _)| known == path);
    let moved = |one: &(String, String)| {
        let (path, is) = one;
        let (_, was) = before.iter().find(|(known, _)| known == path)?;
        (was != is).then(|| format!("`{path}` is {is}, and was {was} before the edit"))
    };
    let new = |one: &&(String, String)| !has(before, one) && !named(before, &one.0);
    let gone = |one: &&(String, String)| !has(after, one) && !named(after, &one.0);
    let mut all: Vec<String> = after.iter().filter_map(moved).collect();
    all.extend(after.iter().filter(new).map(|one| format!("{} is new", shown(one))));
    let gone = before.iter().filter(gone);
    all.extend(gone.map(|one| format!("{} is no longer used", shown(one))));
    all
}

/// The resources that an entry point has only before or only after an edit.
pub(super) fn gained_and_lost(before: Side<'_>, after: Side<'_>) -> Vec<String> {
    let shown = |one: &Binding| {
        format!("`{}` at @group({}) @binding({})", one.name(), one.group, one.binding)
    };
    let known: Vec<&Binding> =
        after.bindings.iter().filter_map(|new| was(before, after, new)).collect();
    let is_new = |new: &&Binding| was(before, after, new).is_none();
    let is_gone = |old: &&Binding| !known.contains(old);
    let gained = after.bindings.iter().filter(is_new).map(|one| format!("{} is new", shown(one)));
    let lost = before.bindings.iter().filter(is_gone);
    gained.chain(lost.map(|one| format!("{} is no longer used", shown(one)))).collect()
}

/// The overrides that the edit added, removed or changed, as sentences.
pub(super) fn overrides(before: &Program, after: &Program) -> Vec<String> {
    let [old, new] = [before, after].map(Program::declared_overrides);
    let of = |all: &[(String, String)], name: &str| {
        all.iter().find(|(known, _)| known == name).map(|(_, is)| is.clone())
    };
    let changed = new.iter().filter_map(|(name, is)| match of(&old, name) {
        Some(was) if was == *is => None,
        Some(was) => Some(format!("the override `{name}` is {is}, and was {was} before the edit")),
        None => {
            Some(format!("the override `{name}` ({is}) is used, and wasn't used before the edit"))
        }
    });
    let gone = old.iter().filter(|(name, _)| of(&new, name).is_none());
    changed
        .chain(gone.map(|(name, was)| format!("the override `{name}` ({was}) is no longer used")))
        .collect()
}

/// The changed bindings of resources, and the changed offsets of their members, which a host must adapt to.
pub(super) fn interface(before: Side<'_>, after: Side<'_>) -> Vec<String> {
    let mut all = Vec::new();
    for new in after.bindings {
        let Some(old) = was(before, after, new) else { continue };
        let name = new.name();
        let at =
            |binding: &Binding| format!("@group({}) @binding({})", binding.group, binding.binding);
        if (old.group, old.binding) != (new.group, new.binding) {
            all.push(format!(
                "`{name}` is bound at {}, and was bound at {} before the edit",
                at(new),
                at(old)
            ));
        }
        if old.kind != new.kind {
            let [was, is] = [old, new].map(|binding| binding.kind.to_string());
            let access = |one: &Binding| if one.kind.is_written() { "read_write" } else { "read" };
            all.push(match was == is {
                true => {
                    format!("`{name}` is {}, and was {} before the edit", access(new), access(old))
                }
                false => format!("`{name}` is a {is}, and was a {was} before the edit"),
            });
        }
        let bytes = |side: Side<'_>, binding: &Binding| side.program.least_bytes(binding);
        if bytes(before, old) != bytes(after, new) {
            let (was, is) = (bytes(before, old), bytes(after, new));
            all.push(format!(
                "`{name}` needs {is} bytes now, and needed {was} bytes before the edit"
            ));
        }
        let (was, is) = (before.program.places(old), after.program.places(new));
        let moved = is.iter().find_map(|(path, place)| {
            let (_, old) = was.iter().find(|(known, _)| known == path)?;
            (old != place).then(|| {
                format!("`{name}{path}` is at byte {place}, and was at byte {old} before the edit")
            })
        });
        all.extend(moved);
    }
    all
}

/// The signatures of a function before and after an edit. If the signatures are equal and the function writes memory,
/// each of the two texts also names the written variables.
pub(super) fn signatures(sides: [&Probed; 2]) -> [String; 2] {
    let shown = sides.map(|one| one.function.to_string());
    if shown[0] != shown[1] || sides.iter().all(|one| one.function.written().next().is_none()) {
        return shown;
    }
    sides.map(|one| {
        let all = match &one.function.result {
            Shape::Struct { members, .. } => members.as_slice(),
            _ => &[],
        };
        let written = all.iter().skip(one.function.outputs().len());
        let written: Vec<String> =
            written.map(|(name, shape)| format!("{name}: {shape}")).collect();
        let written = if written.is_empty() { "nothing".to_owned() } else { written.join(", ") };
        format!("{}, and writes {written}", one.function)
    })
}
