//! Tables of text.

use std::borrow::Cow;
use std::io::{self, Write};

use karat::unstable::output::{Style, one_line};

use super::terminal;

pub(super) const GOOD: Style = Style::GOOD;
pub(super) const KNOWN: Style = Style::KNOWN;
pub(super) const BAD: Style = Style::BAD;
pub(super) const HEAD: Style = Style::HEAD;
pub(super) const DIM: Style = Style::DIM;
pub(super) const PLAIN: Style = Style::PLAIN;

/// The rows of a table. The printed columns are aligned.
#[derive(Debug, Default)]
pub(super) struct Table {
    rows: Vec<(Style, Vec<String>)>,
    right: Vec<usize>,
    /// The columns whose cells may be cut if the terminal is narrow.
    cut: Vec<usize>,
    /// The columns that may be removed, in this order, if cutting isn't enough.
    leave: Vec<usize>,
}

const GAP: &str = "  ";

const CUT: &str = "..";

/// The smallest number of characters in a cut column.
const KEPT: usize = 10;

impl Table {
    /// Makes a table with a head. The columns in `right` are aligned to the right.
    pub(super) fn new(head: &[&str], right: &[usize]) -> Self {
        let head = head.iter().map(ToString::to_string).collect();
        Self { rows: vec![(HEAD, head)], right: right.to_vec(), ..Self::default() }
    }

    /// Allows cutting cells in these columns if the terminal is too narrow. The full text must appear elsewhere.
    pub(super) fn cutting(self, columns: &[usize]) -> Self {
        Self { cut: columns.to_vec(), ..self }
    }

    /// Allows removing these columns, one after the other, if cutting isn't enough.
    pub(super) fn leaving(self, columns: &[usize]) -> Self {
        Self { leave: columns.to_vec(), ..self }
    }

    pub(super) fn row(&mut self, style: Style, cells: Vec<String>) {
        // The width of a cell is that of the visible text, and each cell is one line.
        let cells = cells.iter().map(|cell| one_line(cell).into_owned()).collect();
        self.rows.push((style, cells));
    }

    pub(super) fn is_empty(&self) -> bool {
        self.rows.len() < 2
    }

    pub(super) fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        self.write_within(terminal::size().columns, out)
    }

    fn write_within(&self, limit: Option<usize>, out: &mut dyn Write) -> io::Result<()> {
        let columns = self.rows.iter().map(|(_, cells)| cells.len()).max().unwrap_or(0);
        let width = |column: usize| {
            let cells = self.rows.iter().filter_map(|(_, cells)| cells.get(column));
            cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
        };
        let mut widths: Vec<usize> = (0..columns).map(width).collect();
        if let Some(limit) = limit {
            self.narrow(&mut widths, limit);
        }
        for (style, cells) in &self.rows {
            let mut line = String::new();
            for (column, cell) in cells.iter().enumerate().filter(|(column, _)| widths[*column] > 0)
            {
                let cell = &*shortened(cell, widths[column]);
                let padding = " ".repeat(widths[column] - cell.chars().count());
                if self.right.contains(&column) {
                    line.push_str(&padding);
                    line.push_str(cell);
                } else {
                    line.push_str(cell);
                    line.push_str(&padding);
                }
                line.push_str(GAP);
            }
            writeln!(out, "{style}{}{style:#}", line.trim_end())?;
        }
        Ok(())
    }

    /// Makes columns narrower until a line fits. First removes columns without text. Then cuts columns, the widest
    /// first. If that isn't enough, removes one of the columns in `leave`, and cuts the other columns again.
    fn narrow(&self, widths: &mut [usize], limit: usize) {
        let cells = &self.rows[1..];
        let is_empty = |column: usize| {
            cells.iter().all(|(_, cells)| cells.get(column).is_none_or(String::is_empty))
        };
        for column in (0..widths.len()).filter(|column| is_empty(*column)) {
            if line(widths) > limit {
                widths[column] = 0;
            }
        }
        let mut whole = widths.to_vec();
        let mut leaving = self.leave.iter();
        while !self.cut_to(widths, limit) {
            let Some(column) = leaving.next() else { return };
            whole[*column] = 0;
            widths.copy_from_slice(&whole);
        }
    }

    /// Cuts the columns in `cut` until a line fits. Returns `false` if no column can become narrower.
    fn cut_to(&self, widths: &mut [usize], limit: usize) -> bool {
        while line(widths) > limit {
            let may = self
                .cut
                .iter()
                .copied()
                .filter(|column| widths.get(*column).is_some_and(|width| *width > KEPT));
            let Some(widest) = may.max_by_key(|column| widths[*column]) else { return false };
            widths[widest] -= 1;
        }
        true
    }
}

