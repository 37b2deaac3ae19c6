//! Reads intermediate values of a frame's fragment functions on each pixel.

use std::collections::BTreeSet;

use super::{Frame, FrameError};
use crate::diagnostic::{Diagnostic, Span, nearest};
use crate::dispatch::{DispatchError, Part};
use crate::draw::{DrawError, Drawing};
use crate::executor;
use crate::interpret::asserted::assertions;
use crate::interpret::author;
use crate::package::asserts::PRINTED;
use crate::package::let_statements;
use crate::path::{self, Device, Path};
use crate::probe::ProbeError;
use crate::record::tell_prints;
use crate::reflect::{Program, Valued, WORDS, When};
use crate::value::Shape;

/// Selects the value that [`Frame::tap`] reads: a value in the frame's fragment functions, or in functions that they
/// call.
#[derive(Clone, Debug)]
pub struct Tap {
    pub(crate) wanted: String,
    pub(crate) round: Option<u32>,
    beside: bool,
}

impl Tap {
    /// Selects a value by its text or by its position in the shader.
    ///
    /// The text is the name of a `let` or of a parameter, or an expression that occurs once. If several functions use
    /// the name, put the function's path before the name (`brdf::shade::n_dot_v`).
    ///
    /// The position `scene.wgsl:42:13` selects the largest expression that begins at this position. If the name of a
    /// `let` begins at this position, the tap selects the value of the `let`. The position `scene.wgsl:42` selects the
    /// value of the only `let` on that line.
    #[must_use]
    pub fn new(wanted: &str) -> Self {
        Self { wanted: wanted.to_owned(), round: None, beside: false }
    }

    /// Checks if the tap selects every `print` in the shader: `Tap::new("karat:print")`.
    #[must_use]
    pub fn is_of_prints(&self) -> bool {
        self.wanted == "karat:print"
    }

    /// A copy of this tap for another value.
    #[must_use]
    pub fn of(&self, wanted: &str) -> Self {
        Self { wanted: wanted.to_owned(), ..self.clone() }
    }

    /// Selects one of the values if a pixel computes the value several times, as in a loop. `round` counts from 1. By
    /// default, a tap reads the last value.
    #[must_use]
    pub fn round(self, round: Option<u32>) -> Self {
        Self { round, ..self }
    }

    /// Also draws the frame's colours beside the value, and compares them with the original frame's colours. A driver
    /// may compute a value differently if it doesn't compute the colours. This option doubles the time that the tap
    /// takes.
    #[must_use]
    pub fn beside(self, beside: bool) -> Self {
        Self { beside, ..self }
    }
}

/// The values of one expression on all pixels of a frame, as a driver computed them.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Tapped {
    /// The position of the expression in the source file.
    pub span: Span,
    /// The text of the expression.
    pub text: String,
    /// The name of the `let` or the parameter, if there is one.
    pub name: Option<String>,
    /// The function that contains the expression.
    pub function: String,
    /// The type of the values.
    pub shape: Shape,
    /// The width and height of the frame. For a pass, the number of invocations in x, and the product of the numbers in
    /// y and z.
    pub size: (u32, u32),
    /// The owner of each value, for messages: `pixel` or `invocation`.
    pub of: &'static str,
    /// For each pixel, row by row, how often the pixel computed the value. `None` if no draw covers the pixel.
    pub times: Vec<Option<u32>>,
    /// The components of the values as `u32`s, pixel after pixel. A pixel without a value has zeros.
    pub lanes: Vec<u32>,
    /// `true` if another value in the same function has the same name. Then a file name for the value must contain the
    /// line number.
    pub has_twin: bool,
    /// The number that the caller gave to [`Tap::round`].
    pub round: Option<u32>,
    /// For each pixel, `true` if the pixel has a value.
    pub told: Vec<bool>,
    /// The number of pixels whose colour changed because the draw also returned the value. The driver compiles another
    /// program for such a draw. `None` if the draw returned only the value, without colours.
    pub changed: Option<usize>,
}

