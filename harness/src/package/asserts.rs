//! Assertions and prints in a shader: `//karat: assert x >= 0.0` and `//karat: print x`, each on a line of its own.
//!
//! To the program that loads the shader, an assertion or a print is only a comment. Karat replaces each such comment
//! with a variable and a `let`. The shader computes an asserted or printed expression only when control flow reaches
//! the expression's line. The number of lines stays the same. Karat maps positions in the new text back to the author's
//! text. In WESL, an author may also write `@if(karat) assert(x >= 0.0);`.

use super::PackageError;
use crate::diagnostic::{SourceFile, Span, Value, nearest};

/// The prefix of the generated `let`s' names. For line 12, the name is `karat_assert_12`.
pub(crate) const ASSERTED: &str = "karat_assert_";
pub(crate) const PRINTED: &str = "karat_print_";

/// The prefix of the generated variables' names. For line 12, the name is `karat_value_12`. The variable stores the
/// expression's value, and the `let` loads it: `var karat_value_12 = x; let karat_print_12 = karat_value_12;`.
pub(crate) const HOLDER: &str = "karat_value_";

/// The first text in a comment with an assertion or a print.
const COMMENT: &str = "karat:";
const CONDITION: &str = "@if(karat)";
const CONDITION_HEAD: &str = "@if(karat";

/// A line with an assertion or a print: the command `assert` or `print`, the text before the expression, and the
/// expression.
struct Line<'l> {
    verb: Verb,
    head: &'l str,
    expression: &'l str,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Verb {
    Assert,
    Print,
}

pub(super) fn read(source: SourceFile) -> Result<SourceFile, PackageError> {
    let lower = source.text.to_ascii_lowercase();
    if !lower.contains("karat") {
        return Ok(source);
    }
    let (mut text, mut values) = (String::with_capacity(2 * source.text.len()), Vec::new());
    let mut previous = "";
    for (number, line) in (1..).zip(source.text.split_inclusive('\n')) {
        let wrong = |reason: String| PackageError::Asserts {
            place: format!("{}:{number}", source.name),
            reason,
        };
        let Some(Line { verb, head, expression }) = Line::of(line).map_err(wrong)? else {
            text.push_str(line);
            if !line.trim().is_empty() {
                previous = line.trim();
            }
            continue;
        };
        let is_name = |c: char| c.is_alphanumeric() || c == '_';
        let returned = previous.strip_prefix("return").filter(|rest| !rest.starts_with(is_name));
        if returned.is_some_and(|rest| rest.ends_with(';')) {
            return Err(wrong("this line comes after a `return`, so it never runs: move the line above the `return`".to_owned()));
        }
        let indent = line.len() - line.trim_start().len();
        let (before, behind) = line[indent + head.len()..]
            .split_at(line[indent + head.len()..].find(expression).unwrap_or_default());
        let behind = &behind[expression.len()..];
        let ending = &behind[behind.trim_end_matches(['\r', '\n']).len()..];
        let mut replace = |text: &mut String, by: &str, placeholder: &str| {
            let start = text.len();
            text.push_str(by);
            let placeholder = placeholder.to_owned();
            values.push(Value { at: start..text.len(), placeholder, hidden: true });
        };
        text.push_str(&line[..indent]);
        replace(&mut text, &format!("var {HOLDER}{number} = "), &format!("{head}{before}"));
        text.push_str(expression);
        let holds = match verb {
            Verb::Assert => format!("; let {ASSERTED}{number}: bool = {HOLDER}{number};"),
            Verb::Print => format!("; let {PRINTED}{number} = {HOLDER}{number};"),
        };
        replace(&mut text, &holds, &behind[..behind.len() - ending.len()]);
        text.push_str(ending);
    }
    Ok(SourceFile { text, values, ..source })
}

impl<'l> Line<'l> {
    /// Reads a line. Returns `None` if the line doesn't assert or print.
    fn of(line: &'l str) -> Result<Option<Self>, String> {
        let own = line.trim();
        let comment = own.strip_prefix("//").map(str::trim_start);
        let Some(rest) = comment.and_then(|rest| rest.strip_prefix(COMMENT)) else {
            return match line.find(CONDITION_HEAD) {
                Some(_) => Self::called(own),
                None if is_meant(line) => {
                    Err(format!("`//{COMMENT}` must begin a line, with exactly two slashes"))
                }
                None => Ok(None),
            };
        };
        let rest = rest.trim_start();
        let word: &str = rest.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
        let Some(verb) = Verb::of(word) else {
            let near = nearest(word, ["assert", "print"]);
            let near = near.map_or_else(String::new, |near| format!(" (did you mean `{near}`?)"));
            return Err(format!("`//{COMMENT} {word}` isn't a command of Karat{near}"));
        };
        let behind = &rest[word.len()..];
        let head = &own[..own.len() - behind.len()];
        // A second comment may follow.
        let expression = behind.split("//").next().unwrap_or_default();
        let expression = expression.trim().trim_end_matches(';').trim_end();
        match (expression.is_empty(), is_one(expression)) {
            (true, _) => Err(format!("an expression is missing after `//{COMMENT} {word}`")),
            (_, false) => Err(format!("`{expression}` isn't a single expression")),
            _ => Ok(Some(Self { verb, head, expression })),
        }
    }

