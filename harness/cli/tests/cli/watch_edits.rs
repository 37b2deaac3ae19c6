//! Compares `karat watch` with `karat test`. After an edit that makes a project invalid, both fail. After any other
//! edit, both pass.

use super::watch::Watching;
use super::*;

const LIB: &str = "const GAIN = 2.0;\n\
fn scaled(x: f32) -> f32 { return GAIN * x; }\n\
fn idle(x: f32) -> f32 { return x; }\n";

const MAIN: &str = "import package::lib::{scaled};\n\
struct Params { gain: f32, count: u32 }\n\
@group(0) @binding(0) var<uniform> params: Params;\n\
@group(0) @binding(1) var<storage, read_write> sums: array<f32>;\n\
override STEP: f32 = 1.0;\n\
fn tone(x: f32) -> f32 { return scaled(x); }\n\
fn unused(x: f32) -> vec2f { let half = 0.5; return vec2f(x, half); }\n\
@compute @workgroup_size(4) fn run() {\n    let i = params.count;\n    sums[i] = params.gain * STEP;\n}\n\
@vertex fn vs(@location(0) at: vec3f) -> @builtin(position) vec4f { return vec4f(at, 1.0); }\n\
@fragment fn fs() -> @location(0) vec4f { return vec4f(tone(0.5)); }\n";

const TEST: &str = "import package::main::tone;\nimport karat::expect_near;\n\
@test fn doubles() { expect_near(tone(3.0), 6.0, 0.0); }\n";

const DECLARED: &str = "[[test]]\nfunction = \"tone\"\ntable = \"rows\"\ntolerance = \"exact\"\n";

/// The packages: one plain, one with include guards, and one with a condition.
const PACKAGES: [&str; 3] = ["a", "b", "c"];

/// The content of a file of a package.
fn text(package: &str, file: &str) -> String {
    let text = match file {
        "lib.wgsl" => LIB,
        "main.wgsl" => MAIN,
        "main_test.wgsl" => TEST,
        "main.test.toml" => DECLARED,
        "rows" => "x,result\n0,0\n3,6\n",
        "karat.toml" => "[features]\nFAST = true\n",
        _ => unreachable!("no such file"),
    };
    match (package, file) {
        ("b", "lib.wgsl") => format!("#ifndef LIB\n#define LIB\n{text}#endif\n"),
        ("c", "lib.wgsl") => text.replace("fn idle", "@if(FAST) fn idle"),
        _ => text.to_owned(),
    }
}

