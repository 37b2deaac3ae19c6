//! Runs functions of a package in Karat's engine, which needs no driver.
//!
//! The engine works with naga's IR and 32-bit words. A check works with functions, fixtures and source files. This
//! module converts between the values of the engine and the values of checks.

mod alone;
pub mod asserted;
mod counted;
mod coverage;
mod dispatch;
pub mod equal;
pub mod hazards;
mod order;
mod outside;
mod parting;
pub mod passes;
mod quads;
mod runner;
mod sanitizer;
mod supply;
pub mod trace;
mod work;
mod written;

use std::borrow::Cow;
use std::ops;
use std::sync::Arc;
use std::time::Instant;

pub(crate) use karat_engine::Accuracy;
use karat_engine::{
    Choice, F32, F64, Interval, Intervals, Lane, LaneOf, Observer, Options, Program as Lowered,
    Range, Refusal, Resources, Results, Runs, Settings, Site, Stop, Truth,
};

use crate::diagnostic::{Diagnostic, Span};
use crate::dispatch::Pass;
use crate::dispatch::{DispatchError, Passes};
use crate::fixture::{Fixtures, resolve};
use crate::package::asserts::{ASSERTED, expression_of};
use crate::path::{self, Path, PathError, Via};
use crate::probe::{ProbeError, Probed};
use crate::reflect::{ADAPTER, Function, Program};
use crate::settings;
use crate::value::{Scalar, Shape};

pub use alone::Alone;
pub(crate) use counted::unmeasured;
pub use counted::{Counted, CountedKind, Ran, statements_of};
pub use coverage::{Coverage, of_outside};
pub use coverage::{Missed, Uncovered};
pub use dispatch::dispatch_briefly;
pub use dispatch::dispatch_rounding;
pub use order::{OrderOf, SUBGROUP, Tried, in_order_of};
pub(crate) use parting::parting;
use quads::Quads;
pub use runner::{Run, Runner};
pub use sanitizer::{examine, examine_made_up};
pub use work::{evaluations, long_cases};
pub use written::written;

/// A function that is translated (lowered) for the engine, with its resources.
#[derive(Debug)]
pub struct Interpreted {
    lowered: Lowered,
    resources: Resources,
    arguments: Vec<Scalar>,
    /// The layout of a quad's four pixels. `Some` if each case is a quad.
    quads: Option<Quads>,
    results: Vec<Scalar>,
    function: Box<Function>,
    /// The WGSL program, with the position of each expression in the source files.
    program: Arc<Program>,
    /// The largest number of loop iterations that a case may take.
    fuel: u64,
    /// `true` if the arithmetic treats subnormals as zero.
    flush: bool,
}

/// The settings for translating (lowering) programs. `via` selects the arithmetic: ordinary, `cpu:fma` or `cpu:ftz`.
fn lowering(via: Via) -> Settings {
    let (contract, statements) = (via == Via::Fma, counted::counts());
    // Assertions need names so that tests can observe their values.
    let named: &[&str] = if statements { &[ASSERTED] } else { &[] };
    Settings { contract, statements, named, ..Settings::default() }
}

/// The largest number of loop iterations for a case of a program in which each loop has a known bound. A case with more
/// iterations would take minutes.
const MOST_FUEL: u64 = 1 << 32;

/// The number of iterations after which a run with intervals gives up, if the intervals don't decide whether a loop
/// ends. `MANY_ROUNDS` limits all iterations of such a run.
const FEW_ROUNDS: u64 = 16;
const MANY_ROUNDS: u64 = 4096;

impl Interpreted {
    /// Lowers a function. If the engine can't execute an operation, the error has the operation's position.
    pub fn new(probed: &Probed, fixtures: &Fixtures) -> Result<Self, ProbeError> {
        Self::with(probed, fixtures, &Settings::default())
    }

    /// Lowers a function for the arithmetic that `via` selects: ordinary, `cpu:fma` or `cpu:ftz`.
    pub(crate) fn rounding(
        probed: &Probed,
        fixtures: &Fixtures,
        via: Via,
    ) -> Result<Self, ProbeError> {
        let own = Self::with(probed, fixtures, &lowering(via))?;
        Ok(Self { flush: via == Via::Ftz, ..own })
    }

