//! Parses a module: directives, conditions, declarations, expectations, and the references of each declaration.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use super::brackets::{partners, syntax_error};
use super::conditions::Conditions;
use super::directives::{self, Directed};
use super::feature::Features;
use super::lexer::{Kind, Token, lex};
use super::scope::references;
use super::syntax::Module;
use super::{PackageError, test_items};
use crate::diagnostic::SourceFile;

pub(super) fn parse(file: &Arc<SourceFile>, features: &Features) -> Result<Module, PackageError> {
    let directed = directives::read(file, features)?;
    let mut tokens = lex(directed.as_ref().map_or(&file.text, |directed| &directed.text));
    for end in directed.iter().flat_map(|directed| &directed.ends) {
        let at = tokens.partition_point(|token| token.range().start < *end);
        tokens.insert(at, Token::end(*end));
    }
    if let Some(token) = tokens.iter().find(|token| token.kind == Kind::Unknown) {
        let what = &file.text[token.range()];
        let message = if what.starts_with("/*") {
            "this block comment isn't closed".to_owned()
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
    let mut module = Module {
        replaced,
        calls: Vec::new(),
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
    test_items::prepare(&mut module);
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

/// Checks if the linker has nothing to change in the text. Karat copies such a text even if it isn't well formed.
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
