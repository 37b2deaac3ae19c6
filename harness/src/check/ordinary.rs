//! Common verbs: results are finite, lie in a range, or agree with another function.

use std::ops::{Bound, RangeBounds};

use super::agreement::Expected;
use super::batch::Rows;
use super::demand::Demand;
use super::plan::Plan;
use super::session::{Asserted, Session};
use super::statement::{Beyond, Holds};
use super::{Agreement, Calls, Check, Failure, Mismatch, Vacuous};
use crate::diagnostic::Span;
use crate::domain::Stream;
use crate::fixture::Fixtures;
use crate::interpret::{Bound as Allowed, Interpreted};
use crate::probe::{ProbeError, Probed};
use crate::reflect::{Function, Program};
use crate::run::or_panic;
use crate::tolerance::Criterion;
use crate::value::{Scalar, Shape};

type Bounds = (Bound<f64>, Bound<f64>);

/// Describes a range as a statement: `lies in 0..=1`, `lies in 0..<1`, `is at least 0`.
fn shown(range: Bounds) -> String {
    let least = match range.0 {
        Bound::Included(least) => Some(format!("at least {least}")),
        Bound::Excluded(least) => Some(format!("above {least}")),
        Bound::Unbounded => None,
    };
    let most = match range.1 {
        Bound::Included(most) => Some(format!("at most {most}")),
        Bound::Excluded(most) => Some(format!("below {most}")),
        Bound::Unbounded => None,
    };
    match range {
        (Bound::Included(least), Bound::Included(most)) => format!("lies in {least}..={most}"),
        (Bound::Included(least), Bound::Excluded(most)) => format!("lies in {least}..<{most}"),
        _ => {
            let both: Vec<String> = least.into_iter().chain(most).collect();
            format!(
                "is {}",
                if both.is_empty() { "anything".to_owned() } else { both.join(" and ") }
            )
        }
    }
}

/// Returns the smallest distance between a number in the result and an excluded end of its range. `range` applies to
/// integers, `of_floats` to floats.
fn distance([range, of_floats]: [Bounds; 2], lanes: &[Scalar], words: &[u32]) -> f64 {
    let to = |end: Bound<f64>, value: f64, sign: f64| match end {
        Bound::Excluded(end) => sign * (end - value),
        _ => f64::INFINITY,
    };
    let numbers = lanes.iter().zip(words).filter(|(lane, _)| **lane != Scalar::Bool);
    let each = numbers.map(|(lane, word)| {
        let (least, most) = if lane.is_float() { of_floats } else { range };
        let x = lane.decode(*word);
        to(least, x, -1.0).min(to(most, x, 1.0))
    });
    each.fold(f64::INFINITY, f64::min)
}

/// Checks if some number lies in the range, and some finite number lies outside.
fn is_some_and_not_all(range: Bounds) -> bool {
    let is_open = |end: Bound<f64>, infinity: f64| match end {
        Bound::Included(end) | Bound::Excluded(end) => end == infinity,
        Bound::Unbounded => true,
    };
    if is_open(range.0, f64::NEG_INFINITY) && is_open(range.1, f64::INFINITY) {
        return false;
    }
    match range {
        (Bound::Unbounded, Bound::Unbounded) => false,
        (Bound::Unbounded, Bound::Included(one) | Bound::Excluded(one))
        | (Bound::Included(one) | Bound::Excluded(one), Bound::Unbounded) => !one.is_nan(),
        (Bound::Included(least), Bound::Included(most)) => least <= most,
        (
            Bound::Included(least) | Bound::Excluded(least),
            Bound::Included(most) | Bound::Excluded(most),
        ) => least < most,
    }
}

