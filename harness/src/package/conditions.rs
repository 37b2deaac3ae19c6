//! WESL's conditional translation: `@if(feature)`, `@elif(..)`, `@else`.
//!
//! A condition stands before an import, a directive, a declaration, a group of declarations in braces, a member, a
//! parameter, a statement, a group of statements in braces, or a `case`. If the condition is true, Karat removes only
//! the condition from the text. If the condition is false, Karat also removes the item after the condition.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;

use super::PackageError;
use super::brackets::{after_attribute, end_of, end_of_item, syntax_error};
use super::feature::{Features, is_on};
use super::lexer::{Kind, Token};
use crate::diagnostic::SourceFile;

/// The deepest nesting of brackets in a condition. Authors never nest brackets so deeply, and Karat's recursive reader
/// doesn't overflow the stack at this depth.
const MOST_BRACKETS: usize = 64;

/// A declaration under a condition that is false.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Inactive {
    pub(super) name: String,
    /// The condition in the author's text: `@if(fast)`.
    pub(super) condition: String,
    pub(super) range: Range<usize>,
    /// `true` if the declaration is a function with `@test`.
    pub(super) test: bool,
}

/// Returns `fast` for `@if(fast)` or `#ifdef fast`. Returns `None` if the condition is more than a feature's name, such
/// as `@if(!fast)`.
pub(super) fn feature_of(condition: &str) -> Option<String> {
    let rest = condition.strip_prefix("@if").or_else(|| condition.strip_prefix("#ifdef"))?.trim();
    let name =
        rest.strip_prefix('(').and_then(|rest| rest.strip_suffix(')')).unwrap_or(rest).trim();
    let is_name = |c: char| c == '_' || c.is_alphanumeric();
    (!name.is_empty() && name.chars().all(is_name)).then(|| name.to_owned())
}

pub(super) struct Conditions {
    pub(super) live: Vec<Token>,
    pub(super) removed: Vec<Range<usize>>,
    pub(super) inactive: Vec<Inactive>,
    /// The indices of the open brackets. The list leaves out the braces of a group, as in `@if(fast) { .. }`.
    open: Vec<usize>,
}

impl Conditions {
    pub(super) fn apply(
        file: &Arc<SourceFile>,
        tokens: &[Token],
        brackets: &[usize],
        features: &Features,
    ) -> Result<Self, PackageError> {
        let reader = Reader { file, tokens, brackets, features };
        let mut found =
            Self { live: Vec::new(), removed: Vec::new(), inactive: Vec::new(), open: Vec::new() };
        // The tokens where an `@elif` or `@else` may follow. The value is true if an earlier condition of the
        // chain was true.
        let mut chains: BTreeMap<usize, bool> = BTreeMap::new();
        // The closing braces of groups. Karat removes them with the opening braces.
        let mut closing: Vec<usize> = Vec::new();
        let mut at = 0;
        while at < tokens.len() {
            if closing.last() == Some(&at) {
                closing.pop();
                found.removed.push(tokens[at].range());
                at += 1;
            } else if reader.is_attribute(at) {
                at = reader.attributes(at, &mut chains, &mut closing, &mut found)?;
            } else {
                match tokens[at].kind {
                    Kind::Symbol(b'(' | b'[' | b'{') => found.open.push(at),
                    Kind::Symbol(b')' | b']' | b'}') => drop(found.open.pop()),
                    _ => {}
                }
                found.live.push(tokens[at]);
                at += 1;
            }
        }
        Ok(found)
    }
}

struct Reader<'a> {
    file: &'a Arc<SourceFile>,
    tokens: &'a [Token],
    brackets: &'a [usize],
    features: &'a Features,
}

