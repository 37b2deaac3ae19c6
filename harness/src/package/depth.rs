//! How deep a text nests.

use std::ops::Range;

use super::lexer::{Kind, lex};

/// Tokens of nested expressions, and branches of one `else if` chain, that a compiler is given: it
/// recurses over terms, members, brackets and branches.
const MOST_NESTED: usize = 6_000;

/// The first place of a text that nests deeper than compilers are given to recurse. Only what
/// commas and semicolons don't separate counts: a long list isn't deep.
pub(super) fn deepest(text: &str) -> Option<Range<usize>> {
    // For each open bracket, the tokens since the last separator, and branches in a row.
    let mut levels = vec![(0_usize, 0_usize)];
    let mut sum = 0;
    let tokens = lex(text);
    for (index, token) in tokens.iter().enumerate() {
        let (length, branches) = levels.last_mut().expect("one is always left");
        match token.kind {
            Kind::Symbol(b'(' | b'[' | b'{') => {
                *length += 1;
                sum += 1;
                levels.push((0, 0));
            }
            Kind::Symbol(b')' | b']' | b'}') => {
                sum -= *length;
                *length = 0;
                // One that closes nothing is for naga to refuse.
                if levels.len() > 1 {
                    levels.pop();
                }
                let (length, branches) = levels.last_mut().expect("one is always left");
                let goes_on = tokens.get(index + 1).is_some_and(|t| &text[t.range()] == "else");
                if token.is(b'}') {
                    sum -= *length;
                    *length = 0;
                    *branches = if goes_on { *branches + 1 } else { 0 };
                    if *branches > MOST_NESTED {
                        return Some(token.range());
                    }
                }
            }
            Kind::Symbol(b',' | b';') => {
                sum -= *length;
                *length = 0;
                *branches = 0;
            }
            _ => {
                *length += 1;
                sum += 1;
            }
        }
        if sum > MOST_NESTED {
            return Some(token.range());
        }
    }
    None
}
