//! Tests `karat replay`, and the summary that names failures to replay.

use super::report::function;
use super::*;

/// The record of a failing check. The check's message has two cases on one path, and one case on another path.
fn failing(name: &str) -> String {
    let message = format!(
        "error: `{name}` fails\n\non vulkan: x\n  worst\n  replay: KARAT_CASE={name}/agrees_with/3 cargo test a\n  \
         simplest\n  replay: KARAT_PATHS=vulkan KARAT_CASE={name}/agrees_with/3.1 cargo test 'a b'\n\n\
         on gl: x\n  worst\n  replay: KARAT_PATHS=gl cargo test c"
    );
    function(name, "gl", "fail", Some(&message))
}

fn recorded(lines: &[String]) -> TempDir {
    let project = project();
    let folder = project.path().join("target/karat/record");
    write(&folder, "1.jsonl", &lines.concat());
    write(&folder, "run.json", r#"{"schema":5,"selected":[],"passed":false}"#);
    project
}

/// Finds the lines `karat replay NAME` of a report. Returns each name with the function and the verb of its check.
fn names(out: &str) -> Vec<(String, String)> {
    let lines = out.lines().filter_map(|line| line.strip_prefix("karat replay "));
    let pair = |line: &str| {
        let (name, what) = line.split_once("  ").expect("a name, and what it is of");
        (name.to_owned(), what.to_owned())
    };
    lines.map(pair).collect()
}

#[test]
fn a_failure_is_replayed_by_its_name() {
    let project = recorded(&[failing("calc::double"), failing("calc::same")]);
    let report = karat(project.path(), &["report"]);
    assert_eq!(report.code, Some(1));
    let found = names(&report.out);
    assert_eq!(found.len(), 2, "{report:?}");
    assert_eq!(found[0].1, "calc::double agrees_with");
    let name = &*found[0].0;
    assert!(name.len() == 4 && name.chars().all(|c| c.is_ascii_hexdigit()), "{name}");
    let line = "KARAT_PATHS=vulkan KARAT_CASE=calc::double/agrees_with/3.1 cargo test 'a b'\n";
    assert_eq!(karat(project.path(), &["replay", name, "--print"]).good(), line);
    // The failure has the same name in another run.
    let again = recorded(&[failing("calc::double")]);
    assert_eq!(names(&karat(again.path(), &["report"]).out), [found[0].clone()]);
    assert_eq!(karat(again.path(), &["replay", "--print"]).good(), line);

    // A shell replaces Cargo, and runs a file named like its first argument.
    let script = "echo \"$KARAT_CASE on $KARAT_PATHS: $*\"\nexit $(cat code)\n";
    write(project.path(), "test", script);
    for (code, expected) in [("0", 0), ("101", 1)] {
        write(project.path(), "code", code);
        let mut replay = command(project.path(), &["replay", name]);
        let ran = output(replay.env("CARGO", "/bin/sh"));
        assert_eq!(ran.code, Some(expected), "{ran:?}");
        assert_eq!(ran.out, "calc::double/agrees_with/3.1 on vulkan: a b\n");
    }
}

#[test]
fn a_failure_without_a_replay_says_why() {
    let project = recorded(&[failing("calc::double"), failing("calc::same")]);
    let told = |project: &TempDir, arguments: &[&str], part: &str| {
        let ran = karat(project.path(), &[&["replay"], arguments].concat());
        assert!(ran.code == Some(3) && ran.err.contains(part), "no `{part}` in {ran:?}");
    };
    let listed = "name one of these failures:\n  ";
    told(&project, &[], listed);
    told(&project, &[], "  calc::same agrees_with\n");
    told(&project, &["wxyz"], "no failure of the last run is called `wxyz`; did you mean ");
    told(&project, &[""], "the names of several failures begin with ``");
    let passed = recorded(&[function("calc::double", "gl", "pass", None)]);
    told(&passed, &[], "no failure of the last run can be replayed");
    told(&super::project(), &[], "run `karat test` first");
    let hostile = function("calc::double", "gl", "fail", Some("on gl: x\n  replay: sh test"));
    let ran = karat(recorded(&[hostile]).path(), &["replay"]);
    assert!(ran.code == Some(2) && ran.err.contains("must run cargo or karat"), "{ran:?}");
}

/// A report names at most eight failures to replay, and counts the others. `karat replay` lists all failures.
#[test]
fn more_failures_than_are_named_are_counted() {
    let many: Vec<String> = (0..11).map(|i| failing(&format!("calc::f{i}"))).collect();
    let project = recorded(&many);
    let report = karat(project.path(), &["report"]).out;
    assert_eq!(names(&report).len(), 8, "{report}");
    assert!(report.contains("\nand 3 more failures: `karat replay` lists all\n"), "{report}");
    let listed = karat(project.path(), &["replay"]).err;
    assert!((0..11).all(|i| listed.contains(&format!("  calc::f{i} agrees_with\n"))), "{listed}");
    let few = karat(recorded(&many[..8]).path(), &["report"]).out;
    assert!(names(&few).len() == 8 && !few.contains(" more: "), "{few}");
}

/// If a report doesn't fit the screen, it has one line for all passing checks of a module. The failures follow in full.
#[test]
fn a_long_report_is_folded_by_module() {
    let passing = (0..30).map(|i| function(&format!("m{}::f{i}", i % 2), "gl", "pass", None));
    let lines: Vec<String> = passing.chain([failing("calc::double")]).collect();
    let project = recorded(&lines);
    let folded = karat(project.path(), &["report"]).out;
    let row = |name: &str| folded.lines().find(|line| line.starts_with(name)).unwrap_or_default();
    assert_eq!(
        row("m0 ").split_whitespace().collect::<Vec<_>>(),
        ["m0", "15", "1500", "700%", "gl"]
    );
    assert!(!folded.contains("m0::f0"), "{folded}");
    assert!(["passed", "m0 ", "m1 "].iter().all(|name| row(name).chars().count() <= 80));
    let table = folded.find("calc::double  agrees_with").expect("what fails has its row");
    let message = folded.find("error: `calc::double` fails").expect("and its message");
    let sum = folded.find("31 checks, 1 failed").expect("and the sum");
    assert!(row("m1 ").contains("15") && table < message && message < sum, "{folded}");
    let all = karat(project.path(), &["report", "--all"]).out;
    assert!(all.contains("m0::f0") && !all.contains("--all shows"), "{all}");
    // A few checks fit the screen.
    let few = karat(recorded(&lines[20..]).path(), &["report"]).out;
    assert!(few.contains("m0::f20") && !few.contains("--all shows"), "{few}");
}

/// `--failed` runs only the tests that failed.
#[test]
fn failed_runs_only_the_failed_tests() {
    let folder = tempfile::tempdir().expect("a folder");
    let shader = |bound: &str| {
        format!(
            "import karat::expect_near;\nfn f(x: f32) -> f32 {{ return x; }}\n\
             @test fn good() {{ expect_near(f(1.0), 1.0, 0.0); }}\n\
             @test fn bad() {{ expect_near(f(1.0), {bound}, 0.0); }}\n\
             @test fn bad_as_well() {{ expect_near(f(2.0), 2.0, 0.0); }}\n"
        )
    };
    let run = |arguments: &[&str]| {
        karat(folder.path(), &[&["test", ".", "--paths", "cpu"], arguments].concat())
    };
    write(folder.path(), "m.wgsl", &shader("2.0"));
    let none = run(&["--failed"]);
    assert!(none.code == Some(3) && none.err.contains("run `karat test` first"), "{none:?}");
    let all = run(&[]);
    assert!(all.code == Some(1) && all.out.contains("3 checks, 1 failed"), "{all:?}");
    let failed = run(&["--failed"]);
    assert!(failed.code == Some(1) && failed.out.contains("1 check, 1 failed"), "{failed:?}");
    write(folder.path(), "m.wgsl", &shader("1.0"));
    assert!(run(&["--failed"]).good().contains("1 check, 0 failed"));
    let none = run(&["--failed"]);
    assert!(none.code == Some(3) && none.err.contains("no test failed"), "{none:?}");

    // Karat gives Cargo the names of Cargo's tests. A shell replaces Cargo.
    let project = recorded(&[failing("calc::double")]);
    write(project.path(), "test", "echo \"cargo $*\"\nexit 1\n");
    let ran = output(command(project.path(), &["test", "--failed"]).env("CARGO", "/bin/sh"));
    assert!(ran.out.contains("--workspace --tests -- --exact tests::calc\n"), "{ran:?}");
    assert_eq!(ran.code, Some(2), "it compared nothing: {ran:?}");
}
