//! `shaders/README.md` lists the function, test and frame for each part of the sources. These tests read the page. They
//! fail if the page has a name that doesn't exist, or if it leaves out a module, a frame or a numbered mistake of the
//! source documents.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use shaders::PBR;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Module,
    Function,
    Test,
    Frame,
    Mistake,
}

impl Kind {
    fn noun(self) -> &'static str {
        match self {
            Self::Module => "module",
            Self::Function => "function",
            Self::Test => "test",
            Self::Frame => "frame",
            Self::Mistake => "mistake",
        }
    }
}

enum Column {
    Prose,
    /// Each cell has any number of names of this kind.
    Names(Kind),
    /// The columns of this kind together list each module, frame or mistake exactly once.
    List(Kind),
}

impl Column {
    /// The column with this header. `None` means a misspelt header, which would hide its column from the tests.
    fn of(header: &str) -> Option<Self> {
        Some(match header {
            "item"
            | "what it says"
            | "what it holds"
            | "what it shows"
            | "as the source has it"
            | "what is right"
            | "what it produces" => Self::Prose,
            "function" | "as written" | "drawn by" => Self::Names(Kind::Function),
            "test" | "caught by" => Self::Names(Kind::Test),
            "golden" => Self::Names(Kind::Frame),
            "module" => Self::List(Kind::Module),
            "frame" => Self::List(Kind::Frame),
            "id" => Self::List(Kind::Mistake),
            _ => return None,
        })
    }
}

type Known = BTreeMap<Kind, BTreeSet<String>>;

/// Names of all modules, functions, tests and frames of the library, and the numbers of the source documents' mistakes.
fn known() -> Known {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the tests are in a folder");
    let mut tests = BTreeSet::new();
    // The paths of the library's tests begin in `tests/`. The paths of other tests begin in the repository.
    for (folder, prefix) in [
        ("tests", ""),
        ("shaders", "shaders/"),
        ("harness/core/src", "harness/core/src/"),
        ("harness/src", "harness/src/"),
    ] {
        find_tests(&root.join(folder), prefix, &mut tests);
    }
    let functions = PBR.functions().expect("the library is readable");
    let mistakes = (3..=20).map(|i| format!("E{i}"));
    Known::from([
        (Kind::Module, PBR.modules().expect("the library is readable").into_iter().collect()),
        (Kind::Function, functions.into_iter().map(|function| function.name).collect()),
        (Kind::Test, tests),
        (Kind::Frame, frames::FRAMES.map(|(name, _)| name.to_owned()).into()),
        (Kind::Mistake, mistakes.chain([1, 2, 3, 4, 6].map(|i| format!("P{i}"))).collect()),
    ])
}

fn find_tests(folder: &Path, prefix: &str, found: &mut BTreeSet<String>) {
    for entry in fs::read_dir(folder).expect("the folder is readable") {
        let path = entry.expect("the folder is readable").path();
        let file = path.file_name().expect("an entry has a name").to_string_lossy().into_owned();
        if path.is_dir() {
            find_tests(&path, &format!("{prefix}{file}/"), found);
        } else if file.ends_with(".rs") {
            let text = fs::read_to_string(&path).expect("sources are UTF-8");
            let names = text.split("#[test]\n").skip(1).filter_map(|below| {
                let (name, _) = below.split_once("fn ")?.1.split_once('(')?;
                // Tests that a macro generates have no names in the file.
                (!name.starts_with('$')).then_some(name)
            });
            found.extend(names.map(|name| format!("{prefix}{file}::{name}")));
        }
    }
}

/// A row of a table, with its line number and its cells by header.
struct Row {
    line: usize,
    cells: Vec<(String, String)>,
}

/// Splits a line of a Markdown table into its cells.
fn cells(line: &str) -> Vec<String> {
    let inner = line.trim().trim_start_matches('|').trim_end_matches('|');
    inner.split('|').map(|cell| cell.trim().to_owned()).collect()
}

