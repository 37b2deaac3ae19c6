//! `[values]` of `karat.toml`: texts that replace placeholders or names, as the author's program replaces them.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

use super::lexer::{Kind, Token, lex};
use crate::diagnostic::Value;

/// For each placeholder or name, the text that replaces it.
pub(super) type Values = BTreeMap<String, String>;

/// Reads a value: a number, `true` or `false`, or a line of text.
pub(super) fn value(name: &str, value: &toml::Value) -> Result<String, String> {
    let is_name = |name: &str| matches!(&*lex(name), [token] if token.kind == Kind::Word && token.range() == (0..name.len()));
    if !is_name(name) {
        return Err(format!(
            "the key `{name}` of `[values]` isn't a name: write only the name that is in the placeholder `{{{{ name }}}}` or `{{name}}`"
        ));
    }
    match value {
        toml::Value::String(text) if text.contains(['\n', '\r']) => Err(format!(
            "the value of `{name}` must be one line, so that line numbers stay the same"
        )),
        toml::Value::String(text) if text.contains("//") || text.contains("/*") => Err(format!(
            "the value of `{name}` contains a comment, which would hide the text after the value"
        )),
        toml::Value::String(text) => Ok(text.clone()),
        // The brackets keep `a -N` from becoming `a --1`.
        toml::Value::Integer(number) if *number < 0 => Ok(format!("({number})")),
        toml::Value::Integer(number) => Ok(number.to_string()),
        toml::Value::Float(number) if !number.is_finite() => {
            Err(format!("the value of `{name}` isn't finite, and WGSL has no literal for it"))
        }
        // A float has a point or an exponent, in WGSL as in TOML.
        toml::Value::Float(number) if *number < 0.0 => Ok(format!("({number:?})")),
        toml::Value::Float(number) => Ok(format!("{number:?}")),
        toml::Value::Boolean(on) => Ok(on.to_string()),
        _ => Err(format!("the value of `{name}` must be a string, a number, `true` or `false`")),
    }
}

/// Replaces each `{{ NAME }}`, `{NAME}`, `${NAME}`, `$(NAME)`, `$NAME`, `#{NAME}` and bare name by its value.
/// Comments, directives, conditions, imports, attributes, members and declarations stay unchanged.
pub(super) fn substituted(text: &str, values: &Values) -> (String, Vec<Value>) {
    let (mut result, mut done, mut all) = (String::with_capacity(text.len()), 0, Vec::new());
    for (range, name) in places(text, &lex(text), values) {
        result.push_str(&text[done..range.start]);
        let start = result.len();
        result.push_str(&values[name]);
        let placeholder = text[range.clone()].to_owned();
        all.push(Value { at: start..result.len(), placeholder, hidden: false });
        done = range.end;
    }
    result.push_str(&text[done..]);
    (result, all)
}

pub(super) fn used<'v>(text: &str, values: &'v Values) -> BTreeSet<&'v str> {
    places(text, &lex(text), values).into_iter().map(|(_, name)| name).collect()
}

/// The ranges to replace in a text, each with its name in `[values]`.
fn places<'v>(text: &str, tokens: &[Token], values: &'v Values) -> Vec<(Range<usize>, &'v str)> {
    let of = |at: usize| &text[tokens[at].range()];
    let is = |at: Option<usize>, symbol: &str| {
        at.and_then(|at| tokens.get(at)).is_some_and(|token| &text[token.range()] == symbol)
    };
    let mut found = Vec::new();
    let declared = declared(text, tokens);
    for (at, token) in tokens.iter().enumerate() {
        let Some((name, _)) = values.get_key_value(of(at)) else { continue };
        let mut around = at..at + 1;
        let before = |around: &Range<usize>| around.start.checked_sub(1);
        // An import lists names in braces: `import a::{NAME}`.
        let is_list =
            is(at.checked_sub(1), "{") && is(at.checked_sub(2), ":") && is(at.checked_sub(3), ":");
        let touch = |a: usize, b: usize| tokens[a].range().end == tokens[b].range().start;
        while !is_list
            && is(before(&around), "{")
            && is(Some(around.end), "}")
            // Braces around a placeholder belong to a block, unless they touch the placeholder: `{{ NAME }}`.
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
        let is_bare = around.len() == 1;
        // Doesn't replace a name in the module or in the function that declares the name.
        let is_that =
            |(known, scope): &(&str, Range<usize>)| known == &&**name && scope.contains(&at);
        if is_bare && declared.iter().any(is_that) {
            continue;
        }
        if token.kind == Kind::Word && !(is_bare && is_name(text, tokens, at)) {
            found.push((
                tokens[around.start].range().start..tokens[around.end - 1].range().end,
                &**name,
            ));
        }
    }
    found
}

