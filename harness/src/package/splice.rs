//! Copies text from the author's files, and records each change.
//!
//! A change replaces one token, such as a name or `discard`, or blanks a text but keeps its line ends. So each position
//! in the text maps back to one position in a file, and undoing the changes must give the author's bytes.
//! [`Spliced::check`] checks this in each run, without the linker's lexer.

use std::ops::Range;
use std::sync::Arc;

use crate::diagnostic::{Diagnostic, SourceFile, Span};

#[derive(Clone, Debug, Default)]
pub(crate) struct Spliced {
    text: String,
    pieces: Vec<Piece>,
}

/// The assignment that replaces `discard` in a function that a kernel calls.
pub(crate) const DISCARDED: &str = "karat_discarded = true";

/// A range of a file, copied with its edits.
#[derive(Clone, Debug)]
struct Piece {
    at: Range<usize>,
    file: Arc<SourceFile>,
    from: Range<usize>,
    edits: Vec<Placed>,
}

/// A change, with its range in the author's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Edit {
    pub(super) from: Range<usize>,
    /// The replacement: a name, or the value of `#{NAME}`. `None` blanks the text.
    pub(super) name: Option<String>,
}

#[derive(Clone, Debug)]
struct Placed {
    at: Range<usize>,
    edit: Edit,
}

impl Spliced {
    pub(crate) fn text(&self) -> &str {
        &self.text
    }

    /// Appends a range of a file. The edits are in order and don't overlap.
    pub(super) fn copy(&mut self, file: &Arc<SourceFile>, from: Range<usize>, edits: Vec<Edit>) {
        if !self.text.is_empty() && !self.text.ends_with('\n') {
            self.text.push('\n');
        }
        let start = self.text.len();
        let mut placed = Vec::with_capacity(edits.len());
        let mut done = from.start;
        for edit in edits {
            self.text.push_str(&file.text[done..edit.from.start]);
            let begin = self.text.len();
            match &edit.name {
                Some(name) => self.text.push_str(name),
                None => self.text.extend(file.text[edit.from.clone()].chars().flat_map(blank)),
            }
            done = edit.from.end;
            placed.push(Placed { at: begin..self.text.len(), edit });
        }
        self.text.push_str(&file.text[done..from.end]);
        let piece =
            Piece { at: start..self.text.len(), file: Arc::clone(file), from, edits: placed };
        self.pieces.push(piece);
    }

    /// Appends Karat's own text, which [`check`](Self::check) skips.
    pub(crate) fn append(&mut self, text: &str) {
        self.text.push_str(text);
    }

    /// For each copied piece of a file, its range in the linked text, and its location in the file.
    pub(crate) fn stretches(&self) -> Vec<(Range<usize>, Span)> {
        let of = |piece: &Piece| {
            let span = Span { file: Arc::clone(&piece.file), range: piece.from.clone() };
            (piece.at.clone(), span)
        };
        self.pieces.iter().map(of).collect()
    }

    /// The location in the author's file of a range of the text; `None` outside of the copied ranges.
    pub(crate) fn resolve(&self, range: Range<usize>) -> Option<Span> {
        let index = self.pieces.partition_point(|piece| piece.at.end <= range.start);
        let piece = self.pieces.get(index).filter(|piece| piece.at.start <= range.start)?;
        let start = piece.original(range.start, false);
        let last = range.end.clamp(range.start, piece.at.end);
        let end = piece.original(last, true).max(start);
        Some(Span { file: Arc::clone(&piece.file), range: start..end })
    }

