//! What goes wrong inside of a function while it computes: values that aren't finite, digits that are
//! lost, indices that leave their array, and what WGSL doesn't bound.
//!
//! A function runs in `f32` and in the shadow, `f64`, each operation of which is seen with its
//! operands. What is wrong already in an operand isn't this operation's fault, so each hazard is told
//! where it is born.

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

/// The first operation whose operands are finite and whose value isn't, with its place, under its name in a message.
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

/// A hazard in a case: where it is born, and whether the result shows it.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// What goes wrong.
    pub kind: Kind,
    /// The number of its site in the program.
    pub site: usize,
    /// Where, in its author's file.
    pub span: Span,
    /// The operation, as the author wrote it.
    pub text: String,
    /// Whether the result is finite all the same, so that something behind it hides it.
    pub hidden: bool,
    /// For lost digits: the value in `f32` and in `f64`.
    pub values: Option<(f32, f64)>,
    /// What the operation was computed from, in `f32`.
    pub operands: Vec<f32>,
    /// Of a derivative the pixel that isn't there.
    pub missing: Option<Missing>,
}

/// Pixels of a quad of which one takes a derivative.
#[derive(Clone, Debug, PartialEq)]
pub struct Missing {
    /// That one, as a person calls it.
    pub reached: String,
    /// One that doesn't.
    pub missing: String,
    /// The condition or the jump where that one went another way.
    pub parted: Option<Span>,
}

/// True if an operation makes a number of a NaN. `max` and `clamp` of one, and a comparison with one, may give
/// anything, since implementations may take it that there are none (WGSL, section 15.7.2): the next driver may
/// show what this one hides.
fn absorbs_nan(events: &[Event<f32>], lane: usize) -> bool {
    events.iter().any(|event| {
        let has_nan = event.operands.iter().any(|operand| operand[lane].is_nan());
        event.active[lane] && has_nan && !event.values[lane].is_nan()
    })
}

/// The findings in each case.
pub struct Hazards {
    /// Of each kind the first, case by case.
    pub cases: Vec<Vec<Found>>,
    /// True if there were more operations than are kept.
    pub cut: bool,
    /// By the number of a site the cases that came to it with good operands.
    pub reached: BTreeMap<usize, usize>,
}

/// Lanes that run together: a chunk of the engine's, so that its operations come in one order.
const TOGETHER: usize = 256;

/// Operations that are kept of a run. A loop repeats them, and what goes wrong in its thousandth
/// round did so before, as a rule.
const MOST_EVENTS: usize = 4096;

/// Rounds of loops, of each case, that intervals are followed for where there are more operations: at sixteen in a round
/// they see as many.
const ROUNDS_SEEN: u64 = 256;

/// The digits of a format of floats.
struct Precision {
    /// Half of its digits: a relative error above this has lost them.
    lost: f64,
    /// An operand that is itself this precise isn't the one that loses them.
    precise: f64,
    /// Below this share of its operands, a difference is nothing but their rounding.
    noise: f64,
    /// The least number that isn't flushed.
    least: f64,
}

impl Precision {
    fn of(half: bool) -> Self {
        match half {
            // 24 bits.
            false => Self {
                lost: 1.0 / 4096.0,
                precise: 1.0 / 1_048_576.0,
                noise: 1.0 / 16_777_216.0,
                least: f64::from(f32::MIN_POSITIVE),
            },
            // 11 bits.
            true => Self {
                lost: 1.0 / 32.0,
                precise: 1.0 / 256.0,
                noise: 1.0 / 2048.0,
                least: 1.0 / 16_384.0,
            },
        }
    }
}

/// Rounds of loops that made-up arguments may cause.
pub(super) const PATIENCE: u64 = 4096;

/// Rounds after which a loop that made-up arguments lead into is said not to end: a case takes tenths of a second.
pub const LONG: u64 = 1 << 18;

/// Rounds of loops that have a bound.
const MOST_ROUNDS: u64 = 65_536;

/// Rounds after which an exit that is undecided is given up: each follows both ways.
const UNDECIDED: u64 = 16;

/// Below this share of its operands a difference has fewer than half of the digits of `f32` in double precision, too, whose
/// last digit is 2^-53.
const BLIND: f64 = 1.0 / 2_199_023_255_552.0;