    fn with(probed: &Probed, fixtures: &Fixtures, settings: &Settings) -> Result<Self, ProbeError> {
        let Probed { program, function, .. } = probed;
        if function.form.alone {
            let name = &function.name;
            let message = format!(
                "function `{name}` writes to variables outside of the function, so Karat's engine can't compute bounds, search \
                 for hazards or check assertions. Run `karat hazards` on the entry points that call the function"
            );
            return Err(PathError::Route { path: Path::CPU, message }.into());
        }
        let lowered = lowered(probed, settings)?;
        let mut resources = Resources::new();
        for (binding, fixture) in resolve(&function.bindings, fixtures)? {
            supply::supply(&mut resources, program, binding, fixture)?;
        }
        let varies = function.parameters.iter().any(|(_, shape)| shape.quad().is_some());
        let of_pixel = |shape: &Shape| shape.quad().unwrap_or(shape).lanes();
        let arguments = function.parameters.iter().flat_map(|(_, shape)| of_pixel(shape)).collect();
        Ok(Self {
            lowered,
            resources,
            arguments,
            quads: (function.form.fragment || varies).then(|| Quads::of(function)),
            results: function.result.lanes(),
            function: Box::new(function.clone()),
            flush: false,
            program: Arc::clone(program),
            // A loop with a bound ends. The last check of a loop's condition counts as an iteration, too. There is at
            // most one such check for each iteration of the surrounding loop.
            fuel: match program.most_rounds() {
                Some(rounds) => rounds.saturating_mul(2).min(MOST_FUEL).max(settings::fuel()),
                None => settings::fuel(),
            },
        })
    }

    /// Sets the largest number of loop iterations.
    pub(crate) fn with_fuel(self, fuel: u64) -> Self {
        Self { fuel, ..self }
    }

    /// Makes calls take the arguments of all four pixels of a quad, and return the result of the pixel `own` (0 to 3).
    fn at_pixel(mut self, own: usize) -> Self {
        self.quads.iter_mut().for_each(|quads| quads.own = Some(own));
        self
    }

    fn own(&self) -> usize {
        self.quads.as_ref().and_then(|quads| quads.own).unwrap_or(0)
    }

    pub(crate) fn place(&self) -> &Span {
        &self.function.span
    }

    pub(crate) fn results(&self) -> &[Scalar] {
        &self.results
    }

    /// The results of some cases as `u32` words, as a driver would write them into a buffer.
    pub(crate) fn words(&self, cases: usize, arguments: &[u32]) -> Result<Vec<u32>, ProbeError> {
        let counts = self.lowered.counts();
        let options = Options { counts: counts.clone(), ..self.options() };
        let words = self.words_of(self.call_with::<F32>(cases, arguments, &options)?)?;
        counted::note(&self.program, &self.lowered, counts, &|case| {
            let width = arguments.len() / cases;
            let row = arguments.chunks(width.max(1)).nth(case / self.lanes())?;
            Some(self.function.shown(row))
        });
        Ok(words)
    }

    fn words_of(&self, results: Results<F32>) -> Result<Vec<u32>, ProbeError> {
        let mut words = results.words();
        if self.quads.is_some() {
            let width = self.results.len().max(1);
            let own = words.chunks(width).skip(self.own()).step_by(quads::PIXELS);
            words = own.flatten().copied().collect();
        }
        let whole = |word: &u32| {
            let bits = u16::try_from(*word).expect("a half has 16 bits");
            half::f16::from_bits(bits).to_f32().to_bits()
        };
        each_half(&self.results, || &mut words, whole);
        Ok(words)
    }

