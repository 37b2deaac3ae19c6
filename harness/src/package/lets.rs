//! Finds the `let` statements of a function in a linked text.

use std::ops::Range;

use super::lexer::{Kind, Token, lex};

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct LetStatement {
    pub(crate) name: Range<usize>,
    /// The offset after the statement's semicolon; `None` if the `let` is in the head of a `for`, where no statement
    /// can follow.
    pub(crate) end: Option<usize>,
    /// `true` if the `let` is in a loop, and so has one value in each iteration.
    pub(crate) repeats: bool,
}

pub(crate) fn let_statements(text: &str, function: &str) -> Vec<LetStatement> {
    let tokens = lex(text);
    let is_word = |token: &Token, word: &str| {
        token.kind == Kind::Word && text.get(token.range()) == Some(word)
    };
    let head = |pair: &[Token]| is_word(&pair[0], "fn") && is_word(&pair[1], function);
    let Some(start) = tokens.windows(2).position(head) else { return Vec::new() };
    let mut open: Vec<u8> = Vec::new();
    // For each open loop, the number of open brackets around it. The flag is set between a loop's keyword and its `{`.
    let (mut loops, mut awaited): (Vec<usize>, bool) = (Vec::new(), false);
    let mut found: Vec<LetStatement> = Vec::new();
    // The `let` with the initialiser that this code is reading, and the number of open brackets around the `let`.
    let mut reading: Option<(Range<usize>, usize)> = None;
    for (index, token) in tokens.iter().enumerate().skip(start) {
        match token.kind {
            Kind::Symbol(bracket @ (b'(' | b'[' | b'{')) => {
                if bracket == b'{' && std::mem::take(&mut awaited) {
                    loops.push(open.len());
                }
                open.push(bracket);
            }
            Kind::Symbol(b')' | b']' | b'}') => {
                open.pop();
                if token.is(b'}') && loops.last() == Some(&open.len()) {
                    loops.pop();
                }
                if open.is_empty() && token.is(b'}') {
                    break;
                }
            }
            Kind::Symbol(b';') => {
                if let Some((name, depth)) = reading.take() {
                    if depth != open.len() {
                        reading = Some((name, depth));
                        continue;
                    }
                    let end = (open.last() == Some(&b'{')).then_some(token.range().end);
                    let repeats = !loops.is_empty() || awaited;
                    found.push(LetStatement { name, end, repeats });
                }
            }
            Kind::Word if ["for", "while", "loop"].iter().any(|word| is_word(token, word)) => {
                awaited = true;
            }
            Kind::Word if is_word(token, "let") => {
                let name = tokens.get(index + 1).map(Token::range).unwrap_or_default();
                reading = Some((name, open.len()));
            }
            _ => {}
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_let_of_the_function_is_found() {
        let text = "fn other() { let no = 1; }\n\
                    fn f(let_it: f32) -> f32 {\n\
                    let a /* ; */ = max(let_it, 1.0); let b: vec2<f32> = (vec2f(a)); // let c = 1;\n\
                    for (let d = a; a < 1.0;) { let e = b[0]\n; }\n\
                    return a; }\nfn last() { let no = 1; }\n";
        let found = let_statements(text, "f");
        let shown: Vec<(&str, &str)> = found
            .iter()
            .map(|one| (&text[one.name.clone()], one.end.map_or("", |end| &text[end - 2..end])))
            .collect();
        assert_eq!(shown, [("a", ");"), ("b", ");"), ("d", ""), ("e", "\n;")]);
        let repeats: Vec<bool> = found.iter().map(|one| one.repeats).collect();
        assert_eq!(repeats, [false, false, true, true]);
        let after = "fn f() { loop { if true { break; } let a = 1; } let b = 2; }";
        let repeats: Vec<bool> = let_statements(after, "f").iter().map(|one| one.repeats).collect();
        assert_eq!(repeats, [true, false]);
        assert_eq!(let_statements(text, "g"), []);
    }
}
