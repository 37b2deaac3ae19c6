//! Makes compute passes over generated resources.

mod pixels;

pub(crate) use pixels::of_pixels;

use karat::fixture::Fixtures;
use karat::package::Package;
use karat::unstable::dispatch::{Passes, Wanted};
use karat::unstable::reflect::{Binding, Overrides, Program};

use crate::limits::LEAST_INVOCATIONS;
use crate::made_up::{Content, Extents, Mix, Ranges, Resources};

/// The number of workgroups in each direction for a pass whose dispatch isn't known. Several workgroups run in each
/// direction in which the invocations read their position. If Karat can't tell, several workgroups run in each
/// direction in which a workgroup has several invocations. "Several" usually means two workgroups, but three in the
/// vertical direction, so that the numbers of rows and columns differ. A pass that reads none of the builtin values in
/// [`APART`] has one workgroup.
fn usual_workgroups(size: [u32; 3], tells_apart: bool, asks: [Option<bool>; 3]) -> [u32; 3] {
    if !tells_apart {
        return [1; 3];
    }
    let asks_for_one = asks.contains(&Some(true));
    let extends = [0, 1, 2].map(|k| match asks[k] {
        Some(asks) if asks_for_one => asks,
        _ => size[k] > 1 || k == 0,
    });
    let mut groups = extends.map(|extends| if extends { 2 } else { 1 });
    if extends[1] {
        groups[1] = 3;
    }
    let first = extends.iter().position(|extends| *extends).unwrap_or(0);
    while size.iter().chain(&groups).product::<u32>() < LEAST_INVOCATIONS {
        groups[first] *= 2;
    }
    groups
}

/// The builtin values that let a pass depend on its number of workgroups.
const APART: [&str; 5] = [
    "@builtin(global_invocation_id)",
    "@builtin(global_invocation_index)",
    "@builtin(workgroup_id)",
    "@builtin(workgroup_index)",
    "@builtin(num_workgroups)",
];

/// The builtin values that count workgroups or invocations in all directions.
const INDICES: [&str; 2] = ["@builtin(global_invocation_index)", "@builtin(workgroup_index)"];

/// The usual dispatch of a compute entry point.
#[derive(Clone, Copy, Debug)]
pub struct Usual {
    size: [u32; 3],
    workgroups: [u32; 3],
}

impl Usual {
    /// Determines the usual dispatch of a compute entry point.
    ///
    /// # Errors
    /// Returns an error if the entry point isn't valid, or isn't a compute entry point.
    pub fn of(package: &Package, name: &str) -> Result<Self, String> {
        Self::with_overrides(package, name, &Overrides::new())
    }

    pub(crate) fn with_overrides(
        package: &Package,
        name: &str,
        overrides: &Overrides,
    ) -> Result<Self, String> {
        let (program, bindings, size) = Program::of_pass(package, name, overrides)?;
        Ok(Self::of_program(&program, &bindings, size, name))
    }

    fn of_program(program: &Program, bindings: &[Binding], size: [u32; 3], name: &str) -> Self {
        let own = name.rsplit("::").next().unwrap_or(name);
        let attributes = program.attributes(own);
        let has = |list: &[&str]| attributes.iter().any(|(_, one)| list.contains(&one.as_str()));
        let is_filled = program.fixed_elements(bindings).is_some_and(|most| {
            most <= size.iter().fold(1, |all: usize, count| all.saturating_mul(*count as usize))
        });
        // If one workgroup covers all elements, a host would dispatch one workgroup.
        let (apart, by_index) = (has(&APART) && !is_filled, has(&INDICES));
        let asks = program.asks_for_places(own);
        let asks = asks.map(|asks| asks.filter(|asks| *asks || !by_index));
        Self { size, workgroups: usual_workgroups(size, apart, asks) }
    }

    /// The number of workgroups in each direction. All three numbers are 1 if the pass reads no builtin value that
    /// depends on workgroups, or if one workgroup covers all elements.
    #[must_use]
    pub fn workgroups(&self) -> [u32; 3] {
        self.workgroups
    }

    /// The size that the name of an integer suggests: in a pass over 16 columns, `width` is 16. For a vector, the size
    /// that the vector's name suggests for one component.
    #[must_use]
    pub fn number(&self, name: &str, lane: usize, lanes: usize) -> Option<u32> {
        Extents::of(self.size, self.workgroups, Content::OF_PASSES[0]).size(name, lane, lanes, true)
    }

    /// The number of invocations in each direction that two passes with different workgroup sizes can both run, so that
    /// their results can be compared.
    pub(crate) fn invocations_with(self, other: Self) -> [u32; 3] {
        [0, 1, 2].map(|k| {
            let usual = |one: Self| one.size[k] * one.workgroups[k];
            let (a, b) = (self.size[k], other.size[k]);
            let both = (1..=b).map(|times| a * times).find(|all| all % b == 0).unwrap_or(a * b);
            usual(self).max(usual(other)).next_multiple_of(both)
        })
    }
}

