//! Tests `--short`, which prints lines for problem matchers and quickfix lists.

use super::{CALC, UNASKED, folder, karat, tested, write};

/// Parses `file:line:column: error: message` as VS Code's and vim's patterns do.
fn parsed(line: &str) -> Option<(&str, u32, u32, &str)> {
    let (place, message) = line.split_once(": error: ")?;
    let mut parts = place.split(':');
    let (file, line, column) = (parts.next()?, parts.next()?, parts.next()?);
    Some((file, line.parse().ok()?, column.parse().ok()?, message))
}

#[test]
fn each_failure_is_a_line() {
    let folder = folder();
    let wrong = CALC.replace("0.5 * x", "0.25 * x").replace("a + b", "a + 0.5 * b");
    write(folder.path(), "shaders/calc.wgsl", &wrong);
    let out = tested(folder.path(), &["--short"]);
    let lines: Vec<&str> = out.lines().collect();
    assert_eq!(lines.len(), 3, "{out}");
    let (file, line, column, message) = parsed(lines[0]).expect("a failure");
    assert_eq!((file, line, column), ("shaders/calc.wgsl", 5, 1));
    assert!(message.starts_with("`calc::sum` fails invariant_under: "), "{message}");
    let (file, line, column, message) = parsed(lines[1]).expect("a failure");
    assert_eq!((file, line, column), ("shaders/calc_test.wgsl", 5, 5));
    assert!(message.starts_with("`expect_near(half(3.0), 1.5, 0.0)` saw 0.75"), "{message}");
    assert_eq!(lines[2], &*format!("3 checks, 2 failed{UNASKED}"));
    // `karat report` prints the same lines. In another folder, it prints paths relative to that folder.
    let report = karat(folder.path()).args(["report", "--short"]).output().expect("it runs");
    assert_eq!(String::from_utf8_lossy(&report.stdout), out);
    assert_eq!(report.status.code(), Some(1));
    let below = folder.path().join("shaders");
    let mut command = karat(&below);
    command.args(["report", "--short"]);
    let below = command.output().expect("it runs");
    let below = String::from_utf8_lossy(&below.stdout).into_owned();
    assert!(below.starts_with("calc.wgsl:5:1: error: "), "{below}");
}

#[test]
fn invalid_modules_have_a_line_and_passing_ones_none() {
    let folder = folder();
    assert_eq!(tested(folder.path(), &["--short"]), format!("3 checks, 0 failed{UNASKED}\n"));
    write(folder.path(), "shaders/bad.wgsl", "\nfn f() -> f32 { return y; }\n");
    let out = tested(folder.path(), &["--short"]);
    let line = out.lines().next().and_then(parsed).unwrap_or_else(|| panic!("{out}"));
    assert_eq!((line.0, line.1, line.2), ("shaders/bad.wgsl", 2, 24));
    assert!(
        out.ends_with(&format!("1 module isn't valid: bad; 3 checks passed{UNASKED}\n")),
        "{out}"
    );
    // GitHub shows the error at its line, also if a later command reports the run.
    let start = "::error file=shaders/bad.wgsl,line=2,col=24,title=invalid module::";
    let out = tested(folder.path(), &["--github"]);
    assert!(out.lines().any(|line| line.starts_with(start)), "{out}");
    let report = karat(folder.path()).args(["report", "--github"]).output().expect("it runs");
    assert!(String::from_utf8_lossy(&report.stdout).contains(start), "{report:?}");
}
