//! The violations of passes fail them, but for races that are accepted.

use std::fmt;

use super::order::orders;
use super::{After, Compute, ComputeError};
use crate::diagnostic::{Diagnostic, nearest};
use crate::dispatch::{Examined, Passes, Violation, ViolationKind};
use crate::interpret::{self, OrderOf};
use crate::package::Package;
use crate::record::{Fault, Replay};
use crate::run::Report;

/// Orders in which accesses are looked at, too, by their numbers: backwards side by side; one after the other, forwards and
/// backwards; shuffled; and in turns.
const WATCHED: [u64; 5] = [0, 1, 2, 4, 5];

/// Messages that are shown whole. Several lines often have one cause.
const SHOWN: usize = 4;

/// Races that are meant.
#[derive(Clone, Debug)]
pub(super) struct Accepted {
    variable: String,
    /// True if only writes of one value are.
    equal: bool,
    reason: String,
}

impl Accepted {
    fn covers(&self, race: &Violation) -> bool {
        // Barriers and indices have no variable.
        let is_race = !race.variable.is_empty();
        let own = race.variable.rsplit("::").next() == Some(&self.variable);
        let named = own || race.variable == self.variable;
        is_race && named && (!self.equal || race.kind == ViolationKind::EqualWrites)
    }
}

/// Violations of WGSL's memory model and bounds by compute passes: see [`Violation`].
///
/// ```
/// use karat::compute::ComputeError;
/// # use karat::prelude::*;
///
/// let text = "@group(0) @binding(0) var<storage, read_write> data: array<u32>;
///             @compute @workgroup_size(4) fn sum(@builtin(local_invocation_index) i: u32) { data[0] += 1u + i; }";
/// let package = Package::from_source("m", text);
/// let passes = package.compute().with("data", Storage::new([0_u32])).dispatch("sum", [1, 1, 1]);
/// let wrong = passes.after("data").unrecorded().try_agrees_with([10_u32], Abs(0.0));
/// if let Err(ComputeError::Violations(found)) = &wrong {
///     for access in &found.all[0].accesses {
///         println!("{} {} at {}", access.invocation, access.does, access.place);
///     }
/// }
/// # assert!(matches!(wrong, Err(ComputeError::Violations(_))));
/// ```
#[derive(Clone, Debug)]
pub struct Violations {
    /// Each pair of accesses once, with the first element that has it.
    pub all: Vec<Violation>,
    /// The command that looks through the passes again.
    pub replay: Replay,
    messages: Vec<Diagnostic>,
}

impl Violations {
    pub(super) fn fault(&self) -> Fault {
        let first = &self.messages[0];
        let (violations, replay) = (self.all.clone(), Some(self.replay.clone()));
        Fault { violations, replay, ..Fault::of(&first.message).at(Some(first)) }
    }
}

impl fmt::Display for Violations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, message) in self.messages.iter().take(SHOWN).enumerate() {
            write!(f, "{}{message}", if at == 0 { "" } else { "\n\n" })?;
        }
        match self.messages.len().saturating_sub(SHOWN) {
            0 => {}
            1 => write!(f, "\n\n1 more violation of these passes")?,
            more => write!(f, "\n\n{more} more violations of these passes")?,
        }
        write!(f, "\n  replay: {}", self.replay)
    }
}

impl Compute<'_> {
    /// Declares that invocations race on a variable, and why that is meant: that the algorithm takes whichever value
    /// comes last, say. If there is no such race, the test fails.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "@group(0) @binding(0) var<storage, read_write> any: array<u32>;
    ///             @compute @workgroup_size(4) fn pick(@builtin(local_invocation_index) i: u32) { any[0] = 1u + i; }";
    /// let package = Package::from_source("m", text);
    /// let passes = package.compute().with("any", Storage::new([0_u32])).dispatch("pick", [1, 1, 1]);
    /// let passes = passes.accept_race("any", "whichever comes last will do");
    /// passes.after("any").satisfies("is one of them", |any: &[u32]| (1..=4).contains(&any[0]));
    /// ```
    pub fn accept_race(self, variable: &str, reason: &str) -> Self {
        self.accept(variable, reason, false)
    }

    /// Declares that several invocations write the same value to an element of a variable, and why that is meant: a
    /// flag that each of them may set. WGSL doesn't order these writes, either. Any other race still fails, and so
    /// does the test if there is no such write.
    ///
    /// ```
    /// # use karat::prelude::*;
    /// let text = "@group(0) @binding(0) var<storage, read_write> found: array<u32>;
    ///             @compute @workgroup_size(4) fn find(@builtin(local_invocation_index) i: u32) { found[0] = 1u; }";
    /// let package = Package::from_source("m", text);
    /// let passes = package.compute().with("found", Storage::new([0_u32])).dispatch("find", [1, 1, 1]);
    /// let passes = passes.accept_equal_writes("found", "a flag, which is only ever set");
    /// passes.after("found").agrees_with([1_u32], Abs(0.0));
    /// ```
    pub fn accept_equal_writes(self, variable: &str, reason: &str) -> Self {
        self.accept(variable, reason, true)
    }

    fn accept(mut self, variable: &str, reason: &str, equal: bool) -> Self {
        let (variable, reason) = (variable.to_owned(), reason.to_owned());
        self.accepted.push(Accepted { variable, equal, reason });
        self
    }
}

