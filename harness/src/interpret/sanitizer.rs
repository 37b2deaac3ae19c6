//! Checks compute passes for races, missed barriers and wrong indices, before a path runs the passes.

use std::collections::BTreeSet;

use karat_engine::{
    Access, Atomics, Bounds, Divergence, Explorer, Observed, Options, Outside, Place,
    Race as Found, Resources, Stop, Unwritten,
};

use super::dispatch::{Prepared, options};
use super::order::{OrderOf, SUBGROUPS, options_in};
use super::{outside, parting};
use crate::diagnostic::{Diagnostic, Span};
use crate::dispatch::{
    Afterwards, DispatchError, Examined, Pass, Passes, Violation, ViolationAccess, Watched,
};
use crate::hazard::Kind;
use crate::output::{counted, headline};
use crate::probe::ProbeError;
use crate::reflect::{BindingKind, Dimension, Program};

/// If passes have at most this number of invocations together, the sanitizer runs all of them. At the first pass beyond
/// this limit, the sanitizer runs only some workgroups, and then stops.
const WHOLE: u64 = 1 << 16;

/// The number of workgroups that the sanitizer runs in a pass beyond the limit [`WHOLE`]. These are the first
/// workgroup, the last one, and workgroups that Karat chooses by a hash of the pass's name.
const SOME: usize = 64;

/// The engine's options for passes over generated resources. These options limit the iterations of loops, because a
/// loop may read its number of iterations from generated data. Useful loops run some hundreds of iterations. A million
/// iterations in all invocations together take seconds.
pub(super) fn made_up_options() -> Options {
    Options { fuel: 1 << 14, work: 1 << 20, ..options() }
}

/// Runs passes over generated resources in the orders of [`examine`] and in sampled orders, and returns the findings.
pub fn examine_made_up(passes: &Passes) -> Examined {
    examine_with(passes, &made_up_options(), true)
}

/// The number of sampled orders for each set of generated contents: three simple orders, and five orders in which some
/// invocations stall.
const ORDERS_MADE_UP: u64 = 8;

/// The largest number of turns in one sampled order with generated contents. In a turn, one invocation runs up to its
/// next atomic. 65,536 turns take some hundredths of a second. Karat tries a dozen sets of contents with eight orders
/// each.
const TURNS_MADE_UP: usize = 1 << 16;

/// Runs passes in the usual order, with the usual and the smallest subgroup size, and returns the findings. If the
/// engine can't execute all passes, the result has the reason.
pub fn examine(passes: &Passes) -> Examined {
    examine_with(passes, &options(), false)
}

fn examine_with(passes: &Passes, base: &Options, made_up: bool) -> Examined {
    let prepared = match Prepared::new(passes, &karat_engine::Settings::default()) {
        Ok(prepared) => prepared,
        Err(error) => return refused(passes, &error),
    };
    let mut known = Known { made_up, ..Known::default() };
    let (mut examined, _) = observe(&prepared, Ways::Ordered(None, base), &mut known);
    if prepared.has_subgroups() && examined.watched.reason.is_empty() {
        // The smallest size gives the most subgroups, and the fewest neighbours for each lane.
        let size = SUBGROUPS[0];
        let order = OrderOf::of_size(passes, size);
        let (small, _) = observe(&prepared, Ways::Ordered(Some(&order), base), &mut known);
        examined.violations.extend(small.violations);
        if !small.watched.reason.is_empty() {
            examined.watched.reason = format!("in subgroups of {size}: {}", small.watched.reason);
        }
        examined.endless = examined.endless.take().or(small.endless);
        examined.too_long |= small.too_long;
    }
    // If invocations share no atomics, all orders give the same results.
    let atomics = known.atomics.clone();
    let has_orders = atomics.iter().map(Atomics::most_orders).sum::<f64>() > 0.0;
    if made_up && has_orders && examined.watched.reason.is_empty() {
        let base = Options { most_turns: TURNS_MADE_UP, ..base.clone() };
        for number in 0..ORDERS_MADE_UP {
            let order = OrderOf::drawn(passes, &atomics, number);
            let (other, _) = observe(&prepared, Ways::Ordered(Some(&order), &base), &mut known);
            examined.violations.extend(other.violations);
        }
    }
    examined
}

