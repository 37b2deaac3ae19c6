//! Finds hazards in functions: runs them over generated arguments and resources, and searches for inputs that avert a
//! finding.

use std::collections::{BTreeMap, BTreeSet};

use karat::unstable::check::cause_of;
use karat::unstable::interpret::hazards::{Found, Hazards as InCases, Kind, LONG};
use karat::unstable::interpret::{Interpreted, long_cases};
use karat::unstable::probe::{ProbeError, Probed};
use karat_core::diagnostic::Span;

use super::{Class, Hazard, Seen, first_line, one_line, operands, parted, shown};
use crate::limits::{
    ALL_HOLDS, CONTENTS, DRAWS, HELD, HOLDS, INPUTS_TRIED, KEPT, LONG_CASES, MEMBERS, SEED, VARIED,
    WORK,
};
use crate::made_up::{Arguments, Content, Input, Mix, Ranges, Resources};
use crate::work::{Chosen, ENDS_FOR_NONE, Side};

use rayon::prelude::*;

/// The number of an operation, and the kind of its error.
pub(super) type Key = (usize, Kind);

/// The contents (sets of generated values) of the resources. All cases run over the first content, and some cases also
/// run over each further content.
const CONTENTS_TRIED: &[Content] = &Content::OF_FUNCTIONS;
const FIRST: Content = Content::OF_FUNCTIONS[0];

/// The number in the [`Key`] of a possibly endless loop. Such a finding has no operation.
const LOOP: usize = usize::MAX;

/// A function, the inputs over which Karat runs the function, and the findings of this run.
pub(super) struct Trial {
    name: String,
    probed: Probed,
    ranges: Ranges,
    arguments: Arguments,
    rows: Vec<u32>,
    count: usize,
    contents: &'static [Content],
    main: Tally,
}

#[derive(Clone, Debug)]
struct Case {
    content: Content,
    row: Vec<u32>,
}

#[derive(Clone, Debug)]
struct Gathered {
    /// The error in the simplest case.
    found: Found,
    case: Case,
    members: Vec<(String, String)>,
    oddity: [usize; 2],
    /// The number of cases in which the result, a condition or an index depends on the wrong value.
    wrong: usize,
    dropped: usize,
    failing: Vec<Case>,
    /// The numbers of the failing cases over the first content.
    numbers: Vec<usize>,
    kinds: BTreeSet<Kind>,
    /// The content and the number of the last counted case, so that no case counts twice.
    last: Option<(Content, usize)>,
}

#[derive(Debug, Default)]
struct Tally {
    cases: usize,
    /// The arguments of all cases that run over the first content.
    rows: Vec<u32>,
    /// For each operation: the number of cases that reached it, and the number of contents with such cases.
    reached: BTreeMap<usize, [usize; 2]>,
    found: BTreeMap<Key, Gathered>,
    cut: usize,
    in_part: bool,
    /// The number of cases in which a loop has too many iterations.
    long: usize,
}

impl Tally {
    fn reached(&self, (site, _): Key) -> [usize; 2] {
        self.reached.get(&site).copied().unwrap_or_default()
    }

    /// Checks if the operation goes wrong in each case that reaches it, and if enough cases reach it.
    fn is_always(&self, key: Key) -> bool {
        let wrong = self.found.get(&key).map_or(0, |one| one.wrong);
        let [cases, contents] = self.reached(key);
        wrong > 0 && wrong >= cases && (wrong >= DRAWS || contents >= CONTENTS)
    }

    /// Checks if at least one case reaches the operation without the error.
    fn is_averted(&self, key: Key) -> bool {
        let wrong = self.found.get(&key).map_or(0, |one| one.wrong);
        wrong < self.reached(key)[0]
    }
}

/// Selects the inputs that take their values from another content (another set of generated values).
type Takes<'t> = &'t (dyn Fn(&Input) -> bool + Sync);

/// Keeps each finding of a run, so that one finding doesn't hide another finding of the same kind.
const EACH: &(dyn Fn(&Found) -> bool + Sync) = &|_| true;

