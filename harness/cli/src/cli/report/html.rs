//! One page for a run: self-contained, so that it opens from a file wherever it is sent.

mod plot;

use std::collections::BTreeSet;

use karat::record::{Errors, PathRecord, Record, Run, Subject, Verdict};
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::tables::{is_failure, share};
use super::{message, replay, subject};

const STYLE: &str = include_str!("html/report.css");
const SCRIPT: &str = include_str!("html/report.js");

/// The page of a run. `untested` are functions without a test; `review` is where the page of frames is.
pub(super) fn page(
    records: &[Record],
    run: Option<&Run>,
    untested: Option<&[String]>,
    review: Option<&str>,
) -> String {
    let passed = run.is_some_and(|run| run.passed) && !records.iter().any(is_failure);
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "Karat: " (if passed { "passed" } else { "failed" }) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                (head(records, run, passed))
                main {
                    (failures(records))
                    (functions(records))
                    (frames(records, review))
                    (without_tests(untested))
                }
                script { (PreEscaped(SCRIPT)) }
            }
        }
    };
    page.into_string()
}

/// The verdict, what ran, and what searches.
fn head(records: &[Record], run: Option<&Run>, passed: bool) -> Markup {
    let failed = records.iter().filter(|record| is_failure(record)).count();
    let known = records.iter().filter(|record| record.verdict == Verdict::KnownIssue).count();
    let paths = || records.iter().flat_map(|record| &record.paths);
    let cases: u64 = paths().map(|path| path.cases).sum();
    let adapters: BTreeSet<String> = paths().map(|path| path.adapter.to_string()).collect();
    let started =
        records.iter().filter_map(|record| record.time.as_ref()).map(|time| &time.started);
    let overlays: BTreeSet<_> = records.iter().filter_map(|r| r.overlay.as_ref()).collect();
    html! {
        header {
            h1 class=(if passed { "pass" } else { "fail" }) {
                (if passed { "passed" } else { "failed" })
            }
            p {
                (records.len()) " checks, " (failed) " failed"
                @if known > 0 { ", " (known) " known issues" }
                ", " (cases) " cases compared"
                @if let Some(started) = started.min() { ", begun " time { (started) } }
            }
            @match run {
                None => p class="fail" { "The record doesn't say that its run ended: tests may be missing." },
                Some(run) if !run.selected.is_empty() => p { "Only: " (run.selected.join(" ")) },
                Some(run) if !run.passed && failed == 0 => {
                    p class="fail" { "A test failed outside of Karat's checks." }
                }
                Some(_) => {}
            }
            @for overlay in overlays {
                p class="fail" { "With KARAT_OVERLAY=" (overlay) ": not the modules of the packages." }
            }
            ul class="adapters" { @for adapter in &adapters { li { (adapter) } } }
            label { "Search " input id="search" type="search" placeholder="words of a name, path or message"; }
            label { input id="failing" type="checkbox"; " only what fails" }
            p id="none" hidden { "Nothing has all of these words." }
        }
    }
}

/// A name that addresses can end with: `#brdf::schlick-agrees_with-schlick_matches`.
fn anchor(record: &Record) -> String {
    let name = format!("{}-{}", subject(record), record.test);
    name.chars().map(|c| if c.is_alphanumeric() || ":_-".contains(c) { c } else { '-' }).collect()
}

fn failures(records: &[Record]) -> Markup {
    let failing: Vec<&Record> = records.iter().filter(|record| is_failure(record)).collect();
    html! {
        @if !failing.is_empty() {
            section {
                h2 { "What fails" }
                @for record in failing {
                    article class="row failing" id=(anchor(record)) {
                        h3 { a href={ "#" (anchor(record)) } { (subject(record)) } " " small { (record.test) } }
                        @if let Some(message) = message(record) { pre { (message) } }
                        @if let Some(replay) = replay(record) {
                            p { button type="button" data-copy=(replay) { "Copy the replay command" } }
                        }
                        @for path in &record.paths {
                            @if let Some(plot) = &path.plot {
                                (plot::figures(plot, &path.adapter.path, &path.asserted))
                            }
                        }
                    }
                }
            }
        }
    }
}

/// A path's worst error beside its bound, with how errors are distributed.
fn cell(path: &PathRecord) -> Markup {
    let class = match (&path.known_issue, path.failures == 0 && path.cases > 0) {
        (None, true) => "pass",
        (Some(_), false) => "known",
        _ => "fail",
    };
    html! {
        td class=(class) title={ (path.adapter) "; " (path.asserted) } {
            span class="path" { (path.adapter.path) }
            " " b { (path.worst) }
            @let share = share(path);
            @if !share.is_empty() { " " span class="share" { (share) } }
            @if path.failures > 0 { " " span class="count" { (path.failures) " of " (path.cases) } }
            @else { " " span class="count" { (path.cases) } }
            @if let Some(reason) = &path.known_issue { " " i { (reason) } }
            @if let Some(errors) = &path.errors { (distribution(errors)) }
        }
    }
}

