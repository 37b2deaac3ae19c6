//! Calls of a function on one path, with any number of arguments, and random numbers for them.

use crate::check::Failure;
use crate::check::disagreement::arguments;
use crate::check::parallel;
use crate::check::session::signature;
use crate::domain::Source;
use crate::probe::{self, Probed, Runner};
use crate::value::{Arguments, Scalar, Shareable};

/// Samples of one stream of random numbers.
const BLOCK: usize = 2048;

/// Samples whose arguments are in memory together.
pub(super) const STRIDE: usize = 65_536;

/// A function on one path.
pub(super) struct Calls<'s> {
    pub(super) probed: &'s Probed,
    pub(super) runner: &'s Runner,
    pub(super) seed: u64,
}

impl Calls<'_> {
    /// Words of a result.
    pub(super) fn words(&self) -> usize {
        self.probed.function.result.lanes().len()
    }

    /// The results of calls, whose arguments follow one another in `lanes`.
    pub(super) fn call(&self, lanes: &[u32], calls: usize) -> Result<Vec<u32>, Failure> {
        let words = self.words();
        let mut results = Vec::with_capacity(calls * words);
        let (stride, per_call) = (self.runner.stride_out(), lanes.len() / calls.max(1));
        let mut first = 0;
        while first < calls {
            let count = (calls - first).min(self.runner.capacity());
            let canary = probe::canary(self.seed, first as u64);
            let batch = &lanes[first * per_call..(first + count) * per_call];
            let dispatch = self.runner.dispatch(count, batch, canary)?;
            self.runner.read(dispatch, |read| {
                for result in read.chunks_exact(stride) {
                    results.extend_from_slice(&result[..words]);
                }
            })?;
            first += count;
        }
        Ok(results)
    }

    /// A call as a message shows it: arguments and result.
    pub(super) fn shown(&self, lanes: &[u32], result: &[u32]) -> String {
        let function = &self.probed.function;
        let list: Vec<String> = arguments(function, lanes)
            .into_iter()
            .map(|(name, value)| format!("{name} = {value}"))
            .collect();
        format!("{}({}) = {}", function.path, list.join(", "), function.result.format(result))
    }

    /// Refuses random numbers of a type that has no uniform distribution here.
    pub(super) fn expect_random<U: Shareable>(&self) -> Result<(), Failure> {
        let shape = U::shape();
        let uniform = |scalar: &Scalar| matches!(scalar, Scalar::F32 | Scalar::U32);
        if shape.lanes().iter().all(uniform) {
            return Ok(());
        }
        let mismatch = format!("is sampled with {shape}, but random numbers are f32 or u32");
        Err(signature(&self.probed.function, mismatch))
    }
}

/// Arguments of `count` calls from sample `first` on, which is a multiple of the block's length.
/// An `f32` is a multiple of 2^-24 in [0, 1), as most generators on devices have it.
pub(super) fn draw<U: Shareable, A: Arguments>(
    seed: u64,
    first: usize,
    count: usize,
    arguments: impl Fn(U) -> A + Sync,
) -> Vec<u32> {
    debug_assert_eq!(first % BLOCK, 0, "a stream belongs to a block");
    let scalars = U::shape().lanes();
    let blocks = parallel::map(count.div_ceil(BLOCK), |block| {
        let mut source = Source::new(seed, (first / BLOCK + block) as u64);
        let mut lanes = Vec::new();
        let mut random = Vec::with_capacity(scalars.len());
        for _ in 0..BLOCK.min(count - block * BLOCK) {
            random.clear();
            random.extend(scalars.iter().map(|scalar| match scalar {
                Scalar::U32 => source.bits(),
                // Exact: 24 bits, and a power of two.
                _ => ((source.bits() >> 8) as f32 / 16_777_216.0).to_bits(),
            }));
            arguments(U::load(&mut random.iter())).store_all(&mut lanes);
        }
        lanes
    });
    blocks.concat()
}

/// Appends the lanes of a function's arguments at a point of the support.
pub(super) type At<'f, X> = &'f (dyn Fn(X, &mut Vec<u32>) + Sync);

impl Calls<'_> {
    /// The results at points, with the lanes of the arguments.
    pub(super) fn at<X: Shareable>(
        &self,
        points: &[X],
        arguments: At<'_, X>,
    ) -> Result<(Vec<u32>, Vec<u32>), Failure> {
        let parts = parallel::map(points.len().div_ceil(BLOCK), |block| {
            let mut lanes = Vec::new();
            let points = &points[block * BLOCK..points.len().min((block + 1) * BLOCK)];
            points.iter().for_each(|point| arguments(point.clone(), &mut lanes));
            lanes
        });
        let lanes = parts.concat();
        let results = self.call(&lanes, points.len())?;
        Ok((lanes, results))
    }
}
