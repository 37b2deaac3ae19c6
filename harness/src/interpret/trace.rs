//! Traces each operation of one call in three arithmetics: `f32`, `f64` and intervals.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use karat_engine::{
    F32, F64, Interval, Intervals, Lanes, Observer, Program as Lowered, Range, Resources, Runs,
    Site, Truth, Wrong,
};

use super::dispatch::{in_order, options};
use super::{Alone, Interpreted};
use crate::diagnostic::Span;
use crate::dispatch::{DispatchError, Pass, Passes};
use crate::fixture::Fixtures;
use crate::hazard::Kind;
use crate::probe::{ProbeError, Probed};
use crate::reflect::Program;

/// One run of an operation, with a value for each component.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Step {
    /// The position of the operation in the source file.
    pub span: Span,
    /// The text of the operation in the source file.
    pub text: String,
    /// The name of the `let` for the value, if there is one.
    pub name: Option<String>,
    /// The value in `f32`, rounded to nearest. A conforming implementation may return this value.
    pub single: Vec<Value>,
    /// The value in double precision; empty if the run in double precision takes another branch.
    pub double: Vec<Value>,
    /// The smallest and the largest value that WGSL allows for each component. `None` if WGSL allows any value. The
    /// list is empty if the run with intervals takes another branch or isn't possible.
    pub allowed: Vec<Option<(Value, Value)>>,
}

/// The value of one component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// An `f32`.
    Single(f32),
    /// A float in double precision.
    Double(f64),
    /// An `i32` or a `u32`.
    Int(i64),
    /// A `bool`.
    Bool(bool),
}

/// The largest number of steps in a trace. A loop can have many steps, and a longer trace would be unreadable.
const MOST: usize = 1000;

#[derive(Clone, Copy)]
enum Seen {
    Single(f32),
    Double(f64),
    Interval(Interval),
    Word(u32),
    Range(Range),
    Bool(bool),
    Truth(Truth),
    Anything,
}

/// The values of operations, in the order in which they ran.
struct Values {
    all: Mutex<Vec<(usize, Seen)>>,
    /// `true` after an index was outside of its array. From then on, the trace says that WGSL allows any value.
    lost: AtomicBool,
    case: usize,
    /// For each site (operation), the number of values to keep. `None` sets one limit for all sites together.
    most: Option<Most>,
}

/// For each site (operation), the number of values to keep, and the number of values kept so far.
type Most = Arc<BTreeMap<usize, (usize, AtomicUsize)>>;

macro_rules! values {
    ($arithmetic:ty, $active:expr, $float:expr, $int:expr, $bool:expr, $lost:expr) => {
        impl Observer<$arithmetic> for Values {
            fn floats(&self, lanes: &Lanes<'_, $arithmetic>) {
                Observer::<$arithmetic>::others(self, lanes);
            }

            fn others(&self, lanes: &Lanes<'_, $arithmetic>) {
                let mut values = self.all.lock().unwrap_or_else(PoisonError::into_inner);
                let Some(at) = self.case.checked_sub(lanes.case) else { return };
                if !lanes.active.get(at).is_some_and($active)
                    || self.has_enough(lanes.site, values.len())
                {
                    return;
                }
                let floats = lanes.floats.iter().map(|lane| $float(lane[at]));
                let ints = lanes.ints.iter().map(|lane| $int(lane[at]));
                let seen = floats.chain(ints).chain(lanes.bools.iter().map(|lane| $bool(lane[at])));
                let lost = $lost && self.lost.load(Ordering::Relaxed);
                let seen = seen.map(|seen| if lost { Seen::Anything } else { seen });
                let site = std::ptr::from_ref(lanes.site).addr();
                values.extend(seen.map(|seen| (site, seen)));
            }

            fn wrong(&self, one: &Wrong<'_>) {
                if one.kind == Kind::OutOfRange && one.case == self.case {
                    self.lost.store(true, Ordering::Relaxed);
                }
            }
        }
    };
}
values!(F32, |active: &bool| *active, Seen::Single, Seen::Word, Seen::Bool, false);
values!(F64, |active: &bool| *active, Seen::Double, Seen::Word, Seen::Bool, false);
values!(
    Intervals,
    |active: &Truth| *active != Truth::False,
    Seen::Interval,
    Seen::Range,
    Seen::Truth,
    true
);

impl Values {
    fn of(case: usize, most: Option<Most>) -> Self {
        Self { all: Mutex::default(), lost: AtomicBool::new(false), case, most }
    }

