//! The report of a run: one HTML file that needs no other files.

mod cells;
mod plot;

use std::collections::{BTreeMap, BTreeSet};

use karat::unstable::output::counted;
use karat::unstable::record::{Errors, PathRecord, Record, Run, Subject};
use karat_inspect::hazards::Hazards;
use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::tables::{is_failure, share};
use super::{Names, Sum, failing, replays, values};

const STYLE: &str = include_str!("html/report.css");
const SCRIPT: &str = include_str!("html/report.js");

/// The content that the page shows besides the records.
#[derive(Clone, Debug, Default)]
pub(super) struct Beside<'p> {
    /// The functions without a test. `None` if the run skipped tests.
    pub(super) untested: Option<Vec<String>>,
    /// The hazards of each package. `None` if Karat didn't check for hazards.
    pub(super) hazards: Option<Vec<Hazards>>,
    /// The URL of the page of frames.
    pub(super) review: Option<&'p str>,
    /// The URL of the page of translations.
    pub(super) matrix: Option<&'p str>,
}

pub(super) fn page(
    records: &[Record],
    run: Option<&Run>,
    sum: &Sum,
    beside: &Beside<'_>,
) -> String {
    let Beside { untested, hazards: found, review, matrix } = beside;
    let verdict = match run {
        _ if sum.is_good() => "passed",
        None if !records.iter().any(is_failure) => "not ended",
        _ => "failed",
    };
    let names = &Names::of(records);
    let rows = &Row::all(records, names);
    let page = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { "Karat: " (verdict) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                (head(records, (run, sum), verdict, *matrix))
                main {
                    (failures(rows))
                    (functions(rows))
                    (frames(rows, *review))
                    @if let Some(found) = found { (hazards(found)) }
                    (without_tests(untested.as_deref()))
                }
                script { (PreEscaped(SCRIPT)) }
            }
        }
    };
    page.into_string()
}

fn head(
    records: &[Record],
    (run, sum): (Option<&Run>, &Sum),
    verdict: &str,
    matrix: Option<&str>,
) -> Markup {
    let paths = || records.iter().flat_map(|record| &record.paths);
    let cases: u64 = paths().map(|path| path.cases).sum();
    let adapters: BTreeSet<String> = paths().map(|path| path.adapter.to_string()).collect();
    let started =
        records.iter().filter_map(|record| record.time.as_ref()).map(|time| &time.started);
    let overlays: BTreeSet<_> = records.iter().filter_map(|r| r.overlay.as_ref()).collect();
    html! {
        header {
            h1 class=(if verdict == "passed" { "pass" } else { "fail" }) { (verdict) }
            p {
                (sum.line()) ", " (counted(cases, "case")) " compared"
                @if let Some(started) = started.min() { ", begun " time { (started) } }
            }
            @match run {
                None => p class="fail" {
                    "Tests may be missing: the record doesn't say that the run has ended. Run the tests again."
                },
                Some(run) if !run.selected.is_empty() => p { "Only: " (run.selected.join(" ")) },
                Some(_) => {}
            }
            @for overlay in overlays {
                p class="fail" { "The run had KARAT_OVERLAY=" (overlay) ": files of this folder replaced modules of the packages." }
            }
            @if let Some(matrix) = matrix { p { a href=(matrix) { "See the translations of the shaders" } } }
            ul class="adapters" { @for adapter in &adapters { li { (adapter) } } }
            label { "Search " input id="search" type="search" placeholder="name, test, path, message"; }
            label { input id="failing" type="checkbox"; " only failures" }
            p id="none" hidden { "No row contains all words of the search." }
        }
    }
}

/// A record with the name of its anchor: `#brdf::schlick-agrees_with-schlick_matches`.
struct Row<'r> {
    record: &'r Record,
    /// The subject of the record: `fresnel::schlick agrees_with`, `frame scene`.
    name: String,
    anchor: String,
}

