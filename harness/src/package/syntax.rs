//! What a module declares, found by its tokens: no expression is parsed.
//!
//! A module that isn't well formed is naga's to refuse. Here it is enough that each declaration
//! of a valid module is found, with the place of its name.

use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::sync::Arc;

use super::PackageError;
use super::conditions::{Conditions, Inactive};
use super::directives::{self, Directed, Include};
use super::expectations;
use super::feature::Features;
use super::lexer::{Kind, Token, lex};
use super::scope::{Reference, references};
use super::splice::Edit;
use crate::diagnostic::{Diagnostic, SourceFile, Span};

/// A declaration of a module.
#[derive(Clone, Debug)]
pub(super) struct Declaration {
    /// `None` of `const_assert`.
    pub(super) name: Option<String>,
    pub(super) kind: DeclarationKind,
    /// Its tokens, with attributes and the closing `;` or `}`.
    pub(super) tokens: Range<usize>,
    /// The token of its name.
    pub(super) name_token: usize,
    pub(super) entry_point: bool,
    /// Whether it is a test, which only test runners link.
    pub(super) test: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DeclarationKind {
    Function,
    Struct,
    /// `var`, `const`, `override`, `alias`.
    Value,
    Assertion,
}

/// One file of a package, without what its conditions leave out.
#[derive(Clone, Debug)]
pub(super) struct Module {
    pub(super) file: Arc<SourceFile>,
    /// The tokens that conditions leave.
    pub(super) tokens: Vec<Token>,
    /// What is removed from the text: by conditions and directives, and attributes of tests. In order.
    pub(super) removed: Vec<Range<usize>>,
    /// What values stand for, and what expectations are told, in order.
    pub(super) replaced: Vec<(Range<usize>, String)>,
    /// Files that share a name space with this one, and where they are named.
    pub(super) includes: Vec<(Include, Range<usize>)>,
    /// Whether paths are those that modules give themselves.
    pub(super) composes: bool,
    /// Tokens of each import statement, with attributes and `;`.
    pub(super) imports: Vec<Range<usize>>,
    /// Tokens of each directive: `enable`, `requires`, `diagnostic`.
    pub(super) directives: Vec<Range<usize>>,
    pub(super) declarations: Vec<Declaration>,
    by_name: HashMap<String, Vec<usize>>,
    /// For each bracket among the tokens, its partner.
    pub(super) brackets: Vec<usize>,
    /// All words of the tokens.
    pub(super) words: HashSet<String>,
    /// What each declaration refers to.
    pub(super) references: Vec<Vec<Reference>>,
    /// Declarations under a condition that doesn't hold.
    pub(super) inactive: Vec<Inactive>,
}

impl Module {
    /// Reads a file under conditions.
    pub(super) fn parse(file: &Arc<SourceFile>, features: &Features) -> Result<Self, PackageError> {
        let directed = directives::read(file, features)?;
        let mut tokens = lex(directed.as_ref().map_or(&file.text, |directed| &directed.text));
        for end in directed.iter().flat_map(|directed| &directed.ends) {
            let at = tokens.partition_point(|token| token.range().start < *end);
            tokens.insert(at, Token::end(*end));
        }
        if let Some(token) = tokens.iter().find(|token| token.kind == Kind::Unknown) {
            let what = &file.text[token.range()];
            let message = if what.starts_with("/*") {
                "a block comment isn't closed".to_owned()
            } else {
                format!("WGSL has no token `{}`", what.escape_debug())
            };
            return Err(syntax_error(file, token.range().start..token.range().start + 1, &message));
        }
        let brackets = partners(file, &tokens)?;
        let Conditions { live, mut removed, mut inactive, .. } =
            Conditions::apply(file, &tokens, &brackets, features)?;
        let directed = directed.unwrap_or_default();
        let Directed { replaced, includes, composes, .. } = directed;
        removed.extend(directed.removed);
        removed.sort_by_key(|range| range.start);
        inactive.extend(directed.inactive);
        let mut module = Self {
            replaced,
            includes,
            composes,
            file: Arc::clone(file),
            tokens: live,
            removed,
            imports: Vec::new(),
            directives: Vec::new(),
            declarations: Vec::new(),
            by_name: HashMap::new(),
            brackets: Vec::new(),
            words: HashSet::new(),
            references: Vec::new(),
            inactive,
        };
        module.brackets = partners(file, &module.tokens)?;
        module.find_items()?;
        expectations::prepare(&mut module);
        for (index, declaration) in module.declarations.iter().enumerate() {
            if let Some(name) = &declaration.name {
                module.by_name.entry(name.clone()).or_default().push(index);
            }
        }
        let words = (0..module.tokens.len()).filter(|token| module.is_word(*token));
        module.words = words.map(|token| module.text(token).to_owned()).collect();
        let declarations = module.declarations.iter();
        module.references = declarations.map(|d| references(&module, d)).collect();
        Ok(module)
    }

    /// What conditions and directives change among some bytes.
    pub(super) fn changes(&self, from: &Range<usize>) -> impl Iterator<Item = Edit> {
        let from = from.clone();
        let inside = move |range: &Range<usize>| from.start <= range.start && range.end <= from.end;
        let replaced = self.replaced.iter().map(|(range, text)| (range, Some(text.clone())));
        let all = self.removed.iter().map(|range| (range, None)).chain(replaced);
        all.filter(move |(range, _)| inside(range))
            .map(|(range, name)| Edit { from: range.clone(), name })
    }

    pub(super) fn text(&self, token: usize) -> &str {
        self.tokens.get(token).map_or("", |token| &self.file.text[token.range()])
    }

    pub(super) fn is(&self, token: usize, symbol: u8) -> bool {
        self.tokens.get(token).is_some_and(|token| token.is(symbol))
    }

