//! Calls a prepared function on an executor. Arguments and results are rows of `u32` words.

use std::borrow::Cow;

use super::{Executor, left_open};
use crate::fixture::Fixtures;
use crate::panics;
use crate::path::{self, Path};
use crate::probe::{self, Call, Prepared, ProbeError, Probed, Started};
use crate::reflect::Function;

/// A function that is ready to be called on one executor.
pub struct Caller<'e> {
    /// The function, with its kernel.
    pub probed: Cow<'e, Probed>,
    pub(crate) fixtures: &'e Fixtures,
    /// The path of the executor.
    pub path: Path,
    pub(crate) words: usize,
    /// The number of words in one result.
    width: usize,
    prepared: Box<dyn Prepared + 'e>,
}

/// Calls that are running.
#[must_use]
pub struct Running<'p> {
    caller: &'p Caller<'p>,
    started: Started<'p>,
    calls: usize,
    rows: Vec<u32>,
}

/// A borrowed view of the results of one dispatch.
#[derive(Clone, Copy)]
pub struct View<'r> {
    pub(crate) words: &'r [u32],
    /// The number of words from the start of one result to the start of the next.
    pub(crate) stride: usize,
    /// The number of words in one result.
    pub(crate) width: usize,
}

/// The results of one dispatch.
pub struct Results {
    words: Vec<u32>,
    stride: usize,
    width: usize,
}

impl<'e> Caller<'e> {
    /// Prepares a function on an executor, for up to `calls` calls in each dispatch.
    pub fn new(
        executor: &'e dyn Executor,
        probed: Cow<'e, Probed>,
        fixtures: &'e Fixtures,
        calls: usize,
    ) -> Result<Self, ProbeError> {
        let path = executor.path();
        let Function { name, bindings, .. } = &probed.function;
        super::expect_able(executor, name, &probed.program, bindings)?;
        let call = Call { probed: &probed, fixtures, cases: calls };
        let function = &probed.function;
        let (prepared, capacity) =
            path::caught(path, &[&function.name], Some(&function.span), || {
                let prepared = executor.prepare(&call)?;
                let capacity = prepared.capacity();
                Ok::<_, ProbeError>((prepared, capacity))
            })?;
        if capacity == 0 {
            let function = probed.function.name.clone();
            return Err(ProbeError::NoRoom { function, path });
        }
        let parameters = probe::parameter_shapes(&probed.function);
        let words = parameters.into_iter().map(|shape| shape.lanes().len()).sum();
        let width = probed.function.result.lanes().len();
        Ok(Self { probed, fixtures, path, words, width, prepared })
    }

    /// The largest number of calls in one dispatch.
    pub(crate) fn capacity(&self) -> usize {
        self.prepared.capacity()
    }

    /// Checks if the path stores texels as half floats.
    pub(crate) fn reads_half_floats(&self) -> bool {
        self.prepared.reads_half_floats()
    }

    /// Starts the calls of one dispatch. `rows` contains the arguments of all calls, one call after the other.
    pub(crate) fn start(&self, rows: &[u32], calls: usize) -> Result<Running<'_>, ProbeError> {
        let started = self.caught(|| self.prepared.start(calls, rows))?;
        Ok(Running { caller: self, started, calls, rows: rows.to_vec() })
    }

    fn caught<T>(&self, work: impl FnOnce() -> Result<T, ProbeError>) -> Result<T, ProbeError> {
        let Function { name, span, .. } = &self.probed.function;
        path::caught(self.path, &[name], Some(span), work)
    }

    /// Calls the function `calls` times, in several dispatches if necessary. Returns the results, one call after the
    /// other.
    ///
    /// # Panics
    /// Panics if the number of words in `rows` isn't right for `calls` calls.
    pub fn results(&self, rows: &[u32], calls: usize) -> Result<Vec<u32>, ProbeError> {
        assert_eq!(rows.len(), calls * self.words, "each call has all its arguments");
        let mut results = Vec::with_capacity(calls * self.width);
        for first in (0..calls).step_by(self.capacity()) {
            let count = self.capacity().min(calls - first);
            let rows = &rows[first * self.words..][..count * self.words];
            self.start(rows, count)?.view(|found| {
                (0..found.len()).for_each(|case| results.extend_from_slice(found.of(case)));
            })?;
        }
        Ok(results)
    }
}