/// The reason why Karat can't read a value.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TapError {
    /// Karat can't draw the frame.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// The frame or pass computes no value that matches the caller's text.
    #[error("the frame computes no value `{wanted}`{more}")]
    Unknown {
        /// The value that the caller named.
        wanted: String,
        /// A suggestion for the user.
        more: String,
    },
    /// Several values match the name or the text.
    #[error("`{wanted}` matches {} values: choose one\n  {}", places.len(), places.join("\n  "))]
    Several {
        /// The value that the caller named.
        wanted: String,
        /// The position, function and text of each value.
        places: Vec<String>,
    },
    /// Karat can't read a value of this kind.
    #[error("{place}: `{text}` can't be tapped, because it is {why}")]
    Untold {
        /// The position of the value.
        place: String,
        /// The expression that computes the value, as text.
        text: String,
        /// The reason, as the end of the message: `a constant`, `an atomic`.
        why: String,
    },
    /// Karat can't dispatch the passes.
    #[error(transparent)]
    Dispatch(#[from] DispatchError),
    /// The engine can't run the fragment function.
    #[error(transparent)]
    Probe(#[from] ProbeError),
    /// The frame doesn't contain the pixel.
    #[error("the frame has {} x {} pixels, counted from (0, 0) at the upper left, so the pixel ({}, {}) is outside of the frame", size.0, size.1, pixel.0, pixel.1)]
    Outside {
        /// The column and row of the pixel.
        pixel: (u32, u32),
        /// The width and height of the frame.
        size: (u32, u32),
    },
    /// No draw covers the pixel.
    #[error("no draw is visible at the pixel ({}, {}): no draw covers the pixel, or the fragment functions discard the pixel", pixel.0, pixel.1)]
    Undrawn {
        /// The column and row of the pixel.
        pixel: (u32, u32),
    },
    /// The frame's colours can't be drawn beside a value.
    #[error(
        "the frame has several targets or samples, so Karat can't draw the frame's colours beside the value: draw the value alone"
    )]
    Beside,
    /// No pixel computes the value `round` times.
    #[error(
        "no pixel computes `{value}` {round} times: a pixel computes the value at most {most} times"
    )]
    Round {
        /// The value that the caller named.
        value: String,
        /// The number that the caller gave to [`Tap::round`].
        round: u32,
        /// The largest number of times that a pixel computes the value.
        most: u32,
    },
    /// The frame draws only depth.
    #[error("the frame has no fragment function: it draws only depth")]
    Depth,
}

impl From<DrawError> for TapError {
    fn from(error: DrawError) -> Self {
        Self::Frame(error.into())
    }
}

/// A value that can be tapped, with its position in the source file.
pub(crate) struct Candidate {
    pub(crate) value: Valued,
    span: Span,
    pub(crate) text: String,
    /// The position of the `let`'s name, if there is one.
    named: Option<Span>,
}

impl Candidate {
    fn line_column(&self) -> (usize, usize) {
        self.span.file.line_column(self.span.range.start)
    }

    pub(crate) fn place(&self) -> String {
        let (line, column) = self.line_column();
        format!("{}:{line}:{column}", self.span.file.name)
    }

    pub(crate) fn shape(&self) -> Result<Shape, TapError> {
        self.value.shape.clone().map_err(|why| TapError::Untold {
            place: self.place(),
            text: self.text.clone(),
            why,
        })
    }

    /// The path of the function and the name of the `let` or parameter, if there is one.
    fn path(&self, program: &Program) -> Option<String> {
        let name = self.value.name.as_ref()?;
        let is_own = self.named.is_some() || self.value.range.is_none();
        is_own.then(|| format!("{}::{name}", program.path_of(&self.value.function)))
    }

