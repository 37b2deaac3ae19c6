//! The notes below a failing case: which results WGSL allows, and which operation on the path first returned a
//! value outside of WGSL's bounds.

use std::borrow::Cow;

use super::CaseFailure;
use super::session::{Explained, Session};
use crate::diagnostic::one_line;
use crate::executor::Caller;
use crate::interpret::hazards::first_not_finite;
use crate::interpret::{Bound, Interpreted};
use crate::probe::lets;
use crate::value::{Scalar, format_f32};

impl Session<'_> {
    /// Adds notes to a failing case about the results that WGSL allows. Adds nothing if the engine can't
    /// execute the function.
    pub(super) fn explain(&self, failure: &mut CaseFailure, row: &[u32]) {
        match self.asserted.explained {
            Explained::Nothing => {}
            Explained::ByBounds => {
                if let Ok(explanation) = self.explanation(failure, row) {
                    failure.explanation = explanation;
                }
            }
            Explained::ByHazards(kinds) => {
                failure.explanation = self.hazards_of(row, kinds);
                return;
            }
        }
        failure.explanation.extend(self.first_not_finite(row));
    }

    /// Finds the first operation that returned NaN or an infinity. A later operation, such as a clamp, may have
    /// turned this value into a finite number.
    fn first_not_finite(&self, row: &[u32]) -> Option<(&'static str, String)> {
        let mut found = self.witness().ok()?.hazards_but(1, row, &|_| true).ok()?;
        first_not_finite(found.cases.pop()?.iter())
    }

    fn explanation(
        &self,
        failure: &CaseFailure,
        row: &[u32],
    ) -> Result<Vec<(&'static str, String)>, crate::probe::ProbeError> {
        let Some(expected) = failure.expected else { return Ok(Vec::new()) };
        if !failure.scalar.is_float() || failure.integral.is_some() || row.is_empty() {
            return Ok(Vec::new());
        }
        let witness = self.witness()?;
        let bounds = witness.bounds(1, row)?;
        let (Some(bound), Some(shadow)) =
            (bounds.get(failure.lane), witness.shadow(1, row)?.get(failure.lane).copied())
        else {
            return Ok(Vec::new());
        };
        let mut lines = vec![("in f64", format!("{shadow}"))];
        let Some((least, most)) = bound.ends() else {
            let cause = witness.cause(bound);
            let cause = cause.map_or_else(String::new, |(span, text)| {
                let text = one_line(&text);
                match bound.is_reordered() {
                    true => format!(
                        ": as written, `{text}` ({span}) has bounds, but WGSL (15.7.5) also allows \
                         another order of the operations, which overflows or divides by a value too near to 0"
                    ),
                    false => format!(": no bounds exist for `{text}` ({span})"),
                }
            });
            lines.push(("WGSL", format!("allows anything{cause}")));
            return Ok(lines);
        };
        let actual = f64::from(f32::from_bits(failure.actual));
        let inside = |x: f64| least <= x && x <= most;
        let allowed = bound.allows(actual);
        let said = match (allowed, inside(expected)) {
            (true, true) => "; the test's tolerance is stricter than WGSL's bounds",
            (true, false) => {
                "; the reference isn't in this range: this code computes something else"
            }
            (false, true) => "; this path's result isn't allowed",
            (false, false) => "; the result and the reference aren't allowed",
        };
        let width = width(least, most);
        lines.push(("WGSL", format!("allows {}{width}{said}", interval(bound))));
        if !allowed && let Some(blame) = self.blame(&witness, row) {
            lines.push(("blame", blame));
        }
        Ok(lines)
    }

    /// Describes the first `let` whose value on this path is outside of WGSL's bounds. If all `let` values are inside,
    /// says that only the returned value is outside.
    fn blame(&self, witness: &Interpreted, row: &[u32]) -> Option<String> {
        for one in lets(&self.called.probed) {
            let Some(probed) = &one.probed else { continue };
            let fixtures = self.fixtures;
            let Ok(bounded) = Interpreted::new(probed, fixtures) else { continue };
            let Ok(bounds) = bounded.bounds(1, row) else { continue };
            let caller = Caller::new(self.executor, Cow::Borrowed(probed), fixtures, 1);
            let Ok(words) = caller.and_then(|caller| caller.results(row, 1)) else { continue };
            let scalars = probed.function().result.lanes();
            let left = |((scalar, word), bound): ((&Scalar, &u32), &Bound)| {
                let value = scalar.decode(*word);
                (!bound.allows(value)).then(|| (shown(*scalar, *word), *bound))
            };
            let found = scalars.iter().zip(&words).zip(&bounds).find_map(left);
            if let Some((value, bound)) = found {
                let place = one.span.map_or_else(String::new, |span| format!(" ({span})"));
                let allowed = interval(&bound);
                let last = if one.repeats { ", in the last iteration of a loop" } else { "" };
                return Some(format!(
                    "`{}`{place} is the first value outside of WGSL's bounds{last}: {value}, allowed {allowed}",
                    one.name
                ));
            }
        }
        let place = &witness.place();
        Some(format!(
            "all let-bindings are within WGSL's bounds, but `{}` returns a value outside of these bounds ({place})",
            self.called.function().name
        ))
    }
}

fn interval(bound: &Bound) -> String {
    match bound.ends() {
        None => "anything".to_owned(),
        Some((least, most)) if least == most => number(least),
        Some((least, most)) => format!("{} to {}", number(least), number(most)),
    }
}

/// The width of an interval as text, in ulp of `f32` at the end that is farther from 0.
fn width(least: f64, most: f64) -> String {
    let largest = number_of(least.abs().max(most.abs()));
    let step = f64::from(largest.next_up()) - f64::from(largest);
    let width = (most - least) / step;
    if width > 0.0 { format!(" ({width:.0} ulp)") } else { String::new() }
}

#[expect(clippy::cast_possible_truncation, reason = "ends of intervals are f32")]
fn number_of(value: f64) -> f32 {
    value as f32
}

fn number(value: f64) -> String {
    format_f32(number_of(value))
}

fn shown(scalar: Scalar, word: u32) -> String {
    crate::value::format_lane(scalar, word)
}
