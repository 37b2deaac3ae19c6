//! Compares a function's results before and after an edit, over the same inputs.

use std::borrow::Cow;

use karat::fixture::Fixtures;
use karat::unstable::executor::{self, Caller};
use karat::unstable::probe::{ProbeError, Probed};
use karat_core::domain::Stream as _;
use karat_core::output::counted;

use super::lanes::Shared;
use super::sides::hold_the_same;
use super::values::{Clarity, Distance, Largest, clarity, distance, told};
use super::{Both, Change, PathChange, Request};
use crate::limits::{CHANGED_WORK, COMPARED_WORK, LAST_VERTEX, LEAST_EQUAL, OTHER_WORDS, SIMPLER};
use crate::made_up::{Arguments, Content, Drawn, Mix, Ranges, Resources};
use crate::work::{Chosen, ENDS_FOR_NONE, Side};

const SEED: u64 = 0x0063_6f6d_7061_7265; // "compare"

#[derive(Default)]
pub(super) struct Ran {
    pub(super) drawn: Drawn,
    pub(super) cut: usize,
    pub(super) reached: Both,
}

/// Both versions of a function on one path, with one set of generated values (a content) in their resources.
struct Pair<'p> {
    old: Caller<'p>,
    new: Caller<'p>,
    shared: &'p Shared,
}

struct Results {
    was: Vec<u32>,
    is: Vec<u32>,
    widths: [usize; 2],
}

