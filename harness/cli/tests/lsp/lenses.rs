//! Tests the lenses beside functions, and that a lens runs the right tests.

use serde_json::json;
use tempfile::TempDir;

use super::editor::Editor;
use super::faults::fault;
use super::{CALC, TESTS, UNASKED, folder, tested, told, write};

const FILE: &str = "shaders/calc.wgsl";
const TEST: &str = "shaders/calc_test.wgsl";

#[test]
fn each_function_has_a_lens_with_its_test_results() {
    let folder = folder();
    let mut editor = Editor::open(folder.path());
    editor.open_file(FILE, CALC);
    editor.wait_lens(
        FILE,
        5,
        "karat: 2 checks pass, worst error 0 ulp (0 ulp) on cpu, 131072 cases",
    );
    let lenses = editor.lenses(FILE);
    let expected = [
        (1, "karat: 1 check passes, 1 case".to_owned()),
        (1, "run".to_owned()),
        // Without a test, the lens runs nothing.
        (3, "karat: no test".to_owned()),
        (5, "karat: 2 checks pass, worst error 0 ulp (0 ulp) on cpu, 131072 cases".to_owned()),
        (5, "run".to_owned()),
    ];
    assert_eq!(lenses, expected);
    assert_eq!(
        editor.lenses(TEST),
        [(4, "karat: 1 check passes, 1 case".to_owned()), (4, "run".to_owned()),]
    );
    // Each lens has its line in the unsaved text. The verdicts belong to the saved text.
    editor.edit(FILE, &format!("// a line\n{CALC}"));
    editor.wait_lens(FILE, 6, "karat: changed after the last test");
    editor.wait_heard("workspace/codeLens/refresh");
}

#[test]
fn a_lens_runs_the_tests_of_its_function() {
    let folder = folder();
    write(folder.path(), FILE, &CALC.replace("0.5 * x", "0.25 * x"));
    let mut editor = Editor::open(folder.path());
    editor.wait(TEST, |all| all.len() == 1);
    let arguments = json!([editor.uri(FILE), "calc::half"]);
    let run = json!({ "command": "karat.run", "arguments": arguments });
    let answer = editor.ask("workspace/executeCommand", run.clone());
    assert!(answer["error"].is_null(), "{answer}");
    let said = editor.wait_said("`calc::half`: ");
    assert_eq!(said, format!("karat: `calc::half`: 1 check, 1 failed{UNASKED}"));
    for method in ["window/workDoneProgress/create", "$/progress"] {
        editor.wait_heard(method);
    }
    // The run has a name for this failure.
    let shown = editor.wait(TEST, |all| all.len() == 1 && all[0]["code"].is_string());
    assert_eq!(told(&shown[0]).0, 5);
    // The server still shows the last verdicts of functions that the run didn't check.
    editor.open_file(FILE, &CALC.replace("0.5 * x", "0.25 * x"));
    editor.wait_lens(FILE, 1, "karat: 1 check fails, 1 case");
    editor.wait_lens(FILE, 5, "karat: 2 checks pass");
    // The fault is fixed, so the check passes.
    editor.save(FILE, CALC);
    editor.wait(TEST, <[_]>::is_empty);
    editor.said.clear();
    editor.ask("workspace/executeCommand", run);
    let said = editor.wait_said("`calc::half`: ");
    assert_eq!(said, format!("karat: `calc::half`: 1 check, 0 failed{UNASKED}"));
}

#[test]
fn a_lens_that_cannot_run_says_why() {
    let folder = folder();
    let mut editor = Editor::open(folder.path());
    editor.open_file(TEST, TESTS);
    let lonely = json!([editor.uri(FILE), "calc::lonely"]);
    let run = |arguments| json!({ "command": "karat.run", "arguments": arguments });
    editor.ask("workspace/executeCommand", run(lonely));
    editor.wait_said("`calc::lonely` has no test");
    editor.ask("workspace/executeCommand", run(json!(["untitled:a", "f"])));
    editor.wait_said("isn't in a package of shaders");
    for (command, arguments) in
        [("karat.run", json!([])), ("karat.run", json!([1, 2])), ("karat.fly", json!(["a", "b"]))]
    {
        let wanted = json!({ "command": command, "arguments": arguments });
        let answer = editor.ask("workspace/executeCommand", wanted);
        assert_eq!(answer["error"]["code"], -32602, "{answer}");
    }
}

