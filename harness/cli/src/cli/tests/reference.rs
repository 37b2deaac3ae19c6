//! The pages of `docs/reference`. Karat generates the pages from the code, and a test compares them with the files.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use clap::CommandFactory;
use karat::unstable::settings::variables;

/// A table of keys: the headline, the source file, and the structure with the keys.
type Keys = (&'static str, &'static str, &'static str);

const TESTS: [Keys; 7] = [
    ("`[[test]]`: a function", "suite/src/declared.rs", "Declared"),
    ("`integral` of a `[[test]]`", "suite/src/declared.rs", "Integral"),
    ("`[[compute]]`: passes", "suite/src/compute.rs", "Declared"),
    ("`passes` of a `[[compute]]`", "suite/src/compute.rs", "Pass"),
    ("`after` of a `[[compute]]`, for each resource", "suite/src/compute.rs", "Expected"),
    ("`[[frame]]`: a frame", "suite/src/declared.rs", "Frame"),
    ("`draws` of a `[[frame]]`", "suite/src/draws.rs", "Declared"),
];

const PACKAGES: [Keys; 7] = [
    ("`karat.toml`, beside the shaders", "src/package/manifest.rs", "Written"),
    ("`[dependencies]`", "src/package/manifest.rs", "Dependency"),
    ("`[compilers]`", "src/package/compilers.rs", "Written"),
    ("`[[hazard]]`", "src/package/accepted.rs", "AcceptedHazard"),
    ("`[[mutant]]`", "src/package/accepted.rs", "AcceptedMutants"),
    ("`[[matrix]]`", "src/package/accepted.rs", "KnownRows"),
    ("`[package.metadata.karat]` in `Cargo.toml`", "cli/src/cli/project.rs", "Settings"),
];

const RECORDS: [Keys; 8] = [
    ("A record", "src/record.rs", "Record"),
    ("`paths`, of each path", "src/record.rs", "PathRecord"),
    ("`details` of a failure", "src/record/details.rs", "Details"),
    ("`details.paths`, of each path", "src/record/details.rs", "PathDetails"),
    ("`worst`, `first`, `simplest` of a path: a case", "src/record/details.rs", "CaseDetails"),
    ("`watched` of passes", "src/dispatch/violation.rs", "Watched"),
    ("`read`, of each file", "core/src/diagnostic.rs", "FileRead"),
    ("The time", "src/record.rs", "Time"),
];

/// A key and the sentence that describes it.
type Key = (String, String);

/// Returns the keys of a structure in order. A key without a sentence is an error.
fn keys(source: &str, structure: &str) -> Result<Vec<Key>, String> {
    let head = format!("struct {structure} {{\n");
    let (_, rest) = source.split_once(&head).ok_or(format!("no `{structure}`"))?;
    let (body, _) = rest.split_once("\n}").ok_or("it has no end")?;
    let (mut keys, mut sentence, mut renamed, mut is_skipped) =
        (Vec::new(), String::new(), None, false);
    for line in body.lines().map(str::trim) {
        if let Some(part) = line.strip_prefix("///") {
            sentence.push_str(part);
        } else if line.starts_with("#[serde(") {
            is_skipped |= line.contains("(skip)") || line.contains("flatten");
            let quoted = line.split_once("rename = \"").and_then(|(_, rest)| rest.split_once('"'));
            renamed = quoted.map(|(name, _)| name.to_owned());
        } else if let Some((name, _)) = line.split_once(": ") {
            let name = name.rsplit(' ').next().unwrap_or_default().to_owned();
            let (key, told) = (renamed.take().unwrap_or(name), std::mem::take(&mut sentence));
            if told.is_empty() && !is_skipped {
                return Err(format!("`{key}` of `{structure}` has no sentence"));
            }
            if !std::mem::take(&mut is_skipped) {
                keys.push((key, without_links(told.trim())));
            }
        }
    }
    if keys.is_empty() { Err(format!("`{structure}` has no key")) } else { Ok(keys) }
}

/// Returns a sentence without rustdoc links.
fn without_links(sentence: &str) -> String {
    let mut told = String::new();
    for part in sentence.split_inclusive(']') {
        match part.split_once('[') {
            Some((before, link)) if link.starts_with('`') && link.ends_with("`]") => {
                told.push_str(before);
                told.push_str(&link[..link.len() - 1]);
            }
            _ => told.push_str(part),
        }
    }
    told
}

fn table(page: &mut String, [left, right]: [&str; 2], rows: &[Key]) {
    let _ = writeln!(page, "\n| {left} | {right} |\n|---|---|");
    for (key, sentence) in rows {
        let _ =
            writeln!(page, "| `{}` | {} |", key.replace('|', "\\|"), sentence.replace('|', "\\|"));
    }
}

const WRITTEN: &str =
    "Written from the code: `WRITE=1 cargo test --workspace --bin karat reference`.";

fn page_of_keys(title: &str, begins: &str, all: &[Keys]) -> String {
    let mut page = format!("# {title}\n\n<!-- {WRITTEN} -->\n\n{begins}\n");
    for (head, file, structure) in all {
        let _ = writeln!(page, "\n## {head}");
        let source = std::fs::read_to_string(harness().join(file)).expect("it is a source");
        table(&mut page, ["key", "meaning"], &keys(&source, structure).expect("documented"));
    }
    page
}

fn page_of_commands() -> String {
    let mut page = format!(
        "# Commands\n\n<!-- {WRITTEN} -->\n\n`karat help COMMAND` says the same with examples. In a Cargo project `cargo karat` is the same program.\n"
    );
    let mut karat = crate::cli::Cli::command();
    karat.build();
    for command in karat.get_subcommands().filter(|one| !one.is_hide_set()) {
        if command.get_name() == "help" {
            continue;
        }
        let about = command.get_about().map(ToString::to_string).unwrap_or_default();
        let words = command.get_positionals().filter(|one| !one.is_hide_set());
        let words: String = words.map(|one| format!(" {one}")).collect();
        let _ = writeln!(page, "\n## `karat {}{words}`\n\n{about}.", command.get_name());
        let said = |one: &clap::Arg| {
            let help = one.get_help().map(ToString::to_string).unwrap_or_default();
            let (defaults, values) = (one.get_default_values(), one.get_possible_values());
            let values: Vec<_> = values.iter().map(|one| one.get_name().to_owned()).collect();
            let is_switch = !one.get_action().takes_values();
            let defaults: Vec<_> = defaults.iter().map(|one| one.to_string_lossy()).collect();
            let mut help = help.replace('\n', " ");
            if !is_switch && !values.is_empty() {
                let _ = write!(help, ": {}", values.join(", "));
            }
            // Some help texts name their default in words: "any free port" is 0.
            if !is_switch && !defaults.is_empty() && !help.contains("[default") {
                let _ = write!(help, " [default: {}]", defaults.join(" "));
            }
            help
        };
        let rows: Vec<Key> = command
            .get_arguments()
            .filter(|one| !one.is_hide_set() && one.get_id() != "help" && one.get_id() != "version")
            .map(|one| (one.to_string().replace("...", ""), said(one)))
            .collect();
        if !rows.is_empty() {
            table(&mut page, ["argument", "meaning"], &rows);
        }
    }
    page
}

fn page_of_settings() -> String {
    let mut page = format!(
        "# Settings\n\n<!-- {WRITTEN} -->\n\nEnvironment variables, each with its default in brackets. A name that begins with `KARAT_` and isn't here is an error.\n"
    );
    let rows: Vec<Key> =
        variables().iter().map(|one| (one.name.to_owned(), one.about.to_owned())).collect();
    table(&mut page, ["variable", "meaning"], &rows);
    page
}

fn harness() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("a folder").to_owned()
}