/// An edit of a file: replaces a text by another text, or renames the file.
enum Edit {
    Text(&'static str, &'static str, &'static str),
    Name(&'static str, &'static str),
}
use Edit::{Name, Text};

const RUN: &str = "@compute @workgroup_size(4) fn run";
const VS: &str = "-> @builtin(position) vec4f";

/// Ten kinds of edits, with five edits of each kind. Each edit fits all three packages, and makes the edited
/// package invalid.
const INVALID: [(&str, [Edit; 5]); 10] = [
    (
        "unknown name",
        [
            Text("lib.wgsl", "{ return x; }", "{ return nonsense; }"),
            Text("main.wgsl", "vec4f(at, 1.0)", "vec4f(at, one)"),
            Text("main.wgsl", "vec2f(x, half)", "vec2f(x, haf)"),
            Text("main.wgsl", "array<f32>", "array<Float>"),
            Text("main_test.wgsl", "expect_near(", "expect_neer("),
        ],
    ),
    (
        "type",
        [
            Text("lib.wgsl", "{ return x; }", "{ return vec2f(x); }"),
            Text("main.wgsl", "let i = params.count", "let i: i32 = params.count"),
            Text("main.wgsl", "vec4f(tone(0.5))", "vec3f(tone(0.5))"),
            Text("main.wgsl", "params.gain * STEP", "params"),
            Text("main.wgsl", "let half = 0.5", "let half: bool = 0.5"),
        ],
    ),
    (
        "duplicate",
        [
            Text("lib.wgsl", "fn idle", "fn scaled(x: f32) -> f32 { return x; }\nfn idle"),
            Text("lib.wgsl", "const GAIN", "const GAIN = 1.0;\nconst GAIN"),
            Text("main.wgsl", "struct Params", "struct Params { a: f32 }\nstruct Params"),
            Text("main.wgsl", "fn unused(x: f32", "fn unused(x: f32, x: f32"),
            Text("main.wgsl", "let half = 0.5;", "let half = 0.5; let half = 1.0;"),
        ],
    ),
    (
        "entry point",
        [
            Text("main.wgsl", "@workgroup_size(4) ", ""),
            Text("main.wgsl", VS, "-> @location(0) vec4f"),
            Text("main.wgsl", "fn fs() -> @location(0) vec4f", "fn fs() -> vec4f"),
            Text("main.wgsl", "vs(@location(0) at: vec3f)", "vs(at: vec3f)"),
            Text("main.wgsl", "@workgroup_size(4)", "@workgroup_size(0)"),
        ],
    ),
    (
        "attribute",
        [
            Text("main_test.wgsl", "@test", "@tset"),
            Text("main.wgsl", "@builtin(position)", "@builtin(psition)"),
            Text("main.wgsl", "@fragment", "@fragmnt"),
            Text("main.wgsl", "@location(0) at", "@location(-1) at"),
            Text("main.wgsl", "struct Params { gain", "struct Params { @algn(8) gain"),
        ],
    ),
    (
        "syntax",
        [
            Text("main.wgsl", "let i = params.count;", "let i = ;"),
            Text("main.wgsl", "let half = 0.5;", "let half = 0.5"),
            Text("lib.wgsl", "{ return x; }", "{ return x; "),
            Text("lib.wgsl", "fn idle", "/* fn idle"),
            Text("main_test.wgsl", "6.0, 0.0)", "6.0, 0.0"),
        ],
    ),
    (
        "deleted import",
        [
            Text("main.wgsl", "import package::lib::{scaled};", ""),
            Text("lib.wgsl", "fn scaled", "fn scaled_by_two"),
            Text("main_test.wgsl", "import package::main::tone;", ""),
            Text("main.wgsl", "fn tone", "fn curve"),
            Text("main_test.wgsl", "import karat::expect_near;", ""),
        ],
    ),
    (
        "binding",
        [
            Text("main.wgsl", "@binding(1)", "@binding(0)"),
            Text("main.wgsl", "@group(0) @binding(1) var", "var"),
            Text("main.wgsl", "var<storage, read_write>", "var<storage, read>"),
            Text(
                "main.wgsl",
                "var<uniform> params: Params",
                "var<uniform> params: texture_2d<f32>",
            ),
            Text("main.wgsl", "@group(0) @binding(0)", "@group(0)"),
        ],
    ),
    (
        "override",
        [
            Text("main.wgsl", "override STEP: f32 = 1.0", "override STEP"),
            Text("main.wgsl", "override STEP: f32", "override STEP: vec2f"),
            Text("main.wgsl", "STEP: f32 = 1.0", "STEP: f32 = true"),
            Text(
                "main.wgsl",
                "override STEP",
                "@id(1) override OTHER = 1.0;\n@id(1) override STEP",
            ),
            Text("main.wgsl", "let half = 0.5;", "override half = 0.5;"),
        ],
    ),
    (
        "renamed file",
        [
            Name("lib.wgsl", "lob.wgsl"),
            Name("main.wgsl", "mein.wgsl"),
            Name("main.test.toml", "main.tests.toml"),
            Name("rows", "rows.csv"),
            Name("main.test.toml", "lib.test.toml"),
        ],
    ),
];

/// Fifty edits after which the tests still pass: an edit doesn't change the meaning, or no test detects the change.
const VALID: [Edit; 50] = [
    Text("lib.wgsl", "fn idle", "// idle\nfn idle"),
    Text("lib.wgsl", "fn idle", "fn more(x: f32) -> f32 { return -x; }\nfn idle"),
    Text("lib.wgsl", "{ return x; }", "{ return 2.0 * x; }"),
    Text("lib.wgsl", "GAIN = 2.0", "GAIN = 4.0 / 2.0"),
    Text("lib.wgsl", "GAIN * x", "x * GAIN"),
    Text("lib.wgsl", "GAIN * x", "x + x"),
    Text("lib.wgsl", "return GAIN * x;", "let y = x;\n    return GAIN * y;"),
    Text("lib.wgsl", "const GAIN = 2.0;", "const GAIN: f32 = 2.0;"),
    Text("lib.wgsl", "fn scaled(x: f32)", "fn scaled(\n    x: f32,\n)"),
    Text("lib.wgsl", "{ return x; }", "{\n    return x;\n}"),
    Text("main.wgsl", "let half = 0.5", "let half = 0.25"),
    Text("main.wgsl", "vec2f(x, half)", "vec2f(half, x)"),
    Text("main.wgsl", "fn unused", "fn useless"),
    Text("main.wgsl", "let half = 0.5; return vec2f(x, half)", "let a = 0.5; return vec2f(x, a)"),
    Text(
        "main.wgsl",
        "struct Params { gain: f32, count: u32 }",
        "struct Params { count: u32, gain: f32 }",
    ),
    Text("main.wgsl", "count: u32 }", "count: u32, more: vec4f }"),
    Text("main.wgsl", "@binding(1)", "@binding(7)"),
    Text("main.wgsl", "@group(0) @binding(1)", "@group(1) @binding(1)"),
    Text("main.wgsl", "array<f32>", "array<f32, 16>"),
    Text("main.wgsl", "override STEP: f32 = 1.0", "override STEP = 1.0"),
    Text("main.wgsl", "override STEP: f32 = 1.0", "@id(3) override STEP: f32 = 2.0"),
    Text("main.wgsl", "override STEP", "override MORE: bool = true;\noverride STEP"),
    Text("main.wgsl", RUN, "@compute @workgroup_size(8, 2) fn run"),
    Text("main.wgsl", RUN, "@workgroup_size(4) @compute fn run"),
    Text("main.wgsl", "fn run()", "fn go()"),
    Text("main.wgsl", "fn run()", "fn run(@builtin(local_invocation_index) at: u32)"),
    Text("main.wgsl", "let i = params.count", "var i = params.count"),
    Text("main.wgsl", "let i = params.count;", "let i = params.count;\n    _ = i;"),
    Text("main.wgsl", "params.gain * STEP", "STEP"),
    Text("main.wgsl", "@location(0) at: vec3f", "@location(2) at: vec3f"),
    Text("main.wgsl", "vec4f(at, 1.0)", "vec4f(at.zyx, 1.0)"),
    Text("main.wgsl", "@fragment fn fs()", "@fragment fn shade()"),
    Text("main.wgsl", "tone(0.5)", "tone(0.75)"),
    Text("main.wgsl", "@fragment", "@fragment // draws\n"),
    Text("main.wgsl", "{scaled}", "{scaled, idle}"),
    Text("main.wgsl", "import package::lib::{scaled};", "import package::lib::scaled;"),
    Text("main.wgsl", "return scaled(x)", "return (scaled(x))"),
    Text("main.wgsl", "fn tone(x: f32)", "fn tone(x: f32,)"),
    Text("main.wgsl", "{ return scaled(x); }", "{ let y = scaled(x); return y; }"),
    Text("main_test.wgsl", "tone(3.0), 6.0", "tone(4.0), 8.0"),
    Text("main_test.wgsl", "6.0, 0.0", "6.0, 1e-3"),
    Text("main_test.wgsl", "fn doubles", "fn is_double"),
    Text("main_test.wgsl", "@test", "/* a test */ @test"),
    Text("main_test.wgsl", "expect_near(tone", "let two = 2.0;\n    expect_near(two * 0.5 * tone"),
    Text("main.test.toml", "exact", "1 ulp"),
    Text("main.test.toml", "[[test]]", "# a table\n[[test]]"),
    Text("main.test.toml", "[[test]]", "[[test]]\nname = \"rows\""),
    Text("rows", "3,6", "5,10"),
    Text("rows", "x,result\n0,0\n3,6", "# doubled\nresult,x\n0,0\n6,3"),
    Name("main_test.wgsl", "tests.wgsl"),
];

struct Project {
    folder: TempDir,
}

impl Project {
    /// Makes an edit in a package, and returns a function that undoes it.
    fn edit(&self, package: &str, edit: &Edit) -> Box<dyn Fn()> {
        let folder = self.folder.path().join(package);
        match edit {
            Text(file, from, to) => {
                let before = text(package, file);
                assert!(before.contains(*from), "`{from}` isn't in {package}/{file}");
                save(&folder, file, &before.replace(*from, to));
                let file = (*file).to_owned();
                Box::new(move || save(&folder, &file, &before))
            }
            Name(from, to) => {
                let (from, to) = (folder.join(from), folder.join(to));
                std::fs::rename(&from, &to).expect("renamed");
                Box::new(move || std::fs::rename(&to, &from).expect("renamed"))
            }
        }
    }

