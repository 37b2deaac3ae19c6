//! The command line as a process: its output and its exit codes.

#[path = "cli/asserts.rs"]
mod asserts;
#[path = "cli/browser.rs"]
mod browser;
#[path = "cli/call.rs"]
mod call;
#[path = "cli/check.rs"]
mod check;
#[path = "cli/compare.rs"]
mod compare;
#[path = "cli/compilers.rs"]
mod compilers;
#[path = "cli/coverage.rs"]
mod coverage;
#[path = "cli/crates.rs"]
mod crates;
#[path = "cli/diff.rs"]
mod diff;
#[path = "cli/doctor.rs"]
mod doctor;
#[path = "cli/domains.rs"]
mod domains;
#[path = "cli/entry_points.rs"]
mod entry_points;
#[path = "cli/errors.rs"]
mod errors;
#[path = "cli/escapes.rs"]
mod escapes;
#[path = "given/faults.rs"]
mod faults;
#[path = "given/files.rs"]
mod files;
#[path = "cli/gallery.rs"]
mod gallery;
#[path = "cli/hazards.rs"]
mod hazards;
#[path = "cli/idle.rs"]
mod idle;
#[path = "cli/init.rs"]
mod init;
#[path = "cli/interrupted.rs"]
mod interrupted;
#[path = "cli/mutate.rs"]
mod mutate;
#[path = "cli/names.rs"]
mod names;
#[path = "cli/others.rs"]
mod others;
#[path = "cli/outputs.rs"]
mod outputs;
#[path = "cli/pending.rs"]
mod pending;
#[path = "cli/pipes.rs"]
mod pipes;
#[path = "cli/pixels.rs"]
mod pixels;
#[path = "given/program.rs"]
mod program;
#[path = "cli/replay.rs"]
mod replay;
#[path = "cli/report.rs"]
mod report;
#[path = "cli/report_page.rs"]
mod report_page;
#[path = "given/repository.rs"]
mod repository;
#[path = "cli/runs.rs"]
mod runs;
#[path = "cli/search.rs"]
mod search;
#[path = "cli/suite.rs"]
mod suite;
#[cfg(unix)]
#[path = "cli/terminal.rs"]
mod terminal;
#[path = "cli/translations.rs"]
mod translations;
#[path = "cli/tutorial.rs"]
mod tutorial;
#[path = "cli/unreferenced.rs"]
mod unreferenced;
#[path = "cli/untold.rs"]
mod untold;
#[path = "cli/watch.rs"]
mod watch;
#[cfg(unix)]
#[path = "cli/watch_edits.rs"]
mod watch_edits;
#[path = "cli/watch_screen.rs"]
mod watch_screen;
#[cfg(unix)]
#[path = "cli/workflows.rs"]
mod workflows;

use std::io::Read;
use std::path::Path as FilePath;
use std::process::{Command, Stdio};

use tempfile::TempDir;

use self::files::write;
use self::pending::pending_frame;
use self::program::program;

const SHADERS: [(&str, &str); 3] = [
    ("constants.wgsl", "const TWO = 2.0;\n"),
    (
        "calc.wgsl",
        "import package::constants::TWO;\n\n\
         /// Twice its argument.\n\
         fn double(x: f32) -> f32 { return TWO * x; }\n\
         fn same(x: f32) -> f32 { return x; }\n\
         fn third() -> f32 { return 0.333333343267440796; }\n\
         fn add(a: vec3f, b: f32) -> vec3f { return a + b; }\n\
         struct Hit { t: f32, n: vec2f, id: u32 }\n\
         fn scale(hit: Hit, s: f32) -> Hit { return Hit(hit.t * s, hit.n * s, hit.id + 1u); }\n\
         fn sum(a: array<f32, 3>, flip: bool) -> f32 {\n    \
             let s = a[0] + a[1] + a[2];\n    return select(s, -s, flip);\n}\n\
         fn negate(x: i32) -> i32 { return -x; }\n\
         fn next(x: u32) -> u32 { return x + 1u; }\n\
         fn is_low(x: i32, y: u32) -> bool { return x < 0 && y > 1u; }\n\
         @compute @workgroup_size(1) fn main() {}\n",
    ),
    ("small.wgsl", "enable f16;\nfn halve(x: f16) -> f16 { return x * 0.5h; }\n"),
];