impl<'p> Pair<'p> {
    fn new(
        path: karat::path::Path,
        [before, after]: [&'p Probed; 2],
        held: &'p [Fixtures; 2],
        (shared, count): (&'p Shared, usize),
    ) -> Result<Self, ProbeError> {
        let executor = executor::of(path)?;
        let old = Caller::new(executor, Cow::Borrowed(before), &held[0], count)?;
        let new = Caller::new(executor, Cow::Borrowed(after), &held[1], count)?;
        Ok(Self { old, new, shared })
    }

    fn results(&self, rows: &[u32], count: usize) -> Result<Results, ProbeError> {
        let lanes = |caller: &Caller<'_>| caller.probed.function.result.lanes().len();
        Ok(Results {
            was: self.old.results(&self.shared.rows(rows, count), count)?,
            is: self.new.results(rows, count)?,
            widths: [lanes(&self.old), lanes(&self.new)],
        })
    }
}

impl Results {
    fn of(&self, case: usize) -> (&[u32], &[u32]) {
        let [was, is] = self.widths;
        (&self.was[case * was..][..was], &self.is[case * is..][..is])
    }
}

/// A measure of how well a case shows a change: the change's clarity, `false` if an argument is outside of its domain,
/// and the distance between the two results.
type Evidence = (Clarity, bool, Distance);

impl Request {
    /// Runs both versions on each path, with each set of generated values (content) of their buffers.
    pub(super) fn run_both(
        &self,
        before: &Probed,
        after: &Probed,
        (ran, mut shared): (&mut Ran, Shared),
    ) -> Result<Change, String> {
        let mut ranges = self.ranges()?;
        // A shader may index an array with the vertex number. Both versions get the same small vertex numbers, which
        // are always valid.
        for (path, builtin) in &after.function.form.builtins {
            if matches!(&**builtin, "vertex_index" | "instance_index") && ranges.get(path).is_none()
            {
                ranges.declare(path, 0.0, LAST_VERTEX)?;
            }
        }
        let literals = before.program.literals().and(&after.program.literals());
        let ranges = ranges.with_literals(literals);
        let nameless = ranges.without_names();
        let below = nameless.negative();
        let arguments = Arguments::of(&after.function, &ranges)?;
        let any = Arguments::of(&after.function, &nameless)?;
        let (mut drawn, mut anywhere) = (arguments.drawn(), any.drawn());
        let (count, rows) = arguments.rows_beside(&any, SEED, self.cases);
        if count == 0 {
            return Err("Karat can't generate arguments for the function".to_owned());
        }
        let own = Arguments::of(&before.function, &ranges)?;
        let (own_count, of_own) = own.rows(SEED, 2 * contents().count());
        let mut paths: Vec<PathChange> = Vec::new();
        let (mut cases, mut left_out) = (0, 0);
        // Of the two contents that ignore names, the second one has negative numbers.
        let usual = Content::OF_FUNCTIONS.map(|content| (content, &ranges));
        let of_nameless = Content::NAMELESS.into_iter().zip([&nameless, &below]);
        for (content, ranges) in usual.into_iter().chain(of_nameless) {
            let (all, rows) = arguments.part(&rows, count, content.draw);
            if own_count > 0 && !shared.is_same() {
                // The first rows are edges, so this takes values from the last rows.
                let at = own_count - 1 - content.draw % own_count;
                shared.fill(&of_own[at * own.width()..][..own.width()]);
            }
            let made = Made::of([before, after], ranges, content, None)?;
            let is_usual = Content::OF_FUNCTIONS.contains(&content);
            if is_usual { &mut drawn } else { &mut anywhere }.merge(made.drawn);
            let held = made.held;
            let of_before = |rows: &[u32], count| shared.rows(rows, count).into_owned();
            let sides = [(before, Some(&of_before as _)), (after, None)];
            let side = |(at, (probed, own))| Side { probed, fixtures: &held[at], own };
            let sides: Vec<Side<'_>> = sides.into_iter().enumerate().map(side).collect();
            let work = if paths.is_empty() { COMPARED_WORK } else { CHANGED_WORK };
            let chosen = Chosen::of(&sides, &arguments, (all, &rows), work);
            let Chosen { count, rows, allowed, .. } = chosen;
            ran.cut += chosen.cut;
            left_out += chosen.cut;
            for path in self.paths.iter().filter(|_| count > 0) {
                let pair = Pair::new(*path, [before, after], &held, (&shared, count));
                let pair = pair.map_err(|error| error.to_string())?;
                let found = match changed(&pair, &arguments, (&rows, count, allowed)) {
                    // Before the edit, the function still ended.
                    Err(ProbeError::Rounds { .. })
                        if pair.old.results(&shared.rows(&rows, count), count).is_ok() =>
                    {
                        return Err("after the edit, one of the function's loops runs too many iterations to compare, or doesn't end".to_owned());
                    }
                    other => other,
                };
                cases += count;
                let Some((mut change, row)) = found.map_err(|error| error.to_string())? else {
                    let rows = [shared.rows(&rows, count), Cow::Borrowed(&*rows)];
                    ran.reached.add_calls([before, after], &held, (count, rows));
                    continue;
                };
                let of = (content, &*made.members);
                let known = paths.iter_mut().find(|known| known.path == change.path);
                if known.as_ref().is_none_or(|known| change.shows() > known.shows()) {
                    change.arguments.extend(matter([before, after], ranges, of, (&pair, &row)));
                }
                match known {
                    Some(known) => known.add(change),
                    None => paths.push(change),
                }
            }
            if !made.varies {
                break;
            }
        }
        ran.drawn = drawn.beside(&anywhere);
        let each = cases / self.paths.len().max(1);
        if each == 0 {
            return Err(ENDS_FOR_NONE.to_owned());
        }
        if paths.is_empty() && each < LEAST_EQUAL && left_out > 0 {
            let inputs = counted(each, "input");
            return Err(format!(
                "Karat compared only {inputs} of {}, and found the same results: more inputs would take too long",
                each + left_out
            ));
        }
        paths.iter_mut().for_each(|path| path.cases.1 = each);
        Ok(match paths.is_empty() {
            true => Change::Same { cases: each },
            false => Change::Changed { paths },
        })
    }
}

/// All sets of generated values (contents) for buffers and textures. In some sets, values are in the ranges that the
/// resources' names suggest. Other sets ignore the names.
fn contents() -> impl Iterator<Item = Content> {
    Content::OF_FUNCTIONS.into_iter().chain(Content::NAMELESS)
}

struct Made {
    held: [Fixtures; 2],
    members: Vec<(String, String)>,
    drawn: Drawn,
    varies: bool,
}

impl Made {
    /// Generates the resources of both versions. If only one version reads a resource, only that version gets the
    /// resource.
    fn of(
        [before, after]: [&Probed; 2],
        ranges: &Ranges,
        content: Content,
        mix: Option<&Mix<'_>>,
    ) -> Result<Self, String> {
        let of = |side: &Probed| match mix {
            Some(mix) => Resources::mixed(side, ranges, content, mix),
            None => Resources::of(side, ranges, content),
        };
        let (mut old, mut new) = (of(before)?, of(after)?);
        hold_the_same([&mut old.fixtures, &mut new.fixtures], before, after);
        let varies = old.varies || new.varies;
        let held = [old.fixtures, new.fixtures];
        Ok(Self { held, members: new.members, drawn: new.drawn, varies })
    }
}

/// Returns the members of buffers that affect a change: members for which another value changes the results for the
/// arguments in `row`.
fn matter(
    sides: [&Probed; 2],
    ranges: &Ranges,
    (content, members): (Content, &[(String, String)]),
    (pair, row): (&Pair<'_>, &[u32]),
) -> Vec<(String, String)> {
    let own = pair.results(row, 1).ok();
    let same = |path: &str, other: Content| -> Option<bool> {
        let takes = |input: &crate::made_up::Input| input.path == path;
        let mix = Mix { content: other, extents: None, takes: &takes };
        let made = Made::of(sides, ranges, content, Some(&mix)).ok()?;
        let of = Pair::new(pair.new.path, sides, &made.held, (pair.shared, 1)).ok()?;
        let (others, own) = (of.results(row, 1).ok()?, own.as_ref()?);
        Some((&others.was, &others.is) == (&own.was, &own.is))
    };
    let others: Vec<Content> = contents().filter(|other| *other != content).collect();
    let matters =
        |(path, _): &&(String, String)| others.iter().any(|other| same(path, *other) != Some(true));
    members.iter().filter(|member| matters(member)).cloned().collect()
}

/// The difference between the results on a path, with a case that shows it; `None` if all results are equal.
fn changed(
    pair: &Pair<'_>,
    drawn: &Arguments,
    (rows, count, simpler): (&[u32], usize, usize),
) -> Result<Option<(PathChange, Vec<u32>)>, ProbeError> {
    let (function, of_old) = (&pair.new.probed.function, &pair.old.probed.function);
    let scalars = function.result.lanes();
    let results = pair.results(rows, count)?;
    let width = rows.len() / count.max(1);
    let words = |(was, is): (&[u32], &[u32])| {
        let all = pair.shared.results.iter();
        all.map(|(old, new)| (scalars[*new], was[*old], is[*new])).collect::<Vec<_>>()
    };
    let shows = |row: &[u32], both: (&[u32], &[u32])| -> Option<Evidence> {
        let words = words(both);
        let all = || words.iter().copied();
        let clear = all().filter_map(|(scalar, was, is)| clarity(scalar, was, is)).max()?;
        let far = all().filter_map(|(scalar, was, is)| distance(scalar, was, is)).max()?;
        Some((clear, drawn.domain.admits(row) != Some(false), far))
    };
    // Among equally clear cases, the first one is the simplest, because edges come first.
    let row_of = |case: usize| &rows[case * width..][..width];
    let evidence = |case| Some((shows(row_of(case), results.of(case))?, std::cmp::Reverse(case)));
    let Some((best, std::cmp::Reverse(first))) = (0..count).filter_map(evidence).max() else {
        return Ok(None);
    };
    let (mut total, mut largest) = (0, Largest::default());
    for case in 0..count {
        let each = words(results.of(case)).into_iter();
        let far = each.filter_map(|(scalar, was, is)| largest.add(scalar, was, is)).max();
        total += usize::from(far.is_some());
    }
    let is_as_good =
        |(clear, usual, far): Evidence| (clear, usual) >= (best.0, best.1) && far.is_like(best.2);
    let (mut row, mut left) = (row_of(first).to_vec(), simpler);
    for _ in 0..SIMPLER {
        let simpler = drawn.domain.shrink(&row);
        let all = simpler.concat();
        if simpler.is_empty() || width == 0 || simpler.len() > left {
            break;
        }
        left -= simpler.len();
        let results = pair.results(&all, simpler.len())?;
        let found = (0..simpler.len())
            .find(|at| shows(&simpler[*at], results.of(*at)).is_some_and(is_as_good));
        match found {
            Some(at) => row.clone_from(&simpler[at]),
            None => break,
        }
    }
    let result = pair.results(&row, 1)?;
    let (was, is) = result.of(0);
    let differs =
        |(old, new): &&(usize, usize)| distance(scalars[*new], was[*old], is[*new]).is_some();
    let (old, new): (Vec<usize>, Vec<usize>) =
        pair.shared.results.iter().filter(differs).copied().unzip();
    let is_whole = pair.shared.is_same();
    let matter = lanes_that_matter(pair, (rows, count, simpler), &row, &result)?;
    let mut arguments = function.arguments(&row);
    let mut at = 0;
    arguments.retain(|(name, _)| {
        let shape = function.parameters.iter().find(|(known, _)| known == name);
        let lanes = shape.map_or(0, |(_, shape)| shape.lanes().len());
        at += lanes;
        lanes == 0 || matter[at - lanes..at].contains(&true)
    });
    let change = PathChange {
        path: pair.new.path.to_string(),
        cases: (total, count),
        ulp: largest.ulp,
        relative: largest.relative,
        arguments,
        given: function.arguments(&row),
        before: told(&of_old.result, was, &old, is_whole),
        after: told(&function.result, is, &new, is_whole),
        clarity: best.0,
        words: Vec::new(),
    };
    Ok(Some((change, row)))
}

/// Checks for each argument lane (scalar) if it affects the change. A lane affects the change if the results for `row`
/// change when the lane gets its value from another case. If the work budget allows no further runs, each lane counts
/// as affecting the change.
fn lanes_that_matter(
    pair: &Pair<'_>,
    (rows, count, allowed): (&[u32], usize, usize),
    row: &[u32],
    result: &Results,
) -> Result<Vec<bool>, ProbeError> {
    let width = row.len();
    let mut all = Vec::new();
    let others = count.min(OTHER_WORDS).min(allowed / width.max(1));
    for lane in 0..width {
        for other in 0..others {
            let mut own = row.to_vec();
            own[lane] = rows[other * count / others * width + lane];
            all.extend(own);
        }
    }
    let results = match width * others {
        0 => return Ok(vec![true; width]),
        cases => pair.results(&all, cases)?,
    };
    let matters = |case: usize| results.of(case) != result.of(0);
    Ok((0..width).map(|lane| (0..others).any(|other| matters(lane * others + other))).collect())
}