impl Trial {
    /// Runs a function that has no side effects, and collects its findings.
    pub(super) fn of(
        name: &str,
        probed: Probed,
        ranges: Ranges,
        cases: usize,
    ) -> Result<Self, String> {
        let ranges = ranges.with_literals(probed.program.literals());
        let arguments = Arguments::of(probed.function(), &ranges)?;
        let (count, mut rows) = arguments.rows(SEED, cases);
        arguments.without_subnormals(&mut rows);
        let first = Resources::of(&probed, &ranges, FIRST)?;
        let contents = if first.varies { CONTENTS_TRIED } else { &CONTENTS_TRIED[..1] };
        let main = Tally::default();
        let name = name.to_owned();
        let mut trial = Self { name, probed, ranges, arguments, rows, count, contents, main };
        trial.main = trial.tried()?;
        if trial.main.long > 0 && !trial.main.rows.is_empty() {
            trial.rows.clone_from(&trial.main.rows);
        }
        match trial.main.cases {
            0 if trial.main.found.is_empty() => Err(ENDS_FOR_NONE.to_owned()),
            _ => Ok(trial),
        }
    }

    fn chosen(&self, resources: &Resources, (count, rows): (usize, &[u32])) -> Chosen {
        let Self { probed, arguments, .. } = self;
        let side = Side { probed, fixtures: &resources.fixtures, own: None };
        Chosen::of(&[side], arguments, (count, rows), WORK)
    }

    fn tried(&self) -> Result<Tally, String> {
        // Runs the contents in parallel. Otherwise, a function with long loops would use only one core.
        let looked = self.contents.par_iter().map(|content| {
            let resources = Resources::of(&self.probed, &self.ranges, *content)?;
            let (count, rows) = self.arguments.part(&self.rows, self.count, content.draw);
            let chosen = self.chosen(&resources, (count, &rows));
            let engine = Interpreted::new(&self.probed, &resources.fixtures);
            let seen =
                engine.and_then(|engine| engine.hazards_but(chosen.count, &chosen.rows, EACH));
            let seen = seen.map_err(|error| first_line(&error.to_string()))?;
            Ok::<_, String>((resources, chosen, seen))
        });
        let mut tally = Tally::default();
        for (content, one) in self.contents.iter().zip(looked.collect::<Vec<_>>()) {
            let (resources, chosen, seen) = one?;
            tally.cut += chosen.cut;
            let little = |(row, _): &&(Vec<u32>, Span)| self.arguments.counts_little(row);
            let open = LONG_CASES.saturating_sub(tally.long);
            tally.long += chosen.long.len();
            for one in chosen.long.iter().filter(little).take(open) {
                let added = self.endless(&mut tally, one, &resources);
                added.map_err(|error| first_line(&error.to_string()))?;
            }
            self.add(&mut tally, (*content, &resources), &chosen.rows, &seen);
        }
        // In these cases, all loops ended.
        let ended = tally.cases;
        tally.reached.entry(LOOP).and_modify(|[cases, _]| *cases += ended);
        Ok(tally)
    }

    /// Adds a finding if a loop is possibly endless, and counts the samples of free inputs for which the loop has too
    /// many iterations.
    fn endless(
        &self,
        tally: &mut Tally,
        (row, at): &(Vec<u32>, Span),
        resources: &Resources,
    ) -> Result<(), ProbeError> {
        let key = (LOOP, Kind::Endless);
        let engine = Interpreted::new(&self.probed, &resources.fixtures)?;
        if tally.found.contains_key(&key) || !engine.may_not_end(row, LONG) {
            return Ok(());
        }
        let others = self.arguments.held(row, &self.rows, DRAWS);
        let long = long_cases(&self.probed, &resources.fixtures, (DRAWS, &others))?;
        tally.reached.insert(LOOP, [1 + DRAWS, 1]);
        let text = at.file.text.get(at.range.clone()).unwrap_or_default().to_owned();
        let (hidden, values, operands, missing) = Default::default();
        let (site, kind) = key;
        let found = Found { kind, site, span: at.clone(), text, hidden, values, operands, missing };
        let case = Case { content: FIRST, row: row.clone() };
        let gathered = Gathered {
            found,
            members: resources.members.clone(),
            oddity: [0; 2],
            wrong: 1 + long.len(),
            dropped: 0,
            failing: vec![case.clone()],
            case,
            numbers: Vec::new(),
            kinds: BTreeSet::from([kind]),
            last: None,
        };
        tally.found.insert(key, gathered);
        Ok(())
    }