    /// A line with the name and type of the value. If the value isn't a parameter, the line also has its text and
    /// position.
    fn told(&self, program: &Program) -> String {
        let text = self.text.split_whitespace().collect::<Vec<_>>().join(" ");
        let shape = match &self.value.shape {
            Ok(Shape::Struct { name, .. }) => program.path_of(name),
            Ok(shape) => shape.to_string(),
            Err(what) => what.clone(),
        };
        let function = program.path_of(&self.value.function);
        match (self.path(program), &self.value.range) {
            (Some(path), Some(_)) => format!("{path}: {shape} = {text}  {}", self.place()),
            (Some(path), None) => format!("{path}: {shape}, a parameter"),
            (None, _) => format!("{}  {text}: {shape} in `{function}`", self.place()),
        }
    }

    /// A line that describes the value ([`told`](Self::told)). `None` if the value has no name or can't be read.
    pub(crate) fn listed(&self, program: &Program) -> Option<String> {
        (self.value.shape.is_ok() && self.path(program).is_some()).then(|| self.told(program))
    }

    /// Checks if the value is a `let` or a parameter with this name or path.
    fn is_named(&self, name: &str, program: &Program) -> bool {
        let path = self.path(program);
        path.is_some_and(|path| {
            path.ends_with(name) && {
                let before = &path[..path.len() - name.len()];
                before.is_empty() || before.ends_with("::")
            }
        })
    }
}

/// All values in the code that `entry_points` run, ordered by function.
pub(crate) fn candidates(program: &Program, entry_points: &[&str]) -> Vec<Candidate> {
    let values = program.values_of(entry_points);
    let mut all: Vec<Candidate> = Vec::new();
    for value in values {
        let of_function =
            || Some((program.declaration_span(&value.function)?, value.name.clone()?));
        let found = match &value.range {
            Some(range) => author(program, range.clone()),
            None => of_function(),
        };
        let Some((span, text)) = found else { continue };
        // naga may make several values at one position. Only the last one is the whole expression.
        let same = |other: &Candidate| {
            value.range.is_some()
                && other.value.range == value.range
                && other.value.function == value.function
        };
        if value.shape.is_ok() || !all.iter().any(same) {
            all.retain(|other| !same(other) || (value.shape.is_err() && other.value.shape.is_ok()));
            all.push(Candidate { value, span, text, named: None });
        }
    }
    let functions: BTreeSet<String> = all.iter().map(|one| one.value.function.clone()).collect();
    for function in functions {
        for statement in let_statements(program.text(), &function) {
            let (start, end) = (statement.name.end, statement.end.unwrap_or(statement.name.end));
            let is_inside = |one: &&mut Candidate| {
                let inside =
                    |range: &std::ops::Range<usize>| range.start >= start && range.end <= end;
                one.value.function == function && one.value.range.as_ref().is_some_and(inside)
            };
            let length =
                |one: &&mut Candidate| one.value.range.as_ref().map_or(0, ExactSizeIterator::len);
            let name = program.text()[statement.name.clone()].to_owned();
            let named = program.resolve(statement.name.clone());
            if let Some(found) = all.iter_mut().filter(is_inside).max_by_key(length) {
                (found.named, found.value.name) = (named, Some(name));
                continue;
            }
            // This `let` gives a second name to a value.
            let initialiser = program.text()[start..end].trim_matches([' ', '=', ';', '\n', '\t']);
            let is_it = |one: &&Candidate| {
                one.value.function == function && one.value.name.as_deref() == Some(initialiser)
            };
            if let Some(original) = all.iter().rev().find(is_it) {
                let value = Valued { name: Some(name), ..original.value.clone() };
                let (span, text) = (original.span.clone(), original.text.clone());
                all.push(Candidate { value, span, text, named });
            }
        }
    }
    all
}

/// The source position of each `print` in the code that `entry_points` run.
pub(crate) fn prints(program: &Program, entry_points: &[&str]) -> Vec<String> {
    let all = candidates(program, entry_points);
    let is_print =
        |one: &&Candidate| one.value.name.as_ref().is_some_and(|name| name.starts_with(PRINTED));
    let place = |one: &Candidate| format!("{}:{}", one.span.file.name, one.line_column().0);
    all.iter().filter(is_print).map(place).collect()
}

