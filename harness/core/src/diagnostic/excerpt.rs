//! Excerpts of authors' files, with shortened lines and escaped terminal commands.
//!
//! Only the shown text changes: the numbers of lines and columns stay those of the author's file.

use std::ops::Range;

use codespan_reporting::files::{Error, Files};

use super::SourceFile;
use crate::output::visible;

/// The largest number of columns that a message shows of a line. In a longer line, the message shows only the text
/// around the error's position.
const WIDTH: usize = 100;
/// The number of columns that a message shows before the error's position, if the text after the position fills the
/// other columns.
const BEFORE: usize = 40;
const CUT: &str = "…";

/// A file's text as messages show it. The excerpt can convert each offset to an offset in the author's text.
#[derive(Debug)]
pub(super) struct Excerpt<'a> {
    file: &'a SourceFile,
    text: String,
    /// The ranges that differ from the author's text, in order. Each entry consists of the range in the author's text
    /// and the range in the shown text.
    changes: Vec<(Range<usize>, Range<usize>)>,
    /// The byte at which each shown line begins.
    lines: Vec<usize>,
}

impl<'a> Excerpt<'a> {
    /// Makes the excerpt of a file for a message about the byte ranges `places`. Long lines are cut around these
    /// ranges.
    pub(super) fn new(file: &'a SourceFile, places: &[Range<usize>]) -> Self {
        let mut excerpt =
            Self { file, text: String::new(), changes: Vec::new(), lines: Vec::new() };
        let mut start = 0;
        for line in file.text.split_inclusive('\n') {
            let end = start + line.len();
            excerpt.lines.push(excerpt.text.len());
            let content = line.trim_end_matches(['\r', '\n']);
            let at = start..start + content.len();
            // For a range over several lines, the line that contains the range's end also shows this end.
            let points = places.iter().flat_map(|place| {
                let one = place.end <= end;
                [Some(place.start), (!one || place.start < start).then_some(place.end)]
            });
            let mut points: Vec<usize> =
                points.flatten().filter(|point| (at.start..=at.end).contains(point)).collect();
            points.sort_unstable();
            excerpt.push(at.clone(), &points);
            excerpt.text.push_str(&line[content.len()..]);
            start = end;
        }
        if file.text.is_empty() || file.text.ends_with('\n') {
            excerpt.lines.push(excerpt.text.len());
        }
        excerpt
    }

    fn push(&mut self, line: Range<usize>, points: &[usize]) {
        let mut at = line.start;
        for kept in kept(&self.file.text, line.clone(), points) {
            self.cut(at..kept.start);
            self.copy(kept.clone());
            at = kept.end;
        }
        self.cut(at..line.end);
    }

    fn cut(&mut self, from: Range<usize>) {
        if !from.is_empty() {
            self.change(from, CUT);
        }
    }

    fn change(&mut self, from: Range<usize>, to: &str) {
        let start = self.text.len();
        self.text.push_str(to);
        self.changes.push((from, start..self.text.len()));
    }

    fn copy(&mut self, from: Range<usize>) {
        let mut at = from.start;
        let is_in = |range: &Range<usize>| range.start < from.end && from.start < range.end;
        for value in self.file.values.iter().filter(|value| value.hidden && is_in(&value.at)) {
            self.copy_visible(at..value.at.start.max(at));
            // If the value is cut, the author's text is shown for the rest.
            let own = value.at.start.max(at)..value.at.end.min(from.end);
            at = own.end;
            self.change(own, &visible(&value.placeholder));
        }
        self.copy_visible(at..from.end);
    }

    fn copy_visible(&mut self, from: Range<usize>) {
        let text = &self.file.text[from.clone()];
        if visible(text) == text {
            self.text.push_str(text);
            return;
        }
        for (place, character) in text.char_indices() {
            let place = from.start + place;
            let mut own = [0; 4];
            let own = &*character.encode_utf8(&mut own);
            match visible(own) {
                shown if shown == own => self.text.push(character),
                shown => self.change(place..place + own.len(), &shown),
            }
        }
    }

    /// Converts an offset in the author's text to an offset in the shown text. An offset inside of a changed range
    /// becomes the start of the range's replacement.
    pub(super) fn shown(&self, byte: usize) -> usize {
        let after = self.changes.partition_point(|(from, _)| from.end <= byte);
        match self.changes.get(after) {
            Some((from, to)) if from.start <= byte => to.start,
            _ => match after.checked_sub(1).map(|last| &self.changes[last]) {
                Some((from, to)) => to.end + (byte - from.end),
                None => byte,
            },
        }
    }

