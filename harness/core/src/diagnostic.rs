//! Messages that point into the author's files.
//!
//! A [`Diagnostic`] contains the text of each file that it points into, so a caller can show it anywhere: as text with
//! an excerpt (`Display`), or as data ([`Diagnostic::location`]).

mod blame;
mod excerpt;
mod mend;

use std::borrow::Cow;
use std::fmt;
use std::ops::Range;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use codespan_reporting::diagnostic as codespan;
use codespan_reporting::term;

use self::excerpt::{Excerpt, Excerpts};
pub use self::mend::Mend;
use crate::output::visible;
pub use blame::{At, Blame, Blamed};

/// A file of the author, as Karat read it.
#[derive(PartialEq, Eq)]
pub struct SourceFile {
    /// The path as messages show it: relative to the working directory if the file is inside it.
    pub name: String,
    /// The file's text, with values in place of the author's placeholders.
    pub text: String,
    /// The values that replace the author's placeholders, in the order in which they occur in the text. No value
    /// contains a line break.
    pub values: Vec<Value>,
}

/// A value in a file's text, and the placeholder that the value replaces.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Value {
    /// The range of the value's bytes in the text.
    pub at: Range<usize>,
    /// The placeholder as the author wrote it: `{{ N }}`.
    pub placeholder: String,
    /// `true` if messages show the placeholder instead of the value.
    pub hidden: bool,
}

/// Prints only the name. Otherwise `expect` on an error would print the whole text.
impl fmt::Debug for SourceFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SourceFile").field("name", &self.name).finish_non_exhaustive()
    }
}

impl SourceFile {
    /// A file without placeholders.
    #[must_use]
    pub fn new(name: impl Into<String>, text: impl Into<String>) -> Self {
        Self { name: name.into(), text: text.into(), values: Vec::new() }
    }

    /// The author's text, with placeholders instead of values.
    #[must_use]
    pub fn written(&self) -> Cow<'_, str> {
        if self.values.is_empty() {
            return Cow::Borrowed(&self.text);
        }
        let (mut written, mut done) = (String::with_capacity(self.text.len()), 0);
        for Value { at, placeholder, .. } in &self.values {
            written.push_str(&self.text[done..at.start]);
            written.push_str(placeholder);
            done = at.end;
        }
        written.push_str(&self.text[done..]);
        Cow::Owned(written)
    }

    /// Converts a byte offset in `text` to a byte offset in the author's text. An offset inside a value becomes the
    /// start of the value's placeholder.
    #[must_use]
    pub fn written_at(&self, offset: usize) -> usize {
        let (mut text, mut written) = (0, 0);
        for Value { at, placeholder, .. } in &self.values {
            if offset < at.start {
                break;
            }
            written += at.start - text;
            if offset < at.end {
                return written;
            }
            written += placeholder.len();
            text = at.end;
        }
        written + (offset - text)
    }

    /// The file's path, with the hash of the file's contents. `None` for a text in memory, which has a name that begins
    /// with `<`.
    #[doc(hidden)]
    pub fn read(&self) -> Option<FileRead> {
        let file = Path::new(&self.name);
        (!self.name.starts_with('<')).then(|| FileRead::of(file, self.written().as_bytes()))
    }

    /// The line and the column of a byte offset. Line and column begin at 1, and columns count characters.
    #[must_use]
    pub fn line_column(&self, offset: usize) -> (usize, usize) {
        let written = self.written();
        let offset = written.floor_char_boundary(self.written_at(offset.min(self.text.len())));
        let before = &written[..offset];
        let start = before.rfind('\n').map_or(0, |newline| newline + 1);
        let line = before.bytes().filter(|byte| *byte == b'\n').count() + 1;
        (line, before[start..].chars().count() + 1)
    }
}

/// A range of bytes in an author's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Span {
    /// The file.
    pub file: Arc<SourceFile>,
    /// The range of bytes in the file's text.
    pub range: Range<usize>,
}

impl Span {
    /// The author's text of the span's file, and the span's range in that text.
    #[must_use]
    pub fn written(&self) -> (Cow<'_, str>, Range<usize>) {
        let range = self.file.written_at(self.range.start)..self.file.written_at(self.range.end);
        (self.file.written(), range)
    }

