//! Finds hazards while a function runs: values that aren't finite, lost digits, indices outside of their arrays, and
//! operations whose results WGSL doesn't bound.
//!
//! A function runs in `f32` and also in `f64` (the shadow). Both runs record each operation with its operands. If an
//! operand is already wrong, an earlier operation is at fault. So Karat reports each hazard at the first operation that
//! has right operands and a wrong result.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Mutex, PoisonError};

use karat_engine::{
    F32, F64, Here, Interval, Intervals, Lane, LaneOf, Lanes, Observer, Reach, Site, Stop, Truth,
    Wrong,
};
use rayon::prelude::*;

use super::{Interpreted, Options, quads};
use crate::diagnostic::Span;
pub use crate::hazard::Kind;
use crate::probe::ProbeError;

/// Describes the first operation that has finite operands and returns NaN or infinity. Returns a name (`first NaN` or
/// `infinite`), and the text and position of the operation.
pub(crate) fn first_not_finite<'f>(
    found: impl Iterator<Item = &'f Found>,
) -> Option<(&'static str, String)> {
    let is_it = |one: &&Found| matches!(one.kind, Kind::Nan | Kind::Infinite);
    let first = found.filter(is_it).min_by_key(|one| (one.kind, one.site))?;
    let name = if first.kind == Kind::Nan { "first NaN" } else { "infinite" };
    let of: Vec<String> = first.operands.iter().map(|x| crate::value::format_f32(*x)).collect();
    let of = if of.is_empty() { String::new() } else { format!(" of {}", of.join(", ")) };
    let text = crate::diagnostic::one_line(&first.text);
    Some((name, format!("`{text}`{of} ({})", first.span)))
}

/// A hazard in one case.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// The kind of the hazard.
    pub kind: Kind,
    /// The operation's site: the index of the operation in the program that the engine runs.
    pub site: usize,
    /// The position of the operation in the source file.
    pub span: Span,
    /// The text of the operation in the source file.
    pub text: String,
    /// `true` if the function's result is finite nevertheless, because a later operation hides the hazard.
    pub hidden: bool,
    /// The operation's value in `f32` and in `f64`, for the hazard "lost digits"; otherwise `None`.
    pub values: Option<(f32, f64)>,
    /// For NaN, infinity and lost digits, the operation's operands in `f32`; otherwise empty.
    pub operands: Vec<f32>,
    /// For a derivative that only one of two neighbouring pixels takes, these two pixels; otherwise `None`.
    pub missing: Option<Missing>,
}

/// Two pixels of a quad: one takes a derivative, and the other doesn't.
#[derive(Clone, Debug, PartialEq)]
pub struct Missing {
    /// The name of the pixel that takes the derivative.
    pub reached: String,
    /// The name of the pixel that doesn't take the derivative.
    pub missing: String,
    /// The condition or the jump at which the pixel `missing` took another branch.
    pub parted: Option<Span>,
}

/// Checks if an operation turns a NaN into a number in the given lane. Implementations may assume that NaN doesn't
/// occur (WGSL, section 15.7.2). So `max` or `clamp` of a NaN, or a comparison with NaN, may return any value. Another
/// driver may show a NaN that this operation hides.
fn absorbs_nan(events: &[Event<f32>], lane: usize) -> bool {
    events.iter().any(|event| {
        let has_nan = event.operands.iter().any(|operand| operand[lane].is_nan());
        event.active[lane] && has_nan && !event.values[lane].is_nan()
    })
}

/// The hazards in some cases.
pub struct Hazards {
    /// For each case, the hazards of each kind, up to the first one that the caller doesn't ignore.
    pub cases: Vec<Vec<Found>>,
    /// `true` if the function runs more operations than Karat records.
    pub cut: bool,
    /// For each site, the number of cases that reached the site with finite operands.
    pub reached: BTreeMap<usize, usize>,
}

/// The number of lanes (cases or pixels) that run together. The engine runs these lanes on one thread, so Karat records
/// their operations in order.
const TOGETHER: usize = 256;

