//! Writes text for people. The text can't send commands to a terminal. If the program that reads the output ends early,
//! as `head` does, Karat still finishes its work.
//!
//! Karat doesn't trust the names of files and drivers or the texts of shaders. So Karat escapes every character, as in
//! `\u{1b}`, except for printable characters, line ends and tabs. Karat doesn't escape its own colours: it marks each
//! [`Style`] with a random number that only this process knows.

use std::borrow::Cow;
use std::fmt;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, ErrorKind, Write};
use std::sync::LazyLock;

/// The colour and weight of a piece of text. In a format string, `{BAD}` begins the style `BAD`, and `{BAD:#}` ends it.
/// The field contains the terminal commands (ECMA-48, SGR) that begin the style.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Style(&'static str);

impl Style {
    /// The style for success.
    pub const GOOD: Self = Self("\u{1b}[32m");
    /// The style for known issues.
    pub const KNOWN: Self = Self("\u{1b}[33m");
    /// The style for failures.
    pub const BAD: Self = Self("\u{1b}[1m\u{1b}[31m");
    /// The style for headings and the most important text.
    pub const HEAD: Self = Self("\u{1b}[1m");
    /// The style for the least important text.
    pub const DIM: Self = Self("\u{1b}[2m");
    /// No style.
    pub const PLAIN: Self = Self("");
}

/// The mark that replaces the escape character in Karat's own styles until an [`Output`] writes the text. The mark
/// contains random digits, so no program can guess it and put it into a name.
static MARK: LazyLock<String> = LazyLock::new(|| {
    let number = || RandomState::new().build_hasher().finish();
    format!("\u{1b}{:016x}{:016x}", number(), number())
});

impl fmt::Display for Style {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let end = if self.0.is_empty() { "" } else { "\u{1b}[0m" };
        f.write_str(&trusted(if f.alternate() { end } else { self.0 }))
    }
}

/// Marks the terminal commands in a text as Karat's own, so that an [`Output`] writes them unchanged.
#[must_use]
pub fn trusted(text: &str) -> String {
    text.replace('\u{1b}', &MARK)
}

/// Marks the colours in a text of another program, so that an [`Output`] writes them unchanged. The output still
/// escapes all other terminal commands in the text.
#[must_use]
pub fn with_colours(text: &str) -> String {
    let mut parts = text.split('\u{1b}');
    let mut marked = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let is_parameter = |c: char| c.is_ascii_digit() || c == ';';
        let after = part.strip_prefix('[').map(|rest| rest.trim_start_matches(is_parameter));
        let is_colour = after.is_some_and(|after| after.starts_with('m'));
        marked.push_str(if is_colour { &MARK } else { "\u{1b}" });
        marked.push_str(part);
    }
    marked
}

/// A count with its noun: `1 check`, `12 checks`. The plural of the noun must end in `s`.
#[must_use]
pub fn counted(count: impl TryInto<u64>, one: &str) -> String {
    // A count that doesn't fit into `u64` gets the plural.
    match count.try_into().unwrap_or(u64::MAX) {
        1 => format!("1 {one}"),
        many => format!("{many} {one}s"),
    }
}

/// Checks if Karat escapes a character. Karat escapes the characters that terminals interpret as commands, that change
/// the direction of text, or that XML can't contain. `\n` and tabs are allowed.
fn commands(character: char) -> bool {
    match character {
        '\n' | '\t' => false,
        '\u{61c}' | '\u{200e}' | '\u{200f}' => true, // marks of direction
        '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => true, // overrides and isolates
        '\u{2028}' | '\u{2029}' => true,             // ends of lines and paragraphs
        '\u{fffe}' | '\u{ffff}' => true,             // not characters: XML can't contain them
        _ => character.is_control(),
    }
}

/// Escapes terminal commands in a text, as in `\u{1b}`. The line ends `\n` and `\r\n` stay.
#[must_use]
pub fn visible(text: &str) -> Cow<'_, str> {
    escaped(text, |character| format!("\\u{{{:x}}}", u32::from(character)))
}

/// The first non-empty line of a message, without the prefix `error: `.
///
/// ```
/// assert_eq!(karat_core::output::headline("\nerror: no module `a`\n  --> b.wgsl:1:1"), "no module `a`");
/// ```
#[must_use]
pub fn headline(message: &str) -> &str {
    let line = message.lines().find(|line| !line.trim().is_empty()).unwrap_or_default().trim();
    line.strip_prefix("error: ").unwrap_or(line)
}

/// A text on one line: like [`visible`], but line ends and tabs are also escaped.
#[must_use]
pub fn one_line(text: &str) -> Cow<'_, str> {
    let ends = |character: char| matches!(character, '\n' | '\r' | '\t') || commands(character);
    if !text.contains(ends) {
        return Cow::Borrowed(text);
    }
    let shown = |character: char| match ends(character) {
        true => format!("\\u{{{:x}}}", u32::from(character)),
        false => character.to_string(),
    };
    Cow::Owned(text.chars().map(shown).collect())
}