    /// For each scalar of the results, `true` if the scalar depends on something that WGSL leaves open: a read or a
    /// write outside of an array or a texture, a derivative, or the mip level of a sampled texture. WGSL sets no bound
    /// for the errors of derivatives and mip levels (section 15.7.4).
    pub fn strays(&self, cases: usize, arguments: &[u32]) -> Result<Vec<bool>, ProbeError> {
        let mut open = self.of_outside(cases, arguments)?;
        if let Some(quads) = &self.quads {
            quads.open(arguments, &mut open, |rows| self.words(cases, rows))?;
        }
        Ok(open)
    }

    /// For each scalar of the results, `true` if the scalar depends on a read or a write outside of an array or a
    /// texture.
    fn of_outside(&self, cases: usize, arguments: &[u32]) -> Result<Vec<bool>, ProbeError> {
        differing(|outside| {
            let options = Options { outside, ..self.options() };
            self.words_of(self.call_with::<F32>(cases, arguments, &options)?)
        })
    }

    /// The values that WGSL allows for each scalar of some results. The bounds use the exact decimals of the shader's
    /// constants, as a reference does.
    pub fn bounds(&self, cases: usize, arguments: &[u32]) -> Result<Vec<Bound>, ProbeError> {
        self.bounded(cases, arguments, &Options { decimals: true, ..self.options() })
    }

    /// The values that WGSL allows a driver to return. Drivers round the shader's constants to `f32`, so these values
    /// are within [`bounds`](Self::bounds).
    pub(crate) fn driver_bounds(
        &self,
        cases: usize,
        arguments: &[u32],
    ) -> Result<Vec<Bound>, ProbeError> {
        self.bounded(cases, arguments, &self.options())
    }

    /// The bounds that follow from an adapter's measured accuracy. These bounds are never wider than
    /// [`bounds`](Self::bounds).
    pub(crate) fn measured_bounds(
        &self,
        cases: usize,
        arguments: &[u32],
        accuracy: &Arc<Accuracy>,
    ) -> Result<Vec<Bound>, ProbeError> {
        let accuracy = Some(Arc::clone(accuracy));
        let options = Options { decimals: true, accuracy, ..self.options() };
        self.bounded(cases, arguments, &options)
    }

    fn bounded(
        &self,
        cases: usize,
        arguments: &[u32],
        options: &Options,
    ) -> Result<Vec<Bound>, ProbeError> {
        self.expect_bounds()?;
        let results = self.call_with::<Intervals>(cases, arguments, options)?;
        Ok((0..cases).flat_map(|case| results.row(case)).map(Bound::of).collect())
    }

    /// Bounds that hold for all arguments between the arguments of two rows. The bounds are computed like
    /// [`driver_bounds`](Self::driver_bounds). Returns `None` for quads and for 16-bit floats.
    pub(crate) fn bounds_between(
        &self,
        cases: usize,
        rows: [&[u32]; 2],
    ) -> Result<Option<Vec<Bound>>, ProbeError> {
        if self.quads.is_some() || self.arguments.contains(&Scalar::F16) {
            return Ok(None);
        }
        // Limits the iterations of loops, because a proof must be quick.
        let options = Options { undecided: FEW_ROUNDS, fuel: MANY_ROUNDS, ..self.options() };
        let results = self.lowered.call_between(cases, rows, &self.resources, &options, &());
        let results = results.map_err(|stop| stopped(&self.program, &self.function.name, &stop))?;
        Ok(Some((0..cases).flat_map(|case| results.row(case)).map(Bound::of).collect()))
    }

    /// Runs the function once with intervals, for all arguments between the arguments of two rows. Returns `false` if
    /// the engine can't run the function in this way.
    fn watched_between(&self, rows: [&[u32]; 2], observer: &dyn Observer<Intervals>) -> bool {
        let options = Options { undecided: FEW_ROUNDS, fuel: MANY_ROUNDS, ..self.options() };
        let ran = || self.lowered.call_between(1, rows, &self.resources, &options, observer);
        self.quads.is_none() && ran().is_ok()
    }