impl<'r> Row<'r> {
    /// Makes the rows, with distinct anchors: a test may check the same function several times.
    fn all(records: &'r [Record], names: &Names) -> Vec<Self> {
        let mut known: BTreeMap<String, usize> = BTreeMap::new();
        let row = |record: &'r Record| {
            let about = names.subject(record);
            let name = format!("{about}-{}", record.test);
            let plain = |c: char| if c.is_alphanumeric() || ":_-".contains(c) { c } else { '-' };
            let name: String = name.chars().map(plain).collect();
            let count = known.entry(name.clone()).or_default();
            *count += 1;
            let anchor = if *count == 1 { name } else { format!("{name}-{count}") };
            Self { record, name: about, anchor }
        };
        records.iter().map(row).collect()
    }

    fn fails(&self) -> bool {
        is_failure(self.record)
    }

    /// Returns the anchor of the row. Returns `None` for a failure, because another section of the page shows the
    /// failure in full, and has the anchor.
    fn id(&self) -> Option<&str> {
        (!self.fails()).then_some(&self.anchor)
    }

    /// Returns words that the row doesn't show, but by which the page's search finds the row.
    fn words(&self) -> String {
        let of = |path: &PathRecord| format!("{} {} ", path.adapter, path.asserted);
        self.record.paths.iter().map(of).collect()
    }

    fn class(&self) -> &'static str {
        if self.fails() { "row failing" } else { "row" }
    }
}

fn failures(rows: &[Row<'_>]) -> Markup {
    html! {
        @if rows.iter().any(Row::fails) {
            section {
                h2 { "What fails" }
                @for row in rows.iter().filter(|row| row.fails()) {
                    article class="row failing" id=(row.anchor) {
                        h3 { a href={ "#" (row.anchor) } { (row.name) } " " small { (row.record.test) } }
                        @if let Some(message) = &row.record.message { pre { (message) } }
                        (cases(row.record))
                        (copied(&replays(row.record)))
                        (figures(row.record))
                    }
                }
            }
        }
    }
}

/// Returns the failing cases of each path, as text to copy.
fn cases(record: &Record) -> Markup {
    let paths = record.details.iter().flat_map(|details| &details.paths);
    let paths = paths.map(|path| (&path.adapter.path, values(path)));
    let paths: Vec<_> = paths.filter(|(_, values)| !values.is_empty()).collect();
    html! {
        @if !paths.is_empty() {
            details {
                summary { "Values" }
                @for (path, values) in paths {
                    p { "on " (path) }
                    ul { @for value in values { li { code { (value) } } } }
                }
            }
        }
    }
}

pub(super) fn figures(record: &Record) -> Markup {
    html! {
        @for path in &record.paths {
            @if let Some(plot) = &path.plot {
                (plot::figures(plot, &path.adapter.path, &path.asserted))
            }
            @if let Some(histogram) = &path.histogram {
                (cells::map(histogram, &path.adapter.path))
            }
        }
    }
}

/// Returns a button for each command. The message of the failure lists the commands in the same order.
fn copied(commands: &[String]) -> Markup {
    html! {
        @if !commands.is_empty() {
            p {
                @for (at, command) in commands.iter().enumerate() {
                    button type="button" data-copy=(command) title=(command) {
                        "Copy the " @if commands.len() > 1 { (nth(at)) " " } "replay command"
                    }
                    " "
                }
            }
        }
    }
}

fn nth(at: usize) -> String {
    match at {
        0 => "first".to_owned(),
        1 => "second".to_owned(),
        2 => "third".to_owned(),
        _ => format!("{}th", at + 1),
    }
}

/// Returns the table cell of a path. The cell shows the worst error, its share of the tolerance, and a chart of all
/// errors.
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
            @let told = failing(path);
            @if path.failures > 0 { " " span class="count" { (told) } }
            @else { " " span class="count" { (path.cases) } }
            @if let Some(reason) = &path.known_issue { " " i { (reason) } }
            @if let Some(errors) = &path.errors { (distribution(errors)) }
        }
    }
}

