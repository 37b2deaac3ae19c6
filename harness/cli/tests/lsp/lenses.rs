//! Lenses beside functions, and what they run.

use serde_json::json;

use super::editor::Editor;
use super::{CALC, TESTS, folder, told, write};

const FILE: &str = "shaders/calc.wgsl";
const TEST: &str = "shaders/calc_test.wgsl";

#[test]
fn each_function_has_what_is_known_of_it() {
    let folder = folder();
    let mut editor = Editor::open(folder.path());
    editor.open_file(FILE, CALC);
    editor.wait_lens(FILE, 5, "karat: 2 checks pass, worst 0 of 0 ulp on cpu, 131072 cases");
    let lenses = editor.lenses(FILE);
    let expected = [
        (1, "karat: 1 check passes, 1 case".to_owned()),
        (1, "run".to_owned()),
        // Without a test there is nothing to run.
        (3, "karat: no test".to_owned()),
        (5, "karat: 2 checks pass, worst 0 of 0 ulp on cpu, 131072 cases".to_owned()),
        (5, "run".to_owned()),
    ];
    assert_eq!(lenses, expected);
    assert_eq!(
        editor.lenses(TEST),
        [(4, "karat: 1 check passes, 1 case".to_owned()), (4, "run".to_owned()),]
    );
    // Lines follow the text that isn't saved; verdicts are about what was.
    editor.edit(FILE, &format!("// a line\n{CALC}"));
    editor.wait_lens(FILE, 6, "karat: changed since it was tested");
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
    assert_eq!(said, "karat: `calc::half`: 1 check, 1 failed");
    for method in ["window/workDoneProgress/create", "$/progress"] {
        editor.wait_heard(method);
    }
    // The run has a name for it.
    let shown = editor.wait(TEST, |all| all.len() == 1 && all[0]["code"].is_string());
    assert_eq!(told(&shown[0]).0, 5);
    // Of the functions that weren't run it is still known what it was.
    editor.open_file(FILE, &CALC.replace("0.5 * x", "0.25 * x"));
    editor.wait_lens(FILE, 1, "karat: 1 check fails, 1 case");
    editor.wait_lens(FILE, 5, "karat: 2 checks pass");
    // Mended, it passes.
    editor.save(FILE, CALC);
    editor.wait(TEST, <[_]>::is_empty);
    editor.said.clear();
    editor.ask("workspace/executeCommand", run);
    let said = editor.wait_said("`calc::half`: ");
    assert_eq!(said, "karat: `calc::half`: 1 check, 0 failed");
}

#[test]
fn what_cannot_be_run_is_told() {
    let folder = folder();
    let mut editor = Editor::open(folder.path());
    editor.open_file(TEST, TESTS);
    let lonely = json!([editor.uri(FILE), "calc::lonely"]);
    let run = |arguments| json!({ "command": "karat.run", "arguments": arguments });
    editor.ask("workspace/executeCommand", run(lonely));
    editor.wait_said("`calc::lonely` has no test");
    editor.ask("workspace/executeCommand", run(json!(["untitled:a", "f"])));
    editor.wait_said("is in no package of shaders");
    for (command, arguments) in
        [("karat.run", json!([])), ("karat.run", json!([1, 2])), ("karat.fly", json!(["a", "b"]))]
    {
        let wanted = json!({ "command": command, "arguments": arguments });
        let answer = editor.ask("workspace/executeCommand", wanted);
        assert_eq!(answer["error"]["code"], -32602, "{answer}");
    }
}