/// The result for passes that the engine can't execute.
pub(super) fn refused(passes: &Passes, error: &DispatchError) -> Examined {
    let reason = headline(&error.to_string()).to_owned();
    let watched = Watched { of: passes.invocations(), reason, ..Watched::default() };
    Examined { watched, ..Examined::default() }
}

/// The findings of all runs so far.
#[derive(Default)]
pub(super) struct Known {
    /// `true` if resources have generated contents.
    made_up: bool,
    violations: Vec<Violation>,
    /// The operations that use an index outside of an array: the index of the pass, and the number of the operation.
    outside: BTreeSet<(usize, u32)>,
    pub(super) races: bool,
    pub(super) turns: u64,
    /// The atomics of each pass in the last run.
    pub(super) atomics: Vec<Atomics>,
}

impl Known {
    /// Checks if an earlier run found a violation of the same kind at the same positions.
    fn has(&self, one: &Violation) -> bool {
        // The second access in one order may be the first access in another.
        let places = |one: &Violation| -> BTreeSet<String> {
            one.accesses.iter().map(|access| access.place.clone()).collect()
        };
        let subject = |one: &Violation| (one.entry_point.clone(), one.kind, one.variable.clone());
        let is_same =
            |other: &Violation| subject(other) == subject(one) && places(other) == places(one);
        self.violations.iter().any(is_same)
    }
}

pub(super) enum Ways<'w> {
    /// Runs in an order that the caller chose. `None` stands for the usual order.
    Ordered(Option<&'w OrderOf>, &'w Options),
    /// Runs in the next order of an explorer, which tries all orders. After the run, the third field returns the order
    /// in which the explorer ran the passes.
    Explored(&'w Options, &'w mut Explorer, &'w dyn Fn(&Explorer) -> OrderOf),
}

/// Runs passes in an order. Adds the findings that no earlier run had. Returns the data that the passes write, or
/// `None` if some passes didn't run.
///
/// In an unusual order, a loop may run forever, because WGSL doesn't promise that every invocation makes progress.
/// Findings before such a loop still count.
pub(super) fn observe(
    prepared: &Prepared<'_>,
    mut ways: Ways<'_>,
    known: &mut Known,
) -> (Examined, Option<Afterwards>) {
    let watched = Watched { of: prepared.passes.invocations(), ..Watched::default() };
    let mut examined = Examined { watched, ..Examined::default() };
    let left = run(prepared, &mut examined, &mut ways, known);
    let order = match &ways {
        Ways::Ordered(order, _) => order.cloned(),
        Ways::Explored(_, explorer, order) => Some(order(explorer)),
    };
    let left = left.unwrap_or_else(|error| {
        headline(&error.to_string()).clone_into(&mut examined.watched.reason);
        None
    });
    examined.violations.retain(|(one, _)| !known.has(one));
    known.violations.extend(examined.violations.iter().map(|(one, _)| one.clone()));
    if let Some(order) = order.filter(|_| !examined.violations.is_empty()) {
        let note = order.note(prepared.passes);
        let turns = parting::turns(prepared, &order);
        for (violation, diagnostic) in &mut examined.violations {
            violation.headline = format!("{}, {}", order.headline(), violation.headline);
            diagnostic.message.clone_from(&violation.headline);
            diagnostic.notes.push(note.clone());
            diagnostic.notes.extend(turns.told());
        }
    }
    (examined, left)
}