/// Splits a position such as `scene.wgsl:42:13` into a path, a line, and a column if there is one.
fn place_of(wanted: &str) -> Option<(&str, usize, Option<usize>)> {
    let (rest, last) = wanted.rsplit_once(':')?;
    let last: usize = last.parse().ok()?;
    match rest.rsplit_once(':').map(|(file, line)| (file, line.parse())) {
        Some((file, Ok(line))) => Some((file, line, Some(last))),
        _ => Some((rest, last, None)),
    }
}

fn find(program: &Program, all: &[Candidate], wanted: &str) -> Result<usize, TapError> {
    let (mut found, mut more) = match place_of(wanted) {
        Some(place) => at_place(all, place, program),
        None => {
            let without_blanks = |text: &str| text.split_whitespace().collect::<String>();
            let text = without_blanks(wanted);
            let named = of(all, &|one| one.is_named(wanted, program));
            let is_text =
                |one: &Candidate| one.value.range.is_some() && without_blanks(&one.text) == text;
            (if named.is_empty() { of(all, &is_text) } else { named }, String::new())
        }
    };
    // Two modules may contain copies of one function, whose values have the same position.
    let mut places = BTreeSet::new();
    found.retain(|index| {
        let Candidate { value, .. } = &all[*index];
        places.insert((all[*index].place(), value.function.clone(), value.name.clone()))
    });
    match *found {
        [one] => Ok(one),
        [] => {
            let names: Vec<&str> = all.iter().filter_map(|one| one.value.name.as_deref()).collect();
            let is_variable =
                all.iter().any(|one| program.declares_var(&one.value.function, wanted));
            if more.is_empty() && is_variable {
                more = ": this variable is a `var`, which each assignment changes: name the assigned expression instead".to_owned();
            } else if let Some(near) =
                nearest(wanted, names.iter().copied()).filter(|_| more.is_empty())
            {
                more = format!("; did you mean `{near}`?");
            }
            Err(TapError::Unknown { wanted: wanted.to_owned(), more })
        }
        _ => {
            let places = found.iter().map(|index| all[*index].told(program)).collect();
            Err(TapError::Several { wanted: wanted.to_owned(), places })
        }
    }
}

/// A member or element of a value, as the caller wrote it: `.b`, `[1].x`.
pub(crate) struct Wanted {
    suffix: String,
    part: Part,
    shape: Shape,
}

/// Finds the value that the caller named. The `bool` is `true` if another value in the function has the same name.
/// [`Wanted`] is the member or element of the value, if the caller named one.
pub(crate) fn find_or_part(
    program: &Program,
    entry_points: &[&str],
    wanted: &str,
) -> Result<(Candidate, bool, Option<Wanted>), TapError> {
    let mut all = candidates(program, entry_points);
    let (found, part) = match find(program, &all, wanted) {
        Ok(found) => (found, None),
        Err(error) => {
            let at = wanted.find(['.', '[']).filter(|_| place_of(wanted).is_none());
            let (name, suffix) = wanted.split_at(at.unwrap_or(wanted.len()));
            let path = suffix.strip_prefix('.').unwrap_or(suffix);
            let part = find(program, &all, name).ok().and_then(|found| {
                let (part, shape) = Part::of(0, all[found].value.shape.as_ref().ok()?, path)?;
                Some((found, Some(Wanted { suffix: suffix.to_owned(), part, shape })))
            });
            match (error, part) {
                (TapError::Unknown { .. }, Some(part)) if !suffix.is_empty() => part,
                (error, _) => return Err(error),
            }
        }
    };
    let Valued { function, name, .. } = &all[found].value;
    let same = |one: &&Candidate| one.value.function == *function && one.value.name == *name;
    let has_twin = name.is_some() && all.iter().filter(same).count() > 1;
    Ok((all.swap_remove(found), has_twin, part))
}

fn of(all: &[Candidate], is: &dyn Fn(&Candidate) -> bool) -> Vec<usize> {
    (0..all.len()).filter(|index| is(&all[*index])).collect()
}

