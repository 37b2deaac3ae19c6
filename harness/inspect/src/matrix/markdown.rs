//! Writes a matrix as a Markdown page.

use std::collections::BTreeMap;
use std::fmt::Write;

use karat_core::output::{counted, markdown, visible};

use super::{Cell, Matrix, Status, Stop};

impl Cell {
    /// The cell's text in a table: its status, its fault, or `known` for a declared failure.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match (self.status, &self.stopped) {
            _ if self.fails_as_declared().is_some() => "known",
            (_, Some(Stop::Differs(_))) => "DIFFERS",
            (_, Some(Stop::Rejected(_))) => "INVALID",
            (_, Some(Stop::Broke(_))) => "NO VERDICT",
            (_, Some(Stop::Panicked(_))) => "PANICS",
            (None, _) => "unsupported",
            (Some(status), _) => status.name(),
        }
    }
}

impl Cell {
    /// The reason why the cell has no higher status, and the weight by which the page sorts reasons.
    fn reason(&self) -> Option<(Weight, String)> {
        if let Some(known) = self.fails_as_declared() {
            return Some((Weight::Other, format!("known: {}", known.reason)));
        }
        let stop = self.stopped.as_ref()?;
        let weight = match stop {
            Stop::Unsupported(_) => Weight::Wrong,
            Stop::Unavailable(_) | Stop::NoValidator(_) => Weight::Absent,
            stop if stop.is_wrong() => Weight::Wrong,
            _ => Weight::Other,
        };
        Some((weight, stop.text().trim().to_owned()))
    }
}

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Weight {
    Wrong,
    Other,
    /// A validator or a path isn't available here.
    Absent,
}

const MOST_NAMES: usize = 6;

/// A name as code: between backticks, or as escaped HTML if it has special characters.
fn code(name: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "_:.-#@ (),".contains(c);
    match name.chars().all(plain) {
        true => format!("`{name}`"),
        false => format!("<code>{}</code>", markdown(name)),
    }
}

/// A sentence in which single backticks enclose code.
fn prose(text: &str) -> String {
    let parts: Vec<&str> = text.split('`').collect();
    // If backticks come in pairs and are never adjacent, exactly the parts between them are code.
    if text.contains("``") || parts.len().is_multiple_of(2) {
        return markdown(text);
    }
    let shown = |(at, part): (usize, &&str)| match at % 2 {
        0 => markdown(part),
        _ => format!("`{}`", visible(part)),
    };
    parts.iter().enumerate().map(shown).collect()
}

impl Matrix {
    /// The reasons why rows stop, each with its columns and rows. Faults come first, before reasons such as missing
    /// tools or rows that didn't run. More frequent reasons come earlier.
    #[must_use]
    pub fn reasons(&self) -> Vec<(String, Vec<String>)> {
        self.ranked_reasons().into_iter().map(|(_, why, rows)| (why, rows)).collect()
    }

