//! How much a terminal shows. Where the output isn't one, nobody's window is too narrow for it: a line of a
//! log is as long as what it says.

use std::io::IsTerminal;
use std::sync::OnceLock;

/// What a terminal shows at once, in characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Size {
    /// Of a line; `None` if any length will do.
    pub(super) columns: Option<usize>,
    pub(super) rows: usize,
}

/// Where nothing is known of the reader.
const UNKNOWN: Size = Size { columns: None, rows: 32 };

/// A terminal that doesn't tell its size.
const SMALL: (u16, u16) = (80, 24);

/// What nobody reads on.
const LEAST: (usize, usize) = (20, 4);

static SIZE: OnceLock<Size> = OnceLock::new();

/// Finds out what the terminal shows, if the output is one. `COLUMNS` says better how wide it is.
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
    // One that is 0 wide has no window, such as that of a script.
    let (columns, rows) = if columns == 0 || rows == 0 { SMALL } else { (columns, rows) };
    let columns = told.filter(|columns| *columns > 0).unwrap_or(columns.into());
    Size { columns: Some(columns.max(LEAST.0)), rows: usize::from(rows).max(LEAST.1) }
}

/// What the output shows at once.
pub(super) fn size() -> Size {
    SIZE.get().copied().unwrap_or(UNKNOWN)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_terminal_is_as_wide_as_it_or_its_user_says() {
        let size = |columns, rows| Size { columns: Some(columns), rows };
        assert_eq!(of((100, 50), None), size(100, 50));
        assert_eq!(of((100, 50), Some(60)), size(60, 50));
        assert_eq!(of((100, 50), Some(0)), size(100, 50));
        assert_eq!(of((0, 0), None), size(80, 24), "a script's terminal");
        assert_eq!(of((1, 1), None), size(20, 4));
        assert_eq!(super::size(), UNKNOWN, "nobody measured");
    }
}