    /// Reads `@if(karat) assert(x);` or `@if(karat) print(x);`. Returns `None` for `@if(karat) import karat::print;`.
    fn called(own: &'l str) -> Result<Option<Self>, String> {
        let wrong = || {
            Err(format!(
                "only an import of `karat`, `print(x);` or `assert(x);` can follow `{CONDITION}`, on the same line"
            ))
        };
        let Some(rest) = own.strip_prefix(CONDITION).map(str::trim_start) else { return wrong() };
        if rest.starts_with("import ") {
            return Ok(None);
        }
        let Some((word, _)) = rest.split_once('(') else { return wrong() };
        let Some(verb) = Verb::of(word.trim_end()) else { return wrong() };
        let head = &own[..own.len() - rest.len() + word.len()];
        let call = rest[word.len()..].split("//").next().unwrap_or_default().trim_end();
        let call = call.strip_suffix(';').map(str::trim_end);
        match call.filter(|call| is_one(call) && is_enclosed(call)) {
            Some(expression) => Ok(Some(Self { verb, head, expression })),
            None => wrong(),
        }
    }
}

/// Checks if the author probably meant an assertion or a print, but used a wrong form, such as `//karat print x`.
fn is_meant(line: &str) -> bool {
    let Some(at) = line.find("//") else { return false };
    let lower = line[at..].trim_start_matches('/').trim_start().to_ascii_lowercase();
    let Some(rest) = lower.strip_prefix("karat") else { return false };
    let rest = rest.trim_start_matches([' ', '\t', ':']);
    let verbs = ["print ", "assert ", "print(", "assert("];
    lower.starts_with(COMMENT) || verbs.iter().any(|verb| rest.starts_with(verb))
}

/// Checks if the text is one expression: the text contains no `;`, no brace and no `/*`, and its brackets match.
fn is_one(expression: &str) -> bool {
    let mut open = Vec::new();
    let mut paired = true;
    for character in expression.chars() {
        match character {
            '(' | '[' => open.push(character),
            ')' => paired &= open.pop() == Some('('),
            ']' => paired &= open.pop() == Some('['),
            ';' | '{' | '}' => return false,
            _ => {}
        }
    }
    paired && open.is_empty() && !expression.contains("/*")
}

/// Checks if the text's last bracket closes its first bracket.
fn is_enclosed(call: &str) -> bool {
    let mut depth = 0;
    let closed = call.char_indices().find_map(|(at, character)| {
        depth += i32::from(character == '(') - i32::from(character == ')');
        (depth == 0).then_some(at)
    });
    call.starts_with('(') && closed == Some(call.len() - 1)
}

pub(crate) fn is_in_a_line(span: &Span) -> bool {
    let (text, at) = (&span.file.text, span.range.start);
    let is_before = |value: &Value| {
        value.hidden
            && value.at.start <= at
            && text.get(value.at.start..at).is_some_and(|between| !between.contains('\n'))
    };
    span.file.values.iter().any(is_before)
}

impl Verb {
    fn of(word: &str) -> Option<Self> {
        match word {
            "assert" => Some(Self::Assert),
            "print" => Some(Self::Print),
            _ => None,
        }
    }
}

/// Merges the replaced ranges of two passes over a text: first `inner`, then `outer`. The ranges in `inner` are
/// positions in the text between the two passes. The merged ranges are positions in the final text.
pub(super) fn composed(inner: Vec<Value>, outer: Vec<Value>) -> Vec<Value> {
    let (mut all, mut shift, mut outer) = (Vec::new(), 0_isize, outer.into_iter().peekable());
    let moved = |at: usize, shift: isize| at.checked_add_signed(shift).expect("it is in the text");
    for Value { at, placeholder, hidden } in inner {
        while let Some(one) = outer.next_if(|one| moved(one.at.start, -shift) < at.start) {
            shift += one.at.len() as isize - one.placeholder.len() as isize;
            all.push(one);
        }
        let at = moved(at.start, shift)..moved(at.end, shift);
        all.push(Value { at, placeholder, hidden });
    }
    all.extend(outer);
    all
}

