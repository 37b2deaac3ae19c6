//! Arguments as people read them.

use crate::reflect::Function;

/// Splits the words of all arguments by the function's parameters: names and texts.
#[must_use]
pub fn arguments(function: &Function, mut words: &[u32]) -> Vec<(String, String)> {
    let mut arguments = Vec::new();
    for (name, shape) in &function.parameters {
        let (own, others) = words.split_at(shape.lanes().len());
        words = others;
        arguments.push((name.clone(), shape.format(own)));
    }
    arguments
}
