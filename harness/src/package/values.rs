//! `[values]` of `karat.toml`: what stands for a placeholder, or for a name that the engine's own code replaces.

use std::collections::BTreeMap;
use std::ops::Range;

use super::lexer::{Kind, Token, lex};

/// Texts by the names that they stand for.
pub(super) type Values = BTreeMap<String, String>;

/// Reads a value: a number, a switch, or a text of one line.
pub(super) fn value(name: &str, value: &toml::Value) -> Result<String, String> {
    let is_name = |name: &str| matches!(&*lex(name), [token] if token.kind == Kind::Word && token.range() == (0..name.len()));
    if !is_name(name) {
        return Err(format!(
            "`{name}` in `[values]` is no name: write that of `{{{{ name }}}}` or `{{name}}`"
        ));
    }
    match value {
        toml::Value::String(text) if text.contains(['\n', '\r']) => Err(format!(
            "the value of `{name}` is of one line, so that lines stay those of the file"
        )),
        toml::Value::String(text) => Ok(text.clone()),
        toml::Value::Integer(number) => Ok(number.to_string()),
        // A float of WGSL has a point or an exponent, and so has TOML's.
        toml::Value::Float(number) => Ok(format!("{number:?}")),
        toml::Value::Boolean(on) => Ok(on.to_string()),
        _ => Err(format!("the value of `{name}` is a text, a number, `true` or `false`")),
    }
}

/// A text with its values: for each `{{ NAME }}`, `{NAME}`, `${NAME}`, `$(NAME)`, `$NAME`, `#{NAME}` and for the
/// bare name. Comments stay, and so do members and attributes that are called like a value.
pub(super) fn substituted(text: &str, values: &Values) -> String {
    let tokens = lex(text);
    let (mut result, mut done) = (String::with_capacity(text.len()), 0);
    for at in places(text, &tokens, values) {
        let (range, value) = at;
        result.push_str(&text[done..range.start]);
        result.push_str(value);
        done = range.end;
    }
    result.push_str(&text[done..]);
    result
}

/// The values that a text has a place for.
pub(super) fn used<'v>(text: &str, values: &'v Values) -> Vec<&'v str> {
    let tokens = lex(text);
    let at = |name: &String| tokens.iter().any(|token| &text[token.range()] == name);
    values.keys().filter(|name| at(name)).map(String::as_str).collect()
}

fn places<'v>(text: &str, tokens: &[Token], values: &'v Values) -> Vec<(Range<usize>, &'v str)> {
    let is = |at: Option<usize>, symbol: &str| {
        at.and_then(|at| tokens.get(at)).is_some_and(|token| &text[token.range()] == symbol)
    };
    let mut found = Vec::new();
    for (at, token) in tokens.iter().enumerate() {
        let Some(value) = values.get(&text[token.range()]) else { continue };
        if token.kind != Kind::Word || is(at.checked_sub(1), ".") || is(at.checked_sub(1), "@") {
            continue;
        }
        let mut around = at..at + 1;
        let before = |around: &Range<usize>| around.start.checked_sub(1);
        // An import lists names in braces: `import a::{NAME}`.
        let is_list = is(at.checked_sub(1), "{") && is(at.checked_sub(2), ":");
        let touch = |a: usize, b: usize| tokens[a].range().end == tokens[b].range().start;
        while !is_list
            && is(before(&around), "{")
            && is(Some(around.end), "}")
            // Braces around a placeholder are a block's, unless they are a part of it: `{{ NAME }}`.
            && (around.len() == 1 || touch(around.start - 1, around.start) && touch(around.end - 1, around.end))
        {
            around = around.start - 1..around.end + 1;
        }
        if is(before(&around), "(")
            && is(around.start.checked_sub(2), "$")
            && is(Some(around.end), ")")
        {
            around = around.start - 1..around.end + 1;
        }
        if is(before(&around), "$") || around.len() > 1 && is(before(&around), "#") {
            around.start -= 1;
        }
        found.push((
            tokens[around.start].range().start..tokens[around.end - 1].range().end,
            &**value,
        ));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::{Values, substituted};

    #[test]
    fn each_form_of_a_placeholder_has_its_value() {
        let values = Values::from([
            ("N".to_owned(), "64".to_owned()),
            ("T".to_owned(), "vec4<f32>".to_owned()),
        ]);
        for (text, expected) in [
            ("@workgroup_size({N}) // {N}", "@workgroup_size(64) // {N}"),
            ("array<{{ T }}, {{N}}>;", "array<vec4<f32>, 64>;"),
            ("const A = N * ${N} + $N - #{N};", "const A = 64 * 64 + 64 - 64;"),
            ("let x = a.N; @N NN _N N_;", "let x = a.N; @N NN _N N_;"),
            ("f($(N)); g((N));", "f(64); g((64));"),
            ("import a::{N}; fn f() { {N} }", "import a::{64}; fn f() { 64 }"),
        ] {
            assert_eq!(substituted(text, &values), expected);
        }
    }
}
