//! What a failed check says.

use std::fmt;

use super::tally::{Census, Judged};
use crate::diagnostic::Diagnostic;
use crate::path::Adapter;
use crate::reflect::Function;
use crate::value::{Scalar, Shape, format_f32, hexfloat};

/// A function disagrees with what was asserted of it, on at least one path.
///
/// `Display` shows the function in the author's file, the worst and the first failing case with
/// their inputs, and for each path a census and the command that replays it.
#[derive(Clone, Debug)]
pub struct Disagreement {
    /// The function.
    pub function: Function,
    /// The verb: `agrees_with`.
    pub check: &'static str,
    /// What it asserts: the tolerance, or the statement.
    pub assertion: String,
    /// Each path that disagrees.
    pub paths: Vec<PathDisagreement>,
    /// Paths that agree.
    pub agreeing: Vec<Adapter>,
    /// Seed of the cases.
    pub seed: u64,
}

/// The failures of one path.
#[derive(Clone, Debug)]
pub struct PathDisagreement {
    /// Path, adapter and driver.
    pub adapter: Adapter,
    /// How many failed, and how.
    pub census: Census,
    /// The case with the largest error.
    pub worst: CaseFailure,
    /// The failing case of the lowest index, if it is another one.
    pub first: Option<CaseFailure>,
    /// The command that runs the worst case again.
    pub replay: String,
}

/// One failing case.
#[derive(Clone, Debug)]
pub struct CaseFailure {
    /// Index of the case.
    pub case: u64,
    /// Each argument: its name, and its value as WGSL would write it.
    pub arguments: Vec<(String, String)>,
    /// The worst component: `""` for a scalar, `".y"`.
    pub component: String,
    /// Bits of the component's value.
    pub actual: u32,
    /// What was expected there; `None` if a predicate judged.
    pub expected: Option<f64>,
    /// Type of the component.
    pub scalar: Scalar,
    /// The whole result.
    pub result: String,
    /// The error in its unit, with what is allowed.
    pub error: String,
}

impl CaseFailure {
    pub(super) fn new(
        function: &Function,
        case: u64,
        arguments: &[u32],
        actual: &[u32],
        expected: Option<&[f64]>,
        judged: &Judged,
    ) -> Self {
        let mut rest = arguments;
        let arguments = function
            .parameters
            .iter()
            .map(|(name, shape)| {
                let (own, others) = rest.split_at(shape.lanes().len());
                rest = others;
                (name.clone(), shape.format(own))
            })
            .collect();
        let lane = judged.lane;
        let pick = |shape: &Shape| {
            let name = shape.lane_names().into_iter().nth(lane).unwrap_or_default();
            let scalar = shape.lanes().into_iter().nth(lane).unwrap_or(Scalar::F32);
            (name, scalar)
        };
        let (component, scalar) = pick(&function.result);
        let measure = judged.measure;
        let error = if !scalar.is_float() {
            "not equal".to_owned()
        } else if measure.error.is_nan() {
            "not a finite number".to_owned()
        } else {
            let bound = crate::tolerance::significant(measure.bound);
            format!("{measure} ({bound} allowed)")
        };
        Self {
            case,
            arguments,
            component,
            actual: actual.get(lane).copied().unwrap_or_default(),
            expected: expected.and_then(|expected| expected.get(lane)).copied(),
            scalar,
            result: function.result.format(actual),
            error,
        }
    }

    fn write(&self, f: &mut fmt::Formatter<'_>, title: &str) -> fmt::Result {
        writeln!(f, "  {title} (case {})", self.case)?;
        let names = self.arguments.iter().map(|(name, _)| name.len());
        let width = names.chain([8]).max().unwrap_or(8);
        for (name, value) in &self.arguments {
            writeln!(f, "    {name:>width$} = {value}")?;
        }
        writeln!(f, "    {:>width$} = {}", "returned", self.result)?;
        let place = if self.component.is_empty() {
            String::new()
        } else {
            format!("  at {}", self.component)
        };
        let actual = f32::from_bits(self.actual);
        match (self.expected, self.scalar.is_float()) {
            (Some(expected), true) => {
                #[expect(clippy::cast_possible_truncation, reason = "shown beside the f64")]
                let nearest = expected as f32;
                writeln!(
                    f,
                    "    {:>width$} = {} ({}){place}",
                    "actual",
                    format_f32(actual),
                    hexfloat(actual)
                )?;
                writeln!(
                    f,
                    "    {:>width$} = {} ({})  nearest f32 of {expected}",
                    "expected",
                    format_f32(nearest),
                    hexfloat(nearest)
                )?;
                writeln!(f, "    {:>width$} = {}", "error", self.error)
            }
            (Some(expected), false) => {
                let actual = crate::value::format_lane(self.scalar, self.actual);
                writeln!(f, "    {:>width$} = {actual}{place}", "actual")?;
                let expected = match self.scalar {
                    Scalar::Bool => (expected != 0.0).to_string(),
                    _ => expected.to_string(),
                };
                writeln!(f, "    {:>width$} = {expected}", "expected")
            }
            (None, _) => Ok(()),
        }
    }
}

impl fmt::Display for Disagreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let span = first_line(&self.function);
        let Self { check, assertion, .. } = self;
        let message = format!("`{}` fails {check}: {assertion}", self.function.path);
        let diagnostic = Diagnostic::new(message).at(span, "");
        writeln!(f, "{diagnostic}")?;
        for path in &self.paths {
            let Census { cases, failures, nan, infinite, wrong_sign, too_low, too_high } =
                path.census;
            writeln!(f, "\non {}", path.adapter)?;
            let share = 100.0 * failures as f64 / cases as f64;
            write!(f, "  {failures} of {cases} cases fail ({share:.3}%)")?;
            for (count, name) in [
                (nan, "NaN"),
                (infinite, "infinite"),
                (wrong_sign, "with the wrong sign"),
                (too_low, "too low"),
                (too_high, "too high"),
            ] {
                if count > 0 {
                    write!(f, ", {count} {name}")?;
                }
            }
            writeln!(f)?;
            path.worst.write(f, "worst")?;
            if let Some(first) = &path.first {
                first.write(f, "first")?;
            }
            writeln!(f, "  replay: {}", path.replay)?;
        }
        for adapter in &self.agreeing {
            writeln!(f, "\non {adapter}\n  all cases agree")?;
        }
        Ok(())
    }
}

/// The function's head: from `fn` to the end of its first line.
fn first_line(function: &Function) -> crate::diagnostic::Span {
    let mut span = function.span.clone();
    let text = span.file.text.get(span.range.clone()).unwrap_or_default();
    let head = text.find('\n').unwrap_or(text.len());
    span.range.end = span.range.start + text[..head].trim_end().len();
    span
}
