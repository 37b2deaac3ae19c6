//! Calls a function on one path for any number of samples, and makes the random numbers for the calls.

use crate::check::called::Called;
use crate::check::{Failure, Mismatch};
use crate::domain::Source;
use crate::parallel;
use crate::value::{Arguments, Scalar, Shape, Shareable};

/// The number of samples that share a stream of random numbers.
const BLOCK: usize = 2048;

/// The largest number of samples that Karat keeps in memory at a time.
pub(super) const STRIDE: usize = 65_536;

/// A function that is ready to be called on one path.
pub(super) struct Calls<'s> {
    pub(super) called: &'s Called<'s>,
}

/// A function that takes points (or random numbers) as `u32` words, and appends a function's arguments for each point
/// to a vector.
pub(super) type Given<'g> = &'g (dyn Fn(&[u32], &mut Vec<u32>) + Sync);

/// Turns `of`, which returns arguments as Rust values, into a function that appends the arguments' words to a vector.
pub(super) fn given<X: Shareable, A: Arguments>(
    of: impl Fn(X) -> A + Sync,
) -> impl Fn(&[u32], &mut Vec<u32>) + Sync {
    let width = X::shape().lanes().len();
    move |points, lanes| {
        for point in points.chunks_exact(width.max(1)) {
            of(X::load(&mut point.iter())).store_all(lanes);
        }
    }
}

impl Calls<'_> {
    pub(super) fn words(&self) -> usize {
        self.called.scalars().len()
    }

    /// Calls the function `calls` times. `lanes` contains the arguments of all calls, one call after the other.
    pub(super) fn call(&self, lanes: &[u32], calls: usize) -> Result<Vec<u32>, Failure> {
        let words = self.words();
        let mut results = Vec::with_capacity(calls * words);
        let per_call = lanes.len() / calls.max(1);
        let mut first = 0;
        while first < calls {
            let count = (calls - first).min(self.called.capacity());
            let batch = &lanes[first * per_call..(first + count) * per_call];
            self.called.start(batch, count)?.view(|read| {
                (0..count).for_each(|call| results.extend_from_slice(read.of(call)));
            })?;
            first += count;
        }
        Ok(results)
    }

    pub(super) fn shown(&self, lanes: &[u32], result: &[u32]) -> String {
        let function = self.called.function();
        let list: Vec<String> = function
            .arguments(lanes)
            .into_iter()
            .map(|(name, value)| format!("{name} = {value}"))
            .collect();
        format!("{}({}) = {}", function.name, list.join(", "), function.result.format(result))
    }

    /// Returns an error if Karat has no uniform distribution for this type of random numbers.
    pub(super) fn expect_random(&self, random: &Shape) -> Result<(), Failure> {
        let uniform = |scalar: &Scalar| matches!(scalar, Scalar::F32 | Scalar::U32);
        if random.lanes().iter().all(uniform) {
            return Ok(());
        }
        Err(Mismatch::Random(random.clone()).of(self.called.function()))
    }

    /// Calls the function at each point. `points` contains the words of all points, `width` words for each point.
    /// Returns the words of the arguments and of the results.
    pub(super) fn at(
        &self,
        points: &[u32],
        width: usize,
        given: Given<'_>,
    ) -> Result<(Vec<u32>, Vec<u32>), Failure> {
        let parts: Vec<&[u32]> = points.chunks(BLOCK * width).collect();
        let parts = parallel::map(parts.len(), |part| {
            let mut lanes = Vec::new();
            given(parts[part], &mut lanes);
            lanes
        });
        let lanes = parts.concat();
        let results = self.call(&lanes, points.len() / width)?;
        Ok((lanes, results))
    }
}

/// Makes the arguments of `count` calls from random numbers. The first call is for the sample with index `first`, which
/// must be a multiple of `BLOCK`. A random `f32` is a multiple of 2^-24 in [0, 1), as in most generators on GPUs.
pub(super) fn draw(
    seed: u64,
    first: usize,
    count: usize,
    random: &[Scalar],
    given: Given<'_>,
) -> Vec<u32> {
    debug_assert_eq!(first % BLOCK, 0, "each block has its own random stream");
    let blocks = parallel::map(count.div_ceil(BLOCK), |block| {
        let mut source = Source::new(seed, (first / BLOCK + block) as u64);
        let calls = BLOCK.min(count - block * BLOCK);
        let mut numbers = Vec::with_capacity(calls * random.len());
        for _ in 0..calls {
            numbers.extend(random.iter().map(|scalar| match scalar {
                Scalar::U32 => source.bits(),
                // The division is exact, because it divides 24 bits by a power of two.
                _ => ((source.bits() >> 8) as f32 / 16_777_216.0).to_bits(),
            }));
        }
        let mut lanes = Vec::new();
        given(&numbers, &mut lanes);
        lanes
    });
    blocks.concat()
}
