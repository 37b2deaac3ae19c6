//! A matrix as a page.

use std::collections::BTreeMap;
use std::fmt::Write;

use super::{Cell, Matrix, Status, Stop};

impl Cell {
    /// What a table calls it: how far it got, that it is wrong, or that this is known.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match (self.status, &self.stopped) {
            _ if self.known.is_some() && !self.contradicts() => "known",
            (_, Some(Stop::Differs(_))) => "DIFFERS",
            (_, Some(Stop::Rejected(_))) => "INVALID",
            (None, _) => "unsupported",
            (Some(status), _) => status.name(),
        }
    }
}

impl Matrix {
    /// Why rows stop, each reason with its column and its rows: first what is wrong, then what isn't
    /// here or isn't run; of each the most frequent first.
    #[must_use]
    pub fn reasons(&self) -> Vec<(String, Vec<String>)> {
        let mut reasons: BTreeMap<(bool, String), Vec<String>> = BTreeMap::new();
        for row in &self.rows {
            if let Some(error) = &row.error {
                let first = error.lines().next().unwrap_or_default();
                reasons.entry((false, first.to_owned())).or_default().push(row.name.clone());
            }
            for (head, cell) in self.columns.iter().zip(&row.cells) {
                if let Some(known) = cell.known.as_ref().filter(|_| !cell.contradicts()) {
                    let text = format!("{}: known: {}", head.name, known.reason);
                    reasons.entry((true, text)).or_default().push(row.name.clone());
                } else if let Some(stop) = &cell.stopped {
                    let text = format!("{}: {}", head.name, stop.text().trim());
                    let wrong =
                        matches!(stop, Stop::Differs(_) | Stop::Rejected(_) | Stop::Unsupported(_));
                    reasons.entry((!wrong, text)).or_default().push(row.name.clone());
                }
            }
        }
        let mut reasons: Vec<_> = reasons.into_iter().collect();
        reasons.sort_by_key(|((late, _), rows)| (*late, std::cmp::Reverse(rows.len())));
        reasons.into_iter().map(|((_, why), rows)| (why, rows)).collect()
    }

    /// The matrix as a page of Markdown: what ran, how many rows got how far, each row, and why rows
    /// stop.
    #[must_use]
    pub fn markdown(&self) -> String {
        self.write_markdown().expect("writing to a String never fails")
    }

    fn write_markdown(&self) -> Result<String, std::fmt::Error> {
        let mut text = String::new();
        writeln!(text, "# Translations of `{}`\n\nBy naga {}.\n", self.package, self.naga)?;
        writeln!(text, "| column | language | runs on |\n|---|---|---|")?;
        for head in &self.columns {
            let runs = head.adapter.as_deref().unwrap_or("nothing here");
            writeln!(text, "| {} | {} | {runs} |", head.name, head.language)?;
        }
        writeln!(text, "\n| validator | version |\n|---|---|")?;
        for (tool, version) in &self.validators {
            writeln!(text, "| {tool} | {version} |")?;
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
            writeln!(text, "| {} ({}) | {} |", row.name, row.kind, cells.join(" | "))?;
        }
        writeln!(text, "\n## Why rows stop\n")?;
        // What holds for a whole column is said at its head.
        let whole = |(_, rows): &(String, Vec<String>)| rows.len() * 2 > self.rows.len();
        for (why, rows) in self.reasons().into_iter().filter(|reason| !whole(reason)) {
            let why = why.split_whitespace().collect::<Vec<_>>().join(" ");
            writeln!(text, "- {} rows: {why}", rows.len())?;
            let few: Vec<String> = rows.iter().take(6).map(|row| format!("`{row}`")).collect();
            let more = rows.len().saturating_sub(few.len());
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            writeln!(text, "  ({}{more})", few.join(", "))?;
        }
        Ok(text)
    }

    /// How many rows get at least that far on a column.
    #[must_use]
    pub fn count(&self, column: usize, status: Status) -> usize {
        let rows = self.rows.iter().filter(|row| row.is_judged());
        let reached = rows.filter_map(|row| row.cells.get(column)?.status);
        reached.filter(|reached| *reached >= status).count()
    }
}