    /// Checks that undoing the edits gives the author's bytes. Also checks that each edit only blanks text, or replaces
    /// a whole name, a `#{NAME}`, a `discard` or a call's `(`, and that only line ends separate the copied ranges.
    ///
    /// # Errors
    /// Returns an error if the check fails. Then the linker has a bug, and the linked text isn't the author's program.
    pub(super) fn check(&self) -> Result<(), Box<Diagnostic>> {
        let mut done = 0;
        for piece in &self.pieces {
            let fault = |what: &str, range: Range<usize>| {
                let span = Span { file: Arc::clone(&piece.file), range };
                let message = format!("Karat's linker changed this shader's text: {what}");
                Box::new(Diagnostic::new(message).at(span, "").note(
                    "this is a bug in Karat. Karat ran nothing, because the linked text differs from your shader",
                ))
            };
            let lost = || fault("text between two declarations isn't blank", piece.from.clone());
            let between = self.text.get(done..piece.at.start).ok_or_else(lost)?;
            if !between.bytes().all(|byte| byte == b'\n') {
                return Err(lost());
            }
            let mut original = String::new();
            let mut at = piece.at.start;
            let mut from = piece.from.start;
            for Placed { at: placed, edit } in &piece.edits {
                let here = || edit.from.clone();
                let copied = self.text.get(at..placed.start);
                original.push_str(copied.ok_or_else(|| fault("edits overlap", here()))?);
                let author = piece.file.text.get(edit.from.clone());
                let author =
                    author.ok_or_else(|| fault("an edit's position isn't in the file", here()))?;
                let now = self.text.get(placed.clone()).unwrap_or_default();
                let sound = match &edit.name {
                    // The value of `#{NAME}` or `#NAME`.
                    Some(value) if author.starts_with('#') => {
                        now == value
                            && (author.starts_with("#{") && author.ends_with('}')
                                || is_name(&author[1..]))
                            && value
                                .bytes()
                                .all(|byte| byte.is_ascii_alphanumeric() || byte == b'-')
                    }
                    // The `(` of an expectation's call: behind it, Karat inserts the number of the call's location.
                    Some(told) if author == "(" => {
                        let before = piece.file.text[..edit.from.start].trim_end();
                        now == told && is_place(told) && before.ends_with(belongs)
                    }
                    // The `discard` of a function that a kernel calls.
                    Some(assigned) if author == "discard" => now == assigned && now == DISCARDED,
                    Some(name) => {
                        now == name
                            && is_name(name)
                            && is_name(author)
                            && is_apart(&piece.file.text, &edit.from)
                            && is_apart(&self.text, placed)
                    }
                    None => {
                        now.len() == author.len()
                            && author.bytes().zip(now.bytes()).all(|(was, is)| match was {
                                b'\n' | b'\r' => is == was,
                                _ => is == b' ',
                            })
                    }
                };
                if !sound || edit.from.start < from {
                    return Err(fault("an edit replaces more than a name", here()));
                }
                original.push_str(author);
                (at, from) = (placed.end, edit.from.end);
            }
            original.push_str(self.text.get(at..piece.at.end).ok_or_else(lost)?);
            if piece.file.text.get(piece.from.clone()) != Some(original.as_str()) {
                return Err(fault(
                    "undoing the edits doesn't restore the file",
                    piece.from.clone(),
                ));
            }
            done = piece.at.end;
        }
        if done == self.text.len() {
            return Ok(());
        }
        Err(Box::new(Diagnostic::new(
            "Karat's linker added text to your shader: this is a bug in Karat",
        )))
    }
}

impl Piece {
    /// The offset in the file for an offset in the spliced text. An offset inside of a replaced name maps to the
    /// name's start or end.
    fn original(&self, offset: usize, end: bool) -> usize {
        let index = self.edits.partition_point(|edit| edit.at.start <= offset);
        let Some(Placed { at, edit }) = index.checked_sub(1).map(|last| &self.edits[last]) else {
            return self.from.start + (offset - self.at.start);
        };
        if offset >= at.end {
            return edit.from.end + (offset - at.end);
        }
        match edit.name {
            Some(_) if end && offset > at.start => edit.from.end,
            Some(_) => edit.from.start,
            None => edit.from.start + (offset - at.start),
        }
    }
}

/// Replaces a character by one space for each of its bytes. Line ends stay.
fn blank(character: char) -> impl Iterator<Item = char> {
    let ends = matches!(character, '\n' | '\r');
    std::iter::repeat_n(if ends { character } else { ' ' }, character.len_utf8())
}

/// Checks if a text is one name, without the linker's lexer.
fn is_name(text: &str) -> bool {
    let starts = text.chars().next().is_some_and(|c| belongs(c) && !c.is_ascii_digit());
    starts && text.chars().all(belongs)
}

/// Checks if a text is `(` with a number that Karat inserted: `(17u, `. The number identifies the location of the call.
fn is_place(text: &str) -> bool {
    let number = text.strip_prefix('(').map(|rest| rest.strip_suffix(", ").unwrap_or(rest));
    let digits = number.and_then(|number| number.strip_suffix('u'));
    digits.is_some_and(|digits| {
        !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit())
    })
}

/// Checks that the range is a whole name: the characters before and after the range don't belong to a name.
fn is_apart(text: &str, range: &Range<usize>) -> bool {
    let before = text[..range.start].chars().next_back();
    let after = text[range.end..].chars().next();
    ![before, after].into_iter().flatten().any(belongs)
}

