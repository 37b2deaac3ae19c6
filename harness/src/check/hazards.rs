//! The verbs `has_no_hazards` and `has_none_of`, which check the operations inside of a function for hazards.

use std::sync::atomic::{AtomicBool, Ordering};

use super::batch::Batch;
use super::demand::Demand;
use super::kinds::{Accepted, Kinds};
use super::plan::Plan;
use super::session::{Asserted, Explained, Session};
use super::{Agreement, Calls, Check, Failure, Mismatch, tolerances};
use crate::domain::Stream;
use crate::interpret::hazards::{Found, Kind, Missing};
use crate::judge::{Class, Judged};
use crate::run::or_panic;
use crate::tolerance::LaneError;

impl<V> Check<'_, Calls<V>> {
    /// Checks that no operation inside of the function has a hazard, even if the hazard has no effect on the
    /// result. The hazards are:
    ///
    /// - a value becomes NaN or infinite, or loses more than half of its digits;
    /// - an index is outside of its array;
    /// - WGSL sets no bound for the error of an operation;
    /// - the function takes a derivative, or samples a texture with an implicit derivative, while another pixel of
    ///   the quad runs other code.
    ///
    /// Karat's engine watches each operation. The selected paths must return results, but the check ignores the
    /// results' values. To find hazards without writing a test, use the crate `karat-inspect`.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// // 1 / 0 is infinite, although `min` hides it from the result.
    /// let text = "fn capped(x: f32) -> f32 { return min(1.0 / x, 100.0); }";
    /// let package = Package::from_source("m", text);
    /// package.function("capped").over(0.001..=1.0).has_no_hazards();
    /// assert!(package.function("capped").over(0.0..=1.0).unrecorded().try_has_no_hazards().is_err());
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if an operation has a hazard, or the engine can't execute the function.
    #[track_caller]
    pub fn has_no_hazards(self) -> Agreement {
        or_panic(self.try_has_no_hazards())
    }

    /// Runs [`has_no_hazards`](Self::has_no_hazards), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure with which [`has_no_hazards`](Self::has_no_hazards) panics.
    pub fn try_has_no_hazards(self) -> Result<Agreement, Failure> {
        self.plan.hazards(&*self.stream, &self.demand(), None)
    }

    /// Checks that no operation inside of the function has a hazard of these kinds. Ignores other kinds.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// use karat::check::HazardKind;
    ///
    /// let text = "fn shade(k: u32) -> f32 { var levels = array(0.0, 0.5, 1.0); return pow(levels[k], 5.0); }";
    /// let package = Package::from_source("m", text);
    /// // WGSL sets no bound for `pow` of 0. This check ignores that hazard.
    /// let shade = || package.function("shade").over(Integers(0..=2_u32));
    /// shade().has_none_of([HazardKind::OutOfRange, HazardKind::Nan]);
    /// assert!(shade().unrecorded().try_has_none_of([HazardKind::Unbounded]).is_err());
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if an operation has such a hazard, if `kinds` is empty or contains a kind that no
    /// operation inside of a function can have (such as `Race`), or if the engine can't execute the function.
    #[track_caller]
    pub fn has_none_of(self, kinds: impl IntoIterator<Item = Kind>) -> Agreement {
        or_panic(self.try_has_none_of(kinds))
    }

    /// Runs [`has_none_of`](Self::has_none_of), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure with which [`has_none_of`](Self::has_none_of) panics.
    pub fn try_has_none_of(
        self,
        kinds: impl IntoIterator<Item = Kind>,
    ) -> Result<Agreement, Failure> {
        let kinds: Vec<Kind> = kinds.into_iter().collect();
        self.plan.hazards(&*self.stream, &self.demand(), Some(&kinds))
    }

    /// Accepts the hazard of an operation. `text` is the operation's source text, such as `1.0 / x`. `reason` says why
    /// the hazard is acceptable. If the check finds no hazard in this operation, the check fails until you remove this
    /// call.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "fn capped(x: f32) -> f32 { return min(1.0 / x, 100.0); }";
    /// let package = Package::from_source("m", text);
    /// let capped = package.function("capped").over(0.0..=1.0);
    /// capped.accept_hazard("1.0 / x", "`min` caps it").has_no_hazards();
    /// ```
    pub fn accept_hazard(mut self, text: &str, reason: &str) -> Self {
        let (text, reason) = (one_line(text), reason.to_owned());
        self.plan.accepted.push(Accepted { text, reason });
        self
    }
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