fn run(
    prepared: &Prepared<'_>,
    examined: &mut Examined,
    ways: &mut Ways<'_>,
    known: &mut Known,
) -> Result<Option<Afterwards>, DispatchError> {
    let Examined { violations, watched, endless, too_long } = examined;
    let (mut outside, mut unwritten, mut number) = (Vec::new(), Vec::new(), 0);
    let is_usual = matches!(ways, Ways::Ordered(None, _));
    known.atomics.clear();
    let held = prepared.run(&mut |pass, lowered, resources| {
        let left = WHOLE.saturating_sub(watched.invocations);
        let groups = pass.workgroups.iter().map(|count| *count as usize).product();
        let size = lowered.workgroup_size().expect("a pass is an entry point");
        // naga's IR has no value for a workgroup size that depends on overrides.
        watched.of += pass.invocations_of(size).saturating_sub(pass.invocations());
        let is_whole = pass.invocations_of(size) <= left || groups <= SOME;
        let some = (!is_whole).then(|| sampled(&pass.name, groups));
        let mut options = Options::default();
        let observed = match ways {
            Ways::Ordered(order, base) => {
                options = options_in(number, *order, base);
                lowered.observe_races(pass.workgroups, resources, &options, some.as_deref())?
            }
            Ways::Explored(options, explorer, _) => {
                lowered.explore(pass.workgroups, resources, options, explorer)?
            }
        };
        watched.invocations += observed.invocations as u64;
        watched.rounds += observed.rounds;
        if let Some(some) = &some {
            // A later pass would read data that no invocation wrote.
            watched.reason = format!(
                "in `{}`, only {} of {groups} workgroups ran, and no later pass ran, because more than {WHOLE} invocations \
                 take too long",
                pass.name,
                some.len()
            );
        } else if observed.unwatched > 0 {
            watched.reason = format!("`{}` accesses more elements than the sanitizer can track", pass.name);
        }
        if let Some(stop) = &observed.stopped {
            *too_long |= matches!(stop, Stop::Work { .. });
            // Many invocations together may use up all iterations. An endless loop also uses up the iterations if a
            // workgroup runs alone.
            let alone = match stop {
                Stop::Work { .. } => {
                    let whole = Options { work: u64::MAX, ..options.clone() };
                    lowered.observe_races(pass.workgroups, resources, &whole, Some(&[0]))?.stopped
                }
                _ => None,
            };
            let stop = alone.as_ref().unwrap_or(stop);
            // Nested loops may take many rounds together, although each of them ends.
            let ends = matches!(stop, Stop::Fuel { rounds, own, .. } if super::is_of_several(*rounds, *own));
            *too_long |= ends;
            let stopped = super::stopped(&pass.program, &pass.name, stop);
            watched.reason = headline(&stopped.to_string()).to_owned();
            if let ProbeError::Rounds { diagnostic, .. } = stopped
                && !ends
            {
                *endless = Some(*diagnostic);
            }
        }
        let goes_on = is_whole && observed.stopped.is_none();
        known.races |= !observed.races.is_empty();
        known.turns += observed.turns;
        violations.extend(violations_of(&Examining { pass, size, together: is_usual }, &observed));
        known.atomics.push(observed.atomics);
        let of_blank = observed.unwritten.iter().filter(|one| !one.own);
        unwritten.extend(of_blank.map(|one| {
            let (element, span) = element_read(&Examining { pass, size, together: true }, one);
            span.map_or_else(|| format!("`{element}`"), |span| format!("`{element}` at {span}"))
        }));
        let outside_of = observed.outside.into_iter().map(|one| (number, size, one));
        outside.extend(outside_of.filter(|(_, _, one)| known.outside.insert((number, one.number))));
        number += 1;
        Ok(goes_on)
    })?;
    let is_cut = matches!(ways, Ways::Explored(_, explorer, _) if explorer.is_cut());
    let is_whole = number == prepared.passes.passes.len()
        && endless.is_none()
        && watched.reason.is_empty()
        && !is_cut;
    // A write outside of an array is always an error. A read is an error if it changes the results, which only a
    // complete run shows.
    let (writes, reads): (Vec<_>, Vec<_>) =
        outside.into_iter().partition(|(.., one)| one.writes || one.bounds == Bounds::Wrapped);
    let mut told = Vec::new();
    for (number, size, one) in &writes {
        let pass = &prepared.passes.passes[*number];
        violations.push(of_outside(&Examining { pass, size: *size, together: is_usual }, one, &[]));
        told.push((*number, one.site.span.to_range()));
    }
    // `data[i] += 1` reads and writes outside of the array, but needs only one message.
    let is_part = |number: usize, one: &Outside| {
        told.iter().any(|(other, whole)| {
            let range = one.site.span.to_range();
            let (Some(own), Some(whole)) = (&range, whole) else { return false };
            *other == number && whole.start <= own.start && own.end <= whole.end
        })
    };
    let order = match &ways {
        Ways::Ordered(order, _) => order.cloned(),
        Ways::Explored(_, explorer, order) => Some(order(explorer)),
    };
    let base = match &ways {
        Ways::Ordered(_, base) => *base,
        Ways::Explored(options, ..) => *options,
    };
    for number in (0..prepared.passes.passes.len()).filter(|_| is_whole) {
        let own = reads.iter().filter(|(of, _, one)| *of == number && !is_part(number, one));
        let own: Vec<_> = own.collect();
        let Some((_, size, _)) = own.first() else { continue };
        let of_pass: Vec<&Outside> = own.iter().map(|(.., one)| one).collect();
        let options_of = |number: usize| options_in(number, order.as_ref(), base);
        let found = outside::matter(prepared, (number, known.made_up), &of_pass, &options_of)?;
        let pass = &prepared.passes.passes[number];
        let examining = Examining { pass, size: *size, together: is_usual };
        for one in of_pass.iter().filter(|one| found.alone.contains(&one.number)) {
            violations.push(of_outside(&examining, one, &[]));
        }
        if let ([first, others @ ..], true) = (&of_pass[..], found.together) {
            violations.push(of_outside(&examining, first, others));
        }
        if found.untried > 0 {
            let lines = match found.untried {
                1 => "1 line reads outside of an array, and Karat didn't test the effect",
                more => &format!(
                    "{more} lines read outside of an array, and Karat didn't test the effects"
                ),
            };
            watched.reason = format!("in `{}`, {lines}", pass.name);
        }
    }
    let left = is_whole.then(|| prepared.left(&held));
    if let (Some(left), true, false) = (&left, is_usual, unwritten.is_empty())
        && depends_on_blank(prepared, (&held, left), base)?
    {
        watched.unwritten = unwritten;
    }
    Ok(left)
}