/// The largest number of operations to record in a run. A loop repeats its operations, so a hazard in its thousandth
/// iteration usually occurs in earlier iterations, too.
const MOST_EVENTS: usize = 4096;

/// The largest number of loop iterations of each case in the run with intervals, if the run in `f32` reached
/// [`MOST_EVENTS`]. With sixteen operations in an iteration, both runs then record the same number of operations.
const ROUNDS_SEEN: u64 = 256;

/// Thresholds for the errors of a float format: `f32`, or 16-bit floats.
struct Precision {
    /// A number with a relative error above this value has lost half of its digits.
    lost: f64,
    /// The largest relative error of a precise operand. If all operands are precise, but the result has lost half of
    /// its digits, then the operation itself is the cause.
    precise: f64,
    /// A difference that is smaller than this share of its operands consists only of their rounding errors.
    noise: f64,
    /// The smallest number that implementations don't flush to zero.
    least: f64,
}

impl Precision {
    fn of(half: bool) -> Self {
        match half {
            // The format has 24 bits of precision.
            false => Self {
                lost: 1.0 / 4096.0,
                precise: 1.0 / 1_048_576.0,
                noise: 1.0 / 16_777_216.0,
                least: f64::from(f32::MIN_POSITIVE),
            },
            // The format has 11 bits of precision.
            true => Self {
                lost: 1.0 / 32.0,
                precise: 1.0 / 256.0,
                noise: 1.0 / 2048.0,
                least: 1.0 / 16_384.0,
            },
        }
    }
}

/// The largest number of loop iterations of a case with generated arguments.
pub(super) const PATIENCE: u64 = 4096;

/// The number of iterations after which Karat reports a loop as endless, in a call with generated arguments. A case
/// with this number of iterations takes tenths of a second.
pub const LONG: u64 = 1 << 18;

/// The largest number of loop iterations of a case, if the number of iterations of each loop has a known bound.
const MOST_ROUNDS: u64 = 65_536;

/// The number of iterations after which the run with intervals stops, if the intervals don't decide whether a loop
/// ends. Until then, the engine follows both possibilities in each iteration: the loop ends, or it continues.
const UNDECIDED: u64 = 16;

/// A difference that is smaller than this share (2^-41) of its operands has fewer than 12 correct bits, even in double
/// precision. Double precision rounds an operand by up to 2^-53 of the operand, and 53 - 41 is 12. An `f32` has 24
/// significant bits, so 12 bits are half of its digits.
const BLIND: f64 = 1.0 / 2_199_023_255_552.0;

/// An interval whose relative width is at most this number counts as one number. If all operands of an operation count
/// as one number, and its result is unbounded, then the operation itself is the cause.
const NARROW: f64 = 1.0 / 1024.0;

/// One run of an operation, with the values in all lanes that run together.
struct Event<F> {
    site: usize,
    half: bool,
    values: Vec<F>,
    /// The operands, each with its values in all lanes.
    operands: Vec<Vec<F>>,
    active: Vec<bool>,
}

/// Two pixels of a quad: one takes a derivative, and the other doesn't.
#[derive(Clone, Copy)]
struct Parted {
    /// The indices of the two pixels: first of the pixel that takes the derivative, then of the other pixel.
    pixels: [usize; 2],
    /// The site of the condition or the jump at which the second pixel took another branch.
    by: Option<usize>,
}

/// The hazards of a case, by their kind and the index of their site. If only one of two pixels takes a derivative, the
/// map's value is these two pixels.
type OfCase = BTreeMap<(Kind, usize), Option<Parted>>;

/// Records the operations of a run.
struct Recorder<F> {
    events: Mutex<Vec<Event<F>>>,
    reach: Reach,
    /// For each case, the hazards that the engine reports, such as wrong indices.
    wrong: Mutex<BTreeMap<usize, OfCase>>,
    /// Lanes in which a NaN decides a comparison, or is converted to an integer.
    decided: Mutex<BTreeSet<usize>>,
}