/// Returns a bar chart that counts the cases by error / bound. Each bar covers the range between two powers of two.
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
            (format!("{word} 2^{of} times the bound"), within(power), power > 0)
        }))
        .chain([("not finite".to_owned(), errors.not_finite, true)])
        .collect();
    let most = bars.iter().map(|(_, count, _)| *count).max().unwrap_or(0).max(1);
    // The logarithm makes a single case visible among hundreds.
    #[expect(clippy::cast_precision_loss, reason = "pixels")]
    let height = |count: u64| 20.0 * ((1 + count) as f64).ln() / ((1 + most) as f64).ln();
    html! {
        svg class="bars" width="114" height="22" role="img"
            aria-label={ "errors of " (errors.cases()) " cases, divided by the bound and grouped by powers of two" } {
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

fn functions(rows: &[Row<'_>]) -> Markup {
    let functions: Vec<_> = rows
        .iter()
        .filter_map(|row| match &row.record.subject {
            Subject::Function { function, check, location, domain, assertion, .. } => {
                Some((row, function, check, [location, &row.record.test, assertion, domain]))
            }
            Subject::Frame { .. } => None,
        })
        .collect();
    html! {
        @if !functions.is_empty() {
            section {
                h2 { "Functions" }
                p class="note" {
                    "Each row shows the worst error, this error divided by its bound, and the number of compared cases. Each bar counts \
                     the cases in which the error divided by the bound lies between two powers of two. The vertical line is the bound."
                }
                table {
                    @for (row, function, check, facts) in functions {
                        tr class=(row.class()) id=[row.id()] data-words=(row.words()) {
                            th scope="row" {
                                a href={ "#" (row.anchor) } { (function) } " " small { (check) }
                                div class="place" {
                                    @for fact in facts.iter().filter(|fact| !fact.is_empty()) { span { (fact) } " " }
                                }
                            }
                            @if row.record.paths.is_empty() { td class="fail" { "no verdict" } }
                            @for path in &row.record.paths { (cell(path)) }
                        }
                    }
                }
            }
        }
    }
}

fn frames(rows: &[Row<'_>], review: Option<&str>) -> Markup {
    let frames: Vec<_> = rows
        .iter()
        .filter_map(|row| match &row.record.subject {
            Subject::Frame { golden, .. } => {
                Some((row, golden, row.name.strip_prefix("frame ").unwrap_or(golden)))
            }
            Subject::Function { .. } => None,
        })
        .collect();
    html! {
        @if !frames.is_empty() {
            section {
                h2 { "Frames" }
                @if review.is_none() {
                    p class="note" { "To see the frames, run " code { "karat review" } "." }
                }
                table {
                    @for (row, golden, name) in frames {
                        tr class=(row.class()) id=[row.id()] data-words=(row.words()) {
                            th scope="row" {
                                @match review {
                                    Some(review) => a href={ (review) "#" (golden) } { (name) },
                                    None => a href={ "#" (row.anchor) } { (name) },
                                }
                                div class="place" { (row.record.test) }
                            }
                            @if row.record.paths.is_empty() { td class="fail" { "no verdict" } }
                            @for path in &row.record.paths { (cell(path)) }
                        }
                    }
                }
            }
        }
    }
}

fn hazards(all: &[Hazards]) -> Markup {
    html! {
        section {
            h2 { "Hazards" }
            p class="note" {
                "These operations can go wrong for generated arguments, even if no test fails. For more details, run " code { "karat hazards" } "."
            }
            @for hazards in all {
                p {
                    (hazards.package) ": " (hazards.counts())
                    @if hazards.accepted > 0 { ", " (hazards.accepted) " accepted" }
                }
                @for hazard in &hazards.found { pre class="row" { (hazard) } }
            }
        }
    }
}

fn without_tests(untested: Option<&[String]>) -> Markup {
    html! {
        @if let Some(untested) = untested {
            section {
                h2 { "Functions without a test" }
                @if untested.is_empty() { p class="note" { "None." } }
                ul { @for name in untested { li class="row" { code { (name) } } } }
            }
        }
    }
}