/// The location of the expression in an assertion or a print; `None` if the line contains neither. `holder` is a
/// location in the `let` that Karat generated for the line.
pub(crate) fn expression_of(holder: &Span) -> Option<Span> {
    let values = &holder.file.values;
    let at = values.iter().position(|value| value.at.contains(&holder.range.start))?;
    let is_head = |value: &&Value| {
        let text = &value.placeholder;
        text.starts_with("//") || text.starts_with(CONDITION)
    };
    let head = values[..at].iter().rev().find(is_head)?;
    Some(Span { file: holder.file.clone(), range: head.at.end..values[at].at.start })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(line: &str) -> String {
        let written = format!("fn f(x: f32) {{\n{line}\n}}\n");
        let read = read(SourceFile::new("m.wgsl", &*written)).expect("it is one");
        assert_eq!(read.written(), written, "the author's text stays known");
        read.text.lines().nth(1).expect("lines stay").to_owned()
    }

    #[test]
    fn comments_become_code() {
        let print = "  var karat_value_2 = x * 2; let karat_print_2 = karat_value_2;";
        for line in ["//karat: print x * 2", "// karat: print x * 2;", "//karat:print x * 2 // why"]
        {
            assert_eq!(text(&format!("  {line}")), print);
        }
        let asserts = "var karat_value_2 = (x > 0); let karat_assert_2: bool = karat_value_2;";
        assert_eq!(text("@if(karat) assert(x > 0);"), asserts);
        assert_eq!(text("@if(karat) assert (x > 0) ; // why"), asserts);
        for line in [
            "// karate: print x",
            "@if(karat) import karat::print;",
            "// say //",
            "x = 1; // karat",
        ] {
            assert_eq!(text(line), line);
        }
    }

    #[test]
    fn malformed_assertions_are_errors() {
        let error = |line: &str| {
            let source = SourceFile::new("m.wgsl", format!("\n{line}\n"));
            read(source).map(|read| read.text).expect_err("it is wrong").to_string()
        };
        for (line, part) in [
            ("//karat: prnt x", "did you mean `print`?"),
            ("//karat: assert", "an expression is missing"),
            ("//karat:", "isn't a command of Karat"),
            ("let y = x; //karat: print y", "must begin a line"),
            ("@if(karat) print(x", "on the same line"),
            ("@if(karat) let y = f(x);", "on the same line"),
            ("let y = x; @if(karat) print(y);", "on the same line"),
            ("@if(karat && true) print(y);", "on the same line"),
            ("@if(karat) print(x); @if(karat) print(x);", "on the same line"),
            ("@if(karat) print(x) + (y);", "on the same line"),
            ("//karat: print x; y = 9.0", "isn't a single expression"),
            ("//karat: print f(x", "isn't a single expression"),
            ("//karat: print x /* open", "isn't a single expression"),
            ("//karat print x", "must begin a line"),
            ("// Karat : assert x > 1", "must begin a line"),
            ("/// karat: print x", "exactly two slashes"),
            ("    return x;\n\n    //karat: assert x > 0.0", "after a `return`"),
        ] {
            let error = error(line);
            let at = format!("m.wgsl:{}", 1 + line.lines().count());
            assert!(error.contains(&at) && error.contains(part), "{line}: {error}");
        }
    }

    /// Positions refer to the author's text, even after Karat replaces a print comment by code, and the name `N` by its
    /// value in `[values]`.
    #[test]
    fn places_beside_a_print_comment_are_those_of_the_source() {
        let written = "N;\n//karat: print N + x\nN N\n";
        let read = read(SourceFile::new("m.wgsl", written)).expect("it is one");
        let values = [("N".to_owned(), "100".to_owned())].into();
        let (text, outer) = crate::package::values::substituted(&read.text, &values);
        let file = SourceFile { text, values: composed(read.values, outer), name: read.name };
        assert_eq!(file.written(), written);
        let at = file.text.rfind("100").expect("the last");
        assert_eq!(file.line_column(at), (3, 3));
        let file = std::sync::Arc::new(file);
        let holder = file.text.find("let ").expect("it is there");
        let span = Span { file: file.clone(), range: holder..holder + 1 };
        let own = expression_of(&span).expect("it is one");
        assert_eq!(
            (&file.text[own.range.clone()], own.to_string()),
            ("100 + x", "m.wgsl:2:16".to_owned())
        );
    }
}