impl Plan<'_> {
    pub(super) fn expect_hazards_asked(&self, asserted: &Asserted) -> Result<(), Failure> {
        match (self.accepted.first(), asserted.explained) {
            (None, _) | (_, Explained::ByHazards(_)) => Ok(()),
            (Some(one), _) => {
                let wrong =
                    "does nothing here: only `has_no_hazards` and `has_none_of` look for hazards";
                Err(Mismatch::Accepted(one.text.clone(), wrong).of(&self.function()?))
            }
        }
    }

    pub(super) fn hazards(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
        of: Option<&[Kind]>,
    ) -> Result<Agreement, Failure> {
        let kinds = Kinds::of(of.unwrap_or(&Kinds::ALL));
        let names: Vec<&str> = of.unwrap_or_default().iter().map(|kind| kind.name()).collect();
        let (verb, statement) = match of {
            None => ("has_no_hazards", "no operation has a hazard".to_owned()),
            Some(_) => {
                ("has_none_of", format!("no operation has the hazard {}", names.join(" or ")))
            }
        };
        let asserted =
            Asserted { explained: Explained::ByHazards(kinds), ..Asserted::new(verb, statement) };
        let used: Vec<AtomicBool> = self.accepted.iter().map(|_| AtomicBool::default()).collect();
        self.conclude(&asserted, stream, demand, &mut |session| {
            tolerances::expect_none(&self.tolerance_on, verb, &session.called)?;
            let function = session.called.function();
            let mut asked = of.into_iter().flatten();
            let other = asked.find(|kind| !Kinds::ALL.contains(kind));
            let other =
                other.map(|kind| format!("no operation alone has the hazard `{}`", kind.name()));
            let none = of
                .is_some_and(<[Kind]>::is_empty)
                .then(|| "the check names no kind of hazard".to_owned());
            if let Some(wrong) = other.or(none) {
                return Err(Mismatch::Hazard(wrong).of(function));
            }
            if let Some(one) = self.accepted.iter().find(|one| one.reason.trim().is_empty()) {
                return Err(Mismatch::Accepted(one.text.clone(), "has no reason").of(function));
            }
            let witness = session.witness()?;
            let left_out = |one: &Found| {
                let (is_out, accepted) = session.leaves_out(one, kinds);
                if let Some(own) = accepted {
                    used[own].store(true, Ordering::Relaxed);
                }
                is_out
            };
            let sum = session.run(&mut |batch: &Batch, running| {
                let found = witness.hazards_but(batch.cases, &batch.lanes(), &left_out)?;
                let mut found = found.cases;
                found.iter_mut().for_each(|case| case.retain(|one| !left_out(one)));
                let judge = |case: usize, _: &[u32]| Judged {
                    measure: LaneError::statement(found[case].is_empty()),
                    lane: 0,
                    class: found[case].first().map_or(Class::Other, |one| class(one.kind)),
                };
                session.judge(batch, running, |_| None, &judge)
            })?;
            let unused = used.iter().position(|used| !used.load(Ordering::Relaxed));
            match unused.filter(|_| !session.is_replay() && !sum.fails()) {
                Some(unused) => {
                    let text = self.accepted[unused].text.clone();
                    Err(Mismatch::Accepted(text, "isn't needed: remove it").of(function))
                }
                None => Ok(sum),
            }
        })
    }
}

fn class(kind: Kind) -> Class {
    match kind {
        Kind::Nan => Class::Nan,
        Kind::Infinite => Class::Infinite,
        Kind::Unbounded => Class::Unbounded,
        _ => Class::Other,
    }
}

impl Session<'_> {
    /// Returns the hazards that occur for a row of arguments, as notes for the report. Each note is the label `hazard`
    /// with a description, such as `NaN at ...`.
    pub(super) fn hazards_of(&self, row: &[u32], kinds: Kinds) -> Vec<(&'static str, String)> {
        let left_out = |one: &Found| self.leaves_out(one, kinds).0;
        let found = self.witness().and_then(|witness| witness.hazards_but(1, row, &left_out));
        let found = found.ok().and_then(|mut found| found.cases.pop()).unwrap_or_default();
        let shown = |one: &Found| {
            let text = one_line(&one.text);
            let more = match &one.missing {
                Some(Missing { missing, parted: Some(parted), .. }) => {
                    format!("; {missing} takes another branch at {parted}")
                }
                Some(Missing { missing, .. }) => {
                    format!("; {missing} doesn't reach this operation")
                }
                None if one.hidden => "; a later operation hides this hazard".to_owned(),
                None => String::new(),
            };
            ("hazard", format!("{} at `{text}` ({}){more}", one.kind.name(), one.span))
        };
        found.iter().filter(|one| !left_out(one)).map(shown).collect()
    }

    /// Returns `true` if the hazard's kind isn't in `kinds`, or if the author accepted the hazard with `accept_hazard`.
    /// Also returns the index of the matching `accept_hazard` call, if there is one.
    fn leaves_out(&self, one: &Found, kinds: Kinds) -> (bool, Option<usize>) {
        let text = one_line(&one.text);
        let accepted = self.accepted.iter().position(|own| own.text == text);
        let accepted = accepted.filter(|_| kinds.contains(one.kind));
        (!kinds.contains(one.kind) || accepted.is_some(), accepted)
    }
}