/// Words that declare the name after them.
const DECLARES: [&str; 7] = ["fn", "struct", "alias", "const", "override", "let", "var"];

/// The tokens of the function around `at`. The tokens end at the function's last brace or, without such a brace, at
/// the next function.
fn function_around(text: &str, tokens: &[Token], at: usize) -> Option<Range<usize>> {
    let of = |at: usize| &text[tokens[at].range()];
    let start = (0..at).rev().find(|one| of(*one) == "fn")?;
    let next = (at..tokens.len()).find(|one| of(*one) == "fn").unwrap_or(tokens.len());
    let mut depth = 0;
    let end = (start..next).find(|one| {
        match of(*one) {
            "{" => depth += 1,
            "}" => depth -= 1,
            _ => {}
        }
        of(*one) == "}" && depth == 0
    });
    let all = start..end.unwrap_or(next);
    all.contains(&at).then_some(all)
}

/// The names that a text declares or imports. With each name, returns the tokens in which the name is visible.
fn declared<'t>(text: &'t str, tokens: &[Token]) -> Vec<(&'t str, Range<usize>)> {
    let of = |at: usize| tokens.get(at).map_or("", |token| &text[token.range()]);
    // The end of the text also counts as the start of a line.
    let begins_line = |at: usize| {
        let start = tokens.get(at).map_or(text.len(), |token| token.range().start);
        at > 0 && (at == tokens.len() || text[tokens[at - 1].range().end..start].contains('\n'))
    };
    let mut found = Vec::new();
    // An `#import` ends with its line, or behind its braces. An `import` ends with its semicolon.
    let (mut imports, mut by_line, mut depth) = (false, false, 0_usize);
    for at in 0..tokens.len() {
        let (before, behind) = (at.checked_sub(1).map_or("", of), of(at + 1));
        if by_line && depth == 0 && before != "," && begins_line(at) {
            imports = false;
        }
        match of(at) {
            "import" => (imports, by_line, depth) = (true, before == "#", 0),
            ";" => imports = false,
            "{" if imports => depth += 1,
            "}" if imports => depth = depth.saturating_sub(1),
            _ => {}
        }
        let is_last = by_line && depth == 0 && begins_line(at + 1);
        let is_imported = imports && (is_last || matches!(behind, "," | "}" | ";"));
        let is_declared = DECLARES.contains(&before) && matches!(behind, "(" | "{" | "=" | ":");
        // A parameter follows `(` or `,`. A structure's member may follow `,` as well, but isn't a parameter.
        let is_parameter =
            matches!(before, "(" | ",") && behind == ":" && !is_member(tokens, text, at);
        if is_imported || is_declared || is_parameter || before == ">" && behind == ":" {
            let own = function_around(text, tokens, at).filter(|_| before != "fn");
            found.push((of(at), own.unwrap_or(0..tokens.len())));
        }
    }
    found
}

/// Checks if a name before a colon is a structure's member or belongs to a `case`. If the name is in
/// parentheses, it is a parameter, and the result is `false`.
fn is_member(tokens: &[Token], text: &str, at: usize) -> bool {
    let mut depth = 0;
    for token in tokens[..at].iter().rev() {
        match &text[token.range()] {
            ")" => depth += 1,
            "(" if depth == 0 => return false,
            "(" => depth -= 1,
            "{" | "}" | ";" => return true,
            _ => {}
        }
    }
    true
}

/// Checks if Karat keeps a bare name instead of replacing it by a value: the name is in a declaration, path,
/// condition, directive or import.
fn is_name(text: &str, tokens: &[Token], at: usize) -> bool {
    let of = |at: usize| tokens.get(at).map_or("", |token| &text[token.range()]);
    let before = at.checked_sub(1).map_or("", of);
    let start = tokens[at].range().start;
    let line = text[..start].rfind(['\n', '\r']).map_or(0, |end| end + 1);
    let is_directive =
        text[line..start].trim_start().starts_with('#') && !text[line..start].contains("#{");
    let is_declared = (DECLARES.contains(&before) || before == ">")
        && matches!(of(at + 1), "(" | "{" | "=" | ":")
        && !(before == ">" && of(at + 1) != ":");
    let is_member = matches!(before, "{" | "," | "(" | ")")
        && of(at + 1) == ":"
        && of(at + 2) != ":"
        && !is_case(text, tokens, at);
    // Goes back over the words that a condition or an import may contain.
    let is_part = |word: &str| {
        matches!(word, "(" | ")" | "!" | "&" | "|" | ":" | "," | "{" | "}" | "*")
            || word.starts_with(|c: char| c == '_' || c.is_alphabetic())
                && !DECLARES.contains(&word)
    };
    let mut back = (0..at).rev().take_while(|one| is_part(of(*one)));
    let is_asked = back.any(|one| {
        let is_condition = matches!(of(one), "if" | "elif") && one > 0 && of(one - 1) == "@";
        let ends = || {
            (one + 2..at).try_fold(1_i32, |depth, inner| match of(inner) {
                "(" => Some(depth + 1),
                ")" if depth == 1 => None,
                ")" => Some(depth - 1),
                _ => Some(depth),
            })
        };
        is_condition && ends().is_some() || of(one) == "import"
    });
    let is_path = before == ":" && at > 1 && of(at - 2) == ":";
    matches!(before, "." | "@") || is_path || is_directive || is_declared || is_member || is_asked
}

