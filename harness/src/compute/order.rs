//! Assertions of passes hold in each order of their workgroups and invocations, as WGSL promises none.
//!
//! Passes without a race may still depend on an order: that of atomics. The engine runs them in seeded orders and
//! judges what each leaves.

use std::fmt;

use super::judge::{Assertion, Element, Expected, Sum};
use super::{After, ComputeError};
use crate::dispatch::{DispatchError, Pass, Passes, Watched};
use crate::interpret::{OrderOf, in_order_of, parting};
use crate::probe::ProbeError;
use crate::record::{Fault, Replay};
use crate::run::Report;
use crate::settings;
use crate::value::Shape;

/// Orders that are tried: of passes of so few invocations, and of so few rounds of their loops, many, of others few, as each is a
/// run of all passes. A million of rounds takes a tenth of a second.
const SMALL: u64 = 4096;
const SHORT: u64 = 1 << 20;
const MANY: u64 = 32;
const FEW: u64 = 3;

/// A dependence of passes' results on the order in which their invocations run.
///
/// ```
/// use karat::compute::ComputeError;
/// # use karat::prelude::*;
///
/// let text = "@group(0) @binding(0) var<storage, read_write> count: atomic<u32>;
///             @group(0) @binding(1) var<storage, read_write> found: array<u32, 4>;
///             @compute @workgroup_size(4) fn append(@builtin(local_invocation_index) i: u32) {
///                 found[atomicAdd(&count, 1u)] = i;
///             }";
/// let package = Package::from_source("m", text);
/// let passes = || {
///     let passes = package.compute().with("count", Storage::new([0_u32]));
///     passes.with("found", Storage::new([9_u32; 4])).dispatch("append", [1, 1, 1]).after("found").unrecorded()
/// };
/// let wrong = passes().try_agrees_with([0_u32, 1, 2, 3], Abs(0.0));
/// let Err(ComputeError::Order(order)) = wrong else { panic!("each driver has an order of its own") };
/// assert!(order.swap.contains("local"), "{}", order.swap);
/// passes().up_to_order().agrees_with([0_u32, 1, 2, 3], Abs(0.0));
/// ```
#[derive(Clone, Debug)]
pub struct OrderDependence {
    /// The passes.
    pub entry_points: String,
    /// The resource.
    pub variable: String,
    /// The assertion.
    pub assertion: String,
    /// True if it holds in the usual order in Karat's engine.
    pub holds: bool,
    /// The first operation that gives an invocation something else, or if there is none the entry point of the pass whose
    /// order matters, or the last one: `file:line:column`.
    pub location: String,
    /// The difference between the orders: `local (3, 0, 0) and (5, 0, 0) change places in each workgroup of .. `.
    pub swap: String,
    /// The operation, the invocation and both results; `None` if writes alone come in another order.
    pub operation: Option<String>,
    /// Invocations of a subgroup in that order; `None` if the passes don't depend on it.
    pub subgroup: Option<u32>,
    /// The first element that is wrong then.
    pub element: Option<Element>,
    /// The command that tries the orders again.
    pub replay: Replay,
}

impl OrderDependence {
    pub(super) fn fault(&self) -> Fault {
        let (headline, replay) = (self.headline(), Some(self.replay.clone()));
        Fault { headline, replay, ..Fault::default() }
    }

    fn headline(&self) -> String {
        let Self { entry_points, variable, .. } = self;
        let size = if self.subgroup.is_some() { ", or on the size of subgroups" } else { "" };
        format!("`{variable}` after `{entry_points}` depends on the order of invocations{size}")
    }
}

impl fmt::Display for OrderDependence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "error: {}", self.headline())?;
        if !self.location.is_empty() {
            writeln!(f, "  --> {}", self.location)?;
        }
        if self.holds {
            writeln!(f, "  in the usual order {}. Not where {}", self.assertion, self.swap)?;
        } else {
            writeln!(
                f,
                "  in Karat's engine it isn't so that {}. But each order has to leave the same, and this one doesn't: {}",
                self.assertion, self.swap
            )?;
        }
        if let Some(operation) = &self.operation {
            writeln!(f, "  {operation}")?;
        }
        if let Some(Element { place, actual, expected, .. }) = &self.element {
            writeln!(f, "  then: {place}")?;
            writeln!(f, "      actual = {actual}")?;
            writeln!(f, "    expected = {expected}")?;
        }
        if self.subgroup.is_some() {
            writeln!(
                f,
                "  = a subgroup has from 4 to 128 invocations, by the device: ask `subgroup_size`, and not a number"
            )?;
        }
        writeln!(
            f,
            "  = WGSL promises no order, and each driver has its own. A barrier orders the invocations of a workgroup, and another pass orders workgroups. If the order is meant not to matter, \
             compare elements up to it (`up_to_order`), or allow for sums of floats with a tolerance"
        )?;
        writeln!(f, "  replay: {}", self.replay)
    }
}

/// How many orders are tried of passes.
pub(super) fn orders(watched: &Watched) -> u64 {
    let usual = if watched.of <= SMALL && watched.rounds <= SHORT { MANY } else { FEW };
    settings::schedules().unwrap_or(usual)
}