    pub(crate) fn shadow(&self, cases: usize, arguments: &[u32]) -> Result<Vec<f64>, ProbeError> {
        let results = self.call::<F64>(cases, arguments)?;
        let pixels = self.lanes();
        let lanes = (0..cases).flat_map(|case| results.row(case * pixels));
        let lanes = lanes.zip(self.results.iter().cycle());
        let value = |(lane, scalar): (LaneOf<F64>, &Scalar)| match lane {
            Lane::Float(x) => x,
            Lane::Int(word) => scalar.decode(word),
            Lane::Bool(x) => f64::from(u8::from(x)),
        };
        Ok(lanes.map(value).collect())
    }

    /// The number of invocations that a case needs: one, or four if each case is a quad.
    fn lanes(&self) -> usize {
        if self.quads.is_some() { quads::PIXELS } else { 1 }
    }

    /// Returns an error if the function takes derivatives, because WGSL doesn't bound their errors.
    fn expect_bounds(&self) -> Result<(), ProbeError> {
        if self.quads.is_none() {
            return Ok(());
        }
        let name = &self.function.name;
        let message = format!(
            "`{name}` takes derivatives, and WGSL requires no accuracy of derivatives: use a tolerance such as \
             `Abs` instead of `Spec`"
        );
        Err(PathError::Route { path: Path::CPU, message }.into())
    }

    /// The operation that made a bound infinite: its position in the source file, and its text.
    pub fn cause(&self, bound: &Bound) -> Option<(Span, String)> {
        let Bound::Float(interval) = bound else { return None };
        author(&self.program, self.lowered.cause(*interval)?.span.to_range()?)
    }

    fn call<A: Runs>(&self, cases: usize, arguments: &[u32]) -> Result<Results<A>, ProbeError> {
        self.call_with(cases, arguments, &self.options())
    }

    fn options(&self) -> Options {
        let deadline = Instant::now().checked_add(settings::deadline());
        Options { fuel: self.fuel, deadline, flush: self.flush, ..Options::default() }
    }

    fn call_with<A: Runs>(
        &self,
        cases: usize,
        arguments: &[u32],
        options: &Options,
    ) -> Result<Results<A>, ProbeError> {
        self.observed(cases, arguments, options, &())
    }

    fn observed<A: Runs>(
        &self,
        cases: usize,
        arguments: &[u32],
        options: &Options,
        observer: &dyn Observer<A>,
    ) -> Result<Results<A>, ProbeError> {
        path::caught(Path::CPU, &[&self.function.name], Some(&self.function.span), || {
            self.run(cases, arguments, options, observer).map_err(|stop| self.error(&stop))
        })
    }

    fn error(&self, stop: &Stop) -> ProbeError {
        match stopped(&self.program, &self.function.name, stop) {
            // The engine counts pixels, and each case is a quad of several pixels.
            ProbeError::Rounds { case, diagnostic } if self.quads.is_some() => {
                ProbeError::Rounds { case: case / quads::PIXELS, diagnostic }
            }
            error => error,
        }
    }

    fn run<A: Runs>(
        &self,
        cases: usize,
        arguments: &[u32],
        options: &Options,
        observer: &dyn Observer<A>,
    ) -> Result<Results<A>, Stop> {
        let (cases, mut rows) = match &self.quads {
            Some(quads) => (cases * quads::PIXELS, Cow::Owned(quads.pixels(arguments))),
            None => (cases, Cow::Borrowed(arguments)),
        };
        // Rows of arguments contain 16-bit floats as 32-bit floats. The engine needs the bits of the 16-bit float.
        let half = |word: &u32| u32::from(half::f16::from_f32(f32::from_bits(*word)).to_bits());
        each_half(&self.arguments, || rows.to_mut(), half);
        self.lowered.call::<A>(cases, &rows, &self.resources, options, observer)
    }
}

fn lowered(probed: &Probed, settings: &Settings) -> Result<Lowered, ProbeError> {
    let Probed { program, function, .. } = probed;
    let settings = Settings { quads: function.form.fragment, ..settings.clone() };
    let lowered = match program.adapted(function)? {
        Some((module, info)) => Lowered::function(&module, &info, ADAPTER, &settings),
        None => {
            let (module, info) = (program.module(), program.info());
            Lowered::function(module, info, &function.linked, &settings)
        }
    };
    Ok(lowered.map_err(|refusal| refused(program, &refusal))?)
}