    pub(super) fn is_word(&self, token: usize) -> bool {
        self.tokens.get(token).is_some_and(|token| token.kind == Kind::Word)
    }

    /// Bytes from the first to the last of some tokens.
    pub(super) fn bytes(&self, tokens: &Range<usize>) -> Range<usize> {
        self.tokens[tokens.start].range().start..self.tokens[tokens.end - 1].range().end
    }

    pub(super) fn span(&self, token: usize) -> Span {
        let end = self.file.text.len();
        let range = self.tokens.get(token).map_or(end..end, Token::range);
        Span { file: Arc::clone(&self.file), range }
    }

    /// Declarations of a name; several are an error that naga reports.
    pub(super) fn declared(&self, name: &str) -> impl Iterator<Item = usize> {
        self.by_name.get(name).into_iter().flatten().copied()
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.declarations.iter().filter_map(|declaration| declaration.name.as_deref())
    }

    fn find_items(&mut self) -> Result<(), PackageError> {
        let brackets = std::mem::take(&mut self.brackets);
        let mut at = 0;
        while at < self.tokens.len() {
            if self.is(at, b';') {
                at += 1;
                continue;
            }
            let start = at;
            let (mut entry_point, mut test) = (false, false);
            while self.is(at, b'@') && self.is_word(at + 1) {
                test |= self.text(at + 1) == "test";
                entry_point |= matches!(
                    self.text(at + 1),
                    "vertex"
                        | "fragment"
                        | "compute"
                        | "task"
                        | "mesh"
                        | "ray_generation"
                        | "miss"
                        | "any_hit"
                        | "closest_hit"
                );
                at = after_attribute(&self.file.text, &self.tokens, &brackets, at);
            }
            let keyword = self.text(at).to_owned();
            let until = |from: usize, body: bool| {
                end_of(&self.tokens, &brackets, from, body).ok_or_else(|| {
                    let place = self.tokens[start].range();
                    syntax_error(&self.file, place, "this declaration doesn't end")
                })
            };
            let end = match keyword.as_str() {
                "fn" | "struct" => until(at, true)?,
                "import" | "enable" | "requires" | "diagnostic" | "var" | "const" | "override"
                | "alias" | "const_assert" => until(at, false)?,
                _ => {
                    let what = if at < self.tokens.len() { self.text(at) } else { "the end" };
                    let message = format!("expected a declaration, found `{what}`");
                    let place = self.span(at).range;
                    return Err(syntax_error(&self.file, place, &message));
                }
            };
            let tokens = start..end;
            match keyword.as_str() {
                "import" => self.imports.push(tokens),
                "enable" | "requires" | "diagnostic" => self.directives.push(tokens),
                _ => {
                    let mut name_token = at + 1;
                    if keyword == "var" && self.is(at + 1, b'<') {
                        while name_token < end && !self.is(name_token, b'>') {
                            name_token += 1;
                        }
                        name_token += 1;
                    }
                    let kind = match keyword.as_str() {
                        "fn" => DeclarationKind::Function,
                        "struct" => DeclarationKind::Struct,
                        "const_assert" => DeclarationKind::Assertion,
                        _ => DeclarationKind::Value,
                    };
                    let named = kind != DeclarationKind::Assertion && self.is_word(name_token);
                    let name = named.then(|| self.text(name_token).to_owned());
                    self.declarations.push(Declaration {
                        name,
                        kind,
                        tokens,
                        name_token,
                        entry_point,
                        test: test && kind == DeclarationKind::Function,
                    });
                }
            }
            at = end;
        }
        self.brackets = brackets;
        Ok(())
    }
}

/// Whether nothing in a text, well formed or not, asks the linker to change it.
pub(super) fn asks_for_nothing(text: &str) -> bool {
    let tokens = lex(text);
    if directives::concern(text, &tokens) {
        return false;
    }
    let word = |index: usize| tokens.get(index).map_or("", |token| &text[token.range()]);
    !(0..tokens.len()).any(|index| {
        (tokens[index].is(b':') && word(index + 1) == ":")
            || (tokens[index].is(b'@')
                && matches!(word(index + 1), "if" | "elif" | "else" | "publish" | "test"))
            || word(index) == "import"
    })
}

/// For each bracket, the index of its partner; for other tokens, their own.
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
                    // Nearly always the inner one was forgotten.
                    Some(first) => {
                        let message =
                            format!("this isn't closed: a `{}` comes first", char::from(symbol));
                        return Err(syntax_error(file, tokens[first].range(), &message));
                    }
                    None => {
                        let message = format!("this `{}` closes nothing", char::from(symbol));
                        return Err(syntax_error(file, token.range(), &message));
                    }
                }
            }
            _ => {}
        }
    }
    match open.last() {
        None => Ok(partners),
        Some(index) => Err(syntax_error(file, tokens[*index].range(), "this isn't closed")),
    }
}

/// The token after an attribute that begins at `at`.
pub(super) fn after_attribute(
    text: &str,
    tokens: &[Token],
    brackets: &[usize],
    at: usize,
) -> usize {
    let name = tokens.get(at + 1).map_or("", |token| &text[token.range()]);
    // These take no arguments: a bracket after them belongs to what follows.
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

/// The token after a declaration or statement: after its body's `}`, or after its `;`.
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

/// The token that ends a member or a parameter: its comma, or what closes the list. A comma between
/// `<` and `>` separates a type's arguments.
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

/// A syntax error at its place.
pub(super) fn syntax_error(
    file: &Arc<SourceFile>,
    range: Range<usize>,
    message: &str,
) -> PackageError {
    let span = Span { file: Arc::clone(file), range };
    let diagnostic = Diagnostic::new(format!("syntax error: {message}")).at(span, "");
    PackageError::Shader(Box::new(diagnostic))
}