/// A Cargo project with two Rust tests. The Rust tests write a record as Karat's checks do, but don't depend on the
/// crate `karat`, which would take long to compile.
fn in_rust() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(
        folder.path(),
        "Cargo.toml",
        "[package]\nname = \"stub\"\nedition = \"2021\"\n[workspace]\n",
    );
    write(folder.path(), "src/lib.rs", "");
    write(folder.path(), FILE, CALC);
    let package = folder.path().canonicalize().expect("it is there").join("shaders");
    let adapter = json!({ "path": "cpu", "name": "an engine", "driver": "1", "software": true });
    for (test, function, line) in [("halves", "calc::half", 1), ("adds::up", "calc::sum", 5)] {
        for (text, verdict) in [(CALC.to_owned(), "pass"), (wrong(), "fail")] {
            let failed = verdict == "fail";
            let head = "error: `calc::half` fails agrees_with: 4 ulp\non cpu: an engine, 1\n  replay: KARAT_CASE=x cargo test\n";
            let record = json!({
                "schema": 5, "test": test, "verdict": verdict, "message": failed.then_some(head),
                "details": failed.then(|| fault(head)),
                "subject": {
                    "kind": "function", "package": package, "function": function, "seed": 1,
                    "check": "agrees_with", "assertion": "4 ulp",
                    "location": format!("{FILE}:{line}:1"),
                },
                "paths": [{
                    "adapter": adapter, "cases": 100, "failures": if failed { 7 } else { 0 },
                    "worst": "2 ulp", "ratio": 0.5, "asserted": "4 ulp", "known_issue": null,
                }],
                "read": [{
                    "file": package.join("calc.wgsl"),
                    "hash": blake3::hash(text.as_bytes()).to_hex().to_string(),
                }],
                "started": "2026-01-31T12:00:00.000Z", "seconds": 1.0,
            });
            let name = format!("{}.{verdict}", test.replace("::", "_"));
            write(folder.path(), &name, &format!("{record}\n"));
        }
    }
    write(folder.path(), "tests/calc.rs", RUST);
    folder
}

const RUST: &str = r#"fn keep(test: &str) {
    let text = std::fs::read_to_string("shaders/calc.wgsl").unwrap();
    let verdict = if text.contains("0.5 * x") { "pass" } else { "fail" };
    let folder = std::env::var("KARAT_RECORD").expect("karat runs it");
    std::fs::copy(format!("{test}.{verdict}"), format!("{folder}/{test}.jsonl")).unwrap();
    assert_eq!(verdict, "pass");
}
#[test]
fn halves() {
    keep("halves");
}
mod adds {
    #[test]
    fn up() {
        super::keep("adds_up");
    }
}
"#;

fn wrong() -> String {
    CALC.replace("0.5 * x", "0.25 * x")
}

#[test]
fn a_lens_runs_the_rust_tests_of_its_function() {
    let folder = in_rust();
    let mut editor = Editor::open(folder.path());
    editor.open_file(FILE, CALC);
    let run = |editor: &mut Editor, function: &str| {
        editor.said.clear();
        let wanted = json!({ "command": "karat.run", "arguments": [editor.uri(FILE), function] });
        let answer = editor.ask("workspace/executeCommand", wanted);
        assert!(answer["error"].is_null(), "{answer}");
        editor.wait_said(&format!("`{function}`"))
    };
    // The server knows the functions of a Rust test after the test has run.
    editor.wait_lens(FILE, 1, "karat: no test is known: run `karat test`");
    assert_eq!(
        run(&mut editor, "calc::half"),
        "karat: no test of `calc::half` is known: run `karat test`"
    );
    let ran = tested(folder.path(), &[]);
    assert!(ran.contains("2 checks"), "{ran}");
    let passes = "karat: 1 check passes, worst error 2 ulp (4 ulp) on cpu, 100 cases";
    editor.wait_lens(FILE, 1, passes);
    editor.wait_lens(FILE, 1, "run");
    editor.wait_lens(FILE, 3, "karat: no test");
    // Only tests of this function run. The verdicts of other functions are those of the last run.
    editor.save(FILE, &wrong());
    editor.wait_lens(FILE, 1, "karat: changed after the last test");
    let failed = format!("karat: `calc::half`: 1 check, 1 failed{UNASKED}");
    assert_eq!(run(&mut editor, "calc::half"), failed);
    let shown = editor.wait(FILE, |all| all.len() == 1 && all[0]["code"].is_string());
    assert_eq!(told(&shown[0]).0, 1);
    editor.wait_lens(FILE, 1, "karat: 1 check fails");
    editor.wait_lens(FILE, 5, "karat: changed after the last test");
    editor.save(FILE, CALC);
    editor.wait(FILE, <[_]>::is_empty);
    assert_eq!(
        run(&mut editor, "calc::half"),
        format!("karat: `calc::half`: 1 check, 0 failed{UNASKED}")
    );
    editor.wait_lens(FILE, 1, passes);
    assert_eq!(
        run(&mut editor, "calc::sum"),
        format!("karat: `calc::sum`: 1 check, 0 failed{UNASKED}")
    );
    editor.wait_lens(FILE, 5, passes);
    // The editor shows the error of rustc, and no verdict.
    write(folder.path(), "tests/calc.rs", &RUST.replace("let text =", "let text: u32 ="));
    let said = run(&mut editor, "calc::half");
    assert_eq!(said, "karat: `calc::half`: error[E0308]: mismatched types");
    // The editor also shows that a test no longer exists.
    write(folder.path(), "tests/calc.rs", &RUST.replace("fn halves", "fn halved"));
    let said = run(&mut editor, "calc::half");
    assert_eq!(
        said,
        "karat: `calc::half`: error: no test ran a check. A run that compared nothing isn't a success"
    );
}
