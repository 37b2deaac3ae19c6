//! Measures which operations some inputs reach, and which branches these inputs take.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};

use karat_engine::{F32, Here, Lanes, Observer, Program as Lowered, Site, Wrong};

use super::dispatch::in_order;
use super::sanitizer::made_up_options;
use super::trace::Traced as _;
use super::{Alone, Interpreted, statement_of};
use crate::diagnostic::Span;
use crate::dispatch::{DispatchError, Passes};
use crate::fixture::Fixtures;
use crate::hazard::Kind;
use crate::package::DISCARDED;
use crate::probe::{ProbeError, Probed};
use crate::reflect::Program;

/// The operations of a program by their positions in source files, with the branches that inputs took.
#[derive(Debug, Default)]
pub struct Coverage {
    by_place: BTreeMap<(String, usize, usize), Seen>,
}

#[derive(Debug)]
struct Seen {
    span: Span,
    reached: bool,
    is_true: bool,
    is_false: bool,
    /// `true` if an index was outside of its array.
    outside: bool,
}

impl Seen {
    fn at(span: Span) -> Self {
        Self { span, reached: false, is_true: false, is_false: false, outside: false }
    }
}

/// A line or branch that only one of two compared versions of a shader has, and that no input reaches.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Uncovered {
    /// `file:line:column`
    pub place: String,
    /// The line in the source file.
    pub text: String,
    /// The part of this line that no input reaches.
    pub missed: Missed,
}

/// The part of a line that no input reaches.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Missed {
    /// The whole line.
    Line,
    /// The true branch of the condition.
    True,
    /// The false branch of the condition.
    False,
    /// Unknown, because the engine doesn't run the line.
    Unmeasured,
}

#[derive(Default)]
struct Taken {
    reached: AtomicBool,
    is_true: AtomicBool,
    is_false: AtomicBool,
    outside: AtomicBool,
}

/// For each site (operation) of a program, in order, the branches that cases took.
struct AllTaken {
    all: Vec<Taken>,
    /// The sites of `discard`. `discarded` has the cases that reached such a site. The later operations of these cases
    /// count as not reached, because no output depends on these operations.
    discards: BTreeSet<usize>,
    discarded: Mutex<BTreeSet<usize>>,
}

impl Observer<F32> for AllTaken {
    fn reached(&self, here: &Here<'_, F32>) {
        let number = here.site.number;
        if !self.discards.is_empty() {
            let mut discarded = self.discarded.lock().unwrap_or_else(PoisonError::into_inner);
            let lanes = here.lanes();
            let cases = || (here.case..).zip(lanes.iter()).filter(|(_, is)| **is).map(|(at, _)| at);
            if self.discards.contains(&number) {
                discarded.extend(cases());
            } else if !discarded.is_empty() && cases().all(|case| discarded.contains(&case)) {
                return;
            }
        }
        self.all[number].reached.store(true, Ordering::Relaxed);
    }

    fn others(&self, lanes: &Lanes<'_, F32>) {
        let taken = self.of(lanes.site);
        for values in lanes.bools {
            for (&is, _) in values.iter().zip(lanes.active).filter(|(_, active)| **active) {
                let way = if is { &taken.is_true } else { &taken.is_false };
                way.store(true, Ordering::Relaxed);
            }
        }
    }

    fn wrong(&self, one: &Wrong<'_>) {
        if one.kind == Kind::OutOfRange {
            self.of(one.site).outside.store(true, Ordering::Relaxed);
        }
    }
}

impl AllTaken {
    fn none(lowered: &Lowered, program: &Program) -> Self {
        let all = lowered.sites().iter().map(|_| Taken::default()).collect();
        let is_discard = |site: &Site| {
            let text = site.span.to_range().and_then(|range| program.text().get(range));
            text.is_some_and(|text| text.trim_end_matches(';') == DISCARDED)
        };
        let numbered = lowered.sites().iter().enumerate();
        let discards = numbered.filter(|(_, site)| is_discard(site)).map(|(at, _)| at).collect();
        Self { all, discards, discarded: Mutex::default() }
    }

    fn of(&self, site: &Site) -> &Taken {
        &self.all[site.number]
    }
}