/// A project with the folder `shaders`, in which the command line searches for modules.
fn project() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    write(folder.path(), "Cargo.toml", "[workspace]\n");
    for (file, text) in SHADERS {
        write(&folder.path().join("shaders"), file, text);
    }
    folder
}

/// The result of a run of the command line.
#[derive(Debug)]
struct Ran {
    code: Option<i32>,
    out: String,
    err: String,
}

impl Ran {
    #[track_caller]
    fn good(self) -> String {
        assert_eq!(self.code, Some(0), "{self:?}");
        self.out
    }

    /// Returns the message of a command that couldn't do its work.
    #[track_caller]
    fn error(self) -> String {
        self.failure(2)
    }

    /// Returns the message of a command that ended with this code.
    #[track_caller]
    fn failure(self, code: i32) -> String {
        assert_eq!(self.code, Some(code), "{self:?}");
        assert!(self.err.starts_with("error: "), "{self:?}");
        self.err
    }
}

fn command(folder: &FilePath, arguments: &[&str]) -> Command {
    let mut command = program(folder);
    // Without a window system, Mesa's device-select layer would print a warning.
    command.env_remove("NODEVICE_SELECT").env_remove("XDG_RUNTIME_DIR").env("COLUMNS", "100");
    command.args(arguments);
    command
}

fn output(command: &mut Command) -> Ran {
    let output = command.output().expect("the binary was built with this test");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    Ran { code: output.status.code(), out: text(&output.stdout), err: text(&output.stderr) }
}

fn karat(folder: &FilePath, arguments: &[&str]) -> Ran {
    output(&mut command(folder, arguments))
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error} in:\n{text}"))
}

/// Returns the paths that open on this machine, from `karat doctor`.
fn open_paths(folder: &FilePath) -> Vec<String> {
    let report = json(&karat(folder, &["doctor", "--json"]).good());
    let paths = report["paths"].as_array().expect("a list");
    let open = paths.iter().filter(|path| !path["adapter"].is_null());
    open.map(|path| path["path"].as_str().expect("a name").to_owned()).collect()
}

// Lesson 38
#[test]
fn call_prints_each_path_with_decimal_and_hexadecimal_value() {
    let project = project();
    let paths = open_paths(project.path());
    assert!(!paths.is_empty(), "a check needs a path");
    let mut expected = "calc::add(a: vec3<f32>, b: f32) -> vec3<f32>\n".to_owned();
    for path in &paths {
        let value = "(1.5, 2.25, -1)  0x1.8p+0 0x1.2p+1 -0x1p+0";
        expected.push_str(&format!("{path:<8} {value}\n"));
    }
    assert_eq!(
        karat(project.path(), &["call", "calc::add", "1,1.75,-1.5", "0.5"]).good(),
        expected
    );

    let one = ["call", "calc::double", "--path", &paths[0], "--", "-21"];
    let expected = format!("calc::double(x: f32) -> f32\n{:<8} -42  -0x1.5p+5\n", paths[0]);
    assert_eq!(karat(project.path(), &one).good(), expected);
}

