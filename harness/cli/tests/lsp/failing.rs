//! Tests the diagnostics of failing checks. After each save, the server runs the tests in WGSL and in TOML. For
//! Rust tests, the server uses the record of the last run.

use serde_json::{Value, json};

use super::editor::Editor;
use super::faults::fault;
use super::{CALC, DECLARED, TESTS, folder, tested, told, write};

const FILE: &str = "shaders/calc.wgsl";
const TEST: &str = "shaders/calc_test.wgsl";

#[test]
fn tests_without_rust_run_after_each_save() {
    let folder = folder();
    let mut editor = Editor::open(folder.path());
    editor.open_file(FILE, CALC);
    editor.open_file(TEST, TESTS);
    let wrong = CALC.replace("0.5 * x", "0.25 * x").replace("a + b", "a + 0.5 * b");
    editor.save(FILE, &wrong);
    let shown = editor.wait(TEST, |all| all.len() == 1);
    let (line, column, message) = told(&shown[0]);
    assert_eq!((line, column), (5, 5), "{message}");
    let seen = "`expect_near(half(3.0), 1.5, 0.0)` saw 0.75, expected 1.5 within 0, in `calc_test::halves` on cpu";
    assert_eq!(message, seen);
    let shown = editor.wait(FILE, |all| all.len() == 1);
    let (line, _, message) = told(&shown[0]);
    assert_eq!(line, 5, "{message}");
    assert!(message.starts_with("`calc::sum` fails invariant_under: "), "{message}");
    assert!(message.contains("(0 ulp) on cpu, "), "{message}");
    // No run has a name for this failure.
    assert_eq!(shown[0]["code"], Value::Null);
    // After an edit, the failure isn't shown any more. After undoing the edit, it is shown again.
    editor.edit(FILE, &format!("// new\n{wrong}"));
    editor.wait(FILE, <[_]>::is_empty);
    editor.wait(TEST, <[_]>::is_empty);
    editor.edit(FILE, &wrong);
    editor.wait(FILE, |all| all.len() == 1);
    editor.wait(TEST, |all| all.len() == 1);
    // The fault is fixed and saved, so the check passes.
    editor.save(FILE, CALC);
    editor.wait(FILE, <[_]>::is_empty);
    editor.wait(TEST, <[_]>::is_empty);
    editor.wait_lens(TEST, 4, "karat: 1 check passes");
}

/// A test that can't start has no record. The editor still shows its error at its line.
#[test]
fn a_test_that_cannot_begin_is_an_error_at_its_place() {
    let folder = folder();
    let mut editor = Editor::open(folder.path());
    editor.open_file(FILE, CALC);
    let declared = "[[test]]\nfunction = \"calc::nothing\"\nfinite = true\n";
    write(folder.path(), "shaders/more.test.toml", declared);
    let lines = CALC.lines().count();
    editor.save(FILE, &format!("{CALC}fn nothing() {{}}\n"));
    let shown = editor.wait(FILE, |all| all.len() == 1);
    let (line, _, message) = told(&shown[0]);
    assert_eq!(line as usize, lines + 1, "{message}");
    assert!(message.contains("nothing"), "{message}");
    // The record has no line, so the test's own message is shown.
    let declared =
        "[[test]]\nfunction = \"calc::half\"\nfinite = true\nfails_on = { vulcan = \"no\" }\n";
    write(folder.path(), "shaders/more.test.toml", declared);
    let shown = editor.wait("shaders/more.test.toml", |all| all.len() == 1);
    let (line, column, message) = told(&shown[0]);
    assert_eq!((line, column), (4, 1), "{message}");
    assert!(message.contains("did you mean `vulkan`?"), "{message}");
}

/// If a test file has a wrong name, isn't valid TOML, or has an unknown key, the editor shows an error in this file.
// Lesson 185
#[test]
fn a_misnamed_or_broken_test_file_is_a_diagnostic() {
    let folder = folder();
    let mut editor = Editor::open(folder.path());
    editor.open_file(FILE, CALC);
    for (file, text, part) in [
        (
            "shaders/other.tests.toml",
            DECLARED.to_owned(),
            "Karat reads declared tests from `*.test.toml`",
        ),
        ("shaders/more.test.toml", "garbage".to_owned(), "expected `=`"),
        ("shaders/more.test.toml", DECLARED.replace("function", "functionn"), "functionn"),
    ] {
        write(folder.path(), file, &text);
        let shown = editor.wait(file, |all| all.len() == 1);
        assert!(told(&shown[0]).2.contains(part), "{shown:?}");
        std::fs::remove_file(folder.path().join(file)).expect("it is there");
        editor.wait(file, <[_]>::is_empty);
    }
}

