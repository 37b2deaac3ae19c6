//! Finds the simplest input on which two columns differ.

use karat::unstable::check::Flushed;
use karat::unstable::executor::Caller;
use karat_core::domain::Stream;
use karat_core::value::Scalar;

use super::execute::{Comparison, Judge};
use super::leeway::{Latitude, Leeway};

const ROUNDS: usize = 24;

pub(super) struct Pair<'r, 'p> {
    pub(super) expected: &'r Caller<'p>,
    pub(super) actual: &'r Caller<'p>,
    /// The stream that proposes simpler inputs.
    pub(super) inputs: &'r dyn Stream,
    pub(super) arguments: &'r [Scalar],
    pub(super) results: &'r [Scalar],
    pub(super) judge: &'r Judge<'r>,
    pub(super) leeway: &'r Leeway,
}

/// An input for which two columns differ, with both results.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Case {
    pub(super) row: Vec<u32>,
    pub(super) expected: Vec<u32>,
    pub(super) actual: Vec<u32>,
}

impl Pair<'_, '_> {
    /// Simplifies a case's arguments as long as the columns differ, and then runs the case without other cases. Returns
    /// `None` if the columns agree in this last run, because the difference then depends on the other cases.
    pub(super) fn reduce(&self, found: &Case) -> Option<Case> {
        let mut simplest = found.row.clone();
        for _ in 0..ROUNDS {
            let simpler = self.inputs.shrink(&simplest);
            match self.first_that_differs(&simpler) {
                Some(case) => simplest = case.row,
                None => break,
            }
        }
        // Runs the case without other cases.
        self.first_that_differs(&[simplest])
            .or_else(|| self.first_that_differs(std::slice::from_ref(&found.row)))
    }

    /// Compares the two columns' results for some rows (each row has the arguments of one case). If the columns differ
    /// only because one of them flushes arguments, the result is open: WGSL lets operations treat subnormal numbers as
    /// zeros (15.7.2).
    pub(super) fn compare(
        &self,
        rows: &[u32],
        [expected, actual]: [&[u32]; 2],
        latitude: Option<&Latitude>,
    ) -> Comparison {
        let mut seen = self.judge.compare(expected, actual, latitude);
        let (count, width) = (seen.differing.len(), self.arguments.len());
        seen.differing.retain(|case| {
            let row = &rows[case * width..][..width];
            let own = |results: &[u32]| {
                results[case * self.results.len()..][..self.results.len()].to_vec()
            };
            !Flushed::of(self.arguments, row).any(|row| {
                let latitude = self.leeway.at(&row, 1);
                let is_that_of = |caller: &Caller<'_>, kept: Vec<u32>| {
                    let case = latitude.as_ref().map(|all| all.case(0, kept.len()));
                    let flushed = caller.results(&row, 1);
                    flushed.is_ok_and(|flushed| !self.judge.case(&flushed, &kept, case).differs)
                };
                is_that_of(self.expected, own(actual)) || is_that_of(self.actual, own(expected))
            })
        });
        seen.open += count - seen.differing.len();
        seen
    }

    /// Returns the first of these rows for which the columns differ, or `None` if the columns agree for all rows, or if
    /// a column can't run the rows.
    fn first_that_differs(&self, rows: &[Vec<u32>]) -> Option<Case> {
        if rows.is_empty() {
            return None;
        }
        let words = rows.concat();
        let expected = self.expected.results(&words, rows.len()).ok()?;
        let actual = self.actual.results(&words, rows.len()).ok()?;
        let latitude = self.leeway.at(&words, rows.len());
        let found = self.compare(&words, [&expected, &actual], latitude.as_ref());
        let index = *found.differing.first()?;
        let width = self.results.len();
        let of = |results: &[u32]| results[index * width..][..width].to_vec();
        Some(Case { row: rows[index].clone(), expected: of(&expected), actual: of(&actual) })
    }
}

#[cfg(test)]
mod tests {
    use std::borrow::Cow;

    use super::*;
    use karat::package::Package;
    use karat::path::Path;
    use karat::unstable::executor::Executor;
    use karat::unstable::path::Adapter;
    use karat::unstable::probe::{Call, Prepared, ProbeError, Probed, Started};
    use karat_core::domain::{Dynamic, Part};
    use karat_core::tolerance::{Abs, Tolerance};

    /// An executor that computes each result from all arguments of the run.
    #[derive(Debug)]
    struct By(fn(&[u32]) -> Vec<u32>);

    impl Executor for By {
        fn path(&self) -> Path {
            Path::VULKAN
        }

