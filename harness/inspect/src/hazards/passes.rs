//! Finds hazards in compute passes, and in pixels that write storage. The engine runs the passes and the pixels over
//! generated resources.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use karat::package::Package;
use karat::unstable::dispatch::{Passes, Violation};
use karat::unstable::interpret::examine_made_up;
use karat::unstable::interpret::hazards::Kind;
use karat::unstable::interpret::passes::{Operations, operations};
use karat::unstable::reflect::Program;
use karat_core::diagnostic::Diagnostic;

use super::{Class, Hazard, Seen, first_line, one_line, operands, parted};
use crate::limits::{CONTENTS, INPUTS_TRIED, MEMBERS};
use crate::made_up::{Content, Input, Mix, Numbered, Ranges, Resources};

use rayon::prelude::*;

/// The name of the first entry in [`Hazard::arguments`] for a pass. The entry's value is the invocation that goes
/// wrong.
pub(super) const INVOCATION: &str = "invocation";

pub(super) fn look(package: &Package, name: &str, ranges: &Ranges) -> Result<Seen, String> {
    let (program, ..) = Program::of_pass(package, name, &ranges.overrides_of(package, name))?;
    let ranges = &ranges.with_literals(program.literals());
    let make = |content: Content, mix: Option<&Mix<'_>>| {
        let invocations = content.one_workgroup.then_some([1; 3]);
        let of = (content, mix, &Vec::new());
        crate::passes::arbitrary(package, name, invocations, ranges, of)
    };
    Looked { name, make: &make, are_pixels: false }.seen()
}

pub(super) fn look_at_pixels(
    package: &Package,
    name: &str,
    ranges: &Ranges,
) -> Result<Seen, String> {
    let make = |content: Content, mix: Option<&Mix<'_>>| {
        crate::passes::of_pixels(package, name, content.one_workgroup, ranges, (content, mix))
    };
    Looked { name, make: &make, are_pixels: true }.seen()
}

/// Contents (sets of generated values) in which all arrays have only zeros, only ones, or numbers far from each other.
fn plain() -> [Content; 3] {
    [Numbered::Zero, Numbered::One, Numbered::Apart].map(|how| Content::OF_PASSES[0].numbered(how))
}

/// Further contents with which Karat tries to avert a finding: the contents of [`plain`], contents with long arrays,
/// and contents for a dispatch of one workgroup.
fn others() -> Vec<Content> {
    let [first, second, ..] = Content::OF_PASSES;
    let one = [first, first.numbered(Numbered::Apart)].map(Content::of_one_workgroup);
    [&plain()[..], &[first, second].map(Content::long), &one].concat()
}

/// The contents over which Karat runs a pass again to classify a finding. In each run, the declared inputs keep their
/// values from a failing content. The list is short, but its contents are of different kinds.
fn held() -> Vec<Content> {
    let [first, _, third, bits, _, _, _, _, drawn] = Content::OF_PASSES;
    [&[first, third, bits, drawn][..], &plain(), &[first.long(), first.of_one_workgroup()]].concat()
}

/// Checks if an array of the content has fewer elements than the pass has invocations.
fn is_short(content: &Content) -> bool {
    content.tail.is_some() || content.shorter.is_some()
}

type Make<'m> =
    &'m (dyn Fn(Content, Option<&Mix<'_>>) -> Result<(Passes, Resources), String> + Sync);

/// The positions of a finding (a race has two), its kind, and the operation's text. The text is necessary because `1.0
/// / a` begins where `1.0 / a / b` begins.
type Key = (BTreeSet<String>, Kind, String);

#[derive(Debug, Default)]
struct InContent {
    /// The invocations in which each operation goes wrong; empty for races, missed barriers and endless loops.
    wrong: BTreeMap<Key, BTreeSet<usize>>,
    reached: BTreeMap<String, BTreeSet<usize>>,
    is_cut: bool,
    one_workgroup: bool,
}

impl InContent {
    /// Checks if invocations reach all positions of a finding.
    fn is_reached(&self, (places, kind, _): &Key) -> bool {
        let reached = |place: &String| self.reached.get(place).filter(|all| !all.is_empty());
        match kind {
            // A loop has no operation to reach.
            Kind::Endless => true,
            // A race needs two workgroups, unless the host dispatches only one.
            Kind::Race | Kind::EqualWrites => {
                let Some(all) = places.iter().map(reached).collect::<Option<Vec<_>>>() else {
                    return false;
                };
                let all: BTreeSet<_> = all.into_iter().flatten().collect();
                all.len() > 1 || self.one_workgroup
            }
            _ => places.iter().all(|place| reached(place).is_some()),
        }
    }

