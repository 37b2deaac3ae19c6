//! What is written for others to expand.

use std::ops::Range;
use std::sync::Arc;

use crate::diagnostic::{Diagnostic, SourceFile, Span};
use crate::package::PackageError;
use crate::package::lexer::Token;

/// A place that only a template has: `{% if %}`, `{{ name }}`.
pub(super) fn template(text: &str, tokens: &[Token]) -> Option<Range<usize>> {
    let touching = |pair: &[Token], first: u8, second: u8| {
        pair[0].is(first) && pair[1].is(second) && pair[0].range().end == pair[1].range().start
    };
    let block = tokens.windows(2).find(|pair| touching(pair, b'{', b'%'));
    let placeholder = tokens.windows(2).find(|pair| {
        let line = text[pair[0].range().start..].lines().next().unwrap_or_default();
        // WGSL has blocks in blocks, but statements in them.
        let inner = line.strip_prefix("{{").and_then(|line| line.split_once("}}"));
        let is_placeholder =
            |(inside, _): (&str, &str)| !inside.trim().is_empty() && !inside.contains([';', '{']);
        touching(pair, b'{', b'{') && inner.is_some_and(is_placeholder)
    });
    block.or(placeholder).map(|pair| pair[0].range().start..pair[1].range().end)
}

/// What Karat doesn't expand, with what to do.
pub(super) fn unknown(
    file: &Arc<SourceFile>,
    range: Range<usize>,
    what: &str,
    whose: &str,
) -> PackageError {
    let span = Span { file: Arc::clone(file), range };
    let diagnostic = Diagnostic::new(format!("{what} isn't WGSL: {whose} expands it"))
        .at(span, "")
        .note(
            "hand Karat the expanded text: a `preprocess` command in karat.toml beside the modules, \
             or `Package::from_modules` in Rust",
        );
    PackageError::Shader(Box::new(diagnostic))
}
