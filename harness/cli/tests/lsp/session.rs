//! Tests how a session begins and ends, and how the server handles wrong messages.

use serde_json::{Value, json};

use super::editor::Editor;
use super::{CALC, folder, write};

const FILE: &str = "shaders/calc.wgsl";

#[test]
fn a_session_that_is_shut_down_ends_well() {
    let folder = folder();
    let mut editor = Editor::open(folder.path());
    let answer = editor.ask("shutdown", Value::Null);
    assert_eq!((&answer["result"], &answer["error"]), (&Value::Null, &Value::Null), "{answer}");
    // The server refuses requests before `initialize`.
    let answer = editor.ask("textDocument/codeLens", json!({}));
    assert_eq!(answer["error"]["code"], -32600, "{answer}");
    editor.notify("exit", Value::Null);
    assert_eq!(editor.end(), Some(0));
}

#[test]
fn a_session_that_is_not_shut_down_ends_badly() {
    let folder = folder();
    let mut editor = Editor::open(folder.path());
    editor.notify("exit", Value::Null);
    assert_eq!(editor.end(), Some(1));
    // An editor that crashes sends no `exit`.
    assert_eq!(Editor::open(folder.path()).end(), Some(1));
    let mut editor = Editor::silent(folder.path());
    editor.notify("exit", Value::Null);
    assert_eq!(editor.end(), Some(1));
}

#[test]
fn requests_before_initialize_are_refused() {
    let folder = folder();
    let mut editor = Editor::silent(folder.path());
    let answer = editor.ask("textDocument/codeLens", json!({}));
    assert_eq!(answer["error"]["code"], -32002, "{answer}");
    // The server accepts an `initialize` without folders, and with wrong capabilities.
    let answer = editor.ask("initialize", json!({ "capabilities": 5, "workspaceFolders": "a" }));
    assert!(answer["result"]["capabilities"].is_object(), "{answer}");
    let answer = editor.ask("initialize", json!({}));
    assert_eq!(answer["error"]["code"], -32600, "{answer}");
}

#[test]
fn garbage_ends_no_session() {
    let folder = folder();
    let mut editor = Editor::open(folder.path());
    for (garbage, code) in [
        ("Content-Length: 1\r\n\r\n{", -32700),
        ("Content-Length: -1\r\n\r\n", -32700),
        ("Content-Length: 2\r\n\r\n[]", -32600),
        ("Content-Length: 2\r\nContent-Type: a\r\n\r\n{}", -32600),
    ] {
        editor.raw(garbage.as_bytes());
        let refusal = editor.refusal();
        assert_eq!(refusal["error"]["code"], code, "{garbage}");
        assert_eq!(refusal["id"], Value::Null);
    }
    editor.raw(b"\xff\xfe no protocol\r\n\r\n");
    let answer = editor.ask("textDocument/hover", json!({}));
    assert_eq!(answer["error"]["code"], -32601, "{answer}");
    let answer = editor.ask("textDocument/codeLens", json!({ "textDocument": 5 }));
    assert_eq!(answer["error"]["code"], -32602, "{answer}");
    editor.notify("$/setTrace", json!({ "value": "off" }));
    editor.notify("textDocument/didOpen", json!({}));
    editor.notify("textDocument/didChange", json!([1]));
    editor.notify("textDocument/didSave", Value::Null);
    // The file was never opened.
    editor.edit(FILE, "fn broken(");
    // The server still works.
    editor.open_file(FILE, CALC);
    editor.edit(FILE, "fn broken(\n");
    editor.wait(FILE, |all| !all.is_empty());
    editor.ask("shutdown", Value::Null);
    editor.notify("exit", Value::Null);
    assert_eq!(editor.end(), Some(0));
}

/// If the folder has no shaders or doesn't exist, or if the project is unreadable, the server shows no lenses, and the
/// session continues.
#[test]
fn folders_without_shaders_are_silent() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut editor = Editor::open(folder.path());
    assert_eq!(editor.lenses("a.wgsl"), []);
    // The first module of the folder is written while the folder is open.
    write(folder.path(), "a.wgsl", "fn f() -> f32 { return y; }\n");
    editor.open_file("a.wgsl", "fn f() -> f32 { return y; }\n");
    editor.wait("a.wgsl", |all| all.len() == 1);
    assert_eq!(editor.said, [""; 0]);

    let mut editor = Editor::silent(folder.path());
    let gone = editor.uri("gone");
    editor.ask("initialize", json!({ "rootUri": gone, "capabilities": {} }));
    assert_eq!(editor.lenses("b.wgsl"), []);

    write(folder.path(), "Cargo.toml", "[workspace\n");
    let mut editor = Editor::open(folder.path());
    editor.wait_said("Cargo.toml");
    assert_eq!(editor.lenses("a.wgsl"), []);
}
