//! Probes of a function's let-bindings: what a driver has for each while it computes the result.
//!
//! A copy of the linked text stores the binding in a private variable, and a function that calls the
//! author's one returns that variable. So control flow, arguments and resources are the author's; a
//! binding in a loop has its last value. The text is the linked one, so nothing of the author's file
//! is touched.

use crate::diagnostic::Span;
use crate::package::Package;
use crate::probe::Probed;
use crate::reflect::LetBinding;

/// A let-binding, ready to be called with the function's arguments.
pub(super) struct Let {
    pub(super) name: String,
    /// Its value, in the author's file.
    pub(super) span: Option<Span>,
    pub(super) probed: Probed,
}

/// Bindings of one function that are looked at, each with a pipeline on both columns.
const MOST: usize = 48;

/// The let-bindings of a function, in the order of its text. One that can't be probed (a pointer, a
/// value that no result can be) is left out.
pub(super) fn lets(probed: &Probed) -> Vec<Let> {
    let (program, text) = (&probed.program, probed.program.text());
    let Some(found) = program.let_bindings(&probed.function().name) else { return Vec::new() };
    let parameters: Vec<String> = found
        .parameters
        .iter()
        .enumerate()
        .map(|(index, ty)| format!("karat_{index}: {ty}"))
        .collect();
    let arguments: Vec<String> =
        (0..parameters.len()).map(|index| format!("karat_{index}")).collect();
    let mut bindings: Vec<(usize, Let)> = Vec::new();
    for LetBinding { value: range, ty } in found.bindings {
        let Some(name) = bound_name(text, range.start) else { continue };
        let Some(end) = end_of_statement(text, range.end) else { continue };
        let copy = format!(
            "{} karat_let = {name};{}\nvar<private> karat_let: {ty};\n\
             fn karat_let_of({}) -> {ty} {{\n    karat_let = {ty}();\n    \
             let karat_result = {}({});\n    return karat_let;\n}}\n",
            &text[..end],
            &text[end..],
            parameters.join(", "),
            found.function,
            arguments.join(", "),
        );
        let package = Package::from_source("karat_let", copy);
        if let Ok(probed) = Probed::new(&package, "karat_let_of") {
            let span = program.resolve(range.clone());
            bindings.push((range.start, Let { name: name.to_owned(), span, probed }));
        }
    }
    bindings.sort_by_key(|(start, _)| *start);
    bindings.truncate(MOST);
    bindings.into_iter().map(|(_, one)| one).collect()
}

/// The name that a `let` gives to the expression that starts here. naga's own name of a value that is
/// bound twice is the second one.
fn bound_name(text: &str, expression: usize) -> Option<&str> {
    let before = text.get(..expression)?;
    let part = |c: char| c.is_alphanumeric() || c == '_';
    let alone = |(at, word): &(usize, &str)| {
        !before[..*at].ends_with(part) && !before[at + word.len()..].starts_with(part)
    };
    let (at, word) = before.rmatch_indices("let").find(alone)?;
    let declared = before[at + word.len()..].trim_start();
    let length = declared.find(|c| !part(c))?;
    let (name, rest) = declared.split_at(length);
    // A type may follow, and brackets may open.
    let rest = rest.trim_end_matches(|c: char| c.is_whitespace() || c == '(');
    let of_type = rest.trim_start().starts_with(':') && !rest.contains([';', '{']);
    let bound = rest.strip_suffix('=')?.trim().is_empty() || of_type;
    (bound && !name.is_empty()).then_some(name)
}

/// Behind the semicolon that ends the statement whose expression ends here.
fn end_of_statement(text: &str, expression: usize) -> Option<usize> {
    let rest = text.get(expression..)?;
    let length = rest.find(';')?;
    // Something else, such as a comment, might have a semicolon of its own.
    let plain = |c: char| c.is_whitespace() || c == ')';
    rest[..length].chars().all(plain).then_some(expression + length + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_binding_is_returned_by_a_function_of_its_own() {
        let text = "fn half(x: f32) -> f32 { let h = 0.5 * x; return h; }\n\
                    fn f(a: f32, v: vec3f) -> f32 {\n    \
                    let d = dot(v, v) + a; let copy = d;\n    \
                    if a > 0.0 { let e = (half(d)); return e; }\n    \
                    var sum = 0.0;\n    \
                    for (var i = 0u; i < 3u; i++) { let step = f32(i); sum += step; }\n    \
                    return sum;\n}\n";
        let package = Package::from_source("lets", text);
        let probed = Probed::new(&package, "f").expect("valid");
        let lets = lets(&probed);
        let names: Vec<&str> = lets.iter().map(|one| one.name.as_str()).collect();
        // `copy` is the same value as `d`, and looked at once.
        assert_eq!(names, ["d", "e", "step"]);
        let places: Vec<String> =
            lets.iter().map(|one| one.span.as_ref().expect("the author's").to_string()).collect();
        assert!(places[1].ends_with(":4:27"), "{places:?}");
        assert_eq!(lets[1].probed.function().parameters.len(), 2);
    }

    #[test]
    fn names_are_those_of_the_text() {
        let name =
            |text: &str| bound_name(text, text.find('@').expect("a mark")).map(str::to_owned);
        assert_eq!(name("let d = @").as_deref(), Some("d"));
        assert_eq!(name("let a = 1; let letter: vec3<f32>\n = (( @").as_deref(), Some("letter"));
        for other in ["let d = a; @", "var d = @", "d = @", "let a = f(1, @", "outlet = @"] {
            assert_eq!(name(other), None, "{other}");
        }
    }

    #[test]
    fn a_semicolon_in_a_comment_ends_no_statement() {
        assert_eq!(end_of_statement("a + b ) ; c", 5), Some(9));
        assert_eq!(end_of_statement("a /* ; */;", 1), None);
        assert_eq!(end_of_statement("a", 1), None);
    }
}
