//! Looks through compute passes for races, before any path runs them.

use karat_engine::{Access, Divergence, Observed, Place, Race as Found};

use super::dispatch::{in_order, options};
use crate::diagnostic::{Diagnostic, Span};
use crate::dispatch::{DispatchError, Examined, Pass, Passes, Race, RaceAccess, RaceKind, Watched};

/// Invocations that run whole. Of more, some workgroups of one pass run.
const WHOLE: u64 = 1 << 16;

/// Workgroups that run of a pass that is too large: the first, the last, and others by the name of the pass.
const SOME: usize = 64;

/// What the engine sees of passes. What it can't execute isn't looked at, which the result says.
pub(crate) fn examine(passes: &Passes) -> Examined {
    let of = passes.passes.iter().map(Pass::invocations).sum();
    let mut examined =
        Examined { watched: Watched { of, ..Watched::default() }, ..Examined::default() };
    if let Err(error) = run(passes, &mut examined) {
        let reason = error.to_string();
        let line = reason.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
        line.trim_start_matches("error: ").clone_into(&mut examined.watched.reason);
    }
    examined
}

fn run(passes: &Passes, examined: &mut Examined) -> Result<(), DispatchError> {
    let Examined { races, watched } = examined;
    in_order(passes, &mut |pass, lowered, resources| {
        let left = WHOLE.saturating_sub(watched.invocations);
        let is_whole = pass.invocations() <= left;
        let groups = pass.workgroups.iter().map(|count| *count as usize).product();
        let some = if is_whole { Vec::new() } else { sampled(&pass.name, groups) };
        let runs = |group: usize| is_whole || some.binary_search(&group).is_ok();
        let observed = lowered.observe_races(pass.workgroups, resources, &options(), &runs)?;
        watched.invocations += observed.invocations as u64;
        if !is_whole {
            // What follows would read what was never written.
            watched.reason = format!(
                "of `{}` {} of {groups} workgroups run, and no pass behind it: more than {WHOLE} invocations take \
                 too long",
                pass.name,
                some.len()
            );
        } else if observed.unwatched > 0 {
            watched.reason = format!("`{}` accesses more elements than are remembered", pass.name);
        }
        races.extend(told(pass, &observed));
        Ok(is_whole)
    })?;
    Ok(())
}

/// Workgroups, in order: the first, the last, and as many others as are wanted.
fn sampled(name: &str, groups: usize) -> Vec<usize> {
    let hash = |number: usize| {
        let text = format!("{name} {number}");
        let bytes = blake3::hash(text.as_bytes());
        let (head, _) = bytes.as_bytes().split_first_chunk::<8>().expect("it has 32 bytes");
        u64::from_le_bytes(*head)
    };
    let others = (0..SOME - 2).map(|number| (hash(number) % groups as u64) as usize);
    let mut all: Vec<usize> = [0, groups - 1].into_iter().chain(others).collect();
    all.sort_unstable();
    all.dedup();
    all
}

fn told(pass: &Pass, observed: &Observed) -> Vec<(Race, Diagnostic)> {
    let races = observed.races.iter().map(|race| of_race(pass, race));
    races.chain(observed.divergences.iter().map(|one| of_divergence(pass, one))).collect()
}

/// Where an access is, as far as the author wrote it.
fn span(pass: &Pass, site: &karat_engine::Site) -> Option<Span> {
    pass.program.resolve(site.span.to_range()?).map(|span| span.first_line())
}

