//! Rows of tables, and the comments above them.
//!
//! Comments are the lines above a table's head that begin with `#`. Below it such a line may as well be a row
//! whose first cell begins so, and a row that is left out is one that isn't compared: it is an error.

/// Where a table's head begins, in bytes: behind comments and blank lines.
#[must_use]
pub fn head_of(text: &[u8]) -> usize {
    let is_above = |line: &&[u8]| line.starts_with(b"#") || line.trim_ascii().is_empty();
    text.split_inclusive(|byte| *byte == b'\n').take_while(is_above).map(<[u8]>::len).sum()
}

/// True if a row begins with `#`, where a reader stands `at` this byte before it. Blank lines may follow.
#[must_use]
pub fn begins_with_mark(text: &[u8], at: usize) -> bool {
    let rest = text.get(at..).unwrap_or_default();
    let is_blank = |byte: &&u8| matches!(byte, b'\n' | b'\r');
    rest.iter().find(|byte| !is_blank(byte)) == Some(&b'#')
}

/// That a row begins with `#`.
pub(crate) const MARKED: &str = "this row begins with `#`, and comments stand above the head: remove it, or quote \
                                 its first cell";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_stand_above_the_head() {
        assert_eq!(head_of(b"# facts\r\n\n#\nx,result\n#1,2\n"), 12);
        assert_eq!((head_of(b"x\n"), head_of(b"# no head"), head_of(b"")), (0, 9, 0));
        let text = b"x\n\r\n#1\n2\n";
        assert!(begins_with_mark(text, 2) && !begins_with_mark(text, 0));
        assert!(!begins_with_mark(b"\"#1\"\n", 0), "it is quoted");
    }
}