// Lesson 38
#[test]
fn call_takes_and_returns_every_type() {
    let project = project();
    let path = &open_paths(project.path())[0];
    for (arguments, value) in [
        (&["calc::third"][..], "0.33333334  0x1.555556p-2"),
        (
            &["calc::scale", "1,2,3,4294967294", "0.5"],
            "{ t: 0.5, n: (1, 1.5), id: 4294967295 }  0x1p-1 0x1p+0 0x1.8p+0",
        ),
        (&["calc::sum", "1,2,3", "true"], "-6  -0x1.8p+2"),
        (&["calc::sum", "1, 2, 3", "false"], "6  0x1.8p+2"),
        (&["calc::negate", "-5"], "5"),
        (&["calc::negate", "2147483647"], "-2147483647"),
        (&["calc::next", "4294967294"], "4294967295"),
        (&["calc::is_low", "-1", "2"], "true"),
        (&["calc::is_low", "1", "2"], "false"),
        (&["calc::same", "NaN"], "NaN  NaN("),
        (&["calc::same", "inf"], "inf  inf"),
        (&["calc::same", "1e-45"], "1e-45  0x0.000002p-126"),
        (&["calc::same", "-0"], "-0  -0x0p+0"),
    ] {
        let all = [&["call", "--path", path][..], arguments].concat();
        let out = karat(project.path(), &all).good();
        let line = out.lines().nth(1).unwrap_or_else(|| panic!("{out}"));
        assert!(
            line.strip_prefix(&format!("{path:<8} ")).is_some_and(|l| l.starts_with(value)),
            "{out}"
        );
    }
}

#[test]
fn call_runs_f16_where_there_is_f16() {
    let project = project();
    for path in open_paths(project.path()) {
        let ran = karat(project.path(), &["call", "small::halve", "3", "--path", &path]);
        if ran.code == Some(0) {
            assert!(ran.out.ends_with(&format!("{path:<8} 1.5  0x1.8p+0\n")), "{ran:?}");
        } else {
            let message = format!("`small::halve` needs f16, which path `{path}` doesn't have");
            assert!(ran.error().contains(&message));
        }
    }
    let error = karat(project.path(), &["call", "small::halve", "65520"]).error();
    assert!(error.contains("argument `x`: `65520` is too large for f16"), "{error}");
}

#[test]
fn call_explains_wrong_arguments() {
    let project = project();
    for (arguments, message) in [
        (
            &["calc::double", "1", "2"][..],
            "`calc::double` needs 1 argument, but the call has 2\n  calc::double(x: f32) -> f32",
        ),
        (&["calc::double"], "`calc::double` needs 1 argument, but the call has 0"),
        (
            &["calc::add", "1,2", "3"],
            "argument `a` is a vec3<f32> with 3 components, but `1,2` has 2",
        ),
        (&["calc::double", "1,2"], "argument `x` is a f32 with 1 component, but `1,2` has 2"),
        (&["calc::double", "one"], "argument `x`: `one` isn't a value of type f32"),
        (&["calc::double", ""], "argument `x`: `` isn't a value of type f32"),
        (&["calc::double", "1e39"], "argument `x`: `1e39` is too large for f32"),
        (&["calc::next", "-1"], "argument `x`: `-1` isn't a value of type u32"),
        (&["calc::next", "4294967296"], "argument `x`: `4294967296` isn't a value of type u32"),
        (&["calc::sum", "1,2,3", "1"], "argument `flip`: `1` isn't a value of type bool"),
        (
            &["calc::duoble", "1"],
            "has no function `calc::duoble` (functions in the package: 11); did you mean `calc::double`?",
        ),
        (&["calc::double", "1", "--path", "vulcan"], "did you mean `vulkan`?"),
        (
            &["calc::double", "1", "--out", "out.csv"],
            "--out needs a table or a sweep: add --table IN.CSV",
        ),
        (&["calc::double", "1", "--shaders", "nowhere"], "there is no folder or file `nowhere`"),
        (&["calc::add", "-1,2,3", "4"], "to pass '-1' as a value, use '-- -1'"),
    ] {
        let error = karat(project.path(), &[&["call"], arguments].concat()).error();
        assert!(error.contains(message), "{arguments:?}: {error}");
    }
}

