//! Tests that the tests named in `TESTPLAN.md` exist.

use std::path::{Path, PathBuf};

/// Every `file::test` of the plan, in backticks: a path from the root of the repository, and the
/// name of a function with `#[test]` above it.
fn named(plan: &str) -> Vec<(String, String)> {
    let quoted = plan.split('`').skip(1).step_by(2);
    let parts = quoted.filter_map(|text| text.split_once(".rs::"));
    parts.map(|(file, test)| (format!("{file}.rs"), test.to_owned())).collect()
}

/// Returns `true` if a text has a test of this name.
fn has_test(text: &str, test: &str) -> bool {
    let mut attributed = false;
    for line in text.lines().map(str::trim) {
        if line == "#[test]" {
            attributed = true;
        } else if let Some(rest) = line.strip_prefix("fn ") {
            let name = rest.split('(').next().unwrap_or_default();
            if attributed && name == test {
                return true;
            }
            attributed = false;
        }
    }
    false
}

#[test]
fn each_named_test_exists() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the repository's root");
    let plan = std::fs::read_to_string(root.join("TESTPLAN.md")).expect("the plan is there");
    let named = named(&plan);
    assert!(named.len() >= 40, "the plan names only {} tests", named.len());
    let missing: Vec<String> = named
        .iter()
        .filter(|(file, test)| {
            let text = std::fs::read_to_string(root.join(file)).unwrap_or_default();
            !has_test(&text, test)
        })
        .map(|(file, test)| format!("{file}::{test}"))
        .collect();
    assert!(missing.is_empty(), "the plan names tests that don't exist: {missing:#?}");
}

/// Each row of a lesson names its proof, or the reason why there is none yet.
#[test]
fn each_row_has_a_test_or_says_that_it_is_open() {
    let plan = include_str!("../TESTPLAN.md");
    let rows = plan.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| lesson"));
    let mut count = 0;
    for row in rows {
        count += 1;
        assert!(row.contains(".rs::") || row.contains("**open**"), "{row}");
    }
    assert!(count >= 30, "the plan has {count} rows");
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("readable") {
        let path = entry.expect("readable").path();
        let hidden = path.file_name().is_some_and(|name| name == "target" || name == ".git");
        if path.is_dir() && !hidden {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Tests that fail are declared with a reason, and run. Only `cargo ci full` runs the review's long ones.
#[test]
fn no_test_is_switched_off() {
    let full = include_str!("../ci/src/suite.rs");
    assert!(full.contains(r#"test.args(["--", "--include-ignored"]);"#), "no command runs them");
    let is_long = |file: &Path, line: &str| {
        file.iter().any(|part| part == "review") && line.ends_with("`cargo ci full` runs it\"]")
    };
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the repository's root");
    let mut files = Vec::new();
    sources(root, &mut files);
    assert!(files.len() > 50, "only {} files were found", files.len());
    for file in files {
        let text = std::fs::read_to_string(&file).expect("UTF-8");
        for line in text.lines().map(str::trim) {
            let off = ["#[ignore", "#[cfg(any())]", "#[cfg(false)]"];
            let is_off = off.iter().any(|off| line.starts_with(off)) && !is_long(&file, line);
            assert!(!is_off, "{}: {line}", file.display());
        }
    }
}

#[test]
fn a_test_that_is_named_wrongly_is_missed() {
    let text = "#[test]\nfn right() {}\n\nfn helper() {}\n";
    assert!(has_test(text, "right"));
    assert!(!has_test(text, "wrong") && !has_test(text, "helper") && !has_test("", "right"));
    assert_eq!(named("| x | `a/b.rs::c` and `d` |"), [("a/b.rs".to_owned(), "c".to_owned())]);
}
