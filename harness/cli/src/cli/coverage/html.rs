//! Writes an HTML page with the coverage of all files. A click on a line shows the tests that run this line.

use std::path::Path;

use anyhow::Context;
use karat::unstable::diagnostic::shown;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::union::{File, Line, Sum, Union, word};

/// The largest number of tests that the page lists for a line.
const SHOWN: usize = 20;

pub(super) fn page(union: &Union) -> anyhow::Result<String> {
    let mut files = Vec::new();
    for (file, own) in union.files() {
        let text = std::fs::read_to_string(file)
            .with_context(|| format!("can't read `{}`", file.display()))?;
        files.push((file, own, text));
    }
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width";
                title { "Coverage of shaders" }
                style { (PreEscaped(include_str!("coverage.css"))) }
            }
            body {
                h1 { "Coverage of shaders" }
                p { (union.sum()) "." }
                (summary(union))
                p.key {
                    span.run { "runs" } " " span.weak { "runs, but no test checks the value of this line" } " "
                    span.never { "no test runs this line" } " " span.part { "runs, but some branches of this line are never taken" } " "
                    span.unmeasured { "not measured: this line ran only in frames or on drivers" }
                }
                @for (number, (file, own, text)) in files.iter().enumerate() {
                    h2 id={ "file" (number) } { (shown(file)) }
                    (listing(own, text))
                }
            }
        }
    };
    Ok(page.into_string())
}

fn summary(union: &Union) -> Markup {
    let row = |number: usize, file: &Path, sum: Sum| {
        html! {
            tr {
                td { a href={ "#file" (number) } { (shown(file)) } }
                td { (Sum::share(sum.ran, sum.lines - sum.unmeasured)) }
                td { (Sum::share(sum.taken, sum.ways)) }
                td { (Sum::share(sum.called, sum.functions)) }
                td { (sum.weak) }
                td { (sum.unmeasured) }
            }
        }
    };
    html! {
        table {
            tr { th { "file" } th { "lines" } th { "outcomes" } th { "functions" } th { "not checked" } th { "not measured" } }
            @for (number, (file, own)) in union.files().enumerate() { (row(number, file, own.sum())) }
        }
    }
}

fn listing(own: &File, text: &str) -> Markup {
    let lines = own.lines();
    html! {
        div.listing {
            @for (index, line) in text.lines().enumerate() {
                @match lines.get(&(index + 1)) {
                    None => div.line { (number(index + 1, None)) code { (line) } },
                    Some(known) => details.line.(class(known)) {
                        summary { (number(index + 1, known.measured.then_some(known.count))) code { (line) } }
                        (who(known))
                    },
                }
            }
        }
    }
}

fn number(number: usize, count: Option<u64>) -> Markup {
    html! {
        span.number { (number) }
        span.count { @if let Some(count) = count { (count) } }
    }
}

fn class(line: &Line<'_>) -> &'static str {
    let mut ways = line.seen.iter().flat_map(|seen| seen.sum.ways());
    match line {
        line if !line.measured => "unmeasured",
        line if line.count == 0 => "never",
        line if line.weak => "weak",
        _ if ways.any(|(_, count)| count == 0) => "part",
        _ => "run",
    }
}

/// Lists the sides of a line's branches, each with its count, and the tests that run the line, each with its first
/// input.
fn who(line: &Line<'_>) -> Markup {
    let came = line.seen.iter().max_by_key(|seen| seen.tests.len());
    let tests = came.map(|seen| &seen.tests);
    html! {
        ul {
            @for seen in &line.seen {
                @if seen.sum.ways().next().is_some() {
                    li {
                        code { (word(seen.sum.kind)) }
                        @for (way, count) in seen.sum.ways() {
                            " " span.(if count == 0 { "never" } else { "run" }) { (way) ": " (count) }
                        }
                    }
                }
            }
            @if let Some(tests) = tests {
                @for (test, came) in tests.iter().take(SHOWN) {
                    li { (test) ": " (came.count) @if let Some(input) = &came.input { ", first for " code { (input) } } }
                }
                @if tests.len() > SHOWN { li { "and " (tests.len() - SHOWN) " more tests" } }
                @if tests.is_empty() { li { "no test runs this line" } }
            }
        }
    }
}