        fn adapter(&self) -> Adapter {
            unreachable!("this test makes no record")
        }

        fn prepare<'e>(&'e self, _: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
            Ok(Box::new(Self(self.0)))
        }
    }

    impl Prepared for By {
        fn capacity(&self) -> usize {
            64
        }

        fn start<'p>(&'p self, _: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
            let results = (self.0)(arguments);
            Ok(Box::new(move |read| {
                read(&results, 1);
                Ok(())
            }))
        }
    }

    /// Some drivers compute the results of all invocations from the arguments of one invocation.
    // Lesson 156
    #[test]
    fn a_difference_that_needs_other_invocations_is_not_simplified() {
        let squares = |all: &[u32]| all.iter().map(|own| own * own).collect();
        let mixed = |all: &[u32]| vec![all[0] * all[0]; all.len()];
        let wrong = |all: &[u32]| all.iter().map(|own| own * own + 100).collect();
        let scalars = [Scalar::U32];
        let within = Tolerance::from(Abs(0.0));
        let judge = Judge::new(&scalars, &within, &[0]);
        let package = Package::from_source("m", "fn f(x: u32) -> u32 { return x; }");
        let (probed, fixtures) = (Probed::new(&package, "f").expect("valid"), Vec::new());
        let inputs = Dynamic::new(&probed.function.parameters, vec![vec![Part::any(Scalar::U32)]]);
        let reduced = |actual: fn(&[u32]) -> Vec<u32>| {
            let (squares, actual) = (By(squares), By(actual));
            let caller = |by| Caller::new(by, Cow::Borrowed(&probed), &fixtures, 64);
            let pair = Pair {
                expected: &caller(&squares).expect("ready"),
                actual: &caller(&actual).expect("ready"),
                inputs: &inputs,
                arguments: &scalars,
                results: &scalars,
                judge: &judge,
                leeway: &Leeway::default(),
            };
            pair.reduce(&Case { row: vec![9], expected: vec![81], actual: vec![4] })
        };
        assert_eq!(reduced(mixed), None, "without other cases, the result is right");
        let simplest = Case { row: vec![0], expected: vec![0], actual: vec![100] };
        assert_eq!(reduced(wrong), Some(simplest), "the case has its own results");
    }

    /// A column that treats a subnormal number as 0 is right. A column that returns another result is wrong.
    #[test]
    fn only_flushed_results_are_open() {
        let kept = |all: &[u32]| {
            all.iter().map(|x| if f32::from_bits(*x) > 0.0 { 3 } else { 7 }).collect()
        };
        let flushing = |all: &[u32]| {
            all.iter().map(|x| if f32::from_bits(*x) >= 1.2e-38 { 3 } else { 7 }).collect()
        };
        let wrong = |all: &[u32]| {
            all.iter().map(|x| if f32::from_bits(*x) >= 1.2e-38 { 3 } else { 9 }).collect()
        };
        let (arguments, results) = ([Scalar::F32], [Scalar::U32]);
        let within = Tolerance::from(Abs(0.0));
        let judge = Judge::new(&results, &within, &[0]);
        let package = Package::from_source("m", "fn f(x: f32) -> u32 { return u32(x); }");
        let (probed, fixtures) = (Probed::new(&package, "f").expect("valid"), Vec::new());
        let inputs = Dynamic::new(&probed.function.parameters, vec![vec![Part::any(Scalar::F32)]]);
        let rows = [0.0_f32, 1e-40, 1.0, 2e-38].map(f32::to_bits);
        let compared = |one: fn(&[u32]) -> Vec<u32>, other: fn(&[u32]) -> Vec<u32>| {
            let (one, other) = (By(one), By(other));
            let caller =
                |by| Caller::new(by, Cow::Borrowed(&probed), &fixtures, 64).expect("ready");
            let (expected, actual) = (caller(&one), caller(&other));
            let results_of =
                |caller: &Caller<'_>| caller.results(&rows, 4).expect("the executor runs the rows");
            let words = [results_of(&expected), results_of(&actual)];
            let pair = Pair {
                expected: &expected,
                actual: &actual,
                inputs: &inputs,
                arguments: &arguments,
                results: &results,
                judge: &judge,
                leeway: &Leeway::default(),
            };
            let seen = pair.compare(&rows, [&words[0], &words[1]], None);
            (seen.differing, seen.open)
        };
        assert_eq!(compared(kept, flushing), (vec![], 1));
        assert_eq!(compared(flushing, kept), (vec![], 1), "either column may flush");
        assert_eq!(compared(kept, wrong), (vec![0, 1], 0));
    }
}