/// A table keeps the bits of its values: each path returns every value unchanged, and Karat writes a decimal that
/// parses to the same `f32`.
#[test]
fn a_table_of_cases_round_trips_bit_by_bit() {
    let project = project();
    let inputs = [
        0.1,
        -0.0,
        f32::MIN_POSITIVE,
        f32::from_bits(1),
        f32::from_bits(0x807f_ffff),
        f32::MAX,
        f32::MIN,
        16_777_215.0,
        1.0 + f32::EPSILON,
        f32::INFINITY,
        f32::NEG_INFINITY,
    ];
    let mut text = "# one case a row\n\n# in any order\nx\n".to_owned();
    text.extend(inputs.iter().map(|x| format!("{x:e}\n")));
    text.push_str("\nNaN");
    write(project.path(), "in.csv", &text);
    let table = ["call", "calc::same", "--table", "in.csv", "--out", "out.csv"];
    assert_eq!(karat(project.path(), &table).good(), "");

    let out = std::fs::read_to_string(project.path().join("out.csv")).expect("written");
    let paths = open_paths(project.path());
    let (head, rows) = out.split_once('\n').expect("a head");
    assert_eq!(head, format!("x,{}", paths.join(",")));
    assert_eq!(rows.lines().count(), inputs.len() + 1, "{out}");
    for (row, input) in rows.lines().zip(inputs) {
        let values: Vec<f32> = row.split(',').map(|word| word.parse().expect("a number")).collect();
        assert_eq!(values.len(), 1 + paths.len(), "{row}");
        for value in values {
            assert_eq!(value.to_bits(), input.to_bits(), "{row}");
        }
    }
    let last = rows.lines().last().expect("a row");
    assert!(last.split(',').all(|word| word == "NaN"), "{last}");
}

#[test]
fn a_table_may_name_its_columns_in_any_order_or_not_at_all() {
    let project = project();
    let path = open_paths(project.path()).remove(0);
    let expected = format!(
        "a.x,a.y,a.z,b,{path}.x,{path}.y,{path}.z\n1,2,3,10,11,12,13\n4,5,6,0.5,4.5,5.5,6.5\n"
    );
    for text in [
        "1,2,3,10\n4,5,6,0.5\n",
        "a.x,a.y,a.z,b\n1,2,3,10\n4,5,6,0.5\n",
        "# swapped\r\nb, a.z, a.x, a.y\r\n10, 3, 1, 2\r\n\r\n0.5, 6, 4, 5\r\n",
    ] {
        write(project.path(), "in.csv", text);
        let table = ["call", "calc::add", "--table", "in.csv", "--path", &path];
        assert_eq!(karat(project.path(), &table).good(), expected, "{text}");
    }
    // The columns have types, and a row follows blank lines.
    write(project.path(), "in.csv", "y,x\n\n\n7,-3\n");
    let table = ["call", "calc::is_low", "--table", "in.csv", "--path", &path];
    assert_eq!(karat(project.path(), &table).good(), format!("x,y,{path}\n-3,7,true\n"));
}

// Lesson 194
#[test]
fn a_faulty_table_is_an_error_that_names_the_line() {
    let project = project();
    for (text, message) in [
        ("x\n1\n2,3\n4\n", "`in.csv` line 3 has 2 columns, but a case needs 1: x"),
        ("# why\r\n\r\nx\r\n\r\ntwo", "`in.csv` line 5, column `x`: `two`"),
        ("x\n1\n\n\ntwo\n", "`in.csv` line 5, column `x`: `two` isn't a value of type f32"),
        (
            "x\n1\n\n#2\n",
            "`in.csv` line 4 begins with `#`, but comments are allowed only above the header",
        ),
        ("1\n#2\n3\n", "`in.csv` line 2 begins with `#`"),
        ("note,x\n#ff8000,1\n", "`in.csv` line 2 begins with `#`"),
        ("1\n\n1e99\n", "`in.csv` line 3, column `x`: `1e99` is too large for f32"),
        ("1,2\n", "`in.csv` line 1 has 2 columns, but a case needs 1: x"),
        ("value\n1\n", "`in.csv` has no column `x`; its columns are value"),
        ("", "the table `in.csv` has no cases"),
        ("x\n", "the table `in.csv` has no cases"),
        ("# nothing\n", "the table `in.csv` has no cases"),
    ] {
        write(project.path(), "in.csv", text);
        let error = karat(project.path(), &["call", "calc::double", "--table", "in.csv"]).error();
        assert!(error.contains(message), "{text:?}: {error}");
    }
    for (head, message) in [
        (
            "a.x,a.y,a.w,b",
            "`in.csv` has no column `a.z` (did you mean `a.w`?); its columns are a.x,a.y,a.w,b",
        ),
        (
            "a.x,a.y,b,b",
            "`in.csv` has two columns `b`, and Karat can't know which column you mean: rename or remove one column",
        ),
    ] {
        write(project.path(), "in.csv", &format!("{head}\n1,2,3,4\n"));
        let error = karat(project.path(), &["call", "calc::add", "--table", "in.csv"]).error();
        assert!(error.contains(message), "{error}");
    }
    write(project.path(), "in.csv", "1\n");
    for (arguments, message) in [
        (
            &["calc::double", "--table", "in.csv", "--out", "in.csv/out.csv"][..],
            "can't write `in.csv/out.csv`",
        ),
        (&["calc::double", "--table", "missing.csv"], "can't read `missing.csv`"),
        (&["calc::third", "--table", "in.csv"], "`calc::third` has no parameters"),
        (&["calc::double", "1", "--table", "in.csv"], "cannot be used with"),
    ] {
        let error = karat(project.path(), &[&["call"], arguments].concat()).error();
        assert!(error.contains(message), "{arguments:?}: {error}");
    }
}