    /// Checks if the finding occurs over this content. A race also occurs if both invocations write the same value, for
    /// example 0.
    fn is_wrong(&self, key: &Key) -> bool {
        let equal = || (key.0.clone(), Kind::EqualWrites, key.2.clone());
        self.wrong.contains_key(key) || key.1 == Kind::Race && self.wrong.contains_key(&equal())
    }
}

/// Checks if a finding always occurs. Three conditions must hold:
/// - The pass reaches the finding's operation over at least [`CONTENTS`] contents.
/// - The finding occurs over each of these contents.
/// - If the finding lists invocations, at least one invocation goes wrong over each content in which it reaches the
///   operation.
fn is_always<'c>(key: &Key, contents: impl Iterator<Item = &'c InContent> + Clone) -> bool {
    let reaching = || contents.clone().filter(|content| content.is_reached(key));
    let is_enough = reaching().count() >= CONTENTS;
    if !is_enough || !reaching().all(|content| content.is_wrong(key)) {
        return false;
    }
    let invocations = |content: &InContent| content.wrong.get(key).cloned().unwrap_or_default();
    let Some(mut always) = reaching().map(invocations).next() else { return false };
    if always.is_empty() {
        return true;
    }
    for content in reaching() {
        let own = invocations(content);
        let place = key.0.first().and_then(|place| content.reached.get(place));
        always.retain(|one| own.contains(one) || place.is_none_or(|all| !all.contains(one)));
    }
    !always.is_empty()
}

/// A pass, or the pixels of a draw, in which Karat searches for hazards.
struct Looked<'l> {
    name: &'l str,
    make: Make<'l>,
    are_pixels: bool,
}

