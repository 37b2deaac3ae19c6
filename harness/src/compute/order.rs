//! Checks assertions about passes in several orders of workgroups and invocations, because WGSL promises no order.
//!
//! The order of atomics may change a result, even without a race. The engine runs the passes in orders that a seed
//! determines, and this module judges each result.

use std::fmt;

use super::judge::{Assertion, Element, Expected, Sum};
use super::{After, ComputeError};
use crate::dispatch::{Afterwards, DispatchError, Examined, Part, Passes};
use crate::interpret::asserted::{SHOWN, printed_by};
use crate::interpret::{OrderOf, Run, Runner, Tried, in_order_of, parting};
use crate::probe::ProbeError;
use crate::record::{Details, Replay, tell_prints};
use crate::run::Report;
use crate::value::Shape;

/// A failed check: the result of the passes depends on the order of invocations.
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
/// assert!(order.swap.contains("the last one first"), "{}", order.swap);
/// passes().up_to_order().agrees_with([0_u32, 1, 2, 3], Abs(0.0));
/// ```
#[derive(Clone, Debug)]
pub struct OrderDependence {
    /// The entry points of the passes, separated by commas.
    pub entry_points: String,
    /// The name of the resource's variable.
    pub variable: String,
    /// The assertion that fails.
    pub assertion: String,
    /// `true` if the assertion holds in the engine's usual order.
    pub holds: bool,
    /// The position of the fault, as `file:line:column`: the store that takes effect late (see `turns`). Without such a
    /// store, the position is the first operation that returns a different value than in the usual order. Without such
    /// an operation, it is the entry point of the last pass that runs in another order.
    pub location: String,
    /// The difference from the usual order: `local (3, 0, 0) of workgroup (0, 0, 0) stalls before its second atomic`.
    pub swap: String,
    /// A note with the operation, the invocation, the value in the usual order, and the value in the failing order. It
    /// is `None` if only the order of writes differs.
    pub operation: Option<String>,
    /// Notes for the message. If there are at most 16 atomic operations, one note lists them as they run in the failing
    /// order. If a store takes effect late, another note describes it: an invocation stores a value before its atomic
    /// operation, but other invocations see the atomic operation first.
    pub turns: Vec<String>,
    /// The subgroup size in the failing order. It is `None` if the passes don't use subgroups.
    pub subgroup: Option<u32>,
    /// The first element that is wrong in the failing order.
    pub element: Option<Element>,
    /// The command that runs all orders again.
    pub replay: Replay,
}

impl OrderDependence {
    pub(super) fn details(&self) -> Details {
        let (headline, replay) = (self.headline(), Some(self.replay.clone()));
        Details { headline, replay, ..Details::default() }
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
            writeln!(
                f,
                "  in the usual order, {}. The assertion fails if {}",
                self.assertion, self.swap
            )?;
        } else {
            writeln!(
                f,
                "  in the usual order of Karat's engine, this assertion fails: {}. Each order must give the same result, but the result changes if {}",
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
        for turns in &self.turns {
            writeln!(f, "  = {}", turns.replace('\n', "\n  "))?;
        }
        if self.subgroup.is_some() {
            writeln!(
                f,
                "  = a subgroup has from 4 to 128 invocations, depending on the device: use `subgroup_size` instead of a fixed number"
            )?;
        }
        writeln!(
            f,
            "  = WGSL promises no order of invocations, and drivers use different orders. A barrier orders the invocations of a workgroup, and a second pass orders workgroups. If the order of elements shouldn't matter, \
             use `up_to_order`. If sums of floats differ, use a tolerance"
        )?;
        writeln!(f, "  replay: {}", self.replay)
    }
}

impl After<'_> {
    /// Compares elements without regard to their order. Use this method for passes that append elements with an atomic
    /// counter, because drivers append elements in different orders. Karat sorts the actual and the expected elements
    /// by value. If each element has several numbers, such as a vector's components, the first numbers of any two
    /// elements should differ by more than the tolerance. Otherwise Karat may compare the wrong elements. In a
    /// structure that ends in an array, such as a counter with its items, Karat sorts only that array.
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