impl Coverage {
    /// Runs calls of a function, and adds the operations that they reach.
    pub fn add_calls(
        &mut self,
        probed: &Probed,
        fixtures: &Fixtures,
        (count, rows): (usize, &[u32]),
    ) -> Result<(), ProbeError> {
        match probed.function().form.alone {
            false => {
                let called = Interpreted::new(probed, fixtures)?;
                let (lowered, program) = called.parts();
                let taken = AllTaken::none(lowered, program);
                called.observed(count, rows, &called.options(), &taken)?;
                self.add(called.parts(), &taken);
            }
            true => {
                let called = Alone::new(probed, fixtures)?;
                let (lowered, program) = called.parts();
                let taken = AllTaken::none(lowered, program);
                let width = rows.len() / count.max(1);
                for case in 0..count {
                    called.run(&rows[case * width..][..width], &taken)?;
                }
                self.add(called.parts(), &taken);
            }
        }
        Ok(())
    }

    /// Runs passes over generated resources, and adds the operations that their invocations reach.
    pub fn add_passes(&mut self, passes: &Passes) -> Result<(), DispatchError> {
        in_order(passes, &mut |pass, lowered, resources| {
            let taken = AllTaken::none(lowered, &pass.program);
            lowered.dispatch::<F32>(pass.workgroups, resources, &made_up_options(), &taken)?;
            self.add((lowered, &pass.program), &taken);
            Ok(true)
        })?;
        Ok(())
    }

    fn add(&mut self, (lowered, program): (&Lowered, &Program), taken: &AllTaken) {
        let is = |way: &AtomicBool| way.load(Ordering::Relaxed);
        for site in lowered.operations() {
            let Some(span) = statement_of(program, site) else { continue };
            let place = (span.file.name.clone(), span.range.start, span.range.end);
            let known = self.by_place.entry(place).or_insert_with(|| Seen::at(span));
            let own = taken.of(site);
            known.reached |= is(&own.reached);
            known.is_true |= is(&own.is_true);
            known.is_false |= is(&own.is_false);
            known.outside |= is(&own.outside);
        }
    }

    /// The new lines that no input reached, and the new conditions that had one result for all inputs. An operation is
    /// new if its text occurs more often in this version than in the version `other`.
    pub fn uncovered_beside(&self, other: &Self) -> Vec<Uncovered> {
        let mut lines: Vec<Uncovered> = Vec::new();
        let mut known = None;
        for seen in self.more_than(other, |_| true) {
            let missed = match (seen.reached, seen.is_true, seen.is_false) {
                (false, ..) => Missed::Line,
                (true, false, true) => Missed::True,
                (true, true, false) => Missed::False,
                _ => continue,
            };
            let span = &seen.span;
            let (line, _) = span.file.line_column(span.range.start);
            if known.replace((&span.file.name, line)) != Some((&span.file.name, line)) {
                let text = span.file.text.lines().nth(line.saturating_sub(1)).unwrap_or_default();
                let (place, text) = (span.to_string(), text.trim().to_owned());
                lines.push(Uncovered { place, text, missed });
            }
        }
        lines
    }

    /// The positions where an index was outside of its array in this version, but not in the version `other`.
    pub fn outside_beside(&self, other: &Self) -> Vec<Span> {
        self.more_than(other, |seen| seen.outside).map(|seen| seen.span.clone()).collect()
    }

    /// The operations of this version for which `is` returns `true`. Leaves out an operation if the version `other` has
    /// at least as many such operations with the same text.
    fn more_than<'r>(
        &'r self,
        other: &Self,
        is: impl Fn(&Seen) -> bool + Copy + 'r,
    ) -> impl Iterator<Item = &'r Seen> {
        let mut more = BTreeMap::<String, i64>::new();
        let of = |reach: &Self| -> Vec<String> {
            let all = reach.by_place.values().filter(|seen| is(seen));
            all.map(|seen| plain(&seen.span)).collect()
        };
        of(self).into_iter().for_each(|text| *more.entry(text).or_default() += 1);
        of(other).into_iter().for_each(|text| *more.entry(text).or_default() -= 1);
        let own = self.by_place.values().filter(move |seen| is(seen));
        own.filter(move |seen| more[&plain(&seen.span)] > 0)
    }
}

/// For each scalar of the calls' results, `true` if the scalar depends on a read or a write outside of an array.
pub fn of_outside(
    probed: &Probed,
    fixtures: &Fixtures,
    (count, rows): (usize, &[u32]),
) -> Result<Vec<bool>, ProbeError> {
    match probed.function().form.alone {
        false => Interpreted::new(probed, fixtures)?.of_outside(count, rows),
        true => Alone::new(probed, fixtures)?.of_outside(count, rows),
    }
}

/// The text of an operation without white space.
fn plain(span: &Span) -> String {
    span.file.text.get(span.range.clone()).unwrap_or_default().split_whitespace().collect()
}
