//! The steps of a call as a table: each row is an operation with its values in `f32`, in `f64` and in intervals.

use karat::unstable::trace::{Step, Value};
use karat::unstable::value::format_f32;
use serde::{Deserialize, Serialize};

/// The limit for the relative difference between the `f32` value and the `f64` value of an operation. Above this limit,
/// the `f32` value has lost half of its digits.
const LOST: f64 = 1.0 / 4096.0;

/// The text in place of a missing value. For example, the call in `f64` may skip an operation that the call in `f32`
/// runs, because the two calls take different branches.
const ELSEWHERE: &str = "not run";

/// An operation of a call.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Row {
    /// The source file that contains the operation.
    pub file: String,
    /// The number of the operation's line in this file, from 1.
    pub line: usize,
    /// The operation as the author wrote it, with the name of its `let`.
    pub operation: String,
    /// The values of the operation in `f32`.
    pub single: String,
    /// The values of the operation in `f64`.
    pub double: String,
    /// The range that WGSL allows for the values of the operation.
    pub allowed: String,
    /// `true` if an `f32` value isn't finite.
    pub is_strange: bool,
    /// `true` if the `f32` value has lost half of its digits, or if WGSL allows any value.
    pub has_lost: bool,
}

impl Row {
    /// Returns the file and the line.
    #[must_use]
    pub fn place(&self) -> String {
        format!("{}:{}", self.file, self.line)
    }
}

/// Converts the steps of a call into rows.
#[must_use]
pub fn rows(steps: &[Step]) -> Vec<Row> {
    let bounded = steps.iter().any(|step| !step.allowed.is_empty());
    let is_strange = |x: &Value| matches!(x, Value::Single(x) if !x.is_finite());
    let row = |step: &Step| {
        let [single, double, allowed] = columns(step, bounded);
        Row {
            file: step.span.file.name.clone(),
            line: step.span.file.line_column(step.span.range.start).0,
            operation: operation(step),
            single,
            double,
            allowed,
            is_strange: step.single.iter().any(is_strange),
            has_lost: has_lost(step) || step.allowed.iter().any(Option::is_none),
        }
    };
    steps.iter().map(row).collect()
}

fn has_lost(step: &Step) -> bool {
    let lost = |(x, y): (&Value, &Value)| {
        let (Value::Single(x), Value::Double(y)) = (x, y) else { return false };
        let error = (f64::from(*x) - y).abs();
        error > LOST * y.abs() && error > f64::from(f32::MIN_POSITIVE)
    };
    step.single.iter().zip(&step.double).any(lost)
}

/// Returns the values of a step in `f32` and in `f64`, and the allowed range.
fn columns(step: &Step, bounded: bool) -> [String; 3] {
    let joined = |values: Vec<String>, otherwise: &str| match values.as_slice() {
        [] => otherwise.to_owned(),
        _ => values.join(", "),
    };
    let range = |ends: &Option<(Value, Value)>| match ends {
        None => "anything".to_owned(),
        Some((lo, hi)) if lo == hi => format(lo),
        Some((lo @ Value::Bool(_), hi)) => format!("{} or {}", format(lo), format(hi)),
        Some((lo, hi)) => format!("{} to {}", format(lo), format(hi)),
    };
    [
        joined(step.single.iter().map(format).collect(), ELSEWHERE),
        joined(step.double.iter().map(format).collect(), ELSEWHERE),
        joined(
            step.allowed.iter().map(range).collect(),
            if bounded { ELSEWHERE } else { "not known" },
        ),
    ]
}

fn format(value: &Value) -> String {
    match value {
        Value::Single(x) => format_f32(*x),
        Value::Double(x) => format_f64(*x),
        Value::Int(x) => x.to_string(),
        Value::Bool(x) => x.to_string(),
    }
}

/// Returns the operation as the author wrote it, with the name of its `let`.
fn operation(step: &Step) -> String {
    let text = one_line(&step.text);
    step.name.as_ref().map_or_else(|| text.clone(), |name| format!("{name} = {text}"))
}

/// Formats a number with 12 significant digits. `f32` has about 7 digits, and `f64` about 16.
fn format_f64(x: f64) -> String {
    let rounded: f64 = format!("{x:.11e}").parse().unwrap_or(x);
    match rounded.abs() {
        size if size != 0.0 && !(1e-5..1e12).contains(&size) => format!("{rounded:e}"),
        _ => rounded.to_string(),
    }
}

fn one_line(text: &str) -> String {
    const MOST: usize = 64;
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    match line.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}...", &line[..end]),
        None => line,
    }
}
