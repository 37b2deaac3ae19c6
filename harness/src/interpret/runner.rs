//! Runs passes in several orders of invocations, one after another. Each run returns the passes' results, and the
//! violations that no earlier run showed.

use karat_engine::{Atomics, Explorer, Options, Schedule, Stores};

use super::dispatch::{Prepared, options};
use super::order::{OrderOf, SUBGROUPS, Tried};
use super::sanitizer::{Known, Ways};
use crate::dispatch::{Afterwards, DispatchError, Examined, Passes};
use crate::settings;

/// The number of orders to sample, if there are too many orders to try all of them.
const DRAWN: u64 = 16;

/// The number of runs after which the runner gives up trying all orders. `MOST_INVOCATIONS` limits the number of
/// invocations in all these runs together.
const MOST_ORDERS: u64 = 4096;
const MOST_INVOCATIONS: u64 = 1 << 20;

/// The largest number of pairs of turns that the explorer (which tries all orders) compares in all runs together. In a
/// turn, an invocation runs up to its next atomic. This number is enough for 4,096 runs of 22 turns each.
const MOST_WORK: u64 = 1 << 20;

/// The runner tries all orders only if the estimated number of orders is at most 2 to the power of this number. The
/// estimate is far above the real number.
const MOST_LIKELY: f64 = 24.0;

/// After `MOST_TURNS` turns in all runs together, the runner samples no further order. In one order, at most
/// `TURNS_OF_ONE` turns run. A million turns take a second.
const MOST_TURNS: u64 = 1 << 20;
const TURNS_OF_ONE: usize = 1 << 22;

/// The number of orders to sample before trying all orders. Findings in sampled orders are simpler to describe.
const SIMPLE: u64 = 3;

/// One run of passes in one order.
pub struct Run {
    /// The order of the run. `None` stands for the usual order.
    pub order: Option<OrderOf>,
    /// The data that the passes write. `None` if a loop didn't end, or if some passes didn't run.
    pub left: Option<Afterwards>,
    /// The findings that no earlier run had.
    pub(crate) examined: Examined,
}

enum Next {
    Usual,
    /// The usual order with another subgroup size: the index of this size in [`SUBGROUPS`].
    Size(usize),
    Drawn(u64),
    /// All orders, one after another. Atomic stores take effect either at once or late.
    All(Box<Explorer>, Stores),
    End,
}

/// Runs passes in several orders.
pub struct Runner<'p> {
    passes: &'p Passes,
    prepared: Result<Prepared<'p>, Option<DispatchError>>,
    next: Next,
    wanted: u64,
    /// `true` if the runner tries all orders when there are only a few.
    explores: bool,
    atomics: Vec<Atomics>,
    known: Known,
    tried: Tried,
    runs: u64,
}

impl<'p> Runner<'p> {
    /// Makes a runner, which begins with a run in the usual order. This first run counts the atomics, from which the
    /// runner estimates the number of orders.
    pub fn new(passes: &'p Passes) -> Self {
        Self {
            passes,
            prepared: Prepared::new(passes, &karat_engine::Settings::default()).map_err(Some),
            next: Next::Usual,
            wanted: settings::schedules().unwrap_or(DRAWN),
            explores: true,
            atomics: Vec::new(),
            known: Known::default(),
            tried: Tried::default(),
            runs: 0,
        }
    }

    /// Sets the number of sampled orders. The runner then doesn't try all orders.
    pub fn few(self, orders: u64) -> Self {
        Self { wanted: orders, explores: false, ..self }
    }

    pub(crate) fn tried(&self) -> Tried {
        self.tried
    }

    /// Tells the runner about a violation. The runner then no longer tries all orders.
    pub(crate) fn found(&mut self) {
        self.explores = false;
    }

