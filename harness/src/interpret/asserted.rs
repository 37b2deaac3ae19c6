//! Assertions and prints of a shader, as Karat's engine comes to them.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::sync::{Mutex, PoisonError};

use karat_engine::{F32, Lanes, Observer, Program as Lowered, Settings, Site};

use super::dispatch::{Prepared, options};
use super::{Interpreted, author};
use crate::diagnostic::{Diagnostic, Span, one_line};
use crate::dispatch::{DispatchError, Passes};
use crate::fixture::Fixtures;
use crate::output::counted;
use crate::package::asserts::{ASSERTED, PRINTED};
use crate::probe::{ProbeError, Probed};
use crate::reflect::{Program, Valued};
use crate::value::{Scalar, Shape};

/// Values of a print that are kept: those of the first cases.
pub(crate) const KEPT: usize = 1024;

/// Values of a print that the output of a test shows.
pub(crate) const SHOWN: usize = 16;

/// A line that prints, with its values.
pub(crate) struct Print {
    /// The expression in the author's file.
    span: Span,
    /// Its text.
    text: String,
    /// Its type.
    shape: Shape,
    /// How often it was printed.
    count: u64,
    /// The first values in the order of cases, each with its case: a call, or an invocation.
    first: Vec<(usize, Vec<u32>)>,
    /// The least and the largest number of each component, each with its case; none of booleans and NaN.
    ends: Vec<Option<[(f64, usize); 2]>>,
}

/// An assertion, and how often it was false.
struct Assertion {
    span: Span,
    text: String,
    count: u64,
    wrong: u64,
    first: Option<usize>,
}

enum Line {
    Print(Print),
    Assertion(Assertion),
}

/// The lines of a program that assert or print, and what was seen of them.
struct Seen {
    /// The lines by the addresses of their sites.
    sites: BTreeMap<usize, usize>,
    lines: Vec<Mutex<Line>>,
    /// Lanes of a case.
    lanes: usize,
}

/// The setting by which the engine shows what has a name.
fn settings() -> Settings {
    Settings { named: true, ..Settings::default() }
}

/// True of a program with lines that assert or print.
pub(crate) fn has_lines(program: &Program) -> bool {
    [ASSERTED, PRINTED].iter().any(|name| program.text().contains(name))
}

/// The lines of a program that assert, each with its place: those that a function of it reaches.
pub(crate) fn assertions(program: &Program, of: &[&str]) -> Vec<(Valued, Span, String)> {
    let all = program.values_of(of).into_iter();
    let all = all.filter(|one| one.name.as_ref().is_some_and(|name| name.starts_with(ASSERTED)));
    let placed = |one: Valued| {
        let (span, text) = author(program, one.range.clone()?)?;
        Some((one, span, text))
    };
    all.filter_map(placed).collect()
}

impl Seen {
    fn of(program: &Program, lowered: &Lowered, lanes: usize) -> Self {
        let values = program.named_values(&[ASSERTED, PRINTED]);
        let (mut sites, mut lines) = (BTreeMap::new(), Vec::new());
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
            let text = one_line(&text);
            let is_print = value.name.is_some_and(|name| name.starts_with(PRINTED));
            lines.push(Mutex::new(match is_print {
                true => {
                    let ends = vec![None; shape.lanes().len()];
                    Line::Print(Print { span, text, shape, count: 0, first: Vec::new(), ends })
                }
                false => Line::Assertion(Assertion { span, text, count: 0, wrong: 0, first: None }),
            }));
        }
        Self { sites, lines, lanes }
    }

    /// The lines after a run, in the order of the text.
    fn lines(self) -> Vec<Line> {
        let lines = self.lines.into_iter();
        lines.map(|line| line.into_inner().unwrap_or_else(PoisonError::into_inner)).collect()
    }
}

