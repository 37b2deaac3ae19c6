//! Splits WGSL text into the tokens that mutations need.

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// A name or a keyword.
    Word,
    Number,
    /// An operator or a bracket. The longest match wins, but each angle bracket of a template is a separate token.
    Symbol,
}

/// A token of WGSL. Comments and blanks separate tokens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Token<'a> {
    pub(crate) kind: Kind,
    pub(crate) text: &'a str,
    pub(crate) start: usize,
}

impl Token<'_> {
    pub(crate) fn end(&self) -> usize {
        self.start + self.text.len()
    }
}

/// Operators with more than one character, longer ones first.
const LONG: [&str; 20] = [
    "<<=", ">>=", "&&", "||", "==", "!=", "<=", ">=", "+=", "-=", "*=", "/=", "%=", "&=", "|=",
    "^=", "++", "--", "<<", ">>",
];

/// Splits text into tokens. Text that isn't WGSL gives arbitrary tokens, but no error.
pub(crate) fn tokens(text: &str) -> Vec<Token<'_>> {
    let mut found = Vec::new();
    let mut at = 0;
    while let Some(next) = text[at..].chars().next() {
        let rest = &text[at..];
        if next.is_whitespace() {
            at += next.len_utf8();
        } else if rest.starts_with("//") {
            at += rest.find('\n').unwrap_or(rest.len());
        } else if rest.starts_with("/*") {
            at += block_comment(rest);
        } else {
            let (kind, length) = token(rest, next);
            found.push(Token { kind, text: &rest[..length], start: at });
            at += length;
        }
    }
    found
}

/// The length of the comment at the start of a text, including nested comments.
fn block_comment(text: &str) -> usize {
    let mut depth = 0;
    let mut at = 0;
    while at < text.len() {
        if text[at..].starts_with("/*") {
            depth += 1;
            at += 2;
        } else if text[at..].starts_with("*/") {
            depth -= 1;
            at += 2;
            if depth == 0 {
                break;
            }
        } else {
            at += text[at..].chars().next().map_or(1, char::len_utf8);
        }
    }
    at
}

fn token(rest: &str, next: char) -> (Kind, usize) {
    let leading = |of: &dyn Fn(char) -> bool| rest.find(|c| !of(c)).unwrap_or(rest.len());
    let second = rest.chars().nth(1);
    if next.is_alphabetic() || next == '_' {
        (Kind::Word, leading(&|c| c.is_alphanumeric() || c == '_'))
    } else if next.is_ascii_digit() || next == '.' && second.is_some_and(|c| c.is_ascii_digit()) {
        (Kind::Number, number(rest))
    } else {
        let long = LONG.iter().find(|long| rest.starts_with(**long));
        (Kind::Symbol, long.map_or(next.len_utf8(), |long| long.len()))
    }
}

/// The length of the number at the start of a text: digits, letters, points, and signs of exponents.
fn number(text: &str) -> usize {
    let hexadecimal = text.starts_with("0x") || text.starts_with("0X");
    let exponents = if hexadecimal { ['p', 'P'] } else { ['e', 'E'] };
    let mut before = ' ';
    for (at, c) in text.char_indices() {
        let sign = (c == '+' || c == '-') && exponents.contains(&before);
        if !(c.is_ascii_alphanumeric() || c == '.' || sign) {
            return at;
        }
        before = c;
    }
    text.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(text: &str) -> Vec<&str> {
        tokens(text).into_iter().map(|token| token.text).collect()
    }

    #[test]
    fn text_falls_into_tokens() {
        let text = "a+=1.5e-3f*-b.xy; // no token\n/* nor /* this */ */ c<=0x1.8p-3 && d>>2u";
        let expected = [
            "a", "+=", "1.5e-3f", "*", "-", "b", ".", "xy", ";", "c", "<=", "0x1.8p-3", "&&", "d",
            ">>", "2u",
        ];
        assert_eq!(texts(text), expected);
    }

    #[test]
    fn tokens_know_where_they_are() {
        let text = "let é = 1.0 - x;";
        for token in tokens(text) {
            assert_eq!(&text[token.start..token.end()], token.text);
        }
        assert_eq!(texts("x.x + .5"), ["x", ".", "x", "+", ".5"]);
        assert_eq!(texts("/* open"), [""; 0]);
    }
}