/// The length of the longest name, in bytes. This limit keeps replay commands, which contain several names, short
/// enough for Linux: an argument can have at most 128 KiB.
const LONGEST_NAME: usize = 1000;

/// A name in a form that every output format accepts: on one line (see [`one_line`]), and of at most 1000 bytes. A
/// longer name is cut and gets a hash at its end, so that two long names stay different.
#[must_use]
pub fn name(text: &str) -> Cow<'_, str> {
    name_within(text, LONGEST_NAME)
}

/// Like [`name`], with at most `most` bytes. For example, the name of a file can have only 255 bytes.
#[doc(hidden)]
pub fn name_within(text: &str, most: usize) -> Cow<'_, str> {
    let shown = one_line(text);
    if shown.len() <= most {
        return shown;
    }
    let hash = &blake3::hash(text.as_bytes()).to_hex()[..18];
    let kept = shown.floor_char_boundary(most.saturating_sub(hash.len() + "..".len()));
    Cow::Owned(format!("{}..{hash}", &shown[..kept]))
}

/// Escapes a text for a Markdown table: the text can't end the table's cell, and can't contain an HTML tag, a link, an
/// image or code.
#[must_use]
pub fn markdown(text: &str) -> String {
    let text = text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;");
    let text = text.replace("](", "]&#40;").replace('|', "&#124;").replace('`', "&#96;");
    visible(&text.replace(['\n', '\r'], " ")).into_owned()
}

/// Escapes terminal commands in JSON, as [`visible`] does in other text. In JSON, such commands occur only in strings,
/// and become `\u001b`.
#[must_use]
pub fn visible_json(json: &str) -> Cow<'_, str> {
    escaped(json, |character| format!("\\u{:04x}", u32::from(character)))
}

fn escaped(text: &str, escape: impl Fn(char) -> String) -> Cow<'_, str> {
    if !text.contains(commands) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len());
    let mut characters = text.chars().peekable();
    while let Some(character) = characters.next() {
        if commands(character) && !(character == '\r' && characters.peek() == Some(&'\n')) {
            shown.push_str(&escape(character));
        } else {
            shown.push(character);
        }
    }
    Cow::Owned(shown)
}

/// Turns Karat's marks into terminal commands, and escapes the rest of the text as [`visible`] does.
fn styled(text: &str) -> String {
    let parts: Vec<_> = text.split(MARK.as_str()).map(visible).collect();
    parts.join("\u{1b}")
}

/// A writer of text for people, line by line.
///
/// Writing never fails. If the program that reads the output closes the stream, the rest of the text is dropped. So a
/// command does the same work and has the same exit code as if all its output were read. [`finish`](Self::finish)
/// returns an error if the stream failed, but not if it was closed.
#[derive(Debug)]
pub struct Output<W: Write> {
    inner: W,
    /// The text after the last line end.
    line: Vec<u8>,
    state: State,
}

#[derive(Debug)]
enum State {
    Open,
    /// The program that reads the output closed the stream.
    Unread,
    Failed(io::Error),
}

impl Output<anstream::AutoStream<io::StdoutLock<'static>>> {
    /// A writer to standard output, with colours if standard output is a terminal that supports colours.
    #[must_use]
    pub fn stdout() -> Self {
        Self::new(anstream::stdout().lock())
    }
}

impl Output<anstream::AutoStream<io::Stderr>> {
    /// A writer to standard error. It takes no lock, so other code may write to standard error at the same time.
    #[must_use]
    pub fn stderr() -> Self {
        Self::new(anstream::stderr())
    }
}

impl<W: Write> Output<W> {
    /// Makes a writer that writes to `inner`.
    pub fn new(inner: W) -> Self {
        Self { inner, line: Vec::new(), state: State::Open }
    }

    /// Writes the text after the last line end, and flushes the stream.
    ///
    /// # Errors
    /// Returns an error if a write failed for a reason other than a closed stream.
    pub fn finish(mut self) -> io::Result<()> {
        self.pass_on(self.line.len());
        self.attempt(Write::flush);
        match std::mem::replace(&mut self.state, State::Unread) {
            State::Failed(error) => Err(error),
            State::Open | State::Unread => Ok(()),
        }
    }

    fn pass_on(&mut self, bytes: usize) {
        let rest = self.line.split_off(bytes);
        let text = std::mem::replace(&mut self.line, rest);
        if !text.is_empty() {
            let text = styled(&String::from_utf8_lossy(&text));
            self.attempt(|inner| inner.write_all(text.as_bytes()));
        }
    }

    fn attempt(&mut self, write: impl FnOnce(&mut W) -> io::Result<()>) {
        if !matches!(self.state, State::Open) {
            return;
        }
        match write(&mut self.inner) {
            Ok(()) => {}
            Err(error) if error.kind() == ErrorKind::BrokenPipe => self.state = State::Unread,
            Err(error) => self.state = State::Failed(error),
        }
    }
}

