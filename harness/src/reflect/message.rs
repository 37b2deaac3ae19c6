//! Shows naga's errors with the author's names and locations.

use std::ops::Range;
use std::sync::Arc;

use super::ReflectError;
use crate::diagnostic::{Diagnostic, Mend, Span, nearest};
use crate::expectation;
use crate::package::{Linked, Package, Unmet};

/// The message of an error's innermost cause, and then the messages of the outer errors.
pub(super) fn causes(error: &dyn std::error::Error) -> (String, Vec<String>) {
    let chain = std::iter::successors(Some(error), |cause| cause.source());
    let mut messages: Vec<String> =
        chain.map(|cause| without_handles(&cause.to_string())).collect();
    let message = messages.pop().unwrap_or_default();
    messages.reverse();
    (message, messages)
}

/// Removes naga's handles, `[6]` and `Some([6])`, from a message, because these indices into naga's IR don't help an
/// author.
fn without_handles(message: &str) -> String {
    let is_handle = |word: &str| {
        let word = word.trim_matches(|c| matches!(c, ',' | '.' | ':'));
        let word = word.strip_prefix("Some(").and_then(|w| w.strip_suffix(')')).unwrap_or(word);
        let digits = word.strip_prefix('[').and_then(|word| word.strip_suffix(']'));
        digits.is_some_and(|digits| digits.bytes().all(|byte| byte.is_ascii_digit()))
    };
    message.split(' ').filter(|word| !is_handle(word)).collect::<Vec<_>>().join(" ")
}

pub(super) fn to_author(
    linked: &Linked,
    message: String,
    labels: impl Iterator<Item = (Option<Range<usize>>, String)>,
    notes: Vec<String>,
) -> Diagnostic {
    let mut diagnostic = Diagnostic { notes, ..Diagnostic::new(message) };
    for (range, text) in labels {
        if let Some(span) = range.and_then(|range| linked.spliced.resolve(range)) {
            // naga's text has linked names, and the message shows the author's names.
            diagnostic = diagnostic.at(span, demangle(linked, &text));
        }
    }
    diagnostic.message = demangle(linked, &diagnostic.message);
    diagnostic.notes = diagnostic.notes.iter().map(|note| demangle(linked, note)).collect();
    if diagnostic.labels.is_empty() {
        let span = Span { file: Arc::clone(&linked.file), range: 0..0 };
        diagnostic = diagnostic.at(span, "in this module");
    }
    if let Some(name) = of_words(&diagnostic, "unknown attribute") {
        let near = nearest(&name, ATTRIBUTES).map(|near| format!("did you mean `@{near}`?"));
        return near.into_iter().fold(diagnostic, Diagnostic::note);
    }
    let Some(name) = of_words(&diagnostic, UNDECLARED) else {
        return diagnostic;
    };
    if expectation::package("karat").is_some_and(|karat| karat.names.contains(&name)) {
        return diagnostic.note(format!("add `import karat::{name};`"));
    }
    if let Some(Unmet { condition, feature }) = linked.inactive.get(&name) {
        let mend = feature.clone().map(Mend::Condition);
        let note = format!("`{name}` is declared under `{condition}`, which is false here");
        return diagnostic.note(note).mended_by(mend);
    }
    let mend = macro_of(&diagnostic, name);
    diagnostic.mended_by(mend)
}

/// The beginning of naga's message for an undeclared name.
const UNDECLARED: &str = "no definition in scope for identifier";

/// If an error is about an undeclared name, adds a note with the other modules that declare this name.
pub(super) fn with_declarers(package: &Package, error: ReflectError) -> ReflectError {
    let ReflectError::Invalid(found) = error else { return error };
    let file = found.location().map_or_else(String::new, |at| at.file.name.clone());
    let name = of_words(&found, UNDECLARED).unwrap_or_default();
    let (declaring, own) = package.declaring(&name, &file);
    let ([first, others @ ..], Some(own)) = (&*declaring, own) else {
        return ReflectError::Invalid(found);
    };
    let also = others.iter().map(|other| format!(", as does module `{other}`")).collect::<String>();
    // The list keeps the modules that are already joined with this module.
    let mut list = package.joined_with(&own);
    let how = if list.is_empty() {
        "write into karat.toml beside the modules:\n[join]"
    } else {
        "replace this module's line in karat.toml with:"
    };
    list.push(first.clone());
    let key = if own.contains("::") { format!("{own:?}") } else { own };
    let note = format!(
        "module `{first}` declares `{name}`{also}: write `import package::{first}::{name};`. Or, if your program concatenates \
         the two modules, {how}\n{key} = {list:?}"
    );
    let mend = Some(Mend::Elsewhere(note.clone()));
    ReflectError::Invalid(Box::new(found.note(note).mended_by(mend)))
}

/// The attributes that a function, a parameter or a member may have: attributes of WGSL (section 12), conditions, and
/// attributes of tests.
const ATTRIBUTES: [&str; 22] = [
    "align",
    "binding",
    "blend_src",
    "builtin",
    "cases",
    "compute",
    "diagnostic",
    "elif",
    "else",
    "fragment",
    "group",
    "id",
    "if",
    "interpolate",
    "invariant",
    "location",
    "must_use",
    "over",
    "size",
    "test",
    "vertex",
    "workgroup_size",
];

/// The source text at an error's location, if the error's message starts with `words`.
fn of_words(diagnostic: &Diagnostic, words: &str) -> Option<String> {
    // naga 30 shows the kind of an error only by these words.
    if !diagnostic.message.starts_with(words) {
        return None;
    }
    let span = diagnostic.location()?;
    span.file.text.get(span.range.clone()).map(str::to_owned)
}

/// The remedy for an undeclared name in capitals. Such a name is a macro, or a constant that the host program writes
/// before the shader's text.
fn macro_of(diagnostic: &Diagnostic, name: String) -> Option<Mend> {
    let span = diagnostic.location()?;
    let is_capital = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
    let is_called = span.file.text[span.range.end..].trim_start().starts_with('(');
    let mend = if is_called { Mend::Text } else { Mend::Undeclared };
    (name.len() > 1 && name.chars().all(is_capital)).then(|| mend(name))
}

/// Replaces linked names by the author's names. Replaces longer names first, because a long name may begin with a
/// shorter name.
fn demangle(linked: &Linked, text: &str) -> String {
    let is_mangled = |(name, path): &(&String, &String)| path.rsplit("::").next() != Some(name);
    let mut mangled: Vec<_> = linked.names.iter().filter(is_mangled).collect();
    mangled.sort_by_key(|(name, _)| std::cmp::Reverse(name.len()));
    mangled.into_iter().fold(text.to_owned(), |text, (name, path)| text.replace(name, path))
}
