//! Recognises templates and directives of other tools.

use std::ops::Range;
use std::sync::Arc;

use crate::diagnostic::{Diagnostic, Mend, SourceFile, Span};
use crate::package::PackageError;
use crate::package::lexer::{Kind, Token};

/// The first range with syntax that only templates have, such as `{% if %}` or `{{ name }}`.
pub(super) fn template(text: &str, tokens: &[Token]) -> Option<Range<usize>> {
    let touching = |pair: &[Token], first: u8, second: u8| {
        pair[0].is(first) && pair[1].is(second) && pair[0].range().end == pair[1].range().start
    };
    let block = tokens.windows(2).find(|pair| touching(pair, b'{', b'%'));
    let placeholder = tokens.windows(2).find(|pair| {
        let line = text[pair[0].range().start..].lines().next().unwrap_or_default();
        // WGSL also has nested blocks, but they contain statements.
        let inner = line.strip_prefix("{{").and_then(|line| line.split_once("}}"));
        let is_placeholder =
            |(inside, _): (&str, &str)| !inside.trim().is_empty() && !inside.contains([';', '{']);
        touching(pair, b'{', b'{') && inner.is_some_and(is_placeholder)
    });
    let pair = block.or(placeholder).map(|pair| pair[0].range().start..pair[1].range().end);
    pair.or_else(|| one_brace(text, tokens))
}

/// Checks quickly if a text may have a placeholder, such as `{name}`. A placeholder in a comment counts, too.
pub(super) fn may_be_template(text: &str) -> bool {
    let is_part = |c: char| c == '_' || c.is_alphanumeric();
    text.split('{').skip(1).any(|after| {
        let rest = after.trim_start_matches(is_part);
        after.is_empty()
            || after.starts_with('%')
            || rest.len() < after.len() && rest.starts_with('}')
    })
}

/// Finds `{name}`. `{name}` can't be a block of WGSL, because the statement in a block ends with `;`. Skips `{name}`
/// after `::`, which is a list of imported names, and `#{name}`, which is a value of `naga_oil`.
fn one_brace(text: &str, tokens: &[Token]) -> Option<Range<usize>> {
    let found = tokens.windows(3).enumerate().find(|(at, three)| {
        let before =
            |by: usize| at.checked_sub(by).map_or("", |before| &text[tokens[before].range()]);
        let is_list = before(1) == ":" && before(2) == ":";
        let touch = three[0].range().end == three[1].range().start
            && three[1].range().end == three[2].range().start;
        let is_one = three[0].is(b'{') && three[1].kind == Kind::Word && three[2].is(b'}');
        is_one && touch && !is_list && before(1) != "#"
    });
    found.map(|(_, three)| three[0].range().start..three[2].range().end)
}

/// An error about text that another tool expands, with a remedy.
pub(super) fn unknown(
    file: &Arc<SourceFile>,
    range: Range<usize>,
    what: &str,
    whose: &str,
) -> PackageError {
    let name = placeholder(&file.text[range.start..]).map(str::to_owned);
    let values = match &name {
        Some(name) => format!("`[values]` with a line `{name} = 64`, or "),
        None => String::new(),
    };
    let before = file.text[..range.start].rsplit('\n').next().unwrap_or_default();
    let rest = file.text[range.start..].lines().next().unwrap_or_default();
    let is_alone = before.trim().is_empty() && rest.trim_end().ends_with('}');
    let span = Span { file: Arc::clone(file), range };
    let diagnostic = Diagnostic::new(format!("{what} isn't WGSL: {whose} must expand it"))
        .at(span, "")
        .note(format!(
            "to expand the text, write {values}a `preprocess` command into karat.toml beside the modules, \
             or use `Package::from_modules` in Rust"
        ))
        .mended_by(Some(match name {
            None => Mend::Preprocess,
            Some(name) if is_alone => Mend::Text(name),
            Some(name) => Mend::Value(name),
        }));
    PackageError::Shader(Box::new(diagnostic))
}

fn placeholder(text: &str) -> Option<&str> {
    let (name, _) = text.strip_prefix('{')?.split_once('}')?;
    let name = name.trim_start_matches('{').trim();
    let is_name = name.chars().all(|c| c == '_' || c.is_alphanumeric());
    (is_name && !name.is_empty()).then_some(name)
}
