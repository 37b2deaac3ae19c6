//! Compares a compute pass before and after an edit: the values that it writes into each resource, and its violations.

use karat::check::HazardKind as Kind;
use karat::fixture::Fixtures;
use karat::package::Package;
use karat::path::Path;
use karat::unstable::dispatch::{Examined, Passes, Violation};
use karat::unstable::executor;
use karat::unstable::interpret::{OrderOf, Runner, examine_made_up, in_order_of};
use karat::unstable::reflect::Program;
use karat_core::value::{Shape, format_lane};

use super::sides::{gained_and_lost, interface, renamed};
use super::values::{Clarity, Largest, clarity};
use super::{Both, Change, Compared, PathChange, Request, Side, WordChange, first_line};
use crate::limits::{ORDERS, SEVERAL_WORKGROUPS};
use crate::made_up::Content;
use crate::passes::{self, Usual};

impl Request {
    /// Dispatches a pass before and after the edit, over generated resources.
    pub(super) fn compare_passes(&self, name: &str) -> Compared {
        let mut compared = Compared::of(name, Change::Same { cases: 0 });
        match self.run_passes(name, &mut compared) {
            Ok(change) => Compared { change, ..compared },
            Err(reason) => {
                Compared { change: Change::Unjudged { reason: first_line(&reason) }, ..compared }
            }
        }
    }

    fn run_passes(&self, name: &str, compared: &mut Compared) -> Result<Change, String> {
        let ranges = self.ranges()?;
        let (of_old, of_new) = (
            |error| format!("before the edit: {error}"),
            |error| format!("after the edit: {error}"),
        );
        let of = |side: &Package| Program::of_pass(side, name, &ranges.overrides_of(side, name));
        let (was, old_bindings, _) = of(&self.before).map_err(of_old)?;
        let (is, new_bindings, _) = of(&self.after).map_err(of_new)?;
        let ranges = ranges.with_literals(was.literals().and(&is.literals()));
        let nameless = ranges.without_names();
        let before = Side { program: &was, bindings: &old_bindings };
        let after = Side { program: &is, bindings: &new_bindings };
        compared.interface = interface(before, after);
        compared.interface.extend(gained_and_lost(before, after));
        let renamed = renamed(before, after);
        let usual =
            |side: &Package| Usual::with_overrides(side, name, &ranges.overrides_of(side, name));
        let sides = [usual(&self.before)?, usual(&self.after)?];
        let usual = sides[0].invocations_with(sides[1]);
        compared.dispatched = Some(usual);
        let mut runs: Vec<(Content, [u32; 3])> =
            Content::OF_PASSES.map(|content| (content, usual)).to_vec();
        // A pass that seems to need one workgroup may number its workgroups with an atomic, so Karat also runs several.
        if sides.iter().all(|side| side.workgroups() == [1; 3]) {
            runs.push((Content::OF_PASSES[0], [SEVERAL_WORKGROUPS * usual[0], usual[1], usual[2]]));
        }
        let mut paths: Vec<PathChange> = Vec::new();
        let mut words = 0;
        let (mut brought, mut mended) = (Brought::default(), Brought::default());
        let mut covered = Both::default();
        let mut unwatched = None;
        for (content, invocations) in runs {
            // The pass may be written for one workgroup. So several workgroups run only if no other run shows the edit.
            let is_more = invocations != usual;
            if is_more && !(paths.is_empty() && brought.sure.is_empty()) {
                break;
            }
            // If the content has no likely indices and counts, it doesn't use the ranges of names, either.
            let ranges = if content.is_likely { &ranges } else { &nameless };
            let made = |package: &Package, given: &Fixtures| {
                passes::arbitrary(package, name, Some(invocations), ranges, (content, None, given))
            };
            let (new, made_new) = made(&self.after, &Vec::new()).map_err(of_new)?;
            let of_new_name = |path: &str| made_new.fixtures.iter().find(|(name, _)| name == path);
            let given = renamed
                .iter()
                .filter_map(|(was, is)| Some((was.clone(), of_new_name(is)?.1.clone())));
            let (old, _) = made(&self.before, &given.collect()).map_err(of_old)?;
            let made = made_new;
            compared.location = new.span().map_or_else(String::new, |span| span.to_string());
            compared.drawn.merge(made.drawn);
            let (seen_old, seen_new) = (examine_made_up(&old), examine_made_up(&new));
            let is_clean = seen_old.violations.is_empty() && seen_old.endless.is_none();
            if is_more && (!is_clean || seen_old.too_long) {
                break;
            }
            match (&seen_old.endless, &seen_new.endless) {
                (None, Some(_)) => return Err("after the edit, one of the pass's loops runs too many iterations to compare, or doesn't end".to_owned()),
                (Some(_), _) => {
                    compared.cut += usize::try_from(new.invocations()).unwrap_or(usize::MAX);
                    continue;
                }
                (None, None) => {}
            }
            if seen_new.too_long && !seen_old.too_long {
                return Err("after the edit, the pass's loops run too long to compare".to_owned());
            }
            if seen_old.too_long {
                compared.cut += usize::try_from(new.invocations()).unwrap_or(usize::MAX);
                continue;
            }
            let is_whole = watched(&seen_old, &seen_new, &mut unwatched);
            brought.add(content, [&seen_old, &seen_new], &renamed);
            if is_whole {
                mended.add(content, [&seen_new, &seen_old], &renamed);
            }
            // Each driver numbers the workgroups in its own order, so they run only in the engine.
            let paths_of = self.paths.iter().filter(|path| !is_more || **path == Path::CPU);
            for path in paths_of {
                let run = |passes: &Passes| {
                    let executor = executor::of(*path).map_err(|error| error.to_string())?;
                    executor::dispatch(executor, passes).map_err(|error| error.to_string())
                };
                let difference = Difference::of((&old, run(&old)?), (&new, run(&new)?), &renamed)?;
                words += difference.words;
                let Some(change) = difference.change(path.to_string(), &made.members) else {
                    continue;
                };
                match paths.iter_mut().find(|known| known.path == change.path) {
                    Some(known) => known.add(change),
                    None => paths.push(change),
                }
            }
            // An effect of the edit may depend on the order of invocations, and not appear in the engine's usual order.
            // A violation that the edit adds is the better evidence.
            let is_silent = paths.is_empty() && brought.sure.is_empty();
            if is_silent && content.is_likely {
                paths.extend(ordered((&old, &new), &renamed, &made.members)?);
            }
            if paths.is_empty() && brought.sure.is_empty() {
                covered.add_passes([&old, &new]);
            }
            if !made.varies {
                break;
            }
        }
        if words == 0 && compared.cut > 0 {
            return Err("the loops of the pass run too many iterations to compare".to_owned());
        }
        if words == 0 {
            return Err("the pass writes no buffer or texture that Karat could compare".to_owned());
        }
        compared.violations = brought.told(!paths.is_empty());
        compared.mended = mended.told(!paths.is_empty() || !compared.violations.is_empty());
        if paths.is_empty() && compared.violations.is_empty() {
            if let Some(reason) = unwatched {
                return Err(reason);
            }
            compared.uncovered = covered.uncovered(&compared.location);
        }
        let each = words / self.paths.len().max(1);
        paths.iter_mut().for_each(|path| path.cases.1 = each);
        Ok(match paths.is_empty() {
            true => Change::Same { cases: each },
            false => Change::Changed { paths },
        })
    }
}