    /// Checks if Karat has recorded enough values of this site. `kept` is the number of recorded values of all sites.
    fn has_enough(&self, site: &Site, kept: usize) -> bool {
        let Some(most) = &self.most else { return kept >= 16 * MOST };
        let own = most.get(&std::ptr::from_ref(site).addr());
        own.is_none_or(|(most, seen)| seen.fetch_add(1, Ordering::Relaxed) >= *most)
    }

    /// Groups the recorded values by runs of operations. A group is one run of an operation: its site, a number that
    /// counts the runs at this site, and a value for each component. `components` returns the number of components at a
    /// site.
    fn groups(self, components: &dyn Fn(usize) -> usize) -> Vec<((usize, usize), Vec<Seen>)> {
        let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
        let mut groups: Vec<((usize, usize), Vec<Seen>)> = Vec::new();
        for (site, value) in self.all.into_inner().unwrap_or_else(PoisonError::into_inner) {
            match groups.last_mut() {
                // In a loop with only one operation, this operation's values of several iterations follow each other.
                Some(((last, _), values)) if *last == site && values.len() < components(site) => {
                    values.push(value);
                }
                _ => {
                    let count = counts.entry(site).or_default();
                    groups.push(((site, *count), vec![value]));
                    *count += 1;
                }
            }
        }
        groups
    }
}

impl Seen {
    /// The value that a trace shows. `signed` is `true` if an integer is an `i32`.
    fn value(self, signed: bool) -> Value {
        match self {
            Self::Single(x) => Value::Single(x),
            Self::Double(x) => Value::Double(x),
            Self::Word(word) if signed => Value::Int(i64::from(word.cast_signed())),
            Self::Word(word) => Value::Int(i64::from(word)),
            Self::Bool(x) => Value::Bool(x),
            // Interval arithmetic returns bounds instead of values, and a trace shows these separately.
            Self::Interval(_) | Self::Range(_) | Self::Truth(_) | Self::Anything => {
                Value::Single(f32::NAN)
            }
        }
    }

    fn ends(self) -> Option<(Value, Value)> {
        match self {
            Self::Interval(x) => {
                x.is_bounded().then(|| (Value::Single(x.lo()), Value::Single(x.hi())))
            }
            Self::Range(x) => Some((Value::Int(x.lo()), Value::Int(x.hi()))),
            Self::Truth(x) => Some((Value::Bool(x == Truth::True), Value::Bool(x != Truth::False))),
            _ => None,
        }
    }
}

/// The operations of a call in `f32` and in `f64`, with WGSL's bounds. `arguments` has the bits of each scalar of the
/// arguments.
///
/// ```
/// use karat::Package;
/// use karat::unstable::probe::Probed;
///
/// let text = "fn hidden(x: f32) -> f32 { let square = x * x; return 1.0 - square; }";
/// let probed = Probed::new(&Package::from_source("m", text), "hidden")?;
/// let steps = karat::unstable::trace::trace(&probed, &Vec::new(), &[0.5_f32.to_bits()])?;
/// assert_eq!(steps[0].name.as_deref(), Some("square"));
/// # Ok::<(), karat::unstable::probe::ProbeError>(())
/// ```
///
/// # Errors
/// Returns an error if the engine can't execute the function, or if a variable has no fixture.
pub fn trace(
    probed: &Probed,
    fixtures: &Fixtures,
    arguments: &[u32],
) -> Result<Vec<Step>, ProbeError> {
    let steps = match probed.function().form.alone {
        true => steps(&Alone::new(probed, fixtures)?, arguments, 0, None),
        false => steps(&Interpreted::new(probed, fixtures)?, arguments, 0, None),
    };
    Ok(steps?.0)
}

/// The trace of a call at one pixel of a quad.
pub(crate) struct Pixel {
    /// The operations. If an operation runs often, `steps` has only the first runs.
    pub(crate) steps: Vec<Step>,
    /// `true` if an operation ran more often than `steps` shows.
    pub(crate) more: bool,
    pub(crate) results: Vec<u32>,
}