impl Reader<'_> {
    fn text(&self, token: usize) -> &str {
        self.tokens.get(token).map_or("", |token| &self.file.text[token.range()])
    }

    fn is(&self, token: usize, symbol: u8) -> bool {
        self.tokens.get(token).is_some_and(|token| token.is(symbol))
    }

    fn is_attribute(&self, token: usize) -> bool {
        let named = self.tokens.get(token + 1).is_some_and(|next| next.kind == Kind::Word);
        self.is(token, b'@') && named
    }

    fn bytes(&self, tokens: &Range<usize>) -> Range<usize> {
        self.tokens[tokens.start].range().start..self.tokens[tokens.end - 1].range().end
    }

    fn error(&self, tokens: &Range<usize>, message: &str) -> PackageError {
        syntax_error(self.file, self.bytes(tokens), message)
    }

    /// Reads the attributes at `start`, and keeps or removes the item after these attributes. Returns the next token to
    /// read.
    fn attributes(
        &self,
        start: usize,
        chains: &mut BTreeMap<usize, bool>,
        closing: &mut Vec<usize>,
        found: &mut Conditions,
    ) -> Result<usize, PackageError> {
        let mut run = Vec::new();
        let mut at = start;
        while self.is_attribute(at) {
            let end = after_attribute(&self.file.text, self.tokens, self.brackets, at);
            run.push(at..end);
            at = end;
        }
        let is_condition = |attribute: &&Range<usize>| {
            matches!(self.text(attribute.start + 1), "if" | "elif" | "else")
        };
        let mut conditions = run.iter().filter(is_condition);
        let Some(condition) = conditions.next().cloned() else {
            found.live.extend_from_slice(&self.tokens[start..at]);
            return Ok(at);
        };
        if let Some(second) = conditions.next() {
            return Err(self.error(second, "this is a second condition before the same item: join the two conditions with `&&`"));
        }
        let open = found.open.last().copied();
        if self.is_list(open) && self.is(at, b'{') {
            let message = "only declarations and statements can be in a group in braces: give each member or parameter a \
                           condition of its own";
            return Err(self.error(&condition, message));
        }
        if self.is(at, b'{') && self.text(self.brackets[at] + 1) == "else" {
            let range = self.brackets[at] + 1..self.brackets[at] + 2;
            return Err(self.error(
                &range,
                "an `else` can't follow a group in braces that has a condition: write `@else`",
            ));
        }
        if !self.takes_condition(start, open) || self.is(at, b';') {
            let message = "a condition can only come before an import, a directive, a declaration, a member, \
                           a parameter, a statement or a case: move the condition to the beginning of the statement or \
                           declaration";
            return Err(self.error(&condition, message));
        }
        if at >= self.tokens.len() {
            return Err(
                self.error(&condition, "the declaration that this condition applies to is missing")
            );
        }
        if self.text(at) == "else" {
            let message = "a condition can't be between an `if` and its `else`: put the condition before the \
                           `if`, or inside of the branch";
            return Err(self.error(&condition, message));
        }
        let end = self.end(at).ok_or_else(|| {
            self.error(
                &condition,
                "the end of the declaration or statement after this condition is missing",
            )
        })?;
        // The brackets of a type can't contain attributes.
        let mut tokens = at + 1..end;
        if let Some(next) =
            tokens.find(|token| self.is(*token, b'@')).filter(|_| self.is_list(open))
        {
            return Err(self.error(&(next..next + 2), "a `,` is missing before this attribute"));
        }
        let holds = match (self.text(condition.start + 1), chains.get(&start)) {
            ("if", _) => {
                let holds = self.evaluate(&condition)?;
                chains.insert(end, holds);
                holds
            }
            (word, None) => {
                let message =
                    format!("this `@{word}` doesn't follow a declaration or statement with `@if`");
                return Err(self.error(&condition, &message));
            }
            ("elif", Some(taken)) => {
                let taken = *taken;
                let holds = self.evaluate(&condition)? && !taken;
                chains.insert(end, taken || holds);
                holds
            }
            (_, Some(taken)) => !*taken,
        };
        if !holds {
            let whole = start..end;
            found.removed.push(self.bytes(&whole));
            let text = self.file.text[self.bytes(&condition)].to_owned();
            let mut marked = false;
            for token in start..end {
                marked |= self.is(token, b'@') && self.text(token + 1) == "test";
                let name = match self.text(token) {
                    "fn" | "struct" | "alias" | "const" | "override" => token + 1,
                    // `var<storage, read> name`
                    "var" if self.is(token + 1, b'<') => {
                        let close = (token + 2..end).find(|token| self.is(*token, b'>'));
                        close.map_or(end, |close| close + 1)
                    }
                    "var" => token + 1,
                    _ => continue,
                };
                if self.tokens.get(name).is_some_and(|next| next.kind == Kind::Word) {
                    found.inactive.push(Inactive {
                        name: self.text(name).to_owned(),
                        condition: text.clone(),
                        range: self.bytes(&condition),
                        test: std::mem::take(&mut marked) && self.text(token) == "fn",
                    });
                }
            }
            return Ok(end);
        }
        // Karat removes the group's braces, so no other attribute can stand before the group.
        let is_group = self.is(at, b'{');
        for attribute in &run {
            if *attribute == condition || is_group {
                found.removed.push(self.bytes(attribute));
            } else {
                found.live.extend_from_slice(&self.tokens[attribute.clone()]);
            }
        }
        // Braces only group declarations and statements. They open no scope, so names that are declared between these
        // braces are also visible after them.
        if is_group {
            found.removed.push(self.tokens[at].range());
            closing.push(self.brackets[at]);
            return Ok(at + 1);
        }
        Ok(at)
    }

    /// Checks if a bracket encloses the members of a structure or the parameters of a function.
    fn is_list(&self, open: Option<usize>) -> bool {
        let of = |open: usize, keyword: &str| open > 1 && self.text(open - 2) == keyword;
        open.is_some_and(|open| match self.is(open, b'(') {
            true => of(open, "fn"),
            false => of(open, "struct"),
        })
    }

    /// Checks if an attribute with a condition may begin at the token `at`: the token begins a statement, a
    /// declaration, a member or a parameter. `open` is the innermost bracket around the token.
    fn takes_condition(&self, at: usize, open: Option<usize>) -> bool {
        let after = |symbols: &[u8]| at == 0 || symbols.iter().any(|one| self.is(at - 1, *one));
        match open {
            Some(_) if self.is_list(open) => after(b"({,"),
            Some(open) if self.is(open, b'(') => false,
            _ => after(b"{};"),
        }
    }

    /// The index of the token after the item that begins at `at`.
    fn end(&self, at: usize) -> Option<usize> {
        let body = |from: usize| self.body(from);
        match self.text(at) {
            "{" => Some(self.brackets[at] + 1),
            "if" => {
                let mut end = body(at)?;
                while self.text(end) == "else" {
                    end = body(end)?;
                }
                Some(end)
            }
            "fn" | "struct" | "loop" | "continuing" | "for" | "while" | "switch" | "case" => {
                body(at)
            }
            "default" if !self.is(at + 1, b',') => body(at),
            _ if self.is(at + 1, b':') && !self.is(at + 2, b':') => {
                let end = end_of_item(self.tokens, self.brackets, at)?;
                Some(if self.is(end, b',') { end + 1 } else { end })
            }
            _ => end_of(self.tokens, self.brackets, at, false),
        }
    }

    fn body(&self, from: usize) -> Option<usize> {
        let mut at = from;
        while at < self.tokens.len() {
            match self.tokens[at].kind {
                Kind::Symbol(b'{') => return Some(self.brackets[at] + 1),
                Kind::Symbol(b'(' | b'[') => at = self.brackets[at] + 1,
                Kind::Symbol(b')' | b']' | b'}') => return None,
                _ => at += 1,
            }
        }
        None
    }

    fn evaluate(&self, attribute: &Range<usize>) -> Result<bool, PackageError> {
        let inner = attribute.start + 3..attribute.end.saturating_sub(1);
        if inner.start > inner.end || !self.is(attribute.start + 2, b'(') {
            return Err(
                self.error(attribute, "a condition in brackets is missing: write `@if(feature)`")
            );
        }
        let mut depth = 0_usize;
        for token in inner.clone() {
            depth = match self.tokens[token].kind {
                Kind::Symbol(b'(') => depth + 1,
                Kind::Symbol(b')') => depth.saturating_sub(1),
                _ => depth,
            };
            if depth > MOST_BRACKETS {
                return Err(
                    self.error(&(token..token + 1), "this condition has too many nested brackets")
                );
            }
        }
        let mut at = inner.start;
        let value = self.any(&mut at, inner.end, attribute)?;
        // A trailing comma is allowed, as in any attribute's arguments (WGSL, 12).
        if at + 1 == inner.end && at > inner.start && self.is(at, b',') {
            at += 1;
        }
        if at < inner.end {
            let message = "a condition consists of features, `&&`, `||`, `!` and brackets";
            return Err(self.error(&(at..at + 1), message));
        }
        Ok(value)
    }

    fn any(&self, at: &mut usize, end: usize, whole: &Range<usize>) -> Result<bool, PackageError> {
        let mut value = self.all(at, end, whole)?;
        while *at + 1 < end && self.is(*at, b'|') && self.is(*at + 1, b'|') {
            *at += 2;
            value |= self.all(at, end, whole)?;
        }
        Ok(value)
    }

    fn all(&self, at: &mut usize, end: usize, whole: &Range<usize>) -> Result<bool, PackageError> {
        let mut value = self.one(at, end, whole)?;
        while *at + 1 < end && self.is(*at, b'&') && self.is(*at + 1, b'&') {
            *at += 2;
            value &= self.one(at, end, whole)?;
        }
        Ok(value)
    }

    fn one(&self, at: &mut usize, end: usize, whole: &Range<usize>) -> Result<bool, PackageError> {
        let mut negated = false;
        while *at < end && self.is(*at, b'!') {
            negated = !negated;
            *at += 1;
        }
        let value = if *at >= end {
            return Err(self.error(whole, "this condition isn't complete"));
        } else if self.is(*at, b'(') {
            let close = self.brackets[*at];
            *at += 1;
            let value = self.any(at, close, whole)?;
            if *at != close {
                return Err(self.error(&(*at..*at + 1), "expected `&&`, `||` or `)`"));
            }
            *at += 1;
            value
        } else if self.tokens[*at].kind == Kind::Word {
            let name = self.text(*at);
            *at += 1;
            match name {
                "true" => true,
                "false" => false,
                _ => is_on(self.features, name),
            }
        } else {
            let message = format!("`{}` isn't a feature", self.text(*at));
            return Err(self.error(&(*at..*at + 1), &message));
        };
        Ok(value != negated)
    }
}