impl<F> Default for Recorder<F> {
    fn default() -> Self {
        let (events, reach, wrong, decided) = Default::default();
        Self { events, reach, wrong, decided }
    }
}

macro_rules! recorder {
    ($arithmetic:ty, $float:ty, $reaches:expr) => {
        impl Observer<$arithmetic> for Recorder<$float> {
            fn floats(&self, lanes: &Lanes<'_, $arithmetic>) {
                let mut events = self.events.lock().unwrap_or_else(PoisonError::into_inner);
                if events.len() < MOST_EVENTS {
                    let site = lanes.site.number;
                    let operands = lanes.operands.iter().map(|lane| lane.to_vec());
                    let operands: Vec<Vec<$float>> = operands.collect();
                    events.extend(lanes.floats.iter().map(|values| Event {
                        site,
                        half: lanes.site.half,
                        values: values.to_vec(),
                        operands: operands.clone(),
                        active: lanes.active.to_vec(),
                    }));
                }
            }

            fn others(&self, lanes: &Lanes<'_, $arithmetic>) {
                // A boolean that selects between floats isn't a float operand.
                if !lanes.floats.is_empty() {
                    return;
                }
                let nan = |lane: &usize| lanes.operands.iter().any(|all| all[*lane].is_nan());
                let used = (0..lanes.active.len()).filter(|lane| lanes.active[*lane] && nan(lane));
                let mut decided = self.decided.lock().unwrap_or_else(PoisonError::into_inner);
                decided.extend(used);
            }

            fn wrong(&self, one: &Wrong<'_>) {
                let mut wrong = self.wrong.lock().unwrap_or_else(PoisonError::into_inner);
                let own = wrong.entry(one.case).or_default();
                let missing = one.missing.map(|missing| Parted {
                    pixels: [one.case, missing.case],
                    by: missing.parted.map(|site| site.number),
                });
                own.entry((one.kind, one.site.number)).or_insert(missing);
            }

            fn reached(&self, here: &Here<'_, $arithmetic>) {
                // The runs in `f32` and `f64` reach the same operations, unless rounding decides a branch.
                if $reaches {
                    self.reach.add(here.site.number, here);
                }
            }
        }
    };
}
recorder!(F32, f32, true);
recorder!(F64, f64, false);

/// Observes a run with intervals, and collects facts about the operations in each lane.
struct Known {
    /// For each lane, the operations that may return any value, in order. The flag is `true` if the operation itself is
    /// the cause: its operands are narrow intervals, but WGSL sets no bound for its result.
    anything: Mutex<BTreeMap<usize, Vec<(usize, bool)>>>,
    /// Lanes and sites where double precision can't show which digits are lost.
    blind: BTreeSet<(usize, usize)>,
    /// For each lane, the first operation whose result is a wide interval: see [`is_wide`].
    wide: Mutex<BTreeMap<usize, usize>>,
}

/// Checks if the numbers of an interval share fewer than half of their digits.
fn is_wide(x: Interval, half: bool) -> bool {
    let (lo, hi) = (f64::from(x.lo()), f64::from(x.hi()));
    !x.is_bounded() || hi - lo > Precision::of(half).lost * lo.abs().max(hi.abs())
}

/// Checks if rounding in double precision makes an operand other than 0 disappear: a sum equals one of its terms, or a
/// function of a small number, such as `cos`, returns 1.
fn absorbs(event: &Event<f64>, lane: usize) -> bool {
    let value = event.values[lane].abs();
    match &*event.operands {
        [x, y] => {
            let (x, y) = (x[lane].abs(), y[lane].abs());
            is_sum(event, lane) && x != 0.0 && y != 0.0 && (value == x || value == y)
        }
        [x] => value == 1.0 && x[lane] != 0.0 && x[lane].abs() < f64::from(f32::EPSILON),
        _ => false,
    }
}

