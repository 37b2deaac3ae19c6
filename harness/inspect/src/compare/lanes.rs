//! Matches the lanes of a function's inputs and outputs before and after an edit. A lane is one scalar of a value. Two
//! lanes of an entry point match if their attributes are equal; names and structures don't matter.

use std::borrow::Cow;
use std::collections::BTreeMap;

use karat::unstable::probe::Probed;
use karat::unstable::reflect::Function;
use karat_core::value::{Scalar, Shape};

/// The lanes that a function has before and after an edit.
#[derive(Debug)]
pub(super) struct Shared {
    /// For each argument lane before the edit, the index of the matching lane after the edit.
    arguments: Vec<Option<usize>>,
    /// For each pair of matching result lanes, the index before the edit and the index after it.
    pub(super) results: Vec<(usize, usize)>,
    /// `true` if the lanes and their order didn't change.
    is_same: bool,
    /// For each argument lane before the edit, the value that it gets if no lane matches it after the edit.
    pub(super) own: Vec<u32>,
}

/// The key and the type of each lane. The key is the lane's attribute and component, such as `@location(0).x`, or the
/// lane's name and component if the lane has no attribute.
type Keyed = Vec<(String, Scalar)>;

impl Shared {
    /// Matches the lanes of two functions; `None` if Karat can't compare them, for example because the edit changed a
    /// parameter's type.
    pub(super) fn of(
        before: &Probed,
        after: &Probed,
        attributes: &[Vec<(String, String)>; 2],
    ) -> Option<Self> {
        let (was, is) = (&before.function, &after.function);
        let shapes = |function: &Function| {
            let parameters = function.parameters.iter().map(|(_, shape)| shape.clone());
            (parameters.collect::<Vec<_>>(), function.result.clone())
        };
        if was.form.taken != is.form.taken || was.spaces() != is.spaces() {
            return None;
        }
        if shapes(was) == shapes(is) {
            let all = |shape: &Shape| shape.lanes().len();
            let width = was.parameters.iter().map(|(_, shape)| all(shape)).sum();
            let results = (0..all(&was.result)).map(|lane| (lane, lane)).collect();
            let arguments = (0..width).map(Some).collect();
            return Some(Self { arguments, results, is_same: true, own: vec![0; width] });
        }
        if was.stage().is_none() && is.stage().is_none() {
            return Self::of_names(was, is);
        }
        if was.stage().is_none()
            || was.stage() != is.stage()
            || was.form.discards != is.form.discards
        {
            return None;
        }
        let keyed = |side: usize, names: Vec<(String, Scalar)>| -> Keyed {
            names
                .into_iter()
                .map(|(path, scalar)| (key(&path, &attributes[side]), scalar))
                .collect()
        };
        let arguments = [was, is].map(argument_lanes);
        let results = [was, is].map(result_lanes);
        let [old, new] = arguments;
        let (old, new) = (keyed(0, old), keyed(1, new));
        if has_other_type(&old, &new) {
            return None;
        }
        let arguments: Vec<_> =
            old.iter().map(|one| new.iter().position(|other| other == one)).collect();
        let [given, gives] = results;
        let (given, gives) = (keyed(0, given), keyed(1, gives));
        // Resources that both versions write have no attribute, so names match them.
        let named = |all: &Keyed| {
            all.iter().filter(|(key, _)| !key.contains('@')).cloned().collect::<Vec<_>>()
        };
        if has_other_type(&given, &gives) || named(&given) != named(&gives) {
            return None;
        }
        let place = |(at, one)| Some((at, gives.iter().position(|other| other == one)?));
        let results: Vec<_> = given.iter().enumerate().filter_map(place).collect();
        let own = vec![0; arguments.len()];
        (!results.is_empty()).then_some(Self { arguments, results, is_same: false, own })
    }

    /// Matches the lanes of two functions that aren't entry points, by the parameters' positions and the members'
    /// names. If the edit renamed members, matches the lanes in their order.
    fn of_names(was: &Function, is: &Function) -> Option<Self> {
        let arguments = |function: &Function| -> Keyed {
            let of = |(at, (_, shape)): (usize, &(String, Shape))| {
                let named = shape.lane_names().into_iter().zip(shape.lanes());
                named.map(|(lane, scalar)| (format!("{at}{lane}"), scalar)).collect::<Vec<_>>()
            };
            function.parameters.iter().enumerate().flat_map(of).collect()
        };
        let places = |old: &Keyed, new: &Keyed| -> Option<Vec<usize>> {
            let of = |one| new.iter().position(|other| other == one);
            let by_name: Option<Vec<usize>> = old.iter().map(of).collect();
            let scalars = |all: &Keyed| all.iter().map(|(_, scalar)| *scalar).collect::<Vec<_>>();
            let by_place = || (scalars(old) == scalars(new)).then(|| (0..old.len()).collect());
            (old.len() == new.len()).then(|| by_name.or_else(by_place)).flatten()
        };
        if was.parameters.len() != is.parameters.len() {
            return None;
        }
        let taken = places(&arguments(was), &arguments(is))?;
        let given = places(&result_lanes(was), &result_lanes(is))?;
        let own = vec![0; taken.len()];
        let arguments = taken.into_iter().map(Some).collect();
        let results = given.into_iter().enumerate().collect();
        Some(Self { arguments, results, is_same: false, own })
    }

