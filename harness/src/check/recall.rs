//! What a session has failed on before, and what it will try again.

use super::path_tally::PathTally;
use super::session::Session;
use crate::domain::Held;
use crate::probe::Inputs;
use crate::run::{Descent, Entry};

impl Session<'_> {
    /// The inputs on which this check has failed before, as far as they still are in its domain.
    pub(super) fn remembered(&self) -> Vec<Vec<u32>> {
        let Some(memory) = self.memory else { return Vec::new() };
        let mut rows = Vec::new();
        for entry in memory.of(&self.called.function().name, &self.identity.check) {
            if self.inputs == Inputs::Constant && !self.is_constant(&entry.words) {
                continue; // WGSL has no such constant
            }
            if entry.words.len() != self.stream.width() {
                memory.ignore(entry, "the function takes other arguments now");
            } else if self.still_drawn(entry) {
                rows.push(entry.words.clone());
            } else {
                memory.ignore(entry, "it isn't in the domain any more");
            }
        }
        rows
    }

    /// Whether the domain has a value. One that can't tell has it if the value comes about in the
    /// same way as before.
    fn still_drawn(&self, entry: &Entry) -> bool {
        let again = || Some(self.descend(&entry.descent)?.row == entry.words);
        self.stream.admits(&entry.words).unwrap_or_else(|| again() == Some(true))
    }

    /// The cases of integrals that have failed before, which come about as they did then.
    pub(super) fn remembered_integrals(&self) -> Vec<(Descent, Held)> {
        let Some(memory) = self.memory else { return Vec::new() };
        let mut found = Vec::new();
        for entry in memory.of(&self.called.function().name, &self.identity.check) {
            match self.descend(&entry.descent) {
                Some(value) if entry.comment == format!("case = {}", value.shown()) => {
                    found.push((entry.descent.clone(), value));
                }
                _ => memory.ignore(entry, "it isn't in the domain any more"),
            }
        }
        found
    }

    /// Keeps what failed, reduced.
    pub(super) fn remember(&self, sum: &PathTally) {
        let (Some(memory), Some(simplest)) = (self.memory, &sum.simplest) else { return };
        if simplest.failure.remembered {
            return;
        }
        // An integral is told again by its case alone, not by the arguments that its nodes share.
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