/// Reads the rows of all tables of a Markdown text. Adds a complaint for each unknown header, and for each row with a
/// wrong number of cells.
fn rows(markdown: &str, complaints: &mut Vec<String>) -> Vec<Row> {
    let mut rows = Vec::new();
    let mut headers: Option<Vec<String>> = None;
    for (line, text) in (1..).zip(markdown.lines()) {
        if !text.starts_with('|') {
            headers = None;
            continue;
        }
        let cells = cells(text);
        let Some(headers) = &headers else {
            for header in cells.iter().filter(|header| Column::of(header).is_none()) {
                complaints.push(format!("line {line}: `{header}` is no header that is checked"));
            }
            headers = Some(cells);
            continue;
        };
        if cells.len() != headers.len() {
            let (found, expected) = (cells.len(), headers.len());
            complaints.push(format!("line {line}: {found} cells below {expected} headers"));
        } else if !cells.iter().all(|cell| cell.len() > 1 && cell.chars().all(|c| "-:".contains(c)))
        {
            rows.push(Row { line, cells: headers.iter().cloned().zip(cells).collect() });
        }
    }
    rows
}

/// The names in a cell, separated by commas, with or without backticks; `-` means none.
fn names(cell: &str) -> impl Iterator<Item = &str> {
    cell.split(',').map(|name| name.trim().trim_matches('`')).filter(|name| *name != "-")
}

fn nearest<'a>(unknown: &str, known: &'a BTreeSet<String>) -> Option<&'a str> {
    let likeness = |name| (strsim::normalized_damerau_levenshtein(unknown, name), name);
    let all = known.iter().map(|name| likeness(name.as_str()));
    all.max_by(|(a, _), (b, _)| a.total_cmp(b)).map(|(_, name)| name)
}

impl Row {
    /// Names in the row's cells, with the kind that each name should have.
    fn names(&self) -> impl Iterator<Item = (Kind, &str)> {
        self.cells.iter().flat_map(|(header, cell)| {
            let kind = match Column::of(header) {
                Some(Column::Names(kind) | Column::List(kind)) => Some(kind),
                Some(Column::Prose) | None => None,
            };
            kind.into_iter().flat_map(|kind| names(cell).map(move |name| (kind, name)))
        })
    }

    /// Names in the row's `Column::List` cells.
    fn listed(&self) -> impl Iterator<Item = (Kind, &str)> {
        self.cells.iter().flat_map(|(header, cell)| {
            let kind = match Column::of(header) {
                Some(Column::List(kind)) => Some(kind),
                _ => None,
            };
            kind.into_iter().flat_map(|kind| names(cell).map(move |name| (kind, name)))
        })
    }

    /// Checks if the row names no test and no frame, although its table has columns for them.
    fn is_unshown(&self) -> bool {
        let shows = |header: &str| ["test", "caught by", "golden"].contains(&header);
        let mut evidence = self.cells.iter().filter(|(header, _)| shows(header)).peekable();
        evidence.peek().is_some() && evidence.all(|(_, cell)| names(cell).next().is_none())
    }

    /// Describes each error in the row. The description begins with the line number and the row's first cell.
    fn complaints(&self, known: &Known) -> Vec<String> {
        let row = format!("line {}, `{}`", self.line, self.cells[0].1.trim_matches('`'));
        let unknown = self.names().filter(|(kind, name)| !known[kind].contains(*name));
        let mut complaints: Vec<String> = unknown
            .map(|(kind, name)| {
                let nearest = nearest(name, &known[&kind]);
                let nearest = nearest.map(|nearest| format!(", the nearest is `{nearest}`"));
                let noun = kind.noun();
                format!("{row}: there is no {noun} `{name}`{}", nearest.unwrap_or_default())
            })
            .collect();
        if self.is_unshown() {
            complaints.push(format!("{row}: no test and no golden shows it"));
        }
        complaints
    }
}