/// Checks if the passes' results depend on the initial contents of blank buffers. Runs the passes again, with the
/// integer 1 and then with the float 1 in all elements of these buffers.
fn depends_on_blank(
    prepared: &Prepared<'_>,
    (held, left): (&Resources, &Afterwards),
    base: &Options,
) -> Result<bool, DispatchError> {
    for word in [1, 1.0_f32.to_bits()] {
        let other = prepared.filled(word).dispatched(&|_| base.clone())?;
        for ((number, usual), (_, other)) in left.iter().zip(&other) {
            let touched = held.blank(0, *number as u32);
            let is_written = |at: usize| {
                touched.is_none_or(|touched| (4 * at..4 * at + 4).any(|at| touched.contains(at)))
            };
            let mut words = usual.iter().zip(other).enumerate();
            if words.any(|(at, (usual, other))| usual != other && is_written(at)) {
                return Ok(true);
            }
        }
    }
    Ok(false)
}

/// A pass with violations, and its workgroup size.
struct Examining<'p> {
    pass: &'p Pass,
    size: [u32; 3],
    /// `true` if all invocations finish a statement before any of them begins the next statement. Accesses then happen
    /// in the order of the statements.
    together: bool,
}

impl Examining<'_> {
    fn invocation(&self, number: usize) -> String {
        super::invocation(self.pass, self.size, number)
    }

    fn span(&self, site: &karat_engine::Site) -> Option<Span> {
        super::statement_of(&self.pass.program, site)
    }
}

/// The workgroups to run, in order: the first one, the last one, and others up to [`SOME`].
fn sampled(name: &str, groups: usize) -> Vec<usize> {
    let hash = |number: usize| {
        let text = format!("{name} {number}");
        let bytes = blake3::hash(text.as_bytes());
        let (head, _) = bytes.as_bytes().split_first_chunk::<8>().expect("it has 32 bytes");
        u64::from_le_bytes(*head)
    };
    let mut all = BTreeSet::from([0, groups - 1]);
    let mut drawn = (0..).map(|number| (hash(number) % groups as u64) as usize);
    while all.len() < SOME.min(groups) {
        all.extend(drawn.next());
    }
    all.into_iter().collect()
}

