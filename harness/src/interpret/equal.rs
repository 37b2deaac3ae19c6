//! Proves that two functions are equal: no test can distinguish equal functions.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};

use karat_engine::{Interval, Intervals, Lanes, Observer, Settings, Site, Truth};

use super::{Interpreted, author_of, lowered};
use crate::fixture::Fixtures;
use crate::package::asserts::ASSERTED;
use crate::probe::Probed;
use crate::value::Scalar;

/// Checks if two functions are provably equal. The engine folds constants, merges operations that are equal by an
/// identity (`x * 2` and `x + x`), and removes unused operations. If both functions then have the same operations, they
/// are equal. `false` proves nothing.
pub fn is_same(functions: [&Probed; 2]) -> bool {
    if functions.iter().any(|probed| probed.function().form.alone) {
        return false;
    }
    // An assertion may read values that no result needs.
    let settings = Settings { identities: true, named: &[ASSERTED], ..Settings::default() };
    match functions.map(|probed| lowered(probed, &settings)) {
        [Ok(a), Ok(b)] => a.is_same(&b),
        _ => false,
    }
}

/// A guard in a source file, such as `max(x, 0.0)`, and the argument that remains (`x`) if you remove the guard.
pub struct Guard<'g> {
    /// The byte offset of the guard in the source text.
    pub at: usize,
    /// The text of the guard.
    pub text: &'g str,
    /// The text of the argument that remains.
    pub argument: &'g str,
}

/// Watches the guard's operation during a run with intervals. `seen` has two flags: the guard ran, and the guard may
/// have changed its first operand.
struct Guarded<'g> {
    sites: BTreeSet<usize>,
    acts: &'g (dyn Fn(&[Interval]) -> bool + Sync),
    seen: Mutex<(bool, bool)>,
}

impl Observer<Intervals> for Guarded<'_> {
    fn floats(&self, lanes: &Lanes<'_, Intervals>) {
        if !self.sites.contains(&lanes.site.number) {
            return;
        }
        let mut seen = self.seen.lock().unwrap_or_else(PoisonError::into_inner);
        for lane in (0..lanes.active.len()).filter(|lane| lanes.active[*lane] != Truth::False) {
            let operands: Vec<Interval> = lanes.operands.iter().map(|all| all[lane]).collect();
            seen.0 = true;
            seen.1 |= lanes.floats.len() != 1
                || !operands.iter().all(|one| one.is_bounded())
                || (self.acts)(&operands);
        }
    }
}

/// Checks if a guard in a function never changes a value. The engine runs the function once, with an interval for each
/// argument, and checks that the guarded value is already within the guard's bounds. Returns `false` if the function
/// has float arguments, because these may be NaN or infinite, and then the guard acts. If this returns `true`, any
/// implementation of WGSL returns the same without the guard, except for the sign of a zero, which WGSL lets
/// implementations ignore.
pub fn never_acts(probed: &Probed, guard: &Guard<'_>) -> bool {
    let function = probed.function();
    let name = guard.text.split('(').next().unwrap_or_default().trim();
    let inside = guard.text.trim_start_matches(|c| c != '(').trim_start_matches(['(', ' ']);
    let acts: &(dyn Fn(&[Interval]) -> bool + Sync) = match name {
        "max" => &|of| !matches!(of, [x, least] if x.lo() >= least.hi()),
        "min" => &|of| !matches!(of, [x, most] if x.hi() <= most.lo()),
        "clamp" => {
            &|of| !matches!(of, [x, least, most] if x.lo() >= least.hi() && x.hi() <= most.lo())
        }
        "saturate" => &|of| !matches!(of, [x] if x.lo() >= 0.0 && x.hi() <= 1.0),
        "abs" => &|of| !matches!(of, [x] if x.lo() >= 0.0),
        _ => return false,
    };
    let lanes: Vec<Scalar> =
        function.parameters.iter().flat_map(|(_, shape)| shape.lanes()).collect();
    if !inside.starts_with(guard.argument)
        || !is_closed(probed)
        || lanes.iter().any(|scalar| scalar.is_float())
    {
        return false;
    }
    let Ok(own) = Interpreted::new(probed, &Fixtures::new()) else { return false };
    let is_it = |site: &&Site| {
        author_of(&probed.program, site)
            .is_some_and(|(span, text)| span.written().1.start == guard.at && text == guard.text)
    };
    let sites = own.lowered.sites().iter().filter(is_it).map(|site| site.number).collect();
    let guarded = Guarded { sites, acts, seen: Mutex::default() };
    let ends = |low: bool| -> Vec<u32> {
        let end = |scalar: &Scalar| match (scalar, low) {
            (Scalar::I32, true) => i32::MIN.cast_unsigned(),
            (Scalar::I32, false) => i32::MAX.cast_unsigned(),
            (Scalar::U32, false) => u32::MAX,
            (_, low) => u32::from(!low && *scalar == Scalar::Bool),
        };
        lanes.iter().map(end).collect()
    };
    let (from, to) = (ends(true), ends(false));
    let ran = own.watched_between([&from, &to], &guarded);
    let (came, acts) = guarded.seen.into_inner().unwrap_or_else(PoisonError::into_inner);
    ran && came && !acts
}