/// An operand that is known this closely is one number: what makes of it anything is the operation.
const NARROW: f64 = 1.0 / 1024.0;

/// An operation over the lanes of a chunk.
struct Event<F> {
    /// The number of its site among the program's.
    site: usize,
    /// True if it is of half precision.
    half: bool,
    values: Vec<F>,
    /// By operand, then by lane.
    operands: Vec<Vec<F>>,
    active: Vec<bool>,
}

/// A pixel of a quad takes a derivative, and another one doesn't.
#[derive(Clone, Copy)]
struct Parted {
    /// The one that does, by its number among all pixels, and the other one.
    pixels: [usize; 2],
    /// The site of the condition or the jump where that went another way.
    by: Option<usize>,
}

/// What goes wrong in a case, with its site, and the pixels that part at a derivative.
type OfCase = BTreeMap<(Kind, usize), Option<Parted>>;

/// Keeps what operations give.
struct Recorder<F> {
    events: Mutex<Vec<Event<F>>>,
    reach: Reach,
    /// Of each case the operations whose operands are wrong.
    wrong: Mutex<BTreeMap<usize, OfCase>>,
    /// Lanes in which a NaN decides a comparison, or becomes an integer.
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
                // A condition selects floats of floats: that is no use of them.
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
                // Both come to the same operations, but where rounding decides.
                if $reaches {
                    self.reach.add(here.site.number, here);
                }
            }
        }
    };
}
recorder!(F32, f32, true);
recorder!(F64, f64, false);

/// What intervals know of operations, lane by lane.
struct Known {
    /// Those that may give anything, in order, and of each whether its operands are to blame for that: they are known
    /// closely, and are where it has no bound.
    anything: Mutex<BTreeMap<usize, Vec<(usize, bool)>>>,
    /// Lanes and sites where double precision can't tell which digits are lost.
    blind: BTreeSet<(usize, usize)>,
    /// Of each lane the first of these whose result is wide.
    wide: Mutex<BTreeMap<usize, usize>>,
}

/// True of an interval whose numbers share fewer than half of their digits.
fn is_wide(x: Interval, half: bool) -> bool {
    let (lo, hi) = (f64::from(x.lo()), f64::from(x.hi()));
    !x.is_bounded() || hi - lo > Precision::of(half).lost * lo.abs().max(hi.abs())
}

/// True if double precision has lost a number that isn't 0: a sum is one of its terms, or what is computed of a small
/// number is 1.
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

/// True of a sum or a difference, by its value.
fn is_sum(event: &Event<f64>, lane: usize) -> bool {
    let value = event.values[lane];
    matches!(&*event.operands, [x, y] if value == x[lane] + y[lane] || value == x[lane] - y[lane])
}

/// True of a sum with fewer than half of the digits of `f32` in double precision, and of a logarithm of 1.
fn is_blind(event: &Event<f64>, lane: usize) -> bool {
    let value = event.values[lane].abs();
    let largest = event.operands.iter().map(|x| x[lane].abs()).fold(0.0, f64::max);
    match event.operands.len() {
        1 => largest == 1.0 && value == 0.0,
        _ => is_sum(event, lane) && value < BLIND * largest,
    }
}

/// Lanes and sites where double precision can't tell which digits are lost: they are blind, and an operand comes of what has
/// lost a number.
fn blind(events: &[Event<f64>]) -> BTreeSet<(usize, usize)> {
    // Of each lane the values that come of such.
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

/// Such operations that are kept of a lane: those behind the first count where the first is left out.
const KEPT: usize = 16;

/// True of an operation that loses digits, beside the same in double precision.
type Loses<'l> = &'l dyn Fn(&Event<f32>, &Event<f64>) -> bool;

/// True of a hazard that is left out: one behind it is then told in its place.
pub(crate) type LeftOut<'l> = &'l (dyn Fn(&Found) -> bool + Sync);

impl Observer<Intervals> for Known {
    fn floats(&self, lanes: &Lanes<'_, Intervals>) {
        let narrow = |x: &Interval| {
            let (lo, hi) = (f64::from(x.lo()), f64::from(x.hi()));
            lo == hi || hi - lo <= NARROW * lo.abs().min(hi.abs())
        };
        // What is computed twice in one way has no difference, and of exact numbers a difference has each digit.
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
    /// True if there may have been more operations.
    fn is_full(&self) -> bool {
        self.events.lock().unwrap_or_else(PoisonError::into_inner).len() >= MOST_EVENTS
    }

    fn events(self) -> (Vec<Event<F>>, Reach) {
        (self.events.into_inner().unwrap_or_else(PoisonError::into_inner), self.reach)
    }
}

/// For each event of a lane that of another run: the same operation, as often as the lane has been there.
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

    /// That of the next event of an operation.
    fn next(&mut self, site: usize) -> Option<&'e Event<f64>> {
        self.by_site.get_mut(&site)?.pop_front()
    }
}