impl After<'_> {
    /// Has the sanitizer look through the passes for what no path's result would show for sure.
    pub(super) fn expect_no_violations(
        &self,
        passes: &Passes,
        report: &mut Report,
        replay: &Replay,
    ) -> Result<(), ComputeError> {
        let accepted = &self.compute.accepted;
        if let Some(one) = accepted.iter().find(|one| one.reason.trim().is_empty()) {
            return Err(one.wrong("has no reason: say why the race is meant".to_owned()));
        }
        let known = passes.variables();
        let is_known = |one: &&Accepted| {
            known.iter().any(|name| *name == one.variable || name.ends_with(&one.suffix()))
        };
        if let Some(one) = accepted.iter().find(|one| !is_known(one)) {
            let own = known.iter().map(|name| name.rsplit("::").next().unwrap_or(name));
            let near = nearest(&one.variable, own);
            let near = near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
            return Err(one.wrong(format!("names a variable that no pass has{near}")));
        }
        let mut examined = examined(passes, self.compute.package);
        // Data that come in another order may lead to an access that the usual one doesn't have.
        let orders_matter = passes.has_subgroups()
            || passes
                .passes
                .iter()
                .any(|pass| pass.program.reads_what_it_writes(&pass.entry_point));
        if examined.watched.reason.is_empty() && examined.watched.of > 1 && orders_matter {
            let orders = orders(&examined.watched);
            for number in WATCHED.into_iter().filter(|number| *number < orders) {
                interpret::examine_in(passes, &mut examined, OrderOf::whole(passes, number));
            }
        }
        let Examined { violations, mut watched, .. } = examined;
        let is_met = |one: &&Accepted| violations.iter().any(|(race, _)| one.covers(race));
        let met = accepted.iter().filter(is_met);
        watched.accepted = met.map(|one| (one.variable.clone(), one.reason.clone())).collect();
        let whole = watched.reason.is_empty();
        report.watched = Some(watched);
        let unmet = accepted.iter().find(|one| !is_met(one));
        let is_meant = |race: &Violation| accepted.iter().any(|one| one.covers(race));
        let (all, messages): (Vec<_>, Vec<_>) =
            violations.into_iter().filter(|(one, _)| one.kind.fails() && !is_meant(one)).unzip();
        if !all.is_empty() {
            let replay = replay.clone();
            return Err(ComputeError::Violations(Box::new(Violations { all, replay, messages })));
        }
        // Passes that weren't looked through whole may have the race elsewhere.
        let Some(one) = unmet.filter(|_| whole) else { return Ok(()) };
        let what =
            if one.equal { "no two invocations write one value there" } else { "there is none" };
        Err(one.wrong(format!("isn't needed, as {what}: remove it")))
    }
}

/// The findings in passes; at a barrier that some invocations miss with Tint's word, if it is here.
pub(super) fn examined(passes: &Passes, package: &Package) -> Examined {
    let mut examined = interpret::examine(passes);
    for (violation, message) in &mut examined.violations {
        let of = passes.passes.iter().find(|pass| pass.name == violation.entry_point);
        if let (ViolationKind::Barrier, Some(pass)) = (violation.kind, of) {
            let at: Vec<&str> = violation.accesses.iter().map(|one| &*one.place).collect();
            message.notes.extend(package.uniformity_by_tint(&pass.program, &at));
        }
    }
    examined
}

impl Accepted {
    fn suffix(&self) -> String {
        format!("::{}", self.variable)
    }

    fn wrong(&self, what: String) -> ComputeError {
        let verb = if self.equal { "accept_equal_writes" } else { "accept_race" };
        ComputeError::Accepted { verb, variable: self.variable.clone(), what }
    }
}