fn violations_of(pass: &Examining<'_>, observed: &Observed) -> Vec<(Violation, Diagnostic)> {
    let races = observed.races.iter().map(|race| of_race(pass, race));
    let divergences = observed.divergences.iter().map(|one| of_divergence(pass, one));
    let unwritten = observed.unwritten.iter().filter(|one| one.own);
    let unwritten = unwritten.map(|one| of_unwritten(pass, one));
    races.chain(divergences).chain(unwritten).collect()
}

fn of_race(examining: &Examining<'_>, race: &Found) -> (Violation, Diagnostic) {
    let (pass, program) = (examining.pass, &examining.pass.program);
    let words = [race.first.word, race.second.word];
    let (path, values) = match race.place {
        Place::Byte(at) => element(program, &race.variable, at, words),
        Place::Texel([x, y, z]) => {
            let texture = pass.bindings.iter().find_map(|(binding, _)| match binding.kind {
                BindingKind::StorageTexture { dimension, arrayed, format, .. }
                    if program.name_of(&binding.path) == race.variable =>
                {
                    Some(((dimension, arrayed), format))
                }
                _ => None,
            });
            let texel = match texture {
                Some(((Dimension::D1, false), _)) => format!("[{x}]"),
                Some(((Dimension::D2, false), _)) => format!("[{x}, {y}]"),
                _ => format!("[{x}, {y}, {z}]"),
            };
            let values = texture.and_then(|(_, format)| {
                Some([format.shown(race.first.texel?), format.shown(race.second.texel?)])
            });
            (texel, values)
        }
    };
    let (variable, element) = named(program, &race.variable, &path);
    let both_write = race.first.writes && race.second.writes;
    let kind = if race.writes_equally() { Kind::EqualWrites } else { Kind::Race };
    let does = |access: &Access, value: Option<&String>| {
        let verb = if access.writes { "writes" } else { "reads" };
        value.map_or_else(|| verb.to_owned(), |value| format!("{verb} {value}"))
    };
    let what = match kind {
        Kind::EqualWrites => "two writes of equal values",
        _ if both_write => "two writes",
        _ => "a read and a write",
    };
    let more = match race.elements {
        1 => String::new(),
        2 => "; the same lines race on 1 more element".to_owned(),
        count => format!("; the same lines race on {} more elements", count - 1),
    };
    let headline =
        format!("`{}` has a race on `{element}`: {what} that nothing orders{more}", pass.name);
    let barrier = match (race.binding, race.place) {
        (None, _) => "workgroupBarrier",
        (_, Place::Texel(_)) => "textureBarrier",
        _ => "storageBarrier",
    };
    let note = if pass.drawn.is_some() {
        let atomic = if let Place::Texel(_) = race.place { "" } else { "use an atomic, or " };
        format!("the pixels of a draw have no order: {atomic}let each pixel write its own element")
    } else if !race.one_workgroup {
        let atomic = if let Place::Texel(_) = race.place { "" } else { "use an atomic, or " };
        format!(
            "the workgroups of a dispatch have no order: {atomic}read the element in a later pass, or write into another resource"
        )
    } else if is_within(&race.first, &race.second) || is_within(&race.second, &race.first) {
        match both_write {
            false => format!(
                "if both accesses must write the element, use an atomic. Otherwise read the element into a `let` first, and \
                 write after a `{barrier}()`"
            ),
            true => "let one invocation write the element, or use an atomic".to_owned(),
        }
    } else if examining.together && is_behind(&race.first, &race.second) {
        format!(
            "the second access is in a later iteration of the loop or in a later call. A barrier between the two lines orders \
             the accesses of one iteration or call: put a `{barrier}()` at the end of the loop or of the function, too"
        )
    } else {
        format!(
            "only barriers order the invocations of a workgroup: put a `{barrier}()` between the two accesses"
        )
    };
    let one = |access: &Access, at: usize| {
        let value = values.as_ref().map(|values| &values[at]);
        (examining.span(&access.site), examining.invocation(access.invocation), does(access, value))
    };
    let accesses = [one(&race.first, 0), one(&race.second, 1)];
    let diagnostic = diagnostic(headline.clone(), &accesses).note(note.clone());
    let violation =
        Violation::new(&pass.name, kind, (headline, race.elements), accesses.map(access).into());
    (Violation { variable, element, advice: note, ..violation }, diagnostic)
}

