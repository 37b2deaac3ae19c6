//! Compares the results of passes with a golden: a table of accepted elements.

use std::panic::Location;

use super::judge::{Assertion, Expected};
use super::{After, ComputeAgreement, ComputeError, words};
use crate::diagnostic::text_hash;
use crate::dispatch::{DispatchError, Passes};
use crate::executor::{self, Executor};
use crate::golden::{Column, Goldens, Made, Table, other_columns};
use crate::run::{Identity, Replayed, or_panic};
use crate::tolerance::Tolerance;
use crate::value::Shape;

impl After<'_> {
    /// Compares the elements with their golden, within a tolerance. The golden is the file `golden/<case>.csv`, with a
    /// row for each element. Use a golden for passes that have no reference.
    ///
    /// ```no_run
    /// # use karat::{Goldens, prelude::*};
    /// # static SHADERS: Package = karat::package!("shaders");
    /// static GOLDEN: Goldens = karat::goldens!("golden");
    ///
    /// SHADERS
    ///     .compute()
    ///     .with("particles", karat::fixture::Buffer::zeros(1024))
    ///     .dispatch("particles::spawn", [1, 1, 1])
    ///     .after("particles")
    ///     .matches(&GOLDEN, "particles/spawned", Rel(1e-5).or(Abs(1e-6)));
    /// ```
    ///
    /// # Panics
    /// Panics if an element differs, or the golden doesn't exist.
    #[track_caller]
    pub fn matches(
        self,
        goldens: &Goldens,
        case: &str,
        tolerance: impl Into<Tolerance>,
    ) -> ComputeAgreement {
        or_panic(self.try_matches(goldens, case, tolerance))
    }

    /// Runs [`matches`](Self::matches), but returns the error instead of panicking.
    ///
    /// # Errors
    /// Returns an error if an element differs, or the golden doesn't exist.
    #[track_caller]
    pub fn try_matches(
        self,
        goldens: &Goldens,
        case: &str,
        tolerance: impl Into<Tolerance>,
    ) -> Result<ComputeAgreement, ComputeError> {
        let tolerance = tolerance.into();
        let text = format!("golden `{case}`, {tolerance}");
        self.report(("matches", text), Location::caller(), |report| {
            report.read.extend(goldens.values_read(case));
            let golden = goldens.table(case)?;
            let passes = self.compute.passes()?;
            report.read.extend(passes.read());
            let (part, shape) = passes.written(&self.variable)?;
            let element = match shape {
                Shape::Array { element, .. } => *element,
                whole => whole,
            };
            let executors = self.executors()?;
            // Accepting the result makes these elements the path's next golden.
            let made = |executor: &dyn Executor| {
                let adapter = executor::adapter(executor);
                let words = words(executor, &passes, &part)?;
                let table = Table { columns: self.columns(&element), arguments: 0, words };
                Ok::<_, DispatchError>((table, adapter))
            };
            let first = || {
                let canonical = |executor: &&&dyn Executor| {
                    executor.path() == crate::Path::CPU
                        || executor::adapter(**executor).is_lavapipe()
                };
                let first = executors.iter().find(canonical).or(executors.first());
                made(*first.expect("some path is selected"))
            };
            let left = |(table, adapter), how: Option<(&Table, &str)>| {
                let tolerance = tolerance.to_string();
                let (shader, modules) = (shader(&passes), passes.modules());
                let made = Made { table, adapter: &adapter, shader, modules, tolerance };
                match how {
                    Some((golden, how)) => goldens.unlike_golden(case, &made, golden, how),
                    None => goldens.without_golden(case, &made),
                }
            };
            let Some(golden) = golden else {
                let function = self.last_entry_point();
                let identity = Identity::of(function, &self.check("matches"))?;
                let replayed = Replayed { case: 0, steps: &[], input: None };
                let again = identity.replay(None, 0, function, &identity.check, replayed);
                self.expect_each_order(None, &passes, report, &again)?;
                return Err(left(first()?, None).into());
            };
            // The verdict below reports an error of the first path.
            if let Ok((now, adapter)) = first() {
                let count = (golden.len() != now.len()).then(|| {
                    format!(
                        "the golden has {} elements, but the result has {}",
                        golden.len(),
                        now.len()
                    )
                });
                if let Some(how) = other_columns(&golden, &now).or(count) {
                    return Err(left((now, adapter), Some((&golden, &how))).into());
                }
            }
            let scalars = golden.columns.iter().map(|column| column.scalar).cycle();
            let cells = golden.rows().flatten();
            let lanes = scalars.zip(cells).map(|(scalar, word)| scalar.decode(*word)).collect();
            let expected = Expected { shape: element.clone(), lanes };
            // Writes the elements of the first path, which differ from the golden, into a file for review.
            let with_golden = |failure: ComputeError| {
                let ComputeError::Differs(difference) = failure else { return Ok(failure) };
                let Some(path) = difference.paths.first() else {
                    return Ok(ComputeError::Differs(difference));
                };
                let differing =
                    |executor: &&&dyn Executor| executor::adapter(**executor) == path.adapter;
                let now = executors.iter().find(differing).map_or_else(first, |own| made(*own))?;
                let (elements, failures) = (path.elements, path.census.failures);
                let how = format!("{failures} of {elements} elements on {}", path.adapter.path);
                let cause = Box::new(left(now, Some((&golden, &how))));
                Ok::<_, ComputeError>(ComputeError::Golden { difference: Some(difference), cause })
            };
            match self.judged(&Assertion::Agrees(expected, tolerance.clone()), "matches", report) {
                Ok(agreement) => {
                    goldens.values_agree(case);
                    Ok(agreement)
                }
                Err(ComputeError::Paths(mut paths)) => {
                    let failures = std::mem::take(&mut paths.failures).into_iter();
                    paths.failures = failures.map(with_golden).collect::<Result<_, _>>()?;
                    Err(ComputeError::Paths(paths))
                }
                Err(failure) => Err(with_golden(failure)?),
            }
        })
    }

    fn columns(&self, element: &Shape) -> Vec<Column> {
        let lanes = element.lane_names().into_iter().zip(element.lanes());
        let named = |lane: String| format!("{}{lane}", self.variable);
        lanes.map(|(lane, scalar)| Column { name: named(lane), scalar }).collect()
    }
}

fn shader(passes: &Passes) -> String {
    let texts = passes.passes.iter().map(|pass| pass.program.text());
    text_hash(texts.collect::<String>().as_bytes())
}
