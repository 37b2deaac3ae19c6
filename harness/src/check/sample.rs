//! Stores the errors of some cases for reports. These cases come from the first batch, and include its worst
//! case.

use super::batch::Batch;
use crate::judge::{Picked, Tally};
use crate::record::{self, Errors, Plot};
use crate::value::{Scalar, Shape};

/// The approximate number of cases in a report's plots: enough to fill a heat map of 20 by 20 cells.
const CASES: usize = 512;

/// Some cases with their ratios. A ratio is an error divided by its tolerance.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    names: Vec<String>,
    scalars: Vec<Scalar>,
    rows: Vec<Vec<u32>>,
    ratios: Vec<f64>,
    /// The number of evenly spaced cases at the beginning of `rows` and `ratios`. The worst case and the first failing
    /// case follow.
    chosen: usize,
}

impl Sample {
    /// Selects the cases to keep: all failing cases of the first sampled batch. If Karat writes a record, also selects
    /// about `CASES` evenly spaced cases of this batch.
    pub(super) fn picked(batch: &Batch) -> Picked {
        if !batch.is_drawn || batch.first != 0 {
            return Picked::default();
        }
        let some =
            if record::wanted() { Picked::some(CASES, batch.cases) } else { Picked::default() };
        some.and_failing()
    }

    /// Stores the picked cases of a batch, its worst case and its first failing case. `None` if no case is picked.
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

fn named(name: &str, lanes: usize) -> Vec<String> {
    match lanes {
        1 => vec![name.to_owned()],
        2..=4 => "xyzw".chars().take(lanes).map(|lane| format!("{name}.{lane}")).collect(),
        _ => (0..lanes).map(|lane| format!("{name}[{lane}]")).collect(),
    }
}

impl Sample {
    pub(super) fn errors(&self) -> Errors {
        Errors::of(self.ratios.iter().take(self.chosen).copied())
    }

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