/// Checks if the access that ran first is later in the function's text: then a loop surrounds both accesses, or the
/// function was called again. Returns `false` for accesses in different functions.
fn is_behind(first: &Access, second: &Access) -> bool {
    if first.site.function != second.site.function {
        return false;
    }
    let [first, second] = [first, second].map(|access| access.site.span.to_range());
    first.zip(second).is_some_and(|(first, second)| first.start >= second.end)
}

/// The path (such as `[3].x`) of the element at a byte offset of a variable, and `words` as values of the element's
/// type.
fn element<const N: usize>(
    program: &Program,
    variable: &str,
    byte: u32,
    words: [u32; N],
) -> (String, Option<[String; N]>) {
    match program.element(variable, byte, words) {
        Some((path, values)) => (path, Some(values)),
        None => (format!(", byte {byte}"), None),
    }
}

/// The names of a variable and of its element at `path`, as in the source file.
fn named(program: &Program, variable: &str, path: &str) -> (String, String) {
    let variable = program.author_path(variable).unwrap_or(variable).to_owned();
    let element = format!("{}{path}", variable.rsplit("::").next().unwrap_or(&variable));
    (variable, element)
}

/// Checks if the source range of the access `other` contains the source range of the access `one`. No barrier can be
/// between two such accesses.
fn is_within(one: &Access, other: &Access) -> bool {
    let ranges = [one, other].map(|access| access.site.span.to_range());
    let [Some(one), Some(other)] = ranges else { return false };
    other.start <= one.start && one.end <= other.end
}

fn of_divergence(examining: &Examining<'_>, one: &Divergence) -> (Violation, Diagnostic) {
    let pass = examining.pass;
    let (operation, among) = match one.subgroup {
        true => ("a subgroup operation", "subgroup"),
        false => ("a barrier", "workgroup"),
    };
    let headline =
        format!("`{}` has {operation} that not every invocation of a {among} reaches", pass.name);
    let place = examining.span(&one.site);
    let (missing, parted) = (examining.invocation(one.missing), &one.parted);
    let parts = parted.as_ref().and_then(|site| examining.span(site));
    let other = match &parts {
        Some(_) => (parts, missing, "takes another branch here".to_owned()),
        None => (place.clone(), missing, "doesn't".to_owned()),
    };
    let accesses = [(place, examining.invocation(one.reached), "reaches it".to_owned()), other];
    let note = format!(
        "{} of the {among}'s invocations don't reach this line, but WGSL requires {operation} to be in uniform control flow \
         (15.2)",
        one.count
    );
    let diagnostic = diagnostic(headline.clone(), &accesses).note(note);
    let told = (headline, one.count as u64);
    (Violation::new(&pass.name, Kind::Barrier, told, accesses.map(access).into()), diagnostic)
}

