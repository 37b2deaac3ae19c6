//! Reads lines that begin with `#`: `naga_oil`'s modules, and files that include other files.
//!
//! A directive isn't WGSL. Karat replaces most directives, and the text under false conditions, by blanks. An
//! `#import` becomes an import statement of the same length. So each token keeps its position in the author's file.
//! Karat doesn't use `naga_oil` itself, because `naga_oil` composes naga's IR, renames declarations and loses the
//! author's lines.
//!
//! - `naga_oil`, for Bevy up to 0.19: `#define_import_path`, `#import a::b::{c, d as e}`, `#ifdef`, `#ifndef`,
//!   `#if A >= 3`, `#else`, `#else ifdef`, `#endif`, `#define`, `#{A}`. An include guard works as in C.
//!   `naga_oil` itself would turn a module with a guard into an empty module.
//! - Inclusion, for vello (`#import bbox`), `re_renderer` (`#import <./plane.wgsl>`) and blade (`#include
//!   "quaternion.inc.wgsl"`): an included file and the including file share one namespace.

mod ahead;
mod foreign;
mod include;
mod values;

use std::ops::Range;
use std::sync::Arc;

use super::PackageError;
use super::conditions::Inactive;
use super::feature::Features;
use super::lexer::{Kind, Token, lex};

use ahead::without_comment;
pub(super) use ahead::{asked, defined, guards, path, values};
use foreign::{template, unknown};
pub(super) use include::{Include, without_extension};

use crate::diagnostic::{SourceFile, nearest};

/// A file after Karat processed its directives.
#[derive(Clone, Debug, Default)]
pub(super) struct Directed {
    /// The text with blanks in place of directives. The remaining text keeps its positions.
    pub(super) text: String,
    pub(super) removed: Vec<Range<usize>>,
    /// The range of each placeholder, such as `#{A}`, with the value that replaces it.
    pub(super) replaced: Vec<(Range<usize>, String)>,
    pub(super) inactive: Vec<Inactive>,
    /// The files that this file includes, each with the range of the directive that names the file.
    pub(super) includes: Vec<(Include, Range<usize>)>,
    /// The offsets at which an `#import` without `;` ends.
    pub(super) ends: Vec<usize>,
    /// The path that the module declares for itself by `#define_import_path`.
    path: Option<String>,
    /// `true` if the module imports other modules by `naga_oil`'s rules.
    pub(super) composes: bool,
}

/// The directives of `naga_oil`, and of texts that include files.
const KNOWN: [&str; 9] =
    ["define", "define_import_path", "else", "endif", "if", "ifdef", "ifndef", "import", "include"];

struct Open {
    /// The range of the `#if`, `#ifdef` or `#ifndef` that opens the condition.
    at: Range<usize>,
    /// `true` if all conditions around this condition are true.
    outer: bool,
    /// `true` if the current branch of the condition, or an earlier one, is true.
    taken: bool,
    /// `true` if the current branch is true.
    holds: bool,
    shown: String,
    last: bool,
}

impl Open {
    fn is_live(&self) -> bool {
        self.outer && self.holds
    }
}

pub(super) fn concern(text: &str, tokens: &[Token]) -> bool {
    tokens.iter().any(|token| is_mark(text, token)) || template(text, tokens).is_some()
}

fn is_mark(text: &str, token: &Token) -> bool {
    token.kind == Kind::Unknown && &text[token.range()] == "#"
}

pub(super) fn read(
    file: &Arc<SourceFile>,
    features: &Features,
) -> Result<Option<Directed>, PackageError> {
    let text = &file.text;
    if !text.contains('#') && !foreign::may_be_template(text) {
        return Ok(None);
    }
    let tokens = lex(text);
    if let Some(template) = template(text, &tokens) {
        return Err(unknown(file, template, "a template's placeholder", "a template engine"));
    }
    let marks = tokens.iter().filter(|token| is_mark(text, token));
    let marks: Vec<usize> = marks.map(|token| token.range().start).collect();
    if marks.is_empty() {
        return Ok(None);
    }
    let mut reader = Reader {
        file,
        tokens: &tokens,
        features: features.clone(),
        guards: guards(text),
        bytes: text.clone().into_bytes(),
        open: Vec::new(),
        done: 0,
        found: Directed::default(),
    };
    for mark in marks {
        if mark >= reader.done {
            reader.mark(mark)?;
        }
    }
    reader.blank_dead(text.len());
    if let Some(open) = reader.open.last() {
        return Err(reader.error(open.at.clone(), "this condition has no `#endif`"));
    }
    let mut found = reader.found;
    found.removed.sort_by_key(|range| range.start);
    found.text = String::from_utf8(reader.bytes).expect("whole characters are blanked");
    Ok(Some(found))
}

struct Reader<'f> {
    file: &'f Arc<SourceFile>,
    tokens: &'f [Token],
    features: Features,
    guards: Features,
    bytes: Vec<u8>,
    open: Vec<Open>,
    /// The end of the text that the reader has processed.
    done: usize,
    found: Directed,
}