/// The position and the text of an expression in the source file.
pub(crate) fn author(program: &Program, range: ops::Range<usize>) -> Option<(Span, String)> {
    let span = program.resolve(range)?;
    if let Some(own) = expression_of(&span) {
        let text = own.file.text.get(own.range.clone())?.trim().to_owned();
        return Some((own, text));
    }
    let text = crate::reflect::whole_call(&span.file.text, span.range.clone())?.to_owned();
    Some((span, text))
}

/// The position and the text of an operation in the source file. Adds the sign to the expression `-x`, because naga
/// gives this expression the source range of `x`.
fn author_of(program: &Program, site: &Site) -> Option<(Span, String)> {
    let range = site.span.to_range()?;
    let (mut span, text) = author(program, range)?;
    if !site.expression.is_some_and(|at| program.negates(&site.function, at.index())) {
        return Some((span, text));
    }
    let sign = '-';
    let before = span.file.text.get(..span.range.start)?.trim_end();
    if !text.starts_with(sign) && before.ends_with(sign) {
        let start = before.len() - 1;
        let text = format!("{}{text}", span.file.text.get(start..span.range.start)?);
        span.range.start = start;
        return Some((span, text));
    }
    Some((span, text))
}

/// The position of an operation's statement or condition in the source file, cut off after the first line.
fn statement_of(program: &Program, site: &Site) -> Option<Span> {
    let mut span = program.resolve(site.span.to_range()?)?;
    // naga's range of a `for` condition includes the space before the condition.
    let text = span.file.text.get(span.range.clone())?;
    span.range.start += text.len() - text.trim_start().len();
    // naga's range of a call has only the function's name.
    if let Some(whole) = crate::reflect::whole_call(&span.file.text, span.range.clone()) {
        span.range.end = span.range.start + whole.len();
    }
    Some(span.first_line())
}

/// The values that WGSL allows for one scalar of a result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Bound {
    /// The bound of a float.
    Float(Interval),
    /// The bound of an integer.
    Int(Range),
    /// The bound of a boolean.
    Bool(Truth),
}

impl Bound {
    fn of(lane: LaneOf<Intervals>) -> Self {
        match lane {
            Lane::Float(interval) => Self::Float(interval),
            Lane::Int(range) => Self::Int(range),
            Lane::Bool(truth) => Self::Bool(truth),
        }
    }

    /// Checks if WGSL allows a value.
    pub fn allows(&self, value: f64) -> bool {
        self.ends().is_none_or(|(least, most)| least <= value && value <= most)
    }

    /// Checks if the bound is infinite only because implementations may reorder operations.
    pub(crate) fn is_reordered(&self) -> bool {
        matches!(self, Self::Float(x) if x.is_reordered())
    }

    /// The smallest and the largest allowed value. Returns `None` if any value is allowed.
    pub fn ends(&self) -> Option<(f64, f64)> {
        match self {
            Self::Float(x) => x.is_bounded().then(|| (f64::from(x.lo()), f64::from(x.hi()))),
            #[expect(clippy::cast_precision_loss, reason = "they are of 32 bits")]
            Self::Int(range) => Some((range.lo() as f64, range.hi() as f64)),
            Self::Bool(Truth::False) => Some((0.0, 0.0)),
            Self::Bool(Truth::True) => Some((1.0, 1.0)),
            Self::Bool(Truth::Undecided) => Some((0.0, 1.0)),
        }
    }
}

/// For each word that the passes write, `true` if the word depends on a read or a write outside of an array. WGSL
/// allows several values for such a word.
pub fn strays(passes: &Passes) -> Result<Vec<bool>, DispatchError> {
    differing(|outside| {
        let options = |_: usize| Options { outside, ..dispatch::options() };
        let afterwards = dispatch::dispatched(passes, &options)?;
        Ok(afterwards.into_iter().flat_map(|(_, words)| words).collect())
    })
}