impl Interpreted {
    /// The findings in each of some cases: of each kind those that are left out, up to the first that isn't.
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
        // A loop that doesn't end, or not here, is seen in the first part as a rule, and the others would only wait for it.
        let alone = usize::from(self.program.most_rounds().is_none() && cases > 0);
        let mut parts = (0..alone).map(|_| of_part(0)).collect::<Vec<_>>();
        if parts.iter().all(Result::is_ok) {
            // One function with long loops would keep one core busy while the others idle.
            let firsts: Vec<usize> = (0..cases).step_by(together).skip(alone).collect();
            parts.extend(firsts.into_par_iter().map(of_part).collect::<Vec<_>>());
        }
        // Parts end in any order, and the error is that of the first one.
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

    /// True if a case is still in a loop after so many rounds, so that it may never end.
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
        // What has a bound ends: it may be as long as is still quick to run.
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
            // It saw what the others keep.
            Err(Stop::Work { .. }) => None,
            seen => Some(seen.map_err(|stop| self.error(&stop))?),
        };
        let anything = known.anything.into_inner().unwrap_or_else(PoisonError::into_inner);
        let wide = known.wide.into_inner().unwrap_or_else(PoisonError::into_inner);
        let halves = shadows.halves();
        // Of a quad the pixel that the arguments are given for.
        let each = (0..cases).map(|case| case * self.lanes()).map(|lane| {
            let (result, shadow) = (results.row(lane), shadows.row(lane));
            let finite =
                result.iter().all(|lane| !matches!(lane, Lane::Float(x) if !x.is_finite()));
            let is_used = cut || decided.contains(&lane) || absorbs_nan(&single, lane);
            // An infinity may have become a NaN: `clamp(inf - inf, 0.0, 1.0)`. In `x / sqrt(x * x)` one makes 0 of 1.
            let lost = differ(&result, &shadow, &halves);
            let dropped = finite && !is_used && lost.is_none();
            let mut found = self.born(&single, &double, lane, dropped, (lost, left_out));
            // Both agree where double precision cancels as well, and only the interval knows.
            if let (None, Some(site)) = (lost, wide.get(&lane))
                && bounds.as_ref().is_none_or(|bounds| shows_wide(&bounds.row(lane), &halves))
            {
                found.extend(self.found(Kind::LostDigits, *site, dropped));
            }
            let of_quad = (lane..lane + self.lanes()).flat_map(|pixel| {
                let all = wrong.get(&pixel).into_iter().flatten();
                // Another pixel of the quad is one that some other case is given for, but they part in this one.
                all.filter(move |((kind, _), _)| pixel == lane || *kind == Kind::Barrier)
            });
            let mut told = BTreeSet::new();
            for ((kind, site), parted) in of_quad.filter(|(own, _)| told.insert(*own)) {
                let one = self.found(*kind, *site, dropped);
                let missing = parted.map(|parted| self.missing(lane, parted));
                found.extend(one.map(|one| Found { missing, ..one }));
            }
            // What isn't finite is told already, and WGSL bounds nothing that comes of it.
            let kept = anything.get(&lane).into_iter().flatten();
            for (site, _) in kept.take_while(|(_, sure)| *sure) {
                if !found.iter().all(left_out) {
                    break;
                }
                // Whatever it is, the result is the same.
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

    /// Of each site how many cases came to it with good operands.
    fn good(&self, reach: Reach, events: &[Event<f32>]) -> BTreeMap<usize, usize> {
        // Lanes in which no operation at a site had good operands.
        let mut bad: BTreeMap<(usize, usize), bool> = BTreeMap::new();
        for event in events {
            // Few events have an operand that isn't finite.
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

    /// Of each kind the first operation of a lane that is at fault.
    fn born(
        &self,
        single: &[Event<f32>],
        double: &[Event<f64>],
        lane: usize,
        dropped: bool,
        (lost, left_out): (Option<f64>, LeftOut<'_>),
    ) -> Vec<Found> {
        let Some(size) = lost else {
            // No operation is compared with its twin.
            return self.born_of(single, &[], lane, dropped, (&|_, _| false, left_out));
        };
        let loses_own = |event: &Event<f32>, twin: &Event<f64>| loses(event, twin, lane);
        let found = self.born_of(single, double, lane, dropped, (&loses_own, left_out));
        if found.iter().any(|one| one.kind == Kind::LostDigits && !left_out(one)) {
            return found;
        }
        // A difference that is nothing but rounding is at fault where the result is more than that.
        let loses_some = |event: &Event<f32>, twin: &Event<f64>| loses_all(event, twin, lane, size);
        let more = self.born_of(single, double, lane, dropped, (&loses_some, left_out));
        let lost = more.into_iter().filter(|one| one.kind == Kind::LostDigits);
        found.into_iter().chain(lost).collect()
    }

    /// [`born`](Self::born), with what tells lost digits.
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
                // Who gets an infinity and makes NaN of it passes on what was wrong.
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

    /// A hazard at an operation, in the author's file.
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

    /// The places of all operations in the author's files, with the numbers of their sites.
    pub fn places(&self) -> Vec<(usize, String)> {
        let place = |site: &Site| {
            let (span, _) = super::author_of(&self.program, site)?;
            Some((site.number, span.to_string()))
        };
        let places: BTreeMap<usize, String> = self.lowered.operations().filter_map(place).collect();
        places.into_iter().collect()
    }

    /// The pixels of the quad that begins at a lane as a person calls them, and where they parted.
    fn missing(&self, first: usize, Parted { pixels, by }: Parted) -> Missing {
        const NAMES: [&str; quads::PIXELS] = [
            "the pixel",
            "the pixel to its right",
            "the pixel below it",
            "the pixel below to the right",
        ];
        let [reached, missing] =
            pixels.map(|pixel| NAMES[(pixel - first) % NAMES.len()].to_owned());
        let site = by.and_then(|by| self.site(by));
        let parted = site.and_then(|site| super::statement_of(&self.program, site));
        Missing { reached, missing, parted }
    }
}

/// Whether an operation loses more than half of the digits that its operands have.
fn loses(event: &Event<f32>, twin: &Event<f64>, lane: usize) -> bool {
    loses_all(event, twin, lane, twin.values[lane].abs())
}

/// The same, of one whose value becomes a part of a result of this `size`.
fn loses_all(event: &Event<f32>, twin: &Event<f64>, lane: usize, size: f64) -> bool {
    let error = |x: f32, y: f64| (f64::from(x) - y).abs() / y.abs();
    let (value, shadow) = (event.values[lane], twin.values[lane]);
    let largest = twin.operands.iter().map(|o| o[lane].abs()).fold(0.0, f64::max);
    let Precision { lost, precise, noise, least } = Precision::of(event.half);
    let means_something = shadow.is_finite() && size > noise * largest && shadow.abs() > least;
    let is_precise = |(x, y): (&Vec<f32>, &Vec<f64>)| {
        x[lane] == 0.0 && y[lane] == 0.0 || error(x[lane], y[lane]) <= precise
    };
    // Constants are rounded to `f32` in both, so that what an operand lacks is what was computed.
    means_something
        && error(value, shadow) > lost
        && !event.operands.is_empty()
        && event.operands.iter().zip(&twin.operands).all(is_precise)
}

/// True if a number of a result has lost half of its digits, as far as its interval shows.
fn shows_wide(bounds: &[LaneOf<Intervals>], halves: &[bool]) -> bool {
    let wide = |(lane, half): (&LaneOf<Intervals>, &bool)| matches!(lane, Lane::Float(x) if is_wide(*x, *half));
    bounds.iter().zip(halves).any(wide)
}

/// The largest component of a result that has lost half of its digits itself; `None` if none has.
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
