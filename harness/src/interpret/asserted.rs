//! Evaluates a shader's assertions and prints in Karat's engine.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::{Arc, Mutex, PoisonError};

use karat_engine::{F32, Lanes, Observer, Program as Lowered, Settings, Site, Wrong};

use super::dispatch::{Prepared, options};
use super::{Interpreted, author};
use crate::diagnostic::{Diagnostic, Span, one_line};
use crate::dispatch::{DispatchError, Passes};
use crate::fixture::Fixtures;
use crate::hazard::Kind;
use crate::output::counted;
use crate::package::asserts::{ASSERTED, PRINTED};
use crate::probe::{ProbeError, Probed};
use crate::reflect::{Program, ReflectError, Valued};
use crate::value::{Scalar, Shape, format_lane};

/// The number of values that Karat keeps for each printing line. The values come from the first cases.
pub(crate) const KEPT: usize = 1024;

/// The number of values that a test's output shows for each printing line.
pub(crate) const SHOWN: usize = 16;

/// A line that prints, with the printed values. `C` identifies a case: by its index during a run, and by its name
/// afterwards.
struct Print<C> {
    span: Span,
    text: String,
    shape: Shape,
    count: u64,
    /// The printed values of the first cases, each with its case.
    first: Vec<(C, Vec<u32>)>,
    /// For each component, the smallest and the largest printed number, with its bits and its case. `None` for
    /// booleans. NaN doesn't count.
    ends: Vec<Option<[(f64, u32, C); 2]>>,
    nans: u64,
    /// The first case in which the line reads outside of an array.
    outside: Option<C>,
}

/// An assertion, and the number of times that it was false.
struct Assertion {
    span: Span,
    text: String,
    count: u64,
    wrong: u64,
    first: Option<usize>,
    /// The first case in which the assertion reads outside of an array.
    outside: Option<usize>,
}

enum Line {
    Print(Print<usize>),
    Assertion(Assertion),
}

/// The asserting and printing lines of a program, with the values that the engine has seen so far.
struct Seen<'p> {
    program: &'p Program,
    /// The index of each line in `lines`. The key is the address of the line's site (the engine's record of an
    /// operation).
    sites: BTreeMap<usize, usize>,
    spans: Vec<Span>,
    lines: Vec<Mutex<Line>>,
    /// The number of invocations that a case needs: one, or four if the case is a quad.
    lanes: usize,
}

fn settings() -> Settings {
    Settings { named: &[ASSERTED, PRINTED], ..Settings::default() }
}

pub(crate) fn has_lines(program: &Program) -> bool {
    [ASSERTED, PRINTED].iter().any(|name| program.text().contains(name))
}

/// The assertions that functions of a program reach, each with its position.
///
/// # Errors
/// Returns an error if an assertion has a side effect.
pub(crate) fn assertions(
    program: &Program,
    of: &[&str],
) -> Result<Vec<(Valued, Span, String)>, ReflectError> {
    if has_lines(program) {
        program.expect_no_effects()?;
    }
    let all = program.values_of(of).into_iter();
    let all = all.filter(|one| one.name.as_ref().is_some_and(|name| name.starts_with(ASSERTED)));
    let placed = |one: Valued| {
        let (span, text) = author(program, one.range.clone()?)?;
        Some((one, span, text))
    };
    Ok(all.filter_map(placed).collect())
}

impl<'p> Seen<'p> {
    fn of(program: &'p Program, lowered: &Lowered, lanes: usize) -> Self {
        let values = program.named_values(&[ASSERTED, PRINTED]);
        let (mut sites, mut lines, mut spans) = (BTreeMap::new(), Vec::new(), Vec::new());
        for value in values {
            let is_it = |site: &&Site| {
                site.function == value.function
                    && site.expression.is_some_and(|at| at.index() == value.expression)
            };
            let mut own = lowered.sites().iter().filter(is_it).peekable();
            let place = value.range.clone().and_then(|range| author(program, range));
            let (Some(_), Some((span, text)), Ok(shape)) = (own.peek(), place, value.shape) else {
                continue;
            };
            sites.extend(own.map(|site| (std::ptr::from_ref(site).addr(), lines.len())));
            spans.push(span.clone());
            let text = one_line(&text);
            let is_print = value.name.is_some_and(|name| name.starts_with(PRINTED));
            lines.push(Mutex::new(match is_print {
                true => {
                    let (ends, first) = (vec![None; shape.lanes().len()], Vec::new());
                    let (count, nans, outside) = (0, 0, None);
                    Line::Print(Print { span, text, shape, count, first, ends, nans, outside })
                }
                false => {
                    let (count, wrong, first, outside) = (0, 0, None, None);
                    Line::Assertion(Assertion { span, text, count, wrong, first, outside })
                }
            }));
        }
        Self { program, sites, spans, lines, lanes }
    }