impl<W: Write> Write for Output<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.line.extend_from_slice(bytes);
        if let Some(end) = self.line.iter().rposition(|byte| *byte == b'\n') {
            self.pass_on(end + 1);
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.pass_on(self.line.len());
        self.attempt(Write::flush);
        Ok(())
    }
}

impl<W: Write> Drop for Output<W> {
    fn drop(&mut self) {
        self.pass_on(self.line.len());
        self.attempt(Write::flush);
    }
}

/// Writes a message to standard error. If standard error is closed, the text is lost.
pub fn tell(text: &str) {
    let mut err = Output::stderr();
    // Writing to an `Output` never fails.
    drop(writeln!(err, "{text}"));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn written(parts: &[&[u8]]) -> String {
        let mut bytes = Vec::new();
        let mut output = Output::new(&mut bytes);
        for part in parts {
            output.write_all(part).expect("writing never fails");
        }
        output.finish().expect("memory");
        String::from_utf8(bytes).expect("UTF-8")
    }

    // Lesson 62
    #[test]
    fn control_characters_are_escaped() {
        for (text, shown) in [
            ("a\u{1b}[31mb", r"a\u{1b}[31mb"),
            ("\u{9b}2J\u{7f}\u{0}\u{8}", r"\u{9b}2J\u{7f}\u{0}\u{8}"),
            ("a\rb\r\nc\td\n", "a\\u{d}b\r\nc\td\n"),
            ("\u{202e}x\u{2066}\u{200f}\u{61c}", r"\u{202e}x\u{2066}\u{200f}\u{61c}"),
            ("a\u{2028}b", r"a\u{2028}b"),
            ("é 漢 👩\u{200d}👩 … \\u{1b}", "é 漢 👩\u{200d}👩 … \\u{1b}"),
        ] {
            assert_eq!(visible(text), shown);
            assert_eq!(written(&[text.as_bytes()]), shown);
            assert_eq!(visible(&visible(text)), shown, "a second call changes nothing");
        }
        let json = "[\"\u{9b}2J\u{202e}\"]\n";
        assert_eq!(visible_json(json), "[\"\\u009b2J\\u202e\"]\n");
    }

    #[test]
    fn pieces_of_a_line_are_put_together() {
        let text = "é\u{9b}\r\nx";
        for cut in 0..text.len() {
            let (one, other) = text.as_bytes().split_at(cut);
            assert_eq!(written(&[one, other]), "é\\u{9b}\r\nx", "{cut}");
        }
        assert_eq!(written(&[b"a\xffb\x9bc"]), "a\u{fffd}b\u{fffd}c");
    }

    // Lesson 62
    #[test]
    fn only_known_colour_escapes_are_printed() {
        let (bad, foreign) = (Style::BAD, "\u{1b}[32m\u{1b}0123456789abcdef0123456789abcdefa");
        let text = format!("{bad}{foreign}{bad:#} {}plain{:#}", Style::PLAIN, Style::PLAIN);
        let expected = "\u{1b}[1m\u{1b}[31m\\u{1b}[32m\\u{1b}0123456789abcdef0123456789abcdefa\
                        \u{1b}[0m plain";
        assert_eq!(written(&[text.as_bytes()]), expected);
        for style in [Style::GOOD, Style::KNOWN, Style::BAD, Style::HEAD, Style::DIM] {
            let text = written(&[format!("{style}x{style:#}").as_bytes()]);
            assert_eq!(text, format!("{}x\u{1b}[0m", style.0));
        }
        let other = with_colours("\u{1b}[1;31mred\u{1b}[m \u{1b}[2J \u{1b}]0;x\u{7}\u{1b}[31");
        let expected = "\u{1b}[1;31mred\u{1b}[m \\u{1b}[2J \\u{1b}]0;x\\u{7}\\u{1b}[31";
        assert_eq!(written(&[other.as_bytes()]), expected);
    }

    /// A writer that accepts a given number of bytes, and then fails with a given error. It keeps the accepted bytes.
    struct Failing(usize, ErrorKind, Vec<u8>);

    impl Write for Failing {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if self.2.len() >= self.0 {
                return Err(self.1.into());
            }
            self.2.extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            if self.2.len() >= self.0 { Err(self.1.into()) } else { Ok(()) }
        }
    }

    // Lesson 57
    #[test]
    fn a_full_disk_is_an_error_and_a_closed_pipe_is_not() {
        for (room, kind, good) in [
            (0, ErrorKind::BrokenPipe, true),
            (3, ErrorKind::BrokenPipe, true),
            (0, ErrorKind::StorageFull, false),
            (3, ErrorKind::StorageFull, false),
        ] {
            let mut failing = Failing(room, kind, Vec::new());
            let mut output = Output::new(&mut failing);
            for _ in 0..3 {
                writeln!(output, "line").expect("the command goes on");
                output.flush().expect("the command goes on");
            }
            let finished = output.finish();
            assert_eq!(finished.is_ok(), good, "{room} {kind:?}");
            assert_eq!(finished.err().map(|error| error.kind()), (!good).then_some(kind));
            assert_eq!(failing.2.len(), if room == 0 { 0 } else { 5 });
        }
    }
}
