//! What watches a run.

use std::borrow::Cow;
use std::sync::{Mutex, PoisonError};

use crate::arithmetic::Arithmetic;
use crate::code::Site;
use karat_core::hazard::Kind;

/// Values of all lanes at one operation.
#[derive(Debug)]
pub struct Lanes<'a, A: Arithmetic> {
    /// Where the author wrote it.
    pub site: &'a Site,
    /// The case that the first lane is.
    pub case: usize,
    /// Its floats: a slice of lanes for each.
    pub floats: &'a [&'a [A::Float]],
    /// The floats that an operation computed them from; none for let-bindings, texels and conversions.
    pub operands: &'a [&'a [A::Float]],
    /// Its integers.
    pub ints: &'a [&'a [A::Int]],
    /// Its booleans.
    pub bools: &'a [&'a [A::Bool]],
    /// Which lanes are here; values of others mean nothing.
    pub active: &'a [A::Bool],
}

impl<A: Arithmetic> Lanes<'_, A> {
    /// The case that a lane is.
    #[must_use]
    pub fn case_of(&self, lane: usize) -> usize {
        self.case + lane
    }
}

/// What goes wrong at an operation in one case.
#[derive(Debug)]
pub struct Wrong<'a> {
    /// Its kind.
    pub kind: Kind,
    /// Where the author wrote the operation.
    pub site: &'a Site,
    /// The case.
    pub case: usize,
    /// Of a derivative the pixel that isn't there: WGSL leaves open what it is (15.2, *derivative_uniformity*).
    pub missing: Option<Missing<'a>>,
}

/// A pixel that doesn't come to a derivative.
#[derive(Clone, Copy, Debug)]
pub struct Missing<'a> {
    /// Its case.
    pub case: usize,
    /// The condition, or the jump, where it went another way.
    pub parted: Option<&'a Site>,
}

/// The lanes that come to an operation.
pub struct Here<'a, A: Arithmetic> {
    /// The place of the operation, as the author wrote it.
    pub site: &'a Site,
    /// The case that the first lane is.
    pub case: usize,
    /// Gives the lanes; few observers ask.
    pub(crate) lanes: &'a dyn Fn() -> Cow<'a, [A::Bool]>,
}

impl<A: Arithmetic> Here<'_, A> {
    /// True for each lane that comes.
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

/// The lanes that come to each operation of a program. It stands here so that it is compiled with this crate's
/// optimisation: each operation of a run is added.
#[derive(Debug, Default)]
pub struct Reach {
    /// By the number of the site, a bit for each case.
    by_site: Mutex<Vec<Vec<u64>>>,
}

impl Reach {
    /// Adds the lanes that come to an operation, whose site has this number.
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
        // Cases of a run begin at a multiple of its width, so that most words are whole.
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

    /// The cases that came to each operation, by the number of its site, where some did.
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

/// Sees what a run computes. All methods do nothing by default, and `()` observes nothing at no
/// cost. Chunks run on several threads at once.
///
/// Runs take it as `dyn`: the machine is compiled here, with this crate's optimisation, and not in each crate
/// that observes.
pub trait Observer<A: Arithmetic>: Sync {
    /// Returns `true` if it is called at all.
    fn is_active(&self) -> bool {
        true
    }

    /// An operation gave floats: one for each result.
    fn floats(&self, lanes: &Lanes<'_, A>) {
        let _ = lanes;
    }

    /// An operation gave something else than new floats: integers, booleans, or what a condition
    /// selected.
    fn others(&self, lanes: &Lanes<'_, A>) {
        let _ = lanes;
    }

    /// A let-binding got its value; only in programs lowered with [`named`](crate::Settings::named).
    /// Scalars are sorted: floats, integers, booleans.
    fn named(&self, lanes: &Lanes<'_, A>) {
        let _ = lanes;
    }

    /// Some lane comes to an operation.
    fn reached(&self, here: &Here<'_, A>) {
        let _ = here;
    }

    /// An operation goes wrong: called for each case of each such operation.
    fn wrong(&self, one: &Wrong<'_>) {
        let _ = one;
    }
}

impl<A: Arithmetic> Observer<A> for () {
    fn is_active(&self) -> bool {
        false
    }
}