/// Checks if a function depends only on its arguments, and has no other effect than its result.
fn is_closed(probed: &Probed) -> bool {
    let Probed { program, function, .. } = probed;
    let form = &function.form;
    let reads = function.bindings.len() + form.taken.len() + form.builtins.len();
    let is_alone = form.fragment || program.uses_variables(&function.name);
    reads == 0 && !is_alone && program.module().overrides.is_empty()
}

/// The largest number of inputs that Karat tries one by one. The engine needs some seconds for this number.
const ALL_INPUTS: usize = 1 << 24;

/// Calls two functions with all inputs. Returns the number of inputs if both functions return the same bits for each
/// input, where all NaN are equal. Returns `None` if a result differs, or if there are more than 2^24 inputs. Also
/// returns `None` for functions with 32-bit arguments, which have too many values, and for functions that read
/// resources or overrides, because these would be further inputs.
pub fn agree_everywhere(functions: [&Probed; 2]) -> Option<usize> {
    let lanes = functions.map(|probed| {
        let of = probed.function().parameters.iter().flat_map(|(_, shape)| shape.lanes());
        of.collect::<Vec<_>>()
    });
    let [own, other] = &lanes;
    if own != other || !functions.into_iter().all(is_closed) {
        return None;
    }
    let mut count = 1_usize;
    for lane in own {
        count = count.checked_mul(inputs_of(*lane)?).filter(|count| *count <= ALL_INPUTS)?;
    }
    let [original, changed] =
        functions.map(|probed| Interpreted::new(probed, &Fixtures::new()).ok());
    let (original, changed) = (original?, changed?);
    if original.results != changed.results {
        return None;
    }
    let firsts = (0..count).step_by(BATCH_OF_ALL);
    let agree = |first: usize| -> Option<bool> {
        let cases = BATCH_OF_ALL.min(count - first);
        let rows: Vec<u32> =
            (first..first + cases).flat_map(|at| row_of(own, at).collect::<Vec<_>>()).collect();
        let [a, b] = [&original, &changed].map(|one| one.words(cases, &rows).ok());
        let (a, b) = (a?, b?);
        let mut each = a.iter().zip(&b).zip(original.results.iter().cycle());
        Some(each.all(|((a, b), scalar)| {
            let is_nan = |word: &u32| f32::from_bits(*word).is_nan();
            a == b || (scalar.is_float() && is_nan(a) && is_nan(b))
        }))
    };
    firsts.map(agree).all(|agrees| agrees == Some(true)).then_some(count)
}

/// The number of cases to run at once. Memory then holds the arguments and results of only these cases.
const BATCH_OF_ALL: usize = 1 << 16;

/// The number of values of a scalar type. Returns `None` for types with more than 2^16 values.
fn inputs_of(scalar: Scalar) -> Option<usize> {
    match scalar {
        Scalar::Bool => Some(2),
        Scalar::F16 => Some(1 << 16),
        Scalar::F32 | Scalar::I32 | Scalar::U32 => None,
    }
}

/// The arguments with the index `at` in the list of all possible arguments.
fn row_of(lanes: &[Scalar], at: usize) -> impl Iterator<Item = u32> {
    let mut rest = at;
    lanes.iter().map(move |lane| {
        let values = inputs_of(*lane).unwrap_or(1);
        let own = rest % values;
        rest /= values;
        match lane {
            Scalar::F16 => half::f16::from_bits(own as u16).to_f32().to_bits(),
            _ => own as u32,
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::package::Package;

    fn agree(texts: [&str; 2]) -> Option<usize> {
        let [a, b] = texts.map(|text| {
            let package = Package::from_source("m", format!("enable f16;\n{text}"));
            Probed::new(&package, "f").expect("it is valid")
        });
        agree_everywhere([&a, &b])
    }

    /// Two functions differ if they return different bits for at least one input. All NaN count as equal.
    #[test]
    fn functions_of_16_bits_are_compared_for_all_inputs() {
        let of = |body: &str| format!("fn f(x: f16) -> f16 {{ return {body}; }}");
        let all = |a: &str, b: &str| agree([&of(a), &of(b)]);
        assert_eq!(all("x + x", "2.0h * x"), Some(1 << 16));
        assert_eq!(all("max(x * x, -1.0h)", "x * x"), None, "the square of a NaN is no number");
        assert_eq!(all("select(x, 0.0h, x == 0.5h)", "x"), None);
        // A private variable may have any initial value, and its final value is visible.
        let left = |by: &str| {
            format!("var<private> n = 0; fn f(x: bool) -> bool {{ n += {by}; return x; }}")
        };
        assert_eq!(agree([&left("1"), &left("2")]), None);
        // Functions of 32-bit numbers have too many inputs to try. Functions with overrides aren't tried, either.
        let text = "fn f(x: f32) -> f32 { return x; }";
        assert_eq!(agree([text, text]), None);
        let text = "override N = 1.0; fn f(x: bool) -> f32 { return select(N, 0.0, x); }";
        assert_eq!(agree([text, text]), None);
    }
}
