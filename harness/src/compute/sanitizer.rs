//! Makes passes with violations fail, except for races that the test accepts.

use std::fmt;

use super::{After, Compute, ComputeError};
use crate::diagnostic::{Diagnostic, nearest};
use crate::dispatch::{Examined, Passes, Violation};
use crate::hazard::Kind;
use crate::interpret;
use crate::package::Package;
use crate::record::{Details, Replay};
use crate::run::Report;

/// The number of violations that a message shows in full. Several violations often have one cause.
const SHOWN: usize = 4;

#[derive(Clone, Debug)]
pub(super) struct Accepted {
    variable: String,
    /// `true` if the test accepts only writes of equal values.
    equal: bool,
    reason: String,
}

impl Accepted {
    fn covers(&self, race: &Violation) -> bool {
        // Only a race names a variable.
        let is_race = !race.variable.is_empty();
        let own = race.variable.rsplit("::").next() == Some(&self.variable);
        let named = own || race.variable == self.variable;
        is_race && named && (!self.equal || race.kind == Kind::EqualWrites)
    }
}

/// The sanitizer's findings in compute passes: races, missed barriers and wrong indices. See [`Violation`].
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
    /// The violations. If two accesses in the shader race on several elements, the list contains only one violation,
    /// with the first of these elements.
    pub all: Vec<Violation>,
    /// The command that checks the passes again.
    pub replay: Replay,
    messages: Vec<Diagnostic>,
}

impl Violations {
    pub(super) fn details(&self) -> Details {
        let first = &self.messages[0];
        let (violations, replay) = (self.all.clone(), Some(self.replay.clone()));
        Details { violations, replay, ..Details::of(&first.message).at(Some(first)) }
    }
}

impl fmt::Display for Violations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, message) in self.messages.iter().take(SHOWN).enumerate() {
            write!(f, "{}{message}", if at == 0 { "" } else { "\n\n" })?;
        }
        match self.messages.len().saturating_sub(SHOWN) {
            0 => {}
            1 => write!(f, "\n\n1 more violation in these passes")?,
            more => write!(f, "\n\n{more} more violations in these passes")?,
        }
        write!(f, "\n  replay: {}", self.replay)
    }
}

impl Compute<'_> {
    /// Declares that invocations may race on a variable, and gives the reason: for example, the algorithm works with
    /// any of the written values. If no invocations race on the variable, the test fails.
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

    /// Declares that several invocations may write the same value to one element of a variable, and gives the reason:
    /// for example, each invocation may set a flag. WGSL doesn't define the order of these writes. The test fails if
    /// there is any other race, or if no two invocations write the same value.
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
    /// Checks if a violation makes the test fail.
    pub(super) fn fails(&self, one: &Violation) -> bool {
        one.kind.fails() && !self.compute.accepted.iter().any(|accepted| accepted.covers(one))
    }

    /// Returns an error if the test accepts a race without a reason, or on an unknown variable.
    pub(super) fn expect_known_variables(&self, passes: &Passes) -> Result<(), ComputeError> {
        let accepted = &self.compute.accepted;
        if let Some(one) = accepted.iter().find(|one| one.reason.trim().is_empty()) {
            return Err(one.wrong("has no reason: say why the race is harmless".to_owned()));
        }
        let known = passes.variables();
        let is_known = |one: &&Accepted| {
            known.iter().any(|name| *name == one.variable || name.ends_with(&one.suffix()))
        };
        if let Some(one) = accepted.iter().find(|one| !is_known(one)) {
            let own = known.iter().map(|name| name.rsplit("::").next().unwrap_or(name));
            let near = nearest(&one.variable, own);
            let near = near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
            return Err(one.wrong(format!("names a variable that no pass uses{near}")));
        }
        Ok(())
    }

    /// Adds Tint's verdict to the violation for a missed barrier, if Tint is installed.
    pub(super) fn with_tint(&self, passes: &Passes, examined: Examined) -> Examined {
        with_tint(passes, self.compute.package, examined)
    }

    /// Returns an error if there is a violation that the test doesn't accept, or if the test accepts a race that
    /// doesn't occur. Also records how much of the passes the sanitizer checked.
    pub(super) fn expect_no_violations(
        &self,
        examined: Examined,
        report: &mut Report,
        replay: &Replay,
    ) -> Result<(), ComputeError> {
        let accepted = &self.compute.accepted;
        let Examined { violations, mut watched, .. } = examined;
        let is_met = |one: &&Accepted| violations.iter().any(|(race, _)| one.covers(race));
        let met = accepted.iter().filter(is_met);
        watched.accepted = met.map(|one| (one.variable.clone(), one.reason.clone())).collect();
        let whole = watched.reason.is_empty();
        report.watched = Some(watched);
        let unmet = accepted.iter().find(|one| !is_met(one));
        let (all, messages): (Vec<_>, Vec<_>) =
            violations.into_iter().filter(|(one, _)| self.fails(one)).unzip();
        if !all.is_empty() {
            let replay = replay.clone();
            return Err(ComputeError::Violations(Box::new(Violations { all, replay, messages })));
        }
        // If the sanitizer checked only a part of the passes, the accepted race may be in the other part.
        let Some(one) = unmet.filter(|_| whole) else { return Ok(()) };
        let what = if one.equal {
            "no two invocations write the same value to the variable"
        } else {
            "no invocations race on the variable"
        };
        Err(one.wrong(format!("isn't needed, because {what}: remove it")))
    }
}

/// The sanitizer's findings in the engine's usual order of invocations.
pub(super) fn examined(passes: &Passes, package: &Package) -> Examined {
    with_tint(passes, package, interpret::examine(passes))
}

fn with_tint(passes: &Passes, package: &Package, mut examined: Examined) -> Examined {
    for (violation, message) in &mut examined.violations {
        let of = passes.passes.iter().find(|pass| pass.name == violation.entry_point);
        if let (Kind::Barrier, Some(pass)) = (violation.kind, of) {
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