    /// Converts the end of a range in the author's text to an offset in the shown text.
    pub(super) fn shown_end(&self, byte: usize) -> usize {
        let after = self.changes.partition_point(|(from, _)| from.end < byte);
        match self.changes.get(after) {
            Some((from, to)) if from.start < byte => to.end,
            _ => self.shown(byte),
        }
    }

    /// Converts an offset in the shown text to an offset in the author's text.
    fn author(&self, byte: usize) -> usize {
        let after = self.changes.partition_point(|(_, to)| to.end <= byte);
        match self.changes.get(after) {
            Some((from, to)) if to.start <= byte => from.start,
            _ => match after.checked_sub(1).map(|last| &self.changes[last]) {
                Some((from, to)) => from.end + (byte - to.end),
                None => byte,
            },
        }
    }
}

/// The parts of a line that are shown: the whole line if it fits, otherwise the text around the points. If there are no
/// points, only the line's beginning is shown.
fn kept(text: &str, line: Range<usize>, points: &[usize]) -> Vec<Range<usize>> {
    if forward(text, line.clone(), WIDTH).0 == line.end {
        return vec![line];
    }
    let own = [line.start];
    let points = if points.is_empty() { &own } else { points };
    let mut kept: Vec<Range<usize>> = Vec::new();
    for &point in points {
        if kept.last().is_some_and(|last| last.end > point) {
            continue;
        }
        let floor = kept.last().map_or(line.start, |last| last.end);
        // Columns that the text before the point doesn't need are used for the text after the point.
        let (_, spare) = forward(text, point..line.end, WIDTH - BEFORE);
        let (start, spare) = backward(text, floor..point, BEFORE + spare);
        let (end, _) = forward(text, point..line.end, WIDTH - BEFORE + spare);
        match kept.last_mut() {
            Some(last) if last.end == start => last.end = end,
            _ => kept.push(start..end),
        }
    }
    kept
}

/// The number of columns that a character takes in a message. Wide characters count as one column.
fn columns(character: char) -> usize {
    visible(character.encode_utf8(&mut [0; 4])).chars().count()
}

/// The end of the text that fits into `room` columns from the beginning of a range, and the number of unused columns.
fn forward(text: &str, range: Range<usize>, room: usize) -> (usize, usize) {
    let (mut end, mut room) = (range.start, room);
    for character in text[range].chars() {
        match room.checked_sub(columns(character)) {
            Some(left) => (end, room) = (end + character.len_utf8(), left),
            None => break,
        }
    }
    (end, room)
}

/// The beginning of the text that fits into `room` columns before the end of a range, and the number of unused columns.
fn backward(text: &str, range: Range<usize>, room: usize) -> (usize, usize) {
    let (mut start, mut room) = (range.end, room);
    for character in text[range].chars().rev() {
        match room.checked_sub(columns(character)) {
            Some(left) => (start, room) = (start - character.len_utf8(), left),
            None => break,
        }
    }
    (start, room)
}

#[derive(Debug, Default)]
pub(super) struct Excerpts<'a>(Vec<Excerpt<'a>>);

impl<'a> Excerpts<'a> {
    pub(super) fn add(&mut self, excerpt: Excerpt<'a>) -> usize {
        self.0.push(excerpt);
        self.0.len() - 1
    }

    pub(super) fn get(&self, file: usize) -> Result<&Excerpt<'a>, Error> {
        self.0.get(file).ok_or(Error::FileMissing)
    }
}