    fn after(&mut self, examined: &Examined) -> Next {
        let next = std::mem::replace(&mut self.next, Next::End);
        let Ok(prepared) = &self.prepared else { return Next::End };
        if matches!(next, Next::Usual) && !examined.watched.reason.is_empty() {
            return Next::End;
        }
        let of_size = |at: usize| {
            let has_sizes = prepared.has_subgroups() && self.wanted > 0 && at < SUBGROUPS.len();
            has_sizes.then_some(Next::Size(at))
        };
        let most_orders: f64 = self.atomics.iter().map(Atomics::most_orders).sum();
        // Without atomics and races, all orders give the same results.
        let has_one = most_orders <= 0.0 && !self.known.races;
        let spent = self.known.turns >= MOST_TURNS;
        let drawn = |from: u64| match !has_one && from < self.wanted && !spent {
            true => Next::Drawn(from),
            false => Next::End,
        };
        let is_small = self.passes.invocations() <= super::order::ONE_BY_ONE;
        let few = self.explores && is_small && !self.known.races && most_orders <= MOST_LIKELY;
        let next = match next {
            Next::Usual => of_size(0).unwrap_or_else(|| drawn(0)),
            Next::Size(at) => of_size(at + 1).unwrap_or_else(|| drawn(0)),
            Next::Drawn(at) if at + 1 == SIMPLE && few => Next::All(Box::default(), Stores::AtOnce),
            Next::Drawn(at) => drawn(at + 1),
            other => other,
        };
        self.tried.all |= has_one;
        next
    }

    /// The next run while the runner tries all orders. After the last order, continues with late stores or sampled
    /// orders, or ends.
    fn explored(&mut self, mut explorer: Box<Explorer>, stores: Stores) -> Option<Run> {
        loop {
            let spent = self.runs * self.passes.invocations();
            let spent =
                explorer.is_too_long() || explorer.work() >= MOST_WORK || spent >= MOST_INVOCATIONS;
            if !self.explores || self.runs >= MOST_ORDERS || spent {
                // If `all` is set, all orders were tried, except for orders in which stores take effect late.
                self.next = match self.explores && !self.tried.all {
                    true => Next::Drawn(SIMPLE),
                    false => Next::End,
                };
                return self.next();
            }
            if !explorer.begin() {
                // A loop that waits for other invocations may end in further orders.
                let has_waited = explorer.has_waited();
                self.tried.all |= !has_waited && stores == Stores::AtOnce;
                self.runs = 0;
                self.next = match stores {
                    Stores::AtOnce => Next::All(Box::default(), Stores::Late(0)),
                    Stores::Late(_) if self.tried.all => Next::End,
                    Stores::Late(_) => Next::Drawn(SIMPLE),
                };
                return self.next();
            }
            self.runs += 1;
            let Ok(prepared) = &self.prepared else { return None };
            let base = options();
            let schedule = Schedule { stores, ..Schedule::one_by_one() };
            let options = Options { schedule, ..base.clone() };
            let order = |explorer: &Explorer| OrderOf::of_turns(explorer.turns(), stores);
            let ways = Ways::Explored(&options, &mut explorer, &order);
            let (examined, left) = super::sanitizer::observe(prepared, ways, &mut self.known);
            if explorer.is_cut() {
                continue;
            }
            self.tried.orders += u64::from(stores == Stores::AtOnce);
            let order = Some(order(&explorer));
            self.next = Next::All(explorer, stores);
            return Some(Run { order, left, examined });
        }
    }
}

impl Iterator for Runner<'_> {
    type Item = Run;

    fn next(&mut self) -> Option<Run> {
        let prepared = match &mut self.prepared {
            Ok(prepared) => prepared,
            Err(error) => {
                let examined = super::sanitizer::refused(self.passes, &error.take()?);
                return Some(Run { order: None, left: None, examined });
            }
        };
        let order = match &mut self.next {
            Next::End => return None,
            Next::All(..) => {
                let Next::All(explorer, stores) = std::mem::replace(&mut self.next, Next::End)
                else {
                    return None;
                };
                return self.explored(explorer, stores);
            }
            Next::Usual => None,
            Next::Size(at) => Some(OrderOf::of_size(self.passes, SUBGROUPS[*at])),
            Next::Drawn(number) => {
                self.tried.orders += 1;
                Some(OrderOf::drawn(self.passes, &self.atomics, *number))
            }
        };
        let most_turns = if order.is_some() { TURNS_OF_ONE } else { usize::MAX };
        let base = Options { most_turns, ..options() };
        let ways = Ways::Ordered(order.as_ref(), &base);
        let (examined, left) = super::sanitizer::observe(prepared, ways, &mut self.known);
        if order.is_none() {
            self.atomics = std::mem::take(&mut self.known.atomics);
            self.known.turns = 0;
        }
        // If a run stopped early for another reason than an endless loop, its results say nothing about the order.
        if left.is_none() && examined.endless.is_none() && matches!(self.next, Next::Drawn(_)) {
            self.tried.orders -= 1;
        }
        self.next = self.after(&examined);
        Some(Run { order, left, examined })
    }
}
