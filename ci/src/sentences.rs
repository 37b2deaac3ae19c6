//! `cargo ci sentences`: a random sample of what people read, for a reader who has never seen it.

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
    /// Texts in the sources, of at least five words
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

/// Fewer words are a name or a part of a sentence.
const FEWEST_WORDS: usize = 5;

/// Prints as many sentences as are wanted, each with its place. The same seed gives the same ones with the same Rust.
pub(crate) fn run(from: Source, count: usize, seed: u64) -> Result<()> {
    let listed = Command::new("git").arg("ls-files").current_dir(command::root()).output()?;
    let listed = String::from_utf8(listed.stdout).context("git lists files by UTF-8")?;
    let mut all = Vec::new();
    for file in listed.lines().filter(|file| is_read(from, file)) {
        let text = std::fs::read_to_string(command::root().join(file))?;
        for (line, sentence) in sentences(from, &text) {
            let mut hasher = DefaultHasher::new();
            (seed, file, &sentence).hash(&mut hasher);
            all.push((hasher.finish(), format!("{file}:{line}: {sentence}")));
        }
    }
    all.sort();
    all.dedup();
    let mut out = std::io::stdout().lock();
    for (_, one) in all.iter().take(count) {
        writeln!(out, "{one}")?;
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

/// The sentences of a file, each with the line on which its paragraph begins.
fn sentences(from: Source, text: &str) -> Vec<(usize, String)> {
    let mut paragraphs: Vec<(usize, String)> = Vec::new();
    let (mut open, mut fenced) = (false, false);
    // Code of a module's tests prints nothing.
    let text = match from {
        Source::Messages => text.split("#[cfg(test)]\nmod ").next().unwrap_or_default(),
        Source::Docs | Source::Comments => text,
    };
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim();
        let part = match from {
            Source::Docs => Some(line),
            Source::Comments => line.strip_prefix("///").or_else(|| line.strip_prefix("//!")),
            Source::Messages => {
                let quoted = line.split('"').skip(1).step_by(2);
                paragraphs.extend(quoted.map(|part| (number, part.to_owned())));
                None
            }
        };
        let Some(part) = part.map(str::trim) else {
            (open, fenced) = (false, false);
            continue;
        };
        fenced ^= part.starts_with("```");
        let is_prose = !fenced
            && !part.starts_with("```")
            && !part.starts_with(['#', '<', '!'])
            && !part.is_empty();
        let begins = part.starts_with(['-', '|', '*'])
            || part.split_once(". ").is_some_and(|(at, _)| at.parse::<u32>().is_ok());
        if is_prose && open && !begins {
            let (_, paragraph) = paragraphs.last_mut().expect("one is open");
            paragraph.push(' ');
            paragraph.push_str(part);
        } else if is_prose {
            paragraphs.push((number, part.to_owned()));
        }
        open = is_prose;
    }
    let of = |(number, paragraph): (usize, String)| {
        let cut = paragraph.replace(". ", ".\n").replace("| ", "|\n");
        let parts: Vec<_> = cut.lines().map(|one| (number, one.trim().to_owned())).collect();
        parts
    };
    let is_one = |(_, one): &(usize, String)| one.split_whitespace().count() >= FEWEST_WORDS;
    paragraphs.into_iter().flat_map(of).filter(is_one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sentences_are_whole() {
        let of = |from, text: &str| {
            sentences(from, text).into_iter().map(|(line, one)| format!("{line} {one}")).collect()
        };
        let page = "# A head of five words here\n\nOne sentence on\ntwo lines here. And one more of six words.\n\n```sh\nno word of this is one\n```\n- An item of five words\n";
        let found: Vec<String> = of(Source::Docs, page);
        assert_eq!(
            found,
            [
                "3 One sentence on two lines here.",
                "3 And one more of six words.",
                "9 - An item of five words"
            ]
        );
        let code = "/// Adds a number to\n/// another one.\nfn f() { bail!(\"can't read a file of {x}\") } // not this line here at all\n";
        let found: Vec<String> = of(Source::Comments, code);
        assert_eq!(found, ["1 Adds a number to another one."]);
        let found: Vec<String> = of(Source::Messages, code);
        assert_eq!(found, ["3 can't read a file of {x}"]);
    }
}
