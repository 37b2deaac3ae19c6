//! The operations that inputs come to.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};

use karat_engine::{F32, Observer, Program as Lowered};

use super::dispatch::in_order;
use super::sanitizer::made_up_options;
use super::trace::Traced as _;
use super::{Alone, Interpreted, statement_of};
use crate::diagnostic::Span;
use crate::dispatch::{DispatchError, Passes};
use crate::fixture::Fixtures;
use crate::probe::{ProbeError, Probed};
use crate::reflect::Program;

/// The places of operations, and whether some input came there.
#[derive(Debug, Default)]
pub(crate) struct Reach {
    by_place: BTreeMap<(String, usize, usize), (Span, bool)>,
}

/// An operation that no input came to.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Unreached {
    /// `file:line:column`
    pub place: String,
    /// Its line, as the author wrote it.
    pub text: String,
}

/// Sites by their numbers.
struct Reached(Vec<AtomicBool>);

impl Observer<F32> for Reached {
    fn reached(&self, site: usize) {
        self.0[site].store(true, Ordering::Relaxed);
    }
}

impl Reached {
    fn of(lowered: &Lowered) -> Self {
        Self(lowered.sites().iter().map(|_| AtomicBool::new(false)).collect())
    }
}

impl Reach {
    /// Adds what calls of a function come to.
    pub(crate) fn add_calls(
        &mut self,
        probed: &Probed,
        fixtures: &Fixtures,
        (count, rows): (usize, &[u32]),
    ) -> Result<(), ProbeError> {
        match probed.function().form.alone {
            false => {
                let called = Interpreted::new(probed, fixtures)?;
                let reached = Reached::of(called.parts().0);
                called.observed(count, rows, &called.options(), &reached)?;
                self.add(called.parts(), &reached);
            }
            true => {
                let called = Alone::new(probed, fixtures)?;
                let reached = Reached::of(called.parts().0);
                let width = rows.len() / count.max(1);
                for case in 0..count {
                    called.run(&rows[case * width..][..width], &reached)?;
                }
                self.add(called.parts(), &reached);
            }
        }
        Ok(())
    }

    /// Adds what the invocations of passes over made-up resources come to.
    pub(crate) fn add_passes(&mut self, passes: &Passes) -> Result<(), DispatchError> {
        in_order(passes, &mut |pass, lowered, resources| {
            let reached = Reached::of(lowered);
            lowered.dispatch::<F32>(pass.workgroups, resources, &made_up_options(), &reached)?;
            self.add((lowered, &pass.program), &reached);
            Ok(true)
        })?;
        Ok(())
    }

    fn add(&mut self, (lowered, program): (&Lowered, &Program), reached: &Reached) {
        for site in lowered.operations().collect::<BTreeSet<_>>() {
            let reached = &reached.0[site];
            if let Some(span) = statement_of(program, &lowered.sites()[site]) {
                let place = (span.file.name.clone(), span.range.start, span.range.end);
                let known = self.by_place.entry(place).or_insert((span, false));
                known.1 |= reached.load(Ordering::Relaxed);
            }
        }
    }

    /// The lines that no input came to, of operations that the other side of an edit has fewer of.
    pub(crate) fn unreached_beside(&self, other: &Self) -> Vec<Unreached> {
        let mut more = BTreeMap::<String, i64>::new();
        self.spans().for_each(|span| *more.entry(plain(span)).or_default() += 1);
        other.spans().for_each(|span| *more.entry(plain(span)).or_default() -= 1);
        let mut lines: Vec<Unreached> = Vec::new();
        let mut known = None;
        for (span, reached) in self.by_place.values() {
            if *reached || more[&plain(span)] <= 0 {
                continue;
            }
            let (line, _) = span.file.line_column(span.range.start);
            if known.replace((&span.file.name, line)) != Some((&span.file.name, line)) {
                let text = span.file.text.lines().nth(line.saturating_sub(1)).unwrap_or_default();
                lines.push(Unreached { place: span.to_string(), text: text.trim().to_owned() });
            }
        }
        lines
    }

    fn spans(&self) -> impl Iterator<Item = &Span> {
        self.by_place.values().map(|(span, _)| span)
    }
}

/// The text of an operation without its blanks.
fn plain(span: &Span) -> String {
    span.file.text.get(span.range.clone()).unwrap_or_default().split_whitespace().collect()
}