impl<V> Check<'_, Calls<V>> {
    /// Checks that no component of a result is NaN or infinite.
    ///
    /// A wrong finite number passes this check. [`has_no_hazards`](Self::has_no_hazards) also finds
    /// intermediate values that aren't finite, even if a later `max` hides them from the result.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS.function("geometry::basis").over(UnitVector).is_finite();
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if a result isn't finite, if the function returns no float, or if nothing
    /// could be checked.
    #[track_caller]
    pub fn is_finite(self) -> Agreement {
        or_panic(self.try_is_finite())
    }

    /// Runs [`is_finite`](Self::is_finite), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if a result isn't finite, if the function returns no float, or if nothing could be checked.
    pub fn try_is_finite(self) -> Result<Agreement, Failure> {
        self.plan.is_finite(&*self.stream, &self.demand())
    }

    /// Checks that each number in a result lies in a range: `0.0..=1.0`, `0.0..1.0` (without 1.0), or `0.0..`.
    ///
    /// For floats, Karat rounds each end of the range to the nearest `f32`. NaN and infinite results fail.
    ///
    /// Karat also computes the results that WGSL allows for all arguments of the domain. If all these results lie in
    /// the range, the statement is [`proved`](Agreement::proved). Otherwise, if the range excludes an end, Karat
    /// searches for failing arguments. The search begins at the cases with results nearest to an excluded end.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS.function("fresnel::schlick").over((UnitRgb, 0.0..=1.0)).stays_within(0.0..=1.0);
    /// // 1.0 is excluded, so `hash * length` is a valid index of an array.
    /// SHADERS.function("noise::hash").over(-8.0..=8.0).stays_within(0.0..1.0);
    /// ```
    ///
    /// # Panics
    /// Panics with the [`Failure`] if a number lies outside the range, if the range contains no number, or if nothing
    /// could be checked.
    #[track_caller]
    pub fn stays_within(self, range: impl RangeBounds<f64>) -> Agreement {
        or_panic(self.try_stays_within(range))
    }

    /// Runs [`stays_within`](Self::stays_within), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if a number lies outside the range, if the range contains no number, or if nothing could be
    /// checked.
    pub fn try_stays_within(self, range: impl RangeBounds<f64>) -> Result<Agreement, Failure> {
        let range = (range.start_bound().cloned(), range.end_bound().cloned());
        self.plan.stays_within(&*self.stream, &self.demand(), range)
    }

    /// Checks that the function agrees with a reference function of its package that takes the same arguments,
    /// such as a slower or older version. Karat's engine executes the reference function in `f64`, with the
    /// fixtures of the tested function.
    ///
    /// ```no_run
    /// # use karat::prelude::*;
    /// # static SHADERS: Package = karat::package!("shaders");
    /// SHADERS.function("tone::fast").over(0.0..=16.0).agrees_with_function("tone::exact", Rel(1e-3));
    /// ```
    ///
    /// If the tested function's package [depends on](crate::Package::depends_on) another package, the reference
    /// function can also come from that package. Then write the reference function's name as in an import:
    /// `shaders::tone::exact`. If both functions have the same mistake, the check passes.
    ///
    /// # Panics
    /// Panics with the [`Failure`] if the functions disagree in a case, if the engine can't execute the reference
    /// function, or if nothing could be compared.
    #[track_caller]
    pub fn agrees_with_function(
        self,
        reference: &str,
        tolerance: impl Into<Criterion>,
    ) -> Agreement {
        or_panic(self.try_agrees_with_function(reference, tolerance))
    }

    /// Runs [`agrees_with_function`](Self::agrees_with_function), but returns the failure instead of panicking.
    ///
    /// # Errors
    /// Returns the failure if the functions disagree in a case, if the engine can't execute the reference function, or
    /// if nothing could be compared.
    pub fn try_agrees_with_function(
        self,
        reference: &str,
        tolerance: impl Into<Criterion>,
    ) -> Result<Agreement, Failure> {
        let (stream, demand) = (&*self.stream, &self.demand());
        self.plan.agrees_with_function(stream, demand, reference, &tolerance.into())
    }
}

