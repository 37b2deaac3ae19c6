//! `karat call --trace`: prints each intermediate value of a call, beside the line that computes it.

use std::fmt::Write as _;
use std::io::Write;
use std::path::Path;

use anyhow::Context;
use karat::unstable::diagnostic::SourceFile;
use karat::unstable::image::write_whole;
use karat::unstable::trace::Step;
use karat_gallery::{Row, rows};

use super::super::table::{BAD, DIM, KNOWN, PLAIN, Table};

pub(super) fn write_text(steps: &[Step], out: &mut dyn Write) -> anyhow::Result<()> {
    write_rows(&rows(steps), out)
}

pub(in crate::cli) fn write_rows(rows: &[Row], out: &mut dyn Write) -> anyhow::Result<()> {
    writeln!(out)?;
    let mut table = Table::new(&["place", "operation", "f32", "f64", "WGSL allows"], &[]);
    for row in rows {
        let style = match (row.is_strange, row.has_lost) {
            (true, _) => BAD,
            (false, true) => KNOWN,
            (false, false) => PLAIN,
        };
        let [place, operation, single, double, allowed] =
            [&row.place(), &row.operation, &row.single, &row.double, &row.allowed]
                .map(String::clone);
        table.row(style, vec![place, operation, single, double, allowed]);
    }
    table.write(out)?;
    if rows.is_empty() {
        writeln!(out, "{DIM}the function has no operations to show{DIM:#}")?;
    }
    Ok(())
}

/// Writes an HTML page with the source, and below each line the steps that this line computes.
pub(super) fn write_html(name: &str, steps: &[Step], file: &Path) -> anyhow::Result<()> {
    let rows = rows(steps);
    let mut page = String::from(HEAD);
    writeln!(page, "<title>{}</title><h1>{}</h1>", html(name), html(name))?;
    let mut files: Vec<&SourceFile> = Vec::new();
    for step in steps {
        if files.iter().all(|file| file.name != step.span.file.name) {
            files.push(&step.span.file);
        }
    }
    for source in files {
        writeln!(page, "<h2>{}</h2><table>", html(&source.name))?;
        writeln!(page, "<tr><th><th>operation<th>f32<th>f64<th>WGSL allows")?;
        let own = || rows.iter().filter(|row| row.file == source.name);
        /// The number of source lines that Karat shows above and below a line with a step.
        const ABOUT: usize = 3;
        let mut gap = false;
        for (index, text) in source.text.lines().enumerate() {
            let number = index + 1;
            if !own().any(|row| row.line.abs_diff(number) <= ABOUT) {
                gap = true;
                continue;
            }
            if std::mem::take(&mut gap) {
                writeln!(page, "<tr><td>\u{22ee}")?;
            }
            writeln!(page, "<tr class=source><td>{number}<td colspan=4><pre>{}</pre>", html(text))?;
            for row in own().filter(|row| row.line == number) {
                let class = if row.has_lost { "lost" } else { "step" };
                let cells = [&row.single, &row.double, &row.allowed];
                let cells = cells.map(|cell| format!("<td>{}", html(cell))).concat();
                writeln!(page, "<tr class={class}><td><td>{}{cells}", html(&row.operation))?;
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
