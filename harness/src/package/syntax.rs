//! Finds the declarations of a module by its tokens, without parsing expressions.
//!
//! This code finds the range and the name of each declaration of a well-formed module. If a module
//! isn't well formed, naga reports the syntax errors.

use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::sync::Arc;

use super::PackageError;
use super::brackets::{after_attribute, end_of, syntax_error};
use super::conditions::Inactive;
use super::directives::Include;
use super::lexer::{Kind, Token};
use super::splice::Edit;
use super::stage::Stage;
use crate::diagnostic::{SourceFile, Span};

#[derive(Clone, Debug)]
pub(super) struct Declaration {
    /// `None` for `const_assert`.
    pub(super) name: Option<String>,
    pub(super) kind: DeclarationKind,
    pub(super) tokens: Range<usize>,
    pub(super) name_token: usize,
    pub(super) entry_point: Option<Stage>,
    /// `true` if the function is a test. Karat links a test only when it runs the test.
    pub(super) test: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DeclarationKind {
    Function,
    Struct,
    /// A `var`, `const`, `override` or `alias`.
    Value,
    Assertion,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Reference {
    /// The reference's tokens: words, and two colons between words.
    pub(super) tokens: Range<usize>,
}

impl Reference {
    pub(super) fn words<'a>(&self, module: &'a Module) -> Vec<&'a str> {
        self.tokens.clone().step_by(3).map(|token| module.text(token)).collect()
    }
}

/// One file of a package, without the parts that its conditions remove.
#[derive(Clone, Debug)]
pub(super) struct Module {
    pub(super) file: Arc<SourceFile>,
    /// The tokens that conditions and directives haven't removed.
    pub(super) tokens: Vec<Token>,
    /// The removed ranges, in order: conditions and directives with their false branches, and attributes of
    /// tests.
    pub(super) removed: Vec<Range<usize>>,
    pub(super) replaced: Vec<(Range<usize>, String)>,
    pub(super) calls: Vec<(u32, Span)>,
    pub(super) includes: Vec<(Include, Range<usize>)>,
    /// `true` if imports in this module name other modules by the paths that those modules declare for themselves
    /// (`#define_import_path`).
    pub(super) composes: bool,
    /// The tokens of each import statement, with attributes and `;`.
    pub(super) imports: Vec<Range<usize>>,
    /// The tokens of each directive: `enable`, `requires`, `diagnostic`.
    pub(super) directives: Vec<Range<usize>>,
    pub(super) declarations: Vec<Declaration>,
    /// The indices of declarations, by name.
    pub(super) by_name: HashMap<String, Vec<usize>>,
    /// For each token, the index of its partner bracket, as `partners` returns it.
    pub(super) brackets: Vec<usize>,
    pub(super) words: HashSet<String>,
    pub(super) references: Vec<Vec<Reference>>,
    pub(super) inactive: Vec<Inactive>,
}

impl Module {
    /// The changes that conditions and directives make in a range of bytes.
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

    /// The range from the first to the last of these tokens, in bytes.
    pub(super) fn bytes(&self, tokens: &Range<usize>) -> Range<usize> {
        self.tokens[tokens.start].range().start..self.tokens[tokens.end - 1].range().end
    }

    pub(super) fn span(&self, token: usize) -> Span {
        let end = self.file.text.len();
        let range = self.tokens.get(token).map_or(end..end, Token::range);
        Span { file: Arc::clone(&self.file), range }
    }

    /// The indices of the declarations with this name. If there are several declarations, naga reports an error.
    pub(super) fn declared(&self, name: &str) -> impl Iterator<Item = usize> {
        self.by_name.get(name).into_iter().flatten().copied()
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.declarations.iter().filter_map(|declaration| declaration.name.as_deref())
    }

    /// The edits that turn an entry point into an ordinary function: blanks replace the attributes of the function
    /// and its parameters. Members of structures keep their attributes. Also returns the names of the parameters
    /// with `@builtin`, each with its builtin value.
    pub(super) fn as_function(
        &self,
        declaration: &Declaration,
    ) -> (Vec<Edit>, Vec<(String, String)>) {
        let (mut edits, mut builtins) = (Vec::new(), Vec::new());
        let mut at = declaration.tokens.start;
        while at < declaration.tokens.end && !self.is(at, b'{') {
            if !self.is(at, b'@') {
                at += 1;
                continue;
            }
            let end = after_attribute(&self.file.text, &self.tokens, &self.brackets, at);
            edits.push(Edit { from: self.bytes(&(at..end)), name: None });
            // A parameter's name stands before a colon. The result has no name.
            let ends = |token: &usize| [b',', b')', b'{'].iter().any(|end| self.is(*token, *end));
            let own = (end..declaration.tokens.end).take_while(|token| !ends(token));
            let parameter =
                own.clone().find(|token| self.is_word(*token) && self.is(*token + 1, b':'));
            if let ("builtin", Some(parameter)) = (self.text(at + 1), parameter) {
                builtins.push((self.text(parameter).to_owned(), self.text(at + 3).to_owned()));
            }
            at = end;
        }
        (edits, builtins)
    }

    pub(super) fn find_items(&mut self) -> Result<(), PackageError> {
        let brackets = std::mem::take(&mut self.brackets);
        let mut at = 0;
        while at < self.tokens.len() {
            if self.is(at, b';') {
                at += 1;
                continue;
            }
            let start = at;
            let (mut entry_point, mut test) = (None, false);
            while self.is(at, b'@') && self.is_word(at + 1) {
                test |= self.text(at + 1) == "test";
                entry_point = entry_point.or(Stage::of(self.text(at + 1)));
                at = after_attribute(&self.file.text, &self.tokens, &brackets, at);
            }
            let keyword = self.text(at).to_owned();
            let until = |from: usize, body: bool| {
                end_of(&self.tokens, &brackets, from, body).ok_or_else(|| {
                    let place = self.tokens[start].range();
                    syntax_error(&self.file, place, "the end of this declaration is missing")
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
