//! Explains why two columns differ: finds the simplest input, and the first let-binding whose value differs.

use std::borrow::Cow;

use karat::fixture::Address;
use karat::unstable::executor::{self, Caller};
use karat::unstable::probe::{Let, Probed, lets};
use serde::Serialize;

use super::Request;
use super::excerpt::definition_line;
use super::execute::{Judge, Ran, shown};
use super::leeway::Leeway;
use super::reduce::{Case, Pair};
use crate::made_up::{self, Ranges};

/// A difference between two columns.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Divergence {
    /// The column with which this column is compared.
    pub baseline: String,
    /// The arguments of the simplest input, with their names.
    pub arguments: Vec<(String, String)>,
    /// The result on this column, as text.
    pub here: String,
    /// The result on the baseline, as text.
    pub there: String,
    /// The arguments as 32-bit words, as the kernel reads them.
    pub words: Vec<u32>,
    /// The results as 32-bit words, from this column and from the baseline.
    pub results: (Vec<u32>, Vec<u32>),
    /// `true` if the columns also differ when this input runs alone. Otherwise, a result depends on other inputs of the
    /// same run: some drivers use one invocation's texture level for all invocations.
    pub alone: bool,
    /// The first let-binding of the function whose value differs. `None` if all values agree. In this case, the results
    /// differ because of the `return` expression or of a value without a `let`.
    pub first: Option<Intermediate>,
    /// The let-bindings before `first` that can't be compared: pointers, bindings in the head of a `for`, NaN or
    /// infinite values, and bindings after the first 48.
    pub unseen: Vec<String>,
}

/// A let-binding whose value differs.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Intermediate {
    /// The binding's name.
    pub name: String,
    /// The binding's position in the author's file.
    pub location: Option<String>,
    /// The binding's line in the author's file.
    pub line: Option<usize>,
    /// The binding's value on this column.
    pub here: String,
    /// The binding's value on the baseline.
    pub there: String,
    /// `true` if the binding is in a loop. The compared values are those of the loop's last iteration. They may differ
    /// because another binding had a different value in an earlier iteration.
    pub in_loop: bool,
    /// The binding's line in this column's translation.
    pub text_line: Option<usize>,
}

impl Divergence {
    /// Describes the difference in one or two sentences.
    #[must_use]
    pub fn sentence(&self, column: &str) -> String {
        let named: Vec<String> =
            self.arguments.iter().map(|(name, value)| format!("{name} = {value}")).collect();
        let Self { baseline, here, there, .. } = self;
        let at = if named.is_empty() { String::new() } else { format!("at {} ", named.join("; ")) };
        let mut text = format!("{at}`{column}` returns {here}, and `{baseline}` returns {there}");
        if !self.alone {
            text += "; if this input runs without other inputs, both columns return the same result: a driver \
                     mixes up inputs that run together";
        }
        if let Some(Intermediate { name, location, here, there, in_loop, .. }) = &self.first {
            let place = location.as_ref().map_or_else(String::new, |at| format!(" ({at})"));
            let last = if *in_loop { " in the last iteration of its loop" } else { "" };
            text += &format!(
                "; the first variable that differs is `{name}`{place}{last}: {here} on `{column}`, and {there} on `{baseline}`"
            );
        }
        if !self.unseen.is_empty() {
            text += &format!(" (not compared: `{}`)", self.unseen.join("`, `"));
        }
        text
    }
}

/// Explains a case that differs between two columns. `text` has the translation of the second column, and the
/// function's first and last line in it.
pub(super) fn divergence(
    request: &Request,
    probed: &Probed,
    rows: &[u32],
    (first, other): (&Ran<'_>, &Ran<'_>),
    case: usize,
    (pair, beyond): (&Pair<'_, '_>, Address),
    text: Option<(&str, (usize, usize))>,
) -> Divergence {
    let function = probed.function();
    let Pair { arguments, results, .. } = *pair;
    let of = |words: &[u32], width: usize| words[case * width..][..width].to_vec();
    let seen = Case {
        row: of(rows, arguments.len()),
        expected: of(&first.results, results.len()),
        actual: of(&other.results, results.len()),
    };
    let reduced = pair.reduce(&seen);
    let alone = reduced.is_some();
    let Case { row, expected, actual } = reduced.unwrap_or(seen);
    let mut at = 0;
    let named = function.parameters.iter().map(|(name, shape)| {
        let count = shape.lanes().len();
        at += count;
        (name.clone(), shown(&arguments[at - count..at], &row[at - count..at]))
    });
    let named = named.collect();
    let (mut found, mut unseen) = (None, Vec::new());
    // Let-bindings are compared only if the input differs without other inputs.
    for one in if alone { lets(probed) } else { Vec::new() } {
        match differing(request, (&one, beyond), &row, (&first.caller, &other.caller), text) {
            Ok(None) => {}
            Ok(Some(differing)) => {
                found = Some(differing);
                break;
            }
            Err(Unseen) => unseen.push(one.name),
        }
    }
    Divergence {
        baseline: request.columns[first.column].to_string(),
        arguments: named,
        here: shown(results, &actual),
        there: shown(results, &expected),
        words: row,
        results: (actual, expected),
        alone,
        first: found,
        unseen,
    }
}

/// A let-binding that can't be compared.
struct Unseen;

fn differing(
    request: &Request,
    (one, beyond): (&Let, Address),
    row: &[u32],
    (first, other): (&Caller<'_>, &Caller<'_>),
    text: Option<(&str, (usize, usize))>,
) -> Result<Option<Intermediate>, Unseen> {
    let probed = one.probed.as_ref().ok_or(Unseen)?;
    let ranges = Ranges::of(&request.package).map_err(|_| Unseen)?;
    let fixtures = made_up::fixtures(probed, &ranges, beyond).map_err(|_| Unseen)?;
    let value = |caller: &Caller<'_>| {
        let executor = executor::of(caller.path).map_err(|_| Unseen)?;
        let caller = Caller::new(executor, Cow::Borrowed(probed), &fixtures, 1);
        caller.and_then(|caller| caller.results(row, 1)).map_err(|_| Unseen)
    };
    let (there, here) = (value(first)?, value(other)?);
    let scalars = probed.function().result.lanes();
    let judge = Judge::new(&scalars, &request.within, &there);
    let latitude = Leeway::of(probed, &fixtures).at(row, 1);
    let seen = judge.case(&there, &here, latitude.as_ref().map(|all| all.case(0, scalars.len())));
    if there == here || (seen.compared && !seen.differs) {
        return Ok(None);
    }
    if !seen.compared {
        // WGSL leaves the value open, so columns may differ.
        return Err(Unseen);
    }
    let line = one.span.as_ref().map(|span| span.file.line_column(span.range.start).0);
    let defined = |(text, lines)| definition_line(text, lines, &one.name, one.of_name);
    Ok(Some(Intermediate {
        name: one.name.clone(),
        location: one.span.as_ref().map(ToString::to_string),
        line,
        in_loop: one.repeats,
        here: shown(&scalars, &here),
        there: shown(&scalars, &there),
        text_line: text.and_then(defined),
    }))
}