/// Returns the indices of the values at a position. If no value is there, also returns a text for the error message,
/// such as a list of the values on that line.
fn at_place(
    all: &[Candidate],
    (file, line, column): (&str, usize, Option<usize>),
    program: &Program,
) -> (Vec<usize>, String) {
    let file = std::path::Path::new(file.strip_prefix("./").unwrap_or(file));
    let is_file = |one: &Candidate| {
        let own = std::path::Path::new(&one.span.file.name);
        own.ends_with(file) || file.ends_with(own)
    };
    let is_there = |one: &Candidate| is_file(one) && one.value.range.is_some();
    let is_name = |one: &Candidate, is: &dyn Fn((usize, usize)) -> bool| {
        let name = one.named.as_ref().filter(|_| is_there(one));
        name.is_some_and(|name| is(name.file.line_column(name.range.start)))
    };
    let found = match column {
        None => of(all, &|one| is_name(one, &|(own, _)| own == line)),
        Some(column) => {
            let named = of(all, &|one| is_name(one, &|place| place == (line, column)));
            let begins = of(all, &|one| is_there(one) && one.line_column() == (line, column));
            let largest = begins.into_iter().max_by_key(|index| all[*index].text.len());
            if named.is_empty() { largest.into_iter().collect() } else { named }
        }
    };
    let on_line = of(all, &|one| is_there(one) && one.line_column().0 == line);
    let more = match (found.is_empty(), on_line.is_empty()) {
        (false, _) => String::new(),
        (true, true) if !all.iter().any(is_file) => {
            ": its fragment functions run no code in this file".to_owned()
        }
        (true, true) => ": its fragment functions compute no value on this line".to_owned(),
        (true, false) => {
            let there: Vec<_> = on_line.iter().map(|index| all[*index].told(program)).collect();
            format!("; this line has the values\n  {}", there.join("\n  "))
        }
    };
    (found, more)
}

impl Frame<'_> {
    /// The named values of the frame: `let`s and parameters in the fragment functions, and in functions that they call.
    /// Each line has the value's path, such as `brdf::shade::n_dot_v`, and type. For a `let`, the line also has the
    /// expression and its position.
    ///
    /// # Errors
    /// Returns an error if the frame can't be drawn.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn values(&self, path: Path) -> Result<Vec<String>, TapError> {
        let executor = executor::of(path).map_err(DrawError::from)?;
        let drawing = self.drawing_on(executor)?;
        let program = drawing.program();
        let all = candidates(program, &drawing.fragments());
        Ok(all.iter().filter_map(|one| one.listed(program)).collect())
    }

    /// The source position of each `print` in code that the fragment functions run. [`Tap::new`] accepts each position.
    ///
    /// # Errors
    /// Returns an error if the frame can't be drawn.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn prints(&self, path: Path) -> Result<Vec<String>, TapError> {
        let executor = executor::of(path).map_err(DrawError::from)?;
        let drawing = self.drawing_on(executor)?;
        Ok(prints(drawing.program(), &drawing.fragments()))
    }

    /// Reads a value that the frame's fragment functions compute, on all pixels. A driver computes the value. Each
    /// pixel has the value of its visible draw.
    ///
    /// ```no_run
    /// use karat::Path;
    /// use karat::unstable::frame::Tap;
    /// use karat::prelude::*;
    ///
    /// let text = "@fragment fn fragment(@location(0) uv: vec2f) -> @location(0) vec4f {
    ///     let slope = 2.0 * uv.x;
    ///     return vec4f(slope);
    /// }";
    /// let package = Package::from_source("m", text);
    /// let tapped = package.frame("", 4, 4).fragment("fragment").tap(Path::VULKAN, &Tap::new("slope"))?;
    /// assert_eq!(f32::from_bits(tapped.lanes[0]), 0.25);
    /// # Ok::<(), karat::unstable::frame::TapError>(())
    /// ```
    ///
    /// # Errors
    /// Returns an error if the frame has no such value, or if it can't be drawn.
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn tap(&self, path: Path, tap: &Tap) -> Result<Tapped, TapError> {
        Ok(self.taps(path, std::slice::from_ref(tap))?.swap_remove(0))
    }

    /// Reads several values. The targets of every device have space for 32 bytes per pixel, so each time that Karat
    /// draws the frame, it reads as many values as fit into 32 bytes. If a tap draws the colours [beside](Tap::beside)
    /// its value, Karat reads each value separately.
    ///
    /// # Errors
    /// As for [`tap`](Self::tap).
    ///
    /// *Unstable*: this item may change in any release. It is for programs that run tests or report their results.
    pub fn taps(&self, path: Path, taps: &[Tap]) -> Result<Vec<Tapped>, TapError> {
        let executor = executor::of(path).map_err(DrawError::from)?;
        let drawing = self.drawing_on(executor)?;
        if drawing.fragments().is_empty() {
            return Err(TapError::Depth);
        }
        let program = drawing.program();
        let find = |tap: &Tap| {
            let found = find_or_part(program, &drawing.fragments(), &tap.wanted)?;
            found.0.shape()?;
            Ok(found)
        };
        let found: Vec<_> = taps.iter().map(find).collect::<Result<_, TapError>>()?;
        let opened = path::open(path).map_err(DrawError::from)?;
        let device = opened.device().ok_or(DrawError::Unable { path })?;
        let (names, span) = drawing.entry_points();
        if taps.iter().any(|tap| tap.beside) && !drawing.may_keep_colours() {
            return Err(TapError::Beside);
        }
        let values: Vec<(&Valued, When)> =
            found.iter().zip(taps).map(|(found, tap)| (&found.0.value, tap.round.into())).collect();
        let all = || match taps.iter().any(|tap| tap.beside) {
            false => read(device, &drawing, &values, false),
            true => {
                let one = |value| Ok(read(device, &drawing, &[value], true)?.swap_remove(0));
                values.iter().copied().map(one).collect()
            }
        };
        let all = path::caught(path, &names, span.as_ref(), all)?;
        let told = |((found, tap), read)| tapped(program, found, tap, read, drawing.size());
        found.into_iter().zip(taps).zip(all).map(told).collect()
    }
}