/// Returns a complaint for each function that the text outside of tables names, but the library lacks.
fn unknown_in_prose(markdown: &str, known: &Known) -> Vec<String> {
    let mut complaints = Vec::new();
    let prose = (1..).zip(markdown.lines()).filter(|(_, text)| !text.starts_with('|'));
    for (line, text) in prose {
        for span in text.split('`').skip(1).step_by(2) {
            let of_library = span
                .rsplit_once("::")
                .is_some_and(|(module, _)| known[&Kind::Module].contains(module));
            if of_library && !known[&Kind::Function].contains(span) {
                complaints.push(format!("line {line}: there is no function `{span}`"));
            }
        }
    }
    complaints
}

fn complaints(markdown: &str, known: &Known) -> Vec<String> {
    let mut complaints = unknown_in_prose(markdown, known);
    let rows = rows(markdown, &mut complaints);
    complaints.extend(rows.iter().flat_map(|row| row.complaints(known)));
    let listed: Vec<_> = rows.iter().flat_map(Row::listed).collect();
    for kind in [Kind::Module, Kind::Frame, Kind::Mistake] {
        let noun = kind.noun();
        for name in &known[&kind] {
            match listed.iter().filter(|listed| **listed == (kind, name.as_str())).count() {
                1 => {}
                0 => complaints.push(format!("{noun} `{name}` is not listed")),
                count => complaints.push(format!("{noun} `{name}` is listed {count} times")),
            }
        }
    }
    let named: BTreeSet<_> = rows.iter().flat_map(Row::names).collect();
    let mistakes =
        known[&Kind::Function].iter().filter(|function| function.starts_with("as_written::"));
    for mistake in mistakes.filter(|name| !named.contains(&(Kind::Function, name.as_str()))) {
        complaints.push(format!("function `{mistake}` is a mistake that no row names"));
    }
    complaints
}

fn inventory() -> String {
    let file = PBR.root().join("README.md");
    fs::read_to_string(file).expect("the inventory is readable")
}

#[test]
fn the_inventory_names_what_is_there() {
    let found = complaints(&inventory(), &known());
    assert!(found.is_empty(), "shaders/README.md:\n{}", found.join("\n"));
}

/// Checks that `complaints` looks up the names in each row: if the test appends `_` to a name, the name is reported as
/// unknown.
#[test]
fn every_name_of_the_inventory_is_read() {
    let known = known();
    let rows = rows(&inventory(), &mut Vec::new());
    assert!(rows.len() > 100, "{} rows are read", rows.len());
    for row in rows {
        assert!(row.names().count() > 0, "line {} names nothing", row.line);
        for (i, (header, _)) in row.cells.iter().enumerate() {
            let mut misspelt = Row { line: row.line, cells: row.cells.clone() };
            let cell = &mut misspelt.cells[i].1;
            let name = names(cell).next().map(str::to_owned);
            if let (false, Some(name)) = (matches!(Column::of(header), Some(Column::Prose)), name) {
                *cell = cell.replacen(&name, &format!("{name}_"), 1);
                let found = misspelt.complaints(&known).concat();
                assert!(found.contains(&format!("`{name}_`")), "line {}: `{name}`", row.line);
            }
        }
    }
}

/// The names of a small library with two functions, for tests of `complaints`.
fn small() -> Known {
    let set = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    Known::from([
        (Kind::Module, set(&["as_written::fresnel", "fresnel"])),
        (Kind::Function, set(&["as_written::fresnel::pow", "fresnel::schlick"])),
        (Kind::Test, set(&["fresnel.rs::schlick", "nan.rs::nan"])),
        (Kind::Frame, set(&["scene"])),
        (Kind::Mistake, set(&["E3", "P1"])),
    ])
}

const SOUND: &str = "\
# `fresnel::schlick`

| module | what it holds |
|---|---|
| `fresnel` | reflectance |
| `as_written::fresnel` | its mistakes |