impl Request {
    /// Runs the pixels of a fragment function that writes memory, before and after the edit. Returns the violations
    /// that the edit adds, and the violations that the edit removes.
    pub(super) fn brought_to_pixels(
        &self,
        name: &str,
        renamed: &[(String, String)],
    ) -> Result<(Vec<Violation>, Vec<Violation>), String> {
        let ranges = self.ranges()?;
        let (mut brought, mut mended) = (Brought::default(), Brought::default());
        let mut unwatched = None;
        for content in Content::OF_PASSES {
            let of = |package| passes::of_pixels(package, name, false, &ranges, (content, None));
            let ((old, _), (new, made)) = (of(&self.before)?, of(&self.after)?);
            let (old, new) = (examine_made_up(&old), examine_made_up(&new));
            let is_whole = watched(&old, &new, &mut unwatched);
            brought.add(content, [&old, &new], renamed);
            if is_whole {
                mended.add(content, [&new, &old], renamed);
            }
            if !made.varies {
                break;
            }
        }
        let (brought, mended) = (brought.told(false), mended.told(false));
        match unwatched {
            Some(reason) if brought.is_empty() => Err(reason),
            _ => Ok((brought, mended)),
        }
    }
}

/// Checks if the sanitizer could watch both versions. If the sanitizer could watch only the original, violations that
/// the edit adds may be missing. In this case, this function writes the reason into `unwatched`, and the comparison
/// reports the reason if nothing else shows the edit.
fn watched(before: &Examined, after: &Examined, unwatched: &mut Option<String>) -> bool {
    let [was, is] = [before, after].map(|side| side.watched.reason.as_str());
    if was.is_empty() && !is.is_empty() {
        unwatched.get_or_insert(format!(
            "after the edit, the sanitizer can't watch the invocations of the pass: {is}"
        ));
    }
    was.is_empty() && is.is_empty()
}

