//! Cases whose errors are kept for reports: some of the first batch, and the worst of it.

use super::batch::Batch;
use crate::judge::{Picked, Tally};
use crate::record::{self, Errors, Plot};
use crate::value::{Scalar, Shape};

/// Cases that a distribution and a plot are made of: enough for a map of 20 by 20 fields.
const CASES: usize = 512;

/// Errors of some cases, each divided by its bound.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    names: Vec<String>,
    scalars: Vec<Scalar>,
    rows: Vec<Vec<u32>>,
    ratios: Vec<f64>,
    /// Where the worst cases begin, which were not chosen blindly.
    chosen: usize,
}

impl Sample {
    /// Which cases of a batch are to be kept: of the first one that was drawn, those that fail, and some for
    /// the record where one is kept.
    pub(super) fn picked(batch: &Batch) -> Picked {
        if !batch.is_drawn || batch.first != 0 {
            return Picked::default();
        }
        let some =
            if record::wanted() { Picked::some(CASES, batch.cases) } else { Picked::default() };
        some.and_failing()
    }

    /// The cases of a batch that were picked, of a function with these parameters.
    pub(super) fn of(
        parameters: &[(String, Shape)],
        batch: &Batch,
        tally: &Tally,
        picked: Picked,
    ) -> Option<Self> {
        if picked.ratios.is_empty() {
            return None;
        }
        let chosen = picked.ratios.len();
        let shown = [tally.worst, tally.first].into_iter().flatten();
        let shown = shown.filter_map(|shown| {
            Some((usize::try_from(shown.case).ok()?, shown.judged.measure.ratio))
        });
        let cases: Vec<(usize, f64)> = picked.ratios.into_iter().chain(shown).collect();
        Some(Self {
            names: parameters
                .iter()
                .flat_map(|(name, shape)| named(name, shape.lanes().len()))
                .collect(),
            scalars: parameters.iter().flat_map(|(_, shape)| shape.lanes()).collect(),
            rows: cases.iter().map(|(case, _)| batch.arguments(*case).to_vec()).collect(),
            ratios: cases.iter().map(|(_, ratio)| *ratio).collect(),
            chosen,
        })
    }
}

/// The lanes of an argument.
fn named(name: &str, lanes: usize) -> Vec<String> {
    match lanes {
        1 => vec![name.to_owned()],
        2..=4 => "xyzw".chars().take(lanes).map(|lane| format!("{name}.{lane}")).collect(),
        _ => (0..lanes).map(|lane| format!("{name}[{lane}]")).collect(),
    }
}

impl Sample {
    /// How large the errors are.
    pub(super) fn errors(&self) -> Errors {
        Errors::of(self.ratios.iter().take(self.chosen).copied())
    }

    /// The errors over the arguments.
    pub(super) fn plot(&self) -> Plot {
        let row = |(row, ratio): (&Vec<u32>, &f64)| {
            let lanes = self.scalars.iter().zip(row);
            let values = lanes.map(|(scalar, word)| scalar.decode(*word));
            values.chain([*ratio]).collect()
        };
        Plot {
            arguments: self.names.clone(),
            rows: self.rows.iter().zip(&self.ratios).map(row).collect(),
        }
    }
}