/// Calls `run` several times, with different effects of reads and writes outside of arrays. For each word of the
/// results, returns `true` if the word differs between the calls.
fn differing<E>(run: impl Fn(Choice) -> Result<Vec<u32>, E>) -> Result<Vec<bool>, E> {
    let usual = run(Choice::default())?;
    let mut differs = vec![false; usual.len()];
    for choice in outside::choices() {
        let other = run(choice)?;
        let words = usual.iter().zip(&other);
        differs.iter_mut().zip(words).for_each(|(differs, (a, b))| *differs |= a != b);
    }
    Ok(differs)
}

/// The name of the invocation `number` in messages. In a draw, the invocation is a pixel: `pixel (3, 4)`.
fn invocation(pass: &Pass, size: [u32; 3], number: usize) -> String {
    if pass.drawn.is_none() {
        return pass.invocation(size, number);
    }
    let [x, y] = karat_engine::pixel_of(number, pass.workgroups[0]);
    format!("pixel ({x}, {y})")
}

/// The error for an operation that the engine can't execute, with the operation's position.
fn refused(program: &Program, refusal: &Refusal) -> PathError {
    let place = place(program, refusal.span.to_range());
    let place = place.map_or_else(String::new, |place| format!(" ({place})"));
    PathError::Route { path: Path::CPU, message: format!("{refusal}{place}") }
}

fn place(program: &Program, range: Option<ops::Range<usize>>) -> Option<Span> {
    range.and_then(|range| program.resolve(range))
}

fn stopped(program: &Program, name: &str, stop: &Stop) -> ProbeError {
    let (span, case, message, note) = match stop {
        Stop::Fuel { span, case, rounds, own } => {
            let which = match is_of_several(*rounds, *own) {
                true => "its loops, counted together,",
                false => "this loop",
            };
            let message =
                format!("on path `cpu` `{name}` was stopped: {which} had run {rounds} iterations");
            let note = "if the loop needs more iterations, set KARAT_FUEL to a larger number";
            (span, case, message, note)
        }
        Stop::Late { span, case } => {
            let seconds = settings::deadline().as_secs_f64();
            let message = format!(
                "on path `cpu` `{name}` was stopped: this loop was still running after {seconds} s"
            );
            let note =
                "if the loop needs more time, set KARAT_TIMEOUT to a larger number of seconds";
            (span, case, message, note)
        }
        Stop::Waits { span, case } => {
            let message = format!(
                "on path `cpu` `{name}` was stopped: this loop waits for a value that no invocation can change any more"
            );
            let note = "change the shader: the invocation that stores the value must not wait in a loop or at a barrier before this store";
            (span, case, message, note)
        }
        other => {
            let message = other.to_string();
            return PathError::Route { path: Path::CPU, message }.into();
        }
    };
    let mut diagnostic = Diagnostic::new(message).note(note);
    if let Some(place) = place(program, span.to_range()) {
        diagnostic = diagnostic.at(place.first_line(), "");
    }
    ProbeError::Rounds { case: *case, diagnostic: Box::new(diagnostic) }
}

/// Checks if many loops together used up a call's limit of `rounds` iterations. Then `own`, the largest number of
/// iterations of a single loop, is less than 1/16 of the limit, and the loops may still end. If each iteration of an
/// endless loop runs at most 15 iterations of inner loops, at least 1/16 of all iterations are the endless loop's own,
/// and this function returns `false`.
fn is_of_several(rounds: u64, own: u64) -> bool {
    own < rounds / 16
}

/// Applies `change` to the 16-bit floats in rows of arguments or results.
fn each_half<'w>(
    scalars: &[Scalar],
    words: impl FnOnce() -> &'w mut Vec<u32>,
    change: impl Fn(&u32) -> u32,
) {
    if scalars.contains(&Scalar::F16) {
        let words = words().iter_mut().zip(scalars.iter().cycle());
        words.filter(|(_, s)| **s == Scalar::F16).for_each(|(word, _)| *word = change(word));
    }
}