/// The properties that identify a violation in both versions: its kind, and the name of its variable after the edit.
/// For a wrong index, the violation's headline replaces the name, because such a violation has no variable.
fn subject(one: &Violation, renamed: &[(String, String)]) -> (Kind, String) {
    let quoted = |path: &str| format!("`{}`", path.rsplit("::").next().unwrap_or(path));
    let text = match one.kind.is_of_index() {
        true => one.headline.clone(),
        false => quoted(&one.variable),
    };
    let new_name =
        |text: String, (was, is): &(String, String)| text.replace(&quoted(was), &quoted(is));
    (one.kind, renamed.iter().fold(text, new_name))
}

/// The violations that only one version has. For each kind and variable, only the first violation is kept.
#[derive(Default)]
struct Brought {
    sure: Vec<Violation>,
    /// All indices outside of arrays, even if they are outside only for sizes or numbers that a host is unlikely to
    /// use. Such an index can show that the edit removed a guard.
    of_indices: Vec<Violation>,
}

impl Brought {
    /// Adds the violations that occur in the second version, but not in the first version, over one content (set of
    /// generated values). `renamed` has the resources that the edit renamed.
    fn add(&mut self, content: Content, [old, new]: [&Examined; 2], renamed: &[(String, String)]) {
        let subject = |one: &Violation| subject(one, renamed);
        for (one, _) in &new.violations {
            if old.violations.iter().any(|(known, _)| subject(known) == subject(one)) {
                continue;
            }
            // If the sizes of resources are independent, an index may be outside of an array in only one version by
            // chance.
            let is_sure = content.is_sized || !one.kind.is_of_index();
            if content.is_likely && is_sure {
                add_kind(&mut self.sure, one);
            }
            if one.kind.is_of_index() {
                add_kind(&mut self.of_indices, one);
            }
        }
    }

    /// The violations to report. If something else shows the edit, leaves out indices that are outside only for sizes
    /// or numbers that a host is unlikely to use.
    fn told(self, is_changed: bool) -> Vec<Violation> {
        if self.sure.is_empty() && !is_changed { self.of_indices } else { self.sure }
    }
}

fn add_kind(all: &mut Vec<Violation>, one: &Violation) {
    if all.iter().all(|known| subject(known, &[]) != subject(one, &[])) {
        all.push(one.clone());
    }
}

/// Searches for an order of invocations in which the edit changes the results, and returns the change; `None` if no
/// tested order shows a change. An order counts only if the original pass has its usual results in this order.
fn ordered(
    (old, new): (&Passes, &Passes),
    renamed: &[(String, String)],
    members: &[(String, String)],
) -> Result<Option<PathChange>, String> {
    let left = |passes: &Passes, order: Option<&OrderOf>| {
        in_order_of(passes, order).map_err(|error| error.to_string())
    };
    let usual = left(old, None)?;
    for run in Runner::new(new).few(ORDERS) {
        let Some(order) = run.order else { continue };
        // If the original already depended on this order, or didn't end in it, the edit isn't the cause.
        let was = left(old, Some(&order)).ok().filter(|was| *was == usual);
        let (Some(was), Some(is)) = (was, run.left) else { continue };
        let path = format!("{}, in another order", Path::CPU);
        let difference = Difference::of((old, was), (new, is), renamed)?;
        if let Some(change) = difference.change(path, members) {
            return Ok(Some(change));
        }
    }
    Ok(None)
}

const WRITTEN: &str = "a pass writes the resource";

#[derive(Default)]
struct Difference {
    words: usize,
    changed: usize,
    largest: Largest,
    /// For each resource, the element that shows the resource's change most clearly.
    firsts: Vec<(Clarity, WordChange)>,
}

