//! Describes in one line which arguments make a function fail. The line names a property of the arguments that
//! separates failing cases from passing cases.
//!
//! A property is a component of an argument, or a number computed from two arguments: the quotient, product or
//! difference of two numbers, the dot product or distance of two vectors. For each property, Karat finds the
//! interval of values that contains many failing cases and few passing cases.

use super::batch::Batch;
use crate::judge::Tally;
use crate::reflect::Function;
use crate::tolerance::significant;
use crate::value::{Scalar, Shape};

/// The largest number of failing cases, and of passing cases, that Karat examines first. With 2048 cases, Karat knows
/// the share of failing cases in an interval to within 1 %.
const CASES: usize = 2048;

/// The smallest number of failing cases, and of passing cases, for which Karat reports a cause. With fewer
/// cases, an interval of some property can separate failing from passing cases by chance.
const FEWEST: usize = 8;

/// The smallest gain of a reported interval. An interval's gain is its share of the failing cases minus its
/// share of the passing cases.
const TELLING: f64 = 0.95;

/// The lead that a property of two arguments needs: Karat reports such a property only if its gain exceeds the gain of
/// every property of one argument by more than this number.
const SIMPLER: f64 = 0.02;

/// A function that returns the arguments of a case.
type Of<'b> = &'b dyn Fn(usize) -> &'b [u32];

struct Cases<'b> {
    arguments: Of<'b>,
    failing: Vec<usize>,
    passing: Vec<usize>,
    /// The numbers of failing and of passing cases, before `thinned` removed some.
    all: (usize, usize),
}

/// A function that computes a property from the components of a case's arguments.
type Measured = Box<dyn Fn(&[f64]) -> f64>;

/// A named number that Karat computes from the arguments of each case.
struct Property {
    name: String,
    of: Measured,
    mixed: bool,
}

/// An interval of a property's values. `failing` is the share of all failing cases that lie in the interval. `passing`
/// is the share of all passing cases that lie in the interval.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Interval {
    /// The lower end. `None` if the interval begins at the smallest value of all cases.
    least: Option<f64>,
    /// The upper end. `None` if the interval ends at the largest value of all cases.
    most: Option<f64>,
    failing: f64,
    passing: f64,
}

impl Interval {
    fn gain(&self) -> f64 {
        self.failing - self.passing
    }
}

/// Returns the cause as text:
/// `where x is at least 0.2 (this includes all failing cases and 0.4 % of the passing cases)`, or
/// `everywhere except ..`. `None` if no single property separates the cases.
pub(super) fn cause(
    function: &Function,
    batch: &Batch,
    failing: &[usize],
    tally: &Tally,
) -> Option<String> {
    let count = usize::try_from(tally.census.failures).ok()?;
    let is_whole = failing.len() == count;
    is_whole.then(|| cause_of(function, batch.cases, &|case| batch.arguments(case), failing))?
}

/// Does the same as `cause`, but without a batch. `arguments` returns the arguments of the case with the given index.
pub fn cause_of<'b>(
    function: &Function,
    cases: usize,
    arguments: Of<'b>,
    failing: &[usize],
) -> Option<String> {
    let parameters = &function.parameters;
    let count = failing.len();
    if count < FEWEST || cases - count < FEWEST {
        return None;
    }
    let mut failed = vec![false; cases];
    failing.iter().for_each(|case| failed[*case] = true);
    let passing: Vec<usize> = (0..cases).filter(|case| !failed[*case]).collect();
    let all = (count, passing.len());
    let cases = Cases { arguments, failing: thinned(failing), passing: thinned(&passing), all };
    if cases.passes_at_zeros_alone(parameters) {
        return Some("everywhere except where a number in the arguments is 0".to_owned());
    }
    let mut best: Option<(Property, Interval)> = None;
    for property in properties(parameters) {
        let Some(interval) = cases.split(parameters, &property) else { continue };
        let more = if property.mixed { SIMPLER } else { 0.0 };
        let is_best = best.as_ref().is_none_or(|(_, best)| interval.gain() > best.gain() + more);
        if interval.gain() >= TELLING && is_best {
            best = Some((property, interval));
        }
    }
    let (property, interval) = best?;
    // The examined cases select the property. All cases together give the ends of its interval.
    let whole = Cases { failing: failing.to_vec(), passing, ..cases };
    let interval = whole.split(parameters, &property).unwrap_or(interval);
    Some(said(&property.name, &interval))
}