fn line(widths: &[usize]) -> usize {
    let shown = widths.iter().filter(|width| **width > 0);
    shown.map(|width| width + GAP.len()).sum::<usize>().saturating_sub(GAP.len())
}

/// Returns the text of a cell, cut to the width of its column.
fn shortened(cell: &str, width: usize) -> Cow<'_, str> {
    if cell.chars().count() <= width {
        return Cow::Borrowed(cell);
    }
    let kept: String = cell.chars().take(width - CUT.len()).collect();
    Cow::Owned(format!("{}{CUT}", kept.trim_end()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_narrow_terminal_cuts_what_may_be_cut() {
        let mut table = Table::new(&["frame", "worst", "of bound"], &[2]).cutting(&[1]);
        let worst = "FAIL the gate is exceeded at 12 pixels, largest FLIP tile 0.02 of 0.01";
        table.row(
            PLAIN,
            vec!["a/frame_with_a_long_name".to_owned(), worst.to_owned(), "200%".to_owned()],
        );
        let text = |limit| {
            let mut text = Vec::new();
            table.write_within(limit, &mut text).expect("memory");
            let text = String::from_utf8(text).expect("UTF-8");
            text.split_once('\n').expect("a head").1.to_owned()
        };
        let whole = text(None);
        assert!(whole.contains(worst), "{whole}");
        for limit in [80, 60] {
            let text = text(Some(limit));
            assert!(text.trim_end().chars().count() <= limit, "{limit}:\n{text}");
            assert!(
                text.contains("a/frame_with_a_long_name  FAIL the gate") && text.contains("..")
            );
            assert!(text.ends_with("    200%\n"), "{text}");
        }
        let mut table = Table::new(&["function", "WGSL allows", "asserted"], &[]).cutting(&[2]);
        table.row(PLAIN, vec!["m::f".to_owned(), String::new(), "nothing is left".to_owned()]);
        let mut line = Vec::new();
        table.write_within(Some(30), &mut line).expect("memory");
        let line = String::from_utf8(line).expect("UTF-8");
        assert!(!line.contains("WGSL") && line.ends_with("m::f      nothing is left\n"), "{line}");
        // A removed column leaves its space to the others.
        let head = ["function", "path", "cases", "worst", "of bound", "asserted"];
        let mut table = Table::new(&head, &[2, 4]).cutting(&[3, 5]).leaving(&[5, 2]);
        let cells = ["module::function", "vulkan", "65536", "0.25 ulp", "6%", "4 ulp or abs 1e-30"];
        table.row(PLAIN, cells.map(str::to_owned).to_vec());
        let lines = |limit| {
            let mut text = Vec::new();
            table.write_within(Some(limit), &mut text).expect("memory");
            let text = String::from_utf8(text).expect("UTF-8");
            let (head, row) = text.split_once('\n').expect("a head");
            assert!(row.trim_end().chars().count() <= limit, "{text}");
            assert_eq!(head.contains("asserted"), limit > 60, "{head}");
            row.to_owned()
        };
        assert!(lines(70).contains("4 ulp or abs 1e.."), "{}", lines(70));
        assert!(lines(60).contains("65536  0.25 ulp"), "{}", lines(60));
        assert!(lines(45).ends_with("vulkan  0.25 ulp        6%\n"), "{}", lines(45));
        // A column that isn't in `cut` keeps its text: people copy names.
        assert!(
            text(Some(20)).contains("a/frame_with_a_long_name  FAIL the.."),
            "{}",
            text(Some(20))
        );
    }
}