/// The violation for an index outside of an array. If no single index changes the results, but all wrong indices
/// together do, `others` has the other wrong indices.
fn of_outside(
    examining: &Examining<'_>,
    one: &Outside,
    others: &[&Outside],
) -> (Violation, Diagnostic) {
    let pass = examining.pass;
    let reads = "and the results of the passes depend on this read";
    let name = one.variable.as_ref().map(|variable| named(&pass.program, variable, "").1);
    let of = match (name, one.bounds, one.nested) {
        (Some(name), _, false) => format!("`{name}`"),
        (Some(name), ..) => format!("an array in `{name}`"),
        (None, Bounds::Texture, _) => "a texture".to_owned(),
        (None, ..) => "an array".to_owned(),
    };
    let headline = match (one.writes, one.bounds) {
        (_, Bounds::Wrapped) => format!("`{}` has an index that wraps around", pass.name),
        (true, _) => format!("`{}` writes outside of {of}", pass.name),
        (false, Bounds::Fixed | Bounds::Runtime | Bounds::Texture) => {
            format!("`{}` reads outside of {of}, {reads}", pass.name)
        }
        (false, Bounds::Subgroup) => {
            format!("`{}` reads the value of an invocation that doesn't exist, {reads}", pass.name)
        }
    };
    let (place, invocation) = (examining.span(&one.site), examining.invocation(one.invocation));
    let beyond = match one.bounds {
        Bounds::Subgroup => "reads from an inactive or missing invocation of the subgroup",
        Bounds::Texture => "accesses a texel beyond the edge of the texture",
        _ => "uses an index beyond the end of the array",
    };
    let beyond = match one.index {
        Some((meant, index)) if one.bounds == Bounds::Wrapped => {
            format!("computes index {meant}, but accesses element {index}")
        }
        Some((index, length)) if one.bounds == Bounds::Texture => {
            format!("accesses texel {index}, but {of} has {length} texels in that direction")
        }
        Some((index, length)) => {
            let owner = if one.nested || one.variable.is_none() { "the array" } else { &of };
            format!("uses index {index}, but {owner} has {}", counted(length, "element"))
        }
        None => beyond.to_owned(),
    };
    let does = match one.count {
        1 => beyond,
        count => format!("{beyond}, the first of {count} such indices"),
    };
    let mut diagnostic = Diagnostic::new(headline.clone());
    if let Some(span) = &place {
        diagnostic = diagnostic.at(span.clone(), format!("{invocation} {does}"));
    }
    let note = match one.bounds {
        Bounds::Subgroup => {
            "WGSL allows any result for such an index (*Subgroup Built-in Functions*): if the index is `subgroup_size` or more, `select` another value"
        }
        Bounds::Wrapped => {
            "a sum or a product in the index exceeds 32 bits, and WGSL keeps only the lowest 32 bits (*Arithmetic Expressions*): \
             compare the operands with a limit first, or use smaller operands"
        }
        Bounds::Texture => {
            "WGSL allows such a read to return any texel or zero, and ignores such a write (*textureLoad*, *textureStore*): \
             compare the coordinates with `textureDimensions`, and return early"
        }
        Bounds::Fixed => {
            "WGSL allows such a read to return any element or zero, and such a write to change any element of the variable or none \
             (6.4.4): compare the index with the number of elements in the type, and return early"
        }
        Bounds::Runtime => {
            "WGSL allows such a read to return any element or zero, and such a write to change any element of the buffer or none \
             (6.4.4): compare the index with `arrayLength` or a count, and return early"
        }
    };
    let mut diagnostic = diagnostic.note(note);
    if !others.is_empty() {
        let places = others.iter().filter_map(|other| examining.span(&other.site));
        let mut places: Vec<String> = places.map(|span| span.to_string()).collect();
        places.dedup();
        diagnostic = diagnostic.note(format!(
            "this read changes the results only together with other reads outside of arrays: at {}",
            places.join(", ")
        ));
    }
    let accesses = vec![access((place, invocation, does))];
    let kind = match one.bounds {
        Bounds::Wrapped => Kind::Wrapped,
        _ => Kind::OutOfRange,
    };
    (Violation::new(&pass.name, kind, (headline, one.count), accesses), diagnostic)
}

/// The name of an element that an invocation reads before any invocation writes to the element, and the position of the
/// read.
fn element_read(examining: &Examining<'_>, one: &Unwritten) -> (String, Option<Span>) {
    let program = &examining.pass.program;
    let (path, _) = element(program, &one.variable, one.byte, [one.access.word]);
    (named(program, &one.variable, &path).1, examining.span(&one.access.site))
}

fn of_unwritten(examining: &Examining<'_>, one: &Unwritten) -> (Violation, Diagnostic) {
    let pass = examining.pass;
    let (variable, _) = named(&pass.program, &one.variable, "");
    let (element, place) = element_read(examining, one);
    let headline =
        format!("`{}` reads `{element}`, which no invocation has written yet", pass.name);
    let invocation = examining.invocation(one.access.invocation);
    let does = match one.count {
        1 => format!("reads `{element}`"),
        count => format!("reads `{element}`, the first of {count} such reads on this line"),
    };
    let mut diagnostic = Diagnostic::new(headline.clone());
    if let Some(span) = &place {
        diagnostic = diagnostic.at(span.clone(), format!("{invocation} {does}"));
    }
    let note = "WGSL initialises workgroup memory with zeros (*var Declarations*), but a program can turn this off in wgpu to save \
                time: write the initial value, and then call `workgroupBarrier()`";
    let diagnostic = diagnostic.note(note);
    let accesses = vec![access((place, invocation, does))];
    let violation = Violation::new(&pass.name, Kind::Unwritten, (headline, one.count), accesses);
    (Violation { variable, element, ..violation }, diagnostic)
}

