//! Columns of text.

use std::io::{self, Write};

use karat::output::{Style, visible};

pub(super) const GOOD: Style = Style::GOOD;
pub(super) const KNOWN: Style = Style::KNOWN;
pub(super) const BAD: Style = Style::BAD;
pub(super) const HEAD: Style = Style::HEAD;
pub(super) const DIM: Style = Style::DIM;
pub(super) const PLAIN: Style = Style::PLAIN;

/// Rows whose columns are aligned when printed.
#[derive(Debug, Default)]
pub(super) struct Table {
    rows: Vec<(Style, Vec<String>)>,
    right: Vec<usize>,
}

impl Table {
    /// A table with a head; columns in `right` are aligned to the right.
    pub(super) fn new(head: &[&str], right: &[usize]) -> Self {
        let head = head.iter().map(ToString::to_string).collect();
        Self { rows: vec![(HEAD, head)], right: right.to_vec() }
    }

    pub(super) fn row(&mut self, style: Style, cells: Vec<String>) {
        // As wide as they are shown.
        let cells = cells.iter().map(|cell| visible(cell).into_owned()).collect();
        self.rows.push((style, cells));
    }

    pub(super) fn is_empty(&self) -> bool {
        self.rows.len() < 2
    }

    pub(super) fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        let columns = self.rows.iter().map(|(_, cells)| cells.len()).max().unwrap_or(0);
        let width = |column: usize| {
            let cells = self.rows.iter().filter_map(|(_, cells)| cells.get(column));
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let widths: Vec<usize> = (0..columns).map(width).collect();
        for (style, cells) in &self.rows {
            let mut line = String::new();
            for (column, cell) in cells.iter().enumerate() {
                let padding = " ".repeat(widths[column] - cell.chars().count());
                if self.right.contains(&column) {
                    line.push_str(&padding);
                    line.push_str(cell);
                } else {
                    line.push_str(cell);
                    line.push_str(&padding);
                }
                line.push_str("  ");
            }
            writeln!(out, "{style}{}{style:#}", line.trim_end())?;
        }
        Ok(())
    }
}