impl Running<'_> {
    /// Waits for the results, and passes them to `read`.
    pub(crate) fn view<T>(self, mut read: impl FnMut(View<'_>) -> T) -> Result<T, ProbeError> {
        let Self { caller, started, calls, rows } = self;
        let Caller { width, path, .. } = *caller;
        let mut value = None;
        let mut view = |words: &[u32], stride: usize| {
            let (expected, found) = (calls * stride.max(width), words.len());
            value = Some(match found == expected && stride >= width {
                // The caller's `read` may panic. Such a panic isn't the path's fault, so Karat doesn't catch
                // it.
                true => Ok(panics::passing(|| read(View { words, stride, width }))),
                false => Err(ProbeError::Length { path, expected, found }),
            });
        };
        caller.caught(|| {
            let Err(error) = started(&mut view) else { return Ok(()) };
            let of = (&*caller.probed, caller.fixtures);
            let partial = left_open(of, (calls, &rows), error)?;
            view(&partial.words, partial.stride);
            Ok(())
        })?;
        value.unwrap_or(Err(ProbeError::Length { path, expected: calls * width, found: 0 }))
    }

    pub(crate) fn read(self) -> Result<Results, ProbeError> {
        self.view(|View { words, stride, width }| Results { words: words.to_vec(), stride, width })
    }
}

impl<'r> View<'r> {
    #[inline]
    pub(crate) fn len(self) -> usize {
        self.words.len() / self.stride.max(1)
    }

    #[inline]
    pub(crate) fn of(self, case: usize) -> &'r [u32] {
        &self.words[case * self.stride..][..self.width]
    }
}

impl Results {
    pub(crate) fn view(&self) -> View<'_> {
        View { words: &self.words, stride: self.stride, width: self.width }
    }

    pub(crate) fn of(&self, case: usize) -> &[u32] {
        self.view().of(case)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::package::Package;
    use crate::path::Adapter;
    use crate::probe::Partial;

    /// A driver that writes 7 into every word except the words with these indices. Each result takes three words.
    #[derive(Clone, Debug)]
    struct Dropping(Vec<usize>);

    impl Executor for Dropping {
        fn path(&self) -> Path {
            Path::VULKAN
        }

        fn adapter(&self) -> Adapter {
            unreachable!("no record is made")
        }

        fn prepare<'e>(&'e self, _: &Call<'_>) -> Result<Box<dyn Prepared + 'e>, ProbeError> {
            Ok(Box::new(self.clone()))
        }
    }

    impl Prepared for Dropping {
        fn capacity(&self) -> usize {
            2
        }

        fn start<'p>(&'p self, cases: usize, _: &[u32]) -> Result<Started<'p>, ProbeError> {
            let partial =
                Partial { words: vec![7; 3 * cases], stride: 3, unwritten: self.0.clone() };
            Ok(Box::new(move |read| {
                if partial.unwritten.is_empty() {
                    read(&partial.words, 3);
                    return Ok(());
                }
                let (count, words) = (partial.unwritten.len(), 2 * cases);
                Err(ProbeError::ResultNotWritten {
                    function: "open".to_owned(),
                    path: Path::VULKAN,
                    component: ".y".to_owned(),
                    first: 0,
                    count,
                    words,
                    partial: Box::new(partial),
                })
            }))
        }
    }

    /// Karat accepts an unwritten value only if WGSL sets no bounds for the value.
    // Lesson 174
    #[test]
    fn a_driver_may_leave_only_unbounded_results_unwritten() {
        let text = "fn open(a: f32, x: f32) -> vec2f { return vec2f(x, smoothstep(a, a, x)); }";
        let package = Package::from_source("open", text);
        let probed = Probed::new(&package, "open").expect("valid");
        let (fixtures, rows) = (Fixtures::new(), [1.0_f32, 2.0, 1.0, 3.0].map(f32::to_bits));
        let results = |unwritten: Vec<usize>, rows: &[u32]| {
            let driver = Dropping(unwritten);
            let caller = Caller::new(&driver, Cow::Borrowed(&probed), &fixtures, 2)?;
            caller.results(rows, rows.len() / 2)
        };
        // Three cases need two dispatches.
        let three = [&rows[..], &rows[..2]].concat();
        assert_eq!(results(vec![], &three).expect("all is written"), [7; 6]);
        assert_eq!(results(vec![1, 4], &rows).expect("each may be anything"), [7; 4]);
        for dropped in [vec![0], vec![3], vec![1, 3, 4]] {
            let error = results(dropped, &rows).expect_err("the first component is bounded");
            assert!(error.to_string().contains("the driver drops writes"), "{error}");
        }
    }

    #[test]
    #[should_panic(expected = "each call has all its arguments")]
    fn an_incomplete_row_of_arguments_panics() {
        let package = Package::from_source("m", "fn f(x: f32) -> vec2f { return vec2f(x); }");
        let probed = Probed::new(&package, "f").expect("valid");
        let (driver, fixtures) = (Dropping(vec![]), Fixtures::new());
        let caller = Caller::new(&driver, Cow::Owned(probed), &fixtures, 2).expect("ready");
        drop(caller.results(&[1, 2, 3], 2));
    }
}