/// An access for a message: its position, the name of the invocation, and a predicate such as `reads 3.5`.
type Action = (Option<Span>, String, String);

fn access((span, invocation, does): Action) -> ViolationAccess {
    let place = span.map_or_else(String::new, |span| span.to_string());
    ViolationAccess { place, invocation, does }
}

/// The message about two conflicting accesses, with the position of each of them.
fn diagnostic(headline: String, accesses: &[Action; 2]) -> Diagnostic {
    let [first, second] = accesses;
    let says = |(_, invocation, does): &Action| format!("{invocation} {does}");
    let mut diagnostic = Diagnostic::new(headline);
    if let (Some(one), Some(other)) = (&first.0, &second.0)
        && (&one.file.name, &one.range) == (&other.file.name, &other.range)
    {
        return diagnostic.at(one.clone(), format!("{}, {}", says(first), says(second)));
    }
    for action in accesses {
        match &action.0 {
            Some(span) => diagnostic = diagnostic.at(span.clone(), says(action)),
            None => diagnostic = diagnostic.note(says(action)),
        }
    }
    diagnostic
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dispatch::Wanted;
    use crate::fixture::{Buffer, Fixtures};
    use crate::package::Package;
    use crate::reflect::Overrides;

    fn examined(text: &str, passes: &[(&str, u32)], words: usize) -> Examined {
        let package = Package::from_source("m", text);
        let wanted: Vec<Wanted> = passes
            .iter()
            .map(|(name, groups)| Wanted { name: (*name).to_owned(), workgroups: [*groups, 1, 1] })
            .collect();
        let fixtures: Fixtures = vec![("data".to_owned(), Buffer::zeros(4 * words).into())];
        let passes = Passes::new(&package, &wanted, (&fixtures, &[]), &Overrides::new());
        examine(&passes.expect("they fit"))
    }

    const TEXT: &str = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
        @compute @workgroup_size(64) fn fill(@builtin(global_invocation_id) id: vec3u) { data[id.x] = id.x; }
        @compute @workgroup_size(64) fn ends(@builtin(global_invocation_id) id: vec3u) {
            if id.x == 0u || id.x + 1u == arrayLength(&data) { data[7] = id.x; }
        }";

    /// The sanitizer runs passes one after another, each with all its workgroups, if there aren't too many invocations.
    #[test]
    fn passes_are_ordered_and_run_whole() {
        let examined = examined(TEXT, &[("fill", 2), ("ends", 1)], 128);
        assert!(examined.violations.is_empty(), "{:?}", examined.violations);
        let whole = Watched { invocations: 192, of: 192, ..Watched::default() };
        assert_eq!(examined.watched, whole);
    }

    /// In a pass that is too large, the sanitizer runs only some workgroups, among them the first one and the last one.
    /// Later passes don't run.
    #[test]
    fn a_large_pass_is_checked_in_part() {
        let groups = 2048;
        let all = [("ends", groups), ("fill", groups)];
        let examined = examined(TEXT, &all, 64 * groups as usize);
        let kinds: Vec<_> = examined.violations.iter().map(|(one, _)| one.kind).collect();
        assert_eq!(kinds, [Kind::Race], "by the first and the last workgroup");
        let Watched { invocations, of, reason, .. } = examined.watched;
        assert_eq!(of, 2 * 64 * u64::from(groups));
        assert_eq!(invocations, 64 * 64);
        assert!(reason.starts_with("in `ends`, only 64 of 2048 workgroups ran"), "{reason}");
    }

    /// If the engine can't execute a pass, the result has a reason and no findings.
    #[test]
    fn passes_that_the_engine_refuses_have_a_reason() {
        let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
            @compute @workgroup_size(64) fn sum(@builtin(local_invocation_index) i: u32) {
                data[i] = u32(f64(i));
            }";
        let examined = examined(text, &[("sum", 1)], 64);
        assert!(examined.violations.is_empty());
        let Watched { invocations, reason, .. } = examined.watched;
        assert_eq!(invocations, 0);
        assert!(reason.contains("the engine doesn't support"), "{reason}");
    }
}
