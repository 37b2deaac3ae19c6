//! A function that is ready to be called.

use super::{ProbeError, Probed};
use crate::fixture::Fixtures;

/// The function that an executor has to prepare.
///
/// ```
/// # use karat::executor::Executor;
/// # use karat::path::Adapter;
/// # use karat::prelude::*;
/// # use karat::probe::{Call, Prepared, ProbeError, Started};
/// # #[derive(Debug)]
/// # struct Doubler;
/// # impl Executor for Doubler {
/// #     fn path(&self) -> Path {
/// #         Path::CPU
/// #     }
/// #     fn adapter(&self) -> Adapter {
/// #         let (path, name) = ("cpu".to_owned(), "Doubler".to_owned());
/// #         Adapter { path, name, driver: String::new(), software: true }
/// #     }
/// fn prepare<'e>(&'e self, call: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
///     assert_eq!(call.probed.function().name, "twice");
///     assert!(call.fixtures.is_empty(), "it reads no texture and no buffer");
///     Ok(Box::new(Self))
/// }
/// # }
/// # impl Prepared for Doubler {
/// #     fn capacity(&self) -> usize {
/// #         1000
/// #     }
/// #     fn start<'p>(&'p self, _: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
/// #         let double = |word: &u32| (2.0 * f32::from_bits(*word)).to_bits();
/// #         let results: Vec<u32> = arguments.iter().map(double).collect();
/// #         Ok(Box::new(move |read| {
/// #             read(&results, 1);
/// #             Ok(())
/// #         }))
/// #     }
/// # }
/// # let package = Package::from_source("m", "fn twice(x: f32) -> f32 { return 2.0 * x; }");
/// # package.function("twice").on(&Doubler).over(-1.0..=1.0).agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
/// ```
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct Call<'c> {
    /// The function, with its signature and its kernel.
    pub probed: &'c Probed,
    /// The textures, samplers and buffers that it reads, by the variable's name.
    pub fixtures: &'c Fixtures,
    /// The most cases of one batch. An executor may have room for fewer.
    pub cases: usize,
}

/// A function that is ready to be called on one executor.
///
/// ```
/// # use karat::executor::Executor;
/// # use karat::path::Adapter;
/// # use karat::prelude::*;
/// use karat::probe::{Call, Prepared, ProbeError, Started};
///
/// # #[derive(Debug)]
/// struct Doubler;
/// # impl Executor for Doubler {
/// #     fn path(&self) -> Path {
/// #         Path::CPU
/// #     }
/// #     fn adapter(&self) -> Adapter {
/// #         let (path, name) = ("cpu".to_owned(), "Doubler".to_owned());
/// #         Adapter { path, name, driver: String::new(), software: true }
/// #     }
/// #     fn prepare<'e>(&'e self, _: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
/// #         Ok(Box::new(Self))
/// #     }
/// # }
///
/// impl Prepared for Doubler {
///     fn capacity(&self) -> usize {
///         1000
///     }
///
///     fn start<'p>(&'p self, _: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError> {
///         let double = |word: &u32| (2.0 * f32::from_bits(*word)).to_bits();
///         let results: Vec<u32> = arguments.iter().map(double).collect();
///         Ok(Box::new(move |read| {
///             read(&results, 1); // one word from each case to the next
///             Ok(())
///         }))
///     }
/// }
/// # let package = Package::from_source("m", "fn twice(x: f32) -> f32 { return 2.0 * x; }");
/// # package.function("twice").on(&Doubler).over(-1.0..=1.0).agrees_with(|x: f64| 2.0 * x, Ulp(0.0));
/// ```
pub trait Prepared: Sync {
    /// The most cases of one batch; at least 1.
    fn capacity(&self) -> usize;

    /// Starts a batch of cases, each with the lanes of all its arguments, one 32-bit word a scalar.
    ///
    /// Call what is returned to wait for the results; it lends them to its reader, once. The
    /// executor guarantees that each word was written once, by its case, or returns an error.
    ///
    /// # Errors
    /// If the batch can't be started.
    fn start<'p>(&'p self, cases: usize, arguments: &[u32]) -> Result<Started<'p>, ProbeError>;

    /// Whether the textures that the function reads are kept in 16-bit floats.
    fn reads_half_floats(&self) -> bool {
        false
    }
}

/// A batch that runs. Calling it waits for its results.
pub type Started<'p> = Box<dyn FnOnce(Reader<'_>) -> Result<(), ProbeError> + 'p>;

/// Takes the results of a batch: the words of all cases, and the stride in words from one case to
/// the next. A case may have more words than its result; the executor uses those itself.
pub type Reader<'r> = &'r mut dyn FnMut(&[u32], usize);
