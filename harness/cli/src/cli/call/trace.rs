//! `karat call --trace`: each intermediate beside its line.

use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

use anyhow::Context;
use karat::unstable::image::write_whole;
use karat::unstable::trace::{Step, Value};
use karat::unstable::value::format_f32;

use super::super::table::{BAD, DIM, KNOWN, PLAIN, Table};

/// A value that differs from the shadow by more than this has lost half of its digits.
const LOST: f64 = 1.0 / 4096.0;

/// Of an arithmetic in which a condition turned out otherwise, so that the operation wasn't run.
const ELSEWHERE: &str = "another way";

/// Prints the steps of a call.
pub(super) fn write_text(steps: &[Step], out: &mut dyn Write) -> anyhow::Result<()> {
    let bounded = are_bounded(steps);
    writeln!(out)?;
    let mut table = Table::new(&["place", "operation", "f32", "f64", "WGSL allows"], &[]);
    for step in steps {
        let style = match () {
            () if step.single.iter().any(|x| matches!(x, Value::Single(x) if !x.is_finite())) => {
                BAD
            }
            () if has_lost(step) || step.allowed.iter().any(Option::is_none) => KNOWN,
            () => PLAIN,
        };
        let [single, double, allowed] = columns(step, bounded);
        table.row(style, vec![place(step), operation(step), single, double, allowed]);
    }
    table.write(out)?;
    if steps.is_empty() {
        writeln!(out, "{DIM}it computes nothing{DIM:#}")?;
    }
    Ok(())
}

/// Writes the steps as a page, each below its line of the source.
pub(super) fn write_html(name: &str, steps: &[Step], file: &Path) -> anyhow::Result<()> {
    let bounded = are_bounded(steps);
    let mut page = String::from(HEAD);
    writeln!(page, "<title>{}</title><h1>{}</h1>", html(name), html(name))?;
    let mut files: Vec<&karat::unstable::diagnostic::SourceFile> = Vec::new();
    for step in steps {
        if files.iter().all(|file| file.name != step.span.file.name) {
            files.push(&step.span.file);
        }
    }
    for source in files {
        writeln!(page, "<h2>{}</h2><table>", html(&source.name))?;
        writeln!(page, "<tr><th><th>operation<th>f32<th>f64<th>WGSL allows")?;
        let own = || steps.iter().filter(|step| step.span.file.name == source.name);
        /// Lines of the source about one that computes.
        const ABOUT: usize = 3;
        let mut gap = false;
        for (index, text) in source.text.lines().enumerate() {
            let number = index + 1;
            if !own().any(|step| line(step).abs_diff(number) <= ABOUT) {
                gap = true;
                continue;
            }
            if std::mem::take(&mut gap) {
                writeln!(page, "<tr><td>\u{22ee}")?;
            }
            writeln!(page, "<tr class=source><td>{number}<td colspan=4><pre>{}</pre>", html(text))?;
            for step in own().filter(|step| line(step) == number) {
                let class = if has_lost(step) { "lost" } else { "step" };
                let cells =
                    columns(step, bounded).map(|cell| format!("<td>{}", html(&cell))).concat();
                writeln!(page, "<tr class={class}><td><td>{}{cells}", html(&operation(step)))?;
            }
        }
        writeln!(page, "</table>")?;
    }
    write_whole(file, page.as_bytes()).with_context(|| format!("can't write `{}`", file.display()))
}

const HEAD: &str = "<!doctype html><meta charset=utf-8><meta name=viewport content='width=device-width'>\
    <style>:root{color-scheme:light dark}body{font:14px/1.5 system-ui;margin:2rem}\
    table{border-collapse:collapse}td,th{padding:.1rem .8rem;vertical-align:top;text-align:left}pre{margin:0}\
    td:first-child{color:gray;text-align:right}.step td,.lost td{font-family:ui-monospace,monospace;\
    font-size:12px;background:#8881}.lost td{background:#e803}</style>\n";

fn html(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

fn line(step: &Step) -> usize {
    step.span.file.line_column(step.span.range.start).0
}

/// The file and the line.
fn place(step: &Step) -> String {
    format!("{}:{}", step.span.file.name, line(step))
}

fn has_lost(step: &Step) -> bool {
    let lost = |(x, y): (&Value, &Value)| {
        let (Value::Single(x), Value::Double(y)) = (x, y) else { return false };
        let error = (f64::from(*x) - y).abs();
        error > LOST * y.abs() && error > f64::from(f32::MIN_POSITIVE)
    };
    step.single.iter().zip(&step.double).any(lost)
}

/// Whether it is known what WGSL allows.
fn are_bounded(steps: &[Step]) -> bool {
    steps.iter().any(|step| !step.allowed.is_empty())
}

/// The values of a step in `f32`, in `f64`, and what is allowed.
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

/// An operation as the author wrote it, with the name that a `let` gives it.
fn operation(step: &Step) -> String {
    let text = one_line(&step.text);
    step.name.as_ref().map_or_else(|| text.clone(), |name| format!("{name} = {text}"))
}

/// A number to 12 significant digits, more than half of what `f64` has beyond `f32`.
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