#[test]
fn show_prints_a_whole_shader() {
    let project = project();
    let out = karat(project.path(), &["show", "calc::double"]).good();
    assert!(out.starts_with("// calc::double(x: f32) -> f32\n// shaders/calc.wgsl:4:1\n"), "{out}");
    assert!(out.contains("fn double(") && out.contains("fn karat_probe("), "{out}");
    assert!(!out.contains("fn add("), "only what the function needs: {out}");
    naga::front::wgsl::parse_str(&out).unwrap_or_else(|error| panic!("{error}:\n{out}"));
    assert!(karat(project.path(), &["show", "calc::duoble"]).error().contains("`calc::double`?"));
    // One file is a package of one module. Its functions have no module name in front.
    let out = karat(project.path(), &["show", "halve", "--shaders", "shaders/small.wgsl"]).good();
    assert!(out.starts_with("// halve(x: f16) -> f16\n"), "{out}");
}

#[test]
fn list_shows_signatures_and_what_is_broken_beside_the_rest() {
    let project = project();
    let broken =
        "fn sound(x: f32) -> f32 { return x; }\nfn broken() -> f32 { return vec2f(1.0); }\n";
    write(project.path(), "shaders/broken.wgsl", broken);
    let ran = karat(project.path(), &["list"]);
    assert_eq!(ran.code, Some(1), "a module isn't valid: {ran:?}");
    let out = ran.out;
    for part in [
        "calc::add(a: vec3<f32>, b: f32) -> vec3<f32>",
        "shaders/calc.wgsl:4:4",
        "broken::sound(x: f32) -> f32",
        "can't be called  shaders/broken.wgsl:2:4",
        "--> shaders/broken.wgsl:2:",
    ] {
        assert!(out.contains(part), "`{part}` is missing in:\n{out}");
    }
    assert!(out.contains("@compute calc::main"), "an entry point is listed with its stage");

    let list = json(&karat(project.path(), &["list", "--json"]).out);
    let list = list.as_array().expect("a list");
    let find = |name: &str| {
        list.iter().find(|entry| entry["function"] == name).unwrap_or_else(|| panic!("no {name}"))
    };
    let double = find("calc::double");
    assert_eq!(double["signature"], "calc::double(x: f32) -> f32");
    assert_eq!(double["doc"], "Twice its argument.");
    assert_eq!((&double["tested"], &double["error"]), (&false.into(), &serde_json::Value::Null));
    let broken = find("broken::broken");
    assert!(broken["signature"].is_null());
    assert!(broken["error"].as_str().is_some_and(|text| text.contains("broken.wgsl:2:")));
    assert_eq!(list.len(), 13);
}

