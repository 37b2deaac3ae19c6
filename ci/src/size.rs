//! `cargo ci size`: measures the size of the harness, and the number of files that mention a verb, a path or a
//! subcommand. The command doesn't compile anything, so it can also measure older revisions.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};

use crate::command;

/// The folder whose sources the command measures, without their tests.
const HARNESS: &str = "harness";

/// Three names: `is_unit` occurs only in the code of one verb, `Api::Dx12` only in the code of one path, and
/// `unreferenced::` only in the code of one subcommand. The number of files with such a name shows how many files you
/// would change for a new verb, path or subcommand. Each entry has a title, the folder to search, and the name.
const SPREAD: [(&str, &str, &str); 3] = [
    ("files of a verb", "harness", "is_unit"),
    ("files of a path", "harness/src", "Api::Dx12"),
    ("files of a subcommand", "harness/cli", "unreferenced::"),
];

/// The number of lines above which a function is too long. With its documentation, a function of 80 lines fills about
/// one and a half screens.
const LONG: usize = 80;

/// The methods of `str` that examine a text. Code should rarely examine the text of a message, but naga, Tint, OpenEXR
/// and TOML report some errors only as text.
const READS: [&str; 8] = [
    "contains",
    "starts_with",
    "ends_with",
    "strip_prefix",
    "strip_suffix",
    "split",
    "split_once",
    "find",
];

/// Prints the measured numbers of the working tree, and beside them the numbers of a revision.
pub(crate) fn run(revision: Option<&str>) -> Result<()> {
    let now = measure(&command::root())?;
    let before = revision.map(|revision| {
        let folder = std::env::temp_dir().join(format!("karat-size-{}", std::process::id()));
        let measured = extract(revision, &folder).and_then(|()| measure(&folder));
        drop(std::fs::remove_dir_all(&folder));
        measured
    });
    let before = before.transpose()?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "{:<44}{:>9}{:>14}", "", "now", revision.unwrap_or_default())?;
    for (at, (name, number)) in now.iter().enumerate() {
        let other = before.as_ref().map_or_else(String::new, |before| before[at].1.to_string());
        writeln!(out, "{name:<44}{number:>9}{other:>14}")?;
    }
    Ok(())
}

/// Copies the harness's sources at a revision into a folder.
fn extract(revision: &str, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).context("can't make a folder for the revision's sources")?;
    let mut archive = Command::new("git")
        .args(["archive", "--format=tar", revision, HARNESS])
        .current_dir(command::root())
        .stdout(Stdio::piped())
        .spawn()
        .context("can't run git")?;
    let tar = archive.stdout.take().context("it is piped")?;
    let unpacked = Command::new("tar")
        .args(["-xf", "-", "-C"])
        .arg(folder)
        .stderr(Stdio::null())
        .stdin(tar)
        .status();
    let found = archive.wait().context("git has no status")?.success();
    ensure!(found, "git has no sources of `{revision}`: name a commit, a branch or a tag");
    ensure!(unpacked.context("can't run tar")?.success(), "tar can't unpack what git wrote");
    Ok(())
}

/// A source file without its tests.
struct Source {
    /// The path relative to the repository: `harness/src/check/plan.rs`.
    path: String,
    lines: Vec<String>,
}

fn measure(root: &Path) -> Result<Vec<(String, usize)>> {
    let mut all = Vec::new();
    sources(root, &root.join(HARNESS), &mut all)?;
    ensure!(!all.is_empty(), "there is no source below `{}`", root.join(HARNESS).display());
    let sum = |of: &dyn Fn(&Source) -> usize| all.iter().map(of).sum();
    let lines = |of: fn(&str) -> bool| {
        sum(&|source: &Source| source.lines.iter().filter(|line| of(line.trim())).count())
    };
    let mut numbers = vec![
        ("files".to_owned(), all.len()),
        ("lines of code".to_owned(), lines(is_code)),
        ("lines of doc examples".to_owned(), sum(&|source| examples(&source.lines))),
        ("public items of karat".to_owned(), {
            let own = all.iter().filter(|source| in_library(&source.path).is_some());
            own.map(|source| public_items(&source.lines)).sum()
        }),
        ("callers of Prepared::start".to_owned(), lines(|line| line.contains("prepared.start("))),
        ("places that read a message".to_owned(), lines(reads_message)),
        ("circles inside rooms of karat".to_owned(), circles(&all).len()),
        (format!("functions above {LONG} lines"), long_functions(&all).len()),
    ];
    numbers.extend(SPREAD.map(|(name, below, word)| {
        let has = |source: &&Source| {
            source.path.starts_with(below) && source.lines.iter().any(|line| line.contains(word))
        };
        (format!("{name} ({word})"), all.iter().filter(has).count())
    }));
    Ok(numbers)
}