    /// Returns the part of the span that is on the span's first line. The whole span could fill a screen.
    #[doc(hidden)]
    pub fn first_line(&self) -> Self {
        let text = self.file.text.get(self.range.clone()).unwrap_or_default();
        let line = text.lines().next().unwrap_or_default().trim_end();
        let range = self.range.start..self.range.start + line.len();
        Self { file: Arc::clone(&self.file), range }
    }
}

impl fmt::Display for Span {
    /// Writes `file:line:column`. Terminals and editors can open a file at a position in this form.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (line, column) = self.file.line_column(self.range.start);
        write!(f, "{}:{line}:{column}", self.file.name)
    }
}

/// A message with labelled positions in the author's files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// The problem, in one sentence.
    pub message: String,
    /// The positions in files, the most important one first. Each position has a remark, which may be empty.
    pub labels: Vec<(Span, String)>,
    /// The next steps.
    pub notes: Vec<String>,
    /// The line of `karat.toml` that may fix the problem.
    pub mend: Option<Mend>,
}

impl Diagnostic {
    /// Makes a message without a position.
    pub fn new(message: impl Into<String>) -> Self {
        Self { message: message.into(), labels: Vec::new(), notes: Vec::new(), mend: None }
    }

    /// Adds a position.
    #[must_use]
    pub fn at(mut self, span: Span, remark: impl Into<String>) -> Self {
        self.labels.push((span, remark.into()));
        self
    }

    /// Adds a hint.
    #[must_use]
    pub fn note(mut self, note: impl Into<String>) -> Self {
        self.notes.push(note.into());
        self
    }

    /// Sets the line of `karat.toml` that may fix the problem.
    #[must_use]
    pub fn mended_by(self, mend: Option<Mend>) -> Self {
        Self { mend, ..self }
    }

    /// The most important position.
    #[must_use]
    pub fn location(&self) -> Option<&Span> {
        self.labels.first().map(|(span, _)| span)
    }

    /// The text of the message with the heading `warning`. A warning doesn't make a test fail.
    #[must_use]
    pub fn to_warning(&self) -> String {
        self.shown(codespan::Severity::Warning)
    }

    fn shown(&self, severity: codespan::Severity) -> String {
        let text = self.render(severity).unwrap_or_else(|_| self.message.clone());
        // Files and drivers can put terminal commands into the names that messages contain.
        without_made_up(&visible(&text)).trim_end().to_owned()
    }

    fn render(
        &self,
        severity: codespan::Severity,
    ) -> Result<String, codespan_reporting::files::Error> {
        let mut files = Excerpts::default();
        let mut known: Vec<(&Arc<SourceFile>, usize)> = Vec::new();
        let mut labels = Vec::new();
        // Moves an end of a range that is after the text or inside a character: an excerpt can't show such a range.
        let within = |span: &Span| {
            let text = &span.file.text;
            text.floor_char_boundary(span.range.start)..text.floor_char_boundary(span.range.end)
        };
        for (index, (span, remark)) in self.labels.iter().enumerate() {
            let same = |(other, _): &&(Span, String)| Arc::ptr_eq(&other.file, &span.file);
            let id = match known.iter().find(|(file, _)| Arc::ptr_eq(file, &span.file)) {
                Some((_, id)) => *id,
                None => {
                    let places = self.labels.iter().filter(same).map(|(span, _)| within(span));
                    let id = files.add(Excerpt::new(&span.file, &places.collect::<Vec<_>>()));
                    known.push((&span.file, id));
                    id
                }
            };
            let (range, excerpt) = (within(span), files.get(id)?);
            let start = excerpt.shown(range.start);
            // Shows an empty range as one caret.
            let range = match range.is_empty() {
                true => start..start,
                false => start..excerpt.shown_end(range.end),
            };
            let label = match index {
                0 => codespan::Label::primary(id, range),
                _ => codespan::Label::secondary(id, range),
            };
            labels.push(label.with_message(remark));
        }
        let diagnostic = codespan::Diagnostic::new(severity)
            .with_message(&self.message)
            .with_labels(labels)
            .with_notes(self.notes.clone());
        let config = term::Config { chars: term::Chars::ascii(), ..term::Config::default() };
        term::emit_into_string(&config, &files, &diagnostic)
    }
}

impl fmt::Display for Diagnostic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.shown(codespan::Severity::Error))
    }
}