/// Checks if a character may be in a name: a letter, a digit, `_`, or a character beyond ASCII that isn't a blank.
fn belongs(character: char) -> bool {
    let mark = !character.is_ascii() && !character.is_whitespace();
    character == '_' || character.is_alphanumeric() || mark
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(text: &str) -> Arc<SourceFile> {
        Arc::new(SourceFile::new("f.wgsl", text))
    }

    fn spliced(original: &str) -> Spliced {
        let file = file(original);
        let mut spliced = Spliced::default();
        let at = |word: &str| {
            let start = original.find(word).expect("in the text");
            start..start + word.len()
        };
        let edits = vec![
            Edit { from: at("@if(ä)\n"), name: None },
            Edit { from: at("scale"), name: Some("package_math_scale".into()) },
        ];
        spliced.copy(&file, at("fn f() {").start..original.len(), edits);
        spliced.copy(&file, 0..10, Vec::new());
        spliced
    }

    const ORIGINAL: &str = "// comment\nfn f() {\n  @if(ä)\n return scale( x ) + y;\n}";

    // Lesson 50: exact places
    #[test]
    fn places_survive_names_and_blanks() {
        let spliced = spliced(ORIGINAL);
        spliced.check().expect("sound");
        let text = spliced.text();
        assert_eq!(
            text,
            "fn f() {\n         \n return package_math_scale( x ) + y;\n}\n// comment"
        );
        let resolve = |word: &str| {
            let start = text.find(word).expect("in the text");
            let span = spliced.resolve(start..start + word.len()).expect("copied");
            ORIGINAL[span.range].to_owned()
        };
        assert_eq!(resolve("package_math_scale( x ) + y"), "scale( x ) + y");
        assert_eq!(resolve("math"), "scale");
        assert_eq!(resolve("y;"), "y;");
        assert_eq!(resolve("// comment"), "// comment");
        assert_eq!(spliced.resolve(0..4).map(|s| s.to_string()), Some("f.wgsl:2:1".into()));
        let start = text.find("return").expect("in the text");
        let span = spliced.resolve(start..start + 6).expect("copied");
        assert_eq!(span.to_string(), "f.wgsl:4:2");
        assert_eq!(spliced.resolve(text.len()..text.len() + 5), None);
    }

    /// The check detects each error that a faulty linker could make.
    // Lesson 50: edits are undone without the lexer
    #[test]
    fn changes_of_the_source_bytes_are_detected() {
        let sound = spliced(ORIGINAL);
        let damage = |change: &dyn Fn(&mut Spliced)| {
            let mut spliced = sound.clone();
            change(&mut spliced);
            assert!(spliced.check().is_err(), "{:?}", spliced.text);
        };
        damage(&|s| s.text = s.text.replace("+ y", "- y"));
        damage(&|s| s.text = s.text.replace("( x )", "(x  )"));
        damage(&|s| s.text.push_str("\nconst A = 1;"));
        damage(&|s| s.text = s.text.replace("package_math_scale", "package_math_scole"));
        damage(&|s| s.text = s.text.replace("{\n   ", "{\n ; "));
        let edited = |from: Range<usize>, name: Option<&str>| {
            let mut spliced = Spliced::default();
            let edit = Edit { from, name: name.map(str::to_owned) };
            spliced.copy(&file("ab + cd"), 0..7, vec![edit]);
            spliced.check().is_ok()
        };
        assert!(edited(0..2, Some("x")) && edited(0..2, None) && edited(3..4, None));
        assert!(!edited(0..1, Some("x")), "half a name");
        assert!(!edited(1..2, Some("x")), "half a name");
        assert!(!edited(3..4, Some("x")), "no name");
        assert!(!edited(0..7, Some("x")), "more than a name");
        assert!(!edited(0..2, Some("x + y")), "not a name");
        let told = |text: &str, told: &str| {
            let mut spliced = Spliced::default();
            let from = text.find('(').expect("in the text");
            let edit = Edit { from: from..from + 1, name: Some(told.to_owned()) };
            spliced.copy(&file(text), 0..text.len(), vec![edit]);
            spliced.check().is_ok()
        };
        assert!(told("f(x)", "(7u, ") && told("f()", "(7u"));
        for wrong in ["(7u, 1.0 + ", "(u, ", "(7, ", "((7u, ", "(x, "] {
            assert!(!told("f(x)", wrong), "{wrong}");
        }
        assert!(!told("2 * (x)", "(7u, "), "no call");
    }
}
