//! Splits WGSL into words, numbers and symbols, each with its range.
//!
//! The linker needs tokens only to find declarations and names, so each symbol is a separate token (`>>` is two
//! tokens). The linker never generates text from tokens: it copies text from the author's file.

use std::ops::Range;

use unicode_ident::{is_xid_continue, is_xid_start};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// An identifier or a keyword.
    Word,
    /// A literal number with its suffix.
    Number,
    /// One ASCII symbol.
    Symbol(u8),
    /// A character that begins no token of WGSL.
    Unknown,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Token {
    pub(super) kind: Kind,
    start: u32,
    end: u32,
}

impl Token {
    pub(super) fn range(&self) -> Range<usize> {
        self.start as usize..self.end as usize
    }

    /// A token for a `;` that the author omitted.
    pub(super) fn end(at: usize) -> Self {
        let at = place(at);
        Self { kind: Kind::Symbol(b';'), start: at, end: at }
    }

    pub(super) fn is(&self, symbol: u8) -> bool {
        self.kind == Kind::Symbol(symbol)
    }
}

fn place(offset: usize) -> u32 {
    u32::try_from(offset).expect("a module has less than 4 GiB")
}

const SYMBOLS: &str = "!%&()*+,-./:;<=>@[]^{|}~";

/// All tokens of a text, in order. Only blanks and comments lie between tokens.
pub(super) fn lex(text: &str) -> Vec<Token> {
    let mut tokens = Vec::with_capacity(text.len() / 4);
    let mut at = 0;
    while let Some(first) = text[at..].chars().next() {
        let rest = &text[at..];
        let (kind, length) = match first {
            _ if is_blank(first) => (None, first.len_utf8()),
            '/' if rest.starts_with("//") => (None, rest.find(ends_line).unwrap_or(rest.len())),
            '/' if rest.starts_with("/*") => match comment(rest) {
                Some(length) => (None, length),
                None => (Some(Kind::Unknown), rest.len()),
            },
            _ if is_xid_start(first) || first == '_' => {
                (Some(Kind::Word), run(rest, is_xid_continue))
            }
            '0'..='9' => (Some(Kind::Number), number(rest)),
            '.' if rest[1..].starts_with(|c: char| c.is_ascii_digit()) => {
                (Some(Kind::Number), number(rest))
            }
            _ if SYMBOLS.contains(first) => (Some(Kind::Symbol(rest.as_bytes()[0])), 1),
            _ => (Some(Kind::Unknown), first.len_utf8()),
        };
        if let Some(kind) = kind {
            tokens.push(Token { kind, start: place(at), end: place(at + length) });
        }
        at += length;
    }
    tokens
}

pub(crate) fn texts(text: &str) -> Vec<&str> {
    lex(text).iter().map(|token| &text[token.range()]).collect()
}

fn run(text: &str, belongs: impl Fn(char) -> bool) -> usize {
    text.find(|c| !belongs(c)).unwrap_or(text.len())
}

/// The length of a numeric literal: its digits, letters and points, and the sign of its exponent.
fn number(text: &str) -> usize {
    let bytes = text.as_bytes();
    let hexadecimal = bytes.len() > 1 && bytes[0] == b'0' && matches!(bytes[1], b'x' | b'X');
    let exponent: &[u8] = if hexadecimal { b"pP" } else { b"eE" };
    let mut length = 0;
    while let Some(byte) = bytes.get(length) {
        let signed = matches!(byte, b'+' | b'-')
            && exponent.contains(&bytes[length.saturating_sub(1)])
            && bytes.get(length + 1).is_some_and(u8::is_ascii_digit);
        if !(byte.is_ascii_alphanumeric() || *byte == b'.' || signed) {
            break;
        }
        length += 1;
    }
    length
}

/// The length of a block comment, which may contain other comments; `None` if it doesn't end.
fn comment(text: &str) -> Option<usize> {
    let (mut depth, mut at) = (0_usize, 0);
    let bytes = text.as_bytes();
    while at + 1 < bytes.len() {
        match &bytes[at..at + 2] {
            b"/*" => (depth, at) = (depth + 1, at + 2),
            b"*/" => (depth, at) = (depth - 1, at + 2),
            _ => at += 1,
        }
        if depth == 0 {
            return Some(at);
        }
    }
    None
}

/// Checks if a character is a blank: Unicode's Pattern_White_Space (WGSL, section 3.2).
fn is_blank(c: char) -> bool {
    ends_line(c) || matches!(c, ' ' | '\t' | '\u{200e}' | '\u{200f}')
}

/// Checks if a character is a line break (WGSL, section 3.2).
fn ends_line(c: char) -> bool {
    matches!(c, '\n'..='\r' | '\u{85}' | '\u{2028}' | '\u{2029}')
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<&str> {
        lex(text).iter().map(|token| &text[token.range()]).collect()
    }

    #[test]
    fn a_number_literal_is_one_token() {
        for number in ["0x1.8p-3", "0x1p4f", "0X.8P+1", "1e-5f", "1.", ".5h", "2147483648i", "1lf"]
        {
            assert_eq!(words(number), [number]);
            assert_eq!(lex(number)[0].kind, Kind::Number);
        }
        assert_eq!(words("0x1e-3"), ["0x1e", "-", "3"], "a hexadecimal e is a digit");
        assert_eq!(words("1-x"), ["1", "-", "x"]);
        assert_eq!(words("v.x"), ["v", ".", "x"]);
    }

    #[test]
    fn comments_nest_and_end_at_every_line_break() {
        assert_eq!(words("a/* b /* c */ d */e"), ["a", "e"]);
        assert_eq!(words("a // b\rc // d\u{85}e // f\u{2028}g"), ["a", "c", "e", "g"]);
        assert_eq!(lex("a /* b")[1].kind, Kind::Unknown);
    }

    // Lesson 49: text is copied from the author's bytes
    #[test]
    fn unknown_characters_are_tokens() {
        for text in ["x $", "'x'", "\u{0}", "\\", "a \u{fe0f} b", "\u{feff}a"] {
            assert!(lex(text).iter().any(|token| token.kind == Kind::Unknown), "{text:?}");
        }
        assert_eq!(words("Δλ = _é"), ["Δλ", "=", "_é"]);
    }
}