    fn add(
        &self,
        tally: &mut Tally,
        (content, resources): (Content, &Resources),
        rows: &[u32],
        seen: &InCases,
    ) {
        let width = self.arguments.width();
        tally.cases += seen.cases.len();
        tally.in_part |= seen.cut;
        if content == FIRST {
            tally.rows = rows.to_vec();
        }
        for (site, count) in &seen.reached {
            let [cases, contents] = tally.reached.entry(*site).or_default();
            (*cases, *contents) = (*cases + count, *contents + usize::from(*count > 0));
        }
        for (case, found) in seen.cases.iter().enumerate() {
            let row = &rows[case * width..][..width];
            let oddity = if found.is_empty() { [0; 2] } else { self.arguments.oddity(row) };
            for one in found {
                let own = || Case { content, row: row.to_vec() };
                let new = || Gathered {
                    found: one.clone(),
                    case: own(),
                    members: resources.members.clone(),
                    oddity,
                    wrong: 0,
                    dropped: 0,
                    failing: Vec::new(),
                    numbers: Vec::new(),
                    kinds: BTreeSet::new(),
                    last: None,
                };
                // NaN and infinity are two kinds of the same finding.
                let kind = if one.kind == Kind::Infinite { Kind::Nan } else { one.kind };
                let known = tally.found.entry((one.site, kind)).or_insert_with(new);
                known.kinds.insert(one.kind);
                // A case that shows the wrong value is worse than a case that drops it.
                let rank = |one: &Found, oddity: [usize; 2]| (one.hidden, oddity, one.kind);
                if rank(one, oddity) < rank(&known.found, known.oddity) {
                    (known.found, known.case) = (one.clone(), own());
                    (known.members, known.oddity) = (resources.members.clone(), oddity);
                }
                // One component of a vector may be NaN while another is infinite.
                if known.last == Some((content, case)) {
                    continue;
                }
                known.last = Some((content, case));
                match one.hidden {
                    true => known.dropped += 1,
                    false => {
                        known.wrong += 1;
                        if content == FIRST {
                            known.numbers.push(case);
                        }
                        if known.failing.len() < KEPT {
                            known.failing.push(own());
                        }
                    }
                }
            }
        }
    }

    /// Runs the function with the declared inputs of a case, and with new samples of the free inputs.
    fn held(&self, case: &Case) -> Tally {
        let takes = |input: &Input| input.known;
        self.again(&takes, &|content| {
            let count = HELD[usize::from(content != FIRST)];
            let rows = self.arguments.held(&case.row, &self.rows, count);
            (case.content, count, rows)
        })
    }

    /// Runs the function over each content (set of generated values). For each content, `rows` returns the arguments,
    /// and also another content. The inputs that `takes` selects get their values from this other content.
    fn again(
        &self,
        takes: Takes<'_>,
        rows: &(dyn Fn(Content) -> (Content, usize, Vec<u32>) + Sync),
    ) -> Tally {
        let ran = self.contents.par_iter().map(|content| {
            let (other, count, rows) = rows(*content);
            let count = if self.arguments.width() == 0 { 1 } else { count };
            (*content, self.run((*content, other, takes), (count, &rows)))
        });
        let mut tally = Tally::default();
        for (content, seen) in ran.collect::<Vec<_>>() {
            if let Some((resources, rows, seen)) = seen {
                self.add(&mut tally, (content, &resources), &rows, &seen);
            }
        }
        tally
    }