    fn ranked_reasons(&self) -> Vec<(Weight, String, Vec<String>)> {
        #[derive(Default)]
        struct Where<'m> {
            columns: Vec<&'m str>,
            rows: Vec<String>,
        }
        let mut reasons: BTreeMap<(Weight, String), Where<'_>> = BTreeMap::new();
        for row in &self.rows {
            if let Some(error) = &row.error {
                let first = error.lines().next().unwrap_or_default();
                let weight = if row.is_judged() { Weight::Wrong } else { Weight::Other };
                let found = reasons.entry((weight, first.to_owned())).or_default();
                found.rows.push(row.name.clone());
            }
            for (head, cell) in self.columns.iter().zip(&row.cells) {
                let Some((weight, text)) = cell.reason() else { continue };
                let found = reasons.entry((weight, text)).or_default();
                if !found.columns.contains(&&*head.name) {
                    found.columns.push(&head.name);
                }
                if found.rows.last() != Some(&row.name) {
                    found.rows.push(row.name.clone());
                }
            }
        }
        let mut reasons: Vec<_> = reasons.into_iter().collect();
        reasons.sort_by_key(|((weight, _), found)| (*weight, std::cmp::Reverse(found.rows.len())));
        let shown = |((weight, why), Where { columns, rows }): ((Weight, String), Where<'_>)| {
            let at = if columns.is_empty() { String::new() } else { columns.join(", ") + ": " };
            (weight, at + &why, rows)
        };
        reasons.into_iter().map(shown).collect()
    }

    /// A sentence with the number of results that differ where WGSL leaves the result open; `None` if there are none.
    /// Such results aren't findings.
    #[must_use]
    pub fn open(&self) -> Option<String> {
        let open = |cell: &&Cell| cell.open > 0;
        let cells: Vec<&Cell> = self.rows.iter().flat_map(|row| &row.cells).filter(open).collect();
        let rows = self.rows.iter().filter(|row| row.cells.iter().any(|cell| cell.open > 0));
        let rows: Vec<String> = rows.map(|row| format!("`{}`", row.name)).collect();
        if rows.is_empty() {
            return None;
        }
        let results = counted(cells.iter().map(|cell| cell.open).sum::<usize>(), "result");
        let more = rows.len().saturating_sub(MOST_NAMES);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        Some(format!(
            "{results} in {}, but WGSL doesn't define these results, so they aren't findings: {}{more}",
            match cells.len() {
                1 => "1 cell differ".to_owned(),
                count => format!("{count} cells differ"),
            },
            rows[..rows.len().min(MOST_NAMES)].join(", ")
        ))
    }

    /// The matrix as a Markdown page: the columns, the number of rows by status, each row, and the reasons why rows
    /// stop.
    #[must_use]
    pub fn markdown(&self) -> String {
        self.write_markdown().expect("writing to a String never fails")
    }

    fn write_markdown(&self) -> Result<String, std::fmt::Error> {
        let mut text = String::new();
        writeln!(text, "# Translations of {}\n\nBy naga {}.\n", code(&self.package), self.naga)?;
        writeln!(text, "| column | language | runs on |\n|---|---|---|")?;
        for head in &self.columns {
            let runs = head.adapter.as_deref().unwrap_or("nothing here");
            writeln!(text, "| {} | {} | {} |", head.name, head.language, markdown(runs))?;
        }
        writeln!(text, "\n| validator | version |\n|---|---|")?;
        for (tool, version) in &self.validators {
            writeln!(text, "| {tool} | {} |", markdown(version))?;
        }
        let names: Vec<&str> = self.columns.iter().map(|head| head.name.as_str()).collect();
        let rule = "---|".repeat(names.len());
        writeln!(text, "\n| rows | {} |\n|---|{rule}", names.join(" | "))?;
        for status in Status::ALL {
            let reached = (0..names.len()).map(|column| self.count(column, status).to_string());
            writeln!(text, "| {status} | {} |", reached.collect::<Vec<_>>().join(" | "))?;
        }
        writeln!(text, "\n| row | {} |\n|---|{rule}", names.join(" | "))?;
        for row in self.rows.iter().filter(|row| row.error.is_none()) {
            let cells: Vec<&str> = row.cells.iter().map(Cell::word).collect();
            writeln!(text, "| {} ({}) | {} |", markdown(&row.name), row.kind, cells.join(" | "))?;
        }
        if let Some(open) = self.open() {
            writeln!(text, "\n{open}.")?;
        }
        writeln!(text, "\n## Why rows stop\n")?;
        // The head of a column shows that the column isn't available.
        let whole = |(weight, _, rows): &(Weight, String, Vec<String>)| {
            *weight == Weight::Absent && rows.len() * 2 > self.rows.len()
        };
        for (_, why, rows) in self.ranked_reasons().into_iter().filter(|reason| !whole(reason)) {
            let why = prose(&why.split_whitespace().collect::<Vec<_>>().join(" "));
            writeln!(text, "- {}: {why}", counted(rows.len(), "row"))?;
            let few: Vec<String> = rows.iter().take(MOST_NAMES).map(|row| code(row)).collect();
            let more = rows.len().saturating_sub(few.len());
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            writeln!(text, "  ({}{more})", few.join(", "))?;
        }
        Ok(text)
    }

    /// The number of rows that reach this status, or a higher status, on a column.
    #[must_use]
    pub fn count(&self, column: usize, status: Status) -> usize {
        let rows = self.rows.iter().filter(|row| row.is_judged());
        let reached = rows.filter_map(|row| row.cells.get(column)?.status);
        reached.filter(|reached| *reached >= status).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the parts of a text that aren't between backticks. The text has no two adjacent backticks.
    fn bare(text: &str) -> String {
        text.split('`').step_by(2).collect()
    }

    // Lesson 182
    #[test]
    fn names_and_reasons_bring_no_html() {
        assert_eq!(code("brdf::f (function)"), "`brdf::f (function)`");
        let page = code("a`<img src=x>|");
        assert_eq!(page, "<code>a&#96;&lt;img src=x&gt;&#124;</code>");
        assert_eq!(prose("`array<f32>` isn't `bool`"), "`array<f32>` isn't `bool`");
        for text in ["<img src=x>", "`a` <img src=x>", "`a<img>", "```<img>`", "`a`<img>`b`<img>"] {
            assert!(!bare(&prose(text)).contains("<img"), "{text}: {}", prose(text));
        }
        assert!(!prose("![x](http://example.org/x.png)").contains("]("));
    }
}