/// Makes a pass over generated resources. The resources' sizes follow from `invocations`, or else from the usual
/// dispatch. The resources in `given` replace generated ones, and with `mix`, some inputs come from another content
/// (set of generated values).
///
/// # Errors
/// Returns an error if the pass isn't valid, or if a resource can't be generated.
pub(crate) fn arbitrary(
    package: &Package,
    name: &str,
    invocations: Option<[u32; 3]>,
    ranges: &Ranges,
    (content, mix, given): (Content, Option<&Mix<'_>>, &Fixtures),
) -> Result<(Passes, Resources), String> {
    let ranges = &ranges.scoped(name);
    let overrides = ranges.overrides_of(package, name);
    let (program, bindings, size) = Program::of_pass(package, name, &overrides)?;
    let workgroups = match invocations {
        Some(all) => [0, 1, 2].map(|k| all[k].div_ceil(size[k])),
        None => Usual::of_program(&program, &bindings, size, name).workgroups,
    };
    let workgroups = ranges.workgroups(name, workgroups);
    let extents = Extents::of(size, workgroups, content);
    extents.expect_few()?;
    let of_mix = |content| Some(Extents::of(size, workgroups, content));
    let mix = mix.map(|mix| Mix { extents: of_mix(mix.content), ..*mix });
    let mut made = Resources::of_pass((&program, &bindings), ranges, extents, mix.as_ref())?;
    ranges.note_sizes(std::iter::empty(), Some(name), &mut made.drawn);
    for (name, fixture) in &mut made.fixtures {
        if let Some((_, own)) = given.iter().find(|(known, _)| known == name) {
            fixture.clone_from(own);
        }
    }
    let wanted = Wanted { name: name.to_owned(), workgroups };
    let passes = Passes::new(package, &[wanted], (&made.fixtures, &[]), &overrides);
    Ok((passes.map_err(|error| error.to_string())?, made))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_workgroups_run_in_each_direction_that_a_workgroup_has() {
        let usual_workgroups = |size, apart| usual_workgroups(size, apart, [None; 3]);
        assert_eq!(usual_workgroups([256, 1, 1], true), [2, 1, 1]);
        assert_eq!(usual_workgroups([8, 8, 1], true), [2, 3, 1]);
        assert_eq!(usual_workgroups([1, 1, 1], true), [64, 1, 1]);
        assert_eq!(usual_workgroups([1, 16, 1], true), [2, 3, 1]);
        assert_eq!(usual_workgroups([64, 1, 1], false), [1, 1, 1]);
        let asks = |size, asks: [bool; 3]| super::usual_workgroups(size, true, asks.map(Some));
        assert_eq!(asks([64, 1, 1], [true, true, false]), [2, 3, 1]);
        assert_eq!(asks([64, 1, 1], [false, true, false]), [1, 3, 1]);
        assert_eq!(asks([1, 1, 1], [false, false, true]), [1, 1, 64]);
        assert_eq!(
            asks([64, 1, 1], [false; 3]),
            [2, 1, 1],
            "the pass reads only the number of workgroups"
        );
        let usual = |size| Usual { size, workgroups: usual_workgroups(size, true) };
        assert_eq!(usual([8, 8, 1]).invocations_with(usual([4, 4, 1])), [16, 24, 1]);
        assert_eq!(usual([6, 1, 1]).invocations_with(usual([4, 1, 1])), [96, 1, 1]);
    }

    /// A pass that uses one component of a vector reads only this component. A pass that gives the whole vector to a
    /// function may read all components.
    #[test]
    fn a_pass_runs_along_the_places_that_it_asks_for() {
        let head = "struct In { @builtin(workgroup_id) w: vec3u, @builtin(local_invocation_index) i: u32 }\n\
                    @group(0) @binding(0) var<storage, read_write> out: array<u32>;\n\
                    fn sum(v: vec3u) -> u32 { return v.x + v.y; } fn all(in: In) -> u32 { return in.w.x; }\n\
                    @compute @workgroup_size(64) fn f(in: In) { out[0] = ";
        let workgroups = |value: &str| {
            let package = Package::from_source("p", format!("{head}{value}; }}"));
            Usual::of(&package, "f").expect(value).workgroups
        };
        for (value, expected) in [
            ("in.w.y", [1, 3, 1]),
            ("in.w.yz.x", [1, 3, 2]),
            ("in.w.y + sum(in.w)", [2, 3, 1]),
            ("in.w.y + all(in)", [2, 3, 1]),
            ("in.w[in.i]", [2, 1, 1]),
        ] {
            assert_eq!(workgroups(value), expected, "{value}");
        }
    }
}