impl Looked<'_> {
    fn seen(&self) -> Result<Seen, String> {
        let mut seen = Seen::default();
        let mut found: BTreeMap<Key, (Content, Hazard)> = BTreeMap::new();
        let mut contents: BTreeMap<Content, InContent> = BTreeMap::new();
        let mut inputs = Vec::new();
        let mut too_long = false;
        for content in Content::OF_PASSES {
            let (passes, made) = (self.make)(content, None).map_err(|error| first_line(&error))?;
            seen.drawn.merge(made.drawn.clone());
            let one = self.run(&passes, &made);
            if let Some(reason) = &one.reason {
                // A pass with findings counts as checked, even if it didn't run to its end.
                if contents.is_empty() && one.hazards.is_empty() {
                    return Err(reason.clone());
                }
                seen.cut += one.of;
            }
            too_long |= one.too_long;
            for (key, hazard) in one.hazards {
                let kind = hazard.kind;
                let class = hazard.class;
                let known = match found.entry(key) {
                    Entry::Occupied(known) => known.into_mut(),
                    Entry::Vacant(place) => place.insert((content, hazard.clone())),
                };
                // A content that shows the wrong value is worse than a content that drops it.
                if known.1.class == Class::Dropped && class != Class::Dropped {
                    let kinds = std::mem::take(&mut known.1.kinds);
                    *known = (content, Hazard { kinds, ..hazard });
                }
                if known.1.kind != kind && !known.1.kinds.contains(&kind) {
                    known.1.kinds.push(kind);
                }
            }
            contents.insert(content, one.content);
            // In a draw, each content has other texture coordinates, so its runs differ even without resources.
            let varies = made.varies;
            inputs = made.inputs;
            // Other contents would take as much time.
            if !varies || too_long {
                break;
            }
        }
        for (place, invocations) in contents.values().flat_map(|one| &one.reached) {
            *seen.reached.entry(place.clone()).or_default() += invocations.len();
        }
        // A race of different writes covers equal writes at the same positions.
        let races: BTreeSet<_> = found
            .keys()
            .filter(|(_, kind, _)| *kind == Kind::Race)
            .map(|(at, ..)| at.clone())
            .collect();
        found.retain(|(at, kind, _), _| *kind != Kind::EqualWrites || !races.contains(at));
        if !found.is_empty() && !too_long && !inputs.is_empty() {
            self.add(&mut contents, others(), None);
        }
        let only_one = contents.len() == 1;
        let is_known = inputs.iter().any(|input| input.known);
        let mut again: BTreeMap<Content, BTreeMap<Content, InContent>> = BTreeMap::new();
        let mut varied: BTreeMap<Content, Vec<(String, Vec<InContent>)>> = BTreeMap::new();
        for (key, (content, mut hazard)) in found {
            let takes = |input: &Input| input.known;
            let mix = Mix { content, extents: None, takes: &takes };
            let is_fault = match key.1 {
                // WGSL requires uniform control flow for all data (15.2).
                Kind::Barrier => true,
                Kind::LostDigits | Kind::Unbounded => false,
                _ if only_one && !too_long => true,
                _ if is_always(&key, contents.values()) => true,
                _ if !is_known || too_long => false,
                _ => {
                    let again = again.entry(content).or_insert_with(|| {
                        let mut again = BTreeMap::new();
                        self.add(&mut again, held(), Some(&mix));
                        again
                    });
                    is_always(&key, again.values())
                }
            };
            let wrong_in: Vec<Content> = contents
                .iter()
                .filter(|(_, one)| one.is_wrong(&key))
                .map(|(content, _)| *content)
                .collect();
            if hazard.class != Class::Dropped {
                hazard.class = if is_fault { Class::Fault } else { Class::Requirement };
            }
            if hazard.class == Class::Requirement && !too_long {
                let is_index = matches!(hazard.kind, Kind::OutOfRange | Kind::Wrapped);
                let averted = |one: &InContent| one.is_reached(&key) && !one.is_wrong(&key);
                let named = inputs.iter().any(|one| one.path == variable_of(&hazard.text));
                let length = match named {
                    true => format!("length({})", variable_of(&hazard.text)),
                    false => SIZES.to_owned(),
                };
                if is_index && wrong_in.iter().all(is_short) {
                    if wrong_in.iter().any(|one| one.tail.is_some()) && !self.are_pixels {
                        let tail =
                            "where the number of elements isn't a multiple of the workgroup size";
                        hazard.fails = Some(tail.to_owned());
                    }
                    hazard.needs = vec![length];
                } else {
                    let varied =
                        varied.entry(content).or_insert_with(|| match contents[&content].is_cut {
                            // A stopped run proves nothing about positions that it doesn't reach, and takes the
                            // longest.
                            true => Vec::new(),
                            false => self.varied(content, &inputs),
                        });
                    let named = varied.iter().filter(|(_, runs)| runs.iter().any(averted));
                    hazard.needs = named.map(|(path, _)| path.clone()).collect();
                    if hazard.needs.is_empty() {
                        // If a content averts a wrong index, another length of the array may be the reason.
                        let mut others =
                            contents.iter().filter(|(one, _)| is_index || is_short(one));
                        if others.any(|(_, one)| averted(one)) {
                            hazard.needs.push(if is_index { length } else { SIZES.to_owned() });
                        }
                    }
                }
            }
            let reaching = contents.values().filter(|one| one.is_reached(&key)).count();
            hazard.cases = (wrong_in.len(), reaching.max(wrong_in.len()));
            seen.hazards.push(hazard);
        }
        Ok(seen)
    }

    /// Runs the pass over each content in `more`, and adds the results to `contents`.
    fn add(
        &self,
        contents: &mut BTreeMap<Content, InContent>,
        more: Vec<Content>,
        mix: Option<&Mix<'_>>,
    ) {
        for content in more {
            if let Ok((passes, made)) = (self.make)(content, mix) {
                contents.insert(content, self.run(&passes, &made).content);
            }
        }
    }

    /// For each free input, runs the pass again with other values of this input, and the old values of all other
    /// inputs.
    fn varied(&self, content: Content, inputs: &[Input]) -> Vec<(String, Vec<InContent>)> {
        let paths: BTreeSet<&str> =
            inputs.iter().filter(|one| !one.known).map(|one| one.path.as_str()).collect();
        let paths: Vec<&str> = paths.into_iter().take(INPUTS_TRIED).collect();
        let of = |path: &str| {
            let takes = |input: &Input| input.path == path;
            let [first, _, third, .., drawn] = Content::OF_PASSES;
            let others = plain().into_iter().chain([first, third, drawn]);
            let run = |other: Content| {
                let mix = Mix { content: other, extents: None, takes: &takes };
                let (passes, made) = (self.make)(content, Some(&mix)).ok()?;
                Some(self.run(&passes, &made).content)
            };
            others.filter_map(run).collect()
        };
        let mut all: Vec<_> =
            paths.into_par_iter().map(|path| (path.to_owned(), of(path))).collect();
        let one = content.of_one_workgroup();
        if let Ok((passes, made)) = (self.make)(one, None) {
            all.push((WORKGROUPS.to_owned(), vec![self.run(&passes, &made).content]));
        }
        all
    }

    /// Runs a pass once, and collects its findings.
    fn run(&self, passes: &Passes, made: &Resources) -> Ran {
        let examined = examine_made_up(passes);
        let watched = examined.watched;
        let of = usize::try_from(watched.of).unwrap_or(usize::MAX);
        let inside = operations(passes).map_err(|error| first_line(&error.to_string()));
        let mut ran = Ran { of, too_long: examined.too_long, ..Ran::default() };
        ran.reason = Some(watched.reason).filter(|reason| !reason.is_empty());
        let described = |invocation: String| {
            let invocation = (INVOCATION.to_owned(), invocation);
            let members = made.members.iter().take(MEMBERS).cloned();
            std::iter::once(invocation).chain(members).collect::<Vec<_>>()
        };
        let hazard = |kind, location, text, invocation: String| Hazard {
            class: Class::Requirement,
            kind,
            kinds: Vec::new(),
            location,
            text,
            function: self.name.to_owned(),
            arguments: described(invocation),
            cases: (0, 0),
            needs: Vec::new(),
            fails: None,
            values: None,
            operands: Vec::new(),
            accepted: None,
            also: Vec::new(),
            violation: None,
        };
        let Operations { wrong, reached } = match inside {
            Ok(inside) => inside,
            Err(reason) => {
                ran.reason.get_or_insert(reason);
                Operations::default()
            }
        };
        ran.content.reached = reached;
        ran.content.is_cut = ran.reason.is_some();
        // A draw has several pixels, even in one workgroup.
        let is_one = passes.passes.iter().all(|pass| pass.workgroups == [1; 3]);
        ran.content.one_workgroup = is_one && !self.are_pixels;
        for one in wrong {
            let location = one.found.span.to_string();
            let kind = one.found.kind;
            // The sanitizer reports those indices that matter.
            if matches!(kind, Kind::OutOfRange | Kind::Wrapped) {
                for place in one.statement.into_iter().chain([location]) {
                    let key = (BTreeSet::from([place]), kind, String::new());
                    ran.content.wrong.entry(key).or_default().extend(&one.invocations);
                }
                continue;
            }
            let text = one_line(&one.found.text);
            let of_text = text.clone();
            // NaN and infinity are two kinds of the same finding.
            let family = if kind == Kind::Infinite { Kind::Nan } else { kind };
            let own = Hazard {
                class: if one.found.hidden { Class::Dropped } else { Class::Requirement },
                operands: operands(&one.found),
                violation: parted(self.name, &one.found),
                ..hazard(kind, location.clone(), text, one.invocation)
            };
            let key = (BTreeSet::from([location]), family, of_text);
            if own.class != Class::Dropped {
                ran.content.wrong.entry(key.clone()).or_default().extend(one.invocations);
            }
            ran.hazards.push((key, own));
        }
        for (violation, diagnostic) in examined.violations {
            let kind = violation.kind;
            // Unwritten workgroup memory is zero (WGSL 7.3), so reading it isn't a finding.
            if kind == Kind::Unwritten {
                continue;
            }
            let (location, text) = place_of(&violation, &diagnostic);
            let first = violation.accesses.first().map(|access| access.invocation.clone());
            let places = match kind {
                Kind::Race | Kind::EqualWrites => {
                    violation.accesses.iter().map(|access| access.place.clone()).collect()
                }
                _ => BTreeSet::from([location.clone()]),
            };
            let own = hazard(kind, location, text, first.unwrap_or_default());
            let key = (places, kind, String::new());
            ran.content.wrong.entry(key.clone()).or_default();
            ran.hazards.push((key, Hazard { violation: Some(violation), ..own }));
        }
        if let Some(diagnostic) = examined.endless {
            let place = diagnostic.location();
            let text = place.and_then(|at| at.file.text.get(at.range.clone())).unwrap_or_default();
            let location = place.map_or_else(String::new, ToString::to_string);
            let key = (BTreeSet::from([location.clone()]), Kind::Endless, String::new());
            ran.content.reached.entry(location.clone()).or_default().insert(0);
            ran.content.wrong.insert(key.clone(), BTreeSet::new());
            ran.hazards
                .push((key, hazard(Kind::Endless, location, one_line(text), "unknown".to_owned())));
        }
        ran
    }
}

/// An entry of [`Hazard::needs`] for a pass: the finding disappears with another number of workgroups.
const WORKGROUPS: &str = "another number of workgroups";
const SIZES: &str = "other sizes of arrays and textures";

/// The variable at the start of an access: `tile` in `tile[i].sum = 1.0`.
fn variable_of(text: &str) -> &str {
    text.split(|c: char| c != '_' && !c.is_alphanumeric()).next().unwrap_or_default()
}

#[derive(Default)]
struct Ran {
    hazards: Vec<(Key, Hazard)>,
    content: InContent,
    reason: Option<String>,
    of: usize,
    too_long: bool,
}

fn place_of(violation: &Violation, diagnostic: &Diagnostic) -> (String, String) {
    match diagnostic.location() {
        Some(span) => {
            let text = span.file.text.get(span.range.clone()).unwrap_or_default();
            (span.to_string(), one_line(text))
        }
        None => {
            let place = violation.accesses.first().map(|access| access.place.clone());
            (place.unwrap_or_default(), violation.headline.clone())
        }
    }
}