    fn test(&self, package: &str) -> Ran {
        output(
            command(self.folder.path(), &["test", package, "--paths", "cpu"]).env("CARGO", "true"),
        )
    }
}

/// Replaces the file by a new file, as editors do.
fn save(folder: &FilePath, file: &str, text: &str) {
    write(folder, ".saved", text);
    std::fs::rename(folder.join(".saved"), folder.join(file)).expect("renamed");
}

// Lesson 191
#[test]
fn watch_and_test_agree_after_each_edit() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let manifest = "[workspace]\n[workspace.metadata.karat]\npackages = [\"a\", \"b\", \"c\"]\n";
    write(folder.path(), "Cargo.toml", manifest);
    for package in PACKAGES {
        let files =
            ["lib.wgsl", "main.wgsl", "main_test.wgsl", "main.test.toml", "rows", "karat.toml"];
        for file in files.into_iter().filter(|file| package == "c" || *file != "karat.toml") {
            write(&folder.path().join(package), file, &text(package, file));
        }
    }
    let project = Project { folder };
    let watch = Watching::of(project.folder.path(), &[], |command| {
        command.env("CARGO", "true");
    });
    let line = |package: &str, word: &str| watch.until_any(&format!("cpu ({package}): "), &[word]);
    // The packages may run in any order.
    let mut told = String::new();
    while PACKAGES.iter().any(|package| !told.contains(&format!("cpu ({package}): 2 tests pass"))) {
        told += &watch.until("2 tests pass");
    }
    for package in PACKAGES {
        assert!(project.test(package).good().contains("2 checks, 0 failed"));
    }
    let mut at = PACKAGES.into_iter().cycle();
    for (kind, edits) in &INVALID {
        for edit in edits {
            let package = at.next().expect("it goes on");
            let undo = project.edit(package, edit);
            let ran = project.test(package);
            assert_eq!(ran.code, Some(1), "{kind} in {package}: {ran:?}");
            let words = ["WGSL error", "no verdict", "tests fail"];
            watch.until_any(&format!("cpu ({package}): "), &words);
            undo();
            line(package, "2 tests pass;");
        }
    }
    for edit in &VALID {
        let package = at.next().expect("it goes on");
        let undo = project.edit(package, edit);
        // The line may also name the file of the previous edit.
        watch.until_any("changed: ", &[&format!("{package}/")]);
        let told = watch.until(&format!("cpu ({package}): "));
        assert!(told.lines().last().is_some_and(|line| line.contains("2 tests pass;")), "{told}");
        let ran = project.test(package).good();
        assert!(ran.contains("2 checks, 0 failed"), "{ran}");
        undo();
        // The line may also name the file of the previous edit.
        watch.until_any("changed: ", &[&format!("{package}/")]);
        watch.until(&format!("cpu ({package}): "));
    }
}