impl Plan<'_> {
    /// The tested function. If the function writes resources, its result also contains the contents of these resources.
    pub(super) fn function(&self) -> Result<Function, Failure> {
        let probe = &self.probe;
        let mut probed = Probed::in_valid(probe.package, &probe.name, &probe.overrides)?;
        probed.fit(&probe.fixtures)?;
        Ok(probed.function)
    }

    /// Calls `then` with the value in `begun`. If `begun` is an error, the check fails with this error, and Karat
    /// writes a record.
    pub(super) fn with<T>(
        &self,
        begun: Result<T, Failure>,
        (check, text): (&'static str, &str),
        (stream, demand): (&dyn Stream, &Demand),
        then: impl FnOnce(T) -> Result<Agreement, Failure>,
    ) -> Result<Agreement, Failure> {
        let error = match begun {
            Ok(begun) => return then(begun),
            Err(error) => error,
        };
        let asserted = Asserted::new(check, text.to_owned());
        let mut error = Some(error);
        let nothing = &mut |session: &Session<'_>| session.called.vacuous(Vacuous::NoCases);
        self.conclude_as(&asserted, stream, demand, nothing, &mut |otherwise, _| {
            error.take().map_or(otherwise, Err)
        })
    }

    pub(super) fn is_finite(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
    ) -> Result<Agreement, Failure> {
        let statement = "no result is NaN or infinite";
        let suited =
            |function: Function| match function.result.lanes().iter().any(|lane| lane.is_float()) {
                true => Ok(function),
                false => Err(unsuited(
                    &function,
                    "and this type is always finite, so the check can't fail",
                )),
            };
        let begun = self.function().and_then(suited);
        let asserted = ("is_finite", statement);
        self.with(begun, asserted, (stream, demand), |function| {
            // A result that isn't finite fails every statement, so this closure can always return `true`.
            let holds = |_: &[u32], _: &[u32]| true;
            self.states(stream, demand, asserted, (&function.result, &holds))
        })
    }

    pub(super) fn stays_within(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
        range: Bounds,
    ) -> Result<Agreement, Failure> {
        let (statement, unsuited_range) = (shown(range), Mismatch::Range(shown(range)));
        // No `f32` equals 2 pi. A bound of 2 pi means the nearest `f32`.
        #[expect(clippy::cast_possible_truncation, reason = "the nearest is meant")]
        let nearest = |bound: Bound<f64>| bound.map(|bound| f64::from(bound as f32));
        let of_floats = (nearest(range.0), nearest(range.1));
        let suited = |function: Function| {
            if !is_some_and_not_all(range) || !is_some_and_not_all(of_floats) {
                return Err(unsuited_range.of(&function));
            }
            if function.result.lanes().iter().all(|lane| *lane == Scalar::Bool) {
                return Err(unsuited(&function, "but this check needs a number"));
            }
            // Checks if the range contains every value of the integer type.
            let both = |least: f64, most: f64| range.contains(&least) && range.contains(&most);
            let holds_all = |lane: &Scalar| match lane {
                Scalar::U32 => both(0.0, f64::from(u32::MAX)),
                Scalar::I32 => both(f64::from(i32::MIN), f64::from(i32::MAX)),
                Scalar::Bool => true,
                Scalar::F32 | Scalar::F16 => false,
            };
            if function.result.lanes().iter().all(holds_all) {
                return Err(unsuited_range.of(&function));
            }
            Ok(function)
        };
        let begun = self.function().and_then(suited);
        let asserted = ("stays_within", &*statement);
        self.with(begun, asserted, (stream, demand), |function| {
            let lanes = function.result.lanes();
            let holds = |_: &[u32], words: &[u32]| {
                let mut numbers =
                    lanes.iter().zip(words).filter(|(lane, _)| **lane != Scalar::Bool);
                numbers.all(|(lane, word)| match lane.is_float() {
                    true => of_floats.contains(&lane.decode(*word)),
                    false => range.contains(&lane.decode(*word)),
                })
            };
            let distance = |words: &[u32]| distance([range, of_floats], &lanes, words);
            let is_within = |bounds: &[Allowed]| {
                bounds.len() == lanes.len()
                    && lanes.iter().zip(bounds).all(|(lane, bound)| {
                        let within = if lane.is_float() { of_floats } else { range };
                        let is_inside = |(least, most): (f64, f64)| {
                            within.contains(&least) && within.contains(&most)
                        };
                        *lane == Scalar::Bool || bound.ends().is_some_and(is_inside)
                    })
            };
            // Rounding may reach an excluded end that exact results only approach.
            let is_half_open =
                [range.0, range.1].iter().any(|end| matches!(end, Bound::Excluded(_)));
            let distance = is_half_open.then_some(&distance as _);
            let beyond = Beyond { distance, holds: &is_within };
            let said: (&Shape, Holds<'_>) = (&function.result, &holds);
            self.states_beyond(stream, demand, asserted, said, Some(&beyond))
        })
    }

    pub(super) fn agrees_with_function(
        &self,
        stream: &dyn Stream,
        demand: &Demand,
        reference: &str,
        criterion: &Criterion,
    ) -> Result<Agreement, Failure> {
        let asserted = ("agrees_with", &*criterion.to_string());
        let begun = self.shadow(demand, reference).and_then(|shadow| {
            let own = self.function()?;
            // With `Spec`, a function may be its own reference, because the check tests the driver.
            let declared = |span: &Span| (span.file.name.clone(), span.range.clone());
            let itself = declared(&own.span) == declared(&shadow.span)
                && matches!(criterion, Criterion::Within(_));
            if itself { Err(Mismatch::Itself.of(&own)) } else { Ok(shadow) }
        });
        self.with(begun, asserted, (stream, demand), |shadow| {
            let Shadow { shape, interpreted, kept, .. } = shadow;
            let expect = |rows: Rows<'_>, lanes: &mut Vec<f64>| {
                // If the values are NaN, the check reports an error of the reference.
                let none = || vec![f64::NAN; rows.len() * shape.lanes().len()];
                let taken: Vec<u32>;
                let words = match &kept {
                    Some(kept) => {
                        // The reference takes fewer components than Karat samples.
                        let kept = |row: &'_ [u32]| -> Vec<u32> {
                            kept.iter().map(|lane| row[*lane]).collect()
                        };
                        taken = rows.iter().flat_map(kept).collect();
                        &*taken
                    }
                    None => rows.words(),
                };
                // If a loop of the reference doesn't end for one case, the whole batch has no values.
                lanes.extend(interpreted.shadow(rows.len(), words).unwrap_or_else(|_| none()));
            };
            let expected = Expected { shape: shape.clone(), expect: &expect };
            self.agrees(stream, demand, &expected, criterion)
        })
    }

    fn shadow(&self, demand: &Demand, reference: &str) -> Result<Shadow, Failure> {
        let probe = &self.probe;
        // The reference function gets only the overrides that it declares. The tested function may use more
        // overrides.
        let program = Program::of_function(probe.package, reference).map_err(ProbeError::from)?;
        let used = probe.overrides.iter().filter(|(name, _)| program.has_override(name));
        let overrides = used.map(|(name, value)| (name.clone(), *value)).collect();
        let probed = Probed::in_valid(probe.package, reference, &overrides)?;
        let drawn = &*demand.arguments;
        let mut probed = probed.with_quads_of(drawn);
        let taken: Vec<Shape> =
            probed.function.parameters.iter().map(|(_, shape)| shape.clone()).collect();
        // If the reference takes no derivative, it gets only the pixel's own value, not the whole quad's.
        let fits = |(own, drawn): (&Shape, &Shape)| {
            drawn.stands_for(own, false)
                || drawn.quad().is_some_and(|value| value.stands_for(own, false))
        };
        if taken.len() != drawn.len() || !taken.iter().zip(drawn).all(fits) {
            let (supplied, who) = (drawn.to_vec(), demand.who);
            let mismatch = Mismatch::Arguments { declared: taken, supplied, who };
            return Err(mismatch.of(&probed.function));
        }
        // The reference gets only the fixtures that it reads.
        let bindings = &probed.function.bindings;
        let read = |(name, _): &&(String, _)| bindings.iter().any(|b| b.name() == name);
        let mut fixtures: Fixtures = probe.fixtures.iter().filter(read).cloned().collect();
        // Finds textures in parameters by the reference's parameter names, or else by their order.
        let own = self.function()?.form.taken;
        let theirs = &probed.function.form.taken;
        let given = |name: &str| probe.fixtures.iter().rev().find(|(known, _)| known == name);
        if theirs.iter().any(|(_, name, _)| given(name).is_none()) {
            for ((_, theirs, _), (_, ours, _)) in theirs.iter().zip(&own) {
                if let Some((_, fixture)) = given(ours) {
                    fixtures.push((theirs.clone(), fixture.clone()));
                }
            }
        }
        probed.fit(&fixtures)?;
        let shape = probed.function.result.clone();
        let interpreted = Interpreted::new(&probed, &fixtures).map_err(Failure::from)?;
        let mut first = 0;
        let kept: Vec<usize> = taken
            .iter()
            .zip(drawn)
            .flat_map(|(own, drawn)| {
                let from = first;
                first += drawn.lanes().len();
                from..from + own.lanes().len()
            })
            .collect();
        let span = probed.function.span.clone();
        Ok(Shadow { span, shape, interpreted, kept: (kept.len() < first).then_some(kept) })
    }
}