fn sources(root: &Path, folder: &Path, found: &mut Vec<Source>) -> Result<()> {
    let unread = || format!("can't read `{}`", folder.display());
    for entry in std::fs::read_dir(folder).with_context(unread)? {
        let path = entry.with_context(unread)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if path.is_dir() && !matches!(&*name, "tests" | "examples" | "benches" | "target") {
            sources(root, &path, found)?;
        } else if name.ends_with(".rs") && name != "tests.rs" {
            let text = std::fs::read_to_string(&path).with_context(unread)?;
            let below = path.strip_prefix(root).unwrap_or(&path).display().to_string();
            found.push(Source { path: below.replace('\\', "/"), lines: without_tests(&text) });
        }
    }
    Ok(())
}

/// Returns the lines of a file before its module `tests`, which is the last item of the file.
fn without_tests(text: &str) -> Vec<String> {
    let lines: Vec<&str> = text.lines().collect();
    let begins = |pair: &[&str]| {
        let [attribute, module] = pair else { return false };
        attribute.starts_with("#[cfg(")
            && attribute.contains("test")
            && module.contains("mod tests")
    };
    let end = lines.windows(2).position(begins).unwrap_or(lines.len());
    lines[..end].iter().map(|line| (*line).to_owned()).collect()
}

fn is_code(line: &str) -> bool {
    !line.is_empty() && !line.starts_with("//")
}

/// Returns the number of lines of examples in doc comments, including the lines with the fences.
fn examples(lines: &[String]) -> usize {
    let mut inside = false;
    let is_example = |line: &&String| {
        let line = line.trim_start();
        let Some(text) = line.strip_prefix("///").or_else(|| line.strip_prefix("//!")) else {
            return false;
        };
        let is_fence = text.trim_start().starts_with("```");
        inside ^= is_fence;
        is_fence || inside
    };
    lines.iter().filter(is_example).count()
}

/// Returns the path of a source relative to `harness/src`, `harness/core/src` or `harness/inspect/src`, or `None` for
/// other sources.
fn in_library(path: &str) -> Option<&str> {
    let folders = ["harness/core/src/", "harness/src/", "harness/inspect/src/"];
    folders.iter().find_map(|folder| path.strip_prefix(folder))
}

/// Returns the number of public items that the documentation shows.
fn public_items(lines: &[String]) -> usize {
    let is_shown = |at: usize| at == 0 || lines[at - 1].trim() != "#[doc(hidden)]";
    (0..lines.len()).filter(|at| is_public(lines[*at].trim()) && is_shown(*at)).count()
}

fn is_public(line: &str) -> bool {
    let words = ["pub fn ", "pub struct ", "pub enum ", "pub trait ", "pub type ", "pub const "];
    words.iter().any(|word| line.starts_with(word))
}

/// Checks if a line examines the text of a message, such as `message.contains(..)`.
fn reads_message(line: &str) -> bool {
    line.match_indices("message").any(|(at, word)| {
        let rest = &line[at + word.len()..];
        let rest = rest.strip_prefix(".trim()").unwrap_or(rest);
        let read = |method: &&str| rest.starts_with(&format!(".{method}("));
        READS.iter().any(read)
    })
}

