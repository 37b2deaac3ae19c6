//! Removes comments and extra blanks from a text.

/// A text without comments, with single blanks between words, and without blanks at its ends.
pub(crate) fn plain(text: &str) -> String {
    let mut plain = String::with_capacity(text.len());
    let mut rest = text;
    loop {
        // The loop copies bytes that can't end a word or begin a comment. Karat runs this code for each test at
        // each edit, so the code works on bytes.
        let is_ours = |byte: &u8| *byte == b'/' || byte.is_ascii_whitespace() || !byte.is_ascii();
        let word = rest.bytes().position(|byte| is_ours(&byte)).unwrap_or(rest.len());
        plain.push_str(&rest[..word]);
        rest = &rest[word..];
        let Some(first) = rest.chars().next() else { break };
        let skipped = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            nested(rest)
        } else if first.is_whitespace() {
            first.len_utf8()
        } else {
            plain.push(first);
            rest = &rest[first.len_utf8()..];
            continue;
        };
        if !plain.is_empty() && !plain.ends_with(' ') {
            plain.push(' ');
        }
        rest = &rest[skipped..];
    }
    plain.truncate(plain.trim_end().len());
    plain
}

/// The length of a block comment, which may contain other comments.
fn nested(text: &str) -> usize {
    let (mut depth, mut at) = (0_usize, 0);
    while at < text.len() {
        if text[at..].starts_with("/*") {
            (depth, at) = (depth + 1, at + 2);
        } else if text[at..].starts_with("*/") {
            (depth, at) = (depth - 1, at + 2);
            if depth == 0 {
                return at;
            }
        } else {
            at += text[at..].chars().next().map_or(1, char::len_utf8);
        }
    }
    text.len()
}

#[cfg(test)]
mod tests {
    use super::plain;

    #[test]
    fn comments_and_extra_blanks_are_removed_from_plain_text() {
        let text = "fn f() { // a\n    /* b /* c */ d */ return;\t}\n";
        assert_eq!(plain(text), "fn f() { return; }");
        assert_eq!(plain("a/**/b"), "a b", "a comment separates");
        assert_ne!(plain("a - -b"), plain("a --b"));
        assert_eq!(plain("x /* never closed"), "x");
        assert_eq!(plain("// above\n x // beside"), "x", "no blank is left at either end");
        assert_eq!(plain("α\u{a0}/ β // γ"), "α / β", "blanks beyond ASCII, and a quotient");
    }
}
