//! Follows `docs/guide/tutorial.md`: writes its files, runs its commands, and compares their output with the page.

use super::*;

const PAGE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/guide/tutorial.md");

/// A part of the page that the test uses.
enum Step<'p> {
    Section(&'p str),
    Block {
        language: &'p str,
        text: &'p str,
        /// The line above the block. This line is empty if another block is directly above.
        above: &'p str,
    },
}

fn steps(page: &str) -> Vec<Step<'_>> {
    let mut steps = Vec::new();
    let (mut above, mut rest) = ("", page);
    while let Some((line, after)) = rest.split_once('\n') {
        rest = after;
        if let Some(language) = line.strip_prefix("```") {
            let (text, after) = rest.split_once("```\n").expect("a block ends");
            steps.push(Step::Block { language, text, above });
            (above, rest) = ("", after);
        } else if let Some(section) = line.strip_prefix("## ") {
            steps.push(Step::Section(section));
        } else if !line.trim().is_empty() {
            above = line;
        }
    }
    steps
}

/// The file that a line tells the reader to write. Such a line ends with the file's name in backticks and a colon.
fn written(line: &str) -> Option<&str> {
    line.strip_suffix("`:")?.rsplit_once('`').map(|(_, file)| file)
}

/// The file that a line tells the reader to edit. Such a line ends with the file's name in backticks and `, replace`.
fn changed(line: &str) -> Option<&str> {
    line.strip_suffix("`, replace")?.rsplit_once("In `").map(|(_, file)| file)
}

/// Returns the first part of `block` that is missing in `text`. A line `...` separates the parts of a block. The text
/// must contain the lines of each part without other lines between them.
fn missing(block: &str, text: &str) -> Option<String> {
    let lines: Vec<&str> = block.lines().collect();
    let text: Vec<&str> = text.lines().collect();
    let mut rest = &text[..];
    for part in lines.split(|line| *line == "...").filter(|part| !part.is_empty()) {
        let is_here = |at: &[&str]| at.iter().zip(part).all(|(there, line)| there.contains(line));
        let Some(at) = rest.windows(part.len()).position(is_here) else {
            return Some(part.join("\n"));
        };
        rest = &rest[at + part.len()..];
    }
    None
}

/// Runs a command of the page, and returns its output. `None` if the line isn't a command of Karat.
fn run(folder: &FilePath, line: &str, paths: &str) -> Option<String> {
    let (line, comment) = line.split_once("  #").unwrap_or((line, ""));
    let words = shell_words::split(line).expect("a line for a shell");
    let mut words: Vec<&str> = words.iter().map(String::as_str).collect();
    if words.first() != Some(&"karat") {
        return None;
    }
    // The page describes machines with a GPU.
    if words[1] == "accept" {
        words.push("--any-adapter");
    }
    let ran = output(command(folder, &words[1..]).env("KARAT_PATHS", paths));
    assert_eq!(ran.code, Some(i32::from(comment.trim() == "fails")), "`{line}`: {ran:?}");
    Some(ran.out + &ran.err)
}

/// The commands of the first sections run on Karat's engine. From the section about frames on, all commands run on
/// Vulkan.
// Lesson 137
// Lesson 211
#[test]
fn the_tutorial_does_what_it_shows() {
    let page = std::fs::read_to_string(PAGE).expect("the page").replace("\r\n", "\n");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let folder = folder.path();
    let (mut files, mut commands, mut paths) = (0, 0, "cpu");
    let mut printed = String::new();
    let mut replaced = None;
    for step in steps(&page) {
        let (language, text, above) = match step {
            Step::Block { language, text, above } => (language, text, above),
            Step::Section(section) => {
                if section.contains("frame") {
                    paths = "vulkan";
                }
                continue;
            }
        };
        match language {
            "sh" => {
                let ran: Vec<String> =
                    text.lines().filter_map(|line| run(folder, line, paths)).collect();
                commands += ran.len();
                printed = ran.concat();
            }
            "text" => {
                assert_eq!(above, "", "no command is directly above:\n{text}");
                let missing = missing(text, &printed);
                assert!(missing.is_none(), "no `{}` in:\n{printed}", missing.unwrap_or_default());
            }
            _ if above == "by" => {
                let (file, old): (&str, &str) = replaced.take().expect("a block to replace");
                let now = std::fs::read_to_string(folder.join(file)).expect(file);
                assert_eq!(now.matches(old).count(), 1, "{file} has it once:\n{old}\n{now}");
                write(folder, file, &now.replace(old, text));
            }
            _ => match (written(above), changed(above)) {
                (Some(file), _) => {
                    write(folder, file, text);
                    files += 1;
                }
                (None, Some(file)) => replaced = Some((file, text)),
                (None, None) => panic!("`{above}` doesn't say where this stands:\n{text}"),
            },
        }
    }
    assert!(replaced.is_none(), "a block is replaced by nothing");
    assert_eq!((files, commands), (8, 16), "the walk sees less of the page than it has, or more");
}

#[test]
fn lines_that_a_page_shows_are_looked_for_in_order() {
    let text = "one 1 s\ntwo\nthree\n";
    for (block, lacks) in [
        ("one\n...\nthree\n", None),
        ("...\ntwo\nthree\n...\n", None),
        ("one\nthree\n", Some("one\nthree")),
        ("two\n...\none\n", Some("one")),
        ("four\n", Some("four")),
    ] {
        assert_eq!(missing(block, text).as_deref(), lacks, "{block}");
    }
}