/// Returns each group of modules in one folder that use each other in a cycle, such as `check: sample, session`.
fn circles(all: &[Source]) -> Vec<String> {
    // `check/integral/sum.rs` belongs to the module `integral` of the room `check`.
    let mut rooms: BTreeMap<&str, BTreeMap<&str, BTreeSet<String>>> = BTreeMap::new();
    for source in all {
        let Some(below) = in_library(&source.path) else { continue };
        let parts: Vec<&str> = below.trim_end_matches(".rs").split('/').collect();
        let [room, module, ..] = *parts else { continue };
        let own = [format!("crate::{room}::"), "super::".repeat(parts.len() - 1)];
        let code = source.lines.iter().filter(|line| is_code(line.trim()));
        let text = code.map(|line| line.trim()).collect::<Vec<_>>().join(" ");
        let named = |path: &String| -> Vec<String> {
            let from_root = |at: usize| !text[..at].ends_with("::");
            let rests = text.match_indices(&**path).filter(|(at, _)| from_root(*at));
            rests.flat_map(|(at, _)| first_names(&text[at + path.len()..])).collect()
        };
        let modules = rooms.entry(room).or_default().entry(module).or_default();
        modules.extend(own.iter().flat_map(named));
    }
    let of_room = |(room, modules): (&&str, &BTreeMap<&str, BTreeSet<String>>)| {
        let reached = |from: &str| {
            let (mut seen, mut next) = (BTreeSet::new(), vec![from.to_owned()]);
            while let Some(module) = next.pop() {
                let used = modules.get(&*module).into_iter().flatten();
                next.extend(used.filter(|used| seen.insert((*used).clone())).cloned());
            }
            seen
        };
        let all: BTreeMap<&str, BTreeSet<String>> =
            modules.keys().map(|module| (*module, reached(module))).collect();
        let circle = |one: &&str| -> Vec<&str> {
            let back = |other: &&&str| all[one].contains(**other) && all[**other].contains(*one);
            all.keys().filter(back).copied().collect()
        };
        let circles: BTreeSet<Vec<&str>> = all.keys().map(circle).collect();
        let several = circles.into_iter().filter(|circle| circle.len() > 1);
        several.map(|circle| format!("{room}: {}", circle.join(", "))).collect::<Vec<_>>()
    };
    rooms.iter().flat_map(of_room).collect()
}

/// Returns the first name of a Rust path, or of each path in braces: `a` for `a::b`, `a` and `b` for `{a, b::c}`.
fn first_names(text: &str) -> Vec<String> {
    let Some(inner) = text.strip_prefix('{') else { return vec![word(text)] };
    let (mut depth, mut names, mut begins) = (0_usize, Vec::new(), true);
    for (at, c) in inner.char_indices() {
        match c {
            '}' if depth == 0 => break,
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => begins = true,
            ' ' => {}
            _ if begins => {
                names.push(word(&inner[at..]));
                begins = false;
            }
            _ => {}
        }
    }
    names
}

/// Returns the functions with more than [`LONG`] lines, each with its number of lines: `harness/src/a.rs: f, 81`.
fn long_functions(all: &[Source]) -> Vec<String> {
    let of = |source: &Source| {
        let lines = &source.lines;
        let begins = |at: &usize| {
            let line = lines[*at].trim_start();
            let words = ["pub ", "pub(crate) ", "pub(super) ", "const ", "async ", "unsafe "];
            let bare =
                words.iter().fold(line, |line, word| line.strip_prefix(word).unwrap_or(line));
            // WGSL in a format string doubles its braces.
            bare.starts_with("fn ") && !line.ends_with(['}', ';']) && !line.ends_with("{{")
        };
        let long = |at: usize| {
            // In formatted code a function ends at the indentation of its first line.
            let indent = lines[at].len() - lines[at].trim_start().len();
            let ends = |line: &String| line.trim_start() == "}" && line.len() == indent + 1;
            let count = lines[at..].iter().position(ends)? + 1;
            let name = word(lines[at].split("fn ").nth(1)?);
            (count > LONG).then(|| format!("{}: {name}, {count}", source.path))
        };
        (0..lines.len()).filter(begins).filter_map(long).collect::<Vec<_>>()
    };
    all.iter().flat_map(of).collect()
}