fn thinned(cases: &[usize]) -> Vec<usize> {
    cases.iter().copied().step_by(cases.len().div_ceil(CASES).max(1)).collect()
}

fn said(name: &str, interval: &Interval) -> String {
    let Interval { least, most, failing, passing } = interval;
    // Adding 0 turns -0 into 0. So the text never shows "-0".
    let [least, most] = [least, most].map(|end| end.map(|end| end + 0.0));
    let place = match (least, most) {
        (Some(least), Some(most)) if least == most => format!("is {}", significant(least)),
        (Some(least), Some(most)) => {
            format!("is from {} to {}", significant(least), significant(most))
        }
        (Some(least), None) => format!("is at least {}", significant(least)),
        (None, Some(most)) => format!("is at most {}", significant(most)),
        (None, None) => "is a number".to_owned(),
    };
    let share = |share: f64| format!("{:.3}", 100.0 * share);
    let share = |part: f64| share(part).trim_end_matches('0').trim_end_matches('.').to_owned();
    let fails = match failing {
        1.0 => "all failing cases".to_owned(),
        part => format!("{} % of the failing cases", share(*part)),
    };
    let passes = match passing {
        0.0 => "no passing case".to_owned(),
        part => format!("{} % of the passing cases", share(*part)),
    };
    if *failing == 1.0 && *passing == 0.0 {
        return format!("where {name} {place}, and nowhere else");
    }
    format!("where {name} {place} (this includes {fails} and {passes})")
}

impl Cases<'_> {
    /// Checks if most cases fail, and nearly all passing cases have a 0 among their arguments. A function with a wrong
    /// factor shows this pattern, because 0 times a wrong factor is still 0. So Karat reports the zeros instead of a
    /// product or quotient of arguments.
    fn passes_at_zeros_alone(&self, parameters: &[(String, Shape)]) -> bool {
        let scalars: Vec<Scalar> = parameters.iter().flat_map(|(_, shape)| shape.lanes()).collect();
        // Drivers may flush subnormal numbers to 0. So a product with the smallest normal number may be 0, too.
        let zero = f64::from(f32::MIN_POSITIVE);
        let has_zero = |case: &&usize| {
            let mut lanes = scalars.iter().zip((self.arguments)(**case));
            lanes.any(|(scalar, word)| scalar.is_float() && scalar.decode(*word).abs() <= zero)
        };
        let zeros = self.passing.iter().filter(has_zero).count();
        self.all.0 > 2 * self.all.1 && zeros as f64 >= TELLING * self.passing.len() as f64
    }

    fn split(&self, parameters: &[(String, Shape)], property: &Property) -> Option<Interval> {
        let scalars: Vec<Scalar> = parameters.iter().flat_map(|(_, shape)| shape.lanes()).collect();
        let mut values = Vec::with_capacity(self.failing.len() + self.passing.len());
        for (cases, weight) in [
            (&self.failing, 1.0 / self.failing.len() as f64),
            (&self.passing, -1.0 / self.passing.len() as f64),
        ] {
            for case in cases {
                let row = (self.arguments)(*case);
                let lanes: Vec<f64> =
                    scalars.iter().zip(row).map(|(scalar, word)| scalar.decode(*word)).collect();
                let value = (property.of)(&lanes);
                // A quotient of zeros is NaN, which lies in no interval.
                if value.is_finite() {
                    values.push((value, weight));
                }
            }
        }
        largest_sum(&mut values)
    }
}