/// Traces the call of a fragment function at one pixel of a quad. Bit 0 of `own` is set for a pixel on the right, and
/// bit 1 for a pixel below. `quad` has the arguments at all four pixels.
///
/// # Errors
/// Returns an error for the same reasons as [`trace`].
pub(crate) fn trace_pixel(
    probed: &Probed,
    fixtures: &Fixtures,
    quad: &[Vec<u32>; 4],
    own: usize,
) -> Result<Pixel, ProbeError> {
    let runs = Some(BRIEFLY);
    if probed.function().form.alone {
        let (alone, row) = (Alone::new(probed, fixtures)?, with_slopes(probed, quad, own));
        let (steps, more) = steps(&alone, &row, 0, runs)?;
        return Ok(Pixel { steps, more, results: alone.words(1, &row)? });
    }
    let called = Interpreted::new(probed, fixtures)?.at_pixel(own);
    let row = match called.quads {
        Some(_) => quad.concat(),
        None => quad[own].clone(),
    };
    let (steps, more) = steps(&called, &row, called.own(), runs)?;
    Ok(Pixel { steps, more, results: called.words(1, &row)? })
}

/// The row of arguments for a kernel that runs at one pixel. After each argument that varies, the row has the
/// argument's slopes to the right and downwards.
fn with_slopes(probed: &Probed, quad: &[Vec<u32>; 4], own: usize) -> Vec<u32> {
    let (mut row, mut at) = (Vec::new(), 0);
    for (_, shape) in &probed.function().parameters {
        let scalars = shape.quad().unwrap_or(shape).lanes();
        row.extend(&quad[own][at..at + scalars.len()]);
        // The indices of the two pixels in the row of the pixel `own`, and of the two pixels in its column.
        let sides = shape.quad().map(|_| [[own & 2, own | 1], [own & 1, own | 2]]);
        for [before, behind] in sides.into_iter().flatten() {
            row.extend(scalars.iter().enumerate().map(|(index, scalar)| {
                let value = |pixel: usize| f32::from_bits(quad[pixel][at + index]);
                let slope = if scalar.is_float() { value(behind) - value(before) } else { 0.0 };
                slope.to_bits()
            }));
        }
        at += scalars.len();
    }
    row
}

/// The largest number of runs of an operation that a pixel's trace shows. Three iterations of a loop show how the loop
/// continues.
pub(crate) const BRIEFLY: usize = 3;

/// Traces one invocation of the last pass: `invocation` is its `global_invocation_id`. The steps have no bounds,
/// because the engine can't store intervals in the buffers and textures that the pass writes.
pub(crate) fn trace_pass(
    passes: &Passes,
    invocation: [u32; 3],
) -> Result<Vec<Step>, DispatchError> {
    let last = passes.passes.last().expect("they have one");
    let mut before = None;
    let all = in_order(passes, &mut |pass, lowered, resources| {
        let is_last = std::ptr::eq(pass, last);
        let size = lowered.workgroup_size().expect("a pass is an entry point");
        if is_last {
            before = Some((resources.clone(), size));
        } else {
            lowered.dispatch::<F32>(pass.workgroups, resources, &options(), &())?;
        }
        Ok(!is_last)
    });
    all?;
    let (resources, size) = before.expect("each pass before it goes on");
    let counts: [u32; 3] = std::array::from_fn(|k| size[k].saturating_mul(last.workgroups[k]));
    if invocation.iter().zip(&counts).any(|(index, count)| index >= count) {
        let name = last.name.clone();
        return Err(DispatchError::Invocation { name, invocation, counts });
    }
    let flat = |at: [u32; 3], counts: [u32; 3]| {
        let [at, counts] = [at, counts].map(|all| all.map(|one| one as usize));
        at[0] + counts[0] * (at[1] + counts[1] * at[2])
    };
    let group = flat(std::array::from_fn(|k| invocation[k] / size[k]), last.workgroups);
    let local = flat(std::array::from_fn(|k| invocation[k] % size[k]), size);
    let width: usize = size.iter().map(|count| *count as usize).product();
    let lowered = super::dispatch::lowered(last, &karat_engine::Settings::default())?;
    let pass = OfPass { pass: last, lowered, resources };
    Ok(steps(&pass, &[], group * width + local, None)?.0)
}

/// A pass to trace, with the contents that the earlier passes left in its resources.
struct OfPass<'p> {
    pass: &'p Pass,
    lowered: Lowered,
    resources: Resources,
}

