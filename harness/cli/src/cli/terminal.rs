//! The size of the terminal. If the output isn't a terminal, the length of lines is unlimited.

use std::io::IsTerminal;
use std::sync::OnceLock;

/// The size of a terminal in characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Size {
    /// The number of columns. `None` means that there is no limit.
    pub(super) columns: Option<usize>,
    pub(super) rows: usize,
}

/// The assumed size of an output that isn't a terminal.
const UNKNOWN: Size = Size { columns: None, rows: 32 };

/// The assumed size of a terminal that doesn't report its size.
const SMALL: (u16, u16) = (80, 24);

/// The smallest numbers of columns and rows that Karat assumes.
const LEAST: (usize, usize) = (20, 4);

static SIZE: OnceLock<Size> = OnceLock::new();

/// Measures the terminal, if the output is a terminal. The environment variable `COLUMNS` overrides the measured width.
pub(super) fn measure() {
    let size = match std::io::stdout().is_terminal() {
        true => {
            let told = std::env::var("COLUMNS").ok().and_then(|text| text.trim().parse().ok());
            of(crossterm::terminal::size().unwrap_or(SMALL), told)
        }
        false => UNKNOWN,
    };
    SIZE.get_or_init(|| size);
}

fn of((columns, rows): (u16, u16), told: Option<usize>) -> Size {
    // A terminal of width 0 has no window. An example is the terminal of a script.
    let (columns, rows) = if columns == 0 || rows == 0 { SMALL } else { (columns, rows) };
    let columns = told.filter(|columns| *columns > 0).unwrap_or(columns.into());
    Size { columns: Some(columns.max(LEAST.0)), rows: usize::from(rows).max(LEAST.1) }
}

pub(super) fn size() -> Size {
    SIZE.get().copied().unwrap_or(UNKNOWN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_terminal_width_comes_from_the_terminal_or_the_user() {
        let size = |columns, rows| Size { columns: Some(columns), rows };
        assert_eq!(of((100, 50), None), size(100, 50));
        assert_eq!(of((100, 50), Some(60)), size(60, 50));
        assert_eq!(of((100, 50), Some(0)), size(100, 50));
        assert_eq!(of((0, 0), None), size(80, 24), "a script's terminal");
        assert_eq!(of((1, 1), None), size(20, 4));
        assert_eq!(super::size(), UNKNOWN, "nobody measured");
    }
}
