//! Tests `karat lsp` as an editor uses it, through two pipes. The tests write and parse messages with their own code,
//! so that a mistake of the server's code isn't repeated in the tests.

mod editor;
mod failing;
#[path = "../given/faults.rs"]
mod faults;
#[path = "../given/files.rs"]
mod files;
mod invalid;
mod lenses;
#[path = "../given/program.rs"]
mod program;
mod session;
mod short;

use std::path::Path;
use std::process::Command;

use files::write;
use program::program;
use serde_json::Value;
use tempfile::TempDir;

/// The end of the last line that each command prints in these tests, because the tests run without Tint.
const UNASKED: &str = "; Tint wasn't asked: KARAT_TINT=off";

const CALC: &str = "fn half(x: f32) -> f32 { return 0.5 * x; }\n\n\
fn lonely(x: f32) -> f32 { return x; }\n\n\
fn sum(a: f32, b: f32) -> f32 { return a + b; }\n";

const TESTS: &str = "import package::calc::half;\nimport karat::expect_near;\n\n\
@test fn halves() {\n    expect_near(half(3.0), 1.5, 0.0);\n}\n";

const DECLARED: &str = "[[test]]\nfunction = \"sum\"\nover = { a = \"0..1\", b = \"0..1\" }\n\
symmetric_in = [\"a\", \"b\"]\nin_range = [0, 2]\n";

/// A folder of shaders with tests, without a Cargo project.
fn folder() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "shaders/calc.wgsl", CALC);
    write(folder.path(), "shaders/calc_test.wgsl", TESTS);
    write(folder.path(), "shaders/calc.test.toml", DECLARED);
    folder
}

fn karat(folder: &Path) -> Command {
    let mut command = program(folder);
    command.env("KARAT_PATHS", "cpu").env("NO_COLOR", "1");
    command
}

/// Runs `karat test`, and returns its output.
fn tested(folder: &Path, arguments: &[&str]) -> String {
    let ran = karat(folder).arg("test").args(arguments).output().expect("it runs");
    String::from_utf8(ran.stdout).expect("text")
}

/// The line, column (both from 1) and message of a diagnostic.
fn told(diagnostic: &Value) -> (u64, u64, &str) {
    let start = &diagnostic["range"]["start"];
    let number = |value: &Value| value.as_u64().expect("a number") + 1;
    let message = diagnostic["message"].as_str().expect("a message");
    (number(&start["line"]), number(&start["character"]), message)
}