/// Fails if an assertion of a fragment function is false for a visible pixel. Prints a note for each assertion that
/// Karat couldn't check.
pub(super) fn expect_asserted(drawing: &Drawing<'_>, path: Path) -> Result<(), FrameError> {
    let of = |names: &[&str]| assertions(drawing.program(), names).map_err(DrawError::from);
    let all = of(&drawing.fragments())?;
    let mut notes = String::new();
    for (_, span, text) in of(&drawing.vertices())? {
        if !all.iter().any(|(_, own, _)| *own == span) {
            let why = "in a frame, Karat checks only assertions in fragment functions";
            notes += &format!("note: {span}: the assertion `{text}` isn't checked: {why}\n");
        }
    }
    if all.is_empty() {
        tell_prints(&notes);
        return Ok(());
    }
    let opened = path::open(path)?;
    let device = opened.device().ok_or(DrawError::Unable { path })?;
    let (names, place) = drawing.entry_points();
    // For each assertion, how often it is false, and how often a pixel reaches it.
    let values: Vec<_> = [When::False, When::Last]
        .into_iter()
        .flat_map(|when| all.iter().map(move |(value, ..)| (value, when)))
        .collect();
    let read = || read(device, drawing, &values, false);
    let read = path::caught(path, &names, place.as_ref(), read)?;
    let (wrong, reached) = read.split_at(all.len());
    for ((_, span, text), Read { times, .. }) in all.iter().zip(reached) {
        if times.iter().all(|times| times.unwrap_or(0) == 0) {
            notes += &format!("note: {span}: no pixel reaches the assertion `{text}`\n");
        }
    }
    tell_prints(&notes);
    let mut found: Option<Diagnostic> = None;
    for ((_, span, text), Read { times, .. }) in all.iter().zip(wrong) {
        let is_wrong = |times: &Option<u32>| times.is_some_and(|times| times > 0);
        let Some(first) = times.iter().position(is_wrong) else { continue };
        let (wrong, of) =
            (times.iter().filter(|times| is_wrong(times)).count(), times.iter().flatten().count());
        let width = drawing.size().0 as usize;
        let (x, y) = (first % width, first / width);
        let message =
            format!("the assertion `{text}` is false for {wrong} of {of} pixels on path `{path}`");
        let label = format!("the first pixel is ({x}, {y})");
        found = Some(match found {
            Some(first) => first.note(format!("{span}: {message}, {label}")),
            None => Diagnostic::new(message).at(span.clone(), label),
        });
    }
    found.map_or(Ok(()), |found| Err(FrameError::Asserted(Box::new(found))))
}

