//! Faults inside of compute passes: operations whose operands were good, and whose result isn't.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use karat_engine::{F32, Faulty, Lanes, Observer, Options};

use super::dispatch::{Prepared, options};
use super::hazards::{Found, Kind, Missing, kind_of};
use super::sanitizer::made_up_options;
use super::{author_of, idiom_of, invocation};
use crate::dispatch::{Afterwards, DispatchError, Pass, Passes};
use crate::probe::RESULTS;
use crate::value::Scalar;

/// An operation at fault.
struct Fault {
    /// The first invocation.
    case: usize,
    count: usize,
    operands: Vec<f32>,
    /// Of a derivative the pixel that isn't there, and the address of the site at which it parted.
    missing: Option<(usize, Option<usize>)>,
}

/// Faults by the address of their site, and their kind.
#[derive(Default)]
struct Faults(Mutex<BTreeMap<(usize, Kind), Fault>>);

impl Faults {
    fn add(&self, site: usize, kind: Kind, fault: impl FnOnce() -> Fault) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.entry((site, kind)).or_insert_with(fault).count += 1;
    }
}

impl Observer<F32> for Faults {
    fn floats(&self, lanes: &Lanes<'_, F32>) {
        let site = std::ptr::from_ref(lanes.site).addr();
        for values in lanes.floats {
            for (lane, value) in values.iter().enumerate().filter(|(_, value)| !value.is_finite()) {
                let operands = || lanes.operands.iter().map(|operand| operand[lane]);
                // An operation that gets an infinity passes on what was wrong before.
                if lanes.active[lane] && operands().all(f32::is_finite) {
                    let kind = if value.is_nan() { Kind::Nan } else { Kind::Infinite };
                    self.add(site, kind, || {
                        let (case, operands) = (lanes.case_of(lane), operands().collect());
                        Fault { case, count: 0, operands, missing: None }
                    });
                }
            }
        }
    }

    fn fault(&self, one: &Faulty<'_>) {
        let address = |site: &karat_engine::Site| std::ptr::from_ref(site).addr();
        self.add(address(one.site), kind_of(one.fault), || {
            let missing = one.missing.map(|other| (other.case, other.parted.map(address)));
            Fault { case: one.case, count: 0, operands: Vec::new(), missing }
        });
    }
}

/// A hazard of a pass: the first invocation that has it, and how many operations of invocations do.
pub(crate) struct FoundInPass {
    pub(crate) found: Found,
    pub(crate) invocation: String,
    pub(crate) count: usize,
}

/// The faults inside of passes, in `f32`: values that aren't finite, integers that are divided by zero or don't fit.
/// The sanitizer tells of indices that leave their arrays.
pub(crate) fn hazards(passes: &Passes) -> Result<Vec<FoundInPass>, DispatchError> {
    hazards_with(passes, &options())
}

/// [`hazards`] of passes over made-up resources.
pub(crate) fn hazards_made_up(passes: &Passes) -> Result<Vec<FoundInPass>, DispatchError> {
    hazards_with(passes, &made_up_options())
}

fn hazards_with(passes: &Passes, options: &Options) -> Result<Vec<FoundInPass>, DispatchError> {
    let mut all = Vec::new();
    let prepared = Prepared::new(passes, &karat_engine::Settings::default())?;
    let held = prepared.run(&mut |pass: &Pass, lowered, resources| {
        let faults = Faults::default();
        lowered.dispatch::<F32>(pass.workgroups, resources, options, &faults)?;
        let size = lowered.workgroup_size().expect("a pass is an entry point");
        let faults = faults.0.into_inner().unwrap_or_else(PoisonError::into_inner);
        for ((address, kind), fault) in faults {
            let site_at = |address: usize| {
                let mut sites = lowered.sites().iter();
                sites.find(|one| std::ptr::from_ref(*one).addr() == address)
            };
            let site = site_at(address);
            let author = site.and_then(|site| author_of(&pass.program, site));
            let Some((span, text)) =
                author.filter(|_| !matches!(kind, Kind::OutOfRange | Kind::Wrapped))
            else {
                continue;
            };
            let idiom = site.and_then(|site| idiom_of(&pass.program, site));
            let (operands, values) = (fault.operands, None);
            let (hidden, of_given_size) = (false, false);
            let missing = fault.missing.map(|(other, parted)| Missing {
                reached: invocation(pass, size, fault.case),
                missing: invocation(pass, size, other),
                parted: parted
                    .and_then(site_at)
                    .and_then(|site| super::statement_of(&pass.program, site)),
            });
            let found =
                Found { kind, span, text, hidden, values, operands, idiom, of_given_size, missing };
            let invocation = invocation(pass, size, fault.case);
            all.push(FoundInPass { found, invocation, count: fault.count });
        }
        Ok(true)
    })?;
    // The operations behind a NaN aren't kept here, and one of them may depend on it.
    if are_finite(passes, prepared.left(&held))? {
        let infinite = all.iter_mut().filter(|one| one.found.kind == Kind::Infinite);
        infinite.for_each(|one| one.found.hidden = true);
    }
    Ok(all)
}

/// True if each float that passes leave is finite.
fn are_finite(passes: &Passes, left: Afterwards) -> Result<bool, DispatchError> {
    let mut finite = true;
    for (number, words) in left {
        let (_, shape) = passes.written(&passes.resources[number].name)?;
        let lanes = passes.lanes(number, &words).unwrap_or_default();
        let mut scalars = shape.lanes();
        // The results of pixels are words, with a canary behind each pixel's.
        let drawn = passes.passes.iter().find_map(|pass| pass.drawn.as_ref());
        if let Some(own) = drawn.filter(|_| passes.resources[number].name == RESULTS) {
            let of_pixel = own.iter().copied().chain([Scalar::U32]);
            scalars = of_pixel.cycle().take(lanes.len()).collect();
        }
        let mut each = scalars.iter().zip(&lanes);
        let is_finite = |(scalar, word): (&Scalar, &u32)| {
            !scalar.is_float() || scalar.decode(*word).is_finite()
        };
        finite &= each.all(is_finite);
    }
    Ok(finite)
}
