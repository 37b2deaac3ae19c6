//! Finds the declarations of a module by its tokens, without parsing expressions.
//!
//! naga reports a module that isn't well formed. Here it is enough to find each declaration of a valid module, and the
//! place of its name.

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

/// A declaration of a module.
#[derive(Clone, Debug)]
pub(super) struct Declaration {
    /// `None` for `const_assert`.
    pub(super) name: Option<String>,
    pub(super) kind: DeclarationKind,
    /// Its tokens, with attributes and the closing `;` or `}`.
    pub(super) tokens: Range<usize>,
    /// The token of its name.
    pub(super) name_token: usize,
    pub(super) entry_point: Option<Stage>,
    /// Set for a test, which only test runners link.
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

/// A name that isn't declared where it is used, such as `PI`, or a path, such as `package::math::PI`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Reference {
    /// Its tokens: words, and two colons between them.
    pub(super) tokens: Range<usize>,
}

impl Reference {
    /// The words of the path.
    pub(super) fn words<'a>(&self, module: &'a Module) -> Vec<&'a str> {
        self.tokens.clone().step_by(3).map(|token| module.text(token)).collect()
    }
}

/// One file of a package, without the parts that its conditions leave out.
#[derive(Clone, Debug)]
pub(super) struct Module {
    pub(super) file: Arc<SourceFile>,
    /// The tokens that remain after conditions.
    pub(super) tokens: Vec<Token>,
    /// The ranges removed from the text, in order: by conditions and directives, and attributes of tests.
    pub(super) removed: Vec<Range<usize>>,
    /// The replaced ranges with their new text, in order: values, and the numbers that expectations get.
    pub(super) replaced: Vec<(Range<usize>, String)>,
    /// Calls of expectations, by their numbers.
    pub(super) calls: Vec<(u32, Span)>,
    /// Files that share a name space with this one, and the places that name them.
    pub(super) includes: Vec<(Include, Range<usize>)>,
    /// Set if paths are those that modules give themselves.
    pub(super) composes: bool,
    /// Tokens of each import statement, with attributes and `;`.
    pub(super) imports: Vec<Range<usize>>,
    /// Tokens of each directive: `enable`, `requires`, `diagnostic`.
    pub(super) directives: Vec<Range<usize>>,
    pub(super) declarations: Vec<Declaration>,
    /// Declarations by their names.
    pub(super) by_name: HashMap<String, Vec<usize>>,
    /// For each bracket among the tokens, its partner.
    pub(super) brackets: Vec<usize>,
    /// All words of the tokens.
    pub(super) words: HashSet<String>,
    /// The references of each declaration.
    pub(super) references: Vec<Vec<Reference>>,
    /// Declarations under a condition that doesn't hold.
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

    /// The bytes from the first to the last of these tokens.
    pub(super) fn bytes(&self, tokens: &Range<usize>) -> Range<usize> {
        self.tokens[tokens.start].range().start..self.tokens[tokens.end - 1].range().end
    }

    pub(super) fn span(&self, token: usize) -> Span {
        let end = self.file.text.len();
        let range = self.tokens.get(token).map_or(end..end, Token::range);
        Span { file: Arc::clone(&self.file), range }
    }

    /// Declarations of a name. naga reports several of them as an error.
    pub(super) fn declared(&self, name: &str) -> impl Iterator<Item = usize> {
        self.by_name.get(name).into_iter().flatten().copied()
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &str> {
        self.declarations.iter().filter_map(|declaration| declaration.name.as_deref())
    }

    /// The edits that make an entry point a function that others may call: its attributes are blanked. Also returns the
    /// builtin value of each parameter. Members of structures keep their attributes.
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
            // A parameter's name stands before its colon; the result has no name.
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

    /// Finds imports, directives and declarations among the tokens.
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