/// Finds the interval of values with the largest sum of weights. Failing cases have positive weights, passing
/// cases negative weights. The function uses Kadane's algorithm over the distinct values.
fn largest_sum(values: &mut [(f64, f64)]) -> Option<Interval> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (first, last) = (values.first()?.0, values.last()?.0);
    // The values differ only by rounding, such as the lengths of unit vectors: `normalize` errs by 2 to 4 ulp.
    if last - first < f64::from(f32::EPSILON) * 4.0 * last.abs().max(first.abs()) {
        return None;
    }
    let (mut best, mut at) = (None::<Interval>, None::<Interval>);
    for equal in values.chunk_by(|a, b| a.0 == b.0) {
        let value = equal[0].0;
        let part = |sign: f64| -> f64 {
            equal.iter().map(|(_, weight)| weight * sign).filter(|weight| *weight > 0.0).sum()
        };
        let (failing, passing) = (part(1.0), part(-1.0));
        let before = at.filter(|at| at.gain() > 0.0);
        let from = before.unwrap_or(Interval {
            least: Some(value),
            most: None,
            failing: 0.0,
            passing: 0.0,
        });
        let here = Interval {
            most: Some(value),
            failing: from.failing + failing,
            passing: from.passing + passing,
            ..from
        };
        at = Some(here);
        if best.is_none_or(|best| here.gain() > best.gain() + 1e-9) {
            best = Some(here);
        }
    }
    let rounded = |share: f64| if (share - 1.0).abs() < 1e-9 { 1.0 } else { share };
    let best = best?;
    let inner = best.least != best.most;
    Some(Interval {
        least: best.least.filter(|least| *least != first || !inner),
        most: best.most.filter(|most| *most != last || !inner),
        failing: rounded(best.failing),
        passing: best.passing,
    })
}

/// The properties that may separate the cases. Properties of single arguments come first.
fn properties(parameters: &[(String, Shape)]) -> Vec<Property> {
    let (mut single, mut mixed) = (Vec::new(), Vec::new());
    let (mut numbers, mut vectors) = (Vec::new(), Vec::new());
    let mut lane = 0;
    for (name, shape) in parameters {
        let lanes = shape.lanes();
        let is_float = lanes.iter().all(|scalar| scalar.is_float());
        for (index, part) in shape.lane_names().into_iter().enumerate() {
            let at = lane + index;
            let of = Box::new(move |lanes: &[f64]| lanes[at]);
            single.push(Property { name: format!("{name}{part}"), of, mixed: false });
        }
        match shape {
            Shape::Vector { .. } if is_float => {
                let (first, size) = (lane, lanes.len());
                let of = Box::new(move |lanes: &[f64]| length(&lanes[first..first + size]));
                single.push(Property { name: format!("length({name})"), of, mixed: false });
                vectors.push((name, first, size));
            }
            _ if lanes.len() == 1 && is_float => numbers.push((name, lane)),
            _ => {}
        }
        lane += lanes.len();
    }
    let mut add = |name: String, of: Measured| {
        mixed.push(Property { name, of, mixed: true });
    };
    for (index, (a, i)) in numbers.iter().copied().enumerate() {
        for (b, j) in numbers[index + 1..].iter().copied() {
            add(format!("{a} / {b}"), Box::new(move |lanes| lanes[i] / lanes[j]));
            add(format!("{b} / {a}"), Box::new(move |lanes| lanes[j] / lanes[i]));
            add(format!("{a} * {b}"), Box::new(move |lanes| lanes[i] * lanes[j]));
            add(format!("{a} - {b}"), Box::new(move |lanes| lanes[i] - lanes[j]));
        }
    }
    for (index, (a, i, size)) in vectors.iter().copied().enumerate() {
        for (b, j, _) in vectors[index + 1..].iter().copied().filter(|other| other.2 == size) {
            let pairs = move |lanes: &[f64]| -> Vec<(f64, f64)> {
                lanes[i..i + size].iter().copied().zip(lanes[j..j + size].iter().copied()).collect()
            };
            let dot = move |lanes: &[f64]| pairs(lanes).iter().map(|(a, b)| a * b).sum();
            let apart = move |lanes: &[f64]| {
                length(&pairs(lanes).iter().map(|(a, b)| a - b).collect::<Vec<_>>())
            };
            add(format!("dot({a}, {b})"), Box::new(dot));
            add(format!("distance({a}, {b})"), Box::new(apart));
        }
    }
    single.extend(mixed);
    single
}

