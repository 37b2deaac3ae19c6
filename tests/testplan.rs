//! Checks `TESTPLAN.md`, a list of lessons with their tests. The lessons are written by hand. The tests come from the
//! lines `// Lesson N` above tests in the sources.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The tests of each lesson, such as `file::test`, grouped by the label in `// Lesson 12: label`.
type Tests = BTreeMap<u32, BTreeMap<String, Vec<String>>>;

/// Adds the tests of a file that have a line `// Lesson N` above them.
///
/// # Errors
///
/// If a line `// Lesson` has no number, or no test below it.
fn read(file: &str, text: &str, tests: &mut Tests) -> Result<(), String> {
    let (mut lessons, mut is_test) = (Vec::new(), false);
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim();
        if let Some(lesson) = line.strip_prefix("// Lesson ") {
            let (lesson, label) = lesson.split_once(": ").unwrap_or((lesson, ""));
            let lesson = lesson.parse::<u32>().map_err(|_| {
                format!("{file}:{number}: write `// Lesson 12`, or `// Lesson 12: what it shows`")
            })?;
            lessons.push((lesson, label.to_owned()));
        } else if line == "#[test]" {
            is_test = true;
        } else if !line.starts_with("#[") && !line.starts_with("//") {
            let name = line.strip_prefix("fn ").and_then(|rest| rest.split('(').next());
            let test = name.filter(|_| is_test).map(|name| format!("{file}::{name}"));
            for (lesson, label) in lessons.drain(..) {
                let test = test.clone().ok_or(format!(
                    "{file}:{number}: no test follows the line `// Lesson {lesson}`"
                ))?;
                tests.entry(lesson).or_default().entry(label).or_default().push(test);
            }
            is_test = false;
        }
    }
    match lessons.first() {
        Some((lesson, _)) => Err(format!("{file}: no test follows the line `// Lesson {lesson}`")),
        None => Ok(()),
    }
}

/// Returns the text of the plan with the tests of each lesson filled in.
///
/// # Errors
///
/// If two rows have the same number, if a row has neither a test nor the word **open**, or if a test names a lesson
/// that has no row.
fn written(plan: &str, mut tests: Tests) -> Result<String, String> {
    let (mut text, mut lessons) = (String::new(), Vec::new());
    for line in plan.lines() {
        let mut cells = line.trim_start_matches("| ").splitn(3, " | ").map(str::trim);
        let (first, lesson) = (cells.next().unwrap_or_default(), cells.next());
        let (Ok(number), Some(lesson)) = (first.parse(), lesson) else {
            text += line;
            text.push('\n');
            continue;
        };
        if lessons.contains(&number) {
            return Err(format!("two lessons have the number {number}: take the next free one"));
        }
        lessons.push(number);
        let shown = tests.remove(&number).unwrap_or_default();
        if shown.is_empty() && !lesson.contains("**open**") {
            return Err(format!("no test has a line `// Lesson {number}`, for: {lesson}"));
        }
        let parts = shown.iter().map(|(label, tests)| {
            let tests: Vec<String> = tests.iter().map(|test| format!("`{test}`")).collect();
            let label = if label.is_empty() { String::new() } else { format!("{label}: ") };
            label + &tests.join(", ")
        });
        let parts: Vec<String> = parts.collect();
        writeln!(text, "| {number} | {lesson} | {} |", parts.join("; ")).expect("memory");
    }
    match tests.pop_first() {
        Some((lesson, shown)) => Err(format!("TESTPLAN.md has no lesson {lesson}, of {shown:?}")),
        None => Ok(text),
    }
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

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("the repository's root")
}

#[test]
fn the_plan_names_the_tests_of_each_lesson() {
    let (mut files, mut tests) = (Vec::new(), Tests::new());
    sources(root(), &mut files);
    files.sort();
    for path in files {
        let text = std::fs::read_to_string(&path).expect("UTF-8");
        let file = path.strip_prefix(root()).expect("below the root").to_str().expect("UTF-8");
        read(&file.replace('\\', "/"), &text, &mut tests).unwrap_or_else(|why| panic!("{why}"));
    }
    let plan = root().join("TESTPLAN.md");
    let text = std::fs::read_to_string(&plan).expect("the plan is there").replace("\r\n", "\n");
    let written = written(&text, tests).unwrap_or_else(|why| panic!("{why}"));
    if std::env::var_os("WRITE").is_some() {
        std::fs::write(plan, written).expect("the plan can be written");
    } else {
        let other = text.lines().zip(written.lines()).find(|(old, new)| old != new);
        assert!(
            other.is_none(),
            "run `WRITE=1 cargo test --workspace --test testplan`: {other:#?}"
        );
    }
}

/// Checks that no test is switched off, except for the long tests in folders `review`, which `cargo ci full` runs. Even
/// tests of known issues run.
// Lesson 8: no test is ignored
#[test]
fn no_test_is_switched_off() {
    let full = include_str!("../ci/src/suite.rs");
    assert!(full.contains(r#"test.args(["--", "--include-ignored"]);"#), "no command runs them");
    let is_long = |file: &Path, line: &str| {
        file.iter().any(|part| part == "review") && line.ends_with("`cargo ci full` runs it\"]")
    };
    let mut files = Vec::new();
    sources(root(), &mut files);
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
fn slips_in_lessons_are_errors() {
    let of = |text: &str| {
        let mut tests = Tests::new();
        read("a.rs", text, &mut tests).map(|()| tests)
    };
    let plan = "| # | lesson | tests |\n|---|---|---|\n| 7 | NaN passes. | old |\n";
    let text =
        "// Lesson 7: on CPU\n#[test]\n#[ignore]\nfn b() {}\n\n// Lesson 7\n#[test]\nfn a() {}\n";
    let row = "| 7 | NaN passes. | `a.rs::a`; on CPU: `a.rs::b` |\n";
    let filled = written(plan, of(text).expect("read")).expect("written");
    assert_eq!(filled, plan.replace("| 7 | NaN passes. | old |\n", row));
    for (text, why) in [
        ("// Lesson seven\n#[test]\nfn a() {}\n", "a.rs:1: write `// Lesson 12`"),
        ("// Lesson 7\nfn helper() {}\n", "a.rs:2: no test follows the line `// Lesson 7`"),
        ("// Lesson 7\n", "a.rs: no test follows the line `// Lesson 7`"),
    ] {
        let error = of(text).expect_err("refused");
        assert!(error.starts_with(why), "{error}");
    }
    let doubled = format!("{plan}| 7 | Again. | |\n");
    let added = text.replace("// Lesson 7\n", "// Lesson 8\n// Lesson 7\n");
    for (plan, text, why) in [
        (plan, "", "no test has a line `// Lesson 7`, for: NaN passes."),
        (doubled.as_str(), text, "two lessons have the number 7"),
        (plan, added.as_str(), "TESTPLAN.md has no lesson 8"),
    ] {
        let error = written(plan, of(text).expect("read")).expect_err("refused");
        assert!(error.starts_with(why), "{error}");
    }
    let open = plan.replace("NaN passes.", "NaN passes: **open**.");
    assert!(written(&open, Tests::new()).is_ok());
}