/// Checks if the value is the sum or the difference of the operands.
fn is_sum(event: &Event<f64>, lane: usize) -> bool {
    let value = event.values[lane];
    matches!(&*event.operands, [x, y] if value == x[lane] + y[lane] || value == x[lane] - y[lane])
}

/// Checks if double precision can't show a loss of digits, because double precision loses the digits, too: in a
/// logarithm of 1, or in a sum that is smaller than [`BLIND`] times its largest operand.
fn is_blind(event: &Event<f64>, lane: usize) -> bool {
    let value = event.values[lane].abs();
    let largest = event.operands.iter().map(|x| x[lane].abs()).fold(0.0, f64::max);
    match event.operands.len() {
        1 => largest == 1.0 && value == 0.0,
        _ => is_sum(event, lane) && value < BLIND * largest,
    }
}

/// The lanes and sites where double precision can't show which digits are lost. At such a site, the operation loses
/// digits ([`is_blind`]), and an operand comes from an earlier operation that [`absorbs`] a number.
fn blind(events: &[Event<f64>]) -> BTreeSet<(usize, usize)> {
    // For each lane, the values that were computed from an operand that double precision lost.
    let mut tainted: BTreeMap<usize, BTreeSet<u64>> = BTreeMap::new();
    let mut blind = BTreeSet::new();
    for event in events {
        for lane in (0..event.active.len()).filter(|lane| event.active[*lane]) {
            let own = tainted.get(&lane);
            let comes = own.is_some_and(|own| {
                event.operands.iter().any(|operand| own.contains(&operand[lane].to_bits()))
            });
            if comes && is_blind(event, lane) {
                blind.insert((lane, event.site));
            }
            if comes || absorbs(event, lane) {
                tainted.entry(lane).or_default().insert(event.values[lane].to_bits());
            }
        }
    }
    blind
}

/// The largest number of operations with unbounded results that Karat keeps for each lane. Karat reports the first of
/// them that the caller doesn't ignore.
const KEPT: usize = 16;

/// A function that checks if an operation loses digits, compared with the same operation in double precision.
type Loses<'l> = &'l dyn Fn(&Event<f32>, &Event<f64>) -> bool;

/// A function that checks if the caller ignores a hazard. Karat reports the next hazard of the same kind instead of an
/// ignored one.
pub(crate) type LeftOut<'l> = &'l (dyn Fn(&Found) -> bool + Sync);

impl Observer<Intervals> for Known {
    fn floats(&self, lanes: &Lanes<'_, Intervals>) {
        let narrow = |x: &Interval| {
            let (lo, hi) = (f64::from(x.lo()), f64::from(x.hi()));
            lo == hi || hi - lo <= NARROW * lo.abs().min(hi.abs())
        };
        // A value minus itself is exactly 0. A difference of exact numbers keeps all digits.
        let cancels = |operands: &[Interval]| {
            let is_exact = |x: &Interval| x.lo() == x.hi();
            let alike =
                matches!(operands, [x, y] if x == y || x.lo() == -y.hi() && x.hi() == -y.lo());
            !alike && !operands.iter().all(is_exact)
        };
        let site = lanes.site.number;
        let mut first = self.anything.lock().unwrap_or_else(PoisonError::into_inner);
        let mut wide = self.wide.lock().unwrap_or_else(PoisonError::into_inner);
        for values in lanes.floats {
            for (lane, value) in values.iter().enumerate() {
                let operands = || lanes.operands.iter().map(|operand| operand[lane]);
                if lanes.active[lane] != Truth::True || !operands().all(Interval::is_bounded) {
                    continue;
                }
                if !value.is_bounded() {
                    let sure = !lanes.operands.is_empty() && operands().all(|x| narrow(&x));
                    let all = first.entry(lane).or_default();
                    if all.len() < KEPT && all.iter().all(|(other, _)| *other != site) {
                        all.push((site, sure));
                    }
                } else if self.blind.contains(&(lane, site))
                    && is_wide(*value, lanes.site.half)
                    && cancels(&operands().collect::<Vec<_>>())
                {
                    wide.entry(lane).or_insert(site);
                }
            }
        }
    }
}

