//! `cargo ci sentences`: prints a random sample of sentences for a reader who has never seen Karat.

use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};
use std::io::Write;
use std::process::Command;

use anyhow::{Context, Result};
use clap::ValueEnum;

use crate::command;

/// Where sentences come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Source {
    /// The README and the pages below `docs` that people write
    Docs,
    /// Documentation comments
    Comments,
    /// Messages, help and other texts that the harness shows to users
    Messages,
}

/// Pages that commands write.
const WRITTEN: [&str; 5] = [
    "docs/corpus",
    "docs/divergences",
    "docs/reference",
    "docs/swiftshader.md",
    "docs/translations.md",
];

/// The fewest words of a sentence. A shorter text is usually a name or a part of a sentence.
const FEWEST_WORDS: usize = 5;

/// The code that stands directly before a string literal for developers. Users don't see such a literal.
const UNSEEN: [&str; 4] = ["expect(", "expect_err(", "unreachable!(", "reason ="];

/// The beginnings of string literals that contain WGSL or Rust code, not sentences.
const CODE_BEGINS: [&str; 10] =
    ["@", "#[", "[", "fn ", "struct ", "import ", "enable ", "var<", "let ", "const "];
const CODE_ENDS: [&str; 3] = [";", "{{", "}}"];

/// The pieces of Rust code with which a test module begins.
const TEST_MODULES: [&str; 3] =
    ["#[cfg(test)]\nmod ", "#[cfg(test)]\npub(super) mod ", "#[cfg(all(test,"];

/// A sentence with its place and context.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
struct Sentence {
    /// The line on which the sentence's paragraph begins.
    line: usize,
    /// The context of the sentence: for a page, the heading above the sentence; for a message, the code before the
    /// string literal; for a comment, the first line of the enclosing block and the documented code.
    about: String,
    /// The previous sentence of the same paragraph or table row.
    before: String,
    text: String,
}

/// Prints `count` sentences, each with its file and line and with the sentence before it. The same seed gives the same
/// sentences, as long as the texts and the version of Rust are the same.
pub(crate) fn run(from: Source, count: usize, seed: u64) -> Result<()> {
    let listed = Command::new("git").arg("ls-files").current_dir(command::root()).output()?;
    let listed = String::from_utf8(listed.stdout).context("git lists files by UTF-8")?;
    let mut all = Vec::new();
    for file in listed.lines().filter(|file| is_read(from, file)) {
        let text = std::fs::read_to_string(command::root().join(file))?;
        for sentence in sentences(from, &text) {
            let mut hasher = DefaultHasher::new();
            (seed, file, &sentence.text).hash(&mut hasher);
            all.push((hasher.finish(), file, sentence));
        }
    }
    all.sort();
    // A sentence that a file repeats counts once.
    all.dedup_by_key(|(hash, ..)| *hash);
    let mut out = std::io::stdout().lock();
    for (_, file, Sentence { line, about, before, text }) in all.iter().take(count) {
        writeln!(out, "{file}:{line}: {about}")?;
        if !before.is_empty() {
            writeln!(out, "    ({before})")?;
        }
        writeln!(out, "    {text}")?;
    }
    writeln!(out, "{} of {} sentences, seed {seed}", count.min(all.len()), all.len())?;
    Ok(())
}

fn is_read(from: Source, file: &str) -> bool {
    let is_test = file.contains("/tests/") || file.ends_with("tests.rs");
    match from {
        Source::Docs => {
            let is_page = file == "README.md" || file.starts_with("docs/");
            let is_written = WRITTEN.iter().any(|written| file.starts_with(written));
            file.ends_with(".md") && is_page && !is_written && file != "docs/SUMMARY.md"
        }
        Source::Comments => file.ends_with(".rs"),
        Source::Messages => file.ends_with(".rs") && file.starts_with("harness/") && !is_test,
    }
}

fn sentences(from: Source, text: &str) -> Vec<Sentence> {
    let paragraphs = match from {
        // The code of test modules has no messages that users see.
        Source::Messages => {
            let tests = TEST_MODULES.iter().filter_map(|begin| text.find(begin)).min();
            literals(&text[..tests.unwrap_or(text.len())])
        }
        Source::Docs | Source::Comments => paragraphs(from, text),
    };
    paragraphs.into_iter().flat_map(cut).collect()
}

/// A paragraph: the number of its first line, its context (see [`Sentence::about`]), and its text.
type Paragraph = (usize, String, String);

fn paragraphs(from: Source, text: &str) -> Vec<Paragraph> {
    let mut found: Vec<Paragraph> = Vec::new();
    let (mut open, mut fenced, mut heading) = (false, false, String::new());
    let (mut undocumented, mut blocks) = (0, Vec::<(usize, &str)>::new());
    for (number, line) in (1..).zip(text.lines()) {
        let indent = line.len() - line.trim_start().len();
        let line = line.trim();
        let part = match from {
            Source::Comments => line.strip_prefix("///").or_else(|| line.strip_prefix("//!")),
            Source::Docs | Source::Messages => Some(line),
        };
        let Some(part) = part.map(str::trim) else {
            (open, fenced) = (false, false);
            if !line.starts_with("#[") && !line.starts_with("//") && !line.is_empty() {
                blocks.retain(|(outer, _)| *outer < indent);
                let around =
                    blocks.last().map(|(_, block)| format!("{block} ")).unwrap_or_default();
                for (_, about, _) in &mut found[undocumented..] {
                    *about = format!("{around}{line}");
                }
                undocumented = found.len();
                if line.ends_with('{') {
                    blocks.push((indent, line));
                }
            }
            continue;
        };
        if line.starts_with("//!") {
            "the whole file".clone_into(&mut heading);
        }
        fenced ^= part.starts_with("```");
        if part.starts_with('#') && !fenced {
            heading = part.trim_start_matches('#').trim().to_owned();
        }
        let is_prose = !fenced
            && !part.starts_with("```")
            && !part.starts_with(['#', '<', '!'])
            && !part.is_empty();
        let begins = part.starts_with(['-', '|', '*'])
            || part.split_once(". ").is_some_and(|(at, _)| at.parse::<u32>().is_ok());
        if is_prose && open && !begins {
            let (.., paragraph) = found.last_mut().expect("one is open");
            paragraph.push(' ');
            paragraph.push_str(part);
        } else if is_prose {
            found.push((number, heading.clone(), part.to_owned()));
        }
        if line.starts_with("//!") {
            undocumented = found.len();
        }
        open = is_prose;
    }
    found
}

