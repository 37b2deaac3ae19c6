//! What is read of a text before its directives are: names, paths and definitions.

use std::collections::BTreeSet;

use super::is_mark;
use crate::package::feature::{Feature, Features};
use crate::package::lexer::{Kind, Token, lex};
use crate::package::library::CONSTANTS;

/// The path that a module gives itself.
pub(in crate::package) fn path(text: &str) -> Option<String> {
    let line = text.lines().find_map(|line| line.trim().strip_prefix("#define_import_path"))?;
    Some(without_comment(line).trim().trim_end_matches(';').trim().to_owned())
}

/// What a text defines, wherever in it: `naga_oil` reads that first, and in the module that is linked
/// alone. Values that can't be read are an error when the module is.
pub(in crate::package) fn defined(text: &str) -> Features {
    if !text.contains("#define") && !text.contains("# ") {
        return Features::new();
    }
    let tokens = lex(text);
    let marks = tokens.iter().filter(|token| is_mark(text, token));
    let lines = marks.filter_map(|mark| {
        let line = text[mark.range().end..].lines().next().unwrap_or_default();
        let rest = without_comment(line).trim_start().strip_prefix("define")?;
        rest.starts_with(char::is_whitespace).then(|| rest.trim())
    });
    let pair = |line: &str| {
        let (name, value) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        Some((name.to_owned(), value_of(value.trim())?))
    };
    lines.filter_map(pair).collect()
}

/// A value as a directive has it; none: on.
pub(super) fn value_of(value: &str) -> Option<Feature> {
    match value {
        "" | "true" => Some(Feature::Flag(true)),
        "false" => Some(Feature::Flag(false)),
        _ => value.strip_suffix(['u', 'i']).unwrap_or(value).parse().ok().map(Feature::Number),
    }
}

/// The features that a text asks about, in conditions of either kind, and as values.
pub(in crate::package) fn asked(text: &str) -> BTreeSet<String> {
    let tokens = lex(text);
    let word = |index: usize| tokens.get(index).map_or("", |t: &Token| &text[t.range()]);
    let mut found = BTreeSet::new();
    for index in 0..tokens.len() {
        let condition = word(index) == "@" && matches!(word(index + 1), "if" | "elif");
        let directive = word(index) == "#"
            && matches!(word(index + 1), "if" | "ifdef" | "ifndef" | "else" | "{");
        if word(index) == CONSTANTS && word(index + 1) == ":" {
            // `constants::NAME`, `import constants::{A, B};`
            let names = tokens[index + 3..].iter().map(|t: &Token| (t.kind, &text[t.range()]));
            let braces = word(index + 3) == "{";
            let names = names
                .skip(usize::from(braces))
                .take_while(|(kind, text)| if braces { *text != "}" } else { *kind == Kind::Word });
            let names =
                names.filter(|(kind, _)| *kind == Kind::Word).map(|(_, name)| name.to_owned());
            found.extend(names.take(if braces { usize::MAX } else { 1 }));
        }
        let end = match (condition, directive) {
            (true, _) => text[tokens[index].range().start..].find(')'),
            (_, true) => text[tokens[index].range().start..].find(['\n', '}']),
            _ => None,
        };
        let Some(end) = end.map(|end| tokens[index].range().start + end) else { continue };
        let inside = tokens[index + 2 - usize::from(word(index + 1) == "{")..].iter();
        let inside = inside.take_while(|token| token.range().start < end);
        let names = inside.filter(|t| t.kind == Kind::Word).map(|t| &text[t.range()]);
        let names = names.filter(|n| !matches!(*n, "if" | "ifdef" | "ifndef" | "true" | "false"));
        found.extend(names.map(str::to_owned));
    }
    found
}

pub(super) fn without_comment(line: &str) -> &str {
    line.split("//").next().unwrap_or_default()
}
