//! Observers, which see the values that a run computes.

use std::borrow::Cow;
use std::sync::{Mutex, PoisonError};

use crate::arithmetic::Arithmetic;
use crate::code::Site;
use karat_core::hazard::Kind;

/// The values of all lanes at one operation.
#[derive(Debug)]
pub struct Lanes<'a, A: Arithmetic> {
    /// The operation's site.
    pub site: &'a Site,
    /// The case of the first lane.
    pub case: usize,
    /// The floats among the operation's results: for each float, a slice with one value for each lane.
    pub floats: &'a [&'a [A::Float]],
    /// The floats from which the operation computed its results. Empty for let-bindings, texels and conversions.
    pub operands: &'a [&'a [A::Float]],
    /// The operation's integers.
    pub ints: &'a [&'a [A::Int]],
    /// The operation's booleans.
    pub bools: &'a [&'a [A::Bool]],
    /// The active lanes. The values of other lanes have no meaning.
    pub active: &'a [A::Bool],
}

impl<A: Arithmetic> Lanes<'_, A> {
    /// The case of a lane.
    #[must_use]
    pub fn case_of(&self, lane: usize) -> usize {
        self.case + lane
    }
}

/// A case in which an operation goes wrong.
#[derive(Debug)]
pub struct Wrong<'a> {
    /// The kind of hazard.
    pub kind: Kind,
    /// The operation's site.
    pub site: &'a Site,
    /// The case.
    pub case: usize,
    /// For a derivative that only some pixels of a quad reach: the pixel that doesn't reach it. WGSL doesn't define the
    /// result of such a derivative (15.2, *derivative_uniformity*).
    pub missing: Option<Missing<'a>>,
}

/// A pixel that doesn't reach a derivative.
#[derive(Clone, Copy, Debug)]
pub struct Missing<'a> {
    /// The pixel's case.
    pub case: usize,
    /// The site of the condition or the jump at which this pixel left the other pixels of the quad.
    pub parted: Option<&'a Site>,
}

/// The lanes that reach an operation.
pub struct Here<'a, A: Arithmetic> {
    /// The operation's site.
    pub site: &'a Site,
    /// The case of the first lane.
    pub case: usize,
    /// Computes the lanes on demand, because few observers need them.
    pub(crate) lanes: &'a dyn Fn() -> Cow<'a, [A::Bool]>,
}

impl<A: Arithmetic> Here<'_, A> {
    /// For each lane, `true` if the lane reaches the operation.
    #[must_use]
    pub fn lanes(&self) -> Cow<'_, [A::Bool]> {
        (self.lanes)()
    }
}

impl<A: Arithmetic> std::fmt::Debug for Here<'_, A> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Here").field("site", self.site).field("case", &self.case).finish()
    }
}

/// For each operation of a program, the cases that reach it. This type is in the engine's crate so that
/// [`add`](Self::add) is compiled with the crate's optimisations, because a run calls `add` for each operation.
#[derive(Debug, Default)]
pub struct Reach {
    by_site: Mutex<Vec<Vec<u64>>>,
}

impl Reach {
    /// Adds the lanes that reach the operation with this site number.
    pub fn add<A: Arithmetic<Bool = bool>>(&self, site: usize, here: &Here<'_, A>) {
        let lanes = here.lanes();
        let mut all = self.by_site.lock().unwrap_or_else(PoisonError::into_inner);
        if all.len() <= site {
            all.resize_with(site + 1, Vec::new);
        }
        let own = &mut all[site];
        let words = (here.case + lanes.len()).div_ceil(64);
        if own.len() < words {
            own.resize(words, 0);
        }
        // A run begins at a multiple of its width, so most words are complete.
        let mut at = here.case;
        let mut rest = &*lanes;
        while !rest.is_empty() {
            let (word, first) = (&mut own[at / 64], at % 64);
            let (now, others) = rest.split_at(rest.len().min(64 - first));
            if *word != u64::MAX {
                let bits = now.iter().rev().fold(0, |bits, active| bits << 1 | u64::from(*active));
                *word |= bits << first;
            }
            at += now.len();
            rest = others;
        }
    }

    /// For each operation that a case reached, its site number and the cases.
    #[must_use]
    pub fn cases(self) -> Vec<(usize, Vec<usize>)> {
        let all = self.by_site.into_inner().unwrap_or_else(PoisonError::into_inner);
        let cases = |words: Vec<u64>| -> Vec<usize> {
            let bits = words.iter().enumerate().flat_map(|(at, word)| {
                (0..64).filter(move |bit| word >> bit & 1 == 1).map(move |bit| 64 * at + bit)
            });
            bits.collect()
        };
        let all = all.into_iter().map(cases).enumerate();
        all.filter(|(_, cases)| !cases.is_empty()).collect()
    }
}

/// Observes the values that a run computes. By default, all methods do nothing. `()` observes nothing and costs no
/// time. Chunks run on several threads at the same time.
///
/// Runs receive the observer as `dyn`. So the machine is compiled in this crate, with the crate's optimisations, and
/// not in each crate that has an observer.
pub trait Observer<A: Arithmetic>: Sync {
    /// Checks if the observer wants to receive values. If not, the run is faster.
    fn is_active(&self) -> bool {
        true
    }

    /// Receives the floats that an operation has computed.
    fn floats(&self, lanes: &Lanes<'_, A>) {
        let _ = lanes;
    }

    /// Receives the results of an operation that [`floats`](Self::floats) doesn't receive: integers, booleans, or
    /// floats that a condition selected.
    fn others(&self, lanes: &Lanes<'_, A>) {
        let _ = lanes;
    }

    /// Receives the value of a let-binding, if the program was lowered with [`named`](crate::Settings::named). The
    /// value's floats come first, then its integers, then its booleans.
    fn named(&self, lanes: &Lanes<'_, A>) {
        let _ = lanes;
    }

    /// Receives an operation that at least one lane reaches.
    fn reached(&self, here: &Here<'_, A>) {
        let _ = here;
    }

    /// Receives a case in which an operation goes wrong.
    fn wrong(&self, one: &Wrong<'_>) {
        let _ = one;
    }
}

impl<A: Arithmetic> Observer<A> for () {
    fn is_active(&self) -> bool {
        false
    }
}