/// Finds the messages for users in Rust code, and returns these string literals without their line breaks. Leaves out
/// shaders (raw strings), generated code, and messages for developers (`expect`, `unreachable!`). Scans the text
/// instead of using a crate that parses Rust, because the package `ci` should stay small.
fn literals(text: &str) -> Vec<Paragraph> {
    let (mut found, mut rest, mut line) = (Vec::new(), text, 1);
    while let Some(first) = rest.chars().next() {
        let raw = rest.strip_prefix("r\"").map(|body| (body, "\""));
        let raw = raw.or_else(|| rest.strip_prefix("r#\"").map(|body| (body, "\"#")));
        let length = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("'\"'") {
            3
        } else if let Some((body, end)) = raw {
            rest.len() - body.len() + body.find(end).map_or(body.len(), |at| at + end.len())
        } else if first == '"' {
            let mut escaped = false;
            let end = rest[1..].find(|c| {
                let is_end = c == '"' && !escaped;
                escaped = c == '\\' && !escaped;
                is_end
            });
            let end = end.map_or(rest.len(), |at| at + 2);
            let words = rest[1..end - 1].replace("\\\n", "").replace("\\n", " ");
            let words: Vec<_> = words.split_whitespace().collect();
            let code = text[..text.len() - rest.len()].trim_end();
            let about = code.lines().last().unwrap_or_default().trim();
            let words = words.join(" ");
            let is_code = CODE_BEGINS.iter().any(|begin| words.starts_with(begin))
                || CODE_ENDS.iter().any(|end| words.ends_with(end));
            if !is_code && !UNSEEN.iter().any(|before| about.ends_with(before)) {
                found.push((line, about.to_owned(), words));
            }
            end
        } else {
            first.len_utf8()
        };
        line += rest[..length].matches('\n').count();
        rest = &rest[length..];
    }
    found
}

/// Cuts a paragraph into sentences: between the cells of a table, and after each full stop before a capital letter or
/// code.
fn cut((line, about, paragraph): Paragraph) -> Vec<Sentence> {
    let mut marked = match paragraph.starts_with('|') {
        true => paragraph.replace("| ", "|\n"),
        false => paragraph,
    };
    for first in ('A'..='Z').chain(['`', '*', '[', '"']) {
        marked = marked.replace(&format!(". {first}"), &format!(".\n{first}"));
    }
    let (mut before, mut found) = (String::new(), Vec::new());
    for text in marked.lines().map(|one| one.trim().to_owned()) {
        if text.split_whitespace().count() >= FEWEST_WORDS {
            let (about, before) = (about.clone(), before.clone());
            found.push(Sentence { line, about, before, text: text.clone() });
        }
        before = text;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(from: Source, text: &str) -> Vec<String> {
        let show =
            |Sentence { line, about, before, text }| format!("{line} [{about}] ({before}) {text}");
        sentences(from, text).into_iter().map(show).collect()
    }

    #[test]
    fn sentences_of_pages_and_code_are_found_complete() {
        let page = "# A head of five words here\n\nOne sentence on\ntwo lines, by eq. 7 of a page. And one more of six words.\n\n```sh\nno word of this is one\n```\n- An item of five words\n";
        assert_eq!(
            found(Source::Docs, page),
            [
                "3 [A head of five words here] () One sentence on two lines, by eq. 7 of a page.",
                "3 [A head of five words here] (One sentence on two lines, by eq. 7 of a page.) And one more of six words.",
                "9 [A head of five words here] () - An item of five words"
            ]
        );
        let code = "//! A file of many words here.\nimpl A {\n    /// Says its name and no more.\n    // Lesson 1\n    fn name() {}\n}\n/// Adds a number to\n/// another one.\n#[must_use]\nfn f() { bail!(\"can't read a \\\n    file of {x}\") } // not this line here at all\nlet quote = '\"'; \"a message after a quotation mark\"; x.expect(\"a text that no user sees\"); f(\"fn f(x: f32) -> f32 {{ return x; }}\")";
        assert_eq!(
            found(Source::Comments, code),
            [
                "1 [the whole file] () A file of many words here.",
                "3 [impl A { fn name() {}] () Says its name and no more.",
                r#"7 [fn f() { bail!("can't read a \] () Adds a number to another one."#
            ]
        );
        assert_eq!(
            found(Source::Messages, code),
            [
                "10 [fn f() { bail!(] () can't read a file of {x}",
                "12 [let quote = '\"';] () a message after a quotation mark"
            ]
        );
    }
}