/// A reference function in WGSL that the engine executes in `f64`.
struct Shadow {
    span: Span,
    shape: Shape,
    interpreted: Interpreted,
    /// The indices of the argument components that the reference takes. `None` if the reference takes all components.
    kept: Option<Vec<usize>>,
}

pub(super) fn unsuited(function: &Function, wanted: &'static str) -> Failure {
    Mismatch::Unsuited { result: function.result.clone(), wanted }.of(function)
}

#[cfg(test)]
mod tests {
    use super::*;

    const OPEN: Bounds = (Bound::Excluded(0.0), Bound::Excluded(1.0));
    const BELOW: Bounds = (Bound::Included(0.0), Bound::Excluded(8.0));

    /// If the range excludes both ends, `distance` returns the distance to the nearer end.
    #[test]
    fn distances_are_measured_to_the_nearest_excluded_end() {
        let of = |ranges: [Bounds; 2], lanes: &[(Scalar, u32)]| {
            let (scalars, words): (Vec<_>, Vec<_>) = lanes.iter().copied().unzip();
            distance(ranges, &scalars, &words)
        };
        let single = |x: f32| (Scalar::F32, x.to_bits());
        let float = |x: f32| of([BELOW, OPEN], &[single(x)]);
        assert_eq!([float(0.25), float(0.75), float(0.0), float(1.0)], [0.25, 0.25, 0.0, 0.0]);
        assert_eq!([float(-0.5), float(1.5)], [-0.5; 2], "beyond an end");
        let above = (Bound::Excluded(2.0), Bound::Unbounded);
        assert_eq!(of([above; 2], &[single(7.0)]), 5.0);
        assert_eq!(of([above; 2], &[(Scalar::I32, (-7_i32).cast_unsigned())]), -9.0);
        // The range for integers differs from the range for floats. The smallest distance of all components counts.
        assert_eq!(of([BELOW, OPEN], &[(Scalar::U32, 3)]), 5.0);
        assert_eq!(of([BELOW, OPEN], &[(Scalar::U32, 3), single(0.5)]), 0.5);
        assert_eq!(of([OPEN, BELOW], &[single(0.5), single(7.0)]), 1.0);
        // For included ends and for booleans, the distance is infinite.
        let closed = (Bound::Included(0.0), Bound::Included(1.0));
        assert_eq!(of([closed; 2], &[single(0.5)]), f64::INFINITY);
        assert_eq!(of([OPEN; 2], &[(Scalar::Bool, 1)]), f64::INFINITY);
    }