    fn lines(self) -> Vec<Line> {
        let lines = self.lines.into_iter();
        lines.map(|line| line.into_inner().unwrap_or_else(PoisonError::into_inner)).collect()
    }
}

impl Observer<F32> for Seen<'_> {
    fn named(&self, lanes: &Lanes<'_, F32>) {
        let Some(line) = self.sites.get(&std::ptr::from_ref(lanes.site).addr()) else { return };
        let mut line = self.lines[*line].lock().unwrap_or_else(PoisonError::into_inner);
        for lane in (0..lanes.active.len()).filter(|lane| lanes.active[*lane]) {
            // In a quad, only the values at the case's own pixel are recorded.
            let case = lanes.case_of(lane);
            if !case.is_multiple_of(self.lanes) {
                continue;
            }
            match &mut *line {
                Line::Assertion(own) => {
                    own.count += 1;
                    if !lanes.bools.first().is_some_and(|values| values[lane]) {
                        own.wrong += 1;
                        let case = case / self.lanes;
                        own.first = Some(own.first.map_or(case, |first| first.min(case)));
                    }
                }
                Line::Print(own) => own.add(case / self.lanes, lanes, lane),
            }
        }
    }

    fn wrong(&self, one: &Wrong<'_>) {
        let place = one.site.span.to_range().and_then(|range| self.program.resolve(range));
        let (Kind::OutOfRange, Some(place)) = (one.kind, place) else { return };
        let is_in = |span: &Span| {
            Arc::ptr_eq(&span.file, &place.file) && span.range.contains(&place.range.start)
        };
        let Some(line) = self.spans.iter().position(is_in) else { return };
        let mut line = self.lines[line].lock().unwrap_or_else(PoisonError::into_inner);
        let outside = match &mut *line {
            Line::Print(own) => &mut own.outside,
            Line::Assertion(own) => &mut own.outside,
        };
        let case = one.case / self.lanes;
        *outside = Some(outside.map_or(case, |first| first.min(case)));
    }
}

impl Print<usize> {
    fn add(&mut self, case: usize, lanes: &Lanes<'_, F32>, lane: usize) {
        self.count += 1;
        // The engine passes floats, integers and booleans in separate lists.
        let (mut floats, mut ints, mut bools) =
            (lanes.floats.iter(), lanes.ints.iter(), lanes.bools.iter());
        let words = self.shape.lanes().into_iter().map(|scalar| match scalar {
            Scalar::F32 | Scalar::F16 => floats.next().map_or(0, |all| all[lane].to_bits()),
            Scalar::I32 | Scalar::U32 => ints.next().map_or(0, |all| all[lane]),
            Scalar::Bool => bools.next().map_or(0, |all| u32::from(all[lane])),
        });
        let words: Vec<u32> = words.collect();
        for ((word, scalar), ends) in words.iter().zip(self.shape.lanes()).zip(&mut self.ends) {
            let value = scalar.decode(*word);
            self.nans += u64::from(value.is_nan());
            if scalar == Scalar::Bool || value.is_nan() {
                continue;
            }
            let own = (value, *word, case);
            // Cases run in any order. For equal values, the case with the smallest index is kept.
            let [least, most] = ends.get_or_insert([own; 2]);
            if value < least.0 || value == least.0 && case < least.2 {
                *least = own;
            }
            if value > most.0 || value == most.0 && case < most.2 {
                *most = own;
            }
        }
        self.first.push((case, words));
        // Chunks of cases run in parallel. The cases within one chunk arrive in order.
        if self.first.len() >= 8 * KEPT {
            self.keep_first();
        }
    }

    fn keep_first(&mut self) {
        self.first.sort_by_key(|(case, _)| *case);
        self.first.truncate(KEPT);
    }

    /// Replaces the indices of cases by the names that messages show.
    fn named(mut self, name: &dyn Fn(usize) -> String) -> Print<String> {
        self.keep_first();
        let Self { span, text, shape, count, first, ends, nans, outside } = self;
        let end = |(value, word, case)| (value, word, name(case));
        Print {
            first: first.into_iter().map(|(case, words)| (name(case), words)).collect(),
            ends: ends.into_iter().map(|ends| ends.map(|ends| ends.map(end))).collect(),
            outside: outside.map(name),
            span,
            text,
            shape,
            count,
            nans,
        }
    }
}