impl<F> Recorder<F> {
    fn is_full(&self) -> bool {
        self.events.lock().unwrap_or_else(PoisonError::into_inner).len() >= MOST_EVENTS
    }

    fn events(self) -> (Vec<Event<F>>, Reach) {
        (self.events.into_inner().unwrap_or_else(PoisonError::into_inner), self.reach)
    }
}

/// Pairs the events (recorded operations) of a lane with the events of another run. The two events of a pair come from
/// the same operation in the same iteration of a loop.
struct Twins<'e> {
    by_site: BTreeMap<usize, VecDeque<&'e Event<f64>>>,
}

impl<'e> Twins<'e> {
    fn of(events: &'e [Event<f64>], lane: usize) -> Self {
        let mut by_site: BTreeMap<usize, VecDeque<_>> = BTreeMap::new();
        for event in events.iter().filter(|event| event.active[lane]) {
            by_site.entry(event.site).or_default().push_back(event);
        }
        Self { by_site }
    }

    /// The event of the other run that matches the next event at `site` of this run; `None` if there is none.
    fn next(&mut self, site: usize) -> Option<&'e Event<f64>> {
        self.by_site.get_mut(&site)?.pop_front()
    }
}

impl Interpreted {
    /// The hazards in some cases. For each kind, the list ends with the first hazard that `left_out` doesn't ignore.
    /// `left_out` ignores all earlier hazards of that kind in the list.
    pub fn hazards_but(
        &self,
        cases: usize,
        rows: &[u32],
        left_out: LeftOut<'_>,
    ) -> Result<Hazards, ProbeError> {
        let width = rows.len().checked_div(cases).unwrap_or_default();
        let together = TOGETHER / self.lanes();
        let cases_of = Vec::with_capacity(cases);
        let mut found = Hazards { cases: cases_of, cut: false, reached: BTreeMap::new() };
        let of_part = |first: usize| {
            let count = together.min(cases - first);
            let part = &rows[first * width..][..count * width];
            self.hazards_of_chunk(count, part, left_out)
        };
        // If a loop may be endless, the first part runs before all others. It usually shows the endless loop, and then
        // the other parts needn't run.
        let alone = usize::from(self.program.most_rounds().is_none() && cases > 0);
        let mut parts = (0..alone).map(|_| of_part(0)).collect::<Vec<_>>();
        if parts.iter().all(Result::is_ok) {
            // Parts are interleaved, so that no core waits for a function with long loops.
            let firsts: Vec<usize> = (0..cases).step_by(together).skip(alone).collect();
            parts.extend(firsts.into_par_iter().map(of_part).collect::<Vec<_>>());
        }
        // Parts end in any order. Karat reports the error of the first part.
        for part in parts {
            let part = part?;
            for (site, count) in part.reached {
                *found.reached.entry(site).or_default() += count;
            }
            found.cases.extend(part.cases);
            found.cut |= part.cut;
        }
        Ok(found)
    }

    /// Checks if a case is still in a loop after `rounds` iterations. Such a loop may never end.
    pub fn may_not_end(&self, row: &[u32], rounds: u64) -> bool {
        let options = Options { fuel: rounds, ..self.options() };
        match self.run::<F32>(1, row, &options, &()) {
            Ok(_) => false,
            Err(Stop::Fuel { rounds, own, .. }) => !super::is_of_several(rounds, own),
            Err(_) => true,
        }
    }

