//! Hazards of compute passes, and of the pixels of a draw that write storage, which the engine dispatches over made-up resources.

use std::collections::{BTreeMap, BTreeSet};

use super::{Hazard, MEMBERS, Seen, first_line, one_line, operands, parted};
use crate::diagnostic::Diagnostic;
use crate::dispatch::{Passes, Violation, ViolationKind};
use crate::interpret::examine_made_up;
use crate::interpret::hazards::Kind;
use crate::interpret::passes::{FoundInPass, hazards_made_up};
use crate::made_up::{Extents, Ranges, Resources};
use crate::package::Package;

/// The first argument of a hazard in a pass.
pub(super) const INVOCATION: &str = "invocation";

/// Contents in which a race is about one element and the same, so that no content makes its index.
const SEVERAL: usize = 3;

/// Looks for hazards in a compute pass. Findings over draws alone are guessed: indices in buffers and sizes have
/// meanings that no name tells.
pub(super) fn look(package: &Package, name: &str, ranges: &Ranges) -> Result<Seen, String> {
    look_at(name, &|invocations, variant| {
        Passes::arbitrary(package, name, invocations, ranges, (variant, &Vec::new()))
    })
}

/// Looks for hazards in a fragment function that writes what other pixels see.
pub(super) fn look_at_pixels(
    package: &Package,
    name: &str,
    ranges: &Ranges,
) -> Result<Seen, String> {
    look_at(name, &|invocations, variant| {
        Passes::of_pixels(package, name, invocations.is_some(), ranges, variant)
    })
}

/// Makes passes over a variant of what is made up: so many invocations in each direction, or as many as are usual.
type Make<'m> = &'m dyn Fn(Option<[u32; 3]>, usize) -> Result<(Passes, Resources), String>;