impl Traced for OfPass<'_> {
    fn run<A: Runs>(&self, _: &[u32], observer: &dyn Observer<A>) -> Result<(), ProbeError> {
        let mut resources = self.resources.clone();
        let ran =
            self.lowered.dispatch::<A>(self.pass.workgroups, &mut resources, &options(), observer);
        ran.map_err(|stop| super::stopped(&self.pass.program, &self.pass.name, &stop))
    }

    fn parts(&self) -> (&Lowered, &Program) {
        (&self.lowered, &self.pass.program)
    }
}

/// Code that Karat can trace in each arithmetic: a function, or a kernel that writes buffers. Buffers always contain
/// `f32`, even if the operations use `f64`.
pub(super) trait Traced {
    fn run<A: Runs>(&self, row: &[u32], observer: &dyn Observer<A>) -> Result<(), ProbeError>;

    fn parts(&self) -> (&Lowered, &Program);
}

impl Traced for Interpreted {
    fn run<A: Runs>(&self, row: &[u32], observer: &dyn Observer<A>) -> Result<(), ProbeError> {
        self.observed(1, row, &self.options(), observer).map(drop)
    }

    fn parts(&self) -> (&Lowered, &Program) {
        (&self.lowered, &self.program)
    }
}

/// The operations of a call, in the order in which they run. `case` selects the pixel of a quad, or the invocation of a
/// pass. Returns the first `runs` runs of each operation, and `true` if an operation ran more often.
fn steps(
    traced: &impl Traced,
    row: &[u32],
    case: usize,
    runs: Option<usize>,
) -> Result<(Vec<Step>, bool), ProbeError> {
    let most = || -> Option<Most> {
        let (lowered, program) = traced.parts();
        let limit = |site: &Site| {
            let at = site.expression.map(|at| at.index());
            let components = at.map_or(1, |at| program.components(&site.function, at));
            // The engine computes a derivative by several operations at one site. The last one returns it.
            let is_many = at.is_some_and(|at| program.is_derivative(&site.function, at));
            let limit = if is_many { usize::MAX } else { runs.unwrap_or(0) * components };
            (std::ptr::from_ref(site).addr(), (limit, AtomicUsize::new(0)))
        };
        runs.map(|_| Arc::new(lowered.sites().iter().map(limit).collect()))
    };
    let most_of_single = most();
    let single = Values::of(case, most_of_single.clone());
    let [double, bounds] = [(); 2].map(|()| Values::of(case, most()));
    traced.run::<F32>(row, &single)?;
    traced.run::<F64>(row, &double)?;
    // Some builtin functions of half precision have no bounds. Kernels that write buffers have no bounds, either. The
    // column of bounds is then empty.
    let bounded = traced.run::<Intervals>(row, &bounds).is_ok();
    let (lowered, program) = traced.parts();
    let sites: BTreeMap<usize, &Site> =
        lowered.sites().iter().map(|one| (std::ptr::from_ref(one).addr(), one)).collect();
    let at = |site: usize| {
        let site = sites.get(&site)?;
        Some((site.function.as_str(), site.expression?.index()))
    };
    let components =
        |site: usize| at(site).map_or(1, |(function, at)| program.components(function, at));
    let double: BTreeMap<_, Vec<Seen>> = double.groups(&components).into_iter().collect();
    let bounds: BTreeMap<_, Vec<Seen>> = match bounded {
        true => bounds.groups(&components).into_iter().collect(),
        false => BTreeMap::new(),
    };
    let step = |(key, single): ((usize, usize), Vec<Seen>)| {
        let (span, text) = super::author_of(program, sites.get(&key.0)?)?;
        let signed = at(key.0).is_some_and(|(function, at)| program.is_signed(function, at));
        let values = |seen: &[Seen]| seen.iter().map(|seen| seen.value(signed)).collect::<Vec<_>>();
        let name = at(key.0).and_then(|(function, at)| program.let_name(function, at));
        Some(Step {
            span,
            text,
            name: name.map(str::to_owned),
            single: values(&single),
            double: double.get(&key).map(|seen| values(seen)).unwrap_or_default(),
            allowed: bounds
                .get(&key)
                .map(|seen| seen.iter().map(|seen| seen.ends()).collect())
                .unwrap_or_default(),
        })
    };
    let mut all: Vec<Step> = single.groups(&components).into_iter().filter_map(step).collect();
    let is_beyond = |(most, seen): &(usize, AtomicUsize)| seen.load(Ordering::Relaxed) > *most;
    let more = most_of_single.is_some_and(|all| all.values().any(is_beyond)) || all.len() > MOST;
    all.truncate(MOST);
    Ok((all, more))
}