fn length(lanes: &[f64]) -> f64 {
    lanes.iter().map(|lane| lane * lane).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::{Domain, Integers, UnitVector};
    use crate::package::Package;
    use crate::value::Arguments;

    /// Returns the reported cause for a function that returns 1 if `fails` holds, and 0 otherwise. The check allows
    /// results up to 0.5.
    fn told<D: Domain>(parameters: &str, fails: &str, domain: D) -> Option<String>
    where
        D::Value: Arguments,
    {
        let text = format!("fn f({parameters}) -> f32 {{ return select(0.0, 1.0, {fails}); }}");
        let package = Package::from_source("s", &text);
        // The engine runs the function because some drivers flush subnormal numbers to 0.
        let cpu = crate::executor::of(crate::path::Path::CPU).expect("it opens");
        let check = package.function("f").on(cpu).over(domain);
        let error = check
            .unrecorded()
            .try_stays_within(0.0..=0.5)
            .expect_err("some cases fail")
            .to_string();
        let line = error.lines().find_map(|line| line.trim().strip_prefix("it fails "))?;
        Some(line.to_owned())
    }

    #[test]
    fn the_simplest_property_of_failing_cases_is_named() {
        let unit = || 0.0..=1.0_f32;
        for (parameters, fails, said) in [
            ("x: f32, y: f32", "x > 0.25", "where x is at least 0.25"),
            ("x: f32, y: f32", "x <= 0.25", "where x is at most 0.2"),
            ("x: f32, y: f32", "y > 0.25 && y < 0.5", "where y is from 0.25"),
            ("x: f32, y: f32", "x == 0.0", "where x is 0, and nowhere else"),
            (
                "x: f32, y: f32",
                "x / max(y, 1e-9) > 0.2 && x / max(y, 1e-9) < 1.0",
                "where x / y is from 0.2",
            ),
            ("x: f32, y: f32", "x > y", "where y / x is at most 1"),
        ] {
            let told = told(parameters, fails, (unit(), unit()));
            assert!(told.as_ref().is_some_and(|told| told.starts_with(said)), "{fails}: {told:?}");
        }
        let told_of = told("n: vec3f, l: vec3f", "dot(n, l) < -0.5", (UnitVector, UnitVector));
        assert!(told_of.is_some_and(|told| told.starts_with("where dot(n, l) is at most -0.5")));
        let told_of = told("x: f32, i: u32", "i == 3u", (unit(), Integers(0..=7_u32)));
        assert_eq!(told_of.as_deref(), Some("where i is 3, and nowhere else"));
        // The ends of the interval come from all cases, not only from the examined cases.
        let told_of = told("i: u32", "i != 0u", Integers(0..=u32::MAX));
        let least = "where i is at least 1, and nowhere else";
        assert_eq!(told_of.as_deref(), Some(least));
    }

    #[test]
    fn scattered_failures_have_no_cause() {
        let unit = || 0.0..=1.0_f32;
        assert_eq!(told("x: f32", "fract(x * 7919.0) > 0.5", unit()), None);
        assert_eq!(told("x: f32", "true", unit()), None, "all of them");
        let zero = Some("everywhere except where a number in the arguments is 0".to_owned());
        assert_eq!(told("x: f32, y: f32", "x * y != 0.0", (unit(), unit())), zero);
        assert_eq!(told("x: f32", "x != 0.0", unit()), zero);
    }

    #[test]
    fn the_largest_sum_is_that_of_an_interval() {
        let mut values = [(3.0, 0.5), (1.0, -0.5), (2.0, 0.5), (4.0, -0.5), (2.0, 0.0)];
        let found = largest_sum(&mut values).expect("there are values");
        assert_eq!((found.least, found.most, found.gain()), (Some(2.0), Some(3.0), 1.0));
        assert_eq!(largest_sum(&mut []), None);
    }
}