fn look_at(name: &str, make: Make<'_>) -> Result<Seen, String> {
    let mut seen = Seen::default();
    let mut found: BTreeMap<(String, Kind), Hazard> = BTreeMap::new();
    let mut rare: BTreeMap<(String, Kind), Hazard> = BTreeMap::new();
    // Of a race the only element that it is about, and in how many contents; `None` if that follows from them.
    let mut alone: BTreeMap<(String, Kind), Option<(String, usize)>> = BTreeMap::new();
    // A loop that ends over zeros may wait for what a host writes first, as for a lock that is free.
    let mut surely_endless = false;
    // Contents that were tried, and those in which a float isn't finite, by its place.
    let (mut contents, mut wrong_in) = (0, BTreeMap::<(String, Kind), BTreeSet<usize>>::new());
    for variant in 0..Extents::VARIANTS {
        let (passes, made) = make(None, variant).map_err(|error| first_line(&error))?;
        seen.drawn.merge(made.drawn);
        let examined = examine_made_up(&passes);
        let watched = examined.watched;
        let of = usize::try_from(watched.of).unwrap_or(usize::MAX);
        let reason = Some(watched.reason).filter(|reason| !reason.is_empty());
        let inside = match &reason {
            None => hazards_made_up(&passes).map_err(|error| first_line(&error.to_string())),
            Some(reason) => Err(reason.clone()),
        };
        // A violation that zeros have, too, comes from no content that is made up. A race between two workgroups says nothing
        // of one within a workgroup: buffers that are too small for a look-back make the one, and contents the other.
        let mut surely = BTreeSet::new();
        if (!examined.violations.is_empty() || examined.endless.is_some())
            && let Ok((passes, _)) = make(None, variant + Extents::ZEROS)
        {
            let zeros = examine_made_up(&passes);
            surely_endless |= zeros.endless.is_some();
            for (one, at) in zeros.violations {
                let (place, kind) = (place_of(&one, &at).0, kind_of(one.kind));
                // Of zeros two writes are of the same value, and no less a race of others.
                if kind == Kind::EqualWrites {
                    surely.insert((place.clone(), Kind::Race, one.one_workgroup));
                }
                surely.insert((place, kind, one.one_workgroup));
            }
        }
        // Two workgroups that write where buffers say meet by chance, unless they meet in numbers that are far from each other.
        let mut apart = None;
        let are_writes = |one: &Violation| {
            !one.one_workgroup
                && matches!(one.kind, ViolationKind::WriteWrite | ViolationKind::EqualWrites)
        };
        if examined.violations.iter().any(|(one, _)| are_writes(one))
            && let Ok((passes, _)) = make(None, variant + Extents::APART)
        {
            let all = examine_made_up(&passes).violations.into_iter();
            let writes = all.filter(|(one, _)| are_writes(one));
            apart = Some(writes.map(|(one, at)| place_of(&one, &at).0).collect::<BTreeSet<_>>());
        }
        // Of an array with a length a host dispatches as many invocations as fit, and maybe a single workgroup.
        let mut of_one_workgroup = BTreeSet::new();
        let beyond = examined.violations.iter().filter(|(one, _)| one.of_fixed_length);
        let beyond: BTreeSet<String> =
            beyond.map(|(one, at)| variable_of(&place_of(one, at).1).to_owned()).collect();
        if !beyond.is_empty()
            && let Ok((passes, _)) = make(Some([1; 3]), variant)
        {
            let all = examine_made_up(&passes).violations.into_iter();
            of_one_workgroup.extend(all.map(|(one, at)| place_of(&one, &at).0));
        }
        let members = made.members.iter().take(MEMBERS).cloned();
        let described = |invocation: String| {
            let invocation = (INVOCATION.to_owned(), invocation);
            [invocation].into_iter().chain(members.clone()).collect::<Vec<_>>()
        };
        let of_pass = |kind, location, text| Hazard {
            kind,
            location,
            text,
            function: name.to_owned(),
            arguments: Vec::new(),
            cases: (0, of),
            hidden: false,
            values: None,
            operands: Vec::new(),
            guessed: variant > 0,
            extreme: false,
            idiom: None,
            by_contents: BTreeSet::new(),
            of_made_up_size: false,
            at_tail: false,
            accepted: None,
            lowered: None,
            also: Vec::new(),
            violation: None,
        };
        let violations = examined.violations.into_iter().map(|(violation, diagnostic)| {
            let (location, text) = place_of(&violation, &diagnostic);
            let first = violation.accesses.first().map(|access| access.invocation.clone());
            let count = usize::try_from(violation.count).unwrap_or(usize::MAX).min(of);
            Hazard {
                arguments: described(first.unwrap_or_default()),
                cases: (count, of),
                violation: Some(violation.clone()),
                ..of_pass(kind_of(violation.kind), location, text)
            }
        });
        let inside_found =
            inside.iter().flatten().map(|FoundInPass { found, invocation, count }| Hazard {
                arguments: described(invocation.clone()),
                cases: ((*count).min(of), of),
                hidden: found.hidden,
                idiom: found.idiom,
                operands: operands(found),
                violation: parted(name, found),
                ..of_pass(found.kind, found.span.to_string(), one_line(&found.text))
            });
        let endless = examined.endless.iter().map(|diagnostic| {
            let place = diagnostic.location();
            let text = place.and_then(|at| at.file.text.get(at.range.clone())).unwrap_or_default();
            let location = place.map_or_else(String::new, ToString::to_string);
            Hazard {
                arguments: described("unknown".to_owned()),
                cases: (1, of),
                ..of_pass(Kind::Endless, location, one_line(text))
            }
        });
        contents += 1;
        for found in inside.iter().flatten().map(|one| &one.found) {
            wrong_in.entry((found.span.to_string(), found.kind)).or_default().insert(variant);
        }
        for hazard in violations.chain(inside_found).chain(endless) {
            // No name tells how large a texture is beside another one, or how many words an element has.
            let by_size = hazard.violation.as_ref().is_some_and(|one| one.by_size);
            let in_workgroup = hazard.violation.as_ref().is_some_and(|one| one.in_workgroup);
            let one_workgroup = hazard.violation.as_ref().is_some_and(|one| one.one_workgroup);
            // Invocations that part by what they read may always part.
            let by_index = matches!(
                hazard.kind,
                Kind::Race | Kind::EqualWrites | Kind::OutOfRange | Kind::Wrapped
            );
            let key = (hazard.location.clone(), hazard.kind);
            let meets = !hazard.violation.as_ref().is_some_and(are_writes)
                || apart.as_ref().is_none_or(|places| places.contains(&hazard.location));
            let surely = surely.contains(&(key.0.clone(), key.1, one_workgroup));
            // Where numbers are all different no content makes two accesses of a workgroup's memory meet: it says which come.
            // Of a buffer the places may be a sum of such numbers.
            let in_order = hazard.kind == Kind::Race && in_workgroup && variant < Extents::SIZED;
            let of_content = by_index && !(meets && surely) && !in_order;
            if let Some(race) = hazard.violation.as_ref().filter(|one| !one.element.is_empty()) {
                let known = alone.entry(key).or_insert_with(|| Some((race.element.clone(), 0)));
                let same =
                    known.take().filter(|(element, _)| race.count == 1 && *element == race.element);
                *known = same.map(|(element, count)| (element, count + 1));
            }
            let likely = match hazard.kind {
                Kind::OutOfRange | Kind::Wrapped | Kind::Endless => variant < Extents::SIZED,
                // Of numbers that repeat two are the same, and so are the elements that they index.
                Kind::Race | Kind::EqualWrites => {
                    in_workgroup || variant < Extents::LIKELY && variant != Extents::REPEATED
                }
                _ => variant < Extents::LIKELY,
            };
            // A second workgroup's own elements lie beyond the array, and aren't written either.
            let is_unwritten =
                hazard.kind == Kind::Unwritten && beyond.contains(variable_of(&hazard.text));
            let is_beyond = hazard.violation.as_ref().is_some_and(|one| one.of_fixed_length);
            let by_dispatch =
                (is_beyond || is_unwritten) && !of_one_workgroup.contains(&hazard.location);
            let likely = likely && !by_size && !by_dispatch && !of_content;
            let to = if likely { &mut found } else { &mut rare };
            let hidden = hazard.hidden;
            let of_runtime_length = hazard.kind == Kind::OutOfRange && !is_beyond;
            let at_tail = of_runtime_length && likely && variant == Extents::TAIL;
            let hazard = Hazard { at_tail, ..hazard };
            let known = to.entry((hazard.location.clone(), hazard.kind)).or_insert(hazard);
            known.hidden &= hidden;
        }
        if let Err(reason) = inside {
            // With its findings it was looked at, but not to its end.
            if variant == 0 && found.is_empty() && rare.is_empty() {
                return Err(reason);
            }
            seen.cut += of;
        }
        // Other contents take as long.
        if !made.varies || examined.too_long && variant + 1 >= Extents::SIZED {
            break;
        }
    }
    // Contents that make an index make another one each time. Here they decide only which invocations come.
    let is_fixed = |key: &(String, Kind), _: &mut Hazard| {
        alone.get(key).is_some_and(|one| one.as_ref().is_some_and(|(_, count)| *count >= SEVERAL))
    };
    found.extend(rare.extract_if(.., is_fixed));
    rare.retain(|key, _| !found.contains_key(key));
    for (key, hazard) in &mut found {
        let is_float = matches!(hazard.kind, Kind::Nan | Kind::Infinite);
        let wrong_in = wrong_in.get(key).filter(|_| is_float);
        // Over half of the contents it is fine; or over numbers that were drawn, and no invocation is over one number for
        // all members.
        let by_contents = |wrong: &BTreeSet<usize>| {
            2 * wrong.len() <= contents
                || !wrong.contains(&0) && wrong.len() < contents && hazard.cases.0 == hazard.cases.1
        };
        let waits = key.1 == Kind::Endless && !surely_endless;
        if waits || wrong_in.is_some_and(by_contents) {
            hazard.by_contents.insert(hazard.function.clone());
        }
    }
    seen.hazards = found.into_values().collect();
    seen.rare = rare.into_values().collect();
    Ok(seen)
}

/// The name that an access begins with: `tile` of `tile[i].sum = 1.0`.
fn variable_of(text: &str) -> &str {
    text.split(|c: char| c != '_' && !c.is_alphanumeric()).next().unwrap_or_default()
}

fn kind_of(kind: ViolationKind) -> Kind {
    match kind {
        ViolationKind::ReadWrite | ViolationKind::WriteWrite => Kind::Race,
        ViolationKind::EqualWrites => Kind::EqualWrites,
        ViolationKind::Barrier => Kind::Barrier,
        ViolationKind::Unwritten => Kind::Unwritten,
        ViolationKind::Outside => Kind::OutOfRange,
        ViolationKind::Wrapped => Kind::Wrapped,
    }
}

/// The place of a violation, and the text there.
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