impl<'a, 'b: 'a> Files<'a> for Excerpts<'b> {
    type FileId = usize;
    type Name = String;
    type Source = &'a str;

    fn name(&'a self, file: usize) -> Result<String, Error> {
        // A name is always shown on one line.
        Ok(visible(&self.get(file)?.file.name).replace('\n', "\\n"))
    }

    fn source(&'a self, file: usize) -> Result<&'a str, Error> {
        Ok(&self.get(file)?.text)
    }

    fn line_index(&'a self, file: usize, byte: usize) -> Result<usize, Error> {
        Ok(self.get(file)?.lines.partition_point(|start| *start <= byte).saturating_sub(1))
    }

    fn line_range(&'a self, file: usize, line: usize) -> Result<Range<usize>, Error> {
        let Excerpt { text, lines, .. } = self.get(file)?;
        let too_large = Error::LineTooLarge { given: line, max: lines.len().saturating_sub(1) };
        let start = *lines.get(line).ok_or(too_large)?;
        Ok(start..lines.get(line + 1).copied().unwrap_or(text.len()))
    }

    fn column_number(&'a self, file: usize, _: usize, byte: usize) -> Result<usize, Error> {
        let excerpt = self.get(file)?;
        Ok(excerpt.file.line_column(excerpt.author(byte)).1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn excerpt(text: &str, places: &[(usize, usize)], check: impl Fn(&Excerpt<'_>)) -> String {
        let file = SourceFile::new("a", text);
        let excerpt = Excerpt::new(
            &file,
            &places.iter().map(|(start, end)| *start..*end).collect::<Vec<_>>(),
        );
        check(&excerpt);
        excerpt.text.clone()
    }

    #[test]
    fn short_lines_are_not_changed() {
        for text in ["", "a", "a\n", "\n\n", "é\r\n\tb\r\n", &"x".repeat(WIDTH)] {
            let shown = excerpt(text, &[(0, text.len())], |excerpt| {
                for byte in 0..=text.len() {
                    assert_eq!((excerpt.shown(byte), excerpt.author(byte)), (byte, byte));
                }
            });
            assert_eq!(shown, text);
        }
    }

    // Lesson 63
    #[test]
    fn a_long_line_is_cut_around_its_places() {
        let long = "a".repeat(500) + "HERE" + &"b".repeat(500) + "\nnext\n";
        let shown = excerpt(&long, &[(500, 504)], |excerpt| {
            let place = excerpt.text.find("HERE").expect("it is shown");
            assert_eq!((excerpt.shown(500), excerpt.shown_end(504)), (place, place + 4));
            assert_eq!(excerpt.author(place), 500);
            // An offset in cut text becomes the offset of the mark `…`. Offsets in later lines move with these lines.
            assert_eq!(excerpt.shown(3), 0);
            assert_eq!(&excerpt.text[excerpt.shown(1005)..], "next\n");
        });
        assert_eq!(shown, format!("…{}HERE{}…\nnext\n", "a".repeat(40), "b".repeat(56)));
        // Near one end of the line, the excerpt shows more text on the other side. Two positions give two parts.
        let at = |places: &[(usize, usize)]| excerpt(&long, places, |_| ());
        assert_eq!(at(&[(0, 1)]), format!("{}…\nnext\n", "a".repeat(100)));
        assert_eq!(at(&[(1003, 1004)]), format!("…{}\nnext\n", "b".repeat(100)));
        assert_eq!(at(&[(1005, 1006)]), format!("{}…\nnext\n", "a".repeat(100)));
        let two = format!("{}…{}…\nnext\n", "a".repeat(100), "b".repeat(100));
        assert_eq!(at(&[(0, 1), (700, 701)]), two);
        // For a range that is longer than a line, the excerpt shows the beginning and the text after it.
        let shown = excerpt(&long, &[(10, 900)], |excerpt| {
            assert_eq!(&excerpt.text[..excerpt.shown_end(900)], "a".repeat(100) + "…");
        });
        assert_eq!(shown, format!("{}…\nnext\n", "a".repeat(100)));
    }

    #[test]
    fn control_characters_are_escaped_in_excerpts() {
        let text = "é\u{1b}[2J\u{9b}x\r\nrest";
        let shown = excerpt(text, &[(6, 8)], |excerpt| {
            for (byte, character) in text.char_indices() {
                let shown = excerpt.shown(byte);
                assert_eq!(excerpt.author(shown), byte, "{character:?}");
                let own = visible(character.encode_utf8(&mut [0; 4])).into_owned();
                assert!(character == '\r' || excerpt.text[shown..].starts_with(&own));
            }
        });
        assert_eq!(shown, "é\\u{1b}[2J\\u{9b}x\r\nrest");
        // Each character of an escape counts as one column.
        let long = "\u{1b}".repeat(60) + "x";
        let shown = excerpt(&long, &[(60, 61)], |_| ());
        assert_eq!(shown, format!("…{}x", r"\u{1b}".repeat(16)));
    }
}
