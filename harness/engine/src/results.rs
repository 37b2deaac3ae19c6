//! The results of a call.

use naga::Span;

use crate::arithmetic::Arithmetic;
use crate::arithmetic::sealed::Rules;
use crate::scalar::{File, Scalar};

/// One scalar of a result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Lane<F, I, B> {
    /// A float.
    Float(F),
    /// An integer.
    Int(I),
    /// A boolean.
    Bool(B),
}

/// One scalar of a result in arithmetic `A`.
pub type LaneOf<A> = Lane<<A as Rules>::Float, <A as Rules>::Int, <A as Rules>::Bool>;

/// The results of all cases, one row for each case.
#[derive(Debug)]
pub struct Results<A: Arithmetic> {
    pub(crate) scalars: Vec<Scalar>,
    pub(crate) floats: Vec<A::Float>,
    pub(crate) ints: Vec<A::Int>,
    pub(crate) bools: Vec<A::Bool>,
    pub(crate) cases: usize,
    pub(crate) long: Vec<(usize, Span)>,
}

impl<A: Arithmetic> Results<A> {
    /// The cases that were removed because of [`Options::leaves`](crate::Options::leaves), each with the loop that ran
    /// too many iterations. The rows of these cases have no meaning.
    #[must_use]
    pub fn long(&self) -> &[(usize, Span)] {
        &self.long
    }

    /// The number of rows.
    #[must_use]
    pub fn cases(&self) -> usize {
        self.cases
    }

    /// For each scalar of a row, `true` if it has half precision.
    #[must_use]
    pub fn halves(&self) -> Vec<bool> {
        self.scalars.iter().map(|scalar| *scalar == Scalar::F16).collect()
    }

    /// The number of scalars in a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.scalars.len()
    }

    fn counts(&self) -> [usize; 3] {
        let mut counts = [0; 3];
        for scalar in &self.scalars {
            counts[scalar.file() as usize] += 1;
        }
        counts
    }

    /// The row of a case.
    ///
    /// # Panics
    ///
    /// Panics if the case doesn't exist.
    #[must_use]
    pub fn row(&self, case: usize) -> Vec<LaneOf<A>> {
        assert!(case < self.cases, "case {case} of {}", self.cases);
        let counts = self.counts();
        let mut next: [usize; 3] = std::array::from_fn(|k| case * counts[k]);
        let lane = |scalar: &Scalar| {
            let at = next[scalar.file() as usize];
            next[scalar.file() as usize] += 1;
            match scalar.file() {
                File::Float => Lane::Float(self.floats[at]),
                File::Int => Lane::Int(self.ints[at]),
                File::Bool => Lane::Bool(self.bools[at]),
            }
        };
        self.scalars.iter().map(lane).collect()
    }

    /// All rows as words, in the format of arguments. Floats are rounded to `f32` or `f16`. For an interval, the word
    /// is the interval's midpoint.
    #[must_use]
    pub fn words(&self) -> Vec<u32> {
        let mut words = Vec::with_capacity(self.cases * self.scalars.len());
        let (mut floats, mut ints, mut bools) =
            (self.floats.iter(), self.ints.iter(), self.bools.iter());
        for _ in 0..self.cases {
            for scalar in &self.scalars {
                let word = match scalar {
                    Scalar::F32 => floats.next().map(|x| A::float_word(*x)),
                    Scalar::F16 => floats.next().map(|x| {
                        let x = f32::from_bits(A::float_word(*x));
                        u32::from(half::f16::from_f32(x).to_bits())
                    }),
                    Scalar::I32 | Scalar::U32 => ints.next().map(|x| A::int_word(*x)),
                    Scalar::Bool => bools.next().map(|x| A::bool_word(*x)),
                };
                words.push(word.expect("a case has a value for each of its scalars"));
            }
        }
        words
    }
}
