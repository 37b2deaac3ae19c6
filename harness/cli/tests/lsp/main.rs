//! `karat lsp` as an editor has it: a program at the other end of two pipes. How messages are framed
//! and what they hold is written here once more, so that no mistake is made twice.

mod editor;
mod failing;
mod invalid;
mod lenses;
mod session;
mod short;

use std::path::Path;
use std::process::Command;

use serde_json::Value;
use tempfile::TempDir;

const CALC: &str = "fn half(x: f32) -> f32 { return 0.5 * x; }\n\n\
fn lonely(x: f32) -> f32 { return x; }\n\n\
fn sum(a: f32, b: f32) -> f32 { return a + b; }\n";

const TESTS: &str = "import package::calc::half;\nimport karat::expect_near;\n\n\
@test fn halves() {\n    expect_near(half(3.0), 1.5, 0.0);\n}\n";

const DECLARED: &str = "[[test]]\nfunction = \"sum\"\nover = { a = \"0..1\", b = \"0..1\" }\n\
symmetric_in = [\"a\", \"b\"]\nin_range = [0, 2]\n";

fn write(folder: &Path, file: &str, text: &str) {
    let path = folder.join(file);
    std::fs::create_dir_all(path.parent().expect("in the folder")).expect("a folder");
    std::fs::write(path, text).expect("written");
}

/// A folder of shaders with tests of their own, and no Cargo project.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "shaders/calc.wgsl", CALC);
    write(folder.path(), "shaders/calc_test.wgsl", TESTS);
    write(folder.path(), "shaders/calc.test.toml", DECLARED);
    folder
}

fn karat(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_karat"));
    for (name, _) in std::env::vars_os() {
        if name.to_string_lossy().starts_with("KARAT_") {
            command.env_remove(name);
        }
    }
    for name in ["CI", "GITHUB_ACTIONS", "CARGO_TARGET_DIR", "CLICOLOR_FORCE"] {
        command.env_remove(name);
    }
    command.current_dir(folder).env("KARAT_PATHS", "cpu").env("NO_COLOR", "1");
    command
}

/// What a `karat test` prints; whether it passes or not.
fn tested(folder: &Path, arguments: &[&str]) -> String {
    let ran = karat(folder).arg("test").args(arguments).output().expect("it runs");
    String::from_utf8(ran.stdout).expect("text")
}

/// Where a diagnostic begins, counted as people do, and what it says.
fn told(diagnostic: &Value) -> (u64, u64, &str) {
    let start = &diagnostic["range"]["start"];
    let number = |value: &Value| value.as_u64().expect("a number") + 1;
    let message = diagnostic["message"].as_str().expect("a message");
    (number(&start["line"]), number(&start["character"]), message)
}