    fn hazards_of_chunk(
        &self,
        cases: usize,
        rows: &[u32],
        left_out: LeftOut<'_>,
    ) -> Result<Hazards, ProbeError> {
        let (single, double) = (Recorder::<f32>::default(), Recorder::<f64>::default());
        // Loops with a bound certainly end, so they may run for more iterations than other loops.
        let fuel = match self.program.most_rounds() {
            Some(rounds) => rounds.saturating_mul(2).clamp(PATIENCE, MOST_ROUNDS),
            None => PATIENCE,
        };
        let options = Options { fuel, undecided: UNDECIDED, ..self.options() };
        let results = self.observed::<F32>(cases, rows, &options, &single)?;
        let shadows = self.observed::<F64>(cases, rows, &options, &double)?;
        let cut = single.is_full();
        let wrong = single.wrong.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let decided = single.decided.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let (single, reach) = single.events();
        let (double, _) = double.events();
        let (anything, wide) = Default::default();
        let known = Known { anything, blind: blind(&double), wide };
        let lanes = u64::try_from(cases * self.lanes()).expect("it fits");
        let work = if cut { ROUNDS_SEEN * lanes } else { u64::MAX };
        let bounds = match self.run::<Intervals>(cases, rows, &Options { work, ..options }, &known)
        {
            // The run stopped at its limit. By then, it had recorded about as many operations as the other runs.
            Err(Stop::Work { .. }) => None,
            seen => Some(seen.map_err(|stop| self.error(&stop))?),
        };
        let anything = known.anything.into_inner().unwrap_or_else(PoisonError::into_inner);
        let wide = known.wide.into_inner().unwrap_or_else(PoisonError::into_inner);
        let halves = shadows.halves();
        // In a quad, only hazards at the case's own pixel count.
        let each = (0..cases).map(|case| case * self.lanes()).map(|lane| {
            let (result, shadow) = (results.row(lane), shadows.row(lane));
            let finite =
                result.iter().all(|lane| !matches!(lane, Lane::Float(x) if !x.is_finite()));
            let is_used = cut || decided.contains(&lane) || absorbs_nan(&single, lane);
            // A later operation may turn an infinity into a wrong number: `x / sqrt(x * x)` gives 0 instead of 1.
            let lost = differ(&result, &shadow, &halves);
            let dropped = finite && !is_used && lost.is_none();
            let mut found = self.born(&single, &double, lane, dropped, (lost, left_out));
            // If double precision loses the digits, too, both runs agree. Only the interval shows the loss.
            if let (None, Some(site)) = (lost, wide.get(&lane))
                && bounds.as_ref().is_none_or(|bounds| shows_wide(&bounds.row(lane), &halves))
            {
                found.extend(self.found(Kind::LostDigits, *site, dropped));
            }
            let of_quad = (lane..lane + self.lanes()).flat_map(|pixel| {
                let all = wrong.get(&pixel).into_iter().flatten();
                // A hazard at another pixel of the quad counts only if that pixel takes no derivative.
                all.filter(move |((kind, _), _)| pixel == lane || *kind == Kind::Barrier)
            });
            let mut told = BTreeSet::new();
            for ((kind, site), parted) in of_quad.filter(|(own, _)| told.insert(*own)) {
                let one = self.found(*kind, *site, dropped);
                let missing = parted.map(|parted| self.missing(lane, parted));
                found.extend(one.map(|one| Found { missing, ..one }));
            }
            // Adds operations that WGSL doesn't bound, unless another hazard was found already.
            let kept = anything.get(&lane).into_iter().flatten();
            for (site, _) in kept.take_while(|(_, sure)| *sure) {
                if !found.iter().all(left_out) {
                    break;
                }
                // Set if the case's result is precise for every value that the operation may return.
                let is_sure = bounds.as_ref().is_some_and(|bounds| {
                    let row = bounds.row(lane);
                    let are_floats = row.iter().all(|lane| matches!(lane, Lane::Float(_)));
                    are_floats && !shows_wide(&row, &halves)
                });
                let one = self.found(Kind::Unbounded, *site, false);
                found.extend(one.map(|one| Found { hidden: dropped && is_sure, ..one }));
            }
            found
        });
        let each = each.collect();
        Ok(Hazards { cases: each, cut, reached: self.good(reach, &single) })
    }