fn of_race(pass: &Pass, race: &Found) -> (Race, Diagnostic) {
    let program = &pass.program;
    let words = [race.first.word, race.second.word];
    let (path, values) = match race.place {
        Place::Byte(at) => match program.element(&race.variable, at, words) {
            Some((path, values)) => (path, Some(values)),
            None => (format!(", byte {at}"), None),
        },
        Place::Texel([x, y, z]) => (format!("[{x}, {y}, {z}]"), None),
    };
    let variable = program.author_path(&race.variable).unwrap_or(&race.variable).to_owned();
    let element = format!("{}{path}", variable.rsplit("::").next().unwrap_or(&variable));
    let kind = match (race.first.writes && race.second.writes, race.writes_equally()) {
        (_, true) => RaceKind::EqualWrites,
        (true, _) => RaceKind::WriteWrite,
        _ => RaceKind::ReadWrite,
    };
    let does = |access: &Access, value: Option<&String>| {
        let verb = if access.writes { "writes" } else { "reads" };
        value.map_or_else(|| verb.to_owned(), |value| format!("{verb} {value}"))
    };
    let what = match kind {
        RaceKind::EqualWrites => "two writes of one value",
        RaceKind::WriteWrite => "two writes",
        _ => "a read and a write",
    };
    let more = match race.elements {
        1 => String::new(),
        count => format!(", and of {} more elements by the same lines", count - 1),
    };
    let headline =
        format!("`{}` has a race on `{element}`: {what} that nothing orders{more}", pass.name);
    let barrier = match (race.binding, race.place) {
        (None, _) => "workgroupBarrier",
        (_, Place::Texel(_)) => "textureBarrier",
        _ => "storageBarrier",
    };
    let note = if !race.one_workgroup {
        "nothing orders two workgroups of a dispatch: use an atomic, or write in one pass and read in the next"
            .to_owned()
    } else if race.first.site.span == race.second.site.span && kind != RaceKind::ReadWrite {
        "let one invocation write the element, or use an atomic".to_owned()
    } else {
        format!(
            "only barriers order the invocations of a workgroup: a `{barrier}()` between both does"
        )
    };
    let one = |access: &Access, at: usize| {
        let value = values.as_ref().map(|values| &values[at]);
        (span(pass, &access.site), pass.invocation(access.invocation), does(access, value))
    };
    let accesses = [one(&race.first, 0), one(&race.second, 1)];
    let diagnostic = diagnostic(headline, &accesses).note(note);
    let (entry_point, count) = (pass.name.clone(), race.elements);
    let accesses = accesses.map(access).into();
    (Race { entry_point, kind, variable, element, count, accesses }, diagnostic)
}

fn of_divergence(pass: &Pass, one: &Divergence) -> (Race, Diagnostic) {
    let headline = format!("`{}` has a barrier that not every invocation reaches", pass.name);
    let place = span(pass, &one.site);
    let accesses = [
        (place.clone(), pass.invocation(one.reached), "reaches it".to_owned()),
        (place, pass.invocation(one.missing), "doesn't".to_owned()),
    ];
    let note = format!(
        "{} of the workgroup's invocations don't: a barrier stands where all of them come, in uniform control flow \
         (WGSL, 15.2)",
        one.count
    );
    let diagnostic = diagnostic(headline, &accesses).note(note);
    let (entry_point, count) = (pass.name.clone(), one.count as u64);
    let (variable, element) = (String::new(), String::new());
    let accesses = accesses.map(access).into();
    let race = Race { entry_point, kind: RaceKind::Barrier, variable, element, count, accesses };
    (race, diagnostic)
}

/// Where, who, and what it does.
type Told = (Option<Span>, String, String);

fn access((span, invocation, does): Told) -> RaceAccess {
    let place = span.map_or_else(String::new, |span| span.to_string());
    RaceAccess { place, invocation, does }
}

/// The message, with both places.
fn diagnostic(headline: String, accesses: &[Told; 2]) -> Diagnostic {
    let [first, second] = accesses;
    let says = |(_, invocation, does): &Told| format!("{invocation} {does}");
    let mut diagnostic = Diagnostic::new(headline);
    if let (Some(one), Some(other)) = (&first.0, &second.0)
        && (&one.file.name, &one.range) == (&other.file.name, &other.range)
    {
        return diagnostic.at(one.clone(), format!("{}, {}", says(first), says(second)));
    }
    for told in accesses {
        match &told.0 {
            Some(span) => diagnostic = diagnostic.at(span.clone(), says(told)),
            None => diagnostic = diagnostic.note(says(told)),
        }
    }
    diagnostic
}