    /// Arranges the elements in rows and columns, row by row. Messages then name the row and column of an element.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
    ///             @compute @workgroup_size(1) fn spoil() { data[5] = 9u; }";
    /// let package = Package::from_source("m", text);
    /// let passes = package.compute().with("data", Storage::new([0_u32; 6])).dispatch("spoil", [1, 1, 1]);
    /// let failure = passes.after("data").unrecorded().grid(2, 3).try_agrees_with([0_u32; 6], Abs(0.0)).unwrap_err();
    /// assert!(failure.to_string().contains("[5: row 1, column 2]"), "{failure}");
    /// ```
    #[must_use = "nothing is compared until a verb such as `.agrees_with(...)`"]
    pub fn grid(mut self, rows: usize, columns: usize) -> Self {
        self.grid = Some([rows, columns]);
        self
    }

    /// Runs the passes in the engine, in one order after another. In each order, the test must accept every violation,
    /// and the assertion must hold. If the assertion fails in the usual order, the callers of this function report the
    /// failure.
    pub(super) fn expect_each_order(
        &self,
        assertion: Option<(&Assertion<'_>, &Part, &Shape)>,
        passes: &Passes,
        report: &mut Report,
        replay: &Replay,
    ) -> Result<(), ComputeError> {
        self.expect_known_variables(passes)?;
        let assertion = assertion.filter(|(assertion, ..)| !assertion.is_settled());
        let mut runner = Runner::new(passes);
        let mut examined = Examined::default();
        let mut judged: Option<InOrders<'_>> = None;
        let mut dependent = None;
        while let Some(run) = runner.next() {
            let Run { order, mut left, examined: own, .. } = run;
            let endless = own.endless.is_some();
            let has_violation = own.violations.iter().any(|(one, _)| self.fails(one));
            if order.is_none() {
                examined = own;
                judged = match (assertion, left.take()) {
                    (Some((assertion, part, element)), Some(left)) => {
                        let lanes = lanes_of(passes, part, left);
                        Some(InOrders::new(self, assertion, (part, element), lanes)?)
                    }
                    _ => None,
                };
            } else {
                examined.violations.extend(own.violations);
            }
            if has_violation {
                runner.found();
            }
            let (Some(order), Some(judged)) = (order, &judged) else { continue };
            if judged.sum(passes, left, endless)?.census.failures > 0 {
                dependent = Some(order);
                break;
            }
        }
        let examined = self.with_tint(passes, examined);
        self.expect_no_violations(examined, report, replay)?;
        tell_prints(&printed_by(passes, SHOWN)?.concat());
        if let (Some(order), Some(judged)) = (dependent, &judged) {
            return Err(self.dependence(passes, order, judged, replay)?);
        }
        let Some(watched) = report.watched.as_mut() else { return Ok(()) };
        let tried = runner.tried();
        (watched.orders, watched.all_orders) = (tried.orders, tried.all);
        let Some(judged) = judged.filter(|_| watched.reason.is_empty() && watched.of > 1) else {
            return Ok(());
        };
        if tried == Tried::default() {
            let why = match crate::settings::schedules() {
                Some(0) => "the setting `KARAT_SCHEDULES` is 0",
                _ => "a run in one order takes too long",
            };
            watched.reason = format!("no other order of invocations was tried: {why}");
        } else if tried.orders > 0 && judged.is_undecided() {
            "the assertion fails in all orders that Karat's engine tried, so Karat can't tell if the assertion depends on the order"
                .clone_into(&mut watched.reason);
        }
        Ok(())
    }

    /// Builds the error for an order that fails. First simplifies the order as long as the simpler order also fails.
    fn dependence(
        &self,
        passes: &Passes,
        mut order: OrderOf,
        judged: &InOrders<'_>,
        replay: &Replay,
    ) -> Result<ComputeError, ComputeError> {
        let run = |order: &OrderOf| {
            let left = match in_order_of(passes, Some(order)) {
                // A loop waits for an invocation that runs later. WGSL doesn't promise that the later invocation runs.
                Err(DispatchError::Probe(ProbeError::Rounds { .. }) | DispatchError::Rounds(_)) => {
                    None
                }
                other => Some(other?),
            };
            let endless = left.is_none();
            judged.sum(passes, left, endless)
        };
        'simpler: loop {
            for other in order.simpler().collect::<Vec<_>>() {
                if run(&other)?.census.failures > 0 {
                    order = other;
                    continue 'simpler;
                }
            }
            break;
        }
        let entry_points: Vec<&str> = passes.entry_points().collect();
        let parting = parting(passes, &order);
        let (first, turns) = parting.map(|own| (own.first, own.turns)).unwrap_or_default();
        let (place, operation) = first.unzip();
        let place = turns.late.as_ref().map(|(span, _)| span.clone()).or(place);
        let last = || order.passes(passes).last().and_then(|(pass, _)| pass.span());
        let place = place.or_else(last);
        Ok(ComputeError::Order(Box::new(OrderDependence {
            entry_points: entry_points.join(", "),
            variable: self.variable.clone(),
            assertion: judged.assertion.holds(),
            holds: judged.holds,
            location: place.map_or_else(String::new, |span| span.to_string()),
            swap: order.told(passes),
            operation,
            turns: turns.told(),
            subgroup: passes.has_subgroups().then_some(order.subgroup()),
            element: run(&order)?.shown.into_iter().next(),
            replay: replay.clone(),
        })))
    }
}