#[test]
fn a_project_says_where_its_shaders_are() {
    let project = project();
    let folder = project.path();
    std::fs::rename(folder.join("shaders"), folder.join("wgsl")).expect("renamed");
    let error = karat(folder, &["list"]).error();
    assert!(error.contains("name the shader folder with --shaders DIR"), "{error}");
    let settings = "[workspace.metadata.karat]\npackages = [\"wgsl\"]\n";
    write(folder, "Cargo.toml", &format!("[workspace]\n{settings}"));
    assert!(karat(folder, &["list"]).good().contains("wgsl/calc.wgsl:4:4"));
    // The command also works from a folder inside the project.
    assert!(karat(&folder.join("wgsl"), &["list"]).good().contains("calc.wgsl:4:4"));
    write(folder, "Cargo.toml", "[workspace.metadata.karat]\nshaders = [\"wgsl\"]\n");
    assert!(karat(folder, &["list"]).error().contains("unknown field `shaders`"));
}

/// `cargo karat test` does the same as `karat test`. Cargo passes the name `karat` as the first argument.
#[test]
fn cargo_karat_does_the_same_as_karat() {
    let project = project();
    for (arguments, code) in [(&["--version"][..], 0), (&["list"], 0), (&["tset"], 2)] {
        let mut program = Command::new(env!("CARGO_BIN_EXE_cargo-karat"));
        program.env("NO_COLOR", "1").current_dir(project.path()).arg("karat").args(arguments);
        let ran = output(&mut program);
        let own = karat(project.path(), arguments);
        assert_eq!((ran.code, &ran.out), (Some(code), &own.out), "{arguments:?}: {ran:?}");
        assert!(code == 2 || !ran.out.is_empty(), "{ran:?}");
    }
}

#[test]
fn doctor_reports_which_paths_open() {
    let project = project();
    let folder = project.path();
    let report = json(&karat(folder, &["doctor", "--json"]).good());
    assert_eq!(report["karat"], env!("CARGO_PKG_VERSION"));
    for path in report["paths"].as_array().expect("a list") {
        let opens = path["adapter"]["name"].is_string() && path["adapter"]["driver"].is_string();
        let missing = path["missing"].is_string() && path["remedy"].is_string();
        assert!(opens != missing, "{path}");
    }
    // `karat doctor` prints each setting with its value.
    let ran = output(command(folder, &["doctor"]).env("KARAT_SEED", "0x7").env("KARAT_PATHS", ""));
    assert!(ran.out.contains("\nKARAT_SEED       = 0x7\n"), "{ran:?}");
    assert!(ran.out.contains("\nKARAT_PATHS      not set\n"), "{ran:?}");
    assert!(report["settings"].as_array().is_some_and(|settings| settings.len() == 17), "{report}");
    let named = output(command(folder, &["doctor"]).env("KARAT_EXECUTORS", "mine=/nowhere/at/all"));
    assert!(
        named.out.contains("\nprocess@mine execution path `process@mine` is unavailable"),
        "{named:?}"
    );
    let paths = open_paths(folder);
    let out = karat(folder, &["doctor", "--require", &paths.join(",")]).good();
    assert!(paths.iter().all(|path| out.contains(&format!("\n{path:<8} "))), "{out}");
    // The report has paths that name a driver, and paths that no program provides.
    let family = report["paths"]
        .as_array()
        .and_then(|all| all.iter().find(|path| path["path"] == *paths[0])?["family"].as_str());
    let driver = format!("{}@{}", paths[0], family.expect("it opens"));
    let out = karat(folder, &["doctor", "--require", &driver]).good();
    assert!(out.contains(&format!("\n{driver} ")), "{out}");
    let out = karat(folder, &["doctor", "--require", "cpu"]).good();
    assert!(out.contains("\ncpu      Karat's engine"), "{out}");
    for missing in ["vulkan@nobody", "gl:hlsl", "cpu:hlsl"] {
        let ran = karat(folder, &["doctor", "--require", missing]);
        assert_eq!(ran.code, Some(1), "{ran:?}");
        assert!(ran.out.contains(&format!("`{missing}` is unavailable")), "{ran:?}");
    }
    // With these settings, checks run on no path.
    for wrong in ["nonsense", "vulkan@nobody"] {
        let ran = output(command(folder, &["doctor"]).env("KARAT_PATHS", wrong));
        assert_eq!(ran.code, Some(1), "{ran:?}");
        assert!(ran.out.contains("no path can run checks:") && ran.out.contains(wrong), "{ran:?}");
    }
    let foreign = if cfg!(target_os = "macos") { "dx12" } else { "metal" };
    let ran = karat(folder, &["doctor", "--require", &format!("{},{foreign}", paths[0])]);
    assert_eq!(ran.code, Some(1), "{ran:?}");
    assert!(ran.out.contains(&format!("`{foreign}` is unavailable")), "{ran:?}");
    let error = karat(folder, &["doctor", "--require", "vulkn"]).error();
    assert!(error.contains("did you mean `vulkan`?"), "{error}");
    // Without a driver, nothing can be checked.
    let ran = output(command(folder, &["doctor"]).env("KARAT_ADAPTER", "no such adapter"));
    assert_eq!(ran.code, Some(1), "{ran:?}");
}

