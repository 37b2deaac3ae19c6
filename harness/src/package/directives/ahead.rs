//! Reads names, paths and definitions of a text before Karat processes its directives.

use std::collections::{BTreeMap, BTreeSet};

use super::is_mark;
use crate::package::CONSTANTS;
use crate::package::feature::{Feature, Features};
use crate::package::lexer::{Kind, Token, lex};

/// The directives of a text in order. Returns each directive's word and the rest of its line.
fn lines(text: &str) -> impl Iterator<Item = (&str, &str)> {
    let tokens = if text.contains('#') { lex(text) } else { Vec::new() };
    let marks = tokens.into_iter().filter(|token| is_mark(text, token));
    marks.filter_map(|mark| {
        let line = text[mark.range().end..].lines().next()?;
        let line = without_comment(line).trim();
        let end = line.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
        let (word, rest) = line.split_at(end.unwrap_or(line.len()));
        Some((word, rest.trim()))
    })
}

pub(in crate::package) fn path(text: &str) -> Option<String> {
    let (_, path) = lines(text).find(|(word, _)| *word == "define_import_path")?;
    Some(path.trim_end_matches(';').trim_end().to_owned())
}

/// The names that a text defines anywhere. `naga_oil` reads these definitions first, and only in the linked module,
/// not in imported modules. The list leaves out [guards](guards), and definitions with an unreadable value, which
/// Karat reports when it reads the module.
pub(in crate::package) fn defined(text: &str) -> Features {
    defines(text).filter(|(_, _, is_guard)| !is_guard).filter_map(valued).collect()
}

/// Names that a text defines only if nothing else defines them, as in an include guard: a `#define` of a name under
/// `#ifndef` of the same name. Karat evaluates the `#ifndef` before it defines the name.
pub(in crate::package) fn guards(text: &str) -> Features {
    defines(text).filter(|(_, _, is_guard)| *is_guard).filter_map(valued).collect()
}

fn valued((name, value, _): (&str, &str, bool)) -> Option<(String, Feature)> {
    Some((name.to_owned(), value_of(value)?))
}

/// Each `#define` of a text: its name, its value, and a flag that is true for a guard.
fn defines(text: &str) -> impl Iterator<Item = (&str, &str, bool)> {
    // For each open condition, the name of its `#ifndef`, or `None` for other conditions.
    let mut open: Vec<Option<&str>> = Vec::new();
    lines(text).filter_map(move |(word, rest)| {
        match word {
            "ifndef" => open.push(Some(rest)),
            "ifdef" | "if" => open.push(None),
            "else" => {
                open.pop();
                open.push(rest.strip_prefix("ifndef").map(str::trim));
            }
            "endif" => drop(open.pop()),
            "define" => {
                let (name, value) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
                return Some((name, value.trim(), open.contains(&Some(name))));
            }
            _ => {}
        }
        None
    })
}

/// Checks if `naga_oil` replaces `#NAME` like `#{NAME}`: the name must be in capitals.
pub(super) fn is_named(word: &str) -> bool {
    let is_capital = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
    word.len() > 1 && word.chars().all(is_capital)
}

/// The value in a `#define` or `#if`. A feature without a value is on.
pub(super) fn value_of(value: &str) -> Option<Feature> {
    match value {
        "" | "true" => Some(Feature::Flag(true)),
        "false" => Some(Feature::Flag(false)),
        _ => value.strip_suffix(['u', 'i']).unwrap_or(value).parse().ok().map(Feature::Number),
    }
}

/// Some values to try for each feature that a text compares with a value, or uses as a number. For the condition
/// `A >= 3`, these are 3 and its neighbours 4 and 2, because neighbours may select other branches. For a feature that
/// code uses as a number, such as `#{A}`, the list has two usual values, 4 and 3.
pub(in crate::package) fn values(text: &str) -> BTreeMap<String, Vec<Feature>> {
    // Three isn't a power of two, so shifting by 3 and dividing by 3 give different results.
    const USUAL: [Feature; 2] = [Feature::Number(4), Feature::Number(3)];
    let is_composed = text.contains("#import ") || text.contains("#define_import_path ");
    let mut all = BTreeMap::<String, Vec<Feature>>::new();
    for (word, rest) in lines(text) {
        let condition = if word == "else" { rest.strip_prefix("if ") } else { Some(rest) };
        let (name, compared) = match (word, condition) {
            ("", _) => match rest.strip_prefix('{').and_then(|rest| rest.split_once('}')) {
                Some((name, _)) => (name, USUAL.to_vec()),
                None => continue,
            },
            ("if" | "else", Some(condition)) => {
                let end = condition.find(['=', '!', '<', '>']).unwrap_or(condition.len());
                let (name, value) = condition.split_at(end);
                match value_of(value.trim_start_matches(['=', '!', '<', '>']).trim()) {
                    Some(Feature::Number(x)) => {
                        let near = [x, x.saturating_add(1), x.saturating_sub(1)];
                        (name, near.map(Feature::Number).to_vec())
                    }
                    Some(Feature::Flag(on)) if !value.is_empty() => {
                        (name, [on, !on].map(Feature::Flag).to_vec())
                    }
                    _ => continue,
                }
            }
            (name, _) if is_composed && is_named(name) => (name, USUAL.to_vec()),
            _ => continue,
        };
        let known = all.entry(name.trim().to_owned()).or_default();
        known.extend(compared.into_iter().filter(|one| !known.contains(one)).collect::<Vec<_>>());
    }
    all
}

pub(in crate::package) fn asked(text: &str) -> BTreeSet<String> {
    let tokens = lex(text);
    let word = |index: usize| tokens.get(index).map_or("", |t: &Token| &text[t.range()]);
    let mut found = BTreeSet::new();
    for index in 0..tokens.len() {
        let (first, second, third) = (word(index), word(index + 1), word(index + 2));
        // The index of the token before the list of names, and the tokens that end this list.
        let (before, ends): (usize, &[&str]) = match (first, second, third) {
            ("@", "if" | "elif", "(") => (index + 2, &[")"]),
            ("#", "{", _) => (index + 1, &["}"]),
            ("#", "if" | "ifdef" | "ifndef" | "else", _) => (index + 1, &[]),
            // The form `#NAME`.
            ("#", name, _) if is_named(name) => {
                found.insert(name.to_owned());
                continue;
            }
            // The forms `constants::NAME` and `import constants::{A, B};`.
            (CONSTANTS, ":", ":") if word(index + 3) == "{" => (index + 3, &["}"]),
            (CONSTANTS, ":", ":") => {
                found.insert(word(index + 3).to_owned());
                continue;
            }
            _ => continue,
        };
        let start = tokens[before].range().end;
        let line = text[start..].find(['\n', '\r']).map_or(text.len(), |end| start + end);
        let mut depth = 0_usize;
        for token in &tokens[before + 1..] {
            let name = &text[token.range()];
            let ended = match ends {
                [] => token.range().start >= line,
                _ => depth == 0 && ends.contains(&name),
            };
            if ended {
                break;
            }
            match name {
                "(" => depth += 1,
                ")" => depth -= 1,
                "if" | "ifdef" | "ifndef" | "true" | "false" | "as" => {}
                _ if token.kind == Kind::Word => drop(found.insert(name.to_owned())),
                _ => {}
            }
        }
    }
    found
}

pub(super) fn without_comment(line: &str) -> &str {
    line.split("//").next().unwrap_or_default()
}