/// Checks if a token is within the selectors of a `case`.
fn is_case(text: &str, tokens: &[Token], at: usize) -> bool {
    let of = |at: usize| &text[tokens[at].range()];
    (0..at)
        .rev()
        .take_while(|one| !matches!(of(*one), ";" | "{" | "}"))
        .any(|one| of(one) == "case")
}

#[cfg(test)]
mod tests {
    use super::{Values, substituted};

    // Lesson 145
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
            (
                "fn f(x: {T}) -> {T} { var a: T; }",
                "fn f(x: vec4<f32>) -> vec4<f32> { var a: vec4<f32>; }",
            ),
            (
                "struct P { N: u32, M: N }\nlet a = p.N * N;",
                "struct P { N: u32, M: 64 }\nlet a = p.N * 64;",
            ),
            (
                "#ifdef N\n@if(A && !(N)) const M = N;\n#{N}\n#if N > 3",
                "#ifdef N\n@if(A && !(N)) const M = 64;\n64\n#if N > 3",
            ),
            (
                "const N: u32 = 3; fn N(N: u32, T: f32) {}",
                "const N: u32 = 3; fn N(N: u32, T: f32) {}",
            ),
            (
                "switch x { case N: { y = N; } case 2, N: {} }",
                "switch x { case 64: { y = 64; } case 2, 64: {} }",
            ),
            ("import package::a::{b, N as c};\nf(N)", "import package::a::{b, N as c};\nf(64)"),
            (
                "const N = 3;\nfn f() -> u32 { return N + {N}; }",
                "const N = 3;\nfn f() -> u32 { return N + 64; }",
            ),
            ("@if(A) f(N); @else g(N);", "@if(A) f(64); @else g(64);"),
            ("import a::N;\nfn f() { g(N); a::N(N); }", "import a::N;\nfn f() { g(N); a::N(N); }"),
            (
                "fn f(N: f32) { N; }\nfn g() { N + {N}; }",
                "fn f(N: f32) { N; }\nfn g() { 64 + 64; }",
            ),
            (
                "fn f() { for (var N = 0; N < 3; N++) {} }",
                "fn f() { for (var N = 0; N < 3; N++) {} }",
            ),
            ("const a = b::N + N;", "const a = b::N + 64;"),
            ("import a::{N}; fn f() { {N} }", "import a::{N}; fn f() { 64 }"),
            // A parameter and a local variable hide the value in their own function.
            (
                "fn f(N: f32) { N; }\nfn g() { N; }\nfn h() { let N = 2; if true { N; } }\nconst a = N;",
                "fn f(N: f32) { N; }\nfn g() { 64; }\nfn h() { let N = 2; if true { N; } }\nconst a = 64;",
            ),
            ("fn g() { N; }\nfn N() {}", "fn g() { N; }\nfn N() {}"),
            // `naga_oil` needs no semicolon after an import.
            (
                "#import a::q as Q\nstruct P { a: N, b: N }",
                "#import a::q as Q\nstruct P { a: 64, b: 64 }",
            ),
            (
                "#import a::{\n b,\n c\n}\nconst d = f(N, 1);",
                "#import a::{\n b,\n c\n}\nconst d = f(64, 1);",
            ),
            ("#import a::N\nconst d = f(N, 1);", "#import a::N\nconst d = f(N, 1);"),
            (
                "#import a::{\n b,\n N,\n}\nconst d = f(N, 1);",
                "#import a::{\n b,\n N,\n}\nconst d = f(N, 1);",
            ),
        ] {
            assert_eq!(substituted(text, &values).0, expected);
        }
    }
}