    fn run(
        &self,
        (content, other, takes): (Content, Content, Takes<'_>),
        (count, rows): (usize, &[u32]),
    ) -> Option<(Resources, Vec<u32>, InCases)> {
        let mix = Mix { content: other, extents: None, takes };
        let resources = Resources::mixed(&self.probed, &self.ranges, content, &mix).ok()?;
        let engine = Interpreted::new(&self.probed, &resources.fixtures).ok()?;
        let side = Side { probed: &self.probed, fixtures: &resources.fixtures, own: None };
        let Chosen { count, rows, .. } = Chosen::ending(&side, &self.arguments, (count, rows));
        let seen = engine.hazards_but(count, &rows, EACH).ok()?;
        Some((resources, rows, seen))
    }

    fn inputs(&self) -> Vec<Input> {
        let made = Resources::of(&self.probed, &self.ranges, FIRST);
        made.map(|made| made.inputs).unwrap_or_default()
    }

    /// Runs the function again, and classifies its findings as faults or requirements.
    pub(super) fn judge(&self, hazards: &mut [Hazard], keys: &[Key]) {
        let (inputs, mut holds) = (self.inputs(), BTreeMap::new());
        for (hazard, key) in hazards.iter_mut().zip(keys) {
            let Some(one) = self.main.found.get(key) else { continue };
            if hazard.class != Class::Requirement {
                continue;
            }
            let (class, held) = self.class(*key, one, &inputs, &mut holds);
            hazard.class = class;
            // Keeps only the inputs whose change doesn't avert the error.
            if let Some(case) = held.filter(|case| case.row != one.case.row) {
                let made = Resources::of(&self.probed, &self.ranges, case.content);
                let members = made.map(|made| made.members).unwrap_or_default();
                hazard.arguments = self.described(&case.row, &members);
                (hazard.operands, hazard.values) = (Vec::new(), None);
            }
        }
    }

    fn class(
        &self,
        key: Key,
        gathered: &Gathered,
        inputs: &[Input],
        holds: &mut BTreeMap<(Content, Vec<u32>), Tally>,
    ) -> (Class, Option<Case>) {
        let all = |is: fn(&Input) -> bool| inputs.iter().all(is);
        let is_declared = self.arguments.are_declared() && all(|one| one.declared);
        let nothing_free = self.arguments.are_known() && all(|one| one.known);
        let known = inputs.iter().any(|one| one.known);
        match key.1 {
            // WGSL requires uniform control flow for all data (15.2).
            Kind::Barrier => return (Class::Fault, None),
            kind if is_of_wgsl(kind) && !is_declared => return (Class::Requirement, None),
            _ => {}
        }
        if nothing_free || self.main.is_always(key) {
            return (Class::Fault, None);
        }
        let mut tried = BTreeSet::new();
        let mut failing: Vec<&Case> = gathered.failing.iter().collect();
        failing.sort_by_key(|case| self.arguments.oddity(&case.row));
        for case in std::iter::once(&gathered.case).chain(failing) {
            let words = self.arguments.known_of(&case.row);
            if words.is_empty() && !known {
                break;
            }
            let hold = (if known { case.content } else { FIRST }, words);
            let is_known = holds.contains_key(&hold);
            if tried.len() == HOLDS
                || !is_known && holds.len() == ALL_HOLDS
                || !tried.insert(hold.clone())
            {
                continue;
            }
            let tally = holds.entry(hold).or_insert_with(|| self.held(case));
            if tally.is_always(key) {
                return (Class::Fault, Some(case.clone()));
            }
        }
        (Class::Requirement, None)
    }

    fn described(&self, row: &[u32], members: &[(String, String)]) -> Vec<(String, String)> {
        let mut named =
            if row.is_empty() { Vec::new() } else { self.probed.function().arguments(row) };
        named.extend(members.iter().take(MEMBERS).cloned());
        named
    }

    /// The findings, and the number of cases that reached each position. At first, each finding has the class
    /// `Requirement` or `Dropped`. [`judge`](Self::judge) finds the faults later.
    pub(super) fn seen(self) -> Seen {
        let function = self.probed.function();
        let hazard = |(key, one): (&Key, &Gathered)| {
            let class = if one.wrong == 0 { Class::Dropped } else { Class::Requirement };
            let width = self.arguments.width();
            let named = self.described(&one.case.row, &one.members);
            let rows = &self.main.rows;
            let of = |case: usize| -> &[u32] { &rows[case * width..][..width] };
            let count = rows.len().checked_div(width).unwrap_or(1);
            let fails = cause_of(function, count, &of, &one.numbers);
            // The condition holds for the sampled values. Other values may fail, too.
            let fails = fails.map(|fails| fails.replace(", and nowhere else", ""));
            let reached = self.main.reached(*key)[0].max(one.wrong + one.dropped);
            let hazard = Hazard {
                class,
                kind: one.found.kind,
                kinds: one.kinds.iter().copied().filter(|kind| *kind != one.found.kind).collect(),
                location: one.found.span.to_string(),
                text: one_line(&one.found.text),
                function: self.name.clone(),
                arguments: named,
                cases: (one.wrong.max(one.dropped), reached),
                needs: Vec::new(),
                fails,
                values: shown(&one.found),
                operands: operands(&one.found),
                accepted: None,
                also: Vec::new(),
                violation: parted(&self.name, &one.found),
            };
            (*key, hazard)
        };
        let mut found: Vec<(Key, Hazard)> = self.main.found.iter().map(hazard).collect();
        // The engine knows the positions. The program is the same for each content.
        let engine = Resources::of(&self.probed, &self.ranges, FIRST)
            .ok()
            .and_then(|made| Interpreted::new(&self.probed, &made.fixtures).ok());
        // For each position, the number of cases that reached it. It may be 0.
        let mut reached: BTreeMap<String, usize> = BTreeMap::new();
        for (site, place) in engine.iter().flat_map(Interpreted::places) {
            *reached.entry(place).or_default() += self.main.reached((site, Kind::Nan))[0];
        }
        found.sort_by(|(_, a), (_, b)| {
            (&a.location, &a.text, a.kind).cmp(&(&b.location, &b.text, b.kind))
        });
        // A value that is NaN or infinite for some inputs, and unbounded for others, is one finding.
        found.dedup_by(|(_, next), (_, one)| {
            let is_same = next.kind == Kind::Unbounded
                && (&next.location, &next.text) == (&one.location, &one.text)
                && matches!(one.kind, Kind::Nan | Kind::Infinite);
            if is_same {
                one.kinds.push(next.kind);
            }
            is_same
        });
        let mut drawn = self.arguments.drawn();
        if let Ok(made) = Resources::of(&self.probed, &self.ranges, FIRST) {
            drawn.merge(made.drawn);
        }
        let (cut, in_part) = (self.main.cut, self.main.in_part);
        let (keys, hazards) = found.into_iter().unzip();
        let trial = Some((Box::new(self), keys));
        Seen { hazards, reached, drawn, cut, in_part, trial, ..Seen::default() }
    }

    /// The inputs that can avert the error in the simplest case. A change of any one of these inputs suffices.
    pub(super) fn needs(&self, key: Key) -> Vec<String> {
        let parameters = &self.probed.function().parameters;
        if let ([(name, _)], true) = (&**parameters, self.inputs().is_empty()) {
            return vec![name.clone()];
        }
        let Some(one) = self.main.found.get(&key).filter(|_| key.0 != LOOP) else {
            return Vec::new();
        };
        let of_wgsl = is_of_wgsl(key.1);
        let (free, is_free) =
            (
                self.arguments.free(of_wgsl),
                |input: &Input| {
                    if of_wgsl { !input.declared } else { !input.known }
                },
            );
        let Case { content, row } = &one.case;
        let own = |_: &Input| false;
        let averts = |content, other, takes: Takes<'_>, rows: (usize, &[u32])| {
            let mut tally = Tally::default();
            let Some((resources, rows, seen)) = self.run((content, other, takes), rows) else {
                return false;
            };
            self.add(&mut tally, (content, &resources), &rows, &seen);
            tally.is_averted(key)
        };
        let mut needs = Vec::new();
        let mut first = 0;
        for (name, shape) in &self.probed.function().parameters {
            let lanes = first..first + shape.lanes().len();
            first = lanes.end;
            if !free[lanes.clone()].iter().any(|free| *free) {
                continue;
            }
            let takes = |lane: usize| lanes.contains(&lane) && free[lane];
            let rows = self.arguments.replaced(row, &self.rows, VARIED, &takes);
            if averts(*content, *content, &own, (VARIED, &rows)) {
                needs.push(name.clone());
            }
        }
        let mut inputs = self.inputs();
        let mut known = BTreeSet::new();
        inputs.retain(|one| known.insert(one.path.clone()));
        for input in inputs.iter().filter(|one| is_free(one)).take(INPUTS_TRIED) {
            let takes = |one: &Input| one.path == input.path;
            let mut others = self.contents.iter().filter(|other| *other != content);
            if others.any(|other| averts(*content, *other, &takes, (1, row))) {
                needs.push(input.path.clone());
            }
        }
        needs
    }
}

/// Checks for lost digits, and for operations for which WGSL bounds no error. With arbitrary inputs, most functions
/// have such findings, so they are faults only in functions whose inputs are all declared.
fn is_of_wgsl(kind: Kind) -> bool {
    matches!(kind, Kind::LostDigits | Kind::Unbounded)
}