#[test]
fn preview_writes_a_png() {
    let project = project();
    let folder = project.path();
    pending_frame(folder, "scene", "any");
    assert_eq!(karat(folder, &["preview", "scene.new.exr"]).good(), "scene.new.png\n");
    assert_eq!(karat(folder, &["preview", "scene.new.exr", "--out", "a.png"]).good(), "a.png\n");
    let brighter = ["preview", "scene.new.exr", "--out", "b.png", "--exposure", "1.5"];
    assert_eq!(karat(folder, &brighter).good(), "b.png\n");
    let bytes = |file: &str| std::fs::read(folder.join(file)).expect("written");
    assert!(bytes("a.png") == bytes("scene.new.png") && bytes("a.png") != bytes("b.png"));
    let error = karat(folder, &["preview", "scene.new.exr", "--exposure", "inf"]).error();
    assert!(error.contains("`inf` isn't a finite number of stops"), "{error}");
    for file in ["scene.new.png", "a.png", "b.png"] {
        let png = std::fs::read(folder.join(file)).expect("written");
        assert!(png.starts_with(b"\x89PNG\r\n\x1a\n"), "{file}");
    }
    let exr = std::fs::read(folder.join("scene.new.exr")).expect("written");
    std::fs::write(folder.join("half.exr"), &exr[..exr.len() / 2]).expect("written");
    write(folder, "text.exr", "not an image");
    for (file, message) in [
        ("half.exr", "`half.exr` isn't a readable OpenEXR image"),
        ("text.exr", "`text.exr` isn't a readable OpenEXR image"),
        ("none.exr", "there is no image `none.exr`"),
    ] {
        let code = if file == "none.exr" { 3 } else { 2 };
        let error = karat(folder, &["preview", file]).failure(code);
        assert!(error.contains(message), "{error}");
        assert!(!folder.join(file).with_extension("png").exists(), "no PNG of a bad image");
    }
}

/// `karat render` refuses bad arguments before it builds the gallery. `cli/gallery.rs` tests valid arguments.
#[test]
fn render_explains_bad_arguments_and_how_to_declare_a_gallery() {
    let project = project();
    let folder = project.path();
    let error = karat(folder, &["render", "scene"]).error();
    for part in [
        "error: this project declares no gallery",
        "    [workspace.metadata.karat]\n    gallery = \"gallery\"\n",
        "    karat_gallery::Gallery::new()\n",
    ] {
        assert!(error.contains(part), "no `{part}` in:\n{error}");
    }
    for (arguments, message) in [
        (
            &["--size", "0x5"][..],
            "the image can't have a side of 0 pixels: write 1 to 16384 pixels",
        ),
        (
            &["--size", "16385x1"],
            "the image can't have a side of 16385 pixels: write 1 to 16384 pixels",
        ),
        (&["--size", "640"], "`640` isn't a size: write width x height in pixels, as in 640x360"),
        (&["--size", "640X360"], "`640X360` isn't a size: write width x height in pixels"),
        (&["--samples", "0"], "invalid value '0' for '--samples <N>': 0 is not in 1.."),
        (&["--exposure", "NaN"], "`NaN` isn't a finite number of stops"),
        (&["--exposure", "-inf"], "`-inf` isn't a finite number of stops"),
        (&["--environment", "sky.exr"], "'--environment <FILE>': there is no such file"),
        (&["--environment", "shaders"], "'--environment <FILE>': the path isn't a file"),
        (&["--path", "vulcan"], "did you mean `vulkan`?"),
        (&["--first"], "cannot be used with '--first'"),
    ] {
        let error = karat(folder, &[&["render", "scene"], arguments].concat()).error();
        assert!(error.contains(message), "{arguments:?}: {error}");
    }
}