/// Returns the identifier at the beginning of a text.
fn word(text: &str) -> String {
    text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The largest allowed number of functions with more than [`LONG`] lines. If you add such a function, split it, or
    /// split another such function.
    const MOST_LONG: usize = 60;

    /// Returns the number of lines of code in each folder that has a budget: a folder of `harness/src`, or another
    /// package of the harness.
    fn rooms(all: &[Source]) -> BTreeMap<String, usize> {
        let mut rooms = BTreeMap::new();
        for source in all {
            let parts: Vec<&str> = source.path.trim_end_matches(".rs").split('/').collect();
            let depth = if source.path.starts_with("harness/src/") { 3 } else { 2 };
            let room = parts[..parts.len().min(depth)].join("/");
            let lines = source.lines.iter().filter(|line| is_code(line.trim())).count();
            *rooms.entry(room).or_insert(0) += lines;
        }
        rooms
    }

    fn source(path: &str, text: &str) -> Source {
        Source { path: path.to_owned(), lines: without_tests(text) }
    }

    #[test]
    fn code_comments_and_tests_are_counted_separately() {
        let text = "//! Its purpose.\n/// ```\n/// shown();\n/// ```\npub fn shown() {} // behind\n\n\
                    // aside\n#[cfg(test)]\nmod tests {\n    fn hidden() {}\n}\n";
        let lines = without_tests(text);
        assert_eq!(lines.iter().filter(|line| is_code(line.trim())).count(), 1);
        assert_eq!((examples(&lines), is_public(&lines[4])), (3, true));
        assert!(reads_message("if record.message.contains(\"x\") {"));
        assert!(reads_message("message.trim().strip_prefix(\"x\")"));
        assert!(!reads_message("let message = text.lines().next();"));
    }

    #[test]
    fn cyclic_imports_are_listed_per_folder() {
        let line =
            [source("harness/src/a/b.rs", "use super::c::C;"), source("harness/src/a/c.rs", "")];
        assert!(circles(&line).is_empty());
        let circle = [
            source("harness/src/a/b.rs", "use super::c::C;"),
            source("harness/src/a/c.rs", "use crate::a::d::D;"),
            source("harness/src/a/d.rs", "use super::b::B;"),
            source("harness/src/e/b.rs", "use super::c::C;"),
        ];
        assert_eq!(circles(&circle), ["a: b, c, d"]);
    }

    /// ARCHITECTURE.md limits the number of lines of code in each folder. If a folder needs more lines, write the new
    /// limit into ARCHITECTURE.md, and the reason into the commit's message.
    #[test]
    fn no_folder_exceeds_its_line_budget() {
        let page = std::fs::read_to_string(command::root().join("ARCHITECTURE.md")).expect("it is");
        let table = page.split_once("## Budgets").expect("it has that chapter").1;
        let table = table.split_once("\n## ").map_or(table, |(table, _)| table);
        let row = |line: &str| {
            let mut cells = line.strip_prefix("| `")?.split('|').map(str::trim);
            let room = cells.next()?.trim_end_matches('`').to_owned();
            Some((room, cells.next()?.replace(',', "").parse().ok()?))
        };
        let budgets: BTreeMap<String, usize> = table.lines().filter_map(row).collect();
        let mut all = Vec::new();
        sources(&command::root(), &command::root().join(HARNESS), &mut all).expect("it is there");
        let rooms = rooms(&all);
        let unknown: Vec<_> = rooms.keys().filter(|room| !budgets.contains_key(*room)).collect();
        assert!(unknown.is_empty(), "no budget: {unknown:?}");
        let mut wrong = Vec::new();
        for (room, most) in &budgets {
            let lines = rooms.get(room).copied().unwrap_or_default();
            if lines > *most || 2 * lines <= *most {
                wrong.push(format!("`{room}` has {lines} lines of code, and its budget is {most}"));
            }
        }
        assert!(wrong.is_empty(), "{}", wrong.join("\n"));
        let long = long_functions(&all);
        assert!(long.len() <= MOST_LONG, "{} are long: {}", long.len(), long.join("\n"));
    }

    #[test]
    fn long_functions_and_names_in_braces_are_seen() {
        let body = "    f();\n".repeat(LONG - 1);
        let text = format!("fn short() {{\n}}\npub fn long<T>() {{\n{body}}}\n");
        let found = long_functions(&[source("harness/src/a.rs", &text)]);
        assert_eq!(found, ["harness/src/a.rs: long, 81"]);
        assert_eq!(first_names("{a, b::{c, d}, e as f};"), ["a", "b", "e"]);
        let all = [
            source("harness/src/a/b.rs", "use super::{\n    c::C, d};"),
            source("harness/src/a/c.rs", "use crate::a::{b};"),
        ];
        assert_eq!(circles(&all), ["a: b, c"]);
    }

    #[test]
    fn no_modules_import_each_other_cyclically() {
        let mut all = Vec::new();
        sources(&command::root(), &command::root().join(HARNESS), &mut all).expect("it is there");
        assert_eq!(circles(&all), [""; 0]);
    }

    #[test]
    fn sizes_of_this_repository_are_measured() {
        let numbers = measure(&command::root()).expect("it has sources");
        let of =
            |name: &str| numbers.iter().find(|(own, _)| own.starts_with(name)).map(|one| one.1);
        assert!(
            of("lines of code") > Some(10_000) && of("public items") > Some(100),
            "{numbers:?}"
        );
        assert!(
            numbers.iter().all(|(name, number)| *number > 0
                || name.contains("circles")
                || name.contains("message")),
            "{numbers:?}"
        );
    }
}
