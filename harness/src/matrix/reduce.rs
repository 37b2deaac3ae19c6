//! The simplest input on which two columns differ.

use super::execute::{Judge, Runs};
use super::leeway::Leeway;
use crate::value::Scalar;

/// Rounds of simplification: each makes one component simpler.
const ROUNDS: usize = 24;

/// Two columns that differ, and by which tolerance.
pub(super) struct Pair<'r, 'p> {
    pub(super) expected: &'r Runs<'p>,
    pub(super) actual: &'r Runs<'p>,
    pub(super) arguments: &'r [Scalar],
    pub(super) results: &'r [Scalar],
    pub(super) judge: &'r Judge<'r>,
    pub(super) leeway: &'r Leeway,
}

/// An input on which two columns differ, with the results that do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Case {
    pub(super) row: Vec<u32>,
    pub(super) expected: Vec<u32>,
    pub(super) actual: Vec<u32>,
}

impl Pair<'_, '_> {
    /// Makes the arguments of a case simpler as long as the columns differ when it runs alone. `None`:
    /// alone they agree, so that what differs depends on the cases that run beside it.
    pub(super) fn reduce(&self, found: &Case) -> Option<Case> {
        let mut simplest = found.row.clone();
        for _ in 0..ROUNDS {
            let simpler = self.simpler(&simplest);
            match self.first_that_differs(&simpler) {
                Some(case) => simplest = case.row,
                None => break,
            }
        }
        // What was found among others is looked at alone.
        self.first_that_differs(&[simplest])
            .or_else(|| self.first_that_differs(std::slice::from_ref(&found.row)))
    }

    /// Of these rows, the first on which the columns differ. None if one of them can't be run.
    fn first_that_differs(&self, rows: &[Vec<u32>]) -> Option<Case> {
        if rows.is_empty() {
            return None;
        }
        let words = rows.concat();
        let expected = self.expected.results(&words, rows.len()).ok()?;
        let actual = self.actual.results(&words, rows.len()).ok()?;
        let latitude = self.leeway.at(&words, rows.len());
        let found = self.judge.compare(&expected, &actual, latitude.as_ref());
        let index = *found.differing.first()?;
        let width = self.results.len();
        let of = |results: &[u32]| results[index * width..][..width].to_vec();
        Some(Case { row: rows[index].clone(), expected: of(&expected), actual: of(&actual) })
    }

    /// The same row with one component simpler, in each way.
    fn simpler(&self, row: &[u32]) -> Vec<Vec<u32>> {
        let mut found = Vec::new();
        for (index, scalar) in self.arguments.iter().enumerate() {
            for word in simpler_words(*scalar, row[index]) {
                let mut next = row.to_vec();
                next[index] = word;
                found.push(next);
            }
        }
        found
    }
}

/// What is simpler than a word, the simplest first.
fn simpler_words(scalar: Scalar, word: u32) -> Vec<u32> {
    match scalar {
        Scalar::F32 | Scalar::F16 => {
            let value = f32::from_bits(word);
            let candidates =
                [0.0, 1.0, 0.5, -1.0, value.trunc(), (value * 8.0).round() / 8.0, value.abs()];
            let simple = |x: f32| (x.fract() != 0.0, digits(x), x.abs().to_bits(), x < 0.0);
            let simpler = candidates.into_iter().filter(|c| simple(*c) < simple(value));
            simpler.map(f32::to_bits).collect()
        }
        Scalar::I32 | Scalar::U32 => {
            let value = word.cast_signed();
            [0, 1, value / 2]
                .into_iter()
                .filter(|c| c.unsigned_abs() < value.unsigned_abs())
                .map(i32::cast_unsigned)
                .collect()
        }
        Scalar::Bool => {
            if word == 0 {
                Vec::new()
            } else {
                vec![0]
            }
        }
    }
}

/// How many digits a value is written with.
fn digits(value: f32) -> usize {
    value.to_string().len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::probe::{Prepared, ProbeError, Started};
    use crate::tolerance::{Abs, Tolerance};

    /// Each step leads to something simpler, so that steps end.
    #[test]
    fn simpler_words_get_simpler() {
        for scalar in [Scalar::F32, Scalar::I32, Scalar::U32, Scalar::Bool] {
            for start in [0, 1, 7, 1_000_000, 0.3_f32.to_bits(), (-7.77_f32).to_bits()] {
                let mut seen = vec![start];
                let mut word = start;
                while let Some(next) = simpler_words(scalar, word).last() {
                    assert!(!seen.contains(next), "{scalar:?} {start} comes back to {next}");
                    seen.push(*next);
                    word = *next;
                }
            }
        }
        assert!(simpler_words(Scalar::F32, 0).is_empty());
    }

    /// Makes results of all arguments together.
    struct By(fn(&[u32]) -> Vec<u32>);

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

    /// Some drivers take one invocation's value for those of all that run together.
    #[test]
    fn what_differs_among_others_alone_is_not_made_simpler() {
        let squares = |all: &[u32]| all.iter().map(|own| own * own).collect();
        let mixed = |all: &[u32]| vec![all[0] * all[0]; all.len()];
        let wrong = |all: &[u32]| all.iter().map(|own| own * own + 100).collect();
        let scalars = [Scalar::U32];
        let within = Tolerance::from(Abs(0.0));
        let judge = Judge::new(&scalars, &within, &[0]);
        let reduced = |actual: fn(&[u32]) -> Vec<u32>| {
            let pair = Pair {
                expected: &Runs::of_one_word(By(squares)),
                actual: &Runs::of_one_word(By(actual)),
                arguments: &scalars,
                results: &scalars,
                judge: &judge,
                leeway: &Leeway::default(),
            };
            pair.reduce(&Case { row: vec![9], expected: vec![81], actual: vec![4] })
        };
        assert_eq!(reduced(mixed), None, "alone it is right");
        let simplest = Case { row: vec![0], expected: vec![0], actual: vec![100] };
        assert_eq!(reduced(wrong), Some(simplest), "with its own results");
    }
}