impl std::error::Error for Diagnostic {}

/// Replaces each name that Karat generated, such as `karat_value_12`, by a description that the author understands.
fn without_made_up(text: &str) -> String {
    const MADE_UP: [&str; 3] = ["karat_value_", "karat_assert_", "karat_print_"];
    let mut text = text.to_owned();
    for name in MADE_UP {
        while let Some(start) = text.find(name) {
            let digits = text[start + name.len()..].bytes().take_while(u8::is_ascii_digit).count();
            text.replace_range(
                start..start + name.len() + digits,
                "the asserted or printed expression",
            );
        }
    }
    text
}

/// The name in `known` that the author of `unknown` most likely meant. A name is close if its last `::` part equals the
/// last part of `unknown`, or if at most a third of the letters differ. `None` if no name is close.
pub fn nearest<'a>(unknown: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let last = |name: &str| name.rsplit("::").next().unwrap_or_default().to_owned();
    known
        .into_iter()
        .filter(|name| !name.is_empty())
        .map(|name| {
            let whole = strsim::damerau_levenshtein(unknown, name);
            let tail = strsim::damerau_levenshtein(&last(unknown), &last(name));
            // A function with the same name in another module is a better guess than a function with a similar
            // spelling.
            (whole.min(tail + 1), whole, name)
        })
        .filter(|(distance, _, _)| *distance <= (last(unknown).len() / 3).max(1))
        .min()
        .map(|(_, _, name)| name)
}

/// The BLAKE3 hash of a shader's text, in hexadecimal. The line ends `\n` and `\r\n` give the same hash, because git
/// may change line ends.
#[must_use]
pub fn text_hash(text: &[u8]) -> String {
    let mut hasher = blake3::Hasher::new();
    for line in text.split_inclusive(|byte| *byte == b'\n') {
        match line.strip_suffix(b"\r\n") {
            Some(line) => hasher.update(line).update(b"\n"),
            None => hasher.update(line),
        };
    }
    hasher.finalize().to_hex().to_string()
}

/// A file that was read, with the hash of its contents at that time.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
pub struct FileRead {
    /// The file's absolute path.
    pub file: PathBuf,
    /// BLAKE3 of the file's bytes, in hexadecimal. Empty for a missing file.
    pub hash: String,
}

impl FileRead {
    /// Makes the record of a file that has the contents `bytes`.
    #[must_use]
    pub fn of(file: &Path, bytes: &[u8]) -> Self {
        Self { hash: blake3::hash(bytes).to_hex().to_string(), ..Self::missing(file) }
    }

    /// Makes the record of a file that is missing or can't be read. Karat also records missing files, because results
    /// may change when such a file appears.
    #[must_use]
    pub fn missing(file: &Path) -> Self {
        let file = std::path::absolute(file).unwrap_or_else(|_| file.to_owned());
        Self { file, hash: String::new() }
    }

    /// Reads a file, and makes the record of its current contents.
    #[must_use]
    pub fn now(file: &Path) -> Self {
        read_file(file).map_or_else(|_| Self::missing(file), |bytes| Self::of(file, &bytes))
    }
}

/// The bytes of an author's file. Reading a pipe, a socket or a device file (`/dev/zero`) may never end, so the
/// function returns an error for these.
///
/// # Errors
/// Returns an error if the path doesn't exist, isn't a file, or can't be read.
pub fn read_file(file: &Path) -> std::io::Result<Vec<u8>> {
    let kind = std::fs::metadata(file)?;
    if kind.is_file() || kind.is_dir() {
        return std::fs::read(file);
    }
    Err(std::io::Error::other("the path names a pipe, a socket or a device, not a file"))
}

/// A path for messages: relative to the working directory if the path is inside it, otherwise absolute, without `..`.
/// The working directory itself is `.`.
pub fn shown(path: &Path) -> String {
    let here = std::env::current_dir().unwrap_or_default();
    let mut clean = PathBuf::new();
    for component in here.join(path).components() {
        match component {
            Component::ParentDir => {
                clean.pop();
            }
            Component::CurDir => {}
            other => clean.push(other),
        }
    }
    match clean.strip_prefix(&here).unwrap_or(&clean) {
        nothing if nothing.as_os_str().is_empty() => ".".to_owned(),
        path => path.display().to_string(),
    }
}

