//! The rows of CSV tables, the columns in a table's head, and the comments above the head.
//!
//! A line above the head that begins with `#` is a comment. Below the head, a line that begins with `#` is an error. If
//! Karat took such a line for a comment, but the author meant a row, Karat would never compare the row.

use karat::unstable::diagnostic::nearest;

/// The positions of a table's columns.
#[derive(Debug)]
pub struct Places {
    /// The columns of the arguments, in the order of the arguments.
    pub arguments: Vec<usize>,
    /// The columns of the expected values.
    pub expected: Vec<usize>,
    /// All other columns, with their names. They are notes.
    pub others: Vec<(String, usize)>,
}

impl Places {
    /// Reads a head, which has the names of the columns in any order.
    ///
    /// # Errors
    /// Returns an error if a column is missing or occurs twice. Also if a column has a name such as `v.z`, but the
    /// argument `v` has no `z`: the type of `v` may have changed. The error text continues a sentence that begins with
    /// the table's name.
    pub fn of_head(head: &[&str], arguments: &[&str], expected: &[&str]) -> Result<Self, String> {
        let twice = |(at, column): &(usize, &&str)| head[..*at].contains(column);
        if let Some((_, column)) = head.iter().enumerate().find(twice) {
            return Err(format!(
                "has two columns `{column}`, and Karat can't know which column you mean: rename or remove one column"
            ));
        }
        let wanted = || arguments.iter().chain(expected).copied();
        let find = |name: &&str| {
            head.iter().position(|column| column == name).ok_or_else(|| {
                let near = nearest(name, head.iter().copied());
                let near = near.map_or_else(String::new, |n| format!(" (did you mean `{n}`?)"));
                format!("has no column `{name}`{near}; its columns are {}", head.join(","))
            })
        };
        let arguments = arguments.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        let stem = |name: &str| name.split(['.', '[']).next().map(str::to_owned);
        let is_part = |column: &&&str| {
            wanted().all(|name| name != **column) && wanted().any(|name| stem(name) == stem(column))
        };
        if let Some(foreign) = head.iter().find(is_part) {
            let wanted = wanted().collect::<Vec<_>>().join(",");
            return Err(format!(
                "has a column `{foreign}`, which isn't a part of the function's parameters or result; the table needs the columns {wanted}"
            ));
        }
        let expected = expected.iter().map(find).collect::<Result<Vec<_>, _>>()?;
        let used = |place: &usize| arguments.contains(place) || expected.contains(place);
        let others = head.iter().enumerate().filter(|(place, _)| !used(place));
        let others = others.map(|(place, name)| ((*name).to_owned(), place)).collect();
        Ok(Self { arguments, expected, others })
    }
}

/// The line of a row, counted from 1. `begins` is the reader's byte position before the row. Skips empty lines.
#[must_use]
pub fn line_of(text: &[u8], begins: usize) -> usize {
    let (before, rest) = text.split_at(begins.min(text.len()));
    let lines = rest.split(|byte| *byte == b'\n');
    let skipped = lines.take_while(|line| matches!(line, [] | [b'\r']));
    1 + before.iter().filter(|byte| **byte == b'\n').count() + skipped.count()
}

/// The byte position of a table's head, which follows comments and blank lines.
#[must_use]
pub fn head_of(text: &[u8]) -> usize {
    let is_above = |line: &&[u8]| line.starts_with(b"#") || line.trim_ascii().is_empty();
    text.split_inclusive(|byte| *byte == b'\n').take_while(is_above).map(<[u8]>::len).sum()
}

/// Checks if the row after byte `at` begins with `#`. Skips blank lines.
#[must_use]
pub fn begins_with_mark(text: &[u8], at: usize) -> bool {
    let rest = text.get(at..).unwrap_or_default();
    let is_blank = |byte: &&u8| matches!(byte, b'\n' | b'\r');
    rest.iter().find(|byte| !is_blank(byte)) == Some(&b'#')
}

/// The error message for a row that begins with `#`.
pub(crate) const MARKED: &str = "this row begins with `#`, but comments are allowed only above the column names: remove \
                                 the row, or quote its first cell";

#[cfg(test)]
mod tests {
    use super::*;

    // Lesson 194
    #[test]
    fn comment_lines_before_the_header_of_a_table_are_skipped() {
        assert_eq!(head_of(b"# facts\r\n\n#\nx,result\n#1,2\n"), 12);
        assert_eq!((head_of(b"x\n"), head_of(b"# no head"), head_of(b"")), (0, 9, 0));
        let text = b"x\n\r\n#1\n2\n";
        assert!(begins_with_mark(text, 2) && !begins_with_mark(text, 0));
        assert!(!begins_with_mark(b"\"#1\"\n", 0), "the cell is in quotes");
    }
}