    /// Sets the values of the argument lanes that only the original function has.
    pub(super) fn fill(&mut self, row: &[u32]) {
        self.own.copy_from_slice(row);
    }

    /// Converts the argument rows of the edited function to rows of the original function.
    pub(super) fn rows<'r>(&self, rows: &'r [u32], count: usize) -> Cow<'r, [u32]> {
        if self.is_same {
            return Cow::Borrowed(rows);
        }
        let width = rows.len() / count.max(1);
        let lanes = self.arguments.iter().zip(&self.own);
        let of = |row: &[u32]| -> Vec<u32> {
            lanes.clone().map(|(lane, own)| lane.map_or(*own, |lane| row[lane])).collect()
        };
        Cow::Owned((0..count).flat_map(|at| of(&rows[at * width..][..width])).collect())
    }

    /// Returns `true` if the results of both versions have the same lanes. Then Karat shows results as whole values,
    /// such as `vec3f(0, 1, 0)`.
    pub(super) fn is_same(&self) -> bool {
        self.is_same
    }
}

fn has_other_type(one: &Keyed, other: &Keyed) -> bool {
    let of = |all: &Keyed| -> BTreeMap<String, Keyed> {
        let mut types = BTreeMap::<_, Keyed>::new();
        for (key, scalar) in all.iter().filter(|(key, _)| key.contains('@')) {
            let attribute = key.split_inclusive(')').next().unwrap_or(key);
            types.entry(attribute.to_owned()).or_default().push((key.clone(), *scalar));
        }
        types
    };
    let others = of(other);
    of(one).iter().any(|(attribute, lanes)| others.get(attribute).is_some_and(|of| of != lanes))
}

/// The names of the argument lanes, such as `in.uv.x`. An argument with derivatives has three parts: the value, and the
/// derivatives `dx` and `dy`.
fn argument_lanes(function: &Function) -> Vec<(String, Scalar)> {
    let of = |(name, shape): &(String, Shape)| {
        let parts: Vec<(&str, &Shape)> = match shape.quad() {
            Some(value) => ["", "dx ", "dy "].map(|part| (part, value)).to_vec(),
            None => vec![("", shape)],
        };
        let lanes = |(part, shape): (&str, &Shape)| {
            let named = shape.lane_names().into_iter().zip(shape.lanes());
            named.map(|(lane, scalar)| (format!("{part}{name}{lane}"), scalar)).collect::<Vec<_>>()
        };
        parts.into_iter().flat_map(lanes).collect::<Vec<_>>()
    };
    function.parameters.iter().flat_map(of).collect()
}

fn result_lanes(function: &Function) -> Vec<(String, Scalar)> {
    let shape = &function.result;
    let named = shape.lane_names().into_iter().zip(shape.lanes());
    let is_joined = matches!(shape, Shape::Struct { members, .. } if members.iter().any(|(name, _)| name == RESULT));
    let full = |lane: String| {
        let lane = if function.form.discards { lane.replacen(".value", "", 1) } else { lane };
        match is_joined {
            true => lane.trim_start_matches('.').to_owned(),
            false => format!("{RESULT}{lane}"),
        }
    };
    named.map(|(lane, scalar)| (full(lane), scalar)).collect()
}

const RESULT: &str = "result";

/// Replaces the path of a lane by its attribute: `in.uv.x` becomes `@location(0).x`.
fn key(path: &str, attributes: &[(String, String)]) -> String {
    let (part, path) = path.split_once(' ').map_or(("", path), |(part, path)| (part, path));
    let found = attributes.iter().find_map(|(known, attribute)| {
        let rest = path.strip_prefix(known.as_str())?;
        let ends = rest.is_empty() || rest.starts_with(['.', '[']);
        let side = if known.starts_with(RESULT) { RESULT } else { "" };
        let attribute = attribute.split(" @interpolate").next().unwrap_or(attribute);
        ends.then(|| format!("{part}{side}{attribute}{rest}"))
    });
    found.unwrap_or_else(|| format!("{part}{path}"))
}