/// An expression on one line, cut if it is too long.
#[doc(hidden)]
pub fn one_line(text: &str) -> String {
    const MOST: usize = 60;
    let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
    match line.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}...", &line[..end]),
        None => line,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_after_a_placeholder_are_those_of_the_source_file() {
        let value = |at, placeholder: &str| Value {
            at,
            placeholder: placeholder.to_owned(),
            hidden: false,
        };
        let values = vec![value(0..3, "{N}"), value(6..7, "{{ LONG }}"), value(16..20, "é")];
        let file = SourceFile { values, ..SourceFile::new("a.wgsl", "2.0 + 8;\nreturn 1.25;\n") };
        assert_eq!(file.written(), "{N} + {{ LONG }};\nreturn é;\n");
        for (byte, place) in [
            (0, (1, 1)),
            (2, (1, 1)),
            (4, (1, 5)),
            (6, (1, 7)),
            (7, (1, 17)),
            (9, (2, 1)),
            (19, (2, 8)),
            (20, (2, 9)),
        ] {
            assert_eq!(file.line_column(byte), place, "byte {byte}");
        }
        assert_eq!(file.line_column(file.text.len()), (3, 1));
    }

    #[test]
    fn lines_and_columns_count_characters_from_one() {
        let file = SourceFile::new("a", "é = 1\nx\n");
        assert_eq!(file.line_column(0), (1, 1));
        assert_eq!(file.line_column(3), (1, 3));
        assert_eq!(file.line_column(7), (2, 1));
        assert_eq!(file.line_column(999), (3, 1));
    }

    #[test]
    fn paths_are_relative_and_never_empty() {
        let here = std::env::current_dir().expect("a working directory");
        let above = here.parent().expect("a folder");
        for (path, expected) in [
            (Path::new("."), "."),
            (Path::new(""), "."),
            (&here, "."),
            (&here.join("a/.."), "."),
            (Path::new("a/../b"), "b"),
            (above, &above.display().to_string()),
        ] {
            assert_eq!(shown(path), expected, "{}", path.display());
        }
    }

    fn at(text: &str, range: Range<usize>) -> Diagnostic {
        let file = Arc::new(SourceFile::new("a.wgsl", text));
        Diagnostic::new("it is wrong").at(Span { file, range }, "here")
    }

    // Lesson 63
    #[test]
    fn a_long_line_is_cut_and_its_place_is_the_author_s() {
        let text = format!("first\n{}bad{}\nlast\n", "(".repeat(1 << 20), ")".repeat(1 << 20));
        let start = 6 + (1 << 20);
        let text = at(&text, start..start + 3).to_string();
        let expected = format!(
            "error: it is wrong\n  --> a.wgsl:2:1048577\n  |\n2 | …{}bad{}…\n  | {}^^^ here",
            "(".repeat(40),
            ")".repeat(57),
            " ".repeat(41),
        );
        assert_eq!(text, expected);
    }

    // Lesson 62
    #[test]
    fn control_characters_in_diagnostics_are_escaped() {
        let hostile = "\u{1b}[2J\u{9b}\u{202e}";
        let mut diagnostic = at(&format!("// {hostile} bad\n"), 12..15).note(hostile);
        diagnostic.message.push_str(hostile);
        let file = SourceFile::new(format!("a\n{hostile}"), "");
        let span = Span { file: Arc::new(file), range: 0..0 };
        let text = diagnostic.at(span, hostile).to_string();
        assert!(!text.contains(['\u{1b}', '\u{9b}', '\u{202e}']), "{text:?}");
        assert_eq!(text.matches(r"\u{1b}[2J\u{9b}\u{202e}").count(), 5, "{text}");
        assert!(text.contains(r"a\n\u{1b}"), "{text}");
    }

    #[test]
    fn nearest_names() {
        let known = ["fresnel::schlick", "fresnel::dielectric", "geometry::v_cavity"];
        assert_eq!(nearest("fresnel::schlik", known), Some("fresnel::schlick"));
        assert_eq!(nearest("schlick", known), Some("fresnel::schlick"));
        assert_eq!(nearest("brdf::v_cavity", known), Some("geometry::v_cavity"));
        assert_eq!(nearest("noise::perlin", known), None);
    }
}