pub(crate) fn tapped(
    program: &Program,
    (found, has_twin, part): (Candidate, bool, Option<Wanted>),
    tap: &Tap,
    Read { times, mut lanes, changed }: Read,
    size: (u32, u32),
) -> Result<Tapped, TapError> {
    let function = program.path_of(&found.value.function);
    let mut shape = found.shape()?;
    let Candidate { value: Valued { mut name, .. }, span, text, .. } = found;
    let least = tap.round.unwrap_or(1);
    let told: Vec<bool> = times.iter().map(|times| times.is_some_and(|n| n >= least)).collect();
    let most = times.iter().flatten().max().copied().unwrap_or(0);
    if let Some(round) = tap.round.filter(|round| *round > most) {
        return Err(TapError::Round { value: tap.wanted.clone(), round, most });
    }
    let width = shape.lanes().len();
    for (lanes, told) in lanes.chunks_exact_mut(width).zip(&told) {
        if !told {
            lanes.fill(0);
        }
    }
    if let Some(Wanted { suffix, part, shape: own }) = part {
        lanes = lanes.chunks_exact(width).flat_map(|all| part.pick(all.to_vec())).collect();
        name = name.map(|name| name + &suffix);
        shape = own;
    }
    let round = tap.round;
    let of = "pixel";
    Ok(Tapped {
        span,
        text,
        name,
        function,
        shape,
        size,
        of,
        times,
        lanes,
        has_twin,
        round,
        told,
        changed,
    })
}

pub(crate) struct Read {
    pub(crate) times: Vec<Option<u32>>,
    pub(crate) lanes: Vec<u32>,
    pub(crate) changed: Option<usize>,
}

pub(super) fn read(
    device: &Device,
    drawing: &Drawing<'_>,
    values: &[(&Valued, When)],
    beside: bool,
) -> Result<Vec<Read>, DrawError> {
    let pixels = drawing.size().0 as usize * drawing.size().1 as usize;
    let widths: Vec<usize> = values.iter().filter_map(|(value, _)| value.words()).collect();
    let count: usize = widths.iter().sum();
    let mut words: Vec<Vec<u32>> = vec![Vec::with_capacity(count + WORDS); pixels];
    let (mut changed, mut first) = (None, 0);
    while first < count {
        let colours = beside && first == 0;
        let told = drawing.telling(values, first, !colours)?;
        first += WORDS * told.targets.len();
        let own = told.targets.len();
        let targets: Vec<usize> = told.targets.into_iter().chain(colours.then_some(0)).collect();
        let mut texels = device.texels(&told.drawing, &targets)?;
        for own in texels.drain(..own) {
            words.iter_mut().zip(own).for_each(|(words, own)| words.extend(own));
        }
        if let Some(with) = texels.pop() {
            let without = device.texels(drawing, &[0])?.swap_remove(0);
            changed = Some(with.iter().zip(&without).filter(|(a, b)| a != b).count());
        }
    }
    let mut start = 0;
    let mut of = |width: usize| {
        let lanes = start..start + width - 1;
        start += width;
        Read {
            times: words.iter().map(|words| words[lanes.end].checked_sub(1)).collect(),
            lanes: words.iter().flat_map(|words| &words[lanes.clone()]).copied().collect(),
            changed,
        }
    };
    Ok(widths.into_iter().map(&mut of).collect())
}
