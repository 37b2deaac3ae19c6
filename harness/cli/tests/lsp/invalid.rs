//! Tests the diagnostics of invalid modules in text that isn't saved.

use super::editor::Editor;
use super::{CALC, folder, told, write};

const FILE: &str = "shaders/calc.wgsl";

#[test]
fn a_fault_is_shown_at_its_place_and_goes_when_it_is_mended() {
    let folder = folder();
    let mut editor = Editor::open(folder.path());
    editor.open_file(FILE, CALC);
    // The edit isn't saved, so the file on disk stays valid.
    let fault = CALC.replace("return x;", "/* \u{1f980} */ return y;");
    editor.edit(FILE, &fault);
    let shown = editor.wait(FILE, |all| all.len() == 1);
    let (line, column, message) = told(&shown[0]);
    assert_eq!((line, column), (3, 44), "{message}");
    assert!(message.contains("no definition in scope for identifier: `y`"), "{message}");
    assert_eq!((&shown[0]["source"], &shown[0]["severity"]), (&"karat".into(), &1.into()));
    editor.edit(FILE, CALC);
    editor.wait(FILE, <[_]>::is_empty);
    // The parser of modules rejects this text, and the editor shows its error, too.
    editor.edit(FILE, &CALC.replace("fn lonely(", "fn lonely(("));
    let shown = editor.wait(FILE, |all| !all.is_empty());
    assert_eq!(told(&shown[0]).0, 3, "{shown:?}");
    editor.edit(FILE, CALC);
    editor.wait(FILE, <[_]>::is_empty);
}

/// Tint's rejection is a warning while you type, and an error if the package requires Tint's verdict.
// Lesson 201
#[test]
fn errors_of_tint_are_diagnostics() {
    let folder = folder();
    let mut editor = Editor::with_tint(folder.path());
    editor.open_file(FILE, CALC);
    let shift = format!("{CALC}fn shift(x: u32) -> u32 {{ return x << x + 1u; }}\n");
    let line = shift.lines().count() as u64;
    for severity in [2, 1] {
        editor.edit(FILE, &shift);
        // Without Tint, nothing is shown. `cargo ci setup` installs Tint.
        let shown = editor.wait(FILE, |all| all.len() == 1);
        assert_eq!((told(&shown[0]).0, told(&shown[0]).1), (line, 36));
        assert!(told(&shown[0]).2.contains("Tint rejects this: mixing '<<' and '+'"), "{shown:?}");
        assert_eq!(shown[0]["severity"], severity, "{shown:?}");
        editor.edit(FILE, CALC);
        editor.wait(FILE, <[_]>::is_empty);
        let required = "[compilers]\nrequire = [\"tint\"]\n";
        write(folder.path(), "shaders/karat.toml", required);
    }
}

/// If an edit makes another module invalid, the editor shows the error in the other module, which imports the edited
/// one.
#[test]
fn a_fault_is_shown_in_the_module_that_imports() {
    let folder = folder();
    write(
        folder.path(),
        "shaders/user.wgsl",
        "import package::calc::lonely;\nfn user() -> f32 { return lonely(1.0); }\n",
    );
    let mut editor = Editor::open(folder.path());
    editor.open_file(FILE, CALC);
    editor.edit(FILE, &CALC.replace("lonely", "alone"));
    let shown = editor.wait("shaders/user.wgsl", |all| !all.is_empty());
    let (line, _, message) = told(&shown[0]);
    assert_eq!(line, 1, "{message}");
    assert!(message.contains("lonely"), "{message}");
    editor.edit(FILE, CALC);
    editor.wait("shaders/user.wgsl", <[_]>::is_empty);
    // For a closed file, the server reads the file on disk.
    editor.edit(FILE, &CALC.replace("lonely", "alone"));
    editor.wait("shaders/user.wgsl", |all| !all.is_empty());
    let document = serde_json::json!({ "uri": editor.uri(FILE) });
    editor.notify("textDocument/didClose", serde_json::json!({ "textDocument": document }));
    editor.wait("shaders/user.wgsl", <[_]>::is_empty);
}

/// A deleted file, a file outside of packages, and a URI that isn't a file have no diagnostics, and don't stop the
/// server.
#[test]
fn other_files_have_no_diagnostics() {
    let folder = folder();
    write(folder.path(), "other.wgsl", "fn broken(\n");
    let mut editor = Editor::open(folder.path());
    editor.open_file("other.wgsl", "fn broken(\n");
    editor.open_file("shaders/gone.wgsl", "fn broken(\n");
    let document = serde_json::json!({
        "uri": "untitled:Untitled-1", "languageId": "wgsl", "version": 1, "text": "fn broken(",
    });
    editor.notify("textDocument/didOpen", serde_json::json!({ "textDocument": document }));
    editor.open_file(FILE, CALC);
    editor.edit(FILE, "fn broken(\n");
    editor.wait(FILE, |all| !all.is_empty());
    assert!(editor.shown("other.wgsl").is_empty() && editor.shown("shaders/gone.wgsl").is_empty());
    assert_eq!(editor.lenses("other.wgsl"), []);
    // The module is deleted, and so is its error.
    std::fs::remove_file(folder.path().join(FILE)).expect("removed");
    let document = serde_json::json!({ "uri": editor.uri(FILE) });
    editor.notify("textDocument/didClose", serde_json::json!({ "textDocument": document }));
    editor.wait(FILE, <[_]>::is_empty);
    assert_eq!(editor.lenses(FILE), []);
}