impl Print<String> {
    fn merge(&mut self, other: Self) {
        self.count += other.count;
        self.nans += other.nans;
        self.outside = self.outside.take().or(other.outside);
        let room = KEPT.saturating_sub(self.first.len());
        self.first.extend(other.first.into_iter().take(room));
        for (own, other) in self.ends.iter_mut().zip(other.ends) {
            match (own, other) {
                (Some([least, most]), Some([low, high])) => {
                    if low.0 < least.0 {
                        *least = low;
                    }
                    if high.0 > most.0 {
                        *most = high;
                    }
                }
                (own @ None, other) => *own = other,
                (Some(_), None) => {}
            }
        }
    }

    /// The table of a printing line: the number of values, the smallest, the largest and the first `most` values.
    fn table(&self, most: usize) -> String {
        let Self { span, text, shape, count, nans, .. } = self;
        let times = counted(usize::try_from(*count).unwrap_or(usize::MAX), "value");
        let mut table = format!("{span}: `{text}` ({shape}): {times}");
        if *nans > 0 {
            let _ = write!(table, ", NaN {nans} times");
        }
        table.push('\n');
        let of = |case: &str| if case.is_empty() { String::new() } else { format!(" for {case}") };
        if let Some(outside) = &self.outside {
            let _ = writeln!(table, "  the expression reads outside of an array{}", of(outside));
        }
        if *count > 1 {
            let names = shape.lane_names().into_iter().zip(shape.lanes());
            for ((name, scalar), ends) in names.zip(&self.ends) {
                let Some(ends) = ends else { continue };
                let [least, most] = ends
                    .each_ref()
                    .map(|(_, word, case)| format!("{}{}", format_lane(scalar, *word), of(case)));
                let name = if name.is_empty() { String::new() } else { format!("{name} ") };
                let _ = writeln!(table, "  {name}least {least}, most {most}");
            }
        }
        for (case, words) in self.first.iter().take(most) {
            let between = if case.is_empty() { "" } else { "  " };
            let _ = writeln!(table, "  {case}{between}{}", shape.format(words));
        }
        let shown = self.first.len().min(most) as u64;
        if *count > shown {
            let _ = writeln!(table, "  and {} more", count - shown);
        }
        table
    }
}

impl Assertion {
    /// The first case in which the assertion is false, or reads outside of an array; `None` if the assertion always
    /// holds.
    fn fails(&self) -> Option<usize> {
        self.first.or(self.outside)
    }

    /// A note if no case reaches the assertion, because such an assertion proves nothing.
    fn unreached(&self) -> Option<String> {
        let Self { span, text, count, .. } = self;
        (*count == 0).then(|| format!("note: {span}: no case reaches the assertion `{text}`\n"))
    }

    fn diagnostic(&self, of: &str, first: &str, note: &str) -> Box<Diagnostic> {
        let Self { span, text, count, wrong, .. } = self;
        let message = match count {
            _ if *wrong == 0 => format!("the assertion `{text}` reads outside of an array"),
            1 => format!("the assertion `{text}` is false"),
            _ => format!("the assertion `{text}` is false {wrong} of {count} times"),
        };
        let first = if first.is_empty() { String::new() } else { format!("{of} {first}") };
        let told = Diagnostic::new(message).at(span.clone(), first);
        Box::new(if note.is_empty() { told } else { told.note(note.to_owned()) })
    }
}

/// A function with assertions and prints, which the engine evaluates for each call.
pub(crate) struct Watched {
    function: Interpreted,
    lines: Mutex<Lines>,
}

/// The asserting and printing lines of a function, with their values from all calls so far.
#[derive(Default)]
struct Lines {
    prints: Vec<Print<String>>,
    assertions: Vec<Assertion>,
    calls: usize,
}

impl Watched {
    /// Prepares a function for the engine. Returns `None` if the function neither asserts nor prints.
    ///
    /// # Errors
    /// Returns an error if the engine can't execute the function. Without this error, the test would
    /// pass although its assertions didn't run.
    pub(crate) fn of(probed: &Probed, fixtures: &Fixtures) -> Result<Option<Self>, ProbeError> {
        if !has_lines(&probed.program) {
            return Ok(None);
        }
        probed.program.expect_no_effects()?;
        let function = Interpreted::with(probed, fixtures, &settings())?;
        // If this program has no such line, the lines belong to other functions of the module.
        let seen = Seen::of(&function.program, &function.lowered, 1);
        let has_own = !seen.sites.is_empty();
        Ok(has_own.then(|| Self { function, lines: Mutex::default() }))
    }

