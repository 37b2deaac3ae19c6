//! Locations in the form of the protocol: URIs, and columns in UTF-16 units.

use std::ops::Range as Bytes;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use karat::unstable::diagnostic::Span;
use lsp_types::{Position, Range, Uri};

/// Returns the file of a `file` URI. Resolves links if the file exists.
pub(super) fn file(uri: &str) -> Option<PathBuf> {
    let rest = uri.strip_prefix("file://")?;
    // The URI may have a host before the path. Only files of this machine can be read.
    let path = rest.strip_prefix("localhost").unwrap_or(rest);
    let path = decoded(path.split(['?', '#']).next()?)?;
    let path = match path.as_bytes() {
        // `/C:/folder`
        [b'/', drive, b':', ..] if cfg!(windows) && drive.is_ascii_alphabetic() => &path[1..],
        [b'/', ..] => &path,
        _ => return None,
    };
    Some(resolved(Path::new(path)))
}

/// Returns a file's path with links resolved, or the same path if the file doesn't exist.
pub(super) fn resolved(path: &Path) -> PathBuf {
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    whole.canonicalize().unwrap_or(whole)
}

fn decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::new();
    let mut rest = text.as_bytes();
    while let Some((first, after)) = rest.split_first() {
        rest = after;
        if *first != b'%' {
            bytes.push(*first);
            continue;
        }
        let digits = std::str::from_utf8(after.get(..2)?).ok()?;
        bytes.push(u8::from_str_radix(digits, 16).ok()?);
        rest = &after[2..];
    }
    // A null character would end the name in system calls.
    String::from_utf8(bytes).ok().filter(|text| !text.contains('\0'))
}

/// Returns the URI of a file, or `None` if its name isn't valid Unicode.
pub(super) fn uri(file: &Path) -> Option<Uri> {
    let path = file.to_str()?.replace('\\', if cfg!(windows) { "/" } else { "\\" });
    let mut text = "file://".to_owned();
    if !path.starts_with('/') {
        text.push('/');
    }
    for byte in path.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'-' | b'.' | b'_' | b'~' => {
                text.push(char::from(byte));
            }
            _ => text += &format!("%{byte:02X}"),
        }
    }
    Uri::from_str(&text).ok()
}

/// Returns the range of a span in the author's text.
pub(super) fn of(span: &Span) -> Range {
    let (text, bytes) = span.written();
    Lines::of(&text).range(&bytes)
}

/// A text with an index of positions, which makes it fast to find a position at the end of a long text.
pub(super) struct Lines<'t> {
    text: &'t str,
    /// Byte offsets with their positions, in steps of about [`STEP`] bytes.
    marks: Vec<(usize, Position)>,
}

/// The smallest distance between two marks, in bytes.
const STEP: usize = 64;

impl<'t> Lines<'t> {
    pub(super) fn of(text: &'t str) -> Self {
        let mut at = Position::default();
        let mut marks = vec![(0, at)];
        for (offset, c) in text.char_indices() {
            if marks.last().is_none_or(|(last, _)| offset - last >= STEP) {
                marks.push((offset, at));
            }
            advance(&mut at, c);
        }
        Self { text, marks }
    }

    /// Returns a range of bytes as lines and columns. An offset beyond the end of the text counts as the end.
    pub(super) fn range(&self, bytes: &Bytes<usize>) -> Range {
        let place = |offset: usize| {
            let (mut at, read) = self.before(offset);
            read.chars().for_each(|c| advance(&mut at, c));
            at
        };
        Range { start: place(bytes.start), end: place(bytes.end.max(bytes.start)) }
    }

    /// Returns the position of the last mark before an offset, and the text between the mark and the offset.
    fn before(&self, offset: usize) -> (Position, &'t str) {
        let offset = self.text.floor_char_boundary(offset);
        let behind = self.marks.partition_point(|(mark, _)| *mark <= offset);
        let (mark, at) = self.marks[behind.saturating_sub(1)];
        (at, &self.text[mark..offset])
    }
}

fn advance(at: &mut Position, c: char) {
    if c == '\n' {
        *at = Position { line: at.line.saturating_add(1), character: 0 };
    } else {
        at.character = at.character.saturating_add(number(c.len_utf16()));
    }
}

/// Returns the range from a column to the end of its line. Lines and columns count from 1; columns count characters. If
/// the text has no such line, the range is empty.
pub(super) fn rest_of_line(text: &str, line: u32, column: u32) -> Range {
    let index = line.saturating_sub(1);
    let whole = text.lines().nth(index as usize).unwrap_or_default().trim_end();
    let before = whole.chars().take(column.saturating_sub(1) as usize);
    let start = before.map(char::len_utf16).sum::<usize>();
    let end = whole.encode_utf16().count().max(start);
    let at = |column| Position { line: index, character: number(column) };
    Range { start: at(start), end: at(end) }
}

fn number(count: usize) -> u32 {
    u32::try_from(count).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_have_uris_and_others_none() {
        let folder = tempfile::tempdir().expect("a folder");
        let folder = folder.path().canonicalize().expect("it is there");
        for name in ["plain.wgsl", "two words.wgsl", "100%25 \u{e9} #?.wgsl"] {
            let path = folder.join(name);
            let known = uri(&path).expect("a URI");
            assert_eq!(file(known.as_str()), Some(path), "{}", known.as_str());
        }
        for other in [
            "untitled:Untitled-1",
            "file://",
            "file:a",
            "",
            "file:///%",
            "file:///%zz",
            "file:///%00",
        ] {
            assert_eq!(file(other), None, "{other}");
        }
    }

    #[test]
    fn columns_count_units_of_utf16() {
        let text = "a\n\u{1f980}b c\n";
        let found = Lines::of(text).range(&(6..7));
        assert_eq!((found.start.line, found.start.character, found.end.character), (1, 2, 3));
        let rest = rest_of_line(text, 2, 2);
        assert_eq!((rest.start.line, rest.start.character, rest.end.character), (1, 2, 5));
        let behind = Lines::of(text).range(&(90..99));
        assert_eq!((behind.start, behind.end.line), (behind.end, 2));
        let none = rest_of_line(text, 9, 9);
        assert_eq!((none.start.line, none.start.character, none.end.character), (8, 0, 0));
    }

    /// The time to find a place doesn't depend on the length of the text before it.
    // Lesson 166
    #[test]
    fn places_of_a_long_text_take_as_little_as_those_of_a_short_one() {
        let many = 20_000;
        let lines = "fn f(x: f32) -> f32 { return x; }\n".repeat(many);
        let one_line = "fn \u{1f980}() {} ".repeat(many);
        for text in [&lines, &one_line] {
            let found = Lines::of(text);
            let mut read = 0;
            for (offset, _) in text.match_indices("fn ") {
                read += found.before(offset).1.len();
            }
            assert!(read <= many * (STEP + 4), "{read} bytes for {many} places");
            let (last, _) = text.rmatch_indices("fn ").next().expect("many");
            let line = text[..last].matches('\n').count();
            let start = text[..last].rfind('\n').map_or(0, |newline| newline + 1);
            let column = text[start..last].encode_utf16().count();
            let place = found.range(&(last..last)).start;
            assert_eq!((place.line as usize, place.character as usize), (line, column));
        }
    }
}
