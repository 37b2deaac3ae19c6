//! Finds the ends of attributes, declarations and items by their brackets.

use std::ops::Range;
use std::sync::Arc;

use super::PackageError;
use super::lexer::{Kind, Token};
use crate::diagnostic::{Diagnostic, SourceFile, Span};

/// Returns one index for each token: a bracket has the index of its partner bracket, and any other token has its own
/// index.
pub(super) fn partners(
    file: &Arc<SourceFile>,
    tokens: &[Token],
) -> Result<Vec<usize>, PackageError> {
    let mut partners: Vec<usize> = (0..tokens.len()).collect();
    let mut open: Vec<usize> = Vec::new();
    for (index, token) in tokens.iter().enumerate() {
        let Kind::Symbol(symbol) = token.kind else { continue };
        match symbol {
            b'(' | b'[' | b'{' => open.push(index),
            b')' | b']' | b'}' => {
                let wanted = match symbol {
                    b')' => b'(',
                    b']' => b'[',
                    _ => b'{',
                };
                match open.pop() {
                    Some(first) if tokens[first].is(wanted) => {
                        (partners[first], partners[index]) = (index, first);
                    }
                    // Usually the author forgot to close the inner bracket.
                    Some(first) => {
                        let message = format!(
                            "this bracket isn't closed before the next `{}`",
                            char::from(symbol)
                        );
                        return Err(syntax_error(file, tokens[first].range(), &message));
                    }
                    None => {
                        let message = format!(
                            "this `{}` closes no bracket: an opening bracket is missing",
                            char::from(symbol)
                        );
                        return Err(syntax_error(file, token.range(), &message));
                    }
                }
            }
            _ => {}
        }
    }
    match open.last() {
        None => Ok(partners),
        Some(index) => Err(syntax_error(file, tokens[*index].range(), "this bracket isn't closed")),
    }
}

pub(super) fn after_attribute(
    text: &str,
    tokens: &[Token],
    brackets: &[usize],
    at: usize,
) -> usize {
    let name = tokens.get(at + 1).map_or("", |token| &text[token.range()]);
    // These attributes take no arguments, so a bracket after such an attribute begins the next item.
    let bare = matches!(
        name,
        "else"
            | "vertex"
            | "fragment"
            | "compute"
            | "must_use"
            | "const"
            | "invariant"
            | "publish"
            | "test"
    );
    match tokens.get(at + 2) {
        Some(token) if token.is(b'(') && !bare => brackets[at + 2] + 1,
        _ => (at + 2).min(tokens.len()),
    }
}

/// The index of the token after a declaration or statement: after its body's `}`, or after its `;`.
pub(super) fn end_of(
    tokens: &[Token],
    brackets: &[usize],
    from: usize,
    body: bool,
) -> Option<usize> {
    let mut at = from;
    while at < tokens.len() {
        match tokens[at].kind {
            Kind::Symbol(b'{') if body => return Some(brackets[at] + 1),
            Kind::Symbol(b';') => return Some(at + 1),
            Kind::Symbol(b'(' | b'[' | b'{') => at = brackets[at] + 1,
            Kind::Symbol(b')' | b']' | b'}') => return None,
            _ => at += 1,
        }
    }
    None
}

/// The index of the token that ends a structure's member or a function's parameter: the comma after the member or
/// parameter, or the bracket that closes the list. A comma between `<` and `>` doesn't end an item.
pub(super) fn end_of_item(tokens: &[Token], brackets: &[usize], from: usize) -> Option<usize> {
    let (mut at, mut depth) = (from, 0_usize);
    while at < tokens.len() {
        match tokens[at].kind {
            Kind::Symbol(b',') if depth == 0 => return Some(at),
            Kind::Symbol(b')' | b']' | b'}') => return Some(at),
            Kind::Symbol(b'(' | b'[' | b'{') => at = brackets[at],
            Kind::Symbol(b'<') => depth += 1,
            Kind::Symbol(b'>') => depth = depth.saturating_sub(1),
            _ => {}
        }
        at += 1;
    }
    None
}

pub(super) fn syntax_error(
    file: &Arc<SourceFile>,
    range: Range<usize>,
    message: &str,
) -> PackageError {
    let span = Span { file: Arc::clone(file), range };
    let diagnostic = Diagnostic::new(format!("syntax error: {message}")).at(span, "");
    PackageError::Shader(Box::new(diagnostic))
}