impl Observer<F32> for Seen {
    fn named(&self, lanes: &Lanes<'_, F32>) {
        let Some(line) = self.sites.get(&std::ptr::from_ref(lanes.site).addr()) else { return };
        let mut line = self.lines[*line].lock().unwrap_or_else(PoisonError::into_inner);
        for lane in (0..lanes.active.len()).filter(|lane| lanes.active[*lane]) {
            // Of a quad the pixel that the arguments are given for.
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
}

impl Print {
    fn add(&mut self, case: usize, lanes: &Lanes<'_, F32>, lane: usize) {
        self.count += 1;
        // Scalars come by their kinds.
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
            if scalar == Scalar::Bool || value.is_nan() {
                continue;
            }
            let own = (value, case);
            let before = |a: (f64, usize), b: (f64, usize)| a.0 < b.0 || a.0 == b.0 && a.1 < b.1;
            let after = |a: (f64, usize), b: (f64, usize)| a.0 > b.0 || a.0 == b.0 && a.1 < b.1;
            *ends = Some(match *ends {
                None => [own; 2],
                Some([least, most]) => [
                    if before(own, least) { own } else { least },
                    if after(own, most) { own } else { most },
                ],
            });
        }
        self.first.push((case, words));
        // Chunks of cases run beside each other; those of one come in their order.
        if self.first.len() >= 8 * KEPT {
            self.keep_first();
        }
    }

    fn keep_first(&mut self) {
        self.first.sort_by_key(|(case, _)| *case);
        self.first.truncate(KEPT);
    }

    /// Adds those of later cases, of which the first has this number.
    fn merge(&mut self, other: Self, first: usize) {
        self.count += other.count;
        let room = KEPT.saturating_sub(self.first.len());
        self.first
            .extend(other.first.into_iter().take(room).map(|(case, words)| (first + case, words)));
        for (own, other) in self.ends.iter_mut().zip(other.ends) {
            let moved = other.map(|ends| ends.map(|(value, case)| (value, first + case)));
            *own = match (*own, moved) {
                (Some([a, b]), Some([c, d])) => {
                    Some([if c.0 < a.0 { c } else { a }, if d.0 > b.0 { d } else { b }])
                }
                (own, other) => own.or(other),
            };
        }
    }

    /// Its values in lines: count, least and largest; then the first `most` of them. `case` is the name of a case, empty where
    /// there is one.
    fn table(&self, most: usize, case: &dyn Fn(usize) -> String) -> String {
        let Self { span, text, shape, count, .. } = self;
        let times = counted(usize::try_from(*count).unwrap_or(usize::MAX), "value");
        let mut table = format!("{span}: `{text}` ({shape}): {times}\n");
        if *count > 1 {
            for (name, ends) in shape.lane_names().iter().zip(&self.ends) {
                let Some([least, most]) = ends else { continue };
                let end = |(value, at): &(f64, usize)| match case(*at) {
                    none if none.is_empty() => value.to_string(),
                    case => format!("{value} for {case}"),
                };
                let name = if name.is_empty() { String::new() } else { format!("{name} ") };
                let _ = writeln!(table, "  {name}least {}, most {}", end(least), end(most));
            }
        }
        for (at, words) in self.first.iter().take(most) {
            let case = case(*at);
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
    /// A line about an assertion that shows nothing, since no case comes to it.
    fn unreached(&self) -> Option<String> {
        let Self { span, text, count, .. } = self;
        (*count == 0).then(|| format!("note: {span}: no case comes to the assertion `{text}`\n"))
    }

    fn diagnostic(&self, of: &str, first: &str, note: &str) -> Box<Diagnostic> {
        let Self { span, text, count, wrong, .. } = self;
        let message = match count {
            1 => format!("the assertion `{text}` is false"),
            _ => format!("the assertion `{text}` is false {wrong} of {count} times"),
        };
        let first = if first.is_empty() { String::new() } else { format!("{of} {first}") };
        let told = Diagnostic::new(message).at(span.clone(), first);
        Box::new(if note.is_empty() { told } else { told.note(note.to_owned()) })
    }
}

/// A function whose assertions and prints are looked at over the cases of a check.
pub(crate) struct Watched {
    function: Interpreted,
    prints: Mutex<Vec<Print>>,
    assertions: Mutex<Vec<Assertion>>,
}

impl Watched {
    /// `None` of a function without such lines.
    ///
    /// # Errors
    /// If the engine doesn't execute it: an assertion that isn't looked at shows nothing.
    pub(crate) fn of(probed: &Probed, fixtures: &Fixtures) -> Result<Option<Self>, ProbeError> {
        if !has_lines(&probed.program) {
            return Ok(None);
        }
        let function = Interpreted::with(probed, fixtures, &settings())?;
        // Others of its module may have the lines.
        let seen = Seen::of(&function.program, &function.lowered, 1);
        Ok((!seen.sites.is_empty()).then(|| {
            let (prints, assertions) = Default::default();
            Self { function, prints, assertions }
        }))
    }

    /// Looks at some cases, of which the first has this number.
    ///
    /// # Errors
    /// If an assertion is false.
    pub(crate) fn look(&self, first: usize, cases: usize, rows: &[u32]) -> Result<(), ProbeError> {
        let Self { function, prints, assertions } = self;
        let seen = Seen::of(&function.program, &function.lowered, function.lanes());
        function.observed::<F32>(cases, rows, &function.options(), &seen)?;
        let width = rows.len() / cases.max(1);
        let arguments =
            |case: usize| shown(&function.function.arguments(&rows[case * width..][..width]));
        let mut prints = prints.lock().unwrap_or_else(PoisonError::into_inner);
        let mut assertions = assertions.lock().unwrap_or_else(PoisonError::into_inner);
        for line in seen.lines() {
            match line {
                Line::Assertion(own) => {
                    if let Some(first) = own.first {
                        let arguments = arguments(first);
                        let of = if own.wrong > 1 { "first for" } else { "for" };
                        return Err(ProbeError::Asserted(own.diagnostic(of, &arguments, "")));
                    }
                    match assertions.iter_mut().find(|known| known.span == own.span) {
                        Some(known) => known.count += own.count,
                        None => assertions.push(own),
                    }
                }
                Line::Print(mut own) => {
                    own.keep_first();
                    match prints.iter_mut().find(|known| known.span == own.span) {
                        Some(known) => known.merge(own, first),
                        None => prints.push(own),
                    }
                }
            }
        }
        Ok(())
    }

    /// The prints so far.
    fn prints(&self) -> Vec<Print> {
        std::mem::take(&mut *self.prints.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Writes what a check prints, once in the thread of its test: each path would print the same. `case` is the name of a
    /// case.
    pub(crate) fn tell(&self, case: &dyn Fn(usize) -> String) {
        let mut text: String = self.prints().iter().map(|print| print.table(SHOWN, case)).collect();
        let assertions = self.assertions.lock().unwrap_or_else(PoisonError::into_inner);
        text.extend(assertions.iter().filter_map(Assertion::unreached));
        tell(&text);
    }
}

/// Writes what a test prints, under its name: that of its thread.
pub(crate) fn tell(text: &str) {
    thread_local! {
        static TOLD: RefCell<String> = const { RefCell::new(String::new()) };
    }
    TOLD.with_borrow_mut(|told| {
        if *told != text && !text.is_empty() {
            let thread = std::thread::current();
            let name = thread.name().map_or_else(String::new, |name| format!("{name} prints\n"));
            eprint!("{name}{text}");
            text.clone_into(told);
        }
    });
}

/// Arguments in a line.
pub(crate) fn shown(arguments: &[(String, String)]) -> String {
    let all = arguments.iter().map(|(name, value)| format!("{name} = {value}"));
    all.collect::<Vec<_>>().join(", ")
}

/// What the lines of a function print for some arguments: a table.
///
/// # Errors
/// If an assertion of it is false, or the engine doesn't execute it.
pub fn printed(probed: &Probed, fixtures: &Fixtures, row: &[u32]) -> Result<String, ProbeError> {
    let Some(watched) = Watched::of(probed, fixtures)? else { return Ok(String::new()) };
    watched.look(0, 1, row)?;
    let table = |print: &Print| print.table(KEPT, &|_| String::new());
    Ok(watched.prints().iter().map(table).collect())
}

/// What the lines of passes print: a table for each, of so many values at most.
///
/// # Errors
/// If an assertion of theirs is false, or the engine doesn't execute them.
pub(crate) fn printed_by(passes: &Passes, most: usize) -> Result<Vec<String>, DispatchError> {
    if !passes.passes.iter().any(|pass| has_lines(&pass.program)) {
        return Ok(Vec::new());
    }
    let (mut all, mut wrong) = (Vec::new(), None);
    Prepared::new(passes, &settings())?.run(&mut |pass, lowered, resources| {
        let seen = Seen::of(&pass.program, lowered, 1);
        lowered.dispatch::<F32>(pass.workgroups, resources, &options(), &seen)?;
        let size = lowered.workgroup_size().expect("a pass is an entry point");
        for line in seen.lines() {
            match line {
                Line::Print(mut own) => {
                    own.keep_first();
                    all.push(own.table(most, &|case| pass.invocation(size, case)));
                }
                Line::Assertion(own) => {
                    all.extend(own.unreached());
                    let Some(first) = own.first.filter(|_| wrong.is_none()) else { continue };
                    let note = format!("by Karat's engine, in `{}`", pass.name);
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
