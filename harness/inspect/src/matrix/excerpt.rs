//! Finds a function and its variables in naga's output.

/// The first and the last line of a function in a translation, counted from 1. naga keeps a function's name, or appends
/// a suffix if another item has the name or the language reserves the name. In GLSL, each entry point is `main`.
pub(super) fn function_lines(text: &str, name: &str, entry_point: bool) -> Option<(usize, usize)> {
    let heads = |line: &str| {
        let top = line.starts_with(|c: char| c.is_alphabetic());
        let called = |name: &str| {
            words(line).any(|(word, rest)| is(word, name) && rest.trim_start().starts_with('('))
        };
        top && !line.trim_end().ends_with(';') && (called(name) || (entry_point && called("main")))
    };
    let first = text.lines().position(heads)?;
    let rest = text.lines().skip(first).position(|line| line.trim_end() == "}")?;
    Some((first + 1, first + rest + 1))
}

/// Returns the line, counted from 1, that defines a variable. The author's text has `of` variables with this name, and
/// `which` is the variable's number among them, counted from 0. naga keeps their order. Returns `None` if the
/// translation doesn't have exactly `of` such variables.
pub(super) fn definition_line(
    text: &str,
    (first, last): (usize, usize),
    name: &str,
    (which, of): (usize, usize),
) -> Option<usize> {
    let defines = |line: &str| {
        let line = line.trim_start();
        let assigned = |(word, rest): (&str, &str)| {
            let rest = rest.trim_start();
            // A definition has a type or `let` before the name. An assignment has no text before it.
            let defined = line.len() > word.len() + rest.len() && !line.starts_with(word);
            defined && is(word, name) && rest.starts_with('=') && !rest.starts_with("==")
        };
        words(line).next().is_some_and(|(head, _)| head != "for") && words(line).any(assigned)
    };
    let lines = text.lines().enumerate().skip(first - 1).take(last + 1 - first);
    let found: Vec<usize> =
        lines.filter(|(_, line)| defines(line)).map(|(index, _)| index + 1).collect();
    (found.len() == of).then(|| found.get(which).copied()).flatten()
}

/// The identifiers of a line, each with the text that follows.
fn words(line: &str) -> impl Iterator<Item = (&str, &str)> {
    let part = |c: char| c.is_alphanumeric() || c == '_';
    let mut rest = line;
    std::iter::from_fn(move || {
        rest = &rest[rest.find(part)?..];
        let end = rest.find(|c| !part(c)).unwrap_or(rest.len());
        let word = &rest[..end];
        rest = &rest[end..];
        Some((word, rest))
    })
}

/// Checks if `word` is naga's form of a name: `f0` becomes `f0_`, and a second `x` becomes `x_1`.
fn is(word: &str, name: &str) -> bool {
    let Some(appended) = word.strip_prefix(name.trim_end_matches('_')) else { return false };
    appended.chars().all(|c| c == '_' || c.is_ascii_digit())
        && (appended.is_empty() || appended.starts_with('_'))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MSL: &str = "#include <metal_stdlib>\n\
                       float other(float x) {\n    return x;\n}\n\
                       float f0_(\n    float x_1\n) {\n    float d = x_1;\n    bool e = d == x_1;\n    \
                       return d;\n}\n";

    // Lesson 84
    #[test]
    fn functions_and_their_variables_are_found() {
        assert_eq!(function_lines(MSL, "f0", false), Some((5, 11)));
        assert_eq!(function_lines(MSL, "other", false), Some((2, 4)));
        assert_eq!(function_lines(MSL, "f", false), None);
        let line = |lines, name, which| definition_line(MSL, lines, name, which);
        assert_eq!(line((5, 11), "d", (0, 1)), Some(8));
        assert_eq!(line((5, 11), "e", (0, 1)), Some(9));
        assert_eq!(line((2, 4), "d", (0, 1)), None);
        let glsl = "void helper() {\n}\nvoid main() {\n    return;\n}\n";
        assert_eq!(function_lines(glsl, "shade", true), Some((3, 5)));
        assert_eq!(function_lines(glsl, "shade", false), None);
    }

    #[test]
    fn variables_with_the_same_name_are_found_by_their_order() {
        let wgsl = "fn f(x: f32) -> f32 {\n    let q = (x * 2f);\n    if true {\n        \
                    let q_1 = (q * x);\n        q_2 = 1f;\n        return q_1;\n    }\n}\n";
        let line = |which| definition_line(wgsl, (1, 8), "q", which);
        assert_eq!((line((0, 2)), line((1, 2))), (Some(2), Some(4)));
        assert_eq!(line((0, 1)), None, "two variables have this name");
    }
}