#[test]
fn usage_is_explained() {
    let project = project();
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        assert!(karat(project.path(), &["completions", shell]).good().contains("karat"), "{shell}");
    }
    assert!(
        karat(project.path(), &["tset"]).error().contains("a similar subcommand exists: 'test'")
    );
    assert_eq!(karat(project.path(), &[]).code, Some(2), "no subcommand");
    let version = karat(project.path(), &["--version"]).good();
    assert_eq!(version, format!("karat {}\n", env!("CARGO_PKG_VERSION")));
    let all = karat(project.path(), &["--help"]).good();
    for (command, example) in [
        ("test", "karat test schlick --paths all"),
        ("list", ""),
        ("show", ""),
        ("call", "karat call fresnel::schlick 0.04,0.04,0.04 0.3"),
        ("doctor", ""),
        ("report", "karat report --github"),
        ("pending", "karat pending --from karat.zip --json"),
        ("accept", "karat accept scene --because \""),
        ("reject", "karat reject scene"),
        ("unreferenced", "karat unreferenced --delete"),
        ("diff", "karat diff golden/scene.exr golden/scene.new.exr"),
        ("render", "karat render --first"),
        ("preview", ""),
        ("completions", ""),
    ] {
        assert!(all.contains(&format!("\n  {command} ")), "{all}");
        let help = karat(project.path(), &[command, "--help"]).good();
        assert!(help.contains(&format!("Usage: karat {command} ")), "{help}");
        assert!(example.is_empty() || help.contains(&format!("\n  {example}")), "{help}");
    }
}

#[test]
fn colour_is_left_out_where_it_is_not_wanted() {
    let project = project();
    for arguments in
        [&["list"][..], &["doctor"], &["call", "calc::double", "1"], &["--help"], &["tset"]]
    {
        let escapes = |environment: &[(&str, &str)]| {
            let ran = output(command(project.path(), arguments).envs(environment.iter().copied()));
            ran.out.contains('\x1b') || ran.err.contains('\x1b')
        };
        assert!(escapes(&[("CLICOLOR_FORCE", "1")]), "{arguments:?}: nothing to leave out");
        assert!(!escapes(&[("CLICOLOR_FORCE", "1"), ("NO_COLOR", "1")]), "{arguments:?}");
        assert!(!escapes(&[]), "{arguments:?}: the output is no terminal");
    }
}

/// A command doesn't fail if the reader of its output closes the pipe early, as `head -1` does. `cli/pipes.rs` has more
/// tests of pipes.
#[test]
fn a_reader_may_close_the_pipe_early() {
    let project = project();
    for arguments in [
        &["list"][..],
        &["list", "--json"],
        &["show", "calc::double"],
        &["doctor", "--json"],
        &["completions", "bash"],
        &["--help"],
        &["call", "calc::double", "1"],
    ] {
        let mut command = command(project.path(), arguments);
        let mut child = command
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("the binary was built with this test");
        drop(child.stdout.take());
        let mut err = String::new();
        child.stderr.take().expect("piped").read_to_string(&mut err).expect("text");
        let code = child.wait().expect("it ends").code();
        assert_eq!((code, err.as_str()), (Some(0), ""), "{arguments:?}");
    }
}