// Lesson 211
#[test]
fn reference_pages_match_the_code() {
    // A published package doesn't contain the pages.
    if Path::new(env!("CARGO_MANIFEST_DIR")).join(".cargo_vcs_info.json").exists() {
        return;
    }
    let pages: BTreeMap<&str, String> = [
        ("commands.md", page_of_commands()),
        ("settings.md", page_of_settings()),
        (
            "tests.md",
            page_of_keys("Keys of `*.test.toml`", "Examples: [tests without Rust](../tests-without-rust.md).", &TESTS),
        ),
        (
            "packages.md",
            page_of_keys("Keys of `karat.toml`", "Examples: [packages and dialects](../guide/packages.md).", &PACKAGES),
        ),
        (
            "records.md",
            page_of_keys(
                "Records",
                "Each verdict is a line of JSON below `.karat/run/record` or `target/karat/record`; `karat report --json` prints all.",
                &RECORDS,
            ),
        ),
    ]
    .into();
    let folder = harness().join("../docs/reference");
    for (name, page) in pages {
        let file = folder.join(name);
        if std::env::var_os("WRITE").is_some() {
            std::fs::create_dir_all(&folder).expect("a folder");
            std::fs::write(&file, &page).expect("it can be written");
        }
        let there = std::fs::read_to_string(&file).unwrap_or_default();
        assert!(there == page, "docs/reference/{name} is old. {WRITTEN}");
    }
}

#[test]
fn a_key_without_a_sentence_is_an_error() {
    let source = "struct A {\n    /// It is [`B`] here.\n    #[serde(rename = \"b\")]\n    pub(crate) a: u32,\n    #[serde(skip)]\n    c: u32,\n}\nstruct B {\n    a: u32,\n}\n";
    assert_eq!(keys(source, "A"), Ok(vec![("b".to_owned(), "It is `B` here.".to_owned())]));
    assert!(keys(source, "B").is_err() && keys(source, "C").is_err());
}
