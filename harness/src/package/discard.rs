//! Makes functions with `discard` callable.
//!
//! A test may expect that a function discards its pixel. After `discard`, an invocation goes on as a helper, and
//! the GPU drops its results (WGSL, *Discard Statement*). So Karat replaces the statement `discard` by an assignment
//! to a flag. A generated function calls the author's function, and returns its result and the flag. The GPU also
//! drops a helper's writes to memory, which a flag can't imitate. So a function that writes to memory keeps its
//! `discard`, and Karat calls such a function in a draw instead of a dispatch.

use super::lexer::lex;
use super::splice::{DISCARDED, Edit};
use super::syntax::Module;

const DISCARD: &str = "discard";

/// The name of the function that Karat calls in place of the author's function.
const WRAPPER: &str = "karat_or_discarded";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Discards {
    /// An assignment to a flag replaces the statement `discard`.
    Assigned,
    /// The statement `discard` stays in the text, and the invocation goes on as a helper.
    Kept,
}

pub(super) fn discards(module: &Module, tokens: std::ops::Range<usize>) -> Vec<Edit> {
    let own = tokens.filter(|token| module.text(*token) == DISCARD);
    let edit = |token| Edit { from: module.span(token).range, name: Some(DISCARDED.to_owned()) };
    own.map(edit).collect()
}

/// The name and the text of a function that calls a function with `discard`. The generated function returns a structure
/// of the function's value and the flag `discarded`. If the text keeps the statement `discard`, the flag `discarded` is
/// always false, because the GPU drops a helper's result. Returns `None` if the text doesn't have the function.
pub(super) fn wrapper(
    text: &str,
    function: &str,
    discards: Discards,
) -> Option<(&'static str, String)> {
    let tokens = lex(text);
    let of = |at: usize| tokens.get(at).map_or("", |token| &text[token.range()]);
    let bytes =
        |from: usize, to: usize| &text[tokens[from].range().start..tokens[to].range().start];
    let name = (1..tokens.len()).find(|at| of(*at) == function && of(at - 1) == "fn")?;
    let (mut close, mut depth) = (name + 1, 0);
    while close < tokens.len() {
        depth += match of(close) {
            "(" => 1,
            ")" => -1,
            _ => 0,
        };
        if depth == 0 {
            break;
        }
        close += 1;
    }
    let body = (close..tokens.len()).find(|at| of(*at) == "{")?;
    let parameters = bytes(name + 2, close);
    // Names stand before a colon, and no type contains a colon.
    let names: Vec<&str> = (name + 2..close).filter(|at| of(at + 1) == ":").map(of).collect();
    let call = format!("{function}({})", names.join(", "));
    // A comment may stand between the type and the body.
    let ty = || &text[tokens[close + 3].range().start..tokens[body - 1].range().end];
    let returns = (of(close + 1) == "-").then(ty);
    let (member, run, dropped, value) = match returns {
        Some(ty) => (
            format!("value: {ty}, "),
            format!("let karat_value = {call};"),
            format!("{ty}(), "),
            "karat_value, ",
        ),
        None => (String::new(), format!("{call};"), String::new(), ""),
    };
    let (variable, first, then) = match discards {
        Discards::Kept => ("", "", String::new()),
        Discards::Assigned => (
            "var<private> karat_discarded: bool;\n",
            "karat_discarded = false;\n    ",
            format!("if karat_discarded {{ return karat_Pixel({dropped}true); }}\n    "),
        ),
    };
    let text = format!(
        "\n{variable}struct karat_Pixel {{ {member}discarded: bool }}\n\
         fn {WRAPPER}({parameters}) -> karat_Pixel {{\n    {first}{run}\n    {then}\
         return karat_Pixel({value}false);\n}}\n"
    );
    Some((WRAPPER, text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrapper_takes_what_the_function_takes() {
        let text = "fn f ( a: array<vec2<f32>, 4>,\n  b : ptr<function, f32>, ) -> vec4<f32> {\n  return vec4f(); }";
        let assigned = |text, name| wrapper(text, name, Discards::Assigned);
        let (name, wrapped) = assigned(text, "f").expect("it is there");
        assert!(wrapped.contains(&format!(
            "fn {name}(a: array<vec2<f32>, 4>,\n  b : ptr<function, f32>, ) ->"
        )));
        assert!(wrapped.contains("let karat_value = f(a, b);"), "{wrapped}");
        assert!(wrapped.contains("karat_Pixel(vec4<f32>(), true)"), "{wrapped}");
        let (_, wrapped) = assigned("fn h() -> f32 // half\n{ }", "h").expect("it is there");
        assert!(wrapped.contains("{ value: f32, discarded: bool }"), "{wrapped}");
        let (_, wrapped) = assigned("fn g() { }", "g").expect("it is there");
        assert!(wrapped.contains("    g();\n") && wrapped.contains("{ discarded: bool }"));
        assert!(assigned(text, "g").is_none());
        let (_, wrapped) = wrapper(text, "f", Discards::Kept).expect("it is there");
        assert!(wrapped.contains("return karat_Pixel(karat_value, false);"), "{wrapped}");
        assert!(!wrapped.contains("karat_discarded"), "{wrapped}");
    }
}