impl Difference {
    fn of(
        (old, was): (&Passes, karat::unstable::dispatch::Afterwards),
        (new, is): (&Passes, karat::unstable::dispatch::Afterwards),
        renamed: &[(String, String)],
    ) -> Result<Self, String> {
        let mut all = Self::default();
        for (number, words) in &is {
            let name = &new.resources[*number].name;
            let text = |error: &dyn std::fmt::Display| error.to_string();
            let (_, shape) = new.written(name).map_err(|error| text(&error))?;
            let lanes = new.lanes(*number, words).expect(WRITTEN);
            let short = name.rsplit("::").next().unwrap_or(name);
            let known = renamed.iter().find(|(_, is)| is == name).map_or(name, |(was, _)| was);
            // A resource that a pass doesn't write keeps its contents.
            let (old_shape, before) = match old.written(known) {
                Ok((part, shape)) => {
                    let words = was.iter().find(|(known, _)| *known == part.number);
                    (shape, words.and_then(|(number, words)| old.lanes(*number, words)))
                }
                Err(_) => match old.content(known) {
                    Ok((_, shape, lanes)) => (shape, Some(lanes)),
                    Err(_) => {
                        return Err(format!(
                            "the pass writes `{short}`, which it didn't use before the edit"
                        ));
                    }
                },
            };
            // A structure with only an array counts as the array.
            let (is, was) = (shape.lanes(), old_shape.lanes());
            if is.len() != was.len() {
                return Err(format!(
                    "`{short}` has {} numbers after the edit, and had {} before",
                    is.len(),
                    was.len()
                ));
            }
            if is != was {
                return Err(format!(
                    "`{short}` is {shape} after the edit, and was {old_shape} before"
                ));
            }
            let (scalars, names) = (shape.lanes(), shape.lane_names());
            let mut first: Option<(Clarity, WordChange)> = None;
            for (lane, (was, is)) in before.expect(WRITTEN).iter().zip(&lanes).enumerate() {
                all.words += 1;
                if all.largest.add(scalars[lane], *was, *is).is_none() {
                    continue;
                }
                all.changed += 1;
                let clear = clarity(scalars[lane], *was, *is).unwrap_or_default();
                if first.as_ref().is_some_and(|(known, _)| *known >= clear) {
                    continue;
                }
                let shown = |word: u32| format_lane(scalars[lane], word);
                let channels = match &shape {
                    Shape::Array { element, .. } => element.lane_names(),
                    _ => vec![String::new()],
                };
                let of_texel = |texel: String| texel + &channels[lane % channels.len()];
                let place = new
                    .texel(*number, lane / channels.len())
                    .map_or_else(|| names[lane].clone(), of_texel);
                let (resource, after) = (short.to_owned(), shown(*is));
                let before = format!("{short}{place} = {}", shown(*was));
                first = Some((clear, WordChange { resource, before, after }));
            }
            all.firsts.extend(first);
        }
        for (number, _) in &was {
            let name = &old.resources[*number].name;
            let known = renamed.iter().find(|(was, _)| was == name).map_or(name, |(_, is)| is);
            if new.written(known).is_err() {
                let short = name.rsplit("::").next().unwrap_or(name);
                return Err(format!("the pass no longer writes `{short}`"));
            }
        }
        Ok(all)
    }

