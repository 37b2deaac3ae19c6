//! Colours for messages on a terminal: the headline, the location, and the marked part of the source line.

use super::super::table::{BAD, DIM, HEAD, KNOWN};

/// Adds colours to a message. If colours are off, the output stream removes the colour codes later.
pub(in crate::cli) fn painted(message: &str) -> String {
    message.lines().map(line).collect::<Vec<_>>().join("\n")
}

pub(in crate::cli) fn line(line: &str) -> String {
    let trimmed = line.trim_start();
    let indent = &line[..line.len() - trimmed.len()];
    for (word, style) in [("error", BAD), ("warning", KNOWN)] {
        if let Some(rest) = line.strip_prefix(word).filter(|rest| rest.starts_with([':', '['])) {
            return format!("{style}{word}{style:#}{HEAD}{rest}{HEAD:#}");
        }
    }
    if trimmed.starts_with("--> ") || trimmed.starts_with("replay: ") {
        return format!("{indent}{DIM}{trimmed}{DIM:#}");
    }
    if line.starts_with("on ") || trimmed.starts_with("it fails ") {
        return format!("{indent}{HEAD}{trimmed}{HEAD:#}");
    }
    // A line of a source excerpt: `12 |  return a / b;`, or the carets below it.
    let Some((gutter, text)) = line.split_once('|') else { return line.to_owned() };
    if !gutter.chars().all(|c| c == ' ' || c.is_ascii_digit()) {
        return line.to_owned();
    }
    let is_mark = gutter.trim().is_empty() && text.contains(['^', '-']);
    let text = match is_mark {
        true => format!("{BAD}{text}{BAD:#}"),
        false => text.to_owned(),
    };
    format!("{DIM}{gutter}|{DIM:#}{text}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a text without colours.
    fn plain(text: &str) -> String {
        let mut plain = String::new();
        let mut rest = text;
        while let Some((before, behind)) = rest.split_once('\u{1b}') {
            plain.push_str(before);
            rest = behind.split_once('m').map_or("", |(_, rest)| rest);
        }
        plain + rest
    }

    #[test]
    fn colours_do_not_change_the_text_of_a_message() {
        let message = "error: `a::b` fails agrees_with: 4 ulp\n  --> a.wgsl:3:1\n  |\n3 | fn b() -> f32 {\n  | ^^^^^^ here\n\n\
                       on vulkan: llvmpipe\n  4 of 9 cases fail, 1 | 2\n  it fails where x is 0\n    actual = 1\n  replay: cargo test";
        let painted = painted(message);
        assert_eq!(plain(&painted), message);
        let of = |part: &str| painted.lines().find(|line| line.contains(part)).unwrap_or_default();
        for part in
            ["fails agrees_with", "a.wgsl:3:1", "^^^^^^", "llvmpipe", "x is 0", "cargo test"]
        {
            assert!(of(part).contains('\u{1b}'), "{part}");
        }
        for part in ["1 | 2", "actual = 1"] {
            assert!(!of(part).contains('\u{1b}'), "{part}");
        }
    }
}