| item | what it says | function | test | golden |
|---|---|---|---|---|
| Schlick | F0 + ... | `fresnel::schlick` | `fresnel.rs::schlick` | - |

| frame | what it shows | drawn by |
|---|---|---|
| `scene` | spheres | - |

| id | as the source has it | what is right | as written | what it produces | caught by |
|:---|---|---|---|---|---:|
| E3 | a | b | `as_written::fresnel::pow` | NaN | `nan.rs::nan`, `fresnel.rs::schlick` |
| P1 | a | b | - | 3 | `fresnel.rs::schlick` |
";

/// Each planted error in the page gives the expected complaint.
#[test]
fn faults_are_seen() {
    let known = small();
    assert_eq!(complaints(SOUND, &known), [""; 0]);
    let without = |row: &str| (row.to_owned() + "\n", String::new());
    let with = |original: &str, fault: &str| (original.to_owned(), fault.to_owned());
    let faults = [
        (
            with("`fresnel::schlick` |", "`fresnel::shlick` |"),
            "line 10, `Schlick`: there is no function `fresnel::shlick`, \
             the nearest is `fresnel::schlick`",
        ),
        (
            with("`fresnel.rs::schlick` | -", "`fresnel.rs::schlik` | -"),
            "line 10, `Schlick`: there is no test `fresnel.rs::schlik`, \
             the nearest is `fresnel.rs::schlick`",
        ),
        (
            with("`fresnel.rs::schlick` | -", "`fresnel.rs::schlick` | `scenes`"),
            "line 10, `Schlick`: there is no frame `scenes`, the nearest is `scene`",
        ),
        (
            with("`fresnel.rs::schlick` | -", "- | -"),
            "line 10, `Schlick`: no test and no golden shows it",
        ),
        (
            with("`fresnel::schlick` |", "in the module `fresnel` |"),
            "line 10, `Schlick`: there is no function `in the module `fresnel`, \
             the nearest is `as_written::fresnel::pow`",
        ),
        (without("| P1 | a | b | - | 3 | `fresnel.rs::schlick` |"), "mistake `P1` is not listed"),
        (with("| P1 |", "| E3 |"), "mistake `E3` is listed 2 times\nmistake `P1` is not listed"),
        (
            with("| P1 |", "| P1, P2 |"),
            "line 19, `P1, P2`: there is no mistake `P2`, the nearest is `P1`",
        ),
        (without("| `fresnel` | reflectance |"), "module `fresnel` is not listed"),
        (without("| `scene` | spheres | - |"), "frame `scene` is not listed"),
        (
            with("`as_written::fresnel::pow`", "-"),
            "function `as_written::fresnel::pow` is a mistake that no row names",
        ),
        (with("| test |", "| tests |"), "line 8: `tests` is no header that is checked"),
        (with("# `fresnel::", "# `fresnel::s"), "line 1: there is no function `fresnel::sschlick`"),
        (with("| NaN |", "| NaN"), "line 18: 5 cells below 6 headers"),
    ];
    for ((original, fault), expected) in faults {
        assert!(SOUND.contains(&original), "`{original}` isn't there");
        let found = complaints(&SOUND.replacen(&original, &fault, 1), &known).join("\n");
        assert!(found.contains(expected), "`{fault}` for `{original}`:\n{found}");
    }
}

/// The whole library is valid, including entry points and functions that no test calls.
// Lesson 53
#[test]
fn the_whole_library_is_valid() {
    let found = PBR.is_valid();
    assert!(found.functions > 150 && found.entry_points > 20, "{found}");
    // If Tint is installed, Tint accepts each module. `cargo ci test` requires Tint.
    let opinion = found.opinion;
    assert!(opinion.is_good(false) && opinion.shipped.is_empty(), "{:?}", opinion.remarks());
    assert!(opinion.unasked.is_some() || opinion.accepted == found.modules, "{opinion}");
}