    /// Evaluates the asserting and printing lines in some calls. Messages identify a call by its arguments.
    ///
    /// # Errors
    /// Returns an error if an assertion is false, or reads outside of an array.
    pub(crate) fn look(&self, calls: usize, rows: &[u32]) -> Result<(), ProbeError> {
        let function = &self.function;
        let seen = Seen::of(&function.program, &function.lowered, function.lanes());
        function.observed::<F32>(calls, rows, &function.options(), &seen)?;
        let width = rows.len() / calls.max(1);
        let arguments = |case: usize| function.function.shown(&rows[case * width..][..width]);
        let mut wrong = None;
        let mut lines = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        let Lines { prints, assertions, calls: all } = &mut *lines;
        *all += calls;
        for line in seen.lines() {
            match line {
                Line::Assertion(own) => {
                    if let Some(first) = own.fails().filter(|_| wrong.is_none()) {
                        let of = if own.wrong > 1 { "first for" } else { "for" };
                        wrong = Some(own.diagnostic(of, &arguments(first), ""));
                    }
                    match assertions.iter_mut().find(|known| known.span == own.span) {
                        Some(known) => known.count += own.count,
                        None => assertions.push(own),
                    }
                }
                Line::Print(own) => {
                    let own = own.named(&arguments);
                    match prints.iter_mut().find(|known| known.span == own.span) {
                        Some(known) => known.merge(own),
                        None => prints.push(own),
                    }
                }
            }
        }
        wrong.map_or(Ok(()), |wrong| Err(ProbeError::Asserted(wrong)))
    }

    /// The tables of all values that were printed so far, and notes about assertions that no call reached. Clears both.
    pub(crate) fn told(&self) -> String {
        let mut lines = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        let Lines { prints, assertions, calls } = std::mem::take(&mut *lines);
        let mut text: String = prints.iter().map(|print| print.table(SHOWN)).collect();
        // With only one call, a note about an unreached assertion isn't useful: the call may have taken another branch.
        if calls > 1 {
            text.extend(assertions.iter().filter_map(Assertion::unreached));
        }
        text
    }
}

/// The tables of a function's prints for some rows of arguments. Returns an error if an assertion is false for a row.
pub fn printed(
    probed: &Probed,
    fixtures: &Fixtures,
    rows: &[Vec<u32>],
) -> (String, Result<(), ProbeError>) {
    let watched = match Watched::of(probed, fixtures) {
        Ok(Some(watched)) => watched,
        other => return (String::new(), other.map(drop)),
    };
    let looked = watched.look(rows.len(), &rows.concat());
    let mut lines = watched.lines.lock().unwrap_or_else(PoisonError::into_inner);
    // With a single call, the caller shows the arguments elsewhere.
    if let [_] = rows {
        let first = lines.prints.iter_mut().flat_map(|print| &mut print.first);
        first.for_each(|(case, _)| case.clear());
        let ends = lines.prints.iter_mut().flat_map(|print| &mut print.ends);
        ends.flatten().flatten().for_each(|(_, _, case)| case.clear());
    }
    (lines.prints.iter().map(|print| print.table(KEPT)).collect(), looked)
}

/// The tables of the prints in passes, each with at most `most` values.
///
/// # Errors
/// Returns an error if an assertion of the passes is false, or if the engine can't execute the passes.
pub(crate) fn printed_by(passes: &Passes, most: usize) -> Result<Vec<String>, DispatchError> {
    if !passes.passes.iter().any(|pass| has_lines(&pass.program)) {
        return Ok(Vec::new());
    }
    for pass in &passes.passes {
        pass.program.expect_no_effects()?;
    }
    let (mut all, mut wrong) = (Vec::new(), None);
    Prepared::new(passes, &settings())?.run(&mut |pass, lowered, resources| {
        let seen = Seen::of(&pass.program, lowered, 1);
        lowered.dispatch::<F32>(pass.workgroups, resources, &options(), &seen)?;
        let size = lowered.workgroup_size().expect("a pass is an entry point");
        for line in seen.lines() {
            match line {
                Line::Print(own) => {
                    all.push(own.named(&|case| pass.invocation(size, case)).table(most));
                }
                Line::Assertion(own) => {
                    all.extend(own.unreached());
                    let Some(first) = own.fails().filter(|_| wrong.is_none()) else { continue };
                    let note = format!("Karat's engine found this in the pass `{}`", pass.name);
                    let invocation = pass.invocation(size, first);
                    let of = if own.wrong > 1 { "first by" } else { "by" };
                    wrong = Some(own.diagnostic(of, &invocation, &note));
                }
            }
        }
        Ok(wrong.is_none())
    })?;
    match wrong {
        Some(diagnostic) => Err(ProbeError::Asserted(diagnostic).into()),
        None => Ok(all),
    }
}