/// Bars of how many cases have which error, by powers of two of its bound.
fn distribution(errors: &Errors) -> Markup {
    const LEAST: i32 = -12;
    const MOST: i32 = 4;
    let within = |power: i32| {
        let range = errors.powers.iter().filter(|(k, _)| (**k).clamp(LEAST, MOST) == power);
        range.map(|(_, count)| count).sum::<u64>()
    };
    let bars: Vec<(String, u64, bool)> = [("exact".to_owned(), errors.exact, false)]
        .into_iter()
        .chain((LEAST..=MOST).map(|power| {
            let word = if power == MOST { "above" } else { "up to" };
            let of = if power == MOST { power - 1 } else { power };
            (format!("{word} 2^{of} of the bound"), within(power), power > 0)
        }))
        .chain([("not finite".to_owned(), errors.not_finite, true)])
        .collect();
    let most = bars.iter().map(|(_, count, _)| *count).max().unwrap_or(0).max(1);
    // So that a single case is still seen among hundreds.
    #[expect(clippy::cast_precision_loss, reason = "pixels")]
    let height = |count: u64| 20.0 * ((1 + count) as f64).ln() / ((1 + most) as f64).ln();
    html! {
        svg class="bars" width="114" height="22" role="img"
            aria-label={ "errors of " (errors.cases()) " cases, in powers of two of the bound" } {
            @for (at, (name, count, bad)) in bars.iter().enumerate() {
                @if *count > 0 {
                    rect x=(at * 6) y={ (format!("{:.1}", 21.0 - height(*count))) } width="5"
                        height={ (format!("{:.1}", height(*count))) }
                        class=(if *bad { "bad" } else { "good" }) {
                        title { (name) ": " (count) " of " (errors.cases()) " cases" }
                    }
                }
            }
            line x1=(14 * 6) x2=(14 * 6) y1="0" y2="22" { title { "the bound" } }
        }
    }
}

fn functions(records: &[Record]) -> Markup {
    let functions: Vec<_> = records
        .iter()
        .filter_map(|record| match &record.subject {
            Subject::Function { function, check, location, .. } => {
                Some((record, function, check, location))
            }
            Subject::Frame { .. } => None,
        })
        .collect();
    html! {
        @if !functions.is_empty() {
            section {
                h2 { "Functions" }
                p class="note" {
                    "The worst error, its share of the bound, and how many cases were compared. The bars are \
                     some cases by their error in powers of two of the bound, which is the line."
                }
                table {
                    @for (record, function, check, location) in functions {
                        tr class=(row_class(record)) id=[(!is_failure(record)).then(|| anchor(record))] {
                            th scope="row" {
                                a href={ "#" (anchor(record)) } { (function) } " " small { (check) }
                                div class="place" { (location) }
                            }
                            @if record.paths.is_empty() { td class="fail" { "no verdict" } }
                            @for path in &record.paths { (cell(path)) }
                        }
                    }
                }
            }
        }
    }
}

fn row_class(record: &Record) -> &'static str {
    if is_failure(record) { "row failing" } else { "row" }
}

fn frames(records: &[Record], review: Option<&str>) -> Markup {
    let frames: Vec<_> = records
        .iter()
        .filter_map(|record| match &record.subject {
            Subject::Frame { golden, .. } => Some((record, golden)),
            Subject::Function { .. } => None,
        })
        .collect();
    html! {
        @if !frames.is_empty() {
            section {
                h2 { "Frames" }
                @if review.is_none() {
                    p class="note" { "Look at them with " code { "karat review" } "." }
                }
                table {
                    @for (record, golden) in frames {
                        tr class=(row_class(record)) id=[(!is_failure(record)).then(|| anchor(record))] {
                            th scope="row" {
                                @match review {
                                    Some(review) => a href={ (review) "#" (golden) } { (golden) },
                                    None => a href={ "#" (anchor(record)) } { (golden) },
                                }
                                div class="place" { (record.test) }
                            }
                            @if record.paths.is_empty() { td class="fail" { "no verdict" } }
                            @for path in &record.paths { (cell(path)) }
                        }
                    }
                }
            }
        }
    }
}

fn without_tests(untested: Option<&[String]>) -> Markup {
    html! {
        @if let Some(untested) = untested {
            section {
                h2 { "Functions with no test of their own" }
                @if untested.is_empty() { p class="note" { "None." } }
                ul { @for name in untested { li class="row" { code { (name) } } } }
            }
        }
    }
}