    /// For each site, the number of cases that reached the site with finite operands.
    fn good(&self, reach: Reach, events: &[Event<f32>]) -> BTreeMap<usize, usize> {
        // For each site and lane, `true` if every run of the operation had an operand that isn't finite.
        let mut bad: BTreeMap<(usize, usize), bool> = BTreeMap::new();
        for event in events {
            // Usually all operands are finite.
            let is_finite = |operand: &Vec<f32>| operand.iter().all(|x| x.is_finite());
            if event.operands.iter().all(is_finite) {
                continue;
            }
            for lane in (0..event.active.len()).step_by(self.lanes()).filter(|at| event.active[*at])
            {
                let is_good = event.operands.iter().all(|operand| operand[lane].is_finite());
                let known = bad.entry((event.site, lane)).or_insert(true);
                *known &= !is_good;
            }
        }
        let of_site = |(site, lanes): (usize, Vec<usize>)| {
            let is_bad = |lane| bad.get(&(site, lane)).is_some_and(|bad| *bad);
            let own = lanes.into_iter().filter(|lane| lane.is_multiple_of(self.lanes()));
            (site, own.filter(|lane| !is_bad(*lane)).count())
        };
        reach.cases().into_iter().map(of_site).collect()
    }

    /// The operations of a lane that cause NaN, infinities or lost digits. For each kind, the list ends with the first
    /// operation that `left_out` doesn't ignore.
    fn born(
        &self,
        single: &[Event<f32>],
        double: &[Event<f64>],
        lane: usize,
        dropped: bool,
        (lost, left_out): (Option<f64>, LeftOut<'_>),
    ) -> Vec<Found> {
        let Some(size) = lost else {
            // For 16-bit floats there is no second run in `f64`, so lost digits aren't checked.
            return self.born_of(single, &[], lane, dropped, (&|_, _| false, left_out));
        };
        let loses_own = |event: &Event<f32>, twin: &Event<f64>| loses(event, twin, lane);
        let found = self.born_of(single, double, lane, dropped, (&loses_own, left_out));
        if found.iter().any(|one| one.kind == Kind::LostDigits && !left_out(one)) {
            return found;
        }
        // A rounding error is a hazard only if it dominates the result.
        let loses_some = |event: &Event<f32>, twin: &Event<f64>| loses_all(event, twin, lane, size);
        let more = self.born_of(single, double, lane, dropped, (&loses_some, left_out));
        let lost = more.into_iter().filter(|one| one.kind == Kind::LostDigits);
        found.into_iter().chain(lost).collect()
    }

    /// Like [`born`](Self::born), but the caller's function `loses` checks for lost digits.
    fn born_of(
        &self,
        single: &[Event<f32>],
        double: &[Event<f64>],
        lane: usize,
        dropped: bool,
        (loses, left_out): (Loses<'_>, LeftOut<'_>),
    ) -> Vec<Found> {
        let mut twins = Twins::of(double, lane);
        let mut found: Vec<Found> = Vec::new();
        for event in single.iter().filter(|event| event.active[lane]) {
            let twin = twins.next(event.site);
            let value = event.values[lane];
            let operands = || event.operands.iter().map(|operand| operand[lane]);
            let kind = if !value.is_finite() {
                let nan = value.is_nan();
                // If an operand is already infinite, an earlier operation caused the error.
                if operands().any(|operand| !operand.is_finite()) {
                    continue;
                }
                if nan { Kind::Nan } else { Kind::Infinite }
            } else if twin.is_some_and(|twin| loses(event, twin)) {
                Kind::LostDigits
            } else {
                continue;
            };
            let is_told = |other: &Found| other.site == event.site || !left_out(other);
            if found.iter().any(|other| other.kind == kind && is_told(other)) {
                continue;
            }
            if let Some(mut one) = self.found(kind, event.site, dropped) {
                let pair = twin.map(|twin| (value, twin.values[lane]));
                one.values = pair.filter(|_| kind == Kind::LostDigits);
                one.operands = operands().collect();
                found.push(one);
            }
        }
        found
    }

    fn found(&self, kind: Kind, number: usize, dropped: bool) -> Option<Found> {
        let site = self.site(number)?;
        let (span, text) = super::author_of(&self.program, site)?;
        let hidden = dropped && matches!(kind, Kind::Nan | Kind::Infinite);
        let (values, operands, missing) = Default::default();
        Some(Found { kind, site: number, span, text, hidden, values, operands, missing })
    }

    fn site(&self, number: usize) -> Option<&Site> {
        self.lowered.sites().get(number)
    }

    /// The positions of all operations in source files, each with the index of its site.
    pub fn places(&self) -> Vec<(usize, String)> {
        let place = |site: &Site| {
            let (span, _) = super::author_of(&self.program, site)?;
            Some((site.number, span.to_string()))
        };
        let places: BTreeMap<usize, String> = self.lowered.operations().filter_map(place).collect();
        places.into_iter().collect()
    }

    /// The names of both pixels, and the position at which they took different branches. `first` is the index of the
    /// quad's first pixel.
    fn missing(&self, first: usize, Parted { pixels, by }: Parted) -> Missing {
        const NAMES: [&str; quads::PIXELS] = [
            "the pixel at the quad's upper left",
            "the pixel at the quad's upper right",
            "the pixel at the quad's lower left",
            "the pixel at the quad's lower right",
        ];
        let [reached, missing] =
            pixels.map(|pixel| NAMES[(pixel - first) % NAMES.len()].to_owned());
        let site = by.and_then(|by| self.site(by));
        let parted = site.and_then(|site| super::statement_of(&self.program, site));
        Missing { reached, missing, parted }
    }
}

/// Checks if an operation loses more than half of its operands' digits.
fn loses(event: &Event<f32>, twin: &Event<f64>, lane: usize) -> bool {
    loses_all(event, twin, lane, twin.values[lane].abs())
}

/// Checks if an operation loses more than half of its operands' digits. The loss counts only if `size`, the magnitude
/// of the operation's value or of the function's result, exceeds the rounding errors of the operands.
fn loses_all(event: &Event<f32>, twin: &Event<f64>, lane: usize, size: f64) -> bool {
    let error = |x: f32, y: f64| (f64::from(x) - y).abs() / y.abs();
    let (value, shadow) = (event.values[lane], twin.values[lane]);
    let largest = twin.operands.iter().map(|o| o[lane].abs()).fold(0.0, f64::max);
    let Precision { lost, precise, noise, least } = Precision::of(event.half);
    let means_something = shadow.is_finite() && size > noise * largest && shadow.abs() > least;
    let is_precise = |(x, y): (&Vec<f32>, &Vec<f64>)| {
        x[lane] == 0.0 && y[lane] == 0.0 || error(x[lane], y[lane]) <= precise
    };
    // The runs in `f32` and `f64` use constants rounded to `f32`, so only computed operands have an error.
    means_something
        && error(value, shadow) > lost
        && !event.operands.is_empty()
        && event.operands.iter().zip(&twin.operands).all(is_precise)
}

/// Checks if the bounds of a result show that one of its numbers lost half of its digits.
fn shows_wide(bounds: &[LaneOf<Intervals>], halves: &[bool]) -> bool {
    let wide = |(lane, half): (&LaneOf<Intervals>, &bool)| matches!(lane, Lane::Float(x) if is_wide(*x, *half));
    bounds.iter().zip(halves).any(wide)
}

/// The largest absolute value among the components of a result that lost half of their digits. `None` if no component
/// lost half of its digits.
fn differ(result: &[LaneOf<F32>], shadow: &[LaneOf<F64>], halves: &[bool]) -> Option<f64> {
    let lost = |lane: usize| match (&result[lane], &shadow[lane]) {
        (Lane::Float(x), Lane::Float(y)) => {
            let error = (f64::from(*x) - y).abs();
            let Precision { lost, least, .. } = Precision::of(halves[lane]);
            let is_lost = y.is_finite() && error > least && error > lost * y.abs();
            is_lost.then_some(y.abs())
        }
        _ => None,
    };
    (0..result.len()).filter_map(lost).reduce(f64::max)
}
