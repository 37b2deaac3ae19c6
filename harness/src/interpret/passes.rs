//! Finds hazards in compute passes, such as operations that turn finite operands into NaN or infinity.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, PoisonError};

use karat_engine::{F32, Here, Lanes, Observer, Reach, Wrong};

use super::dispatch::{Prepared, options};
use super::hazards::{Found, Kind, Missing};
use super::sanitizer::made_up_options;
use super::{Options, author_of, invocation, statement_of};
use crate::dispatch::{Afterwards, DispatchError, Pass, Passes};
use crate::probe::RESULTS;
use crate::value::Scalar;

struct Operation {
    operands: Vec<f32>,
    /// For a derivative that one pixel of a quad doesn't take: the index of that pixel, and the site at which that
    /// pixel took another branch.
    missing: Option<(usize, Option<usize>)>,
    invocations: BTreeSet<usize>,
}

/// Records the operations with hazards in a pass, by the index of their site and by the kind of hazard.
struct Recorder {
    all: Mutex<BTreeMap<(usize, Kind), Operation>>,
    /// The invocations that reach each site; `None` if the caller doesn't need these invocations.
    reach: Option<Reach>,
}

impl Recorder {
    fn add(&self, site: usize, kind: Kind, case: usize, operation: impl FnOnce() -> Operation) {
        let mut all = self.all.lock().unwrap_or_else(PoisonError::into_inner);
        all.entry((site, kind)).or_insert_with(operation).invocations.insert(case);
    }
}

impl Observer<F32> for Recorder {
    fn floats(&self, lanes: &Lanes<'_, F32>) {
        // Checks the values of all lanes at once, because this code runs for each operation in each iteration.
        let is_bad = |values: &&[f32]| !values.iter().fold(true, |good, x| good & x.is_finite());
        if !lanes.floats.iter().any(|values| is_bad(&&**values)) {
            return;
        }
        // If an operand is already infinite, an earlier operation caused the error.
        let mut good = lanes.active.to_vec();
        for operand in lanes.operands {
            good.iter_mut().zip(operand.iter()).for_each(|(good, x)| *good &= x.is_finite());
        }
        if !good.contains(&true) {
            return;
        }
        let site = lanes.site.number;
        for values in lanes.floats {
            let bad = |(lane, value): &(usize, &f32)| good[*lane] && !value.is_finite();
            for (lane, value) in values.iter().enumerate().filter(bad) {
                let kind = if value.is_nan() { Kind::Nan } else { Kind::Infinite };
                self.add(site, kind, lanes.case_of(lane), || Operation {
                    operands: lanes.operands.iter().map(|operand| operand[lane]).collect(),
                    missing: None,
                    invocations: BTreeSet::new(),
                });
            }
        }
    }

    fn wrong(&self, one: &Wrong<'_>) {
        self.add(one.site.number, one.kind, one.case, || {
            let parted = |other: karat_engine::Missing<'_>| {
                (other.case, other.parted.map(|site| site.number))
            };
            let missing = one.missing.map(parted);
            Operation { operands: Vec::new(), missing, invocations: BTreeSet::new() }
        });
    }

    fn reached(&self, here: &Here<'_, F32>) {
        if let Some(reach) = &self.reach {
            reach.add(here.site.number, here);
        }
    }
}

/// A hazard in a pass, with the invocations in which it occurs.
pub struct FoundInPass {
    /// The hazard and its position.
    pub found: Found,
    /// The name of the first invocation in which the hazard occurs.
    pub invocation: String,
    /// The indices of all invocations in which the hazard occurs.
    pub invocations: BTreeSet<usize>,
    /// The position of the statement that contains the operation. The sanitizer reports accesses at this position.
    pub statement: Option<String>,
}

/// The hazards in passes, and the invocations that reach each operation.
#[derive(Default)]
pub struct Operations {
    /// The operations that have hazards.
    pub wrong: Vec<FoundInPass>,
    /// The indices of the invocations that reach each operation, by the operation's position in the source file.
    pub reached: BTreeMap<String, BTreeSet<usize>>,
}

/// The hazards in the passes of a test.
pub(crate) fn hazards(passes: &Passes) -> Result<Vec<FoundInPass>, DispatchError> {
    Ok(watched(passes, &options(), false)?.wrong)
}

/// The hazards in passes over generated resources, and the invocations that reach each operation.
pub fn operations(passes: &Passes) -> Result<Operations, DispatchError> {
    watched(passes, &made_up_options(), true)
}

fn watched(
    passes: &Passes,
    options: &Options,
    are_places: bool,
) -> Result<Operations, DispatchError> {
    let mut all = Operations::default();
    let prepared = Prepared::new(passes, &karat_engine::Settings::default())?;
    let held = prepared.run(&mut |pass: &Pass, lowered, resources| {
        let reach = are_places.then(Reach::default);
        let faults = Recorder { all: Mutex::default(), reach };
        lowered.dispatch::<F32>(pass.workgroups, resources, options, &faults)?;
        let size = lowered.workgroup_size().expect("a pass is an entry point");
        let site = |number: usize| lowered.sites().get(number);
        let author = |number: usize| author_of(&pass.program, site(number)?);
        for site in lowered.operations().filter(|_| are_places) {
            if let Some((span, _)) = author_of(&pass.program, site) {
                all.reached.entry(span.to_string()).or_default();
            }
        }
        for (number, invocations) in faults.reach.unwrap_or_default().cases() {
            let statement = site(number).and_then(|site| statement_of(&pass.program, site));
            let own = author(number).map(|(span, _)| span);
            // The sanitizer names an access by the position of its statement.
            let places: BTreeSet<String> =
                own.iter().chain(&statement).map(ToString::to_string).collect();
            for place in places {
                all.reached.entry(place).or_default().extend(&invocations);
            }
        }
        let faults = faults.all.into_inner().unwrap_or_else(PoisonError::into_inner);
        for ((number, kind), fault) in faults {
            let Some((span, text)) = author(number) else { continue };
            let statement = |number| statement_of(&pass.program, site(number)?);
            let first = fault.invocations.first().copied().unwrap_or_default();
            let missing = fault.missing.map(|(other, parted)| Missing {
                reached: invocation(pass, size, first),
                missing: invocation(pass, size, other),
                parted: parted.and_then(statement),
            });
            let (hidden, values, operands) = (false, None, fault.operands);
            let found = Found { kind, site: number, span, text, hidden, values, operands, missing };
            let (invocation, invocations) = (invocation(pass, size, first), fault.invocations);
            let statement = statement(number).map(|span| span.to_string());
            all.wrong.push(FoundInPass { found, invocation, invocations, statement });
        }
        Ok(true)
    })?;
    // If all written data is finite, infinities are hidden. A NaN may still matter: later operations aren't recorded.
    if are_finite(passes, prepared.left(&held))? {
        let infinite = all.wrong.iter_mut().filter(|one| one.found.kind == Kind::Infinite);
        infinite.for_each(|one| one.found.hidden = true);
    }
    Ok(all)
}

fn are_finite(passes: &Passes, left: Afterwards) -> Result<bool, DispatchError> {
    let mut finite = true;
    for (number, words) in left {
        let (_, shape) = passes.written(&passes.resources[number].name)?;
        let lanes = passes.lanes(number, &words).expect("passes write what they leave");
        let mut scalars = shape.lanes();
        // A draw writes the results of each pixel as `u32` words, followed by the pixel's canary.
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
