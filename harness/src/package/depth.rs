//! Measures how deeply the expressions of a text nest.

use std::ops::Range;

use super::lexer::{Kind, lex};

/// The largest number of tokens in nested expressions, and the largest number of branches in an `else if` chain. If a
/// text exceeds this limit, Karat doesn't give the text to a compiler. Compilers recurse over terms, members, brackets
/// and branches, and would overflow their stack.
const MOST_NESTED: usize = 6_000;

/// The first token at which a text exceeds the limit [`MOST_NESTED`]. Commas and semicolons end an expression, so a
/// long list isn't deep.
pub(super) fn deepest(text: &str) -> Option<Range<usize>> {
    // For each open bracket, the numbers of tokens since the last separator, and of `else if` branches in a row.
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
                // naga reports a closing bracket without a partner.
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
