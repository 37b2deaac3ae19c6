//! From linked text back to the author's file, line and column.
//!
//! The linker prints declarations anew: comments and attributes of conditional translation are
//! gone and imported names are mangled. The two texts still share their tokens, so each linked
//! declaration is aligned with its original token by token, and a span in linked text becomes the
//! span of the original tokens.

use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

use similar::{Algorithm, DiffOp};
use wgsl_parse::lexer::Lexer;

use crate::diagnostic::{SourceFile, Span};

/// Aligned tokens of all declarations of a linked text, in its order.
#[derive(Clone, Debug, Default)]
pub(crate) struct SourceMap {
    segments: Vec<Segment>,
}

#[derive(Clone, Debug)]
struct Segment {
    linked: Range<usize>,
    file: Arc<SourceFile>,
    original: Range<usize>,
}

struct Lexeme<'a> {
    range: Range<usize>,
    /// What is compared: mangled names are compared by the author's name for them.
    text: Cow<'a, str>,
}

impl SourceMap {
    /// Aligns a declaration, `printed` at offset `at` of the linked text, with the author's
    /// `original` range.
    ///
    /// `unmangle` gives the author's name of a mangled identifier.
    pub(crate) fn align(
        &mut self,
        printed: &str,
        at: usize,
        file: &Arc<SourceFile>,
        original: Range<usize>,
        unmangle: &dyn Fn(&str) -> Option<String>,
    ) {
        let new = lexemes(printed, at, unmangle);
        let source = file.text.get(original.clone()).unwrap_or_default();
        let old = lexemes(source, original.start, &|_| None);
        let words =
            |lexemes: &[Lexeme<'_>]| lexemes.iter().map(|l| l.text.to_string()).collect::<Vec<_>>();
        let (old_words, new_words) = (words(&old), words(&new));
        let mut push = |lexeme: &Lexeme<'_>, original: Range<usize>| {
            let linked = lexeme.range.clone();
            self.segments.push(Segment { linked, file: Arc::clone(file), original });
        };
        for op in similar::capture_diff_slices(Algorithm::Myers, &old_words, &new_words) {
            match op {
                DiffOp::Equal { old_index, new_index, len } => {
                    for step in 0..len {
                        push(&new[new_index + step], old[old_index + step].range.clone());
                    }
                }
                // Tokens that the linker wrote itself stand for what they replaced or, if there
                // is nothing, for the token that follows.
                DiffOp::Insert { old_index, new_index, new_len }
                | DiffOp::Replace { old_index, new_index, new_len, .. } => {
                    for step in 0..new_len {
                        let place = old.get(old_index + step).or(old.get(old_index)).or(old.last());
                        let range = place.map_or(original.clone(), |lexeme| lexeme.range.clone());
                        push(&new[new_index + step], range);
                    }
                }
                DiffOp::Delete { .. } => {}
            }
        }
    }

    /// The author's span for a range of linked text; `None` outside all declarations.
    pub(crate) fn resolve(&self, linked: Range<usize>) -> Option<Span> {
        let after = |offset: usize| self.segments.partition_point(|s| s.linked.end <= offset);
        let first = self.segments.get(after(linked.start))?;
        if first.linked.start >= linked.end.max(linked.start + 1) {
            return None;
        }
        let last = linked.end.checked_sub(1).and_then(|end| {
            let index = after(end);
            let inside = self.segments.get(index).filter(|s| s.linked.start <= end);
            inside.or_else(|| self.segments.get(index.checked_sub(1)?))
        });
        let end = last
            .filter(|last| {
                Arc::ptr_eq(&last.file, &first.file) && last.original.end >= first.original.end
            })
            .map_or(first.original.end, |last| last.original.end);
        Some(Span { file: Arc::clone(&first.file), range: first.original.start..end })
    }
}

fn lexemes<'a>(
    text: &'a str,
    base: usize,
    unmangle: &dyn Fn(&str) -> Option<String>,
) -> Vec<Lexeme<'a>> {
    Lexer::new(text)
        .map_while(Result::ok)
        .map(|(start, _, end)| {
            let word = &text[start..end];
            let text = unmangle(word).map_or(Cow::Borrowed(word), Cow::Owned);
            Lexeme { range: base + start..base + end, text }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_survive_printing_renaming_and_dropped_branches() {
        let original = "// comment\nfn f(x: f32) -> f32 {\n  @if(fast) return 0.0;\n  \
                        return scale( x ) + y;\n}";
        let linked = "fn f(x: f32) -> f32 { return package_math_scale(x) + y; }";
        let file = Arc::new(SourceFile { name: "f.wgsl".into(), text: original.into() });
        let mut map = SourceMap::default();
        let unmangle = |name: &str| (name == "package_math_scale").then(|| "scale".to_owned());
        map.align(linked, 0, &file, 11..original.len(), &unmangle);
        let resolve = |word: &str| {
            let start = linked.find(word).expect("in linked text");
            let span = map.resolve(start..start + word.len()).expect("mapped");
            original[span.range].to_owned()
        };
        assert_eq!(resolve("package_math_scale(x) + y"), "scale( x ) + y");
        assert_eq!(resolve("y;"), "y;");
        assert_eq!(resolve("return"), "return");
        assert_eq!(map.resolve(0..4).map(|s| s.to_string()), Some("f.wgsl:2:1".into()));
        let start = linked.find("return").expect("in linked text");
        let span = map.resolve(start..start + 6).expect("mapped");
        assert_eq!(span.to_string(), "f.wgsl:4:3", "the return of the kept branch");
        assert_eq!(map.resolve(linked.len()..linked.len() + 5), None);
    }
}