fn lanes_of(passes: &Passes, part: &Part, left: Afterwards) -> Vec<u32> {
    let own = left.into_iter().find(|(of, _)| *of == part.number);
    let lanes = own.and_then(|(_, words)| passes.lanes(part.number, &words));
    part.pick(lanes.expect("a pass writes the resource"))
}

struct InOrders<'a> {
    after: &'a After<'a>,
    assertion: &'a Assertion<'a>,
    part: &'a Part,
    element: &'a Shape,
    /// The scalars of the resource after a run in the usual order.
    usual: Vec<u32>,
    holds: bool,
    /// The assertion for the other orders, if the elements in the usual order differ from the expected elements: each
    /// other order must give the same elements as the usual order, within the tolerance.
    own: Option<Assertion<'a>>,
}

impl<'a> InOrders<'a> {
    fn new(
        after: &'a After<'a>,
        assertion: &'a Assertion<'a>,
        (part, element): (&'a Part, &'a Shape),
        usual: Vec<u32>,
    ) -> Result<Self, ComputeError> {
        let function = after.last_entry_point();
        let holds = after.sum(assertion, None, element, &usual, function)?.census.failures == 0;
        // The engine's result may be beyond the tolerance, because drivers round differently. The other orders must
        // still give the engine's result. A statement that holds in only some orders depends on the order.
        let own = match assertion {
            Assertion::Agrees(_, tolerance) if !holds => {
                let shape = element.clone();
                let scalars = element.lanes().into_iter().cycle();
                let lanes = usual.iter().zip(scalars).map(|(word, scalar)| scalar.decode(*word));
                let expected = Expected { shape, lanes: lanes.collect() };
                Some(Assertion::Agrees(expected, tolerance.clone()))
            }
            _ => None,
        };
        Ok(Self { after, assertion, part, element, usual, holds, own })
    }

    /// Checks if the assertion is a statement that fails in the usual order. If such a statement holds in another
    /// order, the result depends on the order.
    fn is_undecided(&self) -> bool {
        !self.holds && self.own.is_none()
    }

    /// Judges the result of a run in an order other than the usual order. `endless` is `true` if a loop didn't end.
    fn sum(
        &self,
        passes: &Passes,
        left: Option<Afterwards>,
        endless: bool,
    ) -> Result<Sum, ComputeError> {
        let Some(left) = left else {
            return Ok(if endless { Sum::endless() } else { Sum::of_failures(0, None) });
        };
        let lanes = lanes_of(passes, self.part, left);
        if lanes == self.usual {
            return Ok(Sum::of_failures(0, None));
        }
        let assertion = self.own.as_ref().unwrap_or(self.assertion);
        let function = self.after.last_entry_point();
        let sum = self.after.sum(assertion, None, self.element, &lanes, function)?;
        if self.is_undecided() {
            return Ok(Sum::of_failures(usize::from(sum.census.failures == 0), None));
        }
        Ok(sum.named(passes, self.part.number, self.after.grid))
    }
}
