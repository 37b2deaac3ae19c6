//! Remembered inputs: a check runs the inputs of its earlier failures again.

use super::path_tally::PathTally;
use super::session::Session;
use crate::domain::Held;
use crate::probe::Inputs;
use crate::run::{Descent, Entry};

impl Session<'_> {
    /// The failing inputs of earlier runs that are still in the check's domain.
    pub(super) fn remembered(&self) -> Vec<Vec<u32>> {
        let Some(memory) = self.memory else { return Vec::new() };
        let mut rows = Vec::new();
        for entry in memory.of(&self.called.function().name, &self.identity.check) {
            if self.inputs == Inputs::Constant && !self.is_constant(&entry.words) {
                continue; // WGSL can't write these values as constants
            }
            if entry.words.len() != self.stream.width() {
                memory.ignore(entry, "the function takes other arguments now");
            } else if self.still_drawn(entry) {
                rows.push(entry.words.clone());
            } else {
                memory.ignore(entry, "the domain doesn't contain this input now");
            }
        }
        rows
    }

    /// Checks if the domain still contains the stored value. If `admits` returns `None`, repeats the sampling and
    /// simplification that gave the value, and checks that the result is the same.
    fn still_drawn(&self, entry: &Entry) -> bool {
        let again = || Some(self.descend(&entry.descent)?.row == entry.words);
        self.stream.admits(&entry.words).unwrap_or_else(|| again() == Some(true))
    }

    /// The cases of integrals that failed earlier. Repeats the sampling and simplification of each stored case. Leaves
    /// out a case if its value is no longer the stored value.
    pub(super) fn remembered_integrals(&self) -> Vec<(Descent, Held)> {
        let Some(memory) = self.memory else { return Vec::new() };
        let mut found = Vec::new();
        for entry in memory.of(&self.called.function().name, &self.identity.check) {
            match self.descend(&entry.descent) {
                Some(value) if entry.comment == format!("case = {}", value.shown()) => {
                    found.push((entry.descent.clone(), value));
                }
                _ => memory.ignore(entry, "the domain doesn't contain this input now"),
            }
        }
        found
    }

    pub(super) fn remember(&self, sum: &PathTally) {
        let (Some(memory), Some(simplest)) = (self.memory, &sum.simplest) else { return };
        if simplest.failure.remembered {
            return;
        }
        // Only the case identifies an integral, not the arguments that have the same value at its nodes.
        let told = if simplest.failure.integral.is_some() { 1 } else { usize::MAX };
        let arguments: Vec<String> = simplest
            .failure
            .arguments
            .iter()
            .take(told)
            .map(|(name, value)| format!("{name} = {value}"))
            .collect();
        memory.keep(&Entry {
            function: self.called.function().name.clone(),
            check: self.identity.check.clone(),
            path: sum.path.name().to_owned(),
            words: simplest.input.clone(),
            descent: simplest.descent.clone(),
            comment: arguments.join(", "),
        });
    }
}