/// If an edit doesn't affect a test, the test keeps its verdict, at its new line.
#[test]
fn an_unrelated_edit_keeps_the_verdicts_in_the_editor() {
    let folder = folder();
    let wrong = CALC.replace("a + b", "a + 0.5 * b");
    write(folder.path(), FILE, &wrong);
    let mut editor = Editor::open(folder.path());
    editor.open_file(FILE, &wrong);
    editor.wait(FILE, |all| all.len() == 1);
    editor.wait_lens(FILE, 1, "karat: 1 check passes");
    editor.save(FILE, &wrong.replace("fn lonely", "// another line\nfn lonely"));
    let shown = editor.wait(FILE, |all| all.len() == 1 && told(&all[0]).0 == 6);
    assert!(told(&shown[0]).2.starts_with("`calc::sum` fails "), "{shown:?}");
    editor.wait_lens(FILE, 1, "karat: 1 check passes");
    editor.wait_lens(FILE, 6, "karat: 1 of 2 checks fail");
    // Another declared test has no effect either.
    let more = "[[test]]\nfunction = \"lonely\"\nover = { x = \"0..1\" }\nfinite = true\n";
    write(folder.path(), "shaders/calc.test.toml", &format!("{DECLARED}{more}"));
    editor.wait_lens(FILE, 4, "karat: 1 check passes");
    editor.wait_lens(FILE, 6, "karat: 1 of 2 checks fail");
    editor.wait(FILE, |all| all.len() == 1);
}

/// If a file is saved while tests run, Karat tests the file again after this run. Then no diagnostics of the earlier
/// run remain.
#[test]
fn a_save_while_tests_run_is_judged_after_them() {
    let folder = folder();
    let slow = "import package::calc::half;\nimport karat::expect_near;\n\
                @test @cases(4096) fn slow(@over(0, 1) x: f32) {\n    var y = 0.0;\n    \
                for (var i = 0; i < 100000; i++) { y = half(x); }\n    expect_near(y, 0.5 * x, 0.0);\n}\n";
    write(folder.path(), "shaders/slow_test.wgsl", slow);
    let mut editor = Editor::open(folder.path());
    editor.open_file(FILE, CALC);
    editor.wait_lens(FILE, 1, "karat: 2 checks pass");
    for factor in ["0.125", "0.25"] {
        editor.save(FILE, &CALC.replace("0.5 * x", &format!("{factor} * x")));
        // This wait is far shorter than the slow test, so the test still runs.
        std::thread::sleep(std::time::Duration::from_millis(150));
    }
    let shown = editor.wait(TEST, |all| all.len() == 1);
    assert!(told(&shown[0]).2.contains("saw 0.75"), "{shown:?}");
}

/// If another program edits a test file, the server runs the file's tests again. If a test becomes unreadable, the
/// editor shows an error at its line.
#[test]
fn files_that_no_editor_has_open_are_followed() {
    let folder = folder();
    let mut editor = Editor::open(folder.path());
    editor.open_file(FILE, CALC);
    editor.wait_lens(FILE, 1, "karat: 1 check passes");
    let declared = "shaders/calc.test.toml";
    write(folder.path(), declared, &DECLARED.replace("[0, 2]", "[0, 1]"));
    let shown = editor.wait(FILE, |all| all.len() == 1);
    let (line, _, message) = told(&shown[0]);
    assert!(line == 5 && message.starts_with("`calc::sum` fails stays_within: "), "{message}");
    write(folder.path(), declared, &DECLARED.replace("in_range", "in_rage"));
    let shown = editor.wait(declared, |all| all.len() == 1);
    let (line, _, message) = told(&shown[0]);
    assert!(line == 5 && message.contains("in_rage"), "{message}");
    write(folder.path(), declared, DECLARED);
    editor.wait(declared, <[_]>::is_empty);
    editor.wait(FILE, <[_]>::is_empty);
}

/// After a run of `karat test`, each diagnostic has a code: the name by which `karat replay` runs the failure again.
#[test]
fn failures_in_the_editor_have_their_replay_names() {
    let folder = folder();
    write(folder.path(), FILE, &CALC.replace("a + b", "a + 0.5 * b"));
    let mut editor = Editor::open(folder.path());
    editor.wait(FILE, |all| all.len() == 1);
    let out = tested(folder.path(), &[]);
    let name = out.lines().find_map(|line| line.strip_prefix("karat replay "));
    let name = name.and_then(|rest| rest.split(' ').next()).expect("a name");
    let shown = editor.wait(FILE, |all| all.len() == 1 && all[0]["code"].is_string());
    assert_eq!(shown[0]["code"], name);
}

