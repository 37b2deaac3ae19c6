//! Assertions and prints in a shader: `//karat: assert x >= 0.0` and `//karat: print x`, each on a line of its own.
//!
//! To a host they are comments. Karat reads a variable and a `let` in place of the comment, so that the value is computed
//! where the line stands, by the shader's own control flow. Lines stay, and places are mapped back to the author's text. With
//! WESL an author may write `@if(karat) assert(x >= 0.0);`, which means the same.

use super::PackageError;
use crate::diagnostic::{SourceFile, Span, Value, nearest};

/// The names of the `let`s, before the number of the line.
pub(crate) const ASSERTED: &str = "karat_assert_";
pub(crate) const PRINTED: &str = "karat_print_";

/// The variable that makes an operation of its own of each value, before the number of the line.
pub(crate) const HOLDER: &str = "karat_value_";

/// The marks that begin such a line.
const COMMENT: &str = "karat:";
const CONDITION: &str = "@if(karat)";

/// A line that asserts or prints, and the parts that aren't its expression: bytes of the line.
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

/// A text in which assertions and prints are code.
pub(super) fn read(source: SourceFile) -> Result<SourceFile, PackageError> {
    if !source.text.contains(COMMENT) && !source.text.contains(CONDITION) {
        return Ok(source);
    }
    let (mut text, mut values) = (String::with_capacity(2 * source.text.len()), Vec::new());
    for (number, line) in (1..).zip(source.text.split_inclusive('\n')) {
        let wrong = |reason: String| PackageError::Asserts {
            place: format!("{}:{number}", source.name),
            reason,
        };
        let Some(Line { verb, head, expression }) = Line::of(line).map_err(wrong)? else {
            text.push_str(line);
            continue;
        };
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
    /// `None` of a line of any other kind.
    fn of(line: &'l str) -> Result<Option<Self>, String> {
        let own = line.trim();
        let comment = own.strip_prefix("//").map(str::trim_start);
        let Some(rest) = comment.and_then(|rest| rest.strip_prefix(COMMENT)) else {
            let Some(rest) = own.strip_prefix(CONDITION) else {
                let late = line.find("//").is_some_and(|at| {
                    line[at..].trim_start_matches('/').trim_start().starts_with(COMMENT)
                });
                return match late {
                    true => Err(format!("`//{COMMENT}` stands on a line of its own")),
                    false => Ok(None),
                };
            };
            return Self::called(own, rest.trim_start());
        };
        let rest = rest.trim_start();
        let word: &str = rest.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
        let Some(verb) = Verb::of(word) else {
            let near = nearest(word, ["assert", "print"]);
            let near = near.map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
            return Err(format!("`//{COMMENT} {word}` neither asserts nor prints{near}"));
        };
        let behind = &rest[word.len()..];
        let head = &own[..own.len() - behind.len()];
        // What follows may be a comment in the comment.
        let expression = behind.split("//").next().unwrap_or_default();
        let expression = expression.trim().trim_end_matches(';').trim_end();
        match expression.is_empty() {
            true => Err(format!("`//{COMMENT} {word}` has no expression")),
            false => Ok(Some(Self { verb, head, expression })),
        }
    }

    /// `@if(karat) assert(x);`, of which `rest` is behind the condition.
    fn called(own: &'l str, rest: &'l str) -> Result<Option<Self>, String> {
        let Some((word, _)) = rest.split_once('(') else { return Ok(None) };
        let Some(verb) = Verb::of(word.trim_end()) else { return Ok(None) };
        let head = &own[..own.len() - rest.len() + word.len()];
        let call = rest[word.len()..].split("//").next().unwrap_or_default().trim_end();
        match call.strip_suffix(';').map(str::trim_end).filter(|call| call.ends_with(')')) {
            Some(expression) => Ok(Some(Self { verb, head, expression })),
            None => Err(format!("`{CONDITION} {}(…);` stands on one line", word.trim_end())),
        }
    }
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

/// The values of a text in which values were replaced twice: `inner` are places of the text before the second time.
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

/// The expression of an assertion or a print, by a place in the `let` behind it.
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
        for line in
            ["// karate: print x", "@if(karat) let y = f(x);", "// say //", "x = 1; // karat"]
        {
            assert_eq!(text(line), line);
        }
    }

    #[test]
    fn slips_are_told() {
        let error = |line: &str| {
            let source = SourceFile::new("m.wgsl", format!("\n{line}\n"));
            read(source).map(|read| read.text).expect_err("it is wrong").to_string()
        };
        for (line, part) in [
            ("//karat: prnt x", "did you mean `print`?"),
            ("//karat: assert", "has no expression"),
            ("//karat:", "neither asserts nor prints"),
            ("let y = x; //karat: print y", "on a line of its own"),
            ("@if(karat) print(x", "on one line"),
        ] {
            let error = error(line);
            assert!(error.contains("m.wgsl:2") && error.contains(part), "{line}: {error}");
        }
    }

    /// Places in a text with values and a print are those of the author.
    #[test]
    fn values_beside_it_keep_their_places() {
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