    #[test]
    fn a_range_admits_some_numbers_and_not_all() {
        use Bound::{Excluded, Included, Unbounded};
        for (range, expected) in [
            ((Included(0.0), Included(0.0)), true),
            ((Included(0.0), Excluded(0.0)), false),
            ((Excluded(0.0), Included(0.0)), false),
            ((Excluded(0.0), Excluded(1.0)), true),
            ((Included(1.0), Included(0.0)), false),
            ((Unbounded, Included(0.0)), true),
            ((Excluded(0.0), Unbounded), true),
            ((Unbounded, Unbounded), false),
            ((Unbounded, Excluded(f64::NAN)), false),
            ((Included(f64::NAN), Included(1.0)), false),
            ((Included(0.0), Included(f64::INFINITY)), true),
            ((Included(f64::NEG_INFINITY), Included(0.0)), true),
            ((Included(f64::NEG_INFINITY), Unbounded), false),
            ((Unbounded, Excluded(f64::INFINITY)), false),
        ] {
            assert_eq!(is_some_and_not_all(range), expected, "{range:?}");
        }
        let statements = [
            ((Included(0.0), Included(1.0)), "lies in 0..=1"),
            ((Included(0.0), Excluded(1.0)), "lies in 0..<1"),
            ((Excluded(0.0), Included(1.0)), "is above 0 and at most 1"),
            ((Excluded(0.0), Excluded(1.0)), "is above 0 and below 1"),
            ((Included(0.5), Unbounded), "is at least 0.5"),
            ((Unbounded, Excluded(2.0)), "is below 2"),
        ];
        for (range, statement) in statements {
            assert_eq!(shown(range), statement);
        }
    }
}
