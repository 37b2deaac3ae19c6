//! Reads tolerances: `4 ulp`, `rel 1e-4 or abs 1e-6`, `spec`, `spec or rel 1e-3`, `exact`.

use karat::unstable::tolerance::{Criterion, SpecTolerance};
use karat::{Abs, DeviceSpec, Rel, Spec, Tolerance, Ulp};

/// Reads a tolerance, or `spec`, which allows the errors that WGSL's specification allows.
pub(crate) fn criterion(text: &str) -> Result<Criterion, String> {
    let granting = |first: &str, rest: &str| -> Result<Option<SpecTolerance>, String> {
        let base = match first {
            "spec" => SpecTolerance::from(Spec),
            "device" => SpecTolerance::from(DeviceSpec),
            _ => return Ok(None),
        };
        let rest = rest.trim();
        if rest.is_empty() {
            return Ok(Some(base));
        }
        if let Some(need) = rest.strip_prefix("needing ") {
            let (need, otherwise) = need.split_once(" otherwise ").unwrap_or((need, ""));
            let need = tolerance(need)?;
            let base = if first == "spec" { Spec.needing(need) } else { DeviceSpec.needing(need) };
            return Ok(Some(match otherwise {
                "" => base,
                otherwise => base.or(tolerance(otherwise)?),
            }));
        }
        match rest.strip_prefix("or ") {
            Some(otherwise) => Ok(Some(base.or(tolerance(otherwise)?))),
            None => {
                Err(format!("`{text}` isn't a tolerance: write `or` or `needing` after `{first}`"))
            }
        }
    };
    let trimmed = text.trim();
    let (first, rest) = trimmed.split_once(' ').unwrap_or((trimmed, ""));
    match granting(first, rest)? {
        Some(granting) => Ok(granting.into()),
        None => match tolerance(text) {
            Ok(all) => Ok(all.into()),
            Err(wrong) if wrong == unknown(text) => Err(format!("{wrong}; or `spec`")),
            Err(wrong) => Err(wrong),
        },
    }
}

/// Reads a tolerance: bounds joined by `or`, or by `and`.
///
/// # Errors
/// Returns an error if the text isn't a tolerance.
pub fn tolerance(text: &str) -> Result<Tolerance, String> {
    let (words, or): (Vec<&str>, bool) = match (text.contains(" or "), text.contains(" and ")) {
        (true, true) => {
            return Err(format!("`{text}` mixes `or` with `and`: use only one of these words"));
        }
        (_, and) => (text.split(if and { " and " } else { " or " }).collect(), !and),
    };
    let mut bounds = words.into_iter().map(bound);
    let first = bounds.next().unwrap_or_else(|| Err("a tolerance is missing".to_owned()))?;
    bounds.try_fold(first, |all, next| Ok(if or { all.or(next?) } else { all.and(next?) }))
}

fn bound(text: &str) -> Result<Tolerance, String> {
    let words: Vec<&str> = text.split_whitespace().collect();
    if let [granted @ ("spec" | "device"), ..] = &*words {
        return Err(format!(
            "`{granted}` isn't a number, and this tolerance needs a number: `4 ulp`, `rel 1e-4`, `abs 1e-6` or \
             `exact`"
        ));
    }
    let (unit, number) = match &*words {
        ["exact"] => return Ok(Ulp(0.0).into()),
        [number, unit] if number.parse::<f64>().is_ok() => (*unit, *number),
        [unit, number] => (*unit, *number),
        _ => return Err(unknown(text)),
    };
    let number: f64 = number.parse().map_err(|_| unknown(text))?;
    if !(number.is_finite() && number >= 0.0) {
        return Err(format!("`{text}` isn't a bound: the number must be finite and at least 0"));
    }
    let bound: Tolerance = match unit {
        "ulp" => Ulp(number).into(),
        "rel" => Rel(number).into(),
        "abs" => Abs(number).into(),
        _ => return Err(unknown(text)),
    };
    let passes =
        |actual: f32, expected: f32| bound.measure(0, actual, f64::from(expected)).passes();
    let farthest = [(f32::MAX, f32::MIN), (f32::MIN, f32::from_bits(1))];
    match farthest.into_iter().all(|(actual, expected)| passes(actual, expected)) {
        true => Err(format!(
            "`{text}` accepts every result, because no two numbers differ by more than this bound"
        )),
        false => Ok(bound),
    }
}

fn unknown(text: &str) -> String {
    format!("`{text}` isn't a tolerance: write `4 ulp`, `rel 1e-4`, `abs 1e-6` or `exact`")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tolerances_read_as_they_are_shown() {
        for text in ["4 ulp", "rel 1e-4", "rel 1e-4 or abs 1e-6", "4 ulp and abs 1e-3"] {
            assert_eq!(tolerance(text).expect("a tolerance").to_string(), text);
        }
        assert_eq!(tolerance("1e-4 rel").expect("either order").to_string(), "rel 1e-4");
        assert_eq!(tolerance("exact").expect("0 ulp").to_string(), "0 ulp");
        for text in ["spec", "device", "spec or rel 1e-3", "spec needing rel 1e-2"] {
            criterion(text).unwrap_or_else(|error| panic!("{text}: {error}"));
        }
    }

    // Lesson 175
    #[test]
    fn tolerances_that_bound_nothing_are_refused() {
        for text in ["", "4", "ulp", "4 ulps", "nan ulp", "-1 abs", "inf rel", "spec 4 ulp"] {
            assert!(criterion(text).is_err(), "{text}");
        }
        // Each of these tolerances passes every result.
        for text in ["rel 1e300", "abs 1e39", "1e10 ulp", "spec or rel 1e300", "4 ulp or abs 1e300"]
        {
            assert!(criterion(text).expect_err(text).contains("accepts every result"), "{text}");
        }
        for text in ["rel 1e30", "abs 1e38", "1e9 ulp"] {
            assert!(criterion(text).is_ok(), "{text}");
        }
        assert!(tolerance("1 ulp or 2 ulp and 3 ulp").is_err());
    }
}