impl After<'_> {
    /// Compares elements whatever their order is: elements that passes append by an atomic counter come in another one
    /// on each driver. Both sides are sorted by their values, so elements of several numbers should differ by more than
    /// the tolerance in the first one. Of a structure that ends in an array, as of a counter and its items, the array's
    /// elements are meant.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
    ///             @compute @workgroup_size(1) fn reverse() { let x = data[0]; data[0] = data[1]; data[1] = x; }";
    /// let package = Package::from_source("m", text);
    /// let passes = package.compute().with("data", Storage::new([1_u32, 2])).dispatch("reverse", [1, 1, 1]);
    /// passes.after("data").up_to_order().agrees_with([1_u32, 2], Abs(0.0));
    /// ```
    #[must_use = "nothing is compared until a verb such as `.agrees_with(...)`"]
    pub fn up_to_order(mut self) -> Self {
        self.up_to_order = true;
        self
    }

    /// Judges the results of other orders of the invocations. Others report a failure in the usual one.
    pub(super) fn expect_no_order(
        &self,
        assertion: &Assertion<'_>,
        passes: &Passes,
        (number, element): (usize, &Shape),
        report: &mut Report,
        replay: &Replay,
    ) -> Result<(), ComputeError> {
        let Some(watched) = report.watched.as_mut().filter(|one| one.reason.is_empty()) else {
            return Ok(());
        };
        let orders = orders(watched);
        // A single invocation has one order.
        if watched.of <= 1 || assertion.is_settled() {
            return Ok(());
        }
        if orders == 0 {
            "no other order of invocations was tried: 0 are asked for"
                .clone_into(&mut watched.reason);
            return Ok(());
        }
        let function = self.last_entry_point();
        let left = |order: Option<OrderOf>| -> Result<Option<Vec<u32>>, ComputeError> {
            let afterwards = match in_order_of(passes, order) {
                // A loop that waits for an invocation behind it: WGSL promises that none of them makes progress.
                Err(DispatchError::Probe(ProbeError::Rounds { .. }) | DispatchError::Rounds(_))
                    if order.is_some() =>
                {
                    return Ok(None);
                }
                other => other?,
            };
            let own = afterwards.into_iter().find(|(of, _)| *of == number);
            let lanes = own.and_then(|(_, words)| passes.lanes(number, &words));
            Ok(Some(lanes.expect("a pass writes the resource")))
        };
        let usual = left(None)?.expect("the usual order has no time limit of its own");
        let holds = self.sum(assertion, None, element, &usual, function)?.failures == 0;
        // Drivers round otherwise than the engine, so what it leaves may be beyond the tolerance. Each order has to leave the
        // same nevertheless; and a statement that holds in one of them depends on the order.
        let own = match assertion {
            Assertion::Agrees(_, tolerance) if !holds => {
                let shape = element.clone();
                let scalars = element.lanes().into_iter().cycle();
                let lanes = usual.iter().zip(scalars).map(|(word, scalar)| scalar.decode(*word));
                Some(Assertion::Agrees(
                    Expected { shape, lanes: lanes.collect() },
                    tolerance.clone(),
                ))
            }
            _ => None,
        };
        let judged = |order: Option<OrderOf>| -> Result<Sum, ComputeError> {
            let Some(lanes) = left(order)? else { return Ok(Sum::endless()) };
            if lanes == usual {
                return Ok(Sum::of_failures(0));
            }
            let sum =
                self.sum(own.as_ref().unwrap_or(assertion), None, element, &lanes, function)?;
            if !holds && own.is_none() {
                return Ok(Sum::of_failures(usize::from(sum.failures == 0)));
            }
            Ok(sum.of(passes, number))
        };
        for seed in 0..orders {
            let whole = OrderOf::whole(passes, seed);
            if judged(Some(whole))?.failures == 0 {
                continue;
            }
            // The first swap that makes a difference, by halves: no swap makes none, all of them make one.
            let (mut right, mut wrong) = (0, whole.swaps());
            if judged(Some(whole.first(0)))?.failures > 0 {
                wrong = 0;
            }
            while wrong > right + 1 {
                let middle = right + (wrong - right) / 2;
                match judged(Some(whole.first(middle)))?.failures {
                    0 => right = middle,
                    _ => wrong = middle,
                }
            }
            // One pass is to blame, as a rule.
            let mut order = whole.first(wrong);
            let count = passes.passes.len();
            for number in (0..count).filter(|_| count > 1) {
                if judged(Some(order.only(number)))?.failures > 0 {
                    order = order.only(number);
                    break;
                }
            }
            let entry_points: Vec<&str> = passes.entry_points().collect();
            // And swaps alone are simpler than turns.
            if judged(Some(order.apart()))?.failures > 0 {
                order = order.apart();
            }
            let (place, operation) = parting(passes, order).unzip();
            let place = place.or_else(|| order.passes(passes).last().and_then(Pass::span));
            return Err(ComputeError::Order(Box::new(OrderDependence {
                entry_points: entry_points.join(", "),
                variable: self.variable.clone(),
                assertion: assertion.holds(),
                holds,
                location: place.map_or_else(String::new, |span| span.to_string()),
                swap: order.last(passes),
                operation,
                subgroup: passes.has_subgroups().then_some(order.subgroup()),
                element: judged(Some(order))?.shown.into_iter().next(),
                replay: replay.clone(),
            })));
        }
        watched.orders = orders;
        if !holds && own.is_none() {
            "in Karat's engine the assertion holds in no order, so none shows whether it depends on one"
                .clone_into(&mut watched.reason);
        }
        Ok(())
    }
}