impl Reader<'_> {
    fn text(&self) -> &str {
        &self.file.text
    }

    fn error(&self, range: Range<usize>, message: &str) -> PackageError {
        super::brackets::syntax_error(self.file, range, message)
    }

    fn is_live(&self) -> bool {
        self.open.last().is_none_or(Open::is_live)
    }

    /// Replaces the bytes in a range by blanks, but keeps line ends. Code that reads tokens then doesn't see these
    /// bytes.
    fn mask(&mut self, range: Range<usize>) {
        for byte in &mut self.bytes[range] {
            if !matches!(byte, b'\n' | b'\r') {
                *byte = b' ';
            }
        }
    }

    fn blank(&mut self, range: Range<usize>) {
        self.mask(range.clone());
        if !range.is_empty() {
            self.found.removed.push(range);
        }
    }

    /// Blanks the text from `done` to `end`, if the condition around this text is false.
    fn blank_dead(&mut self, end: usize) {
        let from = self.done;
        if !self.is_live() && from < end {
            let text = &self.text()[from..end];
            let condition = self.open.last().map(|open| open.shown.clone()).unwrap_or_default();
            let tokens = lex(text);
            let word = |index: usize| tokens.get(index).map_or("", |t: &Token| &text[t.range()]);
            let (mut inactive, mut marked) = (Vec::new(), false);
            for index in 0..tokens.len() {
                marked |= word(index) == "@" && word(index + 1) == "test";
                let declares = matches!(word(index), "fn" | "struct" | "alias" | "const");
                if declares && tokens.get(index + 1).is_some_and(|t| t.kind == Kind::Word) {
                    let range =
                        from + tokens[index].range().start..from + tokens[index].range().end;
                    let (name, condition) = (word(index + 1).to_owned(), condition.clone());
                    let test = std::mem::take(&mut marked) && word(index) == "fn";
                    inactive.push(Inactive { name, condition, range, test });
                }
            }
            self.found.inactive.extend(inactive);
            self.blank(from..end);
        }
        self.done = end;
    }

    /// Checks if `naga_oil` would replace `#NAME` by a value: `NAME` is in capitals, `#NAME` doesn't begin a line, and
    /// the module has directives of `naga_oil`.
    fn is_oil(&self, word: &str, first: bool) -> bool {
        let text = self.text();
        let is_composed = text.contains("#import ") || text.contains("#define_import_path ");
        !first && is_composed && ahead::is_named(word)
    }

    /// Reads the directive or the placeholder at a `#`: `#ifdef A`, `#{A}`.
    fn mark(&mut self, at: usize) -> Result<(), PackageError> {
        let text = Arc::clone(self.file);
        let text = &text.text;
        let line_start = text[..at].rfind(['\n', '\r']).map_or(0, |end| end + 1);
        let first = text[line_start..at].trim().is_empty();
        if text[at + 1..].starts_with('{') {
            return if self.is_live() { self.braced(at) } else { Ok(()) };
        }
        let line_end = text[at..].find(['\n', '\r']).map_or(text.len(), |end| at + end);
        let line = without_comment(&text[at + 1..line_end]);
        // `# ifdef` is a directive, too.
        let blank = line.len() - line.trim_start().len();
        let length = line[blank..].find(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
        let word_end = length.map_or(line.len(), |length| blank + length);
        let (word, rest) = (&line[blank..word_end], &line[word_end..]);
        let whole = at..at + 1 + line.trim_end().len();
        if !first || !KNOWN.contains(&word) {
            if !self.is_live() {
                return Ok(());
            }
            if KNOWN.contains(&word) {
                return Err(self.error(whole, "a directive must be the first text on its line"));
            }
            // `naga_oil` also accepts a value without braces.
            if self.features.contains_key(word) || self.is_oil(word, first) {
                return self.value(at..at + 1 + word_end, word.to_owned());
            }
            let shown = &text[at..at + 1 + word_end];
            let mut error = unknown(self.file, whole, &format!("`{shown}`"), "a preprocessor");
            if let PackageError::Shader(diagnostic) = &mut error
                && !first
                && word.starts_with(|c: char| c.is_uppercase())
            {
                let value = format!(
                    "write a line `{word} = 3` below `[features]` in karat.toml to set the value"
                );
                diagnostic.notes.insert(0, value);
            }
            if let (PackageError::Shader(diagnostic), Some(near)) =
                (&mut error, nearest(word, KNOWN).filter(|_| first))
            {
                diagnostic.notes.insert(0, format!("did you mean `#{near}`?"));
            }
            return Err(error);
        }
        self.blank_dead(at);
        // `naga_oil` reads only the name, and some authors write a brace behind the name.
        let rest = rest.trim().trim_end_matches('{').trim_end();
        match word {
            "ifdef" | "ifndef" | "if" => {
                let outer = self.is_live();
                let holds = outer && self.holds(word, rest, &whole)?;
                let shown = text[whole.clone()].to_owned();
                let (at, taken) = (whole.clone(), holds);
                self.open.push(Open { at, outer, taken, holds, shown, last: false });
            }
            "else" => {
                let (word, condition) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
                let Some(open) = self.open.last() else {
                    return Err(self.error(whole, "there is no `#if` before this `#else`"));
                };
                let (outer, taken) = (open.outer, open.taken);
                if open.last {
                    return Err(self.error(whole, "this is a second `#else` for the same `#if`"));
                }
                let holds = outer
                    && !taken
                    && match word {
                        "" => true,
                        "if" | "ifdef" | "ifndef" => self.holds(word, condition.trim(), &whole)?,
                        _ => {
                            let message = "only `if`, `ifdef` or `ifndef` can follow an `#else`";
                            return Err(self.error(whole, message));
                        }
                    };
                let shown = text[whole.clone()].to_owned();
                self.open.pop();
                let taken = taken || holds;
                let (at, last) = (whole.clone(), word.is_empty());
                self.open.push(Open { at, outer, taken, holds, shown, last });
            }
            "endif" => {
                if self.open.pop().is_none() {
                    return Err(self.error(whole, "there is no `#if` before this `#endif`"));
                }
            }
            _ if !self.is_live() => return Ok(()),
            "define" => {
                // `defined` has already read this definition, unless it belongs to an include guard.
                let (name, value) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
                let value = self.parsed(value.trim(), &whole)?;
                if self.guards.contains_key(name) {
                    self.features.entry(name.to_owned()).or_insert(value);
                }
                if self.found.path.is_some() {
                    let message = "a module with `#define_import_path` can't use `#define`: move the \
                                   `#define` to the importing module";
                    return Err(self.error(whole, message));
                }
            }
            "define_import_path" => {
                let path = rest.trim_end_matches(';').trim_end();
                let is_part = |c: char| c.is_alphanumeric() || c == '_';
                if self.found.path.as_ref().is_some_and(|known| known != path) {
                    return Err(self.error(whole, "this is a second `#define_import_path`"));
                }
                if path.split("::").any(|part| part.is_empty() || !part.chars().all(is_part)) {
                    let message = "`#define_import_path` needs a path, such as `engine::math`";
                    return Err(self.error(whole, message));
                }
                self.found.path = Some(path.to_owned());
                self.found.composes = true;
            }
            "include" => {
                let named = rest.strip_prefix('"').and_then(|rest| rest.split_once('"'));
                let Some((name, _)) = named else {
                    return Err(self.error(
                        whole,
                        "an `#include` needs a file name in quotes: `#include \"a.wgsl\"`",
                    ));
                };
                self.found.includes.push((Include::File(name.to_owned()), whole.clone()));
            }
            _ => return self.import(at, word_end, &whole),
        }
        self.blank(whole.clone());
        self.done = whole.end;
        Ok(())
    }

    /// Reads an `#import`. The `#import` ends at the end of its line, or at its closing brace.
    fn import(
        &mut self,
        at: usize,
        word_end: usize,
        line: &Range<usize>,
    ) -> Result<(), PackageError> {
        let start = at + 1 + word_end;
        let rest = self.text()[start..line.end].trim().trim_end_matches(';').trim().to_owned();
        let within = |open: char, close: char| {
            rest.strip_prefix(open)?.strip_suffix(close).filter(|file| !file.contains(close))
        };
        let file = within('<', '>').or_else(|| within('"', '"'));
        let include = match file {
            Some(file) => Some(Include::File(file.to_owned())),
            None if !rest.is_empty()
                && rest.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_') =>
            {
                Some(Include::Name(rest.clone()))
            }
            None => None,
        };
        if let Some(include) = include {
            self.found.composes |= matches!(include, Include::Name(_));
            self.found.includes.push((include, line.clone()));
            self.blank(line.clone());
            self.done = line.end;
            return Ok(());
        }
        if rest.contains('"') {
            return Err(unknown(
                self.file,
                line.clone(),
                "an import by an asset's path",
                "the asset server of a game engine",
            ));
        }
        // The result is an import statement of WESL with the same length. A blank replaces `#`, and the statement ends
        // with its line or its braces. The names between the braces may have conditions of their own.
        let (mut depth, mut end, mut ended) = (0_i32, start, false);
        let first = self.tokens.partition_point(|token| token.range().start < start);
        let mut closes = false;
        for token in &self.tokens[first..] {
            let range = token.range();
            // `naga_oil` allows a missing comma behind a group.
            if closes && depth > 0 && token.kind == Kind::Word {
                self.bytes[end] = b',';
            }
            closes = token.kind == Kind::Symbol(b'}');
            if ended || depth <= 0 && self.text()[end..range.start].contains(['\n', '\r']) {
                break;
            }
            match token.kind {
                Kind::Symbol(b'{') => depth += 1,
                Kind::Symbol(b'}') => depth -= 1,
                Kind::Symbol(b';') => ended = true,
                _ => {}
            }
            end = range.end;
        }
        self.bytes[at] = b' ';
        self.found.removed.push(at..at + 1);
        self.found.composes = true;
        if !ended {
            self.found.ends.push(end);
        }
        self.done = start;
        Ok(())
    }
}
