//! Finds the first operation that returns different values in the usual order of invocations and in another order.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use karat_engine::{F32, Lanes, Observer, Options, Settings, Site};

use super::dispatch::{Prepared, options};
use super::order::{OrderOf, options_in};
use crate::diagnostic::Span;
use crate::dispatch::Passes;
use crate::value::{Scalar, format_lane};

/// The largest number of results that Karat records in a pass. These take 24 MiB. The first difference between two
/// orders usually comes early.
const MOST: usize = 1 << 20;

/// A value that an operation returned to an invocation during a run.
#[derive(Clone, Copy)]
struct Given {
    /// The operation's site: its address in memory during the run, and its index after the run.
    site: usize,
    case: u32,
    word: u32,
    scalar: Scalar,
}

#[derive(Default)]
struct Results(Mutex<Vec<Given>>);

impl Results {
    fn add(&self, lanes: &Lanes<'_, F32>, scalar: Scalar, word: impl Fn(usize) -> u32) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let site = std::ptr::from_ref(lanes.site).addr();
        let room = MOST.saturating_sub(all.len());
        let active = lanes.active.iter().enumerate().filter(|(_, active)| **active);
        all.extend(active.take(room).map(|(lane, _)| {
            let case = u32::try_from(lanes.case_of(lane)).unwrap_or(u32::MAX);
            Given { site, case, word: word(lane), scalar }
        }));
    }
}

impl Observer<F32> for Results {
    fn floats(&self, lanes: &Lanes<'_, F32>) {
        for values in lanes.floats {
            self.add(lanes, Scalar::F32, |lane| values[lane].to_bits());
        }
    }

    fn others(&self, lanes: &Lanes<'_, F32>) {
        self.floats(lanes);
        for values in lanes.ints {
            self.add(lanes, Scalar::U32, |lane| values[lane]);
        }
        for values in lanes.bools {
            self.add(lanes, Scalar::Bool, |lane| u32::from(values[lane]));
        }
    }
}

/// The largest number of atomics that a message lists.
const TOLD: usize = 16;

#[derive(Debug, Default)]
pub(crate) struct Turns {
    /// For each atomic, in the order in which they run, a line of a message. The list is empty if there are more than
    /// [`TOLD`] atomics.
    lines: Vec<String>,
    /// A store that other invocations saw only after a later atomic of the same invocation: its position and a note.
    pub(crate) late: Option<(Span, String)>,
}

impl Turns {
    /// The atomics as notes for a message.
    pub(crate) fn told(&self) -> Vec<String> {
        let order = (!self.lines.is_empty())
            .then(|| format!("the atomics run in this order:\n{}", self.lines.join("\n")));
        let relaxed = self.late.as_ref().map(|(_, late)| {
            format!(
                "{late}: WGSL's atomics are relaxed (15.4, *Memory model*), so other invocations may see the two operations in another \
                 order. A barrier between the two operations orders them for one workgroup. If the second operation runs in a later \
                 pass, every workgroup sees the first operation first. You can also store both values in one atomic"
            )
        });
        order.into_iter().chain(relaxed).collect()
    }
}

/// Runs passes in one order, and returns their atomics, sorted by the time at which they take effect.
pub(super) fn turns(prepared: &Prepared<'_>, order: &OrderOf) -> Turns {
    let mut all = Turns::default();
    let (mut number, mut count) = (0, 0);
    // If a loop doesn't end in this order, the earlier atomics are still known.
    let ran = prepared.run(&mut |pass, lowered, resources| {
        let base = Options { shows_order: true, ..options() };
        let own = options_in(number, Some(order), &base);
        number += 1;
        let observed = lowered.observe_races(pass.workgroups, resources, &own, None)?;
        let size = lowered.workgroup_size().expect("a pass is an entry point");
        count += observed.order.len();
        for turn in observed.order {
            let author = |site: &Site| super::author_of(&pass.program, site);
            let Some((span, text)) = author(&turn.site) else { continue };
            let who = super::invocation(pass, size, turn.invocation);
            let verb = if turn.reads { "gives" } else { "writes" };
            let line = format!("  {who}: `{text}` {verb} {} ({span})", turn.word);
            if all.lines.len() < TOLD {
                all.lines.push(line);
            }
            if let (None, Some((other, behind))) = (&all.late, turn.behind.as_ref().and_then(author)) {
                let late = format!(
                    "{who} runs `{text}` ({span}) before `{behind}` ({other}), but other invocations see the two operations in the opposite order"
                );
                all.late = Some((span, late));
            }
        }
        Ok(true)
    });
    drop(ran);
    if count > TOLD {
        all.lines.clear();
    }
    all
}

pub(crate) struct Parting {
    /// The first operation that returns different values to an invocation in this order and in the usual order: its
    /// position, and a clause that names the invocation and both values. `None` if only the order of writes differs.
    pub(crate) first: Option<(Span, String)>,
    pub(crate) turns: Turns,
}

pub(crate) fn parting(passes: &Passes, order: &OrderOf) -> Option<Parting> {
    let prepared = Prepared::new(passes, &Settings::default()).ok()?;
    Some(Parting { first: first(&prepared, order), turns: turns(&prepared, order) })
}

fn first(prepared: &Prepared<'_>, order: &OrderOf) -> Option<(Span, String)> {
    let passes = prepared.passes;
    let run = |order: Option<&OrderOf>| {
        let mut of_passes = Vec::new();
        // If a loop doesn't end in this order, the earlier results are still known.
        let ran = prepared.run(&mut |pass, lowered, resources| {
            let results = Results::default();
            let options = options_in(of_passes.len(), order, &options());
            let ran = lowered.dispatch::<F32>(pass.workgroups, resources, &options, &results);
            let size = lowered.workgroup_size().expect("a pass is an entry point");
            let mut all = results.0.into_inner().unwrap_or_else(PoisonError::into_inner);
            let first = lowered.sites().as_ptr().addr();
            all.iter_mut().for_each(|one| one.site = (one.site - first) / size_of::<Site>());
            let place = |site: &Site| {
                let signed = site.expression.is_some_and(|expression| {
                    pass.program.is_signed(&site.function, expression.index())
                });
                Some((super::author_of(&pass.program, site)?, signed))
            };
            let places: Vec<_> = lowered.sites().iter().map(place).collect();
            of_passes.push((all, size, places));
            ran.map(|()| true)
        });
        drop(ran);
        of_passes
    };
    let (usual, other) = (run(None), run(Some(order)));
    for (number, ((usual, size, places), (other, ..))) in usual.iter().zip(&other).enumerate() {
        let mut known: HashMap<(usize, u32), Vec<Given>> = HashMap::new();
        for one in other {
            known.entry((one.site, one.case)).or_default().push(*one);
        }
        let mut counts: HashMap<(usize, u32), usize> = HashMap::new();
        for one in usual {
            let key = (one.site, one.case);
            let count = counts.entry(key).or_default();
            let there = known.get(&key).and_then(|all| all.get(*count));
            *count += 1;
            let Some(there) = there.filter(|there| there.word != one.word) else { continue };
            let Some(((span, text), signed)) = &places[one.site] else { continue };
            let invocation = super::invocation(&passes.passes[number], *size, one.case as usize);
            let [usual, other] = [one, there].map(|given| match given.scalar {
                Scalar::U32 if *signed => format_lane(Scalar::I32, given.word),
                scalar => format_lane(scalar, given.word),
            });
            let says = format!(
                "`{text}` gives {invocation} the value {other} in this order, and {usual} in the usual order"
            );
            return Some((span.first_line(), says));
        }
    }
    None
}