/// A Cargo project with the record of a Rust test that failed on a path which this machine doesn't have.
fn recorded(hash: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "Cargo.toml", "[workspace]\n");
    write(folder.path(), FILE, CALC);
    let package = folder.path().canonicalize().expect("it is there").join("shaders");
    let adapter = json!({ "path": "gl", "name": "llvmpipe", "driver": "1", "software": true });
    let message = "error: `calc::lonely` fails agrees_with: 4 ulp\non gl: llvmpipe, 1\n  \
                   replay: KARAT_CASE=x cargo test\n";
    let record = json!({
        "schema": 5, "test": "brdf", "verdict": "fail", "message": message, "details": fault(message),
        "subject": {
            "kind": "function", "package": package, "function": "calc::lonely", "check": "agrees_with",
            "assertion": "4 ulp", "location": "shaders/calc.wgsl:3:1", "seed": 1,
        },
        "paths": [{
            "adapter": adapter, "cases": 100, "failures": 7, "worst": "8.5 ulp", "ratio": 2.1,
            "asserted": "4 ulp", "known_issue": null,
        }],
        "read": [{ "file": package.join("calc.wgsl"), "hash": hash }],
        "started": "2026-01-31T12:00:00.000Z", "seconds": 1.0,
    });
    let run = json!({ "schema": 5, "selected": [], "passed": false });
    write(folder.path(), "target/karat/record/1.jsonl", &format!("{record}\n"));
    write(folder.path(), "target/karat/record/run.json", &run.to_string());
    folder
}

#[test]
fn failures_of_the_last_run_are_shown_while_they_are_true() {
    let hash = blake3::hash(CALC.as_bytes()).to_hex().to_string();
    let folder = recorded(&hash);
    let mut editor = Editor::open(folder.path());
    let shown = editor.wait(FILE, |all| all.len() == 1);
    let (line, column, message) = told(&shown[0]);
    assert_eq!((line, column), (3, 1));
    assert_eq!(message, "`calc::lonely` fails agrees_with: 8.5 ulp (4 ulp) on gl, 7 of 100 cases");
    let code = shown[0]["code"].as_str().expect("a name");
    assert!(code.len() == 4 && code.bytes().all(|byte| byte.is_ascii_hexdigit()), "{code}");
    editor.open_file(FILE, CALC);
    let title = "karat: 1 check fails, worst error 8.5 ulp (4 ulp) on gl, 100 cases";
    editor.wait_lens(FILE, 3, title);
    // After a full run, a function that the run didn't check has no test.
    assert!(editor.lenses(FILE).contains(&(1, "karat: no test".to_owned())));
    editor.edit(FILE, &CALC.replace("return x", "return 1.0 * x"));
    editor.wait(FILE, <[_]>::is_empty);
    editor.wait_lens(FILE, 3, "karat: changed after the last test");
    editor.edit(FILE, CALC);
    editor.wait(FILE, |all| all.len() == 1);
    // Another program changes a file that no editor has open.
    let document = json!({ "uri": editor.uri(FILE) });
    editor.notify("textDocument/didClose", json!({ "textDocument": document }));
    write(folder.path(), FILE, &CALC.replace("return x", "return 1.0 * x"));
    editor.wait(FILE, <[_]>::is_empty);
    write(folder.path(), FILE, CALC);
    editor.wait(FILE, |all| all.len() == 1);
}

#[test]
fn failures_of_other_files_are_not_shown() {
    let folder = recorded("0123");
    let mut editor = Editor::open(folder.path());
    editor.open_file(FILE, CALC);
    editor.wait_lens(FILE, 3, "karat: changed after the last test");
    assert!(editor.shown(FILE).is_empty());
}

/// The server reports an unreadable record once, and continues.
#[test]
fn a_broken_record_is_reported_once() {
    let folder = recorded("0123");
    write(folder.path(), "target/karat/record/1.jsonl", "{\n");
    let mut editor = Editor::open(folder.path());
    editor.open_file(FILE, CALC);
    editor.wait_said("isn't a record of version 5");
    for _ in 0..3 {
        editor.save(FILE, &CALC.replace("return x;", "return y;"));
        editor.wait(FILE, |all| all.len() == 1);
        editor.save(FILE, CALC);
        editor.wait(FILE, <[_]>::is_empty);
    }
    let told = editor.said.iter().filter(|said| said.contains("isn't a record")).count();
    assert_eq!(told, 1, "{:?}", editor.said);
}