    /// The change on a path, together with the values of buffer members; `None` if no result changed.
    fn change(self, path: String, members: &[(String, String)]) -> Option<PathChange> {
        let (clarity, first) = self.firsts.first()?.clone();
        let Largest { ulp, relative } = self.largest;
        Some(PathChange {
            path,
            cases: (self.changed, self.words),
            ulp,
            relative,
            arguments: members.to_vec(),
            given: Vec::new(),
            before: first.before,
            after: first.after,
            clarity,
            words: self.firsts.into_iter().map(|(_, word)| word).collect(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Change, Request};
    use super::Kind;
    use karat::package::Package;

    const COUNTS: &str = "@group(0) @binding(0) var<storage, read> data: array<u32>;
        @group(0) @binding(1) var<storage, read_write> bins: array<atomic<u32>, 16>;
        var<workgroup> own: array<atomic<u32>, 16>;
        @compute @workgroup_size(64) fn count(@builtin(global_invocation_id) g: vec3u,
            @builtin(local_invocation_index) i: u32) {
            if i < 16u { atomicStore(&own[i], 0u); }
            workgroupBarrier();
            if g.x < arrayLength(&data) { atomicAdd(&own[data[g.x] % 16u], 1u); }
            workgroupBarrier();
            if i < 16u { atomicAdd(&bins[i], atomicLoad(&own[i])); }
        }";

    /// The comparison reports a race between pixels that write the same element, although the edit changes the colour
    /// of no pixel.
    #[test]
    fn a_new_race_between_pixels_is_reported() {
        let text = "@group(0) @binding(0) var<storage, read_write> count: atomic<u32>;
            @group(0) @binding(1) var<storage, read_write> list: array<u32>;
            @fragment fn collect(@builtin(position) at: vec4f) -> @location(0) vec4f {
                let place = atomicAdd(&count, 1u);
                if place < arrayLength(&list) { list[place] = u32(at.x); }
                return vec4f(1.0);
            }";
        let package = |text: &str| Package::from_source("collect", text.to_owned());
        let compared = |before: &str, after: &str| {
            let mut all = Request::new(package(before), package(after)).run().expect("compared");
            all.pop().expect("the fragment function")
        };
        for first in ["", "if at.x < fwidth(at.x) { discard; }"] {
            let text = text.replace("let place", &format!("{first} let place"));
            let load = "atomicLoad(&count); atomicAdd(&count, 1u);";
            let edited = text.replace("atomicAdd(&count, 1u);", load);
            let one = compared(&text, &edited);
            assert!(matches!(one.change, Change::Same { .. }), "{one:?}");
            let [race, ..] = &one.violations[..] else { panic!("{one:?}") };
            assert_eq!((race.variable.as_str(), race.kind), ("list", Kind::Race));
            assert!(
                compared(&edited, &text).violations.is_empty(),
                "an edit that fixes the race brings no violation"
            );
        }
    }

    /// The comparison reports a race that occurs with only one generated content of the buffer `place`. In this
    /// content, two elements are equal, so two invocations write the same element of `list`.
    #[test]
    fn a_violation_with_one_content_is_reported() {
        let pass = "@group(0) @binding(0) var<storage, read> place: array<u32>;
            @group(0) @binding(1) var<storage, read_write> list: array<u32>;
            @compute @workgroup_size(64) fn put(@builtin(global_invocation_id) g: vec3u) {
                let k = g.x;
                if k < arrayLength(&list) { list[k] = k; }
            }";
        let pixels = "@group(0) @binding(0) var<storage, read> place: array<u32>;
            @group(0) @binding(1) var<storage, read_write> list: array<u32>;
            @group(0) @binding(2) var<uniform> width: u32;
            @fragment fn put(@builtin(position) at: vec4f) -> @location(0) vec4f {
                let k = u32(at.y) * width + u32(at.x);
                if k < arrayLength(&list) { list[k] = k; }
                return vec4f(1.0);
            }";
        for text in [pass, pixels] {
            let edited = text.replace("list[k] = k", "list[place[k]] = k");
            let of = |before: &str, after: &str| {
                let [before, after] = [before, after].map(|text| Package::from_source("m", text));
                let mut all = Request::new(before, after).run().expect("compared");
                all.pop().expect("one entry point").violations
            };
            let brought = of(text, &edited);
            let [race] = &brought[..] else { panic!("{brought:?}") };
            assert_eq!((race.variable.as_str(), race.kind), ("list", Kind::Race));
            assert!(
                of(&edited, text).is_empty(),
                "an edit that fixes the race brings no violation"
            );
        }
    }

    /// If only one version writes a resource, Karat gives no verdict. The reason names the resource.
    #[test]
    fn a_resource_that_only_one_side_writes_is_reported() {
        let text = "@group(0) @binding(0) var<storage, read_write> a: array<u32>;
            @group(0) @binding(1) var<storage, read_write> b: array<u32>;
            @compute @workgroup_size(64) fn f(@builtin(global_invocation_id) g: vec3u) {
                a[g.x] = g.x;
                b[g.x] = 1u;
            }";
        let reason = |before: &str, after: &str| {
            let [before, after] = [before, after].map(|text| Package::from_source("p", text));
            let all = Request::new(before, after).run().expect("compared");
            let Change::Unjudged { reason } = &all[0].change else { panic!("{all:?}") };
            reason.clone()
        };
        let without = text.replace("b[g.x] = 1u;", "");
        assert_eq!(reason(text, &without), "the pass no longer writes `b`");
        assert_eq!(
            reason(&without, text),
            "the pass writes `b`, which it didn't use before the edit"
        );
        let reads = text.replace("var<storage, read_write> b", "var<storage, read> b");
        let reads = reads.replace("b[g.x] = 1u;", "").replace("= g.x;", "= g.x + 0u * b[0];");
        assert_eq!(reason(text, &reads), "the pass no longer writes `b`");
    }

    fn compared(before: &str, after: &str) -> super::Compared {
        let [before, after] = [before, after].map(|text| Package::from_source("p", text));
        let mut all = Request::new(before, after).run().expect("compared");
        all.pop().expect("the pass")
    }

    /// A renamed resource counts as the same resource. A resource with another type doesn't.
    #[test]
    fn resources_are_compared_by_their_names_and_types() {
        let text = "@group(0) @binding(0) var<storage, read> from_: array<u32>;
            @group(0) @binding(1) var<storage, read_write> to: array<u32>;
            @compute @workgroup_size(64) fn f(@builtin(global_invocation_id) g: vec3u) {
                to[g.x] = from_[g.x];
            }";
        let renamed = text.replace("to: ", "target_: ").replace("to[", "target_[");
        let renamed = renamed.replace("from_", "source");
        let one = compared(text, &renamed);
        assert!(matches!(one.change, Change::Same { .. }) && one.violations.is_empty(), "{one:?}");
        let edited = compared(text, &renamed.replace("= source[g.x]", "= source[g.x] + 1u"));
        assert!(matches!(edited.change, Change::Changed { .. }), "{edited:?}");
        let typed = text.replace("to: array<u32>", "to: array<i32>");
        let typed = compared(text, &typed.replace("= from_[g.x]", "= i32(from_[g.x])"));
        let Change::Unjudged { reason } = &typed.change else { panic!("{typed:?}") };
        assert!(
            reason.starts_with("`to` is array<i32") && reason.contains("was array<u32"),
            "{reason}"
        );
    }

    /// If a loop of a pass is endless before or after the edit, the comparison reports this and has no verdict.
    #[test]
    fn a_loop_that_becomes_endless_is_reported() {
        let text = "@group(0) @binding(0) var<storage, read_write> d: array<u32>;
            @compute @workgroup_size(4) fn f(@builtin(global_invocation_id) g: vec3u) {
                var sum = 0u;
                for (var k = 0u; k < 4u; k += 1u) { sum += k; }
                if g.x < arrayLength(&d) { d[g.x] = sum; }
            }";
        let endless = text.replace("k += 1u", "k += 0u");
        for (before, after, expected) in [
            (
                text,
                &*endless,
                "after the edit, one of the pass's loops runs too many iterations to compare, or doesn't end",
            ),
            (&endless, text, "the loops of the pass run too many iterations to compare"),
        ] {
            let one = compared(before, after);
            let Change::Unjudged { reason } = &one.change else { panic!("{one:?}") };
            assert_eq!(reason, expected);
        }
    }

    const GATHER: &str = "@group(0) @binding(0) var<storage, read> column: array<u32>;
            @group(0) @binding(1) var<storage, read> x: array<f32>;
            @group(0) @binding(2) var<storage, read_write> y: array<f32>;
            @compute @workgroup_size(8) fn gather(@builtin(global_invocation_id) id: vec3u) {
                if id.x >= arrayLength(&y) { return; }
                y[id.x] = x[min(column[id.x], arrayLength(&x) - 1u)];
            }";

    /// An index may be outside of an array only for numbers that a host is unlikely to use. Karat reports such an index
    /// only if nothing else shows the edit.
    #[test]
    fn findings_with_arbitrary_numbers_come_last() {
        let text = GATHER;
        let bare = text.replace("min(column[id.x], arrayLength(&x) - 1u)", "column[id.x]");
        assert_eq!(compared(text, &bare).violations.len(), 1);
        let changed = compared(text, &bare.replace("= x[", "= 2.0 * x["));
        assert!(matches!(changed.change, Change::Changed { .. }), "{changed:?}");
        assert!(changed.violations.is_empty(), "{changed:?}");
    }

    #[test]
    fn each_changed_resource_is_reported() {
        let text = "@group(0) @binding(0) var<storage, read_write> a: array<u32>;
            @group(0) @binding(1) var<storage, read_write> b: array<vec2f>;
            @compute @workgroup_size(64) fn f(@builtin(global_invocation_id) g: vec3u) {
                a[g.x] = g.x; b[g.x].y = 1.0;
            }";
        let edited = text.replace("= g.x;", "= g.x + 7u;").replace("1.0", "2.0");
        let [before, after] = [text, &edited].map(|text| Package::from_source("p", text));
        let all = Request::new(before, after).run().expect("compared");
        let Change::Changed { paths } = &all[0].change else { panic!("{all:?}") };
        let words: Vec<&str> = paths[0].words.iter().map(|one| &*one.before).collect();
        assert_eq!(words, ["a[0] = 0", "b[0].y = 1"], "{paths:?}");
        assert_eq!(paths[0].before, words[0]);
    }

    /// The comparison reports an edit that removes the guard of an index, although the results are the same for all
    /// valid indices.
    #[test]
    fn a_removed_guard_is_reported() {
        let text = GATHER;
        let brought = |before: &str, after: &str| {
            let [before, after] = [before, after].map(|text| Package::from_source("m", text));
            let all = Request::new(before, after).run().expect("compared");
            all[0].violations.iter().map(|one| one.headline.clone()).collect::<Vec<_>>()
        };
        let bare = text.replace("min(column[id.x], arrayLength(&x) - 1u)", "column[id.x]");
        let reads = brought(text, &bare);
        assert!(reads.len() == 1 && reads[0].contains("reads outside"), "{reads:?}");
        assert!(brought(&bare, text).is_empty());
        // Another index outside of an array doesn't hide the removed guard.
        let both = bare.replace("if id.x >= arrayLength(&y) { return; }", "");
        let writes = brought(&bare, &both);
        assert!(writes.len() == 1 && writes[0].contains("writes outside"), "{writes:?}");
    }

    /// The comparison reports a removed barrier, although results change only in orders other than the usual one.
    /// Atomics don't race, so the sanitizer reports no violation. In the engine's usual order, invocations run in
    /// lockstep, so the counts are right even without the barrier.
    #[test]
    fn a_result_that_becomes_dependent_on_order_is_a_change() {
        let change = |texts: [&str; 2]| {
            let [before, after] = texts.map(|text| Package::from_source("counts", text));
            let all = Request::new(before, after).run().expect("compared");
            let [one] = &all[..] else { panic!("{all:?}") };
            one.change.clone()
        };
        let barrier = "workgroupBarrier();";
        let last = COUNTS.rfind(barrier).expect("`COUNTS` has two barriers");
        let without = format!("{}{}", &COUNTS[..last], &COUNTS[last + barrier.len()..]);
        match change([COUNTS, &without]) {
            Change::Changed { paths } => assert_eq!(paths[0].path, "cpu, in another order"),
            other => panic!("{other:?}"),
        }
        let alike = COUNTS.replace("% 16u", "& 15u");
        assert!(matches!(change([COUNTS, &alike]), Change::Same { .. }));
        // If the edit removes the dependence on the order, the results don't count as changed.
        assert!(matches!(change([&without, COUNTS]), Change::Same { .. }));
    }

    /// The comparison lists edited lines that no invocation reaches. No generated `mode` is 77, so no invocation takes
    /// the branch for 77.
    #[test]
    fn lines_that_no_invocation_reaches_are_listed() {
        let text = "struct P { width: u32, mode: u32 }
            @group(0) @binding(0) var<storage, read_write> d: array<f32>;
            @group(0) @binding(1) var<uniform> p: P;
            @compute @workgroup_size(64) fn f(@builtin(global_invocation_id) g: vec3u) {
                if g.x >= arrayLength(&d) { return; }
                let row = g.x / p.width;
                d[g.x] += 2.0 * f32(row); // a row
                if p.mode == 77u {
                    d[g.x] = 3.0;
                }
            }";
        let compared = |edited: &str| {
            let [before, after] = [text, edited].map(|text| Package::from_source("p", text));
            let mut all = Request::new(before, after).run().expect("compared");
            all.pop().expect("the pass")
        };
        let lines = |one: &super::Compared| {
            one.uncovered.iter().map(|line| line.text.clone()).collect::<Vec<_>>()
        };
        let row = compared(&text.replace("2.0 *", "3.0 *"));
        assert!(matches!(row.change, Change::Changed { .. }), "rows differ: {row:?}");
        let mode = compared(&text.replace("= 3.0;", "= 4.0;"));
        assert!(matches!(mode.change, Change::Same { .. }), "{mode:?}");
        assert_eq!(lines(&mode), ["d[g.x] = 4.0;", "d[g.x] = 3.0;"], "{mode:?}");
        // Removing a line is an edit of this line.
        assert_eq!(lines(&compared(&text.replace("d[g.x] = 3.0;", ""))), ["d[g.x] = 3.0;"]);
        let same = compared(&text.replace("2.0 * f32(row)", "f32(row) * 2.0").replace("a row", ""));
        assert!(matches!(same.change, Change::Same { .. }) && lines(&same).is_empty(), "{same:?}");
    }

    const LIFE: &str = "
        struct Grid { width: u32, height: u32 }
        @group(0) @binding(0) var<uniform> grid: Grid;
        @group(0) @binding(1) var<storage, read> cells: array<u32>;
        @group(0) @binding(2) var<storage, read_write> next: array<u32>;
        fn at(x: u32, y: u32) -> u32 { return cells[(y % grid.height) * grid.width + x % grid.width]; }
        @compute @workgroup_size(64) fn life(@builtin(global_invocation_id) g: vec3u) {
          if g.x >= grid.width * grid.height { return; }
          let x = g.x % grid.width; let y = g.x / grid.width;
          var n = 0u;
          for (var dy = 0u; dy < 3u; dy++) { for (var dx = 0u; dx < 3u; dx++) {
            if dx == 1u && dy == 1u { continue; }
            n += at(x + dx + grid.width - 1u, y + dy + grid.height - 1u);
          } }
          next[g.x] = select(u32(n == 3u), u32(n == 2u || n == 3u), cells[g.x] == 1u);
        }";

    const PAIRS: &str = "
        @group(0) @binding(0) var<storage, read> input: array<u32>;
        @group(0) @binding(1) var<storage, read_write> sums: array<u32>;
        @compute @workgroup_size(64) fn pairs(@builtin(global_invocation_id) g: vec3u, @builtin(workgroup_id) w: vec3u) {
            let first = 2u * g.x;
            if first + 1u >= arrayLength(&input) || g.x >= arrayLength(&sums) { return; }
            sums[g.x] = input[first] + input[first + 1u] + select(0u, 1u, w.x > 0u);
        }";

    const TONEMAP: &str = "
        @group(0) @binding(0) var src: texture_2d<f32>;
        @group(0) @binding(1) var dst: texture_storage_2d<rgba16float, write>;
        @compute @workgroup_size(8, 8) fn tonemap(@builtin(global_invocation_id) g: vec3u) {
          let size = textureDimensions(dst);
          if any(g.xy >= size) { return; }
          let c = max(textureLoad(src, g.xy, 0).rgb, vec3f(0.0));
          textureStore(dst, g.xy, vec4f(c / (1.0 + c), 1.0));
        }";

    const MEDIAN: &str = "
        @group(0) @binding(0) var src: texture_2d<f32>;
        @group(0) @binding(1) var dst: texture_storage_2d<r32float, write>;
        fn at(p: vec2u) -> f32 { return textureLoad(src, min(p, textureDimensions(src) - 1u), 0).r; }
        @compute @workgroup_size(8, 8) fn median(@builtin(global_invocation_id) g: vec3u) {
            let p = g.xy;
            let a = at(p); let b = at(p + vec2u(0u, 1u)); let c = at(p + vec2u(0u, 2u));
            if any(p >= textureDimensions(dst)) { return; }
            textureStore(dst, p, vec4f(max(min(a, b), min(max(a, b), c))));
        }";

    const MAXIMUM: &str = "
        @group(0) @binding(0) var<storage, read> v: array<f32>;
        @group(0) @binding(1) var<storage, read_write> most: array<f32>;
        var<workgroup> t: array<f32, 64>;
        @compute @workgroup_size(64) fn maximum(@builtin(global_invocation_id) g: vec3u,
            @builtin(local_invocation_index) i: u32, @builtin(workgroup_id) w: vec3u) {
            var x = -3.0e38;
            if g.x < arrayLength(&v) { x = v[g.x]; }
            t[i] = x;
            workgroupBarrier();
            for (var s = 32u; s > 0u; s /= 2u) {
                if i < s { t[i] = max(t[i], t[i + s]); }
                workgroupBarrier();
            }
            if i == 0u { most[w.x] = t[0]; }
        }";

    const TICKETS: &str = "
        @group(0) @binding(0) var<storage, read_write> ticket: atomic<u32>;
        @group(0) @binding(1) var<storage, read_write> starts: array<u32>;
        var<workgroup> own: u32;
        @compute @workgroup_size(32) fn starts_of(@builtin(local_invocation_index) i: u32) {
            if i == 0u { own = atomicAdd(&ticket, 1u); }
            let group = workgroupUniformLoad(&own);
            if i == 0u && group < arrayLength(&starts) { starts[group] = group * 32u; }
        }";

    /// Each of these edits changes results only for few inputs, such as some rows of a grid, or a colour below 0.
    #[test]
    fn edits_that_few_inputs_reveal_are_reported() {
        for (text, from, to) in [
            (LIFE, "n == 2u || n == 3u", "n == 2u || n == 4u"),
            (LIFE, "u32(n == 3u),", "u32(n == 2u),"),
            (LIFE, "dy + grid.height - 1u", "dy + grid.height"),
            (LIFE, "let y = g.x / grid.width;", "let y = g.x / grid.height;"),
            (PAIRS, "select(0u, 1u, w.x > 0u)", "0u"),
            (MEDIAN, "max(min(a, b), min(max(a, b), c))", "b"),
            (MAXIMUM, "x = -3.0e38", "x = 0.0"),
            (TICKETS, "group * 32u", "0u"),
            (
                TONEMAP,
                "max(textureLoad(src, g.xy, 0).rgb, vec3f(0.0))",
                "textureLoad(src, g.xy, 0).rgb",
            ),
        ] {
            assert!(text.contains(from), "{from}");
            let edited = text.replace(from, to);
            let [before, after] = [text, &edited].map(|text| Package::from_source("m", text));
            let all = Request::new(before, after).run().expect("compared");
            let pass =
                all.iter().find(|one| one.dispatched.is_some()).expect("the package has a pass");
            assert!(matches!(pass.change, Change::Changed { .. }), "{to}: {pass:?}");
        }
    }

    /// The comparison finds an edit that changes only the last row of a texture. Each workgroup writes one row.
    #[test]
    fn the_last_row_of_a_texture_is_compared() {
        let text = |guard: &str| {
            format!(
                "@group(0) @binding(0) var image: texture_storage_2d<r32float, write>;
                @compute @workgroup_size(64) fn rows(@builtin(workgroup_id) w: vec3u,
                    @builtin(local_invocation_index) i: u32) {{
                    let size = textureDimensions(image);
                    if {guard} >= size.y {{ return; }}
                    for (var x = i; x < size.x; x += 64u) {{ textureStore(image, vec2u(x, w.x), vec4f(f32(x + w.x))); }}
                }}"
            )
        };
        let [before, after] =
            ["w.x", "w.x + 1u"].map(|guard| Package::from_source("rows", text(guard)));
        let all = Request::new(before, after).run().expect("compared");
        let [one] = &all[..] else { panic!("{all:?}") };
        let Change::Changed { paths } = &one.change else { panic!("{one:?}") };
        // The texture's format has one channel.
        assert!(paths[0].before.starts_with("image[0, 1] = "), "{}", paths[0].before);
    }
}
